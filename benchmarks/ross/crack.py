"""The open crack of ROSS' Crack fault: local compliance, and frequencies with that stiffness held fixed.

ROSS cuts the shaft at the right end of the cracked element. Its compliance matrix there, on (x, y, alpha, beta), is
the clamped element's plus c55 on alpha (bending in ROSS' y, across the crack's edge: weak) and c44 on beta (bending
in x: strong). Both are hinges with a rotational spring.
"""

from __future__ import annotations

import numpy as np
from model import DIAMETER_M, YOUNGS_MODULUS_PA, Case, Lateral, Options, build, nearest, plane_frequencies_hz
from ross.faults.crack import Crack
from scipy.linalg import eigh
from standing import K_B, both

DEPTH_RATIOS = (0.1, 0.2, 0.3, 0.4, 0.5)
POSITIONS_M = (0.2, 0.119)
_SECOND_MOMENT_M4 = np.pi * DIAMETER_M**4 / 64


def open_crack() -> Case:
    """Compliances [rad/(N m)] by depth ratio a/d, and natural frequencies [Hz] with one open crack."""
    systems = {(k, x): build(Options(k_b=both(k), stops_m=(x,))) for k in K_B for x in POSITIONS_M}
    fracture = [fracture_compliances(systems[K_B[0], POSITIONS_M[0]], depth) for depth in DEPTH_RATIOS]
    cases = [frequencies(system, k, x) for (k, x), system in systems.items()]
    return {
        "depth_over_diameter": DEPTH_RATIOS,
        "fracture_mechanics": {
            "meaning": "rad/(N m); ROSS' models Mayes and Gasch when open: weak is c55, bending across the crack's "
            "edge (plane z below), strong is c44 (plane y), coupling is c45",
            "weak": [c["c55"] for c in fracture],
            "strong": [c["c44"] for c in fracture],
            "coupling": [c["c45"] for c in fracture],
        },
        "equivalent_beam": equivalent_beam(systems[K_B[0], POSITIONS_M[0]]),
        "strip_integral_weak": {
            "meaning": "rad/(N m); no ROSS: strips of the section as edge-cracked plates in bending, for comparison",
            "weak": [strip_integral(depth) for depth in DEPTH_RATIOS],
        },
        "frequencies": {
            "meaning": "f_hz_y and f_hz_z: [depth][mode] with the hinges strong in y and weak in z at x, no coupling",
            "cases": cases,
        },
    }


def crack_at(system: Lateral, x: float, depth: float, model: str = "Mayes") -> tuple[Crack, int]:
    """ROSS' crack whose hinge lies at x [m], and the element's left mesh node."""
    element = nearest(np.array(system.rotor.nodes_pos), x) - 1
    return Crack(system.rotor, n=element, depth_ratio=depth, crack_model=model), element


def fracture_compliances(system: Lateral, depth: float) -> dict[str, float]:
    """c44, c55, c45 of Papadopoulos and Dimarogonas as ROSS reads them [rad/(N m)]."""
    crack, _ = crack_at(system, POSITIONS_M[0], depth)
    return {name: float(crack._get_coefficient(name)) for name in ("c44", "c55", "c45")}


def frequencies(system: Lateral, k_b: float, x: float) -> Case:
    """Frequencies at every depth for one bearing stiffness and place."""
    hinged = [with_hinge(system, x, depth) for depth in DEPTH_RATIOS]
    return {
        "k_b_N_per_m": k_b,
        "x_m": x,
        "f_hz_intact": plane_frequencies_hz(system, "y"),
        **{f"f_hz_{plane}": [lowest_hz(*in_plane(plane, M, K), 4) for M, K in hinged] for plane in "yz"},
    }


def lowest_hz(M: np.ndarray, K: np.ndarray, n: int) -> np.ndarray:
    """The n lowest natural frequencies [Hz]."""
    return np.sqrt(eigh(K, M, eigvals_only=True)[:n]) / (2 * np.pi)


def in_plane(plane: str, M: np.ndarray, K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The matrices of one plane: y with theta_z, z with theta_y, the hinge's own rotations last."""
    planes = np.append(np.tile(list("yzzy"), len(M) // 4), list("zy"))
    keep = np.ix_(planes == plane, planes == plane)
    return M[keep], K[keep]


def with_hinge(system: Lateral, x: float, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """M and K of the rotor with the cracked element's right end on rotations of its own, tied by the hinge.

    Without mass at the new rotations this is ROSS' cracked element, all of its Kc but c45. (ROSS' own run brings only
    the first entry of Kc to the element's nodes, see README.md.)
    """
    crack, element = crack_at(system, x, depth)
    n = len(system.K)
    shared = np.arange(4 * element, 4 * element + 8)
    own = np.append(shared[:6], [n, n + 1])
    lateral = np.ix_(*2 * [[0, 1, 3, 4, 6, 7, 9, 10]])
    M, K = (np.pad(A, (0, 2)) for A in (system.M, system.K))
    for A, part in ((M, crack.shaft_elem.M()[lateral]), (K, crack.K_elem[lateral])):
        A[np.ix_(shared, shared)] -= part
        A[np.ix_(own, own)] += part
    ends = np.array([*shared[6:], n, n + 1])
    K[np.ix_(ends, ends)] += hinge_stiffness(crack, coupled=False)
    check_cracked_element(crack, crack.K_elem[lateral])
    return M, K


def hinge_stiffness(crack: Crack, *, coupled: bool) -> np.ndarray:
    """4 x 4 stiffness between two pairs (theta_y, theta_z) = ROSS' (alpha, beta) [N m/rad], with c45 or without."""
    c44, c55, c45 = (crack._get_coefficient(name) for name in ("c44", "c55", "c45"))
    spring = np.linalg.inv([[c55, c45 * coupled], [c45 * coupled, c44]])
    return np.block([[spring, -spring], [-spring, spring]])


def check_cracked_element(crack: Crack, healthy: np.ndarray) -> None:
    """Element and hinge, condensed to two nodes, are ROSS' Kc with the reactions at the element's other end."""
    K = np.pad(healthy, (0, 2))
    order = [0, 1, 2, 3, 4, 5, 8, 9, 6, 7]  # the element ends on the new rotations, 8 and 9
    K = K[np.ix_(order, order)]
    K[6:, 6:] += hinge_stiffness(crack, coupled=True)
    condensed = K[:8, :8] - K[:8, 8:] @ np.linalg.solve(K[8:, 8:], K[8:, :8])
    L = crack.shaft_elem.L
    T = np.vstack([-np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, -L, 1, 0], [L, 0, 0, 1]]), np.eye(4)])
    assert np.allclose(condensed, T @ crack.Kc @ T.T, rtol=1e-6, atol=1e-9 * np.abs(condensed).max())


def equivalent_beam(system: Lateral) -> Case:
    """ROSS' model Flex Open: a stretch of shaft with the second moments of the section that is left.

    Read back from its element K: on a beam (w, s, ...) K_ws / K_ww is L/2, and K_ss - K_ss' is 2 E I/L for any shear.
    """
    rows = []
    for depth in DEPTH_RATIOS:
        K = crack_at(system, POSITIONS_M[0], depth, "Flex Open")[0].flex_open(0.0)
        length = 2 * abs(K[0, 4] / K[0, 0])
        weak, strong = (
            (K[i, i] - K[i, i + 6]) * length / (2 * YOUNGS_MODULUS_PA)
            for i in (4, 3)  # beta is the weak rotation here
        )
        rows.append((length, weak, strong))
    lengths, weak, strong = np.array(rows).T
    return {
        "meaning": "model Flex Open: the shaft over length_m has these second moments; compliance_weak is "
        "length/E (1/I_weak - 1/I), rad/(N m)",
        "length_m": lengths,
        "second_moment_weak_m4": weak,
        "second_moment_strong_m4": strong,
        "second_moment_intact_m4": _SECOND_MOMENT_M4,
        "compliance_weak": lengths / YOUNGS_MODULUS_PA * (1 / weak - 1 / _SECOND_MOMENT_M4),
        "compliance_strong": lengths / YOUNGS_MODULUS_PA * (1 / strong - 1 / _SECOND_MOMENT_M4),
    }


def strip_integral(depth_ratio: float, poisson: float = 0.3, n: int = 400) -> float:
    """Bending compliance across the crack's edge [rad/(N m)] from the strip theory of fracture mechanics.

    c = 2 (1 - nu^2)/E  int int  pi a (4 h / (pi R^4) F(a/2h))^2 da dx  with h = sqrt(R^2 - x^2) half the strip's
    height, a its crack depth and F the factor of an edge-cracked plate in bending.
    """
    R, depth = DIAMETER_M / 2, depth_ratio * DIAMETER_M
    half_width = np.sqrt(R**2 - (R - depth) ** 2)
    nodes, weights = np.polynomial.legendre.leggauss(n)
    total = 0.0
    for u, w in zip(nodes, weights, strict=True):
        x = half_width * u
        half_height = np.sqrt(R**2 - x**2)
        a_end = depth - (R - half_height)
        a = a_end * (1 + nodes) / 2
        lam = np.pi * a / (4 * half_height)
        F = np.sqrt(np.tan(lam) / lam) * (0.923 + 0.199 * (1 - np.sin(lam)) ** 4) / np.cos(lam)
        inner = np.sum(weights * np.pi * a * (4 * half_height / (np.pi * R**4) * F) ** 2) * a_end / 2
        total += w * inner * half_width
    return 2 * (1 - poisson**2) / YOUNGS_MODULUS_PA * total
