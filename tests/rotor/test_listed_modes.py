"""Modes as they are listed and drawn: damping, planes, rigid-body motions, shapes; against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.rotor.effects import PlaneAnisotropy
from rigtwin.rotor.frequency.modal import listed_modes, natural_frequencies_hz
from rigtwin.rotor.frequency.shapes import semi_axes, shaft_shapes
from rigtwin.rotor.frequency.whirl import RPM, whirl_direction
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from rigtwin.rotor.model.rotor_model import build_system
from tests.rotor import rigs
from tests.tolerances import EIGENVALUE_ROUND_OFF, FINE_MESH, NEARLY_MASSLESS, ROUND_OFF, SPECTRAL


def jeffcott(k_b: float, c_b: float):
    """A mass of 2 kg on two bearings."""
    return build_system(assemble(rigs.jeffcott()), Condition(k_b=k_b, bearing_damping=c_b, shaft_damping_ratio=0.0))


def gyroscope(spin_speed: float):
    """A disk at the end of a shaft without give that swings about its one bearing; and I_p, I_d + m L^2."""
    stiff = rigs.lumped_rotor(rigs.LIGHT_STEEL["density_kg_per_m3"], clamped=False)
    segment = stiff.segment[0].model_copy(update={"youngs_modulus_Pa": 207e13})
    rig, disk = stiff.model_copy(update={"segment": [segment]}), stiff.disk[0]
    condition = Condition(k_b=1e12, shaft_damping_ratio=0.0, spin_speed=spin_speed)
    return build_system(assemble(rig), condition), disk.polar_inertia, disk.diametral_inertia + disk.mass * 0.3**2


def test_a_jeffcott_rotor_has_the_damping_and_decrement_of_the_closed_form():
    modes = listed_modes(jeffcott(1e4, 8.0))
    omega = np.sqrt(2e4 / 2.0)
    zeta = 2 * 8.0 / (2 * 2.0 * omega)
    assert_allclose(modes.frequency_hz[0], omega / (2 * np.pi), rtol=100 * NEARLY_MASSLESS)
    assert_allclose(
        modes.damped_frequency_hz[0], omega * np.sqrt(1 - zeta**2) / (2 * np.pi), rtol=100 * NEARLY_MASSLESS
    )
    assert_allclose(modes.damping_ratio[0], zeta, rtol=100 * NEARLY_MASSLESS)
    assert_allclose(modes.log_decrement[0], 2 * np.pi * zeta / np.sqrt(1 - zeta**2), rtol=100 * NEARLY_MASSLESS)


def test_the_decrement_is_the_logarithm_of_two_amplitudes_a_period_apart():
    value = listed_modes(jeffcott(1e4, 60.0)).eigenvalue[0]
    period = 2 * np.pi / value.imag
    ratio = abs(np.exp(value * 0.3) / np.exp(value * (0.3 + period)))
    assert np.log(ratio) > 1
    assert_allclose(listed_modes(jeffcott(1e4, 60.0)).log_decrement[0], np.log(ratio), rtol=ROUND_OFF)


def test_a_mode_that_both_planes_have_is_listed_once():
    system = rigs.paper_system(Condition(k_b=1e6))
    modes = listed_modes(system)
    assert_allclose(modes.frequency_hz[:6], natural_frequencies_hz(system, plane=1)[:6], rtol=EIGENVALUE_ROUND_OFF)
    assert modes.alike.all()
    assert set(modes.plane) == {1}


def test_of_unlike_planes_each_has_its_own_modes():
    system = build_system(rigs.paper_structure(), Condition(k_b=1e6), [PlaneAnisotropy(anisotropy=0.5, angle=0.0)])
    modes = listed_modes(system)
    assert not modes.alike.any()
    assert modes.plane[:4].tolist() == [2, 1, 2, 1]  # softer in z
    assert_allclose(modes.frequency_hz[:8], natural_frequencies_hz(system)[:8], rtol=EIGENVALUE_ROUND_OFF)
    deflections = np.abs(np.array([system.read_out(plane) @ modes.shape for plane in (1, 2)])).max(axis=1)
    assert (deflections[modes.plane - 1, np.arange(len(modes.plane))] > 0).all()
    assert not deflections[2 - modes.plane, np.arange(len(modes.plane))].any()


def test_a_rigid_body_motion_is_listed_at_zero_hertz_and_the_elastic_modes_after_it():
    rig = rigs.lumped_rotor(rigs.LIGHT_STEEL["density_kg_per_m3"], clamped=False)
    system = build_system(assemble(rig), Condition(rigid_support=True, shaft_damping_ratio=0.01))
    modes = listed_modes(system)
    mass, stiffness = rigs.lumped_rotor_matrices(clamped=False)
    omega = np.sqrt(np.trace(np.linalg.solve(mass, stiffness)))  # the other root is zero
    assert modes.rigid_body.tolist()[:3] == [True, False, False]
    assert modes.eigenvalue[0] == 0
    assert np.isnan(modes.damping_ratio[0])
    assert np.isnan(modes.log_decrement[0])
    assert_allclose(modes.frequency_hz[1], omega / (2 * np.pi), rtol=NEARLY_MASSLESS)
    swing = shaft_shapes(system, modes.shape, np.linspace(0, 0.3, 7))[0, :, 0]
    assert_allclose(swing, np.linspace(0, 1, 7), atol=SPECTRAL)


@pytest.mark.parametrize("spin_speed", [300.0, -300.0])
def test_a_gyroscope_nutates_forward_at_the_spin_times_the_ratio_of_its_inertias(spin_speed):
    system, polar, transverse = gyroscope(spin_speed)
    modes = listed_modes(system, spin_speed)
    assert modes.rigid_body.tolist()[:3] == [True, True, False]  # it may point in any direction, in y and in z
    nutation = abs(spin_speed) * polar / transverse
    assert_allclose(2 * np.pi * modes.frequency_hz[2], nutation, rtol=NEARLY_MASSLESS)
    assert whirl_direction(system, modes.shape[:, 2:3])[0] == np.sign(spin_speed)
    straight = shaft_shapes(system, modes.shape[:, 2:3], np.linspace(0, 0.3, 4))[0, :, 0]
    assert_allclose(straight, [0, 1 / 3, 2 / 3, 1], atol=NEARLY_MASSLESS)


def test_a_pinned_beam_has_sines_for_shapes():
    beam = rigs.pinned_beam(rigs.round_shaft(1.0, 0.01))
    system = rigs.held(beam, elements=8, element=euler_bernoulli)
    x = np.linspace(0, 1, 41)
    shapes = shaft_shapes(system, listed_modes(system).shape[:, :3], x)
    assert not shapes[1].any()
    for mode in (1, 2, 3):
        sine = np.sin(mode * np.pi * x)
        own = shapes[0, :, mode - 1]
        assert_allclose(own.imag, 0, atol=SPECTRAL)
        between_nodes = (mode * np.pi / 8) ** 4 / 384  # a cubic through deflections and slopes
        assert_allclose(own.real * np.sign(own[1].real), sine / np.abs(sine).max(), atol=between_nodes)


def test_the_largest_deflection_is_one_and_the_first_of_equally_large_ones_is_positive():
    system = rigs.paper_system(Condition(k_b=1e7))
    nodes = np.array([0.0, 0.0595, 0.119, 0.213, 0.307, 0.3665, 0.426])
    shapes = shaft_shapes(system, listed_modes(system).shape, nodes)
    assert_allclose(np.abs(shapes).max(axis=(0, 1)), 1.0, rtol=EIGENVALUE_ROUND_OFF)
    assert_allclose(shapes[0, [2, 4], 1], [1, -1], rtol=SPECTRAL)  # antisymmetric: both disks move alike


def test_a_joint_that_is_rigid_across_the_shaft_and_gives_in_tilt_bends_the_shape_without_a_step():
    joint = [{"node": 2, "tilt_stiffness_Nm_per_rad": 200.0}]
    beam = rigs.pinned_beam(rigs.round_shaft(1.0, 0.02)).model_dump(exclude_unset=True) | {"joint": joint}
    system = rigs.held(rigs.rig(**beam), elements=4)
    h = 1e-4
    left, at, right = shaft_shapes(system, listed_modes(system).shape[:, :1], np.array([0.5 - h, 0.5, 0.5 + h]))[
        0, :, 0
    ]
    assert_allclose(at, 1, rtol=ROUND_OFF)  # the kink is the largest
    assert_allclose([left, right], 1, rtol=2e-3)
    assert (left.real, right.real) < (1 - h, 1 - h)  # and falls to both sides at once


def test_semi_axes_are_those_of_the_orbit_in_time():
    rng = np.random.default_rng(5)
    y, z = (rng.standard_normal(6) + 1j * rng.standard_normal(6) for _ in range(2))
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 20001))
    radius = np.hypot((y[:, None] * turn).real, (z[:, None] * turn).real)
    major, minor = semi_axes(y, z)
    assert_allclose(major, radius.max(axis=1), rtol=FINE_MESH)
    assert_allclose(np.abs(minor), radius.min(axis=1), atol=2e-4)
    area = np.imag(y * z.conj()) * np.pi  # of the orbit, positive from y towards z
    assert_allclose(np.pi * major * minor, area, rtol=ROUND_OFF)
    assert {-1.0, 1.0} == set(np.sign(minor))


def test_a_revolution_per_minute_in_radians():
    assert_allclose(60 * RPM, 2 * np.pi, rtol=ROUND_OFF)


def test_damping_does_not_hide_a_rigid_body_motion():
    system, _, _ = gyroscope(0.0)
    damped = replace(system, C_support=system.C_support + 1e-3 * system.M)
    assert listed_modes(damped).rigid_body.sum() == listed_modes(system).rigid_body.sum() == 1
