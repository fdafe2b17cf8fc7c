"""The spinning rotor: whirl over spin speed, critical speeds, stability, unbalance response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh

from rigtwin.rotor.frequency.frequency_response import dynamic_stiffness
from rigtwin.rotor.frequency.modal import damped_modes, damping_ratio
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.rotor_model import RotorModel
from rigtwin.rotor.model.system import LinearSystem, work

# Of a speed [rad/s] that is one revolution per minute.
RPM = np.pi / 30

# A mode whose orbits enclose less than this share of the area of circles has no direction: it
# moves in a plane, or both planes are alike and its direction is arbitrary.
_PLANAR = 1e-3

# Modes above those that are followed, so that a line that comes down from above does not push one of them out.
_SPARE = 6

# Accuracy of a crossing, relative to the spin speed; and what a line may be away from it there, relative to its
# frequency. A line that ends between two speeds, because its whirl stops oscillating, meets nothing.
_CROSSING, _MEETS = 1e-12, 1e-6

# Damping ratio below which a mode counts as growing; what is undamped has one of round-off.
_GROWING = -1e-9

# Speeds at which the whirls of a rotor whose supports follow the speed are computed to find its critical speeds.
_SPEEDS = 61

# Speeds around a critical one at which the response to unbalance is computed, and how far out in half bandwidths:
# they lie a tenth of a half bandwidth apart at the peak, which then is right to 0.2 %.
_LINES_OF_PEAK, _REACH_OF_PEAK = 81, 4.0


@dataclass(frozen=True)
class Campbell:
    """Damped modes over spin speed: a row for each speed, a column for each mode."""

    spin_speed: FloatArray  # (n_speeds,) [rad/s]
    eigenvalue: ComplexArray  # (n_speeds, n_modes) lambda [1/s]
    shape: ComplexArray  # (n_speeds, n, n_modes) displacement shapes
    direction: FloatArray  # (n_speeds, n_modes) 1 forward (y towards z, with a positive spin), -1 backward, 0 planar

    def lowest(self, n: int) -> Campbell:
        """The first n modes."""
        return Campbell(self.spin_speed, self.eigenvalue[:, :n], self.shape[:, :, :n], self.direction[:, :n])

    @property
    def frequency_hz(self) -> FloatArray:
        """(n_speeds, n_modes) damped whirl frequency Im(lambda) / 2 pi [Hz]."""
        return self.eigenvalue.imag / (2 * np.pi)

    @property
    def damping_ratio(self) -> FloatArray:
        """(n_speeds, n_modes) [-], negative: unstable."""
        return damping_ratio(self.eigenvalue)


@dataclass(frozen=True)
class Crossings:
    """Spin speeds at which a whirl turns as fast as the rotor, or at a multiple of its speed; ascending."""

    spin_speed: FloatArray  # (m,) [rad/s]
    eigenvalue: ComplexArray  # (m,) lambda [1/s] there
    direction: FloatArray  # (m,) as in ``Campbell``
    mode: IntArray  # (m,) column of the Campbell diagram, from 0


@dataclass(frozen=True)
class CriticalSpeeds:
    """Spin speeds at which a whirl turns as fast as the rotor, ascending."""

    spin_speed: FloatArray  # (m,) [rad/s]
    direction: FloatArray  # (m,) 1 forward, -1 backward, 0 planar
    shape: ComplexArray  # (n, m) displacement shapes


def campbell(system: LinearSystem, spin_speed: FloatArray, n_modes: int = 8) -> Campbell:
    """Whirl frequencies, damping and direction of the lowest modes.

    Parameters
    ----------
    system : the supported rotor
    spin_speed : (n_speeds,) Omega [rad/s]
    n_modes : modes kept at each speed

    >>> system = build_system(assemble(load_rig("nit-rourkela")), Condition())
    >>> campbell(system, spin_speed=np.array([500.0]), n_modes=4).direction  # backward and forward whirl
    array([[-1.,  1., -1.,  1.]])
    """
    rows = [_whirl(system, float(Omega), n_modes) for Omega in np.asarray(spin_speed, dtype=float)]
    return _diagram(spin_speed, rows)


def followed_campbell(system: LinearSystem, spin_speed: FloatArray, n_modes: int = 8) -> Campbell:
    """The same with each mode in one column, also where the lines of two modes cross.

    From one speed to the next a mode is the one whose shape is most alike (``follow``).

    Parameters
    ----------
    system : the supported rotor
    spin_speed : (n_speeds,) Omega [rad/s], increasing
    n_modes : how many are followed: the lowest ones at the lowest speed above zero; fewer where fewer oscillate

    Raises ValueError where none oscillates, SpinSpeedError for a speed that a support's table does not hold.
    """
    rows = [_whirl(system, float(Omega), n_modes + _SPARE) for Omega in spin_speed]
    start = int(np.argmax(spin_speed > 0))
    n_modes = min(n_modes, *(len(value) for value, _, _ in rows))
    if not n_modes:
        raise ValueError("no mode of this rotor oscillates; reduce its damping")
    columns = follow(system.M, [shape for _, shape, _ in rows], start, n_modes)
    pairs = zip(rows, columns, strict=True)
    return _diagram(spin_speed, [(value[c], shape[:, c], direction[c]) for (value, shape, direction), c in pairs])


_Row = tuple[ComplexArray, ComplexArray, FloatArray]


def _whirl(system: LinearSystem, spin_speed: float, n_modes: int) -> _Row:
    """Eigenvalues, shapes and directions of the lowest modes at one speed, sorted by damped frequency."""
    modes = damped_modes(system, spin_speed)
    order = np.argsort(modes.eigenvalue.imag)[:n_modes]
    shape = modes.shape[:, order]
    return modes.eigenvalue[order], shape, whirl_direction(system, shape) * (np.sign(spin_speed) or 1.0)


def _diagram(spin_speed: FloatArray, rows: Sequence[_Row]) -> Campbell:
    eigenvalue, shape, direction = (np.array(column) for column in zip(*rows, strict=True))
    return Campbell(np.asarray(spin_speed, dtype=float), eigenvalue, shape, direction)


def follow(M: FloatArray, shapes: Sequence[ComplexArray], start: int, n: int) -> IntArray:
    """Which column of each row holds the mode that is column 0 to n - 1 of the row ``start``.

    Between neighbouring rows modes are paired so that the sum of |a* M b| over all pairs is largest, each shape at a
    kinetic energy of one.

    Parameters
    ----------
    M : (n_dof, n_dof) mass
    shapes : of every row (n_dof, m), with m of at least n

    Returns
    -------
    (n_rows, n)
    """
    from scipy.optimize import linear_sum_assignment  # takes longer to import than modes take to compute

    unit = [shape / np.sqrt(work(M, shape)) for shape in shapes]
    columns = np.zeros((len(shapes), n), dtype=np.int64)
    columns[start] = np.arange(n)
    for rows in (range(start + 1, len(unit)), range(start - 1, -1, -1)):
        last = unit[start][:, :n]
        for row in rows:
            columns[row] = linear_sum_assignment(np.abs(last.conj().T @ M @ unit[row]), maximize=True)[1]
            last = unit[row][:, columns[row]]
    return columns


def crossings(system: LinearSystem, diagram: Campbell, multiple: float = 1.0) -> Crossings:
    """Where lines of a Campbell diagram meet the line of a multiple of the spin speed, Im lambda = multiple Omega.

    Parameters
    ----------
    system : the rotor of the diagram
    diagram : of ``followed_campbell``
    multiple : 1 for the synchronous line
    """
    return _zeros(system, diagram, lambda value, Omega: value.imag - multiple * Omega)


def stability_limits(system: LinearSystem, diagram: Campbell) -> Crossings:
    """Spin speeds at which a whirl begins to grow by itself, or stops growing: its damping ratio goes through zero.

    On fluid-film bearings this is the onset of oil whip, a forward whirl at about half of the spin speed
    [muszynska1986].

    Parameters
    ----------
    system : the rotor of the diagram
    diagram : of ``followed_campbell``
    """
    return _zeros(system, diagram, lambda value, Omega: value.real + _GROWING * np.abs(value))


def unstable_speeds(system: LinearSystem, spin_speed: FloatArray) -> FloatArray:
    """Of spin speeds (n_speeds,) [rad/s] those at which some mode grows; none where no support follows the speed."""
    if not system.by_speed:
        return np.zeros(0)
    return np.array([Omega for Omega in spin_speed.tolist() if grows(damped_modes(system, Omega).eigenvalue).any()])


def grows(eigenvalue: ComplexArray) -> BoolArray:
    """Whether modes with these eigenvalues [1/s] grow by themselves."""
    return eigenvalue.real > -_GROWING * np.abs(eigenvalue)


def _zeros(system: LinearSystem, diagram: Campbell, distance: Callable[[Any, Any], Any]) -> Crossings:
    """Spin speeds at which a function of eigenvalue [1/s] and spin speed [rad/s] goes through zero along a line."""
    from scipy.optimize import brentq  # as in ``follow``

    every = distance(diagram.eigenvalue, diagram.spin_speed[:, None])  # (n_speeds, n_modes)
    found = []
    for row, mode in np.argwhere(np.sign(every[:-1]) != np.sign(every[1:])).tolist():
        near = diagram.shape[row : row + 2, :, mode]
        speeds = diagram.spin_speed[row : row + 2].tolist()
        ends = dict(zip(speeds, every[row : row + 2, mode].tolist(), strict=True))

        def off(Omega: float, near: ComplexArray = near, ends: dict[float, float] = ends) -> float:
            return ends[Omega] if Omega in ends else distance(_most_alike(system, Omega, near)[0], Omega)

        Omega = float(brentq(off, *speeds, xtol=_CROSSING * max(speeds)))  # type: ignore[arg-type]
        value, direction = _most_alike(system, Omega, near)
        if abs(distance(value, Omega)) <= _MEETS * abs(value):
            found.append((Omega, value, direction, mode))
    found.sort(key=lambda crossing: crossing[0])
    places, values, directions, modes = zip(*found, strict=True) if found else ((), (), (), ())
    return Crossings(
        np.array(places, dtype=float),
        np.array(values, dtype=complex),
        np.array(directions, dtype=float),
        np.array(modes, dtype=np.int64),
    )


def _most_alike(system: LinearSystem, spin_speed: float, near: ComplexArray) -> tuple[complex, float]:
    """Eigenvalue and direction of the mode at a speed whose shape is most like those of (2, n) ``near``."""
    value, shape, direction = _whirl(system, spin_speed, system.n)
    likeness = np.abs(near.conj() @ system.M @ (shape / np.sqrt(work(system.M, shape)))).sum(axis=0)
    place = int(np.argmax(likeness))
    return complex(value[place]), float(direction[place])


def whirl_direction(system: LinearSystem, shapes: ComplexArray) -> FloatArray:
    """(m,) sense of the orbits of shapes (n, m): 1 from y towards z, -1 the other way, 0 planar.

    An orbit y = Re Y e^{i omega t}, z = Re Z e^{i omega t} encloses the area pi Im(Y Z*), positive
    when it turns from y towards z; the areas of all nodes are added.
    """
    Y, Z = system.read_out(1) @ shapes, system.read_out(2) @ shapes  # (n_nodes, m)
    area = np.imag(Y * Z.conj()).sum(axis=0)
    circles = (np.abs(Y) ** 2 + np.abs(Z) ** 2).sum(axis=0) / 2
    share = np.divide(area, circles, out=np.zeros_like(area), where=circles > 0)
    return np.where(np.abs(share) < _PLANAR, 0.0, np.sign(share))


def critical_speeds(system: LinearSystem, n: int = 4) -> CriticalSpeeds:
    """Undamped critical speeds: omega = Omega in K phi = omega^2 (M - i G) phi.

    In modal coordinates of the standing rotor, phi = Phi eta, K is diagonal and M is one. The matrix I - i Phi' G Phi
    is Hermitian, so that 1/omega^2 are the eigenvalues of a Hermitian problem. Those that are not positive belong to
    whirls whose frequency no spin speed reaches (a forward whirl of a disk whose polar inertia is larger than its
    diametral one). Rigid-body motions have no critical speed. They follow the others, since no spring holds them:
    A_re eta_e + A_rr eta_r = 0 with A = I - i Phi' G Phi.

    Where supports follow the spin speed this has no meaning; see ``synchronous_whirls``.

    Parameters
    ----------
    system : the supported rotor
    n : how many

    Raises ValueError where rigid-body motions have no inertia at synchronous whirl (a sphere about its centre), and
    where supports follow the spin speed.
    """
    if system.by_speed:
        raise ValueError(
            "supports that follow the spin speed have no undamped critical speeds; see their Campbell diagram"
        )
    modes = system.modes
    e, r = np.flatnonzero(modes.elastic), np.flatnonzero(~modes.elastic)
    A = np.eye(len(modes.omega)) - 1j * (modes.Phi.T @ system.G @ modes.Phi)
    follower = np.zeros((0, len(e)), dtype=complex)
    if len(r):
        inertia = A[np.ix_(r, r)]
        if np.linalg.matrix_rank(inertia, hermitian=True) < len(r):
            raise ValueError("a rigid-body motion has no inertia against synchronous whirl: no critical speed follows")
        follower = -np.linalg.solve(inertia, A[np.ix_(r, e)])
    S = A[np.ix_(e, e)] + A[np.ix_(e, r)] @ follower
    flexibility, eta = eigh(S / np.outer(modes.omega[e], modes.omega[e]))
    caught = flexibility > 1e-12 * flexibility[-1]
    order = np.argsort(-flexibility[caught])[:n]
    eta = eta[:, caught][:, order] / modes.omega[e][:, None]
    shape = modes.Phi[:, e] @ eta + modes.Phi[:, r] @ (follower @ eta)
    return CriticalSpeeds(1 / np.sqrt(flexibility[caught][order]), whirl_direction(system, shape), shape)


def synchronous_whirls(system: LinearSystem, lowest: float, highest: float) -> Crossings:
    """What an unbalance may excite up to a spin speed: the critical speeds with the damped eigenvalues there.

    The critical speeds are those of ``critical_speeds``. Where supports follow the spin speed they are the speeds at
    which the damped whirls meet the synchronous line (``crossings``).

    Parameters
    ----------
    system : the supported rotor
    lowest, highest : limits [rad/s]; the lower one holds for supports that follow the speed only
    """
    if system.by_speed:
        return crossings(system, followed_campbell(system, np.linspace(lowest, highest, _SPEEDS), system.n))
    critical = critical_speeds(system, system.n)
    places = np.flatnonzero(critical.spin_speed < highest)
    speeds = critical.spin_speed[places]
    values = [_most_alike(system, float(s), critical.shape[:, p][None])[0] for s, p in zip(speeds, places, strict=True)]
    return Crossings(speeds, np.array(values, dtype=complex), critical.direction[places], places)


def unbalance_response(model: RotorModel, spin_speed: FloatArray) -> ComplexArray:
    """Deflections under the model's unbalances, turning with the rotor.

    q = D(Omega)^-1 f with f_y + i f_z = m e Omega^2 e^{i (Omega t + phi)}; in phasors, with
    q(t) = Re[q e^{i Omega t}], f_y = m e Omega^2 e^{i phi} and f_z = -i f_y.

    Parameters
    ----------
    model : the rotor with ``unbalance``; local nonlinear forces are left out
    spin_speed : (n_speeds,) Omega [rad/s], positive

    Returns
    -------
    (n_speeds, 2, n_nodes) phasors of the deflections in y and z [m]
    """
    Omega, system = np.asarray(spin_speed, dtype=float), model.system
    pattern = np.zeros(system.n, dtype=complex)
    for u in model.unbalances:
        pattern += u.moment * np.exp(1j * u.phase) * (u.patterns[0] - 1j * u.patterns[1])
    q = np.array(  # (n_speeds, n)
        [np.linalg.solve(dynamic_stiffness(system, np.array([w]), w)[0], w**2 * pattern) for w in Omega], dtype=complex
    )
    return np.stack([q @ system.read_out(plane).T.astype(complex) for plane in (1, 2)], axis=1)


def speeds_through_resonances(system: LinearSystem, lowest: float, highest: float, n: int) -> FloatArray:
    """Spin speeds for a response to unbalance: evenly spaced, and closer together around every critical speed.

    A critical speed of an undamped mode has no bandwidth, and no more speeds around it.

    Parameters
    ----------
    system : the supported rotor
    lowest, highest : limits [rad/s], positive
    n : evenly spaced speeds

    Returns
    -------
    (n_speeds,) Omega [rad/s], ascending
    """
    speeds = [np.linspace(lowest, highest, n)]
    offsets = np.sinh(np.linspace(-_REACH_OF_PEAK, _REACH_OF_PEAK, _LINES_OF_PEAK))
    for value in synchronous_whirls(system, lowest, highest).eigenvalue.tolist():
        speeds.append(value.imag - offsets * value.real)
    every = np.unique(np.concatenate(speeds))
    return every[(every >= lowest) & (every <= highest)]
