"""Binary files that are damaged or ask for too much: one sentence each, and the process that reads them lives on."""

from __future__ import annotations

import os
import signal
import time

import h5py
import numpy as np
import pytest

from rigtwin.sim.campaign import MeasurementError
from rigtwin.sim.formats import in_child
from rigtwin.sim.formats.run_file import read_run, write_run
from tests.sim.test_formats import a_run


@pytest.fixture
def whole(tmp_path):
    write_run(a_run(), tmp_path / "run.h5")
    return tmp_path / "run.h5"


def refused(path, words):
    with pytest.raises(MeasurementError, match=rf"{path.name}: .*{words}"):
        read_run(path, support="rigid")


def test_an_array_that_no_run_has_is_refused_before_it_is_read(whole):
    with h5py.File(whole, "a") as file:
        del file["std"]
        file.create_dataset("std", (10**12, 1), "c16", chunks=(1000, 1))
    refused(whole, "'std' has 1000000000000 values; a run's arrays have at most 33554432")


def test_an_array_that_is_kept_in_another_file_is_refused(whole, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["secret"] = np.ones((3, 2))
    layout = h5py.VirtualLayout((3, 2), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "secret", (3, 2))
    with h5py.File(whole, "a") as file:
        del file["std"]
        file.create_virtual_dataset("std", layout)
    refused(whole, "'std' is kept in another file")
    with h5py.File(whole, "a") as file:
        del file["std"]
        file.create_dataset("std", (3, 2), "f8", external=[(str(tmp_path / "other.h5"), 0, 48)])
    refused(whole, "'std' is kept in another file")
    with h5py.File(whole, "a") as file:
        del file["std"]
        file["std"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "secret")
    refused(whole, "'std' is a link to another file")


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", f"ended with exit code -{int(signal.SIGSEGV)}"),
        ("import time; time.sleep(60)", "it takes more than 2 s"),
        ("import os; os._exit(7)", "ended with exit code 7"),
    ],
)
def test_a_reader_that_crashes_or_hangs_is_one_sentence(whole, tmp_path, monkeypatch, program, words):
    (tmp_path / "program.py").write_text(program)
    monkeypatch.setattr(in_child, "_DECODER", tmp_path / "program.py")
    monkeypatch.setattr(in_child, "_LONGEST", 2.0)
    began = time.monotonic()
    refused(whole, words)
    assert time.monotonic() - began < 10


def test_a_file_that_asks_for_all_memory_gets_none_of_it(whole):
    """Two hundred arrays of an eighth of a gigabyte each, which compress to nothing."""
    with h5py.File(whole, "a") as file:
        for k in range(10, 210):
            file.create_dataset(f"h{k}", (1 << 23, 2), "f8", chunks=(1 << 20, 2), compression="gzip")
    assert os.stat(whole).st_size < 1e6
    refused(whole, "asks for more than 1024 MB of memory")


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
def test_a_file_with_a_wrong_byte_is_read_or_refused(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    write_run(a_run(), path)
    content, rng = path.read_bytes(), np.random.default_rng(3)
    refusals = []
    for _ in range(5):
        damaged = bytearray(content)
        for place in rng.integers(0, len(content), 4):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            read_run(path, support="rigid")
        except MeasurementError as error:
            refusals.append(str(error))
    assert refusals
    assert all(words.startswith(f"{path}: ") and "\n" not in words for words in refusals)
