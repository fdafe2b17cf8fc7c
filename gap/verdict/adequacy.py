"""Is a fit as good as the noise allows? Judged by the data's own scatter from line to line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from rigtwin.gap.audit.noise import CREDIBLE, live_channels, of_complex, shared_variance
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.observed import Observed, residual
from rigtwin.gap.inference.problem import Problem
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray


@dataclass(frozen=True)
class Scatter:
    """How the data's own scatter is told from line to line."""

    # Share of the smallest squares whose mean tells a channel's scatter: single outliers and sharp peaks take no part.
    trimmed: float = 0.95
    # Standard errors are believed where the scatter differs from them by less than this over the root of the number of
    # values: some 3.5 standard errors of a mean over overlapping differences.
    doubtful: float = 5.0
    # Channels hardly share an error that is below this part of what the lines seemed to tell,
    hardly: float = 0.5
    surely: float = 2.0  # by so many standard errors.


@dataclass(frozen=True)
class OddLines:
    """Which lines a fit plainly misses, and when these are few."""

    plainly: float = 10.0  # misfit over what chance leaves once in 1 / chance lines
    chance: float = 1e-9
    share: float = 0.03  # of a run's lines
    few: int = 3  # lines, whatever share these are
    near: float = 0.01  # of a resonance's frequency: there a line is not odd


SCATTER = Scatter()
ODD = OddLines()


@dataclass(frozen=True)
class Adequacy:
    """What is left of a fit."""

    scale: float  # true over believed standard error, from differences of neighbouring lines
    misfit: float  # mean square of the residuals over that of their noise; 1: nothing is left
    correlation: float  # of neighbouring lines' residuals, in its standard errors; of small ones what it is of noise
    spread: float  # of the misfit where noise alone is left: its standard deviation


def whitened(observed: Observed, model: ComplexArray, added: float = 0.0) -> ComplexArray:
    """(n_freq, n_channels) residuals of unit variance per real component; nan where nothing is there.

    added : relative error beside the data's own
    """
    y = observed.run.H
    silent = np.abs(np.nan_to_num(y)) <= 1e-9 * np.nanmax(np.abs(y))
    return np.where(observed.valid & ~silent, residual(observed, model, added), np.nan)


def judge(problem: Problem, fit: Fit) -> Adequacy:
    """Compare a fit's residuals with the noise under them, and with what the model itself leaves at sharp places."""
    predicted, observed = problem.predict(fit), problem.observed
    scale2 = _scale2(problem, predicted)
    surely = 1.0 if abs(scale2 - 1) < SCATTER.doubtful / np.sqrt(max(fit.n_data / 2, 1)) else scale2
    added = problem.model_error / np.sqrt(surely)
    left = [whitened(o, model, added) for o, model in zip(observed, predicted, strict=True)]
    parts, values = np.array([o.parts for o in observed]), np.array([np.isfinite(z).sum() for z in left])
    # The variance is that of the products' sum, where residuals are independent.
    n, reals, variance = int(values.sum()), int(parts @ values), float(np.sum(values / parts))
    squares = sum(float(np.nansum(np.abs(z) ** 2)) / k for z, k in zip(left, parts, strict=True))
    products = sum(float(np.nansum((z[1:] * z[:-1].conj()).real)) / k for z, k in zip(left, parts, strict=True))
    shares = (_with_model(o, scale2, problem.model_error)[np.isfinite(z)] for o, z in zip(observed, left, strict=True))
    dof = max(n * (1 - (len(fit.u) + 6) / max(reals, 1)), 1.0)
    # Neighbouring residuals of hardly any size are alike for reasons of the model's own.
    counts = max(squares, n * surely, 1e-30)
    return Adequacy(
        scale=float(np.sqrt(sum(map(np.sum, shares)) / n)) if n else 1.0,
        misfit=squares / dof / surely,
        correlation=products / counts * n / np.sqrt(max(variance, 1.0)),
        spread=float(np.sqrt(2 / max(reals, 1))),
    )


def _scale2(problem: Problem, predicted: Sequence[ComplexArray]) -> float:
    """True over believed variance of the data's own errors, by how much residuals bend from line to line."""
    pairs = zip(problem.observed, predicted, strict=True)
    found = [(_bends(channel), o.parts) for o, model in pairs for channel in whitened(o, model).T]
    n = sum(len(bends) for bends, _ in found)
    scatter = sum(len(bends) * _scatter(bends, parts) for bends, parts in found)
    return float(np.clip(scatter / n, *np.square(CREDIBLE))) if n else 1.0


def _with_model(observed: Observed, scale2: float, model_error: float) -> FloatArray:
    """(n_freq, n_channels) true over believed variance, of the data's errors and the model's together."""
    own, of_model = observed.std**2, (model_error * np.abs(np.nan_to_num(observed.run.H))) ** 2
    return 1 + (scale2 - 1) / (1 + of_model / np.maximum(own, 1e-300))


def odd_lines(problem: Problem, fit: Fit) -> list[BoolArray]:
    """(n_freq,) of every run: lines near no resonance that a fit plainly misses, where they are few; else none.

    No rotor has a gap at single lines far from its resonances. A controller that slipped makes one, and so does hum.
    """
    scale2 = max(judge(problem, fit).scale, 1.0) ** 2
    found = []
    predicted = zip(problem.observed, problem.predict(fit), problem.modals(fit.k_b, fit.effects), strict=True)
    for observed, model, modal in predicted:
        z, f = whitened(observed, model), observed.run.frequency_hz
        numbers = np.isfinite(z).sum(axis=1) * observed.parts
        missed = np.nansum(np.abs(z) ** 2, axis=1) > ODD.plainly * scale2 * chi2.isf(ODD.chance, np.maximum(numbers, 1))
        near = np.abs(f[:, None] / modal.frequencies_hz - 1).min(initial=np.inf, axis=1) < ODD.near
        odd = missed & ~near
        found.append(odd if odd.sum() <= max(ODD.few, ODD.share * len(f)) else np.zeros(len(f), dtype=bool))
    return found


def not_shared(problem: Problem, fit: Fit) -> Problem | None:
    """The problem without errors that channels share, where they hardly share what the fit leaves; else nothing.

    Near a line, what a fast sweep still rings with moves all channels alike, as noise of the force does.
    """
    kept = [
        o if not o.common or _shared(o, model) > SCATTER.hardly * o.common else replace(o, common=0.0)
        for o, model in zip(problem.observed, problem.predict(fit), strict=True)
    ]
    return None if all(a is b for a, b in zip(kept, problem.observed, strict=True)) else problem.on(kept)


def _shared(observed: Observed, model: ComplexArray) -> float:
    """At most so large an error channels share of what a model leaves, relative and as of the complex response."""
    size, live = np.abs(observed.run.H), live_channels(observed.run)
    with np.errstate(all="ignore"):
        left = np.where(observed.valid, observed.difference(model) / size, np.nan)
        square, error = shared_variance(left[:, live], (observed.error / size)[:, live])
    return float(of_complex(np.sqrt(np.maximum(square + SCATTER.surely * error, 0.0)), observed.run))


def _bends(z: ComplexArray) -> FloatArray:
    """Squares of second differences of a channel's residuals, where three lines in a row are there."""
    bend = np.abs(z[1:-1] - (z[:-2] + z[2:]) / 2) ** 2
    return bend[np.isfinite(bend)]


def _scatter(bends: FloatArray, parts: int) -> float:
    """Variance of a residual's real component, by the trimmed mean of its second differences' squares.

    Of chi-squared with k degrees of freedom, the mean below the quantile q is k F_(k+2)(q) / F_k(q).
    """
    if not len(bends):
        return 0.0
    kept = np.sort(bends)[: max(round(SCATTER.trimmed * len(bends)), 1)]
    expected = parts * chi2.cdf(chi2.ppf(SCATTER.trimmed, parts), parts + 2) / SCATTER.trimmed
    return float(np.mean(kept) / (1.5 * expected))
