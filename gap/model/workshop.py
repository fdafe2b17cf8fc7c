"""What a workshop does not know exactly of a rig, and the rig as it would be if one of these numbers were off.

Every tolerance is the logarithm of a factor: on the shaft's modulus, on all lengths, on the mass of each disk and of
each lumped mass, on the moments of inertia of each disk that has them in the model, on the tilt stiffness of supports
that hold the slope, on the stiffness of each joint, and on the two dampings. ``NominalBelief`` gives their standard
deviations; a tolerance of zero is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from rigtwin.rotor.effects.scale import RigScale, scale_of
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import NominalBelief

# Step of a tolerance for a derivative.
STEP = 1e-3

# The same of a damping, or of a tilt stiffness: they are small parts of the whole.
_SETTLED_PART = 6e-4

# Keys of [nominal] that are tolerances of what is in the model.
TOLERANCE_KEYS = tuple(
    f.name for f in fields(NominalBelief) if f.name.endswith("_tolerance") and f.name != "gain_tolerance"
)


@dataclass(frozen=True)
class Tolerance:
    """One number that is known within a tolerance."""

    name: str
    std: float  # of the logarithm of its factor
    change: Callable[[Rig, float], Rig] | None = None  # the rig with it so many times as large; None of a damping
    node: int = 0  # of the rig that the disk or mass sits at, from 1
    value: float = 1.0  # as drawn, in the unit
    unit: str = "1"
    words: str = ""  # what the number is
    joint: int = 0  # of the rig, from 1
    settled: float = 2e-5  # change from an anchor below which a fit would go nowhere else from a new one

    @property
    def is_body(self) -> bool:
        """Whether it is the mass or the diametral inertia of a disk or lumped mass."""
        return self.unit in ("kg", "kg.m2")

    @property
    def tilts(self) -> bool:
        """Whether it acts where its node tilts."""
        return self.unit == "kg.m2"


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

    @cached_property
    def scale(self) -> RigScale:
        """Of the rig as drawn."""
        return scale_of(self.anchor(np.zeros(len(self.tolerances))).structure)

    @cached_property
    def k_b(self) -> tuple[float, float]:
        """Range of the bearing stiffness [N/m]: what suits the rig, and no further than its file allows."""
        return self.rig.k_b.limit(*self.scale.k_b)

    def rig_at(self, values: FloatArray) -> Rig:
        """The rig with tolerances (n_tolerances,); dampings are no part of it."""
        rig = self.rig
        for each, value in zip(self.tolerances, values, strict=True):
            if each.change and value:
                rig = each.change(rig, float(np.exp(value)))
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

    @cached_property
    def belief(self) -> NominalBelief:
        """The belief with these tolerances."""
        return self.workshop.belief_at(self.values)

    @property
    def stepped(self) -> list[FloatArray]:
        """The tolerances, each with one of them a step larger."""
        return list(self.values + STEP * np.eye(len(self.values)))

    @cached_property
    def variants(self) -> list[Structure]:
        """The rotor with each tolerance a step larger."""
        return [
            self.workshop.structure(values) if each.change else self.structure
            for values, each in zip(self.stepped, self.workshop.tolerances, strict=True)
        ]


def _tolerances(rig: Rig, belief: NominalBelief) -> Iterator[Tolerance]:
    modulus = _common([s.youngs_modulus_Pa for s in rig.segment], "Pa", "modulus of the shaft")
    length = {"value": sum(s.length_m for s in rig.segment), "unit": "m", "words": "length of the shaft"}
    yield Tolerance("modulus", belief.modulus_tolerance, _stiffer, **modulus)
    yield Tolerance("span", belief.span_tolerance, _longer, **length)
    yield from _bodies(rig, belief.disk_mass_tolerance)
    held = [s.tilt_stiffness_Nm_per_rad for s in rig.support if s.tilt_stiffness_Nm_per_rad not in ("rigid", 0.0)]
    if held:
        tilt = _common(held, "N.m/rad", "tilt stiffness of the supports")
        yield Tolerance("tilt", belief.tilt_tolerance, _held_tighter, **tilt, settled=_SETTLED_PART)
    for k in range(len(rig.joint)):
        change, words = partial(_joined_tighter, number=k), f"factor on the stiffness of joint {k + 1}"
        yield Tolerance(f"joint_{k + 1}", belief.joint_tolerance, change, words=words, joint=k + 1)
    if zeta := belief.shaft_damping_ratio:
        shaft = {"value": zeta, "words": "damping ratio of the shaft"}
        yield Tolerance("shaft_damping_ratio", belief.shaft_damping_tolerance, **shaft, settled=_SETTLED_PART)
    if c_b := belief.bearing_damping_Ns_per_m:
        bearing = {"value": c_b, "unit": "N.s/m", "words": "damping of each bearing"}
        yield Tolerance("bearing_damping", belief.bearing_damping_tolerance, **bearing, settled=_SETTLED_PART)


def _bodies(rig: Rig, std: float) -> Iterator[Tolerance]:
    """Of disks and lumped masses."""
    for k, disk in enumerate(rig.disk):
        there = f"of the disk at node {disk.node}"
        change = partial(_heavier, kind="disk", number=k)
        yield Tolerance(f"disk_mass_{k + 1}", std, change, disk.node, disk.mass, "kg", f"mass {there}")
        if inertia := disk.diametral_inertia:  # of another shape as well as of another density
            change, words = partial(_wider, number=k), f"diametral inertia {there}"
            yield Tolerance(f"disk_inertia_{k + 1}", std, change, disk.node, inertia, "kg.m2", words)
    for k, mass in enumerate(rig.mass):
        change, words = partial(_heavier, kind="mass", number=k), f"mass at node {mass.node}"
        yield Tolerance(f"mass_{k + 1}", std, change, mass.node, mass.mass_kg, "kg", words)


def _common(values: Sequence[float], unit: str, words: str) -> dict[str, Any]:
    """Value, unit and words of a number that has one value; else those of the factor on all of its values."""
    if len(set(values)) == 1:
        return {"value": values[0], "unit": unit, "words": words}
    return {"value": 1.0, "unit": "1", "words": f"factor on the {words}"}


def _stiffer(rig: Rig, factor: float) -> Rig:
    """With another modulus of the shaft."""
    segments = [s.model_copy(update={"youngs_modulus_Pa": factor * s.youngs_modulus_Pa}) for s in rig.segment]
    return rig.model_copy(update={"segment": segments})


def _longer(rig: Rig, factor: float) -> Rig:
    """With other lengths along the shaft."""
    segments = [s.model_copy(update={"length_m": factor * s.length_m}) for s in rig.segment]
    joints = [j if j.x_m is None else j.model_copy(update={"x_m": factor * j.x_m}) for j in rig.joint]
    places = [factor * x for x in rig.nodes_m]
    return rig.model_copy(update={"segment": segments, "joint": joints, "nodes_m": places})


def _heavier(rig: Rig, factor: float, *, kind: str, number: int) -> Rig:
    """With another mass of one disk or lumped mass: of another density, where it has dimensions."""
    bodies = list(getattr(rig, kind))
    body = bodies[number]
    key = "density_kg_per_m3" if getattr(body, "density_kg_per_m3", None) is not None else "mass_kg"
    bodies[number] = body.model_copy(update={key: factor * getattr(body, key)})
    return rig.model_copy(update={kind: bodies})


def _wider(rig: Rig, factor: float, *, number: int) -> Rig:
    """With other moments of inertia of one disk, its mass the same."""
    disks = list(rig.disk)
    disk = disks[number]
    moments = {
        "mass_kg": disk.mass,
        "diametral_inertia_kg_m2": factor * disk.own_diametral_inertia,
        "polar_inertia_kg_m2": factor * disk.own_polar_inertia,
    }
    disks[number] = disk.model_copy(update=moments)
    return rig.model_copy(update={"disk": disks})


def _held_tighter(rig: Rig, factor: float) -> Rig:
    """With another tilt stiffness of the supports that have one."""
    key = "tilt_stiffness_Nm_per_rad"
    supports = [
        s if getattr(s, key) == "rigid" else s.model_copy(update={key: factor * getattr(s, key)}) for s in rig.support
    ]
    return rig.model_copy(update={"support": supports})


def _joined_tighter(rig: Rig, factor: float, *, number: int) -> Rig:
    """With other stiffnesses of one joint; what is rigid stays so, and the dashpots stay as they are."""
    joints, keys = list(rig.joint), ("stiffness_N_per_m", "tilt_stiffness_Nm_per_rad")
    joint = joints[number]
    soft = {key: factor * value for key in keys if (value := getattr(joint, key)) != "rigid"}
    joints[number] = joint.model_copy(update=soft)
    return rig.model_copy(update={"joint": joints})
