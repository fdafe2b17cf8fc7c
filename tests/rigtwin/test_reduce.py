"""``rigtwin reduce``: folders of records in, a run file and its lines for ``campaign.toml`` out."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.estimator.features import features_of_runs
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats import read_run
from rigtwin.sim.oscilloscope import Oscilloscope, file_name, write_record
from tests.rigtwin.conftest import run, run_json

ROOT = Path(__file__).resolve().parents[2]
SCOPE = Oscilloscope(samples=1000)
LINES = np.array([60.0, 80.0, 90.0, 99.0, 101.0, 120.0])
CHANNELS = ["--channel", "force=CH1, 22.4 mV/N", "--channel", "node2=CH2, 10.2 mV/(m/s^2)"]


def response(frequency_hz: np.ndarray) -> np.ndarray:
    """Accelerance of an oscillator of 100 Hz."""
    r = frequency_hz / 100
    return -(r**2) / (1 - r**2 + 0.04j * r)


@pytest.fixture
def records(tmp_path) -> Path:
    """A folder of an oscilloscope's records, one for each line."""
    folder, rng = tmp_path / "records", np.random.default_rng(0)
    folder.mkdir()
    for frequency, H in zip(LINES, response(LINES), strict=True):
        interval = SCOPE.interval(frequency)
        turning = np.exp(2j * np.pi * frequency * interval * np.arange(SCOPE.samples))
        volts = np.column_stack([22.4e-3 * 2.0 * turning.real, 10.2e-3 * 2.0 * (H * turning).real])
        write_record(folder / file_name(frequency), interval, SCOPE.digitise(volts, rng))
    return folder


def test_a_folder_of_records_becomes_a_run_that_a_campaign_reads(records, tmp_path):
    out = tmp_path / "rigid.csv"
    result = run("reduce", records, "--out", out, *CHANNELS, "--set", "support=rigid", "--set", "excitation_node=2")
    assert result.exit_code == 0, result.stderr
    assert "records used             6 of 6" in result.stdout
    toml = result.stdout.split("For campaign.toml:\n")[1]
    (tmp_path / "campaign.toml").write_text('rig = "nit-rourkela"\n' + toml, encoding="utf-8")
    (reduced,) = load_campaign(tmp_path).runs
    assert reduced.std is not None
    assert_allclose(reduced.frequency_hz, LINES, rtol=1e-4)
    assert np.all(np.abs(reduced.H[:, 0] - response(LINES)) < 3 * reduced.std[:, 0])
    assert np.all(reduced.std[:, 0] < 0.01 * np.abs(reduced.H[:, 0]))
    assert_allclose(reduced.forces, 2.0, rtol=0.01)


def test_a_plan_says_the_same_and_the_command_line_wins(records, tmp_path):
    (tmp_path / "plan.toml").write_text('largest_change = 0.1\n[channels]\nforce = {column = "CH1", unit = "N"}\n')
    told = run_json("reduce", records, "--out", tmp_path / "a.csv", "--plan", tmp_path / "plan.toml", *CHANNELS)
    run_json("reduce", records, "--out", tmp_path / "b.csv", *CHANNELS)
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()
    assert (told["lines"], told["quantity"], told["odd"]) == (6, "accelerance", [])
    assert 'support = "bearing"      # or "rigid"' in told["campaign_toml"]


def test_a_number_of_thousands_of_digits_in_a_plan_is_told(records, tmp_path, refused):
    (tmp_path / "plan.toml").write_text(f"sample_rate_Hz = {'9' * 5000}\n")
    words = refused("reduce", records, "--out", tmp_path / "a.csv", "--plan", tmp_path / "plan.toml", *CHANNELS)
    assert "plan.toml: not valid TOML: a whole number in it has thousands of digits" in words


def test_a_column_is_one_channel(records, tmp_path, refused):
    words = refused(
        "reduce", records, "--out", tmp_path / "a.csv", "--channel", "force=CH1, N", "--channel", "node2=ch1, g"
    )
    assert "channels: force and node2 are both the column ch1; correct one of them" in words


def test_an_option_that_is_wrong_is_named_and_so_is_a_folder_that_is_not_there(records, tmp_path, refused):
    (tmp_path / "plan.toml").write_text("largest_change = 0.1\n")
    told = "--out", tmp_path / "a.csv", "--plan", tmp_path / "plan.toml", *CHANNELS
    assert "the command line: sample_rate_Hz" in refused("reduce", records, *told, "--sample-rate", "-1")
    assert "none: no such file or folder" in refused("reduce", tmp_path / "none", *told)
    assert "a folder; give one file of a run" in refused("inspect", records)


def test_amplitudes_alone_make_a_run_of_accelerations(records, tmp_path):
    told = run_json("reduce", records, "--out", tmp_path / "a.csv", *CHANNELS[2:])
    assert told["magnitude_only"]
    assert 'quantity = "acceleration"' in told["campaign_toml"]
    reduced = read_run(tmp_path / "a.csv", support="rigid", quantity="acceleration")
    assert reduced.std is not None
    assert np.all(np.abs(reduced.H[:, 0] - 2 * np.abs(response(LINES))) < 3 * reduced.std[:, 0])


def test_other_formats_and_a_line_that_is_left_out(records, tmp_path):
    clipped = records / "080.000Hz.csv"
    rows = [line.split(",") for line in clipped.read_text().splitlines()]
    top = max(float(row[2]) for row in rows[5:])
    for row in rows[5:]:
        row[2] = f"{min(float(row[2]), 0.5 * top):.6g}"
    clipped.write_text("\n".join(",".join(row) for row in rows))
    result = run("reduce", records, "--out", tmp_path / "a.h5", *CHANNELS, "--set", "support=bearing")
    assert result.exit_code == 0, result.stderr
    assert "odd  080.000Hz.csv: clipped: node2 (" in result.stdout
    reduced = read_run(tmp_path / "a.h5")
    assert (reduced.support, len(reduced.frequency_hz)) == ("bearing", 5)
    assert reduced.swept_hz is not None
    assert len(reduced.swept_hz) == 6


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "a.csv"], "no plan: says of no channel what it is; add a table [channels], or --channel"),
        (["--out", "a.xyz", *CHANNELS], "a.xyz: unknown kind of file; --out takes .csv"),
        (["--out", "no/a.csv", *CHANNELS], "no/a.csv: the folder no does not exist"),
        (["--out", "a.uff", *CHANNELS], "a.uff: says what held the rotor; add --set support=rigid"),
        (["--out", "a.csv", *CHANNELS, "--set", "unit=g"], "--set unit: says how a run file is read"),
        (["--out", "a.csv", "--channel", "node2"], '--channel node2: write NAME=COLUMN, SENSITIVITY'),
        (["--out", "a.csv", "--channel", "node2=CH2, 3 bar"], "channels node2 sensitivity: '3 bar' is no sensitivity"),
        (["--out", "a.csv", *CHANNELS, "--sample-rate", "-1"], "sample_rate_Hz: Input should be greater than 0"),
        (["--out", "a.csv", "--plan", "none.toml"], "none.toml: cannot be read"),
        (["--out", "a.csv", *CHANNELS[2:], "--method", "hammer"], "hammer records need a force; add the channel force"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_told_and_nothing_is_written(records, tmp_path, monkeypatch, refused, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in refused("reduce", records, *arguments)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["records"]


def test_an_unreadable_record_stops_before_anything_is_written(records, tmp_path, refused):
    (records / "070.000Hz.csv").write_text("")
    words = refused("reduce", records, "--out", tmp_path / "a.csv", *CHANNELS)
    assert "070.000Hz.csv: the file is empty; record it again, or move it out of the folder" in words
    assert not (tmp_path / "a.csv").exists()


def test_an_unknown_key_of_a_plan_is_told(records, tmp_path, refused):
    (tmp_path / "plan.toml").write_text('[channel]\nnode2 = {column = "CH2"}\n')
    words = refused("reduce", records, "--out", tmp_path / "a.csv", "--plan", tmp_path / "plan.toml", *CHANNELS)
    assert "channel: unknown key; did you mean channels?" in words


@pytest.mark.long
def test_the_stiffness_from_an_oscilloscopes_records_is_that_of_the_sweep(tmp_path):
    """8 bits and 2 % of noise, through the example and the command as a user runs them."""
    script = ROOT / "examples" / "oscilloscope_records.py"
    subprocess.run([sys.executable, str(script), str(tmp_path)], check=True, capture_output=True)
    reduced = {}
    for support in ("rigid", "bearing"):
        out = tmp_path / f"{support}.csv"
        result = run("reduce", tmp_path / support, "--plan", tmp_path / "plan.toml", "--out", out)
        assert result.exit_code == 0, result.stderr
        assert "odd" not in result.stdout
        reduced[support] = read_run(out, support=support)
    features = features_of_runs(reduced["rigid"], reduced["bearing"])
    assert 0 < features.delta_f1_std < 0.01
    (found,) = run_json("estimate", tmp_path / "rigid.csv", tmp_path / "bearing.csv")["estimates"]
    assert found["valid"]
    assert_allclose(found["k_b"], 6.2e6, rtol=2e-3)
