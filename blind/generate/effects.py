"""What a blind campaign may hide: effects of the diagnosis' library, their ranges, where they sit, how they fade.

Equations and ranges are those of ``docs/effects``; nothing is imported from there. ``KINDS`` is the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from rigtwin.blind.generate.rig import Rig
from rigtwin.blind.generate.scale import Scale

Fading = Literal["to_off", "inverse", "fixed"]
Group = Literal["structure", "support", "chain", "nonlinear", "stranger"]


@dataclass(frozen=True)
class Range:
    """A parameter: it is drawn as ``off`` plus or minus a log-uniform size (uniform where ``even``)."""

    low: float  # smallest distance from off
    high: float  # largest
    off: float = 0.0
    signed: bool = False
    even: bool = False
    least: float = 0.0  # smallest distance from off that the effect's range allows
    unit: str = "1"  # in which a rig of another size has another range
    fading: Fading = "to_off"  # how severity t in (0, 1] shrinks it: off + t (value - off), value / t, not at all

    def scaled(self, scale: Scale) -> Range:
        """The range of a rig of another size."""
        factor = scale.of(self.unit)
        return replace(self, low=self.low * factor, high=self.high * factor, least=self.least * factor)

    def draw(self, rng: np.random.Generator) -> float:
        sign = rng.choice([-1.0, 1.0]) if self.signed else 1.0
        size = rng.uniform(self.low, self.high) if self.even else log_uniform(rng, self.low, self.high)
        return float(self.off + sign * size)

    def faded(self, value: float, severity: float) -> float:
        if self.fading == "fixed":
            return value
        return value / severity if self.fading == "inverse" else self.off + severity * (value - self.off)

    def least_severity(self, value: float) -> float:
        """How far the value may fade before it leaves the range."""
        if self.fading == "fixed":
            return 0.0
        return value / self.high if self.fading == "inverse" else self.least / max(abs(value - self.off), 1e-300)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


@dataclass(frozen=True)
class Kind:
    """An effect id: what is drawn for it and what the label says about its place."""

    group: Group
    place: str  # kind of location in the label
    ranges: Mapping[str, Range]
    at: str = ""  # where it may sit, if at a node: a name in ``PLACES``


PLACES: dict[str, Callable[[Rig], tuple[int, ...]]] = {
    "": lambda rig: (),
    "inner": lambda rig: rig.inner_nodes,
    "inner or all": lambda rig: (0, *rig.inner_nodes),
    "away from the exciter": lambda rig: tuple(n for n in rig.inner_nodes if n != rig.drive_node),
    "held-out drive": lambda rig: (rig.plan.held_out_node,),
    "right end": lambda rig: (len(rig.nodes),),
}
ANYWHERE = (0.04, 0.96)  # of the shaft's length: where a crack may be

KINDS: dict[str, Kind] = {
    "attached_mass": Kind("structure", "node", {"mass": Range(0.02, 0.5, least=0.02, unit="kg")}, "inner"),
    "exciter_suspension": Kind(
        "structure",
        "exciter",
        {"stiffness": Range(3e3, 5e5, least=3e3, unit="N/m"), "damping": Range(0, 20, even=True, unit="N s/m")},
    ),
    "disk_mass": Kind("structure", "disks", {"change": Range(0.003, 0.08, signed=True)}),
    "disk_inertia": Kind("structure", "disks", {"factor": Range(0.02, 2)}),
    "hub_stiffening": Kind("structure", "disks", {"factor": Range(0.01, 1.5, off=1)}),
    "shaft_modulus": Kind("structure", "shaft", {"factor": Range(0.003, 0.1, off=1, signed=True)}),
    "axial_load": Kind("structure", "shaft", {"force": Range(200, 2e4, signed=True, unit="N")}),
    "open_crack": Kind("structure", "position", {"reduction": Range(0.05, 0.6, least=0.05)}),
    "shaft_damping": Kind("structure", "shaft", {"damping_ratio": Range(1e-3, 0.02)}),
    "bearing_damping": Kind("support", "bearings", {"damping": Range(10, 500, unit="N s/m")}),
    "bearing_tilt_stiffness": Kind("support", "bearings", {"stiffness": Range(2e2, 2e4, least=2e2, unit="N m/rad")}),
    "pedestal_flexibility": Kind(
        "support",
        "bearings",
        {
            "stiffness": Range(1e6, 5e7, fading="inverse", unit="N/m"),
            "mass": Range(0.3, 8, fading="fixed", unit="kg"),
            "damping": Range(1, 1000, fading="fixed", unit="N s/m"),
        },
    ),
    "bearing_asymmetry": Kind("support", "bearings", {"asymmetry": Range(0.01, 0.5, signed=True)}),
    "bearing_offset": Kind("support", "bearings", {"offset": Range(5e-4, 9e-3, signed=True, unit="m")}),
    "compliant_rigid_support": Kind(
        "support", "rigid_support", {"stiffness": Range(1e7, 1e9, fading="inverse", unit="N/m")}
    ),
    "plane_anisotropy": Kind(
        "support",
        "bearings",
        {"anisotropy": Range(0.1, 0.5, least=0.1), "angle": Range(0.087, 0.785, even=True, fading="fixed")},
    ),
    "viscoelastic_support": Kind(
        "support",
        "bearings",
        {"strength": Range(0.1, 2, least=0.1), "relaxation_time": Range(1e-4, 1e-2, fading="fixed", unit="s")},
    ),
    "bearing_cubic": Kind("nonlinear", "bearings", {"stiffness": Range(1e13, 1e17, unit="N/m3")}),
    "bearing_hertz": Kind("nonlinear", "bearings", {"preload": Range(1e-6, 2e-5, fading="inverse", unit="m")}),
    "bearing_clearance": Kind(
        "nonlinear",
        "bearings",
        {"gap": Range(5e-7, 1.4e-5, unit="m"), "preload": Range(1, 30, fading="fixed", unit="N")},
    ),
    "bearing_friction": Kind(
        "nonlinear",
        "bearings",
        {"force": Range(0.1, 50, unit="N"), "stiffness": Range(1e5, 1e7, fading="fixed", unit="N/m")},
    ),
    "bilinear_support": Kind("nonlinear", "bearings", {"ratio": Range(0.1, 2, off=1)}),
    "rub": Kind(
        "nonlinear",
        "node",
        {"stiffness": Range(1e5, 1e8, unit="N/m"), "gap": Range(1e-5, 2e-4, fading="fixed", unit="m")},
        "inner",
    ),
    "sensor_gain": Kind("chain", "sensor", {"gain": Range(0.02, 0.2, off=1, signed=True)}, "inner"),
    "sensor_delay": Kind("chain", "sensor", {"delay": Range(2e-6, 2e-3, unit="s")}, "inner or all"),
    "sensor_mass": Kind("chain", "sensor", {"mass": Range(5e-3, 0.06, least=5e-3, unit="kg")}, "inner or all"),
    "sensor_position": Kind("chain", "sensor", {"offset": Range(2e-3, 0.01, signed=True, unit="m")}, "inner"),
    "force_dropout": Kind(
        "chain",
        "exciter",
        {
            "mass": Range(0.02, 0.5, least=0.02, unit="kg"),
            "stiffness": Range(1e3, 1e5, least=1e3, unit="N/m"),
            "damping": Range(0, 50, even=True, unit="N s/m"),
        },
    ),
    "coarse_grid": Kind("chain", "raster", {"step": Range(0.2, 10, unit="Hz")}),
    "fast_sweep": Kind("chain", "raster", {"dwell": Range(0.05, 5, fading="inverse", unit="s")}),
}

STRANGERS: dict[str, Kind] = {
    "tuned_absorber": Kind(
        "stranger",
        "node",
        {
            "mass": Range(0.02, 0.3, unit="kg"),
            "frequency": Range(40, 350, fading="fixed", unit="Hz"),
            "damping_ratio": Range(0.005, 0.05, fading="fixed"),
        },
        "held-out drive",
    ),
    "common_base": Kind(
        "stranger",
        "bearings",
        {
            "mass": Range(3, 40, fading="inverse", unit="kg"),
            "frequency": Range(40, 350, fading="fixed", unit="Hz"),
            "damping_ratio": Range(0.01, 0.05, fading="fixed"),
        },
    ),
    "voice_coil": Kind(
        "stranger",
        "exciter",
        {
            "pull": Range(3e3, 1e5, unit="N/m"),
            "braking": Range(1, 50, unit="N s/m"),
            "time_constant": Range(3e-4, 5e-3, fading="fixed", unit="s"),
        },
    ),
    "end_coupling": Kind(
        "stranger",
        "node",
        {
            "mass": Range(0.05, 0.8, unit="kg"),
            "stiffness": Range(1e4, 1e6, fading="fixed", unit="N/m"),
            "damping": Range(1, 20, fading="fixed", unit="N s/m"),
            "arm": Range(0.02, 0.06, fading="fixed", unit="m"),
        },
        "right end",
    ),
    "crosstalk": Kind("stranger", "sensor", {"share": Range(0.01, 0.2, signed=True)}, "away from the exciter"),
}
KINDS |= STRANGERS

LINEAR = tuple(name for name, kind in KINDS.items() if kind.group in ("structure", "support"))
CHAIN = tuple(name for name, kind in KINDS.items() if kind.group == "chain")
NONLINEAR = tuple(name for name, kind in KINDS.items() if kind.group == "nonlinear")


@dataclass(frozen=True)
class Effect:
    """One effect at its place. ``form`` names another functional form of the same effect (set W6)."""

    id: str
    parameters: Mapping[str, float]
    node: int | None = None  # for sensors 0 is every sensor
    x: float | None = None  # [m]
    form: str = ""
    extras: Mapping[str, float] = field(default_factory=dict)  # parameters that only the other form has

    def __getitem__(self, name: str) -> float:
        return self.parameters[name]

    @property
    def location(self) -> dict[str, object]:
        """As ``causes[].location`` of a diagnosis."""
        place: dict[str, object] = {"kind": KINDS[self.id].place}
        if self.node is not None:
            place["node"] = self.node
        if self.x is not None:
            place["x_m"] = self.x
        return place

    @property
    def is_nonlinear(self) -> bool:
        return self.id in NONLINEAR


def faded(effect: Effect, severity: float, nominal: Mapping[str, float]) -> Effect:
    """The same effect at a share of its severity; at zero it would be the identity.

    nominal : off values that depend on the rig: ``damping_ratio`` and ``damping`` of the bearings
    """
    values = {}
    for name, interval in KINDS[effect.id].ranges.items():
        off = nominal.get(name, interval.off) if effect.id in ("shaft_damping", "bearing_damping") else interval.off
        values[name] = replace(interval, off=off).faded(effect[name], severity)
    return replace(effect, parameters=values)


def ranges_of(name: str, rig: Rig) -> dict[str, Range]:
    """An effect's ranges for a rig of this size."""
    return {key: interval.scaled(rig.scale) for key, interval in KINDS[name].ranges.items()}


def draw_effect(rng: np.random.Generator, name: str, rig: Rig, sensors: str = "all") -> Effect:
    """An effect of this id with sizes and place at random.

    sensors : "all" nodes carry one, or "one": the drive node only
    """
    kind = KINDS[name]
    values = {key: interval.draw(rng) for key, interval in ranges_of(name, rig).items()}
    nodes = PLACES[kind.at](rig)
    if kind.place == "sensor" and sensors == "one":
        nodes = tuple(n for n in nodes if n in (0, rig.drive_node))
    node = int(rng.choice(nodes)) if nodes else None
    x = float(rng.uniform(*ANYWHERE) * rig.nodes[-1]) if kind.place == "position" else None
    return Effect(name, values, node, x)


def least_severity(effect: Effect, rig: Rig) -> float:
    """Share of the effect's severity that still lies in its range."""
    return max(interval.least_severity(effect[name]) for name, interval in ranges_of(effect.id, rig).items())
