"""A stepped sweep that does not wait: every line is read a fixed time after its frequency was set."""

from __future__ import annotations

import numpy as np

from gap.blind.machine import Machine
from gap.blind.rig import ComplexArray, FloatArray

WINDOW = 0.08  # s, read over the last whole periods of at most this


def swept(machine: Machine, frequency_hz: FloatArray, dwell: float, drift: FloatArray) -> ComplexArray:
    """(n_freq, n_nodes) accelerance that an upward sweep reads; it starts at rest and its phase is continuous.

    While the frequency stays, an eigenvector has the coordinate z = p e^{i phi} + (z_0 - p e^{i phi_0}) e^{lambda t}
    with p = beta/(i omega - lambda). What is read is (2/W) times the integral of the real acceleration and e^{-i phi}
    over W, the last whole periods of the dwell.
    """
    values, read, loads = _decomposed(machine, drift)
    z = np.zeros(len(values), dtype=complex)
    phi = 0.0
    H = np.empty((len(frequency_hz), len(machine.read)), dtype=complex)
    for k, omega in enumerate(2 * np.pi * frequency_hz):
        steady = loads / (1j * omega - values)
        free = z - steady * np.exp(1j * phi)
        periods = max(1, int(min(WINDOW, dwell) * omega / (2 * np.pi)))
        window = 2 * np.pi * periods / omega
        H[k] = -(omega**2) * (read @ steady)
        phase = phi + omega * (dwell - window)
        swing = read * (values**2 * free * np.exp(values * (dwell - window)))
        H[k] += np.sum(swing * _mean(values, omega, phase, window), axis=1)
        H[k] += np.sum(np.conj(swing) * _mean(np.conj(values), omega, phase, window), axis=1)
        phi = phi + omega * dwell
        z = steady * np.exp(1j * phi) + free * np.exp(values * dwell)
        phi = float(np.mod(phi, 2 * np.pi))
    return H


def _mean(values: ComplexArray, omega: float, phase: float, window: float) -> ComplexArray:
    """(1/W) int_0^W e^{lambda t} e^{-i (phase + omega t)} dt."""
    rate = values - 1j * omega
    return np.exp(-1j * phase) * (np.exp(rate * window) - 1) / (rate * window)


def _decomposed(machine: Machine, drift: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Eigenvalues (2n,), displacement read-out (n_nodes, 2n), loads (2n,)."""
    if machine.springs:
        raise ValueError("a sweep that does not settle needs a machine without frequency-dependent springs")
    n = len(machine.M)
    K = machine.K + machine.stiffness_of_drift(drift)
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:] = -np.linalg.solve(machine.M, np.hstack([K, machine.C + machine.C_shaft]))
    B = np.concatenate([np.zeros(n), np.linalg.solve(machine.M, machine.drive)])
    values, V = np.linalg.eig(A)
    loads = np.linalg.solve(V, B).astype(complex)
    return (
        np.asarray(values, dtype=complex),
        np.asarray(machine.read @ V[:n], dtype=complex),
        np.asarray(loads, dtype=complex),
    )
