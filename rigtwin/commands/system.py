"""``rigtwin system``: a machine whose bearing softens, its tracker and its supervisor, run and drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.api.rigs import load_rig
from rigtwin.console import print_json, progress, say, table
from rigtwin.errors import UserError
from rigtwin.fmu_src.build import BuildError
from rigtwin.fmu_src.compiling import CompileError, this_machine
from rigtwin.fmu_src.machine import build_machine, machine_facts
from rigtwin.fmu_src.machine_variables import MachineFacts, bearing_variables, supervisor_variables
from rigtwin.pages.machine_page import write_machine_page
from rigtwin.pages.overlay_page import Table
from rigtwin.rotor.frequency.whirl import RPM
from rigtwin.scratch import check_writable
from rigtwin.sim.machine import MachinePlan, MachineRun, run_machine
from rigtwin.wording import stiffness
from rigtwin.workers import report, worker_pool

# Times as much vibration that are worth a word.
_NOTABLE = 1.5

# Periods over which the vibration is averaged.
_WINDOW = 5.0

# Windows that a run has at least.
_LEAST = 20


@dataclass(frozen=True)
class SystemRequest:
    """What was asked for on the command line."""

    rig: str
    out: Path
    seconds: float | None  # None: what suits the rig
    as_json: bool = False


@dataclass(frozen=True)
class Judged:
    """A run in a few numbers."""

    largest_vibration: float  # rms [m/s^2]
    nearest: float  # relative distance of the speed from a resonance
    last_speed: float  # [rad/s]


def _plan(request: SystemRequest, facts: MachineFacts) -> MachinePlan:
    """How long it runs. Raises UserError where that is too short to see anything."""
    plan = MachinePlan(request.seconds or facts.seconds, facts.step, _WINDOW * facts.period)
    if plan.stop < _LEAST * plan.window:
        raise UserError(
            f"--seconds {plan.stop:g}: vibration is an rms over {plan.window:.2g} s, and this rotor needs at least "
            f"{_LEAST * plan.window:.2g} s"
        )
    return plan


def run_system(request: SystemRequest) -> None:
    """Build, run with and without supervisor, draw, print."""
    page = request.out / "system.html"
    check_writable(page)
    rig = load_rig(request.rig)
    try:
        facts = machine_facts(rig)
        plan = _plan(request, facts)
        system = build_machine(rig, facts, request.out, targets=[this_machine()])
    except (BuildError, CompileError) as error:
        raise UserError(str(error)) from error
    runs = _run(system, plan)
    judged = tuple(_judge(run) for run in runs)
    record = _record(runs[0], judged)
    rows, result = _rows(judged), _result(record, judged)
    starts = {v.name: float(v.start or 0.0) for v in (*bearing_variables(facts), *supervisor_variables(facts))}
    head = ("", "largest vibration, m/s²", "nearest to a resonance", "speed at the end, rev/min")
    words = f"After the run-up. Vibration is an rms over {1e3 * plan.window:.0f} ms."
    shown = Table("With and without supervisor", head, rows, words)
    title = f"{rig.title or rig.name}: a bearing that softens"
    write_machine_page(page, title, result, _sentences(facts, starts), shown, runs, starts["margin"])
    if request.as_json:
        print_json({"system": str(system), "page": str(page), **record})
        return
    table(head, rows)
    say(result)
    say(f"{system} and {page} written")


def _run(system: Path, plan: MachinePlan) -> tuple[MachineRun, MachineRun]:
    """The machine with supervisor and without, beside each other."""
    with worker_pool(2) as pool, progress("simulated, %", 100) as bar:
        alone = pool.submit(run_machine, system, replace(plan, supervise=False))
        return pool.run(run_machine, system, plan, report, progress=bar), alone.result()


def _after_run_up(run: MachineRun) -> slice:
    """From where the speed has risen and the stiffness is known."""
    risen = (np.arange(len(run.time)) >= np.argmax(run.speed)) & (run.resonance > 0)
    return slice(int(np.argmax(risen)), None)


def _judge(run: MachineRun) -> Judged:
    some = _after_run_up(run)
    distance = np.abs(run.speed[some] / np.maximum(run.resonance[some], 1e-300) - 1)
    return Judged(float(run.vibration[some].max()), float(distance.min()), float(run.speed[-1]))


def _record(run: MachineRun, judged: tuple[Judged, ...]) -> dict[str, Any]:
    off, known = np.log(run.tracked / run.k_b), run.valid
    inside = (run.low < run.k_b) & (run.k_b < run.high)
    return {
        "k_b_N_per_m": [float(run.k_b[0]), float(run.k_b[-1])],
        "tracked_off_rms": float(np.sqrt(np.mean(off[known] ** 2))) if known.any() else None,
        "interval_holds": float(np.mean(inside[known])) if known.any() else None,
        "valid": float(np.mean(run.valid)),
        **{
            name: {
                "largest_vibration_m_per_s2": each.largest_vibration,
                "nearest_to_a_resonance": each.nearest,
                "last_speed_rad_per_s": each.last_speed,
            }
            for name, each in zip(("supervised", "alone"), judged, strict=True)
        },
    }


def _rows(judged: tuple[Judged, ...]) -> list[tuple[str, ...]]:
    return [
        (name, f"{each.largest_vibration:.3g}", f"{100 * each.nearest:.1f} %", f"{each.last_speed / RPM:.0f}")
        for name, each in zip(("with supervisor", "without"), judged, strict=True)
    ]


def _result(record: dict[str, Any], judged: tuple[Judged, ...]) -> str:
    times = judged[1].largest_vibration / judged[0].largest_vibration
    first, last = record["k_b_N_per_m"]
    tracked = f"off by {100 * record['tracked_off_rms']:.2f} % (rms)" if record["valid"] else "never sure"
    course = f"falls from {stiffness(first)} to {stiffness(last)}" if last < first else f"stays at {stiffness(first)}"
    words = f"While k_b {course} MN/m, the tracker is {tracked}. "
    if times < _NOTABLE:
        near = judged[1].nearest < judged[0].nearest
        hardly = "Its resonance passes through the speed, but hardly shows" if near else "Its resonance stays away"
        return f"{words}{hardly}: without the supervisor the machine vibrates no more."
    return f"{words}Without the supervisor the machine vibrates up to {times:.0f} times as much."


def _sentences(facts: MachineFacts, starts: dict[str, float]) -> list[str]:
    return [
        f"The machine runs up to {facts.speed / RPM:.0f} rev/min, below its first resonance. Its unbalance is "
        f"{1e6 * facts.unbalance:.3g} g mm (balance quality grade G 6.3), and a force of many frequencies beside it, "
        f"{facts.probe:.3g} N rms, lets StiffnessTracker.fmu tell the bearing stiffness.",
        f"From {starts['change_at']:g} s on the bearing softens, within {starts['change_for']:g} s, and the resonance "
        "comes down towards the speed. SpeedSupervisor.fmu reads what the tracker says and keeps its distance of "
        f"{100 * starts['margin']:g} %.",
        "The four FMUs and their connections are SoftenedMachine.ssp beside this page.",
    ]
