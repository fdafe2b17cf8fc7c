"""Streams of a running rotor whose k_b changes, made by RotorRig.fmu; a tracker's network learns from them.

Everything is measured in instants of the tracker and in shares of the highest frequency of the rotor's motion, so that
it suits rotors of any size.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfilt

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.session import FmuSession

# Instants of a stream, those for which k_b stays between two jumps at least and at most, those between two changes of a
# k_b that drifts, and those in which the force fades in.
INSTANTS, SHORTEST, LONGEST, DRIFTS, FADES = 12_000, 1_500, 4_000, 25, 200

# Largest deviation of the disks' masses; largest change of ln k_b in 10,000 instants of a drift, the share of parts
# between two jumps that drift, and a change that is a jump. At a jump masses and dampings change, too: that many more
# machines are learned from.
MASS_OFF, DRIFT, DRIFTING, JUMP = 0.06, 0.5, 0.25, 0.01

# How the rotor is driven, and how often.
KINDS = {"band": 0.45, "multisine": 0.27, "run_up": 0.08, "steps": 0.06, "line": 0.14}

# Streams per task: one FMU instance serves a chunk.
_CHUNK = 8


@dataclass(frozen=True)
class StreamPlan:
    """What streams are drawn from."""

    step: float  # between instants [s]
    finer: int  # steps of the FMU between two instants
    highest_hz: float  # of the rotor's motion
    nodes: tuple[int, ...]  # whose accelerations are read
    k_b: tuple[float, float]  # [N/m]
    shaft_damping_ratio: tuple[float, float]
    bearing_damping: tuple[float, float]  # [N s/m]


@dataclass(frozen=True)
class Streams:
    """n streams of equally many instants, without noise."""

    force: FloatArray  # (n, instants) [N]
    read: FloatArray  # (n, n_nodes, instants) [m/s^2]
    k_b: FloatArray  # (n, instants) [N/m]
    kind: tuple[str, ...]  # of excitation

    def __len__(self) -> int:
        return len(self.kind)


class _Task(NamedTuple):
    """Some streams to be made by one instance of the FMU."""

    fmu: str
    plan: StreamPlan
    seed: int
    numbers: range
    steady: tuple[tuple[float, float] | None, ...]  # k_b and masses' deviation of each; None: drawn


def make_streams(
    fmu: Path, plan: StreamPlan, n: int, seed: int, executor: Executor, progress: Callable[[int], None] | None = None
) -> Streams:
    """Drive a rotor n times while its k_b jumps and drifts; masses and dampings change with the jumps.

    Parameters
    ----------
    fmu : RotorRig.fmu
    plan : what is drawn
    seed : of the draws; each stream depends on it and on its own number alone
    executor : where the work runs
    progress : called with the number of streams so far

    Raises FmuError where the FMU fails.
    """
    return _made(fmu, plan, (None,) * n, seed, executor, progress)


def make_steady_streams(
    fmu: Path, plan: StreamPlan, n_stiffnesses: int, n_masses: int, seed: int, executor: Executor
) -> Streams:
    """The same under one band noise, dampings in the middle, with one k_b and one mass each: a grid, even in ln k_b."""
    masses = np.linspace(-MASS_OFF, MASS_OFF, n_masses).tolist()
    grid = tuple((k_b, off) for off in masses for k_b in np.geomspace(*plan.k_b, n_stiffnesses).tolist())
    return _made(fmu, plan, grid, seed, executor, None)


def _made(
    fmu: Path,
    plan: StreamPlan,
    grid: tuple[tuple[float, float] | None, ...],
    seed: int,
    executor: Executor,
    progress: Callable[[int], None] | None,
) -> Streams:
    parts = [range(start, min(start + _CHUNK, len(grid))) for start in range(0, len(grid), _CHUNK)]
    tasks = [_Task(str(fmu), plan, seed, part, grid[part.start : part.stop]) for part in parts]
    rows: list[FloatArray] = []
    kinds: list[str] = []
    for some, their_kinds in executor.map(_make_chunk, tasks):
        rows += list(some)
        kinds += their_kinds
        if progress:
            progress(len(kinds))
    table = np.array(rows)
    return Streams(table[:, 0], table[:, 1:-1], table[:, -1], tuple(kinds))


def _make_chunk(task: _Task) -> tuple[FloatArray, list[str]]:
    """(n, 2 + n_nodes, INSTANTS) force, accelerations and k_b; and the kinds of excitation."""
    rows, kinds = [], []
    with FmuSession(task.fmu) as session:
        for number, at in zip(task.numbers, task.steady, strict=True):
            rng = np.random.default_rng([task.seed, 0 if at else number])
            kinds.append("band" if at else str(rng.choice(list(KINDS), p=list(KINDS.values()))))
            wanted = draw_force(kinds[-1], task.plan, rng)
            machine = middle_machine(task.plan, at[1]) if at else draw_machine(task.plan, rng)
            course = np.full(INSTANTS, at[0]) if at else draw_course(task.plan.k_b, rng)
            rows.append(_driven(session, task.plan, machine, wanted, course, rng))
    return np.array(rows, dtype=np.float32), kinds


def _driven(
    session: FmuSession,
    plan: StreamPlan,
    machine: dict[str, float],
    wanted: FloatArray,
    k_b: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """(2 + n_nodes, INSTANTS) force, accelerations and k_b of one run; the machine is another after each jump."""
    outputs = ("force_applied", *(f"node_{node}.acceleration_y" for node in plan.nodes))
    session.start(machine | {"k_b": float(k_b[0])})
    changes = [0, *(np.flatnonzero(np.diff(k_b)) + 1).tolist(), len(k_b)]
    told = []
    for start, stop in pairwise(changes):
        if abs(np.log(k_b[start] / k_b[max(start - 1, 0)])) > JUMP:
            machine = draw_machine(plan, rng)
        session.set(machine | {"k_b": float(k_b[start])})
        force = wanted[start * plan.finer : stop * plan.finer]
        told.append(session.play("force", force, outputs, plan.step / plan.finer))
    return np.vstack([np.concatenate(told)[:: plan.finer].T, k_b])


def draw_machine(plan: StreamPlan, rng: np.random.Generator) -> dict[str, float]:
    """Values of RotorRig.fmu: dampings and masses."""
    shaft, bearing = _log_uniform(plan.shaft_damping_ratio, rng), float(rng.uniform(*plan.bearing_damping))
    return _machine(shaft, bearing, float(rng.uniform(-MASS_OFF, MASS_OFF)))


def middle_machine(plan: StreamPlan, mass_off: float) -> dict[str, float]:
    """The same with dampings in the middle, and these masses."""
    return _machine(float(np.sqrt(np.prod(plan.shaft_damping_ratio))), float(np.mean(plan.bearing_damping)), mass_off)


def _machine(shaft_damping_ratio: float, bearing_damping: float, mass_off: float) -> dict[str, float]:
    return {
        "shaft_damping_ratio": shaft_damping_ratio,
        "bearing_damping": bearing_damping,
        "disk_mass.enabled": True,
        "disk_mass.change": mass_off,
    }


def draw_course(limits: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """(INSTANTS,) k_b [N/m]: parts that stay or drift, and jumps between them, small ones and large ones."""
    low, high = np.log(limits)
    parts, ln_k, left = [], rng.uniform(low, high), INSTANTS
    while left > 0:
        n = min(int(rng.integers(SHORTEST, LONGEST)), left)
        rate = rng.uniform(-DRIFT, DRIFT) if rng.random() < DRIFTING else 0.0
        drift = rate / 10_000 * (np.arange(n) // DRIFTS * DRIFTS)
        parts.append(np.clip(ln_k + drift, low, high))
        jump = rng.normal(0.0, 0.6) if rng.random() < 0.7 else rng.uniform(low, high) - ln_k
        ln_k, left = float(np.clip(parts[-1][-1] + jump, low, high)), left - n
    return np.exp(np.concatenate(parts))


def draw_force(kind: str, plan: StreamPlan, rng: np.random.Generator) -> FloatArray:
    """(INSTANTS * finer,) force of one of KINDS, of about 1 N rms, which fades in [N]."""
    n, h = INSTANTS * plan.finer, plan.step / plan.finer
    t = h * np.arange(n)
    low, high = (plan.highest_hz * _log_uniform(share, rng) for share in ((0.03, 0.2), (0.6, 1.1)))
    if kind == "band":
        force = sosfilt(butter(4, [low, high], "bandpass", fs=1 / h, output="sos"), rng.standard_normal(n))
    elif kind == "multisine":
        spacing = plan.highest_hz * _log_uniform((0.02, 0.1), rng)
        force = sum(_sine(t, hz, rng) * rng.uniform(0.5, 1.5) for hz in np.arange(low, high, spacing))
    elif kind == "run_up":
        force = np.sin(2 * np.pi * np.cumsum(np.geomspace(low, high, n)) * h + rng.uniform(0, 7))
    elif kind == "steps":
        held = np.repeat(rng.uniform(low, high, 8), -(-n // 8))[:n]
        force = np.sin(2 * np.pi * np.cumsum(held) * h)
    else:
        force = _sine(t, _log_uniform((low, high), rng), rng)
    force = np.asarray(force)
    return force / force.std() * np.minimum(np.arange(n) / (FADES * plan.finer), 1.0)


def _sine(t: FloatArray, hz: float, rng: np.random.Generator) -> FloatArray:
    return np.sin(2 * np.pi * hz * t + rng.uniform(0, 7))


def _log_uniform(limits: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(limits))))
