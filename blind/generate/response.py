"""What the accelerometers of a linear rig report, free of noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.machine import Machine, Setting, Workshop, build_machine
from rigtwin.blind.generate.rig import ComplexArray, FloatArray, Rig
from rigtwin.blind.generate.strangers import with_crosstalk

N_DRIFTING = 12  # modes whose frequency drifts; the highest lies far above every raster


def reported(
    rig: Rig,
    setting: Setting,
    effects: Sequence[Effect],
    frequency_hz: FloatArray,
    workshop: Workshop | None = None,
    drift: FloatArray | None = None,
) -> ComplexArray:
    """(n_freq, n_nodes) accelerance; with ``force_dropout`` per nominal newton.

    drift : (2, n_modes) relative drift of the resonances, second row for the second principal plane
    """
    nodes = range(1, len(rig.nodes) + 1)
    masses = [e for e in effects if e.id == "sensor_mass"]
    loaded = [n for n in nodes if any(e.node in (0, n) for e in masses)]
    drift = np.zeros((2, N_DRIFTING)) if drift is None else drift
    args = rig, setting, effects, frequency_hz, workshop, drift
    H = _in_both_planes(*args, sensor=None)
    for node in loaded:
        H[:, node - 1] = _in_both_planes(*args, sensor=node)[:, node - 1]
    return with_crosstalk(H, effects, rig.drive_node) * chain_factor(effects, frequency_hz, len(rig.nodes))


def _in_both_planes(
    rig: Rig,
    setting: Setting,
    effects: Sequence[Effect],
    frequency_hz: FloatArray,
    workshop: Workshop | None,
    drift: FloatArray,
    *,
    sensor: int | None,
) -> ComplexArray:
    """Accelerance along the force; unequal principal stiffnesses make it a mixture of two plane rotors.

    K_b = k_b R diag(1 + a/2, 1 - a/2) R^T, the rest alike in all directions: H_yy = cos^2 H_1 + sin^2 H_2.
    """
    omega = 2 * np.pi * frequency_hz
    at_nodes = np.zeros((len(omega), len(rig.nodes)), dtype=complex)
    at_drive = np.zeros(len(omega), dtype=complex)
    for row, (share, one) in zip(drift, principal_settings(setting, effects), strict=False):
        machine = build_machine(rig, one, effects, workshop, sensor=sensor)
        of_nodes, of_drive = machine.receptance(omega, row)
        at_nodes += share * of_nodes
        at_drive += share * of_drive
    return -(omega[:, None] ** 2) * at_nodes * force_factor(effects, omega, at_drive)[:, None]


def principal_settings(setting: Setting, effects: Sequence[Effect]) -> list[tuple[float, Setting]]:
    """Share of the response and bearing stiffness of each principal direction."""
    planes = [(1.0, setting)]
    for effect in effects:
        if effect.id == "plane_anisotropy" and not setting.rigid:
            a, share = effect["anisotropy"], np.cos(effect["angle"]) ** 2
            stiff, soft = (replace(setting, k_b=setting.k_b * (1 + half)) for half in (a / 2, -a / 2))
            planes = [(share, stiff), (1 - share, soft)]
    return planes


def machines(rig: Rig, setting: Setting, effects: Sequence[Effect], workshop: Workshop | None) -> list[Machine]:
    """The plane rotors that ``reported`` mixes, sensors without mass."""
    return [build_machine(rig, one, effects, workshop) for _, one in principal_settings(setting, effects)]


def force_factor(effects: Sequence[Effect], omega: FloatArray, drive_receptance: ComplexArray) -> ComplexArray:
    """(n_freq,) force over nominal force at constant current, 1/(1 + (k_a - w^2 m_a + i w c_a) X_dd)."""
    armature = np.zeros(len(omega), dtype=complex)
    for e in effects:
        if e.id == "force_dropout":
            braking = e["damping"] / (1 + 1j * omega * e.extras.get("coil_time_constant", 0.0))
            armature += e["stiffness"] - omega**2 * e["mass"] + 1j * omega * braking
    return 1 / (1 + armature * drive_receptance)


def chain_factor(effects: Sequence[Effect], frequency_hz: FloatArray, n_nodes: int) -> ComplexArray:
    """(n_freq, n_nodes) reported over true acceleration: gains and delays of the sensors."""
    factor = np.ones((len(frequency_hz), n_nodes), dtype=complex)
    for e in effects:
        channels = slice(None) if e.node == 0 else slice((e.node or 1) - 1, e.node)
        if e.id == "sensor_gain":
            factor[:, channels] *= e["gain"]
        if e.id == "sensor_delay":
            phase = 2j * np.pi * frequency_hz * e["delay"]
            factor[:, channels] *= (1 / (1 + phase) if e.form == "lowpass" else np.exp(-phase))[:, None]
    return factor
