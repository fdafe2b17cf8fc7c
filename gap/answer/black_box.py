"""A correction without a place, the control of a fitted joint: one further resonance of each run.

Every run gets a pole of its own, and at every sensor a complex residue:

    H_s = H0_s + (i omega)^p [ R_s / (i omega - lambda) + R_s* / (i omega - lambda*) ].

These are 2 + 2 n numbers for n sensors, of every run: never fewer than a joint has in all. Such a box follows what it
has seen, but says nothing of another sensor, exciter or support.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from rigtwin.gap.model.linear import over_receptance
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class Poles:
    """Poles that are tried: so many frequencies, evenly in the logarithm over the band, with each damping ratio."""

    frequencies: int = 60
    ratios: tuple[float, ...] = (0.001, 0.005, 0.02, 0.1, 0.5)


_POLES = Poles()


def further_resonance(run: Run, H0: ComplexArray, usable: BoolArray) -> ComplexArray:
    """(n_freq, n_channels) what a further resonance adds to a model's response, fitted to some of a run's values.

    Parameters
    ----------
    H0 : (n_freq, n_channels) response of the model
    usable : (n_freq, n_channels) values that it is fitted to; of magnitudes alone the model's phases are taken
    """
    y = np.nan_to_num(run.H)
    y = np.abs(y) * np.exp(1j * np.angle(H0)) if run.magnitude_only else y
    size = np.sqrt(np.sum(np.where(usable, np.abs(y) ** 2, 0.0), axis=0))
    e = np.where(usable, y - H0, 0.0) / np.where(size > 0, size, 1.0)
    lines = usable.any(axis=1)

    def fitted(at: FloatArray) -> tuple[float, ComplexArray]:
        shapes = _shapes(run, *np.exp(at))
        columns = np.concatenate([shapes.real[lines], shapes.imag[lines]])
        target = np.concatenate([e.real[lines], e.imag[lines]])
        numbers = np.linalg.lstsq(columns, target, rcond=None)[0]
        return float(np.sum((target - columns @ numbers) ** 2)), shapes @ numbers

    f = run.frequency_hz
    grid = [
        np.log([frequency, ratio])
        for frequency in np.geomspace(f[0], f[-1], _POLES.frequencies)
        for ratio in _POLES.ratios
    ]
    begin = min(grid, key=lambda at: fitted(at)[0])
    best = minimize(lambda at: fitted(at)[0], begin, method="Nelder-Mead").x
    return fitted(best)[1] * size


def _shapes(run: Run, frequency_hz: float, ratio: float) -> ComplexArray:
    """(n_freq, 2) response by the real and by the imaginary part of a residue, each as large as one."""
    omega, own = 2 * np.pi * run.frequency_hz, 2 * np.pi * frequency_hz
    pole = own * (-ratio + 1j * np.sqrt(max(1 - ratio**2, 0.0)))
    ahead, behind = 1 / (1j * omega - pole), 1 / (1j * omega - pole.conjugate())
    shapes = over_receptance(run)[:, None] * np.stack([ahead + behind, 1j * (ahead - behind)], axis=1)
    return shapes / np.linalg.norm(shapes, axis=0)
