"""The picture and the HTML page inside each FMU."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from rigtwin.fmu_src.estimator_variables import estimator_variables
from rigtwin.fmu_src.model_description import variability
from rigtwin.fmu_src.rotor_variables import RotorFacts, effects_in_fmu, rotor_variables
from rigtwin.fmu_src.tracker_variables import TrackerFacts
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.time.exciter import highest_frequency

_PAGES = Environment(
    loader=PackageLoader("rigtwin.fmu_src", "templates"), autoescape=select_autoescape(), undefined=StrictUndefined
)
_STEEL, _DISK, _BEARING = "#9db4c8", "#5b7083", "#c9683c"


def rotor_pages(rig: Rig, facts: RotorFacts, *, needs_python: bool = True) -> dict[str, bytes]:
    """``model.png`` and ``documentation/index.html`` of the rotor FMU, by path in the archive."""
    system = build_system(assemble(rig), Condition(k_b=facts.k_b_start, spin_speed=facts.spin_speed_start))
    f1 = float(elastic_frequencies_hz(system, plane=1)[0])
    page = _PAGES.get_template("rotor.html").render(
        rig=rig,
        facts=facts,
        rows=_rows(rotor_variables(facts)),
        effects=effects_in_fmu(),
        f1=f1,
        settling=_settling_s(f1, facts),
        highest_hz=highest_frequency(facts.step),
        needs_python=needs_python,
    )
    return {"model.png": rotor_picture(rig), "documentation/index.html": page.encode()}


def estimator_pages(model: Path, *, needs_python: bool = True) -> dict[str, bytes]:
    """``model.png`` and ``documentation/index.html`` of the estimator FMU."""
    from rigtwin.estimator.runtime import StiffnessEstimator

    card = StiffnessEstimator(model).card
    page = _PAGES.get_template("estimator.html").render(
        card=card, rows=_rows(estimator_variables(card["example_inputs"])), needs_python=needs_python
    )
    return {"model.png": estimator_picture(), "documentation/index.html": page.encode()}


def listener_pages(
    template: str,
    rig: Rig,
    facts: TrackerFacts,
    variables: Sequence[Variable],
    highest_hz: float,
    *,
    needs_python: bool = True,
    network: bool = False,
) -> dict[str, bytes]:
    """``model.png`` and ``documentation/index.html`` of the tracker or the monitor; ``network``: it has one."""
    known = {"rig": rig, "facts": facts, "highest_hz": highest_hz, "network": network}
    page = _PAGES.get_template(template).render(rows=_rows(variables), needs_python=needs_python, **known)
    return {"model.png": rotor_picture(rig), "documentation/index.html": page.encode()}


def machine_pages(
    rig: Rig, name: str, meaning: str, sentences: Sequence[str], variables: Sequence[Variable]
) -> dict[str, bytes]:
    """``model.png`` and ``documentation/index.html`` of an FMU that is connected to the rotor's."""
    page = _PAGES.get_template("machine.html").render(
        rig=rig, name=name, meaning=meaning, sentences=sentences, rows=_rows(variables), needs_python=False
    )
    return {"model.png": rotor_picture(rig), "documentation/index.html": page.encode()}


def _settling_s(f1: float, facts: RotorFacts) -> float:
    """Time for the slowest transient to fall by 1e-4, ln(1e4) / (zeta omega_1) [s]."""
    zeta = max(facts.shaft_damping_ratio, 1e-4)
    return 9.21 / (zeta * 6.2832 * f1)


def _rows(variables: Sequence[Variable]) -> list[dict[str, str]]:
    return [
        {
            "name": v.name,
            "causality": v.causality,
            "variability": variability(v),
            "type": v.type,
            "unit": v.unit or "",
            "start": _start(v),
            "range": _range(v),
            "description": v.description,
        }
        for v in variables
    ]


def _start(variable: Variable) -> str:
    if variable.start is None:
        return ""
    return str(variable.start).lower() if isinstance(variable.start, bool) else f"{variable.start:g}"


def _range(variable: Variable) -> str:
    if variable.labels:
        return ", ".join(f"{value} {label}" for value, label in enumerate(variable.labels))
    low, high = variable.minimum, variable.maximum
    if low is None and high is None:
        return ""
    return f"{'' if low is None else f'{low:g}'} … {'' if high is None else f'{high:g}'}"


# -- pictures ------------------------------------------------------------------------------------


def rotor_picture(rig: Rig) -> bytes:
    """The rig drawn to scale along the shaft, as PNG."""
    figure = Figure(figsize=(6, 3), dpi=100, layout="constrained")
    axes = figure.subplots()
    draw_rotor(axes, rig)
    return _png(figure)


def draw_rotor(axes: Axes, rig: Rig) -> None:
    """Draw shaft, disks, lumped masses, supports and node numbers; lengths in mm."""
    left, half = 0.0, 1.0
    for segment in rig.segment:
        ends, (outer, bores) = (1e3 * left, 1e3 * (left + segment.length_m)), segment.outline
        half = max(half, *(500 * diameter for diameter in outer))
        corners = [(at, side * 500 * d) for side in (1, -1) for at, d in list(zip(ends, outer, strict=True))[::side]]
        axes.add_patch(Polygon(corners, closed=True, fc=_STEEL, ec="k", lw=0.6))
        for side in (1, -1) if any(bores) else ():
            axes.plot(ends, [side * 500 * bore for bore in bores], "k--", lw=0.6)
        left += segment.length_m
    for disk in rig.disk:
        x = 1e3 * rig.nodes_m[disk.node - 1]
        radius, thickness = 500 * (disk.diameter_m or 5e-3 * half), 1e3 * (disk.thickness_m or 0.03 * rig.length)
        half = max(half, radius)
        axes.add_patch(Rectangle((x - thickness / 2, -radius), thickness, 2 * radius, fc=_DISK, ec="k", lw=0.8))
    for mass in rig.mass:
        axes.plot(1e3 * rig.nodes_m[mass.node - 1], 0, "o", ms=10, color=_DISK)
    for support in rig.support:
        _draw_support(axes, 1e3 * rig.nodes_m[support.node - 1], half, bearing=support.stiffness == "k_b")
    for number, x in enumerate(rig.nodes_m, start=1):
        axes.plot(1e3 * x, 0, ".", color="k", ms=4)
        axes.annotate(
            str(number),
            (1e3 * x, 0.15 * half),
            ha="center",
            va="bottom",
            fontsize=9,
            color="w" if _on_disk(rig, number) else "k",
        )
    x = 1e3 * rig.nodes_m[rig.excitation_node - 1]
    axes.annotate(
        "F",
        (x, 0.25 * half),
        (x, 1.05 * half),
        ha="center",
        color="#a01010",
        arrowprops={"arrowstyle": "->", "color": "#a01010"},
    )
    axes.set_xlim(-0.06e3 * rig.length, 1.06e3 * rig.length)
    axes.set_ylim(-1.3 * half, 1.3 * half)
    axes.set_xlabel("x [mm]")
    axes.set_yticks([])
    axes.spines[["left", "top", "right"]].set_visible(False)


def _on_disk(rig: Rig, node: int) -> bool:
    return any(disk.node == node for disk in rig.disk)


def _draw_support(axes: Axes, x: float, half: float, *, bearing: bool) -> None:
    if bearing:
        zigzag = [(0.0, -0.20), (0.12, -0.30), (-0.12, -0.42), (0.12, -0.54), (-0.12, -0.66), (0.0, -0.76)]
        axes.plot([x + half * a * 0.5 for a, _ in zigzag], [half * b for _, b in zigzag], color=_BEARING, lw=1.5)
    else:
        axes.add_patch(
            Polygon(
                [(x, -0.2 * half), (x - 0.2 * half, -0.76 * half), (x + 0.2 * half, -0.76 * half)], fc="none", ec="k"
            )
        )
    axes.plot([x - 0.25 * half, x + 0.25 * half], [-0.78 * half] * 2, color="k", lw=2)


def estimator_picture() -> bytes:
    """Three inputs, a network, one stiffness, as PNG."""
    figure = Figure(figsize=(5, 3), dpi=100, layout="constrained")
    axes = figure.subplots()
    layers = (3, 5, 1)
    points = [[(i, (j - (n - 1) / 2)) for j in range(n)] for i, n in enumerate(layers)]
    for here, after in pairwise(points):
        for x0, y0 in here:
            for x1, y1 in after:
                axes.plot([x0, x1], [y0, y1], color=_STEEL, lw=0.8, zorder=1)
    for x, y in (p for layer in points for p in layer):
        axes.plot(x, y, "o", ms=14, color=_DISK, zorder=2)
    for (x, y), name in zip(points[0], ("A₁/A₀", "Δf₂", "Δf₁"), strict=True):
        axes.annotate(name, (x - 0.15, y), ha="right", va="center", fontsize=12)
    axes.annotate("$k_b$ ± σ", (2.15, 0), ha="left", va="center", fontsize=12)
    axes.set_xlim(-0.8, 2.9)
    axes.set_ylim(-2.6, 2.6)
    axes.axis("off")
    return _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
