"""The page of a machine whose bearing softens: stiffness, speed and vibration over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from rigtwin.pages.figures import styled
from rigtwin.pages.overlay_page import Drawn, Table, write_overlays
from rigtwin.pages.palette import BLUE, GREY, INK, ORANGE, VERMILION
from rigtwin.rotor.frequency.whirl import RPM
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.machine import MachineRun


def write_machine_page(
    path: Path,
    title: str,
    result: str,
    sentences: Sequence[str],
    table: Table,
    runs: tuple[MachineRun, MachineRun],
    margin: float,
) -> Path:
    """Write the page of a run with and one without supervisor; ``margin`` is kept from each resonance, relative."""
    figures = [_stiffness(runs[0]), _speed(*runs, margin), _vibration(*runs)]
    return write_overlays(path, title, result, sentences, [table], figures)


def _stiffness(run: MachineRun) -> Drawn:
    figure, known = go.Figure(), run.valid
    ends = np.where(known, run.low, np.nan) / 1e6, np.where(known, run.high, np.nan) / 1e6
    for end, fill in zip(ends, (None, "tonexty"), strict=True):
        band = {"line": {"width": 0}, "fill": fill, "fillcolor": "rgba(0,114,178,0.25)", "hoverinfo": "skip"}
        figure.add_trace(go.Scatter(x=run.time, y=end, showlegend=False, connectgaps=False, **band))
    figure.add_trace(_line(run.time, run.k_b / 1e6, "the bearing's", INK, "%{y:.4g} MN/m", dash="dot"))
    tracked = np.where(known, run.tracked, np.nan) / 1e6
    figure.add_trace(_line(run.time, tracked, "tracked, with its 90 % interval", BLUE, "%{y:.4g} MN/m"))
    figure.update_yaxes(title="bearing stiffness, MN/m", rangemode="tozero")
    caption = "Where the tracker does not know the stiffness (valid is false), its line has a gap."
    return _drawn(figure, "Bearing stiffness", caption)


def _speed(run: MachineRun, alone: MachineRun, margin: float) -> Drawn:
    figure = go.Figure()
    resonance = np.where(run.resonance > 0, run.resonance, np.nan) / RPM
    for factor, fill in ((1 - margin, None), (1 + margin, "tonexty")):
        band = {"line": {"width": 0}, "fill": fill, "fillcolor": "rgba(213,94,0,0.18)", "hoverinfo": "skip"}
        figure.add_trace(go.Scatter(x=run.time, y=factor * resonance, showlegend=False, **band))
    figure.add_trace(_line(run.time, resonance, "resonance, by the tracked stiffness", VERMILION, "%{y:.0f} rev/min"))
    figure.add_trace(_line(run.time, alone.speed / RPM, "speed without supervisor", GREY, "%{y:.0f} rev/min", "dash"))
    figure.add_trace(_line(run.time, run.speed / RPM, "speed with supervisor", BLUE, "%{y:.0f} rev/min"))
    figure.update_yaxes(title="speed, rev/min", rangemode="tozero")
    caption = "In the shaded band the speed is nearer to the resonance than the supervisor allows."
    return _drawn(figure, "Speed", caption)


def _vibration(run: MachineRun, alone: MachineRun) -> Drawn:
    figure = go.Figure()
    figure.add_trace(_line(alone.time, alone.vibration, "without supervisor", ORANGE, "%{y:.3g} m/s²", "dash"))
    figure.add_trace(_line(run.time, run.vibration, "with supervisor", BLUE, "%{y:.3g} m/s²"))
    figure.update_yaxes(title="acceleration, m/s², rms", type="log", dtick="D2")
    window = run.time[1] - run.time[0]
    return _drawn(figure, "Vibration", f"Rms over {1e3 * window:.0f} ms of the acceleration that the tracker reads.")


def _line(x: FloatArray, y: FloatArray, name: str, colour: str, hover: str, dash: str = "solid") -> go.Scatter:
    template = "%{x:.2f} s<br>" + hover + "<extra>" + name + "</extra>"
    return go.Scatter(
        x=x, y=y, name=name, line={"color": colour, "dash": dash, "width": 2}, hovertemplate=template, mode="lines"
    )


def _drawn(figure: go.Figure, title: str, caption: str) -> Drawn:
    figure.update_xaxes(title="time, s")
    traces: Any = figure.data
    names = ", ".join(str(trace.name) for trace in traces if trace.name)
    return Drawn(title, styled(figure, f"{title} over time: {names}."), caption)
