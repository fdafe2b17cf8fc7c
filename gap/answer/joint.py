"""An unknown mechanism in words a file can hold: its node, its law, and how far it corrects the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from rigtwin.gap.answer.calibration import calibration_of
from rigtwin.gap.answer.causes import k_b_of
from rigtwin.gap.answer.held_out import shrink_beside_black_box
from rigtwin.gap.document import Estimate, FittedJoint, NodeShare
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.posterior import posterior
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.joint import find_joint
from rigtwin.gap.verdict.standing import strain
from rigtwin.rotor.effects.structure import MeasuredJoint

CURVE_POINTS = 400  # of the dynamic stiffness that is shown


@dataclass(frozen=True)
class UnknownJoint:
    """What is said of a mechanism that no known effect explains."""

    node: int | None = None  # where it acts, as far as the sensors tell
    fit: Fit | None = None  # that corrects the model
    document: FittedJoint | None = None


def unknown_joint(problem: Problem, nominal: Fit, scale: float) -> UnknownJoint:
    """The node at which a joint explains most, and its law if that brings the model nearer to held-out data.

    Parameters
    ----------
    problem : all runs
    nominal : the fit of the nominal model to them
    scale : true over believed standard error
    """
    found = find_joint(problem, nominal)
    if found is None:
        return UnknownJoint()
    document = _documented(problem, nominal, found.fits, scale)
    node = document.node if document else found.node or problem.runs[0].excitation_node
    return UnknownJoint(node, found.fits[0] if document else None, document)


def _documented(problem: Problem, nominal: Fit, fits: Sequence[Fit], scale: float) -> FittedJoint | None:
    """The best of these fits, which is the first; None where gains, drifts and tolerances are strained beside it, or
    where held-out data say otherwise."""
    if not fits or fits[0].log_evidence(scale) <= nominal.log_evidence(scale) or strain(problem, fits[0]) >= 1:
        return None
    best = fits[0]
    shrink, control = shrink_beside_black_box(problem, nominal, best, scale)
    if not shrink.after < shrink.before:
        return None
    (effect,) = best.effects
    assert isinstance(effect, MeasuredJoint)
    std = posterior(problem, best, scale).std[: len(best.u)]
    errors = {
        free.name: getattr(effect, free.name) * s if free.log else s
        for free, s in zip(best.hypothesis.free, std[1:], strict=True)
    }
    roles = effect.parameters()
    hz = np.concatenate([run.frequency_hz for run in problem.runs])
    shown = np.geomspace(hz.min(), hz.max(), CURVE_POINTS)
    Z = effect.dynamic_stiffness(2 * np.pi * shown)
    return FittedJoint(
        node=effect.node or problem.runs[0].excitation_node,
        at_exciter=effect.node == 0,
        parameters={
            name: Estimate(getattr(effect, name), errors.get(name, np.nan), roles[name].unit) for name in roles
        },
        k_b=k_b_of(best, std),
        nodes=_probabilities(problem, fits, scale),
        frequency_hz=tuple(shown.tolist()),
        real=tuple(Z.real.tolist()),
        imag=tuple(Z.imag.tolist()),
        shrink=shrink,
        control=control,
        calibration=calibration_of(problem, best, scale),
    )


def _probabilities(problem: Problem, fits: Sequence[Fit], scale: float) -> tuple[NodeShare, ...]:
    """Of the nodes that were fitted, all of them equally probable before the data; the most probable first."""
    best: dict[int, float] = {}
    for fit in fits:
        node = fit.hypothesis.terms[0].node or problem.runs[0].excitation_node
        best[node] = max(best.get(node, -np.inf), fit.log_evidence(scale))
    shares = [NodeShare(node, float(share)) for node, share in zip(best, softmax(list(best.values())), strict=True)]
    return tuple(sorted(shares, key=lambda each: -each.share))
