"""``rigtwin sweep``: one stepped-sine run on the virtual rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.dataset import noisy
from rigtwin.console import print_json, progress, say, table
from rigtwin.exits import UserError
from rigtwin.fmus import excitation_node, rotor_fmu
from rigtwin.wording import with_error
from sim.campaign import Plane, Run, SupportKind
from sim.formats import SUFFIXES, write_run
from sim.modal_fit import ModalFitError, Mode, driving_point, fit_modes
from sim.session import FmuSession
from sim.stepped_sine import Rig, Sweep, SweepPlan
from sim.stepped_sine import sweep as measure

# Settings with an option of their own: the run's record must say the same as the FMU does.
_OPTIONS = {
    "rigid_support": "--support",
    "excitation_node": "--excitation-node",
    "excitation_plane": "--plane",
    "spin_speed": "--spin-rpm",
    "force_amplitude": "--force",
    "force_frequency": "--f-min and --f-max",
}


@dataclass(frozen=True)
class SweepRequest:
    """What was asked for on the command line."""

    source: str  # an FMU or a rig
    support: SupportKind
    settings: tuple[str, ...]  # "name=value"
    plan: SweepPlan
    noise: float  # relative
    seed: int
    excitation_node: int | None  # default the FMU's own
    plane: Plane
    spin_rpm: float
    out: Path | None
    as_json: bool


def run_sweep(request: SweepRequest) -> None:
    """Measure, write the file, print what was found."""
    _check_output(request.out)
    plan = noisy(request.plan, request.noise, request.seed) if request.noise else request.plan
    with rotor_fmu(request.source) as fmu, FmuSession(fmu) as session:
        rig = _rig(session, request)
        with progress(f"{request.support} support", plan.n_lines) as count:
            result = measure(session, rig, plan, count)
        guid = str(session.description.guid)
    if request.out:
        write_run(result.run, request.out)
    modes, why_none = _modes(result.run)
    if request.as_json:
        print_json(_summary(request, rig, result, modes, guid))
    else:
        _print(request, rig, result.run, modes, why_none)


def _check_output(out: Path | None) -> None:
    """Refuse before measuring what could not be written after it."""
    if out and out.suffix.lower() not in SUFFIXES:
        raise UserError(f"{out}: unknown kind of file; --out takes {', '.join(SUFFIXES)}")
    if out and not out.parent.is_dir():
        raise UserError(f"{out}: the folder {out.parent} does not exist; create it first")


def _rig(session: FmuSession, request: SweepRequest) -> Rig:
    return Rig(
        support=request.support,
        excitation_node=request.excitation_node or excitation_node(session),
        excitation_plane=request.plane,
        spin_rpm=request.spin_rpm,
        parameters=parse_settings(session, request.settings),
    )


def parse_settings(session: FmuSession, settings: tuple[str, ...]) -> dict[str, float | int | bool]:
    """Parameters from "name=value" texts, each of the type its FMU variable has. Raises UserError."""
    variables = {v.name: v for v in session.description.modelVariables if v.causality in ("parameter", "input")}
    parameters = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise UserError(f"--set {setting}: write name=value, for example --set k_b=1e7")
        if name in _OPTIONS:
            raise UserError(f"--set {setting}: use {_OPTIONS[name]} for this")
        if name not in variables:
            raise UserError(f"--set {setting}: the FMU has no parameter {name}; it has {', '.join(variables)}")
        parameters[name] = _value(setting, text, variables[name].type)
    return parameters


def _value(setting: str, text: str, kind: str) -> float | int | bool:
    words = {"true": True, "false": False}
    try:
        return words[text.lower()] if kind == "Boolean" else int(text) if kind == "Integer" else float(text)
    except (KeyError, ValueError):
        wanted = {"Boolean": "true or false", "Integer": "a whole number"}.get(kind, "a number")
        raise UserError(f"--set {setting}: {text!r} is not {wanted}") from None


def _modes(run: Run) -> tuple[tuple[Mode, ...], str]:
    """Fitted modes, or none and the reason."""
    try:
        return fit_modes(run), ""
    except ModalFitError as error:
        return (), str(error)


def _summary(request: SweepRequest, rig: Rig, result: Sweep, modes: tuple[Mode, ...], guid: str) -> dict[str, Any]:
    return {
        "source": request.source,
        "guid": guid,
        "support": rig.support,
        "excitation_node": rig.excitation_node,
        "parameters": rig.parameters,
        "lines": len(result.lines),
        "largest_remaining_transient": max(line.transient for line in result.lines),
        "modes": [mode_record(result.run, mode) for mode in modes],
        "file": str(request.out) if request.out else None,
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


def _print(request: SweepRequest, rig: Rig, run: Run, modes: tuple[Mode, ...], why_none: str) -> None:
    where = f"force at node {rig.excitation_node} in {rig.excitation_plane}"
    band = f"{run.frequency_hz[0]:g} to {run.frequency_hz[-1]:g} Hz"
    say(f"{rig.support} support, {where}: {len(run.frequency_hz)} lines, {band}")
    if modes:
        table(
            MODE_HEADER,
            [(str(place), *mode_row(run, mode)) for place, mode in enumerate(modes, start=1)],
        )
    else:
        say(f"no mode fitted: {why_none}")
    if request.out:
        say(f"written to {request.out}")


def plan_of(f_min: float, f_max: float, lines: int, force: float) -> SweepPlan:
    """A sweep plan from the command line's numbers. Raises UserError."""
    if not 0 < f_min < f_max:
        raise UserError(f"--f-min {f_min:g} --f-max {f_max:g}: need 0 < f-min < f-max")
    if lines < 8:
        raise UserError(f"--lines {lines}: at least 8 are needed to find a resonance")
    if not force > 0:
        raise UserError(f"--force {force:g}: the force must be positive")
    return replace(SweepPlan(), f_min_hz=f_min, f_max_hz=f_max, n_lines=lines, force_amplitude=force)
