"""Places, parts and lists in words."""

from __future__ import annotations

import math

import pytest

from rigtwin.gap.document import Location
from rigtwin.gap.phrases import effects_at, listed, part, place


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.883, "88 %"),
        (0.0312, "3.1 %"),
        (0.0996, "10 %"),
        (0.9921, "99.2 %"),
        (0.9995, "over 99.9 %"),
        (4e-4, "under 0.1 %"),
        (0.0, "under 0.1 %"),
        (-0.2, "−20 %"),
        (-1e-4, "under 0.1 %"),
        (math.nan, "unknown"),
    ],
)
def test_a_part_shows_what_counts_of_it(value, words):
    assert part(value) == words


def test_a_place_is_named():
    assert place(Location("node", node=4)) == "at node 4"
    assert place(Location("sensor", node=4)) == "at the sensor of node 4"
    assert place(Location("sensor")) == "at every sensor"
    assert place(Location("position", x_m=0.2134)) == "at x = 213 mm"
    assert place(Location("bearings")) == "at the bearings"
    assert place(Location("somewhere")) == ""


def test_effects_are_named_with_their_places():
    places = (Location("node", node=3), Location("bearings"))
    assert (
        effects_at(("attached_mass", "bearing_damping"), places)
        == "attached mass at node 3 and bearing damping at the bearings"
    )


def test_a_list_ends_with_and():
    assert listed([]) == "none"
    assert listed([3]) == "3"
    assert listed(["a", "b", "c"]) == "a, b and c"
