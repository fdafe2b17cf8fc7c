"""What lists of resonances say of the gap, in the form of every diagnosis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rigtwin.gap.answer.causes import cause_of
from rigtwin.gap.document import Band, Diagnosis, Finding, NextTest, Where
from rigtwin.gap.peaks.lists import Lists
from rigtwin.gap.peaks.ranking import Ranking, Scored, rank
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.sim.campaign import Campaign

# Candidates that are at least so probable beside the first are not told apart from it.
_RIVAL = 0.05


def diagnose_peaks(campaign: Campaign, exclude: Sequence[str], findings: tuple[Finding, ...]) -> Diagnosis:
    """Rank what could explain a list of resonances.

    A few frequencies never prove a cause: the verdict is "no_gap" or "not_enough_data".
    """
    lists = Lists(campaign)
    return diagnosis_of(campaign, lists, rank(lists, exclude), exclude, findings)


def diagnosis_of(
    campaign: Campaign, lists: Lists, ranking: Ranking, exclude: Sequence[str] = (), findings: tuple[Finding, ...] = ()
) -> Diagnosis:
    """What a ranking says, in the form of every diagnosis."""
    nominal = ranking.nominal
    causes = tuple(
        cause_of(s.hypothesis, s.u, s.std, p, s.k_b, s.log_evidence)
        for s, p in zip(ranking.scored, ranking.probabilities, strict=True)
    )
    agrees = ranking.no_gap > THRESHOLDS.sure and nominal.adequate and nominal.n_unseen == 0
    return Diagnosis(
        title=campaign.title,
        rig=Path(campaign.rig).name,
        verdict="no_gap" if agrees else "not_enough_data",
        sentence=_sentence(lists, ranking, agrees=agrees),
        nominal={
            "k_b": nominal.k_b,
            "gap": None,
            "probability": ranking.no_gap,
            "peaks": list(_rows(ranking)),
            "fit": _fit(nominal),
            "best_fit": _fit(ranking.scored[0]) if ranking.scored else None,
        },
        where=_where(nominal),
        causes=causes,
        equivalent=() if agrees else tuple(c for c in causes if c.probability > _RIVAL * causes[0].probability),
        next_test=None if agrees else _next_test(lists, ranking),
        audit=findings,
        excluded=tuple(exclude),
    )


def _fit(scored: Scored) -> dict[str, Any]:
    """How well a model matches the lists, in numbers."""
    return {
        "chi2": scored.chi2,
        "degrees_of_freedom": scored.freedom,
        "p_value": scored.p_value,
        "matched": scored.n_matched,
        "unmatched": scored.n_foreign,
        "not_listed": scored.n_unseen,
        "parameters": scored.n_parameters,
        "determined": scored.determined,
    }


def _rows(ranking: Ranking) -> Iterator[dict[str, Any]]:
    """Every listed peak beside the resonance of the nominal model and of the most probable candidate."""
    names = ("listed_Hz", "std_Hz", "nominal_Hz", "best_Hz")
    best = ranking.scored[0].matches if ranking.scored else ranking.nominal.matches
    for own, other in zip(ranking.nominal.matches, best, strict=True):
        peaks = own.peaks
        for row in zip(peaks.frequencies_hz, peaks.std_hz, own.model_hz, other.model_hz, strict=True):
            yield {"support": peaks.support, **dict(zip(names, row, strict=True))}


def _sentence(lists: Lists, ranking: Ranking, *, agrees: bool) -> str:
    """The verdict in a sentence."""
    nominal, n = ranking.nominal, lists.n_peaks
    if agrees:
        return f"The {n} listed resonances are the nominal model's within their errors: there is nothing to explain."
    if nominal.adequate and nominal.n_unseen == 0:
        return f"The nominal model meets the {n} listed resonances, but so do others: {n} numbers do not decide."
    fault = f"{nominal.n_foreign} of {n} listed resonances have no counterpart in the nominal model"
    if nominal.adequate:
        fault = f"the nominal model has {nominal.n_unseen} resonances in the tested range that nobody listed"
    elif not nominal.n_foreign:
        fault = f"the nominal model misses the {n} listed resonances (chi-squared {nominal.chi2:.3g})"
    if not ranking.scored:
        return f"{fault[0].upper()}{fault[1:]}; no effect of the library is left to explain it."
    return f"{fault[0].upper()}{fault[1:]}, even with its best k_b; {n} numbers cannot tell which effect is the cause."


def _next_test(lists: Lists, ranking: Ranking) -> NextTest:
    """Complete responses; across the force too, where a leading candidate moves the rotor across it."""
    leaders = [s for s, p in zip(ranking.scored, ranking.probabilities, strict=True) if p > 0.01] or ranking.scored[:1]
    across = any(term.effect.couples_planes for s in leaders for term in s.hypothesis.terms)
    node = lists.rotor.node
    words = (
        f"Record complete frequency responses, with phase, on both supports, at three nodes or more, driven at {node}"
    )
    words += (
        ", and on bearings also across the force: bearings that differ in two directions move the rotor across it, "
        "nothing else in the list does."
        if across
        else ": shapes and widths tell apart what frequencies cannot."
    )
    return NextTest(words, {"support": "bearing", "excitation_node": node, "force_amplitude_N": 1.0})


def _where(nominal: Scored, unmatched: float = 5.0) -> Where:
    """Each support's and each listed peak's share of the misfit.

    unmatched : standard errors that a peak without a counterpart counts as
    """
    sizes: dict[str, float] = {"rigid": 0.0, "bearing": 0.0}
    bands: list[tuple[float, float, float]] = []
    for match in nominal.matches:
        for listed, std, z in zip(match.peaks.frequencies_hz, match.peaks.std_hz, match.residuals, strict=True):
            size = unmatched**2 if z is None else z**2
            sizes[match.peaks.support] = sizes.get(match.peaks.support, 0.0) + size
            bands.append((float(listed - 2 * std), float(listed + 2 * std), size))
    total = sum(sizes.values()) or 1.0
    return Where(
        bands=tuple(Band(lo, hi, None, size / total) for lo, hi, size in bands),
        supports={name: size / total for name, size in sizes.items()},
        remark="Resonance frequencies alone: no place can be told.",
    )
