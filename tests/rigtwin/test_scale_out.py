"""Where long work runs: a real dask scheduler with two workers, one of them killed; processes of this machine."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any

import pytest
from numpy.testing import assert_array_equal

from rigtwin import scale_out
from rigtwin.errors import UserError
from rigtwin.estimator import dataset
from rigtwin.estimator.dataset import measure_rigs
from rigtwin.estimator.prior import PRIOR
from rigtwin.rotor.effects import BearingClearance, FastSweep, ForceDropout
from rigtwin.scale_out import executor
from rigtwin.sim.runs import sweep_all
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import NotSettledError, Rig, SetupError, SweepPlan, sweep
from tests.rigtwin.conftest import run

COARSE = SweepPlan(n_lines=96)
PATIENCE = 60.0  # seconds for a process to come up


@dataclass(frozen=True)
class Cluster:
    """A scheduler and its workers, processes of their own."""

    address: str
    workers: tuple[subprocess.Popen, ...]


@pytest.fixture
def draws_kept() -> Iterator[None]:
    """dask draws from Python's global generator."""
    state = random.getstate()
    yield
    random.setstate(state)


@pytest.fixture
def cluster(draws_kept, tmp_path) -> Iterator[Cluster]:
    file = tmp_path / "scheduler.json"
    begun: list[subprocess.Popen] = []

    def start(tool: str, *options: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.dask_{tool}", "--scheduler-file", str(file), *options]
        begun.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        return begun[-1]

    local = ("--host", "127.0.0.1", "--no-dashboard")
    try:
        start("scheduler", *local, "--port", "0")
        end = time.monotonic() + PATIENCE
        while not file.exists():
            assert time.monotonic() < end, "the scheduler does not start"
            time.sleep(0.05)
        workers = tuple(start("worker", *local, "--nthreads", "1", "--no-nanny") for _ in range(2))
        address = json.loads(file.read_text(encoding="utf-8"))["address"].removeprefix("tcp://")
        wait_for_workers(address, 2)
        yield Cluster(address, workers)
    finally:
        for process in begun:
            process.kill()
            process.wait()


def wait_for_workers(address: str, count: int) -> None:
    from distributed import Client

    with Client(f"tcp://{address}") as client:
        client.wait_for_workers(count, timeout=PATIENCE)


@pytest.mark.long
def test_a_worker_killed_in_mid_run_loses_nothing_and_doubles_nothing(rotor_fmu, cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "_CHUNK", 1)
    rigs, store = PRIOR.draw(6, seed=3), tmp_path / "store"
    seen: list[int] = []

    def kill_one(measured: int) -> None:
        seen.append(measured)
        if len(seen) == 2:
            os.kill(cluster.workers[0].pid, signal.SIGKILL)

    with executor(f"dask://{cluster.address}") as pool:
        found = measure_rigs(rotor_fmu, rigs, pool, plan=COARSE, store=store, progress=kill_one)
    assert cluster.workers[0].wait(PATIENCE) == -signal.SIGKILL
    assert seen == list(range(1, 7))
    assert sorted(path.suffix for path in store.iterdir()) == [".npy"] * 6
    with executor(workers=2) as pool:
        assert_array_equal(found.features, measure_rigs(rotor_fmu, rigs, pool, plan=COARSE).features)


@pytest.mark.long
def test_what_a_cluster_left_is_gone_on_with_here(rotor_fmu, cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "_CHUNK", 1)
    rigs, store = PRIOR.draw(4, seed=4), tmp_path / "store"

    def interrupt(measured: int) -> None:
        if measured == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), executor(f"dask://{cluster.address}") as pool:
        measure_rigs(rotor_fmu, rigs, pool, plan=COARSE, store=store, progress=interrupt)
    kept = {path: path.stat().st_mtime_ns for path in store.iterdir()}
    assert len(kept) >= 2
    with executor(workers=1) as pool:
        assert len(measure_rigs(rotor_fmu, rigs, pool, plan=COARSE, store=store)) == 4
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_runs_are_those_of_one_instance_wherever_they_are_measured(rotor_fmu):
    runs = [(Rig("bearing"), SweepPlan(n_lines=24, refine=False, force_amplitude=f)) for f in (1.0, 2.0)]
    with executor(workers=2) as pool:
        found = dict(sweep_all(rotor_fmu, runs, pool))
    with FmuSession(rotor_fmu) as session:
        for place, (rig, plan) in enumerate(runs):
            assert found[place].run.force_amplitude_N == plan.force_amplitude
            assert_array_equal(found[place].run.H, sweep(session, rig, plan).run.H)


@pytest.mark.long
def test_levels_are_swept_on_a_cluster(rotor_fmu, cluster, tmp_path):
    options = ("sweep", rotor_fmu, "--levels", "1,2", "--lines", 24, "--f-max", 90)
    for place, where in (("there.csv", ("--executor", f"dask://{cluster.address}")), ("here.csv", ())):
        done = run(*options, "--out", tmp_path / place, *where)
        assert done.exit_code == 0, done.stderr
    for level in (1, 2):
        there, here = (tmp_path / f"{place}_{level}N.csv" for place in ("there", "here"))
        assert there.read_text(encoding="utf-8") == here.read_text(encoding="utf-8")


def test_a_cluster_does_not_see_a_rig_that_is_built_here(refused):
    assert "give an FMU that all workers see" in refused("sweep", "--executor", "dask://127.0.0.1:1")


def test_a_worker_process_that_dies_is_told_in_a_sentence():
    with pytest.raises(UserError, match="a worker process died"), executor(workers=1) as pool:
        pool.submit(os._exit, 3).result()


def test_workers_use_one_thread_each_and_this_process_keeps_its_own(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with executor(workers=1) as pool:
        assert [pool.submit(os.getenv, name).result() for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS")] == ["1", "1"]
    assert (os.environ["OMP_NUM_THREADS"], os.environ.get("MKL_NUM_THREADS")) == ("7", None)


@pytest.mark.parametrize(
    ("rig", "plan", "error", "words"),
    [
        (Rig("rigid"), SweepPlan(n_lines=8, settle_time=0.01, max_windows=5), NotSettledError, "is still transient"),
        (Rig(effects=(ForceDropout(), FastSweep())), SweepPlan(), SetupError, "give force_dropout or fast_sweep"),
    ],
)
def test_what_a_worker_complains_of_arrives_whole(rotor_fmu, rig, plan, error, words):
    with executor(workers=1) as pool, pytest.raises(error, match=words):
        list(sweep_all(rotor_fmu, [(rig, plan)], pool))


class Unhurried(Executor):
    """Does nothing but note the order in which work comes."""

    def __init__(self) -> None:
        self.begun: list[tuple[Any, ...]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        self.begun.append(args)
        done: Future[Any] = Future()
        done.set_result(args)
        return done


def test_the_longest_runs_begin_first_and_keep_their_places(tmp_path):
    """A rotor that is stepped in time takes longer than one that is not, and the harder it is driven."""
    stepped, linear = Rig(effects=(BearingClearance(),)), Rig("rigid", effects=(BearingClearance(),))
    runs = [(rig, SweepPlan(force_amplitude=force)) for rig, force in ((linear, 9.0), (stepped, 1.0), (stepped, 3.0))]
    pool = Unhurried()
    found = dict(sweep_all(tmp_path, runs, pool))
    assert [args[1:] for args in pool.begun] == [runs[2], runs[1], runs[0]]
    assert [found[place] for place in range(3)] == [(tmp_path, *run) for run in runs]


def test_a_scheduler_without_workers(cluster, monkeypatch):
    monkeypatch.setattr(scale_out, "_ANSWERS_WITHIN", 2.0)
    for worker in cluster.workers:
        worker.kill()
        worker.wait()
    with pytest.raises(UserError, match="has no workers"), executor(f"dask://{cluster.address}"):
        pass


@pytest.mark.parametrize(
    ("where", "words"),
    [("cluster:8786", "write dask://HOST:PORT"), ("dask://127.0.0.1:1", "no dask scheduler answers there")],
)
def test_an_executor_that_is_not_there(where, words, draws_kept, monkeypatch):
    monkeypatch.setattr(scale_out, "_ANSWERS_WITHIN", 1.0)
    with pytest.raises(UserError, match=words), executor(where):
        pass
