"""Which nonlinear effect: a grid over its numbers on few lines, descent from the best points, a robust fine fit.

The lowest force level is the nearest to a linear rotor: the stiffness that suits it is what an effect's own bearing
stiffness starts from. Lines that a candidate puts on another branch than the data count by a loss that grows like a
logarithm, so they cannot decide.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gap.hypotheses import K_B_RANGE, NOMINAL, Free, Hypothesis
from gap.likelihood import Fit, Observed, Problem
from gap.nonlinear import FINAL, MIDDLE, MODEL_ERROR, ROUGH
from gap.search import Progress, Search, best_first, recalibrate
from rotor.structure import FloatArray

# Every so many lines: of the grid, of the descents, of the fits.
_GRID_LINES, _DESCENT_LINES, _FIT_LINES = 8, 6, 4

# Points along the range of each number of an effect, first number first.
_POINTS = {
    "bearing_cubic": (14,),
    "bearing_hertz": (10,),
    "bearing_clearance": (7, 6),
    "bearing_friction": (10, 5),
    "bilinear_support": (7,),
    "rub": (4, 6),
}

# Of an even range the grid takes this share of it as the smallest point.
_SMALL = 0.01

# Relative distance to the data at which a line of the grid counts half.
_HALF = 0.1

# Of every effect, so many points of the grid are descended from; of one with places, so many places.
_STARTS, _PLACES = 2, 3

# Relative errors that are added in the descents, first of all effects, then of those that are left.
_FIRST, _THEN = (0.3,), (0.1,)

# Effects that are left after the first descents, and after the second; beyond the best one, only those whose loss
# is within this factor of its.
_LEFT, _FINALISTS, _WITHIN = 4, 3, 1.5

# A misfit by so much above the best one's is not fitted further.
_CLEAR = 400.0

# Misfit of a line, in standard errors, beyond which it counts as an outlier; rounds of weighting, and steps in each.
OUTLIER = 3.0
_ROUNDS, _STEPS = 2, 5


@dataclass(frozen=True)
class _Start:
    """A point of the grid or of a descent."""

    cost: float
    hypothesis: Hypothesis
    u: FloatArray
    nu: FloatArray


def search_nonlinear(
    problem: Problem, hypotheses: Sequence[Hypothesis], progress: Progress | None = None
) -> tuple[Problem, Search]:
    """Fit the nonlinear candidates.

    Returns
    -------
    the problem with the model error of a truncated motion, and the search on it
    """
    forward = problem.forward
    calm, nu = _calm(problem)
    stages = len(hypotheses) + 3
    forward.resolution = ROUGH
    few = problem.thinned(_GRID_LINES, MODEL_ERROR)
    grid: dict[str, list[_Start]] = {}
    for number, hypothesis in enumerate(hypotheses):
        if progress:
            progress(number, stages, str(hypothesis))
        points = [_Start(_distance(few, hypothesis, u, nu), hypothesis, u, nu) for u in _grid(hypothesis, calm)]
        grid.setdefault(hypothesis.ids[0], []).extend(points)
    if progress:
        progress(len(hypotheses), stages, "descents")
    chosen = [start for points in grid.values() for start in _promising(points)]
    rough = _descend(few, chosen, _FIRST)[:_LEFT]
    forward.resolution = MIDDLE
    some = problem.thinned(_DESCENT_LINES, MODEL_ERROR)
    left = _descend(some, rough, _THEN)
    if progress:
        progress(len(hypotheses) + 1, stages, "fits")
    forward.resolution = FINAL
    every = problem.thinned(_FIT_LINES, MODEL_ERROR)
    nominal = every.fit(NOMINAL, calm.u, nu)
    first = [_fitted(every, start, rounds=1, steps=3) for start in left if start.cost < _WITHIN * left[0].cost]
    fits = sorted((fit for fit in first if fit is not None), key=lambda fit: fit.cost)[:_FINALISTS]
    again = [robust_fit(every, fit.hypothesis, fit.u, fit.nu) for fit in fits if fit.cost < fits[0].cost + _CLEAR]
    fits = [fit for fit in again if fit is not None] + fits[len(again) :]
    return every, Search(nominal, tuple(best_first(fits)))


def _fitted(problem: Problem, start: _Start, **settings: int) -> Fit | None:
    return robust_fit(problem, start.hypothesis, start.u, start.nu, **settings)


def _cost(start: _Start) -> float:
    return start.cost


def _promising(points: Sequence[_Start]) -> list[_Start]:
    """The best points of an effect: of each of its places one, of a single place several."""
    best = sorted(points, key=_cost)
    places = {start.hypothesis: start for start in reversed(best)}
    return best[:_STARTS] if len(places) == 1 else sorted(places.values(), key=_cost)[:_PLACES]


def _calm(problem: Problem) -> tuple[Fit, FloatArray]:
    """The nominal model of the runs at the lowest level, and its nuisances in the order of all runs."""
    levels = {o.run.force_amplitude_N or 0.0 for o in problem.observed if o.run.support == "bearing"}
    kept = [
        o
        for o in problem.observed
        if o.run.support == "rigid" or (o.run.force_amplitude_N or 0.0) == min(levels, default=0.0)
    ]
    low = Problem(problem.forward, kept, problem.model_error)
    fit = recalibrate(low)
    nu = np.zeros(problem.nuisances.n)
    nu[problem.nuisances.tolerance] = fit.nu[low.nuisances.tolerance]
    if low.nuisances.sensors == problem.nuisances.sensors:
        nu[problem.nuisances.sensor] = fit.nu[low.nuisances.sensor]
    return fit, np.clip(nu, -2 * problem.nuisances.std, 2 * problem.nuisances.std)


def _grid(hypothesis: Hypothesis, calm: Fit) -> Iterator[FloatArray]:
    """(1 + n_free,) points over an effect's numbers, its stiffness at rest that of the lowest level."""
    name = hypothesis.ids[0]
    axes = [_axis(free, n) for free, n in zip(hypothesis.free, _POINTS[name], strict=True)]
    low, high = np.log(K_B_RANGE)
    for point in itertools.product(*axes):
        own = [calm.k_b]
        if name == "bearing_friction":  # sticking or slipping at the lowest level
            own = [max(calm.k_b - float(np.exp(point[1])), 0.1 * calm.k_b), 0.7 * calm.k_b]
        elif name == "bilinear_support":
            own = [calm.k_b * (1 + np.exp(point[0] / 2)) ** 2 / (4 * np.exp(point[0]))]
        for stiffness in own:
            yield np.array([np.clip(np.log(stiffness), low, high), *point])


def _axis(free: Free, n: int) -> FloatArray:
    low, high = free.ends
    if free.log:
        return low + (np.arange(n) + 0.5) / n * (high - low)
    return low + (high - low) * np.geomspace(_SMALL, 0.7, n)


def _distance(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray) -> float:
    """Mean over all values of d^2 / (d^2 + h^2), d the distance relative to the larger of model and data."""
    try:
        made = problem.predict(_unfitted(problem, hypothesis, u, nu))
    except (ValueError, np.linalg.LinAlgError):
        return np.inf
    total = n = 0.0
    for observed, H in zip(problem.observed, made, strict=True):
        y = np.where(observed.valid, observed.run.H, 0.0)
        a = np.abs(H) if observed.run.magnitude_only else H
        size = np.maximum(np.abs(y), np.abs(a))
        used = observed.valid & (np.abs(y) > 0)
        d2 = np.abs(y - a) ** 2 / np.maximum(size**2, 1e-300)
        total += float(np.sum(np.where(used, d2 / (d2 + _HALF**2), 0.0)))
        n += float(used.sum())
    return total / max(n, 1.0)


def _unfitted(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray) -> Fit:
    n = len(u) + len(nu)
    return Fit(hypothesis, u, nu, 0.0, 0.0, np.zeros((n, n)), 0, problem.nuisances.std, problem.with_k_b)


def _descend(problem: Problem, starts: Sequence[_Start], anneal: Sequence[float]) -> list[_Start]:
    """Down from every start with ever smaller errors added; the best of every candidate, best first."""
    best: dict[Hypothesis, _Start] = {}
    for start in starts:
        try:
            fit = problem.fit(start.hypothesis, start.u, start.nu, anneal=anneal, steps=4)
        except (ValueError, np.linalg.LinAlgError):
            continue
        loss, _ = _loss(problem, fit)
        found = _Start(loss + fit.penalty, start.hypothesis, fit.u, fit.nu)
        if start.hypothesis not in best or found.cost < best[start.hypothesis].cost:
            best[start.hypothesis] = found
    return sorted(best.values(), key=_cost)


def robust_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    u: FloatArray,
    nu: FloatArray | None = None,
    rounds: int = _ROUNDS,
    steps: int = _STEPS,
) -> Fit | None:
    """A fit in which a line far from the data counts by the logarithm of its misfit.

    Its ``chi2`` is that loss; ``precision`` is that of the weighted lines. None where the start has no model.
    """
    weighted = problem
    fit: Fit | None = None
    for _ in range(rounds):
        try:
            fit = weighted.fit(hypothesis, u, nu, anneal=(0.0,), steps=steps)
        except (ValueError, np.linalg.LinAlgError):
            return None
        u, nu = fit.u, fit.nu
        loss, squares = _loss(problem, fit)
        weighted = _weighted(problem, squares)
        fit = replace(fit, chi2=loss)
        if max(float(each.max(initial=0.0)) for each in squares) < OUTLIER**2:
            break
    return fit


def _loss(problem: Problem, fit: Fit) -> tuple[float, list[FloatArray]]:
    """Robust misfit of all lines, and (n_freq,) mean square residual of every run's lines."""
    total, squares = 0.0, []
    for observed, H in zip(problem.observed, problem.predict(fit), strict=True):
        y, real = np.nan_to_num(observed.run.H), observed.run.magnitude_only
        used = observed.valid & (np.abs(y) > 0)
        d = np.abs(y) - np.abs(H) if real else y - H
        variance = (observed.std**2 + (problem.model_error * np.abs(y)) ** 2) / 2
        z2 = np.where(used, np.abs(d) ** 2 / variance, 0.0)
        n = used.sum(axis=1) * (1 if real else 2)
        mean = z2.sum(axis=1) / np.maximum(n, 1)
        squares.append(mean)
        total += float(np.sum(n * OUTLIER**2 * np.log1p(mean / OUTLIER**2)))
    return total, squares


def _weighted(problem: Problem, squares: Sequence[FloatArray]) -> Problem:
    """The problem with the errors of outlying lines enlarged."""
    observed = []
    for o, mean in zip(problem.observed, squares, strict=True):
        model2 = (problem.model_error * np.abs(np.nan_to_num(o.run.H))) ** 2
        growth = mean[:, None] / OUTLIER**2
        observed.append(Observed(o.run, np.sqrt(o.std**2 * (1 + growth) + model2 * growth)))
    return Problem(problem.forward, observed, problem.model_error)
