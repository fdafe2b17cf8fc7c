"""One blind campaign before it is measured: the hidden rig, the test plan, and the responses free of noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.lines import N_LINES, choose_lines, resonances, with_armature
from rigtwin.blind.generate.machine import Setting, Workshop
from rigtwin.blind.generate.nonlinear import bent_peaks, swept_up
from rigtwin.blind.generate.response import N_DRIFTING, chain_factor, machines, reported
from rigtwin.blind.generate.rig import ComplexArray, FloatArray, Rig
from rigtwin.blind.generate.transient import swept

GAIN_TOLERANCE = 0.02
FREQUENCY_DRIFT = 1e-4
TOLERANCE = 1e-3  # of modulus, span, each disk's mass: uniform, as much to either side
TOLERANCE_STD = TOLERANCE / np.sqrt(3)
NOISE_FLOOR = 1e-4  # of the run's median


@dataclass(frozen=True)
class Tolerances:
    """What is not known of a rig: relative standard deviations, of dampings those of the logarithm; 0: it is known."""

    modulus: float = float(TOLERANCE_STD)
    span: float = float(TOLERANCE_STD)  # of all lengths along the shaft
    disk_mass: float = float(TOLERANCE_STD)
    shaft_damping: float = 0.0
    bearing_damping: float = 0.0
    gain: float = GAIN_TOLERANCE  # of each run's force; that of each sensor is half of it
    repeatability: float = 0.0  # of a sensor's gain from run to run
    drift: float = FREQUENCY_DRIFT  # of a resonance from run to run


@dataclass(frozen=True)
class Case:
    """What the label tells, and what nobody needs to know."""

    set: str
    effects: tuple[Effect, ...]
    k_b: float  # [N/m]
    c_b: float  # [N s/m] nominal
    zeta: float  # nominal
    workshop: Workshop
    noise: float  # relative standard error of every complex value
    sensors: str = "all"  # or "one": node 2
    levels: tuple[float, ...] = (1.0,)  # [N] of the bearing runs
    with_std: bool = True
    quantity: str = "accelerance"  # or "acceleration" per nominal newton, at constant current
    exclude: tuple[str, ...] = ()
    sensor_gains: tuple[float, ...] = field(default=(0.0,) * 7)  # relative errors
    drive_node: int = 2
    force: float = 1.0  # [N] of the runs in which the rig is linear
    repeats: int = 0  # of the bearing run at the middle level
    tolerances: Tolerances = Tolerances()
    stated: Mapping[str, float] | None = None  # what [nominal] says; None: everything, as it is

    def setting(self, rigid: bool, drive_node: int) -> Setting:
        return Setting(rigid, self.k_b, self.c_b, self.zeta, drive_node)

    @property
    def nodes(self) -> tuple[int, ...]:
        return tuple(range(1, len(self.sensor_gains) + 1)) if self.sensors == "all" else (self.drive_node,)

    @property
    def rigid_level(self) -> float:
        """Force [N] of the rigid run; a rub acts there, too."""
        return self.levels[len(self.levels) // 2] if any(e.id == "rub" for e in self.effects) else self.force

    @property
    def is_nonlinear(self) -> bool:
        return any(e.is_nonlinear for e in self.effects)


@dataclass(frozen=True)
class Run:
    """One stepped sine: its plan and the response free of noise."""

    name: str
    setting: Setting
    level: float  # [N]
    frequency_hz: FloatArray  # (n_freq,)
    gain: float  # relative error of the force
    drift: FloatArray  # (2, n_modes)
    ideal: ComplexArray  # (n_freq, n_nodes) the rig's, without gains and drift
    actual: ComplexArray  # with them, without noise


def response(
    rig: Rig, case: Case, setting: Setting, frequency_hz: FloatArray, level: float, drift: FloatArray
) -> ComplexArray:
    """(n_freq, n_nodes) accelerance that the accelerometers would report without noise and gain errors."""
    effects = case.effects
    fast = [e for e in effects if e.id == "fast_sweep"]
    if case.is_nonlinear:
        return swept_up(rig, setting, effects, frequency_hz, level, case.workshop, drift[0])
    if fast:
        machine = machines(rig, setting, effects, case.workshop)[0]
        H = swept(machine, frequency_hz, fast[-1]["dwell"], drift[0])
        return H * chain_factor(effects, frequency_hz, len(rig.nodes))
    return reported(rig, setting, effects, frequency_hz, case.workshop, drift)


def plan_lines(
    rig: Rig,
    case: Case,
    setting: Setting,
    level: float,
    rng: np.random.Generator,
    effects: Sequence[Effect] | None = None,
) -> FloatArray:
    """The run's lines [Hz]: refined at the resonances, or the even raster of ``coarse_grid``."""
    effects = case.effects if effects is None else effects
    steps = [e["step"] for e in effects if e.id == "coarse_grid"]
    if steps:
        low, high = rig.plan.band_hz
        return np.arange(low, high + 1e-9, steps[-1])
    peaks = [
        peak
        for machine in machines(rig, setting, effects, case.workshop)
        for peak in resonances(with_armature(machine, effects))
    ]
    if any(e.id == "rub" or (e.is_nonlinear and not setting.rigid) for e in effects):
        peaks = bent_peaks(rig, setting, effects, level, case.workshop, peaks)
    return choose_lines(peaks, rng, N_LINES, rig.plan.band_hz)


def measure(rig: Rig, case: Case, drive_node: int, levels: Sequence[float], rng: np.random.Generator) -> list[Run]:
    """A rigid run and a bearing run at every level, each with its own force gain and drift."""
    tolerances = case.tolerances
    plans = [("rigid", True, case.rigid_level), *(("bearing", False, level) for level in levels)]
    runs = []
    for number, (support, rigid, level) in enumerate(plans, start=1):
        setting = case.setting(rigid, drive_node)
        frequency = plan_lines(rig, case, setting, level, rng)
        drift = tolerances.drift * rng.standard_normal((2, N_DRIFTING))
        gain = tolerances.gain * rng.standard_normal()
        ideal = response(rig, case, setting, frequency, level, np.zeros_like(drift))
        actual = response(rig, case, setting, frequency, level, drift)
        actual = actual * (1 + gain) * (1 + np.array(case.sensor_gains))
        if tolerances.repeatability:
            actual = actual * (1 + tolerances.repeatability * rng.standard_normal(len(case.sensor_gains)))
        there = np.isfinite(ideal[:, 0] + actual[:, 0])  # lines that repeat
        frequency, ideal, actual = frequency[there], ideal[there], actual[there]
        name = f"run{number:02d}_{support}_{level:g}N"
        runs.append(Run(name, setting, level, frequency, float(gain), drift, ideal, actual))
    return runs


def standard_error(actual: ComplexArray, noise: float) -> FloatArray:
    """(n_freq, n_nodes) standard error of the complex values, relative noise and a floor of the run's median."""
    moving = np.abs(actual[:, np.abs(actual).max(axis=0) > 0])
    return np.sqrt((noise * np.abs(actual)) ** 2 + (NOISE_FLOOR * np.median(moving)) ** 2)
