"""Two rotors and the estimator in the ecos command, a co-simulation host in C++ with no Python inside.

    python examples/in_ecos.py

One SSP contains the rotor on rigid supports, the rotor on bearings and the estimator. The first rotor
is driven by its own sine, and its force also drives the second rotor. The example needs
`pip install ecospy`, which contains the command, and a C compiler or `pip install ziglang`.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from rigtwin.fmu_src.build import build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.fmu_src.ssp import START_VALUES, write_ssp
from rigtwin.rotor.geometry.rig import load_rig

STOP, STEP = 2.0, 1e-3  # [s]
SINE = {"force_amplitude": 1.0, "force_frequency": 60.0}
K_B = 1.1e6  # [N/m]


def ecos() -> Path:
    """Path of the command that comes with ecospy; it and the program it starts are made executable."""
    spec = find_spec("ecospy")
    if spec is None or not spec.origin:
        raise SystemExit("ecospy is missing: pip install ecospy")
    folder, suffix = Path(spec.origin).parent / "binaries", ".exe" if sys.platform == "win32" else ""
    for program in (folder / f"ecos{suffix}", folder / f"proxyfmu{suffix}"):
        if not os.access(program, os.X_OK):
            program.chmod(0o755)
    return folder / f"ecos{suffix}"


def peak(table: Path, column: str) -> float:
    """Largest absolute value of a column of the command's log."""
    with table.open(newline="", encoding="utf-8") as file:
        rows = csv.DictReader(file, skipinitialspace=True)
        return max(abs(float(value)) for row in rows for name, value in row.items() if name.startswith(column))


def main() -> None:
    """Build the FMUs, connect them, run, and read the results."""
    with tempfile.TemporaryDirectory() as name:
        folder, target = Path(name), [this_machine()]
        rotor = build_native_rotor_fmu(load_rig("nit-rourkela"), folder, targets=target)
        estimator = build_native_estimator_fmu(folder, targets=target)
        starts = {"rigid": SINE, "bearing": {"k_b": K_B}}
        system = write_ssp(rotor, estimator, folder / "wired.ssp", closed=True, starts=starts)
        times = ["--stopTime", str(STOP), "--stepSize", str(STEP)]
        command = [ecos(), "simulate", "--path", system, *times, "--parameterSet", START_VALUES]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        (table,) = folder.glob("*.csv")
        rigid, bearing = (peak(table, f"{rig}::node_2.acceleration_y") for rig in ("rigid", "bearing"))
        k_b = peak(table, "estimator::k_b[")
    print(f"node 2 at 60 Hz: {rigid:.2f} m/s2 on rigid supports, {bearing:.2f} m/s2 on bearings")
    print(f"the estimator, at its start values: k_b = {k_b / 1e6:.3f} MN/m")
    assert 1.5 * rigid < bearing


if __name__ == "__main__":
    main()
