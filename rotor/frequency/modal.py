"""Natural frequencies and damped modes of the rotor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
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
        return -self.eigenvalue.real / np.abs(self.eigenvalue)


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


def _of_plane(system: LinearSystem, plane: int | None) -> NDArray[np.bool_]:
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
    DampedModes sorted by frequency; overdamped (real) eigenvalues are left out
    """
    space = StateSpace(system, spin_speed)
    eigenvalue, vectors = np.linalg.eig(space.A)
    keep = np.imag(eigenvalue) > 1e-9 * np.abs(eigenvalue).max()
    order = np.argsort(np.abs(eigenvalue[keep]))
    shape = space.displacement(np.eye(system.n)).astype(complex) @ vectors[:, keep][:, order]
    return DampedModes(eigenvalue[keep][order], shape)
