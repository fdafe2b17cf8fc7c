"""Write docs/reproduction.md and its figures; print each measured figure beside its bar."""

from __future__ import annotations

import sys

from benchmarks.page import DOCS, MISSED, bars_in
from benchmarks.reproduction.sections import SECTIONS

INTRODUCTION = """# The paper's numbers, reproduced

Palariya, Rajasekhar and Srinivas [palariya] model a rotor with two disks on ball bearings by six Timoshenko elements.
This page compares the numbers that they print with ours, says what differs and why, and checks our model against an
independent code. It is written by `python -m benchmarks.reproduction`; do not edit it by hand. The numbers of the paper
are in `benchmarks/paper_tables.toml`, the sources in `references.bib`.
"""


def main() -> int:
    """Run every section; 1 when a bar was missed."""
    parts = [INTRODUCTION]
    for section in SECTIONS:
        markdown = section()
        for line in bars_in(markdown):
            print(line.replace("**", ""), flush=True)
        parts.append(markdown)
    (DOCS / "reproduction.md").write_text("\n".join(part.rstrip() + "\n" for part in parts), encoding="utf-8")
    return int(any(MISSED in part for part in parts))


if __name__ == "__main__":
    sys.exit(main())
