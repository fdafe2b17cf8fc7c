"""What a fit took for tolerances, gains and repeatabilities, beside what was known before."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.answer.calibration import calibration_of
from rigtwin.gap.document import Diagnosis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.workshop import Workshop
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import BearingStiffness, load_rig
from tests.gap.conftest import (
    BELIEF,
    CHANNELS,
    ELEMENTS,
    K_B,
    RIG,
    blank,
    condition,
    lines,
    problem_of,
    rebuilt,
    with_noise,
    workshop,
)

MODULUS = load_rig(RIG).segment[0].youngs_modulus_Pa
OF_A_WORKSHOP = replace(
    BELIEF, modulus_tolerance=0.01, shaft_damping_tolerance=0.7, frequency_drift=None, gain_repeatability=None
)
DRIFT, REMOUNTED = 3e-4, 3e-3


def measured(error, supports=("rigid", "bearing") * 2, seed=0):
    """Runs of a rotor whose modulus is off, each with drifts and gains of its own."""
    structure = assemble(rebuilt("modulus", error), elements_between_nodes=ELEMENTS)
    rng, runs = np.random.default_rng(seed), []
    for number, support in enumerate(supports):
        run = blank(support, lines(support), name=f"{support}{number}")
        f = run.frequency_hz / (1 + DRIFT * rng.standard_normal())
        H = measured_response(structure, condition(support), (), f, [channel.node for channel in CHANNELS])
        runs.append(with_noise(run, H * (1 + REMOUNTED * rng.standard_normal(len(CHANNELS))), seed + number))
    return runs


def calibrated(runs, belief=OF_A_WORKSHOP):
    """What the recalibrated nominal model took, and its fit."""
    problem = Problem(Forward(workshop(belief)), problem_of(*runs).observed)
    fit = recalibrate(problem)
    assert_allclose(fit.k_b, K_B, rtol=0.03)
    return calibration_of(problem, fit, 1.0), fit, problem


def by_name(numbers):
    return {each.name: each for each in numbers}


@pytest.mark.parametrize("error", [0.015, pytest.param(-0.02, marks=pytest.mark.long), 0.0])
def test_the_posterior_holds_the_true_modulus_and_is_narrower_than_the_prior(error):
    found, _, _ = calibrated(measured(error))
    modulus = by_name(found.numbers)["modulus"]
    assert modulus.prior.unit == modulus.posterior.unit == "Pa"
    assert_allclose([modulus.prior.value, modulus.prior.std], [MODULUS, 0.01 * MODULUS])
    assert abs(modulus.posterior.value - (1 + error) * MODULUS) < 3 * modulus.posterior.std
    assert modulus.posterior.std < modulus.prior.std / 2
    assert abs(modulus.posterior.value / MODULUS - 1) > abs(error) / 2


@pytest.mark.parametrize(
    ("low", "high", "end"),
    [(2 * K_B, 1e9, "min_N_per_m"), (1e5, K_B / 2, "max_N_per_m"), (2 * K_B, 2 * K_B, "start_N_per_m")],
)
def test_a_stated_end_of_the_range_of_k_b_is_not_passed(low, high, end):
    """The bearings are softer or stiffer than the rig file allows, or it allows one stiffness only."""
    rig = load_rig(RIG)
    stated = BearingStiffness(start_N_per_m=(low * high) ** 0.5, min_N_per_m=low, max_N_per_m=high)
    runs = measured(0.0, supports=("bearing",))
    own = Workshop(rig.model_copy(update={"k_b": stated}), OF_A_WORKSHOP, ELEMENTS, ELEMENTS)
    problem = Problem(Forward(own), problem_of(*runs).observed)
    assert_allclose(recalibrate(problem).k_b, getattr(stated, end), rtol=1e-9)


def test_a_range_that_is_the_default_says_nothing_of_k_b():
    """A scaled rig may have kept it."""
    own = workshop(OF_A_WORKSHOP)
    assert own.rig.k_b.min_N_per_m == BearingStiffness().min_N_per_m
    assert own.k_b == own.scale.k_b


def test_what_the_data_do_not_tell_stays_as_it_was_known():
    """Masses and lengths act as the modulus does, which is known far less."""
    found, _, _ = calibrated(measured(0.015))
    span = by_name(found.numbers)["span"]
    assert 0.5 * span.prior.std < span.posterior.std <= span.prior.std
    assert abs(span.posterior.value - span.prior.value) < 2 * span.prior.std


def test_every_number_is_named_with_its_unit():
    found, fit, problem = calibrated(measured(0.0))
    numbers = by_name(found.numbers)
    assert tuple(numbers) == problem.forward.workshop.names
    assert [each.words for each in found.numbers][:3] == [
        "modulus of the shaft", "length of the shaft", "mass of the disk at node 3"
    ]  # fmt: skip
    assert numbers["disk_mass_1"].prior.value == load_rig(RIG).disk[0].mass
    zeta = numbers["shaft_damping_ratio"]
    assert_allclose([zeta.prior.value, zeta.prior.std], [BELIEF.shaft_damping_ratio, 0.7 * BELIEF.shaft_damping_ratio])
    assert_allclose(zeta.posterior.value, zeta.prior.value * np.exp(found.tolerance["shaft_damping_ratio"]))
    gains = by_name(found.gains)
    assert len(gains) == len(CHANNELS) + len(problem.runs)
    assert_allclose(gains["sensor_gain.node4"].posterior.value, found.sensor_gain["node4"])
    assert_allclose(gains["run_gain.bearing1"].posterior.value, np.exp(fit.nu[problem.nuisances.gain][1]))
    assert gains["run_gain.bearing1"].prior.std == BELIEF.gain_tolerance


def test_a_repeatability_that_is_learned_comes_with_its_error():
    found, fit, problem = calibrated(measured(0.0))
    repeatability = by_name(found.repeatability)
    assert set(repeatability) == {"frequency_drift", "gain_repeatability"}
    for name, true in (("frequency_drift", DRIFT), ("gain_repeatability", REMOUNTED)):
        each = repeatability[name]
        assert each.learned
        assert abs(np.log(each.posterior.value / true)) < 3 * each.posterior.std / each.posterior.value
        assert each.posterior.std / each.posterior.value < 0.5 * each.prior.std / each.prior.value
    assert repeatability["frequency_drift"].posterior.value == fit.prior_std[problem.nuisances.drift[0].start]


def test_a_repeatability_that_is_stated_stands_beside_what_the_runs_say():
    stated = replace(OF_A_WORKSHOP, frequency_drift=2 * DRIFT, gain_repeatability=0.0)
    found, _, _ = calibrated(measured(0.0), stated)
    (drift,) = found.repeatability  # a gain that repeats exactly is none
    assert not drift.learned
    assert drift.prior.value == 2 * DRIFT
    assert abs(np.log(drift.posterior.value / DRIFT)) < 3 * drift.posterior.std / drift.posterior.value


def test_a_repeatability_that_hardly_acts_is_not_told():
    """Drifts of a billionth leave no trace."""
    (drift,) = calibrated(measured(0.0), replace(OF_A_WORKSHOP, frequency_drift=1e-9, gain_repeatability=0.0))[
        0
    ].repeatability
    assert drift.posterior.value == drift.prior.value


def test_an_arbitrary_unit_has_no_prior():
    runs = [replace(run, quantity="acceleration") for run in measured(0.0)]
    found, _, _ = calibrated(runs)
    assert all(not np.isfinite(each.prior.std) for each in found.gains if each.name.startswith("run_gain"))
    assert all(np.isfinite(each.posterior.std) for each in found.gains)


def test_a_modulus_of_several_segments_is_a_factor():
    rig = load_rig(RIG)
    stiffer = rig.segment[0].model_copy(update={"youngs_modulus_Pa": 1.1 * MODULUS})
    mixed = rig.model_copy(update={"segment": [stiffer, *rig.segment]})
    made = type(workshop(BELIEF))(mixed, BELIEF, ELEMENTS, 8)
    modulus = made.tolerances[0]
    assert (modulus.value, modulus.unit, modulus.words) == (1.0, "1", "factor on the modulus of the shaft")


def test_the_file_holds_both_models_beside_what_was_known(weighed):
    document = json.loads(weighed.diagnosis.to_json())
    for calibration in (document["calibration"], document["nominal"]["calibration"]):
        modulus = calibration["numbers"][0]
        assert set(modulus) == {"name", "words", "prior", "posterior", "learned"}
        assert set(modulus["prior"]) == {"value", "std", "unit"}
        assert_allclose(modulus["posterior"]["value"], MODULUS * np.exp(calibration["tolerance"]["modulus"]))
        assert modulus["posterior"]["std"] <= modulus["prior"]["std"]
        assert {each["name"] for each in calibration["repeatability"]} == {"frequency_drift"}
    again = Diagnosis.from_json(weighed.diagnosis.to_json())
    assert again.calibration == weighed.diagnosis.calibration
    assert again.nominal["calibration"] == weighed.diagnosis.nominal["calibration"]
