"""Curves through folds: branches, jumps, and what slow sweeps stay on."""

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
    Effect,
    Rub,
)
from rigtwin.rotor.frequency import continuation, harmonic_balance
from rigtwin.rotor.frequency.continuation import Curve, from_rest, trace
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model
from tests import tolerances as tol
from tests.rotor.oscillators import CONDITION, MASS, OMEGA_0, STIFFNESS, cubic, oscillator
from tests.rotor.rigs import paper_structure

ZETA, K3, FORCE = 0.01, 2e9, 0.4
PAPER = Condition(k_b=1.3e6, bearing_damping=50.0, shaft_damping_ratio=0.005)
LINES_HZ = np.linspace(40.0, 320.0, 281)


@pytest.fixture(scope="module")
def duffing() -> Curve:
    """A hardening oscillator, driven far beyond its first fold."""
    curve = trace(Balance(oscillator(ZETA, cubic(K3)), CONDITION), 10.0, 24.0, FORCE)
    assert curve.complete, curve.reason
    return curve


def crossings(curve: Curve, hz: float) -> int:
    """How often the curve passes a frequency."""
    return int(np.sum(np.diff(np.sign(curve.motions.frequency_hz - hz)) != 0))


def one_harmonic_folds() -> tuple[float, float]:
    """Frequencies [Hz] between which (k + 3/4 k_3 a^2 - m w^2)^2 a^2 + (c w a)^2 = F^2 has three amplitudes."""

    def roots(hz: float) -> int:
        w = 2 * math.pi * hz
        A, B = STIFFNESS - MASS * w**2, 0.75 * K3
        squares = np.roots([B**2, 2 * A * B, A**2 + (2 * ZETA * OMEGA_0 * MASS * w) ** 2, -(FORCE**2)])
        return int(np.sum((np.abs(squares.imag) < 1e-9 * np.abs(squares)) & (squares.real > 0)))

    three = [hz for hz in np.arange(14.0, 24.0, 0.002) if roots(hz) == 3]
    return min(three), max(three)


# -- folds and branches -------------------------------------------------------------------------


def test_a_hardening_resonance_has_two_folds_where_theory_has_them(duffing):
    low, high = one_harmonic_folds()
    assert len(duffing.folds) == 2
    assert duffing.folds_hz.max() == pytest.approx(high, rel=tol.HARMONIC_BALANCE)
    assert duffing.folds_hz.min() == pytest.approx(low, rel=tol.HARMONIC_BALANCE)


def test_between_the_folds_there_are_three_motions_and_the_middle_one_is_not_stable(duffing):
    low, high = sorted(duffing.folds_hz)
    assert [crossings(duffing, hz) for hz in (low - 0.1, (low + high) / 2, high + 0.1)] == [1, 3, 1]
    first, second = duffing.folds
    middle = slice(first + 1, second)
    assert not duffing.motions.stable[middle].any()
    assert duffing.motions.stable[:first].all()
    assert duffing.motions.stable[second + 1 :].all()


def test_folds_are_where_the_frequency_turns_back(duffing):
    hz = duffing.motions.frequency_hz
    for fold in duffing.folds:
        assert (hz[fold] - hz[fold - 1]) * (hz[fold + 1] - hz[fold]) < 0
        assert abs(duffing.tangents[fold, -1]) < 1e-3 * np.abs(duffing.tangents[:, -1]).max()


def test_upward_and_downward_sweeps_differ_between_the_folds_only(duffing):
    lines = np.linspace(12.0, 23.0, 111)
    up, down = duffing.sweep(lines, "up"), duffing.sweep(lines, "down")
    sizes = np.abs([sweep.motions.joints[:, 1, 0] for sweep in (up, down)])
    low, high = sorted(duffing.folds_hz)
    between = (lines > low) & (lines < high)
    assert np.all(sizes[0, between] > 1.05 * sizes[1, between])
    np.testing.assert_allclose(sizes[0, ~between], sizes[1, ~between], rtol=tol.ROUND_OFF)
    assert up.motions.stable.all()
    assert down.motions.stable.all()
    assert up.jumps_hz == pytest.approx([high])
    assert down.jumps_hz == pytest.approx([low])


def test_lines_solve_the_balance_exactly(duffing):
    """A line's motion is solved for, not interpolated."""
    motions = duffing.sweep(np.array([14.0, 18.0, 21.0])).motions
    balance = motions.balance
    R, _ = balance.residual(balance.receptance(2 * np.pi * motions.frequency_hz), FORCE, motions.joints)
    assert np.abs(R).max() < tol.ROUND_OFF * np.abs(motions.joints).max()


@pytest.mark.parametrize("step_hz", [0.01, 0.1])
def test_the_curve_does_not_depend_on_the_step(duffing, step_hz):
    other = trace(duffing.motions.balance, 10.0, 24.0, FORCE, step_hz=step_hz)
    np.testing.assert_allclose(other.folds_hz, duffing.folds_hz, rtol=tol.FOLD)


def test_a_curve_followed_downwards_is_the_same_curve(duffing):
    other = trace(duffing.motions.balance, 24.0, 10.0, FORCE)
    assert not other.rising
    np.testing.assert_allclose(other.folds_hz[::-1], duffing.folds_hz, rtol=tol.FOLD)
    lines = np.linspace(11.0, 23.0, 25)
    for direction in ("up", "down"):
        a, b = (curve.sweep(lines, direction).motions.joints for curve in (duffing, other))
        np.testing.assert_allclose(a, b, atol=tol.ROUND_OFF * np.abs(a).max())


def lightly_damped(effect: Effect, start_hz: float, stop_hz: float, force: float) -> Curve:
    """The paper's rotor with 0.1 % of damping, hardly anything beside what the effect brings."""
    condition = Condition(k_b=1e7, shaft_damping_ratio=0.001)
    model = build_model(paper_structure(), condition, [effect])
    return trace(Balance(model, condition), start_hz, stop_hz, force)


def test_the_first_slip_of_a_friction_element_is_a_corner_of_the_curve_that_is_passed():
    """Stuck below the limit, the resonance is high and narrow; slip cuts it off at an angle."""
    curve = lightly_damped(BearingFriction(), 305.0, 320.0, 1.0)
    assert curve.complete, curve.reason
    dissipated = curve.motions.dissipated.max(axis=1)
    slips = dissipated > tol.ROUND_OFF * dissipated.max()
    assert slips.any()
    assert not slips.all()


def test_corners_of_a_law_that_move_between_samples_do_not_stop_a_lightly_damped_curve():
    curve = lightly_damped(BilinearSupport(ratio=3.0), 270.0, 320.0, 1.0)
    assert curve.complete, curve.reason
    assert len(curve.folds) < 10


def test_a_slowly_rising_force_stays_on_the_small_motion_until_that_ends():
    """Between the folds the rotor at rest is driven to the lower branch; under enough force only the upper is left."""
    balance = Balance(oscillator(ZETA, cubic(K3)), CONDITION)
    hz = 20.0
    small, large = (from_rest(balance, hz, force).joints[0, 1, 0] for force in (FORCE, 20 * FORCE))
    below = FORCE / abs(STIFFNESS - MASS * (2 * math.pi * hz) ** 2)
    assert abs(small) == pytest.approx(below, rel=0.05)
    assert abs(large) > 1.5 * 20 * below
    assert small.real < 0 < large.real  # beyond its resonance, and before it


# -- against a sweep in time ---------------------------------------------------------------------


def stepped_sine(lines_hz: np.ndarray, zeta: float, force: float, periods: int = 40, steps: int = 64) -> np.ndarray:
    """Largest displacement [m] at each line of a sweep of the hardening oscillator, stepped through time."""
    decay, x, v, phase, turn = math.exp(-zeta * OMEGA_0 / MASS), 0.0, 0.0, 0.0, 2 * math.pi / steps
    sizes = []
    for hz in lines_hz:
        h = 1 / (hz * steps)
        half = decay**h
        for _ in range(periods):
            largest = 0.0
            for _ in range(steps):  # half a drift, a kick between two halves of the damping, half a drift
                x += h / 2 * v
                pull = force * math.cos(phase + turn / 2) - STIFFNESS * x - K3 * x**3
                v = half * (half * v + h / MASS * pull)
                x += h / 2 * v
                phase += turn
                largest = max(largest, x)
        sizes.append(largest)
    return np.array(sizes)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_a_slow_sweep_in_time_jumps_where_the_curve_folds(direction):
    zeta, force = 0.03, 1.2
    curve = trace(Balance(oscillator(zeta, cubic(K3)), CONDITION), 12.0, 24.0, force)
    sign, start = (1, 15.0) if direction == "up" else (-1, 24.0)
    fold = curve.folds_hz.max() if direction == "up" else curve.folds_hz.min()
    run_up = np.arange(start, fold - 0.5 * sign, 0.2 * sign)
    lines = np.concatenate([run_up, fold + sign * np.arange(-0.5, 0.3, 0.05)])
    sizes = stepped_sine(lines, zeta, force)
    jump = int(np.argmax(np.abs(np.diff(np.log(sizes)))))
    assert abs(math.log(sizes[jump + 1] / sizes[jump])) > 0.3
    assert (lines[jump] + lines[jump + 1]) / 2 == pytest.approx(fold, abs=tol.JUMP_HZ)


# -- the paper's rotor ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "force"),
    [
        (BearingCubic(stiffness=1e15), 9.0),
        (BearingHertz(preload=5e-6), 9.0),
        (BearingClearance(gap=2e-6), 9.0),
        (BearingClearance(gap=2e-6, preload=20.0), 9.0),
        (BearingFriction(), 3.0),
        (BilinearSupport(ratio=2.0), 3.0),
        (Rub(gap=2e-5), 9.0),
    ],
    ids=lambda value: getattr(value, "id", None),
)
def test_every_nonlinear_effect_is_followed_through_two_resonances_and_solved_on_every_line(effect, force):
    balance = Balance(build_model(paper_structure(), PAPER, [effect]), PAPER)
    curve = trace(balance, LINES_HZ[0], LINES_HZ[-1], force)
    assert curve.complete, curve.reason
    sweep = curve.sweep(LINES_HZ)
    assert sweep.motions.converged.all()
    A = np.abs(sweep.motions.acceleration()[:, :, 1]).max(axis=0)
    assert A[3] > 0.02 * A[1]


@pytest.mark.parametrize("effects", [(), (BearingCubic(stiffness=0.0),)], ids=["no joint", "a joint without force"])
def test_a_curve_of_the_linear_rotor_has_no_folds_and_is_its_accelerance(effects):
    curve = trace(Balance(build_model(paper_structure(), PAPER, effects), PAPER), LINES_HZ[0], LINES_HZ[-1], 1.0)
    sweep = curve.sweep(LINES_HZ)
    assert not len(curve.folds)
    assert not len(sweep.jumps_hz)
    assert sweep.motions.stable.all()
    expected = accelerance(build_model(paper_structure(), PAPER).system, LINES_HZ)[:, :, 0]
    np.testing.assert_allclose(sweep.motions.acceleration()[:, 1], expected, atol=tol.SPECTRAL * np.abs(expected).max())


# -- what it says when it fails ------------------------------------------------------------------


def test_lines_beyond_the_curve_are_results_with_a_reason(duffing):
    motions = duffing.sweep(np.array([5.0, 15.0, 40.0])).motions
    assert motions.converged.tolist() == [False, True, False]
    assert "does not reach 5 Hz" in motions.reasons[0]
    assert not motions.stable[[0, 2]].any()


def test_a_curve_that_is_given_up_says_where(duffing, monkeypatch):
    monkeypatch.setattr(continuation, "_POINTS", 20)
    curve = trace(duffing.motions.balance, 10.0, 24.0, FORCE)
    assert not curve.complete
    assert "given up at 1" in curve.reason
    sweep = curve.sweep(np.array([10.05, 22.0]))
    assert sweep.motions.converged.tolist() == [True, False]


def test_a_curve_that_cannot_start_says_so(duffing, monkeypatch):
    monkeypatch.setattr(harmonic_balance, "_ITERATIONS", 0)
    curve = trace(duffing.motions.balance, 10.0, 24.0, FORCE)
    assert "no motion was found at 10 Hz" in curve.reason
    assert not curve.sweep(np.array([12.0])).motions.converged.any()
