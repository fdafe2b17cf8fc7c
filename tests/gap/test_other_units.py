"""The same rig in other units of mass, length and time has the same answers: no number in the code is absolute."""

from __future__ import annotations

from dataclasses import replace

import pytest
from numpy.testing import assert_allclose

from benchmarks.scaled_rigs import OTHER_UNITS, Measured, found_by, in_other_units, likeliest
from rigtwin.rotor.effects import AttachedMass
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.effects.scale import RigScale, scale_of
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig, shipped_rigs
from rigtwin.rotor.model.condition import Condition
from tests.gap.conftest import RIG, all_but

NUMBERS = {"mass": "kg", "delay": "s"}
SMALLER_AND_LARGER = (RigScale(1e-3, 0.1, 1 / 3), RigScale(1.0, 1.0, 1.0), OTHER_UNITS)


@pytest.fixture(
    scope="module",
    params=[None, pytest.param(AttachedMass(mass=0.18, node=4), marks=pytest.mark.long)],
    ids=["healthy", "mass"],
)
def twice(request, tmp_path_factory):
    """A campaign's diagnosis, and that of the same campaign in other units."""
    campaign, only = Measured(RIG, request.param).campaign, all_but("attached_mass", "sensor_delay")
    other = in_other_units(campaign, OTHER_UNITS, tmp_path_factory.mktemp("rig"))
    return found_by(campaign, only), found_by(other, only), request.param


def test_the_verdict_is_the_same(twice):
    own, other, hidden = twice
    assert own.verdict == other.verdict == ("cause" if hidden else "no_gap")
    assert [cause.effects for cause in own.causes] == [cause.effects for cause in other.causes]
    assert [cause.location.node for cause in own.causes] == [cause.location.node for cause in other.causes]
    assert likeliest(own) is None or likeliest(own).location.node == hidden.node


def test_probabilities_are_the_same(twice):
    own, other, _ = twice
    assert_allclose(own.nominal["probability"], other.nominal["probability"], atol=1e-6)
    for a, b in zip(own.causes, other.causes, strict=True):
        assert_allclose(b.probability, a.probability, atol=1e-6)
        assert_allclose(b.log_evidence, a.log_evidence, atol=0.02)  # a fit ends where a step gains hardly anything


def test_numbers_are_the_same_in_their_own_units(twice):
    own, other, _ = twice
    assert_allclose(other.nominal["k_b"].value, own.nominal["k_b"].value * OTHER_UNITS.of("N/m"), rtol=1e-4)
    for a, b in zip(own.causes, other.causes, strict=True):
        for name, number in a.parameters.items():
            grown = OTHER_UNITS.of(NUMBERS[name])
            assert abs(b.parameters[name].value / grown - number.value) < 0.02 * number.std
            assert_allclose(b.parameters[name].std, number.std * grown, rtol=0.02)


def test_the_audit_finds_the_same(twice):
    own, other, _ = twice
    assert [(f.check, f.severity, f.run) for f in own.audit] == [(f.check, f.severity, f.run) for f in other.audit]


@pytest.mark.parametrize("rig", ["nit-rourkela", "pump-overhung", "cantilever"])
def test_a_campaign_in_other_units_is_physically_the_same(rig, tmp_path):
    """Its responses are those of the grown rig, whatever the rig file holds."""
    own = Measured(rig, None).campaign
    other = in_other_units(own, OTHER_UNITS, tmp_path)
    for a, b in zip(own.runs, other.runs, strict=True):
        condition = Condition(
            k_b=3e5, rigid_support=a.support == "rigid", bearing_damping=2.0, excitation_node=a.excitation_node
        )
        grown = replace(condition, k_b=3e5 * OTHER_UNITS.of("N/m"), bearing_damping=2.0 * OTHER_UNITS.of("N.s/m"))
        nodes = [channel.node for channel in a.channels]
        H = measured_response(assemble(load_rig(rig)), condition, (), a.frequency_hz, nodes)
        scaled = measured_response(assemble(load_rig(other.rig)), grown, (), b.frequency_hz, nodes)
        assert_allclose(scaled * OTHER_UNITS.of("kg"), H, rtol=1e-6)
        assert_allclose(b.H * OTHER_UNITS.of("kg"), a.H, rtol=1e-12)


@pytest.mark.parametrize("units", SMALLER_AND_LARGER, ids=["smaller", "own", "larger"])
@pytest.mark.parametrize("rig", shipped_rigs())
def test_no_range_is_cut_by_an_absolute_limit(rig, units):
    own = scale_of(assemble(load_rig(rig)))
    scale = RigScale(own.mass * units.mass, own.length * units.length, own.time * units.time)
    cut = [
        f"{name}.{number} {role.unit}"
        for name, effect in EFFECTS.items()
        for number, role in effect.parameters().items()
        for low, high in [scale.ends(role)]
        if (role.maximum is not None and high > role.maximum) or (role.minimum and low < role.minimum)
    ]
    assert cut == []
