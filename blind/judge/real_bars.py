"""What the diagnosis has to reach on rotors of three sizes, known as well as a workshop knows them (W9)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rigtwin.blind.judge.bars import COVERAGE, Bar, Limit, Pick, at_least, number_bar, share_bar
from rigtwin.blind.judge.score import Outcome
from rigtwin.blind.judge.statistics import Rate, median, rate

REAL = "W9"
POINTS = 5.0  # by which a rotor's share of good answers may be below that of all rotors


def kind(o: Outcome) -> str:
    """What the campaign hides: nothing, one, two, three, beside (a nonlinear effect and a linear one), a stranger."""
    label = o.label
    if label.outside_library:
        return "stranger"
    if label.is_nonlinear and len(label.effects) > 1:
        return "beside"
    return ("nothing", "one", "two", "three")[len(label.effects)]


KINDS = {
    "nothing": "nothing to find",
    "one": "one effect",
    "two": "two effects",
    "three": "three effects",
    "beside": "nonlinear beside linear",
    "stranger": "not in the library",
}


def good(o: Outcome) -> bool:
    """The right answer: no false alarm, all effects named, or nothing blamed that is not there."""
    kinds = {"nothing": not o.false_alarm, "stranger": o.not_blamed}
    return kinds.get(kind(o), o.top_right)


def real_bars(outcomes: Sequence[Outcome]) -> list[Bar]:
    """Every bar, in the order of the page; outcomes of other sets do not count."""
    ours = [o for o in outcomes if o.label.set == REAL]
    return [bar for group in (_names, _strangers, _rotors, _intervals, _times) for bar in group(ours)]


def of_kind(outcomes: Sequence[Outcome], *kinds: str, where: Pick = lambda o: True) -> list[Outcome]:
    """Outcomes of these kinds that a condition picks."""
    return [o for o in outcomes if kind(o) in kinds and where(o)]


def _names(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """False alarms, and what is named."""
    alarms = [o.false_alarm for o in of_kind(outcomes, "nothing")]
    yield share_bar("W9 nothing to find: false alarms", alarms, Limit(high=0.05, percent=True))
    large, small = (of_kind(outcomes, "one", where=lambda o, s=s: o.label.size == s) for s in ("large", "small"))
    yield share_bar("W9 one large effect: named", [o.top_right for o in large], at_least(95))
    yield share_bar("W9 one large effect: place", [o.located for o in large], at_least(95))
    yield share_bar("W9 one small effect: named", [o.top_right for o in small], at_least(75))
    words = "W9 one small effect: named, in an ambiguous set, or no gap that predicts the transfer"
    yield share_bar(words, [o.harmless for o in small], at_least(90))
    for each, words, limit in (
        ("two", "two effects: both named", 85),
        ("three", "three effects: all named", 60),
        ("beside", "nonlinear beside linear: both named", 80),
    ):
        yield share_bar(f"W9 {words}", [o.top_right for o in of_kind(outcomes, each)], at_least(limit))


def _strangers(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """Mechanisms that are in no library."""
    strangers = of_kind(outcomes, "stranger")
    yield share_bar("W9 not in the library: no wrong blame", [o.not_blamed for o in strangers], at_least(95))
    yield share_bar("W9 not in the library: located within a node", [o.near_place for o in strangers], at_least(85))
    words = "W9 not in the library: the transfer predicted with at most twice the gap of a repeat"
    yield share_bar(words, [o.predicts for o in strangers], at_least(70))


def rotors(outcomes: Sequence[Outcome]) -> list[str]:
    return sorted({o.label.rotor for o in outcomes})


def _rotors(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """Whether one size of rotor is answered worse than the others."""
    together = rate([good(o) for o in outcomes]).value
    for name in rotors(outcomes) or ["each rotor"]:
        own = rate([good(o) for o in outcomes if o.label.rotor == name])
        points = 100 * (own.value - together) if own.of else math.nan
        beside = f" ({own.hits} of {own.of})"
        yield number_bar(
            f"W9 {name}: good answers, in points above all rotors", points, own.of, Limit(low=-POINTS), beside
        )


def by_rotor(outcomes: Sequence[Outcome]) -> list[tuple[str, str, Rate]]:
    """(kind, rotor, good answers) for every kind and rotor that there is, and of all rotors together."""
    rows = []
    for each in KINDS:
        members = of_kind(outcomes, each)
        rows += [(each, name, rate([good(o) for o in members if o.label.rotor == name])) for name in rotors(members)]
        rows.append((each, "all", rate([good(o) for o in members])))
    return rows


def _intervals(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    inside = [hit for o in outcomes for hit in o.parameters_inside]
    yield share_bar("W9 90 % intervals of parameters cover", inside, COVERAGE)


def _times(outcomes: Sequence[Outcome]) -> Iterator[Bar]:
    """Median seconds of a diagnosis."""
    for words, group, most in (
        ("no effect, or one linear effect", of_kind(outcomes, "nothing", "one", where=_linear), 4),
        ("not in the library", of_kind(outcomes, "stranger"), 12),
        ("two effects", of_kind(outcomes, "two"), 12),
        ("three levels, nonlinear", of_kind(outcomes, "one", "beside", where=lambda o: not _linear(o)), 30),
    ):
        seconds = [o.seconds for o in group if not math.isnan(o.seconds)]
        busy = median([o.processor_seconds for o in group if not math.isnan(o.processor_seconds)])
        beside = f" (of the processor {busy:.3g}; longest {max(seconds, default=0):.3g})"
        yield number_bar(f"W9 seconds, {words}: median", median(seconds), len(seconds), Limit(high=most), beside)


def _linear(o: Outcome) -> bool:
    return not o.label.is_nonlinear
