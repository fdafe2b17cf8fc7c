"""The diagnosis in words."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rigtwin.gap.answer.sentence import sentence
from rigtwin.gap.document import Cause, Finding, Location, Shrink


def shrink(without: float | None) -> Shrink:
    return Shrink("stretches", 0.5, 0.02, 0.01, 0.96, 0.98, (0.9, 1.0), "model", without_effect=without)


@pytest.mark.parametrize(("without", "said"), [(0.02, "; gains and tolerances without it, 98 %."), (0.4, "explained.")])
def test_what_goes_without_the_cause_is_said_where_it_is_much(without, said):
    cause = Cause(("shaft_damping",), Location("shaft"), 1.0, {}, None, 0.0)
    diagnosis = SimpleNamespace(verdict="cause", causes=(cause,), equivalent=(), shrink=shrink(without), audit=())
    assert sentence(diagnosis).endswith(said)  # type: ignore[arg-type]


def ambiguous(no_gap: float, shrink):
    first, second = (Cause((name,), Location("disks"), 0.4, {}, None, 0.0) for name in ("disk_mass", "disk_inertia"))
    told = {"verdict": "ambiguous", "causes": (first, second), "equivalent": (first, second), "shrink": shrink}
    return SimpleNamespace(**told, nominal={"probability": no_gap}, audit=())


def test_causes_that_cannot_be_told_apart_are_all_named_and_so_is_none():
    words = sentence(ambiguous(0.0, None))  # type: ignore[arg-type]
    assert words.endswith("tell apart disk mass at the disks, or diametral inertia of the disks at the disks.")
    words = sentence(ambiguous(0.4, shrink(0.4)))  # type: ignore[arg-type]
    assert ", or no gap at all; the first: it takes away" in words


@pytest.mark.parametrize(
    ("check", "severity", "said"),
    [
        (
            "missing_lines",
            "warning",
            "in the lines that were used; which ones are missing or left out, the audit says.",
        ),
        ("missing_lines", "ok", "nothing to explain."),
        ("raster", "warning", "nothing to explain."),
    ],
)
def test_no_gap_is_said_of_the_lines_that_were_used(check, severity, said):
    found = Finding(check, severity, "words", "run", 1.0, 0.0)
    assert sentence(SimpleNamespace(verdict="no_gap", audit=(found,))).endswith(said)  # type: ignore[arg-type]


def test_what_must_be_corrected_first_is_said_once():
    inverted = [Finding("sign", "error", "Node 3 is inverted.", run, 1.0, 0.0) for run in ("one", "two")]
    wrong = Finding("units", "error", "A unit is wrong.", "three", 9.81, 2.5)
    words = sentence(SimpleNamespace(verdict="no_gap", audit=(*inverted, wrong)))  # type: ignore[arg-type]
    assert words.endswith("First of all, one and two: node 3 is inverted. three: a unit is wrong.")


@pytest.mark.parametrize(
    ("severity", "said"), [("ok", "acts like a mass (95 % of the gap there)."), ("error", "not right.")]
)
def test_no_joint_is_named_where_names_are_wrong(severity, said):
    joint = SimpleNamespace(node=3, explained=0.95, order="a mass (real, falling)")
    found = Finding("labels", severity, "Names are not right.", "run", 1.0, 0.0)
    where = SimpleNamespace(joint=joint, remark="")
    diagnosis = SimpleNamespace(verdict="unknown", where=where, audit=(found,), measured_joint=None)
    words = sentence(diagnosis)  # type: ignore[arg-type]
    assert words.endswith(said)
    assert ("acts like" in words) == (severity == "ok")


def test_of_a_gap_like_the_noise_no_share_is_said():
    small = Shrink("stretches", 0.0101, 0.02, 0.01, -1.0, -94.0, (-1.0, 0.5), "model")
    assert sentence(ambiguous(0.0, small)).endswith("at the disks.")  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "coarse"), [("coarse_grid", True), ("fast_sweep", False)])
def test_only_a_coarse_raster_hides_peaks_between_its_lines(name, coarse):
    """A sweep that is too fast belongs to the raster as well, and yet model and measurement differ there."""
    cause = Cause((name,), Location("raster"), 0.99, {}, None, 0.0)
    diagnosis = SimpleNamespace(verdict="cause", causes=(cause,), equivalent=(), shrink=None, audit=())
    words = sentence(diagnosis)  # type: ignore[arg-type]
    assert ("too far apart to show the peaks" in words) == coarse
    assert coarse or words.startswith("The gap comes from")
