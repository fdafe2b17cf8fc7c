"""What the data leave open of a candidate's numbers and of the nuisances: normal distributions, mixed.

With given repeatabilities it is Laplace's normal distribution. A repeatability that was learned is itself known only
roughly: few resonances tell how far they drift. Its most probable size alone would make the other numbers seem better,
or worse, known than they are. So there is one normal distribution for each of its sizes, weighted by how probable the
runs make it. All of them follow from the curvature at the best fit, as the misfit is taken for quadratic there. With
precision A and nuisances nu there, and precisions P of their priors (P0 at the best fit), another P has

    A1 = A - P0 + P,  step d = A1^-1 (P0 - P) nu,
    -2 ln weight = nu^T P nu - d^T A1 d + ln det A1 - ln det P - 2 ln prior.

Where the data's errors are scaled, the best fit stays where it was found, as in Laplace's distribution.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.nuisances import PRIOR, Learned
from rigtwin.gap.inference.problem import Problem
from rigtwin.rotor.model.arrays import FloatArray

Weighed = tuple[float, FloatArray, FloatArray]  # logarithm of a weight, mean (n,) and covariance (n, n)

# Share of the most probable size's weight from which another size of a learned repeatability counts.
COUNTS = 0.01


@dataclass(frozen=True)
class Posterior:
    """Normal distributions of (u, nu), mixed."""

    weights: FloatArray  # (k,) that add up to one
    means: FloatArray  # (k, n)
    covariances: FloatArray  # (k, n, n)

    @property
    def std(self) -> FloatArray:
        """(n,) standard deviations of the whole."""
        within = self.weights @ self.covariances.diagonal(axis1=1, axis2=2)
        return np.sqrt(np.maximum(within + self.weights @ (self.means - self.weights @ self.means) ** 2, 0.0))

    def draws(self, rng: np.random.Generator, count: int) -> FloatArray:
        """(count, n) numbers drawn from it."""
        parts = zip(self.means, self.covariances, rng.multinomial(count, self.weights), strict=True)
        return np.concatenate([rng.multivariate_normal(m, C, size=k, method="eigh") for m, C, k in parts if k])


def posterior(problem: Problem, fit: Fit, scale: float = 1.0) -> Posterior:
    """What the data leave open of a fit's (u, nu).

    Parameters
    ----------
    problem : that of the fit
    scale : true over believed standard error of the data
    """
    learned = problem.nuisances.learned
    best, choices = [each.of(fit.prior_std) for each in learned], []
    for k, size in enumerate(best):  # one at a time first: what the runs tell well has few sizes
        sizes = size * np.exp(PRIOR.spread * np.linspace(-2, 2, 17))
        logs = np.array([with_sizes(fit, learned, [*best[:k], one, *best[k + 1 :]], scale)[0] for one in sizes])
        choices.append(sizes[logs > logs.max() + np.log(COUNTS)])
    found = [with_sizes(fit, learned, sizes, scale) for sizes in itertools.product(*choices)]
    logs, means, covariances = (np.array(parts) for parts in zip(*found, strict=True))
    return Posterior(softmax(logs), means, covariances)


def with_sizes(fit: Fit, learned: Sequence[Learned], sizes: Sequence[float], scale: float) -> Weighed:
    """Logarithm of the weight, mean and covariance where the repeatabilities have these sizes."""
    std, n_u, change = fit.prior_std.copy(), len(fit.u), np.zeros(len(fit.u) + len(fit.nu))
    for each, size in zip(learned, sizes, strict=True):
        std[each.places] = size
    change[n_u:] = (1 / fit.prior_std**2 - 1 / std**2) * fit.nu
    covariance = replace(fit, prior_std=std).covariance(scale)
    covariance = (covariance + covariance.T) / 2
    if not fit.with_k_b:
        covariance[0, :] = covariance[:, 0] = 0.0
    step, (_, logdet) = covariance @ change, np.linalg.slogdet(covariance[not fit.with_k_b :, not fit.with_k_b :])
    penalty = np.sum((fit.nu / std) ** 2 + 2 * np.log(std))
    prior = sum(each.log_prior(size) for each, size in zip(learned, sizes, strict=True))
    return prior + (change @ step + logdet - penalty) / 2, np.concatenate([fit.u, fit.nu]) + step, covariance
