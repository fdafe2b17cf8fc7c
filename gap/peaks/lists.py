"""A campaign of which only resonance frequencies survive: what a handful of numbers can and cannot tell.

A list of resonances is read off a curve by a person. A resonance that stands out of the curve is listed with
probability ``seen``, one that hardly stands out with less; a listed peak may also be foreign: of the exciter, the
frame, or a motion that no rotor model has. So the probability of a list under a model is the largest, over all ways
to match listed peaks with the model's resonances in order, of

    product over matches   p_j N(listed_i; f_j, std_i)
    product over resonances within the tested range that are not listed   1 - p_j
    product over listed peaks that match nothing   foreign peaks per list / tested range

The evidence of a candidate is the mean of that over its prior, on a grid: k_b and each of the effect's numbers.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2 as chi2_distribution

from rigtwin.gap.answer.causes import cause_of
from rigtwin.gap.document import Band, Diagnosis, Estimate, Finding, NextTest, Where
from rigtwin.gap.inference.hypotheses import K_B, PRIORS, Hypothesis, candidates
from rigtwin.gap.model.campaign_model import structure_of
from rigtwin.gap.peaks.resonances import Resonances, Rotor
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.structure import FloatArray
from rigtwin.sim.campaign import Campaign, Channel, PeakList, Run

# Level of the test whether the residuals of matched peaks are those of their standard errors.
_TEST_LEVEL = 0.01

# Points along ln k_b, and along each number of an effect with so many of them.
_K_B_POINTS, _POINTS = 480, {0: 1, 1: 41, 2: 15, 3: 9}

# Relative standard error that those points resolve; sharper lists are zoomed in on, by so much at a time.
_RESOLVED, _ZOOM = 0.008, 4.0

# Logarithm of the likelihood below its largest that a zoom leaves out.
_LEFT_OUT = 6.0

# First step of the search for the best point, as a part of each prior range.
_STEP = 0.02

# Effects whose numbers do not move resonances.
_DAMPING_ONLY = ("shaft_damping", "bearing_damping")

# Candidates at least so probable, beside the first, are not told apart from it.
_RIVAL = 0.05


@dataclass(frozen=True)
class Reading:
    """What is assumed of how the lists came about."""

    seen: float = 0.9  # probability that a resonance which stands out is listed
    foreign: float = 0.1  # foreign peaks expected in a list
    noticed: float = 0.05  # height, over the highest one's, from which a resonance stands out


@dataclass(frozen=True)
class Match:
    """One list beside a model's resonances."""

    peaks: PeakList
    model_hz: tuple[float | None, ...]  # of each listed peak; None: it matches nothing
    unseen_hz: tuple[float, ...]  # resonances in the tested range that stand out and are not listed

    @property
    def chi2(self) -> float:
        """Squared differences of the matched peaks in their standard errors."""
        return sum(z**2 for z in self.residuals if z is not None)

    @property
    def residuals(self) -> tuple[float | None, ...]:
        """Listed minus model, in standard errors; None for a peak that matches nothing."""
        rows = zip(self.model_hz, self.peaks.frequencies_hz, self.peaks.std_hz, strict=True)
        return tuple(None if f is None else float((listed - f) / std) for f, listed, std in rows)

    @property
    def n_matched(self) -> int:
        """Listed peaks that match a resonance."""
        return sum(f is not None for f in self.model_hz)


@dataclass(frozen=True)
class Scored:
    """A candidate and what the lists make of it."""

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
        return self.n_foreign == 0 and not self.p_value < _TEST_LEVEL


@dataclass(frozen=True)
class Ranking:
    """All candidates, best first, the best place of each effect only; the nominal model beside them."""

    nominal: Scored
    scored: tuple[Scored, ...]
    probabilities: tuple[float, ...]  # of each effect, all of its places together
    no_gap: float


class Lists:
    """Resonance lists of one rig, and how probable they are under a model."""

    def __init__(self, campaign: Campaign, reading: Reading | None = None):
        self.campaign, self.lists, self.reading = campaign, campaign.peaks, reading or Reading()
        self.structure = structure_of(campaign.rig, 1)  # a list of peaks is far coarser than any mesh
        self.rotor = Rotor(self.structure, campaign.nominal, load_rig(campaign.rig).excitation_node)
        self.with_k_b = any(peaks.support == "bearing" for peaks in self.lists)
        every = np.concatenate([peaks.frequencies_hz for peaks in self.lists])
        self.tested_hz = (float(every.min()) / 2, float(every.max()))

    def read_as(self, reading: Reading) -> Lists:
        """The same lists under another assumption of how they came about."""
        other = copy.copy(self)
        other.reading = reading
        return other

    @property
    def n_peaks(self) -> int:
        """Listed peaks."""
        return sum(len(peaks.frequencies_hz) for peaks in self.lists)

    @cached_property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """Single effects that move resonances, at every place."""
        found = [h for h in candidates([_stand_in(p) for p in self.lists], self.structure) if _moves_resonances(h)]
        total = sum(h.prior for h in found)
        return tuple(replace(h, prior=h.prior / total) for h in found)

    def log_likelihood(self, k_b: FloatArray, hypothesis: Hypothesis, u: FloatArray, inflate: float = 1.0):
        """(n_k_b,) of all lists; -inf where there is no such rotor."""
        total = np.zeros(len(k_b))
        for peaks in self.lists:
            try:
                found = self.rotor.resonances(peaks.support, k_b, hypothesis.effects(u))
            except (ValueError, np.linalg.LinAlgError):
                return np.full(len(k_b), -np.inf)
            total = total + self._table(peaks, found, inflate)[-1, -1]
        return np.where(np.isfinite(total), total, -np.inf)

    def _table(self, peaks: PeakList, found: Resonances, inflate: float = 1.0) -> FloatArray:
        """(n_peaks + 1, N_RESONANCES + 1, n_k_b) log-likelihood of the first peaks by the first resonances."""
        _, unseen, matched, foreign = self._terms(peaks, found, inflate)
        n, m, n_k = matched.shape
        table = np.full((n + 1, m + 1, n_k), -np.inf)
        table[0, 0] = -self.reading.foreign
        for i in range(n + 1):
            for j in range(m + 1):
                if i:
                    table[i, j] = np.maximum(table[i, j], table[i - 1, j] + foreign)
                if j:
                    table[i, j] = np.maximum(table[i, j], table[i, j - 1] + unseen[j - 1])
                if i and j:
                    table[i, j] = np.maximum(table[i, j], table[i - 1, j - 1] + matched[i - 1, j - 1])
        return np.where(np.isnan(found.f_hz[:, 0]), -np.inf, table)

    def _terms(self, peaks: PeakList, found: Resonances, inflate: float):
        """Probability that a resonance is seen; logarithms that it is not, that a peak is its own, that one is foreign.

        Shapes: (N_RESONANCES, n_k_b) twice, (n_peaks, N_RESONANCES, n_k_b), ().
        """
        f, height = found.f_hz.T, found.height.T
        low, high = self.tested_hz
        inside = (f >= low) & (f <= high)
        highest = np.max(np.where(inside, height, 0.0), axis=0)
        enough = np.maximum(self.reading.noticed * highest, 1e-300)
        seen = self.reading.seen * np.clip(height / enough, 0.0, 1.0)
        std = peaks.std_hz[:, None, None] * inflate
        z = (peaks.frequencies_hz[:, None, None] - np.where(np.isfinite(f), f, 1e9)) / std
        with np.errstate(divide="ignore"):
            matched = np.log(seen) - z**2 / 2 - np.log(np.sqrt(2 * np.pi) * std)
        unseen = np.where(inside, np.log1p(-seen), 0.0)
        return seen, unseen, matched, np.log(self.reading.foreign / (high - low))

    def match(self, k_b: float, hypothesis: Hypothesis, u: FloatArray) -> tuple[Match, ...]:
        """The most probable matching of every list."""
        made = []
        for peaks in self.lists:
            found = self.rotor.resonances(peaks.support, np.array([k_b]), hypothesis.effects(u))
            made.append(self._matched(peaks, found))
        return tuple(made)

    def _matched(self, peaks: PeakList, found: Resonances) -> Match:
        table = self._table(peaks, found)[:, :, 0]
        seen, unseen, _, foreign = self._terms(peaks, found, 1.0)
        i, j = table.shape[0] - 1, table.shape[1] - 1
        partner: list[float | None] = [None] * i
        left: list[float] = []
        while i or j:
            if j and np.isclose(table[i, j], table[i, j - 1] + unseen[j - 1, 0], rtol=0, atol=1e-9):
                j -= 1
                f = float(found.f_hz[0, j])
                inside = self.tested_hz[0] <= f <= self.tested_hz[1]
                left += [f] if inside and seen[j, 0] > self.reading.seen / 2 else []
            elif i and np.isclose(table[i, j], table[i - 1, j] + foreign, rtol=0, atol=1e-9):
                i -= 1
            else:
                i, j = i - 1, j - 1
                partner[i] = float(found.f_hz[0, j])
        return Match(peaks, tuple(partner), tuple(sorted(left)))

    # -- evidence ----------------------------------------------------------------------------------

    def score(self, hypothesis: Hypothesis) -> Scored:
        """Evidence on a grid that is narrowed to where lists of small errors have their likelihood."""
        ends = hypothesis.ends
        box = ends.copy()
        log_p, axes = np.zeros(1), []
        for inflate in self._inflations():
            axes = self._axes(box, len(hypothesis.free))
            log_p = self._grid(hypothesis, axes, inflate)
            if inflate > 1:
                box = _narrowed(box, axes, log_p)
        width = np.where(ends[:, 1] > ends[:, 0], ends[:, 1] - ends[:, 0], 1.0)
        volume = float(np.prod((box[:, 1] - box[:, 0]) / width))
        top = float(log_p.max())
        evidence = top + np.log(np.exp(log_p - top).mean()) + np.log(volume) if np.isfinite(top) else -np.inf
        return self._summary(hypothesis, axes, log_p, evidence, width)

    def _inflations(self) -> list[float]:
        """Factors on the standard errors, the last one 1."""
        sharpest = min(float(np.min(p.std_hz / p.frequencies_hz)) for p in self.lists)
        factors = [1.0]
        while sharpest * factors[-1] < _RESOLVED:
            factors.append(factors[-1] * _ZOOM)
        return factors[::-1]

    def _axes(self, box: FloatArray, n_free: int) -> list[FloatArray]:
        """Middles of equal cells along ln k_b and every free number."""
        counts = [_K_B_POINTS if self.with_k_b else 1] + [_POINTS[n_free]] * n_free
        return [lo + (hi - lo) * (np.arange(n) + 0.5) / n for (lo, hi), n in zip(box, counts, strict=True)]

    def _grid(self, hypothesis: Hypothesis, axes: Sequence[FloatArray], inflate: float) -> FloatArray:
        """Log-likelihood over the grid, ln k_b first."""
        k_b = np.exp(axes[0])
        shape = [len(axis) for axis in axes[1:]]
        log_p = np.empty((len(k_b), *shape))
        for place in np.ndindex(*shape):
            u = np.array([axis[at] for axis, at in zip(axes[1:], place, strict=True)])
            log_p[(slice(None), *place)] = self.log_likelihood(k_b, hypothesis, u, inflate)
        return log_p

    def _summary(
        self, hypothesis: Hypothesis, axes: Sequence[FloatArray], log_p: FloatArray, evidence: float, width: FloatArray
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
        centred = (points - mean[:, None]) / width[:, None]
        kept = slice(0 if self.with_k_b else 1, None)
        spread = np.linalg.eigvalsh(12 * (centred[kept] * weight) @ centred[kept].T)
        determined = float(np.clip(1 - spread, 0.0, 1.0).sum())
        return Scored(hypothesis, evidence, u, std, determined, self.with_k_b)

    def polished(self, scored: Scored) -> Scored:
        """The best point off the grid, and the peaks matched there."""
        ends = scored.hypothesis.ends
        low, width = ends[:, 0], ends[:, 1] - ends[:, 0]

        def cost(x: FloatArray) -> float:
            u = low + np.clip(x, 0.0, 1.0) * width
            return -float(self.log_likelihood(np.exp(u[:1]), scored.hypothesis, u[1:])[0])

        start = (scored.u - low) / width
        step = np.where(start > 0.5, -_STEP, _STEP)
        options = {"initial_simplex": np.vstack([start, start + np.diag(step)]), "xatol": 1e-5, "fatol": 1e-3}
        found: Any = minimize(cost, start, method="Nelder-Mead", options=options)
        u = low + np.clip(found.x, 0.0, 1.0) * width
        return replace(scored, u=u, matches=self.match(float(np.exp(u[0])), scored.hypothesis, u[1:]))

    def rank(self, exclude: Sequence[str] = ()) -> Ranking:
        """Every effect at its best place, with the probability of all its places."""
        every = [self.score(h) for h in self.hypotheses if h.ids[0] not in exclude]
        nominal = self.score(Hypothesis())
        weights = np.array([s.log_evidence + np.log(s.hypothesis.prior * (1 - PRIORS.no_gap)) for s in every])
        own = nominal.log_evidence + np.log(PRIORS.no_gap)
        shares = np.exp(np.append(weights, own) - np.logaddexp.reduce(np.append(weights, own)))
        best: dict[str, Scored] = {}
        total: dict[str, float] = {}
        for s, share in sorted(zip(every, shares[:-1], strict=True), key=lambda pair: -pair[1]):
            best.setdefault(s.hypothesis.ids[0], s)
            total[s.hypothesis.ids[0]] = total.get(s.hypothesis.ids[0], 0.0) + float(share)
        names = sorted(total, key=lambda name: -total[name])
        return Ranking(
            self.polished(nominal),
            tuple(self.polished(best[name]) for name in names),
            tuple(total[name] for name in names),
            float(shares[-1]),
        )


def _moves_resonances(hypothesis: Hypothesis) -> bool:
    effect = hypothesis.terms[0].effect
    return effect.family in ("structure", "support") and effect.id not in _DAMPING_ONLY


def _stand_in(peaks: PeakList) -> Run:
    """A run that says which support was measured."""
    f = peaks.frequencies_hz
    return Run(f, np.ones((len(f), 1), dtype=complex), (Channel(2),), peaks.support)


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


def _narrowed(box: FloatArray, axes: Sequence[FloatArray], log_p: FloatArray) -> FloatArray:
    """The cells that matter, and one more on either side."""
    matters = log_p > log_p.max() - _LEFT_OUT
    narrowed = box.copy()
    for d, axis in enumerate(axes):
        others = tuple(k for k in range(log_p.ndim) if k != d)
        used = np.flatnonzero(matters.any(axis=others))
        if len(axis) > 1 and len(used):
            cell = axis[1] - axis[0]
            narrowed[d] = max(axis[used[0]] - 1.5 * cell, box[d, 0]), min(axis[used[-1]] + 1.5 * cell, box[d, 1])
    return narrowed


# -- the diagnosis -----------------------------------------------------------------------------------


def diagnose_peaks(campaign: Campaign, exclude: Sequence[str], findings: tuple[Finding, ...]) -> Diagnosis:
    """Rank what could explain a list of resonances.

    A few frequencies never prove a cause: the verdict is "no_gap" or "not_enough_data".
    """
    lists = Lists(campaign)
    return diagnosis_of(campaign, lists, lists.rank(exclude), exclude, findings)


def diagnosis_of(
    campaign: Campaign,
    lists: Lists,
    ranking: Ranking,
    exclude: Sequence[str] = (),
    findings: tuple[Finding, ...] = (),
) -> Diagnosis:
    """What a ranking says, in the form of every diagnosis."""
    nominal = ranking.nominal
    causes = tuple(
        cause_of(s.hypothesis, s.u, s.std, p, s.k_b, s.log_evidence)
        for s, p in zip(ranking.scored, ranking.probabilities, strict=True)
    )
    agrees = ranking.no_gap > THRESHOLDS.sure and nominal.adequate and nominal.n_unseen == 0
    return Diagnosis(
        title=campaign.title,
        rig=Path(campaign.rig).name,
        verdict="no_gap" if agrees else "not_enough_data",
        sentence=_sentence(lists, ranking, agrees=agrees),
        nominal={
            "k_b": nominal.k_b,
            "gap": None,
            "probability": ranking.no_gap,
            "peaks": list(_rows(ranking)),
            "fit": _fit(nominal),
            "best_fit": _fit(ranking.scored[0]) if ranking.scored else None,
        },
        where=_where(nominal),
        causes=causes,
        equivalent=() if agrees else tuple(c for c in causes if c.probability > _RIVAL * causes[0].probability),
        next_test=None if agrees else _next_test(lists, ranking),
        audit=findings,
        excluded=tuple(exclude),
    )


def _fit(scored: Scored) -> dict[str, Any]:
    """How well a model matches the lists, in numbers."""
    return {
        "chi2": scored.chi2,
        "degrees_of_freedom": scored.freedom,
        "p_value": scored.p_value,
        "matched": scored.n_matched,
        "unmatched": scored.n_foreign,
        "not_listed": scored.n_unseen,
        "parameters": scored.n_parameters,
        "determined": scored.determined,
    }


def _rows(ranking: Ranking) -> Iterator[dict[str, Any]]:
    """Every listed peak beside the resonance of the nominal model and of the most probable candidate."""
    names = ("listed_Hz", "std_Hz", "nominal_Hz", "best_Hz")
    best = ranking.scored[0].matches if ranking.scored else ranking.nominal.matches
    for own, other in zip(ranking.nominal.matches, best, strict=True):
        peaks = own.peaks
        for row in zip(peaks.frequencies_hz, peaks.std_hz, own.model_hz, other.model_hz, strict=True):
            yield {"support": peaks.support, **dict(zip(names, row, strict=True))}


def _sentence(lists: Lists, ranking: Ranking, *, agrees: bool) -> str:
    """The verdict in a sentence."""
    nominal, n = ranking.nominal, lists.n_peaks
    if agrees:
        return f"The {n} listed resonances are the nominal model's within their errors: there is nothing to explain."
    if nominal.adequate and nominal.n_unseen == 0:
        return f"The nominal model meets the {n} listed resonances, but so do others: {n} numbers do not decide."
    fault = f"{nominal.n_foreign} of {n} listed resonances have no counterpart in the nominal model"
    if nominal.adequate:
        fault = f"the nominal model has {nominal.n_unseen} resonances in the tested range that nobody listed"
    elif not nominal.n_foreign:
        fault = f"the nominal model misses the {n} listed resonances (chi-squared {nominal.chi2:.3g})"
    if not ranking.scored:
        return f"{fault[0].upper()}{fault[1:]}; no effect of the library is left to explain it."
    return f"{fault[0].upper()}{fault[1:]}, even with its best k_b; {n} numbers cannot tell which effect is the cause."


def _next_test(lists: Lists, ranking: Ranking) -> NextTest:
    """Complete responses; across the force too, where a leading candidate moves the rotor across it."""
    leaders = [s for s, p in zip(ranking.scored, ranking.probabilities, strict=True) if p > 0.01] or ranking.scored[:1]
    across = any("plane_anisotropy" in s.hypothesis.ids for s in leaders)
    node = lists.rotor.node
    words = (
        f"Record complete frequency responses, with phase, on both supports, at three nodes or more, driven at {node}"
    )
    words += (
        ", and on bearings also across the force: bearings that differ in two directions move the rotor across it, "
        "nothing else in the list does."
        if across
        else ": shapes and widths tell apart what frequencies cannot."
    )
    return NextTest(words, {"support": "bearing", "excitation_node": node, "force_amplitude_N": 1.0})


def _where(nominal: Scored) -> Where:
    """Each support's and each listed peak's share of the misfit; one that matches nothing counts as 5 errors."""
    sizes: dict[str, float] = {"rigid": 0.0, "bearing": 0.0}
    bands: list[tuple[float, float, float]] = []
    for match in nominal.matches:
        for listed, std, z in zip(match.peaks.frequencies_hz, match.peaks.std_hz, match.residuals, strict=True):
            size = _UNMATCHED**2 if z is None else z**2
            sizes[match.peaks.support] = sizes.get(match.peaks.support, 0.0) + size
            bands.append((float(listed - 2 * std), float(listed + 2 * std), size))
    total = sum(sizes.values()) or 1.0
    return Where(
        bands=tuple(Band(lo, hi, None, size / total) for lo, hi, size in bands),
        supports={name: size / total for name, size in sizes.items()},
        remark="Resonance frequencies alone: no place can be told.",
    )


# Standard errors that a peak without a counterpart counts as, in the shares of the gap.
_UNMATCHED = 5.0
