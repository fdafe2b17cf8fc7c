"""The linear rotor as first-order equations, the one form every solver starts from.

The state is x = (s eta, eta', w). The first part are the modal coordinates of q = Phi eta, scaled by
s = omega so that the undamped part is skew-symmetric; then the modal velocities; w is the deviation
of massless degrees of freedom (between a spring and a dashpot in series) from their static position. Where K is not
symmetric, its skew part K_c acts on the modes of its symmetric part as the force -Phi' K_c Phi eta. This is exact,
since no mode is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.system import LinearSystem, Modes, block

# Condition number of the eigenvectors (Frobenius) above which the spectral form loses over half of the digits.
_DEFECTIVE = 1e7

# Damping ratio that parts poles which lie upon each other: a critically damped pair by 1e-4 of its frequency.
_PARTING = 1e-9


@dataclass(frozen=True)
class UpperResidual:
    """Receptance of the modes that have no states: undamped and not coupled to the others."""

    squares: FloatArray  # (n_modes,) of the natural frequencies [rad^2/s^2]
    residues: FloatArray  # (n_out, n_in, n_modes)

    def receptance(self, omega: FloatArray) -> FloatArray:
        """(n_freq, n_out, n_in) at omega (n_freq,) [rad/s]."""
        return np.tensordot(1 / (self.squares - np.asarray(omega)[:, None] ** 2), self.residues, axes=(1, 2))


class StateSpace:
    """x' = A x + input(pattern) f, q = displacement(1) x.

    Parameters
    ----------
    system : the supported rotor, n degrees of freedom, of which n_massless have no mass
    spin_speed : Omega [rad/s]
    modes_below_hz : modes above have no states; ``receptance`` takes them as undamped and coupled to nothing, which
        leaves about 1e-4 where the bearings' dampers are as strong as their springs and the limit is 30 times the
        highest line

    >>> StateSpace(build_system(assemble(load_rig("nit-rourkela")), Condition())).n_states
    56
    """

    def __init__(self, system: LinearSystem, spin_speed: float = 0.0, modes_below_hz: float = np.inf):
        system = system.at(spin_speed)
        every = system.modes
        n_kept = int(np.searchsorted(every.omega, 2 * np.pi * modes_below_hz))
        modes = Modes(every.omega[:n_kept], every.Phi[:, :n_kept])
        self._beyond = Modes(every.omega[n_kept:], every.Phi[:, n_kept:])
        heavy, light = system.heavy, system.massless
        self._n, self._heavy, self._light = system.n, heavy, light
        self._Phi = modes.Phi[heavy]  # (n_heavy, m)
        self._to_modal = self._Phi.T @ block(system.M, heavy)
        self._scale = np.where(modes.elastic, modes.omega, 1.0)
        self._slide = system.slide
        m, k = len(modes.omega), len(light)
        C = system.C + spin_speed * system.G
        A = np.zeros((2 * m + k, 2 * m + k))
        A[:m, m : 2 * m] = np.diag(self._scale)
        A[m : 2 * m, :m] = -np.diag(modes.omega)
        A[m : 2 * m, m : 2 * m] = -self._Phi.T @ block(C, heavy) @ self._Phi
        if system.circulatory is not None:
            A[m : 2 * m, :m] -= self._Phi.T @ block(system.circulatory, heavy) @ self._Phi / self._scale
        if k:
            self._add_massless(A, system, C)
        self.A = A

    def _add_massless(self, A: FloatArray, system: LinearSystem, C: FloatArray) -> None:
        """Rows and columns of w: C_ww w' = -(C_wq + C_ww T) q' - K_ww w, and its force on q."""
        heavy, light, m = self._heavy, self._light, len(self._scale)
        C_hl, C_lh, C_ll = block(C, heavy, light), block(C, light, heavy), block(C, light)
        K_ll, K_hl = block(system.K, light), block(system.K, heavy, light)
        relax = np.linalg.solve(C_ll, K_ll)
        drag = np.linalg.solve(C_ll, C_lh)
        A[2 * m :, 2 * m :] = -relax
        A[2 * m :, m : 2 * m] = -(drag + self._slide) @ self._Phi
        # s' = -drag q' - relax w acts back on q through C_hl, w itself through K_hl.
        A[m : 2 * m, m : 2 * m] += self._Phi.T @ C_hl @ drag @ self._Phi
        A[m : 2 * m, 2 * m :] = -self._Phi.T @ (K_hl - C_hl @ relax)

    @property
    def n_states(self) -> int:
        """Length of the state vector."""
        return len(self.A)

    def input(self, patterns: FloatArray) -> FloatArray:
        """(n_states, k) effect of unit forces with patterns (n, k), none on a massless degree of freedom."""
        m = len(self._scale)
        B = np.zeros((self.n_states, patterns.shape[1]))
        B[m : 2 * m] = self._Phi.T @ patterns[self._heavy]
        return B

    def displacement(self, patterns: FloatArray) -> FloatArray:
        """(k, n_states) read-out of the displacements patterns q with patterns (k, n)."""
        m = len(self._scale)
        C = np.zeros((len(patterns), self.n_states))
        light = patterns[:, self._light]
        C[:, :m] = (patterns[:, self._heavy] + light @ self._slide) @ self._Phi / self._scale
        C[:, 2 * m :] = light
        return C

    def velocity(self, patterns: FloatArray) -> FloatArray:
        """(k, n_states) read-out of the velocities patterns q'."""
        return self.displacement(patterns) @ self.A

    def state_of(self, q: FloatArray, velocity: FloatArray) -> FloatArray:
        """(n_states,) state of deflections q [m] and velocities [m/s], each (n,)."""
        heavy = q[self._heavy]
        left_over = q[self._light] - self._slide @ heavy
        return np.concatenate(
            [self._scale * (self._to_modal @ heavy), self._to_modal @ velocity[self._heavy], left_over]
        )

    def motion_of(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) deflections [m] and (n,) velocities [m/s] of a state."""
        one = np.eye(self._n)
        return self.displacement(one) @ state, self.velocity(one) @ state

    @cached_property
    def spectrum(self) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
        """Eigenvalues, right eigenvectors V and V^-1; None where A is close to defective."""
        return _spectrum(self.A)

    @cached_property
    def _parted(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """``spectrum``; where A is close to defective, that of a rotor whose modes are damped by so little more.

        Poles that lie upon each other have no residues, but come apart by the root of what changes.
        """
        m = len(self._scale)
        more = np.zeros(self.n_states)
        more[m : 2 * m] = _PARTING * self._scale * np.arange(1, m + 1) / m
        found = self.spectrum or _spectrum(self.A - np.diag(more))
        if found is None:
            raise np.linalg.LinAlgError("the poles of this rotor are too close together for residues")
        return found

    def receptance(self, omega: FloatArray, inputs: FloatArray, outputs: FloatArray) -> ComplexArray:
        """Displacements per unit force.

        H = C (i omega - A)^-1 B, summed over the eigenvalues of A.

        Parameters
        ----------
        omega : (n_freq,) [rad/s]
        inputs : (n, n_in) force patterns
        outputs : (n_out, n) read-out

        Returns
        -------
        (n_freq, n_out, n_in) receptance [m/N]
        """
        w = np.asarray(omega, dtype=float)
        H = self._of_states(w, inputs, outputs)
        return H + self.upper_residual(inputs, outputs).receptance(w) if len(self._beyond.omega) else H

    def _of_states(self, w: FloatArray, inputs: FloatArray, outputs: FloatArray) -> ComplexArray:
        """The receptance of the modes that have states."""
        if self.spectrum is None:
            B, C, one = self.input(inputs), self.displacement(outputs), np.eye(self.n_states)
            return C @ np.linalg.solve(1j * w[:, None, None] * one - self.A, B[None].astype(complex))
        poles, residues = self.poles(inputs, outputs)
        shares = 1 / (1j * w[:, None] - poles)  # (n_freq, n_states)
        return (shares @ residues.reshape(-1, len(poles)).T).reshape(len(w), len(outputs), inputs.shape[1])

    def poles(self, inputs: FloatArray, outputs: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """(n_states,) poles [rad/s] and (n_out, n_in, n_states) residues of the receptance; arguments as there.

        Raises numpy.linalg.LinAlgError where A is defective whatever the modes' dampings are.
        """
        values, V, inverse = self._parted
        left, right = self.displacement(outputs) @ V, inverse @ self.input(inputs)
        return values, left[:, None, :] * right.T[None]

    def upper_residual(self, inputs: FloatArray, outputs: FloatArray) -> UpperResidual:
        """The modes without states as these inputs and outputs see them; arguments as in ``receptance``."""
        Phi = self._beyond.Phi
        return UpperResidual(self._beyond.omega**2, (outputs @ Phi)[:, None, :] * (Phi.T @ inputs).T[None])


def _spectrum(A: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray] | None:
    """Eigenvalues, right eigenvectors V and V^-1 of a matrix; None where it is close to defective."""
    values, V = np.linalg.eig(A)
    try:
        inverse = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        return None
    if np.linalg.norm(V) * np.linalg.norm(inverse) > _DEFECTIVE:
        return None
    return values.astype(complex), V.astype(complex), inverse.astype(complex)
