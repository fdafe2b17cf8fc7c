"""The bearings' dynamic stiffness as runs tell it, and the laws that resemble it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.inference.hypotheses import candidates
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.gap.search.strategies.bearing_stiffness import compare_with_models, law_starts, measured_stiffness
from rigtwin.rotor.effects import AttachedMass, BearingDamping, PedestalFlexibility, ViscoelasticSupport
from rigtwin.rotor.model.rotor_model import bearing_stiffness
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import K_B, STRUCTURE, all_but, both_supports, condition, measure, of, problem_of

BLOCK = PedestalFlexibility(stiffness=1.8e6, mass=0.7, damping=3.2, block_compliance=0.18, block_mass=6.0)
RUBBER = ViscoelasticSupport(strength=0.8, relaxation_time=8e-4, spread=0.5)


def read(*effects, **settings):
    problem = problem_of(*both_supports(*effects, **settings))
    return problem, measured_stiffness(problem, recalibrate(problem))


def true_stiffness(seat, *effects):
    return bearing_stiffness(STRUCTURE, condition("bearing"), effects, seat.omega, 1)[:, 0]


@pytest.mark.parametrize("effects", [(), (BearingDamping(damping=150.0),), (RUBBER,), (BLOCK,)])
def test_runs_on_bearings_tell_what_carries_the_shaft(effects):
    _, seat = read(*effects)
    true = true_stiffness(seat, *effects)
    told = seat.std < 0.1 * np.abs(true)
    assert told.mean() > 0.95
    assert (np.abs(seat.D - true) < 5 * seat.std + 0.01 * np.abs(true))[told].mean() > 0.97
    assert np.median(np.abs(seat.D / true - 1)[told]) < 0.006


def test_poles_of_a_block_show_where_they_are():
    _, seat = read(BLOCK)
    true = true_stiffness(seat, BLOCK)
    stiffer = np.abs(true) > 2 * K_B
    assert stiffer.any()
    assert_allclose(seat.D[stiffer].real, true[stiffer].real, atol=0.1 * np.abs(true[stiffer]).max())


@pytest.mark.long
def test_a_law_begins_where_it_resembles_the_stiffness():
    problem, seat = read(BLOCK)
    law, rubber = (of(problem.runs, name)[0].bent for name in ("pedestal_flexibility", "viscoelastic_support"))
    best = law_starts(problem, seat, law, K_B)[0]
    assert_allclose(np.exp(best[[0, 1, 2]]), [K_B, BLOCK.stiffness, BLOCK.mass], rtol=0.1)
    assert_allclose(best[4], BLOCK.block_compliance, rtol=0.2)
    right = problem.fit(law, best)
    wrong = problem.fit(rubber, law_starts(problem, seat, rubber, K_B)[0])
    assert right.chi2 < 1.2 * right.n_data
    assert wrong.chi2 > 100 * right.chi2


def test_the_law_that_fits_runs_through_what_the_run_tells():
    problem, seat = read(BLOCK)
    nominal, law = recalibrate(problem), of(problem.runs, "pedestal_flexibility")[0].bent
    found = compare_with_models(problem, nominal, problem.fit(law, law_starts(problem, seat, law, K_B)[0]))
    told, law_, level = (
        np.array(real) + 1j * np.array(imag)
        for real, imag in (
            (found.real, found.imag),
            (found.corrected_real, found.corrected_imag),
            (found.nominal_real, found.nominal_imag),
        )
    )
    error = np.hypot(found.std, 0.05 * np.abs(told))
    assert (np.abs(law_ - told) < 4 * error).mean() > 0.9
    assert (np.abs(level - told) < 4 * error).mean() < 0.5
    assert_allclose(level.real, nominal.k_b)
    assert len(found.frequency_hz) == len(told) > 0.5 * len(seat.omega)
    assert (np.array(found.std) < 0.3 * np.abs(told)).all()


def test_lines_that_hardly_tell_the_stiffness_are_left_out():
    problem, seat = read(noise=1.0)
    found = compare_with_models(problem, recalibrate(problem), None)
    assert (seat.error < 0.3).any()
    assert_allclose(found.frequency_hz, seat.run.frequency_hz[seat.error < 0.3])
    assert len(found.frequency_hz) < len(seat.omega)


def test_no_law_is_drawn_where_there_is_none_that_is_linear():
    problem, _ = read()
    nominal = recalibrate(problem)
    laws = candidates(problem.runs, STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
    cubic = replace(nominal, hypothesis=laws[0])
    cubic = replace(cubic, u=np.concatenate([nominal.u[:1], cubic.hypothesis.ends[1:].mean(axis=1)]))
    for best in (None, cubic):
        found = compare_with_models(problem, nominal, best)
        assert found.nominal_real
        assert found.corrected_real == found.corrected_imag == ()


def test_a_mass_on_the_shaft_is_nothing_that_the_bearings_have_in_common():
    assert read(AttachedMass(mass=0.3, node=3))[1] is None


def test_what_does_not_tell_it_is_left_out():
    rigid, bearing = both_supports()
    alone = measure("bearing", channels=(Channel(2),))
    magnitudes = replace(bearing, H=np.abs(bearing.H).astype(complex), magnitude_only=True)
    for run in (alone, magnitudes, rigid):
        problem = problem_of(run)
        assert measured_stiffness(problem, recalibrate(problem)) is None
