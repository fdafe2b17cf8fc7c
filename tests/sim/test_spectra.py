"""Hammer and random records of an oscillator with a formula for its response."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal, stats

from rigtwin.sim.campaign import MeasurementError
from rigtwin.sim.formats.record import Record
from rigtwin.sim.formats.reduction_plan import ReductionPlan
from rigtwin.sim.modal_fit import fit_modes
from rigtwin.sim.signals import Signals, signals_of
from rigtwin.sim.spectra import estimate_response, find_hits, reduce_spectra
from tests.sim.test_detection import REJECTED

RATE = 1024.0
F0, ZETA, MASS = 60.0, 0.02, 2.0  # [Hz], [-], [kg]
W0 = 2 * np.pi * F0
CHANNELS = {"force": {"column": "F", "unit": "N"}, "node2": {"column": "A", "unit": "m/s^2"}}


def accelerance(frequency_hz: np.ndarray) -> np.ndarray:
    """(n_freq,) of the oscillator, as it is for forces that are piecewise linear between samples."""
    z = np.exp(2j * np.pi * frequency_hz / RATE)
    return np.polyval(NUMERATOR, z) / np.polyval(DENOMINATOR, z)


def _discrete() -> tuple[np.ndarray, np.ndarray]:
    """Transfer function from the samples of a force to those of the acceleration."""
    continuous = ([1 / MASS, 0.0, 0.0], [1.0, 2 * ZETA * W0, W0**2])
    A, B, C, D, _ = signal.cont2discrete(signal.tf2ss(*continuous), 1 / RATE, "foh")
    numerator, denominator = signal.ss2tf(A, B, C, D)
    return numerator[0], denominator


NUMERATOR, DENOMINATOR = _discrete()


def signals(force: np.ndarray, noise: float = 0.0, seed: int = 0, **plan) -> Signals:
    """A record of the oscillator under a force (n,), its acceleration with noise relative to its spread."""
    acceleration = signal.lfilter(NUMERATOR, DENOMINATOR, force)
    acceleration += noise * acceleration.std() * np.random.default_rng(seed).standard_normal(len(force))
    record = Record("r.csv", RATE, np.column_stack([force, acceleration]), ("F", "A"), ("", ""))
    return signals_of(record, plan_of(**plan).sources, Path("r.csv"))


def plan_of(method: str = "random", **keys) -> ReductionPlan:
    return ReductionPlan.model_validate({"channels": CHANNELS, "method": method, **keys})


def white(seed: int, seconds: float = 64.0) -> np.ndarray:
    return np.random.default_rng(100 + seed).standard_normal(round(seconds * RATE))


def blows(*times: float, seconds: float = 12.0, pulse: int = 4, size: float = 100.0) -> np.ndarray:
    """Half sines of so many samples."""
    force = np.zeros(round(seconds * RATE))
    for time in times:
        begin = round(time * RATE)
        force[begin : begin + pulse] += size * np.sin(np.pi * (np.arange(pulse) + 0.5) / pulse)
    return force


def test_random_records_give_the_response_within_their_errors():
    """|error|^2/std^2 is exponential; lines that are far enough apart share no noise."""
    scaled = []
    for seed in range(8):
        reduced = reduce_spectra([signals(white(seed), noise=0.5, seed=seed)], plan_of(block_s=4.0, band_Hz=[30, 90]))
        assert reduced.run.std is not None
        error = np.abs(reduced.run.H[:, 0] - accelerance(reduced.run.frequency_hz)) ** 2
        scaled += (error / reduced.run.std[:, 0] ** 2)[::3].tolist()
    assert reduced.averages == pytest.approx(31 / 1.0545, rel=0.01)
    assert 0.85 < np.mean(scaled) < 1.3  # of the lines near the resonance the leakage of 4 s adds some
    assert stats.kstest(np.array(scaled) / np.mean(scaled), "expon").pvalue > REJECTED


def test_a_noisy_force_needs_h2_and_a_noisy_response_h1():
    force = white(0)
    noisy_force = signals(force)
    samples = noisy_force.samples.copy()
    samples[:, 1] += np.random.default_rng(1).standard_normal(len(force))
    noisy_force = Signals(noisy_force.name, RATE, samples, noisy_force.sources)
    off = {}
    for estimator in ("h1", "h2"):
        run = reduce_spectra([noisy_force], plan_of(estimator=estimator, block_s=1.0, band_Hz=[100, 300])).run
        off[estimator] = np.median(np.abs(run.H[:, 0] / accelerance(run.frequency_hz)))
    assert_allclose(off["h1"], 0.5, atol=0.05)
    assert_allclose(off["h2"], 1.0, atol=0.05)


def test_h1_is_below_h2_by_the_coherence():
    Gxx, Gyy, Gxy = np.array([2.0]), np.array([[8.0]]), np.array([[2.0 + 2.0j]])
    (H1, coherence), (H2, _) = (estimate_response(Gxx, Gyy, Gxy, kind) for kind in ("h1", "h2"))
    assert_allclose(coherence, 0.5)
    assert_allclose(H1 / H2, coherence)


def test_blows_give_the_response_and_are_averaged():
    force = blows(1, 4, 7, 10)
    reduced = reduce_spectra([signals(force, noise=0.02)], plan_of("hammer", block_s=2.0))
    assert reduced.averages == 4
    assert reduced.remarks == ()
    run = reduced.run
    near = (run.frequency_hz > 40) & (run.frequency_hz < 80)
    error = np.abs(run.H[near, 0] - accelerance(run.frequency_hz[near]))
    assert run.std is not None
    assert np.sqrt(np.mean((error / run.std[near, 0]) ** 2)) < 2
    assert error.max() < 0.05 * np.abs(run.H[near]).max()


def test_errors_of_few_blows_are_as_large_as_they_say():
    """Three blows: the residual has two degrees of freedom, and |error|^2/std^2 is F(2, 4) distributed."""
    scaled = []
    for seed in range(10):
        run = reduce_spectra([signals(blows(1, 4, 7), noise=0.3, seed=seed)], plan_of("hammer", block_s=2.0)).run
        far = (run.frequency_hz > 20) & (run.frequency_hz < 200)
        assert run.std is not None
        error = np.abs(run.H[far, 0] - accelerance(run.frequency_hz[far])) ** 2
        scaled += (error / run.std[far, 0] ** 2)[::2].tolist()
    assert stats.kstest(scaled, stats.f(2, 4).cdf).statistic < 0.06


def test_an_exponential_window_adds_the_damping_that_is_told():
    force, tau = blows(1, 4, 7), 0.25
    plain = reduce_spectra([signals(force, noise=1e-3)], plan_of("hammer", block_s=2.5, band_Hz=[20, 120]))
    damped = reduce_spectra([signals(force, noise=1e-3)], plan_of("hammer", block_s=2.5, band_Hz=[20, 120],
                                                                 exponential_s=tau))  # fmt: skip
    (mode,), (wide,) = fit_modes(plain.run, 1), fit_modes(damped.run, 1)
    assert_allclose(mode.damping_ratio, ZETA, rtol=0.02)
    assert_allclose(wide.damping_ratio - 1 / (tau * 2 * np.pi * F0), ZETA, rtol=0.02)
    assert any(
        words.startswith("the exponential window of 0.25 s adds 1/(2 pi f x 0.25 s)") for words in damped.remarks
    )


def test_a_response_that_is_cut_off_is_told():
    reduced = reduce_spectra([signals(blows(1, 4, 7))], plan_of("hammer", block_s=0.3))
    assert "blow 1 at 1 s: the response is still at" in reduced.remarks[0]


def test_a_double_blow_and_a_clipped_one_are_left_out():
    force = blows(1, 4, 7, 10, seconds=14) + blows(4.1, seconds=14, size=30)
    wide = blows(7, seconds=14, pulse=16)
    force = np.where(wide > 0, np.minimum(wide, 60.0), force)
    reduced = reduce_spectra([signals(force)], plan_of("hammer", block_s=2.0))
    assert reduced.averages == 2
    told = [words for words in reduced.remarks if "left out" in words]
    assert told == [
        "r.csv: blow 2 at 4 s: the hammer hit twice; left out",
        "r.csv: blow 3 at 4.1 s: the motion of the blow before is still in it; left out",
        "r.csv: blow 4 at 7 s: channel force is clipped; left out",
    ]


def test_a_bent_pulse_is_one_blow_and_the_level_decides():
    force = blows(1, 2) + blows(1.006) + blows(3, size=5)
    assert len(find_hits(force, 0.1)) == 2
    assert len(find_hits(force, 0.01)) == 3


@pytest.mark.parametrize(
    ("force", "plan", "words"),
    [
        (blows(1), {"method": "hammer", "block_s": 2.0}, "one usable blow has no coherence"),
        (blows(11.9), {"method": "hammer", "block_s": 2.0}, "no blow is usable: r.csv: blow 1"),
        (white(0, 2.0), {"block_s": 4.0}, "block_s: 4 s is longer than the shortest record, 2 s"),
        (white(0, 2.0), {"block_s": 2.0}, "one usable block has no coherence"),
        (np.clip(white(0, 4.0), -1, 1), {}, "channel force is clipped, .* % of its samples"),
        (white(0), {"band_Hz": [600, 700]}, "band_Hz: no line of the spectra lies between 600 and 700 Hz"),
    ],
)
def test_records_that_cannot_be_used_are_told(force, plan, words):
    with pytest.raises(MeasurementError, match=words):
        reduce_spectra([signals(force)], plan_of(**plan))


def test_records_of_different_rates_are_refused():
    one = signals(white(0))
    other = Signals(one.name, 2 * RATE, one.samples, one.sources)
    with pytest.raises(MeasurementError, match=r"different sampling rates \(1024, 2048 Hz\)"):
        reduce_spectra([one, other], plan_of())
