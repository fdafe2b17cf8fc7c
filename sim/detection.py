"""Synchronous detection: phasors of the fundamental and its harmonics, over whole periods or at any frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray

HARMONICS = (1, 2, 3)

# A frequency is found where a step of the search changes it by less than this, relative; so many steps do.
_FOUND, _STEPS = 1e-12, 30

# Noise round a line is judged from so many lines of the spectrum or more, not nearer to it than the window's main lobe.
_NOISE_LINES, _MAIN_LOBE = 8, 2


class NoSineError(ValueError):
    """No sine stands out of the samples; the message says why."""


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


def per_force(phasors: Phasors) -> Phasors:
    """Response phasors referred to the force in the last channel, harmonics to its k-th power's phase.

    The errors of response and force are independent: std(X/F)^2 = (std(X)^2 + |X/F|^2 std(F)^2) / |F|^2.
    """
    force = phasors.amplitude[0, -1]
    turn = np.array([abs(force) * (force / abs(force)) ** k for k in HARMONICS])
    amplitude = phasors.amplitude[:, :-1] / turn[:, None]
    std = np.hypot(phasors.std[:-1], np.abs(amplitude[0]) * phasors.std[-1]) / abs(force)
    return replace(phasors, amplitude=amplitude, std=std)


def detect_at(samples: FloatArray, cycles_per_sample: float) -> Phasors:
    """The fit of ``detect`` where a period has no whole number of samples.

    White noise of variance s^2 gives a phasor the error that the least squares say, 4 s^2 / N over many periods. s^2
    comes from the residual. Where an amplifier lets less of the spectrum pass than the converter takes, noise is denser
    round the line than on the whole. So the residual's spectrum from half to one and a half times the frequency is
    looked at, too, and the larger of both is taken.

    Parameters
    ----------
    samples : (N, n_channels), a period or more
    cycles_per_sample : frequency over the sampling rate, below 1/2; harmonics from 1/2 on are left out and are zero

    >>> phi = 2 * np.pi * 0.0713 * np.arange(100)
    >>> abs(detect_at(2 * np.cos(phi)[:, None], 0.0713).amplitude[:, 0]).round(6)
    array([2., 0., 0.])
    """
    basis, N = _real_basis(len(samples), cycles_per_sample), len(samples)
    unknowns = basis.shape[1]
    if unknowns >= N:
        raise ValueError(f"{N} samples are too few for {unknowns} unknowns")
    information = basis.T @ basis
    fitted = np.linalg.solve(information, basis.T @ samples)  # (1 + 2 n_orders, n_channels)
    amplitude = np.zeros((len(HARMONICS), samples.shape[1]), dtype=complex)
    orders = (len(fitted) - 1) // 2
    amplitude[:orders] = fitted[1::2] - 1j * fitted[2::2]
    residual = samples - basis @ fitted
    variance = np.sum(residual**2, axis=0) / (N - unknowns)
    covariance = np.linalg.inv(information)
    spread = covariance[1, 1] + covariance[2, 2]  # of real and imaginary part of the fundamental
    return Phasors(amplitude, np.sqrt(spread * np.maximum(variance, _noise_round(residual, cycles_per_sample))))


def _real_basis(N: int, cycles_per_sample: float) -> FloatArray:
    """(N, 1 + 2 n_orders) a constant, and cosine and sine of the fundamental and of each harmonic below 1/2."""
    phi = 2 * np.pi * cycles_per_sample * np.arange(N)
    orders = [k for k in HARMONICS if k * cycles_per_sample < 0.5]
    return np.column_stack([np.ones(N), *(wave(k * phi) for k in orders for wave in (np.cos, np.sin))])


def _noise_round(residual: FloatArray, cycles_per_sample: float) -> FloatArray:
    """(n_channels,) variance of white noise as dense as the residual's round a line; zero where too few lines tell."""
    N = len(residual)
    lines, line = np.arange(N // 2 + 1), N * cycles_per_sample
    near = (abs(lines - line) <= line / 2) & (abs(lines - line) > _MAIN_LOBE)
    if np.count_nonzero(near) < _NOISE_LINES:
        return np.zeros(residual.shape[1])
    window = np.hanning(N)[:, None]
    density = np.abs(np.fft.rfft(window * residual, axis=0)) ** 2 / np.sum(window**2)
    return density[near].mean(axis=0)


def find_frequency(samples: FloatArray) -> tuple[float, float]:
    """Frequency of a sine with harmonics and its standard error, in cycles per sample.

    The highest line of the spectrum begins a least-squares fit of the sine, its harmonics, a constant and the frequency
    itself (the four-parameter sine fit [ieee1057], with harmonics).

    Parameters
    ----------
    samples : (N,), two periods or more

    Raises
    ------
    NoSineError : the samples are constant, hold less than two periods, or no sine

    >>> round(find_frequency(np.cos(2 * np.pi * 0.0713 * np.arange(100)))[0], 12)
    0.0713
    """
    N = len(samples)
    found = _highest_line(samples)
    for _ in range(_STEPS):
        basis, by_frequency = _linearised(samples, found)
        step = float(np.linalg.lstsq(np.column_stack([basis, by_frequency]), samples, rcond=None)[0][-1])
        if not 0 < found + step < 0.5 or abs(step) > 2 / N:
            raise NoSineError("no steady sine stands out")
        found += step
        if abs(step) < _FOUND * found:
            break
    basis, by_frequency = _linearised(samples, found)
    residual = _less_what_fits(samples, basis)
    if np.var(residual) > 0.5 * np.var(samples):
        raise NoSineError("no sine stands out: more than half of the signal is something else")
    if N * found < 2:
        raise NoSineError(f"only {N * found:.2g} periods; record two or more")
    variance = np.sum(residual**2) / max(N - basis.shape[1] - 1, 1)
    return float(found), math.sqrt(variance / np.sum(_less_what_fits(by_frequency, basis) ** 2))


def _linearised(samples: FloatArray, cycles_per_sample: float) -> tuple[FloatArray, FloatArray]:
    """The basis of a fit at a frequency (N, n), and (N,) how the fitted sine and its harmonics change with it."""
    N, basis = len(samples), _real_basis(len(samples), cycles_per_sample)
    fitted = np.linalg.lstsq(basis, samples, rcond=None)[0]
    by_phase = basis[:, 1::2] * fitted[2::2] - basis[:, 2::2] * fitted[1::2]  # (N, n_orders) of each harmonic
    return basis, 2 * np.pi * np.arange(N) * (by_phase @ np.arange(1, by_phase.shape[1] + 1))


def _less_what_fits(values: FloatArray, basis: FloatArray) -> FloatArray:
    """(N,) residual of a least-squares fit."""
    return values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]


def _highest_line(samples: FloatArray) -> float:
    """Cycles per sample of the highest line of the spectrum, between lines by a parabola. Raises NoSineError."""
    N = len(samples)
    if np.ptp(samples) == 0:
        raise NoSineError("every sample is the same")
    size = np.abs(np.fft.rfft(np.hanning(N) * (samples - samples.mean())))
    top = int(np.argmax(size[1:-1])) + 1
    below, here, above = np.log(np.maximum(size[top - 1 : top + 2], 1e-15 * size[top])).tolist()
    curvature = below - 2 * here + above
    return (top + (0.5 * (below - above) / curvature if curvature else 0.0)) / N


# The root-mean-square error of a sine's fundamental by the steps of a converter, see ``quantisation_error``.
_STEP_ERROR = math.sqrt(1.2020569 / math.pi**4)


def quantisation_error(amplitude: FloatArray, step: FloatArray, std: FloatArray, N: int) -> FloatArray:
    """(n_channels,) standard error of phasors by the steps of a converter, beside the residual's ``std``.

    Rounding to steps q has the error (q/pi) sum_k (-1)^k sin(2 pi k x/q)/k. Of a sine of amplitude A its fundamental
    is (2q/pi) sum_k (-1)^k J_1(2 pi k A/q) cos(2 pi k d/q)/k, with d the place of zero between two steps. Its mean
    square over d and A is zeta(3) q^3/(pi^4 A), as J_1(z)^2 is 1/(pi z) on average. It repeats from period to period,
    so that a longer record does not make it smaller. Noise of standard deviation s smooths the steps, by
    exp(-2 (pi s/q)^2). The residual has at least the variance q^2/12 of rounding.

    Parameters
    ----------
    amplitude, step : (n_channels,) peak amplitude and step of the converter
    std : (n_channels,) standard error of the phasors by the residual
    N : number of samples
    """
    noise = np.maximum(N / 4 * std**2 - step**2 / 12, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        repeated = np.where(step > 0, _STEP_ERROR * step * np.sqrt(step / np.maximum(amplitude, step / 2)), 0.0)
        smoothed = np.exp(-2 * np.where(step > 0, np.pi**2 * noise / step**2, 0.0))
    missing = np.maximum(4 / N * step**2 / 12 - std**2, 0.0)
    return np.hypot(repeated * smoothed, np.sqrt(missing))
