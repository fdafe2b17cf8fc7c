"""The network's arithmetic, with straight lines in place of learned curves: every output is known by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.estimator.intervals import BETWEEN_CODES
from rigtwin.estimator.network import K_REF, Curve, Limits, StiffnessNetwork

LIMITS = Limits(k_b=(1e6, 1e8), shift_min=(0.2, 1.0), shift_max=(80.0, 500.0), ratio=(0.2, 5.0))

# log k_b = OFFSETS_i - log delta_f_i + RATIO_SLOPES_i log ratio
OFFSETS, RATIO_SLOPES = (np.log(4e7), np.log(2.4e8)), (0.1, -0.05)
FLOORS = (1e-3, 3e-3)
QUANTILE, GATE, RATIO_FLOOR = 1.8, 3.5, 0.01
LARGEST_RATIO = 2.0


def straight(weights: list[float], bias: float) -> Curve:
    """A curve that is a plane."""
    curve = Curve(torch.zeros(len(weights)), torch.ones(len(weights))).double()
    with torch.no_grad():
        for parameter in curve.body.parameters():
            parameter.zero_()
        curve.skip.weight.copy_(torch.tensor([weights]))
        curve.skip.bias.fill_(bias)
    return curve


@pytest.fixture
def network() -> StiffnessNetwork:
    """Two straight curves; undamped bearings of any k_b give a ratio of LARGEST_RATIO."""
    curves = tuple(
        straight([-1.0, slope], offset - np.log(K_REF)) for slope, offset in zip(RATIO_SLOPES, OFFSETS, strict=True)
    )
    own_errors = tuple(straight([0.0, 0.0], np.log(floor)) for floor in FLOORS)
    bound = straight([0.0], np.log(LARGEST_RATIO))
    made = StiffnessNetwork(curves, own_errors, bound, LIMITS).double()  # pyright: ignore[reportArgumentType]
    made.floor.copy_(torch.tensor(FLOORS))
    made.quantile.fill_(QUANTILE)
    made.contradiction.fill_(GATE)
    made.ratio_floor.fill_(RATIO_FLOOR)
    return made.double()


def ask(network: StiffnessNetwork, *rows: list[float]) -> np.ndarray:
    """(n, 5) outputs."""
    with torch.no_grad():
        return network(torch.tensor(rows, dtype=torch.float64)).numpy()


def features(
    k_1: float, k_2: float, ratio: float = 1.0, relative: tuple[float, float, float] = (1e-2, 1e-2, 1e-2)
) -> list[float]:
    """Features whose two shifts say k_1 and k_2."""
    logs = [o - np.log(k) + s * np.log(ratio) for o, k, s in zip(OFFSETS, (k_1, k_2), RATIO_SLOPES, strict=True)]
    values = [*np.exp(logs), ratio]
    return [float(v) for v in (*values, *(r * v for r, v in zip(relative, values, strict=True)))]


def variances(relative: tuple[float, float, float]) -> np.ndarray:
    """(2,) of each curve's answer in log k_b."""
    of_ratio = np.array(RATIO_SLOPES) * relative[2]
    return np.array(relative[:2]) ** 2 + of_ratio**2 + np.array(FLOORS) ** 2


RELATIVE = [(1e-2, 1e-2, 1e-2), (1e-3, 0.1, 0.05), (0.2, 1e-4, 0.0), (0.0, 0.0, 0.0)]


@pytest.mark.parametrize("relative", RELATIVE)
def test_answers_are_averaged_by_the_inverse_of_their_variances(network, relative):
    k_1, k_2 = 1.00e7, 1.01e7
    k, std, *_ = ask(network, features(k_1, k_2, 1.3, relative))[0]
    weights = 1 / np.maximum(variances(relative), 1e-12)
    assert_allclose(np.log(k), np.average(np.log([k_1, k_2]), weights=weights), rtol=1e-7)
    assert_allclose(std / k, np.hypot(weights.sum() ** -0.5, BETWEEN_CODES), rtol=1e-6)


@pytest.mark.parametrize("relative", RELATIVE)
def test_the_interval_lies_round_the_estimate_evenly_in_the_logarithm(network, relative):
    k, std, low, high, _ = ask(network, features(1e7, 1e7, 1.0, relative))[0]
    assert 0 < low < k < high
    assert_allclose(np.log([high / k, k / low]), QUANTILE * std / k, rtol=1e-6)


def test_a_curves_own_error_depends_on_the_place(network):
    network.own_error1 = network.own_error2 = straight([1.0, 0.0], np.log(1e-3))
    few = (1e-6, 1e-6, 1e-6)
    (k, std, *_), (k_there, std_there, *_) = ask(network, features(1e7, 1e7, 1.0, few), features(2e6, 2e6, 1.0, few))
    own, own_there = (np.sqrt((s / v) ** 2 - BETWEEN_CODES**2) for s, v in ((std, k), (std_there, k_there)))
    assert own_there == pytest.approx(5.0 * own, rel=1e-3)  # as the shifts are five times as large


def test_wider_errors_give_wider_intervals(network):
    widths = [
        np.diff(ask(network, features(1e7, 1e7, 1.0, (r, r, r)))[0, 2:4])[0] for r in np.geomspace(1e-6, 0.29, 20)
    ]
    assert np.all(np.diff(widths) > 0)


def test_without_errors_the_curves_own_remain_and_what_codes_differ_by(network):
    k, std, *_ = ask(network, features(1e7, 1e7, 1.0, (0.0, 0.0, 0.0)))[0]
    assert_allclose(std / k, np.hypot((np.array(FLOORS) ** -2.0).sum() ** -0.5, BETWEEN_CODES), rtol=1e-6)


def test_a_row_does_not_depend_on_the_rows_beside_it(network):
    rows = [features(k, 1.01 * k, 1.1, (1e-2, 2e-2, 0.1)) for k in (2e6, 1e7, 7e7)]
    alone = np.vstack([ask(network, row) for row in rows])
    assert_allclose(ask(network, *rows), alone, rtol=1e-12)
    assert_array_equal(ask(network, *rows[::-1])[::-1, 4], alone[:, 4])


# -- what is not valid -----------------------------------------------------------------------------


@pytest.mark.parametrize("relative", [(1e-2, 1e-2, 1e-2), (0.05, 1e-3, 0.0)])
def test_answers_further_apart_than_the_gate_contradict_each_other(network, relative):
    gate = GATE * np.sqrt(variances(relative).sum() + 2 * BETWEEN_CODES**2)
    for sign in (1, -1):
        near, far = (features(1e7 * np.exp(sign * part * gate), 1e7, 1.0, relative) for part in (0.98, 1.02))
        assert ask(network, near, far)[:, 4].tolist() == [1, 0]


def test_a_ratio_that_no_bearing_gives_is_not_valid(network):
    """Within the gate times the errors of the ratio, of the bound and of log k_b."""
    relative = (1e-2, 1e-2, 1e-3)
    sigma = np.sqrt(relative[2] ** 2 + RATIO_FLOOR**2 + 1 / (1 / variances(relative)).sum())
    near, far = (features(1e7, 1e7, LARGEST_RATIO * np.exp(part * GATE * sigma), relative) for part in (0.98, 1.02))
    assert ask(network, near, far)[:, 4].tolist() == [1, 0]


@pytest.mark.parametrize(("end", "outwards"), [(1e6, -1), (1e8, 1)])
def test_the_ends_of_the_range_belong_to_it_to_within_the_curves_own_error(network, end, outwards):
    slack = 2 * max(FLOORS)
    near, far = (features(*[end * np.exp(outwards * part * slack)] * 2) for part in (0.9, 1.1))
    assert ask(network, near, far)[:, 4].tolist() == [1, 0]


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("wrong", [0.0, -1.0, 1e30, float("nan"), float("inf"), float("-inf")])
def test_values_outside_the_trained_range_are_not_valid(network, place, wrong):
    row = features(1e7, 1e7)
    row[place] = wrong
    assert ask(network, row)[0, 4] == 0


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("relative", [-1e-6, 0.31, float("nan"), float("inf")])
def test_errors_that_are_none_or_too_large_are_not_valid(network, place, relative):
    row = features(1e7, 1e7)
    row[3 + place] = relative * row[place]
    assert ask(network, row)[0, 4] == 0


@pytest.mark.parametrize("place", [0, 1, 2])
def test_errors_of_just_under_a_third_are_taken(network, place):
    row = features(1e7, 1e7)
    row[3 + place] = 0.299 * row[place]
    assert ask(network, row)[0, 4] == 1


def test_outputs_stay_finite_for_any_finite_input(network):
    rows = [features(1e7, 1e7) for _ in range(9)]
    for row, (place, wrong) in zip(rows, [(p, w) for p in range(3) for w in (0.0, -1e9, 1e9)], strict=True):
        row[place] = wrong
    assert np.isfinite(ask(network, *rows)).all()


# -- curves ----------------------------------------------------------------------------------------


def test_a_curve_sees_its_inputs_normalised():
    torch.manual_seed(0)
    curve = Curve(torch.tensor([1.0, -2.0]), torch.tensor([0.5, 3.0])).double()
    plain = Curve(torch.zeros(2), torch.ones(2)).double()
    plain.load_state_dict({**curve.state_dict(), "mean": torch.zeros(2), "scale": torch.ones(2)})
    z = torch.randn(7, 2, dtype=torch.float64)
    with torch.no_grad():
        assert_allclose(curve(z * curve.scale + curve.mean), plain(z), rtol=1e-12)


def test_errors_enter_by_the_curves_own_slopes(network):
    """A bent curve: the error of log k_b is slope times relative error, by automatic differentiation."""
    torch.manual_seed(1)
    bent = Curve(torch.zeros(2), torch.ones(2)).double()
    network.curve1 = network.curve2 = bent
    network.own_error1 = network.own_error2 = straight([0.0, 0.0], -16.0)
    relative = (0.02, 0.02, 0.05)
    row = features(1e7, 1e7, 1.2, relative)
    std = []
    for shift in row[:2]:
        x = torch.tensor([[np.log(shift), np.log(row[2])]], requires_grad=True)
        (slopes,) = torch.autograd.grad(bent(x).sum(), x)
        std.append(np.hypot(*(slopes[0].numpy() * [relative[0], relative[2]])))
    k, k_std, *_ = ask(network, row)[0]
    # The slopes are differences over 1 % steps.
    assert_allclose(k_std / k, (np.array(std) ** -2.0).sum() ** -0.5, rtol=1e-3)
