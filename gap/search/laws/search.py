"""Which nonlinear effect: a grid over its numbers on few lines, descent from the best points, a robust fine fit."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, Hypothesis
from rigtwin.gap.inference.problem import MODEL_ERROR, Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.motions import FINAL, MIDDLE, ROUGH, Resolution
from rigtwin.gap.search.laws.grid import Rest, axis, by_distance, by_score, distance, node_of, points_of, seen_motion
from rigtwin.gap.search.laws.reading import READ, read
from rigtwin.gap.search.laws.robust import (
    anew,
    best_of_each,
    cost_of,
    descend,
    fitted,
    robust_fit,
    robust_misfit,
    settle,
    thinned,
    unfitted,
)
from rigtwin.gap.search.linear import NEAR, Progress, Search, best_first, first_of_each, recalibrate
from rigtwin.gap.search.starts import Start
from rigtwin.gap.search.workers import each
from rigtwin.rotor.model.structure import FloatArray

# Every so many lines: of the grid, of the descents, of the fits; where the gap is small all, as one line may hold it.
_GRID_LINES, _DESCENT_LINES, _FIT_LINES, _ALL_LINES = 8, 6, 4, 1

# What coarsely computed motions leave of the response.
_ROUGH_ERROR, _MIDDLE_ERROR = 0.05, 0.01

# Numbers that coarse motions hardly tell, and the points along their ranges that are tried on finer ones.
_VAGUE = {"bearing_clearance": "gap"}
_TRIED = 14

# How finely all laws are fitted first, and a bilinear support is followed.
_SEVERAL = Resolution(9, 256, 15, bends=True)

# Of a bilinear support, logarithms of the ratio that are started from, its mean stiffness over that of a linear rotor,
# and how long it is followed; fits that end within ``_WITHIN`` of the best are all carried on, but for
# those that end at the same place, since one level hardly tells them apart.
_RATIOS, _MEANS = (0.1, 0.2, 0.4, 0.7, 1.0), (0.97, 1.0, 1.03, 1.06, 1.1)
_UNEVEN_EFFORT, _SAME = {"rounds": 2, "steps": 5}, 0.01

# It is the same at all levels: the stiffnesses of linear rotors at the lowest and the highest differ by less than this.
_ALIKE = 0.05

# Effects whose stiffness at rest is not k_b; points that are descended from where the gap is small, and by how much
# more of the misfit than the best one's a candidate may leave after that.
_SHARES_STIFFNESS = ("bearing_friction",)
_NEAR_STARTS, _AHEAD = 6, 240.0

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

# Mean square misfit that a law's noise leaves at most; docs/diagnosis-method.md says why it is more than 1.
ADEQUATE_NONLINEAR = 1.5

# A misfit by so much above the best one's is not fitted further, after the first fits and after those with more steps.
_CLEAR, _CLEARLY = 400.0, 100.0


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
    rest = Rest(calm, loud, seen_motion(problem, calm.k_b), held)
    final = problem.made(resolution=FINAL, refined=True)
    every, lines = thinned(final, _FIT_LINES, calm.k_b, MODEL_ERROR), _FIT_LINES
    nominal = every.fit(NOMINAL, calm.u, nu)
    small = nominal.chi2 < NEAR * nominal.n_data
    if small:
        every, lines = thinned(final, _ALL_LINES, calm.k_b, MODEL_ERROR), _ALL_LINES
        nominal = every.fit(NOMINAL, nominal.u, nominal.nu)
    linear = robust_fit(every, NOMINAL, nominal.u, nominal.nu) or nominal
    tell = _Teller(progress, len(hypotheses) + 3)
    others = _gridded(hypotheses)
    uneven = [hypothesis for hypothesis in hypotheses if hypothesis not in others]
    plain, left = (False, []) if small else _far(problem, others, rest, linear, nu, tell)
    beside = [] if plain else left[:1]  # told by other lines and errors than those near the nominal model
    if not plain:
        left = _near(problem, lines, others, rest, nominal, tell)
    tell("bilinear_support")
    left = [*(start for start in left if start.cost < _WITHIN * left[0].cost), *beside]
    if abs(np.log(rest.loud / calm.k_b)) < _ALIKE:
        left += [start for hypothesis in uneven for start in _uneven(problem, hypothesis, calm, nu)]
    tell("fits")
    several = thinned(problem.made(resolution=_SEVERAL), lines, calm.k_b, MODEL_ERROR)
    first = fitted(several, left, rounds=1, steps=3)
    fits = first_of_each(sorted(first, key=lambda fit: fit.cost), lambda fit: fit.hypothesis)[:_FINALISTS]
    near, far = _parted(fits, _CLEAR)
    nearest, behind = _parted(_or_vaguer(several, fitted(several, near)), _CLEARLY)
    fits = [*fitted(every, nearest), *behind, *far]
    fits += _bent(problem, every, fits)
    fits = best_first(fit for fit in fits if fit.log_evidence() > linear.log_evidence())
    if fits and _adequate(fits[0]):
        every, fits = _at_believed_levels(every, fits)
    return every, linear, Search(nominal, tuple(fits))


def most_promised(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis]) -> float:
    """Misfit that a weak law could take away beside a linear fit, to first order: the most of all points of the grids.

    A law moves the resonances of each level by what its own motions make of it, so its promise is told from noise where
    shifts that are free of each other are not.
    """
    rest = Rest(fit, fit.k_b, seen_motion(problem, fit.k_b), problem.forward.structure.supported_nodes)
    every = thinned(problem.made(resolution=ROUGH), _ALL_LINES, fit.k_b, MODEL_ERROR)
    score = Score(every, every.fit(fit.hypothesis, fit.u, fit.nu), settled=True)
    return max(each(partial(_promise, score, rest), _gridded(hypotheses)), default=0.0)


def _promise(score: Score, rest: Rest, hypothesis: Hypothesis) -> float:
    """The most that a law takes away to first order, at every second point of its grid: its strength is scaled."""
    gains = (
        score.gain(hypothesis.effects(u[1:]))[0] for u in itertools.islice(points_of(hypothesis, rest), 0, None, 2)
    )
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
    problem: Problem, hypotheses: Sequence[Hypothesis], rest: Rest, linear: Fit, nu: FloatArray, tell: _Teller
) -> tuple[bool, list[Start]]:
    """Where the gap is plain: a grid over all numbers by relative distance, then descents; best first.

    It is not where the best explains hardly more than the linear rotor does: few lines hold the gap then, and errors as
    large as these descents begin with hide it.

    Returns
    -------
    whether the gap is plain, and where the descents ended
    """
    calm = rest.calm
    few = thinned(problem.made(resolution=ROUGH), _GRID_LINES, calm.k_b, _ROUGH_ERROR)
    grid: dict[str, list[Start]] = {}
    for hypothesis, points in anew(few, partial(by_distance, rest=rest, nu=nu), hypotheses):
        tell(str(hypothesis))
        grid.setdefault(hypothesis.ids[0], []).extend(points)
    tell("descents")
    rough = descend(few, [start for points in grid.values() for start in _promising(points)], _FIRST)
    some = thinned(problem.made(resolution=MIDDLE), _DESCENT_LINES, calm.k_b, _MIDDLE_ERROR)
    left = settle(some, [start for start in rough[:_LEFT] if start.cost < _ROUGHLY * rough[0].cost])
    left = best_of_each([*left, *settle(some, [*_told(some, left), *_read(problem, hypotheses, rest, nu)])])
    if not left or left[0].cost > _GAINED * robust_misfit(some, linear)[0]:
        return False, left
    return True, best_of_each([*left, *settle(some, _elsewhere(some, hypotheses, left))])[:_LEFT]


def _read(problem: Problem, hypotheses: Sequence[Hypothesis], rest: Rest, nu: FloatArray) -> list[Start]:
    """The places of laws that the forces in the runs tell of best; a coarse grid of responses misses soft contacts."""
    lines = thinned(problem.made(resolution=ROUGH), _FIT_LINES, rest.calm.k_b, MODEL_ERROR)
    found = each(partial(read, lines, rest, nu), [h for h in hypotheses if h.ids[0] in READ])
    return sorted((start for start in found if start), key=cost_of)[:_PLACES]


def _parted(fits: Sequence[Fit], clear: float) -> tuple[list[Fit], list[Fit]]:
    """Fits whose misfit is clearly above the least apart from the others."""
    limit = min((fit.cost for fit in fits), default=0.0) + clear
    return [fit for fit in fits if fit.cost < limit], [fit for fit in fits if fit.cost >= limit]


def _told(problem: Problem, starts: Sequence[Start]) -> list[Start]:
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
        start = Start(fit.hypothesis, fit.u, fit.nu, fit.cost)
        ends = [replace(start, u=points[-1]) for points in _ranges(start)]
        others = fitted(problem, [*_told(problem, [start]), *ends])
        chosen.append(max([fit, *others], key=lambda each: each.log_evidence()))
    return chosen


def _ranges(start: Start) -> list[FloatArray]:
    """Points along the range of every number of the start that coarse motions hardly tell."""
    vague = _VAGUE.get(start.hypothesis.ids[0])
    found = []
    for place, free in enumerate(start.hypothesis.free, start=1):
        if free.name == vague:
            points = np.tile(start.u, (_TRIED, 1))
            points[:, place] = axis(free, _TRIED)
            found.append(points)
    return found


def _misfit(problem: Problem, start: Start) -> float:
    """Robust misfit of a start as it stands; infinite where it has no model."""
    try:
        return robust_misfit(problem, unfitted(problem, start.hypothesis, start.u, start.nu))[0]
    except (ValueError, np.linalg.LinAlgError):
        return np.inf


def _uneven(problem: Problem, hypothesis: Hypothesis, calm: Fit, nu: FloatArray) -> list[Start]:
    """The start of a bilinear support: fits of one level, as it is the same at all of them, from several ratios.

    How stiff it is on average is another number for every resonance, and takes several harmonics. Single lines near a
    resonance are on another branch of the response at times, so the fits are robust.
    """
    low = thinned(_at_level(problem.made(resolution=_SEVERAL), min), _DESCENT_LINES, calm.k_b, MODEL_ERROR)
    points = list(each(partial(_of_mean, low, hypothesis, calm), _RATIOS))
    found = sorted(fitted(low, points, **_UNEVEN_EFFORT), key=lambda fit: fit.cost)
    near = [Start(hypothesis, fit.u, nu, fit.cost) for fit in found if fit.cost < _WITHIN * found[0].cost]
    return first_of_each(near, lambda start: tuple(np.round(start.u / _SAME)))


def _of_mean(low: Problem, hypothesis: Hypothesis, calm: Fit, log_ratio: float) -> Start:
    """A bilinear support of a ratio, as stiff on average as suits the runs best."""
    ratio = log_ratio if hypothesis.free[0].log else np.exp(log_ratio)
    starts = []
    for mean in _MEANS:
        low.forget()
        u = hypothesis.clipped(np.array([np.log(mean * calm.k_b) + _softer(log_ratio), ratio]))
        starts.append(Start(hypothesis, u, calm.nu, distance(low, unfitted(low, hypothesis, u, calm.nu))))
    return min(starts, key=cost_of)


def _softer(log_ratio: float) -> float:
    """Logarithm of a bilinear support's mean stiffness over that of a linear one of the same frequency."""
    return float(np.log((1 + np.exp(log_ratio / 2)) ** 2 / (4 * np.exp(log_ratio))))


def _near(
    problem: Problem, lines: int, hypotheses: Sequence[Hypothesis], rest: Rest, nominal: Fit, tell: _Teller
) -> list[Start]:
    """Where the gap is small: the same grid by what each point leaves of the misfit, nuisances refitted to first order.

    Effects that take part of the bearing stiffness away, which is no small step, are taken from the other grid as well.
    """
    k_b, rough = rest.calm.k_b, problem.made(resolution=ROUGH)
    every = thinned(rough, lines, k_b, MODEL_ERROR)
    finer = thinned(problem.made(resolution=MIDDLE), lines, k_b, MODEL_ERROR)
    nominal = every.fit(NOMINAL, nominal.u, nominal.nu)
    grid: dict[str, list[Start]] = {}
    nu = np.clip(nominal.nu, -2 * nominal.prior_std, 2 * nominal.prior_std)
    beside: list[Start] = []
    gains = each(partial(by_score, Score(every, nominal), rest), hypotheses)
    for hypothesis, points in zip(hypotheses, gains, strict=True):
        tell(str(hypothesis))
        grid.setdefault(hypothesis.ids[0], []).extend(points)
        if hypothesis.ids[0] in _SHARES_STIFFNESS:
            few = thinned(rough, _DESCENT_LINES, k_b, MODEL_ERROR)
            beside += sorted(by_distance(few, hypothesis, rest, nu), key=cost_of)[:1]
    tell("descents")
    chosen = _few_of_each([start for points in grid.values() for start in _promising(points)])[:_NEAR_STARTS]
    left = descend(finer, [*chosen, *beside], (0.0,))
    left = _few_of_each([*left, *descend(finer, _elsewhere(finer, hypotheses, left), (0.0,))])[:_LEFT]
    return [start for start in left if start.cost < left[0].cost + _AHEAD]


def _bent(problem: Problem, every: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """The best law bent, if it can be, where it leaves more than noise: that number roughly first, then all finely."""
    plain = min(fits, key=lambda fit: fit.cost, default=None)
    if plain is None or _adequate(plain):
        return []
    law = plain.hypothesis
    starts = [Start(law.bent, u, plain.nu) for u in law.bent_from(plain.u)]
    if not starts:
        return []
    some = thinned(problem.made(resolution=MIDDLE), _DESCENT_LINES, plain.k_b, _MIDDLE_ERROR)
    return fitted(every, settle(some, descend(some, starts, _FIRST))[:1])


def _adequate(fit: Fit) -> bool:
    return fit.chi2 < ADEQUATE_NONLINEAR * fit.n_data


def _at_believed_levels(problem: Problem, fits: Sequence[Fit]) -> tuple[Problem, Sequence[Fit]]:
    """Forces as large as the runs believe where the evidence of the best law is with that, else all as it is.

    A law's numbers are known no better than the force, unless several levels agree on them.
    """
    sure, starts = problem.at_believed_levels(), []
    for fit in fits:
        nu = fit.nu.copy()
        nu[sure.nuisances.level] = 0.0
        starts.append(Start(fit.hypothesis, fit.u, nu, fit.cost))
    best = fitted(sure, starts[:1])
    if not best or best[0].log_evidence() < fits[0].log_evidence():
        return problem, fits
    return sure, best_first([*best, *fitted(sure, starts[1:])])


def _elsewhere(problem: Problem, hypotheses: Sequence[Hypothesis], found: Sequence[Start]) -> list[Start]:
    """The leader's law at its other places, with numbers that the largest motion feels alike."""
    if not (found and "node" in dict(found[0].hypothesis.terms[0].fixed)):
        return []
    leader = found[0]
    size = _largest_motion(problem, leader)
    starts = []
    for other in hypotheses:
        if other.ids == leader.hypothesis.ids and other != leader.hypothesis:
            ratio = np.log(size[node_of(other) - 1])
            moved = [{"gap": ratio, "stiffness": -2 * ratio}.get(free.name, 0.0) for free in other.free]
            starts.append(Start(other, other.clipped(leader.u + np.array([0.0, *moved])), leader.nu))
    return starts


def _largest_motion(problem: Problem, start: Start) -> FloatArray:
    """(n_nodes,) displacements where the node of a start moves most, relative to that node's."""
    fit = unfitted(problem, start.hypothesis, start.u, start.nu)
    motions = []
    for modal in problem.modals(fit.k_b, fit.effects):
        law = modal.as_nonlinear
        if law is not None:
            plane = 1 if law.run.excitation_plane == "y" else 2
            solved = law.motions()
            motions.append(np.abs(solved.states[solved.converged, 1] @ law.balance.read_out(plane).T))
    motion = np.concatenate(motions)
    own = motion[:, node_of(start.hypothesis) - 1]
    return np.maximum(motion[own.argmax()] / own.max(), _LEAST_MOTION)


def _promising(points: Sequence[Start]) -> list[Start]:
    """The best points of an effect: of each of its places one, of a single place several."""
    places = best_of_each(points)
    return sorted(points, key=cost_of)[:_STARTS] if len(places) == 1 else places[:_PLACES]


def _few_of_each(starts: Sequence[Start]) -> list[Start]:
    """The best candidates, best first, of each law not more than two places."""
    return first_of_each(best_of_each(starts), lambda start: start.hypothesis.ids[0], _PLACES_SMALL)


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
