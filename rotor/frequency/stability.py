"""Stability of periodic motions: Floquet multipliers.

A disturbance of a periodic motion follows the linear equations of the rotor with the slope of its
local forces at that instant,

    z' = lambda z - B df,    df = S(t) dx,    dx = C z - D df,

in the coordinates of the linear rotor's eigenvectors. After one period it is multiplied by the
monodromy matrix, whose eigenvalues are the multipliers; beyond modulus one the motion is not
stable [nayfeh1979; krack2019]. Eigenvectors far above the harmonics follow statically: D.

Between samples the linear part is exact, and the slope acts as an impulse at each sample. The error is
of second order in the sampling interval and adds no damping. If the motion stays in one plane, only
disturbances in that plane are examined.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.frequency.harmonic_balance import Motions
from rigtwin.rotor.frequency.periodic_force import Memory
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray

# Modes with eigenvalues above this multiple of the highest harmonic's frequency follow statically.
_STATIC = 4.0

# A multiplier whose modulus exceeds one by less than this counts as one: an element that does not slip is neutral.
NEUTRAL = 1e-6


def is_stable(multipliers: ComplexArray) -> NDArray[np.bool_]:
    """(n,) whether every multiplier (n, m) has modulus one at most.

    >>> is_stable(np.array([[0.9, 0.5], [1.2, 0.5]]))
    array([ True, False])
    """
    return np.abs(multipliers).max(axis=1, initial=0.0) <= 1 + NEUTRAL


def floquet_multipliers(motions: Motions) -> ComplexArray:
    """Factors by which disturbances grow in one period.

    A law with memory brings two more states: its force and displacement one sample earlier. If it slips
    in some of the motions and not in others, its force is free in those others, which gives a multiplier of one.
    If it slips in none of them, it is a spring.

    Parameters
    ----------
    motions : n periodic motions

    Returns
    -------
    (n, m) multipliers, largest modulus first

    Raises ValueError where the linear rotor has no full set of eigenvectors.
    """
    balance = motions.balance
    if balance.values.ndim > 1:
        raise ValueError("the linear rotor is critically damped: it has no full set of eigenvectors")
    disturbance = _Disturbance(motions)
    for place in range(balance.samples):
        disturbance.kick(place)
        disturbance.drift()
    values = np.linalg.eigvals(disturbance.Y).astype(complex)
    order = np.argsort(-np.abs(values), axis=1)
    return np.take_along_axis(values, order, axis=1)


class _Disturbance:
    """All independent disturbances Y of n motions, (n, m, m): states z, then memory's (displacement, force)."""

    def __init__(self, motions: Motions):
        balance = motions.balance
        omega = 2 * np.pi * motions.frequency_hz
        slow = np.abs(balance.values) <= _STATIC * balance.harmonics * omega[:, None]  # (n, n_states)
        slow[:, np.argmin(np.abs(balance.values))] = True
        used = slow.any(axis=0)
        self.C = balance.left[:, used] * slow[:, None, used]  # (n, n_joints, m)
        self.B = balance.right[used] * slow[:, used, None]  # (n, m, n_joints)
        self.D = (balance.left * np.where(slow, 0.0, -1 / balance.values)[:, None, :]) @ balance.right
        self.interval = 2 * np.pi / (omega * balance.samples)
        self.step = np.exp(balance.values[used] * self.interval[:, None])[..., None]
        sampled = balance.forces.sampled(motions.joints)
        self.springs = [sample for sample in sampled if sample.memory is None]
        self.frictions = [(sample.coordinates[0], sample.memory) for sample in sampled if sample.memory is not None]
        self.m, self.samples = int(used.sum()), balance.samples
        size = self.m + 2 * len(self.frictions)
        self.Y = np.tile(np.eye(size, dtype=complex), (len(omega), 1, 1))

    def drift(self) -> None:
        """The linear rotor by itself, for one sampling interval."""
        self.Y[:, : self.m] *= self.step

    def kick(self, place: int) -> None:
        """The change of the local forces at one sample, over one interval."""
        S = self._slopes(place)
        remembered = [self._remembered(memory, number, place) for number, (_, memory) in enumerate(self.frictions)]
        x = self.C @ self.Y[:, : self.m]  # (n, n_joints, size)
        forces = S @ x
        for (row, _), part in zip(self.frictions, remembered, strict=True):
            forces[:, row] += part
        forces = np.linalg.solve(np.eye(S.shape[1]) + S @ self.D, forces)
        self.Y[:, : self.m] -= self.interval[:, None, None] * (self.B @ forces)
        x -= self.D @ forces
        for number, ((row, memory), part) in enumerate(zip(self.frictions, remembered, strict=True)):
            self.Y[:, self.m + 2 * number] = x[:, row]
            self.Y[:, self.m + 2 * number + 1] = memory.slope[:, self.samples + place, None] * x[:, row] + part

    def _slopes(self, place: int) -> FloatArray:
        """(n, n_joints, n_joints) slope of the local forces at one sample."""
        S = np.zeros(self.D.shape)
        for sample in self.springs:
            for a, row in enumerate(sample.coordinates):
                for b, column in enumerate(sample.coordinates):
                    S[:, row, column] += sample.slope[a, b, :, place]
        for row, memory in self.frictions:
            S[:, row, row] += memory.slope[:, self.samples + place]
        return S

    def _remembered(self, memory: Memory, number: int, place: int) -> ComplexArray:
        """(n, size) change of a force with memory that comes from one sample earlier."""
        displacement, force = (self.Y[:, self.m + 2 * number + k] for k in (0, 1))
        now = self.samples + place  # in the second of its two periods
        change = memory.slope_before[:, now, None] * displacement + memory.persistence[:, now, None] * force
        return np.asarray(change, dtype=complex)
