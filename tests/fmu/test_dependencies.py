"""The declared dependencies are honest: importers sort algebraic loops by them.

Outputs may depend at once only on the inputs they declare, at a communication point as at
initialisation (there on parameters too), and must depend on each of these in some situation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import pytest
from fmpy.model_description import ScalarVariable

from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.session import FmuSession
from tests.tolerances import ROUND_OFF

# Two values of everything that can be set, far apart.
ROTOR_VALUES = {
    "force": (0.3, -2.0),
    "force_amplitude": (1.0, 4.0),
    "force_frequency": (83.0, 250.0),
    "spin_speed": (200.0, -500.0),
    "k_b": (2e6, 3e7),
    "bearing_damping": (5.0, 100.0),
    "shaft_damping_ratio": (0.001, 0.05),
    "rigid_support": (False, True),
    "excitation_node": (2, 4),
    "excitation_plane": (1, 2),
}
ESTIMATOR_VALUES = {
    "delta_f1": (4.0, 12.0),
    "delta_f2": (26.0, 60.0),
    "amplitude_ratio": (1.2, 3.0),
    "delta_f1_std": (0.02, 40.0),
    "delta_f2_std": (0.02, 40.0),
    "amplitude_ratio_std": (0.01, 10.0),
}

Values = dict[str, float]
Read = Callable[[], Values]

SCALE = scale_of(assemble(load_rig("nit-rourkela")))


def reader(session: FmuSession) -> Read:
    outputs = [v.name for v in session.description.modelVariables if v.causality == "output"]
    return lambda: dict(zip(outputs, session.get(outputs), strict=True))


def at_a_communication_point(session: FmuSession, start: Values) -> tuple[Read, Callable[[Values], None]]:
    """Stand in the middle of a run."""
    session.start(start)
    for _ in range(5):
        session.step(3.7e-3)
    return reader(session), session.set


def at_initialisation(session: FmuSession, start: Values) -> tuple[Read, Callable[[Values], None]]:
    """Stand in initialisation mode."""
    session.start()  # takes care of the reset when the instance was used before
    fmu = session._fmu
    fmu.reset()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    session.set(start)
    return reader(session), session.set


def changes(read: Read, change: Callable[[Values], None], name: str, other: Values) -> set[str]:
    """Outputs that change at once with this variable."""
    before = read()
    change({name: other[name]})
    after = read()
    scale = max(abs(v) for v in [*before.values(), *after.values()])
    return {output for output in before if abs(after[output] - before[output]) > ROUND_OFF * scale}


def situations(values: Mapping[str, tuple]) -> Iterator[tuple[Values, Values]]:
    """(start, other) values: all first ones, then each of them exchanged for its second."""
    first = {name: pair[0] for name, pair in values.items()}
    second = {name: pair[1] for name, pair in values.items()}
    for exchanged in (None, *values):
        start = {name: second[name] if name == exchanged else first[name] for name in values}
        yield start, {name: first[name] if start[name] == second[name] else second[name] for name in values}


def observed(session, stand, values, knowns) -> dict[str, set[str]]:
    """Outputs, each with all the knowns it was ever seen to change with."""
    seen: dict[str, set[str]] = {name: set() for name in reader_names(session)}
    for start, other in situations(values):
        for known in knowns:
            for output in changes(*stand(session, start), known, other):
                seen[output].add(known)
    return seen


def reader_names(session: FmuSession) -> list[str]:
    return [v.name for v in session.description.modelVariables if v.causality == "output"]


def declared(unknowns) -> dict[str, set[str]]:
    """Outputs, each with the names it declares to depend on."""
    return {unknown.variable.name: {known.name for known in unknown.dependencies} for unknown in unknowns}


def inputs(session: FmuSession) -> list[str]:
    return [v.name for v in session.description.modelVariables if v.causality == "input"]


def settable(variables: list[ScalarVariable]) -> list[str]:
    return [v.name for v in variables if v.causality in ("input", "parameter")]


def test_the_table_of_values_leaves_no_variable_of_the_rotor_out(rotor_session):
    contract = [name for name in settable(rotor_session.description.modelVariables) if "." not in name]
    assert set(contract) == set(ROTOR_VALUES)


def without_effects(dependencies: dict[str, set[str]]) -> dict[str, set[str]]:
    """What is left of the dependencies while every effect is off."""
    return {output: {name for name in names if "." not in name} for output, names in dependencies.items()}


def test_at_a_communication_point_the_rotors_outputs_depend_on_what_they_declare(rotor_session):
    found = observed(rotor_session, at_a_communication_point, ROTOR_VALUES, inputs(rotor_session))
    assert found == declared(rotor_session.description.outputs)


def test_at_initialisation_the_rotors_outputs_depend_on_what_they_declare(rotor_session):
    """The spin speed acts at initialisation only through an unbalance."""
    found = observed(rotor_session, at_initialisation, ROTOR_VALUES, list(ROTOR_VALUES))
    for output, names in without_effects(declared(rotor_session.description.initialUnknowns)).items():
        assert found[output] == names - {"spin_speed"}


@pytest.mark.parametrize("effect", [e for e in EFFECTS.values() if e.in_fmu], ids=lambda e: e.id)
def test_an_effect_acts_at_initialisation_if_and_only_if_it_is_declared(rotor_session, effect):
    switch = f"{effect.id}.enabled"
    declared_names = set().union(*declared(rotor_session.description.initialUnknowns).values())
    bases = [
        {**{name: pair[0] for name, pair in ROTOR_VALUES.items()}, "rigid_support": rigid} for rigid in (False, True)
    ]
    acts = any(changes(*at_initialisation(rotor_session, base), switch, {switch: True}) for base in bases)
    assert acts == (switch in declared_names) == effect.acts_at_once
    for name, parameter in effect.parameters().items():
        variable = f"{effect.id}.{name}"
        other = {variable: 0.5 * (getattr(effect, name) + SCALE.ends(parameter)[1])}
        moved = any(
            changes(*at_initialisation(rotor_session, {**base, switch: True}), variable, other) for base in bases
        )
        assert variable in declared_names or not moved


@pytest.mark.parametrize("stand", [at_a_communication_point, at_initialisation])
def test_the_estimators_outputs_depend_on_all_inputs(estimator_session, stand):
    found = observed(estimator_session, stand, ESTIMATOR_VALUES, list(ESTIMATOR_VALUES))
    description = estimator_session.description
    groups = {at_a_communication_point: description.outputs, at_initialisation: description.initialUnknowns}
    assert found == declared(groups[stand])


def test_the_frequency_of_the_sine_acts_only_after_the_next_step(rotor_session):
    """Not declared, and exactly without effect at once, because the sine's phase is continuous."""
    read, change = at_a_communication_point(rotor_session, {name: pair[0] for name, pair in ROTOR_VALUES.items()})
    before = read()
    change({"force_frequency": 250.0})
    assert read() == before
    rotor_session.step(1e-3)
    assert read() != before
