"""Fits shared with helpers: in order, whoever does them, and the same answer."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from gap.helpers import each, helped_by
from gap.search import recalibrate, search
from rigtwin.scale_out import executor
from rotor.effects import AttachedMass
from tests.gap.conftest import both_supports, of, problem_of


def test_results_come_in_the_order_of_the_items_whoever_makes_them():
    met = threading.Barrier(2, timeout=10)
    made_by = {}

    def work(item):
        made_by[item] = threading.get_ident()
        if item in (0, 9):  # this thread begins at the front, the helper at the back: they meet
            met.wait()
        return item**2

    with ThreadPoolExecutor(1) as pool, helped_by(pool):
        assert list(each(work, range(10))) == [k**2 for k in range(10)]
    assert made_by[0] == threading.get_ident() != made_by[9]


def test_without_helpers_nothing_is_shared():
    assert list(each(lambda _: threading.get_ident(), range(3))) == [threading.get_ident()] * 3


def test_what_a_helper_raises_is_raised_here_and_the_rest_is_dropped():
    def work(item):
        raise ValueError(f"no model of {item}")

    with ThreadPoolExecutor(1) as pool, helped_by(pool), pytest.raises(ValueError, match="no model of"):
        list(each(work, range(100)))


def _pid() -> int:
    return os.getpid()


def test_another_process_makes_the_same_search():
    problem = problem_of(*both_supports(AttachedMass(mass=0.1, node=4), seed=3))
    nominal, hypotheses = recalibrate(problem), of(problem.runs, "attached_mass", "disk_mass", "shaft_modulus")
    alone = search(problem, hypotheses, nominal)
    with executor(workers=1) as pool:
        assert pool.submit(_pid).result() != os.getpid()
        with helped_by(pool):
            shared = search(problem, hypotheses, nominal)
    assert [(str(fit.hypothesis), fit.cost) for fit in shared.fits] == [
        (str(fit.hypothesis), fit.cost) for fit in alone.fits
    ]
