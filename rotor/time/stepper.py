"""Exact time stepping of the linear rotor under tones and the force of a signal.

The rotor is x' = A x + B f in the scaled modal state of ``state_space``, in which the undamped part
is skew. The steady response to a tone is x_p(phi) = Im[(i omega - A)^-1 B F e^{i phi}], and what
differs from it decays freely, so that a communication step of any length is one matrix product,

    x(t + h) = x_p(phi + omega h) + e^{hA} [x(t) - x_p(phi)] + int_0^h e^{(h-s)A} b u(s) ds,

with u(s) the parabola that the signal is during the step.

A rotor in steady motion stays in it exactly, for any step length. An undamped rotor driven at a
resonance has no steady response; there the tone becomes two more states of the exponential.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import expm
from scipy.sparse.csgraph import connected_components

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.rotor.time.drive import Drive, Tone

# Steady response above which the rotor counts as undamped at a resonance, in units of b / omega:
# subtracting a steady state so much larger than the motion would cost its digits.
_NO_STEADY_STATE = 1e5

# Number of propagators and steady states that are kept. A stepped-sine sweep needs a few at a time, a master with
# variable steps more; with local forces there are several substeps for each communication step and frequency.
CACHE_SIZE = 64


@dataclass(frozen=True, eq=False)
class Block:
    """States that are coupled with each other; they are stepped separately from all others."""

    places: IntArray  # (m,) indices of this block in the state
    A: FloatArray  # (m, m)
    B: FloatArray  # (m, n_inputs)

    def reached_by(self, drive: Drive) -> bool:
        """Whether the drive's forces act on these states."""
        pushed = any(drive.signal) and bool(self.B[:, 0].any())
        return pushed or any(self.hears(tone) for tone in drive.tones)

    def hears(self, tone: Tone) -> bool:
        """Whether a tone acts on these states."""
        return bool((self.B[:, tone.force != 0] != 0).any())


class ModalStepper:
    """Steps the modal state of one system.

    Parameters
    ----------
    system : the supported rotor, n degrees of freedom
    inputs : (n, n_inputs) where forces act
    read_out : (n_out, n) deflections whose accelerations are wanted
    spin_speed : Omega [rad/s]
    """

    def __init__(self, system: LinearSystem, inputs: FloatArray, read_out: FloatArray, spin_speed: float = 0.0):
        self._space = StateSpace(system, spin_speed)
        A, B = self._space.A, self._space.input(inputs)
        velocity = self._space.velocity(read_out)
        self._output = velocity @ A  # (n_out, n_states) acceleration from the state
        self.feedthrough = velocity @ B  # (n_out, n_inputs) acceleration per newton
        self._blocks = decoupled_blocks(A, B)
        remember = lru_cache(maxsize=CACHE_SIZE)
        self._propagator, self._steady, self._growth = remember(_propagate), remember(_steady_state), remember(_grow)

    @property
    def n_states(self) -> int:
        """Length of the state vector."""
        return self._space.n_states

    def state_of(self, q: FloatArray, velocity: FloatArray, memory: FloatArray | None = None) -> FloatArray:
        """(n_states,) modal state of deflections q [m] and velocities [m/s], each (n,); there is no memory."""
        return self._space.state_of(q, velocity)

    def motion_of(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) deflections [m] and (n,) velocities [m/s] of a modal state."""
        return self._space.motion_of(state)

    def memory_of(self, state: FloatArray) -> FloatArray:
        """What a state remembers beside its motion: nothing."""
        return np.zeros(0)

    def step(self, state: FloatArray, drive: Drive, h: float) -> FloatArray:
        """State after h seconds.

        Parameters
        ----------
        state : (n_states,) modal state
        drive : the forces during the step
        h : step [s]
        """
        after = np.zeros_like(state)
        for block in self._blocks:
            x = state[block.places]
            if block.reached_by(drive) or x.any():
                after[block.places] = self._step_block(block, x, drive, h)
        return after

    def acceleration(self, state: FloatArray, forces: FloatArray) -> FloatArray:
        """(n_out,) accelerations [m/s^2] at this state under these (n_inputs,) forces [N]."""
        return self._output.dot(state) + self.feedthrough.dot(forces)

    def _step_block(self, block: Block, x: FloatArray, drive: Drive, h: float) -> FloatArray:
        free, pushed = self._propagator(block, h)
        after = pushed.dot(drive.signal.share(h))
        for tone in drive.tones:
            if not block.hears(tone):
                continue
            steady = self._steady(block, tone.omega)
            if steady is None:
                after = after + self._driven_from_rest(block, tone, h)
            else:
                phasor = steady.dot(tone.force)
                x = x - (phasor * np.exp(1j * tone.start)).imag
                after = after + (phasor * np.exp(1j * tone.stop)).imag
        return after + free.dot(x)

    def _driven_from_rest(self, block: Block, tone: Tone, h: float) -> FloatArray:
        """What a tone alone makes of a block at rest, where it has no steady state."""
        now = tone.force * np.exp(1j * tone.start)  # force = Im now, quarter of a period later: Re now
        return self._growth(block, tone.omega, h).dot(np.concatenate([now.imag, now.real]))


def _propagate(block: Block, h: float) -> tuple[FloatArray, FloatArray]:
    """(m, m) e^{hA} and (m, 3) int_0^h e^{(h-s)A} b (s/h)^p ds of one block, p = 0, 1, 2, b for the first input."""
    m = len(block.places)
    generator = np.zeros((m + 3, m + 3))
    generator[:m, :m] = h * block.A
    generator[:m, m] = h * block.B[:, 0]
    generator[m, m + 1] = generator[m + 1, m + 2] = 1.0  # every power is the integral of the one before
    exponential = expm(generator)
    return np.ascontiguousarray(exponential[:m, :m]), exponential[:m, m:] * np.array([1.0, 1.0, 2.0])


def _steady_state(block: Block, omega: float) -> ComplexArray | None:
    """(m, n_inputs) phasors of one block's steady state under unit tones; None where there is none."""
    try:
        phasors = np.linalg.solve(1j * omega * np.eye(len(block.places)) - block.A, block.B.astype(complex))
    except np.linalg.LinAlgError:
        return None
    amplification = abs(omega) * np.linalg.norm(phasors) / np.linalg.norm(block.B)
    return phasors if amplification < _NO_STEADY_STATE else None


def _grow(block: Block, omega: float, h: float) -> FloatArray:
    """(m, 2 n_inputs) what sines and cosines make of one block at rest."""
    m, k = block.B.shape
    generator = np.zeros((m + 2 * k, m + 2 * k))
    generator[:m, :m] = block.A
    add_tone(generator, m, omega, block.B)
    return np.ascontiguousarray(expm(h * generator)[:m, m:])


def add_tone(generator: FloatArray, first: int, omega: float, B: FloatArray) -> None:
    """Put k sines, then k cosines, into a generator as its states from ``first`` on; the sines act by B (n, k)."""
    n, k = B.shape
    sine, cosine = slice(first, first + k), slice(first + k, first + 2 * k)
    generator[:n, sine] = B
    generator[sine, cosine], generator[cosine, sine] = omega * np.eye(k), -omega * np.eye(k)


def decoupled_blocks(A: FloatArray, B: FloatArray) -> list[Block]:
    """The states in groups that do not act on each other.

    >>> A = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -2.0]])
    >>> [block.places.tolist() for block in decoupled_blocks(A, B=np.ones((3, 1)))]
    [[0, 1], [2]]
    """
    n_groups, group = connected_components(A != 0, directed=False)
    blocks = [np.flatnonzero(group == g) for g in range(n_groups)]
    return [Block(places, A[np.ix_(places, places)], B[places]) for places in blocks]
