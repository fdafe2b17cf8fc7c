"""One mode with one damping, and one whose damping grows with the amplitude: the controls of the bolted beam."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from benchmarks.real_data.data_set import nrmse
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray

# Damping ratio 0.0014, growth 0.0007 at 100 um, residue 0.5 / kg: where every fit begins.
START = (np.log(1.4e-3), np.log(7e-4), 0.5, 0.0)

# Amplitude at which the growth of the damping is counted [m].
REFERENCE = 1e-4


@dataclass(frozen=True)
class Sweep:
    """A stepped sine with the force of each line."""

    name: str
    frequency_hz: FloatArray  # (n_freq,)
    force: FloatArray  # (n_freq,) peak [N]
    H: ComplexArray  # (n_freq,) accelerance at the accelerometer [(m/s^2)/N]

    @property
    def omega(self) -> FloatArray:
        """(n_freq,) [rad/s]"""
        return 2 * np.pi * self.frequency_hz

    @property
    def amplitude(self) -> FloatArray:
        """(n_freq,) peak displacement of the accelerometer [m]"""
        return np.abs(self.H) * self.force / self.omega**2


def mode(sweep: Sweep, shared: FloatArray, natural_hz: float, exponent: float | None) -> ComplexArray:
    """(n_freq,) accelerance -w^2 r / (w0^2 - w^2 + 2 i zeta w0 w) with zeta = z0 + z1 (a / 100 um)^exponent.

    ``shared`` is log z0, log z1, Re r, Im r; no exponent: zeta = z0.
    """
    zeta = np.exp(shared[0]) * np.ones(len(sweep.omega))
    if exponent is not None:
        zeta = zeta + np.exp(shared[1]) * (sweep.amplitude / REFERENCE) ** exponent
    natural = 2 * np.pi * natural_hz
    residue = shared[2] + 1j * shared[3]
    return -(sweep.omega**2) * residue / (natural**2 - sweep.omega**2 + 2j * zeta * natural * sweep.omega)


def fit(sweeps: Sequence[Sweep], start_hz: float, exponent: float | None) -> FloatArray:
    """Shared numbers (4,) of several sweeps; every sweep has a natural frequency of its own."""

    def misfit(p: FloatArray) -> FloatArray:
        parts = [
            (mode(sweep, p[:4], p[4 + k], exponent) - sweep.H) / np.sqrt(np.mean(np.abs(sweep.H) ** 2))
            for k, sweep in enumerate(sweeps)
        ]
        return np.concatenate([part for each in parts for part in (each.real, each.imag)])

    start = np.array([*START, *[start_hz] * len(sweeps)])
    return least_squares(misfit, start, x_scale=0.1).x[:4]


def leave_one_out(sweeps: Sequence[Sweep], start_hz: float, exponent: float | None = None) -> tuple[float, ...]:
    """NRMSE of each sweep by a fit of the others; only its natural frequency is its own, and its level is known."""
    errors = []
    for held in sweeps:
        shared = fit([sweep for sweep in sweeps if sweep is not held], start_hz, exponent)

        def error(natural_hz: float, held: Sweep = held, shared: FloatArray = shared) -> float:
            return nrmse(held.H, mode(held, shared, natural_hz, exponent))

        errors.append(minimize_scalar(error, bounds=(start_hz - 0.6, start_hz + 0.6), method="bounded").fun)
    return tuple(errors)
