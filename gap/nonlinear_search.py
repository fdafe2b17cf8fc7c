"""Which nonlinear effect: a grid over its numbers on few lines, descent from the best points, a robust fine fit.

The lowest force level is the nearest to a linear rotor: the stiffness that suits it is what an effect's own bearing
stiffness starts from. Lines that a candidate puts on another branch than the data count by a loss that grows like a
logarithm, so they cannot decide.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gap.fit import Fit
from gap.helpers import Item, Result, each
from gap.hypotheses import K_B_RANGE, NOMINAL, Free, Hypothesis
from gap.likelihood import MODEL_ERROR, Problem
from gap.modal import over_receptance
from gap.nonlinear import FINAL, MIDDLE, ROUGH, NonlinearModal, Resolution
from gap.residuals import Observed, residual
from gap.score import Score
from gap.search import Progress, Search, best_first, first_of_each, recalibrate
from rotor.measured import measured_response
from rotor.structure import FloatArray

# Every so many lines: of the grid, of the descents, of the fits.
_GRID_LINES, _DESCENT_LINES, _FIT_LINES = 8, 6, 4

# The same where the gap is small, which takes more lines to be seen: of what a law promises, and of the fits.
_SMALL_LINES = 2

# What coarsely computed motions leave of the response.
_ROUGH_ERROR, _MIDDLE_ERROR = 0.05, 0.01

# Points along the range of each number of an effect, first number first.
_POINTS = {
    "bearing_cubic": (14,),
    "bearing_hertz": (10,),
    "bearing_friction": (10, 5),
}

# Of a rub, points along its stiffness; and gaps, as shares of its node's largest motion, which goes little beyond them.
_STIFFNESSES, _SHARES = 5, (0.97, 0.85, 0.7, 0.5, 0.3)

# Of clearance, points along the gap; and preloads, as shares of the largest force of the bearings: more than that keeps
# the contact closed.
_GAPS, _LOADED = 7, (0.95, 0.75, 0.55, 0.35, 0.2, 0.1, 0.02)

# Numbers that coarse motions hardly tell, and the points along their ranges that are tried on finer ones.
_VAGUE = {"bearing_clearance": "gap"}
_TRIED = 14

# Of an even range the grid takes this share of it as the smallest point.
_SMALL = 0.01

# Friction forces where its two stiffnesses are those of the lowest and the highest level.
_FORCES = 30

# Of a bilinear support, logarithms of the ratio that are started from, its mean stiffness over that of a linear rotor,
# how finely it is followed, and relative errors that are added; descents that end within ``_WITHIN`` of the best are
# all carried on, but for those that end at the same place, since one level hardly tells them apart.
_RATIOS, _MEANS = (0.1, 0.2, 0.4, 0.7, 1.0), (0.97, 1.0, 1.03, 1.06, 1.1)
_UNEVEN, _UNEVEN_ERRORS, _SAME = Resolution(9, 256, 15), (0.3, 0.1, 0.03), 0.01

# It is the same at all levels: the stiffnesses of linear rotors at the lowest and the highest differ by less than this.
_ALIKE = 0.05

# Stiffness at rest over the one that suits the lowest level, at which a law may act already.
_AT_REST = {"bearing_cubic": (1.0, 0.95), "bearing_hertz": (1.0, 1.05, 1.1), "bearing_clearance": (1.0, 1.06)}

# Relative distance to the data at which a line of the grid counts half.
_HALF = 0.1

# Mean square misfit of the nominal model below which the gap is small.
NEAR = 5.0

# Effects whose stiffness at rest is not k_b; points that are descended from where the gap is small, and by how much
# more of the misfit than the best one's a candidate may leave after that.
_SHARES_STIFFNESS = ("bearing_friction",)
_NEAR_STARTS, _AHEAD = 6, 60.0

# Where the gap is small, places of a law that are carried on: they hardly differ there.
_PLACES_SMALL = 2

# Of every effect, so many points of the grid are descended from; of one with places, so many places.
_STARTS, _PLACES = 2, 3

# A node that moves less than this share of another's is taken to move so much, when a law is carried over to it.
_LEAST_MOTION = 0.03

# Relative error that is added in the first descents.
_FIRST = (0.3,)

# Effects that are left after the first descents, and after the second; beyond the best one, only those whose loss
# is within these factors of its.
_LEFT, _FINALISTS = 4, 3
_ROUGHLY, _WITHIN = 3.0, 1.5

# Share of the linear rotor's misfit that the best of these leaves at most.
_GAINED = 0.7

# Mean square misfit that a law's noise leaves at most; docs/diagnosis.md says why it is more than 1.
ADEQUATE_NONLINEAR = 1.5

# A misfit by so much above the best one's is not fitted further.
_CLEAR = 400.0

# Misfit of a line, in standard errors, beyond which it counts as an outlier; rounds of weighting, and steps in each.
OUTLIER = 3.0
_ROUNDS, _STEPS = 3, 5

# The same of the descents of the effects that are left, whose few lines only have to tell them apart.
_ROUNDS_THEN, _STEPS_THEN = 1, 4


@dataclass(frozen=True)
class _Start:
    """A point of the grid or of a descent."""

    cost: float
    hypothesis: Hypothesis
    u: FloatArray
    nu: FloatArray


def search_nonlinear(
    problem: Problem, hypotheses: Sequence[Hypothesis], progress: Progress | None = None
) -> tuple[Problem, Fit, Search]:
    """Fit the nonlinear candidates.

    Returns
    -------
    the problem with the model error of a truncated motion; the nominal model fitted to it as the candidates are, where
    a line far from the data counts by the logarithm of its misfit; and the search: candidates that explain more
    """
    calm, nu = _calm(problem)
    loud, held = recalibrate(_at_level(problem, max)).k_b, problem.forward.structure.supported_nodes
    rest = _Rest(calm, loud, _seen_motion(problem, calm.k_b), held)
    final = problem.made(resolution=FINAL, refined=True)
    every = _thinned(final, _FIT_LINES, calm.k_b, MODEL_ERROR)
    nominal = every.fit(NOMINAL, calm.u, nu)
    small = nominal.chi2 < NEAR * nominal.n_data
    if small:
        every = _thinned(final, _SMALL_LINES, calm.k_b, MODEL_ERROR)
        nominal = every.fit(NOMINAL, nominal.u, nominal.nu)
    linear = robust_fit(every, NOMINAL, nominal.u, nominal.nu) or nominal
    tell = _Teller(progress, len(hypotheses) + 3)
    others = _gridded(hypotheses)
    uneven = [hypothesis for hypothesis in hypotheses if hypothesis not in others]
    plain, left = (False, []) if small else _far(problem, others, rest, linear, nu, tell)
    beside = [] if plain else left[:1]  # told by other lines and errors than those near the nominal model
    if not plain:
        left = _near(problem, others, rest, nominal, tell)
    tell("bilinear_support")
    left = [*(start for start in left if start.cost < _WITHIN * left[0].cost), *beside]
    if abs(np.log(rest.loud / calm.k_b)) < _ALIKE:
        left += [start for hypothesis in uneven for start in _uneven(problem, hypothesis, calm, nu)]
    tell("fits")
    first = _fitted(every, left, rounds=1, steps=3)
    fits = first_of_each(sorted(first, key=lambda fit: fit.cost), lambda fit: fit.hypothesis)[:_FINALISTS]
    near = [fit for fit in fits if fit.cost < fits[0].cost + _CLEAR]
    fits = [*_or_vaguer(every, _fitted(every, near)), *fits[len(near) :]]
    fits += _bent(problem, every, fits)
    fits = best_first(fit for fit in fits if fit.log_evidence() > linear.log_evidence())
    every, fits = _at_believed_levels(every, fits)
    return every, linear, Search(nominal, tuple(fits))


@dataclass(frozen=True)
class _Rest:
    """Linear rotors that suit the lowest and the highest level."""

    calm: Fit
    loud: float  # bearing stiffness [N/m]
    motion: FloatArray  # (n_nodes,) largest displacements [m]
    held: tuple[int, ...]  # nodes of the bearings

    @property
    def force(self) -> float:
        """Largest force of a bearing as soft as the lowest level's [N]."""
        return self.calm.k_b * float(self.motion[np.array(self.held) - 1].max())


def most_promised(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis]) -> float:
    """Misfit that a weak law could take away beside a linear fit, to first order: the most of all points of the grids.

    A law moves the resonances of each level by what its own motions make of it, so its promise is told from noise where
    shifts that are free of each other are not.
    """
    rest = _Rest(fit, fit.k_b, _seen_motion(problem, fit.k_b), problem.forward.structure.supported_nodes)
    some = _thinned(problem.made(resolution=ROUGH), _SMALL_LINES, fit.k_b, MODEL_ERROR)
    score = Score(some, some.fit(fit.hypothesis, fit.u, fit.nu), settled=True)
    return max(each(partial(_promise, score, rest), _gridded(hypotheses)), default=0.0)


def _promise(score: Score, rest: _Rest, hypothesis: Hypothesis) -> float:
    """The most that a law takes away to first order, at every second point of its grid: its strength is scaled."""
    gains = (score.gain(hypothesis.effects(u[1:]))[0] for u in itertools.islice(_grid(hypothesis, rest), 0, None, 2))
    return max(gains, default=0.0)


def _gridded(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The laws that a grid tells of; see ``_uneven`` for the other one."""
    return [hypothesis for hypothesis in hypotheses if hypothesis.ids != ("bilinear_support",)]


class _Teller:
    """Tells how far the search is."""

    def __init__(self, progress: Progress | None, stages: int):
        self._progress, self._stages, self._done = progress, stages, 0

    def __call__(self, words: str) -> None:
        if self._progress:
            self._progress(self._done, self._stages, words)
        self._done += 1


def _far(
    problem: Problem, hypotheses: Sequence[Hypothesis], rest: _Rest, linear: Fit, nu: FloatArray, tell: _Teller
) -> tuple[bool, list[_Start]]:
    """Where the gap is plain: a grid over all numbers by relative distance, then descents; best first.

    It is not where the best explains hardly more than the linear rotor does: few lines hold the gap then, and errors as
    large as these descents begin with hide it.

    Returns
    -------
    whether the gap is plain, and where the descents ended
    """
    calm = rest.calm
    few = _thinned(problem.made(resolution=ROUGH), _GRID_LINES, calm.k_b, _ROUGH_ERROR)
    grid: dict[str, list[_Start]] = {}
    for hypothesis, points in _anew(few, partial(_by_distance, rest=rest, nu=nu), hypotheses):
        tell(str(hypothesis))
        grid.setdefault(hypothesis.ids[0], []).extend(points)
    tell("descents")
    rough = _descend(few, [start for points in grid.values() for start in _promising(points)], _FIRST)
    some = _thinned(problem.made(resolution=MIDDLE), _DESCENT_LINES, calm.k_b, _MIDDLE_ERROR)
    left = _settle(some, [start for start in rough[:_LEFT] if start.cost < _ROUGHLY * rough[0].cost])
    left = _best_of_each([*left, *_settle(some, _told(some, left))])
    if not left or left[0].cost > _GAINED * _loss(some, linear)[0]:
        return False, left
    return True, _best_of_each([*left, *_settle(some, _elsewhere(some, hypotheses, left))])[:_LEFT]


def _told(problem: Problem, starts: Sequence[_Start]) -> list[_Start]:
    """Of each start, the best points along the ranges of numbers that coarse motions hardly tell."""
    found = []
    for start in starts:
        for points in _ranges(start):
            problem.forget()
            found.append(min((replace(start, u=u) for u in points), key=partial(_misfit, problem)))
    return found


def _or_vaguer(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """Fits, or where the evidence is with them, those begun elsewhere along the range of a number that is hardly told.

    That is from the best point of the range, and from its end: a gap whose far side no motion reaches can have any
    width, where a single line may seem to tell one that is reached.
    """
    chosen = []
    for fit in fits:
        start = _Start(fit.cost, fit.hypothesis, fit.u, fit.nu)
        ends = [replace(start, u=points[-1]) for points in _ranges(start)]
        others = _fitted(problem, [*_told(problem, [start]), *ends])
        chosen.append(max([fit, *others], key=lambda each: each.log_evidence()))
    return chosen


def _ranges(start: _Start) -> list[FloatArray]:
    """Points along the range of every number of the start that coarse motions hardly tell."""
    vague = _VAGUE.get(start.hypothesis.ids[0])
    found = []
    for place, free in enumerate(start.hypothesis.free, start=1):
        if free.name == vague:
            points = np.tile(start.u, (_TRIED, 1))
            points[:, place] = _axis(free, _TRIED)
            found.append(points)
    return found


def _misfit(problem: Problem, start: _Start) -> float:
    """Robust misfit of a start as it stands; infinite where it has no model."""
    try:
        return _loss(problem, _unfitted(problem, start.hypothesis, start.u, start.nu))[0]
    except (ValueError, np.linalg.LinAlgError):
        return np.inf


def _uneven(problem: Problem, hypothesis: Hypothesis, calm: Fit, nu: FloatArray) -> list[_Start]:
    """The start of a bilinear support: fits of one level, as it is the same at all of them, from several ratios.

    How stiff it is on average is another number for every resonance, and takes several harmonics.
    """
    low = _thinned(_at_level(problem.made(resolution=_UNEVEN), min), _DESCENT_LINES, calm.k_b, MODEL_ERROR)
    points = list(each(partial(_of_mean, low, hypothesis, calm), _RATIOS))
    found = [down for _, down in _anew(low, partial(_down, anneal=_UNEVEN_ERRORS), points) if down is not None]
    found.sort(key=_cost)
    near = [replace(start, nu=nu) for start in found if start.cost < _WITHIN * found[0].cost]
    return first_of_each(near, lambda start: tuple(np.round(start.u / _SAME)))


def _of_mean(low: Problem, hypothesis: Hypothesis, calm: Fit, log_ratio: float) -> _Start:
    """A bilinear support of a ratio, as stiff on average as suits the runs best."""
    ratio = log_ratio if hypothesis.free[0].log else np.exp(log_ratio)
    starts = []
    for mean in _MEANS:
        low.forget()
        u = hypothesis.clipped(np.array([np.log(mean * calm.k_b) + _softer(log_ratio), ratio]))
        starts.append(_Start(_distance(low, _unfitted(low, hypothesis, u, calm.nu)), hypothesis, u, calm.nu))
    return min(starts, key=_cost)


def _softer(log_ratio: float) -> float:
    """Logarithm of a bilinear support's mean stiffness over that of a linear one of the same frequency."""
    return float(np.log((1 + np.exp(log_ratio / 2)) ** 2 / (4 * np.exp(log_ratio))))


def _near(problem: Problem, hypotheses: Sequence[Hypothesis], rest: _Rest, nominal: Fit, tell: _Teller) -> list[_Start]:
    """Where the gap is small: the same grid by what each point leaves of the misfit, nuisances refitted to first order.

    Effects that take part of the bearing stiffness away, which is no small step, are taken from the other grid as well.
    """
    k_b, rough = rest.calm.k_b, problem.made(resolution=ROUGH)
    many = _thinned(rough, _SMALL_LINES, k_b, MODEL_ERROR)
    some = _thinned(problem.made(resolution=MIDDLE), _FIT_LINES, k_b, MODEL_ERROR)
    nominal = many.fit(NOMINAL, nominal.u, nominal.nu)
    grid: dict[str, list[_Start]] = {}
    nu = np.clip(nominal.nu, -2 * nominal.prior_std, 2 * nominal.prior_std)
    beside: list[_Start] = []
    gains = each(partial(_by_score, Score(many, nominal), rest), hypotheses)
    for hypothesis, points in zip(hypotheses, gains, strict=True):
        tell(str(hypothesis))
        grid.setdefault(hypothesis.ids[0], []).extend(points)
        if hypothesis.ids[0] in _SHARES_STIFFNESS:
            few = _thinned(rough, _DESCENT_LINES, k_b, MODEL_ERROR)
            beside += sorted(_by_distance(few, hypothesis, rest, nu), key=_cost)[:1]
    tell("descents")
    chosen = _few_of_each([start for points in grid.values() for start in _promising(points)])[:_NEAR_STARTS]
    left = _descend(some, [*chosen, *beside], (0.0,))
    left = _few_of_each([*left, *_descend(some, _elsewhere(some, hypotheses, left), (0.0,))])[:_LEFT]
    return [start for start in left if start.cost < left[0].cost + _AHEAD]


def _bent(problem: Problem, every: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The best law bent, if it can be, where it leaves more than noise: that number roughly first, then all finely."""
    plain = min(fits, key=lambda fit: fit.cost, default=None)
    if plain is None or plain.chi2 < ADEQUATE_NONLINEAR * plain.n_data:
        return []
    law = plain.hypothesis
    starts = [_Start(np.inf, law.bent, u, plain.nu) for u in law.bent_from(plain.u)]
    if not starts:
        return []
    some = _thinned(problem.made(resolution=MIDDLE), _DESCENT_LINES, plain.k_b, _MIDDLE_ERROR)
    return _fitted(every, _settle(some, _descend(some, starts, _FIRST))[:1])


def _at_believed_levels(problem: Problem, fits: Sequence[Fit]) -> tuple[Problem, Sequence[Fit]]:
    """Forces as large as the runs believe where the evidence of the best law is with that, else all as it is.

    A law's numbers are known no better than the force, unless several levels agree on them.
    """
    sure, starts = problem.at_believed_levels(), []
    for fit in fits:
        nu = fit.nu.copy()
        nu[sure.nuisances.level] = 0.0
        starts.append(_Start(fit.cost, fit.hypothesis, fit.u, nu))
    best = _fitted(sure, starts[:1])
    if not best or best[0].log_evidence() < fits[0].log_evidence():
        return problem, fits
    return sure, best_first([*best, *_fitted(sure, starts[1:])])


def _elsewhere(problem: Problem, hypotheses: Sequence[Hypothesis], found: Sequence[_Start]) -> list[_Start]:
    """The leader's law at its other places, with numbers that the largest motion feels alike."""
    if not (found and "node" in dict(found[0].hypothesis.terms[0].fixed)):
        return []
    leader = found[0]
    size = _largest_motion(problem, leader)
    starts = []
    for other in hypotheses:
        if other.ids == leader.hypothesis.ids and other != leader.hypothesis:
            ratio = np.log(size[_node(other) - 1])
            moved = [{"gap": ratio, "stiffness": -2 * ratio}[free.name] for free in other.free]
            starts.append(_Start(np.inf, other, other.clipped(leader.u + np.array([0.0, *moved])), leader.nu))
    return starts


def _node(hypothesis: Hypothesis) -> int:
    return int(dict(hypothesis.terms[0].fixed)["node"])


def _largest_motion(problem: Problem, start: _Start) -> FloatArray:
    """(n_nodes,) displacements where the node of a start moves most, relative to that node's."""
    fit = _unfitted(problem, start.hypothesis, start.u, start.nu)
    motions = []
    for modal in problem.modals(fit.k_b, fit.effects):
        if isinstance(modal, NonlinearModal):
            plane = 1 if modal.run.excitation_plane == "y" else 2
            motions.append(np.abs(modal.solved().states[:, 1] @ modal.balance.read_out(plane).T))
    motion = np.concatenate(motions)
    own = motion[:, _node(start.hypothesis) - 1]
    return np.maximum(motion[own.argmax()] / own.max(), _LEAST_MOTION)


def _seen_motion(problem: Problem, k_b: float) -> FloatArray:
    """(n_nodes,) the largest displacement of every node along the force, in all runs [m].

    Of a node without a sensor, by the sensor that the nominal rotor says moves most at that line, and the shape it
    says the rotor has.
    """
    forward, largest = problem.forward, np.zeros(problem.forward.structure.n_nodes)
    for run in problem.runs:
        along = [c for c, channel in enumerate(run.channels) if channel.plane == run.excitation_plane]
        if not along:
            continue
        H, nodes = np.nan_to_num(run.H[:, along]), np.array([run.channels[c].node for c in along]) - 1
        seen = (run.force_amplitude_N or 1.0) * np.abs(H) / np.abs(over_receptance(run))[:, None]
        shape = np.abs(measured_response(forward.structure, forward.condition(run, k_b), (), run.frequency_hz))
        best, lines = shape[:, nodes].argmax(axis=1), np.arange(len(shape))
        most = shape[lines, nodes[best]]
        motion = shape * np.divide(seen[lines, best], most, out=np.zeros(len(shape)), where=most > 0)[:, None]
        motion[:, nodes] = seen
        largest = np.maximum(largest, motion.max(axis=0))
    return largest


def _by_distance(problem: Problem, hypothesis: Hypothesis, rest: _Rest, nu: FloatArray) -> list[_Start]:
    """Points of the grid with their distance; of a rub, which few lines see, with their robust misfit."""
    far = (lambda fit: _loss(problem, fit)[0]) if hypothesis.ids == ("rub",) else partial(_distance, problem)
    found = []
    for point, factor in itertools.product(_grid(hypothesis, rest), _AT_REST.get(hypothesis.ids[0], (1.0,))):
        u = hypothesis.clipped(point + np.log(factor) * (np.arange(len(point)) == 0))
        try:
            cost = far(_unfitted(problem, hypothesis, u, nu))
        except (ValueError, np.linalg.LinAlgError):
            cost = np.inf
        found.append(_Start(cost, hypothesis, u, nu))
    return found


def _by_score(score: Score, rest: _Rest, hypothesis: Hypothesis) -> list[_Start]:
    """Points of the grid with what each leaves of the misfit, and where k_b and the nuisances follow it to."""
    nominal = score.fit
    found, limit = [], 2 * nominal.prior_std
    for u in _grid(hypothesis, rest):
        gain, scale, moved = score.gain(hypothesis.effects(u[1:]))
        if scale <= 0:
            found.append(_Start(np.inf, hypothesis, u, nominal.nu))
            continue
        moved = moved / scale  # of the effect as it stands
        at = hypothesis.clipped(np.concatenate([nominal.u + moved[:1], u[1:]]))
        left = nominal.cost - gain / scale * (2 - 1 / scale)
        found.append(_Start(left, hypothesis, at, np.clip(nominal.nu + moved[1:], -limit, limit)))
    return found


def _thinned(problem: Problem, every: int, k_b: float, error: float) -> Problem:
    """Every n-th line of every run; the tolerances bend the modes of the runs that no law acts in."""
    few = problem.thinned(every, error)
    for run in few.runs:
        problem.forward.bend(run, k_b, ())
    return few


def _anew(
    problem: Problem, function: Callable[[Problem, Item], Result], items: Sequence[Item]
) -> Iterator[tuple[Item, Result]]:
    """Every item with what the function makes of it, each from nothing: no answer depends on who made the others."""
    yield from zip(items, each(partial(_alone, problem, function), items), strict=True)
    problem.forget()


def _alone(problem: Problem, function: Callable[[Problem, Item], Result], item: Item) -> Result:
    problem.forget()
    return function(problem, item)


def _fitted(problem: Problem, starts: Sequence[_Start | Fit], **settings: int) -> list[Fit]:
    """Robust fits from every start that has a model."""
    return [fit for _, fit in _anew(problem, partial(_robustly, **settings), starts) if fit is not None]


def _robustly(problem: Problem, start: _Start | Fit, **settings: int) -> Fit | None:
    return robust_fit(problem, start.hypothesis, start.u, start.nu, **settings)


def _cost(start: _Start) -> float:
    return start.cost


def _promising(points: Sequence[_Start]) -> list[_Start]:
    """The best points of an effect: of each of its places one, of a single place several."""
    places = _best_of_each(points)
    return sorted(points, key=_cost)[:_STARTS] if len(places) == 1 else places[:_PLACES]


def _best_of_each(starts: Sequence[_Start]) -> list[_Start]:
    """The best of every candidate, best first."""
    return first_of_each(sorted(starts, key=_cost), lambda start: start.hypothesis)


def _few_of_each(starts: Sequence[_Start]) -> list[_Start]:
    """The best candidates, best first, of each law not more than two places."""
    return first_of_each(_best_of_each(starts), lambda start: start.hypothesis.ids[0], _PLACES_SMALL)


def _at_level(problem: Problem, chosen: Callable[..., float]) -> Problem:
    """The runs at the lowest or the highest level (``min`` or ``max``)."""
    levels = {o.run.force_amplitude_N or 0.0 for o in problem.observed if o.run.support == "bearing"}
    kept = [
        o
        for o in problem.observed
        if o.run.support == "rigid" or (o.run.force_amplitude_N or 0.0) == chosen(levels, default=0.0)
    ]
    return Problem(problem.forward, kept, problem.model_error)


def _calm(problem: Problem) -> tuple[Fit, FloatArray]:
    """The nominal model of the runs at the lowest level, and its nuisances in the order of all runs."""
    low = _at_level(problem, min)
    fit = recalibrate(low)
    nu = np.zeros(problem.nuisances.n)
    nu[problem.nuisances.tolerance] = fit.nu[low.nuisances.tolerance]
    if low.nuisances.sensors == problem.nuisances.sensors:
        nu[problem.nuisances.sensor] = fit.nu[low.nuisances.sensor]
    return fit, np.clip(nu, -2 * problem.nuisances.std, 2 * problem.nuisances.std)


def _grid(hypothesis: Hypothesis, rest: _Rest) -> Iterator[FloatArray]:
    """(1 + n_free,) points over an effect's numbers, its stiffness at rest that of the lowest level."""
    name, calm = hypothesis.ids[0], rest.calm
    low, high = np.log(K_B_RANGE)
    for point in itertools.product(*_axes(hypothesis, rest)):
        own = [calm.k_b]
        if name == "bearing_friction":  # sticking or slipping at the lowest level
            own = [max(calm.k_b - float(np.exp(point[1])), 0.1 * calm.k_b), 0.7 * calm.k_b]
        for stiffness in own:
            yield np.array([np.clip(np.log(stiffness), low, high), *point])
    if name == "bearing_friction" and rest.loud < calm.k_b:  # sticking at the lowest level, slipping at the highest
        between = np.log(calm.k_b - rest.loud)
        for force in _axis(hypothesis.free[0], _FORCES):
            yield hypothesis.clipped(np.array([np.log(rest.loud), force, between]))


def _axes(hypothesis: Hypothesis, rest: _Rest) -> list[FloatArray]:
    """Points along each number's coordinate."""
    if hypothesis.ids == ("rub",):
        stiffness, gap = hypothesis.free
        gaps = np.array(_SHARES) * rest.motion[_node(hypothesis) - 1]
        return [_axis(stiffness, _STIFFNESSES), np.unique(np.log(np.clip(gaps, gap.low, gap.high)))]
    if hypothesis.ids == ("bearing_clearance",):
        gap, preload = hypothesis.free
        preloads = np.clip(np.array(_LOADED) * rest.force, preload.low, preload.high)
        return [_axis(gap, _GAPS), np.unique(preloads)]
    return [_axis(free, n) for free, n in zip(hypothesis.free, _POINTS[hypothesis.ids[0]], strict=True)]


def _axis(free: Free, n: int) -> FloatArray:
    low, high = free.ends
    if free.log:
        return low + (np.arange(n) + 0.5) / n * (high - low)
    return low + (high - low) * np.geomspace(_SMALL, 0.7, n)


def _distance(problem: Problem, fit: Fit) -> float:
    """Mean over all values of d^2 / (d^2 + h^2), d the distance relative to the larger of model and data."""
    total = n = 0.0
    for observed, H in zip(problem.observed, problem.predict(fit), strict=True):
        y = np.where(observed.valid, observed.run.H, 0.0)
        a = observed.run.as_recorded(H)
        size = np.maximum(np.abs(y), np.abs(a))
        used = observed.valid & (np.abs(y) > 0)
        d2 = np.abs(y - a) ** 2 / np.maximum(size**2, 1e-300)
        total += float(np.sum(np.where(used, d2 / (d2 + _HALF**2), 0.0)))
        n += float(used.sum())
    return total / max(n, 1.0)


def _unfitted(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray) -> Fit:
    n = len(u) + len(nu)
    return Fit(hypothesis, u, nu, 0.0, 0.0, np.zeros((n, n)), 0, problem.nuisances.std, problem.with_k_b)


def _descend(problem: Problem, starts: Sequence[_Start], anneal: Sequence[float]) -> list[_Start]:
    """Down from every start with ever smaller errors added; the best of every candidate, best first."""
    found = (down for _, down in _anew(problem, partial(_down, anneal=anneal), starts))
    return _best_of_each([down for down in found if down is not None])


def _down(problem: Problem, start: _Start, anneal: Sequence[float]) -> _Start | None:
    fit = problem.try_fit(start.hypothesis, start.u, start.nu, anneal=anneal, steps=4)
    if fit is None:
        return None
    loss, _ = _loss(problem, fit)
    return _Start(loss + fit.penalty, start.hypothesis, fit.u, fit.nu)


def _settle(problem: Problem, starts: Sequence[_Start]) -> list[_Start]:
    """Robust fits from every start, which lines on another branch of the response pull nowhere; as in `_descend`."""
    fits = _fitted(problem, starts, rounds=_ROUNDS_THEN, steps=_STEPS_THEN)
    return _best_of_each([_Start(fit.cost, fit.hypothesis, fit.u, fit.nu) for fit in fits])


def robust_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    u: FloatArray,
    nu: FloatArray | None = None,
    rounds: int = _ROUNDS,
    steps: int = _STEPS,
) -> Fit | None:
    """A fit in which a line far from the data counts by the logarithm of its misfit.

    Its ``chi2`` is that loss; ``precision`` is that of the weighted lines. None where the start has no model.
    """
    fit = _unfitted(problem, hypothesis, u, np.zeros(problem.nuisances.n) if nu is None else nu)
    for _ in range(rounds):
        try:
            weighted = _without_outliers(problem, fit)
            fit = weighted.fit(hypothesis, fit.u, fit.nu, anneal=(0.0,), steps=steps)
        except (ValueError, np.linalg.LinAlgError):
            return None
        loss, squares = _loss(problem, fit)
        fit = replace(fit, chi2=loss)
        if weighted is problem and not _outliers(squares):
            break
    return fit


def _without_outliers(problem: Problem, fit: Fit) -> Problem:
    """The problem itself, or with the errors of its outlying lines enlarged, where there are any."""
    _, squares = _loss(problem, fit)
    return _weighted(problem, squares) if _outliers(squares) else problem


def _outliers(squares: Sequence[FloatArray]) -> bool:
    return any(float(each.max(initial=0.0)) > OUTLIER**2 for each in squares)


def _loss(problem: Problem, fit: Fit) -> tuple[float, list[FloatArray]]:
    """Robust misfit of all lines, and (n_freq,) mean square residual of every run's lines."""
    total, squares = 0.0, []
    for observed, H in zip(problem.observed, problem.predict(fit), strict=True):
        y, real = np.nan_to_num(observed.run.H), observed.run.magnitude_only
        used = observed.valid & (np.abs(y) > 0)
        z2 = np.where(used, np.abs(residual(observed, H, problem.model_error)) ** 2, 0.0)
        n = used.sum(axis=1) * (1 if real else 2)
        mean = z2.sum(axis=1) / np.maximum(n, 1)
        squares.append(mean)
        total += float(np.sum(n * OUTLIER**2 * np.log1p(mean / OUTLIER**2)))
    return total, squares


def _weighted(problem: Problem, squares: Sequence[FloatArray]) -> Problem:
    """The problem with the errors of outlying lines enlarged."""
    observed = []
    for o, mean in zip(problem.observed, squares, strict=True):
        model2 = (problem.model_error * np.abs(np.nan_to_num(o.run.H))) ** 2
        growth = mean[:, None] / OUTLIER**2
        observed.append(Observed(o.run, np.sqrt(o.std**2 * (1 + growth) + model2 * growth)))
    return problem.on(observed)
