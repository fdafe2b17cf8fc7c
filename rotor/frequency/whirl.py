"""The spinning rotor: whirl over spin speed, critical speeds, unbalance response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from rigtwin.rotor.frequency.frequency_response import dynamic_stiffness
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.rotor_model import RotorModel
from rigtwin.rotor.model.system import LinearSystem

# A mode whose orbits enclose less than this share of the area of circles has no direction: it
# moves in a plane, or both planes are alike and its direction is arbitrary.
_PLANAR = 1e-3


@dataclass(frozen=True)
class Campbell:
    """Damped modes over spin speed, at each speed sorted by frequency."""

    spin_speed: FloatArray  # (n_speeds,) [rad/s]
    frequency_hz: FloatArray  # (n_speeds, n_modes) damped whirl frequency Im(lambda) / 2 pi
    damping_ratio: FloatArray  # (n_speeds, n_modes) negative: unstable
    direction: FloatArray  # (n_speeds, n_modes) 1 forward (y towards z, with a positive spin), -1 backward, 0 planar


@dataclass(frozen=True)
class CriticalSpeeds:
    """Spin speeds at which a whirl turns as fast as the rotor, ascending."""

    spin_speed: FloatArray  # (m,) [rad/s]
    direction: FloatArray  # (m,) 1 forward, -1 backward, 0 planar


def campbell(system: LinearSystem, spin_speed: FloatArray, n_modes: int = 8) -> Campbell:
    """Whirl frequencies, damping and direction of the lowest modes.

    Parameters
    ----------
    system : the supported rotor
    spin_speed : (n_speeds,) Omega [rad/s]
    n_modes : modes kept at each speed

    >>> system = build_system(assemble(load_rig("nit-rourkela")), Condition())
    >>> campbell(system, spin_speed=np.array([500.0]), n_modes=4).direction  # backward and forward whirl
    array([[-1.,  1., -1.,  1.]])
    """
    rows = []
    for Omega in np.asarray(spin_speed, dtype=float):
        modes = damped_modes(system, Omega)
        order = np.argsort(modes.eigenvalue.imag)[:n_modes]
        direction = whirl_direction(system, modes.shape[:, order]) * (np.sign(Omega) or 1.0)
        rows.append((modes.eigenvalue.imag[order] / (2 * np.pi), modes.damping_ratio[order], direction))
    frequency, damping, direction = (np.array(column) for column in zip(*rows, strict=True))
    return Campbell(np.asarray(spin_speed, dtype=float), frequency, damping, direction)


def whirl_direction(system: LinearSystem, shapes: ComplexArray) -> FloatArray:
    """(m,) sense of the orbits of shapes (n, m): 1 from y towards z, -1 the other way, 0 planar.

    An orbit y = Re Y e^{i omega t}, z = Re Z e^{i omega t} encloses the area pi Im(Y Z*), positive
    when it turns from y towards z; the areas of all nodes are added.
    """
    Y, Z = system.read_out(1) @ shapes, system.read_out(2) @ shapes  # (n_nodes, m)
    area = np.imag(Y * Z.conj()).sum(axis=0)
    circles = (np.abs(Y) ** 2 + np.abs(Z) ** 2).sum(axis=0) / 2
    share = np.divide(area, circles, out=np.zeros_like(area), where=circles > 0)
    return np.where(np.abs(share) < _PLANAR, 0.0, np.sign(share))


def critical_speeds(system: LinearSystem, n: int = 4) -> CriticalSpeeds:
    """Undamped critical speeds: omega = Omega in K phi = omega^2 (M - i G) phi.

    The matrix M - i G is Hermitian and K positive definite, so that 1/omega^2 are the eigenvalues of
    a Hermitian problem. Those that are not positive belong to whirls whose frequency no spin speed
    reaches (a forward whirl of a disk whose polar inertia is larger than its diametral one).

    Parameters
    ----------
    system : the supported rotor; it must be held (K positive definite)
    n : how many

    Raises ValueError for a rotor that is free to move as a rigid body.
    """
    if not system.modes.elastic[0]:
        raise ValueError("the rotor is free to move as a rigid body: it has no critical speeds")
    heavy = system.heavy
    block = np.ix_(heavy, heavy)
    flexibility, shapes = eigh(system.M[block] - 1j * system.G[block], system.condensed_stiffness)
    caught = flexibility > 1e-12 * flexibility[-1]
    order = np.argsort(-flexibility[caught])[:n]
    every = np.zeros((system.n, len(order)), dtype=complex)
    every[heavy] = shapes[:, caught][:, order]
    return CriticalSpeeds(1 / np.sqrt(flexibility[caught][order]), whirl_direction(system, every))


def unbalance_response(model: RotorModel, spin_speed: FloatArray) -> ComplexArray:
    """Deflections under the model's unbalances, turning with the rotor.

    q = D(Omega)^-1 f with f_y + i f_z = m e Omega^2 e^{i (Omega t + phi)}; in phasors, with
    q(t) = Re[q e^{i Omega t}], f_y = m e Omega^2 e^{i phi} and f_z = -i f_y.

    Parameters
    ----------
    model : the rotor with ``unbalance``; local nonlinear forces are left out
    spin_speed : (n_speeds,) Omega [rad/s], positive

    Returns
    -------
    (n_speeds, 2, n_nodes) phasors of the deflections in y and z [m]
    """
    Omega, system = np.asarray(spin_speed, dtype=float), model.system
    pattern = np.zeros(system.n, dtype=complex)
    for u in model.unbalances:
        pattern += u.moment * np.exp(1j * u.phase) * (u.patterns[0] - 1j * u.patterns[1])
    q = np.array(  # (n_speeds, n)
        [np.linalg.solve(dynamic_stiffness(system, np.array([w]), w)[0], w**2 * pattern) for w in Omega], dtype=complex
    )
    return np.stack([q @ system.read_out(plane).T.astype(complex) for plane in (1, 2)], axis=1)
