"""A campaign of which only resonance frequencies survive: what a handful of numbers can and cannot tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from gap.diagnosis import Band, Cause, Diagnosis, Estimate, Finding, Location, NextTest, Where
from gap.forward import Forward
from gap.hypotheses import K_B_RANGE, Hypothesis, candidates
from rotor.effects import Effect
from rotor.model import build_system
from rotor.structure import FloatArray
from sim.campaign import Campaign, PeakList, Run

# Probability of no gap before the data.
_NO_GAP = 0.5

# Points along each free number of an effect, and of ln k_b, at which the evidence is summed.
_GRID, _GRID_K_B = (11, 8, 5), 400

# A resonance of the model that is matched with none of the measured ones costs nothing: a curve need not show it.
# A measured one that the model lacks costs this many standard errors.
_MISSING = 5.0


@dataclass(frozen=True)
class _Scored:
    """A candidate, its evidence, and the best point."""

    hypothesis: Hypothesis
    log_evidence: float
    k_b: float
    u: FloatArray
    chi2: float


def diagnose_peaks(campaign: Campaign, exclude: Sequence[str], findings: tuple[Finding, ...]) -> Diagnosis:
    """Rank what could explain a list of resonances.

    With as many numbers as free parameters every candidate fits: then the answer is which ones remain possible, and
    the verdict "not_enough_data".
    """
    from gap.diagnose import structure_of

    structure = structure_of(campaign.rig, 1)  # a list of peaks is far coarser than any mesh
    forward = Forward(structure, campaign.nominal)
    runs = [_stand_in(peaks) for peaks in campaign.peaks]
    hypotheses = [
        h
        for h in candidates(runs, structure, exclude)
        if h.terms[0].effect.family in ("structure", "support") and h.ids[0] not in ("shaft_damping", "bearing_damping")
    ]
    nominal = _score(forward, campaign.peaks, Hypothesis())
    scored = sorted((_score(forward, campaign.peaks, h) for h in hypotheses), key=lambda s: -s.log_evidence)
    weights = np.array([s.log_evidence + np.log(s.hypothesis.prior * (1 - _NO_GAP)) for s in scored])
    own = nominal.log_evidence + np.log(_NO_GAP)
    top = max(float(weights.max(initial=-np.inf)), own)
    total = float(np.sum(np.exp(weights - top)) + np.exp(own - top))
    no_gap = float(np.exp(own - top)) / total
    causes = _causes(scored, np.exp(weights - top) / total)
    n = sum(len(p.frequencies_hz) for p in campaign.peaks)
    enough = no_gap > 0.9
    leaders = ", ".join(c.effects[0] for c in causes[:3])
    sentence = (
        "The listed resonances agree with the nominal model within their errors: there is nothing to explain."
        if enough
        else f"{n} resonance frequencies differ from the nominal model, but cannot tell one cause from another; "
        f"most probable: {leaders}."
    )
    return Diagnosis(
        title=campaign.title,
        rig=Path(campaign.rig).name,
        verdict="no_gap" if enough else "not_enough_data",
        sentence=sentence,
        nominal={
            "k_b": Estimate(nominal.k_b, float("nan"), "N/m"),
            "gap": float(np.sqrt(nominal.chi2 / max(n, 1))),
            "gap_is": "root mean square difference of the resonances, in their standard errors",
            "probability": no_gap,
            "resonances_Hz": _table(forward, campaign.peaks, nominal),
        },
        where=_where(forward, campaign.peaks, nominal),
        causes=causes,
        equivalent=causes[:3] if not enough else (),
        next_test=NextTest(
            "Record complete frequency responses, with phase, on both supports and at three nodes or more: "
            "shapes and widths tell apart what frequencies cannot.",
            {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 1.0},
        ),
        audit=findings,
        excluded=tuple(exclude),
    )


def _stand_in(peaks: PeakList) -> Run:
    """A run that says which support was measured."""
    from sim.campaign import Channel

    f = peaks.frequencies_hz
    return Run(f, np.ones((len(f), 1), dtype=complex), (Channel(2),), peaks.support)


def _resonances(forward: Forward, peaks: PeakList, k_b: float, effects: Sequence[Effect]) -> FloatArray:
    """Undamped resonances in the exciter's plane up to 1.5 times the highest listed one [Hz]."""
    absent = "bearings" if peaks.support == "rigid" else "rigid_support"
    acting = [e for e in effects if e.location != absent]
    system = build_system(forward.structure, forward.condition(_stand_in(peaks), k_b), acting)
    if not system.couples_planes():
        system = system.in_plane(1)
    f = system.modes.omega / (2 * np.pi)
    return f[(f > 1.0) & (f < 1.5 * peaks.frequencies_hz[-1])]


def _chi2(forward: Forward, lists: Sequence[PeakList], k_b: float, effects: Sequence[Effect]) -> float:
    """Squared differences of every listed resonance from the model's own, matched in order."""
    total = 0.0
    for peaks in lists:
        try:
            f = _resonances(forward, peaks, k_b, effects)
        except (ValueError, np.linalg.LinAlgError):
            return np.inf
        total += _matched(peaks, f)
    return total


def _matched(peaks: PeakList, f: FloatArray) -> float:
    """Cheapest matching in order: resonances of the model may go unseen, listed ones may not."""
    z = (peaks.frequencies_hz[:, None] - f[None, :]) / peaks.std_hz[:, None]
    cost = np.minimum(z**2, _MISSING**2)
    best = np.zeros(len(f) + 1)
    for row in cost:
        taken = best[:-1] + row if len(f) else np.zeros(0)
        after = np.full(len(best), np.inf)
        after[0] = best[0] + _MISSING**2
        for j in range(1, len(best)):
            after[j] = min(after[j - 1], taken[j - 1], best[j] + _MISSING**2)
        best = after
    return float(best[-1])


def _score(forward: Forward, lists: Sequence[PeakList], hypothesis: Hypothesis) -> _Scored:
    """Evidence by a grid over the effect's numbers and, inside, the best and the width in ln k_b."""
    free = hypothesis.free
    grids = [np.linspace(*f.ends, _GRID[len(free) - 1]) for f in free]
    points = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, len(free)) if free else np.zeros((1, 0))
    low, high = (float(np.log(k)) for k in K_B_RANGE)
    best = (np.inf, 1e7, points[0])
    logs = []
    for u in points:
        effects = hypothesis.effects(u)
        coarse = np.linspace(low, high, 25)
        values = [_chi2(forward, lists, float(np.exp(x)), effects) for x in coarse]
        k = int(np.argmin(values))
        lo, hi = coarse[max(k - 1, 0)], coarse[min(k + 1, len(coarse) - 1)]
        if np.isfinite(values[k]):
            found: Any = minimize_scalar(
                lambda x, e=effects: _chi2(forward, lists, float(np.exp(x)), e),
                bounds=(lo, hi),
                method="bounded",
                options={"xatol": 1e-3},
            )
            chi2, x = (float(found.fun), float(found.x)) if found.fun < values[k] else (values[k], float(coarse[k]))
        else:
            chi2, x = np.inf, float(coarse[k])
        # The volume in ln k_b: where the misfit exceeds its least value by less than one.
        inside = np.interp(np.linspace(low, high, _GRID_K_B), coarse, np.minimum(values, 1e6)) < chi2 + 1
        logs.append(-chi2 / 2 + np.log(max(inside.mean(), 1 / _GRID_K_B)))
        if chi2 < best[0]:
            best = (chi2, float(np.exp(x)), u)
    evidence = float(np.logaddexp.reduce(logs) - np.log(len(logs)))
    return _Scored(hypothesis, evidence, best[1], best[2], best[0])


def _causes(scored: Sequence[_Scored], share: FloatArray) -> tuple[Cause, ...]:
    """One cause for every effect at its best place, with the probability of all its places."""
    total: dict[str, float] = {}
    for s, p in zip(scored, share, strict=True):
        total[s.hypothesis.ids[0]] = total.get(s.hypothesis.ids[0], 0.0) + float(p)
    causes, seen = [], set()
    for s in scored:
        name = s.hypothesis.ids[0]
        if name in seen:
            continue
        seen.add(name)
        term = s.hypothesis.terms[0]
        parameters = {}
        position, node = None, None
        for free, u in zip(term.free, s.u, strict=True):
            low, high = free.ends
            unit = "m" if free.name == "position" else term.effect.parameters()[free.name].unit
            value = free.value(u)
            spread = (high - low) / np.sqrt(12) * (value if free.log else 1.0)
            parameters[free.name] = Estimate(value, float(abs(spread)), unit)
            position = value if free.name == "position" else position
        for key, value in term.fixed:
            node = int(value) if key == "node" else node
        location = Location(term.effect.location, node, position)  # type: ignore[arg-type]
        causes.append(
            Cause(
                (name,),
                location,
                total[name],
                parameters,
                Estimate(s.k_b, float("nan"), "N/m"),
                s.log_evidence,
                locations=(location,),
                places={f"{name}.{k}": v for k, v in term.fixed},
            )
        )
    return tuple(sorted(causes, key=lambda c: -c.probability))


def _table(forward: Forward, lists: Sequence[PeakList], best: _Scored) -> dict[str, list[float]]:
    effects = best.hypothesis.effects(best.u)
    return {peaks.support: [float(f) for f in _resonances(forward, peaks, best.k_b, effects)] for peaks in lists}


def _where(forward: Forward, lists: Sequence[PeakList], nominal: _Scored) -> Where:
    """Each support's share of the misfit, and each listed resonance's."""
    supports, bands = {}, []
    for peaks in lists:
        f = _resonances(forward, peaks, nominal.k_b, ())
        supports[peaks.support] = _matched(peaks, f)
        for listed, std in zip(peaks.frequencies_hz, peaks.std_hz, strict=True):
            off = min(float(np.min(np.abs(f - listed)) / std) if len(f) else _MISSING, _MISSING)
            bands.append((float(listed - 2 * std), float(listed + 2 * std), off**2))
    total, across = sum(supports.values()), sum(b[2] for b in bands)
    return Where(
        bands=tuple(Band(lo, hi, None, size / across if across else 1 / len(bands)) for lo, hi, size in bands),
        supports={k: v / total if total else 1 / len(supports) for k, v in supports.items()},
        remark="resonance frequencies alone: no place can be told",
    )
