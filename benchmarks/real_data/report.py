"""docs/real-data.md: what was measured, what the diagnosis says, and what simpler models predict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np

from benchmarks.page import machine, table
from benchmarks.real_data.data_set import Control, DataSet
from benchmarks.real_data.diagnosing import Judged

WIDTH = 120  # characters of a line of text on the page


@dataclass(frozen=True)
class Result:
    """Everything about one data set."""

    data: DataSet
    folds: tuple[Judged, ...]
    controls: tuple[Control, ...]


def page(results: Sequence[Result]) -> str:
    """The page in markdown."""
    sections = "\n".join(_section(result) for result in results)
    return f"""# Data of other laboratories

This page says how well the diagnosis works on rigs that others have built and measured.
`python -m benchmarks.real_data FOLDER --page docs/real-data.md` writes it ({machine()}),
with the folder that holds the data; `make benchmark-real-data DATA=FOLDER` does the same. The data are not part of
rigtwin. They come from the repositories that are named, under the licences that are named.

A campaign is diagnosed without the runs that are held out, and these are then predicted. All figures of predictions are
√(Σ|H − Ĥ|²/Σ|H|²), averaged over the held-out runs. *Before* is the recalibrated nominal model. *After* is the model
with the named cause; it equals *before* if none is named. The *floor* is what neighbouring lines leave unexplained of
each other: no model can be expected to do better, and where a resonance is as narrow as the lines are apart, the floor
is too high. The controls are models without a diagnosis.

{sections}"""


def _section(result: Result) -> str:
    data = result.data
    return f"""## {data.title}

{fill(data.measured, WIDTH)}

Source: {data.source} ({data.licence}).

{_folds(result.folds)}
{_controls(result.controls)}
{fill(f"**What these data cannot say.** {data.silent}", WIDTH)}
"""


def _folds(folds: Sequence[Judged]) -> str:
    header = ("left out", "verdict", "first causes", "before", "after", "floor", "processor time [s]")
    rows = [
        (
            f.fold,
            f.verdict.replace("_", " "),
            "; ".join(f.causes) or "–",
            *map(_figure, (f.before, f.after, f.floor)),
            f"{f.seconds:.0f}",
        )
        for f in folds
    ]
    words = [f"- {f.fold}: {f.failure or f.sentence}\n" for f in folds]
    return f"{table(header, rows)}\n{''.join(words)}"


def _controls(controls: Sequence[Control]) -> str:
    header = ("control", "mean", "each")
    rows = [(c.words, _figure(float(np.mean(c.errors))), ", ".join(map(_figure, c.errors))) for c in controls]
    return table(header, rows)


def _figure(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"
