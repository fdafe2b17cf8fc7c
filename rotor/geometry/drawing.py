"""The rig drawn to scale as SVG, for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rigtwin.rotor.model.html import drawing

if TYPE_CHECKING:
    from rigtwin.rotor.geometry.rig import Rig, SupportTable

_WIDTH, _MARGIN, _TALLEST = 560.0, 24.0, 150.0
_MARK = "var(--mark, #d33)"


def rig_svg(rig: Rig, rings_m: Sequence[float] = ()) -> str:
    """Shaft, disks, masses, supports, node numbers and the force, to one scale in both directions where that fits.

    Parameters
    ----------
    rings_m : positions along the shaft that are ringed, in the colour ``--mark`` of the page around [m]

    Returns
    -------
    SVG of at most 560 px; a tall disk is drawn lower, so that the drawing stays flat
    """
    scale = (_WIDTH - 2 * _MARGIN) / rig.length
    tallest = max(_diameters(rig), default=0.0) * scale
    upward = scale * min(1.0, _TALLEST / tallest) if tallest else scale
    middle = max(tallest * upward / scale / 2, 20.0) + 30.0

    def x(position_m: float) -> float:
        return _MARGIN + scale * position_m

    half = middle - 24.0
    parts = [_shaft(rig, x, upward, middle), _disks(rig, x, upward, middle)]
    parts += [_support(support, x(rig.nodes_m[support.node - 1]), middle, half) for support in rig.support]
    parts += [_label(x(at), 2 * middle + 8, str(n)) for n, at in enumerate(rig.nodes_m, start=1)]
    force = x(rig.nodes_m[rig.excitation_node - 1])
    parts.append(
        f'<path d="M{force:.1f} {middle - half:.1f}V{middle - 8:.1f}m-4 -7l4 7l4 -7" stroke="{_MARK}" '
        'stroke-width="1.8"/>' + _label(force, middle - half - 6, "F", _MARK)
    )
    parts += [_ring(x(at), middle) for at in rings_m]
    words = f"{rig.title or rig.name}: {len(rig.nodes_m)} nodes, force at node {rig.excitation_node}"
    return drawing("".join(parts), _WIDTH, 2 * middle + 14, words)


def _ring(x: float, y: float) -> str:
    """Drawn twice, the first time as its own rim, so that it is seen on any ground."""
    circle = f'<circle class="ring" cx="{x:.1f}" cy="{y:.1f}" r="15" '
    return f'{circle}stroke="var(--paper, #fff)" stroke-width="7"/>{circle}stroke="{_MARK}" stroke-width="3.5"/>'


def _label(x: float, y: float, words: str, colour: str = "currentColor") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle" stroke="none" fill="{colour}">{words}</text>'


def _diameters(rig: Rig) -> list[float]:
    """Of shaft and disks [m]; a section of another shape has that of its circle."""
    return [*(d for s in rig.segment for d in s.outline[0]), *(d.diameter_m or 0.0 for d in rig.disk)]


def _shaft(rig: Rig, x, upward: float, middle: float) -> str:
    """Each segment, and its bore dashed."""
    parts, left = [], 0.0
    for segment in rig.segment:
        ends, (outer, bores) = (x(left), x(left + segment.length_m)), segment.outline
        heights = [max(upward * diameter, 2.0) / 2 for diameter in outer]
        outline = [(ends[0], -heights[0]), (ends[1], -heights[1]), (ends[1], heights[1]), (ends[0], heights[0])]
        points = " ".join(f"{at:.1f},{middle + up:.1f}" for at, up in outline)
        parts.append(f'<polygon points="{points}" fill="#9db4c8"/>')
        for side in (-0.5, 0.5) if any(bores) else ():
            start, stop = (middle + side * upward * bore for bore in bores)
            line = f"M{ends[0]:.1f} {start:.1f}L{ends[1]:.1f} {stop:.1f}"
            parts.append(f'<path d="{line}" stroke-dasharray="3 2" stroke-width="0.8" fill="none"/>')
        left += segment.length_m
    return "".join(parts)


def _disks(rig: Rig, x, upward: float, middle: float) -> str:
    parts = []
    for disk in rig.disk:
        at, thickness = rig.nodes_m[disk.node - 1], disk.thickness_m or 0.03 * rig.length
        height = upward * disk.diameter_m if disk.diameter_m else 40.0
        parts.append(_box(x(at - thickness / 2), x(at + thickness / 2), middle, height, "#5b7083"))
    for mass in rig.mass:
        parts.append(f'<circle cx="{x(rig.nodes_m[mass.node - 1]):.1f}" cy="{middle:.1f}" r="5" fill="#5b7083"/>')
    return "".join(parts)


def _box(left: float, right: float, middle: float, height: float, colour: str) -> str:
    return (
        f'<rect x="{left:.1f}" y="{middle - height / 2:.1f}" width="{right - left:.1f}" height="{height:.1f}" '
        f'fill="{colour}"/>'
    )


def _support(support: SupportTable, at: float, middle: float, half: float) -> str:
    """A spring of a bearing, a triangle of another support, with the ground beneath."""
    foot = middle + half + 6
    if support.stiffness == "k_b":
        turns = "".join(f"l{dx} {(half + 2) / 7:.2f}" for dx in (4, -8, 8, -8, 8, -8, 4))
        leg = f'<path d="M{at:.1f} {middle + 4:.1f}{turns}" stroke="#c9683c" stroke-width="1.6"/>'
    else:
        leg = f'<path d="M{at:.1f} {middle + 4:.1f}L{at - 9:.1f} {foot:.1f}H{at + 9:.1f}Z"/>'
    return leg + f'<path d="M{at - 12:.1f} {foot:.1f}H{at + 12:.1f}"/>'
