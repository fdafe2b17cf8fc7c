"""``rigtwin effects``: the library as a reader and as a machine see it."""

from __future__ import annotations

import math

import pytest

from rigtwin.commands.effects import LOCATIONS, limits, prior, record, zero
from rigtwin.rotor.effects import EFFECTS, Parameter
from rigtwin.rotor.model.condition import Condition
from rigtwin.wording import number, unit
from tests.rigtwin.conftest import run, run_json

KEYS = {
    "id", "title", "family", "where", "meaning", "equation", "signature", "source", "in_fmu", "is_candidate",
    "changes_size", "parameters", "places",
}  # fmt: skip


def test_the_list_names_every_effect_with_its_parameters_and_numbers():
    lines = run("effects").stdout.splitlines()
    for key, effect in EFFECTS.items():
        first = next(place for place, line in enumerate(lines) if line.split()[:1] == [key])
        assert effect.title in lines[first]
        for row, (name, role) in zip(lines[first:], effect.parameters().items(), strict=False):
            assert f" {name} " in row
            assert prior(role) in row
            assert number(getattr(effect(), name)) in row
    families = [line.strip() for line in lines if line.strip() in {e.family for e in EFFECTS.values()}]
    assert families == ["structure", "support", "nonlinear", "chain", "spinning"]


@pytest.mark.parametrize("key", EFFECTS)
def test_one_effect_says_what_it_is_where_it_sits_and_where_it_comes_from(key):
    effect = EFFECTS[key]
    result = run("effects", key)
    assert result.exit_code == 0
    for words in (effect.title, effect.meaning, effect.equation, effect.signature, effect.source):
        assert words in result.stdout
    assert LOCATIONS[effect.location] in result.stdout
    for name, role in effect.roles().items():
        assert f" {name} " in result.stdout
        assert role.meaning.split()[-1] in result.stdout


def test_a_machine_reads_every_effect():
    found = run_json("effects")["effects"]
    assert [entry["id"] for entry in found] == list(EFFECTS)
    assert all(set(entry) == KEYS for entry in found)
    assert run_json("effects", "rub") == next(entry for entry in found if entry["id"] == "rub")


def test_the_record_of_a_parameter_is_the_parameter():
    pedestal = run_json("effects", "pedestal_flexibility")
    stiffness, *others = pedestal["parameters"]
    assert stiffness == {
        "name": "stiffness", "unit": "N/m", "meaning": "Stiffness of each pedestal", "start": 1e7,
        "prior": {"low": 0.3, "high": 50.0, "in": "m_r t_r^-2", "even_in": "log"},
        "zero": "infinity", "minimum": 1.0, "maximum": 1e15,
    }  # fmt: skip
    assert [p["zero"] for p in others] == [None] * 4
    assert pedestal["changes_size"]
    place = {"name": "node", "start": 2, "meaning": "Node of the sensor, 0: every sensor"}
    assert run_json("effects", "sensor_gain")["places"] == [
        place | {"kind": "node", "all_nodes": True, "exciter": False}
    ]


def test_a_zero_that_is_named_is_an_entry_of_the_test_condition():
    for effect in EFFECTS.values():
        for parameter in record(effect)["parameters"]:
            if isinstance(parameter["zero"], str) and parameter["zero"] != "infinity":
                assert hasattr(Condition(), parameter["zero"])


@pytest.mark.parametrize(
    ("asked", "answer"),
    [
        ("bearing_cubik", "there is no effect 'bearing_cubik'; did you mean bearing_cubic?"),
        ("open-crack", "there is no effect 'open-crack'; did you mean open_crack?"),
        ("warp_drive", "there is no effect 'warp_drive'; rigtwin effects lists them all"),
    ],
)
def test_an_effect_that_does_not_exist_is_refused_in_one_sentence(refused, asked, answer):
    assert refused("effects", asked).startswith(answer)
    assert refused("effects", asked, "--json").startswith(answer)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.02, "0.02"), (30000.0, "30000"), (5e5, "5e5"), (1e15, "1e15"), (5e-7, "5e-7"), (-2e4, "−20000"),
     (-0.5, "−0.5"), (math.inf, "∞"), (1.4e-5, "1.4e-5")],
)  # fmt: skip
def test_numbers_are_short(value, text):
    assert number(value) == text


def test_words_for_a_parameter():
    role = Parameter("N.s/m", "Damping", 10.0, 500.0, null="bearing_damping", minimum=0.0, log=True)
    assert (unit(role.unit), unit("1"), unit("Hz")) == ("N s/m", "", "Hz")
    assert (prior(role), zero(role), limits(role)) == ("10 to 500 m_r t_r^-1, log", "as in the test", "0 to ∞")
    other = Parameter("m", "Offset", -0.01, 0.01, null=None)
    assert (prior(other), zero(other), limits(other)) == ("−0.01 to 0.01 l_r", "", "−∞ to ∞")
