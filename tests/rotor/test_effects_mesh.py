"""Effects that have a place or a length converge with the mesh, and do not know where elements end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.rotor.effects import (
    AxialLoad,
    BearingOffset,
    Effect,
    HubStiffening,
    OpenCrack,
    Rub,
    SensorPosition,
    ShaftModulus,
)
from rigtwin.rotor.frequency.frequency_response import dynamic_stiffness, receptance
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model, build_system
from tests.rotor.effect_cases import RIGID, node_receptance, paper, paper_with, sensed
from tests.tolerances import CONVERGENCE_ORDER, FINE_MESH, ROUND_OFF

ELEMENTS = (1, 2, 4, 8)  # between two nodes
REFERENCE = 16
BEARINGS = Condition(k_b=1e7)

# A third of the way between two nodes: every halving of the elements leaves the crack a third of an
# element away from one of its ends, so that the error falls evenly.
NEXT_TO_A_DISK, IN_THE_MIDDLE, NEAR_THE_END = 0.119 + 0.094 / 3, 0.213 + 0.094 / 3, 0.0595 / 3


def order(errors: FloatArray) -> FloatArray:
    """Mean order of convergence over meshes that are halved each time, (n_mesh, ...) to (...)."""
    return np.log2(errors[0] / errors[-1]) / (len(errors) - 1)


def frequencies(effect: Effect, condition: Condition, elements: int) -> FloatArray:
    """(2,) f1 and f2 [Hz]."""
    return natural_frequencies_hz(paper_with(condition, effect, elements=elements).in_plane(1))[:2]


def errors_over_the_mesh(quantity: Callable[[int], np.ndarray]) -> FloatArray:
    """(n_mesh, ...) relative errors of what follows from so many elements, against 16 between two nodes."""
    values = np.array([quantity(elements) for elements in (*ELEMENTS, REFERENCE)])
    return np.abs(values[:-1] / values[-1] - 1)


def test_a_bearing_beside_its_node_yields_with_the_shafts_own_modulus():
    """Softer by the effect or by the rig file: the same rotor."""
    rig, beside = load_rig("nit-rourkela"), BearingOffset(offset=-0.009)
    softer = [s.model_copy(update={"youngs_modulus_Pa": 0.9 * s.youngs_modulus_Pa}) for s in rig.segment]
    drawn = assemble(rig.model_copy(update={"segment": softer}))
    condition = Condition(k_b=1e8)
    by_rig = natural_frequencies_hz(build_system(drawn, condition, (beside,)))
    by_effect = natural_frequencies_hz(build_system(assemble(rig), condition, (ShaftModulus(factor=0.9), beside)))
    assert_allclose(by_effect, by_rig, rtol=1e-8)


@pytest.mark.parametrize("condition", [RIGID, BEARINGS], ids=["rigid", "bearing"])
@pytest.mark.parametrize(
    "effect",
    [
        OpenCrack(reduction=0.4, position=NEXT_TO_A_DISK),
        OpenCrack(reduction=0.4, position=IN_THE_MIDDLE),
        OpenCrack(reduction=0.4, position=NEAR_THE_END),
        OpenCrack(reduction=0.4, position=0.213),  # on a node
        OpenCrack(reduction=0.4, position=0.119),  # on a disk's node
        HubStiffening(factor=2.0),
        BearingOffset(offset=0.003),
        BearingOffset(offset=-0.009),
        AxialLoad(force=1e4),
        AxialLoad(force=-1e4),
    ],
    ids=str,
)
def test_frequencies_converge_with_second_order(effect, condition):
    """Timoshenko's elements are of second order in the end; a kink or a step within an element is no worse.

    At four elements between nodes, 24 on the shaft, a crack of 40 % at a disk is the worst: 6e-5 of f2.
    """
    errors = errors_over_the_mesh(lambda elements: frequencies(effect, condition, elements))
    assert (order(errors) > 2 - CONVERGENCE_ORDER).all(), errors
    assert (errors[2] < FINE_MESH).all(), errors


AWAY_FROM_RESONANCES = 2 * np.pi * np.array([50.0, 150.0, 250.0, 350.0])


def test_a_sensor_beside_its_node_converges_with_second_order():
    def reading(elements: int) -> np.ndarray:
        system = paper_with(BEARINGS, SensorPosition(offset=0.01, node=3), elements=elements).in_plane(1)
        return sensed(system, AWAY_FROM_RESONANCES)[:, 2]

    errors = errors_over_the_mesh(reading).max(axis=1)
    assert order(errors) > 2 - CONVERGENCE_ORDER, errors
    nominal = sensed(paper_with(BEARINGS, elements=REFERENCE).in_plane(1), AWAY_FROM_RESONANCES)[:, 2]
    assert np.abs(reading(REFERENCE) / nominal - 1).min() > 1e-3


@pytest.mark.parametrize("node", [3, 4])
def test_the_response_at_a_rub_converges_with_second_order(node):
    """All that harmonic balance takes of the rotor: the receptance of the joint."""

    def joint(elements: int) -> np.ndarray:
        model = build_model(paper(elements), BEARINGS, [Rub(node=node)]).in_plane(1)
        pattern = model.forces[0].patterns[0]
        return receptance(dynamic_stiffness(model.system, AWAY_FROM_RESONANCES), pattern[:, None], pattern[None])

    errors = errors_over_the_mesh(joint).reshape(len(ELEMENTS), -1).max(axis=1)
    assert order(errors) > 2 - CONVERGENCE_ORDER, errors


# --- across the border of two elements -------------------------------------------------------------


def jump(x: float, elements: int) -> FloatArray:
    """(2,) relative change of f1 and f2 while a crack moves across x by a nanometre."""
    left, right = (frequencies(OpenCrack(reduction=0.4, position=x + d), RIGID, elements) for d in (-5e-10, 5e-10))
    return np.abs(right / left - 1)


@pytest.mark.parametrize("x", [0.0595, 0.119])
def test_the_jump_of_a_crack_across_an_elements_border_vanishes_with_second_order(x):
    """The shaft's stiffness knows the crack's place exactly, its mass matrix knows no crack.

    The coarsest elements, 94 mm or half a wave of the second mode, hardly show an order yet.
    """
    jumps = np.array([jump(x, elements) for elements in ELEMENTS])
    assert (order(jumps) > 2 - 2 * CONVERGENCE_ORDER).all(), jumps
    assert (jumps[2] < FINE_MESH).all(), jumps


@pytest.mark.parametrize("x", [0.0595, 0.119, 0.213])
def test_at_rest_a_crack_crosses_an_elements_border_unnoticed(x):
    static = np.zeros(1)
    left, right = (
        node_receptance(paper_with(RIGID, OpenCrack(reduction=0.4, position=x + d)), static) for d in (-1e-12, 1e-12)
    )
    assert_allclose(left, right, rtol=0, atol=ROUND_OFF * np.abs(left).max())


def test_within_an_element_the_frequencies_follow_a_moving_crack_smoothly():
    """The second difference over 2 mm is that of a smooth line: no kinks, no steps."""
    x = np.arange(0.121, 0.211, 0.002)
    f = np.array([frequencies(OpenCrack(reduction=0.4, position=float(p)), RIGID, 1) for p in x])
    nominal = frequencies(OpenCrack(reduction=0.0), RIGID, 1)
    drop = 1 - f / nominal
    assert (np.abs(np.diff(drop, 2, axis=0)) < 0.02 * drop.max(axis=0)).all()
