"""A page of tables and figures, most of them responses laid over each other: of a prediction, of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from rigtwin.pages.figures import RESPONSE_UNITS, styled
from rigtwin.pages.page import write_page
from rigtwin.pages.provenance import provenance
from rigtwin.sim.campaign import Run

# Letters of a label.
_LONGEST = 36


@dataclass(frozen=True)
class Table:
    """A table of a page, with its title and what a reader has to know of it."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True)
class Layer:
    """A run as it is laid over others."""

    run: Run
    label: str
    style: dict[str, object]  # of a plotly trace


@dataclass(frozen=True)
class Overlay:
    """Responses of one channel laid over each other."""

    title: str
    layers: Sequence[Layer]
    caption: str = ""

    @property
    def figure(self) -> go.Figure:
        """Magnitudes over frequency, logarithmic, of the channel of the first layer that moves most."""
        channel = self.layers[0].run.loudest
        figure = go.Figure()
        for layer in self.layers:
            size = np.abs(layer.run.channel(channel.node, channel.plane, channel.label))
            hover = "%{x:.4f} Hz<br>%{y:.4g}<extra>" + escape(layer.label) + "</extra>"
            figure.add_trace(
                go.Scatter(
                    x=layer.run.frequency_hz,
                    y=np.where(size > 0, size, np.nan),
                    name=_short(layer.label),
                    hovertemplate=hover,
                    **layer.style,
                )
            )
        title = f"{RESPONSE_UNITS[self.layers[0].run.quantity]} at {channel}"
        figure.update_yaxes(type="log", title=title, exponentformat="power", dtick=1)
        figure.update_xaxes(title="frequency, Hz")
        words = ", ".join(layer.label for layer in self.layers)
        return styled(figure, f"Magnitude over frequency, {title}: {words}.")


@dataclass(frozen=True)
class Drawn:
    """Another figure of a page."""

    title: str
    figure: go.Figure
    caption: str


def _short(label: str) -> str:
    """A label as Plotly reads it: HTML, no longer than a narrow window holds."""
    return escape(label if len(label) <= _LONGEST else f"{label[: _LONGEST - 1]}…")


def write_overlays(
    path: Path,
    title: str,
    result: str,
    sentences: Sequence[str],
    tables: Sequence[Table],
    overlays: Sequence[Overlay | Drawn],
) -> Path:
    """Write the page; an existing one is replaced only when the new one is complete."""
    return write_page(
        "overlays.html",
        path,
        title=title,
        result=result,
        sentences=sentences,
        tables=tables,
        overlays=overlays,
        provenance=provenance(),
    )
