"""Synchronous detection: exact on harmonics, and a standard error that behaves like one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy import stats

from rigtwin.sim.detection import HARMONICS, detect
from tests.tolerances import ROUND_OFF

# A statistic with a fixed seed is rejected where its null distribution gives it less than this.
REJECTED = 1e-3

SAMPLES_PER_PERIOD = 16
PHASORS = np.array([[1.0 - 2.0j, 0.0], [0.3j, -5e-3], [-1e-4, 2.0 + 1.0j]])  # (n_harmonics, n_channels)
DC = np.array([7.0, -0.1])


def signal(phasors: np.ndarray, dc: np.ndarray | float, samples_per_period: int, periods: int) -> np.ndarray:
    """(N, n_channels) of Re sum_k X_k e^{ik phi} + DC."""
    phi = 2 * np.pi * np.arange(samples_per_period * periods) / samples_per_period
    return (np.exp(1j * np.outer(phi, HARMONICS)) @ phasors).real + dc


def noise_phasors(s: float, periods: int, n: int, seed: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Phasors (3, n) and standard errors (n,) of n windows of white noise, and the residual's degrees of freedom."""
    N = SAMPLES_PER_PERIOD * periods
    found = detect(s * np.random.default_rng(seed).standard_normal((N, n)), SAMPLES_PER_PERIOD)
    return found.amplitude, found.std, N - 7


@given(samples_per_period=st.integers(8, 64), periods=st.integers(1, 5), scale=st.floats(1e-9, 1e9))
def test_harmonics_and_a_constant_are_found_exactly(samples_per_period, periods, scale):
    found = detect(scale * signal(PHASORS, DC, samples_per_period, periods), samples_per_period)
    size = scale * np.abs(DC).max()
    assert_allclose(found.amplitude, scale * PHASORS, rtol=0, atol=ROUND_OFF * size)
    assert np.all(found.std < ROUND_OFF * size)


def test_phasors_are_peak_values_from_the_first_sample():
    """x = 3 cos(omega t - 30 degrees)."""
    phi = 2 * np.pi * np.arange(SAMPLES_PER_PERIOD) / SAMPLES_PER_PERIOD
    found = detect(3 * np.cos(phi - np.pi / 6)[:, None], SAMPLES_PER_PERIOD)
    assert_allclose(found.amplitude[0], 3 * np.exp(-1j * np.pi / 6), rtol=ROUND_OFF)


def test_channels_are_detected_apart():
    samples = signal(PHASORS, DC, SAMPLES_PER_PERIOD, 2)
    together = detect(samples, SAMPLES_PER_PERIOD)
    alone = detect(samples[:, 1:], SAMPLES_PER_PERIOD)
    assert_allclose(together.amplitude[:, 1:], alone.amplitude, rtol=0, atol=ROUND_OFF * np.abs(DC).max())


@pytest.mark.parametrize("periods", [1, 4])
def test_noise_gives_each_phasor_the_error_2_s_over_root_n(periods):
    """On every harmonic |error|^2 N / (4 s^2) is exponential: chi-squared with two degrees of freedom, halved."""
    s, n = 0.3, 4000
    errors, _, _ = noise_phasors(s, periods, n, seed=1)
    for k in range(len(HARMONICS)):
        scaled = np.abs(errors[k]) ** 2 * SAMPLES_PER_PERIOD * periods / (4 * s**2)
        assert stats.kstest(scaled, "expon").pvalue > REJECTED
        assert stats.kstest(np.angle(errors[k]), stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > REJECTED


@pytest.mark.parametrize("periods", [1, 4])
def test_the_standard_error_follows_its_null_distribution(periods):
    """It comes from a residual of N - 7 degrees of freedom, so that its square is chi-squared."""
    s = 0.3
    _, std, freedom = noise_phasors(s, periods, 4000, seed=2)
    expected = 4 * s**2 / (SAMPLES_PER_PERIOD * periods)
    assert stats.kstest(freedom * std**2 / expected, stats.chi2(freedom).cdf).pvalue > REJECTED


@pytest.mark.parametrize("periods", [1, 4])
@pytest.mark.parametrize("level", [0.5, 0.9, 0.99])
def test_the_standard_error_covers_the_error_as_often_as_it_says(periods, level):
    """|error|^2 / std^2 is F(2, N - 7): few periods leave the standard error itself uncertain."""
    n = 20_000
    errors, std, freedom = noise_phasors(0.3, periods, n, seed=3)
    covered = np.count_nonzero(np.abs(errors[0]) ** 2 <= std**2 * stats.f.ppf(level, 2, freedom))
    assert stats.binomtest(covered, n, level).pvalue > REJECTED


def test_what_is_no_harmonic_of_the_fit_shows_in_the_standard_error():
    phi = 2 * np.pi * np.arange(SAMPLES_PER_PERIOD) / SAMPLES_PER_PERIOD
    found = detect(np.cos(5 * phi)[:, None], SAMPLES_PER_PERIOD)
    assert_allclose(found.amplitude, 0, rtol=0, atol=ROUND_OFF)
    # Residual sum of squares N/2 over N - 7 degrees of freedom.
    assert_allclose(found.std, 2 * np.sqrt(0.5 / (SAMPLES_PER_PERIOD - 7)), rtol=ROUND_OFF)


@pytest.mark.parametrize(("n", "samples_per_period"), [(15, 16), (17, 16), (8, 16), (0, 16), (14, 7), (6, 6)])
def test_samples_that_are_not_whole_periods_are_refused(n, samples_per_period):
    with pytest.raises(ValueError, match=f"{n} samples are not whole periods of {samples_per_period}"):
        detect(np.zeros((n, 1)), samples_per_period)
