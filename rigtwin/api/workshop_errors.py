"""By how much k_b is off where a rig differs from its drawing as one that comes from a workshop usually does."""

from __future__ import annotations

import numpy as np

from rigtwin.estimator.features import Features
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.gap.model.campaign_model import elements_between_nodes
from rigtwin.gap.model.workshop import Workshop
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.sim.campaign import NominalBelief

# Standard error of ln k_b by one shift below which it counts as exact.
_EXACT = 1e-9


def workshop_error(rig: Rig, features: Features, k_b: float, belief: NominalBelief | None = None) -> float:
    """Standard error of ln k_b by the tolerances of a rig, where both shifts are read on the rig as drawn.

    With s the shifts, a tolerance t moves them by ds and the answer by the weighted mean of ds / (ds / d ln k_b).

    Parameters
    ----------
    features : their errors weigh the two shifts
    k_b : that was found [N/m]
    belief : tolerances; default those that are taken where nobody states any
    """
    elements = elements_between_nodes(rig)
    workshop = Workshop(rig, belief or NominalBelief(), elements, elements)
    solid = [k for k, each in enumerate(workshop.tolerances) if each.change]
    changed = np.diag(workshop.std)[solid]
    drawn = StiffnessFinder(workshop.structure(np.zeros(len(workshop.std))))
    shifts, slope = drawn.shifts(k_b), drawn.slopes(k_b)
    stds = np.array([features.delta_f1_std, features.delta_f2_std])
    weights = (slope / np.maximum(stds, _EXACT * np.abs(slope))) ** 2
    moved = [StiffnessFinder(workshop.structure(values)).shifts(k_b) - shifts for values in changed]
    return float(np.linalg.norm([np.average(change / slope, weights=weights) for change in moved]))
