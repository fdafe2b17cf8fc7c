"""Candidates ranked by their evidence: the mean of the lists' probability over a prior, on a grid.

The grid is laid over ln k_b and each of an effect's numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2 as chi2_distribution

from rigtwin.gap.document import Estimate
from rigtwin.gap.inference.hypotheses import K_B, PRIORS, Hypothesis
from rigtwin.gap.peaks.lists import Lists, Match
from rigtwin.rotor.model.arrays import FloatArray


@dataclass(frozen=True)
class Grid:
    """How finely a candidate's numbers are looked at."""

    k_b_points: int = 480  # along ln k_b
    points: tuple[int, ...] = (1, 41, 15, 9)  # along each number of an effect with none, one, two or three of them
    resolved: float = 0.008  # [-] relative standard error that these points resolve; sharper lists are zoomed in on
    zoom: float = 4.0  # factor of one zoom
    left_out: float = 6.0  # logarithm of the likelihood below its largest that a zoom leaves out
    first_step: float = 0.02  # of the search for the best point, as a part of each prior range


_GRID = Grid()


@dataclass(frozen=True)
class Scored:
    """A candidate and what the lists make of it."""

    test_level: ClassVar[float] = 0.01  # of the test whether residuals of matched peaks are those of their errors

    hypothesis: Hypothesis
    log_evidence: float
    u: FloatArray  # (1 + n_free,) the best ln k_b and coordinates
    std: FloatArray  # (1 + n_free,) distance from them within which 68 % of the posterior lie
    determined: float  # combinations of numbers, k_b among them, that the data determine
    with_k_b: bool
    matches: tuple[Match, ...] = field(default=())

    @property
    def k_b(self) -> Estimate | None:
        """Bearing stiffness with its standard error."""
        value = K_B.value(self.u[0])
        return Estimate(value, float(value * self.std[0]), "N/m") if self.with_k_b else None

    @property
    def n_parameters(self) -> int:
        """Numbers that were fitted."""
        return len(self.u) - (not self.with_k_b)

    @property
    def n_matched(self) -> int:
        """Listed peaks that match a resonance."""
        return sum(match.n_matched for match in self.matches)

    @property
    def n_foreign(self) -> int:
        """Listed peaks that match none."""
        return sum(len(match.model_hz) for match in self.matches) - self.n_matched

    @property
    def n_unseen(self) -> int:
        """Resonances that should have been listed."""
        return sum(len(match.unseen_hz) for match in self.matches)

    @property
    def chi2(self) -> float:
        """Misfit of the matched peaks."""
        return sum(match.chi2 for match in self.matches)

    @property
    def freedom(self) -> int:
        """Matched peaks more than fitted numbers."""
        return self.n_matched - self.n_parameters

    @property
    def p_value(self) -> float:
        """Probability of a larger misfit by reading errors alone; nan without degrees of freedom."""
        return float(chi2_distribution.sf(self.chi2, self.freedom)) if self.freedom > 0 else float("nan")

    @property
    def adequate(self) -> bool:
        """Whether every listed peak is a resonance of the model within its error, as far as that can be tested."""
        return self.n_foreign == 0 and not self.p_value < self.test_level


@dataclass(frozen=True)
class Ranking:
    """All candidates, best first, the best place of each effect only; the nominal model beside them."""

    nominal: Scored
    scored: tuple[Scored, ...]
    probabilities: tuple[float, ...]  # of each effect, all of its places together
    no_gap: float


def score(lists: Lists, hypothesis: Hypothesis) -> Scored:
    """Evidence on a grid that is narrowed to where lists of small errors have their likelihood."""
    box = lists.ends(hypothesis)
    log_p, axes = np.zeros(1), []
    for inflate in _inflations(lists):
        axes = _axes(lists, box, len(hypothesis.free))
        log_p = _over_grid(lists, hypothesis, axes, inflate)
        if inflate > 1:
            box = _narrow_box(box, axes, log_p)
    volume = float(np.prod((box[:, 1] - box[:, 0]) / _widths(lists.ends(hypothesis))))
    top = float(log_p.max())
    evidence = top + np.log(np.exp(log_p - top).mean()) + np.log(volume) if np.isfinite(top) else -np.inf
    return _summary(lists, hypothesis, axes, log_p, evidence)


def _widths(ends: FloatArray) -> FloatArray:
    """(1 + n_free,) widths of ranges (1 + n_free, 2); 1 where a number is fixed."""
    low, high = ends.T
    return np.where(high > low, high - low, 1.0)


def _inflations(lists: Lists) -> list[float]:
    """Factors on the standard errors, the last one 1."""
    sharpest = min(float(np.min(p.std_hz / p.frequencies_hz)) for p in lists.lists)
    factors = [1.0]
    while sharpest * factors[-1] < _GRID.resolved:
        factors.append(factors[-1] * _GRID.zoom)
    return factors[::-1]


def _axes(lists: Lists, box: FloatArray, n_free: int) -> list[FloatArray]:
    """Middles of equal cells along ln k_b and every free number."""
    counts = [_GRID.k_b_points if lists.with_k_b else 1] + [_GRID.points[n_free]] * n_free
    return [lo + (hi - lo) * (np.arange(n) + 0.5) / n for (lo, hi), n in zip(box, counts, strict=True)]


def _over_grid(lists: Lists, hypothesis: Hypothesis, axes: Sequence[FloatArray], inflate: float) -> FloatArray:
    """Log-likelihood over the grid, ln k_b first."""
    k_b = np.exp(axes[0])
    shape = [len(axis) for axis in axes[1:]]
    log_p = np.empty((len(k_b), *shape))
    for place in np.ndindex(*shape):
        u = np.array([axis[at] for axis, at in zip(axes[1:], place, strict=True)])
        log_p[(slice(None), *place)] = lists.log_likelihood(k_b, hypothesis, u, inflate)
    return log_p


def _summary(
    lists: Lists, hypothesis: Hypothesis, axes: Sequence[FloatArray], log_p: FloatArray, evidence: float
) -> Scored:
    """The best point of a grid, and how far the posterior reaches round it."""
    best = int(np.argmax(log_p))
    known = np.exp(log_p - log_p.max()) if np.isfinite(evidence) else np.ones(log_p.shape)
    share = known / known.sum()
    points = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(len(axes), -1)
    u = points[:, best]
    weight = share.ravel()
    half = [(axis[1] - axis[0]) / 2 if len(axis) > 1 else 0.0 for axis in axes]
    off = np.abs(points - u[:, None])
    std = np.array([_reach(row, weight, h) for row, h in zip(off, half, strict=True)])
    mean: FloatArray = points @ weight
    centred = (points - mean[:, None]) / _widths(lists.ends(hypothesis))[:, None]
    kept = slice(0 if lists.with_k_b else 1, None)
    spread = np.linalg.eigvalsh(12 * (centred[kept] * weight) @ centred[kept].T)
    determined = float(np.clip(1 - spread, 0.0, 1.0).sum())
    return Scored(hypothesis, evidence, u, std, determined, lists.with_k_b)


def polish(lists: Lists, scored: Scored) -> Scored:
    """The best point off the grid, and the peaks matched there."""
    ends = lists.ends(scored.hypothesis)
    low, width = ends[:, 0], ends[:, 1] - ends[:, 0]

    def cost(x: FloatArray) -> float:
        u = low + np.clip(x, 0.0, 1.0) * width
        return -float(lists.log_likelihood(np.exp(u[:1]), scored.hypothesis, u[1:])[0])

    start = (scored.u - low) / width
    step = np.where(start > 0.5, -_GRID.first_step, _GRID.first_step)
    options = {"initial_simplex": np.vstack([start, start + np.diag(step)]), "xatol": 1e-5, "fatol": 1e-3}
    found: Any = minimize(cost, start, method="Nelder-Mead", options=options)
    u = low + np.clip(found.x, 0.0, 1.0) * width
    return replace(scored, u=u, matches=lists.match(float(np.exp(u[0])), scored.hypothesis, u[1:]))


def rank(lists: Lists, exclude: Sequence[str] = ()) -> Ranking:
    """Every effect at its best place, with the probability of all its places."""
    some = [h for h in lists.hypotheses if h.ids[0] not in exclude]
    whole = sum(h.prior for h in some)
    every = [score(lists, replace(h, prior=h.prior / whole)) for h in some]
    nominal = score(lists, Hypothesis())
    weights = np.array([s.log_evidence + np.log(s.hypothesis.prior * (1 - PRIORS.no_gap)) for s in every])
    own = nominal.log_evidence + np.log(PRIORS.no_gap)
    shares = np.exp(np.append(weights, own) - np.logaddexp.reduce(np.append(weights, own)))
    best: dict[str, Scored] = {}
    total: dict[str, float] = {}
    for s, share in sorted(zip(every, shares[:-1], strict=True), key=lambda pair: -pair[1]):
        best.setdefault(s.hypothesis.ids[0], s)
        total[s.hypothesis.ids[0]] = total.get(s.hypothesis.ids[0], 0.0) + float(share)
    names = sorted(total, key=lambda name: -total[name])
    polished, chances = tuple(polish(lists, best[name]) for name in names), tuple(total[name] for name in names)
    return Ranking(polish(lists, nominal), polished, chances, float(shares[-1]))


def _reach(distance: FloatArray, weight: FloatArray, half: float) -> float:
    """Distance within which 68.3 % of the weight lie: a standard error that a far second solution does not blow up.

    Parameters
    ----------
    distance, weight : of every point of the grid
    half : half a cell, over which a point's weight is spread
    """
    values, place = np.unique(distance, return_inverse=True)
    inside = np.append(0.0, np.cumsum(np.bincount(place, weight)))
    return float(np.interp(0.683 * inside[-1], inside, np.append(0.0, values + half)))


def _narrow_box(box: FloatArray, axes: Sequence[FloatArray], log_p: FloatArray) -> FloatArray:
    """The cells that matter, and one more on either side."""
    matters = log_p > log_p.max() - _GRID.left_out
    narrowed = box.copy()
    for d, axis in enumerate(axes):
        others = tuple(k for k in range(log_p.ndim) if k != d)
        used = np.flatnonzero(matters.any(axis=others))
        if len(axis) > 1 and len(used):
            cell = axis[1] - axis[0]
            narrowed[d] = max(axis[used[0]] - 1.5 * cell, box[d, 0]), min(axis[used[-1]] + 1.5 * cell, box[d, 1])
    return narrowed
