"""Noise of a run, from its own lines: what a smooth curve through a line's neighbours cannot follow.

Over a few neighbouring lines every channel is a polynomial over one common denominator,

    H_c(f) (1 + d x) = n_c0 + n_c1 x + n_c2 x^2,    x = (f - f_i) / reach,

a resonance and what the other modes leave: a local rational model as in McKelvey and Guerin (IFAC
Symposium on System Identification, 2012). Where resonances may lie in pairs, in two planes or with a
spin, it is a cubic over a quadratic. What is left at the line itself, divided by the square root of
one minus its leverage, is one draw of its error. Magnitudes are fitted as squares, with real
coefficients, a cubic over a quadratic, too. Nothing is assumed of the raster: lines may lie anywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from rigtwin.gap.curves import SILENT
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class LocalFit:
    """A curve through a line's neighbours."""

    numerator: int  # degree
    denominator: int  # degree: number of poles
    wide: int  # lines of a wide window
    narrow: int  # lines of a narrow one


_ONE_POLE = LocalFit(2, 1, 9, 6)  # one resonance
_TWO_POLES = LocalFit(3, 2, 11, 8)  # a magnitude's square has a conjugate pair, and two planes have pairs of resonances


@dataclass(frozen=True)
class Scattering:
    """How the noise is told from the scatter of the lines."""

    # Scatter about wide fits over that about narrow ones: from here on a window holds more than one resonance.
    unresolved: float = 1.6
    windows: int = 2  # a run whose lines fill fewer wide windows holds a resonance in each of them
    # Share of the residuals in a mean square. The largest ones are left out: lines of a jump, of ringing or of a sharp
    # resonance between two lines do not say what the noise is.
    kept: float = 0.75
    # Standard deviation of the denominator's coefficients: a pole may lie as near as a third of the window from its
    # centre before this prior is felt; a pole in the data is known far better than that.
    denominator_prior: float = 3.0
    largest_leverage: float = 0.9  # lines with a higher one say too little of their own error
    usual_size: float = 0.9  # a channel is as large as this share of its lines reach
    largest: float = 1e60  # responses in any unit are smaller, and larger than one over it; squares stay floats
    group: int = 25  # lines per group in which noise is compared with the response's size
    groups: int = 8  # of them at the most
    common_errors: float = 4.0  # standard errors from which variance that all channels share counts, ...
    common_share: float = 0.1  # ... and its least share of all variance


@dataclass(frozen=True)
class GivenErrorLimits:
    """When given standard errors are believed, and what is taken where there are none."""

    contradicted: float = 3.0  # scatter of a value over its error, from which its scatter is taken, ...
    # ... where more than this share of the values has it. Two lines in a sharp resonance, and still channels, may.
    contradicted_share: float = 0.03
    rough: float = 0.07  # relative scatter of the errors from line to line: 0.07 with 50 repeats, 0.3 with four
    usual: float = 0.01  # noise over response where nothing is known: what a careful laboratory reaches
    most: float = 0.03  # the same at most, where lines lie too far apart to tell it


_SCATTERING = Scattering()
GIVEN_ERRORS = GivenErrorLimits()

# Scatter of a run's lines over the given errors: outside, all of them are scaled.
CREDIBLE = (0.5, 2.0)


@dataclass(frozen=True)
class NoiseEstimate:
    """What the lines of a run say of their own error.

    A channel's error has a part that is proportional to the response and a part that is not:
    std^2 = (relative part)^2 |H|^2 + floor^2. Entries are nan where too few lines tell.
    """

    relative: FloatArray  # (n_channels,) median over the lines of std / |H| [-]
    std: FloatArray  # (n_freq, n_channels) sqrt(E|error|^2), unit of H
    draws: FloatArray  # (n_freq, n_channels) |residual| of each line, freed of its leverage, unit of H
    uncertainty: float  # relative standard error of ``relative`` [-]; inf where nothing is known
    resolved: bool = True  # whether lines lie close enough; else the estimate is more than the noise
    common: float = 0.0  # part of ``relative`` that all channels share, as noise of the force; 0 where hardly any


def estimate_noise(run: Run) -> NoiseEstimate:
    """Estimate the noise of every line of a run; its standard errors, if given, are not looked at.

    Parameters
    ----------
    run : at least 7 lines (magnitudes, two planes, a spin: 9) that are finite in every live channel; fewer: all is nan

    Returns
    -------
    NoiseEstimate; a channel that is zero throughout has no noise, one that is mostly nan has nan
    """
    H = responses(run)
    nothing = np.full(H.shape, np.nan)
    silent = np.nan_to_num(H).any(axis=0) == 0  # (n_channels,)
    live = live_channels(run)
    lines = np.isfinite(H[:, live]).all(axis=1) if live.any() else np.zeros(len(H), dtype=bool)
    std, draws, relative = nothing.copy(), nothing.copy(), np.full(H.shape[1], np.nan)
    std[:, silent], draws[:, silent], relative[silent] = 0.0, 0.0, 0.0
    n, local = int(np.count_nonzero(lines)), _local_fit(run)
    if n < local.numerator + local.denominator + 4:
        return NoiseEstimate(relative, std, draws, math.inf)
    with np.errstate(all="ignore"):
        H_live = H[np.ix_(lines, live)]
        fits = (_Windows(run.frequency_hz[lines], window, local) for window in (local.wide, local.narrow))
        wide, narrow = (_scatter(fit, H_live, run.magnitude_only) for fit in fits)
        crowded = np.median(wide.relative / narrow.relative) > _SCATTERING.unresolved
        resolved = n >= _SCATTERING.windows * local.wide and not crowded
        found = wide if resolved else narrow
        draws[np.ix_(lines, live)] = found.draws
        std[:, live] = np.sqrt((found.share * np.abs(H[:, live])) ** 2 + found.floor**2)
        relative[live] = found.relative
        common = 0.0
        if resolved:
            common = _shared_error(found.residuals / H_live, std[np.ix_(lines, live)] / np.abs(H_live))
            common *= _shared_error_factor(H_live.shape[1], local)
    return NoiseEstimate(relative, std, draws, 0.75 / math.sqrt(n), resolved, common)


@dataclass(frozen=True)
class _Scatter:
    """Scatter of live channels about local fits."""

    residuals: np.ndarray  # (n, n_live), complex but for magnitudes
    share: FloatArray  # (n_live,) of the response
    floor: FloatArray  # (n_live,) unit of the response
    relative: FloatArray  # (n_live,) median of both together

    @property
    def draws(self) -> FloatArray:
        """(n, n_live) sizes of the residuals."""
        return np.abs(self.residuals)


def _local_fit(run: Run) -> LocalFit:
    """That with as many poles as the curves of a run have near one resonance."""
    planes = {run.excitation_plane, *(channel.plane for channel in run.channels)}
    return _TWO_POLES if run.magnitude_only or run.spin_rpm or len(planes) > 1 else _ONE_POLE


def _scatter(fit: _Windows, H: np.ndarray, magnitude: bool) -> _Scatter:
    residuals, size = _residuals(fit, H, magnitude), np.abs(H)
    parts = [_two_parts(s, d, magnitude) for s, d in zip(size.T, np.abs(residuals).T, strict=True)]
    share, floor = np.array(parts).T
    relative = np.median(np.hypot(share, floor / np.maximum(size, np.finfo(float).tiny)), axis=0)
    return _Scatter(residuals, share, floor, relative)


def _shared_error_factor(n_channels: int, local: LocalFit) -> float:
    """Factor by which an error that all channels share is larger than the residuals show.

    The denominator is common to all channels: it follows their common error as a numerator does a channel's own.
    """
    numerator, denominator, window = local.numerator + 1, local.denominator, local.wide
    own = 1 - (numerator + denominator / n_channels) / window
    return math.sqrt(own / (1 - (numerator + denominator) / window))


def _shared_error(residuals: np.ndarray, std: FloatArray) -> float:
    """Relative error that all channels share; 0 where it is hardly any. Parameters as in ``shared_variance``."""
    square, error = shared_variance(residuals, std)
    if not square > _SCATTERING.common_errors * error:
        return 0.0
    least = _SCATTERING.common_share * float(np.median(std[np.isfinite(std)])) ** 2
    return math.sqrt(square) if square > least else 0.0


def shared_variance(residuals: np.ndarray, std: FloatArray) -> tuple[float, float]:
    """Square of the relative error that all channels share, and its standard error; (0, inf) where too few lines tell.

    It is the covariance of the channels' relative residuals line by line. The largest quarter is left out; what that
    takes from the covariance it takes from the mean square as well.

    Parameters
    ----------
    residuals : (n, n_live) relative to the responses
    std : (n, n_live) relative standard errors, the shared part among them
    """
    z = residuals / std
    known = np.isfinite(z).all(axis=1)
    z, std = z[known], std[known]
    n, n_channels = z.shape
    if n_channels < 2 or n < _SCATTERING.group:
        return 0.0, math.inf
    squares = np.sum(np.abs(z) ** 2, axis=1)
    kept = np.argsort(squares)[: math.ceil(_SCATTERING.kept * n)]
    enlarged = n_channels * len(kept) / float(squares[kept].sum())
    products = enlarged * (np.abs(z.sum(axis=1)) ** 2 - squares)[kept]
    weights = (np.sum(1 / std, axis=1) ** 2 - np.sum(std**-2, axis=1))[kept]
    square = float(products.sum() / weights.sum())
    return square, float(np.sqrt(np.sum((products - square * weights) ** 2)) / weights.sum())


@dataclass(frozen=True)
class GivenErrors:
    """Given standard errors beside the scatter of the lines."""

    std: FloatArray  # (n_freq, n_channels) as given, or scaled to the scatter in the median where they differ much
    roughness: float  # their own relative scatter from line to line; 0 where unknown
    too_small: NDArray[np.bool_]  # (n_freq, n_channels) values that scatter by much more than that
    share: float  # of the values, that whose errors are far too small
    too_large: float  # and far too large

    @property
    def rough(self) -> bool:
        """Whether they scatter themselves, as those from few repeats do."""
        return self.roughness > GIVEN_ERRORS.rough

    @property
    def uneven(self) -> bool:
        """Whether the errors of more values are far too small than chance has it."""
        return self.share > GIVEN_ERRORS.contradicted_share


def weigh_errors(given: FloatArray, own: FloatArray, H: np.ndarray) -> GivenErrors:
    """Compare given standard errors with the scatter ``own``, all (n_freq, n_channels)."""
    there = np.isfinite(own) & np.isfinite(given) & (given > 0) & (np.abs(H) > 0)
    ratio = float(np.median(own[there] / given[there])) if there.any() else 1.0
    low, high = CREDIBLE
    std = given if low < ratio < high else ratio * given
    with np.errstate(all="ignore"):
        steps = np.abs(np.diff(np.log(std / own), axis=0))
    steps = steps[np.isfinite(steps)]
    roughness = 1.4826 * float(np.median(steps)) / math.sqrt(2) if steps.size else 0.0
    small, large = own > GIVEN_ERRORS.contradicted * std, std > GIVEN_ERRORS.contradicted * own
    shares = (float(np.mean(wrong[there])) if there.any() else 0.0 for wrong in (small, large))
    return GivenErrors(std, roughness, there & small, *shares)


def of_complex(std: FloatArray, run: Run) -> FloatArray:
    """Errors of a run's values as standard errors are given: of the complex response, also where it is a magnitude."""
    return np.sqrt(2) * std if run.magnitude_only else std


def believed_errors(run: Run) -> FloatArray:
    """(n_freq, n_channels) standard errors to fit with: the given ones, as far as the lines' scatter bears them out.

    Where none are given, the scatter, or what a careful laboratory reaches where the lines are too few to show any.
    A given zero is no error. Errors that are wrong by a factor are scaled as a whole. Values with far too small an
    error get their scatter. It is taken throughout where other values have far too large a one, as when one error
    stands for all lines of a channel; and where the errors scatter themselves, as those from few repeats do. Lines too
    far apart contradict nothing.
    """
    noise = estimate_noise(run)
    own = of_complex(noise.std, run)
    estimated = own if noise.resolved else np.minimum(own, GIVEN_ERRORS.most * np.abs(run.H))
    estimated = estimated if np.isfinite(own[:, live_channels(run)]).any() else GIVEN_ERRORS.usual * np.abs(run.H)
    if run.std is None:
        return estimated
    stated = np.where((run.std > 0) | (run.H == 0), run.std, estimated)
    if not noise.resolved:
        return stated
    given = weigh_errors(stated, own, run.H)
    if not (given.rough or given.uneven):
        return given.std
    throughout = given.rough or given.too_large > GIVEN_ERRORS.contradicted_share
    return np.where(np.isfinite(own) & (throughout | given.too_small), own, given.std)


def scatter_over(run: Run, std: FloatArray) -> float:
    """Median scatter of the lines over their standard errors (n_freq, n_channels); nan where it is not known."""
    noise = estimate_noise(run)
    own = of_complex(noise.std, run)
    there = np.isfinite(own) & np.isfinite(std) & (std > 0) & (np.abs(run.H) > 0)
    return float(np.median(own[there] / std[there])) if noise.resolved and there.any() else math.nan


def common_error(run: Run) -> float:
    """Relative standard error that all channels of a run share at a line, as of the complex response [-]."""
    return float(of_complex(np.asarray(estimate_noise(run).common), run))


def live_channels(run: Run) -> np.ndarray:
    """(n_channels,) whether a channel carries a response on half of the lines or more.

    What stays below ``SILENT`` of the largest channel is the noise of a node that is held.
    """
    H = responses(run)
    there = np.count_nonzero(np.isfinite(H) & (H != 0), axis=0) * 2 >= max(len(H), 2)
    known = np.abs(np.where(np.isfinite(H), H, 0.0))
    # Of one wild line nothing follows.
    size = np.quantile(known, _SCATTERING.usual_size, axis=0) if len(H) else known.sum(axis=0)
    return there & (size > SILENT * size.max(initial=0.0))


def responses(run: Run) -> np.ndarray:
    """(n_freq, n_channels) responses, nan where there is no number or one that no sensor gives."""
    size = np.abs(np.where(np.isfinite(run.H), run.H, np.inf))
    return np.where(size > _SCATTERING.largest, np.nan, np.where(size < 1 / _SCATTERING.largest, 0.0, run.H))


def mean_square(squares: FloatArray, *, magnitude: bool = False) -> float:
    """Mean of squared errors that ignores the largest quarter.

    The mean of the smallest three quarters, divided by what it is for |e|^2 of circular normal
    errors (exponential) or, for magnitudes, of a real normal error (chi-squared with one degree).
    nan where there is nothing finite.
    """
    known = np.sort(squares[np.isfinite(squares)])
    if known.size == 0:
        return math.nan
    kept = known[: max(math.ceil(_SCATTERING.kept * known.size), 1)]
    if magnitude:
        c = 1.1503493803760079  # three quarters of a normal variable are within +-c
        share = 1 - 2 * c * math.exp(-(c**2) / 2) / math.sqrt(2 * math.pi) / _SCATTERING.kept
    else:
        c = -math.log(1 - _SCATTERING.kept)
        share = 1 - c * math.exp(-c) / _SCATTERING.kept
    return float(kept.mean()) / share


def _residuals(fit: _Windows, H: np.ndarray, magnitude: bool) -> np.ndarray:
    """(n_freq, n_channels) residual of every line, freed of its leverage; nan where the leverage is too high."""
    Y = np.abs(H) ** 2 if magnitude else H
    size = np.abs(Y)
    # Neither a line in an antiresonance, a thousandth of the usual, nor one that dropped out must rule its window.
    usual = np.maximum(size, 1e-3 * np.median(size, axis=0) + np.finfo(float).tiny)
    usual[1:-1] = np.maximum(usual[1:-1], np.minimum(size[:-2], size[2:]))
    weight = 1 / usual
    first, d = fit.residuals(Y, weight, prior=1e-6, denominator=None)
    level = np.array([mean_square(np.abs(r) ** 2, magnitude=magnitude) for r in (first * weight).T])
    weight = weight / np.maximum(np.sqrt(level), 1e-9)
    second, _ = fit.residuals(Y, weight, prior=_SCATTERING.denominator_prior**-2, denominator=d)
    # An error of |H| is one of 2|H| times it in the square.
    return second / (2 * np.sqrt(size) + np.finfo(float).tiny) if magnitude else second


class _Windows:
    """Local fits round every line, all at once."""

    def __init__(self, frequency_hz: FloatArray, window: int, local: LocalFit):
        n = len(frequency_hz)
        m = min(window, n)
        start = np.clip(np.arange(n) - m // 2, 0, n - m)
        self.line, self.place = np.arange(n), np.arange(n) - start  # where in its window each line stands
        self.index = start[:, None] + np.arange(m)  # (n, m)
        x = frequency_hz[self.index] - frequency_hz[:, None]
        self.x = x / np.abs(x).max(axis=1, keepdims=True)
        self.powers, self.order = self.x[:, :, None] ** np.arange(local.numerator + 1), local.denominator

    def residuals(
        self, Y: np.ndarray, weight: FloatArray, *, prior: float, denominator: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residuals at the windows' own lines and the denominators.

        Parameters
        ----------
        Y : (n, n_channels) curves
        weight : (n, n_channels) one over their standard error, in whatever unit
        prior : one over the variance of each denominator coefficient
        denominator : (n, order) coefficients of an earlier fit, from which the weights follow
            (Sanathanan and Koerner, IEEE Trans. Automatic Control 8, 1963, 56-58)

        Returns
        -------
        (n, n_channels) residuals in the unit of Y, (n, order) coefficients
        """
        w = weight[self.index].swapaxes(1, 2)  # (n, n_channels, m)
        steps = self.x[:, :, None] ** np.arange(1, self.order + 1)  # (n, m, order)
        if denominator is not None:
            D = 1 + np.einsum("nmk,nk->nm", steps, denominator)
            w = w / np.maximum(np.abs(D), 1e-3)[:, None, :]
        Q = np.linalg.qr(self.powers[:, None] * w[..., None])[0]  # (n, n_channels, m, degree + 1)
        y = (w * Y[self.index].swapaxes(1, 2))[..., None]  # (n, n_channels, m, 1)
        b = -steps[:, None] * y  # (n, n_channels, m, order)
        y, b = y - Q @ (Q.swapaxes(-1, -2) @ y), b - Q @ (Q.swapaxes(-1, -2) @ b)
        gram = np.einsum("ncmk,ncml->nkl", b.conj(), b) + prior * np.eye(self.order)
        covariance = np.linalg.pinv(gram, hermitian=True)
        d = np.einsum("nkl,ncml,ncm->nk", covariance, b.conj(), y[..., 0])
        left = y[..., 0] - np.einsum("ncmk,nk->ncm", b, d)  # (n, n_channels, m)
        own, b, Q = left[self.line, :, self.place], b[self.line, :, self.place], Q[self.line, :, self.place]
        leverage = np.sum(Q**2, axis=-1) + np.einsum("nck,nkl,ncl->nc", b, covariance, b.conj()).real
        freedom = np.where(leverage < _SCATTERING.largest_leverage, 1 - leverage, np.nan)
        return own / np.sqrt(freedom) / w[self.line, :, self.place], d


def _two_parts(size: FloatArray, draws: FloatArray, magnitude: bool) -> tuple[float, float]:
    """Relative part and floor of one channel's noise from the sizes of its lines and of their errors.

    Lines are grouped by size; (std / |H|)^2 = relative^2 + floor^2 / |H|^2 is laid through the groups.
    """
    known = np.isfinite(draws) & (size > 0)
    if not known.any():
        return math.nan, math.nan
    inverse, squares = size[known] ** -2.0, (draws[known] / size[known]) ** 2
    groups = np.array_split(np.argsort(inverse), max(min(len(inverse) // _SCATTERING.group, _SCATTERING.groups), 1))
    level = np.array([mean_square(squares[g], magnitude=magnitude) for g in groups])
    typical = np.array([np.median(inverse[g]) for g in groups])
    if not level.all():
        return math.sqrt(mean_square(squares, magnitude=magnitude)), 0.0
    if len(groups) == 1:
        return math.sqrt(level[0]), 0.0
    # Every group counts by its relative error; columns of the same size.
    (a2, b2), _ = nnls(np.stack([level.min() / level, typical / typical.max() * level.max() / level], axis=1), level**0)
    a2, b2 = a2 * level.min(), b2 * level.max() / typical.max()
    left = mean_square(squares / (a2 + b2 * inverse), magnitude=magnitude)
    return math.sqrt(a2 * left), math.sqrt(b2 * left)
