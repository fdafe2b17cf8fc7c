"""Evidence by importance sampling, which corrects Laplace's approximation and says how far it can be believed.

Numbers and nuisances are drawn from the normal distribution that Laplace's approximation stands for; each draw counts
by its posterior density over that of this distribution [mackay2003]. Draws outside a number's range count for
nothing. The mean weight is the evidence over Laplace's.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from rigtwin.gap.inference.fit import Fit, Sampled
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import nonlinear
from rigtwin.rotor.model.arrays import FloatArray

# Numbers of draws, tried in turn as long as too few count: most then lie outside the ranges, and cost nothing.
DRAWS = (64, 256, 1024)


def sample(problem: Problem, fit: Fit, scale: float = 1.0, draws: Sequence[int] = DRAWS) -> Sampled | None:
    """Sample the evidence of a fit; None where the effect is nonlinear, as a draw takes seconds, or no draw counts.

    Parameters
    ----------
    problem : that of the fit
    scale : true over believed standard error of the data
    draws : how many, one after another until enough of them count; the same ones for every fit of as many numbers
    """
    if nonlinear(fit.effects):
        return None
    problem = problem.around(fit)
    n_u, fixed = len(fit.u), 0 if fit.with_k_b else 1
    best = np.concatenate([fit.u, fit.nu])
    try:
        spread = np.linalg.cholesky(fit.covariance(scale)[fixed:, fixed:])
    except np.linalg.LinAlgError:  # numbers that the data do not tell apart at all
        return None
    z = np.random.default_rng(0).standard_normal((draws[-1], len(spread)))
    drawn = np.tile(best, (draws[-1], 1))
    drawn[:, fixed:] += z @ spread.T
    low, high = fit.hypothesis.ends[fixed:].T
    inside = ((drawn[:, fixed:n_u] >= low) & (drawn[:, fixed:n_u] <= high)).all(axis=1)

    def log_likelihood(x: FloatArray) -> float:
        penalty = float(np.sum((x[n_u:] / fit.prior_std) ** 2))
        chi2 = problem.misfit_of(fit.hypothesis, x[:n_u], x[n_u:])
        return -(chi2 / scale**2 + penalty) / 2

    log_weight, at_best, found = np.full(draws[-1], -np.inf), log_likelihood(best), None
    for before, count in itertools.pairwise((0, *draws)):
        for k in before + np.flatnonzero(inside[before:count]):
            log_weight[k] = log_likelihood(drawn[k]) - at_best + np.sum(z[k] ** 2) / 2
        found = _summarise(log_weight[:count])
        if found and found.trusted:
            break
    return found


def _summarise(log_weight: FloatArray) -> Sampled | None:
    """The mean weight of all draws, its error, and how many of them count; None where none does."""
    if not np.isfinite(log_weight).any():
        return None
    draws, total = len(log_weight), float(np.logaddexp.reduce(log_weight))
    ess = float(np.exp(2 * total - np.logaddexp.reduce(2 * log_weight)))
    return Sampled(total - float(np.log(draws)), float(np.sqrt(max(draws / ess - 1, 0.0) / draws)), ess)
