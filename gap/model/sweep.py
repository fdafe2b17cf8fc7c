"""Motions of a run without data: its sweep is followed from line to line, as a rotor under a force law follows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.gap.model.motions import Drive, Solved
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.model.arrays import ComplexArray


@dataclass(frozen=True)
class SweepSteps:
    """How a motion is followed from one line to the next."""

    jump: float = 0.3  # [-] a motion that changes by more in one step has jumped
    shortest: float = 4.0**-6  # [-] shortest step, over the way from one line to the next
    beyond: tuple[float, ...] = (0.0, 0.01, 0.03, 0.06, 0.12, 0.25)  # [-] ways past a line from which it is come to


_STEPS = SweepSteps()


def follow_sweep(drive: Drive, balance: Balance, iterations: int) -> Solved:
    """Follow the run's sweep from its first line; where a branch ends, fall onto the one that comes from beyond.

    Where that has none either, Newton's method starts from the last motion, and may not come to another.
    """
    hz = drive.run.frequency_hz
    joints = np.zeros((len(hz), balance.harmonics + 1, balance.n_joints), dtype=complex)
    before: tuple[float, ComplexArray] | None = None
    last = joints[0]
    for line in np.arange(len(hz))[:: -1 if drive.run.sweep == "down" else 1]:
        here = float(hz[line])
        X = None if before is None else _follow(drive, balance, *before, here)
        if X is None:
            X = _land(drive, balance, here)
        before = None if X is None else (here, X)
        last = joints[line] = last if X is None else X
    return drive.solve(balance, joints, iterations)


def _follow(drive: Drive, balance: Balance, hz_before: float, before: ComplexArray, hz: float) -> ComplexArray | None:
    """The motion (K, n_joints) that continues a known one; None where the branch ends on the way."""
    here, X, step = hz_before, before, hz - hz_before
    shortest = _STEPS.shortest * abs(step)
    while here != hz:
        there = hz if abs(step) >= abs(hz - here) else here + step
        motions = balance.solve(there, drive.force_at(there), X[None])
        new = motions.joints[0]
        if motions.converged[0] and np.linalg.norm(new - X) < _STEPS.jump * np.linalg.norm(new):
            here, X, step = there, new, 2 * step
        elif abs(step) > shortest:
            step /= 4
        else:
            return None
    return X


def _land(drive: Drive, balance: Balance, hz: float) -> ComplexArray | None:
    """The motion that is come to from beyond the line, where there is one motion only."""
    sign = -1 if drive.run.sweep == "down" else 1
    for way in _STEPS.beyond:
        beyond = hz * (1 + sign * way)
        motions = balance.solve(beyond, drive.force_at(beyond))
        if motions.converged[0]:
            X = _follow(drive, balance, float(motions.frequency_hz[0]), motions.joints[0], hz)
            if X is not None:
                return X
    return None
