"""Size of an effect in a campaign, over the smallest that could be seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigtwin.blind.generate.case import Case, Run, plan_lines, response
from rigtwin.blind.generate.detection import THRESHOLD, severity_at_limit
from rigtwin.blind.generate.effects import CHAIN, LINEAR, Effect, faded
from rigtwin.blind.generate.lines import resonances
from rigtwin.blind.generate.nonlinear import STEPPED
from rigtwin.blind.generate.response import N_DRIFTING, chain_factor, machines
from rigtwin.blind.generate.rig import Rig
from rigtwin.blind.generate.wide import distance_for

SMALL, LARGE = 3.0, 30.0  # borders of the size ratio


def size_class(ratio: float) -> str:
    return "large" if ratio > LARGE else "small"


def nominal_off(case: Case) -> dict[str, float]:
    """Off values of the effects that replace a nominal damping."""
    return {"damping_ratio": case.zeta, "damping": case.c_b}


def size_ratio(rig: Rig, case: Case, effect: Effect, rng: np.random.Generator) -> float:
    """Size of one effect of the case, alone in the rig, over the smallest that could be seen."""
    if effect.id == "coarse_grid":
        return effect["step"] / narrowest_band(rig, case)
    if not can_fade(effect):
        return _fixed_size(rig, replace(case, effects=(effect,)), rng)
    return 1 / _severity_at_limit(rig, case, effect, rng)


def can_fade(effect: Effect) -> bool:
    """Whether its size is measured in severity, so that the ratio falls in proportion."""
    return effect.id in (*LINEAR, *CHAIN) and effect.id not in ("coarse_grid", "fast_sweep")


def narrowest_band(rig: Rig, case: Case) -> float:
    """Smallest half-power width [Hz] on both supports."""
    widths = []
    for rigid in (True, False):
        for machine in machines(rig, case.setting(rigid, rig.drive_node), case.effects, case.workshop):
            widths += [width for _, width in resonances(machine)]
    return min(widths)


def _severity_at_limit(rig: Rig, case: Case, effect: Effect, rng: np.random.Generator) -> float:
    settings = [case.setting(rigid, rig.drive_node) for rigid in (True, False)]
    lines = [plan_lines(rig, case, s, 1.0, rng, effects=()) for s in settings]
    distance = distance_for(rig, case, settings, lines)
    still = np.zeros((2, N_DRIFTING))

    def at(severity: float) -> float:
        weak = replace(case, effects=(faded(effect, severity, nominal_off(case)),))
        return distance.of([response(rig, weak, s, f, 1.0, still) for s, f in zip(settings, lines, strict=True)])

    return severity_at_limit(at)


def _fixed_size(rig: Rig, case: Case, rng: np.random.Generator) -> float:
    """Distance in units of the threshold, all levels together."""
    plans = [(True, case.rigid_level), *((False, level) for level in case.levels)]
    settings = [case.setting(rigid, rig.drive_node) for rigid, _ in plans]
    still = np.zeros((2, N_DRIFTING))
    lines = [plan_lines(rig, case, s, level, rng) for s, (_, level) in zip(settings, plans, strict=True)]
    case = replace(case, effects=tuple(replace(e, form="") if e.form == STEPPED else e for e in case.effects))
    responses = [
        response(rig, case, s, f, level, still) for s, f, (_, level) in zip(settings, lines, plans, strict=True)
    ]
    there = [np.isfinite(H[:, 0]) for H in responses]
    lines = [f[ok] for f, ok in zip(lines, there, strict=True)]
    responses = [H[ok] for H, ok in zip(responses, there, strict=True)]
    return distance_for(rig, case, settings, lines).of(responses) / THRESHOLD


def shown_size(rig: Rig, case: Case, runs: Sequence[Run]) -> float:
    """The same of a nonlinear effect as runs show it, free of noise, gains and drift, beside what is linear in them.

    runs : begin with one on rigid supports
    """
    beside = tuple(e for e in case.effects if not e.is_nonlinear)
    lines = [run.frequency_hz for run in runs]
    distance = distance_for(rig, case, [run.setting for run in runs], lines, beside)
    responses = [run.ideal for run in runs]
    if beside:
        chains = [chain_factor(beside, f, len(rig.nodes)) for f in lines]
        responses = [H / chain for H, chain in zip(responses, chains, strict=True)]
    return distance.of(responses) / THRESHOLD
