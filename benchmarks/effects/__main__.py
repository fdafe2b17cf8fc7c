"""Write docs/solvers.md: ``python -m benchmarks.effects``; print each measured figure beside its bar.

The whole takes about half an hour on a quiet machine. ``python -m benchmarks.effects ross curves``
measures these sections anew and keeps the others as the page has them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from benchmarks.effects import closed_forms, curves, folds, linear, periodic, ross
from benchmarks.page import DOCS, MISSED, bars_in

INTRODUCTION = """# Effects and solvers, measured

Every effect of the library can be computed by several solvers: frequency response, harmonic balance, and time stepping
inside the FMU. These solvers share the matrices of the rotor and the expressions of the force laws, and nothing else.
This page measures how well they agree with each other, with an independent code and with closed-form solutions, and how
long they take.

The page is written by `python -m benchmarks.effects`; do not edit it by hand. The times depend on the machine. Each is
the best of several runs on one core.
"""

SECTIONS: dict[str, Callable[[], str]] = {
    "linear": linear.section,
    "ross": ross.section,
    "closed_forms": closed_forms.section,
    "periodic": periodic.section,
    "folds": folds.section,
    "curves": curves.section,
}
PAGE = DOCS / "solvers.md"


def main(names: list[str]) -> int:
    """Measure sections, all by default; 1 when a bar is missed."""
    unknown = [name for name in names if name not in SECTIONS]
    if unknown:
        print(f"there is no section {', '.join(unknown)}; there are {', '.join(SECTIONS)}", file=sys.stderr)
        return 2
    parts = _parts_of_the_page() if names else {}
    for name in names or SECTIONS:
        parts[name] = SECTIONS[name]()
        for line in bars_in(parts[name]):
            print(line.replace("**", ""), flush=True)
        _write(parts)
    return int(any(MISSED in part for part in parts.values()))


def _mark(name: str) -> str:
    return f"<!-- section {name} -->"


def _parts_of_the_page() -> dict[str, str]:
    """The sections as they stand; a mark precedes each."""
    parts, name = {}, None
    if not PAGE.exists():
        return parts
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        name = next((n for n in SECTIONS if line == _mark(n)), name)
        if name and line != _mark(name):
            parts[name] = parts.get(name, "") + line + "\n"
    return parts


def _write(parts: dict[str, str]) -> None:
    """Beside the page, then renamed; after each section, so that nothing measured is lost."""
    texts = [INTRODUCTION, *(f"{_mark(name)}\n{parts[name].strip()}\n" for name in SECTIONS if name in parts)]
    beside = PAGE.with_name(f".{PAGE.name}.{os.getpid()}")
    beside.write_text("\n".join(texts), encoding="utf-8")
    os.replace(beside, PAGE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
