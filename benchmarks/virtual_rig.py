"""How exact and how fast the virtual rig is: ``python -m benchmarks.virtual_rig`` writes docs/virtual-rig.md."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description, simulate_fmu

from build_fmu import build_rotor_fmu
from rotor.assembly import assemble
from rotor.condition import Condition
from rotor.frequency_response import accelerance
from rotor.model import build_system
from rotor.rig import load_rig
from sim.campaign import Run
from sim.session import FmuSession
from sim.stepped_sine import Rig, Sweep, SweepPlan, measure_lines, sweep

DOC = Path(__file__).resolve().parent.parent / "docs" / "virtual-rig.md"
PLAN = SweepPlan()
SUPPORTS = ("rigid", "bearing")

# Channels are judged where a line is above this share of the channel's median.
_SHARE_OF_MEDIAN = 0.01


@dataclass(frozen=True)
class Accuracy:
    """Largest complex error of a run, relative to each line's own value."""

    support: str
    k_b: float
    lines: int
    worst: float
    judged: int


def main() -> None:
    """Measure, print, write the page."""
    rig = load_rig("nit-rourkela")
    structure = assemble(rig)
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_rotor_fmu(rig, Path(folder))
        with FmuSession(fmu) as session:
            accuracies = [_accuracy(session, structure, support, k) for k in (1e6, 1e7, 1e8) for support in SUPPORTS]
            seconds, sweeps = _time_two_supports(session)
            hasty = _hasty(session, structure)
            from_rest = _time_from_rest(session, sweeps)
        per_line = _time_sampled_sine(fmu, sweeps[1].run)
    page = _page(accuracies, seconds, sweeps, hasty, from_rest, per_line)
    DOC.write_text(page, encoding="utf-8")
    print(page)


def _accuracy(session: FmuSession, structure, support: str, k_b: float) -> Accuracy:
    run = sweep(session, Rig(support, parameters={"k_b": k_b}), PLAN).run
    errors = _errors(run, structure, k_b)
    return Accuracy(support, k_b, len(run.frequency_hz), float(errors.max()), errors.size)


def _errors(run: Run, structure, k_b: float) -> np.ndarray:
    system = build_system(structure, Condition(k_b=k_b, rigid_support=run.support == "rigid"))
    exact = accelerance(system, run.frequency_hz)[:, :, 0]
    moving = np.abs(exact).max(axis=0) > 0
    size = np.abs(exact[:, moving])
    judged = size > _SHARE_OF_MEDIAN * np.median(size, axis=0)
    return (np.abs(run.H - exact)[:, moving] / size)[judged]


def _time_two_supports(session: FmuSession) -> tuple[float, list[Sweep]]:
    """Best of three: both supports, base lines and refinement, from rest."""
    best, sweeps = np.inf, []
    for _ in range(3):
        start = time.perf_counter()
        sweeps = [sweep(session, Rig(support), PLAN) for support in SUPPORTS]
        best = min(best, time.perf_counter() - start)
    return best, sweeps


def _hasty(session: FmuSession, structure) -> float:
    """The same sweep with a tenth of the settling time and no check."""
    plan = SweepPlan(settle_time=PLAN.settle_time / 10, settling_tolerance=np.inf, refine=False)
    lines = sweep(session, Rig("bearing"), PLAN).run.frequency_hz
    return float(_errors(measure_lines(session, Rig("bearing"), plan, lines).run, structure, 1e7).max())


def _time_from_rest(session: FmuSession, sweeps: list[Sweep]) -> float:
    """The same lines, every one settled from rest in an instance of its own."""
    start = time.perf_counter()
    for measured in sweeps:
        for f in measured.run.frequency_hz:
            measure_lines(session, Rig(measured.run.support), PLAN, [float(f)])
    return time.perf_counter() - start


def _time_sampled_sine(fmu: Path, run: Run, settle: float = 16.0, rate: float = 20e3) -> list[float]:
    """Seconds a line with ``fmpy.simulate_fmu`` and a sampled sine on the force input.

    Unpacked once, one instance, as fmpy's own example of efficient loops does it.
    """
    unpacked = extract(str(fmu))
    description = read_model_description(unpacked)
    instance = instantiate_fmu(unpacked, description, "CoSimulation")
    seconds = []
    for f in (60.0, 100.0, 350.0):
        t = np.arange(0.0, settle, 1 / rate)
        signal = np.array(
            list(zip(t, np.sin(2 * np.pi * f * t), strict=True)), dtype=[("time", float), ("force", float)]
        )
        instance.reset()
        start = time.perf_counter()
        simulate_fmu(
            unpacked,
            model_description=description,
            fmu_instance=instance,
            input=signal,
            output=[f"node_{n}.acceleration_y" for n in range(1, 8)],
            step_size=1 / rate,
            output_interval=1 / rate,
            stop_time=settle,
        )
        seconds.append(time.perf_counter() - start)
    instance.freeInstance()
    return seconds


def _page(
    accuracies: list[Accuracy],
    seconds: float,
    sweeps: list[Sweep],
    hasty: float,
    from_rest: float,
    per_line: list[float],
) -> str:
    lines = [len(s.lines) for s in sweeps]
    sampled = float(np.median(per_line)) * sum(lines)
    rows = "\n".join(f"| {a.support} | {a.k_b:.0e} | {a.lines} | {a.judged} | {a.worst:.1e} |" for a in accuracies)
    worst = max(a.worst for a in accuracies)
    drift = max(line.drift_per_period for s in sweeps for line in s.lines)
    windows = sum(line.windows for s in sweeps for line in s.lines)
    return f"""# The virtual rig, measured

Written by `python -m benchmarks.virtual_rig`. Timings depend on the machine; quote the ratios.

## Exactness

Accelerance measured through `RotorRig.fmu` (built-in sine, {PLAN.samples_per_period} samples a period, settled lines,
20 to 400 Hz, refined round the resonances) against the direct frequency response of the same matrices. Largest complex
error relative to each line's own value, over all moving nodes, where the line is above 1 % of its channel's median.

| support | k_b, N/m | lines | values judged | largest error |
|---|---|---|---|---|
{rows}

Bar: 1e-4. Largest: **{worst:.1e}**. The same lines with a tenth of the settling time and the check switched off:
{hasty:.1e}.

## Speed

Two supports, {lines[0]} + {lines[1]} lines, 7 nodes, from rest, {PLAN.settle_time:g} s between windows, {windows}
windows in all, largest drift {drift:.0e} per period: **{seconds:.2f} s** (bar: 2 s).

| how | time, s | ratio |
|---|---|---|
| virtual rig, each line settled from the one before | {seconds:.2f} | 1 |
| virtual rig, every line settled from rest on a reset instance | {from_rest:.2f} | {from_rest / seconds:.1f} |
| `fmpy.simulate_fmu`, 20 kHz sampled sine on `force` | {sampled:.0f} | {sampled / seconds:.0f} |

The last row is extrapolated from three lines of 16 s, {np.median(per_line):.2f} s each. The sampled sine is
held between samples, so its result also carries a phase error of half a sample and more (see the FMU's documentation).
"""


if __name__ == "__main__":
    main()
