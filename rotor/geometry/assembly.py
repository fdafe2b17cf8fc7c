"""From a rig to its free-free matrices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from rigtwin.rotor.geometry.rig import SAME_PLACE_M, Rig, Segment
from rigtwin.rotor.model.arrays import FloatArray, IntArray
from rigtwin.rotor.model.elements import (
    Cone,
    ElementMatrices,
    ElementType,
    Section,
    cantilever_flexibility,
    euler_bernoulli,
    timoshenko,
)
from rigtwin.rotor.model.structure import DOF_PER_NODE, PLANE_PLACES, PLANE_SIGNS, Structure


def assemble(rig: Rig, *, element: ElementType = timoshenko, elements_between_nodes: int | None = None) -> Structure:
    """Assemble shaft, disks and lumped masses; supports and joints are kept apart.

    A joint cuts the shaft: two mesh nodes at its position, with an element without length and stiffness in between.

    Parameters
    ----------
    rig : the rig
    element : element theory, default Timoshenko
    elements_between_nodes : mesh refinement; default is the rig's own

    Returns
    -------
    Structure with 4 degrees of freedom per mesh node

    >>> structure = assemble(load_rig("nit-rourkela"))
    >>> structure.n_nodes, structure.n
    (7, 28)
    """
    x = _mesh(rig, elements_between_nodes or rig.elements_between_nodes)
    n = DOF_PER_NODE * len(x)
    M, K, G, K_tension = (np.zeros((n, n)) for _ in range(4))
    sections = _sections(rig, x)
    of = cache(element)  # many elements are alike
    for left, pair in enumerate(sections):
        if x[left + 1] > x[left]:
            _add_element(M, K, G, K_tension, left, [of(section, _rounded(x[left + 1] - x[left])) for section in pair])
    stations = np.array([int(np.argmin(np.abs(x - position))) for position in rig.nodes_m])
    for disk in rig.disk:
        _add_rigid_body(M, G, stations[disk.node - 1], disk.mass, disk.diametral_inertia, disk.polar_inertia)
    for mass in rig.mass:
        _add_rigid_body(M, G, stations[mass.node - 1], mass.mass_kg, 0.0, 0.0)
    return Structure(
        M=M,
        K=K,
        G=G,
        K_tension=K_tension,
        x=x,
        stations=stations,
        bending_stiffness=np.array([[s.at(0.5).bending_stiffness for s in pair] for pair in sections]),
        shear_stiffness=np.array([[_shear_stiffness(s.at(0.5), element) for s in pair] for pair in sections]),
        flexibility=_flexibilities(sections, x, element),
        diameter=np.array([(64 * pair[0].at(0.5).second_moment / math.pi) ** 0.25 for pair in sections]),
        disk_node=np.array([stations[d.node - 1] for d in rig.disk], dtype=np.int64),
        disk_mass=np.array([d.mass for d in rig.disk]),
        disk_thickness=np.array([d.thickness_m or 0.0 for d in rig.disk]),
        disk_lumped_diametral=np.array([d.own_diametral_inertia - d.diametral_inertia for d in rig.disk]),
        disk_lumped_polar=np.array([d.own_polar_inertia - d.polar_inertia for d in rig.disk]),
        **_supports(rig, stations),
        **_joints(rig, x),
    )


def _supports(rig: Rig, stations: IntArray) -> dict[str, Any]:
    """The columns of a structure that hold its supports."""
    return {
        "support_node": np.array([stations[s.node - 1] for s in rig.support], dtype=np.int64),
        "support_stiffness": np.array([_number(s.stiffness) for s in rig.support]),
        "support_tilt_stiffness": np.array([_number(s.tilt_stiffness_Nm_per_rad) for s in rig.support]),
        "support_damping": np.array([s.damping_Ns_per_m for s in rig.support]),
        **_tables(rig),
    }


def _tables(rig: Rig) -> dict[str, Any]:
    """The columns of a structure that hold the supports which follow the spin speed."""
    tables = [(number, s.table) for number, s in enumerate(rig.support) if s.table]
    rows = [number for number, table in tables for _ in table.spin_rpm]
    stiffness, damping = ([m for _, table in tables for m in table.matrices(letter)] for letter in ("k", "c"))
    return {
        "table_support": np.array(rows, dtype=np.int64),
        "table_spin_speed": np.array([rpm * math.pi / 30 for _, table in tables for rpm in table.spin_rpm]),
        "table_stiffness": np.array(stiffness, dtype=float).reshape(-1, 2, 2),
        "table_damping": np.array(damping, dtype=float).reshape(-1, 2, 2),
    }


def _joints(rig: Rig, x: FloatArray) -> dict[str, Any]:
    """The columns of a structure that hold its joints; of two mesh nodes at a joint the left one is found."""
    return {
        "joint_node": np.array([int(np.argmin(np.abs(x - place))) for place in rig.joints_m], dtype=np.int64),
        "joint_stiffness": np.array([_number(j.stiffness_N_per_m) for j in rig.joint]),
        "joint_tilt_stiffness": np.array([_number(j.tilt_stiffness_Nm_per_rad) for j in rig.joint]),
        "joint_damping": np.array([j.damping_Ns_per_m for j in rig.joint]),
        "joint_tilt_damping": np.array([j.tilt_damping_Nms_per_rad for j in rig.joint]),
    }


def _number(stiffness: str | float) -> float:
    return {"k_b": math.nan, "rigid": math.inf, "table": 0.0}[stiffness] if isinstance(stiffness, str) else stiffness


def _shear_stiffness(section: Section, element: ElementType) -> float:
    return math.inf if element is euler_bernoulli else section.shear_stiffness


def _mesh(rig: Rig, elements_between_nodes: int) -> FloatArray:
    """Mesh nodes: the rig's nodes, section changes and joints, each interval cut into equal elements; joints twice."""
    stops = list(rig.nodes_m)
    for place in (*np.cumsum([0.0] + [s.length_m for s in rig.segment]).tolist(), *rig.joints_m):
        if min(abs(place - stop) for stop in stops) > SAME_PLACE_M:
            stops.append(place)
    stops.sort()
    cuts = [np.linspace(a, b, elements_between_nodes + 1)[:-1] for a, b in pairwise(stops)]
    x = np.append(np.concatenate(cuts), stops[-1])
    twice = [x[np.argmin(np.abs(x - joint))] for joint in rig.joints_m]
    return np.sort(np.append(x, twice))


_Pair = tuple[Section | Cone, Section | Cone]  # as the y plane and the z plane see it


def _sections(rig: Rig, x: FloatArray) -> list[_Pair]:
    """Of every element between the mesh nodes."""
    borders = np.cumsum([0.0] + [s.length_m for s in rig.segment])
    places = np.searchsorted(borders[1:], (x[:-1] + x[1:]) / 2).clip(max=len(rig.segment) - 1)
    return [_part(rig.segment[k], (x[e : e + 2] - borders[k]) / rig.segment[k].length_m) for e, k in enumerate(places)]


def _part(segment: Segment, ends: FloatArray) -> _Pair:
    """A segment between two places x / L (2,)."""
    if not segment.cone:
        return segment.sections()
    part = segment.cone.part(*(float(f"{end:.12g}") for end in ends))  # without round-off: many elements are alike
    return part, part


def _flexibilities(sections: Sequence[_Pair], x: FloatArray, element: ElementType) -> FloatArray:
    """(n_elements, 2, 2, 2) see ``Structure.flexibility``; zero of the element within a joint."""
    of = cache(partial(cantilever_flexibility, sheared=element is not euler_bernoulli))
    lengths = [_rounded(length) for length in np.diff(x)]
    return np.array([[of(s, length) for s in pair] for pair, length in zip(sections, lengths, strict=True)])


def _rounded(length: float) -> float:
    """A length [m] without the round-off that tells equal elements apart."""
    return float(f"{length:.14g}")


def _add_element(
    M: FloatArray, K: FloatArray, G: FloatArray, K_tension: FloatArray, left: int, matrices: Sequence[ElementMatrices]
) -> None:
    """Write an element's matrices in y and in z to the right of a mesh node."""
    start = DOF_PER_NODE * left
    for plane, places, signs in zip(matrices, PLANE_PLACES, PLANE_SIGNS, strict=True):
        block = np.ix_(start + places, start + places)
        M[block] += signs[:, None] * plane.mass * signs
        K[block] += signs[:, None] * plane.stiffness * signs
        K_tension[block] += signs[:, None] * plane.tension * signs
    # Polar second moment = sum of the two planes'; with theta_y = -slope_z the coupling
    # I_p (theta_y'' row) takes +Omega theta_z', the theta_z row -Omega theta_y'.
    polar = matrices[0].tilt_inertia + matrices[1].tilt_inertia
    y, z = start + PLANE_PLACES[0], start + PLANE_PLACES[1]
    G[np.ix_(z, y)] += PLANE_SIGNS[1][:, None] * -polar * PLANE_SIGNS[0]
    G[np.ix_(y, z)] += PLANE_SIGNS[0][:, None] * polar * PLANE_SIGNS[1]


def _add_rigid_body(M: FloatArray, G: FloatArray, node: int, mass: float, diametral: float, polar: float) -> None:
    """A rigid disk: I_d theta_y'' + I_p Omega theta_z' = M_y, I_d theta_z'' - I_p Omega theta_y' = M_z."""
    y, z, theta_y, theta_z = range(DOF_PER_NODE * node, DOF_PER_NODE * (node + 1))
    M[[y, z], [y, z]] += mass
    M[[theta_y, theta_z], [theta_y, theta_z]] += diametral
    G[theta_y, theta_z] += polar
    G[theta_z, theta_y] -= polar
