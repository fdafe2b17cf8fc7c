"""``rigtwin sweep``: stepped-sine runs on the virtual rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rigtwin.api.runs import MODE_HEADER, mode_row
from rigtwin.api.sweeps import LEAST_LINES, SweepRequest, Swept, measure
from rigtwin.console import note, print_json, progress, say, table
from rigtwin.errors import UserError
from rigtwin.scratch import check_writable
from rigtwin.sim.campaign import Run, SweepDirection
from rigtwin.sim.formats import SUFFIXES
from rigtwin.sim.lines import HOW_TO_SETTLE, NotSettledError
from rigtwin.sim.modal_fit import Mode, driving_point
from rigtwin.sim.stepped_sine import SweepPlan

# Settings with an option of their own: the run's record must say the same as the FMU does.
_OPTIONS = {
    "rigid_support": "--support",
    "excitation_node": "--excitation-node",
    "excitation_plane": "--plane",
    "spin_speed": "--spin-rpm",
    "force_amplitude": "--force",
    "force_frequency": "--f-min and --f-max",
}

# HOW_TO_SETTLE in the words of the command line.
_HOW_TO_SETTLE = "raise --settle-time, or the damping (--set shaft_damping_ratio=VALUE) if it is too low"

# Noise of a line from which chance makes lines that stand out as resonances do.
_MUCH_NOISE = 0.2

# Remarks on single lines that are printed; the others are counted.
_REMARKS = 3


@dataclass(frozen=True)
class Output:
    """Where the results go."""

    out: Path | None
    as_json: bool


def run_sweep(request: SweepRequest, to: Output) -> None:
    """Measure, write the files, print what was found."""
    try:
        _run_sweep(request, to)
    except NotSettledError as error:
        raise UserError(str(error).replace(HOW_TO_SETTLE, _HOW_TO_SETTLE)) from error


def _run_sweep(request: SweepRequest, to: Output) -> None:
    _check_output(to.out)
    if request.noise > _MUCH_NOISE:
        note(
            f"noise of {100 * request.noise:g} % of each line looks like resonances: lines are added round each of "
            "them, and what is fitted means little"
        )
    results: dict[int, Swept] = {}
    for place, swept in measure(request, progress):
        results[place] = swept
        if file := _file_of(request, to.out, swept.run):
            swept.save(file)
    summaries = []
    for _, swept in sorted(results.items()):
        file = _file_of(request, to.out, swept.run)
        summaries.append(_summary(swept, file))
        if not to.as_json:
            _print(swept, file)
    if to.as_json:
        print_json({"runs": summaries} if request.levels else summaries[0])


def _file_of(request: SweepRequest, out: Path | None, run: Run) -> Path | None:
    """Where a run goes: the file that was asked for, of several levels each with its own in the name."""
    if out is None or not request.levels:
        return out
    return out.with_stem(f"{out.stem}_{run.force_amplitude_N:g}N")


def _check_output(out: Path | None) -> None:
    """Refuse before measuring what could not be written after it."""
    if out and out.suffix.lower() not in SUFFIXES:
        raise UserError(f"{out}: unknown kind of file; --out takes {', '.join(SUFFIXES)}")
    if out and not out.parent.is_dir():
        raise UserError(f"{out}: the folder {out.parent} does not exist; create it first")
    if out:
        check_writable(out)


def parse_settings(settings: Sequence[str]) -> dict[str, str]:
    """Parameters of the FMU from "name=value" texts, not yet read: the FMU knows their types. Raises UserError."""
    parameters = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise UserError(f"--set {setting}: write name=value, for example --set k_b=1e7")
        if name in _OPTIONS:
            raise UserError(f"--set {setting}: use {_OPTIONS[name]} for this")
        parameters[name] = text
    return parameters


def _summary(swept: Swept, out: Path | None) -> dict[str, Any]:
    rig, sweep = swept.rig, swept.sweep
    return {
        "source": swept.source,
        "guid": swept.guid,
        "support": rig.support,
        "excitation_node": rig.excitation_node,
        "force_amplitude_N": swept.run.force_amplitude_N,
        "sweep": swept.run.sweep,
        "parameters": rig.parameters,
        "effects": {each.id: asdict(each) for each in rig.effects},
        "lines": len(sweep.lines),
        "largest_remaining_transient": max(line.transient for line in sweep.lines),
        "remarks": sweep.remarks,
        "modes": [mode_record(swept.run, mode) for mode in swept.modes],
        "file": str(out) if out else None,
    }


def mode_record(run: Run, mode: Mode) -> dict[str, float]:
    """A mode for a machine."""
    response, response_std = driving_point(run, mode, run.excitation_node, run.excitation_plane)
    return {
        "frequency_hz": mode.frequency_hz,
        "frequency_std_hz": mode.frequency_std_hz,
        "damping_ratio": mode.damping_ratio,
        "damping_ratio_std": mode.damping_ratio_std,
        "driving_point_response": response,
        "driving_point_response_std": response_std,
        "misfit": mode.misfit,
    }


def _print(swept: Swept, out: Path | None) -> None:
    run, rig, remarks = swept.run, swept.rig, swept.remarks
    where = f"force {run.force_amplitude_N:g} N at node {rig.excitation_node} in {rig.excitation_plane}"
    band = f"{run.frequency_hz[0]:g} to {run.frequency_hz[-1]:g} Hz"
    say(f"{rig.support} support, {where}: {len(run.frequency_hz)} lines, {band}")
    for each in rig.effects:
        say(f"with {each.id}: " + ", ".join(f"{name} = {value:g}" for name, value in asdict(each).items()))
    if len(swept.modes):
        table(MODE_HEADER, [(str(place), *mode_row(run, mode)) for place, mode in enumerate(swept.modes, start=1)])
    else:
        say(f"no mode fitted: {swept.why_no_modes}")
    for remark in remarks[:_REMARKS]:
        note(remark)
    if len(remarks) > _REMARKS:
        note(f"and {len(remarks) - _REMARKS} more lines with such remarks; --json lists them")
    if out:
        say(f"written to {out}")


def plan_of(
    f_min: float,
    f_max: float,
    lines: int,
    force: float,
    direction: SweepDirection,
    settle_time: float = SweepPlan.settle_time,
) -> SweepPlan:
    """A sweep plan from the command line's numbers. Raises UserError."""
    if not 0 < f_min < f_max:
        raise UserError(f"--f-min {f_min:g} --f-max {f_max:g}: need 0 < f-min < f-max")
    if lines < LEAST_LINES:
        raise UserError(f"--lines {lines}: at least {LEAST_LINES} are needed to find a resonance")
    if not 0 < force < math.inf:
        raise UserError(f"--force {force:g}: the force must be positive")
    if not 0 < settle_time < math.inf:
        raise UserError(f"--settle-time {settle_time:g}: give a positive number of seconds")
    return SweepPlan(
        f_min_hz=f_min,
        f_max_hz=f_max,
        n_lines=lines,
        force_amplitude=force,
        direction=direction,
        settle_time=settle_time,
    )


def levels_of(text: str | None) -> tuple[float, ...]:
    """Force levels from "0.5,1,2". Raises UserError."""
    if text is None:
        return ()
    try:
        levels = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise UserError(f"--levels {text}: write forces in newtons, for example --levels 0.5,1,2") from None
    if not all(0 < level < math.inf for level in levels) or len({f"{level:g}" for level in levels}) < len(levels):
        raise UserError(f"--levels {text}: the forces must be positive and different in six digits")
    return levels
