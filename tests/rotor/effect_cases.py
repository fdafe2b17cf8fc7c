"""Effects drawn at random from their prior ranges, and the responses they are judged by."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st

from rigtwin.rotor.effects import EFFECTS, Effect, Parameter
from rigtwin.rotor.effects.scale import RigScale, scale_of
from rigtwin.rotor.frequency.frequency_response import ComplexArray, dynamic_stiffness, receptance
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import Change, build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem
from tests.rotor import rigs

OMEGA = 2 * np.pi * np.linspace(20.0, 400.0, 21)
BEARING = Condition(k_b=2e6, bearing_damping=20.0, shaft_damping_ratio=0.003)
RIGID = Condition(rigid_support=True, shaft_damping_ratio=0.003)
SUPPORTS = {"bearing": BEARING, "rigid": RIGID}


def by_family(*families: str) -> list[str]:
    """Ids of the effects of these families."""
    return [key for key, effect in EFFECTS.items() if effect.family in families]


STRUCTURE, SUPPORT = by_family("structure"), by_family("support")
NONLINEAR = [key for key in by_family("nonlinear") if EFFECTS[key].location != "joints"]  # the paper's rotor has none
LINEAR = [*STRUCTURE, *SUPPORT, "gyroscopic"]  # change matrices
PLACED = [*LINEAR, *NONLINEAR, "sensor_mass", "sensor_position", "unbalance"]  # write into the design

# Acts in the bearings: nothing on rigid supports. (A support that is called rigid is none.)
IN_BEARINGS = [key for key, effect in EFFECTS.items() if effect.location == "bearings"]


@functools.cache
def paper(elements: int = 1) -> Structure:
    """The paper's rotor."""
    return rigs.paper_structure(elements)


conditions = st.builds(
    Condition,
    k_b=st.floats(5.7, 9).map(lambda exponent: 10**exponent),
    rigid_support=st.booleans(),
    bearing_damping=st.floats(0, 100),
    shaft_damping_ratio=st.floats(1e-3, 0.02),
    excitation_node=st.integers(2, 6),
    excitation_plane=st.sampled_from([1, 2]),
)


@cache
def paper_scale() -> RigScale:
    """The scale of the paper's rotor."""
    return scale_of(paper())


def drawn(key: str) -> st.SearchStrategy[Effect]:
    """An effect with parameters from its prior and any place on the paper's rotor."""
    fields = {name: _value(role) for name, role in EFFECTS[key].roles().items()}
    return st.builds(EFFECTS[key], **fields)


def _value(role: Any) -> st.SearchStrategy[Any]:
    if isinstance(role, Parameter):
        low, high = paper_scale().ends(role)
        if role.log:
            return st.floats(math.log(low), math.log(high)).map(math.exp)
        return st.floats(low, high)
    if role.kind == "position":
        return st.floats(0.0, float(paper().x[-1]))
    return st.integers(role.first, paper().n_nodes)


def paper_with(condition: Condition, *effects: Change, elements: int = 1) -> LinearSystem:
    """The paper's rotor with effects."""
    return build_system(paper(elements), condition, effects)


def nodes_of(system: LinearSystem, planes: Iterable[int] = (1, 2)) -> FloatArray:
    """(n, n_nodes * n_planes) unit forces at every node."""
    nodes = range(1, system.structure.n_nodes + 1)
    return np.array([system.unit_vector(node, plane) for plane in planes for node in nodes]).T


def node_receptance(system: LinearSystem, omega: FloatArray = OMEGA, spin_speed: float = 0.0) -> ComplexArray:
    """(n_freq, 14, 14) receptance between all nodes, y and z [m/N]."""
    forces = nodes_of(system)
    return receptance(dynamic_stiffness(system, omega, spin_speed), forces, forces.T)


def sensed(system: LinearSystem, omega: FloatArray = OMEGA, node: int = 2, plane: int = 1) -> ComplexArray:
    """(n_freq, n_nodes) receptance that the accelerometers of both planes see for a force at a node [m/N]."""
    read_out = np.vstack([system.read_out(1), system.read_out(2)])
    return receptance(dynamic_stiffness(system, omega), system.unit_vector(node, plane)[:, None], read_out)[:, :, 0]


def relative_difference(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(a - b).max() / np.abs(b).max())
