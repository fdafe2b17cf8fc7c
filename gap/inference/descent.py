"""Least squares by damped Gauss-Newton steps, within ranges (Marquardt 1963)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rigtwin.rotor.model.arrays import BoolArray, FloatArray

Residual = Callable[[FloatArray], FloatArray | None]  # of a point; None where it has no model


def soften(residual: FloatArray) -> FloatArray:
    """Let large residuals grow like their root only: what is far off should not decide a descent.

    >>> soften(np.array([0.0, 3.0, 99.0]))
    array([0. , 1.5, 9.9])
    """
    return residual / np.sqrt(1 + np.abs(residual))


def minimise(
    residual: Residual, u: FloatArray, ends: FloatArray, log: BoolArray, with_k_b: bool, steps: int
) -> tuple[FloatArray, float]:
    """A few damped Gauss-Newton steps with forward differences, which avoid points without a model.

    Parameters
    ----------
    u, ends, log : (n,) start, (n, 2) range and (n,) which coordinates are logarithms
    with_k_b : whether the first coordinate moves
    """
    x, scales = np.clip(u, ends[:, 0], ends[:, 1]), np.ptp(ends, axis=1)
    r = residual(x)
    if r is None:
        return x, np.inf
    mu = 1e-2
    moving = [j for j in range(len(x)) if scales[j] > 0 and (j or with_k_b)]
    for _ in range(steps):
        J = np.zeros((len(r), len(x)))
        for j in moving:
            step = 1e-4 * scales[j] * (1 if x[j] + 1e-4 * scales[j] <= ends[j, 1] else -1)
            y = x.copy()
            y[j] += step
            moved = residual(y)
            if moved is not None:
                J[:, j] = (moved - r) / step
        found = _reduce(residual, x, r, J, ends, log, mu)
        if found is None:
            break
        before = float(r @ r)
        x, r, mu = found
        if before - float(r @ r) < 1e-3 * before:
            break
    return x, float(r @ r) / len(r)


def _reduce(
    residual: Residual, x: FloatArray, r: FloatArray, J: FloatArray, ends: FloatArray, log: BoolArray, mu: float
) -> tuple[FloatArray, FloatArray, float] | None:
    """A point with a smaller residual, the residual, and the next damping; None where none is found."""
    A, g = J.T @ J, -J.T @ r
    damping = np.diag(A.diagonal() + 1e-12)
    for _ in range(6):
        step = np.linalg.solve(A + mu * damping + 1e-12 * np.eye(len(x)), g)
        trial = np.clip(x + np.where(log, shorten_logarithms(step), step), ends[:, 0], ends[:, 1])
        moved = residual(trial)
        if moved is not None and moved @ moved < r @ r:
            return trial, moved, mu / 5
        mu *= 6
    return None


def damped_step(A: FloatArray, g: FloatArray, mu: float, active: BoolArray) -> FloatArray:
    """Marquardt's step; held coordinates do not move."""
    held = np.concatenate([active, np.zeros(len(A) - len(active), dtype=bool)])
    diagonal = A.diagonal()
    held |= diagonal <= 0
    free = np.flatnonzero(~held)
    block = A[np.ix_(free, free)] + np.diag(mu * diagonal[free])
    step = np.zeros(len(A))
    step[free] = np.linalg.solve(block, g[free])
    return step


def shorten_logarithms(step: FloatArray) -> FloatArray:
    """Shorten steps s of logarithms to ln(1 + s): the number, or downwards its reciprocal, grows by s times itself."""
    return np.sign(step) * np.log1p(np.abs(step))
