"""Force laws: their slopes, the Jenkins element followed sample by sample, other forms of the same effect."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.blind.generate.case import Case
from rigtwin.blind.generate.draw import empty_case
from rigtwin.blind.generate.effects import KINDS, NONLINEAR, draw_effect
from rigtwin.blind.generate.forms import FORMS, in_form
from rigtwin.blind.generate.laws import law_of, stop_operator
from rigtwin.blind.generate.machine import Setting, Workshop
from rigtwin.blind.generate.response import reported
from rigtwin.blind.generate.rig import read_rig

RIG = read_rig("nit-rourkela")
T = 2 * np.pi * np.arange(512)[:, None] / 512
GAMMA = np.hstack([np.ones_like(T), np.cos(T), -np.sin(T), np.cos(3 * T), -np.sin(3 * T)])
RATE = np.hstack([np.zeros_like(T), -np.sin(T), -np.cos(T), -3 * np.sin(3 * T), -3 * np.cos(3 * T)])


def test_jenkins_element_is_what_following_it_sample_by_sample_gives():
    x = (GAMMA @ np.array([0.1, 1.0, 0.3, 0.5, -0.2])).ravel()
    force, before, followed = 0.0, 0.0, []
    for value in np.tile(x, 3):
        force = np.clip(force + 2.0 * (value - before), -1.1, 1.1)
        before = value
        followed.append(force)
    assert_allclose(stop_operator(x, np.array([1.1]), np.array([2.0]))[0][0], followed[-512:], atol=1e-12)


@pytest.mark.parametrize("name", NONLINEAR)
def test_slopes_are_derivatives(name):
    rng = np.random.default_rng(0)
    effect = draw_effect(rng, name, RIG)
    scale = {"bearing_friction": 2 * effect.parameters.get("force", 0.0) / effect.parameters.get("stiffness", 1.0)}
    scale |= {
        "rub": 1.5 * effect.parameters.get("gap", 0.0),
        "bearing_clearance": 2 * effect.parameters.get("gap", 0.0),
    }
    u = scale.get(name, 1e-6) * np.array([0.1, 1.0, 0.2, 0.1, 0.0])
    law = law_of(effect, 1e6)
    force, slope = law(u, GAMMA, RATE, 300.0)
    direction = np.array([0.0, 0.3, -0.4, 0.2, 0.5]) * np.abs(u).max()
    shifted, back = (law(u + h * direction, GAMMA, RATE, 300.0)[0] for h in (1e-5, -1e-5))
    error = np.abs((shifted - back) / 2e-5 - slope @ direction)
    assert np.quantile(error, 0.97) < 1e-3 * np.abs(slope @ direction).max()  # a few samples are at corners
    assert np.abs(force).max() > 0


@pytest.mark.parametrize(("name", "form"), [f for f in FORMS if KINDS[f[0]].group != "nonlinear"])
def test_other_forms_act_like_the_effect_but_are_not_it(name, form):
    rng = np.random.default_rng(2)
    effect = draw_effect(rng, name, RIG)
    other = in_form(effect, form, rng)
    lines = np.linspace(20, 400, 25)
    setting = Setting(False, 1.3e6, 20.0, 0.002)
    known = reported(RIG, setting, [draw_effect(np.random.default_rng(2), name, RIG)], lines)
    strange = reported(RIG, setting, [other], lines)
    assert np.isfinite(strange).all()
    assert np.abs(strange - known).max() > 1e-5 * np.abs(known).max()


def test_workshop_tolerances_are_within_a_tenth_of_a_percent():
    case: Case = empty_case(RIG, "W3", np.random.default_rng(0))
    workshop: Workshop = case.workshop
    assert max(abs(workshop.modulus), abs(workshop.span), *map(abs, workshop.disk_masses)) <= 1e-3
    assert 3e5 <= case.k_b <= 5e6
