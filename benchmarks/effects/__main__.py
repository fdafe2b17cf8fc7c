"""Write docs/solvers.md: ``python -m benchmarks.effects``; print each measured figure beside its bar.

The whole takes about twenty minutes; ``python -m benchmarks.effects.closed_forms`` and the like
print one section alone.
"""

from __future__ import annotations

import os
import sys

from benchmarks.effects import closed_forms, curves, folds, linear, periodic, ross
from benchmarks.page import DOCS, MISSED, bars_in

INTRODUCTION = """# Effects and solvers, measured

Every effect of the library goes through several solvers that share its equations and nothing else: frequency response,
harmonic balance, time stepping inside the FMU. This page measures how well they agree with each other, with an
independent code and with closed forms, and what they cost. Written by `python -m benchmarks.effects`; do not edit it by
hand. Timings depend on the machine; they are the best of several runs on one core.
"""


def main() -> int:
    """Run every section; 1 when a bar was missed."""
    parts = [INTRODUCTION]
    for module in (linear, ross, closed_forms, periodic, folds, curves):
        markdown = module.section()
        for line in bars_in(markdown):
            print(line.replace("**", ""), flush=True)
        parts.append(markdown)
    beside = DOCS / f".solvers.md.{os.getpid()}"
    beside.write_text("\n".join(part.rstrip() + "\n" for part in parts), encoding="utf-8")
    os.replace(beside, DOCS / "solvers.md")
    return int(any(MISSED in part for part in parts))


if __name__ == "__main__":
    sys.exit(main())
