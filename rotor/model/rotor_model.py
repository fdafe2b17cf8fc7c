"""From a structure, a test condition and effects to the model that the solvers use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.design import (
    Bearing,
    Branch,
    Design,
    JointLaw,
    Pattern,
    Unbalance,
    local_flexibility,
    shaft_point,
    shaft_stiffness,
)
from rigtwin.rotor.model.local_force import LocalForce
from rigtwin.rotor.model.speed_tables import SpeedSupports
from rigtwin.rotor.model.structure import DOF_PER_NODE, PLANE_PLACES, PLANE_SIGNS, Structure
from rigtwin.rotor.model.system import LinearSystem, block


class Change(Protocol):
    """Anything that can be put into a design; the effects of ``rotor.effects`` are."""

    def add_to(self, design: Design) -> None:
        """Write down what changes."""


@dataclass(frozen=True)
class RotorModel:
    """The supported rotor with everything that acts on it.

    M q'' + (C + Omega G) q' + K q + sum of the local forces = f + unbalance
    """

    system: LinearSystem
    forces: tuple[LocalForce, ...] = ()
    unbalances: tuple[Unbalance, ...] = ()

    @property
    def memory(self) -> bool:
        """Whether a law has memory, so that each sample depends on the one before."""
        return any(force.law.memory for force in self.forces)

    def in_plane(self, plane: int) -> RotorModel:
        """Motion in one plane, for planes that do not couple; spinning forces are left out."""
        keep = np.flatnonzero(self.system.plane == plane)
        forces = tuple(replace(force, patterns=force.patterns[:, keep]) for force in self.forces)
        return RotorModel(self.system.in_plane(plane), forces)


def build_model(structure: Structure, condition: Condition, effects: Sequence[Change] = ()) -> RotorModel:
    """Put the rotor on its supports, with effects.

    A rigid support removes the degree of freedom. A stiff spring instead would, by round-off, change
    the frequencies by 1e-7 and add an undamped mode at the support.

    Raises ValueError where an effect names a node that does not exist.
    """
    return _Assembly(_designed(structure, condition, effects)).model()


def build_system(structure: Structure, condition: Condition, effects: Sequence[Change] = ()) -> LinearSystem:
    """The linear part of ``build_model``.

    >>> build_system(assemble(load_rig("nit-rourkela")), Condition(rigid_support=True)).n
    24
    """
    return build_model(structure, condition, effects).system


def bearing_stiffness(
    structure: Structure, condition: Condition, effects: Sequence[Change], omega: FloatArray, plane: int
) -> ComplexArray:
    """Dynamic stiffness between shaft and ground at every bearing, with everything below it condensed.

    D = Z_ss - Z_sb Z_bb^-1 Z_bs with Z = K + i omega C - omega^2 M of the bearings alone: s are the shaft's degrees of
    freedom there, b those below. It holds for bearings at their nodes and leaves out tilt stiffness and force laws.

    Parameters
    ----------
    omega : (n_freq,) [rad/s]
    plane : 1 = y or 2 = z

    Returns
    -------
    (n_freq, n_bearings) [N/m], bearings by node; none on rigid supports
    """
    design = _designed(structure, condition, effects)
    made = _Assembly(design)
    for bearing in design.bearings:
        made._bearing(bearing)
    n, w = len(design.bearings), omega[:, None, None]
    shaft = [structure.dof(node, plane) for node in structure.bearing_nodes][:n]
    places = np.array([*shaft, *range(structure.n + plane - 1, made.size, 2)], dtype=np.int64)
    block = places[:, None], places
    Z = made.K[block] + 1j * w * made.C[block] - w**2 * made.M[block]
    D = Z[:, :n, :n] - Z[:, :n, n:] @ np.linalg.solve(Z[:, n:, n:], Z[:, n:, :n])
    return np.einsum("fii->fi", D)


def _designed(structure: Structure, condition: Condition, effects: Sequence[Change]) -> Design:
    """The design of the rotor after all effects have changed it."""
    design = Design(structure, condition)
    for effect in effects:
        effect.add_to(design)
    return design


class _Assembly:
    """Matrices over all degrees of freedom: the shaft's, then the supports' own, in pairs (y, z)."""

    def __init__(self, design: Design):
        self.design, self.structure = design, design.structure
        n = self.structure.n
        pairs = sum((b.pedestal.n_masses if b.pedestal else 0) + len(b.branches) for b in design.bearings)
        self.size = n + 2 * (pairs + len(design.branches))
        self.used = n
        self.M, self.K, self.C, self.G, self.K_shaft = (np.zeros((self.size, self.size)) for _ in range(5))
        self.held = np.zeros(self.size, dtype=bool)
        self.tied: list[tuple[IntArray, IntArray]] = []  # left and right side of joints that are rigid
        self.forces: list[LocalForce] = []

    def model(self) -> RotorModel:
        """The model, built in a fixed order."""
        self._shaft()
        self._joints()
        self._bodies()
        self._fixed_supports()
        for bearing in self.design.bearings:
            self._bearing(bearing)
        for node, plane, stiffness, damping in self.design.ground_springs:
            place = self.structure.dof(node, plane)
            self.K[place, place] += stiffness
            self.C[place, place] += damping
        for branch in self.design.branches:
            self._branch(branch)
        for node, law in self.design.contacts:
            self._local_force([self._node(node, plane) for plane in (1, 2)], law, 0.0)
        for node, stiffness in self.structure.tilting_joints:
            for law in self.design.joint_laws:
                self._local_force([_angle(node, plane) for plane in (1, 2)], law, stiffness)
        return self._on_free()

    def _shaft(self) -> None:
        n, design = self.structure.n, self.design
        K_shaft = shaft_stiffness(design)
        self.K_shaft[:n, :n] = K_shaft
        self.K[:n, :n] = K_shaft + design.tension * self.structure.K_tension if design.tension else K_shaft
        self.M[:n, :n] = self.structure.M
        self.G[:n, :n] = self.structure.G

    def _joints(self) -> None:
        """Springs and dashpots between the two sides of each joint; the shaft's damping has no part in them."""
        for left, right, stiffness, damping in self._sides():
            if np.isinf(stiffness):
                self.tied.append((left, right))
                continue
            for matrix, value in ((self.K, stiffness), (self.C, damping)):
                matrix[left, left] += value
                matrix[right, right] += value
                matrix[left, right] -= value
                matrix[right, left] -= value

    def _sides(self) -> Iterator[tuple[IntArray, IntArray, float, float]]:
        """Left and right degrees of freedom of every joint, deflections and then tilts, with stiffness and damping."""
        s = self.structure
        across = zip(s.joint_node, s.joint_stiffness, s.joint_damping, strict=True)
        tilt = zip(s.joint_node, s.joint_tilt_stiffness, s.joint_tilt_damping, strict=True)
        for first, joints in ((0, across), (2, tilt)):
            for node, stiffness, damping in joints:
                left = DOF_PER_NODE * int(node) + first + np.arange(2)
                yield left, left + DOF_PER_NODE, float(stiffness), float(damping)

    def _tie(self, sensors: FloatArray) -> None:
        """Let both sides of a joint move as one where it is rigid; the right one's degrees of freedom go."""
        for left, right in self.tied:
            for matrix in (self.M, self.K, self.C, self.G, self.K_shaft):
                matrix[:, left] += matrix[:, right]
                matrix[left] += matrix[right]
            for patterns in (sensors, *(force.patterns for force in self.forces)):
                patterns[..., left] += patterns[..., right]
            self.held[right] = True

    def _bodies(self) -> None:
        design, structure = self.design, self.structure
        for disk, node in enumerate(structure.disk_node.tolist()):
            y, z, theta_y, theta_z = range(DOF_PER_NODE * node, DOF_PER_NODE * (node + 1))
            for place in (y, z):
                self.M[place, place] += design.disk_mass_change * structure.disk_mass[disk]
            for place in (theta_y, theta_z):
                self.M[place, place] += design.disk_inertia_factor * structure.disk_lumped_diametral[disk]
            polar = design.gyroscopic_factor * structure.disk_lumped_polar[disk]
            self.G[theta_y, theta_z] += polar
            self.G[theta_z, theta_y] -= polar
        for node, mass, half_width in design.masses:
            if not half_width:
                places = [structure.dof(node, plane) for plane in (1, 2)]
                self.M[places, places] += mass
                continue
            for side in (-half_width, half_width):
                self._connect(self.M, [self._beside(node, side, plane) for plane in (1, 2)], mass / 2 * np.eye(2))

    def _fixed_supports(self) -> None:
        """Supports with a stiffness of their own, and bearings replaced by rigid supports."""
        design, structure = self.design, self.structure
        for support, node in enumerate(structure.support_node):
            stiffness, tilt = structure.support_stiffness[support], structure.support_tilt_stiffness[support]
            damping = structure.support_damping[support]
            if np.isnan(stiffness):
                if not design.condition.rigid_support:
                    continue
                stiffness, damping = design.rigid_stiffness, 0.0  # no bearing, no damper
            places = DOF_PER_NODE * int(node) + np.arange(DOF_PER_NODE)
            self._hold(places[:2], stiffness)
            self._hold(places[2:], tilt)
            self.C[places[:2], places[:2]] += damping

    def _hold(self, places: np.ndarray, stiffness: float) -> None:
        if np.isinf(stiffness):
            self.held[places] = True
        else:
            self.K[places, places] += stiffness

    def _bearing(self, bearing: Bearing) -> None:
        _check(bearing)
        points = [shaft_point(self.structure, bearing.x, plane) for plane in (1, 2)]
        shaft = [deflection for deflection, _ in points]
        if np.isinf(bearing.tilt_stiffness):
            tilts = np.concatenate([places for _, (places, _) in points])
            if len(tilts) > len(points):
                raise ValueError(
                    f"the bearing at {bearing.x:g} m holds the shaft's tilt rigidly, and can do so at a node only: "
                    "leave its offset out, or give the support a tilt stiffness"
                )
            self.held[tilts] = True
        elif bearing.tilt_stiffness:
            for _, tilt in points:
                self._connect(self.K, [tilt], np.array([[bearing.tilt_stiffness]]))
        base = self._pedestal(bearing)
        joint = [_difference(a, b) for a, b in zip(shaft, base, strict=True)]
        stiffness, damping = bearing.stiffness * bearing.directions, bearing.damping * np.eye(2)
        flexibility = [local_flexibility(self.structure, bearing.x, plane) for plane in (1, 2)]
        if any(flexibility):
            yielding = np.diag(flexibility) / self.design.modulus_factor
            share = np.linalg.inv(np.eye(2) + stiffness @ yielding)  # of the deflection, the bearing's own
            stiffness, damping = share @ stiffness, share @ damping @ share.T
        self._connect(self.K, joint, stiffness)
        self._connect(self.C, joint, damping)
        for relative, relaxation_time in bearing.branches:
            end = self._new_pair()
            spring = [_difference(a, b) for a, b in zip(shaft, end, strict=True)]
            dashpot = [_difference(a, b) for a, b in zip(end, base, strict=True)]
            self._connect(self.K, spring, relative * stiffness)
            self._connect(self.C, dashpot, relative * relaxation_time * stiffness)
        for law in bearing.laws:
            self._local_force(joint, law, float(stiffness.trace() / 2))

    def _pedestal(self, bearing: Bearing) -> list[Pattern]:
        """The bearing's base in y and z: its pedestal, on the ground or on a block, or the ground."""
        pedestal = bearing.pedestal
        if pedestal is None:
            return [_NOWHERE, _NOWHERE]
        base, below = self._new_pair(), [_NOWHERE, _NOWHERE]
        self._connect(self.M, base, pedestal.mass * np.eye(2))
        if pedestal.has_block:
            below = self._new_pair()
            self._connect(self.M, below, pedestal.block_mass * pedestal.mass * np.eye(2))
            self._connect(self.K, below, pedestal.stiffness / pedestal.block_compliance * np.eye(2))
        leg = [_difference(a, b) for a, b in zip(base, below, strict=True)]
        self._connect(self.K, leg, pedestal.stiffness * np.eye(2))
        self._connect(self.C, leg, pedestal.damping * np.eye(2))
        return base

    def _branch(self, branch: Branch) -> None:
        """A mass on a spring and a damper to a node, and on a damper to the ground, in y and in z."""
        body = self._new_pair()
        spring = [_difference(self._node(branch.node, plane), own) for plane, own in zip((1, 2), body, strict=True)]
        self._connect(self.M, body, branch.mass * np.eye(2))
        self._connect(self.K, spring, branch.stiffness * np.eye(2))
        self._connect(self.C, spring, branch.damping * np.eye(2))
        self._connect(self.C, body, branch.ground_damping * np.eye(2))

    def _new_pair(self) -> list[Pattern]:
        pair: list[Pattern] = [(np.array([self.used + k]), np.ones(1)) for k in (0, 1)]
        self.used += 2
        return pair

    def _node(self, node: int, plane: int) -> Pattern:
        return np.array([self.structure.dof(node, plane)]), np.ones(1)

    def _beside(self, node: int, offset: float, plane: int) -> Pattern:
        structure = self.structure
        structure.dof(node, plane)  # raises where there is no such node
        return shaft_point(structure, float(structure.x[structure.stations[node - 1]]) + offset, plane)[0]

    def _connect(self, matrix: FloatArray, joint: list[Pattern], values: FloatArray) -> None:
        """Add sum values_ab p_a p_b' over the joint's displacements."""
        for (rows, left), line in zip(joint, values.tolist(), strict=True):
            for (columns, right), value in zip(joint, line, strict=True):
                if value:
                    matrix[rows[:, None], columns] += value * left[:, None] * right

    def _local_force(self, joint: list[Pattern], law: JointLaw, stiffness: float) -> None:
        patterns = np.zeros((2, self.size))
        for row, (places, weights) in zip(patterns, joint, strict=True):
            row[places] = weights
        force = LocalForce(law.law, law.coefficients(stiffness), patterns, law.offset(stiffness))
        self.forces.append(force)

    def _sensors(self) -> FloatArray:
        """(2, n_nodes, size) deflection that each node's accelerometer sees."""
        structure = self.structure
        sensors = np.zeros((2, structure.n_nodes, self.size))
        sensors[:, :, : structure.n] = structure.sensors
        for node, offset in self.design.sensor_offsets.items():
            for plane in (1, 2):
                places, weights = self._beside(node, offset, plane)
                sensors[plane - 1, node - 1] = 0.0
                sensors[plane - 1, node - 1, places] = weights
        return sensors

    def _by_speed(self, K: FloatArray, C: FloatArray, free: IntArray) -> SpeedSupports | None:
        """The supports with tables, over the matrices of everything else."""
        tables = self.structure.speed_tables
        dofs = [[self.structure.dof(table.node, plane) for plane in (1, 2)] for table in tables]
        places = tuple(np.flatnonzero(np.isin(free, pair)) for pair in dofs)
        return SpeedSupports(K, C, tables, places) if tables else None

    def _on_free(self) -> RotorModel:
        sensors = self._sensors()
        self._tie(sensors)
        free = np.flatnonzero(~self.held)
        pairs = (self.size - self.structure.n) // 2
        plane = np.concatenate([self.structure.plane, np.tile([1, 2], pairs)]) if pairs else self.structure.plane
        K, C = block(self.K, free), block(self.C, free)
        by_speed = self._by_speed(K, C, free)
        spin_speed = self.design.condition.spin_speed if by_speed else None
        if by_speed:
            K, C = by_speed.at(self.design.condition.spin_speed)
        system = LinearSystem(
            M=block(self.M, free),
            K=K,
            G=block(self.G, free),
            K_shaft=block(self.K_shaft, free),
            C_support=C,
            shaft_damping_ratio=self.design.shaft_damping_ratio,
            free=free,
            plane=plane[free],
            sensors=sensors[:, :, free],
            structure=self.structure,
            by_speed=by_speed,
            spin_speed=spin_speed,
        )
        unbalances = tuple(
            Unbalance(moment, phase, np.array([system.unit_vector(node, plane) for plane in (1, 2)]))
            for node, moment, phase in self.design.unbalances
        )
        forces = tuple(replace(force, patterns=force.patterns[:, free]) for force in self.forces)
        return RotorModel(system, forces, unbalances)


def _check(bearing: Bearing) -> None:
    """A law that replaces the linear stiffness replaces all of it, in every direction alike."""
    laws = [joint.law.name for joint in bearing.laws if joint.law.in_place]
    if len(laws) > 1:
        raise ValueError(f"the laws {' and '.join(laws)} both take the place of k_b; give one of them")
    if laws and not np.array_equal(bearing.directions, np.eye(2)):
        raise ValueError(
            f"the law {laws[0]} takes the place of k_b in every direction alike; it does not go with unequal "
            "stiffnesses in y and z"
        )


_NOWHERE: Pattern = (np.zeros(0, dtype=np.int64), np.zeros(0))


def _angle(node: int, plane: int) -> Pattern:
    """Of the right section against the left one, at the mesh node of a joint."""
    left = DOF_PER_NODE * node + PLANE_PLACES[plane - 1][1]
    return np.array([left + DOF_PER_NODE, left]), PLANE_SIGNS[plane - 1][1] * np.array([1.0, -1.0])


def _difference(a: Pattern, b: Pattern) -> Pattern:
    return np.concatenate([a[0], b[0]]), np.concatenate([a[1], -b[1]])
