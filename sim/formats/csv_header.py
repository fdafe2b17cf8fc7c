"""The grammar of the campaign CSV's column names: ``node2_z_h3_re`` and the like."""

from __future__ import annotations

import logging
import re
from collections import Counter
from dataclasses import dataclass
from typing import Literal

from rigtwin.sim.campaign import Channel, MeasurementError

logger = logging.getLogger(__name__)

FREQUENCY = "frequency_Hz"

Part = Literal["re", "im", "abs", "std"]

_COLUMN = re.compile(r"node([1-9][0-9]{0,8})(_z)?(?:_h([2-9]|[1-9][0-9]{1,8}))?_(re|im|abs|std)")

_KNOWN = (
    f"known are {FREQUENCY}, node2_re with node2_im (or node2_abs), node2_std, node2_z_re … for the other plane "
    "and node2_h3_re … for the third harmonic, with any node from 1"
)


@dataclass(frozen=True)
class Column:
    """One column beside the frequency: a part of one channel's response at one harmonic order."""

    channel: Channel
    part: Part
    order: int = 1  # 1: the excitation's own frequency

    def __str__(self) -> str:
        return f"{self.channel}_{self.part}" if self.order == 1 else f"{self.channel}_h{self.order}_{self.part}"


@dataclass(frozen=True)
class Header:
    """The first line of a campaign CSV, checked."""

    names: tuple[str, ...]  # every column, in the file's order
    columns: dict[str, Column]  # the same without the frequency
    channels: tuple[Channel, ...]  # in order of appearance
    orders: tuple[int, ...]  # harmonic orders of all channels, from 2
    magnitude_only: bool
    has_std: bool  # of all channels


def parse_header(place: str, cells: list[str]) -> Header:
    """Parse the header line; ``place`` names file and line. Raises MeasurementError that names them and the column.

    >>> parse_header("run.csv, line 1", ["frequency_Hz", "node2_re", "node2_im"]).channels
    (Channel(node=2, plane='y'),)
    """
    names = tuple(cell.strip() for cell in cells)
    _refuse_no_header(place, names)
    for name, count in Counter(names).items():
        if count > 1:
            raise MeasurementError(f"{place}, column {name}: is there {count} times; keep one")
    columns = {name: _column(place, n, name) for n, name in enumerate(names, start=1) if name != FREQUENCY}
    if FREQUENCY not in names:
        raise MeasurementError(f"{place}: column {FREQUENCY} is missing; it holds the lines' frequencies in Hz")
    present = set(columns.values())
    channels = tuple(dict.fromkeys(c.channel for c in columns.values()))
    if not channels:
        raise MeasurementError(f"{place}: no response column; {_KNOWN}")
    for column in columns.values():
        _check_partner(place, column, present)
    return _complete(place, names, columns, channels)


def _refuse_no_header(place: str, names: tuple[str, ...]) -> None:
    if any(";" in name or "\t" in name for name in names):
        raise MeasurementError(
            f"{place}: columns must be separated by commas (and decimals written with a point); save it again so"
        )
    if not any(names) or _is_number(names[0]):
        raise MeasurementError(f"{place}: the header is missing; the first line names the columns: {_KNOWN}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _column(place: str, number: int, name: str) -> Column:
    match = _COLUMN.fullmatch(name)
    if match is None or (match[3] and match[4] == "std"):
        raise MeasurementError(f"{place}, column {number} {name!r}: unknown column; {_KNOWN}")
    return Column(Channel(int(match[1]), "z" if match[2] else "y"), match[4], int(match[3] or 1))  # type: ignore[arg-type]


def _check_partner(place: str, column: Column, present: set[Column]) -> None:
    """``re`` needs ``im`` and the reverse; ``abs`` excludes both; the rest needs the channel's response."""

    def there(part: Part, order: int = column.order) -> bool:
        return Column(column.channel, part, order) in present

    where = f"{place}, column {column}"
    partner: dict[Part, Part] = {"re": "im", "im": "re"}
    if column.part == "abs" and (there("re") or there("im")):
        raise MeasurementError(f"{where}: this node has real and imaginary part too; keep those or _abs, not both")
    if column.part in partner and not there(partner[column.part]):
        missing = Column(column.channel, partner[column.part], column.order)
        raise MeasurementError(f"{where}: column {missing} is missing; a complex value needs both")
    if not (there("re", 1) or there("abs", 1)):
        raise MeasurementError(f"{where}: {column.channel} has no response; add {column.channel}_re and _im, or _abs")


def _complete(place: str, names: tuple[str, ...], columns: dict[str, Column], channels: tuple[Channel, ...]) -> Header:
    """All channels must give magnitudes or complex values; errors and harmonics that not all give are passed over."""
    present = set(columns.values())
    magnitude_only = any(c.part == "abs" for c in present)
    if magnitude_only and any(c.part == "re" for c in present):
        mixed = next(c for c in columns.values() if c.part == "abs")
        raise MeasurementError(
            f"{place}, column {mixed}: other columns are complex (_re, _im); put the nodes that have "
            "magnitudes only in a run file of their own"
        )
    value: Part = "abs" if magnitude_only else "re"

    def of_all(part: Part, order: int = 1) -> bool:
        missing = [channel for channel in channels if Column(channel, part, order) not in present]
        if missing and len(missing) < len(channels):
            what = "standard errors are" if part == "std" else f"harmonics of order {order} are"
            logger.warning("%s: %s missing for %s, and left out for all", place, what, ", ".join(map(str, missing)))
        return not missing

    has_std = of_all("std")
    orders = tuple(order for order in sorted({c.order for c in present} - {1}) if of_all(value, order))
    return Header(names, columns, channels, orders, magnitude_only, has_std)
