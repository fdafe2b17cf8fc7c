"""Where a candidate's fit begins: points of its ranges, next to the nominal model, or on a grid of its own.

Most effects need nothing here. Those whose misfit has narrow or many minima do: anisotropic bearings (``points``,
``crossing``), whose resonances of the other plane are a few half-power widths wide, a sweep that is too fast
(``scanned``), and a crack, which may be anywhere (``placed``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from scipy.signal import find_peaks

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, Free, Hypothesis, Term
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.search.strategies.dwell import dwell_fits
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import FloatArray

# Starts of one candidate that run on.
RIVALS = 2

# A weak effect is so much of its range away from nothing; along the shaft it is started from so many positions.
_WEAK, _POSITIONS = 0.02, 7

# Every so many lines tell enough to start from.
THIRD = 3

# A plain effect along the shaft: share of its range, positions, steps of each fit.
_PLAIN, _PLACES, _SHORT = 0.7, 10, 8

# Of the grid of anisotropic bearings: angles from the force's direction or from across it [rad], steps along the
# anisotropy, fine enough for a resonance that is two per mille wide, and how many of its valleys are descended into.
_TURNS, _ANISOTROPIES, _VALLEYS = np.array([0.08, 0.2, 0.4, 0.65]), 60, 12


@dataclass(frozen=True)
class Start:
    """Where a candidate's fit begins, or where one ended."""

    hypothesis: Hypothesis
    u: FloatArray
    nu: FloatArray
    cost: float = np.inf  # misfit there, as far as it is known


@dataclass(frozen=True)
class Promise:
    """What a candidate could take away from the misfit to first order, and the start that this suggests."""

    gain: float
    start: Start


def begin(hypothesis: Hypothesis, u: FloatArray, like: Fit) -> Start:
    """A start with the nuisances of another fit, as far as their priors allow."""
    return Start(hypothesis, u, np.clip(like.nu, -2 * like.prior_std, 2 * like.prior_std))


def points(u: FloatArray, hypothesis: Hypothesis) -> list[FloatArray]:
    """A hypothesis' starts after the coordinates that are known, k_b the first of them.

    Bearings with two principal stiffnesses show two resonances for each of the nominal model's, whose k_b suits one of
    them: the mean that goes with a start makes either of the two stiffnesses that k_b.
    """
    starts = hypothesis.starts()
    if hypothesis.ids != ("plane_anisotropy",):
        return [np.concatenate([u, start]) for start in starts]
    place = [free.name for free in hypothesis.free].index("anisotropy")
    return [
        np.concatenate([[u[0] - np.log1p(sign * start[place] / 2)], u[1:], start])
        for start in starts
        for sign in (-1, 1)
    ]


def crossing(problem: Problem, hypothesis: Hypothesis, nominal: Fit, added: float) -> list[Start]:
    """Where anisotropic bearings put a narrow resonance of the other plane: no descent meets it from a width away.

    The stiffness along the force is the nominal model's, the one across it anything. The nominal model strains its k_b
    and its nuisances for a resonance that it does not have: the nuisances begin at nothing, and the best valleys of the
    grid are descended into with all numbers free. None for other effects, with accelerometers across the force (angles
    of both signs), which show that plane openly, and where no point of the grid beats the nominal model, with such a
    relative error added.
    """
    free = {number.name: number for number in hypothesis.free}
    if hypothesis.ids != ("plane_anisotropy",) or free["angle"].low < 0:
        return []
    unstrained = np.zeros_like(nominal.nu)
    limit = problem.cost(NOMINAL, nominal.u[:1], unstrained, added)
    valleys: list[tuple[float, FloatArray]] = []
    for angle in (*_TURNS, *(np.pi / 2 - _TURNS)):
        line = [
            np.array([nominal.u[0] - np.log1p(anisotropy / 2 * np.cos(2 * angle)), anisotropy, angle])
            for anisotropy in np.linspace(0.01, free["anisotropy"].high, _ANISOTROPIES)
        ]
        costs = np.array([np.inf, *(problem.cost(hypothesis, u, unstrained, added) for u in line), np.inf])
        valleys += [(float(costs[k]), line[k - 1]) for k in find_peaks(-costs)[0] if costs[k] < limit]
    valleys.sort(key=itemgetter(0))
    fits = [problem.try_fit(hypothesis, u, unstrained, anneal=(added,), steps=_SHORT) for _, u in valleys[:_VALLEYS]]
    return [Start(hypothesis, fit.u, fit.nu) for fit in sorted(filter(None, fits), key=lambda fit: fit.cost)[:RIVALS]]


def promises(score: Score, hypothesis: Hypothesis, pair: Hypothesis | None = None) -> list[Promise]:
    """What an effect could gain beside a fit, to first order, and where its own fit should begin; best first."""
    (term,), fit = hypothesis.terms, score.fit
    found = []
    for point in _from_nominal(fit, hypothesis, score.condition):
        gain, scale, moved = score.gain(hypothesis.effects(point[1:]))
        stronger = _scaled(term, point[1:], scale, score.condition)
        u = fit.u if stronger is None else fit.hypothesis.clipped(fit.u + moved[: len(fit.u)])
        nu = fit.nu if stronger is None else fit.nu + moved[len(fit.u) :]
        start = Start(pair or hypothesis, np.concatenate([u, point[1:] if stronger is None else stronger]), nu)
        found.append(Promise(-np.inf if stronger is None else abs(gain), start))
    return sorted(found, key=lambda promise: promise.gain, reverse=True)


def scanned(problem: Problem, hypothesis: Hypothesis, fit: Fit) -> list[Promise]:
    """The same for an effect whose misfit has many minima along its number: by grids; empty for others."""
    if hypothesis.ids != ("fast_sweep",):
        return []
    found = [Start(hypothesis, made.u, made.nu) for made in dwell_fits(problem, hypothesis, fit)[:RIVALS]]
    return _kept(problem, found, fit)


def placed(problem: Problem, hypothesis: Hypothesis, fit: Fit) -> list[Promise]:
    """The same for an effect that may be anywhere along the shaft: by short fits of a plain one; empty for others.

    From next to another minimum a crack slides to the end of its range, and to first order it may seem to act the other
    way where it is.
    """
    if "position" not in (free.name for free in hypothesis.free):
        return []
    few, points = problem.thinned(THIRD), _along_the_shaft(hypothesis.terms[0], _PLACES, _PLAIN)
    fits = [few.try_fit(hypothesis, np.append(fit.u[:1], u), fit.nu, anneal=(0.0,), steps=_SHORT) for u in points]
    made = sorted((each for each in fits if each), key=lambda each: each.cost)
    return _kept(problem, [Start(hypothesis, each.u, each.nu) for each in made[:RIVALS]], fit)


def _kept(problem: Problem, found: Sequence[Start], fit: Fit) -> list[Promise]:
    """Starts with what they take away from the nominal model's misfit."""
    before = problem.cost(NOMINAL, fit.u[:1], fit.nu)
    return [Promise(before - problem.cost(start.hypothesis, start.u, start.nu), start) for start in found]


def several(hypothesis: Hypothesis) -> bool:
    """Whether more than one number besides a position says how strong the effect is: one start is not enough."""
    return sum(free.name != "position" for free in hypothesis.free) > 1


def _from_nominal(nominal: Fit, hypothesis: Hypothesis, condition: Condition) -> list[FloatArray]:
    """A start next to the nominal model: each number at the end of its range that changes less, where there is one."""
    if len(hypothesis.terms) != 1:
        return []
    term = hypothesis.terms[0]
    if any(free.name == "position" for free in term.free):
        return [np.concatenate([nominal.u[:1], point]) for point in _along_the_shaft(term, _POSITIONS, 0.05)]
    point = [_weakly(free, _null(term, free, condition)) for free in term.free]
    return [np.concatenate([nominal.u[:1], point])]


def _along_the_shaft(term: Term, count: int, strength: float) -> list[FloatArray]:
    """Starts at several positions; strength as a share of its range."""
    shares = (np.arange(count) + 0.5) / count
    ends = [free.ends for free in term.free]
    at = [free.name == "position" for free in term.free]
    return [
        np.array(
            [low + (share if here else strength) * (high - low) for (low, high), here in zip(ends, at, strict=True)]
        )
        for share in shares
    ]


def _weakly(free: Free, null: float | None) -> float:
    """A coordinate a little away from where the effect does nothing; the middle of the range where none is known."""
    low, high = free.ends
    if null is None:
        return (low + high) / 2
    if np.isinf(null):
        return high - _WEAK * (high - low)
    if free.log:
        null = float(np.log(null)) if null > 0 else low
    return float(np.clip(null + _WEAK * (high - low), low, high))


def _null(term: Term, free: Free, condition: Condition) -> float | None:
    """The value at which an effect does nothing, as far as this number alone decides; inf: a limit."""
    null = term.effect.parameters()[free.name].null if free.name != "position" else None
    return float(getattr(condition, null)) if isinstance(null, str) else null


def _scaled(term: Term, point: FloatArray, scale: float, condition: Condition) -> FloatArray | None:
    """A weak effect made so many times stronger; None where its range is on the other side of nothing.

    Numbers of which not one alone decides whether the effect does something stay as they are.
    """
    nulls = {k: _null(term, free, condition) for k, free in enumerate(term.free) if free.name != "position"}
    known = {k: null for k, null in nulls.items() if null is not None}
    both_ways = known and all(term.free[k].low < null < term.free[k].high for k, null in known.items())
    if scale <= 0 and not both_ways:
        return None
    at = point.copy()
    for k, null in known.items():
        at[k] = _stronger(term.free[k], at[k], null, scale)
    return at


def _stronger(free: Free, u: float, null: float, scale: float) -> float:
    """A coordinate so many times as far from the value at which its number does nothing."""
    if np.isinf(null):
        moved = u - np.log(scale)
    elif free.log and null == 0:
        moved = u + np.log(scale)
    elif free.log:
        moved = np.log(max(null + scale * (np.exp(u) - null), free.low))
    else:
        moved = null + scale * (u - null)
    return float(np.clip(moved, *free.ends))
