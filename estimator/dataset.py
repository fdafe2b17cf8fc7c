"""Rigs measured through the FMU by the virtual test rig."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator.features import FEATURE_NAMES, features_of_runs
from estimator.prior import Rigs
from sim.sensors import SensorNoise
from sim.session import FmuSession
from sim.stepped_sine import Rig, SweepPlan, sweep

RIG_NAMES = ("k_b", "shaft_damping_ratio", "bearing_damping")

# A coarse raster finds the resonances, the refinement then resolves them.
FEATURE_PLAN = SweepPlan(n_lines=96)

# Rigs per task: one FMU instance serves a chunk.
_CHUNK = 16


@dataclass(frozen=True)
class Dataset:
    """Rigs and what the virtual rig measured on them."""

    rigs: Rigs
    features: np.ndarray  # (n, 6) in the order of FEATURE_NAMES

    def __len__(self) -> int:
        return len(self.rigs)


def measure_rigs(
    fmu: Path,
    rigs: Rigs,
    executor: Executor,
    *,
    plan: SweepPlan = FEATURE_PLAN,
    progress: Callable[[int], None] | None = None,
) -> Dataset:
    """Sweep every rig on rigid supports and on its bearings, and fit the modes.

    Parameters
    ----------
    fmu : RotorRig.fmu
    rigs : what to set in it
    executor : where the work runs; the result does not depend on it
    plan : lines, settling, noise; the noise differs from rig to rig
    progress : called with the number of rigs measured so far
    """
    tasks = [(str(fmu), _part(rigs, start), start, plan) for start in range(0, len(rigs), _CHUNK)]
    rows: list[np.ndarray] = []
    for part in executor.map(_measure_chunk, tasks):
        rows.extend(part)
        if progress:
            progress(len(rows))
    return Dataset(rigs, np.array(rows))


def _part(rigs: Rigs, start: int) -> Rigs:
    return Rigs(*(getattr(rigs, name)[start : start + _CHUNK] for name in RIG_NAMES))


def _measure_chunk(task: tuple[str, Rigs, int, SweepPlan]) -> list[np.ndarray]:
    fmu, rigs, start, plan = task
    with FmuSession(fmu) as session:
        return [_measure_one(session, rigs, i, start + i, plan) for i in range(len(rigs))]


def _measure_one(session: FmuSession, rigs: Rigs, i: int, number: int, plan: SweepPlan) -> np.ndarray:
    parameters = {name: float(getattr(rigs, name)[i]) for name in RIG_NAMES}
    noise = replace(plan.noise, seed=plan.noise.seed * 1_000_003 + number)
    own = replace(plan, noise=noise)
    rigid = sweep(session, Rig("rigid", parameters=parameters), own).run
    bearing = sweep(session, Rig("bearing", parameters=parameters), own).run
    return features_of_runs(rigid, bearing).as_array()


def noisy(plan: SweepPlan, relative: float, seed: int) -> SweepPlan:
    """The plan with sensor noise, and with enough periods a line to estimate it."""
    return replace(plan, periods=4, noise=SensorNoise(relative=relative, seed=seed))


def write_dataset(dataset: Dataset, path: Path) -> None:
    """Write a data set as CSV, beside and renamed."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    with beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*RIG_NAMES, *FEATURE_NAMES])
        columns = [getattr(dataset.rigs, name) for name in RIG_NAMES]
        for row in np.column_stack([*columns, dataset.features]):
            writer.writerow([repr(float(value)) for value in row])
    os.replace(beside, path)


def read_dataset(path: Path) -> Dataset:
    """Read what ``write_dataset`` wrote."""
    table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    n = len(RIG_NAMES)
    return Dataset(Rigs(*table[:, :n].T), table[:, n:])
