"""Whatever a host calls, in whatever order: no memory error, no undefined behaviour, no hang, no leak."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from fmpy import read_model_description

from tests.fmu.native.sanitizers import program, run

SEQUENCES = {"RotorRig": 200, "StiffnessEstimator": 3000}


LONGER = (pytest.param(name, marks=pytest.mark.long) for name in ("rotor_fmu", "estimator_fmu", "estimator3"))


@pytest.mark.parametrize("name", ["rotor3", *LONGER])
def test_random_calls_find_nothing_that_the_sanitizers_object_to(name, request, tmp_path):
    fmu = request.getfixturevalue(name)
    fmi = read_model_description(str(fmu), validate=False).fmiVersion
    answer = run(program(fmu, fmi, tmp_path), 1, SEQUENCES[fmu.stem])
    assert int(answer.split()[0]) > 10 * SEQUENCES[fmu.stem]  # refusals that came with a sentence


@pytest.mark.long
def test_the_sanitizers_would_have_seen_a_mistake(estimator_fmu, tmp_path):
    """Negative control: the estimator, reading one feature more than it has."""
    folder = tmp_path / "unpacked"
    program(estimator_fmu, "2.0", folder)
    source = folder / "sources" / "estimator_model.c"
    source.write_text(source.read_text().replace("k < N_FEATURES", "k <= N_FEATURES + 60"))
    repacked = tmp_path / "broken.zip"
    shutil.make_archive(str(repacked.with_suffix("")), "zip", folder, "sources")
    with pytest.raises(subprocess.CalledProcessError):
        run(program(repacked, "2.0", tmp_path / "broken"), 1, 100)
