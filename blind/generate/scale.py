"""How large a rig is, in mass, length and time, over the rig that the ranges of effects are written for."""

from __future__ import annotations

from dataclasses import dataclass

# Powers of mass, length and time in a unit.
UNITS = {
    "1": (0, 0, 0),
    "kg": (1, 0, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "N": (1, 1, -2),
    "N/m": (1, 0, -2),
    "N s/m": (1, 0, -1),
    "N m/rad": (1, 2, -2),
    "N/m3": (1, -2, -2),
}


@dataclass(frozen=True)
class Scale:
    """Mass, length and time of a rig over those of another.

    >>> Scale(mass=8.0, time=0.5).of("N/m")
    32.0
    """

    mass: float = 1.0
    length: float = 1.0
    time: float = 1.0

    def of(self, unit: str) -> float:
        """What a quantity of this unit grows by; raises KeyError for a unit that is not in ``UNITS``."""
        mass, length, time = UNITS[unit]
        return self.mass**mass * self.length**length * self.time**time
