"""How a workshop's tolerances bend the modes of a rotor, each to first order."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.gap.model.linear import MODES, Group, Modal, conjugates
from rigtwin.gap.model.workshop import STEP, Tolerance
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.structure import DOF_PER_NODE
from rigtwin.rotor.model.system import LinearSystem, work


@dataclass(frozen=True)
class Bend:
    """How the tolerances change what a group of channels sees."""

    columns: IntArray  # places of its channels in the run, ascending
    residues: ComplexArray  # (n_tolerances, n_channels + 1, MODES) over the size of each mode's residues
    missed: ComplexArray  # (MODES, n_tolerances) of the poles, relative, beyond ``sensitivity_of``
    aside: ComplexArray  # (n_tolerances, n_freq, n_channels + 1)


def bend_of(modal: Modal, plain: Group, others: Sequence[Group]) -> Bend:
    """Change by each tolerance of a group's poles, residues and of what the modes that do not drift leave."""
    omega, n_rows, step = modal.omega, len(plain.columns) + 1, np.expm1(STEP)
    missed, sizes = np.zeros((MODES, len(others)), dtype=complex), _sizes(plain.residues, plain.mode)
    aside = np.zeros((len(others), len(omega), n_rows), dtype=complex)
    bent = np.zeros((len(others), n_rows, MODES), dtype=complex)
    for t, other in enumerate(others):
        aside[t] = (_undrifting_part(other, omega) - _undrifting_part(plain, omega)) / step
        for m in range(MODES):
            a, b = _upper_pole(plain, m), _upper_pole(other, m)
            if a is not None and b is not None:
                change = other.residues[:, b] - plain.residues[:, a]
                bent[t, :, m] = change / (step * sizes[a])
                missed[m, t] = (other.poles[b] / plain.poles[a] - 1) / step - modal.sensitivity[m, t]
    return Bend(plain.columns, bent, missed, aside)


def bend_residues(
    known: Bend | None,
    n: int,
    omega: FloatArray,
    columns: IntArray,
    poles: ComplexArray,
    residues: ComplexArray,
    mode: IntArray,
) -> tuple[ComplexArray, ComplexArray]:
    """(n, n_channels + 1, n_states) and (n, n_freq, n_channels + 1): a bend by n tolerances, for these poles."""
    bent = np.zeros((n, *residues.shape), dtype=complex)
    if known is None:
        return bent, np.zeros((n, len(omega), len(columns) + 1), dtype=complex)
    rows = np.append(np.searchsorted(known.columns, columns), len(known.columns))
    sizes = _sizes(residues, mode)
    upper = np.flatnonzero((mode >= 0) & (poles.imag > 0))
    bent[:, :, upper] = known.residues[:, rows][:, :, mode[upper]] * sizes[upper]
    bent[:, :, conjugates(poles, upper)] = bent[:, :, upper].conj()
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


def sensitivity_of(
    system: LinearSystem, tolerances: Sequence[Tolerance], replaced: Collection[str] = ()
) -> ComplexArray:
    """(MODES, n_tolerances) relative change of each pole, to the order of the damping, by each number of the workshop.

    Parameters
    ----------
    system, tolerances : the supported rotor, and what the workshop does not know of it
    replaced : entries of the test condition that an effect takes the place of
    """
    modes, count = system.modes, min(MODES, len(system.modes.omega))
    Phi, omega = modes.Phi[:, :count], np.maximum(modes.omega[:count], 1e-6)
    strain = work(system.K_shaft, Phi) / omega**2
    bodies = {each.name: _kinetic_share(system, Phi, each) for each in tolerances if each.is_body}
    slopes: dict[str, Any] = {name: -share / 2 for name, share in bodies.items()} | {
        "modulus": strain / 2,
        "span": -1.5 * strain - 0.5 * np.clip(1 - sum(bodies.values(), np.zeros(count)), 0.0, 1.0),
    }
    for each in tolerances:
        if each.joint:
            slopes[each.name] = _strain_in_joint(system, Phi, each.joint - 1) / (2 * omega**2)
    if "shaft_damping_ratio" not in replaced:
        slopes["shaft_damping_ratio"] = 1j * system.shaft_damping_ratio * strain
    if "bearing_damping" not in replaced:
        slopes["bearing_damping"] = 0.5j * work(system.C_support, Phi) / omega
    at = np.zeros((MODES, len(tolerances)), dtype=complex)
    for column, each in enumerate(tolerances):
        at[:count, column] = slopes.get(each.name, 0.0)
    return at


def _kinetic_share(system: LinearSystem, Phi: FloatArray, body: Tolerance) -> FloatArray:
    """(n_modes,) share of a disk or a lumped mass in each mode's kinetic energy, of its motion or its tilting."""
    first = DOF_PER_NODE * int(system.structure.stations[body.node - 1]) + (2 if body.tilts else 0)
    return np.sum(body.value * Phi[(system.free == first) | (system.free == first + 1)] ** 2, axis=0)


def _strain_in_joint(system: LinearSystem, Phi: FloatArray, joint: int) -> FloatArray:
    """(n_modes,) twice the strain energy of a joint's springs in each mode; what is rigid has none [rad^2/s^2]."""
    structure, full = system.structure, np.zeros((system.structure.n, Phi.shape[1]))
    own = system.free < structure.n
    full[system.free[own]] = Phi[own]
    left = DOF_PER_NODE * int(structure.joint_node[joint]) + np.arange(DOF_PER_NODE)
    stiffness = np.repeat([structure.joint_stiffness[joint], structure.joint_tilt_stiffness[joint]], 2)
    soft = np.isfinite(stiffness)
    opened = full[left[soft] + DOF_PER_NODE] - full[left[soft]]
    return stiffness[soft] @ opened**2
