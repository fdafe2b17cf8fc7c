"""The sealed label of a campaign: what it hides, and how its rig differs from what is known of it."""

from __future__ import annotations

from rigtwin.blind.generate.draw import Draw
from rigtwin.blind.generate.folder import stated
from rigtwin.blind.generate.rig import Rig
from rigtwin.blind.generate.sizes import size_class


def label_of(draw: Draw, campaign: str, split: str) -> dict[str, object]:
    """Of any set."""
    case = draw.case
    return {
        "campaign": campaign,
        "set": case.set,
        "split": split,
        "exclude": list(case.exclude),
        "effects": _effects(draw),
        "size": size_class(draw.ratio) if draw.ratio else None,
        "size_ratio": draw.ratio,
        "rejected_draws": draw.rejected,
        "not_periodic_draws": draw.not_periodic,
        "k_b": case.k_b,
        "sensors": case.sensors,
        "levels": list(case.levels),
        "noise": case.noise,
        "with_std": case.with_std,
        "quantity": case.quantity,
        "shaft_damping_ratio": case.zeta,
        "bearing_damping_Ns_per_m": case.c_b,
        "workshop": {
            "modulus": case.workshop.modulus,
            "span": case.workshop.span,
            "disk_masses": list(case.workshop.disk_masses),
        },
    }


def _effects(draw: Draw) -> list[dict[str, object]]:
    return [
        {
            "id": e.id,
            "parameters": dict(e.parameters),
            "location": e.location,
            "form": e.form,
            "extras": dict(e.extras),
            "size_ratio": r,
        }
        for e, r in zip(draw.case.effects, draw.ratios, strict=True)
    ]


def of_real_rig(draw: Draw, rig: Rig) -> dict[str, object]:
    """What the label of a rig of any size says besides."""
    case = draw.case
    return {
        "rotor": rig.name,
        "nodes_m": list(rig.nodes),
        "bearings": list(rig.bearings),
        "drive_node": rig.drive_node,
        "drift": case.tolerances.drift,
        "gain_repeatability": case.tolerances.repeatability,
        "sensor_mass_kg": case.workshop.sensor_mass,
        "n_effects": len(case.effects),
        "repeats": case.repeats,
        "stated": dict(stated(case)),
    }
