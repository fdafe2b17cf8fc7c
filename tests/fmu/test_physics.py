"""The rotor as its host sees it: forces and parameters in, accelerations out, nothing else known."""

from __future__ import annotations

import numpy as np
import pytest

from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.modal import damped_modes, natural_frequencies_hz
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.stepped_sine import Rig, SweepPlan, measure_lines
from tests.fmu.truth import CLOCK, PHYSICAL_COORDINATES, SETTLED, FreshRotor, assert_close, held_force, whole_ticks
from tests.tolerances import ROUND_OFF, STEPPER

Y = [f"node_{node}.acceleration_y" for node in range(1, 8)]
Z = [f"node_{node}.acceleration_z" for node in range(1, 8)]


def slowest_decay(system, spin_speed=0.0) -> float:
    """Smallest zeta omega of all modes [1/s]."""
    return float(-damped_modes(system, spin_speed).eigenvalue.real.max())


# -- rest and ring-down --------------------------------------------------------------------------


def test_it_starts_at_rest_and_stays_there(rotor_session):
    rotor_session.start({"spin_speed": 100.0})
    assert rotor_session.get([*Y, *Z, "force_applied"]) == [0.0] * 15
    rotor_session.step(1.0)
    assert rotor_session.get([*Y, *Z, "force_applied"]) == [0.0] * 15


def test_every_start_is_a_start_from_rest(rotor_session):
    def first_second():
        rotor_session.start({"force_amplitude": 1.0, "force_frequency": 90.0})
        return rotor_session.sample(Y, 1e-3, 1000)

    np.testing.assert_array_equal(first_second(), first_second())


@pytest.mark.parametrize(
    "condition",
    [Condition(), Condition(rigid_support=True), Condition(k_b=1e6, bearing_damping=20.0, shaft_damping_ratio=2e-3)],
    ids=["bearing", "rigid", "damped bearing"],
)
def test_it_rings_down_at_the_rate_and_frequency_of_its_first_damped_mode(rotor_session, structure, condition):
    first = damped_modes(build_system(structure, condition)).eigenvalue[0]
    damped_hz, rate = first.imag / (2 * np.pi), -first.real
    sine = {"force_amplitude": 1.0, "force_frequency": damped_hz}
    rotor_session.start({name: getattr(condition, name) for name in condition.__dataclass_fields__} | sine)
    rotor_session.step(2.0)
    rotor_session.set({"force_amplitude": 0.0})
    rotor_session.step(8 / rate)  # higher modes decay faster

    def phasor():
        samples = rotor_session.sample(["node_2.acceleration_y"], 1 / (16 * damped_hz), 16 * 8)[:, 0]
        return samples @ np.exp(-2j * np.pi * np.arange(16 * 8) / 16)

    # Whole periods apart, the two windows hold the same share of the phasor's mirror image.
    elapsed = round(2 / rate * damped_hz) / damped_hz
    start, before = rotor_session.time, phasor()
    rotor_session.step(start + elapsed - rotor_session.time)
    ratio = phasor() / before
    assert -np.log(abs(ratio)) / elapsed == pytest.approx(rate, rel=1e-6)
    assert np.angle(ratio) == pytest.approx(0.0, abs=1e-6)


def test_a_force_that_stays_leaves_the_rotor_bent_and_still(rotor_session, structure):
    rotor_session.start({"force": 1000.0})
    first = rotor_session.get(Y)
    rotor_session.step(SETTLED / slowest_decay(build_system(structure, Condition())))
    assert_close(np.array(rotor_session.get(Y)) + np.array(first), first, 1e-7)


# -- the built-in sine ---------------------------------------------------------------------------


SET_UPS = {
    "bearing": Rig("bearing"),
    "rigid": Rig("rigid"),
    "elsewhere": Rig("bearing", excitation_node=4, excitation_plane="z", parameters={"k_b": 1e6}),
    "spinning": Rig("bearing", spin_rpm=6000.0, parameters={"k_b": 1e6, "bearing_damping": 50.0}),
}


def frf_error(session, structure, rig: Rig, settle: float) -> float:
    """Largest relative error over lines and nodes when ``settle`` of the time to 1e-8 is waited."""
    condition = Condition(rigid_support=rig.support == "rigid", **rig.parameters)
    system, spin_speed = build_system(structure, condition), rig.spin_rpm * np.pi / 30
    settle_time = settle * SETTLED / slowest_decay(system, spin_speed)
    lines = [25.0, *natural_frequencies_hz(system, 1)[:2], 150.0, 390.0]
    plan = SweepPlan(settle_time=settle_time, settling_tolerance=np.inf)
    run = measure_lines(session, rig, plan, sorted(lines)).run
    plane = "yz".index(rig.excitation_plane) + 1
    truth = accelerance(
        system, run.frequency_hz, excitation_node=rig.excitation_node, plane=plane, spin_speed=spin_speed
    )[:, :, 0]
    moving = np.flatnonzero(truth.any(axis=0))  # not a rigid support's own nodes
    return float(np.abs(run.H[:, moving] / truth[:, moving] - 1).max())


@pytest.mark.parametrize("rig", SET_UPS.values(), ids=SET_UPS)
def test_a_settled_stepped_sine_gives_the_direct_accelerance(rotor_session, structure, rig):
    assert frf_error(rotor_session, structure, rig, settle=1.0) < 1e-6


@pytest.mark.parametrize("rig", SET_UPS.values(), ids=SET_UPS)
def test_a_tenth_of_the_settling_time_is_not_enough(rotor_session, structure, rig):
    """Negative control: the transient is real, and the check above sees it."""
    assert frf_error(rotor_session, structure, rig, settle=0.1) > 1e-4


def test_the_applied_force_is_the_input_plus_the_sine(rotor_session):
    rotor_session.start({"force": 0.25, "force_amplitude": 2.0, "force_frequency": 7.0})
    h = whole_ticks(1e-3)
    applied = rotor_session.sample(["force_applied"], h, 500)[:, 0]
    assert_close(applied, 0.25 + 2.0 * np.sin(2 * np.pi * 7.0 * h * np.arange(500)), ROUND_OFF)


def test_the_sines_phase_is_continuous_when_its_frequency_changes(rotor_session):
    rotor_session.start({"force_amplitude": 1.0})
    cycles = 0.0
    for frequency, step in [(80.0, 0.0131), (250.5, 0.0077), (20.0, 1.2345), (399.9, 30.001), (80.0, 0.0003)]:
        h = whole_ticks(step)
        before = rotor_session.get(["force_applied"])
        rotor_session.set({"force_frequency": frequency})
        assert rotor_session.get(["force_applied"]) == before
        rotor_session.step(h)
        cycles += frequency * h
        assert rotor_session.get(["force_applied"]) == pytest.approx([np.sin(2 * np.pi * cycles)], abs=ROUND_OFF)


def test_response_to_two_forces_is_the_sum_of_the_responses(rotor_session):
    def response(**forces):
        rotor_session.start({"force_frequency": 60.0, **forces})
        return rotor_session.sample(Y, 1e-3, 200)

    both = response(force=3.0, force_amplitude=2.0)
    assert_close(both, 3 * response(force=1.0) + 2 * response(force_amplitude=1.0), STEPPER)


def test_a_force_in_z_moves_z_as_a_force_in_y_moves_y(rotor_session):
    readings = {}
    for plane in (1, 2):
        rotor_session.start({"excitation_plane": plane, "force_amplitude": 1.0, "force_frequency": 60.0})
        readings[plane] = rotor_session.sample([*Y, *Z], 1e-3, 200)
    assert not readings[1][:, 7:].any()
    assert not readings[2][:, :7].any()
    assert_close(readings[2][:, 7:], readings[1][:, :7], ROUND_OFF)


def test_reciprocity_force_and_accelerometer_may_change_places(rotor_session):
    def at(force_node, sensor_node):
        rotor_session.start({"excitation_node": force_node, "force_amplitude": 1.0, "force_frequency": 60.0})
        return rotor_session.sample([f"node_{sensor_node}.acceleration_y"], 1e-3, 200)

    assert_close(at(2, 5), at(5, 2), STEPPER)


def test_a_rigid_supports_own_nodes_read_exactly_zero(rotor_session):
    rotor_session.start({"rigid_support": True, "force_amplitude": 1.0, "force": 5.0, "spin_speed": 300.0})
    readings = rotor_session.sample([Y[0], Y[6], Z[0], Z[6], Y[1], Z[1]], 1e-3, 100)
    assert not readings[:, :4].any()
    assert readings[1:, 4:].all()


# -- the held force ------------------------------------------------------------------------------


def drive(session, u, h, parameters):
    """(n_steps, 7) accelerations of a master that sets a force that is held, steps, and then reads."""
    session.start({"held_force.enabled": True, **parameters})
    readings = []
    for force in u:
        session.set({"force": force})
        session.step(h)
        readings.append(session.get(Y))
    return np.array(readings)


@pytest.mark.parametrize("h", [1e-4, 2e-5])
def test_a_held_force_gives_the_zero_order_hold_response_from_the_first_step(rotor_session, structure, h):
    u = np.cos(2 * np.pi * 50.0 * h * np.arange(800)) + 0.3
    expected = held_force(build_system(structure, Condition()), h).respond(u)
    assert_close(drive(rotor_session, u, h, {}), expected, CLOCK)


def test_a_settled_held_force_measures_G_and_not_H(rotor_session, structure):
    """G(z) = C (z 1 - A_d)^-1 B_d + D / z: the price of holding the force, to be known by who closes a loop."""
    h, f, zeta = 1e-4, 50.0, 0.05
    system = build_system(structure, Condition(shaft_damping_ratio=zeta))
    settled, window = round(SETTLED / slowest_decay(system) / h), 200 * 4  # four periods of 200 steps
    u = np.cos(2 * np.pi * f * h * np.arange(settled + window))
    readings = drive(rotor_session, u, h, {"shaft_damping_ratio": zeta})[-window:]
    read_at = h * (np.arange(settled, settled + window) + 1)
    measured = 2 / window * np.exp(-2j * np.pi * f * read_at) @ readings
    expected = held_force(system, h).G(f)
    assert_close(measured, expected, CLOCK)
    direct = accelerance(system, np.array([f]))[0, :, 0]
    assert np.abs(measured / direct - 1).max() > 0.5


@pytest.mark.parametrize(("h", "degrees"), [(1e-4, 74.3), (2e-5, 33.2)])
def test_holding_the_force_costs_tens_of_degrees_at_the_driving_point(structure, h, degrees):
    """The shipped rig at node 2 and 50 Hz; the FMU follows this model step by step (see above)."""
    system = build_system(structure, Condition())
    error = np.angle(held_force(system, h).G(50.0) / accelerance(system, np.array([50.0]))[0, :, 0], deg=True)
    assert error[1] == pytest.approx(degrees, abs=0.05)
    assert np.abs(error[2:5]).max() < 10  # where the rotor moves much


def test_the_built_in_sine_costs_nothing(rotor_session, structure):
    """Same line, same number of samples a period as a held force of h = 1e-4 s would take."""
    system = build_system(structure, Condition())
    rotor_session.start({"force_amplitude": 1.0, "force_frequency": 50.0})
    rotor_session.step(2 * SETTLED / slowest_decay(system))
    samples = rotor_session.sample([*Y, "force_applied"], 1e-4, 200)
    phasors = np.exp(-2j * np.pi * np.arange(200) / 200) @ samples
    assert_close(phasors[:-1] / phasors[-1], accelerance(system, np.array([50.0]))[0, :, 0], CLOCK)


# -- parameters that change while it runs --------------------------------------------------------


H_BEFORE, H_AFTER = whole_ticks(5.03e-3), whole_ticks(2.5e-3)
RUNNING = {"force_amplitude": 2.0, "force_frequency": 83.0, "force": 0.5, "spin_speed": 300.0, "k_b": 2e6}


def run_to_the_change(session, structure):
    """The FMU and the same rotor in physical coordinates, both 50.3 ms into a run."""
    session.start(RUNNING)
    rotor = FreshRotor(structure, Condition(k_b=2e6), spin_speed=300.0)
    for _ in range(10):
        session.step(H_BEFORE)
        rotor.step(H_BEFORE, force=0.5, amplitude=2.0, frequency_hz=83.0)
    return rotor


CHANGES = {
    "softer": {"k_b": 5e5},
    "stiffer": {"k_b": 3e7},
    "bearing damping": {"bearing_damping": 200.0},
    "shaft damping": {"shaft_damping_ratio": 0.05},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_after_a_change_it_moves_as_a_fresh_rotor_started_from_the_same_motion(rotor_session, structure, change):
    before = run_to_the_change(rotor_session, structure)
    rotor_session.set(change)
    fresh = FreshRotor(
        structure, Condition(**{"k_b": 2e6, **change}), spin_speed=300.0, motion=before.motion, phase=before.phase
    )
    for _ in range(5):
        (force,) = rotor_session.get(["force_applied"])
        assert_close(rotor_session.get([*Y, *Z]), fresh.accelerations(force), PHYSICAL_COORDINATES)
        rotor_session.step(H_AFTER)
        fresh.step(H_AFTER, force=0.5, amplitude=2.0, frequency_hz=83.0)


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_change_makes_no_other_jump_than_its_own_force(rotor_session, structure, change):
    """Deflections q and velocities q' are continuous: the accelerations jump by -M^-1 (dK q + dC q')."""
    before = run_to_the_change(rotor_session, structure)
    old, new = before.system, build_system(structure, Condition(**{"k_b": 2e6, **change}))
    readings = np.array(rotor_session.get([*Y, *Z]))
    rotor_session.set(change)
    jump = np.array(rotor_session.get([*Y, *Z])) - readings
    q, velocity = before.motion
    expected = -np.linalg.solve(old.M, (new.K - old.K) @ q + (new.C - old.C) @ velocity)
    assert_close(jump, np.concatenate([old.read_out(1), old.read_out(2)]) @ expected, PHYSICAL_COORDINATES)
    assert np.abs(jump).max() > 1e-3 * np.abs(readings).max()


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_change_there_and_back_leaves_the_motion_as_it_was(rotor_session, change):
    """A change does no work at its instant: taken back at once, it leaves energy and motion alone."""
    original = {"k_b": 2e6, "bearing_damping": 0.0, "shaft_damping_ratio": 0.001}
    untouched = {**original, "force_amplitude": 1.0, "force_frequency": 83.0}
    readings = []
    for times in (0, 20):
        rotor_session.start(untouched)
        rotor_session.step(0.5)
        for _ in range(times):
            rotor_session.set(change)
            rotor_session.set({name: original[name] for name in change})
        readings.append(rotor_session.sample(Y, 1e-3, 100))
    assert_close(readings[1], readings[0], STEPPER)


# -- spin ----------------------------------------------------------------------------------------


def spinning(session, spin_speed):
    session.start({"spin_speed": spin_speed, "force_amplitude": 1.0, "force_frequency": 60.0})
    readings = session.sample([*Y, *Z], 1e-3, 300)
    return readings[:, :7], readings[:, 7:]


def test_only_a_spinning_rotor_moves_out_of_the_plane_of_the_force(rotor_session):
    _, z_at_standstill = spinning(rotor_session, 0.0)
    _, z = spinning(rotor_session, 500.0)
    assert not z_at_standstill.any()
    assert np.abs(z).max() > 1e-4


def test_reversing_the_spin_flips_the_other_plane_and_nothing_else(rotor_session):
    y, z = spinning(rotor_session, 500.0)
    y_reversed, z_reversed = spinning(rotor_session, -500.0)
    assert_close(y_reversed, y, STEPPER)
    assert_close(z_reversed, -z, 1e-6)


def test_it_may_spin_up_while_it_runs(rotor_session, structure):
    before = run_to_the_change(rotor_session, structure)
    rotor_session.set({"spin_speed": -800.0})
    fresh = FreshRotor(structure, Condition(k_b=2e6), spin_speed=-800.0, motion=before.motion, phase=before.phase)
    for _ in range(5):
        (force,) = rotor_session.get(["force_applied"])
        assert_close(rotor_session.get([*Y, *Z]), fresh.accelerations(force), PHYSICAL_COORDINATES)
        rotor_session.step(H_AFTER)
        fresh.step(H_AFTER, force=0.5, amplitude=2.0, frequency_hz=83.0)
