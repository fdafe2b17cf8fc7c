"""The datasets of a universal file that a run needs, 58 (functions) and 164 (units), as software really writes them.

The limits of a dataset come from its own counts, because the bytes of a binary one may look like a closing line.
Numbers may have the exponents of Fortran (``1.0D+00``, ``1.0-101``), in columns or with blanks between them.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray

# Ordinate data types of dataset 58, real or complex in single or double precision.
_DOUBLE, _COMPLEX = (4, 6), (5, 6)
_TYPES = (2, 4, 5, 6)

# Width of a number of a text file: of the abscissa and of single precision, and of double precision.
_NARROW, _WIDE = 13, 20

_HEADER_LINES = 11
_SHORT_EXPONENT = re.compile(r"([0-9.])([+-][0-9]{3})")


class DatasetError(ValueError):
    """A dataset that cannot be read; says where and why."""


@dataclass(frozen=True)
class End:
    """Where a function's response, or its reference, is."""

    name: str  # of the entity, as the software calls it
    node: int
    direction: int  # 1, 2, 3: +X, +Y, +Z; negative: against the axis; 0: not said


@dataclass(frozen=True)
class Axis:
    """What an axis holds."""

    data_type: int  # specific data type: 8 displacement, 11 velocity, 12 acceleration, 13 force, 18 frequency
    unit: str  # its label


@dataclass(frozen=True)
class Function:
    """A dataset 58."""

    ids: tuple[str, ...]  # the five ID lines
    function_type: int  # 4: frequency response
    response: End
    reference: End
    abscissa: Axis
    numerator: Axis
    denominator: Axis
    n_values: int  # that it says to hold
    x: FloatArray  # (n,)
    values: ComplexArray | FloatArray  # (n,)


@dataclass(frozen=True)
class Units:
    """A dataset 164: what the numbers of the functions below it are multiplied by to have SI."""

    code: int
    length: float
    force: float


def read_datasets(content: bytes) -> Iterator[Function | Units]:
    """The datasets 58 and 164 in the file's order; all others are passed over.

    Raises DatasetError that names the line or the byte.
    """
    file = _Lines(content)
    while file.skip_to_dataset():
        kind = file.line().split()
        number = kind[0].lower() if kind else ""
        if number in ("58", "58b"):
            yield _function(file, binary=number == "58b", order=kind[1] if len(kind) > 1 else "")
        elif number == "164":
            yield _units(file)


class _Lines:
    """A file's lines one after the other, and bytes in between."""

    def __init__(self, content: bytes):
        self.content, self.at, self.number = content, 0, 0

    def __bool__(self) -> bool:
        return self.at < len(self.content)

    def line(self) -> str:
        """The next line without its end. Raises DatasetError at the end of the file."""
        if not self:
            raise DatasetError("the file ends inside a dataset")
        end = self.content.find(b"\n", self.at)
        end = len(self.content) if end < 0 else end
        text = self.content[self.at : end].decode("latin-1").rstrip("\r")
        self.at, self.number = end + 1, self.number + 1
        return text

    def closes(self) -> bool:
        """Whether the line here is the one between datasets; stays before it."""
        return self.content[self.at : self.at + 16].split(b"\n")[0].strip() == b"-1"

    def skip_to_dataset(self) -> bool:
        """Go behind the next opening line; False where there is none."""
        while self:
            if self.line().strip() == "-1" and self and not self.closes():
                return True
        return False

    def body(self) -> list[tuple[int, str]]:
        """Numbers and texts of the lines up to the closing one, which is left."""
        lines = []
        while self and not self.closes():
            lines.append((self.number + 1, self.line()))
        return lines


def _function(file: _Lines, *, binary: bool, order: str) -> Function:
    """A dataset 58; ``order`` is that of its bytes, "2" with the highest first."""
    records = [(file.number + 1, file.line()) for _ in range(_HEADER_LINES)]
    (n6, sixth), (n7, seventh) = records[5:7]
    kinds = _fields(sixth, (5, 10, 5, 10, 11, 10, 4, 11, 10, 4))
    form = _fields(seventh, (10, 10, 10, 13, 13, 13))
    data_type, n_values, even = _whole(n7, form[0]), _whole(n7, form[1]), _whole(n7, form[2]) == 1
    if data_type not in _TYPES or n_values < 0:
        raise DatasetError(f"line {n7}: {n_values} values of data type {data_type}; a function's are 2, 4, 5 or 6")
    axes = [_axis(*record) for record in records[7:10]]
    columns = (2 if data_type in _COMPLEX else 1) + (not even)
    size = columns * n_values
    flat = _binary(file, size, data_type in _DOUBLE, order) if binary else _text(file, size, data_type, even)
    table = flat[: len(flat) // columns * columns].reshape(-1, columns)
    x = _number(n7, form[3]) + _number(n7, form[4]) * np.arange(len(table)) if even else table[:, 0]
    ordinate = table if even else table[:, 1:]
    return Function(
        ids=tuple(text[:80].strip() for _, text in records[:5]),
        function_type=_whole(n6, kinds[0]),
        response=End(kinds[4], _whole(n6, kinds[5]), _whole(n6, kinds[6])),
        reference=End(kinds[7], _whole(n6, kinds[8]), _whole(n6, kinds[9])),
        abscissa=axes[0],
        numerator=axes[1],
        denominator=axes[2],
        n_values=n_values,
        x=np.array(x),
        values=ordinate[:, 0] + 1j * ordinate[:, 1] if data_type in _COMPLEX else ordinate[:, 0].copy(),
    )


def _binary(file: _Lines, size: int, double: bool, order: str) -> FloatArray:
    """(size,) numbers behind the header lines; fewer where the file ends.

    The count of bytes in the first record is wrong in many files, that of values is not.
    """
    width = 8 if double else 4
    there = file.content[file.at : file.at + size * width]
    file.at += len(there)
    kind = f"{'>' if order == '2' else '<'}f{width}"
    return np.frombuffer(there[: len(there) // width * width], kind).astype(float)


def _text(file: _Lines, size: int, data_type: int, even: bool) -> FloatArray:
    """(size,) numbers of the lines up to the closing one."""
    double = data_type in _DOUBLE
    wide = [_WIDE] * (2 if data_type in _COMPLEX else 1) if double else [_NARROW]
    widths = ([] if even or not double else [_NARROW]) + wide
    numbers: list[float] = []
    for number, line in file.body():
        numbers += _numbers(number, line, widths)
    return np.array(numbers[:size])


def _numbers(number: int, line: str, widths: list[int]) -> list[float]:
    """The numbers of a line: between blanks or, where these are missing, in columns of these widths, over and over."""
    try:
        return [_number(number, cell) for cell in line.split()]
    except DatasetError:
        cells, at, k = [], 0, 0
        while line[at:].strip():
            cells.append(line[at : at + widths[k % len(widths)]])
            at, k = at + widths[k % len(widths)], k + 1
        return [_number(number, cell) for cell in cells]


def _units(file: _Lines) -> Units:
    number, first = file.number + 1, file.line()
    code = _whole(number, _fields(first, (10,))[0])
    factors = [value for line, text in file.body() for value in _numbers(line, text, [25])]
    if len(factors) < 2:
        raise DatasetError(f"line {number}: units without the factors of length and force")
    return Units(code, factors[0], factors[1])


def _axis(number: int, line: str) -> Axis:
    cells = _fields(line, (10, 5, 5, 5, 21, 21))
    return Axis(_whole(number, cells[0]), cells[5])


def _fields(line: str, widths: tuple[int, ...]) -> list[str]:
    """The cells of a record in columns of these widths."""
    ends = np.cumsum([0, *widths]).tolist()
    return [line[a:b].strip() for a, b in itertools.pairwise(ends)]


def _whole(number: int, cell: str) -> int:
    try:
        return int(cell or "0")
    except ValueError:
        raise DatasetError(f"line {number}: {cell!r} is not a whole number") from None


def _number(number: int, cell: str) -> float:
    text = _SHORT_EXPONENT.sub(r"\1e\2", cell.strip()) if "e" not in cell.lower() else cell.strip()
    try:
        return float(text.upper().replace("D", "E") or "0")
    except ValueError:
        why = " (the number did not fit its column)" if set(cell.strip()) == {"*"} else ""
        raise DatasetError(f"line {number}: {cell.strip()!r} is not a number{why}") from None
