"""Both FMUs as one system."""

from __future__ import annotations

import zipfile

import pytest
from fmpy.ssp.ssd import read_ssd

from examples import ssp_hammer_test
from rigtwin.fmu_src.ssp import Component, Link, write_ssp, write_system


@pytest.fixture(scope="module")
def ssp(rotor_fmu, estimator_fmu, tmp_path_factory):
    return write_ssp(rotor_fmu, estimator_fmu, tmp_path_factory.mktemp("ssp") / "StiffnessTest.ssp")


def test_the_system_description_follows_the_ssp_schema(ssp):
    system = read_ssd(str(ssp)).system  # validates against the schema
    assert [component.name for component in system.elements] == ["rigid", "bearing", "estimator"]


def test_the_system_carries_its_fmus(ssp, rotor_fmu):
    with zipfile.ZipFile(ssp) as archive:
        assert archive.read("resources/RotorRig.fmu") == rotor_fmu.read_bytes()


@pytest.mark.parametrize(
    ("link", "words"),
    [
        (Link("second", "force_applied", "first", "force"), "second, which is no component"),
        (Link("first", "force_aplied", None, "force"), "first has no variable force_aplied"),
        (Link(None, "force", "third", "force"), "third, which is no component"),
    ],
)
def test_a_link_to_nothing_is_refused_and_nothing_is_written(rotor_fmu, tmp_path, link, words):
    with pytest.raises(ValueError, match=words):
        write_system("system", [Component("first", rotor_fmu)], [link], tmp_path / "system.ssp")
    assert not list(tmp_path.iterdir())


def test_two_fmus_of_one_file_name_are_refused(rotor_fmu, tmp_path):
    other = tmp_path / rotor_fmu.name
    other.write_bytes(rotor_fmu.read_bytes())
    components = [Component("first", rotor_fmu), Component("second", other)]
    with pytest.raises(ValueError, match="the same file name"):
        write_system("system", components, [], tmp_path / "system.ssp")
    assert not (tmp_path / "system.ssp").exists()


@pytest.mark.long
def test_a_hammer_blow_on_both_rotors_brings_k_b_out_of_the_estimator(ssp):
    assert ssp_hammer_test.measure(ssp) == pytest.approx(ssp_hammer_test.TRUE_K_B, rel=5e-3)
