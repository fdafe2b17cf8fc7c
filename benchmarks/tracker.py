"""How well k_b is tracked: ``python -m benchmarks.tracker [--page FILE]``; minutes.

The whole finite-element rotor, stepped four times as fast as the tracker, is the rig: band noise or a multisine drives
node 2, where an accelerometer with 2 % of noise reads. StiffnessTracker.fmu, compiled, follows k_b, first with
method 2, the Kalman filter, then with method 1, the network that comes with rigtwin.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.linalg import expm
from scipy.signal import butter, sosfilt

from benchmarks.page import bar, machine, table
from rigtwin.estimator.tracking import shipped_tracker
from rigtwin.estimator.tracking.network import NetworkTracker, TrackerNetwork
from rigtwin.estimator.tracking.tracker import Belief, StiffnessTracker
from rigtwin.fmu_src.build import TRACKER, build_native_listener_fmu, reduced_rotor
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.effects import DiskMass
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.session import FmuSession

RIG = load_rig("nit-rourkela")
NODE, STEP, FASTER, BLOCK = 2, 1e-4, 4, 50  # the rotor's k_b changes after so many instants at most
TRUE = Condition(shaft_damping_ratio=0.005, bearing_damping=20.0, excitation_node=NODE)
NOISE = 0.02
STIFFNESSES = (1e6, 3e6, 1e7, 3e7)
WITHIN, ROUGHLY = 0.03, 0.1  # of k_b: has followed a jump, by the filter and by the network


@dataclass(frozen=True)
class Stream:
    """Instants of a rig: force [N], acceleration [m/s^2] and k_b [N/m]."""

    force: FloatArray
    read: FloatArray
    k_b: FloatArray


def main() -> None:
    """Measure, print, and write the page if one is asked for."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_native_listener_fmu(TRACKER, RIG, Path(folder), (NODE,), targets=[this_machine()])
        parts = [_jumps(fmu), _ramps(fmu), _single_lines(fmu), _network(fmu), _network_elsewhere(fmu), _steps(fmu)]
    text = "\n\n".join([f"{__doc__.split(chr(10) * 2)[1]}\n\n{machine()}", *parts])
    print(text)
    if "--page" in sys.argv:
        Path(sys.argv[sys.argv.index("--page") + 1]).write_text(
            f"# The tracker, measured\n\n{text}\n", encoding="utf-8"
        )


# -- what is measured --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Jump:
    """A rig whose k_b falls by 40 % after a second."""

    masses: str
    excitation: str
    k_b: float  # [N/m]
    rig: Stream


@cache
def jumps() -> tuple[Jump, ...]:
    """Of two forces, four stiffnesses and three masses."""
    return tuple(
        Jump(masses, excitation.__name__.replace("_", " "), k_b, simulate(excitation, 1.6, _falls(k_b), change))
        for change, masses in ((0.0, "as drawn"), (0.05, "5 % heavier"), (-0.05, "5 % lighter"))
        for excitation in (band_noise, multisine)
        for k_b in STIFFNESSES
    )


def _falls(k_b: float) -> Callable[[float], float]:
    return lambda t: k_b if t < 1.0 else 0.6 * k_b


def _followed_after(off: FloatArray, within: float) -> float:
    """Milliseconds after the jump from which on the error stays within this."""
    after = np.flatnonzero(np.abs(off[10_000:]) > within)
    return 1e3 * STEP * (after[-1] + 1) if len(after) else 0.0


def _jumps(fmu: Path) -> str:
    rows, settled, steady, wrong = [], [], [], []
    for jump in jumps():
        told = track(fmu, jump.rig, k_b_start=1.1 * jump.k_b, disk_mass_std=0.05)
        off, valid = np.log(told[:, 0] / jump.rig.k_b), told[:, 3] > 0
        settled.append(_followed_after(off, WITHIN))
        steady.append(100 * float(np.sqrt(np.mean(off[13_000:] ** 2))))
        inside = (told[:, 1] < jump.rig.k_b) & (jump.rig.k_b < told[:, 2])
        wrong.append(float(np.mean(~inside & (np.abs(off) > WITHIN), where=valid)))
        numbers = f"{settled[-1]:.0f}", f"{steady[-1]:.2f}", f"{100 * np.mean(valid[13_000:]):.0f} %"
        rows.append((jump.masses, jump.excitation, f"{jump.k_b / 1e6:g}", *numbers))
    header = ("disks", "force", "k_b, MN/m", "ms until within 3 %", "then off by, % rms", "valid")
    bars = [
        bar("median of the times, ms", float(np.median(settled)), at_most=100.0),
        bar(
            "share of the jumps that are not followed within 300 ms",
            float(np.mean(np.array(settled) > 300)),
            at_most=0.0,
        ),
        bar("median of the errors, %", float(np.median(steady)), at_most=0.5),
        bar("share with an error above 0.8 %", float(np.mean(np.array(steady) > 0.8)), at_most=0.0),
        bar(
            "share of valid instants off by more than 3 % and outside the interval", float(np.mean(wrong)), at_most=0.01
        ),
    ]
    return "\n".join(["## k_b falls by 40 %\n", _KNOWN, "", table(header, rows), "", *bars])


def _network(fmu: Path) -> str:
    """The network beside the filter on the same streams."""
    rows, errors, held, valid_share = [], {1: [], 2: []}, [], []
    for jump in jumps():
        numbers: list[str] = []
        for method in (2, 1):
            told = track(fmu, jump.rig, k_b_start=1.1 * jump.k_b, disk_mass_std=0.05, method=method)
            off, late = np.log(told[:, 0] / jump.rig.k_b), slice(13_000, None)
            errors[method].append(100 * float(np.sqrt(np.mean(off[late] ** 2))))
            numbers += [f"{_followed_after(off, ROUGHLY):.0f}", f"{errors[method][-1]:.2f}"]
        valid, inside = told[:, 3] > 0, (told[:, 1] < jump.rig.k_b) & (jump.rig.k_b < told[:, 2])
        held.append(inside[valid])
        valid_share.append(float(np.mean(valid[late])))
        rows.append((jump.masses, jump.excitation, f"{jump.k_b / 1e6:g}", *numbers, f"{100 * valid_share[-1]:.0f} %"))
    header = (
        *("disks", "force", "k_b, MN/m", "filter: ms until within 10 %", "then off by, % rms"),
        *("network: ms until within 10 %", "then off by, % rms", "valid"),
    )
    coverage = np.concatenate(held)
    said = (
        f"Medians of the errors: filter {np.median(errors[2]):.2f} %, network {np.median(errors[1]):.2f} %. The "
        f"network is valid in {100 * np.mean(valid_share):.0f} % of the late instants; of all valid instants its 90 % "
        f"interval holds k_b in {100 * np.mean(coverage):.0f} %."
    )
    return "\n".join(["## The network on the same jumps\n", table(header, rows), "", said])


def _network_elsewhere(fmu: Path) -> str:
    """Ramps and single lines by the network."""
    rows = []
    for k_b in (3e6, 2e7):
        for rate in (0.0, 0.01, 0.1, 0.5):
            rig = simulate(band_noise, 2.0, lambda t, k_b=k_b, r=rate: k_b * np.exp(-r * max(0.0, t - 1.0)), 0.0)
            told, true = track(fmu, rig, method=1)[10_000:], rig.k_b[10_000:]
            off, inside, valid = np.log(told[:, 0] / true), (told[:, 1] < true) & (true < told[:, 2]), told[:, 3] > 0
            numbers = f"{100 * np.sqrt(np.mean(off**2)):.2f}", f"{np.mean(inside):.2f}", f"{100 * np.mean(valid):.0f} %"
            rows.append((f"{k_b / 1e6:g}", f"{100 * rate:g}", *numbers))
    header = ("k_b, MN/m", "falls by, % a second", "off by, % rms", "90 % interval holds it", "valid")
    lines = []
    for hz in (60.0, 90.0, 250.0):
        rig = simulate(lambda n, rng, hz=hz: sine(n, hz), 2.0, lambda t: 3e6, 0.0)
        told = track(fmu, rig, method=1)[10_000:]
        off = np.abs(np.log(told[:, 0] / 3e6))
        width = np.log(told[:, 2] / told[:, 1]) / 2
        lines.append(
            (f"{hz:g}", f"{100 * np.mean(told[:, 3]):.0f} %", f"{100 * off.max():.1f}", f"{100 * np.median(width):.0f}")
        )
    names = ("sine, Hz", "valid", "off by at most, %", "half the interval, %")
    slowly = "\n".join(["## The network where k_b falls slowly\n", table(header, rows)])
    return "\n".join([slowly, "", "## The network on a single line\n", table(names, lines)])


_KNOWN = (
    "The tracker believes k_b to be 10 % too high with an error of 30 %, the disks' masses to 5 %, the dampings to a "
    "factor of two, and the gain to 2 %."
)


def _ramps(fmu: Path) -> str:
    rows, covered = [], []
    for k_b in (3e6, 2e7):
        for rate in (0.0, 0.01, 0.1, 0.5):
            rig = simulate(band_noise, 2.0, lambda t, k_b=k_b, r=rate: k_b * np.exp(-r * max(0.0, t - 1.0)), 0.0)
            told = track(fmu, rig, k_b_start=1.1 * k_b)[10_000:]
            true = rig.k_b[10_000:]
            off, inside = np.log(told[:, 0] / true), (told[:, 1] < true) & (true < told[:, 2])
            covered.append(float(np.mean(inside)))
            rows.append(
                (f"{k_b / 1e6:g}", f"{100 * rate:g}", f"{100 * np.sqrt(np.mean(off**2)):.2f}", f"{covered[-1]:.2f}")
            )
    header = ("k_b, MN/m", "falls by, % a second", "off by, % rms", "90 % interval holds it")
    return "\n".join(
        ["## k_b falls slowly\n", table(header, rows), "", bar("largest share outside", 1 - min(covered), at_most=0.15)]
    )


def _single_lines(fmu: Path) -> str:
    rows = []
    for hz in (60.0, 90.0, 250.0):
        rig = simulate(lambda n, rng, hz=hz: sine(n, hz), 2.0, lambda t: 3e6, 0.0)
        known = dict.fromkeys(("disk_mass_std", "bearing_damping_std", "shaft_damping_std", "gain_std"), 0.0)
        unknown, sure = track(fmu, rig), track(fmu, rig, **known)
        valid = sure[10_000:, 3] > 0
        off = np.abs(np.log(sure[10_000:, 0] / 3e6))[valid]
        worst = f"{100 * off.max():.2f}" if len(off) else "-"
        rows.append((f"{hz:g}", f"{100 * np.mean(unknown[:, 3]):.0f} %", f"{100 * np.mean(valid):.0f} %", worst))
    header = ("sine, Hz", "valid, mass and gain unknown", "valid, all but k_b known", "then off by at most, %")
    return "\n".join(["## A single line\n", table(header, rows)])


def _steps(fmu: Path) -> str:
    """Processor time of the filter in Python, when one filter runs, and of the network."""
    rig = simulate(band_noise, 1.2, lambda t: 3e6, 0.0)
    belief = Belief(3e6, 20.0, 0.005, k_b_std=0.02)
    filter_ = _spent(StiffnessTracker(reduced_rotor(RIG, assemble(RIG)), (NODE,), belief), rig)
    network = _spent(NetworkTracker(TrackerNetwork(shipped_tracker()), belief), rig)
    compiled = [_spent_compiled(fmu, rig, method) for method in (2, 1)]
    return (
        f"## Time\n\nA step of the filter in Python, when one filter runs: {np.median(filter_[8_000:]):.0f} µs in the "
        f"median; of the network: {np.mean(network[8_000:]):.0f} µs in the mean, as it answers in every 32nd step. The "
        f"compiled FMU with all that fmpy does for a step takes {compiled[0]:.1f} µs with the filter and "
        f"{compiled[1]:.1f} µs with the network."
    )


def _spent(tracker: StiffnessTracker | NetworkTracker, rig: Stream) -> FloatArray:
    """Microseconds of every step."""
    spent = np.zeros(len(rig.force))
    for i, (force, read) in enumerate(zip(rig.force, rig.read, strict=True)):
        start = time.perf_counter()
        tracker.step(STEP, force, np.array([read]))
        spent[i] = time.perf_counter() - start
    return 1e6 * spent


def _spent_compiled(fmu: Path, rig: Stream, method: int) -> float:
    """Microseconds of a step in the mean, after the start."""
    spent = np.zeros(len(rig.force))
    with FmuSession(fmu) as session:
        session.start({"method": method, "k_b_start": 3e6, "k_b_start_std": 0.02})
        for i, (force, read) in enumerate(zip(rig.force.tolist(), rig.read.tolist(), strict=True)):
            session.set({"force": force, f"node_{NODE}.acceleration_y": read})
            start = time.perf_counter()
            session.step(STEP)
            spent[i] = time.perf_counter() - start
    return 1e6 * float(np.mean(spent[8_000:]))


# -- a rig -------------------------------------------------------------------------------------------------


def band_noise(n: int, rng: np.random.Generator) -> FloatArray:
    """20 to 400 Hz."""
    wanted = butter(4, [20, 400], "bandpass", fs=FASTER / STEP, output="sos")
    noise = sosfilt(wanted, rng.standard_normal(n))
    return noise / noise.std()


def multisine(n: int, rng: np.random.Generator) -> FloatArray:
    """Every 20 Hz from 20 to 380 Hz, random phases."""
    t = np.arange(n) * STEP / FASTER
    lines = [
        np.sin(2 * np.pi * hz * t + phase) for hz, phase in zip(range(20, 400, 20), rng.uniform(0, 7, 19), strict=True)
    ]
    return sum(lines) / np.sqrt(len(lines) / 2)


def sine(n: int, hz: float) -> FloatArray:
    """One line."""
    return np.sqrt(2) * np.sin(2 * np.pi * hz * np.arange(n) * STEP / FASTER)


Excitation = Callable[[int, np.random.Generator], FloatArray]


def simulate(excitation: Excitation, seconds: float, k_b_at: Callable[[float], float], mass: float) -> Stream:
    """The whole rotor in time, the force fading in over 20 ms; disks are heavier by a share ``mass``."""
    n, rng = round(seconds / STEP), np.random.default_rng(1)
    force = excitation(n * FASTER, rng) * np.minimum(np.arange(n * FASTER) * STEP / FASTER / 0.02, 1.0)
    structure, effects = assemble(RIG), (DiskMass(change=mass),) if mass else ()
    read, k_b, x = np.zeros(n), np.zeros(n), None
    for i in range(n):
        if i % BLOCK == 0 and (not i or k_b_at((i + BLOCK / 2) * STEP) != k_b[i - 1]):
            now = k_b_at((i + BLOCK / 2) * STEP)
            T, left, right, seen, direct = _matrices(structure, replace(TRUE, k_b=now), effects)
        x = np.zeros(len(T)) if x is None else x
        k_b[i], read[i] = now, seen @ x + direct * force[i * FASTER]
        for j in range(i * FASTER, (i + 1) * FASTER):
            x = T @ x + left * force[j] + right * force[min(j + 1, len(force) - 1)]
    return Stream(force[::FASTER], read + NOISE * read.std() * rng.standard_normal(n), k_b)


def _matrices(structure: Structure, condition: Condition, effects: tuple) -> Iterator[FloatArray]:
    """A quarter of a step under a force that is a ramp, and the accelerometer's reading."""
    system = build_system(structure, condition, effects).in_plane(1)
    n, unit = system.n, system.unit_vector(NODE, 1)
    slow = 2 * np.pi * 500.0  # makes deflections as large as velocities
    rows = np.linalg.solve(system.M, np.column_stack([-system.K / slow, -system.C, unit]))
    A = np.zeros((2 * n + 2, 2 * n + 2))
    A[:n, n : 2 * n] = slow * np.eye(n)
    A[n : 2 * n, : 2 * n + 1] = rows
    A *= STEP / FASTER
    A[2 * n, 2 * n + 1] = 1.0
    E = expm(A)[: 2 * n]
    yield from (E[:, : 2 * n], E[:, 2 * n] - E[:, 2 * n + 1], E[:, 2 * n + 1])
    yield from (unit @ rows[:, : 2 * n], unit @ rows[:, 2 * n])


def track(fmu: Path, rig: Stream, **settings: float) -> FloatArray:
    """(n, 4) k_b, its interval and ``valid`` of the FMU, after every instant."""
    believed = {"k_b_start": 3.3e6, "bearing_damping": 20.0, "shaft_damping_ratio": 0.005, **settings}
    told = np.zeros((len(rig.force), 4))
    with FmuSession(fmu) as session:
        session.start(believed)
        for i, (force, read) in enumerate(zip(rig.force.tolist(), rig.read.tolist(), strict=True)):
            session.set({"force": force, f"node_{NODE}.acceleration_y": read})
            session.step(STEP)
            told[i] = session.get(("k_b", "k_b_low", "k_b_high", "valid"))
    return told


if __name__ == "__main__":
    main()
