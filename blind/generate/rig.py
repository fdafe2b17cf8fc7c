"""Geometry of a rig, read from its TOML by this room alone."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """A solid disk at a node."""

    node: int  # from 1
    diameter: float  # [m]
    thickness: float  # [m]
    density: float  # [kg/m^3]

    @property
    def mass(self) -> float:  # [kg]
        return self.density * math.pi * self.diameter**2 / 4 * self.thickness

    @property
    def diametral_inertia(self) -> float:  # [kg m^2]
        return self.mass * (self.diameter**2 / 16 + self.thickness**2 / 12)


@dataclass(frozen=True)
class Rig:
    """A round shaft with solid disks on bearings of unknown stiffness."""

    name: str
    nodes: tuple[float, ...]  # [m] places of the rig nodes
    segments: tuple[Segment, ...]
    disks: tuple[Disk, ...]
    bearings: tuple[int, ...]  # nodes of the supports, left first


def read_rig(name: str) -> Rig:
    """A shipped rig by name; solid round segments, disks and bearings are understood, no more."""
    table = tomllib.loads((SHIPPED_RIGS / f"{name}.toml").read_text(encoding="utf-8"))
    segments = tuple(
        Segment(s["length_m"], s["diameter_m"], s["youngs_modulus_Pa"], s["density_kg_per_m3"], s["poisson"])
        for s in table["segment"]
    )
    disks = tuple(Disk(d["node"], d["diameter_m"], d["thickness_m"], d["density_kg_per_m3"]) for d in table["disk"])
    bearings = tuple(s["node"] for s in table["support"] if s["stiffness"] == "k_b")
    return Rig(table["name"], tuple(table["nodes_m"]), segments, disks, bearings)
