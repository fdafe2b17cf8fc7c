"""The page of the benchmark: bars, curves, confusions, controls, in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from rigtwin.blind.judge.bars import bars, detection_curve
from rigtwin.blind.judge.score import Outcome, group_table, shuffled
from rigtwin.blind.judge.statistics import rate

_INTRODUCTION = """# The blind benchmark

`rigtwin blind` makes campaigns with a hidden cause, diagnoses them, and scores the answers; it also writes this page.
The generator of the campaigns is in `blind/`. It is a separate implementation with other elements and another solver,
and it imports neither the rotor model nor the diagnosis.

Besides the hidden effect, every rig differs from its drawing in the ways in which real rigs do:

- The modulus, the span and the masses of the disks differ from the drawing by up to 0.1 %.
- The resonances drift by 0.01 % from run to run.
- The force gains are wrong by 2 % and the sensor gains by 1 %.
- The noise is 0.5 to 1 %.

The labels, which say what each campaign hides, are sealed by a SHA-256 checksum before anything is diagnosed.

| set | what its campaigns hide |
| --- | --- |
| W1 | one effect of the library; a third of the campaigns have only one accelerometer |
| W2 | one effect of the library that the diagnosis is not allowed to use |
| W3 | nothing |
| W4 | two effects |
| W5 | an error of the measurement chain |
| W6 | an effect in another functional form, solved in time, or made by another code |
| W7 | an effect at 0.3 to 10 times its detection limit |
| W8 | a mechanism that is in no library |

The tables use these words:

- **Detection limit**: the size of an effect at which its campaign lies three standard deviations from the nearest
  campaign without the effect. An effect is *large* from 30 times its detection limit on, and *small* from 3 to 30
  times.
- **First answer** and **answered set**: the effect that the diagnosis names first, and all effects that it names as
  possible.
- **Gap**: √(Σ|H − Ĥ|²/Σ|H|²), averaged over channels and runs.
- **Held-out transfer**: runs that the diagnosis does not see. In them the force acts at node 4 instead of node 2.
- **Explainable shrink**: how much the correction reduces the gap, divided by how much it could at most. The floor is
  the gap that a repeat run would leave, with its own gains, drift and noise.
- **Wrong blame**: naming an effect of the library for one that is outside it. It does not count where the answer is
  "unknown" or "not enough data". Nor does it count where the answered effect, or the answer "no gap", predicts the
  transfer with at most twice the gap that a repeat run leaves.

A campaign whose diagnosis fails counts as answered wrongly.
"""

_BARS = """A bar is a value that the benchmark has to reach. Shares have Wilson 95 % intervals; the column "of" is the
number of campaigns, or of values, that a share rests on. AUROC is the probability that an effect outside the library
has a higher score than one inside it or none."""

_GROUPS = """Each row is a group of campaigns. The columns mean:

- "top-1", "set" and "place": how often the first answer, the answered set and the place are right.
- "set size (largest)": the mean and the largest number of effects in the answered set.
- "coverage": how often the 90 % intervals of the parameters contain the true value.
- "parameter error" and "k_b error": medians of the relative errors.
- "k_b gain": the error of k_b in the nominal model divided by that after the diagnosis, as a median over the campaigns
  in which the nominal model misses k_b by more than five standard errors.
- "unknown", "not blamed", "false alarms": how often the answer is "unknown", how often an effect outside the library is
  not blamed on a wrong one, and how often a campaign without an effect gets one.
- "Brier" and "ECE": the Brier score and the expected calibration error of the probabilities.
- "shrink median (worst)" and "shrink covered": the explainable shrink where the first answer is right, and how often
  its 90 % interval contains the true one."""


def page(outcomes: Sequence[Outcome], facts: Mapping[str, str]) -> str:
    """Everything; facts: what the figures come from, by name."""
    parts = [
        _INTRODUCTION,
        "## Where the figures come from\n\n" + _table(("", ""), facts.items()),
        f"## Bars\n\n{_BARS}\n\n{bar_table(outcomes)}",
        "## Detection by size (W7)\n\n" + detection_curve(outcomes),
        f"## Groups\n\n{_GROUPS}\n\n{group_table(outcomes)}",
        "## Answers by effect\n\n" + confusions(outcomes),
        "## Rejected draws\n\nThe generator draws an effect again if nobody could have seen it (below 3 times the "
        "detection limit), or if it found no periodic motion.\n\n" + rejected(outcomes),
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
