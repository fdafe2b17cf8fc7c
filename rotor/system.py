"""One support condition of the rotor: constrained matrices and the damping operator.

Everything that solves the rotor, in frequency or in time, inside an FMU or outside, starts from
the same ``LinearSystem``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.csgraph import connected_components

from rotor.structure import DOF_PER_NODE, FloatArray, IntArray, Structure


@dataclass(frozen=True)
class Condition:
    """How the rotor is held: the parameters a test condition can change.

    k_b [N/m] and bearing_damping [N s/m] belong to every bearing, in y and z alike;
    ``rigid_support`` pins the bearings instead. shaft_damping_ratio [-] is the shaft's own.
    """

    k_b: float = 1e7
    rigid_support: bool = False
    bearing_damping: float = 0.0
    shaft_damping_ratio: float = 0.001

    def __post_init__(self) -> None:
        if not (np.isfinite(self.k_b) and self.k_b > 0):
            raise ValueError(f"k_b must be a positive stiffness in N/m, got {self.k_b}")
        for name in ("bearing_damping", "shaft_damping_ratio"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name} must not be negative, got {value}")


@dataclass(frozen=True)
class LinearSystem:
    """M q'' + (C + Omega G) q' + K q = f on the degrees of freedom that are free to move."""

    M: FloatArray  # (n, n)
    K: FloatArray  # (n, n) shaft and supports
    C: FloatArray  # (n, n) shaft and bearing damping
    G: FloatArray  # (n, n) gyroscopic, per unit spin speed
    K_shaft: FloatArray  # (n, n) the shaft's share of K
    C_support: FloatArray  # (n, n) the supports' share of C
    shaft_damping_ratio: float
    free: IntArray  # (n,) full index of each degree of freedom
    structure: Structure

    @property
    def n(self) -> int:
        """Number of free degrees of freedom."""
        return len(self.free)

    def unit_vector(self, node: int, plane: int) -> FloatArray:
        """(n,) unit force at, or read-out of, a node (from 1) in plane 1 = y or 2 = z.

        Zero where a rigid support holds the node. Raises ValueError when it does not exist.
        """
        return (self.free == self.structure.dof(node, plane)).astype(float)

    def read_out(self, plane: int) -> FloatArray:
        """(n_nodes, n) map from the free degrees of freedom to every node's deflection."""
        return np.array([self.unit_vector(node, plane) for node in range(1, self.structure.n_nodes + 1)])


@dataclass(frozen=True)
class Modes:
    """Undamped modes of the non-spinning rotor, lowest first."""

    omega: FloatArray  # (n_modes,) natural frequencies [rad/s]
    Phi: FloatArray  # (n, n_modes) mass-normalised: Phi' M Phi = 1


def build_system(structure: Structure, condition: Condition) -> LinearSystem:
    """Put the rotor on its supports and build its damping.

    A rigid support removes the degree of freedom: a stiff spring would leave float64 with
    frequencies off by 1e-7 and an undamped mode at the support.
    """
    K_support, C_support, held = _supports(structure, condition)
    free = np.flatnonzero(~held)
    keep = np.ix_(free, free)
    undamped = LinearSystem(
        M=structure.M[keep],
        K=(structure.K + K_support)[keep],
        C=C_support[keep],
        G=structure.G[keep],
        K_shaft=structure.K[keep],
        C_support=C_support[keep],
        shaft_damping_ratio=condition.shaft_damping_ratio,
        free=free,
        structure=structure,
    )
    return replace(undamped, C=undamped.C_support + shaft_damping(undamped))


def _supports(structure: Structure, condition: Condition) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Support stiffness and damping on the full degrees of freedom, and which of them are held."""
    n = len(structure.M)
    K, C, held = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n, dtype=bool)
    for node, stiffness, tilt_stiffness, damping in zip(
        structure.support_node,
        structure.support_stiffness,
        structure.support_tilt_stiffness,
        structure.support_damping,
        strict=True,
    ):
        bearing = np.isnan(stiffness)
        if bearing:
            stiffness = np.inf if condition.rigid_support else condition.k_b
            damping = condition.bearing_damping
        deflections = DOF_PER_NODE * int(node) + np.array([0, 1])
        for places, value in ((deflections, stiffness), (deflections + 2, tilt_stiffness)):
            if np.isinf(value):
                held[places] = True
            else:
                K[places, places] += value
        C[deflections, deflections] += damping
    return K, C, held


def undamped_modes(system: LinearSystem) -> Modes:
    """Undamped modes, each in one plane where the planes do not couple.

    Solving plane by plane keeps degenerate y and z modes apart, so that a force in y leaves z
    exactly at rest.
    """
    n_groups, group = connected_components((system.M != 0) | (system.K != 0))
    omega, Phi = np.zeros(system.n), np.zeros((system.n, system.n))
    column = 0
    for g in range(n_groups):
        places = np.flatnonzero(group == g)
        block = np.ix_(places, places)
        squares, shapes = eigh(system.K[block], system.M[block])
        columns = slice(column, column + len(places))
        omega[columns] = np.sqrt(np.clip(squares, 0.0, None))
        Phi[places, columns] = shapes
        column += len(places)
    order = np.argsort(omega, kind="stable")
    return Modes(omega[order], Phi[:, order])


def shaft_damping(system: LinearSystem) -> FloatArray:
    """Viscous matrix of the shaft's damping ratio zeta.

    C_s = M Phi [2 zeta (Phi' K_s Phi)_ij / sqrt(omega_i omega_j)] Phi' M, with K_s the shaft's
    stiffness and Phi, omega the undamped modes of the supported, non-spinning rotor: the diagonal
    is 2 zeta omega times the shaft's share of the mode's strain energy, so that a mode that lives
    in the bearings is damped by the bearings alone (see docs/theory.md).

    Returns
    -------
    (n, n) damping matrix [N s/m]
    """
    modes = undamped_modes(system)
    moving = modes.omega > 1e-6 * modes.omega.max()  # a rigid-body mode strains nothing
    Phi, root = modes.Phi[:, moving], np.sqrt(modes.omega[moving])
    shaft_energy = Phi.T @ system.K_shaft @ Phi  # (m, m)
    modal = 2 * system.shaft_damping_ratio * shaft_energy / np.outer(root, root)
    MPhi = system.M @ Phi
    return MPhi @ modal @ MPhi.T
