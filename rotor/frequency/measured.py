"""What a rig without noise measures on a linear rotor, effects of the measurement chain included.

The virtual rig of ``sim`` measures through the same groups of channels and the same factors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigtwin.rotor.effects.effect import Effect
from rigtwin.rotor.frequency.frequency_response import driven_receptance
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model
from rigtwin.rotor.model.structure import Structure

Quantity = Literal["receptance", "mobility", "accelerance", "acceleration"]

# Powers of i omega between a quantity and receptance.
DERIVATIVE_ORDER = {"receptance": 0, "mobility": 1, "accelerance": 2, "acceleration": 2}


@dataclass(frozen=True)
class ChannelGroup:
    """Sensors that are read together, and the effects that act while they are read."""

    nodes: tuple[int, ...]
    effects: tuple[Effect, ...]


def channel_groups(effects: Sequence[Effect], nodes: Sequence[int]) -> tuple[ChannelGroup, ...]:
    """Split the nodes into groups that see the same rotor: a sensor with mass loads its node only while it is read.

    Parameters
    ----------
    effects : of the structure and of the measurement chain
    nodes : nodes of the sensors, from 1

    Returns
    -------
    groups in the order of their first node; in their effects every mass on a sensor has the node it is at

    >>> [group.nodes for group in channel_groups([EFFECTS["sensor_mass"](mass=0.02, node=3)], nodes=[2, 3, 4])]
    [(2, 4), (3,)]
    """
    groups: dict[tuple[Effect, ...], list[int]] = {}
    for node in nodes:
        groups.setdefault(tuple(_while_read(effects, node)), []).append(node)
    return tuple(ChannelGroup(tuple(read), acting) for acting, read in groups.items())


def _while_read(effects: Sequence[Effect], node: int) -> Iterator[Effect]:
    for effect in effects:
        if not effect.rides_on_sensor:
            yield effect
        elif effect.sits_at(node):
            yield effect.moved_to(node)


def check_nodes(effects: Sequence[Effect], n_nodes: int) -> None:
    """Raise ValueError where an effect sits at a node that the rotor does not have."""
    for effect in effects:
        for name, place in effect.places().items():
            node = getattr(effect, name)
            if place.kind == "node" and node > n_nodes:
                raise ValueError(f"{effect.id}.{name}: node {node} does not exist: the rotor has nodes 1 to {n_nodes}")


def channel_factor(effects: Sequence[Effect], omega: FloatArray, node: int) -> ComplexArray:
    """(n_freq,) reported response divided by the true one at a node, by all effects."""
    factor = np.ones(len(omega), dtype=complex)
    for effect in effects:
        if type(effect).channel_factor is not Effect.channel_factor:
            factor *= effect.channel_factor(omega, node)
    return factor


def at_constant_current(effects: Sequence[Effect]) -> bool:
    """Whether an effect makes the force depend on the motion."""
    return any(type(effect).force_factor is not Effect.force_factor for effect in effects)


def force_factor(effects: Sequence[Effect], omega: FloatArray, drive_receptance: ComplexArray) -> ComplexArray:
    """(n_freq,) force on the rotor over the nominal force, by all effects; arguments as ``Effect.force_factor``."""
    factor = np.ones(len(omega), dtype=complex)
    for effect in effects:
        factor *= effect.force_factor(omega, drive_receptance)
    return factor


def measured_response(
    structure: Structure,
    condition: Condition,
    effects: Sequence[Effect],
    frequency_hz: FloatArray,
    nodes: Sequence[int] | None = None,
    *,
    plane: int | None = None,
    quantity: Quantity = "accelerance",
    referred_to: Literal["force", "nominal_force"] = "force",
    force_amplitude: float = 1.0,
) -> ComplexArray:
    """Steady response of a linear rotor as its sensors report it; unbalance is left out.

    Parameters
    ----------
    structure : the free-free rotor
    condition : support, exciter, spin
    effects : of the structure and of the measurement chain; raster and sweep rate change nothing here
    frequency_hz : (n_freq,) [Hz]
    nodes : nodes of the sensors, default all
    plane : what the sensors look along, 1 = y, 2 = z, default the plane of the force
    quantity : "acceleration" is in m/s^2 and not divided by a force, recorded at constant exciter current
    referred_to : the force on the rotor, or the one that was asked for; "acceleration" follows the latter
    force_amplitude : that was asked for [N], for "acceleration"

    Returns
    -------
    (n_freq, n_channels) in the order of ``nodes``

    Raises
    ------
    ValueError : an effect is nonlinear, or names a node that does not exist
    """
    read = tuple(nodes) if nodes is not None else tuple(range(1, structure.n_nodes + 1))
    for node in read:
        structure.dof(node, 1)  # raises where there is no such node
    check_nodes(effects, structure.n_nodes)
    omega = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
    unit = force_amplitude if quantity == "acceleration" else 1.0
    nominal = quantity == "acceleration" or referred_to == "nominal_force"
    once = tuple(dict.fromkeys(read))
    response = np.empty((len(omega), len(once)), dtype=complex)
    for group in channel_groups(effects, once):
        H, drive = _receptance(structure, condition, group, omega, plane or condition.excitation_plane)
        scale = unit * (1j * omega) ** DERIVATIVE_ORDER[quantity]
        if nominal:
            scale = scale * force_factor(group.effects, omega, drive)
        sensors = [scale * channel_factor(group.effects, omega, node) for node in group.nodes]
        response[:, [once.index(node) for node in group.nodes]] = H * np.array(sensors).T
    return response[:, [once.index(node) for node in read]]


def _receptance(
    structure: Structure, condition: Condition, group: ChannelGroup, omega: FloatArray, plane: int
) -> tuple[ComplexArray, ComplexArray]:
    """(n_freq, n_group) receptance at the sensors of a group and (n_freq,) at the exciter."""
    model = build_model(structure, condition, group.effects)
    if model.forces:
        laws = ", ".join(force.law.name for force in model.forces)
        raise ValueError(f"a rotor with the force laws {laws} has no frequency response; use harmonic balance")
    system = model.system
    exciter = system.unit_vector(condition.excitation_node, condition.excitation_plane)
    outputs = np.vstack([system.read_out(plane)[np.array(group.nodes) - 1], exciter])
    H = driven_receptance(system, omega, exciter, outputs, condition.spin_speed)[:, :, 0]
    return H[:, :-1], H[:, -1]
