"""The dwell of a fast sweep: its misfit has thousands of minima, one for every beat between two frequencies.

Near a resonance the beats are slow and only that resonance rings. There the pattern of the lines separates the dwell
from a shift of the resonance, whatever the rest of the model says. Once the resonances are right, the misfit of all
lines has one minimum far below the others. This works without the images of the transients, whose phase turns once
in some microseconds of dwell; they are added at the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL, Hypothesis
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.inference.score_test import Score
from rigtwin.gap.model.linear import MODES, Modal
from rigtwin.gap.model.transients import as_read, transients
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.shared_work import each


@dataclass(frozen=True)
class SweepScale:
    """The unit of all times of a search, the shortest dwell that is tried: a spindle settles sooner than a pump."""

    shortest: float  # [s]
    longest: float  # dwell that is looked for, in the shortest

    @classmethod
    def of(cls, hypothesis: Hypothesis) -> SweepScale:
        """The scale of a fast sweep, whose dwell is its only number."""
        (dwell,) = hypothesis.free
        return cls(dwell.low, dwell.high / dwell.low)

    def grid(self, *parts: FloatArray) -> FloatArray:
        """Dwells [s] of parts in the shortest one."""
        return self.shortest * np.concatenate(parts)


@dataclass(frozen=True)
class WeakTransients:
    """Search of a dwell whose transients leave the nominal model right but for themselves.

    Times here and in the classes below are in the shortest dwell, see ``SweepScale``.
    """

    relative_step: float = 0.01  # between dwells up to ``even_from``, where minima widen with the dwell
    even_from: float = 21.0  # from here on the steps are even
    even_step: float = 0.25  # between the longer dwells
    longest: float = 320.0  # beyond, next to nothing is left of any transient
    kept: int = 4  # dwells that go on, with finer steps,
    least: float = 16.0  # if they take away so much misfit: chance gives the best of a thousand dwells 10
    fine_step: float = 0.02
    to_either_side: int = 12  # fine steps

    def grid(self, scale: SweepScale) -> FloatArray:
        """Dwells [s], as far apart as the misfit's minima are wide."""
        n = int(np.ceil(np.log(self.even_from) / self.relative_step))
        short = np.geomspace(1.0, self.even_from, n, endpoint=False)
        return scale.grid(short, np.arange(self.even_from, min(scale.longest, self.longest), self.even_step))


@dataclass(frozen=True)
class StrongTransients:
    """Search of a dwell near single resonances, then of all lines round the dwell that was found."""

    even_step: float = 0.03  # between dwells up to ``relative_from``
    relative_from: float = 10.0
    relative_step: float = 3e-3  # between the longer dwells
    longest: float = 84.0  # that is tried near resonances
    largest_shift: float = 6e-3  # of a resonance, relative
    n_shifts: int = 41
    near: float = 0.15  # relative distance from a resonance up to which a line counts as near
    fewest: int = 8  # near lines that a resonance must have
    ringing: int = 25  # lines before the near ones that still ring there
    local_error: float = 0.02  # relative error of the model near one resonance
    seen: float = 0.2  # of the logarithm of the misfit, what transients must take away to be plain to see
    within: float = 1.25  # factor round the local dwell that all lines are searched in
    fine_step: float = 8e-3  # of that search
    fine_relative_step: float = 1e-3  # the same for long dwells
    apart: float = 0.03  # between minima that are rivals
    rivals: int = 3  # minima that are fitted
    rough_error: float = 0.3  # relative error added to all lines at first
    loose: float = 30.0  # drifts as many times as wide as their priors take up the shifts at first

    @property
    def shifts(self) -> FloatArray:
        """(n_shifts,) relative shifts of a resonance."""
        return np.linspace(-self.largest_shift, self.largest_shift, self.n_shifts)

    def grid(self, scale: SweepScale) -> FloatArray:
        """Dwells [s] that are tried near a resonance."""
        longest = min(scale.longest, self.longest)
        n = int(np.ceil(np.log(longest / self.relative_from) / self.relative_step))
        even = np.arange(1.0, self.relative_from, self.even_step)
        return scale.grid(even, np.geomspace(self.relative_from, longest, n))


@dataclass(frozen=True)
class Refinement:
    """Fits of all lines from a dwell, and at last the images of the transients."""

    steps: int = 6
    error: float = 0.02  # relative, added to all lines
    dwells_at_once: int = 25  # that are processed together, by all lines
    dwells_at_once_near: int = 200  # by one resonance
    least_gain: float = 50.0  # misfit that a fit must have taken away for images to be added
    least_share: float = 0.3  # the same, of what the nominal model leaves above noise
    aside: float = 8e-3  # to either side that dwells are tried with images, wider in proportion from ``even_from`` on
    step: float = 2e-5  # between them, wider likewise
    apart: float = 8e-5  # between minima that are fitted
    kept: int = 3  # minima that are fitted
    rounds: int = 4
    better: float = 2.0  # misfit that a round must take away for another one


WEAK = WeakTransients()
STRONG = StrongTransients()
REFINED = Refinement()


def dwell_fits(problem: Problem, hypothesis: Hypothesis, nominal: Fit, quiet: bool) -> list[Fit]:
    """Fits of a fast sweep from the most likely dwells, best first.

    Parameters
    ----------
    problem : the runs
    hypothesis : the fast sweep, its dwell the only number
    nominal : the recalibrated nominal model
    quiet : whether it leaves what noise may leave: strong transients would be seen
    """
    smooth = problem.made(images=False)
    fits = [*([] if quiet else _fit_strong(smooth, hypothesis, nominal)), *_fit_weak(smooth, hypothesis, nominal)]
    fits.sort(key=lambda fit: fit.cost)
    if fits:
        gain = nominal.cost - problem.cost(hypothesis, fits[0].u, fits[0].nu)
        if gain > max(REFINED.least_gain, REFINED.least_share * (nominal.cost - nominal.n_data)):
            return [_add_images(problem, fits[0]), *fits[1:]]
    return fits


def _fit(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, anneal: Sequence[float]) -> list[Fit]:
    """The fit in a list, which is empty where there is no model."""
    fit = problem.try_fit(hypothesis, u, nu, anneal=anneal, steps=REFINED.steps)
    return [] if fit is None else [fit]


# -- weak transients -----------------------------------------------------------------------------------


def _fit_weak(problem: Problem, hypothesis: Hypothesis, nominal: Fit) -> list[Fit]:
    """Fits next to the nominal model, by what transients would take away to first order once nuisances are refitted."""
    few, scale = problem.at_middle_level(), SweepScale.of(hypothesis)
    coarse = _most_promising(few, hypothesis, few.fit(NOMINAL, nominal.u), WEAK.grid(scale))
    around = scale.shortest * WEAK.fine_step * np.arange(-WEAK.to_either_side, WEAK.to_either_side + 1)
    fits = []
    for dwell, *_ in coarse:
        near = np.maximum(dwell + around, scale.shortest)
        for _, u, nu in _most_promising(problem, hypothesis, nominal, near)[:1]:
            fits += _fit(problem, hypothesis, u, nu, (REFINED.error,))
    return fits


def _gains(problem: Problem, score: Score, dwells: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(k,) misfit that transients of k dwells take away, and (k, n) how the fit's (u, nu) move; see ``Score.gains``.

    Between two dwells that are tried, beats run out of step and seem weaker than they are; they never seem stronger.
    """
    gain, scale, moved = score.gains(problem.change_by_dwells(score.fit, dwells))
    beyond = np.maximum(scale, 1.0)
    return np.where(scale > 0, gain * (2 * beyond - 1) / beyond**2, 0.0), moved / beyond[:, None]


def _most_promising(
    problem: Problem, hypothesis: Hypothesis, nominal: Fit, dwells: FloatArray
) -> list[tuple[float, FloatArray, FloatArray]]:
    """The dwells that promise most, beyond chance, each with its coordinates and nuisances; best first."""
    found = each(partial(_gains, problem, Score(problem, nominal)), _in_blocks(dwells, REFINED.dwells_at_once))
    gain, moved = (np.concatenate(parts) for parts in zip(*found, strict=True))
    apart = 1.5 * WEAK.even_step * SweepScale.of(hypothesis).shortest
    chosen = [k for k in _minima(dwells, (-gain).tolist(), apart, WEAK.kept) if gain[k] > WEAK.least]
    places = [np.split(np.concatenate([nominal.u, nominal.nu]) + moved[k], [1]) for k in chosen]
    return [
        (float(dwells[k]), hypothesis.clipped(np.array([u[0], np.log(dwells[k])])), nu)
        for k, (u, nu) in zip(chosen, places, strict=True)
    ]


def _in_blocks(dwells: FloatArray, size: int) -> list[FloatArray]:
    """The dwells in parts of at most this many."""
    return np.array_split(dwells, -(-len(dwells) // size))


# -- strong transients ---------------------------------------------------------------------------------


def _fit_strong(problem: Problem, hypothesis: Hypothesis, nominal: Fit) -> list[Fit]:
    """Fits whose resonances differ from the nominal model's; none where no transients are plain to see."""
    fits = []
    for dwell, nu in _dwells_of_all_lines(problem, hypothesis, nominal):
        u = np.array([nominal.u[0], np.log(dwell)])
        for loose in _fit(problem.loosened(STRONG.loose), hypothesis, u, nu, (STRONG.rough_error, 0.1)):
            fits += _fit(problem, hypothesis, loose.u, loose.nu, (0.1, REFINED.error))
    return fits


def _dwells_of_all_lines(problem: Problem, hypothesis: Hypothesis, nominal: Fit) -> list[tuple[float, FloatArray]]:
    """Lowest minima of the misfit of all lines, round the dwell that resonances agree on, each with its nuisances."""
    scale = SweepScale.of(hypothesis)
    dwells = STRONG.grid(scale)
    total, shifts, near = np.zeros(len(dwells)), np.zeros((len(dwells), problem.nuisances.n)), 0
    for r, modal in enumerate(problem.modals(nominal.k_b, ())):
        if modal.as_linear is not None:
            for m, n_lines, left in _resonances(modal.as_linear, dwells):
                near += n_lines
                total += n_lines * np.log(left.min(axis=1) + STRONG.local_error**2)
                shifts[:, problem.nuisances.drift[r].start + m] = STRONG.shifts[left.argmin(axis=1)]
    if total[-1] - total.min() <= STRONG.seen * near:
        return []
    shifts[:, problem.nuisances.gain] = nominal.nu[problem.nuisances.gain]
    middle = float(dwells[np.argmin(total)])
    step = max(STRONG.fine_step * scale.shortest, STRONG.fine_relative_step * middle)
    low, high = max(middle / STRONG.within, dwells[0]), min(middle * STRONG.within, dwells[-1])
    fine = np.arange(low, high, step)
    nus = shifts[np.searchsorted(dwells, fine).clip(max=len(dwells) - 1)]
    loose = problem.loosened(1 / np.finfo(float).eps)
    costs = [
        loose.cost(hypothesis, np.array([nominal.u[0], np.log(dwell)]), nu, STRONG.rough_error)
        for dwell, nu in zip(fine, nus, strict=True)
    ]
    return [(float(fine[k]), nus[k]) for k in _minima(fine, costs, STRONG.apart * scale.shortest, STRONG.rivals)]


def _minima(places: FloatArray, costs: Sequence[float], apart: float, count: int) -> list[int]:
    """The lowest places that are so far apart, lowest first."""
    chosen: list[int] = []
    for k in map(int, np.argsort(costs)):
        if len(chosen) < count and all(abs(places[k] - places[other]) > apart for other in chosen):
            chosen.append(k)
    return chosen


def _resonances(modal: Modal, dwells: FloatArray) -> Iterator[tuple[int, int, FloatArray]]:
    """Yield for each resonance its number, how many lines are near, and their misfit for dwells and shifts.

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
        near = np.flatnonzero(np.abs(omega / abs(pole) - 1) < STRONG.near)
        if len(near) < STRONG.fewest or not omega.min() < abs(pole) < omega.max():
            continue
        trace = _trace(measured[order[near]], shape, modal.run.magnitude_only)
        since = max(int(near[0]) - STRONG.ringing, 0)
        ringing = omega[since : near[-1] + 1]
        straight, _ = np.linalg.qr(np.vander(omega[near] - abs(pole), 2))
        misfit = [
            _misfit(trace, _near_shares(ringing, pole, some)[near - since], straight, modal.run.magnitude_only)
            for some in _in_blocks(dwells, REFINED.dwells_at_once_near)
        ]
        yield m, len(near), np.concatenate(misfit)


def _trace(y: ComplexArray, shape: ComplexArray, magnitude_only: bool) -> ComplexArray | FloatArray:
    """(n_lines,) the channels by a shape; of magnitudes the channel that moves most."""
    return np.abs(y[:, np.abs(shape).argmax()]) if magnitude_only else y @ shape.conj()


def _near_shares(omega: FloatArray, pole: complex, dwells: FloatArray) -> ComplexArray:
    """(n_lines, n_dwells, n_shifts) 1 / (i omega - lambda) with transients."""
    w, poles = omega[:, None, None], pole * (1 + STRONG.shifts)
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


def _add_images(problem: Problem, fit: Fit) -> Fit:
    """Go on from a fit with images: to the best of the many minima round it, as long as that gets better."""
    last, shortest = np.inf, SweepScale.of(fit.hypothesis).shortest
    for _ in range(REFINED.rounds):
        dwell = float(np.exp(fit.u[1]))
        unit = max(dwell / WEAK.even_from, shortest)
        dwells = dwell + unit * np.arange(-REFINED.aside, REFINED.aside, REFINED.step)
        dwells = dwells[dwells > shortest]
        settled = replace(fit, hypothesis=NOMINAL, u=fit.u[:1])
        blocks = _in_blocks(dwells, REFINED.dwells_at_once)
        costs = np.concatenate(list(each(partial(_costs, problem, settled), blocks)))
        found = [] if last == np.inf else [fit]
        for k in _minima(dwells, costs.tolist(), REFINED.apart * shortest, REFINED.kept):
            u = np.array([fit.u[0], np.log(dwells[k])])
            found += _fit(problem, fit.hypothesis, u, fit.nu, (REFINED.error, 0.0))
        if not found:
            return fit
        fit = min(found, key=lambda each: each.cost)
        if last - fit.cost < REFINED.better:
            return fit
        last = fit.cost
    return fit


def _costs(problem: Problem, settled: Fit, dwells: FloatArray) -> FloatArray:
    """(k,) misfit and penalty with transients of k dwells."""
    return problem.costs(settled, problem.change_by_dwells(settled, dwells), REFINED.error)
