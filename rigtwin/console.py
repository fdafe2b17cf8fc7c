"""What commands print: tables and text on stdout, progress bars on stderr, JSON for machines."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what rich loads is loaded when something is printed: --help has no need of it
    from rich.console import Console

_SECONDS_BETWEEN_STAGES = 10.0

# Where the output is not a terminal, its width is nobody's business; tables then get this.
_WIDTH = 160


def output() -> Console:
    """The console on stdout."""
    from rich.console import Console

    return Console(highlight=False, markup=False, emoji=False, width=None if sys.stdout.isatty() else _WIDTH)


def say(text: str = "") -> None:
    """Print text as it is, whatever its length."""
    output().print(text, soft_wrap=True)


def note(text: str) -> None:
    """A remark beside the result, on stderr."""
    print(f"rigtwin: {text}", file=sys.stderr)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None) -> None:
    """Print a table; the first column is left-aligned, the others right-aligned."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    grid = Table(box=SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)
    for place, name in enumerate(header):
        grid.add_column(name, justify="right" if place else "left")
    for row in rows:
        grid.add_row(*row)
    output().print(grid)


def print_json(value: Any) -> None:
    """Print one JSON document."""
    print(to_json(value))


def to_json(value: Any) -> str:
    """JSON text; what is not a finite number becomes null."""
    return json.dumps(_finite(value), indent=2, ensure_ascii=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    return [_finite(item) for item in value] if isinstance(value, list | tuple) else value


def stages() -> Callable[[str, int, int], None]:
    """Say on stderr what goes on and how far it is, at most every ten seconds: a log shows that it is not stuck."""
    said = time.monotonic()

    def tell(words: str, done: int, total: int) -> None:
        nonlocal said
        if time.monotonic() - said > _SECONDS_BETWEEN_STAGES:
            said = time.monotonic()
            note(f"{words}, {done} of {total}")

    return tell


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar while the block runs; yields what to call with the count so far.

    Where stderr is not a terminal, a line now and then says how far it is. A count may pass ``total``, which then
    grows.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        say_stage = stages()
        yield lambda count: say_stage(what, count, max(total, count))
        return
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda count: bar.update(task, completed=count, total=max(total, count))
