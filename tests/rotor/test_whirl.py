"""Whirl direction, critical speeds and unbalance response against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.rotor.effects import DiskInertia, Gyroscopic, PlaneAnisotropy, UnbalanceForce, ViscoelasticSupport
from rigtwin.rotor.frequency.whirl import (
    campbell,
    critical_speeds,
    crossings,
    followed_campbell,
    speeds_through_resonances,
    unbalance_response,
    whirl_direction,
)
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.time.simulator import RotorSimulator
from tests.rotor import rigs
from tests.rotor.test_assembly import UNDAMPED, overhung
from tests.tolerances import EIGENVALUE_ROUND_OFF, NEARLY_MASSLESS, PEAK_BETWEEN_SPEEDS, SPECTRAL

SPINNING_DISKS = (DiskInertia(), Gyroscopic())
BEARINGS = Condition(k_b=1.3e6, bearing_damping=100.0, shaft_damping_ratio=0.0)


def overhung_criticals(rig):
    """Synchronous whirl of the overhung disk: Omega = omega forward, Omega = -omega backward [rad/s]."""
    EI, L, disk = rigs.section_of(rig).bending_stiffness, rig.length, rig.disk[0]
    forward, backward = (
        np.roots(
            np.polymul([-disk.mass, 12 * EI / L**3], [sign * disk.polar_inertia - disk.diametral_inertia, 4 * EI / L])
            - np.array([0, 0, (6 * EI / L**2) ** 2])
        )
        for sign in (1, -1)
    )
    real = [np.sqrt(w2) for w2 in forward if w2 > 0], [np.sqrt(w2) for w2 in backward if w2 > 0]
    return sorted([(w, 1.0) for w in real[0]] + [(w, -1.0) for w in real[1]])


@pytest.mark.parametrize("polar_share", [0.5, 2.0])
def test_critical_speeds_of_an_overhung_disk_are_those_of_the_closed_form(polar_share):
    """A thin disk (polar share 2) has one forward critical speed only: no spin catches its second forward whirl."""
    rig = overhung(polar_share)
    system = rigs.held(rig, elements=1, element=euler_bernoulli, condition=UNDAMPED)
    expected = overhung_criticals(rig)
    found = critical_speeds(system, n=len(expected))
    assert_allclose(found.spin_speed, [w for w, _ in expected], rtol=NEARLY_MASSLESS)
    assert found.direction.tolist() == [d for _, d in expected]


@pytest.mark.parametrize("effects", [SPINNING_DISKS, (*SPINNING_DISKS, PlaneAnisotropy()), ()])
def test_at_a_critical_speed_a_whirl_turns_as_fast_as_the_rotor(effects):
    system = build_system(rigs.paper_structure(), Condition(k_b=1.3e6, shaft_damping_ratio=0.0), effects)
    for Omega in critical_speeds(system, n=6).spin_speed:
        whirl = 2 * np.pi * campbell(system, np.array([Omega]), n_modes=10).frequency_hz[0]
        assert np.abs(whirl / Omega - 1).min() < EIGENVALUE_ROUND_OFF


def test_critical_speeds_of_a_viscoelastic_rotor_are_those_of_its_relaxed_stiffness():
    relaxed = build_system(rigs.paper_structure(), BEARINGS, SPINNING_DISKS)
    viscoelastic = build_system(rigs.paper_structure(), BEARINGS, (*SPINNING_DISKS, ViscoelasticSupport()))
    assert_allclose(critical_speeds(viscoelastic).spin_speed, critical_speeds(relaxed).spin_speed, rtol=SPECTRAL)


def test_a_rotor_that_nothing_holds_has_the_critical_speeds_of_its_bending():
    """Rigid-body motions are left out: four of a free rotor in both planes."""
    free = build_system(rigs.paper_structure(), Condition(k_b=1e-6), SPINNING_DISKS)
    assert np.count_nonzero(~free.modes.elastic) == 4
    barely_held = build_system(rigs.paper_structure(), Condition(k_b=1.0), SPINNING_DISKS)
    of_bending = critical_speeds(barely_held, n=8).spin_speed[4:]
    assert_allclose(critical_speeds(free, n=4).spin_speed, of_bending, rtol=NEARLY_MASSLESS)


def test_critical_speeds_of_a_rotor_that_swings_about_its_bearing_are_those_of_the_closed_form():
    """K = k b b' has one root beside zero: omega^2 = k (b_1^2 / m + b_2^2 / (I_d -+ I_p)), here only backward."""
    swinging = rigs.lumped_rotor(rigs.LIGHT_STEEL["density_kg_per_m3"], clamped=False)
    system = build_system(assemble(swinging), UNDAMPED)
    _, stiffness = rigs.lumped_rotor_matrices(clamped=False)
    disk = swinging.disk[0]
    backward = np.diag([disk.mass, disk.diametral_inertia + disk.polar_inertia])
    expected = np.sqrt(np.trace(np.linalg.solve(backward, stiffness)))
    assert np.trace(np.linalg.solve(np.diag([disk.mass, disk.diametral_inertia - disk.polar_inertia]), stiffness)) < 0
    found = critical_speeds(system, n=1)
    assert_allclose(found.spin_speed, expected, rtol=NEARLY_MASSLESS)
    assert found.direction.tolist() == [-1.0]


def test_lines_of_a_campbell_diagram_are_followed_where_they_cross():
    """Forward whirls rise through falling backward ones: sorted by frequency, a column changes its direction."""
    system = build_system(rigs.paper_structure(), BEARINGS, SPINNING_DISKS)
    speeds = np.linspace(0.0, 12_000.0, 61)
    sorted_, followed = campbell(system, speeds, n_modes=8), followed_campbell(system, speeds, n_modes=8)
    assert (sorted_.direction[1:] != sorted_.direction[1]).any()
    assert (followed.direction[1:] == followed.direction[1]).all()
    assert_allclose(followed.frequency_hz[0], sorted_.frequency_hz[0], rtol=EIGENVALUE_ROUND_OFF)
    assert (np.abs(np.diff(followed.frequency_hz, axis=0)) < 0.1 * followed.frequency_hz[1:]).all()


def test_an_undamped_rotor_meets_the_synchronous_line_at_its_critical_speeds():
    system = build_system(rigs.paper_structure(), Condition(k_b=1.3e6, shaft_damping_ratio=0.0), SPINNING_DISKS)
    found = crossings(system, followed_campbell(system, np.linspace(0.0, 3_000.0, 31), n_modes=8))
    expected = critical_speeds(system, n=len(found.spin_speed))
    assert len(found.spin_speed) > 3
    assert_allclose(found.spin_speed, expected.spin_speed, rtol=EIGENVALUE_ROUND_OFF)
    assert (found.direction == expected.direction).all()


@pytest.mark.parametrize("multiple", [0.5, 2.0])
def test_at_a_crossing_a_whirl_turns_at_the_multiple_of_the_spin(multiple):
    system = build_system(rigs.paper_structure(), BEARINGS, SPINNING_DISKS)
    diagram = followed_campbell(system, np.linspace(0.0, 3_000.0, 31), n_modes=6)
    found = crossings(system, diagram, multiple)
    assert len(found.mode) > 1
    for Omega, value in zip(found.spin_speed, found.eigenvalue, strict=True):
        whirl = 2 * np.pi * campbell(system, np.array([Omega]), n_modes=12).frequency_hz[0]
        assert np.abs(whirl / (multiple * Omega) - 1).min() < EIGENVALUE_ROUND_OFF
        assert_allclose(value.imag, multiple * Omega, rtol=EIGENVALUE_ROUND_OFF)
        assert value.real < 0


def test_a_diagram_below_the_first_critical_speed_has_no_crossing():
    system = build_system(rigs.paper_structure(), BEARINGS)
    assert not len(crossings(system, followed_campbell(system, np.linspace(0.0, 100.0, 4), n_modes=4)).mode)


def test_forward_whirl_rises_and_backward_whirl_falls_with_the_spin():
    system = build_system(rigs.paper_structure(), BEARINGS, SPINNING_DISKS)
    map_ = campbell(system, np.array([200.0, 1500.0]), n_modes=4)
    assert map_.direction.tolist() == [[-1, 1, -1, 1]] * 2
    slope = map_.frequency_hz[1] - map_.frequency_hz[0]
    assert (np.sign(slope) == map_.direction[0]).all()


def test_reversing_the_spin_keeps_frequencies_and_directions():
    """Forward is with the spin, whichever way it turns."""
    system = build_system(rigs.paper_structure(), BEARINGS, SPINNING_DISKS)
    there, back = (campbell(system, np.array([s]), n_modes=6) for s in (900.0, -900.0))
    assert_allclose(back.frequency_hz, there.frequency_hz, rtol=EIGENVALUE_ROUND_OFF)
    assert (back.direction == there.direction).all()


def test_a_standing_rotor_on_unlike_planes_vibrates_in_a_plane():
    system = build_system(rigs.paper_structure(), BEARINGS, [PlaneAnisotropy(angle=0.4)])
    assert not campbell(system, np.array([0.0]), n_modes=4).direction.any()


def test_a_heavy_disk_on_a_light_shaft_runs_out_as_jeffcott_says():
    """r = e omega^2 / (k/m - omega^2 + i c omega / m) for a mass on two springs and dampers."""
    rig = rigs.jeffcott()
    structure, condition = assemble(rig), Condition(k_b=1e4, bearing_damping=8.0, shaft_damping_ratio=0.0)
    model = build_model(structure, condition, [UnbalanceForce(moment=1e-4, phase=0.3, node=2)])
    Omega = np.array([20.0, 80.0, 99.0, 101.0, 300.0])
    m = rig.disk[0].mass
    expected = 1e-4 * Omega**2 * np.exp(0.3j) / (2e4 - m * Omega**2 + 16j * Omega)
    y, z = unbalance_response(model, Omega)[:, :, 1].T
    assert_allclose(y, expected, rtol=100 * NEARLY_MASSLESS)
    assert_allclose(z, -1j * y, rtol=SPECTRAL)


def test_the_peak_of_a_jeffcott_rotor_is_not_missed_between_speeds():
    """Largest deflection u / (2 m zeta sqrt(1 - zeta^2)) at omega / sqrt(1 - 2 zeta^2), from three even speeds."""
    structure, m, k_b, c_b = assemble(rigs.jeffcott()), 2.0, 1e4, 0.05
    condition = Condition(k_b=k_b, bearing_damping=c_b, shaft_damping_ratio=0.0)
    model = build_model(structure, condition, [UnbalanceForce(moment=1e-4, node=2)])
    speeds = speeds_through_resonances(model.system, 10.0, 300.0, 3)
    omega = np.sqrt(2 * k_b / m)
    zeta = c_b / (m * omega)
    deflection = np.abs(unbalance_response(model, speeds)[:, 0, 1])
    assert_allclose(deflection.max(), 1e-4 / (2 * m * zeta * np.sqrt(1 - zeta**2)), rtol=PEAK_BETWEEN_SPEEDS)
    assert_allclose(speeds[np.argmax(deflection)], omega / np.sqrt(1 - 2 * zeta**2), rtol=zeta)
    assert (np.diff(speeds) > 0).all()
    assert (speeds[0], speeds[-1]) == (10.0, 300.0)


def test_the_simulated_rotor_settles_on_the_unbalance_response():
    """Deflection phasors times -Omega^2 against accelerations read after the transient is gone."""
    Omega, effects = 450.0, (*SPINNING_DISKS, UnbalanceForce(moment=2e-5, phase=0.7, node=3))
    condition = Condition(k_b=1.3e6, bearing_damping=100.0, spin_speed=Omega, shaft_damping_ratio=0.02)
    simulator = RotorSimulator(rigs.paper_structure(), condition, effects)
    simulator.drive(force=0.0, force_amplitude=0.0, force_frequency=50.0)
    simulator.advance(0.0, 20.0)
    phasors = unbalance_response(build_model(rigs.paper_structure(), condition, effects), np.array([Omega]))[0]
    expected = (-(Omega**2) * phasors * np.exp(1j * Omega * 20.0)).real
    found = simulator.accelerations().reshape(2, -1)
    assert_allclose(found, expected, rtol=0, atol=SPECTRAL * np.abs(expected).max())


def test_the_direction_of_a_circle_is_that_of_its_turning():
    system = build_system(rigs.paper_structure(), BEARINGS)
    node_y, node_z = system.unit_vector(4, 1), system.unit_vector(4, 2)
    shapes = np.array([node_y - 1j * node_z, node_y + 1j * node_z, node_y + node_z]).T
    assert whirl_direction(system, shapes).tolist() == [1, -1, 0]
