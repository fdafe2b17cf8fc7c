"""The shaft's damping operator: zeta on rigid supports, zeta times the shaft's strain share on bearings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import LinearSystem, shaft_damping, undamped_modes
from tests.rotor import rigs
from tests.tolerances import EIGENVALUE_ROUND_OFF, LIGHT_DAMPING, ROUND_OFF

stiffnesses = st.floats(4, 11).map(lambda exponent: 10**exponent)


def bearing_share(system: LinearSystem, k_b: float) -> np.ndarray:
    """(n_modes,) share of each mode's strain energy in the bearings: k_b times its squared deflections there."""
    modes = undamped_modes(system)
    at_bearings = [system.unit_vector(node, plane) @ modes.Phi for node in (1, 7) for plane in (1, 2)]
    return k_b * (np.array(at_bearings) ** 2).sum(axis=0) / modes.omega**2


def modal_damping_ratio(system: LinearSystem) -> np.ndarray:
    """(n_modes,) diagonal of Phi' C Phi over 2 omega."""
    modes = undamped_modes(system)
    return np.einsum("im,ij,jm->m", modes.Phi, system.C, modes.Phi) / (2 * modes.omega)


@pytest.mark.parametrize("zeta", [0.001, 0.02, 0.2])
@pytest.mark.parametrize("elements", [1, 4])
def test_every_mode_on_rigid_supports_has_the_shafts_damping_ratio(zeta, elements):
    system = rigs.paper_system(Condition(rigid_support=True, shaft_damping_ratio=zeta), elements=elements)
    assert_allclose(damped_modes(system).damping_ratio[:12], zeta, rtol=EIGENVALUE_ROUND_OFF * elements**2)


@settings(max_examples=25)
@given(k_b=stiffnesses, zeta=st.floats(1e-4, 0.2))
def test_a_mode_on_bearings_is_damped_by_the_shafts_share_of_its_strain_energy(k_b, zeta):
    system = rigs.paper_system(Condition(k_b=k_b, shaft_damping_ratio=zeta))
    expected = zeta * (1 - bearing_share(system, k_b))
    assert_allclose(modal_damping_ratio(system), expected, rtol=0, atol=ROUND_OFF * zeta * 100)


def test_the_damped_modes_have_that_ratio_too():
    system = rigs.paper_system(Condition(k_b=1e6))
    expected = 0.001 * (1 - bearing_share(system, 1e6))
    assert_allclose(damped_modes(system).damping_ratio[:8], expected[:8], rtol=LIGHT_DAMPING)


def test_soft_bearings_leave_the_bounce_mode_undamped():
    system = rigs.paper_system(Condition(k_b=1e4))
    assert modal_damping_ratio(system)[0] < 0.02 * 0.001


@settings(max_examples=25)
@given(k_b=stiffnesses)
def test_stiffer_bearings_give_the_first_mode_more_of_the_shafts_damping(k_b):
    soft, stiff = (modal_damping_ratio(rigs.paper_system(Condition(k_b=k)))[0] for k in (k_b, 1.5 * k_b))
    assert soft < stiff < 0.001 * (1 + ROUND_OFF)


@settings(max_examples=25)
@given(k_b=stiffnesses, bearing_damping=st.floats(0, 1e3))
def test_the_damping_matrix_is_symmetric_and_never_feeds_energy(k_b, bearing_damping):
    C = rigs.paper_system(Condition(k_b=k_b, bearing_damping=bearing_damping)).C
    assert_allclose(C, C.T, rtol=0, atol=ROUND_OFF * np.abs(C).max())
    eigenvalues = np.linalg.eigvalsh(C)
    assert eigenvalues.min() >= -ROUND_OFF * eigenvalues.max()


def test_the_operator_is_linear_in_the_damping_ratio():
    one, three = (rigs.paper_system(Condition(k_b=1e7, shaft_damping_ratio=z)).C for z in (0.001, 0.003))
    assert_allclose(three, 3 * one, rtol=0, atol=ROUND_OFF * np.abs(one).max())


def test_a_bearing_damper_acts_on_the_bearings_deflection_alone():
    condition = Condition(k_b=1e6, bearing_damping=20.0, shaft_damping_ratio=0.0)
    system = rigs.paper_system(condition)
    at_bearings = sum(np.outer(v, v) for v in (system.unit_vector(n, p) for n in (1, 7) for p in (1, 2)))
    assert_allclose(system.C, 20.0 * at_bearings, rtol=1e-15)


def test_a_rigid_support_makes_the_bearing_damper_inert():
    C = [rigs.paper_system(Condition(rigid_support=True, bearing_damping=c)).C for c in (0.0, 500.0)]
    assert_allclose(C[0], C[1], rtol=0, atol=0)


def test_a_rigid_body_mode_is_not_damped_by_the_shaft():
    """One bearing only: the rotor swings about it freely."""
    tables = rigs.tables(support=[{"node": 1, "stiffness": "k_b"}])
    system = build_system(
        rigs.assemble(rigs.Rig.model_validate(tables)), Condition(rigid_support=True, shaft_damping_ratio=0.01)
    )
    swing = np.zeros(len(system.structure.M))
    swing[0::4], swing[3::4] = system.structure.x, 1.0
    motion = swing[system.free]
    assert_allclose(system.K @ motion, 0, atol=ROUND_OFF * np.abs(system.K).max())
    forces = np.abs(shaft_damping(system)) @ np.abs(motion)
    assert_allclose(shaft_damping(system) @ motion, 0, atol=1e-6 * forces.max())


@pytest.mark.parametrize(
    "wrong", [{"k_b": 0.0}, {"k_b": np.nan}, {"bearing_damping": -1.0}, {"shaft_damping_ratio": np.inf}]
)
def test_a_condition_that_is_not_physical_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Condition(**wrong)
