"""The examples run as a user runs them, and the CI workflow's own commands work."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rigtwin.conftest import run

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize(
    "name",
    [
        "measure_k_b",
        pytest.param("own_rotor", marks=pytest.mark.long),
        pytest.param("diagnose_a_campaign", marks=pytest.mark.long),
        "in_libcosim",
        "in_ecos",
        pytest.param("as_one_fmu", marks=pytest.mark.long),
    ],
)
def test_an_example_runs_from_anywhere_and_its_number_holds(name, tmp_path):
    script = EXAMPLES / f"{name}.py"
    finished = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    assert "k_b = " in finished.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["measure_k_b", "own_rotor", "diagnose_a_campaign"])
def test_an_example_is_a_page_and_asserts_a_number(name):
    lines = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8").splitlines()
    assert len(lines) < 60
    assert any(line.strip().startswith("assert ") for line in lines)


@pytest.mark.long
def test_the_workflow_builds_checks_and_reports(tmp_path, monkeypatch):
    text = (EXAMPLES / "ci" / "rigtwin-check.yml").read_text(encoding="utf-8")
    commands = re.findall(r"^\s+run: rigtwin (.+)$", text, re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["build", "check", "check"]
    monkeypatch.chdir(tmp_path)
    for command in commands:
        result = run(*shlex.split(command))
        assert result.exit_code == 0, result.output
    assert {path.name for path in tmp_path.glob("reports/*.xml")} == {"rotor.xml", "estimator.xml"}
