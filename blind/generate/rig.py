"""Geometry of a rig, read from its TOML by this room alone."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigtwin.blind.generate.scale import Scale

FloatArray = NDArray[np.floating[Any]]
ComplexArray = NDArray[np.complexfloating[Any, Any]]

SHIPPED_RIGS = Path(__file__).resolve().parents[2] / "rotor" / "rigs"


@dataclass(frozen=True)
class Segment:
    """A stretch of round shaft."""

    length: float  # [m]
    diameter: float  # [m]
    modulus: float  # [Pa]
    density: float  # [kg/m^3]
    poisson: float

    @property
    def area(self) -> float:  # [m^2]
        return math.pi * self.diameter**2 / 4

    @property
    def second_moment(self) -> float:  # [m^4]
        return math.pi * self.diameter**4 / 64

    @property
    def shear_stiffness(self) -> float:
        """Kappa G A [N] with Cowper's factor for a round bar, 6(1 + nu)/(7 + 6 nu)."""
        kappa = 6 * (1 + self.poisson) / (7 + 6 * self.poisson)
        return kappa * self.modulus / (2 * (1 + self.poisson)) * self.area


@dataclass(frozen=True)
class Disk:
    """A solid disk at a node; without ``tilts`` only its mass acts there."""

    node: int  # from 1
    diameter: float  # [m]
    thickness: float  # [m]
    density: float  # [kg/m^3]
    tilts: bool = False

    @property
    def mass(self) -> float:  # [kg]
        return self.density * math.pi * self.diameter**2 / 4 * self.thickness

    @property
    def diametral_inertia(self) -> float:  # [kg m^2]
        return self.mass * (self.diameter**2 / 16 + self.thickness**2 / 12)


@dataclass(frozen=True)
class Plan:
    """How a rig is tested."""

    band_hz: tuple[float, float]
    first_hz: float  # first resonance on rigid supports, to two digits: the rig's scale of time
    held_out_node: int  # where the exciter acts in runs that the diagnosis does not see


REFERENCE = "nit-rourkela"  # the rig that ranges are written for
PLANS = {
    REFERENCE: Plan((20.0, 400.0), 100.0, 4),
    "pump-overhung": Plan((9.0, 330.0), 46.0, 6),
    "spindle": Plan((150.0, 2400.0), 730.0, 6),
}


@dataclass(frozen=True)
class Rig:
    """A round shaft with solid disks on two bearings of unknown stiffness, and how it is tested."""

    name: str
    nodes: tuple[float, ...]  # [m] places of the rig nodes
    segments: tuple[Segment, ...]
    disks: tuple[Disk, ...]
    bearings: tuple[int, ...]  # nodes of the supports, left first
    drive_node: int  # where the exciter acts
    zeta: float  # damping ratio of the shaft, as the rig's file gives it
    c_b: float  # [N s/m] of each bearing, likewise
    plan: Plan
    scale: Scale = field(default_factory=Scale)

    @property
    def mass(self) -> float:
        """Of shaft and disks [kg]."""
        return sum(s.density * s.area * s.length for s in self.segments) + sum(d.mass for d in self.disks)

    @property
    def inner_nodes(self) -> tuple[int, ...]:
        """Nodes that are no bearings."""
        return tuple(n for n in range(1, len(self.nodes) + 1) if n not in self.bearings)


@cache
def read_rig(name: str) -> Rig:
    """A shipped rig by name; solid round segments, solid disks and two bearings are understood, no more.

    Raises ValueError for a rig that has anything else, and KeyError for one without a plan.
    """
    table = tomllib.loads((SHIPPED_RIGS / f"{name}.toml").read_text(encoding="utf-8"))
    _check(table)
    rig = Rig(
        table["name"],
        tuple(table["nodes_m"]),
        tuple(
            Segment(s["length_m"], s["diameter_m"], s["youngs_modulus_Pa"], s["density_kg_per_m3"], s["poisson"])
            for s in table["segment"]
        ),
        tuple(
            Disk(d["node"], d["diameter_m"], d["thickness_m"], d["density_kg_per_m3"], d.get("inertia", False))
            for d in table["disk"]
        ),
        tuple(s["node"] for s in table["support"]),
        table["excitation_node"],
        table["shaft_damping_ratio"],
        table.get("bearing_damping_Ns_per_m", 0.0),
        PLANS[name],
    )
    return replace(rig, scale=_scale(rig, rig if name == REFERENCE else read_rig(REFERENCE)))


def _check(table: Mapping[str, Any]) -> None:
    """Raises ValueError where a rig's file has something that this room does not model."""
    plain = {
        "segment": {"length_m", "diameter_m", "youngs_modulus_Pa", "density_kg_per_m3", "poisson"},
        "disk": {"node", "diameter_m", "thickness_m", "density_kg_per_m3", "inertia"},
        "support": {"node", "stiffness"},
        "mass": set(),
    }
    for kind, keys in plain.items():
        for entry in table.get(kind, []):
            if other := set(entry) - keys:
                raise ValueError(f"rig {table['name']}: a {kind} with {', '.join(sorted(other))} is not modelled")
    if [s["stiffness"] for s in table["support"]] != ["k_b", "k_b"]:
        raise ValueError(f"rig {table['name']}: two supports are needed, both bearings")


def _scale(rig: Rig, reference: Rig) -> Scale:
    """Exactly one for the reference itself."""
    return Scale(
        rig.mass / reference.mass, rig.nodes[-1] / reference.nodes[-1], reference.plan.first_hz / rig.plan.first_hz
    )
