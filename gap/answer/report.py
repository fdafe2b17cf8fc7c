"""A ranking as a diagnosis: causes, where, how far, what next."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.gap.answer import sentence as wording
from rigtwin.gap.answer.calibration import calibration_of
from rigtwin.gap.answer.causes import cause_of, k_b_of, locations
from rigtwin.gap.answer.held_out import Confirm, measure_shrink
from rigtwin.gap.answer.joint import UnknownJoint, unknown_joint
from rigtwin.gap.answer.missing_test import missing_test
from rigtwin.gap.answer.next_run import best_next_test
from rigtwin.gap.answer.where import locate
from rigtwin.gap.audit.findings import amplitude_dependent
from rigtwin.gap.clock import Clock
from rigtwin.gap.curves import Curve, log_distance_db, nrmse
from rigtwin.gap.document import DAMPING, Cause, Diagnosis, Finding, Location, NextTest, Regime, Shrink, Verdict, Where
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.posterior import posterior
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.strategies.bearing_stiffness import compare_with_models
from rigtwin.gap.verdict.adequacy import judge
from rigtwin.gap.verdict.ranking import Ranked, best_of, by_name, likely, name_of, together
from rigtwin.gap.verdict.standing import Standing, scale_of
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.effects.structure import MeasuredJoint
from rigtwin.sim.campaign import Campaign


@dataclass(frozen=True)
class Outcome:
    """A diagnosis and the curves that it rests on."""

    diagnosis: Diagnosis
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class Answer:
    """What was found about a campaign, before it is put into words."""

    whole: Problem  # of all lines
    problem: Problem  # that the fits belong to
    fitted: Fit  # the recalibrated nominal model by the data's own errors
    nominal: Fit  # the same, as it is reported; see ``fit_lines_alike``
    ranked: Ranked
    standing: Standing
    verdict: Verdict

    @cached_property
    def all_lines(self) -> Problem:
        """The problem of the fits on all lines."""
        return self.problem.on(self.whole.observed)

    @property
    def scale(self) -> float:
        """True over believed error."""
        return scale_of(self.standing.quality)


def report(
    campaign: Campaign,
    answer: Answer,
    findings: tuple[Finding, ...],
    exclude: Sequence[str],
    confirm: Confirm | None,
    clock: Clock,
) -> Outcome:
    """The diagnosis with its curves, and how far the gap shrinks.

    Parameters
    ----------
    findings, exclude : those of the audit, and ids of effects that were withheld
    confirm : measures the corrected rotor on the virtual rig; None: the model's figure stands
    """
    findings = (*findings, *_form_finding(answer))
    named = _name_causes(campaign, answer, findings, exclude)
    joint = _joint(answer, named, exclude, clock)
    curves = _curves(answer, named, joint)
    where = _where(answer, named, curves, findings, joint)
    clock.lap("where")
    diagnosis = Diagnosis(
        title=campaign.title,
        rig=Path(campaign.rig).name,
        verdict=named.verdict,
        sentence="",
        nominal=_nominal_figures(answer, curves),
        where=where,
        causes=named.causes,
        equivalent=named.equivalent,
        next_test=_next_test(campaign, answer, findings, named),
        shrink=_shrink(answer, named.best, confirm, clock),
        audit=(*findings, *_repeatability_findings(answer.problem, named.best), *_noise_finding(answer)),
        excluded=tuple(exclude),
        unknown_score=_doubt(answer.standing),
        calibration=calibration_of(answer.problem, named.best, answer.scale),
        timing_s=clock.laps,
        measured_joint=joint.document,
    )
    return Outcome(replace(diagnosis, sentence=wording.sentence(diagnosis)), curves)


@dataclass(frozen=True)
class _Named:
    """What is answered."""

    verdict: Verdict
    causes: tuple[Cause, ...]  # by probability
    best: Fit  # that corrects the model: the nominal one where no effect does

    @property
    def equivalent(self) -> tuple[Cause, ...]:
        """Causes that the data cannot tell apart."""
        return _equivalent(self.causes) if self.verdict == "ambiguous" else ()

    @property
    def answered(self) -> tuple[Cause, ...]:
        """Causes that the verdict names."""
        return self.causes[:1] if self.verdict == "cause" else self.equivalent


def _name_causes(campaign: Campaign, answer: Answer, findings: Sequence[Finding], exclude: Sequence[str]) -> _Named:
    """The answer; where the model is right on every line, the raster is the cause if it is too coarse."""
    ranked, verdict, raster = answer.ranked, answer.verdict, _raster_effect()
    causes = _causes(answer.problem, ranked, answer.scale, _known(answer))
    if verdict in ("cause", "ambiguous"):
        return _Named(verdict, causes, best_of(ranked))
    if verdict == "no_gap" and raster not in exclude and _is_coarse(campaign, findings):
        return _Named("cause", (_raster_cause(answer, raster), *causes), answer.nominal)
    return _Named(verdict, causes, answer.nominal)


def _joint(answer: Answer, named: _Named, exclude: Sequence[str], clock: Clock) -> UnknownJoint:
    """What is told of a mechanism that no known effect explains."""
    if named.verdict != "unknown" or MeasuredJoint.id in exclude:
        return UnknownJoint()
    found = unknown_joint(answer.problem, answer.fitted, answer.scale)
    clock.lap("measured joint")
    return found


def _curves(answer: Answer, named: _Named, joint: UnknownJoint) -> tuple[Curve, ...]:
    """All lines of the runs, with the nominal model and, where there is one, the corrected model."""
    drawn, best = answer.all_lines, joint.fit or named.best
    before = drawn.recalibrated(answer.nominal)
    corrects = best is not answer.nominal or named.verdict == "no_gap"
    after = drawn.predict(best) if corrects else [None] * len(before)
    return tuple(Curve(o.run, H0, H1, o.error) for o, H0, H1 in zip(drawn.observed, before, after, strict=True))


def _where(
    answer: Answer, named: _Named, curves: Sequence[Curve], findings: Sequence[Finding], joint: UnknownJoint
) -> Where:
    """Where the gap lies, with the bearings' stiffness where that may be the cause; nothing of too few data."""
    if named.verdict == "not_enough_data":
        return Where()
    regime = _regime(named.answered, findings)
    where = locate(answer.all_lines, answer.nominal, [c.nominal for c in curves], regime, joint.node)
    if joint.document:
        where = replace(where, nodes=joint.document.nodes)
    if _may_be_the_bearings(named.answered):
        best = named.best if named.best is not answer.nominal else None
        where = replace(where, bearings=compare_with_models(answer.all_lines, answer.nominal, best))
    return where


def _shrink(answer: Answer, best: Fit, confirm: Confirm | None, clock: Clock) -> Shrink | None:
    """How far the gap shrinks; None where no effect corrects the model."""
    if best is answer.nominal:
        return None
    shrink = measure_shrink(answer.problem, answer.nominal, best, answer.scale, confirm)
    clock.lap("held out")
    return shrink


def _may_be_the_bearings(answered: Sequence[Cause]) -> bool:
    """Whether the answered causes leave it open that the bearings carry the shaft in another way."""
    return not answered or any(place.kind == "bearings" for cause in answered for place in cause.locations)


def _known(answer: Answer) -> float:
    """Probability that a known effect, or none at all, is the answer."""
    return 1 - _doubt(answer.standing) if answer.verdict == "unknown" else 1.0


def _doubt(standing: Standing) -> float:
    """0 where nothing but noise is left, 1/2 at the threshold."""
    return standing.excess**2 / (1 + standing.excess**2)


def _nominal_figures(answer: Answer, curves: Sequence[Curve]) -> dict[str, Any]:
    """What the diagnosis says about the recalibrated nominal model."""
    problem, nominal = answer.problem, answer.nominal
    return {
        "k_b": k_b_of(nominal, posterior(problem, nominal, answer.scale).std) if nominal.n_data else None,
        "gap": _mean([nrmse(c.run.H, c.run.as_recorded(c.nominal)) for c in curves]),
        "gap_dB": _mean([log_distance_db(c.run.H, c.nominal) for c in curves]),
        "misfit": judge(problem, answer.fitted).misfit,
        "probability": _known(answer) * answer.ranked.no_gap if answer.verdict != "not_enough_data" else math.nan,
        "calibration": calibration_of(problem, problem.plausible(nominal), answer.scale),
        **{key: getattr(problem.forward.belief, key) for key in DAMPING},
    }


def _mean(values: Sequence[float]) -> float:
    """Over the runs that have a value; nan where none has."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan


def _next_test(campaign: Campaign, answer: Answer, findings: Sequence[Finding], named: _Named) -> NextTest | None:
    """What would tell the causes, or the places, that remain apart; else what the campaign lacks."""
    if wrong := sorted({f.check for f in findings if wording.must_be_corrected(f)}):
        return NextTest(f"None before what the audit finds wrong under {' and '.join(wrong)} is corrected.")
    rivals = _rivals(answer.ranked, named)
    separating = best_next_test(answer.problem, rivals) if len(rivals) > 1 else None
    return separating or missing_test(named.verdict, campaign, named.causes, named.equivalent)


def _rivals(ranked: Ranked, named: _Named) -> list[Fit]:
    """What the next test should tell apart: causes, or else the places of the one that is named."""
    groups, causes = by_name(ranked), named.causes
    if named.equivalent:
        return [groups[name_of(cause.effects)][0][0] for cause in named.equivalent]
    if named.verdict == "cause" and causes[0].place_probability < THRESHOLDS.sure:
        return [fit for fit, _ in likely(groups[name_of(causes[0].effects)])]
    return []


def _causes(problem: Problem, ranked: Ranked, scale: float, known: float) -> tuple[Cause, ...]:
    """One cause for every set of effects, at its most probable place, with the probability of all its places.

    Parameters
    ----------
    known : probability that a known effect, or none at all, is the answer
    """
    causes = []
    for places in by_name(ranked).values():
        total = together(places)
        (best, probability), *others = likely(places)
        cause = _cause(problem, best, known * total, scale)
        elsewhere = tuple(locations(fit.hypothesis, fit.u) for fit, _ in others)
        causes.append(replace(cause, place_probability=probability / total if total else 1.0, other_places=elsewhere))
    return tuple(causes)


def _cause(problem: Problem, fit: Fit, probability: float, scale: float) -> Cause:
    std = posterior(problem, fit, scale).std[: len(fit.u)]
    cause = cause_of(fit.hypothesis, fit.u, std, probability, k_b_of(fit, std), fit.log_evidence(scale))
    if fit.sampled is None:
        return cause
    return replace(cause, ess=fit.sampled.ess, log_evidence_error=fit.sampled.error)


def _equivalent(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """The smallest set that holds nearly all of the causes' probability, of at most three."""
    total = sum(cause.probability for cause in causes)
    chosen: list[Cause] = []
    for cause in causes:
        if sum(c.probability for c in chosen) >= THRESHOLDS.answered * total or len(chosen) == THRESHOLDS.at_most:
            break
        chosen.append(cause)
    return tuple(chosen)


def _regime(answered: Sequence[Cause], findings: Sequence[Finding]) -> Regime:
    """What kind of gap it is: by the families of the causes that are answered, or else by whether levels differ."""
    regimes: set[Regime] = {_regime_of(cause) for cause in answered}
    if len(regimes) == 1:
        return next(iter(regimes))
    return "amplitude_dependent" if amplitude_dependent(findings) else "linear"


def _regime_of(cause: Cause) -> Regime:
    families = {EFFECTS[name].family for name in cause.effects}
    if "nonlinear" in families:
        return "amplitude_dependent"
    if "spinning" in families:
        return "spin_dependent"
    return "measurement_chain" if families == {"chain"} else "linear"


def _is_coarse(campaign: Campaign, findings: Sequence[Finding]) -> bool:
    """Whether lines are further apart than a half-power band, in half of the runs or more; else some are missing."""
    seen = (f for f in findings if f.check == "raster" and f.severity == "warning")
    coarse = {f.run for f in seen if f.value is None or f.value <= 1}
    return bool(coarse) and 2 * len(coarse) >= len(campaign.runs)


def _raster_effect() -> str:
    """The effect that widens the distance of the lines."""
    return next(name for name, effect in EFFECTS.items() if "step_hz" in effect().sweep_changes())


def _raster_cause(answer: Answer, effect: str) -> Cause:
    """The raster as the cause, as surely as the model is right."""
    std = posterior(answer.problem, answer.nominal, answer.scale).std
    k_b, place = k_b_of(answer.nominal, std), Location("raster")
    return Cause((effect,), place, answer.ranked.no_gap, {}, k_b, math.nan, locations=(place,))


def _form_finding(answer: Answer) -> tuple[Finding, ...]:
    """That a cause leaves more than noise, though far less than anything else."""
    standing = answer.standing
    if not standing.other_form or answer.verdict not in ("cause", "ambiguous"):
        return ()
    names = " and ".join(best_of(answer.ranked).hypothesis.ids)
    words = (
        f"{names} leaves {standing.quality.misfit:.2g} times the noise, far less than anything else leaves: on this "
        "rig it acts in a form that differs from the library's, or something small acts beside it"
    )
    return (Finding("form", "warning", words, "", standing.quality.misfit, THRESHOLDS.adequate_misfit),)


def _repeatability_findings(problem: Problem, fit: Fit) -> Iterator[Finding]:
    """What the runs say of repeatabilities that nobody stated; a warning where they are worse than usual."""
    words = {
        "frequency_drift": "The resonances of the runs differ from the model's by {size:.2g} %, each on its own",
        "gain_repeatability": "The gains of the sensors differ from run to run by {size:.2g} %",
    }
    for each in problem.nuisances.learned:
        size = each.of(fit.prior_std)
        severity = "warning" if each.is_unusual(size) else "note"
        told = words[each.name].format(size=100 * size)
        yield Finding("repeatability", severity, f"{told}; say {each.name} in [nominal] if you know it.", "", size)


def _noise_finding(answer: Answer) -> tuple[Finding, ...]:
    """That the values scatter otherwise than their standard errors say."""
    low, high, quality = THRESHOLDS.believed_scale_low, THRESHOLDS.believed_scale_high, answer.standing.quality
    if all(run.std is None for run in answer.problem.runs) or low <= quality.scale <= high:
        return ()
    words = (
        f"the values scatter {quality.scale:.2g} times as much as their standard errors say; "
        "fits are judged and ranked with errors scaled by that"
    )
    return (Finding("noise", "warning", words, "", quality.scale, high),)
