"""The branch that a run's motions are on, found from what its sensors read.

Every line is a motion of its own. Its start is inverted from the measured response: the joints' forces N that, with
the rotor's own receptances, give what the sensors read,

    y_s = H_sF F - sum_j H_sj N_j,   X_j = H_jF F - sum_i H_ji N_i,

so that Newton's method finds the branch the data are on, without following curves. Lines that end far from the data
are started again from other motions; the one nearest to the data counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.gap.model.motions import Drive, Resolution, Solved
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray, IntArray


@dataclass(frozen=True)
class BranchSearch:
    """When a line is started again, and how its force is suited."""

    far: float = 0.05  # [-] distance to the data from which a line is started again, ...
    farther: float = 4.0  # ... and so many times that of the median line
    near: float = 2e-3  # [-] parameters this near to the known motion's: it is the start, and no other is tried
    in_vain: int = 10  # candidates in a row that no start brings to the data, then none is tried at that line
    in_vain_with_memory: int = 3  # the same with memory: a start costs many times as much, motions are hardly several
    widest: float = 0.7  # [-] a measured displacement's logarithm changes by so much at most to suit the force, ...
    rounds: int = 5  # ... in so many rounds
    shares: int = 9  # tried in each round


_SEARCH = BranchSearch()

# Where only magnitudes were measured: phases [rad] against the linear rotor's response. Past its resonance a motion
# that is still below its own is opposite. Of rough motions these let wrong candidates pass for right ones.
_PHASES = {"in phase": 0.0, "opposite": np.pi, "a quarter later": np.pi / 2}


@dataclass
class Known:
    """The last motion of a run under some effects: where the next candidate starts."""

    numbers: FloatArray  # k_b and the effects' parameters
    joints: ComplexArray  # (n_freq, K, n_joints)
    lost: IntArray  # (n_freq,) candidates in a row that no start brought to the data


@dataclass(frozen=True)
class Branch:
    """Motions of a run on the branch that its own values say it is on."""

    drive: Drive
    places: tuple  # id and places of every effect
    numbers: FloatArray  # k_b and the effects' parameters
    known: dict[tuple, Known]
    resolution: Resolution

    def begin_with(self, balance: Balance, joints: ComplexArray) -> None:
        """Start from (n_freq, K, n_joints) motions that are known of this run."""
        lost = np.zeros(len(self.drive.run.frequency_hz), dtype=int)
        self.known[self._kind(balance)] = Known(self.numbers, joints, lost)

    def _kind(self, balance: Balance) -> tuple:
        """What motions belong to: a run, effects at their places, harmonics."""
        run = self.drive.run
        test = (run.support, run.excitation_node, run.excitation_plane, run.force_amplitude_N, run.sweep, run.name)
        return (*test, run.frequency_hz.tobytes(), self.places, balance.harmonics, balance.n_joints)

    def find(self, balance: Balance) -> Solved:
        """The motions of all lines, from the last ones that are known or else from the data; remembered."""
        if self.resolution.harmonics == 1:
            return self._solve(balance, self.measured_motion(balance))
        kind = self._kind(balance)
        known = self.known.get(kind)
        near = known is not None and np.allclose(known.numbers, self.numbers, rtol=_SEARCH.near, atol=0.0)
        best = self._solve(balance, self.measured_motion(balance) if known is None else known.joints)
        lost = np.zeros(len(best.omega), dtype=int) if known is None else known.lost
        if not near:
            vain = lost >= (_SEARCH.in_vain_with_memory if balance.memory else _SEARCH.in_vain)
            best = self.start_again(balance, best, vain)
            lost = np.where(_are_far(best, self.drive.miss(best)), lost + 1, 0)
        good = np.isfinite(best.joints).all(axis=(1, 2)) & best.converged
        start = best.joints if known is None else known.joints
        self.known[kind] = Known(self.numbers, np.where(good[:, None, None], best.joints, start), lost)
        return best

    def _solve(self, balance: Balance, start: ComplexArray, lines: IntArray | None = None) -> Solved:
        return self.drive.solve(balance, start, self.resolution.iterations, lines)

    def start_again(self, balance: Balance, best: Solved, given_up: BoolArray) -> Solved:
        """Start lines that are far from the data again: from the data, without the law, and from their neighbours."""
        phases = _PHASES if self.drive.run.magnitude_only and self.resolution.turned else ()
        for start in ("data", "force", "linear", "left", "right", *phases):
            miss = self.drive.miss(best)
            far = np.flatnonzero(_are_far(best, miss) & ~given_up)
            if not len(far):
                break
            other = self._solve(balance, self._start(start, balance, best, far), far)
            least = np.where(best.converged[far], miss[far], np.inf)
            best = best.with_lines(other, far, other.converged & (self.drive.miss(other, far) < least))
        return best

    def _start(self, start: str, balance: Balance, best: Solved, lines: IntArray) -> ComplexArray:
        """(n_lines, K, n_joints) motions of one kind that some lines are started from."""
        if start == "data":
            return self.measured_motion(balance)[lines]
        if start == "force":
            return self.measured_force(balance, lines)
        if start in _PHASES:
            return self.measured_motion(balance, _PHASES[start])[lines]
        if start == "linear":
            return self.drive.force[lines, None, None] * balance.receptance(self.drive.omega[lines])[1]
        return best.joints[np.clip(lines + (1 if start == "right" else -1), 0, len(best.omega) - 1)]

    def measured_motion(self, balance: Balance, phase: float | None = None) -> ComplexArray:
        """(n_freq, K, n_joints) joints that the data tell of; harmonics and mean start at zero."""
        return self.measured_joints(balance, phase)[0]

    def measured_force(self, balance: Balance, lines: IntArray) -> ComplexArray:
        """The same of some lines, made larger or smaller until the laws give the forces that the data tell of.

        A stiff law turns a small error of the displacement into a large one of the force.
        """
        X, N = (each[lines] for each in self.measured_joints(balance))
        size = np.maximum(np.abs(N), 1e-300)
        best, width = np.zeros(N.shape), _SEARCH.widest
        for _ in range(_SEARCH.rounds):
            tried = best + width * np.linspace(-1, 1, _SEARCH.shares)[:, None, None]
            made = [balance.forces.harmonics(X * np.exp(each)[:, None])[:, 1] for each in tried]
            off = np.abs(np.array(made) - N) / size + 1e-3 * np.abs(tried)
            best = np.take_along_axis(tried, off.argmin(axis=0)[None], axis=0)[0]
            width /= 4
        return X * np.exp(best)[:, None]

    def measured_joints(self, balance: Balance, phase: float | None = None) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, K, n_joints) displacements [m] and (n_freq, n_joints) fundamentals of the forces [N].

        Magnitudes tell nothing, unless they are given the phases of the linear rotor's response, turned by ``phase``.
        """
        drive, run = self.drive, self.drive.run
        sensors, joints = drive.by_force(balance)
        linear = sensors[:, :, -1] * drive.force[:, None]
        there = np.isfinite(run.H)
        y = np.where(there, np.nan_to_num(run.H) / drive.scale, linear)
        if run.magnitude_only:
            y = linear if phase is None else np.abs(y) * np.exp(1j * (np.angle(linear) + phase))
        elif run.quantity == "acceleration":  # of an arbitrary scale
            usable = (np.abs(y) > 0) & (np.abs(linear) > 0)
            y = y / np.exp(np.median(np.log(np.abs(y[usable] / linear[usable])))) if usable.any() else y
        felt = np.where(there[..., None], sensors[:, :, :-1], 0.0)
        N = (np.linalg.pinv(felt, rcond=1e-3) @ (linear - y)[..., None])[..., 0]
        start = np.zeros((len(linear), balance.harmonics + 1, balance.n_joints), dtype=complex)
        start[:, 1] = joints[:, :, -1] * drive.force[:, None] - (joints[:, :, :-1] @ N[..., None])[..., 0]
        return start, N


def _are_far(solved: Solved, miss: FloatArray) -> BoolArray:
    """(n_freq,) lines far from the data, and farther than most, by their distances; or without a motion."""
    return (miss > max(_SEARCH.far, _SEARCH.farther * float(np.median(miss)))) | ~solved.converged
