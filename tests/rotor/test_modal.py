"""Natural frequencies: analytic beams, orders of convergence, the paper, another code."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import eigh

from rigtwin.rotor.frequency.modal import damped_modes, elastic_frequencies_hz, natural_frequencies_hz
from rigtwin.rotor.frequency.whirl import campbell
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import ElementType, euler_bernoulli, linear_timoshenko, timoshenko
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import undamped_modes
from tests.rotor import rigs
from tests.tolerances import (
    CONVERGENCE_ORDER,
    EIGENVALUE_ROUND_OFF,
    LIGHT_DAMPING,
    NEARLY_MASSLESS,
    OTHER_CODE,
    ROUND_OFF,
    SIX_ELEMENTS,
    TABLE_1_ANSYS,
    TABLE_1_PROGRAM,
    TABLE_2_SHIFT,
)

SLENDER = rigs.pinned_beam(rigs.round_shaft(1.0, 0.01))
STUBBY = rigs.pinned_beam(rigs.round_shaft(0.4, 0.08))  # its shear error shows on coarse meshes already
RIG_1, RIG_2 = rigs.PAPER["table1"], rigs.PAPER["table2"]


def y_hz(system, n=2):
    return natural_frequencies_hz(system, plane=1)[:n]


def orders(beam: Rig, element: ElementType, exact: float, mode: int, meshes: tuple[int, ...]) -> np.ndarray:
    errors = [y_hz(rigs.held(beam, elements=n, element=element), mode)[-1] / exact - 1 for n in meshes]
    return np.log2(np.array(errors[:-1]) / errors[1:])


@pytest.mark.parametrize("mode", [2, 3])
def test_pinned_euler_bernoulli_beam_converges_with_fourth_order(mode):
    exact = rigs.pinned_euler_bernoulli_hz(rigs.section_of(SLENDER), SLENDER.length, mode)
    observed = orders(SLENDER, euler_bernoulli, exact, mode, (2, 4, 8))
    assert_allclose(observed, 4.0, atol=CONVERGENCE_ORDER)


@pytest.mark.parametrize("element", [timoshenko, linear_timoshenko], ids=lambda e: e.__name__)
@pytest.mark.parametrize("mode", [1, 2])
def test_pinned_timoshenko_beam_converges_with_second_order(element, mode):
    _, forward = rigs.pinned_timoshenko_whirl(rigs.section_of(STUBBY), STUBBY.length, mode)
    observed = orders(STUBBY, element, forward / (2 * math.pi), mode, (6, 12, 24))
    assert_allclose(observed, 2.0, atol=CONVERGENCE_ORDER)


@pytest.mark.parametrize("element", [timoshenko, euler_bernoulli])
def test_consistent_elements_approach_from_above(element):
    f = np.array([y_hz(rigs.paper_system(rigs.RIGID, elements=n, element=element)) for n in (1, 2, 4)])
    assert (np.diff(f, axis=0) < 0).all()


def test_shear_and_rotary_inertia_lower_the_frequencies():
    thick, thin = (y_hz(rigs.paper_system(rigs.RIGID, element=e)) for e in (timoshenko, euler_bernoulli))
    assert (thick < thin).all()


@pytest.mark.parametrize("k_b", [1e15, 1e7])
def test_six_elements_are_within_a_ten_thousandth_of_the_converged_mesh(k_b):
    six, converged = (y_hz(rigs.paper_system(rigs.paper_condition(k_b), elements=n)) for n in (1, 24))
    assert_allclose(six, converged, rtol=SIX_ELEMENTS)


@pytest.mark.parametrize("row", range(3), ids=lambda i: f"k_b={RIG_1['k_b'][i]:g}")
def test_table_1_program_columns(row):
    printed = [RIG_1["program_f1"][row], RIG_1["program_f2"][row]]
    computed = y_hz(rigs.paper_system(rigs.paper_condition(RIG_1["k_b"][row])))
    assert_allclose(computed, printed, rtol=TABLE_1_PROGRAM)


@pytest.mark.parametrize("row", range(3), ids=lambda i: f"k_b={RIG_1['k_b'][i]:g}")
def test_table_1_ansys_columns_are_the_linear_elements(row):
    printed = np.array([RIG_1["ansys_f1"][row], RIG_1["ansys_f2"][row]])
    condition = rigs.paper_condition(RIG_1["k_b"][row])
    assert_allclose(y_hz(rigs.paper_system(condition, element=linear_timoshenko)), printed, rtol=TABLE_1_ANSYS)
    cubic = y_hz(rigs.paper_system(condition))
    assert abs(cubic[1] / printed[1] - 1) > 2 * TABLE_1_ANSYS, "the cubic element must not pass for ANSYS'"


@pytest.mark.parametrize("row", range(12), ids=lambda i: f"k_b={RIG_2['k_b'][i]:g}")
def test_table_2_frequency_shifts(row):
    shift = y_hz(rigs.paper_system(rigs.RIGID)) - y_hz(rigs.paper_system(Condition(k_b=RIG_2["k_b"][row])))
    assert_allclose(shift, [RIG_2["df1_Hz"][row], RIG_2["df2_Hz"][row]], rtol=TABLE_2_SHIFT)


@pytest.fixture(scope="module")
def ross_structure():
    disks = [{"node": node, "inertia": True, **rigs.ROSS["disk"]} for node in (3, 5)]
    return assemble(Rig.model_validate(rigs.tables(disk=disks)), elements_between_nodes=8)


@pytest.mark.parametrize("row", range(4), ids=lambda i: f"k_b={rigs.ROSS['k_b_N_per_m'][i]:g}")
def test_four_lateral_modes_agree_with_ross(ross_structure, row):
    condition = rigs.paper_condition(rigs.ROSS["k_b_N_per_m"][row])
    computed = y_hz(build_system(ross_structure, condition), 4)
    assert_allclose(computed, rigs.ROSS["f_Hz"][row], rtol=OTHER_CODE)


def test_a_bearing_as_stiff_as_the_papers_tends_to_the_rigid_support():
    rigid = y_hz(rigs.paper_system(rigs.RIGID))
    shortfall = [1 - y_hz(rigs.paper_system(Condition(k_b=k))) / rigid for k in (1e9, 1e10)]
    assert_allclose(shortfall[0] / shortfall[1], 10, rtol=0.01)


def test_frequencies_rise_with_bearing_stiffness():
    f = np.array([y_hz(rigs.paper_system(Condition(k_b=k)), 4) for k in np.geomspace(1e4, 1e11, 15)])
    assert (np.diff(f, axis=0) > 0).all()


def test_both_planes_of_a_round_rotor_have_the_same_frequencies():
    system = rigs.paper_system(Condition(k_b=1e6))
    in_y, in_z = (natural_frequencies_hz(system, plane) for plane in (1, 2))
    assert_allclose(in_y, in_z, rtol=ROUND_OFF)
    assert_allclose(np.sort(np.concatenate([in_y, in_z])), natural_frequencies_hz(system), rtol=ROUND_OFF)


def test_a_mode_is_found_though_every_rig_node_is_at_rest():
    """A rig with nodes at its rigid bearings only: nothing to read out, but modes in between."""
    bearings = [{"node": node, "stiffness": "k_b"} for node in (1, 2)]
    beam = rigs.rig(nodes_m=[0.0, 1.0], segment=[rigs.round_shaft(1.0, 0.01)], support=bearings)
    with_middle_node = y_hz(rigs.held(SLENDER, elements=4), 3)
    assert_allclose(y_hz(rigs.held(beam, elements=8), 3), with_middle_node, rtol=EIGENVALUE_ROUND_OFF)


def test_a_plane_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="plane 3"):
        natural_frequencies_hz(rigs.paper_system(rigs.RIGID), plane=3)


@pytest.mark.parametrize("condition", [rigs.RIGID, Condition(k_b=1e6)], ids=["rigid", "bearing"])
def test_undamped_modes_are_mass_normalised_and_orthogonal(condition):
    system = rigs.paper_system(condition)
    modes = undamped_modes(system)
    assert_allclose(modes.Phi.T @ system.M @ modes.Phi, np.eye(system.n), rtol=0, atol=ROUND_OFF)
    stiffness = modes.Phi.T @ system.K @ modes.Phi
    assert_allclose(stiffness, np.diag(modes.omega**2), rtol=0, atol=ROUND_OFF * stiffness.max())


def test_each_undamped_mode_stays_in_one_plane_exactly():
    system = rigs.paper_system(Condition(k_b=1e6))
    Phi = undamped_modes(system).Phi
    moves_y, moves_z = (np.abs(system.read_out(plane) @ Phi).max(axis=0) > 0 for plane in (1, 2))
    assert not (moves_y & moves_z).any()


def test_light_damping_leaves_the_natural_frequencies_alone():
    system = rigs.paper_system(Condition(k_b=1e7, shaft_damping_ratio=0.001))
    damped = damped_modes(system).frequency_hz
    assert_allclose(damped, natural_frequencies_hz(system), rtol=LIGHT_DAMPING)


def test_campbell_lines_start_at_the_natural_frequencies():
    disks = [{"node": n, "inertia": True, **rigs.ROSS["disk"]} for n in (3, 5)]
    system = build_system(assemble(Rig.model_validate(rigs.tables(disk=disks))), Condition(shaft_damping_ratio=0.0))
    standing, spinning = campbell(system, np.array([0.0, 500.0]), n_modes=4).frequency_hz
    assert_allclose(standing, natural_frequencies_hz(system)[:4], rtol=EIGENVALUE_ROUND_OFF)
    assert spinning[0] < standing[0] < spinning[1], "whirl splits"


@pytest.mark.parametrize("plane", [None, 1])
def test_all_frequencies_of_a_rotor_that_is_held_are_elastic(plane):
    system = rigs.paper_system(rigs.RIGID)
    assert_array_equal(elastic_frequencies_hz(system, plane), natural_frequencies_hz(system, plane))


# A shaft that weighs 1e-7 of its disk's mass and less; heavier ones are felt.
WEIGHTLESS = (1e-3, 1e-6, 1e-12)


@pytest.mark.parametrize("density", WEIGHTLESS)
@pytest.mark.parametrize("clamped", [True, False])
def test_a_disk_on_a_weightless_shaft_has_the_modes_of_two_degrees_of_freedom(density, clamped):
    """Its lowest frequency is 1e-6 of the highest one and less: no rigid-body motion for that."""
    M, K = rigs.lumped_rotor_matrices(clamped=clamped)
    exact = np.sqrt(np.clip(eigh(K, M, eigvals_only=True), 0, None)) / (2 * math.pi)
    system = rigs.held(rigs.lumped_rotor(density, clamped=clamped), elements=4)
    found = natural_frequencies_hz(system, plane=1)
    assert_allclose(found[:2], exact if clamped else [0.0, exact[1]], rtol=NEARLY_MASSLESS)
    assert list(system.modes.elastic[:4]) == [clamped, clamped, True, True]
    assert found[2] > 1e4 * found[1], "all others belong to the shaft"


@pytest.mark.parametrize("elements", [1, 6, 50])
def test_a_rotor_that_swings_about_one_bearing_has_one_rigid_body_motion_in_each_plane(elements):
    rig = Rig.model_validate(rigs.tables(support=[{"node": 1, "stiffness": "k_b"}]))
    system = rigs.held(rig, elements=elements)
    modes = system.modes
    assert list(modes.elastic[:4]) == [False, False, True, True]
    assert_allclose(modes.Phi.T @ system.M @ modes.Phi, np.eye(system.n), atol=ROUND_OFF)
    low = modes.Phi[:, :20]
    scale = modes.omega[19] ** 2
    assert_allclose(low.T @ system.K @ low, np.diag(modes.omega[:20] ** 2), atol=EIGENVALUE_ROUND_OFF * scale)


def test_soft_springs_are_no_rigid_body_motion():
    """k_b a billionth of a bearing's: the rotor floats on two springs, f = sqrt(2 k_b / m)."""
    system = rigs.paper_system(Condition(k_b=1e-2))
    mass = system.M[system.plane == 1][:, system.plane == 1]
    up = (system.free % 4 == 0)[system.plane == 1].astype(float)
    bounce = math.sqrt(2e-2 / (up @ mass @ up)) / (2 * math.pi)
    found = elastic_frequencies_hz(system, plane=1)
    assert np.abs(found[:2] / bounce - 1).min() < 1e-3
