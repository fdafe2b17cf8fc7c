"""FMI 2.0 of the self-contained FMUs, as far as it is not what holds for pythonfmu's as well."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE


@pytest.fixture
def told(rotor_fmu: Path, tmp_path: Path) -> Iterator[tuple[FMU2Slave, list[str]]]:
    """An instance, and what it has told its host."""
    extract(str(rotor_fmu), str(tmp_path))
    guid = read_model_description(str(tmp_path)).guid
    messages: list[str] = []
    logger = fmi2CallbackLoggerTYPE(lambda *said: messages.append(said[-1].decode()))
    host = fmi2CallbackFunctions(
        logger, defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory, defaultCallbacks.stepFinished, None
    )
    slave = FMU2Slave(guid=guid, unzipDirectory=str(tmp_path), modelIdentifier="RotorRig", instanceName="one")
    slave.instantiate(callbacks=host)
    yield slave, messages
    slave.freeInstance()


@pytest.mark.parametrize(
    "call",
    [
        lambda slave: slave.fmi2GetReal(slave.component, None, 1, None),
        lambda slave: slave.fmi2SetReal(slave.component, None, 1, None),
        lambda slave: slave.fmi2SetBoolean(slave.component, None, 1, None),
        lambda slave: slave.fmi2GetString(slave.component, None, 1, None),
        lambda slave: slave.fmi2GetFMUstate(slave.component, None),
    ],
)
def test_a_null_pointer_is_refused_with_a_sentence(told, call):
    slave, messages = told
    with pytest.raises(FMICallException):
        call(slave)
    assert len(messages) == 1
    assert "an argument that is needed is a null pointer" in messages[0]
    slave.fmi2GetReal(slave.component, None, 0, None)  # of nothing nothing is needed
    assert len(messages) == 1
