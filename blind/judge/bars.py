"""What the benchmark has to reach: every bar, what was measured, and whether it is held."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.blind.judge.score import Outcome, unknown_auroc
from rigtwin.blind.judge.statistics import calibration_error, median, rate

Pick = Callable[[Outcome], bool]

NAMEABLE = ("W1", "W4", "W5", "W6")  # sets whose effects the diagnosis can name
SAME_FORM = ("W1", "W4", "W5")  # of these in the form that it knows
MISSED = 5.0  # standard errors by which the nominal model's k_b counts as missed


@dataclass(frozen=True)
class Bar:
    """One line of the table."""

    what: str
    count: int  # campaigns, or values, that it rests on
    measured: str
    interval: str
    limit: str
    held: bool | None  # None: nothing to judge

    @property
    def words(self) -> str:
        return "nothing measured" if self.held is None else "held" if self.held else "**missed**"


@dataclass(frozen=True)
class Limit:
    """At least, at most or between; percent: shares."""

    low: float = -math.inf
    high: float = math.inf
    percent: bool = False

    def __str__(self) -> str:
        factor, unit = (100, " %") if self.percent else (1, "")
        low, high = self.low * factor, self.high * factor
        if math.isinf(self.low):
            return f"≤ {high:g}{unit}"
        return f"≥ {low:g}{unit}" if math.isinf(self.high) else f"{low:g}–{high:g}{unit}"

    def holds(self, value: float) -> bool | None:
        return None if math.isnan(value) else self.low <= value <= self.high


def at_least(share: float) -> Limit:
    return Limit(low=share / 100, percent=True)


COVERAGE = Limit(0.85, 0.95, percent=True)


def share_bar(what: str, hits: Sequence[bool], limit: Limit) -> Bar:
    """A share with its Wilson interval."""
    found = rate(hits)
    low, high = found.interval
    if not found.of:
        return Bar(what, 0, "–", "–", str(limit), None)
    measured = f"{100 * found.value:.1f} % ({found.hits} of {found.of})"
    return Bar(what, found.of, measured, f"{100 * low:.0f}–{100 * high:.0f} %", str(limit), limit.holds(found.value))


def number_bar(what: str, value: float, count: int, limit: Limit, beside: str = "") -> Bar:
    """A number without an interval; beside: words after it."""
    measured = "–" if math.isnan(value) else f"{value:.3g}{beside}"
    return Bar(what, count, measured, "", str(limit), limit.holds(value) if count else None)


def bars(outcomes: Sequence[Outcome]) -> list[Bar]:
    """Every bar of the sets W1 to W8, in the order of the page."""
    groups = (_names, _strangers, _sets, _shrinks, _numbers, _times)
    return [bar for group in groups for bar in group(outcomes)]


def pick(outcomes: Iterable[Outcome], sets: Sequence[str], *conditions: Pick) -> list[Outcome]:
    return [o for o in outcomes if o.label.set in sets and all(condition(o) for condition in conditions)]


def size(wanted: str) -> Pick:
    return lambda o: o.label.size == wanted


def linear(o: Outcome) -> bool:
    return not o.label.is_nonlinear


def nonlinear(o: Outcome) -> bool:
    return o.label.is_nonlinear


def seven_nodes(o: Outcome) -> bool:
    return o.label.sensors == "all"


def one_sensor(o: Outcome) -> bool:
    return o.label.sensors == "one"


def _names(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """W1: names, sets and places."""
    large, small = size("large"), size("small")
    for words, condition, chosen, top, answered in (
        ("large, seven nodes", seven_nodes, large, 98, 100),
        ("small, seven nodes", seven_nodes, small, 85, 97),
        ("large, one accelerometer", one_sensor, large, 95, 99),
        ("small, one accelerometer", one_sensor, small, 80, 95),
    ):
        group = pick(outcomes, ("W1",), linear, condition, chosen)
        yield share_bar(f"W1 {words}: first answer", [o.top_right for o in group], at_least(top))
        yield share_bar(f"W1 {words}: answered set", [o.set_right for o in group], at_least(answered))
    group = pick(outcomes, ("W1",), nonlinear)
    yield share_bar("W1 nonlinear, three levels: name", [o.top_right for o in group], at_least(90))
    yield share_bar("W1 nonlinear, three levels: place", [o.located for o in group], at_least(80))
    for words, chosen, limit in (("large", large, 98), ("small", small, 85)):
        group = pick(outcomes, ("W1",), linear, seven_nodes, chosen)
        yield share_bar(f"W1 {words}, seven nodes: place", [o.located for o in group], at_least(limit))


def _strangers(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """W2 and W8, and what is no gap at all."""
    for words, limit in (("large", 95), ("small", 85)):
        group = pick(outcomes, ("W2", "W8"), size(words))
        yield share_bar(f"W2 and W8 {words}: no wrong blame", [o.not_blamed for o in group], at_least(limit))
    scored = pick(outcomes, ("W1", "W2", "W3", "W8"))
    telling = [o for o in scored if not (o.label.outside_library and o.has_equivalent)]
    for words, group in (
        ("AUROC of the unknown score, W2 and W8 against W1 and W3", scored),
        ("the same without effects whose transfer the answer predicts with at most twice the floor", telling),
    ):
        yield number_bar(words, unknown_auroc(group), len(group), Limit(low=0.97))
    group = pick(outcomes, ("W3",))
    yield share_bar("W3: false alarms", [o.false_alarm for o in group], Limit(high=0.05, percent=True))


def _sets(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """Names in the other sets."""
    for words, limit in (("large", 90), ("small", 70)):
        group = pick(outcomes, ("W4",), size(words))
        yield share_bar(f"W4 {words}: both of a pair named", [o.top_right for o in group], at_least(limit))
    for name, words, limit in (("W5", "artefact", 90), ("W6", "effect in another form", 85)):
        group = pick(outcomes, (name,))
        yield share_bar(f"{name}: {words} named", [o.top_right for o in group], at_least(limit))


def named_rightly(o: Outcome) -> bool:
    """Rasters are left out: they change no response, so that nothing is left to shrink."""
    return o.top_right and bool(o.label.ids) and "coarse_grid" not in o.label.ids


def _shrinks(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """How far the gap shrinks on the held-out transfer, where the cause is named rightly."""
    named = pick(outcomes, SAME_FORM, named_rightly)
    of = {words: _explainable(pick(named, SAME_FORM, size(words))) for words in ("large", "small")}
    what = "explainable shrink on the held-out transfer"
    large, small = of["large"], of["small"]
    yield number_bar(f"{what}, large: median", median(large), len(large), Limit(low=0.99))
    yield number_bar(f"{what}, large: worst", min(large, default=math.nan), len(large), Limit(low=0.9))
    yield number_bar(f"{what}, small: median", median(small), len(small), Limit(low=0.8))
    hits = [bool(o.shrink.covered) for o in named if o.shrink is not None and o.shrink.covered is not None]
    yield share_bar("90 % interval of the shrink covers the one free of noise on the held-out transfer", hits, COVERAGE)
    controls = [(o.control.explainable, o.no_effect) for o in named if o.control is not None]
    controls = [(share, alone) for share, alone in controls if not math.isnan(share)]
    alone = [without.explainable for _, without in controls if without is not None]
    beside = f" (by gains and tolerances alone, without any effect: {median(alone):.3g})" if alone else ""
    what, limit = "explainable shrink by a random effect outside the answered set", Limit(high=0.3)
    yield number_bar(f"{what}: median", median([share for share, _ in controls]), len(controls), limit, beside)
    beyond = [share - without.explainable for share, without in controls if without is not None]
    words = f"{what}, beyond what gains and tolerances explain without an effect: median"
    yield number_bar(words, median(beyond), len(beyond), limit)


def _explainable(outcomes: Sequence[Outcome]) -> list[float]:
    found = [o.shrink.explainable for o in outcomes if o.shrink is not None]
    return [value for value in found if not math.isnan(value)]


def _numbers(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """k_b, intervals, probabilities, sizes of sets."""
    missed = pick(outcomes, NAMEABLE, lambda o: o.k_b_miss > MISSED and o.k_b_error > 0)
    gains = [o.k_b_error_nominal / o.k_b_error for o in missed]
    yield number_bar(
        f"error of k_b in the recalibrated nominal model, where it misses by over {MISSED:g} standard errors, over "
        "the error after the diagnosis: median",
        median(gains),
        len(gains),
        Limit(low=10),
    )
    inside = [hit for o in pick(outcomes, SAME_FORM) for hit in o.parameters_inside]
    yield share_bar("90 % intervals of parameters cover", inside, COVERAGE)
    answered = pick(outcomes, ("W1", "W3", "W4", "W5", "W6"), lambda o: bool(o.answered))
    error = calibration_error([o.probability for o in answered], [o.top_right for o in answered])
    yield number_bar("calibration error of the probabilities", error, len(answered), Limit(high=0.05))
    sizes = [len(o.answered) for o in outcomes if o.answered]
    mean = float(np.mean(sizes)) if sizes else math.nan
    yield number_bar("effects in the answered set: mean", mean, len(sizes), Limit(high=1.5))
    yield number_bar("effects in the answered set: most", max(sizes, default=math.nan), len(sizes), Limit(high=3))


def _times(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """Seconds: the bar is on what 95 in 100 campaigns need at most."""
    for words, group, limit in (
        ("one linear effect or none", pick(outcomes, ("W1", "W3", "W5", "W6", "W7"), linear), 20),
        ("pairs, and where no single effect is adequate (W2, W4, W8)", pick(outcomes, ("W2", "W4", "W8"), linear), 40),
        ("three levels, nonlinear", [o for o in outcomes if o.label.is_nonlinear], 90),
    ):
        seconds = [o.seconds for o in group if not math.isnan(o.seconds)]
        busy = median([o.processor_seconds for o in group if not math.isnan(o.processor_seconds)])
        quantile = float(np.quantile(seconds, 0.95)) if seconds else math.nan
        beside = f" (median {median(seconds):.3g}, of the processor {busy:.3g}; longest {max(seconds, default=0):.3g})"
        what = f"seconds of a campaign, {words}: 95 % take at most"
        yield number_bar(what, quantile, len(seconds), Limit(high=limit), beside)


def detection_curve(outcomes: Sequence[Outcome]) -> str:
    """W7: how many are seen and named, by size over the detection limit."""
    borders = (0.3, 0.5, 0.8, 1.25, 2.0, 3.0, 5.0, 10.0)
    rows = [
        "| size over its detection limit | campaigns | gap seen | first answer right | set right |",
        "|" + " --- |" * 5,
    ]
    group = pick(outcomes, ("W7",))
    for low, high in itertools.pairwise(borders):
        members = [
            o for o in group if low <= (o.label.size_ratio or 0.0) < high or (high == borders[-1] == o.label.size_ratio)
        ]
        seen = rate([o.verdict not in ("no_gap", "failed") for o in members])
        cells = (
            f"{low:g} to {high:g}",
            len(members),
            seen,
            rate([o.top_right for o in members]),
            rate([o.set_right for o in members]),
        )
        rows.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(rows)
