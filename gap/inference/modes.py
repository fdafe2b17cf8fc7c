"""How far a model's resonances are from those that the runs show: what a search from afar goes down.

On lines, a resonance that is several half-power widths off says nothing of where it has to go. Poles and residues do:
they follow the numbers of a rotor smoothly, however far they have to go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from rigtwin.gap.model.linear import MODES, Group, Modal
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.sim.campaign import MeasurementError, Run
from rigtwin.sim.modal_fit import PROMINENCE, Mode, try_modes


@dataclass(frozen=True)
class Tempered:
    """Errors that are allowed beside the measured ones and what the workshop's tolerances make."""

    frequency: float = 2e-3  # relative
    damping: float = 0.2  # of the logarithm
    shape: float = 0.1  # of residues, over the size of all channels' together
    alien: float = 1.5  # distance, as ``_counterparts`` has it, from which two resonances are not one and the same
    overdamped: float = 0.5  # damping ratio from which a bump is no resonance


TEMPERED = Tempered()


@dataclass(frozen=True)
class MeasuredMode:
    """A resonance as a run shows it."""

    pole: complex  # of positive frequency [rad/s]
    residues: ComplexArray  # (n_channels,) of the receptance at it
    frequency_std: float  # relative
    damping_std: float  # relative
    residue_std: FloatArray  # (n_channels,) over the size of the residues

    @property
    def damping_ratio(self) -> float:
        """Over critical damping."""
        return -self.pole.real / abs(self.pole)


def measured_modes(run: Run, std: FloatArray) -> tuple[MeasuredMode, ...]:
    """The resonances that a run shows plainly; none of magnitudes alone."""
    if run.magnitude_only:
        return ()
    measured = np.asarray(np.isfinite(run.H).all(axis=1))
    unseen = 1e3 * np.abs(np.nan_to_num(run.H)).max()  # a node that is held has no error
    known = replace(run, std=np.where(np.isfinite(std), std, unseen))
    try:
        modes, _ = try_modes(known.on_lines(measured))
    except MeasurementError:
        return ()
    return tuple(_measured(mode, run) for mode in modes if mode.damping_ratio < TEMPERED.overdamped)


def _measured(mode: Mode, run: Run) -> MeasuredMode:
    """A fitted mode R / (omega_r^2 - omega^2 + ..) as the residue R / (2 i omega_d) of its pole."""
    omega, zeta = 2 * np.pi * mode.frequency_hz, mode.damping_ratio
    damped = omega * np.sqrt(1 - zeta**2)
    force = (run.force_amplitude_N or 1.0) if run.quantity == "acceleration" else 1.0
    residues = mode.residue * omega ** (2 - DERIVATIVE_ORDER[run.quantity]) / (2j * damped * force)
    relative = mode.resonance_std / max(float(np.linalg.norm(mode.resonance)), 1e-300)
    pole = complex(-zeta * omega, damped)
    return MeasuredMode(
        pole, residues, mode.frequency_std_hz / mode.frequency_hz, mode.damping_ratio_std / zeta, relative
    )


def resonance_residual(modal: Modal, measured: Sequence[MeasuredMode], tolerance_std: FloatArray) -> FloatArray:
    """Misfit of each measured resonance's frequency, damping and residues, and of resonances that were not measured.

    Parameters
    ----------
    tolerance_std : (n_tolerances,) standard deviations of what the workshop does not know, which moves resonances

    Returns
    -------
    (n_modes (2 + 2 n_channels) + MODES,) over their errors
    """
    n_channels = len(modal.run.channels)
    poles = np.full(len(measured), np.nan, dtype=complex)
    residues = np.zeros((len(measured), n_channels), dtype=complex)
    moved = np.zeros(len(measured), dtype=complex)
    unmatched = []
    for group in modal.groups:
        upper = np.flatnonzero((group.mode >= 0) & (group.poles.imag > 0))
        pairs = _counterparts(group, upper, measured)
        for place, k in pairs:
            j = upper[place]
            line = int(np.argmin(np.abs(modal.omega - measured[k].pole.imag)))
            poles[k], residues[k, group.columns] = group.poles[j], group.residues[:-1, j] * group.chain[line]
            spread = modal.sensitivity[group.mode[j]] * tolerance_std
            moved[k] = np.linalg.norm(spread.real) + 1j * np.linalg.norm(spread.imag)
        unmatched.append((group, np.setdiff1d(upper, upper[[place for place, _ in pairs]])))
    unit = _unit(residues, measured) if modal.run.quantity == "acceleration" else 1.0
    residues, extra = unit * residues, np.zeros(MODES)
    for group, others in unmatched:
        extra[group.mode[others]] = _seen(modal, group, others, measured, unit)
    parts = [_of_mode(mode, *found) for mode, *found in zip(measured, poles, residues, moved, strict=True)]
    return np.concatenate([*parts, extra / TEMPERED.shape])


def _unit(residues: ComplexArray, measured: Sequence[MeasuredMode]) -> float:
    """Factor between a run in an arbitrary unit and its model."""
    sizes = np.linalg.norm(residues, axis=1)
    there = np.linalg.norm([mode.residues for mode in measured], axis=1)
    return float(np.exp(np.median(np.log(there[sizes > 0] / sizes[sizes > 0])))) if sizes.any() else 1.0


def _of_mode(mode: MeasuredMode, pole: Any, residues: ComplexArray, moved: Any) -> FloatArray:
    """(2 + 2 n_channels,) misfit of a measured resonance; as far off as can be where the model has none."""
    size = float(np.linalg.norm(mode.residues))
    shape = (residues - mode.residues) / (size * np.hypot(TEMPERED.shape, mode.residue_std))
    frequency = np.linalg.norm([TEMPERED.frequency, mode.frequency_std, moved.real])
    damping = np.linalg.norm([TEMPERED.damping, mode.damping_std, moved.imag / mode.damping_ratio])
    if np.isnan(pole):  # no nearer than the farthest counterpart
        there = np.array([TEMPERED.alien / frequency, 0.0])
    else:
        ratio = max(-pole.real / abs(pole), 1e-9) / mode.damping_ratio
        there = np.log([abs(pole) / abs(mode.pole), ratio]) / [frequency, damping]
    return np.concatenate([there, shape.real, shape.imag])


def _seen(modal: Modal, group: Group, others: IntArray, measured: Sequence[MeasuredMode], unit: float) -> FloatArray:
    """(n_others,) heights of resonances that were not measured, over the smallest one that was, at most 1.

    One that would not stand out from the others' response counts as little as it does.
    """
    smallest = min((np.linalg.norm(m.residues[group.columns]) / -m.pole.real for m in measured), default=np.inf)
    damped = np.maximum(-group.poles[others].real, 1e-12 * np.abs(group.poles[others]))
    heights = unit * np.linalg.norm(group.residues[:-1, others], axis=0) / damped
    inside = (group.poles[others].imag > modal.omega[0]) & (group.poles[others].imag < modal.omega[-1])
    return np.where(inside, np.minimum(heights / max(smallest, 1e-300), 1.0) * _standing_out(group, others), 0.0)


def _standing_out(group: Group, some: IntArray) -> FloatArray:
    """(n_some,) how far resonances stand out of the rest of the response, over what a run shows plainly; at most 1."""
    shares = 1 / (1j * group.poles[some].imag[:, None] - group.poles)
    whole = shares @ group.residues[:-1].T
    own = shares[np.arange(len(some)), some][:, None] * group.residues[:-1, some].T
    size, rest = np.linalg.norm(whole, axis=1), np.linalg.norm(whole - own, axis=1)
    return np.clip((size / np.maximum(rest, 1e-300) - 1) / (PROMINENCE - 1), 0.0, 1.0)


def _counterparts(group: Group, upper: IntArray, measured: Sequence[MeasuredMode]) -> list[tuple[int, int]]:
    """Which of a group's resonances is which of the measured ones.

    They are the less alike the farther their frequencies are apart, by the logarithm, and their shapes, by 1 - MAC.
    """
    if not (len(upper) and measured):
        return []
    own, there = group.residues[:-1, upper], np.array([mode.residues[group.columns] for mode in measured])
    sizes = np.outer(np.sum(np.abs(own) ** 2, axis=0), np.sum(np.abs(there) ** 2, axis=1))
    alike = np.where(sizes > 0, np.abs(own.T @ there.conj().T) ** 2 / np.where(sizes > 0, sizes, 1.0), 1.0)
    apart = 1 - alike + np.abs(np.log(np.abs(np.divide.outer(group.poles[upper], [m.pole for m in measured]))))
    found = zip(*linear_sum_assignment(apart), strict=True)
    return [(int(place), int(k)) for place, k in found if apart[place, k] < TEMPERED.alien]
