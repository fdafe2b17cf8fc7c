"""Several runs of the virtual rig, each with its own FMU instance, on any executor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, as_completed
from pathlib import Path

from rigtwin.sim.session import FmuSession
from rigtwin.sim.setup import Rig, SweepPlan
from rigtwin.sim.stepped_sine import Progress, Sweep, sweep


def sweep_all(fmu: Path, runs: Sequence[tuple[Rig, SweepPlan]], executor: Executor) -> Iterator[tuple[int, Sweep]]:
    """Sweep each of the runs; the results do not depend on where the work runs.

    Parameters
    ----------
    fmu : RotorRig.fmu, where all workers find it
    runs : how each is set up
    executor : where the work runs

    Yields
    ------
    each run's place among ``runs`` and its sweep, as they are done

    Raises
    ------
    NotSettledError, SetupError : as ``sweep`` does
    """
    longest_first = sorted(range(len(runs)), key=lambda place: _length(*runs[place]), reverse=True)
    places = {executor.submit(sweep_one, fmu, *runs[place]): place for place in longest_first}
    for done in as_completed(places):
        yield places[done], done.result()


def _length(rig: Rig, plan: SweepPlan) -> tuple[bool, float]:
    """Key that sorts runs by their expected duration: nonlinear ones take longer, and more so at higher force."""
    return rig.nonlinear, plan.force_amplitude


def sweep_one(fmu: Path, rig: Rig, plan: SweepPlan, progress: Progress | None = None) -> Sweep:
    """``sweep`` of an FMU that is opened for it alone. Raises FmuError and what ``sweep`` does."""
    with FmuSession(fmu) as session:
        return sweep(session, rig, plan, progress)
