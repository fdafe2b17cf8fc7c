"""What the FMU must give, computed in physical coordinates with ``scipy.linalg.expm`` alone.

The FMU steps modal states and splits off the steady response; nothing of that is used here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem


def state_matrix(system: LinearSystem, spin_speed: float = 0.0) -> FloatArray:
    """(2n, 2n) matrix A of d/dt (q, q') = A (q, q')."""
    inverse = np.linalg.inv(system.M)
    damping = system.C + spin_speed * system.G
    return np.block([[np.zeros_like(system.M), np.eye(system.n)], [-inverse @ system.K, -inverse @ damping]])


def force_column(system: LinearSystem, node: int, plane: int) -> FloatArray:
    """(2n,) effect of a unit force on d/dt (q, q')."""
    acceleration = np.linalg.solve(system.M, system.unit_vector(node, plane))
    return np.concatenate([np.zeros(system.n), acceleration])


@dataclass(frozen=True)
class HeldForce:
    """x[k+1] = A_d x[k] + B_d u[k], y = C x + D u: the rotor under a force held over h seconds."""

    A_d: FloatArray  # (2n, 2n)
    B_d: FloatArray  # (2n,)
    C: FloatArray  # (n_nodes, 2n) accelerations in y
    D: FloatArray  # (n_nodes,)
    h: float  # [s]

    def G(self, frequency_hz: float) -> np.ndarray:
        """(n_nodes,) C (z 1 - A_d)^-1 B_d + D / z at z = e^{i omega h}.

        What a master measures that sets the force, steps, and then reads: it reads y[k+1] while
        u[k] is still applied.
        """
        z = np.exp(2j * np.pi * frequency_hz * self.h)
        return self.C @ np.linalg.solve(z * np.eye(len(self.B_d)) - self.A_d, self.B_d) + self.D / z

    def respond(self, u: FloatArray) -> FloatArray:
        """(n_steps, n_nodes) accelerations read after each step, from rest."""
        x, readings = np.zeros(len(self.B_d)), []
        for force in u:
            x = self.A_d @ x + self.B_d * force
            readings.append(self.C @ x + self.D * force)
        return np.array(readings)


def held_force(system: LinearSystem, h: float, node: int = 2) -> HeldForce:
    """Zero-order-hold discretisation of the non-spinning rotor, force and accelerations in y."""
    A, b, n = state_matrix(system), force_column(system, node, 1), system.n
    exponential = expm(h * np.block([[A, b[:, None]], [np.zeros((1, 2 * n + 1))]]))
    read_out = system.read_out(1)
    return HeldForce(exponential[: 2 * n, : 2 * n], exponential[: 2 * n, 2 * n], read_out @ A[n:], read_out @ b[n:], h)


class FreshRotor:
    """A rotor under force + F sin(phi), stepped by one exponential of motion and sine together.

    Parameters
    ----------
    structure, condition : the rotor
    spin_speed : Omega [rad/s]
    motion : (q, q') to start from, default rest
    phase : of the sine [rad]
    """

    def __init__(
        self,
        structure: Structure,
        condition: Condition,
        *,
        spin_speed: float = 0.0,
        motion: tuple[FloatArray, FloatArray] | None = None,
        phase: float = 0.0,
    ):
        self.system = build_system(structure, condition)
        n = self.system.n
        self._A = state_matrix(self.system, spin_speed)
        self._b = force_column(self.system, 2, 1)
        self._x = np.concatenate(motion) if motion else np.zeros(2 * n)
        self.phase = phase

    @property
    def motion(self) -> tuple[FloatArray, FloatArray]:
        """(n,) deflections [m] and (n,) velocities [m/s]."""
        n = self.system.n
        return self._x[:n], self._x[n:]

    def step(self, h: float, *, force: float = 0.0, amplitude: float = 0.0, frequency_hz: float = 0.0) -> None:
        """Go on for h seconds under this force."""
        n, omega = len(self._x), 2 * np.pi * frequency_hz
        generator = np.zeros((n + 3, n + 3))  # motion, F sin phi, F cos phi, held force
        generator[:n, :n] = self._A
        generator[:n, n] = generator[:n, n + 2] = self._b
        generator[n, n + 1], generator[n + 1, n] = omega, -omega
        sine = amplitude * np.array([np.sin(self.phase), np.cos(self.phase)])
        self._x = (expm(h * generator) @ np.concatenate([self._x, sine, [force]]))[:n]
        self.phase += omega * h

    def accelerations(self, force: float = 0.0) -> FloatArray:
        """(2 n_nodes,) accelerations in y, then in z, under this total force at node 2 in y."""
        n = self.system.n
        q_dd = self._A[n:] @ self._x + self._b[n:] * force
        return np.concatenate([self.system.read_out(1) @ q_dd, self.system.read_out(2) @ q_dd])


# -- tolerances ----------------------------------------------------------------------------------

# The FMU's clock has ticks of 2^-36 s. Half a tick is 7e-12 s, or 2e-6 rad of the rotor's fastest
# mode (52 kHz); what that mode contributes to an acceleration is a fraction of the whole.
CLOCK = 1e-6

# Motion in physical coordinates spans deflections and the fastest mode's velocities; the matrix
# exponential of both keeps eight digits of an acceleration.
PHYSICAL_COORDINATES = 1e-7

# ln(1e8): after a transient has decayed for this many of its time constants, 1e-8 of it is left.
SETTLED = 18.42


def whole_ticks(h: float) -> float:
    """The nearest step that the FMU's clock represents exactly [s]."""
    return round(h * 2**36) / 2**36


def assert_close(found: FloatArray, expected: FloatArray, tolerance: float) -> None:
    """Agreement to ``tolerance`` of the largest expected value: small channels are differences of large terms."""
    found, expected = np.asarray(found), np.asarray(expected)
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())
