"""The page of the benchmark: bars, curves, confusions, controls, in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from rigtwin.blind.judge.bars import Bar, bars, detection_curve
from rigtwin.blind.judge.real_bars import KINDS, REAL, by_rotor, real_bars
from rigtwin.blind.judge.score import Outcome, group_table, shuffled
from rigtwin.blind.judge.statistics import rate

# What the page says whatever the results are.
_PROSE = Path(__file__).with_name("prose.md").read_text(encoding="utf-8").removesuffix("\n")
_REAL_PROSE = Path(__file__).with_name("real_prose.md").read_text(encoding="utf-8").removesuffix("\n")
_INTRODUCTION, _BARS, _GROUPS = _PROSE.split("\n<!-- next -->\n")


def page(outcomes: Sequence[Outcome], facts: Mapping[str, str]) -> str:
    """Everything; facts: what the figures come from, by name. W9 alone has a page of its own, else it comes last."""
    real = [o for o in outcomes if o.label.set == REAL]
    others = [o for o in outcomes if o.label.set != REAL]
    if real and not others:
        return real_page(real, facts)
    text = _page(others, facts)
    return f"{text}\n{real_page(real, facts)}" if real else text


def real_page(outcomes: Sequence[Outcome], facts: Mapping[str, str]) -> str:
    """Of the campaigns with rotors of several sizes."""
    introduction, words = _REAL_PROSE.split("\n<!-- next -->\n")
    rows = [(KINDS[each], rotor, good.of, good) for each, rotor, good in by_rotor(outcomes) if good.of]
    parts = [
        introduction,
        "## Where the figures come from\n\n" + _table(("", ""), facts.items()),
        f"## Bars\n\n{words}\n\n{_bar_rows(real_bars(outcomes))}",
        "## Good answers by rotor\n\n" + _table(("what is hidden", "rotor", "campaigns", "good answers"), rows),
        f"## Groups\n\n{_GROUPS}\n\n{group_table(outcomes)}",
        "## Answers by effect\n\n" + confusions(outcomes),
        "## Failures\n\n" + failures(outcomes),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _page(outcomes: Sequence[Outcome], facts: Mapping[str, str]) -> str:
    """Of the sets W1 to W8."""
    parts = [
        _INTRODUCTION,
        "## Where the figures come from\n\n" + _table(("", ""), facts.items()),
        f"## Bars\n\n{_BARS}\n\n{_bar_rows(bars(outcomes))}",
        "## Detection by size (W7)\n\n" + detection_curve(outcomes),
        f"## Groups\n\n{_GROUPS}\n\n{group_table(outcomes)}",
        "## Answers by effect\n\n" + confusions(outcomes),
        "## Rejected draws\n\nThe generator draws an effect again if nobody could have seen it (below 3 times the "
        "detection limit), or if it found no periodic motion.\n\n" + rejected(outcomes),
        "## Controls and failures\n\n" + controls(outcomes) + "\n\n" + failures(outcomes),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def bar_table(outcomes: Sequence[Outcome]) -> str:
    """The bars of all sets that there are; rates have Wilson 95 % intervals."""
    real = [o for o in outcomes if o.label.set == REAL]
    others = [o for o in outcomes if o.label.set != REAL]
    found = bars(others) if others or not real else []
    return _bar_rows([*found, *(real_bars(real) if real else [])])


def _bar_rows(found: Iterable[Bar]) -> str:
    rows = [(b.what, b.count, b.measured, b.interval, b.limit, b.words) for b in found]
    return _table(("bar", "of", "measured", "95 % interval", "has to be", ""), rows)


def confusions(outcomes: Sequence[Outcome]) -> str:
    """What was answered to each label."""
    counts: dict[tuple[str, str, str], Counter[str]] = {}
    for o in outcomes:
        name = o.label.name + (f" ({o.label.form})" if o.label.form else "")
        counts.setdefault((o.label.set, name, o.label.size or ""), Counter())[_answer(o)] += 1
    rows = [
        (*key, sum(found.values()), ", ".join(f"{answer} {n}" for answer, n in found.most_common()))
        for key, found in sorted(counts.items())
    ]
    return _table(("set", "label", "size", "campaigns", "answers"), rows)


def _answer(o: Outcome) -> str:
    """The verdict, or the first cause; marked where it is one of several or at the wrong place."""
    if o.verdict not in ("cause", "ambiguous"):
        return o.verdict
    name = " + ".join(sorted(o.top))
    if o.verdict == "ambiguous":
        others = [" + ".join(sorted(names)) for names in o.answered if names != o.top]
        name += f" or {' or '.join(others)}" if others else " (not sure)"
    return f"{name} elsewhere" if o.top == o.label.ids and not o.located else name


def rejected(outcomes: Sequence[Outcome]) -> str:
    """Draws that were not used, by what was drawn."""
    counts: dict[str, list[int]] = {}
    for o in outcomes:
        row = counts.setdefault(o.label.name, [0, 0, 0])
        row[0] += 1
        row[1] += o.label.table.get("rejected_draws", 0)
        row[2] += o.label.table.get("not_periodic_draws", 0)
    rows = [(name, *row) for name, row in sorted(counts.items()) if row[1] or row[2]]
    return _table(("label", "campaigns", "too small", "no periodic motion"), rows) if rows else "None."


def controls(outcomes: Sequence[Outcome], draws: int = 200) -> str:
    """Answers against the labels of other campaigns: nothing but chance may be left."""
    named = [o for o in outcomes if o.label.ids and not o.label.outside_library]
    if not named:
        return "No campaign hides an effect of the library, so no labels could be shuffled."
    rng = np.random.default_rng(0)
    hits = [np.mean([o.top_right for o in shuffled(named, rng)]) for _ in range(draws)]
    labels = Counter(o.label.ids for o in named)
    answers = Counter(o.top for o in named if o.verdict in ("cause", "ambiguous"))
    chance = sum(labels[ids] * answers[ids] for ids in labels) / len(named) ** 2
    return (
        f"As a control, the labels of the {len(named)} campaigns that hide something of the library were shuffled "
        f"{draws} times. The first answer is then right in {100 * float(np.mean(hits)):.1f} % (with the true labels: "
        f"{rate([o.top_right for o in named])}). By chance alone, as often as each name was hidden and answered, it "
        f"would be right in {100 * chance:.1f} %."
    )


def failures(outcomes: Sequence[Outcome]) -> str:
    """Campaigns without an answer, and why."""
    counts = Counter(o.failure for o in outcomes if o.failure)
    if not counts:
        return f"All {len(outcomes)} campaigns have an answer."
    return _table(("no answer, counted as wrong", "campaigns"), counts.most_common())


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [f"| {' | '.join(head)} |", "|" + " --- |" * len(head)]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row))} |" for row in rows)])
