"""Sensor noise: what is stated is what comes out, and it comes out again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.sim.detection import detect
from rigtwin.sim.sensors import SensorNoise

SAMPLES_PER_PERIOD = 16
PEAKS = np.array([1.0, 250.0, 4e-3])  # [m/s^2]
WINDOWS = 4000
# The mean square of so many complex errors is within 4 sigma, 4 / sqrt(WINDOWS), of its expectation.
FEW_PER_CENT = 4 / np.sqrt(WINDOWS)


def window(peaks: np.ndarray = PEAKS, periods: int = 1) -> np.ndarray:
    """(N, n_channels) sines, each with a phase of its own."""
    phi = 2 * np.pi * np.arange(SAMPLES_PER_PERIOD * periods) / SAMPLES_PER_PERIOD
    return peaks * np.sin(phi[:, None] + np.arange(len(peaks)))


def mean_square_errors(noise: SensorNoise, clean: np.ndarray) -> np.ndarray:
    """(n_channels,) E|error|^2 of the fundamental over many streams."""
    truth = detect(clean, SAMPLES_PER_PERIOD).amplitude[0]
    found = [detect(noise.add(clean, (0, k)), SAMPLES_PER_PERIOD).amplitude[0] for k in range(WINDOWS)]
    return np.mean(np.abs(np.array(found) - truth) ** 2, axis=0)


@pytest.mark.parametrize("periods", [1, 4])
@pytest.mark.parametrize("relative", [1e-4, 0.01, 0.2])
def test_one_per_cent_stated_is_one_per_cent_on_the_line(relative, periods):
    """Whatever the line's size and however long the window."""
    errors = mean_square_errors(SensorNoise(relative=relative), window(periods=periods))
    assert_allclose(errors, (relative * PEAKS) ** 2, rtol=FEW_PER_CENT)


@pytest.mark.parametrize("periods", [1, 4])
def test_the_floor_is_the_same_on_every_line_and_adds_in_squares(periods):
    clean = window(periods=periods)
    assert_allclose(mean_square_errors(SensorNoise(floor=0.02), clean), 0.02**2, rtol=FEW_PER_CENT)
    both = mean_square_errors(SensorNoise(relative=0.01, floor=0.02), clean)
    assert_allclose(both, (0.01 * PEAKS) ** 2 + 0.02**2, rtol=FEW_PER_CENT)


def test_the_standard_error_found_is_the_one_stated():
    clean, noise = window(periods=4), SensorNoise(relative=0.01)
    squares = [detect(noise.add(clean, (k,)), SAMPLES_PER_PERIOD).std ** 2 for k in range(WINDOWS)]
    assert_allclose(np.mean(squares, axis=0), (0.01 * PEAKS) ** 2, rtol=FEW_PER_CENT)


def test_a_sensor_at_rest_has_the_floor_only():
    still = np.zeros((SAMPLES_PER_PERIOD, 2))
    assert_array_equal(SensorNoise(relative=0.1).add(still, (0,)), still)
    assert np.all(SensorNoise(relative=0.1, floor=1e-3).add(still, (0,)).std(axis=0) > 0)


def test_without_noise_the_samples_pass_unchanged():
    assert_array_equal(SensorNoise(seed=5).add(window(), (1, 2)), window())


def test_the_samples_given_are_left_alone():
    clean = window()
    SensorNoise(relative=0.1, floor=0.1).add(clean, (0,))
    assert_array_equal(clean, window())


def test_noise_comes_again_whatever_was_asked_before():
    noise, streams = SensorNoise(relative=0.01, seed=3), [(0, 1), (1, 0), (0, 10**12), (1, 5)]
    forwards = {stream: noise.add(window(), stream) for stream in streams}
    backwards = {stream: replace(noise).add(window(), stream) for stream in reversed(streams)}
    for stream in streams:
        assert_array_equal(forwards[stream], backwards[stream])


def test_streams_seeds_and_channels_are_independent():
    """Correlations of 16,000 samples are within 5 / sqrt(16,000) = 0.04 of zero."""
    clean = window(np.ones(2), periods=1000)
    draws = [SensorNoise(relative=0.1, seed=s).add(clean, stream) - clean for s, stream in [(0, (1, 2)), (1, (1, 2))]]
    draws += [SensorNoise(relative=0.1, seed=0).add(clean, stream) - clean for stream in [(2, 1), (1, 3), (1,)]]
    correlation = np.corrcoef(np.hstack(draws), rowvar=False)  # (10, 10)
    assert np.abs(correlation - np.eye(10)).max() < 0.04
