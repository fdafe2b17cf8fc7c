"""Root finding on the model: it inverts the model, and says nan where there is nothing to find."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.estimator.features import Features
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from tests.rotor.rigs import paper_structure
from tests.tolerances import LIGHT_DAMPING

# The bracket in log k_b is closed to 1e-12, and a shift of 0.04 Hz in 100 Hz keeps ten digits.
ROOT = 1e-8

FINDER = StiffnessFinder(paper_structure(), Condition(bearing_damping=10.0))
STIFFNESSES = np.geomspace(1.1e5, 9e8, 9)


def features(k_1: float, k_2: float, std_1: float, std_2: float) -> Features:
    """First shift of a bearing of k_1, second of a bearing of k_2."""
    return Features(float(FINDER.shifts(k_1)[0]), float(FINDER.shifts(k_2)[1]), 1.0, std_1, std_2, 0.1)


def relative_slope(mode: int, k_b: float) -> float:
    """d shift / d log k_b [Hz], by a wide central difference."""
    up, down = (FINDER.shifts(k_b * math.exp(s))[mode - 1] for s in (1e-3, -1e-3))
    return float((up - down) / 2e-3)


def test_a_flat_shaft_is_measured_in_the_plane_of_its_force():
    rig = load_rig("nit-rourkela")
    round_one = rig.segment[0]
    I_y = np.pi * 0.02**4 / 64
    keys = {"length_m", "youngs_modulus_Pa", "density_kg_per_m3", "poisson"}
    moments = {"area_m2": np.pi * 0.02**2 / 4, "second_moment_y_m4": I_y, "second_moment_z_m4": I_y / 2}
    flat = type(round_one).model_validate(round_one.model_dump(include=keys) | moments | {"shear_factor": 0.9})
    structure = assemble(rig.model_copy(update={"segment": [flat]}))
    condition = Condition(bearing_damping=10.0)
    finder = StiffnessFinder(structure, condition)
    rigid, bearing = (
        damped_modes(build_system(structure, replace(condition, k_b=2e6, rigid_support=held)).in_plane(1)).frequency_hz
        for held in (True, False)
    )
    assert_allclose(finder.shifts(2e6), rigid[:2] - bearing[:2])


@pytest.mark.parametrize("mode", [1, 2])
@pytest.mark.parametrize("k_b", STIFFNESSES)
def test_the_shift_of_a_bearing_leads_back_to_it(mode, k_b):
    assert_allclose(FINDER.from_shift(mode, FINDER.shifts(k_b)[mode - 1]), k_b, rtol=ROOT)


def test_shifts_are_those_of_the_damped_modes_of_one_plane():
    conditions = (Condition(3e6, pinned, 10.0) for pinned in (True, False))
    rigid, bearing = (damped_modes(build_system(paper_structure(), c)).frequency_hz[[0, 2]] for c in conditions)
    assert_allclose(FINDER.shifts(3e6), rigid - bearing, rtol=ROOT)
    assert np.all(np.diff([FINDER.shifts(k) for k in STIFFNESSES], axis=0) < 0)


@pytest.mark.parametrize("mode", [1, 2])
@pytest.mark.parametrize("shift", [-1.0, 0.0, 1e-9, 1e3, math.nan, math.inf, -math.inf])
def test_a_shift_that_no_bearing_in_the_range_gives_has_no_answer(mode, shift):
    assert math.isnan(FINDER.from_shift(mode, shift))


@pytest.mark.parametrize("k_b", [0.9e6, 1.1e7])
def test_the_range_ends_where_it_was_said_to_end(k_b):
    narrow = StiffnessFinder(paper_structure(), Condition(bearing_damping=10.0), k_b=(1e6, 1e7))
    assert math.isnan(narrow.from_shift(1, FINDER.shifts(k_b)[0]))
    assert_allclose(narrow.from_shift(1, FINDER.shifts(5e6)[0]), 5e6, rtol=ROOT)


@pytest.mark.parametrize(("std_1", "std_2"), [(0.1, 0.1), (0.01, 1.0), (0.5, 0.01)])
def test_two_answers_are_averaged_by_the_errors_of_log_k_b(std_1, std_2):
    k_1, k_2 = 2.0e6, 2.2e6
    errors = np.array([std_1 / relative_slope(1, k_1), std_2 / relative_slope(2, k_2)])
    expected = np.exp(np.average(np.log([k_1, k_2]), weights=1 / errors**2))
    assert_allclose(FINDER.fused(features(k_1, k_2, std_1, std_2)), expected, rtol=1e-6)


def test_an_exact_shift_outweighs_the_other():
    assert_allclose(FINDER.fused(features(2e6, 3e6, 0.0, 1.0)), 2e6, rtol=1e-6)
    assert_allclose(FINDER.fused(features(2e6, 3e6, 1.0, 0.0)), 3e6, rtol=1e-6)


@pytest.mark.parametrize("k_b", [1e6, 1e8])
def test_answers_that_agree_are_the_answer(k_b):
    assert_allclose(FINDER.fused(features(k_b, k_b, 0.3, 0.2)), k_b, rtol=ROOT)


@pytest.mark.parametrize("shifts", [(1e3, 20.0), (4.0, -1.0), (math.nan, 20.0)])
def test_one_shift_without_an_answer_leaves_both_without(shifts):
    assert math.isnan(FINDER.fused(Features(*shifts, 1.0, 0.1, 0.1, 0.1)))


# -- the amplitude ratio ---------------------------------------------------------------------------


@pytest.mark.parametrize("node", [2, 4])
@pytest.mark.parametrize(("k_b", "bearing_damping"), [(1e6, 0.0), (2e6, 10.0), (1e8, 60.0)])
def test_the_amplitude_ratio_is_that_of_the_peaks_of_the_direct_response(node, k_b, bearing_damping):
    finder = StiffnessFinder(paper_structure(), Condition(), node=node)
    peaks = []
    for pinned in (True, False):
        system = build_system(paper_structure(), Condition(k_b, pinned, bearing_damping))
        modes = damped_modes(system)
        f = modes.frequency_hz[0] * (1 + modes.damping_ratio[0] * np.linspace(-1, 1, 201))
        peaks.append(np.abs(accelerance(system, f, excitation_node=node)[:, node - 1, 0]).max())
    assert_allclose(finder.amplitude_ratio(k_b, bearing_damping), peaks[1] / peaks[0], rtol=LIGHT_DAMPING)


@pytest.mark.parametrize("bearing_damping", [0.0, 0.5, 10.0, 300.0])
def test_the_bearing_damping_that_gives_a_ratio_is_found(bearing_damping):
    ratio = FINDER.amplitude_ratio(2e6, bearing_damping)
    assert_allclose(FINDER.bearing_damping_for_ratio(2e6, ratio), bearing_damping, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("factor", [1.001, 100.0])
def test_a_ratio_above_that_of_undamped_bearings_has_no_damping(factor):
    assert math.isnan(FINDER.bearing_damping_for_ratio(2e6, factor * FINDER.amplitude_ratio(2e6, 0.0)))


def test_a_ratio_below_any_damping_has_none_either():
    assert math.isnan(FINDER.bearing_damping_for_ratio(2e6, 1e-6))
