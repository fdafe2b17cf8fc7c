"""Numbers as they are printed."""

from __future__ import annotations

import math

import pytest

from rigtwin.console import progress
from rigtwin.wording import counted, exponent, interval, percent, unbroken, with_error


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (25.0, 2.1213, "25.0 ± 2.1"),
        (100.561234, 0.000144, "100.56123 ± 0.00014"),
        (1234.5, 67.0, "1234 ± 67"),
        (100.5612, 1e-9, "100.5612"),
        (100.5612, 0.0, "100.5612"),
        (1.0, math.inf, "1 ± ?"),
        (math.nan, 1.0, "nan"),
    ],
)
def test_an_error_has_two_digits_and_the_value_as_many_decimals(value, std, text):
    assert with_error(value, std) == text


def test_an_interval_shows_that_its_ends_differ():
    assert interval(9.9978e6, 10.0022e6) == "9.9978 to 10.0022"
    assert interval(1.01e6, 1.23e6) == "1.01 to 1.23"
    assert interval(1e7, 1e7) == "10.000000 to 10.000000"


def test_small_words():
    assert exponent(1.3e6) == "1.3e6"
    assert percent(-0.0549) == "−5.5 %"


def test_a_number_stays_with_its_unit_and_its_error():
    assert unbroken("1 % of 25 ± 2 Hz, 19 N s/m") == "1\xa0% of 25\xa0±\xa02\xa0Hz, 19\xa0N\xa0s/m"


def test_a_long_work_without_a_terminal_says_now_and_then_how_far_it_is(capsys, monkeypatch):
    monkeypatch.setattr("rigtwin.console._SECONDS_BETWEEN_STAGES", 3600.0)
    with progress("rigs", 3) as count:
        count(1)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("rigtwin.console._SECONDS_BETWEEN_STAGES", -1.0)
    with progress("rigs", 3) as count:
        count(2)
    assert capsys.readouterr().err == "rigtwin: rigs, 2 of 3\n"


@pytest.mark.parametrize(("count", "words"), [(0, "0 lines"), (1, "1 line"), (2, "2 lines")])
def test_one_is_no_plural(count, words):
    assert counted(count, "line") == words
