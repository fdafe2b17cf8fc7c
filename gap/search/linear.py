"""From runs to ranked candidates.

1. Recalibrate the nominal model.
2. Give every candidate starts: far from the data by a rough fit of logarithms, close to them next to the nominal
   model, where Rao's score says how much each candidate could explain to first order.
3. Race the candidates: with relative errors added that shrink from stage to stage, those that fall behind drop out.
4. Where no single effect is adequate, race pairs: every candidate beside the leaders.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import TypeVar

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B, K_B_RANGE, NOMINAL, Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.search.starts import (
    RIVALS,
    THIRD,
    Promise,
    Start,
    begin,
    crossing,
    placed,
    points,
    promises,
    scanned,
    several,
)
from rigtwin.gap.search.strategies.bearing_stiffness import MeasuredStiffness, law_starts, measured_stiffness
from rigtwin.gap.search.workers import each
from rigtwin.rotor.model.structure import FloatArray

T = TypeVar("T")

Progress = Callable[[int, int, str], None]

# Starting values of the bearing stiffness along its range.
_K_B_STARTS = 15

# A rough cost within this factor (and this much) of the best one is worth racing.
_WORTH_FACTOR, _WORTH = 3.0, 0.02

# To first order, a candidate is worth a fit from this share of the largest gain, or within so much of it.
_WORTH_GAIN, _WORTH_MISFIT = 0.3, 40.0

# An effect that takes away such a share of the misfit, and leaves so much of it per value, leaves nothing for others.
_ALL, _NOTHING = 0.9, 2.0

# At least so many candidates are raced.
_AT_LEAST = 12

# Steps of rough descents from all points, and from so many points of every candidate, the lowest, unless these are
# behind the best candidate's by this factor.
_DOWN, _CARRIED, _DROPPED = (2, 6), 3, 10.0

# Steps of descents along the long valleys of laws that are bent.
_LONG_WAY = 24

# Close: the mean square misfit of the nominal model is below the first and its nuisances are not further outside
# their priors than by so many standard deviations.
NEAR, _CALM = 5.0, 40.0


@dataclass(frozen=True)
class Stage:
    """One round of the race."""

    added: float  # relative error that is added to the data's own
    steps: int  # at most
    keep: int  # candidates' starts that go on, at most
    behind: float = 2.0  # misfit over the best one's beyond which a start drops out, but for ``_HOPELESS``


FAR = (Stage(0.1, 1, 60, behind=5.0), Stage(0.1, 4, 30), Stage(0.02, 6, 16), Stage(0.0, 20, 12))
CLOSE = (Stage(0.0, 20, 100),)
BENT = (Stage(0.1, 60, 12), Stage(0.02, 60, 8), Stage(0.0, 60, 4))

# Leading candidates that are fitted to the end: valleys of several numbers are long.
POLISHED, _PATIENCE = 4, 60

# So much more misfit than the best one's can be made good anywhere; where a race of many begins, so many times as much.
_HOPELESS, _FROM_THE_START = 400.0, 20.0


@dataclass(frozen=True)
class Search:
    """What a search led to."""

    nominal: Fit
    fits: tuple[Fit, ...]  # best first by evidence, the nominal model not among them
    rough: tuple[Start, ...] = ()  # best first by logarithms, one of every effect; none close to the nominal model

    @property
    def best(self) -> Fit:
        """The best candidate, or the nominal model where there is none."""
        return self.fits[0] if self.fits else self.nominal


def recalibrate(problem: Problem, start: Fit | None = None) -> Fit:
    """The nominal model with the bearing stiffness that suits the runs best."""
    if start is not None:
        return problem.fit(NOMINAL, start.u, start.nu, anneal=(0.0,))
    if not problem.with_k_b:
        return problem.fit(NOMINAL, np.array([np.log(1e7)]))
    starts = np.geomspace(*K_B_RANGE, _K_B_STARTS)
    few = problem.thinned(THIRD)
    rough = [few.rough(NOMINAL, np.array([np.log(start)]), sum(_DOWN)) for start in starts]
    best = min(rough, key=itemgetter(1))[0]
    return problem.fit(NOMINAL, best)


def matched(problem: Problem, nominal: Fit, scale: float = 1.0) -> Fit:
    """The nominal model that is as near to all lines alike as a relative error of the data lets it be.

    Where a gap is many times the noise, its drifts and tolerances would go any way to follow the few lines with the
    smallest errors, and k_b with them. The least error is added that what is left is within: none without a gap.

    Parameters
    ----------
    nominal : its fit by the data's own errors
    scale : true over believed standard error
    """
    if nominal.chi2 <= _WITHIN * nominal.n_data * scale**2:
        return nominal
    best = problem.fit(NOMINAL, nominal.u, anneal=_ADDED[:1])
    for added in _ADDED[1:]:
        fit = problem.fit(NOMINAL, best.u, best.nu, anneal=(added,))
        if fit.chi2 > _WITHIN * fit.n_data:
            break
        best = fit
    return best


def strained(problem: Problem, cause: Fit) -> Fit:
    """The nominal model with its nuisances bent as far as they go towards what a cause explains.

    It starts with the cause's resonances, taken for drifts under priors far too wide, which are narrowed step by step.
    """
    nu, u = cause.nu.copy(), cause.u[:1]
    there, here = (problem.modals(cause.k_b, effects) for effects in (cause.effects, ()))
    for modal, plain, drift in zip(there, here, problem.nuisances.drift, strict=True):
        n = min(len(modal.frequencies_hz), len(plain.frequencies_hz))
        nu[drift][:n] += modal.frequencies_hz[:n] / plain.frequencies_hz[:n] - 1
    made = problem.loosened(_LOOSE[0]).fit(NOMINAL, u, nu, anneal=(0.1, 0.02, 0.0))
    for factor in _LOOSE[1:]:
        made = problem.loosened(factor).fit(NOMINAL, made.u, made.nu, anneal=(0.0,))
    return made


# Relative errors that are added, and mean square misfit that is within them.
_ADDED, _WITHIN = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005), 1.1

# Factors of the nuisances' priors.
_LOOSE = (300.0, 100.0, 30.0, 10.0, 3.0, 1.0)


def search(
    problem: Problem,
    hypotheses: Sequence[Hypothesis],
    nominal: Fit | None = None,
    progress: Progress | None = None,
) -> Search:
    """Fit all candidates that are worth it.

    Parameters
    ----------
    problem : the runs
    hypotheses : candidates
    nominal : its fit, where it is known already
    progress : called with (done, total, words)
    """
    nominal = nominal or recalibrate(problem)
    if _close(nominal):
        fits = race(problem, weak_starts(problem, hypotheses, nominal, progress), CLOSE, progress)
    else:
        starts, rough = _rough_starts(problem, hypotheses, nominal, progress)
        return Search(nominal, tuple(race(problem, starts, FAR, progress)), rough)
    return Search(nominal, tuple(fits))


def from_afar_too(
    problem: Problem, found: Search, hypotheses: Sequence[Hypothesis], progress: Progress | None = None
) -> Search:
    """A search next to the nominal model, and effects of several numbers from rough descents as well.

    Where such an effect is weak it may act the other way than where it explains the runs.
    """
    if found.rough:
        return found
    of_several = [hypothesis for hypothesis in hypotheses if several(hypothesis)]
    starts, _ = _rough_starts(problem, of_several, found.nominal, progress)
    fits = best_first([*found.fits, *race(problem, starts, FAR, progress)])
    return replace(found, fits=tuple(first_of_each(fits, lambda fit: fit.hypothesis)))


def _close(nominal: Fit) -> bool:
    outside = np.abs(nominal.nu / nominal.prior_std).max()
    return nominal.cost < NEAR * nominal.n_data and bool(outside < _CALM)


def race(problem: Problem, starts: Sequence[Start], stages: Sequence[Stage], progress: Progress | None) -> list[Fit]:
    """The candidates that do not fall behind, each from its best start, best first by evidence and prior."""
    fits: list[Fit] = []
    if len(stages) > 1:
        starts = _not_hopeless(problem, starts, stages[0].added)
    for stage in stages:
        fits = []
        for number, fit in enumerate(each(partial(fitted, problem, stage), starts)):
            if progress:
                progress(number, len(starts), str(starts[number].hypothesis))
            if fit is not None:
                fits.append(fit)
        fits.sort(key=lambda fit: fit.cost)
        fits = [fit for fit in fits if fit.cost <= stage.behind * fits[0].cost + _HOPELESS]
        fits = _of_each(fits, RIVALS)[: stage.keep]
        starts = [Start(fit.hypothesis, fit.u, fit.nu) for fit in fits]
    fits = _of_each(fits, 1)
    return best_first([*all_polished(problem, fits[:POLISHED]), *fits[POLISHED:]])


def fitted(problem: Problem, stage: Stage, start: Start) -> Fit | None:
    """A stage of the race from one start; None where there is no model."""
    return problem.try_fit(start.hypothesis, start.u, start.nu, anneal=(stage.added,), steps=stage.steps)


def _not_hopeless(problem: Problem, starts: Sequence[Start], added: float) -> list[Start]:
    """The starts that are not far behind the best one, with such a relative error added."""
    costs = [problem.cost(start.hypothesis, start.u, start.nu, added) for start in starts]
    limit = _FROM_THE_START * min(costs, default=0.0) + _HOPELESS
    return [start for start, cost in zip(starts, costs, strict=True) if cost <= limit]


def with_bent(problem: Problem, found: Search, hypotheses: Sequence[Hypothesis]) -> Search:
    """The search, and its best effect bent, where it can be; far from the data, the best of all that can be."""
    starts = _bent(found.best)
    if found.rough:
        few, base = problem.thinned(THIRD), found.nominal.u[:1]
        laws = [hypothesis.bent for hypothesis in hypotheses if hypothesis.bent != hypothesis]
        seat = measured_stiffness(few, found.nominal)
        ends = each(partial(_all_the_way_down, few, base, seat), laws)
        rough = [(law, u) for law, us in zip(laws, ends, strict=True) for u in us]
        starts += [Start(law, u, problem.unit(law, u)) for law, u in rough]
        starts += [begin(law, u, found.nominal) for law, u in rough]
    return _along_with(race(problem, starts, BENT, None) if starts else [], bent_little(problem, found))


def bent_little(problem: Problem, found: Search) -> Search:
    """The search, and its best effect bent, fitted without an added error: a slight bend would hide behind one."""
    starts = _bent(found.best)
    return _along_with(race(problem, starts, CLOSE, None) if starts else [], found)


def _bent(fit: Fit) -> list[Start]:
    """Starts of an effect with its law bent, where that can be."""
    return [Start(fit.hypothesis.bent, u, fit.nu) for u in fit.hypothesis.bent_from(fit.u)]


def _along_with(fits: Sequence[Fit], found: Search) -> Search:
    """The search, and the best of these fits."""
    return replace(found, fits=tuple(best_first([*found.fits, *fits[:1]])))


def _all_the_way_down(
    few: Problem, base: FloatArray, seat: MeasuredStiffness | None, hypothesis: Hypothesis
) -> list[FloatArray]:
    """Where a candidate's best rough descents end; of a law of the bearings, those to what a run says of it."""
    if seat and hypothesis.terms[0].effect.location == "bearings":
        return law_starts(few, seat, hypothesis, K_B.value(base[0]))
    first = _down(few, base, hypothesis)[:_CARRIED]
    return [few.rough(hypothesis, x, _LONG_WAY)[0] for x, _ in first]


def best_first(fits: Iterable[Fit]) -> list[Fit]:
    """By evidence and prior."""
    return sorted(fits, key=lambda fit: fit.log_weight, reverse=True)


def polished(problem: Problem, fit: Fit) -> Fit:
    """The same candidate, fitted on from where it is, with the tolerances as they act there."""
    problem.bend(fit)
    return problem.fit(fit.hypothesis, fit.u, fit.nu, anneal=(0.0,), steps=_PATIENCE)


def all_polished(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """Several candidates, each fitted on.

    On a support where the same of their effects act, candidates share how tolerances bend the modes: at the end it is
    as the best of them had it.
    """
    made = list(each(partial(polished, problem), fits))
    for _, begun in sorted(zip(made, fits, strict=True), key=lambda both: both[0].log_weight):
        problem.bend(begun)
    return made


def first_of_each(items: Iterable[T], key: Callable[[T], Hashable], count: int = 1) -> list[T]:
    """The first so many items of every key, in their order."""
    seen: Counter[Hashable] = Counter()
    kept = []
    for item in items:
        seen[key(item)] += 1
        if seen[key(item)] <= count:
            kept.append(item)
    return kept


def _of_each(fits: Iterable[Fit], count: int) -> list[Fit]:
    """The first so many of every candidate."""
    return first_of_each(fits, lambda fit: fit.hypothesis.rotor, count)


def _rough_starts(
    problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit, progress: Progress | None
) -> tuple[list[Start], tuple[Start, ...]]:
    """Starts of the candidates whose rough cost is near the best one's, and the best of every effect by that alone.

    Where a grid has found an effect that leaves next to nothing, no rough descents are needed.
    """
    few = problem.thinned(THIRD)
    base = few.rough(NOMINAL, nominal.u[:1], sum(_DOWN))[0] if problem.with_k_b else nominal.u[:1]
    score = Score(problem, nominal)
    by_grid = {h: scanned(problem, h, nominal) for h in hypotheses}
    most = max(_ALL * nominal.cost, nominal.cost - _NOTHING * nominal.n_data)
    found_by_grid = any(promise.gain > most for promises in by_grid.values() for promise in promises)
    weak = {h: (by_grid[h] or _promised(problem, score, h))[0] for h in hypotheses}
    found = {} if found_by_grid else _descents(few, hypotheses, base, progress)
    on_grid = {h: [] if found_by_grid else crossing(few, h, nominal, FAR[0].added) for h in hypotheses}
    rough = [_Rough(h, found.get(h, []), weak[h], on_grid[h]) for h in hypotheses]
    rough.sort(key=lambda entry: (entry.cost, -entry.weak.gain))
    limit = _WORTH_FACTOR * rough[0].cost + _WORTH if rough else 0.0
    told = sorted((entry.weak.gain for entry in rough), reverse=True)[:_AT_LEAST]
    worth = [
        entry
        for place, entry in enumerate(rough)
        if place < _AT_LEAST or entry.cost < limit or entry.weak.gain >= told[-1] or entry.crossing
    ]
    first = {entry.hypothesis.ids: entry for entry in reversed(rough) if entry.found}
    best = sorted(first.values(), key=lambda entry: entry.cost)
    return [s for entry in worth for s in entry.starts(nominal)], tuple(entry.starts(nominal)[0] for entry in best)


def _promised(problem: Problem, score: Score, hypothesis: Hypothesis) -> list[Promise]:
    """What a candidate could take away: along the shaft by short fits, else to first order."""
    return placed(problem, hypothesis, score.fit) or promises(score, hypothesis)


@dataclass(frozen=True)
class _Rough:
    """A candidate after a rough descent."""

    hypothesis: Hypothesis
    found: list[tuple[FloatArray, float]]  # coordinates and cost, best first; none were looked for where it is empty
    weak: Promise
    crossing: list[Start]

    @property
    def cost(self) -> float:
        return self.found[0][1] if self.found else np.inf

    def starts(self, nominal: Fit) -> list[Start]:
        """Where its fits begin."""
        chosen = [begin(self.hypothesis, x, nominal) for x, _ in self.found[:RIVALS]]
        return [*chosen, *([self.weak.start] if self.weak.gain > 0 else []), *self.crossing]


def _descents(
    few: Problem, hypotheses: Sequence[Hypothesis], base: FloatArray, progress: Progress | None
) -> dict[Hypothesis, list[tuple[FloatArray, float]]]:
    """Rough descents of all candidates, the best ones carried on; coordinates and cost, best first."""
    made = {}
    for number, found in enumerate(each(partial(_down, few, base), hypotheses)):
        if progress:
            progress(number, 2 * len(hypotheses), str(hypotheses[number]))
        made[hypotheses[number]] = found
    limit = _DROPPED * min((found[0][1] for found in made.values()), default=0.0)
    near = [(hypothesis, found) for hypothesis, found in made.items() if found[0][1] <= limit]
    made |= zip([hypothesis for hypothesis, _ in near], each(partial(_further_down, few), near), strict=True)
    return made


def _down(few: Problem, base: FloatArray, hypothesis: Hypothesis) -> list[tuple[FloatArray, float]]:
    """Short descents from all points of a candidate."""
    return _best([few.rough(hypothesis, point, _DOWN[0]) for point in points(base, hypothesis)])


def _further_down(
    few: Problem, found: tuple[Hypothesis, list[tuple[FloatArray, float]]]
) -> list[tuple[FloatArray, float]]:
    """The best of a candidate's descents carried on."""
    hypothesis, first = found
    return _best([few.rough(hypothesis, x, _DOWN[1]) for x, _ in first[:_CARRIED]])


def _best(found: list[tuple[FloatArray, float]]) -> list[tuple[FloatArray, float]]:
    """By cost."""
    return sorted(found, key=itemgetter(1))


def weak_starts(
    problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit, progress: Progress | None = None
) -> list[Start]:
    """Starts next to the nominal model of the candidates that could explain most to first order."""
    score = Score(problem, nominal)
    found: list[tuple[float, list[Start]]] = []
    for number, hypothesis in enumerate(hypotheses):
        if progress:
            progress(number, 2 * len(hypotheses), str(hypothesis))
        tried = scanned(problem, hypothesis, nominal) or _promised(problem, score, hypothesis)
        found.append((tried[0].gain, [promise.start for promise in tried[:RIVALS]]))
    found.sort(key=lambda entry: entry[0], reverse=True)
    limit = min(_WORTH_GAIN * found[0][0], found[0][0] - _WORTH_MISFIT) if found else 0.0
    return [
        start
        for place, (gain, starts) in enumerate(found)
        for start in starts
        if place < _AT_LEAST or gain >= limit or several(start.hypothesis)
    ]
