"""Every number that decides an answer, with its unit, its meaning and what it was set on.

docs/thresholds.md is printed from here (``make thresholds``). None of them was set on a report campaign of the blind
benchmark: those are looked at once, and judge.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

# What a threshold can have been set on.
TUNING = "tuning campaigns of the blind benchmark"
STATISTICS = "statistics: the distribution of what noise alone leaves"
CHOICE = "choice: what a reader of the answer expects"


class Meaning(NamedTuple):
    """What a threshold says."""

    stage: str
    unit: str
    words: str
    set_on: str


def _number(value: float, *meaning: str) -> Any:
    return field(default=value, metadata={"meaning": Meaning(*meaning)})


@dataclass(frozen=True)
class Thresholds:
    """The numbers that decide an answer.

    >>> THRESHOLDS.sure
    0.9
    """

    # fmt: off
    least_data: int = _number(20, "data", "real numbers", "Fewer measured numbers than this conclude nothing.", CHOICE)
    adequate_misfit: float = _number(1.15, "adequacy", "1", "Largest mean square residual, over that of the noise, that a fit may leave.", TUNING)
    adequate_spread: float = _number(3.0, "adequacy", "standard deviations", "The same where there are few values: how far above 1 it may be, in units of what noise alone leaves.", STATISTICS)
    adequate_correlation: float = _number(3.5, "adequacy", "standard errors", "Largest correlation of the residuals of neighbouring lines.", STATISTICS)
    strained_chance: float = _number(1e-4, "adequacy", "probability", "Chance that the gains, drifts and tolerances which the data determine are as far from nothing, by their priors.", STATISTICS)
    adequate_nonlinear: float = _number(1.5, "adequacy", "1", "Largest mean square misfit of a nonlinear effect: at a jump a single line may be on another branch.", TUNING)
    believed_scale_low: float = _number(0.8, "adequacy", "1", "Scatter of the data over their given errors: from here up to the next number the given errors are believed.", TUNING)
    believed_scale_high: float = _number(1.25, "adequacy", "1", "The upper end of that range.", TUNING)
    most_scale: float = _number(1.5, "adequacy", "1", "How many times the given errors may be noise about a nonlinear fit where the lines themselves do not tell.", TUNING)
    passed_over_chance: float = _number(1e-4, "adequacy", "probability", "Chance that noise gives resonances and mode shapes of each run's own as much as they would take away.", STATISTICS)
    passed_over_share: float = _number(0.1, "adequacy", "1", "Share of what a cause takes away that such resonances and shapes may take away beside it.", TUNING)
    form_left: float = _number(0.02, "adequacy", "1", "Share of the best rival's misfit that an effect of another form than the library's may leave and still be named.", TUNING)
    form_left_nonlinear: float = _number(0.5, "adequacy", "1", "The same for nonlinear effects, whose lines far from the data weigh less.", TUNING)
    level_sigmas: float = _number(2.0, "levels", "standard deviations", "How much more than chance resonances of each force level's own must take away before nonlinear effects are looked for.", STATISTICS)
    plain_gap: float = _number(3.0, "levels", "1", "Mean square residual of the rigid runs from which no force law of the bearings can be the cause.", TUNING)
    plainly_nonlinear: float = _number(20.0, "levels", "1", "Mean square misfit of the nominal model from which levels that differ need no linear rival.", TUNING)
    bent_share: float = _number(3e-4, "pairs", "1", "Share of what a law of the bearings takes away that another form of it could take away besides.", TUNING)
    likeliest: float = _number(0.5, "verdict", "probability", "Probability of no gap above which that is the answer.", CHOICE)
    sure: float = _number(0.9, "verdict", "probability", "Probability from which a verdict names one cause, and a place.", CHOICE)
    answered: float = _number(0.98, "verdict", "probability", "Probability that the set of an ambiguous verdict holds.", CHOICE)
    at_most: int = _number(3, "verdict", "effects", "Most effects in that set.", CHOICE)
    # fmt: on


THRESHOLDS = Thresholds()


def meanings(numbers: Any = THRESHOLDS) -> list[tuple[str, float, Meaning]]:
    """Name, value and meaning of every threshold, in their order."""
    return [(each.name, getattr(numbers, each.name), each.metadata["meaning"]) for each in fields(numbers)]
