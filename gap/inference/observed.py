"""Measured runs with their errors, and the residuals that a model leaves of them.

A residual is (data - model) over the standard error of a real component; magnitudes, where only these were measured,
are compared with the mean magnitude of a noisy response.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import i0e, i1e

from rigtwin.gap.inference.modes import MeasuredMode, measured_modes
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray
from rigtwin.sim.campaign import Run

Values = ComplexArray | FloatArray  # responses, or magnitudes alone


@dataclass(frozen=True)
class LeastErrors:
    """Errors that are believed at least."""

    own_variance: float = 0.05  # a channel's own, over that with what all channels share
    std: float = 1e-4  # over a run's median response


LEAST = LeastErrors()


@dataclass(frozen=True)
class Observed:
    """A run with its errors."""

    run: Run
    std: FloatArray  # (n_freq, n_channels), what all channels share among them
    common: float = 0.0  # relative standard error that all channels share at a line, as noise of the force is
    scatter: float = np.nan  # of the lines about a smooth curve, over these errors; nan: not known
    resonances: tuple[MeasuredMode, ...] = ()  # that the run shows plainly

    @property
    def valid(self) -> BoolArray:
        """(n_freq, n_channels) whether a value is there."""
        return np.isfinite(self.run.H) & np.isfinite(self.std)

    def difference(self, H: ComplexArray) -> ComplexArray | FloatArray:
        """(n_freq, n_channels) data less a model; magnitudes less their mean where only these were measured."""
        y = self.run.H
        return np.abs(y) - expected_magnitude(self, H)[0] if self.run.magnitude_only else y - H

    @property
    def error(self) -> FloatArray:
        """(n_freq, n_channels) sqrt(E|data - truth|^2): a magnitude sees half of the noise's power."""
        return self.std / np.sqrt(2) if self.run.magnitude_only else self.std

    def divide_by(self, factor: float) -> Observed:
        """The same in another unit, which is so many times as large."""
        std = None if self.run.std is None else self.run.std / factor
        harmonics = {order: values / factor for order, values in self.run.harmonics.items()}
        run = replace(self.run, H=self.run.H / factor, std=std, harmonics=harmonics)
        resonances = tuple(replace(mode, residues=mode.residues / factor) for mode in self.resonances)
        return replace(self, run=run, std=self.std / factor, resonances=resonances)

    @property
    def parts(self) -> int:
        """Real numbers in a value."""
        return 1 if self.run.magnitude_only else 2

    @property
    def n_values(self) -> int:
        """Real numbers that were measured; a node that is held still has none."""
        moving = np.abs(np.nan_to_num(self.run.H)) > 0
        return int((self.valid & moving).sum()) * self.parts


def observe(run: Run, std: FloatArray, common: float = 0.0, scatter: float = np.nan) -> Observed:
    """A run whose errors are at least what can be believed."""
    size = np.abs(run.H[np.isfinite(run.H)])
    least = LEAST.std * (np.median(size[size > 0]) if (size > 0).any() else 1.0)
    believed = np.maximum(np.where(np.isfinite(std), std, np.inf), least)
    return Observed(run, believed, common, scatter, measured_modes(run, believed))


def residual(observed: Observed, H: ComplexArray, added: float) -> Values:
    """(data - model) over the standard error of a real component; what is not there is zero.

    What all channels share is taken out, so that the channels' errors are independent.
    """
    return _left(observed, H, _weight(observed, added))


def _left(observed: Observed, H: ComplexArray, weight: FloatArray) -> Values:
    return _independent(observed, np.where(observed.valid, observed.difference(H) * weight, 0.0), weight)


def misfit(observed: Observed, H: ComplexArray, added: float) -> FloatArray:
    """Sum of squared residuals (...) of responses (..., n_freq, n_channels)."""
    return np.sum(np.abs(residual(observed, H, added)) ** 2, axis=(-2, -1))


def _weight(observed: Observed, added: float) -> FloatArray:
    """(n_freq, n_channels) 1 / standard error of a real component of a channel's own; 0 where nothing is there."""
    squared = np.abs(np.nan_to_num(observed.run.H)) ** 2
    own = np.maximum(observed.std**2 - observed.common**2 * squared, LEAST.own_variance * observed.std**2)
    return np.where(observed.valid, 1 / np.sqrt((own + added**2 * squared) / 2), 0.0)


def _independent(observed: Observed, z: Values, weight: FloatArray) -> Values:
    """Values (..., n_freq, n_channels) in units of the channels' own errors, where these are independent.

    An error e that all channels share changes each by e y. With w = e y in units of the own errors the covariance is
    1 + w w^H, and 1 - (1 - 1 / sqrt(1 + |w|^2)) w w^H / |w|^2 times the values have that of independent ones.
    """
    if not observed.common:
        return z
    y = np.nan_to_num(observed.run.H)
    w = observed.common / np.sqrt(2) * weight * (np.abs(y) if observed.run.magnitude_only else y)
    square = np.sum(np.abs(w) ** 2, axis=-1, keepdims=True)
    part = (1 - 1 / np.sqrt(1 + square)) / np.where(square > 0, square, 1.0)
    return z - part * w * np.sum(w.conj() * z, axis=-1, keepdims=True)


def weights_and_residuals(observed: Observed, H: ComplexArray, added: float) -> tuple[FloatArray, FloatArray]:
    """(n_freq, n_channels) weights and (n_residuals,) real residuals."""
    weight = _weight(observed, added)
    left = _left(observed, H, weight)
    return weight, _flat(left.real if observed.run.magnitude_only else left)


def derivatives(observed: Observed, H: ComplexArray, columns: ComplexArray, weight: FloatArray) -> FloatArray:
    """(n_columns, n_residuals) derivatives of the model in units of the residuals."""
    slope = expected_magnitude(observed, H)[1] if observed.run.magnitude_only else 1.0
    changes = _as_recorded(columns * weight * slope, H, observed.run)
    return _flat(_independent(observed, changes, weight))


def as_real(changes: ComplexArray, H: ComplexArray, run: Run) -> FloatArray:
    """(..., n_residuals) changes (..., n_freq, n_channels) of a response: both parts, or its magnitude's alone."""
    return _flat(_as_recorded(changes, H, run))


def _as_recorded(changes: ComplexArray, H: ComplexArray, run: Run) -> Values:
    """Changes (..., n_freq, n_channels) of a response, or of its magnitude where only that was measured."""
    if not run.magnitude_only:
        return changes
    size = np.abs(H)
    return (changes * np.where(size > 0, H.conj() / np.where(size > 0, size, 1.0), 0.0)).real


def _flat(values: Values) -> FloatArray:
    """(..., n_residuals) of (..., n_freq, n_channels), real parts first."""
    flat = (*values.shape[:-2], values.shape[-2] * values.shape[-1])
    parts: list[FloatArray] = [values.real, values.imag] if np.iscomplexobj(values) else [values.real]
    return np.concatenate([part.reshape(flat) for part in parts], axis=-1)


def expected_magnitude(observed: Observed, H: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Mean magnitude of a response with noise, and its slope by the magnitude without (mean of Rice's distribution).

    With s the standard deviation of a real component and z = |H|^2 / (4 s^2),
    mean = s sqrt(pi/2) e^-z ((1 + 2 z) I0(z) + 2 z I1(z)).

    Where exactly nothing was measured there was no noise.

    Returns
    -------
    (n_freq, n_channels) each
    """
    s, size = np.where(observed.valid, observed.std, 1.0) / np.sqrt(2), np.abs(H)
    z = (size / (2 * s)) ** 2
    zeroth, first = i0e(z), i1e(z)
    mean = s * np.sqrt(np.pi / 2) * ((1 + 2 * z) * zeroth + 2 * z * first)
    slope = size / (2 * s) * np.sqrt(np.pi / 2) * (zeroth + first)
    noisy = np.abs(observed.run.H) > 0
    return np.where(noisy, mean, size), np.where(noisy, slope, 1.0)
