"""How far the best fit is to be believed: does it leave noise alone, and what would still take something away?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.forward import nonlinear
from rigtwin.gap.search.nominal import strain_towards
from rigtwin.gap.verdict.adequacy import Adequacy, judge
from rigtwin.gap.verdict.thresholds import THRESHOLDS


@dataclass(frozen=True)
class Standing:
    """The fits that count, best first, and how far the first one is to be believed."""

    fits: Sequence[Fit]
    quality: Adequacy  # of the first
    excess: float  # of what it leaves: 1 at the threshold
    other_form: bool = False  # whether it is believed for leaving a small share of what anything else leaves


def standing_of(problem: Problem, nominal: Fit, fits: Sequence[Fit]) -> Standing:
    """How far the best fit is to be believed.

    An effect whose law or shape is not quite the library's leaves more than noise, and yet a small share of what
    anything else leaves. It is believed then, unless one of its numbers would leave its range, and pairs that patch
    it up are no answer.
    """
    quality = judge(problem, fits[0])
    excess = excess_of(problem, fits[0], quality)
    if excess < 1:
        return Standing(fits, quality, max(excess, _passed_over(problem, nominal, fits[0], quality)))
    singles = [fit for fit in fits if len(fit.hypothesis.terms) == 1]
    if not singles or singles[0].wants_more:
        return Standing(fits, quality, excess)
    beside = _beside_rivals(problem, nominal, singles)
    if beside < 1:
        return Standing(singles, judge(problem, singles[0]), beside, other_form=True)
    return Standing(fits, quality, min(excess, beside))


def adequate(problem: Problem, fit: Fit) -> bool:
    return excess_of(problem, fit, judge(problem, fit)) < 1


def excess_of(problem: Problem, fit: Fit, quality: Adequacy) -> float:
    """How far a fit is from leaving nothing but noise: 1 at the threshold of adequacy."""
    if nonlinear(fit.effects):
        return fit.chi2 / fit.n_data / noise_scale(problem, quality) ** 2 / THRESHOLDS.adequate_nonlinear
    return max(
        (quality.misfit - 1) / max(THRESHOLDS.adequate_misfit - 1, THRESHOLDS.adequate_spread * quality.spread),
        quality.correlation / THRESHOLDS.adequate_correlation,
        strain(problem, fit),
        0.0,
    )


def scale_of(quality: Adequacy) -> float:
    """True over believed error, where the data's own scatter contradicts the given errors."""
    believed = THRESHOLDS.believed_scale_low <= quality.scale <= THRESHOLDS.believed_scale_high
    return 1.0 if believed else quality.scale


def noise_scale(problem: Problem, quality: Adequacy) -> float:
    """``scale_of``, as far as it may be noise: a law that misses lines scatters as well."""
    told = [o.scatter for o in problem.observed if np.isfinite(o.scatter)] or [THRESHOLDS.most_scale]
    return min(scale_of(quality), max(float(np.median(told)), 1.0), THRESHOLDS.most_scale)


def strain(problem: Problem, fit: Fit) -> float:
    """Sum of squares of the nuisances in units of their priors, over those that the data determine: 1 at the threshold.

    By the priors it is chi-squared with as many degrees of freedom as nuisances are determined.
    """
    covariance = fit.covariance()[len(fit.u) :, len(fit.u) :]
    prior = fit.prior_std**2
    told = np.clip(1 - covariance.diagonal() / prior, 0.0, 1.0)
    told[problem.nuisances.gain] = [
        0.0 if run.quantity == "acceleration" else t
        for run, t in zip(problem.runs, told[problem.nuisances.gain], strict=True)
    ]
    freedom = max(float(told.sum()), 1.0)
    return float(np.sum(told * fit.nu**2 / prior)) / float(chi2.isf(THRESHOLDS.strained_chance, freedom))


def _passed_over(problem: Problem, nominal: Fit, fit: Fit, quality: Adequacy) -> float:
    """What resonances and shapes of each run's own would still take away beside a linear cause: 1 at the threshold.

    Whatever acts on a linear rotor shows in these, also where no effect of the library resembles it. It counts where it
    is more than noise gives them, and more than a small share of what the cause takes away.
    """
    if nonlinear(fit.effects):
        return 0.0
    score, runs = Score(problem, fit, settled=True), range(len(problem.runs))
    scale2, explained = max(quality.scale, 1.0) ** 2, max(nominal.cost - fit.cost, 1.0)
    excesses = [0.0]
    for shapes in (False, True):
        gain, n = score.apart(runs, shapes=shapes)
        if n:
            chance = (gain / scale2 - n) / float(chi2.isf(THRESHOLDS.passed_over_chance, n) - n)
            excesses.append(min(chance, (gain - n * scale2) / explained / THRESHOLDS.passed_over_share))
    return max(excesses)


def _beside_rivals(problem: Problem, nominal: Fit, singles: Sequence[Fit]) -> float:
    """What the best effect leaves over what the best other one leaves, or none at all: 1 at the threshold."""
    best = singles[0]
    rivals = [nominal, *(fit for fit in singles if fit.hypothesis.ids != best.hypothesis.ids)]
    if nonlinear(best.effects):
        return _left(best) / min(map(_left, rivals)) / THRESHOLDS.form_left_nonlinear
    return _left(best) / min(map(_left, [*rivals, strain_towards(problem, best)])) / THRESHOLDS.form_left


def _left(fit: Fit) -> float:
    """Misfit beyond the noise's, and strain of the nuisances, per value."""
    return (max(fit.chi2 - fit.n_data, 0.0) + fit.penalty) / fit.n_data
