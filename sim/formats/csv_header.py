"""The grammar of the campaign CSV's column names: ``node2_z_h3_re`` and the like."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rigtwin.sim.campaign import Channel, MeasurementError

logger = logging.getLogger(__name__)

FREQUENCY, FORCE = "frequency_Hz", "force_N"

Part = Literal["re", "im", "abs", "dB", "deg", "std", "coherence"]

_COLUMN = re.compile(
    r"node([1-9][0-9]{0,8})([a-z]?)(_z)?(?:_h([2-9]|[1-9][0-9]{1,8}))?_(re|im|abs|dB|deg|std|coherence)"
)

_CHANNEL = re.compile(r"(-?)node([1-9][0-9]{0,8})([a-z]?)(_z)?")
PLACE = re.compile(r"(\d{1,9})([XYZxyz])([+-])")  # a channel that is called after its place, such as 2Y+

# Parts that belong to the run as a whole: not to one of its harmonics.
_ONCE = ("std", "coherence")

_KNOWN = (
    f"known are {FREQUENCY}, {FORCE}, node2_re with node2_im (or node2_abs or node2_dB, with node2_deg where there are "
    "phases), node2_std or node2_coherence, node2b_re … for a second sensor, node2_z_re … for the other plane and "
    "node2_h3_re … for the third harmonic, with any node from 1"
)

_OTHERWISE = (
    "of a file with other names, channels in campaign.toml says what they mean (--set 'channels={node2_re = \"Re\"}'), "
    "and rigtwin reduce reads records over time"
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
    columns: dict[str, Column]  # the same without frequency and force
    channels: tuple[Channel, ...]  # in order of appearance
    orders: tuple[int, ...]  # harmonic orders of all channels, from 2
    magnitude_only: bool
    has_std: bool  # of all channels
    has_coherence: bool  # of all channels

    @property
    def has_force(self) -> bool:
        """Whether the force of every line is there."""
        return FORCE in self.names


def channel_of(text: str) -> tuple[int, Channel]:
    """Sign and channel of ``node2``, ``node2b_z`` or, of a sensor that points the other way, ``-node2``; or of ``2Y-``.

    Raises ValueError where it is none.
    """
    place = PLACE.fullmatch(text)
    if place is not None and int(place[1]) and place[2] not in "Xx":
        return -1 if place[3] == "-" else 1, Channel(int(place[1]), "z" if place[2] in "Zz" else "y")
    match = _CHANNEL.fullmatch(text)
    if match is None:
        raise ValueError(
            f"{text!r} is no channel; write node2, node2_z for the other plane, or -node2 for its negative"
        )
    return -1 if match[1] else 1, Channel(int(match[2]), "z" if match[4] else "y", match[3])


def parse_header(place: str, cells: list[str]) -> Header:
    """Parse the header line; ``place`` names file and line. Raises MeasurementError that names them and the column.

    >>> parse_header("run.csv, line 1", ["frequency_Hz", "node2_re", "node2_im"]).channels
    (Channel(node=2, plane='y', label=''),)
    """
    names = tuple(cell.strip() for cell in cells)
    _refuse_no_header(place, names)
    for name, count in Counter(names).items():
        if count > 1:
            raise MeasurementError(f"{place}, column {name}: is there {count} times; keep one")
    columns = {n: _column(place, k, n) for k, n in enumerate(names, start=1) if n not in (FREQUENCY, FORCE)}
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
            f"{place}: columns must be separated by one sign throughout, a comma, a semicolon or a tab; save it again"
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
    if match is None or (match[4] and match[5] in _ONCE):
        raise MeasurementError(f"{place}, column {number} {name!r}: unknown column; {_KNOWN}; {_OTHERWISE}")
    channel = Channel(int(match[1]), "z" if match[3] else "y", match[2])
    return Column(channel, match[5], int(match[4] or 1))  # type: ignore[arg-type]


def _check_partner(place: str, column: Column, present: set[Column]) -> None:
    """``re`` needs ``im`` and the reverse; ``abs`` and ``dB`` exclude them and each other, ``deg`` needs one of these
    two; the rest needs the channel's response."""

    def there(part: Part, order: int = column.order) -> bool:
        return Column(column.channel, part, order) in present

    where = f"{place}, column {column}"
    partner: dict[Part, Part] = {"re": "im", "im": "re"}
    if column.part in ("abs", "dB", "deg") and (there("re") or there("im")):
        raise MeasurementError(
            f"{where}: this node has real and imaginary part too; keep those or _{column.part}, not both"
        )
    if column.part == "abs" and there("dB"):
        raise MeasurementError(f"{where}: this node has its magnitude in dB too; keep _abs or _dB, not both")
    if column.part == "deg" and not (there("abs") or there("dB")):
        magnitude = Column(column.channel, "abs", column.order)
        raise MeasurementError(f"{where}: a phase needs its magnitude; add {magnitude} or the same in _dB")
    if column.part in partner and not there(partner[column.part]):
        missing = Column(column.channel, partner[column.part], column.order)
        raise MeasurementError(f"{where}: column {missing} is missing; a complex value needs both")
    if not (there("re", 1) or there("abs", 1) or there("dB", 1)):
        raise MeasurementError(f"{where}: {column.channel} has no response; add {column.channel}_re and _im, or _abs")


def _complete(place: str, names: tuple[str, ...], columns: dict[str, Column], channels: tuple[Channel, ...]) -> Header:
    """All channels must give magnitudes or complex values; errors and harmonics that not all give are passed over."""
    present = set(columns.values())
    with_phase = {(c.channel, c.order) for c in present if c.part in ("re", "deg")}
    without = [c for c in columns.values() if c.part in ("abs", "dB") and (c.channel, c.order) not in with_phase]
    if without and with_phase:
        raise MeasurementError(
            f"{place}, column {without[0]}: other columns are complex (_re, _im); put the nodes that have "
            "magnitudes only in a run file of their own, or add their phases (_deg)"
        )

    def of_all(what: str, there: Callable[[Channel], bool]) -> bool:
        missing = [channel for channel in channels if not there(channel)]
        if missing and len(missing) < len(channels):
            logger.warning("%s: %s missing for %s, and left out for all", place, what, ", ".join(map(str, missing)))
        return not missing

    def has_order(order: int) -> bool:
        values = {c.channel for c in present if c.order == order and c.part in ("re", "abs", "dB")}
        return of_all(f"harmonics of order {order} are", values.__contains__)

    has_std = of_all("standard errors are", lambda channel: Column(channel, "std") in present)
    has_coherence = of_all("coherences are", lambda channel: Column(channel, "coherence") in present)
    orders = tuple(order for order in sorted({c.order for c in present} - {1}) if has_order(order))
    return Header(names, columns, channels, orders, bool(without), has_std, has_coherence)
