"""Campaign CSV: one line per frequency, every number in full precision."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import MeasurementError, Run
from rigtwin.sim.formats.csv_header import FREQUENCY, Column, Header, parse_header
from rigtwin.sim.formats.recording import Recording, misplaced
from rigtwin.sim.formats.settings import RunSettings


def read(path: Path, given: RunSettings) -> Recording:
    """Read a campaign CSV. Raises MeasurementError that names file, line and column."""
    lines = _lines(path)
    try:
        line, cells = next(lines)
    except StopIteration:
        raise MeasurementError(f"{path}: the file is empty; it needs a header and one line per frequency") from None
    header = parse_header(f"{path}, line {line}", cells)
    table = _table(path, header, lines)
    return Recording(
        frequency_hz=table[FREQUENCY],
        H=_values(header, table, 1),
        channels=header.channels,
        std=_stack(table, [Column(channel, "std") for channel in header.channels]) if header.has_std else None,
        harmonics={order: _values(header, table, order) for order in header.orders},
        magnitude_only=header.magnitude_only,
    )


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number (from 1) and cells of the header and of every line below it that is not blank."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            try:
                for cells in reader:
                    if any(cell.strip() for cell in cells):
                        yield reader.line_num, cells
            except csv.Error as error:
                raise MeasurementError(f"{path}, line {reader.line_num}: not CSV ({error}); save it again") from error
    except UnicodeDecodeError as error:
        raise MeasurementError(f"{path}: not a text file in UTF-8 ({error.reason}); save it as CSV in UTF-8") from error


def _table(path: Path, header: Header, lines: Iterator[tuple[int, list[str]]]) -> dict[str, FloatArray]:
    """Column name -> (n_freq,) values."""
    rows: list[list[float]] = []
    places: list[int] = []
    for line, cells in lines:
        if len(cells) != len(header.names):
            raise MeasurementError(
                f"{path}, line {line}: {len(cells)} cells, but the header names {len(header.names)} columns; "
                "fill or remove the line, and write decimals with a point"
            )
        rows.append([_number(path, line, header, name, cell) for name, cell in zip(header.names, cells, strict=True)])
        places.append(line)
    if not rows:
        raise MeasurementError(f"{path}: nothing below the header; add one line per frequency")
    table = dict(zip(header.names, np.array(rows).T, strict=True))
    _check_order(path, places, table[FREQUENCY])
    return table


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
    if value < 0 and name != FREQUENCY and header.columns[name].part in ("std", "abs"):
        what = "standard error" if header.columns[name].part == "std" else "magnitude"
        raise MeasurementError(f"{where}: {value!r} is negative; a {what} is not")
    return value


def _stack(table: dict[str, FloatArray], columns: list[Column]) -> FloatArray:
    """(n_freq, n_channels) values of these columns."""
    return np.column_stack([table[str(column)] for column in columns])


def _values(header: Header, table: dict[str, FloatArray], order: int) -> ComplexArray:
    """(n_freq, n_channels) response at one harmonic order."""
    values = np.zeros((len(table[FREQUENCY]), len(header.channels)), dtype=complex)
    values.real = _stack(table, [Column(c, "abs" if header.magnitude_only else "re", order) for c in header.channels])
    if not header.magnitude_only:
        values.imag = _stack(table, [Column(c, "im", order) for c in header.channels])
    return values


def write(run: Run, path: Path) -> None:
    """Write a campaign CSV; ``repr`` keeps every bit of a double."""
    columns = {FREQUENCY: run.frequency_hz, **{str(column): values for column, values in _columns(run)}}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in np.column_stack(list(columns.values())).tolist():
            writer.writerow([repr(number) for number in row])


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
