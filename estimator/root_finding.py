"""The baseline: k_b by root finding on the finite-element model itself."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from rigtwin.estimator.features import Features
from rigtwin.estimator.intervals import Z90
from rigtwin.estimator.runtime import Estimate
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem

# Bearing damping is looked for in these steps [N s/m]; far beyond, the dampers lock the bearings.
_BEARING_DAMPING = np.concatenate([[0.0], np.geomspace(0.01, 1e5, 141)])


# The model's own error in log k_b: what a bearing damping that nobody knows and a coarse mesh do to a shift.
_MODEL_ERROR = 1e-3

# Two answers that are further apart than so many standard errors contradict each other.
_FURTHEST = 4.0


class StiffnessFinder:
    """Looks k_b up on the model of one rotor.

    Parameters
    ----------
    structure : the rotor
    condition : damping to assume; k_b and support in it are ignored
    k_b : range to search [N/m]
    node : driving point of the amplitude ratio
    """

    def __init__(
        self,
        structure: Structure,
        condition: Condition | None = None,
        k_b: tuple[float, float] = (1e5, 1e9),
        node: int = 2,
    ):
        self._structure, self._range, self._node = structure, k_b, node
        self._damping = condition or Condition()
        self.rigid = self._frequencies(rigid=True)  # (2,) first two frequencies on rigid supports [Hz]

    def shifts(self, k_b: float) -> np.ndarray:
        """(2,) shifts of modes 1 and 2, rigid minus bearing support [Hz].

        >>> StiffnessFinder(assemble(load_rig("nit-rourkela"))).shifts(k_b=1e7).round(1)
        array([ 4., 26.])
        """
        return self.rigid - self._frequencies(k_b=k_b)

    def from_shift(self, mode: int, shift_hz: float) -> float:
        """k_b at which one mode has this shift [N/m]; nan where none in the range has."""
        low, high = np.log(self._range)

        def miss(log_k: float) -> float:
            return float(self.shifts(float(np.exp(log_k)))[mode - 1] - shift_hz)

        if not miss(low) * miss(high) <= 0:  # neither of one sign nor nan
            return float("nan")
        return float(np.exp(brentq(miss, low, high, xtol=1e-12)))  # type: ignore[arg-type]

    def fused(self, features: Features) -> float:
        """Both shifts' answers, averaged in log k_b by their errors [N/m]; nan where one has none."""
        shifts, stds = (features.delta_f1, features.delta_f2), (features.delta_f1_std, features.delta_f2_std)
        answers = np.log([self.from_shift(mode, shift) for mode, shift in zip((1, 2), shifts, strict=True)])
        if np.isnan(answers).any():
            return float("nan")
        slopes = [self._slope(mode, k) for mode, k in zip((1, 2), answers, strict=True)]
        weights = [(slope / max(std, 1e-9)) ** 2 for slope, std in zip(slopes, stds, strict=True)]
        return float(np.exp(np.average(answers, weights=weights)))

    def readings(self, features: Features) -> list[tuple[float, float]]:
        """k_b [N/m] by each shift alone, and the standard error of its logarithm; nan where no k_b has the shift."""
        shifts, stds = (features.delta_f1, features.delta_f2), (features.delta_f1_std, features.delta_f2_std)
        read = []
        for mode, (shift, std) in enumerate(zip(shifts, stds, strict=True), start=1):
            k_b = self.from_shift(mode, shift)
            slope = self._slope(mode, math.log(k_b)) if k_b > 0 else math.nan
            read.append((k_b, math.hypot(std / abs(slope), _MODEL_ERROR)))
        return read

    def estimate(self, features: Features) -> Estimate:
        """Both shifts' answers together, with the 90 % interval that their errors give.

        It is valid where both shifts have an answer and these agree. The amplitude ratio is not used.

        >>> finder = StiffnessFinder(assemble(load_rig("nit-rourkela")))
        >>> found = finder.estimate(Features(4.036, 26.0, np.nan, 0.01, 0.02, np.nan))
        >>> found.valid, f"{found.k_b:.2e}"
        (True, '1.00e+07')
        """
        k_b, std = np.array(self.readings(features)).T
        weights = std**-2.0
        log_k, log_std = float(np.average(np.log(k_b), weights=weights)), float(weights.sum() ** -0.5)
        low, middle, high = (math.exp(log_k + z * log_std) for z in (-Z90, 0.0, Z90))
        return Estimate(middle, middle * log_std, low, high, valid=not self.objections(features))

    def objections(self, features: Features) -> list[str]:
        """What speaks against the answer of ``estimate``, in sentences."""
        readings = self.readings(features)
        (first, first_std), (second, second_std) = readings
        if math.isnan(first + second):
            low, high = self._range
            named = zip(("delta_f1", "delta_f2"), (features.delta_f1, features.delta_f2), readings, strict=True)
            return [
                f"{name} = {shift:.4g} Hz: the model has this shift at no k_b between {low:g} and {high:g} N/m"
                for name, shift, (k_b, _) in named
                if math.isnan(k_b)
            ]
        if abs(math.log(first / second)) > _FURTHEST * math.hypot(first_std, second_std):
            return [
                f"the two shifts contradict each other: delta_f1 alone gives {first / 1e6:.4g} MN/m, delta_f2 alone "
                f"{second / 1e6:.4g} MN/m; the rig differs from its model; rigtwin diagnose says where"
            ]
        return []

    def amplitude_ratio(self, k_b: float, bearing_damping: float) -> float:
        """A1/A0 of mode 1 at the driving point, bearing over rigid support [-]."""
        zeta = self._damping.shaft_damping_ratio
        rigid, bearing = (Condition(k_b, pinned, bearing_damping, zeta) for pinned in (True, False))
        a0, a1 = (_resonance_acceleration(build_system(self._structure, c), self._node) for c in (rigid, bearing))
        return a1 / a0

    def bearing_damping_for_ratio(self, k_b: float, ratio: float) -> float:
        """The least bearing damping that gives mode 1 this amplitude ratio [N s/m]; nan where none does."""

        def miss(damping: float) -> float:
            return self.amplitude_ratio(k_b, damping) / ratio - 1

        low = _BEARING_DAMPING[0]
        if miss(low) < 0:
            return float("nan")
        for high in _BEARING_DAMPING[1:]:
            if miss(high) <= 0:
                return float(brentq(miss, low, high, xtol=1e-9 * high))  # type: ignore[arg-type]
            low = high
        return float("nan")

    def slopes(self, k_b: float, step: float = 1e-4) -> np.ndarray:
        """(2,) derivatives of the shifts by ln k_b [Hz]."""
        up, down = (self.shifts(float(np.exp(np.log(k_b) + s))) for s in (step, -step))
        return (up - down) / (2 * step)

    def _slope(self, mode: int, log_k: float) -> float:
        return float(self.slopes(float(np.exp(log_k)))[mode - 1])

    def _frequencies(self, k_b: float = 1e7, rigid: bool = False) -> np.ndarray:
        condition = Condition(k_b, rigid, self._damping.bearing_damping, self._damping.shaft_damping_ratio)
        return damped_modes(build_system(self._structure, condition).in_plane(1)).frequency_hz[:2]


def _resonance_acceleration(system: LinearSystem, node: int) -> float:
    """Resonance acceleration of mode 1 alone at a node in y, per unit force there [(m/s^2)/N].

    Receptance is the sum of R / (s - lambda) over all eigenvalues; a pair of them is
    2 [s Re R - Re(R conj lambda)] / (s^2 + 2 zeta omega_r s + omega_r^2). At s = i omega_r its
    denominator is 2 i zeta omega_r^2, and acceleration is omega_r^2 times it.
    """
    system = system.in_plane(1)
    force = system.unit_vector(node, 1)
    poles, residues = StateSpace(system).poles(force[:, None], force[None])
    oscillating = np.imag(poles) > 1e-9 * np.abs(poles).max()
    lowest = np.argmin(np.where(oscillating, np.abs(poles), np.inf))
    first, R = poles[lowest], residues[0, 0, lowest]
    omega, zeta = np.abs(first), -first.real / np.abs(first)
    return float(np.abs(2 * (1j * omega * R.real - (R * first.conjugate()).real)) / (2 * zeta))
