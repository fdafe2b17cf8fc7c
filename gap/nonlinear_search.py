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
from gap.likelihood import Fit, Observed, Problem, Score
from gap.nonlinear import FINAL, MIDDLE, MODEL_ERROR, ROUGH
from gap.search import Progress, Search, best_first, recalibrate
from rotor.structure import FloatArray

# Every so many lines: of the grid, of the descents, of the fits.
_GRID_LINES, _DESCENT_LINES, _FIT_LINES = 8, 6, 4

# What coarsely computed motions leave of the response.
_ROUGH_ERROR, _MIDDLE_ERROR = 0.05, 0.01

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

# Of a bilinear support, ratios of a grid, and its step along the logarithm of k_b.
_RATIOS, _FINELY = 7, 0.02

# Relative distance to the data at which a line of the grid counts half.
_HALF = 0.1

# Mean square misfit of the nominal model below which the gap is small.
NEAR = 5.0

# Effects whose stiffness at rest is not k_b; points that are descended from where the gap is small, and by how much
# more of the misfit than the best one's a candidate may leave after that.
_SHARES_STIFFNESS = ("bearing_friction", "bilinear_support")
_NEAR_STARTS, _AHEAD = 6, 60.0

# Of every effect, so many points of the grid are descended from; of one with places, so many places.
_STARTS, _PLACES = 2, 3

# Relative errors that are added in the descents, first of all effects, then of those that are left.
_FIRST, _THEN = (0.3,), (0.1,)

# Effects that are left after the first descents, and after the second; beyond the best one, only those whose loss
# is within these factors of its.
_LEFT, _FINALISTS = 4, 3
_ROUGHLY, _WITHIN = 3.0, 1.5

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
    every = _thinned(problem, _FIT_LINES, calm.k_b, MODEL_ERROR)
    nominal = every.fit(NOMINAL, calm.u, nu)
    tell = _Teller(progress, len(hypotheses) + 3)
    if nominal.chi2 < NEAR * nominal.n_data:
        left = _near(problem, hypotheses, calm, nominal, tell)
    else:
        left = _far(problem, hypotheses, calm, nu, tell)
    tell("fits")
    forward.resolution = FINAL
    first = [_fitted(every, start, rounds=1, steps=3) for start in left if start.cost < _WITHIN * left[0].cost]
    fits = sorted((fit for fit in first if fit is not None), key=lambda fit: fit.cost)[:_FINALISTS]
    again = [robust_fit(every, fit.hypothesis, fit.u, fit.nu) for fit in fits if fit.cost < fits[0].cost + _CLEAR]
    fits = [fit for fit in again if fit is not None] + fits[len(again) :]
    return every, Search(nominal, tuple(best_first(fits)))


class _Teller:
    """Tells how far the search is."""

    def __init__(self, progress: Progress | None, stages: int):
        self._progress, self._stages, self._done = progress, stages, 0

    def __call__(self, words: str) -> None:
        if self._progress:
            self._progress(self._done, self._stages, words)
        self._done += 1


def _far(problem: Problem, hypotheses: Sequence[Hypothesis], calm: Fit, nu: FloatArray, tell: _Teller) -> list[_Start]:
    """Where the gap is plain: a grid over all numbers by relative distance, then descents; best first."""
    problem.forward.resolution = ROUGH
    few = _thinned(problem, _GRID_LINES, calm.k_b, _ROUGH_ERROR)
    grid: dict[str, list[_Start]] = {}
    for hypothesis in hypotheses:
        tell(str(hypothesis))
        grid.setdefault(hypothesis.ids[0], []).extend(_by_distance(few, hypothesis, calm, nu))
    tell("descents")
    rough = _descend(few, [start for points in grid.values() for start in _promising(points)], _FIRST)
    problem.forward.resolution = MIDDLE
    some = _thinned(problem, _DESCENT_LINES, calm.k_b, _MIDDLE_ERROR)
    left = _descend(some, [start for start in rough[:_LEFT] if start.cost < _ROUGHLY * rough[0].cost], _THEN)
    uneven = [start for h in hypotheses if h.ids == ("bilinear_support",) for start in _uneven(problem, h, calm, nu)]
    best: dict[Hypothesis, _Start] = {}
    for start in sorted([*left, *_descend(some, uneven, (*_FIRST, *_THEN))], key=_cost):
        best.setdefault(start.hypothesis, start)
    return list(best.values())


def _uneven(problem: Problem, hypothesis: Hypothesis, calm: Fit, nu: FloatArray) -> list[_Start]:
    """Starts of a bilinear support: a grid over ratio and k_b on one level, as it is the same at all of them.

    How stiff it is on average is another number for every resonance, and tells in its harmonics.
    """
    low = _thinned(_lowest(problem), _DESCENT_LINES, calm.k_b, _MIDDLE_ERROR)
    (free,) = hypothesis.free
    found = []
    for log_ratio in np.linspace(0.1, 0.95, _RATIOS) * np.log(free.high):
        soft = np.log(calm.k_b * (1 + np.exp(log_ratio / 2)) ** 2 / (4 * np.exp(log_ratio)))
        for log_k_b in np.arange(soft - _FINELY, np.log(calm.k_b) + 2 * _FINELY, _FINELY):
            u = hypothesis.clipped(np.array([log_k_b, log_ratio if free.log else np.exp(log_ratio)]))
            found.append(_Start(_distance(low, hypothesis, u, calm.nu), hypothesis, u, nu))
    return sorted(found, key=_cost)[:_STARTS]


def _near(problem: Problem, hypotheses: Sequence[Hypothesis], calm: Fit, nominal: Fit, tell: _Teller) -> list[_Start]:
    """Where the gap is small: the same grid by what each point leaves of the misfit, nuisances refitted to first order.

    Effects that take part of the bearing stiffness away, which is no small step, are taken from the other grid as well.
    """
    problem.forward.resolution = ROUGH
    some = _thinned(problem, _DESCENT_LINES, calm.k_b, MODEL_ERROR)
    nominal = some.fit(NOMINAL, nominal.u, nominal.nu)
    score = some.score(nominal)
    grid: dict[str, list[_Start]] = {}
    nu = np.clip(nominal.nu, -2 * nominal.prior_std, 2 * nominal.prior_std)
    beside: list[_Start] = []
    for hypothesis in hypotheses:
        tell(str(hypothesis))
        points = [_by_score(score, nominal, hypothesis, u) for u in _grid(hypothesis, calm)]
        grid.setdefault(hypothesis.ids[0], []).extend(points)
        if hypothesis.ids[0] in _SHARES_STIFFNESS:
            beside += sorted(_by_distance(some, hypothesis, calm, nu), key=_cost)[:1]
    tell("descents")
    chosen = sorted((start for points in grid.values() for start in _promising(points)), key=_cost)[:_NEAR_STARTS]
    problem.forward.resolution = MIDDLE
    left = _descend(some, [*chosen, *beside], (0.0,))[:_LEFT]
    return [start for start in left if start.cost < left[0].cost + _AHEAD]


def _by_distance(problem: Problem, hypothesis: Hypothesis, calm: Fit, nu: FloatArray) -> list[_Start]:
    return [_Start(_distance(problem, hypothesis, u, nu), hypothesis, u, nu) for u in _grid(hypothesis, calm)]


def _by_score(score: Score, nominal: Fit, hypothesis: Hypothesis, u: FloatArray) -> _Start:
    """A point of the grid with what it leaves of the misfit, and where k_b and the nuisances follow it to."""
    gain, scale, moved = score.gain(hypothesis.effects(u[1:]))
    if scale <= 0:
        return _Start(np.inf, hypothesis, u, nominal.nu)
    moved = moved / scale  # of the effect as it stands
    at = hypothesis.clipped(np.concatenate([nominal.u + moved[:1], u[1:]]))
    left = nominal.cost - gain / scale * (2 - 1 / scale)
    limit = 2 * nominal.prior_std
    return _Start(left, hypothesis, at, np.clip(nominal.nu + moved[1:], -limit, limit))


def _thinned(problem: Problem, every: int, k_b: float, error: float) -> Problem:
    """Every n-th line of every run; the tolerances bend the modes of the runs that no law acts in."""
    few = problem.thinned(every, error)
    for run in few.runs:
        problem.forward.bend(run, k_b, ())
    return few


def _fitted(problem: Problem, start: _Start, **settings: int) -> Fit | None:
    return robust_fit(problem, start.hypothesis, start.u, start.nu, **settings)


def _cost(start: _Start) -> float:
    return start.cost


def _promising(points: Sequence[_Start]) -> list[_Start]:
    """The best points of an effect: of each of its places one, of a single place several."""
    best = sorted(points, key=_cost)
    places = {start.hypothesis: start for start in reversed(best)}
    return best[:_STARTS] if len(places) == 1 else sorted(places.values(), key=_cost)[:_PLACES]


def _lowest(problem: Problem) -> Problem:
    """The runs at the lowest level."""
    levels = {o.run.force_amplitude_N or 0.0 for o in problem.observed if o.run.support == "bearing"}
    kept = [
        o
        for o in problem.observed
        if o.run.support == "rigid" or (o.run.force_amplitude_N or 0.0) == min(levels, default=0.0)
    ]
    return Problem(problem.forward, kept, problem.model_error)


def _calm(problem: Problem) -> tuple[Fit, FloatArray]:
    """The nominal model of the runs at the lowest level, and its nuisances in the order of all runs."""
    low = _lowest(problem)
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
