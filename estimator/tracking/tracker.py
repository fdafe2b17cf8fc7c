"""Bearing stiffness that changes while the machine runs, from the force and a few accelerations, instant by instant.

An extended Kalman filter of the reduced rotor [jazwinski1970] estimates the motion together with the logarithms of the
bearing stiffness, the disks' masses, the dampings and the gain of the force. The stiffness walks, the others stay. What
keeps it honest:

* at the start, and after an alarm, several filters with other stiffnesses run until one of them wins by its likelihood
  (a Gaussian sum [alspach1972]), and measurements count for less than their errors say, as little is linear yet;
* innovations that are larger than their errors for long raise the alarm;
* a force of few frequencies cannot tell all parameters apart. It is known by its last values, which foretell each other
  (it is not persistently exciting [ljung1999]); the stiffness is not corrected then, and its error grows.

``native/tracker.c`` is the same in C; its numbers are printed from here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import eigh

from rigtwin.estimator.intervals import Z90
from rigtwin.estimator.tracking.reduced_rotor import ReducedRotor
from rigtwin.rotor.model.arrays import FloatArray

# The parameters of a filter, the first four those that its matrices depend on.
STIFFNESS, DISK_MASS, BEARING_DAMPING, SHAFT_DAMPING, GAIN = range(5)
_N, _IN_MATRICES = 5, 4

# Nodes that a tracker can read.
MOST_SENSORS = 8

# How far each of these may be from where the matrices were made; for differences by parameters.
_ALL_NEAR = (0.05, 0.003, 0.1, 0.1)
DIFFERENCE = 1e-3

# Standard errors that an innovation counts for at most, and those beyond which its likelihood falls like that of a
# double exponential; the most that one corrects ln k_b by, beyond which it is not linear; and the largest squared
# innovation in an average.
OUTLIER, FAR_OFF, FARTHEST, UTMOST = 4.0, 3.0, 0.2, 50.0

# Seconds of the windows in which the loudness is taken before a filter begins, and the factor between two of them
# within which it is steady; seconds over which loudness and size of the motion are averaged afterwards; that size at
# the start over what the loudness says; and noise that nobody states, over it.
GAUGED, STEADY, HEARD, REMEMBERED, LOUDEST = 0.05, 2.0, 0.2, 0.05, 2.0
NOISE_SHARE = 0.02

# What the force between the instants is unknown by, over its rms and over its third difference: a parabola through
# three instants misses it by about a tenth of that.
FORCE_DOUBT, THIRD_DIFFERENCE_DOUBT = 1e-3, 0.1

# Factors on the squared noise at the start and after an alarm, and the seconds in which they fall to an e-th.
CAUTION, CALMING = 1000.0, 0.02
CAUTION_AFTER_ALARM, CALMING_AFTER_ALARM = 30.0, 0.01

# An alarm: innovations averaged over so many seconds, by so many of the average's errors, not before that time.
AVERAGED, ALARM, SETTLED = 0.003, 7.0, 0.5

# After an alarm: error of ln k_b of each filter; spread of their stiffnesses; squared doubt of the motion over its
# size; walk of ln k_b in a second; seconds for which several filters run at least and at most; and how far behind in
# the logarithm of the likelihood one ends.
WIDTH, SPREAD, DOUBT, FAST_WALK = 0.15, 0.6, 0.1, 1.5
TOGETHER, LONGEST, HOPELESS = 0.005, 0.05, 12.0

# Seconds for which the filters of the start run at least and at most.
TOGETHER_AT_FIRST, LONGEST_AT_FIRST = 0.2, 0.5

# An alarm within so many seconds of another says that not only the stiffness is wrong: the other parameters are doubted
# by this share of what was believed at the start. Where one follows the other for as long, something moves the machine
# that no stiffness explains: nothing is believed until none has come for that time.
AGAIN, DOUBTED_AGAIN = 0.3, 0.1

# A rich force: the time between its values over the shortest period of the motion; seconds over which their products
# are averaged; and the share of its square that the others leave untold.
SHARE_OF_PERIOD, ENRICHED, UNTOLD = 0.25, 0.1, 1e-3
ORDER, _PAST = 5, 512

# Estimates to be believed: largest error of ln k_b, and largest average of squared innovations.
LARGEST_ERROR, CONTRADICTED = 0.05, 3.0

# Other stiffnesses that are tried after an alarm, as ln k_b over the one before.
_ALL_OFFSETS = (0.0, -0.15, 0.15, -0.35, 0.35, -0.6, 0.6, -0.9, 0.9, -1.3, 1.3)


@dataclass(frozen=True)
class Belief:
    """What is believed before anything was measured. Standard deviations are those of logarithms; 0: known.

    Raises ValueError for a number that is not positive, where it has to be.
    """

    k_b: float  # [N/m]
    bearing_damping: float  # [N s/m]
    shaft_damping_ratio: float
    k_b_std: float = 0.3
    disk_mass_std: float = 0.01
    bearing_damping_std: float = 0.7
    shaft_damping_std: float = 0.7
    gain_std: float = 0.02
    walk: float = 0.04  # standard deviation of ln k_b after a second
    acceleration_std: float = 0.0  # standard error of a value [m/s^2]; 0: 2 % of the rms
    driven_node: int = 2  # of the force, from 1

    def __post_init__(self) -> None:
        for name in ("k_b", "bearing_damping", "shaft_damping_ratio"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")

    @property
    def start(self) -> FloatArray:
        """(5,) the parameters."""
        return np.array(
            [math.log(self.k_b), 0.0, math.log(self.bearing_damping), math.log(self.shaft_damping_ratio), 0.0]
        )

    @property
    def std(self) -> FloatArray:
        """(5,) their standard deviations."""
        return np.array(
            [self.k_b_std, self.disk_mass_std, self.bearing_damping_std, self.shaft_damping_std, self.gain_std]
        )

    @property
    def others_known(self) -> bool:
        """Whether all but the stiffness is known."""
        return not self.std[1:].any()


@dataclass(frozen=True)
class Tracked:
    """k_b at an instant with its 90 % interval [N/m]; not to be used where ``valid`` is false."""

    k_b: float
    k_b_low: float
    k_b_high: float
    valid: bool


@dataclass(frozen=True)
class Learned:
    """What a tracker knows of the machine."""

    point: FloatArray  # (5,) the parameters
    x: FloatArray  # (2 r,) the motion
    P: FloatArray  # (2 r + 5, 2 r + 5) covariance of motion and parameters
    power: FloatArray  # (2 r,) mean square of the motion
    noise: float  # standard error of an acceleration [m/s^2]
    loud: float  # mean square of the accelerations
    loud_force: float  # mean square of the force


@dataclass
class _Filter:
    """Motion and parameters with their covariance."""

    x: FloatArray  # (2 r,)
    parameters: FloatArray  # (5,)
    P: FloatArray  # (2 r + 5, 2 r + 5)
    at: FloatArray  # (5,) where the matrices were made
    power: FloatArray  # (2 r,) mean square of x
    log_weight: float = 0.0
    contradiction: float = 0.0
    linear: _Linear | None = None


@dataclass(frozen=True)
class _Linear:
    """A step of the motion T (x, forces), and what is read, Y (x, force), with their derivatives by the parameters."""

    T: FloatArray  # (2 r, 2 r + 3)
    dT: FloatArray  # (4, 2 r, 2 r + 3)
    ddT: FloatArray  # second by ln k_b
    Y: FloatArray  # (n_sensors, 2 r + 1)
    dY: FloatArray
    ddY: FloatArray


@dataclass
class _State:
    """All that a tracker remembers."""

    filters: list[_Filter] = field(default_factory=list)
    best: int = 0
    age: float = 0.0  # instants since there are several filters
    count: int = 0
    last_alarm: float = -1e9
    first_alarm: float = -1e9  # of those that follow each other
    step: float = 0.0
    before: FloatArray = field(default_factory=lambda: np.zeros(3))
    past: FloatArray = field(default_factory=lambda: np.zeros(_PAST))
    newest: int = 0
    likeness: FloatArray = field(default_factory=lambda: np.zeros((ORDER, ORDER)))
    rich: bool = False
    loud: float = 0.0
    window: float = 0.0
    gauged: int = 0
    noise: float = 0.0
    caution: float = CAUTION
    calming: float = CALMING
    contradiction: float = 1.0
    together: float = TOGETHER_AT_FIRST
    longest: float = LONGEST_AT_FIRST


class StiffnessTracker:
    """Follows k_b.

    Parameters
    ----------
    rotor : the reduced rotor
    nodes : where accelerations in its plane are read, from 1
    belief : what is believed at the start
    """

    def __init__(self, rotor: ReducedRotor, nodes: Sequence[int], belief: Belief):
        self._rotor, self._read, self._belief = rotor, rotor.nodes[[node - 1 for node in nodes]], belief
        self._state = _State()

    def step(self, h: float, force: float, accelerations: FloatArray) -> None:
        """Take up the force [N] and the accelerations (n_nodes,) [m/s^2] of an instant, h seconds after the last."""
        o = self._state
        other, o.step = abs(h - o.step) > 1e-9 * h, h
        if not o.count:
            o.before[:] = force
        o.count += 1
        self._listen(force)
        if other:
            for each in o.filters:
                each.linear = self._linear(each.at)
        if self._gauge(accelerations):
            if not o.filters:
                self._begin()
            self._run(force, accelerations)
        o.before = np.array([force, *o.before[:2]])

    @property
    def tracked(self) -> Tracked:
        """The estimate."""
        o, error = self._state, self.error
        k_b = math.exp(self._state.filters[o.best].parameters[STIFFNESS]) if o.filters else self._belief.k_b
        low, high = self._rotor.k_b
        restless = lasted(o.last_alarm - o.first_alarm, o.step, AGAIN)
        calm = not restless or lasted(o.count - o.last_alarm, o.step, AGAIN)
        valid = self._tells and calm and o.contradiction < CONTRADICTED and error < LARGEST_ERROR and low < k_b < high
        return Tracked(k_b, k_b * math.exp(-Z90 * error), k_b * math.exp(Z90 * error), bool(valid))

    @property
    def _tells(self) -> bool:
        return len(self._state.filters) == 1 and (self._state.rich or self._belief.others_known)

    @property
    def learned(self) -> Learned | None:
        """All that it knows of the machine; None while several filters run, or none, or the force is not rich."""
        o = self._state
        if not self._tells:
            return None
        f = o.filters[0]
        return Learned(f.parameters.copy(), f.x, f.P, f.power, o.noise, o.loud, float(o.likeness[0, 0]))

    @property
    def error(self) -> float:
        """Standard error of ln k_b."""
        o, at = self._state, 2 * self._rotor.r + STIFFNESS
        return math.sqrt(max(o.filters[o.best].P[at, at], 0.0)) if o.filters else self._belief.k_b_std

    # -- states ------------------------------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """All that it remembers, in JSON types."""
        state = asdict(replace(self._state, filters=[replace(each, linear=None) for each in self._state.filters]))
        return plain(state)

    def restore(self, belief: Belief, saved: dict[str, Any]) -> None:
        """Go back to what ``save`` gave, under the belief of then."""
        self._belief = belief
        arrays = {name: np.array(saved[name]) for name in ("before", "past", "likeness")}
        filters = []
        for each in saved["filters"]:
            own = {name: np.array(each[name]) for name in ("x", "parameters", "P", "at", "power")}
            filters.append(_Filter(**{**each, **own}))
        self._state = _State(**{**saved, **arrays, "filters": filters})
        for made in filters:
            made.linear = self._linear(made.at)

    # -- matrices ----------------------------------------------------------------------------------------------

    def _matrices(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """T (m, 2 r, 2 r + 3) and Y (m, n_sensors, 2 r + 1) at points (m, 5); the force is a parabola."""
        rotor, driven = self._rotor, self._belief.driven_node - 1
        rows = np.array([rotor.accelerations(at, driven) for at in points])
        return rotor.a_step(rows, self._state.step), self._read @ rows

    def _linear(self, at: FloatArray) -> _Linear:
        away = DIFFERENCE * np.eye(_N)[:_IN_MATRICES]
        T, Y = self._matrices(np.concatenate([at[None], at + away, at - away]))
        dT, dY = ((each[1 : 1 + _IN_MATRICES] - each[1 + _IN_MATRICES :]) / (2 * DIFFERENCE) for each in (T, Y))
        ddT, ddY = ((each[1] + each[1 + _IN_MATRICES] - 2 * each[0]) / DIFFERENCE**2 for each in (T, Y))
        return _Linear(T[0], dT, ddT, Y[0], dY, ddY)

    def _follow(self, f: _Filter) -> None:
        """Make the matrices anew where the parameters have gone far from where they were made."""
        off = np.abs(f.parameters - f.at)
        if (off[:_IN_MATRICES] > _ALL_NEAR).any():
            f.at = f.parameters.copy()
            f.linear = self._linear(f.at)

    # -- one filter --------------------------------------------------------------------------------------------

    def _predict(self, f: _Filter, force: float, doubt: float) -> None:
        """``doubt``: standard error of the force between the instants."""
        linear, n, o = f.linear, 2 * self._rotor.r, self._state
        assert linear is not None
        by, g = (f.parameters - f.at)[:_IN_MATRICES], math.exp(f.parameters[GAIN])
        T = linear.T + np.tensordot(by, linear.dT, 1) + by[0] ** 2 / 2 * linear.ddT
        u = np.concatenate([f.x, [g * o.before[1], g * o.before[0], g * force]])
        J = np.column_stack([(linear.dT @ u).T, T[:, n:] @ u[n:]])
        J[:, STIFFNESS] += by[0] * (linear.ddT @ u)
        W = np.hstack([T[:, :n], J])
        top, own = W @ f.P, T[:, n:].sum(axis=1) * doubt
        f.x = T @ u
        P = f.P
        P[:n, :n] = top @ W.T + np.outer(own, own)
        P[:n, n:] = top[:, n:]
        P[n:, :n] = top[:, n:].T
        walk = FAST_WALK if len(o.filters) > 1 and o.longest == LONGEST else self._belief.walk
        P[n, n] += walk**2 * o.step

    def _correct(self, f: _Filter, force: float, read: FloatArray) -> float:
        """Squared innovation over its variance, in the mean of the sensors; the log-likelihood goes to the weight."""
        linear, n, o = f.linear, 2 * self._rotor.r, self._state
        assert linear is not None
        # What a force of few frequencies cannot tell is considered, and not estimated: its errors stay what they were.
        estimated = n + _N if o.rich else n + 1 if self._belief.others_known else n
        total = 0.0
        for q, value in enumerate(read):
            by, g = (f.parameters - f.at)[:_IN_MATRICES], math.exp(f.parameters[GAIN])
            v = np.append(f.x, g * force)
            Y = linear.Y[q] + by @ linear.dY[:, q] + by[0] ** 2 / 2 * linear.ddY[q]
            H = np.concatenate([Y[:n], linear.dY[:, q] @ v, [Y[n] * v[n]]])
            H[n] += by[0] * (linear.ddY[q] @ v)
            off, PH = float(value - Y @ v), f.P @ H
            variance = float(H @ PH) + o.noise**2 * o.caution
            square = off**2 / variance
            if square > OUTLIER**2:  # counts no more than that
                off *= OUTLIER / math.sqrt(square)
            own = square if square < FAR_OFF**2 else 2 * FAR_OFF * math.sqrt(square) - FAR_OFF**2
            f.log_weight -= (math.log(variance) + own) / 2
            step = PH * (off / variance)
            step[estimated:] = 0.0
            step[n] = min(max(step[n], -FARTHEST), FARTHEST)
            f.x += step[:n]
            f.parameters += step[n:]
            less = np.outer(PH, PH / variance)
            less[estimated:, estimated:] = 0.0
            f.P -= less
            f.P[n, n] += step[n] ** 4 / 4  # what the linear step leaves out
            total += square
        f.power += (f.x**2 - f.power) * min(1.0, o.step / REMEMBERED)
        low, high = np.log(self._rotor.k_b)
        f.parameters[STIFFNESS] = min(max(f.parameters[STIFFNESS], low), high)
        return total / len(read)

    # -- several filters ---------------------------------------------------------------------------------------

    def _alarm(self) -> None:
        """The measurements contradict the filter: others with other stiffnesses run beside it."""
        o, n = self._state, 2 * self._rotor.r
        best, again = o.filters[o.best], not lasted(o.count - o.last_alarm, o.step, AGAIN)
        o.filters = []
        for offset in _ALL_OFFSETS:
            f = replace(deepcopy(replace(best, linear=None)), linear=best.linear)
            f.parameters[STIFFNESS] += offset
            f.log_weight = -(offset**2) / (2 * SPREAD**2)
            f.P[range(n), range(n)] += DOUBT * f.power
            std = DOUBTED_AGAIN * self._belief.std
            std[STIFFNESS] = WIDTH
            for j in range(n, n + (_N if again else 1)):
                f.P[j] = f.P[:, j] = 0.0
                f.P[j, j] = std[j - n] ** 2
            o.filters.append(f)
        o.best, o.age, o.last_alarm = 0, 0.0, o.count
        o.first_alarm = o.first_alarm if again else o.count
        o.together, o.longest = TOGETHER, LONGEST
        o.caution, o.calming, o.contradiction = CAUTION_AFTER_ALARM, CALMING_AFTER_ALARM, 1.0

    def _choose(self) -> None:
        """Which filter is the best, and which go on beside it."""
        o = self._state
        o.age += 1
        best = max(o.filters, key=lambda f: f.log_weight)
        most, at_last = best.log_weight, lasted(o.age, o.step, o.longest)
        for f in o.filters:
            f.log_weight -= most
        if len(o.filters) > 1 and lasted(o.age, o.step, o.together):
            o.filters = [f for f in o.filters if f is best or (f.log_weight >= -HOPELESS and not at_last)]
        o.best = next(k for k, f in enumerate(o.filters) if f is best)

    def _listen(self, force: float) -> None:
        """Whether the force is persistently exciting: whether its last values do not foretell each other."""
        o = self._state
        lag = lag_between_forces(float(self._rotor.highest_hz), o.step, _PAST)
        o.newest = (o.newest + 1) % _PAST
        o.past[o.newest] = force
        f = o.past[(o.newest - lag * np.arange(ORDER)) % _PAST]
        o.likeness += min(1.0, o.step / ENRICHED) * (np.outer(f, f) - o.likeness)
        o.rich = is_rich(o.likeness)

    def _gauge(self, read: FloatArray) -> bool:
        """How loud the rotor is; whether that is known: at first it is taken until two windows agree."""
        o, square = self._state, float(read @ read) / len(read)
        if o.filters:
            o.loud += (square - o.loud) * min(1.0, o.step / HEARD)
            return True
        if not square and not o.gauged:
            return False
        o.gauged += 1
        o.window += (square - o.window) / o.gauged
        if not lasted(o.gauged, o.step, GAUGED):
            return False
        steady = o.loud / STEADY < o.window < o.loud * STEADY
        o.loud, o.window, o.gauged = o.window, 0.0, 0
        return steady

    def _begin(self) -> None:
        """First filters, with stiffnesses about the one believed, for a motion as large as the accelerations say."""
        o, n, belief = self._state, 2 * self._rotor.r, self._belief
        squares, Phi = eigh(*self._rotor.stiffness_and_mass(*belief.start[:2]))
        loud = LOUDEST * math.sqrt(o.loud) * Phi / squares  # each mode as loud as all of them
        P = np.zeros((n + _N, n + _N))
        P[: n // 2, : n // 2] = self._rotor.scale[:, None] * (loud @ loud.T) * self._rotor.scale
        P[n // 2 : n, n // 2 : n] = (loud * squares) @ loud.T
        P[range(n, n + _N), range(n, n + _N)] = belief.std**2
        several = o.rich or belief.others_known  # else nothing could tell them apart
        share = belief.k_b_std / SPREAD
        P[n, n] = (WIDTH * share if several else belief.k_b_std) ** 2
        for offset in _ALL_OFFSETS if several else (0.0,):
            at = belief.start
            at[STIFFNESS] += offset * share
            weight = -(offset**2) / (2 * SPREAD**2)
            o.filters.append(
                _Filter(np.zeros(n), at, P.copy(), at.copy(), np.zeros(n), weight, linear=self._linear(at))
            )
        o.age, o.together, o.longest = 0.0, TOGETHER_AT_FIRST, LONGEST_AT_FIRST

    def _run(self, force: float, read: FloatArray) -> None:
        o, belief = self._state, self._belief
        o.noise = belief.acceleration_std or NOISE_SHARE * math.sqrt(o.loud)
        third = force - 3 * o.before[0] + 3 * o.before[1] - o.before[2]
        doubt = math.hypot(FORCE_DOUBT * math.sqrt(o.likeness[0, 0]), THIRD_DIFFERENCE_DOUBT * third)
        for f in o.filters:
            self._follow(f)
            self._predict(f, force, doubt)
            f.contradiction = self._correct(f, force, read)
        self._choose()
        now, samples = o.filters[o.best].contradiction, max(1.0, AVERAGED / o.step)
        o.contradiction += (min(now, UTMOST) - o.contradiction) / samples
        o.caution -= (o.caution - 1) * min(1.0, o.step / o.calming)
        if len(o.filters) > 1 or not (o.rich or belief.others_known):
            return
        if lasted(o.count, o.step, SETTLED) and o.contradiction > 1 + ALARM / math.sqrt(samples * len(read)):
            self._alarm()


def lag_between_forces(highest_hz: float, step: float, remembered: int) -> int:
    """Steps between the values of the force that tell whether it is rich, of so many that are remembered."""
    return min((remembered - 1) // ORDER, max(1, int(SHARE_OF_PERIOD / highest_hz / step)))


def is_rich(likeness: FloatArray) -> bool:
    """Whether the last values of a force, whose mean products these are (ORDER, ORDER), do not foretell each other."""
    try:
        left = np.linalg.cholesky(likeness).diagonal() ** 2
    except np.linalg.LinAlgError:
        return False
    return bool((left > UNTOLD * likeness[0, 0]).all())


def lasted(instants: float, step: float, seconds: float) -> bool:
    """Whether so many instants have lasted so long; hosts whose steps differ in the last digit count alike."""
    return (instants + 0.5) * step >= seconds


def plain(value: Any) -> Any:
    """Dictionaries, lists and arrays in JSON types."""
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray) else value
