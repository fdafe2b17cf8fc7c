"""A rotor in two journal bearings: their coefficients by the short-bearing theory, and rig files of them."""

from __future__ import annotations

import math


def short_bearing(eccentricity: float) -> tuple[float, list[list[float]], list[list[float]]]:
    """Sommerfeld number [-] and the coefficients of a plain journal bearing by the short-bearing (Ocvirk) theory.

    Closed forms over the eccentricity ratio as printed by Friswell et al., *Dynamics of Rotating Machines*, 2010, and in
    many other books: with h0 = [pi^2 (1 - e^2) + 16 e^2]^(-3/2), stiffness a_ij = k_ij c / F and damping
    b_ij = c_ij c Omega / F, axis u along the static load and v across it, towards which the journal turns from u.

    Returns
    -------
    modified Sommerfeld number S = D Omega eta L^3 / (8 F c^2), a (2, 2), b (2, 2), all in (u, v)
    """
    e, pi2 = eccentricity, math.pi**2
    e2 = e * e
    s = (1 - e2) ** 2 / (e * math.sqrt(pi2 * (1 - e2) + 16 * e2))
    h = (pi2 * (1 - e2) + 16 * e2) ** -1.5
    root = math.sqrt(1 - e2)
    a_uu = h * 4 * (pi2 * (2 - e2) + 16 * e2)
    a_uv = h * math.pi * (pi2 * (1 - e2) ** 2 - 16 * e2 * e2) / (e * root)
    a_vu = -h * math.pi * (pi2 * (1 - e2) * (1 + 2 * e2) + 32 * e2 * (1 + e2)) / (e * root)
    a_vv = h * 4 * (pi2 * (1 + 2 * e2) + 32 * e2 * (1 + e2) / (1 - e2))
    b_uu = h * 2 * math.pi * root * (pi2 * (1 + 2 * e2) - 16 * e2) / e
    b_uv = -h * 8 * (pi2 * (1 + 2 * e2) - 16 * e2)
    b_vv = h * 2 * math.pi * (pi2 * (1 - e2) ** 2 + 48 * e2) / (e * root)
    return s, [[a_uu, a_uv], [a_vu, a_vv]], [[b_uu, b_uv], [b_uv, b_vv]]
