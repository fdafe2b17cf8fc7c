"""Harmonic balance against linear theory, closed forms and direct integration."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rigtwin.rotor.effects import (
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BearingHertz,
    BilinearSupport,
    Gyroscopic,
    PlaneAnisotropy,
    Rub,
)
from rigtwin.rotor.frequency.continuation import Curve, trace
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.harmonic_balance import Balance, Motions
from rigtwin.rotor.frequency.periodic_force import complex_form, real_form
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.force_laws import CUBIC
from rigtwin.rotor.model.local_force import LocalForce
from rigtwin.rotor.model.printed_laws import SCALAR
from rigtwin.rotor.model.rotor_model import Change, build_model
from tests import tolerances as tol
from tests.rotor.oscillators import (
    CONDITION,
    F_0,
    MASS,
    OMEGA_0,
    STIFFNESS,
    bilinear,
    clearance,
    contact,
    cubic,
    hertz,
    integrated,
    jenkins,
    masses,
    masses_of,
    oscillator,
    swing,
    two_masses,
)
from tests.rotor.rigs import paper_structure

LINES_HZ = np.linspace(20.0, 400.0, 77)
PAPER = Condition(k_b=1.3e6, bearing_damping=50.0, shaft_damping_ratio=0.005)
PRELOADED = BearingClearance(gap=2e-6, preload=5.0)
SYMMETRIC = [
    BearingCubic(stiffness=1e15),
    BearingHertz(preload=5e-6),
    BearingClearance(gap=2e-6),
    BearingFriction(force=1.0),
    Rub(gap=2e-6),
]
LOPSIDED = [PRELOADED, BilinearSupport(ratio=1.5)]


def paper_balance(*effects: Change, condition: Condition = PAPER, **options: object) -> Balance:
    return Balance(build_model(paper_structure(), condition, effects), condition, **options)  # type: ignore[arg-type]


def peak(curve: Curve) -> tuple[float, float]:
    """Frequency [Hz] and swing [m] where the swing is largest."""
    assert curve.complete, curve.reason
    sizes = swing(curve.motions)
    return float(curve.motions.frequency_hz[np.argmax(sizes)]), float(sizes.max())


# -- the linear limit ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "condition",
    [
        PAPER,
        Condition(rigid_support=True),
        Condition(excitation_plane=2, excitation_node=4),
        Condition(k_b=1e6, bearing_damping=30.0, spin_speed=800.0),
    ],
    ids=["bearings", "rigid", "plane 2", "spinning"],
)
def test_without_local_forces_the_fundamental_is_the_accelerance(condition):
    motions = paper_balance(Gyroscopic(), condition=condition).solve(LINES_HZ, 3.0)
    system = build_model(paper_structure(), condition, [Gyroscopic()]).system
    plane = condition.excitation_plane
    expected = accelerance(
        system, LINES_HZ, excitation_node=condition.excitation_node, plane=plane, spin_speed=condition.spin_speed
    )[:, :, 0]
    found = motions.acceleration(plane)
    np.testing.assert_allclose(found[:, 1], expected, rtol=tol.SPECTRAL, atol=tol.SPECTRAL * np.abs(expected).max())
    np.testing.assert_array_equal(found[:, [0, 2, 3, 4, 5, 6, 7]], 0.0)


@pytest.mark.parametrize("effect", [SYMMETRIC[0], SYMMETRIC[1], SYMMETRIC[4], PRELOADED], ids=lambda e: e.id)
def test_a_very_small_force_finds_the_rotor_linear(effect):
    expected = accelerance(build_model(paper_structure(), PAPER).system, LINES_HZ)[:, :, 0]
    motions = paper_balance(effect, corner=1e-6).solve(LINES_HZ, 1e-6)
    assert motions.converged.all()
    np.testing.assert_allclose(motions.acceleration()[:, 1], expected, rtol=tol.NEARLY_LINEAR)


def test_an_element_that_sticks_is_a_spring():
    k_t = 0.3 * STIFFNESS
    motions = Balance(oscillator(0.01, jenkins(k_t, 1.0)), CONDITION).solve(LINES_HZ, 1e-3)
    omega = 2 * np.pi * LINES_HZ
    expected = 1e-3 / (STIFFNESS + k_t - MASS * omega**2 + 0.02j * OMEGA_0 * omega)
    np.testing.assert_allclose(motions.joints[:, 1, 0], expected, rtol=tol.ROUND_OFF)


def test_a_law_without_a_length_of_its_own_scales_with_the_force():
    small, large = (paper_balance(BilinearSupport()).solve(LINES_HZ, force) for force in (0.1, 10.0))
    expected = small.acceleration()
    np.testing.assert_allclose(large.acceleration(), expected, atol=tol.NEARLY_LINEAR * np.abs(expected).max())


def test_a_critically_damped_rotor_has_no_eigenvectors_and_a_response():
    motions = Balance(oscillator(1.0), CONDITION).solve(LINES_HZ, 1.0)
    omega = 2 * np.pi * LINES_HZ
    expected = -(omega**2) / (STIFFNESS - MASS * omega**2 + 2j * OMEGA_0 * omega)
    np.testing.assert_allclose(motions.acceleration()[:, 1, 1], expected, rtol=tol.ROUND_OFF)


# -- the equations ------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [4e-6, 2e-7], ids=["large", "small"])
@pytest.mark.parametrize("both_planes", [False, True], ids=["one plane", "both planes"])
@pytest.mark.parametrize("effect", [*SYMMETRIC, *LOPSIDED], ids=lambda e: e.id + "-preloaded" * (e is PRELOADED))
def test_the_jacobian_is_the_derivative_of_the_residual(effect, both_planes, size):
    pattern = None
    if both_planes:
        system = build_model(paper_structure(), PAPER).system
        pattern = system.unit_vector(2, 1) + 0.5j * system.unit_vector(3, 2)
    balance = paper_balance(effect, harmonics=3, samples=64, pattern=pattern)
    rng = np.random.default_rng(5)
    receptance = balance.receptance(np.array([2 * np.pi * 70.0]))
    u = size * rng.standard_normal((1, 7, balance.n_joints))

    def residual(unknowns: FloatArray) -> FloatArray:
        return balance.residual(receptance, 1.0, complex_form(unknowns))[0][0]

    J = balance.residual(receptance, 1.0, complex_form(u))[1][0]
    step = 1e-7 * np.abs(u).max()
    for column, direction in enumerate(np.eye(u.size)):
        change = step * direction.reshape(u.shape)
        slope = (residual(u + change) - residual(u - change)) / (2 * step)
        np.testing.assert_allclose(J[:, column], slope, atol=tol.DIFFERENCE_QUOTIENT * np.abs(J).max())


def test_real_and_complex_form_are_inverse():
    rng = np.random.default_rng(3)
    u = rng.standard_normal((4, 9, 2))
    np.testing.assert_array_equal(real_form(complex_form(u)), u)


@pytest.mark.parametrize("effect", SYMMETRIC, ids=lambda e: e.id)
def test_symmetric_laws_give_no_even_harmonics(effect):
    motions = paper_balance(effect).solve(LINES_HZ[::3], 5.0)
    sizes = np.abs(motions.joints[motions.converged]).max(axis=(0, 2))
    assert sizes[3] > 1e-3 * sizes[1]
    assert sizes[[0, 2, 4, 6]].max() < tol.ROUND_OFF * sizes[1]


@pytest.mark.parametrize("effect", LOPSIDED, ids=lambda e: e.id)
def test_lopsided_laws_shift_the_mean_and_give_even_harmonics(effect):
    motions = paper_balance(effect).solve(LINES_HZ, 3.0)
    sizes = np.abs(motions.joints[motions.converged]).max(axis=(0, 2))
    assert min(sizes[0], sizes[2]) > 1e-2 * sizes[1]


@pytest.mark.parametrize("effect", [*SYMMETRIC, *LOPSIDED], ids=lambda e: e.id + "-preloaded" * (e is PRELOADED))
def test_what_the_force_feeds_in_dampers_and_local_forces_take_out(effect):
    force = 2.0
    motions = paper_balance(effect).solve(LINES_HZ[::2], force)
    balance, k = motions.balance, np.arange(8)[:, None]
    omega = 2 * np.pi * motions.frequency_hz[:, None, None] * k
    velocity = 1j * omega * every_harmonic(motions)
    fed = np.pi * force * np.real(velocity[:, 1] @ balance.system.unit_vector(2, 1)) / omega[:, 1, 0]
    damping = np.einsum("lki,ij,lkj->lk", velocity.conj(), balance.system.C, velocity).real[:, 1:]
    damped = np.pi * np.sum(damping / omega[:, 1, 0, None], axis=1)
    found = motions.converged
    assert found.sum() > 25
    taken = motions.dissipated.sum(axis=1)
    np.testing.assert_allclose((damped + taken)[found], fed[found], rtol=tol.ENERGY)
    if isinstance(effect, BearingFriction):
        assert motions.dissipated[found].min() > -tol.ROUND_OFF * fed[found].max()
        assert taken[found].max() > 0.01 * fed[found].max()
    else:
        assert np.abs(taken[found]).max() < tol.SAMPLED_CORNERS * fed[found].max()


def every_harmonic(motions: Motions) -> np.ndarray:
    """(n, K, n_dof) displacement phasors of every degree of freedom, solved directly."""
    system = motions.balance.system
    force = np.zeros((*motions.joints.shape[:2], system.n), dtype=complex)
    force[:, 1] = motions.force_amplitude * system.unit_vector(2, 1)
    force -= motions.forces @ motions.balance.forces.patterns
    w = 2 * np.pi * motions.frequency_hz[:, None, None, None] * np.arange(8)[:, None, None]
    return np.linalg.solve(system.K + 1j * w * system.C - w**2 * system.M, force[..., None])[..., 0]


def test_harmonics_of_all_nodes_solve_the_full_equations():
    motions = paper_balance(BearingCubic(stiffness=1e15)).solve(LINES_HZ, 2.0)
    k_omega = 2 * np.pi * LINES_HZ[:, None] * np.arange(8)
    nodes = every_harmonic(motions) @ motions.balance.system.read_out(1).T
    expected = -(k_omega[..., None] ** 2) * nodes / 2.0
    np.testing.assert_allclose(motions.acceleration(), expected, atol=tol.SPECTRAL * np.abs(expected).max())


# -- closed forms -------------------------------------------------------------------------------


@pytest.mark.parametrize("force", [0.1, 0.2, 0.4])
def test_a_cubic_spring_bends_the_resonance_along_its_backbone(force):
    """f^2 = f_0^2 (1 + 3 k_3 a^2 / 4 k) [nayfeh1979]."""
    k3 = 2e9
    curve = trace(Balance(oscillator(0.01, cubic(k3)), CONDITION), 12.0, 26.0, force)
    f, a = peak(curve)
    assert 0.75 * k3 * a**2 / STIFFNESS > 0.03
    assert f == pytest.approx(F_0 * math.sqrt(1 + 0.75 * k3 * a**2 / STIFFNESS), rel=tol.HARMONIC_BALANCE)


def test_a_turning_force_on_a_radial_spring_turns_the_mass_on_a_circle():
    """Force and orbit are round, so the harmonic balance of one harmonic is exact: (Z + k_3 a^2) a = F."""
    k3, force = 2e9, 1.0
    one = np.eye(2)
    model = masses(MASS * one, STIFFNESS * one, 2.0 * one, LocalForce(CUBIC, (k3,), one), planes=2)
    omega = 2 * np.pi * 15.0
    motions = Balance(model, CONDITION, pattern=np.array([1.0, -1.0j])).solve(15.0, force)
    y, z = motions.joints[0, 1]
    assert z == pytest.approx(-1j * y, rel=tol.ROUND_OFF)
    Z = STIFFNESS - MASS * omega**2 + 2j * omega
    assert (Z + k3 * abs(y) ** 2) * y == pytest.approx(force, rel=tol.ROUND_OFF)
    assert np.abs(motions.joints[0, 2:]).max() < tol.ROUND_OFF * abs(y)


@pytest.mark.parametrize("share", [0.2, 0.4, 0.6])
def test_dry_friction_takes_its_part_of_the_force_at_resonance(share):
    """A slider that hardly yields: the energy balance pi F X = pi c omega X^2 + 4 F_c X gives X."""
    force, zeta = 10.0, 0.02
    limit = share * force
    curve = trace(Balance(oscillator(zeta, jenkins(300 * STIFFNESS, limit)), CONDITION), 14.0, 18.0, force)
    _, a = peak(curve)
    viscous = 2 * zeta * OMEGA_0 * MASS
    assert a == pytest.approx((force - 4 * limit / math.pi) / (viscous * OMEGA_0), rel=tol.HARMONIC_BALANCE)


@pytest.mark.parametrize("force", [1.5, 3.0, 8.0])
def test_a_dead_band_resonates_at_the_period_of_flight_and_contact(force):
    """A quarter period: free flight through the gap g at v, then a quarter sine of the spring."""
    gap = 1e-3
    curve = trace(Balance(oscillator(0.02, clearance(gap)), CONDITION, harmonics=11), 3.0, 20.0, force)
    f, a = peak(curve)
    assert a > 1.2 * gap
    quarter = gap / ((a - gap) * OMEGA_0) + math.pi / (2 * OMEGA_0)
    assert f == pytest.approx(1 / (4 * quarter), rel=tol.HARMONIC_BALANCE)


@pytest.mark.parametrize("ratio", [1.3, 2.0, 3.0])
def test_a_bilinear_spring_resonates_at_the_harmonic_mean_of_its_two_frequencies(ratio):
    """Half a period on either side: f = 2 f_+ f_- / (f_+ + f_-) [shaw1983]."""
    curve = trace(Balance(oscillator(0.005, bilinear(ratio)), CONDITION), 14.0, 23.0, 1.0)
    f, _ = peak(curve)
    stiff = F_0 * math.sqrt(ratio)
    assert f == pytest.approx(2 * F_0 * stiff / (F_0 + stiff), rel=tol.HARMONIC_BALANCE)


def test_hertzian_contacts_soften_until_the_preload_is_lost_and_then_harden():
    preload = 1e-3
    balance = Balance(oscillator(0.01, hertz(preload)), CONDITION)
    found = [peak(trace(balance, 10.0, 22.0, force)) for force in (0.02, 0.1, 0.2, 3.0)]
    frequencies, sizes = (np.array(column) for column in zip(*found, strict=True))
    assert sizes[2] < 1.2 * preload < sizes[3]
    assert np.all(np.diff(frequencies[:3]) < 0)
    assert frequencies[3] > frequencies[2]


# -- direct integration ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "coefficients", "force", "hz"),
    [
        (*cubic(2e9), 12.0, 9.0),
        (*clearance(5e-4, corner=1e-5), 6.0, 9.0),
        (*clearance(5e-4, corner=1e-5), 6.0, 12.0),
        (*bilinear(2.0, corner=1e-7), 5.0, 10.0),
        (*bilinear(2.0, corner=1e-7), 5.0, 9.0),
        (*hertz(5e-4), 12.0, 8.0),
        (*contact(5.0, 1e-4), 3.0, 9.0),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_direct_integration_stays_on_the_motion_of_harmonic_balance(law, coefficients, force, hz):
    balance = Balance(two_masses(law, coefficients), CONDITION, harmonics=9)
    motion = balance.solve(hz, force)
    assert motion.converged.all()
    X = masses_of(motion)
    found = integrated(balance, motion, 80, lambda x: SCALAR[law.name](x, *coefficients)[0], balance.forces.patterns[0])
    size = np.abs(X[1]).max()
    assert np.abs(X[3]).max() > 0.02 * size
    np.testing.assert_allclose(found[1], X[1], atol=tol.HARMONIC_BALANCE * size)
    np.testing.assert_allclose(found[3], X[3], atol=tol.HARMONIC_BALANCE_THIRD * np.abs(X[3]).max())
    np.testing.assert_allclose(found[[0, 2]], X[[0, 2]], atol=tol.HARMONIC_BALANCE * size)


def test_a_stiff_stator_is_felt_where_it_is_touched_whatever_the_samples():
    """By some thousandths of the gap, where the shaft turns round: rounding by one length would be felt before."""
    hz, rub = np.arange(60.0, 70.0), Rub(stiffness=4e7, gap=2e-5, node=2)
    coarse, fine = (paper_balance(rub, samples=n, corner=1e-4).solve(hz, 14.0) for n in (512, 8192))
    assert coarse.converged.all()
    assert fine.converged.all()
    depth = np.abs(coarse.forces[:, 1, 0]) / rub.stiffness / rub.gap
    assert 5e-4 < depth.min() < depth.max() < 1e-2
    found, expected = coarse.acceleration()[:, 1], fine.acceleration()[:, 1]
    assert (np.linalg.norm(found - expected, axis=1) < tol.TOUCHED * np.linalg.norm(expected, axis=1)).all()


def test_stepping_a_slider_through_time_settles_on_the_loop_of_harmonic_balance():
    k_t, limit, force, hz, steps = 2 * STIFFNESS, 4.0, 9.0, 17.0, 2000
    motion = Balance(oscillator(0.03, jenkins(k_t, limit)), CONDITION, harmonics=15).solve(hz, force)
    law, dt = SCALAR["jenkins"], 1 / (hz * steps)
    x = v = slider = before = 0.0
    path = np.zeros(steps)
    for n in range(40 * steps):  # leapfrog; the transient is e^-0.03 per radian
        slider = law(x, before, slider, k_t, limit)[0]
        before = x
        pull = force * math.cos(2 * math.pi * n / steps) - STIFFNESS * x - 0.06 * OMEGA_0 * v - slider
        v += dt * pull / MASS
        x += dt * v
        path[n % steps] = before
    X = 2 / steps * np.exp(-2j * np.pi * np.outer([1, 3], np.arange(steps)) / steps) @ path
    assert abs(X[0]) > 3 * limit / k_t
    assert abs(motion.joints[0, 1, 0]) == pytest.approx(abs(X[0]), rel=tol.HARMONIC_BALANCE)
    assert abs(motion.joints[0, 3, 0]) == pytest.approx(abs(X[1]), rel=tol.HARMONIC_BALANCE_THIRD)


# -- what it refuses, and what it says -----------------------------------------------------------


def test_motion_stays_in_the_plane_of_the_force_unless_something_couples_the_planes():
    in_plane = paper_balance(BearingCubic())
    assert (in_plane.plane, in_plane.n_joints) == (1, 2)
    skew = paper_balance(PlaneAnisotropy(), BearingCubic())
    assert (skew.plane, skew.n_joints) == (None, 4)
    offset = Condition(k_b=1.3e6, excitation_plane=2)
    assert paper_balance(PRELOADED, condition=offset).plane is None
    assert paper_balance(BearingClearance(), condition=offset).plane == 2


def test_a_rub_at_a_node_that_a_rigid_support_holds_does_nothing():
    condition = Condition(rigid_support=True)
    assert paper_balance(Rub(node=1), condition=condition).n_joints == 0


def test_forces_on_the_same_joint_add_up():
    together = oscillator(0.02, cubic(2e9), cubic(1e9))
    one = oscillator(0.02, cubic(3e9))
    a, b = (Balance(model, CONDITION).solve(14.0, 2.0) for model in (together, one))
    assert a.balance.n_joints == 1
    np.testing.assert_allclose(a.joints, b.joints, rtol=tol.ROUND_OFF, atol=1e-18)


def test_a_motion_that_is_not_found_is_a_result_with_a_reason():
    balance = paper_balance(BearingClearance(gap=2e-6))
    far_off = np.full((1, 8, 2), 1.0 + 0j)
    motions = balance.solve(61.0, 3.0, far_off)
    assert not motions.converged[0]
    assert motions.reasons == ("Newton's method found no motion",)
    assert not motions.stable[0]
    assert np.isfinite(motions.joints).all()


@pytest.mark.parametrize("options", [{"harmonics": 0}, {"harmonics": 7, "samples": 14}])
def test_too_few_harmonics_or_samples_are_refused(options):
    with pytest.raises(ValueError, match="samples of a period"):
        Balance(oscillator(0.01), CONDITION, **options)


def test_every_motion_may_have_a_force_of_its_own():
    balance, hz, forces = paper_balance(BearingCubic()), np.array([60.0, 75.0, 90.0]), np.array([0.5, 30.0, 2.0])
    together = balance.solve(hz, forces)
    apart = [balance.solve(f, force) for f, force in zip(hz, forces.tolist(), strict=True)]
    one_by_one = np.concatenate([each.joints for each in apart])
    np.testing.assert_allclose(together.joints, one_by_one, atol=1e-9 * np.abs(one_by_one).min(axis=0).max())
    accelerance = np.concatenate([each.acceleration()[:, 1] for each in apart])
    np.testing.assert_allclose(together.acceleration()[:, 1], accelerance, rtol=1e-6, atol=1e-9)


def test_a_force_without_amplitude_is_refused():
    with pytest.raises(ValueError, match="amplitude must be positive"):
        Balance(oscillator(0.01), CONDITION).solve(10.0, 0.0)
