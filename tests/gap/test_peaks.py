"""Lists of resonances: matched, weighed, and never more certain than they are."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import rigtwin.gap.peaks.ranking
import rigtwin.rotor.geometry.rig
from rigtwin.gap.audit.geometry import geometry_of
from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.gap.peaks.diagnosis import diagnose_peaks
from rigtwin.gap.peaks.lists import Lists, Reading
from rigtwin.gap.peaks.ranking import Grid, polish, rank, score
from rigtwin.gap.peaks.resonances import Rotor
from rigtwin.rotor.effects import (
    AttachedMass,
    BearingDamping,
    DiskMass,
    Effect,
    PedestalFlexibility,
    PlaneAnisotropy,
    ShaftDamping,
    ViscoelasticSupport,
)
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.campaign import Campaign, NominalBelief, PeakList
from rigtwin.sim.campaign_folder import load_campaign
from tests.gap.conftest import RIG, STRUCTURE, all_but

K_B = 2e6
BELIEF = NominalBelief(shaft_damping_ratio=0.005)
ROTOR = Rotor(STRUCTURE, BELIEF, 2)
NONE = Hypothesis()
EMPTY = np.zeros(0)


def system(effects=(), k_b=K_B, *, rigid=False):
    return build_system(STRUCTURE, Condition(k_b=k_b, rigid_support=rigid, shaft_damping_ratio=0.005), effects)


def campaign_of(*lists: PeakList) -> Campaign:
    return Campaign("peaks", RIG, peaks=lists, nominal=BELIEF)


def both_lists(*effects: Effect, std=0.01, keep=slice(None), extra=()) -> Campaign:
    """What a careful reader lists of both supports up to 330 Hz; std relative."""
    made = []
    for support in ("rigid", "bearing"):
        found = ROTOR.resonances(support, np.array([K_B]), effects)
        tested = found.f_hz[0] < 330
        f = found.f_hz[0][tested & (found.height[0] > 0.05 * found.height[0][tested].max())]
        f = np.sort(np.append(f, extra)) if support == "bearing" else f
        f = f[keep] if support == "bearing" else f
        made.append(PeakList(support, f, std * f))
    return campaign_of(*made)


# -- resonances ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "effect",
    [
        PlaneAnisotropy(anisotropy=0.3, angle=0.4),
        PedestalFlexibility(stiffness=1e7, mass=2.0, damping=5.0),
        ViscoelasticSupport(strength=0.5, relaxation_time=3e-3),
        AttachedMass(mass=0.2, node=4),
    ],
    ids=lambda effect: effect.id,
)
def test_resonances_are_those_of_the_rotor(effect):
    found = ROTOR.resonances("bearing", np.array([5e5, K_B]), (effect,)).f_hz[1]
    alone = system((effect,))
    exact = damped_modes(alone if alone.couples_planes() else alone.in_plane(1)).frequency_hz
    assert_allclose(found[:4], exact[:4], rtol=1e-4)


def test_the_height_is_that_of_the_peak():
    found = ROTOR.resonances("rigid", np.array([K_B]))
    lines = found.f_hz[0, :2, None] * np.linspace(0.98, 1.02, 401)
    peaks = [np.abs(accelerance(system(rigid=True), f, excitation_node=2)[:, 1, 0]).max() for f in lines]
    assert_allclose(found.height[0, :2], peaks, rtol=0.05)
    plain, damped = (ROTOR.resonances("bearing", np.array([K_B]), e).height[0, 0]
                     for e in ((), (BearingDamping(damping=300.0),)))  # fmt: skip
    assert damped < 0.5 * plain


def test_between_the_stiffnesses_that_are_solved_resonances_are_interpolated():
    k_b = np.geomspace(1e5, 1e9, 160)
    every = ROTOR.resonances("bearing", k_b)
    few = ROTOR.resonances("bearing", k_b[70:75])
    assert_allclose(every.f_hz[70:75, :3], few.f_hz[:, :3], rtol=2e-3)


def test_bearings_do_not_act_on_rigid_supports():
    plain, other = (ROTOR.resonances("rigid", np.array([K_B]), e) for e in ((), (PlaneAnisotropy(),)))
    assert_allclose(plain.f_hz, other.f_hz)


@pytest.mark.parametrize(
    "effect", [BearingDamping(damping=300.0), ShaftDamping(damping_ratio=0.02)], ids=lambda e: e.id
)
def test_effects_that_say_so_do_not_move_resonances(effect):
    plain, other = (ROTOR.resonances("bearing", np.array([K_B]), e) for e in ((), (effect,)))
    assert not effect.moves_resonances
    assert_allclose(plain.f_hz, other.f_hz)


# -- matching --------------------------------------------------------------------------------------


def matched(campaign: Campaign):
    return Lists(campaign).match(K_B, NONE, EMPTY)


def test_the_models_own_list_is_matched_peak_by_peak():
    for match in matched(both_lists()):
        assert_allclose(np.array(match.model_hz, dtype=float), match.peaks.frequencies_hz, rtol=1e-4)
        assert match.unseen_hz == ()
        assert match.chi2 < 1e-3


def test_a_peak_between_two_resonances_is_foreign():
    _, bearing = matched(both_lists(extra=[130.0]))
    at = int(np.argmin(np.abs(bearing.peaks.frequencies_hz - 130.0)))
    assert [place for place, f in enumerate(bearing.model_hz) if f is None] == [at]


def test_a_resonance_that_nobody_listed_is_noticed():
    whole, lacking = both_lists(), both_lists(keep=slice(1, None))
    (_, bearing), missing = matched(lacking), whole.peaks[1].frequencies_hz[0]
    assert_allclose(bearing.unseen_hz, missing, rtol=1e-4)


def test_what_was_not_listed_or_not_predicted_costs_what_it_should():
    reading = Reading(seen=0.9, foreign=0.1)
    logs = {}
    for name, campaign in (("whole", both_lists()), ("less", both_lists(keep=slice(1, None))),
                           ("more", both_lists(extra=[130.0]))):  # fmt: skip
        lists = Lists(campaign, reading)
        logs[name] = float(lists.log_likelihood(np.array([K_B]), NONE, EMPTY)[0])
    width = 330 - 0  # about the tested range
    std = 0.01 * both_lists().peaks[1].frequencies_hz[0]
    listed = np.log(0.9) - np.log(np.sqrt(2 * np.pi) * std)
    assert_allclose(logs["less"] - logs["whole"], np.log(0.1) - listed, atol=1e-3)
    assert_allclose(logs["more"] - logs["whole"], np.log(0.1 / width), atol=0.3)


def test_a_resonance_that_hardly_stands_out_may_go_unlisted():
    """Bearings turned by a hair hide one of every pair of resonances."""
    campaign = both_lists(PlaneAnisotropy(anisotropy=0.3, angle=0.0))
    lists = Lists(campaign)
    (hypothesis,) = [h for h in lists.hypotheses if h.ids == ("plane_anisotropy",)]
    _, bearing = lists.match(K_B, hypothesis, np.array([0.3, 0.087]))
    assert bearing.unseen_hz == ()
    _, bearing = lists.match(K_B, hypothesis, np.array([0.3, 0.6]))
    assert len(bearing.unseen_hz) > 0


# -- evidence --------------------------------------------------------------------------------------


@pytest.mark.parametrize("std", [0.01, 3e-4])
def test_k_b_and_its_error_are_those_of_a_least_squares_fit(std):
    lists = Lists(both_lists(std=std))
    scored = polish(lists, score(lists, NONE))
    f = [ROTOR.resonances("bearing", np.array([k])).f_hz[0] for k in (0.99 * K_B, 1.01 * K_B)]
    listed = lists.lists[1].frequencies_hz
    slope = [np.log(f[1][m] / f[0][m]) / np.log(1.01 / 0.99) for m in range(len(listed))]
    expected = std / np.linalg.norm(slope)
    assert scored.k_b is not None
    assert_allclose(scored.k_b.value, K_B, rtol=0.3 * expected)
    assert_allclose(scored.k_b.std / K_B, expected, rtol=0.25)
    assert_allclose(scored.determined, 1.0, atol=0.05)


@pytest.mark.parametrize("name", ["disk_mass", "plane_anisotropy"])
def test_the_grid_is_fine_enough(name, monkeypatch):
    lists = Lists(both_lists(DiskMass(change=0.05)))
    hypothesis = next(h for h in lists.hypotheses if h.ids == (name,))
    coarse = score(lists, hypothesis).log_evidence
    monkeypatch.setattr(rigtwin.gap.peaks.ranking, "_GRID", Grid(points=(1, 81, 21, 9)))
    assert_allclose(score(lists, hypothesis).log_evidence, coarse, atol=0.3)


def test_a_number_that_the_list_does_not_tell_keeps_its_prior():
    lists = Lists(both_lists())
    (unequal,) = [score(lists, h) for h in lists.hypotheses if h.ids == ("bearing_asymmetry",)]
    low, high = unequal.hypothesis.free[0].ends  # resonances follow the square of the difference
    assert unequal.std[1] > 0.1 * (high - low)
    assert unequal.determined < 1.9


# -- the diagnosis -----------------------------------------------------------------------------------

FEW = all_but("disk_mass", "shaft_modulus", "axial_load")
WITH_PAIRS = all_but("axial_load", "plane_anisotropy")


def test_a_rotor_as_it_should_be_has_no_gap():
    diagnosis = diagnose_peaks(both_lists(), FEW, ())
    assert diagnosis.verdict == "no_gap"
    assert diagnosis.next_test is None
    assert diagnosis.nominal["probability"] > 0.9


def test_heavy_disks_are_a_gap_but_not_a_proof():
    diagnosis = diagnose_peaks(both_lists(DiskMass(change=0.08), std=0.003), FEW, ())
    assert diagnosis.verdict == "not_enough_data"
    assert diagnosis.nominal["probability"] < 0.01
    assert "disk_mass" in {cause.effects[0] for cause in diagnosis.equivalent}
    total = sum(cause.probability for cause in diagnosis.causes) + diagnosis.nominal["probability"]
    assert_allclose(total, 1.0)
    assert diagnosis.next_test is not None


def test_a_foreign_peak_alone_is_no_proof_of_anything():
    diagnosis = diagnose_peaks(both_lists(extra=[130.0]), FEW, ())
    assert diagnosis.verdict == "not_enough_data"
    assert diagnosis.nominal["fit"]["unmatched"] == 1
    assert "1 of" in diagnosis.sentence


def test_rigid_supports_alone_have_no_bearing_stiffness():
    diagnosis = diagnose_peaks(campaign_of(both_lists().peaks[0]), FEW, ())
    assert diagnosis.nominal["k_b"] is None
    assert all(cause.k_b is None for cause in diagnosis.causes)
    assert "plane_anisotropy" not in {h.ids[0] for h in Lists(campaign_of(both_lists().peaks[0])).hypotheses}


def test_an_excluded_effect_is_no_candidate():
    names = {cause.effects[0] for cause in diagnose_peaks(both_lists(), FEW, ()).causes}
    assert names == {"disk_mass", "shaft_modulus", "axial_load"}


def test_what_is_excluded_leaves_its_probability_to_the_other_effects(monkeypatch):
    asked = []
    monkeypatch.setattr(rigtwin.gap.peaks.ranking, "score", lambda lists, h: asked.append(h) or score(lists, h))
    rank(Lists(both_lists()), FEW)
    assert sum(h.prior for h in asked if h.terms) == pytest.approx(1.0)


def test_stiffnesses_end_where_the_rigs_file_ends_them(tmp_path):
    table = (Path(rigtwin.rotor.geometry.rig.__file__).parents[1] / "rigs" / f"{RIG}.toml").read_text(encoding="utf-8")
    ends = "[k_b]\nstart_N_per_m = 2e6\nmin_N_per_m = 1.5e6\nmax_N_per_m = 4e6\n"
    (tmp_path / "rig.toml").write_text(re.sub(r"\[k_b\][^\[]*", ends, table), encoding="utf-8")
    lists = Lists(replace(both_lists(), rig=str(tmp_path / "rig.toml")))
    assert_allclose(np.exp(lists.ends(Hypothesis())[0]), [1.5e6, 4e6])
    geometry = geometry_of(str(tmp_path / "rig.toml"))
    assert_allclose(geometry.stiffnesses(2), [1.5e6, 4e6])


@pytest.fixture(scope="module")
def paper():
    """The paper's own rig, by a few candidates."""
    campaign = load_campaign(Path(__file__).resolve().parents[2] / "examples" / "nit-rourkela-rig")
    return campaign, rank(Lists(campaign), WITH_PAIRS), diagnose_peaks(campaign, WITH_PAIRS, ())


def test_the_papers_peaks_are_not_enough(paper):
    _, ranking, diagnosis = paper
    assert diagnosis.verdict == "not_enough_data"
    assert ranking.nominal.n_foreign == 2  # 151 Hz and one of 172 and 190 Hz
    assert ranking.nominal.p_value < 0.01  # 95 Hz on rigid supports
    rows = diagnosis.nominal["peaks"]
    assert [row["listed_Hz"] for row in rows] == [95.0, 320.0, 70.0, 151.0, 172.0, 190.0]
    assert sum(row["nominal_Hz"] is None for row in rows) == 2


def test_the_papers_ranking_hangs_on_what_is_assumed(paper):
    """Where overlooked resonances cost nothing, the effect that doubles them all comes first."""
    campaign, ranking, _ = paper
    lists = Lists(campaign).read_as(Reading(seen=0.5, foreign=0.01))
    other = rank(lists, WITH_PAIRS)
    assert ranking.scored[0].hypothesis.ids != ("plane_anisotropy",)
    assert other.scored[0].hypothesis.ids == ("plane_anisotropy",)


def test_a_list_that_is_read_otherwise_is_another():
    lists = Lists(both_lists())
    other = lists.read_as(Reading(seen=0.5))
    assert (lists.reading.seen, other.reading.seen) == (0.9, 0.5)


def test_a_match_tells_its_residuals():
    match = matched(both_lists())[1]
    off = replace(match, peaks=replace(match.peaks, frequencies_hz=match.peaks.frequencies_hz + 2 * match.peaks.std_hz))
    assert_allclose(np.array(off.residuals, dtype=float), 2.0, rtol=2e-3)
    assert_allclose(off.chi2, 4.0 * len(match.model_hz), rtol=4e-3)
    assert off.n_matched == len(match.model_hz)
