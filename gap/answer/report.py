"""A ranking as a diagnosis: causes, where, how far, what next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.gap.answer import sentence as wording
from rigtwin.gap.answer.causes import cause_of, locations
from rigtwin.gap.answer.held_out import Confirm, measure_shrink
from rigtwin.gap.answer.missing_test import missing_test
from rigtwin.gap.answer.next_run import best_next_test
from rigtwin.gap.answer.where import locate
from rigtwin.gap.audit.findings import amplitude_dependent
from rigtwin.gap.clock import Clock
from rigtwin.gap.curves import Curve, log_distance_db, nrmse
from rigtwin.gap.document import (
    DAMPING,
    Cause,
    Diagnosis,
    Estimate,
    Finding,
    Location,
    NextTest,
    Regime,
    Shrink,
    Verdict,
    Where,
)
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.linear import TOLERANCES
from rigtwin.gap.search.strategies.bearing_stiffness import beside_models
from rigtwin.gap.verdict.adequacy import Adequacy, judge
from rigtwin.gap.verdict.ranking import Ranked, best_of, by_name, likely, name_of, together
from rigtwin.gap.verdict.standing import Standing, scale_of
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.sim.campaign import Campaign


@dataclass(frozen=True)
class Outcome:
    """A diagnosis and the curves that it rests on."""

    diagnosis: Diagnosis
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class Answer:
    """What was found of a campaign, before it is put into words."""

    whole: Problem  # of all lines
    problem: Problem  # that the fits belong to
    fitted: Fit  # the recalibrated nominal model by the data's own errors
    nominal: Fit  # the same, as it is said; see ``matched``
    ranked: Ranked
    standing: Standing
    verdict: Verdict

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
    """The diagnosis, and how far the gap shrinks.

    Parameters
    ----------
    findings : of the audit
    exclude : ids of effects that were withheld
    confirm : measures the corrected rotor on the virtual rig; None: the model's figure stands
    """
    problem, nominal = answer.problem, answer.nominal
    findings = (*findings, *_form_finding(answer))
    verdict, causes, best = _named(campaign, answer, findings, exclude)
    drawn = problem.on(answer.whole.observed)
    believed = drawn.bare(nominal)
    corrected = drawn.predict(best) if best is not nominal or verdict == "no_gap" else [None] * len(believed)
    curves = tuple(Curve(o.run, H0, H1, o.error) for o, H0, H1 in zip(drawn.observed, believed, corrected, strict=True))
    equivalent = _equivalent(causes) if verdict == "ambiguous" else ()
    regime = _regime(causes[:1] if verdict == "cause" else equivalent, findings)
    told = verdict != "not_enough_data"
    where = locate(drawn, nominal, believed, regime) if told else Where()
    if told and _may_be_the_bearings(verdict, causes[:1], equivalent):
        where = replace(where, bearings=beside_models(drawn, nominal, best if best is not nominal else None))
    clock.lap("where")
    shrink: Shrink | None = None
    if best is not nominal:
        shrink = measure_shrink(problem, nominal, best, answer.scale, confirm)
        clock.lap("held out")
    diagnosis = Diagnosis(
        title=campaign.title,
        rig=Path(campaign.rig).name,
        verdict=verdict,
        sentence="",
        nominal=_nominal_figures(campaign, answer, curves),
        where=where,
        causes=causes,
        equivalent=equivalent,
        next_test=_next_test(campaign, answer, findings, verdict, causes, equivalent),
        shrink=shrink,
        audit=(
            *findings,
            *_mounting_finding(campaign, problem, best),
            *_noise_finding(problem, answer.standing.quality),
        ),
        excluded=tuple(exclude),
        unknown_score=_doubt(answer.standing),
        calibration=calibration(problem, best),
        timing_s=clock.laps,
    )
    return Outcome(replace(diagnosis, sentence=wording.sentence(diagnosis)), curves)


def _named(
    campaign: Campaign, answer: Answer, findings: Sequence[Finding], exclude: Sequence[str]
) -> tuple[Verdict, tuple[Cause, ...], Fit]:
    """The verdict, causes by probability, and the fit that corrects the model: the nominal one where no effect does."""
    problem, ranked, verdict = answer.problem, answer.ranked, answer.verdict
    causes = _causes(problem, ranked, answer.scale, _known(answer))
    if verdict in ("cause", "ambiguous"):
        return verdict, causes, best_of(ranked)
    if verdict == "no_gap" and "coarse_grid" not in exclude and _is_coarse(campaign, findings):
        return "cause", (_raster(answer), *causes), answer.nominal
    return verdict, causes, answer.nominal


def _may_be_the_bearings(verdict: Verdict, first: Sequence[Cause], equivalent: Sequence[Cause]) -> bool:
    """Whether what is answered leaves it open that the bearings carry the shaft in another way."""
    answered = first if verdict == "cause" else equivalent
    return not answered or any(place.kind == "bearings" for cause in answered for place in cause.locations)


def _known(answer: Answer) -> float:
    """Probability that it is a known effect, or none, at all."""
    return 1 - _doubt(answer.standing) if answer.verdict == "unknown" else 1.0


def _doubt(standing: Standing) -> float:
    """0 where nothing but noise is left, 1/2 at the threshold."""
    return standing.excess**2 / (1 + standing.excess**2)


def _nominal_figures(campaign: Campaign, answer: Answer, curves: Sequence[Curve]) -> dict[str, Any]:
    """What is said of the recalibrated nominal model."""
    problem, nominal = answer.problem, answer.nominal
    return {
        "k_b": _k_b(problem, nominal, answer.scale) if nominal.n_data else None,
        "gap": _mean([nrmse(c.run.H, c.run.as_recorded(c.nominal)) for c in curves]),
        "gap_dB": _mean([log_distance_db(c.run.H, c.nominal) for c in curves]),
        "misfit": judge(problem, answer.fitted).misfit,
        "probability": _known(answer) * answer.ranked.no_gap if answer.verdict != "not_enough_data" else math.nan,
        **{key: getattr(campaign.nominal, key) for key in DAMPING},
    }


def _mean(values: Sequence[float]) -> float:
    """Over the runs that have a value; nan where none has."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan


def _next_test(
    campaign: Campaign,
    answer: Answer,
    findings: Sequence[Finding],
    verdict: Verdict,
    causes: Sequence[Cause],
    equivalent: Sequence[Cause],
) -> NextTest | None:
    """What would tell the causes, or the places, that remain apart; else what the campaign lacks."""
    if wrong := sorted({f.check for f in findings if wording.must_be_corrected(f)}):
        return NextTest(f"None before what the audit finds wrong under {' and '.join(wrong)} is corrected.")
    rivals = _rivals(answer.ranked, causes, verdict, equivalent)
    told = best_next_test(answer.problem, rivals) if len(rivals) > 1 else None
    return told or missing_test(verdict, campaign, causes, equivalent)


def _rivals(ranked: Ranked, causes: Sequence[Cause], verdict: Verdict, equivalent: Sequence[Cause]) -> list[Fit]:
    """What the next test should tell apart: causes, or else the places of the one that is named."""
    groups = by_name(ranked)
    if equivalent:
        return [groups[name_of(cause.effects)][0][0] for cause in equivalent]
    if verdict == "cause" and causes[0].place_probability < THRESHOLDS.sure:
        return [fit for fit, _ in likely(groups[name_of(causes[0].effects)])]
    return []


def _k_b(problem: Problem, fit: Fit, scale: float) -> Estimate | None:
    if not problem.with_k_b:
        return None
    return Estimate(fit.k_b, fit.k_b * float(np.sqrt(fit.covariance(scale)[0, 0])), "N/m")


def _causes(problem: Problem, ranked: Ranked, scale: float, known: float) -> tuple[Cause, ...]:
    """One cause for every set of effects, at its most probable place, with the probability of all its places.

    Parameters
    ----------
    known : probability that it is a known effect, or none, at all
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
    std = np.sqrt(fit.covariance(scale).diagonal())[: len(fit.u)]
    k_b = _k_b(problem, fit, scale)
    cause = cause_of(fit.hypothesis, fit.u, std, probability, k_b, fit.log_evidence(scale))
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


def _raster(answer: Answer) -> Cause:
    """The raster as the cause, as surely as the model is right."""
    k_b, place = _k_b(answer.problem, answer.nominal, answer.scale), Location("raster")
    return Cause(("coarse_grid",), place, answer.ranked.no_gap, {}, k_b, math.nan, locations=(place,))


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


def _mounting_finding(campaign: Campaign, problem: Problem, fit: Fit) -> tuple[Finding, ...]:
    """That sensors' gains are not the same in all runs, where the campaign did not say so."""
    if campaign.nominal.gain_repeatability or not problem.forward.belief.gain_repeatability:
        return ()
    own = np.concatenate([fit.nu[each] for each in problem.nuisances.own_gain])
    size = float(np.sqrt(np.mean(own**2)))
    words = (
        f"The gains of the sensors differ from run to run by {100 * size:.2g} %, as when they are mounted anew; they "
        "were fitted run by run. Calibrate them in place, or say gain_repeatability in [nominal]"
    )
    return (Finding("repeatability", "warning", f"{words}.", "", size, problem.nuisances.sensor_std),)


def _noise_finding(problem: Problem, quality: Adequacy) -> tuple[Finding, ...]:
    low, high = THRESHOLDS.believed_scale_low, THRESHOLDS.believed_scale_high
    if all(run.std is None for run in problem.runs) or low <= quality.scale <= high:
        return ()
    words = (
        f"the values scatter {quality.scale:.2g} times as much as their standard errors say; "
        "fits are judged and ranked with errors scaled by that"
    )
    return (Finding("noise", "warning", words, "", quality.scale, high),)


def calibration(problem: Problem, fit: Fit) -> dict[str, dict[str, float]]:
    """What the fit says of sensors and of the workshop's tolerances: common to all runs of the rig."""
    nuisances = problem.nuisances
    return {
        "sensor_gain": {
            str(channel): float(np.exp(value))
            for channel, value in zip(nuisances.sensors, fit.nu[nuisances.sensor], strict=True)
        },
        "tolerance": dict(zip(TOLERANCES, map(float, fit.nu[nuisances.tolerance]), strict=True)),
    }
