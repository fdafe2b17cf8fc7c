"""Exact time stepping of the linear rotor under a sine and a held force.

In modal coordinates q = Phi eta the state is x = (s eta, eta'), scaled by s = omega so that the
undamped part is skew: x' = A x + b (u + F sin phi). The steady response to the sine is
x_p(phi) = Im[(i omega - A)^-1 b F e^{i phi}], and what differs from it decays freely, so that a
communication step of any length is one matrix product,

    x(t + h) = x_p(phi + omega h) + e^{hA} [x(t) - x_p(phi)] + int_0^h e^{sA} ds b u.

A rotor that has settled stays settled exactly, however long the step. An undamped rotor driven at a
resonance has no steady response; there the sine becomes two more states of the exponential.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.sparse.csgraph import connected_components

from rotor.structure import FloatArray, IntArray
from rotor.system import LinearSystem, undamped_modes

ComplexArray = NDArray[np.complexfloating[Any, Any]]

# Steady response above which the rotor counts as undamped at a resonance, in units of b / omega:
# subtracting a steady state so much larger than the motion would cost its digits.
_NO_STEADY_STATE = 1e5

# Propagators and steady states kept: a stepped-sine sweep needs a handful at a time, a variable-step master more.
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

    @property
    def forced(self) -> bool:
        """Whether the force reaches these modes."""
        return bool(self.b.any())


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
        self._cache: OrderedDict[tuple[Any, ...], Any] = OrderedDict()

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

    def step(self, state: FloatArray, phases: tuple[float, float], drive: Drive, h: float) -> FloatArray:
        """State after h seconds.

        Parameters
        ----------
        state : (2n,) modal state
        phases : phase of the sine at the start and at the end of the step [rad]
        drive : the force during the step
        h : step [s]
        """
        after = np.zeros_like(state)
        forced = drive.amplitude != 0.0 or drive.held != 0.0
        for number, block in enumerate(self._blocks):
            x = state[block.places]
            if not ((forced and block.forced) or x.any()):
                continue
            free, held = self._propagator(number, h)
            if drive.amplitude == 0.0 or not block.forced:
                x = free.dot(x)
            elif (unit := self._steady(number, drive.omega)) is not None:
                steady = drive.amplitude * unit  # complex phasor
                x = free.dot(x - (steady * np.exp(1j * phases[0])).imag)
                x += (steady * np.exp(1j * phases[1])).imag
            else:
                sine = (drive.amplitude * np.sin(phases[0]), drive.amplitude * np.cos(phases[0]))
                x = self._growth(number, drive.omega, h).dot(np.concatenate([x, sine]))
            after[block.places] = x + held * drive.held
        return after

    def acceleration(self, state: FloatArray, force: float) -> FloatArray:
        """(n_out,) accelerations [m/s^2] at this state under this total force [N]."""
        return self._output.dot(state) + self.feedthrough * force

    def _propagator(self, number: int, h: float) -> tuple[FloatArray, FloatArray]:
        """e^{hA} and int_0^h e^{sA} ds b of one block."""
        return self._remember(("propagator", number, h), lambda: _propagate(self._blocks[number], h))

    def _steady(self, number: int, omega: float) -> ComplexArray | None:
        """Phasor of one block's steady state under a unit sine; None where there is none."""
        return self._remember(("steady", number, omega), lambda: _steady_state(self._blocks[number], omega))

    def _growth(self, number: int, omega: float, h: float) -> FloatArray:
        """(2m, 2m + 2) propagator of one block and the sine and cosine that drive it."""
        return self._remember(("growth", number, omega, h), lambda: _propagate_driven(self._blocks[number], omega, h))

    def _remember(self, key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
        if key in self._cache:
            self._cache.move_to_end(key)
            return self._cache[key]
        self._cache[key] = make()
        if len(self._cache) > _CACHE_SIZE:
            self._cache.popitem(last=False)
        return self._cache[key]


def _propagate(block: _Block, h: float) -> tuple[FloatArray, FloatArray]:
    m = len(block.places)
    generator = np.zeros((m + 1, m + 1))
    generator[:m, :m] = block.A
    generator[:m, m] = block.b
    exponential = expm(h * generator)
    return np.ascontiguousarray(exponential[:m, :m]), exponential[:m, m].copy()


def _steady_state(block: _Block, omega: float) -> ComplexArray | None:
    try:
        phasor = np.linalg.solve(1j * omega * np.eye(len(block.places)) - block.A, block.b.astype(complex))
    except np.linalg.LinAlgError:
        return None
    amplification = abs(omega) * np.linalg.norm(phasor) / np.linalg.norm(block.b)
    return phasor if amplification < _NO_STEADY_STATE else None


def _propagate_driven(block: _Block, omega: float, h: float) -> FloatArray:
    m = len(block.places)
    generator = np.zeros((m + 2, m + 2))
    generator[:m, :m] = block.A
    generator[:m, m] = block.b
    generator[m, m + 1], generator[m + 1, m] = omega, -omega
    return np.ascontiguousarray(expm(h * generator)[:m])


def _decoupled_blocks(A: FloatArray, b: FloatArray) -> list[_Block]:
    n_groups, group = connected_components(A != 0, directed=False)
    blocks = [np.flatnonzero(group == g) for g in range(n_groups)]
    return [_Block(places, A[np.ix_(places, places)], b[places]) for places in blocks]
