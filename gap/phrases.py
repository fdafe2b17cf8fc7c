"""Places, parts of a whole and lists, as every finding, verdict and report words them."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rigtwin.gap.document import Location
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.sim.campaign import SupportKind

PLACES = {
    "bearings": "at the bearings",
    "disks": "at the disks",
    "joints": "in the joints",
    "shaft": "along the shaft",
    "sensor": "at every sensor",
    "exciter": "at the exciter",
    "rigid_support": "at the rigid supports",
    "raster": "in the frequency raster",
}


def place(location: Location) -> str:
    """'at node 4', 'at x = 213 mm', 'at the bearings'; empty where a location says nothing."""
    if location.node is not None:
        return f"at {'the sensor of ' if location.kind == 'sensor' else ''}node {location.node}"
    if location.x_m is not None:
        return f"at x = {1e3 * location.x_m:.0f} mm"
    return PLACES.get(location.kind, "")


def effects_at(effects: Iterable[str], locations: Iterable[Location]) -> str:
    """'attached mass at node 3 and open crack at x = 213 mm'."""
    there = zip(effects, locations, strict=False)
    return " and ".join(f"{EFFECTS[effect].title.lower()} {place(where)}".strip() for effect, where in there)


def supports(support: SupportKind) -> str:
    """'bearings', 'rigid supports'."""
    return "bearings" if support == "bearing" else "rigid supports"


def part(value: float) -> str:
    """'88 %', '3.1 %', '99.2 %', 'under 0.1 %', 'over 99.9 %', '−20 %': a part of the whole, a probability.

    >>> part(0.4567)
    '46 %'
    """
    if not math.isfinite(value):
        return "unknown"
    if value > 0.999:
        return "over 99.9 %"
    if abs(value) < 1e-3:
        return "under 0.1 %"
    decimals = 1 if 0 < value < 0.0995 or value > 0.99 else 0
    return f"{100 * value:.{decimals}f} %".replace("-", "−")


def lowered(words: str) -> str:
    """A sentence as it goes on after a colon: its first letter small."""
    return words[:1].lower() + words[1:]


def listed(names: Iterable[object]) -> str:
    """Names in a row; 'none' without any.

    >>> listed(["node 2", "node 3", "node 5"])
    'node 2, node 3 and node 5'
    """
    *first, last = list(map(str, names)) or ["none"]
    return f"{', '.join(first)} and {last}" if first else last


def ten_to(power: int) -> str:
    """'×10⁶', as it follows a number's digits."""
    return f"×10{str(power).translate(str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
