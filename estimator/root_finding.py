"""The baseline: k_b by root finding on the finite-element model itself."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from estimator.features import Features
from rotor.modal import damped_modes
from rotor.structure import Structure
from rotor.system import Condition, build_system


class StiffnessFinder:
    """Looks k_b up on the model of one rotor.

    Parameters
    ----------
    structure : the rotor
    condition : damping to assume; k_b and support in it are ignored
    k_b : range to search [N/m]
    """

    def __init__(self, structure: Structure, condition: Condition | None = None, k_b: tuple[float, float] = (1e5, 1e9)):
        self._structure, self._range = structure, k_b
        self._damping = condition or Condition()
        self._rigid = self._frequencies(rigid=True)

    def shifts(self, k_b: float) -> np.ndarray:
        """(2,) shifts of modes 1 and 2, rigid minus bearing support [Hz]."""
        return self._rigid - self._frequencies(k_b=k_b)

    def from_shift(self, mode: int, shift_hz: float) -> float:
        """k_b at which one mode has this shift [N/m]; nan where none in the range has."""
        low, high = np.log(self._range)

        def miss(log_k: float) -> float:
            return float(self.shifts(float(np.exp(log_k)))[mode - 1] - shift_hz)

        if miss(low) * miss(high) > 0:
            return float("nan")
        return float(np.exp(brentq(miss, low, high, xtol=1e-12)))  # type: ignore[arg-type]

    def fused(self, features: Features) -> float:
        """Both shifts' answers, averaged in log k_b by their errors [N/m]."""
        shifts, stds = (features.delta_f1, features.delta_f2), (features.delta_f1_std, features.delta_f2_std)
        answers = np.log([self.from_shift(mode, shift) for mode, shift in zip((1, 2), shifts, strict=True)])
        slopes = [self._slope(mode, k) for mode, k in zip((1, 2), answers, strict=True)]
        weights = [(slope / max(std, 1e-9)) ** 2 for slope, std in zip(slopes, stds, strict=True)]
        return float(np.exp(np.average(answers, weights=weights)))

    def _slope(self, mode: int, log_k: float, step: float = 1e-4) -> float:
        """d shift / d log k_b [Hz]."""
        up, down = (self.shifts(float(np.exp(log_k + s)))[mode - 1] for s in (step, -step))
        return float((up - down) / (2 * step))

    def _frequencies(self, k_b: float = 1e7, rigid: bool = False) -> np.ndarray:
        condition = Condition(k_b, rigid, self._damping.bearing_damping, self._damping.shaft_damping_ratio)
        return damped_modes(build_system(self._structure, condition)).frequency_hz[[0, 2]]
