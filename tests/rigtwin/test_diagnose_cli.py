"""``rigtwin diagnose`` and ``rigtwin predict``: what they ask of gap, write, print and refuse."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.api.diagnoses import measured_on_the_virtual_rig
from rigtwin.api.diagnoses import read_diagnosis as load_diagnosis
from rigtwin.errors import UserError
from rigtwin.gap.document import SCHEMA, Diagnosis
from rigtwin.gap.model.campaign_model import structure_of
from rigtwin.pages.diagnosis_words import VERIFIED
from rigtwin.rotor.effects import EFFECTS
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.campaign import Campaign, Channel, NominalBelief, Run
from rigtwin.sim.campaign_folder import save_campaign
from rigtwin.sim.formats import read_run, run_file
from rigtwin.sim.setup import SetupError
from tests.gap.conftest import MASS, all_but, both_supports, campaign_of
from tests.rigtwin.conftest import run, run_json
from tests.rigtwin.test_diagnose_page import DIAGNOSIS

PAPER = Path(__file__).resolve().parents[2] / "examples" / "nit-rourkela-paper"

# The virtual rig against the frequency response: what is left of the transient, and the FMU's round-off.
SETTLED = 1e-6

CHANNELS = (Channel(2), Channel(4))
F_HZ = np.linspace(60.0, 110.0, 7)


def plain_run(name: str, **settings: Any) -> Run:
    H = np.column_stack([F_HZ * (1 + 2j), F_HZ * (3 - 1j)])
    return Run(F_HZ, H, CHANNELS, "bearing", name=name, **settings)


@dataclass(frozen=True)
class Outcome:
    """Stands in for gap.diagnose.Outcome."""

    diagnosis: Diagnosis
    curves: tuple[Any, ...] = ()


@dataclass
class Asked:
    """Stands in for gap.diagnose.diagnose; keeps what it was asked."""

    diagnosis: Diagnosis = DIAGNOSIS
    campaigns: list[Campaign] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)

    def __call__(self, campaign: Campaign, **options: Any) -> Outcome:
        self.campaigns.append(campaign)
        self.options = options
        options["progress"](3, 10, "single effects")
        return Outcome(self.diagnosis)


@pytest.fixture
def asked(monkeypatch) -> Asked:
    """A diagnosis that takes no time."""
    asked = Asked()
    monkeypatch.setattr("rigtwin.gap.diagnose.diagnose", asked)
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # no helpers for what takes no time
    return asked


@pytest.fixture
def campaign(tmp_path) -> Path:
    """A folder with two runs, one of them in a folder of its own."""
    folder = tmp_path / "campaign"
    save_campaign(Campaign("two runs", "nit-rourkela", (plain_run("first"), plain_run("more/second"))), folder)
    return folder


# --- diagnose --------------------------------------------------------------------------------------


def test_diagnose_leaves_a_document_and_a_page(asked, campaign, tmp_path):
    result = run("diagnose", campaign, "--out", tmp_path / "new" / "out")
    assert result.exit_code == 0, result.stderr
    assert {path.name for path in (tmp_path / "new" / "out").iterdir()} == {"diagnosis.json", "report.html"}
    assert (tmp_path / "new" / "out" / "diagnosis.json").read_text(encoding="utf-8") == DIAGNOSIS.to_json()
    assert DIAGNOSIS.sentence.split("(")[0] in (tmp_path / "new" / "out" / "report.html").read_text(encoding="utf-8")


def test_diagnose_prints_verdict_causes_shrink_warnings_and_where_the_page_is(asked, campaign, tmp_path):
    result = run("diagnose", campaign, "--out", tmp_path / "out")
    lines = result.stdout.splitlines()
    assert lines[0] == DIAGNOSIS.sentence
    (row,) = (line.split() for line in lines if line.strip().startswith("Pedestal flexibility   "))
    assert row[:7] == ["Pedestal", "flexibility", "at", "the", "bearings", "93", "%"]
    for said in (
        "Open crack: reduction at the end of the range that was searched",
        "gap on the run on bearings at 2 N: 31.4 % before, 1.31 % after; noise alone leaves 1.10 %; gains and "
        "tolerances alone leave 20.7 %",
        "99.3 % of what can be explained is explained; with another node driven, expect 98.1 % to 99.9 %; "
        "verified by the FMU",
        "next: Measure on bearings at 4 N with an accelerometer on the pedestal.",
        "warning: rigid-1: 2 lines in the half-power band of mode 1: refine the raster.",
        f"{tmp_path / 'out' / 'report.html'} and diagnosis.json written",
    ):
        assert said in lines, said
    assert "Lines 30 to 32 Hz are missing" not in result.stdout  # a note stands on the page alone
    assert result.stderr == ""  # no progress bar where there is no terminal


def test_candidates_of_a_verdict_without_a_cause_are_not_printed_as_causes(asked, campaign, tmp_path):
    asked.diagnosis = replace(DIAGNOSIS, verdict="unknown", sentence="None fits.", shrink=None)
    result = run("diagnose", campaign, "--out", tmp_path / "out")
    assert result.stdout.splitlines()[1].startswith("No cause is named.")


def test_with_json_stdout_is_the_document_alone(asked, campaign, tmp_path):
    result = run("diagnose", campaign, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["schema"] == SCHEMA
    assert result.stdout == (tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8")


def test_the_diagnosis_gets_the_campaign_the_exclusions_and_the_virtual_rig(asked, campaign, tmp_path):
    options = ("--exclude", "open_crack", "--exclude", "rub", "--exclude", "rub")
    run("diagnose", campaign, "--out", tmp_path / "out", *options)
    assert [r.name for r in asked.campaigns[0].runs] == ["first", "more/second"]
    assert asked.options["exclude"] == ("open_crack", "rub")
    several = ("--exclude", "open_crack", "rub", campaign, "--exclude", "unbalance,gyroscopic")
    run("diagnose", *several, "--out", tmp_path / "out")
    assert asked.options["exclude"] == ("open_crack", "rub", "unbalance", "gyroscopic")
    assert callable(asked.options["confirm"])
    run("diagnose", campaign, "--out", tmp_path / "out", "--no-fmu")
    assert asked.options["exclude"] == ()
    assert asked.options["confirm"] is None


def test_fits_are_shared_among_as_many_processes_as_asked_for(asked, campaign, tmp_path):
    run("diagnose", campaign, "--out", tmp_path / "out", "--workers", 1)
    assert asked.options["helpers"] is None
    run("diagnose", campaign, "--out", tmp_path / "out", "--workers", 2)
    assert isinstance(asked.options["helpers"], Executor)


def test_an_interrupted_diagnosis_leaves_the_one_before(monkeypatch, campaign, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    (tmp_path / "diagnosis.json").write_text("before")
    monkeypatch.setattr("rigtwin.gap.diagnose.diagnose", interrupted)
    assert run("diagnose", campaign, "--out", tmp_path).exit_code == 130
    assert {path.name for path in tmp_path.iterdir()} == {"campaign", "diagnosis.json"}
    assert (tmp_path / "diagnosis.json").read_text() == "before"


def test_an_interrupted_diagnosis_leaves_no_empty_folder(monkeypatch, campaign, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("rigtwin.gap.diagnose.diagnose", interrupted)
    assert run("diagnose", campaign, "--out", tmp_path / "new").exit_code == 130
    assert not (tmp_path / "new").exists()


def test_a_page_that_is_interrupted_leaves_the_document_before(asked, monkeypatch, campaign, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    (tmp_path / "diagnosis.json").write_text("before")
    monkeypatch.setattr("rigtwin.api.diagnoses.write_diagnosis_page", interrupted)
    assert run("diagnose", campaign, "--out", tmp_path).exit_code == 130
    assert {path.name for path in tmp_path.iterdir()} == {"campaign", "diagnosis.json"}
    assert (tmp_path / "diagnosis.json").read_text() == "before"


@pytest.mark.parametrize("name", ["diagnosis.json", "report.html"])
def test_a_file_that_fails_half_way_leaves_the_one_before(asked, monkeypatch, campaign, tmp_path, name):
    write = Path.write_text

    def broken(path: Path, text: str, **options: Any) -> int:
        if name not in path.name:
            return write(path, text, **options)
        write(path, text[: len(text) // 2], **options)
        raise OSError(28, "No space left on device", str(path))

    (tmp_path / "report.html").write_text("before")
    (tmp_path / "diagnosis.json").write_text("before")
    monkeypatch.setattr(Path, "write_text", broken)
    result = run("diagnose", campaign, "--out", tmp_path)
    assert result.exit_code == 2
    assert "No space left on device" in result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"campaign", "diagnosis.json", "report.html"}
    assert (tmp_path / name).read_text() == "before"


def test_wrong_input_of_diagnose_is_refused_before_any_work(refused, asked, campaign, tmp_path):
    out = tmp_path / "out"
    message = refused("diagnose", campaign, "--out", out, "--exclude", "open_crak")
    assert message.startswith("--exclude: there is no effect 'open_crak'; did you mean open_crack?")
    message = refused("diagnose", "--exclude", "rub", "open_crak", campaign, "--out", out)
    assert message.startswith("--exclude: there is no effect 'open_crak'; did you mean open_crack?")
    assert "no such folder" in refused("diagnose", tmp_path / "nosuch", "--out", out)
    assert "holds no campaign.toml" in refused("diagnose", tmp_path, "--out", out)
    assert not out.exists()
    lines = (campaign / "first.csv").read_text().splitlines()
    (campaign / "first.csv").write_text("\n".join([*lines[:3], "x" + lines[3], *lines[4:]]))
    assert "first.csv, line 4, column frequency_Hz" in refused("diagnose", campaign, "--out", out)
    assert asked.campaigns == []


def test_an_output_folder_that_cannot_be_made_is_named_before_any_work(refused, asked, campaign, tmp_path):
    (tmp_path / "file").touch()
    assert f"{tmp_path}/file" in refused("diagnose", campaign, "--out", tmp_path / "file")
    assert asked.campaigns == []


def test_asking_for_help_loads_no_diagnosis():
    watch = "import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); "
    script = watch + "from rigtwin.cli import main; sys.argv = ['rigtwin', 'diagnose', '--help']; main()"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert {name.split(".")[0] for name in done.stderr.split()} & {"gap", "numpy", "plotly"} == set()


# --- the virtual rig -------------------------------------------------------------------------------


def test_the_virtual_rig_measures_what_the_effects_do_to_each_run():
    """Settings, quantity, damping and effects of every run reach the FMU: it gives the rotor's own response."""
    pedestal, gain = EFFECTS["pedestal_flexibility"](stiffness=8e6), EFFECTS["sensor_gain"](gain=1.1, node=4)
    runs = (
        plain_run("mobility", quantity="mobility", excitation_node=4, excitation_plane="y"),
        replace(plain_run("rigid"), support="rigid"),
    )
    campaign = Campaign("", "nit-rourkela", runs, nominal=NominalBelief(0.004, 30.0))
    measured, verified = measured_on_the_virtual_rig(campaign, runs, (pedestal, gain), 5e6)
    assert verified == "rig"  # the gain is none of the FMU's effects
    condition = Condition(k_b=5e6, bearing_damping=30.0, shaft_damping_ratio=0.004)
    structure = structure_of("nit-rourkela")
    for run_, H in zip(runs, measured, strict=True):
        here = replace(condition, rigid_support=run_.support == "rigid", excitation_node=run_.excitation_node)
        expected = measured_response(
            structure, here, (pedestal, gain), F_HZ, [2, 4], quantity=run_.quantity  # type: ignore[arg-type]
        )  # fmt: skip
        assert_allclose(H, expected, rtol=0, atol=SETTLED * np.abs(expected).max())


def test_the_virtual_rig_has_accelerometers_where_the_run_has_them():
    """Across the force, too; and a force that is measured is not dropped."""
    effects = EFFECTS["plane_anisotropy"](), EFFECTS["force_dropout"](mass=0.3)
    channels = tuple(Channel(node, plane) for plane in "zy" for node in (2, 4))  # type: ignore[arg-type]
    per_force = Run(F_HZ, np.zeros((len(F_HZ), 4), complex), channels, support="bearing", force_amplitude_N=2.0)
    runs = per_force, replace(per_force, quantity="acceleration")
    campaign = Campaign("", "nit-rourkela", runs, nominal=NominalBelief(0.004, 30.0))
    measured, verified = measured_on_the_virtual_rig(campaign, runs, effects, 1e6)
    assert verified == "rig"
    here = Condition(k_b=1e6, bearing_damping=30.0, shaft_damping_ratio=0.004)
    structure = structure_of("nit-rourkela")
    for run_, acting, H in zip(runs, (effects[:1], effects), measured, strict=True):
        across, along = (
            measured_response(
                structure, here, acting, F_HZ, [2, 4], plane=plane, quantity=run_.quantity, force_amplitude=2.0
            )  # type: ignore[arg-type]
            for plane in (2, 1)
        )
        assert_allclose(H, np.hstack([across, along]), rtol=0, atol=SETTLED * np.abs(along).max())
        assert np.abs(across).max() > 0.01 * np.abs(along).max()


def test_the_virtual_rig_comes_to_a_nonlinear_line_as_the_measured_rig_did():
    """At 88 Hz the hardening rotor has two motions; only a sweep that comes from lower lines finds the larger one."""
    f, channels = np.arange(80.0, 88.6, 0.5), (Channel(4, "y"),)
    whole = Run(f, np.zeros((len(f), 1), complex), channels, support="bearing", force_amplitude_N=15.0, sweep="up")
    swept = whole.on_lines(f == 88.0)
    campaign = Campaign("", "nit-rourkela", (whole,), nominal=NominalBelief(0.02, 50.0))
    runs = swept, replace(swept, swept_hz=None)
    (upper, lower), _ = measured_on_the_virtual_rig(campaign, runs, (EFFECTS["bearing_cubic"](stiffness=1e15),), 1.3e6)
    assert np.abs(upper / lower) > 2


def test_an_effect_of_the_rotor_is_verified_by_the_fmu_and_tells_how_far_it_is():
    run_ = replace(plain_run("one"), support="rigid")
    campaign = Campaign("", "nit-rourkela", (run_,))
    told: list[tuple[int, int, str]] = []
    effects = (EFFECTS["attached_mass"](),)
    _, verified = measured_on_the_virtual_rig(campaign, (run_, run_), effects, 1e7, lambda *step: told.append(step))
    assert verified == "fmu"
    assert [(done, total) for done, total, _ in told] == [(0, 2), (0, 2), (1, 2)]
    assert told[-1][2] == "virtual rig: run 2 of 2"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KeyboardInterrupt(), "was interrupted"),
        (RuntimeError("unsettled"), "does not confirm the cause (unsettled)"),
        (SetupError("no such node"), "does not confirm the cause (no such node)"),
        (UserError("no compiler"), "does not confirm the cause (no compiler)"),
        (OSError("disk full"), "does not confirm the cause (disk full)"),
    ],
)
def test_a_virtual_rig_without_an_answer_leaves_the_diagnosis_its_own_figure(
    asked, campaign, tmp_path, monkeypatch, caplog, error, said
):
    def fails(*_):
        raise error

    run("diagnose", campaign, "--out", tmp_path / "out")
    monkeypatch.setattr("rigtwin.api.diagnoses.measured_on_the_virtual_rig", fails)
    assert asked.options["confirm"]((plain_run("one"),), (), 1e7) == ([], "model")
    assert f"the virtual rig {said}: the after-figure is the fitting model's own" in caplog.text


# --- predict ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Predicted:
    """Stands in for gap.predict.Predicted."""

    run: Run
    nominal: Run
    corrected: Run


@pytest.fixture
def predicted(monkeypatch) -> list[Diagnosis]:
    """A prediction that doubles and triples what was measured; keeps the documents it was given."""
    documents: list[Diagnosis] = []

    def predict(document: Diagnosis, campaign: Campaign) -> tuple[Predicted, ...]:
        documents.append(document)
        return tuple(Predicted(r, replace(r, H=2 * r.H), replace(r, H=3 * r.H)) for r in campaign.runs)

    monkeypatch.setattr("rigtwin.gap.predict.predict", predict)
    return documents


@pytest.fixture
def document(tmp_path) -> Path:
    """diagnosis.json."""
    return DIAGNOSIS.save(tmp_path / "diagnosed")


def test_predict_writes_every_run_twice_on_its_own_lines(predicted, document, campaign, tmp_path):
    result = run("predict", document, campaign, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    files = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    runs = {f"{kind}/{name}.csv" for kind in ("nominal", "corrected") for name in ("first", "more/second")}
    assert files == {*runs, "prediction.html"}
    for kind, factor in (("nominal", 2), ("corrected", 3)):
        again = read_run(tmp_path / "out" / kind / "more" / "second.csv", support="bearing")
        assert_allclose(again.H, factor * plain_run("").H, rtol=0)
        assert_allclose(again.frequency_hz, F_HZ, rtol=0)
    assert predicted[0].causes[0].effects == ("pedestal_flexibility",)
    assert "2 runs written" in result.stdout
    gaps = run_json("predict", document, campaign, "--out", tmp_path / "out")["runs"]
    assert [(one["gap_nominal"], one["gap_corrected"]) for one in gaps] == [(1.0, 2.0)] * 2  # doubled and tripled
    assert "gap, nominal model" in result.stdout
    assert (tmp_path / "out" / "prediction.html").read_text(encoding="utf-8").count('class="figure"') >= 2
    assert "names no cause" not in result.stderr


def test_predict_says_where_a_diagnosis_does_not_know_the_bearings(predicted, campaign, tmp_path):
    for nominal, said in ((DIAGNOSIS.nominal, False), (DIAGNOSIS.nominal | {"k_b": None}, True)):
        document = replace(DIAGNOSIS, nominal=nominal).save(tmp_path / f"diagnosed {said}")
        result = run("predict", document, campaign, "--out", tmp_path / "out")
        assert (result.exit_code, "does not say k_b" in result.stderr) == (0, said)


def test_predict_says_where_a_diagnosis_names_no_cause(predicted, campaign, tmp_path):
    document = replace(DIAGNOSIS, verdict="unknown").save(tmp_path / "diagnosed")
    result = run("predict", document, campaign, "--out", tmp_path / "out")
    assert (result.exit_code, "names no cause" in result.stderr) == (0, True)


def test_a_prediction_that_is_interrupted_leaves_all_files_as_they_were(
    predicted, document, campaign, tmp_path, monkeypatch
):
    csv, count = run_file._FORMATS[".csv"], [0]

    def interrupted(run_: Run, path: Path) -> None:
        count[0] += 1
        csv.write(run_, path)
        if count[0] == 3:
            raise KeyboardInterrupt

    old = tmp_path / "out" / "nominal" / "first.csv"
    old.parent.mkdir(parents=True)
    old.write_text("before")
    monkeypatch.setitem(run_file._FORMATS, ".csv", csv._replace(write=interrupted))
    assert run("predict", document, campaign, "--out", tmp_path / "out").exit_code == 130
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == [old]
    assert old.read_text() == "before"


def test_no_run_is_written_outside_the_output_folder(predicted, document, tmp_path):
    inside = tmp_path / "a" / "campaign"
    save_campaign(Campaign("", "nit-rourkela", (plain_run("run"),)), inside)
    (tmp_path / "a" / "elsewhere.csv").write_text((inside / "run.csv").read_text())
    toml = (inside / "campaign.toml").read_text().replace("run.csv", "../elsewhere.csv")
    (inside / "campaign.toml").write_text(toml)
    before = {path for path in tmp_path.rglob("*") if path.is_file()}
    assert run("predict", document, inside, "--out", tmp_path / "out").exit_code == 0
    new = {path for path in tmp_path.rglob("*") if path.is_file()} - before
    runs = {tmp_path / "out" / kind / "elsewhere.csv" for kind in ("nominal", "corrected")}
    assert new == {*runs, tmp_path / "out" / "prediction.html"}


def test_a_campaign_of_resonance_lists_has_no_line_to_predict(refused, predicted, document, tmp_path):
    assert "only resonance lists" in refused("predict", document, PAPER, "--out", tmp_path / "out")


def test_a_diagnosis_of_another_rig_is_remarked_on(predicted, campaign, tmp_path):
    other = replace(DIAGNOSIS, rig="stepped-cantilever").save(tmp_path / "diagnosed")
    result = run("predict", other, campaign, "--out", tmp_path / "out")
    assert (result.exit_code, len(result.stderr.splitlines())) == (0, 1)
    assert "is of the rig stepped-cantilever" in result.stderr


def test_a_missing_document_is_named(refused, campaign, tmp_path):
    assert "nosuch.json: no such file" in refused("predict", tmp_path / "nosuch.json", campaign, "--out", tmp_path)


def without(key: str) -> Callable[[dict[str, Any]], Any]:
    return lambda document: document.pop(key)


def set_cause(**entries: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda document: document["causes"][0].update(entries)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda document: document.update(schema="rigtwin.diagnosis/9"), "schema is 'rigtwin.diagnosis/9', not"),
        (without("schema"), "schema is None"),
        (without("nominal"), "nominal is missing; the file is damaged"),
        (lambda document: document.update(causes={}), "causes is '{}'"),
        (lambda document: document["causes"].append(7), "cause 4 is '7'"),
        (lambda document: document["causes"][1].pop("parameters"), "cause 2 parameters is missing"),
        (set_cause(effects=["pedestal_flexibilty"]), "cause 1: there is no effect 'pedestal_flexibilty'; did you mean"),
        (set_cause(k_b="soft"), "cause 1 k_b is 'soft'"),
    ],
    ids=["another schema", "no schema", "no nominal", "causes", "cause", "parameters", "effect", "k_b"],
)
def test_a_damaged_document_is_refused_with_what_is_wrong(
    refused, predicted, document, campaign, tmp_path, damage, said
):
    content = json.loads(document.read_text(encoding="utf-8"))
    damage(content)
    document.write_text(json.dumps(content), encoding="utf-8")
    message = refused("predict", document, campaign, "--out", tmp_path / "out")
    assert message.startswith(f"{document}: ")
    assert said in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "line 1: not valid JSON"),
        (b'{"schema":\n', "line 2: not valid JSON"),
        (b"[1]", "schema is None"),
        (b"\xff\xfe", "not a text file"),
    ],
)
def test_what_is_no_document_is_refused(refused, predicted, campaign, tmp_path, content, said):
    (tmp_path / "diagnosis.json").write_bytes(content)
    assert said in refused("predict", tmp_path / "diagnosis.json", campaign, "--out", tmp_path / "out")


def test_every_document_that_is_written_is_read_again_as_it_was(tmp_path):
    """Numbers that are not finite become null, and null is no damage."""
    few = Diagnosis("", "nit-rourkela", "not_enough_data", "", {"k_b": None, "gap": float("nan")}, DIAGNOSIS.where)
    for diagnosis in (DIAGNOSIS, few):
        again = load_diagnosis(diagnosis.save(tmp_path))
        assert json.loads(again.to_json()) == json.loads(diagnosis.to_json())


# --- all of it -------------------------------------------------------------------------------------


def test_a_campaign_on_disk_becomes_a_verified_diagnosis_and_a_prediction(tmp_path):
    runs = both_supports(MASS, seed=3)
    save_campaign(replace(campaign_of(*runs), title="a mass at node 3"), tmp_path / "campaign")
    excluded = ",".join(all_but("attached_mass", "disk_mass"))
    done = run("diagnose", tmp_path / "campaign", "--out", tmp_path / "out", "--workers", 1, "--exclude", excluded)
    assert done.exit_code == 0, done.stderr
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert (document["verdict"], document["causes"][0]["effects"]) == ("cause", ["attached_mass"])
    assert set(document["causes"][0]["parameters"]) == {"mass"}
    assert document["shrink"]["verified_by"] == "fmu"
    assert_allclose(document["shrink"]["after"], document["shrink"]["after_model"], rtol=0.01)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for said in ("a mass at node 3", document["sentence"].split(" (")[0], VERIFIED["fmu"]):
        assert said in page, said
    assert page.count('class="figure"') >= 4
    done = run("predict", tmp_path / "out" / "diagnosis.json", tmp_path / "campaign", "--out", tmp_path / "predicted")
    assert done.exit_code == 0, done.stderr
    for measured in runs:
        nominal, corrected = (
            read_run(tmp_path / "predicted" / kind / f"{measured.name}.csv", support=measured.support)
            for kind in ("nominal", "corrected")
        )
        off = [np.linalg.norm(each.H - measured.H) for each in (nominal, corrected)]
        assert off[1] < 0.2 * off[0]
