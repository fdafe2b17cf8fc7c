"""A campaign made ready: its runs with their errors and model, and the recalibrated nominal model."""

from __future__ import annotations

from dataclasses import replace

from rigtwin.gap.audit.checked_run import checked_runs
from rigtwin.gap.audit.noise import believed_errors, common_error, scatter_over
from rigtwin.gap.audit.wild import blank_lines, left_out_finding
from rigtwin.gap.document import Finding
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.observed import Observed, observe
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.campaign_model import forward_of
from rigtwin.gap.search.nominal import in_si, is_close, recalibrate, roughly
from rigtwin.gap.verdict.adequacy import odd_lines
from rigtwin.gap.verdict.standing import adequate
from rigtwin.sim.campaign import Campaign, Run


def _observed(run: Run) -> Observed:
    std = believed_errors(run)
    return observe(run, std, common_error(run), scatter_over(run, std))


def prepared(campaign: Campaign) -> tuple[Problem, Fit]:
    """A campaign's runs with their errors and model, and the recalibrated nominal model."""
    as_given = Problem(forward_of(campaign), [_observed(run) for run in campaign.runs])
    problem = in_si(as_given, u := roughly(as_given))
    nominal = recalibrate(problem, u)
    return (problem.near_fit(nominal) if is_close(nominal) else problem), nominal


def without_odd_lines(
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
