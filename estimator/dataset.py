"""Rigs measured through the FMU by the virtual test rig."""

from __future__ import annotations

import csv
import hashlib
import io
import logging
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import astuple, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fmpy import read_model_description

from rigtwin.estimator.features import FEATURE_NAMES, features_of_runs
from rigtwin.estimator.prior import Prior, Rigs
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.scratch import replacing
from rigtwin.sim.sensors import SensorNoise
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep

logger = logging.getLogger(__name__)

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
    excitation_node: int = 2,
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
    excitation_node : where the force acts and the amplitude ratio is read
    progress : called with the number of rigs measured so far
    store : folder that keeps what is measured; what it has of the same FMU, rigs and plan is not measured again
    """
    guid = str(read_model_description(str(fmu)).guid)
    bench = _Bench(str(fmu), guid, plan, excitation_node, store)
    tasks = [_Task(bench, _part(rigs, start), start) for start in range(0, len(rigs), _CHUNK)]
    rows: list[np.ndarray] = []
    for part in executor.map(_measure_chunk, tasks):
        rows.extend(part)
        if progress:
            progress(len(rows))
    return Dataset(rigs, np.array(rows))


class _Bench(NamedTuple):
    """What all rigs of a data set have in common."""

    fmu: str
    guid: str
    plan: SweepPlan
    excitation_node: int
    store: Path | None


class _Task(NamedTuple):
    """Some rigs to be measured by one instance of the FMU."""

    bench: _Bench
    rigs: Rigs
    start: int  # number of the first of them

    def kept(self) -> Path | None:
        """Where their features are kept: a name for the FMU, the plan and the rigs together."""
        bench = self.bench
        if bench.store is None:
            return None
        rigs = [values.tolist() for values in astuple(self.rigs)]
        said = repr((version("rigtwin"), bench.guid, bench.plan, bench.excitation_node, self.start, rigs))
        return bench.store / f"{hashlib.sha256(said.encode()).hexdigest()[:20]}.npy"


def _part(rigs: Rigs, start: int) -> Rigs:
    return Rigs(*(getattr(rigs, name)[start : start + _CHUNK] for name in RIG_NAMES))


def _measure_chunk(task: _Task) -> np.ndarray:
    """(n, 6) features, from the store or from the rig."""
    kept = task.kept()
    if kept and (rows := _read_kept(kept)) is not None:
        return rows
    with FmuSession(task.bench.fmu) as session:
        rows = np.array([_measure_one(session, task, i) for i in range(len(task.rigs))])
    if kept:
        kept.parent.mkdir(parents=True, exist_ok=True)
        with replacing(kept) as beside:
            beside.write_bytes(_with_digest(rows))
    return rows


def _with_digest(rows: np.ndarray) -> bytes:
    """An array as .npy, and the SHA-256 of it, which readers of .npy do not see."""
    buffer = io.BytesIO()
    np.save(buffer, rows)
    return buffer.getvalue() + hashlib.sha256(buffer.getvalue()).digest()


def _read_kept(path: Path) -> np.ndarray | None:
    """What ``_with_digest`` made of an array; None where there is no such file or it is damaged."""
    if not path.exists():
        return None
    content = path.read_bytes()
    size = len(content) - hashlib.sha256().digest_size
    if hashlib.sha256(content[: max(size, 0)]).digest() == content[size:]:
        return np.load(io.BytesIO(content), allow_pickle=False)
    logger.warning("%s is damaged; its rigs are measured again", path)
    return None


def _measure_one(session: FmuSession, task: _Task, i: int) -> np.ndarray:
    parameters = {name: float(getattr(task.rigs, name)[i]) for name in RIG_NAMES}
    plan, node = task.bench.plan, task.bench.excitation_node
    noise = replace(plan.noise, seed=plan.noise.seed * 1_000_003 + task.start + i)
    own = replace(plan, noise=noise)
    rigid = sweep(session, Rig("rigid", node, parameters=parameters), own).run
    bearing = sweep(session, Rig("bearing", node, parameters=parameters), own).run
    return features_of_runs(rigid, bearing).as_array()


def feature_plan(structure: Structure, prior: Prior) -> SweepPlan:
    """FEATURE_PLAN with the band that holds modes 1 and 2 of any rotor, whatever k_b the prior draws."""
    soft = build_system(structure, Condition(k_b=prior.k_b_trained[0]))
    rigid = build_system(structure, Condition(rigid_support=True))
    lowest, highest = elastic_frequencies_hz(soft, plane=1)[0], elastic_frequencies_hz(rigid, plane=1)[1]
    return replace(FEATURE_PLAN, f_min_hz=0.3 * float(lowest), f_max_hz=1.25 * float(highest))


def noisy(plan: SweepPlan, relative: float, seed: int) -> SweepPlan:
    """The plan with sensor noise, and with enough periods a line to estimate it."""
    return replace(plan, periods=4, noise=SensorNoise(relative=relative, seed=seed))


def write_dataset(dataset: Dataset, path: Path) -> None:
    """Write a data set as CSV, beside and renamed."""
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*RIG_NAMES, *FEATURE_NAMES])
        columns = [getattr(dataset.rigs, name) for name in RIG_NAMES]
        for row in np.column_stack([*columns, dataset.features]):
            writer.writerow([repr(float(value)) for value in row])


def read_dataset(path: Path) -> Dataset:
    """Read what ``write_dataset`` wrote."""
    table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    n = len(RIG_NAMES)
    return Dataset(Rigs(*table[:, :n].T), table[:, n:])
