"""Prints docs/thresholds.md: ``python -m benchmarks.thresholds``."""

from __future__ import annotations

from benchmarks.page import DOCS, table
from rigtwin.gap.inference.hypotheses import PRIORS
from rigtwin.gap.verdict.thresholds import meanings

PAGE = DOCS / "thresholds.md"


def page() -> str:
    """The page's text."""
    rows = [
        (meaning.stage, f"`{name}`", f"{value:g}", meaning.unit, meaning.words, meaning.set_on)
        for name, value, meaning in meanings()
    ]
    header = ("stage", "name", "value", "unit", "meaning", "set on")
    priors = [
        ("`no_gap`", f"{PRIORS.no_gap:g}", "Probability, before the data, that there is no gap at all."),
        (
            "`pair_log_odds`",
            f"{PRIORS.pair_log_odds:g}",
            "Logarithm of the odds, before the data, against two effects at once: a pair must earn that much evidence.",
        ),
    ]
    return f"""# Thresholds

Every number that decides what a diagnosis answers. The page is printed from `gap/verdict/thresholds.py` by
`make thresholds`; [the method](diagnosis-method.md) says where each one is used.

No threshold was set on a report campaign of the [blind benchmark](blind.md): those are looked at once, to judge.

{table(header, rows)}
## Probabilities before the data

{table(("name", "value", "meaning"), priors)}"""


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)


if __name__ == "__main__":
    main()
