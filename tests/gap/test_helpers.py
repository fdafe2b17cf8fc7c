"""Fits shared with helpers: in order, whoever does them, and the same answer."""

from __future__ import annotations

import math
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from rigtwin.gap.inference.hypotheses import candidates
from rigtwin.gap.search.laws.robust import each_from_scratch
from rigtwin.gap.search.laws.search import search_nonlinear
from rigtwin.gap.search.linear import search, weak_starts
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.gap.search.race import polish_all
from rigtwin.rotor.effects import AttachedMass, BearingCubic
from rigtwin.scale_out import executor
from rigtwin.shared_work import each, helped_by, seconds_left, seconds_to_work
from tests.gap.conftest import STRUCTURE, all_but, both_supports, of, problem_of
from tests.gap.test_nonlinear import runs_of

MET = threading.Barrier(2, timeout=10)


def square(item):
    """A square, and who made it; this thread begins at the front, a helper at the back, and they meet."""
    if item in (0, 9):
        MET.wait()
    return item**2, threading.get_ident()


def nothing(item):
    raise ValueError(f"no model of {item}")


class Shift:
    """A function with a state."""

    def __init__(self):
        self.by = 0

    def __call__(self, item):
        return item + self.by


def test_results_come_in_the_order_of_the_items_whoever_makes_them():
    with ThreadPoolExecutor(1) as pool, helped_by(pool):
        squares, makers = zip(*each(square, range(10)), strict=True)
    assert list(squares) == [k**2 for k in range(10)]
    assert makers[0] == threading.get_ident() != makers[9]


def test_without_helpers_nothing_is_shared():
    assert {maker for _, maker in each(square, range(1, 9))} == {threading.get_ident()}


def test_what_a_helper_raises_is_raised_here_and_the_rest_is_dropped():
    with ThreadPoolExecutor(1) as pool, helped_by(pool), pytest.raises(ValueError, match="no model of"):
        list(each(nothing, range(100)))


def test_helpers_work_with_what_was_there_at_the_start():
    """A search goes on changing what its functions refer to."""
    held, shift = threading.Event(), Shift()
    with ThreadPoolExecutor(1) as pool, helped_by(pool):
        pool.submit(held.wait, 10)
        pending = each(shift, [1, 2, 3])
        first = next(pending)  # the helper has not begun
        shift.by = 100
        held.set()
        pool.submit(int).result()  # by now the helper has done the others
        assert (first, *pending) == (1, 2, 3)


def test_another_process_makes_the_same_search():
    problem = problem_of(*both_supports(AttachedMass(mass=0.1, node=4), seed=3))
    nominal, hypotheses = recalibrate(problem), of(problem.runs, "attached_mass", "disk_mass", "shaft_modulus")
    alone = search(problem, hypotheses, nominal)
    with executor(workers=1) as pool, helped_by(pool):
        pool.submit(square, 1).result()  # it is there
        shared = search(problem, hypotheses, nominal)
    assert [(str(fit.hypothesis), fit.cost) for fit in shared.fits] == [
        (str(fit.hypothesis), fit.cost) for fit in alone.fits
    ]


@pytest.mark.long
def test_another_process_makes_the_same_nonlinear_search():
    """Each candidate from nothing: a motion solved for one leads no other."""
    runs = runs_of(BearingCubic(stiffness=1e15))
    laws = candidates(runs, STRUCTURE, all_but("bearing_cubic"), nonlinear=True)
    *_, alone = search_nonlinear(problem_of(*runs), laws, 1.5)
    with executor(workers=1) as pool, helped_by(pool):
        pool.submit(square, 1).result()  # it is there
        *_, shared = search_nonlinear(problem_of(*runs), laws, 1.5)
    assert [(str(fit.hypothesis), fit.cost) for fit in shared.fits] == [
        (str(fit.hypothesis), fit.cost) for fit in alone.fits
    ]


@pytest.mark.long
def test_what_helpers_polish_is_predicted_here_as_there():
    """A candidate's tolerances act as they do at its own numbers, in this process too."""
    problem = problem_of(*both_supports(AttachedMass(mass=0.1, node=4), seed=3))
    starts = weak_starts(problem, of(problem.runs, "attached_mass"), recalibrate(problem))[:4]
    fits = [problem.fit(start.hypothesis, start.u + np.array([0.0, 0.5]), steps=2) for start in starts]
    with executor(workers=1) as pool, helped_by(pool):
        pool.submit(square, 1).result()
        made = polish_all(problem, fits)
    for fit in made:
        assert problem.at_fit(fit).cost(fit.hypothesis, fit.u, fit.nu) == pytest.approx(fit.cost, rel=1e-3)


def left_behind(problem, item):
    """How many motions are known, one more afterwards."""
    known = problem.forward._known
    known[item,] = None  # type: ignore[assignment]
    return len(known)


def test_nothing_is_known_from_the_item_before():
    problem = problem_of(*both_supports())
    assert list(each_from_scratch(problem, left_behind, [1, 2, 3])) == [(1, 1), (2, 1), (3, 1)]
    assert not problem.forward._known


def left(_: int) -> float:
    return seconds_left()


def test_helpers_work_no_longer_than_is_left():
    assert seconds_left() == math.inf
    with executor(workers=1) as pool, seconds_to_work(60.0):
        with helped_by(pool):
            pool.submit(square, 1).result()  # it is there
            told = list(each(left, range(20)))
        assert all(0 < seconds <= 60.0 for seconds in told)
    assert seconds_left() == math.inf
