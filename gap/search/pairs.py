"""Pairs of linear effects: which second one could explain what a first leaves, and where both fit best."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import itemgetter

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import PRIORS, Hypothesis, Term
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.search.linear import search
from rigtwin.gap.search.race import (
    CLOSE,
    FAR,
    Progress,
    Search,
    best_first,
    first_of_each,
    fitted,
    in_turns,
    polish_all,
    race,
)
from rigtwin.gap.search.starts import Promise, Start, begin, promises, worth_from
from rigtwin.gap.search.strategies.registry import strategy_of
from rigtwin.shared_work import each


@dataclass(frozen=True)
class PairSearch:
    """Which pairs are raced."""

    leaders: int = 3  # effects that others are tried beside: the best of all runs,
    rough_leaders: int = 2  # the best by rough fits,
    rigid_leaders: int = 2  # and the best of the rigid runs alone
    roughly: float = 0.3  # relative error that is added for those
    no_leader: float = 30.0  # cost over the best one's from which none of the others is a leader
    by_score: int = 24  # pairs that gain most to first order, shared by the leaders,
    of_each: int = 6  # each of which has at least so many
    starts: int = 1  # starts of each pair, the lowest, that are taken a step down;
    by_rough: int = 16  # the lowest of these
    steps: int = 5  # are carried on so far
    every: int = 5  # lines that rough descents see


PAIRS = PairSearch()


def most_left(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis]) -> float:
    """Misfit that one more effect could take away beside a fit, to first order: the most of all candidates."""
    score = Score(problem, fit, settled=True)
    others = [h for h in hypotheses if h.ids[0] not in fit.hypothesis.ids]
    return max((promises(score, h)[0].gain for h in others), default=0.0)


def pursued(
    problem: Problem, leaders: Sequence[Fit], hypotheses: Sequence[Hypothesis], progress: Progress | None = None
) -> list[Fit]:
    """Leaders, each with one more effect that its score promises; best first by evidence and prior.

    At a leader's own minimum, with the tolerances as they act there, the score tells nearly what a fit would gain.
    """
    found: list[Fit] = []
    for leader in polish_all(problem, leaders):
        there = problem.around(leader)
        promised = promised_beside(Score(there, leader, settled=True), hypotheses)
        limit = worth_from(promised[0].gain) if promised else 0.0
        starts = _some([promise for promise in promised if promise.gain >= limit], len(leaders))
        found += race(there, starts, FAR, progress)
    return best_first(found)


def pairs(
    problem: Problem, found: Search, hypotheses: Sequence[Hypothesis], progress: Progress | None = None
) -> list[Fit]:
    """Pairs of effects that do not fall behind, best first by evidence and prior."""
    leaders = _leaders(problem, found, hypotheses)
    return race(problem, pair_starts(problem, leaders, hypotheses, not found.rough, progress), FAR, progress)


def exchanged(
    problem: Problem, pair: Fit, hypotheses: Sequence[Hypothesis], near: bool, progress: Progress | None = None
) -> list[Fit]:
    """Pairs of either effect of a pair, with the numbers it has there, and another; best first by evidence and prior.

    Alone, an effect takes over what another one does: from there its partner may lie too far for a start of its own.
    """
    leaders = [fit for start in one_fewer(pair, hypotheses) if (fit := _as_it_is(problem, start))]
    return race(problem, pair_starts(problem, leaders, hypotheses, near, progress), FAR, progress)


def without_one(problem: Problem, several: Fit, hypotheses: Sequence[Hypothesis]) -> list[Fit]:
    """Several effects without each of them, from where they ended; best first by evidence and prior.

    The starts of fewer may have missed that place, and what was found first may not be needed beside the later ones.
    """
    there = problem.around(several)
    return best_first(fit for start in one_fewer(several, hypotheses) if (fit := fitted(there, CLOSE[0], start)))


def straightened(problem: Problem, pair: Fit) -> list[Fit]:
    """A pair with plain laws, where one is bent, from where it ended: beside a second effect that may not be needed."""
    plain, u = pair.hypothesis.straightened(pair.u)
    made = None if plain == pair.hypothesis else fitted(problem, CLOSE[0], Start(plain, u, pair.nu))
    return [made] if made else []


def one_fewer(several: Fit, hypotheses: Sequence[Hypothesis]) -> list[Start]:
    """Several effects without each of them, where they ended; the last one first."""
    numbers = several.hypothesis.split(several.u[1:])
    singles = [_single(term, hypotheses) for term in several.hypothesis.terms]
    found = []
    for left_out in reversed(range(len(singles))):
        kept = [k for k in range(len(singles)) if k != left_out]
        hypothesis = reduce(paired, [singles[k] for k in kept])
        found.append(Start(hypothesis, np.concatenate([several.u[:1], *(numbers[k] for k in kept)]), several.nu))
    return found


def _single(term: Term, hypotheses: Sequence[Hypothesis]) -> Hypothesis:
    """The candidate of one effect alone, its law bent or not as it is in the term."""
    alone = next(hypothesis for hypothesis in hypotheses if hypothesis.bent.terms == (term.bent,))
    return replace(alone, terms=(term,))


def _as_it_is(problem: Problem, start: Start) -> Fit | None:
    """A start as a fit without a step; None where there is no model."""
    return problem.try_fit(start.hypothesis, start.u, start.nu, anneal=(PAIRS.roughly,), steps=0)


def pair_starts(
    problem: Problem,
    leaders: Sequence[Fit],
    hypotheses: Sequence[Hypothesis],
    near: bool,
    progress: Progress | None = None,
) -> list[Start]:
    """Every candidate beside each of the leaders, from the leader's fit; those of most gain first, leader by leader.

    Parameters
    ----------
    near : whether the nominal model is close to the data
    """
    starts: list[Start] = []
    beside: list[Start] = []
    for number, leader in enumerate(leaders):
        if progress:
            progress(number, len(leaders), f"beside {leader.hypothesis}")
        starts += _some(promised_beside(Score(problem, leader, settled=near), hypotheses), len(leaders))
        for second in _others(leader, hypotheses) if not near else ():
            pair = paired(leader.hypothesis, second)
            points = strategy_of(second).points(leader.u, second)
            beside += [begin(pair, pair.clipped(point), leader) for point in points]
    return starts + _down_a_step(problem.thinned(PAIRS.every), beside)


def _others(leader: Fit, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Candidates of effects that a leader does not have."""
    return [second for second in hypotheses if second.ids[0] not in leader.hypothesis.ids]


def promised_beside(score: Score, hypotheses: Sequence[Hypothesis]) -> list[Promise]:
    """What second effects promise beside a fit, whose score it is; most first."""
    found = each(partial(_beside, score), _others(score.fit, hypotheses))
    return sorted((promise for own in found for promise in own), key=lambda promise: promise.gain, reverse=True)


def _some(promised: Sequence[Promise], leaders: int) -> list[Start]:
    """The starts that one of so many leaders has, effects in turns."""
    count = max(PAIRS.by_score // leaders, PAIRS.of_each)
    return [promise.start for promise in in_turns(promised, lambda promise: promise.start.hypothesis.ids)[:count]]


def _down_a_step(few: Problem, starts: Sequence[Start]) -> list[Start]:
    """The best starts of pairs by rough descents.

    A start tells little of where it leads to: of each pair some are taken a step down before.
    """
    tried = sorted(each(partial(_down_from, few, 0), starts), key=itemgetter(1))
    some = [start for start, _ in first_of_each(tried, lambda found: found[0].hypothesis, PAIRS.starts)]
    stepped = sorted(each(partial(_down_from, few, 1), some), key=itemgetter(1))
    best = [start for start, _ in in_turns(stepped, lambda found: found[0].hypothesis.ids)[: PAIRS.by_rough]]
    return [start for start, _ in each(partial(_down_from, few, PAIRS.steps), best)]


def paired(first: Hypothesis, second: Hypothesis) -> Hypothesis:
    """All effects at once: each further one has the odds of a pair against it."""
    k, odds = len(first.terms), PRIORS.pair_log_odds
    mean = (k * (np.log(first.prior) + odds * (k - 1)) + np.log(second.prior)) / (k + 1)
    return Hypothesis((*first.terms, *second.terms), float(np.exp(mean - odds * k)))


def _beside(score: Score, second: Hypothesis) -> list[Promise]:
    """What a second effect promises beside a leader, whose score it is."""
    return promises(score, second, paired(score.fit.hypothesis, second))


def _down_from(few: Problem, steps: int, start: Start) -> tuple[Start, float]:
    """A start after so many steps of a rough descent, and its rough cost."""
    u, cost = few.rough(start.hypothesis, start.u, steps)
    return replace(start, u=u), cost


def _leaders(problem: Problem, found: Search, hypotheses: Sequence[Hypothesis]) -> list[Fit]:
    """Effects that others are tried beside: the best of all runs, and of a part of what there is to see.

    The latter, unless an effect leads, are the best by rough fits, which far misfits do not rule, and the best of the
    rigid runs, in which fewer effects can act. What leaves many times as much as the best is no leader, but for those
    by rough fits.
    """
    leaders = best_effects(problem, found)
    there = {fit.hypothesis.ids for fit in leaders}
    if found.leads:
        return leaders
    rough = [start for start in found.rough[: PAIRS.rough_leaders] if start.hypothesis.ids not in there]
    roughly = [problem.try_fit(s.hypothesis, s.u, s.nu, anneal=(PAIRS.roughly,), steps=2) for s in rough]
    rigid = problem.only("rigid")
    if rigid is not None and problem.with_k_b:
        acting = [h for h in hypotheses if h.terms[0].effect.location != "bearings"]
        for fit in _of_each_effect(search(rigid, acting).fits)[: PAIRS.rigid_leaders]:
            u = np.concatenate([found.nominal.u[:1], fit.u[1:]])
            made = problem.try_fit(fit.hypothesis, u, found.nominal.nu, anneal=(0.1, 0.0), steps=6)
            leaders += [made] if made else []
    return [*_not_behind(problem, leaders), *(fit for fit in roughly if fit)]


def best_effects(problem: Problem, found: Search) -> list[Fit]:
    """The best effects of a search that others may stand beside."""
    return _not_behind(problem, _of_each_effect(found.fits)[: PAIRS.leaders])


def _not_behind(problem: Problem, leaders: Sequence[Fit]) -> list[Fit]:
    """Leaders that do not leave many times as much as the best one."""
    costs = [problem.cost(fit.hypothesis, fit.u, fit.nu) for fit in leaders]
    return [fit for fit, cost in zip(leaders, costs, strict=True) if cost <= PAIRS.no_leader * min(costs)]


def _of_each_effect(fits: Iterable[Fit]) -> list[Fit]:
    """The best fit of every effect."""
    return first_of_each(fits, lambda fit: fit.hypothesis.ids[0])
