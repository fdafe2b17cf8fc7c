"""Rigs whose truth is known: the paper's, pinned and clamped beams, disks on light shafts."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import ElementType, Section, timoshenko
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PAPER: dict[str, Any] = tomllib.loads((BENCHMARKS / "paper_tables.toml").read_text(encoding="utf-8"))
ROSS: dict[str, Any] = tomllib.loads((BENCHMARKS / "reproduction/ross_table.toml").read_text(encoding="utf-8"))

STEEL = {"youngs_modulus_Pa": 207e9, "density_kg_per_m3": 7840.0, "poisson": 0.3}
# Heavy enough to keep the mass matrix regular, too light to be felt.
LIGHT_STEEL = STEEL | {"density_kg_per_m3": 7840e-6}
RIGID = Condition(rigid_support=True)


def tables(**changes: Any) -> dict[str, Any]:
    """The paper's rig as the tables of its TOML, with top-level keys replaced."""
    return load_rig("nit-rourkela").model_dump(exclude_unset=True) | changes


def rig(**keys: Any) -> Rig:
    """A rig from its tables."""
    return Rig.model_validate({"name": "test"} | keys)


def round_shaft(length: float, diameter: float, material: dict[str, float] = STEEL, **keys: float) -> dict[str, Any]:
    """A segment table."""
    return {"length_m": length, "diameter_m": diameter} | material | keys


def pinned_beam(segment: dict[str, Any]) -> Rig:
    """A beam on two bearings; pinned at both ends when they are rigid."""
    supports = [{"node": node, "stiffness": "k_b"} for node in (1, 3)]
    L = segment["length_m"]
    return rig(nodes_m=[0.0, L / 2, L], segment=[segment], support=supports)


def cantilever(*segments: dict[str, Any], **keys: Any) -> Rig:
    """A beam clamped at node 1; a clamp's tilt is rigid, its deflection follows ``rigid_support``."""
    ends = np.cumsum([0.0] + [s["length_m"] for s in segments])
    clamp = {"node": 1, "stiffness": "k_b", "tilt_stiffness_Nm_per_rad": "rigid"}
    return rig(nodes_m=list(ends), segment=list(segments), support=[clamp], **keys)


def jeffcott(mass_kg: float = 2.0) -> Rig:
    """A mass in the middle of a light and stiff shaft on two bearings."""
    return rig(
        nodes_m=[0.0, 0.2, 0.4],
        segment=[round_shaft(0.4, 0.2, LIGHT_STEEL)],
        disk=[{"node": 2, "mass_kg": mass_kg}],
        support=[{"node": 1, "stiffness": "k_b"}, {"node": 3, "stiffness": "k_b"}],
    )


def paper_structure(elements: int = 1, element: ElementType = timoshenko) -> Structure:
    """The paper's rotor without its bearings."""
    return assemble(load_rig("nit-rourkela"), element=element, elements_between_nodes=elements)


def paper_system(condition: Condition, *, elements: int = 1, element: ElementType = timoshenko) -> LinearSystem:
    """The paper's rotor."""
    return build_system(paper_structure(elements, element), condition)


def held(beam: Rig, *, elements: int, element: ElementType = timoshenko, condition: Condition = RIGID) -> LinearSystem:
    """A rig on its supports, meshed with so many elements between nodes."""
    return build_system(assemble(beam, element=element, elements_between_nodes=elements), condition)


def paper_condition(k_b: float) -> Condition:
    """The paper's k_b; its 1e15 N/m is the rigid support."""
    return RIGID if k_b > 1e14 else Condition(k_b=k_b)


def section_of(beam: Rig) -> Section:
    """Section of the first segment in the y plane."""
    return beam.segment[0].sections()[0]


def pinned_euler_bernoulli_hz(section: Section, length: float, mode: int) -> float:
    """f_n = (n pi / L)^2 sqrt(EI / rho A) / 2 pi."""
    k = mode * math.pi / length
    return k**2 * math.sqrt(section.bending_stiffness / (section.density * section.area)) / (2 * math.pi)


def pinned_timoshenko_whirl(section: Section, length: float, mode: int, spin_speed: float = 0.0) -> tuple[float, float]:
    """Backward and forward whirl [rad/s] of a spinning pinned Timoshenko beam in closed form.

    With y + i z = W sin(kx) e^{i omega t}, rotation S cos(kx) and k = n pi / L:

        kGA (k^2 W - k S)        = rho A omega^2 W
        EI k^2 S + kGA (S - k W) = rho I (omega^2 - 2 Omega omega) S
    """
    k = mode * math.pi / length
    shear = section.shear_factor * section.shear_modulus * section.area
    a, b = section.density * section.area, section.density * section.second_moment
    translation = np.array([-a, 0.0, shear * k**2])
    tilt = np.array([-b, 2 * b * spin_speed, section.bending_stiffness * k**2 + shear])
    roots = np.roots(np.polymul(translation, tilt) - np.array([0, 0, 0, 0, (shear * k) ** 2]))
    assert np.abs(roots.imag).max() < 1e-6 * np.abs(roots.real).max()
    return -roots.real[roots.real < 0].max(), roots.real[roots.real > 0].min()


def lumped_rotor(density: float, *, clamped: bool = True) -> Rig:
    """A disk at the end of a shaft that weighs next to nothing, clamped, or on one bearing about which it swings."""
    tilt = {"tilt_stiffness_Nm_per_rad": "rigid"} if clamped else {}
    return rig(
        nodes_m=[0.0, 0.3],
        elements_between_nodes=4,
        excitation_node=2,
        segment=[round_shaft(0.3, 0.02, STEEL | {"density_kg_per_m3": density})],
        disk=[
            {"node": 2, "mass_kg": 5.0, "diametral_inertia_kg_m2": 0.02, "polar_inertia_kg_m2": 0.04, "inertia": True}
        ],
        support=[{"node": 1, "stiffness": "k_b", **tilt}],
    )


def lumped_rotor_matrices(*, clamped: bool = True) -> tuple[FloatArray, FloatArray]:
    """Mass and stiffness (2, 2) of the disk's deflection and tilt on a massless shaft, in closed form.

    Clamped, the shaft's flexibility is [[L^3/3EI + L/kGA, L^2/2EI], [L^2/2EI, L/EI]]. On one bearing the shaft is a
    rigid pointer between bearing and disk as far as it is not bent: what strains it is the tilt beyond w / L, against
    the stiffness of a simply supported end, 1 / (L/3EI + 1/(kGA L)).
    """
    shaft = section_of(lumped_rotor(STEEL["density_kg_per_m3"]))
    L, EI = 0.3, shaft.bending_stiffness
    kGA = shaft.shear_factor * shaft.shear_modulus * shaft.area
    mass = np.diag([5.0, 0.02])
    if clamped:
        return mass, np.linalg.inv([[L**3 / (3 * EI) + L / kGA, L**2 / (2 * EI)], [L**2 / (2 * EI), L / EI]])
    bent = np.array([-1 / L, 1.0])
    return mass, np.outer(bent, bent) / (L / (3 * EI) + 1 / (kGA * L))


def driving_point(system: LinearSystem, node: int = 2) -> tuple[FloatArray, FloatArray]:
    """Force pattern (n, 1) and read-out of every node (n_nodes, n) in y."""
    return system.unit_vector(node, 1)[:, None], system.read_out(1)
