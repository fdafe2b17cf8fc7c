"""From a campaign to a verdict where one effect at one level is not all: laws, pairs, what the virtual rig measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.blind.generate.campaigns import Order, make
from rigtwin.gap.diagnose import diagnose
from rigtwin.gap.inference.hypotheses import candidates
from rigtwin.gap.model.forward import Forward, acting
from rigtwin.rotor.effects import AttachedMass, BearingDamping, Gyroscopic
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.sim.campaign import Channel
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.lines import NotSettledError
from rigtwin.sim.setup import SetupError
from tests.gap.conftest import (
    CUBIC,
    K_B,
    LEVELS,
    MASS,
    NOISE,
    STRUCTURE,
    WORKSHOP,
    all_but,
    blank,
    both_supports,
    campaign_of,
    condition,
    lines,
    truth,
    with_noise,
)

# A force sensor and accelerometers that err as the campaign believes they may.
GAINS = 1.02 * (1 + 0.01 * np.array([1.0, -1.0, 0.5, -0.5, 1.0, -1.0, 0.0]))


def on_the_virtual_rig(runs, effects, k_b):
    """Exact sensors, exact forces."""
    return [_response(run, acting(effects, run.support), k_b) for run in runs], "rig"


def _response(run, effects, k_b):
    if not any(effect.family == "nonlinear" for effect in effects):
        return truth(run, effects, k_b=k_b)
    return Forward(WORKSHOP).made(with_data=False).modal(run, k_b, effects).response()


# -- the virtual rig's figures ----------------------------------------------------------------------


@pytest.mark.parametrize("quantity", ["accelerance", pytest.param("acceleration", marks=pytest.mark.long)])
def test_what_the_virtual_rig_measures_is_the_figure_under_the_gains_of_the_runs(quantity):
    runs = both_supports(MASS, seed=3, gain=GAINS, quantity=quantity, force_amplitude_N=2.0)
    found = diagnose(campaign_of(*runs), exclude=all_but("attached_mass"), confirm=on_the_virtual_rig).diagnosis
    assert found.shrink.verified_by == "rig"
    assert_allclose(found.shrink.after, found.shrink.after_model, rtol=0.02)
    assert_allclose(found.shrink.after, found.shrink.floor, rtol=0.2)


@pytest.mark.long
@pytest.mark.parametrize(
    "error", [SetupError("no such sensor"), NotSettledError("no end of the transient", 90.0, 1e-3)]
)
def test_where_the_virtual_rig_has_no_figure_the_models_own_stands(error):
    def refused(*_):
        raise error

    runs = both_supports(MASS, seed=3)
    shrink = diagnose(campaign_of(*runs), exclude=all_but("attached_mass"), confirm=refused).diagnosis.shrink
    assert shrink.verified_by == "model"
    assert shrink.after == shrink.after_model < 2 * NOISE


# -- laws -------------------------------------------------------------------------------------------

FORCES = (0.0515, 0.194, 0.808)  # where the force sensor says LEVELS [N]


@pytest.fixture(scope="module")
def hardened():
    """Accelerations at three levels, the forces up to 3 % off."""
    rigid = blank("rigid", lines("rigid"), force_amplitude_N=1.0, name="rigid")
    runs = [with_noise(rigid, truth(rigid), 9)]
    for seed, level in enumerate(LEVELS):
        settings = {"quantity": "acceleration", "sweep": "up", "name": f"{level} N"}
        driven = blank("bearing", lines("bearing"), force_amplitude_N=FORCES[seed], **settings)
        run = blank("bearing", lines("bearing"), force_amplitude_N=level, **settings)
        runs.append(with_noise(run, _response(driven, (CUBIC,), K_B), seed))
    exclude = all_but("bearing_cubic", "attached_mass")
    return diagnose(campaign_of(*runs), exclude=exclude, confirm=on_the_virtual_rig)


@pytest.mark.long
def test_a_law_is_named_where_levels_differ(hardened):
    found = hardened.diagnosis
    assert (found.verdict, found.causes[0].effects) == ("cause", ("bearing_cubic",))
    assert found.where.regime == "amplitude_dependent"
    stiffness = found.causes[0].parameters["stiffness"]
    assert abs(stiffness.value - CUBIC.stiffness) < 4 * stiffness.std
    assert found.next_test is not None
    assert len(hardened.curves) == 4


@pytest.mark.long
def test_the_virtual_rig_is_driven_by_the_forces_that_were_found(hardened):
    shrink = hardened.diagnosis.shrink
    assert shrink.verified_by == "rig"
    assert_allclose(shrink.after, shrink.after_model, rtol=0.1)
    assert shrink.after < 1.3 * shrink.floor < 0.2 * shrink.before


# -- pairs ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_two_effects_are_one_cause_with_the_numbers_and_places_of_both():
    pair = AttachedMass(mass=0.1, node=3), BearingDamping(damping=150.0)
    names = ("attached_mass", "bearing_damping", "disk_mass")
    found = diagnose(campaign_of(*both_supports(*pair, seed=2)), exclude=all_but(*names)).diagnosis
    cause = found.causes[0]
    assert (found.verdict, set(cause.effects)) == ("cause", {"attached_mass", "bearing_damping"})
    assert set(cause.parameters) == {"attached_mass.mass", "bearing_damping.damping"}
    assert {location.kind for location in cause.locations} == {"node", "bearings"}
    for name, true in (("attached_mass.mass", 0.1), ("bearing_damping.damping", 150.0)):
        assert abs(cause.parameters[name].value - true) < 4 * cause.parameters[name].std


@pytest.mark.long
def test_a_second_effect_at_the_bearings_does_not_stand_for_another_form_of_the_first(tmp_path):
    """Rubber of fractional order, which a damper beside rubber of the library's form would patch up."""
    order = Order("W6", "tuning", 301, 3)
    make(order, tmp_path)
    measured = load_campaign(tmp_path / order.name / "measured")
    found = diagnose(measured, exclude=all_but("viscoelastic_support", "bearing_damping")).diagnosis
    assert (found.verdict, found.causes[0].effects) == ("cause", ("viscoelastic_support",))


# -- spin -------------------------------------------------------------------------------------------


@pytest.mark.long
def test_what_splits_the_modes_of_a_spinning_rotor_is_named():
    """Accelerometers in both planes, at rest and at 6000 rev/min."""
    channels = tuple(Channel(node, plane) for plane in ("y", "z") for node in (2, 4, 6))
    effect = Gyroscopic(factor=0.8)
    runs = [spinning(rpm, effect, channels, seed) for seed, rpm in enumerate((0.0, 6000.0))]
    names = ("gyroscopic", "plane_anisotropy", "bearing_asymmetry", "disk_inertia", "attached_mass")
    found = diagnose(campaign_of(*runs), exclude=all_but(*names), confirm=None).diagnosis
    assert (found.verdict, found.causes[0].effects) == ("cause", ("gyroscopic",))
    assert found.where.regime == "spin_dependent"
    factor = found.causes[0].parameters["factor"]
    assert abs(factor.value - 0.8) < 4 * factor.std < 0.4
    assert not {"gyroscopic", "unbalance"} & {h.ids[0] for h in candidates(runs[:1], STRUCTURE)}


def spinning(rpm, effect, channels, seed):
    """A run of a rotor that turns."""
    run = blank("bearing", lines("bearing"), channels=channels, spin_rpm=rpm, name=f"{rpm:g} rpm")
    turning = replace(condition("bearing"), spin_speed=rpm * np.pi / 30)
    planes = [measured_response(STRUCTURE, turning, (effect,), run.frequency_hz, [2, 4, 6], plane=k) for k in (1, 2)]
    return with_noise(run, np.hstack(planes), seed)
