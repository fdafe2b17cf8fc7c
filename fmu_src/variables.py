"""What a variable of an FMU is: name, unit, range, start value. Everything else is derived.

The model description, the checks of incoming values and the HTML documentation all read the tables in
``rotor_variables`` and ``estimator_variables``; a test holds those of docs/contracts.md to them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

# FMI 2 unit definitions: exponents of the SI base units.
UNITS: dict[str, dict[str, int]] = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "N/m": {"kg": 1, "s": -2},
    "N.s/m": {"kg": 1, "s": -1},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N/m3": {"kg": 1, "m": -2, "s": -2},
    "kg": {"kg": 1},
    "kg.m": {"kg": 1, "m": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "Hz": {"s": -1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "m/s2": {"m": 1, "s": -2},
    "1": {},
}

# Units that people read a quantity in, and how many of them one SI unit is.
DISPLAY_UNITS: dict[str, tuple[str, float]] = {
    "N/m": ("MN/m", 1e-6),
    "rad": ("deg", 180 / math.pi),
    "rad/s": ("rpm", 30 / math.pi),
}


@dataclass(frozen=True)
class Variable:
    """One FMI variable. ``start`` decides the type: bool, int or float; outputs have none."""

    name: str
    causality: str  # "input", "parameter" or "output"
    description: str
    unit: str | None = None
    start: float | int | bool | None = None
    minimum: float | int | None = None
    maximum: float | int | None = None
    variability: str | None = None
    depends_on: tuple[str, ...] = ()  # inputs with a direct feedthrough to this output
    initially_depends_on: tuple[str, ...] = ()  # what its value at initialisation depends on
    boolean: bool = False
    labels: tuple[str, ...] = ()  # of an enumeration, whose first value is 0

    @property
    def kind(self) -> str:
        """FMI type: "Boolean", "Integer" or "Real"."""
        if self.boolean or isinstance(self.start, bool):
            return "Boolean"
        return "Integer" if self.labels or isinstance(self.start, int) else "Real"

    @property
    def type(self) -> str:
        """The same, or "Enumeration"."""
        return "Enumeration" if self.labels else self.kind

    def refusal(self, value: float) -> str | None:
        """Why this value cannot be set, as a sentence; None when it can."""
        unit = f" {self.unit}" if self.unit and self.unit != "1" else ""
        if value != value or value in (float("inf"), float("-inf")):
            return f"{self.name} must be a finite number, got {value}"
        if self.minimum is not None and value < self.minimum:
            return f"{self.name} must be at least {self.minimum:g}{unit}, got {value:g}"
        if self.maximum is not None and value > self.maximum:
            return f"{self.name} must be at most {self.maximum:g}{unit}, got {value:g}"
        return None


@dataclass(frozen=True)
class ArrayOutput:
    """Outputs that stand beside each other in the table, once more as one array (FMI 3)."""

    name: str
    description: str
    unit: str
    first: str  # name of the first scalar
    shape: tuple[int, ...]
