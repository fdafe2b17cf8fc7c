"""A force law beside linear effects: found one after the other, fitted together, each earning its evidence.

The lowest level is the nearest to a linear rotor. A linear effect that its runs show is found there first, and laws are
looked for on the rotor that has it. Beside a law that is fitted, the score test says what else could act: at the
motions that were found, the law is a linear element whose force follows the motion to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, PRIORS, Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.motions import MIDDLE
from rigtwin.gap.search.laws.robust import robust_fit, robust_fits, without_outliers
from rigtwin.gap.search.laws.search import at_level, is_adequate, search_nonlinear
from rigtwin.gap.search.linear import search
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.gap.search.pairs import one_fewer, paired, promised_beside
from rigtwin.gap.search.race import Progress, Search, best_first, first_of_each, in_turns
from rigtwin.gap.search.starts import Promise, Start
from rigtwin.rotor.effects import Effect


@dataclass(frozen=True)
class BesideLaw:
    """How effects beside a law are narrowed down."""

    leaders: int = 2  # laws that linear effects are tried beside, the best
    most: int = 4  # effects that act together
    tried: int = 8  # further effects that are fitted with few harmonics, those that promise most to first order,
    finalists: int = 2  # and with all of them


BESIDE = BesideLaw()


def search_laws(
    problem: Problem,
    laws: Sequence[Hypothesis],
    effects: Sequence[Hypothesis],
    adequate: float,
    progress: Progress | None = None,
) -> tuple[Problem, Fit, Search]:
    """Laws alone and beside linear effects that earn their evidence; otherwise as ``search_nonlinear``."""
    effects = [effect for effect in effects if _can_stand_beside(effect.terms[0].effect)]
    rest = _shown_at_rest(problem, effects) if laws else None
    if rest is None:
        every, linear, found = search_nonlinear(problem, laws, adequate, progress)
        fits = list(found.fits)
    else:
        every, linear, fits = _on_rotor_with(rest, problem, laws, adequate, progress)
        found = Search(linear, ())
        if not (fits and is_adequate(fits[0], adequate)):
            _, _, alone = search_nonlinear(problem, laws, adequate, progress)
            fits += robust_fits(every, alone.fits)
    candidates, leaders = [*laws, *effects], first_of_each(best_first(fits), lambda fit: fit.hypothesis.ids)
    several = [more for leader in leaders[: BESIDE.leaders] for more in _grown(every, leader, candidates)]
    kept = (fit for fit in [*fits, *several] if fit.log_evidence() > linear.log_evidence())
    return every, linear, replace(found, fits=tuple(best_first(kept)))


def _can_stand_beside(effect: type[Effect]) -> bool:
    """Whether a rotor under a law can have the effect: it changes the rotor, or what a channel reports."""
    force, sweep = (getattr(effect, name) is getattr(Effect, name) for name in ("force_factor", "sweep_changes"))
    return force and sweep and not effect.rides_on_sensor


# -- linear effects first ----------------------------------------------------------------------------------


def _shown_at_rest(problem: Problem, effects: Sequence[Hypothesis]) -> Fit | None:
    """The linear effect that the runs of the lowest level show; None where they show none."""
    low = at_level(problem, min)
    calm = recalibrate(low)
    if not promises_much(low, calm, effects):
        return None
    best = search(low, effects, calm).best
    return best if best.log_evidence() > calm.log_evidence() + PRIORS.pair_log_odds else None


def _on_rotor_with(
    rest: Fit, problem: Problem, laws: Sequence[Hypothesis], adequate: float, progress: Progress | None
) -> tuple[Problem, Fit, list[Fit]]:
    """Laws on the rotor that has a linear effect, then fitted with it; best first, without what is not needed.

    Returns
    -------
    the problem, the linear rotor without any effect and the fits, as in ``search_nonlinear``
    """
    there, _, found = search_nonlinear(problem.on_rotor_with(rest.effects), laws, adequate, progress)
    every = there.on_rotor_with(())
    nominal = every.fit(NOMINAL, rest.u[:1])
    linear = robust_fit(every, NOMINAL, nominal.u, nominal.nu) or nominal
    fits = best_first(robust_fits(every, [_joined(law, rest) for law in found.fits]))
    return every, linear, [_needed(every, fit, [*laws, rest.hypothesis]) for fit in fits[:1]] + fits[1:]


def _joined(law: Fit, rest: Fit) -> Start:
    """A law with the linear effect that its rotor has."""
    return Start(paired(law.hypothesis, rest.hypothesis), np.append(law.u, rest.u[1:]), law.nu)


# -- laws first --------------------------------------------------------------------------------------------


def _grown(problem: Problem, leader: Fit, candidates: Sequence[Hypothesis]) -> list[Fit]:
    """A fit with one more linear effect after the other, as long as each earns its evidence."""
    found: list[Fit] = []
    for _ in range(BESIDE.most - len(leader.hypothesis.terms)):
        further = _extended(problem, leader, candidates)
        scale = _scale([leader, *further])
        needed = leader.log_evidence(scale) + PRIORS.pair_log_odds
        if not (further and further[0].log_evidence(scale) > needed):
            break
        leader = _needed(problem, further[0], candidates)
        found.append(leader)
    return found


def _extended(problem: Problem, leader: Fit, candidates: Sequence[Hypothesis]) -> list[Fit]:
    """A fit with one more linear effect, those that promise much; best first by evidence and prior."""
    promised = promises_much(problem, leader, candidates)
    some = in_turns(promised, lambda promise: promise.start.hypothesis.ids)[: BESIDE.tried]
    few = robust_fits(problem.made(resolution=MIDDLE), [promise.start for promise in some], rounds=1)
    few = first_of_each(sorted(few, key=lambda fit: fit.cost), lambda fit: fit.hypothesis.rotor)
    return best_first(robust_fits(problem, few[: BESIDE.finalists]))


def promises_much(problem: Problem, fit: Fit, candidates: Sequence[Hypothesis]) -> list[Promise]:
    """What linear effects could take away beside a fit, to first order, where that may be enough; best first."""
    linear = [c for c in candidates if c.terms[0].effect.family != "nonlinear"]
    score = Score(without_outliers(problem, fit), fit, settled=True)
    least = 2 * PRIORS.pair_log_odds * _scale([fit]) ** 2
    return [promise for promise in promised_beside(score, linear) if promise.gain > least]


def _needed(problem: Problem, several: Fit, candidates: Sequence[Hypothesis]) -> Fit:
    """Several effects without those that do not earn their evidence beside the others."""
    while len(several.hypothesis.terms) > 1:
        fewer = robust_fits(problem, one_fewer(several, candidates))
        scale = _scale([several, *fewer])
        best = max(fewer, key=lambda fit: fit.log_evidence(scale), default=None)
        if best is None or best.log_evidence(scale) < several.log_evidence(scale) - PRIORS.pair_log_odds:
            break
        several = best
    return several


def _scale(fits: Sequence[Fit]) -> float:
    """True over believed standard error: what even the best of these leaves counts as noise."""
    return max(min(fit.chi2 / fit.n_data for fit in fits), 1.0) ** 0.5
