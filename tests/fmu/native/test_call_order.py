"""The life of an instance as the standard draws it, call by call, with a rotor that moves.

What is allowed in a state succeeds, what is not fails with a sentence, and the run that follows is to the
last bit the run of an instance that was never asked anything wrong.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from rigtwin.sim.session import FmuError, FmuSession

H, STEPS = 1e-3, 30
READ = ["node_2.acceleration_y", "node_5.acceleration_y", "force_applied"]
DRIVEN = {"force_amplitude": 1.0, "force_frequency": 60.0, "k_b": 2e6}

Call = Callable[[FmuSession], object]


@pytest.fixture(params=["rotor_fmu", "rotor3"])
def session(request):
    """A fresh instance of either version of FMI, instantiated and nothing more."""
    with FmuSession(request.getfixturevalue(request.param)) as fresh:
        yield fresh


def enter(session: FmuSession) -> None:
    session._call(session._fmu.setupExperiment, startTime=0.0)
    session._call(session._fmu.enterInitializationMode)


def leave(session: FmuSession) -> None:
    session._call(session._fmu.exitInitializationMode)


def end(session: FmuSession) -> None:
    session._call(session._fmu.terminate)


def reset(session: FmuSession) -> None:
    session._call(session._fmu.reset)


def step(session: FmuSession) -> None:
    session._call(session._fmu.doStep, session.time, H)
    session.time += H


def run(session: FmuSession) -> np.ndarray:
    """(STEPS, 3) what a run from the initialisation mode on gives; the force jumps halfway."""
    session.time, rows = 0.0, []
    for k in range(STEPS):
        if k == STEPS // 2:
            session.set({"force": 2.0, "k_b": 3e6})
        step(session)
        rows.append(session.get(READ))
    return np.array(rows)


def whole_run(session: FmuSession) -> np.ndarray:
    session.set(DRIVEN)
    enter(session)
    leave(session)
    return run(session)


def refused(call: Call, session: FmuSession) -> str:
    """The sentence of a call that fails."""
    with pytest.raises((FmuError, FMICallException)) as caught:
        call(session)
    return str(caught.value)


def test_values_can_be_read_before_the_initialisation_and_during_it(session):
    """At rest, but with the force that has been set: 3 N at node 2 accelerate it at once."""
    assert session.get([*READ, "k_b"]) == [0.0, 0.0, 0.0, 1e7]
    session.set({"force": 3.0})
    enter(session)
    accelerations = session.get(READ)
    assert accelerations[2] == 3.0
    assert accelerations[0] > 1.0
    session.set({"force": -3.0})
    assert session.get(READ) == [-value for value in accelerations]


# Of each state: how to get there, what succeeds in it, and what fails with which words.
SET_INPUT = ("set an input", lambda s: s.set({"force": 0.0}))
SET_TUNABLE = ("set a tunable parameter", lambda s: s.set({"k_b": 2e6}))
SET_FIXED = ("set a fixed parameter", lambda s: s.set({"excitation_node": 2}))
GET = ("get outputs", lambda s: s.get(READ))
KEEP = ("keep a state", lambda s: s.restore_state(s.save_state()))
STATES: dict[str, tuple[list[Call], list[tuple[str, Call]], list[tuple[str, Call, str]]]] = {
    "instantiated": (
        [],
        [SET_INPUT, SET_TUNABLE, SET_FIXED, GET, KEEP],
        [
            ("step", step, "a step is not possible before"),
            ("leave", leave, "leaving the initialization is not possible before"),
            ("end", end, "ending the simulation is not possible before"),
        ],
    ),
    "initialisation mode": (
        [enter],
        [SET_INPUT, SET_TUNABLE, SET_FIXED, GET, KEEP],
        [
            ("step", step, "a step is not possible during the init"),
            ("enter", lambda s: s._call(s._fmu.enterInitializationMode), "entering the initialization is not possible"),
            ("end", end, "ending the simulation is not possible during the init"),
        ],
    ),
    "step mode": (
        [enter, leave],
        [SET_INPUT, SET_TUNABLE, GET, KEEP],
        [
            (*SET_FIXED, "excitation_node can only be set before"),
            ("enter", lambda s: s._call(s._fmu.enterInitializationMode), "entering the initialization is not possible"),
            ("leave", leave, "leaving the initialization is not possible during the simulation"),
        ],
    ),
    "terminated": (
        [enter, leave, step, end],
        [GET],
        [
            (*SET_INPUT, "force cannot be set after the end"),
            (*SET_TUNABLE, "k_b cannot be set after the end"),
            ("step", step, "a step is not possible after the end"),
            ("end", end, "ending the simulation is not possible after the end"),
            ("leave", leave, "leaving the initialization is not possible after the end"),
        ],
    ),
}


@pytest.mark.parametrize("state", STATES)
def test_each_state_allows_what_the_standard_allows_and_refuses_the_rest(session, state):
    undisturbed = whole_run(session)
    assert np.abs(undisturbed).max(axis=0).min() > 0.05, "it moves"
    reset(session)
    way, allowed, forbidden = STATES[state]
    session.time = 0.0
    session.set(DRIVEN)
    for call in way:
        call(session)
    for _, call, words in forbidden:
        assert words in refused(call, session)
    for _, call in allowed:
        call(session)
    reset(session)
    np.testing.assert_array_equal(whole_run(session), undisturbed)


@pytest.mark.parametrize("way", [[], [end]], ids=["while it runs", "after its end"])
def test_a_reset_forgets_everything(session, way):
    first = whole_run(session)
    for call in way:
        call(session)
    reset(session)
    assert session.get([*READ, "k_b", "force_amplitude"]) == [0.0, 0.0, 0.0, 1e7, 0.0]
    np.testing.assert_array_equal(whole_run(session), first)


@pytest.mark.parametrize("way", [[], [enter], [enter, leave], [enter, leave, step], [enter, leave, step, end]])
def test_an_instance_can_be_freed_in_any_state(request, way):
    for name in ("rotor_fmu", "rotor3"):
        with FmuSession(request.getfixturevalue(name)) as session:
            for call in way:
                call(session)


def test_a_run_may_end_and_begin_again_from_a_kept_state(session):
    whole_run(session)
    kept = session.save_state()
    on = [session.sample(READ, H, 5)]
    end(session)
    session.restore_state(kept)
    on.append(session.sample(READ, H, 5))
    np.testing.assert_array_equal(*on)
    assert np.abs(on[0]).max() > 0.05
