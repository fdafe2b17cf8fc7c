"""Candidates by probability, the nominal model among them, and the verdict that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax

from rigtwin.gap.document import Verdict
from rigtwin.gap.inference.evidence import sample
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import PRIORS
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import acting
from rigtwin.gap.search.nominal import fit_lines_alike
from rigtwin.gap.search.race import first_of_each
from rigtwin.gap.verdict.adequacy import judge
from rigtwin.gap.verdict.standing import Standing, excess_of, noise_scale, scale_of, standing_of
from rigtwin.gap.verdict.thresholds import THRESHOLDS


@dataclass(frozen=True)
class Sampling:
    """Which candidates have their evidence sampled."""

    least_probability: float = 5e-3  # a quarter of what an answered set may leave out
    most: int = 4  # of the most probable ones


SAMPLING = Sampling()

Places = list[tuple[Fit, float]]  # fits of the same effects with their probabilities, best first


@dataclass(frozen=True)
class Ranked:
    """All candidates with their probabilities, the nominal model among them."""

    fits: tuple[Fit, ...]
    probabilities: tuple[float, ...]
    no_gap: float


@dataclass(frozen=True)
class Decision:
    """The verdict, and what it follows from."""

    ranked: Ranked
    standing: Standing
    verdict: Verdict


def decide(problem: Problem, nominal: Fit, fits: Sequence[Fit], enough: bool) -> Decision:
    """The verdict on the fits of a problem, best first; ``enough``: whether there are data to conclude from."""
    standing = standing_of(problem, nominal, fits)
    ranked = rank(problem, nominal, standing)
    standing = _of_the_likeliest(problem, nominal, ranked, standing)
    if standing.other_form and all(acting(best_of(ranked).effects, run.support) for run in problem.runs):
        ranked = _by_lines_alike(problem, ranked, standing)
    return Decision(ranked, standing, _verdict_of(ranked, standing) if enough else "not_enough_data")


def rank(problem: Problem, nominal: Fit, standing: Standing) -> Ranked:
    """Probabilities by evidence, which is sampled where it matters."""
    scale, fits = scale_of(standing.quality), [fit for fit in standing.fits if fit.hypothesis.terms]
    fits = first_of_each(fits, lambda fit: fit.hypothesis.places)
    ranked = _by_evidence(nominal, fits, scale)
    matters = [p >= SAMPLING.least_probability and k < SAMPLING.most for k, p in enumerate(ranked.probabilities)]
    fits = [
        replace(fit, sampled=sample(problem, fit, scale)) if one else fit
        for fit, one in zip(ranked.fits, matters, strict=True)
    ]
    return _by_evidence(nominal, fits, scale)


def _by_evidence(nominal: Fit, fits: Sequence[Fit], scale: float) -> Ranked:
    """Candidates by probability; the nominal model has its own prior."""
    single = [fit.log_evidence(scale) + np.log(fit.hypothesis.prior * (1 - PRIORS.no_gap)) for fit in fits]
    every = np.array([*single, nominal.log_evidence(scale) + np.log(PRIORS.no_gap)])
    share = softmax(every)
    order = np.argsort(-share[:-1], kind="stable")
    return Ranked(tuple(fits[k] for k in order), tuple(float(share[k]) for k in order), float(share[-1]))


def _of_the_likeliest(problem: Problem, nominal: Fit, ranked: Ranked, standing: Standing) -> Standing:
    """The same, but where no gap is the most probable, the nominal model has to leave as little as the best fit."""
    if ranked.no_gap <= THRESHOLDS.likeliest:
        return standing
    return replace(standing, excess=max(standing.excess, excess_of(problem, nominal, judge(problem, nominal))))


def _by_lines_alike(problem: Problem, ranked: Ranked, standing: Standing) -> Ranked:
    """The same with the numbers of the best by all lines alike; its misfit stays the one that it is ranked by.

    A law of another form would follow the few lines with the smallest errors. Where it does not act in some run, that
    run holds tolerances and sensors, and the numbers stay.
    """
    best = best_of(ranked)
    alike = fit_lines_alike(problem, best, noise_scale(problem, standing.quality))
    ranked_by = ("chi2", "penalty", "log_prior", "sampled", "harmonics")
    said = replace(alike, **{name: getattr(best, name) for name in ranked_by})
    return replace(ranked, fits=tuple(said if fit is best else fit for fit in ranked.fits))


def _verdict_of(ranked: Ranked, standing: Standing) -> Verdict:
    if standing.excess >= 1:
        return "unknown"
    if ranked.no_gap > THRESHOLDS.likeliest:
        return "no_gap"
    return "cause" if max(map(together, by_name(ranked).values())) >= THRESHOLDS.sure else "ambiguous"


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
    return places[: min(int(np.searchsorted(reached, THRESHOLDS.answered)) + 1, THRESHOLDS.at_most)]
