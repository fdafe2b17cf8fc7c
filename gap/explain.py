"""What explains the runs: linear effects, force laws where force levels differ, pairs where no single effect suffices.

The steps, each a function below:

1. search single linear effects, unless the levels plainly differ;
2. begin anew without errors that channels share, where they do not share what is left;
3. finish the linear answer (bent laws, several effects, the finer mesh) where levels do not differ in what it leaves;
4. else search force laws, and let the finished linear answer rival them on the same lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.gap.clock import Clock
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.harmonics import with_harmonics
from rigtwin.gap.inference.hypotheses import PRIORS, Hypothesis, candidates
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.forward import nonlinear
from rigtwin.gap.search.laws.beside import search_laws
from rigtwin.gap.search.laws.robust import robust_fit
from rigtwin.gap.search.laws.search import most_promised
from rigtwin.gap.search.linear import bend_best, bend_laws, search, search_from_afar
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.gap.search.pairs import best_effects, exchanged, most_left, pairs, pursued, straightened, without_one
from rigtwin.gap.search.race import RACE, Progress, Search, best_first, polish_leaders, reach
from rigtwin.gap.verdict.adequacy import judge, not_shared
from rigtwin.gap.verdict.standing import adequate, excess_of, scale_of
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.shared_work import seconds_left, seconds_to_work
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class SeveralEffects:
    """How effects that act together are looked for."""

    taken_apart: int = 3  # pairs whose effects are tried alone
    most: int = 4  # effects that act together


_SEVERAL = SeveralEffects()

# Seconds in which the leading fits are made exact where the time of the search is up.
_CLOSING = 30.0


@dataclass(frozen=True)
class Library:
    """Candidates."""

    linear: Sequence[Hypothesis]
    laws: Sequence[Hypothesis]  # nonlinear ones


@dataclass(frozen=True)
class Task:
    """What is to be explained, and with what."""

    problem: Problem
    nominal: Fit
    library: Library
    levels_differ: bool  # whether the runs themselves show that force levels differ
    progress: Progress | None
    clock: Clock

    def on(self, problem: Problem) -> Task:
        """The same task on another problem."""
        return replace(self, problem=problem, nominal=recalibrate(problem))


@dataclass(frozen=True)
class Explained:
    """Fits, best first, with the problem that they belong to and its nominal model."""

    problem: Problem
    nominal: Fit
    fits: Sequence[Fit]
    enough: bool = True  # whether there are data to conclude from


def library_of(problem: Problem, exclude: Sequence[str]) -> Library:
    """All effects are equally probable before the data; laws are candidates where a support has several levels."""
    linear = candidates(problem.runs, problem.forward.structure, exclude)
    laws = candidates(problem.runs, problem.forward.structure, exclude, nonlinear=True)
    laws = laws if _at_several_levels(problem.runs) else ()
    share = len({h.ids for h in linear}) / max(len({h.ids for h in (*linear, *laws)}), 1)
    return Library(
        [replace(h, prior=share * h.prior) for h in linear], [replace(h, prior=(1 - share) * h.prior) for h in laws]
    )


def explain(task: Task) -> Explained:
    """Fit what may explain the runs, beginning anew where the problem turns out to be badly posed; of hardly any data
    the nominal model alone."""
    if task.nominal.n_data < THRESHOLDS.least_data:
        return Explained(task.problem, task.nominal, [task.nominal], enough=False)
    outcome: Task | Explained = task
    while isinstance(outcome, Task):
        outcome = _attempt(outcome)
    return _heard(outcome)


def _heard(found: Explained) -> Explained:
    """The same where measured harmonics count, too, if they can be a law's."""
    measured = any(run.harmonics for run in found.problem.runs)
    if not (measured and any(nonlinear(fit.effects) for fit in found.fits)):
        return found
    nominal, *fits = (with_harmonics(found.problem, fit) for fit in (found.nominal, *found.fits))
    return replace(found, nominal=nominal, fits=best_first(fits))


def _attempt(task: Task) -> Task | Explained:
    """The explanation, or the same task on a better posed problem."""
    laws = _laws_not_ruled_out(task.problem, task.library.laws)
    found = None if task.levels_differ and laws else _search_singles(task)
    if found:
        if better := _better_posed(task.problem, found.best):
            return task.on(better)
        if not (laws and _levels_differ_beside(task.problem, found.best, laws)):
            problem, fits = _finish(task, found)
            return Explained(problem, task.nominal, fits)
    enough = THRESHOLDS.adequate_nonlinear
    coarser, linear, bent = search_laws(task.problem, laws, task.library.linear, enough, task.progress)
    task.clock.lap("nonlinear effects")
    return _rival(task, found, Explained(coarser, linear, bent.fits), bent)


def _search_singles(task: Task) -> Search:
    found = search(task.problem, task.library.linear, task.nominal, task.progress)
    task.clock.lap("single effects")
    return found


def _better_posed(problem: Problem, best: Fit) -> Problem | None:
    """Without errors that channels share, where these do not share what the best fit leaves."""
    return None if adequate(problem, best) else not_shared(problem, best)


def _rival(task: Task, found: Search | None, by_law: Explained, bent: Search) -> Explained:
    """Laws and linear effects on the same lines, unless laws alone suffice where the nominal model is far off."""
    problem = task.problem
    suffices = bool(bent.fits) and adequate(by_law.problem, bent.best)
    rivalled = found is not None and bool(found.fits) and adequate(problem, found.best)
    if suffices and not rivalled and bent.nominal.chi2 > THRESHOLDS.plainly_nonlinear * bent.nominal.n_data:
        return by_law
    with_pairs = not (task.levels_differ or suffices)
    problem, straight = _finish(task, found or _search_singles(task), with_pairs=with_pairs)
    rivals = [fit for fit in (_on_lines_of(by_law.problem, fit) for fit in straight[: RACE.polished]) if fit]
    best = max((fit.log_weight for fit in rivals), default=-np.inf)
    task.clock.lap("linear rivals")
    if not bent.fits or best > bent.fits[0].log_weight:
        return Explained(problem, task.nominal, straight)
    return replace(by_law, fits=best_first([*bent.fits, *rivals]))


def _on_lines_of(problem: Problem, fit: Fit) -> Fit | None:
    """A linear fit, on the lines and with the loss of the nonlinear ones."""
    return robust_fit(problem.around(fit), fit.hypothesis, fit.u, fit.nu)


# -- do force levels differ? -------------------------------------------------------------------------------


def _at_several_levels(runs: Sequence[Run]) -> list[int]:
    """Runs on supports that were measured at more than one level."""
    levels: dict[str, set[float]] = {}
    for run in runs:
        levels.setdefault(run.support, set()).update(run.levels)
    return [r for r, run in enumerate(runs) if len(levels.get(run.support, ())) > 1]


def _laws_not_ruled_out(problem: Problem, laws: Sequence[Hypothesis]) -> Sequence[Hypothesis]:
    """Without the laws of the bearings where runs on rigid supports, in which they do not act, show a plain gap."""
    rigid = problem.only("rigid")
    if not laws or rigid is None or judge(rigid, recalibrate(rigid)).misfit < THRESHOLDS.plain_gap:
        return laws
    return [law for law in laws if law.terms[0].effect.location != "bearings"]


def _levels_differ_beside(problem: Problem, fit: Fit, laws: Sequence[Hypothesis]) -> bool:
    """Whether levels differ in what a linear fit leaves.

    Misfit goes where each level may have resonances of its own, or, in a smaller gap, where a law moves them.
    """
    quality = judge(problem, fit)
    gain, numbers = Score(problem, fit, settled=True).apart(_at_several_levels(problem.runs))
    gain /= scale_of(quality) ** 2
    if gain > numbers + THRESHOLDS.level_sigmas * np.sqrt(2 * numbers) or excess_of(problem, fit, quality) >= 1:
        return True
    return most_promised(problem, fit, laws) > 2 * PRIORS.pair_log_odds * scale_of(quality) ** 2


# -- the linear answer -------------------------------------------------------------------------------------


def _finish(task: Task, found: Search, *, with_pairs: bool = True) -> tuple[Problem, list[Fit]]:
    """The problem on the finer mesh; linear effects, best first, and pairs where no single one is adequate."""
    problem = task.problem
    found, alone = _bend_where_it_helps(task, found)
    fits = list(found.fits) or [found.nominal]
    if with_pairs and not alone:
        fits = _add_pairs(task, found)
        task.clock.lap("pairs")
    finer = problem.made(refined=True)
    with seconds_to_work(max(seconds_left(), _CLOSING)):
        return finer, polish_leaders(finer, fits, reach(fits[0])) or fits


def _bend_where_it_helps(task: Task, found: Search) -> tuple[Search, bool]:
    """The search, with its best effect bent where it does not suffice; whether nothing is left for a second one."""
    problem, hypotheses = task.problem, task.library.linear
    if not found.fits:
        return found, True
    if not adequate(problem, found.best):
        found = bend_laws(problem, search_from_afar(problem, found, hypotheses, task.progress), hypotheses)
    elif _suffices(problem, found.best, hypotheses):
        return found, True
    else:  # what a second effect would take away may be its own law's
        found = bend_best(problem, found)
    return found, _suffices(problem, found.best, hypotheses)


def _suffices(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis]) -> bool:
    """Whether a single effect leaves noise, of which no second one takes away much."""
    quality = judge(problem, fit)
    if excess_of(problem, fit, quality) >= 1:
        return False
    return most_left(problem, fit, hypotheses) < 2 * PRIORS.pair_log_odds * scale_of(quality) ** 2


def _add_pairs(task: Task, found: Search) -> list[Fit]:
    """Singles and several effects, best first; each further effect counts only where it earns its evidence.

    What was found first may stand in for what is there: where that does not suffice, or takes many effects, each is
    exchanged for others.
    """
    problem, hypotheses = task.problem, task.library.linear
    answer = _grown(task, found, pursued(problem, best_effects(problem, found), hypotheses, task.progress))
    if not adequate(problem, answer[0]):
        answer = best_first([*answer, *_grown(task, found, pairs(problem, found, hypotheses, task.progress))])
    several = next((fit for fit in answer if len(fit.hypothesis.terms) > 1), None)
    if several and (len(several.hypothesis.terms) > 2 or not adequate(problem, answer[0])):
        others = exchanged(problem, several, hypotheses, not found.rough, task.progress)
        if others and others[0].log_weight > several.log_weight:
            answer = best_first([*answer, *_grown(task, found, others)])
    return answer


def _grown(task: Task, found: Search, several: Sequence[Fit]) -> list[Fit]:
    """Several effects that earn their evidence, best first, with fewer ones and with more beside the best."""
    problem, hypotheses = task.problem, task.library.linear
    best = several[: _SEVERAL.taken_apart]
    several = best_first([*several, *(fit for each in best for fit in straightened(problem, each))])
    apart = [fit for each in several[: _SEVERAL.taken_apart] for fit in without_one(problem, each, hypotheses)]
    fewer = {fit.hypothesis: fit for fit in sorted((*found.fits, *apart), key=lambda fit: fit.log_weight)}
    scale = scale_of(judge(problem, max([*fewer.values(), *several], key=lambda fit: fit.log_weight)))
    rival = max(fewer.values(), key=lambda fit: fit.log_evidence(scale))
    needed = rival.log_evidence(scale) + PRIORS.pair_log_odds
    bend = _gain_of_another_form(problem, found.nominal, rival, scale)
    earned = [fit for fit in several if fit.log_evidence(scale) > needed + (bend if _at_one_joint(fit) else 0.0)]
    return best_first([*fewer.values(), *earned, *_more(task, earned[:1], scale)])


def _more(task: Task, leaders: Sequence[Fit], scale: float) -> list[Fit]:
    """The best several effects, with one more as long as it earns its evidence, and without what is not needed then."""
    problem, hypotheses = task.problem, task.library.linear
    found: list[Fit] = []
    while leaders and len(leaders[0].hypothesis.terms) < _SEVERAL.most:
        leader = leaders[0]
        if most_left(problem, leader, hypotheses) < 2 * PRIORS.pair_log_odds * scale**2:
            break
        needed = leader.log_evidence(scale) + PRIORS.pair_log_odds
        more = pursued(problem, [leader], hypotheses, task.progress)
        leaders = [fit for fit in more if fit.log_evidence(scale) > needed]
        if leaders and (enough := _needed(problem, leaders[0], hypotheses, scale)) is not leaders[0]:
            leaders = [enough]
        found += leaders
    return found


def _needed(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis], scale: float) -> Fit:
    """Several effects without those that do not earn their evidence beside the others."""
    while len(fit.hypothesis.terms) > 1:
        fewer = without_one(problem, fit, hypotheses)
        if not fewer or fewer[0].log_evidence(scale) < fit.log_evidence(scale) - PRIORS.pair_log_odds:
            break
        fit = fewer[0]
    return fit


def _gain_of_another_form(problem: Problem, nominal: Fit, best: Fit, scale: float) -> float:
    """Evidence that another form of the best effect's law could take away besides."""
    return THRESHOLDS.bent_share * (nominal.chi2 - best.chi2) / (2 * scale**2) if adequate(problem, best) else 0.0


def _at_one_joint(fit: Fit) -> bool:
    """Whether all its effects act at the bearings: a second one bends the law of the first."""
    return all(effect.location == "bearings" for effect in fit.effects)
