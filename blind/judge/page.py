"""The page of the benchmark: bars, curves, confusions, controls, in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from rigtwin.blind.judge.bars import bars, detection_curve
from rigtwin.blind.judge.score import Outcome, group_table, shuffled
from rigtwin.blind.judge.statistics import rate

_INTRODUCTION = """# The blind benchmark

`rigtwin blind` makes campaigns whose cause is sealed, diagnoses them, and scores the answers; this page is what it
wrote. The generator `gap/blind` is an implementation of its own, with other elements and another solver, and imports
neither the rotor model nor the diagnosis. Beside the effect, every rig has a modulus, span and disk masses that differ
from the drawing by up to 0.1 %, resonances that drift by 0.01 % from run to run, force gains that err by 2 %, sensor
gains by 1 %, and noise of 0.5 to 1 %. Labels are sealed by SHA-256 before anything is diagnosed.

| set | what its campaigns hide |
| --- | --- |
| W1 | one effect of the library; a third with one accelerometer |
| W2 | one effect of the library that is withheld from the diagnosis |
| W3 | nothing |
| W4 | two effects |
| W5 | an error of the measurement chain |
| W6 | an effect in another functional form, solved in time, or made by another code |
| W7 | an effect at 0.3 to 10 times its detection limit |
| W8 | a mechanism that is in nobody's library |

An effect is *large* from 30 times its detection limit on, *small* from 3 to 30 times; the limit is where its campaign
lies three standard deviations from the nearest one without it. A gap is √(Σ|H − Ĥ|²/Σ|H|²), averaged over channels and
runs. The *transfer* is held out whole: the force acts at node 4 instead of 2. *Explainable* is a shrink over the one
that a repeat run would leave, with its own gains, drift and noise. A campaign whose diagnosis fails counts as answered
wrongly. An effect that is outside the library is *not blamed* on a wrong one where the answer is "unknown" or "not
enough data", or where what is answered, an effect or none, predicts the transfer to twice what a repeat run leaves.
"""


def page(outcomes: Sequence[Outcome], facts: Mapping[str, str]) -> str:
    """Everything; facts: what the figures come from, by name."""
    parts = [
        _INTRODUCTION,
        "## Where the figures come from\n\n" + _table(("", ""), facts.items()),
        "## Bars\n\n" + bar_table(outcomes),
        "## Detection by size (W7)\n\n" + detection_curve(outcomes),
        "## Groups\n\n" + group_table(outcomes),
        "## Answers by effect\n\n" + confusions(outcomes),
        "## Rejected draws\n\nDraws that nobody could have seen (below 3 times the detection limit), and draws of "
        "which the generator found no periodic motion, are drawn again.\n\n" + rejected(outcomes),
        "## Controls and failures\n\n" + controls(outcomes) + "\n\n" + failures(outcomes),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def bar_table(outcomes: Sequence[Outcome]) -> str:
    """Rates have Wilson 95 % intervals."""
    rows = [(b.what, b.count, b.measured, b.interval, b.limit, b.words) for b in bars(outcomes)]
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
        return "Nothing to name, so that no labels could be shuffled."
    rng = np.random.default_rng(0)
    hits = [np.mean([o.top_right for o in shuffled(named, rng)]) for _ in range(draws)]
    labels = Counter(o.label.ids for o in named)
    answers = Counter(o.top for o in named if o.verdict in ("cause", "ambiguous"))
    chance = sum(labels[ids] * answers[ids] for ids in labels) / len(named) ** 2
    return (
        f"Labels shuffled among the {len(named)} campaigns that hide something of the library, {draws} times: first "
        f"answer right in {100 * float(np.mean(hits)):.1f} % (as drawn: {rate([o.top_right for o in named])}); chance, "
        f"from how often each name was hidden and answered: {100 * chance:.1f} %."
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
