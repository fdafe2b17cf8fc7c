"""Modes of a measured frequency response: one resonance at a time, weighted by the lines' errors.

Near a resonance every channel is the sum of one mode and a smooth rest of the other modes,

    H_c(omega) = -omega^2 [ R_c / (omega_r^2 - omega^2 + 2 i zeta omega_r omega)
                            + U_c + V_c (omega^2 - omega_r^2) / omega_r^2 ],

for accelerance (mobility and receptance with i omega and 1 in front). omega_r and zeta are common
to all channels; R, U, V are complex and linear, and are solved for inside the residual (variable
projection, Golub and Pereyra, *SIAM J. Numer. Anal.* 10, 1973, 413-432).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import MeasurementError, Plane, Run

# A resonance is higher than its surroundings by at least this factor.
PROMINENCE = 1.5

# A response at the end of a band of this share of the highest one is said to be a resonance's.
_AMONG_THE_HIGHEST = 0.5

# Lines within so many half-power bandwidths on either side take part in a fit.
_BANDWIDTHS = 8.5


logger = logging.getLogger(__name__)


class ModalFitError(MeasurementError):
    """There are too few lines round a resonance, or no resonance at all."""


class CoarseRasterError(ModalFitError):
    """A resonance is there, but too few lines tell of it."""


@dataclass(frozen=True)
class Mode:
    """One fitted mode with standard errors.

    ``frequency_hz`` is the undamped natural frequency, ``resonance`` the mode's own response at it,
    |R|/(2 zeta) for accelerance and constant force, in the unit of the run.
    """

    frequency_hz: float
    frequency_std_hz: float
    damping_ratio: float
    damping_ratio_std: float
    residue: ComplexArray  # (n_channels,)
    resonance: FloatArray  # (n_channels,)
    resonance_std: FloatArray  # (n_channels,)
    misfit: float  # reduced chi-squared; nan where the run carries no standard errors


def fit_modes(run: Run, n_modes: int | None = None) -> tuple[Mode, ...]:
    """Fit every resonance of a run, lowest first, or only the ``n_modes`` lowest.

    Where no number of modes is asked for, a resonance that cannot be fitted is left out, with a warning.

    Raises
    ------
    ModalFitError : fewer resonances than asked for; too few lines round one that is asked for, or round every one
    """
    modes, left_out = try_modes(run, n_modes)
    for words in left_out:
        logger.warning(words)
    return modes


def try_modes(run: Run, n_modes: int | None = None) -> tuple[tuple[Mode, ...], tuple[str, ...]]:
    """``fit_modes``, with a sentence on each thing that was left out instead of a warning."""
    left_out = []
    if run.magnitude_only:
        raise ModalFitError(f"run {run.name!r} holds magnitudes only; a modal fit needs the phase")
    measured = np.any(run.H != 0, axis=1)
    if measured.any() and not measured.all():
        left_out.append(f"run {run.name!r}: {np.count_nonzero(~measured)} lines without a response are left out")
        run = run.on_lines(measured)
    left_out += _beyond_the_ends(run)
    found = resonances(run.frequency_hz, _displacement_size(run))
    if not found or (n_modes is not None and len(found) < n_modes):
        raise ModalFitError(
            f"run {run.name!r} shows {len(found)} resonances between {run.frequency_hz[0]:g} and "
            f"{run.frequency_hz[-1]:g} Hz, {n_modes or 1} are needed; widen the band or refine the lines"
        )
    if n_modes is not None:
        return tuple(fit_mode(run, f) for f in found[:n_modes]), tuple(left_out)
    modes, errors = [], []
    for f in found:
        try:
            modes.append(fit_mode(run, f))
        except ModalFitError as error:
            errors.append(error)
    if not modes:
        raise errors[0]
    left_out += [f"a resonance is left out: {error}" for error in errors]
    return tuple(modes), tuple(left_out)


def _beyond_the_ends(run: Run) -> list[str]:
    """A sentence on each end of the band that cuts a resonance off, where the response is among the highest.

    There the response does not fall far enough before the band ends, so that it is no resonance to ``resonances``.
    """
    f, size, response = run.frequency_hz, _displacement_size(run), np.linalg.norm(run.H, axis=1)
    cut = set(resonances(np.pad(f, 1), np.pad(size, 1))) - set(resonances(f, size))
    high = [peak for peak in sorted(cut) if response[f == peak].max() > _AMONG_THE_HIGHEST * response.max()]
    return [
        f"run {run.name!r}: the response is high at {peak:g} Hz, at the end of the band ({f[0]:g} to {f[-1]:g} Hz): a "
        "resonance there is not fitted; widen the band"
        for peak in high
    ]


def fit_mode(run: Run, near_hz: float) -> Mode:
    """Fit the resonance next to a frequency.

    Parameters
    ----------
    run : a run with phase; lines within 8.5 half-power bandwidths on either side are used, but none nearer to another
        resonance
    near_hz : the line with the highest response, or close to it

    Raises
    ------
    CoarseRasterError : fewer than 8 lines round it
    ModalFitError : another resonance too close to it
    """
    centre, width = half_power_band(run.frequency_hz, _displacement_size(run), near_hz)
    reach = min(_BANDWIDTHS * width, _half_way_to_neighbour(run, near_hz))
    use = np.abs(run.frequency_hz - centre) <= reach
    if np.count_nonzero(use) < 8:
        raise CoarseRasterError(
            f"run {run.name!r}: only {np.count_nonzero(use)} lines within {reach:.3g} Hz of the resonance "
            f"at {centre:.3f} Hz, 8 are needed; its half-power band is {width:.3g} Hz wide: refine the lines there"
        )
    moving = np.abs(run.H[use]).max(axis=0) > 1e-9 * np.abs(run.H[use]).max()
    problem = _Problem(run, use, moving)
    start = np.array([1.0, np.log(max(width / (2 * centre), 1e-6))])
    solution = least_squares(
        lambda p: problem.residual(p, centre), start, x_scale=[width / centre, 1.0], xtol=1e-13, ftol=1e-13, gtol=1e-13
    )
    if abs(centre * (solution.x[0] - 1)) > reach:
        raise ModalFitError(
            f"run {run.name!r}: the fit of the resonance at {centre:.3f} Hz went to {centre * solution.x[0]:.3f} Hz, "
            "another one's; they are too close to be told apart here"
        )
    return problem.mode(solution.x, centre, solution.jac, solution.cost)


def resonances(frequency_hz: FloatArray, magnitude: FloatArray) -> list[float]:
    """Lines at which a magnitude stands out from its surroundings by half or more, ascending [Hz].

    >>> resonances(frequency_hz=np.array([98.0, 99.0, 100.0, 101.0]), magnitude=np.array([1.0, 2.0, 9.0, 3.0]))
    [100.0]
    """
    places, _ = find_peaks(np.log(magnitude + np.finfo(float).tiny), prominence=np.log(PROMINENCE))
    return [float(frequency_hz[p]) for p in places]


def half_power_band(frequency_hz: FloatArray, magnitude: FloatArray, near_hz: float) -> tuple[float, float]:
    """Resonance and half-power bandwidth [Hz] next to a line.

    1/|X|^2 of one mode is a parabola in frequency; it is laid through the five nearest lines.
    """
    nearest = np.argsort(np.abs(frequency_hz - near_hz), kind="stable")[:5]
    x = frequency_hz[nearest] - near_hz
    a, b, c = np.polyfit(x, (magnitude[nearest].max() / magnitude[nearest]) ** 2, 2)
    if a <= 0:
        return near_hz, float(np.ptp(x))
    offset = float(np.clip(-b / (2 * a), x.min(), x.max()))
    lowest = max(c - b**2 / (4 * a), 1e-3 * abs(c))
    return near_hz + offset, 2 * float(np.sqrt(lowest / a))


def _half_way_to_neighbour(run: Run, near_hz: float) -> float:
    """Half the distance from a resonance to the next one [Hz]; inf where it is the only one."""
    distances = np.sort(np.abs(np.array(resonances(run.frequency_hz, _displacement_size(run))) - near_hz))
    return float(distances[1]) / 2 if len(distances) > 1 else np.inf


def _displacement_size(run: Run) -> FloatArray:
    """(n_freq,) root-sum-square over channels, brought to displacement."""
    return np.linalg.norm(run.H, axis=1) / run.frequency_hz ** DERIVATIVE_ORDER[run.quantity]


class _Problem:
    """Weighted residuals of one resonance; parameters p = (omega_r / centre, log zeta)."""

    def __init__(self, run: Run, use: np.ndarray, moving: np.ndarray):
        self.omega = 2 * np.pi * run.frequency_hz[use]
        self.H = run.H[np.ix_(use, moving)]
        self.n_channels, self.moving = run.H.shape[1], moving
        self.factor = (1j * self.omega) ** DERIVATIVE_ORDER[run.quantity]
        self.order = DERIVATIVE_ORDER[run.quantity]
        self.known_errors = run.std is not None
        # Without standard errors every line counts alike; their size is the optimiser's unit.
        alike = np.full(self.H.shape, np.abs(self.H).max())
        std = run.std[np.ix_(use, moving)] if run.std is not None else alike
        # A line with an error of 1e-12 would dominate the fit, so no error is taken below 1e-9 of the largest line.
        self.weight = np.sqrt(2) / np.maximum(std, 1e-9 * np.abs(self.H).max(axis=0))

    def columns(self, p: FloatArray, centre: float) -> ComplexArray:
        """(n_lines, 3) factors of R, U and V."""
        w_r, zeta = 2 * np.pi * centre * p[0], np.exp(p[1])
        mode = w_r**2 / (w_r**2 - self.omega**2 + 2j * zeta * w_r * self.omega)
        rest = np.stack([mode, np.ones_like(mode), (self.omega / w_r) ** 2 - 1], axis=1)
        return self.factor[:, None] * rest / w_r**self.order

    def linear(self, p: FloatArray, centre: float) -> tuple[ComplexArray, ComplexArray]:
        """(3, n_moving) coefficients and (n_lines, n_moving) weighted residuals."""
        columns = self.columns(p, centre)
        coefficients = np.empty((3, self.H.shape[1]), dtype=complex)
        residual = np.empty_like(self.H)
        for c, weight in enumerate(self.weight.T):
            A, b = columns * weight[:, None], self.H[:, c] * weight
            coefficients[:, c] = np.linalg.lstsq(A, b, rcond=None)[0]
            residual[:, c] = A @ coefficients[:, c] - b
        return coefficients, residual

    def residual(self, p: FloatArray, centre: float) -> FloatArray:
        """Real and imaginary residuals, flat."""
        r = self.linear(p, centre)[1].ravel()
        return np.concatenate([r.real, r.imag])

    def resonance(self, p: FloatArray, centre: float) -> FloatArray:
        """(n_moving,) |H| of the mode alone at omega_r."""
        return np.abs(self.linear(p, centre)[0][0]) / (2 * np.exp(p[1]))

    def mode(self, p: FloatArray, centre: float, J: FloatArray, cost: float) -> Mode:
        """The fitted mode with errors; errors grow with the misfit where the model does not fit."""
        freedom = max(2 * self.H.size - 6 * self.H.shape[1] - 2, 1)
        chi2 = 2 * cost / freedom
        scale = max(chi2, 1.0) if self.known_errors else chi2
        covariance = scale * np.linalg.pinv(J.T @ J)
        coefficients, _ = self.linear(p, centre)
        slope = np.array([self._derivative(p, centre, k) for k in range(2)])  # (2, n_moving)
        given_p = self._residue_std(p, centre) * np.sqrt(scale) / (2 * np.exp(p[1]))
        variance = np.einsum("kc,kl,lc->c", slope, covariance, slope) + given_p**2
        zeta = float(np.exp(p[1]))
        return Mode(
            frequency_hz=float(centre * p[0]),
            frequency_std_hz=float(centre * np.sqrt(covariance[0, 0])),
            damping_ratio=zeta,
            damping_ratio_std=float(zeta * np.sqrt(covariance[1, 1])),
            residue=self._spread(coefficients[0]),
            resonance=self._spread(self.resonance(p, centre)),
            resonance_std=self._spread(np.sqrt(variance)),
            misfit=chi2 if self.known_errors else float("nan"),
        )

    def _derivative(self, p: FloatArray, centre: float, k: int) -> FloatArray:
        step = np.zeros(2)
        step[k] = 1e-6 * (np.exp(p[1]) if k == 0 else 1.0)
        return (self.resonance(p + step, centre) - self.resonance(p - step, centre)) / (2 * step[k])

    def _residue_std(self, p: FloatArray, centre: float) -> FloatArray:
        """Standard error of |R| per channel for given omega_r and zeta."""
        columns = self.columns(p, centre)
        normal = [(columns * w[:, None]).conj().T @ (columns * w[:, None]) for w in self.weight.T]
        return np.sqrt(np.array([np.linalg.pinv(n)[0, 0].real for n in normal]))

    def _spread(self, values: np.ndarray) -> np.ndarray:
        """Values of the moving channels among all channels, zero elsewhere."""
        spread = np.zeros(self.n_channels, dtype=values.dtype)
        spread[self.moving] = values
        return spread


def driving_point(run: Run, mode: Mode, node: int, plane: Plane = "y") -> tuple[float, float]:
    """A mode's resonance response at a node, with its standard error."""
    run.channel(node, plane)  # says so when the node was not measured
    place = [(c.node, c.plane) for c in run.channels].index((node, plane))
    return float(mode.resonance[place]), float(mode.resonance_std[place])
