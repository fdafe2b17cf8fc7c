"""What is left of a command that is killed: no process, and no folder beyond the next command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rigtwin.scratch import _sweep_once, replacing, scratch_folder
from tests.rigtwin.test_foreign_fmus import wait_for

OWNER = """
import sys
from pathlib import Path
from rigtwin.scratch import replacing, scratch_folder
with scratch_folder("test_") as folder, replacing(Path(sys.argv[1])) as beside:
    beside.write_text("half")
    print("made", flush=True)
    sys.stdin.read()
"""

POOL = """
import sys, time
from rigtwin.workers import worker_pool
if __name__ == "__main__":
    with worker_pool(2) as pool:
        for _ in range(2):
            pool.submit(time.sleep, 1000)
        print(*(process.pid for process in pool._context.started), flush=True)
        sys.stdin.read()
"""


@contextmanager
def begun(script: str, temporary: Path, *arguments: object) -> Iterator[tuple[subprocess.Popen, str]]:
    """A program, and the first line that it prints; it is killed in the end."""
    program = temporary.parent / "program.py"
    program.write_text(script, encoding="utf-8")
    command = [sys.executable, str(program), *map(str, arguments)]
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, text=True, env=os.environ | {"TMPDIR": str(temporary)}, **streams) as process:
        assert process.stdout
        try:
            yield process, process.stdout.readline()
        finally:
            process.kill()


@pytest.fixture
def temporary(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    _sweep_once.cache_clear()  # as if each test were a command of its own
    return folder


def are_there(processes: list[int]) -> list[bool]:
    """Which of them run; a zombie does not."""
    return [bool(read(pid)) for pid in processes]


def read(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def test_folders_of_a_killed_program_are_removed_by_the_next_one_and_those_in_use_are_not(temporary, tmp_path):
    target = tmp_path / "result.txt"
    target.write_text("before")
    with begun(OWNER, temporary, target) as (killed, _):
        killed.kill()
        killed.wait()
    assert [len(list(temporary.iterdir())), len(list(tmp_path.glob(".result.txt.*")))] == [1, 1]
    with begun(OWNER, temporary, target) as (running, _):
        assert len(list(temporary.iterdir())) == 1, "the second removed the first one's and made its own"
        with scratch_folder(), replacing(target) as beside:
            beside.write_text("after")
            assert len(list(temporary.iterdir())) == 2
        assert target.read_text() == "after"
        running.communicate("")
        assert running.returncode == 0
    assert target.read_text() == "half"
    assert list(temporary.iterdir()) == []
    assert list(tmp_path.glob(".result.txt.*")) == []


def test_workers_end_with_a_program_that_is_killed(temporary):
    with begun(POOL, temporary) as (process, line):
        workers = [int(word) for word in line.split()]
        assert len(workers) == 2
        wait_for(lambda: all(are_there(workers)), 20.0)  # while a process is replaced, it has no command line
        time.sleep(3)  # they are at work
        process.send_signal(signal.SIGKILL)
        process.wait()
        wait_for(lambda: not any(are_there(workers)), 20.0)


def test_an_interrupt_ends_workers_at_once(temporary):
    with begun(POOL, temporary) as (process, line):
        began = time.monotonic()
        process.send_signal(signal.SIGINT)
        process.wait(30)
        assert time.monotonic() - began < 15
    assert are_there([int(word) for word in line.split()]) == [False, False]
    assert list(temporary.iterdir()) == []
