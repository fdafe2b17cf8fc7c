"""Input that is damaged or made to do harm: one message of a readable length, exit code 2, and nothing of it is run."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import pytest

from rigtwin.exits import readable
from rigtwin.sim import archive
from rigtwin.sim.session import FmuSession
from tests.rigtwin.conftest import run

RIG = """
name = "{name}"
nodes_m = [0.0, 0.5, 1.0]
[[segment]]
length_m = 1.0
diameter_m = {diameter}
bore_m = {bore}
youngs_modulus_Pa = {modulus}
density_kg_per_m3 = {density}
[[support]]
node = 1
stiffness = "k_b"
[[support]]
node = 3
stiffness = "k_b"
"""
STEEL = {"name": "steel", "diameter": 0.02, "bore": 0.0, "modulus": 2e11, "density": 7800.0}
DEEP, DIGITS, MANY = "a = " + "[" * 20000 + "]" * 20000, "a = " + "9" * 5000, "9" * 400

NUMBERS = ("--delta-f1", 4.035, "--delta-f2", 25.996, "--amplitude-ratio", 1.2)
OPENING = [("check",), ("estimate", *NUMBERS, "--trust", "--estimator"), ("sweep", "--trust")]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


# -- text ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (DEEP, "not valid TOML: it is nested too deeply"),
        (DIGITS, "not valid TOML: a whole number in it has thousands of digits"),
        (RIG.format_map(STEEL | {"density": MANY}), "density_kg_per_m3: Input should be a valid number"),
        (RIG.format_map(STEEL | {"diameter": "1e200"}), "diameter_m: is 1e+200; give a number from 1e-30 to 1e+30"),
        (RIG.format_map(STEEL | {"density": "1e-300"}), "density_kg_per_m3: is 1e-300"),
        (RIG.format_map(STEEL | {"modulus": "1e-30"}), "segment 1: a shaft of it would bend at about"),
        (RIG.format_map(STEEL | {"bore": "0.019999999999999999"}), "bore_m must be smaller than diameter_m"),
    ],
    ids=["deep", "digits", "hundreds of digits", "wide", "light", "soft", "all bore"],
)
def test_a_rig_file(refused, text, said):
    Path("rig.toml").write_text(text, encoding="utf-8")
    assert said in refused("build", "rig.toml")
    assert os.listdir(".") == ["rig.toml"]


@pytest.mark.parametrize(("text", "said"), [(DEEP, "it is nested too deeply"), (DIGITS, "a whole number in it has")])
def test_a_campaign(refused, text, said):
    Path("campaign.toml").write_text(text, encoding="utf-8")
    assert f"campaign.toml: not valid TOML: {said}" in refused("estimate", ".")


@pytest.mark.parametrize(
    ("number", "said"),
    [
        ("Infinity", "Infinity is not a finite number"),
        ("1e999", "1e999 is not a finite number"),
        ("9" * 5000, "a whole number in it has thousands of digits"),
        ("[" * 100000, "it is nested too deeply"),
    ],
    ids=["infinity", "overflow", "digits", "deep"],
)
def test_a_diagnosis(refused, number, said):
    document = json.dumps({"schema": "rigtwin.diagnosis/1", "verdict": "no_gap", "nominal": {"k_b": {"value": "HERE"}}})
    Path("diagnosis.json").write_text(document.replace('"HERE"', number), encoding="utf-8")
    assert f"diagnosis.json: not valid JSON ({said})" in refused("predict", "diagnosis.json", ".", "--out", "p")


# -- FMUs ------------------------------------------------------------------------------------------


def with_flipped_byte(fmu: Path, member: str) -> bytes:
    content = bytearray(fmu.read_bytes())
    with zipfile.ZipFile(fmu) as whole:
        info = whole.getinfo(member)
    content[info.header_offset + 30 + len(member) + info.compress_size // 2] ^= 0xFF
    return bytes(content)


def encrypted(content: bytes) -> bytes:
    """As an archive is marked whose members are encrypted."""
    marked, place = bytearray(content), -1
    while (place := content.find(b"PK\x01\x02", place + 1)) >= 0:
        marked[place + 8] |= 1
    return bytes(marked)


@pytest.mark.parametrize(
    "command", [("check",), ("estimate", *NUMBERS, "--trust", "--estimator"), ("sweep", "--trust")]
)
def test_a_damaged_or_encrypted_fmu(refused, estimator_fmu, command):
    Path("damaged.fmu").write_bytes(with_flipped_byte(estimator_fmu, "modelDescription.xml"))
    Path("encrypted.fmu").write_bytes(encrypted(estimator_fmu.read_bytes()))
    assert "damaged.fmu" in refused(*command, "damaged.fmu")
    assert "it is encrypted" in refused(*command, "encrypted.fmu")


def test_a_damaged_network_in_an_fmu(refused, estimator_fmu):
    Path("damaged.fmu").write_bytes(with_flipped_byte(estimator_fmu, "resources/estimator.onnx"))
    said = refused("estimate", *NUMBERS, "--trust", "--estimator", "damaged.fmu")
    assert said.startswith("damaged.fmu cannot be read as an FMU: ")


@pytest.mark.parametrize(
    "command", [("check",), ("estimate", *NUMBERS, "--trust", "--estimator"), ("sweep", "--trust")]
)
def test_an_fmu_that_unpacks_to_more_than_there_is_room_for(refused, rotor_fmu, monkeypatch, command):
    monkeypatch.setattr(archive, "MOST_BYTES", 1 << 24)
    with zipfile.ZipFile(rotor_fmu) as whole, zipfile.ZipFile("bomb.fmu", "w", zipfile.ZIP_DEFLATED) as bomb:
        for name in whole.namelist():
            bomb.writestr(name, whole.read(name))
        bomb.writestr("resources/zeros", bytes((1 << 24) + 1))
    assert os.path.getsize("bomb.fmu") < 1e6
    assert "unpacked it has 18 MB, the limit is 17 MB" in refused(*command, "bomb.fmu")


# -- options ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("sweep", "--excitation-node", 4294967298), "'--excitation-node'"),
        (("sweep", "--lines", 10**9), "'--lines'"),
        (("sweep", "--settle-time", 0), "--settle-time 0"),
        (("train", "--rigs", 10**9), "'--rigs'"),
        (("train", "--calibration-rigs", 10**9), "'--calibration-rigs'"),
        (("blind", "--count", 10**9), "'--count'"),
        (("blind", "--workers", 10**6), "'--workers'"),
        (("blind", "--seed", -1), "'--seed'"),
        (("diagnose", ".", "--out", "d", "--workers", 10**6), "'--workers'"),
        (("sweep", "a\0b.fmu"), "a b.fmu: no such file"),
        (("sweep", "\033[2Ja.fmu"), " [2Ja.fmu: no such file"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_an_option(refused, arguments, said):
    assert said in refused(*arguments)


def test_a_number_that_an_fmus_integer_cannot_hold(refused, rotor_fmu):
    said = refused("sweep", rotor_fmu, "--set", "excitation_plane=4294967298")
    assert "use --plane" in said
    words = "excitation_node = 4294967298 is out of range: it takes 1 to 7"
    with FmuSession(rotor_fmu) as session, pytest.raises(archive.FmuError, match=words):
        session.start({"excitation_node": 4294967298})


def test_a_message_is_short_and_keeps_its_end(refused):
    said = refused("sweep", "x" * 3000 + ".toml")
    assert len(said) <= 500
    assert said.endswith("give a rig TOML or one of: cantilever, nit-rourkela, pump-overhung, spindle")
    assert readable("short\nand\0plain") == "short and plain"


def test_an_unreachable_settling_names_options(refused, rotor_fmu):
    hasty = ("--settle-time", 0.01, "--lines", 8, "--support", "rigid", "--set", "shaft_damping_ratio=1e-4")
    said = refused("sweep", rotor_fmu, *hasty)
    assert said.endswith("raise --settle-time, or the damping (--set shaft_damping_ratio=VALUE) if it is too low")


# -- disks -----------------------------------------------------------------------------------------


def test_a_full_disk_names_the_file(rotor_fmu, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rigtwin.sim.formats.csv_file.csv.writer", full)
    result = run("sweep", rotor_fmu, "--lines", 8, "--f-max", 60, "--out", "run.csv")
    assert result.exit_code == 2
    assert result.stderr == "rigtwin: run.csv: cannot be written (No space left on device)\n"
    assert os.listdir(".") == []
