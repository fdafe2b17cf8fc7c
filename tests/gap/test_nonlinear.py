"""Nonlinear effects: the motion of a run, its derivatives, the search for the law, and predictions of a sweep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rigtwin.gap.model.forward as forward_module
from rigtwin.gap.answer.transfer import transfer_interval
from rigtwin.gap.curves import nrmse
from rigtwin.gap.document import SCHEMA, Diagnosis
from rigtwin.gap.inference.hypotheses import NOMINAL, PRIORS, candidates
from rigtwin.gap.inference.observed import observe
from rigtwin.gap.inference.problem import MODEL_ERROR, Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.branch import Branch, BranchSearch
from rigtwin.gap.model.forward import Forward, ModelSize
from rigtwin.gap.model.linear import MODES
from rigtwin.gap.model.motions import FINAL, FINE, MIDDLE, ROUGH
from rigtwin.gap.model.nonlinear import NonlinearModal
from rigtwin.gap.predict import predict
from rigtwin.gap.search.laws.grid import by_distance, seen_motion
from rigtwin.gap.search.laws.robust import descend, fit_at_start, robust_fit, robust_misfit, settle, thin_out
from rigtwin.gap.search.laws.search import (
    EVERY,
    SEVERAL,
    _at_believed_levels,
    _bent,
    _calm,
    _elsewhere,
    _few_of_each,
    _or_vaguer,
    _promising,
    _told,
    _uneven,
    most_promised,
    search_nonlinear,
)
from rigtwin.gap.search.laws.search import LAWS as LAW_SEARCH
from rigtwin.gap.search.linear import search
from rigtwin.gap.search.nominal import NOMINAL_FITS, recalibrate
from rigtwin.gap.search.starts import Start
from rigtwin.gap.search.strategies.law import Rest
from rigtwin.gap.search.strategies.registry import law_strategy_of
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.rotor.effects import (
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BearingHertz,
    BearingTiltStiffness,
    BilinearSupport,
    Rub,
)
from rigtwin.rotor.effects.effect import Effect
from rigtwin.rotor.frequency import periodic_force
from rigtwin.rotor.model.force_laws import LAWS
from rigtwin.rotor.model.printed_laws import SCALAR
from tests.gap.conftest import (
    BELIEF,
    CHANNELS,
    CUBIC,
    K_B,
    LEVELS,
    STRUCTURE,
    TOLERANCES,
    WORKSHOP,
    all_but,
    blank,
    campaign_of,
    lines,
    measure,
    truth,
    with_noise,
    workshop,
)


def swept(effect: Effect, level: float, seed: int = 0, resolution=FINE, **settings):
    """A run swept upwards under a nonlinear effect, with noise and its standard errors; without lines of no motion."""
    run = blank("bearing", lines("bearing"), force_amplitude_N=level, sweep="up", name=f"{level} N", **settings)
    forward = Forward(WORKSHOP).made(with_data=False, resolution=resolution)
    modal = forward.modal(run, K_B, (effect,))
    return with_noise(run, np.where(modal.found()[:, None], modal.response(), np.nan), seed)


def runs_of(effect: Effect):
    """A rigid run, and runs on bearings at three levels."""
    rigid = blank("rigid", lines("rigid"), force_amplitude_N=1.0, name="rigid")
    return with_noise(rigid, truth(rigid), 9), *(swept(effect, level, seed) for seed, level in enumerate(LEVELS))


def problem_of(runs):
    return Problem(Forward(WORKSHOP), [observe(run, run.std) for run in runs])


@pytest.fixture(scope="module")
def hardening():
    return runs_of(CUBIC)


@pytest.mark.parametrize("law", [law for law in LAWS if law.memory], ids=lambda law: law.name)
@pytest.mark.parametrize("few", [0, 10])
def test_all_steps_of_a_law_with_memory_are_those_of_its_printed_form(law, few, monkeypatch):
    monkeypatch.setattr(periodic_force, "_FEW", few)
    t = 2 * np.pi * np.arange(60) / 60  # no power of two
    x = 2e-6 * np.array([0.1, 1.0, 3.0])[:, None] * (np.cos(t) + 0.3 * np.sin(3 * t))
    coefficients = np.array([[3e6, 2e6, 3e6], [2.0, 1.0, 2.0]])
    expected = []
    for path, own in zip(x, coefficients.T, strict=True):
        before, force = 0.0, 0.0
        for displacement in [*path, *path]:
            expected.append(SCALAR[law.name](displacement, before, force, *own))
            before, force = displacement, expected[-1][0]
    found = periodic_force._history(law.name, coefficients, x, derivatives=True)
    assert np.allclose(np.reshape(expected, (3, 120, 4)).transpose(2, 0, 1), found, rtol=1e-12, atol=1e-12)
    assert 0 < np.count_nonzero(found[3]) < found[3].size  # some stick, some slip
    alone = periodic_force._history(law.name, coefficients, x, derivatives=False)
    assert np.array_equal(alone[0], found[0])
    assert not alone[1:].any()


def test_derivatives_by_drift_are_those_of_the_motion(hardening):
    forward = Forward(WORKSHOP)
    modal = forward.modal(hardening[2], K_B, (CUBIC,))
    drift, tolerance, step = np.zeros(MODES), np.zeros(len(TOLERANCES)), 1e-7
    H, D = modal.with_derivatives(drift, tolerance)
    for m, unit, row in ((0, 1, 0), (1, 1, 1), (0, 1j, MODES), (1, 1j, MODES + 1)):
        moved = modal.response(drift + unit * step * (np.arange(MODES) == m))
        off = np.linalg.norm((moved - H) / step - D[row], axis=1)
        usual = off < 1e-3 * np.linalg.norm(D[row], axis=1) + 1e-9 * np.linalg.norm(D[row])
        assert usual.mean() > 0.97  # beside a fold no step is small enough


def test_derivatives_by_the_tolerances_follow_the_shapes(hardening):
    forward = Forward(WORKSHOP).made(resolution=replace(FINAL, harmonics=3, samples=128))
    modal = forward.modal(hardening[1], K_B, (BearingCubic(stiffness=1e13),))
    drift, tolerance, step = np.zeros(MODES), np.full(len(TOLERANCES), 3e-4), 1e-6
    H, D = modal.with_derivatives(drift, tolerance)
    for t in range(len(TOLERANCES)):
        moved = modal.response(drift, tolerance + step * (np.arange(len(TOLERANCES)) == t))
        assert np.linalg.norm((moved - H) / step - D[2 * MODES + t]) < 5e-3 * np.linalg.norm(D[2 * MODES + t])


def test_rough_derivatives_by_the_dampings_are_those_of_the_motion(hardening):
    """A force law answers a damping otherwise than a frequency that is i times as large."""
    belief = replace(BELIEF, shaft_damping_tolerance=0.7, bearing_damping_tolerance=0.7)
    belief = replace(belief, modulus_tolerance=0.0, span_tolerance=0.0, disk_mass_tolerance=0.0)
    unknown = workshop(replace(belief, shaft_damping_ratio=1e-3, bearing_damping_Ns_per_m=10.0))
    modal = Forward(unknown).made(resolution=FINE).modal(hardening[2], K_B, (CUBIC,))
    drift, tolerance, step = np.zeros(MODES), np.zeros(2), 1e-6
    H, D = modal.with_derivatives(drift, tolerance)
    for t in range(2):
        moved = (modal.response(drift, step * (np.arange(2) == t)) - H) / step
        assert np.linalg.norm(moved - D[2 * MODES + t]) < 0.15 * np.linalg.norm(moved)


def test_a_rig_that_is_known_exactly_has_no_derivatives_by_tolerances(hardening):
    exact = replace(BELIEF, modulus_tolerance=0.0, span_tolerance=0.0, disk_mass_tolerance=0.0)
    forward = Forward(workshop(exact)).made(resolution=replace(FINAL, harmonics=3, samples=128))
    modal = forward.modal(hardening[1], K_B, (BearingCubic(stiffness=1e13),))
    H, D = modal.with_derivatives(np.zeros(MODES), np.zeros(0))
    assert D.shape == (2 * MODES + 1, *H.shape)
    assert np.isfinite(D).all()


@pytest.mark.parametrize("law", [CUBIC, BearingFriction(force=2.0, stiffness=3e6)], ids=lambda law: law.id)
def test_changes_by_numbers_of_a_law_are_those_of_the_motion(hardening, law):
    forward = Forward(WORKSHOP).made(resolution=replace(FINAL, harmonics=3, samples=128))
    drift, tolerance = np.full(MODES, 1e-4), np.full(len(TOLERANCES), 3e-4)
    modal = forward.modal(hardening[1], K_B, (law,))
    before = modal.response(drift, tolerance, 0.02)
    for k_b, share in ((K_B * 1.0001, 0.0), (K_B, 0.001)):
        other = replace(law, stiffness=law.stiffness * (1 + share))
        there = forward.modal(hardening[1], k_b, (other,))
        change = modal.small_change_to(there, drift, tolerance, 0.02)
        assert np.linalg.norm(there.response(drift, tolerance, 0.02) - before - change) < 0.02 * np.linalg.norm(change)


def test_derivatives_by_the_level_are_those_of_the_motion(hardening):
    forward = Forward(WORKSHOP)
    modal = forward.modal(hardening[1], K_B, (CUBIC,))
    drift, tolerance, step = np.zeros(MODES), np.zeros(len(TOLERANCES)), 1e-6
    for level in (0.0, 0.03):
        H, D = modal.with_derivatives(drift, tolerance, level)
        assert np.array_equal(H, modal.response(drift, tolerance, level))
        difference = (modal.response(drift, tolerance, level + step) - H) / step
        assert np.linalg.norm(difference - D[-1]) < 1e-3 * np.linalg.norm(D[-1])
        assert np.linalg.norm(D[-1]) > 0.02 * np.linalg.norm(H)  # per force, only what is nonlinear changes
    linear = forward.modal(hardening[1], K_B, (BearingCubic(stiffness=1e-3),))
    assert np.linalg.norm(linear.with_derivatives(drift, tolerance)[1][-1]) < 1e-9 * np.linalg.norm(H)


def test_every_line_moves_under_its_own_force():
    """A sweep under response control: its motions, found from data or followed, and how they change with the level."""
    hz, forces = np.linspace(95.0, 130.0, 36), np.geomspace(0.05, 2.0, 36)
    run = blank("bearing", hz, force_amplitude_N=float(np.median(forces)), force_N=forces, sweep="up", name="held")
    followed = Forward(WORKSHOP).made(with_data=False).modal(run, K_B, (CUBIC,))
    H = followed.response()
    for line in (3, 30):
        alone = replace(run.on_lines(slice(line, line + 1)), force_amplitude_N=forces[line], force_N=None)
        np.testing.assert_allclose(
            Forward(WORKSHOP).made(with_data=False).modal(alone, K_B, (CUBIC,)).response()[0], H[line], rtol=1e-6
        )
    measured = Forward(WORKSHOP).modal(replace(run, H=H), K_B, (CUBIC,))
    np.testing.assert_allclose(measured.response(), H, rtol=1e-6)
    H, D = measured.with_derivatives(np.zeros(MODES), np.zeros(len(TOLERANCES)))
    difference = (measured.response(level=1e-6) - H) / 1e-6
    assert np.linalg.norm(difference - D[-1]) < 1e-3 * np.linalg.norm(D[-1])


@pytest.mark.long
def test_a_force_sensor_that_errs_does_not_change_the_law(hardening):
    """Its error changes the force at which the rotor moves as well as what is read; another gain what is read alone."""
    errs = (0.03, -0.02, 0.025)
    sensed, read = ([hardening[0]], [hardening[0]])
    for level, err, run in zip(LEVELS, errs, hardening[1:], strict=True):
        there = swept(CUBIC, level * (1 + err), seed=5)
        sensed.append(replace(run, H=there.H * (1 + err), std=there.std))
        read.append(replace(run, H=run.H * (1 + err)))
    found = []
    for runs in (sensed, read):
        (law,) = candidates(runs, STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
        problem = problem_of(runs).made(resolution=FINE)
        begun = robust_fit(problem, law, np.log([K_B, 1.1 * CUBIC.stiffness]))
        problem, (fit,) = _at_believed_levels(problem, [begun])
        level = problem.nuisances.std[problem.nuisances.level][0]
        found.append((fit.effects[0].stiffness, np.sqrt(fit.covariance()[1, 1]), level))
    (by_sensed, wide, free), (by_read, narrow, known) = found
    assert free == BELIEF.gain_tolerance > 1e4 * known
    assert abs(np.log(by_sensed / CUBIC.stiffness)) < 3 * wide
    assert abs(np.log(by_read / CUBIC.stiffness)) < 3 * narrow
    assert narrow < 0.3 * wide < 0.02


def test_a_start_has_the_forces_of_a_hard_contact_that_the_data_tell_of():
    rub = Rub(stiffness=2e7, gap=2e-5, node=5)
    run = swept(rub, 1.0)
    modal = Forward(WORKSHOP).modal(run, K_B, (rub,))
    assert isinstance(modal, NonlinearModal)
    told = modal.branch.measured_joints(modal.balance)[1][:, 0]
    every = np.arange(len(told))
    touching = np.abs(told) > 0.03 * np.abs(told).max()
    off = [
        np.abs(modal.balance.forces.harmonics(start)[:, 1, 0] - told)[touching] / np.abs(told)[touching]
        for start in (modal.branch.measured_motion(modal.balance), modal.branch.measured_force(modal.balance, every))
    ]
    assert touching.sum() > 5
    assert np.median(off[0]) > 0.2
    assert np.median(off[1]) < 0.05


def test_a_hard_rub_shows_where_the_motion_of_its_node_ends():
    rub = Rub(stiffness=2e7, gap=2e-5, node=5)
    runs = (swept(rub, 1.0),)
    problem = problem_of(runs).made(resolution=ROUGH)
    few, nu = thin_out(problem, 4, K_B, 0.05), np.zeros(problem.nuisances.n)
    motion = seen_motion(problem, K_B)
    assert rub.gap < motion[4] < 1.5 * rub.gap
    rest = Rest(problem.fit(NOMINAL, np.log([K_B]), steps=1), K_B, motion, (1, 7))
    places = candidates(runs, STRUCTURE, all_but("rub"), nonlinear=True)
    points = sorted((p for place in places for p in by_distance(few, place, rest, nu)), key=lambda p: p.cost)
    assert str(points[0].hypothesis) == "rub node 5"
    assert points[0].cost < 0.6 * robust_misfit(few, fit_at_start(few, NOMINAL, np.log([rest.calm.k_b]), nu))[0]


def test_a_node_without_a_sensor_moves_as_the_rotor_is_bent(hardening):
    every = seen_motion(problem_of(hardening), K_B)
    one = [replace(r, channels=r.channels[1:2], H=r.H[:, 1:2], std=r.std[:, 1:2]) for r in hardening]
    by_one = seen_motion(problem_of(one), K_B)
    assert [channel.node for channel in one[0].channels] == [2]
    assert every[0] > 0
    np.testing.assert_allclose(by_one, every, rtol=0.2)


def test_sensors_that_tell_nothing_of_the_motion_are_passed_over(hardening):
    """On rigid supports a sensor at a bearing reads nothing; one across the force reads another motion."""
    rigid, loud = hardening[0], hardening[3]
    at_bearing = replace(rigid, channels=rigid.channels[:1], H=0 * rigid.H[:, :1], std=rigid.std[:, :1])
    across = replace(loud, channels=tuple(replace(c, plane="z") for c in loud.channels))
    both = replace(
        loud, channels=loud.channels + across.channels, H=np.hstack([loud.H, 0 * loud.H]), std=np.hstack([loud.std] * 2)
    )
    expected = seen_motion(problem_of([loud]), K_B)
    assert (expected > 0).all()
    np.testing.assert_array_equal(seen_motion(problem_of([at_bearing, loud]), K_B), expected)
    np.testing.assert_array_equal(seen_motion(problem_of([across, loud]), K_B), expected)
    np.testing.assert_array_equal(seen_motion(problem_of([both]), K_B), expected)


@pytest.mark.long
def test_where_levels_do_not_differ_no_law_is_kept():
    """At the end of its range where it does nothing, a law explains as much as none, and must not be named."""
    runs = runs_of(BearingCubic(stiffness=1.0))
    *_, found = search_nonlinear(
        problem_of(runs), candidates(runs, STRUCTURE, all_but("bearing_cubic"), nonlinear=True), 1.5
    )
    assert found.fits == ()


@pytest.mark.long
def test_preloads_are_tried_below_the_force_that_the_bearings_bear():
    opening = BearingClearance(gap=2e-6, preload=28.0)
    runs = runs_of(opening)
    problem = problem_of(runs)
    laws = candidates(runs, STRUCTURE, all_but("bearing_clearance"), nonlinear=True)
    rest = Rest(problem.fit(NOMINAL, np.log([K_B]), steps=1), K_B, seen_motion(problem, K_B), (1, 7))
    preloads = np.array([laws[0].effects(u[1:])[0].preload for u in law_strategy_of(laws[0]).points(laws[0], rest)])
    assert opening.preload < rest.force < 1.5 * opening.preload
    assert preloads.max() < rest.force
    assert np.abs(preloads / opening.preload - 1).min() < 0.2
    *_, found = search_nonlinear(problem, laws, THRESHOLDS.adequate_nonlinear)
    assert found.nominal.chi2 > NOMINAL_FITS.near * found.nominal.n_data
    best = found.fits[0]
    assert best.chi2 < 1.2 * best.n_data
    assert best.effects[0].preload == pytest.approx(opening.preload, rel=0.05)


@pytest.mark.long
def test_a_gap_that_a_single_line_holds_is_seen():
    """Only at the top of the loudest resonance does the bearing lift off; every second line would pass it over."""
    opening = BearingClearance(gap=5e-7, preload=47.0)
    runs = runs_of(opening)
    problem, laws = problem_of(runs), candidates(runs, STRUCTURE, all_but("bearing_clearance"), nonlinear=True)
    *_, found = search_nonlinear(problem, laws, THRESHOLDS.adequate_nonlinear)
    assert found.nominal.chi2 < NOMINAL_FITS.near * found.nominal.n_data
    assert found.fits[0].log_weight > found.nominal.log_weight + 100
    assert found.fits[0].effects[0].preload == pytest.approx(opening.preload, rel=0.05)


@pytest.mark.long
def test_a_bearing_that_lifts_off_on_few_lines_is_told_by_their_misfit():
    """As a mean distance of all lines it is hardly nearer to the data than a rotor without a gap."""
    opening = BearingClearance(gap=8e-7, preload=2.0)
    runs = runs_of(opening)
    problem = problem_of(runs)
    (law,) = candidates(runs, STRUCTURE, all_but("bearing_clearance"), nonlinear=True)
    calm, nu = _calm(problem)
    rest = Rest(calm, calm.k_b, seen_motion(problem, calm.k_b), (1, 7))
    few = thin_out(problem.made(resolution=ROUGH), EVERY.grid, calm.k_b, LAW_SEARCH.rough_error)
    (best,) = descend(few, _promising(by_distance(few, law, rest, nu)), LAW_SEARCH.first_added)
    assert law.effects(best.u[1:])[0].gap == pytest.approx(opening.gap, rel=0.1)
    assert law.effects(best.u[1:])[0].preload == pytest.approx(opening.preload, rel=0.1)


@pytest.fixture(
    scope="module",
    params=[(1e-6, 10.0), pytest.param((1e-5, 28.0), marks=pytest.mark.long)],
    ids=["reached", "out of reach"],
)
def clearance(request):
    """A gap and its campaign's problem, law and true numbers; no motion reaches across the wide one."""
    gap, preload = request.param
    runs = runs_of(BearingClearance(gap=gap, preload=preload))[1:]
    (law,) = candidates(runs, STRUCTURE, all_but("bearing_clearance"), nonlinear=True)
    return gap, problem_of(runs), law, np.array([np.log(K_B), np.log(gap), preload])


def test_a_gap_is_looked_for_along_its_range(clearance):
    gap, problem, law, true = clearance
    for away in (-9.0, 9.0):
        lost = Start(law, law.clipped(true + np.array([0.0, away, 0.0])), np.zeros(problem.nuisances.n))
        (found,) = _told(problem, [lost])
        found_gap = np.exp(found.u[1])
        assert found_gap > 1.2e-6 if gap == 1e-5 else found_gap == pytest.approx(gap, rel=0.6)


@pytest.mark.long
def test_a_gap_out_of_reach_has_a_wide_error(clearance):
    gap, problem, law, true = clearance
    (kept,) = _or_vaguer(problem, [robust_fit(problem, law, true, rounds=1)])
    error = np.sqrt(kept.covariance()[1, 1])
    assert error > 0.5 if gap == 1e-5 else error < 0.05
    assert kept.u[1] == pytest.approx(np.log(gap), abs=3 * error)


def test_where_newtons_method_was_left_nothing_is_told(hardening):
    """By no column: neither numbers nor gains, drifts, tolerances, level."""
    problem = problem_of(hardening[3:]).made(resolution=replace(FINE, iterations=2))
    (law,) = candidates(hardening, STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
    fit = fit_at_start(problem, law, np.log([K_B, 3e15]), np.zeros(problem.nuisances.n))
    (modal,) = problem.modals(fit.k_b, fit.effects)
    ((residual, J, _),) = problem.linear_parts(law, fit.u, fit.nu, fit.added)
    by_line = np.abs(J).reshape(len(J), 2, *modal.run.H.shape).sum(axis=(1, 3))  # (n_columns, n_freq)
    told = modal.tells()
    assert 3 < np.count_nonzero(~told) < len(told) - 3
    assert (modal.found() <= told).all()
    assert (by_line[:, ~told] == 0).all()
    assert (by_line[1, told] > 0).all()  # the law's number
    assert (by_line[-1, told] > 0).all()  # the level
    assert (np.abs(residual.reshape(2, *modal.run.H.shape)[:, ~told]).sum(axis=(0, 2)) > 0).all()


def test_a_contact_is_carried_over_to_other_places():
    rub = Rub(stiffness=1e5, gap=2e-5, node=4)
    runs = (swept(rub, 1.0),)
    problem = problem_of(runs)
    places = candidates(runs, STRUCTURE, all_but("rub"), nonlinear=True)
    (here,) = (each for each in places if dict(each.terms[0].fixed)["node"] == 4)
    found = Start(here, np.log([K_B, 1e5, 2e-5]), np.zeros(problem.nuisances.n), 0.0)
    carried = {str(start.hypothesis): start for start in _elsewhere(problem, places, [found])}
    assert len(carried) == len(places) - 1
    start = carried["rub node 5"]
    other = robust_fit(problem, start.hypothesis, start.u, start.nu, rounds=1)
    nominal = problem.fit(NOMINAL, start.u[:1])
    assert other is not None
    assert other.cost < 0.05 * nominal.cost  # almost as well as where it is


def test_thinned_runs_bend_with_the_tolerances(hardening):
    problem = problem_of(hardening[:1])
    (whole,), (few,) = (each.modals(K_B, ()) for each in (problem, thin_out(problem, 2, K_B, 0.0)))
    tolerance = np.full(len(TOLERANCES), 1e-3)
    assert np.allclose(whole.response(None, tolerance)[::2], few.response(None, tolerance))


def test_first_fits_follow_the_tolerances():
    """A workshop's tolerances bend the modes by more than a law that acts on few lines does."""
    rub, tolerance = Rub(stiffness=1e5, gap=2.2e-5, node=3), 1e-3 * np.array([1.0, -1.0, 1.0, -1.0])
    empty = [blank("rigid", lines("rigid"), force_amplitude_N=0.3)]
    empty += [blank("bearing", lines("bearing"), force_amplitude_N=level, sweep="up") for level in (0.3, 1.0)]
    forward = Forward(WORKSHOP).made(with_data=False, resolution=FINE)
    made = [forward.modal(run, K_B, (rub,)).response(None, tolerance) for run in empty]
    runs = [with_noise(run, H, seed, 0.003) for seed, (run, H) in enumerate(zip(empty, made, strict=True))]
    problem = problem_of(runs)
    place = next(h for h in candidates(runs, STRUCTURE, all_but("rub"), nonlinear=True) if str(h) == "rub node 3")
    several = thin_out(problem.made(resolution=SEVERAL), 1, K_B, MODEL_ERROR)
    fit = robust_fit(several, place, np.log([K_B, rub.stiffness, rub.gap]), rounds=1, steps=3)
    assert fit
    assert fit.chi2 < 1.1 * fit.n_data


@pytest.mark.long
def test_a_weak_law_is_named():
    weak = BearingCubic(stiffness=1e13)
    runs = tuple(swept(weak, level, seed) for seed, level in enumerate(LEVELS[1:]))
    laws = candidates(runs, STRUCTURE, all_but("bearing_cubic", "bearing_hertz"), nonlinear=True)
    *_, found = search_nonlinear(problem_of(runs), laws, THRESHOLDS.adequate_nonlinear)
    best, second = found.fits[0], found.nominal
    assert second.chi2 < NOMINAL_FITS.near * second.n_data
    assert best.hypothesis.ids == ("bearing_cubic",)
    assert best.log_weight > second.log_weight + 10
    assert best.effects[0].stiffness == pytest.approx(1e13, rel=0.3)


@pytest.mark.long
def test_a_law_promises_more_than_noise_where_the_levels_own_resonances_tell_nothing():
    promised = {}
    for stiffness in (1e9, 4e12):
        runs = runs_of(BearingCubic(stiffness=stiffness))
        problem = problem_of(runs)
        nominal = recalibrate(problem)
        gain, numbers = Score(problem, nominal, settled=True).apart([1, 2, 3])
        assert gain < numbers + THRESHOLDS.level_sigmas * np.sqrt(2 * numbers)
        laws = candidates(runs, STRUCTURE, all_but("bearing_cubic", "bearing_hertz"), nonlinear=True)
        promised[stiffness] = most_promised(problem, nominal, laws)
    assert promised[1e9] < 12
    assert promised[4e12] > 2 * PRIORS.pair_log_odds


def test_no_law_promises_more_than_noise_beside_a_linear_effect_that_explains_all_levels():
    """Tolerances bend the modes otherwise under such an effect than they do without it."""
    effect = BearingTiltStiffness(stiffness=1500.0)
    runs = [measure("rigid", [effect], seed=9)]
    runs += [measure("bearing", [effect], seed=s, force_amplitude_N=level) for s, level in enumerate(LEVELS)]
    problem = problem_of(runs)
    (fit,) = search(problem, candidates(runs, STRUCTURE, all_but(effect.id))).fits
    assert fit.chi2 < 1.1 * fit.n_data
    laws = candidates(runs, STRUCTURE, all_but("bearing_friction"), nonlinear=True)
    assert most_promised(problem, fit, laws) < PRIORS.pair_log_odds


def test_many_places_of_a_law_do_not_crowd_out_the_others(hardening):
    laws = candidates(hardening, STRUCTURE, all_but("bearing_cubic", "rub"), nonlinear=True)
    rubs, (cubic,) = ([h for h in laws if h.ids == (name,)] for name in ("rub", "bearing_cubic"))
    starts = [Start(h, np.zeros(1), np.zeros(0), float(k)) for k, h in enumerate([*rubs, cubic, *rubs])]
    kept = _few_of_each(starts)
    assert len(rubs) > 2
    assert [start.hypothesis for start in kept] == [*rubs[:2], cubic]
    assert [start.cost for start in kept] == [0, 1, len(rubs)]


def test_lines_that_no_start_brings_to_the_data_are_given_up(hardening, monkeypatch):
    run = hardening[2]
    strange = np.arange(len(run.frequency_hz)) == 20
    run = replace(run, H=np.where(strange[:, None], 30 * run.H, run.H))
    forward, given_up = Forward(WORKSHOP), []
    start_again, in_vain = Branch.start_again, BranchSearch().in_vain

    def watched(self, balance, best, lost):
        given_up.append(np.flatnonzero(lost).tolist())
        return start_again(self, balance, best, lost)

    monkeypatch.setattr(Branch, "start_again", watched)
    for k_b in K_B * (1 + 0.005 * np.arange(in_vain + 2)):
        forward.modal(run, k_b, (CUBIC,)).response()
    assert given_up[:in_vain] == [[]] * in_vain
    assert all(20 in lost for lost in given_up[in_vain:])
    forward.forget()
    forward.modal(run, K_B, (CUBIC,)).response()
    assert given_up[-1] == []


def test_lines_on_the_upper_branch_are_found_by_their_magnitudes(monkeypatch):
    run = swept(CUBIC, 2.0, resolution=FINAL)
    run = replace(run, H=np.abs(run.H), magnitude_only=True)

    def lost():
        modal = Forward(WORKSHOP).made(resolution=FINAL).modal(run, K_B, (CUBIC,))
        assert isinstance(modal, NonlinearModal)
        return np.count_nonzero(modal.drive.miss(modal.motions()) > 0.1)

    assert lost() == 0
    monkeypatch.setattr("rigtwin.gap.model.branch._PHASES", {})
    assert lost() == 4


def test_hysteresis_needs_no_more_samples_than_it_has(monkeypatch):
    friction, H = BearingFriction(force=1.0, stiffness=5e5), {}
    for size in (ModelSize(), ModelSize(hysteresis_samples=1024)):
        monkeypatch.setattr(forward_module, "_SIZE", size)
        run = blank("bearing", lines("bearing")[::16], force_amplitude_N=3.0, sweep="up")
        forward = Forward(WORKSHOP).made(with_data=False, resolution=FINAL)
        H[size.hysteresis_samples] = forward.modal(run, K_B, (friction,)).response()
    few, many = H.values()
    off = np.abs(few - many).max() / np.abs(many).max()
    assert 0 < off < 1e-4


@pytest.mark.long
def test_a_bilinear_support_starts_from_one_level():
    """The mean stiffness that narrow resonances need takes several harmonics."""
    rigid = blank("rigid", lines("rigid"), force_amplitude_N=0.2, name="rigid")
    runs = (with_noise(rigid, truth(rigid), 9), swept(BilinearSupport(ratio=1.15), 0.2, 0, FINAL))
    problem = problem_of(runs)
    (law,) = candidates(runs, STRUCTURE, all_but("bilinear_support"), nonlinear=True)
    calm = recalibrate(problem)
    best = min(_uneven(problem, law, calm, calm.nu), key=lambda start: start.cost)
    assert law.effects(best.u[1:])[0].ratio == pytest.approx(1.15, abs=0.03)
    assert np.exp(best.u[0]) == pytest.approx(K_B, rel=0.03)


@pytest.mark.long
def test_the_interval_of_a_nonlinear_cause_holds_what_the_correction_explains(hardening):
    problem = problem_of(hardening)
    (cubic,) = candidates(hardening, STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
    fit = robust_fit(problem, cubic, np.log([1.001 * K_B, 1.01e15]))
    assert fit is not None
    low, high = transfer_interval(problem, problem.fit(NOMINAL, fit.u[:1]), fit, 1.0)
    there = swept(CUBIC, LEVELS[1], excitation_node=4)
    forward = Forward(WORKSHOP).made(with_data=False)
    truth, corrected = (forward.modal(there, k_b, e).response() for k_b, e in ((K_B, (CUBIC,)), (fit.k_b, fit.effects)))
    shrink = 1 - nrmse(truth, corrected) / nrmse(truth, forward.modal(there, K_B).response())
    assert 0.5 < low < high <= 1
    assert low - 0.05 < shrink <= 1


def test_the_law_is_named_and_its_number_found(hardening):
    laws = candidates(hardening, STRUCTURE, all_but("bearing_cubic", "bearing_hertz"), nonlinear=True)
    *_, found = search_nonlinear(problem_of(hardening), laws, THRESHOLDS.adequate_nonlinear)
    best = found.fits[0]
    assert best.hypothesis.ids == ("bearing_cubic",)
    assert best.chi2 < 1.2 * best.n_data
    assert found.nominal.chi2 > 20 * best.chi2
    assert best.effects[0].stiffness == pytest.approx(1e15, rel=0.03)
    assert best.k_b == pytest.approx(K_B, rel=0.01)


def test_lines_on_another_branch_do_not_decide(hardening):
    wrong = hardening[3].H.copy()
    wrong[20:24] *= 5j
    runs = (hardening[1], replace(hardening[3], H=wrong))
    problem = problem_of(runs)
    (cubic,) = candidates(runs, STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
    u = np.log([1.01 * K_B, 1.1e15])
    fit = robust_fit(problem, cubic, u)
    assert fit is not None
    assert fit.effects[0].stiffness == pytest.approx(1e15, rel=0.03)
    (settled,) = settle(problem, [Start(cubic, u, np.zeros(problem.nuisances.n), 0.0)])
    assert np.exp(settled.u[1]) == pytest.approx(1e15, rel=0.05)


def test_friction_starts_from_the_stiffnesses_of_two_levels(hardening):
    problem = problem_of(hardening[2:3])
    (friction,) = candidates(hardening, STRUCTURE, all_but("bearing_friction"), nonlinear=True)
    rest = Rest(problem.fit(NOMINAL, np.log([K_B]), steps=1), 0.8 * K_B, np.zeros(7), (1, 7))
    points = [u for u in law_strategy_of(friction).points(friction, rest) if np.isclose(u[0], np.log(rest.loud))]
    assert len(points) > 10
    assert np.allclose([np.exp(u[0]) + np.exp(u[2]) for u in points], rest.calm.k_b)


@pytest.mark.long
def test_friction_whose_limits_differ_is_told_from_friction_that_slips_at_once():
    seat = BearingFriction(force=0.5, stiffness=1e6, spread=0.85)
    runs = [swept(seat, level, seed, resolution=MIDDLE) for seed, level in enumerate((0.1, 0.5))]
    problem = problem_of(runs)
    every = thin_out(problem.made(resolution=MIDDLE), 4, K_B, MODEL_ERROR)
    (friction,) = candidates(runs, STRUCTURE, all_but("bearing_friction"), nonlinear=True)
    assert [free.name for free in friction.free] == ["force", "stiffness"]
    plain = robust_fit(every, friction, np.log([K_B, 0.5, 1e6]))
    assert plain is not None
    assert plain.chi2 > 3 * plain.n_data
    (bent,) = _bent(problem, every, [plain], THRESHOLDS.adequate_nonlinear)
    assert bent.chi2 < THRESHOLDS.adequate_nonlinear * bent.n_data
    assert bent.effects[0].spread == pytest.approx(0.85, abs=0.05)
    assert bent.effects[0].force == pytest.approx(0.5, rel=0.05)
    assert _bent(problem, every, [bent], THRESHOLDS.adequate_nonlinear) == []


def test_a_far_start_is_not_held_by_its_worst_lines(hardening):
    problem = problem_of(hardening[2:3])
    (cubic,) = candidates(hardening, STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
    fit = robust_fit(problem, cubic, np.log([1.02 * K_B, 2e15]))
    assert fit is not None
    assert fit.effects[0].stiffness == pytest.approx(1e15, rel=0.03)


def document(effect: str, **parameters):
    """A diagnosis with one cause."""
    cause = {
        "effects": [effect],
        "parameters": {name: {"value": value, "std": 0.0} for name, value in parameters.items()},
        "places": {},
        "k_b": {"value": K_B, "std": 1e3},
    }
    return {"schema": SCHEMA, "verdict": "cause", "nominal": {"k_b": {"value": K_B}}, "causes": [cause]}


def test_a_sweep_stays_on_its_branch_however_far_apart_its_lines_are():
    """From below a contact to far above it the way has to be made in short steps more than once."""
    rub = Rub(stiffness=3e6, gap=4.8e-5, node=6)
    forward = Forward(workshop(replace(BELIEF, shaft_damping_ratio=1e-3))).made(with_data=False, resolution=FINAL)
    sparse, dense = np.array([99.0, 100.9, 102.8]), np.linspace(99.0, 102.8, 77)
    found = []
    for hz in (sparse, dense):
        run = blank("rigid", hz, force_amplitude_N=0.59, excitation_node=4, sweep="up")
        modal = forward.modal(run, K_B, (rub,))
        assert isinstance(modal, NonlinearModal)
        found.append(modal.response()[:, 3])
    np.testing.assert_allclose(found[0], found[1][[0, 38, 76]], rtol=1e-6)


def test_a_prediction_follows_the_sweep():
    run = blank("bearing", lines("bearing"), force_amplitude_N=1.5, sweep="up", name="up", channels=CHANNELS)
    made = [
        predict(Diagnosis.from_document(document("bearing_cubic", stiffness=1e15)), campaign_of(each))[0].corrected.H
        for each in (run, replace(run, sweep="down"))
    ]
    apart = np.linalg.norm(made[0] - made[1], axis=1) > 0.1 * np.linalg.norm(made[0], axis=1)
    assert apart.any()  # where there are two motions
    assert not apart[:5].any()
    assert (np.linalg.norm(made[0], axis=1) > np.linalg.norm(made[1], axis=1))[apart].all()  # hardening: up is higher


def test_values_of_a_run_do_not_choose_the_branch_of_a_prediction():
    run = blank("bearing", lines("bearing")[::3], force_amplitude_N=0.2, sweep="up", name="any")
    loud = replace(run, H=np.full_like(run.H, 1e3))
    soft = Diagnosis.from_document(document("bearing_hertz", preload=BearingHertz().preload))
    (a,), (b,) = predict(soft, campaign_of(run)), predict(soft, campaign_of(loud))
    assert np.array_equal(a.corrected.H, b.corrected.H)
    assert np.linalg.norm(a.corrected.H - a.nominal.H) > 0.05 * np.linalg.norm(a.nominal.H)
