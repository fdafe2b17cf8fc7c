"""How far the gap will shrink under another excitation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rigtwin.gap.answer.transfer
from rigtwin.gap.answer.transfer import _Test, transfer_interval
from rigtwin.gap.inference.hypotheses import NOMINAL, candidates
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.rotor.effects import AttachedMass, BearingCubic
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import K_B, STRUCTURE, WORKSHOP, all_but, blank, both_supports, candidate, lines, problem_of


@pytest.fixture(scope="module")
def heavy():
    """A rotor with a mass on it: the problem, and what the nominal model and the cause make of it."""
    problem = problem_of(*both_supports(AttachedMass(mass=0.1, node=3)))
    calm = recalibrate(problem)
    mass = problem.fit(candidate(problem.runs, "attached_mass", 3), np.append(calm.u[:1], np.log(0.1)))
    return problem, problem.fit(NOMINAL, calm.u[:1]), mass


def test_the_interval_is_one_of_what_the_correction_explains(heavy):
    low, high = transfer_interval(*heavy, 1.0)
    assert 0.9 < low < high < 1


def test_what_is_left_of_the_gap_is_stretched_both_ways(heavy, monkeypatch):
    """A single rig at a single node: what is left is known, and the interval is the stretch alone."""
    monkeypatch.setattr(rigtwin.gap.answer.transfer, "_other_nodes", lambda problem: [4])
    monkeypatch.setattr(rigtwin.gap.answer.transfer, "_draws", lambda problem, best, *_: [(best.u, best.nu)])
    low, high = transfer_interval(*heavy, 1.0)
    assert (1 - low) / (1 - high) == pytest.approx(1.05**2)


def test_a_model_without_any_motion_there_has_no_interval(heavy, monkeypatch):
    def no_motion(*_):
        raise ValueError("no line has a motion")

    monkeypatch.setattr(rigtwin.gap.answer.transfer, "_Test", no_motion)
    assert np.isnan(transfer_interval(*heavy, 1.0)).all()


def test_no_node_left_to_drive_has_no_interval(heavy, monkeypatch):
    monkeypatch.setattr(rigtwin.gap.answer.transfer, "_other_nodes", lambda problem: [])
    assert np.isnan(transfer_interval(*heavy, 1.0)).all()


def swept_law(level, channels):
    """A cubic law's problem, and its fit, driven so hard that lines have several motions."""
    run = blank("bearing", lines("bearing"), channels=channels, name="hard", force_amplitude_N=level, sweep="up")
    swept = Forward(WORKSHOP).made(with_data=False).modal(run, K_B, (BearingCubic(stiffness=1e15),))
    run = replace(run, H=swept.response(), std=0.01 * np.abs(swept.response()))
    problem = problem_of(run)
    (law,) = candidates([run], STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
    return problem, problem.fit(NOMINAL, np.log([K_B]), steps=0), problem.fit(law, np.log([K_B, 1e15]), steps=0)


@pytest.mark.parametrize("channels", [(Channel(2),), (Channel(2), Channel(3), Channel(5))], ids=["one", "three"])
def test_a_rig_of_the_fitted_numbers_is_the_corrected_model(channels):
    """Whatever its sensors tell of its motions."""
    problem, nominal, best = swept_law(20.0, channels)
    assert _Test(problem, nominal, best, 4).shrink(best.u, best.nu) == pytest.approx(1.0, abs=1e-4)


def test_what_a_nonlinear_cause_leaves_is_stretched_further(monkeypatch):
    problem, nominal, best = swept_law(20.0, (Channel(2),))
    off = best.u + np.array([1e-3, 0.0])
    monkeypatch.setattr(rigtwin.gap.answer.transfer, "_draws", lambda problem, best, *_: [(off, best.nu)])
    low, high = transfer_interval(problem, nominal, best, 1.0)
    assert low < high < 1
    assert (1 - low) / (1 - high) == pytest.approx(1.75**2)
