"""A bad call fails with a sentence in the FMI log, changes nothing, and leaves the instance usable.

pythonfmu's glue can report a refused value only as fmi2Fatal, and used to leave the host with a
dangling instance. So every bad call here is made in a child process, which must go on with the
numbers of a run without the bad call, free the instance, and end with exit code 0.
"""

from __future__ import annotations

import math
from typing import Any

import pytest

from tests.fmu.child import in_child

NAN, INF = math.nan, math.inf
ANY_REFERENCE = 2**32 - 1
UNUSED_REFERENCE = 9999  # beyond those of all effects

# id: (call, the sentence in the log). Calls are (method of the session or its fmpy instance, arguments).
WHILE_RUNNING: dict[str, tuple[str, list[Any], str]] = {
    "k_b zero": ("set", [{"k_b": 0.0}], "k_b must be at least 10000 N/m, got 0"),
    "k_b negative": ("set", [{"k_b": -1e7}], "k_b must be at least 10000 N/m, got -1e+07"),
    "k_b NaN": ("set", [{"k_b": NAN}], "k_b must be a finite number, got nan"),
    "k_b infinite": ("set", [{"k_b": INF}], "k_b must be a finite number, got inf"),
    "k_b too large": ("set", [{"k_b": 1e13}], "k_b must be at most 1e+12 N/m, got 1e+13"),
    "force NaN": ("set", [{"force": NAN}], "force must be a finite number, got nan"),
    "force infinite": ("set", [{"force": -INF}], "force must be a finite number, got -inf"),
    "amplitude negative": ("set", [{"force_amplitude": -1.0}], "force_amplitude must be at least 0 N, got -1"),
    "amplitude NaN": ("set", [{"force_amplitude": NAN}], "force_amplitude must be a finite number"),
    "frequency negative": ("set", [{"force_frequency": -50.0}], "force_frequency must be at least 0 Hz, got -50"),
    "frequency NaN": ("set", [{"force_frequency": NAN}], "force_frequency must be a finite number"),
    "bearing damping": ("set", [{"bearing_damping": -1.0}], "bearing_damping must be at least 0 N.s/m, got -1"),
    "shaft damping": ("set", [{"shaft_damping_ratio": -0.01}], "shaft_damping_ratio must be at least 0, got -0.01"),
    "spin NaN": ("set", [{"spin_speed": NAN}], "spin_speed must be a finite number"),
    "rigid support late": ("set", [{"rigid_support": True}], "rigid_support can only be set before the simulation"),
    "node late": ("set", [{"excitation_node": 3}], "excitation_node can only be set before the simulation starts"),
    "plane late": ("set", [{"excitation_plane": 2}], "excitation_plane can only be set before the simulation starts"),
    "buckling": ("set", [{"axial_load.force": -1e6}], "the rotor buckles"),
    "output": ("set", [{"node_2.acceleration_y": 1.0}], "node_2.acceleration_y is an output and cannot be set"),
    "applied force": ("set", [{"force_applied": 1.0}], "force_applied is an output and cannot be set"),
    "step zero": ("doStep", [0.125, 0.0], "the communication step must be positive, got 0 s"),
    "step negative": ("doStep", [0.125, -1e-3], "the communication step must be positive, got -0.001 s"),
    "step NaN": ("doStep", [0.125, NAN], "the communication step must be finite, got nan s"),
    "step infinite": ("doStep", [0.125, INF], "the communication step must be finite, got inf s"),
    "step beyond the clock": ("doStep", [0.125, 1e300], "leaves the clock's range"),
    "step below the clock": ("doStep", [0.125, 1e-15], "below the clock's resolution"),
    "point too early": ("doStep", [0.0, 1e-3], "a step from 0 s was asked for, but the rotor stands at 0.125 s"),
    "point too late": ("doStep", [0.2, 1e-3], "a step from 0.2 s was asked for, but the rotor stands at 0.125 s"),
    "point NaN": ("doStep", [NAN, 1e-3], "the communication step must be finite"),
    "start time late": ("setupExperiment", [None, 0.25], "setting the start time is not possible during the simul"),
    "get unknown": (
        "getReal",
        [[UNUSED_REFERENCE]],
        f"there is no Real variable with value reference {UNUSED_REFERENCE}",
    ),
    "get any": ("getReal", [[0, ANY_REFERENCE]], f"there is no Real variable with value reference {ANY_REFERENCE}"),
    "get integer as real": ("getReal", [[8]], "there is no Real variable with value reference 8"),
    "get unknown integer": ("getInteger", [[ANY_REFERENCE]], "there is no Integer variable with value reference"),
    "get real as boolean": ("getBoolean", [[0]], "there is no Boolean variable with value reference 0"),
    "get string": ("getString", [[0]], "there is no String variable with value reference 0"),
    "set unknown": (
        "setReal",
        [[UNUSED_REFERENCE], [1.0]],
        f"there is no Real variable with value reference {UNUSED_REFERENCE}",
    ),
    "set any": ("setReal", [[ANY_REFERENCE], [1.0]], "there is no Real variable with value reference"),
    "set integer as real": ("setReal", [[8], [2.0]], "there is no Real variable with value reference 8"),
    "set string": ("setString", [[0], ["1.0"]], "there is no String variable with value reference 0"),
}
BEFORE_INITIALISATION: dict[str, tuple[dict[str, Any], str]] = {
    "node zero": ({"excitation_node": 0}, "excitation_node must be at least 1, got 0"),
    "node beyond the shaft": ({"excitation_node": 8}, "excitation_node must be at most 7, got 8"),
    "plane": ({"excitation_plane": 3}, "excitation_plane must be at most 2, got 3"),
    "k_b": ({"k_b": -1.0}, "k_b must be at least 10000 N/m, got -1"),
    "start time": ({"start time": NAN}, "the start time must lie within 1e+09 s of zero, got nan s"),
    "late start": ({"start time": 1e300}, "the start time must lie within 1e+09 s of zero, got 1e+300 s"),
}


def make_bad_calls(fmu, calls):
    """Of each call: what the session's error says, and whether the run went on as without the call."""
    from rigtwin.sim.session import FmuError, FmuSession

    outputs = ["node_2.acceleration_y", "node_5.acceleration_z", "force_applied"]

    def run(session, bad_call):
        pushed = {"axial_load.enabled": True, "axial_load.force": -1e3}
        session.start({"force": 0.5, "force_amplitude": 1.0, "spin_speed": 200.0, **pushed})
        session.step(0.125)
        message = bad_call(session)
        return message, session.sample(outputs, 1e-3, 30).tolist() + session.get(session.variables)

    def bad(session, method, arguments):
        try:
            if method == "set":
                session.set(*arguments)
            else:
                session._call(getattr(session._fmu, method), *arguments)
        except FmuError as error:
            return str(error)
        return None

    with FmuSession(fmu) as session:
        _, undisturbed = run(session, lambda s: None)
        report = {}
        for name, method, arguments in calls:
            message, readings = run(session, lambda s, m=method, a=arguments: bad(s, m, a))
            report[name] = message, readings == undisturbed
    return report


@pytest.fixture(scope="module")
def report(rotor_fmu):
    return in_child(make_bad_calls, rotor_fmu, [(name, *call[:2]) for name, call in WHILE_RUNNING.items()])


@pytest.mark.parametrize("name", WHILE_RUNNING)
def test_a_bad_call_fails_with_a_sentence_and_has_no_effect(report, name):
    message, went_on = report[name]
    assert message is not None, "the call did not fail"
    assert WHILE_RUNNING[name][2] in message
    assert went_on, "the run after the refused call differs from a run without it"


def start_badly(fmu, starts):
    """Of each set of start values: what the session's error says, and the reading of a good start after it."""
    from rigtwin.sim.session import FmuError, FmuSession

    report = {}
    with FmuSession(fmu) as session:
        for name, values in starts:
            message = None
            try:
                if "start time" in values:
                    session._call(session._fmu.reset)
                    session._call(session._fmu.setupExperiment, startTime=values["start time"])
                else:
                    session.start(values)
            except FmuError as error:
                message = str(error)
            session.start({"force_amplitude": 1.0})
            session.step(0.01)
            report[name] = message, session.get(["node_2.acceleration_y"])
    return report


@pytest.fixture(scope="module")
def bad_starts(rotor_fmu):
    return in_child(start_badly, rotor_fmu, [(name, values) for name, (values, _) in BEFORE_INITIALISATION.items()])


@pytest.mark.parametrize("name", BEFORE_INITIALISATION)
def test_a_bad_start_value_is_refused_and_a_good_start_follows(bad_starts, rotor_session, name):
    message, reading = bad_starts[name]
    assert message is not None, "the start did not fail"
    assert BEFORE_INITIALISATION[name][1] in message
    rotor_session.start({"force_amplitude": 1.0})
    rotor_session.step(0.01)
    assert reading == rotor_session.get(["node_2.acceleration_y"])


def step_out_of_turn(fmu):
    """What a step says before the initialisation and after the end, and a reading of the run in between."""
    from rigtwin.sim.session import FmuError, FmuSession

    def refused(session):
        try:
            session._call(session._fmu.doStep, session.time, 0.01)
        except FmuError as error:
            return str(error)
        return None

    with FmuSession(fmu) as session:
        early = refused(session)
        session.start({"force_amplitude": 1.0})
        session.step(0.01)
        reading = session.get(["node_2.acceleration_y"])
        session._call(session._fmu.terminate)
        return early, refused(session), reading


def test_a_step_is_refused_before_the_initialisation_and_after_the_end(rotor_fmu, rotor_session):
    early, late, reading = in_child(step_out_of_turn, rotor_fmu)
    assert "a step is not possible before the" in early
    assert "a step is not possible after the end of the simulation" in late
    rotor_session.start({"force_amplitude": 1.0})
    rotor_session.step(0.01)
    assert reading == rotor_session.get(["node_2.acceleration_y"])


def set_several(fmu, cases):
    """Values of all four after each refused call that sets four at once."""
    from rigtwin.sim.session import FmuError, FmuSession

    names = ["force", "force_amplitude", "k_b", "spin_speed"]
    found = []
    with FmuSession(fmu) as session:
        references = [session._variables[name].valueReference for name in names]
        for values in cases:
            session.start({"force": 0.5})
            session.step(0.01)
            before = session.get([*names, "node_2.acceleration_y", "force_applied"])
            try:
                session._call(session._fmu.setReal, references, values)
            except FmuError as error:
                found.append((str(error), session.get([*names, "node_2.acceleration_y", "force_applied"]) == before))
    return found


def test_of_several_values_in_one_call_either_all_are_set_or_none(rotor_fmu):
    cases = [[9.0, 1.0, -1.0, 5.0], [NAN, 1.0, 2e6, 5.0], [9.0, 1.0, 2e6, NAN], [9.0, -1.0, -1.0, 5.0]]
    found = in_child(set_several, rotor_fmu, cases)
    assert [unchanged for _, unchanged in found] == [True] * len(cases)
    for (message, _), culprit in zip(found, ["k_b", "force", "spin_speed", "force_amplitude"], strict=True):
        assert f"{culprit} must be" in message


def fail_often(fmu, n, unused):
    """n failing calls of every kind on several instances, with the garbage collector at work in between."""
    import gc

    from rigtwin.sim.session import FmuError, FmuSession

    failed = 0
    for _ in range(4):
        with FmuSession(fmu) as session:
            session.start()
            bad_calls = (
                (session.set, {"k_b": -1.0}),
                (session._call, session._fmu.getReal, [unused]),
                (session._call, session._fmu.doStep, 1e6, 1.0),
                (session._call, session._fmu.setString, [0], ["x"]),
            )
            for number in range(n // 4):
                call, *arguments = bad_calls[number % 4]
                try:
                    call(*arguments)
                except FmuError:
                    failed += 1
                if number % 10 == 0:
                    gc.collect()
            session.step(1e-3)
    gc.collect()
    return failed


def test_two_hundred_failing_calls_do_not_crash_the_host(rotor_fmu):
    assert in_child(fail_often, rotor_fmu, 200, UNUSED_REFERENCE) == 200


ESTIMATOR_CALLS: dict[str, tuple[str, list[Any], str]] = {
    "NaN": ("set", [{"delta_f1": NAN}], "delta_f1 must be a finite number, got nan"),
    "infinite": ("set", [{"amplitude_ratio": INF}], "amplitude_ratio must be a finite number, got inf"),
    "negative error": ("set", [{"delta_f2_std": -0.1}], "delta_f2_std must be at least 0 Hz, got -0.1"),
    "output": ("set", [{"k_b": 1e7}], "k_b is an output and cannot be set"),
    "boolean output": ("set", [{"valid": True}], "valid is an output and cannot be set"),
    "step zero": ("doStep", [1.0, 0.0], "the communication step must be positive, got 0 s"),
    "step NaN": ("doStep", [1.0, NAN], "the communication step must be finite, got nan s"),
    "step infinite": ("doStep", [1.0, INF], "the communication step must be finite, got inf s"),
    "time NaN": ("doStep", [NAN, 1.0], "the communication step must be finite, got 1 s at nan s"),
    "unknown": ("getReal", [[UNUSED_REFERENCE]], f"there is no Real variable with value reference {UNUSED_REFERENCE}"),
    "boolean as real": ("getReal", [[10]], "there is no Real variable with value reference 10"),
}


def make_bad_estimator_calls(fmu, calls):
    """Of each call: what the session's error says, and whether the estimate stays what it was."""
    from rigtwin.sim.session import FmuError, FmuSession

    report = {}
    with FmuSession(fmu) as session:
        session.start()
        names = session.variables
        before = session.get(names)
        for name, method, arguments in calls:
            message = None
            try:
                if method == "set":
                    session.set(*arguments)
                else:
                    session._call(getattr(session._fmu, method), *arguments)
            except FmuError as error:
                message = str(error)
            session.step(1.0)
            report[name] = message, session.get(names) == before
    return report


@pytest.fixture(scope="module")
def estimator_report(estimator_fmu):
    calls = [(name, *call[:2]) for name, call in ESTIMATOR_CALLS.items()]
    return in_child(make_bad_estimator_calls, estimator_fmu, calls)


@pytest.mark.parametrize("name", ESTIMATOR_CALLS)
def test_the_estimator_refuses_bad_calls_in_the_same_way(estimator_report, name):
    message, unchanged = estimator_report[name]
    assert message is not None, "the call did not fail"
    assert ESTIMATOR_CALLS[name][2] in message
    assert unchanged
