"""``rigtwin sweep``: stepped-sine runs on the virtual rig."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from fmpy.model_description import ModelDescription

from rigtwin.commands.fmus import Host, excitation_node, host_of, rotor_fmu
from rigtwin.commands.settings import parse_effects, value_of
from rigtwin.console import note, print_json, progress, say, table
from rigtwin.estimator.dataset import noisy
from rigtwin.exits import UserError
from rigtwin.scale_out import executor
from rigtwin.sim.archive import describe
from rigtwin.sim.campaign import Plane, Run, SupportKind, SweepDirection
from rigtwin.sim.formats import SUFFIXES, write_run
from rigtwin.sim.formats.atomic import check_writable
from rigtwin.sim.lines import HOW_TO_SETTLE, NotSettledError
from rigtwin.sim.modal_fit import ModalFitError, Mode, driving_point, fit_modes
from rigtwin.sim.runs import sweep_all, sweep_one
from rigtwin.sim.session import kind_of
from rigtwin.sim.stepped_sine import Rig, Sweep, SweepPlan
from rigtwin.wording import with_error

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

# Remarks on single lines that are printed; the others are counted.
_REMARKS = 3


@dataclass(frozen=True)
class SweepRequest:
    """What was asked for on the command line."""

    source: str  # an FMU or a rig
    support: SupportKind
    effects: tuple[str, ...]  # ids
    settings: tuple[str, ...]  # "name=value"
    plan: SweepPlan
    levels: tuple[float, ...]  # force amplitudes, a run each; none: the plan's alone [N]
    noise: float  # relative
    seed: int
    excitation_node: int | None  # default the FMU's own
    plane: Plane
    across: bool  # accelerometers in the other plane, too
    quantity: Literal["accelerance", "acceleration"]
    spin_rpm: float
    out: Path | None
    as_json: bool
    executor: str | None = None  # "dask://host:port"; default processes here
    trust: bool = False  # an FMU that was built elsewhere


def run_sweep(request: SweepRequest) -> None:
    """Measure, write the files, print what was found."""
    try:
        _run_sweep(request)
    except NotSettledError as error:
        raise UserError(str(error).replace(HOW_TO_SETTLE, _HOW_TO_SETTLE)) from error


def _run_sweep(request: SweepRequest) -> None:
    _check_output(request.out)
    if request.executor and not request.source.lower().endswith(".fmu"):
        raise UserError(f"--executor: give an FMU that all workers see in place of the rig {request.source}")
    plan = noisy(request.plan, request.noise, request.seed) if request.noise else request.plan
    plans = [replace(plan, force_amplitude=level) for level in request.levels or (plan.force_amplitude,)]
    results: dict[int, Sweep] = {}
    with ExitStack() as stack:
        fmu = stack.enter_context(rotor_fmu(request.source))
        description = describe(fmu)
        rig, guid = _rig(description, request), str(description.guid)
        run = stack.enter_context(host_of(fmu, trust=request.trust))
        for place, result in _measure(run, fmu.resolve(), rig, plans, request.executor):
            results[place] = result
            if out := _file_of(request, plans[place]):
                write_run(result.run, out)
    summaries = []
    for place, one in enumerate(plans):
        result, out = results[place], _file_of(request, one)
        modes, why_none = _modes(result.run)
        summaries.append(_summary(request.source, rig, result, modes, guid, out))
        if not request.as_json:
            _print(rig, result, modes, why_none, out)
    if request.as_json:
        print_json({"runs": summaries} if request.levels else summaries[0])


def _measure(
    run: Host, fmu: Path, rig: Rig, plans: Sequence[SweepPlan], where: str | None
) -> Iterator[tuple[int, Sweep]]:
    """A run for each plan, with its place, as it is done; several at once, one for each core, or on a cluster."""
    if len(plans) == 1 and not where:
        words = f"{rig.support} support, {plans[0].force_amplitude:g} N"
        with progress(words, rig.carry_out(plans[0]).n_lines) as count:
            yield 0, run(sweep_one, fmu, rig, plans[0], progress=count)
        return
    with executor(where) as pool, progress(f"{rig.support} support, runs", len(plans)) as count:
        runs = sweep_all(fmu, [(rig, plan) for plan in plans], pool)
        for number, done in enumerate(runs, start=1):
            count(number)
            yield done


def _file_of(request: SweepRequest, plan: SweepPlan) -> Path | None:
    """Where a run goes: the file that was asked for, of several levels each with its own in the name."""
    if request.out is None or not request.levels:
        return request.out
    return request.out.with_stem(f"{request.out.stem}_{plan.force_amplitude:g}N")


def _check_output(out: Path | None) -> None:
    """Refuse before measuring what could not be written after it."""
    if out and out.suffix.lower() not in SUFFIXES:
        raise UserError(f"{out}: unknown kind of file; --out takes {', '.join(SUFFIXES)}")
    if out and not out.parent.is_dir():
        raise UserError(f"{out}: the folder {out.parent} does not exist; create it first")
    if out:
        check_writable(out)


def _rig(description: ModelDescription, request: SweepRequest) -> Rig:
    effects, settings = parse_effects(request.effects, request.settings)
    return Rig(
        support=request.support,
        excitation_node=request.excitation_node or excitation_node(description),
        excitation_plane=request.plane,
        spin_rpm=request.spin_rpm,
        parameters=parse_settings(description, settings),
        effects=effects,
        quantity=request.quantity,
        sensor_planes=(request.plane, "z" if request.plane == "y" else "y") if request.across else (),
    )


def parse_settings(description: ModelDescription, settings: tuple[str, ...]) -> dict[str, float | int | bool]:
    """Parameters from "name=value" texts, each of the type its FMU variable has. Raises UserError."""
    variables = {v.name: v for v in description.modelVariables if v.causality in ("parameter", "input")}
    parameters = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise UserError(f"--set {setting}: write name=value, for example --set k_b=1e7")
        if name in _OPTIONS:
            raise UserError(f"--set {setting}: use {_OPTIONS[name]} for this")
        if name not in variables:
            known = ", ".join(known for known in variables if "." not in known)
            raise UserError(f"--set {setting}: the FMU has no parameter {name}; it has {known}, and those of --effect")
        parameters[name] = value_of(setting, text, kind_of(variables[name]))
    return parameters


def _modes(run: Run) -> tuple[tuple[Mode, ...], str]:
    """Fitted modes, or none and the reason."""
    try:
        return fit_modes(run), ""
    except ModalFitError as error:
        return (), str(error)


def _summary(
    source: str, rig: Rig, result: Sweep, modes: tuple[Mode, ...], guid: str, out: Path | None
) -> dict[str, Any]:
    return {
        "source": source,
        "guid": guid,
        "support": rig.support,
        "excitation_node": rig.excitation_node,
        "force_amplitude_N": result.run.force_amplitude_N,
        "sweep": result.run.sweep,
        "parameters": rig.parameters,
        "effects": {effect.id: asdict(effect) for effect in rig.effects},
        "lines": len(result.lines),
        "largest_remaining_transient": max(line.transient for line in result.lines),
        "remarks": result.remarks,
        "modes": [mode_record(result.run, mode) for mode in modes],
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


# The response is the mode's own, at its resonance and at the driving point, in the unit of the run.
MODE_HEADER = ("mode", "frequency, Hz", "damping, %", "driving-point response", "misfit")


def mode_row(run: Run, mode: Mode) -> tuple[str, str, str, str]:
    """A mode for a reader: frequency, damping, driving-point response, misfit."""
    try:
        response = with_error(*driving_point(run, mode, run.excitation_node, run.excitation_plane))
    except ValueError:  # no accelerometer at the driving point
        response = ""
    known = run.std is not None and np.median(run.std) > 1e-6 * np.median(np.abs(run.H).max(axis=1))
    return (
        with_error(mode.frequency_hz, mode.frequency_std_hz),
        with_error(100 * mode.damping_ratio, 100 * mode.damping_ratio_std),
        response,
        f"{mode.misfit:.2f}" if known else "",
    )


def _print(rig: Rig, result: Sweep, modes: tuple[Mode, ...], why_none: str, out: Path | None) -> None:
    run = result.run
    where = f"force {run.force_amplitude_N:g} N at node {rig.excitation_node} in {rig.excitation_plane}"
    band = f"{run.frequency_hz[0]:g} to {run.frequency_hz[-1]:g} Hz"
    say(f"{rig.support} support, {where}: {len(run.frequency_hz)} lines, {band}")
    for effect in rig.effects:
        say(f"with {effect.id}: " + ", ".join(f"{name} = {value:g}" for name, value in asdict(effect).items()))
    if modes:
        table(MODE_HEADER, [(str(place), *mode_row(run, mode)) for place, mode in enumerate(modes, start=1)])
    else:
        say(f"no mode fitted: {why_none}")
    for remark in result.remarks[:_REMARKS]:
        note(remark)
    if len(result.remarks) > _REMARKS:
        note(f"and {len(result.remarks) - _REMARKS} more lines with such remarks; --json lists them")
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
    if lines < 8:
        raise UserError(f"--lines {lines}: at least 8 are needed to find a resonance")
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
