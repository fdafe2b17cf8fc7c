"""``rigtwin build``: the FMUs of a rig."""

from __future__ import annotations

import shutil
from pathlib import Path

from rigtwin.commands.fmus import SHIPPED_RIG, build_rotor, is_shipped
from rigtwin.console import note, say
from rigtwin.exits import UserError
from rigtwin.fmu_src.build import ESTIMATOR_FMU, build_estimator_fmu, build_native
from rigtwin.fmu_src.compiling import CompileError
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.sim.formats.atomic import replacing


def build_fmus(source: str, out: Path, *, train: bool, native: bool, array_output: bool = False) -> None:
    """Build RotorRig.fmu of a rig, and the estimator FMU where there is a network for it.

    Raises UserError where the shipped rig is to be trained, or an array is asked for that no FMU would have.
    """
    if array_output and not native:
        raise UserError("--array-output: only the FMI 3.0 FMU of --native can have an array; add --native")
    rig = load_rig(source)
    if is_shipped(rig) and train:
        raise UserError(f"--train: the rig {SHIPPED_RIG} has its network already; rigtwin train makes another one")
    if is_shipped(rig):
        say(str(build_rotor(rig, out)))
        say(str(build_estimator_fmu(out)))
    elif train:
        _trained(source, out)
    else:
        say(str(build_rotor(rig, out)))
        note(
            f"{ESTIMATOR_FMU} is not built: the shipped network knows the rig {SHIPPED_RIG} only; "
            f"--train trains one for {rig.name} (a quarter of an hour or so)"
        )
    if native:
        _build_native(rig, out, array_output)


def _build_native(rig: Rig, out: Path, array_output: bool) -> None:
    try:
        for path in build_native(rig, out, estimator=is_shipped(rig), array_output=array_output):
            say(str(path))
    except CompileError as error:
        raise UserError(str(error)) from error
    except ModuleNotFoundError as error:
        raise UserError(
            f"the network cannot be turned into C without the package {error.name}: pip install onnx"
        ) from error


def _trained(source: str, out: Path) -> None:
    from rigtwin.commands.training import TrainingPlan, train

    result = train(TrainingPlan(rig=source, out=out / "training"))
    for path in (result.rotor_fmu, result.estimator_fmu):
        with replacing(out / path.name) as beside:
            shutil.copy(path, beside)
        say(str(out / path.name))
