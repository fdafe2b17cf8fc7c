"""How far the gap will shrink under another excitation, with an interval from the fit's own uncertainty.

Numbers are drawn from the posterior; each draw is a rig that the data allow. It is driven at a node that was not driven
in the campaign, without noise, gains and drift, and compared with the nominal and with the corrected model. So the
interval is one for transfer data, not for the lines next to those that were fitted. It contains the 90 % interval of
every such node, as nobody knows which one will be driven. What is left of the gap is stretched a little both ways,
because the posterior knows of no other elements or solver than those of the model.

A nonlinear cause is tried at the middle of the levels. Its corrected model is followed as a sweep, and the motions of
a drawn rig are those nearest to that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rigtwin.gap.curves import nrmse
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B
from rigtwin.gap.inference.posterior import posterior
from rigtwin.gap.inference.problem import Problem, middle_level
from rigtwin.gap.model.forward import acting, nonlinear
from rigtwin.gap.model.motions import FINE
from rigtwin.gap.model.run_model import RunModel
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class TransferTest:
    """How many rigs are drawn, and by how much their interval is widened.

    Without the stretch the interval covered 72 of 80 linear and 22 of 34 nonlinear causes of tuning campaigns, whose
    rigs are another implementation's; with it 75 and 31.
    """

    draws: int
    every: int  # of how many lines one is solved
    stretch: float  # factor by which more, or less, may be left of the gap


LINEAR = TransferTest(draws=60, every=1, stretch=1.05)
NONLINEAR = TransferTest(draws=40, every=2, stretch=1.75)  # as each is solved anew


def transfer_interval(problem: Problem, nominal: Fit, best: Fit, scale: float) -> tuple[float, float]:
    """90 % interval of 1 - after / before, free of noise, where another node is driven; nan where none can be.

    Parameters
    ----------
    problem : the runs, of which supports, channels and lines are taken
    nominal, best : the recalibrated nominal model and the corrected one
    scale : true over believed standard error
    """
    rng = np.random.default_rng(0)
    nodes, settings = _other_nodes(problem), LINEAR
    if not nodes:
        return (np.nan, np.nan)
    if nonlinear(best.effects):
        nodes, settings = nodes[len(nodes) // 2 :][:1], NONLINEAR
    try:
        tests = [_Test(problem, nominal, best, node) for node in nodes]
    except (ValueError, np.linalg.LinAlgError):  # of a nonlinear cause no line of the sweep may have a motion
        return (np.nan, np.nan)
    draws = _draws(problem, best, scale, rng, settings.draws)
    shrinks = [[test.shrink(u, nu) for u, nu in draws] for test in tests]
    known = [np.array(each)[np.isfinite(each)] for each in shrinks if np.isfinite(each).any()]
    if not known:
        return (np.nan, np.nan)
    low = min(float(np.quantile(each, 0.05)) for each in known)
    high = max(float(np.quantile(each, 0.95)) for each in known)
    return 1 - (1 - low) * settings.stretch, 1 - (1 - high) / settings.stretch


def _other_nodes(problem: Problem) -> list[int]:
    """Nodes that can be driven on every support and that no run drove."""
    driven = {run.excitation_node for run in problem.runs}
    return [node for node in problem.forward.structure.free_nodes if node not in driven]


def _draws(
    problem: Problem, best: Fit, scale: float, rng: np.random.Generator, count: int
) -> list[tuple[FloatArray, FloatArray]]:
    """Coordinates and nuisances from the posterior, the former within their ranges."""
    drawn = posterior(problem, best, scale).draws(rng, count)
    n = len(best.u)
    return [(best.hypothesis.clipped(each[:n]), each[n:]) for each in drawn]


@dataclass(frozen=True)
class _Part:
    """One run of the test with what both models say of it."""

    run: Run
    nominal: ComplexArray
    corrected: ComplexArray


class _Test:
    """The campaign's supports, driven at another node."""

    def __init__(self, problem: Problem, nominal: Fit, best: Fit, node: int):
        self._forward = problem.at_fit(best).forward.made(resolution=FINE)
        self._nuisances, self._best = problem.nuisances, best
        self._parts = []
        for r in middle_level(problem.runs):
            there = replace(problem.runs[r], excitation_node=node, harmonics={}, std=None)
            effects = acting(best.effects, there.support)
            if nonlinear(effects):
                there = self._follow(there, best)
                corrected = there.H
            else:
                self._forward.bend(there, best.k_b, effects)
                corrected = self._response(there, best.u, best.nu)
            corrected = corrected * problem.nuisances.sensor_gains(best.nu, there)
            plain = self._forward.modal(there, nominal.k_b).response()
            self._parts.append(_Part(there, plain, corrected))

    def _follow(self, run: Run, best: Fit) -> Run:
        """Some lines of a run with the corrected model's response, which says on which branch its motions are."""
        run = replace(run.on_lines(slice(None, None, NONLINEAR.every)), magnitude_only=False)
        there = acting(best.effects, run.support)
        modal = self._forward.made(with_data=False).modal(run, best.k_b, there).as_nonlinear
        assert modal is not None
        swept = modal.motions(None, best.nu[self._nuisances.tolerance])
        found = swept.converged
        run = replace(run, H=swept.H).on_lines(found)
        by_data = self._modal(run, best.u).as_nonlinear
        assert by_data is not None
        by_data.begin_with(swept.joints[found])
        return run

    def shrink(self, u: FloatArray, nu: FloatArray) -> float:
        """1 - after / before where these numbers are the truth; nan where they have no model."""
        try:
            truths = [self._response(part.run, u, nu) for part in self._parts]
        except (ValueError, np.linalg.LinAlgError):
            return float("nan")
        before = [nrmse(truth, part.nominal) for truth, part in zip(truths, self._parts, strict=True)]
        after = [nrmse(truth, part.corrected) for truth, part in zip(truths, self._parts, strict=True)]
        return 1 - float(np.mean(after)) / float(np.mean(before))

    def _modal(self, run: Run, u: FloatArray) -> RunModel:
        return self._forward.modal(run, K_B.value(u[0]), acting(self._best.hypothesis.effects(u[1:]), run.support))

    def _response(self, run: Run, u: FloatArray, nu: FloatArray) -> ComplexArray:
        """nan where there is no motion."""
        modal, tolerance = self._modal(run, u), nu[self._nuisances.tolerance]
        return np.where(modal.found(None, tolerance)[:, None], modal.response(None, tolerance), np.nan)
