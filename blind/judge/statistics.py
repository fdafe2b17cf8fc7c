"""Rates with their intervals, calibration, and how well a score separates two groups."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Z_95 = 1.959964


@dataclass(frozen=True)
class Rate:
    """A share with its Wilson 95 % interval (E. B. Wilson, JASA 22, 1927)."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        return self.hits / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        if not self.of:
            return (0.0, 1.0)
        n, p, z = self.of, self.value, Z_95
        middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
        half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return (max(0.0, middle - half), min(1.0, middle + half))

    def __str__(self) -> str:
        if not self.of:
            return "none"
        low, high = self.interval
        return f"{100 * self.value:.1f} % ({100 * low:.0f}–{100 * high:.0f}), {self.hits} of {self.of}"


def rate(hits: Sequence[bool]) -> Rate:
    return Rate(sum(map(bool, hits)), len(hits))


def auroc(positive: Sequence[float], negative: Sequence[float]) -> float:
    """Probability that a positive scores higher than a negative; ties count half."""
    if not positive or not negative:
        return math.nan
    a, b = np.asarray(positive)[:, None], np.asarray(negative)[None, :]
    return float(np.mean((a > b) + 0.5 * (a == b)))


def brier(probabilities: Sequence[float], hits: Sequence[bool]) -> float:
    """Mean square of the top answer's probability less whether it was right."""
    return float(np.mean((np.asarray(probabilities) - np.asarray(hits, float)) ** 2)) if len(hits) else math.nan


def calibration_error(probabilities: Sequence[float], hits: Sequence[bool], bins: int = 10) -> float:
    """Expected calibration error: |hit rate - mean probability| over equal bins, weighted by their counts."""
    if not len(hits):
        return math.nan
    p, h = np.asarray(probabilities), np.asarray(hits, float)
    which = np.minimum((p * bins).astype(int), bins - 1)
    return float(sum(abs(h[which == b].mean() - p[which == b].mean()) * np.mean(which == b) for b in set(which)))


def median(values: Sequence[float]) -> float:
    return float(np.median(values)) if len(values) else math.nan
