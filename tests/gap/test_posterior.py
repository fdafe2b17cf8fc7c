"""What the data leave open, where a repeatability is learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import binom

from rigtwin.gap.inference.posterior import Posterior, posterior, with_sizes
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.linear import MODES
from rigtwin.gap.search.nominal import recalibrate
from tests.gap.conftest import BELIEF, K_B, blank, both_supports, lines, problem_of, with_noise, workshop

DRIFT = 5e-4
LEARNS = replace(BELIEF, frequency_drift=None)


def on(belief, runs) -> Problem:
    return Problem(Forward(workshop(belief)), problem_of(*runs).observed)


def drifted(seed: int, true: float, supports=("rigid", "bearing")):
    """Runs whose resonances drift each by their own."""
    rng = np.random.default_rng([seed, 7])
    made, forward = [], problem_of(*both_supports()).forward
    for n, support in enumerate(supports):
        run = blank(support, lines(support), name=f"{support}{n}")
        modal = forward.modal(run, K_B)
        drift = true * (rng.standard_normal(MODES) + 1j * rng.standard_normal(MODES))
        made.append(with_noise(run, modal.response(drift), 100 * seed + n))
    return made


@pytest.fixture(scope="module")
def learned():
    problem = on(LEARNS, drifted(3, DRIFT))
    return problem, recalibrate(problem)


def test_where_nothing_is_learned_it_is_laplaces():
    problem = on(BELIEF, drifted(3, DRIFT))
    fit = recalibrate(problem)
    found = posterior(problem, fit, 1.3)
    assert_allclose(found.weights, [1.0])
    assert_allclose(found.means[0], np.concatenate([fit.u, fit.nu]))
    assert_allclose(found.std, np.sqrt(fit.covariance(1.3).diagonal()))


def test_sizes_weigh_as_the_evidence_of_fits_to_which_they_are_stated(learned):
    problem, fit = learned
    (drift,) = problem.nuisances.learned
    logs, stated = [], []
    for size in (DRIFT / 2, DRIFT, 2 * DRIFT):
        log, mean, covariance = with_sizes(fit, [drift], [size], 1.0)
        told = on(replace(LEARNS, frequency_drift=size), problem.runs)
        own = told.fit(fit.hypothesis, fit.u, fit.nu, anneal=(0.0,))
        logs.append(log)
        stated.append(own.log_evidence() + drift.log_prior(size))
        assert abs(mean[0] - own.u[0]) < 0.1 * np.sqrt(own.covariance()[0, 0])
        assert_allclose(covariance[0, 0], own.covariance()[0, 0], rtol=0.1)
    assert_allclose(np.diff(logs), np.diff(stated), atol=0.1)


def test_the_whole_has_the_spread_of_what_is_drawn_from_it(learned):
    found = posterior(*learned)
    assert len(found.weights) > 2
    assert found.weights.sum() == pytest.approx(1.0)
    drawn = found.draws(np.random.default_rng(1), 4000)
    assert drawn.shape == (4000, len(found.std))
    assert_allclose(drawn[:, 0].std(), found.std[0], rtol=0.05)


def test_means_apart_count():
    mixed = Posterior(np.array([0.5, 0.5]), np.array([[-2.0], [2.0]]), np.ones((2, 1, 1)))
    assert_allclose(mixed.std, np.sqrt([5.0]))


def test_intervals_of_k_b_hold_it_as_often_as_they_say():
    """Two runs, whose few resonances hardly tell how far they drift."""
    held, wider = [], []
    for seed in range(40):
        problem = on(LEARNS, drifted(seed, DRIFT))
        fit = recalibrate(problem)
        std = posterior(problem, fit).std[0]
        held.append(abs(fit.u[0] - np.log(K_B)) < 1.645 * std)
        wider.append(std / np.sqrt(fit.covariance()[0, 0]))
    low, high = binom.interval(0.99, len(held), 0.9)
    assert low <= sum(held) <= high
    assert np.median(wider) > 1.04  # than where the most probable drift is taken for known
