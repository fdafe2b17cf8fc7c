"""The base class of effects: something that a real rig may have and the nominal rotor does not have.

Each effect is one small frozen dataclass. Its fields are its parameters and its place. It acts by one
of four methods, which change nothing by default:

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
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.design import Design

# Name, among an effect's variables in the FMU, of the one that switches it on.
SWITCH = "enabled"

# Starts of a number that puts a resonance, or a beat, somewhere: between two of them it must not be missed.
MANY_STARTS = (0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9)


@dataclass(frozen=True)
class Parameter:
    """A number that says how strong an effect is.

    ``low`` to ``high`` is the prior range in the rig's own scale (``scale.RigScale``), ``minimum`` and ``maximum`` what
    is physically possible, in SI. A diagnosis fits a number that changes the form of a law (``form``) only
    where the plain law is not enough. ``null`` is the value at which the effect does nothing: a number,
    a limit (inf), the name of the entry of the test condition that it replaces, or None where another
    parameter decides.
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
    amplitude: int = 0  # the power of the force that its range follows, if it matters in motions of some size only
    sign_seen_across: bool = False  # whether only a sensor that looks across the force tells its sign
    starts: tuple[float, ...] = ()  # shares of its range where fits start, where the usual ones miss something
    step: float = 1e-5  # share of its range for a derivative: less where a response follows it wildly
    grid: int = 8  # points along it in a grid over a force law's numbers
    vague: bool = False  # whether coarsely computed motions hardly tell it
    motion_power: int = 0  # the power of its node's motion that it grows with, when a law moves to another node


@dataclass(frozen=True)
class Place:
    """A node, or a position along the shaft, that an effect sits at."""

    meaning: str
    kind: str = "node"  # or "position" [m]
    all_nodes: bool = False  # whether node 0 stands for all nodes,
    exciter: bool = False  # or for the exciter's, wherever it drives

    @property
    def first(self) -> int:
        """Its lowest node."""
        return 0 if self.all_nodes or self.exciter else 1


def parameter(start: float, unit: str, meaning: str, low: float, high: float, **options: Any) -> Any:
    """Dataclass field of a parameter; see ``Parameter``."""
    return field(default=start, metadata={"role": Parameter(unit, meaning, low, high, **options)})


def node(start: int, meaning: str, *, all_nodes: bool = False, exciter: bool = False) -> Any:
    """Dataclass field of a node, counted from 1; see ``Place``."""
    return field(default=start, metadata={"role": Place(meaning, "node", all_nodes, exciter)})


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
    is_candidate: ClassVar[bool] = True  # whether a diagnosis may name it as a cause
    acts_at_once: ClassVar[bool] = False  # on the accelerations of a rotor at rest, when a force sets in
    rides_on_sensor: ClassVar[bool] = False  # whether it is at a node only while that node's sensor is read
    reads_beside_node: ClassVar[bool] = False  # whether a sensor reads another place than its node
    turns_with_shaft: ClassVar[bool] = False  # whether it is a force at the spin frequency
    remedy: ClassVar[str] = ""  # how to measure again without it, where it is the way of measuring that is wrong
    moves_response: ClassVar[bool] = True  # whether it changes the response at the lines that are measured
    needs_exciter_current: ClassVar[bool] = False  # whether only tests at constant exciter current show it
    needs_phase: ClassVar[bool] = False  # whether magnitudes alone do not show it
    common_is_calibrated: ClassVar[bool] = False  # whether on all sensors at once it is a gain of the force
    acts_beyond_amplitude: ClassVar[bool] = False  # whether it is not there at all in small motions
    shares_k_b: ClassVar[bool] = False  # whether it takes a part of the bearing stiffness at rest
    stiffness_at_rest: ClassVar[tuple[float, ...]] = (1.0,)  # over the one that suits the lowest force level
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
        """The effect at severity zero; a limit at infinity is replaced by a million times the start value."""
        values = {name: p.null for name, p in cls.parameters().items() if p.null is not None}
        for name, null in values.items():
            if isinstance(null, str):
                values[name] = getattr(condition, null)
            elif math.isinf(null):
                values[name] = 1e6 * getattr(cls, name)
        return cls(**values, **places)

    def sits_at(self, node: int) -> bool:
        """Whether it is at a node, or at all nodes."""
        return any(getattr(self, name) in (0, node) for name, place in self.places().items() if place.kind == "node")

    def moved_to(self, node: int) -> Effect:
        """The same at a node."""
        return replace(self, **{name: node for name, place in self.places().items() if place.kind == "node"})

    def start_values(self) -> dict[str, float | int | bool]:
        """FMU variables that switch the effect on, with their values.

        >>> EFFECTS["disk_mass"](change=0.05).start_values()
        {'disk_mass.enabled': True, 'disk_mass.change': 0.05}
        """
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
    if value != int(value) or value < role.first:
        raise ValueError(f"{name} must be a node number from {role.first}, got {value}")
