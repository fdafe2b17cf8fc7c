"""Harmonics that were measured: the model has those of a motion in time, and they tell a law from a bad exciter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rigtwin
from rigtwin.gap.inference.harmonics import with_harmonics
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.motions import FINAL
from rigtwin.gap.search.laws.robust import robust_fit
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.rotor.effects import BearingHertz
from tests.gap.conftest import BELIEF, CUBIC, K_B, RIG, WORKSHOP, blank, measure, of, problem_of, truth
from tests.gap.test_laws_beside import library
from tests.gap.test_nonlinear import swept

NONE = np.zeros(len(WORKSHOP.std))
RNG = np.random.default_rng(4)


def still(modal):
    return np.zeros(len(modal.sensitivity), dtype=complex)


def noisy(run, harmonics):
    """The run with harmonics of this size, in the noise of its lines."""
    error = RNG.standard_normal((2, *run.H.shape))
    return replace(run, harmonics={3: harmonics + run.std * (error[0] + 1j * error[1]) / np.sqrt(2)})


def at_third_harmonic(run):
    """What a newton of the exciter's third harmonic does to the linear rotor."""
    return truth(blank(run.support, 3 * run.frequency_hz))


def test_harmonics_are_those_of_the_rotor_in_time():
    damping = {"bearing_damping": BELIEF.bearing_damping_Ns_per_m, "shaft_damping_ratio": BELIEF.shaft_damping_ratio}
    measured = rigtwin.sweep(
        RIG, k_b=K_B, effects=[CUBIC], parameters=damping, f_min_hz=228.0, f_max_hz=240.0, lines=16, force_N=0.8
    ).run
    modal = Forward(WORKSHOP).made(resolution=FINAL).modal(measured, K_B, (CUBIC,))
    expected, found = measured.harmonics[3], modal.harmonic(3, still(modal), NONE)
    size, off = (np.linalg.norm(each, axis=1) for each in (expected, found - expected))
    large = size > 0.1 * size.max()
    assert np.count_nonzero(large) > 10
    near = off[large] / size[large]
    assert np.median(near) < 0.02
    assert np.mean(near < 0.1) > 0.9  # but for a line at the jump
    assert not modal.harmonic(FINAL.harmonics + 1, still(modal), NONE).any()


def law_fits(problem, runs):
    """Fits of a cubic bearing and of a contact that moves the resonances alike."""
    laws, _ = library(runs, "bearing_cubic", "bearing_hertz")
    cubic, contact = sorted(laws, key=lambda law: law.ids)
    contact = robust_fit(problem, contact, np.log([K_B, BearingHertz().preload]))
    return robust_fit(problem, cubic, np.log([K_B, CUBIC.stiffness])), contact


def test_harmonics_count_for_the_law_that_makes_them():
    run = swept(CUBIC, 0.8)
    modal = Forward(WORKSHOP).made(with_data=False).modal(run, K_B, (CUBIC,))
    run = noisy(run, np.where(np.isfinite(run.H), modal.harmonic(3, still(modal), NONE), 0.0))
    problem = problem_of(run)
    cubic, contact = (with_harmonics(problem, fit) for fit in law_fits(problem, (run,)))
    nominal = with_harmonics(problem, recalibrate(problem))
    assert cubic.harmonics > contact.harmonics + 10
    assert cubic.harmonics > nominal.harmonics + 100
    assert cubic.log_evidence() - replace(cubic, harmonics=0.0).log_evidence() == pytest.approx(cubic.harmonics)


def test_harmonics_of_the_exciter_are_no_law():
    run = measure("bearing", force_amplitude_N=0.8, sweep="up")
    run = noisy(run, 0.03 * np.exp(0.4j) * at_third_harmonic(run))
    problem = problem_of(run)
    nominal = with_harmonics(problem, recalibrate(problem))
    cubic = with_harmonics(problem, law_fits(problem, (run,))[0])
    assert nominal.harmonics > cubic.harmonics - 1
    none = with_harmonics(problem_of(noisy(run, 0 * run.H)), recalibrate(problem))
    strange = with_harmonics(problem_of(noisy(run, 0.3 * np.abs(run.H))), recalibrate(problem))
    assert none.harmonics > nominal.harmonics > strange.harmonics


def test_harmonics_of_some_lines_of_a_fast_sweep_are_read():
    run = measure("bearing", force_amplitude_N=0.8, sweep="up")
    few = noisy(run, 0.03 * at_third_harmonic(run)).on_lines(slice(None, None, 3))
    assert np.array_equal(few.at_order(3).swept_hz, 3 * run.frequency_hz)
    problem = problem_of(few)
    (hypothesis,) = of((few,), "fast_sweep")
    assert np.isfinite(with_harmonics(problem, problem.fit(hypothesis, np.log([K_B, 3.0]))).harmonics)


def test_runs_without_harmonics_say_nothing_by_them():
    run = measure("bearing")
    problem = problem_of(run)
    assert with_harmonics(problem, recalibrate(problem)).harmonics == 0.0
    sizes = replace(run, H=np.abs(run.H), magnitude_only=True, harmonics={3: np.abs(run.H)})
    problem = problem_of(sizes)
    assert with_harmonics(problem, recalibrate(problem)).harmonics == 0.0
