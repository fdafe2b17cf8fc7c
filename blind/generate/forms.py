"""The same effects in other functional forms than the diagnosis knows (set W6)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigtwin.blind.generate.case import Case
from rigtwin.blind.generate.effects import Effect, log_uniform
from rigtwin.blind.generate.nonlinear import STEPPED, largest_travel
from rigtwin.blind.generate.rig import Rig

FORMS = (
    ("bearing_friction", "iwan"),  # a chain of Jenkins elements that slip one after another
    ("pedestal_flexibility", "two_masses"),  # a foundation block under each pedestal
    ("bearing_cubic", "quintic"),  # k3 (x^3 + x^5/s^2)
    ("viscoelastic_support", "fractional"),  # (i w tau)^alpha
    ("open_crack", "notch"),  # 0.8 diameters of softer shaft for a hinge
    ("bearing_hertz", "roller"),  # exponent 10/9 for 3/2
    ("attached_mass", "collar"),  # two halves beside the node
    ("bearing_clearance", "hardening"),  # contact hardens with its depth
    ("sensor_delay", "lowpass"),  # 1/(1 + i w T) for e^{-i w T}
    ("bearing_cubic", "sinh"),  # 6 k3 s^3 (sinh(x/s) - x/s)
    ("hub_stiffening", "tapered"),  # stiffened by half at the ends of the hub
    ("rub", "hardening"),  # a stator whose contact hardens
    ("force_dropout", "coil"),  # back EMF through a coil with inductance
    ("bearing_friction", "tanh"),  # F_c tanh(v/v_0)
    ("bearing_clearance", STEPPED),  # the same law, solved in time
    ("rub", STEPPED),
)


def in_form(effect: Effect, form: str, rng: np.random.Generator) -> Effect:
    """The effect in another form, with what that form needs besides."""
    extras: dict[str, float] = {}
    match form:
        case "iwan":
            extras = {"elements": 6.0}
        case "two_masses":
            extras = {"block_mass": rng.uniform(4, 12), "block_stiffness": rng.uniform(4, 12)}
        case "fractional":
            extras = {"order": rng.uniform(0.6, 0.9)}
        case "collar":
            extras = {"half_width": rng.uniform(0.005, 0.012)}
        case "hardening":
            extras = {"power": rng.uniform(1.1, 1.3)}
        case "coil":
            extras = {"coil_time_constant": log_uniform(rng, 1e-4, 1e-3)}
        case "lowpass":
            effect = replace(effect, parameters={"delay": min(effect["delay"], 2e-4)})
    return replace(effect, form=form, extras=extras)


def with_scale(rig: Rig, case: Case, effect: Effect) -> Effect:
    """Lengths and velocities of a form, set by the largest travel of the linear rig at the middle level."""
    if effect.form not in ("quintic", "sinh", "tanh"):
        return effect
    travel, omega = largest_travel(rig, case.setting(False, rig.drive_node), effect, case.levels[1])
    extras = {"velocity": 0.05 * travel * omega} if effect.form == "tanh" else {"scale": travel}
    return replace(effect, extras=extras)
