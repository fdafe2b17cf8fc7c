"""The paper's measured numbers as the demo reads them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from rigtwin.api.fmus import open_estimator
from rigtwin.commands.paper import PaperReading, printed, read_paper, verdict

PAPER_TABLES = Path(__file__).resolve().parents[2] / "benchmarks" / "paper_tables.toml"


@pytest.fixture(scope="module")
def paper() -> PaperReading:
    with open_estimator() as (ask, card):
        return read_paper(ask, card)


def test_both_shifts_and_the_estimator_agree_on_one_stiffness(paper):
    first, second, fused = paper.readings
    assert paper.agree
    assert_allclose([first.k_b, second.k_b, fused.k_b], 1.11e6, rtol=0.02)
    assert paper.estimate.valid


def test_the_papers_own_answer_is_stiffer_than_its_shifts(paper):
    """At 1.3 MN/m the model's second shift is more than two standard errors from the measured one."""
    one, two = paper.deviations_at_printed()
    assert 1 < one < 1.2
    assert 2 < two < 3
    assert paper.printed_k_b > paper.estimate.k_b_high


def test_the_measured_ratio_needs_bearing_damping(paper):
    assert 3 < paper.undamped_ratio < 3.5
    assert 15 < paper.bearing_damping < 25


def test_the_first_peak_lies_below_the_model_on_rigid_supports_too(paper):
    assert paper.peaks[0].name == "f1, rigid support"
    assert_allclose(paper.peaks[0].difference, 95 / 100.56 - 1, atol=1e-4)


def test_the_verdict_names_every_number(paper):
    text = " ".join(verdict(paper))
    for number in ("1.125", "1.108", "1.111", "1.3 MN/m", "0.78", "19 N s/m", "95 Hz against 100.6 Hz"):
        assert number in text


def test_the_demos_copy_of_the_printed_numbers_is_the_benchmarks():
    source = tomllib.loads(PAPER_TABLES.read_text(encoding="utf-8"))
    copy = printed()
    assert copy["table1"] == {
        "k_b": source["table1"]["k_b"], "f1": source["table1"]["program_f1"], "f2": source["table1"]["program_f2"],
    }  # fmt: skip
    assert copy["table2"] == {
        "k_b": source["table2"]["k_b"], "delta_f1": source["table2"]["df1_Hz"], "delta_f2": source["table2"]["df2_Hz"],
    }  # fmt: skip
    assert copy["conclusion"]["k_b"] == source["rig"]["estimated_k_b"]
    assert copy["conclusion"]["amplitude_ratio"] == source["rig"]["amplitude_ratio_A1_over_A0"]
