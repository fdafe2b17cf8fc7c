"""``rigtwin build``: the FMUs of a rig."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from rigtwin.api.fmus import (
    ESTIMATOR_FMU,
    SHIPPED_RIG,
    build_compiled,
    build_fmu,
    build_listeners,
    check_native,
    is_shipped,
)
from rigtwin.api.rigs import load_rig
from rigtwin.console import note, say
from rigtwin.errors import UserError, existing
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.scratch import replacing


@dataclass(frozen=True)
class BuildRequest:
    """What was asked for on the command line."""

    rig: str
    out: Path
    train: bool
    native: bool
    array_output: bool = False
    k_b_input: bool = False
    targets: tuple[str, ...] = ()  # platforms of --native; default all
    listeners: tuple[str, ...] = ()  # StiffnessTracker, GapMonitor
    nodes: tuple[int, ...] = ()  # that they read, default the driven one
    tracker_network: Path | None = None  # default the shipped one where it knows the rig


def build_fmus(request: BuildRequest) -> None:
    """Build RotorRig.fmu of a rig, its estimator where there is a network, tracker and monitor if asked for.

    Raises UserError where the shipped rig is to be trained, or an array is asked for that no FMU would have.
    """
    check_native(request.native, request.array_output, request.targets)
    rig = load_rig(request.rig)
    if is_shipped(rig) and request.train:
        raise UserError(f"--train: the rig {SHIPPED_RIG} has its network already; rigtwin train makes another one")
    if request.train:
        _trained(request.rig, request.out)
    else:
        for path in build_fmu(rig, request.out, k_b_input=request.k_b_input):
            say(str(path))
    if not request.train and not is_shipped(rig):
        note(_without_estimator(rig))
    if request.native:
        array, as_input = request.array_output, request.k_b_input
        compiled = build_compiled(rig, request.out, array_output=array, k_b_input=as_input, targets=request.targets)
        for path in compiled:
            say(str(path))
    if request.listeners:
        native = request.targets if request.native else None
        network = existing(request.tracker_network) if request.tracker_network else None
        for path in build_listeners(request.listeners, rig, request.out, request.nodes, native=native, network=network):
            say(str(path))


def _without_estimator(rig: Rig) -> str:
    """Why there is no estimator FMU of a rig, and what there is instead."""
    if rig.has_tables:
        return f"{ESTIMATOR_FMU} is not built: {rig.name} has supports with tables, and k_b says nothing about them"
    return (
        f"{ESTIMATOR_FMU} is not built: the shipped network knows the rig {SHIPPED_RIG} only; "
        f"rigtwin estimate --rig finds k_b of {rig.name} on its model, and --train trains one for {rig.name} (a "
        "quarter of an hour or so)"
    )


def _trained(source: str, out: Path) -> None:
    from rigtwin.commands.training import TrainingPlan, train

    result = train(TrainingPlan(rig=source, out=out / "training"))
    for path in (result.rotor_fmu, result.estimator_fmu):
        with replacing(out / path.name) as beside:
            shutil.copy(path, beside)
        say(str(out / path.name))
