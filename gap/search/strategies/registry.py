"""Which effects have a search strategy of their own. All others have the default of their kind.

Beside ``rotor/effects`` this folder is the only place that knows effects by name.
"""

from __future__ import annotations

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.race import RACE
from rigtwin.gap.search.starts import Promise, Start, gains_of
from rigtwin.gap.search.strategies.along_shaft import AlongShaft
from rigtwin.gap.search.strategies.dwell import dwell_fits
from rigtwin.gap.search.strategies.law import Clearance, Contact, LawStrategy, Microslip, Sliding, Uneven
from rigtwin.gap.search.strategies.strategy import Strategy
from rigtwin.gap.search.strategies.two_planes import TwoPlanes


class Dwells(Strategy):
    """A sweep that is too fast: its misfit has thousands of minima along the dwell."""

    def scan(self, problem: Problem, hypothesis: Hypothesis, nominal: Fit, quiet: bool) -> list[Promise]:
        """The best dwells; see ``dwell``."""
        fits = dwell_fits(problem, hypothesis, nominal, quiet)[: RACE.rivals]
        return gains_of(problem, [Start(hypothesis, fit.u, fit.nu) for fit in fits], nominal)


LINEAR: dict[str, Strategy] = {"plane_anisotropy": TwoPlanes(), "open_crack": AlongShaft(), "fast_sweep": Dwells()}
LAWS: dict[str, LawStrategy] = {
    "rub": Contact(),
    "bearing_clearance": Clearance(),
    "bearing_friction": Sliding(),
    "joint_microslip": Microslip(),
    "bilinear_support": Uneven(),
}


def strategy_of(hypothesis: Hypothesis) -> Strategy:
    """The strategy of a linear effect; several effects together have the default."""
    ids = hypothesis.ids
    return LINEAR.get(ids[0], Strategy()) if len(ids) == 1 else Strategy()


def law_strategy_of(hypothesis: Hypothesis) -> LawStrategy:
    """The strategy of a nonlinear effect."""
    return LAWS.get(hypothesis.ids[0], LawStrategy())
