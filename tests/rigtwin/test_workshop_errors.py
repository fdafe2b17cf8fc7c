"""What is usually off in a rig, against rigs that are off."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rigtwin
from rigtwin.api.workshop_errors import as_the_workshop_knows, shift_errors, workshop_error
from rigtwin.estimator.features import Features
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.gap.model.workshop import Workshop
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.sim.campaign import Campaign, NominalBelief, PeakList

RIG, K_B = rigtwin.load_rig("nit-rourkela"), 3e6
FINDER = StiffnessFinder(assemble(RIG))


def features(shifts) -> Features:
    """Shifts as measured, which weigh alike relative to their size."""
    (first, second), ratio = shifts, 1.2
    return Features(first, second, ratio, 1e-3 * first, 1e-3 * second, 0.01)


def test_it_is_the_spread_of_k_b_over_rigs_from_a_workshop():
    belief = NominalBelief()
    workshop, rng = Workshop(RIG, belief, 1, 1), np.random.default_rng(1)
    drawn = StiffnessFinder(workshop.structure(np.zeros(len(workshop.std))))
    found = []
    for _ in range(60):
        made = StiffnessFinder(workshop.structure(workshop.std * rng.standard_normal(len(workshop.std))))
        found.append(math.log(drawn.fused(features(made.shifts(K_B))) / K_B))
    # The standard deviation of 60 draws is within 3 x 9 %.
    assert workshop_error(RIG, features(FINDER.shifts(K_B)), K_B) == pytest.approx(np.std(found), rel=0.27)


def test_a_rig_that_is_known_exactly_adds_nothing():
    exact = NominalBelief(modulus_tolerance=0.0, span_tolerance=0.0, disk_mass_tolerance=0.0)
    assert workshop_error(RIG, features(FINDER.shifts(K_B)), K_B, exact) == 0.0


def test_valid_estimates_by_shifts_come_with_it():
    shifts = features(FINDER.shifts(K_B))
    numbers = dict(
        zip(("delta_f1", "delta_f2", "amplitude_ratio"), (shifts.delta_f1, shifts.delta_f2, 1.2), strict=True)
    )
    found = rigtwin.estimate(**numbers, delta_f1_std=0.01, delta_f2_std=0.03, amplitude_ratio_std=0.01).best
    assert found.estimate.valid
    assert 0.005 < found.workshop_error < 0.05
    assert found.record()["workshop_error_of_ln_k_b"] == found.workshop_error
    invalid = rigtwin.estimate(
        **(numbers | {"delta_f2": 60.0}), delta_f1_std=0.01, delta_f2_std=0.03, amplitude_ratio_std=0.01
    )
    assert "workshop_error_of_ln_k_b" not in invalid.best.record()


@pytest.mark.parametrize("stds", [(0.0, 0.0), (0.0, 0.03), (0.01, 0.0)])
def test_shifts_without_an_error_weigh_as_exact_ones(stds):
    first, second = FINDER.shifts(K_B)
    exact = workshop_error(RIG, Features(first, second, 1.2, *stds, 0.01), K_B)
    tiny = Features(first, second, 1.2, *(max(std, 1e-7) for std in stds), 0.01)
    assert exact == pytest.approx(workshop_error(RIG, tiny, K_B), rel=0.3)


def by_model(asked: Features):
    """What root finding on the rig as drawn says."""
    return FINDER.estimate(asked), FINDER.objections(asked)


def measured(made: StiffnessFinder, drift, belief: NominalBelief) -> Features:
    """Shifts of a rig whose four resonances have drifted, known exactly as such."""
    rigid = made.rigid
    bearing = rigid - made.shifts(K_B)
    first, second = rigid * (1 + drift[0]) - bearing * (1 + drift[1])
    return Features(first, second, np.nan, 1e-6, 1e-6, np.nan)


@pytest.mark.parametrize(
    "belief",
    [
        NominalBelief(frequency_drift=0.0),
        NominalBelief(frequency_drift=5e-4, modulus_tolerance=0.0, span_tolerance=0.0, disk_mass_tolerance=0.0),
    ],
    ids=["tolerances", "drifts"],
)
def test_intervals_hold_the_rigs_of_a_workshop_as_often_as_they_say(belief):
    workshop, rng = Workshop(RIG, belief, 1, 1), np.random.default_rng(2)
    held, valid, n = 0, 0, 80
    for _ in range(n):
        made = StiffnessFinder(workshop.structure(workshop.std * rng.standard_normal(len(workshop.std))))
        drift = belief.expected_drift * rng.standard_normal((2, 2))
        found, against = as_the_workshop_knows(by_model, RIG, belief, measured(made, drift, belief))
        held += found.k_b_low <= K_B <= found.k_b_high
        valid += not against
    # 90 % of 80, within three standard deviations of the binomial distribution.
    assert 64 <= held <= 80 - 1
    assert valid == n


def test_a_common_error_of_both_shifts_is_counted_once():
    belief = NominalBelief(span_tolerance=0.0, disk_mass_tolerance=0.0, frequency_drift=0.0)
    errors = shift_errors(RIG, K_B, belief)
    ((first, second),) = errors.tolerances / errors.slope
    assert first == pytest.approx(second, rel=0.1)  # a stiffer shaft is as much stiffer by either shift
    found, _ = as_the_workshop_knows(by_model, RIG, belief, measured(FINDER, np.zeros((2, 2)), belief))
    assert found.k_b_std / found.k_b == pytest.approx(abs(first), rel=0.1)  # not less by the square root of two


def test_a_campaign_of_resonances_says_how_well_its_rig_is_known():
    rigid, bearing = FINDER.rigid, FINDER.rigid - FINDER.shifts(K_B)
    lists = tuple(PeakList(kind, f, np.full(2, 1e-3)) for kind, f in (("rigid", rigid), ("bearing", bearing)))
    exact = NominalBelief(0, 0, modulus_tolerance=0.0, span_tolerance=0.0, disk_mass_tolerance=0.0, frequency_drift=0.0)
    widths = []
    for belief in (exact, NominalBelief()):
        found = rigtwin.estimate(Campaign("lists", RIG.name, peaks=lists, nominal=belief), amplitude_ratio=1.2).best
        assert found.estimate.valid
        assert "workshop_error_of_ln_k_b" not in found.record()  # the interval holds it
        widths.append(found.estimate.k_b_std / found.estimate.k_b)
    assert widths[0] < 2e-3
    assert widths[1] == pytest.approx(workshop_error(RIG, features(FINDER.shifts(K_B)), K_B), rel=0.3)
