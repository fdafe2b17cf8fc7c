"""The commands: what they find, what they refuse and how, what a machine can read of it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from rigtwin.api.estimates import answers_of_runs
from rigtwin.blind import SETS
from rigtwin.commands.blind import BlindRequest
from rigtwin.console import say
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.campaign import MeasurementError
from rigtwin.sim.formats import SUFFIXES, read_run, run_file
from tests.rigtwin.conftest import run, run_json

OWN_ROTOR = Path(__file__).resolve().parents[2] / "examples" / "own_rotor.toml"
PAPER = OWN_ROTOR.with_name("nit-rourkela-paper")
COMMANDS = (
    "demo",
    "build",
    "sweep",
    "train",
    "estimate",
    "check",
    "report",
    "inspect",
    "convert",
    "effects",
    "modes",
    "campbell",
    "critical-speeds",
    "unbalance",
    "diagnose",
    "predict",
    "blind",
)

# What the modal fit of a noise-free virtual run is worth: neighbouring modes, not the rig.
FIT = 1e-6
# The network's own error of k_b, and what 1 % noise on every line adds to it.
ESTIMATE = 2e-3

NUMBERS = ("--delta-f1", 4.036, "--delta-f2", 26.0, "--amplitude-ratio", 1.228)
ERRORS = ("--delta-f1-std", 0.004, "--delta-f2-std", 0.026, "--amplitude-ratio-std", 0.0012)


# --- start -----------------------------------------------------------------------------------------


def test_help_names_every_command():
    text = run("--help").stdout
    assert [name for name in COMMANDS if name not in text] == []
    assert run().stdout == text


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_its_options(command):
    result = run(command, "--help")
    assert result.exit_code == 0
    assert "--help" in result.stdout


def test_the_command_starts_without_loading_anything_heavy():
    watch = "import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); "
    script = watch + "from rigtwin.cli import main; sys.argv = ['rigtwin', '--help']; main()"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    heavy = {"numpy", "scipy", "fmpy", "torch", "onnxruntime", "plotly", "matplotlib", "jinja2", "pydantic"}
    loaded = {name.split(".")[0] for name in result.stderr.split()}
    assert "typer" in loaded
    assert loaded & heavy == set()


# --- sweep -----------------------------------------------------------------------------------------


def test_sweep_finds_the_modes_of_the_finite_element_model(rotor_fmu):
    condition = Condition(k_b=4e6, bearing_damping=10.0)
    settings = {"k_b": condition.k_b, "bearing_damping": condition.bearing_damping}
    options = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    found = run_json("sweep", rotor_fmu, "--lines", 96, *options)
    expected = damped_modes(build_system(assemble(load_rig("nit-rourkela")), condition))
    assert_allclose([m["frequency_hz"] for m in found["modes"]], expected.frequency_hz[[0, 2]], rtol=FIT)
    assert_allclose([m["damping_ratio"] for m in found["modes"]], expected.damping_ratio[[0, 2]], rtol=1e-4)
    assert found["parameters"] == settings


def test_printed_text_is_what_was_said(capsys):
    say("runs/r:x:b:100:.html [bold]")
    assert capsys.readouterr().out == "runs/r:x:b:100:.html [bold]\n"


def test_sweep_takes_a_rig_in_place_of_an_fmu():
    found = run_json("sweep", "nit-rourkela", "--support", "rigid", "--f-min", 90, "--f-max", 110, "--lines", 12)
    assert_allclose(found["modes"][0]["frequency_hz"], 100.5612, rtol=1e-5)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_sweep_writes_a_run_that_can_be_read_again(rotor_fmu, tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    found = run_json("sweep", rotor_fmu, "--f-min", 90, "--f-max", 100, "--lines", 10, "--excitation-node", 4,
                     "--plane", "z", "--out", path)  # fmt: skip
    told = {"support": "bearing", "excitation_node": 4, "excitation_plane": "z"} if suffix == ".csv" else {}
    again = read_run(path, **told)
    assert found["file"] == str(path)
    assert len(again.frequency_hz) == found["lines"]
    assert (again.excitation_node, again.excitation_plane) == (4, "z")


def test_an_interrupt_leaves_no_file_behind(rotor_fmu, tmp_path, monkeypatch):
    def interrupted(run, path):
        path.write_text("half of")
        raise KeyboardInterrupt

    csv = run_file._FORMATS[".csv"]
    monkeypatch.setitem(run_file._FORMATS, ".csv", csv._replace(write=interrupted))
    result = run("sweep", rotor_fmu, "--lines", 8, "--f-min", 20, "--f-max", 30, "--out", tmp_path / "run.csv")
    assert result.exit_code == 130
    assert list(tmp_path.iterdir()) == []


# --- estimate --------------------------------------------------------------------------------------


def test_estimate_finds_the_stiffness_of_two_swept_runs(swept):
    (answer,) = run_json("estimate", swept.rigid, swept.bearing)["estimates"]
    assert answer["valid"] is True
    assert answer["why_not_valid"] == []
    assert_allclose(answer["k_b"], swept.k_b, rtol=ESTIMATE)


def test_a_pair_that_cannot_be_used_does_not_hide_one_that_can(swept):
    rigid, bearing = read_run(swept.rigid, support="rigid"), read_run(swept.bearing, support="bearing")
    narrow = replace(bearing.on_lines(bearing.frequency_hz < 150.0), name="narrow")
    found = answers_of_runs([rigid, narrow, bearing], "nit-rourkela", None)
    (answer,) = found
    assert answer.estimate.valid
    assert "left out: run 'narrow'" in found.remarks[0]
    with pytest.raises(MeasurementError, match="narrow"):
        answers_of_runs([rigid, narrow], "nit-rourkela", None)


def test_responses_that_are_not_per_force_are_paired_by_their_force(swept):
    per_newton = [read_run(swept.rigid, support="rigid"), read_run(swept.bearing, support="bearing")]
    runs = [
        replace(run, H=force * run.H, std=None, harmonics={}, quantity="acceleration", force_amplitude_N=force)
        for force in (0.5, 2.0)
        for run in per_newton
    ]
    answers = answers_of_runs(runs, "nit-rourkela", None)
    assert [answer.estimate.valid for answer in answers] == [True, True]


def test_the_estimator_fmu_answers_as_the_network_it_holds(swept, estimator_fmu):
    outputs = ("k_b", "k_b_std", "k_b_low", "k_b_high", "valid")
    (network,) = run_json("estimate", swept.rigid, swept.bearing)["estimates"]
    (fmu,) = run_json("estimate", swept.rigid, swept.bearing, "--estimator", estimator_fmu)["estimates"]
    assert [fmu[name] for name in outputs] == [network[name] for name in outputs]


def test_estimate_takes_numbers():
    (answer,) = run_json("estimate", *NUMBERS, *ERRORS)["estimates"]
    assert answer["valid"] is True
    assert answer["k_b_low"] < 1e7 < answer["k_b_high"]


def test_estimate_says_why_inputs_are_not_valid():
    contradictory = run("estimate", "--delta-f1", 4.036, "--delta-f2", 60.0, "--amplitude-ratio", 1.228, *ERRORS)
    outside = run("estimate", "--delta-f1", -3, "--delta-f2", 26, "--amplitude-ratio", 1.228, *ERRORS)
    vague = run("estimate", *NUMBERS, *ERRORS[:-1], 0.9)
    assert [r.exit_code for r in (contradictory, outside, vague)] == [0, 0, 0]
    assert "contradict" in contradictory.stdout
    assert "delta_f1 = -3 Hz is outside the trained range" in outside.stdout
    assert "amplitude_ratio_std = 0.9 is not between 0 and 30%" in vague.stdout


def test_estimate_takes_a_campaign_of_resonance_lists():
    (answer,) = run_json("estimate", PAPER, "--amplitude-ratio", 0.78, "--amplitude-ratio-std", 0.08)["estimates"]
    assert (answer["delta_f1"], answer["delta_f2"]) == (25.0, 130.0)
    assert answer["k_b_low"] < 1.11e6 < answer["k_b_high"]


def test_a_ratio_without_its_error_is_trusted_to_a_tenth_and_says_so():
    result = run("estimate", PAPER, "--amplitude-ratio", 0.78)
    assert result.exit_code == 0
    assert "0.780 ± 0.078" in result.stdout
    assert "10 % of the ratio is taken" in result.stderr


# --- build -----------------------------------------------------------------------------------------


def test_build_makes_both_fmus_of_the_shipped_rig(tmp_path):
    result = run("build", "--out", tmp_path)
    assert result.stdout.split() == [str(tmp_path / "RotorRig.fmu"), str(tmp_path / "StiffnessEstimator.fmu")]
    assert all(Path(line).is_file() for line in result.stdout.split())


def test_build_of_another_rig_says_that_no_network_knows_it(tmp_path):
    result = run("build", OWN_ROTOR, "--out", tmp_path)
    assert result.exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["RotorRig.fmu"]
    assert len(result.stderr.splitlines()) == 1
    assert "--train trains one for stepped-cantilever" in result.stderr


# --- what is refused, and how ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nosuch",), "No such command 'nosuch'"),
        (("sweep", "--nosuch"), "No such option: --nosuch"),
        (("sweep", "--support", "soft"), "'soft' is not one of 'rigid', 'bearing'"),
        (("sweep", "nosuch.fmu"), "nosuch.fmu: no such file"),
        (("sweep", "nosuch.toml"), "give a rig TOML or one of: cantilever, nit-rourkela, pump-overhung, spindle"),
        (("sweep", "--f-min", 0), "need 0 < f-min < f-max"),
        (("sweep", "--lines", 3), "at least 8"),
        (("sweep", "--out", "run.txt"), "--out takes .csv, .uff"),
        (("sweep", "--out", "nosuch/run.csv"), "the folder nosuch does not exist"),
        (("build", "nosuch.toml"), "nosuch.toml: cannot be read"),
        (("build", "--train"), "has its network already; rigtwin train makes another one"),
        (("estimate",), "give RIGID_FILE BEARING_FILE, a campaign folder, or numbers"),
        (("estimate", "a.csv", "b.csv", "c.csv"), "3 files given"),
        (("estimate", "nosuch.csv", "nosuch.uff"), "nosuch.csv: no such file"),
        (("estimate", "nosuch"), "nosuch: no such folder"),
        (("estimate", PAPER), "give --amplitude-ratio"),
        (("estimate", *NUMBERS), "--delta-f1-std, --delta-f2-std, --amplitude-ratio-std missing"),
        (("estimate", "--delta-f1", "nan", *NUMBERS[2:], *ERRORS), "--delta-f1 nan: give a finite number"),
        (("estimate", *NUMBERS, *ERRORS, "--estimator", __file__), "holds no network of rigtwin train"),
        (("check", "nosuch.fmu"), "nosuch.fmu: no such file"),
        (("check", __file__), "not an FMU"),
        (("check", "nosuch.fmu", "--expect-k-b", -1), "--expect-k-b -1.0: give a positive number"),
        (("report",), "give a campaign folder, or run files"),
        (("report", "nosuch"), "nosuch: no such file"),
        (("report", PAPER, "run.csv"), "a campaign folder is reported alone"),
        (("train", "--rigs", 3), "at least 16"),
        (("train", "--from-data", "--rigs", 64), "--from-data trains on the shipped data alone"),
    ],
    ids=lambda value: " ".join(map(str, value))[:40] if isinstance(value, tuple) else "",
)
def test_wrong_input_gives_one_message_and_exit_code_2(refused, arguments, said):
    assert said in refused(*arguments)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--set", "k_b"), "write name=value"),
        (("--set", "k_b=soft"), "'soft' is not a number"),
        (("--set", "kb=1e7"), "the FMU has no parameter kb; did you mean k_b? it has force"),
        (("--set", "rigid_support=true"), "use --support"),
        (("--set", "excitation_node=3"), "use --excitation-node"),
        (("--set", "k_b=-1"), "k_b must be at least 10000 N/m, got -1"),
        (("--f-max", "inf"), "f_max"),
        (("--excitation-node", 8), "excitation_node must be at most 7, got 8"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_a_wrong_setting_of_the_rig_gives_one_message(refused, rotor_fmu, options, said):
    assert said in refused("sweep", rotor_fmu, *options)


def test_an_estimator_cannot_be_swept(refused, estimator_fmu):
    assert "is not a RotorRig FMU" in refused("sweep", estimator_fmu)


def test_a_broken_fmu_is_the_users_input(refused, tmp_path):
    (tmp_path / "broken.fmu").write_bytes(b"PK\x05\x06" + bytes(18))
    assert "broken.fmu" in refused("sweep", tmp_path / "broken.fmu")


def test_a_rig_with_a_wrong_key_is_named_with_the_key(refused, tmp_path):
    text = OWN_ROTOR.read_text(encoding="utf-8").replace("diameter_m = 0.016", "diameter_m = -1")
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    assert "rig.toml: segment 2 diameter_m" in refused("build", tmp_path / "rig.toml", "--out", tmp_path)


def test_a_data_file_with_a_wrong_cell_is_named_with_its_line(refused, swept, tmp_path):
    lines = swept.rigid.read_text(encoding="utf-8").splitlines()
    (tmp_path / "wrong.csv").write_text("\n".join([*lines[:5], "x" + lines[5], *lines[6:]]), encoding="utf-8")
    assert "wrong.csv, line 6, column frequency_Hz" in refused("estimate", tmp_path / "wrong.csv", swept.bearing)


def test_runs_in_the_wrong_order_are_refused(refused, swept):
    assert "bearing.uff: a run on bearing support; give first the run on rigid" in refused(
        "estimate", swept.bearing, swept.rigid
    )


def test_one_file_alone_is_not_enough(refused, swept):
    assert "one file alone" in refused("estimate", swept.rigid)


def test_a_run_driven_elsewhere_than_in_training_is_refused(refused, swept):
    message = refused("estimate", swept.rigid, swept.bearing, "--excitation-node", 3)
    assert "the force at node 2" in message


@pytest.mark.parametrize("number", [("--delta-f1", 4.0), ("--amplitude-ratio-std", 0.01)], ids=lambda pair: pair[0])
def test_numbers_beside_files_that_tell_them_are_refused(refused, swept, number):
    assert f"{number[0]}: numbers go without files" in refused("estimate", swept.rigid, swept.bearing, *number)


def test_shifts_beside_lists_of_resonances_are_refused(refused):
    message = refused("estimate", PAPER, "--amplitude-ratio", 0.78, "--delta-f2-std", 1)
    assert "--delta-f2-std: numbers go without files" in message


def test_settings_beside_a_campaign_are_refused(refused):
    message = refused("estimate", PAPER, "--amplitude-ratio", 0.78, "--quantity", "mobility")
    assert "--quantity: the campaign says that of its runs" in message


def test_two_lists_of_one_support_are_refused(refused, tmp_path):
    text = (PAPER / "campaign.toml").read_text(encoding="utf-8")
    again = text[text.index("[[peaks]]") :].split("[[peaks]]")[1]
    (tmp_path / "campaign.toml").write_text(f"{text}\n[[peaks]]{again}", encoding="utf-8")
    message = refused("estimate", tmp_path, "--amplitude-ratio", 1, "--amplitude-ratio-std", 0.1)
    assert "one [[peaks]] of each support" in message


def test_a_campaign_of_another_rig_is_no_question_to_the_network(refused, estimator_fmu, tmp_path):
    text = (PAPER / "campaign.toml").read_text(encoding="utf-8").replace('"nit-rourkela"', f'"{OWN_ROTOR.as_posix()}"')
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    message = refused("estimate", tmp_path, "--amplitude-ratio", 1, "--estimator", estimator_fmu)
    assert "the campaign's rig is stepped-cantilever, the estimator was trained for nit-rourkela" in message
    (answer,) = run_json("estimate", tmp_path)["estimates"]
    assert answer["method"] == "model"
    assert "contradict" in answer["why_not_valid"][0]  # the resonances are those of the paper's rotor


@pytest.mark.parametrize("command", [("build", "--out"), ("demo", "--fmus")], ids=["build", "demo"])
def test_a_folder_that_cannot_be_made_is_named(refused, tmp_path, command):
    (tmp_path / "file").touch()
    assert f"{tmp_path}/file" in refused(*command, tmp_path / "file" / "dist")


@pytest.mark.parametrize(
    "command",
    [("demo", "--out"), ("report", "nosuch.csv", "--out"), ("check", "nosuch.fmu", "--junit")],
    ids=["demo", "report", "check"],
)
def test_what_cannot_be_written_is_refused_before_any_work(refused, tmp_path, command):
    (tmp_path / "file").touch()
    place = tmp_path / "file" / "result"
    assert f"{place}" in refused(*command, place)
    assert "cannot be written" in refused(*command, place)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_page_needs_a_name_of_its_own(refused, tmp_path):
    assert f"{tmp_path}: is a folder; give the file a name inside it" in refused("report", PAPER, "--out", tmp_path)


def test_training_without_torch_says_what_to_install(refused, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "pip install '.[train]'" in refused("train", "--from-data")


def test_the_blind_benchmark_is_asked_for_what_the_options_say(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr("rigtwin.commands.blind.run_blind", asked.append)
    options = ("--split", "report", "--count", 7, "--seed", 9, "--workers", 3, "--executor", "dask://here:1")
    assert run("blind", "W3", "W1", *options, "--out", tmp_path, "--page", "p.md", "--render-only").exit_code == 0
    assert run("blind").exit_code == 0
    assert asked == [
        BlindRequest(
            sets=("W3", "W1"),
            split="report",
            count=7,
            out=tmp_path,
            seed=9,
            workers=3,
            executor="dask://here:1",
            page=Path("p.md"),
            render_only=True,
        ),
        BlindRequest(sets=tuple(SETS), split="tuning", count=20, out=Path("runs/blind"), seed=1, workers=2),
    ]


def test_sets_and_splits_that_do_not_exist_are_refused(refused):
    assert "W10: no such set; the sets are W1, W2" in refused("blind", "W10")
    assert "--split other: give tuning or report" in refused("blind", "W1", "--split", "other")


def test_a_fault_of_our_own_shows_its_traceback(monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("the planted fault")

    monkeypatch.setattr("rigtwin.commands.build.build_fmus", broken)
    result = run("build")
    assert result.exit_code == 1
    assert "Traceback" in result.stderr
    assert "ZeroDivisionError: the planted fault" in result.stderr
    assert "this is a fault of rigtwin" in result.stderr.splitlines()[-1]


def test_an_interrupted_command_exits_with_130(monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("rigtwin.commands.build.build_fmus", interrupted)
    result = run("build")
    assert (result.exit_code, result.stderr) == (130, "rigtwin: interrupted\n")


@pytest.mark.parametrize("later", [0, 0.05, 0.3, 0.6])  # [s]: while the FMU is loaded, while its Python runs
def test_a_terminated_command_leaves_nothing_behind(later, rotor_fmu, tmp_path):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    command = [sys.executable, "-m", "rigtwin", "sweep", rotor_fmu, "--out", tmp_path / "run.csv"]
    environment = {**os.environ, "TMPDIR": str(scratch)}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while process.poll() is None and not any(scratch.rglob("*.py")):  # until the FMU is unpacked
            time.sleep(0.01)
        time.sleep(later)
        process.terminate()
        _, errors = process.communicate()
    assert (process.returncode, errors) == (130, "rigtwin: interrupted\n")
    assert [path for path in scratch.iterdir() if path.is_dir()] == []
    assert list(tmp_path.iterdir()) == [scratch]


# --- the documentation -----------------------------------------------------------------------------


# Commands that share a page.
OF_MODES = ("modes", "campbell", "critical-speeds", "unbalance")


def section(command: str) -> str:
    """What docs/command-line.md says of a command, or docs/modes.md of all that it describes."""
    docs = OWN_ROTOR.parents[1] / "docs"
    if command in OF_MODES:
        return (docs / "modes.md").read_text(encoding="utf-8")
    text = (docs / "command-line.md").read_text(encoding="utf-8")
    return text.split(f"## rigtwin {command}\n")[1].split("\n## ")[0]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_documentation_has_an_example_and_every_option_of_a_command(command):
    text = section(command)
    assert f"\n$ rigtwin {command}" in text
    documented = set(re.findall(r"`(--[\w-]+)", text))
    assert options_of(command) <= documented
    known = {name for each in (OF_MODES if command in OF_MODES else (command,)) for name in options_of(each)}
    assert set(re.findall(r"^\| `(--[\w-]+)", text, re.MULTILINE)) <= known


def options_of(command: str) -> set[str]:
    """That its help lists."""
    return set(re.findall(r"^  (?:-\w, )?(--[\w-]+)", run(command, "--help").stdout, re.MULTILINE)) - {"--help"}
