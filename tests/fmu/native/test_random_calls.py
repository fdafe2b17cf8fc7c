"""Whatever a host calls, in whatever order: no memory error, no undefined behaviour, no hang, no leak."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from build_fmu import build_native_estimator_fmu, build_native_rotor_fmu
from fmu_src.compiling import this_machine
from rotor.rig import load_rig
from tests.fmu.native.sanitizers import program, run

SEQUENCES = {"RotorRig": 1500, "StiffnessEstimator": 20000}


def built(name, fmi, folder):
    if name == "RotorRig":
        return build_native_rotor_fmu(load_rig("nit-rourkela"), folder, fmi=fmi, targets=[this_machine()])
    return build_native_estimator_fmu(folder, fmi=fmi, targets=[this_machine()])


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("name", SEQUENCES)
def test_random_calls_find_nothing_that_the_sanitizers_object_to(tmp_path, name, fmi):
    made = program(built(name, fmi, tmp_path), fmi, tmp_path / "unpacked")
    answer = run(made, 1, SEQUENCES[name])
    assert int(answer.split()[0]) > 10 * SEQUENCES[name]  # refusals that came with a sentence


def test_the_sanitizers_would_have_seen_a_mistake(tmp_path):
    """Negative control: the estimator, reading one feature more than it has."""
    fmu = built("StiffnessEstimator", "2.0", tmp_path)
    folder = tmp_path / "unpacked"
    program(fmu, "2.0", folder)
    source = folder / "sources" / "estimator_model.c"
    source.write_text(source.read_text().replace("k < N_FEATURES", "k <= N_FEATURES + 60"))
    repacked = tmp_path / "broken.zip"
    shutil.make_archive(str(repacked.with_suffix("")), "zip", folder, "sources")
    with pytest.raises(subprocess.CalledProcessError):
        run(program(repacked, "2.0", tmp_path / "broken"), 1, 100)
