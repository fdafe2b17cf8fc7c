"""How records become a run: which channel is what, in which unit, and by which method; as a TOML file says it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from rigtwin.parsing import parse_toml
from rigtwin.sim.campaign import Channel, MeasurementError
from rigtwin.sim.formats.csv_header import channel_of
from rigtwin.sim.formats.settings import Band, Positive, explain
from rigtwin.sim.formats.units import Sensitivity, derivative_order, kind_of, sensitivity

FORCE, REFERENCE = "force", "reference"

Method = Literal["sine", "hammer", "random"]
Estimator = Literal["h1", "h2"]


def _known_unit(text: str) -> str:
    if text and kind_of(text) is None:
        raise ValueError(f"{text!r} is no unit that is known; write one like V, mV, counts, N, m/s^2, g or mm/s")
    return text


def _known_sensitivity(text: str) -> str:
    if text:
        sensitivity(text)
    return text


class ChannelTable(BaseModel):
    """Where a channel stands in the records and what its numbers are."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    column: str | int  # its name in the file, or its number from 1 where the file names nothing
    unit: Annotated[str, AfterValidator(_known_unit)] = ""  # of the numbers; default what the file says, or V
    sensitivity: Annotated[str, AfterValidator(_known_sensitivity)] = ""  # "22.4 mV/N"

    @model_validator(mode="after")
    def _one_signal(self) -> ChannelTable:
        if self.unit and self.sensitivity:
            kind = (kind_of(self.unit) or ("", 1.0))[0]
            if kind != sensitivity(self.sensitivity).signal:
                raise ValueError(
                    f"unit {self.unit!r} and sensitivity {self.sensitivity!r} do not go together; give the unit of the "
                    "numbers in the file, as V or mV, or leave out the sensitivity of numbers that are in N or m/s^2"
                )
        return self


class ReductionPlan(BaseModel):
    """A plan of a reduction; every key but ``channels`` has a default."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    channels: dict[str, ChannelTable]  # "force", "reference", or a channel: "node2", "-node4_z", "2Y+"
    method: Method = "sine"
    estimator: Estimator = "h1"
    sample_rate_Hz: Positive | None = None  # wins over what the records say
    largest_change: Positive = 0.05  # of a stepped line from its first to its last part, relative
    block_s: Positive | None = None  # length of a block that is transformed
    trigger: Annotated[float, Field(gt=0, lt=1)] = 0.1  # a hit begins at this share of the record's largest force
    exponential_s: Positive | None = None  # time constant of an exponential window, for hammer records
    band_Hz: Band | None = None  # of the lines that are written

    @field_validator("channels")
    @classmethod
    def _sensible(cls, channels: dict[str, ChannelTable]) -> dict[str, ChannelTable]:
        for name, table in channels.items():
            try:
                _source(name, table)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from error
        responses = [_source(name, table).channel for name, table in channels.items()]
        if not [channel for channel in responses if channel]:
            raise ValueError('no response; add one, for example node2 = {column = "CH2", sensitivity = "100 mV/g"}')
        if len(set(responses)) < len(responses):
            raise ValueError("a force and a reference, or one node twice; of two sensors of a node call one node2b")
        return channels

    @model_validator(mode="after")
    def _with_force(self) -> ReductionPlan:
        if self.method != "sine" and FORCE not in self.channels:
            raise ValueError(f"channels: {self.method} records need a force; add the channel force")
        return self

    @model_validator(mode="after")
    def _each_column_once(self) -> ReductionPlan:
        named: dict[str, str] = {}
        for name, table in self.channels.items():
            other = named.setdefault(str(table.column).lower(), name)
            if other != name:
                raise ValueError(
                    f"channels: {other} and {name} are both the column {table.column}; correct one of them"
                )
        return self

    @property
    def sources(self) -> tuple[Source, ...]:
        """The responses in the plan's order, and last the force or the reference, if there is one."""
        found = [_source(name, table) for name, table in self.channels.items()]
        return tuple(sorted(found, key=lambda source: source.channel is None))


@dataclass(frozen=True)
class Source:
    """A response, the force or the reference, and where in a record it comes from."""

    name: str  # "force", "reference" or as the plan calls the channel
    channel: Channel | None  # None of the force and the reference
    sign: int
    column: str | int
    unit: str
    sensitivity: Sensitivity | None

    def factor(self, unit_in_file: str) -> float:
        """What a number of the file is to be multiplied with to be in SI. Raises ValueError where nobody knows it."""
        said = self.unit or unit_in_file
        kind, factor = kind_of(said) or ("", 1.0)
        if self.name == REFERENCE:
            return factor
        if self.sensitivity is None:
            if kind == self._measured():
                return self.sign * factor
            if derivative_order(kind) is not None and self.channel:
                raise ValueError(f'the file says it is in {said}; write unit = "{said}" in the plan if this is right')
            known = f"its numbers are in {said}" if said else "its unit is not known"
            example = "22.4 mV/N" if self.name == FORCE else "100 mV/g"
            raise ValueError(f'{known}; give its sensitivity, for example sensitivity = "{example}"')
        if kind and kind != self.sensitivity.signal:
            raise ValueError(
                f"the file says it is in {said}, which does not go with a sensitivity of a {self._signal()}"
            )
        return self.sign * factor / self.sensitivity.value

    def _signal(self) -> str:
        return "signal in volts" if self.sensitivity and self.sensitivity.signal == "voltage" else "signal in counts"

    def _measured(self) -> str:
        """What the numbers measure: of a response without sensitivity, what its unit says."""
        kind = (kind_of(self.unit) or ("", 1.0))[0]
        if self.sensitivity is not None:
            kind = self.sensitivity.measured
        return FORCE if self.name == FORCE else kind if derivative_order(kind) is not None else "acceleration"

    @property
    def order(self) -> int:
        """Which derivative of the displacement a response is."""
        return derivative_order(self._measured()) or 0


def _source(name: str, table: ChannelTable) -> Source:
    """Raises ValueError where the name is no channel, or measures what its unit does not."""
    told = sensitivity(table.sensitivity) if table.sensitivity else None
    if name in (FORCE, REFERENCE):
        sign, channel = 1, None
    else:
        sign, channel = channel_of(name)
    found = Source(name, channel, sign, table.column, table.unit, told)
    kind = told.measured if told else (kind_of(table.unit) or ("", 1.0))[0]
    is_force = kind == "force"
    if name == FORCE and kind and not is_force and kind not in ("voltage", "counts"):
        raise ValueError(f"a force is not measured in the unit of {_an(kind)}; correct it")
    if channel and is_force:
        raise ValueError("a response is not measured in the unit of a force; correct it, or call the channel force")
    return found


def _an(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


_KEYS = (*ReductionPlan.model_fields, *ChannelTable.model_fields, FORCE, REFERENCE)


def read_plan(path: Path | None, told: dict[str, Any], channels: Sequence[str]) -> ReductionPlan:
    """The plan of a file, with what the command line says in its place.

    Parameters
    ----------
    path : a TOML file, or None
    told : keys of the plan that the command line gives
    channels : ``NAME=COLUMN, SENSITIVITY`` or ``NAME=COLUMN, UNIT`` each, beside those of the file

    Raises
    ------
    MeasurementError : names the file and the key
    """
    tables = _tables(path) if path else {}
    where = str(path) if path else "--channel"
    tables |= told
    if channels:
        tables["channels"] = {**tables.get("channels", {}), **dict(_told_channel(words) for words in channels)}
    if "channels" not in tables:
        raise MeasurementError(
            f"{path or 'no plan'}: says of no channel what it is; add a table [channels], or --channel, for example "
            '--channel "force=CH1, 22.4 mV/N" --channel "node2=CH2, 100 mV/g"'
        )
    try:
        return ReductionPlan.model_validate(tables)
    except ValidationError as error:
        here = "the command line" if error.errors()[0]["loc"][:1] in [(key,) for key in told] else where
        raise MeasurementError(f"{here}: {explain(error, _KEYS)}") from error


def _tables(path: Path) -> dict[str, Any]:
    try:
        return parse_toml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise MeasurementError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise MeasurementError(f"{path}: not a text file in UTF-8 ({error.reason}); save it as UTF-8") from error
    except ValueError as error:
        raise MeasurementError(f"{path}: {error}") from error


def _told_channel(words: str) -> tuple[str, dict[str, str]]:
    """Name and table of ``node2=CH2, 100 mV/g``."""
    name, equals, rest = words.partition("=")
    column, _, scale = rest.partition(",")
    if not equals or not column.strip():
        raise MeasurementError(f'--channel {words}: write NAME=COLUMN, SENSITIVITY, for example "node2=CH2, 100 mV/g"')
    key = "sensitivity" if any(letter.isdigit() for letter in scale.split("/")[0]) else "unit"
    return name.strip(), {"column": column.strip(), key: scale.strip()}
