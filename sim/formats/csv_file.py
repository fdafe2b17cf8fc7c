"""Campaign CSV: one line per frequency, every number in full precision."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import MeasurementError, Run
from rigtwin.sim.formats.csv_header import FORCE, FREQUENCY, Column, Header, Part, parse_header
from rigtwin.sim.formats.recording import Recording, misplaced
from rigtwin.sim.formats.settings import RunSettings

# What may separate columns; the first where a header has none of them.
_SEPARATORS = (",", ";", "\t")
_TOLD = re.compile(r"sep=([,;\t])", re.IGNORECASE)


def read(path: Path, given: RunSettings) -> Recording:
    """Read a campaign CSV. Raises MeasurementError that names file, line and column."""
    lines = _lines(path)
    try:
        line, cells = next(lines)
    except StopIteration:
        raise MeasurementError(f"{path}: the file is empty; it needs a header and one line per frequency") from None
    header = parse_header(f"{path}, line {line}", _renamed(path, cells, given.get("channels", {})))
    table, swept = _table(path, header, lines)

    def stack(part: Part) -> FloatArray:
        return np.column_stack([table[str(Column(channel, part))] for channel in header.channels])

    return Recording(
        frequency_hz=table[FREQUENCY],
        H=_values(header, table, 1),
        channels=header.channels,
        std=stack("std") if header.has_std else None,
        harmonics={order: _values(header, table, order) for order in header.orders},
        magnitude_only=header.magnitude_only,
        force_N=table[FORCE] if header.has_force else None,
        coherence=stack("coherence") if header.has_coherence else None,
        swept_hz=swept if len(swept) > len(table[FREQUENCY]) else None,
    )


def _renamed(path: Path, cells: list[str], channels: Mapping[str, str]) -> list[str]:
    """The header's cells, those that the campaign calls otherwise under these names."""
    there = [cell.strip() for cell in cells]
    if unknown := [name for name in channels if name not in there]:
        raise MeasurementError(f"{path}: channels: no column is called {unknown[0]!r}; the file has {', '.join(there)}")
    return [channels.get(cell, cell) for cell in there]


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number (from 1) and cells of the header and of every line below it that is not blank.

    Empty cells beyond the header's last name are left out: spreadsheets write them. Where columns are separated by
    semicolons or tabs, numbers may have decimal commas; they have points here.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            separator, above = _separator(file)
            reader, width = csv.reader(file, strict=True, delimiter=separator), 0
            try:
                for cells in reader:
                    if any(cell.strip() for cell in cells):
                        width = width or _filled(cells)
                        kept = max(_filled(cells), min(width, len(cells)))
                        line = cells[:kept] if separator == "," else [cell.replace(",", ".") for cell in cells[:kept]]
                        yield above + reader.line_num, line
            except csv.Error as error:
                place = f"{path}, line {above + reader.line_num}"
                raise MeasurementError(f"{place}: not CSV ({error}); save it again") from error
    except UnicodeDecodeError as error:
        raise MeasurementError(f"{path}: not a text file in UTF-8 ({error.reason}); save it as CSV in UTF-8") from error


def _separator(file: TextIO) -> tuple[str, int]:
    """What separates the columns, and how many lines were read of the file to know it.

    A first line ``sep=;``, as spreadsheets write it, says it; else the header has it more often than any other.
    """
    first = file.readline()
    if told := told_separator(first):
        return told, 1
    while first and not first.strip():
        first = file.readline()
    file.seek(0)
    return max(_SEPARATORS, key=first.count), 0


def told_separator(line: str) -> str | None:
    """What a first line such as ``sep=;`` says that separates columns; None of any other line."""
    told = _TOLD.fullmatch(line.strip("\r\n "))
    return told[1] if told else None


def _filled(cells: list[str]) -> int:
    """Number of cells up to the last that is not empty."""
    return max((k for k, cell in enumerate(cells, start=1) if cell.strip()), default=0)


def _table(
    path: Path, header: Header, lines: Iterator[tuple[int, list[str]]]
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Column name -> (n_freq,) values; and all frequencies, those of lines without values among them."""
    rows: list[list[float]] = []
    places: list[int] = []
    swept: list[float] = []
    column = header.names.index(FREQUENCY)
    for line, cells in lines:
        if len(cells) != len(header.names):
            raise MeasurementError(
                f"{path}, line {line}: {len(cells)} cells, but the header names {len(header.names)} columns; "
                "fill or remove the line, and write decimals with a point"
            )
        swept.append(_number(path, line, header, FREQUENCY, cells[column]))
        places.append(line)
        if any(cell.strip() for k, cell in enumerate(cells) if k != column):
            each = zip(header.names, cells, strict=True)
            rows.append([_number(path, line, header, name, cell) for name, cell in each])
    if not rows:
        raise MeasurementError(f"{path}: nothing below the header; add one line per frequency")
    _check_order(path, places, np.array(swept))
    return dict(zip(header.names, np.array(rows).T, strict=True)), np.array(swept)


def _check_order(path: Path, places: list[int], frequency_hz: FloatArray) -> None:
    """Lines go up, or down throughout; ``places`` are their line numbers in the file."""
    if (row := misplaced(frequency_hz)) is not None:
        line, here, last = places[row], float(frequency_hz[row]), float(frequency_hz[row - 1]) if row else 0.0
        if here <= 0:
            raise MeasurementError(
                f"{path}, line {line}, column {FREQUENCY}: {here!r} Hz; frequencies must be positive: remove the line"
            )
        raise MeasurementError(
            f"{path}, line {line}, column {FREQUENCY}: {here!r} Hz does not come after {last!r} Hz; "
            "frequencies must be positive and increase (or all decrease): sort the lines and remove repeats"
        )


def _number(path: Path, line: int, header: Header, name: str, cell: str) -> float:
    where = f"{path}, line {line}, column {name}"
    try:
        value = float(cell)
    except ValueError:
        value = None
    # Python reads 1_000 as a number; in a data file it is a slip.
    if value is None or "_" in cell:
        raise MeasurementError(f"{where}: {cell.strip()!r} is not a number; correct the cell or remove the line")
    if not math.isfinite(value):
        raise MeasurementError(f"{where}: {cell.strip()!r} is not a finite number; remove the line")
    if problem := _problem(name, header, value):
        raise MeasurementError(f"{where}: {value!r} {problem}")
    return value


def _problem(name: str, header: Header, value: float) -> str:
    """What is wrong with a number of a column, nothing where it is right."""
    if name == FORCE:
        return "" if value > 0 else "is no force; give the positive peak force of the line, or remove the line"
    part = header.columns[name].part if name in header.columns else ""
    if value < 0 and part in ("std", "abs"):
        return f"is negative; a {'standard error' if part == 'std' else 'magnitude'} is not"
    if part == "coherence" and not 0 < value <= 1:
        return "is no coherence; it lies above 0 and is at most 1: correct the cell or remove the line"
    return ""


def _values(header: Header, table: dict[str, FloatArray], order: int) -> ComplexArray:
    """(n_freq, n_channels) response at one harmonic order."""
    values = np.zeros((len(table[FREQUENCY]), len(header.channels)), dtype=complex)
    for k, channel in enumerate(header.channels):
        own = {c.part: table[str(c)] for c in header.columns.values() if (c.channel, c.order) == (channel, order)}
        values[:, k].real, values[:, k].imag = (own["re"], own["im"]) if "re" in own else _from_polar(own)
    return values


def _from_polar(parts: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """(n_freq,) real and imaginary part from a magnitude, in its unit or in dB over it, and a phase if there is one."""
    magnitude = parts["abs"] if "abs" in parts else np.power(10.0, parts["dB"] / 20)
    phase = np.radians(parts["deg"]) if "deg" in parts else np.zeros(len(magnitude))
    return magnitude * np.cos(phase), magnitude * np.sin(phase)


def write(run: Run, path: Path) -> None:
    """Write a campaign CSV; ``repr`` keeps every bit of a double."""
    force = {} if run.force_N is None else {FORCE: run.force_N}
    columns = {**force, **{str(column): values for column, values in _columns(run)}}
    rows = dict(zip(run.frequency_hz.tolist(), np.column_stack(list(columns.values())).tolist(), strict=True))
    swept = run.frequency_hz if run.swept_hz is None else run.swept_hz
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([FREQUENCY, *columns])
        for frequency in swept.tolist():
            values = [repr(number) for number in rows[frequency]] if frequency in rows else [""] * len(columns)
            writer.writerow([repr(frequency), *values])


def _columns(run: Run) -> Iterator[tuple[Column, FloatArray]]:
    """Every column beside the frequency with its (n_freq,) values, channel by channel."""
    for i, channel in enumerate(run.channels):
        for order, values in [(1, run.H), *sorted(run.harmonics.items())]:
            if run.magnitude_only:
                yield Column(channel, "abs", order), values[:, i].real
            else:
                yield Column(channel, "re", order), values[:, i].real
                yield Column(channel, "im", order), values[:, i].imag
        if run.std is not None:
            yield Column(channel, "std"), run.std[:, i]
