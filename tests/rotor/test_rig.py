"""The rig file: every wrong key is named once, and unusual rigs are beams like any other."""

import copy
import math
import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, RigError, load_rig, parse_rig, shipped_rigs
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from tests.rotor import rigs
from tests.tolerances import FINE_MESH, ROUND_OFF, hermite_error

# Frequency equations of the clamped-free and clamped-pinned Euler-Bernoulli beam, first three roots.
CLAMPED_FREE = (1.875104068711961, 4.694091132974175, 7.854757438237613)
CLAMPED_PINNED = (3.926602312047919, 7.068582745628732, 10.210176122813031)

PINNED_TOML = """
name = "{name}"
nodes_m = {nodes}
{top}
[[segment]]
length_m = 1.0
diameter_m = 0.02
youngs_modulus_Pa = 207e9
density_kg_per_m3 = 7840
poisson = {poisson}
{segment}
[[disk]]
node = {disk_node}
mass_kg = 1.0
{disk}
[[mass]]
node = 2
mass_kg = {mass}
[[support]]
node = 1
stiffness = {stiffness}
{support}
[[support]]
node = 3
stiffness = "k_b"
"""
GOOD = {
    "name": "pinned",
    "nodes": "[0.0, 0.5, 1.0]",
    "poisson": "0.3",
    "disk_node": "2",
    "mass": "0.5",
    "stiffness": '"k_b"',
    **dict.fromkeys(("top", "segment", "disk", "support"), ""),
}

# What is written wrongly, the key the message must name, and a word of what it says about it.
WRONG = [
    ({"name": "my rig"}, "name", "blanks"),
    ({"nodes": "[0.0, 0.7, 0.5]"}, "nodes_m", "increase"),
    ({"nodes": "[0.0, 0.5, 0.9]"}, "nodes_m", "0.9"),
    ({"nodes": "[0.1, 0.5, 1.0]"}, "nodes_m", "0.1"),
    ({"nodes": "[0.0]"}, "nodes_m", "at least 2"),
    ({"nodes": "[0.0, -0.5, 1.0]"}, "nodes_m 2", "greater"),
    ({"top": "excitation_node = 4"}, "excitation_node", "3 nodes"),
    ({"top": "shaft_damping_ratio = 0.5"}, "shaft_damping_ratio", "0.2"),
    ({"top": "elements_between_nodes = 0"}, "elements_between_nodes", "greater"),
    ({"top": "colour = 3"}, "colour", "unknown key"),
    ({"top": "[k_b]\nstart_N_per_m = 1e13"}, "k_b", "max_N_per_m"),
    ({"top": "[k_b]\nmin_N_per_m = 0"}, "k_b min_N_per_m", "greater"),
    ({"poisson": "0.5"}, "segment 1 poisson", "0.5"),
    ({"poisson": "nan"}, "segment 1 poisson", "Input should be"),
    ({"segment": "bore_m = 0.02"}, "segment 1", "bore_m"),
    ({"segment": "area_m2 = 1e-4"}, "segment 1", "not both"),
    ({"segment": "width_m = 0.1"}, "segment 1 width_m", "unknown key"),
    ({"disk_node": "4"}, "disk 1", "node 4"),
    ({"disk_node": "0"}, "disk 1 node", "greater"),
    ({"disk": "thickness_m = 0.01"}, "disk 1", "not both"),
    ({"disk": "inertia = true"}, "disk 1", "diametral_inertia_kg_m2"),
    ({"mass": "-1"}, "mass 1 mass_kg", "greater"),
    ({"stiffness": '"soft"'}, "support 1 stiffness", "'k_b', 'rigid' or 'table'"),
    ({"stiffness": "-1e6"}, "support 1 stiffness", "greater"),
    ({"stiffness": "nan"}, "support 1 stiffness", "finite"),
    ({"support": 'tilt_stiffness_Nm_per_rad = "k_b"'}, "support 1 tilt_stiffness_Nm_per_rad", "rigid"),
    ({"support": "damping_Ns_per_m = 5"}, "support 1", "bearing_damping_Ns_per_m"),
]


def message(**wrong: str) -> str:
    with pytest.raises(RigError) as error:
        parse_rig(PINNED_TOML.format(**GOOD | wrong), "my.toml")
    return str(error.value)


def test_the_template_of_these_tests_is_a_good_rig():
    assert parse_rig(PINNED_TOML.format(**GOOD)).length == 1.0


@pytest.mark.parametrize(("wrong", "key", "word"), WRONG, ids=[f"{k}: {w}" for _, k, w in WRONG])
def test_a_wrong_key_gives_one_message_that_names_it(wrong, key, word):
    text = message(**wrong)
    assert text.startswith("my.toml: ")
    assert key in text
    assert word in text
    assert text.count(key) == 1, "named once"


def test_every_wrong_key_is_reported_at_once():
    text = message(poisson="0.7", mass="-1", stiffness='"soft"')
    assert all(key in text for key in ("segment 1 poisson", "mass 1 mass_kg", "support 1 stiffness"))
    assert len(text.split("; ")) == 3


def test_a_rig_without_a_bearing_is_refused():
    text = PINNED_TOML.format(**GOOD).replace('"k_b"', '"rigid"')
    with pytest.raises(RigError, match="no bearing to identify"):
        parse_rig(text)


def test_two_supports_at_one_node_are_refused():
    with pytest.raises(RigError, match="two supports at one node"):
        parse_rig(PINNED_TOML.format(**GOOD).replace("node = 3", "node = 1"))


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"mass_kg": None, "diameter_m": 0.1}, "thickness_m"),
        ({"mass_kg": None}, "mass_kg"),
        (
            {"mass_kg": None, "diameter_m": 0.1, "thickness_m": 0.01, "density_kg_per_m3": 1e3}
            | {"diametral_inertia_kg_m2": 1.0},
            "diametral_inertia_kg_m2",
        ),
        ({"mass_kg": None, "diameter_m": 0.1, "thickness_m": 0.01, "density_kg_per_m3": 1e3, "bore_m": 0.1}, "bore_m"),
    ],
)
def test_a_disk_is_given_by_mass_or_by_dimensions(keys, word):
    disk = {"node": 3, "mass_kg": 1.0} | keys
    with pytest.raises(ValueError, match=word):
        Rig.model_validate(rigs.tables(disk=[{k: v for k, v in disk.items() if v is not None}]))


def test_no_toml_and_no_such_rig_are_told_apart():
    with pytest.raises(RigError, match="not valid TOML"):
        parse_rig("name = ")
    with pytest.raises(RigError, match="nit-rourkela"):
        load_rig("no-such-rig")


def test_a_rig_is_loaded_from_a_path(tmp_path):
    path = tmp_path / "pinned.toml"
    path.write_text(PINNED_TOML.format(**GOOD), encoding="utf-8")
    assert load_rig(path).name == "pinned"


def test_another_rotor_under_a_shipped_name_is_refused(tmp_path):
    text = (files("rigtwin.rotor") / "rigs" / "nit-rourkela.toml").read_text(encoding="utf-8")
    path = tmp_path / "copy.toml"
    path.write_text(text.replace("elements_between_nodes = 1", "elements_between_nodes = 4"), encoding="utf-8")
    assert load_rig(path).elements_between_nodes == 4
    path.write_text(text.replace("diameter_m = 0.020", "diameter_m = 0.024"), encoding="utf-8")
    with pytest.raises(RigError, match="nit-rourkela is a shipped rig of other dimensions"):
        load_rig(path)


def test_the_shipped_rig_is_the_papers():
    paper, rig = rigs.PAPER["geometry"], load_rig("nit-rourkela")
    assert "nit-rourkela" in shipped_rigs()
    assert_allclose(rig.length, sum(paper["segments_mm"]) / 1e3, rtol=1e-15)
    borders = np.cumsum([0, *paper["segments_mm"]]) / 1e3
    assert_allclose([rig.nodes_m[d.node - 1] for d in rig.disk], (borders[[1, 3]] + borders[[2, 4]]) / 2)
    assert len(rig.nodes_m) - 1 == paper["elements"]
    assert borders[0] < rig.nodes_m[rig.excitation_node - 1] < borders[1], "node 2 is between bearing and disk"
    segment = rig.segment[0]
    assert (segment.diameter_m, segment.youngs_modulus_Pa) == (paper["shaft_diameter_m"], paper["E_Pa"])
    assert (segment.density_kg_per_m3, segment.poisson) == (paper["density_kg_m3"], paper["poisson"])
    assert rig.shaft_damping_ratio == paper["shaft_damping_ratio"]
    assert rig.disk[0].diametral_inertia == 0.0, "the paper lumps the disks' masses"


# Length [m], mass [kg] and the resonances on rigid supports [Hz], as docs/contracts.md lists them.
SHIPPED = {
    "nit-rourkela": (0.426, 4.46, (101, 324)),
    "pump-overhung": (1.6, 120.8, (46, 259)),
    "spindle": (0.16, 0.211, (730, 1856)),
    "cantilever": (0.3, 0.473, (33, 214)),
}


def test_every_shipped_rig_is_listed():
    assert shipped_rigs() == sorted(SHIPPED)


@pytest.mark.parametrize("name", list(SHIPPED))
def test_a_shipped_rig_has_the_size_and_the_resonances_that_are_listed(name):
    length, mass, resonances_hz = SHIPPED[name]
    rig = load_rig(name)
    assert (rig.name, rig.length) == (name, pytest.approx(length))
    assert_allclose(_mass(rig), mass, rtol=2e-3)
    computed = natural_frequencies_hz(rigs.held(rig, elements=4), plane=1)[:2]
    assert_allclose(computed, resonances_hz, atol=0.5)


@pytest.mark.parametrize("name", list(SHIPPED))
def test_the_mesh_of_a_shipped_rig_is_fine_enough_for_its_first_resonances(name):
    rig = load_rig(name)
    own, fine = (
        natural_frequencies_hz(rigs.held(rig, elements=n), plane=1)[:2] for n in (rig.elements_between_nodes, 8)
    )
    assert_allclose(own, fine, rtol=2e-4)


@pytest.mark.parametrize("name", list(SHIPPED))
def test_bearings_of_a_shipped_rig_matter_within_their_range(name):
    """From the softest to the stiffest bearing the first resonance moves by a twentieth or more."""
    rig = load_rig(name)
    soft, stiff = (
        natural_frequencies_hz(rigs.held(rig, elements=2, condition=Condition(k_b=k_b)), plane=1)[0]
        for k_b in (rig.k_b.min_N_per_m, rig.k_b.max_N_per_m)
    )
    assert stiff > 1.05 * soft


def _mass(rig: Rig) -> float:
    """Of shaft, disks and lumped masses [kg]."""
    shaft = sum(s.length_m * s.sections()[0].density * s.sections()[0].area for s in rig.segment)
    return shaft + sum(d.mass for d in rig.disk) + sum(m.mass_kg for m in rig.mass)


def euler_bernoulli_hz(beam: Rig, root: float) -> float:
    section = rigs.section_of(beam)
    wave = math.sqrt(section.bending_stiffness / (section.density * section.area))
    return (root / beam.length) ** 2 * wave / (2 * math.pi)


def test_a_cantilever_with_rigid_deflection_and_tilt_has_the_analytic_frequencies():
    beam = rigs.cantilever(rigs.round_shaft(1.0, 0.01))
    computed = natural_frequencies_hz(rigs.held(beam, elements=16, element=euler_bernoulli), plane=1)[:3]
    assert_allclose(computed, [euler_bernoulli_hz(beam, root) for root in CLAMPED_FREE], rtol=hermite_error(3, 16))


def test_a_propped_cantilever_has_the_analytic_frequencies():
    clamp = {"node": 1, "stiffness": "rigid", "tilt_stiffness_Nm_per_rad": "rigid"}
    prop = {"node": 2, "stiffness": "k_b"}
    beam = rigs.rig(nodes_m=[0.0, 1.0], segment=[rigs.round_shaft(1.0, 0.01)], support=[clamp, prop])
    computed = natural_frequencies_hz(rigs.held(beam, elements=24, element=euler_bernoulli), plane=1)[:3]
    assert_allclose(computed, [euler_bernoulli_hz(beam, root) for root in CLAMPED_PINNED], rtol=hermite_error(3.25, 24))


def test_a_stiff_tilt_spring_approaches_the_rigid_clamp():
    tables = rigs.cantilever(rigs.round_shaft(1.0, 0.01)).model_dump(exclude_unset=True)
    clamped = natural_frequencies_hz(rigs.held(Rig.model_validate(tables), elements=4), plane=1)[0]
    first = []
    for tilt_stiffness in (1e3, 1e5, 1e7):
        tables["support"][0]["tilt_stiffness_Nm_per_rad"] = tilt_stiffness
        first.append(natural_frequencies_hz(rigs.held(Rig.model_validate(tables), elements=4), plane=1)[0])
    shortfall = 1 - np.array(first) / clamped
    # A hundred times the spring, a hundredth of the shortfall (EI/L is 100 N m/rad, so 1e3 is still soft).
    assert_allclose(shortfall[1] / shortfall[2], 100, rtol=0.02)
    assert shortfall[0] > shortfall[1] > 0


def tip_flexibility(beam: Rig) -> float:
    """Deflection of a clamped beam's free end per newton there."""
    system = rigs.held(beam, elements=3)
    tip = system.unit_vector(len(beam.nodes_m), 1)
    return tip @ np.linalg.solve(system.K, tip)


def test_a_stepped_shaft_deflects_as_its_segments_in_series():
    """w = sum over segments of int (L-x)^2/EI dx + l/kGA."""
    thick, thin = rigs.round_shaft(0.3, 0.03), rigs.round_shaft(0.2, 0.02)
    beam = rigs.cantilever(thick, thin)
    expected, start = 0.0, 0.0
    for segment in beam.segment:
        section, end = segment.sections()[0], start + segment.length_m
        arms = (beam.length - start) ** 3 - (beam.length - end) ** 3
        shear_stiffness = section.shear_factor * section.shear_modulus * section.area
        expected += arms / (3 * section.bending_stiffness) + segment.length_m / shear_stiffness
        start = end
    assert_allclose(tip_flexibility(beam), expected, rtol=ROUND_OFF)


def test_a_step_between_two_nodes_gets_a_mesh_node_of_its_own():
    thick, thin = rigs.round_shaft(0.3, 0.03), rigs.round_shaft(0.2, 0.02)
    with_node = rigs.cantilever(thick, thin)
    without = with_node.model_copy(update={"nodes_m": [0.0, 0.5]})
    assert_allclose(tip_flexibility(without), tip_flexibility(with_node), rtol=ROUND_OFF)
    assert 0.3 in assemble(without).x


def test_cutting_a_segment_in_two_changes_nothing():
    whole = rigs.cantilever(rigs.round_shaft(0.5, 0.02))
    halves = rigs.cantilever(rigs.round_shaft(0.25, 0.02), rigs.round_shaft(0.25, 0.02))
    f = [natural_frequencies_hz(rigs.held(b, elements=n), plane=1)[:3] for b, n in ((whole, 4), (halves, 2))]
    assert_allclose(f[0], f[1], rtol=1e-9)


def general_section(**keys: float) -> dict:
    segment = rigs.round_shaft(0.5, 0.02)
    del segment["diameter_m"]
    return segment | keys


def test_a_round_section_given_by_its_moments_is_the_same_beam():
    round_rig = rigs.pinned_beam(rigs.round_shaft(0.5, 0.02))
    section = rigs.section_of(round_rig)
    least = {"area_m2": section.area, "second_moment_y_m4": section.second_moment}
    segment = general_section(**least)
    del segment["poisson"]  # steel's
    for general in (general_section(**least, shear_factor=section.shear_factor), segment):
        beam = rigs.pinned_beam(general)
        for matrix in ("M", "K", "G"):
            assert_allclose(getattr(assemble(beam), matrix), getattr(assemble(round_rig), matrix), rtol=1e-15)


def test_a_flat_bar_is_stiff_in_one_plane_and_soft_in_the_other():
    width, height = 0.03, 0.01
    moments = {"second_moment_y_m4": width * height**3 / 12, "second_moment_z_m4": height * width**3 / 12}
    beam = rigs.pinned_beam(general_section(area_m2=width * height, shear_factor=5 / 6, **moments))
    system = rigs.held(beam, elements=8, element=euler_bernoulli)
    f_y, f_z = natural_frequencies_hz(system, plane=1)[0], natural_frequencies_hz(system, plane=2)[0]
    exact = rigs.pinned_euler_bernoulli_hz(rigs.section_of(beam), 0.5, 1)
    assert_allclose(f_y, exact, rtol=hermite_error(1, 16))
    assert_allclose(f_z / f_y, width / height, rtol=1e-9)


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({}, "area_m2"),
        ({"area_m2": 1e-4}, "second_moment_y_m4"),
        ({"area_m2": 1e-4, "second_moment_y_m4": 1e-9, "shear_factor": 0.9, "bore_m": 0.001}, "bore_m"),
    ],
)
def test_half_a_general_section_is_refused(keys, word):
    with pytest.raises(ValueError, match=word):
        rigs.pinned_beam(general_section(**keys))


def test_a_hollow_shaft_has_the_frequencies_of_a_tube():
    beam = rigs.pinned_beam(rigs.round_shaft(0.4, 0.03, bore_m=0.02))
    section = rigs.section_of(beam)
    assert_allclose(section.area, math.pi * (0.015**2 - 0.010**2), rtol=1e-14)
    assert_allclose(section.second_moment, math.pi * (0.015**4 - 0.010**4) / 4, rtol=1e-14)
    computed = 2 * math.pi * natural_frequencies_hz(rigs.held(beam, elements=32), plane=1)[:2]
    exact = [rigs.pinned_timoshenko_whirl(section, 0.4, mode)[1] for mode in (1, 2)]
    assert_allclose(computed, exact, rtol=FINE_MESH)


def test_a_larger_bore_ratio_carries_shear_on_less_of_its_area():
    factors = [rigs.section_of(rigs.pinned_beam(rigs.round_shaft(0.4, 0.03, bore_m=b))).shear_factor for b in (0, 0.02)]
    assert factors[0] > factors[1]


def test_disk_by_dimensions_is_a_rigid_annulus():
    D, d, t, rho = 0.124, 0.02, 0.018, 7840.0
    disk = {"node": 3, "diameter_m": D, "bore_m": d, "thickness_m": t, "density_kg_per_m3": rho, "inertia": True}
    annulus = Rig.model_validate(rigs.tables(disk=[disk])).disk[0]
    assert_allclose(annulus.mass, rho * math.pi / 4 * (D**2 - d**2) * t, rtol=1e-14)
    assert_allclose(annulus.polar_inertia, annulus.mass * (D**2 + d**2) / 8, rtol=1e-14)
    # Perpendicular axes: half the polar inertia, and the slices' distance from the middle plane.
    assert_allclose(annulus.diametral_inertia, annulus.polar_inertia / 2 + annulus.mass * t**2 / 12, rtol=1e-14)


def test_a_thin_disk_given_by_mass_has_twice_its_diametral_inertia_about_the_shaft():
    tables = copy.deepcopy(rigs.tables())
    tables["disk"] = [{"node": 3, "mass_kg": 1.0, "diametral_inertia_kg_m2": 0.5, "inertia": True}]
    assert Rig.model_validate(tables).disk[0].polar_inertia == 1.0


@pytest.mark.parametrize(("diameter", "said"), [("0.020", False), ("25", True)])
def test_a_diameter_in_another_unit_is_remarked_upon(tmp_path, caplog, diameter, said):
    own = Path(__file__).resolve().parents[2] / "examples" / "own_rotor.toml"
    file = tmp_path / f"{diameter}.toml"
    file.write_text(own.read_text(encoding="utf-8").replace("diameter_m = 0.020", f"diameter_m = {diameter}"))
    load_rig(file)
    load_rig(file)  # said once
    words = "segment 1: diameter_m = 25 is much for a shaft of 0.34 m; lengths are in metres"
    assert caplog.text.count(words) == said


@pytest.mark.parametrize(
    ("key", "wrong", "words"),
    [
        ("youngs_modulus_Pa", "210", "segment 1: youngs_modulus_Pa = 210 is little; steel has 2.1e11 Pa"),
        ("youngs_modulus_Pa", "69e9", None),
        ("density_kg_per_m3", "7.85", "segment 1: density_kg_per_m3 = 7.85 is little; steel has 7850 kg/m³"),
        ("density_kg_per_m3", "1e-3", None),  # a shaft whose mass stands as lumped masses
    ],
)
def test_a_material_in_another_unit_is_remarked_upon(tmp_path, caplog, key, wrong, words):
    own = Path(__file__).resolve().parents[2] / "examples" / "own_rotor.toml"
    text = re.sub(rf"{key} = \S+", f"{key} = {wrong}", own.read_text(encoding="utf-8"))
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    load_rig(tmp_path / "rig.toml")
    assert (words in caplog.text) if words else ("is little" not in caplog.text)
