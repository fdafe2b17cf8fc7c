"""A search that ends early: what was found is judged, and the audit says that something may have been missed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rigtwin.gap.diagnose import diagnose
from rigtwin.rotor.effects import AttachedMass, BearingCubic
from tests.gap.conftest import all_but, both_supports, campaign_of
from tests.gap.test_nonlinear import runs_of

FEW = all_but("attached_mass", "disk_mass", "bearing_asymmetry", "bearing_cubic")


def ended(outcome) -> bool:
    """Whether the audit says that the search ended early."""
    return any(finding.check == "search" and finding.severity == "warning" for finding in outcome.diagnosis.audit)


@pytest.mark.long
def test_a_linear_search_without_time_names_nothing():
    campaign = campaign_of(*both_supports(AttachedMass(mass=0.3, node=4), seed=3))
    hurried, whole = diagnose(campaign, FEW, seconds=0.0), diagnose(campaign, FEW)
    assert ended(hurried)
    assert hurried.diagnosis.verdict == "unknown"
    assert not ended(whole)
    assert whole.diagnosis.causes[0].effects == ("attached_mass",)


def test_a_small_gap_without_time_is_no_fault():
    """Near the nominal model starts are told to first order; without time there are none."""
    hurried = diagnose(campaign_of(*both_supports(AttachedMass(mass=0.01, node=4), seed=3)), FEW, seconds=0.0)
    assert ended(hurried)
    assert hurried.diagnosis.verdict in ("unknown", "no_gap")


def test_a_search_of_laws_without_time_names_nothing():
    hurried = diagnose(campaign_of(*runs_of(BearingCubic(stiffness=1e15))), FEW, seconds=0.0)
    assert ended(hurried)
    assert hurried.diagnosis.verdict == "unknown"


def test_a_rig_without_a_gap_is_told_without_time():
    """There is nothing to search for."""
    assert diagnose(campaign_of(*both_supports(seed=3)), FEW, seconds=0.0).diagnosis.verdict == "no_gap"


def test_what_has_to_be_corrected_first_is_not_searched_for_long(monkeypatch):
    """Supports that were exchanged: no candidate can explain these runs."""
    monkeypatch.setattr("rigtwin.gap.diagnose.TIME_LIMIT", 0.0)
    exchanged = {"rigid": "bearing", "bearing": "rigid"}
    runs = [replace(run, support=exchanged[run.support]) for run in both_supports(seed=3)]
    outcome = diagnose(campaign_of(*runs), FEW)
    assert ended(outcome)
    assert outcome.diagnosis.verdict == "unknown"
    assert any("Correct first what the audit found" in finding.words for finding in outcome.diagnosis.audit)
