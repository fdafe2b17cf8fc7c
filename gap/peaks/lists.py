"""A campaign of which only resonance frequencies survive: what a handful of numbers can and cannot tell.

A list of resonances is read off a curve by a person. A resonance that stands out of the curve is listed with
probability ``seen``, one that hardly stands out with less; a listed peak may also be foreign: of the exciter, the
frame, or a motion that no rotor model has. So the probability of a list under a model is the largest, over all ways
to match listed peaks with the model's resonances in order, of

    product over matches   p_j N(listed_i; f_j, std_i)
    product over resonances within the tested range that are not listed   1 - p_j
    product over listed peaks that match nothing   foreign peaks per list / tested range
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigtwin.gap.inference.hypotheses import Hypothesis, candidates
from rigtwin.gap.model.campaign_model import structure_of
from rigtwin.gap.peaks.resonances import Resonances, Rotor
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Campaign, Channel, PeakList, Run


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


class Lists:
    """Resonance lists of one rig, and how probable they are under a model."""

    def __init__(self, campaign: Campaign, reading: Reading | None = None):
        self.campaign, self.lists, self.reading = campaign, campaign.peaks, reading or Reading()
        self.structure = structure_of(campaign.rig, 1)  # a list of peaks is far coarser than any mesh
        rig = load_rig(campaign.rig)
        self._ln_k_b = np.log(rig.k_b.limit(*scale_of(self.structure).k_b))
        self.rotor = Rotor(self.structure, campaign.nominal, rig.excitation_node)
        self.with_k_b = any(peaks.support == "bearing" for peaks in self.lists)
        every = np.concatenate([peaks.frequencies_hz for peaks in self.lists])
        self.tested_hz = (float(every.min()) / 2, float(every.max()))

    def ends(self, hypothesis: Hypothesis) -> FloatArray:
        """(1 + n_free, 2) ranges of ln k_b, which suits the rig, and of a candidate's numbers."""
        return np.vstack([self._ln_k_b, hypothesis.ends[1:]])

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
        every = candidates([_stand_in(p) for p in self.lists], self.structure)
        return tuple(h for h in every if _moves_resonances(h))

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
            made.append(self._match_list(peaks, found))
        return tuple(made)

    def _match_list(self, peaks: PeakList, found: Resonances) -> Match:
        """The most probable matching of one list, read backwards from the end of its table."""
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


def _moves_resonances(hypothesis: Hypothesis) -> bool:
    effect = hypothesis.terms[0].effect
    return effect.family in ("structure", "support") and effect.moves_resonances


def _stand_in(peaks: PeakList) -> Run:
    """A run that says which support was measured."""
    f = peaks.frequencies_hz
    return Run(f, np.ones((len(f), 1), dtype=complex), (Channel(2),), peaks.support)
