"""Where a diagnosis points at the rotor: rings on its drawing, and what they are in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from rigtwin.gap.document import Cause, Diagnosis, Location
from rigtwin.gap.phrases import place
from rigtwin.pages.diagnosis_words import title
from rigtwin.rotor.geometry.rig import Rig


class Pointed(NamedTuple):
    """What is ringed on a drawing."""

    rings_m: tuple[float, ...]  # positions along the shaft
    words: str  # empty where nothing is


def pointed_at(diagnosis: Diagnosis, rig: Rig, driven: Iterable[int]) -> Pointed:
    """The places of the named causes, or of an unknown mechanism that was located.

    Parameters
    ----------
    driven : nodes that the runs drive
    """
    if diagnosis.verdict == "unknown" and diagnosis.measured_joint:
        node = diagnosis.measured_joint.node
        return Pointed((rig.nodes_m[node - 1],), f"Ringed: the unknown mechanism, at node {node}.")
    causes = (diagnosis.equivalent or diagnosis.causes[:1]) if diagnosis.names_a_cause else ()
    found = [
        (positions_m(location, rig, driven), f"{title(effect)} {place(location)}")
        for cause in causes
        for effect, location in zip(cause.effects, _locations(cause), strict=False)
    ]
    seen = [(rings, words) for rings, words in found if rings]
    rings = dict.fromkeys(x for rings, _ in seen for x in rings)
    words = "; ".join(dict.fromkeys(words for _, words in seen))
    return Pointed(tuple(rings), f"Ringed: {words}." if words else "")


def _locations(cause: Cause) -> tuple[Location, ...]:
    return cause.locations or (cause.location,)


def positions_m(location: Location, rig: Rig, driven: Iterable[int]) -> list[float]:
    """Where a location lies along the shaft; nowhere for the whole shaft, all sensors or a raster."""
    if location.x_m is not None:
        return [location.x_m]
    bearings = [support.node for support in rig.support if support.stiffness == "k_b"]
    nodes = {
        "bearings": bearings,
        "rigid_support": bearings,
        "disks": [disk.node for disk in rig.disk],
        "exciter": sorted(set(driven)),
    }.get(location.kind, [])
    if location.node is not None:
        nodes = [location.node]
    return rig.joints_m if location.kind == "joints" else [rig.nodes_m[node - 1] for node in nodes]
