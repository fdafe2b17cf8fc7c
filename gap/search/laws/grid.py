"""Where the search for a nonlinear effect begins: points over an effect's numbers, and how far each is from the data.

The lowest force level is the nearest to a linear rotor: the stiffness that suits it is what an effect's own bearing
stiffness starts from.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B_RANGE, Free, Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.linear import over_receptance
from rigtwin.gap.search.laws.robust import fit_at_start, robust_misfit
from rigtwin.gap.search.starts import Start
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.model.structure import FloatArray

# Points along the range of each number of an effect, first number first.
_POINTS = {
    "bearing_cubic": (14,),
    "bearing_hertz": (10,),
    "bearing_friction": (10, 5),
}

# Of a rub, points along its stiffness; and gaps, as shares of its node's largest motion, which goes little beyond them.
_STIFFNESSES, _SHARES = 5, (0.97, 0.85, 0.7, 0.5, 0.3)

# Of clearance, points along the gap; and preloads, as shares of the largest force of the bearings: more than that keeps
# the contact closed.
_GAPS, _LOADED = 7, (0.95, 0.75, 0.55, 0.35, 0.2, 0.1, 0.02)

# Of an even range the grid takes this share of it as the smallest point.
_SMALL = 0.01

# Friction forces where its two stiffnesses are those of the lowest and the highest level.
_FORCES = 30

# Stiffness at rest over the one that suits the lowest level, at which a law may act already.
_AT_REST = {"bearing_cubic": (1.0, 0.95), "bearing_hertz": (1.0, 1.05, 1.1), "bearing_clearance": (1.0, 1.06)}

# Laws that do not act below some amplitude.
_TOUCHING = ("rub", "bearing_clearance")

# Relative distance to the data at which a line of the grid counts half.
_HALF = 0.1


@dataclass(frozen=True)
class Rest:
    """Linear rotors that suit the lowest and the highest level."""

    calm: Fit
    loud: float  # bearing stiffness [N/m]
    motion: FloatArray  # (n_nodes,) largest displacements [m]
    held: tuple[int, ...]  # nodes of the bearings

    @property
    def force(self) -> float:
        """Largest force of a bearing as soft as the lowest level's [N]."""
        return self.calm.k_b * float(self.motion[np.array(self.held) - 1].max())


def seen_motion(problem: Problem, k_b: float) -> FloatArray:
    """(n_nodes,) the largest displacement of every node along the force, in all runs [m].

    Of a node without a sensor, by the sensor that the nominal rotor says moves most at that line, and the shape it
    says the rotor has.
    """
    forward, largest = problem.forward, np.zeros(problem.forward.structure.n_nodes)
    for run in problem.runs:
        along = [c for c, channel in enumerate(run.channels) if channel.plane == run.excitation_plane]
        if not along:
            continue
        H, nodes = np.nan_to_num(run.H[:, along]), np.array([run.channels[c].node for c in along]) - 1
        seen = (run.force_amplitude_N or 1.0) * np.abs(H) / np.abs(over_receptance(run))[:, None]
        shape = np.abs(measured_response(forward.structure, forward.condition(run, k_b), (), run.frequency_hz))
        best, lines = shape[:, nodes].argmax(axis=1), np.arange(len(shape))
        most = shape[lines, nodes[best]]
        motion = shape * np.divide(seen[lines, best], most, out=np.zeros(len(shape)), where=most > 0)[:, None]
        motion[:, nodes] = seen
        largest = np.maximum(largest, motion.max(axis=0))
    return largest


def points_of(hypothesis: Hypothesis, rest: Rest) -> Iterator[FloatArray]:
    """(1 + n_free,) points over an effect's numbers, its stiffness at rest that of the lowest level."""
    name, calm = hypothesis.ids[0], rest.calm
    low, high = np.log(K_B_RANGE)
    for point in itertools.product(*_axes(hypothesis, rest)):
        own = [calm.k_b]
        if name == "bearing_friction":  # sticking or slipping at the lowest level
            own = [max(calm.k_b - float(np.exp(point[1])), 0.1 * calm.k_b), 0.7 * calm.k_b]
        for stiffness in own:
            yield np.array([np.clip(np.log(stiffness), low, high), *point])
    if name == "bearing_friction" and rest.loud < calm.k_b:  # sticking at the lowest level, slipping at the highest
        between = np.log(calm.k_b - rest.loud)
        for force in axis(hypothesis.free[0], _FORCES):
            yield hypothesis.clipped(np.array([np.log(rest.loud), force, between]))


def _axes(hypothesis: Hypothesis, rest: Rest) -> list[FloatArray]:
    """Points along each number's coordinate."""
    if hypothesis.ids == ("rub",):
        return rub_axes(hypothesis, rest, _STIFFNESSES, _SHARES)
    if hypothesis.ids == ("bearing_clearance",):
        gap, preload = hypothesis.free
        preloads = np.clip(np.array(_LOADED) * rest.force, preload.low, preload.high)
        return [axis(gap, _GAPS), np.unique(preloads)]
    return [axis(free, n) for free, n in zip(hypothesis.free, _POINTS[hypothesis.ids[0]], strict=True)]


def rub_axes(hypothesis: Hypothesis, rest: Rest, stiffnesses: int, shares: Sequence[float]) -> list[FloatArray]:
    """So many points along a rub's stiffness; and gaps, as shares of its node's largest motion."""
    stiffness, gap = hypothesis.free
    gaps = np.array(shares) * rest.motion[node_of(hypothesis) - 1]
    return [axis(stiffness, stiffnesses), np.unique(np.log(np.clip(gaps, gap.low, gap.high)))]


def axis(free: Free, n: int) -> FloatArray:
    """(n,) points along the range of a number."""
    low, high = free.ends
    if free.log:
        return low + (np.arange(n) + 0.5) / n * (high - low)
    return low + (high - low) * np.geomspace(_SMALL, 0.7, n)


def node_of(hypothesis: Hypothesis) -> int:
    """Where a law with a place acts."""
    return int(dict(hypothesis.terms[0].fixed)["node"])


def by_distance(problem: Problem, hypothesis: Hypothesis, rest: Rest, nu: FloatArray) -> list[Start]:
    """Points of the grid with their distance; of a law that few lines may see, with their robust misfit."""
    few = hypothesis.ids[0] in _TOUCHING
    far = (lambda fit: robust_misfit(problem, fit)[0]) if few else partial(distance, problem)
    found = []
    for point, factor in itertools.product(points_of(hypothesis, rest), _AT_REST.get(hypothesis.ids[0], (1.0,))):
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
    for u in points_of(hypothesis, rest):
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
        total += float(np.sum(np.where(used, d2 / (d2 + _HALF**2), 0.0)))
        n += float(used.sum())
    return total / max(n, 1.0)
