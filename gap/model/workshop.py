"""What a workshop does not know exactly of a rig, and the rig as it would be if one of these numbers were off.

Every tolerance is the logarithm of a factor: on the shaft's modulus, on all lengths, on the mass of each disk and of
each lumped mass, on the tilt stiffness of supports that hold the slope, and on the two dampings. ``NominalBelief``
gives their standard deviations; a tolerance of zero is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Disk, Mass, Rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import NominalBelief

# Step of a tolerance for a derivative.
STEP = 1e-3

# Change of a damping, or of a tilt stiffness, that its first order follows: they are small parts of the whole.
_SMALL_SHARE = 0.03

# Keys of [nominal] that are tolerances of what is in the model.
TOLERANCE_KEYS = tuple(
    f.name for f in fields(NominalBelief) if f.name.endswith("_tolerance") and f.name != "gain_tolerance"
)

Body = TypeVar("Body", Disk, Mass)


@dataclass(frozen=True)
class Tolerance:
    """One number that is known within a tolerance."""

    name: str
    std: float  # of the logarithm of its factor
    number: int = 0  # of the disk or lumped mass, from 0
    node: int = 0  # of the rig that the disk or mass sits at, from 1
    mass: float = 0.0  # [kg]
    reach: float = 1e-3  # change over which a model follows it to first order well enough


class Workshop:
    """A rig as drawn, and as it may be.

    Parameters
    ----------
    rig, belief : the rig, and what the campaign says of it
    elements, fine_elements : between two nodes of the rig; fine for effects that act inside an element
    """

    def __init__(self, rig: Rig, belief: NominalBelief, elements: int, fine_elements: int):
        self.rig, self.belief = rig, belief
        self._elements, self._fine_elements = elements, fine_elements
        self.tolerances = tuple(each for each in _tolerances(rig, belief) if each.std > 0)
        self._anchors: dict[bytes, Anchor] = {}

    def without_sensors(self) -> Workshop:
        """The same without accelerometers on it, as the FMU of the rig has none."""
        belief = replace(self.belief, sensor_mass_kg=0.0)
        return Workshop(self.rig, belief, self._elements, self._fine_elements)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the tolerances, in the order of their vector."""
        return tuple(each.name for each in self.tolerances)

    @property
    def std(self) -> FloatArray:
        """(n_tolerances,) standard deviations."""
        return np.array([each.std for each in self.tolerances])

    def rig_at(self, values: FloatArray) -> Rig:
        """The rig with tolerances (n_tolerances,); dampings are no part of it."""
        rig = self.rig
        for each, factor in zip(self.tolerances, np.exp(values), strict=True):
            rig = _changed(rig, each, float(factor))
        return rig

    def belief_at(self, values: FloatArray) -> NominalBelief:
        """The belief with these tolerances of the dampings."""
        belief = self.belief
        factors = {each.name: float(np.exp(value)) for each, value in zip(self.tolerances, values, strict=True)}
        return replace(
            belief,
            shaft_damping_ratio=belief.shaft_damping_ratio * factors.get("shaft_damping_ratio", 1.0),
            bearing_damping_Ns_per_m=belief.bearing_damping_Ns_per_m * factors.get("bearing_damping", 1.0),
        )

    def near(self, a: FloatArray, b: FloatArray, share: float = 1.0) -> bool:
        """Whether a model that is exact at the one holds at the other, tolerances (n_tolerances,) each; where every
        digit counts, within a share of its reach."""
        return bool(np.all(np.abs(a - b) <= share * np.array([each.reach for each in self.tolerances])))

    def anchor(self, values: FloatArray) -> Anchor:
        """The rig with these tolerances, remembered."""
        key = values.tobytes()
        if key not in self._anchors:
            self._anchors[key] = Anchor(self, values.copy())
        return self._anchors[key]

    def structure(self, values: FloatArray, *, fine: bool = False) -> Structure:
        """The meshed rotor with these tolerances."""
        elements = self._fine_elements if fine else self._elements
        return assemble(self.rig_at(values), elements_between_nodes=elements)


class Anchor:
    """Tolerances at which a model is exact; near them it follows the tolerances to first order."""

    def __init__(self, workshop: Workshop, values: FloatArray):
        self.workshop, self.values = workshop, values
        self.key = values.tobytes()

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs to make the rest."""
        return {name: self.__dict__[name] for name in ("workshop", "values", "key")}

    @cached_property
    def structure(self) -> Structure:
        """The rotor."""
        return self.workshop.structure(self.values)

    @cached_property
    def fine(self) -> Structure:
        """The rotor on the finer mesh."""
        return self.workshop.structure(self.values, fine=True)

    @property
    def stepped(self) -> list[FloatArray]:
        """The tolerances, each with one of them a step larger."""
        return list(self.values + STEP * np.eye(len(self.values)))

    @cached_property
    def variants(self) -> list[Structure]:
        """The rotor with each tolerance a step larger."""
        structural = (each.name not in ("shaft_damping_ratio", "bearing_damping") for each in self.workshop.tolerances)
        return [
            self.workshop.structure(values) if builds else self.structure
            for values, builds in zip(self.stepped, structural, strict=True)
        ]


def _tolerances(rig: Rig, belief: NominalBelief) -> list[Tolerance]:
    std = belief.disk_mass_tolerance
    dampings = (
        ("shaft_damping_ratio", belief.shaft_damping_tolerance, belief.shaft_damping_ratio),
        ("bearing_damping", belief.bearing_damping_tolerance, belief.bearing_damping_Ns_per_m),
    )
    masses = [
        *(Tolerance(f"disk_mass_{k + 1}", std, k, disk.node, disk.mass) for k, disk in enumerate(rig.disk)),
        *(Tolerance(f"mass_{k + 1}", std, k, mass.node, mass.mass_kg) for k, mass in enumerate(rig.mass)),
    ]
    tilted = any(s.tilt_stiffness_Nm_per_rad not in ("rigid", 0.0) for s in rig.support)
    return [
        Tolerance("modulus", belief.modulus_tolerance),
        Tolerance("span", belief.span_tolerance),
        *masses,
        *([Tolerance("tilt", belief.tilt_tolerance, reach=_SMALL_SHARE)] if tilted else []),
        *(Tolerance(name, std, reach=_SMALL_SHARE) for name, std, damping in dampings if damping),
    ]


def _changed(rig: Rig, tolerance: Tolerance, factor: float) -> Rig:
    """The rig with one number so many times as large; dampings are no part of it."""
    name, k = tolerance.name, tolerance.number
    if factor == 1.0:
        return rig
    if name == "modulus":
        stiffer = [s.model_copy(update={"youngs_modulus_Pa": factor * s.youngs_modulus_Pa}) for s in rig.segment]
        return rig.model_copy(update={"segment": stiffer})
    if name == "span":
        longer = [s.model_copy(update={"length_m": factor * s.length_m}) for s in rig.segment]
        return rig.model_copy(update={"segment": longer, "nodes_m": [factor * x for x in rig.nodes_m]})
    if name == "tilt":
        return rig.model_copy(
            update={"support": [s.model_copy(update=_tilted(s.tilt_stiffness_Nm_per_rad, factor)) for s in rig.support]}
        )
    if name.startswith("disk_mass"):
        return rig.model_copy(update={"disk": [_heavier(d, factor) if j == k else d for j, d in enumerate(rig.disk)]})
    if name.startswith("mass"):
        return rig.model_copy(update={"mass": [_heavier(m, factor) if j == k else m for j, m in enumerate(rig.mass)]})
    return rig


def _tilted(stiffness: float | str, factor: float) -> dict[str, float]:
    return {} if isinstance(stiffness, str) else {"tilt_stiffness_Nm_per_rad": factor * stiffness}


def _heavier(body: Body, factor: float) -> Body:
    """The body with another mass: of another density, where it has dimensions."""
    if isinstance(body, Disk) and body.density_kg_per_m3 is not None:
        return body.model_copy(update={"density_kg_per_m3": factor * body.density_kg_per_m3})
    return body.model_copy(update={"mass_kg": factor * (body.mass if isinstance(body, Disk) else body.mass_kg)})
