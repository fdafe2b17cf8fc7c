"""A force law beside linear effects: what these promise, and how both are found."""

from __future__ import annotations

import numpy as np
import pytest

from rigtwin.gap.inference.hypotheses import candidates
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.linear import MODES
from rigtwin.gap.model.motions import FINE
from rigtwin.gap.search.laws.beside import _can_stand_beside, _grown, _shown_at_rest, promises_much, search_laws
from rigtwin.gap.search.laws.robust import robust_fit
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.rotor.effects import AttachedMass, PlaneAnisotropy, SensorDelay, SensorGain
from rigtwin.rotor.effects.effect import Effect
from rigtwin.rotor.effects.library import EFFECTS
from tests.gap.conftest import (
    CUBIC,
    K_B,
    LEVELS,
    STRUCTURE,
    TOLERANCES,
    WORKSHOP,
    all_but,
    blank,
    lines,
    problem_of,
    truth,
    with_noise,
)

MASS = AttachedMass(mass=0.05, node=3)


def runs_of(*effects: Effect):
    """A rigid run, and upward sweeps on bearings at three levels, under a law and what is beside it."""
    linear = [effect for effect in effects if effect.family != "nonlinear"]
    rigid = blank("rigid", lines("rigid", linear)[::2], force_amplitude_N=1.0, name="rigid")
    forward = Forward(WORKSHOP).made(with_data=False, resolution=FINE)
    runs = [with_noise(rigid, truth(rigid, linear), 9)]
    for seed, level in enumerate(LEVELS):
        settings = {"force_amplitude_N": level, "sweep": "up", "name": f"{level} N"}
        run = blank("bearing", lines("bearing", linear)[::2], **settings)
        modal = forward.modal(run, K_B, effects)
        runs.append(with_noise(run, np.where(modal.found()[:, None], modal.response(), np.nan), seed))
    return tuple(runs)


def library(runs, *names: str):
    """Laws and linear effects."""
    return [candidates(runs, STRUCTURE, all_but(*names), nonlinear=nonlinear) for nonlinear in (True, False)]


@pytest.fixture(scope="module")
def weighed_down():
    return runs_of(CUBIC, MASS)


@pytest.mark.parametrize("effect", [SensorGain(gain=1.1, node=3), SensorDelay(delay=1e-4, node=0)], ids=lambda e: e.id)
def test_channels_report_under_a_law_as_their_effects_say(weighed_down, effect):
    run, forward = weighed_down[2], Forward(WORKSHOP)
    plain, reported = (forward.modal(run, K_B, (CUBIC, *more)) for more in ((), (effect,)))
    omega = 2 * np.pi * run.frequency_hz
    factors = np.array([effect.channel_factor(omega, channel.node) for channel in run.channels]).T
    H, drift, tolerance = plain.response(), np.zeros(MODES), np.zeros(len(TOLERANCES))
    assert np.abs(factors - 1).max() > 0.03
    there = reported.response()
    same = np.abs(there - H * factors).max(axis=1) < 1e-6 * np.abs(H).max(axis=1)  # elsewhere another branch is nearer
    assert same.mean() > 0.9
    change = plain.small_change_to(reported, drift, tolerance)
    np.testing.assert_allclose(change, H * (factors - 1), atol=1e-9 * np.abs(H).max())


def test_what_a_mass_changes_beside_a_law_is_followed_at_the_motion_that_was_found(weighed_down):
    run, forward = weighed_down[2], Forward(WORKSHOP)
    light = AttachedMass(mass=2e-6, node=3)
    plain, heavier = (forward.modal(run, K_B, (CUBIC, *more)) for more in ((), (light,)))
    change = heavier.response() - plain.response()
    small = plain.small_change_to(heavier, np.zeros(MODES), np.zeros(len(TOLERANCES)))
    off = np.linalg.norm(small - change, axis=1)
    assert np.mean(off < 0.02 * np.linalg.norm(change, axis=1)) > 0.9  # beside a fold no step is small enough


def test_what_pushes_a_law_across_the_force_is_followed_to_its_own_motion(weighed_down):
    run, forward = weighed_down[2], Forward(WORKSHOP)
    turned = PlaneAnisotropy(anisotropy=0.2, angle=0.4)
    plain, across = (forward.modal(run, K_B, (CUBIC, *more)) for more in ((), (turned,)))
    assert across.as_nonlinear.balance.n_joints > plain.as_nonlinear.balance.n_joints
    change = plain.small_change_to(across, np.zeros(MODES), np.zeros(len(TOLERANCES)))
    np.testing.assert_allclose(change, across.response() - plain.response(), atol=1e-12)


def test_what_the_drive_or_the_sweep_changes_does_not_stand_beside_a_law():
    there = {key for key, effect in EFFECTS.items() if effect.family != "nonlinear" and _can_stand_beside(effect)}
    assert not there & {"force_dropout", "fast_sweep", "coarse_grid", "sensor_mass"}
    assert there > {"attached_mass", "sensor_gain", "sensor_delay", "sensor_position", "bearing_damping"}


def test_the_lowest_level_shows_the_linear_effect(weighed_down):
    problem = problem_of(*weighed_down)
    _, effects = library(weighed_down, "bearing_cubic", "attached_mass", "shaft_modulus")
    rest = _shown_at_rest(problem, effects)
    assert rest is not None
    assert str(rest.hypothesis) == "attached_mass node 3"
    plain = runs_of(CUBIC)
    assert _shown_at_rest(problem_of(*plain), effects) is None


@pytest.mark.long
def test_a_law_and_a_linear_effect_are_found_together(weighed_down):
    laws, effects = library(weighed_down, "bearing_cubic", "attached_mass", "shaft_modulus")
    *_, found = search_laws(problem_of(*weighed_down), laws, effects, THRESHOLDS.adequate_nonlinear)
    best = found.fits[0]
    assert str(best.hypothesis) == "bearing_cubic + attached_mass node 3"
    assert best.chi2 < 1.2 * best.n_data
    law, mass = best.effects
    assert law.stiffness == pytest.approx(CUBIC.stiffness, rel=0.05)
    assert mass.mass == pytest.approx(MASS.mass, rel=0.05)


@pytest.mark.long
def test_beside_a_law_that_is_fitted_the_score_tells_the_linear_effect(weighed_down):
    laws, effects = library(weighed_down, "bearing_cubic", "attached_mass", "shaft_modulus")
    problem = problem_of(*weighed_down)
    alone = robust_fit(problem, laws[0], np.log([K_B, CUBIC.stiffness]))
    assert alone is not None
    promised = promises_much(problem, alone, effects)
    assert str(promised[0].start.hypothesis) == "bearing_cubic + attached_mass node 3"
    (both,) = _grown(problem, alone, [*laws, *effects])
    assert str(both.hypothesis) == "bearing_cubic + attached_mass node 3"
    assert both.chi2 < 1.2 * both.n_data < alone.chi2
