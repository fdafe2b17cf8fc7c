"""Natural frequencies, damped modes and whirl of the rotor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotor.structure import DOF_PER_NODE, FloatArray
from rotor.system import LinearSystem, undamped_modes

# Which of (y, z, theta_y, theta_z) move in plane 1 = y and in plane 2 = z.
_MOVES_IN_PLANE = {1: (0, 3), 2: (1, 2)}


@dataclass(frozen=True)
class DampedModes:
    """Oscillating modes of the damped, spinning rotor; one of each conjugate pair."""

    eigenvalue: NDArray[np.complexfloating[Any, Any]]  # (m,) lambda [1/s], imaginary part positive
    shape: NDArray[np.complexfloating[Any, Any]]  # (n, m) displacement shapes

    @property
    def frequency_hz(self) -> FloatArray:
        """(m,) undamped natural frequency |lambda| / 2 pi [Hz]."""
        return np.abs(self.eigenvalue) / (2 * np.pi)

    @property
    def damping_ratio(self) -> FloatArray:
        """(m,) zeta = -Re lambda / |lambda| [-]."""
        return -self.eigenvalue.real / np.abs(self.eigenvalue)


def natural_frequencies_hz(system: LinearSystem, plane: int | None = None) -> FloatArray:
    """Undamped natural frequencies of the non-spinning rotor [Hz], ascending.

    Parameters
    ----------
    system : the supported rotor
    plane : 1 = y or 2 = z to list the bending modes of one plane; default both
    """
    modes = undamped_modes(system)
    if plane is None:
        return modes.omega / (2 * np.pi)
    if plane not in _MOVES_IN_PLANE:
        raise ValueError(f"plane {plane} does not exist: 1 is y, 2 is z")
    inside = np.isin(system.free % DOF_PER_NODE, _MOVES_IN_PLANE[plane])
    kinetic_energy = modes.Phi * (system.M @ modes.Phi)  # (n, n_modes), each column sums to one
    return modes.omega[kinetic_energy[inside].sum(axis=0) > 0.5] / (2 * np.pi)


def damped_modes(system: LinearSystem, spin_speed: float = 0.0) -> DampedModes:
    """Eigenvalues and shapes of M q'' + (C + Omega G) q' + K q = 0.

    Parameters
    ----------
    system : the supported rotor, n degrees of freedom
    spin_speed : Omega [rad/s]; the sign is the spin direction about +x

    Returns
    -------
    DampedModes sorted by frequency; overdamped (real) eigenvalues are left out
    """
    eigenvalue, vectors = np.linalg.eig(state_matrix(system, spin_speed))
    keep = np.imag(eigenvalue) > 1e-9 * np.abs(eigenvalue).max()
    order = np.argsort(np.abs(eigenvalue[keep]))
    return DampedModes(eigenvalue[keep][order], vectors[: system.n, keep][:, order])


def state_matrix(system: LinearSystem, spin_speed: float = 0.0) -> FloatArray:
    """(2n, 2n) matrix A of d/dt (q, q') = A (q, q')."""
    inverse = np.linalg.inv(system.M)
    damping = system.C + spin_speed * system.G
    return np.block([[np.zeros_like(system.M), np.eye(system.n)], [-inverse @ system.K, -inverse @ damping]])


def campbell_hz(system: LinearSystem, spin_speeds: FloatArray, n_modes: int = 4) -> FloatArray:
    """Whirl frequencies over spin speed.

    Returns
    -------
    (n_speeds, n_modes) whirl frequencies [Hz], ascending at each speed
    """
    return np.array(
        [np.sort(np.abs(damped_modes(system, s).eigenvalue.imag))[:n_modes] / (2 * np.pi) for s in spin_speeds]
    )
