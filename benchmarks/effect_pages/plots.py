"""Panels that show effects: responses over frequency on the paper's rotor, against the nominal one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from PIL import Image

from rigtwin.pages.palette import BLUE, GREEN, GRID, INK, ORANGE, PURPLE, VERMILION
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.continuation import trace
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Joint, load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.model.structure import Structure

# Draws one panel of a figure.
Panel = Callable[[Axes], None]

# What a curve is called, and the effects it has.
Cases = Mapping[str, Sequence[Effect]]

NODE = 2
BAND = 20.0, 400.0  # [Hz]
BEARING = Condition(k_b=1.3e6, bearing_damping=50.0, shaft_damping_ratio=0.003, excitation_node=NODE)
RIGID = Condition(rigid_support=True, shaft_damping_ratio=0.003, excitation_node=NODE)
ACCELERANCE = "acceleration per force, (m/s²)/N"

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
NOMINAL: dict[str, Any] = {"color": "#a9b0b8", "linewidth": 3.0}

_STYLE: dict[Any, Any] = {
    "font.size": 8.5,
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
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}
_PANEL_INCHES, _HEIGHT_INCHES, _DPI = 3.7, 3.1, 110

# Colours of a picture: a handful of lines and the shades at their edges.
_PALETTE = 128


@cache
def paper_rotor(elements: int = 4) -> Structure:
    """The paper's rotor, four elements between nodes."""
    return assemble(load_rig("nit-rourkela"), elements_between_nodes=elements)


def jointed_rotor(elements: int = 4) -> Structure:
    """The same with a joint of 20 kN m/rad in its middle."""
    joint = Joint(node=4, tilt_stiffness_Nm_per_rad=2e4)
    rig = load_rig("nit-rourkela").model_copy(update={"joint": [joint]})
    return assemble(rig, elements_between_nodes=elements)


def save(panels: Sequence[Panel], path: Path) -> None:
    """Draw panels side by side under one legend, into a PNG."""
    with rc_context(_STYLE):
        width = _PANEL_INCHES * len(panels) if len(panels) > 1 else 1.35 * _PANEL_INCHES
        figure = Figure(figsize=(width, _HEIGHT_INCHES), dpi=_DPI, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for panel, ax in zip(panels, axes, strict=True):
            panel(ax)
            plain_decades(ax)
        entries = {label: line for ax in axes for line, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        figure.legend(entries.values(), entries.keys(), loc="outside upper center", ncols=1 + 2 * len(panels))
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        picture.quantize(_PALETTE).save(path, optimize=True)


def plain_decades(ax: Axes) -> None:
    """Label a logarithmic axis with 0.1, 1, 10; with 2 and 5 between where it spans little more than a decade."""
    if ax.get_yscale() != "log":
        return
    low, high = ax.get_ylim()

    def words(value: float, _: float) -> str:
        return f"{value:g}" if 1e-3 <= value <= 1e4 else f"$10^{{{round(np.log10(value))}}}$"

    def between(value: float, place: float) -> str:
        return words(value, place) if round(value / 10 ** np.floor(np.log10(value)), 6) in (2, 5) else ""

    ax.yaxis.set_major_formatter(words)
    minor: Any = between if high < 30 * low else NullFormatter()
    ax.yaxis.set_minor_formatter(minor)


# -- linear responses ----------------------------------------------------------------------------


def lines_hz(condition: Condition, effects: Sequence[Effect], band: tuple[float, float] = BAND) -> FloatArray:
    """Frequencies that show every resonance: an even raster, and thirty half widths round each mode."""
    modes = damped_modes(build_system(paper_rotor(), condition, effects), condition.spin_speed)
    widths = np.concatenate([[0.0], np.geomspace(0.05, 60, 40)])
    around = np.outer(modes.frequency_hz * modes.damping_ratio, np.concatenate([-widths[::-1], widths]))
    near = (modes.frequency_hz[:, None] + around).ravel()
    raster = np.concatenate([np.linspace(*band, 500), near[(near > band[0]) & (near < band[1])]])
    return np.unique(raster)


def response(
    cases: Cases,
    condition: Condition = BEARING,
    *,
    title: str = "",
    band: tuple[float, float] = BAND,
    node: int = NODE,
    nominal: bool = True,
    **options: Any,
) -> Panel:
    """Magnitude of the accelerance; ``options`` go to ``measured_response``."""

    def draw(ax: Axes) -> None:
        for style, label, effects in curves(cases, nominal=nominal):
            f = lines_hz(condition, effects, band)
            H = measured_response(paper_rotor(), condition, effects, f, [node], **options)[:, 0]
            ax.semilogy(f, np.abs(H), label=label, **style)
        frame(ax, title or support_of(condition), band, ACCELERANCE)

    return draw


def curves(cases: Cases, *, nominal: bool = True) -> list[tuple[dict[str, Any], str, Sequence[Effect]]]:
    """Style, label and effects of every curve; the nominal rotor first, in grey."""
    first = [(NOMINAL, "nominal", ())] if nominal else []
    return first + [({"color": c}, label, effects) for c, (label, effects) in zip(COLOURS, cases.items(), strict=False)]


def frame(ax: Axes, title: str, limits: tuple[float, float], y_label: str, x_label: str = "frequency, Hz") -> None:
    """Title, limits and labels of a panel."""
    ax.set(title=title, xlim=limits, xlabel=x_label, ylabel=y_label)


def support_of(condition: Condition) -> str:
    """Title of a panel."""
    return "on rigid supports" if condition.rigid_support else "on bearings"


def on_both_supports(cases: Cases) -> tuple[Panel, Panel]:
    """The same curves on bearings and on rigid supports."""
    return response(cases, BEARING), response(cases, RIGID)


# -- nonlinear responses -------------------------------------------------------------------------


def at_levels(
    effect: Effect,
    levels_N: Sequence[float],
    band: tuple[float, float],
    harmonic: int = 1,
    *,
    title: str = "",
    widths: Sequence[float] = (1.3, 1.3, 1.3),
) -> Panel:
    """Response on bearings at several force amplitudes by harmonic balance; what is not stable dashed."""

    def draw(ax: Axes) -> None:
        if harmonic == 1:
            f = lines_hz(BEARING, (), band)
            ax.semilogy(f, np.abs(measured_response(paper_rotor(), BEARING, (), f, [NODE])), label="nominal", **NOMINAL)
        balance = Balance(build_model(paper_rotor(), BEARING, [effect]), BEARING)
        for colour, force, width in zip(COLOURS, levels_N, widths, strict=False):
            motions = trace(balance, *band, force).motions
            size = np.abs(motions.acceleration()[:, harmonic, NODE - 1])
            stable = np.where(motions.stable, size, np.nan)
            ax.semilogy(motions.frequency_hz, stable, color=colour, linewidth=width, label=f"{force:g} N")
            ax.semilogy(motions.frequency_hz, size, color=colour, linestyle=(0, (2, 1.5)), linewidth=0.9)
        words = {1: "on bearings, at the force's frequency", 2: "second harmonic", 3: "third harmonic"}
        frame(ax, title or words[harmonic], band, ACCELERANCE)

    return draw


def force_law(effect: Effect, reach_m: float, *, linear: float = BEARING.k_b) -> Panel:
    """What the joint pulls back with over its displacement, the linear stiffness included."""

    def draw(ax: Axes) -> None:
        law = build_model(paper_rotor(), BEARING, [effect]).forces[0]
        x = np.linspace(-reach_m, reach_m, 401)
        ax.plot(1e6 * x, linear * x, label="nominal", **NOMINAL)
        ax.plot(1e6 * x, linear * x + law.along(x)[0], color=INK)
        ends = 1e6 * reach_m
        frame(ax, "at the joint", (-ends, ends), "force, N", "displacement, µm")

    return draw
