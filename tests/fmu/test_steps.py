"""Any communication step will do: variable, jittery, split or long."""

from __future__ import annotations

import numpy as np
import pytest

from rigtwin.rotor.model.condition import Condition
from tests.fmu.child import in_child
from tests.fmu.truth import CLOCK, FreshRotor, assert_close, whole_ticks
from tests.tolerances import STEPPER

OUTPUTS = [f"node_{node}.acceleration_y" for node in range(1, 8)] + ["force_applied"]
DRIVEN = {"force_amplitude": 2.0, "force_frequency": 83.0, "force": 0.4, "k_b": 2e6}


def after(session, steps) -> np.ndarray:
    """(n_outputs,) outputs after these steps from rest."""
    session.start(DRIVEN)
    for h in steps:
        session.step(float(h))
    return np.array(session.get(OUTPUTS))


@pytest.mark.parametrize("pieces", [2, 7, 100, 2000])
def test_many_equal_steps_lead_where_one_step_leads(rotor_session, pieces):
    h = whole_ticks(1.0 / pieces)
    assert_close(after(rotor_session, [h] * pieces), after(rotor_session, [h * pieces]), STEPPER)


def test_uneven_steps_lead_where_one_step_leads(rotor_session):
    rng = np.random.default_rng(1)
    ends = np.unique(np.append(np.round(np.sort(rng.uniform(0, 1, 60)) * 2**36), 2**36)) / 2**36
    assert_close(after(rotor_session, np.diff(ends, prepend=0.0)), after(rotor_session, [1.0]), STEPPER)


@pytest.mark.parametrize("h", [1e-6, 1e-3, 1.0])
def test_one_step_is_exact_whatever_its_length(rotor_session, structure, h):
    h = whole_ticks(h)
    rotor = FreshRotor(structure, Condition(k_b=2e6))
    rotor.step(h, force=0.4, amplitude=2.0, frequency_hz=83.0)
    readings = after(rotor_session, [h])
    assert_close(readings[:-1], rotor.accelerations(readings[-1])[:7], CLOCK)


def test_a_settled_rotor_stays_settled_over_a_day(rotor_session):
    rotor_session.start({"force_amplitude": 1.0, "force_frequency": 64.0})
    rotor_session.step(60.0)
    settled = rotor_session.sample(OUTPUTS, 1 / 1024, 16)
    rotor_session.step(86400.0 - 15 / 1024)
    assert_close(rotor_session.sample(OUTPUTS, 1 / 1024, 16), settled, 1e-7)


def simulate(fmu, stop, h):
    import warnings

    from fmpy import simulate_fmu

    warnings.simplefilter("error")
    outputs = ["node_2.acceleration_y", "force_applied"]
    values = {"force_amplitude": 2.0, "force_frequency": 83.0, "k_b": 2e6}
    result = simulate_fmu(fmu, stop_time=stop, output_interval=h, step_size=h, start_values=values, output=outputs)
    return {name: result[name].tolist() for name in ["time", *outputs]}


def test_simulate_fmu_runs_to_the_end(rotor_fmu, structure):
    """A do_step that does not return True ends fmpy's simulation after one step, without a word."""
    result = in_child(simulate, rotor_fmu, 0.3, 1e-4)
    assert len(result["time"]) == 3001
    assert result["time"][-1] == pytest.approx(0.3, rel=1e-12)
    rotor = FreshRotor(structure, Condition(k_b=2e6))
    rotor.step(0.3, amplitude=2.0, frequency_hz=83.0)
    assert result["force_applied"][-1] == pytest.approx(2 * np.sin(rotor.phase), abs=1e-6)
    expected = rotor.accelerations(result["force_applied"][-1])[1]
    assert result["node_2.acceleration_y"][-1] == pytest.approx(expected, abs=CLOCK)


def test_simulate_fmu_runs_the_estimator_to_the_end(estimator_fmu):
    def simulate_estimator(fmu):
        from fmpy import simulate_fmu

        result = simulate_fmu(fmu, stop_time=3.0, step_size=1.0, output_interval=1.0, output=["k_b", "valid"])
        return result["time"].tolist(), result["k_b"].tolist(), result["valid"].tolist()

    times, k_b, valid = in_child(simulate_estimator, estimator_fmu)
    assert times == [0.0, 1.0, 2.0, 3.0]
    assert len(set(k_b)) == 1
    assert all(valid)


def test_an_experiment_may_start_at_any_time(rotor_session):
    """The rotor is at rest, its sine at phase zero, when the experiment starts."""
    readings = []
    for start in (0.0, 1234.5, -3.0):
        fmu = rotor_session._fmu
        rotor_session.start()
        fmu.reset()
        fmu.setupExperiment(startTime=start)
        rotor_session.set(DRIVEN)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        rotor_session.time = start
        rotor_session.step(0.125)
        readings.append(rotor_session.get(OUTPUTS))
    assert_close(readings[1], readings[0], STEPPER)
    assert_close(readings[2], readings[0], STEPPER)


@pytest.mark.parametrize("value", [{"rigid_support": True}, {"pedestal_flexibility.enabled": True}])
def test_what_changes_the_size_of_the_rotor_may_be_set_whenever_it_starts(rotor_session, value):
    rotor_session.start()
    rotor_session._fmu.reset()
    rotor_session._fmu.setupExperiment(startTime=1234.5)
    rotor_session.set(value)
    rotor_session._fmu.enterInitializationMode()
    rotor_session._fmu.exitInitializationMode()
    assert rotor_session.get(list(value)) == list(value.values())


def test_an_estimate_takes_no_step_or_any(estimator_session):
    estimator_session.start()
    at_once = estimator_session.get(["k_b", "k_b_std", "valid"])
    for h in (1e-9, 1.0, 1e6):
        estimator_session.step(h)
        assert estimator_session.get(["k_b", "k_b_std", "valid"]) == at_once
