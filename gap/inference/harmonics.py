"""What measured harmonics say of candidates: a force law bends a motion in its own way, and a linear rotor does not.

The harmonics of all channels at a line are compared with those of the fitted motion. Where a candidate has none, the
exciter may still make them: a harmonic of its force, of an unknown size at every line, moves the linear rotor. Errors
of one line have an unknown size in common, so that they follow a t-distribution [lange1989].
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import acting
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray


@dataclass(frozen=True)
class HarmonicErrors:
    """Errors of harmonics beside the noise."""

    model: float = 0.1  # of a prediction, relative: far above the lines that were fitted, no tolerance is known
    sensor: float = 3e-3  # harmonic that a sensor reports of a pure sine, relative
    exciter: tuple[float, ...] = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)  # of its force, relative; each as probable
    freedom: float = 4.0  # of the t-distribution


_ERRORS = HarmonicErrors()


def with_harmonics(problem: Problem, fit: Fit) -> Fit:
    """The fit, whose evidence counts the harmonics that the runs have, too."""
    return replace(fit, harmonics=float(sum(_of_each(problem, fit))))


def _of_each(problem: Problem, fit: Fit) -> Iterator[float]:
    """Logarithm of the density of each run's harmonics of each order, up to a constant of the data."""
    linear = [effect for effect in fit.effects if effect.family != "nonlinear"]
    for r, modal in enumerate(problem.at_fit(fit).modals(fit.k_b, fit.effects)):
        observed, run, gains = problem.observed[r], problem.runs[r], problem.nuisances.gains(fit.nu, r, modal)
        for order, measured in {} if run.magnitude_only else run.harmonics.items():
            left = measured - gains * modal.harmonic(order, *problem.nuisances.of_run(fit.nu, r, modal))
            plain = problem.forward.modal(run.at_order(order), fit.k_b, acting(linear, run.support))
            by_exciter = gains * plain.response(*problem.nuisances.of_run(fit.nu, r, plain))
            variance = observed.std**2 + (_ERRORS.sensor * np.abs(run.H)) ** 2
            variance = variance + (_ERRORS.model * np.abs(measured - left)) ** 2
            heard = observed.valid.all(axis=1) & np.isfinite(left).all(axis=1)
            yield _log_density(left[heard], variance[heard], by_exciter[heard])


def _log_density(left: ComplexArray, variance: FloatArray, by_exciter: ComplexArray) -> float:
    """Of what is left (n_freq, n_channels) of harmonics, with variances of their own and by the exciter's harmonic."""
    n = 2 * left.shape[1]
    own = np.sum(np.abs(left) ** 2 / variance, axis=1)
    size = np.sum(np.abs(by_exciter) ** 2 / variance, axis=1)
    along = np.abs(np.sum(by_exciter.conj() * left / variance, axis=1)) ** 2
    tried = []
    for share in _ERRORS.exciter:
        square = 2 * (own - along * share**2 / (1 + share**2 * size))
        spread = np.sum(np.log(variance), axis=1) + np.log1p(share**2 * size)
        tried.append(-np.sum(spread + (_ERRORS.freedom + n) / 2 * np.log1p(square / _ERRORS.freedom)))
    return float(logsumexp(tried)) - float(np.log(len(tried)))
