"""The rotor in one plane with few coordinates, as a function of bearing stiffness, disk mass and dampings.

q = Psi eta, with a basis Psi that holds the lowest modes at bearing stiffnesses all over the range, so that one basis
serves them all. What the parameters change is exact in it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import DOF_PER_NODE, Structure
from rigtwin.rotor.model.system import LinearSystem, shaft_damping

# Bearing stiffnesses, evenly spaced in the logarithm, whose modes are in the basis and at which the shaft's damping is
# tabulated.
_STIFFNESSES = 33

# Singular value, relative to the largest, below which a direction of the stacked modes is left out.
_LEAST_SHARE = 1e-4


@dataclass(frozen=True)
class ReducedRotor:
    """M eta'' + C eta' + K eta = b f, a = P eta''.

    M = I + (e^mu - 1) M_disks, K = K_shaft + k_b K_bearing, C = d C_bearing + zeta C_shaft(ln k_b).
    """

    M_disks: FloatArray  # (r, r) share of the disks' masses
    K_fixed: FloatArray  # (r, r) shaft, and supports of known stiffness [1/s^2]
    K_bearing: FloatArray  # (r, r) of bearings of 1 N/m
    C_bearing: FloatArray  # (r, r) of bearings of 1 N s/m
    C_shaft: FloatArray  # (n_k, r, r) of the shaft with a damping ratio of 1
    ln_k: FloatArray  # (n_k,) where C_shaft is tabulated
    force: FloatArray  # (r,) unit force at the driven node
    sensors: FloatArray  # (n_nodes, r) deflection of every node

    @property
    def r(self) -> int:
        """Number of coordinates."""
        return len(self.force)

    def stiffness(self, ln_k: float) -> FloatArray:
        """(r, r) K at a bearing stiffness."""
        return self.K_fixed + np.exp(ln_k) * self.K_bearing

    def damping(self, ln_k: float, bearing_damping: float, shaft_damping_ratio: float) -> FloatArray:
        """(r, r) C; the shaft's damping is interpolated between the tabulated stiffnesses."""
        place = float(np.clip(np.interp(ln_k, self.ln_k, np.arange(len(self.ln_k))), 0, len(self.ln_k) - 1))
        left = min(int(place), len(self.ln_k) - 2)
        share = place - left
        shaft = (1 - share) * self.C_shaft[left] + share * self.C_shaft[left + 1]
        return bearing_damping * self.C_bearing + shaft_damping_ratio * shaft

    def mass(self, ln_mass: float) -> FloatArray:
        """(r, r) M with disks e^ln_mass times as heavy."""
        return np.eye(self.r) + np.expm1(ln_mass) * self.M_disks


def reduce_rotor(
    structure: Structure, condition: Condition, k_b: tuple[float, float], highest_hz: float, plane: int = 1
) -> ReducedRotor:
    """A rotor's reduction.

    Parameters
    ----------
    structure : the rotor
    condition : where the force acts; its k_b and dampings are not used
    k_b : range of the bearing stiffness [N/m]
    highest_hz : modes up to here are in the basis, and the one above
    """
    ln_k = np.linspace(*np.log(k_b), _STIFFNESSES)
    systems = [_at(structure, condition, float(np.exp(x)), plane) for x in ln_k]
    shapes = [s.modes.Phi[:, : 1 + int(np.sum(s.modes.omega < 2 * np.pi * highest_hz))] for s in systems]
    root = np.linalg.cholesky(systems[0].M)
    left, shares, _ = np.linalg.svd(root.T @ np.hstack(shapes), full_matrices=False)
    kept = left[:, shares > _LEAST_SHARE * shares[0]]
    Psi = np.linalg.solve(root.T, kept)

    def reduced(matrix: FloatArray) -> FloatArray:
        return Psi.T @ matrix @ Psi

    one = _at(structure, replace(condition, shaft_damping_ratio=1.0), 1.0, plane)
    more = _at(structure, condition, 2.0, plane)
    damped = _at(structure, replace(condition, bearing_damping=1.0), 1.0, plane)
    undamped = _at(structure, replace(condition, bearing_damping=0.0), 1.0, plane)
    K_bearing = more.K - one.K
    disks = np.zeros(structure.n)
    for node, mass in zip(structure.disk_node, structure.disk_mass, strict=True):
        disks[DOF_PER_NODE * node : DOF_PER_NODE * node + 2] += mass
    return ReducedRotor(
        M_disks=reduced(np.diag(disks[one.free])),
        K_fixed=reduced(one.K - K_bearing),
        K_bearing=reduced(K_bearing),
        C_bearing=reduced(damped.C_support - undamped.C_support),
        C_shaft=np.array([reduced(shaft_damping(replace(s, shaft_damping_ratio=1.0))) for s in systems]),
        ln_k=ln_k,
        force=Psi.T @ one.unit_vector(condition.excitation_node, plane),
        sensors=one.read_out(plane) @ Psi,
    )


def _at(structure: Structure, condition: Condition, k_b: float, plane: int) -> LinearSystem:
    return build_system(structure, replace(condition, k_b=k_b, rigid_support=False)).in_plane(plane)
