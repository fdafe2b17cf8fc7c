"""A saved state holds everything: going on from it gives the same bits, wherever it is put back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rigtwin.sim.session import FmuSession
from tests.fmu.child import in_child

OUTPUTS = [f"node_{node}.acceleration_{plane}" for plane in "yz" for node in range(1, 8)] + ["force_applied"]

# What the rotor runs on before its state is saved.
RUNS = {
    "mid-sine": {"force_amplitude": 1.0, "force_frequency": 83.0},
    "held force": {"force": 3.0},
    "with spin": {"force_amplitude": 1.0, "spin_speed": 500.0, "k_b": 1e6, "bearing_damping": 30.0},
    "rigid support": {"rigid_support": True, "force_amplitude": 1.0, "excitation_node": 3, "excitation_plane": 2},
    "undamped at resonance": {"force_amplitude": 1.0, "shaft_damping_ratio": 0.0, "force_frequency": 96.53},
}


def run_up(session: FmuSession, values: dict) -> None:
    """Leave rest, with a change of k_b on the way."""
    session.start(values)
    session.step(0.0123)
    session.set({"k_b": 4e6})
    session.sample(OUTPUTS, 3.1e-4, 20)


def eventful_future(session: FmuSession) -> np.ndarray:
    """Readings while everything that may change changes."""
    readings = [session.sample(OUTPUTS, 2.3e-4, 40)]
    for change in ({"force_frequency": 211.0}, {"k_b": 9e5}, {"force": -1.0}, {"spin_speed": -50.0}, {"k_b": 4e6}):
        session.set(change)
        readings.append(session.sample(OUTPUTS, 2.3e-4, 40))
    session.step(7.0)
    return np.concatenate([*readings, session.sample(OUTPUTS, 1e-3, 40)])


@pytest.mark.parametrize("values", RUNS.values(), ids=RUNS)
def test_a_replay_from_a_serialised_state_is_exact_to_the_last_bit(rotor_session, values):
    run_up(rotor_session, values)
    saved = rotor_session.save_state()
    first = eventful_future(rotor_session)
    rotor_session.restore_state(saved)
    np.testing.assert_array_equal(eventful_future(rotor_session), first)
    assert np.ptp(first[:, 1]) > 0 or np.ptp(first[:, 8]) > 0  # it did move


@pytest.mark.parametrize("values", RUNS.values(), ids=RUNS)
def test_a_replay_from_a_state_that_was_kept_is_exact_to_the_last_bit(rotor_session, values):
    """get and set alone; the state is kept while the instance runs on, and may be set more than once."""
    run_up(rotor_session, values)
    fmu, time = rotor_session._fmu, rotor_session.time
    state = fmu.getFMUstate()
    futures = []
    for _ in range(3):
        fmu.setFMUstate(state)
        rotor_session.time = time
        futures.append(eventful_future(rotor_session))
    fmu.freeFMUstate(state)
    np.testing.assert_array_equal(futures[1], futures[0])
    np.testing.assert_array_equal(futures[2], futures[0])


@pytest.mark.parametrize("values", RUNS.values(), ids=RUNS)
def test_a_second_instance_goes_on_where_the_first_one_stood(rotor_session, rotor_fmu, values):
    run_up(rotor_session, values)
    saved = rotor_session.save_state()
    first = eventful_future(rotor_session)
    with FmuSession(rotor_fmu) as second:
        second.start({"k_b": 7e7, "shaft_damping_ratio": 0.1, "force": 9.0})
        second.step(0.1)
        second.restore_state(saved)
        np.testing.assert_array_equal(eventful_future(second), first)


def test_a_state_outlives_its_process(rotor_session, rotor_fmu):
    def go_on(fmu, time, content):
        import numpy

        from rigtwin.sim.session import FmuSession, SavedState

        outputs = ["node_2.acceleration_y", "node_3.acceleration_z", "force_applied"]
        with FmuSession(fmu) as session:
            session.start({"force": 9.0})
            session.restore_state(SavedState(time, content.encode("latin-1")))
            return numpy.asarray(session.sample(outputs, 1e-3, 50)).tolist()

    run_up(rotor_session, RUNS["with spin"])
    saved = rotor_session.save_state()
    here = rotor_session.sample(["node_2.acceleration_y", "node_3.acceleration_z", "force_applied"], 1e-3, 50)
    np.testing.assert_array_equal(in_child(go_on, rotor_fmu, saved.time, saved.content.decode("latin-1")), here)


def test_the_state_holds_the_outputs_of_its_instant(rotor_session):
    run_up(rotor_session, RUNS["with spin"])
    saved, then = rotor_session.save_state(), rotor_session.get(OUTPUTS)
    rotor_session.step(0.5)
    assert rotor_session.get(OUTPUTS) != then
    rotor_session.restore_state(saved)
    assert rotor_session.get(OUTPUTS) == then


def test_saving_a_state_changes_nothing(rotor_session):
    def readings(save):
        run_up(rotor_session, RUNS["mid-sine"])
        if save:
            rotor_session.save_state()
        return rotor_session.sample(OUTPUTS, 1e-3, 50)

    np.testing.assert_array_equal(readings(save=True), readings(save=False))


def test_the_estimators_state_is_its_inputs(estimator_session):
    estimator_session.start()
    estimates = ["k_b", "k_b_std", "k_b_low", "k_b_high", "valid"]
    saved, before = estimator_session.save_state(), estimator_session.get(estimates)
    estimator_session.set({"delta_f1": 2 * estimator_session.get(["delta_f1"])[0]})
    assert estimator_session.get(estimates) != before
    estimator_session.restore_state(saved)
    assert estimator_session.get(estimates) == before


def restore(fmu, contents):
    """Of each content: what the session's error says, and whether the run went on as without the attempt."""
    from rigtwin.sim.session import FmuError, FmuSession, SavedState

    outputs = ["node_2.acceleration_y", "force_applied"]

    def run(session, content):
        session.start({"force_amplitude": 1.0})
        session.step(0.0123)
        message = None
        if content is not None:
            try:
                session.restore_state(SavedState(0.0, content.encode("latin-1")))
            except FmuError as error:
                message = str(error)
        return message, session.sample(outputs, 1e-3, 30).tolist()

    with FmuSession(fmu) as session:
        undisturbed = run(session, None)[1]
        return [[message, readings == undisturbed] for message, readings in (run(session, c) for c in contents)]


def test_what_is_no_state_of_this_fmu_is_refused_without_harm(rotor_fmu, larger_disks_fmu):
    """Restored in a child: a state that broke the instance would end the process."""
    with FmuSession(larger_disks_fmu) as other:
        other.start()
        of_another_rig = other.save_state().content.decode("latin-1")
    no_state = ["\x80garbage", "[1, 2]", "null", "{}", json.dumps({"values": [], "state": None}), of_another_rig]
    for message, went_on in in_child(restore, rotor_fmu, no_state):
        assert "this is not a state that this FMU saved" in message
        assert went_on


def set_fixed_after_restoring(fmu):
    """What the session's error says when a fixed parameter is set after going back to a running state."""
    from rigtwin.sim.session import FmuError, FmuSession

    with FmuSession(fmu) as session:
        session.start()
        session.step(0.1)
        session.restore_state(session.save_state())
        try:
            session.set({"excitation_node": 3})
        except FmuError as error:
            return str(error)
    return None


def test_what_was_fixed_is_fixed_again_after_going_back(rotor_fmu):
    assert "excitation_node can only be set before" in in_child(set_fixed_after_restoring, rotor_fmu)
