"""The self-contained FMUs in hosts that are not Python, and wired to each other."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from numpy.testing import assert_allclose

from rigtwin.api.checks import Expectation, run_gates
from rigtwin.fmu_src.ssp import write_ssp
from rigtwin.sim.session import FmuSession

H, N_STEPS = 1e-3, 50
STOP = H * N_STEPS


def without_binaries(fmu: Path, folder: Path) -> Path:
    """A copy that holds the sources alone."""
    copy = folder / fmu.name
    with zipfile.ZipFile(fmu) as whole, zipfile.ZipFile(copy, "w", zipfile.ZIP_DEFLATED) as rest:
        for name in whole.namelist():
            if not name.startswith("binaries/"):
                rest.writestr(name, whole.read(name))
    return copy


def test_fmpy_compiles_its_sources(any_fmu, tmp_path):
    """With all warnings on there are none, and what comes out answers as the binary that was taken away."""
    own = without_binaries(any_fmu, tmp_path)
    command = [Path(sys.executable).with_name("fmpy"), "compile", own, "--all-warnings"]
    with_cmake = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    finished = subprocess.run(command, capture_output=True, text=True, check=False, env=with_cmake)
    said = finished.stdout + finished.stderr
    assert finished.returncode == 0, said
    assert "warning" not in said, said
    rotor = any_fmu.stem == "RotorRig"
    name = "node_2.acceleration_y" if rotor else "k_b"
    start = {"force_amplitude": 1.0, "force_frequency": 60.0} if rotor else {}
    assert_allclose(fmpy_says(own, name, start), fmpy_says(any_fmu, name, start), rtol=1e-9, atol=1e-12)


def test_every_gate_of_the_check_passes(any_fmu):
    assert {gate.name: gate.outcome for gate in run_gates(any_fmu, None, 600) if gate.outcome != "passed"} == {}


def test_the_check_gets_k_b_back_through_fmi_3(rotor3, estimator3):
    gate = run_gates(rotor3, Expectation(3e6, 0.01, estimator3), 600)[-1]
    assert "gives back k_b" in gate.name
    assert gate.outcome == "passed", gate.message


def ecos(path: Path, folder: Path, *options: str) -> dict[str, np.ndarray]:
    """What the ecos command, a native importer, logs of an FMU or an SSP: columns by name."""
    spec = find_spec("ecospy")
    assert spec is not None
    assert spec.submodule_search_locations
    binaries = Path(spec.submodule_search_locations[0]) / "binaries"
    for name in ("ecos", "proxyfmu"):
        (binaries / name).chmod(0o755)
    command = [binaries / "ecos", "simulate", "--path", path, "--stopTime", str(STOP), "--stepSize", str(H)]
    command += options
    finished = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    (table,) = folder.glob("*.csv")
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    return {name.split("[")[0].strip(): np.array([row[name] for row in rows]) for name in rows[0]}


def floats(column: np.ndarray) -> np.ndarray:
    return column.astype(float)


def fmpy_says(fmu: Path, name: str, values: dict | None = None) -> np.ndarray:
    options = {"stop_time": STOP, "step_size": H, "output_interval": H, "start_values": values or {}}
    return simulate_fmu(str(fmu), output=[name], **options)[name]


def test_the_ecos_command_runs_the_estimator(estimator_fmu, estimator3, tmp_path):
    for version, fmu in enumerate((estimator_fmu, estimator3)):
        folder = tmp_path / str(version)
        folder.mkdir()
        found = floats(ecos(fmu, folder)["instance::k_b"])
        assert len(found) >= N_STEPS
        assert_allclose(found[-1], fmpy_says(fmu, "k_b")[-1], rtol=1e-6)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_ecos_command_runs_them_wired_together(tmp_path, rotor_fmu, estimator_fmu, rotor3, estimator3, fmi):
    """One rotor's sine drives the other: all that each rotor gives is what fmpy says, one step after the other."""
    rotor, estimator = (rotor_fmu, estimator_fmu) if fmi == "2.0" else (rotor3, estimator3)
    starts = {"rigid": {"force_amplitude": 1.0, "force_frequency": 60.0}}
    ssp = write_ssp(rotor, estimator, tmp_path / "wired.ssp", closed=True, starts=starts)
    columns = ecos(ssp, tmp_path, "--parameterSet", "support")
    names = [v.name for v in read_model_description(str(rotor)).modelVariables if "acceleration_" in v.name]
    names.append("force_applied")
    alone = simulate_fmu(
        str(rotor), stop_time=STOP, step_size=H, output_interval=H, output=names,
        start_values={**starts["rigid"], "rigid_support": True},
    )  # fmt: skip
    for name in names:
        found = floats(columns[f"rigid::{name}"])
        assert len(found) >= N_STEPS
        assert_allclose(found, alone[name][: len(found)], rtol=0, atol=2e-6, err_msg=name)  # its log has six decimals
    moving = [np.abs(alone[name]).max() for name in names]
    assert np.count_nonzero(np.array(moving) > 1e-3) == 6, "five nodes in y and the force"
    rigid, bearing = (floats(columns[f"{rig}::node_2.acceleration_y"]) for rig in ("rigid", "bearing"))
    assert np.abs(bearing).max() > 0.1 * np.abs(rigid).max()
    assert np.abs(bearing - rigid).max() > 0.01 * np.abs(rigid).max()
    assert floats(columns["estimator::k_b"])[-1] == pytest.approx(fmpy_says(estimator, "k_b")[-1], rel=1e-6)


def in_libcosim(rotor_fmu: Path, estimator_fmu: Path) -> list[float]:
    """node_2 of a rotor with a sine, the force on the rotor that it drives, and k_b, by libcosim."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    reference = {v.name: v.valueReference for v in read_model_description(str(rotor_fmu)).modelVariables}
    execution = CosimExecution.from_step_size(step_size=int(H * 1e9))
    slaves = [
        execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name=name))
        for name, fmu in (("first", rotor_fmu), ("second", rotor_fmu), ("estimator", estimator_fmu))
    ]
    observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
    execution.add_observer(observer)
    execution.add_manipulator(manipulator)
    execution.connect_real_variables(slaves[0], reference["force_applied"], slaves[1], reference["force"])
    manipulator.slave_real_values(
        slave_index=slaves[0],
        variable_references=[reference["force_amplitude"], reference["force_frequency"]],
        values=[1.0, 60.0],
    )
    execution.simulate_until(target_time=int(STOP * 1e9))
    names = ["node_2.acceleration_y", "force_applied"]
    found = [
        observer.last_real_values(slave_index=slaves[k], variable_references=[reference[names[k]]])[0] for k in (0, 1)
    ]
    k_b = {v.name: v.valueReference for v in read_model_description(str(estimator_fmu)).modelVariables}["k_b"]
    return [*found, observer.last_real_values(slave_index=slaves[2], variable_references=[k_b])[0]]


def as_applied(rotor_fmu: Path, samples: np.ndarray) -> float:
    """The force on a rotor after it was given these samples, one before each step."""
    with FmuSession(rotor_fmu) as session:
        session.start({"force": float(samples[0])})
        for sample in samples:
            session.set({"force": float(sample)})
            session.step(H)
        return session.get(["force_applied"])[0]


def test_libcosim_runs_them_wired_together(rotor_fmu, estimator_fmu):
    acceleration, force, k_b = in_libcosim(rotor_fmu, estimator_fmu)
    driven = {"force_amplitude": 1.0, "force_frequency": 60.0}
    assert_allclose(acceleration, fmpy_says(rotor_fmu, "node_2.acceleration_y", driven)[-1], rtol=1e-9)
    carried = np.sin(2 * np.pi * 60.0 * H * np.arange(N_STEPS))  # a connection carries what was there a step ago
    expected = as_applied(rotor_fmu, carried)
    assert force == pytest.approx(expected, abs=1e-6)
    assert abs(force - carried[-1]) < 0.4
    assert k_b == pytest.approx(fmpy_says(estimator_fmu, "k_b")[-1], rel=1e-12)


@pytest.fixture(scope="module")
def container(rotor_fmu, estimator_fmu, tmp_path_factory) -> Path:
    """One FMU that holds both."""
    folder = tmp_path_factory.mktemp("container")
    for fmu in (rotor_fmu, estimator_fmu):
        shutil.copy(fmu, folder)
    plan = {
        "name": "StiffnessTest.fmu", "fmu": [rotor_fmu.name, estimator_fmu.name], "step_size": H,
        "output": [[rotor_fmu.name, "node_2.acceleration_y", "node_2"], [estimator_fmu.name, "k_b", "k_b"]],
        "auto_input": True, "auto_output": True, "auto_link": False, "auto_parameter": True,
    }  # fmt: skip
    (folder / "plan.json").write_text(json.dumps(plan))
    command = [Path(sys.executable).with_name("fmucontainer"), "-container", "plan.json", "-fmu-directory", folder]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "StiffnessTest.fmu"


def test_both_fit_into_one_container_fmu(container, rotor_fmu, estimator_fmu):
    assert validate_fmu(str(container)) == []
    driven = {"force_amplitude": 1.0, "force_frequency": 60.0, "k_b": 5e6}
    found = simulate_fmu(
        str(container), stop_time=STOP, step_size=H, output_interval=H, output=["node_2", "k_b_low"],
        input=np.array([(0.0, 1.0, 60.0), (STOP, 1.0, 60.0)],
                       dtype=[("time", float), ("force_amplitude", float), ("force_frequency", float)]),
    )  # fmt: skip
    del driven["k_b"]
    expected = fmpy_says(rotor_fmu, "node_2.acceleration_y", driven)
    assert_allclose(found["node_2"][-1], expected[-1], rtol=1e-6)
    assert found["k_b_low"][-1] == pytest.approx(fmpy_says(estimator_fmu, "k_b_low")[-1], rel=1e-9)


def test_the_ecos_command_runs_the_container(container, tmp_path):
    columns = ecos(container, tmp_path)
    assert floats(columns["instance::k_b"])[-1] > 1e6
