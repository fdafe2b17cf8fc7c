"""A candidate at its best: its numbers, its misfit, and its evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rigtwin.gap.inference.hypotheses import K_B, Hypothesis
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Sampled:
    """An evidence by importance sampling, beside Laplace's."""

    correction: float  # logarithm of it over Laplace's
    error: float  # standard error of that
    ess: float  # effective number of draws
    least_ess: ClassVar[float] = 8.0  # from which the evidence is believed

    @property
    def trusted(self) -> bool:
        """Whether enough draws count."""
        return self.ess >= self.least_ess


@dataclass(frozen=True)
class Fit:
    """A candidate at its best."""

    hypothesis: Hypothesis
    u: FloatArray  # (1 + n_free,) ln k_b and the candidate's coordinates
    nu: FloatArray  # (n_nuisances,)
    chi2: float  # misfit of the data
    penalty: float  # of the nuisances by their priors
    precision: FloatArray  # of (u, nu) at the best point, scaled data
    n_data: int
    prior_std: FloatArray  # of the nuisances
    with_k_b: bool
    added: float = 0.0  # relative error beside the data's own that it was fitted with at last
    sampled: Sampled | None = None  # its evidence, where it was sampled
    log_prior: float = 0.0  # of the repeatabilities that it learned
    harmonics: float = 0.0  # logarithm of the density of measured harmonics, up to a constant of the data

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects with their fitted numbers."""
        return self.hypothesis.effects(self.u[1:])

    @property
    def k_b(self) -> float:
        """Bearing stiffness [N/m]."""
        return K_B.value(self.u[0])

    @property
    def at_edge(self) -> BoolArray:
        """(1 + n_free, 2) which coordinates stand at the low or at the high end of their ranges."""
        return self.hypothesis.at_edge(self.u)

    @property
    def wants_more(self) -> bool:
        """Whether a number stands at an end of its range where its effect has not faded."""
        fades = [free.fades for free in self.hypothesis.coordinates]
        hard = np.array([[fade >= 0, fade <= 0] for fade in fades])
        return bool((self.at_edge & hard)[1:].any())

    @property
    def cost(self) -> float:
        """Misfit and penalty."""
        return self.chi2 + self.penalty

    def log_evidence(self, scale: float = 1.0) -> float:
        """Laplace's approximation, up to a constant of the data; corrected, where it was sampled with success.

        An even prior counts by the normal distribution that is as high: what the data tell well has its exact evidence,
        and no number's volume exceeds its prior's.

        Parameters
        ----------
        scale : true over believed standard error of the data
        """
        keep = slice(0 if self.with_k_b else 1, None)
        prior = self._prior_precision[keep]
        posterior = self.precision[keep, keep] / scale**2 + np.diag(prior)
        _, logdet = np.linalg.slogdet(posterior)
        laplace = -(self.chi2 / scale**2 + self.penalty + logdet - np.sum(np.log(prior))) / 2
        sampled = self.sampled.correction if self.sampled and self.sampled.trusted else 0.0
        return laplace + self.log_prior + self.harmonics + sampled

    def covariance(self, scale: float = 1.0, held: BoolArray | None = None) -> FloatArray:
        """Of (u, nu).

        Parameters
        ----------
        scale : true over believed standard error of the data
        held : (1 + n_free,) coordinates that stay where they are
        """
        precision = self.precision / scale**2 + np.diag(self._prior_precision)
        if held is None or not held.any():
            return np.linalg.inv(precision)
        free = np.flatnonzero(np.concatenate([~held, np.ones(len(self.nu), bool)]))
        covariance = np.zeros_like(precision)
        covariance[np.ix_(free, free)] = np.linalg.inv(precision[np.ix_(free, free)])
        return covariance

    @property
    def _prior_precision(self) -> FloatArray:
        """Of (u, nu); an even prior counts by the normal distribution that is as high."""
        width = np.ptp(self.hypothesis.ends, axis=1)
        return np.concatenate([2 * np.pi / width**2, 1 / self.prior_std**2])

    @property
    def log_weight(self) -> float:
        """Logarithm of evidence times prior: what candidates are ranked by."""
        return self.log_evidence() + float(np.log(self.hypothesis.prior))
