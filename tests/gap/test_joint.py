"""A mechanism that no effect describes: found at its node, fitted, and used for a prediction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.answer.black_box import further_resonance
from rigtwin.gap.answer.joint import unknown_joint
from rigtwin.gap.diagnose import diagnose
from rigtwin.gap.document import Diagnosis
from rigtwin.gap.inference.hypotheses import candidates
from rigtwin.gap.predict import corrected_rotor, predict
from rigtwin.gap.search.joint import find_joint, joints
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.rotor.effects import AttachedMass, MeasuredJoint
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import K_B, STRUCTURE, all_but, both_supports, campaign_of, measure, problem_of, truth

ABSORBER = MeasuredJoint(
    stiffness=0.0, mass=0.0, damping=0.0, node=5, branch_mass=0.1, branch_frequency=150.0, branch_damping_ratio=0.03
)
SENSORS = tuple(map(Channel, (2, 3, 4, 6)))


@pytest.fixture(scope="module")
def runs():
    return both_supports(ABSORBER, seed=5, channels=SENSORS)


@pytest.fixture(scope="module")
def diagnosis(runs):
    """Of a library in which nothing resembles an absorber."""
    return diagnose(campaign_of(*runs), exclude=all_but("disk_mass", "measured_joint")).diagnosis


@pytest.mark.long
def test_an_absorber_is_an_unknown_mechanism_at_its_node(diagnosis):
    joint = diagnosis.measured_joint
    assert diagnosis.verdict == "unknown"
    assert joint is not None
    assert joint.node == 5
    assert not joint.at_exciter
    assert max(diagnosis.where.nodes, key=lambda each: each.share).node == 5
    assert diagnosis.where.joint.node == 5
    assert "an unknown mechanism acts at node 5" in diagnosis.sentence
    assert_allclose(joint.k_b.value, K_B, rtol=0.01)
    for name, rtol in {"branch_mass": 0.05, "branch_frequency": 0.01, "branch_damping_ratio": 0.3}.items():
        assert_allclose(joint.parameters[name].value, getattr(ABSORBER, name), rtol=rtol)
    shown = 2 * np.pi * np.array(joint.frequency_hz)
    found, expected = np.array(joint.real) + 1j * np.array(joint.imag), ABSORBER.dynamic_stiffness(shown)
    assert np.linalg.norm(found - expected) < 0.2 * np.linalg.norm(expected)


def test_the_law_shrinks_the_gap_to_the_noise_and_a_black_box_does_not(diagnosis):
    joint = diagnosis.measured_joint
    assert joint.shrink.after < 1.5 * joint.shrink.floor
    assert joint.shrink.after < joint.control < joint.shrink.before


def test_a_run_that_was_never_seen_is_predicted_with_the_law(diagnosis):
    known = Diagnosis.from_json(diagnosis.to_json())
    (effect,), _ = corrected_rotor(known)
    assert isinstance(effect, MeasuredJoint)
    run = measure("bearing", (ABSORBER,), excitation_node=4, channels=SENSORS)
    (predicted,) = predict(known, campaign_of(run))
    expected = truth(run, [ABSORBER])
    nominal, corrected = (np.linalg.norm(each.H - expected) for each in (predicted.nominal, predicted.corrected))
    assert corrected < 0.05 * np.linalg.norm(expected)
    assert corrected < 0.1 * nominal


def test_without_a_law_an_unknown_cause_is_predicted_as_nominal(diagnosis):
    assert corrected_rotor(replace(diagnosis, measured_joint=None))[0] == ()
    assert corrected_rotor(replace(diagnosis, verdict="no_gap"))[0] == ()


def test_it_is_no_candidate_of_the_library(runs):
    assert "measured_joint" not in {name for h in candidates(runs, STRUCTURE) for name in h.ids}


def test_where_all_runs_drive_one_node_a_joint_there_goes_with_the_exciter(runs):
    problem = problem_of(*runs)
    assert [h.terms[0].node for h in joints(problem)] == [1, 3, 4, 5, 6, 7, 0]
    both = problem_of(*runs, measure("bearing", (ABSORBER,), excitation_node=4, channels=SENSORS))
    assert [h.terms[0].node for h in joints(both)] == [1, 2, 3, 4, 5, 6, 7, 0]


def test_two_sensors_tell_no_place():
    problem = problem_of(*both_supports(ABSORBER, seed=5, channels=SENSORS[:2]))
    assert find_joint(problem, recalibrate(problem)) is None


@pytest.mark.long
def test_what_strains_the_nuisances_is_no_law():
    """Masses at two nodes are no joint at one."""
    problem = problem_of(*both_supports(AttachedMass(0.4, 2), AttachedMass(0.4, 6), seed=5, channels=SENSORS))
    found = unknown_joint(problem, recalibrate(problem), 1.0)
    assert found.document is None
    assert found.fit is None


def test_a_black_box_finds_a_resonance():
    run = measure("bearing", channels=SENSORS)
    every = np.ones(run.H.shape, dtype=bool)
    omega, pole = 2 * np.pi * run.frequency_hz[:, None], 2 * np.pi * 200 * (-0.02 + 1j)
    residues = np.abs(run.H).max() * np.array([1.0, -0.5, 0.2, 0.3]) * (1 + 0.3j) * 1e-3
    more = -(omega**2) * (residues / (1j * omega - pole) + residues.conj() / (1j * omega - pole.conjugate()))
    found = further_resonance(replace(run, H=run.H + more), run.H, every)
    assert np.linalg.norm(found - more) < 0.02 * np.linalg.norm(more)
