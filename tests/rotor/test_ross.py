"""Every effect that ROSS has too, against ROSS' golden values (benchmarks/ross/README.md)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.effects import ross
from tests.tolerances import (
    EIGENVALUE_ROUND_OFF,
    FINE_MESH,
    ROSS_RUB,
    ROSS_RUB_THIRD,
    ROUND_OFF,
    ROUNDED_RUB,
    ROUNDED_RUB_THIRD,
    SAME_MATRICES,
    SHARP_RESONANCE,
)

ON_ROSS_MESH = [name for name in ross.CASES if name not in ross.OWN_MESH_NODES]
SHARP = {"nominal": SHARP_RESONANCE}  # bearings of 1e9 N/m

RUBS = tuple(ross.case("rub")["tests"])
RUB_TOLERANCES = {"harmonic balance": (ROUNDED_RUB, ROUNDED_RUB_THIRD), "time stepping": (ROSS_RUB, ROSS_RUB_THIRD)}


def test_no_golden_case_is_left_out():
    others = {"element", "rub"}  # below
    assert set(ross.golden()["cases"]) == set(ross.CASES) | others


def test_the_disks_are_the_same():
    shaft, theirs = ross.structure(ross.ELEMENTS), ross.golden()["rotor"]
    assert_allclose(shaft.disk_mass, theirs["disk_mass_kg"], rtol=ROUND_OFF)
    assert_allclose(shaft.disk_lumped_diametral, theirs["solid_disk_diametral_inertia_kg_m2"], rtol=ROUND_OFF)
    assert_allclose(shaft.disk_lumped_polar, theirs["solid_disk_polar_inertia_kg_m2"], rtol=ROUND_OFF)


@pytest.mark.parametrize(
    ("ours", "theirs"), [("M", "M"), ("K", "K"), ("G", "G_per_rad_per_s"), ("K_tension", "K_tension_per_N")]
)
def test_the_shafts_elements_are_the_same(ours: str, theirs: str):
    # The first and the last span are as long as ROSS' element; at the rotor's ends no other element adds to it.
    matrix, element = getattr(ross.structure(1), ours), np.array(ross.case("element")[theirs])
    atol = ROUND_OFF * np.abs(element).max()
    assert_allclose(matrix[:4, :8], element[:4], rtol=0, atol=atol)
    assert_allclose(matrix[-4:, -8:], element[4:], rtol=0, atol=atol)


@pytest.mark.parametrize("name", ON_ROSS_MESH)
def test_an_effect_on_the_same_mesh(name: str):
    found = ross.CASES[name](ross.ELEMENTS)
    assert len(found.frequencies) + len(found.responses) > 0
    assert found.frequencies.max(initial=0) < SAME_MATRICES
    assert found.responses.max(initial=0) < SHARP.get(name, SAME_MATRICES)


@pytest.mark.parametrize(("name", "elements"), [("bearing_offset", 8), ("bearing_offset", 16), ("open_crack", 16)])
def test_an_effect_inside_an_element_where_ross_has_a_mesh_node(name: str, elements: int):
    found = ross.CASES[name](elements)
    assert found.frequencies.max() < FINE_MESH
    assert found.responses.max(initial=0) < FINE_MESH


@pytest.mark.parametrize("name", ross.OWN_MESH_NODES)
def test_with_ross_mesh_nodes_nothing_else_differs(name: str):
    assert ross.ross_nodes(name, ross.ELEMENTS).max() < EIGENVALUE_ROUND_OFF


@pytest.mark.parametrize("solver", ross.RUB_SOLVERS)
@pytest.mark.parametrize("name", RUBS)
def test_the_steady_motion_of_a_rub(name: str, solver: str):
    test = ross.rub_tests()[name]
    ours = ross.RUB_SOLVERS[solver](test)
    fundamental, third = RUB_TOLERANCES[solver]
    assert ross.rub_difference(test, ours, 1).max() < fundamental
    assert ross.rub_difference(test, ours, 3).max() < third
