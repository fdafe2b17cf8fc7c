"""A measured campaign in, a diagnosis out: audit, recalibrate, explain, judge, answer."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

from threadpoolctl import threadpool_limits

from rigtwin.gap.answer.held_out import Confirm
from rigtwin.gap.answer.report import Answer, Outcome, report
from rigtwin.gap.answer.sentence import must_be_corrected
from rigtwin.gap.audit.findings import amplitude_dependent, audit, usable
from rigtwin.gap.clock import Clock
from rigtwin.gap.document import Finding
from rigtwin.gap.explain import Explained, Task, explain, library_of
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import nonlinear
from rigtwin.gap.peaks.diagnosis import diagnose_peaks
from rigtwin.gap.prepare import prepared, without_odd_lines
from rigtwin.gap.search.nominal import fit_lines_alike
from rigtwin.gap.search.race import Progress
from rigtwin.gap.verdict.ranking import decide
from rigtwin.gap.verdict.standing import scale_of
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.shared_work import helped_by, seconds_left, seconds_to_work
from rigtwin.sim.campaign import Campaign

# Seconds of processor time that a search takes at most, unless another number is asked for; a fifth of it where names,
# signs or units do not fit what the runs show, as nothing can explain these.
TIME_LIMIT = 300.0


@threadpool_limits.wrap(limits=1)  # the matrices are small: several threads make it five times slower
def diagnose(
    campaign: Campaign,
    exclude: Sequence[str] = (),
    progress: Progress | None = None,
    confirm: Confirm | None = None,
    helpers: Executor | None = None,
    seconds: float | None = None,
) -> Outcome:
    """Say where the gap between the campaign and its model lies, what causes it, and how far it shrinks.

    Parameters
    ----------
    campaign : measured or simulated
    exclude : ids of effects that are withheld from the library
    progress : called with (done, total, words)
    confirm : measures the corrected rotor on the virtual rig, for the after-figure; None: the model's figure stands
    helpers : workers that fits are shared with, one thread each; the answer is the same without
    seconds : of processor time that the search may take, default 300, or 60 where the audit finds what has
        to be corrected first; what was found until then is judged, and a finding says so

    Raises
    ------
    ValueError : an excluded effect does not exist
    MeasurementError : a run has a node that the rig lacks
    """
    _check_known(exclude)
    clock = Clock()
    findings = audit(campaign)
    clock.lap("audit")
    if not campaign.runs:
        return Outcome(diagnose_peaks(campaign, exclude, findings), ())
    campaign = usable(campaign)
    campaign, whole, nominal, odd = without_odd_lines(campaign, *prepared(campaign))
    findings += odd
    clock.lap("recalibration")
    task = Task(whole, nominal, library_of(whole, exclude), amplitude_dependent(findings), progress, clock)
    with helped_by(helpers):
        found, ended = _explained(task, findings, seconds)
    answer = _judge(whole, found, clock)
    return report(campaign, answer, findings + ended, exclude, confirm, clock)


def _check_known(effect_ids: Sequence[str]) -> None:
    if unknown := sorted(set(effect_ids) - set(EFFECTS)):
        raise ValueError(f"exclude: no effect {', '.join(unknown)}; see rigtwin effects")


def _explained(task: Task, findings: Sequence[Finding], seconds: float | None) -> tuple[Explained, tuple[Finding, ...]]:
    """What explains the runs within a time, and a finding where the search took longer."""
    wrong = any(map(must_be_corrected, findings))
    limit = TIME_LIMIT / (5 if wrong else 1) if seconds is None else seconds
    with seconds_to_work(limit):
        found = explain(task)
        if seconds_left() > 0:
            return found, ()
    words = f"The search ended after {limit:g} s of work, before everything was tried: it may have missed a cause"
    words += ". Correct first what the audit found." if wrong else ". Give it more time."
    return found, (Finding("search", "warning", words),)


def _judge(whole: Problem, found: Explained, clock: Clock) -> Answer:
    """The verdict, and the nominal model that is shown beside it."""
    problem, nominal = found.problem, found.nominal
    decision = decide(problem, nominal, found.fits, found.enough)
    clock.lap("verdict")
    robust = any(nonlinear(fit.effects) for fit in found.fits)  # and so is the nominal model
    shown = nominal if robust else fit_lines_alike(problem, nominal, scale_of(decision.standing.quality))
    return Answer(whole, problem, nominal, shown, decision.ranked, decision.standing, decision.verdict)
