"""Upward and downward sweeps through folds: jumps in the FMU against those of harmonic balance."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.effects.cases import Case, condition, fmu_parameters, structure
from benchmarks.page import bar, table
from rigtwin.fmu_src.build import build_rotor_fmu
from rigtwin.rotor.effects import BearingClearance, BearingCubic, BearingHertz, Rub
from rigtwin.rotor.frequency.continuation import trace
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.rotor_model import build_model
from rigtwin.sim.campaign import SweepDirection
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, measure_lines

BAR_HZ = 0.1
STEP_HZ = 0.04  # of the FMU's sweep near a jump
REACH_HZ = (0.8, 0.4)  # the FMU sweeps from so far before the jump to so far behind it
RUN_UP_HZ, RUN_UP_STEP_HZ = 4.0, 1.0  # the sweep begins so far before all folds, where a single motion exists
HARMONICS, SAMPLES, CORNER = 15, 512, 0.002

CASES = (
    (Case(BearingCubic(stiffness=1e15), (1.0, 1.0, 1.0)), (60.0, 100.0)),
    (Case(BearingHertz(preload=1e-5), (1.0, 1.0, 1.0)), (50.0, 90.0)),
    (Case(BearingClearance(gap=2e-6, preload=20.0), (3.0, 3.0, 3.0)), (55.0, 95.0)),
    (Case(Rub(stiffness=1e6, gap=3e-5, node=4), (2.0, 2.0, 2.0)), (60.0, 110.0)),
)

PLAN = SweepPlan(settling_tolerance=1e-3, max_windows=40)


@dataclass(frozen=True)
class Jump:
    """One jump, in harmonic balance and in the FMU."""

    case: str
    direction: SweepDirection
    balance_hz: float
    fmu_hz: float  # nan: it did not jump within the reach
    before: float  # response of the driven node before the jump, FMU over harmonic balance
    behind: float  # and behind it


def jumps(session: FmuSession, case: Case, span_hz: tuple[float, float]) -> list[Jump]:
    """Every jump of the case, upwards and downwards."""
    model = build_model(structure(), condition(), [case.effect])
    balance = Balance(model, condition(), harmonics=HARMONICS, samples=SAMPLES, corner=CORNER)
    curve = trace(balance, *span_hz, case.levels_N[0])
    found = []
    for direction, sign in (("up", 1.0), ("down", -1.0)):
        first_fold = sign * min(sign * curve.folds_hz)
        for predicted in curve.sweep(np.array(span_hz), direction).jumps_hz:
            start, stop = predicted - sign * REACH_HZ[0], predicted + sign * REACH_HZ[1]
            lines = np.sort(np.arange(start, stop, sign * STEP_HZ))
            alone = sign * (min(sign * first_fold, sign * start) - RUN_UP_HZ)
            run_up = np.arange(alone, start, sign * RUN_UP_STEP_HZ)
            plan = replace(PLAN, force_amplitude=case.levels_N[0], direction=direction)
            rig = Rig("bearing", parameters=fmu_parameters(), effects=(case.effect,))
            run = measure_lines(session, rig, plan, np.union1d(run_up, lines)).run
            near = np.isin(run.frequency_hz, lines)
            f, a = run.frequency_hz[near], np.abs(run.channel(2)[near])
            swept = curve.sweep(f, direction).motions
            b = np.abs(swept.acceleration()[:, 1, 1])
            found.append(_jump(case.name, direction, float(predicted), f, a, b))
            print(f"{case.name} {direction}: {found[-1].balance_hz:.2f} {found[-1].fmu_hz:.2f} Hz", file=sys.stderr)
    return found


def _jump(name: str, direction: SweepDirection, predicted: float, f: np.ndarray, a: np.ndarray, b: np.ndarray) -> Jump:
    """Where the response changes most from one line to the next, if that is a jump."""
    change = np.abs(np.diff(np.log(a)))
    place = int(np.argmax(change))
    jumped = change[place] > 0.2 and change[place] > 5 * np.median(change)
    ends = (0, -1) if direction == "up" else (-1, 0)
    before, behind = (a[end] / b[end] for end in ends)
    return Jump(name, direction, predicted, (f[place] + f[place + 1]) / 2 if jumped else np.nan, before, behind)


def section() -> str:
    """Markdown of the comparison."""
    with (
        tempfile.TemporaryDirectory() as folder,
        FmuSession(build_rotor_fmu(load_rig("nit-rourkela"), Path(folder))) as session,
    ):
        found = [jump for case, span in CASES for jump in jumps(session, case, span)]
    rows = [
        (
            f"`{j.case}`",
            j.direction,
            f"{j.balance_hz:.3f}",
            f"{j.fmu_hz:.3f}",
            f"{j.fmu_hz - j.balance_hz:+.3f}",
            f"{100 * (j.before - 1):+.2f}",
            f"{100 * (j.behind - 1):+.2f}",
        )
        for j in found
    ]
    worst = max((abs(j.fmu_hz - j.balance_hz) for j in found), default=np.nan)
    worst = np.inf if any(np.isnan(j.fmu_hz) for j in found) else worst
    header = ("effect", "sweep", "jump, balance, Hz", "jump, FMU, Hz", "diff., Hz", "before, %", "behind, %")
    return f"""## Jumps

The response curve of a nonlinear rotor can turn back on itself. At such a fold a sweep jumps to another branch of the
curve. This section compares the frequency at which harmonic balance says that the branch ends with the frequency at
which `RotorRig.fmu` jumps. The FMU is swept upwards and downwards in steps of {STEP_HZ:g} Hz, and each line starts from
the state at the end of the line before. The last two columns compare the responses of both solvers at the driven node,
{REACH_HZ[0]:g} Hz before the jump and {REACH_HZ[1]:g} Hz behind it.

{table(header, rows)}
{bar("jump frequency, largest difference", worst, at_most=BAR_HZ, unit="Hz")}"""


if __name__ == "__main__":
    print(section())
