"""What the nominal and the corrected model make of a measured run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Run

# Channels below this share of the largest are left out of the gap: a rigid support's own node, for example.
SILENT = 1e-4


@dataclass(frozen=True)
class Curve:
    """A measured run beside its models."""

    run: Run
    nominal: ComplexArray  # (n_freq, n_channels) recalibrated nominal model
    corrected: ComplexArray | None  # with the named effect
    std: FloatArray  # (n_freq, n_channels) standard error of what was measured, as believed


def nrmse(measured: ComplexArray, model: ComplexArray) -> float:
    """sqrt(sum |H - H_model|^2 / sum |H|^2) of each channel, averaged over the channels that move.

    Parameters
    ----------
    measured, model : (n_freq, n_channels); real and not negative for magnitudes; lines without a value are left out

    >>> nrmse(np.array([[3.0], [4.0]]), np.array([[3.0], [4.5]]))
    0.1
    """
    measured, model = _where_measured(measured, model)
    size = np.sqrt(np.sum(np.abs(measured) ** 2, axis=0))
    moving = size > SILENT * size.max(initial=0.0)
    if not moving.any():
        return float("nan")
    error = np.sqrt(np.sum(np.abs(measured - model) ** 2, axis=0))
    return float(np.mean(error[moving] / size[moving]))


def log_distance_db(measured: ComplexArray, model: ComplexArray) -> float:
    """Root mean square of 20 log10 |H / H_model| over all lines of the channels that move [dB]."""
    measured, model = _where_measured(measured, model)
    size = np.sqrt(np.sum(np.abs(measured) ** 2, axis=0))
    moving = size > SILENT * size.max(initial=0.0)
    a, b = np.abs(measured[:, moving]), np.abs(model[:, moving])
    ok = (a > 0) & (b > 0)
    return float(np.sqrt(np.mean((20 * np.log10(a[ok] / b[ok])) ** 2))) if ok.any() else float("nan")


def _where_measured(measured: ComplexArray, model: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    there = np.isfinite(measured)
    return np.where(there, measured, 0.0), np.where(there, model, 0.0)
