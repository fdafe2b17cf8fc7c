"""The dwell of a fast sweep: its misfit has thousands of minima, a beat between two frequencies apart.

Near a resonance the beats are slow, and nothing but that resonance rings: there a dwell and a shift of the resonance
are told apart by the lines' own pattern, whatever the rest of the model says. With resonances set right, the misfit of
all lines shows one minimum far below the others. That is seen without the transients' images, whose phase turns once
in some microseconds of dwell; they are let in at the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, Free, Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.linear import MODES, Modal
from rigtwin.gap.model.transients import as_read, transients
from rigtwin.gap.search.workers import each
from rigtwin.rotor.model.structure import ComplexArray, FloatArray

# Beyond this dwell next to nothing is left of any transient [s].
_LONGEST = 15.0

# Strong transients: dwells that are tried near resonances, in even steps [s] up to a split, then in relative ones.
_STEP, _SPLIT, _RELATIVE, _STRONG = 1.5e-3, 0.5, 3e-3, 4.0

# Relative shifts of a resonance.
_SHIFTS = np.linspace(-6e-3, 6e-3, 41)

# Lines that count as near, by their relative distance; how many there must be; lines before them that still ring.
_NEAR, _FEWEST, _RINGING = 0.15, 8, 25

# Relative error of such a local fit; transients are seen where they take away so much of the logarithm of the misfit.
_LOCAL_ERROR, _SEEN = 0.02, 0.2

# The dwell of all lines: searched within this factor of the local one, by these steps [s] and relative ones; minima
# this far apart [s] are rivals, of which so many are fitted.
_WITHIN, _FINE_STEP, _FINE_RELATIVE, _APART, _RIVALS = 1.25, 4e-4, 1e-3, 1.5e-3, 3

# Drifts as wide as this many of their priors take the shifts up at first; steps then, and with the prior.
_LOOSE, _STEPS = 30.0, 6

# Weak transients, which leave the nominal model right but for them: steps of the dwells that are tried, relative ones
# up to a second, then even ones [s]; so many of them go on, with finer steps [s] to either side.
_RELATIVE_WEAK, _EVENLY, _STEP_WEAK, _KEPT = 0.01, 1.0, 0.012, 4
_FINER, _TO_EITHER_SIDE = 1e-3, 12

# Dwells processed at once, by one resonance and by all lines; relative errors added to all lines, roughly and finely.
_BLOCK, _FEW, _ADDED, _FINELY = 200, 25, 0.3, 0.02

# Images: dwells tried to either side [s], in such steps [s], both wider from a second on; minima so far apart [s], and
# how many of them are fitted.
_ASIDE, _IMAGE_STEP, _IMAGE_APART, _IMAGES = 4e-4, 1e-6, 4e-6, 3

# Rounds of that, and by how much one must lower the misfit for another.
_ROUNDS, _BETTER = 4, 2.0

# What a fit must take away for images to be let in: misfit, and a share of what the nominal model leaves above noise.
_GAIN, _SHARE = 50.0, 0.3


def dwell_fits(problem: Problem, hypothesis: Hypothesis, nominal: Fit) -> list[Fit]:
    """Fits of a fast sweep from the most likely dwells, best first.

    Parameters
    ----------
    problem : the runs
    hypothesis : the fast sweep, its dwell the only number
    nominal : the recalibrated nominal model
    """
    smooth = problem.made(images=False)
    fits = [*_strong(smooth, hypothesis, nominal), *_weak(smooth, hypothesis, nominal)]
    fits.sort(key=lambda fit: fit.cost)
    if fits:
        gain = nominal.cost - problem.cost(hypothesis, fits[0].u, fits[0].nu)
        if gain > max(_GAIN, _SHARE * (nominal.cost - nominal.n_data)):
            return [_with_images(problem, fits[0]), *fits[1:]]
    return fits


def _fitted(
    problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, anneal: Sequence[float]
) -> list[Fit]:
    """A list of the one fit, empty where there is no model."""
    fit = problem.try_fit(hypothesis, u, nu, anneal=anneal, steps=_STEPS)
    return [] if fit is None else [fit]


# -- weak transients -----------------------------------------------------------------------------------


def _weak(problem: Problem, hypothesis: Hypothesis, nominal: Fit) -> list[Fit]:
    """Fits next to the nominal model, by what transients would take away to first order, nuisances refitted."""
    few = problem.at_middle_level()
    coarse = _promising(few, hypothesis, few.fit(NOMINAL, nominal.u), _weak_grid(hypothesis))
    around = _FINER * np.arange(-_TO_EITHER_SIDE, _TO_EITHER_SIDE + 1)
    fits = []
    for dwell, *_ in coarse:
        near = np.maximum(dwell + around, hypothesis.free[0].low)
        _, u, nu = _promising(problem, hypothesis, nominal, near)[0]
        fits += _fitted(problem, hypothesis, u, nu, (_FINELY,))
    return fits


def _weak_grid(hypothesis: Hypothesis) -> FloatArray:
    """Dwells [s], as far apart as the misfit's minima are wide."""
    low, high = hypothesis.free[0].low, min(hypothesis.free[0].high, _LONGEST)
    n = int(np.ceil(np.log(_EVENLY / low) / _RELATIVE_WEAK))
    return np.concatenate([np.geomspace(low, _EVENLY, n, endpoint=False), np.arange(_EVENLY, high, _STEP_WEAK)])


def _gains(problem: Problem, score: Score, dwells: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(k,) misfit that transients of k dwells take away, and (k, n) how the fit's (u, nu) move; see ``Score.gains``.

    Between two dwells that are tried, beats run out of step and seem weaker than they are; they never seem stronger.
    """
    gain, scale, moved = score.gains(problem.change_by_dwells(score.fit, dwells))
    beyond = np.maximum(scale, 1.0)
    return np.where(scale > 0, gain * (2 * beyond - 1) / beyond**2, 0.0), moved / beyond[:, None]


def _promising(
    problem: Problem, hypothesis: Hypothesis, nominal: Fit, dwells: FloatArray
) -> list[tuple[float, FloatArray, FloatArray]]:
    """The dwells that promise most, each with the coordinates and the nuisances that go with it; best first."""
    found = each(partial(_gains, problem, Score(problem, nominal)), _in_blocks(dwells, _FEW))
    gain, moved = (np.concatenate(parts) for parts in zip(*found, strict=True))
    chosen = _minima(dwells, (-gain).tolist(), 1.5 * _STEP_WEAK, _KEPT)
    places = [np.split(np.concatenate([nominal.u, nominal.nu]) + moved[k], [1]) for k in chosen]
    return [
        (float(dwells[k]), hypothesis.clipped(np.array([u[0], np.log(dwells[k])])), nu)
        for k, (u, nu) in zip(chosen, places, strict=True)
    ]


def _in_blocks(dwells: FloatArray, size: int) -> list[FloatArray]:
    """The dwells in parts of at most this many."""
    return np.array_split(dwells, -(-len(dwells) // size))


# -- strong transients ---------------------------------------------------------------------------------


def _strong(problem: Problem, hypothesis: Hypothesis, nominal: Fit) -> list[Fit]:
    """Fits whose resonances differ from the nominal model's; none where no transients are plain to see."""
    fits = []
    for dwell, nu in _dwells(problem, hypothesis, nominal):
        u = np.array([nominal.u[0], np.log(dwell)])
        for loose in _fitted(problem.loosened(_LOOSE), hypothesis, u, nu, (_ADDED, 0.1)):
            fits += _fitted(problem, hypothesis, loose.u, loose.nu, (0.1, _FINELY))
    return fits


def _dwells(problem: Problem, hypothesis: Hypothesis, nominal: Fit) -> list[tuple[float, FloatArray]]:
    """Dwells and the nuisances that go with them, by the misfit of all lines."""
    dwells = _grid(*hypothesis.free)
    total, shifts, near = np.zeros(len(dwells)), np.zeros((len(dwells), problem.nuisances.n)), 0
    for r, modal in enumerate(problem.modals(nominal.k_b, ())):
        if modal.as_linear is not None:
            for m, n_lines, left in _resonances(modal.as_linear, dwells):
                near += n_lines
                total += n_lines * np.log(left.min(axis=1) + _LOCAL_ERROR**2)
                shifts[:, problem.nuisances.drift[r].start + m] = _SHIFTS[left.argmin(axis=1)]
    if total[-1] - total.min() <= _SEEN * near:
        return []
    shifts[:, problem.nuisances.gain] = nominal.nu[problem.nuisances.gain]
    middle = dwells[np.argmin(total)]
    step = max(_FINE_STEP, _FINE_RELATIVE * middle)
    fine = np.arange(max(middle / _WITHIN, dwells[0]), min(middle * _WITHIN, dwells[-1]), step)
    nus = shifts[np.searchsorted(dwells, fine).clip(max=len(dwells) - 1)]
    loose = problem.loosened(1 / np.finfo(float).eps)
    costs = [
        loose.cost(hypothesis, np.array([nominal.u[0], np.log(dwell)]), nu, _ADDED)
        for dwell, nu in zip(fine, nus, strict=True)
    ]
    return [(float(fine[k]), nus[k]) for k in _minima(fine, costs, _APART, _RIVALS)]


def _minima(places: FloatArray, costs: Sequence[float], apart: float, count: int) -> list[int]:
    """The lowest places that are so far apart, lowest first."""
    chosen: list[int] = []
    for k in map(int, np.argsort(costs)):
        if len(chosen) < count and all(abs(places[k] - places[other]) > apart for other in chosen):
            chosen.append(k)
    return chosen


def _grid(dwell: Free) -> FloatArray:
    longest = min(dwell.high, _STRONG)
    n = int(np.ceil(np.log(longest / _SPLIT) / _RELATIVE))
    return np.concatenate([np.arange(dwell.low, _SPLIT, _STEP), np.geomspace(_SPLIT, longest, n)])


def _resonances(modal: Modal, dwells: FloatArray) -> Iterator[tuple[int, int, FloatArray]]:
    """Of each resonance among the lines its number, how many lines are near, and their misfit for dwells and shifts.

    Channels are added up by the resonance's shape, to which amplitude and phase are fitted beside a straight line that
    stands for all other resonances. The misfit (n_dwells, n_shifts) is relative to the mean square.
    """
    group, order = modal.groups[0], modal.in_order
    omega = modal.omega[order]
    measured = np.where(np.isfinite(modal.run.H), modal.run.H, 0.0) / modal.scale[:, None]
    for m in range(MODES):
        (places,) = np.nonzero((group.mode == m) & (group.poles.imag > 0))
        if not len(places):
            continue
        pole, shape = complex(group.poles[places[0]]), group.residues[:-1, places[0]]
        near = np.flatnonzero(np.abs(omega / abs(pole) - 1) < _NEAR)
        if len(near) < _FEWEST or not omega.min() < abs(pole) < omega.max():
            continue
        trace = _trace(measured[order[near]], shape, modal.run.magnitude_only)
        since = max(int(near[0]) - _RINGING, 0)
        ringing = omega[since : near[-1] + 1]
        straight, _ = np.linalg.qr(np.vander(omega[near] - abs(pole), 2))
        misfit = [
            _misfit(trace, _near_shares(ringing, pole, some)[near - since], straight, modal.run.magnitude_only)
            for some in _in_blocks(dwells, _BLOCK)
        ]
        yield m, len(near), np.concatenate(misfit)


def _trace(y: ComplexArray, shape: ComplexArray, magnitude_only: bool) -> ComplexArray | FloatArray:
    """(n_lines,) the channels by a shape; of magnitudes the channel that moves most."""
    return np.abs(y[:, np.abs(shape).argmax()]) if magnitude_only else y @ shape.conj()


def _near_shares(omega: FloatArray, pole: complex, dwells: FloatArray) -> ComplexArray:
    """(n_lines, n_dwells, n_shifts) 1 / (i omega - lambda) with transients."""
    w, poles = omega[:, None, None], pole * (1 + _SHIFTS)
    return 1 / (1j * w - poles) + as_read(transients(w, poles, dwells[:, None]), w, poles)


def _misfit(
    trace: ComplexArray | FloatArray, shares: ComplexArray, straight: FloatArray, magnitude_only: bool
) -> FloatArray:
    """(n_dwells, n_shifts) mean square that no multiple of the shares and no straight line explains, relative."""
    if magnitude_only:
        shares = np.abs(shares)
    bent = trace - straight @ (straight.T @ trace)
    flat = shares.reshape(len(trace), -1)
    flat = flat - straight @ (straight.T @ flat)
    explained = np.abs(bent.conj() @ flat) ** 2 / np.maximum(np.sum(np.abs(flat) ** 2, axis=0), 1e-300)
    left = 1 - explained / max(float(np.sum(np.abs(bent) ** 2)), 1e-300)
    return left.reshape(shares.shape[1:])


# -- images ----------------------------------------------------------------------------------------------


def _with_images(problem: Problem, fit: Fit) -> Fit:
    """A fit without images carried on with them: the best of the many minima round it, as long as that gets better."""
    last = np.inf
    for _ in range(_ROUNDS):
        dwell = float(np.exp(fit.u[1]))
        dwells = dwell + max(dwell, 1.0) * np.arange(-_ASIDE, _ASIDE, _IMAGE_STEP)
        dwells = dwells[dwells > fit.hypothesis.free[0].low]
        settled = replace(fit, hypothesis=NOMINAL, u=fit.u[:1])
        costs = np.concatenate(list(each(partial(_costs, problem, settled), _in_blocks(dwells, _FEW))))
        found = [] if last == np.inf else [fit]
        for k in _minima(dwells, costs.tolist(), _IMAGE_APART, _IMAGES):
            u = np.array([fit.u[0], np.log(dwells[k])])
            found += _fitted(problem, fit.hypothesis, u, fit.nu, (_FINELY, 0.0))
        if not found:
            return fit
        fit = min(found, key=lambda each: each.cost)
        if last - fit.cost < _BETTER:
            return fit
        last = fit.cost
    return fit


def _costs(problem: Problem, settled: Fit, dwells: FloatArray) -> FloatArray:
    """(k,) misfit and penalty with transients of k dwells."""
    return problem.costs(settled, problem.change_by_dwells(settled, dwells), _FINELY)
