"""What every effect keeps to: symmetry, passivity, a zero, composition, and the place it belongs to."""

from __future__ import annotations

import math
from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rigtwin.rotor.effects import EFFECTS, BearingFriction, CompliantRigidSupport, Effect, OpenCrack, PlaneAnisotropy
from rigtwin.rotor.effects.nonlinear import SEAT_PARTS
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.local_force import LocalForce
from rigtwin.rotor.model.printed_laws import SCALAR
from rigtwin.rotor.model.rotor_model import build_model
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.rotor.time.simulator import RotorSimulator
from tests.rotor.effect_cases import (
    BEARING,
    IN_BEARINGS,
    LINEAR,
    NONLINEAR,
    OMEGA,
    PLACED,
    RIGID,
    SUPPORTS,
    conditions,
    drawn,
    node_receptance,
    nodes_of,
    paper,
    paper_scale,
    paper_with,
    relative_difference,
    sensed,
)
from tests.tolerances import EFFECT_LIMIT, ROUND_OFF, SPECTRAL, STEPPER

each_effect = pytest.mark.parametrize("key", PLACED)
each_linear = pytest.mark.parametrize("key", LINEAR)
each_support = pytest.mark.parametrize("condition", SUPPORTS.values(), ids=SUPPORTS)
few = settings(max_examples=8)
spins = st.sampled_from([-900.0, 0.0, 300.0, 2000.0])

# From far below the first mode to far above the last that the mesh has.
WIDE = 2 * np.pi * np.geomspace(0.1, 1e6, 36)


def assert_symmetric(matrix: FloatArray) -> None:
    assert_allclose(matrix, matrix.T, rtol=0, atol=ROUND_OFF * np.abs(matrix).max())


def lowest(matrix: np.ndarray) -> float:
    """Lowest eigenvalue of a Hermitian matrix over the size of its largest."""
    values = np.linalg.eigvalsh(matrix)
    return float(values[0] / max(np.abs(values).max(), np.finfo(float).tiny))


# --- matrices --------------------------------------------------------------------------------------


@each_effect
@few
@given(data=st.data(), condition=conditions)
def test_mass_stiffness_and_damping_are_symmetric_and_the_gyroscopic_matrix_is_skew(key, data, condition):
    system = paper_with(condition, data.draw(drawn(key)))
    for matrix in (system.M, system.K, system.K_shaft, system.C, system.C_support):
        assert_symmetric(matrix)
    assert_allclose(system.G, -system.G.T, rtol=0, atol=ROUND_OFF * np.abs(system.G).max())


@each_effect
@few
@given(data=st.data(), condition=conditions)
def test_every_motion_has_kinetic_energy_except_that_of_massless_joints(key, data, condition):
    system = paper_with(condition, data.draw(drawn(key)))
    assert lowest(system.M[np.ix_(system.heavy, system.heavy)]) > 0
    assert not system.M[system.massless].any()


@each_effect
@few
@given(data=st.data(), condition=conditions)
def test_no_effect_feeds_energy(key, data, condition):
    system = paper_with(condition, data.draw(drawn(key)))
    assert lowest(system.C_support) >= -ROUND_OFF
    assert lowest(system.C) >= -ROUND_OFF


@each_effect
@few
@given(data=st.data(), condition=conditions, spin_speed=spins)
def test_every_driving_point_takes_power_at_every_frequency(key, data, condition, spin_speed):
    """The Hermitian part of the mobility matrix i omega H has no negative eigenvalue."""
    system = paper_with(condition, data.draw(drawn(key)))
    mobility = 1j * WIDE[:, None, None] * node_receptance(system, WIDE, spin_speed)
    power = (mobility + mobility.conj().swapaxes(1, 2)) / 2
    worst = np.linalg.eigvalsh(power).min(axis=1) / np.abs(mobility).max(axis=(1, 2))
    assert worst.min() >= -ROUND_OFF


@each_effect
@few
@given(data=st.data(), condition=conditions, spin_speed=spins)
def test_no_free_motion_grows(key, data, condition, spin_speed):
    values = np.linalg.eigvals(StateSpace(paper_with(condition, data.draw(drawn(key))), spin_speed).A)
    assert values.real.max() <= ROUND_OFF * np.abs(values).max()


# --- responses -------------------------------------------------------------------------------------


@each_effect
@few
@given(data=st.data(), condition=conditions, spin_speed=spins)
def test_negative_frequency_conjugates_the_response(key, data, condition, spin_speed):
    system = paper_with(condition, data.draw(drawn(key)))
    H, mirrored = (node_receptance(system, omega, spin_speed) for omega in (OMEGA, -OMEGA))
    assert_allclose(mirrored, H.conj(), rtol=0, atol=ROUND_OFF * np.abs(H).max())


@each_effect
@few
@given(data=st.data(), condition=conditions, gyroscopic=drawn("gyroscopic"))
def test_reversing_the_spin_transposes_the_response(key, data, condition, gyroscopic):
    system = paper_with(condition, data.draw(drawn(key)), gyroscopic)
    H, reversed_H = (node_receptance(system, OMEGA, spin) for spin in (500.0, -500.0))
    assert_allclose(reversed_H, H.swapaxes(1, 2), rtol=0, atol=ROUND_OFF * np.abs(H).max())


@each_effect
@few
@given(data=st.data(), condition=conditions, spin_speed=spins)
def test_the_first_order_form_has_the_response_of_the_dynamic_stiffness(key, data, condition, spin_speed):
    """Pedestals and massless joints included: the same rotor in frequency and in time."""
    system = paper_with(condition, data.draw(drawn(key)))
    forces = nodes_of(system)
    direct = node_receptance(system, OMEGA, spin_speed)
    by_state = StateSpace(system, spin_speed).receptance(OMEGA, forces, forces.T)
    assert_allclose(by_state, direct, rtol=0, atol=SPECTRAL * np.abs(direct).max())


@each_linear
def test_twice_the_force_gives_twice_the_accelerations(key):
    """In time, from rest; a linear effect stays linear there too."""

    def accelerations(force: float) -> FloatArray:
        simulator = RotorSimulator(paper(), BEARING, [EFFECTS[key]()])
        simulator.drive(force=0.3 * force, force_amplitude=force, force_frequency=90.0)
        rows = []
        for _ in range(10):
            simulator.advance(simulator.time, 0.003)
            rows.append(simulator.accelerations())
        return np.array(rows)

    single = accelerations(1.0)
    assert np.abs(single).max() > 0
    assert_allclose(accelerations(2.0), 2 * single, rtol=0, atol=STEPPER * np.abs(single).max())


# --- zero ------------------------------------------------------------------------------------------


def force_at(force: LocalForce, displacement: float = 1e-6) -> float:
    """Largest force of a law without memory where the shaft moves so far either way [N]."""
    x = np.array([-displacement, displacement])
    return float(np.abs(force.along(x)[0]).max())


@each_support
@each_effect
def test_at_severity_zero_an_effect_does_nothing(key, condition):
    model = build_model(paper(), condition, [EFFECTS[key].identity(condition)])
    nominal = paper_with(condition)
    assert relative_difference(node_receptance(model.system), node_receptance(nominal)) < EFFECT_LIMIT
    assert_allclose(sensed(model.system), sensed(nominal), rtol=0, atol=EFFECT_LIMIT * np.abs(sensed(nominal)).max())
    elastic = condition.k_b * 1e-6
    assert max(map(force_at, model.forces), default=0.0) < EFFECT_LIMIT * elastic
    assert not any(u.moment for u in model.unbalances)


def test_the_zero_follows_the_test_condition_where_an_effect_replaces_its_entry():
    for zeta, c_b in ((0.001, 0.0), (0.01, 70.0)):
        condition = Condition(shaft_damping_ratio=zeta, bearing_damping=c_b)
        for key in ("shaft_damping", "bearing_damping"):
            changed = paper_with(condition, EFFECTS[key].identity(condition))
            assert_allclose(changed.C, paper_with(condition).C, rtol=0, atol=0)


def test_a_measurement_chain_at_severity_zero_reports_the_rotor():
    H = sensed(paper_with(BEARING))
    for key, effect in EFFECTS.items():
        nothing = effect.identity(BEARING)
        assert_allclose(nothing.channel_factor(OMEGA, 2), 1.0, rtol=0, atol=0, err_msg=key)
        assert_allclose(nothing.force_factor(OMEGA, H[:, 1]), 1.0, rtol=0, atol=0, err_msg=key)
    assert EFFECTS["fast_sweep"].identity(BEARING).sweep_changes()["dwell_s"] > 1e5
    assert not EFFECTS["attached_mass"]().sweep_changes()


# --- composition -----------------------------------------------------------------------------------


def assert_same_rotor(one: list[Effect], other: list[Effect], condition: Condition) -> None:
    """Response, what the sensors see, and forces: whatever order they were written down in."""
    models = [build_model(paper(), condition, effects) for effects in (one, other)]
    H, same = (node_receptance(model.system) for model in models)
    assert_allclose(same, H, rtol=0, atol=ROUND_OFF * np.abs(H).max(), err_msg=f"{one}, {other}")
    seen, also = (sensed(model.system) for model in models)
    assert_allclose(also, seen, rtol=0, atol=ROUND_OFF * np.abs(seen).max())
    forces = [sorted((f.law.name, f.coefficients, f.offset) for f in model.forces) for model in models]
    assert forces[0] == forces[1]
    unbalances = [sorted((u.moment, u.phase) for u in model.unbalances) for model in models]
    assert unbalances[0] == unbalances[1]


def exclude_each_other(one: Effect, other: Effect) -> bool:
    """Whether two effects cannot be true at once: both take the place of the bearings' linear stiffness."""
    in_place = {"bearing_clearance", "bearing_hertz"}
    return one.id in in_place and other.id in in_place | {"plane_anisotropy"}


@each_support
def test_the_order_of_two_effects_does_not_matter(condition):
    for one, other in combinations([EFFECTS[key]() for key in PLACED], 2):
        if not (exclude_each_other(one, other) or exclude_each_other(other, one)):
            assert_same_rotor([one, other], [other, one], condition)


@settings(max_examples=40)
@given(
    effects=st.lists(st.sampled_from(LINEAR), min_size=3, max_size=4, unique=True).flatmap(
        lambda keys: st.tuples(*map(drawn, keys))
    ),
    condition=conditions,
    shuffled=st.randoms(use_true_random=False),
)
def test_the_order_of_several_effects_does_not_matter(effects, condition, shuffled):
    other = list(effects)
    shuffled.shuffle(other)
    assert_same_rotor(list(effects), other, condition)
    assert lowest(paper_with(condition, *effects).C) >= -ROUND_OFF


def twice(key: str, **parameters: tuple[float, float, float]) -> pytest.param:  # type: ignore[valid-type]
    """Two of a kind, and the one that they are together."""
    parts = [EFFECTS[key](**{name: values[k] for name, values in parameters.items()}) for k in range(3)]
    return pytest.param(*parts, id=key)


@pytest.mark.parametrize(
    ("one", "other", "both"),
    [
        twice("attached_mass", mass=(0.1, 0.05, 0.15)),
        twice("exciter_suspension", stiffness=(1e4, 2e4, 3e4), damping=(1.0, 0.5, 1.5)),
        twice("disk_mass", change=(0.03, -0.01, 0.02)),
        twice("disk_inertia", factor=(0.5, 0.4, 0.9)),
        twice("hub_stiffening", factor=(1.2, 1.5, 1.8)),
        twice("shaft_modulus", factor=(1.1, 0.9, 0.99)),
        twice("axial_load", force=(5e3, -2e3, 3e3)),
        twice("bearing_tilt_stiffness", stiffness=(1e3, 2e3, 3e3)),
        twice("bearing_offset", offset=(0.003, -0.001, 0.002)),
        twice("plane_anisotropy", anisotropy=(0.1, 0.2, 0.3), angle=(0.4, 0.4, 0.4)),
        twice("viscoelastic_support", strength=(0.2, 0.3, 0.5), relaxation_time=(1e-3, 1e-3, 1e-3)),
        twice("sensor_mass", mass=(0.01, 0.02, 0.03)),
        twice("sensor_position", offset=(0.004, -0.001, 0.003)),
        twice("gyroscopic", factor=(0.5, 0.7, 1.2)),
    ],
)
def test_two_of_a_kind_add_up(one, other, both):
    systems = [paper_with(BEARING, *effects) for effects in ([both], [one, other], [one])]
    H, together, alone = (node_receptance(system, spin_speed=400.0) for system in systems)
    seen, summed, half = (sensed(system) for system in systems)
    assert_allclose(together, H, rtol=0, atol=ROUND_OFF * np.abs(H).max())
    assert_allclose(summed, seen, rtol=0, atol=ROUND_OFF * np.abs(seen).max())
    assert max(relative_difference(alone, H), relative_difference(half, seen)) > 1e-3


def test_two_rigid_supports_that_give_way_are_springs_in_series():
    series = [CompliantRigidSupport(stiffness=k) for k in (2e8, 3e8)]
    together = CompliantRigidSupport(stiffness=1.2e8)
    H, one = node_receptance(paper_with(RIGID, *series)), node_receptance(paper_with(RIGID, together))
    assert_allclose(H, one, rtol=0, atol=ROUND_OFF * np.abs(one).max())


@settings(max_examples=15)
@given(effects=st.tuples(drawn("plane_anisotropy"), drawn("plane_anisotropy"), drawn("bearing_asymmetry")))
def test_anisotropies_along_different_axes_stay_symmetric_and_commute(effects):
    assert_symmetric(paper_with(BEARING, *effects).K)
    for order in permutations(effects):
        assert_same_rotor(list(effects), list(order), BEARING)


@pytest.mark.parametrize("key", ["shaft_damping", "bearing_damping", "pedestal_flexibility"])
def test_what_is_put_in_place_of_a_value_is_put_there_once(key):
    with pytest.raises(ValueError, match=f"{key}.*twice"):
        paper_with(BEARING, EFFECTS[key](), EFFECTS[key]())


@pytest.mark.parametrize(
    "keys",
    [
        ("bearing_clearance", "bearing_hertz"),
        ("bearing_hertz", "bearing_hertz"),
        ("bearing_clearance", "plane_anisotropy"),
        ("plane_anisotropy", "bearing_hertz"),
    ],
    ids="+".join,
)
def test_two_answers_to_what_the_bearings_stiffness_is_are_refused(keys):
    with pytest.raises(ValueError, match=r"takes? the place of k_b"):
        paper_with(BEARING, *(EFFECTS[key]() for key in keys))


# --- places ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", IN_BEARINGS)
@few
@given(data=st.data(), condition=conditions.filter(lambda c: c.rigid_support))
def test_an_effect_of_the_bearings_changes_nothing_on_rigid_supports(key, data, condition):
    model = build_model(paper(), condition, [data.draw(drawn(key))])
    assert_allclose(node_receptance(model.system), node_receptance(paper_with(condition)), rtol=0, atol=0)
    assert not model.forces


@few
@given(effect=drawn("compliant_rigid_support"), condition=conditions.filter(lambda c: not c.rigid_support))
def test_rigid_supports_that_give_way_change_nothing_on_bearings(effect, condition):
    H, nominal = node_receptance(paper_with(condition, effect)), node_receptance(paper_with(condition))
    assert_allclose(H, nominal, rtol=0, atol=0)


@each_support
@pytest.mark.parametrize("key", NONLINEAR)
def test_a_force_law_leaves_the_linear_rotor_as_it_is(key, condition):
    model = build_model(paper(), condition, [EFFECTS[key]()])
    assert_allclose(node_receptance(model.system), node_receptance(paper_with(condition)), rtol=0, atol=0)


def where(force: LocalForce, system: LinearSystem) -> list[tuple[int, int]]:
    """Nodes and planes that a local force acts at."""
    nodes = [(node, plane) for node in range(1, 8) for plane in (1, 2)]
    return [place for place in nodes if np.any(force.patterns @ system.unit_vector(*place))]


@pytest.mark.parametrize("key", NONLINEAR)
def test_a_force_law_sits_at_its_joints_in_both_planes(key):
    model = build_model(paper(), BEARING, [EFFECTS[key]()])
    expected = [4] if key == "rub" else [1, 7]
    assert [where(force, model.system) for force in model.forces] == [[(n, 1), (n, 2)] for n in expected]


def test_a_force_law_on_a_pedestal_acts_on_what_lies_between_shaft_and_pedestal():
    model = build_model(paper(), BEARING, [EFFECTS["bearing_cubic"](), EFFECTS["pedestal_flexibility"]()])
    moving_along = np.ones(model.system.n)  # shaft and pedestals by the same amount
    moving_along[(model.system.free < paper().n) & (model.system.free % 4 >= 2)] = 0.0
    for force in model.forces:
        assert_allclose(force.patterns @ moving_along, 0.0, atol=0)
        assert np.abs(force.patterns).sum() == 4  # shaft and pedestal, y and z


# Effects whose start value moves f1 and f2 by a sign, or (0) leaves them where they are; the
# damping of mode 1 likewise. Mode 2 has a node at node 4.
SIGNS = {
    "attached_mass": (-1, 0, None),
    "exciter_suspension": (1, 1, 1),
    "disk_mass": (-1, -1, None),
    "disk_inertia": (-1, -1, None),
    "hub_stiffening": (1, 1, None),
    "shaft_modulus": (1, 1, None),
    "axial_load": (1, 1, None),
    "open_crack": (-1, -1, None),
    "shaft_damping": (0, 0, 1),
    "bearing_damping": (0, 0, 1),
    "bearing_tilt_stiffness": (1, 1, None),
    "pedestal_flexibility": (-1, -1, None),
    "bearing_asymmetry": (-1, -1, None),
    "bearing_offset": (1, 1, None),
    "compliant_rigid_support": (-1, -1, None),
    "viscoelastic_support": (1, 1, 1),
    "sensor_mass": (-1, -1, None),
    "measured_joint": (1, 0, 1),
}


@pytest.mark.parametrize("key", SIGNS)
def test_an_effect_moves_the_modes_the_way_it_should(key):
    condition = RIGID if key == "compliant_rigid_support" else BEARING
    nominal, changed = (damped_modes(paper_with(condition, *e).in_plane(1)) for e in ([], [EFFECTS[key]()]))
    shifts = changed.frequency_hz[:2] / nominal.frequency_hz[:2] - 1
    for shift, sign in zip(shifts, SIGNS[key][:2], strict=True):
        # damping moves |lambda| by its square
        assert shift * sign > 1e-4 if sign else abs(shift) < 1e-3, (key, shifts)
    if SIGNS[key][2]:
        assert changed.damping_ratio[0] > 1.01 * nominal.damping_ratio[0]


@pytest.mark.parametrize("key", PLACED)
def test_an_effect_is_felt_somewhere_at_its_start_value(key):
    """Each in the one way it has: response, response across the planes, spin, read-out, force, unbalance."""
    condition = RIGID if key == "compliant_rigid_support" else BEARING
    model, nominal = build_model(paper(), condition, [EFFECTS[key]()]), paper_with(condition)
    spin = 500.0 if key == "gyroscopic" else 0.0
    responses = (node_receptance(s, spin_speed=spin) for s in (model.system, nominal))
    felt = relative_difference(*responses), relative_difference(sensed(model.system), sensed(nominal))
    reach = max(EFFECTS[key]().gap * 2 if "gap" in EFFECTS[key].parameters() else 1e-5, 1e-5)  # type: ignore[attr-defined]
    pushed = any(f.law.memory or force_at(f, reach) > 1e-6 for f in model.forces)
    assert max(felt) > 0.01 or pushed or any(u.moment for u in model.unbalances)


@pytest.mark.parametrize(("spread", "parts"), [(0.0, 1), (0.8, SEAT_PARTS)])
def test_a_seat_is_stiff_until_its_parts_slip_and_loses_what_each_of_them_does(spread, parts):
    """Energy of a cycle of amplitude X: sum of 4 F_i (X - F_i / k_i) over the parts that slip [iwan1966]."""
    seat, X = BearingFriction(force=3.0, stiffness=1e6, spread=spread), 4e-6
    left = build_model(paper(), BEARING, [seat]).forces[:parts]
    assert len(build_model(paper(), BEARING, [seat]).forces) == 2 * parts
    x = X * np.sin(np.linspace(0, 4 * np.pi, 4 * 5000 + 1))
    pulls = np.zeros((parts, len(x)))
    for part, force in enumerate(left):
        for place in range(1, len(x)):
            step = SCALAR["jenkins"](x[place], x[place - 1], pulls[part, place - 1], *force.coefficients)
            pulls[part, place] = step[0]
    total = pulls.sum(axis=0)
    assert_allclose(total[1] / x[1], 1e6, rtol=1e-12)
    cycle = slice(2 * 5000, None)
    limits = 3.0 / parts * (1 + spread * np.linspace(-1, 1, parts) * (1 - 1 / parts))
    expected = np.sum(4 * limits * np.maximum(X - limits * parts / 1e6, 0))
    assert_allclose(limits.sum(), 3.0)
    assert_allclose(np.trapezoid(total[cycle], x[cycle]), expected, rtol=1e-3)
    assert 0 < np.sum(np.abs(pulls).max(axis=1) > limits * (1 - 1e-12)) <= parts


def test_a_force_across_an_anisotropic_bearings_axes_moves_the_other_plane():
    turned, along = (paper_with(BEARING, PlaneAnisotropy(angle=angle)) for angle in (0.35, 0.0))
    assert np.abs(sensed(turned)[:, 7:]).max() > 0.01 * np.abs(sensed(turned)).max()
    assert not sensed(along)[:, 7:].any()


@pytest.mark.parametrize("key", ["attached_mass", "rub", "unbalance", "sensor_mass", "sensor_position"])
def test_a_node_that_does_not_exist_is_refused(key):
    with pytest.raises(ValueError, match=r"node 8 does not exist: the rotor has nodes 1 to 7"):
        paper_with(BEARING, EFFECTS[key](**{"node": 8}))


@pytest.mark.parametrize("x", [-0.001, 0.4261])
def test_a_crack_beside_the_shaft_is_refused(x):
    with pytest.raises(ValueError, match=r"open_crack\.position must lie on the shaft, 0 to 0\.426 m"):
        paper_with(BEARING, OpenCrack(position=x))


def limits() -> list[tuple[str, str, float]]:
    """Every parameter with a value just beyond each of its physical limits, and with no number."""
    table = []
    for key, effect in EFFECTS.items():
        for name, role in effect.parameters().items():
            beyond = [role.minimum - 1e-9 - abs(role.minimum) * 1e-6] if role.minimum is not None else []
            beyond += [role.maximum * (1 + 1e-6)] if role.maximum is not None else []
            table += [(key, name, value) for value in (*beyond, math.nan, math.inf)]
    return table


@pytest.mark.parametrize(("key", "name", "value"), limits())
def test_a_value_that_is_not_physical_is_refused_by_name(key, name, value):
    with pytest.raises(ValueError, match=f"{key}\\.{name} must be"):
        EFFECTS[key](**{name: value})


def test_every_start_value_lies_in_its_prior_and_every_prior_within_the_physical_limits():
    for key, effect in EFFECTS.items():
        for name, role in effect.parameters().items():
            low, high = paper_scale().ends(role)
            assert low <= getattr(effect(), name) <= high, f"{key}.{name}"
            assert role.minimum is None or role.minimum <= low, f"{key}.{name}"
            assert role.maximum is None or high <= role.maximum, f"{key}.{name}"
            assert not role.log or low > 0, f"{key}.{name}"
