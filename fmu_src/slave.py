"""A pythonfmu slave driven by a variable table.

It adds what the stock slave lacks: checked values, a complete model description (units, ranges,
dependencies, InitialUnknowns, a GUID derived from the content), and a state that holds everything.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import math
import os
import sys
from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import cache, wraps
from pathlib import Path
from typing import Any, NoReturn
from uuid import UUID
from xml.etree.ElementTree import Element

from pythonfmu.fmi2slave import Fmi2Slave

from rigtwin.fmu_src.model_description import Model, fmi2, variability
from rigtwin.fmu_src.variables import Variable

# Phases of an instance, in the words of a refusal.
_SET_UP, _RUNNING, _ENDED = "before the simulation", "during the simulation", "after the end of the simulation"

# Largest excess of a step's end over the stop time: in steps, and relative to the time.
_SAME_STEP, _SAME_STOP = 1e-6, 1e-9

_FOREIGN_STATE = "this is not a state that this FMU saved"

_KINDS = ("Real", "Integer", "Boolean", "String")

# What pythonfmu's glue calls on an instance.
_HOST_CALLS = (
    *("setup_experiment", "enter_initialization_mode", "exit_initialization_mode", "do_step", "terminate"),
    *(f"{verb}_{kind}" for verb in ("get", "set") for kind in ("real", "integer", "boolean", "string")),
    *("_get_fmu_state", "_set_fmu_state"),
)


def _survives_errors(method: Callable[..., Any]) -> Callable[..., Any]:
    """A call from the host that leaves the instance alive when it raises.

    pythonfmu's glue drops its references to the instance, its class and its log when a call
    raises, and drops them again when the instance is freed. Taking one more of each keeps the
    instance alive and the host from crashing: for a refused value, for a warning that the host
    turned into an error, and for most of Ctrl-C (an interrupt at the very entry is raised before
    this can see it).
    """

    @wraps(method)
    def call(self: TableSlave, *arguments: Any) -> Any:
        try:
            return method(self, *arguments)
        except BaseException as error:
            for held in (self, type(self), self.log_queue):
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(held))
            if not isinstance(error, ValueError):
                raise
            raise ValueError(
                f"{self.instance_name}: {error}. The call has no effect; the instance is still usable."
            ) from error

    return call


class TableSlave(Fmi2Slave):
    """Holds the values of a variable table; a subclass computes its outputs.

    Set values are refused with a sentence in the FMI log: the call returns fmi2Fatal (the only
    failure pythonfmu can return from a set call), and the instance keeps its last good values.
    """

    def __init__(
        self, variables: Sequence[Variable], description: str, step_size: float, tolerance: float, **kwargs: Any
    ):
        super().__init__(**kwargs)
        manifest = read_manifest(Path(kwargs["resources"]))
        self.guid = UUID(manifest["guid"])
        self.version = manifest["version"]
        self.description = description
        self._table = tuple(variables)
        name, described = type(self).__name__, (manifest["guid"], manifest["version"], description, step_size)
        self._description = Model(name, *described, self._table, tolerance=tolerance)
        self._number = {v.name: number for number, v in enumerate(self._table)}
        self._references = {
            kind: frozenset(number for number, v in enumerate(self._table) if v.kind == kind) for kind in _KINDS
        }
        self._values: list[Any] = [_start_value(v) for v in self._table]
        self._phase = _SET_UP
        self._stop = math.inf
        self._stale = True
        _end_glue_early(Path(kwargs["resources"]).parent / "binaries" / "linux64" / f"{self.modelName}.so")

    def __init_subclass__(cls, **kwargs: Any):
        super().__init_subclass__(**kwargs)
        for name in _HOST_CALLS:
            setattr(cls, name, _survives_errors(getattr(cls, name)))

    # -- what a subclass provides --------------------------------------------------------------

    @abstractmethod
    def compute_outputs(self) -> Sequence[float | bool]:
        """Values of all outputs, in the order of the table."""

    @abstractmethod
    def advance(self, time: float, h: float) -> None:
        """One communication step of h > 0 from this time on [s], both finite; raise ValueError to refuse."""

    def start_at(self, time: float) -> None:
        """Called with the start time [s]; raise ValueError to refuse."""

    def accept_settings(self, changed: Sequence[Variable]) -> None:
        """Called after every set call with what was set; raise ValueError to refuse."""

    def save_state(self) -> Any:
        """State beside the variables' values, in JSON types."""
        return None

    def load_state(self, state: Any) -> None:
        """Take up what ``save_state`` gave."""

    def value(self, name: str) -> Any:
        """Current value of a variable."""
        return self._values[self._number[name]]

    # -- FMI life cycle ------------------------------------------------------------------------

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Set the clock, and the time beyond which no step goes."""
        self._only(_SET_UP, "setting the start time")
        if stop_time is not None and not stop_time >= start_time:
            self.refuse(
                f"the stop time must not lie before the start time of {start_time:.9g} s, got {stop_time:.9g} s"
            )
        self.start_at(start_time)
        self._stop = math.inf if stop_time is None else stop_time

    def exit_initialization_mode(self) -> None:
        """From here on fixed parameters are refused."""
        self._only(_SET_UP, "the end of the initialization")
        self._phase = _RUNNING

    def do_step(self, current_time: float, step_size: float) -> bool:
        """One communication step of any length above zero."""
        self._only(_RUNNING, "a step")
        end, excess = current_time + step_size, _SAME_STEP * abs(step_size) + _SAME_STOP * max(1.0, abs(self._stop))
        if end - self._stop > excess:
            self.refuse(f"a step to {end:.9g} s goes beyond the stop time of {self._stop:.9g} s")
        if not math.isfinite(end):
            self.refuse(f"the communication step must be finite, got {step_size:.9g} s at {current_time:.9g} s")
        if not step_size > 0:
            self.refuse(f"the communication step must be positive, got {step_size:.9g} s")
        self.advance(current_time, step_size)
        self._stale = True
        return True

    def terminate(self) -> None:
        """From here on there are no steps."""
        self._phase = _ENDED

    def _only(self, phase: str, what: str) -> None:
        if self._phase != phase:
            self.refuse(f"{what} is not possible {self._phase}")

    # -- getting and setting -------------------------------------------------------------------

    def get_real(self, vrs: list[int]) -> list[float]:
        """Values by value reference; outputs are brought up to date first."""
        return self._get(vrs, "Real")

    def get_integer(self, vrs: list[int]) -> list[int]:
        """See ``get_real``."""
        return self._get(vrs, "Integer")

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        """See ``get_real``."""
        return self._get(vrs, "Boolean")

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set values by value reference; all or none."""
        self._set(vrs, values, "Real")

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        """See ``set_real``."""
        self._set(vrs, values, "Integer")

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        """See ``set_real``."""
        self._set(vrs, [bool(v) for v in values], "Boolean")

    def get_string(self, vrs: list[int]) -> list[str]:
        """There are no strings."""
        return self._get(vrs, "String")

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        """There are no strings."""
        self._set(vrs, values, "String")

    def _get(self, vrs: list[int], kind: str) -> list[Any]:
        self._check_references(vrs, kind)
        if self._stale:
            self._refresh()
        values = self._values
        return [values[vr] for vr in vrs]

    def _refresh(self) -> None:
        outputs = self.compute_outputs()
        self._values[len(self._values) - len(outputs) :] = outputs
        self._stale = False

    def _set(self, vrs: list[int], values: list[Any], kind: str) -> None:
        self._check_references(vrs, kind)
        for vr, value in zip(vrs, values, strict=True):
            self._check_settable(self._table[vr], value)
        before = list(self._values)
        for vr, value in zip(vrs, values, strict=True):
            self._values[vr] = value
        self._stale = True
        try:
            self.accept_settings([self._table[vr] for vr in vrs])
        except BaseException:
            self._values = before
            raise

    def _check_references(self, vrs: list[int], kind: str) -> None:
        if not self._references[kind].issuperset(vrs):
            unknown = min(set(vrs) - self._references[kind]) % 2**32  # the glue hands over a signed number
            self.refuse(f"there is no {kind} variable with value reference {unknown}")

    def _check_settable(self, variable: Variable, value: Any) -> None:
        if variable.causality == "output":
            self.refuse(f"{variable.name} is an output and cannot be set")
        if self._phase == _ENDED:
            self.refuse(f"{variable.name} cannot be set after the end of the simulation")
        if self._phase != _SET_UP and variability(variable) == "fixed":
            self.refuse(f"{variable.name} can only be set before the simulation starts")
        reason = variable.refusal(value)
        if reason:
            self.refuse(reason)

    def refuse(self, reason: str) -> NoReturn:
        """Fail this call with a sentence in the FMI log; the instance stays as it was."""
        raise ValueError(reason)

    # -- state ---------------------------------------------------------------------------------

    def _get_fmu_state(self) -> dict[str, Any]:
        return {"guid": str(self.guid), "values": list(self._values), "phase": self._phase, "state": self.save_state()}

    def _set_fmu_state(self, state: dict[str, Any] | None) -> None:
        if state is None or state.get("guid") != str(self.guid):
            self.refuse(_FOREIGN_STATE)
        before = self._values
        try:
            phase, self._values = state["phase"], list(state["values"])
            if len(self._values) != len(before):
                self.refuse(_FOREIGN_STATE)
            self.load_state(state["state"])
        except BaseException as error:
            self._values = before
            if isinstance(error, (LookupError, TypeError, AttributeError)):
                self.refuse(_FOREIGN_STATE)
            raise
        self._phase, self._stale = phase, True

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> dict[str, Any] | None:
        """None for what cannot be read: only setting the state can refuse it without harm to the instance."""
        try:
            content = json.loads(state)
        except (ValueError, RecursionError):
            return None
        return content if isinstance(content, dict) else None

    # -- model description ---------------------------------------------------------------------

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """The complete FMI 2.0 model description; the same sources give the same one."""
        return fmi2(self._description, needs_execution_tool=True)


def read_manifest(resources: Path) -> dict[str, Any]:
    """The FMU's own facts, written when it was built: GUID, version, and what its model needs."""
    return json.loads((resources / "manifest.json").read_text(encoding="utf-8"))


@cache
def _end_glue_early(library: Path) -> None:
    """Make the glue library end its interpreter state before the process runs its exit handlers.

    It frees that state in a static destructor and again in a library destructor: a use after free
    that now and then aborts the host when all its work is done. Its own finaliser, called first,
    leaves both nothing to free.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        glue = ctypes.CDLL(str(library), mode=os.RTLD_NOW | os.RTLD_NOLOAD)
    except OSError:  # not loaded: the FMU is being built
        return
    atexit.register(glue.finalizePythonInterpreter)


def _start_value(variable: Variable) -> Any:
    if variable.start is not None:
        return variable.start
    return {"Boolean": False, "Integer": 0}.get(variable.kind, 0.0)
