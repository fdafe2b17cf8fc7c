"""Bars, rows and the page on outcomes made by hand."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from rigtwin.blind.judge.bars import bars, detection_curve
from rigtwin.blind.judge.page import confusions, controls, failures, page, rejected
from rigtwin.blind.judge.results import from_row, to_row
from rigtwin.blind.judge.score import Outcome, Shrink, failed, outcome
from tests.blind.test_score import MASS, diagnosis, label

RIGHT = diagnosis("cause", ("attached_mass", 0.95))
WRONG = diagnosis("cause", ("open_crack", 0.95))


def bar(start: str, outcomes: list[Outcome]):
    (found,) = [b for b in bars(outcomes) if b.what.startswith(start)]
    return found


def many(right: int, wrong: int, **changes) -> list[Outcome]:
    return [outcome(label(MASS, **changes), RIGHT)] * right + [outcome(label(MASS, **changes), WRONG)] * wrong


@pytest.mark.parametrize(
    ("what", "changes", "enough", "too_few"),
    [
        ("W1 large, seven nodes: first answer", {}, (98, 2), (97, 3)),
        ("W1 large, seven nodes: answered set", {}, (100, 0), (99, 1)),
        ("W1 small, seven nodes: first answer", {"size": "small"}, (85, 15), (84, 16)),
        ("W1 small, seven nodes: answered set", {"size": "small"}, (97, 3), (96, 4)),
        ("W1 large, one accelerometer: first answer", {"sensors": "one"}, (95, 5), (94, 6)),
        ("W1 large, one accelerometer: answered set", {"sensors": "one"}, (99, 1), (98, 2)),
        ("W1 small, one accelerometer: first", {"sensors": "one", "size": "small"}, (80, 20), (79, 21)),
        ("W1 small, one accelerometer: answered", {"sensors": "one", "size": "small"}, (95, 5), (94, 6)),
        ("W1 large, seven nodes: place", {}, (98, 2), (97, 3)),
        ("W1 small, seven nodes: place", {"size": "small"}, (85, 15), (84, 16)),
        ("W4 large", {"set": "W4"}, (90, 10), (89, 11)),
        ("W4 small", {"set": "W4", "size": "small"}, (70, 30), (69, 31)),
        ("W5", {"set": "W5"}, (90, 10), (89, 11)),
        ("W6", {"set": "W6"}, (85, 15), (84, 16)),
    ],
)
def test_names_and_places_are_held_from_their_share_on(what, changes, enough, too_few):
    assert bar(what, many(*enough, **changes)).held is True
    assert bar(what, many(*too_few, **changes)).held is False
    assert bar(what, []).held is None


def test_nonlinear_effects_have_bars_of_their_own():
    rub = {"id": "rub", "parameters": {}, "location": {"kind": "node", "node": 3}}
    hidden = label(rub, levels=[0.3, 1.0, 3.0])
    found = [outcome(hidden, diagnosis("cause", ("rub", 0.9)))] * 9 + [outcome(hidden, WRONG)]
    assert bar("W1 nonlinear, three levels: name", found).held
    assert bar("W1 nonlinear, three levels: place", found).count == 10
    assert bar("W1 large, seven nodes: first", found).count == 0


def test_blame_alarms_and_the_unknown_score():
    outside = label(MASS, set="W8")
    right, wrong = outcome(outside, diagnosis("unknown", unknown_score=0.9)), outcome(outside, WRONG)
    assert bar("W2 and W8 large", [right] * 95 + [wrong] * 5).held is True
    assert bar("W2 and W8 large", [right] * 94 + [wrong] * 6).held is False
    assert bar("AUROC", [right, *many(1, 0)]).held is True
    empty = label(set="W3", size=None)
    quiet, loud = outcome(empty, diagnosis("no_gap")), outcome(empty, WRONG)
    assert bar("W3", [quiet] * 95 + [loud] * 5).held is True
    assert bar("W3", [quiet] * 94 + [loud] * 6).held is False


def shrunk(*explainable: float, **changes) -> list[Outcome]:
    """Gaps of 1 before, noise none."""
    (known,) = many(1, 0, **changes)
    return [replace(known, shrink=Shrink(1.0, 1.0 - e, 0.0, 0.9, 1.0)) for e in explainable]


def test_shrink_bars():
    what = "explainable shrink on the held-out transfer"
    assert bar(f"{what}, large: median", shrunk(0.9, 0.99, 1.0)).held is True
    assert bar(f"{what}, large: median", shrunk(0.9, 0.98, 1.0)).held is False
    assert bar(f"{what}, large: worst", shrunk(0.95, 1.0)).held is True
    assert bar(f"{what}, large: worst", shrunk(0.89, 1.0)).held is False
    assert bar(f"{what}, small: median", shrunk(0.8, size="small")).held is True
    covered = "90 % interval of the shrink covers the one free of noise on the held-out transfer"
    assert bar(covered, shrunk(*[0.95] * 9, 0.5)).held is True
    assert bar(covered, shrunk(*[0.95] * 8, 0.5, 0.5)).held is False
    assert bar(covered, shrunk(*[0.95] * 10)).held is False
    other = [replace(o, control=Shrink(1.0, 0.6, 0.0)) for o in shrunk(1.0)]
    control = "explainable shrink by a random effect outside the answered set"
    assert bar(f"{control}: median", other).held is False
    assert bar(f"{control}: median", shrunk(1.0)).held is None
    assert bar(f"{control}, beyond", other).held is None
    most_without = [replace(o, no_effect=Shrink(1.0, 0.7, 0.0)) for o in other]
    assert bar(f"{control}, beyond", most_without).measured == "0.1"
    assert "without any effect: 0.3" in bar(f"{control}: median", most_without).measured


def test_bars_on_numbers():
    (known,) = many(1, 0)  # k_b is off by 20 % before and by 1 % after
    assert bar("error of k_b", [known]).held is True
    assert bar("error of k_b", [replace(known, k_b_error=0.03)]).held is False
    assert bar("error of k_b", [replace(known, k_b_miss=4.0)]).held is None
    assert bar("90 % intervals of parameters", [known] * 10).held is False
    some = [replace(known, parameters_inside=(k > 0,)) for k in range(10)]
    assert bar("90 % intervals of parameters", some).held is True
    assert bar("calibration error", many(95, 5)).held is True
    assert bar("calibration error", many(80, 20)).held is False
    wide = [replace(known, answered=(known.top,) * n) for n in (1, 1, 4)]
    assert bar("effects in the answered set: mean", wide[:2]).held is True
    assert bar("effects in the answered set: most", wide).held is False
    slow = [replace(known, seconds=s) for s in (10.0, 19.0)]
    assert bar("seconds of a campaign, one linear", slow).held is True
    assert bar("seconds of a campaign, one linear", [*slow, replace(known, seconds=90.0)]).held is False


def test_rows_come_back_as_they_were():
    (known,) = shrunk(0.9)
    for before in (known, failed(label(MASS), "died")):
        text = json.dumps(to_row(before), allow_nan=False)
        after = from_row(json.loads(text))
        assert json.dumps(to_row(after)) == text
        assert (after.top_right, after.answered, after.label.ids) == (
            before.top_right,
            before.answered,
            before.label.ids,
        )
    assert math.isnan(from_row(to_row(known)).seconds)


def test_the_curve_counts_by_size():
    seen = [outcome(label(MASS, set="W7", size_ratio=r), d) for r, d in ((0.4, diagnosis("no_gap")), (4.0, RIGHT))]
    rows = detection_curve(seen).splitlines()
    assert rows[2].startswith("| 0.3 to 0.5 | 1 | 0.0 %")
    assert any(row.startswith("| 3 to 5 | 1 | 100.0 %") for row in rows)


def test_confusions_failures_and_rejections_are_listed():
    found = [*many(2, 1), failed(label(MASS, rejected_draws=3), "the process died")]
    assert "| W1 | attached_mass | large | 4 | attached_mass 2, open_crack 1, failed 1 |" in confusions(found)
    assert "| the process died | 1 |" in failures(found)
    assert "| attached_mass | 4 | 3 | 0 |" in rejected(found)
    text = page(found, {"python": "3.11"})
    assert "| python | 3.11 |" in text
    assert all(b.what in text for b in bars(found))


def test_shuffled_labels_leave_chance():
    crack = {"id": "open_crack", "parameters": {}, "location": {"kind": "position", "x_m": 0.1}}
    found = many(10, 0) + [outcome(label(crack), WRONG)] * 10
    words = controls(found)
    assert "as often as each name was hidden and answered, it would be right in 50.0 %" in words
    share = float(words.split("right in ")[1].split(" %")[0])
    assert 45 < share < 55
