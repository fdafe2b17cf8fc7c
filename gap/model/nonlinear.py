"""The model of a run under a nonlinear effect: harmonic balance on the branch that the run was on.

``branch`` finds the motions from the run's data, ``sweep`` follows them where there are none. Drifts and tolerances
move the poles of the linear rotor, as in ``linear.Modal``; the true force of a run is not quite the one that it
believes. Derivatives by these follow from the balance's own Jacobian.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from rigtwin.gap.model.branch import Branch, Known
from rigtwin.gap.model.linear import chain_factors, of_resonances_towards_damping, towards_damping
from rigtwin.gap.model.motion_slopes import MotionSlopes
from rigtwin.gap.model.motions import Drive, Resolution, Solved
from rigtwin.gap.model.run_model import RunModel
from rigtwin.gap.model.sweep import follow_sweep
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rigtwin.sim.campaign import Run

# Relative step of a tolerance for a derivative.
_TOLERANCE_STEP = 1e-7


@dataclass(frozen=True)
class NonlinearModal(RunModel):
    """Noise-free fundamental of one run; see ``RunModel``."""

    level_is_parameter: ClassVar[bool] = True

    run: Run
    balance_of: Callable[[FloatArray], tuple[Balance, IntArray]]  # by (n_tolerances,); and ``mode`` of each pole
    balance: Balance  # at the anchor
    mode: IntArray  # (n_states,) resonance that each pole of the linear rotor belongs to, -1: none
    sensitivity: ComplexArray  # (MODES, n_tolerances)
    anchor: FloatArray  # (n_tolerances,)
    effects: tuple[Effect, ...]
    numbers: FloatArray  # k_b and the effects' parameters
    known: dict[tuple, Known]
    resolution: Resolution
    with_data: bool  # whether the run's own values say which branch it is on
    level: float = 0.0  # logarithm of the true force over the one that the run believes; responses are per true force
    _solved: dict[bytes, Solved] = field(default_factory=dict)
    _driven: dict[float, NonlinearModal] = field(default_factory=dict)

    @property
    def as_nonlinear(self) -> NonlinearModal:
        """Itself."""
        return self

    def response(
        self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None, level: float = 0.0
    ) -> ComplexArray:
        """As ``Modal.response``, under a force e^level as large as the run believes."""
        return self.at_level(level).motions(drift, tolerance).H

    def with_derivatives(
        self, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """As ``Modal.with_derivatives``, (2 MODES + n_tolerances + 1, n_freq, n_channels), the last by the level."""
        there = self.at_level(level)
        solved = there.motions(drift, tolerance)
        slopes = MotionSlopes(there.drive, solved)
        most = len(self.sensitivity)
        D = np.zeros((2 * most, *solved.H.shape), dtype=complex)
        if n_modes := min(len(self.frequencies_hz), most):
            D[:n_modes], D[most : most + n_modes] = np.split(slopes.by_mode(n_modes), 2)
        if self.resolution.bends and len(tolerance):
            near = [
                _drift_poles(*self.balance_of(t), drift) for t in tolerance + _TOLERANCE_STEP * np.eye(len(tolerance))
            ]
            by_tolerance = slopes.by_rotors(near, _TOLERANCE_STEP)
        else:
            by_tolerance = np.tensordot(self._of_drifts.T, D, axes=1)
        every = np.concatenate([D, by_tolerance, slopes.by_level()])
        return solved.H, np.where(solved.tells[:, None], every, 0.0)

    def small_change_to(
        self, other: RunModel, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> ComplexArray:
        """(n_freq, n_channels) the response with the same laws, other numbers or more linear effects less this one, to
        first order. No first order leads to one whose laws are pushed across the force, too."""
        if other.as_nonlinear is None or other.as_nonlinear.balance.n_joints != self.balance.n_joints:
            return self.change_to(other, drift, tolerance, level)
        there = self.at_level(level)
        solved = there.motions(drift, tolerance)
        balance = _drift_poles(*other.as_nonlinear._with_tolerance(tolerance), drift)
        reported = solved.H * (other.as_nonlinear.chain / self.chain - 1)
        return np.where(solved.tells[:, None], MotionSlopes(there.drive, solved).change_to(balance) + reported, 0.0)

    def at_level(self, level: float) -> NonlinearModal:
        """The same under a force e^level as large as the run believes, remembered."""
        if level == self.level:
            return self
        if level not in self._driven:
            self._driven.clear()
            self._driven[level] = replace(self, level=float(level), _solved={}, _driven={})
        return self._driven[level]

    @cached_property
    def _of_drifts(self) -> FloatArray:
        """(2 MODES, n_tolerances) drifts, of frequency and damping apart, that do to resonances what tolerances do."""
        zeta = of_resonances_towards_damping(self.balance.values, self.mode).imag[:, None]
        damped = np.where(zeta > 0, self.sensitivity.imag / np.where(zeta > 0, zeta, 1.0), 0.0)
        return np.concatenate([self.sensitivity.real, damped])

    @property
    def frequencies_hz(self) -> FloatArray:
        """Resonances of the linear part that may drift, lowest first [Hz]."""
        values: ComplexArray = self.balance.values
        positive = (self.mode >= 0) & (values.imag > 0)
        return np.sort(np.abs(values[positive])) / (2 * np.pi)

    def found(self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None) -> BoolArray:
        """(n_freq,) lines with a motion."""
        return self.motions(drift, tolerance).converged

    def harmonic(
        self, order: int, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> ComplexArray | FloatArray:
        """As ``RunModel.harmonic``: what the harmonics of the joints' forces move."""
        if order > self.resolution.harmonics:
            return super().harmonic(order, drift, tolerance, level)
        solved = self.at_level(level).motions(drift, tolerance)
        there = self.run.at_order(order)
        chain = chain_factors(self.effects, there, np.arange(len(there.channels)))
        drive = Drive(there, level, chain)
        sensors = drive.by_force(solved.balance)[0][:, :, :-1]
        return -drive.scale * (sensors @ solved.forces[:, order, :, None])[..., 0]

    def tells(
        self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None, level: float = 0.0
    ) -> BoolArray:
        """(n_freq,) lines of which ``response`` has a slope; elsewhere it is where Newton's method was left."""
        return self.at_level(level).motions(drift, tolerance).tells

    def motions(self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None) -> Solved:
        """The run's motions with drifts (MODES,) and tolerances (n_tolerances,), remembered."""
        drift = np.zeros(len(self.sensitivity), dtype=complex) if drift is None else drift.astype(complex)
        tolerance = self.anchor if tolerance is None else tolerance
        key = drift.tobytes() + tolerance.tobytes()
        if key not in self._solved:
            if len(self._solved) > 2:
                self._solved.pop(next(iter(self._solved)))
            plain, mode = self._with_tolerance(tolerance)
            balance = _drift_poles(plain, mode, drift)
            if self.with_data:
                made = self.branch.find(balance)
            else:
                made = follow_sweep(self.drive, balance, self.resolution.iterations)
            self._solved[key] = replace(made, plain=plain, mode=mode)
        return self._solved[key]

    def _with_tolerance(self, tolerance: FloatArray) -> tuple[Balance, IntArray]:
        return (self.balance, self.mode) if np.array_equal(tolerance, self.anchor) else self.balance_of(tolerance)

    @cached_property
    def chain(self) -> ComplexArray:
        """(n_freq, n_channels) reported over true response."""
        return chain_factors(self.effects, self.run, np.arange(len(self.run.channels)))

    @property
    def drive(self) -> Drive:
        """How the run drives the rotor and reads it."""
        return Drive(self.run, self.level, self.chain)

    @property
    def branch(self) -> Branch:
        """The search for the branch that the run's own values are on."""
        places = tuple((e.id, *(getattr(e, name) for name in e.places())) for e in self.effects)
        return Branch(self.drive, places, self.numbers, self.known, self.resolution)

    def begin_with(self, joints: ComplexArray) -> None:
        """Start from (n_freq, K, n_joints) motions that are known of this run."""
        self.branch.begin_with(self.balance, joints)

    def read_joints(
        self, drift: ComplexArray, tolerance: FloatArray
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """What the run says of the joints, whatever their law.

        Returns
        -------
        (n_freq, K, n_joints) displacements [m]; (n_freq, n_channels, n_joints) what a newton of a joint's force takes
        from the response; (n_freq, n_channels) the response without any
        """
        drive, balance = self.drive, _drift_poles(*self._with_tolerance(tolerance), drift)
        sensors = drive.scale[:, :, None] * drive.by_force(balance)[0]
        return self.branch.measured_motion(balance), sensors[:, :, :-1], drive.force[:, None] * sensors[:, :, -1]


def _drift_poles(plain: Balance, mode: IntArray, drift: ComplexArray) -> Balance:
    """The balance with shifted resonances."""
    balance = copy.copy(plain)
    shift = drift.real[mode] + towards_damping(plain.values) * drift.imag[mode]
    balance.values = plain.values * (1 + np.where(mode >= 0, shift, 0.0))
    return balance
