"""The rotor in one plane with few coordinates, as a tracker carries it: plain arrays, no rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from rigtwin.rotor.model.arrays import FloatArray

# Instants at which a step knows the force.
_FORCES = 3


@dataclass(frozen=True)
class ReducedRotor:
    """M eta'' + C eta' + K eta = nodes[driven] f, a = nodes eta''.

    M = 1 + (e^m - 1) M_disks, K = K_fixed + k_b K_bearing, C = d C_bearing + zeta C_shaft(ln k_b), with disks e^m times
    as heavy, bearings of stiffness k_b [N/m] and damping d [N s/m], and a shaft of damping ratio zeta.
    """

    M_disks: FloatArray  # (r, r) the disks' share
    K_fixed: FloatArray  # (r, r) of the shaft and of supports of known stiffness [1/s^2]
    K_bearing: FloatArray  # (r, r) of bearings of 1 N/m
    C_bearing: FloatArray  # (r, r) of bearings of 1 N s/m
    C_shaft: FloatArray  # (n_k, r, r) of a shaft with a damping ratio of 1
    ln_k: FloatArray  # (n_k,) where C_shaft is given, evenly spaced
    nodes: FloatArray  # (n_nodes, r) deflection of every node, and unit force at it
    scale: FloatArray  # (r,) frequency by which a coordinate is made as large as its velocity [rad/s]
    k_b: FloatArray  # (2,) range that is looked for [N/m]
    highest_hz: FloatArray  # () up to where the coordinates hold the motion

    @property
    def r(self) -> int:
        """Number of coordinates."""
        return len(self.scale)

    def stiffness_and_mass(self, ln_k: float, ln_mass: float) -> tuple[FloatArray, FloatArray]:
        """(r, r) K and M."""
        return self.K_fixed + np.exp(ln_k) * self.K_bearing, np.eye(self.r) + np.expm1(ln_mass) * self.M_disks

    def accelerations(self, at: FloatArray, driven: int, masses: FloatArray | None = None) -> FloatArray:
        """(r, 2 r + 1) M^-1 (-K / scale, -C, force): accelerations from (scale eta, eta', force).

        Parameters
        ----------
        at : (4,) logarithms of k_b, of the disks' masses relative to their own, of each bearing's damping, and of the
            shaft's damping ratio
        driven : node of the force, from 0
        masses : (n_nodes,) attached to the nodes [kg]
        """
        place = float(np.clip((at[0] - self.ln_k[0]) / (self.ln_k[1] - self.ln_k[0]), 0, len(self.ln_k) - 1))
        left = min(int(place), len(self.ln_k) - 2)
        share = place - left
        K, M = self.stiffness_and_mass(float(at[0]), float(at[1]))
        if masses is not None:
            M = M + (self.nodes.T * masses) @ self.nodes
        C_shaft = (1 - share) * self.C_shaft[left] + share * self.C_shaft[left + 1]
        C = np.exp(at[2]) * self.C_bearing + np.exp(at[3]) * C_shaft
        return np.linalg.solve(M, np.column_stack([-K / self.scale, -C, self.nodes[driven]]))

    def a_step(self, rows: FloatArray, h: float) -> FloatArray:
        """(m, 2 r, 2 r + 3) a step of h seconds, from (scale eta, eta') and the force at three instants.

        Parameters
        ----------
        rows : (m, r, 2 r + 1) accelerations, as above
        h : between the instants; the force is a parabola through this one, the one before, and the one to come
        """
        r, n = self.r, 2 * self.r
        A = np.zeros((len(rows), n + _FORCES, n + _FORCES))
        A[:, :r, r:n] = h * np.diag(self.scale)
        A[:, r:n, : n + 1] = h * rows
        A[:, n, n + 1] = A[:, n + 1, n + 2] = 1.0
        E = expm(A)[:, :n]
        held, ramp, bow = np.moveaxis(E[:, :, n:], 2, 0)
        forces = np.stack([bow - ramp / 2, held - 2 * bow, bow + ramp / 2], axis=2)
        return np.concatenate([E[:, :, :n], forces], axis=2)


def to_arrays(rotor: ReducedRotor) -> dict[str, NDArray]:
    """Arrays of a reduced rotor by name, for ``numpy.savez``."""
    return {field.name: getattr(rotor, field.name) for field in fields(ReducedRotor)}


def from_arrays(arrays: Mapping[str, NDArray]) -> ReducedRotor:
    """The reduced rotor that ``to_arrays`` named."""
    return ReducedRotor(**{field.name: arrays[field.name] for field in fields(ReducedRotor)})
