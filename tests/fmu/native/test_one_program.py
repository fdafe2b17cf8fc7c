"""Both FMUs as sources in one program, as a controller or a test bench without shared libraries holds them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from numpy.testing import assert_allclose

H, STEPS = 1e-3, 40
HERE = Path(__file__).parent
STRICT = ("-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror")


def compiled(fmu: Path, folder: Path, fmi: str) -> list[Path]:
    """Object files of an FMU's sources, with the prefix that FMI's headers give its functions."""
    shutil.unpack_archive(fmu, folder, format="zip")
    sources = folder / "sources"
    prefix = f"-DFMI{fmi}_FUNCTION_PREFIX={fmu.stem}_"
    subprocess.run(["cc", *STRICT, prefix, "-c", *[p.name for p in sources.glob("*.c")]], cwd=sources, check=True)
    return sorted(sources.glob("*.o"))


def global_names(objects: list[Path]) -> list[str]:
    """What the object files define for the linker."""
    said = subprocess.run(
        ["nm", "--defined-only", "--extern-only", "--format=posix", *objects],
        capture_output=True,
        text=True,
        check=True,
    )
    return [line.split()[0] for line in said.stdout.splitlines() if " " in line]


@pytest.fixture(params=["2", "3"])
def both(request, tmp_path) -> tuple[str, Path, Path, list[Path], list[Path]]:
    """Version of FMI, both FMUs, and their object files."""
    names = ("rotor_fmu", "estimator_fmu") if request.param == "2" else ("rotor3", "estimator3")
    fmus = [request.getfixturevalue(name) for name in names]
    objects = [compiled(fmu, tmp_path / fmu.stem, request.param) for fmu in fmus]
    return request.param, *fmus, *objects


def test_both_run_side_by_side_in_one_program(both, tmp_path):
    fmi, rotor, estimator, *objects = both
    program, sources = tmp_path / "one_program", tmp_path / "RotorRig" / "sources"
    command = ["cc", *STRICT, f"-DFMI={fmi}", f"-isystem{sources}", HERE / "one_program.c"]
    subprocess.run([*command, *objects[0], *objects[1], "-o", program, "-lm"], check=True)
    descriptions = [read_model_description(str(fmu)) for fmu in (rotor, estimator)]
    first, second = ({v.name: v.valueReference for v in d.modelVariables} for d in descriptions)
    out = "node_2.acceleration_y"
    references = [first[out], first["force_amplitude"], first["force_frequency"], second["delta_f1"], second["k_b"]]
    arguments = [*(d.guid for d in descriptions), *references, H, STEPS]
    said = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=True).stdout
    found = np.array([line.split() for line in said.splitlines()], dtype=float)
    driven = {"force_amplitude": 1.0, "force_frequency": 60.0}
    alone = simulate_fmu(
        str(rotor), stop_time=H * STEPS, step_size=H, output_interval=H, start_values=driven, output=[out]
    )
    assert len(found) == STEPS
    assert np.abs(found[:, 0]).max() > 1e-2
    assert_allclose(found[:, 0], alone[out][1:], rtol=0, atol=1e-9 * np.abs(alone[out]).max())
    for k in (0, STEPS - 1):
        shift = {"delta_f1": 3 + 0.01 * k}
        expected = simulate_fmu(str(estimator), stop_time=1.0, start_values=shift, output=["k_b"])["k_b"][-1]
        assert found[k, 1] == pytest.approx(expected, rel=1e-6)
    assert len(set(found[:, 1])) == STEPS, "the estimate follows its input"


def test_every_name_that_an_fmu_shows_the_linker_begins_with_its_own(both):
    _, *_, rotor, estimator = both
    for name, objects in (("RotorRig_", rotor), ("StiffnessEstimator_", estimator)):
        shown = global_names(objects)
        assert len(shown) > 30
        assert [one for one in shown if not one.startswith(name)] == []


@pytest.mark.parametrize("name", ["rotor_fmu", "estimator_fmu", "rotor3", "estimator3"])
def test_a_shared_library_shows_the_functions_of_fmi_and_nothing_else(name, request, tmp_path):
    fmu = request.getfixturevalue(name)
    shutil.unpack_archive(fmu, tmp_path / "unpacked", format="zip")
    (library,) = (tmp_path / "unpacked" / "binaries").rglob("*.so")
    said = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    shown = {line.split()[-1] for line in said.splitlines()}
    assert len(shown) > 30
    assert {one for one in shown if not one.startswith(("fmi2", "fmi3"))} <= {"_init", "_fini"}
