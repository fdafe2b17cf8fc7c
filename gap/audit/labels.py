"""Labels that the measured curves contradict: exchanged sensors, wrong exciter, quantity, unit, range or support.

The drawing says how large each node's response is beside the others', line by line and whatever the gain. A gap moves
resonances and changes peaks; an exchanged cable changes the whole curve of two channels, and a wrong exciter all. A
velocity that passes for an acceleration tilts every curve, and frequencies in another unit stretch it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.optimize import minimize_scalar

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.geometry import Geometry
from rigtwin.gap.audit.one_run import is_only_noise
from rigtwin.gap.document import Finding
from rigtwin.gap.phrases import listed
from rigtwin.rotor.frequency.measured import Quantity
from rigtwin.rotor.model.arrays import FloatArray


@dataclass(frozen=True)
class LabelLimits:
    """When the names of a run are not believed. Distances are means of |ln (measured / drawn)|."""

    # In tuning campaigns no gap brought other names nearer than the right ones, which were off by 0.09 at most.
    distance: float = 0.1  # at which a run's own names are no longer believed, ...
    share: float = 0.5  # ... where others leave this share of it or less
    channels: int = 3  # fewer say nothing of their names
    lines: int = 20  # fewer say nothing at all
    other_range: float = 3.0  # factor to the other channels from which a channel's range differs; gaps reach 2
    range_error: float = 0.05  # of the factor's logarithm beside a known one
    stiffnesses: int = 49  # of bearings that are tried
    spread: int = 200  # frequencies along the band at which a run's lines are looked at
    above: float = 0.02  # relative difference by which a first resonance is above another, ...
    same: float = 0.003  # ... the same, ...
    far_below: float = 0.1  # ... or far below the drawing's


_LIMITS = LabelLimits()

# What frequencies may be in, and how many of it are one Hz.
_FREQUENCY_UNITS = {"rad/s": 2 * np.pi, "rev/min": 60.0, "kHz": 1e-3}

# What responses per newton may be.
_QUANTITIES: tuple[Quantity, ...] = ("receptance", "mobility", "accelerance")

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
    moving, places = geometry.moving_nodes(p.run), _telling_places(p, geometry)
    nodes, exciter = tuple(p.channels[i].node for i in places), p.run.excitation_node
    if not nodes:
        return
    curves = _Curves(p, places, geometry)
    distance, named = curves.distance(nodes, exciter), len(nodes) >= _LIMITS.channels
    if distance < _LIMITS.distance:
        words = "Nodes and exciter are where their names say: measured responses are off the drawing's by"
        if named:
            yield p.finding("labels", "ok", f"{words} {_percent(distance)} in the median.", distance, _LIMITS.distance)
        return
    # With the bearings' stiffness free, few channels may have a resonance anywhere.
    units = [*_in_other_quantities(p), *(_in_other_frequencies(p) if named or p.run.support == "rigid" else ())]
    others = [(_Curves(q, places, geometry).distance(nodes, exciter), *words) for q, *words in units]
    if named:
        others.append(_other_names(curves, nodes, exciter, moving, geometry))
        others += _other_range(curves, nodes, exciter, geometry)
    left, looks, do = min(others, default=(np.inf, "", ""))
    if left <= _LIMITS.share * distance:
        words = f"{looks}: off by {_percent(left)} in the median then, by {_percent(distance)} as they are named"
        yield p.finding("labels", "error", f"{words}; {do}.", distance, _LIMITS.distance)


def _telling_places(p: CheckedRun, geometry: Geometry) -> list[int]:
    """Live channels along the exciter that move and carry the rotor; none where the lines are too few."""
    moving = geometry.moving_nodes(p.run)
    places = [i for i, c in enumerate(p.channels) if c.plane == p.run.excitation_plane and c.node in moving]
    return [i for i in places if not is_only_noise(p.noise, p.live[i])] if len(p.f) >= _LIMITS.lines else []


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
    curves: _Curves, nodes: tuple[int, ...], exciter: int, moving: frozenset[int], geometry: Geometry
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
    curves: _Curves, nodes: tuple[int, ...], exciter: int, geometry: Geometry
) -> Iterator[tuple[float, str, str]]:
    """Channels in another range, if fewer than half and not at bearings: remaining distance, words, and what to do."""
    left, sizes = curves.with_own_sizes(nodes, exciter)
    free = [node not in geometry.bearings for node in nodes]
    odd = np.flatnonzero(free & (np.abs(sizes) > np.log(_LIMITS.other_range)))
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


class _Curves:
    """How far a run's magnitudes are from the drawing's under some names.

    Parameters
    ----------
    places : (n,) live channels that move, along the exciter
    """

    def __init__(self, p: CheckedRun, places: Sequence[int], geometry: Geometry):
        # Evenly along the band: lines crowd at peaks, where a gap shows most.
        spread = np.clip(np.searchsorted(p.f, np.linspace(p.f[0], p.f[-1], _LIMITS.spread)), 0, len(p.f) - 1)
        run, f = p.run, p.f[spread]
        self._measured = np.log(np.abs(p.receptance[np.ix_(spread, places)]) + np.finfo(float).tiny)
        self._k_b = np.log(geometry.stiffnesses(_LIMITS.stiffnesses if run.support != "rigid" else 1))

        @lru_cache(maxsize=len(self._k_b) * len(geometry.nodes))
        def drawn(ln_k_b: float, exciter: int) -> FloatArray:
            H = geometry.response(run, f, float(np.exp(ln_k_b)), exciter)
            return np.log(np.abs(H) + np.finfo(float).tiny)

        self._drawn = drawn

    def distance(self, nodes: Sequence[int], exciter: int) -> float:
        """Mean over channels of the median |ln ratio|, with one gain for all and the k_b that suits these names."""
        return self._nearest(lambda x: self._at(x, nodes, exciter))[0]

    def _nearest(self, off: Callable[[float], float]) -> tuple[float, float]:
        """How little is off, and at which ln k_b."""
        raster = [off(x) for x in self._k_b]
        k = int(np.argmin(raster))
        if len(self._k_b) == 1:
            return raster[k], float(self._k_b[k])
        ends = self._k_b[max(k - 1, 0)], self._k_b[min(k + 1, len(self._k_b) - 1)]
        nearest = minimize_scalar(off, bounds=ends, method="bounded", options={"xatol": 1e-3})
        return min((raster[k], float(self._k_b[k])), (float(nearest.fun), float(nearest.x)))

    def rough_distance(self, nodes: Sequence[int], exciter: int) -> float:
        """``distance`` at the nearest k_b of a raster."""
        return min(self._at(x, nodes, exciter) for x in self._k_b)

    def with_own_sizes(self, nodes: Sequence[int], exciter: int) -> tuple[float, FloatArray]:
        """What each channel is off with a gain of its own, at the k_b that suits, and these beside the usual.

        Returns
        -------
        mean over channels of the median |ln ratio|, and (n,) logarithms of their gains over the median one
        """
        left, ln_k_b = self._nearest(lambda x: float(np.mean(self._off(x, nodes, exciter)[0])))
        sizes = self._off(ln_k_b, nodes, exciter)[1]
        return left, sizes - np.median(sizes)

    def _off(self, ln_k_b: float, nodes: Sequence[int], exciter: int) -> tuple[FloatArray, FloatArray]:
        """(n,) median |ln ratio| of every channel with a gain of its own, and (n,) logarithms of these gains."""
        ratio = self._ratio(ln_k_b, nodes, exciter)
        sizes = np.median(ratio, axis=0)
        return np.median(np.abs(ratio - sizes), axis=0), sizes

    def _ratio(self, ln_k_b: float, nodes: Sequence[int], exciter: int) -> FloatArray:
        return self._measured - self._drawn(ln_k_b, exciter)[:, np.array(nodes) - 1]

    def _at(self, ln_k_b: float, nodes: Sequence[int], exciter: int) -> float:
        ratio = self._ratio(ln_k_b, nodes, exciter)
        ratio -= np.median(np.median(ratio, axis=0))
        return float(np.mean(np.median(np.abs(ratio), axis=0)))


def _is_as_drawn(p: CheckedRun, geometry: Geometry) -> bool:
    """Whether a run is near the drawing's on its own supports, whatever hum its first resonance may be."""
    places = _telling_places(p, geometry)
    nodes = [p.channels[i].node for i in places]
    return bool(nodes) and _Curves(p, places, geometry).distance(nodes, p.run.excitation_node) < _LIMITS.distance


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
