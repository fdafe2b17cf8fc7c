"""The diagnosis in words."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from gap.diagnosis import Cause, Location, Shrink
from gap.wording import next_test, sentence
from sim.campaign import Campaign
from tests.gap.conftest import blank, lines


def shrink(without: float | None) -> Shrink:
    return Shrink("stretches", 0.5, 0.02, 0.01, 0.96, 0.98, (0.9, 1.0), "model", without_effect=without)


@pytest.mark.parametrize(("without", "said"), [(0.02, "; gains and tolerances without it, 98 %."), (0.4, "explained.")])
def test_what_goes_without_the_cause_is_said_where_it_is_much(without, said):
    cause = Cause(("shaft_damping",), Location("shaft"), 1.0, {}, None, 0.0)
    diagnosis = SimpleNamespace(verdict="cause", causes=(cause,), equivalent=(), shrink=shrink(without))
    assert sentence(diagnosis).endswith(said)  # type: ignore[arg-type]


def test_what_nobody_knows_is_measured_at_other_levels_then_downwards():
    runs = [blank(support, lines(support), force_amplitude_N=1.0) for support in ("rigid", "bearing")]
    louder = blank("bearing", lines("bearing"), force_amplitude_N=3.0, name="louder")
    down = blank("bearing", lines("bearing"), force_amplitude_N=3.0, name="down", sweep="down")
    tests = [
        next_test("unknown", Campaign("", "nit-rourkela", tuple(some)))
        for some in (runs, [*runs, louder], [*runs, louder, down])
    ]
    assert [test.run for test in tests if test] == [
        {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 3.0},
        {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 3.0, "sweep": "down"},
        {"support": "bearing", "excitation_node": 4, "force_amplitude_N": 3.0},
    ]
