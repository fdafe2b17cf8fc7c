"""Plotly figures of a diagnosis, and the measured and computed responses that its page switches between."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike
from plotly.subplots import make_subplots

from rigtwin.gap.curves import SILENT, Curve, nrmse
from rigtwin.gap.document import Band, BearingStiffness, Cause, FittedJoint, JointStiffness, Shrink
from rigtwin.gap.phrases import part
from rigtwin.pages.diagnosis_words import cause_key, cause_title, finite, places, share
from rigtwin.pages.figures import RESPONSE_UNITS, styled
from rigtwin.pages.palette import BLUE, EDGE, EMPTY, GREY, INK, MAP, ON_MAP, ORANGE, PAPER, PURPLE, VERMILION
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel, Run

# Traces of the response figure that the page fills with the chosen run and node, in this order: row and name.
RESPONSE_TRACES = (
    ("size", "noise"), ("size", "nominal"), ("size", "corrected"), ("size", "measured"),
    ("phase", "nominal"), ("phase", "corrected"), ("phase", "measured"),
    ("gap", "std"), ("gap", "nominal"), ("gap", "corrected"),
)  # fmt: skip

# Logarithms of the gap at both ends of its map, and the most columns that leave room for numbers in the cells.
_MAP_RANGE = (-3.0, 0.0)
_MOST_NUMBERED = 14

# Candidates that are drawn: those that are not far below the first, and never fewer or more than these.
_LIKELY, _FEWEST, _MOST = 1e-3, 5, 10


# -- responses -----------------------------------------------------------------------------------


def run_label(run: Run) -> str:
    """'run01: bearing, 1 N at node 2': a run in a list."""
    force = f"{run.force_amplitude_N:g} N" if run.force_amplitude_N is not None else "force"
    plane = " z" if run.excitation_plane == "z" else ""
    parts = [run.support, f"{force} at node {run.excitation_node}{plane}"]
    parts += [f"swept {run.sweep}"] if run.sweep else []
    parts += [f"{run.spin_rpm:g} rpm"] if run.spin_rpm else []
    return (f"{run.name}: " if run.name else "") + ", ".join(parts)


def channel_label(channel: Channel) -> str:
    """'2', '2b' of a second sensor, or '2 z' in the other plane."""
    return f"{channel.node}{channel.label}" + ("" if channel.plane == "y" else f" {channel.plane}")


def responses(curves: Sequence[Curve]) -> list[dict[str, Any]]:
    """What the page draws of each run: frequencies in Hz, magnitudes, phases in hundredths of a degree.

    Arrays are base64 of little-endian numbers: frequencies float64, magnitudes and standard errors
    float32, phases int16 with -32768 for none.
    """
    return [
        {
            "label": run_label(curve.run),
            "title": RESPONSE_UNITS[curve.run.quantity],
            "frequency": _packed(curve.run.frequency_hz, "<f8"),
            "phase": not curve.run.magnitude_only,
            "lowest": _lowest_phase(curve.run),
            "channels": [_channel_record(curve, place) for place in range(len(curve.run.channels))],
        }
        for curve in curves
    ]


def _channel_record(curve: Curve, place: int) -> dict[str, Any]:
    run = curve.run
    models = {"measured": run.H, "nominal": curve.nominal, "corrected": curve.corrected}
    record: dict[str, Any] = {
        "label": f"node {channel_label(run.channels[place])}",
        "std": _packed(curve.std[:, place], "<f4"),
    }
    for name, H in models.items():
        if H is not None:
            size = np.abs(H[:, place])
            record[name] = {"size": _packed(np.where(size > 0, size, np.nan), "<f4")}
            if not run.magnitude_only:
                record[name]["phase"] = _packed(_phase(H[:, place], _lowest_phase(run)), "<i2")
    return record


def _packed(values: ArrayLike, kind: str) -> str:
    return base64.b64encode(np.asarray(values).astype(kind).tobytes()).decode()


def _lowest_phase(run: Run) -> int:
    """Where a turn of phase is cut [deg]: far from where resonances leave it, 0 and 180, of mobilities +-90."""
    return -180 if run.quantity == "mobility" else -90


def _phase(H: ComplexArray, lowest: int) -> FloatArray:
    """(n_freq,) phase in hundredths of a degree, whole; -32768 where there is no response."""
    degrees = np.angle(H, deg=True)  # (n_freq,)
    turned = (degrees - lowest) % 360.0 + lowest
    return np.where(np.abs(H) > 0, np.round(100 * turned), -32768)


def first_choice(curves: Sequence[Curve]) -> tuple[int, int]:
    """Places of the run with the largest gap, and in it of the driving point, else of the largest response."""
    gaps = [nrmse(curve.run.H, curve.run.H - _error(curve.run, curve.nominal)) for curve in curves]
    place = int(np.argmax([gap if finite(gap) else -1.0 for gap in gaps]))
    run = curves[place].run
    point = Channel(run.excitation_node, run.excitation_plane)
    largest = int(np.argmax(np.nan_to_num(np.abs(run.H)).max(axis=0)))
    return place, run.channels.index(point) if point in run.channels else largest


def response_figure(
    curves: Sequence[Curve], bands: Sequence[Band], corrected_name: str = "with the effect"
) -> go.Figure:
    """Axes for magnitude, phase, difference and band map; the page fills in a run and a node."""
    with_phase = any(not curve.run.magnitude_only for curve in curves)
    rows = ["size"] + ["phase"] * with_phase + ["gap"] + ["bands"] * bool(bands)
    heights = {"size": 0.4, "phase": 0.17, "gap": 0.28, "bands": 0.15}
    figure = make_subplots(
        rows=len(rows), shared_xaxes=True, vertical_spacing=0.04, row_heights=[heights[row] for row in rows]
    )
    styles = {
        "noise": {"fill": "toself", "fillcolor": INK, "opacity": 0.18, "line": {"width": 0}, "hoverinfo": "skip"},
        "measured": {"mode": "markers", "marker": {"color": INK, "size": 5}, "name": "measured"},
        "nominal": {"line": {"color": VERMILION, "width": 2, "dash": "dash"}, "name": "nominal, recalibrated"},
        "corrected": {"line": {"color": BLUE, "width": 2}, "name": corrected_name},
        "std": {"line": {"color": GREY, "width": 1.5}, "name": "standard error"},
    }
    corrected = any(curve.corrected is not None for curve in curves)
    for kind, name in RESPONSE_TRACES:
        row = rows.index(kind) + 1 if kind in rows else 1
        listed = (kind == "size" and name != "noise" and (name != "corrected" or corrected)) or name == "std"
        hover = "%{x:.4f} Hz<br>%{y:.4g}" + ("°" if kind == "phase" else "")
        hover = {} if name == "noise" else {"hovertemplate": hover + f"<extra>{styles[name]['name']}</extra>"}
        figure.add_trace(
            go.Scatter(x=[], y=[], legendgroup=name, showlegend=listed, **styles[name], **hover), row=row, col=1
        )
    figure.update_yaxes(type="log", exponentformat="power", dtick=1, row=1, col=1)
    if with_phase:
        figure.update_yaxes(title="phase, °", dtick=90, row=rows.index("phase") + 1, col=1)
    gap_row = rows.index("gap") + 1
    figure.update_yaxes(type="log", exponentformat="power", dtick=1, title="|measured − model|", row=gap_row, col=1)
    if bands:
        _add_bands(figure, bands, len(rows))
    figure.update_xaxes(title="frequency, Hz", row=len(rows), col=1)
    figure.update_yaxes(title={"standoff": 12, "font": {"size": 13}})
    shown = ["magnitude", *["phase"] * with_phase, "difference of measurement and model"]
    words = (
        f"Responses over frequency, measured and computed: {', '.join(shown)}, of the run and the node that are chosen."
    )
    return styled(figure, words, height=570 + 120 * with_phase + 130 * bool(bands)).update_layout(bargap=0)


def _add_bands(figure: go.Figure, bands: Sequence[Band], row: int) -> None:
    """Each band's share of the gap as a bar over its stretch of frequency, and its edges through all rows."""
    shares = [band.share for band in bands]
    figure.add_trace(
        go.Bar(
            x=[(band.f_lo + band.f_hi) / 2 for band in bands],
            width=[band.f_hi - band.f_lo for band in bands],
            y=[100 * value for value in shares],
            marker={"color": VERMILION, "line": {"color": PAPER, "width": 1.5}},
            text=[part(value) for value in shares],
            textposition="outside",
            cliponaxis=False,
            customdata=[f"{band_label(band)}, {band.f_lo:.4g} to {band.f_hi:.4g} Hz" for band in bands],
            hovertemplate="%{customdata}<br>%{y:.3g} % of the gap<extra></extra>",
            showlegend=False,
        ),
        row=row,
        col=1,
    )
    top = 100 * max([value for value in shares if finite(value)], default=1.0)
    figure.update_yaxes(title="share, %", range=[0, 1.45 * top or 1], nticks=3, row=row, col=1)
    for edge in sorted({edge for band in bands for edge in (band.f_lo, band.f_hi)}):
        line = {"color": EDGE, "width": 1, "dash": "dot"}
        figure.add_shape(type="line", x0=edge, x1=edge, xref="x", y0=0, y1=1, yref="paper", line=line, layer="below")


def band_label(band: Band) -> str:
    """'mode 2'."""
    return f"mode {band.mode}" if band.mode else "no mode"


# -- resonance lists -----------------------------------------------------------------------------


def peaks_figure(rows: Sequence[Mapping[str, Any]], best: str) -> go.Figure:
    """Listed peaks with their errors, and the resonances that two models have there; one line for each support."""
    supports = list(dict.fromkeys(row["support"] for row in rows))
    models = (
        ("listed", "listed_Hz", INK, "line-ns-open", 0.0),
        ("nominal model", "nominal_Hz", VERMILION, "circle", 0.2),
        (best, "best_Hz", BLUE, "diamond", -0.2),
    )
    figure = go.Figure()
    for name, key, colour, symbol, above in models:
        shown = [row for row in rows if finite(row[key])]
        error = {"type": "data", "array": [row["std_Hz"] for row in shown], "color": colour} if above == 0 else None
        figure.add_trace(
            go.Scatter(
                x=[row[key] for row in shown],
                y=[supports.index(row["support"]) + above for row in shown],
                error_x=error,
                mode="markers",
                name=name,
                marker={"symbol": symbol, "color": colour, "size": 11, "line": {"width": 2, "color": colour}},
                hovertemplate="%{x:.1f} Hz<extra>" + escape(name) + "</extra>",
            )
        )
    figure.update_yaxes(tickvals=list(range(len(supports))), ticktext=[f"{s} support " for s in supports],
                        range=[-0.6, len(supports) - 0.4], showgrid=False, ticks="")  # fmt: skip
    figure.update_xaxes(title="frequency, Hz", rangemode="tozero")
    words = f"Listed resonances with their errors, beside those of the nominal model and of {escape(best)}."
    return styled(figure, words, height=140 + 70 * len(supports))


# -- the gap by band, node and run ---------------------------------------------------------------


@dataclass(frozen=True)
class GapMap:
    """sqrt(sum |H - model|^2 / sum |H|^2) over the lines of one band, for each run and channel; nan: not there."""

    runs: tuple[str, ...]  # axis 0
    bands: tuple[Band, ...]  # axis 1
    channels: tuple[Channel, ...]  # axis 2
    before: FloatArray  # (n_runs, n_bands, n_channels) recalibrated nominal model
    after: FloatArray  # with the effect; nan where no model was corrected
    noise: FloatArray  # the standard error alone


def gap_map(curves: Sequence[Curve], bands: Sequence[Band]) -> GapMap:
    """The gap cell by cell; without bands, one over all lines."""
    f_hz = np.concatenate([curve.run.frequency_hz for curve in curves])
    known = tuple(bands) or (Band(float(f_hz.min()), float(f_hz.max()), None, 1.0),)
    channels = tuple(sorted({channel for curve in curves for channel in curve.run.channels}))
    shape = len(curves), len(known), len(channels)
    before, after, noise = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    for i, curve in enumerate(curves):
        columns = [channels.index(channel) for channel in curve.run.channels]
        for j, band in enumerate(known):
            inside = _inside(curve.run, band)
            before[i, j, columns] = _cells(curve.run, _error(curve.run, curve.nominal), inside)
            noise[i, j, columns] = _cells(curve.run, curve.std, inside)
            if curve.corrected is not None:
                after[i, j, columns] = _cells(curve.run, _error(curve.run, curve.corrected), inside)
    return GapMap(_short_labels([curve.run for curve in curves]), known, channels, before, after, noise)


def _error(run: Run, H: ComplexArray) -> ComplexArray:
    """(n_freq, n_channels) measured less model; of magnitudes where there is no phase."""
    return run.H - run.as_recorded(H)


def _inside(run: Run, band: Band) -> np.ndarray:
    return (run.frequency_hz >= band.f_lo) & (run.frequency_hz <= band.f_hi)


def _cells(run: Run, error: ComplexArray | FloatArray, inside: np.ndarray) -> FloatArray:
    """(n_channels,) of one band; nan for channels that hardly move and for a band without lines."""
    whole = np.nansum(np.abs(run.H) ** 2, axis=0)  # (n_channels,)
    size = np.nansum(np.abs(run.H[inside]) ** 2, axis=0)
    wrong = np.nansum(np.abs(error[inside]) ** 2, axis=0)
    usable = (whole > SILENT**2 * whole.max(initial=0.0)) & (size > 0)
    return np.sqrt(np.divide(wrong, size, out=np.full(len(size), np.nan), where=usable))


def _short_labels(runs: Sequence[Run]) -> tuple[str, ...]:
    """'bearing 1 N', with as much more as it takes to tell the runs apart."""
    labels = [f"{run.support} {run.force_amplitude_N:g} N" if run.force_amplitude_N else run.support for run in runs]
    for more in (
        lambda run: run.sweep or "",
        lambda run: f"at {run.excitation_node}{run.excitation_plane if run.excitation_plane == 'z' else ''}",
        lambda run: f"{run.spin_rpm:g} rpm",
        lambda run: run.name,
    ):
        twice = {label for label, count in Counter(labels).items() if count > 1}
        labels = [f"{label} {more(run)}".rstrip() if label in twice else label
                  for label, run in zip(labels, runs, strict=True)]  # fmt: skip
    return tuple(labels)


def gap_map_figure(cells: GapMap, corrected_name: str = "with the effect") -> go.Figure:
    """Rows are runs, columns are bands and in each the nodes; below it the same with the effect."""
    maps = {"nominal model, recalibrated": cells.before, corrected_name: cells.after}
    shown = {name: gap for name, gap in maps.items() if name.startswith("nominal") or np.isfinite(gap).any()}
    height, between, (top, bottom) = 27 * len(cells.runs), 40, (34, 74)  # [px]
    whole = height * len(shown) + between * (len(shown) - 1)
    figure = make_subplots(rows=len(shown), shared_xaxes=True, vertical_spacing=(len(shown) - 1) * between / whole)
    for row, (name, gap) in enumerate(shown.items(), start=1):
        figure.add_trace(_heat(cells, gap), row=row, col=1)
        if _columns(cells) <= _MOST_NUMBERED:
            figure.add_trace(_cell_numbers(cells, gap), row=row, col=1)
        figure.update_yaxes(autorange="reversed", showgrid=False, ticks="", row=row, col=1)
        above = 1 - (row - 1) * (height + between) / whole
        _write(figure, f"<b>{name}</b>", x=0, xref="paper", xanchor="left", y=above, yanchor="bottom", yshift=4)
    _label_columns(figure, cells)
    figure.update_layout(
        coloraxis={"colorscale": list(MAP), "cmin": _MAP_RANGE[0], "cmax": _MAP_RANGE[1], "showscale": False}
    )
    return styled(figure, _map_words(cells), height=whole + top + bottom).update_layout(
        margin={"t": top, "b": bottom}, plot_bgcolor=EMPTY
    )


def _map_words(cells: GapMap) -> str:
    """Where the largest gap of the map is."""
    words = "The gap of the nominal model in each band, at each node, for each run"
    if not np.isfinite(cells.before).any():
        return f"{words}."
    run, band, channel = np.unravel_index(np.nanargmax(cells.before), cells.before.shape)
    where = f"{band_label(cells.bands[band])}, node {channel_label(cells.channels[channel])}, {cells.runs[run]}"
    return f"{words}; it is largest in {where}, with {share(float(np.nanmax(cells.before)))}."


def _label_columns(figure: go.Figure, cells: GapMap) -> None:
    """Nodes below the columns, bands below the nodes, a line between bands."""
    n_bands, n_channels = len(cells.bands), len(cells.channels)
    nodes = [channel_label(channel) for channel in cells.channels] * n_bands
    figure.update_xaxes(showgrid=False, ticks="", tickvals=list(range(len(nodes))), ticktext=nodes, tickangle=0)
    for edge in range(1, n_bands):
        figure.add_vline(x=edge * n_channels - 0.5, line={"color": INK, "width": 1.5})
    for place, band in enumerate(cells.bands):
        name = f"{band_label(band)}<br>" if n_bands > 1 or band.mode else ""
        text = f"{name}{band.f_lo:.4g} to {band.f_hi:.4g} Hz"
        _write(figure, text, x=(place + 0.5) * n_channels - 0.5, y=0, yanchor="top", yshift=-24)
    _write(figure, "node ", x=0, xref="paper", xanchor="right", y=0, yanchor="top", yshift=-5)


def _write(figure: go.Figure, text: str, **where: Any) -> None:
    figure.add_annotation(text=text, yref="paper", showarrow=False, font={"size": 13}, **where)


def _heat(cells: GapMap, gap: FloatArray) -> go.Heatmap:
    """One map."""
    flat = gap.reshape(len(cells.runs), -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        colour = np.log10(flat)
    labels = [
        f"{band_label(band)}, node {channel_label(channel)}" for band in cells.bands for channel in cells.channels
    ]
    noise = cells.noise.reshape(len(cells.runs), -1)
    facts = [
        [f"{name}<br>{share(value)}, noise {share(floor)}" for name, value, floor in zip(labels, a, b, strict=True)]
        for a, b in zip(flat, noise, strict=True)
    ]
    return go.Heatmap(
        z=np.maximum(colour, _MAP_RANGE[0]),
        y=_row_names(cells),
        coloraxis="coloraxis",
        xgap=1,
        ygap=1,
        customdata=facts,
        hovertemplate="%{y}<br>%{customdata}<extra></extra>",
        hoverongaps=False,
    )


def _columns(cells: GapMap) -> int:
    return len(cells.bands) * len(cells.channels)


def _row_names(cells: GapMap) -> list[str]:
    return [escape(label) + " " for label in cells.runs]


def _cell_numbers(cells: GapMap, gap: FloatArray) -> go.Scatter:
    """The numbers of the cells, each in the colour that is read on its ground."""
    known = [(y, x, value) for y, row in zip(_row_names(cells), gap.reshape(len(cells.runs), -1), strict=True)
             for x, value in enumerate(row) if np.isfinite(value)]  # fmt: skip
    rows, columns, values = zip(*known, strict=True) if known else ((), (), ())
    dark_from = 10.0 ** (_MAP_RANGE[0] + 4 / (len(MAP) - 1) * (_MAP_RANGE[1] - _MAP_RANGE[0]))
    return go.Scatter(
        x=columns,
        y=rows,
        text=[_percent(value) for value in values],
        mode="text",
        textfont={"size": 12, "color": [ON_MAP[int(value >= dark_from)] for value in values]},
        hoverinfo="skip",
        showlegend=False,
    )


def _percent(value: float) -> str:
    """'0.66', '1.4', '84', '130': a cell's number in %."""
    if not np.isfinite(value):
        return ""
    return f"{100 * value:.0f}" if value >= 0.0995 else f"{100 * value:.2g}"


def map_width(cells: GapMap) -> int:
    """Least width at which the columns can be told apart [px]."""
    return max(320, 150 + max(18 * len(cells.channels), 110) * len(cells.bands))


# -- candidates, joint, shrink ---------------------------------------------------------------------


def foremost(causes: Sequence[Cause]) -> int:
    """How many of the ranked candidates a reader wants to see."""
    likely = sum(cause.probability >= _LIKELY for cause in causes)
    return min(len(causes), max(_FEWEST, min(likely, _MOST)))


def candidate_figure(causes: Sequence[Cause], equivalent: Sequence[Cause], *, named: bool = True) -> go.Figure:
    """Probabilities of the first candidates; hatched: cannot be told apart; *: at the edge of its prior."""
    same = {cause_key(cause) for cause in equivalent}
    shown = causes[: foremost(causes)]
    colours = [ORANGE if cause_key(c) in same else BLUE if named and n == 0 else GREY for n, c in enumerate(shown)]
    figure = go.Figure(
        go.Bar(
            x=[100 * cause.probability for cause in shown],
            y=list(range(len(shown))),
            orientation="h",
            marker={
                "color": colours,
                "pattern": {
                    "shape": ["/" if cause_key(cause) in same else "" for cause in shown],
                    "solidity": 0.6,
                    "size": 9,
                },
            },
            text=[part(cause.probability) + (" *" if cause.at_prior_edge else "") for cause in shown],
            textposition="outside",
            cliponaxis=False,
            customdata=[f"{cause_title(cause)}, {places(cause)}" for cause in shown],
            hovertemplate="%{customdata}<br>%{x:.2f} %<extra></extra>",
        )
    )
    names = [cause_title(cause).replace(" + ", "<br>+ ") + " " for cause in shown]
    figure.update_yaxes(
        tickvals=list(range(len(shown))), ticktext=names, autorange="reversed", showgrid=False, ticks=""
    )
    figure.update_xaxes(title="probability, %", range=[0, 135], tickvals=[0, 25, 50, 75, 100])
    rows = sum(max(1, len(cause.effects)) for cause in shown)
    told = ", ".join(f"{cause_title(cause)} {part(cause.probability)}" for cause in shown)
    words = f"Probabilities of the candidates: {told}."
    return styled(figure, words, height=80 + 14 * len(shown) + 20 * rows).update_layout(bargap=0.35)


def joint_figure(joint: JointStiffness) -> go.Figure:
    """Real and imaginary part over frequency; the axis shows what the bulk of the lines does."""
    figure = go.Figure()
    f, parts = np.array(joint.frequency_hz), {"real part": joint.real, "imaginary part": joint.imag}
    for (name, values), colour, symbol in zip(parts.items(), (BLUE, VERMILION), ("circle", "diamond"), strict=True):
        figure.add_trace(
            go.Scatter(
                x=f,
                y=np.array(values, dtype=float),
                name=name,
                mode="lines+markers",
                line={"color": colour, "width": 1},
                marker={"symbol": symbol, "size": 5},
                hovertemplate="%{x:.4f} Hz<br>%{y:.4g} N/m<extra>" + name + "</extra>",
            )
        )
    figure.add_hline(y=0, line={"color": INK, "width": 1})
    figure.update_xaxes(title="frequency, Hz")
    figure.update_yaxes(title="ΔZ, N/m", exponentformat="power", range=_bulk([*joint.real, *joint.imag]))
    words = f"Dynamic stiffness missing at node {joint.node} over frequency, real and imaginary part: {joint.order}."
    return styled(figure, words, height=340)


def law_figure(joint: FittedJoint) -> go.Figure:
    """Magnitude of the dynamic stiffness that was fitted at a node, over frequency."""
    size = np.abs(np.array(joint.real) + 1j * np.array(joint.imag))  # (n_freq,)
    figure = go.Figure(
        go.Scatter(
            x=np.array(joint.frequency_hz),
            y=size,
            mode="lines",
            line={"color": BLUE, "width": 2},
            hovertemplate="%{x:.4f} Hz<br>%{y:.4g} N/m<extra></extra>",
        )
    )
    figure.update_xaxes(title="frequency, Hz")
    figure.update_yaxes(title="|Z|, N/m", type="log", exponentformat="power", dtick=1)
    return styled(
        figure, f"Magnitude of the dynamic stiffness fitted at node {joint.node}, over frequency.", height=300
    )


def bearings_figure(bearings: BearingStiffness, corrected_name: str) -> go.Figure:
    """Stiffness and loss of each bearing, line by line with standard errors, beside the models'."""
    figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.6, 0.4])
    f = np.array(bearings.frequency_hz)
    parts = (
        ("real", bearings.real, bearings.nominal_real, bearings.corrected_real),
        ("imaginary", bearings.imag, bearings.nominal_imag, bearings.corrected_imag),
    )
    for row, (part_name, told, *modelled) in enumerate(parts, start=1):
        hover = f"%{{x:.4f}} Hz<br>%{{y:.4g}} N/m<extra>{part_name} part</extra>"
        figure.add_trace(
            go.Scatter(
                x=f,
                y=np.array(told),
                error_y={"type": "data", "array": bearings.std, "color": GREY, "thickness": 1, "width": 0},
                mode="markers",
                marker={"color": INK, "size": 5},
                name="told by the run",
                showlegend=row == 1,
                hovertemplate=hover,
            ),
            row=row,
            col=1,
        )
        lines = (("nominal, recalibrated", VERMILION, "dash"), (corrected_name, BLUE, "solid"))
        for values, (name, colour, dash) in zip(modelled, lines, strict=True):
            if values:
                line = {"color": colour, "width": 2, "dash": dash}
                trace = go.Scatter(x=f, y=values, line=line, name=name, showlegend=row == 1, hovertemplate=hover)
                figure.add_trace(trace, row=row, col=1)
        bulk = _bulk([*told, *(value for values in modelled for value in values)])
        figure.update_yaxes(title=f"{part_name}, N/m", exponentformat="power", range=bulk, row=row, col=1)
    figure.update_xaxes(title="frequency, Hz", row=2, col=1)
    words = "Dynamic stiffness of each bearing over frequency, real and imaginary part, beside that of the models."
    return styled(figure, words, height=460)


def _bulk(values: Sequence[float]) -> list[float] | None:
    """A range that shows nine lines of ten and zero; near a node of the shape the others reach far out."""
    known = np.array([value for value in values if finite(value)])
    if not known.size:
        return None
    low, high = np.minimum(np.percentile(known, 5), 0), np.maximum(np.percentile(known, 95), 0)
    margin = 0.25 * (high - low) or 1.0
    return [float(low - margin), float(high + margin)]


def shrink_figure(shrink: Shrink) -> go.Figure:
    """The gap on data that were held out: before, with gains and tolerances alone, after, and of noise alone."""
    bars = [
        ("nominal model", shrink.before, VERMILION),
        ("gains, tolerances alone", shrink.without_effect, ORANGE),
        ("with the effect", shrink.after, BLUE),
        ("noise alone", shrink.floor, GREY),
    ]
    names, values, colours = zip(*((n, v, c) for n, v, c in bars if v is not None and finite(v)), strict=True)
    figure = go.Figure(
        go.Bar(
            x=[100 * value for value in values],
            y=[name + " " for name in names],
            orientation="h",
            marker={"color": colours},
            hovertemplate="%{y}<br>%{x:.3g} %<extra></extra>",
            showlegend=False,
        )
    )
    ends = dict(zip(names, values, strict=True))
    if shrink.after_model is not None and finite(shrink.after_model):
        figure.add_trace(
            go.Scatter(
                x=[100 * shrink.after_model],
                y=["with the effect "],
                mode="markers",
                marker={"symbol": "diamond-open", "color": PURPLE, "size": 13, "line": {"width": 2}},
                hovertemplate="%{x:.3g} %<extra>by the fitting model</extra>",
                name="by the fitting model",
            )
        )
        ends["with the effect"] = max(ends.get("with the effect", 0.0), shrink.after_model)
    for name, value in zip(names, values, strict=True):
        figure.add_annotation(
            x=100 * ends[name], y=name + " ", text=share(value), showarrow=False, xanchor="left", xshift=10
        )
    figure.update_yaxes(autorange="reversed", showgrid=False, ticks="")
    figure.update_xaxes(title="gap (NRMSE), %", range=[0, 135 * max(*ends.values(), 1e-6)])
    told = ", ".join(f"{name} {share(value)}" for name, value in zip(names, values, strict=True))
    return styled(figure, f"The gap on data that were held out: {told}.", height=240).update_layout(bargap=0.35)
