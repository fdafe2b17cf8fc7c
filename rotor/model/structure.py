"""The rotor without its supports: full matrices, and the nodes of its parts.

Plain arrays only, so that an FMU can carry them: no file format, no geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.model.arrays import FloatArray, IntArray
from rigtwin.rotor.model.speed_tables import SpeedTable

DOF_PER_NODE = 4  # y, z, theta_y, theta_z

# Coordinates of one element in each plane, as places among its two nodes' eight degrees of
# freedom, with the sign that turns (w, slope) into (deflection, rotation): slope dy/dx is
# +theta_z, slope dz/dx is -theta_y.
PLANE_PLACES = (np.array([0, 3, 4, 7]), np.array([1, 2, 5, 6]))
PLANE_SIGNS = (np.array([1.0, 1.0, 1.0, 1.0]), np.array([1.0, -1.0, 1.0, -1.0]))

# The columns of a support that follows the spin speed.
_TABLES = ("table_support", "table_spin_speed", "table_stiffness", "table_damping")


@dataclass(frozen=True)
class Structure:
    """Free-free rotor, all degrees of freedom ordered node by node as (y, z, theta_y, theta_z).

    Supports are columns of equal length: mesh node, stiffness [N/m] (nan: the parameter k_b; inf:
    rigid), tilt stiffness [N m/rad] (inf: rigid), damping [N s/m].

    A support whose stiffness and damping follow the spin speed has rows of its own: its number (from 0), a spin speed
    [rad/s] and the matrices there in (y, z). The rows of one support stand together, speeds ascending. What the columns
    hold of such a support, stiffness and damping of zero, adds nothing.

    Joints are columns, too: the mesh node on the left, stiffness [N/m], tilt stiffness [N m/rad] (inf: rigid), damping
    [N s/m] and tilt damping [N m s/rad] between it and the next one, which stands at the same position. The element in
    between has no part in M and K.
    """

    M: FloatArray  # (n, n) mass
    K: FloatArray  # (n, n) stiffness of the shaft
    G: FloatArray  # (n, n) gyroscopic, to be multiplied by the spin speed; skew
    K_tension: FloatArray  # (n, n) geometric stiffness per newton of axial tension [1/m]
    x: FloatArray  # (n_mesh,) positions of the mesh nodes [m]
    stations: IntArray  # (n_nodes,) mesh node of each rig node, counted from 0
    bending_stiffness: FloatArray  # (n_mesh - 1, 2) E I in the middle of each element for bending in y, in z [N m^2]
    shear_stiffness: FloatArray  # (n_mesh - 1, 2) kappa G A [N]; inf: no shear flexibility
    flexibility: FloatArray  # (n_mesh - 1, 2, 2, 2) of each element in y and in z, see ``cantilever_flexibility``
    diameter: FloatArray  # (n_mesh - 1,) of a round bar with that bending stiffness in y [m]
    disk_node: IntArray  # (n_disks,) mesh node
    disk_mass: FloatArray  # (n_disks,) [kg]
    disk_thickness: FloatArray  # (n_disks,) length of the hub [m]; zero where not known
    disk_lumped_diametral: FloatArray  # (n_disks,) diametral inertia that M leaves out [kg m^2]
    disk_lumped_polar: FloatArray  # (n_disks,) polar inertia that G leaves out [kg m^2]
    support_node: IntArray  # (n_supports,)
    support_stiffness: FloatArray  # (n_supports,)
    support_tilt_stiffness: FloatArray  # (n_supports,)
    support_damping: FloatArray  # (n_supports,)
    table_support: IntArray  # (n_rows,)
    table_spin_speed: FloatArray  # (n_rows,)
    table_stiffness: FloatArray  # (n_rows, 2, 2) [N/m]
    table_damping: FloatArray  # (n_rows, 2, 2) [N s/m]
    joint_node: IntArray  # (n_joints,)
    joint_stiffness: FloatArray  # (n_joints,)
    joint_tilt_stiffness: FloatArray  # (n_joints,)
    joint_damping: FloatArray  # (n_joints,)
    joint_tilt_damping: FloatArray  # (n_joints,)

    @property
    def tilting_joints(self) -> tuple[tuple[int, float], ...]:
        """Mesh node on the left and tilt stiffness [N m/rad] of the joints whose two sections can turn."""
        joints = zip(self.joint_node.tolist(), self.joint_tilt_stiffness.tolist(), strict=True)
        return tuple((node, stiffness) for node, stiffness in joints if np.isfinite(stiffness))

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return DOF_PER_NODE * len(self.x)

    @cached_property
    def positions(self) -> list[float]:
        """``x`` to search in."""
        return self.x.tolist()

    @cached_property
    def plane(self) -> IntArray:
        """(n,) plane in which each degree of freedom moves, 1 = y or 2 = z."""
        return np.tile([1, 2, 2, 1], len(self.x))

    @cached_property
    def bearings(self) -> tuple[tuple[float, int, float], ...]:
        """Of every support whose stiffness is k_b: position [m], side, tilt stiffness [N m/rad].

        The side is -1 left, +1 right of the middle of all of them, 0 in the middle.
        """
        places = np.flatnonzero(np.isnan(self.support_stiffness))
        x = self.x[self.support_node[places]]
        middle = (x.min() + x.max()) / 2 if len(x) else 0.0
        sides = np.sign(x - middle).astype(int)
        return tuple(zip(x.tolist(), sides.tolist(), self.support_tilt_stiffness[places].tolist(), strict=True))

    @cached_property
    def speed_tables(self) -> tuple[SpeedTable, ...]:
        """Of every support that follows the spin speed, in the order of the supports."""
        return tuple(self._table(int(support)) for support in np.unique(self.table_support))

    def _table(self, support: int) -> SpeedTable:
        rows = self.table_support == support
        node = int(np.flatnonzero(self.stations == self.support_node[support])[0]) + 1
        return SpeedTable(node, self.table_spin_speed[rows], self.table_stiffness[rows], self.table_damping[rows])

    @property
    def spin_range(self) -> tuple[float, float]:
        """Lowest and highest spin speed that all tables of supports hold [rad/s]; (-inf, inf) without tables."""
        tables = self.speed_tables
        low, high = ([float(table.spin_speed[end]) for table in tables] for end in (0, -1))
        return max(low, default=-np.inf), min(high, default=np.inf)

    @property
    def lowest_spin_speed(self) -> float:
        """Spin speed of a rotor of which nobody said how fast it spins [rad/s]: 0, or the lowest of all tables."""
        return max(0.0, self.spin_range[0])

    def with_bearings_for_tables(self) -> Structure:
        """The same with a bearing of stiffness k_b in place of every support that follows the spin speed."""
        rows = np.zeros(0, dtype=np.int64)
        stiffness = self.support_stiffness.copy()
        stiffness[self.table_support] = np.nan
        tables = {name: getattr(self, name)[rows] for name in _TABLES}
        return replace(self, support_stiffness=stiffness, **tables)

    @cached_property
    def sensors(self) -> FloatArray:
        """(2, n_nodes, n) deflection of each node in y and in z."""
        sensors = np.zeros((2, self.n_nodes, self.n))
        for plane in (0, 1):
            sensors[plane, np.arange(self.n_nodes), DOF_PER_NODE * self.stations + plane] = 1.0
        return sensors

    @property
    def n_nodes(self) -> int:
        """Number of rig nodes (those with a number, not the mesh's own)."""
        return len(self.stations)

    @property
    def free_nodes(self) -> tuple[int, ...]:
        """Rig nodes without a support, from 1; they move on rigid supports too."""
        return tuple((np.flatnonzero(~self._supported) + 1).tolist())

    @property
    def supported_nodes(self) -> tuple[int, ...]:
        """Rig nodes with a support, from 1."""
        return tuple((np.flatnonzero(self._supported) + 1).tolist())

    @property
    def bearing_nodes(self) -> tuple[int, ...]:
        """Rig nodes with a support whose stiffness is k_b, from 1."""
        bearings = self.support_node[np.isnan(self.support_stiffness)]
        return tuple((np.flatnonzero(np.isin(self.stations, bearings)) + 1).tolist())

    @property
    def _supported(self) -> NDArray[np.bool_]:
        return np.isin(self.stations, self.support_node)

    def dof(self, node: int, plane: int) -> int:
        """Full index of a rig node's deflection; node from 1, plane 1 = y or 2 = z.

        Raises ValueError when there is no such node or plane.

        >>> assemble(load_rig("nit-rourkela")).dof(node=2, plane=2)
        5
        """
        if not 1 <= node <= self.n_nodes:
            raise ValueError(f"node {node} does not exist: the rotor has nodes 1 to {self.n_nodes}")
        if plane not in (1, 2):
            raise ValueError(f"plane {plane} does not exist: 1 is y, 2 is z")
        return DOF_PER_NODE * int(self.stations[node - 1]) + plane - 1


def to_arrays(structure: Structure) -> dict[str, NDArray]:
    """Arrays of a structure by name, for ``numpy.savez``."""
    return {f.name: getattr(structure, f.name) for f in fields(Structure)}


def from_arrays(arrays: Mapping[str, NDArray]) -> Structure:
    """Structure from the arrays that ``to_arrays`` named."""
    return Structure(**{f.name: arrays[f.name] for f in fields(Structure)})
