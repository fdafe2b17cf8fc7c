"""Effects of sensors, exciter and sweep, and the forces of a spinning rotor, against formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rigtwin.rotor.effects import (
    EFFECTS,
    AttachedMass,
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
from rigtwin.rotor.frequency.frequency_response import ComplexArray, dynamic_stiffness
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.time.simulator import RotorSimulator
from tests.rotor import rigs
from tests.rotor.effect_cases import BEARING, OMEGA, by_family, node_receptance, paper, paper_with, sensed
from tests.tolerances import NEARLY_MASSLESS, ROUND_OFF, STEPPER

# The shaft's damping follows the modes, and so a mass that is added; formulas for what is added to a
# given rotor are exact without it.
GIVEN = Condition(k_b=2e6, bearing_damping=20.0, shaft_damping_ratio=0.0)


# --- sensors ---------------------------------------------------------------------------------------


def test_a_gain_is_its_sensors_alone_and_the_same_at_every_frequency():
    effect = SensorGain(gain=0.87, node=5)
    for node in range(1, 8):
        assert_allclose(effect.channel_factor(OMEGA, node), 0.87 if node == 5 else 1.0, rtol=0)
    assert_allclose(SensorGain(gain=0.87, node=0).channel_factor(OMEGA, 3), 0.87, rtol=0)


@settings(max_examples=20)
@given(delay=st.floats(0.0, 2e-3))
def test_a_delay_turns_the_phase_in_proportion_to_frequency_and_keeps_the_magnitude(delay):
    factor = SensorDelay(delay=delay).channel_factor(OMEGA, 4)
    assert_allclose(np.abs(factor), 1.0, rtol=ROUND_OFF)
    assert_allclose(factor[1:] / factor[:-1], np.exp(-1j * np.diff(OMEGA) * delay), rtol=ROUND_OFF)
    mirrored = SensorDelay(delay=delay).channel_factor(-OMEGA, 4)
    assert_allclose(mirrored, factor.conj(), rtol=0, atol=ROUND_OFF)


def test_a_delay_reads_a_sine_as_it_was_that_long_ago():
    omega, delay, t = 2 * np.pi * 80.0, 7e-4, np.linspace(0.0, 0.05, 40)
    phasor = (0.3 - 1.2j) * SensorDelay(delay=delay).channel_factor(np.array([omega]), 1)[0]
    now, before = (np.real(p * np.exp(1j * omega * s)) for p, s in ((phasor, t), (0.3 - 1.2j, t - delay)))
    assert_allclose(now, before, rtol=0, atol=ROUND_OFF)


@settings(max_examples=20)
@given(mass=st.floats(0.005, 0.06), node=st.integers(1, 7), drive=st.integers(2, 6))
def test_a_sensors_mass_divides_its_own_channel_by_one_minus_its_inertia(mass, node, drive):
    """H_sd / (1 - omega^2 m H_ss)."""
    H = node_receptance(paper_with(GIVEN))
    loaded = sensed(paper_with(GIVEN, SensorMass(mass=mass, node=node)), node=drive)
    s, d = node - 1, drive - 1
    formula = H[:, s, d] / (1 - OMEGA**2 * mass * H[:, s, s])
    assert_allclose(loaded[:, s], formula, rtol=0, atol=ROUND_OFF * np.abs(H).max())


def test_a_sensors_mass_moves_the_poles_of_its_channel_as_that_mass_would():
    with_sensor, with_mass = (paper_with(BEARING, e) for e in (SensorMass(mass=0.05, node=3), AttachedMass(0.05, 3)))
    assert_allclose(natural_frequencies_hz(with_sensor), natural_frequencies_hz(with_mass), rtol=0)
    assert natural_frequencies_hz(with_sensor)[0] < natural_frequencies_hz(paper_with(BEARING))[0]


def deflection_line(offset: float, plane: int = 1) -> FloatArray:
    """(7,) static deflections that sensors beside every node see under a force at node 3."""
    system = paper_with(GIVEN, SensorPosition(offset=offset, node=0))
    force = system.unit_vector(3, plane)
    return system.read_out(plane) @ np.linalg.solve(system.K, force)


@settings(max_examples=20)
@given(offset=st.floats(-0.01, 0.01).filter(lambda x: abs(x) > 1e-4), plane=st.sampled_from([1, 2]))
def test_a_sensor_between_two_nodes_reads_the_shafts_own_bending_line(offset, plane):
    """At rest the line between two nodes is exact: a rig with nodes at the sensors reads the same."""
    places = [float(x) for x in np.array(rigs.tables()["nodes_m"]) + offset]
    inside = [k for k, x in enumerate(places) if 0 < x < 0.426]
    nodes = sorted([*rigs.tables()["nodes_m"], *(places[k] for k in inside)])

    def number(x: float) -> int:
        return nodes.index(x) + 1

    disks = [disk | {"node": number(x)} for disk, x in zip(rigs.tables()["disk"], (0.119, 0.307), strict=True)]
    supports = [{"node": n, "stiffness": "k_b"} for n in (1, len(nodes))]
    fine = build_system(assemble(Rig.model_validate(rigs.tables(nodes_m=nodes, disk=disks, support=supports))), GIVEN)
    q = np.linalg.solve(fine.K, fine.unit_vector(number(0.119), plane))
    expected = [fine.unit_vector(number(places[k]), plane) @ q for k in inside]
    assert_allclose(deflection_line(offset, plane)[inside], expected, rtol=0, atol=ROUND_OFF * np.abs(q).max())


def test_a_sensor_beyond_the_shafts_end_goes_on_along_its_slope():
    at, beside, twice = (deflection_line(offset)[6] for offset in (0.0, 0.004, 0.008))
    assert_allclose(twice - beside, beside - at, rtol=1e-8)
    assert abs(beside - at) > 0.01 * abs(at)


def test_a_sensor_that_reaches_the_next_mesh_node_reads_it():
    """Half way from node 3 to node 4 lies a mesh node where there are two elements between nodes."""
    system = paper_with(BEARING, SensorPosition(offset=0.047, node=3), elements=2)
    place = 4 * (paper(2).stations[2] + 1)
    assert_allclose(paper(2).x[place // 4], 0.119 + 0.047, rtol=ROUND_OFF)
    assert_allclose(system.read_out(1)[2], (system.free == place).astype(float), rtol=0, atol=0)


def test_where_a_sensor_sits_moves_no_pole():
    beside, nominal = (natural_frequencies_hz(paper_with(BEARING, *e)) for e in ([SensorPosition()], []))
    assert_allclose(beside, nominal, rtol=0)


# --- exciter ---------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(m=st.floats(0.02, 0.5), k=st.floats(1e3, 1e5), c=st.floats(0.0, 50.0), node=st.integers(2, 6))
def test_at_constant_current_the_response_per_nominal_force_is_that_of_the_rotor_with_its_exciter(m, k, c, node):
    """The armature as a mass and its suspension at the drive node, and the current's force on both."""
    condition = Condition(k_b=2e6, bearing_damping=20.0, shaft_damping_ratio=0.0, excitation_node=node)
    H = sensed(paper_with(condition), node=node)
    factor = ForceDropout(mass=m, stiffness=k, damping=c).force_factor(OMEGA, H[:, node - 1])
    exciter = AttachedMass(mass=m, node=node), ExciterSuspension(stiffness=k, damping=c)
    together = sensed(paper_with(condition, *exciter), node=node)
    assert_allclose(H * factor[:, None], together, rtol=0, atol=ROUND_OFF * np.abs(H).max())


def test_behind_a_coil_the_back_emf_brakes_slow_motions_and_is_a_spring_to_fast_ones():
    """i omega c / (1 + i omega tau) is i omega c far below 1/tau and c/tau far above."""
    omega, H = np.array([1.0, 1e7]), np.array([3e-7 - 2e-8j, 1e-9j])
    lagging = ForceDropout(mass=0.1, stiffness=1e4, damping=20.0, time_constant=1e-3).force_factor(omega, H)
    slow = ForceDropout(mass=0.1, stiffness=1e4, damping=20.0).force_factor(omega[:1], H[:1])
    fast = ForceDropout(mass=0.1, stiffness=1e4 + 20.0 / 1e-3, damping=0.0).force_factor(omega[1:], H[1:])
    assert_allclose(1 / lagging - 1, 1 / np.concatenate([slow, fast]) - 1, rtol=1e-3)
    assert not np.allclose(lagging[1] / ForceDropout(damping=20.0).force_factor(omega[1:], H[1:])[0], 1.0, rtol=1e-6)


def test_the_force_drops_where_the_rotor_moves_much():
    f = natural_frequencies_hz(paper_with(BEARING))[0]
    omega = 2 * np.pi * np.array([f, 0.5 * f])
    at_peak, aside = np.abs(ForceDropout(mass=0.3).force_factor(omega, sensed(paper_with(BEARING), omega)[:, 1]))
    assert at_peak < 0.5
    assert abs(aside - 1) < 0.1


# --- raster and sweep ------------------------------------------------------------------------------


def test_raster_and_sweep_change_how_lines_are_taken_and_nothing_else():
    assert CoarseGrid(step=2.5).sweep_changes() == {"step_hz": 2.5}
    assert FastSweep(dwell=0.3).sweep_changes() == {"dwell_s": 0.3}
    for effect in (CoarseGrid(), FastSweep()):
        assert_allclose(sensed(paper_with(BEARING, effect)), sensed(paper_with(BEARING)), rtol=0, atol=0)
        assert_allclose(effect.channel_factor(OMEGA, 1), 1.0, rtol=0)


@pytest.mark.parametrize("key", by_family("chain"))
def test_an_effect_of_the_chain_speaks_in_its_own_way_only(key):
    """By a sensor's channel, the exciter's force, the lines of the sweep, or what is written into the model."""
    effect, H = EFFECTS[key](), sensed(paper_with(BEARING))[:, 1]
    ways = {
        "channel": not np.allclose(effect.channel_factor(OMEGA, 2), 1.0),
        "force": not np.allclose(effect.force_factor(OMEGA, H), 1.0),
        "sweep": bool(effect.sweep_changes()),
        "model": not np.array_equal(sensed(paper_with(BEARING, effect)), sensed(paper_with(BEARING))),
    }
    expected = {"sensor_gain": "channel", "sensor_delay": "channel", "force_dropout": "force"}
    expected |= {"sensor_mass": "model", "sensor_position": "model", "coarse_grid": "sweep", "fast_sweep": "sweep"}
    assert [way for way, used in ways.items() if used] == [expected[key]]


# --- spinning --------------------------------------------------------------------------------------


def jeffcott() -> Rig:
    """A disk in the middle of a light shaft on pins."""
    beam = rigs.pinned_beam(rigs.round_shaft(0.4, 0.02, rigs.LIGHT_STEEL)).model_dump(exclude_unset=True)
    return Rig.model_validate(beam | {"mass": [{"node": 2, "mass_kg": 2.0}]})


def whirl(condition: Condition, unbalance: Effect, turns: int) -> ComplexArray:
    """(turns,) y + i z acceleration of the middle at every full turn, from rest."""
    simulator = RotorSimulator(assemble(jeffcott(), element=euler_bernoulli), condition, [unbalance])
    period = 2 * np.pi / abs(condition.spin_speed)
    rows = []
    for _ in range(turns):
        simulator.advance(simulator.time, period)
        rows.append(simulator.accelerations()[[1, 4]] @ [1, 1j])
    return np.array(rows)


@pytest.mark.parametrize("share", [0.5, 0.95, 1.5])
def test_an_unbalanced_jeffcott_rotor_circles_with_its_amplification(share):
    """y + i z = e Omega^2 / (omega_0^2 - Omega^2 + 2 i zeta omega_0 Omega) e^{i (Omega t + phi)}."""
    rig, zeta, moment, phase = jeffcott(), 0.1, 3e-5, 0.4
    omega_0 = math.sqrt(48 * rigs.section_of(rig).bending_stiffness / (2.0 * 0.4**3))
    condition = Condition(rigid_support=True, shaft_damping_ratio=zeta, spin_speed=share * omega_0)
    settled = whirl(condition, UnbalanceForce(moment=moment, phase=phase, node=2), turns=60)[-1]
    spin = condition.spin_speed
    orbit = moment / 2.0 * spin**2 / (omega_0**2 - spin**2 + 2j * zeta * omega_0 * spin) * np.exp(1j * phase)
    assert_allclose(settled, -(spin**2) * orbit, rtol=NEARLY_MASSLESS)


def test_unbalance_turns_with_the_rotor_and_backwards_when_it_spins_backwards():
    """Reversing the spin mirrors the motion at the y axis."""
    condition = Condition(rigid_support=True, shaft_damping_ratio=0.1, spin_speed=300.0)
    forward = whirl(condition, UnbalanceForce(moment=3e-5, phase=0.4, node=2), 5)
    mirrored = Condition(rigid_support=True, shaft_damping_ratio=0.1, spin_speed=-300.0)
    backward = whirl(mirrored, UnbalanceForce(moment=3e-5, phase=-0.4, node=2), 5)
    assert_allclose(backward, forward.conj(), rtol=0, atol=STEPPER * np.abs(forward).max())


def test_unbalance_pulls_with_the_square_of_the_spin_speed_and_not_at_standstill():
    model = build_model(paper(), BEARING, [UnbalanceForce(moment=2e-5, phase=0.3, node=4)])
    (unbalance,) = model.unbalances
    assert (unbalance.moment, unbalance.phase) == (2e-5, 0.3)
    assert_allclose(unbalance.patterns, [model.system.unit_vector(4, plane) for plane in (1, 2)], rtol=0)
    still = RotorSimulator(paper(), BEARING, [UnbalanceForce()])
    still.advance(0.0, 0.1)
    assert not still.accelerations().any()


def test_gyroscopic_moments_act_with_the_spin_only():
    system = paper_with(BEARING, EFFECTS["gyroscopic"]())
    D, nominal = (dynamic_stiffness(s, OMEGA) for s in (system, paper_with(BEARING)))
    assert_allclose(D, nominal, rtol=0, atol=0)
    across = dynamic_stiffness(system, OMEGA, 500.0) - dynamic_stiffness(paper_with(BEARING), OMEGA, 500.0)
    tilts = np.flatnonzero(np.abs(across).max(axis=(0, 1)))
    assert set(tilts) == {4 * n + k for n in paper().disk_node for k in (2, 3)}
