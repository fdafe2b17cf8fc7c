"""Linear effects: the virtual rig on the FMU against the direct response, and what a response costs."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.page import bar, table
from rigtwin.fmu_src.build import build_rotor_fmu
from rigtwin.rotor.effects import EFFECTS, Effect, FastSweep
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.measured import channel_groups, measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import SupportKind
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, measure_lines

AGREEMENT = 1e-4  # bars
ONE_PLANE_MS, TWO_PLANES_MS = 1.5, 3.0

SUPPORTS: tuple[SupportKind, ...] = ("rigid", "bearing")
BAND_HZ = (20.0, 400.0)
EVEN_LINES, LINES_AT_A_RESONANCE = 24, (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)  # in half bandwidths
SPIN_RPM = 3000.0
NODES = tuple(range(1, 8))

# Channels are judged where a line is above this share of the channel's median.
SHARE_OF_MEDIAN = 0.01

TIMED_LINES, REPEATS = 280, 40


@dataclass(frozen=True)
class Agreement:
    """One effect on one support."""

    lines: int
    worst: float  # largest complex error of a line, relative to its own value


@dataclass(frozen=True)
class Cost:
    """Of one frequency response of one rotor; an effect may need several rotors."""

    rotors: int
    coupled: bool
    total_ms: float  # design, matrices, modes, response
    response_ms: float  # modes and response


def effects() -> list[Effect]:
    """Every linear effect with its start values; a fast sweep has no settled lines to compare."""
    return [effect() for effect in EFFECTS.values() if effect.family != "nonlinear" and effect is not FastSweep]


def condition(support: SupportKind, effect: Effect) -> Condition:
    """The nominal test condition; spinning where the effect needs it."""
    spin = SPIN_RPM * np.pi / 30 if effect.family == "spinning" else 0.0
    return Condition(rigid_support=support == "rigid", spin_speed=spin)


def lines(structure: Structure, test: Condition, effect: Effect) -> FloatArray:
    """Even lines over the band, and seven at each resonance in it."""
    modes = damped_modes(build_system(structure, test, channel_groups([effect], NODES)[0].effects), test.spin_speed)
    inside = (modes.frequency_hz > BAND_HZ[0]) & (modes.frequency_hz < BAND_HZ[1])
    close = [
        f * (1 + zeta * k)
        for f, zeta in zip(modes.frequency_hz[inside], modes.damping_ratio[inside], strict=True)
        for k in LINES_AT_A_RESONANCE
    ]
    return np.unique(np.round([*np.linspace(*BAND_HZ, EVEN_LINES), *close], 6))


def compare(session: FmuSession, structure: Structure, effect: Effect, support: SupportKind) -> Agreement:
    """The virtual rig with the effect against the formula, both per nominal force."""
    test = condition(support, effect)
    rig = Rig(support, effects=(effect,), spin_rpm=test.spin_speed * 30 / np.pi)
    run = measure_lines(session, rig, SweepPlan(), lines(structure, test, effect)).run
    exact = measured_response(structure, test, (effect,), run.frequency_hz, referred_to="nominal_force")
    size = np.abs(exact)
    judged = size > SHARE_OF_MEDIAN * np.median(size, axis=0)
    return Agreement(len(run.frequency_hz), float(np.max(np.abs(run.H - exact)[judged] / size[judged])))


def cost(structure: Structure, effect: Effect, support: SupportKind) -> Cost:
    """Best of many repeats."""
    test, frequency_hz = condition(support, effect), np.linspace(*BAND_HZ, TIMED_LINES)
    groups = channel_groups([effect], NODES)

    def system():
        return build_system(structure, test, groups[-1].effects)

    total = _best_ms(lambda _: measured_response(structure, test, (effect,), frequency_hz), lambda: None)
    response = _best_ms(lambda s: accelerance(s, frequency_hz, spin_speed=test.spin_speed), system)
    return Cost(len(groups), system().couples_planes(test.spin_speed), total / len(groups), response)


def _best_ms(work: Callable[[Any], object], prepare: Callable[[], Any]) -> float:
    """Time of ``work``, without that of preparing what it works on."""
    best = np.inf
    for _ in range(REPEATS):
        ready = prepare()
        start = time.perf_counter()
        work(ready)
        best = min(best, time.perf_counter() - start)
    return 1e3 * float(best)


def section() -> str:
    """Markdown of the comparison and of the timings."""
    structure = assemble(load_rig("nit-rourkela"))
    agreements: dict[str, dict[SupportKind, Agreement]] = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        FmuSession(build_rotor_fmu(load_rig("nit-rourkela"), Path(folder))) as session,
    ):
        for effect in effects():
            agreements[effect.id] = {support: compare(session, structure, effect, support) for support in SUPPORTS}
            print(f"{effect.id}: {agreements[effect.id]['bearing'].worst:.1e}", file=sys.stderr)
    costs = {effect.id: cost(structure, effect, "bearing") for effect in effects()}
    worst = max(a.worst for both in agreements.values() for a in both.values())
    one, two = (max(c.total_ms for c in costs.values() if c.coupled is coupled) for coupled in (False, True))
    rows = [
        (
            f"`{key}`",
            str(sum(a.lines for a in both.values())),
            *(f"{both[support].worst:.1e}" for support in SUPPORTS),
            str(costs[key].rotors),
            "both" if costs[key].coupled else "one",
            f"{costs[key].total_ms:.2f}",
            f"{costs[key].response_ms:.2f}",
        )
        for key, both in agreements.items()
    ]
    header = ("effect", "lines", "rigid", "bearing", "rotors", "planes", "with design, ms", "response, ms")
    return f"""## Linear effects: the FMU against the direct response

The virtual rig measures the rotor through `RotorRig.fmu`, on both supports, with one linear effect at a time at its
start value. Effects of the measurement chain are included, and spinning effects are measured at {SPIN_RPM:g} rev/min.
The results are compared with the response that `rigtwin.rotor.frequency.measured` computes directly. There are
{EVEN_LINES} evenly spaced lines from {BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz, and {len(LINES_AT_A_RESONANCE)} more at each
resonance.

The columns "rigid" and "bearing" give the largest error of the complex value over all nodes, relative to the value of
the same line. Lines below {100 * SHARE_OF_MEDIAN:g} % of the median of their channel are left out. For the exciter at
constant current (`force_dropout`) the response is divided by the nominal force.

The last two columns give the time for one response of {TIMED_LINES} lines at 7 nodes on bearings, the best of {REPEATS}
runs: first from the design of the rotor to the response, then from the finished matrices to the response. A sensor with
a mass loads the rotor only while its own channel is read, so several rotors must be solved; the time is that of one of
them.

{table(header, rows)}
{bar("FMU against direct response, largest error", worst, at_most=AGREEMENT)}
{bar("one response, one plane, design included", one, at_most=ONE_PLANE_MS, unit="ms")}
{bar("one response, coupled planes, design included", two, at_most=TWO_PLANES_MS, unit="ms")}"""


if __name__ == "__main__":
    print(section())
