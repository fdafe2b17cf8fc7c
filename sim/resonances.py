"""Resonances of a run from the lines next to each: pole, half-power band and how many lines lie inside.

Near a resonance every channel is a pole common to all channels and what the other modes leave,
H_c (x - p) = n_c0 + n_c1 x + n_c2 x^2. That is linear but for the weights 1/|x - p|, which follow
from the fit before (Sanathanan and Koerner 1963). Unlike ``modal_fit`` it needs no line inside
the half-power band: on a coarse raster the lines beside the peak still tell where the pole is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray


@dataclass(frozen=True)
class PoleSearch:
    """What a resonance is, and the lines that its pole is fitted to."""

    prominence: float = 1.5  # it stands out from its surroundings by this factor, ...
    # ... and by more than noise does: lines in a channel's noise differ by eight standard deviations once in a million.
    prominence_std: float = 8.0
    fewest: int = 9  # lines of a fit, at least: the nearest ones
    widths: float = 6.0  # half-power widths within which lines are fitted
    most: int = 81  # lines that they are thinned out to
    resolved: float = 0.5  # relative standard error of a damping ratio; beyond it is not resolved
    largest_damping: float = 0.15  # a broad hump between two antiresonances is none; bending modes are damped less
    iterations: int = 6


_SEARCH = PoleSearch()

_NO_MISFIT = (np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Resonance:
    """One resonance; where its damping is not resolved, ``damping_ratio`` is nan."""

    frequency_hz: float
    frequency_std_hz: float
    damping_ratio: float
    damping_std: float
    line: int  # index of the line with the highest response
    peak: float  # root-sum-square response of the live channels there, unit of the run
    misfit: float = np.nan  # rms of (measured - one pole) over the noise, lines near the peak
    misfit_relative: float = np.nan  # the same over the response
    misfit_above: float = np.nan  # share of the squares that lies above the resonance [-]

    @property
    def half_power_hz(self) -> float:
        """Width of the half-power band, 2 zeta f."""
        return 2 * self.damping_ratio * self.frequency_hz


def find_resonances(
    frequency_hz: FloatArray, H: ComplexArray | FloatArray, std: FloatArray, quantity: str
) -> tuple[Resonance, ...]:
    """Every resonance of clean lines, ascending.

    Parameters
    ----------
    frequency_hz : (n_freq,)
    H : (n_freq, n_channels) finite responses of live channels; real: magnitudes
    std : (n_freq, n_channels) their standard errors
    quantity : of the response
    """
    if len(frequency_hz) < 3 or H.shape[1] == 0:
        return ()
    size = np.linalg.norm(H, axis=1)
    error = float(np.median(np.linalg.norm(std, axis=1) / np.maximum(size, np.finfo(float).tiny)))
    displacement = np.log(size / frequency_hz ** DERIVATIVE_ORDER[quantity] + np.finfo(float).tiny)
    prominence = max(np.log(_SEARCH.prominence), _SEARCH.prominence_std * error if np.isfinite(error) else 0.0)
    peaks, _ = find_peaks(displacement, prominence=prominence)
    found = [_resonance(frequency_hz, H, std, int(line), peaks) for line in peaks]
    return tuple(r for r in found if not r.damping_ratio > _SEARCH.largest_damping)


def _resonance(f: FloatArray, H: np.ndarray, std: FloatArray, line: int, peaks: np.ndarray) -> Resonance:
    """The pole next to a peak."""
    peak = float(np.linalg.norm(H[line]))
    spacing = float(np.max(np.abs(np.diff(f[max(line - 1, 0) : line + 2]))))
    unresolved = Resonance(float(f[line]), spacing / 2, np.nan, np.nan, line, peak)
    others = np.abs(f[peaks] - f[line])
    reach = np.min(others[others > 0], initial=np.inf) / 2  # half way to the next resonance
    pole, error, misfit = 0j, np.inf, _NO_MISFIT
    use = _lines_of_fit(f, float(f[line]), _half_height(f, np.linalg.norm(H, axis=1), line))
    for _ in range(2):
        use = use[np.abs(f[use] - f[line]) <= reach]
        if len(use) < 6:
            return unresolved
        pole, error, misfit = _pole(f[use], H[use], std[use], f[line])
        if not (np.isfinite(error) and pole.imag > 0 and abs(pole.real - f[line]) <= 2 * spacing + 4 * pole.imag):
            return unresolved
        use = _lines_of_fit(f, pole.real, _SEARCH.widths * 2 * pole.imag)
    damping, damping_std = pole.imag / abs(pole), error / abs(pole)
    if damping_std > _SEARCH.resolved * damping:
        return unresolved
    return Resonance(float(abs(pole)), error, float(damping), float(damping_std), line, peak, *misfit)


def _half_height(f: FloatArray, size: FloatArray, line: int) -> float:
    """Distance from a peak to where the response first falls below half of it [Hz], to the farther side."""
    low = np.flatnonzero(size < size[line] / 2)
    sides = [low[low < line][-1:], low[low > line][:1]]
    return float(max((abs(f[i[0]] - f[line]) for i in sides if len(i)), default=np.ptp(f)))


def _lines_of_fit(f: FloatArray, centre: float, reach: float) -> np.ndarray:
    """Lines within reach, but not too few; thinned out evenly where they are many."""
    nearest = np.argsort(np.abs(f - centre), kind="stable")
    wanted = np.sort(nearest[: max(np.count_nonzero(np.abs(f - centre) <= reach), _SEARCH.fewest)])
    return wanted[:: -(-len(wanted) // _SEARCH.most)]


def _pole(
    f: FloatArray, H: np.ndarray, std: FloatArray, centre: float
) -> tuple[complex, float, tuple[float, float, float]]:
    """Pole [Hz], imaginary part positive for a damped mode, the standard error of each part, and the misfit."""
    magnitude = not np.iscomplexobj(H)
    reach = float(np.max(np.abs(f - centre)))
    x = (f - centre) / reach
    size = np.abs(H)
    Y, sigma = (size**2, 2 * size * std) if magnitude else (H, std)
    weight = 1 / np.maximum(sigma, 1e-6 * np.abs(Y).max(axis=0))
    order = 2 if magnitude else 1
    powers = x[:, None] ** np.arange(min(3 if magnitude else 2, len(x) - 3) + 1)
    D = np.ones_like(x)
    q, covariance, residual = np.zeros(order), np.eye(order), np.zeros(H.T.shape)
    for _ in range(_SEARCH.iterations):
        w = (weight / np.maximum(np.abs(D), 1e-3)[:, None]).T  # (n_channels, n)
        y = (w * (x**order * Y.T))[..., None]
        b = -(x[:, None] ** np.arange(order)) * (w * Y.T)[..., None]  # (n_channels, n, order)
        Q = np.linalg.qr(powers * w[..., None])[0]
        y, b = y - Q @ (Q.swapaxes(-1, -2) @ y), b - Q @ (Q.swapaxes(-1, -2) @ b)
        covariance = np.linalg.pinv(np.einsum("cmk,cml->kl", b.conj(), b), hermitian=True)
        q = covariance @ np.einsum("cmk,cm->k", b.conj(), y[..., 0])
        D = x**order + (x[:, None] ** np.arange(order)) @ q
        residual = y[..., 0] - b @ q  # (n_channels, n)
    freedom = H.size - powers.shape[1] * H.shape[1] - order
    if freedom < 1:
        return 0j, np.inf, _NO_MISFIT
    misfit = float(np.sqrt(np.sum(np.abs(residual) ** 2) / freedom))
    scale = max(misfit**2, 1.0)
    # In the peak's own unit: the weights are one over the errors.
    squares = np.sum(np.abs(residual) ** 2, axis=0)
    above = float(squares[x > _real_part(q)].sum() / max(squares.sum(), np.finfo(float).tiny))
    misfit = (misfit, misfit * float(np.median(1 / weight / np.abs(Y))), above)
    if not magnitude:
        return complex(centre - reach * q[0]), reach * float(np.sqrt(scale * covariance[0, 0].real / 2)), misfit
    return *_root_of_square(q, scale * covariance, centre, reach), misfit


def _real_part(q: np.ndarray) -> float:
    """Real part of the pole of x + q_0 or x^2 + q_1 x + q_0."""
    return float(-q[0].real if len(q) == 1 else -q[1] / 2)


def _root_of_square(q: FloatArray, covariance: FloatArray, centre: float, reach: float) -> tuple[complex, float]:
    """Pole of a curve whose square has the denominator x^2 + q_1 x + q_0, and the standard error of its parts."""
    square = q[0] - q[1] ** 2 / 4
    if square <= 0:
        return 0j, np.inf
    slope = np.array([1.0, -q[1] / 2]) / (2 * np.sqrt(square))
    error = np.sqrt(max(slope @ covariance @ slope, covariance[1, 1] / 4))
    return complex(centre - reach * q[1] / 2, reach * np.sqrt(square)), reach * float(error)
