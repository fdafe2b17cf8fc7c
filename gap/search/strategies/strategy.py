"""How the fits of a linear candidate begin, where the effect itself says nothing else."""

from __future__ import annotations

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.search.starts import Promise, Start, promises
from rigtwin.rotor.model.arrays import FloatArray


class Strategy:
    """The default: points over the ranges, and first-order steps next to the nominal model."""

    def points(self, u: FloatArray, hypothesis: Hypothesis) -> list[FloatArray]:
        """Points of rough descents, after the coordinates u that are known, ln k_b the first of them."""
        return [np.concatenate([u, start]) for start in hypothesis.starts()]

    def grid_starts(self, problem: Problem, hypothesis: Hypothesis, nominal: Fit, added: float) -> list[Start]:
        """Starts that only a grid of its own finds, far from the nominal model, with a relative error added."""
        return []

    def scan(self, problem: Problem, hypothesis: Hypothesis, nominal: Fit, quiet: bool) -> list[Promise]:
        """Starts by a grid where misfit has so many minima that neither descents nor first-order steps find the right
        one; best first, empty where they do. ``quiet``: whether the nominal model leaves what noise may leave."""
        return []

    def promise(self, problem: Problem, score: Score, hypothesis: Hypothesis) -> list[Promise]:
        """What the effect could take away from what the nominal model leaves, and where its fit begins; best first."""
        return promises(score, hypothesis)
