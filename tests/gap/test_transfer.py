"""How far the gap will shrink under another excitation."""

from __future__ import annotations

import numpy as np
import pytest

import gap.transfer
from gap.hypotheses import NOMINAL
from gap.search import recalibrate
from gap.transfer import transfer_interval
from rotor.effects import AttachedMass
from tests.gap.conftest import both_supports, candidate, problem_of


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
    monkeypatch.setattr(gap.transfer, "_other_nodes", lambda problem: [4])
    monkeypatch.setattr(gap.transfer, "_draws", lambda best, *_: [(best.u, best.nu)])
    low, high = transfer_interval(*heavy, 1.0)
    assert (1 - low) / (1 - high) == pytest.approx(1.2**2)


def test_a_model_without_any_motion_there_has_no_interval(heavy, monkeypatch):
    def no_motion(*_):
        raise ValueError("no line has a motion")

    monkeypatch.setattr(gap.transfer, "_Test", no_motion)
    assert np.isnan(transfer_interval(*heavy, 1.0)).all()


def test_no_node_left_to_drive_has_no_interval(heavy, monkeypatch):
    monkeypatch.setattr(gap.transfer, "_other_nodes", lambda problem: [])
    assert np.isnan(transfer_interval(*heavy, 1.0)).all()
