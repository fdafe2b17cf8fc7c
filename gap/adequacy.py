"""Is a fit as good as the noise allows? Judged by the data's own scatter from line to line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gap.likelihood import MODEL_ERROR, Fit, Observed, Problem
from rotor.structure import ComplexArray

# Median of chi-squared with one and with two degrees of freedom.
_MEDIAN_1, _MEDIAN_2 = 0.45494, 1.38629

# Standard errors are believed where the data's own scatter differs by less than this over the root of the number of
# values: 2.5 standard errors of the median of overlapping differences.
_DOUBTFUL = 5.0


@dataclass(frozen=True)
class Adequacy:
    """What is left of a fit."""

    scale: float  # true over believed standard error, from differences of neighbouring lines
    misfit: float  # mean square of the residuals over that of their noise; 1: nothing is left
    correlation: float  # of neighbouring lines' residuals, in its standard errors


def whitened(observed: Observed, model: ComplexArray, model_error: float = 0.0) -> ComplexArray:
    """(n_freq, n_channels) residuals of unit variance per real component; nan where nothing is there."""
    y = observed.run.H
    difference = np.abs(y) - np.abs(model) if observed.run.magnitude_only else y - model
    silent = np.abs(np.nan_to_num(y)) <= 1e-9 * np.nanmax(np.abs(y))
    return np.where(
        observed.valid & ~silent,
        difference / (np.hypot(observed.std, model_error * np.abs(np.nan_to_num(y))) / np.sqrt(2)),
        np.nan,
    )


def judge(problem: Problem, fit: Fit) -> Adequacy:
    """Compare a fit's residuals with the noise under them."""
    bends, squares, products, n = [], 0.0, 0.0, 0
    for observed, model in zip(problem.observed, problem.predict(fit), strict=True):
        z = whitened(observed, model, problem.model_error if problem.model_error > MODEL_ERROR else 0.0)
        real = observed.run.magnitude_only
        parts = 1 if real else 2
        if len(z) > 2:
            bend = z[1:-1] - (z[:-2] + z[2:]) / 2
            bends.append((np.abs(bend) ** 2 / (1.5 * (_MEDIAN_1 if real else _MEDIAN_2))).ravel())
        size = float(np.nansum(np.abs(z) ** 2)) / parts
        squares += size
        n += int(np.isfinite(z).sum())
        products += float(np.nansum((z[1:] * z[:-1].conj()).real)) / parts
    every = np.concatenate(bends) if bends else np.ones(1)
    scale2 = float(np.nanmedian(every))
    surely = 1.0 if abs(scale2 - 1) < _DOUBTFUL / np.sqrt(max(n, 1)) else scale2
    dof = max(n - len(fit.u) - 6, 1)
    return Adequacy(
        scale=float(np.sqrt(scale2)),
        misfit=squares / dof / max(surely, 1e-30),
        correlation=products / max(squares, 1e-30) * np.sqrt(2 * n),
    )
