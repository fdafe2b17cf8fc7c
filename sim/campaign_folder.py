"""A campaign on disk: a folder with ``campaign.toml`` and one data file for each run."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from difflib import get_close_matches
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Required

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
    with_config,
)

from rigtwin.parsing import parse_toml, toml_lines
from rigtwin.rotor.geometry.rig import Rig, load_rig, shipped_rigs
from rigtwin.scratch import replacing
from rigtwin.sim.campaign import (
    STATED_DAMPING,
    UNKNOWN_DAMPING,
    Campaign,
    MeasurementError,
    NominalBelief,
    PeakList,
    Run,
    SupportKind,
)
from rigtwin.sim.formats.run_file import SUFFIXES, read_run, write_beside
from rigtwin.sim.formats.settings import RunSettings, explain, stored_settings

FILE_NAME = "campaign.toml"

# Keys of [nominal], the first of each of the rig file too.
_DAMPINGS = (
    ("shaft_damping_ratio", "shaft_damping_tolerance"),
    ("bearing_damping_Ns_per_m", "bearing_damping_tolerance"),
)

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


def _none_if_learned(value: Any) -> Any:
    """None for the word "learned"; a number as it is."""
    if not isinstance(value, str):
        return value
    if value != "learned":
        raise ValueError('give a number, or "learned"')
    return None


Repeatability = Annotated[NonNegative | None, BeforeValidator(_none_if_learned)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _NominalTable(_Table):
    shaft_damping_ratio: Annotated[float, Field(ge=0, le=0.2)] | None = None
    bearing_damping_Ns_per_m: NonNegative | None = None
    gain_tolerance: NonNegative = NominalBelief.gain_tolerance
    frequency_drift: Repeatability = None
    gain_repeatability: Repeatability = None
    modulus_tolerance: NonNegative = NominalBelief.modulus_tolerance
    disk_mass_tolerance: NonNegative = NominalBelief.disk_mass_tolerance
    span_tolerance: NonNegative = NominalBelief.span_tolerance
    shaft_damping_tolerance: NonNegative | None = None
    bearing_damping_tolerance: NonNegative | None = None
    tilt_tolerance: NonNegative = NominalBelief.tilt_tolerance
    joint_tolerance: NonNegative = NominalBelief.joint_tolerance
    sensor_mass_kg: NonNegative = NominalBelief.sensor_mass_kg


class _PeaksTable(_Table):
    support: SupportKind
    frequencies_Hz: Annotated[list[Positive], Field(min_length=1)]
    std_Hz: list[Positive]

    @model_validator(mode="after")
    def _paired(self) -> _PeaksTable:
        f = self.frequencies_Hz
        if len(self.std_Hz) != len(f):
            raise ValueError(
                f"frequencies_Hz has {len(f)} numbers and std_Hz {len(self.std_Hz)}; give one for each peak"
            )
        if len(set(f)) < len(f):
            raise ValueError("frequencies_Hz names a resonance twice; remove one")
        return self


@with_config(ConfigDict(extra="forbid"))
class _RunTable(RunSettings, total=False):
    """A [[run]] table: the data file and whatever the campaign says of it."""

    file: Required[Annotated[str, Field(min_length=1)]]


def _says_support(run: _RunTable) -> _RunTable:
    if "support" not in run:
        raise ValueError('support is missing; say support = "rigid" or "bearing"')
    return run


class _CampaignTable(_Table):
    title: str = ""
    rig: Annotated[str, Field(min_length=1)]
    nominal: _NominalTable = _NominalTable()
    run: list[Annotated[_RunTable, AfterValidator(_says_support)]] = []
    peaks: list[_PeaksTable] = []

    @field_validator("run", "peaks", mode="before")
    @classmethod
    def _each_a_table(cls, tables: Any, info: ValidationInfo) -> Any:
        if not isinstance(tables, list):
            raise ValueError(f"is one table; write [[{info.field_name}]] above each")
        return tables

    @model_validator(mode="after")
    def _not_empty(self) -> _CampaignTable:
        if not self.run and not self.peaks:
            raise ValueError("no [[run]] and no [[peaks]]; a campaign needs at least one of either")
        return self


_KEYS = (
    *_RunTable.__annotations__,
    *(key for table in (_CampaignTable, _NominalTable, _PeaksTable) for key in table.model_fields),
)


def load_campaign(folder: str | Path) -> Campaign:
    """Load a campaign folder.

    The rig of the campaign is a shipped rig's name or the full path of its TOML. A run is named after
    its file, without the suffix; a second run from the same file is ``<name>-2``.

    Raises
    ------
    MeasurementError : the folder, campaign.toml or a data file cannot be used; names the file and the key or line
    RigError : the rig file cannot be used
    """
    folder = Path(folder)
    table = _read_table(folder)
    rig = _rig_to_load(folder, table.rig)
    model = load_rig(rig)
    names = _distinct(entry["file"].removesuffix(Path(entry["file"]).suffix) for entry in table.run)
    runs = (_load_run(folder, place, entry, model.excitation_node) for place, entry in enumerate(table.run, start=1))
    campaign = Campaign(
        title=table.title,
        rig=rig,
        runs=tuple(dataclasses.replace(run, name=name) for run, name in zip(runs, names, strict=True)),
        peaks=tuple(_peak_list(peaks) for peaks in table.peaks),
        nominal=_belief(table.nominal, model),
    )
    _check_sensor_mass(folder, campaign)
    return campaign


def _check_sensor_mass(folder: Path, campaign: Campaign) -> None:
    """A roving exciter's channels are where it hit, and no accelerometer weighs on the rotor there."""
    roving = next((run.name for run in campaign.runs if run.roving), None)
    if campaign.nominal.sensor_mass_kg and roving is not None:
        raise MeasurementError(
            f"{folder / FILE_NAME}: nominal sensor_mass_kg: the accelerometer of run {roving!r} stays at its "
            "excitation_node while the exciter roves; set this to 0 and write the mass as a [[mass]] of the rig file"
        )


def _peak_list(table: _PeaksTable) -> PeakList:
    """Resonances in ascending order."""
    frequency_hz, std_hz = np.array(sorted(zip(table.frequencies_Hz, table.std_Hz, strict=True))).T
    return PeakList(table.support, frequency_hz, std_hz)


def _belief(table: _NominalTable, rig: Rig) -> NominalBelief:
    """What the campaign says, and where it does not state a damping the rig's own, which is less sure."""
    said = table.model_dump(exclude_none=True)
    for damping, tolerance in _DAMPINGS:
        said.setdefault(tolerance, STATED_DAMPING if damping in said else UNKNOWN_DAMPING)
        said.setdefault(damping, getattr(rig, damping))
    return NominalBelief(**said)


def _read_table(folder: Path) -> _CampaignTable:
    path = folder / FILE_NAME
    if folder.is_file():
        raise MeasurementError(f"{folder}: is a file; give its folder, {folder.parent}")
    if not folder.is_dir():
        raise MeasurementError(f"{folder}: no such folder; give the folder that holds {FILE_NAME}")
    if not path.is_file():
        raise MeasurementError(f"{folder}: holds no {FILE_NAME}; write one (title, rig, a [[run]] for each data file)")
    try:
        table = parse_toml(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise MeasurementError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise MeasurementError(f"{path}: not a text file in UTF-8 ({error.reason}); save it as UTF-8") from error
    except ValueError as error:
        raise MeasurementError(f"{path}: {error}") from error
    try:
        return _CampaignTable.model_validate(table)
    except ValidationError as error:
        raise MeasurementError(f"{path}: {explain(error, _KEYS)}") from error


def _rig_to_load(folder: Path, rig: str) -> str:
    """A shipped rig's name as it is, a path from the campaign's folder as a full path."""
    if rig in shipped_rigs():
        return rig
    path = (folder / rig).absolute()
    if not isfile(path):  # also of a name that no disk takes, at which methods of a path raise
        close = get_close_matches(rig, shipped_rigs(), n=1)
        guess = f"did you mean {close[0]}? " if close else ""
        raise MeasurementError(
            f"{folder / FILE_NAME}: rig: no rig file {path}; {guess}give the path of a rig TOML (from the campaign's "
            f"folder) or a shipped rig: {', '.join(shipped_rigs())}"
        )
    return str(path.resolve())


def _load_run(folder: Path, place: int, entry: _RunTable, usual_node: int) -> Run:
    path = folder / entry["file"]
    if not isfile(path):
        words = f"{folder / FILE_NAME}: run {place} file: no such data file {str(path)!r}; correct the name"
        if not entry["file"].isprintable():
            words += ", and write folders with /: a backslash begins another character"
        raise MeasurementError(words)
    settings: dict[str, Any] = {key: value for key, value in entry.items() if key != "file"}
    return read_run(path, usual_node, **settings)


def _distinct(names: Iterator[str]) -> list[str]:
    """The names, with -2, -3 … added to those that come again."""
    distinct: list[str] = []
    for name in names:
        choices = (name if n == 1 else f"{name}-{n}" for n in range(1, len(distinct) + 2))
        distinct.append(next(choice for choice in choices if choice not in distinct))
    return distinct


def save_campaign(campaign: Campaign, folder: str | Path, file_format: str = "csv") -> None:
    """Write a campaign folder; files of an earlier campaign are replaced only when all new ones are complete.

    Parameters
    ----------
    folder : made when it is missing
    file_format : "csv", "uff", "unv", "h5" or "mat", for every run

    Raises
    ------
    MeasurementError : the campaign holds what no folder may hold, or the format is unknown
    """
    folder, suffix = Path(folder), f".{file_format}"
    if suffix not in SUFFIXES:
        known = ", ".join(s[1:] for s in SUFFIXES)
        raise MeasurementError(f"{folder}: file_format = {file_format!r} is unknown; a run is one of {known}")
    names = _distinct(_file_name(run.name) for run in campaign.runs)
    files = [name + suffix for name in names]
    tables = _tables(campaign, folder, files)
    try:
        _CampaignTable.model_validate(tables)
    except ValidationError as error:
        raise MeasurementError(f"{folder / FILE_NAME}: {explain(error)}") from error
    _write_files(campaign, folder, files, _toml(tables))


def _write_files(campaign: Campaign, folder: Path, files: list[str], toml: str) -> None:
    """Write everything under free names, then rename; campaign.toml, entered first, is renamed last."""
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        beside = stack.enter_context(replacing(folder / FILE_NAME))
        beside.write_text(toml, encoding="utf-8", newline="\n")
        for run, file in zip(campaign.runs, files, strict=True):
            path = folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            write_beside(run, path, stack.enter_context(replacing(path)))


def _file_name(name: str) -> str:
    """A run's name as a path inside the folder; characters that some system refuses become "_"."""
    parts = [re.sub(r'[<>:"\\|?*\x00-\x1f\x7f]', "_", part).strip(" ") for part in name.split("/")]
    return "/".join(part for part in parts if part.strip(".")) or "run"


def _tables(campaign: Campaign, folder: Path, files: list[str]) -> dict[str, Any]:
    """The campaign as the tables of campaign.toml."""
    return {
        "title": campaign.title,
        "rig": _rig_to_save(folder, campaign.rig),
        "nominal": {key: "learned" if value is None else value for key, value in vars(campaign.nominal).items()},
        "run": [{"file": file, **stored_settings(run)} for run, file in zip(campaign.runs, files, strict=True)],
        "peaks": [
            {"support": p.support, "frequencies_Hz": p.frequencies_hz.tolist(), "std_Hz": p.std_hz.tolist()}
            for p in campaign.peaks
        ],
    }


def _rig_to_save(folder: Path, rig: str) -> str:
    """A shipped rig's name; a rig file inside the folder relative to it; any other with its full path."""
    if rig in shipped_rigs():
        return rig
    path, home = Path(rig).resolve(), folder.resolve()
    return (path.relative_to(home) if path.is_relative_to(home) else path).as_posix()


def _toml(tables: Mapping[str, Any]) -> str:
    """campaign.toml: top-level keys, [nominal], then each [[run]] and [[peaks]]."""
    lines = [
        *toml_lines({key: tables[key] for key in ("title", "rig")}),
        "",
        "[nominal]",
        *toml_lines(tables["nominal"]),
    ]
    for kind in ("run", "peaks"):
        for entry in tables[kind]:
            lines += ["", f"[[{kind}]]", *toml_lines(entry)]
    return "\n".join(lines) + "\n"
