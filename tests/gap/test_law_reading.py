"""A law's numbers, read from what its joints do, line by line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigtwin.gap.inference.hypotheses import NOMINAL, candidates
from rigtwin.gap.inference.observed import observe
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.motions import ROUGH
from rigtwin.gap.model.workshop import Workshop
from rigtwin.gap.search.laws.grid import by_distance, seen_motion
from rigtwin.gap.search.laws.reading import read
from rigtwin.gap.search.laws.robust import fit_at_start, robust_misfit, thin_out
from rigtwin.gap.search.strategies.law import Rest
from rigtwin.rotor.effects import JointMicroslip, Rub
from rigtwin.rotor.geometry.rig import Joint, load_rig
from tests.gap.conftest import BELIEF, ELEMENTS, K_B, STRUCTURE, all_but, blank, with_noise
from tests.gap.test_nonlinear import problem_of, swept

SOFT = Rub(stiffness=1.4e5, gap=2.2e-5, node=3)


@pytest.fixture(scope="module")
def run():
    return swept(SOFT, 2.0)


def rest_of(problem) -> Rest:
    calm = fit_at_start(problem, NOMINAL, np.log([K_B]), np.zeros(problem.nuisances.n))
    return Rest(calm, K_B, seen_motion(problem, K_B), (1, 7))


def places(run):
    found = candidates((run,), STRUCTURE, all_but("rub"), nonlinear=True)
    return {dict(each.terms[0].fixed)["node"]: each for each in found}


def test_a_soft_contact_is_read_where_a_grid_of_responses_passes_it(run):
    problem = problem_of([run]).made(resolution=ROUGH)
    rest, nu = rest_of(problem), np.zeros(problem.nuisances.n)
    assert rest.motion[2] > 4 * SOFT.gap  # it gives way
    start = read(problem, rest, nu, places(run)[3])
    assert start
    assert np.exp(start.u[1:]) == pytest.approx([SOFT.stiffness, SOFT.gap], rel=0.1)
    few = thin_out(problem, 2, K_B, 0.05)
    grid = min(point.cost for point in by_distance(few, places(run)[3], rest, nu))
    assert robust_misfit(few, fit_at_start(few, start.hypothesis, start.u, nu))[0] < 0.5 * grid


def test_the_place_whose_forces_a_law_has_leaves_least(run):
    problem = problem_of([run]).made(resolution=ROUGH)
    rest, nu = rest_of(problem), np.zeros(problem.nuisances.n)
    starts = {node: read(problem, rest, nu, place) for node, place in places(run).items()}
    assert min(starts, key=lambda node: starts[node].cost) == 3


def test_magnitudes_tell_no_force(run):
    problem = problem_of([replace(run, H=np.abs(run.H), magnitude_only=True)]).made(resolution=ROUGH)
    assert read(problem, rest_of(problem), np.zeros(problem.nuisances.n), places(run)[3]) is None


def test_values_that_are_missing_are_passed_over(run):
    H, std = run.H.copy(), run.std.copy()
    H[::3, 1:] = np.nan
    problem = problem_of([replace(run, H=H, std=std)]).made(resolution=ROUGH)
    start = read(problem, rest_of(problem), np.zeros(problem.nuisances.n), places(run)[3])
    assert start
    assert np.exp(start.u[1:]) == pytest.approx([SOFT.stiffness, SOFT.gap], rel=0.1)


def test_a_law_without_a_model_is_not_read(run, monkeypatch):
    def nothing(*_):
        raise ValueError("a rotor without a full set of eigenvectors has no modal form")

    problem = problem_of([run]).made(resolution=ROUGH)
    rest = rest_of(problem)
    monkeypatch.setattr(problem, "modals", nothing)
    assert read(problem, rest, np.zeros(problem.nuisances.n), places(run)[3]) is None


SLIPPING = JointMicroslip(angle=8e-3, exponent=1.2, contact=0.1, gap=3e-4)


@pytest.fixture(scope="module")
def bolted():
    """A rotor with a joint that slips, driven through its first resonance."""
    bolts = Joint(node=4, tilt_stiffness_Nm_per_rad=5e3)
    rig = load_rig("nit-rourkela").model_copy(update={"joint": [bolts]})
    forward = Forward(Workshop(rig, BELIEF, ELEMENTS, 8))
    first = forward.modal(blank("bearing", np.array([30.0, 60.0])), K_B).frequencies_hz[0]
    hz = first * np.linspace(0.97, 1.02, 60)
    run = blank("bearing", hz, force_amplitude_N=5.0, sweep="up", name="bolted")
    H = forward.made(with_data=False).modal(run, K_B, (SLIPPING,)).response()
    run = with_noise(run, H, seed=1)
    return Problem(forward, [observe(run, run.std)]).made(resolution=ROUGH)


def test_microslip_and_its_second_contact_are_read(bolted):
    (law,) = candidates(bolted.runs, bolted.forward.structure, all_but("joint_microslip"), nonlinear=True)
    start = read(bolted, rest_of(bolted), np.zeros(bolted.nuisances.n), law)
    assert start
    (found,) = law.effects(start.u[1:])
    assert found.gap == pytest.approx(SLIPPING.gap, rel=0.3)
    assert found.contact == pytest.approx(SLIPPING.contact, rel=0.3)
    assert found.exponent == pytest.approx(SLIPPING.exponent, rel=0.3)


def test_a_joint_that_cannot_tilt_and_a_rotor_without_one_do_not_slip(bolted, run):
    rigid = replace(bolted.forward.structure, joint_tilt_stiffness=np.array([np.inf]))
    for structure in (rigid, STRUCTURE):
        assert not candidates((run,), structure, all_but("joint_microslip"), nonlinear=True)
