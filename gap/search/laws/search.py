"""Which nonlinear effect: a grid over its numbers on few lines, descent from the best points, a robust fine fit."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, Hypothesis
from rigtwin.gap.inference.problem import MODEL_ERROR, Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.motions import FINAL, MIDDLE, ROUGH, Resolution
from rigtwin.gap.search.laws.grid import by_distance, by_score, distance, seen_motion
from rigtwin.gap.search.laws.reading import read
from rigtwin.gap.search.laws.robust import (
    best_of_each,
    cost_of,
    descend,
    each_from_scratch,
    fit_at_start,
    robust_fit,
    robust_fits,
    robust_misfit,
    settle,
    thin_out,
)
from rigtwin.gap.search.nominal import NOMINAL_FITS, recalibrate
from rigtwin.gap.search.race import Progress, Search, best_first, first_of_each
from rigtwin.gap.search.starts import Start
from rigtwin.gap.search.strategies.law import Rest, axis
from rigtwin.gap.search.strategies.registry import law_strategy_of
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.shared_work import each


@dataclass(frozen=True)
class Thinning:
    """Every so many lines are used."""

    grid: int = 8
    descents: int = 6
    fits: int = 4
    small_gap: int = 1  # where the gap is small all are, as one line may hold it


@dataclass(frozen=True)
class LawSearch:
    """How laws are narrowed down."""

    rough_error: float = 0.05  # what coarsely computed motions leave of the response
    middle_error: float = 0.01  # the same of finer ones
    tried: int = 14  # points along a number that coarse motions hardly tell, on finer ones
    first_added: tuple[float, ...] = (0.3,)  # relative error that is added in the first descents
    starts: int = 2  # points of the grid that are descended from, of every effect,
    places: int = 3  # or of one with places, so many places
    places_small: int = 2  # places that are carried on where the gap is small: they hardly differ there
    near_starts: int = 6  # points that are descended from where the gap is small,
    ahead: float = 240.0  # and by how much more of the misfit than the best one's a candidate may leave after that
    least_motion: float = 0.03  # share of another node's motion that a node is taken to move at least
    left: int = 4  # effects that are left after the first descents,
    finalists: int = 3  # and after the second
    roughly: float = 3.0  # beyond the best one, only those whose loss is within this factor of its go on,
    within: float = 1.5  # and later within this one
    gained: float = 0.7  # share of the linear rotor's misfit that the best of these leaves at most
    clear: float = 400.0  # a misfit by so much above the best one's is not fitted further after the first fits,
    clearly: float = 100.0  # and by so much after those with more steps


@dataclass(frozen=True)
class UnevenSearch:
    """Where a support that is stiffer one way begins."""

    log_ratios: tuple[float, ...] = (0.1, 0.2, 0.4, 0.7, 1.0)  # logarithms of the ratio that are started from
    means: tuple[float, ...] = (0.97, 1.0, 1.03, 1.06, 1.1)  # its mean stiffness over that of a linear rotor
    rounds: int = 2  # how long it is followed,
    steps: int = 5  # and in how many steps each
    same: float = 0.01  # ends that are so near are one place: one level hardly tells them apart
    # It is the same at all levels: the stiffnesses of linear rotors at the lowest and the highest differ by less.
    alike: float = 0.05


EVERY = Thinning()
LAWS = LawSearch()
UNEVEN = UnevenSearch()

# How finely all laws are fitted first, and an uneven support is followed.
SEVERAL = Resolution(9, 256, 15, bends=True)


def search_nonlinear(
    problem: Problem, hypotheses: Sequence[Hypothesis], adequate: float, progress: Progress | None = None
) -> tuple[Problem, Fit, Search]:
    """Fit the nonlinear candidates; adequate: mean square misfit from which a fit is carried on at the given levels.

    Returns
    -------
    the problem with the model error of a truncated motion; the nominal model fitted to it as the candidates are, where
    a line far from the data counts by the logarithm of its misfit; and the search: candidates that explain more
    """
    rest, nu = _rest(problem)
    calm = rest.calm
    final = problem.made(resolution=FINAL, refined=True)
    every, lines = thin_out(final, EVERY.fits, calm.k_b, MODEL_ERROR), EVERY.fits
    nominal = every.fit(NOMINAL, calm.u, nu)
    small = nominal.chi2 < NOMINAL_FITS.near * nominal.n_data
    if small:
        every, lines = thin_out(final, EVERY.small_gap, calm.k_b, MODEL_ERROR), EVERY.small_gap
        nominal = every.fit(NOMINAL, nominal.u, nominal.nu)
    linear = robust_fit(every, NOMINAL, nominal.u, nominal.nu) or nominal
    tell = _Teller(progress, len(hypotheses) + 3)
    others = _gridded(hypotheses)
    plain, left = (False, []) if small else _far(problem, others, rest, linear, nu, tell)
    beside = [] if plain else left[:1]  # told by other lines and errors than those near the nominal model
    if not plain:
        left = _near(problem, lines, others, rest, nominal, tell)
    tell("uneven supports")
    left = [*(start for start in left if start.cost < LAWS.within * left[0].cost), *beside]
    if abs(np.log(rest.loud / calm.k_b)) < UNEVEN.alike:
        uneven = (hypothesis for hypothesis in hypotheses if hypothesis not in others)
        left += [start for hypothesis in uneven for start in _uneven(problem, hypothesis, calm, nu)]
    tell("fits")
    fits = _fits(problem, every, lines, calm.k_b, left, adequate)
    fits = best_first(fit for fit in fits if fit.log_evidence() > linear.log_evidence())
    if fits and is_adequate(fits[0], adequate):
        every, fits = _at_believed_levels(every, fits)
    return every, linear, Search(nominal, tuple(fits))


def _rest(problem: Problem) -> tuple[Rest, FloatArray]:
    """Linear rotors of the lowest and the highest level; the nuisances of the first, in the order of all runs."""
    calm, nu = _calm(problem)
    loud, held = recalibrate(at_level(problem, max)).k_b, problem.forward.structure.supported_nodes
    return Rest(calm, loud, seen_motion(problem, calm.k_b), held), nu


def _fits(
    problem: Problem, every: Problem, lines: int, k_b: float, starts: Sequence[Start], adequate: float
) -> list[Fit]:
    """Ever finer fits of ever fewer laws, the best of them bent where that may help."""
    several = thin_out(problem.made(resolution=SEVERAL), lines, k_b, MODEL_ERROR)
    first = robust_fits(several, starts, rounds=1, steps=3)
    fits = first_of_each(sorted(first, key=lambda fit: fit.cost), lambda fit: fit.hypothesis)[: LAWS.finalists]
    near, far = _parted(fits, LAWS.clear)
    nearest, behind = _parted(_or_vaguer(several, robust_fits(several, near)), LAWS.clearly)
    fits = [*robust_fits(every, nearest), *behind, *far]
    return [*fits, *_bent(problem, every, fits, adequate)]


def most_promised(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis]) -> float:
    """Misfit that a weak law could take away beside a linear fit, to first order: the most of all points of the grids.

    A law moves the resonances of each level by what its own motions make of it, so its promise is told from noise where
    shifts that are free of each other are not.
    """
    rest = Rest(fit, fit.k_b, seen_motion(problem, fit.k_b), problem.forward.structure.supported_nodes)
    every = thin_out(problem.made(resolution=ROUGH), EVERY.small_gap, fit.k_b, MODEL_ERROR).around(fit)
    score = Score(every, every.fit(fit.hypothesis, fit.u, fit.nu), settled=True)
    return max(each(partial(_promise, score, rest), _gridded(hypotheses)), default=0.0)


def _promise(score: Score, rest: Rest, hypothesis: Hypothesis) -> float:
    """The most that a law takes away to first order, at every second point of its grid: its strength is scaled."""
    gains = (
        score.gain(hypothesis.effects(u[1:]))[0]
        for u in itertools.islice(law_strategy_of(hypothesis).points(hypothesis, rest), 0, None, 2)
    )
    return max(gains, default=0.0)


def _gridded(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The laws that a grid tells of; see ``_uneven`` for the other one."""
    return [hypothesis for hypothesis in hypotheses if law_strategy_of(hypothesis).gridded]


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
    few = thin_out(problem.made(resolution=ROUGH), EVERY.grid, calm.k_b, LAWS.rough_error)
    grid: dict[str, list[Start]] = {}
    for hypothesis, points in each_from_scratch(few, partial(by_distance, rest=rest, nu=nu), hypotheses):
        tell(str(hypothesis))
        grid.setdefault(hypothesis.ids[0], []).extend(points)
    tell("descents")
    rough = descend(few, [start for points in grid.values() for start in _promising(points)], LAWS.first_added)
    some = thin_out(problem.made(resolution=MIDDLE), EVERY.descents, calm.k_b, LAWS.middle_error)
    left = settle(some, [start for start in rough[: LAWS.left] if start.cost < LAWS.roughly * rough[0].cost])
    left = best_of_each([*left, *settle(some, [*_told(some, left), *_read(problem, hypotheses, rest, nu)])])
    if not left or left[0].cost > LAWS.gained * robust_misfit(some, linear)[0]:
        return False, left
    return True, best_of_each([*left, *settle(some, _elsewhere(some, hypotheses, left))])[: LAWS.left]


def _read(problem: Problem, hypotheses: Sequence[Hypothesis], rest: Rest, nu: FloatArray) -> list[Start]:
    """The places of laws that the forces in the runs tell of best; a coarse grid of responses misses soft contacts."""
    lines = thin_out(problem.made(resolution=ROUGH), EVERY.fits, rest.calm.k_b, MODEL_ERROR)
    found = each(partial(read, lines, rest, nu), [h for h in hypotheses if law_strategy_of(h).readable])
    return sorted((start for start in found if start), key=cost_of)[: LAWS.places]


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
        others = robust_fits(problem, [*_told(problem, [start]), *ends])
        chosen.append(max([fit, *others], key=lambda each: each.log_evidence()))
    return chosen


def _ranges(start: Start) -> list[FloatArray]:
    """Points along the range of every number of the start that coarse motions hardly tell."""
    roles, found = start.hypothesis.terms[0].effect.parameters(), []
    for place, free in enumerate(start.hypothesis.free, start=1):
        if roles[free.name].vague:
            points = np.tile(start.u, (LAWS.tried, 1))
            points[:, place] = axis(free, LAWS.tried)
            found.append(points)
    return found


def _misfit(problem: Problem, start: Start) -> float:
    """Robust misfit of a start as it stands; infinite where it has no model."""
    try:
        return robust_misfit(problem, fit_at_start(problem, start.hypothesis, start.u, start.nu))[0]
    except (ValueError, np.linalg.LinAlgError):
        return np.inf


def _uneven(problem: Problem, hypothesis: Hypothesis, calm: Fit, nu: FloatArray) -> list[Start]:
    """Starts of a support that is stiffer one way: fits of one level, as it is the same at all, from several ratios.

    How stiff it is on average is another number for every resonance, and takes several harmonics. Single lines near a
    resonance are on another branch of the response at times, so the fits are robust.
    """
    low = thin_out(at_level(problem.made(resolution=SEVERAL), min), EVERY.descents, calm.k_b, MODEL_ERROR)
    points = list(each(partial(_of_mean, low, hypothesis, calm), UNEVEN.log_ratios))
    found = sorted(robust_fits(low, points, rounds=UNEVEN.rounds, steps=UNEVEN.steps), key=lambda fit: fit.cost)
    near = [Start(hypothesis, fit.u, nu, fit.cost) for fit in found if fit.cost < LAWS.within * found[0].cost]
    return first_of_each(near, lambda start: tuple(np.round(start.u / UNEVEN.same)))


def _of_mean(low: Problem, hypothesis: Hypothesis, calm: Fit, log_ratio: float) -> Start:
    """An uneven support of a ratio, as stiff on average as suits the runs best."""
    ratio = log_ratio if hypothesis.free[0].log else np.exp(log_ratio)
    starts = []
    for mean in UNEVEN.means:
        low.forget()
        u = hypothesis.clipped(np.array([np.log(mean * calm.k_b) + _softer(log_ratio), ratio]))
        starts.append(Start(hypothesis, u, calm.nu, distance(low, fit_at_start(low, hypothesis, u, calm.nu))))
    return min(starts, key=cost_of)


def _softer(log_ratio: float) -> float:
    """Logarithm of an uneven support's mean stiffness over that of a linear one of the same frequency."""
    return float(np.log((1 + np.exp(log_ratio / 2)) ** 2 / (4 * np.exp(log_ratio))))


def _near(
    problem: Problem, lines: int, hypotheses: Sequence[Hypothesis], rest: Rest, nominal: Fit, tell: _Teller
) -> list[Start]:
    """Where the gap is small: the same grid by what each point leaves of the misfit, nuisances refitted to first order.

    Effects that take part of the bearing stiffness away, which is no small step, are taken from the other grid as well.
    """
    k_b, rough = rest.calm.k_b, problem.made(resolution=ROUGH)
    every = thin_out(rough, lines, k_b, MODEL_ERROR)
    finer = thin_out(problem.made(resolution=MIDDLE), lines, k_b, MODEL_ERROR)
    nominal = every.fit(NOMINAL, nominal.u, nominal.nu)
    grid: dict[str, list[Start]] = {}
    nu = np.clip(nominal.nu, -2 * nominal.prior_std, 2 * nominal.prior_std)
    beside: list[Start] = []
    gains = each(partial(by_score, Score(every, nominal), rest), hypotheses)
    for hypothesis, points in zip(hypotheses, gains, strict=True):
        tell(str(hypothesis))
        grid.setdefault(hypothesis.ids[0], []).extend(points)
        if hypothesis.terms[0].effect.shares_k_b:
            few = thin_out(rough, EVERY.descents, k_b, MODEL_ERROR)
            beside += sorted(by_distance(few, hypothesis, rest, nu), key=cost_of)[:1]
    tell("descents")
    chosen = _few_of_each([start for points in grid.values() for start in _promising(points)])[: LAWS.near_starts]
    left = descend(finer, [*chosen, *beside], (0.0,))
    left = _few_of_each([*left, *descend(finer, _elsewhere(finer, hypotheses, left), (0.0,))])[: LAWS.left]
    return [start for start in left if start.cost < left[0].cost + LAWS.ahead]


def _bent(problem: Problem, every: Problem, fits: Sequence[Fit], adequate: float) -> list[Fit]:
    """The best law bent, if it can be, where it leaves more than noise: that number roughly first, then all finely."""
    plain = min(fits, key=lambda fit: fit.cost, default=None)
    if plain is None or is_adequate(plain, adequate):
        return []
    law = plain.hypothesis
    starts = [Start(law.bent, u, plain.nu) for u in law.bent_from(plain.u)]
    if not starts:
        return []
    some = thin_out(problem.made(resolution=MIDDLE), EVERY.descents, plain.k_b, LAWS.middle_error)
    return robust_fits(every, settle(some, descend(some, starts, LAWS.first_added))[:1])


def is_adequate(fit: Fit, adequate: float) -> bool:
    return fit.chi2 < adequate * fit.n_data


def _at_believed_levels(problem: Problem, fits: Sequence[Fit]) -> tuple[Problem, Sequence[Fit]]:
    """Forces as large as the runs believe where the evidence of the best law is with that, else all as it is.

    A law's numbers are known no better than the force, unless several levels agree on them.
    """
    sure, starts = problem.at_believed_levels(), []
    for fit in fits:
        nu = fit.nu.copy()
        nu[sure.nuisances.level] = 0.0
        starts.append(Start(fit.hypothesis, fit.u, nu, fit.cost))
    best = robust_fits(sure, starts[:1])
    if not best or best[0].log_evidence() < fits[0].log_evidence():
        return problem, fits
    return sure, best_first([*best, *robust_fits(sure, starts[1:])])


def _elsewhere(problem: Problem, hypotheses: Sequence[Hypothesis], found: Sequence[Start]) -> list[Start]:
    """The leader's law at its other places, with numbers that the largest motion feels alike."""
    if not (found and "node" in dict(found[0].hypothesis.terms[0].fixed)):
        return []
    leader = found[0]
    size = _largest_motion(problem, leader)
    starts = []
    for other in hypotheses:
        if other.ids == leader.hypothesis.ids and other != leader.hypothesis:
            ratio, roles = np.log(size[other.terms[0].node - 1]), other.terms[0].effect.parameters()
            moved = [roles[free.name].motion_power * ratio for free in other.free]
            starts.append(Start(other, other.clipped(leader.u + np.array([0.0, *moved])), leader.nu))
    return starts


def _largest_motion(problem: Problem, start: Start) -> FloatArray:
    """(n_nodes,) displacements where the node of a start moves most, relative to that node's."""
    fit = fit_at_start(problem, start.hypothesis, start.u, start.nu)
    motions = []
    for modal in problem.modals(fit.k_b, fit.effects):
        law = modal.as_nonlinear
        if law is not None:
            plane = 1 if law.run.excitation_plane == "y" else 2
            solved = law.motions()
            motions.append(np.abs(solved.states[solved.converged, 1] @ law.balance.read_out(plane).T))
    motion = np.concatenate(motions)
    own = motion[:, start.hypothesis.terms[0].node - 1]
    return np.maximum(motion[own.argmax()] / own.max(), LAWS.least_motion)


def _promising(points: Sequence[Start]) -> list[Start]:
    """The best points of an effect: of each of its places one, of a single place several."""
    places = best_of_each(points)
    return sorted(points, key=cost_of)[: LAWS.starts] if len(places) == 1 else places[: LAWS.places]


def _few_of_each(starts: Sequence[Start]) -> list[Start]:
    """The best candidates, best first, of each law not more than two places."""
    return first_of_each(best_of_each(starts), lambda start: start.hypothesis.ids[0], LAWS.places_small)


def at_level(problem: Problem, chosen: Callable[..., float]) -> Problem:
    """The runs at the lowest or the highest level of their support (``min`` or ``max``)."""
    level = [(run.support, run.force_amplitude_N or 0.0) for run in problem.runs]
    limit = {support: chosen(f for held, f in level if held == support) for support, _ in level}
    kept = [o for o, (support, f) in zip(problem.observed, level, strict=True) if f == limit[support]]
    return Problem(problem.forward, kept, problem.model_error)


def _calm(problem: Problem) -> tuple[Fit, FloatArray]:
    """The nominal model of the runs at the lowest level, and its nuisances in the order of all runs."""
    low = at_level(problem, min)
    fit = recalibrate(low)
    nu = np.zeros(problem.nuisances.n)
    nu[problem.nuisances.tolerance] = fit.nu[low.nuisances.tolerance]
    if low.nuisances.sensors == problem.nuisances.sensors:
        nu[problem.nuisances.sensor] = fit.nu[low.nuisances.sensor]
    return fit, np.clip(nu, -2 * problem.nuisances.std, 2 * problem.nuisances.std)
