"""How a run was measured: the keys of a ``[[run]]`` table, their checks and their defaults."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict

from rigtwin.sim.campaign import Control, MeasurementError, Plane, Quantity, Roving, Run, SupportKind, SweepDirection
from rigtwin.sim.formats.units import FREQUENCY, factor_of, response_factor

logger = logging.getLogger(__name__)

# TOML, CSV and MATLAB have no null; this word stands for a force amplitude nobody recorded.
UNKNOWN = "unknown"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Node = Annotated[int, Field(ge=1, le=999_999_999)]  # as many digits as a column's name has


def _unknown_is_none(value: Any) -> Any:
    return None if isinstance(value, str) and value == UNKNOWN else value


def _ordered(band: tuple[float, float]) -> tuple[float, float]:
    if not band[0] < band[1]:
        raise ValueError("a band is [from, to] in Hz, from below to")
    return band


def _response_unit(text: str) -> str:
    if response_factor(text) is None:
        raise ValueError(f"{text!r} is no unit that is known; write one like g, mm/s^2, m/s or in, or one per N or lbf")
    return text


def _frequency_unit(text: str) -> str:
    if factor_of(text, FREQUENCY) is None:
        raise ValueError(f"{text!r} is no unit of frequencies that is known; write Hz, kHz, rad/s or rpm")
    return text


Force = Annotated[Positive | None, BeforeValidator(_unknown_is_none)]
Band = Annotated[tuple[Finite, Finite], AfterValidator(_ordered)]


class UnknownSupportError(MeasurementError):
    """Neither the campaign nor the data file says what held the rotor."""


@with_config(ConfigDict(extra="forbid"))
class RunSettings(TypedDict, total=False):
    """How a run was measured. An absent key was not said; it is then looked for in the data file."""

    support: SupportKind
    excitation_node: Node  # counted from 1; default the rig's
    excitation_plane: Plane  # default "y"
    force_amplitude_N: Force  # [N] peak; None: not recorded; default 1, or None where quantity is "acceleration"
    spin_rpm: Finite  # [rev/min], the sign is the direction about +x; default 0
    quantity: Quantity  # default "accelerance"
    sweep: SweepDirection | None  # default None: lines measured one by one
    control: Control  # default "force"
    response_amplitude: Positive  # that a controller held, peak, unit of the quantity without "per newton"
    response_node: Node  # whose response that is; default the exciter's node
    roving: Roving | None  # default None: the accelerometers stayed, and so did the exciter
    phase_offset_deg: Finite  # added to the phase of every channel; default 0
    leave_out_Hz: list[Band]  # bands whose lines are not used; default none
    keep_Hz: list[Band]  # bands outside which no line is used; default all
    averages: Annotated[int, Field(ge=2, le=10**9)]  # spectra behind each response and its coherence
    unit: Annotated[str, AfterValidator(_response_unit)]  # of the response in the file: "g/N", "mm/s^2"; default SI
    frequency_unit: Annotated[str, AfterValidator(_frequency_unit)]  # "rad/s", "rpm"; default Hz
    channels: dict[str, str]  # what names in the file mean: of a universal file "node2_z", "-node2", of a CSV columns


SETTING_NAMES = tuple(RunSettings.__annotations__)

# Keys that say how the data are read; a run keeps the result and not the key.
READING = (
    "response_amplitude",
    "response_node",
    "phase_offset_deg",
    "leave_out_Hz",
    "keep_Hz",
    "averages",
    "channels",
    "unit",
    "frequency_unit",
)

_DEFAULTS = {
    "excitation_plane": "y",
    "spin_rpm": 0.0,
    "quantity": "accelerance",
    "sweep": None,
    "control": "force",
    "roving": None,
}

_CHECK = TypeAdapter(RunSettings)


def check_settings(settings: Mapping[str, Any], where: str | Path) -> RunSettings:
    """Check settings key by key; ``where`` names their source in the MeasurementError.

    >>> check_settings({"support": "rigid", "spin_rpm": 3000}, where="campaign.toml")
    {'support': 'rigid', 'spin_rpm': 3000.0}
    """
    try:
        return _CHECK.validate_python(dict(settings))
    except ValidationError as error:
        raise MeasurementError(f"{where}: {explain(error)}") from error


def settings_of(run: Run) -> RunSettings:
    """Every setting of a run, as a file stores it."""
    return RunSettings(
        support=run.support,
        excitation_node=int(run.excitation_node),
        excitation_plane=run.excitation_plane,
        force_amplitude_N=None if run.force_amplitude_N is None else float(run.force_amplitude_N),
        spin_rpm=float(run.spin_rpm),
        quantity=run.quantity,
        sweep=run.sweep,
        control=run.control,
        roving=run.roving,
    )


def stored_settings(run: Run) -> dict[str, str | int | float]:
    """Settings without nulls: an unrecorded force is "unknown", and what is not said is no key."""
    settings: dict[str, Any] = {**settings_of(run)}
    if run.force_amplitude_N is None:
        settings["force_amplitude_N"] = UNKNOWN
    silent = [key for key in ("sweep", "control", "roving") if settings[key] == _DEFAULTS[key]]
    return {key: value for key, value in settings.items() if key not in silent}


def settle(path: Path, given: RunSettings, found: RunSettings, usual_node: int) -> dict[str, Any]:
    """All settings of a run: the campaign's word first, then the data file's, then the defaults.

    A force that nobody states is None where each line has its own, or where a controller or the exciter's current
    decided it.
    """
    for key in given.keys() & found.keys():
        if given[key] != found[key]:
            logger.warning("%s: says %s = %r; %r is used, as the campaign says", path, key, found[key], given[key])
    said: dict[str, Any] = {**found, **given}
    if "support" not in said:
        raise UnknownSupportError(f'{path}: support is not known; say support = "rigid" or "bearing"')
    varies = said.get("quantity") == "acceleration" or said.get("control") == "response"
    return {**_DEFAULTS, "excitation_node": usual_node, "force_amplitude_N": None if varies else 1.0, **said}


def explain(error: ValidationError, known: Collection[str] = SETTING_NAMES) -> str:
    """All problems of a table in one line: 'run 2 support: Input should be ...; nominal gain: unknown key'.

    Parameters
    ----------
    known : keys that an unknown one may be a misspelling of
    """
    return "; ".join(_key(e["loc"]) + _problem(e["type"], e["msg"], e["loc"], known) for e in error.errors())


def _key(location: tuple[int | str, ...]) -> str:
    """'run 2 support: ' for ('run', 1, 'support'), nothing for the whole table."""
    words = " ".join(str(part + 1) if isinstance(part, int) else part for part in location)
    return f"{words}: " if words else ""


def _problem(kind: str, message: str, location: tuple[int | str, ...], known: Collection[str]) -> str:
    if kind == "extra_forbidden":
        close = get_close_matches(str(location[-1]), known, n=1)
        return f"unknown key; did you mean {close[0]}?" if close else "unknown key; check its spelling or remove it"
    if kind == "missing":
        return "is missing; write it"
    return message.removeprefix("Value error, ")
