"""``rigtwin inspect`` and ``rigtwin convert`` on files of the virtual rig and of other software."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats import read_run, write_run
from tests.rigtwin.conftest import run, run_json
from tests.sim.test_foreign_files import text_58
from tests.sim.test_formats import a_run


def test_a_file_that_says_everything_is_described_and_its_lines_make_a_campaign(tmp_path):
    written = a_run(support="rigid", excitation_node=4, excitation_plane="z")
    write_run(written, tmp_path / "run01.uff")
    result = run("inspect", tmp_path / "run01.uff")
    assert result.exit_code == 0, result.stderr
    assert "accelerance in (m/s^2)/N" in result.stdout
    assert "force      at node 4 along z" in result.stdout
    toml = result.stdout.split("For campaign.toml:\n")[1]
    assert 'support = "rigid"' in toml
    (tmp_path / "campaign.toml").write_text('rig = "nit-rourkela"\n' + toml, encoding="utf-8")
    (read,) = load_campaign(tmp_path).runs
    np.testing.assert_array_equal(read.H, written.H)
    assert (read.excitation_node, read.excitation_plane, read.support) == (4, "z", "rigid")


def test_what_a_file_does_not_say_is_said_and_what_was_told_is_kept(tmp_path):
    text = text_58(rsp=("Acc 1", 0, 2), motion="g")
    (tmp_path / "foreign.uff").write_text(text)
    told = ["--set", 'channels={"Acc 1" = "node3"}', "--set", "excitation_node=5"]
    found = run_json("inspect", tmp_path / "foreign.uff", *told)
    assert (found["support"], found["channels"], found["lines"], found["from_Hz"]) == (None, ["node3"], 3, 20.0)
    assert any("values in g are turned into SI" in words for words in found["odd"])
    assert "the file does not say it" in found["campaign_toml"]
    assert tomllib.loads(found["campaign_toml"])["run"][0]["channels"] == {"Acc 1": "node3"}


def test_the_rig_says_where_the_exciter_is_where_the_file_does_not(tmp_path):
    write_run(a_run(support="rigid"), tmp_path / "run.csv")
    rig = Path(__file__).resolve().parents[2] / "examples" / "own_rotor.toml"
    alone, with_rig, told = (
        run_json("inspect", tmp_path / "run.csv", *more)
        for more in ([], ["--rig", rig], ["--rig", rig, "--set", "excitation_node=3", "--set", "quantity=mobility"])
    )
    assert [found["excitation_node"] for found in (alone, with_rig, told)] == [2, 4, 3]
    assert "excitation_node = 4      # the file does not say it" in with_rig["campaign_toml"]
    assert told["campaign_toml"].count("the file does not say it") == 2  # support and force
    assert tomllib.loads(told["campaign_toml"])["run"][0]["excitation_node"] == 3


def test_an_unknown_force_and_a_strange_name_are_written_as_they_are(tmp_path):
    path = tmp_path / "run ⚙\U0001f600.csv"
    write_run(a_run(support="rigid", force_amplitude_N=None), path)
    found = run_json("inspect", path, "--set", "force_amplitude_N=unknown")
    (table,) = tomllib.loads(found["campaign_toml"])["run"]
    assert (table["file"], table["force_amplitude_N"]) == (path.name, "unknown")


def test_what_the_audit_finds_in_a_run_is_odd(tmp_path):
    loud = a_run(support="rigid", frequency_hz=np.linspace(20, 60, 3), harmonics={}, std=None)
    write_run(loud, tmp_path / "run.uff")
    assert run_json("inspect", tmp_path / "run.uff", "--rig", "nit-rourkela")["odd"]


@pytest.mark.parametrize(("quantity", "power"), [("receptance", -2), ("mobility", -1), ("accelerance", 0)])
def test_a_run_is_converted_to_another_format_and_quantity(tmp_path, quantity, power):
    written = a_run(support="rigid")
    write_run(written, tmp_path / "run.csv")
    told = ["--set", "support=rigid", "--quantity", quantity]
    result = run("convert", tmp_path / "run.csv", tmp_path / "run.h5", *told)
    assert result.exit_code == 0, result.stderr
    read = read_run(tmp_path / "run.h5")
    omega = 2 * np.pi * written.frequency_hz[:, None]
    assert (read.quantity, read.support) == (quantity, "rigid")
    np.testing.assert_allclose(read.H, written.H * (1j * omega) ** power, rtol=1e-12)
    np.testing.assert_allclose(read.harmonics[3], written.harmonics[3] * (3j * omega) ** power, rtol=1e-12)
    assert read.std is not None
    assert written.std is not None
    np.testing.assert_allclose(read.std, written.std * omega**power, rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["inspect", "run.csv", "--set", "uni=g"], "--set uni=g: give KEY=VALUE .* did you mean unit?"),
        (["inspect", "none.csv"], "none.csv: no such file"),
        (["convert", "run.csv", "new.uff"], "run.csv: does not say what held the rotor; add --set support=rigid"),
        (["convert", "run.csv", "run.csv", "--set", "support=rigid"], "run.csv: is the file that is read"),
        (["convert", "run.csv", "new.xyz", "--set", "support=rigid"], "new.xyz: unknown kind of file"),
        (
            ["convert", "run.csv", "new.uff", "--set", "support=rigid", "--set", "quantity=acceleration",
             "--quantity", "mobility"],
            "--quantity mobility: the force of an acceleration is not known",
        ),
    ],
)  # fmt: skip
def test_a_mistake_is_one_sentence_and_writes_nothing(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    write_run(a_run(), tmp_path / "run.csv")
    before = (tmp_path / "run.csv").read_bytes()
    result = run(*arguments)
    assert result.exit_code == 2
    assert words.split(" .* ")[0] in result.stderr
    assert words.split(" .* ")[-1] in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
    assert (tmp_path / "run.csv").read_bytes() == before
