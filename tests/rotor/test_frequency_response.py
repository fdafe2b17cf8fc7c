"""Direct frequency response: symmetries, scaling, rigid nodes, damping models."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rigtwin.rotor.frequency.frequency_response import (
    accelerance,
    dynamic_stiffness,
    hysteretic_dynamic_stiffness,
    receptance,
)
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.system import LinearSystem, undamped_modes
from tests.rotor import rigs
from tests.rotor.oscillators import OMEGA_0, masses
from tests.tolerances import LIGHT_DAMPING, ROUND_OFF, SPECTRAL

OMEGA = 2 * np.pi * np.linspace(20.0, 400.0, 77)
SPIN = 400.0

conditions = st.one_of(
    st.just(rigs.RIGID),
    st.builds(Condition, k_b=st.floats(5, 10).map(lambda e: 10**e), bearing_damping=st.floats(0, 100)),
)


def with_gyroscopic_disks(condition: Condition) -> LinearSystem:
    disks = [{"node": node, "inertia": True, **rigs.ROSS["disk"]} for node in (3, 5)]
    return build_system(assemble(Rig.model_validate(rigs.tables(disk=disks))), condition)


def every_node(system: LinearSystem) -> np.ndarray:
    """(n, 14) unit forces at every node, in y and in z."""
    return np.vstack([system.read_out(1), system.read_out(2)]).T


def full_receptance(system: LinearSystem, spin_speed: float = 0.0, omega: np.ndarray = OMEGA) -> np.ndarray:
    forces = every_node(system)
    return receptance(dynamic_stiffness(system, omega, spin_speed), forces, forces.T)


@settings(max_examples=15)
@given(condition=conditions)
def test_receptance_at_standstill_is_symmetric(condition):
    H = full_receptance(with_gyroscopic_disks(condition))
    assert_allclose(H, H.swapaxes(1, 2), rtol=0, atol=ROUND_OFF * np.abs(H).max())


@settings(max_examples=15)
@given(condition=conditions, spin_speed=st.floats(1, 2000))
def test_reversing_the_spin_transposes_the_receptance(condition, spin_speed):
    system = with_gyroscopic_disks(condition)
    H, reversed_H = full_receptance(system, spin_speed), full_receptance(system, -spin_speed)
    assert_allclose(reversed_H, H.swapaxes(1, 2), rtol=0, atol=ROUND_OFF * np.abs(H).max())


def test_spin_breaks_the_symmetry():
    H = full_receptance(with_gyroscopic_disks(Condition()), SPIN)
    assert np.abs(H - H.swapaxes(1, 2)).max() > 1e-3 * np.abs(H).max()


@settings(max_examples=15)
@given(condition=conditions, spin_speed=st.floats(-2000, 2000))
def test_negative_frequency_conjugates_the_receptance(condition, spin_speed):
    system = with_gyroscopic_disks(condition)
    H, mirrored = (full_receptance(system, spin_speed, omega) for omega in (OMEGA, -OMEGA))
    assert_allclose(mirrored, H.conj(), rtol=0, atol=ROUND_OFF * np.abs(H).max())


def test_negative_frequency_conjugates_the_hysteretic_receptance():
    system = rigs.paper_system(rigs.RIGID)
    force, read_out = rigs.driving_point(system)
    H, mirrored = (receptance(hysteretic_dynamic_stiffness(system, w), force, read_out) for w in (OMEGA, -OMEGA))
    assert_allclose(mirrored, H.conj(), rtol=0, atol=ROUND_OFF * np.abs(H).max())


@given(factor=st.floats(-1e3, 1e3).filter(lambda f: abs(f) > 1e-3))
def test_the_response_scales_with_the_force(factor):
    system = rigs.paper_system(Condition(k_b=1e6))
    force, read_out = rigs.driving_point(system)
    D = dynamic_stiffness(system, OMEGA[:5])
    H, scaled = (receptance(D, f, read_out) for f in (force, factor * force))
    assert_allclose(scaled, factor * H, rtol=0, atol=ROUND_OFF * np.abs(scaled).max())


def test_the_response_to_two_forces_is_the_sum():
    system = rigs.paper_system(Condition(k_b=1e6))
    D, forces = dynamic_stiffness(system, OMEGA), every_node(system)
    apart = receptance(D, forces[:, [1, 4]], forces.T)
    together = receptance(D, forces[:, [1]] + forces[:, [4]], forces.T)
    assert_allclose(together[:, :, 0], apart.sum(axis=2), rtol=0, atol=ROUND_OFF * np.abs(apart).max())


def test_rigidly_held_nodes_read_exactly_zero():
    A = accelerance(rigs.paper_system(rigs.RIGID), OMEGA / (2 * np.pi))
    assert A.shape == (len(OMEGA), 7, 1)
    assert not A[:, [0, 6]].any()
    assert np.abs(A[:, 1:6]).min() > 0


def test_a_force_on_a_rigidly_held_node_moves_nothing():
    assert not accelerance(rigs.paper_system(rigs.RIGID), np.array([50.0]), excitation_node=1).any()


def test_a_force_in_one_plane_leaves_the_other_at_rest_exactly():
    system = rigs.paper_system(Condition(k_b=1e6))
    force, _ = rigs.driving_point(system)
    assert not receptance(dynamic_stiffness(system, OMEGA), force, system.read_out(2)).any()


def test_accelerance_is_receptance_times_minus_omega_squared():
    system = rigs.paper_system(Condition(k_b=1e6))
    force, read_out = rigs.driving_point(system)
    H = receptance(dynamic_stiffness(system, OMEGA), force, read_out)
    A = accelerance(system, OMEGA / (2 * np.pi), excitation_node=2)
    assert_allclose(A, -(OMEGA[:, None, None] ** 2) * H, rtol=SPECTRAL)


def test_both_planes_of_a_round_rotor_respond_alike():
    system = rigs.paper_system(Condition(k_b=1e6))
    in_y, in_z = (accelerance(system, OMEGA / (2 * np.pi), plane=plane) for plane in (1, 2))
    assert_allclose(in_y, in_z, rtol=0, atol=ROUND_OFF * np.abs(in_y).max())


def test_the_static_response_is_the_flexibility():
    system = rigs.paper_system(Condition(k_b=1e6))
    force, read_out = rigs.driving_point(system)
    static = receptance(dynamic_stiffness(system, np.zeros(1)), force, read_out)[0]
    assert_allclose(static, read_out @ np.linalg.solve(system.K, force), rtol=ROUND_OFF)


def test_modal_superposition_gives_the_direct_response():
    """On rigid supports the damping is modal: H = sum of phi phi' / (omega_r^2 - omega^2 + 2 i zeta omega_r omega)."""
    system = rigs.paper_system(rigs.RIGID)
    modes, (force, read_out) = undamped_modes(system), rigs.driving_point(system)
    w, zeta = OMEGA[:, None], system.shaft_damping_ratio
    modal = 1 / (modes.omega**2 - w**2 + 2j * zeta * modes.omega * w)  # (n_freq, n_modes)
    superposed = np.einsum("om,fm,m->fo", read_out @ modes.Phi, modal, (modes.Phi.T @ force)[:, 0])
    direct = receptance(dynamic_stiffness(system, OMEGA), force, read_out)[:, :, 0]
    assert_allclose(direct, superposed, rtol=0, atol=ROUND_OFF * np.abs(direct).max())


@pytest.mark.parametrize("operator", [dynamic_stiffness, hysteretic_dynamic_stiffness])
@pytest.mark.parametrize("mode", [0, 2], ids=["f1", "f2"])
def test_a_resonance_peak_is_the_modal_flexibility_over_twice_the_damping_ratio(operator, mode):
    """Viscous and hysteretic alike: |H| = phi_2^2 / (2 zeta omega^2) on rigid supports."""
    system = rigs.paper_system(rigs.RIGID)
    modes = undamped_modes(system)
    pair = modes.Phi[:, mode : mode + 2]  # the y and the z mode of this frequency
    force, read_out = rigs.driving_point(system)
    flexibility = ((pair.T @ force) ** 2).sum() / modes.omega[mode] ** 2
    peak = receptance(operator(system, modes.omega[[mode]]), force, read_out)[0, 1, 0]
    assert_allclose(peak, -1j * flexibility / (2 * system.shaft_damping_ratio), rtol=20 * LIGHT_DAMPING)
    assert_allclose(peak.imag, -flexibility / (2 * system.shaft_damping_ratio), rtol=LIGHT_DAMPING)


@pytest.mark.parametrize("condition", [rigs.RIGID, Condition(k_b=1e7)], ids=["rigid", "bearing"])
def test_viscous_and_hysteretic_damping_agree_at_resonance(condition):
    system = rigs.paper_system(condition)
    omega = np.unique(undamped_modes(system).omega.round(9))[:3]
    force, read_out = rigs.driving_point(system)
    viscous, hysteretic = (
        receptance(operator(system, omega), force, read_out)[:, 1, 0]
        for operator in (dynamic_stiffness, hysteretic_dynamic_stiffness)
    )
    assert_allclose(viscous, hysteretic, rtol=LIGHT_DAMPING)


def test_viscous_and_hysteretic_damping_differ_off_resonance():
    system = rigs.paper_system(rigs.RIGID)
    off = np.array([2 * undamped_modes(system).omega[0]])
    force, read_out = rigs.driving_point(system)
    viscous, hysteretic = (
        receptance(operator(system, off), force, read_out)[0, 1, 0].imag
        for operator in (dynamic_stiffness, hysteretic_dynamic_stiffness)
    )
    assert abs(viscous / hysteretic - 1) > 0.1


def test_a_critically_damped_mode_has_poles_and_takes_nothing_from_a_sharp_resonance_beside_it():
    """Two masses on springs of their own: two poles lie upon each other, two are those of a damping of 0.1 %."""
    zeta, own = np.array([1.0, 1e-3]), np.array([OMEGA_0, 2 * OMEGA_0])
    system = masses(np.eye(2), np.diag(own**2), np.diag(2 * zeta * own)).system
    space, one = StateSpace(system), np.eye(2)
    assert space.spectrum is None
    poles, residues = space.poles(one, one)
    omega = np.concatenate([np.linspace(10, 400, 50), own[1] * (1 + 1e-3 * np.linspace(-3, 3, 25))])
    H = (residues / (1j * omega[:, None, None, None] - poles)).sum(axis=-1)
    expected = 1 / (own**2 - omega[:, None] ** 2 + 2j * zeta * own * omega[:, None])
    np.testing.assert_allclose(H[:, [0, 1], [0, 1]], expected, rtol=3e-6)
