"""One test condition: how the rotor is held, driven and spun."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Largest damping that a bearing may have [N s/m].
MOST_BEARING_DAMPING = 1e9


@dataclass(frozen=True)
class Condition:
    """The parameters a test condition can change.

    k_b [N/m] and bearing_damping [N s/m] are those of every bearing, the same in y and z.
    ``rigid_support`` pins the bearings instead. shaft_damping_ratio [-] belongs to the shaft. The
    exciter acts at ``excitation_node`` (from 1) in ``excitation_plane`` (1 = y, 2 = z);
    spin_speed [rad/s] is about +x.

    >>> Condition(k_b=-1.0)
    Traceback (most recent call last):
        ...
    ValueError: k_b must be a positive stiffness in N/m, got -1.0
    """

    k_b: float = 1e7
    rigid_support: bool = False
    bearing_damping: float = 0.0
    shaft_damping_ratio: float = 0.001
    excitation_node: int = 2
    excitation_plane: int = 1
    spin_speed: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.k_b) and self.k_b > 0):
            raise ValueError(f"k_b must be a positive stiffness in N/m, got {self.k_b}")
        for name in ("bearing_damping", "shaft_damping_ratio"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must not be negative, got {value}")
