"""The same sources give the same file; other content gives another GUID."""

from __future__ import annotations

import ast
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from rigtwin.fmu_src import build, staging
from rigtwin.fmu_src.documentation import rotor_pages
from rigtwin.fmu_src.staging import Bundle
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from tests.fmu.child import in_child


def guid(fmu: Path) -> str:
    with zipfile.ZipFile(fmu) as archive:
        return ElementTree.fromstring(archive.read("modelDescription.xml")).attrib["guid"]


def build_both(folder: str) -> list[str]:
    from pathlib import Path

    from rigtwin.fmu_src.build import build_estimator_fmu, build_rotor_fmu
    from rigtwin.rotor.geometry.rig import load_rig

    return [str(build_rotor_fmu(load_rig("nit-rourkela"), Path(folder))), str(build_estimator_fmu(Path(folder)))]


def test_a_build_is_reproducible_byte_for_byte(rotor_fmu, estimator_fmu, tmp_path):
    """In another process, with another hash seed, from another working directory."""
    again = in_child(build_both, tmp_path / "again", PYTHONHASHSEED="7", TZ="Asia/Kolkata")
    for path, first in zip(again, (rotor_fmu, estimator_fmu), strict=True):
        assert Path(path).read_bytes() == first.read_bytes()


def test_another_rig_gives_another_guid(rotor_fmu, larger_disks_fmu):
    assert guid(rotor_fmu) != guid(larger_disks_fmu)


def test_another_description_has_another_guid(monkeypatch, tmp_path):
    staged = []
    monkeypatch.setattr(build, "_build", lambda bundle, *rest: staged.append(bundle))
    rig = load_rig("nit-rourkela")
    for k_b_input in (False, True):
        build.build_rotor_fmu(rig, tmp_path, k_b_input=k_b_input)
    for nodes in ((2,), (3, 4)):
        build.build_listener_fmu(build.MONITOR, rig, tmp_path, nodes)
    assert len({bundle.guid for bundle in staged}) == 4


def test_rotor_and_estimator_have_different_guids(rotor_fmu, estimator_fmu):
    assert guid(rotor_fmu) != guid(estimator_fmu)


@pytest.fixture
def bundle_of(monkeypatch, tmp_path) -> Callable[[str], Bundle]:
    """What the build functions put together for an FMU, without building it."""
    staged = []
    monkeypatch.setattr(build, "_build", lambda bundle, *rest: staged.append(bundle))

    def bundle(name: str) -> Bundle:
        if name == "rotor_fmu":
            build.build_rotor_fmu(load_rig("nit-rourkela"), tmp_path)
        else:
            build.build_estimator_fmu(tmp_path)
        return staged.pop()

    return bundle


@pytest.mark.parametrize("name", ["rotor_fmu", "estimator_fmu"])
def test_the_guid_is_derived_from_the_bundle(bundle_of, name, request):
    assert f"{bundle_of(name).guid}" == guid(request.getfixturevalue(name))


@pytest.mark.parametrize("name", ["rotor_fmu", "estimator_fmu"])
def test_a_change_of_any_bundled_source_changes_the_guid(bundle_of, name, monkeypatch):
    bundle = bundle_of(name)
    guids = {bundle.guid}
    source = staging._source
    for changed in (bundle.script, *bundle.modules):
        monkeypatch.setattr(staging, "_source", lambda m, c=changed: source(m) + ("\n# changed" if m == c else ""))
        guids.add(bundle.guid)
    assert len(guids) == 1 + 1 + len(bundle.modules)


@pytest.mark.parametrize("name", ["rotor_fmu", "estimator_fmu"])
def test_a_change_of_any_bundled_data_changes_the_guid(bundle_of, name):
    bundle = bundle_of(name)
    assert bundle.data
    guids = {replace(bundle, data={**bundle.data, file: bundle.data[file] + b"\0"}).guid for file in bundle.data}
    assert len(guids | {bundle.guid}) == 1 + len(bundle.data)


def test_a_finer_mesh_gives_another_guid(rotor_fmu, monkeypatch, tmp_path):
    staged = []
    monkeypatch.setattr(build, "_build", lambda bundle, *rest: staged.append(bundle))
    build.build_rotor_fmu(load_rig("nit-rourkela"), tmp_path, elements_between_nodes=2)
    assert f"{staged[0].guid}" != guid(rotor_fmu)


NEEDED_ON_THE_TARGET = {"rotor_fmu": {"numpy", "scipy"}, "estimator_fmu": {"numpy", "onnxruntime"}}


def imported_packages(source: str) -> set[str]:
    """First names of all absolute imports; those of an ``if TYPE_CHECKING`` count too."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(str(node.module).split(".")[0])
    return found


@pytest.mark.parametrize("name", ["rotor_fmu", "estimator_fmu"])
def test_bundled_sources_import_only_each_other_and_what_the_target_has(name, request):
    """Every bundled package carries a hash: no plain ``rotor``, ``fmu_src``, ``estimator`` or ``pythonfmu``."""
    with zipfile.ZipFile(request.getfixturevalue(name)) as archive:
        sources = {n: archive.read(n).decode() for n in archive.namelist() if n.endswith(".py")}
    own = {path.split("/")[1].removesuffix(".py") for path in sources}
    digest = {package.rsplit("_", 1)[1] for package in own}
    assert len(digest) == 1
    used = set().union(*(imported_packages(source) for source in sources.values()))
    assert used - set(sys.stdlib_module_names) - own <= NEEDED_ON_THE_TARGET[name]


def test_a_failed_build_leaves_the_older_file_as_it_was(monkeypatch, tmp_path):
    older = tmp_path / build.ROTOR_FMU
    older.write_bytes(b"older")
    monkeypatch.setattr(build, "validate_fmu", lambda path: ["something is wrong"])
    with pytest.raises(build.BuildError, match=r"RotorRig\.fmu is not a valid FMU: something is wrong"):
        build.build_rotor_fmu(load_rig("nit-rourkela"), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == [build.ROTOR_FMU]
    assert older.read_bytes() == b"older"


def test_the_matrices_in_the_fmu_are_those_of_the_rig(rotor_fmu, structure, tmp_path):
    with zipfile.ZipFile(rotor_fmu) as archive:
        archive.extract("resources/structure.npz", tmp_path)
    with np.load(tmp_path / "resources/structure.npz") as arrays:
        for name in ("M", "K", "G", "x", "support_stiffness"):
            np.testing.assert_array_equal(arrays[name], getattr(structure, name))


@pytest.mark.parametrize("node", [1, 2])
def test_a_shaft_on_one_bearing_has_its_pages(node):
    """It swings about the bearing at no frequency; the page names the first one above."""
    rig = load_rig("nit-rourkela")
    one = rig.model_copy(update={"support": [rig.support[0].model_copy(update={"node": node})]})
    page = rotor_pages(one, build.rotor_facts(one, assemble(one)))["documentation/index.html"].decode()
    first = elastic_frequencies_hz(build_system(assemble(one), Condition(k_b=1e7)), plane=1)[0]
    assert first > 50
    assert f"{first:.1f} Hz" in page


def test_of_another_rig_no_estimator_is_built(tmp_path, capsys):
    """Its network would answer, and be wrong."""
    own = Path(__file__).resolve().parents[2] / "examples" / "own_rotor.toml"
    assert build.main([str(own), "--out", str(tmp_path)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == [build.ROTOR_FMU]
    assert "its network knows the rig nit-rourkela only" in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_is_one_message(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert build.main(["--out", str(tmp_path / "file")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
