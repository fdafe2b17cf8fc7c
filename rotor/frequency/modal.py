"""Natural frequencies and damped modes of the rotor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.system import LinearSystem


@dataclass(frozen=True)
class DampedModes:
    """Oscillating modes of the damped, spinning rotor; one of each conjugate pair."""

    eigenvalue: ComplexArray  # (m,) lambda [1/s], imaginary part positive
    shape: ComplexArray  # (n, m) displacement shapes

    @property
    def frequency_hz(self) -> FloatArray:
        """(m,) undamped natural frequency |lambda| / 2 pi [Hz]."""
        return np.abs(self.eigenvalue) / (2 * np.pi)

    @property
    def damping_ratio(self) -> FloatArray:
        """(m,) zeta = -Re lambda / |lambda| [-]."""
        return damping_ratio(self.eigenvalue)


@dataclass(frozen=True)
class ListedModes:
    """Modes as a table lists them: rigid-body motions first, at 0 Hz, then oscillations by frequency."""

    eigenvalue: ComplexArray  # (m,) lambda [1/s]; 0 of a rigid-body motion
    shape: ComplexArray  # (n, m) displacement shapes
    plane: IntArray  # (m,) 1 = y, 2 = z: the plane it moves in; 0: both
    alike: BoolArray  # (m,) whether the other plane has the same mode, which is not listed again

    @property
    def rigid_body(self) -> BoolArray:
        """(m,) whether it is a rigid-body motion."""
        return self.eigenvalue == 0

    @property
    def frequency_hz(self) -> FloatArray:
        """(m,) undamped natural frequency |lambda| / 2 pi [Hz]."""
        return np.abs(self.eigenvalue) / (2 * np.pi)

    @property
    def damped_frequency_hz(self) -> FloatArray:
        """(m,) Im lambda / 2 pi [Hz]."""
        return self.eigenvalue.imag / (2 * np.pi)

    @property
    def damping_ratio(self) -> FloatArray:
        """(m,) zeta = -Re lambda / |lambda| [-], nan of a rigid-body motion."""
        return damping_ratio(self.eigenvalue)

    @property
    def log_decrement(self) -> FloatArray:
        """(m,) see ``log_decrement``; nan of a rigid-body motion."""
        return log_decrement(self.eigenvalue)


def damping_ratio(eigenvalue: ComplexArray) -> FloatArray:
    """zeta = -Re lambda / |lambda| [-] of eigenvalues [1/s]; negative: unstable, nan where lambda is zero."""
    return _over(-eigenvalue.real, np.abs(eigenvalue))


def log_decrement(eigenvalue: ComplexArray) -> FloatArray:
    """delta = 2 pi zeta / sqrt(1 - zeta^2) = -2 pi Re lambda / Im lambda [-], nan where lambda is zero.

    It is the logarithm of the ratio of an amplitude to the one a period later.

    >>> zeta = 0.1
    >>> log_decrement(np.array([-zeta + 1j * np.sqrt(1 - zeta**2)])).round(4)
    array([0.6315])
    """
    return _over(-2 * np.pi * eigenvalue.real, eigenvalue.imag)


def _over(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Quotients; nan over zero."""
    return np.divide(numerator, denominator, out=np.full(numerator.shape, np.nan), where=denominator != 0)


def natural_frequencies_hz(system: LinearSystem, plane: int | None = None) -> FloatArray:
    """Undamped natural frequencies of the non-spinning rotor [Hz], ascending.

    Parameters
    ----------
    system : the supported rotor
    plane : 1 = y or 2 = z to list the bending modes of one plane; default both

    >>> system = build_system(assemble(load_rig("nit-rourkela")), Condition(rigid_support=True))
    >>> natural_frequencies_hz(system, plane=1)[:2].round(1)
    array([100.6, 324. ])
    """
    return system.modes.omega[_of_plane(system, plane)] / (2 * np.pi)


def elastic_frequencies_hz(system: LinearSystem, plane: int | None = None) -> FloatArray:
    """The same without rigid-body motions, whose frequency is zero, such as a shaft swinging about a single bearing."""
    return system.modes.omega[_of_plane(system, plane) & system.modes.elastic] / (2 * np.pi)


def _of_plane(system: LinearSystem, plane: int | None) -> BoolArray:
    """(n_modes,) which modes bend in a plane; all of them where none is given."""
    modes = system.modes
    if plane is None:
        return np.ones(len(modes.omega), dtype=bool)
    if plane not in (1, 2):
        raise ValueError(f"plane {plane} does not exist: 1 is y, 2 is z")
    inside = system.plane == plane
    kinetic_energy = modes.Phi * (system.M @ modes.Phi)  # (n, n_modes), each column sums to one
    return kinetic_energy[inside].sum(axis=0) > 0.5


def damped_modes(system: LinearSystem, spin_speed: float = 0.0) -> DampedModes:
    """Eigenvalues and shapes of M q'' + (C + Omega G) q' + K q = 0.

    Parameters
    ----------
    system : the supported rotor, n degrees of freedom
    spin_speed : Omega [rad/s]; the sign is the spin direction about +x

    Returns
    -------
    DampedModes sorted by frequency; overdamped (real) eigenvalues and rigid-body motions, which do not oscillate, are
    left out
    """
    space = StateSpace(system, spin_speed)
    eigenvalue, vectors = np.linalg.eig(space.A)
    keep = np.imag(eigenvalue) > 1e-9 * np.abs(eigenvalue).max()
    order = np.argsort(np.abs(eigenvalue[keep]))
    shape = space.displacement(np.eye(system.n)).astype(complex) @ vectors[:, keep][:, order]
    return DampedModes(eigenvalue[keep][order], shape)


def listed_modes(system: LinearSystem, spin_speed: float = 0.0) -> ListedModes:
    """All modes of the damped rotor as they are listed.

    Where spin and supports do not couple the planes, each mode moves in one of them; a mode that both planes have alike
    is listed once, in y. Otherwise a mode moves in both. Rigid-body motions are those that strain neither shaft nor
    supports.

    Parameters
    ----------
    system : the supported rotor, n degrees of freedom
    spin_speed : Omega [rad/s]

    >>> system = build_system(assemble(load_rig("nit-rourkela")), Condition(rigid_support=True))
    >>> modes = listed_modes(system)
    >>> modes.frequency_hz[:2].round(1), modes.alike[:2]
    (array([100.6, 324. ]), array([ True,  True]))
    """
    system = system.at(spin_speed)
    if system.couples_planes(spin_speed):
        return _list_of(system, spin_speed)
    in_y, in_z = (_list_of(system, spin_speed, plane) for plane in (1, 2))
    if _same(in_y, in_z):
        return replace(in_y, alike=np.ones(len(in_y.eigenvalue), dtype=bool))
    both = ListedModes(
        eigenvalue=np.concatenate([in_y.eigenvalue, in_z.eigenvalue]),
        shape=np.hstack([in_y.shape, in_z.shape]),
        plane=np.concatenate([in_y.plane, in_z.plane]),
        alike=np.concatenate([in_y.alike, in_z.alike]),
    )
    order = np.argsort(np.abs(both.eigenvalue), kind="stable")
    return ListedModes(both.eigenvalue[order], both.shape[:, order], both.plane[order], both.alike[order])


# Relative difference of two eigenvalues that counts as round-off.
_SAME = 1e-7


def _same(a: ListedModes, b: ListedModes) -> bool:
    """Whether two planes have the same modes."""
    x, y = a.eigenvalue, b.eigenvalue
    return x.shape == y.shape and bool(np.all(np.abs(x - y) <= _SAME * np.abs(x)))


def _list_of(system: LinearSystem, spin_speed: float, plane: int = 0) -> ListedModes:
    """Modes of one plane, or of both."""
    inside = np.flatnonzero(system.plane == plane) if plane else np.arange(system.n)
    part = system.in_plane(plane) if plane else system
    damped = damped_modes(part, spin_speed)
    rigid = part.modes.Phi[:, ~part.modes.elastic]
    m = rigid.shape[1] + len(damped.eigenvalue)
    shape = np.zeros((system.n, m), dtype=complex)
    shape[inside] = np.hstack([rigid, damped.shape])
    return ListedModes(
        eigenvalue=np.concatenate([np.zeros(rigid.shape[1], dtype=complex), damped.eigenvalue]),
        shape=shape,
        plane=np.full(m, plane, dtype=np.int64),
        alike=np.zeros(m, dtype=bool),
    )
