"""A law's numbers, read from the runs without solving for a motion.

With the linear rotor known, what the sensors read at a line tells how a joint moves there and what force it takes (see
``gap.nonlinear``). A law is compared with that, line by line. No resonance has to be met: a grid may be coarse, where
one over responses would have to be as fine as the resonances are sharp.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from operator import itemgetter

import numpy as np

from rigtwin.gap.inference.descent import minimise, softened
from rigtwin.gap.inference.hypotheses import K_B, Hypothesis
from rigtwin.gap.inference.observed import Observed
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.run_model import RunModel
from rigtwin.gap.search.laws.grid import Rest, rub_axes
from rigtwin.gap.search.starts import Start
from rigtwin.rotor.model.structure import ComplexArray, FloatArray

# Laws that are read. Of them points along the stiffness, and gaps as shares of the node's largest motion: a soft
# contact is gone far beyond.
READ = ("rub",)
_STIFFNESSES, _SHARES = 10, (0.95, 0.8, 0.6, 0.4, 0.2, 0.1)

# Best points that are carried on, and steps of each.
_CARRIED, _STEPS = 2, 6

# What else than noise a line misses, relative to the response with and without the law: drifts and gains.
_ASIDE = 0.05


@dataclass(frozen=True)
class _Told:
    """What a run tells of a law's joints."""

    joints: ComplexArray  # (n_freq, K, n_joints) displacements [m]
    toward: ComplexArray  # (n_freq, n_channels, n_joints) what a newton of a joint's force takes from the response
    missed: ComplexArray  # (n_freq, n_channels) the response without any force, less what was measured
    weight: FloatArray  # (n_freq, n_channels) one over the error of that; 0 where nothing was


def read(problem: Problem, rest: Rest, nu: FloatArray, hypothesis: Hypothesis) -> Start | None:
    """Numbers of a rub that suit the forces best that the runs tell of; None where no run tells any.

    Parameters
    ----------
    nu : (n_nuisances,) the linear rotor's
    """
    grid = itertools.product(*rub_axes(hypothesis, rest, _STIFFNESSES, _SHARES))
    points = [hypothesis.clipped(np.array([rest.calm.u[0], *point])) for point in grid]
    told = {}
    for r, modal in enumerate(_modals(problem, hypothesis, points[0])):
        law = modal.as_nonlinear
        if law is not None and not law.run.magnitude_only:
            drift, tolerance, _ = problem.nuisances.of_run(nu, r, modal)
            told[r] = _tell(problem.observed[r], *law.read_joints(drift, tolerance))
    if not told:
        return None
    residual = partial(_residual, problem, hypothesis, told)
    best = sorted(points, key=lambda u: _loss(residual(u)))[:_CARRIED]
    ended = [minimise(residual, u, hypothesis.ends, False, _STEPS) for u in best]
    u, cost = min(ended, key=itemgetter(1))
    return Start(hypothesis, u, nu, cost)


def _tell(observed: Observed, joints: ComplexArray, toward: ComplexArray, without: ComplexArray) -> _Told:
    H = np.where(observed.valid, observed.run.H, without)
    size = np.maximum(np.linalg.norm(H, axis=1), np.linalg.norm(without, axis=1))[:, None]
    weight = np.where(observed.valid, 1 / np.hypot(observed.std, _ASIDE * size), 0.0)
    return _Told(joints, toward, without - H, weight)


def _residual(problem: Problem, hypothesis: Hypothesis, told: Mapping[int, _Told], u: FloatArray) -> FloatArray | None:
    """What a law leaves of the lines, large errors softened; None without a model."""
    modals, left = _modals(problem, hypothesis, u), []
    if not modals:
        return None
    for r, run in told.items():
        law = modals[r].as_nonlinear
        assert law is not None
        force = law.balance.forces.harmonics(run.joints)[:, 1]
        z = (run.weight * (run.missed - (run.toward @ force[..., None])[..., 0])).ravel()
        left += [z.real, z.imag]
    return softened(np.concatenate(left))


def _loss(residual: FloatArray | None) -> float:
    return np.inf if residual is None else float(residual @ residual)


def _modals(problem: Problem, hypothesis: Hypothesis, u: FloatArray) -> list[RunModel]:
    """Models of the runs; none where one of them has none."""
    try:
        return problem.modals(K_B.value(u[0]), hypothesis.effects(u[1:]))
    except (ValueError, np.linalg.LinAlgError):
        return []
