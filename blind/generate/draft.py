"""A rotor ready to be shaken, and its matrices while they are put together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg

from rigtwin.blind.generate.beam import Shaft
from rigtwin.blind.generate.rig import PLANS, REFERENCE, ComplexArray, FloatArray

N_MODES = 20  # of the poles
DynamicStiffness = Callable[[FloatArray], ComplexArray]


@dataclass(frozen=True)
class Joint:
    """Where a nonlinear force acts, and the linear stiffness there that it replaces or adds to."""

    row: FloatArray  # (n,) reads the joint's displacement
    stiffness: float  # [N/m] linear stiffness of the joint, already in K


@dataclass(frozen=True)
class Machine:
    """A rotor ready to be shaken; n coordinates in one plane."""

    M: FloatArray  # (n, n)
    C: FloatArray  # (n, n) dampers of supports, without the shaft's
    K: FloatArray  # (n, n) static stiffness
    K_shaft: FloatArray  # (n, n) share of it that is strain energy of the shaft
    zeta: float
    drive: FloatArray  # (n,)
    read: FloatArray  # (n_nodes, n) deflections at the rig's nodes
    springs: tuple[tuple[FloatArray, DynamicStiffness], ...] = ()
    bearings: tuple[Joint, ...] = ()
    band_hz: tuple[float, float] = PLANS[REFERENCE].band_hz  # in which it is tested
    rotations: tuple[int, ...] = ()  # coordinates that are rotations of cross-sections
    omega: FloatArray = field(init=False)  # (n,) undamped
    Phi: FloatArray = field(init=False)  # (n, n) mass-normalised
    C_shaft: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        squares, Phi = scipy.linalg.eigh(self.K, self.M)
        omega = np.sqrt(np.maximum(squares, 1e-12))
        root = np.sqrt(omega)
        modal = 2 * self.zeta * (Phi.T @ self.K_shaft @ Phi) / np.outer(root, root)
        MPhi = self.M @ Phi
        object.__setattr__(self, "omega", omega)
        object.__setattr__(self, "Phi", Phi)
        object.__setattr__(self, "C_shaft", MPhi @ modal @ MPhi.T)

    def stiffness_of_drift(self, drift: FloatArray) -> FloatArray:
        """(n, n) stiffness that moves the r-th undamped frequency to (1 + drift_r) times itself and keeps its shape.

        K' = K + sum_r ((1 + drift_r)^2 - 1) omega_r^2 (M phi_r)(M phi_r)^T
        """
        m = min(len(drift), len(self.omega))
        shapes = self.M @ self.Phi[:, :m]
        return (shapes * (((1 + drift[:m]) ** 2 - 1) * self.omega[:m] ** 2)) @ shapes.T

    def dynamic_stiffness(self, omega: FloatArray, drift: FloatArray | None = None) -> ComplexArray:
        """(n_freq, n, n)"""
        w = omega[:, None, None]
        K = self.K if drift is None else self.K + self.stiffness_of_drift(drift)
        D = (K - w**2 * self.M).astype(complex) + 1j * w * (self.C + self.C_shaft)
        for row, spring in self.springs:
            D = D + spring(omega)[:, None, None] * np.outer(row, row)
        return np.asarray(D, dtype=complex)

    def receptance(self, omega: FloatArray, drift: FloatArray | None = None) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, n_nodes) displacement at the nodes and (n_freq,) at the exciter, per newton."""
        load = np.broadcast_to(self.drive[:, None].astype(complex), (len(omega), len(self.drive), 1))
        q = np.linalg.solve(self.dynamic_stiffness(omega, drift), load)[:, :, 0]
        return q @ self.read.T, q @ self.drive

    def poles(self) -> ComplexArray:
        """(2m,) eigenvalues [rad/s] on the lowest modes, frequency-dependent springs left out."""
        Phi = self.Phi[:, :N_MODES]
        m = Phi.shape[1]
        A = np.zeros((2 * m, 2 * m))
        A[:m, m:] = np.eye(m)
        A[m:, :m], A[m:, m:] = -Phi.T @ self.K @ Phi, -Phi.T @ (self.C + self.C_shaft) @ Phi
        return np.asarray(np.linalg.eigvals(A), dtype=complex)


class Draft:
    """Matrices while they are put together; supports may append coordinates."""

    def __init__(self, shaft: Shaft) -> None:
        self.M, self.K, self.K_shaft = shaft.M.copy(), shaft.K.copy(), shaft.K.copy()
        self.C = np.zeros_like(self.M)
        self.springs: list[tuple[FloatArray, DynamicStiffness]] = []
        self.joints: list[Joint] = []
        self.shaft = shaft
        self.rotations = sorted({i for stretch in shaft.stretches for i in stretch.s})

    def widen(self, row: FloatArray) -> FloatArray:
        return np.pad(row, (0, len(self.M) - len(row)))

    def unit(self, coordinate: int) -> FloatArray:
        return np.eye(1, len(self.M), coordinate)[0]

    def add_coordinate(self, mass: float) -> FloatArray:
        """Append a coordinate with this mass; its row."""
        self.M, self.C, self.K, self.K_shaft = (
            np.pad(matrix, (0, 1)) for matrix in (self.M, self.C, self.K, self.K_shaft)
        )
        self.M[-1, -1] = mass
        return self.unit(len(self.M) - 1)

    def mass(self, row: FloatArray, mass: float) -> None:
        row = self.widen(row)
        self.M += mass * np.outer(row, row)

    def spring(self, row: FloatArray, stiffness: float, damping: float = 0.0) -> None:
        row = self.widen(row)
        self.K += stiffness * np.outer(row, row)
        self.C += damping * np.outer(row, row)

    def finish(
        self,
        zeta: float,
        drive: FloatArray,
        read: Sequence[FloatArray],
        held: Sequence[FloatArray],
        band_hz: tuple[float, float],
    ) -> Machine:
        """Remove the held coordinates (rows with a single one) and make the machine."""
        gone = [int(np.argmax(np.abs(row))) for row in held]
        free = np.setdiff1d(np.arange(len(self.M)), gone)
        grid = np.ix_(free, free)
        return Machine(
            self.M[grid],
            self.C[grid],
            self.K[grid],
            self.K_shaft[grid],
            zeta,
            self.widen(drive)[free],
            np.array([self.widen(r)[free] for r in read]),
            tuple((self.widen(row)[free], spring) for row, spring in self.springs),
            tuple(replace(joint, row=self.widen(joint.row)[free]) for joint in self.joints),
            band_hz,
            tuple(np.flatnonzero(np.isin(free, self.rotations)).tolist()),
        )
