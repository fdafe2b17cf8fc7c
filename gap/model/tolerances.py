"""How a workshop's tolerances of modulus, span and disk masses bend the modes of a rotor, each to first order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.gap.model.linear import MODES, TOLERANCES, Group, Modal
from rigtwin.rotor.geometry.rig import Disk, Rig
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem

# Relative step of a tolerance.
STEP = 1e-3


@dataclass(frozen=True)
class Bend:
    """How the tolerances change what a group of channels sees."""

    columns: IntArray  # places of its channels in the run, ascending
    residues: ComplexArray  # (n_tolerances, n_channels + 1, MODES) over the size of each mode's residues
    missed: ComplexArray  # (MODES, n_tolerances) of the poles' logarithms, beyond ``sensitivity_of``
    aside: ComplexArray  # (n_tolerances, n_freq, n_channels + 1)


def variants_of(rig: Rig) -> list[Rig]:
    """The rig with each tolerance at a small value, in the order of ``TOLERANCES``."""
    more = 1 + STEP
    stiffer = [s.model_copy(update={"youngs_modulus_Pa": more * s.youngs_modulus_Pa}) for s in rig.segment]
    longer = [s.model_copy(update={"length_m": more * s.length_m}) for s in rig.segment]
    variants = [
        rig.model_copy(update={"segment": stiffer}),
        rig.model_copy(update={"segment": longer, "nodes_m": [more * x for x in rig.nodes_m]}),
    ]
    for number in range(2):
        disks = [_heavier(disk, more) if k == number else disk for k, disk in enumerate(rig.disk)]
        variants.append(rig.model_copy(update={"disk": disks}))
    return variants


def _heavier(disk: Disk, factor: float) -> Disk:
    """The disk with another mass: of another density, where it has dimensions."""
    if disk.density_kg_per_m3 is not None:
        return disk.model_copy(update={"density_kg_per_m3": factor * disk.density_kg_per_m3})
    return disk.model_copy(update={"mass_kg": factor * disk.mass})


def bend_of(modal: Modal, plain: Group, others: Sequence[Group]) -> Bend:
    """Change by each tolerance of a group's poles, residues and of what the modes that do not drift leave."""
    omega, n_rows = modal.omega, len(plain.columns) + 1
    missed = np.zeros((MODES, len(TOLERANCES)), dtype=complex)
    aside = np.zeros((len(TOLERANCES), len(omega), n_rows), dtype=complex)
    bent = np.zeros((len(TOLERANCES), n_rows, MODES), dtype=complex)
    sizes = _sizes(plain.residues, plain.mode)
    for t, other in enumerate(others):
        aside[t] = (_undrifting_part(other, omega) - _undrifting_part(plain, omega)) / STEP
        for m in range(MODES):
            a, b = _upper_pole(plain, m), _upper_pole(other, m)
            if a is not None and b is not None:
                change = other.residues[:, b] - plain.residues[:, a]
                bent[t, :, m] = change / (STEP * sizes[a])
                moved = np.log(other.poles[b] / plain.poles[a]) / np.log1p(STEP)
                missed[m, t] = moved - modal.sensitivity[m, t]
    return Bend(plain.columns, bent, missed, aside)


def bend_residues(known: Bend | None, omega, columns, poles: ComplexArray, residues: ComplexArray, mode: IntArray):
    """(n_tolerances, n_channels + 1, n_states) and (n_tolerances, n_freq, n_channels + 1): a bend for these poles."""
    bent = np.zeros((len(TOLERANCES), *residues.shape), dtype=complex)
    if known is None:
        return bent, np.zeros((len(TOLERANCES), len(omega), len(columns) + 1), dtype=complex)
    rows = np.append(np.searchsorted(known.columns, columns), len(known.columns))
    sizes = _sizes(residues, mode)
    for k in np.flatnonzero((mode >= 0) & (poles.imag > 0)):
        bent[:, :, k] = known.residues[:, rows, mode[k]] * sizes[k]
        twin = int(np.argmin(np.abs(poles - poles[k].conj())))
        bent[:, :, twin] = bent[:, :, k].conj()
    return bent, known.aside[:, :, rows]


def _sizes(residues: ComplexArray, mode: IntArray, unreached: float = 0.05) -> FloatArray:
    """(n_states,) size of each mode's residues, at least a share of the largest that drifts.

    unreached : that share; tolerances change a mode that the exciter hardly reaches in proportion to it
    """
    sizes = np.linalg.norm(residues, axis=0)
    return np.maximum(sizes, unreached * sizes[mode >= 0].max(initial=1e-300))


def _undrifting_part(group: Group, omega: FloatArray) -> ComplexArray:
    """(n_freq, n_channels + 1) what the modes that do not drift contribute."""
    mine = group.mode < 0
    return (1 / (1j * omega[:, None] - group.poles[mine])) @ group.residues[:, mine].T + group.rest


def _upper_pole(group: Group, m: int) -> int | None:
    """Place of a resonance's pole with positive frequency."""
    found = np.flatnonzero((group.mode == m) & (group.poles.imag > 0))
    return int(found[0]) if len(found) else None


def sensitivity_of(system: LinearSystem) -> FloatArray:
    """(MODES, n_tolerances) relative change of each undamped resonance by modulus, span and each disk's mass."""
    modes = system.modes
    count = min(MODES, len(modes.omega))
    Phi, squares = modes.Phi[:, :count], np.maximum(modes.omega[:count] ** 2, 1e-12)
    strain = np.einsum("im,ij,jm->m", Phi, system.K_shaft, Phi) / squares
    at = np.zeros((MODES, len(TOLERANCES)))
    masses = [
        np.sum(mass * Phi[(system.free[:, None] == places).any(axis=1)] ** 2, axis=0)
        for places, mass in _disk_places(system.structure)
    ]
    shaft = np.clip(1 - sum(masses, np.zeros(count)), 0.0, 1.0)
    at[:count, 0] = strain / 2
    at[:count, 1] = -1.5 * strain - 0.5 * shaft
    for column, mass in enumerate(masses[:2]):
        at[:count, 2 + column] = -mass / 2
    return at


def _disk_places(structure: Structure) -> list[tuple[IntArray, float]]:
    """Translational degrees of freedom and mass of every disk."""
    return [
        (4 * int(node) + np.arange(2), float(mass))
        for node, mass in zip(structure.disk_node, structure.disk_mass, strict=True)
    ]
