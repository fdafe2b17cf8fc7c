"""What ``--native`` makes: five platforms, sources that compile, the same file from the same sources."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from rigtwin.api import fmus
from rigtwin.api.fmus import manifest
from rigtwin.fmu_src import compiling
from rigtwin.fmu_src.build import build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import TARGETS, CompileError, compiler, targets_named, this_machine
from rigtwin.fmu_src.native_sources import NATIVE, check_core_reads_every_effect
from rigtwin.fmu_src.network_code import WIDEST, UnknownOperationError, network_code
from rigtwin.rotor.effects import EFFECTS
from rigtwin.rotor.geometry.rig import load_rig
from tests.fmu.native.new_effect import DriveMass

SEEN = '__attribute__((visibility("default"))) '

# First bytes of a shared library, and where its machine stands with what value.
MAGIC = {
    "linux": (b"\x7fELF", 18, {"x86_64": b"\x3e\x00", "aarch64": b"\xb7\x00"}),
    "darwin": (b"\xcf\xfa\xed\xfe", 4, {"x86_64": b"\x07\x00\x00\x01", "aarch64": b"\x0c\x00\x00\x01"}),
}


# ziglang makes the C library of Windows, which takes minutes the first time.
PLATFORMS = {"all": TARGETS, "all but Windows": [t for t in TARGETS if "windows" not in t.fmi3]}


@pytest.fixture(autouse=True)
def _zig_keeps_its_library(monkeypatch):
    """ziglang makes a C library first, which takes seconds, and must be able to keep it."""
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(compiling.compile_cache().parent / "zig"))


@pytest.mark.parametrize("platforms", [pytest.param("all", marks=pytest.mark.long), "all but Windows"])
def test_one_file_has_a_binary_for_every_platform(tmp_path, platforms):
    targets = PLATFORMS[platforms]
    everywhere = build_native_estimator_fmu(tmp_path, fmi="3.0", targets=targets)
    with zipfile.ZipFile(everywhere) as archive:
        for target in targets:
            content = archive.read(f"binaries/{target.fmi3}/StiffnessEstimator{target.suffix}")
            machine, system = target.fmi3.split("-")
            if system == "windows":
                header = int.from_bytes(content[60:64], "little")
                assert content[:2] == b"MZ"
                assert content[header : header + 6] == b"PE\0\0\x64\x86"
                continue
            magic, place, machines = MAGIC[system]
            assert content.startswith(magic)
            assert content[place:].startswith(machines[machine])


def test_the_folders_of_fmi_2_have_the_names_its_importers_look_for():
    assert {t.folder("2.0") for t in TARGETS if t.fmi3.startswith("x86_64")} == {"linux64", "win64", "darwin64"}


def test_another_model_description_has_another_guid(tmp_path, monkeypatch):
    """A binary must not be taken for that of another description."""
    build = partial(build_native_rotor_fmu, load_rig("nit-rourkela"), targets=[this_machine()])
    before = manifest(build(tmp_path / "before"))["guid"]
    monkeypatch.setattr("rigtwin.fmu_src.build.ROTOR_MEANING", "another rotor")
    assert manifest(build(tmp_path / "after"))["guid"] != before


def test_the_same_sources_give_the_same_guid_and_other_numbers_another(tmp_path, larger_disks):
    rig, target = load_rig("nit-rourkela"), [this_machine()]
    guids = []
    for number, (which, fmi) in enumerate(((rig, "2.0"), (rig, "2.0"), (larger_disks, "2.0"), (rig, "3.0"))):
        fmu = build_native_rotor_fmu(which, tmp_path / str(number), fmi=fmi, targets=target)
        with zipfile.ZipFile(fmu) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        guids.append(root.get("guid") or root.get("instantiationToken"))
    assert guids[0] == guids[1]
    assert len(set(guids)) == 3


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_sources_compile_with_another_compiler_from_what_the_fmu_says(tmp_path, fmi):
    """As an importer would do it: the files that the descriptions list, nothing else."""
    fmu = build_native_rotor_fmu(load_rig("nit-rourkela"), tmp_path, fmi=fmi, targets=[this_machine()])
    folder = tmp_path / "unpacked"
    shutil.unpack_archive(fmu, folder, format="zip")
    if fmi == "2.0":
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        files = [file.attrib["name"] for file in root.findall("CoSimulation/SourceFiles/File")]
    else:
        root = ElementTree.parse(folder / "sources" / "buildDescription.xml").getroot()
        files = [file.attrib["name"] for file in root.iter("SourceFile")]
    assert len(files) > 8
    command = [shutil.which("cc") or sys.executable, "-std=c99", "-shared", "-fPIC", *files, "-o", "own.so", "-lm"]
    subprocess.run(command, cwd=folder / "sources", check=True)


def test_without_a_compiler_it_says_what_to_install(monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiling, "find_spec", lambda name: None)
    monkeypatch.setattr(compiling.shutil, "which", lambda name: None)
    with pytest.raises(CompileError, match="install one, or ziglang"):
        compiler(this_machine())


def test_a_compiler_with_arguments_is_taken_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(compiling, "find_spec", lambda name: None)
    monkeypatch.setenv("CC", f"{sys.executable} -m nosuch 'one argument'")
    assert compiler(this_machine()) == [sys.executable, "-m", "nosuch", "one argument"]


def test_what_the_compiler_says_reaches_the_user(tmp_path):
    (tmp_path / "broken.c").write_text("int f(void) { return nothing; }\n")
    with pytest.raises(CompileError, match="nothing"):
        compiling.compile_library(tmp_path, ["broken.c"], this_machine(), tmp_path / "out" / "broken.so")
    assert not (tmp_path / "out").exists()


def test_what_was_compiled_once_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "sources").mkdir()
    source = tmp_path / "sources" / "one.c"
    source.write_text(SEEN + "int one(void) { return 1; }\n")
    compiling.compile_library(source.parent, ["one.c"], this_machine(), tmp_path / "first.so")
    with monkeypatch.context() as without:
        without.setattr(compiling.subprocess, "run", lambda *_, **__: pytest.fail("compiled again"))
        compiling.compile_library(source.parent, ["one.c"], this_machine(), tmp_path / "second.so")
    assert (tmp_path / "first.so").read_bytes() == (tmp_path / "second.so").read_bytes()
    source.write_text(SEEN + "int one(void) { return 2; }\n")
    compiling.compile_library(source.parent, ["one.c"], this_machine(), tmp_path / "third.so")
    assert (tmp_path / "third.so").read_bytes() != (tmp_path / "first.so").read_bytes()
    assert len(list((tmp_path / "cache" / "rigtwin").iterdir())) == 2


@pytest.mark.parametrize(
    "damage", [lambda whole: whole[:1000], lambda whole: b"", lambda whole: whole[:-100] + bytes(100), None]
)
def test_a_damaged_library_in_the_cache_is_named_and_made_again(tmp_path, monkeypatch, caplog, damage):
    """A damaged one ends the process that loads it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "one.c").write_text(SEEN + "int one(void) { return 1; }\n")
    compiling.compile_library(tmp_path, ["one.c"], this_machine(), tmp_path / "first.so")
    (kept,) = (tmp_path / "cache" / "rigtwin").iterdir()
    whole = kept.read_bytes()
    if damage is None:
        kept.unlink()
        kept.mkdir()  # what cannot be read
    else:
        kept.write_bytes(damage(whole))
    compiling.compile_library(tmp_path, ["one.c"], this_machine(), tmp_path / "second.so")
    assert (tmp_path / "second.so").read_bytes() == whole
    assert str(kept) in caplog.text
    assert "compiled again" in caplog.text
    if damage is not None:
        assert kept.read_bytes() == whole


def test_a_cache_that_cannot_be_written_does_no_harm(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    (tmp_path / "one.c").write_text(SEEN + "int one(void) { return 1; }\n")
    compiling.compile_library(tmp_path, ["one.c"], this_machine(), tmp_path / "out" / "one.so")
    assert (tmp_path / "out" / "one.so").stat().st_size > 0


@pytest.mark.parametrize("compilable", [True, False])
def test_the_virtual_rig_takes_the_compiled_fmu_where_it_can(tmp_path, monkeypatch, compilable):
    monkeypatch.setattr(fmus, "can_compile", lambda: compilable)
    fmu = fmus.build_rotor_for_the_rig(load_rig("nit-rourkela"), tmp_path)
    with zipfile.ZipFile(fmu) as archive:
        assert ("sources/nonlinear.c" in archive.namelist()) == compilable


def test_where_the_compiler_fails_the_virtual_rig_says_so_and_goes_on(tmp_path, monkeypatch, caplog):
    def fail(*_, **__):
        raise CompileError("the C compiler failed")

    monkeypatch.setattr(fmus, "build_native_rotor_fmu", fail)
    fmu = fmus.build_rotor_for_the_rig(load_rig("nit-rourkela"), tmp_path)
    assert fmu.is_file()
    assert "the C compiler failed; the virtual rig goes on" in caplog.text


def test_an_effect_that_the_core_does_not_read_leaves_the_virtual_rig_pythonfmus_fmu(tmp_path, monkeypatch, caplog):
    monkeypatch.setitem(EFFECTS, DriveMass.id, DriveMass)
    fmu = fmus.build_rotor_for_the_rig(load_rig("nit-rourkela"), tmp_path)
    with zipfile.ZipFile(fmu) as archive:
        assert "sources/nonlinear.c" not in archive.namelist()
    assert "the C core does not read drive_mass.mass: add the line that does" in caplog.text


def test_a_single_parameter_that_the_core_does_not_read_is_named():
    core = "".join(path.read_text(encoding="utf-8") for path in sorted(NATIVE.glob("*.c")))
    check_core_reads_every_effect(core)
    forgetful = core.replace("d->pedestal_flexibility.block_mass", "8")
    with pytest.raises(CompileError, match=r"does not read pedestal_flexibility\.block_mass: add the line"):
        check_core_reads_every_effect(forgetful)


def tanh_network(file: Path, neurons: int) -> Path:
    """A network of one layer with so many neurons."""
    weights = numpy_helper.from_array(np.ones((3, neurons), dtype=np.float32), "W")
    answers = numpy_helper.from_array(np.ones((neurons, 1), dtype=np.float32), "V")
    nodes = [
        helper.make_node("MatMul", ["features", "W"], ["a"]),
        helper.make_node("Tanh", ["a"], ["b"]),
        helper.make_node("MatMul", ["b", "V"], ["estimate"]),
    ]
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, n]) for name, n in (("features", 3), ("estimate", 1))
    ]
    onnx.save(helper.make_model(helper.make_graph(nodes, "g", ends[:1], ends[1:], [weights, answers])), file)
    return file


def test_a_network_too_wide_for_the_code_in_c_is_refused(tmp_path):
    header = (Path(compiling.__file__).parent / "native" / "layer.h").read_text(encoding="utf-8")
    assert f"#define WIDEST {WIDEST} " in header
    assert f"tanh_of({WIDEST}," in network_code(tanh_network(tmp_path / "n.onnx", WIDEST), "network")
    with pytest.raises(UnknownOperationError, match="tanh of 68 neurons: the C code takes 64 of them at most"):
        network_code(tanh_network(tmp_path / "n.onnx", WIDEST + 4), "network")


def test_platforms_are_chosen_by_their_names():
    assert targets_named(["here", this_machine().fmi3]) == (this_machine(),)
    assert targets_named(["x86_64-windows", "aarch64-linux"])[0].fmi2 == "win64"
    with pytest.raises(CompileError, match="there is no platform atari; there are here, x86_64-linux"):
        targets_named(["atari"])


def test_without_ziglang_other_platforms_are_refused(monkeypatch):
    monkeypatch.setattr("rigtwin.fmu_src.compiling.find_spec", lambda _: None)
    other = next(target.fmi3 for target in TARGETS if target != this_machine())
    with pytest.raises(CompileError, match=f"{other} cannot be compiled for here without ziglang"):
        targets_named([other])
