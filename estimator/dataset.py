"""Rigs measured through the FMU by the virtual test rig."""

from __future__ import annotations

import csv
import hashlib
import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fmpy import read_model_description

from estimator.features import FEATURE_NAMES, features_of_runs
from estimator.prior import Prior, Rigs
from rotor.modal import natural_frequencies_hz
from rotor.structure import Structure
from rotor.system import Condition, build_system
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
    store: Path | None = None,
) -> Dataset:
    """Sweep every rig on rigid supports and on its bearings, and fit the modes.

    Parameters
    ----------
    fmu : RotorRig.fmu
    rigs : what to set in it
    executor : where the work runs; the result does not depend on it
    plan : lines, settling, noise; the noise differs from rig to rig
    progress : called with the number of rigs measured so far
    store : folder that keeps what is measured; what it has of the same FMU, rigs and plan is not measured again
    """
    guid = read_model_description(str(fmu)).guid
    tasks = [_task(fmu, guid, rigs, start, plan, store) for start in range(0, len(rigs), _CHUNK)]
    rows: list[np.ndarray] = []
    for part in executor.map(_measure_chunk, tasks):
        rows.extend(part)
        if progress:
            progress(len(rows))
    return Dataset(rigs, np.array(rows))


class _Task(NamedTuple):
    """Some rigs to be measured by one instance of an FMU."""

    fmu: str
    rigs: Rigs
    start: int  # number of the first of them
    plan: SweepPlan
    kept: Path | None  # where their features are kept


def _task(fmu: Path, guid: str, rigs: Rigs, start: int, plan: SweepPlan, store: Path | None) -> _Task:
    part = Rigs(*(getattr(rigs, name)[start : start + _CHUNK] for name in RIG_NAMES))
    said = repr((guid, start, plan, [values.tolist() for values in astuple(part)]))
    kept = store / f"{hashlib.sha256(said.encode()).hexdigest()[:20]}.npy" if store else None
    return _Task(str(fmu), part, start, plan, kept)


def _measure_chunk(task: _Task) -> np.ndarray:
    """(n, 6) features, from the store or from the rig."""
    if task.kept and task.kept.exists():
        return np.load(task.kept)
    with FmuSession(task.fmu) as session:
        rows = [_measure_one(session, task.rigs, i, task.start + i, task.plan) for i in range(len(task.rigs))]
    if task.kept:
        task.kept.parent.mkdir(parents=True, exist_ok=True)
        beside = task.kept.with_suffix(f".{os.getpid()}.npy")
        np.save(beside, np.array(rows))
        os.replace(beside, task.kept)
    return np.array(rows)


def _measure_one(session: FmuSession, rigs: Rigs, i: int, number: int, plan: SweepPlan) -> np.ndarray:
    parameters = {name: float(getattr(rigs, name)[i]) for name in RIG_NAMES}
    noise = replace(plan.noise, seed=plan.noise.seed * 1_000_003 + number)
    own = replace(plan, noise=noise)
    rigid = sweep(session, Rig("rigid", parameters=parameters), own).run
    bearing = sweep(session, Rig("bearing", parameters=parameters), own).run
    return features_of_runs(rigid, bearing).as_array()


def feature_plan(structure: Structure, prior: Prior) -> SweepPlan:
    """FEATURE_PLAN with the band that holds modes 1 and 2 of any rotor, whatever k_b the prior draws."""
    soft = build_system(structure, Condition(k_b=prior.k_b_trained[0]))
    rigid = build_system(structure, Condition(rigid_support=True))
    lowest, highest = natural_frequencies_hz(soft, plane=1)[0], natural_frequencies_hz(rigid, plane=1)[1]
    return replace(FEATURE_PLAN, f_min_hz=0.3 * float(lowest), f_max_hz=1.25 * float(highest))


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
