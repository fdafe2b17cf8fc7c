"""Force laws as they are printed: up to date, differentiated right, the same in Python, numpy and C."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rigtwin.fmu_src import print_laws
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.force_laws import BILINEAR, CLEARANCE, CONTACT, CUBIC, HERTZ, JENKINS, LAWS, SPRING, ForceLaw
from rigtwin.rotor.model.local_force import LocalForce
from rigtwin.rotor.model.printed_laws import ARRAY, SCALAR
from tests.tolerances import DIFFERENCE_QUOTIENT, LAW_ROUND_OFF

WITHOUT_MEMORY = [law for law in LAWS if not law.memory]
each_law = pytest.mark.parametrize("law", WITHOUT_MEMORY, ids=lambda law: law.name)
few = settings(max_examples=30)


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(np.log10(low), np.log10(high)).map(lambda exponent: 10.0**exponent)


# The length of a law is its gap, its preload, or 10 um; displacements go five lengths either way.
LENGTH = {"clearance": "gap", "contact": "gap", "hertz": "d0"}
VALUES = {
    "k": powers(1e4, 1e9),
    "k3": powers(1e13, 1e17),
    "gap": powers(1e-7, 1e-3),
    "d0": powers(1e-7, 1e-3),
    "ratio": powers(0.1, 10),
}


@st.composite
def cases(draw: st.DrawFn, law: ForceLaw) -> tuple[float, tuple[float, ...]]:
    """A displacement and the coefficients of a law without memory."""
    values = {name: draw(VALUES[name]) for name in law.coefficients if name != "corner"}
    length = values.get(LENGTH.get(law.name, ""), 1e-5)
    values["corner"] = length * draw(powers(1e-6, 0.05))
    return length * draw(st.floats(-5, 5)), tuple(values[name] for name in law.coefficients)


def coefficient(law: ForceLaw, coefficients: Sequence[float], name: str) -> float:
    return dict(zip(law.coefficients, coefficients, strict=True))[name]


def scale(law: ForceLaw, x: float, coefficients: Sequence[float]) -> float:
    """Size of the terms that a law's force is the difference of [N]."""
    if law is CUBIC:
        return coefficients[0] * abs(x) ** 3
    length = coefficient(law, coefficients, LENGTH[law.name]) if law.name in LENGTH else 0.0
    ratio = coefficient(law, coefficients, "ratio") if law is BILINEAR else 1.0
    return coefficient(law, coefficients, "k") * (abs(x) + length) * max(ratio, 1.0)


def sharp(law: ForceLaw, x: float, coefficients: Sequence[float]) -> float:
    """The law as a textbook writes it, with its corners."""
    c = dict(zip(law.coefficients, coefficients, strict=True))
    if law is CUBIC:
        return c["k3"] * x**3
    if law is SPRING:
        return c["k"] * x
    if law is BILINEAR:
        return c["k"] * (c["ratio"] - 1) * max(x, 0.0)
    if law is HERTZ:
        contacts = max(c["d0"] + x, 0.0) ** 1.5 - max(c["d0"] - x, 0.0) ** 1.5
        return c["k"] / (3 * c["d0"] ** 0.5) * contacts - c["k"] * x
    beyond = float(np.sign(x)) * max(abs(x) - c["gap"], 0.0)
    return c["k"] * beyond - (c["k"] * x if law is CLEARANCE else 0.0)


# --- printed ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("file", print_laws.printed(), ids=lambda file: file.name)
def test_the_printed_laws_are_those_of_the_expressions(file):
    assert print_laws.printed()[file] == file.read_text(encoding="utf-8"), "run python print_laws.py"


def test_every_law_is_printed_for_floats_and_every_law_without_memory_for_arrays():
    assert list(SCALAR) == [law.name for law in LAWS]
    assert list(ARRAY) == [law.name for law in WITHOUT_MEMORY]


@each_law
@few
@given(data=st.data())
def test_floats_and_arrays_give_the_same(law, data):
    x, coefficients = data.draw(cases(law))
    points = np.array([x, -x, 0.0, x / 3])
    force, slope, _ = ARRAY[law.name](points, *coefficients)
    single = np.array([SCALAR[law.name](float(p), *coefficients) for p in points])
    size = scale(law, x, coefficients)
    assert_allclose(force, single[:, 0], rtol=LAW_ROUND_OFF, atol=LAW_ROUND_OFF * size)
    stiffness = size / max(abs(x), 1e-12)
    assert_allclose(slope, single[:, 1], rtol=LAW_ROUND_OFF, atol=LAW_ROUND_OFF * stiffness)


@each_law
@few
@given(data=st.data())
def test_the_slope_is_the_derivative_of_the_force(law, data):
    """By a complex step, which has no difference of nearby numbers in it."""
    x, coefficients = data.draw(cases(law))
    length = coefficient(law, coefficients, LENGTH[law.name]) if law.name in LENGTH else 1e-5
    step = 1e-20 * length
    _, slope = SCALAR[law.name](x, *coefficients)
    by_step = ARRAY[law.name](np.array([x + 1j * step]), *coefficients)[0].imag[0] / step
    # next to a rounded corner the slope changes by all of k over the corner's length
    corner = coefficient(law, coefficients, "corner") if "corner" in law.coefficients else length
    tolerance = LAW_ROUND_OFF * (1 + length / corner) * scale(law, max(abs(x), length), coefficients) / length
    assert_allclose(by_step, slope, rtol=LAW_ROUND_OFF, atol=tolerance)
    *_, by_corner = ARRAY[law.name](np.array([x]), *coefficients)
    moved = [
        value + 1j * step if name == "corner" else value
        for name, value in zip(law.coefficients, coefficients, strict=True)
    ]
    by_step = np.imag(ARRAY[law.name](np.array([x]), *moved)[0]) / step
    assert_allclose(np.broadcast_to(by_corner, 1), by_step, rtol=LAW_ROUND_OFF, atol=tolerance)


@few
@given(
    k=powers(1e5, 1e8), limit=powers(0.1, 50), share=st.floats(-0.9, 0.9), move=st.floats(-3, 3),
    step=st.just(1e-7),
)  # fmt: skip
def test_a_jenkins_elements_derivatives_are_its_difference_quotients(k, limit, share, move, step):
    """Not across the point where it begins to slip."""
    point = np.array([move * limit / k, 0.0, share * limit])  # x, x before, force before
    if abs(abs(move + share) - 1) < 1e-3:
        return
    _, *derivatives = SCALAR["jenkins"](*point, k, limit)
    for place, size in enumerate((limit / k, limit / k, limit)):
        h = np.zeros(3)
        h[place] = step * size
        high, low = (SCALAR["jenkins"](*p, k, limit)[0] for p in (point + h, point - h))
        assert_allclose(derivatives[place], (high - low) / (2 * h[place]), rtol=0,
                        atol=DIFFERENCE_QUOTIENT * limit / size)  # fmt: skip


# --- shape -----------------------------------------------------------------------------------------


@each_law
@few
@given(data=st.data())
def test_at_rest_a_law_pulls_with_no_more_than_its_rounding(law, data):
    x, coefficients = data.draw(cases(law))
    rounding = 0.0
    if law is BILINEAR:
        k, ratio, corner = coefficients
        rounding = k * abs(ratio - 1) * corner / 2
    at_rest = abs(SCALAR[law.name](0.0, *coefficients)[0])
    assert at_rest <= (1 + LAW_ROUND_OFF) * rounding + LAW_ROUND_OFF * scale(law, x, coefficients)


@pytest.mark.parametrize("law", [CUBIC, CLEARANCE, HERTZ, CONTACT], ids=lambda law: law.name)
@few
@given(data=st.data())
def test_laws_without_a_preferred_side_are_odd(law, data):
    x, coefficients = data.draw(cases(law))
    one, other = SCALAR[law.name](x, *coefficients), SCALAR[law.name](-x, *coefficients)
    size = scale(law, x, coefficients)
    assert_allclose(other[0], -one[0], rtol=0, atol=LAW_ROUND_OFF * size)
    assert_allclose(other[1], one[1], rtol=LAW_ROUND_OFF, atol=LAW_ROUND_OFF * size / max(abs(x), 1e-12))


def test_only_odd_laws_are_radial():
    assert {law.name for law in LAWS if law.radial} == {"cubic", "clearance", "contact"}
    x = np.linspace(-3e-5, 3e-5, 7)
    for law in (law for law in WITHOUT_MEMORY if law.radial):
        coefficients = {"k": 1e6, "k3": 1e15, "gap": 1e-5, "corner": 1e-8}
        force, *_ = ARRAY[law.name](x, *(coefficients[name] for name in law.coefficients))
        assert_allclose(force, -force[::-1], rtol=0, atol=LAW_ROUND_OFF * np.abs(force).max())


@each_law
@few
@given(data=st.data())
def test_rounding_a_corner_moves_the_force_by_less_than_its_length(law, data):
    """|pos(u) - max(u, 0)| <= corner / 2; Hertz' contacts hand it on by their own slope."""
    x, coefficients = data.draw(cases(law))
    if law in (SPRING, CUBIC):
        bound = 0.0
    else:
        k, corner = coefficient(law, coefficients, "k"), coefficient(law, coefficients, "corner")
        ratio = abs(coefficient(law, coefficients, "ratio") - 1) if law is BILINEAR else 1.0
        bound = k * ratio * corner
        if law is HERTZ:
            d0 = coefficient(law, coefficients, "d0")
            bound *= np.sqrt((d0 + abs(x) + corner) / d0)
    difference = SCALAR[law.name](x, *coefficients)[0] - sharp(law, x, coefficients)
    assert abs(difference) <= bound + LAW_ROUND_OFF * scale(law, x, coefficients)


@each_law
def test_a_corner_of_no_length_is_sharp(law):
    values = {"k": 2e6, "k3": 1e15, "gap": 1e-5, "d0": 1e-5, "ratio": 2.5, "corner": 1e-14}
    coefficients = tuple(values[name] for name in law.coefficients)
    for x in (-3e-5, -1.2e-5, -0.9e-5, 0.0, 0.3e-5, 1.1e-5, 4e-5):
        force, slope = SCALAR[law.name](x, *coefficients)
        h = 1e-8
        right = (sharp(law, x + h, coefficients) - sharp(law, x - h, coefficients)) / (2 * h)
        assert_allclose(force, sharp(law, x, coefficients), rtol=1e-8, atol=1e-7)
        if x or law is not BILINEAR:
            assert_allclose(slope, right, rtol=1e-3, atol=1.0)


@pytest.mark.parametrize("law", [law for law in LAWS if law.in_place], ids=lambda law: law.name)
@few
@given(data=st.data())
def test_what_takes_the_place_of_a_stiffness_never_pushes_away(law, data):
    x, coefficients = data.draw(cases(law))
    k = coefficient(law, coefficients, "k")
    force, slope = SCALAR[law.name](x, *coefficients)
    size = scale(law, x, coefficients)
    assert (k * x + force) * np.sign(x) >= -LAW_ROUND_OFF * size
    assert k + slope >= -LAW_ROUND_OFF * k


@given(k=powers(1e4, 1e9), d0=powers(1e-7, 1e-3), share=st.floats(1e-3, 0.9))
@few
def test_preloaded_contacts_have_the_stiffness_they_are_named_for_and_soften(k, d0, share):
    """About rest f = k x (1 - x^2 / (24 d0^2)) to third order."""
    force, slope = SCALAR["hertz"](share * d0, k, d0, 1e-9 * d0)
    assert force < 0
    assert slope < 0
    small, _ = SCALAR["hertz"](1e-2 * d0, k, d0, 1e-9 * d0)
    assert_allclose(small, -k * (1e-2 * d0) ** 3 / (24 * d0**2), rtol=1e-3)
    lifted, stiff = SCALAR["hertz"](20 * d0, k, d0, 1e-9 * d0)
    assert lifted > 0
    assert stiff > 0


# --- memory ----------------------------------------------------------------------------------------


def jenkins_along(path: FloatArray, k: float, limit: float, force: float = 0.0) -> FloatArray:
    """Forces along a path of displacements that starts at its first."""
    forces = [force]
    for before, x in pairwise(path):
        forces.append(SCALAR["jenkins"](float(x), float(before), forces[-1], k, limit)[0])
    return np.array(forces)


paths = st.lists(st.floats(-5, 5), min_size=2, max_size=30)


@few
@given(k=powers(1e5, 1e8), limit=powers(0.1, 50), moves=paths)
def test_a_jenkins_element_never_exceeds_its_limit(k, limit, moves):
    forces = jenkins_along(np.array([0.0, *moves]) * limit / k, k, limit)
    assert np.abs(forces).max() <= limit


def work(path: FloatArray, forces: FloatArray, k: float) -> float:
    """Work done on a Jenkins element along a path [J]: exact for straight pieces that slip at one end."""
    total = 0.0
    for x0, x1, f0, f1 in zip(path[:-1], path[1:], forces[:-1], forces[1:], strict=True):
        sticking = (f1 - f0) / k  # of x1 - x0
        total += (f0 + f1) / 2 * sticking + f1 * (x1 - x0 - sticking)
    return total


@few
@given(k=powers(1e5, 1e8), limit=powers(0.1, 50), moves=paths)
def test_a_jenkins_element_gives_back_at_most_what_its_spring_holds(k, limit, moves):
    path = np.array([0.0, *moves]) * limit / k
    forces = jenkins_along(path, k, limit)
    stored = forces**2 / (2 * k)
    dissipated = np.array([work(path[: n + 1], forces[: n + 1], k) for n in range(len(path))]) - stored
    assert (np.diff(dissipated) >= -1e-9 * limit**2 / k).all()


@pytest.mark.parametrize("amplitude", [0.5, 1.0, 2.0, 10.0])
def test_a_jenkins_element_dissipates_its_loop(amplitude):
    """4 F_c (A - F_c / k) a cycle beyond the limit, nothing within it; amplitudes in F_c / k."""
    k, limit = 1e7, 5.0
    corners = amplitude * limit / k * np.array([0.0, *([1.0, -1.0] * 4), 1.0])
    forces = jenkins_along(corners, k, limit)
    cycle = slice(-3, None)
    expected = 4 * limit * max(amplitude - 1, 0.0) * limit / k
    assert_allclose(work(corners[cycle], forces[cycle], k), expected, rtol=1e-12, atol=1e-12 * limit**2 / k)


@few
@given(k=powers(1e5, 1e8), limit=powers(0.1, 50), end=st.floats(-5, 5), pieces=st.integers(2, 30))
def test_a_straight_path_may_be_cut_into_any_pieces(k, limit, end, pieces):
    whole, cut = (jenkins_along(np.linspace(0, end * limit / k, n + 1), k, limit, 0.3 * limit)[-1] for n in (1, pieces))
    assert_allclose(cut, whole, rtol=0, atol=LAW_ROUND_OFF * limit)


# --- C ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The printed laws as a shared library, compiled with all warnings as errors."""
    compiler = shutil.which("gcc")
    assert compiler, "gcc is not installed; the printed C cannot be checked without a compiler: apt install gcc"
    source = Path(print_laws.__file__).with_name("native") / "laws.c"
    library = tmp_path_factory.mktemp("laws") / "laws.so"
    library.with_name("names.h").touch()  # the names that an FMU gives its functions: here they keep their own
    options = [
        "-I",
        str(library.parent),
        "-std=c99",
        "-O2",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-ffp-contract=off",
        "-shared",
        "-fPIC",
    ]
    run = subprocess.run([compiler, *options, str(source), "-o", str(library), "-lm"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return ctypes.CDLL(str(library))


def c_function(library: ctypes.CDLL, law: ForceLaw) -> Callable[..., tuple[float, ...]]:
    """A compiled law, called as its Python twin."""
    call: Any = library.law_force
    call.restype = ctypes.c_double
    n = len(law.variables)

    def function(*values: float) -> tuple[float, ...]:
        variables, coefficients, derivatives = (
            (ctypes.c_double * len(v))(*v) for v in (values[:n], values[n:], [0] * n)
        )
        return call(LAWS.index(law), variables, coefficients, derivatives), *derivatives

    return function


@each_law
@few
@given(data=st.data())
def test_the_printed_c_gives_what_python_gives(law, in_c, data):
    x, coefficients = data.draw(cases(law))
    force, slope = c_function(in_c, law)(x, *coefficients)
    expected = SCALAR[law.name](x, *coefficients)
    size = scale(law, x, coefficients)
    assert_allclose(force, expected[0], rtol=LAW_ROUND_OFF, atol=LAW_ROUND_OFF * size)
    assert_allclose(slope, expected[1], rtol=LAW_ROUND_OFF, atol=LAW_ROUND_OFF * size / max(abs(x), 1e-12))


@few
@given(k=powers(1e5, 1e8), limit=powers(0.1, 50), moves=paths)
def test_the_printed_c_of_a_law_with_memory_follows_the_same_path(in_c, k, limit, moves):
    function = c_function(in_c, JENKINS)
    force = expected = 0.0
    before = 0.0
    for x in np.array(moves) * limit / k:
        force, *derivatives = function(float(x), before, force, k, limit)
        expected, *also = SCALAR["jenkins"](float(x), before, expected, k, limit)
        assert force == expected
        assert derivatives == also
        before = float(x)


# --- at a joint ------------------------------------------------------------------------------------

RADIAL = [law for law in WITHOUT_MEMORY if law.radial]


def at_a_joint(law: ForceLaw, offset: float = 0.0) -> LocalForce:
    values = {"k": 2e6, "k3": 1e16, "gap": 1e-5, "d0": 1e-5, "ratio": 2.5, "corner": 1e-7}
    return LocalForce(law, tuple(values[name] for name in law.coefficients), np.eye(2), offset)


@pytest.mark.parametrize("law", WITHOUT_MEMORY, ids=lambda law: law.name)
@pytest.mark.parametrize("offset", [0.0, 1.4e-5])
def test_the_jacobian_in_both_planes_is_that_of_the_forces(law, offset):
    force, (y, z), h = at_a_joint(law, offset), np.array([[1.1e-5, -2e-5, 3e-6], [0.7e-5, 1.9e-5, -2e-5]]), 1e-10
    _, jacobian, _ = force.across(y, z)
    for place, (dy, dz) in enumerate(((h, 0.0), (0.0, h))):
        quotient = (force.across(y + dy, z + dz)[0] - force.across(y - dy, z - dz)[0]) / (2 * h)
        assert_allclose(jacobian[:, place], quotient, rtol=0, atol=1e-5 * np.abs(jacobian).max())


@pytest.mark.parametrize(
    "law", [law for law in WITHOUT_MEMORY if "corner" in law.coefficients], ids=lambda law: law.name
)
@pytest.mark.parametrize("offset", [0.0, 1.4e-5])
def test_forces_in_both_planes_answer_to_the_rounding_of_their_corners(law, offset):
    force, (y, z) = at_a_joint(law, offset), np.array([[1.1e-5, -2e-5, 3e-6], [0.7e-5, 1.9e-5, -2e-5]])
    corner, h = np.full(3, 1e-6), 1e-10
    *_, by_corner = force.across(y, z, corner)
    quotient = (force.across(y, z, corner + h)[0] - force.across(y, z, corner - h)[0]) / (2 * h)
    assert_allclose(by_corner, quotient, rtol=0, atol=1e-5 * np.abs(by_corner).max())


@pytest.mark.parametrize("law", RADIAL, ids=lambda law: law.name)
@given(angle=st.floats(-3, 3), size=st.floats(0.1, 4))
@few
def test_a_radial_law_pulls_back_along_the_displacement_whatever_its_direction(law, angle, size):
    force, r = at_a_joint(law), size * 1e-5
    forces, jacobian, _ = force.across(np.array([r * np.cos(angle)]), np.array([r * np.sin(angle)]))
    expected = force.along(np.array([r]))[0][0]
    scale_ = np.abs(expected) + 2e6 * r
    assert_allclose(forces[:, 0], expected * np.array([np.cos(angle), np.sin(angle)]), rtol=0, atol=1e-12 * scale_)
    assert_allclose(jacobian[:, :, 0], jacobian[:, :, 0].T, rtol=0, atol=1e-12 * np.abs(jacobian).max())


@pytest.mark.parametrize("law", WITHOUT_MEMORY, ids=lambda law: law.name)
def test_about_its_static_position_a_joint_starts_without_a_force(law):
    force, nothing = at_a_joint(law, 1.4e-5), np.zeros(1)
    assert_allclose(force.across(nothing, nothing)[0], 0.0, atol=1e-10)
    assert_allclose(force.along(nothing)[0], 0.0, atol=1e-10)
