"""Motions that a lab could not measure are left out; time stepping agrees on the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.blind.generate.campaigns import DATA, Order, make, seal, stored_case
from rigtwin.blind.generate.case import measure, plan_lines
from rigtwin.blind.generate.draw import empty_case, with_levels
from rigtwin.blind.generate.effects import Effect, draw_effect
from rigtwin.blind.generate.laws import dead_band
from rigtwin.blind.generate.machine import build_machine
from rigtwin.blind.generate.nonlinear import GROWTH, Balance, joints_of, stepped_forces, swept_up
from rigtwin.blind.generate.response import N_DRIFTING
from rigtwin.blind.generate.rig import read_rig
from rigtwin.blind.judge.score import read_labels
from rigtwin.sim.campaign_folder import load_campaign

RIG = read_rig("nit-rourkela")


def rubbing():
    """A rub whose motion is not stable at some lines of a sweep: case, setting, level and lines."""
    rng = np.random.default_rng(2)
    case = empty_case(RIG, "W1", rng)
    effect = draw_effect(rng, "rub", RIG)
    case = with_levels(RIG, replace(case, effects=(effect,)), 1.0, rng)
    setting = case.setting(False, 2)
    return case, setting, case.levels[1], plan_lines(RIG, case, setting, case.levels[1], rng)


def balance_of(case, setting, level) -> Balance:
    machine = build_machine(RIG, setting, case.effects, case.workshop)
    return Balance(machine, joints_of(machine, setting, case.effects), level, np.zeros(N_DRIFTING))


def test_without_a_law_a_disturbance_decays_as_the_slowest_eigenvector():
    case = replace(
        empty_case(RIG, "W1", np.random.default_rng(0)), effects=(Effect("bearing_cubic", {"stiffness": 1.0}),)
    )
    balance = balance_of(case, case.setting(False, 2), 1e-3)
    omega = 2 * np.pi * np.array([50.0, 130.0])
    expected = np.exp(balance.poles.values.real.max() * 2 * np.pi / omega)
    assert_allclose(balance.growth(omega, balance.sweep(omega)), expected, rtol=1e-9)


@pytest.mark.long
def test_time_stepping_repeats_where_a_motion_is_stable_and_there_only():
    case, setting, level, lines = rubbing()
    balance = balance_of(case, setting, level)
    omega = 2 * np.pi * lines
    motions = balance.sweep(omega)
    growth = balance.growth(omega, motions)
    touching = np.flatnonzero((np.abs(balance.fundamentals(omega, motions)[:, 0]) > 0.01) & (growth < 0.999))
    runaway = np.flatnonzero(growth > 1.05)
    assert min(len(touching), len(runaway)) >= 2
    some = np.concatenate([touching[:: max(len(touching) // 4, 1)], runaway[:2]])
    forces = stepped_forces(balance, omega[some], motions[some])
    assert np.isnan(forces[-2:]).all()
    balanced = balance.fundamentals(omega, motions)[some]
    assert_allclose(forces[:-2], balanced[:-2], rtol=0.02)


@pytest.mark.long
@pytest.mark.parametrize("every", [50, 20])
def test_time_stepping_repeats_where_a_law_is_not_felt(every):
    """A rotor that does not touch has no force to repeat; a preload far above the exciter's force stays what it is."""
    effect = Effect("bearing_clearance", {"gap": 2.6e-6, "preload": 3.2})
    preloaded = replace(empty_case(RIG, "W1", np.random.default_rng(0)), effects=(effect,))
    touching, setting, level, lines = rubbing()
    omega = 2 * np.pi * lines[::every]
    for case, here, force in ((touching, setting, 1e-3 * level), (preloaded, preloaded.setting(False, 2), 0.02)):
        balance = balance_of(case, here, force)
        found = stepped_forces(balance, omega, balance.sweep(omega))
        assert np.abs(found).max() < 1e-6 * force


def test_lines_that_do_not_repeat_are_left_out():
    case, setting, level, lines = rubbing()
    H = swept_up(RIG, setting, case.effects, lines, level, case.workshop)
    out = np.isnan(H[:, 0])
    assert 2 <= out.sum() < 0.25 * len(lines)
    assert not np.isnan(swept_up(RIG, setting, case.effects, lines, level, case.workshop, stable=False)).any()
    for run in measure(RIG, case, 2, case.levels[1:2], np.random.default_rng(0)):
        assert np.isfinite(run.actual).all()
        assert len(run.frequency_hz) == len(run.actual) == len(run.ideal)


def test_a_rub_without_contact_is_none():
    law = dead_band(1e-5, 1e8, 0.0)
    x = 0.99e-5 * np.cos(np.linspace(0, 2 * np.pi, 64))
    force, slope = law(x, np.eye(64), np.eye(64), 1.0)
    assert not force.any()
    assert not slope.any()


@pytest.mark.parametrize("side", [-1, 1])
def test_contact_is_a_spring_beyond_its_gap(side):
    force, slope = dead_band(1e-5, 1e8, 0.0)(np.array([side * 3e-5]), np.eye(1), np.eye(1), 1.0)
    assert_allclose([force[0], slope[0, 0]], [side * 2000.0, 1e8])


def test_growth_has_room_for_round_off_only():
    assert 1 < GROWTH < 1.01


# -- stored cases ------------------------------------------------------------------------------------------


def test_every_stored_case_takes_its_place_in_w6(tmp_path):
    cases = sorted(p.name for p in DATA.iterdir() if p.is_dir())
    assert len(cases) == 8
    found = [stored_case(Order("W6", "tuning", 1, index)) for index in range(80)]
    assert sorted(f.name for f in found if f) == cases
    assert stored_case(Order("W1", "tuning", 1, 7)) is None
    order = Order("W6", "tuning", 1, 7)
    make(order, tmp_path)
    seal(tmp_path)
    (label,) = read_labels(tmp_path)
    assert label.campaign == order.name
    for part in ("measured", "held_out"):
        text = (tmp_path / order.name / part / "campaign.toml").read_text(encoding="utf-8")
        assert "ross" not in text.lower()
        assert len(load_campaign(tmp_path / order.name / part).runs) == 2


@pytest.mark.parametrize("folder", sorted(p for p in DATA.iterdir() if p.is_dir()), ids=lambda p: p.name)
def test_rosses_rotor_is_the_generators(folder):
    import json

    from rigtwin.blind.generate.machine import Setting, Workshop
    from rigtwin.blind.generate.response import reported

    label = json.loads((folder / "truth" / "label.json").read_text(encoding="utf-8"))
    workshop = label["workshop"]
    effects = [Effect(e["id"], e["parameters"], e["location"].get("node")) for e in label["effects"]]
    with np.load(folder / "truth" / "measured.npz") as truth:
        for run in ("run01_rigid_1N", "run02_bearing_1N"):
            setting = Setting(
                "rigid" in run, label["k_b"], label["bearing_damping_Ns_per_m"], label["shaft_damping_ratio"]
            )
            theirs = truth[f"{run}/ideal"][:, 1:6]
            ours = reported(
                RIG,
                setting,
                effects,
                truth[f"{run}/frequency_Hz"],
                Workshop(workshop["modulus"], workshop["span"], tuple(workshop["disk_masses"])),
            )[:, 1:6]
            assert (np.abs(ours - theirs).max(axis=0) / np.abs(theirs).max(axis=0)).max() < 5e-3
