"""A campaign folder: saved and loaded it is the same, and whatever is wrong in it is named once and clearly."""

from __future__ import annotations

import dataclasses
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim import campaign_folder
from rigtwin.sim.campaign import Campaign, MeasurementError, NominalBelief, PeakList
from rigtwin.sim.campaign_folder import load_campaign, save_campaign
from rigtwin.sim.formats import RunSettings, read_run
from tests.sim.recorded import a_run, assert_same_run, runs

EXAMPLES = Path(__file__).parents[2] / "examples"

CSV = "frequency_Hz,node2_re,node2_im\n95,1,2\n96,3,4\n"

CONTRACT = """\
title = "ball bearing, shaker at node 2"
rig = "nit-rourkela"
[nominal]
shaft_damping_ratio = 0.002
bearing_damping_Ns_per_m = 20.0
gain_tolerance = 0.02
frequency_drift = 1e-4
[[run]]
file = "run01_rigid_1N.csv"
support = "rigid"
excitation_node = 2
force_amplitude_N = 1.0
spin_rpm = 0.0
quantity = "accelerance"
[[peaks]]
support = "rigid"
frequencies_Hz = [95.0, 320.0]
std_Hz = [1.5, 3.0]
"""

HEAD = 'rig = "nit-rourkela"\n'
RUN = '[[run]]\nfile = "a.csv"\nsupport = "rigid"\n'
PEAKS = '[[peaks]]\nsupport = "rigid"\nfrequencies_Hz = [95.0, 320.0]\nstd_Hz = [1.5, 3.0]\n'


def folder_with(tmp_path: Path, toml: str, **files: str) -> Path:
    """A campaign folder; keywords are CSV files by stem."""
    (tmp_path / "campaign.toml").write_text(toml, encoding="utf-8")
    for stem, text in files.items():
        (tmp_path / f"{stem}.csv").write_text(text, encoding="utf-8")
    return tmp_path


def refusal(folder: Path) -> str:
    """The message a folder is refused with, its paths written from the folder."""
    with pytest.raises(MeasurementError) as refused:
        load_campaign(folder)
    assert "\n" not in str(refused.value)
    return str(refused.value).replace(f"{folder}/", "").replace(str(folder), ".")


def test_the_campaign_of_the_contract_is_loaded(tmp_path):
    campaign = load_campaign(folder_with(tmp_path, CONTRACT, run01_rigid_1N=CSV))
    assert (campaign.title, campaign.rig) == ("ball bearing, shaker at node 2", "nit-rourkela")
    assert campaign.nominal == NominalBelief(0.002, 20.0, 0.02, 1e-4)
    (run,), (peaks,) = campaign.runs, campaign.peaks
    assert (run.name, run.support, run.quantity, run.force_amplitude_N) == (
        "run01_rigid_1N",
        "rigid",
        "accelerance",
        1.0,
    )
    np.testing.assert_array_equal(run.H, [[1 + 2j], [3 + 4j]])
    np.testing.assert_array_equal(peaks.frequencies_hz, [95.0, 320.0])
    np.testing.assert_array_equal(peaks.std_hz, [1.5, 3.0])


def test_the_example_of_the_documentation_is_a_campaign_and_every_key_is_documented(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "campaign-format.md").read_text(encoding="utf-8")
    toml, csv = (text.split(f"```{kind}\n")[1].split("```")[0] for kind in ("toml", "csv"))
    campaign = load_campaign(folder_with(tmp_path, toml, run01_rigid_1N=csv))
    assert [len(run.frequency_hz) for run in campaign.runs] == [3]
    keys = [*RunSettings.__annotations__, *vars(NominalBelief()), "title", "rig", "file", "frequencies_Hz", "std_Hz"]
    assert [key for key in keys if f"\n| `{key}` |" not in text] == []


def test_standard_errors_may_be_missing(tmp_path):
    assert load_campaign(folder_with(tmp_path, HEAD + RUN, a=CSV)).runs[0].std is None


def test_damping_that_the_campaign_leaves_out_is_the_rigs(tmp_path):
    folder = folder_with(tmp_path, HEAD + RUN, a=CSV)
    assert load_campaign(folder).nominal.shaft_damping_ratio == load_rig("nit-rourkela").shaft_damping_ratio
    shutil.copy(EXAMPLES / "own_rotor.toml", folder / "rig.toml")
    for told, expected in (("", 0.002), ("[nominal]\nshaft_damping_ratio = 0.004\n", 0.004)):
        text = HEAD.replace("nit-rourkela", "rig.toml") + told + RUN
        assert load_campaign(folder_with(tmp_path, text, a=CSV)).nominal.shaft_damping_ratio == expected


def test_the_bearings_damper_and_the_exciters_node_are_the_rigs_too(tmp_path):
    folder = folder_with(tmp_path, HEAD.replace("nit-rourkela", "rig.toml") + RUN, a=CSV)
    own = (EXAMPLES / "own_rotor.toml").read_text(encoding="utf-8")
    (folder / "rig.toml").write_text("bearing_damping_Ns_per_m = 12.5\n" + own, encoding="utf-8")
    campaign = load_campaign(folder)
    assert campaign.nominal.bearing_damping_Ns_per_m == 12.5
    assert campaign.runs[0].excitation_node == load_rig(folder / "rig.toml").excitation_node == 4
    text = HEAD.replace("nit-rourkela", "rig.toml") + "[nominal]\nbearing_damping_Ns_per_m = 0\n" + RUN
    campaign = load_campaign(folder_with(tmp_path, text + "excitation_node = 3\n", a=CSV))
    assert campaign.nominal.bearing_damping_Ns_per_m == 0
    assert campaign.runs[0].excitation_node == 3


def test_a_damping_is_known_better_where_it_is_stated_and_repeatability_is_learned(tmp_path):
    stated = load_campaign(folder_with(tmp_path, CONTRACT, run01_rigid_1N=CSV)).nominal
    assert (stated.shaft_damping_tolerance, stated.bearing_damping_tolerance) == (0.1, 0.1)
    assert (stated.modulus_tolerance, stated.disk_mass_tolerance, stated.span_tolerance) == (0.01, 0.005, 0.001)
    table = '[nominal]\nbearing_damping_tolerance = 0.3\nfrequency_drift = "learned"\nsensor_mass_kg = 0.012\n'
    left_out = load_campaign(folder_with(tmp_path, HEAD + table + RUN, a=CSV)).nominal
    assert (left_out.shaft_damping_tolerance, left_out.bearing_damping_tolerance) == (0.7, 0.3)
    assert (left_out.frequency_drift, left_out.gain_repeatability, left_out.sensor_mass_kg) == (None, None, 0.012)
    folder_with(tmp_path, HEAD + '[nominal]\nfrequency_drift = "lerned"\n' + RUN, a=CSV)
    assert refusal(tmp_path) == 'campaign.toml: nominal frequency_drift: give a number, or "learned"'


def test_resonance_lists_alone_make_a_campaign(tmp_path):
    campaign = load_campaign(folder_with(tmp_path, HEAD + PEAKS))
    assert campaign.runs == ()
    assert campaign.nominal == NominalBelief(shaft_damping_tolerance=0.7, bearing_damping_tolerance=0.7)


def test_every_key_of_a_run_reaches_the_run(tmp_path):
    keys = (
        'excitation_node = 3\nexcitation_plane = "z"\nforce_amplitude_N = "unknown"\nspin_rpm = -600\nsweep = "down"\n'
    )
    run = load_campaign(folder_with(tmp_path, HEAD + RUN + keys + 'quantity = "mobility"\n', a=CSV)).runs[0]
    assert (run.excitation_node, run.excitation_plane, run.force_amplitude_N) == (3, "z", None)
    assert (run.spin_rpm, run.sweep, run.quantity) == (-600.0, "down", "mobility")


def test_a_rig_path_counts_from_the_campaigns_folder(tmp_path, monkeypatch):
    shutil.copy(EXAMPLES / "own_rotor.toml", tmp_path / "ours.toml")
    folder = tmp_path / "campaign"
    folder.mkdir()
    folder_with(folder, 'rig = "../ours.toml"\n' + PEAKS)
    monkeypatch.chdir("/")
    assert load_campaign(folder).rig == str((tmp_path / "ours.toml").resolve())


def test_data_files_may_lie_in_subfolders_and_one_file_may_serve_two_runs(tmp_path):
    (tmp_path / "day1").mkdir()
    (tmp_path / "day1" / "a.csv").write_text(CSV)
    toml = HEAD + RUN.replace("a.csv", "day1/a.csv") + RUN.replace("a.csv", "day1/a.csv") + RUN
    campaign = load_campaign(folder_with(tmp_path, toml, a=CSV))
    assert [run.name for run in campaign.runs] == ["day1/a", "day1/a-2", "a"]


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("rig = nit-rourkela\n", "not valid TOML: "),
        (PEAKS, "rig: is missing; write it"),
        (f'rig = "{"n" * 5000}"\n' + PEAKS, "rig: no rig file nnn"),
        ('rig = "n\\u0000"\n' + PEAKS, "rig: no rig file "),
        (HEAD + RUN.replace("a.csv", "a" * 5000), "run 1 file: no such data file 'aaa"),
        (HEAD + RUN.replace("a.csv", "\\u0000"), "run 1 file: no such data file "),
        (HEAD, "no [[run]] and no [[peaks]]; a campaign needs at least one of either"),
        (
            'rig = "nit-rurkela"\n' + PEAKS,
            "rig: no rig file nit-rurkela; did you mean nit-rourkela? give the path of a rig TOML",
        ),
        (HEAD + 'titel = "x"\n' + PEAKS, "titel: unknown key; did you mean title?"),
        (HEAD + RUN.replace("[[run]]", "[[runs]]"), "runs: unknown key; did you mean run?"),
        (HEAD + "author = 1\n" + PEAKS, "author: unknown key; check its spelling or remove it"),
        (HEAD + "[nominal]\ngain = 0.02\n" + PEAKS, "nominal gain: unknown key"),
        (
            HEAD + "[nominal]\nshaft_damping_ratio = 2\n" + PEAKS,
            "nominal shaft_damping_ratio: Input should be less than or equal to 0.2",
        ),
        (
            HEAD + "[nominal]\ngain_tolerance = -0.1\nfrequency_drift = nan\n" + PEAKS,
            "nominal gain_tolerance: Input should be greater than or equal to 0; nominal frequency_drift: ",
        ),
        (
            HEAD + RUN + RUN + "excitation = 2\nforce = 1\n",
            "run 2 excitation: unknown key; did you mean excitation_node?; run 2 force: unknown key",
        ),
        (HEAD + RUN.replace('"rigid"', '"fixed"'), "run 1 support: Input should be 'rigid' or 'bearing'"),
        (HEAD + '[[run]]\nfile = "a.csv"\n', 'run 1: support is missing; say support = "rigid" or "bear'),
        (HEAD + '[[run]]\nsupport = "rigid"\n', "run 1 file: is missing"),
        (HEAD + RUN + "excitation_node = 2.5\n", "run 1 excitation_node: Input should be a valid integer"),
        (HEAD + RUN + 'force_amplitude_N = "weak"\n', "run 1 force_amplitude_N: Input should be a valid num"),
        (HEAD + RUN + 'sweep = "both"\n', "run 1 sweep: Input should be 'up' or 'down'"),
        (HEAD + RUN.replace("a.csv", "b.csv"), "run 1 file: no such data file 'b.csv'; correct the name"),
        (
            HEAD + RUN.replace("a.csv", "data\\run.csv"),
            "run 1 file: no such data file 'data\\run.csv'; correct the name, and write folders with /",
        ),
        (HEAD + RUN.replace("[[run]]", "[run]"), "run: is one table; write [[run]] above each"),
        (HEAD + PEAKS.replace("[[peaks]]", "[peaks]"), "peaks: is one table; write [[peaks]] above each"),
        (HEAD + RUN.replace("a.csv", "campaign.toml"), "unknown kind of file; a run is one of .csv, .uff"),
        (HEAD + PEAKS.replace("3.0", "-3.0"), "peaks 1 std_Hz 2: Input should be greater than 0"),
        (
            HEAD + PEAKS.replace(", 3.0", ""),
            "peaks 1: frequencies_Hz has 2 numbers and std_Hz 1; give one for each peak",
        ),
        (HEAD + PEAKS.replace("320.0", "95.0"), "peaks 1: frequencies_Hz names a resonance twice; remove one"),
        (HEAD + PEAKS.replace('"rigid"', '"free"'), "peaks 1 support: Input should be 'rigid' or 'bearing'"),
        (HEAD + PEAKS.replace("95.0, 320.0", ""), "peaks 1 frequencies_Hz: List should have at least 1 item"),
    ],
)
def test_a_wrong_campaign_is_refused_with_file_and_key(tmp_path, toml, message):
    assert refusal(folder_with(tmp_path, toml, a=CSV)).startswith(f"campaign.toml: {message}")


def test_an_error_in_a_data_file_names_that_file_and_its_line(tmp_path):
    message = refusal(folder_with(tmp_path, HEAD + RUN, a=CSV + "97,1,two\n"))
    assert message.startswith("a.csv, line 4, column node2_im: 'two' is not a number")


def test_a_missing_folder_and_a_folder_without_campaign_are_named(tmp_path):
    with pytest.raises(MeasurementError, match=r"nowhere: no such folder; give the folder that holds campaign\.toml"):
        load_campaign(tmp_path / "nowhere")
    assert refusal(tmp_path).startswith(".: holds no campaign.toml; write one")


def test_a_campaign_in_another_encoding_is_refused(tmp_path):
    (tmp_path / "campaign.toml").write_bytes((HEAD + 'title = "W\xe4lzlager"\n' + PEAKS).encode("latin-1"))
    assert refusal(tmp_path).startswith("campaign.toml: not a text file in UTF-8")


# --- saving --------------------------------------------------------------------------------------


def a_campaign(**changes) -> Campaign:
    campaign = Campaign(
        title='rough "ball" bearing \\ ø 20 mm\n\x7f\x01 \U0001f600',
        rig="nit-rourkela",
        runs=(a_run(name="rigid 1 N"), a_run(name="up/0.5N", force_amplitude_N=None, sweep="up")),
        peaks=(PeakList("bearing", np.array([95.1, 320.0]), np.array([1e-30, 3.0])),),
        nominal=NominalBelief(0.002, 1 / 3, 0.05, 2e-5),
    )
    return dataclasses.replace(campaign, **changes)


def assert_same_campaign(loaded: Campaign, saved: Campaign, *, sign_of_zero: bool = True) -> None:
    assert (loaded.title, loaded.rig, loaded.nominal) == (saved.title, saved.rig, saved.nominal)
    for read, written in zip(loaded.runs, saved.runs, strict=True):
        assert_same_run(read, written, sign_of_zero=sign_of_zero)
    for read, written in zip(loaded.peaks, saved.peaks, strict=True):
        assert read.support == written.support
        np.testing.assert_array_equal(read.frequencies_hz, written.frequencies_hz)
        np.testing.assert_array_equal(read.std_hz, written.std_hz)


@pytest.mark.parametrize("file_format", ["csv", "uff", "unv", "h5", "mat"])
def test_a_saved_campaign_is_loaded_unchanged(tmp_path, file_format):
    save_campaign(a_campaign(), tmp_path / "new" / "campaign", file_format)
    loaded = load_campaign(tmp_path / "new" / "campaign")
    assert_same_campaign(loaded, a_campaign(), sign_of_zero=file_format not in ("uff", "unv"))


@given(title=st.text(st.characters(exclude_categories=["Cs"])), run=runs())
@settings(max_examples=30, deadline=None)
def test_any_title_and_any_run_survive(tmp_path_factory, title, run):
    folder = tmp_path_factory.mktemp("campaign")
    campaign = Campaign(title=title, rig="nit-rourkela", runs=(run,))
    save_campaign(campaign, folder)
    assert_same_campaign(load_campaign(folder), campaign)


def test_campaign_toml_says_every_setting_in_the_contracts_words(tmp_path):
    save_campaign(a_campaign(), tmp_path)
    with (tmp_path / "campaign.toml").open("rb") as file:
        first, second = tomllib.load(file)["run"]
    assert first == {
        "file": "rigid 1 N.csv",
        "support": "bearing",
        "excitation_node": 2,
        "excitation_plane": "y",
        "force_amplitude_N": 1.0,
        "spin_rpm": 0.0,
        "quantity": "accelerance",
    }
    assert (second["file"], second["force_amplitude_N"], second["sweep"]) == ("up/0.5N.csv", "unknown", "up")


def test_a_rig_file_is_found_again_when_the_folder_moves(tmp_path, monkeypatch):
    folder = tmp_path / "here"
    folder.mkdir()
    shutil.copy(EXAMPLES / "own_rotor.toml", folder / "ours.toml")
    monkeypatch.chdir(folder)
    save_campaign(a_campaign(rig="ours.toml"), folder)
    folder.rename(tmp_path / "there")
    assert load_campaign(tmp_path / "there").rig == str((tmp_path / "there" / "ours.toml").resolve())


def test_run_names_become_safe_and_distinct_file_names(tmp_path):
    names = ["", "", "a:b", "../../etc/x", "a:b", "/"]
    save_campaign(a_campaign(runs=tuple(a_run(name=name) for name in names)), tmp_path)
    assert [r.name for r in load_campaign(tmp_path).runs] == ["run", "run-2", "a_b", "etc/x", "a_b-2", "run-3"]


def test_a_failure_while_saving_leaves_the_old_campaign_untouched(tmp_path, monkeypatch):
    save_campaign(a_campaign(), tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    real = campaign_folder.write_beside

    def fails_at_the_second_run(run, path, beside):
        if run.name == "up/0.5N":
            raise OSError("no space left on device")
        real(run, path, beside)

    monkeypatch.setattr(campaign_folder, "write_beside", fails_at_the_second_run)
    changed = tuple(dataclasses.replace(run, spin_rpm=99.0, H=run.H + 1) for run in a_campaign().runs)
    with pytest.raises(OSError, match="no space left"):
        save_campaign(a_campaign(title="new", runs=changed), tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("changes", "file_format", "problem"),
    [
        ({}, "xlsx", "file_format = 'xlsx' is unknown; a run is one of csv, uff, unv, h5, mat"),
        ({"runs": (), "peaks": ()}, "csv", r"campaign\.toml: no \[\[run\]\] and no \[\[peaks\]\]"),
        (
            {"runs": (a_run(force_amplitude_N=-1.0),)},
            "csv",
            r"campaign\.toml: run 1 force_amplitude_N: Input should be",
        ),
        (
            {"runs": (a_run(name="a", H=a_run().H * np.nan),)},
            "csv",
            r"a\.csv: H of node2 at 95\.000123456789 Hz is not",
        ),
    ],
)
def test_what_could_not_be_loaded_is_not_saved(tmp_path, changes, file_format, problem):
    with pytest.raises(MeasurementError, match=problem):
        save_campaign(a_campaign(**changes), tmp_path / "new", file_format)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_run_read_alone_and_in_its_campaign_is_the_same(tmp_path):
    run = load_campaign(folder_with(tmp_path, HEAD + RUN, a=CSV)).runs[0]
    assert_same_run(run, read_run(tmp_path / "a.csv", support="rigid"))


def test_the_file_of_a_campaign_is_not_its_folder(tmp_path):
    file = tmp_path / "campaign.toml"
    file.write_text(HEAD)
    with pytest.raises(MeasurementError, match="is a file; give its folder"):
        load_campaign(file)
