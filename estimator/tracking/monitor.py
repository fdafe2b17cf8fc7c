"""Whether a machine still does what its model says, instant by instant, and if not, what has changed.

It listens first: a tracker learns k_b, masses, dampings and the gain of the machine as it stands. Then a Kalman filter
with these numbers, which it does not change any more, foretells every acceleration, and two questions are asked:

* *Has anything changed?* Each number that can change gets a bet: its likelihood ratio against the machine as it stands,
  begun anew whenever it falls below one. What is not known of the machine is in both, by the derivatives of the
  filter's innovations (the bias of [friedland1969]). The weighted mean of the bets is an e-detector [shin2024]: if
  nothing changes, it reaches a number A after A instants or more in the mean, whenever it is looked at.
* *What?* After an alarm filters run, each with one other number free, and the most likely one names the cause. All of
  them doubt the measurements as much as the best of them has to, because a sudden change rings modes that no filter has
  [mehra1972]. Where even the best goes on doubting, or two causes are as likely, the cause is unknown.

``native/monitor.c`` is the same in C; its numbers are printed from here.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_toeplitz

from rigtwin.estimator.tracking.reduced_rotor import ReducedRotor
from rigtwin.estimator.tracking.tracker import (
    BEARING_DAMPING,
    DIFFERENCE,
    DOUBT,
    FORCE_DOUBT,
    GAIN,
    OUTLIER,
    REMEMBERED,
    SHAFT_DAMPING,
    STIFFNESS,
    THIRD_DIFFERENCE_DOUBT,
    Belief,
    StiffnessTracker,
    lasted,
    plain,
)
from rigtwin.rotor.model.arrays import FloatArray

CAUSES = ("none", "k_b", "damping", "mass", "sensor", "unknown")
NONE, OF_K_B, OF_DAMPING, OF_MASS, OF_SENSOR, UNKNOWN = range(len(CAUSES))

# Numbers of the machine: those of the tracker, masses at nodes in units of the node's modal mass, gains of sensors and
# what they read at rest. The first four are in the matrices, and the masses.
_N = 5

# Standard deviation of a change that a bet expects: of ln k_b, of the logarithm of a damping, of a mass over the modal
# mass there, of a sensor's gain. The bet on something unknown: squares so many times as large.
CHANGE_OF_K_B, CHANGE_OF_DAMPING, CHANGE_OF_MASS, CHANGE_OF_GAIN, UNKNOWN_SQUARES = 0.1, 1.0, 0.1, 0.1, 4.0

# The most that one instant adds to the logarithm of a bet: a single wild value is no alarm.
MOST_OF_ONE = 3.0

# Standard deviations that the tracker's five numbers have at least, whatever it says, as its filter is not linear; what
# its covariance is taken times; gains of sensors against each other, and what they read at rest over the rms.
LEAST_DOUBT, LEARNED, GAINS_APART, AT_REST = (0.01, 0.001, 0.1, 0.1, 0.005), 4.0, 0.05, 0.1

# Seconds after the listening in which it is learned how innovations foretell each other, and by how many; seconds after
# it in which their size is learned, too, and no bet runs; instants that the size is worth at first, and at most.
COMPARED_FOR, ORDER_OF_LIKENESS, GAUGED_FOR, WORTH_FIRST, WORTH_MOST = 0.2, 8, 0.4, 20.0, 1e5

# How far a number may be from where the matrices of its filter were made: ln k_b, dampings, masses.
NEAR_K_B, NEAR_DAMPING, NEAR_MASS = 0.05, 0.1, 0.02

# Filters that look for the cause begin here, with this standard deviation: changes of ln k_b, of the logarithm of a
# damping, of a mass over the modal mass, which falls to half of it at most. A sensor's gain is linear.
STARTS_K_B, STARTS_DAMPING, STARTS_MASS = (0.0, -0.15, 0.15, -0.35, 0.35, -0.6, 0.6), (0.0, -1.0, 1.0), (0.0, 0.3, 1.0)
WIDTHS_K_B, WIDTHS_DAMPING = (0.15,) * 7, (0.5,) * 3
WIDTHS_MASS, WIDTH_GAIN, FARTHEST_STEP, LEAST_MASS = (0.1, 0.15, 0.5), 0.5, 0.3, -0.5

# They doubt measurements, by a factor on the squared noise: at first by the squared innovation that raised the alarm or
# this; then by what the best of them needs, within these seconds, for which a square counts for so much at most.
DOUBTED, FOLLOWED, LARGEST_SQUARE = 30.0, 0.01, 9.0

# A filter ends that is behind by so much in the logarithm, before and after so many seconds; seconds after which what
# was likely is forgotten, because the first instants after a change mislead; growth in a second of the variance of a
# motion over its mean square, for what the model does not have.
BEHIND_EARLY, BEHIND, KEPT, FORGOTTEN, MODEL_DOUBT = 60.0, 12.0, 0.3, 0.1, 2e-4

# Seconds before which nothing is named; how likely a cause is that is named; and the doubt above which it is not.
NAMED_AFTER, SURE, DOUBTFUL = 0.03, 0.99, 3.0

# A node carries no mass of note where its modal mass is so many times the least.
LEAST_MOTION = 1e-4

# A k_b that is set anew to what was found, within this share, is taken for known.
TAKEN_FOR_KNOWN = 0.03

_LOG_10 = math.log(10.0)


@dataclass(frozen=True)
class Watching:
    """How a monitor watches. Raises ValueError for a number that is not positive."""

    alarm_every: float = 1e9  # instants in the mean between false alarms, at least
    learning: float = 1.0  # seconds before it watches

    def __post_init__(self) -> None:
        for name in ("alarm_every", "learning"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True)
class Watched:
    """What a monitor says at an instant."""

    drift: float  # decimal logarithm of the evidence for a change
    alarm: bool
    cause: str  # one of ``CAUSES``
    k_b: float  # [N/m] believed, or found where that is the cause


@dataclass(frozen=True)
class _Number:
    """A number that can change."""

    cause: int
    column: int  # among the numbers of the machine
    change: float  # that a bet expects
    near: float
    starts: tuple[float, ...]
    widths: tuple[float, ...]


@dataclass
class _Linear:
    """A step of the motion and what is read, with first and second derivative by one number."""

    T: FloatArray
    Y: FloatArray
    dT: FloatArray
    dY: FloatArray
    ddT: FloatArray
    ddY: FloatArray


@dataclass
class _Guess:
    """A filter with one number free."""

    number: int  # which
    value: float
    at: float  # where its matrices were made
    x: FloatArray  # (2 r,)
    P: FloatArray  # (2 r + 1, 2 r + 1)
    log_weight: float
    square: float = 1.0  # of its last innovations, over their variance
    linear: _Linear | None = None


@dataclass
class _State:
    """All that a monitor remembers, beside its tracker."""

    phase: int = 0  # 0 listens, 1 watches, 2 has raised the alarm
    instants: int = 0  # in this phase
    step: float = 0.0
    before: FloatArray = field(default_factory=lambda: np.zeros(3))
    loud: float = 0.0  # mean square of the force
    heard: float = 0.0  # mean square of the accelerations that the machine was learned from
    point: FloatArray = field(default_factory=lambda: np.zeros(_N))  # the machine as it was learned
    noise: float = 0.0
    x: FloatArray = field(default_factory=lambda: np.zeros(0))
    P: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    power: FloatArray = field(default_factory=lambda: np.zeros(0))
    D: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))  # derivatives of x by the numbers
    off: FloatArray = field(default_factory=lambda: np.zeros(0))  # what is not known of the machine, and its covariance
    C: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    rough: float = 1.0  # squared innovations over their variance
    size: float = 1.0  # the same of what those before do not foretell
    worth: float = WORTH_FIRST
    G: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))  # derivatives of ``off`` by a change
    told: FloatArray = field(default_factory=lambda: np.zeros(0))  # of a change: information, and that times it
    tells: FloatArray = field(default_factory=lambda: np.zeros(0))
    bets: FloatArray = field(default_factory=lambda: np.zeros(0))  # logarithms
    likeness: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))  # products of innovations, by their distance
    foretell: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))  # an innovation from those before
    past: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))  # innovations with derivatives, newest first
    drift: float = 0.0
    known_k_b: float = 0.0  # believed at the alarm [N/m]
    latest: float = 0.0  # squared innovation over its variance
    guesses: list[_Guess] = field(default_factory=list)
    doubt: float = 1.0
    cause: int = NONE
    found: float = 0.0  # k_b [N/m]


class GapMonitor:
    """Watches a machine beside its model.

    Parameters
    ----------
    rotor : the reduced rotor
    nodes : where accelerations in its plane are read, from 1
    belief : what is believed at the start
    watching : how often it may be wrong, and how long it listens
    """

    def __init__(self, rotor: ReducedRotor, nodes: Sequence[int], belief: Belief, watching: Watching | None = None):
        self._rotor, self._nodes, self._watching = rotor, [node - 1 for node in nodes], watching or Watching()
        squares = np.sum(rotor.nodes**2, axis=1)
        self._scale = 1 / np.maximum(squares, LEAST_MOTION * squares.max())  # modal mass of each node
        self._numbers = tuple(self._all_numbers())
        self._base = [*range(_N), *self._gains[1:], *self._at_rest]
        share = Counter(each.cause for each in self._numbers)
        kinds = 1 + len(share)
        self._stakes = np.array([*(1 / (kinds * share[each.cause]) for each in self._numbers), 1 / kinds])
        self._begin(belief)

    def step(self, h: float, force: float, accelerations: FloatArray, k_b: float) -> None:
        """Take up an instant, h seconds after the last.

        Parameters
        ----------
        h : [s]
        force : [N]
        accelerations : (n_nodes,) [m/s^2]
        k_b : that is believed [N/m]; after an alarm, one that was found is taken for known
        """
        o = self._state
        if not self.has_begun:
            self._begin(replace(self._belief, k_b=k_b))
            o = self._state
            o.before[:] = force
        other, o.step = abs(h - o.step) > 1e-9 * h, h
        o.instants += 1
        if not o.phase:
            self._listen(h, force, accelerations)
        else:
            if other:
                self._linearise()
            self._watch(force, accelerations, k_b)
            if o.cause == OF_K_B and k_b != o.known_k_b and abs(math.log(k_b / o.found)) < TAKEN_FOR_KNOWN:
                self._take_for_known()
        o.before = np.array([force, *o.before[:2]])

    @property
    def watched(self) -> Watched:
        """What it says."""
        o = self._state
        k_b = o.found if o.phase else self._tracker.tracked.k_b
        return Watched(o.drift / _LOG_10, o.phase == 2, CAUSES[o.cause], k_b)

    @property
    def has_begun(self) -> bool:
        """Whether it has taken up an instant; until then it believes any k_b."""
        return bool(self._state.phase or self._state.instants)

    @property
    def can_change(self) -> list[tuple[int, int]]:
        """Cause and column of every number that can change."""
        return [(each.cause, each.column) for each in self._numbers]

    # -- states ------------------------------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """All that it remembers, in JSON types."""
        state = replace(self._state, guesses=[replace(each, linear=None) for each in self._state.guesses])
        return {"tracker": self._tracker.save(), "k_b": self._belief.k_b, "monitor": plain(asdict(state))}

    def restore(self, belief: Belief, saved: dict[str, Any]) -> None:
        """Go back to what ``save`` gave, under the belief of then."""
        self._begin(replace(belief, k_b=saved["k_b"]))
        self._tracker.restore(self._belief, saved["tracker"])
        made = {name: _restored(getattr(self._state, name), each) for name, each in saved["monitor"].items()}
        guesses = [{**each, "x": np.array(each["x"]), "P": np.array(each["P"])} for each in made["guesses"]]
        self._state = _State(**{**made, "guesses": [_Guess(**each) for each in guesses]})
        if self._state.phase:
            self._linearise()

    # -- listening ---------------------------------------------------------------------------------------------

    def _begin(self, belief: Belief) -> None:
        self._belief, self._state = belief, _State()
        self._tracker = StiffnessTracker(self._rotor, [node + 1 for node in self._nodes], belief)

    def _all_numbers(self) -> Iterable[_Number]:
        yield _Number(OF_K_B, STIFFNESS, CHANGE_OF_K_B, NEAR_K_B, STARTS_K_B, WIDTHS_K_B)
        for column in (BEARING_DAMPING, SHAFT_DAMPING):
            yield _Number(OF_DAMPING, column, CHANGE_OF_DAMPING, NEAR_DAMPING, STARTS_DAMPING, WIDTHS_DAMPING)
        n_nodes, n_sensors = len(self._rotor.nodes), len(self._nodes)
        for node in np.flatnonzero(self._scale < self._scale.min() / LEAST_MOTION).tolist():
            yield _Number(OF_MASS, _N + node, CHANGE_OF_MASS, NEAR_MASS, STARTS_MASS, WIDTHS_MASS)
        self._gains = [_N + n_nodes + sensor for sensor in range(n_sensors)]
        self._at_rest = [_N + n_nodes + n_sensors + sensor for sensor in range(n_sensors)]
        for column in self._gains:
            yield _Number(OF_SENSOR, column, CHANGE_OF_GAIN, math.inf, (0.0,), (WIDTH_GAIN,))

    def _listen(self, h: float, force: float, accelerations: FloatArray) -> None:
        self._tracker.step(h, force, accelerations)
        learned = self._tracker.learned
        if learned and lasted(self._state.instants, h, self._watching.learning):
            o, n = self._state, 2 * self._rotor.r
            o.x, o.P, o.power, o.point = learned.x.copy(), learned.P[:n, :n].copy(), learned.power.copy(), learned.point
            o.noise, o.loud, o.heard = learned.noise, learned.loud_force, learned.loud
            self._start_watch(LEARNED * learned.P[n:, n:])

    def _start_watch(self, C: FloatArray) -> None:
        """Watch a machine that is known but for the covariance of its numbers."""
        o, apart = self._state, (len(self._nodes) - 1, len(self._nodes))
        rest = [GAINS_APART**2] * apart[0] + [AT_REST**2 * o.heard] * apart[1]
        o.C = np.diag([*np.zeros(_N), *rest])
        o.C[:_N, :_N] = C + np.diag(np.square(LEAST_DOUBT))
        o.off, o.D = np.zeros(len(self._base)), np.zeros((2 * self._rotor.r, 1 + self._at_rest[-1]))
        m = len(self._numbers)
        o.G, o.tells, o.told = np.zeros((len(self._base), m)), np.zeros(m), self._precision()
        o.bets, o.drift, o.rough, o.size, o.worth = np.zeros(m + 1), 0.0, 1.0, 1.0, WORTH_FIRST
        n_sensors, order = len(self._nodes), ORDER_OF_LIKENESS
        o.likeness, o.foretell = np.zeros((n_sensors, order + 1)), np.zeros((n_sensors, order))
        o.past = np.zeros((n_sensors, order, 1 + self._at_rest[-1] + 1))
        o.guesses, o.cause, o.found = [], NONE, math.exp(o.point[STIFFNESS])
        o.phase, o.instants = 1, 0
        self._linearise()

    def _precision(self) -> FloatArray:
        return np.array([each.change**-2 for each in self._numbers])

    # -- matrices ----------------------------------------------------------------------------------------------

    def _matrices(self, column: int, values: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        """T (m, 2 r, 2 r + 3) and Y (m, n_sensors, 2 r + 1) where one number has these values, m of them."""
        rotor, o, driven = self._rotor, self._state, self._belief.driven_node - 1
        rows = []
        for value in values:
            at, masses = o.point[:GAIN].copy(), np.zeros(len(rotor.nodes))
            if column < GAIN:
                at[column] = value
            elif column >= _N:
                masses[column - _N] = value * self._scale[column - _N]
            rows.append(rotor.accelerations(at, driven, masses))
        return rotor.a_step(np.array(rows), o.step), rotor.nodes[self._nodes] @ np.array(rows)

    def _linear(self, column: int, at: float) -> _Linear:
        T, Y = self._matrices(column, (at, at + DIFFERENCE, at - DIFFERENCE))
        dT, dY = ((each[1] - each[2]) / (2 * DIFFERENCE) for each in (T, Y))
        ddT, ddY = ((each[1] + each[2] - 2 * each[0]) / DIFFERENCE**2 for each in (T, Y))
        return _Linear(T[0], Y[0], dT, dY, ddT, ddY)

    def _of_guess(self, guess: _Guess) -> _Linear:
        return self._linear(*self._place(self._numbers[guess.number], guess.at))

    def _place(self, number: _Number, value: float) -> tuple[int, float]:
        """Column of the matrices and its value; the machine's own for a sensor."""
        return (STIFFNESS, self._state.point[STIFFNESS]) if number.cause == OF_SENSOR else (number.column, value)

    def _linearise(self) -> None:
        """Matrices of the machine as it was learned, their derivatives by all numbers, and those of the guesses."""
        point, moving = self._state.point, [*range(GAIN), *range(_N, self._gains[0])]
        linear = [self._linear(j, point[j] if j < _N else 0.0) for j in moving]
        self._T, self._Y, self._moving = linear[0].T, linear[0].Y, moving
        self._dT, self._dY = np.array([each.dT for each in linear]), np.array([each.dY for each in linear])
        for guess in self._state.guesses:
            guess.linear = self._of_guess(guess)

    # -- watching ----------------------------------------------------------------------------------------------

    def _watch(self, force: float, read: FloatArray, k_b: float) -> None:
        o = self._state
        g = math.exp(o.point[GAIN])
        third = force - 3 * o.before[0] + 3 * o.before[1] - o.before[2]
        o.loud += (force**2 - o.loud) * min(1.0, o.step / REMEMBERED)
        doubt = math.hypot(FORCE_DOUBT * math.sqrt(o.loud), THIRD_DIFFERENCE_DOUBT * third)
        forces = g * np.array([o.before[1], o.before[0], force])
        if o.phase == 1:
            self._foretell(forces, doubt, read)
            if o.drift >= math.log(self._watching.alarm_every):
                self._alarm(k_b)
        else:
            self._name(forces, doubt, read)

    def _foretell(self, forces: FloatArray, doubt: float, read: FloatArray) -> None:
        """The motion a step on; each reading is compared with what it should be, and corrects the motion."""
        o, n, T = self._state, 2 * self._rotor.r, self._T
        u = np.concatenate([o.x, forces])
        own = T[:, n:].sum(axis=1) * doubt
        o.D = T[:, :n] @ o.D
        o.D[:, self._moving] += (self._dT @ u).T
        o.D[:, GAIN] += T[:, n:] @ forces
        o.x, o.P = T @ u, T[:, :n] @ o.P @ T[:, :n].T + np.outer(own, own)
        for q, value in enumerate(read):
            Y, v = self._Y[q], np.append(o.x, forces[2])
            foretold = float(Y @ v)
            dy = Y[:n] @ o.D
            dy[self._moving] += self._dY[:, q] @ v
            dy[GAIN] += Y[n] * v[n]
            dy[self._gains[q]] += foretold
            dy[self._at_rest[q]] += 1.0
            off, PH = value - foretold, o.P @ Y[:n]
            variance = float(Y[:n] @ PH) + o.noise**2
            self._bet(*self._white(q, off, dy), variance)
            left = off - float(dy[self._base] @ o.off)
            o.rough *= 1 + (min(left**2 / variance / o.rough, LARGEST_SQUARE) - 1) / o.worth
            gain = PH / variance * min(1.0, OUTLIER * math.sqrt(variance * o.rough) / max(abs(off), 1e-300))
            o.x += gain * off
            o.D -= np.outer(gain, dy)
            o.P -= np.outer(PH, PH / variance)
        o.power += (o.x**2 - o.power) * min(1.0, o.step / REMEMBERED)

    def _white(self, q: int, off: float, dy: FloatArray) -> tuple[float, FloatArray]:
        """An innovation and its derivatives less what those before foretell, as far as that has been learned.

        Innovations of a filter that lacks something of the machine foretell each other [box2015].
        """
        o, row = self._state, np.array([off, *dy])
        if not lasted(o.instants, o.step, COMPARED_FOR):
            left = np.vstack([row, o.past[q]]) @ np.array([1.0, *-self._in_columns(o.off)])
            o.likeness[q] += left[0] * left
        elif not lasted(o.instants - 1, o.step, COMPARED_FOR) and o.likeness[q, 0] > 0:
            first = o.likeness[q] * np.array([1 + 1e-9, *np.ones(ORDER_OF_LIKENESS)])
            o.foretell[q] = solve_toeplitz(first[:-1], first[1:])
            if not q:
                o.size, o.worth = 1.0, WORTH_FIRST
        white = row - o.foretell[q] @ o.past[q]
        o.past[q] = np.vstack([row, o.past[q, :-1]])
        return float(white[0]), white[1:]

    def _in_columns(self, off: FloatArray) -> FloatArray:
        """What is not known of the machine, among all of its numbers."""
        whole = np.zeros(1 + self._at_rest[-1])
        whole[self._base] = off
        return whole

    def _bet(self, off: float, dy: FloatArray, variance: float) -> None:
        """One innovation more for all bets, and for what is not known of the machine."""
        o, S = self._state, dy[self._base]
        CS = o.C @ S
        variance = float(S @ CS) + variance * o.size
        off -= float(S @ o.off)
        o.latest = square = off**2 / variance
        by = dy[[each.column for each in self._numbers]] - S @ o.G  # (m,) of this innovation, by a change
        spread, mean = 1 + by**2 / o.told / variance, by * o.tells / o.told
        gained = np.append(
            (square - (off - mean) ** 2 / variance / spread - np.log(spread)) / 2,
            (square * (1 - 1 / UNKNOWN_SQUARES) - math.log(UNKNOWN_SQUARES)) / 2,
        )
        o.tells += by * off / variance
        o.told += by**2 / variance
        gain = CS / variance
        o.G += np.outer(gain, by)
        o.off += gain * off
        o.C -= np.outer(gain, CS)
        o.worth = min(o.worth + 1, WORTH_MOST)
        o.size *= 1 + (min(square, LARGEST_SQUARE) - 1) / o.worth
        if lasted(o.instants, o.step, GAUGED_FOR):
            o.bets = np.maximum(o.bets, 0.0) + np.minimum(gained, MOST_OF_ONE)
        anew = o.bets[:-1] <= 0
        o.G[:, anew], o.tells[anew], o.told[anew] = 0.0, 0.0, self._precision()[anew]
        most = float(o.bets.max())
        o.drift = most + math.log(float(self._stakes @ np.exp(o.bets - most)))

    # -- naming ------------------------------------------------------------------------------------------------

    def _alarm(self, k_b: float) -> None:
        """Filters begin, each with another number free."""
        o, n = self._state, 2 * self._rotor.r
        P = np.zeros((n + 1, n + 1))
        P[:n, :n] = o.P + np.diag(DOUBT * o.power)
        for which, number in enumerate(self._numbers):
            now = o.point[number.column] if number.column < _N else 0.0
            several = sum(len(each.starts) for each in self._numbers if each.cause == number.cause)
            for start, width in zip(number.starts, number.widths, strict=True):
                P[n, n] = width**2
                at = now + start
                o.guesses.append(_Guess(which, at, at, o.x.copy(), P.copy(), -math.log(several)))
                o.guesses[-1].linear = self._of_guess(o.guesses[-1])
        o.known_k_b = k_b
        o.phase, o.instants, o.cause, o.doubt = 2, 0, UNKNOWN, max(DOUBTED, o.latest)

    def _name(self, forces: FloatArray, doubt: float, read: FloatArray) -> None:
        o = self._state
        for guess in o.guesses:
            self._follow(guess)
            self._predict(guess, forces, doubt)
            self._correct(guess, forces[2], read)
        best = max(o.guesses, key=lambda each: each.log_weight)
        most, nameable = best.log_weight, lasted(o.instants, o.step, NAMED_AFTER)
        for guess in o.guesses:
            guess.log_weight = (guess.log_weight - most) * (1 - min(1.0, o.step / FORGOTTEN))
        if nameable:
            behind = BEHIND if lasted(o.instants, o.step, KEPT) else BEHIND_EARLY
            o.guesses = [each for each in o.guesses if each.log_weight >= -behind]
        o.doubt = max(1.0, o.doubt * math.exp((min(best.square, LARGEST_SQUARE) - 1) * min(1.0, o.step / FOLLOWED)))
        cause = self._numbers[best.number].cause
        same = sum(math.exp(g.log_weight) for g in o.guesses if self._numbers[g.number].cause == cause)
        sure = same > SURE * sum(math.exp(each.log_weight) for each in o.guesses)
        o.cause = cause if sure and nameable and o.doubt < DOUBTFUL else UNKNOWN
        o.found = math.exp(best.value if o.cause == OF_K_B else o.point[STIFFNESS])

    def _follow(self, guess: _Guess) -> None:
        if abs(guess.value - guess.at) > self._numbers[guess.number].near:
            guess.at = guess.value
            guess.linear = self._of_guess(guess)

    def _predict(self, guess: _Guess, forces: FloatArray, doubt: float) -> None:
        linear, n, number = guess.linear, 2 * self._rotor.r, self._numbers[guess.number]
        assert linear is not None
        by = 0.0 if number.cause == OF_SENSOR else guess.value - guess.at
        T, u = linear.T + by * linear.dT + by**2 / 2 * linear.ddT, np.concatenate([guess.x, forces])
        J = np.zeros(n) if number.cause == OF_SENSOR else (linear.dT + by * linear.ddT) @ u
        W = np.column_stack([T[:, :n], J])
        top, own = W @ guess.P, T[:, n:].sum(axis=1) * doubt
        guess.x = T @ u
        guess.P[:n, :n] = top @ W.T + np.outer(own, own) * self._state.rough
        guess.P[range(n), range(n)] += MODEL_DOUBT * self._state.step * self._state.power
        guess.P[:n, n] = guess.P[n, :n] = top[:, n]

    def _correct(self, guess: _Guess, force: float, read: FloatArray) -> None:
        linear, n, number, o = guess.linear, 2 * self._rotor.r, self._numbers[guess.number], self._state
        assert linear is not None
        noise, total = o.noise**2 * o.rough * o.doubt, 0.0
        for q, value in enumerate(read):
            v = np.append(guess.x, force)
            if number.cause == OF_SENSOR:
                own = number.column == self._gains[q]
                Y, J = linear.Y[q] * (1 + guess.value * own), float(linear.Y[q] @ v) * own
            else:
                by = guess.value - guess.at
                Y = linear.Y[q] + by * linear.dY[q] + by**2 / 2 * linear.ddY[q]
                J = float((linear.dY[q] + by * linear.ddY[q]) @ v)
            H = np.append(Y[:n], J)
            off, PH = float(value - Y @ v), guess.P @ H
            variance = float(H @ PH) + noise
            square = off**2 / variance
            counts = square if square < OUTLIER**2 else 2 * OUTLIER * math.sqrt(square) - OUTLIER**2
            guess.log_weight -= (math.log(variance / noise) + counts) / 2
            step = PH * off / variance * min(1.0, OUTLIER / math.sqrt(max(square, 1e-300)))
            step[n] = min(max(step[n], -FARTHEST_STEP), FARTHEST_STEP)
            guess.x += step[:n]
            guess.value += step[n]
            guess.P -= np.outer(PH, PH / variance)
            if number.cause != OF_SENSOR:
                guess.P[n, n] += step[n] ** 4 / 4  # what the linear step leaves out
            total += square
        guess.square = total / len(read)
        self._keep_within(guess)

    def _keep_within(self, guess: _Guess) -> None:
        """k_b and masses stay in their ranges."""
        number = self._numbers[guess.number]
        if number.cause == OF_K_B:
            low, high = np.log(self._rotor.k_b)
            guess.value = min(max(guess.value, low), high)
        elif number.cause == OF_MASS:
            guess.value = max(guess.value, LEAST_MASS)

    def _take_for_known(self) -> None:
        """Watch on from the k_b that was found."""
        o, n = self._state, 2 * self._rotor.r
        best = max(o.guesses, key=lambda each: each.log_weight)
        o.point[STIFFNESS], o.x, o.P = best.value, best.x.copy(), best.P[:n, :n].copy()
        C = o.C[:_N, :_N].copy()
        C[STIFFNESS, STIFFNESS] += LEARNED * best.P[n, n]
        o.point[:_N] += np.array([0.0, *o.off[1:_N]])
        self._start_watch(C)


def _restored(now: Any, saved: Any) -> Any:
    return np.array(saved) if isinstance(now, np.ndarray) else saved
