"""Rao's score, the starts that it suggests, and the race of candidates."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.explain import _needed
from rigtwin.gap.inference.hypotheses import PRIORS, Hypothesis
from rigtwin.gap.inference.observed import observe
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.forward import Forward, acting
from rigtwin.gap.model.workshop import Workshop
from rigtwin.gap.search import pairs as pair_search
from rigtwin.gap.search import race as race_module
from rigtwin.gap.search.linear import search, search_from_afar, weak_starts
from rigtwin.gap.search.nominal import fit_lines_alike, recalibrate, strain_towards
from rigtwin.gap.search.pairs import (
    PAIRS,
    _down_a_step,
    _leaders,
    exchanged,
    most_left,
    pair_starts,
    paired,
    pairs,
    pursued,
    straightened,
    without_one,
)
from rigtwin.gap.search.race import FAR, RACE, Search, Stage, _of_each, polish, polish_all, race
from rigtwin.gap.search.starts import Promise, Start, promises
from rigtwin.gap.search.strategies.dwell import _gains
from rigtwin.gap.search.strategies.registry import Dwells
from rigtwin.gap.verdict.adequacy import judge
from rigtwin.gap.verdict.ranking import Ranked, _by_lines_alike, best_of, rank
from rigtwin.gap.verdict.standing import Standing
from rigtwin.rotor.effects import (
    AttachedMass,
    BearingDamping,
    BearingTiltStiffness,
    CompliantRigidSupport,
    DiskInertia,
    DiskMass,
    FastSweep,
    OpenCrack,
    PedestalFlexibility,
    PlaneAnisotropy,
    SensorDelay,
    SensorGain,
    ShaftDamping,
    ShaftModulus,
)
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import (
    BELIEF,
    ELEMENTS,
    K_B,
    NOISE,
    WORKSHOP,
    both_supports,
    candidate,
    condition,
    lines,
    measure,
    of,
    problem_of,
    rebuilt,
    truth,
    with_noise,
    workshop,
)


def problem_with(*effects, seed=0, **settings):
    problem = problem_of(*both_supports(*effects, seed=seed, **settings))
    return problem


def names(fits):
    return [fit.hypothesis.ids for fit in fits]


def test_the_first_order_gain_is_what_a_fit_gains():
    """A small mass: the score beside the nominal model foresees the misfit that its own fit takes away."""
    problem = problem_with(AttachedMass(mass=0.018, node=3))
    nominal = recalibrate(problem)
    gain, scale, moved = Score(problem, nominal).gain([AttachedMass(mass=0.001, node=3)])
    fit = next(f for f in search(problem, of(problem.runs, "attached_mass"), nominal).fits if f.effects[0].node == 3)
    assert 0.3 < gain / (nominal.cost - fit.cost) < 1.1
    assert 0.3 < 0.001 * scale / fit.effects[0].mass < 1.1
    assert abs(nominal.u[0] + moved[0] - fit.u[0]) < 0.7 * abs(nominal.u[0] - fit.u[0])


def test_a_gain_is_a_share_of_the_misfit_whatever_model_a_fit_ended_with():
    """The slopes of the fit's own numbers are those of the model that the change is made in."""
    problem = problem_with(AttachedMass(mass=0.018, node=3))
    nominal, change = recalibrate(problem), [AttachedMass(mass=0.001, node=4)]
    of_another_model = replace(nominal, precision=nominal.precision / 10)
    assert Score(problem, of_another_model).gain(change)[0] == Score(problem, nominal).gain(change)[0]


def test_gains_of_many_changes_are_the_gain_of_each():
    problem = problem_with(FastSweep(dwell=2.0)).made(images=False)
    score = Score(problem, recalibrate(problem), settled=True)
    dwells = np.array([1.0, 2.0, 5.0])
    together = zip(*score.gains(problem.change_by_dwells(score.fit, dwells)), strict=True)
    for dwell, (gain, scale, moved) in zip(dwells, together, strict=True):
        expected = score.gain([FastSweep(dwell=dwell)])
        assert_allclose([gain, scale], expected[:2], rtol=1e-4)
        assert_allclose(moved, expected[2], rtol=1e-4, atol=1e-8)


def test_costs_of_many_dwells_are_the_cost_of_each():
    problem = problem_with(FastSweep(dwell=2.0))
    nominal, (sweep,) = recalibrate(problem), of(problem.runs, "fast_sweep")
    dwells = np.array([1.0, 2.0, 5.0])
    costs = problem.costs(nominal, problem.change_by_dwells(nominal, dwells), 0.02)
    expected = [problem.cost(sweep, np.array([nominal.u[0], u]), nominal.nu, 0.02) for u in np.log(dwells)]
    assert_allclose(costs, expected, rtol=1e-5)


def test_transients_that_have_died_away_promise_nothing():
    problem = problem_with().made(images=False)
    gain, moved = _gains(problem, Score(problem, recalibrate(problem)), np.array([120.0, 150.0]))
    assert_allclose(gain, 0.0, atol=1e-6)
    assert_allclose(moved, 0.0, atol=1e-6)


def test_a_fit_that_stopped_short_of_its_minimum_leaves_nothing_to_effects_like_its_tolerances():
    """A modulus is all but a tolerance: what a tolerance has left to gain is not the modulus'."""
    problem = problem_with()
    nominal = recalibrate(problem)
    short = nominal.nu.copy()
    short[problem.nuisances.tolerance.start] += 0.1 * nominal.prior_std[problem.nuisances.tolerance.start]
    left = replace(nominal, nu=short)
    assert problem.cost(left.hypothesis, left.u, short) > nominal.cost + 10
    here, there = Score(problem, nominal, settled=True), Score(problem, left, settled=True)
    weak = [ShaftModulus(factor=0.9999)]
    assert_allclose(there.gain(weak)[0], here.gain(weak)[0], atol=1.0)
    every = range(len(problem.runs))
    assert_allclose(there.apart(every)[0], here.apart(every)[0], atol=3.0)


def test_resonances_and_shapes_of_their_own_take_of_noise_what_chance_gives_them():
    taken = []
    for seed in range(4):
        problem = problem_with(seed=seed)
        score = Score(problem, recalibrate(problem), settled=True)
        taken += [score.apart([0, 1], shapes=shapes) for shapes in (False, True)]
    gains, numbers = np.array(taken).reshape(4, 2, 2).sum(axis=0).T
    assert numbers[1] > 5 * numbers[0] > 0
    assert np.all(np.abs(gains - numbers) < 4 * np.sqrt(2 * numbers))


@pytest.mark.parametrize("seed", range(4))
def test_a_number_at_an_end_of_its_range_stays_there_when_another_effect_is_added(seed):
    """Free to leave it, one that is too large already promised resonances of their own what noise cannot give."""
    problem = problem_with(seed=seed)
    nominal, tilt = recalibrate(problem), candidate(problem.runs, "bearing_tilt_stiffness")
    least = problem.fit(tilt, np.append(nominal.u, tilt.ends[1, 0]), nominal.nu)
    assert least.at_edge[1, 0]
    beside, plain = (Score(problem, fit, settled=True) for fit in (least, nominal))
    assert beside.gain([AttachedMass(mass=0.001, node=3)])[2][1] == 0.0
    for shapes in (False, True):
        (gain, n), (expected, _) = (score.apart([0, 1], shapes=shapes) for score in (beside, plain))
        assert abs(gain - expected) < 3 * np.sqrt(2 * n)


def test_a_shape_of_its_own_takes_away_what_a_late_sensor_does():
    """It turns one channel; all resonances stay where they are."""
    problem = problem_with(SensorDelay(delay=5e-6, node=3))
    nominal = recalibrate(problem)
    late = problem.fit(candidate(problem.runs, "sensor_delay", 3), np.append(nominal.u, 5e-6), nominal.nu)
    score = Score(problem, nominal, settled=True)
    (shifts, n), (shapes, n_shapes) = (score.apart([0, 1], shapes=each) for each in (False, True))
    assert shifts < n + 3 * np.sqrt(2 * n)
    assert nominal.cost - late.cost < shapes < nominal.cost - late.cost + n_shapes + 3 * np.sqrt(2 * n_shapes)


def test_slopes_that_are_a_little_off_give_an_effect_that_a_tolerance_makes_as_well_no_gain():
    """A stiffer shaft: all it can gain is that its tolerance comes back to where the prior has it."""
    problem = problem_with(AttachedMass(mass=0.02, node=3))
    nominal = recalibrate(problem)
    score, step = Score(problem, nominal, settled=True), [ShaftModulus(factor=1.001)]
    exact = score.gain(step)[0]
    place = 1 + problem.nuisances.tolerance.start + problem.forward.workshop.names.index("modulus")
    for residual, J, where in score._parts:
        slope = J[where == place]
        J[where == place] += 0.004 * np.linalg.norm(slope) / np.linalg.norm(residual) * residual
    score._unsettled = score._gradient()
    assert_allclose(score.gain(step)[0], exact, atol=0.1 * nominal.penalty)


def believing(runs, **belief):
    """The problem of runs whose workshop knows less."""
    return Problem(Forward(workshop(replace(BELIEF, **belief))), [observe(run, run.std) for run in runs])


def test_a_damping_far_beyond_its_tolerance_promises_what_its_prior_costs():
    """The tolerance has taken the damping there: all that the effect can gain is that it comes back."""
    runs = both_supports(BearingDamping(damping=467.0))
    problem = believing(runs, bearing_damping_tolerance=0.7)
    nominal, (damping,) = recalibrate(problem), of(runs, "bearing_damping")
    (promise,) = promises(Score(problem, nominal, settled=True), damping)
    assert_allclose(promise.gain, (np.log(467 / 20) / 0.7) ** 2, rtol=0.1)
    assert_allclose(np.exp(promise.start.u[1]), 467.0, rtol=0.02)
    assert problem.cost(damping, promise.start.u, promise.start.nu) < nominal.cost - 0.5 * promise.gain


def test_a_repeatability_that_has_grown_for_one_sensor_falls_back_where_that_sensor_is_blamed():
    """By the size that was learned without it, a gain that is 10 % off promises a quarter of what its fit gains."""
    runs = both_supports(SensorGain(gain=0.9, node=1))
    problem = believing(runs, gain_repeatability=None)
    nominal, gain = recalibrate(problem), candidate(runs, "sensor_gain", 1)
    (promise,) = promises(Score(problem, nominal, settled=True), gain)
    found = problem.fit(gain, promise.start.u, promise.start.nu)
    (learned,) = problem.nuisances.learned
    assert learned.of(found.prior_std) < learned.median < 0.1 * learned.of(nominal.prior_std)
    assert_allclose(promise.gain, 2 * (found.log_evidence() - nominal.log_evidence()), rtol=0.2)
    assert promise.gain > 3 * nominal.cost - 3 * found.cost


def test_seconds_are_tried_on_a_rig_that_has_its_leaders_tolerances(monkeypatch):
    """A shaft eight times as damped as believed: slopes from the drawing would lead starts anywhere."""
    tried = []
    monkeypatch.setattr(pair_search, "race", lambda problem, starts, *_: tried.append((problem, starts)) or [])
    runs = both_supports(AttachedMass(mass=0.3, node=3), ShaftDamping(damping_ratio=0.024), SensorDelay(2e-5, 3))
    problem = believing(runs, shaft_damping_tolerance=0.7)
    mass, nominal = candidate(runs, "attached_mass", 3), recalibrate(problem)
    leader = problem.fit(mass, np.append(nominal.u, np.log(0.3)), nominal.nu, steps=40)
    pursued(problem, [leader], of(runs, "sensor_delay"))
    ((there, starts),) = tried
    late, *_ = (start for start in starts if dict(start.hypothesis.terms[1].fixed) == {"node": 3})
    assert there.cost(late.hypothesis, late.u, late.nu) < leader.cost - 500
    assert_allclose(there.forward.anchor.values[-1], np.log(0.024 / 0.003), rtol=0.01)


def test_an_effect_on_the_wrong_side_gains_nothing():
    problem = problem_with(AttachedMass(mass=0.01, node=3))
    gain, scale, _ = Score(problem, recalibrate(problem)).gain([ShaftModulus(factor=1.001)])
    assert gain < 0
    assert scale < 0


RIVALS_OF_A_PLANE = ("bearing_asymmetry", "pedestal_flexibility")


@pytest.mark.parametrize(
    ("effect", "rivals"),
    [
        # Shifts by several widths, which tolerances alone first take.
        (ShaftModulus(factor=0.985), ("disk_mass", "axial_load")),
        # Only the rigid run's own end nodes tell of it: a rough comparison of logarithms prefers none.
        (CompliantRigidSupport(stiffness=9e8), ("axial_load", "sensor_position")),
        # Two resonances of its own, narrow ones.
        (PedestalFlexibility(stiffness=1.02e7, mass=4.2, damping=140.0), ("bearing_damping", "attached_mass")),
        # Two resonances for each of the nominal model's, whose k_b suits one of them.
        (PlaneAnisotropy(anisotropy=0.45, angle=0.6), RIVALS_OF_A_PLANE),
        # A narrow one of the other plane.
        pytest.param(PlaneAnisotropy(anisotropy=0.3, angle=0.1), RIVALS_OF_A_PLANE, marks=pytest.mark.long),
        # One that draws the nominal model's k_b and nuisances away.
        pytest.param(PlaneAnisotropy(anisotropy=0.15, angle=0.1), RIVALS_OF_A_PLANE, marks=pytest.mark.long),
        # One at the end of its range.
        pytest.param(PlaneAnisotropy(anisotropy=0.498, angle=0.1), RIVALS_OF_A_PLANE, marks=pytest.mark.long),
    ],
)
def test_the_right_one_wins_the_race(effect, rivals):
    problem = problem_with(effect)
    best = search(problem, of(problem.runs, effect.id, *rivals)).fits[0]
    assert best.hypothesis.ids == (effect.id,)
    assert best.cost < 1.1 * best.n_data
    for name in effect.parameters():
        assert_allclose(getattr(best.effects[0], name), getattr(effect, name), rtol=0.02)


def test_a_weak_effect_of_several_numbers_is_started_near_its_size():
    """Stiffness, mass and damping of a pedestal that one accelerometer hardly sees."""
    effect = PedestalFlexibility(stiffness=3.8e7, mass=0.7, damping=40.0)
    problem = problem_with(effect, channels=(Channel(2),))
    nominal = recalibrate(problem)
    (hypothesis,) = of(problem.runs, effect.id)
    (start,) = weak_starts(problem, [hypothesis], nominal)
    assert abs(start.u[1] - np.log(effect.stiffness)) < 0.7
    best = search(problem, [hypothesis, *of(problem.runs, "bearing_damping")], nominal).fits[0]
    assert best.hypothesis is hypothesis
    assert best.cost < 1.1 * best.n_data


def test_effects_of_several_numbers_are_looked_for_from_afar_too():
    """Next to the nominal model nothing else stands, and there a weak pedestal may act the other way."""
    runs = both_supports(PedestalFlexibility(stiffness=6e7, mass=2.0, damping=150.0), channels=(Channel(2),), seed=5)
    problem = problem_of(*runs)
    near = search(problem, [candidate(runs, "attached_mass", 3)], recalibrate(problem))
    assert not near.rough
    assert near.best.cost > 1.3 * near.best.n_data
    found = search_from_afar(
        problem, near, [candidate(runs, name) for name in ("pedestal_flexibility", "hub_stiffening")]
    )
    assert [fit.hypothesis.ids for fit in found.fits] == [("pedestal_flexibility",), ("attached_mass",)]
    assert found.best.cost < 1.1 * found.best.n_data


def test_the_chain_leaves_the_rotor_as_it_is():
    """Candidates that differ in the measurement chain share a rotor, and answer as if they did not."""
    mass, belief = AttachedMass(mass=0.1, node=3), Forward(WORKSHOP)
    chain = (SensorGain(gain=1.1, node=3), SensorDelay(delay=5e-5, node=2), FastSweep(dwell=0.8))
    problem = problem_with(mass)
    problem.modals(K_B, (mass,))
    for run, modal in zip(problem.runs, problem.modals(K_B, (mass, *chain)), strict=True):
        assert_allclose(modal.response(), belief.modal(run, K_B, (mass, *chain)).response(), rtol=1e-12)
        assert not np.allclose(modal.response(), belief.modal(run, K_B, (mass,)).response(), rtol=1e-3)


@pytest.mark.parametrize(
    ("dwell", "within"),
    [
        (0.13, 1e-5),
        pytest.param(0.48, 1e-5, marks=pytest.mark.long),
        pytest.param(1.2, 1e-5, marks=pytest.mark.long),
        pytest.param(3.4, 1e-3, marks=pytest.mark.long),
    ],
)
def test_a_dwell_is_found_among_its_many_minima(dwell, within):
    """The transients are in the model only, so the model makes these data, on a rig whose resonances are off."""
    effect, forward = FastSweep(dwell=dwell), Forward(WORKSHOP)
    tolerance, runs = np.array([1e-3, -5e-4, 8e-4, -8e-4]), []
    for run in both_supports():
        H = forward.at(tolerance).modal(run, K_B, [effect]).response()
        error = (run.H - truth(run)) / np.where(truth(run) == 0, 1.0, truth(run))
        runs.append(replace(run, H=H * (1 + error), std=NOISE * np.abs(H)))
    problem = problem_of(*runs)
    best = search(problem, of(problem.runs, "fast_sweep", "bearing_damping", "shaft_damping")).fits[0]
    assert best.hypothesis.ids == ("fast_sweep",)
    assert_allclose(best.effects[0].dwell, dwell, rtol=within)
    assert best.chi2 < 1.2 * best.n_data


@pytest.mark.parametrize(
    ("reduction", "position"),
    [(0.27, 0.074), *(pytest.param(*at, marks=pytest.mark.long) for at in [(0.23, 0.103), (0.14, 0.07)])],
)
def test_a_crack_is_found_wherever_it_is(reduction, position):
    """Seen by one accelerometer, next to another minimum, from where it slid to an end of its range."""
    crack = OpenCrack(reduction=reduction, position=position)
    problem = problem_of(*both_supports(crack, channels=(Channel(2),)))
    best = search(problem, of(problem.runs, "open_crack")).fits[0]
    assert_allclose([best.effects[0].position, best.effects[0].reduction], [position, reduction], rtol=0.1)
    assert best.chi2 < 1.2 * best.n_data


def test_a_grid_that_leaves_plenty_does_not_end_the_search(monkeypatch):
    """A fast sweep that takes away 95 % of a huge misfit is not the cause."""
    problem = problem_with(AttachedMass(mass=0.3, node=4))
    nominal = recalibrate(problem)

    def much(_self, _problem, hypothesis, fit):
        if hypothesis.ids != ("fast_sweep",):
            return []
        u = np.append(fit.u[:1], np.log(0.5))
        return [Promise(0.95 * fit.cost, Start(hypothesis, u, fit.nu))]

    monkeypatch.setattr(Dwells, "scan", much)
    found = search(problem, of(problem.runs, "attached_mass", "fast_sweep"), nominal)
    assert names(found.fits)[0] == ("attached_mass",)
    assert ("attached_mass",) in [start.hypothesis.ids for start in found.rough]


@pytest.mark.long
def test_a_second_effect_that_tolerances_hide_is_seen_by_what_is_left():
    """A softer shaft beside a delay: modulus, span and disks take it up, but at a price."""
    problem = problem_with(ShaftModulus(factor=0.98), SensorDelay(delay=5e-5, node=3))
    hypotheses = of(problem.runs, "sensor_delay", "shaft_modulus", "attached_mass")
    found = search(problem, hypotheses)
    single = found.fits[0]
    assert single.hypothesis.ids == ("sensor_delay",)
    assert most_left(problem, single, hypotheses) > 5
    both = pairs(problem, found, hypotheses)[0]
    assert set(both.hypothesis.ids) == {"sensor_delay", "shaft_modulus"}
    assert both.log_evidence() > single.log_evidence() + 25


def test_pairs_are_started_beside_what_leaves_little():
    """Beside an effect that leaves nearly all, any second one gains more than the right one does beside a leader."""
    effects = (BearingDamping(damping=60.0), DiskInertia(factor=0.1))
    problem = problem_of(measure("bearing", effects))
    nominal = recalibrate(problem)
    hypotheses = of(problem.runs, "bearing_damping", "disk_inertia", "attached_mass", "sensor_mass")
    near, hopeless = (
        problem.fit(next(h for h in hypotheses if h.ids == (effect.id,)), np.append(nominal.u, u), anneal=(0.1, 0.0))
        for effect, u in zip(effects, (np.log(60.0), 0.1), strict=True)
    )
    leaders = _leaders(problem, Search(nominal, (hopeless, near)), hypotheses)
    starts = pair_starts(problem, leaders, hypotheses, near=True)
    assert ("bearing_damping", "disk_inertia") in [start.hypothesis.ids for start in starts]
    assert {start.hypothesis.ids[0] for start in starts} == {"bearing_damping"}


@pytest.mark.long
def test_pairs_are_started_beside_what_logarithms_see():
    """A stiffer shaft shifts narrow resonances of two-plane bearings: fine misfits say nothing, logarithms do."""
    effects = (ShaftModulus(factor=1.025), PlaneAnisotropy(anisotropy=0.25, angle=0.37))
    problem = problem_of(measure("bearing", effects))
    hypotheses = of(problem.runs, "shaft_modulus", "sensor_delay", "bearing_damping")
    found = search(problem, hypotheses)
    others = tuple(fit for fit in found.fits if fit.hypothesis.ids != ("shaft_modulus",))
    leaders = _leaders(problem, replace(found, fits=others), hypotheses)
    starts = pair_starts(problem, leaders, hypotheses, near=False)
    assert "shaft_modulus" in {start.hypothesis.ids[0] for start in starts}


@pytest.mark.long
def test_leaders_by_rough_fits_are_not_judged_by_far_misfits(monkeypatch):
    problem = problem_of(measure("bearing", (ShaftModulus(factor=1.025), PlaneAnisotropy(anisotropy=0.25, angle=0.37))))
    hypotheses = of(problem.runs, "shaft_modulus", "sensor_delay", "bearing_damping")
    found = search(problem, hypotheses)
    others = tuple(fit for fit in found.fits if fit.hypothesis.ids != ("shaft_modulus",))
    monkeypatch.setattr(pair_search, "PAIRS", replace(PAIRS, no_leader=1e-9))
    leaders = _leaders(problem, replace(found, fits=others), hypotheses)
    assert "shaft_modulus" in {fit.hypothesis.ids[0] for fit in leaders}


@pytest.mark.parametrize("resonances", [True, False])
def test_far_from_the_data_a_pair_that_begins_like_others_leads_after_a_step_down(resonances):
    """A seat that holds the shaft's tilt, and a mass: beside the seat weak second effects begin nearly alike."""
    problem = problem_of(*both_supports(BearingTiltStiffness(stiffness=1300.0), AttachedMass(mass=0.2, node=2)))
    (seat,) = of(problem.runs, "bearing_tilt_stiffness")
    lead = np.log([K_B, 1450.0])
    starts = []
    for second in of(problem.runs, "attached_mass", "sensor_gain", "sensor_delay", "bearing_damping"):
        pair = paired(seat, second)
        begin = [np.log(0.0018)] if second.ids == ("attached_mass",) else second.starts()[0]
        starts.append(Start(pair, pair.clipped(np.append(lead, begin)), np.zeros(problem.nuisances.n)))
    if not resonances:
        problem = problem.on([replace(observed, resonances=()) for observed in problem.observed])
    few = problem.thinned(5)

    def cost(start):
        return few.rough(start.hypothesis, start.u, 0)[1]

    assert dict(min(starts, key=cost).hypothesis.terms[1].fixed) != {"node": 2}
    best, *others = sorted(_down_a_step(few, starts), key=cost)
    assert dict(best.hypothesis.terms[1].fixed) == {"node": 2}
    assert cost(best) < 0.01 * min(map(cost, others))


def test_a_wrong_partner_is_exchanged():
    """Damped bearings and heavier disks: a damper alone is so strong, or so weak, that the disks begin too far away."""
    problem = problem_of(*both_supports(DiskMass(change=0.047), BearingDamping(damping=10.0)))
    hypotheses = of(problem.runs, "attached_mass", "bearing_damping", "disk_mass")
    mass = next(h for h in hypotheses if dict(h.terms[0].fixed).get("node") == 5)
    (damping,) = (h for h in hypotheses if h.ids == ("bearing_damping",))
    wrong = problem.fit(paired(mass, damping), np.log([K_B, 0.05, 9.0]))
    right, *_ = exchanged(problem, wrong, hypotheses, near=False)
    assert set(right.hypothesis.ids) == {"disk_mass", "bearing_damping"}
    assert right.chi2 < 1.2 * right.n_data
    assert right.chi2 < wrong.chi2 - 100


def in_both_orders(problem):
    """A few steps of the pair of a mass and a modulus, each of them leading once."""
    mass, modulus = of(problem.runs, "attached_mass")[3], of(problem.runs, "shaft_modulus")[0]
    return [
        problem.fit(Hypothesis((*a.terms, *b.terms)), np.array([np.log(K_B), *u]), steps=2, anneal=(0.0,))
        for a, b, u in ((mass, modulus, (np.log(0.1), 1.001)), (modulus, mass, (1.001, np.log(0.1))))
    ]


def test_a_pair_found_from_either_of_its_effects_is_one_pair():
    problem = problem_with(AttachedMass(mass=0.1, node=4))
    fits = in_both_orders(problem)
    assert fits[0].hypothesis != fits[1].hypothesis
    assert _of_each(fits, 1) == fits[:1]


def test_a_pair_has_to_explain_more_before_it_is_as_probable_as_one_effect():
    runs = both_supports()
    mass, modulus = (replace(of(runs, name)[0], prior=0.1) for name in ("attached_mass", "shaft_modulus"))
    assert np.log(paired(mass, modulus).prior / 0.1) == pytest.approx(-PRIORS.pair_log_odds)


def test_a_bent_law_beside_another_effect_is_tried_plain():
    """A pedestal without a block, and a mass: its block is not needed, and not there."""
    pedestal = PedestalFlexibility(stiffness=8e6, mass=1.5, damping=150.0)
    problem = problem_with(pedestal, AttachedMass(mass=0.1, node=4))
    seat, mass = of(problem.runs, "pedestal_flexibility")[0], of(problem.runs, "attached_mass")[3]
    block = [low + 0.02 * (high - low) for low, high in seat.bent.ends[1 + len(seat.free) :]]
    u = np.array([np.log(K_B), *np.log([8e6, 1.5, 150.0]), *block, np.log(0.1)])
    bent = problem.fit(Hypothesis((*seat.bent.terms, *mass.terms)), u)
    (plain,) = straightened(problem, bent)
    assert plain.hypothesis.terms == (*seat.terms, *mass.terms)
    assert plain.chi2 < 1.1 * plain.n_data
    assert plain.log_weight > bent.log_weight
    assert not straightened(problem, plain)


def test_a_cause_is_ranked_once_whatever_its_form_and_order():
    problem = problem_with(AttachedMass(mass=0.1, node=4))
    fits = in_both_orders(problem)
    standing = Standing(fits, judge(problem, fits[0]), 0.5)
    assert len(rank(problem, recalibrate(problem), standing).fits) == 1


def test_an_effect_that_its_own_starts_missed_is_found_in_a_pair():
    """A mass and next to nothing beside it: the mass alone explains as much."""
    problem = problem_with(AttachedMass(mass=0.1, node=4))
    hypotheses = of(problem.runs, "attached_mass", "shaft_modulus")
    mass = next(h for h in hypotheses if dict(h.terms[0].fixed).get("node") == 4)
    modulus = next(h for h in hypotheses if h.ids == ("shaft_modulus",))
    pair = Hypothesis((*modulus.terms, *mass.terms))
    both = problem.fit(pair, np.array([np.log(K_B), 1.0005, np.log(0.11)]))
    heavier, softer = without_one(problem, both, hypotheses)
    assert (softer.hypothesis, heavier.hypothesis) == (modulus, mass)
    assert heavier.effects[0].mass == pytest.approx(0.1, rel=0.02)
    assert heavier.cost < both.cost + 5 < softer.cost


def test_what_later_effects_make_needless_is_left_out():
    """A modulus that stood in for disks that are heavier, found after it: of three effects two are needed."""
    problem = problem_with(DiskMass(change=0.04), SensorGain(gain=1.1, node=3))
    hypotheses = of(problem.runs, "shaft_modulus", "disk_mass", "sensor_gain")
    names = ("shaft_modulus", "disk_mass", "sensor_gain")
    modulus, disks, gain = (next(h for h in hypotheses if h.ids == (name,)) for name in names)
    gain = next(h for h in hypotheses if h.ids == ("sensor_gain",) and h.terms[0].node == 3)
    three = problem.fit(reduce(paired, (modulus, disks, gain)), np.array([np.log(K_B), 1.0005, 0.04, 1.1]))
    two = _needed(problem, three, hypotheses, 1.0)
    assert set(two.hypothesis.ids) == {"disk_mass", "sensor_gain"}
    assert two.cost < three.cost + 2 * PRIORS.pair_log_odds
    assert _needed(problem, two, hypotheses, 1.0) is two


def test_a_race_follows_the_tolerances_where_they_lead(monkeypatch):
    """A stiffer shaft in bearings of two planes: slopes at the drawing would leave many times the noise."""
    loose = workshop(replace(BELIEF, modulus_tolerance=0.01))
    stiffer = assemble(rebuilt("modulus", 0.01), elements_between_nodes=ELEMENTS)
    effects = (PlaneAnisotropy(anisotropy=0.16, angle=0.36),)
    runs = []
    for seed, run in enumerate(both_supports(*effects)):
        nodes = [channel.node for channel in run.channels]
        H = measured_response(stiffer, condition(run.support), acting(effects, run.support), run.frequency_hz, nodes)
        runs.append(with_noise(run, H, seed, noise=1e-3))
    problem = Problem(Forward(loose), [observe(run, run.std) for run in runs], model_error=0.0)
    (bearings,) = of(runs, "plane_anisotropy")
    start = Start(bearings, np.array([np.log(K_B), 0.15, 0.35]), np.zeros(problem.nuisances.n))
    monkeypatch.setattr(race_module, "RACE", replace(RACE, polished=0))
    (fit,) = race(problem, [start], FAR, None)
    assert fit.cost < 1.3 * fit.n_data


@pytest.mark.parametrize("patient", [False, True])
def test_in_a_patient_race_a_start_of_every_effect_goes_on_before_a_second_one_does(patient):
    """What errors as large as the response leave tells places of a mass apart no better than a mass and a load."""
    problem = problem_with(AttachedMass(mass=0.2, node=3))
    load, *masses = of(problem.runs, "axial_load", "attached_mass")
    nu = np.zeros(problem.nuisances.n)
    starts = [Start(load, np.array([np.log(K_B), 1.0]), nu)]
    starts += [Start(mass, np.array([np.log(K_B), np.log(0.2)]), nu) for mass in masses]
    stages = [Stage(added, 1, 2, behind=1e6, patient=patient) for added in (1.0, 0.3)]
    left = {fit.hypothesis.ids[0] for fit in race(problem, starts, stages, None)}
    assert ("axial_load" in left) == patient


def test_where_nothing_is_nothing_is_left():
    problem = problem_with()
    assert most_left(problem, recalibrate(problem), of(problem.runs, "attached_mass", "shaft_modulus")) < 12


def problem_of_longer(*effects):
    """A rotor that is longer than it should be: with a heavy mass the nominal rotor's shapes would leave a misfit."""
    noise, rng = 2e-4, np.random.default_rng(0)
    longer = assemble(rebuilt("span", 1e-3), elements_between_nodes=ELEMENTS)
    runs = []
    for run in both_supports(*effects):
        nodes = [channel.node for channel in run.channels]
        H = measured_response(longer, condition(run.support), acting(effects, run.support), run.frequency_hz, nodes)
        error = (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) / np.sqrt(2)
        runs.append(replace(run, H=H * (1 + noise * error), std=noise * np.abs(H)))
    problem = Problem(Forward(WORKSHOP), [observe(run, run.std) for run in runs], model_error=0.0)
    return problem


def test_tolerances_bend_a_candidate_at_its_own_numbers():
    problem = problem_of_longer(AttachedMass(mass=0.45, node=3))
    runs = problem.runs
    fit = problem.fit(candidate(runs, "attached_mass", 3), np.log([K_B, 0.45]), anneal=(0.1, 0.01, 0.0), steps=30)
    better = polish(problem, fit)
    assert better.cost < 1.2 * better.n_data
    assert better.cost < fit.cost - 50


@pytest.mark.parametrize("pair_first", [True, pytest.param(False, marks=pytest.mark.long)])
def test_a_single_effect_leaves_the_bends_of_a_better_pair(pair_first):
    """On rigid supports the pair's other effect does not act: there the two are one to the tolerances."""
    problem = problem_of_longer(AttachedMass(mass=0.45, node=3), BearingDamping(damping=150.0))
    mass, damper = candidate(problem.runs, "attached_mass", 3), of(problem.runs, "bearing_damping")[0]
    pair = problem.fit(Hypothesis((*mass.terms, *damper.terms)), np.log([K_B, 0.45, 150.0]), anneal=(0.0,), steps=30)
    single = problem.fit(mass, np.log([K_B, 0.002]), anneal=(0.0,), steps=1)
    made = polish_all(problem, [pair, single] if pair_first else [single, pair])
    best = max(made, key=lambda fit: fit.log_weight)
    assert best.hypothesis == pair.hypothesis
    assert best.cost < 1.2 * best.n_data
    assert problem.at_fit(best).cost(best.hypothesis, best.u, best.nu) == pytest.approx(best.cost, rel=1e-3)


def test_a_fit_without_a_model_at_its_own_tolerances_is_dropped():
    """The first order leads anywhere: here to a shaft that is 1e26 times as stiff."""
    problem = problem_of(*both_supports(AttachedMass(mass=0.1, node=3)))
    fit = recalibrate(problem)
    nu = fit.nu.copy()
    nu[problem.nuisances.tolerance.start + problem.forward.workshop.names.index("modulus")] = 60
    lost = replace(fit, nu=nu)
    assert (problem.has_model(fit), problem.has_model(lost)) == (True, False)
    assert [made.hypothesis for made in polish_all(problem, [lost, fit])] == [fit.hypothesis]


def test_rigid_runs_alone_are_a_problem_of_their_own():
    problem = problem_with()
    assert [run.support for run in problem.only("rigid").runs] == ["rigid"]
    assert problem_of(measure("rigid", frequency_hz=lines("rigid"))).only("rigid") is None


@pytest.mark.parametrize("damping", [0.0015, 0.006])
def test_what_the_nominal_model_cannot_explain_does_not_pull_its_stiffness(damping):
    """With another damping the peaks stand where they did; fitted by the noise alone they would drift, and k_b too."""
    problem = problem_with(ShaftDamping(damping_ratio=damping))
    fitted = recalibrate(problem)
    said = fit_lines_alike(problem, fitted)
    assert abs(fitted.k_b / K_B - 1) > 0.01
    assert abs(said.k_b / K_B - 1) < 0.004
    assert said.penalty < fitted.penalty / 100


def test_a_nominal_model_that_explains_the_runs_is_said_as_it_was_fitted():
    problem = problem_with()
    fitted = recalibrate(problem)
    assert fit_lines_alike(problem, fitted) is fitted
    doubted = problem.on([replace(o, std=o.std / 3) for o in problem.observed])
    fitted = recalibrate(doubted)
    assert fit_lines_alike(doubted, fitted, scale=3.0) is fitted
    assert fit_lines_alike(doubted, fitted).added > 0


@pytest.mark.parametrize("damping", [0.0015, 0.006])
def test_what_a_cause_leaves_does_not_pull_its_numbers(damping):
    """A damping that it lacks has drifts and tolerances follow the smallest errors, and the mass with them."""
    problem = problem_with(AttachedMass(mass=0.3, node=3), ShaftDamping(damping_ratio=damping))
    nominal, mass = recalibrate(problem), candidate(problem.runs, "attached_mass", node=3)
    fit = problem.refine(problem.fit(mass, np.array([nominal.u[0], np.log(0.2)])), anchors=2)
    standing = Standing([fit], judge(problem, fit), 0.5, other_form=True)
    said = best_of(_by_lines_alike(problem, Ranked((fit,), (1.0,), 0.0), standing))
    off, left = (abs(each.effects[0].mass / 0.3 - 1) for each in (fit, said))
    assert off > 0.1
    assert left < 0.03
    assert abs(said.k_b / K_B - 1) < 0.003
    assert said.chi2 == fit.chi2


def test_a_strained_nominal_model_follows_a_cause_that_its_tolerances_can_mimic():
    """A shaft softer by 7 % lies far beyond the tolerances: from k_b alone the narrow resonances are never met."""
    problem = problem_with(ShaftModulus(factor=0.93), seed=4)
    nominal = recalibrate(problem)
    (cause,) = search(problem, of(problem.runs, "shaft_modulus"), nominal).fits[:1]
    rival = strain_towards(problem, cause)
    assert cause.cost < 1.2 * cause.n_data
    assert rival.cost < nominal.cost / 1000
    assert rival.penalty > 100  # and it says by how much it had to strain
    assert rival.effects == ()


@pytest.mark.parametrize("heavier", [1e-3, 1e3])
def test_bearings_of_any_rig_are_found(heavier):
    """A rig of another density, modulus and bearings has the same frequencies; its response is so much smaller."""
    rig = load_rig("nit-rourkela")
    matter = {"youngs_modulus_Pa": heavier, "density_kg_per_m3": heavier}
    segments = [s.model_copy(update={k: f * getattr(s, k) for k, f in matter.items()}) for s in rig.segment]
    disks = [d.model_copy(update={"density_kg_per_m3": heavier * d.density_kg_per_m3}) for d in rig.disk]
    belief = replace(BELIEF, bearing_damping_Ns_per_m=heavier * BELIEF.bearing_damping_Ns_per_m)
    scaled = Workshop(rig.model_copy(update={"segment": segments, "disk": disks}), belief, ELEMENTS, 8)
    runs = [replace(run, H=run.H / heavier, std=run.std / heavier) for run in both_supports()]
    fit = recalibrate(Problem(Forward(scaled), [observe(run, run.std) for run in runs]))
    assert fit.k_b == pytest.approx(heavier * K_B, rel=5e-3)
    assert fit.chi2 < 1.1 * fit.n_data
