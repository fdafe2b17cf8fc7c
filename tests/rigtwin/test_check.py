"""The gate: good FMUs pass, each kind of bad one fails its own gate, and the report says so."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from rigtwin.api.checks import NotRun, refuses
from rigtwin.api.fmus import manifest
from tests.rigtwin.conftest import run, run_json


def altered(fmu: Path, target: Path, member: str, change: Callable[[str], str]) -> Path:
    """A copy of an FMU with one text file of it changed; ``member`` is a regular expression."""
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(target, "w") as copy:
        names = [name for name in source.namelist() if re.fullmatch(member, name)]
        assert len(names) == 1
        for name in source.namelist():
            content = source.read(name)
            if name in names:
                text = content.decode()
                content = change(text).encode()
                assert content.decode() != text, "the change changed nothing"
            copy.writestr(name, content)
    return target


def with_slave(fmu: Path, target: Path, what: str, instead: str) -> Path:
    """A copy of a rotor FMU whose slave does something else."""
    return altered(fmu, target, r"resources/rotor_slave_\w+\.py", lambda text: text.replace(what, instead))


STEP = "self._simulator.advance(time, h)"


def outcomes(report: dict) -> dict[str, str]:
    """Outcome of each gate by the first word of its name."""
    return {gate["name"].split()[0]: gate["outcome"] for gate in report["gates"]}


def check_failing(*arguments: object) -> tuple[dict[str, str], str]:
    """Failed gates by name with their messages, and everything printed, of a check that fails."""
    result = run("check", *arguments)
    assert result.exit_code == 3, result.output
    failed = re.findall(r"^ +failed +(.+?): (.+)$", result.stdout, re.MULTILINE)
    return dict(failed), result.stdout


def test_both_fmus_pass(rotor_fmu, estimator_fmu):
    for report in (
        run_json("check", rotor_fmu, "--expect-k-b", 4.7e7, "--tolerance", 0.002, "--estimator", estimator_fmu),
        run_json("check", estimator_fmu),
    ):
        assert report["passed"] is True
        assert set(outcomes(report).values()) == {"passed"}
    assert len(report["gates"]) == 5


@pytest.fixture
def stuck(rotor_fmu, tmp_path) -> Path:
    """A rig whose k_b does nothing, so that it always measures 10 MN/m."""
    return altered(
        rotor_fmu,
        tmp_path / "stuck.fmu",
        r"resources/rigtwin_\w+/rotor/model/design\.py",
        lambda text: text.replace("k_b, damping = condition.k_b,", "k_b, damping = 1e7,"),
    )


@pytest.mark.long
def test_a_stiffness_may_be_as_far_off_as_the_tolerance(stuck, estimator_fmu):
    four_off, six_off = (("--expect-k-b", 1e7 * factor, "--estimator", estimator_fmu) for factor in (1.04, 1.06))
    assert run_json("check", stuck, *four_off)["passed"] is True
    assert len(check_failing(stuck, *six_off)[0]) == 1
    assert len(check_failing(stuck, *four_off, "--tolerance", 0.03)[0]) == 1


def test_a_rotor_that_nothing_moves_fails(rotor_fmu, tmp_path):
    still = with_slave(rotor_fmu, tmp_path / "still.fmu", STEP, "pass")
    assert check_failing(still)[0]["loads, initialises, steps"] == "a force of 1 N moves nothing"


def test_another_stiffness_than_expected_fails_with_both_numbers(stuck, estimator_fmu, tmp_path):
    junit = tmp_path / "reports" / "junit.xml"
    failed, _ = check_failing(stuck, "--expect-k-b", 1.3e6, "--estimator", estimator_fmu, "--junit", junit)
    ((name, message),) = failed.items()
    assert name == "the virtual rig gives back k_b = 1.3e+06 N/m"
    assert float(re.search(r"estimated ([\d.]+) MN/m", message)[1]) == pytest.approx(10.0, rel=5e-4)
    suite = ElementTree.parse(junit).getroot()[0]
    assert (suite.get("tests"), suite.get("failures")) == ("6", "1")
    (failure,) = suite.iter("failure")
    assert failure.get("message") == failure.text == message


@pytest.mark.long
def test_a_stiffness_outside_the_trained_range_fails_with_the_reason(rotor_fmu, estimator_fmu):
    failed, _ = check_failing(rotor_fmu, "--expect-k-b", 1e9, "--estimator", estimator_fmu)
    assert "is not valid: delta_f1" in next(iter(failed.values()))


def test_the_junit_report_has_a_case_for_each_gate(estimator_fmu, tmp_path):
    junit = tmp_path / "junit.xml"
    assert run("check", estimator_fmu, "--junit", junit).exit_code == 0
    root = ElementTree.parse(junit).getroot()
    (suite,) = root
    cases = suite.findall("testcase")
    assert (root.tag, suite.tag) == ("testsuites", "testsuite")
    assert len(cases) == int(suite.get("tests", 0)) == 5
    assert all(case.get("name") and case.get("classname") and float(case.get("time", -1)) >= 0 for case in cases)


def test_a_gate_that_cannot_be_run_is_not_a_pass(estimator_fmu, tmp_path, monkeypatch):
    monkeypatch.setattr("rigtwin.api.checks.find_spec", lambda name: None)
    junit = tmp_path / "junit.xml"
    report = run_json("check", estimator_fmu, "--junit", junit)
    assert outcomes(report)["FMU"] == "not run"
    (skipped,) = ElementTree.parse(junit).getroot().iter("skipped")
    assert "not installed" in str(skipped.get("message"))


def test_a_model_description_against_the_standard_fails_both_readers(estimator_fmu, tmp_path):
    wrong = altered(
        estimator_fmu,
        tmp_path / "wrong.fmu",
        r"modelDescription\.xml",
        lambda text: text.replace('causality="output"', 'causality="outcome"', 1),
    )
    failed, _ = check_failing(wrong)
    assert "model description and archive (fmpy)" in failed
    assert "FMU Manipulation Toolbox -check" in failed


def test_an_fmu_that_hangs_fails_its_gates_and_the_next_gets_a_process_of_its_own(rotor_fmu, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # what a stopped process cannot clean up
    hanging = altered(
        rotor_fmu,
        tmp_path / "hanging.fmu",
        r"resources/rigtwin_\w+/rotor/time/simulator\.py",
        lambda text: text + "\n\nimport time\ntime.sleep(1000)\n",
    )
    failed, printed = check_failing(hanging, "--time-limit", 5)
    assert set(failed.values()) == {"not done after 5 s, stopped; --time-limit gives it longer"}
    assert [name.split(",")[0].split()[0] for name in failed] == ["loads", "a", "a"], printed


def test_an_fmu_that_crashes_fails_its_gates_and_the_report_is_written(rotor_fmu, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # what a crashed process cannot clean up
    crashing = with_slave(rotor_fmu, tmp_path / "crashing.fmu", STEP, "import os; os._exit(1)")
    junit = tmp_path / "junit.xml"
    failed, _ = check_failing(crashing, "--junit", junit)
    assert set(failed.values()) == {"the FMU crashed the process that ran it"}
    assert set(failed) == {
        "loads, initialises, steps", "a saved state replays exactly", "a bad value is refused with a message",
    }  # fmt: skip
    assert ElementTree.parse(junit).getroot()[0].get("failures") == "3"


def test_a_state_that_is_not_whole_fails_the_replay(rotor_fmu, tmp_path):
    restoring = "self._simulator.restore(state, self._condition(), self._effects())"
    forgetful = with_slave(rotor_fmu, tmp_path / "forgetful.fmu", restoring, "pass")
    failed, _ = check_failing(forgetful)
    assert list(failed) == ["a saved state replays exactly"]


def test_a_bad_value_that_is_accepted_fails(estimator_fmu, tmp_path):
    careless = altered(
        estimator_fmu,
        tmp_path / "careless.fmu",
        r"resources/rigtwin_\w+/fmu_src/variables\.py",
        lambda text: text.replace("value < self.minimum", "False"),
    )
    failed, _ = check_failing(careless)
    assert failed == {"a bad value is refused with a message": "delta_f1_std = -1 is accepted, its minimum is 0"}


def test_values_below_a_minimum_are_no_gate_for_other_tools_fmus(estimator_fmu, monkeypatch):
    """FMI lets them be accepted."""
    monkeypatch.setattr("rigtwin.api.checks.manifest", lambda fmu: {})
    with pytest.raises(NotRun, match="only FMUs that rigtwin built"):
        refuses(estimator_fmu)


def test_an_estimator_has_no_stiffness_to_give_back(refused, estimator_fmu):
    assert "--expect-k-b needs a RotorRig.fmu" in refused("check", estimator_fmu, "--expect-k-b", 1e6)


def test_a_rotor_of_another_rig_needs_its_own_estimator(refused, estimator_fmu, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # away from any dist/
    own = Path(__file__).resolve().parents[2] / "examples" / "own_rotor.toml"
    fmu = run("build", own, "--out", tmp_path).stdout.strip()
    assert "no estimator trained for it lies beside it" in refused("check", fmu, "--expect-k-b", 1e6)
    message = refused("check", fmu, "--expect-k-b", 1e6, "--estimator", estimator_fmu)
    assert "was trained for the rig nit-rourkela" in message


@pytest.mark.parametrize("text", ["another tool's notes", '["another tool\'s"]'])
def test_a_manifest_of_another_tool_tells_nothing(estimator_fmu, tmp_path, text):
    foreign = altered(estimator_fmu, tmp_path / "foreign.fmu", r"resources/manifest\.json", lambda _: text)
    assert manifest(foreign) == {}
    assert manifest(estimator_fmu) != {}
