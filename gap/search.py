"""From runs to ranked candidates: recalibrate the nominal model, start every candidate roughly, fit the best ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gap.hypotheses import K_B_RANGE, NOMINAL, Hypothesis, Term
from gap.likelihood import Fit, Problem
from gap.nonlinear import MODEL_ERROR
from rotor.structure import FloatArray

Progress = Callable[[int, int, str], None]

# Starting values of the bearing stiffness along its range.
_K_B_STARTS = 10

# A rough cost within this factor (and this much) of the best one is worth a fine fit, and at least so many are.
_WORTH_FACTOR, _WORTH, _AT_LEAST = 3.0, 0.02, 12

# Of several starts of one candidate, those whose rough cost is within this factor of its best are all fitted.
_RIVAL = 1.3
_RIVALS = 2

# A misfit by so much above the best one's cannot be made good by anything else.
_HOPELESS = 400.0

# Positions along the shaft from which a weak effect is started.
_POSITIONS = 7

# Below this mean square misfit of the nominal model every candidate is fitted from next to it, without rough starts.
_NEAR = 3.0

# ... provided that its nuisances are not far outside their priors: mean square, in their units.
_CALM = 3.0

# Candidates of an inadequate search from which pairs are formed.
_PAIR_LEADERS = 3


@dataclass(frozen=True)
class Search:
    """What a search led to."""

    nominal: Fit
    fits: tuple[Fit, ...]  # best first by evidence, the nominal model not among them


def recalibrate(problem: Problem) -> Fit:
    """The nominal model with the bearing stiffness that suits the runs best."""
    if not problem.with_k_b:
        return problem.fit(NOMINAL, np.array([np.log(1e7)]))
    starts = np.geomspace(*K_B_RANGE, _K_B_STARTS)
    rough = [problem.rough(NOMINAL, np.array([np.log(start)])) for start in starts]
    best = min(rough, key=lambda found: found[1])[0]
    return problem.fit(NOMINAL, best)


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
    base = nominal.u[:1]
    if problem.with_k_b:
        base = problem.rough(NOMINAL, base)[0]
    near = nominal.chi2 + nominal.penalty < _NEAR * nominal.n_data and nominal.penalty < _CALM * len(nominal.nu)
    total = 2 * len(hypotheses)
    rough: list[tuple[float, Hypothesis, list[FloatArray]]] = []
    for number, hypothesis in enumerate(hypotheses):
        if progress:
            progress(number, total, str(hypothesis))
        if near:
            rough.append((0.0, hypothesis, []))
            continue
        found = [problem.rough(hypothesis, np.concatenate([base, start])) for start in hypothesis.starts()]
        found.sort(key=lambda pair: pair[1])
        rivals = [x for x, cost in found[:_RIVALS] if cost <= _RIVAL * found[0][1] + 1e-9]
        rough.append((found[0][1], hypothesis, rivals))
    rough.sort(key=lambda entry: entry[0])
    limit = _WORTH_FACTOR * rough[0][0] + _WORTH if rough else 0.0
    worth = [entry for place, entry in enumerate(rough) if place < _AT_LEAST or entry[0] <= limit]
    fits: list[Fit] = []
    hopeless = np.inf
    for number, (_, hypothesis, starts) in enumerate(worth):
        if progress:
            progress(len(hypotheses) + number, len(hypotheses) + len(worth), str(hypothesis))
        every = [*starts, *_from_nominal(nominal, hypothesis)]
        best = fit_best(problem, hypothesis, every, nominal, hopeless)
        if best is not None:
            fits.append(best)
            hopeless = min(hopeless, best.chi2 + best.penalty + _HOPELESS)
    fits.sort(key=lambda fit: fit.log_weight, reverse=True)
    return Search(nominal, tuple(fits))


def _from_nominal(nominal: Fit, hypothesis: Hypothesis) -> list[FloatArray]:
    """A start next to the nominal model: each number at the end of its range that changes less, where there is one."""
    if len(hypothesis.terms) != 1:
        return []
    term = hypothesis.terms[0]
    parameters = term.effect.parameters()
    if any(free.name == "position" for free in term.free):
        return [np.concatenate([nominal.u[:1], point]) for point in _along_the_shaft(term)]
    point = []
    for free in term.free:
        low, high = free.ends
        null = parameters[free.name].null if free.name in parameters else None
        if isinstance(null, (int, float)) and np.isfinite(null) and not free.log:
            point.append(float(np.clip(null + 0.02 * (high - low), low, high)))
        elif isinstance(null, (int, float)) and np.isinf(null):
            point.append(high - 0.02 * (high - low))
        elif isinstance(null, (int, float)):
            point.append(low + 0.02 * (high - low))
        else:
            point.append((low + high) / 2)
    return [np.concatenate([nominal.u[:1], point])]


def _along_the_shaft(term: Term) -> list[FloatArray]:
    """Weak starts at several positions."""
    shares = (np.arange(_POSITIONS) + 0.5) / _POSITIONS
    ends = [free.ends for free in term.free]
    at = [free.name == "position" for free in term.free]
    return [
        np.array([low + (share if here else 0.05) * (high - low) for (low, high), here in zip(ends, at, strict=True)])
        for share in shares
    ]


def fit_best(
    problem: Problem, hypothesis: Hypothesis, starts: Sequence[FloatArray], nominal: Fit, hopeless: float = np.inf
) -> Fit | None:
    """The best of several fits; None where no start has a model."""
    best: Fit | None = None
    for number, start in enumerate(starts):
        nu = np.clip(nominal.nu, -2 * nominal.prior_std, 2 * nominal.prior_std)
        try:
            fit = problem.fit(hypothesis, start, nu, hopeless=hopeless)
        except (ValueError, np.linalg.LinAlgError):
            continue
        if best is None or fit.chi2 + fit.penalty < best.chi2 + best.penalty:
            best = fit
        settled = "position" not in {free.name for free in hypothesis.free}
        if settled and number + 1 < len(starts) and best.chi2 + best.penalty < 1.3 * best.n_data:
            break
    return best


def pairs(
    problem: Problem, found: Search, hypotheses: Sequence[Hypothesis], progress: Progress | None = None
) -> list[Fit]:
    """Pairs of effects: every candidate beside each of the leaders, started from the leader's fit."""
    leaders = _leaders(found.fits)
    fits: list[Fit] = []
    jobs = [(leader, h) for leader in leaders for h in hypotheses if h.ids != leader.hypothesis.ids]
    rough = []
    for number, (leader, second) in enumerate(jobs):
        if progress:
            progress(number, len(jobs), f"{leader.hypothesis} + {second}")
        pair = Hypothesis((*leader.hypothesis.terms, *second.terms), leader.hypothesis.prior * second.prior)
        starts = [np.concatenate([leader.u, start[1:]]) for start in _from_nominal(leader, second)]
        starts += [np.concatenate([leader.u, start]) for start in second.starts()[:: max(len(second.starts()) // 2, 1)]]
        tried = [problem.rough(pair, start, steps=5, every=5) for start in starts]
        x, cost = min(tried, key=lambda each: each[1])
        rough.append((cost, pair, x))
    rough.sort(key=lambda entry: entry[0])
    hopeless = np.inf
    for _, pair, x in rough[: 2 * _AT_LEAST]:
        best = fit_best(problem, pair, [x], found.nominal, hopeless)
        if best is not None:
            fits.append(best)
            hopeless = min(hopeless, best.chi2 + best.penalty + _HOPELESS)
    fits.sort(key=lambda fit: fit.log_weight, reverse=True)
    return fits


def _leaders(fits: Sequence[Fit]) -> list[Fit]:
    """The best fit of each of the best few effects."""
    seen: dict[str, Fit] = {}
    for fit in fits:
        seen.setdefault(fit.hypothesis.ids[0], fit)
    return list(seen.values())[:_PAIR_LEADERS]


def polished(problem: Problem, fit: Fit) -> Fit:
    """The same candidate, fitted on from where it is."""
    return problem.fit(fit.hypothesis, fit.u, fit.nu, anneal=(0.0,), steps=30)


# Lines of a nonlinear search: every so many, roughly and finely.
_ROUGH_LINES, _FINE_LINES = 8, 4
_NONLINEAR_FITS = 4


def search_nonlinear(
    problem: Problem, hypotheses: Sequence[Hypothesis], nominal: Fit, progress: Progress | None = None
) -> tuple[Problem, Search]:
    """Fit the nonlinear candidates on a part of the lines.

    Returns
    -------
    the problem on those lines, and the search on it
    """
    few, some = problem.thinned(_ROUGH_LINES, MODEL_ERROR), problem.thinned(_FINE_LINES, MODEL_ERROR)
    rough = []
    for number, hypothesis in enumerate(hypotheses):
        if progress:
            progress(number, len(hypotheses) + _NONLINEAR_FITS, str(hypothesis))
        found = []
        starts = hypothesis.starts()
        for start in starts if hypothesis.ids != ("rub",) else starts[1:2]:
            u = np.concatenate([nominal.u[:1], start])
            found.append(few.rough(hypothesis, u, steps=4, every=1))
        found.sort(key=lambda pair: pair[1])
        rough.append((found[0][1], hypothesis, found[0][0]))
    rough.sort(key=lambda entry: entry[0])
    base = some.fit(NOMINAL, nominal.u[:1], nominal.nu)
    fits = []
    for number, (_, hypothesis, u) in enumerate(rough[:_NONLINEAR_FITS]):
        if progress:
            progress(len(hypotheses) + number, len(hypotheses) + _NONLINEAR_FITS, str(hypothesis))
        try:
            fits.append(some.fit(hypothesis, u, anneal=(0.1, 0.0), steps=6))
        except (ValueError, np.linalg.LinAlgError):
            continue
    fits.sort(key=lambda fit: fit.log_weight, reverse=True)
    return some, Search(base, tuple(fits))
