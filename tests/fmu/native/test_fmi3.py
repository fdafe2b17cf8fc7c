"""The same rotor and the same estimator behind FMI 3.0."""

from __future__ import annotations

import ctypes
import struct
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from numpy.testing import assert_array_equal

from rigtwin.sim.session import FmuError, FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep
from tests.fmu.test_model_description import fmutool_report

N_NODES = 7


@pytest.fixture(params=["rotor3", "rotor3_with_array", "estimator3"])
def fmu3(request) -> Path:
    return request.getfixturevalue(request.param)


NULL_ARGUMENT = "an argument that is needed is a null pointer"


class Slave:
    """An instance, by the names of its variables."""

    def __init__(self, fmu: Path, folder: Path):
        extract(str(fmu), str(folder))
        description = read_model_description(str(folder))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.types = {v.name: v.type for v in description.modelVariables}
        name = description.coSimulation.modelIdentifier
        self.messages: list[str] = []
        self.fmu = FMU3Slave(
            guid=description.guid, unzipDirectory=str(folder), modelIdentifier=name, instanceName="one"
        )
        self.fmu.instantiate(logMessage=lambda *said: self.messages.append(said[-1].decode()))

    def set(self, name, value):
        getattr(self.fmu, f"set{self.types[name]}")([self.references[name]], [value])

    def get(self, name, n=1):
        return getattr(self.fmu, f"get{self.types[name]}")([self.references[name]], nValues=n)


ACCELERATIONS = [f"node_{node}.acceleration_{plane}" for plane in "yz" for node in range(1, N_NODES + 1)]


@pytest.fixture
def rotor(rotor3, tmp_path):
    slave = Slave(rotor3, tmp_path / "unpacked")
    yield slave
    slave.fmu.freeInstance()


@pytest.fixture
def with_array(rotor3_with_array, tmp_path):
    slave = Slave(rotor3_with_array, tmp_path / "unpacked")
    yield slave
    slave.fmu.freeInstance()


def run(slave, time, n, h=1e-3):
    found = []
    for k in range(n):
        slave.fmu.doStep(time + k * h, h)
        found.append(slave.fmu.getFloat64([slave.references[name] for name in ACCELERATIONS]))
    return np.array(found)


def started(slave, **values):
    for name, value in values.items():
        slave.set(name, value)
    slave.fmu.enterInitializationMode(startTime=0.0)
    slave.fmu.exitInitializationMode()


def test_both_checkers_find_nothing_wrong(fmu3):
    assert validate_fmu(str(fmu3)) == []
    report = fmutool_report(fmu3)
    assert {level for level, _ in report} == {"INFO"}
    assert "This FMU seems to be compliant with FMI-3.0." in [message for _, message in report]
    assert "No semantic error against the FMI-3 standard." in [message for _, message in report]


@pytest.mark.parametrize(("name", "values"), [("RotorRig", {"force_amplitude": 1.0, "bearing_friction.enabled": True}),
                                              ("StiffnessEstimator", {"delta_f1": 4.1})])  # fmt: skip
def test_it_gives_the_digits_of_its_fmi_2_sister(name, values, rotor3, estimator3, rotor_fmu, estimator_fmu):
    sisters = {"RotorRig": (rotor3, rotor_fmu), "StiffnessEstimator": (estimator3, estimator_fmu)}[name]
    scalars = [v.name for v in read_model_description(str(sisters[1])).modelVariables if v.causality == "output"]
    found = [
        simulate_fmu(str(fmu), stop_time=0.05, step_size=1e-3, start_values=values, output=scalars) for fmu in sisters
    ]
    assert len(found[0]) > 1
    for scalar in scalars:
        assert_array_equal(found[0][scalar], found[1][scalar])
    assert np.abs(found[0][scalars[1]]).max() > 0


def test_without_being_asked_for_no_variable_is_an_array(rotor3):
    variables = read_model_description(str(rotor3)).modelVariables
    assert not any(v.dimensions for v in variables)
    assert "accelerations" not in {v.name for v in variables}


def test_the_array_holds_the_accelerations_in_y_and_then_in_z(with_array):
    started(with_array, force_amplitude=1.0, spin_speed=200.0)
    scalars = run(with_array, 0.0, 20)[-1]
    assert_array_equal(with_array.get("accelerations", 2 * N_NODES), scalars)
    assert np.count_nonzero(scalars) == 2 * N_NODES


@pytest.mark.parametrize("n", [0, 1, 2 * N_NODES, 2 * N_NODES + 1])
def test_where_the_sizes_do_not_fit_nothing_is_written(with_array, n):
    """An importer that reads one value a reference asks for as many values as references."""
    started(with_array, force_amplitude=1.0)
    run(with_array, 0.0, 5)
    asked = [with_array.references[name] for name in ("force_applied", "accelerations", "node_2.acceleration_y")]
    values = (ctypes.c_double * (n + 1))(*[12345.0] * (n + 1))
    fmu = with_array.fmu
    with pytest.raises(FMICallException):
        fmu.fmi3GetFloat64(fmu.component, (ctypes.c_uint32 * 3)(*asked), 3, values, n)
    assert "the number of values is not that of the variables" in with_array.messages[-1]
    assert set(values) == {12345.0}


def test_the_time_is_a_variable_of_its_own(rotor):
    started(rotor)
    run(rotor, 0.0, 5)
    assert rotor.get("time") == [pytest.approx(5e-3)]


def test_a_state_replays_to_the_last_bit_also_when_serialised(rotor):
    started(rotor, force_amplitude=5.0, **{"bearing_friction.enabled": True})
    run(rotor, 0.0, 20)
    state = rotor.fmu.getFMUState()
    content = rotor.fmu.serializeFMUState(state)
    first = run(rotor, 0.02, 20)
    rotor.fmu.setFMUState(state)
    assert rotor.get("time") == [pytest.approx(0.02)]
    assert_array_equal(run(rotor, 0.02, 20), first)
    rotor.fmu.freeFMUState(state)
    rotor.fmu.reset()
    again = rotor.fmu.deserializeFMUState(content)
    rotor.fmu.setFMUState(again)
    assert_array_equal(run(rotor, 0.02, 20), first)
    rotor.fmu.freeFMUState(again)


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        (lambda r: r.set("k_b", -1.0), "k_b must be at least 10000 N/m, got -1"),
        (lambda r: r.set("rigid_support", True), "rigid_support can only be set before the simulation starts"),
        (lambda r: r.fmu.setFloat64([len(r.references) - 1], [1.0]), "there is no Real variable"),
        (lambda r: r.get("force_applied", 3), "the number of values is not that of the variables"),
        (lambda r: r.fmu.doStep(1.0, 1e-3), "a step from 1 s was asked for, but the rotor stands at 0.005 s"),
        (lambda r: r.fmu.enterEventMode(), "there is no event mode"),
        (lambda r: r.fmu.getUInt8([0]), "there are no variables of this type"),
        (lambda r: r.fmu.fmi3GetFloat64(r.fmu.component, None, 1, None, 1), NULL_ARGUMENT),
        (lambda r: r.fmu.fmi3GetBoolean(r.fmu.component, None, 1, None, 1), NULL_ARGUMENT),
        (lambda r: r.fmu.fmi3SetFloat64(r.fmu.component, None, 1, None, 1), NULL_ARGUMENT),
        (lambda r: r.fmu.fmi3GetFMUState(r.fmu.component, None), NULL_ARGUMENT),
    ],
)
def test_a_bad_call_fails_with_a_sentence_and_has_no_effect(rotor, bad, sentence):
    started(rotor, force_amplitude=1.0)
    run(rotor, 0.0, 5)
    state = rotor.fmu.getFMUState()
    undisturbed = run(rotor, 5e-3, 5)
    rotor.fmu.setFMUState(state)
    rotor.fmu.freeFMUState(state)
    with pytest.raises(FMICallException):
        bad(rotor)
    assert sentence in rotor.messages[-1]
    assert_array_equal(run(rotor, 5e-3, 5), undisturbed)


def test_another_builds_token_is_refused(rotor3, tmp_path):
    extract(str(rotor3), str(tmp_path))
    slave = FMU3Slave(
        guid="{00000000-0000-0000-0000-000000000000}",
        unzipDirectory=str(tmp_path),
        modelIdentifier="RotorRig",
        instanceName="one",
    )
    with pytest.raises(Exception, match="Failed to instantiate"):
        slave.instantiate()


def test_a_state_with_a_setting_out_of_its_range_is_refused(rotor):
    """Bytes that were tampered with: k_b stands among them as it was set."""
    started(rotor, k_b=1234567.0, force_amplitude=1.0)
    run(rotor, 0.0, 5)
    content = rotor.fmu.serializeFMUState(rotor.fmu.getFMUState())
    assert content.count(struct.pack("=d", 1234567.0)) == 1
    forged = rotor.fmu.deserializeFMUState(content.replace(struct.pack("=d", 1234567.0), struct.pack("=d", -1.0)))
    with pytest.raises(FMICallException):
        rotor.fmu.setFMUState(forged)
    assert "k_b must be at least" in rotor.messages[-1]
    assert rotor.get("k_b") == [1234567.0]
    run(rotor, 5e-3, 1)


# -- the virtual rig's session ---------------------------------------------------------------------------


@pytest.fixture
def both_sessions(rotor_session, rotor3):
    with FmuSession(rotor3) as session3:
        yield rotor_session, session3


def test_a_session_measures_the_same_through_either_version(both_sessions):
    start = {"force_amplitude": 1.0, "force_frequency": 60.0, "rigid_support": True, "excitation_node": 3}
    outputs = ["node_2.acceleration_y", "node_4.acceleration_z", "force_applied"]
    readings = []
    for session in both_sessions:
        session.start(start)
        session.step(0.1)
        session.set({"k_b": 5e6})
        readings.append(session.sample(outputs, 1e-3, 50))
        assert session.get(["excitation_node", "rigid_support", "k_b"]) == [3, True, 5e6]
        assert [session.kind(name) for name in ("k_b", "excitation_node", "rigid_support")] == [
            "Real", "Integer", "Boolean",
        ]  # fmt: skip
    assert_array_equal(*readings)


def test_a_session_goes_back_through_either_version(both_sessions):
    for session in both_sessions:
        session.start({"force_amplitude": 1.0, "force_frequency": 60.0})
        session.step(0.1)
        saved = session.save_state()
        first = session.sample(["node_2.acceleration_y"], 1e-3, 20)
        session.restore_state(saved)
        assert session.time == pytest.approx(0.1)
        assert_array_equal(session.sample(["node_2.acceleration_y"], 1e-3, 20), first)


def test_a_session_hears_why_a_value_is_refused(both_sessions):
    for session in both_sessions:
        session.start()
        with pytest.raises(FmuError, match="k_b"):
            session.set({"k_b": -1.0})
        with pytest.raises(FmuError, match="communication step"):
            session.sample(["node_2.acceleration_y"], -1.0, 2)


def test_a_sweep_is_the_same_through_either_version(both_sessions):
    plan = SweepPlan(f_min_hz=80.0, f_max_hz=110.0, n_lines=8)
    first, second = (sweep(session, Rig("bearing"), plan).run for session in both_sessions)
    assert_array_equal(first.H, second.H)
