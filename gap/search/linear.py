"""Single linear effects: every candidate gets starts, and they race.

Far from the data starts come from rough fits of resonances; close to them they lie next to the nominal model, where
Rao's score says how much each candidate could explain to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter

import numpy as np
from scipy.stats import chi2

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B, NOMINAL, Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.search.nominal import is_close, recalibrate
from rigtwin.gap.search.race import BENT, CLOSE, FAR, RACE, Progress, Search, best_first, first_of_each, race
from rigtwin.gap.search.starts import Start, begin, promises, several, worth_from
from rigtwin.gap.search.strategies.bearing_stiffness import MeasuredStiffness, law_starts, measured_stiffness
from rigtwin.gap.search.strategies.registry import strategy_of
from rigtwin.gap.search.strategies.strategy import Strategy
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.shared_work import each


@dataclass(frozen=True)
class NearSearch:
    """A search close to the nominal model."""

    # Where neither the misfit nor resonances and shapes of each run's own show more than noise, by this chance, only
    # candidates whose first-order gain could make up for the odds against any gap are fitted, and a few for the report.
    chance: float = 1e-3
    telling: float = 6.0  # twice the logarithm of these odds
    reported: int = 3


@dataclass(frozen=True)
class FarSearch:
    """A search far from the nominal model, by rough descents."""

    every: int = 3  # lines: every third tells enough to start from
    worth_factor: float = 3.0  # a rough cost within this factor of the best one,
    worth: float = 0.02  # and this much more, is worth racing
    nothing: float = 2.0  # an effect that leaves so much misfit per value leaves nothing for grids to find
    tried: int = 2  # points of every candidate, the lowest, from which descents begin
    first_steps: int = 1  # of these
    further_steps: int = 7  # of those carried on
    carried: int = 1  # points of every candidate that are carried on, the lowest,
    along_shaft: int = 3  # times as many along the shaft,
    dropped: float = 10.0  # unless these are behind the best candidate's by this factor
    long_way: int = 24  # steps along the long valleys of laws that are bent


NEAR_SEARCH = NearSearch()
FAR_SEARCH = FarSearch()


def search(
    problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit | None = None, progress: Progress | None = None
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
    if is_close(nominal):
        problem = problem.near_fit(nominal)
        starts = weak_starts(problem, hypotheses, nominal, progress)
        return Search(nominal, tuple(race(problem, starts, CLOSE, progress)))
    starts, rough = _rough_starts(problem, hypotheses, nominal, progress)
    found = Search(nominal, tuple(race(problem, starts, FAR, progress)), rough)
    others = partial(_starts_on_grids, problem, hypotheses, nominal)
    for more, stages in ((others, FAR), (lambda: starts, [replace(stage, patient=True) for stage in FAR])):
        if not (found.leads or found.best.cost < FAR_SEARCH.nothing * nominal.n_data):
            found = _along_with(race(problem, more(), stages, progress), found)
    return found


def search_from_afar(
    problem: Problem, found: Search, hypotheses: Sequence[Hypothesis], progress: Progress | None = None
) -> Search:
    """A search next to the nominal model, and effects of several numbers from rough descents as well.

    Where such an effect is weak it may act the other way than where it explains the runs.
    """
    if found.rough:
        return found
    of_several = [hypothesis for hypothesis in hypotheses if several(hypothesis)]
    starts, _ = _rough_starts(problem, of_several, found.nominal, progress)
    return _along_with(race(problem, starts, FAR, progress), found)


def bend_laws(problem: Problem, found: Search, hypotheses: Sequence[Hypothesis]) -> Search:
    """The search, and its best effect bent, where it can be; far from the data, the best of all that can be, unless an
    effect leads."""
    starts = _bent(found.best)
    if found.rough and not found.leads:
        few, base = problem.thinned(FAR_SEARCH.every), found.nominal.u[:1]
        laws = [hypothesis.bent for hypothesis in hypotheses if hypothesis.bent != hypothesis]
        seat = measured_stiffness(few, found.nominal)
        ends = each(partial(_all_the_way_down, few, base, seat), laws)
        rough = [(law, u) for law, us in zip(laws, ends, strict=True) for u in us]
        starts += [Start(law, u, problem.unit(law, u)) for law, u in rough]
        starts += [begin(law, u, found.nominal) for law, u in rough]
    return _along_with(race(problem, starts, BENT, None)[:1] if starts else [], bend_best(problem, found))


def bend_best(problem: Problem, found: Search) -> Search:
    """The search, and its best effect bent, fitted without an added error: a slight bend would hide behind one."""
    starts = _bent(found.best)
    return _along_with(race(problem, starts, CLOSE, None)[:1] if starts else [], found)


def _bent(fit: Fit) -> list[Start]:
    """Starts of an effect with its law bent, where that can be."""
    return [Start(fit.hypothesis.bent, u, fit.nu) for u in fit.hypothesis.bent_from(fit.u)]


def _along_with(fits: Sequence[Fit], found: Search) -> Search:
    """The search and these fits, the best of every candidate."""
    best = best_first([*found.fits, *fits])
    return replace(found, fits=tuple(first_of_each(best, lambda fit: fit.hypothesis)))


def _all_the_way_down(
    few: Problem, base: FloatArray, seat: MeasuredStiffness | None, hypothesis: Hypothesis
) -> list[FloatArray]:
    """Where a candidate's best rough descents end; of a law of the bearings, those to what a run says of it."""
    if seat and hypothesis.terms[0].effect.location == "bearings":
        return law_starts(few, seat, hypothesis, K_B.value(base[0]))
    first = _down(few, base, hypothesis)[: FAR_SEARCH.carried]
    return [few.rough(hypothesis, x, FAR_SEARCH.long_way)[0] for x, _ in first]


def _rough_starts(
    problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit, progress: Progress | None
) -> tuple[list[Start], tuple[Start, ...]]:
    """Starts of the candidates whose rough cost is near the best one's, and the best of every effect by that alone."""
    few = problem.thinned(FAR_SEARCH.every)
    base = nominal.u[:1]
    if problem.with_k_b:
        base, _ = few.rough(NOMINAL, base, FAR_SEARCH.first_steps + FAR_SEARCH.further_steps)
    found = _descents(few, hypotheses, base, progress)
    lowest = min((_cost(own) for own in found.values()), default=0.0)
    limit = FAR_SEARCH.worth_factor * lowest + FAR_SEARCH.worth
    starts, best = [], {}
    for place, h in enumerate(sorted(hypotheses, key=lambda h: _cost(found[h]))):
        own = [Start(h, u, problem.unit(h, u)) for u, _ in found[h][: _of(h, RACE.rivals)]]
        if place < RACE.at_least or _cost(found[h]) < limit:
            starts += own
        best.setdefault(h.ids, own[0])
    return starts + _beside_nominal(problem, hypotheses, nominal), tuple(best.values())


def _beside_nominal(problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit) -> list[Start]:
    """Starts next to the nominal model of the candidates that gain most there: its nuisances may be right already."""
    score = Score(problem, nominal)
    found = sorted((promises(score, h)[0] for h in hypotheses), key=lambda promise: promise.gain, reverse=True)
    return [promise.start for promise in found[: RACE.at_least] if promise.gain > 0]


def _starts_on_grids(problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit) -> list[Start]:
    """Starts that only grids of their own find."""
    few, there = problem.thinned(FAR_SEARCH.every), problem.at_fit(nominal)
    starts: list[Start] = []
    for h in hypotheses:
        starts += [promise.start for promise in strategy_of(h).scan(there, h, nominal, quiet=False)]
        starts += strategy_of(h).grid_starts(few, h, nominal, FAR[0].added)
    return starts


def _cost(found: list[tuple[FloatArray, float]]) -> float:
    """Of the best descent."""
    return found[0][1] if found else np.inf


def _descents(
    few: Problem, hypotheses: Sequence[Hypothesis], base: FloatArray, progress: Progress | None
) -> dict[Hypothesis, list[tuple[FloatArray, float]]]:
    """Rough descents of all candidates, the best ones carried on; coordinates and cost, best first."""
    made = {}
    for number, found in enumerate(each(partial(_down, few, base), hypotheses)):
        if progress:
            progress(number, 2 * len(hypotheses), str(hypotheses[number]))
        made[hypotheses[number]] = found
    limit = FAR_SEARCH.dropped * min((found[0][1] for found in made.values()), default=0.0)
    near = [(hypothesis, found) for hypothesis, found in made.items() if found[0][1] <= limit]
    made |= zip([hypothesis for hypothesis, _ in near], each(partial(_further_down, few), near), strict=True)
    return made


def _down(few: Problem, base: FloatArray, hypothesis: Hypothesis) -> list[tuple[FloatArray, float]]:
    """Short descents from the lowest points of a candidate."""
    points = _best([few.rough(hypothesis, x, 0) for x in strategy_of(hypothesis).points(base, hypothesis)])
    return _best(
        [few.rough(hypothesis, x, FAR_SEARCH.first_steps) for x, _ in points[: _of(hypothesis, FAR_SEARCH.tried)]]
    )


def _of(hypothesis: Hypothesis, number: int) -> int:
    """So many points, of an effect anywhere along the shaft as many times more as there are minima along it."""
    return number * (FAR_SEARCH.along_shaft if any(free.along_shaft for free in hypothesis.free) else 1)


def _further_down(
    few: Problem, found: tuple[Hypothesis, list[tuple[FloatArray, float]]]
) -> list[tuple[FloatArray, float]]:
    """The best of a candidate's descents carried on."""
    hypothesis, first = found
    return _best(
        [few.rough(hypothesis, x, FAR_SEARCH.further_steps) for x, _ in first[: _of(hypothesis, FAR_SEARCH.carried)]]
    )


def _best(found: list[tuple[FloatArray, float]]) -> list[tuple[FloatArray, float]]:
    """By cost."""
    return sorted(found, key=itemgetter(1))


def nothing_shows(problem: Problem, nominal: Fit) -> bool:
    """Whether the nominal model leaves no more than noise, also where each resonance of each run is set free."""
    if nominal.chi2 > chi2.isf(NEAR_SEARCH.chance, nominal.n_data):
        return False
    score = Score(problem, nominal, settled=True)
    apart = (score.apart(range(len(problem.runs)), shapes=shapes) for shapes in (False, True))
    return all(gain <= chi2.isf(NEAR_SEARCH.chance, numbers) for gain, numbers in apart if numbers)


def weak_starts(
    problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit, progress: Progress | None = None
) -> list[Start]:
    """Starts next to the nominal model of the candidates that could explain most to first order."""
    score = Score(problem, nominal)
    quiet = nothing_shows(problem, nominal)
    found: list[tuple[float, list[Start]]] = []
    for number, hypothesis in enumerate(hypotheses):
        if progress:
            progress(number, 2 * len(hypotheses), str(hypothesis))
        strategy = strategy_of(hypothesis)
        scanned = strategy.scan(problem, hypothesis, nominal, quiet)
        tried = scanned or (Strategy() if quiet else strategy).promise(problem, score, hypothesis)
        if tried:  # else the time is up
            found.append((tried[0].gain, [promise.start for promise in tried[: RACE.rivals]]))
    found.sort(key=lambda entry: entry[0], reverse=True)
    first = NEAR_SEARCH.reported if quiet else RACE.at_least
    limit = NEAR_SEARCH.telling if quiet else worth_from(found[0][0]) if found else 0.0
    return [
        start
        for place, (gain, starts) in enumerate(found)
        for start in starts
        if place < first or gain >= limit or (several(start.hypothesis) and not quiet)
    ]
