"""``python -m benchmarks.real_data FOLDER [--page docs/real-data.md] [--only NAME ...]``; about half an hour."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.real_data.bolted_beam import BOLTED_BEAM
from benchmarks.real_data.cantilever import CANTILEVER
from benchmarks.real_data.data_set import DataSet, MissingDataError
from benchmarks.real_data.diagnosing import judged
from benchmarks.real_data.report import Result, page

KNOWN = {data.key: data for data in (BOLTED_BEAM, CANTILEVER)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Read, diagnose, predict, print, write the page. Returns 2 where a file is missing."""
    options = _parser().parse_args(arguments)
    try:
        chosen = [KNOWN[key] for key in options.only or KNOWN]
        folders = {data.key: data.folder_in(options.folder) for data in chosen}
        for name in _unknown(options.folder):
            print(f"{options.folder / name}: no data set of this name is known, and it is not read")
        results = [_result(data, folders[data.key]) for data in chosen]
    except MissingDataError as error:
        print(error, file=sys.stderr)
        return 2
    text = page(results)
    print(text)
    if options.page is not None:
        options.page.write_text(text, encoding="utf-8")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_data", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder that holds a folder of each data set")
    parser.add_argument("--page", type=Path, help="file to write the page into")
    parser.add_argument("--only", nargs="+", choices=KNOWN, help="data sets to use; default all")
    return parser


def _unknown(folder: Path) -> list[str]:
    """Folders that no data set belongs to."""
    return sorted(path.name for path in folder.iterdir() if path.is_dir() and path.name not in KNOWN)


def _result(data: DataSet, folder: Path) -> Result:
    """Controls first: they are done in seconds."""

    def say(words: str) -> None:
        print(f"{data.title}: {words}", flush=True)

    controls = tuple(data.controls(folder))
    for control in controls:
        say(f"{control.words}: {', '.join(f'{error:.3f}' for error in control.errors)}")
    with tempfile.TemporaryDirectory() as made:
        folds = tuple(judged(fold, say) for fold in data.folds(folder, Path(made)))
    return Result(data, folds, controls)


if __name__ == "__main__":
    sys.exit(main())
