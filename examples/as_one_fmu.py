"""Pack the rotor and the estimator into one FMU with the FMU Manipulation Toolbox, and run it with fmpy.

    python examples/as_one_fmu.py

The example needs `pip install fmu-manipulation-toolbox` and a C compiler or `pip install ziglang`.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from rigtwin.fmu_src.build import build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.geometry.rig import load_rig

STOP, STEP = 2.0, 1e-3  # [s]
MEASURED = {"delta_f1": 25.0, "delta_f2": 130.0, "amplitude_ratio": 0.78}
ERRORS = {"delta_f1_std": 2.1, "delta_f2_std": 4.2, "amplitude_ratio_std": 0.08}
SINE = {"force_amplitude": 1.0, "force_frequency": 60.0}


def pack(folder: Path) -> Path:
    """Build both FMUs into a folder and pack them into one, which has the inputs and outputs of both."""
    build_native_rotor_fmu(load_rig("nit-rourkela"), folder, targets=[this_machine()])
    build_native_estimator_fmu(folder, targets=[this_machine()])
    plan = {
        "name": "StiffnessTest.fmu",
        "fmu": ["RotorRig.fmu", "StiffnessEstimator.fmu"],
        "step_size": STEP,
        "output": [["RotorRig.fmu", "node_2.acceleration_y", "node_2"], ["StiffnessEstimator.fmu", "k_b", "k_b"]],
        "auto_input": True,
        "auto_output": True,
        "auto_parameter": True,
        "auto_link": False,
    }
    (folder / "plan.json").write_text(json.dumps(plan), encoding="utf-8")
    tool = shutil.which("fmucontainer", path=Path(sys.executable).parent) or shutil.which("fmucontainer")
    if tool is None:
        raise SystemExit("fmucontainer is missing: pip install fmu-manipulation-toolbox")
    subprocess.run([tool, "-container", "plan.json", "-fmu-directory", folder], check=True)
    return folder / "StiffnessTest.fmu"


def main() -> None:
    """Pack the FMUs, validate the result, run it, and read k_b."""
    inputs = MEASURED | ERRORS | SINE
    held = np.array([(t, *inputs.values()) for t in (0.0, STOP)], dtype=[(name, float) for name in ("time", *inputs)])
    with tempfile.TemporaryDirectory() as name:
        fmu = pack(Path(name))
        assert validate_fmu(str(fmu)) == []
        result = simulate_fmu(str(fmu), stop_time=STOP, step_size=STEP, output=["node_2", "k_b"], input=held)
    k_b = result["k_b"][-1]
    print(f"node 2 at 60 Hz: {np.abs(result['node_2']).max():.2f} m/s2 at most")
    print(f"the paper's measured shifts and ratio: k_b = {k_b / 1e6:.3f} MN/m")
    assert np.isclose(k_b, 1.112e6, rtol=0.01)


if __name__ == "__main__":
    main()
