"""The supported linear rotor: constrained matrices, its undamped modes and its damping operator.

Everything that solves the rotor, in frequency or in time, inside an FMU or outside, starts from
the same ``LinearSystem``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, lapack, qr

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.speed_tables import SpeedSupports
from rigtwin.rotor.model.structure import Structure

# Largest strain energy, relative to the sum of its unsigned parts, that counts as round-off. A mode with so little
# is a rigid-body motion; a more negative one means buckling. The first mode of a beam of n elements has 2 / n^4.
_NO_STRAIN = 1e-12

# Ratio of the lowest to the highest eigenvalue below which one solution cannot be accurate for both.
_WIDE = 1e-12


def block(matrix: FloatArray, rows: IntArray, columns: IntArray | None = None) -> FloatArray:
    """(n_rows, n_columns) of a matrix; the columns are the rows where none are given."""
    return matrix.take(rows, axis=0).take(rows if columns is None else columns, axis=1)


def work(matrix: FloatArray, shapes: FloatArray | ComplexArray) -> FloatArray:
    """(m,) quadratic form of a symmetric matrix (n, n) in each shape of (n, m), real or complex: twice an energy."""
    return np.sum(shapes.conj() * (matrix @ shapes), axis=0).real


@dataclass(frozen=True)
class LinearSystem:
    """M q'' + (C + Omega G) q' + K q = f on the degrees of freedom that are free to move.

    Supports may follow the spin speed: K and ``C_support`` are then those of one speed, and ``at`` gives others. Their
    K need not be symmetric. Its symmetric part is the one that stores energy; the undamped modes are that part's.
    """

    M: FloatArray  # (n, n)
    K: FloatArray  # (n, n) shaft and supports
    G: FloatArray  # (n, n) gyroscopic, per unit spin speed
    K_shaft: FloatArray  # (n, n) the shaft's share of K
    C_support: FloatArray  # (n, n) the supports' damping
    shaft_damping_ratio: float
    free: IntArray  # (n,) full index of each degree of freedom; beyond the structure's: pedestals and the like
    plane: IntArray  # (n,) plane each degree of freedom moves in, 1 = y or 2 = z
    sensors: FloatArray  # (2, n_nodes, n) deflection that the accelerometer of each plane and node sees
    structure: Structure
    by_speed: SpeedSupports | None = None  # the supports that follow the spin speed
    spin_speed: float | None = None  # that these supports belong to [rad/s]; None: there are none

    def at(self, spin_speed: float) -> LinearSystem:
        """The rotor at a spin speed [rad/s]: itself unless supports follow the speed.

        Raises SpinSpeedError outside a support's table.
        """
        if self.spin_speed is None or spin_speed == self.spin_speed:
            return self
        if self.by_speed is None:
            raise ValueError("a rotor in one plane stays at its spin speed: take the plane after the speed")
        K, C = self.by_speed.at(spin_speed)
        return replace(self, K=K, C_support=C, spin_speed=float(spin_speed))

    @cached_property
    def circulatory(self) -> FloatArray | None:
        """(n, n) skew part of K, which puts energy into whirl in one direction; None where K is symmetric."""
        skew = (self.K - self.K.T) / 2 if self.spin_speed is not None else np.zeros(0)
        return skew if skew.any() else None

    @property
    def n(self) -> int:
        """Number of free degrees of freedom."""
        return len(self.free)

    @cached_property
    def heavy(self) -> IntArray:
        """(n_heavy,) degrees of freedom with mass."""
        return np.flatnonzero(self.M.diagonal())

    @cached_property
    def massless(self) -> IntArray:
        """(n - n_heavy,) degrees of freedom without mass: ends of dashpots in series with springs."""
        return np.flatnonzero(self.M.diagonal() == 0)

    @cached_property
    def slide(self) -> FloatArray:
        """(n_massless, n_heavy) static position of the massless degrees of freedom, -K_ll^-1 K_lh."""
        light = self.massless
        if not len(light):
            return np.zeros((0, self.n))
        return -np.linalg.solve(block(self.K, light), block(self.K, light, self.heavy))

    @property
    def condensed_stiffness(self) -> FloatArray:
        """(n_heavy, n_heavy) stiffness of the degrees of freedom with mass, the massless ones following statically."""
        if not len(self.massless):
            return self.K
        heavy, light = self.heavy, self.massless
        return block(self.K, heavy) + block(self.K, heavy, light) @ self.slide

    @cached_property
    def modes(self) -> Modes:
        """See ``undamped_modes``."""
        return undamped_modes(self)

    @cached_property
    def C(self) -> FloatArray:
        """(n, n) damping of shaft and supports."""
        return self.C_support + shaft_damping(self)

    def unit_vector(self, node: int, plane: int) -> FloatArray:
        """(n,) unit force at, or deflection of, a node (from 1) in plane 1 = y or 2 = z.

        Zero where a rigid support holds the node. Raises ValueError when it does not exist.
        """
        return (self.free == self.structure.dof(node, plane)).astype(float)

    def read_out(self, plane: int) -> FloatArray:
        """(n_nodes, n) map from the free degrees of freedom to what every node's accelerometer sees."""
        return self.sensors[plane - 1]

    def couples_planes(self, spin_speed: float = 0.0) -> bool:
        """Whether the motions in y and in z are coupled; supports are taken as they are, at their own speed."""
        y, z = (np.flatnonzero(self.plane == plane) for plane in (1, 2))
        if not len(y) or not len(z):
            return False
        matrices = (self.M, self.K, self.C_support, *([self.G] if spin_speed else []))
        return any(block(matrix, *places).any() for matrix in matrices for places in ((y, z), (z, y)))

    def plane_of_motion(self, pattern: ComplexArray | FloatArray, spin_speed: float = 0.0) -> int | None:
        """Plane in which a force with pattern (n,) moves the rotor, 1 for no force; None where it moves both planes."""
        driven = {int(plane) for plane in self.plane[pattern != 0]}
        if self.couples_planes(spin_speed) or len(driven) > 1:
            return None
        return driven.pop() if driven else 1

    def in_plane(self, plane: int) -> LinearSystem:
        """The rotor's motion in one plane, for planes that do not couple."""
        keep = np.flatnonzero(self.plane == plane)
        matrices = {name: block(getattr(self, name), keep) for name in ("M", "K", "G", "K_shaft", "C_support")}
        parts = {"free": self.free[keep], "plane": self.plane[keep], "sensors": self.sensors[:, :, keep]}
        return replace(self, **matrices, **parts, by_speed=None)


@dataclass(frozen=True)
class Modes:
    """Undamped modes of the non-spinning rotor, lowest first."""

    omega: FloatArray  # (n_heavy,) natural frequencies [rad/s], 0 of a rigid-body motion
    Phi: FloatArray  # (n, n_heavy) mass-normalised: Phi' M Phi = 1

    @property
    def elastic(self) -> NDArray[np.bool_]:
        """(n_heavy,) whether a mode strains the shaft or its supports; the others are rigid-body motions."""
        return self.omega > 0


def undamped_modes(system: LinearSystem) -> Modes:
    """Undamped modes, each in one plane where the planes do not couple.

    Solving plane by plane keeps degenerate y and z modes apart, so that a force in y leaves z
    exactly at rest. Massless degrees of freedom follow statically. Of a K that is not symmetric, the symmetric part
    counts.

    Raises ValueError when the stiffness is negative: the rotor buckles.
    """
    heavy = system.heavy
    M, K = block(system.M, heavy), system.condensed_stiffness
    if system.circulatory is not None:
        K = (K + K.T) / 2
    groups = [np.flatnonzero(system.plane[heavy] == plane) for plane in (1, 2)]
    if system.couples_planes():
        groups = [np.arange(len(heavy))]
    omega, Phi = np.zeros(len(heavy)), np.zeros((len(heavy), len(heavy)))
    column = 0
    for places in groups:
        squares, shapes = _natural(block(K, places), block(M, places))
        columns = slice(column, column + len(places))
        omega[columns] = np.sqrt(np.maximum(squares, 0.0))
        Phi[places, columns] = shapes
        column += len(places)
    order = np.argsort(omega, kind="stable")
    every = np.zeros((system.n, len(heavy)))
    every[heavy] = Phi[:, order]
    if len(system.massless):
        every[system.massless] = system.slide @ Phi[:, order]
    return Modes(omega[order], every)


def _natural(K: FloatArray, M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squares of the natural frequencies, ascending, and mass-normalised shapes.

    The inverse problem M phi = K phi / omega^2 is solved, because round-off is relative to the largest eigenvalue: the
    lowest frequencies are then accurate to 1e-13 and not to 1e-11. The highest modes are corrected afterwards. They are
    made orthogonal from the lowest up, and their frequencies come from Rayleigh's quotient or, where the shaft has
    almost no mass, from the direct problem. ``_floating`` solves a rotor with rigid-body motions.
    """
    if not len(M):
        return np.zeros(0), np.zeros((0, 0))
    try:
        inverse, shapes = eigh(M, K, check_finite=False)
    except np.linalg.LinAlgError:
        return _floating(K, M)
    if strain_share(K, shapes[:, -1:])[0] <= _NO_STRAIN:
        return _floating(K, M)
    wide = inverse[0] <= _WIDE * inverse[-1]
    inverse, shapes = inverse[::-1], np.ascontiguousarray(shapes[:, ::-1])
    high = inverse < np.sqrt(max(inverse[-1], _WIDE**2 * inverse[0]) * inverse[0])
    if wide:
        shapes[:, high] = eigh(K, M)[1][:, high]
        inverse = np.where(high, 1.0, inverse)
    shapes /= np.sqrt(inverse)
    shapes = _against_lower(np.linalg.cholesky(shapes.T @ M @ shapes), shapes)
    return np.where(high, work(K, shapes), 1 / inverse), shapes


def _against_lower(L: FloatArray, shapes: FloatArray) -> FloatArray:
    """Shapes (n, m) made orthogonal from the first up, with the Cholesky factor L (m, m) of their products."""
    return lapack.dtrtrs(L, shapes.T, lower=True)[0].T  # pyright: ignore[reportAttributeAccessIssue]


def strain_share(K: FloatArray, shapes: FloatArray) -> FloatArray:
    """(m,) strain energy of shapes (n, m), divided by the sum of its parts without their signs.

    >>> spring = np.array([[1.0, -1.0], [-1.0, 1.0]])  # between two masses, which move together or against each other
    >>> strain_share(spring, shapes=np.array([[1.0, 1.0], [1.0, -1.0]]))
    array([0., 1.])
    """
    size = work(np.abs(K), np.abs(shapes))
    return work(K, shapes) / np.where(size > 0, size, 1.0)


def _floating(K: FloatArray, M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same for a rotor whose K is singular: its rigid-body motions, and the modes orthogonal to them.

    Raises ValueError when the stiffness is negative: the rotor buckles.
    """
    diagonal = np.abs(K.diagonal())
    stiff = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))  # makes entries of similar size, whatever their units
    motions = stiff[:, None] * eigh(stiff[:, None] * K * stiff)[1]
    shares = strain_share(K, motions)
    if shares.min() < -_NO_STRAIN:
        raise ValueError(
            "the rotor buckles: its stiffness is negative; reduce the axial compression or the negative stiffness"
        )
    rigid = motions[:, shares <= _NO_STRAIN]
    n_rigid = rigid.shape[1]
    if not n_rigid:
        return eigh(K, M)
    rigid = _against_lower(np.linalg.cholesky(rigid.T @ M @ rigid), rigid)
    others = _orthogonal_to(rigid.T @ M, 1 / np.sqrt(M.diagonal()))
    squares, shapes = _natural(others.T @ K @ others, others.T @ M @ others)
    return np.concatenate([np.zeros(n_rigid), squares]), np.hstack([rigid, others @ shapes])


def _orthogonal_to(rows: FloatArray, size: FloatArray) -> FloatArray:
    """(n, n - m) shapes orthogonal to rows (m, n): each moves one coordinate, and m common ones as far as needed.

    Light and heavy coordinates are kept apart, so that round-off of the light ones does not spoil the heavy ones.

    Parameters
    ----------
    size : (n,) motion of each coordinate at a kinetic energy of one
    """
    m, n = rows.shape
    order = qr(rows * size, mode="r", pivoting=True)[-1]
    common, own = order[:m], order[m:]
    shapes = np.zeros((n, n - m))
    shapes[own, np.arange(n - m)] = 1.0
    shapes[common] = -np.linalg.solve(rows[:, common], rows[:, own])
    return shapes


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
    modes = system.modes
    strained = modes.elastic  # a rigid-body mode strains nothing
    Phi, root = modes.Phi[:, strained], np.sqrt(modes.omega[strained])
    shaft_energy = Phi.T @ system.K_shaft @ Phi  # (m, m)
    modal = 2 * system.shaft_damping_ratio * shaft_energy / np.outer(root, root)
    MPhi = system.M @ Phi
    return MPhi @ modal @ MPhi.T
