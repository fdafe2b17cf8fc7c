"""An effect that may be anywhere along the shaft."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.search.race import RACE
from rigtwin.gap.search.starts import Promise, Start, along_the_shaft, gains_of
from rigtwin.gap.search.strategies.strategy import Strategy


@dataclass(frozen=True)
class ShortFits:
    """Fits from several positions."""

    positions: int = 10
    strength: float = 0.7  # share of its range
    steps: int = 8  # of each fit
    every: int = 3  # lines


SHORT = ShortFits()


class AlongShaft(Strategy):
    """Short fits of a plain effect from several positions.

    From next to another minimum a crack slides to the end of its range, and to first order it may seem to act the
    other way where it is.
    """

    def promise(self, problem: Problem, score: Score, hypothesis: Hypothesis) -> list[Promise]:
        """Where the best of the short fits end."""
        fit, few = score.fit, problem.thinned(SHORT.every)
        points = along_the_shaft(hypothesis.terms[0], SHORT.positions, SHORT.strength)
        starts = [np.append(fit.u[:1], point) for point in points]
        fits = [few.try_fit(hypothesis, u, fit.nu, anneal=(0.0,), steps=SHORT.steps) for u in starts]
        made = sorted((each for each in fits if each), key=lambda each: each.cost)
        found = [Start(hypothesis, each.u, each.nu) for each in made[: RACE.rivals]]
        return gains_of(problem, found, fit)
