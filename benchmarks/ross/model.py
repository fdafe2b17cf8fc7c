"""The rotor in ROSS, its lateral matrices, and what is solved from them.

ROSS (x, y lateral, z along the shaft) turns into the project's axes by renaming: x -> y, y -> z, z -> x,
alpha -> theta_y, beta -> theta_z. Handedness, signs and the spin's sense stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import ross as rs
from scipy.linalg import eigh

NODES_M = (0.0, 0.0595, 0.119, 0.213, 0.307, 0.3665, 0.426)
DIAMETER_M, YOUNGS_MODULUS_PA, DENSITY, POISSON = 0.020, 207e9, 7840.0, 0.3
DISK_NODES, DISK_DIAMETER_M, DISK_THICKNESS_M = (3, 5), 0.124, 0.018
DISK_MASS_KG = DENSITY * np.pi * DISK_DIAMETER_M**2 / 4 * DISK_THICKNESS_M
DISK_ID_KG_M2 = DISK_MASS_KG * (3 * DISK_DIAMETER_M**2 / 4 + DISK_THICKNESS_M**2) / 12
DISK_IP_KG_M2 = DISK_MASS_KG * DISK_DIAMETER_M**2 / 8
BEARING_DAMPING_NS_PER_M = 100.0
FORCE_NODE = 2
ELEMENTS_PER_SPAN = 8

_STEEL = rs.Material(name="nit_rourkela_steel", rho=DENSITY, E=YOUNGS_MODULUS_PA, Poisson=POISSON)


@dataclass(frozen=True)
class Pedestal:
    """What a bearing stands on: stiffness [N/m], mass [kg], damping [N s/m], in both directions."""

    stiffness: float
    mass: float
    damping: float


@dataclass(frozen=True)
class Options:
    """One variant of the rotor.

    k_b [N/m] of the left and the right bearing, or stiffness_yz: each bearing's 2 x 2 matrix in (y, z). masses are
    (node, kg); spring_y is (node, N/m, N s/m) to ground in y; bearing_offset [m] moves both bearings towards the
    middle; axial_force [N] is positive in tension; stops_m are further places that shall be mesh nodes.
    """

    k_b: tuple[float, float] = (1e6, 1e6)
    damping: float = BEARING_DAMPING_NS_PER_M
    stiffness_yz: np.ndarray | None = None
    disk_id: float = 0.0
    disk_ip: float = 0.0
    masses: tuple[tuple[int, float], ...] = ()
    spring_y: tuple[int, float, float] | None = None
    pedestal: Pedestal | None = None
    bearing_offset: float = 0.0
    axial_force: float = 0.0
    stops_m: tuple[float, ...] = ()
    elements_per_span: int = ELEMENTS_PER_SPAN


@dataclass(frozen=True)
class Lateral:
    """M q'' + (C + spin G) q' + K q = f on ROSS' lateral coordinates.

    Shaft nodes first, each (y, z, theta_y, theta_z) in the project's names, then the pedestals' (y, z).
    """

    rotor: rs.Rotor
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    G: np.ndarray
    dofs: np.ndarray  # ROSS' index of each lateral coordinate
    stations: np.ndarray  # (7,) mesh node of each rig node, from 0

    def place(self, node: int, plane: str) -> int:
        """Index of a rig node's deflection; node from 1."""
        return 4 * int(self.stations[node - 1]) + "yz".index(plane)

    def read_out(self, plane: str) -> np.ndarray:
        """Indices of the deflections of nodes 1 to 7."""
        return np.array([self.place(node, plane) for node in range(1, len(NODES_M) + 1)])

    @property
    def pedestals(self) -> np.ndarray:
        """Indices of the pedestals' deflections, (left, right) x (y, z)."""
        return np.arange(4 * len(self.rotor.nodes), len(self.dofs)).reshape(-1, 2)


def mesh(options: Options) -> np.ndarray:
    """Positions of the mesh nodes [m]: the rig's nodes and further stops, every interval cut alike."""
    offset = options.bearing_offset
    extra = (*options.stops_m, *((offset, NODES_M[-1] - offset) if offset else ()))
    stops = sorted({*NODES_M, *extra})
    cuts = [np.linspace(a, b, options.elements_per_span + 1)[:-1] for a, b in pairwise(stops)]
    return np.append(np.concatenate(cuts), stops[-1])


def nearest(x: np.ndarray, position: float) -> int:
    """The mesh node at a position."""
    found = int(np.argmin(np.abs(x - position)))
    assert abs(x[found] - position) < 1e-9, f"no mesh node at {position} m"
    return found


def build_rotor(options: Options) -> rs.Rotor:
    """The rotor as ROSS elements."""
    x = mesh(options)
    shaft = [
        rs.ShaftElement(L=length, idl=0.0, odl=DIAMETER_M, material=_STEEL, axial_force=options.axial_force)
        for length in np.diff(x)
    ]
    disks = [
        rs.DiskElement(n=nearest(x, NODES_M[node - 1]), m=mass, Id=inertia, Ip=polar)
        for node, mass, inertia, polar in (
            *((node, DISK_MASS_KG, options.disk_id, options.disk_ip) for node in DISK_NODES),
            *((node, mass, 0.0, 0.0) for node, mass in options.masses),
        )
    ]
    springs, point_masses = _supports(options, x)
    return rs.Rotor(shaft, disks, springs, point_masses)


def _supports(options: Options, x: np.ndarray) -> tuple[list[Any], list[Any]]:
    """Bearings, pedestals and the spring at a node."""
    springs, point_masses = [], []
    for side, end in enumerate((0, len(NODES_M) - 1)):
        inward = options.bearing_offset * (1 if side == 0 else -1)
        matrix = options.k_b[side] * np.eye(2) if options.stiffness_yz is None else options.stiffness_yz
        bearing = {
            "n": nearest(x, NODES_M[end] + inward),
            "kxx": float(matrix[0, 0]),
            "kyy": float(matrix[1, 1]),
            "kxy": float(matrix[0, 1]),
            "kyx": float(matrix[1, 0]),
            "cxx": options.damping,
        }
        if options.pedestal is None:
            springs.append(rs.BearingElement(**bearing))
            continue
        link = len(x) + side
        springs.append(rs.BearingElement(**bearing, n_link=link))
        springs.append(rs.BearingElement(n=link, kxx=options.pedestal.stiffness, cxx=options.pedestal.damping))
        point_masses.append(rs.PointMass(n=link, m=options.pedestal.mass))
    if options.spring_y is not None:
        node, stiffness, damping = options.spring_y
        springs.append(rs.BearingElement(n=nearest(x, NODES_M[node - 1]), kxx=stiffness, kyy=0.0, cxx=damping, cyy=0.0))
    return springs, point_masses


def build(options: Options) -> Lateral:
    """Assemble with ROSS and keep the lateral coordinates."""
    rotor, x = build_rotor(options), mesh(options)
    shaft_dofs = [6 * i + j for i in range(len(x)) for j in (0, 1, 3, 4)]
    link_dofs = [6 * len(x) + 3 * i + j for i in range(len(rotor.point_mass_elements)) for j in (0, 1)]
    dofs = np.array(shaft_dofs + link_dofs)
    M, C, K, G = (A[np.ix_(dofs, dofs)] for A in (rotor.M(0), rotor.C(0), rotor.K(0), rotor.G()))
    stations = np.array([nearest(x, position) for position in NODES_M])
    return Lateral(rotor, M, C, K, G, dofs, stations)


def frequencies_hz(system: Lateral, K: np.ndarray | None = None) -> np.ndarray:
    """Undamped natural frequencies at standstill, both planes, ascending [Hz]; K replaces the system's own."""
    squares = eigh(system.K if K is None else K, system.M, eigvals_only=True)
    return np.sqrt(squares) / (2 * np.pi)


def plane_frequencies_hz(system: Lateral, plane: str, K: np.ndarray | None = None, n: int = 4) -> np.ndarray:
    """The first n of them that move in one plane, where the planes do not couple [Hz]."""
    offsets = {"y": (0, 3), "z": (1, 2)}[plane]
    shaft = [4 * i + j for i in range(len(system.rotor.nodes)) for j in offsets]
    keep = np.array(shaft + [int(pair["yz".index(plane)]) for pair in system.pedestals])
    rest = np.setdiff1d(np.arange(len(system.dofs)), keep)
    K = system.K if K is None else K
    assert not K[np.ix_(keep, rest)].any(), "the planes couple"
    squares = eigh(K[np.ix_(keep, keep)], system.M[np.ix_(keep, keep)], eigvals_only=True)
    return np.sqrt(squares[:n]) / (2 * np.pi)


def receptance(
    system: Lateral, frequency_hz: np.ndarray, force: np.ndarray, spin: float = 0.0, K: np.ndarray | None = None
) -> np.ndarray:
    """(n_freq, n) response to a complex force pattern per unit [m/N]; time factor e^{+i omega t}."""
    K = system.K if K is None else K
    omega = 2 * np.pi * frequency_hz[:, None, None]
    D = K + 1j * omega * (system.C + spin * system.G) - omega**2 * system.M
    return np.linalg.solve(D, np.broadcast_to(force[:, None], (len(D), len(force), 1)))[..., 0]


def unit_force(system: Lateral, node: int = FORCE_NODE, plane: str = "y") -> np.ndarray:
    """Force pattern of 1 N at a node."""
    force = np.zeros(len(system.dofs))
    force[system.place(node, plane)] = 1.0
    return force


def whirl_hz(system: Lateral, spin: float, n: int = 4) -> dict[str, np.ndarray]:
    """The first n backward and forward whirl frequencies, undamped part |Im lambda| [Hz].

    Solved as 1/lambda of the inverse state matrix, so that the low modes have the full precision.
    """
    inverse_K = np.linalg.inv(system.K)
    n_dofs = len(system.K)
    A = np.block(
        [
            [-inverse_K @ (system.C + spin * system.G), -inverse_K @ system.M],
            [np.eye(n_dofs), np.zeros((n_dofs, n_dofs))],
        ]
    )
    values, vectors = np.linalg.eig(A)
    # On (q, u = lambda q): q / lambda = -K^-1 (C q + M u) is the equation of motion, u / lambda = q the definition.
    eigenvalue = 1 / values
    keep = eigenvalue.imag > 1e-3 * np.abs(eigenvalue)
    eigenvalue, shape = eigenvalue[keep], vectors[:n_dofs, keep]
    order = np.argsort(eigenvalue.imag)
    eigenvalue, shape = eigenvalue[order], shape[:, order]
    forward = turns_forward(shape[0 : 4 * len(system.rotor.nodes) : 4], shape[1 : 4 * len(system.rotor.nodes) : 4])
    hz = eigenvalue.imag / (2 * np.pi)
    return {"backward": hz[~forward][:n], "forward": hz[forward][:n]}


def turns_forward(y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """True where the orbits turn from y to z: with e^{+i omega t}, z lags y by a quarter turn."""
    return np.sum((np.conj(y) * z).imag, axis=0) < 0


def lateral_modal_hz(rotor: rs.Rotor, modal: Any) -> tuple[np.ndarray, list[str]]:
    """ROSS' own damped frequencies [Hz] and whirl directions; torsional and axial modes are left out."""
    n_nodes = len(rotor.nodes)
    frequencies, directions = [], []
    for index, value in enumerate(modal.wd):
        shape = np.abs(modal.evectors[: 6 * n_nodes, index]).reshape(n_nodes, 6).max(axis=0)
        if max(shape[:2]) > 1e-6 * max(shape[2], shape[5]):
            frequencies.append(value / (2 * np.pi))
            directions.append(str(modal.whirl_direction()[index]))
    return np.array(frequencies), directions


def largest_relative_difference(a: np.ndarray, b: np.ndarray) -> float:
    """max |a - b| / |b|."""
    return float(np.max(np.abs(a - b) / np.abs(b)))


def lines_hz(resonances_hz: np.ndarray, count: int = 32) -> np.ndarray:
    """Frequencies from 20 to 400 Hz: evenly spaced ones, and five round every resonance below 400 Hz."""
    near = [f * (1 + d) for f in resonances_hz if f < 400 for d in (-4e-3, -1e-3, 0.0, 1e-3, 4e-3)]
    return np.unique(np.round(np.concatenate([np.linspace(20, 400, count), near]), 3))


def split(values: np.ndarray) -> dict[str, Any]:
    """Real and imaginary part, each (line, node)."""
    return {"real": values.real, "imag": values.imag}


Case = dict[str, Any]
