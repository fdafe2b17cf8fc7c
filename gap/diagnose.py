"""A measured campaign in, a diagnosis out: audit, recalibrate, where, which, how far, what next."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from gap import wording
from gap.adequacy import Adequacy, judge
from gap.audit import audit, believed_errors, usable
from gap.causes import cause_of, locations
from gap.curves import Curve, log_distance_db, nrmse
from gap.diagnosis import DAMPING, Cause, Diagnosis, Estimate, Finding, Location, Regime, Shrink, Verdict
from gap.evidence import sample
from gap.forward import TOLERANCES, Forward, nonlinear
from gap.held_out import Confirm, measure_shrink
from gap.helpers import helped_by
from gap.hypotheses import NO_GAP_PRIOR, SURE, Hypothesis, candidates
from gap.likelihood import Fit, Problem, observe
from gap.next_test import best_next_test
from gap.nonlinear_search import ADEQUATE_NONLINEAR, most_promised, robust_fit, search_nonlinear
from gap.search import (
    POLISHED,
    Progress,
    Search,
    all_polished,
    best_first,
    each_alone,
    exchanged,
    most_left,
    pairs,
    recalibrate,
    search,
    strained,
    with_bent,
)
from gap.where import locate
from rotor.assembly import assemble
from rotor.effects.library import EFFECTS
from rotor.rig import load_rig
from rotor.structure import Structure
from sim.campaign import Campaign, MeasurementError

# Thresholds. They are set on the tuning campaigns of the blind benchmark, never on its report campaigns.
ADEQUATE_MISFIT = 1.15  # mean square residual over the noise's, at most
ADEQUATE_SPREAD = 3.0  # the same of few values: beyond 1, in standard deviations of what noise alone leaves
ADEQUATE_CORRELATION = 3.5  # of neighbouring residuals, in standard errors, at most
ADEQUATE_NUISANCE = 2.5  # mean square of the nuisances that are determined, in their priors' units, at most
PASSED_OVER_CHANCE = 1e-4  # that noise gives resonances and shapes of their own as much as they would take away
PASSED_OVER_SHARE = 0.1  # of what a cause takes away, that they would take away beside it, at most
FORM_LEFT = 0.02  # share of the best rival's misfit that an effect in another form than the library's leaves, at most
FORM_LEFT_NONLINEAR = 0.5  # the same of nonlinear effects: their far lines weigh less
LEVEL_SIGMAS = 2.0  # standard deviations by which resonances of each level's own may take away more than chance
PLAIN_GAP = 3.0  # mean square residual of rigid runs over the noise's that no law of the bearings leaves
PAIR_GAIN = 12.0  # logarithm of the evidence that a pair must add
ANSWERED = 0.98  # probability that the set of an ambiguous verdict holds
AT_MOST = 3  # effects in that set
LEAST_DATA = 20  # real numbers; of fewer nothing is concluded
BELIEVED_SCALE = (0.8, 1.25)  # the data's own scatter over the given errors: within, the given ones are believed
MOST_SCALE = 1.5  # scatter about a nonlinear effect's fit over the believed errors that is still noise, not misfit

# Elements between two nodes of the diagnosis model, at least: at zeta = 0.1 % a mesh error of 0.02 % is a gap.
# A crack or a hub inside an element needs more of them.
_ELEMENTS, _FINE_ELEMENTS = 2, 8

# Pairs whose effects are tried alone.
_TAKEN_APART = 3

# Candidates of such a probability, of the most probable ones, have their evidence sampled.
_WORTH_SAMPLING, _SAMPLED = 1e-4, 4

# Mean square misfit of the nominal model from which levels that differ are not asked for a linear cause.
_PLAIN = 20.0


@dataclass(frozen=True)
class Outcome:
    """A diagnosis and the curves that it rests on."""

    diagnosis: Diagnosis
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class _Standing:
    """The fits that count, best first, and how far the first one is to be believed."""

    fits: Sequence[Fit]
    quality: Adequacy  # of the first
    excess: float  # of what it leaves: 1 at the threshold
    other_form: bool = False  # whether it is believed for leaving a small share of what anything else leaves


@dataclass(frozen=True)
class _Ranked:
    """All candidates with their probabilities, the nominal model among them."""

    fits: tuple[Fit, ...]
    probabilities: tuple[float, ...]
    no_gap: float


def elements_between_nodes(rig: str, least: int = _ELEMENTS) -> int:
    """So many, or the rig's own number, if that is larger."""
    return max(least, load_rig(rig).elements_between_nodes)


def structure_of(rig: str, least: int = _ELEMENTS) -> Structure:
    """The campaign's rig, with at least so many elements between two nodes."""
    return assemble(load_rig(rig), elements_between_nodes=elements_between_nodes(rig, least))


def forward_of(campaign: Campaign) -> Forward:
    """The model of a campaign's rig, meshed finely enough for a diagnosis.

    Raises MeasurementError where a run has a node that the rig lacks.
    """
    structure = structure_of(campaign.rig)
    for run in campaign.runs:
        last = max(run.excitation_node, *(channel.node for channel in run.channels))
        if last > structure.n_nodes:
            raise MeasurementError(
                f"run {run.name!r}: node {last} does not exist, the rig has {structure.n_nodes}; correct one of them"
            )
    return Forward(structure, campaign.nominal, structure_of(campaign.rig, _FINE_ELEMENTS))


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
    clock = _Clock()
    findings = audit(campaign)
    clock.lap("audit")
    if not campaign.runs:
        from gap.peaks import diagnose_peaks

        return Outcome(diagnose_peaks(campaign, exclude, findings), ())
    campaign = usable(campaign)
    problem, nominal = prepared(campaign)
    clock.lap("recalibration")
    library = _Library(
        linear=candidates(campaign.runs, problem.forward.structure, exclude),
        laws=candidates(campaign.runs, problem.forward.structure, exclude, nonlinear=True),
    )
    whole, enough = problem, nominal.n_data >= LEAST_DATA
    with helped_by(helpers):
        problem, nominal, fits = _explained(problem, nominal, library, _amplitude_dependent(findings), progress, clock)
    standing = _standing(problem, nominal, fits)
    clock.lap("form")
    ranked = _rank(problem, nominal, standing)
    verdict = _verdict(problem, nominal, ranked, standing) if enough else "not_enough_data"
    if standing.other_form and verdict in ("cause", "ambiguous"):
        findings = (*findings, _form_finding(ranked.fits[0], standing))
    return _report(campaign, whole, problem, nominal, ranked, standing, verdict, findings, exclude, confirm, clock)


def prepared(campaign: Campaign) -> tuple[Problem, Fit]:
    """A campaign's runs with their errors and model, and the recalibrated nominal model."""
    problem = Problem(forward_of(campaign), [observe(run, believed_errors(run)) for run in campaign.runs])
    problem, first = problem.in_si(recalibrate(problem))
    problem.allow_for_tolerances(load_rig(campaign.rig), first.k_b)
    return problem, recalibrate(problem, first)


@dataclass(frozen=True)
class _Library:
    """Candidates."""

    linear: Sequence[Hypothesis]
    laws: Sequence[Hypothesis]  # nonlinear ones


def _explained(
    problem: Problem, nominal: Fit, library: _Library, dependent: bool, progress: Progress | None, clock: _Clock
) -> tuple[Problem, Fit, list[Fit]]:
    """Fit what may explain the runs: nonlinear effects only where levels differ, linear ones unless those suffice.

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

    laws = _not_ruled_out(problem, library.laws)
    found = None if dependent and laws else singles()
    if found and not (laws and _differ_by_level(problem, found.best, laws)):
        problem, fits = _finished(problem, found, library.linear, progress, clock)
        return problem, nominal, fits
    coarser, linear, bent = search_nonlinear(problem, laws, progress)
    clock.lap("nonlinear effects")
    adequate = bool(bent.fits) and _adequate(coarser, bent.best)
    rivalled = found is not None and bool(found.fits) and _adequate(problem, found.best)
    if adequate and not rivalled and bent.nominal.chi2 > _PLAIN * bent.nominal.n_data:
        return coarser, linear, list(bent.fits)
    with_pairs = not (dependent or adequate)
    problem, straight = _finished(problem, found or singles(), library.linear, progress, clock, with_pairs=with_pairs)
    rivals = [fit for fit in (robust_fit(coarser, fit.hypothesis, fit.u) for fit in straight[:POLISHED]) if fit]
    best = max((fit.log_weight for fit in rivals), default=-np.inf)
    clock.lap("linear rivals")
    if not bent.fits or best > bent.fits[0].log_weight:
        return problem, nominal, straight
    return coarser, linear, best_first([*bent.fits, *rivals])


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
    levels: dict[str, set[float | None]] = {}
    for run in problem.runs:
        levels.setdefault(run.support, set()).add(run.force_amplitude_N)
    runs = [r for r, run in enumerate(problem.runs) if len(levels[run.support]) > 1]
    if not runs:
        return False
    quality = judge(problem, fit)
    gain, numbers = problem.score(fit, settled=True).apart(runs)
    gain /= _scale(quality) ** 2
    if gain > numbers + LEVEL_SIGMAS * np.sqrt(2 * numbers) or _excess(problem, fit, quality) >= 1:
        return True
    return most_promised(problem, fit, laws) > 2 * PAIR_GAIN * _scale(quality) ** 2


def _finished(
    problem: Problem,
    found: Search,
    hypotheses: Sequence[Hypothesis],
    progress: Progress | None,
    clock: _Clock,
    *,
    with_pairs: bool = True,
) -> tuple[Problem, list[Fit]]:
    """The problem on the finer mesh; linear effects, best first, and pairs where no single one is adequate."""
    if found.fits and not _adequate(problem, found.best):
        found = with_bent(problem, found, hypotheses)
    fits = list(found.fits) or [found.nominal]
    if with_pairs and found.fits and not _suffices(problem, found.best, hypotheses):
        fits = _with_pairs(problem, found, hypotheses, progress)
        clock.lap("pairs")
    finer = problem.made(refined=True)
    return finer, best_first([*all_polished(finer, fits[:POLISHED]), *fits[POLISHED:]])


def _suffices(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis]) -> bool:
    """Whether a single effect leaves noise, of which no second one takes away much."""
    quality = judge(problem, fit)
    if _excess(problem, fit, quality) >= 1:
        return False
    return most_left(problem, fit, hypotheses) < 2 * PAIR_GAIN * _scale(quality) ** 2


def _amplitude_dependent(findings: Sequence[Finding]) -> bool:
    """Whether the audit saw runs at different levels differ by more than their noise; too few lines are no finding."""
    seen = (finding for finding in findings if finding.check == "level" and finding.severity != "ok")
    return any(finding.value is not None for finding in seen)


class _Clock:
    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self._last = now - self._last, now


def _with_pairs(
    problem: Problem, found: Search, hypotheses: Sequence[Hypothesis], progress: Progress | None
) -> list[Fit]:
    """Singles and pairs, best first; a pair counts only where it earns its evidence."""
    twos = pairs(problem, found, hypotheses, progress)
    if twos and not any(_adequate(problem, fit) for fit in (found.best, twos[0])):
        twos = best_first([*twos, *exchanged(problem, twos[0], hypotheses, not found.rough, progress)])
    alone = [fit for pair in twos[:_TAKEN_APART] for fit in each_alone(problem, pair, hypotheses)]
    singles = {fit.hypothesis: fit for fit in sorted((*found.fits, *alone), key=lambda fit: fit.log_weight)}
    scale = _scale(judge(problem, max([*singles.values(), *twos], key=lambda fit: fit.log_weight)))
    best = max(fit.log_evidence(scale) for fit in singles.values())
    earned = (pair for pair in twos if pair.log_evidence(scale) > best + PAIR_GAIN)
    return best_first([*singles.values(), *earned])


def _scale(quality: Adequacy) -> float:
    """True over believed error, where the data's own scatter contradicts the given errors."""
    low, high = BELIEVED_SCALE
    return 1.0 if low <= quality.scale <= high else quality.scale


def nuisance_size(problem: Problem, fit: Fit) -> float:
    """Mean square of the nuisances in units of their priors, over those that the data determine."""
    covariance = fit.covariance()[len(fit.u) :, len(fit.u) :]
    prior = fit.prior_std**2
    told = np.clip(1 - covariance.diagonal() / prior, 0.0, 1.0)
    told[problem.nuisances.gain] = [
        0.0 if run.quantity == "acceleration" else t
        for run, t in zip(problem.runs, told[problem.nuisances.gain], strict=True)
    ]
    freedom = max(float(told.sum()), 1.0)
    return float(np.sum(told * fit.nu**2 / prior)) / freedom


def _adequate(problem: Problem, fit: Fit) -> bool:
    return _excess(problem, fit, judge(problem, fit)) < 1


def _excess(problem: Problem, fit: Fit, quality: Adequacy) -> float:
    """How far a fit is from leaving nothing but noise: 1 at the threshold of adequacy."""
    if nonlinear(fit.effects):
        return fit.chi2 / fit.n_data / min(_scale(quality), MOST_SCALE) ** 2 / ADEQUATE_NONLINEAR
    return max(
        (quality.misfit - 1) / max(ADEQUATE_MISFIT - 1, ADEQUATE_SPREAD * quality.spread),
        quality.correlation / ADEQUATE_CORRELATION,
        nuisance_size(problem, fit) / ADEQUATE_NUISANCE,
        0.0,
    )


def _passed_over(problem: Problem, nominal: Fit, fit: Fit, quality: Adequacy) -> float:
    """What resonances and shapes of each run's own would still take away beside a linear cause: 1 at the threshold.

    Whatever acts on a linear rotor shows in these, also where no effect of the library resembles it. It counts where it
    is more than noise gives them, and more than a small share of what the cause takes away.
    """
    if nonlinear(fit.effects):
        return 0.0
    score, runs = problem.score(fit, settled=True), range(len(problem.runs))
    scale2, explained = max(quality.scale, 1.0) ** 2, max(nominal.cost - fit.cost, 1.0)
    excesses = [0.0]
    for shapes in (False, True):
        gain, n = score.apart(runs, shapes=shapes)
        if n:
            chance = (gain / scale2 - n) / float(chi2.isf(PASSED_OVER_CHANCE, n) - n)
            excesses.append(min(chance, (gain - n * scale2) / explained / PASSED_OVER_SHARE))
    return max(excesses)


def _standing(problem: Problem, nominal: Fit, fits: Sequence[Fit]) -> _Standing:
    """How far the best fit is to be believed.

    An effect whose law or shape is not quite the library's leaves more than noise, and yet a small share of what
    anything else leaves. It is believed then, unless one of its numbers would leave its range, and pairs that patch
    it up are no answer.
    """
    quality = judge(problem, fits[0])
    excess = _excess(problem, fits[0], quality)
    if excess < 1:
        return _Standing(fits, quality, max(excess, _passed_over(problem, nominal, fits[0], quality)))
    singles = [fit for fit in fits if len(fit.hypothesis.terms) == 1]
    if not singles or singles[0].wants_more:
        return _Standing(fits, quality, excess)
    beside = _beside_rivals(problem, nominal, singles)
    if beside < 1:
        return _Standing(singles, judge(problem, singles[0]), beside, other_form=True)
    return _Standing(fits, quality, min(excess, beside))


def _beside_rivals(problem: Problem, nominal: Fit, singles: Sequence[Fit]) -> float:
    """What the best effect leaves over what the best other one leaves, or none at all: 1 at the threshold."""
    best = singles[0]
    rivals = [nominal, *(fit for fit in singles if fit.hypothesis.ids != best.hypothesis.ids)]
    if nonlinear(best.effects):
        return _left(best) / min(map(_left, rivals)) / FORM_LEFT_NONLINEAR
    return _left(best) / min(map(_left, [*rivals, strained(problem, best)])) / FORM_LEFT


def _left(fit: Fit) -> float:
    """Misfit beyond the noise's, and strain of the nuisances, per value."""
    return (max(fit.chi2 - fit.n_data, 0.0) + fit.penalty) / fit.n_data


def _rank(problem: Problem, nominal: Fit, standing: _Standing) -> _Ranked:
    """Probabilities by evidence, which is sampled where it matters."""
    scale, fits = _scale(standing.quality), [fit for fit in standing.fits if fit.hypothesis.terms]
    ranked = _by_evidence(nominal, fits, scale)
    matters = [p >= _WORTH_SAMPLING and k < _SAMPLED for k, p in enumerate(ranked.probabilities)]
    fits = [
        replace(fit, sampled=sample(problem, fit, scale)) if one else fit
        for fit, one in zip(ranked.fits, matters, strict=True)
    ]
    return _by_evidence(nominal, fits, scale)


def _by_evidence(nominal: Fit, fits: Sequence[Fit], scale: float) -> _Ranked:
    """Candidates by probability; the nominal model has its own prior."""
    single = [fit.log_evidence(scale) + np.log(fit.hypothesis.prior * (1 - NO_GAP_PRIOR)) for fit in fits]
    every = np.array([*single, nominal.log_evidence(scale) + np.log(NO_GAP_PRIOR)])
    share = np.exp(every - logsumexp(every))
    order = np.argsort(-share[:-1], kind="stable")
    return _Ranked(tuple(fits[k] for k in order), tuple(float(share[k]) for k in order), float(share[-1]))


def _verdict(problem: Problem, nominal: Fit, ranked: _Ranked, standing: _Standing) -> Verdict:
    if ranked.no_gap > 0.5:
        return "no_gap" if _adequate(problem, nominal) and standing.excess < 1 else "unknown"
    if standing.excess >= 1:
        return "unknown"
    return "cause" if max(map(_together, _by_name(ranked).values())) >= SURE else "ambiguous"


_Places = list[tuple[Fit, float]]  # fits of the same effects with their probabilities, best first


def _by_name(ranked: _Ranked) -> dict[tuple[str, ...], _Places]:
    """The places of each set of effects, the most probable set first."""
    groups: dict[tuple[str, ...], _Places] = {}
    for fit, probability in zip(ranked.fits, ranked.probabilities, strict=True):
        groups.setdefault(_name(fit.hypothesis.ids), []).append((fit, probability))
    return dict(sorted(groups.items(), key=lambda group: -_together(group[1])))


def _best(ranked: _Ranked) -> Fit:
    """The most probable effects where they fit best."""
    return next(iter(_by_name(ranked).values()))[0][0]


def _name(effects: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted(effects))


def _together(places: _Places) -> float:
    """Probability of some effects, wherever they are."""
    return sum(probability for _, probability in places)


def _likely(places: _Places) -> _Places:
    """The fewest places, of at most three, that hold nearly all of their probability."""
    reached = np.cumsum([probability for _, probability in places]) / max(_together(places), 1e-300)
    return places[: min(int(np.searchsorted(reached, ANSWERED)) + 1, AT_MOST)]


# -- putting it together ---------------------------------------------------------------------------


def _report(
    campaign: Campaign,
    whole: Problem,
    problem: Problem,
    nominal: Fit,
    ranked: _Ranked,
    standing: _Standing,
    verdict: Verdict,
    findings: tuple[Finding, ...],
    exclude: Sequence[str],
    confirm: Confirm | None,
    clock: _Clock,
) -> Outcome:
    scale, excess = _scale(standing.quality), standing.excess
    named = verdict == "no_gap" and "coarse_grid" not in exclude and _is_coarse(campaign, findings)
    raster = _raster(ranked.no_gap) if named else None
    doubt = excess**2 / (1 + excess**2)  # 0 where nothing but noise is left, 1/2 at the threshold
    causes = _causes(problem, ranked, scale, 1 - doubt if verdict == "unknown" else 1.0)
    if raster is not None:
        verdict, causes = "cause", (raster, *causes)
    best = nominal if verdict not in ("cause", "ambiguous") or raster is not None else _best(ranked)
    drawn = problem.on_all_lines_of(whole)
    believed = drawn.bare(nominal)
    corrected = drawn.predict(best)
    where = locate(drawn, nominal, believed, _regime(verdict, causes, findings))
    clock.lap("where")
    shrink: Shrink | None = None
    if verdict in ("cause", "ambiguous") and raster is None:
        shrink = measure_shrink(problem, nominal, best, scale, confirm)
        clock.lap("held out")
    equivalent = _equivalent(causes) if verdict == "ambiguous" else ()
    rivals = _rivals(ranked, causes, verdict, equivalent)
    curves = tuple(
        Curve(o.run, H0, H1 if best is not nominal or verdict == "no_gap" else None, o.error)
        for o, H0, H1 in zip(drawn.observed, believed, corrected, strict=True)
    )
    gap = float(np.nanmean([nrmse(c.run.H, c.run.as_recorded(c.nominal)) for c in curves]))
    diagnosis = Diagnosis(
        title=campaign.title,
        rig=Path(campaign.rig).name,
        verdict=verdict,
        sentence="",
        nominal={
            "k_b": _k_b(problem, nominal, scale),
            "gap": gap,
            "gap_dB": float(np.mean([log_distance_db(c.run.H, c.nominal) for c in curves])),
            "misfit": judge(problem, nominal).misfit,
            "probability": ranked.no_gap,
            **{key: getattr(campaign.nominal, key) for key in DAMPING},
        },
        where=where,
        causes=causes,
        equivalent=equivalent,
        next_test=(best_next_test(problem, rivals) if len(rivals) > 1 else None)
        or wording.next_test(verdict, campaign, causes, equivalent),
        shrink=shrink,
        audit=(*findings, *_noise_finding(problem, standing.quality)),
        excluded=tuple(exclude),
        unknown_score=doubt,
        calibration=calibration(problem, best),
        timing_s=clock.laps,
    )
    return Outcome(replace(diagnosis, sentence=wording.sentence(diagnosis)), curves)


def _rivals(ranked: _Ranked, causes: Sequence[Cause], verdict: Verdict, equivalent: Sequence[Cause]) -> list[Fit]:
    """What the next test should tell apart: causes, or else the places of the one that is named."""
    groups = _by_name(ranked)
    if equivalent:
        return [groups[_name(cause.effects)][0][0] for cause in equivalent]
    if verdict == "cause" and causes[0].place_probability < SURE:
        return [fit for fit, _ in _likely(groups[_name(causes[0].effects)])]
    return []


def _k_b(problem: Problem, fit: Fit, scale: float) -> Estimate | None:
    if not problem.with_k_b:
        return None
    return Estimate(fit.k_b, fit.k_b * float(np.sqrt(fit.covariance(scale)[0, 0])), "N/m")


def _causes(problem: Problem, ranked: _Ranked, scale: float, known: float) -> tuple[Cause, ...]:
    """One cause for every set of effects, at its most probable place, with the probability of all its places.

    Parameters
    ----------
    known : probability that it is a known effect, or none, at all
    """
    causes = []
    for places in _by_name(ranked).values():
        total = _together(places)
        (best, probability), *others = _likely(places)
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
        if sum(c.probability for c in chosen) >= ANSWERED * total or len(chosen) == AT_MOST:
            break
        chosen.append(cause)
    return tuple(chosen)


def _regime(verdict: Verdict, causes: Sequence[Cause], findings: Sequence[Finding]) -> Regime:
    """What kind of gap it is: by the family of a cause that is named, or else by whether levels differ."""
    if verdict != "cause":
        return "amplitude_dependent" if _amplitude_dependent(findings) else "linear"
    families = {EFFECTS[name].family for name in causes[0].effects}
    if "nonlinear" in families:
        return "amplitude_dependent"
    return "measurement_chain" if families == {"chain"} else "linear"


def _is_coarse(campaign: Campaign, findings: Sequence[Finding]) -> bool:
    """Whether peaks lie between the lines in half of the runs or more; in fewer, their lines are missing there."""
    coarse = {f.run for f in findings if f.check == "raster" and f.severity in ("warning", "error")}
    return bool(coarse) and 2 * len(coarse) >= len(campaign.runs)


def _raster(no_gap: float) -> Cause:
    """The raster as the cause, as surely as the model is right."""
    return Cause(("coarse_grid",), Location("raster"), no_gap, {}, None, math.nan, locations=(Location("raster"),))


def _form_finding(fit: Fit, standing: _Standing) -> Finding:
    """That a cause leaves more than noise, though far less than anything else."""
    words = (
        f"{' and '.join(fit.hypothesis.ids)} leaves {standing.quality.misfit:.2g} times the noise, far less than "
        "anything else leaves: on this rig it acts in a form that differs from the library's, or something small acts "
        "beside it"
    )
    return Finding("form", "warning", words, "", standing.quality.misfit, ADEQUATE_MISFIT)


def _noise_finding(problem: Problem, quality: Adequacy) -> tuple[Finding, ...]:
    low, high = BELIEVED_SCALE
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
