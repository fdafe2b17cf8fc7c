"""How a run's motions under a force law change: derivatives from the harmonic balance's own Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.gap.model.linear import towards_damping
from rigtwin.gap.model.motions import Drive, Solved
from rigtwin.rotor.frequency.harmonic_balance import Balance, amounts_of
from rigtwin.rotor.frequency.periodic_force import real_form
from rigtwin.rotor.model.arrays import ComplexArray


@dataclass(frozen=True)
class MotionSlopes:
    """Derivatives of a run's response at its motions, (n, n_freq, n_channels) each."""

    drive: Drive
    solved: Solved

    def by_mode(self, n_modes: int) -> ComplexArray:
        """By the relative shifts of the linear rotor's lowest resonances, and then by those of their dampings."""
        solved, balance = self.solved, self.solved.balance
        assert solved.plain is not None
        assert solved.mode is not None
        s = 1j * self.drive.omega[:, None] * np.arange(balance.harmonics + 1)
        moved = solved.states * solved.plain.values / (s[..., None] - balance.values)  # (n_freq, K, n_states)
        own = (solved.mode[:, None] == np.arange(n_modes)).astype(float)  # (n_states, n_modes)
        belongs = np.hstack([own, towards_damping(solved.plain.values)[:, None] * own])
        direct = balance.left[:, :, None] * belongs  # (n_joints, n_states, n_modes)
        push = np.einsum("fks,jsm->fkjm", moved, direct, optimize=True)
        own = np.einsum("fs,cs,sm->fcm", moved[:, 1], self.drive.read_out(balance), belongs, optimize=True)
        return self._answer(push, own)

    def by_level(self) -> ComplexArray:
        """By the logarithm of the force; zero where the rotor is linear."""
        drive, balance = self.drive, self.solved.balance
        states = balance.resolvent(drive.omega, balance.loads)[..., -1:]  # (n_freq, K, n_states, 1)
        states = drive.force[:, None, None, None] * states
        return self._answer(balance.left @ states, drive.read_out(balance) @ states[:, 1]) - self.solved.H

    def by_rotors(self, others: Sequence[Balance], step: float) -> ComplexArray:
        """By numbers of the rotor, of which each is a step larger in one of the others."""
        forces = self.solved.forces
        changes = [[change / step for change in self._moved_by(other, forces)] for other in others]
        push, own = (np.stack(parts, axis=-1) for parts in zip(*changes, strict=True))
        return self._answer(push, own)

    def change_to(self, other: Balance) -> ComplexArray:
        """(n_freq, n_channels) change of the response to that of a rotor with other numbers, to first order."""
        push, own = self._moved_by(other, other.forces.harmonics(self.solved.joints))
        return self._answer(push[..., None], own[..., None])[0]

    def _moved_by(self, other: Balance, forces: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """How another rotor under given forces moves beside a motion.

        Returns
        -------
        (n_freq, K, n_joints) of the joints and (n_freq, n_channels) of the sensors
        """
        drive, solved = self.drive, self.solved
        amounts = amounts_of(forces, drive.force)
        states = other.resolvent(drive.omega, other.loads @ amounts[..., None])[..., 0]
        joints = states @ other.left.T - solved.states @ solved.balance.left.T
        sensors = states[:, 1] @ drive.read_out(other).T - solved.states[:, 1] @ drive.read_out(solved.balance).T
        return joints, sensors

    def _answer(self, push: ComplexArray, own: ComplexArray) -> ComplexArray:
        """(m, n_freq, n_channels) derivative of the response by m numbers.

        Parameters
        ----------
        push : (n_freq, K, n_joints, m) derivative of the joints' motion, their forces held
        own : (n_freq, n_channels, m) the same of the sensors' motion
        """
        drive, balance = self.drive, self.solved.balance
        inverse, DN = self.solved.tangent
        m = push.shape[-1]
        flat = real_form(push.reshape(*push.shape[:2], -1)).reshape(len(inverse), -1, m)
        dX = (inverse @ flat).reshape(len(inverse), *DN.shape[2:], m)
        dN = np.einsum("fjun,funm->fjm", DN, dX, optimize=True)
        to_sensors = drive.read_out(balance) @ balance.resolvent(drive.omega, balance.loads)[:, 1, :, :-1]
        change = drive.scale[:, :, None] * (own - to_sensors @ dN)
        return np.moveaxis(np.where(np.isfinite(change), change, 0.0), 2, 0)
