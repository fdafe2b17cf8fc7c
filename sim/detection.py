"""Synchronous detection: phasors of the fundamental and its harmonics over whole periods."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray

HARMONICS = (1, 2, 3)


@dataclass(frozen=True)
class Phasors:
    """Peak phasors of a window of samples, time factor e^{+i omega t} from its first sample."""

    amplitude: ComplexArray  # (n_harmonics, n_channels)
    std: FloatArray  # (n_channels,) standard error sqrt(E|error|^2) of each phasor


def harmonics(samples: FloatArray, samples_per_period: int) -> ComplexArray:
    """(n_harmonics, n_channels) peak phasors of a window of whole periods, see ``detect``."""
    N = len(samples)
    if samples_per_period < 8 or N == 0 or N % samples_per_period:
        raise ValueError(f"{N} samples are not whole periods of {samples_per_period} (at least 8) samples")
    return np.asarray(2 / N * (_basis(N, samples_per_period) @ samples), dtype=complex)


def detect(samples: FloatArray, samples_per_period: int, *, any_harmonics: bool = False) -> Phasors:
    """Least squares of a constant and HARMONICS over whole periods.

    Over whole periods the columns are orthogonal, so the fit is a sum: X_k = 2/N sum x e^{-ik phi}.
    White noise of standard deviation s in the samples gives each phasor the error
    sqrt(E|error|^2) = 2 s / sqrt(N); s is estimated from the residuals of the fit.

    Parameters
    ----------
    samples : (N, n_channels), N a multiple of samples_per_period
    samples_per_period : at least 8, so that three harmonics and a residual fit
    any_harmonics : s is estimated from what does not repeat from period to period, so that harmonics
        beyond HARMONICS do not count as noise; for two periods and more

    >>> cosine = 2 * np.cos(2 * np.pi * np.arange(32) / 16)[:, None]  # two periods, one channel
    >>> abs(detect(cosine, samples_per_period=16).amplitude[:, 0]).round(6)
    array([2., 0., 0.])
    """
    amplitude, N = harmonics(samples, samples_per_period), len(samples)
    if any_harmonics and samples_per_period < N:
        periods = samples.reshape(-1, samples_per_period, samples.shape[1])
        fitted, freedom = np.tile(periods.mean(axis=0), (len(periods), 1)), N - samples_per_period
    else:
        fitted = samples.mean(axis=0) + np.real(_basis(N, samples_per_period).conj().T @ amplitude)
        freedom = N - 1 - 2 * len(HARMONICS)
    variance = np.sum((samples - fitted) ** 2, axis=0) / freedom
    return Phasors(amplitude, 2 * np.sqrt(variance / N))


@lru_cache(maxsize=4)
def _basis(N: int, samples_per_period: int) -> ComplexArray:
    """(n_harmonics, N) e^{-ik phi}: a sweep asks for the same ones again and again."""
    basis = np.exp(-2j * np.pi / samples_per_period * np.outer(HARMONICS, np.arange(N)))
    basis.setflags(write=False)
    return basis
