"""What to measure next, by what the campaign lacks."""

from __future__ import annotations

import pytest

from rigtwin.gap.answer.missing_test import missing_test
from rigtwin.gap.document import Cause, Location
from rigtwin.sim.campaign import Campaign
from tests.gap.conftest import blank, lines


def test_a_run_in_the_other_plane_is_proposed_in_that_plane_and_an_unknown_force_is_none():
    one = blank("bearing", lines("bearing"), force_amplitude_N=None, excitation_plane="z")
    proposed = missing_test("unknown", Campaign("", "nit-rourkela", (one,)))
    assert proposed
    assert proposed.run == {"support": "rigid", "excitation_node": 2, "excitation_plane": "z"}


def test_where_every_free_node_was_driven_no_node_is_proposed():
    drives = [
        blank(s, lines(s), excitation_node=n, force_amplitude_N=f, sweep="down")
        for s in ("rigid", "bearing")
        for n in range(2, 7)
        for f in (1.0, 3.0)
    ]
    proposed = missing_test("unknown", Campaign("", "nit-rourkela", tuple(drives)))
    assert proposed
    assert "instead of" not in proposed.words
    assert "known mass" in proposed.words


def test_what_nobody_knows_is_measured_at_other_levels_then_downwards():
    runs = [blank(support, lines(support), force_amplitude_N=1.0) for support in ("rigid", "bearing")]
    louder = blank("bearing", lines("bearing"), force_amplitude_N=3.0, name="louder")
    down = blank("bearing", lines("bearing"), force_amplitude_N=3.0, name="down", sweep="down")
    tests = [
        missing_test("unknown", Campaign("", "nit-rourkela", tuple(some)))
        for some in (runs, [*runs, louder], [*runs, louder, down])
    ]
    assert [test.run for test in tests if test] == [
        {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 3.0},
        {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 3.0, "sweep": "down"},
        {"support": "bearing", "excitation_node": 4, "force_amplitude_N": 3.0},
    ]


@pytest.mark.parametrize(("cause", "advice"), [("coarse_grid", "lines as close"), ("fast_sweep", "stay longer")])
def test_what_was_measured_badly_is_measured_again_where_that_is_the_cause(cause, advice):
    runs = tuple(blank(support, lines(support)) for support in ("rigid", "bearing"))
    raster = (Cause((cause,), Location("raster"), 0.99, {}, None, 0.0),)
    for verdict, told in (("cause", True), ("unknown", False)):
        proposed = missing_test(verdict, Campaign("", "nit-rourkela", runs), raster)  # type: ignore[arg-type]
        assert proposed
        assert (advice in proposed.words) == told
