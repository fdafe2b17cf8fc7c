"""``rigtwin report``: one page of measured runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigtwin.api.reports import report
from rigtwin.console import say


def run_report(
    paths: Sequence[Path],
    *,
    rigid: Sequence[Path],
    bearing: Sequence[Path],
    out: Path,
    rig: str | None,
    estimator: Path | None,
    trust: bool,
) -> None:
    """Write the page and print its result."""
    written = report(*paths, out=out, rig=rig, rigid=rigid, bearing=bearing, estimator=estimator, trust=trust)
    say(f"{out} written: {written.result}")
