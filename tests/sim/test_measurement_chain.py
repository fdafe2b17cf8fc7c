"""Effects on the virtual rig: what the FMU with an effect measures is what the formulas say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.rotor.effects import (
    EFFECTS,
    AttachedMass,
    BearingCubic,
    CoarseGrid,
    Effect,
    ExciterSuspension,
    FastSweep,
    ForceDropout,
    SensorDelay,
    SensorGain,
    SensorMass,
    SensorPosition,
    UnbalanceForce,
)
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.campaign import Run
from rigtwin.sim.sensors import SensorNoise
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SetupError, SweepPlan, measure_lines, sweep
from tests.rotor.rigs import paper_structure
from tests.sim.stand_ins import DuffingOscillator
from tests.tolerances import SAME_LINE, SETTLED_LINE

STRUCTURE = paper_structure()
LINEAR = [effect() for effect in EFFECTS.values() if effect.family != "nonlinear" and effect is not FastSweep]
SEEN = [effect for effect in LINEAR if not isinstance(effect, CoarseGrid | UnbalanceForce)]  # on settled lines
SPIN_RPM = 3000.0
LINES = np.array([33.0, 71.0, 96.5, 180.0, 297.0])


@pytest.fixture(scope="module")
def session(rotor_fmu) -> Iterator[FmuSession]:
    with FmuSession(rotor_fmu) as opened:
        yield opened


def reported(rig: Rig, frequency_hz: np.ndarray) -> np.ndarray:
    """(n_freq, 7) what this rig should report, by the formulas."""
    condition = Condition(
        rigid_support=rig.support == "rigid", excitation_node=rig.excitation_node, spin_speed=rig.spin_rpm * np.pi / 30
    )
    condition = replace(condition, **rig.parameters)
    return measured_response(STRUCTURE, condition, rig.effects, frequency_hz, referred_to="nominal_force")


def largest_error(run: Run, rig: Rig) -> float:
    """Largest complex error over channels, relative to the line, or to 1e-3 of its largest channel."""
    exact = reported(rig, run.frequency_hz)
    size = np.maximum(np.abs(exact), 1e-3 * np.abs(exact).max(axis=1, keepdims=True))
    return float(np.max(np.abs(run.H - exact) / size))


# -- every effect ----------------------------------------------------------------------------------


@pytest.mark.parametrize("support", ["rigid", "bearing"])
@pytest.mark.parametrize("effect", LINEAR, ids=lambda effect: effect.id)
def test_the_rig_with_an_effect_measures_the_response_of_the_rotor_with_that_effect(session, effect, support):
    rig = Rig(support, effects=(effect,), spin_rpm=SPIN_RPM if effect.family == "spinning" else 0.0)
    assert largest_error(measure_lines(session, rig, SweepPlan(), LINES).run, rig) < SETTLED_LINE


@pytest.mark.parametrize("effect", SEEN, ids=lambda effect: effect.id)
def test_every_effect_that_can_be_seen_is_seen(session, effect):
    """Negative control of the test above: on one support or the other, the response is not the nominal one."""
    differences = []
    for support in ("rigid", "bearing"):
        rig = Rig(support, effects=(effect,), spin_rpm=SPIN_RPM if effect.family == "spinning" else 0.0)
        nominal = reported(replace(rig, effects=()), LINES)
        differences.append(np.abs(measure_lines(session, rig, SweepPlan(), LINES[2:3]).run.H - nominal[2]).max())
    assert max(differences) > 1e-4


def test_effects_act_together(session):
    effects = AttachedMass(), SensorPosition(node=2), ForceDropout(), SensorMass(node=3), SensorDelay(), SensorGain()
    rig = Rig(effects=effects, parameters={"k_b": 3e6, "bearing_damping": 20.0})
    assert largest_error(measure_lines(session, rig, SweepPlan(), LINES).run, rig) < SETTLED_LINE


def test_start_values_are_the_effects_fields():
    rig = Rig("rigid", effects=(AttachedMass(0.2, 5), SensorGain(), SensorMass(0.01, 3)), parameters={"k_b": 2e6})
    values = rig.start_values()
    assert (values["attached_mass.enabled"], values["attached_mass.mass"], values["attached_mass.node"]) == (
        True,
        0.2,
        5,
    )
    assert (values["sensor_mass.node"], values["k_b"], values["rigid_support"]) == (3, 2e6, True)
    assert not [name for name in values if name.startswith("sensor_gain")]


# -- sensors ---------------------------------------------------------------------------------------


def test_gain_and_delay_act_on_harmonics_at_their_own_frequency():
    """A delay turns the k-th harmonic k times as far; the force channel stays."""
    delay, frequency = 4e-4, 31.0
    plain = Rig(effects=(BearingCubic(),))
    faulty = replace(plain, effects=(BearingCubic(), SensorGain(gain=0.7, node=2), SensorDelay(delay=delay)))
    runs = [measure_lines(_Distorting().as_session(), rig, SweepPlan(), [frequency]) for rig in (plain, faulty)]
    assert_allclose(abs(runs[0].lines[0].force), abs(runs[1].lines[0].force))
    for order in (1, 2, 3):
        before, after = (run.run.H if order == 1 else run.run.harmonics[order] for run in runs)
        assert_allclose(after / before, 0.7 * np.exp(-2j * np.pi * order * frequency * delay), rtol=SAME_LINE)


class _Distorting(DuffingOscillator):
    def acceleration(self, phi: np.ndarray) -> np.ndarray:
        return 5 * np.sin(phi) + 2 * np.sin(2 * phi - 1) + np.sin(3 * phi + 0.4)


def test_a_sensors_mass_is_felt_in_its_own_channel_only(session):
    plain = measure_lines(session, Rig(), SweepPlan(), LINES).run.H
    loaded = measure_lines(session, Rig(effects=(SensorMass(mass=0.05, node=4),)), SweepPlan(), LINES).run.H
    others = [0, 1, 2, 4, 5, 6]
    assert_allclose(loaded[:, others], plain[:, others], rtol=0, atol=SAME_LINE * np.abs(plain).max())
    assert np.abs(loaded[:, 3] / plain[:, 3] - 1).min() > 1e-3


def test_a_roving_sensor_is_at_every_node_in_turn(session):
    rig = Rig("bearing", effects=(SensorMass(mass=0.05, node=0),))
    measured = measure_lines(session, rig, SweepPlan(), LINES[[1, 4]])
    assert largest_error(measured.run, rig) < SETTLED_LINE
    assert measured.lines[0].windows >= 7 * 3


def test_a_sweep_resolves_the_resonances_of_every_place_of_the_sensor(session):
    """Each place has its own resonance; all channels are there on all lines."""
    rig, plan = Rig("rigid", effects=(SensorMass(mass=0.06, node=4),)), SweepPlan(f_min_hz=90, f_max_hz=110, n_lines=11)
    run = sweep(session, rig, plan).run
    assert largest_error(run, rig) < SETTLED_LINE
    dense = np.linspace(98, 101, 30001)
    exact = np.abs(reported(rig, dense))
    for column in (2, 3):
        resonance = dense[exact[:, column].argmax()]
        assert (
            np.count_nonzero(np.abs(run.frequency_hz - resonance) < 1e-3 * resonance) >= plan.lines_per_half_power_band
        )


# -- exciter ---------------------------------------------------------------------------------------


def test_at_constant_current_the_response_per_nominal_force_is_that_of_the_rotor_with_its_exciter(session):
    """Mass and suspension of the armature at the drive node. Without shaft damping, which follows the modes."""
    damping = {"shaft_damping_ratio": 0.0, "bearing_damping": 100.0, "k_b": 2e6}
    dropout = Rig(effects=(ForceDropout(mass=0.2, stiffness=2e4, damping=7.0),), parameters=damping)
    exciter = AttachedMass(mass=0.2, node=2), ExciterSuspension(stiffness=2e4, damping=7.0)
    runs = [measure_lines(session, rig, SweepPlan(), LINES).run for rig in (dropout, replace(dropout, effects=exciter))]
    size = np.abs(runs[1].H).max(axis=1, keepdims=True)
    assert np.max(np.abs(runs[0].H - runs[1].H) / size) < SETTLED_LINE


def test_the_force_on_the_rotor_is_the_nominal_one_less_what_moves_the_exciter(session):
    """F = F_0 - Z x, on every line; and it is not the nominal one."""
    exciter, plan = ForceDropout(mass=0.2), SweepPlan(force_amplitude=2.5)
    measured = measure_lines(session, Rig(effects=(exciter,)), plan, LINES)
    omega = 2 * np.pi * LINES
    x = -2.5 * measured.run.channel(2) / omega**2
    Z = exciter.stiffness + 1j * omega * exciter.damping - omega**2 * exciter.mass
    forces = np.array([abs(line.force) for line in measured.lines])
    assert_allclose(forces, np.abs(2.5 - Z * x), rtol=SETTLED_LINE)
    assert np.ptp(forces) > 0.1
    assert measured.run.force_amplitude_N == 2.5


def test_a_nonlinear_rotor_on_constant_current_finds_the_force_that_goes_with_its_motion():
    """Where the response depends on the force, and the force on the response."""
    rig = Rig(effects=(BearingCubic(), ForceDropout(mass=0.3, stiffness=1e4, damping=40.0)))
    lines, plan = np.arange(90.0, 112.0), SweepPlan(force_amplitude=500.0)
    measured = measure_lines(DuffingOscillator().as_session(), rig, plan, lines)
    assert measured.remarks == ()
    omega = 2 * np.pi * lines
    x = -500.0 * measured.run.H[:, 0] / omega**2
    forces = np.array([abs(line.force) for line in measured.lines])
    assert_allclose(forces, np.abs(500.0 - (1e4 + 40j * omega - 0.3 * omega**2) * x), rtol=2e-3)
    assert np.ptp(forces) > 100


def test_accelerations_at_constant_current_are_the_response_per_force_times_the_force(session):
    plan = SweepPlan(force_amplitude=4.0)
    rig = Rig(effects=(ForceDropout(), SensorGain()))
    per_force, recorded = (
        measure_lines(session, replace(rig, quantity=quantity), plan, LINES).run
        for quantity in ("accelerance", "acceleration")
    )
    assert recorded.quantity == "acceleration"
    assert per_force.std is not None
    assert recorded.std is not None
    assert_allclose(recorded.H, 4.0 * per_force.H, rtol=0, atol=SAME_LINE * np.abs(recorded.H).max())
    assert_allclose(recorded.harmonics[3], 4.0 * per_force.harmonics[3], rtol=0, atol=SAME_LINE)
    assert_allclose(recorded.std, 4.0 * per_force.std, rtol=1e-6, atol=SAME_LINE)


# -- raster and sweep rate -------------------------------------------------------------------------


def test_a_coarse_raster_is_even_and_its_lines_are_right(session):
    rig = Rig("rigid", effects=(CoarseGrid(step=7.0),))
    run = sweep(session, rig, SweepPlan(f_min_hz=90.0, f_max_hz=120.0)).run
    assert_array_equal(run.frequency_hz, [90.0, 97.0, 104.0, 111.0, 118.0])
    assert largest_error(run, rig) < SETTLED_LINE


def test_a_coarse_raster_misses_the_peak(session):
    plan = SweepPlan(f_min_hz=90.0, f_max_hz=110.0, n_lines=11)
    coarse, fine = (
        np.abs(sweep(session, Rig("rigid", effects=effects), plan).run.H).max() for effects in ((CoarseGrid(),), ())
    )
    assert coarse < 0.7 * fine


FAST = SweepPlan(f_min_hz=99.0, f_max_hz=102.2, n_lines=65, refine=False)


@pytest.mark.parametrize(("direction", "late"), [("up", 1), ("down", -1)])
def test_a_fast_sweep_sees_a_peak_that_is_low_and_late(session, direction, late):
    """Late: at a higher frequency upwards, at a lower one downwards."""
    slow = Rig("rigid")
    fast = replace(slow, effects=(FastSweep(dwell=0.15),))
    run = sweep(session, fast, replace(FAST, direction=direction)).run
    settled = np.abs(reported(slow, run.frequency_hz)[:, 1])
    seen = np.abs(run.channel(2))
    assert seen.max() < 0.8 * settled.max()
    assert late * (run.frequency_hz[seen.argmax()] - run.frequency_hz[settled.argmax()]) > 0.09
    assert run.sweep == direction


def test_a_slow_enough_dwell_is_a_settled_sweep(session):
    rig = Rig("rigid", effects=(FastSweep(dwell=60.0),))
    run = measure_lines(session, rig, FAST, LINES).run
    assert largest_error(run, rig) < SETTLED_LINE


def test_the_standard_error_of_a_fast_sweep_is_noise_alone(session):
    """The transient is in the data, and nothing says so."""
    rig, plan = Rig("rigid", effects=(FastSweep(dwell=0.15),)), replace(FAST, n_lines=25)
    clean = sweep(session, rig, plan).run
    noisy = sweep(session, rig, replace(plan, noise=SensorNoise(relative=0.01), periods=4)).run
    assert clean.std is not None
    assert noisy.std is not None
    assert not clean.std.any()
    size = np.abs(noisy.H[:, 1:6])
    assert np.median(noisy.std[:, 1:6] / size) == pytest.approx(0.01, rel=0.1)
    assert np.max(np.abs(noisy.H - reported(Rig("rigid"), noisy.frequency_hz))[:, 1:6] / noisy.std[:, 1:6]) > 30


def test_a_fast_sweep_is_refined_where_a_settled_one_is(session):
    plan = SweepPlan(f_min_hz=90.0, f_max_hz=110.0, n_lines=11)
    slow, fast = (sweep(session, Rig("rigid", effects=e), plan) for e in ((), (FastSweep(dwell=0.2),)))
    assert_array_equal(slow.run.frequency_hz, fast.run.frequency_hz)
    assert np.isnan([line.transient for line in fast.lines]).all()


# -- direction, drift, noise -----------------------------------------------------------------------


def test_up_and_down_agree_for_a_linear_rotor(session):
    plan = SweepPlan(f_min_hz=80.0, f_max_hz=110.0, n_lines=16)
    up, down = (sweep(session, Rig("rigid"), replace(plan, direction=d)).run for d in ("up", "down"))
    assert (up.sweep, down.sweep) == ("up", "down")
    assert_allclose(up.frequency_hz, down.frequency_hz, rtol=1e-9)
    assert_allclose(up.H, down.H, rtol=0, atol=SETTLED_LINE * np.abs(up.H).max())


def test_drift_moves_what_is_measured_and_not_what_is_reported(session):
    rig = Rig(drift=3e-3)
    run = measure_lines(session, rig, SweepPlan(), LINES).run
    assert_array_equal(run.frequency_hz, LINES)
    exact = reported(rig, LINES * 1.003)
    assert np.max(np.abs(run.H - exact) / np.abs(exact).max(axis=1, keepdims=True)) < SETTLED_LINE


NOISY = SweepPlan(noise=SensorNoise(relative=0.01, seed=7))
OTHERS = {
    "level": (Rig("bearing"), replace(NOISY, force_amplitude=2.0)),
    "node": (Rig("bearing", excitation_node=3), NOISY),
    "plane": (Rig("bearing", excitation_plane="z"), NOISY),
    "support": (Rig("rigid"), NOISY),
    "spin": (Rig("bearing", spin_rpm=600.0), NOISY),
    "repeat": (Rig("bearing"), replace(NOISY, noise=replace(NOISY.noise, repeat=1))),
    "seed": (Rig("bearing"), replace(NOISY, noise=replace(NOISY.noise, seed=8))),
}


def relative_noise(session: FmuSession, rig: Rig, plan: SweepPlan) -> np.ndarray:
    """(2, 5) relative errors of the moving nodes."""
    silent, noisy = (
        measure_lines(session, rig, p, LINES[1:3]).run.H[:, 1:6] for p in (replace(plan, noise=SensorNoise()), plan)
    )
    return noisy / silent - 1


@pytest.mark.parametrize("other", OTHERS.values(), ids=OTHERS)
def test_every_setting_has_noise_of_its_own(session, other):
    first, again = (relative_noise(session, Rig("bearing"), NOISY) for _ in range(2))
    assert_allclose(first, again, rtol=0, atol=SAME_LINE)
    assert np.abs(relative_noise(session, *other) - first).min() > 1e-5


# -- what cannot be carried out --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ((SensorGain(node=8),), "sensor_gain.node: node 8 does not exist: the rotor has nodes 1 to 7"),
        ((AttachedMass(node=8),), "attached_mass.node: node 8 does not exist"),
        ((AttachedMass(), AttachedMass(node=3)), "attached_mass is given twice; the FMU has one of each effect"),
        ((ForceDropout(), FastSweep()), "give force_dropout or fast_sweep"),
    ],
    ids=lambda value: value[0].id if isinstance(value, tuple) else "",
)
def test_a_rig_that_cannot_be_set_up_is_refused_with_a_sentence(session, effects: tuple[Effect, ...], said):
    with pytest.raises(SetupError, match=said):
        measure_lines(session, Rig(effects=effects), SweepPlan(), LINES)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"force_amplitude": 0.0}, "force_amplitude must be a positive number of newtons, got 0"),
        ({"force_amplitude": np.nan}, "force_amplitude must be a positive number of newtons"),
        ({"f_min_hz": 0.0}, "need 0 < f_min_hz <= f_max_hz"),
        ({"f_min_hz": 500.0}, "need 0 < f_min_hz <= f_max_hz"),
        ({"n_lines": 0}, "at least one line"),
        ({"direction": "sideways"}, 'direction must be "up" or "down"'),
        ({"dwell": 0.0}, "dwell must be a positive number"),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused_with_a_sentence(changes, said):
    with pytest.raises(SetupError, match=said):
        SweepPlan(**changes)


def test_a_drift_is_small():
    with pytest.raises(SetupError, match="drift is a small relative change"):
        Rig(drift=-1.0)


def test_effects_are_no_parameters():
    with pytest.raises(SetupError, match=r"bearing_cubic.enabled in parameters: .* give them as effects"):
        Rig(parameters={"bearing_cubic.enabled": True})


def test_two_gains_are_two_sensors(session):
    """Effects that the FMU knows nothing of may be there more than once."""
    rig = Rig(effects=(SensorGain(gain=0.9, node=2), SensorGain(gain=1.2, node=5)))
    assert largest_error(measure_lines(session, rig, SweepPlan(), LINES[:2]).run, rig) < SETTLED_LINE
