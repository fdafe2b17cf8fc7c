"""Features of a test: the model's own numbers come out, with honest errors, and a muddled test is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from rigtwin.estimator.features import FEATURE_NAMES, Features, features_of_peaks, features_of_runs
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.campaign import Channel, MeasurementError, PeakList, Quantity, Run, SupportKind
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep
from tests.rotor.rigs import paper_structure
from tests.tolerances import LIGHT_DAMPING

DAMPING = {"bearing_damping": 10.0, "shaft_damping_ratio": 1e-3}
ORDER = {"receptance": 2, "mobility": 1, "accelerance": 0, "acceleration": 0}

# A modal fit takes the neighbouring modes' tails for straight lines: at 0.1 % shaft damping that
# leaves a few 1e-6 of the damping ratio, see the tests of the fit.
MODAL_FIT = 1e-5

# A statistic with a fixed seed is rejected where its null distribution gives it less than this.
REJECTED = 1e-3
SEEDS = 100


def exact_run(
    support: SupportKind, k_b: float = 2e6, nodes: tuple[int, ...] = (2, 4), quantity: Quantity = "accelerance"
):
    """The direct response of the paper's rotor on the lines of a refined sweep."""
    system = build_system(paper_structure(), Condition(k_b, support == "rigid", **DAMPING))
    modes = damped_modes(system)
    near = np.concatenate([np.arange(-4, 5) / 8, [-8, -4, -2, -1, 1, 2, 4, 8]])
    first_two = zip(modes.frequency_hz[[0, 2]], modes.damping_ratio[[0, 2]], strict=True)
    f = np.unique(np.concatenate([np.linspace(20, 400, 96), *(f * (1 + 2 * zeta * near) for f, zeta in first_two)]))
    A = accelerance(system, f)[:, [n - 1 for n in nodes], 0]
    H = A / (2j * np.pi * f[:, None]) ** ORDER[quantity]
    return Run(f, H, tuple(map(Channel, nodes)), support, quantity=quantity, name=support)


def true_features(k_b: float) -> np.ndarray:
    """(3,) shifts and amplitude ratio by the eigenvalues of the same matrices."""
    finder = StiffnessFinder(paper_structure(), Condition(**DAMPING))
    return np.array([*finder.shifts(k_b), finder.amplitude_ratio(k_b, DAMPING["bearing_damping"])])


@pytest.mark.parametrize("k_b", [1e6, 1e7, 1e8])
def test_features_measured_through_the_fmu_are_those_of_the_eigenvalues(rotor_fmu, k_b):
    parameters, plan = {"k_b": k_b, **DAMPING}, SweepPlan(n_lines=96)
    with FmuSession(rotor_fmu) as session:
        rigid, bearing = (sweep(session, Rig(kind, parameters=parameters), plan).run for kind in ("rigid", "bearing"))
    assert_allclose(features_of_runs(rigid, bearing).as_array()[:3], true_features(k_b), rtol=MODAL_FIT)


@pytest.mark.parametrize("k_b", [1e6, 1e7, 1e8])
def test_features_of_exact_runs_are_those_of_the_eigenvalues(k_b):
    features = features_of_runs(exact_run("rigid"), exact_run("bearing", k_b))
    assert_allclose(features.as_array()[:3], true_features(k_b), rtol=MODAL_FIT)


def test_softer_bearings_lower_both_resonances():
    """Shifts are rigid minus bearing support, and grow as k_b falls."""
    soft, stiff = (features_of_runs(exact_run("rigid"), exact_run("bearing", k)) for k in (1e6, 1e8))
    assert soft.delta_f1 > stiff.delta_f1 > 0
    assert soft.delta_f2 > stiff.delta_f2 > 0


def test_the_ratio_is_that_of_the_resonance_peaks_bearing_over_rigid():
    runs = exact_run("rigid"), exact_run("bearing")
    A0, A1 = (np.abs(run.channel(2)[run.frequency_hz < 150]).max() for run in runs)
    assert A1 / A0 > 1.2
    assert_allclose(features_of_runs(*runs).amplitude_ratio, A1 / A0, rtol=LIGHT_DAMPING)


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "acceleration"])
def test_the_ratio_is_that_of_accelerations_whatever_was_measured(quantity):
    features = features_of_runs(exact_run("rigid", quantity=quantity), exact_run("bearing", quantity=quantity))
    expected = features_of_runs(exact_run("rigid"), exact_run("bearing"))
    assert_allclose(features.as_array()[:3], expected.as_array()[:3], rtol=MODAL_FIT)


def test_runs_of_two_quantities_can_be_compared():
    features = features_of_runs(exact_run("rigid", quantity="receptance"), exact_run("bearing"))
    assert_allclose(features.as_array()[:3], true_features(2e6), rtol=MODAL_FIT)


def test_the_driving_point_counts_and_not_the_channel_that_moves_most():
    both = features_of_runs(exact_run("rigid"), exact_run("bearing"))
    alone = features_of_runs(exact_run("rigid", nodes=(4, 2)), exact_run("bearing", nodes=(2,)))
    assert_allclose(alone.amplitude_ratio, both.amplitude_ratio, rtol=MODAL_FIT)


@pytest.mark.parametrize("relative", [1e-3, 0.02])
def test_errors_are_as_large_as_stated(relative):
    """z-scores of noisy runs are standard normal: unit variance and 90 % coverage over the seeds."""

    def noisy(run: Run, rng: np.random.Generator) -> Run:
        std = relative * np.abs(run.H)
        errors = rng.standard_normal(run.H.shape) + 1j * rng.standard_normal(run.H.shape)
        return replace(run, H=run.H + std * errors / np.sqrt(2), std=std)

    rigid, bearing, truth = exact_run("rigid", nodes=(2,)), exact_run("bearing", nodes=(2,)), true_features(2e6)
    z = np.empty((SEEDS, 3))
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        features = features_of_runs(noisy(rigid, rng), noisy(bearing, rng)).as_array()
        z[seed] = (features[:3] - truth) / features[3:]
    low, high = stats.chi2(SEEDS).ppf([REJECTED / 2, 1 - REJECTED / 2])
    assert np.all((low < (z**2).sum(axis=0)) & ((z**2).sum(axis=0) < high))
    for covered in np.count_nonzero(np.abs(z) < stats.norm.ppf(0.95), axis=0):
        assert stats.binomtest(int(covered), SEEDS, 0.9).pvalue > REJECTED


def test_as_array_has_the_order_of_the_names():
    features = Features(**{name: float(place) for place, name in enumerate(FEATURE_NAMES)})
    assert features.as_array().tolist() == [0, 1, 2, 3, 4, 5]


# -- refusals --------------------------------------------------------------------------------------


def test_exchanged_runs_are_named_as_such():
    first, second = replace(exact_run("bearing"), support="rigid", name="a"), replace(exact_run("rigid"), name="b")
    with pytest.raises(MeasurementError, match=r"^a resonates at .* Hz, b at .* the two seem to be exchanged"):
        features_of_runs(first, replace(second, support="bearing"))


@pytest.mark.parametrize("kinds", [("bearing", "rigid"), ("rigid", "rigid"), ("bearing", "bearing")])
def test_mixed_up_supports_are_refused(kinds):
    runs = [exact_run(kind) for kind in kinds]
    lists = [PeakList(kind, np.array([95.0, 320.0]), np.ones(2)) for kind in kinds]
    for found in (lambda: features_of_runs(*runs), lambda: features_of_peaks(*lists, 0.8, 0.05)):
        with pytest.raises(MeasurementError) as refused:
            found()
        assert str(refused.value).startswith("need a rigid and a bearing ")
        assert str(refused.value).endswith(f"got '{kinds[0]}' and '{kinds[1]}'")


@pytest.mark.parametrize("elsewhere", [{"excitation_node": 4}, {"excitation_plane": "z"}])
def test_runs_driven_at_different_places_are_refused(elsewhere):
    with pytest.raises(MeasurementError, match="driven at different places: their amplitudes cannot be compared"):
        features_of_runs(exact_run("rigid"), replace(exact_run("bearing"), **elsewhere))


def test_a_driving_point_that_was_not_measured_is_named():
    with pytest.raises(MeasurementError, match=r"^run 'bearing' has no channel node2; it has node3, node4$"):
        features_of_runs(exact_run("rigid"), exact_run("bearing", nodes=(3, 4)))


def test_a_run_with_one_resonance_is_refused():
    bearing = exact_run("bearing")
    lower = bearing.frequency_hz < 150
    narrow = replace(bearing, frequency_hz=bearing.frequency_hz[lower], H=bearing.H[lower])
    with pytest.raises(MeasurementError, match=r"^run 'bearing' shows 1 resonances between 20 and .* 2 are needed"):
        features_of_runs(exact_run("rigid"), narrow)


def test_a_driving_point_that_stands_still_has_no_ratio():
    rigid = exact_run("rigid", nodes=(2, 3))
    still = replace(rigid, H=rigid.H * [0, 1])
    with pytest.raises(MeasurementError, match="node 2 does not move in mode 1 on rigid supports"):
        features_of_runs(still, exact_run("bearing"))


# -- resonance lists -------------------------------------------------------------------------------


def test_a_dead_accelerometer_on_bearings_has_no_ratio():
    rigid, bearing = (exact_run(support, nodes=(2, 3)) for support in ("rigid", "bearing"))
    dead = replace(bearing, H=bearing.H * [0, 1])
    with pytest.raises(MeasurementError, match="does not move in mode 1 on bearings"):
        features_of_runs(rigid, dead)


def test_accelerations_compare_at_one_force_only():
    rigid, bearing = (exact_run(support, quantity="acceleration") for support in ("rigid", "bearing"))
    features_of_runs(rigid, bearing)
    with pytest.raises(MeasurementError, match="same quantity and force_amplitude_N"):
        features_of_runs(rigid, replace(bearing, force_amplitude_N=2.0))


def test_lists_of_resonances_give_the_shifts_and_their_errors():
    """The paper's measured peaks; further peaks do not count."""
    rigid = PeakList("rigid", np.array([95.0, 320.0]), np.array([1.5, 3.0]))
    bearing = PeakList("bearing", np.array([70.0, 190.0, 250.0]), np.array([2.0, 4.0, 9.0]))
    assert features_of_peaks(rigid, bearing, 0.78, 0.05) == Features(25.0, 130.0, 0.78, 2.5, 5.0, 0.05)


@pytest.mark.parametrize("short", ["rigid", "bearing"])
def test_a_list_with_one_resonance_is_refused(short):
    lists = {kind: PeakList(kind, np.array([70.0, 190.0]), np.ones(2)) for kind in ("rigid", "bearing")}
    lists[short] = PeakList(short, np.array([70.0]), np.ones(1))
    with pytest.raises(MeasurementError, match="two resonances on each support are needed"):
        features_of_peaks(lists["rigid"], lists["bearing"], 0.8, 0.05)
