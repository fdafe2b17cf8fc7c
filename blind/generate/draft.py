"""Matrices of a rotor while they are put together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigtwin.blind.generate.beam import Shaft
from rigtwin.blind.generate.rig import ComplexArray, FloatArray

DynamicStiffness = Callable[[FloatArray], ComplexArray]


@dataclass(frozen=True)
class Joint:
    """Where a nonlinear force acts, and the linear stiffness there that it replaces or adds to."""

    row: FloatArray  # (n,) reads the joint's displacement
    stiffness: float  # [N/m] linear stiffness of the joint, already in K


class Draft:
    """Matrices while they are put together; supports may append coordinates."""

    def __init__(self, shaft: Shaft) -> None:
        self.M, self.K, self.K_shaft = shaft.M.copy(), shaft.K.copy(), shaft.K.copy()
        self.C = np.zeros_like(self.M)
        self.springs: list[tuple[FloatArray, DynamicStiffness]] = []
        self.joints: list[Joint] = []
        self.shaft = shaft

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

    def finish(self, zeta: float, drive: FloatArray, read: Sequence[FloatArray], held: Sequence[FloatArray]) -> Machine:
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
        )
