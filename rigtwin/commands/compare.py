"""``rigtwin compare``: two campaigns beside each other."""

from __future__ import annotations

from pathlib import Path

from rigtwin.api.comparisons import COMPARISON_HEADER, RUN_HEADER, compare
from rigtwin.console import note, print_json, say, table
from rigtwin.scratch import check_writable


def run_compare(a: Path, b: Path, out: Path | None, *, as_json: bool) -> None:
    """Compare, print what has changed, write the page where one is asked for."""
    if out:
        check_writable(out)
    found = compare(a, b)
    if out:
        found.save(out)
    for remark in found.remarks:
        note(remark)
    if as_json:
        print_json(found.record())
        return
    say(found.sentence)
    if found.modes:
        table(COMPARISON_HEADER, found.rows())
    if found.runs:
        table(RUN_HEADER, found.run_rows())
    if out:
        say(f"{out} written")
