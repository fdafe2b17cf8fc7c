"""Evidence by importance sampling, against integrals that are known."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from rigtwin.gap.inference.evidence import sample
from rigtwin.gap.inference.fit import Fit, Sampled
from rigtwin.gap.inference.hypotheses import NOMINAL
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.rotor.effects import BearingCubic
from tests.gap.conftest import MASS, both_supports, candidate, problem_of


def one_number(cost, curvature, ends=(-50.0, 50.0), effects=()):
    """A problem of one number and one nuisance, the fit at zero; ``cost`` is the misfit by the number."""
    width = ends[1] - ends[0]
    precision = np.diag([curvature, 0.0])
    prior = np.array([2 * np.pi / width**2, 1.0])
    fit = SimpleNamespace(
        u=np.zeros(1),
        nu=np.zeros(1),
        prior_std=np.ones(1),
        with_k_b=True,
        effects=effects,
        hypothesis=SimpleNamespace(ends=np.array([ends])),
        covariance=lambda scale: np.linalg.inv(precision / scale**2 + np.diag(prior)),
    )
    problem = SimpleNamespace(misfit_of=lambda h, u, nu: float(cost(u[0])), around=lambda fit: problem)
    laplace = np.sqrt(2 * np.pi / (curvature + prior[0]))
    return problem, fit, laplace


@pytest.mark.parametrize(
    ("cost", "curvature", "ends"),
    [
        (lambda x: x**2, 1.0, (-50.0, 50.0)),  # Laplace is right
        (lambda x: x**2, 1.0, (0.0, 50.0)),  # the best point is at the end of the range: half of it
        (lambda x: x**2 + 0.3 * x**4, 1.0, (-50.0, 50.0)),  # lighter tails than it has curvature
        (lambda x: 4 * np.log1p(x**2 / 4), 1.0, (-50.0, 50.0)),  # heavier ones
    ],
)
def test_the_correction_is_the_integral_over_laplace_s(cost, curvature, ends):
    problem, fit, laplace = one_number(cost, curvature, ends)
    true = quad(lambda x: np.exp(-cost(x) / 2), max(ends[0], -30), min(ends[1], 30))[0]
    found = sample(problem, fit, draws=(4000,))
    assert abs(found.correction - np.log(true / laplace)) < 4 * found.error + 1e-3
    assert found.error < 0.05
    few = sample(problem, fit)
    assert abs(few.correction - np.log(true / laplace)) < 4 * few.error + 1e-3
    assert 20 < few.ess <= 64


def test_the_evidence_is_the_data_s_probability_over_the_prior():
    """Of a number that the data tell well, and of one that they do not tell."""
    width = np.ptp(NOMINAL.ends)
    told = Fit(NOMINAL, np.log([1e6]), np.zeros(0), 7.0, 0.0, np.array([[1e8]]), 9, np.zeros(0), True)
    exact = quad(lambda x: np.exp(-1e8 * x**2 / 2), -1e-3, 1e-3, points=[0.0])[0] / width
    assert told.log_evidence() == pytest.approx(np.log(exact) - 3.5, abs=1e-4)
    assert replace(told, precision=np.zeros((1, 1))).log_evidence() == pytest.approx(-3.5)


def test_where_few_draws_count_there_are_more():
    """A neighbourhood much narrower than the fit says."""
    problem, fit, laplace = one_number(lambda x: x**2, 0.0025)
    assert not sample(problem, fit, draws=(64,)).trusted
    found = sample(problem, fit)
    assert found.trusted
    assert abs(found.correction - np.log(np.sqrt(2 * np.pi) / laplace)) < 4 * found.error


def test_errors_that_are_larger_than_believed_widen_the_integral():
    problem, fit, _ = one_number(lambda x: x**2, 1.0)
    assert_allclose(sample(problem, fit, scale=3.0).correction, 0.0, atol=0.01)


def test_a_fit_whose_neighbourhood_is_nothing_like_laplace_s_is_not_trusted():
    problem, fit, _ = one_number(lambda x: 1e6 * x**2, 1.0)
    found = sample(problem, fit)
    assert found.ess < 8
    assert not found.trusted


def test_nonlinear_effects_are_not_sampled_nor_is_what_has_no_model():
    problem, fit, _ = one_number(lambda x: x**2, 1.0, effects=(BearingCubic(stiffness=1e15),))
    assert sample(problem, fit) is None
    problem, fit, _ = one_number(lambda x: 0.0 if x == 0 else np.inf, 1.0)
    assert sample(problem, fit) is None


def test_the_evidence_of_a_fit_takes_a_trusted_correction_only():
    runs = both_supports(MASS)
    problem = problem_of(*runs)
    nominal = recalibrate(problem)
    fit = problem.fit(candidate(runs, "attached_mass", MASS.node), np.array([nominal.u[0], np.log(MASS.mass)]))
    found = sample(problem, fit)
    assert found.ess > 8
    assert abs(found.correction) < 0.6  # a mass that is well measured: Laplace is right
    plain = fit.log_evidence()
    assert_allclose(replace(fit, sampled=Sampled(-1.5, 0.1, 20.0)).log_evidence(), plain - 1.5)
    assert replace(fit, sampled=Sampled(-1.5, 0.9, 3.0)).log_evidence() == plain


def test_a_diagnosis_says_how_its_evidence_was_sampled(weighed):
    first, *others = json.loads(weighed.diagnosis.to_json())["causes"]
    assert 8 < first["ess"] <= 64
    assert 0 <= first["log_evidence_error"] < 0.5
    assert all(cause["ess"] is None for cause in others if cause["probability"] < 1e-4)
