"""The shipped network: accurate on the model, honest about its errors, and silent where it knows nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.estimator.intervals import BETWEEN_CODES
from rigtwin.estimator.prior import PRIOR, Rigs
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.estimator.runtime import Estimate, StiffnessEstimator, shipped_model
from rigtwin.rotor.model.condition import Condition
from tests.rotor.rigs import PAPER, paper_structure

# The project's bars on noise-free rigs; the network is a hundred times better.
MEDIAN_BAR, NINETY_FIFTH_BAR = 0.005, 0.02
REACHED_MEDIAN, REACHED_NINETY_FIFTH = 1e-4, 2e-4

# Repetitions of every rig in the tests of the interval.
DRAWS = 40

# Relative errors of features that a good test reaches; contradictions are then known for sure.
GOOD_TEST = (0.0, 1e-6, 1e-4, 1e-3, 1e-2)


def clean_features(rigs: Rigs) -> np.ndarray:
    """(n, 3) shifts and amplitude ratio by the eigenvalues of the rotor's own matrices."""
    rows = []
    for k_b, zeta, damping in zip(rigs.k_b, rigs.shaft_damping_ratio, rigs.bearing_damping, strict=True):
        finder = StiffnessFinder(paper_structure(), Condition(bearing_damping=damping, shaft_damping_ratio=zeta))
        rows.append([*finder.shifts(k_b), finder.amplitude_ratio(k_b, damping)])
    return np.array(rows)


def with_relative_errors(values: np.ndarray, relative: float | np.ndarray) -> np.ndarray:
    """(n, 6) features that state these errors, the values as they are."""
    return np.hstack([values, relative * np.abs(values)])


def noisy(values: np.ndarray, relative: float | np.ndarray, seed: int) -> np.ndarray:
    """(n, 6) features with errors drawn as they are stated."""
    errors = relative * values * np.random.default_rng(seed).standard_normal(values.shape)
    return np.hstack([values + errors, np.broadcast_to(relative * values, values.shape)])


def with_second_shift_of(rigs: Rigs, clean: np.ndarray, factor: float) -> np.ndarray:
    """(n / 2, 3) features of every other rig, with the second shift of a bearing stiffer by a factor."""
    half = Rigs(factor * rigs.k_b[::2], rigs.shaft_damping_ratio[::2], rigs.bearing_damping[::2])
    return np.column_stack([clean[::2, 0], clean_features(half)[:, 1], clean[::2, 2]])


@pytest.fixture(scope="module")
def estimator() -> StiffnessEstimator:
    return StiffnessEstimator()


@pytest.fixture(scope="module")
def rigs() -> Rigs:
    """200 rigs of the range that is answered for; neither training nor calibration saw them."""
    return PRIOR.draw(200, seed=99, k_b=PRIOR.k_b)


@pytest.fixture(scope="module")
def clean(rigs) -> np.ndarray:
    return clean_features(rigs)


# -- accuracy --------------------------------------------------------------------------------------


def test_k_b_of_rigs_it_has_never_seen(estimator, rigs, clean):
    out = estimator(with_relative_errors(clean, 1e-6))
    error = np.abs(out[:, 0] / rigs.k_b - 1)
    assert np.median(error) < REACHED_MEDIAN < MEDIAN_BAR
    assert np.quantile(error, 0.95) < REACHED_NINETY_FIFTH < NINETY_FIFTH_BAR


@pytest.mark.parametrize("relative", GOOD_TEST)
def test_rigs_in_range_are_valid(estimator, clean, relative):
    assert np.mean(estimator(with_relative_errors(clean, relative))[:, 4]) >= 0.99


@pytest.mark.parametrize("relative", [1e-4, 1e-3, 1e-2])
def test_noisy_tests_of_rigs_in_range_are_valid(estimator, clean, relative):
    assert np.mean(estimator(noisy(np.tile(clean, (DRAWS, 1)), relative, seed=1))[:, 4]) >= 0.99


def test_the_papers_measurement_is_valid_and_gives_a_little_less_than_the_paper_says(estimator):
    """25 and 130 Hz of shift and an amplitude ratio of 0.78, read off printed figures; the paper says 1.3e6 N/m."""
    measured = [*PAPER["rig"]["frequency_shifts_Hz"], PAPER["rig"]["amplitude_ratio_A1_over_A0"]]
    estimate = estimator.estimate(np.array([*measured, 2.1, 4.2, 0.05]))
    assert estimate.valid
    assert 1.0e6 < estimate.k_b < 1.25e6
    assert estimate.k_b_low < estimate.k_b < estimate.k_b_high < PAPER["rig"]["estimated_k_b"]


# -- the interval ----------------------------------------------------------------------------------


@pytest.mark.parametrize("relative", [1e-4, 1e-3, 1e-2, 5e-2])
def test_the_90_per_cent_interval_covers_at_every_size_of_error(estimator, rigs, clean, relative):
    """Of rigs that another code makes, whose k_b is another one by as much as codes differ."""
    out = estimator(noisy(np.tile(clean, (DRAWS, 1)), relative, seed=2))
    other = np.exp(BETWEEN_CODES * np.random.default_rng(9).standard_normal(len(out)))
    truth = np.tile(rigs.k_b, DRAWS) * other
    assert 0.85 < np.mean((out[:, 2] <= truth) & (truth <= out[:, 3])) < 0.95


def test_the_90_per_cent_interval_covers_when_every_feature_has_an_error_of_its_own(estimator, rigs, clean):
    relative = 10 ** np.random.default_rng(3).uniform(-4, np.log10(0.05), (200 * DRAWS, 3))
    out = estimator(noisy(np.tile(clean, (DRAWS, 1)), relative, seed=4))
    truth = np.tile(rigs.k_b, DRAWS)
    valid = out[:, 4] > 0.5
    covers = (out[:, 2] <= truth) & (truth <= out[:, 3])
    assert 0.85 < np.mean(covers) < 0.95
    assert 0.85 < np.mean(covers[valid]) < 0.95


def test_the_interval_covers_soft_and_stiff_bearings_alike(estimator, rigs, clean):
    """No part of the range pays for another."""
    out = estimator(noisy(np.tile(clean, (DRAWS, 1)), 0.01, seed=5))
    truth = np.tile(rigs.k_b, DRAWS)
    covers = (out[:, 2] <= truth) & (truth <= out[:, 3])
    for low, high in ((1e6, 4e6), (4e6, 2.5e7), (2.5e7, 1e8)):
        assert 0.85 < np.mean(covers[(truth >= low) & (truth < high)]) < 0.97


@pytest.mark.parametrize("feature", [0, 1, 2])
def test_a_wider_error_never_narrows_the_interval(estimator, clean, feature):
    widths = []
    for relative in np.geomspace(1e-5, 0.29, 10):
        errors = np.full(3, 1e-3)
        errors[feature] = relative
        out = estimator(with_relative_errors(clean, errors))
        widths.append(np.log(out[:, 3] / out[:, 2]))
    # float32 rounds the width to about 1e-5 of itself.
    assert np.all(np.diff(widths, axis=0) > -1e-3 * np.array(widths[:-1]))
    # The ratio says little of k_b, and nothing where its influence on a curve changes its sign.
    assert np.all(widths[-1] > (1 - 1e-3) * widths[0])
    assert np.mean(widths[-1] > 1.01 * widths[0]) > (0.5, 0.5, 0.2)[feature]


def test_wider_errors_all_round_give_wider_intervals(estimator, clean):
    widths = [
        np.log(np.divide(*estimator(with_relative_errors(clean, r))[:, [3, 2]].T)) for r in np.geomspace(1e-4, 0.29, 10)
    ]
    assert np.all(np.diff(widths, axis=0) > 0)


def test_the_estimate_lies_in_its_interval(estimator, clean):
    for relative in GOOD_TEST:
        k, std, low, high, _ = estimator(with_relative_errors(clean, relative)).T
        assert np.all((low < k) & (k < high) & (std > 0))


# -- what is not valid -----------------------------------------------------------------------------


@pytest.mark.parametrize("k_b", [(1e4, 3e5), (3e5, 0.97e6), (1.03e8, 3e8), (3e8, 1e12)], ids=str)
def test_bearings_outside_the_range_are_not_valid(estimator, k_b):
    outside = clean_features(PRIOR.draw(32, seed=7, k_b=k_b))
    for relative in GOOD_TEST:
        assert not estimator(with_relative_errors(outside, relative))[:, 4].any()


@pytest.mark.parametrize("feature", [0, 1, 2])
@pytest.mark.parametrize("wrong", [0.0, -1.0, 1e-30, 1e30, np.nan, np.inf, -np.inf])
def test_values_that_no_rotor_gives_are_not_valid(estimator, clean, feature, wrong):
    rows = with_relative_errors(clean, 1e-3)
    rows[:, feature] = wrong
    assert not estimator(rows)[:, 4].any()


@pytest.mark.parametrize("feature", [0, 1, 2])
@pytest.mark.parametrize("wrong", [-1e-3, 0.31, 10.0, np.nan, np.inf])
def test_errors_that_are_none_or_too_large_are_not_valid(estimator, clean, feature, wrong):
    rows = with_relative_errors(clean, 1e-3)
    rows[:, 3 + feature] = wrong * clean[:, feature]
    assert not estimator(rows)[:, 4].any()


@pytest.mark.parametrize("relative", GOOD_TEST)
def test_a_peak_higher_than_undamped_bearings_allow_is_not_valid(estimator, rigs, clean, relative):
    loud = clean[rigs.bearing_damping == 0] * [1, 1, 1.2]
    assert len(loud) > 30
    assert not estimator(with_relative_errors(loud, relative))[:, 4].any()


@pytest.mark.parametrize("factor", [1 / 1.5, 1.5, 5.0])
def test_shifts_of_two_different_bearings_contradict_each_other(estimator, rigs, clean, factor):
    mixed = with_second_shift_of(rigs, clean, factor)
    for relative in GOOD_TEST:
        assert not estimator(with_relative_errors(mixed, relative))[:, 4].any()


def test_a_contradiction_within_the_errors_is_none(estimator, rigs, clean):
    """Negative control: a tenth apart is nothing to a test that is good for five per cent."""
    mixed = with_second_shift_of(rigs, clean, 1.1)
    mixed = mixed[rigs.k_b[::2] < 0.9 * PRIOR.k_b[1]]
    assert np.mean(estimator(with_relative_errors(mixed, 0.05))[:, 4]) > 0.95


# -- asking ----------------------------------------------------------------------------------------


def test_one_test_is_asked_as_many_are(estimator, clean):
    rows = with_relative_errors(clean, 1e-3)
    one = estimator.estimate(rows[3])
    assert isinstance(one, Estimate)
    assert one.valid is True
    many = estimator(rows)
    assert_allclose([one.k_b, one.k_b_std, one.k_b_low, one.k_b_high], many[3, :4], rtol=1e-5)


def test_the_same_question_has_the_same_answer(estimator, clean):
    rows = with_relative_errors(clean, 1e-3)
    assert_array_equal(estimator(rows), StiffnessEstimator(shipped_model())(rows))


def test_a_damaged_network_is_refused_without_a_word_on_stdout(tmp_path, capfd):
    """onnxruntime tries again and says so, there where results go."""
    content = bytearray(shipped_model().read_bytes())
    content[content.index(b"features")] = 0xFF  # a name that is no text
    (tmp_path / "damaged.onnx").write_bytes(content)
    with pytest.raises(Exception, match="utf-8"):
        StiffnessEstimator(tmp_path / "damaged.onnx")
    assert capfd.readouterr().out == ""


def test_the_card_says_what_the_network_answers_for(estimator):
    limits = estimator.card["training_range"]
    assert tuple(limits["k_b"]) == PRIOR.k_b
    assert tuple(limits["shaft_damping_ratio"]) == PRIOR.shaft_damping_ratio
    assert tuple(limits["bearing_damping"]) == PRIOR.bearing_damping


def test_the_example_on_the_card_is_a_valid_test(estimator):
    assert estimator.estimate(np.array(list(estimator.card["example_inputs"].values()))).valid
