"""A stepped sweep that does not wait: every line is read a fixed time after its frequency was set.

What is read is the one period that follows the dwell; then the next frequency is set.
"""

from __future__ import annotations

import numpy as np

from rigtwin.blind.generate.machine import Machine
from rigtwin.blind.generate.rig import ComplexArray, FloatArray


def swept(machine: Machine, frequency_hz: FloatArray, dwell: float, drift: FloatArray) -> ComplexArray:
    """(n_freq, n_nodes) accelerance that an upward sweep reads; it starts from rest, its phase is continuous.

    While the frequency stays, an eigenvector has the coordinate z = p e^{i phi} + (z_0 - p e^{i phi_0}) e^{lambda t}
    with p = beta/(i omega - lambda). What is read is (2/T) times the integral of the real acceleration and e^{-i phi}
    over the period T that follows the dwell.
    """
    values, read, loads = _decomposed(machine, drift)
    z = np.zeros(len(values), dtype=complex)
    phi = -np.pi / 2  # of the cosine: the force starts from zero
    H = np.empty((len(frequency_hz), len(machine.read)), dtype=complex)
    for k, omega in enumerate(2 * np.pi * frequency_hz):
        steady = loads / (1j * omega - values)
        free = z - steady * np.exp(1j * phi)
        period = 2 * np.pi / omega
        H[k] = -(omega**2) * (read @ steady)
        phase = phi + omega * dwell
        swing = read * (values**2 * free * np.exp(values * dwell))
        H[k] += np.sum(swing * _mean(values, omega, phase, period), axis=1)
        H[k] += np.sum(np.conj(swing) * _mean(np.conj(values), omega, phase, period), axis=1)
        phi = phase + omega * period
        z = steady * np.exp(1j * phi) + free * np.exp(values * (dwell + period))
        phi = float(np.mod(phi, 2 * np.pi))
    return H


def _mean(values: ComplexArray, omega: float, phase: float, period: float) -> ComplexArray:
    """(1/T) int_0^T e^{lambda t} e^{-i (phase + omega t)} dt."""
    rate = values - 1j * omega
    return np.exp(-1j * phase) * np.expm1(rate * period) / (rate * period)


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
