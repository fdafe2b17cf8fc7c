"""Candidates against each other: with relative errors added that shrink from stage to stage, those behind drop out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from operator import itemgetter
from typing import TypeVar

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.search.nominal import NOMINAL_FITS
from rigtwin.gap.search.starts import Start
from rigtwin.shared_work import each

T = TypeVar("T")

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Stage:
    """One round of a race."""

    added: float  # relative error that is added to the data's own
    steps: int  # at most
    keep: int  # candidates' starts that go on, at most
    behind: float = 2.0  # misfit over the best one's beyond which a start drops out, but for ``RaceRules.hopeless``
    patient: bool = False  # not left out where nothing tells, and one start of every effect goes on before a second one


# With an error as large as the response itself, a resonance that is off by its width counts no more than others.
FAR = (
    Stage(1.0, 2, 60, behind=10.0),
    Stage(0.3, 4, 30, behind=5.0),
    Stage(0.1, 4, 20),
    Stage(0.02, 6, 16),
    Stage(0.0, 20, 12),
)
CLOSE = (Stage(0.0, 20, 100),)
BENT = (Stage(0.1, 60, 12), Stage(0.02, 60, 8), Stage(0.0, 60, 4))


@dataclass(frozen=True)
class RaceRules:
    """What all races share."""

    at_least: int = 12  # candidates that are raced
    rivals: int = 2  # starts of one candidate that run on
    polished: int = 4  # leading candidates that are fitted to the end, where they are close to the data;
    anchors: int = 3  # how often the model is made anew at the tolerances that a fit has come to, at most
    patience: int = 60  # in so many steps: valleys of several numbers are long
    hopeless: float = 400.0  # more misfit than the best one's than this cannot be made good anywhere,
    from_the_start: float = 20.0  # nor so many times as much, where a race of many begins
    leads: float = 30.0  # an effect that leaves so many times less than the nominal model is one of the cause's


RACE = RaceRules()


@dataclass(frozen=True)
class Search:
    """What a search led to."""

    nominal: Fit
    fits: tuple[Fit, ...]  # best first by evidence, the nominal model not among them
    rough: tuple[Start, ...] = ()  # best first by rough cost, one of every effect; none close to the nominal model

    @property
    def leads(self) -> bool:
        """Whether the best candidate leaves so little that others need only be looked for beside it."""
        return bool(self.fits) and RACE.leads * self.fits[0].cost < self.nominal.cost

    @property
    def best(self) -> Fit:
        """The best candidate, or the nominal model where there is none."""
        return self.fits[0] if self.fits else self.nominal


def race(problem: Problem, starts: Sequence[Start], stages: Sequence[Stage], progress: Progress | None) -> list[Fit]:
    """The candidates that do not fall behind, each from its best start, best first by evidence and prior."""
    starts, (first, *further) = _from_where_it_tells(problem, starts, stages)
    fits = _round(first, each(partial(fitted, problem, first), starts), starts, progress)
    for stage in further:
        fits = _round(stage, each(partial(_fitted_on, problem, stage), fits), fits, progress)
    fits = [fit for fit in _of_each(fits, 1) if problem.has_model(fit)]
    return polish_leaders(problem, fits, NOMINAL_FITS.near * fits[0].n_data) if fits else []


def _round(
    stage: Stage, made: Iterable[Fit | None], begun: Sequence[Start | Fit], progress: Progress | None
) -> list[Fit]:
    """The fits of one stage that go on, lowest cost first."""
    fits = []
    for number, fit in enumerate(made):
        if progress:
            progress(number, len(begun), str(begun[number].hypothesis))
        if fit is not None:
            fits.append(fit)
    fits.sort(key=lambda fit: fit.cost)
    fits = [fit for fit in fits if fit.cost <= stage.behind * fits[0].cost + RACE.hopeless]
    fits = _of_each(fits, RACE.rivals)
    return (in_turns(fits, lambda fit: fit.hypothesis.ids) if stage.patient else fits)[: stage.keep]


def _fitted_on(problem: Problem, stage: Stage, fit: Fit) -> Fit | None:
    """A further stage of the race, with the tolerances as they act where the one before ended; None without a model."""
    return problem.around(fit).try_fit(fit.hypothesis, fit.u, fit.nu, anneal=(stage.added,), steps=stage.steps)


def polish_leaders(problem: Problem, fits: Sequence[Fit], limit: float) -> list[Fit]:
    """These fits, best first by evidence, the leading ones fitted on as far as their cost is within a limit."""
    leading = list(takewhile(lambda fit: fit.cost <= limit, fits[: RACE.polished]))
    return best_first([*polish_all(problem, leading), *fits[len(leading) :]])


def reach(best: Fit) -> float:
    """The cost up to which another fit, carried on, could still win."""
    return Stage.behind * best.cost + RACE.hopeless


def fitted(problem: Problem, stage: Stage, start: Start) -> Fit | None:
    """A stage of the race from one start; None where there is no model."""
    return problem.try_fit(start.hypothesis, start.u, start.nu, anneal=(stage.added,), steps=stage.steps)


def _from_where_it_tells(
    problem: Problem, starts: Sequence[Start], stages: Sequence[Stage]
) -> tuple[Sequence[Start], Sequence[Stage]]:
    """The stages from the last one whose added error the best start is within, since before nothing tells starts apart;
    of many, the starts that are not far behind the best one there."""
    if len(stages) == 1 or stages[0].patient:
        return starts, stages
    within = NOMINAL_FITS.within * sum(observed.n_values for observed in problem.observed)
    costs, further = _costs(problem, starts, stages[0]), _costs(problem, starts, stages[1])
    while len(stages) > 2 and min(further, default=np.inf) <= within:
        stages = stages[1:]
        costs, further = further, _costs(problem, starts, stages[1])
    limit = RACE.from_the_start * min(costs, default=0.0) + RACE.hopeless
    return [start for start, cost in zip(starts, costs, strict=True) if cost <= limit], stages


def _costs(problem: Problem, starts: Sequence[Start], stage: Stage) -> list[float]:
    """Costs of starts with the error that a stage adds."""
    return [problem.cost(start.hypothesis, start.u, start.nu, stage.added) for start in starts]


def best_first(fits: Iterable[Fit]) -> list[Fit]:
    """By evidence and prior."""
    return sorted(fits, key=lambda fit: fit.log_weight, reverse=True)


def polish(problem: Problem, fit: Fit) -> Fit:
    """The same candidate, fitted on from where it is, with the tolerances as they act there."""
    return problem.refine(fit, anchors=RACE.anchors, steps=RACE.patience)


def polish_all(problem: Problem, fits: Sequence[Fit]) -> list[Fit]:
    """Several candidates, each fitted on; without those that have no model where they end."""
    return [fit for fit in each(partial(polish, problem), fits) if problem.has_model(fit)]


def first_of_each(items: Iterable[T], key: Callable[[T], Hashable], count: int = 1) -> list[T]:
    """The first so many items of every key, in their order.

    >>> first_of_each(["mass 3", "crack 1", "mass 5"], key=lambda name: name.split()[0])
    ['mass 3', 'crack 1']
    """
    return [item for place, item in _numbered(items, key) if place < count]


def in_turns(items: Iterable[T], key: Callable[[T], Hashable]) -> list[T]:
    """The first item of every key, then the second of every key, and so on, in their order.

    >>> in_turns(["mass 3", "mass 5", "crack 1"], key=lambda name: name.split()[0])
    ['mass 3', 'crack 1', 'mass 5']
    """
    return [item for _, item in sorted(_numbered(items, key), key=itemgetter(0))]


def _numbered(items: Iterable[T], key: Callable[[T], Hashable]) -> Iterator[tuple[int, T]]:
    """Items in their order, each with how many of its key came before."""
    seen: Counter[Hashable] = Counter()
    for item in items:
        own = key(item)
        yield seen[own], item
        seen[own] += 1


def _of_each(fits: Iterable[Fit], count: int) -> list[Fit]:
    """The first so many of every candidate."""
    return first_of_each(fits, lambda fit: fit.hypothesis.rotor, count)
