"""How far the gap shrinks on data that took no part in the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.gap.answer.black_box import further_resonance
from rigtwin.gap.answer.transfer import transfer_interval
from rigtwin.gap.curves import nrmse
from rigtwin.gap.document import Shrink, explainable
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import acting, nonlinear
from rigtwin.gap.search.laws.robust import robust_fit
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray
from rigtwin.sim.campaign import Run
from rigtwin.sim.lines import NotSettledError
from rigtwin.sim.setup import SetupError

# Measures a run with effects and k_b on the virtual rig: (runs, effects, k_b) -> responses, and what measured.
Confirm = Callable[[Sequence[Run], Sequence[Effect], float], tuple[Sequence[ComplexArray], str]]

# Held-out lines of a nonlinear run that the virtual rig reads: settling takes four times as long as passing a line.
INTEGRATED = 8


def measure_shrink(problem: Problem, nominal: Fit, best: Fit, scale: float, confirm: Confirm | None) -> Shrink:
    """Hold out every second stretch of lines, fit the rest, and compare the models on what was held out.

    Parameters
    ----------
    problem : all runs
    nominal, best : fits to all of them, where the new fits start
    scale : true over believed standard error
    confirm : measures on the virtual rig
    """
    return _shrink(_halved(problem, nominal), best, scale, confirm)


def shrink_beside_black_box(problem: Problem, nominal: Fit, best: Fit, scale: float) -> tuple[Shrink, float]:
    """``measure_shrink`` without the virtual rig, and the gap on the same lines where a black box without a place
    corrects the nominal model.

    That model has the gains and drifts that it was fitted with, as a joint has its own.
    """
    halves = _halved(problem, nominal)
    before = problem.predict(halves.without)
    after = [
        H + further_resonance(o.run, H, o.valid & ~mask[:, None])
        for o, H, mask in zip(problem.observed, before, halves.masks, strict=True)
    ]
    return _shrink(halves, best, scale, None), _figures(problem, halves.masks, before, after, scale)[1]


@dataclass(frozen=True)
class _Halves:
    """The runs, which of their lines judge, and the nominal model by the others."""

    problem: Problem
    nominal: Fit  # to all lines
    masks: Sequence[BoolArray]  # (n_freq,) of every run: lines that are held out
    training: Problem
    without: Fit  # the nominal model, refitted


def _halved(problem: Problem, nominal: Fit) -> _Halves:
    masks = [_held_out(len(run.frequency_hz)) for run in problem.runs]
    pairs = zip(problem.observed, masks, strict=True)
    training = problem.on([replace(o, std=np.where(mask[:, None], np.inf, o.std)) for o, mask in pairs])
    return _Halves(problem, nominal, masks, training, _with_same_errors(training, nominal))


def _shrink(halves: _Halves, best: Fit, scale: float, confirm: Confirm | None) -> Shrink:
    problem, without, masks = halves.problem, halves.without, halves.masks
    with_it = _refit(halves.training, best)
    before = problem.recalibrated(without)  # drifts would follow any gap between the lines that they were fitted to
    after = problem.predict(with_it)
    model_after, verified = after, "model"
    if confirm is not None:
        after, masks, verified = _measure_corrected(problem, with_it, after, masks, confirm)
    numbers = _figures(problem, masks, before, after, scale)
    stretches = max(_stretches(len(run.frequency_hz)) for run in problem.runs)
    return Shrink(
        held_out=f"lines left out of the fit, every second of {stretches} stretches of each run",
        before=numbers[0],
        after=numbers[1],
        floor=numbers[2],
        shrink=1 - numbers[1] / numbers[0],
        explainable=explainable(*numbers),
        ci90=transfer_interval(problem, halves.nominal, best, scale),
        verified_by=verified,  # type: ignore[arg-type]
        after_model=_figures(problem, masks, before, model_after, scale)[1],
        without_effect=_figures(problem, masks, before, problem.calibrated(without), scale)[1],
    )


def _refit(training: Problem, best: Fit) -> Fit:
    """Fit the corrected model to the lines that were not held out, a nonlinear one as robustly as before."""
    if best.added:
        return _with_same_errors(training, best)
    if nonlinear(best.effects):
        return robust_fit(training, best.hypothesis, best.u, best.nu) or best
    return training.refine(best, anchors=1)


def _with_same_errors(training: Problem, fit: Fit) -> Fit:
    """The same fitted to the lines that were not held out, with the error that was added to all of them."""
    return training.at_fit(fit).fit(fit.hypothesis, fit.u, fit.nu, anneal=(fit.added,))


def _held_out(n: int) -> BoolArray:
    """(n,) which of a run's lines take no part in the fit."""
    return (np.arange(n) * _stretches(n) // n) % 2 == 1


def _stretches(n: int) -> int:
    """How many stretches n lines are divided into, of which every second one is held out."""
    return min(10, n)


def _measure_corrected(
    problem: Problem, fit: Fit, after: Sequence[ComplexArray], masks: Sequence[BoolArray], confirm: Confirm
) -> tuple[Sequence[ComplexArray], Sequence[BoolArray], str]:
    """The corrected runs as the virtual rig measures them, the held-out lines that it measured, and what measured.

    The virtual rig holds its force, so that motions whose size depends on the force of each line have no figure.
    """
    if nonlinear(fit.effects) and any(run.force_N is not None for run in problem.runs):
        return after, masks, "model"
    held_out = zip(problem.runs, masks, strict=True)
    lines = [lines_to_measure(mask, acting(fit.effects, run.support)) for run, mask in held_out]
    levels = np.exp(fit.nu[problem.nuisances.level])
    asked = zip(problem.runs, lines, levels, strict=True)
    some = [run.on_lines(chosen).at_force(float(level)) for run, chosen, level in asked]
    try:
        measured, verified = confirm(some, fit.effects, fit.k_b)
    except (NotSettledError, SetupError):  # the virtual rig has no figure
        return after, masks, "model"
    if not len(measured):
        return after, masks, verified
    corrected, ratios = [], _nuisance_ratios(problem, fit)
    for r, (run, H, chosen, level) in enumerate(zip(problem.runs, measured, lines, levels, strict=True)):
        whole = _on_all_lines(H, chosen)
        whole = whole / level if run.quantity == "acceleration" else whole
        corrected.append(whole * ratios[r])
    return corrected, [mask & chosen for mask, chosen in zip(masks, lines, strict=True)], verified


def lines_to_measure(held_out: BoolArray, effects: Sequence[Effect]) -> BoolArray:
    """(n_freq,) lines for the virtual rig: all, or some that were held out where each is integrated in time."""
    if not nonlinear(effects):
        return np.ones(len(held_out), dtype=bool)
    places = np.flatnonzero(held_out) if held_out.any() else np.arange(1)  # of one line none was held out
    chosen = np.zeros(len(held_out), dtype=bool)
    chosen[places[:: max(len(places) // INTEGRATED, 1)]] = True
    return chosen


def _on_all_lines(H: ComplexArray, lines: BoolArray) -> ComplexArray:
    """(n_freq, n_channels) of all lines, zero where nothing was measured."""
    every = np.zeros((len(lines), H.shape[1]), dtype=complex)
    every[lines] = H
    return every


def _nuisance_ratios(problem: Problem, fit: Fit) -> list[ComplexArray]:
    """What gains, drift, tolerances and mounted sensors do to each run's response: they are not the effect's."""
    drawn, ratios = problem.as_drawn().modals(fit.k_b, fit.effects), []
    for r, (modal, with_them) in enumerate(zip(drawn, problem.predict(fit), strict=True)):
        own = problem.nuisances.of_run(fit.nu, r, modal)
        without = modal.response(None, None, *own[2:])
        ratios.append(np.divide(with_them, without, out=np.ones_like(with_them), where=np.abs(without) > 0))
    return ratios


def _figures(
    problem: Problem,
    masks: Sequence[BoolArray],
    before: Sequence[ComplexArray],
    after: Sequence[ComplexArray],
    scale: float,
) -> tuple[float, float, float]:
    """Gaps before, after and of the noise on the lines of the masks, averaged over runs."""
    rows = []
    for observed, mask, H0, H1 in zip(problem.observed, masks, before, after, strict=True):
        lines = observed.valid & mask[:, None]
        measured = np.where(lines, observed.run.H, np.nan)
        noise = np.where(lines, scale * observed.error, 0.0)
        rows.append([nrmse(measured, model) for model in (*map(observed.run.as_recorded, (H0, H1)), measured + noise)])
    gap_before, gap_after, floor = np.nanmean(rows, axis=0) if np.isfinite(rows).any() else np.full(3, np.nan)
    return float(gap_before), float(gap_after), float(floor)
