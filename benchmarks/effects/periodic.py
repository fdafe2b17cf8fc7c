"""Harmonic balance against time stepping in the FMU, every nonlinear effect at three levels."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.effects.cases import CASES, LINES_HZ, Case, condition, fmu_parameters, structure
from benchmarks.page import bar, table
from rigtwin.fmu_src.build import build_rotor_fmu
from rigtwin.rotor.frequency.continuation import Sweep as Branches
from rigtwin.rotor.frequency.continuation import trace
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.stability import floquet_multipliers, is_stable
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.rotor_model import build_model
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, Sweep, SweepPlan, measure_lines

FUNDAMENTAL, THIRD = 0.005, 0.02  # bars
SHOWN_THIRD = 0.02  # of the fundamental: a smaller third harmonic is not judged
AT_A_JUMP_HZ = 0.1
CORNER = 0.002
SAMPLES_PER_HARMONIC = 68

# Jumps are approached upwards, from rest at the first line.
PLAN = SweepPlan(settling_tolerance=2e-4, max_windows=40)


@dataclass(frozen=True)
class Comparison:
    """One case at one level."""

    case: str
    level_N: float
    fundamental: np.ndarray  # (n_lines,) relative difference over all nodes
    third: np.ndarray  # (n_lines,)
    third_share: np.ndarray  # (n_lines,) third harmonic over fundamental
    periodic: np.ndarray  # (n_lines,) bool
    stable: np.ndarray  # (n_lines,) bool: the motion of harmonic balance is
    solved: np.ndarray  # (n_lines,) bool: harmonic balance found a motion and no jump is near

    @property
    def judged(self) -> np.ndarray:
        """Lines whose fundamental is compared."""
        return self.periodic & self.solved & self.stable

    @property
    def judged_third(self) -> np.ndarray:
        """Lines whose third harmonic is compared."""
        return self.judged & (self.third_share >= SHOWN_THIRD)


def compare(session: FmuSession, case: Case, level_N: float) -> Comparison:
    """Sweep the FMU upwards and follow the same branch by harmonic balance."""
    rig = Rig("bearing", parameters=fmu_parameters(), effects=(case.effect,))
    swept = measure_lines(session, rig, replace(PLAN, force_amplitude=level_N), LINES_HZ)
    balance = Balance(
        build_model(structure(), condition(), [case.effect]),
        condition(),
        harmonics=case.harmonics,
        samples=SAMPLES_PER_HARMONIC * case.harmonics,
        corner=CORNER,
    )
    ends = LINES_HZ[0] - 1, LINES_HZ[-1] + 1
    curve = trace(balance, *ends, level_N)
    if not curve.complete:  # in a gap, where nothing holds the rotor, it may be easier from the other end
        curve = trace(balance, *reversed(ends), level_N)
    return _compare(case.name, level_N, swept, [curve.sweep(LINES_HZ, direction) for direction in ("up", "down")])


def _compare(name: str, level_N: float, swept: Sweep, branches: list[Branches]) -> Comparison:
    run = swept.run
    found = np.array([b.motions.acceleration() for b in branches])  # (2, n_lines, K, n_nodes)
    differences = np.array([_difference(run.H, motions[:, 1]) for motions in found])
    converged = np.array([b.motions.converged for b in branches])
    stable = np.array([is_stable(floquet_multipliers(b.motions)) for b in branches])
    nearest = np.argmin(np.where(converged, differences, np.inf), axis=0)
    lines = np.arange(len(nearest))
    jumps = np.concatenate([b.jumps_hz for b in branches])
    near = np.array([np.abs(jumps - f).min(initial=np.inf) < AT_A_JUMP_HZ for f in run.frequency_hz])
    return Comparison(
        name,
        level_N,
        fundamental=differences[nearest, lines],
        third=_difference(run.harmonics[3], found[nearest, lines, 3]),
        third_share=np.linalg.norm(run.harmonics[3], axis=1) / np.linalg.norm(run.H, axis=1),
        periodic=np.array([line.periodic and not line.remark for line in swept.lines]),
        stable=stable[nearest, lines],
        solved=converged.any(axis=0) & ~near,
    )


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(a - b, axis=1) / np.linalg.norm(a, axis=1)


def comparisons() -> Iterator[Comparison]:
    """All cases and levels; each takes up to a minute."""
    with (
        tempfile.TemporaryDirectory() as folder,
        FmuSession(build_rotor_fmu(load_rig("nit-rourkela"), Path(folder))) as fmu,
    ):
        for case in CASES:
            for level in case.levels_N:
                start = time.perf_counter()
                comparison = compare(fmu, case, level)
                print(
                    f"{comparison.case} {level:g} N: {comparison.judged.sum()} lines, "
                    f"{_worst(comparison.fundamental[comparison.judged])}, {time.perf_counter() - start:.0f} s",
                    file=sys.stderr,
                )
                yield comparison


def _worst(values: np.ndarray) -> str:
    return f"{100 * values.max():.2f}" if len(values) else "none"


def section() -> str:
    """Markdown of the comparison."""
    results = list(comparisons())
    rows = [
        (
            f"`{r.case}`",
            f"{r.level_N:g}",
            f"{r.judged.sum()}",
            _worst(r.fundamental[r.judged]),
            f"{r.judged_third.sum()}",
            _worst(r.third[r.judged_third]),
            f"{(~r.periodic).sum()}",
            f"{(r.periodic & ~r.stable).sum()}",
            f"{(r.periodic & r.stable & ~r.solved).sum()}",
        )
        for r in results
    ]
    fundamental = max(r.fundamental[r.judged].max(initial=0) for r in results)
    third = max(r.third[r.judged_third].max(initial=0) for r in results)
    header = (
        "effect",
        "level, N",
        "lines",
        "fundamental, %",
        "lines with 3rd",
        "3rd, %",
        "not periodic",
        "unstable",
        "at a jump",
    )
    return f"""## Harmonic balance against time stepping

The virtual rig sweeps `RotorRig.fmu` upwards over {len(LINES_HZ)} lines, with one nonlinear effect at a time and three
force levels. Where there are contacts it takes 150,000 samples per second. The same motion is computed by harmonic
balance with 15 harmonics. For clearance, friction, the bilinear support and the rub it uses 31 harmonics, because the
sharp corners of these laws excite higher modes; the corners are rounded over {100 * CORNER:g} % of the gap. Where
several motions are possible, the FMU is compared with the branch that it is on, which is that of an upward or of a
downward sweep. From one of these lines to the next it may fall from one branch to the other.

The table shows the largest difference of a line's phasors over all nodes, relative to the line. A third harmonic is
compared only where it is at least {100 * SHOWN_THIRD:g} % of the fundamental. Some lines are not compared and are
counted in the last three columns:

- "not periodic": the fundamental varies by more than 0.1 % from period to period, or the motion does not settle.
- "unstable": the motion that harmonic balance finds is not stable, for example because the real motion has become
  unsymmetric.
- "at a jump": the line is within {AT_A_JUMP_HZ:g} Hz of a jump.

{table(header, rows)}
{bar("fundamental, largest difference", 100 * fundamental, at_most=100 * FUNDAMENTAL, unit="%")}
{bar("third harmonic, largest difference", 100 * third, at_most=100 * THIRD, unit="%")}"""


if __name__ == "__main__":
    print(section())
