"""The self-contained FMUs in hosts that are not Python, and wired to each other."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
from numpy.testing import assert_allclose

from rigtwin.api.checks import Expectation, run_gates
from tests.fmu.native.hosts import HOSTS, Plan, build, difference, pack

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


def fmpy_says(fmu: Path, name: str, values: dict | None = None) -> np.ndarray:
    options = {"stop_time": STOP, "step_size": H, "output_interval": H, "start_values": values or {}}
    return simulate_fmu(str(fmu), output=[name], **options)[name]


@pytest.fixture(scope="module")
def system(request, tmp_path_factory) -> Plan:
    """All FMUs, wired together."""
    return build(tmp_path_factory.mktemp("hosts"), request.param)


@pytest.mark.parametrize(
    ("system", "host"),
    [(fmi, name) for fmi in ("2.0", "3.0") for name, host in HOSTS.items() if fmi in host.versions],
    indirect=["system"],
)
def test_a_host_gives_what_fmpy_gives(system, host):
    """Of the ecos command to the six decimals of its log."""
    relative, single, decades = difference(system, HOSTS[host])
    assert single < 2 * float(np.finfo(np.float32).eps)
    assert relative < 1e-9
    assert decades < 1e-5


@pytest.mark.parametrize("system", ["2.0"], indirect=True)
def test_the_container_is_a_valid_fmu(system, tmp_path):
    assert validate_fmu(str(pack(system, tmp_path))) == []
