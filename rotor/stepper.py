"""Exact time stepping of the linear rotor under a sine and a held force.

In modal coordinates q = Phi eta, with the state (s eta, eta') scaled by s = omega so that the
undamped part is skew, the forced rotor is a linear system with three more states: the sine, the
cosine and the held force. One communication step of any length is then one matrix product,

    z(t + h) = exp(h [[A, B], [0, S]]) z(t),   z = (s eta, eta', F sin phi, F cos phi, u).
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.sparse.csgraph import connected_components

from rotor.structure import FloatArray, IntArray
from rotor.system import LinearSystem, undamped_modes

# Propagators kept: a stepped-sine sweep needs a handful at a time, a variable-step master more.
_CACHE_SIZE = 64


@dataclass(frozen=True)
class Drive:
    """Force during a step: a held value [N] and F sin(phi) with phi' = 2 pi f."""

    held: float = 0.0
    amplitude: float = 0.0
    omega: float = 0.0


@dataclass(frozen=True)
class _Block:
    """Modes that couple with each other; others are stepped without them."""

    places: IntArray  # (2m,) indices of this block in the state
    A: FloatArray  # (2m, 2m)
    b: FloatArray  # (2m,) effect of a unit force


class ModalStepper:
    """Steps the modal state of one system under one force pattern.

    Parameters
    ----------
    system : the supported rotor, n degrees of freedom
    force_pattern : (n,) where the force acts
    read_out : (n_out, n) deflections whose accelerations are wanted
    spin_speed : Omega [rad/s]
    """

    def __init__(self, system: LinearSystem, force_pattern: FloatArray, read_out: FloatArray, spin_speed: float = 0.0):
        modes = undamped_modes(system)
        self._M, self._Phi = system.M, modes.Phi
        self._scale = np.where(modes.omega > 1e-6 * modes.omega.max(), modes.omega, 1.0)
        damping = modes.Phi.T @ (system.C + spin_speed * system.G) @ modes.Phi
        m = len(modes.omega)
        A = np.zeros((2 * m, 2 * m))
        A[:m, m:] = np.diag(self._scale)
        A[m:, :m] = -np.diag(modes.omega**2 / self._scale)
        A[m:, m:] = -damping
        b = np.concatenate([np.zeros(m), modes.Phi.T @ force_pattern])
        self._output = read_out @ modes.Phi @ A[m:]  # (n_out, 2m) acceleration from the state
        self.feedthrough = read_out @ modes.Phi @ b[m:]  # (n_out,) acceleration per newton
        self._blocks = _decoupled_blocks(A, b)
        self._propagators: OrderedDict[tuple[int, float, float], FloatArray] = OrderedDict()

    @property
    def n_states(self) -> int:
        """Length of the state vector, twice the number of degrees of freedom."""
        return 2 * len(self._scale)

    def state_of(self, q: FloatArray, velocity: FloatArray) -> FloatArray:
        """(2n,) modal state of deflections q [m] and velocities [m/s], each (n,)."""
        to_modal = self._Phi.T @ self._M
        return np.concatenate([self._scale * (to_modal @ q), to_modal @ velocity])

    def motion_of(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) deflections [m] and (n,) velocities [m/s] of a modal state."""
        m = len(self._scale)
        return self._Phi @ (state[:m] / self._scale), self._Phi @ state[m:]

    def step(self, state: FloatArray, phase: float, drive: Drive, h: float) -> FloatArray:
        """State after h seconds; ``phase`` is the sine's at the start of the step [rad]."""
        after = np.zeros_like(state)
        forces = (drive.amplitude * np.sin(phase), drive.amplitude * np.cos(phase), drive.held)
        forced = drive.amplitude != 0.0 or drive.held != 0.0
        for number, block in enumerate(self._blocks):
            start = state[block.places]
            if (forced and block.b.any()) or start.any():
                z = np.concatenate([start, forces])
                after[block.places] = self._propagator(number, drive.omega, h).dot(z)
        return after

    def acceleration(self, state: FloatArray, force: float) -> FloatArray:
        """(n_out,) accelerations [m/s^2] at this state under this total force [N]."""
        return self._output.dot(state) + self.feedthrough * force

    def _propagator(self, number: int, omega: float, h: float) -> FloatArray:
        key = (number, omega, h)
        if key in self._propagators:
            self._propagators.move_to_end(key)
            return self._propagators[key]
        block = self._blocks[number]
        m = len(block.places)
        generator = np.zeros((m + 3, m + 3))
        generator[:m, :m] = block.A
        generator[:m, m] = generator[:m, m + 2] = block.b
        generator[m, m + 1], generator[m + 1, m] = omega, -omega
        self._propagators[key] = expm(h * generator)[:m]
        if len(self._propagators) > _CACHE_SIZE:
            self._propagators.popitem(last=False)
        return self._propagators[key]


def _decoupled_blocks(A: FloatArray, b: FloatArray) -> list[_Block]:
    n_groups, group = connected_components(A != 0, directed=False)
    blocks = [np.flatnonzero(group == g) for g in range(n_groups)]
    return [_Block(places, A[np.ix_(places, places)], b[places]) for places in blocks]
