"""A law's numbers, read from the runs without solving for a motion.

With the linear rotor known, what the sensors read at a line tells how a joint moves there and what force it takes (see
``gap.nonlinear``). A law is compared with that, line by line. No resonance has to be met: a grid may be coarse, where
one over responses would have to be as fine as the resonances are sharp.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from operator import itemgetter

import numpy as np

from gap.descent import minimise, softened
from gap.hypotheses import K_B, Hypothesis
from gap.law_grid import Rest, axis, node_of
from gap.likelihood import Problem
from gap.nonlinear import NonlinearModal
from gap.starts import Start
from rotor.structure import ComplexArray, FloatArray

# Laws that are read. Of them points along the stiffness, and gaps as shares of the node's largest motion: a soft
# contact is gone far beyond.
READ = ("rub",)
_STIFFNESSES, _SHARES = 10, (0.95, 0.8, 0.6, 0.4, 0.2, 0.1)

# Best points that are carried on, and steps of each.
_CARRIED, _STEPS = 2, 6

# What else than noise a line misses, relative to the response with and without the law: drifts and gains.
_ASIDE = 0.05


def read(problem: Problem, rest: Rest, nu: FloatArray, hypothesis: Hypothesis) -> Start | None:
    """Numbers of a rub that suit the forces best that the runs tell of; None where no run tells any.

    Parameters
    ----------
    nu : (n_nuisances,) the linear rotor's
    """
    reading = _Reading(problem, nu)
    points = [hypothesis.clipped(np.array([rest.calm.u[0], *point])) for point in _points(hypothesis, rest)]
    if not reading.begin(hypothesis, points[0]):
        return None
    best = sorted(points, key=reading.loss)[:_CARRIED]
    ended = [minimise(reading.residual, u, hypothesis.ends, False, _STEPS) for u in best]
    u, cost = min(ended, key=itemgetter(1))
    return Start(hypothesis, u, nu, cost)


def _points(hypothesis: Hypothesis, rest: Rest) -> itertools.product[tuple[float, float]]:
    stiffness, gap = hypothesis.free
    gaps = np.array(_SHARES) * rest.motion[node_of(hypothesis) - 1]
    return itertools.product(axis(stiffness, _STIFFNESSES), np.unique(np.log(np.clip(gaps, gap.low, gap.high))))


class _Reading:
    """What the runs tell of a law's joints, and how far a law is from it."""

    def __init__(self, problem: Problem, nu: FloatArray):
        self._problem, self._nu = problem, nu
        self._told: dict[int, tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray]] = {}

    def begin(self, hypothesis: Hypothesis, u: FloatArray) -> bool:
        """Read the runs, for a law at its place; False where none has a phase and feels the law."""
        self._hypothesis = hypothesis
        for r, modal in enumerate(self._modals(u)):
            if isinstance(modal, NonlinearModal) and not modal.run.magnitude_only:
                drift, tolerance, _ = self._problem.nuisances.of_run(self._nu, r, modal)
                joints, toward, without = modal.told(drift, tolerance)
                observed = self._problem.observed[r]
                H = np.where(observed.valid, observed.run.H, without)
                size = np.maximum(np.linalg.norm(H, axis=1), np.linalg.norm(without, axis=1))[:, None]
                weight = np.where(observed.valid, 1 / np.hypot(observed.std, _ASIDE * size), 0.0)
                self._told[r] = joints, toward, without - H, weight
        return bool(self._told)

    def loss(self, u: FloatArray) -> float:
        z = self.residual(u)
        return np.inf if z is None else float(z @ z)

    def residual(self, u: FloatArray) -> FloatArray | None:
        """What the law leaves of the lines, large errors softened; None without a model."""
        try:
            modals = self._modals(u)
        except (ValueError, np.linalg.LinAlgError):
            return None
        left = []
        for r, (joints, toward, missed, weight) in self._told.items():
            modal = modals[r]
            assert isinstance(modal, NonlinearModal)
            force = modal.balance.forces.harmonics(joints)[:, 1]
            z = (weight * (missed - (toward @ force[..., None])[..., 0])).ravel()
            left += [z.real, z.imag]
        return softened(np.concatenate(left))

    def _modals(self, u: FloatArray) -> Sequence[object]:
        return self._problem.modals(K_B.value(u[0]), self._hypothesis.effects(u[1:]))
