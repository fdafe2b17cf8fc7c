"""What an effect is: something reality may have and the nominal rotor lacks.

One small frozen dataclass per effect. Its fields are its parameters and its place; what it adds it
says in one of four ways, each the identity by default:

- ``add_to``: matrices, degrees of freedom, force laws, written into the design of the rotor;
- ``channel_factor``: what a sensor chain does to a response;
- ``force_factor``: what the exciter does to the force that was asked for;
- ``sweep_changes``: how the sweep is run.

Every solver and the FMU read the same object, and so do the command line and the documentation.
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.design import Design
from rigtwin.rotor.model.structure import ComplexArray, FloatArray

# Name, among an effect's variables in the FMU, of the one that switches it on.
SWITCH = "enabled"


@dataclass(frozen=True)
class Parameter:
    """A number that says how strong an effect is.

    ``low`` to ``high`` is the prior range for the paper's rotor, ``minimum`` and ``maximum`` what
    is physically possible. A diagnosis fits a number that bends a law (``form``) only where the plain
    law is not enough. ``null`` is where the effect does nothing: a value, a limit (inf), the
    name of the test condition's entry it replaces, or None where another parameter decides.
    """

    unit: str
    meaning: str
    low: float
    high: float
    null: float | str | None = None
    minimum: float | None = None
    maximum: float | None = None
    log: bool = False  # whether the prior is even in the logarithm
    form: bool = False  # whether it bends the law, and may change the size of the equations where the effect does


@dataclass(frozen=True)
class Place:
    """A node, or a position along the shaft, that an effect sits at. Node 0 stands for all nodes."""

    meaning: str
    kind: str = "node"  # or "position" [m]
    all_nodes: bool = False


def parameter(start: float, unit: str, meaning: str, low: float, high: float, **options: Any) -> Any:
    """Dataclass field of a parameter; see ``Parameter``."""
    return field(default=start, metadata={"role": Parameter(unit, meaning, low, high, **options)})


def node(start: int, meaning: str, *, all_nodes: bool = False) -> Any:
    """Dataclass field of a node, counted from 1."""
    return field(default=start, metadata={"role": Place(meaning, "node", all_nodes)})


def position(start: float, meaning: str) -> Any:
    """Dataclass field of a position along the shaft [m]."""
    return field(default=start, metadata={"role": Place(meaning, "position")})


@dataclass(frozen=True)
class Effect(ABC):
    """Base of all effects. Raises ValueError for values that are not physical."""

    id: ClassVar[str]
    title: ClassVar[str]
    meaning: ClassVar[str]  # one line: the physics
    equation: ClassVar[str]  # LaTeX
    signature: ClassVar[str]  # what it looks like in a measurement
    source: ClassVar[str]  # key in docs/references.bib
    location: ClassVar[str]  # kind of place: node, position, bearings, disks, shaft, sensor, exciter, ...
    family: ClassVar[str]  # structure, support, nonlinear, chain, spinning
    changes_size: ClassVar[bool] = False  # of the equations: not to be switched while the rotor runs
    in_fmu: ClassVar[bool] = True
    acts_at_once: ClassVar[bool] = False  # on the accelerations of a rotor at rest, when a force sets in
    needs_finer_mesh: ClassVar[bool] = False  # it acts inside an element, so that the elements' length shows
    moves_resonances: ClassVar[bool] = True  # and not only how high and wide they are
    couples_planes: ClassVar[bool] = False  # the rotor moves across the force too

    def __post_init__(self) -> None:
        for name, role in self.roles().items():
            value = getattr(self, name)
            if isinstance(role, Parameter):
                _check_parameter(self.full_name(name), value, role)
            elif role.kind == "node":
                _check_node(self.full_name(name), value, role)
            elif not math.isfinite(value):
                raise ValueError(f"{self.full_name(name)} must be a finite position in m, got {value}")

    @classmethod
    def full_name(cls, name: str) -> str:
        """A field, or ``SWITCH``, as the FMU, the command line and messages call it."""
        return f"{cls.id}.{name}"

    @classmethod
    def roles(cls) -> Mapping[str, Parameter | Place]:
        """What each field is, by name."""
        return {f.name: f.metadata["role"] for f in fields(cls)}

    @classmethod
    def parameters(cls) -> Mapping[str, Parameter]:
        """Parameters by name."""
        return {name: role for name, role in cls.roles().items() if isinstance(role, Parameter)}

    @classmethod
    def places(cls) -> Mapping[str, Place]:
        """Places by name."""
        return {name: role for name, role in cls.roles().items() if isinstance(role, Place)}

    @classmethod
    def identity(cls, condition: Condition, **places: Any) -> Effect:
        """The effect at severity zero; a limit at infinity is replaced by a million times the prior's end."""
        values = {name: p.null for name, p in cls.parameters().items() if p.null is not None}
        for name, null in values.items():
            if isinstance(null, str):
                values[name] = getattr(condition, null)
            elif math.isinf(null):
                values[name] = 1e6 * cls.parameters()[name].high
        return cls(**values, **places)

    def start_values(self) -> dict[str, float | int | bool]:
        """FMU variables that switch the effect on, with their values."""
        return {self.full_name(SWITCH): True, **{self.full_name(name): getattr(self, name) for name in self.roles()}}

    def add_to(self, design: Design) -> None:  # noqa: B027
        """Write into the design of the rotor what the effect changes."""

    def channel_factor(self, omega: FloatArray, channel_node: int) -> ComplexArray:
        """(n_freq,) factor between what a node does and what its sensor chain reports."""
        return np.ones(len(omega), dtype=complex)

    def force_factor(self, omega: FloatArray, drive_receptance: ComplexArray) -> ComplexArray:
        """(n_freq,) force on the rotor over the force that was asked for.

        Parameters
        ----------
        omega : (n_freq,) [rad/s]
        drive_receptance : (n_freq,) receptance of the rotor at the exciter [m/N]
        """
        return np.ones(len(omega), dtype=complex)

    def sweep_changes(self) -> Mapping[str, float]:
        """Changes to how the sweep is run: ``step_hz`` or ``dwell_s``."""
        return {}


def _check_parameter(name: str, value: float, role: Parameter) -> None:
    unit = "" if role.unit == "1" else f" {role.unit}"
    if not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, got {value}")
    if role.minimum is not None and value < role.minimum:
        raise ValueError(f"{name} must be at least {role.minimum:g}{unit}, got {value:g}")
    if role.maximum is not None and value > role.maximum:
        raise ValueError(f"{name} must be at most {role.maximum:g}{unit}, got {value:g}")


def _check_node(name: str, value: int, role: Place) -> None:
    least = 0 if role.all_nodes else 1
    if value != int(value) or value < least:
        raise ValueError(f"{name} must be a node number from {least}, got {value}")
