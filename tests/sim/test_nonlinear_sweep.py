"""Sweeps of rotors whose response depends on level and history: branches, jumps, motion that does not repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.rotor.effects import BearingClearance, BearingCubic, BilinearSupport, FastSweep, Rub
from rigtwin.sim.detection import detect
from rigtwin.sim.lines import PERIODIC
from rigtwin.sim.sensors import SensorNoise
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import NotSettledError, Rig, SweepPlan, measure_lines, sweep
from tests.sim.stand_ins import DuffingOscillator, StandIn, SwellingMotion
from tests.tolerances import SAME_LINE

NONLINEAR = Rig(effects=(BearingCubic(),))
PLAN = SweepPlan(f_min_hz=90.0, f_max_hz=125.0, n_lines=36, force_amplitude=1000.0)


def slow_sweep(frequency_hz: np.ndarray, direction: str) -> np.ndarray:
    """(n_freq,) amplitudes on the branch that is there when one comes from below ("up") or from above."""
    return np.array([DuffingOscillator().amplitudes(f, 1000.0)[-1 if direction == "up" else 0] for f in frequency_hz])


# -- branches and jumps ----------------------------------------------------------------------------


def test_the_oscillator_has_two_stable_motions_at_some_frequencies():
    roots = [len(DuffingOscillator().amplitudes(f, 1000.0)) for f in np.arange(90.0, 125.0)]
    assert 3 <= roots.count(3) <= 30
    assert set(roots) == {1, 3}


@pytest.mark.parametrize("direction", ["up", "down"])
@pytest.mark.parametrize("refine", [True, False])
def test_every_line_is_on_the_branch_of_a_slow_sweep(direction, refine):
    """Refined lines, too, though they were found last."""
    plan = replace(PLAN, direction=direction, refine=refine)
    run = sweep(DuffingOscillator().as_session(), NONLINEAR, plan).run
    assert run.sweep == direction
    assert (len(run.frequency_hz) > 36) is refine
    amplitude = 1000.0 * np.abs(run.H[:, 0]) / (2 * np.pi * run.frequency_hz) ** 2
    assert_allclose(amplitude, slow_sweep(run.frequency_hz, direction), rtol=SAME_LINE)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_lines_are_added_on_the_branch_that_is_swept(direction):
    """The highest line of the branch has neighbours much closer than the base lines are."""
    run = sweep(DuffingOscillator().as_session(), NONLINEAR, replace(PLAN, direction=direction)).run
    highest = np.abs(run.H[:, 0]).argmax()
    f = run.frequency_hz
    assert f[highest + 1] - f[highest - 1] < 0.1
    assert np.count_nonzero(np.abs(f - f[highest]) < 1e-3) < 5  # and a jump is not closed in on for ever


def test_the_jump_comes_later_upwards_than_downwards():
    up, down = (
        sweep(DuffingOscillator().as_session(), NONLINEAR, replace(PLAN, direction=d)).run for d in ("up", "down")
    )
    highest = [run.frequency_hz[np.abs(run.H[:, 0]).argmax()] for run in (up, down)]
    assert highest[0] > highest[1] + 5.0


def test_lines_that_are_passed_keep_a_sweep_on_its_branch():
    plan = replace(PLAN, noise=SensorNoise())
    read, passed = [92.0, 106.0, 124.0], plan.base_lines()
    kept = measure_lines(DuffingOscillator().as_session(), NONLINEAR, plan, read, passing=passed).run
    left = measure_lines(DuffingOscillator().as_session(), NONLINEAR, replace(plan, glide_time=1e-9), read).run
    amplitudes = [1000.0 * np.abs(run.H[:, 0]) / (2 * np.pi * run.frequency_hz) ** 2 for run in (kept, left)]
    assert_array_equal(kept.frequency_hz, read)
    assert_allclose(amplitudes[0], slow_sweep(kept.frequency_hz, "up"), rtol=SAME_LINE)
    assert amplitudes[1][1] < 0.5 * amplitudes[0][1]


def test_a_linear_rotor_takes_one_pass_and_a_nonlinear_one_two():
    counts = {}
    for name, rig in (("linear", Rig()), ("nonlinear", NONLINEAR)):
        seen: list[int] = []
        measured = sweep(DuffingOscillator(k3=1.0).as_session(), rig, replace(PLAN, noise=SensorNoise()), seen.append)
        counts[name] = seen[-1] / len(measured.lines)
    assert counts == {"linear": 1.0, "nonlinear": 2.0}


@pytest.fixture(scope="module")
def session(rotor_fmu):
    with FmuSession(rotor_fmu) as opened:
        yield opened


def test_a_rotor_with_hardening_bearings_jumps_later_upwards_than_downwards(session):
    """Through the FMU: at 88 Hz the upward sweep is on the upper branch, the downward one on the lower."""
    parameters = {"k_b": 1.3e6, "bearing_damping": 50.0, "shaft_damping_ratio": 0.02}
    rig = Rig(parameters=parameters, effects=(BearingCubic(stiffness=1e15),))
    plan = SweepPlan(force_amplitude=15.0, settle_time=0.1, settling_tolerance=1e-2)
    up = measure_lines(session, rig, plan, [85.0, 88.0])
    down = measure_lines(session, rig, replace(plan, direction="down"), [88.0, 91.0])
    assert up.remarks == down.remarks == ()
    assert up.run.frequency_hz[1] == down.run.frequency_hz[0]
    assert np.abs(up.run.channel(4)[1] / down.run.channel(4)[0]) > 2


# -- what a nonlinear rotor needs ------------------------------------------------------------------


def test_a_nonlinear_rotor_gets_samples_periods_and_close_windows():
    plan = NONLINEAR.carry_out(SweepPlan())
    assert (plan.samples(50.0), plan.samples(1e4), plan.periods, plan.accept_nonperiodic) == (3000, 128, 4, True)
    assert plan.settle_time < SweepPlan().settle_time
    assert plan.settling_tolerance == 1e-3
    assert plan.glide_time > SweepPlan().glide_time
    waits = {"settle_time": 2.0, "settling_tolerance": 1e-4, "max_windows": 10, "glide_time": 1.0}
    own = SweepPlan(samples_per_period=2048, sample_rate_hz=3e5, periods=20, **waits)
    assert NONLINEAR.carry_out(own) == replace(own, accept_nonperiodic=True)


@pytest.mark.long
def test_a_glide_from_line_to_line_starts_hardly_any_transients(session):
    """Neither to the first one, from rest, nor to the next; five windows are the least."""
    rig, read = Rig(effects=(BearingCubic(stiffness=1e6),)), [150.0, 152.0, 154.0]
    glided = measure_lines(session, rig, SweepPlan(), read)
    jumped = measure_lines(session, rig, SweepPlan(glide_time=1e-9), read)
    assert max(line.windows for line in glided.lines) < 10
    assert min(line.windows for line in jumped.lines) > 25
    assert_allclose(glided.run.H, jumped.run.H, rtol=1e-3, atol=1e-4 * abs(jumped.run.H).max())


class Harmonic(StandIn):
    """A fundamental and one harmonic; ``taken`` are the samples of each call."""

    def __init__(self, order: int):
        self.order, self.taken = order, []

    def sample(self, outputs: list[str], h: float, n: int) -> np.ndarray:
        self.taken.append(n)
        return super().sample(outputs, h, n)

    def acceleration(self, phi: np.ndarray) -> np.ndarray:
        return 3 * np.sin(phi) + 0.1 * np.sin(self.order * phi)


@pytest.mark.parametrize(("order", "dense"), [(3, False), (60, False), (61, True), (67, True), (190, True)])
def test_a_motion_is_read_from_as_many_samples_as_its_harmonics_need(order, dense):
    """At 100 Hz, two periods after half a one of run-in; of 64 samples, orders 61, 67 and 190 fold onto harmonics."""
    motion, plan = Harmonic(order), replace(PLAN, noise=SensorNoise())
    run = measure_lines(motion.as_session(), NONLINEAR, plan, [100.0]).run
    assert motion.taken[-1] == 2.5 * (1500 if dense else 128)
    assert abs(run.H[0, 0]) * 1000.0 == pytest.approx(3.0)
    assert abs(run.harmonics[3][0, 0]) * 1000.0 == pytest.approx(0.1 if order == 3 else 0.0, abs=1e-9)


def test_periods_beyond_two_are_read_only_of_a_motion_that_does_not_repeat():
    """And have their own noise all the same."""
    stds = []
    for periods in (2, 4, 16):
        motion = Harmonic(3)
        plan = replace(PLAN, periods=periods, noise=SensorNoise(floor=0.01))
        stds.append(measure_lines(motion.as_session(), NONLINEAR, plan, [100.0]).run.std)
        assert motion.taken[-1] == 2.5 * 128
    assert_allclose(stds, 0.01 / 1000.0, rtol=0.3)


@pytest.mark.parametrize(
    ("rig", "nonlinear"),
    [
        (Rig(), False),
        (Rig(effects=(FastSweep(),)), False),
        (Rig("bearing", effects=(BilinearSupport(),)), True),
        (Rig("rigid", effects=(BilinearSupport(), BearingClearance())), False),
        (Rig("rigid", effects=(Rub(),)), True),
    ],
)
def test_bearings_make_a_rotor_nonlinear_only_where_it_runs_in_them(rig, nonlinear):
    assert rig.nonlinear is nonlinear
    assert (rig.carry_out(SweepPlan()) != SweepPlan(dwell=rig.carry_out(SweepPlan()).dwell)) is nonlinear


class RichInHarmonics(DuffingOscillator):
    """Harmonics from the fifth on, which detection does not report."""

    def acceleration(self, phi: np.ndarray) -> np.ndarray:
        return 3 * np.sin(phi) + 0.5 * np.sin(3 * phi) + 0.3 * np.sin(5 * phi) + 0.1 * np.sin(7 * phi)


def test_higher_harmonics_are_no_noise():
    run = measure_lines(RichInHarmonics().as_session(), NONLINEAR, PLAN, [100.0]).run
    assert run.std is not None
    assert run.std[0, 0] < 1e-6 * abs(run.H[0, 0])
    assert abs(run.harmonics[3][0, 0] / run.H[0, 0]) == pytest.approx(0.5 / 3)
    noisy = replace(PLAN, noise=SensorNoise(relative=0.01))
    stds = np.array(
        [measure_lines(RichInHarmonics().as_session(), NONLINEAR, noisy, [f]).run.std for f in (99.0, 100.0)]
    )
    assert_allclose(stds[:, 0, 0] / abs(run.H[0, 0]), 0.01, rtol=0.15)


def test_detection_of_any_harmonics_needs_a_second_period():
    samples = RichInHarmonics().acceleration(2 * np.pi * np.arange(64) / 32)[:, None]
    assert detect(samples, 32, any_harmonics=True).std[0] < 1e-12
    assert detect(samples, 32).std[0] > 0.01
    assert_array_equal(detect(samples[:32], 32, any_harmonics=True).std, detect(samples[:32], 32).std)


# -- motion that does not repeat -------------------------------------------------------------------


@pytest.mark.parametrize(("share", "frequency"), [(0.01, 50.0), (0.3, 50.0), (0.01, 52.0)])
def test_a_motion_that_does_not_repeat_is_marked_and_its_error_holds_the_spread(share, frequency):
    """Also at 52 Hz, where all windows begin at the same point of the four periods and look alike.

    Over a period cos(phi/4) is sin(pi/4)/(pi/4) = 0.9 of its middle; its rms over four periods is 1/sqrt(2) of that.
    """
    (line,) = measure_lines(SwellingMotion(share).as_session(), NONLINEAR, PLAN, [frequency]).lines
    assert not line.periodic
    assert line.spread == pytest.approx(0.9 * share / np.sqrt(2), rel=0.05)
    assert line.std[0] >= line.spread * abs(line.response[0, 0])
    assert "the motion does not repeat" in line.remark
    assert line.remark.startswith(f"{frequency:.4f} Hz: ")


def test_a_motion_that_repeats_is_not_marked():
    (line,) = measure_lines(SwellingMotion(1e-4).as_session(), NONLINEAR, PLAN, [50.0]).lines
    assert line.periodic
    assert line.remark == ""
    assert 0 < line.spread < PERIODIC


def test_peaks_of_a_motion_that_does_not_repeat_are_not_closed_in_on():
    """They are chance; a steady motion of the same size rises towards the lower end of the band."""
    plan = replace(PLAN, n_lines=12)
    counts = [len(sweep(SwellingMotion(share).as_session(), NONLINEAR, plan).lines) for share in (0.1, 0.0)]
    assert counts == [12, 13]


def test_a_sweep_lists_what_is_wrong_with_its_lines():
    measured = measure_lines(SwellingMotion(0.1).as_session(), NONLINEAR, PLAN, [50.0, 60.0])
    assert [remark[:10] for remark in measured.remarks] == ["50.0000 Hz", "60.0000 Hz"]


def test_waiting_ends_when_it_is_of_no_use():
    """Long before the windows are used up."""
    (line,) = measure_lines(SwellingMotion(0.1).as_session(), NONLINEAR, PLAN, [50.0]).lines
    assert line.windows < PLAN.max_windows / 2


def test_a_linear_rotor_that_does_not_repeat_is_an_error():
    with pytest.raises(NotSettledError):
        measure_lines(SwellingMotion(0.1).as_session(), Rig(), replace(PLAN, settle_time=0.77), [50.3])
