"""The virtual rig: settled lines through the FMU are the direct frequency response, to within their errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from rigtwin.rotor.effects import PlaneAnisotropy
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.sim.campaign import Channel, Run
from rigtwin.sim.detection import HARMONICS
from rigtwin.sim.sensors import SensorNoise
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import NotSettledError, Rig, Sweep, SweepPlan, measure_lines, sweep
from tests.rotor.rigs import paper_structure

# The project's bar for the FMU against the direct response. Rounding the sampling instants to the
# FMU's clock leaves 1e-8, see CLOCK.
BAR = 1e-4

# The FMU's clock ticks every 2^-36 s: 2 pi 400 Hz / 2^36 = 4e-8 of a phasor's phase, and as much
# again where a line is a small difference of its modes.
CLOCK = 1e-7

# Beats make the estimate of a transient uncertain; it may be too small by so much on a line in ten.
HONEST = 4.0

# A statistic with a fixed seed is rejected where its null distribution gives it less than this.
REJECTED = 1e-3

PLAN = SweepPlan(n_lines=96)
CONDITIONS = {
    "rigid": Rig("rigid"),
    "1e6": Rig("bearing", parameters={"k_b": 1e6}),
    "1e7": Rig("bearing", parameters={"k_b": 1e7}),
    "1e8": Rig("bearing", parameters={"k_b": 1e8}),
}
EVERY_CONDITION = pytest.mark.parametrize("rig", CONDITIONS.values(), ids=CONDITIONS)
LINES = np.array([33.0, 71.0, 96.5, 180.0, 297.0, 391.5])


@pytest.fixture(scope="module")
def session(rotor_fmu) -> Iterator[FmuSession]:
    with FmuSession(rotor_fmu) as opened:
        yield opened


def system_of(rig: Rig) -> LinearSystem:
    """The linear system that the FMU integrates when it is set up like this."""
    return build_system(paper_structure(), Condition(rigid_support=rig.support == "rigid", **rig.parameters))


def direct(rig: Rig, frequency_hz: np.ndarray) -> np.ndarray:
    """(n_freq, 7) accelerance of the rig by its matrices."""
    place = {"excitation_node": rig.excitation_node, "plane": "yz".index(rig.excitation_plane) + 1}
    return accelerance(system_of(rig), frequency_hz, spin_speed=rig.spin_rpm * np.pi / 30, **place)[:, :, 0]


def largest_error(run: Run, rig: Rig) -> float:
    """Largest complex error over all moving nodes, relative to the line's own value.

    Lines below 1 % of their channel's median are antiresonances and do not count.
    """
    exact = direct(rig, run.frequency_hz)
    size = np.abs(exact)
    counts = size > 0.01 * np.median(size, axis=0)
    return float((np.abs(run.H - exact)[counts] / size[counts]).max())


def modes_in_band(rig: Rig, plan: SweepPlan) -> list[tuple[float, float]]:
    """(natural frequency [Hz], damping ratio) of each mode of one plane in the plan's band."""
    modes = damped_modes(system_of(rig))
    both = zip(modes.frequency_hz[::2], modes.damping_ratio[::2], strict=True)
    return [(f, zeta) for f, zeta in both if plan.f_min_hz < f < plan.f_max_hz]


# -- the response ----------------------------------------------------------------------------------


@EVERY_CONDITION
def test_the_sweep_through_the_fmu_is_the_direct_response(session, rig):
    measured = sweep(session, rig, SweepPlan())
    run = measured.run
    assert (run.frequency_hz[0], run.frequency_hz[-1]) == (20.0, 400.0)
    assert largest_error(run, rig) < CLOCK < BAR
    held = [node in (1, 7) and rig.support == "rigid" for node in range(1, 8)]
    assert not run.H[:, held].any()
    assert np.abs(run.H[:, np.logical_not(held)]).min() > 0


def test_a_plan_that_does_not_wait_fails_the_same_check(session):
    """Negative control: a tenth of the settling time and no check of it."""
    rig = CONDITIONS["1e7"]
    lines = sweep(session, rig, PLAN).run.frequency_hz
    hasty = replace(PLAN, settle_time=PLAN.settle_time / 10, settling_tolerance=np.inf)
    assert largest_error(measure_lines(session, rig, hasty, lines).run, rig) > 10 * BAR


def test_the_response_per_newton_does_not_depend_on_the_force(session):
    weak, strong = (
        measure_lines(session, CONDITIONS["1e7"], SweepPlan(force_amplitude=force), LINES) for force in (1e-3, 50.0)
    )
    assert_allclose([abs(line.force) for line in strong.lines], 50.0, rtol=CLOCK)
    assert_allclose(weak.run.H, strong.run.H, rtol=0, atol=CLOCK * np.abs(strong.run.H).max())


def test_damping_of_shaft_and_bearings_is_passed_on(session):
    rig = Rig("bearing", parameters={"k_b": 2e6, "bearing_damping": 40.0, "shaft_damping_ratio": 0.004})
    assert largest_error(sweep(session, rig, PLAN).run, rig) < CLOCK


@pytest.mark.parametrize("node", [1, 4, 7])
def test_the_exciter_can_sit_at_any_node(session, node):
    rig = Rig("bearing", excitation_node=node)
    run = measure_lines(session, rig, PLAN, LINES).run
    assert run.excitation_node == node
    assert largest_error(run, rig) < CLOCK


def test_a_force_on_a_held_node_moves_nothing_and_has_settled_at_once(session):
    measured = sweep(session, Rig("rigid", excitation_node=1), PLAN)
    assert not measured.run.H.any()
    assert {line.windows for line in measured.lines} == {3}


def test_the_z_plane_of_a_spinning_shaft_is_measured_in_z(session):
    rig = Rig("bearing", excitation_plane="z", spin_rpm=60_000.0, parameters={"k_b": 1e6})
    run = measure_lines(session, rig, PLAN, LINES).run
    assert run.channels == tuple(Channel(node, "z") for node in range(1, 8))
    assert (run.excitation_plane, run.spin_rpm) == ("z", 60_000.0)
    assert largest_error(run, rig) < CLOCK
    # The shaft's own gyroscopic effect is small, but a hundred times what can be seen.
    assert largest_error(run, replace(rig, spin_rpm=0.0)) > 100 * CLOCK


# -- refinement ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "shaft_damping_ratio", [0.0005, *(pytest.param(z, marks=pytest.mark.long) for z in (0.001, 0.005))]
)
@EVERY_CONDITION
def test_every_resonance_is_resolved(session, rig, shaft_damping_ratio):
    """At least as many lines within |f - f_r| <= zeta f_r as the plan asks for."""
    rig = replace(rig, parameters={**rig.parameters, "shaft_damping_ratio": shaft_damping_ratio})
    f = sweep(session, rig, PLAN).run.frequency_hz
    modes = modes_in_band(rig, PLAN)
    assert len(modes) >= 2
    for natural, zeta in modes:
        assert np.count_nonzero(np.abs(f - natural) <= zeta * natural) >= PLAN.lines_per_half_power_band


def test_both_of_two_resonances_between_the_same_base_lines_are_resolved(session):
    """Bearings with principal directions: the modes of the two planes lie eight half-power bandwidths apart."""
    effect = PlaneAnisotropy(anisotropy=0.05, angle=np.pi / 4)
    rig = Rig("bearing", parameters={"k_b": 1.3e6}, effects=(effect,), sensor_planes=("y", "z"))
    plan = SweepPlan(f_min_hz=50.0, f_max_hz=110.0, n_lines=31)
    system = build_system(paper_structure(), Condition(k_b=1.3e6), [effect])
    modes = damped_modes(system)
    pair = list(zip(modes.frequency_hz[:2], modes.damping_ratio[:2], strict=True))
    width = 2 * pair[0][0] * pair[0][1]
    assert 3 * width < pair[1][0] - pair[0][0] < BASE_STEP
    f = sweep(session, rig, plan).run.frequency_hz
    for natural, zeta in pair:
        assert np.count_nonzero(np.abs(f - natural) <= zeta * natural) >= plan.lines_per_half_power_band


def test_base_lines_are_even_and_stay_in_the_refined_sweep(session):
    plan = SweepPlan(f_min_hz=50.0, f_max_hz=150.0, n_lines=26)
    assert_allclose(np.diff(plan.base_lines()), 4.0)
    base = sweep(session, Rig("rigid"), replace(plan, refine=False)).run
    assert_array_equal(base.frequency_hz, plan.base_lines())
    refined = sweep(session, Rig("rigid"), plan).run
    assert np.isin(base.frequency_hz, refined.frequency_hz).all()
    assert (refined.frequency_hz[0], refined.frequency_hz[-1]) == (50.0, 150.0)


BASE_STEP = 2.0


@pytest.mark.parametrize("inside", [0.05, 0.9, 1.1, 1.95])
@pytest.mark.parametrize("end", ["f_min", "f_max"])
def test_a_resonance_between_an_end_of_the_band_and_the_next_base_line_is_resolved(session, end, inside, caplog):
    natural, zeta = modes_in_band(Rig("rigid"), PLAN)[0]
    f_min, f_max = (natural - inside, natural + 16) if end == "f_min" else (natural - 16, natural + inside)
    plan = SweepPlan(f_min_hz=f_min, f_max_hz=f_max, n_lines=round((f_max - f_min) / BASE_STEP) + 1)
    f = sweep(session, Rig("rigid"), plan).run.frequency_hz
    assert np.count_nonzero(np.abs(f - natural) <= zeta * natural) >= plan.lines_per_half_power_band - (inside < 0.1)
    assert caplog.messages == []


@pytest.mark.parametrize(("beyond", "warns"), [(0.3, True), (3.0, False), (40.0, False)])
@pytest.mark.parametrize("end", ["f_min", "f_max"])
def test_a_resonance_close_beyond_an_end_of_the_band_is_spoken_of(session, end, beyond, warns, caplog):
    natural, _ = modes_in_band(Rig("rigid"), PLAN)[0]
    f_min, f_max = (natural + beyond, natural + 60) if end == "f_min" else (natural - 60, natural - beyond)
    plan = SweepPlan(f_min_hz=f_min, f_max_hz=f_max, n_lines=round((f_max - f_min) / BASE_STEP) + 1)
    f = sweep(session, Rig("rigid"), plan).run.frequency_hz
    assert (f[0], f[-1]) == (f_min, f_max)
    assert len(f) <= plan.n_lines + 10
    said = [message for message in caplog.messages if "a resonance lies within" in message]
    assert len(said) == warns == len(caplog.messages)


def test_progress_counts_the_lines(session):
    counts: list[int] = []
    measured = sweep(session, Rig("rigid"), SweepPlan(n_lines=20), counts.append)
    assert counts == list(range(1, len(measured.lines) + 1))


# -- settling --------------------------------------------------------------------------------------

IMPATIENT = {
    "rigid": Rig("rigid"),
    "bearing": Rig("bearing"),
    "soft": Rig("bearing", parameters={"k_b": 1e6, "bearing_damping": 20.0}),
    "lightly damped": Rig("bearing", parameters={"k_b": 1e6, "shaft_damping_ratio": 0.0005}),
}


def true_transients(measured: Sweep, rig: Rig) -> np.ndarray:
    """(n_freq,) error of each line as ``Line.transient`` states it: largest over channels, relative."""
    size = np.abs(measured.run.H)
    reference = np.maximum(size, 1e-3 * size.max(axis=1, keepdims=True))
    reference[:, size.max(axis=0) == 0] = np.inf  # nodes that are held
    return np.max(np.abs(measured.run.H - direct(rig, measured.run.frequency_hz)) / reference, axis=1)


@pytest.mark.parametrize("rig", IMPATIENT.values(), ids=IMPATIENT)
@pytest.mark.parametrize("settle_time", [1.0, pytest.param(3.0, marks=pytest.mark.long)])
def test_the_estimated_transient_bounds_the_true_one(session, rig, settle_time):
    """With windows so close together that many are needed, on resonances and between them."""
    near = [f * (1 + zeta * k) for f, zeta in modes_in_band(rig, PLAN)[:2] for k in (-10, -4, -1, 0, 1, 4, 10)]
    lines = np.sort(np.concatenate([np.linspace(20, 400, 25), near]))
    plan = replace(PLAN, settle_time=settle_time, settling_tolerance=1e-4, max_windows=400)
    measured = measure_lines(session, rig, plan, lines)
    true, estimated = true_transients(measured, rig), np.array([line.transient for line in measured.lines])
    assert min(line.windows for line in measured.lines) >= 5
    assert np.all(estimated <= plan.settling_tolerance)
    assert np.max(true / np.maximum(estimated, CLOCK)) < HONEST
    assert np.mean(true <= np.maximum(estimated, CLOCK)) > 0.9
    assert np.all(measured.run.std >= 0.99 * estimated[:, None] * np.abs(measured.run.H))


@pytest.mark.parametrize("frequency", [25.0, 60.0, 100.0, 250.0, 390.0])
def test_a_rotor_without_damping_never_settles(session, frequency):
    rig = Rig("rigid", parameters={"shaft_damping_ratio": 0.0})
    with pytest.raises(NotSettledError, match=r"Hz: .* is still transient after 1800 s; raise settle_time") as refused:
        measure_lines(session, rig, PLAN, [frequency])
    assert refused.value.frequency_hz == frequency
    assert refused.value.estimate > PLAN.settling_tolerance
    assert f"{frequency:.4f} Hz" in str(refused.value)


def test_too_few_windows_are_an_error_that_says_where(session):
    plan = replace(PLAN, settle_time=0.5, max_windows=5)
    with pytest.raises(NotSettledError) as refused:
        measure_lines(session, Rig("rigid"), plan, [70.0, 100.5])
    assert refused.value.frequency_hz == 70.0
    assert refused.value.estimate > plan.settling_tolerance


@pytest.mark.parametrize("max_windows", [0, 1, 2])
def test_two_windows_cannot_tell_whether_a_line_has_settled(session, max_windows):
    with pytest.raises(NotSettledError) as refused:
        measure_lines(session, Rig("rigid"), replace(PLAN, max_windows=max_windows), [70.0])
    assert refused.value.estimate == np.inf


def test_a_session_measures_on_after_a_line_that_did_not_settle(session):
    with pytest.raises(NotSettledError):
        measure_lines(session, Rig("rigid"), replace(PLAN, max_windows=1), [70.0])
    assert largest_error(measure_lines(session, Rig("rigid"), PLAN, LINES).run, Rig("rigid")) < CLOCK


# -- noise -----------------------------------------------------------------------------------------


def squared_z_scores(values: np.ndarray, exact: np.ndarray, std: np.ndarray) -> np.ndarray:
    """|error|^2 / std^2 of all lines and moving channels."""
    moving = std.max(axis=0) > 0
    return (np.abs(values - exact)[:, moving] ** 2 / std[:, moving] ** 2).ravel()


@pytest.mark.parametrize("periods", [1, pytest.param(4, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "noise", [SensorNoise(relative=0.01, seed=1), SensorNoise(floor=3e-3, seed=2)], ids=["relative", "floor"]
)
@pytest.mark.parametrize("rig", [CONDITIONS["rigid"], CONDITIONS["1e6"]], ids=["rigid", "1e6"])
def test_errors_are_as_large_as_the_standard_errors_say(session, rig, noise, periods):
    """|error|^2 / std^2 is F(2, nu), nu the samples of a window less the seven that are fitted."""
    run = sweep(session, rig, replace(PLAN, noise=noise, periods=periods, force_amplitude=2.5)).run
    assert run.std is not None
    z2 = squared_z_scores(run.H, direct(rig, run.frequency_hz), run.std)
    null = stats.f(2, PLAN.samples_per_period * periods - 7)
    assert stats.kstest(z2, null.cdf).pvalue > REJECTED
    assert z2.mean() == pytest.approx(null.mean(), abs=4 * null.std() / np.sqrt(len(z2)))


def test_one_per_cent_noise_is_one_per_cent_of_every_line(session):
    rig = CONDITIONS["1e6"]
    run = sweep(session, rig, replace(PLAN, noise=SensorNoise(relative=0.01), periods=4)).run
    exact = direct(rig, run.frequency_hz)
    squares = np.abs(run.H / exact - 1) ** 2
    assert squares.mean() == pytest.approx(1e-4, rel=4 / np.sqrt(squares.size))


def test_noise_comes_again_with_its_seed_and_not_with_another(session):
    plan = replace(PLAN, noise=SensorNoise(relative=0.01, seed=4))
    first, again = (measure_lines(session, Rig("rigid"), plan, LINES).run for _ in range(2))
    assert_array_equal(first.H, again.H)
    other = replace(plan, noise=SensorNoise(relative=0.01, seed=5))
    assert np.abs(measure_lines(session, Rig("rigid"), other, LINES).run.H - first.H)[:, 1:6].min() > 0


def test_lines_do_not_depend_on_what_was_measured_before(session):
    """In one go, in two, each from rest, or as part of a sweep."""
    rig = CONDITIONS["1e7"]
    swept = sweep(session, rig, PLAN).run
    lines = swept.frequency_hz[::9]
    together = measure_lines(session, rig, PLAN, lines).run
    halves = [measure_lines(session, rig, PLAN, part).run.H for part in (lines[::2], lines[1::2])]
    alone = np.vstack([measure_lines(session, rig, PLAN, [f]).run.H for f in lines])
    apart = np.empty_like(alone)
    apart[::2], apart[1::2] = halves
    for other in (together.H, apart, alone):
        assert_allclose(other, swept.H[::9], rtol=0, atol=CLOCK * np.abs(swept.H).max())


def test_lines_are_measured_upwards_whatever_their_order_and_once_each(session):
    run = measure_lines(session, Rig("rigid"), PLAN, [100.0, 60.0, 100.0, 80.0]).run
    assert_array_equal(run.frequency_hz, [60.0, 80.0, 100.0])


# -- harmonics -------------------------------------------------------------------------------------


@EVERY_CONDITION
def test_a_linear_rotor_has_no_harmonics(session, rig):
    run = measure_lines(session, rig, PLAN, LINES).run
    assert sorted(run.harmonics) == [2, 3]
    for harmonic in run.harmonics.values():
        assert np.all(np.abs(harmonic) <= CLOCK * np.abs(run.H).max(axis=1, keepdims=True))


def test_with_noise_its_harmonics_are_noise(session):
    run = sweep(session, CONDITIONS["1e7"], replace(PLAN, noise=SensorNoise(relative=0.01), periods=4)).run
    assert run.std is not None
    for harmonic in run.harmonics.values():
        z2 = squared_z_scores(harmonic, np.zeros_like(harmonic), run.std)
        assert stats.kstest(z2, stats.f(2, 4 * PLAN.samples_per_period - 7).cdf).pvalue > REJECTED


class DistortingFmu:
    """Stands in for a session: an accelerometer that adds harmonics at fixed phases of the force F sin(phi)."""

    variables = ("node_2.acceleration_y", "force_applied")
    response = np.array([3.0 - 1.0j, 0.5 + 0.2j, -0.1j])  # of e^{i k phi}, k = 1, 2, 3

    def start(self, values: dict[str, float]) -> None:
        self.force, self.phase = values["force_amplitude"], 0.3

    def set(self, values: dict[str, float]) -> None:
        self.frequency = values["force_frequency"]

    def step(self, h: float) -> None:
        self.phase += 2 * np.pi * self.frequency * h

    def sample(self, _outputs: list[str], h: float, n: int) -> np.ndarray:
        phi = self.phase + 2 * np.pi * self.frequency * h * np.arange(n)
        self.phase = phi[-1]
        return np.column_stack([(np.exp(1j * np.outer(phi, HARMONICS)) @ self.response).real, self.force * np.sin(phi)])


def test_harmonics_are_referred_to_the_phase_of_the_force():
    """Whenever a window begins: a force F sin(phi) has the phasor F / i, its k-th power's phase is that of i^-k."""
    frequencies = [33.3, 71.7, 96.1]
    plan = SweepPlan(force_amplitude=2.0, settle_time=0.77)
    run = measure_lines(DistortingFmu(), Rig(), plan, frequencies).run  # pyright: ignore[reportArgumentType]
    expected = DistortingFmu.response / 2.0 * 1j ** np.array(HARMONICS)
    for order, values in {1: run.H, **run.harmonics}.items():
        assert_allclose(values[:, 0], expected[order - 1], rtol=1e-6)


# -- what a run says of itself ---------------------------------------------------------------------


def test_a_run_says_how_it_was_made(session):
    rig = Rig("rigid", excitation_node=3, excitation_plane="y", spin_rpm=1200.0)
    measured = measure_lines(session, rig, replace(PLAN, force_amplitude=2.5), LINES)
    run = measured.run
    assert (run.support, run.excitation_node, run.excitation_plane) == ("rigid", 3, "y")
    assert (run.force_amplitude_N, run.spin_rpm, run.sweep) == (2.5, 1200.0, "up")
    assert (run.quantity, run.magnitude_only, run.name) == ("accelerance", False, "rigid support, 2.5 N")
    assert run.channels == tuple(Channel(node) for node in range(1, 8))
    assert_array_equal(run.frequency_hz, LINES)
    assert [line.frequency_hz for line in measured.lines] == LINES.tolist()
    assert run.std is not None


def test_a_settled_line_does_not_drift(session):
    """The drift over a second is below the tolerance of the whole transient."""
    lines = measure_lines(session, Rig("rigid"), PLAN, LINES).lines
    assert max(line.drift_per_period * line.frequency_hz for line in lines) < PLAN.settling_tolerance
