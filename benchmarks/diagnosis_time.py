"""What one diagnosis alone costs: ``python -m benchmarks.diagnosis_time`` writes docs/diagnosis-time.md."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.campaigns import tuning_campaigns
from benchmarks.page import DOCS, bar, best_seconds, machine, table
from rigtwin.api.diagnoses import measured_on_the_virtual_rig, shared_among
from rigtwin.gap.diagnose import diagnose
from rigtwin.sim.campaign_folder import load_campaign

# Campaigns of the tuning split that no threshold has seen.
SEED = 25


@dataclass(frozen=True)
class Group:
    """Campaigns of a kind; what they may take [s]."""

    words: str
    set: str
    count: int
    nonlinear: bool
    most: float


GROUPS = (
    Group("one linear effect or artefact", "W1", 12, False, 20.0),
    Group("no gap", "W3", 4, False, 20.0),
    Group("pairs", "W4", 8, False, 40.0),
    Group("mechanisms that no library holds", "W8", 6, False, 40.0),
    Group("three levels, nonlinear", "W1", 8, True, 90.0),
)


def main() -> None:
    """Make, diagnose one after another, print, write the page."""
    rows, bars = [], []
    with tempfile.TemporaryDirectory() as folder, shared_among(2) as helpers:
        for group in GROUPS:
            times = [_diagnosed(campaign, helpers) for campaign in _campaigns(group, Path(folder))]
            alone, fmu = (np.array(values) for values in zip(*times, strict=True))
            cells = (group.words, str(len(times)), _seconds(alone), f"{alone.max():.1f}", _seconds(fmu))
            rows.append(cells)
            bars.append(bar(f"{group.words}, median", float(np.median(alone)), at_most=group.most, unit="s"))
    page = _page(rows, bars)
    (DOCS / "diagnosis-time.md").write_text(page, encoding="utf-8")
    print(page)


def _campaigns(group: Group, folder: Path) -> list[Path]:
    """The first campaigns of the kind, two supports and 280 lines each."""
    made = tuning_campaigns(group.set, SEED, folder, group.nonlinear)
    return [path for path, _ in itertools.islice(made, group.count)]


def _diagnosed(folder: Path, helpers: Executor | None) -> tuple[float, float]:
    """Seconds of the diagnosis, and of the FMU that confirms it."""
    campaign, fmu = load_campaign(folder), 0.0

    def confirm(*asked: Any) -> Any:
        nonlocal fmu
        begin = time.perf_counter()
        found = measured_on_the_virtual_rig(campaign, *asked, progress=lambda done, total, words: None)
        fmu += time.perf_counter() - begin
        return found

    whole = best_seconds(lambda: diagnose(campaign, confirm=confirm, helpers=helpers), 1)
    return whole - fmu, fmu


def _seconds(values: np.ndarray) -> str:
    return f"{np.median(values):.1f}"


def _page(rows: Sequence[tuple[str, ...]], bars: Sequence[str]) -> str:
    header = ("campaign", "how many", "median, s", "longest, s", "confirmation by the FMU, median, s")
    return f"""# What a diagnosis costs

This page says how long one diagnosis takes. `python -m benchmarks.diagnosis_time` writes it ({machine()}). The
diagnoses run one after another. Each is shared by two processes of one thread, as `rigtwin diagnose` does on two cores.

The campaigns come from the generator of the blind benchmark. Each has two supports and 280 lines, with accelerometers
at seven nodes or at one. Campaigns with a nonlinear effect are measured at three force levels. The last column is a
separate time that the other columns do not contain: it is the time for building the FMU and measuring, on that FMU, the
lines that were held out to confirm the diagnosis.

{table(header, rows)}
{"".join(f"{line}" + chr(10) for line in bars)}"""


if __name__ == "__main__":
    main()
