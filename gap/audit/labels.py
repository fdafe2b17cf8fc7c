"""Labels that the measured curves contradict: exchanged sensors, wrong exciter, quantity, unit, range or support.

The drawing says how large each node's response is beside the others', line by line and whatever the gain. A gap moves
resonances and changes peaks; an exchanged cable changes the whole curve of two channels, and a wrong exciter all. A
velocity that passes for an acceleration tilts every curve, and frequencies in another unit stretch it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.drawn import Curves
from rigtwin.gap.audit.geometry import Geometry
from rigtwin.gap.audit.one_run import is_only_noise
from rigtwin.gap.document import Finding
from rigtwin.gap.phrases import listed
from rigtwin.rotor.frequency.measured import Quantity


@dataclass(frozen=True)
class LabelLimits:
    """When the names of a run are not believed. Distances are means of |ln (measured / drawn)|."""

    # In tuning campaigns no gap brought other names nearer than the right ones, which were off by 0.09 at most.
    distance: float = 0.1  # at which a run's own names are no longer believed, ...
    share: float = 0.5  # ... where others leave this share of it or less
    channels: int = 3  # fewer say nothing of their names
    lines: int = 20  # fewer say nothing at all,
    band: float = 1.2  # nor do lines round one resonance, highest over lowest: where a gap moves it, all of them change
    other_range: float = 3.0  # factor to the other channels from which a channel's range differs; gaps reach 2
    range_error: float = 0.05  # of the factor's logarithm beside a known one
    above: float = 0.02  # relative difference by which a first resonance is above another, ...
    same: float = 0.003  # ... the same, ...
    far_below: float = 0.1  # ... or far below the drawing's


_LIMITS = LabelLimits()

# What frequencies may be in, and how many of it are one Hz.
_FREQUENCY_UNITS = {"rad/s": 2 * np.pi, "rev/min": 60.0, "kHz": 1e-3}

# What responses per newton may be.
_QUANTITIES: tuple[Quantity, ...] = ("receptance", "mobility", "accelerance")

# Measured over drawn response, whatever the bearings' stiffness. A gap changes it by some ten per cent in the median,
# a wrong unit by ten or a thousand.
_UNIT_FACTOR = 2.5

# What the factor says of the unit.
_UNITS = {1 / 9.81: "g instead of m/s^2", 1e3: "mm instead of m, or kN instead of N", 1e6: "um instead of m"}

# The same of peak values over effective ones, or the other way; within the error of a modulus.
_PEAK_FACTOR = float(np.sqrt(2))
_PEAK_ERROR = 0.03

# What a factor between two channels may come from.
_RANGES = {9.81: "g and m/s^2", 10.0: "an amplifier's range", 1e2: "an amplifier's range", 1e3: "mm and m"}


def check_labels(runs: Sequence[CheckedRun], geometry: Geometry) -> Iterator[Finding]:
    """Each run's nodes and exciter against the drawing, and the supports against each other."""
    still = [p for p in runs if not p.run.spin_rpm and geometry.knows(p.run)]
    for p in still:
        yield from _check_run(p, geometry)
    yield from _check_supports(still, geometry)


def _check_run(p: CheckedRun, geometry: Geometry) -> Iterator[Finding]:
    """Check one run's names and units; others are proposed where they at least halve its distance to the drawing."""
    places, exciter = _telling_places(p, geometry), p.run.excitation_node
    nodes = tuple(p.channels[i].node for i in places)
    if not nodes:
        return
    curves = Curves(p, places, geometry)
    (distance, gain), named = curves.distance_and_gain(nodes, exciter), len(nodes) >= _LIMITS.channels
    if distance < _LIMITS.distance:
        yield from _check_size(p, gain, distance, geometry)
        words = "Nodes and exciter are where their names say: measured responses are off the drawing's by"
        if named:
            yield p.finding("labels", "ok", f"{words} {_percent(distance)} in the median.", distance, _LIMITS.distance)
        return
    # With the bearings' stiffness free, few channels may have a resonance anywhere.
    units = [*_in_other_quantities(p), *(_in_other_frequencies(p) if named or p.run.support == "rigid" else ())]
    others = [(Curves(q, places, geometry).distance(nodes, exciter), *words) for q, *words in units]
    if named:
        others.append(_other_names(curves, nodes, exciter, geometry.moving_nodes(p.run), geometry))
        others += _other_range(curves, nodes, exciter, geometry)
    left, looks, do = min(others, default=(np.inf, "", ""))
    if left <= _LIMITS.share * distance:
        words = f"{looks}: off by {_percent(left)} in the median then, by {_percent(distance)} as they are named"
        yield p.finding("labels", "error", f"{words}; {do}.", distance, _LIMITS.distance)
    else:
        yield from _check_size(p, gain, distance, geometry)


def _check_size(p: CheckedRun, factor: float, distance: float, geometry: Geometry) -> Iterator[Finding]:
    """Check the size of a run's responses, so many times the drawing's and as far off otherwise, by which units are
    told."""
    if p.run.quantity == "acceleration" or p.run.excitation_node not in geometry.moving_nodes(p.run):
        return
    words, off = f"The responses are {factor:.3g} times what the drawing gives", abs(np.log(factor))
    if off > np.log(_UNIT_FACTOR) + distance:
        hint = next((f" ({name}?)" for unit, name in _UNITS.items() if abs(np.log(factor / unit)) < np.log(1.5)), "")
        words += f": a unit or a sensitivity is wrong{hint}; check units of response and force."
        yield p.finding("units", "error", words, factor, _UNIT_FACTOR)
    elif abs(off - np.log(_PEAK_FACTOR)) < _PEAK_ERROR and distance < _LIMITS.distance:
        words += ", as where effective values (RMS) are divided by peak values; check both settings."
        yield p.finding("units", "warning", words, factor, _PEAK_FACTOR)
    else:
        yield p.finding("units", "ok", f"{words}.", factor, _UNIT_FACTOR)


def _telling_places(p: CheckedRun, geometry: Geometry) -> list[int]:
    """Live channels along the exciter that move and carry the rotor; none where the lines are too few or all close."""
    if len(p.f) < _LIMITS.lines or p.f[-1] < _LIMITS.band * p.f[0]:
        return []
    moving = geometry.moving_nodes(p.run)
    places = [i for i, c in enumerate(p.channels) if c.plane == p.run.excitation_plane and c.node in moving]
    return [i for i in places if not is_only_noise(p.noise, p.live[i])]


def _in_other_quantities(p: CheckedRun) -> Iterator[tuple[CheckedRun, str, str]]:
    """The run read as another quantity, with the finding's words and what to do."""
    for quantity in _QUANTITIES if p.run.quantity in _QUANTITIES else ():
        if quantity != p.run.quantity:
            looks = f"The responses look like those of a {quantity}, not of {p.run.quantity} as they are said to be"
            yield CheckedRun(replace(p.run, quantity=quantity), p.label), looks, "correct quantity"


def _in_other_frequencies(p: CheckedRun) -> Iterator[tuple[CheckedRun, str, str]]:
    """The run read in another frequency unit, with the finding's words and what to do."""
    for unit, factor in _FREQUENCY_UNITS.items():
        looks = f"The responses look like those at frequencies in {unit}, not Hz"
        run = replace(p.run, frequency_hz=p.run.frequency_hz / factor)
        yield CheckedRun(run, p.label), looks, f"divide the frequencies by {factor:.4g}"


def _other_names(
    curves: Curves, nodes: tuple[int, ...], exciter: int, moving: frozenset[int], geometry: Geometry
) -> tuple[float, str, str]:
    """The exciter or the sensor names that fit best: remaining distance, the finding's words, and what to do."""
    names = {order: curves.rough_distance(order, exciter) for order in _orders(nodes, geometry.nodes)}
    drives = {node: curves.rough_distance(nodes, node) for node in sorted(moving - {exciter})}
    order, drive = min(names, key=names.__getitem__), min(drives, key=drives.__getitem__)
    if drives[drive] <= names[order]:
        looks = f"The responses look like those to a force at node {drive}, not {exciter}"
        do = "correct excitation_node, or the names of the channels"
        return curves.distance(nodes, drive), looks, do
    changed = sorted((a, b) for a, b in zip(nodes, order, strict=True) if a != b)
    right = "each other's" if len(changed) == 2 else f"those of nodes {listed(b for _, b in changed)}"
    looks = f"The responses of nodes {listed(a for a, _ in changed)} look like {right}"
    return curves.distance(order, exciter), looks, "look for exchanged cables or columns"


def _other_range(
    curves: Curves, nodes: tuple[int, ...], exciter: int, geometry: Geometry
) -> Iterator[tuple[float, str, str]]:
    """Channels in another range, if fewer than half and not at bearings: remaining distance, words, and what to do."""
    left, sizes = curves.with_own_sizes(nodes, exciter)
    odd = np.flatnonzero(~np.isin(nodes, list(geometry.bearings)) & (np.abs(sizes) > np.log(_LIMITS.other_range)))
    if 0 < 2 * len(odd) < len(nodes):
        many = f"node {nodes[odd[0]]} are" if len(odd) == 1 else f"nodes {listed(nodes[i] for i in odd)} are"
        factors = listed(f"{np.exp(abs(sizes[i])):.3g} times too {'large' if sizes[i] > 0 else 'small'}" for i in odd)
        units = {_RANGES[f] for i in odd for f in _RANGES if abs(abs(sizes[i]) - np.log(f)) < _LIMITS.range_error}
        hint = f" ({' or '.join(sorted(units))}?)" if units else ""
        yield left, f"The responses of {many} {factors} beside the others'{hint}", "correct unit, sensitivity or range"


def _percent(distance: float) -> str:
    """Of a mean |ln ratio|."""
    percent = 100 * np.expm1(distance)
    return f"{percent:.{0 if percent > 10 else 1}f} %"


def _orders(nodes: tuple[int, ...], known: frozenset[int]) -> Iterator[tuple[int, ...]]:
    """Other names of the channels: two exchanged, all moved on by some, or counted from the other end."""
    for a, b in combinations(nodes, 2):
        yield tuple({a: b, b: a}.get(node, node) for node in nodes)
    for by in range(1, len(nodes)):
        yield (*nodes[by:], *nodes[:by])
    mirrored = tuple(max(known) + 1 - node for node in nodes)
    if set(mirrored) == set(nodes):
        yield mirrored


def _is_as_drawn(p: CheckedRun, geometry: Geometry) -> bool:
    """Whether a run is near the drawing's on its own supports, whatever hum its first resonance may be."""
    places = _telling_places(p, geometry)
    nodes = [p.channels[i].node for i in places]
    return bool(nodes) and Curves(p, places, geometry).distance(nodes, p.run.excitation_node) < _LIMITS.distance


def _check_supports(runs: Sequence[CheckedRun], geometry: Geometry) -> Iterator[Finding]:
    """First resonances against the drawing's on rigid supports: bearings are softer, unless they hold the slope too."""
    for plane in ("y", "z"):
        seen = [p for p in runs if p.run.excitation_plane == plane and p.resonances]
        rigid, bearing = ([p for p in seen if p.run.support == support] for support in ("rigid", "bearing"))
        if not rigid or not bearing:
            continue
        stiff, soft = (float(np.median([p.resonances[0].frequency_hz for p in each])) for each in (rigid, bearing))
        drawn = geometry.first_resonance(rigid[0].run)
        nearer = abs(np.log(soft / drawn)) < abs(np.log(stiff / drawn))
        if soft > (1 + _LIMITS.above) * stiff and nearer and max(p.f[0] for p in bearing) < (1 - _LIMITS.above) * stiff:
            do = "correct the names of the supports"
        elif abs(soft / stiff - 1) < _LIMITS.same and stiff < (1 - _LIMITS.far_below) * drawn:
            do = "look whether the supports were changed"
        else:
            continue
        if all(_is_as_drawn(p, geometry) for p in rigid):
            continue
        words = f"The first resonance lies at {stiff:.4g} Hz on rigid supports and at {soft:.4g} Hz on bearings"
        words += f", and the drawing says {drawn:.4g} Hz for rigid ones; {do}."
        yield Finding("labels", "error", words, ", ".join(p.label for p in (*rigid, *bearing)), soft / stiff, 1.0)
