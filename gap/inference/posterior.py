"""What the data leave open of a candidate's numbers and of the nuisances: normal distributions, mixed.

With given repeatabilities it is Laplace's normal distribution. A repeatability that was learned is itself known only
roughly: few resonances tell how far they drift. Its most probable size alone would make the other numbers seem better,
or worse, known than they are. So there is one normal distribution for each of its sizes, weighted by how probable the
runs make it. All of them follow from the curvature at the best fit, as the misfit is taken for quadratic there. With
precision A and nuisances nu there, and precisions P of their priors (P0 at the best fit), another P has

    A1 = A - P0 + P,  step d = A1^-1 (P0 - P) nu,
    -2 ln weight = nu^T P nu - d^T A1 d + ln det A1 - ln det P - 2 ln prior.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.nuisances import Learned
from rigtwin.gap.inference.problem import Problem
from rigtwin.rotor.model.arrays import FloatArray

# Sizes of a learned repeatability that are tried: logarithms over the most probable one.
STEPS = np.linspace(-3.2, 3.2, 17)
# Share of the most probable size's weight from which another one counts.
COUNTS = 0.01


@dataclass(frozen=True)
class Normal:
    """One of the mixed distributions of (u, nu)."""

    weight: float
    mean: FloatArray  # (n,)
    covariance: FloatArray  # (n, n)


@dataclass(frozen=True)
class Posterior:
    """Normal distributions of (u, nu), whose weights add up to one."""

    parts: Sequence[Normal]

    @property
    def std(self) -> FloatArray:
        """(n,) standard deviations of the whole."""
        weights = np.array([part.weight for part in self.parts])
        means = np.array([part.mean for part in self.parts])
        within = weights @ np.array([part.covariance.diagonal() for part in self.parts])
        return np.sqrt(np.maximum(within, 0.0) + weights @ (means - weights @ means) ** 2)

    def draws(self, rng: np.random.Generator, count: int) -> FloatArray:
        """(count, n) numbers drawn from it."""
        chosen = rng.multinomial(count, [part.weight for part in self.parts])
        return np.concatenate(
            [
                rng.multivariate_normal(part.mean, part.covariance, size=k, method="eigh")
                for part, k in zip(self.parts, chosen, strict=True)
                if k
            ]
        )


def posterior(problem: Problem, fit: Fit, scale: float = 1.0) -> Posterior:
    """What the data leave open of a fit's (u, nu).

    Parameters
    ----------
    problem : that of the fit
    scale : true over believed standard error of the data
    """
    learned = problem.nuisances.learned
    best = [each.of(fit.prior_std) for each in learned]
    choices = []
    for k, size in enumerate(best):  # one at a time first: what the runs tell well has few sizes
        tried = [[*best[:k], other, *best[k + 1 :]] for other in size * np.exp(STEPS)]
        logs = np.array([with_sizes(fit, learned, sizes, scale)[0] for sizes in tried])
        choices.append([sizes[k] for sizes, log in zip(tried, logs, strict=True) if log > logs.max() + np.log(COUNTS)])
    found = [with_sizes(fit, learned, sizes, scale) for sizes in itertools.product(*choices)]
    logs = np.array([log for log, _ in found])
    weights = np.exp(logs - logs.max())
    return Posterior([replace(part, weight=w) for (_, part), w in zip(found, weights / weights.sum(), strict=True)])


def with_sizes(fit: Fit, learned: Sequence[Learned], sizes: Sequence[float], scale: float) -> tuple[float, Normal]:
    """Logarithm of the weight, and the distribution, where the repeatabilities have these sizes."""
    std = fit.prior_std.copy()
    for each, size in zip(learned, sizes, strict=True):
        std[each.places] = size
    other = replace(fit, prior_std=std)
    n_u, change = len(fit.u), np.zeros(len(fit.u) + len(fit.nu))
    change[n_u:] = (1 / fit.prior_std**2 - 1 / std**2) * fit.nu
    covariance = other.covariance(scale)
    covariance = (covariance + covariance.T) / 2
    if not fit.with_k_b:
        covariance[0, :] = covariance[:, 0] = 0.0
    step = covariance @ change
    _, logdet = np.linalg.slogdet(covariance[1 - fit.with_k_b :, 1 - fit.with_k_b :])
    prior = sum(each.log_prior(size) for each, size in zip(learned, sizes, strict=True))
    own = [each.places for each in learned]
    places = np.concatenate(own) if own else np.zeros(0, dtype=int)
    penalty = float(np.sum((fit.nu[places] / std[places]) ** 2 + 2 * np.log(std[places])))
    log = prior + (float(change @ step) + logdet - penalty) / 2
    return log, Normal(1.0, np.concatenate([fit.u, fit.nu]) + step, covariance)
