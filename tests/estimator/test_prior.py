"""The rigs that are drawn: repeatable, spread over the whole of their ranges, and some without damping."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.estimator.prior import PRIOR, Prior, Rigs, prior_for
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import undamped_modes
from tests.rotor.rigs import paper_structure

N = 512
RANGES = {
    "k_b": PRIOR.k_b_trained,
    "shaft_damping_ratio": PRIOR.shaft_damping_ratio,
    "bearing_damping": PRIOR.bearing_damping,
}


def places(rigs: Rigs, name: str) -> np.ndarray:
    """Where in its range each value lies, 0 to 1, of all but the bearings' damping in the logarithm; bearings without
    damping left out."""
    values, (low, high) = getattr(rigs, name), RANGES[name]
    values = values[values > 0]
    if name != "bearing_damping":
        low, high, values = np.log(low), np.log(high), np.log(values)
    return (values - low) / (high - low)


def test_the_same_seed_draws_the_same_rigs_and_another_seed_others():
    first, again, other = (astuple(PRIOR.draw(N, seed)) for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        assert_array_equal(a, b)
        assert np.mean(a == c) < 0.5  # bearings without damping are alike


@given(n=st.integers(1, 70), seed=st.integers(0, 2**32))
def test_as_many_rigs_as_asked_for_all_in_range(n, seed):
    rigs = PRIOR.draw(n, seed)
    assert {len(rigs), *(len(values) for values in astuple(rigs))} == {n}
    for name in RANGES:
        assert np.all((places(rigs, name) >= 0) & (places(rigs, name) <= 1))


@pytest.mark.parametrize("name", RANGES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ranges_are_covered_evenly(name, seed):
    """A Sobol sequence has no holes: no point of a range is further than a few of N even steps from a rig."""
    u = np.sort(places(PRIOR.draw(N, seed), name))
    assert np.max(np.diff(u, prepend=0.0, append=1.0)) < 10 / len(u)
    even = (np.arange(len(u)) + 0.5) / len(u)
    assert np.max(np.abs(u - even)) < 1.36 / np.sqrt(len(u))  # Kolmogorov's 5 % of plain random draws


def test_parameters_vary_independently():
    rigs = PRIOR.draw(N, 1)
    assert abs(np.corrcoef(np.log(rigs.k_b), np.log(rigs.shaft_damping_ratio))[0, 1]) < 0.05
    damped = rigs.bearing_damping > 0
    assert abs(np.corrcoef(np.log(rigs.k_b[damped]), np.log(rigs.bearing_damping[damped]))[0, 1]) < 0.1


def test_the_stated_share_of_the_bearings_has_no_damping():
    undamped = PRIOR.draw(N, 1).bearing_damping == 0
    assert np.mean(undamped) == pytest.approx(PRIOR.undamped_share, abs=0.02)
    assert Prior(undamped_share=0.0).draw(N, 1).bearing_damping.min() > 0
    assert not Prior(undamped_share=1.0).draw(N, 1).bearing_damping.any()


def test_another_range_of_k_b_changes_k_b_alone():
    wide, narrow = PRIOR.draw(N, 1), PRIOR.draw(N, 1, k_b=PRIOR.k_b)
    assert PRIOR.k_b[0] <= narrow.k_b.min() < 1.02 * PRIOR.k_b[0]
    assert PRIOR.k_b[1] / 1.02 < narrow.k_b.max() <= PRIOR.k_b[1]
    assert_array_equal(wide.shaft_damping_ratio, narrow.shaft_damping_ratio)
    assert_array_equal(wide.bearing_damping, narrow.bearing_damping)


def test_training_reaches_beyond_what_is_answered_for():
    assert PRIOR.k_b_trained[0] < PRIOR.k_b[0] < PRIOR.k_b[1] < PRIOR.k_b_trained[1]


# -- another rotor ---------------------------------------------------------------------------------


def loss_factors(structure: Structure, prior: Prior) -> np.ndarray:
    """c omega_2 / k_b at either end of the prior."""
    omega_2 = undamped_modes(build_system(structure, Condition(rigid_support=True))).omega[2]
    return np.array(prior.bearing_damping) * omega_2 / np.array(prior.k_b)


def test_the_prior_of_the_shipped_rotor_is_the_shipped_prior():
    for own, shipped in zip(astuple(prior_for(paper_structure(), 1e7)), astuple(PRIOR), strict=True):
        assert_allclose(own, shipped, rtol=1e-3)  # f2 = 323.99 Hz, rounded to 324


@pytest.mark.parametrize("factor", [1e-2, 30.0])
def test_a_rotor_scaled_as_a_whole_has_the_prior_scaled_with_it(factor):
    """All stiffnesses by a factor: frequencies by its root, k_b by the factor, loss factors as they were."""
    structure = paper_structure()
    scaled = Structure(**{**vars(structure), "K": factor * structure.K})
    prior = prior_for(scaled, factor * 1e7)
    assert_allclose(prior.k_b, factor * np.array(PRIOR.k_b))
    assert_allclose(prior.k_b_trained, factor * np.array(PRIOR.k_b_trained))
    assert_allclose(loss_factors(scaled, prior), loss_factors(structure, PRIOR), rtol=1e-3)
    assert prior.shaft_damping_ratio == PRIOR.shaft_damping_ratio


def test_a_prior_stays_within_the_limits_of_the_rig():
    prior = prior_for(paper_structure(), 1e7, (2e6, 1.2e8))
    assert (prior.k_b, prior.k_b_trained) == ((2e6, PRIOR.k_b[1]), (2e6, 1.2e8))
    assert prior.bearing_damping == prior_for(paper_structure(), 1e7).bearing_damping
