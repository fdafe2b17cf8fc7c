"""Frequency response of the linear rotor."""

from __future__ import annotations

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.system import LinearSystem


def dynamic_stiffness(system: LinearSystem, omega: FloatArray, spin_speed: float = 0.0) -> ComplexArray:
    """D(omega) = K + i omega (C + Omega G) - omega^2 M.

    Parameters
    ----------
    system : the supported rotor
    omega : (n_freq,) excitation frequencies [rad/s]
    spin_speed : Omega [rad/s]

    Returns
    -------
    (n_freq, n, n) dynamic stiffness [N/m]
    """
    w, system = np.asarray(omega, dtype=float)[:, None, None], system.at(spin_speed)
    return system.K + 1j * w * (system.C + spin_speed * system.G) - w**2 * system.M


def hysteretic_dynamic_stiffness(system: LinearSystem, omega: FloatArray) -> ComplexArray:
    """D(omega) with the shaft's damping as a complex stiffness, K_s (1 + 2 i zeta sign(omega)).

    For the frequency domain only, as no causal time model has it. The supports' dampers stay viscous.
    """
    w = np.asarray(omega, dtype=float)[:, None, None]
    loss = 2j * system.shaft_damping_ratio * np.sign(w) * system.K_shaft
    return system.K + loss + 1j * w * system.C_support - w**2 * system.M


def receptance(D: ComplexArray, inputs: FloatArray, outputs: FloatArray) -> ComplexArray:
    """Outputs per unit input force, outputs D^-1 inputs.

    Parameters
    ----------
    D : (n_freq, n, n) dynamic stiffness [N/m]
    inputs : (n, n_in) force patterns
    outputs : (n_out, n) read-out

    Returns
    -------
    (n_freq, n_out, n_in) receptance [m/N]
    """
    return outputs @ np.linalg.solve(D, np.broadcast_to(inputs, (len(D), *inputs.shape)))


def accelerance(
    system: LinearSystem, frequency_hz: FloatArray, *, excitation_node: int = 2, plane: int = 1, spin_speed: float = 0.0
) -> ComplexArray:
    """Acceleration of every node in the plane of the exciting force, per unit force.

    Parameters
    ----------
    system : the supported rotor
    frequency_hz : (n_freq,) [Hz]
    excitation_node : node of the force, from 1
    plane : 1 = y, 2 = z, of force and response
    spin_speed : Omega [rad/s]

    Returns
    -------
    (n_freq, n_nodes, 1) accelerance -omega^2 H [(m/s^2)/N]; rows of rigidly held nodes are zero

    >>> system = build_system(assemble(load_rig("nit-rourkela")), Condition(rigid_support=True))
    >>> accelerance(system, frequency_hz=np.array([50.0, 60.0])).shape
    (2, 7, 1)
    """
    omega = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
    exciter = system.unit_vector(excitation_node, plane)
    H = driven_receptance(system, omega, exciter, system.read_out(plane), spin_speed)
    return -(omega[:, None, None] ** 2) * H


def driven_receptance(
    system: LinearSystem, omega: FloatArray, exciter: FloatArray, outputs: FloatArray, spin_speed: float = 0.0
) -> ComplexArray:
    """Outputs per unit force of one exciter, solved in its plane only where the planes are not coupled.

    Parameters
    ----------
    system : the supported rotor
    omega : (n_freq,) excitation frequencies [rad/s]
    exciter : (n,) force pattern
    outputs : (n_out, n) read-out
    spin_speed : Omega [rad/s]

    Returns
    -------
    (n_freq, n_out, 1) receptance [m/N]
    """
    system = system.at(spin_speed)
    if plane := system.plane_of_motion(exciter, spin_speed):
        inside = system.plane == plane
        system, exciter, outputs = system.in_plane(plane), exciter[inside], outputs[:, inside]
    return StateSpace(system, spin_speed).receptance(omega, exciter[:, None], outputs)
