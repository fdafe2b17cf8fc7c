"""What large work costs, and how cost grows: ``python -m benchmarks.scale`` writes docs/scale.md; half an hour."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import DOCS, bar, best_seconds, machine, table
from rigtwin.estimator.dataset import measure_rigs
from rigtwin.estimator.prior import PRIOR
from rigtwin.fmu_src.build import build_native_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.effects import EFFECTS, BearingClearance, Effect
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.scale_out import executor
from rigtwin.sim.campaign import SupportKind
from rigtwin.sim.runs import sweep_all
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, Sweep, SweepPlan, sweep

SUPPORTS: tuple[SupportKind, ...] = ("rigid", "bearing")
WORKERS = 2

LEVELS, LINES = (1.0, 3.0, 10.0), 280  # [N]
PRELOADS = (20.0, 0.0)  # [N] on each bearing: the gap closed at rest, and open

SAMPLES, FEW, SEED = 10_000, 200, 11

# Effects that are switched on one after another.
ADDED = (
    "attached_mass", "disk_mass", "open_crack", "bearing_damping", "pedestal_flexibility", "axial_load",
    "bearing_tilt_stiffness", "hub_stiffening",
)  # fmt: skip


def main() -> None:
    """Measure, print, write the page."""
    rig, target = load_rig("nit-rourkela"), [this_machine()]
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_native_rotor_fmu(rig, Path(folder), targets=target)
        nonlinear = [_nonlinear_rig(fmu, preload) for preload in PRELOADS]
        meshes = [
            build_native_rotor_fmu(rig, Path(folder) / str(n), elements_between_nodes=n, targets=target)
            for n in (1, 2, 4, 8)
        ]
        growth = "\n".join((_over_lines(fmu), _over_effects(fmu), _over_mesh(meshes)))
        work = [(FEW, 1), (FEW, WORKERS), (SAMPLES, WORKERS)]
        sampled = [(n, workers, _samples(fmu, n, workers)) for n, workers in work]
    page = _page(nonlinear, growth, sampled)
    (DOCS / "scale.md").write_text(page, encoding="utf-8")
    print(page)


def _nonlinear_rig(fmu: Path, preload: float) -> tuple[float, float, float]:
    """Preload, seconds of all levels on both supports, and the share of the bearing lines that repeat."""
    effect = BearingClearance(preload=preload)
    runs = [
        (Rig(support, effects=(effect,)), SweepPlan(force_amplitude=level, n_lines=LINES, refine=False))
        for support in SUPPORTS
        for level in LEVELS
    ]
    done: dict[int, Sweep] = {}
    with executor(workers=WORKERS) as pool:
        seconds = best_seconds(lambda: done.update(sweep_all(fmu, runs, pool)), 1)
    lines = [line for one in done.values() if one.run.support == "bearing" for line in one.lines]
    return preload, seconds, sum(line.periodic for line in lines) / len(lines)


def _samples(fmu: Path, n: int, workers: int) -> float:
    with executor(workers=workers) as pool:
        return best_seconds(lambda: measure_rigs(fmu, PRIOR.draw(n, SEED), pool), 1)


# -- growth --------------------------------------------------------------------------------------------


def _two_supports(fmu: Path, effects: Sequence[Effect] = (), plan: SweepPlan | None = None) -> float:
    """Seconds of a sweep on both supports, the best of three."""
    plan = plan or SweepPlan(n_lines=LINES, refine=False)
    with FmuSession(fmu) as session:
        return best_seconds(lambda: [sweep(session, Rig(s, effects=tuple(effects)), plan) for s in SUPPORTS])


def _growth(what: str, steps: Sequence[tuple[str, float]]) -> str:
    first = steps[0][1]
    return table((what, "time, s", "ratio"), [(name, f"{s:.3f}", f"{s / first:.2f}") for name, s in steps])


def _over_lines(fmu: Path) -> str:
    counts = (70, 140, 280, 560, 1120)
    plans = [SweepPlan(n_lines=n, refine=False) for n in counts]
    return _growth("lines", [(str(n), _two_supports(fmu, plan=plan)) for n, plan in zip(counts, plans, strict=True)])


def _over_effects(fmu: Path) -> str:
    effects = [EFFECTS[name]() for name in ADDED]
    return _growth("effects switched on", [(str(n), _two_supports(fmu, effects[:n])) for n in (0, 1, 2, 4, 8)])


def _over_mesh(fmus: Sequence[Path]) -> str:
    nodes = [1 + 6 * 2**k for k in range(len(fmus))]
    return _growth("nodes of the mesh", [(str(n), _two_supports(fmu)) for n, fmu in zip(nodes, fmus, strict=True)])


# -- page ----------------------------------------------------------------------------------------------


def _page(
    nonlinear: Sequence[tuple[float, float, float]], growth: str, sampled: Sequence[tuple[int, int, float]]
) -> str:
    levels = ", ".join(f"{level:g}" for level in LEVELS)
    rigs = table(
        ("preload, N", "time, s", "lines on bearings that repeat"),
        [(f"{preload:g}", f"{seconds:.1f}", f"{100 * share:.0f} %") for preload, seconds, share in nonlinear],
    )
    rates = table(
        ("samples", "processes", "time, s", "samples per second"),
        [(str(n), str(workers), f"{s:.1f}", f"{n / s:.1f}") for n, workers, s in sampled],
    )
    (_, _, alone), (_, _, together), (_, _, whole) = sampled
    sharing = f"time of {FEW} samples by {WORKERS} processes divided by half the time of one process"
    return f"""# What large work costs

This page says how long large jobs take and how the time grows with their size. `python -m benchmarks.scale` writes it
({machine()}). All sweeps go through the compiled FMU. The times depend on the machine.

## A nonlinear rig

Both bearings have a clearance. The rig is swept with a force of {levels} N, on rigid supports and on bearings, with
{LINES} lines each, by {WORKERS} processes. On bearings each line starts from the settled motion of the line before, as
in an upward sweep, and the exciter changes its frequency smoothly from one line to the next. A smooth motion is read
from 128 samples per period. A motion with contacts is sampled at 150 kHz. The last column says on how many of the lines
on bearings the motion repeats from period to period.

{rigs}
{bar(f"all sweeps of the rig with {nonlinear[0][0]:g} N of preload", nonlinear[0][1], at_most=15.0, unit="s")}
Without a preload the shaft rattles in the gap, and on most lines the motion does not repeat. The rig reads each such
line in twelve windows that are a quarter of a second apart, and it resolves contacts that last less than a microsecond.
This is why the second row takes so much longer.

## Samples for training

One training sample of the estimator is a rig that is drawn at random, swept on both supports with lines refined around
the resonances, and reduced to six features by a modal fit.

{rates}
{bar(f"{SAMPLES} samples, {WORKERS} processes", whole / 60, at_most=15.0, unit="min")}
{bar(sharing, together / (alone / WORKERS), at_most=1.25)}
## How cost grows

Each row is one sweep on each of the two supports in one process, with {LINES} lines each unless the table says
otherwise and without lines added around the resonances.

{growth}"""


if __name__ == "__main__":
    main()
