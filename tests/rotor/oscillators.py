"""Masses on springs whose nonlinear motion is known in closed form or by direct integration."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from rigtwin.rotor.frequency.harmonic_balance import Balance, Motions
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.force_laws import BILINEAR, CLEARANCE, CONTACT, CUBIC, HERTZ, JENKINS, ForceLaw
from rigtwin.rotor.model.local_force import LocalForce
from rigtwin.rotor.model.rotor_model import RotorModel
from rigtwin.rotor.model.system import LinearSystem
from tests.rotor.rigs import paper_structure

# A kilogram on 1e4 N/m: 100 rad/s, 15.9 Hz.
MASS, STIFFNESS = 1.0, 1e4
OMEGA_0 = math.sqrt(STIFFNESS / MASS)
F_0 = OMEGA_0 / (2 * math.pi)
# The oscillators' masses are the rotor's nodes from 2 on: the exciter and the first sensor are at the first mass.
CONDITION = Condition()


def masses(M: FloatArray, K: FloatArray, C: FloatArray, *forces: LocalForce, planes: int = 1) -> RotorModel:
    """Masses that move in y, or the first half of them in y and the second in z."""
    structure = paper_structure()
    n = len(M) // planes
    plane = np.repeat(np.arange(1, planes + 1), n)
    nodes = np.tile(np.arange(2, n + 2), planes)
    sensors = np.zeros((2, structure.n_nodes, len(M)))
    sensors[plane - 1, nodes - 1, np.arange(len(M))] = 1.0
    free = np.array([structure.dof(int(node), int(p)) for node, p in zip(nodes, plane, strict=True)])
    zero = np.zeros_like(M)
    system = LinearSystem(M, K, zero, zero, C, 0.0, free, plane, sensors, structure)
    return RotorModel(system, forces)


def oscillator(damping_ratio: float, *laws: tuple[ForceLaw, tuple[float, ...]]) -> RotorModel:
    """One mass on a spring, with force laws beside it."""
    pattern = np.array([[1.0], [0.0]])
    forces = (LocalForce(law, coefficients, pattern) for law, coefficients in laws)
    damping = 2 * damping_ratio * OMEGA_0 * MASS
    M, K, C = (np.array([[value]]) for value in (MASS, STIFFNESS, damping))
    return masses(M, K, C, *forces)


def two_masses(law: ForceLaw, coefficients: tuple[float, ...]) -> RotorModel:
    """Two masses in a row between walls; the law acts between them."""
    K = STIFFNESS * np.array([[2.0, -1.0], [-1.0, 2.5]])
    between = np.array([[1.0, -1.0], [0.0, 0.0]])
    return masses(MASS * np.diag([1.0, 1.5]), K, 5e-4 * K, LocalForce(law, coefficients, between))


def cubic(k3: float) -> tuple[ForceLaw, tuple[float, ...]]:
    return CUBIC, (k3,)


def clearance(gap: float, corner: float = 1e-9) -> tuple[ForceLaw, tuple[float, ...]]:
    return CLEARANCE, (STIFFNESS, gap, corner)


def contact(ratio: float, gap: float) -> tuple[ForceLaw, tuple[float, ...]]:
    return CONTACT, (ratio * STIFFNESS, gap, 1e-6 * gap)


def bilinear(ratio: float, corner: float = 1e-12) -> tuple[ForceLaw, tuple[float, ...]]:
    return BILINEAR, (STIFFNESS, ratio, corner)


def hertz(preload: float) -> tuple[ForceLaw, tuple[float, ...]]:
    return HERTZ, (STIFFNESS, preload, 1e-6 * preload)


def jenkins(stiffness: float, limit: float) -> tuple[ForceLaw, tuple[float, ...]]:
    return JENKINS, (stiffness, limit)


def swing(motions: Motions, samples: int = 2000) -> FloatArray:
    """(n,) half the distance between the turning points of the first joint [m]."""
    k = np.arange(motions.joints.shape[1])
    phase = np.exp(2j * np.pi * np.outer(k, np.arange(samples)) / samples)
    x = np.real(motions.joints[:, :, 0] @ phase)
    return np.ptp(x, axis=1) / 2


def integrated(
    balance: Balance, motion: Motions, periods: int, law: Callable[[float], float], joint: FloatArray
) -> FloatArray:
    """Harmonics 0 to 3 of every mass after direct integration from the state of harmonic balance.

    Parameters
    ----------
    motion : one motion of the balance
    law : force of the joint's displacement [N]
    joint : (n,) displacement of the joint by the masses
    """
    system, hz = balance.system, float(motion.frequency_hz[0])
    inverse, n = np.linalg.inv(system.M), system.n
    force = motion.force_amplitude * system.unit_vector(2, 1)

    def rate(t: float, state: FloatArray) -> FloatArray:
        q, v = state[:n], state[n:]
        pull = force * math.cos(2 * math.pi * hz * t) - system.K @ q - system.C @ v - joint * law(float(joint @ q))
        return np.concatenate([v, inverse @ pull])

    X = masses_of(motion)
    k = np.arange(X.shape[0])
    start = np.concatenate([X.sum(axis=0).real, (2j * math.pi * hz * k @ X).real])
    last = (periods - 1 + np.arange(256) / 256) / hz
    path = solve_ivp(rate, (0, last[-1]), start, "DOP853", last, rtol=1e-8, atol=1e-14, max_step=0.02 / hz).y[:n]
    phase = np.exp(-2j * np.pi * hz * np.outer(np.arange(4), last))
    return np.array([1.0, 2.0, 2.0, 2.0])[:, None] * (phase @ path.T) / 256


def masses_of(motion: Motions) -> FloatArray:
    """(K, n) peak phasors of the masses' displacements; the mean, which acceleration does not show, from the joint."""
    n = motion.balance.system.n
    k_omega = 2 * np.pi * motion.frequency_hz[0] * np.arange(motion.joints.shape[1])
    X = np.zeros((len(k_omega), n), dtype=complex)
    X[1:] = -motion.acceleration()[0, 1:, 1 : n + 1] * motion.force_amplitude / k_omega[1:, None] ** 2
    X[0] = np.linalg.solve(motion.balance.system.K, -motion.balance.forces.patterns.T @ motion.forces[0, 0].real)
    return X
