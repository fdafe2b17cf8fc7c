"""Pictures of modes, Campbell diagrams, critical speeds and responses to unbalance, drawn by matplotlib.

Every function returns a figure; ``save_figure`` writes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rigtwin.pages.palette import BLUE, GREEN, GREY, GRID, INK, ORANGE, PURPLE, VERMILION
from rigtwin.rotor.frequency.shapes import semi_axes
from rigtwin.rotor.frequency.stiffness_map import CriticalSpeedMap
from rigtwin.rotor.frequency.whirl import RPM, Campbell, Crossings
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray
from rigtwin.rotor.model.speed_tables import SpeedTable
from rigtwin.scratch import replacing

_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}
_WIDTH, _DPI = 7.2, 150  # inches, dots per inch
_DIRECTIONS = {1.0: ("forward", BLUE, "-"), -1.0: ("backward", VERMILION, "--"), 0.0: ("planar", GREEN, "-.")}
_NODE_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, GREY, INK)

# Distance of the zero lines of shapes above each other, where a largest deflection is 1; and on paper [inches].
_ROW, _ROW_INCHES = 2.9, 1.1

# An orbit is drawn from its dot through this share of a period, so that the gap shows which way it turns.
_DRAWN_ORBIT = 0.9


@dataclass(frozen=True)
class DrawnMode:
    """A mode as it is to be drawn."""

    title: str
    line: ComplexArray  # (2, n_x) deflection in y and in z along the shaft, the largest 1
    nodes: ComplexArray  # (2, n_nodes) the same at the nodes
    direction: float  # 1 forward, -1 backward, 0 planar


@dataclass(frozen=True)
class MeasuredResonance:
    """A resonance of a campaign, and the stiffnesses at which the model has it; none on rigid supports."""

    frequency_hz: float
    rigid: bool
    k_b: tuple[float, ...]


def save_figure(figure: Figure, path: Path) -> None:
    """Write a picture; an existing file is replaced only when the new one is complete."""
    kind = path.suffix[1:].lower()
    metadata: dict[str, Any] = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    with rc_context(_STYLE), replacing(path) as beside:
        figure.savefig(beside, format=kind, dpi=_DPI, metadata=metadata)


@contextmanager
def _drawing(height: float, layout: Literal["constrained"] | None = "constrained") -> Iterator[Figure]:
    """An empty figure so high [inches], drawn on in the style of all of them."""
    with rc_context(_STYLE):
        yield Figure(figsize=(_WIDTH, height), layout=layout)


# -- modes ---------------------------------------------------------------------------------------


def mode_figure(rig: Rig, x: FloatArray, modes: Sequence[DrawnMode], *, whirling: bool) -> Figure:
    """Shapes of modes: deflection along the shaft, or orbits in perspective where the modes whirl.

    Parameters
    ----------
    x : (n_x,) positions of the shapes' points [m]
    modes : one panel each
    """
    if whirling:
        return _orbit_panels(rig, x, modes)
    height = 0.8 + _ROW_INCHES * len(modes)
    with _drawing(height, layout=None) as figure:  # one pair of axes and no search for margins: twice as fast
        axes = figure.add_axes((0.02, 0.5 / height, 0.96, 1 - 0.8 / height))
        for place, mode in enumerate(modes):
            _draw_deflection(axes, rig, x, mode, -_ROW * place)
        axes.set(xlabel="x, mm", ylim=(-_ROW * len(modes) + 1.4, 1.8), yticks=())
        axes.spines["left"].set_visible(False)
        lines, labels = axes.get_legend_handles_labels()
        entries = dict(zip(labels, lines, strict=True))
        if len(entries) > 1:
            figure.legend(entries.values(), entries.keys(), loc="upper right", ncols=2)
    return figure


def _draw_deflection(axes: Axes, rig: Rig, x: FloatArray, mode: DrawnMode, level: float) -> None:
    """One mode around its own zero line."""
    _silhouette(axes, rig, level)
    for plane, colour, style in ((0, BLUE, "-"), (1, VERMILION, "--")):
        if np.abs(mode.line[plane]).max() > 0:
            axes.plot(1e3 * x, level + mode.line[plane].real, style, color=colour, label=("in y", "in z")[plane])
            axes.plot(1e3 * np.array(rig.nodes_m), level + mode.nodes[plane].real, "o", color=colour, ms=3.5)
    axes.text(0, level + 1.2, mode.title)


def _silhouette(axes: Axes, rig: Rig, level: float) -> None:
    """The rotor behind a shape, thin: its axis, disks, masses, supports."""
    axes.axhline(level, color=GREY, lw=0.8)
    reach = max([disk.diameter_m or 0.0 for disk in rig.disk], default=0.0) or 1.0
    for disk in rig.disk:
        width = disk.thickness_m or 0.02 * rig.length
        half, left = 0.8 * (disk.diameter_m or reach) / reach, rig.nodes_m[disk.node - 1] - width / 2
        axes.fill_between([1e3 * left, 1e3 * (left + width)], level - half, level + half, color=GRID, lw=0)
    for mass in rig.mass:
        axes.plot(1e3 * rig.nodes_m[mass.node - 1], level, "s", color=GRID, ms=9)
    for support in rig.support:
        axes.plot(1e3 * rig.nodes_m[support.node - 1], level - 0.2, "^", color=GREY, ms=6)


def _orbit_panels(rig: Rig, x: FloatArray, modes: Sequence[DrawnMode]) -> Figure:
    rows = (len(modes) + 1) // 2
    with _drawing(0.2 + 2.1 * rows) as figure:
        for place, mode in enumerate(modes, start=1):
            _orbit_panel(figure.add_subplot(rows, min(len(modes), 2), place, projection="3d"), rig, x, mode)
    return figure


def _orbit_panel(axes: Any, rig: Rig, x: FloatArray, mode: DrawnMode) -> None:
    """Orbits at the nodes; dots and the thick line are the shaft at one moment."""
    _, colour, _ = _DIRECTIONS[mode.direction]
    turn = np.exp(2j * np.pi * np.linspace(0, _DRAWN_ORBIT, 60))
    nodes = 1e3 * np.array(rig.nodes_m)
    axes.plot(1e3 * x, 0 * x, 0 * x, color=GREY, lw=0.8)
    for place, orbit in zip(nodes, (mode.nodes[:, :, None] * turn).real.transpose(1, 0, 2), strict=True):
        axes.plot(np.full(len(turn), place), orbit[0], orbit[1], color=colour, lw=0.8)
    axes.plot(1e3 * x, mode.line[0].real, mode.line[1].real, color=INK)
    axes.plot(nodes, mode.nodes[0].real, mode.nodes[1].real, "o", color=INK, ms=3)
    axes.set(xlabel="x, mm", ylim=(-1, 1), zlim=(-1, 1), yticks=(-1, 0, 1), zticks=(-1, 0, 1), ylabel="y", zlabel="z")
    axes.xaxis.labelpad = 5
    axes.set_box_aspect((2.4, 1, 1), zoom=1.0)
    axes.set_title(mode.title, pad=0)
    axes.view_init(elev=18, azim=-62)


# -- spinning ------------------------------------------------------------------------------------


def campbell_figure(
    diagram: Campbell, met: Crossings, multiple: float, limits: Sequence[tuple[float, float]] = ()
) -> Figure:
    """Whirl frequencies over spin speed, coloured by direction, with a line of the speed and what meets it.

    Parameters
    ----------
    limits : spin speed [rev/min] and frequency [Hz] at which modes begin to grow
    """
    rpm = diagram.spin_speed / RPM
    with _drawing(4.4) as figure:
        axes = figure.subplots()
        for direction, (words, colour, style) in _DIRECTIONS.items():
            shown = np.where(_segments(diagram.direction, direction), diagram.frequency_hz, np.nan)
            _lines(axes, rpm, shown, color=colour, linestyle=style, label=words)
        top = 1.1 * np.nanmax(
            [*(multiple * rpm[-1:] / 60), diagram.frequency_hz[:, : diagram.direction.shape[1]].max()]
        )
        axes.plot(rpm, multiple * rpm / 60, color=GREY, lw=1.0, label=f"{multiple:g}x spin speed")
        axes.plot(met.spin_speed / RPM, multiple * met.spin_speed / RPM / 60, "o", color=INK, ms=5, mfc="white")
        for speed, direction in zip(met.spin_speed / RPM, met.direction, strict=True):
            above = {"xytext": (-4, 5), "ha": "right"} if direction < 0 else {"xytext": (4, -10), "ha": "left"}
            place = speed, multiple * speed / 60
            axes.annotate(f"{speed:.0f}", place, textcoords="offset points", fontsize=7.5, **above)
        if limits:
            axes.plot(*zip(*limits, strict=True), "X", color=PURPLE, ms=9, label="grows from here")
        axes.set(xlabel="spin speed, rev/min", ylabel="whirl frequency, Hz", xlim=(rpm[0], rpm[-1]), ylim=(0, top))
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.1), ncols=5)
    return figure


def _segments(direction: FloatArray, wanted: float) -> BoolArray:
    """(n_speeds, n_modes) points that lie on a stretch of this direction: each stretch has that of its upper end."""
    has = direction == wanted
    has[0] = has[1]
    return has | np.vstack([has[1:], has[-1:]])


def _lines(axes: Axes, x: FloatArray, columns: FloatArray, *, label: str, **style: Any) -> None:
    """A line for each column that has points; one entry in the legend."""
    for y in columns[:, np.isfinite(columns).any(axis=0)].T:
        axes.plot(x, y, label=label, **style)
        label = "_"


def critical_speed_figure(
    speeds: CriticalSpeedMap,
    standing_hz: FloatArray,
    measured: Sequence[MeasuredResonance],
    tables: Sequence[SpeedTable] = (),
) -> Figure:
    """Critical speeds over bearing stiffness; resonances that were measured at rest on the standing rotor's lines.

    Parameters
    ----------
    standing_hz : (n_k, n_modes) natural frequencies of the standing rotor, drawn if anything was measured [Hz]
    tables : supports that follow the spin speed; their direct stiffnesses are drawn over it
    """
    with _drawing(4.4) as figure:
        axes = figure.subplots()
        if measured:
            _lines(axes, speeds.k_b, standing_hz * 60, color=GREY, lw=0.9, label="at rest")
        for direction, (words, colour, style) in _DIRECTIONS.items():
            shown = np.where(speeds.direction == direction, speeds.spin_speed / RPM, np.nan)
            _lines(axes, speeds.k_b, shown, color=colour, linestyle=style, label=words)
        _draw_measured(axes, speeds.k_b, measured)
        for place, (words, colour) in enumerate((("kyy of tables", PURPLE), ("kzz of tables", ORANGE))):
            for number, table in enumerate(tables):
                label = "_" if number else words
                axes.plot(
                    table.stiffness[:, place, place], table.spin_speed / RPM, ".-", color=colour, label=label, lw=1
                )
        axes.set(xscale="log", yscale="log", xlabel="bearing stiffness k_b, N/m", ylabel="critical speed, rev/min")
        axes.set_xlim(speeds.k_b[0], speeds.k_b[-1])
        in_hertz: Any = (lambda rpm: rpm / 60, lambda hertz: hertz * 60)
        hertz = axes.secondary_yaxis("right", functions=in_hertz)
        hertz.set_ylabel("Hz")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=5)
    return figure


def _draw_measured(axes: Axes, k_b: FloatArray, measured: Sequence[MeasuredResonance]) -> None:
    """A thin line at each resonance, and a mark wherever the standing model has it."""
    labels = {False: "measured on bearings", True: "measured, rigid"}
    for one in measured:
        rpm = 60 * one.frequency_hz
        axes.axhline(rpm, color=ORANGE if one.rigid else PURPLE, lw=0.7, ls=":")
        x, mark = ([k_b[-1]], "<") if one.rigid else (one.k_b, "o")
        style: dict[str, Any] = {"color": ORANGE if one.rigid else PURPLE, "clip_on": False, "ls": "none", "ms": 6}
        axes.plot(x, [rpm] * len(x), mark, label=labels.pop(one.rigid, "_"), **style)


def unbalance_figure(
    spin_speed: FloatArray, response: ComplexArray, nodes: Sequence[int], critical: FloatArray
) -> Figure:
    """Amplitude and phase over spin speed.

    Parameters
    ----------
    spin_speed : (n_speeds,) [rad/s]
    response : (n_speeds, 2, n) deflections in y and z of the nodes [m]
    nodes : (n,) numbers of the nodes
    critical : (m,) critical speeds to be marked [rad/s]
    """
    rpm = spin_speed / RPM
    with _drawing(5.2) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for place, node in enumerate(nodes):
            y, z = response[:, 0, place], response[:, 1, place]
            style: dict[str, Any] = {
                "color": _NODE_COLOURS[place % len(_NODE_COLOURS)],
                "ls": "-" if place < len(_NODE_COLOURS) else "--",
            }
            upper.plot(rpm, 1e6 * semi_axes(y, z)[0], label=f"node {node}", **style)
            lower.plot(rpm, np.degrees(np.unwrap(np.angle(y))), **style)
        for speed in critical / RPM:
            for axes in (upper, lower):
                axes.axvline(speed, color=GREY, lw=0.8, ls=":")
        upper.set(yscale="log", ylabel="largest deflection, µm")
        lower.set(xlabel="spin speed, rev/min", ylabel="phase of y, degrees", xlim=(rpm[0], rpm[-1]))
        lower.yaxis.set_major_locator(_multiples_of(90))
        figure.legend(loc="outside upper center", ncols=8, columnspacing=1.2, handlelength=1.4)
    return figure


def _multiples_of(step: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    return MultipleLocator(step)
