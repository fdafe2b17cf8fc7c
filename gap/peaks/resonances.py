"""Resonances of a candidate's rotor over the bearing stiffness, and how high each stands in a response.

A list of resonances is compared with thousands of candidates, so the eigenvalues of many stiffnesses are solved at
once. Shapes are the undamped ones; damping is taken mode by mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rigtwin.gap.model.forward import acting
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.sim.campaign import NominalBelief, SupportKind

# Resonances that are kept, the lowest ones.
N_RESONANCES = 8


@dataclass(frozen=True)
class Stiffnesses:
    """At which bearing stiffnesses a rotor is built and solved."""

    solved: int = 48  # at most; between them resonances are interpolated over ln k_b
    low: float = 1e6  # [N/m] matrices are built at this one and the next: they are linear in k_b ...
    high: float = 2e6  # [N/m] ... between and beyond the two

    @property
    def built_at(self) -> tuple[float, float]:
        """The two stiffnesses at which matrices are built [N/m]."""
        return self.low, self.high


_K_B = Stiffnesses()


@dataclass(frozen=True)
class Resonances:
    """The lowest resonances for each bearing stiffness."""

    f_hz: FloatArray  # (n_k_b, N_RESONANCES) ascending; inf where there are no more, nan where the rotor buckles
    height: FloatArray  # (n_k_b, N_RESONANCES) drive-point accelerance at the peak [(m/s^2)/N]; 0 beyond the last


@dataclass(frozen=True)
class Rotor:
    """The rotor and its exciter.

    Parameters
    ----------
    structure : free-free rotor
    belief : damping of the nominal model
    node : of exciter and accelerometer, in plane y
    """

    structure: Structure
    belief: NominalBelief
    node: int
    _memory: dict[tuple, Resonances] = field(default_factory=dict, repr=False)

    def resonances(self, support: SupportKind, k_b: FloatArray, effects: Sequence[Effect] = ()) -> Resonances:
        """Resonances on one support. Raises ValueError where an effect is impossible.

        Parameters
        ----------
        support : effects of the other one do not act
        k_b : (n_k_b,) bearing stiffness [N/m], ascending
        """
        there = acting(effects, support)
        if support == "rigid":
            low, high = (self._system(k, True, there) for k in _K_B.built_at)
            one = self._solve_batch(low, high, k_b[:1])
            return Resonances(*(np.repeat(part, len(k_b), axis=0) for part in (one.f_hz, one.height)))
        if len(k_b) > _K_B.solved:
            few = np.geomspace(k_b[0], k_b[-1], _K_B.solved)
            key = (float(k_b[0]), float(k_b[-1]), tuple(there))
            if key not in self._memory:  # the same grid is asked for again where only the lists' reading differs
                self._memory[key] = self.resonances(support, few, there)
            return _interpolate(self._memory[key], few, k_b)
        low, high = (self._system(k, False, there) for k in _K_B.built_at)
        if len(low.massless):
            each = [self._solve_damped(self._system(float(k), False, there)) for k in k_b]
            return Resonances(*(np.concatenate([getattr(one, name) for one in each]) for name in ("f_hz", "height")))
        return self._solve_batch(low, high, k_b)

    def _system(self, k_b: float, rigid: bool, effects: Sequence[Effect]) -> LinearSystem:
        c, zeta = self.belief.bearing_damping_Ns_per_m, self.belief.shaft_damping_ratio
        condition = Condition(k_b, rigid, bearing_damping=c, shaft_damping_ratio=zeta, excitation_node=self.node)
        system = build_system(self.structure, condition, effects)
        return system if system.couples_planes() else system.in_plane(1)

    def _solve_batch(self, low: LinearSystem, high: LinearSystem, k_b: FloatArray) -> Resonances:
        """All stiffnesses at once, in coordinates in which the mass matrix is the unit matrix."""
        inverse = np.linalg.inv(np.linalg.cholesky(low.M))
        slope = inverse @ (high.K - low.K) @ inverse.T / (_K_B.high - _K_B.low)
        base = inverse @ low.K @ inverse.T - _K_B.low * slope
        squares, shapes = np.linalg.eigh(base + k_b[:, None, None] * slope)
        buckled = squares[:, 0] < -1e-9 * squares[:, -1]
        omega = np.sqrt(np.clip(squares[:, :N_RESONANCES], (2 * np.pi * 1e-3) ** 2, None))
        shapes = shapes[:, :, :N_RESONANCES]
        push = inverse @ low.unit_vector(self.node, 1)
        damper = inverse @ low.C_support @ inverse.T
        zeta = low.shaft_damping_ratio + np.einsum("kim,ij,kjm->km", shapes, damper, shapes) / (2 * omega)
        height = np.einsum("i,kim->km", push, shapes) ** 2 / (2 * np.maximum(zeta, 1e-6))
        found = _sort(omega / (2 * np.pi), height)
        found.f_hz[buckled] = np.nan
        return found

    def _solve_damped(self, system: LinearSystem) -> Resonances:
        """One stiffness by damped eigenvalues, for dashpots in series with springs."""
        push = system.unit_vector(self.node, 1)
        poles, residues = StateSpace(system).poles(push[:, None], push[None, :])
        upper = poles.imag > 0
        omega = np.abs(poles[upper])
        height = np.abs(residues[0, 0, upper]) * omega**2 / np.maximum(-poles[upper].real, 1e-12)
        order = np.argsort(omega)[:N_RESONANCES]
        return _sort(omega[None, order] / (2 * np.pi), height[None, order])


def _sort(f_hz: FloatArray, height: FloatArray, least_hz: float = 1.0) -> Resonances:
    """Resonances in ascending order, always ``N_RESONANCES`` of them, without motions of the rigid body.

    least_hz : below this a motion is one of the rigid body [Hz]
    """
    n, m = f_hz.shape
    f, h = np.full((n, N_RESONANCES), np.inf), np.zeros((n, N_RESONANCES))
    f[:, :m], h[:, :m] = f_hz, height
    h[f < least_hz] = 0.0
    f[f < least_hz] = np.inf
    order = np.argsort(f, axis=1, kind="stable")
    return Resonances(np.take_along_axis(f, order, 1), np.take_along_axis(h, order, 1))


def _interpolate(solved: Resonances, at: FloatArray, k_b: FloatArray) -> Resonances:
    """Resonances at other stiffnesses; where a neighbour has none, there is none."""
    x, x_at = np.log(k_b), np.log(at)
    right = np.clip(np.searchsorted(x_at, x), 1, len(at) - 1)
    share = ((x - x_at[right - 1]) / (x_at[right] - x_at[right - 1]))[:, None]
    parts = []
    for part in (solved.f_hz, solved.height):
        low, high = part[right - 1], part[right]
        whole = np.isfinite(low) & np.isfinite(high)
        parts.append(np.where(whole, low + share * np.where(whole, high - low, 0.0), np.maximum(low, high)))
    return Resonances(*parts)
