"""Both FMUs as one system."""

from __future__ import annotations

import zipfile

import pytest
from fmpy.ssp.ssd import read_ssd

from examples import ssp_hammer_test
from rigtwin.fmu_src.ssp import write_ssp


@pytest.fixture(scope="module")
def ssp(rotor_fmu, estimator_fmu, tmp_path_factory):
    return write_ssp(rotor_fmu, estimator_fmu, tmp_path_factory.mktemp("ssp") / "StiffnessTest.ssp")


def test_the_system_description_follows_the_ssp_schema(ssp):
    system = read_ssd(str(ssp)).system  # validates against the schema
    assert [component.name for component in system.elements] == ["rigid", "bearing", "estimator"]


def test_the_system_carries_its_fmus(ssp, rotor_fmu):
    with zipfile.ZipFile(ssp) as archive:
        assert archive.read("resources/RotorRig.fmu") == rotor_fmu.read_bytes()


@pytest.mark.long
def test_a_hammer_blow_on_both_rotors_brings_k_b_out_of_the_estimator(ssp):
    assert ssp_hammer_test.measure(ssp) == pytest.approx(ssp_hammer_test.TRUE_K_B, rel=5e-3)
