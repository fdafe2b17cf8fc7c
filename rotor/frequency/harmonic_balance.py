"""Periodic motion of a rotor with local forces under a sine force: harmonic balance.

The rotor's linear part is exact; the unknowns are the harmonics of the displacements at the local
forces' joints alone [krack2019],

    X_k = H_jF(k omega) F_k - H_jj(k omega) N_k(X),    k = 0 ... n_harmonics,

with the force F(t) = Re[F e^{i omega t}], peak phasors, and N_k the harmonics of the local forces
(see ``periodic_force``). Without local forces X_1 / F is the receptance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.frequency.periodic_force import PeriodicForces, complex_form, real_form
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import RotorModel
from rigtwin.rotor.model.state_space import StateSpace

# Length over which the corners of a law with a gap are rounded, relative to the gap; what it costs
# is measured by benchmarks/effects/curves.py.
CORNER = 0.002

# Samples of a period: smooth laws and those with memory, and laws with corners (see ``periodic_force``).
SAMPLES, SAMPLES_OF_CORNERS = 256, 512

# Newton's method has converged when its full step is this small relative to the motion. A longer step, up to the
# second number, that does not reduce the residual is taken for round-off.
_CONVERGED, _ROUND_OFF = 1e-9, 1e-6

_ITERATIONS, _SHORTEST_SHARE = 40, 1e-4

# Share of the force at which its rise from zero begins; it doubles from there.
_FIRST_SHARE = 2.0**-8


class Balance:
    """A rotor model with its exciting force, ready for harmonic balance.

    If the planes are not coupled and the force acts in one plane, the motion stays in that plane and
    every local force is scalar. Unbalance is left out, because its frequency is that of the spin.

    Parameters
    ----------
    model : linear rotor and local forces
    condition : place of the exciter and spin speed
    pattern : (n,) complex, the force on the model's degrees of freedom per newton of its amplitude;
        by default the condition's exciter
    harmonics : highest harmonic
    samples : of a period, at which the local forces are evaluated; by default what the laws need
    corner : rounding of the corners of laws with a gap, relative to the gap
    """

    def __init__(
        self,
        model: RotorModel,
        condition: Condition,
        *,
        pattern: ComplexArray | None = None,
        harmonics: int = 7,
        samples: int | None = None,
        corner: float = CORNER,
    ):
        cornered = any("corner" in force.law.coefficients for force in model.forces)
        self.samples = samples or (SAMPLES_OF_CORNERS if cornered else SAMPLES)
        if harmonics < 1 or self.samples <= 2 * harmonics:
            raise ValueError(f"{harmonics} harmonics need at least 1, and more than twice as many samples of a period")
        exciter = model.system.unit_vector(condition.excitation_node, condition.excitation_plane)
        shape = exciter.astype(complex) if pattern is None else np.asarray(pattern, dtype=complex)
        self.plane = _plane_of_motion(model, shape, condition.spin_speed)
        if self.plane is not None:
            shape, model = shape[model.system.plane == self.plane], model.in_plane(self.plane)
        self.system, self.harmonics, self.memory = model.system, harmonics, model.memory
        self.forces = PeriodicForces(model.forces, self.plane, harmonics, self.samples, corner)
        self._linear(StateSpace(self.system, condition.spin_speed), shape)

    def _linear(self, state: StateSpace, pattern: ComplexArray) -> None:
        """The linear part in the coordinates of its eigenvectors; in its own states where it has no full set."""
        joints = self.forces.patterns.reshape(-1, self.system.n)
        one = np.eye(state.n_states, dtype=complex)
        self.values, self.V, inverse = state.spectrum or (state.A.astype(complex), one, one)
        self.left = state.displacement(joints) @ self.V  # (n_joints, n_states)
        self.right = inverse @ state.input(joints.T)  # (n_states, n_joints)
        force = state.input(pattern.real[:, None]) + 1j * state.input(pattern.imag[:, None])
        # (1, K, n_states, n_joints + 1): unit forces at the joints in every harmonic, the exciting force in the first
        self.loads = np.zeros((1, self.harmonics + 1, state.n_states, len(joints) + 1), dtype=complex)
        self.loads[..., :-1] = self.right
        self.loads[:, 1, :, -1] = (inverse @ force)[:, 0]
        self._state = state

    @property
    def n_joints(self) -> int:
        """Number of joint coordinates."""
        return len(self.left)

    def read_out(self, plane: int) -> ComplexArray:
        """(n_nodes, n_states) deflection of every node in a plane, from the states in eigenvector coordinates."""
        return np.asarray(self._state.displacement(self.system.read_out(plane)) @ self.V, dtype=complex)

    def resolvent(self, omega: FloatArray, loads: ComplexArray) -> ComplexArray:
        """(i k omega - A)^-1 loads, in the coordinates of A's eigenvectors.

        Parameters
        ----------
        omega : (B,) [rad/s]
        loads : (B or 1, K, n_states, m)

        Returns
        -------
        (B, K, n_states, m) states
        """
        s = 1j * omega[:, None] * np.arange(self.harmonics + 1)  # (B, K)
        if self.values.ndim == 1:
            return loads / (s[..., None] - self.values)[..., None]
        one = np.eye(len(self.values))
        return np.linalg.solve(s[..., None, None] * one - self.values, loads)

    def receptance(self, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Receptances of the joints among each other and to the exciting force.

        Parameters
        ----------
        omega : (B,) [rad/s]

        Returns
        -------
        (B, K, n_joints, n_joints) H_jj(k omega) and (B, K, n_joints) H_jF, zero but for k = 1 [m/N]
        """
        H = self.left @ self.resolvent(omega, self.loads)
        return H[..., :-1], H[..., -1]

    def residual(
        self, receptance: tuple[ComplexArray, ComplexArray], force_amplitude: FloatArray | float, joints: ComplexArray
    ) -> tuple[FloatArray, FloatArray]:
        """Residual of the balance, and its derivative.

        Parameters
        ----------
        receptance : as from ``receptance``, at B frequencies
        force_amplitude : (B,) or one [N]
        joints : (B, K, n_joints) joint phasors [m]

        Returns
        -------
        (B, n) residual X - H_jF F + H_jj N [m] and (B, n, n) Jacobian, in ``real_form`` of the
        joints with n = (2 K - 1) n_joints
        """
        H, H_force = receptance
        N, DN = self.forces(joints)
        R = joints - _of_motions(force_amplitude) * H_force + (H @ N[..., None])[..., 0]
        return real_form(R).reshape(len(R), self.forces.n_unknowns * self.n_joints), jacobian(H, DN)

    def solve(
        self,
        frequency_hz: FloatArray | float,
        force_amplitude: FloatArray | float,
        start: ComplexArray | None = None,
        *,
        iterations: int | None = None,
    ) -> Motions:
        """Periodic motions at given frequencies, each by itself.

        Parameters
        ----------
        frequency_hz : (n,) or one [Hz]
        force_amplitude : (n,) or one, peak of the exciting force [N]
        start : (n, K, n_joints) joint phasors to start from [m]; by default the force is raised
            from zero in a few steps. That can fail in strongly nonlinear motion, and where there are several motions
            it is left to the start which is found: ``continuation`` follows them.
        iterations : of Newton's method, at most

        Returns
        -------
        motions, with reasons where none was found
        """
        if not np.all(np.asarray(force_amplitude) > 0):
            raise ValueError(f"the force's amplitude must be positive, got {force_amplitude} N")
        hz = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        receptance = self.receptance(2 * np.pi * hz)
        if start is None:
            share = _FIRST_SHARE
            start = share * _of_motions(force_amplitude) * receptance[1]
            while share < 1:
                start = 2 * _Newton(self, receptance, share * force_amplitude, start).run().joints
                share *= 2
        newton = _Newton(self, receptance, force_amplitude, start).run(iterations)
        stable = newton.converged & (np.linalg.slogdet(newton.jacobian)[0] > 0)
        reasons = tuple("" if ok else "Newton's method found no motion" for ok in newton.converged)
        return Motions(self, force_amplitude, hz, newton.joints, stable, reasons, newton.off)


class _Newton:
    """Newton's method for B motions, each by itself, with halved steps where the residual does not fall."""

    def __init__(
        self,
        balance: Balance,
        receptance: tuple[ComplexArray, ComplexArray],
        force_amplitude: FloatArray | float,
        start: ComplexArray,
    ):
        self.balance, self.receptance = balance, receptance
        self.force_amplitude = np.broadcast_to(force_amplitude, len(start))
        self.u = real_form(start).reshape(len(start), balance.forces.n_unknowns * balance.n_joints)
        R, J = balance.residual(receptance, force_amplitude, start)
        self.size, self.step = np.linalg.norm(R, axis=1), _solve(J, -R)
        self.jacobian = J
        self.share = np.ones(len(start))
        self.converged = np.zeros(len(start), dtype=bool)

    @property
    def joints(self) -> ComplexArray:
        """(B, K, n_joints) joint phasors [m]."""
        return self._joints(self.u)

    @property
    def off(self) -> FloatArray:
        """(B,) size of the next step relative to the motion."""
        return np.linalg.norm(self.step, axis=1) / np.maximum(np.linalg.norm(self.u, axis=1), 1e-300)

    def _joints(self, u: FloatArray) -> ComplexArray:
        return complex_form(u.reshape(len(u), self.balance.forces.n_unknowns, self.balance.n_joints))

    def run(self, iterations: int | None = None) -> _Newton:
        """Iterate until every motion has converged or stalled."""
        active = np.arange(len(self.u))
        for _ in range(_ITERATIONS if iterations is None else iterations):
            if not len(active):
                break
            active = self._iterate(active)
        return self

    def _iterate(self, active: NDArray[np.intp]) -> NDArray[np.intp]:
        """One trial step of some motions; returns those that are not done."""
        step, share = self.step[active], self.share[active]
        trial = self.u[active] + share[:, None] * step
        H, H_force = self.receptance
        force = self.force_amplitude[active]
        R, J = self.balance.residual((H[active], H_force[active]), force, self._joints(trial))
        relative = np.linalg.norm(step, axis=1) / np.maximum(np.linalg.norm(self.u[active], axis=1), 1e-300)
        short = relative <= _CONVERGED
        size = np.linalg.norm(R, axis=1)
        better = short | (size <= (1 - 0.1 * share) * self.size[active])
        good = active[better]
        self.u[good], self.size[good], self.step[good] = trial[better], size[better], _solve(J[better], -R[better])
        self.jacobian[good] = J[better]
        self.share[active] = np.where(better, np.minimum(1.0, 2 * share), share / 2)
        stalled = self.share[active] < _SHORTEST_SHARE
        self.converged[active] = (short & (share == 1)) | (~better & (relative <= _ROUND_OFF))
        return active[~self.converged[active] & ~stalled]


def jacobian(H: ComplexArray, DN: ComplexArray) -> FloatArray:
    """1 + H DN in real form.

    Parameters
    ----------
    H : (B, K, n_joints, n_joints) receptance of the joints [m/N]
    DN : (B, K, n_joints, n_unknowns, n_joints) derivative of the forces' harmonics [N/m]

    Returns
    -------
    (B, n, n), n = n_unknowns n_joints
    """
    B, K, n_joints, n_unknowns, _ = DN.shape
    n = n_unknowns * n_joints
    rows = H @ DN.reshape(B, K, n_joints, n)
    return np.eye(n) + np.concatenate([rows.real, rows.imag[:, 1:]], axis=1).reshape(B, n, n)


def amounts_of(forces: ComplexArray, force_amplitude: FloatArray | float) -> ComplexArray:
    """What a balance's loads are multiplied by: the joints' forces, which pull back, and the exciting force.

    Parameters
    ----------
    forces : (B, K, n_joints) [N]
    force_amplitude : (B,) or one [N]

    Returns
    -------
    (B, K, n_joints + 1) [N]
    """
    amounts = np.empty((*forces.shape[:2], forces.shape[2] + 1), dtype=complex)
    amounts[..., :-1], amounts[..., -1:] = -forces, _of_motions(force_amplitude)
    return amounts


def _of_motions(force_amplitude: FloatArray | float) -> FloatArray:
    """(B or 1, 1, 1) amplitudes that go with (B, K, n) phasors."""
    return np.reshape(force_amplitude, (-1, 1, 1))


def _solve(J: FloatArray, R: FloatArray) -> FloatArray:
    return np.linalg.solve(J, R[..., None])[..., 0]


def _plane_of_motion(model: RotorModel, pattern: ComplexArray, spin_speed: float) -> int | None:
    """1 or 2 where the motion stays in that plane, None where both planes move."""
    plane = model.system.plane_of_motion(pattern, spin_speed)
    pushed_aside = any(force.law.radial and force.offset for force in model.forces)
    return None if plane == 2 and pushed_aside else plane


@dataclass(frozen=True)
class Motions:
    """n periodic motions, under one amplitude of the exciting force or each under its own."""

    balance: Balance
    force_amplitude: FloatArray | float  # (n,) or one [N]
    frequency_hz: FloatArray  # (n,)
    joints: ComplexArray  # (n, K, n_joints) peak phasors of the joint coordinates, k = 0 ... n_harmonics [m]
    stable: NDArray[np.bool_]  # (n,) against drifting off to another motion of the same period; see ``stability``
    reasons: tuple[str, ...]  # (n,) why there is no such motion; empty: there is
    off: FloatArray | None = None  # (n,) what Newton's method would change next, relative; None: not by it alone

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(n,) whether the motion was found; elsewhere its phasors mean nothing."""
        return np.array([not reason for reason in self.reasons], dtype=bool)

    @property
    def forces(self) -> ComplexArray:
        """(n, K, n_joints) peak phasors of the local forces [N]."""
        return self.balance.forces.harmonics(self.joints)

    @property
    def dissipated(self) -> FloatArray:
        """(n, n_joints) energy that the local forces take in one period, pi sum k Im(N_k conj X_k) [J]."""
        k = np.arange(self.joints.shape[1])[:, None]
        return np.pi * np.sum(k * np.imag(self.forces * self.joints.conj()), axis=1)

    @property
    def states(self) -> ComplexArray:
        """(n, K, n_states) peak phasors of the linear part's states, in the coordinates of A's eigenvectors."""
        amounts = amounts_of(self.forces, self.force_amplitude)
        return self.balance.resolvent(2 * np.pi * self.frequency_hz, self.balance.loads @ amounts[..., None])[..., 0]

    def acceleration(self, plane: int | None = None) -> ComplexArray:
        """Acceleration of every node per newton of the exciting force, harmonic by harmonic.

        Parameters
        ----------
        plane : 1 = y or 2 = z; by default the plane of the motion, y where both planes move

        Returns
        -------
        (n, K, n_nodes) -(k omega)^2 X_k / F [(m/s^2)/N]; k = 1 is what a stepped sine calls accelerance
        """
        X = (self.balance.read_out(plane or self.balance.plane or 1) @ self.states[..., None])[..., 0]
        k_omega = 2 * np.pi * self.frequency_hz[:, None] * np.arange(self.joints.shape[1])  # (n, K)
        return -(k_omega[..., None] ** 2) * X / _of_motions(self.force_amplitude)
