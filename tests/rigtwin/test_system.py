"""``rigtwin system``: the machine of four FMUs, its page, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rigtwin.conftest import run, run_json

JOURNALS = str(Path(__file__).parents[2] / "examples" / "journal_bearings.toml")


def test_a_short_run_tracks_k_b_and_writes_page_and_system(tmp_path):
    found = run_json("system", "--out", tmp_path, "--seconds", "1.5")
    assert found["k_b_N_per_m"] == [1e7, 1e7]
    assert found["valid"] > 0.3
    assert found["tracked_off_rms"] < 0.01
    assert found["interval_holds"] > 0.9
    assert found["supervised"]["last_speed_rad_per_s"] == pytest.approx(1.5 * 274, rel=0.05)  # the last whole window
    assert {path.name for path in tmp_path.iterdir()} == {
        "RotorRig.fmu", "SofteningBearing.fmu", "SpeedSupervisor.fmu", "StiffnessTracker.fmu", "SoftenedMachine.ssp",
        "system.html",
    }  # fmt: skip
    text = (tmp_path / "system.html").read_text(encoding="utf-8")
    assert "the tracker is off by" in text
    assert text.count('class="figure"') == 3


def test_a_rig_whose_bearings_have_no_k_b_is_refused(tmp_path):
    result = run("system", JOURNALS, "--out", tmp_path)
    assert result.exit_code == 2
    assert "has no bearing whose stiffness is k_b" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_run_too_short_to_see_vibration_is_refused_before_anything_is_built(tmp_path):
    result = run("system", "--out", tmp_path, "--seconds", "0.1")
    assert result.exit_code == 2
    assert "--seconds 0.1: vibration is an rms over" in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_the_supervisor_keeps_away_from_the_resonance_that_comes_down(tmp_path):
    found = run_json("system", "--out", tmp_path)
    assert found["k_b_N_per_m"] == pytest.approx([1e7, 2e6])
    assert found["tracked_off_rms"] < 0.005
    assert found["interval_holds"] > 0.85
    alone, supervised = found["alone"], found["supervised"]
    assert supervised["nearest_to_a_resonance"] > 0.049
    assert alone["nearest_to_a_resonance"] < 0.01
    assert alone["largest_vibration_m_per_s2"] > 5 * supervised["largest_vibration_m_per_s2"]
