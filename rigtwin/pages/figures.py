"""Plotly figures of a page, and the drawing of the rotor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup

from rigtwin.pages.palette import BLUE, GREEN, GRID, INK, ORANGE, PAPER, PURPLE, VERMILION
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.drawing import rig_svg
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Channel, Run

_BEARING_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)

# A band of standard errors thinner than this share of its curve cannot be seen.
_VISIBLE_BAND = 0.03

# Axis titles of responses, by quantity.
RESPONSE_UNITS: dict[str, str] = {
    "accelerance": "acceleration per force, (m/s²)/N",
    "acceleration": "acceleration, m/s²",
    "mobility": "velocity per force, (m/s)/N",
    "receptance": "displacement per force, m/N",
}

_TEMPLATE = go.layout.Template(
    layout={
        "font": {"family": "system-ui, -apple-system, Segoe UI, Roboto, sans-serif", "size": 14, "color": INK},
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "margin": {"l": 70, "r": 16, "t": 8, "b": 56},
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0},
        "hoverlabel": {"bgcolor": PAPER},
        "xaxis": {"gridcolor": GRID, "linecolor": INK, "ticks": "outside", "zeroline": False, "automargin": True},
        "yaxis": {"gridcolor": GRID, "linecolor": INK, "ticks": "outside", "zeroline": False, "automargin": True},
    }
)


@dataclass(frozen=True)
class Curve:
    """A run as it is to be drawn."""

    run: Run
    label: str
    channel: Channel


@dataclass(frozen=True)
class Mark:
    """A measured rig in the figure of frequencies over stiffness; a list of them is one legend entry."""

    k_b: float
    k_b_std: float
    frequencies_hz: tuple[float, float]


def frf_figure(curves: Sequence[Curve]) -> go.Figure:
    """Frequency responses, as in the paper's Fig. 9: rigid dotted, bearing solid; logarithmic."""
    figure = go.Figure()
    colours = iter(_BEARING_COLOURS * (len(curves) // len(_BEARING_COLOURS) + 1))
    for curve in curves:
        rigid = curve.run.support == "rigid"
        line = {"color": INK if rigid else next(colours), "dash": "dot" if rigid else "solid", "width": 2}
        f, size, std = _magnitude(curve)
        if std is not None and size.size and np.nanmax(std / size) > _VISIBLE_BAND:
            figure.add_trace(_band(f, size, std, line["color"]))
        hover = "%{x:.4f} Hz<br>%{y:.4g}<extra>" + curve.label + "</extra>"
        figure.add_trace(go.Scatter(x=f, y=size, name=curve.label, line=line, hovertemplate=hover))
    quantities = {curve.run.quantity for curve in curves}
    y_title = RESPONSE_UNITS[quantities.pop()] if len(quantities) == 1 else "response"
    figure.update_yaxes(type="log", title=y_title, exponentformat="power", dtick=1)
    figure.update_xaxes(title="frequency, Hz")
    names = ", ".join(curve.label for curve in curves)
    return styled(figure, f"Magnitude of the response over frequency, {y_title}: {names}.")


def _magnitude(curve: Curve) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Frequency, magnitude, and standard error where it is known; zeros left out."""
    run = curve.run
    place = run.channels.index(curve.channel)
    size = np.abs(run.H[:, place])
    shown = size > 0
    std = run.std[shown, place] if run.std is not None else None
    return run.frequency_hz[shown], size[shown], std


def _band(f: FloatArray, size: FloatArray, std: FloatArray, colour: str) -> go.Scatter:
    low, high = np.maximum(size - std, 0.05 * size), size + std
    return go.Scatter(
        x=np.concatenate([f, f[::-1]]),
        y=np.concatenate([high, low[::-1]]),
        fill="toself",
        fillcolor=colour,
        opacity=0.2,
        line={"width": 0},
        hoverinfo="skip",
        showlegend=False,
    )


def two_frequencies_hz(structure: Structure, condition: Condition) -> FloatArray:
    """(2,) first two bending frequencies in y [Hz]."""
    return natural_frequencies_hz(build_system(structure, condition), plane=1)[:2]


def frequency_figure(structure: Structure, marks: Mapping[str, Sequence[Mark]]) -> go.Figure:
    """The paper's Fig. 2: the first two bending frequencies over bearing stiffness, with measured rigs on it."""
    k_b = np.geomspace(1e5, 1e15, 161)
    f = np.array([two_frequencies_hz(structure, Condition(k_b=float(k))) for k in k_b])  # (n, 2)
    figure = go.Figure()
    for mode, colour in enumerate((BLUE, GREEN)):
        name = f"f{mode + 1}, finite elements"
        hover = "%{x:.3g} N/m<br>%{y:.2f} Hz<extra>" + name + "</extra>"
        line = {"color": colour, "width": 2}
        figure.add_trace(go.Scatter(x=k_b, y=f[:, mode], name=name, line=line, hovertemplate=hover))
    for (name, group), symbol, colour in zip(marks.items(), ("circle", "diamond"), (INK, VERMILION), strict=False):
        figure.add_trace(_marks(name, group, symbol, colour))
    figure.update_xaxes(type="log", title="bearing stiffness k_b, N/m", exponentformat="power", dtick=2)
    figure.update_yaxes(title="natural frequency, Hz", rangemode="tozero")
    return styled(figure, f"The first two natural frequencies over the bearing stiffness; marks: {', '.join(marks)}.")


def _marks(name: str, group: Sequence[Mark], symbol: str, colour: str) -> go.Scatter:
    points = [(mark.k_b, mark.k_b_std, f) for mark in group for f in mark.frequencies_hz]
    x, std, y = zip(*points, strict=True)
    return go.Scatter(
        x=x,
        y=y,
        error_x={"type": "data", "array": std, "color": colour, "thickness": 1.5},
        mode="markers",
        name=name,
        marker={"symbol": symbol, "size": 10, "color": PAPER, "line": {"color": colour, "width": 2}},
        hovertemplate="%{x:.4g} N/m<br>%{y:.2f} Hz<extra>" + name + "</extra>",
    )


def readings_figure(readings: Sequence[tuple[str, float, float, float]], printed: tuple[str, float]) -> go.Figure:
    """Stiffnesses with their intervals below each other, and a printed value as a line."""
    names, k_b, low, high = (np.array(column) for column in zip(*readings, strict=True))
    figure = go.Figure(
        go.Scatter(
            x=k_b / 1e6,
            y=names,
            error_x={"type": "data", "array": (high - k_b) / 1e6, "arrayminus": (k_b - low) / 1e6, "thickness": 2},
            mode="markers",
            marker={"size": 11, "color": BLUE},
            hovertemplate="%{x:.3f} MN/m<extra>%{y}</extra>",
        )
    )
    name, value = printed
    figure.add_vline(x=value / 1e6, line={"color": VERMILION, "dash": "dash", "width": 2})
    figure.add_annotation(x=value / 1e6, y=1, yref="paper", text=name, showarrow=False, xanchor="left", xshift=6)
    figure.update_xaxes(title="bearing stiffness k_b, MN/m")
    figure.update_yaxes(autorange="reversed", showgrid=False)
    told = ", ".join(f"{source} {value / 1e6:.3g}" for source, value in zip(names, k_b, strict=True))
    return styled(figure, f"Bearing stiffness in MN/m by source: {told}; {name} {value / 1e6:.3g}.", height=240)


def styled(figure: go.Figure, words: str, height: int = 420) -> go.Figure:
    """The same figure in the pages' fonts and colours, so high [px], and in words for who cannot see it."""
    return figure.update_layout(template=_TEMPLATE, height=height, meta=words)


def rotor_drawing(rig: Rig, rings_m: Sequence[float] = ()) -> Markup:
    """The rig drawn to scale, with rings at some positions [m]."""
    return Markup(f'<div class="rotor">{rig_svg(rig, rings_m)}</div>')
