"""The bars of W9 on outcomes made by hand, and its page."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest

from rigtwin.blind.judge.page import bar_table, page
from rigtwin.blind.judge.real_bars import by_rotor, good, kind, real_bars
from rigtwin.blind.judge.results import from_row, to_row
from rigtwin.blind.judge.score import Outcome, Shrink, outcome
from tests.blind.test_score import CRACK, MASS, diagnosis, label

ABSORBER = {"id": "tuned_absorber", "parameters": {}, "location": {"kind": "node", "node": 4}}
PLATE = {"id": "common_base", "parameters": {}, "location": {"kind": "bearings"}}
RUB = {"id": "rub", "parameters": {}, "location": {"kind": "node", "node": 3}}
OFFSET = {"id": "bearing_offset", "parameters": {}, "location": {"kind": "bearings"}}
LEVELS = [0.3, 1.0, 3.0]


def real(*effects: dict[str, Any], **changes: Any):
    table = {
        "set": "W9", "rotor": "spindle", "nodes_m": [0.0, 0.08, 0.16], "bearings": [2, 5], "drive_node": 3,
    }  # fmt: skip
    return label(*effects, **(table | changes))


def named(*effects: dict[str, Any], **changes: Any) -> Outcome:
    names = "+".join(e["id"] for e in effects)
    return outcome(real(*effects, **changes), diagnosis("cause", (names, 0.9)))


def missed(*effects: dict[str, Any], **changes: Any) -> Outcome:
    return outcome(real(*effects, **changes), diagnosis("cause", ("shaft_damping", 0.9)))


def bar(start: str, outcomes: list[Outcome]):
    (found,) = [b for b in real_bars(outcomes) if b.what.startswith(start)]
    return found


def test_a_campaign_is_of_the_kind_that_it_hides():
    assert kind(named()) == "nothing"
    assert kind(named(MASS)) == kind(named(RUB, levels=LEVELS)) == "one"
    assert kind(named(MASS, CRACK)) == "two"
    assert kind(named(RUB, MASS, levels=LEVELS)) == "beside"
    assert kind(named(MASS, CRACK, OFFSET)) == "three"
    assert kind(named(ABSORBER)) == "stranger"


@pytest.mark.parametrize(
    ("what", "effects", "changes", "enough"),
    [
        ("W9 one large effect: named", (MASS,), {}, 95),
        ("W9 one large effect: place", (MASS,), {}, 95),
        ("W9 one small effect: named", (MASS,), {"size": "small"}, 75),
        ("W9 one small effect: named, in", (MASS,), {"size": "small"}, 90),
        ("W9 two effects", (MASS, CRACK), {}, 85),
        ("W9 three effects", (MASS, CRACK, OFFSET), {}, 60),
        ("W9 nonlinear beside linear", (RUB, MASS), {"levels": LEVELS}, 80),
    ],
)
def test_names_and_places_are_held_from_their_share_on(what, effects, changes, enough):
    right, wrong = named(*effects, **changes), missed(*effects, **changes)
    one = next(b for b in real_bars([right]) if b.what.startswith(what))
    found = [
        b for n in (enough, enough - 1) for b in real_bars([right] * n + [wrong] * (100 - n)) if b.what == one.what
    ]
    assert [b.held for b in found] == [True, False]
    assert next(b for b in real_bars([]) if b.what == one.what).held is None


def test_false_alarms():
    quiet, loud = outcome(real(), diagnosis("no_gap")), outcome(real(), diagnosis("unknown"))
    assert bar("W9 nothing", [quiet] * 95 + [loud] * 5).held is True
    assert bar("W9 nothing", [quiet] * 94 + [loud] * 6).held is False


def test_a_small_effect_that_is_not_named_does_no_harm_if_the_transfer_is_predicted():
    hidden = real(MASS, size="small")
    unseen = outcome(hidden, diagnosis("no_gap"), Shrink(0.03, 0.03, 0.02))
    overseen = outcome(hidden, diagnosis("no_gap"), Shrink(0.05, 0.05, 0.02))
    answer = diagnosis("ambiguous", ("open_crack", 0.6), equivalent=["open_crack", "attached_mass"])
    doubtful = outcome(hidden, answer)
    assert [o.harmless for o in (unseen, overseen, doubtful, missed(MASS))] == [True, False, True, False]
    assert not any(o.top_right for o in (unseen, overseen, doubtful))


def unknown(effect: dict[str, Any], where: dict[str, Any], after: float = 0.03) -> Outcome:
    return outcome(real(effect), diagnosis("unknown", where=where), Shrink(0.5, after, 0.02))


def test_a_stranger_is_located_by_the_joint_or_else_by_the_largest_share():
    nodes = [{"node": 1, "share": 0.2}, {"node": 5, "share": 0.8}]
    assert unknown(ABSORBER, {"nodes": nodes}).near_place
    assert not unknown(ABSORBER, {"nodes": nodes, "joint": {"node": 1}}).near_place
    assert unknown(PLATE, {"joint": {"node": 6}}).near_place  # beside the bearing at node 5
    assert not unknown(PLATE, {"joint": {"node": 7}}).near_place
    assert not unknown(ABSORBER, {}).near_place
    coil = {"id": "voice_coil", "parameters": {}, "location": {"kind": "exciter"}}
    assert unknown(coil, {"joint": {"node": 2}}).near_place
    assert not unknown(coil, {"joint": {"node": 5}}).near_place


def test_bars_on_strangers():
    close, far = unknown(ABSORBER, {"joint": {"node": 4}}), unknown(ABSORBER, {"joint": {"node": 1}}, after=0.05)
    assert bar("W9 not in the library: located", [close] * 85 + [far] * 15).held is True
    assert bar("W9 not in the library: located", [close] * 84 + [far] * 16).held is False
    assert bar("W9 not in the library: the transfer", [close] * 70 + [far] * 30).held is True
    assert bar("W9 not in the library: the transfer", [close] * 69 + [far] * 31).held is False
    blamed = missed(ABSORBER)
    assert bar("W9 not in the library: no wrong blame", [close] * 95 + [blamed] * 5).held is True
    assert bar("W9 not in the library: no wrong blame", [close] * 94 + [blamed] * 6).held is False


def test_no_rotor_may_be_answered_worse_than_the_others():
    pumps = [named(MASS, rotor="pump-overhung")] * 50
    for wrong, held in ((5, True), (6, False)):
        mine = [named(MASS)] * (50 - wrong) + [missed(MASS)] * wrong
        assert bar("W9 spindle", [*pumps, *mine]).held is held
        assert bar("W9 pump-overhung", [*pumps, *mine]).held is True
    rows = {(each, rotor): rate for each, rotor, rate in by_rotor([*pumps, *mine])}
    assert rows["one", "spindle"].hits == 44
    assert (rows["one", "all"].of, rows["stranger", "all"].of) == (100, 0)


def test_intervals_and_times():
    some = [replace(named(MASS), parameters_inside=(k > 0,)) for k in range(10)]
    assert bar("W9 90 %", some).held is True
    assert bar("W9 90 %", some[1:]).held is False
    for what, hidden, changes, most in (
        ("W9 seconds, no effect, or", (MASS,), {}, 4.0),
        ("W9 seconds, not in the library", (ABSORBER,), {}, 12.0),
        ("W9 seconds, two", (MASS, CRACK), {}, 12.0),
        ("W9 seconds, three levels", (RUB,), {"levels": LEVELS}, 30.0),
    ):
        for seconds, held in ((most, True), (1.1 * most, False), (math.nan, None)):
            assert bar(what, [replace(named(*hidden, **changes), seconds=seconds)]).held is held


def test_a_crack_is_placed_in_proportion_to_the_rotor():
    place = {"kind": "position", "x_m": 0.2035}
    answer = diagnosis("cause", ("open_crack", 0.9))
    answer["causes"][0]["location"] = place
    assert outcome(real(CRACK), answer).located  # within 10 mm of 426, that is 3.76 mm of 160
    place["x_m"] = 0.2040
    assert not outcome(real(CRACK), answer).located
    assert outcome(label(CRACK), answer).located


def test_rows_come_back_with_what_the_bars_need():
    for before in (unknown(ABSORBER, {"joint": {"node": 4}}), named(RUB, MASS, levels=LEVELS)):
        after = from_row(json.loads(json.dumps(to_row(before), allow_nan=False)))
        assert (kind(after), good(after), after.near_place) == (kind(before), good(before), before.near_place)
        assert (after.label.rotor, after.label.position_tolerance) == ("spindle", before.label.position_tolerance)


def test_w9_alone_has_a_page_of_its_own_and_comes_last_beside_others():
    ours = [named(MASS), missed(MASS, rotor="pump-overhung")]
    others = [outcome(label(MASS), diagnosis("cause", ("attached_mass", 0.9)))]
    alone, both, without = (page(found, {"python": "3.11"}) for found in (ours, [*others, *ours], others))
    assert alone.startswith("# The blind benchmark on rotors of three sizes")
    assert all(b.what in alone for b in real_bars(ours))
    assert "W1 large" not in alone
    assert "| one effect | spindle | 1 | 100.0 %" in alone
    assert both == f"{without}\n{alone}"
    assert "W9" not in without
    assert ("W1 large" in bar_table(ours), "W9 one" in bar_table(ours)) == (False, True)
    assert "W9" not in bar_table(others)
