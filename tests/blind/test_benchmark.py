"""A fixed small part of the benchmark, as it is run: made, sealed, diagnosed in processes of their own, scored."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from rigtwin.blind.generate.campaigns import Order, make, seal
from rigtwin.blind.judge.bars import bars
from rigtwin.blind.judge.results import from_row
from rigtwin.commands import blind
from rigtwin.commands.blind import BlindRequest, diagnose_all, in_own_process, run_blind
from rigtwin.errors import UserError
from rigtwin.scale_out import executor

# Of the tuning split: no gap, a mass; and once more no gap, an artefact, two rotors of ROSS.
ORDERS = (Order("W3", "tuning", 1, 0), Order("W1", "tuning", 1, 0))
MORE = (
    Order("W3", "tuning", 1, 1),
    Order("W5", "tuning", 1, 1),
    Order("W6", "tuning", 1, 7),
    Order("W6", "tuning", 1, 23),
)


@pytest.mark.parametrize("orders", [ORDERS, pytest.param(MORE, marks=pytest.mark.long)], ids=["some", "more"])
def test_right_names_on_a_fixed_part(tmp_path, orders):
    from rigtwin.blind.judge.score import read_outcomes

    campaigns, answers = tmp_path / "campaigns", tmp_path / "answers"
    for order in orders:
        make(order, campaigns)
    seal(campaigns)
    with executor(workers=2) as pool:
        diagnose_all(campaigns, answers, pool)
    outcomes = read_outcomes(campaigns, answers)
    assert len(outcomes) == len(orders)
    for o in outcomes:
        assert not o.failure
        assert o.top_right, f"{o.label.name}: {o.verdict} {sorted(o.top)}"
        assert o.located or not o.label.ids
        assert o.shrink is not None
        if o.label.ids and o.shrink.before > o.shrink.floor:
            assert o.shrink.explainable > 0.8
        elif o.label.ids:  # with k_b recalibrated an asymmetry may leave no more on the transfer than a repeat run does
            assert o.shrink.after < o.shrink.floor


# -- the command, without a diagnosis --------------------------------------------------------------------


def request(folder: Path, **changes) -> BlindRequest:
    settings = {"sets": ("W3",), "split": "tuning", "count": 2, "out": folder, "seed": 7, "workers": 1}
    return BlindRequest(**(settings | changes))


@pytest.fixture
def answered(monkeypatch):
    """Stands in for the process of a diagnosis: the first campaign dies, the others have no gap. Counts the calls."""
    calls: list[str] = []

    def stand_in(campaign: Path, answer: Path, exclude) -> str:
        calls.append(campaign.name)
        answer.mkdir(parents=True, exist_ok=True)
        if len(calls) == 1:
            (answer / "failure.txt").write_text("the process died", encoding="utf-8")
            return "the process died"
        (answer / "failure.txt").unlink(missing_ok=True)
        (answer / "diagnosis.json").write_text(json.dumps({"verdict": "no_gap"}), encoding="utf-8")
        (answer / "seconds.json").write_text(json.dumps({"seconds": 1.5, "processor": 1.0}), encoding="utf-8")
        return "2 s"

    monkeypatch.setattr(blind, "in_own_process", stand_in)
    monkeypatch.setattr(blind, "executor", lambda where, workers: ThreadPoolExecutor(workers))
    return calls


def test_a_failure_is_a_wrong_answer_and_tried_again(tmp_path, answered):
    page = tmp_path / "page.md"
    run_blind(request(tmp_path / "out", page=page))
    rows = json.loads((tmp_path / "page.json").read_text(encoding="utf-8"))["campaigns"]
    outcomes = [from_row(row) for row in rows]
    (alarms,) = [b for b in bars(outcomes) if b.what.startswith("W3")]
    assert (alarms.count, alarms.held) == (2, False)
    assert "| the process died | 1 |" in page.read_text(encoding="utf-8")
    run_blind(request(tmp_path / "out", page=page))
    assert len(answered) == 3
    assert "All 2 campaigns have an answer" in page.read_text(encoding="utf-8")


def test_the_page_comes_from_the_results_alone(tmp_path, answered):
    with pytest.raises(UserError, match=r"blind\.json does not exist"):
        run_blind(request(tmp_path, render_only=True))
    run_blind(request(tmp_path))
    first = (tmp_path / "blind.md").read_text(encoding="utf-8")
    calls = len(answered)
    run_blind(request(tmp_path, render_only=True))
    assert (tmp_path / "blind.md").read_text(encoding="utf-8") == first
    assert len(answered) == calls


@pytest.mark.long
def test_sets_are_added_one_by_one(tmp_path, answered):
    """A set takes its own place, with its seed, and leaves the others of the same split; another split begins anew."""
    page, found = tmp_path / "page.md", []
    for changes in ({}, {"sets": ("W5",)}, {"sets": ("W3",), "seed": 8}, {"split": "report"}):
        run_blind(request(tmp_path / "out", page=page, **changes))
        document = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
        seeds = {key: words.split(", ")[1] for key, words in document["facts"].items() if key.startswith("W")}
        found.append(seeds)
        assert [row["label"]["set"] for row in document["campaigns"]] == [key for key in sorted(seeds) for _ in "12"]
    first = f"seed {request(tmp_path).seed}"
    assert found == [{"W3": first}, {"W3": first, "W5": first}, {"W3": "seed 8", "W5": first}, {"W3": first}]


def test_a_process_that_dies_leaves_a_failure(tmp_path, monkeypatch):
    monkeypatch.setattr(blind, "_ANSWER", (sys.executable, "-c", "import os; os._exit(7)"))
    words = in_own_process(tmp_path / "c1", tmp_path / "answer", ())
    assert "exit code 7" in words
    assert (tmp_path / "answer" / "failure.txt").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["answer"]


def test_an_answer_that_is_there_already_stays(tmp_path, monkeypatch):
    """A worker that was given up may come to its end: the second answer to the same campaign is not taken."""
    answer = tmp_path / "answer"
    first = "from pathlib import Path; import sys; p = Path(sys.argv[2]); (p / 'seconds.json').write_text(sys.argv[3])"
    monkeypatch.setattr(blind, "_ANSWER", (sys.executable, "-c", first))
    for seconds in (3, 8):
        assert in_own_process(tmp_path / "c1", answer, (f'{{"seconds": {seconds}}}',)) == f"{seconds} s"
    assert json.loads((answer / "seconds.json").read_text(encoding="utf-8")) == {"seconds": 3}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["answer"]


def test_a_diagnosis_that_takes_too_long_is_a_failure(tmp_path, monkeypatch):
    monkeypatch.setattr(blind, "_ANSWER", (sys.executable, "-c", "import time; time.sleep(60)"))
    monkeypatch.setattr(blind, "_LONGEST", 0.2)
    words = in_own_process(tmp_path / "c1", tmp_path / "answer", ())
    assert words == "took longer than 0 s"


def test_a_campaign_that_cannot_be_read_leaves_a_failure(tmp_path):
    words = in_own_process(tmp_path / "nowhere", tmp_path / "answer", ())
    assert "nowhere" in words
