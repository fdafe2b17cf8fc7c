"""One FMU instance from unzip to free, driven through fmpy's co-simulation interfaces, FMI 2.0 and FMI 3.0."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.model_description import ScalarVariable

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.scratch import Scratch
from rigtwin.sim.archive import FmuError, describe_unpacked, unpack
from rigtwin.sim.instances import FAILED, INTEGERS, KINDS, Instance, instance

__all__ = ["FmuError", "FmuSession", "SavedState"]

# pythonfmu's loader reads its resources from a file URI of which it decodes only %20; any other
# escaped character is a segmentation fault.
_SAFE_PATH = re.compile(r"[A-Za-z0-9_./\\: ~-]+")

# Messages of an FMU that are kept for the one that goes with an error.
_MESSAGES = 20


@dataclass(frozen=True)
class SavedState:
    """A state of an FMU, serialised."""

    time: float  # [s]
    content: bytes


class FmuSession:
    """One instance of an FMU, which is reset between runs; use it as a context manager.

    Parameters
    ----------
    fmu : path of the .fmu file

    Raises
    ------
    FmuError : the file cannot be read, loaded or instantiated
    """

    def __init__(self, fmu: str | Path):
        self._log: deque[str] = deque(maxlen=_MESSAGES)
        self._scratch = _new_folder()  # is removed when nothing holds it any longer
        self._folder = self._scratch.path
        try:
            unpack(fmu, self._folder)
            self.description = describe_unpacked(fmu, self._folder)
            self._variables = {v.name: v for v in self.description.modelVariables}
            self._fmu = self._instantiate()
        except BaseException:
            self._scratch.close()
            raise
        self._open = True
        self.time = 0.0
        self._fresh = True

    def __enter__(self) -> FmuSession:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the instance and delete the unpacked files; closing again does nothing."""
        if self._open:  # freeing an instance twice is a segmentation fault
            self._open = False
            try:
                self._fmu.freeInstance()
            finally:
                self._scratch.close()

    @property
    def variables(self) -> list[str]:
        """Names of all variables."""
        return list(self._variables)

    def kind(self, name: str) -> str:
        """Type of a variable, see ``kind_of``."""
        return kind_of(self._variable(name))

    def start(self, values: Mapping[str, float | int | bool] | None = None) -> None:
        """(Re)start at time zero from rest with these start values.

        Raises FmuError when there is no such variable or the FMU refuses a value.
        """
        if not self._fresh:
            self._call(self._fmu.reset)
        self._fresh = False
        self.time = 0.0
        self._call(self._fmu.setupExperiment, startTime=0.0)
        self.set(values or {})
        self._call(self._fmu.enterInitializationMode)
        self._call(self._fmu.exitInitializationMode)

    def set(self, values: Mapping[str, float | int | bool]) -> None:
        """Set inputs or parameters by name."""
        for name, value in values.items():
            variable = self._variable(name)
            check_integer(variable, value)
            setter = getattr(self._fmu, f"set{variable.type}")
            self._call(setter, [variable.valueReference], [value])

    def get(self, names: Sequence[str]) -> list[Any]:
        """Current values by name."""
        variables = [self._variable(n) for n in names]
        return [self._call(getattr(self._fmu, f"get{v.type}"), [v.valueReference])[0] for v in variables]

    def step(self, h: float) -> None:
        """One communication step of h seconds."""
        self._call(self._fmu.doStep, self.time, h, False)  # an earlier state may be set again
        self.time += h

    def save_state(self) -> SavedState:
        """Everything the instance holds. Raises FmuError where the FMU cannot save its state."""
        state = self._call(self._fmu.getFMUstate)
        try:
            return SavedState(self.time, self._call(self._fmu.serializeFMUstate, state))
        finally:
            self._call(self._fmu.freeFMUstate, state)

    def restore_state(self, saved: SavedState) -> None:
        """Go back to a saved state, its time included."""
        state = self._call(self._fmu.deSerializeFMUstate, saved.content, None)
        try:
            self._call(self._fmu.setFMUstate, state)
        finally:
            self._call(self._fmu.freeFMUstate, state)
        self.time = saved.time

    def sample(self, outputs: Sequence[str], h: float, n: int) -> FloatArray:
        """Read Real outputs now and after each of n - 1 further steps of h seconds.

        Returns
        -------
        (n, n_outputs) values; the instance then stands n - 1 steps later
        """
        self._require_open()
        values, start = np.empty((n, len(outputs))), self.time
        step = self._fmu.stepping()
        read = self._fmu.reading([self._variable(o).valueReference for o in outputs], values)
        for row in range(n):
            if row and (status := step(start + (row - 1) * h, h)) >= FAILED:
                raise self._error(FMICallException(function="doStep", status=status))
            if (status := read(row)) >= FAILED:
                raise self._error(FMICallException(function="getReal", status=status))
        self.time = start + (n - 1) * h
        return values

    def play(self, name: str, values: FloatArray, outputs: Sequence[str], h: float) -> FloatArray:
        """Set a Real input before each step of h seconds, and read Real outputs before it, too.

        Parameters
        ----------
        name, values : the input, and its values (n,)

        Returns
        -------
        (n, n_outputs) values; the instance then stands n steps later
        """
        self._require_open()
        told, start = np.empty((len(values), len(outputs))), self.time
        step, give = self._fmu.stepping(), self._fmu.giving(self._variable(name).valueReference)
        read = self._fmu.reading([self._variable(o).valueReference for o in outputs], told)
        for row, value in enumerate(values.tolist()):
            if (status := max(give(value), read(row), step(start + row * h, h))) >= FAILED:
                raise self._error(FMICallException(function="setting, reading or doStep", status=status))
        self.time = start + len(values) * h
        return told

    def _require_open(self) -> None:
        if not self._open:  # a call on a freed instance is a segmentation fault
            raise FmuError(f"the session of {self.description.modelName} is closed; open a new one")

    def _variable(self, name: str) -> Any:
        if name not in self._variables:
            raise FmuError(f"{self.description.modelName} has no variable {name!r}")
        return self._variables[name]

    def _instantiate(self) -> Instance:
        try:
            with chdir(Path.cwd()):  # fmpy stays in the FMU's own folder when its library does not load
                fmu = instance(self.description, str(self._folder))
            fmu.begin(self._log.append)
        except Exception as error:  # fmpy raises bare Exception here
            raise self._error(error) from error
        return fmu

    def _call(self, function: Any, *arguments: Any, **options: Any) -> Any:
        self._require_open()
        try:
            return function(*arguments, **options)
        except FMICallException as error:
            raise self._error(error) from error

    def _error(self, error: Exception) -> FmuError:
        log = " ".join(self._log)
        self._log.clear()
        return FmuError(f"{error}: {log}" if log else str(error))


def kind_of(variable: ScalarVariable) -> str:
    """Type of a variable: "Real", "Integer", "Boolean" or "String", of FMI 3.0 any other that it has."""
    kind = str(variable.type)
    return KINDS.get(kind, kind)


def check_integer(variable: ScalarVariable, value: float | int | bool) -> None:
    """Raises FmuError for a whole number that the variable's type cannot hold; ctypes would let it wrap."""
    if (lowest_highest := INTEGERS.get(str(variable.type))) is None:
        return
    lowest, highest = lowest_highest
    if not lowest <= value <= highest:
        least, most = variable.min or lowest, variable.max or highest
        raise FmuError(f"{variable.name} = {value} is out of range: it takes {least} to {most}")


def _new_folder() -> Scratch:
    scratch = Scratch("fmu_")
    if not _SAFE_PATH.fullmatch(str(scratch.path)):
        scratch.close()
        raise FmuError(
            f"the folder for temporary files, {scratch.path}, has characters FMU loaders cannot read; set TMPDIR"
        )
    return scratch
