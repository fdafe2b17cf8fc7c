"""The rotor in one plane with few coordinates, as a function of bearing stiffness, disk masses and dampings.

q = Psi eta, with a basis Psi that holds the lowest modes at bearing stiffnesses all over the range, so that one basis
serves them all. What the parameters change is exact in it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigtwin.estimator.tracking.reduced_rotor import ReducedRotor
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import DOF_PER_NODE, Structure
from rigtwin.rotor.model.system import LinearSystem

# Bearing stiffnesses, evenly spaced in the logarithm, whose modes are in the basis and at which the shaft's damping is
# tabulated.
_STIFFNESSES = 33

# Singular value, relative to the largest, below which a direction of the stacked modes is left out; and the most
# coordinates that a tracker has room for.
_LEAST_SHARE, MOST_COORDINATES = 1e-4, 8


def reduce_rotor(structure: Structure, k_b: tuple[float, float], highest_hz: float, plane: int = 1) -> ReducedRotor:
    """A rotor on its bearings with few coordinates.

    Parameters
    ----------
    structure : the rotor
    k_b : range of the bearing stiffness [N/m]
    highest_hz : modes up to here are in the basis, and the one above
    plane : of the motion, 1 = y, 2 = z
    """
    condition = Condition()
    low, high = np.log(k_b).tolist()
    ln_k = np.linspace(low, high, _STIFFNESSES)
    systems = [_at(structure, condition, float(np.exp(x)), plane) for x in ln_k]
    shapes = [s.modes.Phi[:, : 1 + int(np.sum(s.modes.omega < 2 * np.pi * highest_hz))] for s in systems]
    root = np.linalg.cholesky(systems[0].M)
    left, shares, _ = np.linalg.svd(root.T @ np.hstack(shapes), full_matrices=False)
    kept = left[:, shares > _LEAST_SHARE * shares[0]][:, :MOST_COORDINATES]
    Psi = np.linalg.solve(root.T, kept)

    def reduced(matrix: FloatArray) -> FloatArray:
        return Psi.T @ matrix @ Psi

    one, two = (_at(structure, condition, stiffness, plane) for stiffness in (1.0, 2.0))
    damped, undamped = (
        _at(structure, replace(condition, bearing_damping=damping), 1.0, plane) for damping in (1.0, 0.0)
    )
    K_bearing, K_fixed = reduced(two.K - one.K), reduced(2 * one.K - two.K)
    disks = np.zeros(structure.n)
    np.add.at(disks, DOF_PER_NODE * structure.disk_node + plane - 1, structure.disk_mass)
    return ReducedRotor(
        M_disks=reduced(np.diag(disks[one.free])),
        K_fixed=K_fixed,
        K_bearing=K_bearing,
        C_bearing=reduced(damped.C_support - undamped.C_support),
        C_shaft=np.array([reduced(_of_the_shaft(s)) for s in systems]),
        ln_k=ln_k,
        nodes=one.read_out(plane) @ Psi,
        scale=np.sqrt(np.diag(K_fixed + np.exp(ln_k.mean()) * K_bearing)),
        k_b=np.array(k_b),
        highest_hz=np.array(highest_hz),
    )


def _at(structure: Structure, condition: Condition, k_b: float, plane: int) -> LinearSystem:
    return build_system(structure, replace(condition, k_b=k_b, rigid_support=False)).in_plane(plane)


def _of_the_shaft(system: LinearSystem) -> FloatArray:
    """Damping of the shaft alone, for a damping ratio of 1."""
    damped = replace(system, shaft_damping_ratio=1.0)
    return damped.C - damped.C_support
