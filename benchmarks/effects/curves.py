"""Harmonic balance: what a curve costs, and what corners' rounding and the number of harmonics change."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks.effects.cases import Case, condition, structure
from benchmarks.page import bar, table
from rigtwin.rotor.effects import (
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BearingHertz,
    BilinearSupport,
    Effect,
    Rub,
)
from rigtwin.rotor.frequency.continuation import Curve, Sweep, trace
from rigtwin.rotor.frequency.harmonic_balance import CORNER, SAMPLES, SAMPLES_OF_CORNERS, Balance
from rigtwin.rotor.frequency.periodic_force import TRAVEL
from rigtwin.rotor.frequency.stability import floquet_multipliers
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.rotor_model import build_model

LINES_HZ: FloatArray = np.linspace(40.0, 320.0, 280)
HARMONICS, RUNS = 7, 3
CUBIC_S, CLEARANCE_S = 1.0, 2.0  # bars


def _at(effect: Effect, force: float) -> Case:
    return Case(effect, (force, force, force))


TIMED = (
    _at(BearingCubic(stiffness=1e15), 10.0),
    _at(BearingClearance(gap=2e-6), 10.0),
    _at(BearingClearance(gap=2e-6), 3.0),
    _at(BearingClearance(gap=2e-6, preload=20.0), 10.0),
    _at(BearingHertz(preload=5e-6), 10.0),
    _at(BilinearSupport(ratio=1.5), 10.0),
    _at(Rub(stiffness=1e6, gap=3e-5, node=4), 10.0),
    _at(BearingFriction(force=1.0, stiffness=3e6), 2.0),
)
VARIED = TIMED[1]

# The rounding is judged on the sharpest law, the number of harmonics on the most harmonics.
CORNERS, SHARPEST = (0.05, 0.02, 0.005, 0.002), {"corner": 5e-4, "samples": 4096}
NUMBERS_OF_SAMPLES = (256, 512, 1024, 2048)
NUMBERS_OF_HARMONICS, MOST = (3, 5, 7, 9, 11, 15), 21

# Third harmonics below this share of the fundamental are not judged, nor lines this close to a jump [Hz].
SHOWN_THIRD, AT_A_JUMP_HZ = 0.02, 0.5


@dataclass(frozen=True)
class Timing:
    """Cost of one curve, its lines up and down, and the lines' stability [s]."""

    case: Case
    curve: Curve
    trace: float
    lines: float
    stability: float

    @property
    def total(self) -> float:
        """Curve and lines [s]."""
        return self.trace + self.lines


def balance(case: Case, **options: float) -> Balance:
    """The case's rotor; options as of ``Balance``."""
    model = build_model(structure(), condition(), [case.effect])
    return Balance(model, condition(), **({"harmonics": HARMONICS} | options))  # type: ignore[arg-type]


def timing(case: Case) -> Timing:
    """Best of a few runs, each from the model's matrices on."""
    best = None
    for _ in range(RUNS):
        marks = [time.process_time()]
        curve = trace(balance(case), LINES_HZ[0], LINES_HZ[-1], case.levels_N[0])
        marks.append(time.process_time())
        up, _ = curve.sweep(LINES_HZ, "up"), curve.sweep(LINES_HZ, "down")
        marks.append(time.process_time())
        floquet_multipliers(up.motions)
        marks.append(time.process_time())
        run = Timing(case, curve, *(float(second) for second in np.diff(marks)))
        best = run if best is None or run.total < best.total else best
    assert best is not None
    return best


def swept(case: Case, **options: float) -> Sweep:
    """An upward sweep of the case."""
    curve = trace(balance(case, **options), LINES_HZ[0], LINES_HZ[-1], case.levels_N[0])
    if not curve.complete:
        raise RuntimeError(f"the curve of {case.name} with {options} ends early: {curve.reason}")
    return curve.sweep(LINES_HZ, "up")


def difference(found: Sweep, reference: Sweep) -> list[str]:
    """Cells: median and 95th percentile of the difference in fundamental and in third harmonic, and the jumps."""
    A, B = (np.abs(sweep.motions.acceleration()[:, :, 1]) for sweep in (found, reference))
    jumps = np.concatenate([found.jumps_hz, reference.jumps_hz])
    calm = np.all(np.abs(LINES_HZ[:, None] - jumps) > AT_A_JUMP_HZ, axis=1)
    calm &= found.motions.converged & reference.motions.converged
    shown = calm & (B[:, 3] > SHOWN_THIRD * B[:, 1])
    cells = []
    for harmonic, lines in ((1, calm), (3, shown)):
        relative = 100 * np.abs(A[lines, harmonic] / B[lines, harmonic] - 1)
        cells += [f"{np.median(relative):.3f}", f"{np.percentile(relative, 95):.3f}"]
    return [*cells, ", ".join(f"{hz:.2f}" for hz in found.jumps_hz) or "none"]


def section() -> str:
    """Markdown of this section."""
    timings = [timing(case) for case in TIMED]
    cost = [
        (
            f"`{t.case.name}`",
            f"{t.case.levels_N[0]:g}",
            f"{len(t.curve.motions.frequency_hz)}",
            f"{len(t.curve.folds)}",
            f"{t.trace:.2f}",
            f"{t.lines:.2f}",
            f"{t.stability:.2f}",
        )
        for t in timings
    ]
    header = ("effect", "force, N", "points", "folds", "curve, s", "lines up and down, s", "stability of the lines, s")
    cubic, *clearances = (t.total for t in timings[:4])
    return f"""## Curves by harmonic balance

This section says how long harmonic balance takes for the shipped rotor. Nonlinear bearings are nonlinear at both ends.
Three steps are timed: following one response curve from {LINES_HZ[0]:g} to {LINES_HZ[-1]:g} Hz with {HARMONICS}
harmonics, reading {len(LINES_HZ)} lines of an upward and as many of a downward sweep from it, and computing the
stability of the upward lines by Floquet multipliers. The times are processor times of one core, the best of {RUNS}
runs.

{table(header, cost)}
{bar("cubic bearings, curve and lines", cubic, at_most=CUBIC_S, unit="s")}
{bar("bearings with clearance, curve and lines", max(clearances), at_most=CLEARANCE_S, unit="s")}
{_rounding()}
{_harmonics()}"""


COLUMNS = ("fundamental, median %", "95th", "third harmonic, median %", "95th", "jumps, Hz")


def _rounding() -> str:
    reference = swept(VARIED, **SHARPEST)
    by_corner = [(f"{corner:g}", *difference(swept(VARIED, corner=corner), reference)) for corner in CORNERS]
    by_samples = [(f"{n}", *difference(swept(VARIED, samples=n), reference)) for n in NUMBERS_OF_SAMPLES]
    return f"""### Rounded corners

The sharp corner of a force law is rounded so that the solver finds its way round it. The length of the rounding has two
parts, {CORNER:g} of the gap and {TRAVEL:g} of the distance that the joint travels between two samples of a period; it
is the root of the sum of their squares. Laws with corners use {SAMPLES_OF_CORNERS} samples per period unless stated
otherwise, laws without corners {SAMPLES}.

The tables show what the rounding changes. They compare the response of `{VARIED.name}` under {VARIED.levels_N[0]:g} N,
at the driven node in an upward sweep, with the sharpest calculation, which rounds over {SHARPEST["corner"]:g} of the
gap and uses {SHARPEST["samples"]} samples. Lines within {AT_A_JUMP_HZ:g} Hz of a jump are left out, and so are third
harmonics below {100 * SHOWN_THIRD:g} % of the fundamental. The column "95th" is the 95th percentile of the difference.

{table(("rounding over the gap", *COLUMNS), by_corner)}
{table(("samples of a period", *COLUMNS), by_samples)}"""


def _harmonics() -> str:
    reference = swept(VARIED, harmonics=MOST)
    rows = [(f"{n}", *difference(swept(VARIED, harmonics=n), reference)) for n in NUMBERS_OF_HARMONICS]
    return f"""### Number of harmonics

Here the same response is computed with few harmonics and compared with {MOST} harmonics. The third harmonic is far off
where a harmonic that was left out has the frequency of a natural mode (superharmonic resonance).

{table(("harmonics", *COLUMNS), rows)}"""


if __name__ == "__main__":
    print(section())
