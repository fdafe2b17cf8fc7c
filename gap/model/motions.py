"""Periodic motions of a rotor under a force law: how finely they are solved, and how a run drives and reads them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigtwin.rotor.frequency.harmonic_balance import Balance, jacobian
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class Resolution:
    """How finely a periodic motion is computed."""

    harmonics: int = 3
    samples: int = 128
    iterations: int = 15  # of Newton's method; where they are too few the last force counts
    bends: bool = False  # whether derivatives by the tolerances follow the modes' shapes, or their frequencies alone
    turned: bool = False  # whether magnitudes are given the linear rotor's phases, turned, where a line has no start


ROUGH = Resolution(1, 64, 5)
MIDDLE = Resolution(3, 128, 8)
FINE = Resolution(3, 128, 15)
FINAL = Resolution(15, 1024, 25, bends=True, turned=True)


@dataclass(frozen=True)
class Solved:
    """Motions of a run at given drifts of the resonances."""

    balance: Balance
    omega: FloatArray  # (n_freq,) [rad/s]
    joints: ComplexArray  # (n_freq, K, n_joints)
    states: ComplexArray  # (n_freq, K, n_states)
    H: ComplexArray  # (n_freq, n_channels)
    converged: BoolArray  # (n_freq,)
    tells: BoolArray  # (n_freq,) lines near enough to a motion to tell how the response changes
    plain: Balance | None = None  # without the drifts
    mode: IntArray | None = None  # (n_states,) as of ``NonlinearModal``

    @cached_property
    def forces(self) -> ComplexArray:
        """(n_freq, K, n_joints) harmonics of the joints' forces [N]."""
        return self.balance.forces.harmonics(self.joints)

    @cached_property
    def tangent(self) -> tuple[FloatArray, ComplexArray]:
        """(n_freq, n, n) inverse of the balance's Jacobian, and of the forces' fundamentals the derivative in it."""
        _, DN = self.balance.forces(self.joints)
        return np.linalg.inv(jacobian(self.balance.receptance(self.omega)[0], DN)), DN[:, 1]

    def with_lines(self, other: Solved, lines: IntArray, better: BoolArray) -> Solved:
        """The same with better motions at some lines; ``other`` was solved at ``lines`` only."""
        joints, states, H = self.joints.copy(), self.states.copy(), self.H.copy()
        converged, tells = self.converged.copy(), self.tells.copy()
        taken = lines[better]
        joints[taken], states[taken], H[taken] = other.joints[better], other.states[better], other.H[better]
        converged[taken] = tells[taken] = True
        return Solved(self.balance, self.omega, joints, states, H, converged, tells)


@dataclass(frozen=True)
class Drive:
    """How a run drives a rotor, and what its sensors read of the motion."""

    run: Run
    level: float = 0.0  # logarithm of the true force over the one that the run believes; responses are per true force
    chain: ComplexArray | float = 1.0  # (n_freq, n_channels) reported over true response

    @property
    def omega(self) -> FloatArray:
        """(n_freq,) lines [rad/s]."""
        return 2 * np.pi * self.run.frequency_hz

    @property
    def force(self) -> FloatArray:
        """(n_freq,) true force of each line [N]."""
        return self.run.forces * float(np.exp(self.level))

    @property
    def scale(self) -> ComplexArray:
        """(n_freq, n_channels or 1) of what is reported over displacements: powers of i omega, per force or, of
        accelerations, per its error alone, and the channels' factors."""
        unit = np.full_like(self.force, np.exp(-self.level)) if self.run.quantity == "acceleration" else 1 / self.force
        return (unit * (1j * self.omega) ** DERIVATIVE_ORDER[self.run.quantity])[:, None] * self.chain

    def force_at(self, hz: float) -> float:
        """True force at a frequency [N], between two lines even and beyond the last one as there."""
        return float(np.interp(hz, self.run.frequency_hz, self.force))

    def read_out(self, balance: Balance) -> ComplexArray:
        """(n_channels, n_states) displacements that the sensors read of the states."""
        planes = {c.plane: balance.read_out(1 if c.plane == "y" else 2) for c in self.run.channels}
        return np.stack([planes[c.plane][c.node - 1] for c in self.run.channels])

    def by_force(self, balance: Balance) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, n_channels or n_joints, n_joints + 1) sensors, joints per newton at joints and exciter."""
        states = balance.resolvent(self.omega, balance.loads)[:, 1]  # (n_freq, n_states, n_joints + 1)
        return self.read_out(balance) @ states, balance.left @ states

    def solve(
        self, balance: Balance, start: ComplexArray, iterations: int, lines: IntArray | None = None, tells: float = 1e-3
    ) -> Solved:
        """Motions at all lines, or some, by Newton's method.

        Parameters
        ----------
        start : (n_lines, K, n_joints)
        tells : what Newton's method would change next, relative, of a motion that still tells a slope
        """
        at = slice(None) if lines is None else lines
        motions = balance.solve(self.run.frequency_hz[at], self.force[at], start, iterations=iterations)
        states = motions.states
        H = self.scale[at] * (states[:, 1] @ self.read_out(balance).T)
        usable: BoolArray = np.asarray(np.isfinite(H).all(axis=1), dtype=bool)
        assert motions.off is not None
        near = usable & (motions.converged | (motions.off <= tells))
        H = np.where(usable[:, None], H, 0.0)
        return Solved(balance, self.omega[at], motions.joints, states, H, motions.converged & usable, near)

    def miss(self, solved: Solved, lines: IntArray | None = None) -> FloatArray:
        """(n_freq,) distance of motions to the data, relative, over all channels."""
        H = self.run.H if lines is None else self.run.H[lines]
        y = np.nan_to_num(H)
        d = np.where(np.isfinite(H), np.abs(y) - np.abs(solved.H) if self.run.magnitude_only else y - solved.H, 0.0)
        return np.linalg.norm(d, axis=1) / np.maximum(np.linalg.norm(y, axis=1), 1e-300)
