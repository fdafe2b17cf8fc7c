"""Where a candidate's fit begins: next to the nominal model, as far as a first-order step says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, Free, Hypothesis, Term
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition


@dataclass(frozen=True)
class WeakEffect:
    """Where an effect that hardly acts is started from."""

    share: float = 0.02  # of its range, away from an end of it,
    beside: float = 1e-4  # or from a value inside: slopes are steep where a small change shows
    positions: int = 7  # along the shaft


@dataclass(frozen=True)
class Worth:
    """Which candidates are worth a fit, by what they gain to first order."""

    gain: float = 0.3  # this share of the largest gain,
    misfit: float = 40.0  # or within so much misfit of it


WEAK = WeakEffect()
WORTH = Worth()


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


def promises(score: Score, hypothesis: Hypothesis, pair: Hypothesis | None = None) -> list[Promise]:
    """What an effect could gain beside a fit, to first order, and where its own fit should begin; best first."""
    (term,), fit = hypothesis.terms, score.fit
    found = []
    for point in _from_nominal(fit, hypothesis, score.condition):
        gain, scale, moved = score.gain(hypothesis.effects(point[1:]))
        stronger = _scaled(score, term, point[1:], scale, moved)
        u = fit.u if stronger is None else fit.hypothesis.clipped(fit.u + moved[: len(fit.u)])
        nu = fit.nu if stronger is None else fit.nu + moved[len(fit.u) :]
        start = Start(pair or hypothesis, np.concatenate([u, point[1:] if stronger is None else stronger]), nu)
        found.append(Promise(-np.inf if stronger is None else abs(gain), start))
    return sorted(found, key=lambda promise: promise.gain, reverse=True)


def worth_from(largest: float) -> float:
    """The gain from which candidates are worth a fit, where this is the largest."""
    return min(WORTH.gain * largest, largest - WORTH.misfit)


def gains_of(problem: Problem, found: Sequence[Start], fit: Fit) -> list[Promise]:
    """Starts with what they take away from the nominal model's misfit."""
    before = problem.cost(NOMINAL, fit.u[:1], fit.nu)
    return [Promise(before - problem.cost(start.hypothesis, start.u, start.nu), start) for start in found]


def several(hypothesis: Hypothesis) -> bool:
    """Whether more than one number besides a position says how strong the effect is: one start is not enough."""
    return sum(not free.along_shaft for free in hypothesis.free) > 1


def _from_nominal(nominal: Fit, hypothesis: Hypothesis, condition: Condition) -> list[FloatArray]:
    """A start next to the nominal model: each number at the end of its range that changes less, where there is one."""
    (term,) = hypothesis.terms
    if any(free.along_shaft for free in term.free):
        return [np.concatenate([nominal.u[:1], point]) for point in along_the_shaft(term, WEAK.positions, 0.05)]
    point = [_weakly(free, _null(term, free, condition)) for free in term.free]
    return [np.concatenate([nominal.u[:1], point])]


def along_the_shaft(term: Term, count: int, strength: float) -> list[FloatArray]:
    """Starts at several positions; strength as a share of its range."""
    shares = (np.arange(count) + 0.5) / count
    ends = [free.ends for free in term.free]
    at = [free.along_shaft for free in term.free]
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
        return high - WEAK.share * (high - low)
    if free.log:
        null = float(np.log(null)) if null > 0 else low
    return float(np.clip(null + (WEAK.beside if low < null < high else WEAK.share) * (high - low), low, high))


def _null(term: Term, free: Free, condition: Condition) -> float | None:
    """The value at which an effect does nothing, as far as this number alone decides; inf: a limit."""
    null = term.effect.parameters()[free.name].null if not free.along_shaft else None
    return float(getattr(condition, null)) if isinstance(null, str) else null


def _scaled(score: Score, term: Term, point: FloatArray, scale: float, moved: FloatArray) -> FloatArray | None:
    """A weak effect made so many times stronger; None where its range is on the other side of nothing.

    Numbers of which not one alone decides whether the effect does something stay as they are. One that replaces a
    number of the workshop takes over what the tolerance of that one gives up as the fit has ``moved``.
    """
    nulls = {k: _null(term, free, score.condition) for k, free in enumerate(term.free) if not free.along_shaft}
    known = {k: null for k, null in nulls.items() if null is not None}
    both_ways = known and all(term.free[k].low < null < term.free[k].high for k, null in known.items())
    if scale <= 0 and not both_ways:
        return None
    at, taken = point.copy(), score.tolerances_of(moved)
    for k, null in known.items():
        replaced = str(term.effect.parameters()[term.free[k].name].null)
        at[k] = _stronger(term.free[k], at[k], null, scale, taken.get(replaced, 0.0))
    return at


def _stronger(free: Free, u: float, null: float, scale: float, taken: float) -> float:
    """A coordinate so many times as far from the value at which its number does nothing, of which a share is taken."""
    if np.isinf(null):
        moved = u - np.log(scale)
    elif free.log and null == 0:
        moved = u + np.log(scale)
    elif free.log:
        moved = np.log(max(null * (1 + taken) + scale * (np.exp(u) - null), free.low))
    else:
        moved = null + scale * (u - null)
    return float(np.clip(moved, *free.ends))
