"""The command as a user runs it, and what it measured once for all tests."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from rigtwin.cli import app


def run(*arguments: object) -> Result:
    """``rigtwin arguments``; stdout and stderr apart."""
    state = random.getstate()  # rich, when first imported, draws from the global generator
    try:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])
    finally:
        random.setstate(state)


def run_json(*arguments: object) -> Any:
    """What a command that succeeds prints with --json."""
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


@dataclass(frozen=True)
class Swept:
    """A rig that was swept on both supports."""

    k_b: float
    rigid: Path
    bearing: Path


@pytest.fixture(scope="session")
def swept(rotor_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Swept:
    """Two run files of one rig with 1 % noise: a CSV, which does not say its support, and a UFF, which does."""
    folder, k_b = tmp_path_factory.mktemp("swept"), 3.7e6
    files = {"rigid": folder / "rigid.csv", "bearing": folder / "bearing.uff"}
    for support, path in files.items():
        result = run(
            "sweep", rotor_fmu, "--support", support, "--set", f"k_b={k_b}", "--lines", 96, "--noise", 0.01,
            "--out", path,
        )  # fmt: skip
        assert result.exit_code == 0, result.stderr
    return Swept(k_b, files["rigid"], files["bearing"])


@dataclass(frozen=True)
class DemoRun:
    """What ``rigtwin demo`` left behind."""

    out: Path
    fmus: Path
    printed: str

    @property
    def numbers(self) -> dict[str, Any]:
        """demo.json."""
        return json.loads((self.out / "demo.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> DemoRun:
    """One run of the demo."""
    folder = tmp_path_factory.mktemp("demo")
    result = run("demo", "--out", folder / "out", "--fmus", folder / "dist")
    assert result.exit_code == 0, result.stderr
    return DemoRun(folder / "out", folder / "dist", result.stdout)


@pytest.fixture
def refused() -> Callable[..., str]:
    """Run a command that must be refused; returns its one message without the prefix."""

    def run_refused(*arguments: object) -> str:
        result = run(*arguments)
        lines = result.stderr.splitlines()
        assert (result.exit_code, len(lines)) == (2, 1), result.output
        assert lines[0].startswith("rigtwin: ")
        return lines[0].removeprefix("rigtwin: ")

    return run_refused
