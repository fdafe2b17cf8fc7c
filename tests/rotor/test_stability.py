"""Floquet multipliers against linear theory, Liouville's formula and disturbed motion in time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigtwin.rotor.effects import BearingClearance, BearingCubic, BearingFriction, BilinearSupport
from rigtwin.rotor.frequency.continuation import Curve, trace
from rigtwin.rotor.frequency.harmonic_balance import Balance, Motions
from rigtwin.rotor.frequency.stability import floquet_multipliers, is_stable
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model
from tests import tolerances as tol
from tests.rotor.oscillators import CONDITION, MASS, OMEGA_0, STIFFNESS, bilinear, cubic, jenkins, oscillator
from tests.rotor.rigs import paper_structure

ZETA, K3, FORCE = 0.01, 2e9, 0.4
PAPER = Condition(k_b=1.3e6, bearing_damping=50.0, shaft_damping_ratio=0.005)


@pytest.fixture(scope="module")
def duffing() -> Curve:
    """A hardening oscillator with a fold on either side."""
    return trace(Balance(oscillator(ZETA, cubic(K3)), CONDITION), 10.0, 24.0, FORCE)


def expected_linear(stiffness: float, zeta: float, hz: float) -> complex:
    """exp(lambda T) of a mass on a spring, damped relative to ``STIFFNESS``."""
    decay = zeta * OMEGA_0
    return complex(np.exp(complex(-decay, math.sqrt(stiffness / MASS - decay**2)) / hz))


def closest(values: np.ndarray, expected: complex) -> float:
    """Distance of the value that comes closest."""
    return float(np.abs(values - expected).min())


# -- linear theory --------------------------------------------------------------------------------


def test_multipliers_of_a_linear_rotor_are_its_eigenvalues_over_a_period():
    balance = Balance(build_model(paper_structure(), PAPER, [BearingCubic(stiffness=0.0)]), PAPER)
    motions = balance.solve(np.array([50.0, 150.0]), 1.0)
    found = floquet_multipliers(motions)
    for hz, multipliers in zip(motions.frequency_hz, found, strict=True):
        slow = balance.values[np.abs(balance.values) < 20 * 2 * np.pi * hz]
        assert max(closest(multipliers, value) for value in np.exp(slow / hz)) < tol.ROUND_OFF
    assert is_stable(found).all()


@pytest.mark.parametrize("samples", [128, 256])
def test_a_constant_slope_acts_like_a_spring(samples):
    """A bilinear spring that is only pushed: its kicks must add up to its stiffness, second order in the interval."""
    balance = Balance(oscillator(0.02, bilinear(1.5)), CONDITION, samples=samples)
    joints = np.zeros((1, 8, 1), dtype=complex)
    joints[0, 0] = 1.0
    pushed = Motions(balance, 1.0, np.array([40.0]), joints, np.array([True]), ("",))
    found = floquet_multipliers(pushed)[0]
    bound = tol.KICKS * (256 / samples) ** 2
    assert closest(found, expected_linear(1.5 * STIFFNESS, 0.02, 40.0)) < bound


def test_modes_above_the_harmonics_yield_statically():
    """Bearings that are only pushed are half as stiff again, and the fast modes' share of that must not be lost."""
    condition = Condition(k_b=5e6, bearing_damping=50.0, shaft_damping_ratio=0.0)
    stiffer = Condition(k_b=7.5e6, bearing_damping=50.0, shaft_damping_ratio=0.0)
    balance = Balance(build_model(paper_structure(), condition, [BilinearSupport(ratio=1.5)]), condition)
    joints = np.zeros((1, 8, 2), dtype=complex)
    joints[0, 0] = 1.0
    found = floquet_multipliers(Motions(balance, 1.0, np.array([150.0]), joints, np.array([True]), ("",)))[0]
    expected = Balance(build_model(paper_structure(), stiffer), stiffer).values
    low = expected[np.abs(expected) < 2 * np.pi * 300.0]
    assert len(low) == 4
    assert max(closest(found, value) for value in np.exp(low / 150.0)) < tol.KICKS


def test_an_element_that_sticks_is_a_spring():
    k_t = 0.3 * STIFFNESS
    motion = Balance(oscillator(0.02, jenkins(k_t, 1.0)), CONDITION).solve(25.0, 1e-3)
    found = floquet_multipliers(motion)[0]
    assert found.size == 2  # the oscillator's own: a spring remembers nothing
    assert closest(found, expected_linear(STIFFNESS + k_t, 0.02, 25.0)) < tol.KICKS
    assert is_stable(found[None])[0]


def test_an_element_that_sticks_beside_a_motion_that_slips_leaves_its_force_free():
    k_t = 0.3 * STIFFNESS
    balance = Balance(oscillator(0.02, jenkins(k_t, 1.0)), CONDITION)
    motions = balance.solve(np.array([25.0, 25.0]), np.array([1e-3, 50.0]))
    assert motions.dissipated[0, 0] < tol.ROUND_OFF < motions.dissipated[1, 0]
    found = floquet_multipliers(motions)[0]
    assert closest(found, 1.0) < tol.ROUND_OFF
    assert closest(found, expected_linear(STIFFNESS + k_t, 0.02, 25.0)) < tol.KICKS
    assert is_stable(found[None])[0]


def test_an_element_that_slips_forgets():
    motion = Balance(oscillator(0.02, jenkins(2 * STIFFNESS, 1.0)), CONDITION).solve(17.0, 5.0)
    assert motion.dissipated[0, 0] > 0
    found = np.abs(floquet_multipliers(motion)[0])
    assert found[0] < 1
    assert found[2:].max() < tol.ROUND_OFF  # beside the oscillator's own two states


# -- the multipliers' own laws -----------------------------------------------------------------------


def test_the_product_of_all_multipliers_is_what_the_dampers_take(duffing):
    """Liouville: exp(-trace(C / M) T), whatever the motion."""
    found = np.prod(floquet_multipliers(duffing.motions), axis=1)
    expected = np.exp(-2 * ZETA * OMEGA_0 / duffing.motions.frequency_hz)
    np.testing.assert_allclose(found, expected, rtol=tol.ROUND_OFF)


def test_a_multiplier_leaves_the_unit_circle_at_a_fold_and_comes_back_at_the_next(duffing):
    stable = is_stable(floquet_multipliers(duffing.motions))
    first, second = duffing.folds
    assert stable[: first - 2].all()
    assert not stable[first + 3 : second - 2].any()
    assert stable[second + 3 :].all()
    at_folds = floquet_multipliers(duffing.motions)[duffing.folds]
    assert max(closest(values, 1.0) for values in at_folds) < tol.MULTIPLIER_AT_FOLD


def monodromy(motion: Motions) -> FloatArray:
    """(2, 2) how a small disturbance of the hardening oscillator ends after one period in time."""
    hz, F, X = float(motion.frequency_hz[0]), motion.force_amplitude, motion.joints[0, :, 0]
    k = np.arange(len(X))
    start = np.array([X.sum().real, (2j * math.pi * hz * k @ X).real])

    def rate(t: float, s: FloatArray) -> list[float]:
        x, v = float(s[0]), float(s[1])
        pull = F * math.cos(2 * math.pi * hz * t) - STIFFNESS * x - K3 * x**3 - 2 * ZETA * OMEGA_0 * MASS * v
        return [v, pull / MASS]

    def after(offset: FloatArray) -> FloatArray:
        return solve_ivp(rate, (0, 1 / hz), start + offset, "DOP853", rtol=1e-11, atol=1e-15).y[:, -1]

    steps = 1e-4 * np.abs(start).max() * np.diag([1 / OMEGA_0, 1.0])
    return np.column_stack([(after(step) - after(-step)) / (2 * step.sum()) for step in steps])


@pytest.mark.parametrize("place", [0.3, 0.5, 0.7])
def test_multipliers_are_those_of_disturbed_motion_in_time(duffing, place):
    """On the upper branch, between the folds and on the lower branch."""
    n = np.array([int(place * len(duffing.motions.frequency_hz))])
    m = duffing.motions
    motion = Motions(m.balance, FORCE, m.frequency_hz[n], m.joints[n], m.stable[n], ("",))
    expected = np.linalg.eigvals(monodromy(motion))
    found = floquet_multipliers(motion)[0]
    assert max(closest(found, value) for value in expected) < tol.KICKS * np.abs(expected).max()


# -- the rotor -------------------------------------------------------------------------------------


def test_a_dead_band_loses_its_symmetry_where_a_multiplier_says_so():
    """Between stable symmetric motions lies a band in which they are not: a real multiplier passes one."""
    balance = Balance(build_model(paper_structure(), PAPER, [BearingClearance(gap=2e-6)]), PAPER)
    motions = trace(balance, 40.0, 60.0, 10.0).sweep(np.array([44.0, 47.0, 55.0])).motions
    found = floquet_multipliers(motions)
    assert is_stable(found).tolist() == [True, False, True]
    assert found[1, 0].real > 1
    assert abs(found[1, 0].imag) < tol.ROUND_OFF


def test_a_bilinear_rotor_is_not_stable_where_two_modes_combine():
    """Driven at the sum of its first two frequencies, 82 and 207 Hz, both grow; away from it they do not."""
    balance = Balance(build_model(paper_structure(), PAPER, [BilinearSupport(ratio=1.5)]), PAPER)
    motions = balance.solve(np.array([270.0, 290.0, 315.0]), 1.0)
    found = floquet_multipliers(motions)
    assert is_stable(found).tolist() == [True, False, True]
    assert abs(found[1, 0].imag) > 0.1
    assert motions.stable.all()  # the determinant alone does not see it


def test_friction_never_feeds_energy_into_a_disturbance():
    balance = Balance(build_model(paper_structure(), PAPER, [BearingFriction()]), PAPER)
    motions = trace(balance, 60.0, 120.0, 5.0).sweep(np.linspace(60.0, 120.0, 31)).motions
    assert motions.dissipated.max() > 0
    assert is_stable(floquet_multipliers(motions)).all()
