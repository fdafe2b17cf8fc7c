"""Beam elements: what every element must do, whatever its section."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rigtwin.rotor.model.elements import (
    Section,
    cowper_shear_factor,
    euler_bernoulli,
    linear_timoshenko,
    shape_functions,
    timoshenko,
)
from tests.tolerances import ROUND_OFF

ELEMENTS = [timoshenko, euler_bernoulli, linear_timoshenko]
each_element = pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.__name__)


def size(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(math.log(low), math.log(high)).map(math.exp)


sections = st.builds(
    Section,
    area=size(1e-5, 1e-1),
    second_moment=size(1e-11, 1e-4),
    density=size(500, 20000),
    youngs_modulus=size(1e9, 5e11),
    shear_modulus=size(4e8, 2e11),
    shear_factor=st.floats(0.3, 1.0),
)
lengths = size(1e-3, 2.0)
places = st.floats(0.0, 1.0)
shear_parameters = st.one_of(st.just(0.0), size(1e-6, 1e3))


def unit_free(matrix: np.ndarray, length: float) -> np.ndarray:
    """The matrix with rotations measured as end deflections, so that all entries share one unit."""
    scale = np.array([1.0, 1 / length, 1.0, 1 / length])
    return scale[:, None] * matrix * scale


@each_element
@given(section=sections, length=lengths)
def test_stiffness_and_mass_are_symmetric(element, section, length):
    matrices = element(section, length)
    for matrix in (matrices.stiffness, matrices.mass, matrices.tilt_inertia):
        assert_allclose(matrix, matrix.T, rtol=0, atol=1e-15 * np.abs(matrix).max())


@each_element
@given(section=sections, length=lengths)
def test_mass_is_positive_and_stiffness_has_no_negative_eigenvalue(element, section, length):
    matrices = element(section, length)
    assert np.linalg.eigvalsh(unit_free(matrices.mass, length)).min() > 0
    for matrix in (matrices.stiffness, matrices.tilt_inertia):
        eigenvalues = np.linalg.eigvalsh(unit_free(matrix, length))
        assert eigenvalues.min() >= -ROUND_OFF * eigenvalues.max()


@each_element
@given(section=sections, length=lengths)
def test_rigid_body_motion_strains_nothing(element, section, length):
    stiffness = element(section, length).stiffness
    for motion in ([1, 0, 1, 0], [0, 1, length, 1]):
        forces = np.abs(stiffness) @ np.abs(motion)  # what cancels
        assert_allclose(stiffness @ motion, 0, atol=ROUND_OFF * forces.max())


@each_element
@given(section=sections, length=lengths)
def test_pure_bending_stores_the_energy_of_a_constant_curvature(element, section, length):
    """Ends turned by -1 and +1: curvature 2/L, no shear, twice the energy 4 EI/L for every element."""
    ends_turned = np.array([0, -1, 0, 1])
    energy = ends_turned @ element(section, length).stiffness @ ends_turned
    shear = section.shear_factor * section.shear_modulus * section.area * length  # the linear element's, cancels
    exact = 4 * section.bending_stiffness / length
    assert_allclose(energy, exact, rtol=ROUND_OFF, atol=ROUND_OFF * shear * (element is linear_timoshenko))


@given(section=sections, length=lengths)
def test_shear_flexibility_softens_an_antisymmetric_bend(section, length):
    """Ends turned alike: 12 EI/L / (1 + Phi)."""
    ends_turned = np.array([0, 1, 0, 1])
    energies = [ends_turned @ e(section, length).stiffness @ ends_turned for e in (euler_bernoulli, timoshenko)]
    exact = 12 * section.bending_stiffness / length
    softened = exact / (1 + section.shear_parameter(length))
    assert_allclose(energies, [exact, softened], rtol=ROUND_OFF, atol=ROUND_OFF * exact)


@each_element
@given(section=sections, length=lengths)
def test_translation_carries_the_whole_mass(element, section, length):
    translation = np.array([1, 0, 1, 0])
    mass = translation @ element(section, length).mass @ translation
    assert_allclose(mass, section.density * section.area * length, rtol=ROUND_OFF)


@pytest.mark.parametrize("element", [timoshenko, linear_timoshenko], ids=lambda e: e.__name__)
@given(section=sections, length=lengths)
def test_rotation_carries_the_rotary_inertia(element, section, length):
    rotation = np.array([0, 1, length, 1])
    tilt = rotation @ element(section, length).tilt_inertia @ rotation
    assert_allclose(tilt, section.density * section.second_moment * length, rtol=ROUND_OFF)


@given(xi=places, length=lengths, phi=shear_parameters)
def test_shape_functions_are_a_partition_of_unity(xi, length, phi):
    deflection, rotation = shape_functions(xi, length, phi)
    assert_allclose(deflection @ [1, 0, 1, 0], 1, rtol=ROUND_OFF)
    assert_allclose(rotation @ [1, 0, 1, 0], 0, atol=ROUND_OFF / length)


@given(xi=places, length=lengths, phi=shear_parameters)
def test_shape_functions_carry_a_rigid_rotation(xi, length, phi):
    deflection, rotation = shape_functions(xi, length, phi)
    assert_allclose(deflection @ [0, 1, length, 1], xi * length, atol=ROUND_OFF * length)
    assert_allclose(rotation @ [0, 1, length, 1], 1, rtol=ROUND_OFF)


@given(length=lengths, phi=shear_parameters)
def test_shape_functions_meet_their_nodes(length, phi):
    ends = np.concatenate([shape_functions(xi, length, phi) for xi in (0.0, 1.0)])
    assert_allclose(ends, np.eye(4), rtol=0, atol=ROUND_OFF * max(1.0, length, 1 / length))


@given(section=sections, length=lengths)
def test_stiffness_is_the_strain_energy_of_the_shape_functions(section, length):
    """K = int EI s' s' + kGA (w' - s)(w' - s) dx, with derivatives by differences of the cubics."""
    phi, h = section.shear_parameter(length), 1e-3
    points, weights = np.polynomial.legendre.leggauss(4)
    shear_stiffness = section.shear_factor * section.shear_modulus * section.area
    energy = np.zeros((4, 4))
    for xi, weight in zip((1 + points) / 2, weights * length / 2, strict=True):
        # Central differences of step h are exact for the quadratic rotation and, extrapolated, for the cubic.
        slope, curvature = np.zeros(4), np.zeros(4)
        for factor, step in ((4 / 3, h), (-1 / 3, 2 * h)):
            ahead, behind = shape_functions(xi + step, length, phi), shape_functions(xi - step, length, phi)
            slope += factor * (ahead[0] - behind[0]) / (2 * step * length)
            curvature += factor * (ahead[1] - behind[1]) / (2 * step * length)
        shear = slope - shape_functions(xi, length, phi)[1]
        energy += weight * section.bending_stiffness * np.outer(curvature, curvature)
        energy += weight * shear_stiffness * np.outer(shear, shear)
    stiffness = unit_free(timoshenko(section, length).stiffness, length)
    # Differences of step 1e-3 keep nine digits of a strain; a stiff shear multiplies what they lose.
    lost = 1e-9 * (1 + 12 / phi * 1e-9) * np.abs(stiffness).max()
    assert_allclose(unit_free(energy, length), stiffness, rtol=0, atol=lost)


@given(section=sections, length=lengths)
def test_a_shear_stiff_timoshenko_element_is_euler_bernoulli(section, length):
    stiff = Section(section.area, section.second_moment, section.density, section.youngs_modulus, 1e30, 1.0)
    assert_allclose(timoshenko(stiff, length).stiffness, euler_bernoulli(section, length).stiffness, rtol=ROUND_OFF)


@given(section=sections, length=lengths, force=st.floats(-1, 1), moment=st.floats(-1, 1))
def test_one_timoshenko_element_is_an_exact_cantilever(section, length, force, moment):
    """w = F L^3/3EI + F L/kGA + M L^2/2EI, s = F L^2/2EI + M L/EI at the loaded end."""
    EI, L = section.bending_stiffness, length
    shear_stiffness = section.shear_factor * section.shear_modulus * section.area
    tip = np.linalg.solve(timoshenko(section, length).stiffness[2:, 2:], [force, moment])
    exact = [
        force * (L**3 / (3 * EI) + L / shear_stiffness) + moment * L**2 / (2 * EI),
        force * L**2 / (2 * EI) + moment * L / EI,
    ]
    scale = np.array([L**3 / (3 * EI) + L / shear_stiffness + L**2 / (2 * EI), L**2 / (2 * EI) + L / EI])
    assert_allclose(tip / scale, exact / scale, rtol=0, atol=1e-8)


def test_cowper_factor_of_solid_bar_and_thin_tube():
    assert_allclose(cowper_shear_factor(0.3), 6 * 1.3 / (7 + 6 * 0.3), rtol=1e-15)
    # Cowper's separate formula for a thin-walled round tube.
    assert_allclose(cowper_shear_factor(0.3, bore_ratio=1.0), 2 * 1.3 / (4 + 3 * 0.3), rtol=1e-15)
