"""The model of a run under a nonlinear effect: harmonic balance on the branch that the run was on.

Every line is a motion of its own. Its start is inverted from the measured response: the joints' forces N that, with
the rotor's own receptances, give what the sensors read,

    y_s = H_sF F - sum_j H_sj N_j,   X_j = H_jF F - sum_i H_ji N_i,

so that Newton's method finds the branch the data are on, without following curves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotor.condition import Condition
from rotor.effects import Effect
from rotor.harmonic_balance import Balance
from rotor.measured import DERIVATIVE_ORDER
from rotor.model import RotorModel
from rotor.structure import ComplexArray, FloatArray
from sim.campaign import Run

BoolArray = NDArray[np.bool_]

HARMONICS, SAMPLES, CORNER = 3, 128, 0.02

# Truncation to three harmonics, the rounded corners and neighbouring branches leave this much.
MODEL_ERROR = 0.01


@dataclass(frozen=True)
class NonlinearModal:
    """Noise-free fundamental of one run; drifts and tolerances act by first order."""

    run: Run
    H: ComplexArray  # (n_freq, n_channels)
    by_frequency: ComplexArray  # (n_freq, n_channels) derivative by the logarithm of all resonances together
    frequencies_hz: FloatArray  # of the linear part, those that may drift
    sensitivity: FloatArray  # (MODES, n_tolerances)
    effects: tuple[Effect, ...]
    joints: ComplexArray  # (n_freq, K, n_joints) converged motion
    found: BoolArray  # (n_freq,)

    def response(self, drift: FloatArray | None = None, tolerance: FloatArray | None = None) -> ComplexArray:
        """As ``Modal.response``."""
        shift = np.zeros(len(self.sensitivity)) if drift is None else drift
        if tolerance is not None:
            shift = shift + self.sensitivity @ tolerance
        return self.H + np.tensordot(shift, self._by_mode(), axes=1)

    def with_derivatives(self, drift: FloatArray, tolerance: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """As ``Modal.with_derivatives``."""
        D = self._by_mode()
        return self.response(drift, tolerance), np.concatenate([D, np.tensordot(self.sensitivity.T, D, axes=1)])

    def _by_mode(self) -> ComplexArray:
        """(MODES, n_freq, n_channels): a line belongs to the resonance next to it."""
        D = np.zeros((len(self.sensitivity), *self.H.shape), dtype=complex)
        f = self.frequencies_hz
        if len(f):
            nearest = np.argmin(np.abs(np.log(self.run.frequency_hz[:, None] / f)), axis=1)
            for m in range(len(f)):
                D[m][nearest == m] = self.by_frequency[nearest == m]
        return D


def solve_run(
    run: Run,
    model: RotorModel,
    condition: Condition,
    start: ComplexArray | None,
) -> tuple[ComplexArray, ComplexArray, ComplexArray, BoolArray]:
    """Fundamental of every line, its derivative by the logarithm of the frequency, joints, and which converged.

    Parameters
    ----------
    run : gives lines, channels, force and, where there is no start, the motion to start from
    model, condition : rotor with its local forces
    start : (n_freq, K, n_joints) joints of a neighbouring candidate
    """
    balance = Balance(model, condition, harmonics=HARMONICS, samples=SAMPLES, corner=CORNER)
    force = run.force_amplitude_N or 1.0
    read = np.stack([balance.read_out(1 if c.plane == "y" else 2)[c.node - 1] for c in run.channels])
    if start is None or start.shape[2] != balance.n_joints:
        start = _start(run, balance, read, force)
    motions = balance.solve(run.frequency_hz, force, start)
    scale = (2j * np.pi * run.frequency_hz[:, None]) ** DERIVATIVE_ORDER[run.quantity]
    unit = 1.0 if run.quantity == "acceleration" else 1 / force
    H = unit * scale * (motions.states[:, 1] @ read.T)
    step = 1e-4
    near = balance.solve(run.frequency_hz * (1 - step), force, motions.joints)
    moved = unit * (scale * (1 - step) ** DERIVATIVE_ORDER[run.quantity]) * (near.states[:, 1] @ read.T)
    converged = motions.converged
    both = (converged & near.converged)[:, None]
    small = np.abs(moved - H) < 0.3 * np.abs(H) + 1e-300
    slope = np.where(both & small, (moved - H) / step, 0.0)
    return np.where(converged[:, None], H, 0.0), slope, motions.joints, converged


def _start(run: Run, balance: Balance, read: ComplexArray, force: float) -> ComplexArray:
    """(n_freq, K, n_joints) joints that the measured fundamental tells of; higher harmonics start at zero."""
    omega = 2 * np.pi * run.frequency_hz
    states = balance.resolvent(omega, balance.loads)[:, 1]  # (n_freq, n_states, n_joints + 1)
    sensors, joints = read @ states, balance.left @ states
    unit = 1.0 if run.quantity == "acceleration" else force
    y = unit * np.nan_to_num(run.H) / (1j * omega[:, None]) ** DERIVATIVE_ORDER[run.quantity]
    if run.magnitude_only:
        y = sensors[:, :, -1] * force
    wanted = sensors[:, :, -1] * force - y
    N = (np.linalg.pinv(sensors[:, :, :-1], rcond=1e-3) @ wanted[..., None])[..., 0]
    X = joints[:, :, -1] * force - (joints[:, :, :-1] @ N[..., None])[..., 0]
    start = np.zeros((len(omega), balance.harmonics + 1, balance.n_joints), dtype=complex)
    start[:, 1] = X
    return start
