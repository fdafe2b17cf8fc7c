"""Which run would separate two candidates: as far as the whole fit says it would."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.answer.next_run import PROPOSED, best_next_test, proposals, relative_noise, separations
from rigtwin.gap.inference.hypotheses import candidates
from rigtwin.gap.inference.observed import observe
from rigtwin.gap.inference.problem import Problem
from rigtwin.rotor.effects import AttachedMass, BearingCubic
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import K_B, NOISE, STRUCTURE, all_but, both_supports, candidate, measure, problem_of

MASS = AttachedMass(mass=0.1, node=3)
ONE = (Channel(2),)


def fitted(problem, hypothesis, *numbers):
    """A candidate fitted from near its end."""
    u = np.array([np.log(K_B), *numbers])
    return problem.fit(hypothesis, u, anneal=(0.02, 0.0))


@pytest.fixture(scope="module")
def rivals():
    """One sensor on rigid supports: a small mass at node 3, and the same data taken for one at node 5."""
    run = measure("rigid", (AttachedMass(mass=0.02, node=3),), channels=ONE, seed=1)
    problem = problem_of(run)
    fits = [fitted(problem, candidate([run], "attached_mass", node), np.log(0.02)) for node in (3, 5)]
    return problem, fits


def test_the_run_that_is_proposed_was_not_measured(rivals):
    problem, fits = rivals
    test = best_next_test(problem, fits)
    assert test.words.split(":")[0] in {p.words for p in proposals(problem, fits)}
    assert "attached mass at node 3" in test.words
    assert "attached mass at node 5" in test.words
    assert set(test.run) == {"support", "excitation_node", "force_amplitude_N"}


def refitted(problem, separation, fits):
    """Increase of chi-squared when the proposed run is fitted beside the old one, as another member measures it."""
    truth, other = (fits[k] for k in separation.pair)
    (run,), old = separation.proposal.runs, problem.nuisances
    modal = problem.forward.modal(run, truth.k_b, truth.effects)
    H = modal.response(None, truth.nu[old.tolerance]) * np.exp(truth.nu[old.sensor])
    std = np.hypot(NOISE * np.abs(H), 1e-3 * np.median(np.abs(H)))
    both = Problem(problem.forward, [*problem.observed, observe(replace(run, H=H, std=std), std)])
    nu = np.zeros(both.nuisances.n)
    nu[both.nuisances.sensor], nu[both.nuisances.tolerance] = other.nu[old.sensor], other.nu[old.tolerance]
    again = both.fit(other.hypothesis, other.u, nu, anneal=(0.0,), steps=80)
    return again.chi2 + again.penalty - other.chi2 - other.penalty


def test_two_members_are_as_far_apart_as_a_fit_of_both_runs_says(rivals):
    problem, fits = rivals
    ranked = separations(problem, fits, proposals(problem, fits))
    assert [s.chi2 for s in ranked] == sorted((s.chi2 for s in ranked), reverse=True)
    driven = {s.proposal.runs[0].excitation_node: s for s in ranked if s.proposal.words.startswith("Drive")
              and s.proposal.runs[0].support == "rigid"}  # fmt: skip
    assert_allclose(driven[3].chi2, refitted(problem, driven[3], fits), rtol=0.2)
    assert driven[3].chi2 > PROPOSED.told_apart
    # Far from the fit the estimate is on the safe side: a mass cannot become negative.
    assert PROPOSED.told_apart < driven[4].chi2 < 1.05 * refitted(problem, driven[4], fits)
    assert driven[6].chi2 < 10


def test_a_member_is_not_apart_from_itself(rivals):
    problem, fits = rivals
    for separation in separations(problem, [fits[0], fits[0]], proposals(problem, fits)):
        assert_allclose(separation.chi2, 0, atol=1e-6)


def test_a_repeat_of_the_same_run_tells_little(rivals):
    problem, fits = rivals
    proposed = proposals(problem, fits)
    driven = next(p for p in proposed if p.runs[0].support == "rigid" and not p.added)
    repeat = replace(driven, words="again", runs=(replace(driven.runs[0], excitation_node=2),))
    best = separations(problem, fits, proposed)[0].chi2
    assert separations(problem, fits, [repeat])[0].chi2 < best / 2


def test_nothing_that_was_measured_is_proposed_again():
    runs = both_supports(MASS)
    problem = problem_of(*runs)
    fits = [fitted(problem, candidate(runs, "attached_mass", 3), np.log(0.1))] * 2
    words = [p.words for p in proposals(problem, fits)]
    assert not any("at node 2, accelerometers" in w for w in words)  # driven there already
    assert not any("accelerometer at every node" in w for w in words)  # they are there already
    assert not any("times the force" in w for w in words)  # nothing nonlinear is in the set
    assert any("on rigid supports at node 4" in w for w in words)
    assert any("known mass" in w for w in words)


def test_the_support_that_is_missing_is_among_the_proposals(rivals):
    problem, fits = rivals
    (bearing,) = [p for p in proposals(problem, fits) if p.settings["support"] == "bearing" and not p.added
                  and "every node" not in p.words]  # fmt: skip
    assert bearing.settings["excitation_node"] == 2


def test_a_run_is_repeated_on_the_supports_that_there_are(rivals):
    problem, fits = rivals
    repeated = [p for p in proposals(problem, fits) if "every node" in p.words or p.added]
    assert len(repeated) > 1
    assert all("on rigid supports" in p.words and p.settings["support"] == "rigid" for p in repeated)


def test_force_levels_are_for_nonlinear_members(rivals):
    problem, fits = rivals
    cubic = replace(fits[0], hypothesis=Fixed(BearingCubic(stiffness=1e12)), u=fits[0].u[:1])
    (levels,) = [p for p in proposals(problem, [cubic, fits[1]]) if "three times the force" in p.words]
    assert [run.force_amplitude_N for run in levels.runs] == [pytest.approx(1 / 3), 3.0]


@pytest.mark.long
def test_nonlinear_members_are_told_apart():
    run = measure("bearing", channels=ONE, seed=2)
    problem = problem_of(run)
    laws = candidates([run], STRUCTURE, all_but("bearing_cubic", "bearing_hertz"), nonlinear=True)
    starts = {"bearing_cubic": [np.log(1e15)], "bearing_hertz": [2e-6]}
    fits = [problem.fit(law, np.array([np.log(K_B), *starts[law.ids[0]]]), steps=0) for law in laws]
    levels = [p for p in proposals(problem, fits) if "three times the force" in p.words]
    (one,) = separations(problem, fits, levels)
    assert one.chi2 > PROPOSED.told_apart
    (none,) = separations(problem, [fits[0], fits[0]], levels)
    assert none.chi2 == pytest.approx(0.0, abs=1e-6)


def test_where_nothing_moves_nothing_is_told_apart():
    """An accelerometer of an arbitrary scale at a bearing reads nothing on rigid supports."""
    (_, run) = both_supports(MASS, channels=(Channel(1, "y"),), seed=4)
    problem = problem_of(replace(run, quantity="acceleration"))
    fits = [fitted(problem, candidate((run,), "attached_mass", node), np.log(0.1)) for node in (3, 5)]
    rigid = [p for p in proposals(problem, fits) if p.settings["support"] == "rigid"]
    assert rigid
    assert [each.chi2 for each in separations(problem, fits, rigid)] == [0.0] * len(rigid)


class Fixed:
    """A hypothesis without free numbers."""

    free = ()

    def __init__(self, effect):
        self._effect = effect

    def effects(self, _):
        return (self._effect,)


@pytest.mark.parametrize("kind", ["magnitude_only", "acceleration"])
def test_runs_of_other_kinds_have_a_next_test(kind):
    runs = both_supports(MASS, channels=ONE, seed=4)
    if kind == "magnitude_only":
        runs = tuple(replace(run, H=np.abs(run.H).astype(complex), magnitude_only=True) for run in runs)
    else:
        runs = tuple(
            replace(run, H=7.0 * run.H, std=7.0 * np.asarray(run.std), quantity="acceleration") for run in runs
        )
    problem = problem_of(*runs)
    fits = [fitted(problem, candidate(runs, "attached_mass", node), np.log(0.1)) for node in (3, 5)]
    ranked = separations(problem, fits, proposals(problem, fits))
    assert ranked[0].chi2 > PROPOSED.told_apart
    assert best_next_test(problem, fits).run


def test_the_noise_is_the_campaigns(rivals):
    assert_allclose(relative_noise(rivals[0]), NOISE, rtol=0.02)


def test_one_member_leaves_nothing_to_separate(rivals):
    problem, fits = rivals
    with pytest.raises(ValueError, match="at least two"):
        best_next_test(problem, fits[:1])
