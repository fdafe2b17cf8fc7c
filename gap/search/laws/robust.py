"""Fits of nonlinear candidates, in which a line cannot decide where the model is on another branch than the rig.

Such a line counts by a loss that grows like a logarithm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.gap.inference.observed import residual
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.race import first_of_each
from rigtwin.gap.search.starts import Start
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.shared_work import Item, Result, each, seconds_left


@dataclass(frozen=True)
class RobustFit:
    """Fits with weighted lines, each round of weighting followed by steps."""

    outlier: float = 3.0  # misfit of a line, in standard errors, beyond which its weight falls
    rounds: int = 3
    steps: int = 5  # in each round
    quick_rounds: int = 1  # where few lines only have to tell candidates apart
    quick_steps: int = 4


ROBUST = RobustFit()


def cost_of(start: Start) -> float:
    """What starts are sorted by."""
    return start.cost


def best_of_each(starts: Sequence[Start]) -> list[Start]:
    """The best of every candidate, best first."""
    return first_of_each(sorted(starts, key=cost_of), lambda start: start.hypothesis)


def robust_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    u: FloatArray,
    nu: FloatArray | None = None,
    rounds: int = ROBUST.rounds,
    steps: int = ROBUST.steps,
) -> Fit | None:
    """A fit in which a line far from the data counts by the logarithm of its misfit.

    Its ``chi2`` is that loss; ``precision`` is that of the weighted lines. None where the start has
    no model or the time is up.
    """
    if seconds_left() <= 0:
        return None
    fit = fit_at_start(problem, hypothesis, u, problem.unit(hypothesis, u) if nu is None else nu)
    for _ in range(rounds):
        try:
            weighted = without_outliers(problem, fit)
            fit = weighted.fit(hypothesis, fit.u, fit.nu, anneal=(0.0,), steps=steps)
        except (ValueError, np.linalg.LinAlgError):
            return None
        loss, squares = robust_misfit(problem, fit)
        fit = replace(fit, chi2=loss)
        if weighted is problem and not _outliers(squares):
            break
    return fit


def without_outliers(problem: Problem, fit: Fit) -> Problem:
    """The problem itself, or with the errors of its outlying lines enlarged, where there are any."""
    _, squares = robust_misfit(problem, fit)
    return _weighted(problem, squares) if _outliers(squares) else problem


def _outliers(squares: Sequence[FloatArray]) -> bool:
    return any(float(each.max(initial=0.0)) > ROBUST.outlier**2 for each in squares)


def robust_misfit(problem: Problem, fit: Fit) -> tuple[float, list[FloatArray]]:
    """Robust misfit of all lines, and (n_freq,) mean square residual of every run's lines."""
    total, squares = 0.0, []
    for observed, H in zip(problem.observed, problem.predict(fit), strict=True):
        y = np.nan_to_num(observed.run.H)
        used = observed.valid & (np.abs(y) > 0)
        z2 = np.where(used, np.abs(residual(observed, H, problem.model_error)) ** 2, 0.0)
        n = used.sum(axis=1) * observed.parts
        mean = z2.sum(axis=1) / np.maximum(n, 1)
        squares.append(mean)
        total += float(np.sum(n * ROBUST.outlier**2 * np.log1p(mean / ROBUST.outlier**2)))
    return total, squares


def _weighted(problem: Problem, squares: Sequence[FloatArray]) -> Problem:
    """The problem with the errors of outlying lines enlarged."""
    observed = []
    for o, mean in zip(problem.observed, squares, strict=True):
        model2 = (problem.model_error * np.abs(np.nan_to_num(o.run.H))) ** 2
        growth = mean[:, None] / ROBUST.outlier**2
        observed.append(replace(o, std=np.sqrt(o.std**2 * (1 + growth) + model2 * growth)))
    return problem.on(observed)


def fit_at_start(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray) -> Fit:
    """A candidate at its start, with neither misfit nor precision."""
    n = len(u) + len(nu)
    return Fit(hypothesis, u, nu, 0.0, 0.0, np.zeros((n, n)), 0, problem.nuisances.std, problem.with_k_b)


def robust_fits(problem: Problem, starts: Sequence[Start | Fit], **settings: int) -> list[Fit]:
    """Robust fits from every start that has a model."""
    fits = each_from_scratch(problem, partial(_robust_fit_of, **settings), starts)
    return [fit for _, fit in fits if fit is not None]


def _robust_fit_of(problem: Problem, start: Start | Fit, **settings: int) -> Fit | None:
    return robust_fit(problem, start.hypothesis, start.u, start.nu, **settings)


def descend(problem: Problem, starts: Sequence[Start], anneal: Sequence[float]) -> list[Start]:
    """Down from every start with ever smaller errors added; the best of every candidate, best first."""
    found = (down for _, down in each_from_scratch(problem, partial(_descend_from, anneal=anneal), starts))
    return best_of_each([down for down in found if down is not None])


def _descend_from(problem: Problem, start: Start, anneal: Sequence[float]) -> Start | None:
    """Where a start ends; None where it has no model."""
    fit = problem.try_fit(start.hypothesis, start.u, start.nu, anneal=anneal, steps=4)
    if fit is None:
        return None
    loss, _ = robust_misfit(problem, fit)
    return Start(start.hypothesis, fit.u, fit.nu, loss + fit.penalty)


def settle(problem: Problem, starts: Sequence[Start]) -> list[Start]:
    """Robust fits from every start, which lines on another branch of the response pull nowhere; as in ``descend``."""
    fits = robust_fits(problem, starts, rounds=ROBUST.quick_rounds, steps=ROBUST.quick_steps)
    return best_of_each([Start(fit.hypothesis, fit.u, fit.nu, fit.cost) for fit in fits])


def thin_out(problem: Problem, every: int, k_b: float, error: float) -> Problem:
    """Every n-th line of every run; the tolerances bend the modes of the runs that no law acts in."""
    few = problem.thinned(every, error)
    for run in few.runs:
        problem.forward.bend(run, k_b, ())
    return few


def each_from_scratch(
    problem: Problem, function: Callable[[Problem, Item], Result], items: Sequence[Item]
) -> Iterator[tuple[Item, Result]]:
    """Every item with its result, each solved from scratch: no answer depends on who solved the others."""
    yield from zip(items, each(partial(_from_scratch, problem, function), items), strict=True)
    problem.forget()


def _from_scratch(problem: Problem, function: Callable[[Problem, Item], Result], item: Item) -> Result:
    problem.forget()
    return function(problem, item)
