"""Timoshenko shaft in spectral elements: Lagrange polynomials through Gauss-Lobatto points, one lateral plane.

Deflection w and rotation s of the cross-section are interpolated alike; the shear strain is w' - s. At order four and
above the element does not lock in shear and is integrated exactly.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss

from rigtwin.blind.generate.rig import FloatArray, Segment

ORDER = 5
SHORTEST = 2e-3  # m, of an element that nothing demands, in a rotor as long as the reference


def lobatto_points(order: int) -> FloatArray:
    """(order + 1,) Gauss-Lobatto points on [-1, 1]: the ends and the zeros of P'_order."""
    inner = Legendre.basis(order).deriv().roots()
    return np.concatenate([[-1.0], np.sort(inner.real), [1.0]])


def lagrange(points: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n_at, n_points) values and derivatives of the Lagrange polynomials through the points."""
    n = len(points)
    to_legendre = np.linalg.inv(np.polynomial.legendre.legvander(points, n - 1))  # (n, n)
    values = np.polynomial.legendre.legvander(at, n - 1) @ to_legendre
    slopes = np.column_stack([Legendre(to_legendre[:, k]).deriv()(at) for k in range(n)])
    return values, slopes


@dataclass(frozen=True)
class Stretch:
    """A spectral element of uniform shaft."""

    start: float  # [m]
    length: float  # [m]
    segment: Segment
    bending_factor: float  # EI over the bare shaft's
    w: tuple[int, ...]  # coordinates of its deflections
    s: tuple[int, ...]  # and rotations


@dataclass(frozen=True)
class Shaft:
    """Free-free shaft in one plane, n coordinates."""

    stretches: tuple[Stretch, ...]
    K: FloatArray  # (n, n) bending, shear and hinges [N/m, N, N m]
    K_axial: FloatArray  # (n, n) geometric stiffness of 1 N of tension
    M: FloatArray  # (n, n) [kg, kg m, kg m^2]

    def _shapes(self, x: float) -> tuple[Stretch, FloatArray, FloatArray]:
        last = self.stretches[-1]
        inside = min(max(x, 0.0), last.start + last.length)
        stretch = next(e for e in self.stretches if inside <= e.start + e.length + 1e-12)
        xi = np.array([2 * (inside - stretch.start) / stretch.length - 1])
        values, slopes = lagrange(lobatto_points(ORDER), xi)
        return stretch, values[0], slopes[0] * 2 / stretch.length

    def rotation(self, x: float) -> FloatArray:
        """(n,) row that reads the rotation s of the cross-section at x."""
        row = np.zeros(len(self.M))
        stretch, values, _ = self._shapes(x)
        row[list(stretch.s)] = values
        return row

    def deflection(self, x: float) -> FloatArray:
        """(n,) row that reads the deflection at x; beyond its ends the shaft goes on straight and rigid."""
        row = np.zeros(len(self.M))
        stretch, values, _ = self._shapes(x)
        row[list(stretch.w)] = values
        last = self.stretches[-1]
        beyond = min(x, 0.0) + max(x - last.start - last.length, 0.0)
        return row + beyond * self.rotation(x)


@dataclass(frozen=True)
class Hinge:
    """A section whose halves turn against each other by ``compliance`` times the bending moment."""

    position: float  # [m]
    compliance: float  # [rad/(N m)]


@dataclass(frozen=True)
class Hub:
    """A stretch whose bending stiffness is ``factor`` times the bare shaft's."""

    start: float  # [m]
    end: float  # [m]
    factor: float


def build_shaft(
    segments: Sequence[Segment],
    breaks: Sequence[float],
    hubs: Sequence[Hub] = (),
    hinges: Sequence[Hinge] = (),
    *,
    modulus_factor: float = 1.0,
    shortest: float = SHORTEST,
) -> Shaft:
    """Assemble a shaft with element borders where its sections change, and at ``breaks`` [m].

    A break nearer than ``shortest`` [m] to another border is left out: the polynomials reach it, and short elements
    cost accuracy.
    """
    stretches = _mesh(segments, breaks, hubs, hinges, shortest)
    n = 1 + max(max(e.w + e.s) for e in stretches)
    K, K_axial, M = np.zeros((3, n, n))
    for element in stretches:
        k, g, m = element_matrices(element)
        where = np.ix_([*element.w, *element.s], [*element.w, *element.s])
        K[where] += modulus_factor * k
        K_axial[where] += g
        M[where] += m
    for hinge in hinges:
        left = next(e for e in stretches if abs(e.start + e.length - hinge.position) < 1e-12)
        right = next(e for e in stretches if abs(e.start - hinge.position) < 1e-12)
        jump = np.zeros(n)
        jump[right.s[0]], jump[left.s[-1]] = 1.0, -1.0
        K += modulus_factor / hinge.compliance * np.outer(jump, jump)
    return Shaft(tuple(stretches), K, K_axial, M)


def _mesh(
    segments: Sequence[Segment], breaks: Sequence[float], hubs: Sequence[Hub], hinges: Sequence[Hinge], shortest: float
) -> list[Stretch]:
    """Elements from border to border; at a hinge the two sides have rotations of their own."""
    ends = np.cumsum([s.length for s in segments])
    needed = [0.0, *ends, *(h.position for h in hinges), *(x for h in hubs for x in (h.start, h.end))]
    borders = _distinct([x for x in needed if 0.0 <= x <= ends[-1] + 1e-12])
    for x in breaks:
        if 0.0 < x < ends[-1] and min(abs(x - b) for b in borders) > shortest:
            borders.append(x)
    borders.sort()
    stretches: list[Stretch] = []
    next_free = 2
    w_end, s_end = 0, 1
    for a, b in itertools.pairwise(borders):
        middle = (a + b) / 2
        segment = segments[int(np.searchsorted(ends, middle))]
        factor = float(np.prod([h.factor for h in hubs if h.start < middle < h.end]))
        if any(abs(h.position - a) < 1e-12 for h in hinges):
            s_end, next_free = next_free, next_free + 1
        w = (w_end, *range(next_free, next_free + ORDER))
        s = (s_end, *range(next_free + ORDER, next_free + 2 * ORDER))
        next_free += 2 * ORDER
        w_end, s_end = w[-1], s[-1]
        stretches.append(Stretch(a, b - a, segment, factor, w, s))
    return stretches


def _distinct(values: Sequence[float]) -> list[float]:
    """Sorted; of values closer than a picometre the first."""
    result: list[float] = []
    for x in sorted(values):
        if not result or x - result[-1] > 1e-12:
            result.append(float(x))
    return result


def element_matrices(element: Stretch) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(2p + 2, 2p + 2) stiffness, geometric stiffness of 1 N and mass, coordinates (w..., s...)."""
    points, weights = leggauss(ORDER + 1)
    N, dN = lagrange(lobatto_points(ORDER), points)  # (n_gauss, p + 1)
    dN = dN * 2 / element.length
    weights = weights * element.length / 2
    section = element.segment
    zero = np.zeros_like(N)
    bending, shear = np.hstack([zero, dN]), np.hstack([dN, -N])
    slope, deflection, rotation = np.hstack([dN, zero]), np.hstack([N, zero]), np.hstack([zero, N])

    def integral(factor: float, row: FloatArray) -> FloatArray:
        return factor * row.T @ (weights[:, None] * row)

    EI = element.bending_factor * section.modulus * section.second_moment
    k = integral(EI, bending) + integral(section.shear_stiffness, shear)
    m = integral(section.density * section.area, deflection) + integral(
        section.density * section.second_moment, rotation
    )
    return k, integral(1.0, slope), m
