"""FMUs that were built elsewhere run when the user says so, in a process that cannot take the command along."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from rigtwin.api import fmus
from rigtwin.fmu_src.build import LISTENERS, build_listener_fmu
from rigtwin.rotor.geometry.rig import load_rig
from tests.rigtwin.conftest import run
from tests.rigtwin.test_check import STEP, with_slave

SHORT = ("--lines", 8, "--f-max", 60)


@pytest.fixture
def temporary(tmp_path, monkeypatch) -> Path:
    """A folder for temporary files, so that leftovers show."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr("tempfile.tempdir", None)
    return folder


@pytest.fixture(scope="session")
def printing(rotor_fmu, tmp_path_factory) -> Path:
    """A foreign FMU that prints on stdout."""
    noise = f"print('noise from the FMU', flush=True); {STEP}"
    return with_slave(rotor_fmu, tmp_path_factory.mktemp("foreign") / "printing.fmu", STEP, noise)


def test_an_fmu_that_was_built_elsewhere_is_not_run_unasked(printing, estimator_fmu, tmp_path, refused):
    message = refused("sweep", printing, *SHORT)
    assert message.startswith(f"{printing}: this installation has not built it")
    assert message.endswith("add --trust")
    other = tmp_path / "other.fmu"
    other.write_bytes(estimator_fmu.read_bytes() + b"\n")
    numbers = [
        *("--delta-f1", 4.035, "--delta-f2", 25.996, "--amplitude-ratio", 1.2),
        *("--delta-f1-std", 0.01, "--delta-f2-std", 0.02, "--amplitude-ratio-std", 0.01),
    ]
    assert "add --trust" in refused("estimate", *numbers, "--estimator", other)
    trusted = run("estimate", *numbers, "--estimator", other, "--trust")
    assert trusted.exit_code == 0, trusted.stderr
    assert trusted.stdout == run("estimate", *numbers, "--estimator", estimator_fmu).stdout


@pytest.mark.parametrize("listener", [None, *LISTENERS], ids=lambda each: each.name if each else "StiffnessEstimator")
def test_an_fmu_that_this_installation_would_build_alike_is_its_own(listener, estimator_fmu, tmp_path, monkeypatch):
    """Where the list of what was built is not there or cannot be written."""
    rig = load_rig("nit-rourkela")
    fmu = build_listener_fmu(listener, rig, tmp_path, (2, 4)) if listener else estimator_fmu
    builder = "build_listener_fmu" if listener else "build_estimator_fmu"
    make, built = getattr(fmus, builder), []

    def build(*about: Any) -> Path:
        built.append(make(*about))
        return built[-1]

    monkeypatch.setattr(fmus, builder, build)
    (tmp_path / "a file").touch()
    with monkeypatch.context() as without, fmus.host_of(fmu, trust=False):
        assert built == [], "it stands in the list"
        without.setenv("XDG_STATE_HOME", str(tmp_path / "a file"))
        with fmus.host_of(fmu, trust=False) as run_here:
            assert run_here(os.getpid) == os.getpid()
    assert len(built) == 1


def test_what_an_fmu_prints_is_no_result(printing, temporary):
    alone, levels = (command(("sweep", printing, "--trust", *SHORT, "--json", *more)) for more in ([], ["--levels", 1]))
    assert (alone.returncode, levels.returncode) == (0, 0), alone.stderr + levels.stderr
    assert "noise from the FMU" in alone.stderr
    assert "noise from the FMU" in levels.stderr
    assert json.loads(levels.stdout)["runs"][0]["lines"] == json.loads(alone.stdout)["lines"] >= 8
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(
    ("does", "words"),
    [
        ("import os; os._exit(0)", "(exit code 0)"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "(SIGSEGV)"),
    ],
)
@pytest.mark.parametrize("levels", [(), ("--levels", "1,2")])
def test_an_fmu_that_ends_its_process_is_one_message(rotor_fmu, temporary, tmp_path, refused, does, words, levels):
    fmu = with_slave(rotor_fmu, tmp_path / "ending.fmu", STEP, does)
    message = refused("sweep", fmu, "--trust", *SHORT, *levels, "--out", tmp_path / "run.csv")
    assert words in message
    assert "crashed the process that ran it" in message or "worker process died" in message
    assert list(temporary.iterdir()) == []
    assert list(tmp_path.glob("*.csv")) == []


def test_an_interrupt_ends_a_sweep_whose_fmu_hangs(rotor_fmu, temporary, tmp_path):
    mark = tmp_path / "stepping"
    hangs = f"import signal; open({str(mark)!r}, 'w').close(); signal.sigwait([signal.SIGUSR1])"
    fmu = with_slave(rotor_fmu, tmp_path / "hanging.fmu", STEP, hangs)
    process = subprocess.Popen(line(("sweep", fmu, "--trust")), stderr=subprocess.PIPE, text=True)
    wait_for(mark.exists)
    process.send_signal(signal.SIGINT)
    began = time.monotonic()
    assert process.communicate(timeout=60)[1].endswith("rigtwin: interrupted\n")
    assert process.returncode == 130
    assert time.monotonic() - began < 20
    assert list(temporary.iterdir()) == []


def test_a_second_signal_ends_a_command_that_does_not_listen_to_the_first():
    script = """
import time
from rigtwin.interrupt import end_at_the_second, install
install()
end_at_the_second(again_after=0.2)
words = ["ready"]
while True:
    try:  # also where the signal comes at once
        print(*words, flush=True)
        words = []
        time.sleep(1000)
    except KeyboardInterrupt:
        pass
"""
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    process.send_signal(signal.SIGTERM)
    assert "interrupted" in process.communicate(timeout=30)[1]
    assert process.returncode == 130


def line(arguments) -> list[str]:
    """The command as a user's shell starts it."""
    return [sys.executable, "-m", "rigtwin", *map(str, arguments)]


def command(arguments) -> subprocess.CompletedProcess:
    return subprocess.run(line(arguments), capture_output=True, text=True, check=False, env=os.environ)


def wait_for(there, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end
        time.sleep(0.05)
