"""The scorer on cases made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.blind.judge.score import (
    Outcome,
    Shrink,
    failed,
    gap,
    group_table,
    groups,
    label_from,
    outcome,
    read_shrink,
    score,
    shuffled,
    unknown_auroc,
)
from rigtwin.blind.judge.statistics import auroc, brier, calibration_error, rate

MASS = {"id": "attached_mass", "parameters": {"mass": 0.1}, "location": {"kind": "node", "node": 3}}
CRACK = {"id": "open_crack", "parameters": {"reduction": 0.2}, "location": {"kind": "position", "x_m": 0.2}}


def label(*effects: dict[str, Any], **changes: Any):
    table = {
        "campaign": "c", "set": "W1", "effects": list(effects), "exclude": [], "size": "large", "size_ratio": 50.0,
        "k_b": 1e6, "sensors": "all", "levels": [1.0],
    }  # fmt: skip
    return label_from(table | changes)


def diagnosis(verdict: str, *causes: tuple[str, float], **changes: Any) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "nominal": {"k_b": {"value": 1.2e6, "std": 1e4}},
        "causes": [
            {
                "effects": name.split("+"),
                "probability": p,
                "location": {"kind": "node", "node": 3},
                "parameters": {"attached_mass.mass": {"value": 0.11, "std": 0.01}},
                "k_b": {"value": 1.01e6, "std": 1e4},
            }
            for name, p in causes
        ],
    } | changes


def test_a_right_cause_counts_with_place_parameter_and_stiffness():
    o = outcome(label(MASS), diagnosis("cause", ("attached_mass", 0.95), ("open_crack", 0.05)))
    assert o.top_right
    assert o.set_right
    assert o.located
    assert o.parameters_inside == (True,)
    assert_allclose(o.parameter_errors, [0.1])
    assert_allclose(score("", [o]).k_b_gain, 20.0)


def test_an_ambiguous_answer_hits_by_its_set():
    d = diagnosis("ambiguous", ("open_crack", 0.6), ("attached_mass", 0.4), equivalent=["open_crack", "attached_mass"])
    o = outcome(label(MASS), d)
    assert not o.top_right
    assert o.set_right
    assert len(o.answered) == 2
    assert not o.located


def test_a_crack_is_placed_within_ten_millimetres():
    place = {"kind": "position", "x_m": 0.209}
    d = diagnosis("cause", ("open_crack", 0.9))
    d["causes"][0]["location"] = place
    assert outcome(label(CRACK), d).located
    place["x_m"] = 0.211
    assert not outcome(label(CRACK), d).located


def test_a_pair_needs_both():
    both = label(MASS, CRACK)
    assert outcome(both, diagnosis("cause", ("open_crack+attached_mass", 0.9))).top_right
    assert not outcome(both, diagnosis("cause", ("attached_mass", 0.9))).top_right


def test_unknown_is_right_where_the_effect_is_withheld():
    withheld = label(MASS, set="W2", exclude=["attached_mass"])
    assert outcome(withheld, diagnosis("unknown", ("open_crack", 0.3))).top_right
    wrong = outcome(withheld, diagnosis("cause", ("open_crack", 0.95)))
    assert not wrong.top_right
    assert not wrong.not_blamed
    equivalent = outcome(withheld, diagnosis("cause", ("open_crack", 0.95)), Shrink(0.5, 0.03, 0.02))
    assert equivalent.not_blamed


def test_no_gap_is_right_where_there_is_none():
    empty = label(set="W3", size=None, size_ratio=None)
    quiet, loud = outcome(empty, diagnosis("no_gap")), outcome(empty, diagnosis("cause", ("attached_mass", 0.9)))
    s = score("W3", [quiet, loud])
    assert (s.false_alarms.hits, s.false_alarms.of) == (1, 2)
    assert s.top1.hits == 1


def test_wilson_interval_of_eight_in_ten():
    # Brown, Cai and DasGupta, Statistical Science 16 (2001): 0.490 to 0.943
    low, high = rate([True] * 8 + [False] * 2).interval
    assert_allclose([low, high], [0.490, 0.943], atol=5e-4)


def test_statistics_of_known_cases():
    assert auroc([0.9, 0.8], [0.1, 0.8]) == 0.875
    assert_allclose(brier([1.0, 0.5], [True, False]), 0.125)
    assert_allclose(calibration_error([0.9] * 10, [True] * 9 + [False]), 0.0, atol=1e-12)
    assert_allclose(calibration_error([0.9] * 10, [False] * 10), 0.9)


def test_auroc_separates_strangers_from_known_effects():
    known = outcome(label(MASS), diagnosis("cause", ("attached_mass", 0.99)))
    strange = outcome(label(MASS, set="W8"), diagnosis("unknown", ("attached_mass", 0.2)))
    empty = outcome(label(set="W3", size=None), diagnosis("no_gap", unknown_score=0.9))
    assert unknown_auroc([known, strange]) == 1.0
    assert unknown_auroc([known, strange, empty]) == 0.5


def test_no_answer_is_a_wrong_answer():
    named, outside = failed(label(MASS), "died"), failed(label(MASS, set="W8"), "died")
    empty = failed(label(set="W3", size=None), "died")
    assert not any((named.top_right, named.set_right, named.located, outside.top_right, outside.not_blamed))
    assert empty.false_alarm
    assert (named.unknown_score, outside.unknown_score) == (1.0, 0.0)


def test_no_gap_is_no_blame_only_where_the_nominal_model_predicts():
    withheld = label(MASS, set="W2", exclude=["attached_mass"])
    assert outcome(withheld, diagnosis("no_gap"), Shrink(0.03, 0.03, 0.02)).not_blamed
    assert not outcome(withheld, diagnosis("no_gap"), Shrink(0.3, 0.3, 0.02)).not_blamed


def test_shuffled_labels_score_at_chance():
    names = [f"effect_{i}" for i in range(20)]
    outcomes = [
        outcome(label({"id": n, "parameters": {}, "location": {"kind": "shaft"}}), diagnosis("cause", (n, 0.9)))
        for n in names * 5
    ]
    assert score("", outcomes).top1.value == 1.0
    low, high = score("", shuffled(outcomes, np.random.default_rng(0))).top1.interval
    assert low < 1 / 20 < high


def test_tables_have_a_row_for_every_group():
    outcomes: list[Outcome] = [outcome(label(MASS), diagnosis("cause", ("attached_mass", 0.99)))]
    text = group_table(outcomes)
    assert all(f"| {name} |" in text for name in groups(outcomes))


def test_gap_leaves_silent_channels_out():
    H = np.array([[1.0, 1e-9], [2.0, 1e-9]], dtype=complex)
    assert_allclose(gap(H, 1.1 * H + np.array([0.0, 1.0])), 0.1)


def test_shrink_is_read_from_predicted_files(tmp_path):
    from rigtwin.blind.generate.folder import write_csv

    frequency, H = np.linspace(20, 30, 5), np.ones((5, 7), dtype=complex)
    (tmp_path / "truth").mkdir()
    arrays = {"frequency_Hz": frequency, "ideal": H, "actual": 1.01 * H, "std": 0.005 * np.abs(H)}
    np.savez(tmp_path / "truth" / "held_out.npz", **{f"run01/{k}": v for k, v in arrays.items()})
    for kind, factor in (("nominal", 1.5), ("corrected", 1.05)):
        (tmp_path / kind).mkdir()
        write_csv(tmp_path / kind / "run01.csv", frequency, factor * H, range(1, 8), None)
    nominal, corrected = tmp_path / "nominal", tmp_path / "corrected"
    shrink = read_shrink(tmp_path, nominal, corrected, {"shrink": {"ci90": [0.8, 0.95]}})
    assert shrink is not None
    assert_allclose([shrink.before, shrink.after, shrink.true], [0.5, 0.05, 0.9])
    assert_allclose(shrink.floor, np.hypot(0.01, 0.005))
    assert shrink.covered
    assert read_shrink(tmp_path, nominal, tmp_path / "elsewhere", {}) is None


@pytest.mark.parametrize("verdict", ["no_gap", "cause", "ambiguous", "unknown", "not_enough_data"])
def test_every_verdict_can_be_judged(verdict):
    outcome(label(MASS), {"verdict": verdict})
