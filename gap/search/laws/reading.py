"""A law's numbers, read from the runs without solving for a motion.

With the linear rotor known, the sensors at a line show how a joint moves there and what force acts in it (see
``gap.model.nonlinear``). A law is compared with that force line by line. As no resonance has to be met, the grid may
be coarse; a grid over responses would have to be as fine as the resonances are sharp.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from operator import itemgetter

import numpy as np

from rigtwin.gap.inference.descent import minimise, soften
from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.gap.inference.observed import Observed
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.starts import Start
from rigtwin.gap.search.strategies.law import Rest
from rigtwin.gap.search.strategies.registry import law_strategy_of
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray


@dataclass(frozen=True)
class Reading:
    """How the best points of the grid over a law's numbers are refined."""

    kept: int = 2  # best points of the grid that descend
    steps: int = 6  # of each descent
    error: float = 0.05  # of drifts and gains, beside the noise, relative to the response with and without the law


READING = Reading()


@dataclass(frozen=True)
class _Joints:
    """What a run shows of a law's joints."""

    joints: ComplexArray  # (n_freq, K, n_joints) displacements [m]
    toward: ComplexArray  # (n_freq, n_channels, n_joints) what a newton of a joint's force takes from the response
    missed: ComplexArray  # (n_freq, n_channels) the response without any force, less what was measured
    weight: FloatArray  # (n_freq, n_channels) one over the error of that; 0 where nothing was


def read(problem: Problem, rest: Rest, nu: FloatArray, hypothesis: Hypothesis) -> Start | None:
    """Numbers of a law that suit the forces in the runs best; None where no run shows a force.

    Parameters
    ----------
    nu : (n_nuisances,) the linear rotor's
    """
    points = [hypothesis.clipped(u) for u in law_strategy_of(hypothesis).readings(hypothesis, rest)]
    joints = {}
    for r, modal in enumerate(problem.try_modals(hypothesis, points[0]) or ()):
        law = modal.as_nonlinear
        if law is not None and not law.run.magnitude_only:
            drift, tolerance, _ = problem.nuisances.of_run(nu, r, modal)
            joints[r] = _joints(problem.observed[r], *law.read_joints(drift, tolerance))
    if not joints:
        return None
    residual = partial(_residual, problem, hypothesis, joints)
    best = sorted(points, key=lambda u: _loss(residual(u)))[: READING.kept]
    ended = [minimise(residual, u, hypothesis.ends, hypothesis.log, False, READING.steps) for u in best]
    u, cost = min(ended, key=itemgetter(1))
    return Start(hypothesis, u, nu, cost)


def _joints(observed: Observed, joints: ComplexArray, toward: ComplexArray, without: ComplexArray) -> _Joints:
    H = np.where(observed.valid, observed.run.H, without)
    size = np.maximum(np.linalg.norm(H, axis=1), np.linalg.norm(without, axis=1))[:, None]
    weight = np.where(observed.valid, 1 / np.hypot(observed.std, READING.error * size), 0.0)
    return _Joints(joints, toward, without - H, weight)


def _residual(
    problem: Problem, hypothesis: Hypothesis, joints: Mapping[int, _Joints], u: FloatArray
) -> FloatArray | None:
    """(n_residuals,) what a law leaves of the lines, large errors softened; None without a model."""
    modals, left = problem.try_modals(hypothesis, u), []
    if modals is None:
        return None
    for r, run in joints.items():
        law = modals[r].as_nonlinear
        assert law is not None
        force = law.balance.forces.harmonics(run.joints)[:, 1]
        z = (run.weight * (run.missed - (run.toward @ force[..., None])[..., 0])).ravel()
        left += [z.real, z.imag]
    return soften(np.concatenate(left))


def _loss(residual: FloatArray | None) -> float:
    return np.inf if residual is None else float(residual @ residual)
