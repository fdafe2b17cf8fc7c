"""Resonances that runs show, and how far a model's are from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigtwin.gap.inference.modes import measured_modes, resonance_residual
from rigtwin.gap.search.linear import search
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.rotor.effects import BearingAsymmetry, PedestalFlexibility, PlaneAnisotropy
from tests.gap.conftest import K_B, both_supports, of, problem_of


def misfit(problem, k_b, *effects):
    """Mean square misfit of the resonances."""
    std = problem.forward.workshop.std
    pairs = zip(problem.observed, problem.modals(k_b, effects), strict=True)
    return float(np.mean(np.concatenate([resonance_residual(m, o.resonances, std) for o, m in pairs]) ** 2))


def test_a_run_shows_the_poles_and_residues_of_its_rotor():
    problem = problem_of(*both_supports())
    for observed, modal in zip(problem.observed, problem.modals(K_B, ()), strict=True):
        group = modal.groups[0]
        assert len(observed.resonances) >= 2
        for mode in observed.resonances:
            j = int(np.argmin(np.abs(group.poles - mode.pole)))
            assert abs(group.poles[j] / mode.pole - 1) < 1e-4
            own = group.residues[:-1, j]
            assert np.linalg.norm(own - mode.residues) < 0.01 * np.linalg.norm(own)


def test_magnitudes_alone_show_none():
    run = both_supports()[0]
    assert measured_modes(replace(run, magnitude_only=True), run.std) == ()


def test_the_misfit_grows_all_the_way_from_the_right_stiffness():
    """On lines nothing tells, some half-power widths away, which way to go."""
    problem = problem_of(*both_supports())
    for factors in (np.geomspace(1, 30, 12), np.geomspace(1, 1 / 30, 12)):
        costs = [misfit(problem, factor * K_B) for factor in factors]
        assert costs[0] < 1e-3
        assert all(np.diff(costs) > 0)


def test_a_resonance_that_the_model_lacks_or_has_alone_counts():
    pedestal = PedestalFlexibility(stiffness=1.02e7, mass=4.2, damping=140.0)
    plain, pedestals = problem_of(*both_supports()), problem_of(*both_supports(pedestal))
    assert misfit(pedestals, K_B, pedestal) < 0.3
    assert misfit(pedestals, K_B) > 100
    assert misfit(plain, K_B, pedestal) > 10


def test_a_resonance_that_hides_in_the_flank_of_another_does_not_count_as_lacking():
    """The second plane's, 1 % away and a fortieth as high."""
    turned = PlaneAnisotropy(anisotropy=0.02, angle=0.17)
    problem = problem_of(*both_supports(turned))
    assert [len(observed.resonances) for observed in problem.observed] == [2, 2]
    assert misfit(problem, K_B, turned) < 0.3 * misfit(problem, K_B)


def test_the_unit_of_a_run_in_an_arbitrary_unit_does_not_count():
    problem = problem_of(*both_supports(quantity="acceleration"))
    louder = [replace(o.run, H=7 * o.run.H, std=7 * o.run.std) for o in problem.observed]
    for effects in ((), (PedestalFlexibility(stiffness=1.02e7, mass=4.2, damping=140.0),)):  # and its own resonances
        expected = misfit(problem, K_B, *effects)
        assert misfit(problem_of(*louder), K_B, *effects) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("asymmetry", [0.45, pytest.param(0.3, marks=pytest.mark.long)])
def test_a_gap_of_many_widths_is_found_from_afar(asymmetry):
    problem = problem_of(*both_supports(BearingAsymmetry(asymmetry=asymmetry)))
    assert recalibrate(problem).chi2 > 100 * recalibrate(problem).n_data
    best = search(problem, of(problem.runs, "bearing_asymmetry", "attached_mass", "axial_load")).fits[0]
    assert best.effects[0].asymmetry == pytest.approx(asymmetry, rel=0.01)
