"""The model of a run under a nonlinear effect: harmonic balance on the branch that the run was on.

Every line is a motion of its own. Its start is inverted from the measured response: the joints' forces N that, with
the rotor's own receptances, give what the sensors read,

    y_s = H_sF F - sum_j H_sj N_j,   X_j = H_jF F - sum_i H_ji N_i,

so that Newton's method finds the branch the data are on, without following curves. Lines that end far from the data
are started again from other motions; the one nearest to the data counts. Without data a sweep is followed line by line.

Drifts and tolerances move the poles of the linear rotor, as in ``modal.Modal``; the true force of a run is not quite
the one that it believes. Derivatives by these follow from the balance's own Jacobian.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from rigtwin.gap.model.run_model import BoolArray, RunModel
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.harmonic_balance import Balance, jacobian
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.frequency.periodic_force import real_form
from rigtwin.rotor.model.structure import ComplexArray, FloatArray, IntArray
from rigtwin.sim.campaign import Run

# A line this far from the data, and so many times as far as the median line, is started again.
_FAR, _FARTHER = 0.05, 4.0

# A measured displacement is changed by such a share (of its logarithm) at most, in so many rounds, to suit the force.
_WIDEST, _ROUNDS = 0.7, 5

# Where only magnitudes were measured: phases against the linear rotor's response; past its resonance a motion that is
# still below its own is opposite. Of rough motions these let wrong candidates pass for right ones.
_PHASES = {"in phase": 0.0, "opposite": np.pi, "a quarter later": np.pi / 2}

# Parameters this near to those of the known motion: it is the start, and no other is tried.
_NEAR = 2e-3

# Candidates in a row that no start brings to the data at a line, after which none is tried there in the same fit; with
# memory, where a start costs many times as much, and the motions of a line are hardly ever several.
_IN_VAIN, _IN_VAIN_WITH_MEMORY = 10, 3

# What Newton's method would change next of a motion that tells a slope, relative; elsewhere it was left far from any.
_TELLS = 1e-3

# Step of a tolerance for a derivative.
_STEP = 1e-7

# Sweeps without data: in a step the motion changes by less than this, or it has jumped; the shortest step is this share
# of the way from one line to the next.
_JUMP, _SHORTEST = 0.3, 4.0**-6

# Frequencies above a line from which a branch is come down on where the one below has ended.
_ABOVE = (0.01, 0.03, 0.06, 0.12, 0.25)


@dataclass(frozen=True)
class Resolution:
    """How finely a periodic motion is computed."""

    harmonics: int = 3
    samples: int = 128
    iterations: int = 15  # of Newton's method; where they are too few the last force counts
    bends: bool = False  # whether derivatives by the tolerances follow the modes' shapes, or their frequencies alone
    turned: bool = False  # whether magnitudes are given the linear rotor's phases, turned, where a line has no start


# Rounding of the corners of laws with a gap, relative to the gap: more of it is a stiffness that is felt at rest.
CORNER = 1e-4

ROUGH = Resolution(1, 64, 5)
MIDDLE = Resolution(3, 128, 8)
FINE = Resolution(3, 128, 15)
FINAL = Resolution(15, 1024, 25, bends=True, turned=True)


@dataclass
class Known:
    """The last motion of a run under some effects: where the next candidate starts."""

    numbers: FloatArray  # k_b and the effects' parameters
    joints: ComplexArray  # (n_freq, K, n_joints)
    lost: IntArray  # (n_freq,) candidates in a row that no start brought to the data


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


@dataclass(frozen=True)
class NonlinearModal:
    """Noise-free fundamental of one run; see ``RunModel``."""

    level_is_parameter: ClassVar[bool] = True

    run: Run
    balance_of: Callable[
        [FloatArray], tuple[Balance, IntArray]
    ]  # for tolerances (n_tolerances,); ``mode`` of each pole
    balance: Balance  # without tolerances
    mode: IntArray  # (n_states,) resonance that each pole of the linear rotor belongs to, -1: none
    sensitivity: FloatArray  # (MODES, n_tolerances)
    effects: tuple[Effect, ...]
    numbers: FloatArray  # k_b and the effects' parameters
    known: dict[tuple, Known]
    resolution: Resolution
    with_data: bool  # whether the run's own values say which branch it is on
    level: float = 0.0  # logarithm of the true force over the one that the run believes; responses are per true force
    _solved: dict[bytes, Solved] = field(default_factory=dict)
    _driven: dict[float, NonlinearModal] = field(default_factory=dict)

    @property
    def as_linear(self) -> None:
        """None: a force law acts."""
        return

    @property
    def as_nonlinear(self) -> NonlinearModal:
        """Itself."""
        return self

    def response(
        self, drift: FloatArray | None = None, tolerance: FloatArray | None = None, level: float = 0.0
    ) -> ComplexArray:
        """As ``Modal.response``, under a force e^level as large as the run believes."""
        return self.driven(level).solved(drift, tolerance).H

    def with_derivatives(
        self, drift: FloatArray, tolerance: FloatArray, level: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """As ``Modal.with_derivatives``, (MODES + n_tolerances + 1, n_freq, n_channels): the last one by the level."""
        there = self.driven(level)
        solved = there.solved(drift, tolerance)
        D = there._by_mode(solved)
        if self.resolution.bends:
            by_tolerance = there._by_tolerance(solved, drift, tolerance)
        else:
            by_tolerance = np.tensordot(self.sensitivity.T, D, axes=1)
        every = np.concatenate([D, by_tolerance, there._by_level(solved)])
        return solved.H, np.where(solved.tells[:, None], every, 0.0)

    def change_to(self, other: RunModel, drift: FloatArray, tolerance: FloatArray, level: float = 0.0) -> ComplexArray:
        """(n_freq, n_channels) another response less this one."""
        return other.response(drift, tolerance, level) - self.response(drift, tolerance, level)

    def small_change_to(
        self, other: RunModel, drift: FloatArray, tolerance: FloatArray, level: float = 0.0
    ) -> ComplexArray:
        """(n_freq, n_channels) the response with other numbers of the same laws less this one, to first order."""
        if other.as_nonlinear is None:
            return self.change_to(other, drift, tolerance, level)
        there = self.driven(level)
        solved = there.solved(drift, tolerance)
        balance = _drifted(*other.as_nonlinear._with_tolerance(tolerance), drift)
        push, own = there._moved_by(solved, balance, balance.forces.harmonics(solved.joints))
        change = there._answer(solved, push[..., None], own[..., None])[0]
        return np.where(solved.tells[:, None], change, 0.0)

    def driven(self, level: float) -> NonlinearModal:
        """The same under a force e^level as large as the run believes, remembered."""
        if level == self.level:
            return self
        if level not in self._driven:
            self._driven.clear()
            self._driven[level] = replace(self, level=float(level), _solved={}, _driven={})
        return self._driven[level]

    def driven_and_read_by(self, effects: Sequence[Effect]) -> None:
        """None: what drives and reads the rotor belongs to the motions, which have to be solved again."""
        return

    @property
    def frequencies_hz(self) -> FloatArray:
        """Resonances of the linear part that may drift, lowest first [Hz]."""
        values: ComplexArray = self.balance.values
        positive = (self.mode >= 0) & (values.imag > 0)
        return np.sort(np.abs(values[positive])) / (2 * np.pi)

    def found(self, drift: FloatArray | None = None, tolerance: FloatArray | None = None) -> BoolArray:
        """(n_freq,) lines with a motion."""
        return self.solved(drift, tolerance).converged

    def tells(
        self, drift: FloatArray | None = None, tolerance: FloatArray | None = None, level: float = 0.0
    ) -> BoolArray:
        """(n_freq,) lines of which ``response`` has a slope; elsewhere it is where Newton's method was left."""
        return self.driven(level).solved(drift, tolerance).tells

    def solved(self, drift: FloatArray | None = None, tolerance: FloatArray | None = None) -> Solved:
        """The run's motions with drifts (MODES,) and tolerances (n_tolerances,), remembered."""
        n_modes, n_tolerances = self.sensitivity.shape
        drift = np.zeros(n_modes) if drift is None else drift
        tolerance = np.zeros(n_tolerances) if tolerance is None else tolerance
        key = drift.tobytes() + tolerance.tobytes()
        if key not in self._solved:
            if len(self._solved) > 2:
                self._solved.pop(next(iter(self._solved)))
            plain, mode = self._with_tolerance(tolerance)
            balance = _drifted(plain, mode, drift)
            made = self._by_data(balance) if self.with_data else self._by_sweep(balance)
            self._solved[key] = replace(made, plain=plain, mode=mode)
        return self._solved[key]

    def _with_tolerance(self, tolerance: FloatArray) -> tuple[Balance, IntArray]:
        return self.balance_of(tolerance) if tolerance.any() else (self.balance, self.mode)

    # -- without solving -------------------------------------------------------------------------

    def told(self, drift: FloatArray, tolerance: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """What the run says of the joints, whatever their law.

        Returns
        -------
        (n_freq, K, n_joints) displacements [m]; (n_freq, n_channels, n_joints) what a newton of a joint's force takes
        from the response; (n_freq, n_channels) the response without any
        """
        balance = _drifted(*self._with_tolerance(tolerance), drift)
        sensors = self._unit * self._scale[:, None, None] * self._by_force(balance)[0]
        return self._measured_motion(balance), sensors[:, :, :-1], self._force * sensors[:, :, -1]

    # -- the branch that the data are on ---------------------------------------------------------

    def begin_with(self, joints: ComplexArray) -> None:
        """Start from (n_freq, K, n_joints) motions that are known of this run."""
        lost = np.zeros(len(self.run.frequency_hz), dtype=int)
        self.known[self._kind(self.balance)] = Known(self.numbers, joints, lost)

    def _kind(self, balance: Balance) -> tuple:
        """What motions belong to: a run, effects at their places, harmonics."""
        run, places = self.run, tuple((e.id, *(getattr(e, name) for name in e.places())) for e in self.effects)
        test = (run.support, run.excitation_node, run.excitation_plane, run.force_amplitude_N, run.sweep, run.name)
        return (*test, run.frequency_hz.tobytes(), places, balance.harmonics, balance.n_joints)

    def _by_data(self, balance: Balance) -> Solved:
        if self.resolution.harmonics == 1:
            return self._solve(balance, self._measured_motion(balance))
        run, kind = self.run, self._kind(balance)
        known = self.known.get(kind)
        near = known is not None and np.allclose(known.numbers, self.numbers, rtol=_NEAR, atol=0.0)
        if known is None:
            best = self._solve(balance, self._measured_motion(balance))
        else:
            best = self._solve(balance, known.joints)
        lost = np.zeros(len(run.frequency_hz), dtype=int) if known is None else known.lost
        if not near:
            best = self._nearer(balance, best, lost >= (_IN_VAIN_WITH_MEMORY if balance.memory else _IN_VAIN))
            lost = np.where(_far(best, self._miss(best)), lost + 1, 0)
        good = np.isfinite(best.joints).all(axis=(1, 2)) & best.converged
        start = best.joints if known is None else known.joints
        self.known[kind] = Known(self.numbers, np.where(good[:, None, None], best.joints, start), lost)
        return best

    def _nearer(self, balance: Balance, best: Solved, given_up: BoolArray) -> Solved:
        """Start lines that are far from the data again: from the data, without the law, and from their neighbours."""
        phases = _PHASES if self.run.magnitude_only and self.resolution.turned else ()
        for start in ("data", "force", "linear", "left", "right", *phases):
            miss = self._miss(best)
            far = np.flatnonzero(_far(best, miss) & ~given_up)
            if not len(far):
                break
            if start == "data":
                joints = self._measured_motion(balance)[far]
            elif start == "force":
                joints = self._measured_force(balance, far)
            elif start in _PHASES:
                joints = self._measured_motion(balance, _PHASES[start])[far]
            elif start == "linear":
                joints = self._force * balance.receptance(self._omega[far])[1]
            else:
                joints = best.joints[np.clip(far + (1 if start == "right" else -1), 0, len(miss) - 1)]
            other = self._solve(balance, joints, far)
            better = other.converged & (self._miss(other, far) < np.where(best.converged[far], miss[far], np.inf))
            best = _replaced(best, other, far, better)
        return best

    def _solve(self, balance: Balance, start: ComplexArray, lines: IntArray | None = None) -> Solved:
        at = slice(None) if lines is None else lines
        hz, finely = self.run.frequency_hz[at], self.resolution
        motions = balance.solve(hz, self._force, start, iterations=finely.iterations)
        states = motions.states
        H = self._unit * self._scale[at, None] * (states[:, 1] @ self._read(balance).T)
        usable: BoolArray = np.asarray(np.isfinite(H).all(axis=1), dtype=bool)
        assert motions.off is not None
        tells = usable & (motions.converged | (motions.off <= _TELLS))
        H = np.where(usable[:, None], H, 0.0)
        return Solved(balance, self._omega[at], motions.joints, states, H, motions.converged & usable, tells)

    def _miss(self, solved: Solved, lines: IntArray | None = None) -> FloatArray:
        """(n_freq,) distance to the data, relative, over all channels."""
        H = self.run.H if lines is None else self.run.H[lines]
        y = np.nan_to_num(H)
        d = np.where(np.isfinite(H), np.abs(y) - np.abs(solved.H) if self.run.magnitude_only else y - solved.H, 0.0)
        return np.linalg.norm(d, axis=1) / np.maximum(np.linalg.norm(y, axis=1), 1e-300)

    def _measured_motion(self, balance: Balance, phase: float | None = None) -> ComplexArray:
        """(n_freq, K, n_joints) joints that the data tell of; harmonics and mean start at zero."""
        return self._measured(balance, phase)[0]

    def _measured_force(self, balance: Balance, lines: IntArray) -> ComplexArray:
        """The same of some lines, made larger or smaller until the laws give the forces that the data tell of.

        A stiff law turns a small error of the displacement into a large one of the force.
        """
        X, N = (each[lines] for each in self._measured(balance))
        size = np.maximum(np.abs(N), 1e-300)
        best, width = np.zeros(N.shape), _WIDEST
        for _ in range(_ROUNDS):
            tried = best + width * np.linspace(-1, 1, 9)[:, None, None]
            made = [balance.forces.harmonics(X * np.exp(each)[:, None])[:, 1] for each in tried]
            off = np.abs(np.array(made) - N) / size + 1e-3 * np.abs(tried)
            best = np.take_along_axis(tried, off.argmin(axis=0)[None], axis=0)[0]
            width /= 4
        return X * np.exp(best)[:, None]

    def _measured(self, balance: Balance, phase: float | None = None) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, K, n_joints) displacements [m] and (n_freq, n_joints) fundamentals of the forces [N].

        Magnitudes tell nothing, unless they are given the phases of the linear rotor's response, turned by ``phase``.
        """
        sensors, joints = self._by_force(balance)
        linear = sensors[:, :, -1] * self._force
        there = np.isfinite(self.run.H)
        y = np.where(there, np.nan_to_num(self.run.H) / (self._unit * self._scale[:, None]), linear)
        if self.run.magnitude_only:
            y = linear if phase is None else np.abs(y) * np.exp(1j * (np.angle(linear) + phase))
        elif self.run.quantity == "acceleration":  # of an arbitrary scale
            usable = (np.abs(y) > 0) & (np.abs(linear) > 0)
            y = y / np.exp(np.median(np.log(np.abs(y[usable] / linear[usable])))) if usable.any() else y
        felt = np.where(there[..., None], sensors[:, :, :-1], 0.0)
        N = (np.linalg.pinv(felt, rcond=1e-3) @ (linear - y)[..., None])[..., 0]
        start = np.zeros((len(linear), balance.harmonics + 1, balance.n_joints), dtype=complex)
        start[:, 1] = joints[:, :, -1] * self._force - (joints[:, :, :-1] @ N[..., None])[..., 0]
        return start, N

    def _by_force(self, balance: Balance) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, n_channels or n_joints, n_joints + 1) sensors, joints per newton at joints and exciter."""
        states = balance.resolvent(self._omega, balance.loads)[:, 1]  # (n_freq, n_states, n_joints + 1)
        return self._read(balance) @ states, balance.left @ states

    # -- a sweep ---------------------------------------------------------------------------------

    def _by_sweep(self, balance: Balance) -> Solved:
        """Follow the run's sweep from its first line; where a branch ends, fall onto the one that comes from beyond.

        Where that has none either, Newton's method starts from the last motion, and may not come to another.
        """
        n = len(self._omega)
        order = range(n - 1, -1, -1) if self.run.sweep == "down" else range(n)
        joints = np.zeros((n, balance.harmonics + 1, balance.n_joints), dtype=complex)
        before: tuple[float, ComplexArray] | None = None
        last = joints[0]
        for line in order:
            hz = float(self.run.frequency_hz[line])
            X = None if before is None else self._follow(balance, *before, hz)
            if X is None:
                X = self._land(balance, hz)
            before = None if X is None else (hz, X)
            last = joints[line] = last if X is None else X
        return self._solve(balance, joints)

    def _follow(self, balance: Balance, hz_before: float, before: ComplexArray, hz: float) -> ComplexArray | None:
        """The motion (K, n_joints) that continues a known one; None where the branch ends on the way."""
        here, X, step = hz_before, before, hz - hz_before
        shortest = _SHORTEST * abs(step)
        while here != hz:
            there = hz if abs(step) >= abs(hz - here) else here + step
            motions = balance.solve(there, self._force, X[None])
            new = motions.joints[0]
            if motions.converged[0] and np.linalg.norm(new - X) < _JUMP * np.linalg.norm(new):
                here, X, step = there, new, 2 * step
            elif abs(step) > shortest:
                step /= 4
            else:
                return None
        return X

    def _land(self, balance: Balance, hz: float) -> ComplexArray | None:
        """The motion that is come to from beyond the line, where there is one motion only."""
        sign = -1 if self.run.sweep == "down" else 1
        for way in (0.0, *_ABOVE):
            motions = balance.solve(hz * (1 + sign * way), self._force)
            if motions.converged[0]:
                X = self._follow(balance, float(motions.frequency_hz[0]), motions.joints[0], hz)
                if X is not None:
                    return X
        return None

    # -- derivatives -----------------------------------------------------------------------------

    def _by_mode(self, solved: Solved) -> ComplexArray:
        """(MODES, n_freq, n_channels) derivative by the relative shift of every resonance of the linear rotor."""
        balance, n_modes = solved.balance, len(self.frequencies_hz)
        D = np.zeros((len(self.sensitivity), *solved.H.shape), dtype=complex)
        n_modes = min(n_modes, len(D))
        if not n_modes:
            return D
        s = 1j * self._omega[:, None] * np.arange(balance.harmonics + 1)
        assert solved.plain is not None
        assert solved.mode is not None
        moved = solved.states * solved.plain.values / (s[..., None] - balance.values)  # (n_freq, K, n_states)
        belongs = (solved.mode[:, None] == np.arange(n_modes)).astype(float)  # (n_states, n_modes)
        direct = balance.left[:, :, None] * belongs  # (n_joints, n_states, n_modes)
        push = np.einsum("fks,jsm->fkjm", moved, direct, optimize=True)
        own = np.einsum("fs,cs,sm->fcm", moved[:, 1], self._read(balance), belongs, optimize=True)
        D[:n_modes] = self._answer(solved, push, own)
        return D

    def _by_tolerance(self, solved: Solved, drift: FloatArray, tolerance: FloatArray) -> ComplexArray:
        """(n_tolerances, n_freq, n_channels) derivative by the tolerances."""
        changes = []
        for one in np.eye(len(tolerance)):
            balance = _drifted(*self.balance_of(tolerance + _STEP * one), drift)
            changes.append([change / _STEP for change in self._moved_by(solved, balance, solved.forces)])
        push, own = (np.stack(parts, axis=-1) for parts in zip(*changes, strict=True))
        return self._answer(solved, push, own)

    def _by_level(self, solved: Solved) -> ComplexArray:
        """(1, n_freq, n_channels) derivative by the level; none where the rotor is linear there."""
        balance = solved.balance
        states = self._force * balance.resolvent(self._omega, balance.loads)[..., -1:]  # (n_freq, K, n_states, 1)
        return self._answer(solved, balance.left @ states, self._read(balance) @ states[:, 1]) - solved.H

    def _moved_by(self, solved: Solved, balance: Balance, forces: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """How another rotor under given forces moves beside a motion.

        Returns
        -------
        (n_freq, K, n_joints) of the joints and (n_freq, n_channels) of the sensors
        """
        amounts = np.concatenate([-forces, np.full((*forces.shape[:2], 1), self._force)], axis=2)
        states = balance.resolvent(self._omega, balance.loads @ amounts[..., None])[..., 0]
        joints = states @ balance.left.T - solved.states @ solved.balance.left.T
        return joints, states[:, 1] @ self._read(balance).T - solved.states[:, 1] @ self._read(solved.balance).T

    def _answer(self, solved: Solved, push: ComplexArray, own: ComplexArray) -> ComplexArray:
        """(m, n_freq, n_channels) derivative of the response by m numbers.

        Parameters
        ----------
        push : (n_freq, K, n_joints, m) derivative of the joints' motion, their forces held
        own : (n_freq, n_channels, m) the same of the sensors' motion
        """
        balance = solved.balance
        inverse, DN = solved.tangent
        m = push.shape[-1]
        flat = real_form(push.reshape(*push.shape[:2], -1)).reshape(len(inverse), -1, m)
        dX = (inverse @ flat).reshape(len(inverse), *DN.shape[2:], m)
        dN = np.einsum("fjun,funm->fjm", DN, dX, optimize=True)
        to_sensors = self._read(balance) @ balance.resolvent(self._omega, balance.loads)[:, 1, :, :-1]
        change = self._unit * self._scale[:, None, None] * (own - to_sensors @ dN)
        return np.moveaxis(np.where(np.isfinite(change), change, 0.0), 2, 0)

    # -- the run -----------------------------------------------------------------------------------

    @property
    def _omega(self) -> FloatArray:
        return 2 * np.pi * self.run.frequency_hz

    @property
    def _force(self) -> float:
        return (self.run.force_amplitude_N or 1.0) * float(np.exp(self.level))

    @property
    def _unit(self) -> float:
        return float(np.exp(-self.level)) if self.run.quantity == "acceleration" else 1 / self._force

    @property
    def _scale(self) -> ComplexArray:
        return (1j * self._omega) ** DERIVATIVE_ORDER[self.run.quantity]

    def _read(self, balance: Balance) -> ComplexArray:
        """(n_channels, n_states)"""
        planes = {c.plane: balance.read_out(1 if c.plane == "y" else 2) for c in self.run.channels}
        return np.stack([planes[c.plane][c.node - 1] for c in self.run.channels])


def _far(solved: Solved, miss: FloatArray) -> BoolArray:
    """(n_freq,) lines far from the data, and farther than most, by their distances; or without a motion."""
    return (miss > max(_FAR, _FARTHER * float(np.median(miss)))) | ~solved.converged


def _drifted(plain: Balance, mode: IntArray, drift: FloatArray) -> Balance:
    """The balance with shifted resonances."""
    balance = copy.copy(plain)
    balance.values = plain.values * (1 + np.where(mode >= 0, drift[mode], 0.0))
    return balance


def _replaced(best: Solved, other: Solved, lines: IntArray, better: BoolArray) -> Solved:
    """The first, with some lines of the second, which was solved on some lines alone."""
    joints, states, H = best.joints.copy(), best.states.copy(), best.H.copy()
    converged, tells = best.converged.copy(), best.tells.copy()
    taken = lines[better]
    joints[taken], states[taken], H[taken] = other.joints[better], other.states[better], other.H[better]
    converged[taken] = tells[taken] = True
    return Solved(best.balance, best.omega, joints, states, H, converged, tells)
