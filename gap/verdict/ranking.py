"""Candidates by probability, the nominal model among them, and the verdict that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from rigtwin.gap.document import Verdict
from rigtwin.gap.inference.evidence import sample
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NO_GAP_PRIOR, SURE
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.linear import first_of_each
from rigtwin.gap.verdict.adequacy import judge
from rigtwin.gap.verdict.standing import Standing, excess_of, scale_of

# Thresholds. They are set on the tuning campaigns of the blind benchmark, never on its report campaigns.
ANSWERED = 0.98  # probability that the set of an ambiguous verdict holds
AT_MOST = 3  # effects in that set

_LIKELIEST = 0.5  # probability of no gap above which it is the answer

# Candidates of such a probability, of the most probable ones, have their evidence sampled.
_WORTH_SAMPLING, _SAMPLED = 1e-4, 4

Places = list[tuple[Fit, float]]  # fits of the same effects with their probabilities, best first


@dataclass(frozen=True)
class Ranked:
    """All candidates with their probabilities, the nominal model among them."""

    fits: tuple[Fit, ...]
    probabilities: tuple[float, ...]
    no_gap: float


def rank(problem: Problem, nominal: Fit, standing: Standing) -> Ranked:
    """Probabilities by evidence, which is sampled where it matters."""
    scale, fits = scale_of(standing.quality), [fit for fit in standing.fits if fit.hypothesis.terms]
    fits = first_of_each(fits, lambda fit: fit.hypothesis.places)
    ranked = _by_evidence(nominal, fits, scale)
    matters = [p >= _WORTH_SAMPLING and k < _SAMPLED for k, p in enumerate(ranked.probabilities)]
    fits = [
        replace(fit, sampled=sample(problem, fit, scale)) if one else fit
        for fit, one in zip(ranked.fits, matters, strict=True)
    ]
    return _by_evidence(nominal, fits, scale)


def _by_evidence(nominal: Fit, fits: Sequence[Fit], scale: float) -> Ranked:
    """Candidates by probability; the nominal model has its own prior."""
    single = [fit.log_evidence(scale) + np.log(fit.hypothesis.prior * (1 - NO_GAP_PRIOR)) for fit in fits]
    every = np.array([*single, nominal.log_evidence(scale) + np.log(NO_GAP_PRIOR)])
    share = np.exp(every - logsumexp(every))
    order = np.argsort(-share[:-1], kind="stable")
    return Ranked(tuple(fits[k] for k in order), tuple(float(share[k]) for k in order), float(share[-1]))


def of_the_likeliest(problem: Problem, nominal: Fit, ranked: Ranked, standing: Standing) -> Standing:
    """The same, but where no gap is the most probable, the nominal model has to leave as little as the best fit."""
    if ranked.no_gap <= _LIKELIEST:
        return standing
    return replace(standing, excess=max(standing.excess, excess_of(problem, nominal, judge(problem, nominal))))


def verdict_of(ranked: Ranked, standing: Standing) -> Verdict:
    if standing.excess >= 1:
        return "unknown"
    if ranked.no_gap > _LIKELIEST:
        return "no_gap"
    return "cause" if max(map(together, by_name(ranked).values())) >= SURE else "ambiguous"


def by_name(ranked: Ranked) -> dict[tuple[str, ...], Places]:
    """The places of each set of effects, the most probable set first."""
    groups: dict[tuple[str, ...], Places] = {}
    for fit, probability in zip(ranked.fits, ranked.probabilities, strict=True):
        groups.setdefault(name_of(fit.hypothesis.ids), []).append((fit, probability))
    return dict(sorted(groups.items(), key=lambda group: -together(group[1])))


def best_of(ranked: Ranked) -> Fit:
    """The most probable effects where they fit best."""
    return next(iter(by_name(ranked).values()))[0][0]


def name_of(effects: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted(effects))


def together(places: Places) -> float:
    """Probability of some effects, wherever they are."""
    return sum(probability for _, probability in places)


def likely(places: Places) -> Places:
    """The fewest places, of at most three, that hold nearly all of their probability."""
    reached = np.cumsum([probability for _, probability in places]) / max(together(places), 1e-300)
    return places[: min(int(np.searchsorted(reached, ANSWERED)) + 1, AT_MOST)]
