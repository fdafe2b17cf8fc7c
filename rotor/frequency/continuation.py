"""Frequency-response curves of a nonlinear rotor, through their folds: arc-length continuation.

A curve of periodic motions is followed along its arc length and not along frequency [vongroll2001],
because it can turn back. Each step predicts along the tangent and corrects perpendicular to it. Length
is relative to the motion's own amplitude, which varies by three decades over a peak 0.2 Hz wide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rigtwin.rotor.frequency.harmonic_balance import Balance, Motions, jacobian
from rigtwin.rotor.frequency.periodic_force import complex_form, real_form
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray

Direction = Literal["up", "down"]
Varied = Literal["omega", "force_amplitude"]

# One unit of arc length: this relative change of the motion, or the largest frequency step.
_RELATIVE_CHANGE = 0.3

# Distance between prediction and correction that the step length aims at, and the largest accepted.
_AIM, _LARGEST = 0.05, 0.3

# A curve that turns by more than this cosine, or loses its orientation, may be another curve; it is accepted
# only with steps this short. The first slip of a Jenkins element is a real corner of the curve.
_TURN, _SURE_STEP = 0.5, 0.02

_FIRST_STEP, _LONGEST_STEP, _SHORTEST_STEP = 0.05, 1.0, 1e-6

# A correction this short is the last one; Newton's method squares it.
_CONVERGED = 1e-6

# Slope of the frequency over arc length, in largest steps, that counts as none.
_FLAT = 1e-4

_CORRECTIONS, _FOLD_STEPS, _POINTS = 8, 12, 3000

# Share of the force at which its rise from zero begins.
_FIRST_SHARE = 1e-4

# How far behind its start, in frequency ratio, a curve may run before it is given up.
_BEHIND = 2.0


@dataclass(frozen=True)
class Curve:
    """Periodic motions in the order of arc length."""

    motions: Motions
    tangents: FloatArray  # (n, n_joints (2 K - 1) + 1) change of the joints in real form [m], then of omega [rad/s]
    folds: IntArray  # places in ``motions`` where the curve turns back in frequency
    rising: bool  # whether it was followed towards higher frequencies
    step_hz: float  # the largest frequency step, one unit of arc length
    reason: str  # why the curve ends early; empty: it does not

    @property
    def complete(self) -> bool:
        """Whether the curve reaches the frequency it was followed to."""
        return not self.reason

    @property
    def folds_hz(self) -> FloatArray:
        """Frequencies at which the curve turns back [Hz]."""
        return self.motions.frequency_hz[self.folds]

    def sweep(self, lines_hz: FloatArray, direction: Direction = "up") -> Sweep:
        """The motions that a slow stepped sine stays on, jumping at folds.

        A sweep begins at the end of the curve that it meets first. Where its branch turns back, it
        jumps to the next branch along the curve that goes on in its direction. Branches that the
        curve does not reach are not seen, nor is a loss of stability without a fold: see ``stability``.

        Parameters
        ----------
        lines_hz : (n,) frequencies, in any order [Hz]
        direction : of the sweep
        """
        lines = np.atleast_1d(np.asarray(lines_hz, dtype=float))
        stretches, jumps = self._visited(lines, direction)
        met = stretches >= 0
        start = np.zeros((len(lines), *self.motions.joints.shape[1:]), dtype=complex)
        start[met] = self._between(stretches[met], 2 * np.pi * lines[met])
        motions = self.motions.balance.solve(lines, self.motions.force_amplitude, start)
        away = np.linalg.norm(motions.joints - start, axis=(1, 2)) > _RELATIVE_CHANGE * np.linalg.norm(
            start, axis=(1, 2)
        )
        reasons = tuple(
            f"the curve does not reach {hz:.6g} Hz" if not reached else reason or ("it left the curve" if left else "")
            for hz, reached, reason, left in zip(lines, met, motions.reasons, away, strict=True)
        )
        return Sweep(replace(motions, reasons=reasons, stable=motions.stable & met & ~away), jumps)

    def _visited(self, lines: FloatArray, direction: Direction) -> tuple[IntArray, FloatArray]:
        """Stretch of the curve, by its first point, that a sweep is on at each line (-1: none), and the jumps [Hz].

        A sweep is where the curve goes beyond all frequencies before; a fold's frequency stands
        until a later branch goes beyond it.
        """
        sign, hz = (1 if direction == "up" else -1), self.motions.frequency_hz
        backwards = self.rising != (direction == "up")
        way = sign * (hz[::-1] if backwards else hz)
        record = np.maximum.accumulate(way)
        ahead = np.flatnonzero(way[1:] > record[:-1])
        if not len(ahead):
            return np.full(len(lines), -1), np.zeros(0)
        place = np.searchsorted(way[ahead + 1], sign * lines)
        inside = (place < len(ahead)) & (sign * lines >= way[0])
        stretch = ahead[np.minimum(place, len(ahead) - 1)]
        if backwards:
            stretch = len(hz) - 2 - stretch
        jumps = sign * record[ahead[1:][np.diff(ahead) > 1]]
        return np.where(inside, stretch, -1), jumps

    def _between(self, stretches: IntArray, omega: FloatArray) -> ComplexArray:
        """(n, K, n_joints) joints at given frequencies between two points: the cubic along both tangents."""
        balance, joints = self.motions.balance, self.motions.joints
        points = np.column_stack([real_form(joints).reshape(len(joints), -1), 2 * np.pi * self.motions.frequency_hz])
        a, b = points[stretches], points[stretches + 1]
        weights = np.array([_weights(each, 2 * np.pi * self.step_hz) for each in joints[stretches]]).reshape(a.shape)

        def length(change: FloatArray) -> FloatArray:
            return np.linalg.norm(weights * change, axis=1, keepdims=True)

        leave, arrive = self.tangents[stretches], self.tangents[stretches + 1]
        leave, arrive = length(b - a) * leave / length(leave), length(b - a) * arrive / length(arrive)

        def cubic(t: FloatArray) -> FloatArray:
            c3 = leave + arrive - 2 * (b - a)
            return a + t * (leave + t * ((b - a) - leave - c3 + t * c3))

        low, high = np.zeros((len(a), 1)), np.ones((len(a), 1))
        rising = b[:, -1:] > a[:, -1:]
        for _ in range(40):
            middle = (low + high) / 2
            before = (cubic(middle)[:, -1:] < omega[:, None]) == rising
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return complex_form(cubic(low)[:, :-1].reshape(len(a), balance.forces.n_unknowns, balance.n_joints))


@dataclass(frozen=True)
class Sweep:
    """The motions that a slow stepped sine finds."""

    motions: Motions  # one for every line
    jumps_hz: FloatArray  # in the order in which they happen [Hz]


def trace(
    balance: Balance, start_hz: float, stop_hz: float, force_amplitude: float, *, step_hz: float | None = None
) -> Curve:
    """Follow the motions under a sine force from one frequency to another, through all folds between.

    Parameters
    ----------
    balance : rotor and force
    start_hz, stop_hz : first and last frequency, in either order [Hz]. The curve starts on the
        branch to which a slowly rising force drives a rotor at rest; where several are stable at an
        end of the range, an upward and a downward sweep need curves that start at their own ends.
    force_amplitude : peak of the exciting force [N]
    step_hz : largest frequency step, by default a 400th of the range; narrower resonances of little
        weight in the joints' motion can be stepped over

    Returns
    -------
    curve, with ``reason`` when it does not reach ``stop_hz``
    """
    step_hz = abs(stop_hz - start_hz) / 400 if step_hz is None else step_hz
    start = from_rest(balance, start_hz, force_amplitude)
    tracer = _Tracer(balance, "omega", 2 * np.pi * step_hz)
    if start.converged[0]:
        reason = tracer.follow(_point(start), 2 * np.pi * stop_hz)
    else:
        reason = f"no motion was found at {start_hz:.6g} Hz, where the curve should start"
        tracer.points.append(_point(start))
    return tracer.curve(stop_hz > start_hz, step_hz, reason)


def from_rest(balance: Balance, frequency_hz: float, force_amplitude: float) -> Motions:
    """The motion that a force of one frequency ends on when it rises slowly from zero to its amplitude.

    Finds it where ``Balance.solve`` fails, and the one that a rotor at rest is driven to where there are several.

    Parameters
    ----------
    frequency_hz : [Hz]
    force_amplitude : peak of the exciting force [N]
    """
    share = _FIRST_SHARE * force_amplitude
    linear = share * balance.receptance(np.array([2 * np.pi * frequency_hz]))[1]
    first = balance.solve(frequency_hz, share, linear)
    if not first.converged[0]:
        return balance.solve(frequency_hz, force_amplitude)
    ramp = _Tracer(balance, "force_amplitude", force_amplitude / 2)
    ramp.follow(_point(first), force_amplitude)
    last = balance.solve(frequency_hz, force_amplitude, ramp.end(force_amplitude)[None])
    return last if last.converged[0] else balance.solve(frequency_hz, force_amplitude)


@dataclass(frozen=True)
class _Point:
    """One periodic motion, and how it changes along the curve per unit of arc length."""

    omega: float  # [rad/s]
    force_amplitude: float  # [N]
    joints: ComplexArray  # (K, n_joints) [m]
    states: ComplexArray  # (K, n_states) of the linear part, in the coordinates of A's eigenvectors
    tangent: FloatArray  # (n + 1,) of the joints in real form, then of what varies along the curve
    states_tangent: ComplexArray  # (K, n_states)
    orientation: float = 0.0  # sign of the Jacobian over the tangent: changes only where curves cross

    @property
    def stable(self) -> bool:
        """Whether det J = orientation * tangent[-1] is positive: no neighbouring motion draws this one away."""
        return bool(self.orientation * self.tangent[-1] > 0)


def _point(motion: Motions) -> _Point:
    """A single motion as a point without tangent."""
    joints, states = motion.joints[0], motion.states[0]
    tangent = np.zeros(_flat(joints).size + 1)
    omega = 2 * np.pi * float(motion.frequency_hz[0])
    return _Point(omega, float(motion.force_amplitude), joints, states, tangent, np.zeros_like(states))


class _Linearised:
    """The balance and its derivatives at a point, by the joints and by what varies along the curve.

    The linear part is carried along in its own states s_k, (i k omega - A) s_k = b F_k - B N_k. In
    them the equations have no poles: a step in frequency may be longer than a resonance is wide.
    """

    def __init__(self, balance: Balance, at: _Point, varied: Varied):
        k = 1j * np.arange(balance.harmonics + 1)[:, None]
        N, DN = balance.forces(at.joints[None])
        shift = k * at.states if varied == "omega" else -balance.loads[0, ..., -1]
        loads = np.concatenate([balance.loads, shift[None, :, :, None]], axis=3)
        states = balance.resolvent(np.array([at.omega]), loads)[0]  # (K, n_states, n_joints + 2)
        H = balance.left @ states  # (K, n_joints, n_joints + 2)
        self._by_force, self._drive = states[..., :-2], at.force_amplitude * states[..., -2]
        self._by_varied = -states[..., -1]
        self._N, self._DN = N[0], DN[0].reshape(*N.shape[1:], N[0].size * 2 - balance.n_joints)
        self.J = jacobian(H[None, ..., :-2], DN)[0]
        linear = at.force_amplitude * H[..., -2] - (H[..., :-2] @ N[0, ..., None])[..., 0]
        self.residual, self.by_varied = _flat(at.joints - linear), _flat(H[..., -1])

    def border(self, row: FloatArray) -> FloatArray:
        """(n + 1, n + 1) derivative by joints and what varies, over a row of its own."""
        return np.vstack([np.column_stack([self.J, self.by_varied]), row])

    def states_after(self, step: FloatArray) -> ComplexArray:
        """(K, n_states) states after a step of joints and what varies."""
        return self._drive - self._states(self._N + self._DN @ step[:-1]) + step[-1] * self._by_varied

    def states_rate(self, tangent: FloatArray) -> ComplexArray:
        """(K, n_states) rate of change of the states along a tangent."""
        return tangent[-1] * self._by_varied - self._states(self._DN @ tangent[:-1])

    def _states(self, force: ComplexArray) -> ComplexArray:
        return (self._by_force @ force[..., None])[..., 0]


class _Tracer:
    """Predictor, corrector and step control for one balance.

    Parameters
    ----------
    balance : rotor and force
    varied : what varies along the curve
    unit : change of it that counts as one unit of arc length
    """

    def __init__(self, balance: Balance, varied: Varied, unit: float):
        self.balance, self.unit = balance, unit
        self.varied: Varied = varied
        self.points: list[_Point] = []
        self.folds: list[int] = []

    def value(self, point: _Point) -> float:
        """What varies."""
        return getattr(point, self.varied)

    def follow(self, start: _Point, stop: float) -> str:
        """Collect points until ``stop``; returns why it ended before, or nothing."""
        sign = 1.0 if stop > self.value(start) else -1.0
        across = np.append(np.zeros(len(start.tangent) - 1), sign)
        here = self._with_tangent(start, _Linearised(self.balance, start, self.varied), across)
        self.points.append(here)
        step = _FIRST_STEP
        while len(self.points) < _POINTS:
            found = self._advance(here, step)
            if found is None:
                step /= 2
                if step < _SHORTEST_STEP:
                    return f"the curve was lost at {here.omega / (2 * np.pi):.6g} Hz"
                continue
            there, distance = found
            if here.tangent[-1] * there.tangent[-1] < 0:
                self._mark_fold(here, there, step)
            self.points.append(there)
            here = there
            if sign * (self.value(here) - stop) >= 0:
                return ""
            if self.varied == "omega" and sign * np.log(here.omega / start.omega) < -np.log(_BEHIND):
                return "the curve ran out of the range behind its start: start at another frequency"
            step = min(_LONGEST_STEP, step * float(np.clip(np.sqrt(_AIM / max(distance, 1e-12)), 0.5, 2.0)))
        return f"the curve was given up at {here.omega / (2 * np.pi):.6g} Hz, after {_POINTS} points"

    def _advance(self, here: _Point, step: float) -> tuple[_Point, float] | None:
        """Next point and its distance from the prediction; None where a shorter step is needed."""
        at = self._after(here, step * here.tangent, here.states + step * here.states_tangent)
        weights = _weights(at.joints, self.unit)
        across = weights**2 * here.tangent
        travelled, last = np.zeros_like(across), _LARGEST
        for _ in range(_CORRECTIONS):
            linearised = _Linearised(self.balance, at, self.varied)
            change = np.linalg.solve(linearised.border(across), np.append(-linearised.residual, 0.0))
            length = float(np.linalg.norm(weights * change))
            if not length < last:
                return None
            at = self._after(at, change, linearised.states_after(change))
            travelled, last = travelled + change, length
            if length < _CONVERGED:
                there = self._with_tangent(at, linearised, across)
                turned = _cosine(weights * here.tangent, weights * there.tangent) < _TURN
                doubtful = turned or there.orientation != here.orientation
                return None if doubtful and step > _SURE_STEP else (there, float(np.linalg.norm(weights * travelled)))
        return None

    def _mark_fold(self, here: _Point, there: _Point, step: float) -> None:
        """Put the point where the curve turns back between two neighbours, by false position along the arc."""
        low, high = (0.0, float(here.tangent[-1])), (step, float(there.tangent[-1]))
        fold = here
        for _ in range(_FOLD_STEPS):
            length = (low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1])
            found = self._advance(here, length)
            if found is None:
                break
            fold, rate = found[0], float(found[0].tangent[-1])
            if abs(rate) < _FLAT * self.unit:
                break
            # The end that stays counts half: false position else creeps up on a bent curve (Illinois).
            if rate * low[1] > 0:
                low, high = (length, rate), (high[0], high[1] / 2)
            else:
                low, high = (low[0], low[1] / 2), (length, rate)
        if fold is not here:
            self.points.append(fold)
        self.folds.append(len(self.points) - 1)

    def _with_tangent(self, at: _Point, linearised: _Linearised, across: FloatArray) -> _Point:
        """The point with the tangent that goes on in the direction ``across``."""
        border = linearised.border(across)
        tangent = np.linalg.solve(border, np.append(np.zeros(len(across) - 1), 1.0))
        tangent /= np.linalg.norm(_weights(at.joints, self.unit) * tangent)
        orientation, rate = float(np.linalg.slogdet(border)[0]), linearised.states_rate(tangent)
        return replace(at, tangent=tangent, states_tangent=rate, orientation=orientation)

    def _after(self, at: _Point, change: FloatArray, states: ComplexArray) -> _Point:
        """A point after a change of joints and what varies, with its states."""
        joints = complex_form(change[:-1].reshape(1, self.balance.forces.n_unknowns, self.balance.n_joints))[0]
        varied = {self.varied: self.value(at) + float(change[-1])}
        return replace(at, joints=at.joints + joints, states=states, **varied)

    def end(self, value: float) -> ComplexArray:
        """Joints where the last step of the curve crosses a value of what varies, by interpolation."""
        before, after = self.points[-2:] if len(self.points) > 1 else self.points * 2
        width = self.value(after) - self.value(before)
        share = float(np.clip((value - self.value(before)) / width, 0.0, 1.0)) if width else 0.0
        return before.joints + share * (after.joints - before.joints)

    def curve(self, rising: bool, step_hz: float, reason: str) -> Curve:
        """The points collected so far, under one force."""
        points = self.points
        hz = np.array([point.omega for point in points]) / (2 * np.pi)
        joints = np.array([point.joints for point in points])
        stable = np.array([point.stable for point in points])
        reasons = ("",) * len(points) if len(points) > 1 else (reason,)
        motions = Motions(self.balance, points[0].force_amplitude, hz, joints, stable, reasons)
        tangents = np.array([point.tangent for point in points])
        return Curve(motions, tangents, np.array(self.folds, dtype=np.int64), rising, step_hz, reason)


def _flat(phasors: ComplexArray) -> FloatArray:
    return real_form(phasors[None]).ravel()


def _weights(joints: ComplexArray, unit: float) -> FloatArray:
    """(n + 1,) factors that turn changes of joints and of what varies into arc length."""
    size = float(np.linalg.norm(joints)) or 1.0
    return np.append(np.full(_flat(joints).size, 1 / (_RELATIVE_CHANGE * size)), 1 / unit)


def _cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
