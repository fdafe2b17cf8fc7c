"""A virtual oscilloscope on the virtual rig: records of settled lines, with noise and the steps of its converter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigtwin.rotor.frequency.measured import channel_groups
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.scratch import replacing
from rigtwin.sim.lines import LineReader, channels_of
from rigtwin.sim.session import FmuSession
from rigtwin.sim.setup import Rig, SweepPlan

# Settings that the knobs of an oscilloscope have, within each power of ten.
_KNOB = (1.0, 2.0, 5.0)

# A screen has so many divisions in height.
_DIVISIONS = 8


@dataclass(frozen=True)
class Oscilloscope:
    """How the signals of a force sensor and of accelerometers are recorded; channel 1 is the force."""

    bits: int = 8
    samples: int = 2500
    periods: int = 20  # at least, in a record
    noise: float = 0.02  # standard deviation of each sample, relative to the peak of its channel
    force_V_per_N: float = 22.4e-3
    acceleration_V_per_m_s2: float = 10.2e-3
    seed: int = 0

    def interval(self, frequency_hz: float) -> float:
        """Seconds between samples, as the knob of the time base allows."""
        return knob(self.periods / frequency_hz / self.samples)

    def digitise(self, volts: FloatArray, rng: np.random.Generator) -> FloatArray:
        """(n, n_channels) with noise and the converter's steps; the peak fills the screen as far as the knob allows."""
        peak = np.abs(volts).max(axis=0)
        noisy = volts + self.noise * peak * rng.standard_normal(volts.shape)
        last = 2 ** (self.bits - 1) - 1  # upwards there is one step less than downwards
        filled = np.abs(noisy).max(axis=0) * (last + 1) / last
        division = np.array([knob(reach / (_DIVISIONS / 2)) for reach in filled])
        step = division * _DIVISIONS / 2**self.bits
        return np.clip(np.round(noisy / step), -last - 1, last) * step

    def plan(self, nodes: Sequence[int]) -> str:
        """The plan of a reduction of its records, as TOML."""
        lines = [f'force = {{column = "CH1", sensitivity = "{1e3 * self.force_V_per_N:g} mV/N"}}']
        response = f"{1e3 * self.acceleration_V_per_m_s2:g} mV/(m/s^2)"
        lines += [f'node{n} = {{column = "CH{k}", sensitivity = "{response}"}}' for k, n in enumerate(nodes, start=2)]
        return "[channels]\n" + "\n".join(lines) + "\n"


def knob(at_least: float) -> float:
    """The next setting of a knob.

    >>> knob(0.03), knob(4.1)
    (0.05, 5.0)
    """
    if not at_least > 0:
        return 1e-3
    decade = 10.0 ** np.floor(np.log10(at_least))
    return float(next(m * decade for m in (*_KNOB, 10.0) if m * decade >= at_least * (1 - 1e-9)))


def record_lines(
    session: FmuSession, rig: Rig, frequencies_hz: Sequence[float], nodes: Sequence[int], scope: Oscilloscope
) -> Iterator[tuple[float, float, FloatArray]]:
    """Let every line settle, then record it.

    Parameters
    ----------
    frequencies_hz : in the order of the sweep
    nodes : of the accelerometers, in the plane of the force

    Yields
    ------
    frequency [Hz], seconds between samples, and (samples, 1 + n_nodes) volts of the force and the accelerometers
    """
    plan = rig.carry_out(SweepPlan())
    every = [channel.node for channel in channels_of(session, rig)]
    reader = LineReader(session, rig, plan, channel_groups(rig.effects, every)[0])
    outputs = ["force_applied", *(f"node_{node}.acceleration_{rig.excitation_plane}" for node in nodes)]
    to_volts = np.array([scope.force_V_per_N] + [scope.acceleration_V_per_m_s2] * len(nodes))
    rng = np.random.default_rng(scope.seed)
    reader.start()
    for frequency in frequencies_hz:
        reader.read(frequency)
        interval = scope.interval(frequency)
        volts = session.sample(outputs, interval, scope.samples) * to_volts
        yield frequency, interval, scope.digitise(volts, rng)


def write_record(path: Path, interval_s: float, volts: FloatArray) -> None:
    """Write a CSV as oscilloscopes do: a preamble, the names of the columns, a line per sample."""
    names = [f"CH{k + 1}" for k in range(volts.shape[1])]
    preamble = [
        "Model,rigtwin virtual oscilloscope",
        f"Record Length,{len(volts)},Points",
        f"Sample Interval,{interval_s:g},s",
        f"Vertical Units,{','.join('V' for _ in names)}",
        f"TIME,{','.join(names)}",
    ]
    time = (np.arange(len(volts)) - len(volts) // 2) * interval_s
    table = np.column_stack([time, volts])
    with replacing(path) as beside, beside.open("w", encoding="utf-8", newline="") as file:
        file.write("\n".join(preamble) + "\n")
        np.savetxt(file, table, fmt="%.9g", delimiter=",")


def file_name(frequency_hz: float) -> str:
    """Of a line's record.

    >>> file_name(95.4837)
    '095.484Hz.csv'
    """
    return f"{frequency_hz:07.3f}Hz.csv"
