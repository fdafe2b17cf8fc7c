"""A measured campaign in, a diagnosis out: audit, recalibrate, where, which, how far, what next."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from rigtwin.gap.answer.held_out import Confirm
from rigtwin.gap.answer.report import Answer, Clock, Outcome, report
from rigtwin.gap.audit.checked_run import checked_runs
from rigtwin.gap.audit.findings import amplitude_dependent, audit, usable
from rigtwin.gap.audit.wild import blank_lines, left_out_finding
from rigtwin.gap.document import Finding
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import Hypothesis, candidates
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.forward import nonlinear
from rigtwin.gap.peaks.diagnosis import diagnose_peaks
from rigtwin.gap.prepare import prepared
from rigtwin.gap.search.laws.robust import robust_fit
from rigtwin.gap.search.laws.search import most_promised, search_nonlinear
from rigtwin.gap.search.linear import (
    POLISHED,
    Progress,
    Search,
    all_polished,
    bent_little,
    best_first,
    from_afar_too,
    matched,
    recalibrate,
    search,
    with_bent,
)
from rigtwin.gap.search.pairs import PAIR_GAIN, each_alone, exchanged, most_left, pairs, straightened
from rigtwin.gap.search.workers import helped_by
from rigtwin.gap.verdict.adequacy import judge, not_shared, odd_lines
from rigtwin.gap.verdict.ranking import of_the_likeliest, rank, verdict_of
from rigtwin.gap.verdict.standing import adequate, excess_of, gains_differ, scale_of, standing_of
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.sim.campaign import Campaign, Run

# Thresholds. They are set on the tuning campaigns of the blind benchmark, never on its report campaigns.
LEVEL_SIGMAS = 2.0  # standard deviations by which resonances of each level's own may take away more than chance
PLAIN_GAP = 3.0  # mean square residual of rigid runs over the noise's that no law of the bearings leaves
BENT_SHARE = 3e-4  # of what a law of the bearings takes away, that another form of it could take away besides
LEAST_DATA = 20  # real numbers; of fewer nothing is concluded

# Pairs whose effects are tried alone.
_TAKEN_APART = 3

# Mean square misfit of the nominal model from which levels that differ are not asked for a linear cause.
_PLAIN = 20.0


@threadpool_limits.wrap(limits=1)  # the matrices are small: several threads make it five times slower
def diagnose(
    campaign: Campaign,
    exclude: Sequence[str] = (),
    progress: Progress | None = None,
    confirm: Confirm | None = None,
    helpers: Executor | None = None,
) -> Outcome:
    """Say where the gap between the campaign and its model lies, what causes it, and how far it shrinks.

    Parameters
    ----------
    campaign : measured or simulated
    exclude : ids of effects that are withheld from the library
    progress : called with (done, total, words)
    confirm : measures the corrected rotor on the virtual rig, for the after-figure; None: the model's figure stands
    helpers : workers that fits are shared with, one thread each; the answer is the same without

    Raises
    ------
    ValueError : an excluded effect does not exist
    MeasurementError : a run has a node that the rig lacks
    """
    if unknown := sorted(set(exclude) - set(EFFECTS)):
        raise ValueError(f"exclude: no effect {', '.join(unknown)}; see rigtwin effects")
    clock = Clock()
    findings = audit(campaign)
    clock.lap("audit")
    if not campaign.runs:
        return Outcome(diagnose_peaks(campaign, exclude, findings), ())
    campaign = usable(campaign)
    campaign, problem, nominal, odd = _without_odd_lines(campaign, *prepared(campaign))
    findings += odd
    clock.lap("recalibration")
    library = _library(problem, exclude)
    whole, enough = problem, nominal.n_data >= LEAST_DATA
    fits = [nominal]
    if enough:
        with helped_by(helpers):
            problem, nominal, fits = _explained(
                problem, nominal, library, amplitude_dependent(findings), progress, clock
            )
    standing = standing_of(problem, nominal, fits)
    clock.lap("form")
    ranked = rank(problem, nominal, standing)
    standing = of_the_likeliest(problem, nominal, ranked, standing)
    verdict = verdict_of(ranked, standing) if enough else "not_enough_data"
    robust = any(nonlinear(fit.effects) for fit in fits)  # and so is the nominal model
    said = nominal if robust else matched(problem, nominal, scale_of(standing.quality))
    answer = Answer(whole, problem, nominal, said, ranked, standing, verdict)
    return report(campaign, answer, findings, exclude, confirm, clock)


def _without_odd_lines(
    campaign: Campaign, problem: Problem, nominal: Fit
) -> tuple[Campaign, Problem, Fit, tuple[Finding, ...]]:
    """Leave out single lines that alone keep the nominal model from explaining the runs, and say which."""
    unchanged = campaign, problem, nominal, ()
    odd = [] if adequate(problem, nominal) else odd_lines(problem, nominal)
    if not any(lines.any() for lines in odd):
        return unchanged
    left = replace(campaign, runs=tuple(map(blank_lines, campaign.runs, odd)))
    problem_left, nominal_left = prepared(left)
    if not adequate(problem_left, nominal_left):
        return unchanged
    why = "Only here, far from any resonance, the nominal model misses what was measured, as where a mains hum is read"
    named = [(p, p.run.frequency_hz[lines]) for p, lines in zip(checked_runs(campaign.runs), odd, strict=True)]
    return left, problem_left, nominal_left, tuple(left_out_finding(p, f, why) for p, f in named if len(f))


@dataclass(frozen=True)
class _Library:
    """Candidates."""

    linear: Sequence[Hypothesis]
    laws: Sequence[Hypothesis]  # nonlinear ones


def _library(problem: Problem, exclude: Sequence[str]) -> _Library:
    """All effects are equally probable before the data; laws are candidates where a support has several levels."""
    linear = candidates(problem.runs, problem.forward.structure, exclude)
    laws = candidates(problem.runs, problem.forward.structure, exclude, nonlinear=True)
    laws = laws if _at_several_levels(problem.runs) else ()
    share = len({h.ids for h in linear}) / max(len({h.ids for h in (*linear, *laws)}), 1)
    return _Library(
        [replace(h, prior=share * h.prior) for h in linear], [replace(h, prior=(1 - share) * h.prior) for h in laws]
    )


def _at_several_levels(runs: Sequence[Run]) -> list[int]:
    """Runs on supports that were measured at more than one level."""
    levels: dict[str, set[float]] = {}
    for run in runs:
        if run.force_amplitude_N is not None:
            levels.setdefault(run.support, set()).add(run.force_amplitude_N)
    return [r for r, run in enumerate(runs) if len(levels.get(run.support, ())) > 1]


def _explained(
    problem: Problem, nominal: Fit, library: _Library, dependent: bool, progress: Progress | None, clock: Clock
) -> tuple[Problem, Fit, list[Fit]]:
    """Fit what may explain the runs: nonlinear effects only where levels differ, linear ones unless those suffice.

    It begins anew with gains of each sensor in each run where the best fit shows that these differ, and without errors
    that channels share where they do not share what it leaves.

    Parameters
    ----------
    dependent : whether the runs themselves show that levels differ

    Returns
    -------
    the problem the best fits belong to, its nominal model, and all fits, best first
    """

    def singles() -> Search:
        made = search(problem, library.linear, nominal, progress)
        clock.lap("single effects")
        return made

    def anew(other: Problem) -> tuple[Problem, Fit, list[Fit]]:
        return _explained(other, recalibrate(other), library, dependent, progress, clock)

    laws = _not_ruled_out(problem, library.laws)
    found = None if dependent and laws else singles()
    if found and not adequate(problem, found.best) and (apart := not_shared(problem, found.best)):
        return anew(apart)
    if found and gains_differ(problem, found.best):
        return anew(problem.remounted())
    if found and not (laws and _differ_by_level(problem, found.best, laws)):
        problem, fits = _finished(problem, found, library.linear, progress, clock)
        return problem, nominal, fits
    coarser, linear, bent = search_nonlinear(problem, laws, progress)
    clock.lap("nonlinear effects")
    if gains_differ(coarser, bent.best):
        return anew(problem.remounted())
    suffices = bool(bent.fits) and adequate(coarser, bent.best)
    rivalled = found is not None and bool(found.fits) and adequate(problem, found.best)
    if suffices and not rivalled and bent.nominal.chi2 > _PLAIN * bent.nominal.n_data:
        return coarser, linear, list(bent.fits)
    with_pairs = not (dependent or suffices)
    problem, straight = _finished(problem, found or singles(), library.linear, progress, clock, with_pairs=with_pairs)
    rivals = [fit for fit in (_on_lines_of(coarser, fit) for fit in straight[:POLISHED]) if fit]
    best = max((fit.log_weight for fit in rivals), default=-np.inf)
    clock.lap("linear rivals")
    if not bent.fits or best > bent.fits[0].log_weight:
        return problem, nominal, straight
    return coarser, linear, best_first([*bent.fits, *rivals])


def _on_lines_of(problem: Problem, fit: Fit) -> Fit | None:
    """A linear fit, on the lines and with the loss of the nonlinear ones."""
    problem.bend(fit)
    return robust_fit(problem, fit.hypothesis, fit.u, fit.nu)


def _not_ruled_out(problem: Problem, laws: Sequence[Hypothesis]) -> Sequence[Hypothesis]:
    """Without the laws of the bearings where runs on rigid supports, in which they do not act, show a plain gap."""
    rigid = problem.only("rigid")
    if not laws or rigid is None or judge(rigid, recalibrate(rigid)).misfit < PLAIN_GAP:
        return laws
    return [law for law in laws if law.terms[0].effect.location != "bearings"]


def _differ_by_level(problem: Problem, fit: Fit, laws: Sequence[Hypothesis]) -> bool:
    """Whether levels differ in what a linear fit leaves.

    Misfit goes where each level may have resonances of its own, or, in a smaller gap, where a law moves them.
    """
    runs = _at_several_levels(problem.runs)
    quality = judge(problem, fit)
    gain, numbers = Score(problem, fit, settled=True).apart(runs)
    gain /= scale_of(quality) ** 2
    if gain > numbers + LEVEL_SIGMAS * np.sqrt(2 * numbers) or excess_of(problem, fit, quality) >= 1:
        return True
    return most_promised(problem, fit, laws) > 2 * PAIR_GAIN * scale_of(quality) ** 2


def _finished(
    problem: Problem,
    found: Search,
    hypotheses: Sequence[Hypothesis],
    progress: Progress | None,
    clock: Clock,
    *,
    with_pairs: bool = True,
) -> tuple[Problem, list[Fit]]:
    """The problem on the finer mesh; linear effects, best first, and pairs where no single one is adequate."""
    found, alone = _bent_where_it_helps(problem, found, hypotheses, progress)
    fits = list(found.fits) or [found.nominal]
    if with_pairs and not alone:
        fits = _with_pairs(problem, found, hypotheses, progress)
        clock.lap("pairs")
    finer = problem.made(refined=True)
    return finer, best_first([*all_polished(finer, fits[:POLISHED]), *fits[POLISHED:]])


def _bent_where_it_helps(
    problem: Problem, found: Search, hypotheses: Sequence[Hypothesis], progress: Progress | None
) -> tuple[Search, bool]:
    """The search, with its best effect bent where it does not suffice; whether nothing is left for a second one."""
    if not found.fits:
        return found, True
    if not adequate(problem, found.best):
        found = with_bent(problem, from_afar_too(problem, found, hypotheses, progress), hypotheses)
    elif _suffices(problem, found.best, hypotheses):
        return found, True
    else:  # what a second effect would take away may be its own law's
        found = bent_little(problem, found)
    return found, _suffices(problem, found.best, hypotheses)


def _suffices(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis]) -> bool:
    """Whether a single effect leaves noise, of which no second one takes away much."""
    quality = judge(problem, fit)
    if excess_of(problem, fit, quality) >= 1:
        return False
    return most_left(problem, fit, hypotheses) < 2 * PAIR_GAIN * scale_of(quality) ** 2


def _with_pairs(
    problem: Problem, found: Search, hypotheses: Sequence[Hypothesis], progress: Progress | None
) -> list[Fit]:
    """Singles and pairs, best first; a pair counts only where it earns its evidence."""
    twos = pairs(problem, found, hypotheses, progress)
    if twos and not any(adequate(problem, fit) for fit in (found.best, twos[0])):
        twos = best_first([*twos, *exchanged(problem, twos[0], hypotheses, not found.rough, progress)])
    twos = best_first([*twos, *(fit for pair in twos[:_TAKEN_APART] for fit in straightened(problem, pair))])
    alone = [fit for pair in twos[:_TAKEN_APART] for fit in each_alone(problem, pair, hypotheses)]
    singles = {fit.hypothesis: fit for fit in sorted((*found.fits, *alone), key=lambda fit: fit.log_weight)}
    scale = scale_of(judge(problem, max([*singles.values(), *twos], key=lambda fit: fit.log_weight)))
    best = max(singles.values(), key=lambda fit: fit.log_evidence(scale))
    bend = BENT_SHARE * (found.nominal.chi2 - best.chi2) / (2 * scale**2) if adequate(problem, best) else 0.0
    needed = best.log_evidence(scale) + PAIR_GAIN
    earned = (pair for pair in twos if pair.log_evidence(scale) > needed + (bend if _at_one_joint(pair) else 0.0))
    return best_first([*singles.values(), *earned])


def _at_one_joint(fit: Fit) -> bool:
    """Whether all its effects act at the bearings: a second one bends the law of the first."""
    return all(effect.location == "bearings" for effect in fit.effects)
