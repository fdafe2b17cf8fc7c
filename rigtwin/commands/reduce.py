"""``rigtwin reduce``: time records of an oscilloscope or a logger become a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.commands.files import run_table, told_settings
from rigtwin.console import print_json, progress, say
from rigtwin.errors import UserError
from rigtwin.scratch import check_writable
from rigtwin.sim.campaign import Run
from rigtwin.sim.formats import SUFFIXES, RunSettings, write_run
from rigtwin.sim.formats.record_file import read_record, record_files
from rigtwin.sim.formats.reduction_plan import ReductionPlan, read_plan
from rigtwin.sim.formats.settings import READING, check_settings
from rigtwin.sim.formats.variables import UNITS
from rigtwin.sim.signals import Signals, signals_of
from rigtwin.sim.spectra import reduce_spectra
from rigtwin.sim.stepped_records import line_of, remarks_of, run_of_lines

# Remarks that are printed; the others are counted.
_REMARKS = 10


@dataclass(frozen=True)
class ReduceRequest:
    """What was asked for on the command line."""

    records: tuple[Path, ...]  # files, and folders of files
    out: Path
    plan: Path | None
    channels: tuple[str, ...]  # "NAME=COLUMN, SENSITIVITY"
    told: dict[str, Any]  # keys of the plan
    settings: tuple[str, ...]  # "key=value" of a [[run]]
    as_json: bool


@dataclass(frozen=True)
class Reduced:
    """What the records of a request hold."""

    run: Run
    records: int
    remarks: list[str]
    how: dict[str, Any]  # what a machine may want to know beside the run


def run_reduce(request: ReduceRequest) -> None:
    """Read, reduce, write the run, print what was found and the lines for ``campaign.toml``.

    Raises MeasurementError where a record or the plan cannot be used, UserError for a wrong option.
    """
    settings = _settings(request)
    result = reduce_records(request)
    run = replace(result.run, **settings)
    write_run(run, request.out)
    table = run_table(request.out, run, settings, {"quantity", *settings})
    if request.as_json:
        print_json(_record(request, run, result) | {"campaign_toml": table})
        return
    band = f"{run.frequency_hz[0]:.6g} to {run.frequency_hz[-1]:.6g} Hz"
    say(f"{request.out} written: {run.quantity} in {UNITS[run.quantity]}, {len(run.frequency_hz)} lines, {band}")
    for name, value in result.how.items():
        say(f"  {name.replace('_', ' '):<24} {value if isinstance(value, str) else format(value, '.3g')}")
    for words in result.remarks[:_REMARKS]:
        say(f"  odd  {words}")
    if len(result.remarks) > _REMARKS:
        say(f"  odd  and {len(result.remarks) - _REMARKS} more remarks; --json lists them")
    say("\nFor campaign.toml:\n")
    say(table)


def reduce_records(request: ReduceRequest) -> Reduced:
    """Read and reduce; nothing is written. Raises MeasurementError where a record or the plan cannot be used."""
    plan = read_plan(request.plan, request.told, request.channels)
    files = record_files(list(request.records))
    return _of_lines(files, plan) if plan.method == "sine" else _of_spectra(files, plan)


def _settings(request: ReduceRequest) -> RunSettings:
    """Checked settings of the run. Raises UserError and MeasurementError before anything is read."""
    if request.out.suffix.lower() not in SUFFIXES:
        raise UserError(f"{request.out}: unknown kind of file; --out takes {', '.join(SUFFIXES)}")
    if not request.out.parent.is_dir():
        raise UserError(f"{request.out}: the folder {request.out.parent} does not exist; create it first")
    check_writable(request.out)
    settings = check_settings(told_settings(request.settings), "--set")
    if reading := [key for key in (*READING, "quantity", "control", "roving") if key in settings]:
        raise UserError(f"--set {reading[0]}: says how a run file is read; write it into campaign.toml")
    if request.out.suffix.lower() != ".csv" and "support" not in settings:
        raise UserError(f"{request.out}: says what held the rotor; add --set support=rigid or --set support=bearing")
    return settings


def _of_lines(files: Sequence[tuple[Path, ...]], plan: ReductionPlan) -> Reduced:
    """Each record a line."""
    lines = []
    with progress("records", len(files)) as count:
        for number, each in enumerate(files, start=1):
            lines.append(line_of(_signals(each, plan), plan.largest_change))
            count(number)
    last = plan.sources[-1]
    channels = [source.channel for source in plan.sources if source.channel]
    run = run_of_lines(lines, channels, None if last.channel else last.name)
    used = sum(line.usable for line in lines)
    assert run.std is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nanmedian(np.where(run.H != 0, run.std / np.abs(run.H), np.nan))
    how = {
        "records_used": f"{used} of {len(lines)}",
        "fewest_periods": min(line.periods for line in lines),
        "median_relative_error": float(relative),
    }
    return Reduced(run, len(files), remarks_of(lines), how)


def _of_spectra(files: Sequence[tuple[Path, ...]], plan: ReductionPlan) -> Reduced:
    """All records together."""
    with progress("records", len(files)) as count:
        records = []
        for number, each in enumerate(files, start=1):
            records.append(_signals(each, plan))
            count(number)
    reduced = reduce_spectra(records, plan)
    how = {
        "estimator": plan.estimator.upper(),
        "independent_averages": reduced.averages,
        "median_coherence": float(np.median(reduced.coherence)),
    }
    return Reduced(reduced.run, len(files), list(reduced.remarks), how)


def _signals(files: tuple[Path, ...], plan: ReductionPlan) -> Signals:
    return signals_of(read_record(*files, sample_rate_hz=plan.sample_rate_Hz), plan.sources, files[0])


def _record(request: ReduceRequest, run: Run, result: Reduced) -> dict[str, Any]:
    """All there is to say, in JSON types."""
    return {
        "file": str(request.out),
        "records": result.records,
        "quantity": run.quantity,
        "unit": UNITS[run.quantity],
        "lines": len(run.frequency_hz),
        "from_Hz": float(run.frequency_hz[0]),
        "to_Hz": float(run.frequency_hz[-1]),
        "channels": [str(channel) for channel in run.channels],
        "magnitude_only": run.magnitude_only,
        **result.how,
        "odd": result.remarks,
    }
