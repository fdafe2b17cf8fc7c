"""How exact and how fast the virtual rig is: ``python -m benchmarks.virtual_rig`` writes docs/virtual-rig.md."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description, simulate_fmu

from benchmarks.page import DOCS, bar, best_seconds, table
from rigtwin.fmu_src.build import build_native_rotor_fmu, build_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Channel, Run, SupportKind
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, Sweep, SweepPlan, measure_lines, sweep

PLAN = SweepPlan()
SUPPORTS: tuple[SupportKind, ...] = ("rigid", "bearing")
SHIPPED_K_B = 1e7

# What a user would do instead: a force signal sampled so fast, for so long that 0.1 % of damping settles.
RATE, DURATION = 20e3, 16.0
TRIED_LINES = (60.0, 100.0, 350.0)
PULSE, PULSE_PEAK = 2e-3, 100.0  # a hammer's blow [s, N]
OUTPUTS = [f"node_{n}.acceleration_y" for n in range(1, 8)]

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


@dataclass(frozen=True)
class Timings:
    """Seconds for two supports; how many lines that are, and what it leaves."""

    compiled: float
    on_python: float
    from_rest: float
    sampled_line: float  # one line of fmpy.simulate_fmu
    blows: float  # two runs of it
    blow_error: float


def main() -> None:
    """Measure, print, write the page."""
    rig = load_rig("nit-rourkela")
    structure = assemble(rig)
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_native_rotor_fmu(rig, Path(folder), targets=[this_machine()])
        with FmuSession(fmu) as session:
            accuracies = [_accuracy(session, structure, support, k) for k in (1e6, 1e7, 1e8) for support in SUPPORTS]
            compiled, sweeps = _time_two_supports(session)
            hasty = _hasty(session, structure)
            from_rest = _time_from_rest(session, sweeps)
        with FmuSession(build_rotor_fmu(rig, Path(folder) / "python")) as session:
            on_python, _ = _time_two_supports(session)
        timings = Timings(compiled, on_python, from_rest, _time_sampled_sine(fmu), *_blows(fmu, structure))
    page = _page(accuracies, sweeps, hasty, timings)
    (DOCS / "virtual-rig.md").write_text(page, encoding="utf-8")
    print(page)


def _accuracy(session: FmuSession, structure: Structure, support: SupportKind, k_b: float) -> Accuracy:
    run = sweep(session, Rig(support, parameters={"k_b": k_b}), PLAN).run
    errors = _errors(run, structure, k_b)
    return Accuracy(support, k_b, len(run.frequency_hz), float(errors.max()), errors.size)


def _exact(run: Run, structure: Structure, k_b: float) -> np.ndarray:
    """(n_freq, n_nodes) what the run should have measured."""
    system = build_system(structure, Condition(k_b=k_b, rigid_support=run.support == "rigid"))
    return accelerance(system, run.frequency_hz)[:, :, 0]


def _errors(run: Run, structure: Structure, k_b: float) -> np.ndarray:
    exact = _exact(run, structure, k_b)
    moving = np.abs(exact).max(axis=0) > 0
    size = np.abs(exact[:, moving])
    judged = size > _SHARE_OF_MEDIAN * np.median(size, axis=0)
    return (np.abs(run.H - exact)[:, moving] / size)[judged]


def _time_two_supports(session: FmuSession) -> tuple[float, list[Sweep]]:
    """Best of three: both supports, base lines and refinement, from rest."""
    sweeps: list[Sweep] = []

    def both() -> None:
        sweeps[:] = [sweep(session, Rig(support), PLAN) for support in SUPPORTS]

    return best_seconds(both), sweeps


def _hasty(session: FmuSession, structure: Structure) -> float:
    """The same sweep with a tenth of the settling time and no check."""
    plan = SweepPlan(settle_time=PLAN.settle_time / 10, settling_tolerance=np.inf, refine=False)
    lines = sweep(session, Rig("bearing"), PLAN).run.frequency_hz
    return float(_errors(measure_lines(session, Rig("bearing"), plan, lines).run, structure, SHIPPED_K_B).max())


def _time_from_rest(session: FmuSession, sweeps: list[Sweep]) -> float:
    """The same lines, every one settled from rest in an instance of its own."""

    def all_lines() -> None:
        for measured in sweeps:
            for f in measured.run.frequency_hz:
                measure_lines(session, Rig(measured.run.support), PLAN, [float(f)])

    return best_seconds(all_lines, 1)


def _time_sampled_sine(fmu: Path) -> float:
    """Seconds a line with ``fmpy.simulate_fmu`` and a sampled sine on the force input, the median of three."""
    with _sampled(fmu) as run:
        return float(np.median([run(lambda t, f=f: np.sin(2 * np.pi * f * t), {})[0] for f in TRIED_LINES]))


def _blows(fmu: Path, structure: Structure) -> tuple[float, float]:
    """Seconds of a sampled hammer's blow on each support with ``fmpy.simulate_fmu``, and its largest error.

    The error is relative to the channel's largest value.
    """
    seconds = worst = 0.0
    for support in SUPPORTS:
        with _sampled(fmu) as run:
            took, force, motion = run(_pulse, {"rigid_support": support == "rigid"})
        seconds += took
        frequency = np.fft.rfftfreq(len(force), 1 / RATE)
        band = (frequency >= PLAN.f_min_hz) & (frequency <= PLAN.f_max_hz)
        H = (np.fft.rfft(motion, axis=0) / np.fft.rfft(force)[:, None])[band]
        channels = tuple(Channel(n) for n in range(1, 8))
        measured = Run(frequency[band], H, channels, support=support, name=f"blow, {support}")
        exact = _exact(measured, structure, SHIPPED_K_B)
        largest = np.abs(exact).max(axis=0)
        error = np.abs(H - exact)[:, largest > 0] / largest[largest > 0]
        worst = max(worst, float(error.max()))
    return seconds, worst


def _pulse(t: np.ndarray) -> np.ndarray:
    return np.where(t < PULSE, PULSE_PEAK * np.sin(np.pi * t / PULSE) ** 2, 0.0)


@contextmanager
def _sampled(fmu: Path) -> Iterator[Callable[..., tuple[float, np.ndarray, np.ndarray]]]:
    """A run with ``fmpy.simulate_fmu``: seconds, force (n,) and accelerations (n, 7).

    Unpacked once, one instance, as fmpy's own example of efficient loops does it.
    """
    unpacked = extract(str(fmu))
    description = read_model_description(unpacked)
    instance = instantiate_fmu(unpacked, description, "CoSimulation")

    def run(force: Callable, start_values: dict) -> tuple[float, np.ndarray, np.ndarray]:
        t = np.arange(0.0, DURATION, 1 / RATE)
        signal = np.array(list(zip(t, force(t), strict=True)), dtype=[("time", float), ("force", float)])
        instance.reset()
        start = time.perf_counter()
        result = simulate_fmu(
            unpacked,
            model_description=description,
            fmu_instance=instance,
            start_values=start_values,
            input=signal,
            output=OUTPUTS,
            step_size=1 / RATE,
            output_interval=1 / RATE,
            stop_time=DURATION,
        )
        seconds = time.perf_counter() - start
        return seconds, force(result["time"]), np.column_stack([result[name] for name in OUTPUTS])

    try:
        yield run
    finally:
        instance.freeInstance()
        shutil.rmtree(unpacked)


def _page(accuracies: list[Accuracy], sweeps: list[Sweep], hasty: float, timings: Timings) -> str:
    first, second = (len(s.lines) for s in sweeps)
    rows = [(a.support, f"{a.k_b:.0e}", str(a.lines), str(a.judged), f"{a.worst:.1e}") for a in accuracies]
    exactness = table(("support", "k_b, N/m", "lines", "values judged", "largest error"), rows)
    drift = max(line.drift_per_period for s in sweeps for line in s.lines)
    windows = sum(line.windows for s in sweeps for line in s.lines)
    sampled, one = timings.sampled_line * (first + second), timings.compiled
    ways = [
        ("virtual rig, compiled FMU, each line starts from the motion of the line before", one),
        ("the same with the FMU that pythonfmu builds", timings.on_python),
        ("virtual rig, compiled FMU, each line starts from rest", timings.from_rest),
        ("`fmpy.simulate_fmu`, compiled FMU, a 20 kHz sampled sine for each line", sampled),
        ("`fmpy.simulate_fmu`, compiled FMU, one sampled hammer blow on each support", timings.blows),
    ]
    speed = table(("how", "time, s", "ratio"), [(name, f"{s:.3g}", f"{s / one:.3g}") for name, s in ways])
    return f"""# The virtual rig, measured

This page says how exactly the virtual rig measures and how fast it is. `python -m benchmarks.virtual_rig` writes it.
The times depend on the machine, so quote the ratios and not the seconds.

## Exactness

The virtual rig measures the accelerance through the compiled `RotorRig.fmu`: it drives the rotor with the FMU's
built-in sine, waits at every frequency line until the motion has settled, and reads {PLAN.samples_per_period} samples
per period. The lines run from 20 to 400 Hz and are closer together around the resonances. The result is compared with
the frequency response that is computed directly from the same matrices.

The table shows the largest error of the complex value, relative to the value of the same line, over all nodes that
move. Lines below 1 % of the median of their channel are left out, because a relative error says little there.

{exactness}
{bar("largest error of all six runs", max(a.worst for a in accuracies), at_most=1e-4)}
For comparison, the error is {hasty:.1e} when the same lines are measured with a tenth of the settling time and without
the check that the motion has settled.

## Speed

The work that is timed is a sweep on each of the two supports, with {first} + {second} lines and 7 nodes, starting from
rest. The rig waits {PLAN.settle_time:g} s of simulated time before each window in which it reads the motion. It needs
{windows} windows in all, and in no window that it accepts does the motion change by more than {drift:.0e} per period.

{speed}
{bar("sweep on both supports", one, at_most=0.7, unit="s")}
{bar("this time divided by that of a sampled sine for each line", one / sampled, at_most=1 / 2000)}
The time for the sampled sine is an estimate: three lines of {DURATION:g} s of simulated time were timed, each took
{timings.sampled_line:.2f} s, and this was multiplied by the number of lines.

Each hammer blow is followed by {DURATION:g} s in which the rotor rings down. It gives the whole frequency band at once,
in lines {1 / DURATION:.4g} Hz apart. Its errors reach {100 * timings.blow_error:.1f} % of the largest value of a
channel. Near that largest value the errors of the virtual rig are below 1e-6 %.
"""


if __name__ == "__main__":
    main()
