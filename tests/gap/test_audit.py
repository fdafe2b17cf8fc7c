"""The audit of a campaign: each check fires when its fault is put in, and is silent otherwise."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.gap.audit.checked_run import CheckedRun, checked_runs
from rigtwin.gap.audit.findings import audit, usable
from rigtwin.gap.audit.geometry import geometry_of
from rigtwin.gap.audit.noise import believed_errors, common_error, estimate_noise, mean_square, scatter_over
from rigtwin.gap.audit.pairs import compare
from rigtwin.gap.audit.phase import Delays, _drive_sign, check_sign
from rigtwin.gap.audit.wild import wild_lines, without_wild_lines
from rigtwin.gap.document import Finding
from rigtwin.rotor.effects import Gyroscopic, SensorDelay
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import undamped_modes
from rigtwin.sim.campaign import Campaign, Channel, NominalBelief, PeakList, Run
from tests.repetitions import every_second_is_long

RIG = "nit-rourkela"
OWN_ROTOR = str(Path(__file__).parents[2] / "examples/own_rotor.toml")
STRUCTURE = assemble(load_rig(RIG))
SCALE = scale_of(STRUCTURE)
CHANNELS = tuple(Channel(node) for node in range(1, 8))
EVEN = np.arange(20.0, 400.5, 1.0)
RIGID = Condition(rigid_support=True, shaft_damping_ratio=0.005)
BEARING = Condition(k_b=5e6, bearing_damping=20.0, shaft_damping_ratio=0.005)


def clustered(condition):
    """201 even lines and 17 more round each resonance, as the virtual rig lays them."""
    modes = damped_modes(build_system(STRUCTURE, condition))
    places = np.concatenate([np.arange(-4, 5) / 8, [-8, -4, -2, -1, 1, 2, 4, 8]])
    inside = modes.frequency_hz < 400
    close = [
        f * (1 + 2 * zeta * places)
        for f, zeta in zip(modes.frequency_hz[inside], modes.damping_ratio[inside], strict=True)
    ]
    return np.unique(np.round(np.concatenate([np.linspace(20, 400, 201), *close]), 6))


def circular(rng, shape):
    """Circular complex normal numbers with E|e|^2 = 1."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def measure(condition, frequency_hz=None, *, noise=0.005, seed=0, drift=0.0, gain: Any = 1.0, effects=(), **settings):
    """A run with noise relative to each line, and with the standard errors that belong to it."""
    f = clustered(condition) if frequency_hz is None else frequency_hz
    rng = np.random.default_rng(seed)
    H = gain * measured_response(STRUCTURE, condition, effects, f * (1 + drift))
    std = noise * np.abs(H)
    support = "rigid" if condition.rigid_support else "bearing"
    known = {"std": std, "excitation_node": condition.excitation_node, "name": f"{support}-{seed}"}
    return Run(f, H + std * circular(rng, H.shape), CHANNELS, support, **(known | settings))


def in_campaign(*runs, **keys):
    return Campaign("test", RIG, tuple(runs), **keys)


def healthy(seed):
    """Four runs as a good laboratory makes them: gains, drift, noise and damping are random."""
    rng = np.random.default_rng(seed)
    zeta, noise = 10 ** rng.uniform(-3, -2), 10 ** rng.uniform(-2.7, -1.7)
    k_b, c_b = 10 ** rng.uniform(6, 8), rng.choice([0.0, 20.0, 100.0])
    sensors = 1 + 0.01 * rng.standard_normal(7)
    runs = []
    for place, (rigid, force) in enumerate([(True, 1.0), (False, 1.0), (False, 4.0), (False, 1.0)]):
        condition = Condition(k_b=k_b, bearing_damping=c_b, shaft_damping_ratio=zeta, rigid_support=rigid)
        gain = sensors * (1 + 0.02 * rng.standard_normal())
        drift = 1e-4 * rng.standard_normal()
        run = measure(condition, noise=noise, seed=100 * seed + place, gain=gain, drift=drift, force_amplitude_N=force)
        runs.append(run if seed % 3 else replace(run, std=None))
    return in_campaign(*runs, nominal=NominalBelief(shaft_damping_ratio=zeta))


def troubles(findings, *checks):
    """Warnings and errors of some checks, or of all."""
    return [f for f in findings if f.severity in ("warning", "error") and (not checks or f.check in checks)]


def noted(findings, check):
    return [f for f in findings if f.severity != "ok" and f.check == check]


# -- no fault --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("campaigns", "most"), [(4, 1), pytest.param(20, 2, marks=pytest.mark.long)])
def test_healthy_campaigns_give_hardly_a_warning(campaigns, most):
    """Four runs each, with some ten judgements of every run."""
    found = [f for seed in range(campaigns) for f in troubles(audit(healthy(seed)))]
    assert len(found) <= most, found


def test_every_check_of_a_healthy_campaign_says_so():
    reciprocal = replace(BEARING, excitation_node=5)
    findings = audit(in_campaign(*healthy(1).runs, measure(BEARING, EVEN), measure(reciprocal, EVEN, seed=1)))
    passed = {f.check for f in findings if f.severity == "ok"}
    assert passed >= {"channels", "missing_lines", "raster", "noise", "saturation", "sweep_rate", "delay", "sign"}
    assert passed >= {"units", "repeatability", "level", "reciprocity", "coverage", "labels"}
    assert all(f.words.endswith(".") for f in findings)
    assert all(isinstance(f, Finding) for f in findings)


def test_an_audit_of_two_runs_is_quick():
    """The bar is 0.3 s; five times that on a busy machine."""
    campaign = in_campaign(measure(RIGID), measure(BEARING))
    start = time.perf_counter()
    audit(campaign)
    assert time.perf_counter() - start < 1.5


# -- noise -----------------------------------------------------------------------------------------

WITHIN = 0.15  # bar of the project for the noise estimate


@pytest.mark.parametrize("noise", [0.002, 0.006, 0.02])
@pytest.mark.parametrize("condition", [RIGID, BEARING, replace(RIGID, shaft_damping_ratio=0.001)])
@pytest.mark.parametrize("lines", [EVEN, None], ids=["even", "clustered"])
@pytest.mark.parametrize("magnitudes", [False, True])
def test_the_noise_of_every_channel_is_estimated(noise, condition, lines, magnitudes):
    run = measure(condition, lines, noise=noise, seed=3)
    expected = noise
    if magnitudes:  # which see half of a circular error's power
        run, expected = replace(run, H=np.abs(run.H).astype(complex), magnitude_only=True), noise / np.sqrt(2)
    found = estimate_noise(run)
    moving = np.abs(run.H).any(axis=0)
    assert np.median(found.relative[moving]) == pytest.approx(expected, rel=WITHIN)
    # Single channels have a standard error of a tenth in the clustered raster, magnitudes a seventh.
    assert found.relative[moving] == pytest.approx(expected, rel=WITHIN * (3 if magnitudes else 2))
    assert found.std[:, moving] == pytest.approx(expected * np.abs(run.H[:, moving]), rel=0.6, abs=1e-3)


def test_noise_is_estimated_from_one_channel():
    run = measure(RIGID, EVEN, noise=0.01)
    alone = replace(run, H=run.H[:, 1:2], std=None, channels=(Channel(2),))
    assert estimate_noise(alone).relative == pytest.approx([0.01], rel=WITHIN)


def test_noise_that_does_not_grow_with_the_response_is_told_from_noise_that_does():
    run = measure(RIGID, EVEN, noise=0.0)
    H = run.H[:, 1:6]
    floor = 0.02 * np.median(np.abs(H), axis=0)
    rng = np.random.default_rng(5)
    noisy = replace(run, H=H + floor * circular(rng, H.shape), std=None, channels=CHANNELS[1:6])
    found = estimate_noise(noisy).std
    large = np.abs(H) > 3 * np.median(np.abs(H), axis=0)
    ratio = (found / floor)[large]
    assert np.median(ratio) == pytest.approx(1, rel=0.5)  # a relative error would be ten times too large here
    assert np.median(found / floor) == pytest.approx(1, rel=WITHIN)


def test_data_without_noise_have_next_to_none():
    for lines in (EVEN, None):
        assert np.nanmax(estimate_noise(measure(RIGID, lines, noise=0.0)).relative) < 1e-4


@pytest.mark.parametrize("magnitude", [False, True])
def test_a_quarter_of_wild_lines_does_not_spoil_a_mean_square(magnitude):
    rng = np.random.default_rng(0)
    e = rng.standard_normal(20000) if magnitude else circular(rng, 20000)
    assert mean_square(np.abs(e) ** 2, magnitude=magnitude) == pytest.approx(1, rel=0.03)
    e[:1000] *= 100
    assert mean_square(np.abs(e) ** 2, magnitude=magnitude) == pytest.approx(1, rel=0.2)


@pytest.mark.parametrize("factor", [1 / 3, 0.5, 2.0, 3.0])
def test_standard_errors_that_are_wrong_by_two_or_three_are_found(factor):
    run = measure(RIGID)
    assert run.std is not None
    (found,) = troubles(audit(in_campaign(replace(run, std=run.std * factor))))
    assert found.check == "noise"
    assert found.value == pytest.approx(1 / factor, rel=WITHIN)


def one_for_each_channel(std):
    return np.broadcast_to(np.median(std, axis=0), std.shape)


def from_repeats(repeats):
    freedom = 2 * (repeats - 1)
    return lambda std: std * np.sqrt(np.random.default_rng(1).chisquare(freedom, std.shape) / freedom)


@pytest.mark.parametrize(
    ("given_for", "said", "severity"),
    [
        (one_for_each_channel, "of its own", "warning"),
        *((from_repeats(n), "few repeats", severity) for n, severity in ((2, "warning"), (4, "warning"), (20, "note"))),
    ],
    ids=["one for each channel", "2 repeats", "4 repeats", "20 repeats"],
)
def test_errors_that_are_wrong_from_line_to_line_give_way_to_the_scatter(given_for, said, severity):
    run = measure(RIGID, noise=0.01)
    assert run.std is not None
    odd = replace(run, std=given_for(run.std))
    findings = audit(in_campaign(odd))
    (found,) = noted(findings, "noise")
    assert found.severity == severity
    assert troubles(findings) == [found] * (severity == "warning")
    assert said in found.words
    assert_array_equal(believed_errors(odd), estimate_noise(run).std)


@pytest.mark.parametrize(("step_hz", "told"), [(0.25, 1 / 0.7), (20.0, np.nan)])
def test_how_much_lines_scatter_over_their_errors_is_told_where_they_show_it(step_hz, told):
    run = measure(BEARING, np.arange(20.0, 401.0, step_hz), noise=0.01)
    assert scatter_over(run, 0.7 * np.asarray(run.std)) == pytest.approx(told, rel=0.1, nan_ok=True)


@pytest.mark.parametrize("step_hz", [15.0, 20.0, 30.0])
def test_lines_that_lie_too_far_apart_contradict_no_standard_errors(step_hz):
    """Two resonances between neighbouring lines are no noise."""
    run = measure(BEARING, np.arange(20.0, 401.0, step_hz), noise=0.01)
    assert not estimate_noise(run).resolved
    assert_array_equal(believed_errors(run), run.std)
    untold = believed_errors(replace(run, std=None))
    assert np.all(untold <= 0.03 * np.abs(run.H) * (1 + 1e-12))
    (finding,) = noted(audit(in_campaign(run)), "noise")
    assert "too far apart" in finding.words


@pytest.mark.parametrize("step_hz", [0.5, 2.0])
def test_lines_that_lie_close_enough_tell_the_noise(step_hz):
    assert estimate_noise(measure(BEARING, np.arange(20.0, 401.0, step_hz), noise=0.01)).resolved


def test_resonances_in_pairs_are_no_noise():
    """A window may hold forward and backward whirl."""
    turning = replace(BEARING, spin_speed=600.0)
    f = clustered(BEARING)
    H = np.hstack([measured_response(STRUCTURE, turning, (Gyroscopic(),), f, plane=k) for k in (1, 2)])
    std = 0.01 * np.abs(H)
    channels = tuple(Channel(node, plane) for plane in ("y", "z") for node in range(1, 8))
    H = H + std * circular(np.random.default_rng(3), H.shape)
    found = estimate_noise(Run(f, H, channels, "bearing", spin_rpm=5730.0))
    assert_allclose(found.relative.mean(), 0.01, rtol=0.1)


def test_errors_that_are_far_too_small_at_some_values_alone_give_way_there():
    run = measure(RIGID, noise=0.01)
    assert run.std is not None
    high = np.abs(run.H) > np.quantile(np.abs(run.H), 0.9)
    odd = replace(run, std=np.where(high, run.std / 10, run.std))
    (found,) = troubles(audit(in_campaign(odd)))
    assert "of its own" in found.words
    taken = believed_errors(odd)
    assert (taken[~high] >= run.std[~high]).all()
    assert_array_equal(taken[high], estimate_noise(run).std[high])


def test_channels_that_are_zero_say_nothing_of_the_errors_of_the_others():
    """A node that is held reads zero, with a standard error all the same."""
    run = measure(RIGID, noise=0.01)
    assert run.std is not None
    high = np.abs(run.H) > np.quantile(np.abs(run.H[:, 1:-1]), 0.9)
    odd = replace(run, std=np.where(high, run.std / 10, run.std))
    held = [0, len(run.channels) - 1]
    H, std = odd.H.copy(), odd.std.copy()  # type: ignore[union-attr]
    H[:, held], std[:, held] = 0.0, 0.1
    taken = believed_errors(replace(odd, H=H, std=std))
    inner = np.zeros(H.shape, dtype=bool)
    inner[:, 1:-1] = True
    assert (taken[~high & inner] >= run.std[~high & inner]).all()


def test_errors_that_the_scatter_bears_out_are_taken_as_they_are():
    run = measure(RIGID, noise=0.01)
    assert_array_equal(believed_errors(run), run.std)


def test_a_run_without_standard_errors_gets_the_estimate_said():
    (found,) = noted(audit(in_campaign(measure(RIGID, std=None, noise=0.01))), "noise")
    assert found.severity == "note"
    assert found.value == pytest.approx(0.01, rel=WITHIN)


# -- wild lines ------------------------------------------------------------------------------------


@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_wild_lines_are_found_and_left_out(condition):
    run = measure(condition, noise=0.01)
    places = [20, 60, 110, 111, 150, 200]
    H = run.H.copy()
    H[places] *= np.array([0.2, 1.5, 3.0, 0.5, 0.3, 2.0])[:, None]
    odd = replace(run, H=H)
    seen = np.flatnonzero(wild_lines(odd)).tolist()
    assert set(seen) <= set(places)
    assert len(seen) >= len(places) - 1  # next to a dense raster a line alone says little
    (found,) = troubles(audit(in_campaign(odd)), "missing_lines")
    assert found.value == len(seen)
    (tamed,) = without_wild_lines([odd])
    assert_array_equal(tamed.frequency_hz, run.frequency_hz)
    assert np.flatnonzero(np.isnan(tamed.H).all(axis=1)).tolist() == seen
    assert_array_equal(np.delete(tamed.H, seen, axis=0), np.delete(odd.H, seen, axis=0))


@pytest.mark.parametrize("factor", [0.3, 0.1, 1e-3])
def test_a_line_that_dropped_out_is_wild(factor):
    """So small a line has a small error as well, and would rule its neighbours' curve."""
    run = measure(RIGID, np.r_[np.arange(20.0, 400.5, 2.2)], noise=0.01)
    run.H[80] *= factor
    assert np.flatnonzero(wild_lines(run)).tolist() == [80]


def test_plain_wild_lines_are_found_in_magnitudes():
    run = measure(BEARING, noise=0.01)
    H = np.abs(run.H).astype(complex)
    H[[60, 150]] *= 3.0
    assert np.flatnonzero(wild_lines(replace(run, H=H, magnitude_only=True))).tolist() == [60, 150]


def test_a_slip_in_one_channel_is_a_wild_line():
    run = measure(RIGID, noise=0.01)
    run.H[70, 3] *= 1.3
    assert np.flatnonzero(wild_lines(run)).tolist() == [70]


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.05])
@pytest.mark.parametrize("frequency_hz", [None, EVEN, np.arange(20.0, 400.5, 4.0)])
def test_resonances_are_not_wild_on_any_raster(frequency_hz, noise):
    for condition in (replace(RIGID, shaft_damping_ratio=0.001), BEARING):
        assert not wild_lines(measure(condition, frequency_hz, noise=noise)).any()


def test_a_jump_and_the_ringing_of_a_sweep_are_not_wild():
    run = measure(RIGID, noise=0.005)
    jump = run.H.copy()
    jump[100:] *= 0.5
    ringing = run.H * (1 + 0.3 * np.cos(np.arange(len(run.H)) ** 1.5))[:, None]
    for H in (jump, ringing):
        assert not wild_lines(replace(run, H=H)).any()


# -- raster and lines ------------------------------------------------------------------------------


@pytest.mark.parametrize("magnitudes", [False, True])
@pytest.mark.parametrize("damping", [0.001, 0.005])
def test_damping_is_read_from_lines_a_hertz_apart(damping, magnitudes):
    run = measure(replace(RIGID, shaft_damping_ratio=damping), EVEN, noise=0.003)
    if magnitudes:
        run = replace(run, H=np.abs(run.H).astype(complex), magnitude_only=True)
    for found, true_hz in zip(CheckedRun(run, "").resonances, (100.561, 323.994), strict=True):
        assert found.frequency_hz == pytest.approx(true_hz, abs=4 * found.frequency_std_hz + 1e-3)
        assert found.damping_ratio == pytest.approx(damping, abs=4 * found.damping_std, rel=0.01)
        assert found.damping_std < 0.1 * damping


def test_a_raster_coarser_than_the_half_power_band_is_found():
    found = troubles(audit(in_campaign(measure(replace(RIGID, shaft_damping_ratio=0.001), EVEN))))
    assert [f.check for f in found] == ["raster", "raster"]
    assert all(f.value is not None and f.limit is not None and f.value < f.limit for f in found)


def test_where_lines_are_missing_next_to_a_resonance_the_raster_is_not_coarse():
    run = measure(RIGID)
    peak = CheckedRun(run, "").resonances[0]
    keep = np.abs(run.frequency_hz - peak.frequency_hz) > 0.4 * peak.half_power_hz
    thinned = replace(run, frequency_hz=run.frequency_hz[keep], H=run.H[keep], std=None)
    assert {f.severity for f in noted(audit(in_campaign(thinned)), "raster")} == {"note"}


def test_believed_damping_serves_where_the_lines_do_not_tell():
    run = measure(replace(RIGID, shaft_damping_ratio=0.0005), np.arange(20.0, 400.0, 6.0), noise=0.02)
    (one, *_) = CheckedRun(run, "").resonances
    unresolved = replace(one, damping_ratio=float("nan"))
    assert CheckedRun(run, "").half_power_hz(unresolved, NominalBelief(0.01)) == pytest.approx(0.02 * one.frequency_hz)
    assert np.isnan(CheckedRun(run, "").half_power_hz(unresolved, NominalBelief(0.0)))


def test_a_hole_in_the_raster_is_found_and_one_over_a_resonance_is_worse():
    run = measure(RIGID, EVEN)

    def without(low, high):
        keep = (run.frequency_hz < low) | (run.frequency_hz > high)
        cut = replace(run, frequency_hz=run.frequency_hz[keep], H=run.H[keep], std=None)
        return noted(audit(in_campaign(cut)), "missing_lines")

    assert [f.severity for f in without(200.5, 210.5)] == ["note"]
    assert [f.severity for f in without(318.5, 322.5)] == ["warning"]
    assert [f.value for f in without(199.9, 200.1)] == [2.0]


def test_lines_without_a_number_are_counted():
    run = measure(RIGID)
    H = run.H.copy()
    H[[10, 20, 30], 3] = np.nan
    (found,) = troubles(audit(in_campaign(replace(run, H=H))))
    assert (found.check, found.value) == ("missing_lines", 3)


# -- channels --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "severity"),
    [
        (lambda h: 0 * h, "error"),
        (lambda h: 0 * h + 0.3, "error"),
        (lambda h: 0 * h + np.nan, "error"),
        (lambda h: np.median(np.abs(h)) * circular(np.random.default_rng(1), h.shape), "warning"),
        (lambda h: 1e-6 * h, "warning"),
    ],
    ids=["zero", "constant", "nan", "noise only", "tiny"],
)
def test_a_channel_that_carries_no_response_is_found(make, severity):
    run = measure(RIGID, std=None)
    H = run.H.copy()
    H[:, 3] = make(H[:, 3])
    found = troubles(audit(in_campaign(replace(run, H=H))), "channels")
    assert [f.severity for f in found] == [severity]
    assert "node4" in found[0].words


def test_zero_is_right_at_a_rigid_support_and_motion_is_not():
    run = measure(RIGID, std=None)
    assert not noted(audit(in_campaign(run)), "channels")
    H = run.H.copy()
    H[:, 0] = 0.1 * H[:, 1]
    (found,) = noted(audit(in_campaign(replace(run, H=H))), "channels")
    assert found.severity == "note"
    assert "gives way" in found.words


# -- saturation and ringing ------------------------------------------------------------------------


def test_a_sensor_that_clips_is_found():
    run = measure(RIGID, noise=0.002, std=None)
    H = run.H.copy()
    H[:, 2] /= np.maximum(np.abs(H[:, 2]) / (0.4 * np.abs(H[:, 2]).max()), 1)
    found = troubles(audit(in_campaign(replace(run, H=H))), "saturation")
    assert found
    assert all("channel node3:" in f.words for f in found)


def test_a_motion_that_is_held_is_found_in_all_channels():
    run = measure(RIGID, noise=0.002, std=None)
    size = np.linalg.norm(run.H, axis=1) * (run.frequency_hz < 200)
    held = run.H / np.maximum(size / (0.5 * size.max()), 1)[:, None]
    (found,) = troubles(audit(in_campaign(replace(run, H=held))), "saturation")
    assert "all channels" in found.words


def test_lines_that_repeat_are_found():
    run = measure(RIGID)
    H = run.H.copy()
    H[100] = H[99]
    (found,) = troubles(audit(in_campaign(replace(run, H=H))), "saturation")
    assert found.value == 1


HALF_HERTZ = np.arange(20.0, 400.0, 0.5)


def swept_fast(frequency_hz, dwell_s, direction, noise=0.005):
    """Every line is read ``dwell_s`` after its frequency was set; modes on rigid supports, exact between steps."""
    system = build_system(STRUCTURE, RIGID)
    drive = system.unit_vector(2, 1)
    w_r, zeta = system.modes.omega, RIGID.shaft_damping_ratio
    w_d = w_r * np.sqrt(1 - zeta**2)
    pole = -zeta * w_r + 1j * w_d
    residue = (system.read_out(1) @ system.modes.Phi) * (drive @ system.modes.Phi) / (2j * w_d)  # (n_nodes, n_modes)
    run = measure(RIGID, frequency_hz, noise=noise, sweep=direction)
    H, state, phase = run.H.copy(), np.zeros_like(pole), 1.0 + 0j
    for line in np.argsort(frequency_hz) if direction == "up" else np.argsort(-frequency_hz):
        s = 2j * np.pi * frequency_hz[line]
        left = np.exp(pole * dwell_s) * (state - phase / (s - pole))
        phase *= np.exp(s * dwell_s)
        state = phase / (s - pole) + left
        H[line] += s**2 * (residue @ left) / phase
    return replace(run, H=H)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_beats_behind_a_peak_are_found(direction):
    found = troubles(audit(in_campaign(swept_fast(HALF_HERTZ, 0.05, direction))), "sweep_rate")
    assert len(found) == 1
    assert ("above" in found[0].words) == (direction == "up")


@pytest.mark.parametrize("direction", ["up", "down"])
@pytest.mark.parametrize("dwell_s", [0.3, 0.5])
def test_a_peak_that_has_not_settled_is_noted(dwell_s, direction):
    (found,) = noted(audit(in_campaign(swept_fast(HALF_HERTZ, dwell_s, direction))), "sweep_rate")
    assert found.severity == "note"
    assert (found.value or 0) > 3


@pytest.mark.parametrize("direction", ["up", "down"])
def test_a_settled_sweep_has_no_ringing(direction):
    assert not noted(audit(in_campaign(swept_fast(HALF_HERTZ, 5.0, direction))), "sweep_rate")


# -- phase -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [1e-4, -3e-4, 2e-3])
@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_a_delay_of_all_sensors_is_found(delay, condition):
    run = measure(condition, effects=(SensorDelay(delay=delay),))
    (found,) = troubles(audit(in_campaign(run)))
    assert found.check == "delay"
    assert found.value == pytest.approx(delay, abs=5e-6)


def test_a_delay_of_one_sensor_is_found():
    run = measure(RIGID, effects=(SensorDelay(delay=2e-4, node=4),))
    (found,) = troubles(audit(in_campaign(run)))
    assert (found.check, "node4" in found.words) == ("delay", True)
    assert found.value == pytest.approx(2e-4, abs=5e-6)


@pytest.mark.parametrize("node", [2, 3, 6])
@pytest.mark.parametrize("condition", [RIGID, BEARING])
@pytest.mark.parametrize("delay", [0.0, 1e-3])
def test_an_inverted_sensor_is_found(node, condition, delay):
    run = measure(condition, effects=(SensorDelay(delay=delay),) if delay else ())
    turned = replace(run, H=run.H * np.where(np.arange(1, 8) == node, -1, 1))
    (found,) = troubles(audit(in_campaign(turned)), "sign", "channels", "units")
    assert (found.check, f"node{node}" in found.words) == ("sign", True)


def test_a_delay_that_bent_peaks_feign_inverts_no_sensor():
    run = measure(RIGID, EVEN[68:])
    prepared = CheckedRun(run, "run")
    feigned = Delays(np.arange(5), np.full(5, 5e-3), np.full(5, 1e-5), 0.0)
    turned = prepared.receptance * np.exp(2j * np.pi * prepared.f[:, None] * 5e-3)
    assert min(_drive_sign(prepared, turned).values()) < 0
    assert [f.severity for f in check_sign(prepared, geometry_of(RIG), feigned)] == ["ok"]


def test_an_inverted_force_is_found():
    run = measure(BEARING)
    (found,) = troubles(audit(in_campaign(replace(run, H=-run.H))))
    assert found.check == "sign"
    assert "force signal" in found.words


def test_the_drive_point_tells_its_sign_without_low_lines():
    run = measure(RIGID, EVEN[68:])
    assert not troubles(audit(in_campaign(run)), "sign")
    turned = replace(run, H=run.H * np.where(np.arange(1, 8) == 2, -1, 1))
    assert len(troubles(audit(in_campaign(turned)), "sign")) == 1


def test_a_band_round_one_resonance_says_nothing_of_units_and_names():
    """There a rotor that is 3 % stiffer than drawn has a tenth of the response, and another shape."""
    (mode, *_) = damped_modes(build_system(STRUCTURE, RIGID)).frequency_hz
    lines = mode * np.linspace(0.98, 1.02, 41)
    stiffer = measure(RIGID, lines, drift=-0.03)
    assert not [f for f in audit(in_campaign(stiffer)) if f.check in ("labels", "units")]


@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_units_of_g_are_found(condition):
    run = measure(condition)
    (found,) = troubles(audit(in_campaign(replace(run, H=run.H / 9.81, std=None))))
    assert (found.check, "g instead" in found.words) == ("units", True)


@pytest.mark.parametrize(("factor", "hint"), [(9.81, None), (1e3, "kN instead of N"), (1e-3, None)])
def test_a_unit_is_guessed_only_where_it_errs_in_that_direction(factor, hint):
    run = measure(RIGID)
    (found,) = troubles(audit(in_campaign(replace(run, H=run.H * factor, std=None))))
    assert ("instead of" in found.words) == (hint is not None)
    assert hint is None or hint in found.words


@pytest.mark.parametrize("condition", [RIGID, BEARING])
@pytest.mark.parametrize("factor", [np.sqrt(2), 1 / np.sqrt(2)])
def test_effective_values_over_peak_values_are_found(condition, factor):
    run = measure(condition)
    (found,) = troubles(audit(in_campaign(replace(run, H=run.H * factor, std=None))))
    assert (found.check, found.severity, "RMS" in found.words) == ("units", "warning", True)


@pytest.mark.parametrize("drive", [1, 7])
def test_a_force_on_a_rigid_support_is_no_unit(drive):
    """The drawing says that nothing moves then."""
    run = replace(measure(RIGID), excitation_node=drive).with_channels([1, 3])  # too few to find the right node
    assert not [f for f in audit(in_campaign(run)) if f.check == "units"]


@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_conjugated_responses_are_found(condition):
    run = measure(condition)
    found = troubles(audit(in_campaign(replace(run, H=run.H.conj()))))
    assert [f.check for f in found] == ["sign"], found
    assert "conjugated" in found[0].words


@pytest.mark.parametrize("condition", [RIGID, BEARING])
@pytest.mark.parametrize("nodes", [(2, 4, 6), (3,)])
@pytest.mark.parametrize("quantity", ["mobility", "receptance"])
def test_another_quantity_is_found(condition, nodes, quantity):
    run = measure(condition).with_channels([node - 1 for node in nodes])
    velocity = 2j * np.pi * run.frequency_hz[:, None]
    H = run.H / (velocity if quantity == "mobility" else velocity**2)
    (found,) = troubles(audit(in_campaign(replace(run, H=H, std=None))))
    assert (found.check, f"those of a {quantity}" in found.words) == ("labels", True), found


@pytest.mark.parametrize(("unit", "factor"), [("rad/s", 2 * np.pi), ("rev/min", 60), ("kHz", 1e-3)])
@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_frequencies_in_another_unit_are_found(condition, unit, factor):
    run = measure(condition)
    found = noted(audit(in_campaign(replace(run, frequency_hz=factor * run.frequency_hz))), "labels")
    assert [f"in {unit}" in f.words for f in found] == [True], found


@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_channels_of_noise_have_no_names(condition):
    run = measure(condition).with_channels([1, 2, 4])
    noise = circular(np.random.default_rng(1), run.H.shape) * run.frequency_hz[:, None] ** 2
    assert not noted(audit(in_campaign(replace(run, H=noise, std=None))), "labels")
    stuck = replace(run, H=np.full_like(run.H, 0.3 + 0.1j), std=None)
    assert not noted(audit(in_campaign(stuck)), "labels")


def test_one_run_that_stands_twice_is_found_and_used_once():
    run = measure(BEARING)
    twice = in_campaign(run, replace(run, name="again"))
    (found,) = troubles(audit(twice))
    assert (found.check, "same values" in found.words) == ("repeatability", True)
    assert [left.name for left in usable(twice).runs] == [run.name]
    louder = in_campaign(run, replace(run, name="louder", force_amplitude_N=3.0))
    assert len(usable(louder).runs) == 2  # of a linear rotor without noise


# -- names -----------------------------------------------------------------------------------------


def named(run, names):
    """The run with its channels named so."""
    return replace(run, channels=tuple(map(Channel, names)))


@pytest.mark.parametrize("condition", [RIGID, BEARING])
@pytest.mark.parametrize(
    ("names", "said"),
    [
        ((1, 2, 6, 4, 5, 3, 7), "nodes 3 and 6 look like each other's"),
        ((1, 2, 3, 5, 4, 6, 7), "nodes 4 and 5 look like each other's"),
        ((2, 3, 4, 5, 6, 7, 1), "look like those of nodes"),
    ],
)
def test_sensors_with_exchanged_names_are_found(condition, names, said):
    (found,) = [f for f in audit(in_campaign(named(measure(condition), names))) if f.check == "labels"]
    assert (found.severity, said in found.words) == ("error", True), found.words


@pytest.mark.parametrize("condition", [RIGID, BEARING])
@pytest.mark.parametrize("quantity", ["accelerance", "acceleration"])
def test_another_exciter_is_found(condition, quantity):
    run = replace(measure(replace(condition, excitation_node=4)), excitation_node=2, quantity=quantity)
    (found,) = noted(audit(in_campaign(run)), "labels")
    assert "force at node 4, not 2" in found.words


@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_a_rotor_that_is_counted_from_its_other_end_is_found(condition):
    """On a symmetric rotor that is the same as a force at the other end."""
    (found,) = noted(audit(in_campaign(named(measure(condition), range(7, 0, -1)))), "labels")
    assert "force at node 6, not 2: " in found.words or "look like those of nodes" in found.words


def test_exchanged_supports_are_found():
    runs = measure(RIGID), measure(BEARING, seed=1)
    assert not noted(audit(in_campaign(*runs)), "labels")
    turned = [replace(run, support="rigid" if run.support == "bearing" else "bearing") for run in runs]
    (found,) = [f for f in noted(audit(in_campaign(*turned)), "labels") if "," in f.run]
    assert "names of the supports" in found.words


def test_supports_that_were_not_changed_are_found():
    soft = replace(BEARING, k_b=5e5)
    runs = measure(soft), replace(measure(soft, seed=1), support="rigid")
    (found,) = [f for f in noted(audit(in_campaign(*runs)), "labels") if "," in f.run]
    assert "whether the supports were changed" in found.words


def test_a_hum_below_the_first_resonance_exchanges_no_supports():
    runs = measure(RIGID, EVEN), measure(BEARING, EVEN, seed=1)
    hum = np.exp(-(((EVEN - 50) / 0.7) ** 2))
    loud = replace(runs[0], H=runs[0].H + 5 * np.median(np.abs(runs[0].H)) * hum[:, None])
    assert checked_runs([loud])[0].resonances[0].frequency_hz == pytest.approx(50, abs=1)
    assert not noted(audit(in_campaign(loud, runs[1])), "labels")


@pytest.mark.parametrize("condition", [RIGID, BEARING])
@pytest.mark.parametrize(("factor", "size", "unit"), [(1 / 9.81, "small", "g and m/s^2"), (100, "large", "amplifier")])
def test_a_sensor_in_another_unit_or_range_is_found(condition, factor, size, unit):
    run = measure(condition, noise=0.01)
    factors = np.where(np.arange(1, 8) == 5, factor, 1)
    (found,) = noted(audit(in_campaign(replace(run, H=run.H * factors, std=run.std * factors))), "labels")
    assert "responses of node 5 are" in found.words
    assert f"times too {size}" in found.words
    assert unit in found.words


LINEAR = [effect for effect in EFFECTS.values() if effect.family not in ("nonlinear", "spinning")]


@pytest.mark.parametrize("end", [pytest.param("low", marks=pytest.mark.long), "high"])
@pytest.mark.parametrize("effect", every_second_is_long(LINEAR), ids=lambda effect: effect.id)
@pytest.mark.parametrize("node", [4, *(pytest.param(node, marks=pytest.mark.long) for node in (2, 6))])
def test_no_linear_effect_passes_for_a_wrong_name(effect, end, node):
    ends = {name: SCALE.ends(role) for name, role in effect.parameters().items() if not role.form}
    numbers = {name: both[end == "high"] for name, both in ends.items()}
    places = {name: node if place.kind == "node" else 0.05 * node for name, place in effect.places().items()}
    made = effect(**numbers, **places)
    conditions = RIGID, replace(BEARING, k_b=1e6), replace(BEARING, k_b=2e7)
    runs = [measure(condition, EVEN, effects=(made,)) for condition in conditions]
    assert not noted(audit(in_campaign(*runs)), "labels")


# -- pairs -----------------------------------------------------------------------------------------


def exchanged(gain=1.0, effects=()):
    """Exciter at 2 and at 5."""
    one = measure(BEARING, EVEN)
    two = measure(replace(BEARING, excitation_node=5), EVEN, seed=1, effects=effects)
    return in_campaign(one, replace(two, H=two.H * gain))


def test_reciprocity_holds_and_a_wrong_gain_or_sign_breaks_it():
    assert not troubles(audit(exchanged()), "reciprocity")
    (gain,) = troubles(audit(exchanged(1.3)), "reciprocity")
    assert gain.value == pytest.approx(1 / 1.3 - 1, abs=0.01)
    (sign,) = troubles(audit(exchanged(-1)), "reciprocity")
    assert sign.severity == "error"


def test_an_inverted_sensor_is_one_whatever_side_of_the_circle_its_noise_is_on():
    """Phases near +pi and near -pi have a median near zero."""
    few = np.linspace(20, 400, 60)
    for seed in range(0, 40, 2):
        one = measure(BEARING, few, seed=seed)
        two = measure(replace(BEARING, excitation_node=5), few, seed=seed + 1)
        (sign,) = troubles(audit(in_campaign(one, replace(two, H=-two.H))), "reciprocity")
        assert sign.severity == "error"


def test_a_resonance_that_moved_between_repeats_is_found():
    one, two = measure(BEARING), measure(BEARING, seed=1, drift=-2e-3)
    (found,) = troubles(audit(in_campaign(one, two)))
    assert found.check == "repeatability"
    assert found.value == pytest.approx(2e-3, rel=0.2)


DRIFT = 1e-3


def repeated(drifts, **settings):
    """Runs of one test whose resonances lie a little higher or lower."""
    return [measure(BEARING, seed=k, drift=drift, **settings) for k, drift in enumerate(drifts)]


def test_a_drift_that_is_learned_is_what_repeats_show_among_themselves():
    """Six runs of a rig whose resonances drift ten times as much as is usual."""
    runs = repeated(DRIFT * np.random.default_rng(1).standard_normal(6))
    assert not troubles(audit(in_campaign(*runs)), "repeatability")
    fine = [f for f in audit(in_campaign(*runs)) if (f.check, f.severity) == ("repeatability", "ok")]
    assert len(fine) == 5
    (shown,) = re.findall(r"drifts of ([\d.]+) %", fine[0].words)
    assert 0.5 * DRIFT < float(shown) / 100 < 2 * DRIFT
    stated = NominalBelief(frequency_drift=1e-4)
    assert troubles(audit(in_campaign(*runs, nominal=stated)), "repeatability")


def test_a_run_that_moved_far_more_than_the_others_is_found_beside_a_learned_drift():
    drifts = DRIFT * np.random.default_rng(1).standard_normal(6)
    drifts[3] = 0.02
    found = troubles(audit(in_campaign(*repeated(drifts))), "repeatability")
    assert [f.run for f in found] == ["bearing-2, bearing-3", "bearing-3, bearing-4"]


def test_levels_that_differ_by_the_drift_of_repeats_are_no_dependence_on_amplitude():
    runs = repeated(DRIFT * np.random.default_rng(1).standard_normal(6), force_amplitude_N=1.0)
    high = measure(BEARING, seed=9, drift=2 * DRIFT, force_amplitude_N=5.0)
    assert not noted(audit(in_campaign(*runs, high)), "level")
    assert noted(audit(in_campaign(runs[0], high)), "level")
    far = measure(BEARING, seed=9, drift=0.02, force_amplitude_N=5.0)
    assert noted(audit(in_campaign(*runs, far)), "level")


def test_repeats_of_a_rig_without_errors_of_gain_may_differ_by_their_noise():
    one, two = measure(BEARING), measure(BEARING, seed=1)
    belief = NominalBelief(gain_tolerance=0.0)
    assert not troubles(audit(in_campaign(one, two, nominal=belief)), "repeatability")


def test_what_noise_explains_is_the_same_whatever_the_phase():
    """A phase near 180 degrees is at both ends of the circle; that is no slope."""
    one, two = measure(BEARING), measure(BEARING, seed=1)
    ratios = []
    for turn in (1.0, 1j):
        a, b = checked_runs((replace(one, H=turn * one.H), replace(two, H=turn * two.H)))
        found = compare(a, b, [(c, c) for c in a.channels], 1e-4)
        assert found
        ratios.append(found.ratio)
        assert found.expected < 0.02
    assert ratios[0] == pytest.approx(ratios[1], rel=1e-6)


def test_a_gain_that_changed_between_repeats_is_found():
    one, two = measure(BEARING), measure(BEARING, seed=1, gain=1.2)
    (found,) = troubles(audit(in_campaign(one, two)))
    assert (found.check, "gain" in found.words) == ("repeatability", True)


def test_one_sensor_that_changed_between_repeats_is_found():
    one, two = measure(BEARING), measure(BEARING, seed=1, gain=np.array([1, 1, 1, 1, 1, 1.2, 1.0]))
    found = troubles(audit(in_campaign(one, two)))
    assert [f.check for f in found] == ["repeatability"]
    assert "node6" in found[0].words


def test_amplitude_dependence_is_noted_with_its_trend():
    low = measure(BEARING, force_amplitude_N=1.0)
    stiffer = replace(BEARING, k_b=6e6, bearing_damping=40.0)
    high = measure(stiffer, seed=1, force_amplitude_N=5.0)
    found = noted(audit(in_campaign(low, high)), "level")
    assert found
    assert {f.severity for f in found} == {"note"}
    assert any((f.value or 0) > 1e-3 and "amplitude" in f.words for f in found)


def test_peaks_that_bend_are_not_taken_for_late_sensors():
    """A delay in one channel is said of a linear rig, and withheld where the levels differ."""
    low = measure(BEARING, force_amplitude_N=1.0)
    late = np.exp(-2j * np.pi * low.frequency_hz * 2e-4)
    stiffer = replace(BEARING, k_b=6e6, bearing_damping=40.0)
    for condition, said in ((BEARING, True), (stiffer, False)):
        high = measure(condition, seed=1, force_amplitude_N=5.0)
        high = replace(high, H=high.H * np.where(np.arange(high.H.shape[1]) == 2, late[:, None], 1.0), name="high")
        found = noted(audit(in_campaign(replace(low, name="low"), high)), "delay")
        late_ones = [f.words for f in found if f.run == "high" and f.severity == "warning"]
        assert bool(late_ones) is said
        assert any(f.run == "high" and "bend with the force" in f.words for f in found) is not said


def gone(runs):
    return [f for f in audit(in_campaign(*runs)) if "gone" in f.words]


def test_a_resonance_that_is_elsewhere_at_a_higher_force_is_noted():
    soft, stiff = replace(BEARING, k_b=1e6), replace(BEARING, k_b=3e6)
    low, high = measure(soft, force_amplitude_N=1.0), measure(stiff, seed=1, force_amplitude_N=5.0)
    first = gone([low, high])[0]
    frequency = float(first.words.split(" Hz")[0].split()[-1])
    resonances = [undamped_modes(build_system(STRUCTURE, each)).omega / (2 * np.pi) for each in (soft, stiff)]
    assert min(np.abs(resonances[0] / frequency - 1)) < 2e-3
    assert min(np.abs(resonances[1] / frequency - 1)) == pytest.approx(abs(first.value or 0), abs=2e-3)
    below = (high.frequency_hz > 0.9 * frequency) & (high.frequency_hz < frequency)
    std = None if high.std is None else high.std[~below]
    unseen = replace(high, H=high.H[~below], std=std, frequency_hz=high.frequency_hz[~below])
    assert not any(f"{frequency:.4g} Hz" in f.words for f in gone([low, unseen]))


@pytest.mark.parametrize("step", [0.005, 0.02, 0.05])
def test_a_resonance_between_coarse_lines_is_not_gone(step):
    coarse = np.exp(np.arange(np.log(20), np.log(400), step))
    low, high = measure(BEARING, force_amplitude_N=1.0), measure(BEARING, coarse, seed=1, force_amplitude_N=5.0)
    assert not gone([low, high])


def test_up_and_down_are_compared():
    runs = [measure(BEARING, sweep="up"), measure(BEARING, seed=1, sweep="down", drift=-3e-3)]
    (found,) = troubles(audit(in_campaign(*runs)))
    assert found.check == "sweep_direction"


# -- what was not measured -------------------------------------------------------------------------


def words(findings):
    return " ".join(f.words for f in noted(findings, "coverage"))


def test_what_was_not_measured_is_said():
    full = measure(RIGID, std=None)
    alone = replace(full, H=full.H[:, 2:3], channels=CHANNELS[2:3], force_amplitude_N=None, quantity="acceleration")
    said = words(audit(in_campaign(replace(alone, H=np.abs(alone.H).astype(complex), magnitude_only=True))))
    for part in (
        "Only rigid",
        "one node",
        "Magnitudes only",
        "not referred",
        "not recorded",
        "drive point",
        "one force",
    ):
        assert part in said
    fewer = replace(full, H=full.H[:, 1:4], channels=CHANNELS[1:4])
    assert "Nodes 5 and 6 carried no sensor" in words(audit(in_campaign(fewer)))


def test_lists_of_resonances_alone_are_an_audit_too():
    peaks = PeakList("rigid", np.array([95.0, 320.0]), np.array([1.5, 3.0]))
    findings = audit(in_campaign(peaks=(peaks,)))
    assert "only lists of resonances" in words(findings)
    assert not troubles(findings)
    assert troubles(audit(in_campaign()), "coverage")


# -- odd data --------------------------------------------------------------------------------------


@given(
    n=st.integers(1, 40),
    channels=st.integers(1, 4),
    seed=st.integers(0, 10**6),
    magnitudes=st.booleans(),
    std=st.sampled_from([None, "ones", "zero", "nan", "negative"]),
    spoil=st.sampled_from(["nothing", "nan", "inf", "zero", "zero lines", "huge", "steps", "all nan"]),
    rig=st.sampled_from([RIG, "no such rig.toml"]),
    quantity=st.sampled_from(["accelerance", "receptance", "mobility", "acceleration"]),
)
def test_odd_data_are_never_an_error(n, channels, seed, magnitudes, std, spoil, rig, quantity):
    rng = np.random.default_rng(seed)
    H = circular(rng, (n, channels)) * 10 ** rng.uniform(-9, 9)
    spoilt = rng.random(H.shape) < 0.2
    change = {"nan": np.nan, "inf": np.inf, "zero": 0.0, "huge": 1e300}
    if spoil in change:
        H[spoilt] = change[spoil]
    elif spoil == "zero lines":
        H[spoilt[:, 0]] = 0
    elif spoil == "steps":
        H = np.round(H / np.abs(H).max(), 1).astype(complex)
    elif spoil == "all nan":
        H[:] = np.nan
    H = np.abs(H).astype(complex) if magnitudes else H
    errors = {"ones": 1.0, "zero": 0.0, "nan": np.nan, "negative": -1.0}
    run = Run(
        np.cumsum(rng.exponential(size=n)) + 1e-3,
        H,
        tuple(Channel(int(k) + 1, "z" if k % 2 else "y") for k in rng.permutation(9)[:channels]),
        "rigid" if seed % 2 else "bearing",
        std=None if std is None else np.full(H.shape, errors[std]),
        quantity=quantity,
        magnitude_only=magnitudes,
        excitation_node=1 + seed % 9,
        force_amplitude_N=None if seed % 5 == 0 else 1.0,
        sweep=[None, "up", "down"][seed % 3],
    )
    other = replace(run, excitation_node=2, force_amplitude_N=3.0)
    found = audit(Campaign("odd", rig, (run, other, run), nominal=NominalBelief(gain_tolerance=0, frequency_drift=0)))
    assert found
    noise = estimate_noise(run)
    assert noise.std.shape == H.shape
    assert not (noise.std < 0).any()


def test_a_node_that_is_held_in_every_run_is_not_a_dead_channel():
    """The cantilever of the examples: clamped at node 1, a bearing at node 3."""
    rig = load_rig(OWN_ROTOR)
    structure, f = assemble(rig), np.arange(20.0, 300.0, 0.25)
    H = measured_response(structure, Condition(excitation_node=rig.excitation_node), (), f)
    channels = tuple(Channel(node) for node in range(1, structure.n_nodes + 1))
    run = Run(f, H, channels, "bearing", excitation_node=rig.excitation_node)
    assert not troubles(audit(Campaign("own", OWN_ROTOR, (run,))), "channels")


@pytest.mark.parametrize("size", [0.0, 1e-7, 1e-3])
def test_channels_across_the_force_of_a_round_rotor_may_read_nothing_or_noise(size):
    run = measure(BEARING, noise=0.01)
    across = size * np.abs(run.H).max() * circular(np.random.default_rng(3), run.H.shape)
    channels = (*run.channels, *(Channel(c.node, "z") for c in run.channels))
    both = replace(run, H=np.hstack([run.H, across]), channels=channels, std=None)
    assert not troubles(audit(in_campaign(both)), "channels")


def test_runs_without_a_common_channel_are_not_said_to_lack_lines():
    run = measure(BEARING, noise=0.01)
    halves = [run.with_channels(places) for places in ((0, 1, 2), (3, 4, 5, 6))]
    (finding,) = noted(audit(in_campaign(*halves)), "repeatability")
    assert "share no channel" in finding.words


def test_a_node_that_must_move_against_the_force_is_not_inverted():
    """On its rigid bearing, the overhung end pushed down lifts node 2 between clamp and bearing."""
    rig = load_rig(OWN_ROTOR)
    condition = Condition(rigid_support=True, excitation_node=rig.excitation_node, shaft_damping_ratio=0.005)
    f = np.arange(20.0, 300.0, 0.2)
    H = measured_response(assemble(rig), condition, (), f)
    assert H[0, 1].real * H[0, 3].real < 0
    channels = tuple(Channel(node) for node in range(1, 6))
    run = Run(f, H * (1 + 0.002 * circular(np.random.default_rng(0), H.shape)), channels, "rigid", excitation_node=4)
    assert not troubles(audit(Campaign("own", OWN_ROTOR, (run,))), "sign")
    turned = replace(run, H=run.H * np.array([1, -1, 1, 1, 1]))
    (found,) = troubles(audit(Campaign("own", OWN_ROTOR, (turned,))), "sign")
    assert "node2" in found.words


def test_lists_beside_runs_are_not_counted_as_measured():
    lists = (PeakList("bearing", np.array([80.0, 200.0]), np.array([1.0, 1.0])),)
    found = [f.words for f in audit(in_campaign(measure(RIGID), peaks=lists)) if f.check == "coverage"]
    assert any(words.startswith("Only rigid supports were measured") for words in found)
    assert any(words.startswith("Lists of resonances beside runs are not used") for words in found)


# -- what instruments write where they have no value -------------------------------------------------------


def on_lines(n, **settings):
    """A rigid run on so many even lines, 1 % noise."""
    return measure(RIGID, np.linspace(20.0, 400.0, n), noise=0.01, **settings)


def test_an_exact_zero_between_others_is_a_value_that_was_dropped():
    run = on_lines(200)
    H = run.H.copy()
    H[60], H[80:110, 2], H[:, 4] = 0, 0, 0
    (left,) = usable(in_campaign(replace(run, H=H))).runs
    assert [channel.node for channel in left.channels] == [1, 2, 3, 4, 6, 7]  # 5 is dead, 1 and 7 are held
    assert np.isnan(left.H[60, 1:5]).all()
    assert np.isnan(left.H[80:110, 2]).all()
    assert np.count_nonzero(np.isnan(left.H)) == 4 + 30
    (found,) = troubles(audit(in_campaign(replace(run, H=H))), "missing_lines")
    assert found.value == 31


def test_a_standard_error_of_zero_is_none():
    run = on_lines(200)
    std = run.std.copy()
    std[::10] = 0
    for stated in (std, 0 * std):
        believed = believed_errors(replace(run, std=stated))[:, 1:-1]
        assert_allclose(np.median(believed / run.std[:, 1:-1]), 1, rtol=0.2)
        assert np.min(believed / run.std[:, 1:-1]) > 0.5


@pytest.mark.parametrize("n", [8, 10, 12, 16])
@pytest.mark.parametrize("magnitude", [False, True])
def test_a_few_lines_do_not_tell_their_noise(n, magnitude):
    run = on_lines(n)
    run = replace(run, H=np.abs(run.H).astype(complex), magnitude_only=True) if magnitude else run
    assert_array_equal(believed_errors(run), run.std)
    assert np.max(believed_errors(replace(run, std=None))[:, 1:-1] / np.abs(run.H[:, 1:-1])) < 0.05
    assert not wild_lines(run).any()


@pytest.mark.parametrize("zeta", [0.001, 0.005])
@pytest.mark.parametrize("spacing", [2.0, 1.0, 0.5])
def test_peaks_and_dips_of_magnitudes_are_not_wild(zeta, spacing):
    for condition in (replace(RIGID, shaft_damping_ratio=zeta), replace(BEARING, shaft_damping_ratio=zeta)):
        run = measure(condition, np.arange(20.0, 400.5, spacing), noise=0.005)
        assert not wild_lines(replace(run, H=np.abs(run.H).astype(complex), magnitude_only=True)).any()


def test_four_slips_in_a_hundred_lines_are_still_slips():
    run = on_lines(200)
    H, places = run.H.copy(), np.array([5, 27, 60, 77, 101, 133, 150, 190])
    H[places] *= 5
    assert np.flatnonzero(wild_lines(replace(run, H=H))).tolist() == places.tolist()


def test_one_wild_value_does_not_silence_the_other_channels():
    run = on_lines(200)
    run.H[70, 3] *= 1e6
    assert usable(in_campaign(run)).runs[0].channels == run.channels
    assert np.flatnonzero(wild_lines(run)).tolist() == [70]


def test_a_sensor_that_carries_noise_alone_is_left_out_where_there_are_others():
    run = measure(BEARING, noise=0.01)
    H = run.H.copy()
    H[:, 2] = 0.02 * np.median(np.abs(H[:, 0])) * circular(np.random.default_rng(1), len(H))
    (left,) = usable(in_campaign(replace(run, H=H))).runs
    assert left.channels == tuple(channel for channel in CHANNELS if channel != Channel(3))
    alone = replace(run, H=H).with_channels([2])
    assert usable(in_campaign(alone)).runs[0].channels == (Channel(3),)


def test_lines_that_are_not_compared_have_no_phase():
    """An inverted sensor shows on the few lines whose noise is small."""
    one = measure(BEARING, noise=0.01)
    two = replace(one, H=-one.H)
    loud = np.arange(len(one.H)) % 3 > 0
    std = np.where(loud[:, None], np.abs(one.H), one.std)
    a, b = checked_runs((one, two))
    a.__dict__["std"] = std[:, a.live]
    found = compare(a, b, [(c, c) for c in a.channels], 1e-4)
    assert found
    assert abs(found.phase) > 3


# -- noise that all channels share -------------------------------------------------------------------


@pytest.mark.parametrize("magnitude_only", [False, True])
@pytest.mark.parametrize("condition", [RIGID, BEARING])
def test_noise_that_all_channels_share_is_estimated(condition, magnitude_only):
    run = measure(condition)
    assert estimate_noise(replace(run, magnitude_only=magnitude_only)).common == 0
    force = 0.01 * circular(np.random.default_rng(3), (len(run.frequency_hz), 1))
    H = run.H * (1 + force)
    shaken = replace(run, H=np.abs(H) if magnitude_only else H, std=None, magnitude_only=magnitude_only)
    assert_allclose(common_error(shaken), 0.01, rtol=0.25)
