"""Bearings with two principal stiffnesses: the other plane's resonances are a few half-power widths wide."""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from scipy.signal import find_peaks

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.race import RACE
from rigtwin.gap.search.starts import Start
from rigtwin.gap.search.strategies.strategy import Strategy
from rigtwin.rotor.model.arrays import FloatArray


@dataclass(frozen=True)
class AnisotropyGrid:
    """Points over anisotropy and angle."""

    angles: tuple[float, ...] = (0.08, 0.2, 0.4, 0.65)  # rad, from the force's direction, and from across it
    anisotropies: int = 60  # fine enough for a resonance that is two per mille wide
    smallest: float = 0.01
    valleys: int = 12  # that are descended into,
    steps: int = 8  # in so many steps each


GRID = AnisotropyGrid()


class TwoPlanes(Strategy):
    """Either stiffness may be the nominal model's, and the other plane's narrow resonances are looked for on a grid."""

    def points(self, u: FloatArray, hypothesis: Hypothesis) -> list[FloatArray]:
        """The mean stiffness that goes with a start makes either of the two stiffnesses the nominal model's k_b."""
        place = [free.name for free in hypothesis.free].index("anisotropy")
        return [
            np.concatenate([[u[0] - np.log1p(sign * start[place] / 2)], u[1:], start])
            for start in hypothesis.starts()
            for sign in (-1, 1)
        ]

    def grid_starts(self, problem: Problem, hypothesis: Hypothesis, nominal: Fit, added: float) -> list[Start]:
        """Where bearings put a narrow resonance of the other plane: no descent meets it from a width away.

        The stiffness along the force is the nominal model's, the one across it anything. The nominal model strains its
        k_b and its nuisances for a resonance that it does not have: the other nuisances begin at nothing, and the best
        valleys of the grid are descended into with all numbers free. There are none with accelerometers across the
        force (angles of both signs), which show that plane openly, and where no point beats the nominal model.
        """
        free = {number.name: number for number in hypothesis.free}
        if free["angle"].low < 0:
            return []
        unstrained = problem.unit(NOMINAL, nominal.u)
        limit = problem.cost(NOMINAL, nominal.u[:1], unstrained, added)
        valleys: list[tuple[float, FloatArray]] = []
        for angle in (*GRID.angles, *(np.pi / 2 - np.array(GRID.angles))):
            line = [
                np.array([nominal.u[0] - np.log1p(anisotropy / 2 * np.cos(2 * angle)), anisotropy, angle])
                for anisotropy in np.linspace(GRID.smallest, free["anisotropy"].high, GRID.anisotropies)
            ]
            costs = np.array([np.inf, *(problem.cost(hypothesis, u, unstrained, added) for u in line), np.inf])
            valleys += [(float(costs[k]), line[k - 1]) for k in find_peaks(-costs)[0] if costs[k] < limit]
        valleys.sort(key=itemgetter(0))
        best = [u for _, u in valleys[: GRID.valleys]]
        fits = [problem.try_fit(hypothesis, u, unstrained, anneal=(added,), steps=GRID.steps) for u in best]
        found = sorted(filter(None, fits), key=lambda fit: fit.cost)
        return [Start(hypothesis, fit.u, fit.nu) for fit in found[: RACE.rivals]]
