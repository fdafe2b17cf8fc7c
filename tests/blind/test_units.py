"""A campaign in other units of mass and length is the same rig: frequencies, dampings and relative noise stay."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.blind.generate.campaigns import Order, make
from rigtwin.blind.generate.units import in_other_units
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.campaign_folder import load_campaign

MASS, LENGTH = 64.0, 4.0  # powers of two: scaled without rounding
PUMP = Order("W9", "tuning", 1, 4)
HIDING = Order("W9", "tuning", 1, 10)  # in a pump, too; at constant current or not, it hides an effect


@pytest.fixture(scope="module")
def originals(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("originals")
    for order in (PUMP, HIDING):
        make(order, folder)
    return folder


@pytest.fixture
def copy(originals, tmp_path) -> Path:
    in_other_units(originals / PUMP.name, tmp_path / "copy", mass=MASS, length=LENGTH)
    return tmp_path / "copy"


@pytest.mark.long
@pytest.mark.parametrize("part", ["measured", "held_out"])
def test_frequencies_stay_and_accelerances_are_divided_by_the_mass(originals, copy, part):
    before, after = (load_campaign(folder / part) for folder in (originals / PUMP.name, copy))
    for old, new in zip(before.runs, after.runs, strict=True):
        assert_array_equal(new.frequency_hz, old.frequency_hz)
        assert_array_equal(new.H, old.H / MASS)
        assert new.std is None or old.std is None or np.array_equal(new.std, old.std / MASS)
        assert new.force_amplitude_N == (old.force_amplitude_N or 0.0) * MASS * LENGTH
        assert (new.support, new.excitation_node) == (old.support, old.excitation_node)
    assert after.nominal.sensor_mass_kg == before.nominal.sensor_mass_kg * MASS
    assert after.nominal.bearing_damping_Ns_per_m == before.nominal.bearing_damping_Ns_per_m * MASS
    assert after.nominal.shaft_damping_ratio == before.nominal.shaft_damping_ratio
    assert after.nominal.modulus_tolerance == before.nominal.modulus_tolerance


@pytest.mark.long
def test_the_copys_rig_responds_as_its_data_are_scaled(copy):
    rigs = load_rig("pump-overhung"), load_rig(load_campaign(copy / "measured").rig)
    lines = np.linspace(20.0, 300.0, 30)
    conditions = [
        Condition(k_b=2e7 * f, bearing_damping=300.0 * f, shaft_damping_ratio=0.003, excitation_node=3)
        for f in (1.0, MASS)
    ]
    old, new = (measured_response(assemble(r), c, [], lines) for r, c in zip(rigs, conditions, strict=True))
    assert_allclose(new, old / MASS, rtol=1e-9, atol=1e-9 * np.abs(old).max() / MASS)
    assert rigs[1].length == LENGTH * rigs[0].length


@pytest.mark.long
def test_back_again_is_what_it_was(originals, copy, tmp_path):
    in_other_units(copy, tmp_path / "back", mass=1 / MASS, length=1 / LENGTH)
    for part in ("measured", "held_out"):
        before, after = (load_campaign(folder / part) for folder in (originals / PUMP.name, tmp_path / "back"))
        for old, new in zip(before.runs, after.runs, strict=True):
            assert_array_equal(new.H, old.H)
        rig, again = load_rig(before.rig), load_rig(after.rig)
        assert rig.same_rotor(again)
        files = [folder / "truth" / f"{part}.npz" for folder in (originals / PUMP.name, tmp_path / "back")]
        with np.load(files[0]) as old_truth, np.load(files[1]) as new_truth:
            assert old_truth.files == new_truth.files
            assert all(np.array_equal(old_truth[key], new_truth[key]) for key in old_truth.files)


def test_the_label_tells_the_same_in_other_units(originals, tmp_path):
    in_other_units(originals / HIDING.name, tmp_path / "copy", mass=MASS, length=LENGTH)
    old, new = (
        json.loads((folder / "truth" / "label.json").read_text(encoding="utf-8"))
        for folder in (originals / HIDING.name, tmp_path / "copy")
    )
    assert (new["campaign"], new["size_ratio"], new["drift"]) == ("copy", old["size_ratio"], old["drift"])
    assert (new["k_b"], new["nodes_m"][-1]) == (MASS * old["k_b"], LENGTH * old["nodes_m"][-1])
    assert new["levels"] == [MASS * LENGTH * level for level in old["levels"]]
    assert new["workshop"] == old["workshop"]
    assert [e["id"] for e in new["effects"]] == [e["id"] for e in old["effects"]] != []


def test_an_effects_numbers_have_units_of_their_own(originals, tmp_path):
    """Of a mass, a stiffness and a relaxation time only the last one stays; a place moves with the rig."""
    path = originals / HIDING.name / "truth" / "label.json"
    label = json.loads(path.read_text(encoding="utf-8"))
    numbers = {"stiffness": 2.0, "mass": 3.0, "damping": 5.0}
    effects = [
        {"id": "pedestal_flexibility", "parameters": numbers, "location": {"kind": "bearings"}, "form": ""},
        {"id": "open_crack", "parameters": {"reduction": 0.1}, "location": {"x_m": 0.5}, "form": ""},
        {"id": "axial_load", "parameters": {"force": 7.0}, "location": {"kind": "shaft"}, "form": ""},
    ]
    path.write_text(json.dumps(label | {"effects": effects}), encoding="utf-8")
    in_other_units(originals / HIDING.name, tmp_path / "copy", mass=MASS, length=LENGTH)
    copied = json.loads((tmp_path / "copy" / "truth" / "label.json").read_text(encoding="utf-8"))["effects"]
    assert copied[0]["parameters"] == {name: MASS * value for name, value in numbers.items()}
    assert (copied[1]["parameters"], copied[1]["location"]) == ({"reduction": 0.1}, {"x_m": 0.5 * LENGTH})
    assert copied[2]["parameters"] == {"force": 7.0 * MASS * LENGTH}
    path.write_text(json.dumps(label | {"effects": [effects[0] | {"form": "two_masses"}]}), encoding="utf-8")
    with pytest.raises(ValueError, match="pedestal_flexibility in another form"):
        in_other_units(originals / HIDING.name, tmp_path / "other", mass=MASS, length=LENGTH)
    path.write_text(json.dumps(label), encoding="utf-8")
