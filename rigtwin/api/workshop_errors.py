"""By how much k_b is off where a rig differs from its drawing as one that comes from a workshop usually does."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.estimator.features import Features
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.estimator.runtime import Estimate
from rigtwin.gap.model.campaign_model import elements_between_nodes
from rigtwin.gap.model.workshop import Workshop
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import NominalBelief

# Standard error of ln k_b by one shift below which it counts as exact.
_EXACT = 1e-9

# What answers by shifts says of some: the estimate, and what speaks against it.
Asked = Callable[[Features], tuple[Estimate, list[str]]]


@dataclass(frozen=True)
class ShiftErrors:
    """By how much two shifts are off near a k_b where they are read on the rig as drawn.

    A tolerance t moves both shifts s at once, by ds, and what they say of ln k_b by ds / (ds / d ln k_b).
    """

    tolerances: FloatArray  # (n, 2) of both shifts by each tolerance, one standard deviation [Hz]
    drifts: FloatArray  # (2,) standard deviations by drifts of the resonances from run to run [Hz]
    slope: FloatArray  # (2,) of the shifts by ln k_b [Hz]

    @property
    def std(self) -> FloatArray:
        """(2,) standard deviation of each shift by all of this together [Hz]."""
        return np.hypot(np.linalg.norm(self.tolerances, axis=0), self.drifts)

    def of_mean(self, stds: FloatArray) -> FloatArray:
        """(n,) errors of ln k_b by each tolerance where both shifts, known to ``stds`` (2,) [Hz], are averaged."""
        return (self.tolerances / self.slope) @ self._weights(stds)

    def shared(self, stds: FloatArray) -> float:
        """Variance of that ln k_b which both shifts have in common, beside those of the single shifts."""
        first, second = (self.tolerances / self.slope * self._weights(stds)).T
        return float(2 * first @ second)

    def _weights(self, stds: FloatArray) -> FloatArray:
        weights = (self.slope / np.maximum(stds, _EXACT * np.abs(self.slope))) ** 2
        return weights / weights.sum()


def shift_errors(rig: Rig, k_b: float, belief: NominalBelief) -> ShiftErrors:
    """What the two shifts of a rig with this k_b [N/m] miss by, as the workshop says how well it knows the rig."""
    elements = elements_between_nodes(rig)
    workshop = Workshop(rig, belief, elements, elements)
    solid = [k for k, each in enumerate(workshop.tolerances) if each.change]
    changed = np.diag(workshop.std)[solid]
    drawn = StiffnessFinder(workshop.structure(np.zeros(len(workshop.std))))
    shifts = drawn.shifts(k_b)
    moved = [StiffnessFinder(workshop.structure(values)).shifts(k_b) - shifts for values in changed]
    drifts = belief.expected_drift * np.hypot(drawn.rigid, drawn.rigid - shifts)
    return ShiftErrors(np.reshape(moved, (-1, 2)), drifts, drawn.slopes(k_b))


def workshop_error(rig: Rig, features: Features, k_b: float, belief: NominalBelief | None = None) -> float:
    """Standard error of ln k_b by the tolerances of a rig, where both shifts are read on the rig as drawn.

    Parameters
    ----------
    features : their errors weigh the two shifts
    k_b : that was found [N/m]
    belief : tolerances; default those that are taken where nobody states any
    """
    errors = shift_errors(rig, k_b, belief or NominalBelief())
    return float(np.linalg.norm(errors.of_mean(_stds(features))))


def as_the_workshop_knows(
    ask: Asked, rig: Rig, belief: NominalBelief, features: Features
) -> tuple[Estimate, list[str]]:
    """What ``ask`` says of two shifts whose errors hold those of the rig, too: its tolerances and drifts.

    Both answers of the shifts then weigh by all that they may be off, contradict each other only where they are further
    apart, and the interval counts what they are off together.
    """
    read, against = ask(features)
    if not (math.isfinite(read.k_b) and read.k_b > 0):
        return read, against
    errors = shift_errors(rig, read.k_b, belief)
    stds = np.hypot(_stds(features), errors.std)
    found, against = ask(replace(features, delta_f1_std=float(stds[0]), delta_f2_std=float(stds[1])))
    own = (found.k_b_std / found.k_b) ** 2
    wider = math.sqrt(max(own + errors.shared(stds), 0.0) / own)
    low, high = (found.k_b * (end / found.k_b) ** wider for end in (found.k_b_low, found.k_b_high))
    return replace(found, k_b_std=wider * found.k_b_std, k_b_low=low, k_b_high=high), against


def _stds(features: Features) -> FloatArray:
    return np.array([features.delta_f1_std, features.delta_f2_std])
