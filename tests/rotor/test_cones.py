"""Conical segments: against closed forms of cones, and against the same shaft in many short steps."""

from __future__ import annotations

import math
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import iv, jv, kv, yv

from rigtwin.fmu_src.documentation import rotor_picture
from rigtwin.rotor.effects import EFFECTS
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.frequency.shapes import shaft_shapes
from rigtwin.rotor.frequency.whirl import campbell
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.drawing import rig_svg
from rigtwin.rotor.geometry.rig import RigError, load_rig, parse_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import (
    Cone,
    cantilever_flexibility,
    cowper_shear_factor,
    euler_bernoulli,
    linear_timoshenko,
    round_section,
    timoshenko,
)
from rigtwin.rotor.model.rotor_model import build_system
from tests.rotor import rigs
from tests.tolerances import CONVERGENCE_ORDER, ROUND_OFF

STEEL = (7840.0, 207e9, 0.3)
E, NU = 207e9, 0.3

# The integral over a cone whose diameter trebles, by sixteen points.
QUADRATURE = 1e-10


def cone(left: float, right: float, length: float, **keys: float) -> dict[str, float]:
    """A segment table."""
    return {"length_m": length, "diameter_left_m": left, "diameter_right_m": right} | rigs.STEEL | keys


def steps(segment: dict[str, float], n: int) -> list[dict[str, float]]:
    """The same segment in n cylinders, each with the diameter and bore of its middle."""
    ends = [(segment[f"{key}_left_m"], segment[f"{key}_right_m"]) for key in ("diameter", "bore")]
    places = (np.arange(n) + 0.5) / n
    middles = np.array([(1 - places) * left + places * right for left, right in ends]).T.tolist()
    length = segment["length_m"] / n
    return [{"length_m": length, "diameter_m": d, "bore_m": b} | rigs.STEEL for d, b in middles]


def frequencies(beam, elements, element=timoshenko, n=3):
    return natural_frequencies_hz(rigs.held(beam, elements=elements, element=element), plane=1)[:n]


# -- closed forms -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", [timoshenko, euler_bernoulli, linear_timoshenko])
def test_a_cone_without_slope_is_a_cylinder(element):
    straight = Cone((0.03, 0.03), (0.01, 0.01), *STEEL)
    for name in ("stiffness", "mass", "tilt_inertia", "tension"):
        expected = getattr(element(round_section(0.03, 0.01, *STEEL, None), 0.08), name)
        found = getattr(element(straight, 0.08), name)
        assert_allclose(found, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("ratio", [0.4, 1.5, 3.0])
def test_the_tip_of_a_cone_yields_as_the_closed_form_says(ratio):
    """64 F L^3 / (3 pi E D^3 d) in bending and 4 F L / (kappa G pi D d) in shear, from D at the clamp to d."""
    D, L, d = 0.03, 0.2, 0.03 * ratio
    bent = cantilever_flexibility(Cone((D, d), (0.0, 0.0), *STEEL), L, sheared=False)
    assert bent[0, 0] == pytest.approx(64 * L**3 / (3 * math.pi * E * D**3 * d), rel=QUADRATURE)
    moment = 64 * L / (3 * math.pi * E) * (D**2 + D * d + d**2) / (D * d) ** 3
    assert bent[1, 1] == pytest.approx(moment, rel=QUADRATURE)
    sheared = cantilever_flexibility(Cone((D, d), (0.0, 0.0), *STEEL), L)
    kappa, G = cowper_shear_factor(NU), E / (2 * (1 + NU))
    assert sheared[0, 0] - bent[0, 0] == pytest.approx(4 * L / (kappa * G * math.pi * D * d), rel=1e-9)


def test_a_conical_segment_yields_at_its_tip_whatever_the_mesh_is():
    """One element is exact for forces at its ends, and so are five."""
    beam = rigs.cantilever(cone(0.03, 0.012, 0.2))
    for elements in (1, 5):
        system = rigs.held(beam, elements=elements, element=euler_bernoulli)
        tip = system.unit_vector(2, 1)
        deflection = tip @ np.linalg.solve(system.K, tip)
        assert deflection == pytest.approx(64 * 0.2**3 / (3 * math.pi * E * 0.03**3 * 0.012), rel=1e-8)


def test_mass_and_inertia_of_a_hollow_cone_are_those_of_the_frustums():
    """pi rho L (D^2 + D d + d^2) / 12 less the bore's; the moment of inertia about its left end to the last digit."""
    D, d, B, b, L, rho = 0.05, 0.03, 0.01, 0.02, 0.3, 7840.0
    beam = rigs.cantilever(cone(D, d, L, bore_left_m=B, bore_right_m=b))
    for elements in (1, 3):
        structure = assemble(beam, elements_between_nodes=elements)
        along_y = np.arange(0, structure.n, 4)
        mass = structure.M[np.ix_(along_y, along_y)].sum()
        volume = math.pi * L / 12 * (D * D + D * d + d * d - B * B - B * b - b * b)
        assert mass == pytest.approx(rho * volume, rel=ROUND_OFF)
        turned = np.zeros(structure.n)
        turned[0::4], turned[3::4] = structure.x, 1.0  # y = x, theta_z = 1
        outer, bore = np.polynomial.Polynomial([D, (d - D) / L]), np.polynomial.Polynomial([B, (b - B) / L])
        x = np.polynomial.Polynomial([0, 1])
        inertia = rho * math.pi * (x**2 * (outer**2 - bore**2) / 4 + (outer**4 - bore**4) / 64).integ()(L)
        assert turned @ structure.M @ turned == pytest.approx(inertia, rel=ROUND_OFF)
        about_y = np.zeros(structure.n)
        about_y[1::4], about_y[2::4] = structure.x, -1.0  # z = x, theta_y = -1
        polar = rho * math.pi * (2 * (outer**4 - bore**4) / 64).integ()(L)
        assert abs(turned @ structure.G @ about_y) == pytest.approx(polar, rel=ROUND_OFF)
        assert turned @ structure.K_tension @ turned == pytest.approx(L, rel=ROUND_OFF)
        assert np.abs(structure.K @ turned).max() <= 1e-9 * np.abs(structure.K).max() * L


def bessel(k: float, tip: float) -> float:
    """Zero where k^2 is a frequency of a cone, clamped at its base (1) and free at its tip (between 0 and 1 of it).

    (s^4 w'')'' = k^4 s^2 w has the solutions J, Y, I, K of order two of 2 k sqrt(s), over s [cranch1956].
    """
    rows = []
    for function, down, up in ((jv, -1, 1), (yv, -1, 1), (iv, 1, 1), (kv, -1, -1)):
        base, end = 2 * k, 2 * k * math.sqrt(tip)
        rows.append(
            [function(2, base), down * function(3, base), tip**-2 * function(4, end), up * tip**1.5 * function(3, end)]
        )
    return float(np.linalg.det(np.array(rows)))


def cone_frequencies(tip: float, n: int) -> np.ndarray:
    """(n,) k of a cantilever cone: omega = k^2 sqrt(E I / rho A) / h^2 with the base's section, h to the apex."""
    grid = np.linspace(0.5, 40, 4000) / (1 - tip) ** 0.5
    values = np.array([bessel(k, tip) for k in grid])
    places = np.flatnonzero(np.sign(values[:-1]) != np.sign(values[1:]))[:n]
    return np.array([brentq(bessel, grid[p], grid[p + 1], args=(tip,), xtol=1e-13) for p in places])


def test_the_closed_form_of_the_tests_has_the_frequencies_of_kirchhoffs_cone():
    """8.7193, 21.1457 and 38.4538 for a cone to its apex [kirchhoff1879; naguleswaran1994]."""
    assert_allclose(cone_frequencies(1e-6, 3) ** 2, [8.7193, 21.1457, 38.4538], atol=6e-5)


@pytest.mark.parametrize("tip", [0.2, 0.5])
def test_frequencies_of_a_truncated_cone_converge_on_the_closed_form_with_fourth_order(tip):
    D, L = 0.04, 0.8
    omega = cone_frequencies(tip, 3) ** 2 * math.sqrt(E / 7840.0) * D / 4 / (L / (1 - tip)) ** 2
    beam = rigs.cantilever(cone(D, tip * D, L))
    counts = np.array([2, 4, 8, 16])
    errors = np.array([frequencies(beam, n, euler_bernoulli) / (omega / (2 * np.pi)) - 1 for n in counts])
    for n, error in zip(counts, errors, strict=True):
        print(f"tip {tip}: {n} elements, errors " + ", ".join(f"{e:.1e}" for e in error))
    order = -np.log2(errors[2:, 1] / errors[1:-1, 1])
    assert order[-1] == pytest.approx(4, abs=CONVERGENCE_ORDER)
    assert np.abs(errors[-1]).max() < 2e-4


# -- many short steps -----------------------------------------------------------------------------------------

TUBE = cone(0.05, 0.02, 0.5, bore_left_m=0.02, bore_right_m=0.01)


def overhung(*segments):
    """A shaft on two rigid supports with a disk beyond them."""
    ends = np.cumsum([0.0, *(s["length_m"] for s in segments)])
    disk = {"mass_kg": 5.0, "diametral_inertia_kg_m2": 0.02, "polar_inertia_kg_m2": 0.04, "inertia": True}
    return rigs.rig(
        nodes_m=ends.tolist(),
        segment=list(segments),
        disk=[{"node": len(ends), **disk}],
        support=[{"node": 1, "stiffness": "k_b"}, {"node": (len(ends) + 1) // 2, "stiffness": "rigid"}],
    )


def whirls(rig, elements):
    """Backward and forward whirl of the lowest modes at 6000 rev/min [rad/s]."""
    system = build_system(assemble(rig, elements_between_nodes=elements), Condition(rigid_support=True))
    return campbell(system, np.array([6000 * math.pi / 30]), 4).eigenvalue[0].imag


def test_a_cone_in_many_steps_converges_on_the_conical_element_with_second_order():
    """Shear, rotary inertia and gyroscopic moments of a tapered tube; the steps' error is printed over their number."""
    halves = [{**TUBE, "length_m": 0.25} for _ in range(2)]
    for key in ("diameter", "bore"):
        middle = (TUBE[f"{key}_left_m"] + TUBE[f"{key}_right_m"]) / 2
        halves[0][f"{key}_right_m"] = halves[1][f"{key}_left_m"] = middle
    exact = whirls(overhung(*halves), 20)
    counts = [4, 8, 16, 32, 64]
    errors = []
    for n in counts:
        stepped = overhung(*(step for half in halves for step in steps(half, n // 2)))
        errors.append(np.abs(whirls(stepped, max(1, 40 // n)) / exact - 1).max())
        print(f"{n} steps: error {errors[-1]:.1e}")
    assert errors[-1] < 1e-3
    for before, after in pairwise(errors[1:]):
        assert math.log2(before / after) == pytest.approx(2, abs=CONVERGENCE_ORDER)


def test_one_conical_element_is_as_good_as_many_steps():
    """The lowest frequency of a tapered cantilever: five cones against twenty steps, each of one element."""
    exact = frequencies(rigs.cantilever(TUBE), 60)[0]
    cones = abs(frequencies(rigs.cantilever(TUBE), 5)[0] / exact - 1)
    stepped = abs(frequencies(rigs.cantilever(*steps(TUBE, 20)), 1)[0] / exact - 1)
    print(f"five cones {cones:.1e}, twenty steps {stepped:.1e}")
    assert cones < stepped / 8


def test_the_shear_factor_follows_the_bore_ratio_of_each_section():
    tube = Cone((0.05, 0.04), (0.0, 0.03), *STEEL)
    for xi, ratio in ((0.0, 0.0), (0.5, 0.015 / 0.045), (1.0, 0.75)):
        assert tube.at(xi).shear_factor == pytest.approx(cowper_shear_factor(NU, ratio), rel=1e-14)
    assert Cone((0.05, 0.04), (0.0, 0.03), *STEEL, shear_factor=0.7).at(0.3).shear_factor == 0.7


def test_a_cone_in_pieces_is_the_same_cone():
    whole = frequencies(rigs.cantilever(cone(0.04, 0.02, 0.6)), 6)
    parts = rigs.cantilever(cone(0.04, 0.03, 0.3), cone(0.03, 0.02, 0.3))
    assert_allclose(frequencies(parts, 3), whole, rtol=1e-9)
    mirrored = rigs.rig(
        nodes_m=[0.0, 0.6],
        segment=[cone(0.02, 0.04, 0.6)],
        support=[{"node": 2, "stiffness": "k_b", "tilt_stiffness_Nm_per_rad": "rigid"}],
    )
    assert_allclose(frequencies(mirrored, 6), whole, rtol=1e-9)


# -- effects ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["open_crack", "hub_stiffening", "bearing_offset", "shaft_modulus", "axial_load"])
def test_effects_on_a_cone_converge_on_those_on_steps(name):
    """An effect inside an element takes the element's middle section: an error of second order in its length."""
    disk = {"node": 2, "diameter_m": 0.1, "thickness_m": 0.03, "density_kg_per_m3": 7840.0}
    rest = {"nodes_m": [0.0, 0.2, 0.4], "disk": [disk], "support": [{"node": n, "stiffness": "k_b"} for n in (1, 3)]}
    conical = rigs.rig(segment=[cone(0.03, 0.02, 0.4)], **rest)
    table = {**cone(0.03, 0.02, 0.4), "bore_left_m": 0.0, "bore_right_m": 0.0}
    stepped = rigs.rig(segment=steps(table, 80), **rest)
    effects, condition = [EFFECTS[name]()], Condition(k_b=5e6)
    of_cone = build_system(assemble(conical, elements_between_nodes=20), condition, effects)
    of_steps = build_system(assemble(stepped), condition, effects)
    assert_allclose(of_cone.modes.omega[:4], of_steps.modes.omega[:4], rtol=3e-4)
    plain = build_system(assemble(conical, elements_between_nodes=20), condition)
    assert np.abs(of_cone.modes.omega[:4] / plain.modes.omega[:4] - 1).max() > 1e-5


def test_a_deep_crack_in_a_steep_cone_leaves_a_stiffness():
    beam = rigs.pinned_beam(round_segment := rigs.round_shaft(0.4, 0.02))
    steep = beam.model_copy(update={"segment": [type(beam.segment[0])(**cone(0.06, 0.01, round_segment["length_m"]))]})
    for position in (0.02, 0.2, 0.38):
        crack = EFFECTS["open_crack"](reduction=0.99, position=position)
        system = build_system(assemble(steep), Condition(k_b=1e7), [crack])
        assert system.modes.omega.min() > 0


# -- files and pictures ---------------------------------------------------------------------------------------

RIG = """
name = "mine"
nodes_m = [0.0, 0.2]
[[segment]]
length_m = 0.2
diameter_left_m = 0.04
diameter_right_m = 0.02
bore_left_m = 0.01
bore_right_m = 0.005
youngs_modulus_Pa = 207e9
density_kg_per_m3 = 7840
[[support]]
node = 1
stiffness = "k_b"
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("diameter_right_m = 0.02", "", "segment 1: a cone needs both of diameter_left_m and diameter_right_m"),
        ("diameter_left_m = 0.04", "diameter_m = 0.04", "segment 1: diameter_m does not go with a cone"),
        ("diameter_left_m = 0.04", "area_m2 = 0.04", "segment 1: area_m2 does not go with a cone"),
        ("bore_right_m = 0.005", "", "a conical bore needs both of bore_left_m and bore_right_m"),
        ("bore_right_m = 0.005", "bore_right_m = 0.005\nbore_m = 0.01", "give bore_m, or both of bore_left_m"),
        ("bore_right_m = 0.005", "bore_right_m = 0.02", "smaller than diameter_right_m at the right end"),
        ("diameter_left_m", "diameter_lift_m", "did you mean diameter_left_m"),
        ("diameter_right_m = 0.02", "diameter_right_m = 0", "segment 1 diameter_right_m"),
    ],
)
def test_a_wrong_cone_gives_one_sentence_with_its_key(old, new, words):
    with pytest.raises(RigError) as raised:
        parse_rig(RIG.replace(old, new, 1), "my.toml")
    assert words in str(raised.value)


def test_a_straight_bore_goes_through_a_cone():
    text = RIG.replace("bore_left_m = 0.01\nbore_right_m = 0.005", "bore_m = 0.01")
    (segment,) = parse_rig(text).segment
    assert segment.cone == Cone((0.04, 0.02), (0.01, 0.01), *STEEL)
    assert segment.outline == ((0.04, 0.02), (0.01, 0.01))
    assert load_rig("nit-rourkela").segment[0].cone is None


def test_a_cone_is_drawn_as_one():
    """Its outline is as high at each end as its diameter there, and its bore is dashed."""
    rig = parse_rig(RIG)
    svg = ElementTree.fromstring(rig_svg(rig))
    (outline,) = [one for one in svg.iter() if one.tag.endswith("polygon")]
    corners = np.array([[float(v) for v in pair.split(",")] for pair in outline.attrib["points"].split()])
    left, right = corners[0, 0], corners[1, 0]
    heights = [np.ptp(corners[corners[:, 0] == x, 1]) for x in (left, right)]
    scale = (right - left) / 0.2
    assert_allclose(heights, [0.04 * scale, 0.02 * scale], rtol=0.01)
    assert len([one for one in svg.iter() if "stroke-dasharray" in one.attrib]) == 2
    straight = ElementTree.fromstring(rig_svg(load_rig("nit-rourkela")))
    assert not [one for one in straight.iter() if "stroke-dasharray" in one.attrib]


def test_the_picture_of_the_fmu_shows_cones():
    """It differs from the picture of the cylinder of the same middle."""
    straight = RIG.replace("diameter_left_m = 0.04\ndiameter_right_m = 0.02", "diameter_m = 0.03")
    straight = straight.replace("bore_left_m = 0.01\nbore_right_m = 0.005", "")
    pictures = {rotor_picture(parse_rig(text)) for text in (RIG, straight)}
    assert len(pictures) == 2


def test_shapes_of_cones_run_through_their_nodes():
    system = rigs.held(rigs.cantilever(cone(0.04, 0.02, 0.6)), elements=3)
    shapes = shaft_shapes(
        system.in_plane(1), system.in_plane(1).modes.Phi[:, :1].astype(complex), np.linspace(0, 0.6, 31)
    )
    line = shapes[0, :, 0].real
    assert line[[0, -1]].tolist() == pytest.approx([0, 1])
    assert np.diff(line).min() > 0
    assert np.diff(line, 2).min() > -1e-6
