"""Effects of shaft, disks and bearings against formulas, and against rotors that are built that way."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.rotor.effects import (
    AttachedMass,
    AxialLoad,
    BearingAsymmetry,
    BearingDamping,
    BearingOffset,
    BearingTiltStiffness,
    CompliantRigidSupport,
    DiskInertia,
    DiskMass,
    Effect,
    ExciterSuspension,
    Gyroscopic,
    HubStiffening,
    MeasuredJoint,
    OpenCrack,
    PedestalFlexibility,
    PlaneAnisotropy,
    ShaftDamping,
    ShaftModulus,
    ViscoelasticSupport,
)
from rigtwin.rotor.frequency.frequency_response import ComplexArray, dynamic_stiffness
from rigtwin.rotor.frequency.modal import damped_modes, natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model import rotor_model as model
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli, timoshenko
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import LinearSystem
from tests.rotor import rigs
from tests.rotor.effect_cases import BEARING, OMEGA, RIGID, node_receptance, paper, paper_with, sensed
from tests.tolerances import NEARLY_CLAMPED, NEARLY_MASSLESS, ROUND_OFF, hermite_error

UNDAMPED = Condition(k_b=2e6, shaft_damping_ratio=0.0)
# From rest to far above the pedestals' resonance.
WIDE = 2 * np.pi * np.array([0.0, 1.0, 30.0, 100.0, 300.0, 503.0, 2000.0, 1e4])


def flexibility(system: LinearSystem, plane: int = 1) -> FloatArray:
    """(n_nodes, n_nodes) static deflections under unit forces at the nodes [m/N]."""
    nodes = np.array([system.unit_vector(node, plane) for node in range(1, system.structure.n_nodes + 1)])
    return nodes @ np.linalg.solve(system.K, nodes.T)


def bending_stiffness(beam: Rig) -> float:
    """E I of the first segment [N m^2]."""
    return rigs.section_of(beam).bending_stiffness


# --- what a bearing stands on ----------------------------------------------------------------------


def bearing_stiffness(*effects: Effect, condition: Condition = UNDAMPED, node: int = 1) -> ComplexArray:
    """Dynamic stiffness of a bearing: what is left of the rotor's when the shaft's is taken away.

    Degrees of freedom beyond the shaft's are condensed, at every frequency for itself.
    """
    system = paper_with(condition, *effects)
    D = dynamic_stiffness(system, WIDE)
    shaft, own = slice(0, paper().n), slice(paper().n, system.n)
    condensed = D[:, shaft, shaft]
    if system.n > paper().n:
        condensed = condensed - D[:, shaft, own] @ np.linalg.solve(D[:, own, own], D[:, own, shaft])
    place = paper().dof(node, 1)
    return (condensed - (paper().K - WIDE[:, None, None] ** 2 * paper().M))[:, place, place]


def assert_is_the_bearing(found: ComplexArray, formula: ComplexArray) -> None:
    """Round-off of the shaft's own stiffness and inertia is in the difference."""
    scale = np.abs(formula) + paper().K[0, 0] + WIDE**2 * paper().M[0, 0]
    assert (np.abs(found - formula) <= ROUND_OFF * scale).all()


def test_a_pedestal_is_a_spring_in_series_at_rest():
    k_b, k_p = UNDAMPED.k_b, 7e6
    found = bearing_stiffness(PedestalFlexibility(stiffness=k_p, mass=2.0))[0]
    assert_allclose(found, k_b * k_p / (k_b + k_p), rtol=ROUND_OFF)


@settings(max_examples=20)
@given(k_p=st.floats(1e6, 5e7), m_p=st.floats(0.3, 8.0), c_p=st.floats(0.0, 1e3))
def test_a_pedestal_has_the_dynamic_stiffness_of_its_formula(k_p, m_p, c_p):
    k_b, base = UNDAMPED.k_b, k_p - WIDE**2 * m_p + 1j * WIDE * c_p
    effect = PedestalFlexibility(stiffness=k_p, mass=m_p, damping=c_p)
    assert_is_the_bearing(bearing_stiffness(effect), k_b * base / (k_b + base))


def test_below_its_pole_a_pedestal_softens_the_bearing_and_far_above_it_stands_still():
    k_b, k_p = UNDAMPED.k_b, 1e7
    D = bearing_stiffness(PedestalFlexibility(stiffness=k_p, mass=1.0, damping=0.0)).real
    below = D[:5]  # to 300 Hz, the pedestal's own resonance is at 503 Hz
    assert (np.diff(below) < 0).all()
    assert (below < k_b * k_p / (k_b + k_p) * (1 + ROUND_OFF)).all()
    assert_allclose(D[-1], k_b, rtol=1e-3)


@settings(max_examples=20)
@given(g=st.floats(0.1, 2.0), tau=st.floats(1e-4, 1e-2))
def test_a_viscoelastic_support_has_the_dynamic_stiffness_of_its_formula(g, tau):
    branch = 1j * WIDE * tau / (1 + 1j * WIDE * tau)
    found = bearing_stiffness(ViscoelasticSupport(strength=g, relaxation_time=tau))
    assert_is_the_bearing(found, UNDAMPED.k_b * (1 + g * branch))


def test_a_seat_of_several_relaxation_times_has_the_dynamic_stiffness_of_all_of_them():
    times = {1e-4: 1 / 9, 10**-3.5: 2 / 9, 1e-3: 3 / 9, 10**-2.5: 2 / 9, 1e-2: 1 / 9}
    branch = sum(share * 1j * WIDE * tau / (1 + 1j * WIDE * tau) for tau, share in times.items())
    found = bearing_stiffness(ViscoelasticSupport(strength=0.7, relaxation_time=1e-3, spread=1.0))
    assert_is_the_bearing(found, UNDAMPED.k_b * (1 + 0.7 * branch))


def test_a_pedestal_on_a_block_has_the_dynamic_stiffness_of_both():
    k_p, m_p, c_p, beta, mu = 1e7, 1.5, 80.0, 0.2, 6.0
    block, leg = k_p / beta - WIDE**2 * mu * m_p, k_p + 1j * WIDE * c_p
    base = leg * block / (leg + block) - WIDE**2 * m_p
    found = bearing_stiffness(
        PedestalFlexibility(stiffness=k_p, mass=m_p, damping=c_p, block_compliance=beta, block_mass=mu)
    )
    assert_is_the_bearing(found, UNDAMPED.k_b * base / (UNDAMPED.k_b + base))


@pytest.mark.parametrize("compliance", [5e-324, 1e-6])
def test_a_block_on_next_to_no_compliance_is_the_ground(compliance):
    found, plain = (
        build_system(paper(), UNDAMPED, [PedestalFlexibility(block_compliance=beta)]) for beta in (compliance, 0.0)
    )
    assert_array_equal(found.M, plain.M)
    assert_array_equal(found.K, plain.K)


def test_seat_damper_unequal_bearings_and_pedestal_combine_as_their_formulas_do():
    k_p, m_p, c_p, g, tau, c_b, a = 1e7, 1.5, 80.0, 0.5, 1e-3, 120.0, 0.2
    effects = (
        PedestalFlexibility(stiffness=k_p, mass=m_p, damping=c_p),
        ViscoelasticSupport(strength=g, relaxation_time=tau),
        BearingDamping(damping=c_b),
        BearingAsymmetry(asymmetry=a),
    )
    base = k_p - WIDE**2 * m_p + 1j * WIDE * c_p
    for node, side in ((1, 1 + a), (7, 1 - a)):
        seat = UNDAMPED.k_b * side * (1 + g * 1j * WIDE * tau / (1 + 1j * WIDE * tau)) + 1j * WIDE * c_b
        assert_is_the_bearing(bearing_stiffness(*effects, node=node), seat * base / (seat + base))


def test_the_condensed_stiffness_of_the_bearings_is_the_one_the_shaft_feels():
    effects = (
        PedestalFlexibility(stiffness=1e7, mass=1.5, damping=80.0, block_compliance=0.2, block_mass=6.0),
        ViscoelasticSupport(strength=0.5, relaxation_time=1e-3),
        BearingDamping(damping=120.0),
        BearingAsymmetry(asymmetry=0.2),
        AxialLoad(force=2000.0),
        AttachedMass(mass=0.1, node=1),
    )
    for plane in (1, 2):
        D = model.bearing_stiffness(paper(), UNDAMPED, effects, WIDE, plane)
        for bearing, node in enumerate((1, 7)):
            assert_is_the_bearing(D[:, bearing], bearing_stiffness(*effects[:4], node=node))
    rigid = Condition(rigid_support=True)
    assert model.bearing_stiffness(paper(), rigid, effects, WIDE, 1).shape == (len(WIDE), 0)


def test_bearing_damping_is_the_conditions():
    damped = Condition(k_b=2e6, bearing_damping=130.0)
    assert_allclose(paper_with(BEARING, BearingDamping(damping=130.0), ShaftDamping(damping_ratio=0.001)).C,
                    paper_with(damped).C, rtol=0, atol=0)  # fmt: skip


def test_a_rigid_support_that_gives_way_is_an_undamped_bearing():
    H = node_receptance(paper_with(RIGID, CompliantRigidSupport(stiffness=3e7)))
    bearing = Condition(k_b=3e7, bearing_damping=0.0, shaft_damping_ratio=RIGID.shaft_damping_ratio)
    assert_allclose(H, node_receptance(paper_with(bearing)), rtol=0, atol=0)


@settings(max_examples=20)
@given(a=st.floats(-0.5, 0.5))
def test_a_force_at_an_unequal_bearing_deflects_that_bearing_alone(a):
    F = flexibility(paper_with(UNDAMPED, BearingAsymmetry(asymmetry=a)))
    k_b, scale = UNDAMPED.k_b, np.abs(F).max()
    assert_allclose(F[[0, 6], [0, 6]], [1 / (k_b * (1 + a)), 1 / (k_b * (1 - a))], rtol=0, atol=ROUND_OFF * scale)
    assert_allclose(F[0, 6], 0.0, atol=ROUND_OFF * scale)


# --- anisotropy ------------------------------------------------------------------------------------


@settings(max_examples=10)
@given(a=st.floats(0.1, 0.5))
def test_along_its_axes_an_anisotropic_bearing_gives_two_rotors_that_do_not_meet(a):
    H = node_receptance(paper_with(BEARING, PlaneAnisotropy(anisotropy=a, angle=0.0)))
    for plane, factor in ((slice(0, 7), 1 + a / 2), (slice(7, 14), 1 - a / 2)):
        alone = Condition(k_b=BEARING.k_b * factor, bearing_damping=20.0, shaft_damping_ratio=0.003)
        expected = node_receptance(paper_with(alone))[:, plane, plane]
        assert_allclose(H[:, plane, plane], expected, rtol=0, atol=ROUND_OFF * np.abs(H).max())
    assert not H[:, :7, 7:].any()


@settings(max_examples=10)
@given(a=st.floats(0.1, 0.5), angle=st.floats(-3.2, 3.2))
def test_turning_an_anisotropic_bearing_turns_the_response_with_it(a, angle):
    along, turned = (node_receptance(paper_with(BEARING, PlaneAnisotropy(anisotropy=a, angle=x))) for x in (0.0, angle))
    c, s = math.cos(angle), math.sin(angle)
    turn = np.kron([[c, -s], [s, c]], np.eye(7))  # (y, z) of every node
    assert_allclose(turned, turn @ along @ turn.T, rtol=0, atol=ROUND_OFF * np.abs(along).max())


# --- where the bearings act, and how they hold the slope -------------------------------------------


def supported_at(*extra_nodes: float, stub: dict[str, Any] | None = None) -> Rig:
    """The paper's rotor with nodes at the places where the bearings are; ``stub`` lengthens the shaft both ways."""
    tables = load_rig("nit-rourkela").model_dump(exclude_unset=True)
    if stub:
        tables["segment"] = [stub, *tables["segment"], stub]
        tables["nodes_m"] = [0.0, *(x + stub["length_m"] for x in tables["nodes_m"])]
        tables["nodes_m"].append(tables["nodes_m"][-1] + stub["length_m"])
        for disk in tables["disk"]:
            disk["node"] += 1
        places = [1, 9]
    else:
        tables["nodes_m"] = sorted([*tables["nodes_m"], *extra_nodes])
        for disk in tables["disk"]:
            disk["node"] += 1
        places = [2, 8]
    tables["support"] = [{"node": node, "stiffness": "k_b"} for node in places]
    return Rig.model_validate(tables)


@settings(max_examples=20)
@given(
    offset=st.floats(0.002, 0.009),
    k_b=st.floats(6, 9).map(lambda exponent: 10**exponent),
    anisotropy=st.floats(0.1, 0.5),
    elements=st.sampled_from([1, 4]),
)
def test_bearings_towards_the_middle_hold_the_shaft_as_if_it_had_nodes_there(offset, k_b, anisotropy, elements):
    """Exact at rest: a bearing between two nodes has the shaft's local flexibility in series."""
    condition, across = Condition(k_b=k_b, shaft_damping_ratio=0.0), PlaneAnisotropy(anisotropy=anisotropy, angle=0.0)
    there = build_system(assemble(supported_at(offset, 0.426 - offset)), condition, [across])
    here = paper_with(condition, BearingOffset(offset=offset), across, elements=elements)
    common = [0, 2, 3, 4, 5, 6, 8]
    for plane in (1, 2):
        F, expected = flexibility(here, plane), flexibility(there, plane)[np.ix_(common, common)]
        assert_allclose(F, expected, rtol=0, atol=ROUND_OFF * np.abs(expected).max())


def test_bearings_beyond_the_ends_hold_a_shaft_that_goes_on_rigidly():
    """Rigid stubs stand for it: a million times stiffer than the shaft."""
    offset = 0.006
    stub = rigs.round_shaft(offset, 0.02, rigs.LIGHT_STEEL | {"youngs_modulus_Pa": 207e9 * 1e6})
    there = flexibility(build_system(assemble(supported_at(stub=stub)), UNDAMPED))[1:8, 1:8]
    F = flexibility(paper_with(UNDAMPED, BearingOffset(offset=-offset)))
    assert_allclose(F, there, rtol=0, atol=1e-6 * np.abs(there).max())


def test_a_bearing_that_holds_the_slope_rigidly_cannot_act_beside_a_node():
    clamped = [{"node": n, "stiffness": "k_b", "tilt_stiffness_Nm_per_rad": "rigid"} for n in (1, 7)]
    structure = assemble(Rig.model_validate(rigs.tables(support=clamped)))
    with pytest.raises(ValueError, match="tilt rigidly, and can do so at a node only"):
        build_system(structure, BEARING, [BearingOffset(offset=0.002)])


@settings(max_examples=20)
@given(k_theta=st.floats(2e2, 2e4))
def test_tilt_stiffness_takes_its_share_of_a_pinned_beams_bending(k_theta):
    """Force in the middle: end moments P L / 8 over 1 + 2 E I / (k_theta L)."""
    beam = rigs.pinned_beam(rigs.round_shaft(0.4, 0.02))
    EI, L, k_b = bending_stiffness(beam), 0.4, 1e7
    effect = BearingTiltStiffness(stiffness=k_theta)
    system = build_system(assemble(beam, element=euler_bernoulli), Condition(k_b=k_b), [effect])
    moment = L / 8 / (1 + 2 * EI / (k_theta * L))
    expected = 1 / (2 * k_b) + L**3 / (48 * EI) - moment * L**2 / (8 * EI)
    assert_allclose(flexibility(system)[1, 1], expected, rtol=ROUND_OFF)


def test_a_stiff_tilt_spring_clamps_the_shafts_ends():
    clamped = [{"node": n, "stiffness": "k_b", "tilt_stiffness_Nm_per_rad": "rigid"} for n in (1, 7)]
    limit = build_system(assemble(Rig.model_validate(rigs.tables(support=clamped))), BEARING)
    stiff = paper_with(BEARING, BearingTiltStiffness(stiffness=1e9))
    assert_allclose(natural_frequencies_hz(stiff, 1)[:3], natural_frequencies_hz(limit, 1)[:3], rtol=NEARLY_CLAMPED)


# --- shaft -----------------------------------------------------------------------------------------

SLENDER = rigs.round_shaft(1.0, 0.01)


def buckling_load(beam: Rig) -> float:
    """pi^2 E I / L^2 of a pinned beam [N]."""
    return math.pi**2 * bending_stiffness(beam) / beam.length**2


def slender_beam(share: float, elements: int = 8) -> LinearSystem:
    """A pinned Euler-Bernoulli beam under a share of its buckling load, tension positive."""
    beam = rigs.pinned_beam(SLENDER)
    structure = assemble(beam, element=euler_bernoulli, elements_between_nodes=elements)
    effects = [AxialLoad(force=share * buckling_load(beam))]
    return build_system(structure, rigs.RIGID, effects)


@pytest.mark.parametrize("share", [-0.99, -0.5, 0.1, 1.0, 10.0])
def test_axial_load_raises_a_pinned_beams_frequencies_with_the_root_of_one_plus_its_share(share):
    """f_n(P) / f_n(0) = sqrt(1 + P / (n^2 P_cr))."""
    mode = np.arange(1, 4)
    ratio = natural_frequencies_hz(slender_beam(share), 1)[:3] / natural_frequencies_hz(slender_beam(0.0), 1)[:3]
    near_buckling = 1 / (1 + min(share, 0.0))
    tolerance = near_buckling * hermite_error(3, 16)
    assert_allclose(ratio, np.sqrt(1 + share / mode**2), rtol=tolerance)


@pytest.mark.parametrize(("elements", "beyond"), [(1, 1.01), (8, 1.0001), (32, 1.0001)])
def test_beyond_its_buckling_load_a_beam_is_refused_on_any_mesh(elements, beyond):
    """Two elements buckle 0.75 % late."""
    assert natural_frequencies_hz(slender_beam(-0.9999, elements), 1)[0] > 0
    with pytest.raises(ValueError, match=r"buckles.*axial compression"):
        natural_frequencies_hz(slender_beam(-beyond, elements))


@pytest.mark.parametrize("elements", [1, 8, 24])
def test_a_shaft_that_swings_freely_does_not_buckle(elements):
    """One bearing only: the stiffness of the swing is zero, give or take round-off."""
    tables = rigs.tables(support=[{"node": 1, "stiffness": "k_b"}])
    structure = assemble(Rig.model_validate(tables), elements_between_nodes=elements)
    for condition in (RIGID, Condition(k_b=1e6), Condition(k_b=1e12)):
        f = natural_frequencies_hz(build_system(structure, condition), 1)
        assert f[0] < 0.01 * f[1]


def test_axial_load_of_the_papers_rotor_shifts_its_first_mode_by_half_its_share():
    """Delta f / f = P / 2 P_cr: the paper's first mode is close to a half sine."""
    P_cr = buckling_load(load_rig("nit-rourkela"))
    f = [natural_frequencies_hz(paper_with(RIGID, AxialLoad(force=P)), 1)[0] for P in (-2000.0, 0.0, 2000.0)]
    assert_allclose((f[2] - f[0]) / (2 * f[1]), 2000.0 / (2 * P_cr), rtol=0.02)


@settings(max_examples=10)
@given(factor=st.floats(0.9, 1.1))
def test_the_modulus_moves_every_frequency_on_rigid_supports_by_its_root(factor):
    f, nominal = (natural_frequencies_hz(paper_with(RIGID, *e)) for e in ([ShaftModulus(factor=factor)], []))
    assert_allclose(f, nominal * math.sqrt(factor), rtol=ROUND_OFF)


def test_the_shafts_damping_is_the_ratio_of_every_mode_on_rigid_supports():
    modes = damped_modes(paper_with(RIGID, ShaftDamping(damping_ratio=0.012)))
    assert_allclose(modes.damping_ratio[:12], 0.012, rtol=1e-7)
    assert_allclose(modes.frequency_hz[:12], damped_modes(paper_with(RIGID)).frequency_hz[:12], rtol=1e-7)


def moments(x_c: float, at: FloatArray, L: float) -> FloatArray:
    """Bending moment of a simply supported beam at x_c under a unit force at each place."""
    return np.where(x_c <= at, (1 - at / L) * x_c, at / L * (L - x_c))


positions = st.one_of(st.floats(0.0, 0.426), st.sampled_from([0.0, 0.119, 0.213, 0.3, 0.426]))


@pytest.mark.parametrize("element", [euler_bernoulli, timoshenko])
@settings(max_examples=40)
@given(x_c=positions, lost=st.floats(0.05, 0.6), condition=st.sampled_from([RIGID, UNDAMPED]))
def test_a_crack_adds_its_hinge_to_the_flexibility_wherever_it_is(element, x_c, lost, condition):
    """By unit loads F_ij grows by c M_i(x_c) M_j(x_c), c = 0.8 d r / (E I (1 - r)), on supports of any stiffness."""
    structure = assemble(load_rig("nit-rourkela"), element=element)
    sound, cracked = (
        flexibility(build_system(structure, condition, effects))
        for effects in ([], [OpenCrack(reduction=lost, position=x_c)])
    )
    rig = load_rig("nit-rourkela")
    compliance = 0.8 * 0.02 / bending_stiffness(rig) * lost / (1 - lost)
    M = moments(x_c, np.array(rig.nodes_m), rig.length)
    assert_allclose(cracked, sound + compliance * np.outer(M, M), rtol=0, atol=ROUND_OFF * sound.max())


def test_a_crack_that_takes_nearly_all_the_stiffness_leaves_a_hinge():
    """A pinned beam with a hinge in its middle is a mechanism: what is left is the crack's spring alone."""
    beam = rigs.pinned_beam(rigs.round_shaft(0.4, 0.02))
    system = build_system(assemble(beam), rigs.RIGID, [OpenCrack(reduction=0.99, position=0.2)])
    sound = flexibility(build_system(assemble(beam), rigs.RIGID))[1, 1]
    compliance = 0.8 * 0.02 / bending_stiffness(beam) * 99
    assert_allclose(flexibility(system)[1, 1], sound + compliance * (0.4 / 4) ** 2, rtol=ROUND_OFF)


def stepped(factor: float) -> Rig:
    """The paper's rotor with a shaft that is so much stiffer in bending, not in shear, within its disks."""
    rig = load_rig("nit-rourkela")
    section = rigs.section_of(rig)
    material = {"youngs_modulus_Pa": section.youngs_modulus, "density_kg_per_m3": section.density, "poisson": 0.3}

    def segment(length: float, stiffening: float) -> dict[str, float]:
        return material | {
            "length_m": length,
            "area_m2": section.area,
            "second_moment_y_m4": stiffening * section.second_moment,
            "shear_factor": section.shear_factor,
        }

    borders = np.array([0.0, 0.110, 0.128, 0.298, 0.316, 0.426])
    factors = [1.0, factor, 1.0, factor, 1.0]
    segments = [segment(length, f) for length, f in zip(np.diff(borders), factors, strict=True)]
    return Rig.model_validate(rigs.tables(segment=segments))


@pytest.mark.parametrize("elements", [1, 3])
@settings(max_examples=10)
@given(factor=st.floats(1.0, 2.5), condition=st.sampled_from([RIGID, UNDAMPED]))
def test_hubs_deflect_as_a_stepped_shaft(elements, factor, condition):
    """Exact under forces at the nodes: the step need not be at an element's border."""
    expected = flexibility(build_system(assemble(stepped(factor)), condition))
    F = flexibility(paper_with(condition, HubStiffening(factor=factor), elements=elements))
    assert_allclose(F, expected, rtol=0, atol=ROUND_OFF * np.abs(expected).max())


# --- masses and disks ------------------------------------------------------------------------------


def test_an_attached_mass_is_a_lumped_mass_of_the_rig():
    lumped = assemble(Rig.model_validate(rigs.tables(mass=[{"node": 3, "mass_kg": 0.2}])))
    H = node_receptance(paper_with(BEARING, AttachedMass(mass=0.2, node=3)))
    assert_allclose(H, node_receptance(build_system(lumped, BEARING)), rtol=0, atol=ROUND_OFF * np.abs(H).max())


@pytest.mark.parametrize("node", [0, 5])
@pytest.mark.parametrize("plane", [1, 2])
def test_a_measured_joint_adds_its_dynamic_stiffness_at_its_node_or_the_exciters(node, plane):
    k, m, c, m_r, f_r, zeta, ground = -2e4, 0.04, 3.0, 0.2, 130.0, 0.04, 0.7
    joint = MeasuredJoint(k, m, c, node, m_r, f_r, zeta, ground)
    condition = replace(UNDAMPED, excitation_node=3)
    system = build_system(paper(), condition, [joint])
    own = system.n - 2 + plane - 1  # of the branch
    D = dynamic_stiffness(system, WIDE)
    place = int(np.flatnonzero(system.free == paper().dof(node or 3, plane))[0])
    found = D[:, place, place] - D[:, place, own] * D[:, own, place] / D[:, own, own]
    plain = dynamic_stiffness(build_system(paper(), condition), WIDE)[:, place, place]
    w_r, s = 2 * np.pi * f_r, 1j * WIDE
    spring, body = m_r * w_r**2 + s * 2 * zeta * w_r * m_r, s * 2 * ground * w_r * m_r + s**2 * m_r
    Z = k + s**2 * m + s * c + spring * body / (spring + body)
    assert_allclose(joint.dynamic_stiffness(WIDE), Z, rtol=ROUND_OFF)
    assert (np.abs(found - plain - Z) <= ROUND_OFF * (np.abs(plain) + np.abs(Z))).all()


def test_a_measured_joint_of_a_mass_or_a_spring_is_that_mass_or_spring():
    node = BEARING.excitation_node
    for joint, twin in (
        (MeasuredJoint(0.0, 0.2, 0.0, node), AttachedMass(mass=0.2, node=node)),
        (MeasuredJoint(5e4, 0.0, 7.0, 0), ExciterSuspension(stiffness=5e4, damping=7.0)),
    ):
        found, expected = (node_receptance(paper_with(BEARING, each).in_plane(1)) for each in (joint, twin))
        assert_allclose(found, expected, rtol=0, atol=ROUND_OFF * np.abs(expected).max())


def test_a_joint_that_pulls_harder_than_the_rotor_holds_is_refused():
    with pytest.raises(ValueError, match="buckles"):
        _ = paper_with(BEARING, MeasuredJoint(stiffness=-1e8)).modes


def test_a_mass_in_the_middle_of_a_light_beam_swings_on_its_stiffness():
    beam = rigs.pinned_beam(rigs.round_shaft(0.4, 0.02, rigs.LIGHT_STEEL))
    structure = assemble(beam, element=euler_bernoulli)
    f = natural_frequencies_hz(build_system(structure, rigs.RIGID, [AttachedMass(mass=0.5, node=2)]))
    expected = math.sqrt(48 * bending_stiffness(beam) / (0.5 * 0.4**3)) / (2 * math.pi)
    assert_allclose(f[:2], expected, rtol=NEARLY_MASSLESS)


@settings(max_examples=10)
@given(k=st.floats(3e3, 5e5), c=st.floats(0.0, 20.0), node=st.integers(2, 6), plane=st.sampled_from([1, 2]))
def test_the_exciters_suspension_is_a_spring_to_ground_along_the_force(k, c, node, plane):
    """H_jd / (1 + (k + i omega c) H_dd); exact where the shaft's damping does not follow the modes, that is at zero."""
    condition = Condition(k_b=2e6, bearing_damping=20.0, shaft_damping_ratio=0.0,
                          excitation_node=node, excitation_plane=plane)  # fmt: skip
    H, held = (node_receptance(paper_with(condition, *e)) for e in ([], [ExciterSuspension(stiffness=k, damping=c)]))
    d = node - 1 + 7 * (plane - 1)
    expected = H[:, :, d] / (1 + (k + 1j * OMEGA * c) * H[:, d, d])[:, None]
    assert_allclose(held[:, :, d], expected, rtol=0, atol=ROUND_OFF * np.abs(H).max())
    other = slice(7, 14) if plane == 1 else slice(0, 7)
    assert_allclose(held[:, other, other], H[:, other, other], rtol=0, atol=ROUND_OFF * np.abs(H).max())


def light_rotor() -> Rig:
    """The paper's disks on a shaft without weight."""
    return Rig.model_validate(rigs.tables(segment=[rigs.round_shaft(0.426, 0.02, rigs.LIGHT_STEEL)]))


@settings(max_examples=10)
@given(change=st.floats(-0.08, 0.08))
def test_heavier_disks_on_a_light_shaft_swing_slower_by_the_root(change):
    f, nominal = (
        natural_frequencies_hz(build_system(assemble(light_rotor()), rigs.RIGID, e), 1)[:2]
        for e in ([DiskMass(change=change)], [])
    )
    assert_allclose(f, nominal / math.sqrt(1 + change), rtol=NEARLY_MASSLESS)


def with_inertia() -> Rig:
    """The paper's rotor with the moments of inertia that its nominal model leaves out."""
    return Rig.model_validate(rigs.tables(disk=[d | {"inertia": True} for d in rigs.tables()["disk"]]))


@pytest.mark.parametrize("condition", [RIGID, BEARING], ids=["rigid", "bearing"])
def test_both_inertias_make_the_disks_solid(condition):
    solid = build_system(assemble(with_inertia()), condition)
    effects = paper_with(condition, DiskInertia(factor=1.0), Gyroscopic(factor=1.0))
    H = node_receptance(solid, spin_speed=800.0)
    assert_allclose(node_receptance(effects, spin_speed=800.0), H, rtol=0, atol=ROUND_OFF * np.abs(H).max())


def test_the_inertias_added_are_those_of_a_solid_cylinder():
    m, D, t = load_rig("nit-rourkela").disk[0].mass, 0.124, 0.018
    tilt = paper().stations[2] * 4 + 2
    changed = paper_with(BEARING, DiskInertia(factor=0.6), Gyroscopic(factor=0.5))
    assert_allclose(changed.M[tilt, tilt] - paper().M[tilt, tilt], 0.6 * m / 12 * (0.75 * D**2 + t**2), rtol=1e-9)
    assert_allclose(changed.G[tilt, tilt + 1] - paper().G[tilt, tilt + 1], 0.5 * m * D**2 / 8, rtol=1e-9)


@pytest.mark.parametrize("spin", [0.0, 200.0, 2000.0])
def test_a_disk_in_the_middle_of_a_light_beam_whirls_as_its_inertias_say(spin):
    """I_d omega^2 -+ I_p Omega omega - 12 E I / L = 0 for the tilt, backward and forward."""
    tables = rigs.pinned_beam(rigs.round_shaft(0.4, 0.02, rigs.LIGHT_STEEL)).model_dump(exclude_unset=True)
    disk = {"node": 2, "diameter_m": 0.124, "thickness_m": 0.018, "density_kg_per_m3": 7840.0}
    rig = Rig.model_validate(tables | {"disk": [disk]})
    structure = assemble(rig, element=euler_bernoulli)
    undamped = Condition(rigid_support=True, shaft_damping_ratio=0.0)
    system = build_system(structure, undamped, [DiskInertia(factor=1.0), Gyroscopic(factor=1.0)])
    I_d, I_p = rig.disk[0].own_diametral_inertia, rig.disk[0].own_polar_inertia
    stiffness, half = 12 * bending_stiffness(rig) / 0.4, I_p * spin / (2 * I_d)
    expected = math.hypot(half, math.sqrt(stiffness / I_d)) + np.array([-half, half])
    whirl = np.sort(np.abs(damped_modes(system, spin).eigenvalue.imag))
    tilting = whirl[[np.argmin(np.abs(whirl - w)) for w in expected]]
    assert_allclose(tilting, expected, rtol=NEARLY_MASSLESS)


def test_what_reads_a_force_reads_the_same_force_with_an_effect_elsewhere():
    """Effects in one plane alone leave the other: a suspension along z is not felt in y."""
    condition = Condition(k_b=2e6, excitation_plane=2)
    H, nominal = (sensed(paper_with(condition, *e), plane=1) for e in ([ExciterSuspension()], []))
    assert_allclose(H, nominal, rtol=0, atol=ROUND_OFF * np.abs(nominal).max())
