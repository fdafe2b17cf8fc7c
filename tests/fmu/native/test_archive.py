"""What lies in a compiled FMU beside its model, and that the same rig gives the same bytes."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest
from fmpy import read_model_description
from lxml import etree

from rigtwin.fmu_src.build import build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.geometry.rig import load_rig

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"


@pytest.mark.long
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_same_rig_gives_the_same_bytes(tmp_path, monkeypatch, fmi):
    """Compiled twice, each time without what an earlier build has kept."""
    builds = []
    for turn in ("first", "second"):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / turn / "cache"))
        options = {"fmi": fmi, "targets": [this_machine()]}
        rotor = build_native_rotor_fmu(load_rig("nit-rourkela"), tmp_path / turn, **options)
        builds.append([rotor.read_bytes(), build_native_estimator_fmu(tmp_path / turn, **options).read_bytes()])
    assert builds[0] == builds[1]


def test_terminals_carry_the_force_and_the_accelerometers(rotor3):
    with zipfile.ZipFile(rotor3) as archive:
        content = archive.read("terminalsAndIcons/terminalsAndIcons.xml")
        assert archive.read("terminalsAndIcons/icon.png").startswith(b"\x89PNG")
    etree.XMLSchema(etree.parse(str(SCHEMA))).assertValid(etree.fromstring(content))
    terminals = {t.get("name"): t for t in ElementTree.fromstring(content).iter("Terminal")}
    assert list(terminals) == ["exciter", *(f"node_{n}" for n in range(1, 8))]
    members = [m.get("variableName") for t in terminals.values() for m in t]
    known = {v.name for v in read_model_description(str(rotor3)).modelVariables}
    assert len(members) == 16
    assert set(members) <= known


def test_the_estimator_has_an_icon(estimator3):
    with zipfile.ZipFile(estimator3) as archive:
        content = archive.read("terminalsAndIcons/terminalsAndIcons.xml")
        assert archive.read("terminalsAndIcons/icon.png").startswith(b"\x89PNG")
    etree.XMLSchema(etree.parse(str(SCHEMA))).assertValid(etree.fromstring(content))


@pytest.mark.parametrize("name", ["rotor3", "estimator3"])
def test_fmi_3_has_the_same_papers(request, name):
    with zipfile.ZipFile(request.getfixturevalue(name)) as archive:
        names = set(archive.namelist())
        needs = archive.read("documentation/externalDependencies.txt").decode()
        headers = archive.read("documentation/licenses/fmi-headers.txt").decode()
    assert {"documentation/licenses/license.txt", "extra/rigtwin/metadata.json"} <= names
    assert "nothing else" in needs
    assert 'Modelica Association Project "FMI"' in headers
