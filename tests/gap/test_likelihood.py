"""The joint fit of a candidate and of what runs do not share, on runs whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.inference.hypotheses import NOMINAL, Hypothesis
from rigtwin.gap.inference.observed import (
    Observed,
    derivatives,
    expected_magnitude,
    observe,
    residual,
    weights_and_residuals,
)
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.workshop import Workshop
from rigtwin.gap.search.nominal import NOMINAL_FITS, in_si, recalibrate, roughly
from rigtwin.gap.verdict.adequacy import judge
from rigtwin.rotor.effects import AttachedMass, BearingDamping
from tests.gap.conftest import (
    BELIEF,
    CHANNELS,
    ELEMENTS,
    K_B,
    NOISE,
    blank,
    both_supports,
    candidate,
    lines,
    measure,
    problem_of,
    rebuilt,
    with_noise,
    workshop,
)

MASS = AttachedMass(mass=0.1, node=3)
GAINS, DRIFTS = (1.03, 0.98), (1.5e-4, -1e-4)


def two_runs(*effects, seed=0, **settings):
    """Runs with a gain and a drift of their own."""
    return tuple(
        measure(support, effects, seed=seed + n, gain=GAINS[n], drift=DRIFTS[n], **settings)
        for n, support in enumerate(("rigid", "bearing"))
    )


def fitted(problem, hypothesis):
    """A candidate from the middle of its range and the nominal model's stiffness."""
    start = np.concatenate([recalibrate(problem).u[:1], hypothesis.starts()[len(hypothesis.starts()) // 2]])
    return problem.fit(hypothesis, problem.rough(hypothesis, start, 8)[0])


def sigmas(fit, place, truth):
    """How far a fitted coordinate is from the truth, in its standard errors."""
    return float((fit.u[place] - truth) / np.sqrt(fit.covariance()[place, place]))


@pytest.fixture(scope="module")
def heavy() -> Problem:
    problem = problem_of(*two_runs(MASS))
    return problem


@pytest.fixture(scope="module")
def right(heavy):
    return fitted(heavy, candidate(heavy.runs, "attached_mass", 3))


def test_stiffness_and_mass_are_recovered(right):
    assert abs(sigmas(right, 0, np.log(K_B))) < 4
    assert abs(sigmas(right, 1, np.log(MASS.mass))) < 4
    assert_allclose(right.k_b, K_B, rtol=5e-3)
    assert_allclose(right.effects[0].mass, MASS.mass, rtol=0.05)


def test_only_noise_is_left(right):
    assert right.n_data == 2 * sum(np.count_nonzero(run.H) for run in two_runs(MASS))
    assert 0.9 < right.chi2 / right.n_data < 1.1
    assert np.abs(right.nu / right.prior_std).max() < 4


def test_gains_of_the_runs_are_recovered(heavy, right):
    """A run's gain, times what its sensors share."""
    nuisances = heavy.nuisances
    common = right.nu[nuisances.sensor][1:6].mean()
    assert_allclose(np.exp(right.nu[nuisances.gain] + common), GAINS, rtol=5e-3)


def test_a_drift_between_runs_is_recovered(heavy, right):
    """Two runs of one rotor differ by what drifted between them."""
    first, second = (measure("bearing", (MASS,), seed=n, drift=drift, noise=1e-3) for n, drift in enumerate(DRIFTS))
    problem = problem_of(first, second)
    fit = problem.fit(candidate(problem.runs, "attached_mass", 3), right.u)
    between = fit.nu[problem.nuisances.drift[0]] - fit.nu[problem.nuisances.drift[1]]
    assert_allclose(between[:2], DRIFTS[0] - DRIFTS[1], atol=4e-5)


def test_the_fit_predicts_the_runs(heavy, right):
    for observed, model in zip(heavy.observed, heavy.predict(right), strict=True):
        error = np.linalg.norm(observed.run.H - model) / np.linalg.norm(observed.run.H)
        assert 0.5 * NOISE < error < 1.5 * NOISE


def test_evidence_prefers_what_is_there(heavy, right):
    nominal = recalibrate(heavy)
    elsewhere = fitted(heavy, candidate(heavy.runs, "attached_mass", 5))
    other = fitted(heavy, candidate(heavy.runs, "disk_mass"))
    assert right.log_evidence() > max(fit.log_evidence() for fit in (nominal, elsewhere, other)) + 10


@pytest.mark.parametrize("seed", [10, 20])
def test_evidence_prefers_the_nominal_model_where_nothing_is(seed):
    problem = problem_of(*two_runs(seed=seed))
    nominal = recalibrate(problem)
    assert 0.9 < nominal.chi2 / nominal.n_data < 1.1
    for name, node in (("attached_mass", 3), ("disk_mass", None), ("bearing_damping", None)):
        hypothesis = candidate(problem.runs, name, node)
        start = np.concatenate([nominal.u, hypothesis.starts()[0]])
        assert problem.fit(hypothesis, start).log_evidence() < nominal.log_evidence()


def test_errors_that_are_too_small_can_be_scaled():
    """Twice the noise that is believed: with the scale given, the evidence is that of the right errors."""
    runs = two_runs(MASS)
    forward = problem_of(*runs).forward
    honest, believed = (
        Problem(forward, [observe(run, share * np.asarray(run.std)) for run in runs], 0.0) for share in (1.0, 0.5)
    )
    u = np.array([np.log(K_B), np.log(MASS.mass)])
    hypothesis = candidate(runs, "attached_mass", 3)
    loud, true = (problem.fit(hypothesis, u, anneal=(0.0,), steps=0) for problem in (believed, honest))
    assert_allclose(loud.log_evidence(2.0), true.log_evidence(), rtol=0.02)
    assert loud.log_evidence() < true.log_evidence() - 100


def test_magnitudes_alone_tell_stiffness_and_mass():
    runs = [replace(run, H=np.abs(run.H), magnitude_only=True) for run in two_runs(MASS, seed=3)]
    problem = problem_of(*runs)
    fit = fitted(problem, candidate(runs, "attached_mass", 3))
    assert fit.n_data == sum(np.count_nonzero(run.H) for run in runs)
    assert 0.85 < fit.chi2 / fit.n_data < 1.15
    assert abs(sigmas(fit, 0, np.log(K_B))) < 4
    assert abs(sigmas(fit, 1, np.log(MASS.mass))) < 4


def test_missing_values_take_no_part(right):
    runs = []
    for run in two_runs(MASS):
        H = run.H.copy()
        H[::7, 2], H[5, :] = np.nan, np.nan
        runs.append(replace(run, H=H))
    problem = problem_of(*runs)
    fit = fitted(problem, candidate(runs, "attached_mass", 3))
    assert fit.n_data < right.n_data
    assert 0.9 < fit.chi2 / fit.n_data < 1.1
    assert abs(sigmas(fit, 1, np.log(MASS.mass))) < 4


def test_a_channel_without_errors_takes_no_part():
    run = measure("bearing")
    std = run.std.copy()
    std[:, 3] = np.inf
    broken = replace(run, H=np.where(np.arange(7) == 3, 100 * run.H, run.H))
    problem = Problem(problem_of(run).forward, [observe(broken, std)])
    fit = recalibrate(problem)
    assert 0.9 < fit.chi2 / fit.n_data < 1.1
    assert_allclose(fit.k_b, K_B, rtol=5e-3)


@pytest.mark.parametrize(("n", "left"), [(20, 20), (70, 35), (280, 70)])
def test_a_short_run_is_not_thinned_out_of_sight(n, left):
    run = measure("bearing", frequency_hz=np.linspace(20.0, 400.0, n))
    (some,) = problem_of(run).thinned(4).observed
    assert len(some.run.frequency_hz) == left
    assert some.run.std is not None


def test_runs_in_another_unit_are_brought_to_si():
    """What is within a factor of three is taken as it is: an effect may change the level, too."""
    runs = [replace(run, quantity="acceleration") for run in both_supports()]
    far = [replace(run, H=1e4 * run.H, std=1e4 * run.std, name="far") for run in runs[:1]]
    problem = problem_of(*far, *runs[1:])
    again = in_si(problem, roughly(problem))
    assert_allclose(np.abs(again.runs[0].H), np.abs(runs[0].H), rtol=0.1)
    assert_allclose(again.observed[0].std * np.abs(far[0].H), problem.observed[0].std * np.abs(again.runs[0].H))
    (mode, *_), (before, *_) = again.observed[0].resonances, problem.observed[0].resonances
    assert_allclose(mode.residues * np.abs(far[0].H[0, 1]), before.residues * np.abs(again.runs[0].H[0, 1]))
    assert again.runs[1] is problem.runs[1]
    assert_allclose(recalibrate(again).nu[again.nuisances.gain], 0.0, atol=0.1)


@pytest.mark.parametrize("effect", [BearingDamping(damping=3000.0), AttachedMass(mass=2.0, node=3)])
def test_a_large_gap_does_not_pass_for_a_unit(effect):
    """A fit of the lines would take their level for a tenth of what it is."""
    runs = [replace(run, quantity="acceleration") for run in both_supports(effect)]
    problem = problem_of(*runs)
    assert in_si(problem, roughly(problem)) is problem
    louder = problem_of(*(replace(run, H=1e3 * run.H, std=1e3 * run.std) for run in runs))
    for run, given in zip(in_si(louder, roughly(louder)).runs, runs, strict=True):
        moving = np.abs(given.H) > 0
        assert np.abs(np.log(np.abs(run.H[moving] / given.H[moving]))).max() < np.log(NOMINAL_FITS.no_si_unit)


def test_an_arbitrary_unit_is_fitted():
    run = measure("bearing", (BearingDamping(damping=60.0),), gain=37.0, quantity="acceleration")
    problem = problem_of(run)
    fit = fitted(problem, candidate([run], "bearing_damping"))
    assert_allclose(fit.effects[0].damping, 60.0, rtol=0.05)
    assert_allclose(np.exp(fit.nu[problem.nuisances.gain]), 37.0, rtol=0.05)


def test_rigid_runs_say_nothing_of_the_bearings():
    run = measure("rigid", (MASS,))
    problem = problem_of(run)
    assert not problem.with_k_b
    fit = fitted(problem, candidate([run], "attached_mass", 3))
    assert_allclose(fit.effects[0].mass, MASS.mass, rtol=0.05)
    assert np.isfinite(fit.log_evidence())


def test_an_impossible_start_is_refused():
    run = measure("bearing", frequency_hz=lines("bearing")[::4])
    hypothesis: Hypothesis = candidate([run], "open_crack")
    depth, position = hypothesis.free
    beside = replace(hypothesis.terms[0], free=(depth, replace(position, low=1.0, high=2.0)))
    with pytest.raises(ValueError, match="open_crack: no model at the start"):
        problem_of(run).fit(Hypothesis((beside,)), np.array([np.log(K_B), np.log(0.3), 1.5]))


def test_belief_sets_the_nuisances_width():
    problem = problem_of(*both_supports())
    std, nuisances = problem.nuisances.std, problem.nuisances
    assert_allclose(std[nuisances.gain], BELIEF.gain_tolerance)
    assert_allclose(std[nuisances.drift[1]], BELIEF.frequency_drift)
    assert NOMINAL.free == ()


def test_gains_of_each_sensor_in_each_run_are_recovered():
    gains = 1 + 0.02 * np.random.default_rng(3).standard_normal((2, 7))
    runs = [measure(s, seed=k, gain=gains[k]) for k, s in enumerate(("rigid", "bearing"))]
    problem = problem_of(*runs)
    assert judge(problem, recalibrate(problem)).misfit > 1.5
    free = Problem(Forward(workshop(replace(BELIEF, gain_repeatability=None))), problem.observed)
    fit = recalibrate(free)
    assert judge(free, fit).misfit < 1.1
    found = [np.log(free.nuisances.gains(fit.nu, r, modal)) for r, modal in enumerate(free.modals(fit.k_b, ()))]
    moving = np.array([run.H.any(axis=0) for run in runs])
    assert_allclose(
        np.array(found)[moving], np.log(gains[moving]), atol=4 * NOISE / np.sqrt(2 * len(runs[0].frequency_hz))
    )


def test_gains_of_each_sensor_in_each_run_are_as_wide_as_the_campaign_says():
    observed = problem_of(*both_supports()).observed
    told = Problem(Forward(workshop(replace(BELIEF, gain_repeatability=0.003))), observed)
    own = [told.nuisances.std[each] for each in told.nuisances.own_gain]
    assert_allclose(own, np.full((2, 7), 0.003))
    assert told.thinned(3).nuisances.n == told.nuisances.n == problem_of(*both_supports()).nuisances.n + 14


@pytest.mark.parametrize("true", [1e-4, 2e-3])
def test_a_drift_that_nobody_states_is_learned(true):
    """Six runs of one rotor, whose resonances differ by so much."""
    drifts = true * np.random.default_rng(4).standard_normal(6)
    runs = [measure(s, seed=k, drift=drifts[k]) for k, s in enumerate(("rigid", "bearing") * 3)]
    problem = Problem(Forward(workshop(replace(BELIEF, frequency_drift=None))), problem_of(*runs).observed)
    fit = recalibrate(problem)
    learned = fit.prior_std[problem.nuisances.drift[0].start]
    assert 0.3 < learned / true < 3
    assert judge(problem, fit).misfit < 1.1


def test_loosened_drifts_are_free_whether_they_are_stated_or_learned():
    for stated in (1e-4, None):
        problem = Problem(
            Forward(workshop(replace(BELIEF, frequency_drift=stated))), problem_of(measure("rigid")).observed
        )
        loose, nu = problem.loosened(1e6), np.zeros(problem.nuisances.n)
        nu[problem.nuisances.drift[0]] = 6e-3
        assert problem.nuisances.penalty(nu) > 10
        assert loose.nuisances.penalty(nu) < 1e-6


def test_what_a_workshop_does_not_know_is_calibrated():
    """A rotor that is 1.5 % stiffer and damped twice as much as believed, beside tolerances that allow for it."""
    stiffer = rebuilt("modulus", 0.015)
    belief = replace(BELIEF, modulus_tolerance=0.01, shaft_damping_tolerance=0.7, frequency_drift=None)
    believed = replace(belief, shaft_damping_ratio=BELIEF.shaft_damping_ratio / 2)
    made = Forward(Workshop(stiffer, belief, ELEMENTS, 8))
    runs = [
        with_noise(empty, made.modal(empty, K_B).response(), seed)
        for seed, empty in enumerate(blank(support, lines(support), name=support) for support in ("rigid", "bearing"))
    ]
    problem = Problem(Forward(workshop(believed)), problem_of(*runs).observed)
    nominal = recalibrate(problem)
    taken = dict(zip(problem.forward.workshop.names, nominal.nu[problem.nuisances.tolerance], strict=True))
    assert judge(problem, nominal).misfit < 1.1
    assert_allclose(nominal.k_b, K_B, rtol=0.02)
    assert_allclose(taken["shaft_damping_ratio"], np.log(2), atol=0.05)
    assert 0.005 < taken["modulus"] < 0.025


def test_the_mean_magnitude_of_a_noisy_response_is_that_of_many_draws():
    rng = np.random.default_rng(0)
    H = np.array([[0.0, 0.3, 1.0, 4.0]], dtype=complex)
    run = replace(measure("rigid"), frequency_hz=np.array([50.0]), H=H + 1, channels=CHANNELS[:4], std=np.ones((1, 4)))
    noise = (rng.standard_normal((400_000, 4)) + 1j * rng.standard_normal((400_000, 4))) / np.sqrt(2)
    mean, slope = expected_magnitude(Observed(run, np.ones((1, 4))), H)
    assert_allclose(mean[0], np.abs(H + noise).mean(axis=0), atol=4e-3)
    nearby, _ = expected_magnitude(Observed(run, np.ones((1, 4))), H + 1e-6)
    assert_allclose(slope, (nearby - mean) / 1e-6, atol=1e-5)


def test_noise_of_a_sensor_that_stands_still_is_no_misfit_of_magnitudes():
    """Supports hold the end nodes, whose magnitudes are noise alone."""
    rng, runs = np.random.default_rng(1), []
    for run in both_supports():
        std = np.hypot(run.std, 1e-3 * np.median(np.abs(run.H)))
        noise = (rng.standard_normal(run.H.shape) + 1j * rng.standard_normal(run.H.shape)) / np.sqrt(2)
        runs.append(replace(run, H=np.abs(run.H + std * noise).astype(complex), std=std, magnitude_only=True))
    problem = problem_of(*runs)
    quality = judge(problem, recalibrate(problem))
    assert quality.misfit < 1.15
    assert abs(quality.correlation) < 3.5


def test_a_number_wants_more_at_an_end_where_its_effect_has_not_faded():
    runs = both_supports()
    pedestal = candidate(runs, "pedestal_flexibility")
    foam = candidate(runs, "viscoelastic_support")

    fit = recalibrate(problem_of(*runs))

    def standing(hypothesis, name, end):
        u = hypothesis.ends.mean(axis=1)
        place = [free.name for free in hypothesis.coordinates].index(name)
        u[place] = hypothesis.ends[place, end]
        return replace(fit, hypothesis=hypothesis, u=u)

    for hypothesis, name, end, wanted in (
        (pedestal, "damping", 0, False),  # no damping is nothing to ask more of
        (pedestal, "damping", 1, True),
        (pedestal, "stiffness", 1, False),  # a stiff pedestal is none
        (pedestal, "stiffness", 0, True),
        (foam, "relaxation_time", 0, True),
    ):
        at_end = standing(hypothesis, name, end)
        assert at_end.at_edge.sum() == 1
        assert at_end.wants_more == wanted, (name, end)


@pytest.mark.parametrize("magnitude_only", [False, True])
def test_residuals_are_independent_where_channels_share_an_error(magnitude_only):
    """Their covariance over many draws is one, and their derivatives follow them."""
    rng, common, own = np.random.default_rng(4), 0.02, 0.01
    plain = measure("bearing", noise=1e-9)
    H = np.repeat(plain.H[10:11], 20000, axis=0)
    noise = [rng.standard_normal((len(H), n)) + 1j * rng.standard_normal((len(H), n)) for n in (1, H.shape[1])]
    y = H * (1 + (common * noise[0] + own * noise[1]) / np.sqrt(2))
    f = np.linspace(20, 30, len(H))
    run = replace(plain, frequency_hz=f, H=np.abs(y) if magnitude_only else y, std=None, magnitude_only=magnitude_only)
    observed = observe(run, np.hypot(common, own) * np.abs(H), common)
    z = residual(observed, H, 0.0)
    for part in (z.real,) if magnitude_only else (z.real, z.imag):
        assert_allclose(np.cov(part.T), np.eye(H.shape[1]), atol=0.05)
    weight, left = weights_and_residuals(observed, H, 0.0)
    _, moved = weights_and_residuals(observed, H * (1 + 1e-6), 0.0)
    assert_allclose(derivatives(observed, H, H[None], weight)[0], (left - moved) / 1e-6, rtol=1e-2, atol=0.3)
