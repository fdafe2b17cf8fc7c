"""The C core against the Python rotor: matrices, motion, and what changes while it runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from rigtwin.fmu_src.native_sources import NATIVE
from rigtwin.fmu_src.rotor_variables import effects_in_fmu
from rigtwin.rotor.effects import (
    EFFECTS,
    AttachedMass,
    AxialLoad,
    BearingClearance,
    BearingDamping,
    BearingFriction,
    JointMicroslip,
    MeasuredJoint,
    PedestalFlexibility,
    Rub,
    ShaftDamping,
    ViscoelasticSupport,
)
from rigtwin.rotor.effects.nonlinear import JOINT_PARTS, SEAT_PARTS
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.force_laws import LAWS
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.time.simulator import RotorSimulator
from tests.fmu.native.core import Core, Rotor, compiled
from tests.fmu.native.new_effect import LINE_OF_C, DriveMass
from tests.rotor import rigs
from tests.rotor.journals import RPM, disk_in_oil

CONDITION = Condition(k_b=3.3e6, bearing_damping=17.0, shaft_damping_ratio=0.0013, excitation_node=3)
KNOWN = tuple(effect.id for effect in effects_in_fmu())
LINEAR = tuple(name for name in KNOWN if EFFECTS[name].family != "nonlinear")
COMBINATIONS = [(), *((name,) for name in LINEAR), ("unbalance", "gyroscopic", "plane_anisotropy"), LINEAR]
STRUCTURE = assemble(load_rig("nit-rourkela"))

# The paper's rotor has no joint.
NONLINEAR = tuple(sorted(name for name in set(KNOWN) - set(LINEAR) if EFFECTS[name].location != "joints"))

# With numbers that do nothing at their start values.
BENT = (
    AttachedMass(half_width=0.02),
    BearingClearance(preload=20.0),
    BearingFriction(spread=0.8),
    ViscoelasticSupport(spread=0.6),
    MeasuredJoint(stiffness=-2e4, branch_mass=0.1),
)

# Of a channel's peak, over a simulation.
SAME_MOTION, SAME_NONLINEAR_MOTION = 1e-9, 1e-6

# One that can tilt, and one that can slide.
JOINTS = [
    {"node": 4, "tilt_stiffness_Nm_per_rad": 2e4, "tilt_damping_Nms_per_rad": 0.3},
    {"x_m": 0.25, "stiffness_N_per_m": 1e7, "damping_Ns_per_m": 20.0},
]

# So strong a force [N] keeps joints with a gap in contact; a weak one leaves them to chance, digit by digit.
STRONG = 20.0


@pytest.fixture(scope="module")
def core(tmp_path_factory) -> Core:
    return Core(compiled(tmp_path_factory.mktemp("core")), STRUCTURE)


def effects_of(names):
    return [EFFECTS[name]() for name in names]


@pytest.mark.parametrize("rigid", [False, True], ids=["bearings", "rigid"])
@pytest.mark.parametrize("names", COMBINATIONS, ids="+".join)
def test_the_matrices_are_those_of_the_python_rotor_to_the_last_digit(core, names, rigid):
    assert_same_matrices(core, replace(CONDITION, rigid_support=rigid), effects_of(names))


@pytest.mark.parametrize("beside", [(), ("viscoelastic_support", "bearing_offset")], ids="+".join)
@pytest.mark.parametrize("compliance", [0.2, 5e-324])
def test_blocks_under_pedestals_are_those_of_the_python_rotor(core, beside, compliance):
    assert_same_matrices(core, CONDITION, [PedestalFlexibility(block_compliance=compliance), *effects_of(beside)])


def test_branches_of_several_relaxation_times_are_those_of_the_python_rotor(core):
    assert_same_matrices(core, CONDITION, [ViscoelasticSupport(spread=0.6), PedestalFlexibility()])


def assert_same_matrices(core, condition, effects, structure=STRUCTURE):
    expected = build_system(structure, condition, effects)
    found = core.system(core.design(condition, effects))
    assert np.array_equal(found["free"], expected.free)
    assert np.array_equal(found["plane"], expected.plane)
    for name, matrix in (("C", expected.C_support), *((k, getattr(expected, k)) for k in ("M", "K", "G", "K_shaft"))):
        assert np.abs(found[name] - matrix).max() <= 4e-16 * np.abs(matrix).max(), name


@pytest.mark.parametrize(
    "effects", [(), ("open_crack", "shaft_modulus"), ("axial_load", "sensor_position")], ids="+".join
)
def test_a_rotor_with_joints_is_that_of_python(core, effects):
    """Matrices, and then how it moves, with a joint at a node and one between two."""
    structure = assemble(rigs.rig(**rigs.tables(name="jointed", joint=JOINTS)))
    jointed = Core(core.compiled, structure)
    assert_same_matrices(jointed, CONDITION, effects_of(effects), structure)
    python, c = (
        RotorSimulator(structure, CONDITION, effects_of(effects)),
        Rotor(jointed, CONDITION, effects_of(effects)),
    )
    steps = np.full(60, 7e-4)
    assert_same_motion(moved(c, steps), moved(python, steps))


@pytest.mark.parametrize("effects", [(), ("attached_mass", "gyroscopic", "unbalance"), ("rub",)], ids="+".join)
@pytest.mark.parametrize("rpm", [2000.0, 5000.0, 10500.0])
def test_a_rotor_on_tables_is_that_of_python(core, rpm, effects):
    """Matrices, and then how it moves on a stiffness that is not symmetric, also where it grows."""
    structure = assemble(disk_in_oil())
    oiled, effects = Core(core.compiled, structure), effects_of(effects)
    condition = replace(CONDITION, spin_speed=rpm * RPM)
    assert_same_matrices(oiled, condition, effects, structure)
    python, c = RotorSimulator(structure, condition, effects), Rotor(oiled, condition, effects)
    steps = np.full(60, 7e-4)
    share = SAME_NONLINEAR_MOTION if any(effect.family == "nonlinear" for effect in effects) else SAME_MOTION
    assert_same_motion(moved(c, steps, amplitude=STRONG), moved(python, steps, amplitude=STRONG), share)


def test_the_spin_speed_of_a_rotor_on_tables_changes_while_it_moves(core):
    structure = assemble(disk_in_oil())
    oiled, parts = Core(core.compiled, structure), []
    first, *others = (replace(CONDITION, spin_speed=rpm * RPM) for rpm in (2000.0, 3000.0, 7000.0, 11000.0))
    rotors = Rotor(oiled, first), RotorSimulator(structure, first)
    for rotor in rotors:
        motion = [moved(rotor, [1e-3] * 20)]
        for condition in others:
            rotor.configure(condition)
            motion.append(moved(rotor, [1e-3] * 20))
        parts.append(np.concatenate(motion))
    assert_same_motion(*parts)
    kept = rotors[0].snapshot()
    for rpm in (0.0, 1999.0, 11002.0, -3000.0):
        for rotor, words in zip(
            rotors, ("spin_speed lies outside the table of a support", "does not hold"), strict=True
        ):
            with pytest.raises(ValueError, match=words):
                rotor.configure(replace(CONDITION, spin_speed=rpm * RPM))
    assert np.array_equal(rotors[0].snapshot(), kept)


@pytest.mark.parametrize(
    "names", [(), ("open_crack", "hub_stiffening"), ("bearing_offset", "sensor_position")], ids="+".join
)
def test_a_conical_shaft_is_that_of_python(core, names):
    """Matrices, and then how it moves: a crack, a hub and what sits beside a node change elements of a cone."""
    segment = {"length_m": 0.426, "diameter_left_m": 0.022, "diameter_right_m": 0.012, "bore_m": 0.004} | rigs.STEEL
    structure = assemble(rigs.rig(**rigs.tables(name="conical", segment=[segment])))
    conical, effects = Core(core.compiled, structure), effects_of(names)
    assert_same_matrices(conical, CONDITION, effects, structure)
    steps = np.full(60, 7e-4)
    rotors = Rotor(conical, CONDITION, effects), RotorSimulator(structure, CONDITION, effects)
    assert_same_motion(*(moved(rotor, steps) for rotor in rotors))


def test_joints_that_slip_move_as_those_of_python(core):
    """The laws of the joint that can tilt, the other one having none; slipping, and open beyond the second contact."""
    structure = assemble(rigs.rig(**rigs.tables(name="jointed", joint=JOINTS)))
    jointed, effects = Core(core.compiled, structure), [JointMicroslip(angle=1e-3, exponent=1.3, contact=0.2, gap=1e-5)]
    expected = build_model(structure, CONDITION, effects).forces
    found = jointed.system(jointed.design(CONDITION, effects))["forces"]
    assert len(found) == len(expected) == 2 + JOINT_PARTS
    for (number, coefficients, _, patterns), force in zip(found, expected, strict=True):
        assert LAWS[number] is force.law
        assert_allclose(coefficients[: len(force.coefficients)], force.coefficients, rtol=1e-13)
        assert_allclose(patterns, force.patterns, rtol=1e-15)
    python, c = RotorSimulator(structure, CONDITION, effects), Rotor(jointed, CONDITION, effects)
    steps = np.full(40, 7e-4)
    assert_same_motion(moved(c, steps), moved(python, steps), SAME_NONLINEAR_MOTION)


def test_a_new_linear_effect_takes_one_class_and_one_line_of_c(tmp_path, monkeypatch):
    monkeypatch.setitem(EFFECTS, DriveMass.id, DriveMass)
    written = (NATIVE / "rotor.c").read_text(encoding="utf-8")
    place = "    add_mass(a, d->sensor_mass.node"
    assert written.count(place) == 1
    larger = Core(compiled(tmp_path, {"rotor.c": written.replace(place, LINE_OF_C + place)}), STRUCTURE)
    for effects in ([DriveMass()], []):
        assert_same_matrices(larger, CONDITION, effects)


def test_values_that_have_no_say_are_not_in_the_design(core):
    """Otherwise setting one while the rotor runs would build its equations once more."""
    parameters = [effect.full_name(name) for effect in effects_in_fmu() for name in effect.roles()]
    nominal = bytes(core.design(CONDITION, []))
    assert bytes(core.design(CONDITION, [], dict.fromkeys(parameters, 7))) == nominal
    damped = [ShaftDamping(), BearingDamping()]
    undamped = replace(CONDITION, bearing_damping=0.0, shaft_damping_ratio=0.0)
    assert bytes(core.design(undamped, damped)) == bytes(core.design(CONDITION, damped)) != nominal


@pytest.mark.parametrize(
    "beside", [(), ("bearing_asymmetry",), ("pedestal_flexibility", "bearing_offset")], ids="+".join
)
@pytest.mark.parametrize("name", NONLINEAR)
def test_the_local_forces_are_those_of_the_python_rotor(core, name, beside):
    for law in (EFFECTS[name](), *(effect for effect in BENT if effect.id == name)):
        effects = [*effects_of(beside), law]
        expected = build_model(STRUCTURE, CONDITION, effects).forces
        found = core.system(core.design(CONDITION, effects))["forces"]
        parts = SEAT_PARTS if getattr(law, "spread", 0) else 1
        assert len(found) == len(expected) == (1 if name == "rub" else 2 * parts)
        for (number, coefficients, offset, patterns), force in zip(found, expected, strict=True):
            assert LAWS[number] is force.law
            assert_allclose(coefficients[: len(force.coefficients)], force.coefficients, rtol=1e-15)
            assert_allclose(offset, force.offset, rtol=1e-15)
            assert_allclose(patterns, force.patterns, rtol=1e-15)


def moved(rotor, steps, force=0.5, amplitude=2.0, frequency=61.3):
    """(n_steps, 2 n_nodes) accelerations after each step."""
    found = []
    rotor.drive(force=force, force_amplitude=amplitude, force_frequency=frequency)
    for step in steps:
        rotor.advance(rotor.time, step)
        found.append(rotor.accelerations())
    return np.array(found)


def assert_same_motion(found, expected, share=SAME_MOTION):
    peak = np.abs(expected).max(axis=0)
    assert peak.max() > 0
    assert (np.abs(found - expected).max(axis=0) <= share * peak).all()


@pytest.mark.parametrize("density", [1e-3, 1e-9])
@pytest.mark.parametrize("clamped", [True, False])
def test_a_disk_on_a_weightless_shaft_answers_as_two_degrees_of_freedom(core, density, clamped):
    """Settled at 10 Hz, in C and in Python: no mode of the disk is taken for a rigid-body motion."""
    zeta, frequency, h = 0.1, 10.0, 2e-3
    structure = assemble(rigs.lumped_rotor(density, clamped=clamped), elements_between_nodes=4)
    condition = Condition(rigid_support=True, shaft_damping_ratio=zeta, excitation_node=2)
    M, K = rigs.lumped_rotor_matrices(clamped=clamped)
    squares, Phi = eigh(K, M)
    omega = 2 * np.pi * frequency
    modes = Phi[0] ** 2 / (squares - omega**2 + 2j * zeta * np.sqrt(np.clip(squares, 0, None)) * omega)
    exact = abs(omega**2 * modes.sum())
    for rotor in (Rotor(Core(core.compiled, structure), condition), RotorSimulator(structure, condition)):
        settled = moved(rotor, [h] * 4000, 0.0, 1.0, frequency)[-50:, 1]  # one period, node 2
        assert settled.max() == pytest.approx(exact, rel=2e-3)  # of 50 samples one is near the peak
        assert settled.min() == pytest.approx(-exact, rel=2e-3)


@pytest.mark.parametrize("rigid", [False, True], ids=["bearings", "rigid"])
@pytest.mark.parametrize("names", COMBINATIONS[:-1], ids="+".join)
def test_the_rotor_moves_as_the_python_rotor_does(core, names, rigid):
    spin = 100.0 if {"unbalance", "gyroscopic"} & set(names) else 0.0
    condition, effects = replace(CONDITION, rigid_support=rigid, spin_speed=spin), effects_of(names)
    steps = 1e-3 * (1 + np.arange(500) % 2)
    found = moved(Rotor(core, condition, effects), steps)
    assert_same_motion(found, moved(RotorSimulator(STRUCTURE, condition, effects), steps))


@pytest.mark.parametrize(
    "names",
    [
        *((name,) for name in NONLINEAR),
        ("rub", "unbalance"),
        ("bearing_friction", "pedestal_flexibility", "bearing_offset"),
        ("bearing_clearance", "rub", "bearing_friction", "pedestal_flexibility", "unbalance"),
    ],
    ids="+".join,
)
def test_the_rotor_with_local_forces_moves_as_the_python_rotor_does(core, names):
    condition = replace(CONDITION, spin_speed=100.0 if "unbalance" in names else 0.0)
    effects = effects_of(names)
    steps = 1e-3 * (1 + np.arange(200) % 2)
    found = moved(Rotor(core, condition, effects), steps, amplitude=STRONG)
    expected = moved(RotorSimulator(STRUCTURE, condition, effects), steps, amplitude=STRONG)
    assert_same_motion(found, expected, SAME_NONLINEAR_MOTION)
    still = moved(Rotor(core, condition), steps, amplitude=STRONG)
    assert np.abs(found - still).max() > 1e-3 * np.abs(found).max()


@pytest.mark.parametrize("effect", BENT, ids=lambda effect: effect.id)
def test_bearings_whose_laws_are_bent_move_as_the_python_rotor_does(core, effect):
    found, expected, plain = (
        moved(rotor, [1e-3] * 200, amplitude=STRONG)
        for rotor in (
            Rotor(core, CONDITION, [effect]),
            RotorSimulator(STRUCTURE, CONDITION, [effect]),
            Rotor(core, CONDITION, [type(effect)()]),
        )
    )
    assert_same_motion(found, expected, SAME_NONLINEAR_MOTION)
    assert np.abs(found - plain).max() > 1e-3 * np.abs(found).max()


@pytest.mark.parametrize("after", [("bearing_friction", "rub"), ("bearing_cubic",), ()], ids="+".join)
def test_local_forces_come_and_go_while_the_rotor_moves(core, after):
    parts = []
    for rotor in (Rotor(core, CONDITION), RotorSimulator(STRUCTURE, CONDITION)):
        motion = [moved(rotor, [1e-3] * 50, amplitude=STRONG)]
        for names in (("bearing_friction",), after):
            rotor.configure(replace(CONDITION, k_b=5e6), effects_of(names))
            motion.append(moved(rotor, [1e-3] * 100, amplitude=STRONG))
        parts.append(np.concatenate(motion))
    assert_same_motion(*parts, SAME_NONLINEAR_MOTION)


def test_stiffness_and_effects_change_while_the_rotor_moves(core):
    rotors = Rotor(core, CONDITION), RotorSimulator(STRUCTURE, CONDITION)
    parts = []
    for rotor in rotors:
        first = moved(rotor, [1e-3] * 100)
        rotor.configure(replace(CONDITION, k_b=5e6), [AxialLoad(force=3000.0)])
        parts.append(np.concatenate([first, moved(rotor, [1e-3] * 200, frequency=80.0)]))
    assert_same_motion(*parts)


def test_an_undamped_rotor_driven_at_resonance_grows_as_the_python_rotor_does(core):
    still = Condition(k_b=1e6, shaft_damping_ratio=0.0)
    resonance = float(build_system(STRUCTURE, still).modes.omega[0]) / (2 * np.pi)
    steps = [0.01] * 60
    found, expected = (
        moved(rotor, steps, force=0.0, frequency=resonance)
        for rotor in (Rotor(core, still), RotorSimulator(STRUCTURE, still))
    )
    assert np.abs(expected[-1]).max() > 5 * np.abs(expected[5]).max()
    assert_same_motion(found, expected)


@pytest.mark.parametrize("names", [("pedestal_flexibility",), ("bearing_clearance", "bearing_friction")], ids="+".join)
def test_a_snapshot_replays_to_the_last_bit(core, names):
    rotor = Rotor(core, CONDITION, effects_of(names))
    moved(rotor, [1e-3] * 50)
    kept = rotor.snapshot()
    first = moved(rotor, [7e-4] * 50)
    rotor.restore(kept)
    assert np.array_equal(moved(rotor, [7e-4] * 50), first)


def test_two_rotors_do_not_know_each_other(core):
    alone = moved(Rotor(core, CONDITION), [1e-3] * 50)
    one, other = Rotor(core, CONDITION), Rotor(core, replace(CONDITION, k_b=1e6), [PedestalFlexibility()])
    found = []
    for _ in range(50):
        found.append(moved(one, [1e-3])[0])
        moved(other, [3e-4], frequency=333.0)
    assert np.array_equal(np.array(found), alone)


def test_what_is_impossible_is_refused_in_a_sentence_and_changes_nothing(core):
    rotor = Rotor(core, CONDITION)
    moved(rotor, [1e-3] * 20)
    kept = rotor.snapshot()
    for condition, effects, words in (
        (CONDITION, [AxialLoad(force=-1e7)], "buckles"),
        (CONDITION, [PedestalFlexibility()], "degrees of freedom"),
        (CONDITION, [Rub(), PedestalFlexibility()], "degrees of freedom"),
        (replace(CONDITION, rigid_support=True), [], "degrees of freedom"),
    ):
        with pytest.raises(ValueError, match=words):
            rotor.configure(condition, effects)
    for time, step in ((0.5, 1e-3), (rotor.time, -1e-3), (rotor.time, float("nan")), (rotor.time, 1e-15)):
        with pytest.raises(ValueError, match="step"):
            rotor.advance(time, step)
    assert np.array_equal(rotor.snapshot(), kept)
    assert_same_motion(moved(rotor, [1e-3] * 20), moved(RotorSimulator(STRUCTURE, CONDITION), [1e-3] * 40)[20:])


def test_a_force_beyond_all_bounds_says_so_and_changes_nothing(core):
    rotor = Rotor(core, CONDITION)
    moved(rotor, [1e-3] * 20, amplitude=STRONG)
    design = core.design(CONDITION, effects_of(["bearing_cubic"]))
    design.bearing_cubic.stiffness = 1e300
    rotor.use(design)
    kept = rotor.snapshot()
    with pytest.raises(ValueError, match=r"cubic in [yz] finds no balance .* check the effect's parameters"):
        rotor.advance(rotor.time, 1e-3)
    assert np.array_equal(rotor.snapshot(), kept)
