"""The binaries for Windows and ARM, run here: ``python -m tests.fmu.native.elsewhere``.

A host in C makes the same calls of the FMUs on each platform, on Windows by Wine, on ARM by qemu, and their numbers are
compared with this platform's. It needs ziglang, and of Debian wine, wine64, qemu-user and libc6-arm64-cross; in the
tests the host runs on this platform only.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from fmpy import read_model_description

from rigtwin.fmu_src.build import FMI_HEADERS, build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import TARGETS, Target, compiler, this_machine
from rigtwin.rotor.geometry.rig import load_rig

HOST = Path(__file__).with_name("host.c")
H, STEPS = 1e-3, 40
STARTS = {
    "linear": {},
    "pedestal": {"pedestal_flexibility.enabled": 1},
    "clearance": {"bearing_clearance.enabled": 1, "bearing_clearance.preload": 20.0},
    "friction": {"bearing_friction.enabled": 1},
    "cubic, spinning": {"bearing_cubic.enabled": 1, "unbalance.enabled": 1, "spin_speed": 100.0},
}
SINE = {"force_amplitude": 20.0, "force_frequency": 60.0, "shaft_damping_ratio": 0.005}

# Largest difference, of the largest number; the network computes with single precision.
LARGEST = {"RotorRig": 1e-9, "StiffnessEstimator": 1e-6}

# The command that runs a program of another platform.
RUNNERS = {"x86_64-windows": ("wine",), "aarch64-linux": ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu")}


def rotor_script(fmu: Path, starts: dict[str, float]) -> str:
    """From rest, with a save and a way back, and another k_b on the way."""
    description = read_model_description(str(fmu))
    variables = {v.name: v for v in description.modelVariables}

    def put(name: str, value: float) -> str:
        return f"{'boolean' if variables[name].type == 'Boolean' else 'real'} {variables[name].valueReference} {value}"

    outputs = [f"get {v.valueReference}" for v in description.modelVariables if v.causality == "output"]
    steps = [[f"step {k * H!r} {H!r}", *outputs] for k in range(2 * STEPS)]
    first, second = (list(chain.from_iterable(part)) for part in (steps[:STEPS], steps[STEPS:]))
    settings = [put(name, value) for name, value in {**SINE, **starts}.items()]
    again = ["save", *second, "back", *second, put("k_b", 5e6), *outputs]
    return "\n".join([f"instantiate {description.guid}", *settings, "start", *outputs, *first, *again, ""])


def estimator_script(fmu: Path) -> str:
    """The answers at the start values, and at others."""
    description = read_model_description(str(fmu))
    outputs = [
        f"get {v.valueReference}" for v in description.modelVariables if v.causality == "output" and v.type == "Real"
    ]
    lines = [f"instantiate {description.guid}", "start", *outputs]
    for factor in (0.9, 1.1):
        inputs = [v for v in description.modelVariables if v.causality == "input"]
        lines += [f"real {v.valueReference} {factor * float(v.start)!r}" for v in inputs] + outputs
    return "\n".join([*lines, ""])


def run(fmu: Path, target: Target, script: str, folder: Path) -> list[float]:
    """What the host gets from an FMU's binary for a platform."""
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / ("host.exe" if "windows" in target.fmi3 else "host")
    if not program.exists():
        libraries = ["-ldl"] if "linux" in target.fmi3 else []
        subprocess.run(
            [*compiler(target), "-std=c99", "-O1", f"-isystem{FMI_HEADERS}", HOST, "-o", program, *libraries],
            check=True,
        )
    shutil.unpack_archive(fmu, folder / fmu.stem, format="zip")
    library = folder / fmu.stem / "binaries" / target.folder("2.0") / f"{fmu.stem}{target.suffix}"
    (folder / "script").write_text(script, encoding="ascii")
    runner = () if target == this_machine() else RUNNERS[target.fmi3]
    command = [*runner, program, library, folder / "script"]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    if finished.returncode:
        raise RuntimeError(f"{target.fmi3}: {finished.stderr.strip()}")
    return [float(line) for line in finished.stdout.split()]


def difference(first: Sequence[float], second: Sequence[float]) -> float:
    """Largest difference, of the largest number."""
    if len(first) != len(second) or not first:
        return math.inf
    return max(abs(a - b) for a, b in zip(first, second, strict=True)) / max(map(abs, first))


def main() -> int:
    """Every platform that can be run here, beside this one."""
    own = this_machine()
    others = [target for target in TARGETS if target.fmi3 in RUNNERS and shutil.which(RUNNERS[target.fmi3][0])]
    if not others:
        print("neither wine nor qemu-aarch64 is here: apt install wine wine64 qemu-user libc6-arm64-cross")
        return 1
    failed = 0
    with tempfile.TemporaryDirectory(prefix="elsewhere_") as name:
        folder = Path(name)
        rotor = build_native_rotor_fmu(load_rig("nit-rourkela"), folder, targets=[own, *others])
        estimator = build_native_estimator_fmu(folder, targets=[own, *others])
        jobs = [(rotor, what, rotor_script(rotor, starts)) for what, starts in STARTS.items()]
        for fmu, what, script in [*jobs, (estimator, "three estimates", estimator_script(estimator))]:
            here = run(fmu, own, script, folder / own.fmi3)
            for target in others:
                there = run(fmu, target, script, folder / target.fmi3)
                found = difference(here, there)
                failed += found > LARGEST[fmu.stem]
                print(f"{fmu.stem}, {what}, {target.fmi3}: {len(there)} numbers, largest difference {found:.1e}")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
