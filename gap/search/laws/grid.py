"""How far the points over a law's numbers are from the data.

The lowest force level is the nearest to a linear rotor: the stiffness that suits it is what an effect's own bearing
stiffness starts from.
"""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.linear import over_receptance
from rigtwin.gap.search.laws.robust import fit_at_start, robust_misfit
from rigtwin.gap.search.starts import Start
from rigtwin.gap.search.strategies.law import Rest
from rigtwin.gap.search.strategies.registry import law_strategy_of
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.model.arrays import FloatArray

# Relative distance to the data at which a line of the grid counts half.
HALF = 0.1


def seen_motion(problem: Problem, k_b: float) -> FloatArray:
    """(n_nodes,) the largest displacement of every node along the force, in all runs [m].

    Of a node without a sensor, by the sensor that the nominal rotor says moves most at that line, and the shape it
    says the rotor has.
    """
    forward, largest = problem.forward, np.zeros(problem.forward.structure.n_nodes)
    for run in problem.runs:
        along = run.along_force
        if not along:
            continue
        H, nodes = np.nan_to_num(run.H[:, along]), np.array([run.channels[c].node for c in along]) - 1
        seen = run.forces[:, None] * np.abs(H) / np.abs(over_receptance(run))[:, None]
        shape = np.abs(measured_response(forward.structure, forward.condition(run, k_b), (), run.frequency_hz))
        best, lines = shape[:, nodes].argmax(axis=1), np.arange(len(shape))
        most = shape[lines, nodes[best]]
        motion = shape * np.divide(seen[lines, best], most, out=np.zeros(len(shape)), where=most > 0)[:, None]
        motion[:, nodes] = seen
        largest = np.maximum(largest, motion.max(axis=0))
    return largest


def by_distance(problem: Problem, hypothesis: Hypothesis, rest: Rest, nu: FloatArray) -> list[Start]:
    """Points of the grid with their distance; of a law that few lines may see, with their robust misfit."""
    few = hypothesis.terms[0].effect.acts_beyond_amplitude
    far = (lambda fit: robust_misfit(problem, fit)[0]) if few else partial(distance, problem)
    found = []
    for point, factor in itertools.product(
        law_strategy_of(hypothesis).points(hypothesis, rest), hypothesis.terms[0].effect.stiffness_at_rest
    ):
        u = hypothesis.clipped(point + np.log(factor) * (np.arange(len(point)) == 0))
        try:
            cost = far(fit_at_start(problem, hypothesis, u, nu))
        except (ValueError, np.linalg.LinAlgError):
            cost = np.inf
        found.append(Start(hypothesis, u, nu, cost))
    return found


def by_score(score: Score, rest: Rest, hypothesis: Hypothesis) -> list[Start]:
    """Points of the grid with what each leaves of the misfit, and where k_b and the nuisances follow it to."""
    nominal = score.fit
    found, limit = [], 2 * nominal.prior_std
    for u in law_strategy_of(hypothesis).points(hypothesis, rest):
        gain, scale, moved = score.gain(hypothesis.effects(u[1:]))
        if scale <= 0:
            found.append(Start(hypothesis, u, nominal.nu))
            continue
        moved = moved / scale  # of the effect as it stands
        at = hypothesis.clipped(np.concatenate([nominal.u + moved[:1], u[1:]]))
        left = nominal.cost - gain / scale * (2 - 1 / scale)
        found.append(Start(hypothesis, at, np.clip(nominal.nu + moved[1:], -limit, limit), left))
    return found


def distance(problem: Problem, fit: Fit) -> float:
    """Mean over all values of d^2 / (d^2 + h^2), d the distance relative to the larger of model and data."""
    total = n = 0.0
    for observed, H in zip(problem.observed, problem.predict(fit), strict=True):
        y = np.where(observed.valid, observed.run.H, 0.0)
        a = observed.run.as_recorded(H)
        size = np.maximum(np.abs(y), np.abs(a))
        used = observed.valid & (np.abs(y) > 0)
        d2 = np.abs(y - a) ** 2 / np.maximum(size**2, 1e-300)
        total += float(np.sum(np.where(used, d2 / (d2 + HALF**2), 0.0)))
        n += float(used.sum())
    return total / max(n, 1.0)
