"""Markdown of measured pages: tables, bars, figures."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from datetime import date
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no display is needed, and none is looked for

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

DOCS = Path(__file__).resolve().parents[1] / "docs"
HELD, MISSED = "**Limit kept:**", "**Limit exceeded:**"

# Okabe and Ito's colours, told apart by colour-blind readers too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


def machine() -> str:
    """The machine and the day, as a page names them."""
    return f"{platform.machine()}, {os.cpu_count()} cores, {date.today().isoformat()}"


def best_seconds(work: Callable[[], object], repeats: int = 3) -> float:
    """Shortest of several times that some work takes."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A markdown table; the first column is left-aligned, the others right-aligned."""
    rule = [":--"] + ["--:"] * (len(header) - 1)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, rule, *rows)) + "\n"


def bar(claim: str, measured: float, *, at_most: float, unit: str = "") -> str:
    """One measured figure beside the bar it has to stay under; also printed by the command."""
    verdict = HELD if measured <= at_most else MISSED
    unit = f" {unit}" if unit else ""
    return f"{verdict} {claim}: {measured:.3g}{unit}, allowed {at_most:g}{unit}.\n"


def bars_in(markdown: str) -> list[str]:
    """The lines that ``bar`` wrote."""
    return [line for line in markdown.splitlines() if line.startswith((HELD, MISSED))]


def new_figure(x_label: str, y_label: str) -> tuple[Figure, Axes]:
    """An empty figure of the document's size with labelled axes."""
    figure, axes = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    axes.set(xlabel=x_label, ylabel=y_label)
    axes.grid(visible=True, color="0.88", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def save_figure(figure: Figure, name: str, caption: str) -> str:
    """Write docs/figures/<name>.png and return the markdown that shows it."""
    path = DOCS / "figures" / f"{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)
    return f"![{caption}](figures/{name}.png)\n\n*{caption}*\n"


def power_of_ten(value: float) -> str:
    """'1e7' for 1e+07: stiffnesses as the paper writes them."""
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"
