"""Effects switched on in the FMU: what they do, when they may be switched, and that states replay exactly."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from rigtwin.rotor.effects import EFFECTS
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.time.simulator import RotorSimulator
from rigtwin.sim.session import FmuSession
from tests.fmu.child import in_child

OUTPUTS = [f"node_{node}.acceleration_{plane}" for plane in "yz" for node in range(1, 8)]
IN_FMU = [effect for effect in EFFECTS.values() if effect.in_fmu and effect.location != "joints"]  # it has no joint
NONLINEAR = [effect for effect in IN_FMU if effect.family == "nonlinear"]

# A drive strong enough for every force law to matter; the spin makes the spinning effects act.
DRIVE = {"force_amplitude": 20.0, "force_frequency": 71.0, "spin_speed": 300.0, "k_b": 2e6, "bearing_damping": 50.0}

each_effect = pytest.mark.parametrize("effect", IN_FMU, ids=lambda e: e.id)
each_nonlinear = pytest.mark.parametrize("effect", NONLINEAR, ids=lambda e: e.id)

SCALE = scale_of(assemble(load_rig("nit-rourkela")))


def switched_on(effect, **values) -> dict:
    """Start values with an effect on, and rigid supports where only they have it."""
    return {**DRIVE, f"{effect.id}.enabled": True, "rigid_support": effect.location == "rigid_support", **values}


def ride(session: FmuSession, start: dict, n: int = 60) -> np.ndarray:
    """Readings over the first n milliseconds from rest."""
    session.start(start)
    return session.sample(OUTPUTS, 1e-3, n)


@each_effect
def test_an_effect_switched_on_changes_the_simulated_rig(rotor_session, effect):
    start = switched_on(effect)
    on, off = ride(rotor_session, start), ride(rotor_session, {**start, f"{effect.id}.enabled": False})
    assert np.abs(on - off).max() > 1e-4 * np.abs(off).max()


@each_effect
def test_parameters_of_an_effect_that_is_off_do_nothing(rotor_session, effect):
    nominal = ride(rotor_session, DRIVE)
    changed = {f"{effect.id}.{name}": SCALE.ends(parameter)[1] for name, parameter in effect.parameters().items()}
    np.testing.assert_array_equal(ride(rotor_session, {**DRIVE, **changed}), nominal)


def _larger(start, role):
    """The upper end of a range, of a number that is not zero at most ten times its start."""
    high = SCALE.ends(role)[1]
    return min(high, 10 * start) if start > 0 else high


@each_effect
def test_the_fmu_is_the_simulator_with_that_effect(rotor_session, structure, effect):
    """Every parameter of the FMU reaches the effect's field of the same name."""
    values = {}
    for f in fields(effect):
        role = effect.roles()[f.name]
        values[f.name] = (
            0.6 * f.default + 0.4 * _larger(f.default, role) if f.name in effect.parameters() else f.default
        )
    start = switched_on(effect, **{f"{effect.id}.{name}": value for name, value in values.items()})
    readings = ride(rotor_session, start)
    condition = Condition(
        k_b=2e6, bearing_damping=50.0, spin_speed=300.0, rigid_support=effect.location == "rigid_support"
    )
    simulator = RotorSimulator(structure, condition, [effect(**values)])
    simulator.drive(force=0.0, force_amplitude=20.0, force_frequency=71.0)
    expected = [simulator.accelerations()]
    for k in range(len(readings) - 1):
        simulator.advance(simulator.time, 1e-3 * (k + 1) - simulator.time)
        expected.append(simulator.accelerations())
    np.testing.assert_allclose(readings, expected, rtol=0, atol=1e-9 * np.abs(readings).max())


@each_nonlinear
def test_a_replay_with_a_force_law_is_exact_to_the_last_bit(rotor_session, effect):
    rotor_session.start(switched_on(effect))
    rotor_session.step(0.0371)
    saved = rotor_session.save_state()
    futures = []
    for _ in range(2):
        rotor_session.restore_state(saved)
        first = rotor_session.sample(OUTPUTS, 7.7e-4, 30)
        rotor_session.set({"k_b": 1.5e6})
        rotor_session.step(0.05)
        futures.append(np.concatenate([first, rotor_session.sample(OUTPUTS, 1.3e-4, 30)]))
    np.testing.assert_array_equal(futures[1], futures[0])


@each_nonlinear
def test_long_and_short_communication_steps_lead_to_the_same_motion(rotor_session, effect):
    """Within the tolerance of the internal steps; in a gap small differences grow, hence the short time."""
    readings = []
    for n in (1, 50):
        rotor_session.start(switched_on(effect))
        for _ in range(n):
            rotor_session.step(0.05 / n)
        readings.append(rotor_session.get(OUTPUTS))
    assert np.abs(np.subtract(*readings)).max() < 0.02 * np.abs(readings[0]).max()


@pytest.mark.parametrize("spin_speed", [0.0, 300.0])
def test_a_law_at_a_node_that_is_held_does_nothing_however_long_the_step(rotor_session, spin_speed):
    held = {**DRIVE, "rigid_support": True, "spin_speed": spin_speed, "unbalance.enabled": True}
    readings = []
    for rub in (False, True):
        rotor_session.start({**held, "rub.enabled": rub, "rub.node": 1})
        for _ in range(2):
            rotor_session.step(0.25)
        readings.append(rotor_session.get(OUTPUTS))
    np.testing.assert_allclose(*readings, rtol=0, atol=1e-9 * np.abs(readings[0]).max())


def test_the_strength_of_a_viscoelastic_support_may_be_tuned_to_zero_and_back(rotor_session):
    readings = []
    for strength in (0.0, 1e-6, 1e3):
        rotor_session.start({**DRIVE, "viscoelastic_support.enabled": True})
        rotor_session.step(0.01)
        rotor_session.set({"viscoelastic_support.strength": strength})
        rotor_session.step(0.01)
        readings.append(rotor_session.get(OUTPUTS))
    none, little, much = np.asarray(readings)
    np.testing.assert_allclose(none, little, rtol=0, atol=1e-5 * np.abs(little).max())
    assert np.abs(none - much).max() > 1e-2 * np.abs(much).max()


@pytest.mark.parametrize("effect", [e for e in IN_FMU if not e.changes_size], ids=lambda e: e.id)
def test_an_effect_of_the_same_size_may_be_switched_while_the_rotor_runs(rotor_session, effect):
    start = switched_on(effect)
    rotor_session.start({**start, f"{effect.id}.enabled": False})
    rotor_session.step(0.03)
    rotor_session.set({f"{effect.id}.enabled": True})
    rotor_session.step(0.01)
    on = rotor_session.get(OUTPUTS)
    rotor_session.start({**start, f"{effect.id}.enabled": False})
    rotor_session.step(0.04)
    assert np.abs(np.subtract(on, rotor_session.get(OUTPUTS))).max() > 0
    assert np.isfinite(on).all()


def refused(fmu, start: dict, late: dict) -> str:
    """The sentence with which a value is refused; the instance must be able to go on."""
    from rigtwin.sim.session import FmuError, FmuSession

    with FmuSession(fmu) as session:
        session.start(start)
        session.step(0.01)
        try:
            session.set(late)
        except FmuError as error:
            session.step(0.01)
            return str(error)
        return "accepted"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((f"{e.id}.enabled", True) for e in IN_FMU if e.changes_size),
        ("viscoelastic_support.spread", 0.5),
        ("pedestal_flexibility.block_compliance", 0.2),
    ],
)
def test_what_changes_the_degrees_of_freedom_cannot_be_set_late(rotor_fmu, name, value):
    assert f"{name} can only be set before the simulation starts" in in_child(refused, rotor_fmu, DRIVE, {name: value})


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"attached_mass.mass": -0.1}, "attached_mass.mass must be at least 0 kg, got -0.1"),
        ({"attached_mass.node": 8}, "attached_mass.node must be at most 7, got 8"),
        ({"open_crack.position": 0.5}, "open_crack.position must be at most 0.426 m, got 0.5"),
        ({"rub.gap": float("nan")}, "rub.gap must be a finite number, got nan"),
        ({"axial_load.enabled": True, "axial_load.force": -2e5}, "buckles"),
    ],
    ids=["negative mass", "no such node", "off the shaft", "nan", "buckling"],
)
def test_values_that_are_not_physical_are_refused_with_a_sentence(rotor_fmu, values, sentence):
    assert sentence in in_child(refused, rotor_fmu, DRIVE, values)
