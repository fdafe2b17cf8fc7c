"""Build the FMUs: ``python build_fmu.py`` writes both into ``dist/``.

Stage the sources, let pythonfmu build, complete the archive (picture, documentation, names that
cannot clash), validate, and only then put the file in place.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import numpy as np
from fmpy.validation import validate_fmu

from fmu_src.documentation import estimator_pages, rotor_pages
from fmu_src.rotor_variables import RotorFacts
from fmu_src.staging import Bundle, hide_pythonfmu, stage
from rotor.assembly import assemble
from rotor.rig import Rig, RigError, load_rig
from rotor.structure import to_arrays

ROTOR_FMU = "RotorRig.fmu"

# What the rotor needs at run time: everything but geometry, meshing and the frequency domain.
_ROTOR_MODULES = (
    *(f"rotor.{name}" for name in ("condition", "design", "drive", "elements", "force_laws", "local_force", "model")),
    *(f"rotor.{name}" for name in ("nonlinear_stepper", "printed_laws", "simulator", "state_space", "stepper")),
    *(f"rotor.{name}" for name in ("structure", "system")),
    *(f"rotor.effects.{name}" for name in ("chain", "effect", "library", "nonlinear", "spinning", "structure")),
    "rotor.effects.supports",
)
ESTIMATOR_FMU = "StiffnessEstimator.fmu"

# A fixed time stamp in the archive: the same sources give the same file, byte for byte.
_ZIP_DATE = (2020, 1, 1, 0, 0, 0)


class BuildError(RuntimeError):
    """pythonfmu failed, or the FMU it made does not pass validation."""


def build_rotor_fmu(rig: Rig, folder: Path, *, elements_between_nodes: int | None = None) -> Path:
    """Build ``RotorRig.fmu`` of a rig.

    Parameters
    ----------
    rig : the rig
    folder : where the FMU goes; made if it is not there
    elements_between_nodes : mesh refinement, default the rig's own

    Returns
    -------
    Path of the FMU. Raises BuildError; an older file is then left as it was.
    """
    structure = assemble(rig, elements_between_nodes=elements_between_nodes)
    facts = RotorFacts(
        n_nodes=structure.n_nodes,
        excitation_node=rig.excitation_node,
        shaft_damping_ratio=rig.shaft_damping_ratio,
        bearing_damping=rig.bearing_damping_Ns_per_m,
        k_b_start=rig.k_b.start_N_per_m,
        k_b_min=rig.k_b.min_N_per_m,
        k_b_max=rig.k_b.max_N_per_m,
        length=rig.length,
    )
    bundle = Bundle(
        script="fmu_src.rotor_slave",
        modules=("fmu_src.slave", "fmu_src.variables", "fmu_src.rotor_variables", *_ROTOR_MODULES),
        data={"structure.npz": _npz(to_arrays(structure)), "rig.json": rig.model_dump_json(indent=1).encode()},
    )
    return _build(bundle, {"facts": asdict(facts), "rig": rig.name}, rotor_pages(rig, facts), folder / ROTOR_FMU)


def build_estimator_fmu(folder: Path, model: Path | None = None) -> Path:
    """Build ``StiffnessEstimator.fmu`` around a trained network, default the shipped one. Raises BuildError."""
    from estimator.runtime import shipped_model

    model = model or shipped_model()
    bundle = Bundle(
        script="fmu_src.estimator_slave",
        modules=("fmu_src.slave", "fmu_src.variables", "fmu_src.estimator_variables", "estimator.runtime"),
        data={"estimator.onnx": model.read_bytes()},
    )
    return _build(bundle, {}, estimator_pages(model), folder / ESTIMATOR_FMU)


def _build(bundle: Bundle, facts: dict, pages: dict[str, bytes], target: Path) -> Path:
    """Stage, build, complete, validate, put in place."""
    target.parent.mkdir(parents=True, exist_ok=True)
    manifest = json.dumps({"guid": str(bundle.guid), "version": version("rigtwin"), **facts}, indent=1)
    with tempfile.TemporaryDirectory(prefix="rigtwin_build_") as scratch:
        stock = _run_pythonfmu(stage(bundle, manifest, _folder(scratch, "stage")), Path(scratch))
        unpacked = Path(scratch) / "fmu"
        with zipfile.ZipFile(stock) as archive:
            archive.extractall(unpacked)
        hide_pythonfmu(unpacked / "resources", bundle)
        for name, content in pages.items():
            page = unpacked / name
            page.parent.mkdir(exist_ok=True)
            page.write_bytes(content)
        complete = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            _zip(unpacked, complete)
            problems = validate_fmu(str(complete))
            if problems:
                raise BuildError(f"{target.name} is not a valid FMU: " + "; ".join(problems))
            os.replace(complete, target)
        finally:
            complete.unlink(missing_ok=True)
    return target


def _run_pythonfmu(script: Path, scratch: Path) -> Path:
    """Build the stock FMU in a process of its own: pythonfmu imports the slave to describe it."""
    project_files = [str(p) for p in script.parent.iterdir() if p != script]
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", str(script), "-d", str(_folder(scratch, "stock"))]
    command += ["--handle-state", "--serialize-state", *project_files]
    finished = subprocess.run(command, capture_output=True, text=True, cwd=scratch, check=False)
    built = list((scratch / "stock").glob("*.fmu"))
    if finished.returncode or len(built) != 1:
        raise BuildError(f"pythonfmu could not build {script.name}:\n{finished.stderr.strip()}")
    return built[0]


def _folder(parent: str | Path, name: str) -> Path:
    path = Path(parent) / name
    path.mkdir()
    return path


def _zip(folder: Path, target: Path) -> None:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts):
            entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), _ZIP_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes())


def _npz(arrays: dict) -> bytes:
    """Arrays as .npz, the same bytes for the same arrays."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.asarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _ZIP_DATE), entry.getvalue())
    return buffer.getvalue()


def main(arguments: list[str] | None = None) -> int:
    """Command line of ``python build_fmu.py``."""
    parser = argparse.ArgumentParser(description="Build RotorRig.fmu and StiffnessEstimator.fmu.")
    parser.add_argument("rig", nargs="?", default="nit-rourkela", help="a shipped rig or the path of a rig TOML")
    parser.add_argument("--out", type=Path, default=Path("dist"), help="folder for the FMUs (default: dist)")
    options = parser.parse_args(arguments)
    try:
        rig = load_rig(options.rig)
    except RigError as error:
        print(error, file=sys.stderr)
        return 2
    for path in (build_rotor_fmu(rig, options.out), build_estimator_fmu(options.out)):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
