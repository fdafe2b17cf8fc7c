"""Noise-free response of a measured run in modal form, so that resonances can drift one by one.

For every group of channels that sees one and the same rotor,

    H(omega) = sum_k R_k / (1 + delta_m(k)) / (i omega - lambda_k (1 + delta_m(k) + i zeta_k epsilon_m(k)))
               + what the modes far above leave,

times the powers of i omega and the factors of the measurement chain. delta_m and epsilon_m are the relative shifts of
the m-th resonance and of its damping, which belong to the run, not to the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from rigtwin.gap.model.run_model import RunModel
from rigtwin.gap.model.transients import as_read, transients
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER, channel_factor, force_factor
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.sim.campaign import Run

# Resonances of a run that may drift, at most.
MODES = 8

# Damping ratio of a pole, at least.
_LEAST_DAMPING = 1e-7


@dataclass(frozen=True)
class Group:
    """Channels that see one rotor."""

    columns: IntArray  # places of its channels in the run
    poles: ComplexArray  # (n_states,)
    residues: ComplexArray  # (n_channels + 1, n_states); the last row is the exciter's own
    mode: IntArray  # (n_states,) number of the drifting resonance a pole belongs to, -1: none
    rest: FloatArray  # (n_freq, n_channels + 1) what modes far above leave
    chain: ComplexArray  # (n_freq, n_channels)
    bent: ComplexArray  # (n_tolerances, n_channels + 1, n_states) change of the residues by the tolerances
    aside: ComplexArray  # (n_tolerances, n_freq, n_channels + 1) change of what the other modes leave


@dataclass(frozen=True)
class Modal(RunModel):
    """Noise-free response of one run in modal form; see ``RunModel``."""

    ringing: ClassVar[float] = 1.5  # without images: modes above so many times the highest line have no transients

    run: Run
    omega: FloatArray
    groups: tuple[Group, ...]
    effects: tuple[Effect, ...]
    sensitivity: ComplexArray  # (MODES, n_tolerances) relative change of each resonance's pole: frequency and damping
    anchor: FloatArray  # (n_tolerances,) where the model is exact in the tolerances
    scale: ComplexArray  # (n_freq,) powers of i omega and nominal force
    images: bool = True  # whether transients are seen with their images, and those of far modes at all

    @property
    def frequencies_hz(self) -> FloatArray:
        """Resonances that may drift, lowest first [Hz]."""
        group = self.groups[0]
        positive = (group.mode >= 0) & (group.poles.imag > 0)
        return np.sort(np.abs(group.poles[positive])) / (2 * np.pi)

    @property
    def in_order(self) -> IntArray:
        """(n_freq,) places of the lines in the order in which they were swept."""
        return np.arange(len(self.omega))[:: self._onward]

    @property
    def _onward(self) -> int:
        return -1 if self.run.sweep == "down" else 1

    @property
    def as_linear(self) -> Modal:
        """Itself."""
        return self

    def response(
        self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None, level: float = 0.0
    ) -> ComplexArray:
        """(n_freq, n_channels) response with drifts (MODES,) and tolerances (n_tolerances,)."""
        return self._evaluate(drift, self._factors(tolerance), derivatives=False)[0]

    def with_derivatives(
        self, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """``response`` and its (2 MODES + n_tolerances, n_freq, n_channels) derivatives."""
        factors = self._factors(tolerance)
        H, D = self._evaluate(drift, factors, derivatives=True)
        D[2 * MODES :] *= (1 + factors)[:, None, None]
        return H, D

    def _factors(self, tolerance: FloatArray | None) -> FloatArray:
        """(n_tolerances,) relative changes of the workshop's numbers from those of the anchor."""
        return np.zeros(len(self.anchor)) if tolerance is None else np.expm1(tolerance - self.anchor)

    def _evaluate(
        self, drift: ComplexArray | None, factors: FloatArray, *, derivatives: bool
    ) -> tuple[ComplexArray, ComplexArray]:
        """``with_derivatives``, by the factors themselves."""
        shift = self._shift(drift, factors)
        n_f, n_c = len(self.omega), len(self.run.channels)
        H = np.empty((n_f, n_c), dtype=complex)
        D = np.zeros((2 * MODES + len(factors) if derivatives else 0, n_f, n_c), dtype=complex)
        for group in self.groups:
            poles = _moved_poles(group, shift)
            shares = self._shares(poles)
            still = _heights(group, drift)
            Y, residues = self._motion(group, shares * still, factors)
            force = self._force(Y[:, -1])
            H[:, group.columns] = Y[:, :-1] * group.chain * force[:, None]
            if not derivatives:
                continue
            by_shift = self._shares_slope(group.poles, poles, shares) * still
            dY = np.concatenate([self._by_drifts(group, by_shift, shares * still**2, residues), group.aside])
            dY[2 * MODES :] += np.tensordot(shares * still, group.bent, axes=(1, 2)).swapaxes(0, 1)
            dY[2 * MODES :] += _by_states(by_shift, _pole_shifts(group, self.sensitivity.T), residues)
            D[:, :, group.columns] = _sensor_change(Y, dY, force, self._force_slope(Y[:, -1], force)) * group.chain
        return H, D

    def _by_drifts(
        self, group: Group, by_shift: ComplexArray, by_height: ComplexArray, residues: ComplexArray
    ) -> ComplexArray:
        """(2 MODES, n_freq, n_channels + 1) derivatives of the motion by the drifts, of frequency and of damping."""
        own = np.arange(MODES)[:, None] == group.mode
        turned = own * _pole_shifts(group, self._towards_damping)
        moved = _by_states(by_shift, np.concatenate([own, turned]), residues)
        moved[:MODES] -= _by_states(by_height, own, residues)
        return moved

    def of_resonances(self, drift: ComplexArray, tolerance: FloatArray) -> ComplexArray:
        """(MODES, n_freq, n_channels) what each resonance that may drift adds to the response."""
        parts = np.zeros((MODES, len(self.omega), len(self.run.channels)), dtype=complex)
        factors = self._factors(tolerance)
        shift = self._shift(drift, factors)
        for group in self.groups:
            shares = self._shares(_moved_poles(group, shift)) * _heights(group, drift)
            Y, residues = self._motion(group, shares, factors)
            force = self._force(Y[:, -1])
            for m in range(MODES):
                mine = group.mode == m
                parts[m][:, group.columns] = shares[:, mine] @ residues[:-1, mine].T * group.chain * force[:, None]
        return parts

    def _shares(self, poles: ComplexArray) -> ComplexArray:
        """(n_freq, n_states) 1 / (i omega - lambda), and what transients add."""
        shares = 1 / (1j * self.omega[:, None] - poles)
        return shares if self.dwell_s is None else shares + self._transient_shares(poles, np.array(self.dwell_s))

    def _shares_slope(self, own: ComplexArray, poles: ComplexArray, shares: ComplexArray) -> ComplexArray:
        """(n_freq, n_states) derivative of the shares by a shift of the poles relative to their own places."""
        if self.dwell_s is None:
            return shares**2 * own
        step = 1e-7
        return (self._shares(poles + step * own) - shares) / step

    def _shift(self, drift: ComplexArray | None, factors: FloatArray) -> ComplexArray:
        """(MODES,) relative shift of each resonance's pole."""
        if drift is None:
            return self.sensitivity @ factors
        return self.sensitivity @ factors + drift.real + self._towards_damping * drift.imag

    @cached_property
    def _towards_damping(self) -> ComplexArray:
        """(MODES,) ``towards_damping`` of each resonance."""
        return of_resonances_towards_damping(self.groups[0].poles, self.groups[0].mode)

    def _motion(self, group: Group, shares: ComplexArray, factors: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, n_channels + 1) receptance and the residues that it is made of."""
        if not factors.any():
            return shares @ group.residues.T + group.rest, group.residues
        residues = group.residues + np.tensordot(factors, group.bent, axes=1)
        return shares @ residues.T + group.rest + np.tensordot(factors, group.aside, axes=1), residues

    def change_to(
        self, other: RunModel, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> ComplexArray:
        """(n_freq, n_channels) another response less this one, to first order in the shifts of the resonances.

        A plain difference is no derivative where a resonance shifts by more than a small part of its width.
        """
        linear: Any = other.as_linear
        if linear is None:
            return super().change_to(other, drift, tolerance, level)
        return self._change_to(linear, drift, tolerance)

    def _change_to(self, other: Modal, drift: ComplexArray, tolerance: FloatArray) -> ComplexArray:
        change = np.empty((len(self.omega), len(self.run.channels)), dtype=complex)
        for group in other.groups:
            twin = next((g for g in self.groups if holds(g.columns, group.columns)), None)
            here = None if twin is None else _poles_of_twin(group, twin)
            if twin is None or here is None or self.dwell_s is not None or other.dwell_s is not None:
                return other.response(drift, tolerance) - self.response(drift, tolerance)
            change[:, group.columns] = self._change(twin, other, group, here, drift, tolerance)
        return change

    def _change(
        self, own: Group, other: Modal, group: Group, here: ComplexArray, drift: ComplexArray, tolerance: FloatArray
    ) -> ComplexArray:
        """``change_to`` of one group, whose resonances stand at ``here`` in this model."""
        factors, others = self._factors(tolerance), other._factors(tolerance)
        own_shift, shift = self._shift(drift, factors), other._shift(drift, others)
        poles = _moved_poles(group, shift)
        there = np.where(group.mode >= 0, here * (1 + _pole_shifts(group, own_shift)), poles)
        shares = 1 / (1j * self.omega[:, None] - there)
        moved, _ = other._motion(group, (shares + shares**2 * (poles - there)) * _heights(group, drift), others)
        poles = _moved_poles(own, own_shift)
        plain, _ = self._motion(own, self._shares(poles) * _heights(own, drift), factors)
        places = np.searchsorted(own.columns, group.columns)
        Y, chain = plain[:, [*places, -1]], own.chain[:, places]
        force = self._force(Y[:, -1])
        driven = _sensor_change(Y, moved - Y, force, self._force_slope(Y[:, -1], force))
        turned = (other._force(Y[:, -1]) - force)[:, None] * chain + force[:, None] * (group.chain - chain)
        return driven * chain + Y[:, :-1] * turned

    def driven_and_read_by(self, effects: Sequence[Effect]) -> Modal:
        """The same rotor with these effects, of which those on the rotor are the same."""
        groups = (replace(g, chain=chain_factors(effects, self.run, g.columns)) for g in self.groups)
        return replace(self, groups=tuple(groups), effects=tuple(effects))

    @property
    def dwell_s(self) -> float | None:
        """Time after which every line is read, settled or not; None: when it has settled."""
        changes = {name: value for effect in self.effects for name, value in effect.sweep_changes().items()}
        return changes.get("dwell_s")

    def _transient_shares(self, poles: ComplexArray, dwell: FloatArray) -> ComplexArray:
        """(n_freq, ..., n_states) what transients add to 1 / (i omega - lambda), read over a period after dwells (...).

        The real signal is the imaginary part of what a force e^{i theta} makes, so the conjugate pole's transient is
        seen as well: an image that turns with twice the phase of all dwells so far, 1e5 radians for a second more.
        """
        all_hz = self.run.frequency_hz if self.run.swept_hz is None else self.run.swept_hz
        swept = 2 * np.pi * all_hz[:: self._onward]
        w, dwell = swept.reshape(-1, *(1,) * dwell.ndim, 1), dwell[..., None]
        if self.images:
            left = transients(w, poles, dwell)
            twin = conjugates(poles, np.arange(len(poles)))
            left -= left[..., twin].conj() * np.exp(-2j * dwell * np.cumsum(w, axis=0))
            read = as_read(left, w, poles)
        else:
            near = np.flatnonzero(np.abs(poles) < self.ringing * w.max())
            read = np.zeros((len(w), *dwell.shape[:-1], len(poles)), dtype=complex)
            read[..., near] = as_read(transients(w, poles[near], dwell), w, poles[near])
        return read[:: self._onward][np.searchsorted(all_hz, self.run.frequency_hz)]

    def change_by_dwells(self, dwells: FloatArray, drift: ComplexArray, tolerance: FloatArray) -> ComplexArray:
        """(n_dwells, n_freq, n_channels) what the transients of a fast sweep change of a settled response.

        Parameters
        ----------
        dwells : (n_dwells,) [s]
        drift, tolerance : as in ``response``
        """
        factors = self._factors(tolerance)
        shift = self._shift(drift, factors)
        change = np.empty((len(dwells), len(self.omega), len(self.run.channels)), dtype=complex)
        for group in self.groups:
            poles, still = _moved_poles(group, shift), _heights(group, drift)
            Y, residues = self._motion(group, self._shares(poles) * still, factors)
            dY = np.swapaxes((self._transient_shares(poles, dwells) * still) @ residues.T, 0, 1)
            force = self._force(Y[:, -1])
            change[:, :, group.columns] = _sensor_change(Y, dY, force, self._force_slope(Y[:, -1], force)) * group.chain
        return change

    def _force_slope(self, drive: ComplexArray, force: ComplexArray) -> ComplexArray:
        """Derivative of the force by the exciter's own receptance, of which it is an analytic function."""
        if self.run.quantity != "acceleration":
            return np.zeros_like(force)
        step = 1e-6 * drive
        return np.divide(self._force(drive + step) - force, step, out=np.zeros_like(force), where=step != 0)

    def _force(self, drive: ComplexArray) -> ComplexArray:
        if self.run.quantity != "acceleration":
            return self.scale
        return self.scale * force_factor(self.effects, self.omega, drive)


def _pole_shifts(group: Group, shift: ComplexArray) -> ComplexArray:
    """(..., n_states) relative shift of every pole, of (..., MODES) the resonances'; none of what does not drift."""
    own = shift[..., group.mode]
    return np.where(group.mode < 0, 0.0, np.where(group.poles.imag < 0, own.conj(), own))


def _by_states(shares: ComplexArray, weights: ComplexArray, residues: ComplexArray) -> ComplexArray:
    """(k, n_freq, n_rows) sum over the states of shares (n_freq, n_states), weights (k, n_states) and residues."""
    return np.matmul(shares, weights[:, :, None] * residues.T)


def _moved_poles(group: Group, shift: ComplexArray) -> ComplexArray:
    """(n_states,) poles with relative shifts (MODES,); what damps never drives, wherever the first order leads."""
    poles = group.poles * (1 + _pole_shifts(group, shift))
    return np.minimum(poles.real, -_LEAST_DAMPING * np.abs(poles)) + 1j * poles.imag


def _heights(group: Group, drift: ComplexArray | None) -> FloatArray:
    """(n_states,) factor of the residues: a resonance drifts at a fixed mass-normalised shape, R ~ 1 / omega."""
    if drift is None:
        return np.ones(len(group.mode))
    return 1 / (1 + np.where(group.mode >= 0, drift.real[group.mode], 0.0))


def towards_damping(poles: ComplexArray) -> ComplexArray:
    """(n,) relative shift of poles when their dampings grow by one of themselves: i zeta, -i zeta of the conjugates."""
    return -1j * np.sign(poles.imag) * poles.real / np.maximum(np.abs(poles), 1e-300)


def of_resonances_towards_damping(poles: ComplexArray, mode: IntArray) -> ComplexArray:
    """(MODES,) ``towards_damping`` of each resonance; 0 where there is none."""
    found, upper = np.zeros(MODES, dtype=complex), np.flatnonzero((mode >= 0) & (poles.imag > 0))
    found[mode[upper]] = towards_damping(poles[upper])
    return found


def holds(columns: IntArray, others: IntArray) -> bool:
    """Whether the first columns have all of the others."""
    return set(columns.tolist()).issuperset(others.tolist())


def chain_factors(effects: Sequence[Effect], run: Run, columns: IntArray) -> ComplexArray:
    """(n_freq, n_columns) reported over true response of some channels."""
    omega = 2 * np.pi * run.frequency_hz
    return np.array([channel_factor(effects, omega, run.channels[c].node) for c in columns]).T


def _sensor_change(Y: ComplexArray, dY: ComplexArray, force: ComplexArray, slope: ComplexArray) -> ComplexArray:
    """(..., n_freq, n_channels) change of the sensors' motion where the force changes with the exciter's own motion."""
    return dY[..., :-1] * force[:, None] + Y[:, :-1] * (slope * dY[..., -1])[..., None]


def _poles_of_twin(group: Group, twin: Group, tolerance: float = 0.05) -> ComplexArray | None:
    """The twin's pole in the place of each of the group's resonances; None where they are not one to one.

    tolerance : relative difference of frequencies beyond which two resonances are not one and the same
    """
    poles = group.poles.copy()
    for k in np.flatnonzero(group.mode >= 0):
        same = np.flatnonzero((twin.mode == group.mode[k]) & (np.sign(twin.poles.imag) == np.sign(poles[k].imag)))
        if len(same) != 1 or abs(twin.poles[same[0]] / poles[k] - 1) > tolerance:
            return None
        poles[k] = twin.poles[same[0]]
    return poles if group.mode.max(initial=-1) == twin.mode.max(initial=-1) else None


def over_receptance(run: Run) -> ComplexArray:
    """(n_freq,) a run's values over receptances: powers of i omega, and the nominal force of recorded motions."""
    omega = 2 * np.pi * run.frequency_hz
    force = (run.force_amplitude_N or 1.0) if run.quantity == "acceleration" else 1.0
    return force * (1j * omega) ** DERIVATIVE_ORDER[run.quantity]


def resonance_numbers(poles: ComplexArray, top: float) -> IntArray:
    """Number of the resonance that every pole belongs to; conjugates share it."""
    number = np.full(len(poles), -1)
    oscillating = np.flatnonzero((poles.imag > 0) & (np.abs(poles) < top))
    order = oscillating[np.argsort(np.abs(poles[oscillating]))][:MODES]
    number[order] = np.arange(len(order))
    number[conjugates(poles, order)] = np.arange(len(order))
    return number


def conjugates(poles: ComplexArray, of: IntArray) -> IntArray:
    """(k,) places of the poles that are the conjugates of these (k,)."""
    return np.abs(poles - poles[of, None].conj()).argmin(axis=1)
