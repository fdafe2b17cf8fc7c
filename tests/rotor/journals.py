"""Rotors in journal bearings: coefficients of the short-bearing theory, and rigs whose supports have tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import brentq

from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import ElementType, timoshenko
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import LinearSystem
from tests.rotor import rigs

RPM = math.pi / 30
UNDAMPED_SHAFT = Condition(shaft_damping_ratio=0.0)

# (2, 2) stiffness [N/m] and damping [N s/m] at a spin speed [rad/s].
Coefficients = Callable[[float], tuple[Any, Any]]


def short_bearing(eccentricity: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Modified Sommerfeld number and coefficients of a plain journal bearing: short-bearing theory [friswell2010].

    h0 = [pi^2 (1 - e^2) + 16 e^2]^(-3/2); k_ij = a_ij F / c and c_ij = b_ij F / (c Omega) under the static load F, with
    the axes u along the load and v, towards which the journal turns from u.

    Returns
    -------
    S = D Omega eta L^3 / (8 F c^2) [-], a (2, 2), b (2, 2)
    """
    e, e2, pi2, root = eccentricity, eccentricity**2, math.pi**2, math.sqrt(1 - eccentricity**2)
    below = pi2 * (1 - e2) + 16 * e2
    a_uu = 4 * (pi2 * (2 - e2) + 16 * e2)
    a_uv = math.pi * (pi2 * (1 - e2) ** 2 - 16 * e2 * e2) / (e * root)
    a_vu = -math.pi * (pi2 * (1 - e2) * (1 + 2 * e2) + 32 * e2 * (1 + e2)) / (e * root)
    a_vv = 4 * (pi2 * (1 + 2 * e2) + 32 * e2 * (1 + e2) / (1 - e2))
    b_uu = 2 * math.pi * root * (pi2 * (1 + 2 * e2) - 16 * e2) / e
    b_uv = -8 * (pi2 * (1 + 2 * e2) - 16 * e2)
    b_vv = 2 * math.pi * (pi2 * (1 - e2) ** 2 + 48 * e2) / (e * root)
    a, b = np.array([[a_uu, a_uv], [a_vu, a_vv]]), np.array([[b_uu, b_uv], [b_uv, b_vv]])
    return (1 - e2) ** 2 / (e * math.sqrt(below)), a * below**-1.5, b * below**-1.5


def oil_film(load: float, diameter: float, length: float, clearance: float, viscosity: float) -> Coefficients:
    """Coefficients of a short bearing over the spin speed, the load in y."""

    def at(Omega: float) -> tuple[np.ndarray, np.ndarray]:
        wanted = diameter * Omega * viscosity * length**3 / (8 * load * clearance**2)
        e = float(brentq(lambda e: short_bearing(e)[0] - wanted, 1e-6, 1 - 1e-6))
        _, a, b = short_bearing(e)
        return a * load / clearance, b * load / (clearance * Omega)

    return at


def table(coefficients: Coefficients, spin_rpm: Sequence[float]) -> dict[str, list[float]]:
    """A support's table in a rig file."""
    rows = [coefficients(rpm * RPM) for rpm in spin_rpm]
    keys: dict[str, list[float]] = {"spin_rpm": list(spin_rpm)}
    for which, name, unit in ((0, "k", "N_per_m"), (1, "c", "Ns_per_m")):
        for a, b in np.ndindex(2, 2):
            keys[f"{name}{'yz'[a]}{'yz'[b]}_{unit}"] = [float(np.asarray(row[which])[a, b]) for row in rows]
    return keys


def on_tables(coefficients: Coefficients, spin_rpm: Sequence[float], nodes: Sequence[int], **keys: Any) -> Rig:
    """A rig whose supports at these nodes all have the same table."""
    own = table(coefficients, spin_rpm)
    return rigs.rig(support=[{"node": node, "stiffness": "table", "table": own} for node in nodes], **keys)


def jeffcott(
    coefficients: Coefficients, spin_rpm: Sequence[float], *, mass_kg: float = 2.0, diameter: float = 0.02
) -> Rig:
    """A mass in the middle of a light shaft of 0.4 m in two journals."""
    return on_tables(
        coefficients,
        spin_rpm,
        (1, 3),
        nodes_m=[0.0, 0.2, 0.4],
        segment=[rigs.round_shaft(0.4, diameter, rigs.LIGHT_STEEL)],
        disk=[{"node": 2, "mass_kg": mass_kg}],
    )


def film(Omega: float) -> tuple[np.ndarray, np.ndarray]:
    """A short bearing beside a seal, whose cross damping is skew, as that of seals is."""
    stiffness, damping = oil_film(400.0, 0.05, 0.02, 5e-5, 0.03)(Omega)
    return stiffness, damping + np.array([[0.0, 3e3], [-3e3, 0.0]])


TABLE_RPM = (2000.0, 4000.0, 7000.0, 11000.0)


def disk_in_oil(**keys: Any) -> Rig:
    """A disk beside the middle of a shaft in two short bearings."""
    disk = {"mass_kg": 60.0, "diametral_inertia_kg_m2": 0.8, "polar_inertia_kg_m2": 1.5, "inertia": True}
    return on_tables(
        film,
        TABLE_RPM,
        (1, 4),
        nodes_m=[0.0, 0.25, 0.5, 0.8],
        segment=[rigs.round_shaft(0.8, 0.05)],
        disk=[{"node": 2, **disk}],
        **keys,
    )


def system_of(rig: Rig, *, element: ElementType = timoshenko, condition: Condition = UNDAMPED_SHAFT) -> LinearSystem:
    """The rotor at the lowest speed of its tables; it can be taken to others."""
    structure = assemble(rig, element=element)
    fields = {**vars(condition), "spin_speed": structure.lowest_spin_speed}
    return build_system(structure, Condition(**fields))
