"""The page of a diagnosis: verdict, responses, place of the gap, candidates, shrink, next test, audit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rigtwin.gap.curves import Curve, nrmse
from rigtwin.gap.document import Calibration, Cause, Diagnosis, Finding, Shrink, Where
from rigtwin.gap.phrases import part
from rigtwin.pages.diagnosis_figures import (
    bearings_figure,
    candidate_figure,
    first_choice,
    foremost,
    gap_map,
    gap_map_figure,
    joint_figure,
    law_figure,
    map_width,
    peaks_figure,
    response_figure,
    responses,
    shrink_figure,
)
from rigtwin.pages.diagnosis_words import (
    NO_CAUSE,
    REGIMES,
    VERDICTS,
    VERIFIED,
    at_edge,
    best_k_b,
    calibrated_row,
    calibration_words,
    cause_key,
    cause_title,
    explained,
    finite,
    gap_before,
    k_b_interval,
    k_b_words,
    meanings,
    parameters,
    places,
    repeatability_row,
    run_toml,
    share,
    title,
)
from rigtwin.pages.figures import rotor_drawing
from rigtwin.pages.page import json_in_html, write_page
from rigtwin.pages.places import pointed_at
from rigtwin.pages.provenance import provenance
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.sim.campaign import Campaign
from rigtwin.wording import stiffness, with_error

FILE_NAME = "report.html"

_SEVERITIES = ("error", "warning", "note", "ok")
_MARKS = {"ok": "✓", "note": "i", "warning": "!", "error": "×"}

# Effects explained beneath an ambiguous verdict; the list of candidates has all.
_MEANINGS = 5

_NO_CURVES = "No response was computed: there is no run to compare with."


class KeyFigure(NamedTuple):
    """One number beneath the verdict."""

    label: str
    value: str
    below: str


class CauseRow(NamedTuple):
    """A candidate in the list."""

    title: str
    place: str
    probability: str
    parameters: list[str]
    k_b: str
    log_evidence: str  # beside the first one's
    ess: str
    remarks: list[str]


def write_diagnosis_page(diagnosis: Diagnosis, curves: Sequence[Curve], campaign: Campaign, path: Path) -> Path:
    """Write the page; an existing one is replaced only when the new one is complete.

    Parameters
    ----------
    diagnosis : what was found
    curves : each measured run beside its models; none of a campaign of resonance lists
    campaign : what was measured
    path : of the page
    """
    rig = load_rig(campaign.rig)
    pointed = pointed_at(diagnosis, rig, [run.excitation_node for run in campaign.runs])
    return write_page(
        "diagnosis.html",
        path,
        title=campaign.title or diagnosis.title or rig.title or rig.name,
        d=diagnosis,
        verdict=VERDICTS[diagnosis.verdict],
        key_figures=_key_figures(diagnosis, curves),
        meanings=_meanings(diagnosis),
        rig=rig,
        drawing=rotor_drawing(rig, pointed.rings_m),
        pointed=pointed.words,
        **_response_content(curves, diagnosis),
        **_peak_content(diagnosis, campaign),
        where=_where_rows(diagnosis.where, diagnosis.audit),
        with_runs=bool(curves),
        **_candidate_content(diagnosis),
        joint=joint_figure(diagnosis.where.joint) if diagnosis.where.joint else None,
        law=law_figure(diagnosis.measured_joint) if diagnosis.measured_joint else None,
        bearings=bearings_figure(diagnosis.where.bearings, _WITH_EFFECT[0]) if diagnosis.where.bearings else None,
        **_shrink_content(diagnosis.shrink),
        **_calibration_content(diagnosis),
        toml=run_toml(diagnosis.next_test.run) if diagnosis.next_test and diagnosis.next_test.run else "",
        audit=_audit_rows(diagnosis.audit),
        share=share,
        provenance=_provenance(diagnosis, campaign, rig),
    )


# -- verdict ---------------------------------------------------------------------------------------


def _key_figures(diagnosis: Diagnosis, curves: Sequence[Curve]) -> list[KeyFigure]:
    """Gap before, after and floor, stiffness, probability: those there are."""
    figures, shrink = [], diagnosis.shrink
    before, decibel = gap_before(diagnosis), diagnosis.nominal.get("gap_dB")
    in_decibel = f"; magnitudes differ by {decibel:.2g} dB" if finite(decibel) else ""
    if diagnosis.verdict == "no_gap" and curves:
        figures += _nothing_left(curves, before, in_decibel)
    elif finite(before):
        data = "nominal model, held-out data" if shrink else "recalibrated nominal model"
        figures.append(KeyFigure("Gap before" if shrink else "Gap", share(before), data + in_decibel))
    if shrink and finite(shrink.after):
        figures.append(KeyFigure("Gap after", share(shrink.after), "with the effect, held-out data"))
    if shrink and finite(shrink.floor):
        figures.append(KeyFigure("Noise floor", share(shrink.floor), "what noise alone gives"))
    k_b = best_k_b(diagnosis)
    if k_b and finite(k_b.value):
        of = "of the nominal model, " if diagnosis.verdict in ("unknown", "not_enough_data") else ""
        value = f"{stiffness(k_b.value)} MN/m"
        figures.append(KeyFigure("Bearing stiffness k_b", value, f"{of}90 % interval {k_b_interval(k_b)}"))
    if diagnosis.names_a_cause:
        best = diagnosis.causes[0]
        figures.append(KeyFigure("Probability", part(best.probability), cause_title(best)))
    elif diagnosis.nominal.get("peaks") and finite(diagnosis.nominal.get("probability")):
        words = "of the nominal model, peaks that it lacks being foreign"
        figures.append(KeyFigure("Probability", part(diagnosis.nominal["probability"]), words))
    elif diagnosis.verdict == "no_gap" and finite(diagnosis.nominal.get("probability")):
        figures.append(KeyFigure("Probability", part(diagnosis.nominal["probability"]), "that there is no gap"))
    elif diagnosis.verdict == "unknown" and diagnosis.unknown_score is not None and finite(diagnosis.unknown_score):
        figures.append(KeyFigure("Unknown score", f"{diagnosis.unknown_score:.2f}", "0: a known effect fits; 1: none"))
    return figures


def _nothing_left(curves: Sequence[Curve], before: float | None, in_decibel: str) -> list[KeyFigure]:
    """What the test's own gains and drifts leave of the gap, the noise, and what they take."""
    left = [nrmse(c.run.H, c.run.as_recorded(c.corrected)) for c in curves if c.corrected is not None]
    noise = [nrmse(c.run.H, c.run.H + c.std) for c in curves]
    found = (
        ("Gap", float(np.mean(left)) if left else before, "gains and drifts of this test allowed for"),
        ("Noise floor", float(np.mean(noise)), "what noise alone gives"),
        ("Gains and drifts", before, "difference that they make" + in_decibel),
    )
    return [KeyFigure(label, share(value), below) for label, value, below in found if finite(value)]


def _meanings(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """What the verdict names: title, place, meaning, size."""
    if not diagnosis.names_a_cause:
        return []
    several = diagnosis.equivalent if diagnosis.verdict == "ambiguous" else ()
    return [
        {
            "title": cause_title(cause),
            "place": places(cause),
            "meaning": "; ".join(text for _, text in meanings(cause)),
            "size": ", ".join(parameters(cause)),
        }
        for cause in (several or diagnosis.causes[:1])[:_MEANINGS]
    ]


# -- responses and place ---------------------------------------------------------------------------


# What the corrected model of a diagnosis is called.
_WITH_EFFECT = ("with the effect", "the same with the effect")
_CORRECTED_AS = {
    "no_gap": ("nominal, with gains and drifts", "the same with the gains and drifts of this test"),
    "unknown": ("with the fitted joint", "the same with the fitted joint"),
}


def _response_content(curves: Sequence[Curve], diagnosis: Diagnosis) -> dict[str, Any]:
    """Figures and data of the measured runs; nothing of a campaign that has none."""
    if not curves:
        return {"response": None, "gap_map": None, "no_curves": _NO_CURVES}
    where = diagnosis.where
    name, words = _CORRECTED_AS.get(diagnosis.verdict, _WITH_EFFECT)
    cells = gap_map(curves, where.bands)
    data = {"runs": responses(curves), "first": first_choice(curves)}
    return {
        "no_curves": "",
        "response": response_figure(curves, where.bands, name),
        "response_data": json_in_html(data),
        "magnitudes_only": [curve.run.name for curve in curves if curve.run.magnitude_only],
        "corrected": any(curve.corrected is not None for curve in curves),
        "corrected_words": words,
        "gap_map": gap_map_figure(cells, name),
        "map_width": map_width(cells),
    }


def _where_rows(where: Where, audit: Sequence[Finding]) -> list[tuple[str, str]]:
    """The gap's shares in words."""
    if not (where.bands or where.supports or where.nodes or where.levels):
        return []
    differ = any(finding.check == "level" and finding.severity != "ok" for finding in audit)
    words = REGIMES["amplitude_dependent" if where.regime == "linear" and differ else where.regime]
    words = "one level was measured" if len(where.levels) < 2 and where.regime == "linear" else words
    rows = [("By force level", words)] if where.levels or where.regime != "linear" else []
    rows += _shares("Supports", ((name, value) for name, value in where.supports.items()))
    rows += _shares("Nodes", ((f"node {n.node}", n.share) for n in where.nodes))
    if len(where.levels) > 1:
        rows += _shares("Force levels", ((f"{level} N", value) for level, value in where.levels.items()))
    return rows if where.regime in ("linear", "amplitude_dependent") else [("Kind", words), *rows[1:]]


def _shares(name: str, parts: Iterable[tuple[str, float]]) -> list[tuple[str, str]]:
    """'node 2 40 %, node 4 35 %', the largest first; empty without parts."""
    known = sorted(((label, value) for label, value in parts if finite(value)), key=lambda part: -part[1])
    return [(name, ", ".join(f"{label}: {part(value)}" for label, value in known))] if known else []


def _peak_content(diagnosis: Diagnosis, campaign: Campaign) -> dict[str, Any]:
    """Listed resonances beside the models'; the lists alone where no model was compared with them."""
    rows = diagnosis.nominal.get("peaks") or []
    best = cause_title(diagnosis.causes[0]) if diagnosis.causes else ""
    lists = [(p.support, ", ".join(map(with_error, p.frequencies_hz, p.std_hz))) for p in campaign.peaks]
    table = [
        (row["support"], with_error(row["listed_Hz"], row["std_Hz"]), _hertz(row["nominal_Hz"]), _hertz(row["best_Hz"]))
        for row in rows
    ]
    return {
        "peak_rows": table or lists,
        "peak_header": ("support", "listed, Hz", "nominal model, Hz", f"{best}, Hz")
        if table
        else ("support", "peaks, Hz"),
        "peaks": peaks_figure(rows, best) if rows else None,
        "peak_fits": [
            (name, *_fit_row(diagnosis.nominal[key]))
            for name, key in (("nominal model", "fit"), (best, "best_fit"))
            if diagnosis.nominal.get(key)
        ],
    }


def _hertz(value: float | None) -> str:
    return f"{value:.1f}" if value is not None and finite(value) else "none"


def _fit_row(fit: Mapping[str, Any]) -> tuple[str, ...]:
    p = fit["p_value"]
    tested = "cannot be tested" if not finite(p) else "under 0.0001" if p < 1e-4 else f"{p:.2g}"
    counts = (str(fit[key]) for key in ("matched", "unmatched", "not_listed", "parameters"))
    return (*counts, f"{fit['chi2']:.1f}", str(fit["degrees_of_freedom"]), tested)


# -- candidates --------------------------------------------------------------------------------------


def _candidate_content(diagnosis: Diagnosis) -> dict[str, Any]:
    causes, rows = diagnosis.causes, _cause_rows(diagnosis)
    first = foremost(causes)
    drawn = any(cause.probability >= 1e-3 for cause in causes)  # bars that can be seen
    why_none = NO_CAUSE.get(diagnosis.verdict, "") if causes else "No cause is named."
    return {
        "no_cause": "" if diagnosis.names_a_cause else why_none,
        "candidates": candidate_figure(causes, diagnosis.equivalent, named=diagnosis.names_a_cause) if drawn else None,
        "edge": any(cause.at_prior_edge for cause in causes[:first]),
        "cause_rows": rows[:first] or rows,
        "other_rows": rows[first:] if first else [],
        "with_ess": any(row.ess for row in rows),
    }


def _cause_rows(diagnosis: Diagnosis) -> list[CauseRow]:
    """All candidates, and those of the equivalent set that the ranking lacks."""
    same = {cause_key(cause) for cause in diagnosis.equivalent}
    ranked = {cause_key(cause) for cause in diagnosis.causes}
    causes = [*diagnosis.causes, *(cause for cause in diagnosis.equivalent if cause_key(cause) not in ranked)]
    best = max((cause.log_evidence for cause in causes if finite(cause.log_evidence)), default=0.0)
    return [_cause_row(cause, best, cause_key(cause) in same) for cause in causes]


def _cause_row(cause: Cause, best: float, same: bool) -> CauseRow:
    remarks = ["not told apart from the others marked so"] if same else []
    remarks += [at_edge(cause)] if cause.at_prior_edge else []
    behind = cause.log_evidence - best
    return CauseRow(
        title=cause_title(cause),
        place=places(cause),
        probability=part(cause.probability),
        parameters=parameters(cause),
        k_b=k_b_words(cause.k_b),
        log_evidence=_behind(behind),
        ess=f"{cause.ess:.0f}" if cause.ess is not None and finite(cause.ess) else "",
        remarks=remarks,
    )


def _behind(value: float) -> str:
    """'−6.5', 'below −1000': logarithms beside the best one's."""
    if not finite(value):
        return ""
    text = f"{value:.1f}" if value > -100 else f"{value:.0f}" if value > -1000 else "below -1000"
    return text.replace("-", "−")


# -- shrink, audit, foot -----------------------------------------------------------------------------


def _shrink_content(shrink: Shrink | None) -> dict[str, Any]:
    if shrink is None:
        return {"shrink": None, "explained": "", "verified": ""}
    drawable = any(map(finite, (shrink.before, shrink.after, shrink.floor)))
    return {
        "shrink": shrink_figure(shrink) if drawable else None,
        "explained": explained(shrink),
        "verified": VERIFIED[shrink.verified_by],
    }


def _calibration_content(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the nominal model takes, and what the one with the effect takes, beside what was known before."""
    own, nominal = diagnosis.calibration, diagnosis.nominal.get("calibration")
    models = [nominal, own] if diagnosis.names_a_cause and nominal is not None else [own]
    return {
        "calibrated": _calibrated_rows(models, "numbers", calibrated_row),
        "calibrated_gains": _calibrated_rows(models, "gains", calibrated_row),
        "repeatability": _calibrated_rows(models, "repeatability", repeatability_row),
        "calibrated_models": ("nominal model", _WITH_EFFECT[0])[: len(models)],
        "calibration_words": calibration_words(own.numbers) if own.numbers else "",
    }


def _calibrated_rows(models: Sequence[Calibration], kind: str, row: Callable[..., tuple[str, ...]]) -> list[tuple]:
    """One row for each number of the last model, with what every model takes."""
    by_name = [{each.name: each.posterior for each in getattr(model, kind)} for model in models]
    return [row(each, *(found.get(each.name) for found in by_name)) for each in getattr(models[-1], kind)]


def _audit_rows(audit: Sequence[Finding]) -> list[dict[str, str]]:
    """The findings, the gravest first."""
    ranked = sorted(audit, key=lambda finding: _SEVERITIES.index(finding.severity))
    return [
        {
            "severity": finding.severity,
            "mark": _MARKS[finding.severity],
            "check": finding.check.replace("_", " "),
            "run": finding.run,
            "words": finding.words,
            "numbers": _numbers(finding),
        }
        for finding in ranked
    ]


def _numbers(finding: Finding) -> str:
    """'0.31, limit 0.2'."""
    parts: Mapping[str, float | None] = {"found": finding.value, "limit": finding.limit}
    return ", ".join(f"{name} {value:.3g}" for name, value in parts.items() if value is not None and finite(value))


def _provenance(diagnosis: Diagnosis, campaign: Campaign, rig: Rig) -> dict[str, str]:
    excluded = ", ".join(f"{title(effect)} ({effect})" for effect in diagnosis.excluded)
    facts = {
        "campaign": campaign.title or "without a title",
        "rig": f"{rig.title} ({rig.name})" if rig.title else rig.name,
        "effects left out": excluded or "none",
    }
    if diagnosis.timing_s:
        facts["computing time"] = ", ".join(f"{step} {time:.1f} s" for step, time in diagnosis.timing_s.items())
    return facts | provenance()
