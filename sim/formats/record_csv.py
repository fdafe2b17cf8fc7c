"""Records as oscilloscopes and loggers write them in text: a preamble of any length, a table, one line per sample."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import MeasurementError
from rigtwin.sim.formats.csv_file import told_separator
from rigtwin.sim.formats.record import Record, record_of
from rigtwin.sim.formats.units import kind_of

# Names of the column that holds the time, and units of it, in small letters and without brackets.
_TIMES = (
    "t",
    "time",
    "times",
    "time axis",
    "x",
    "x-axis",
    "x axis",
    "zeit",
    "temps",
    "tiempo",
    "tempo",
    "second",
    "in s",
)
_SECONDS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_IN_NAME = re.compile(r"(.+?)\s*[\[(]\s*([^\[\]()]+(?:\([^()]*\)[^\[\]()]*)?)\s*[\])]|(.+?)\s+in\s+(\S+)")
_STEP = ("increment", "sample interval", "sampling interval", "t interval", "horizontal interval", "delta t", "dt")


@dataclass(frozen=True)
class _Table:
    """The table of samples, and what stands above it."""

    first: int  # number of its first line in the file, from 1
    rows: list[str]
    columns: list[int]  # of the numbers, from 0
    above: list[list[str]]  # cells of the lines that are not blank, from the top
    separator: str | None


def read(path: Path, sample_rate_hz: float | None) -> Record:
    """Read a record from text. Raises MeasurementError that names the file and the line."""
    lines, begin, separator = _lines(path)
    table = _table(path, lines, begin, separator)
    numbers = _numbers(path, table)
    names, units = _labels(table)
    increment = _increment(table)
    at = _time_column(table, names, units, numbers)
    time_s = None
    if at is not None:
        time_s = numbers[:, at] * (
            increment if increment and _counts(numbers[:, at]) else _seconds(names[at], units[at])
        )
    elif increment and sample_rate_hz is None:
        sample_rate_hz = 1 / increment
    kept = [k for k in range(len(names)) if k != at]
    channels = {names[k]: numbers[:, k] for k in kept}
    if len(channels) < len(kept):
        raise MeasurementError(f"{path}: two columns have the same name; the names are {', '.join(names)}: change one")
    return record_of(path, channels, [units[k] for k in kept], time_s=time_s, sample_rate_hz=sample_rate_hz)


def _lines(path: Path) -> tuple[list[str], int, str | None]:
    """All lines, how many of them come before the contents, and what separates cells."""
    content = path.read_bytes()
    text = _text(content).replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise MeasurementError(f"{path}: the file is empty; record it again, or move it out of the folder")
    if told := told_separator(lines[0]):
        return lines, 1, told
    # Numbers hold no tabs and no semicolons, whatever the country; a comma may be their decimal point.
    return lines, 0, next((sign for sign in ("\t", ";", ",") if sign in lines[-1]), None)


def _text(content: bytes) -> str:
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:  # the µ of an older instrument
        return content.decode("latin-1")


def _table(path: Path, lines: list[str], begin: int, separator: str | None) -> _Table:
    """The lines at the end of the file that hold numbers in the same columns as the last one."""
    last = _cells(lines[-1], separator)
    columns = [k for k, cell in enumerate(last) if _is_number(cell)]
    if not columns:
        raise MeasurementError(
            f"{path}, line {len(lines)}: holds no number; a record ends with a table of samples: is this one?"
        )

    def belongs(line: str) -> bool:
        cells = _cells(line, separator)
        return any(k < len(cells) and _is_number(cells[k]) for k in columns)

    start = len(lines)
    while start > begin and (not lines[start - 1].strip() or belongs(lines[start - 1])):
        start -= 1
    start += next(k for k, line in enumerate(lines[start:]) if line.strip())
    columns = _columns_of_most(lines[start:], columns, separator)
    above = [_cells(line, separator) for line in lines[begin:start] if line.strip()]
    return _Table(start + 1, lines[start:], columns, above, separator)


def _columns_of_most(rows: list[str], columns: list[int], separator: str | None) -> list[int]:
    """Columns that hold a number in every tenth of the table or more; a last line may have been cut."""
    seen = [_cells(row, separator) for row in rows[:: max(1, len(rows) // 200)]]
    width = max(len(cells) for cells in seen)
    counts = [sum(k < len(cells) and _is_number(cells[k]) for cells in seen) for k in range(width)]
    return [k for k, count in enumerate(counts) if count > len(seen) / 2 or k in columns]


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [cell.strip().strip('"').strip() for cell in line.split(separator)]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell


def _numbers(path: Path, table: _Table) -> FloatArray:
    """(n, n_columns) of the table; decimal commas are read as points."""
    rows = [row for row in table.rows if row.strip()]
    if table.separator != ",":
        rows = [row.replace(",", ".") for row in rows]
    try:
        return np.loadtxt(rows, delimiter=table.separator, usecols=table.columns, ndmin=2, quotechar='"', comments=None)
    except (ValueError, IndexError):
        raise _first_problem(path, table) from None


def _first_problem(path: Path, table: _Table) -> MeasurementError:
    """What is wrong with the first line that has no number in every column."""
    counts = dict.fromkeys(table.columns, 0)
    problem = None
    for number, row in enumerate(table.rows, start=table.first):
        cells = _cells(row, table.separator)
        for k in table.columns if row.strip() else ():
            cell = cells[k] if k < len(cells) else ""
            counts[k] += bool(cell)
            if problem is None and not _is_number(cell):
                problem = f"line {number}, column {k + 1}: " + (f"{cell!r} is not a number" if cell else "is empty")
    if len(set(counts.values())) > 1:
        told = ", ".join(f"column {k + 1} {count}" for k, count in counts.items())
        return MeasurementError(
            f"{path}, {problem or 'a line'}; channels of different lengths ({told} samples); save "
            "them again, all as long"
        )
    return MeasurementError(f"{path}, {problem or 'a line cannot be read'}; correct it, or record it again")


def _labels(table: _Table) -> tuple[list[str], list[str]]:
    """Name and unit of each column, from the lines above; a column without a name has its number in the file."""
    above = table.above
    units = [""] * len(table.columns)
    row = _labelled(above, table.columns)
    if row is not None and len(above) > row and _are_units(above[row], table.columns):
        units = [_bare(_cell(above[row], k)) for k in table.columns]
        row = _names_above(above, row, table.columns)
    names = [_cell(above[row], k) if row is not None else "" for k in table.columns]
    split = [_IN_NAME.fullmatch(name) for name in names]
    for k, match in enumerate(split):
        if match and (kind_of(match[2] or match[4]) or (match[2] or match[4]).lower() in _SECONDS):
            names[k], units[k] = (match[1] or match[3]).strip(), units[k] or (match[2] or match[4])
    return [name or str(column + 1) for name, column in zip(names, table.columns, strict=True)], units


def _names_above(above: list[list[str]], units: int, columns: list[int]) -> int | None:
    """Place of the names that stand above a line of units; channels may be called by numbers there."""
    cells = [_cell(above[units - 1], k) for k in columns] if units else []
    numbered = all(cells) and not _is_number(cells[0])
    return units - 1 if cells and numbered else _labelled(above[:units], columns)


def _labelled(above: list[list[str]], columns: list[int]) -> int | None:
    """Place of the last line above that has a word over every column, or over all but the first."""
    for place in range(len(above) - 1, max(-1, len(above) - 4), -1):
        words = [bool(_cell(above[place], k)) and not _is_number(_cell(above[place], k)) for k in columns]
        if all(words[-1:]) and sum(words) >= max(1, len(words) - 1):
            return place
    return None


def _cell(cells: Sequence[str], k: int) -> str:
    return cells[k] if k < len(cells) else ""


def _are_units(cells: Sequence[str], columns: list[int]) -> bool:
    """Whether a line holds a unit over each column, and no name."""
    words = [_bare(_cell(cells, k)) for k in columns]
    return all(kind_of(word) or word.lower() in (*_SECONDS, "sequence") for word in words[1:] or words)


def _bare(word: str) -> str:
    return word.strip().strip("[]()").strip()


def _time_column(table: _Table, names: list[str], units: list[str], numbers: FloatArray) -> int | None:
    """Place of the time among the columns: by name or unit; of a table without names the first, if it increases."""
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        if name.lower() in _TIMES or unit.lower() in (*_SECONDS, "sequence"):
            return k
    named = any(name != str(column + 1) for name, column in zip(names, table.columns, strict=True))
    increases = len(numbers) > 1 and len(names) > 1 and bool(np.all(np.diff(numbers[:, 0]) > 0))
    return 0 if increases and not named else None


def _counts(values: FloatArray) -> bool:
    """Whether a column counts the samples."""
    return bool(np.all(np.diff(values) == 1))


def _seconds(name: str, unit: str) -> float:
    """Seconds of one unit of the time column; of one that says none, a second."""
    return _SECONDS.get(unit.lower().replace("µ", "u").replace("μ", "u"), _SECONDS.get(name.lower(), 1.0))


def _increment(table: _Table) -> float | None:
    """Seconds between samples that stand above the table, under their name or beside it."""
    for place, cells in enumerate(table.above):
        for k, cell in enumerate(cells):
            if cell.lower().strip(" :") in _STEP:
                beside = [_cell(cells, k + 1)]
                below = [_cell(row, k) for row in table.above[place + 1 : place + 3]]
                found = [float(each.replace(",", ".")) for each in (*beside, *below) if _is_number(each)]
                if found and found[0] > 0:
                    return found[0]
    return None
