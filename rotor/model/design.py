"""The rotor while effects are put into it.

An effect changes the design in terms of the machine (the stiffness of a bearing, a mass at a node, a
crack). ``build_model`` then makes the matrices, always in the same order. So effects can be combined,
and the order in which they are given does not matter.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray, IntArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import shape_functions, stiffness_of, uniform_flexibility
from rigtwin.rotor.model.force_laws import ForceLaw
from rigtwin.rotor.model.structure import DOF_PER_NODE, PLANE_PLACES, PLANE_SIGNS, Structure

# Length of shaft, in diameters, over which a crack counts as a reduced bending stiffness.
CRACK_LENGTH = 0.8

# Least stiffness of a viscoelastic branch relative to its bearing: the point between spring and dashpot needs one.
WEAKEST_BRANCH = 1e-9

# A block whose mount has at most this compliance, relative to the pedestal's, counts as the ground.
GROUND_COMPLIANCE = 1e-6

# Distance below which a position is that of a mesh node [m].
_SAME = 1e-12

# Nonzero entries of a vector over all degrees of freedom: their places and their values.
Pattern = tuple[IntArray, FloatArray]


@dataclass(frozen=True)
class JointLaw:
    """A force law at a joint; its numbers follow from the joint's linear stiffness [N/m]."""

    law: ForceLaw
    coefficients: Callable[[float], tuple[float, ...]]
    offset: Callable[[float], float] = lambda stiffness: 0.0  # static displacement in y [m]


@dataclass(frozen=True)
class Pedestal:
    """What a bearing stands on, in y and in z: mass [kg] on stiffness [N/m] and damping [N s/m].

    It stands on the ground or on a block, whose mass and compliance are multiples of its own.
    """

    stiffness: float
    mass: float
    damping: float
    block_compliance: float = 0.0
    block_mass: float = 0.0

    @property
    def has_block(self) -> bool:
        """Whether the pedestal stands on a block that can move."""
        return self.block_compliance > GROUND_COMPLIANCE

    @property
    def n_masses(self) -> int:
        """Number of masses: the pedestal, and the block if there is one."""
        return 2 if self.has_block else 1


@dataclass(frozen=True)
class Branch:
    """A mass [kg] beside a node, in y and in z, on a spring [N/m] and a damper [N s/m] to the node."""

    node: int
    mass: float
    stiffness: float
    damping: float
    ground_damping: float  # between the mass and the ground [N s/m]


@dataclass
class Bearing:
    """A support whose stiffness is the parameter k_b: a joint between the shaft and its base."""

    x: float  # where it acts on the shaft [m]
    side: int  # -1 left, +1 right of the middle of all bearings, 0 in the middle
    stiffness: float  # radial [N/m]
    damping: float  # radial, beside the stiffness [N s/m]
    tilt_stiffness: float  # [N m/rad]
    directions: FloatArray = field(default_factory=lambda: np.eye(2))  # (2, 2) stiffness in (y, z) over ``stiffness``
    branches: list[tuple[float, float]] = field(default_factory=list)  # Maxwell: stiffness ratio, relaxation time [s]
    pedestal: Pedestal | None = None
    laws: list[JointLaw] = field(default_factory=list)


@dataclass(frozen=True)
class Unbalance:
    """A mass off the axis of a spinning rotor."""

    moment: float  # [kg m]
    phase: float  # angle from y towards z at time zero [rad]
    patterns: FloatArray  # (2, n) where it acts in y and in z


class Design:
    """What the rotor consists of; starts as the nominal rotor under its test condition."""

    def __init__(self, structure: Structure, condition: Condition):
        self.structure, self.condition = structure, condition
        self.modulus_factor = 1.0  # of the whole shaft
        self.hub_factor = 1.0  # of the shaft's bending stiffness inside the disks
        self.cracks: list[tuple[float, float]] = []  # position [m], lost share of the bending stiffness
        self.tension = 0.0  # [N]
        self.shaft_damping_ratio = condition.shaft_damping_ratio
        self.disk_mass_change = 0.0  # relative
        self.disk_inertia_factor = 0.0  # of the inertia that the nominal rotor leaves out
        self.gyroscopic_factor = 0.0  # of the polar inertia that the nominal rotor leaves out
        self.masses: list[tuple[int, float, float]] = []  # node, mass [kg], half its width [m]
        self.ground_springs: list[tuple[int, int, float, float]] = []  # node, plane, [N/m], [N s/m]
        self.branches: list[Branch] = []  # at nodes
        self.rigid_stiffness = np.inf  # of the rigid supports in place of the bearings [N/m]
        self.bearings = _bearings(structure, condition)
        self.contacts: list[tuple[int, JointLaw]] = []  # between a node and the ground
        self.joint_laws: list[JointLaw] = []  # of the angle [rad] between the two sections at every joint that tilts
        self.unbalances: list[tuple[int, float, float]] = []  # node, moment [kg m], phase [rad]
        self.sensor_offsets: dict[int, float] = {}  # node, distance along x [m]
        self._replaced: set[str] = set()

    def replace(self, effect: str) -> None:
        """Called by an effect that replaces a value; a second replacement would contradict the first.

        Raises ValueError when the effect has been called before.
        """
        if effect in self._replaced:
            raise ValueError(f"{effect} is given twice, and takes the place of one value; give it once")
        self._replaced.add(effect)


def _bearings(structure: Structure, condition: Condition) -> list[Bearing]:
    """The bearings of the rotor; none on rigid supports."""
    if condition.rigid_support:
        return []
    k_b, damping = condition.k_b, condition.bearing_damping
    return [
        Bearing(x=x, side=side, stiffness=k_b, damping=damping, tilt_stiffness=tilt_stiffness)
        for x, side, tilt_stiffness in structure.bearings
    ]


# -- where a point of the shaft is in the matrices -----------------------------------------------


def _element_at(structure: Structure, x: float) -> int:
    return min(max(bisect_right(structure.positions, x) - 1, 0), len(structure.positions) - 2)


def shaft_point(structure: Structure, x: float, plane: int) -> tuple[Pattern, Pattern]:
    """Deflection and rotation of the shaft at position x [m] in plane 1 or 2.

    Between mesh nodes the element's shape functions give them. Beyond its ends the shaft is
    continued as a straight and rigid line.
    """
    node = bisect_left(structure.positions, x - _SAME)
    if node < len(structure.positions) and structure.positions[node] < x + _SAME:
        first = DOF_PER_NODE * node
        tilt = first + PLANE_PLACES[plane - 1][1]
        sign = PLANE_SIGNS[plane - 1][1]
        return (np.array([first + plane - 1]), np.ones(1)), (np.array([tilt]), np.array([sign]))
    element = _element_at(structure, x)
    left, length = structure.x[element], structure.x[element + 1] - structure.x[element]
    phi = 12 * structure.bending_stiffness[element, plane - 1]
    phi /= structure.shear_stiffness[element, plane - 1] * length**2
    inside = float(np.clip(x, structure.x[0], structure.x[-1]))
    deflection, rotation = shape_functions((inside - left) / length, length, phi)
    deflection = deflection + (x - inside) * rotation
    places, signs = DOF_PER_NODE * element + PLANE_PLACES[plane - 1], PLANE_SIGNS[plane - 1]
    return (places, signs * deflection), (places, signs * rotation)


def local_flexibility(structure: Structure, x: float, plane: int) -> float:
    """How far a unit force at x [m] bends and shears an element whose ends are held [m/N]; zero at mesh nodes.

    The shape functions transfer a load between two nodes to the nodes exactly, but do not contain this deflection.

    >>> local_flexibility(assemble(load_rig("nit-rourkela")), x=0.0, plane=1)
    0.0
    """
    element = _element_at(structure, x)
    before, after = x - structure.positions[element], structure.positions[element + 1] - x
    if min(before, after) < _SAME:  # a node, or beyond the shaft's ends
        return 0.0
    EI, GA = structure.bending_stiffness[element, plane - 1], structure.shear_stiffness[element, plane - 1]
    parts = (stiffness_of(uniform_flexibility(length, EI, GA), length) for length in (before, after))
    left, right = parts
    return float(np.linalg.inv(left[2:, 2:] + right[:2, :2])[0, 0])


# -- the shaft's stiffness -----------------------------------------------------------------------


def shaft_stiffness(design: Design) -> FloatArray:
    """(n, n) stiffness of the shaft with its modulus, hubs and cracks [N/m].

    An element whose bending stiffness changes along its length is built from the sum of its
    flexibilities. This is exact for forces at its ends, wherever the change is. What is added to a cone is that of
    its middle section.
    """
    structure = design.structure
    K = structure.K.copy()
    for element, added in _added_flexibility(design).items():
        length = structure.x[element + 1] - structure.x[element]
        for plane in (1, 2):
            EI, sound = structure.bending_stiffness[element, plane - 1], structure.flexibility[element, plane - 1]
            signs = PLANE_SIGNS[plane - 1]
            change = stiffness_of(sound + added / EI, length) - stiffness_of(sound, length)
            places = DOF_PER_NODE * element + PLANE_PLACES[plane - 1]
            K[np.ix_(places, places)] += signs[:, None] * change * signs
    return design.modulus_factor * K


def _added_flexibility(design: Design) -> dict[int, FloatArray]:
    """Per element, (2, 2) flexibility that hubs and cracks add, times E I."""
    structure, added = design.structure, {}

    def add(element: int, flexibility: FloatArray) -> None:
        added[element] = added.get(element, 0.0) + flexibility

    if design.hub_factor != 1.0:
        for node, thickness in zip(structure.disk_node, structure.disk_thickness, strict=True):
            for element, a, b in _covered(
                structure, structure.x[node] - thickness / 2, structure.x[node] + thickness / 2
            ):
                add(element, (1 / design.hub_factor - 1) * _moment_integral(a, b, structure.x[element + 1]))
    for position, lost in design.cracks:
        element = _element_at(structure, position)
        compliance = CRACK_LENGTH * structure.diameter[element] * lost / (1 - lost)  # times E I
        lever = np.array([structure.x[element + 1] - position, 1.0])
        add(element, compliance * np.outer(lever, lever))
    return added


def _covered(structure: Structure, start: float, stop: float) -> list[tuple[int, float, float]]:
    """Elements that a part of the shaft covers, and the ends of the covered pieces."""
    left, right = np.maximum(structure.x[:-1], start), np.minimum(structure.x[1:], stop)
    return [(int(e), float(left[e]), float(right[e])) for e in np.flatnonzero(right - left > 1e-12)]


def _moment_integral(a: float, b: float, end: float) -> FloatArray:
    """int_a^b m m' dx with m = (end - x, 1), the moments of a unit force and a unit moment at ``end``."""
    p, q = end - a, end - b  # lever arms, p > q
    return np.array([[(p**3 - q**3) / 3, (p**2 - q**2) / 2], [(p**2 - q**2) / 2, p - q]])
