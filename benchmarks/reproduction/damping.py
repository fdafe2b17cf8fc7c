"""Viscous shaft damping against constant hysteresis."""

from __future__ import annotations

import numpy as np

from benchmarks.page import bar, table
from benchmarks.reproduction.nominal import percent, system, two_frequencies_hz
from rigtwin.rotor.frequency.frequency_response import (
    ComplexArray,
    FloatArray,
    accelerance,
    hysteretic_dynamic_stiffness,
    receptance,
)
from rigtwin.rotor.model.system import LinearSystem

SUPPORTS = {1e15: "rigid", 1e7: "k_b = 1e7 N/m", 1e6: "k_b = 1e6 N/m"}
STEP_HZ = 0.05
CHUNK = 500  # lines solved at once, to bound the memory
NODE_2 = 1


def hysteretic_accelerance(supported: LinearSystem, frequency_hz: FloatArray) -> ComplexArray:
    """(n_freq, n_nodes, 1) accelerance under a force at node 2 with a complex shaft stiffness."""
    omega = 2 * np.pi * frequency_hz
    H = receptance(
        hysteretic_dynamic_stiffness(supported, omega), supported.unit_vector(2, 1)[:, None], supported.read_out(1)
    )
    return -(omega[:, None, None] ** 2) * H


def both(supported: LinearSystem, frequency_hz: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """(n_freq, n_nodes) viscous and hysteretic accelerance."""
    pieces = np.array_split(frequency_hz, max(1, len(frequency_hz) // CHUNK))
    viscous = np.concatenate([accelerance(supported, piece) for piece in pieces])[:, :, 0]
    return viscous, np.concatenate([hysteretic_accelerance(supported, piece) for piece in pieces])[:, :, 0]


def damping_models() -> str:
    """How far the two damping models lie apart from 20 to 400 Hz."""
    lines = np.arange(20.0, 400.0 + STEP_HZ / 2, STEP_HZ)
    rows, peaks = [], []
    for k_b, name in SUPPORTS.items():
        supported = system(k_b)
        viscous, hysteretic = both(supported, lines)
        nrmse = np.sqrt((np.abs(viscous - hysteretic) ** 2).sum() / (np.abs(hysteretic) ** 2).sum())
        decibel = np.abs(20 * np.log10(np.abs(viscous[:, NODE_2] / hysteretic[:, NODE_2])))
        at_peaks = [percent(a, b) for a, b in np.abs(both(supported, two_frequencies_hz(supported)))[:, :, NODE_2].T]
        peaks += [abs(p) for p in at_peaks]
        rows.append(
            (
                name,
                f"{100 * nrmse:.4f}",
                f"{decibel.max():.2f}",
                f"{lines[decibel.argmax()]:.2f}",
                *(f"{p:+.5f}" for p in at_peaks),
            )
        )
    header = ("support", "NRMSE, %", "largest difference at node 2, dB", "at, Hz", "at f1, %", "at f2, %")
    return f"""## Viscous and hysteretic damping

The damping of the shaft is viscous in every solver. It is scaled so that the loss factor of each mode is 2ζ times the
share of its strain energy that is in the shaft. The usual alternative in the frequency domain is constant hysteresis, a
complex stiffness K_s(1 + 2iζ). It has no causal model in time, so an FMU cannot have it.

The table shows how much the choice matters. It compares the accelerance under a force at node 2 from 20 to 400 Hz in
steps of {STEP_HZ:g} Hz. The NRMSE is √(Σ|ΔH|²/Σ|H|²) over all nodes:

{table(header, rows)}
{bar("viscous against hysteretic, largest difference of a resonance peak", max(peaks), at_most=0.1, unit="%")}
The two models agree at resonance by construction. The NRMSE comes from the flanks of the resonances, where the viscous
force is ω/ω_n times the hysteretic one. The largest difference in decibels occurs at an antiresonance, between the
resonances or just above them. There the response is almost zero, and only the damping keeps it from vanishing. A
measurement with noise shows neither difference.
"""
