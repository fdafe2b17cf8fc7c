"""Co-simulation instances of fmpy for FMI 2.0 and FMI 3.0, both with the method names of FMI 2.0."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import byref
from pathlib import Path

from fmpy import platform_tuple, sharedLibraryExtension
from fmpy.fmi2 import (
    FMU2Slave,
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    fmi2Real,
    fmi2ValueReference,
)
from fmpy.fmi3 import FMU3Slave, fmi3Boolean, fmi3Float64, fmi3ValueReference
from fmpy.model_description import ModelDescription

from rigtwin.rotor.model.arrays import FloatArray

# FMI 2.0's words for the types of FMI 3.0 that have one.
KINDS = {"Float64": "Real", "Int32": "Integer"}

# Lowest and highest value of every type of whole numbers, of either version.
INTEGERS = {f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)}
INTEGERS |= {f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)}
INTEGERS |= dict.fromkeys(("Integer", "Enumeration"), INTEGERS["Int32"])

# Status of a call, of either version, from which it has failed.
FAILED = 2

Log = Callable[[str], None]


def _taking(log: Log) -> Callable[..., None]:
    """The callback of a logger, whose last argument is the message in either version."""
    return lambda *about: log(about[-1].decode("utf-8", errors="replace"))


# fmpy reads the version off the beginning of a class' name.


class FMU2Instance(FMU2Slave):
    """FMI 2.0."""

    getEnumeration = FMU2Slave.getInteger
    setEnumeration = FMU2Slave.setInteger

    def begin(self, log: Log) -> None:
        """Instantiate; log gets every message."""
        own = fmi2CallbackFunctions(
            logger=fmi2CallbackLoggerTYPE(_taking(log)),
            allocateMemory=defaultCallbacks.allocateMemory,
            freeMemory=defaultCallbacks.freeMemory,
        )
        self.instantiate(callbacks=own, loggingOn=True)

    # fmpy's wrapper of a call takes longer than a step of the compiled FMU.

    def stepping(self) -> Callable[[float, float], int]:
        """doStep without fmpy's wrapper: takes time and size, returns the status."""
        call, component = self.dll.fmi2DoStep, self.component
        return lambda time, h: call(component, time, h, 0)  # an earlier state may be set again

    def reading(self, references: Sequence[int], values: FloatArray) -> Callable[[int], int]:
        """The same of getReal: reads into a row of values (n, n_references), returns the status."""
        call, component, size = self.dll.fmi2GetReal, self.component, len(references)
        asked, rows = (fmi2ValueReference * size)(*references), (fmi2Real * size * len(values)).from_buffer(values.data)
        return lambda row: call(component, asked, size, rows[row])

    def giving(self, reference: int) -> Callable[[float], int]:
        """The same of setReal: sets one variable, returns the status."""
        call, component = self.dll.fmi2SetReal, self.component
        asked, given = (fmi2ValueReference * 1)(reference), (fmi2Real * 1)()

        def give(value: float) -> int:
            given[0] = value
            return call(component, asked, 1, given)

        return give


class FMU3Instance(FMU3Slave):
    """FMI 3.0."""

    getEnumeration = FMU3Slave.getInt64
    setEnumeration = FMU3Slave.setInt64
    getFMUstate = FMU3Slave.getFMUState
    setFMUstate = FMU3Slave.setFMUState
    freeFMUstate = FMU3Slave.freeFMUState
    serializeFMUstate = FMU3Slave.serializeFMUState
    deSerializeFMUstate = FMU3Slave.deserializeFMUState

    def begin(self, log: Log) -> None:
        """Instantiate; log gets every message."""
        self.instantiate(loggingOn=True, logMessage=_taking(log))

    def setupExperiment(self, startTime: float) -> None:
        """Nothing: the start time, zero, is an argument of enterInitializationMode."""

    def stepping(self) -> Callable[[float, float], int]:
        """doStep without fmpy's wrapper: takes time and size, returns the status."""
        call, component = self.dll.fmi3DoStep, self.component
        flags = [byref(fmi3Boolean()) for _ in range(3)]  # events, an end, an early return: none is offered
        last = byref(fmi3Float64())
        return lambda time, h: call(component, time, h, False, *flags, last)  # an earlier state may be set again

    def reading(self, references: Sequence[int], values: FloatArray) -> Callable[[int], int]:
        """The same of getFloat64: reads into a row of values (n, n_references), returns the status."""
        call, component, size = self.dll.fmi3GetFloat64, self.component, len(references)
        asked = (fmi3ValueReference * size)(*references)
        rows = (fmi3Float64 * size * len(values)).from_buffer(values.data)
        return lambda row: call(component, asked, size, rows[row], size)

    def giving(self, reference: int) -> Callable[[float], int]:
        """The same of setFloat64: sets one variable, returns the status."""
        call, component = self.dll.fmi3SetFloat64, self.component
        asked, given = (fmi3ValueReference * 1)(reference), (fmi3Float64 * 1)()

        def give(value: float) -> int:
            given[0] = value
            return call(component, asked, 1, given, 1)

        return give


Instance = FMU2Instance | FMU3Instance

_INSTANCES = {"2.0": FMU2Instance, "3.0": FMU3Instance}


def instance(description: ModelDescription, folder: str) -> Instance:
    """An instance of an unpacked FMU, not begun yet. Raises ValueError where it is not for co-simulation."""
    kind = _INSTANCES.get(str(description.fmiVersion))
    if description.coSimulation is None or kind is None:
        raise ValueError(f"{description.modelName} is not an FMI 2.0 or 3.0 co-simulation FMU")
    identifier = str(description.coSimulation.modelIdentifier)
    return kind(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=identifier,
        instanceName=description.modelName,
        **(_own_library(folder, identifier) if kind is FMU2Instance else {}),
    )


def _own_library(folder: str, identifier: str) -> dict[str, str]:
    """The binary of this processor, where an FMU 2.0 has one under the name that FMI 3.0 gives it.

    FMI 2.0 has names for x86 alone, and fmpy takes those on every processor.
    """
    library = Path(folder) / "binaries" / str(platform_tuple) / f"{identifier}{sharedLibraryExtension}"
    return {"libraryPath": str(library)} if library.is_file() else {}
