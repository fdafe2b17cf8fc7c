"""The rotor of a campaign: matrices of one lateral plane, with effects in, on rigid supports or on bearings.

D(omega) = K + i omega (C_s + C_b) - omega^2 M + sum_k d_k(omega) r_k r_k^T

C_s = M Phi [2 zeta (Phi^T K_s Phi)_ij / sqrt(omega_i omega_j)] Phi^T M, with K_s the shaft's stiffness and Phi, omega
the mass-normalised undamped modes of K and M. d_k are supports whose stiffness depends on frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.blind.generate.beam import SHORTEST, Hinge, Hub, Shaft, build_shaft
from rigtwin.blind.generate.draft import Draft, DynamicStiffness, Joint, Machine
from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.rig import ComplexArray, FloatArray, Rig
from rigtwin.blind.generate.strangers import ADDERS, base_plate


@dataclass(frozen=True)
class Workshop:
    """What a workshop does not know: relative deviations from the drawing."""

    modulus: float = 0.0
    span: float = 0.0  # every length along the shaft
    disk_masses: tuple[float, ...] = (0.0, 0.0)
    sensor_mass: float = 0.0  # [kg] of every accelerometer that stays mounted; this is known
    sensors: tuple[int, ...] = ()  # nodes where they are


@dataclass(frozen=True)
class Setting:
    """One run's condition."""

    rigid: bool
    k_b: float  # [N/m]
    c_b: float  # [N s/m]
    zeta: float
    drive_node: int = 2


class Found:
    """Effects of a machine by id."""

    def __init__(self, effects: Sequence[Effect]) -> None:
        self.effects = effects

    def all(self, name: str) -> list[Effect]:
        return [e for e in self.effects if e.id == name]

    def value(self, name: str, parameter: str, default: float) -> float:
        """Of the last effect with this id."""
        return next((e[parameter] for e in reversed(self.effects) if e.id == name), default)


def build_machine(
    rig: Rig,
    setting: Setting,
    effects: Sequence[Effect] = (),
    workshop: Workshop | None = None,
    *,
    sensor: int | None = None,
) -> Machine:
    """The rotor with its structural effects.

    sensor : node whose accelerometer is on the rotor now, if the accelerometer has a mass
    """
    workshop = workshop or Workshop((len(rig.disks) and 0.0), 0.0, (0.0,) * len(rig.disks))
    found = Found(effects)
    stretch = 1 + workshop.span
    nodes = [x * stretch for x in rig.nodes]
    draft = Draft(_shaft(rig, found, workshop))
    _load_shaft(draft, rig, found, workshop, nodes, setting.drive_node)
    for effect in found.all("sensor_mass"):
        if sensor is not None and effect.node in (0, sensor):
            draft.mass(draft.shaft.deflection(nodes[sensor - 1]), effect["mass"])
    held = (
        _hold_rigidly(draft, rig, found, nodes)
        if setting.rigid
        else _hang_in_bearings(draft, rig, found, nodes, setting)
    )
    drive = draft.widen(draft.shaft.deflection(nodes[setting.drive_node - 1]))
    for effect in effects:
        if effect.id in ADDERS:
            ADDERS[effect.id](draft, effect, rig, nodes, draft.widen(drive))
    zeta = found.value("shaft_damping", "damping_ratio", setting.zeta)
    offsets = {e.node: e["offset"] for e in found.all("sensor_position")}
    read = [draft.shaft.deflection(x + offsets.get(i, offsets.get(0, 0.0))) for i, x in enumerate(nodes, start=1)]
    return draft.finish(zeta, drive, read, held, rig.plan.band_hz)


def _shaft(rig: Rig, found: Found, workshop: Workshop) -> Shaft:
    stretch = 1 + workshop.span
    nodes = [x * stretch for x in rig.nodes]
    segments = [replace(s, length=s.length * stretch) for s in rig.segments]
    hubs = [
        hub
        for effect in found.all("hub_stiffening")
        for d in rig.disks
        for hub in hub_stretches(nodes[d.node - 1], d.thickness, effect)
    ]
    hubs += [_notch(e, rig) for e in found.all("open_crack") if e.form == "notch"]
    offset = found.value("bearing_offset", "offset", 0.0)
    seats = [nodes[n - 1] + side * offset for n, side in zip(rig.bearings, (1, -1), strict=True)]
    modulus = found.value("shaft_modulus", "factor", 1.0) * (1 + workshop.modulus)
    hinges = [
        Hinge(e.x, hinge_compliance(e, rig) / (1 + workshop.modulus))
        for e in found.all("open_crack")
        if e.x is not None and e["reduction"] > 0 and e.form != "notch"
    ]
    shortest = SHORTEST * rig.scale.length
    return build_shaft(segments, [*nodes, *seats], hubs, hinges, modulus_factor=modulus, shortest=shortest)


def hub_stretches(x: float, thickness: float, effect: Effect) -> list[Hub]:
    """The stretch inside a hub; in the form "tapered" its outer thirds are stiffened by half."""
    factor = effect["factor"]
    if effect.form != "tapered":
        return [Hub(x - thickness / 2, x + thickness / 2, factor)]
    factors = ((1 + factor) / 2, factor, (1 + factor) / 2)
    borders = x - thickness / 2 + thickness / 3 * np.arange(4)
    return [Hub(float(a), float(b), f) for a, b, f in zip(borders[:-1], borders[1:], factors, strict=True)]


def _notch(crack: Effect, rig: Rig) -> Hub:
    """A crack in the form of 0.8 diameters of softer shaft."""
    half = 0.4 * rig.segments[0].diameter
    x = float(np.clip(crack.x or 0.0, half, rig.nodes[-1] - half))
    return Hub(x - half, x + half, 1 - crack["reduction"])


def hinge_compliance(crack: Effect, rig: Rig) -> float:
    """c = 0.8 d / (E I) r / (1 - r) [rad/(N m)]."""
    ends = np.cumsum([s.length for s in rig.segments])
    section = rig.segments[min(int(np.searchsorted(ends, crack.x or 0.0)), len(ends) - 1)]
    r = crack["reduction"]
    return 0.8 * section.diameter / (section.modulus * section.second_moment) * r / (1 - r)


def _load_shaft(
    draft: Draft, rig: Rig, found: Found, workshop: Workshop, nodes: Sequence[float], drive_node: int
) -> None:
    """Disks, masses, mounted accelerometers, axial force, exciter's suspension."""
    change = 1 + found.value("disk_mass", "change", 0.0)
    inertia = found.value("disk_inertia", "factor", 0.0)
    for disk, deviation in zip(rig.disks, workshop.disk_masses, strict=True):
        x = nodes[disk.node - 1]
        draft.mass(draft.shaft.deflection(x), disk.mass * change * (1 + deviation))
        draft.mass(draft.shaft.rotation(x), (1.0 if disk.tilts else inertia) * disk.diametral_inertia)
    for node in workshop.sensors:
        draft.mass(draft.shaft.deflection(nodes[node - 1]), workshop.sensor_mass)
    for effect in found.all("attached_mass"):
        half = effect.extras.get("half_width", 0.0)  # of a collar
        for side in (-half, half):
            draft.mass(draft.shaft.deflection(nodes[(effect.node or 1) - 1] + side), effect["mass"] / 2)
    for effect in found.all("axial_load"):
        draft.K += effect["force"] * draft.shaft.K_axial
    for effect in found.all("exciter_suspension"):
        draft.spring(draft.shaft.deflection(nodes[drive_node - 1]), effect["stiffness"], effect["damping"])


def _hold_rigidly(draft: Draft, rig: Rig, found: Found, nodes: Sequence[float]) -> list[FloatArray]:
    """Rows of the supports that are held; none where the rigid supports give way."""
    rows = [draft.shaft.deflection(nodes[n - 1]) for n in rig.bearings]
    compliant = found.all("compliant_rigid_support")
    for effect in compliant:
        for row in rows:
            draft.spring(row, effect["stiffness"])
    return [] if compliant else rows


def _hang_in_bearings(
    draft: Draft, rig: Rig, found: Found, nodes: Sequence[float], setting: Setting
) -> list[FloatArray]:
    """Bearings, each k_b beside its damper, on pedestals if there are any."""
    damping = found.value("bearing_damping", "damping", setting.c_b)
    asymmetry = found.value("bearing_asymmetry", "asymmetry", 0.0)
    offset = found.value("bearing_offset", "offset", 0.0)
    plates = [base_plate(draft, effect) for effect in found.all("common_base")]
    for number, side in zip(rig.bearings, (1, -1), strict=True):
        x = nodes[number - 1] + side * offset
        stiffness = setting.k_b * (1 + side * asymmetry)
        row = draft.shaft.deflection(x)
        for effect in found.all("pedestal_flexibility"):
            row = _on_pedestal(draft, row, effect)
        for plate in plates:
            row = draft.widen(row) - draft.widen(plate)
        draft.spring(row, stiffness, damping)
        draft.joints.append(Joint(row, stiffness))
        for effect in found.all("viscoelastic_support"):
            draft.springs.append((row, _relaxing(effect, stiffness)))
        for effect in found.all("bearing_tilt_stiffness"):
            draft.spring(draft.shaft.rotation(x), effect["stiffness"])
    return []


def _on_pedestal(draft: Draft, row: FloatArray, effect: Effect) -> FloatArray:
    """Row of the bearing's deformation with a pedestal below it."""
    pedestal = draft.add_coordinate(effect["mass"])
    draft.spring(pedestal, effect["stiffness"], effect["damping"])
    if effect.form == "two_masses":  # a foundation block below the pedestal
        block = draft.add_coordinate(effect["mass"] * effect.extras["block_mass"])
        draft.spring(pedestal, -effect["stiffness"], -effect["damping"])
        draft.spring(draft.widen(pedestal) - block, effect["stiffness"], effect["damping"])
        draft.spring(block, effect["stiffness"] * effect.extras["block_stiffness"])
    return draft.widen(row) - draft.widen(pedestal)


def _relaxing(effect: Effect, stiffness: float) -> DynamicStiffness:
    """Maxwell branch k g i w tau / (1 + i w tau); in another form of fractional order, (i w tau)^alpha instead."""
    g, tau = effect["strength"], effect["relaxation_time"]
    order = effect.extras.get("order", 1.0)

    def branch(omega: FloatArray) -> ComplexArray:
        s = (1j * omega * tau) ** order
        return stiffness * g * s / (1 + s)

    return branch
