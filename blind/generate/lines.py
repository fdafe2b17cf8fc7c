"""Frequency lines as a lab chooses them: a base raster, and clusters round the resonances of a first look."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.machine import Machine
from rigtwin.blind.generate.rig import PLANS, REFERENCE, ComplexArray, FloatArray

N_LINES = 280
PER_CLUSTER = 41
REACH = 10.0  # half-power bands on either side
CROWDING = 3.4  # asinh spacing: about ten lines within the half-power band


def resonances(machine: Machine) -> list[tuple[float, float]]:
    """(frequency, half-power width) [Hz] of every resonance in the band.

    A frequency-dependent spring is put in with its stiffness and loss at the resonance itself.
    """
    found = []
    for pole in _in_band(machine.poles(), machine.band_hz):
        for _ in range(3 if machine.springs else 0):
            near = _in_band(_frozen(machine, abs(pole.imag)).poles(), machine.band_hz)
            if len(near):
                pole = near[np.argmin(np.abs(near - pole))]
        found.append((float(pole.imag / 2 / np.pi), float(-pole.real / np.pi)))
    return sorted(found)


def _in_band(poles: ComplexArray, band_hz: tuple[float, float]) -> ComplexArray:
    frequency = poles.imag / (2 * np.pi)
    return poles[(frequency > band_hz[0]) & (frequency < band_hz[1])]


def _frozen(machine: Machine, omega: float) -> Machine:
    K, C = machine.K.copy(), machine.C.copy()
    for row, spring in machine.springs:
        d = complex(spring(np.array([omega]))[0])
        K += d.real * np.outer(row, row)
        C += d.imag / omega * np.outer(row, row)
    return replace(machine, K=K, C=C, springs=())


def with_armature(machine: Machine, effects: Sequence[Effect]) -> Machine:
    """At constant current the exciter's armature is part of what resonates."""
    for e in effects:
        if e.id == "force_dropout":
            dd = np.outer(machine.drive, machine.drive)
            machine = replace(
                machine,
                M=machine.M + e["mass"] * dd,
                K=machine.K + e["stiffness"] * dd,
                C=machine.C + e["damping"] * dd,
            )
    return machine


def choose_lines(
    peaks: Iterable[tuple[float, float]],
    rng: np.random.Generator,
    n_lines: int = N_LINES,
    band_hz: tuple[float, float] = PLANS[REFERENCE].band_hz,
) -> FloatArray:
    """(n_lines,) increasing frequencies [Hz] for peaks of given frequency and half-power width."""
    low, high = band_hz
    clusters = [cluster(f * (1 + 0.02 * width / f * rng.standard_normal()), width) for f, width in peaks]
    close = np.concatenate([c[(c > low) & (c < high)] for c in clusters]) if clusters else np.empty(0)
    if len(close) > 0.75 * n_lines:
        close = rng.choice(close, int(0.75 * n_lines), replace=False)
    base = np.linspace(low, high, n_lines - len(close))
    step = base[1] - base[0]
    base[1:-1] += rng.uniform(-0.3, 0.3, len(base) - 2) * step
    lines = np.sort(np.concatenate([base, close]))
    return np.round(_apart(lines), 6)


def cluster(frequency_hz: float, width_hz: float) -> FloatArray:
    """(PER_CLUSTER,) lines, dense at the resonance."""
    s = np.linspace(-1, 1, PER_CLUSTER)
    return frequency_hz + REACH * width_hz * np.sinh(CROWDING * s) / np.sinh(CROWDING)


def _apart(lines: FloatArray, least: float = 1e-4) -> FloatArray:
    """Lines at least this far apart [Hz], in the same order."""
    index = np.arange(len(lines))
    return np.maximum.accumulate(lines - least * index) + least * index
