"""Two codes, one physics: the generator against the project's rotor on random conditions.

Both are converged where it counts, so the bar is the rotor's mesh: 1e-3 of a channel's peak at 16 elements a span.
"""

from __future__ import annotations

import numpy as np
import pytest

from rigtwin.blind.generate.effects import CHAIN, LINEAR, NONLINEAR, Effect, draw_effect, log_uniform
from rigtwin.blind.generate.lines import choose_lines, resonances, with_armature
from rigtwin.blind.generate.machine import Setting
from rigtwin.blind.generate.nonlinear import bent_peaks, swept_up, telling_levels
from rigtwin.blind.generate.response import machines, reported
from rigtwin.blind.generate.rig import read_rig
from rigtwin.rotor.effects import AttachedMass
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.frequency.continuation import trace
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model
from tests.repetitions import every_second_is_long

RIG = read_rig("nit-rourkela")
STRUCTURE = assemble(load_rig("nit-rourkela"), elements_between_nodes=16)
COARSER = assemble(load_rig("nit-rourkela"), elements_between_nodes=6)
CLASSES = EFFECTS if isinstance(EFFECTS, dict) else {c.id: c for c in EFFECTS}
STEADY = tuple(n for n in (*LINEAR, *CHAIN) if n not in ("coarse_grid", "fast_sweep"))


def theirs(effect: Effect):
    places = {"node": effect.node} if effect.node is not None else {}
    places |= {"position": effect.x} if effect.x is not None else {}
    return CLASSES[effect.id](**effect.parameters, **places)


def condition(setting: Setting) -> Condition:
    return Condition(
        k_b=setting.k_b,
        rigid_support=setting.rigid,
        bearing_damping=setting.c_b,
        shaft_damping_ratio=setting.zeta,
        excitation_node=setting.drive_node,
    )


def random_setting(rng: np.random.Generator, rigid: bool) -> Setting:
    damping = rng.uniform(5, 50), rng.uniform(1e-3, 3e-3)
    return Setting(rigid, log_uniform(rng, 3e5, 5e6), *damping, int(rng.choice([2, 4])))


@pytest.mark.parametrize("name", STEADY)
@pytest.mark.parametrize("rigid", [True, False])
def test_linear_effects_agree(name, rigid):
    rng = np.random.default_rng(STEADY.index(name) + 100 * rigid)
    setting = random_setting(rng, rigid)
    effects = (draw_effect(rng, name, RIG),)
    peaks = [p for m in machines(RIG, setting, effects, None) for p in resonances(with_armature(m, effects))]
    lines = choose_lines(peaks, rng)[::2]
    expected = measured_response(
        STRUCTURE,
        condition(setting),
        [theirs(e) for e in effects],
        lines,
        referred_to="nominal_force" if name == "force_dropout" else "force",
    )
    peak = np.abs(expected).max(axis=0)
    moving = peak > 1e-4 * peak.max()
    error = np.abs(reported(RIG, setting, effects, lines) - expected).max(axis=0)
    assert (error[moving] / peak[moving]).max() < 1e-3


@pytest.mark.parametrize("rigid", [True, False])
@pytest.mark.parametrize("node", [2, 3, 4])
def test_two_halves_of_a_collar_are_an_attached_mass_of_some_width(node, rigid):
    rng = np.random.default_rng(node)
    setting = random_setting(rng, rigid)
    collar = Effect("attached_mass", {"mass": 0.3}, node, form="collar", extras={"half_width": 0.01})
    lines = choose_lines([p for m in machines(RIG, setting, (collar,), None) for p in resonances(m)], rng)[::2]
    H = reported(RIG, setting, (collar,), lines)
    for half_width, same in ((0.01, True), (0.0, False)):
        mass = AttachedMass(mass=0.3, node=node, half_width=half_width)
        expected = measured_response(STRUCTURE, condition(setting), [mass], lines)
        peak = np.abs(expected).max(axis=0)
        moving = peak > 1e-4 * peak.max()
        error = (np.abs(H - expected).max(axis=0)[moving] / peak[moving]).max()
        assert error < 1e-3 if same else error > 1e-2


@pytest.mark.parametrize("name", every_second_is_long(NONLINEAR))
def test_nonlinear_effects_agree_along_an_upward_sweep(name):
    rng = np.random.default_rng(5)
    setting = Setting(False, log_uniform(rng, 3e5, 5e6), rng.uniform(5, 50), rng.uniform(1e-3, 3e-3))
    effect = draw_effect(rng, name, RIG)
    level = telling_levels(RIG, setting, effect, rng)[1]
    first = [p for m in machines(RIG, setting, (effect,), None) for p in resonances(m)]
    lines = choose_lines(bent_peaks(RIG, setting, (effect,), level, None, first), rng)
    peak = lines[np.argmax(np.abs(swept_up(RIG, setting, (effect,), lines, level, stable=False))[:, 1])]
    near = lines[np.abs(lines - peak) < 3.0][::4]
    model = build_model(COARSER, condition(setting), [theirs(effect)])
    balance = Balance(model, condition(setting), harmonics=7, samples=256, corner=0.005)
    curve = trace(balance, peak - 6.0, peak + 6.0, level)
    expected = curve.sweep(near, "up").motions.acceleration()[:, 1, :]
    H = swept_up(RIG, setting, (effect,), near, level, stable=False)
    assert np.abs(H - expected).max() < 0.02 * np.abs(expected).max()
