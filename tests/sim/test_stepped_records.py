"""Lines from records of a sine: right within their standard errors, and every fault of a record is told."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from rigtwin.sim.campaign import Channel, MeasurementError
from rigtwin.sim.detection import NoSineError, detect, detect_at, find_frequency, quantisation_error
from rigtwin.sim.formats.record import Record
from rigtwin.sim.formats.reduction_plan import ReductionPlan
from rigtwin.sim.signals import Signals, clipped_share, signals_of
from rigtwin.sim.stepped_records import line_of, remarks_of, run_of_lines
from tests.sim.test_detection import REJECTED
from tests.tolerances import ROUND_OFF

RATE, N = 2500.0, 2500
FREQUENCY = 95.4837  # [Hz], no whole number of samples a period
FORCE, MOTION = 1.5 * np.exp(0.4j), 3.0 * np.exp(-1.1j)
TIME = np.arange(N) / RATE

WITH_FORCE = {
    "force": {"column": "CH1", "sensitivity": "20 mV/N"},
    "node2": {"column": "CH2", "sensitivity": "10 mV/(m/s^2)"},
}
VOLTS = np.array([20e-3, 10e-3])


def sine(phasor: complex, frequency_hz: float = FREQUENCY) -> np.ndarray:
    """(N,) of Re X e^{i omega t}."""
    return (phasor * np.exp(2j * np.pi * frequency_hz * TIME)).real


def signals(samples: np.ndarray, channels: dict | None = None, name: str = "r.csv") -> Signals:
    """Samples (N, 2) of force and motion in SI, as a record of volts that is read by a plan."""
    plan = ReductionPlan.model_validate({"channels": channels or WITH_FORCE})
    record = Record(name, RATE, samples * VOLTS, ("CH1", "CH2"), ("V", "V"))
    return signals_of(record, plan.sources, Path(name))


def settled(noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """(N, 2) force and motion."""
    clean = np.column_stack([sine(FORCE), sine(MOTION)])
    return clean + noise * np.random.default_rng(seed).standard_normal(clean.shape)


# -- detection at any frequency -----------------------------------------------------------------------------


def test_over_whole_periods_both_detections_are_one():
    noise = np.random.default_rng(0).standard_normal((1600, 2))
    samples = np.column_stack([sine(FORCE, RATE / 16), sine(MOTION, RATE / 16)])[:1600] + 0.1 * noise
    here, there = detect(samples, 16), detect_at(samples, 1 / 16)
    assert_allclose(there.amplitude, here.amplitude, atol=ROUND_OFF * 3)
    assert np.all(there.std >= here.std * (1 - ROUND_OFF))
    assert_allclose(there.std, here.std, rtol=0.2)  # the noise round the line may be a little denser than on the whole


@pytest.mark.parametrize("level", [0.5, 0.9, 0.99])
def test_the_standard_error_covers_the_error_as_often_as_it_says(level):
    """|error|^2/std^2 is exponential; the denser of two estimates of the noise makes the intervals somewhat wide."""
    covered, n = 0, 400
    for seed in range(n):
        found = detect_at(settled(0.3, seed)[:500], FREQUENCY / RATE)
        covered += abs(found.amplitude[0, 0] - FORCE) ** 2 <= -np.log(1 - level) * found.std[0] ** 2
    assert stats.binomtest(covered, n, level, alternative="less").pvalue > REJECTED
    assert covered < n * (level + 0.8 * (1 - level))


def test_noise_that_an_amplifier_has_smoothed_is_as_large_as_it_is_round_the_line():
    """Noise below a fifth of the band is five times as dense there; a formula for white noise would miss that."""
    errors, stds = [], []
    for seed in range(100):
        spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(N))
        spectrum[N // 10 :] = 0
        found = detect_at((sine(FORCE) + np.fft.irfft(spectrum, N))[:, None], FREQUENCY / RATE)
        errors.append(abs(found.amplitude[0, 0] - FORCE))
        stds.append(found.std[0])
    assert_allclose(np.sqrt(np.mean(np.square(errors))), np.mean(stds), rtol=0.3)


def test_a_frequency_is_found_as_exactly_as_its_error_says():
    found = [find_frequency(sine(FORCE) + 0.3 * np.random.default_rng(k).standard_normal(N)) for k in range(100)]
    off = np.array([(f * RATE - FREQUENCY) / (std * RATE) for f, std in found])
    assert stats.kstest(off, "norm").pvalue > REJECTED
    assert_allclose(find_frequency(sine(FORCE))[0] * RATE, FREQUENCY, rtol=1e-12)


@pytest.mark.parametrize("periods", [2.2, 3.7, 12.4])
def test_few_periods_with_an_offset_and_harmonics_do(periods):
    n = round(periods * RATE / FREQUENCY)
    values = (7 + sine(FORCE) + 0.3 * sine(1j, 2 * FREQUENCY) + 0.2 * sine(1, 3 * FREQUENCY))[:n]
    assert_allclose(find_frequency(values)[0] * RATE, FREQUENCY, rtol=1e-9)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.ones(N), "every sample is the same"),
        (np.random.default_rng(0).standard_normal(N), "sine stands out"),
        (sine(FORCE, 1.3), "only 1.3 periods"),
    ],
)
def test_what_is_no_sine_is_refused(values, words):
    with pytest.raises(NoSineError, match=words):
        find_frequency(values)


def test_the_error_of_a_converters_steps_is_as_large_as_it_says():
    """Noise-free sines of many amplitudes and offsets, rounded: the error repeats each period, so that N is no help."""
    rng, ratios = np.random.default_rng(0), []
    for _ in range(400):
        amplitude, offset = rng.uniform(2, 40), rng.uniform(-0.5, 0.5)
        samples = np.round(offset + amplitude * sine(1))[:, None]
        found = detect_at(samples, FREQUENCY / RATE)
        std = quantisation_error(np.array([amplitude]), np.ones(1), found.std, N)[0]
        ratios.append(abs(found.amplitude[0, 0] - amplitude) / np.hypot(std, found.std[0]))
    assert_allclose(np.sqrt(np.mean(np.square(ratios))), 1, rtol=0.25)


def test_noise_smooths_the_steps():
    amplitude, step, N = np.array([10.0]), np.ones(1), 10_000
    quiet, noisy = (quantisation_error(amplitude, step, 2 * np.array([s]) / np.sqrt(N), N)[0] for s in (0.3, 1.0))
    assert noisy < 1e-3 * quiet


# -- one record ----------------------------------------------------------------------------------------------


def test_a_line_is_motion_over_force_within_its_error():
    line = line_of(signals(settled(0.05)), 0.05)
    assert line.remarks == ()
    assert line.usable
    assert abs(line.frequency_hz - FREQUENCY) < 4 * line.frequency_std_hz
    assert abs(line.response[0] - MOTION / FORCE) < 3 * line.std[0]
    assert line.std[0] < 5e-3
    assert_allclose(line.force_N, 1.5, rtol=5e-3)


def test_a_sensor_that_points_the_other_way_and_one_of_velocity():
    channels = {"force": WITH_FORCE["force"], "-node4_z": {"column": "CH2", "sensitivity": "10 mV/(m/s)"}}
    line = line_of(signals(settled(), channels), 0.05)
    assert_allclose(line.response[0], -2j * np.pi * FREQUENCY * MOTION / FORCE, rtol=1e-9)
    assert signals(settled(), channels).channels == (Channel(4, "z"),)


def test_a_reference_gives_the_phase_and_not_the_size():
    channels = {"reference": {"column": "CH1"}, "2Y+": WITH_FORCE["node2"]}
    line = line_of(signals(settled(), channels), 0.05)
    assert_allclose(line.response[0], MOTION * abs(FORCE) / FORCE, rtol=1e-9)
    run = run_of_lines([line], (Channel(2),), "reference")
    assert (run.quantity, run.magnitude_only, run.force_amplitude_N) == ("acceleration", False, None)


def test_the_papers_procedure_reads_amplitudes_of_one_accelerometer():
    line = line_of(signals(settled(0.05), {"node2": WITH_FORCE["node2"]}), 0.05)
    assert abs(line.frequency_hz - FREQUENCY) < 4 * line.frequency_std_hz
    assert line.response[0].imag == 0
    assert abs(line.response[0] - abs(MOTION)) < 3 * line.std[0]
    run = run_of_lines([line], (Channel(2),), None)
    assert (run.quantity, run.magnitude_only) == ("acceleration", True)


def test_a_file_that_is_named_after_another_frequency_is_told_and_its_samples_believed():
    line = line_of(signals(settled(0.05), name="line_096.5Hz.csv"), 0.05)
    (words,) = remarks_of([line])
    expected = r"line_096\.5Hz\.csv: its name says 96.5 Hz, its samples 95\.48\d+ Hz; the samples are believed"
    assert re.fullmatch(expected, words)
    assert line.usable
    for name in ("95.5Hz.csv", "95Hz.csv", "95,48 Hz.csv", "0.0955kHz.csv", "record17.csv"):
        assert remarks_of([line_of(signals(settled(0.05), name=name), 0.05)]) == []


def test_a_wrong_sampling_rate_is_told_once():
    line = line_of(signals(settled(0.05), name="955Hz.csv"), 0.05)
    lines = [replace(line, record=f"{955 + k}Hz.csv", frequency_hz=95.5 + k / 10) for k in range(30)]
    (words,) = remarks_of(lines)
    assert words.startswith("the names of 30 records say 10 times the frequency of their samples: is the sampling rate")
    assert len(remarks_of(lines[:3])) == 3


def transient(share: float, decay: float = 8.0) -> np.ndarray:
    """The settled motion with a free vibration of a neighbouring frequency that dies out."""
    samples = settled(0.01)
    samples[:, 1] += share * abs(MOTION) * np.exp(-decay * TIME) * np.cos(2 * np.pi * 94.9 * TIME)
    return samples


def test_a_record_that_has_not_settled_is_told_and_left_out():
    line = line_of(signals(transient(0.5)), 0.05)
    assert not line.usable
    assert "not settled: the response still changes by" in line.remarks[0]
    assert "the line is left out" in line.remarks[0]


def test_a_small_change_is_in_the_standard_error():
    line, calm = line_of(signals(transient(0.03)), 0.05), line_of(signals(settled(0.01)), 0.05)
    assert line.usable
    assert "the standard error holds the change" in line.remarks[0]
    assert line.std[0] > 3 * calm.std[0]
    assert abs(line.response[0] - MOTION / FORCE) < 2 * line.std[0]


def test_noise_is_not_taken_for_a_change():
    told = sum(bool(line_of(signals(settled(0.3, seed)), 0.05).remarks) for seed in range(50))
    assert told <= 1


def test_a_clipped_record_is_told_and_left_out():
    samples = settled(0.02)
    samples[:, 1] = np.clip(samples[:, 1], -np.inf, 2.8)
    line = line_of(signals(samples), 0.05)
    assert not line.usable
    assert line.remarks[0].startswith("clipped: node2 (")
    assert line.remarks[0].endswith("at the end of the range; the line is left out")


@pytest.mark.parametrize("bits", [4, 8, 12])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_flat_top_of_a_coarsely_sampled_sine_is_not_clipped(bits, noise):
    rng = np.random.default_rng(bits)
    for _ in range(20):
        step = rng.uniform(1, 2) * 2 / 2**bits
        values = np.round((sine(1) + noise * rng.standard_normal(N) + rng.uniform(0, step)) / step) * step
        assert clipped_share(values) == 0
        if bits > 4:  # among a dozen levels nobody can tell
            assert clipped_share(np.minimum(values, np.floor(0.8 / step) * step)) > 0


def test_a_blow_rests_at_one_end_of_its_range_and_is_not_clipped():
    force = np.zeros(N)
    force[100:120] = np.round(100 * np.sin(np.pi * np.arange(20) / 20))
    assert clipped_share(force) == 0
    assert clipped_share(np.minimum(force, 70)) > 0


# -- channels, and many records --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ({**WITH_FORCE, "node3": {"column": "CH9", "unit": "g"}}, "node3: no column is called 'CH9'; the file has CH1"),
        ({"node2": {"column": "CH2"}}, "its numbers are in V; give its sensitivity, for example"),
        ({"force": {"column": "CH1"}, "node2": WITH_FORCE["node2"]}, "force .CH1.: its numbers are in V; give"),
        (
            {"node2": {"column": "CH2", "sensitivity": "5 counts/g"}},
            "the file says it is in V, which does not go with a sensitivity of a signal in counts",
        ),
    ],
)
def test_a_channel_that_the_record_does_not_have_or_tell_is_refused(channels, words):
    with pytest.raises(MeasurementError, match=rf"r\.csv: channel .*{words}"):
        signals(settled(), channels)


def test_a_dead_channel_is_told():
    samples = settled()
    samples[:, 1] = 0.1
    with pytest.raises(MeasurementError, match="channel node2: every sample is the same; is it connected"):
        signals(samples)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"channels": {"force": {"column": "A"}}}, "no response; add one"),
        ({"channels": {"node": {"column": "A"}}}, "'node' is no channel"),
        ({"channels": {"node2": {"column": "A", "sensitivity": "3 mV/N"}}}, "is not measured in the unit of a force"),
        (
            {"channels": {"force": {"column": "A", "unit": "g"}}},
            "force: a force is not measured in the unit of an accel",
        ),
        ({"channels": {"node2": {"column": "A", "unit": "N"}}}, "is not measured in the unit of a force"),
        ({"channels": {"node2": {"column": "A", "unit": "g", "sensitivity": "1 mV/g"}}}, "do not go together"),
        ({"channels": {"node2": {"column": "A"}, "2Y-": {"column": "B"}}}, "one node twice"),
        ({"channels": {"node2": {"column": "A"}}, "method": "hammer"}, "hammer records need a force"),
        ({"channels": {"node2": {"column": "A", "unit": "V/m"}}}, "'V/m' is no unit that is known"),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(tables, words):
    with pytest.raises(ValueError, match=words):
        ReductionPlan.model_validate(tables)


def test_lines_are_sorted_and_those_left_out_were_swept():
    lines = [
        line_of(signals(np.column_stack([sine(FORCE, f), sine(MOTION, f)])), 0.05) for f in (120.3, 80.1, 100.2)
    ]  # fmt: skip
    run = run_of_lines([lines[0], replace(lines[2], usable=False), lines[1]], (Channel(2),), "force")
    assert_allclose(run.frequency_hz, [80.1, 120.3])
    assert run.swept_hz is not None
    assert_allclose(run.swept_hz, [80.1, 100.2, 120.3])
    assert run.force_N is not None
    assert_allclose(run.force_N, 1.5)
    with pytest.raises(MeasurementError, match=r"both are of 80\.1 Hz"):
        run_of_lines([lines[1], lines[1]], (Channel(2),), "force")
    with pytest.raises(MeasurementError, match="no record is usable"):
        run_of_lines([replace(lines[1], usable=False)], (Channel(2),), "force")


def test_where_the_response_is_steep_the_frequencys_error_counts():
    lines = []
    for f, size in ((100.0, 1.0), (100.01, 2.0), (100.02, 3.0)):
        samples = np.column_stack([sine(1, f), sine(size, f)]) + 0.01 * np.random.default_rng(0).standard_normal((N, 2))
        lines.append(line_of(signals(samples), 0.05))
    run = run_of_lines(lines, (Channel(2),), "force")
    assert run.std is not None
    assert_allclose(run.std[1] ** 2 - lines[1].std ** 2, (100 * lines[1].frequency_std_hz) ** 2, rtol=0.1)
