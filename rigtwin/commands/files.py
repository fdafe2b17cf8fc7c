"""``rigtwin inspect`` and ``rigtwin convert``: what a data file holds, and the same run in another file."""

from __future__ import annotations

import logging
from collections.abc import Collection, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.console import print_json, say
from rigtwin.errors import UserError
from rigtwin.parsing import parse_toml, toml_lines
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.campaign import Campaign, Run
from rigtwin.sim.formats import RunSettings, read_run_and_said, write_run
from rigtwin.sim.formats.settings import SETTING_NAMES, UNKNOWN
from rigtwin.sim.formats.variables import UNITS
from rigtwin.wording import counted

# Findings of the audit that say nothing of a file alone.
_OF_CAMPAIGNS = ("coverage", "repeatability")


def inspect_file(path: Path, told: Sequence[str], rig: str | None, *, as_json: bool) -> None:
    """Print what a data file holds, what is odd about it, and the lines to write into ``campaign.toml``.

    Raises MeasurementError where it cannot be read, UserError for a setting that is none.
    """
    settings = told_settings(told)
    run, said, heard = _read(path, settings, rig)
    record = _record(path, run, settings, said)
    record["odd"] = [*heard, *_odd(run, rig)]
    if as_json:
        print_json(record)
        return
    band = f"{record['from_Hz']:.6g} to {record['to_Hz']:.6g} Hz"
    smallest, largest = (f"{record[f'{which}_step_Hz']:.3g}" for which in ("smallest", "largest"))
    steps = f"{smallest} Hz apart" if smallest == largest else f"{smallest} to {largest} Hz apart"
    size = f"{counted(len(run.channels), 'channel')}, {counted(record['lines'], 'line')}"
    say(f"{path.name}: {record['quantity']} in {record['unit']}, {size}")
    say(f"  lines      {band}, {steps}")
    say(f"  channels   {', '.join(record['channels'])}" + (", magnitudes without phases" if run.magnitude_only else ""))
    say(f"  force      at node {run.excitation_node} along {run.excitation_plane}, {_force(run)}")
    say(f"  errors     {'standard errors of every value' if run.std is not None else 'none are given'}")
    if run.harmonics:
        say(f"  harmonics  of order {', '.join(map(str, sorted(run.harmonics)))}")
    for line in record["odd"]:
        say(f"  odd        {line}")
    say("\nFor campaign.toml:\n")
    say(record["campaign_toml"])


def convert_file(source: Path, target: Path, told: Sequence[str], quantity: str | None) -> None:
    """Write a run into a file of another format, in SI, as another quantity where one is asked for.

    Raises MeasurementError where a file cannot be read or written, UserError where the quantity cannot be had.
    """
    if target.exists() and target.samefile(source):
        raise UserError(f"{target}: is the file that is read; give another name")
    run, said, heard = _read(source, told_settings(told))
    if "support" not in said:
        raise UserError(f"{source}: does not say what held the rotor; add --set support=rigid or --set support=bearing")
    for words in heard:
        say(words)
    run = as_quantity(run, quantity) if quantity else run
    write_run(run, target)
    say(f"{target} written: {run.quantity} in {UNITS[run.quantity]}, {len(run.frequency_hz)} lines")


def as_quantity(run: Run, quantity: str) -> Run:
    """The same run as receptance, mobility or accelerance. Raises UserError where the force is not known."""
    if quantity == run.quantity:
        return run
    if "acceleration" in (quantity, run.quantity):
        raise UserError(f"--quantity {quantity}: the force of an acceleration is not known")
    omega = 2 * np.pi * run.frequency_hz[:, None]
    power = DERIVATIVE_ORDER[quantity] - DERIVATIVE_ORDER[run.quantity]
    factor = omega**power if run.magnitude_only else (1j * omega) ** power

    return replace(
        run,
        H=run.H * factor,
        std=None if run.std is None else run.std * np.abs(factor),
        harmonics={order: values * factor * order**power for order, values in run.harmonics.items()},
        quantity=quantity,
    )


def told_settings(told: Sequence[str]) -> RunSettings:
    """Keys of a ``[[run]]`` from ``key=value`` words, values as in TOML or plain text. Raises UserError."""
    settings: dict[str, Any] = {}
    for words in told:
        key, equals, text = words.partition("=")
        if not equals or key not in SETTING_NAMES:
            close = get_close_matches(key, SETTING_NAMES, n=1)
            hint = f"; did you mean {close[0]}?" if close else ""
            raise UserError(f"--set {words}: give KEY=VALUE with a key of a run in campaign.toml{hint}")
        try:
            settings[key] = parse_toml(f"value = {text}")["value"]
        except ValueError:
            settings[key] = text
    return RunSettings(**settings)  # type: ignore[typeddict-item] - checked where they are used


def _read(path: Path, settings: RunSettings, rig: str | None = None) -> tuple[Run, RunSettings, list[str]]:
    """A run, what file and settings say of it, and the warnings of the reader; the rest is as usual for the rig."""
    heard: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: heard.append(record.getMessage().removeprefix(f"{path}: "))  # type: ignore[method-assign]
    logger = logging.getLogger("rigtwin.sim.formats")
    logger.addHandler(handler)
    passed_on, logger.propagate = logger.propagate, False
    try:
        node = load_rig(rig).excitation_node if rig else Run.excitation_node
        return *read_run_and_said(path, node, "bearing", **settings), heard
    finally:
        logger.removeHandler(handler)
        logger.propagate = passed_on


def _record(path: Path, run: Run, settings: RunSettings, said: Collection[str]) -> dict[str, Any]:
    """All there is to say about a run, in JSON types."""
    steps = np.diff(run.frequency_hz) if len(run.frequency_hz) > 1 else np.zeros(1)
    return {
        "file": str(path),
        "quantity": run.quantity,
        "unit": UNITS[run.quantity],
        "lines": len(run.frequency_hz),
        "from_Hz": float(run.frequency_hz[0]),
        "to_Hz": float(run.frequency_hz[-1]),
        "smallest_step_Hz": float(steps.min()),
        "largest_step_Hz": float(steps.max()),
        "channels": [str(channel) for channel in run.channels],
        "magnitude_only": run.magnitude_only,
        "standard_errors": run.std is not None,
        "harmonics": sorted(run.harmonics),
        "force_amplitude_N": run.force_amplitude_N,
        "excitation_node": int(run.excitation_node),
        "excitation_plane": run.excitation_plane,
        "support": run.support if "support" in said else None,
        "campaign_toml": run_table(path, run, settings, said),
    }


def run_table(path: Path, run: Run, settings: RunSettings, said: Collection[str]) -> str:
    """The table of a run in ``campaign.toml``, with a remark on each key that nobody has ``said``."""
    table: dict[str, Any] = {"file": path.name, "support": run.support, "excitation_node": int(run.excitation_node)}
    if run.excitation_plane != "y":
        table["excitation_plane"] = run.excitation_plane
    if run.force_N is None:
        table["force_amplitude_N"] = UNKNOWN if run.force_amplitude_N is None else run.force_amplitude_N
    table["quantity"] = run.quantity
    lines = toml_lines(table | {key: value for key, value in settings.items() if key not in table})
    for place, key in enumerate(table):
        if key != "file" and key not in said:
            other = ' or "rigid":' if key == "support" else ""
            lines[place] = f"{lines[place]:<25}#{other} the file does not say it"
    return "\n".join(["[[run]]", *lines])


def _force(run: Run) -> str:
    if run.force_N is not None:
        return f"{run.force_N.min():.3g} to {run.force_N.max():.3g} N, of every line"
    return "of a size that nobody recorded" if run.force_amplitude_N is None else f"{run.force_amplitude_N:.3g} N"


def _odd(run: Run, rig: str | None) -> list[str]:
    """What the audit of a diagnosis finds about this run alone."""
    from rigtwin.gap.audit.findings import audit

    found = audit(Campaign("", rig or "", (run,)))
    told = [f for f in found if f.severity in ("warning", "error") and f.check not in _OF_CAMPAIGNS]
    return [f.words for f in told]
