"""Beam elements: shape functions first, every matrix integrated from them.

Written for one bending plane with the nodal coordinates ``(w1, s1, w2, s2)``: deflection w and
rotation s of the cross-section, positive like the slope dw/dx. The shape functions are the
shear-flexible cubics that solve the static Timoshenko beam exactly (Przemieniecki, *Theory of
Matrix Structural Analysis*, 1968; for rotors Nelson, *J. Mech. Design* 102, 1980, 793-803).
With ``shear_parameter = 0`` they are the Hermite cubics of the Euler-Bernoulli beam.

The shape functions of a cone are its static deflections, too. They follow from its flexibility, the integral of
bending and shear along it, so that its stiffness is exact for forces at its ends however steep it is (the force method
of Przemieniecki's book). Mass, rotary inertia and gyroscopic moments are integrated from them over the true sections.
A cone without slope has the matrices of the uniform element.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray

# Gauss points along a cone. E I grows with the fourth power of the diameter: where that doubles over an element, an
# integral over 1 / E I has an error of 1e-16 with sixteen points, and of 1e-9 where it grows tenfold.
_CONE_POINTS, _CONE_WEIGHTS = np.polynomial.legendre.leggauss(16)

# Four Gauss points integrate polynomials up to degree 7; the mass matrix needs degree 6.
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class Section:
    """Cross-section and material of a shaft segment, as seen by one bending plane.

    Units: E, shear_modulus [Pa], density [kg/m^3], area [m^2], second_moment [m^4].
    ``shear_factor`` [-] multiplies the area to give the shear area.
    """

    area: float
    second_moment: float
    density: float
    youngs_modulus: float
    shear_modulus: float
    shear_factor: float

    @property
    def bending_stiffness(self) -> float:
        """E I [N m^2]."""
        return self.youngs_modulus * self.second_moment

    @property
    def shear_stiffness(self) -> float:
        """kappa G A [N]."""
        return self.shear_factor * self.shear_modulus * self.area

    def shear_parameter(self, length: float) -> float:
        """Phi = 12 E I / (kappa G A L^2) [-], ratio of shear to bending flexibility of an element."""
        return 12.0 * self.bending_stiffness / (self.shear_stiffness * length**2)

    def at(self, xi: float) -> Section:
        """The section at xi = x/L: the same everywhere."""
        return self


@dataclass(frozen=True)
class Cone:
    """A round stretch of shaft whose diameter and bore change along straight lines; (left, right) [m].

    ``shear_factor`` None: Cowper's for the bore ratio of each section.
    """

    diameter: tuple[float, float]
    bore: tuple[float, float]
    density: float
    youngs_modulus: float
    poisson: float
    shear_factor: float | None = None

    def at(self, xi: float) -> Section:
        """The section at xi = x/L, 0 at the left end and 1 at the right one."""
        diameter, bore = self._between(self.diameter, xi), self._between(self.bore, xi)
        return round_section(diameter, bore, self.density, self.youngs_modulus, self.poisson, self.shear_factor)

    def part(self, start: float, stop: float) -> Cone:
        """The stretch between two places xi = x/L.

        >>> Cone((0.03, 0.01), (0.0, 0.0), 7840.0, 2.1e11, 0.3).part(0.5, 1.0).diameter
        (0.02, 0.01)
        """
        ends = [tuple(self._between(pair, xi) for xi in (start, stop)) for pair in (self.diameter, self.bore)]
        return replace(self, diameter=ends[0], bore=ends[1])

    @staticmethod
    def _between(ends: tuple[float, float], xi: float) -> float:
        return (1 - xi) * ends[0] + xi * ends[1]


def round_section(
    diameter: float, bore: float, density: float, youngs_modulus: float, poisson: float, shear_factor: float | None
) -> Section:
    """Section of a bar or tube: A = pi (D^2 - d^2) / 4, I = pi (D^4 - d^4) / 64, G = E / (2 + 2 nu).

    Parameters
    ----------
    diameter, bore : D and d [m]
    shear_factor : None for Cowper's
    """
    return Section(
        math.pi * (diameter**2 - bore**2) / 4,
        math.pi * (diameter**4 - bore**4) / 64,
        density,
        youngs_modulus,
        youngs_modulus / (2 * (1 + poisson)),
        shear_factor or cowper_shear_factor(poisson, bore / diameter),
    )


def cowper_shear_factor(poisson: float, bore_ratio: float = 0.0) -> float:
    """Shear factor of a round bar or tube (Cowper, *J. Appl. Mech.* 33, 1966, 335-340).

    Solid: 6(1+nu)/(7+6nu). Hollow, with m = inner/outer diameter:
    6(1+nu)(1+m^2)^2 / [(7+6nu)(1+m^2)^2 + (20+12nu) m^2].

    >>> round(cowper_shear_factor(poisson=0.3), 3)
    0.886
    """
    wall = (1.0 + bore_ratio**2) ** 2
    return 6 * (1 + poisson) * wall / ((7 + 6 * poisson) * wall + (20 + 12 * poisson) * bore_ratio**2)


@dataclass(frozen=True)
class ElementMatrices:
    """Matrices of one element in one plane; all (4, 4), coordinates (w1, s1, w2, s2).

    ``tilt_inertia`` is the rotary part of ``mass``, int rho I Ns' Ns dx [kg, kg m, kg m^2]: a
    round shaft's gyroscopic matrix is twice that, since its polar second moment is twice I.
    ``tension`` is the geometric stiffness per newton of axial tension, int Nw'^T Nw' dx [1/m, 1, m].
    """

    stiffness: FloatArray
    mass: FloatArray
    tilt_inertia: FloatArray
    tension: FloatArray


ElementType = Callable[[Section | Cone, float], ElementMatrices]


def shape_functions(xi: float, length: float, shear_parameter: float) -> tuple[FloatArray, FloatArray]:
    """Deflection and rotation at xi = x/L for unit nodal coordinates.

    Parameters
    ----------
    xi : position in the element, 0 to 1 [-]
    length : element length L [m]
    shear_parameter : Phi = 12 E I / (kappa G A L^2) [-]

    Returns
    -------
    (4,) deflection and (4,) rotation; columns two and four are per radian
    """
    phi, L = shear_parameter, length
    # fmt: off
    deflection = np.array([
        1 - 3*xi**2 + 2*xi**3 + phi*(1 - xi),
        L*(xi - 2*xi**2 + xi**3 + phi*(xi - xi**2)/2),
        3*xi**2 - 2*xi**3 + phi*xi,
        L*(-xi**2 + xi**3 - phi*(xi - xi**2)/2),
    ])
    rotation = np.array([
        6*(xi**2 - xi)/L,
        1 - 4*xi + 3*xi**2 + phi*(1 - xi),
        6*(xi - xi**2)/L,
        3*xi**2 - 2*xi + phi*xi,
    ])
    # fmt: on
    return deflection / (1 + phi), rotation / (1 + phi)


def slope_functions(xi: float, length: float, shear_parameter: float) -> FloatArray:
    """(4,) slope dw/dx of the deflection at xi = x/L for unit nodal coordinates [1/m, 1]."""
    phi, L = shear_parameter, length
    # fmt: off
    slope = np.array([
        (6*xi**2 - 6*xi - phi)/L,
        1 - 4*xi + 3*xi**2 + phi*(1 - 2*xi)/2,
        (6*xi - 6*xi**2 + phi)/L,
        3*xi**2 - 2*xi - phi*(1 - 2*xi)/2,
    ])
    # fmt: on
    return slope / (1 + phi)


def _cubic_element(section: Section, length: float, phi: float, rotary_inertia: bool) -> ElementMatrices:
    stiffness = _cubic_stiffness(section.bending_stiffness, length, phi)
    translation = np.zeros((4, 4))
    tilt_inertia = np.zeros((4, 4))
    tension = np.zeros((4, 4))
    for point, weight in zip(_GAUSS_POINTS, _GAUSS_WEIGHTS, strict=True):
        Nw, Ns = shape_functions((1 + point) / 2, length, phi)  # (4,), (4,)
        dx = weight * length / 2
        translation += section.density * section.area * dx * np.outer(Nw, Nw)
        tilt_inertia += section.density * section.second_moment * dx * np.outer(Ns, Ns)
        slope = slope_functions((1 + point) / 2, length, phi)  # (4,)
        tension += dx * np.outer(slope, slope)
    if not rotary_inertia:
        tilt_inertia = np.zeros((4, 4))
    return ElementMatrices(stiffness, translation + tilt_inertia, tilt_inertia, tension)


def _cubic_stiffness(EI: float, L: float, phi: float) -> FloatArray:
    # fmt: off
    return EI / (L**3 * (1 + phi)) * np.array([
        [ 12.0,          6*L,  -12.0,          6*L],
        [  6*L, (4 + phi)*L**2, -6*L, (2 - phi)*L**2],
        [-12.0,         -6*L,   12.0,         -6*L],
        [  6*L, (2 - phi)*L**2, -6*L, (4 + phi)*L**2],
    ])
    # fmt: on


def cantilever_flexibility(section: Section | Cone, length: float, *, sheared: bool = True) -> FloatArray:
    """(2, 2) deflection and slope of a cantilever's end under a force and a moment there [m/N, 1/N, 1/(N m)].

    F = int m m' / (E I) + v v' / (kappa G A) dx with m = (L - x, 1), v = (1, 0); of a uniform stretch
    [[L^3/3EI + L/kGA, L^2/2EI], [L^2/2EI, L/EI]].
    """
    if isinstance(section, Cone):
        return _flexibility_up_to(section, length, 1.0, sheared)
    return uniform_flexibility(length, section.bending_stiffness, section.shear_stiffness if sheared else math.inf)


def uniform_flexibility(L: float, EI: float, GA: float) -> FloatArray:
    """(2, 2) the same of a uniform stretch, from E I [N m^2] and kappa G A [N]; inf: no shear."""
    return np.array([[L**3 / (3 * EI) + L / GA, L**2 / (2 * EI)], [L**2 / (2 * EI), L / EI]])


def stiffness_of(flexibility: FloatArray, L: float) -> FloatArray:
    """(4, 4) stiffness of an element of length L from the flexibility (2, 2) of its cantilever."""
    relative = _relative(L)
    return relative.T @ np.linalg.solve(flexibility, relative)


def _relative(L: float) -> FloatArray:
    """(2, 4) deflection and rotation of end 2 as seen from end 1."""
    return np.array([[-1.0, -L, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])


def _flexibility_up_to(cone: Cone, L: float, xi: float, sheared: bool) -> FloatArray:
    """(2, 2) deflection and rotation at x = xi L of a cone held at its left end, under a force and a moment at the
    right one: int_0^x m_x m' / (E I) + v v' / (kappa G A) ds with m_x = (x - s, 1), m = (L - s, 1).
    """
    flexibility = np.zeros((2, 2))
    for point, weight in zip(_CONE_POINTS, _CONE_WEIGHTS, strict=True):
        place = xi * (1 + point) / 2
        section, ds = cone.at(place), xi * L * weight / 2
        own, end = np.array([(xi - place) * L, 1.0]), np.array([(1 - place) * L, 1.0])
        flexibility += ds / section.bending_stiffness * np.outer(own, end)
        if sheared:
            flexibility[0, 0] += ds / section.shear_stiffness
    return flexibility


def _cone_element(cone: Cone, L: float, *, sheared: bool, rotary_inertia: bool) -> ElementMatrices:
    """Matrices of a cone: the deflections N are rigid motion of end 1 plus F_x F^-1 times what end 2 does beyond it."""
    whole = _flexibility_up_to(cone, L, 1.0, sheared)
    forces = np.linalg.solve(whole, _relative(L))  # (2, 4) force and moment at end 2
    translation, tilt_inertia, tension = (np.zeros((4, 4)) for _ in range(3))
    for point, weight in zip(_CONE_POINTS, _CONE_WEIGHTS, strict=True):
        xi, dx = (1 + point) / 2, weight * L / 2
        section = cone.at(xi)
        rigid = np.array([[1.0, xi * L, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
        Nw, Ns = rigid + _flexibility_up_to(cone, L, xi, sheared) @ forces  # (4,), (4,)
        slope = Ns + forces[0] / section.shear_stiffness if sheared else Ns
        translation += section.density * section.area * dx * np.outer(Nw, Nw)
        tilt_inertia += section.density * section.second_moment * dx * np.outer(Ns, Ns)
        tension += dx * np.outer(slope, slope)
    if not rotary_inertia:
        tilt_inertia = np.zeros((4, 4))
    return ElementMatrices(stiffness_of(whole, L), translation + tilt_inertia, tilt_inertia, tension)


def timoshenko(section: Section | Cone, length: float) -> ElementMatrices:
    """Timoshenko element: shear flexibility, consistent mass, rotary inertia."""
    if isinstance(section, Cone):
        return _cone_element(section, length, sheared=True, rotary_inertia=True)
    return _cubic_element(section, length, section.shear_parameter(length), rotary_inertia=True)


def euler_bernoulli(section: Section | Cone, length: float) -> ElementMatrices:
    """Euler-Bernoulli element: no shear, no rotary inertia, consistent mass."""
    if isinstance(section, Cone):
        return _cone_element(section, length, sheared=False, rotary_inertia=False)
    return _cubic_element(section, length, 0.0, rotary_inertia=False)


def linear_timoshenko(section: Section | Cone, length: float) -> ElementMatrices:
    """Two-node element with linear interpolation and one integration point.

    The interpolation of ANSYS' BEAM188 in its default setting (KEYOPT(3) = 0): deflection and
    rotation are straight lines, so the curvature is constant over the element and bending comes
    out too stiff on a coarse mesh. Hughes, Taylor and Kanoknukulchai, *Int. J. Numer. Meth.
    Eng.* 11, 1977, 1529-1543. A cone has its middle section everywhere.
    """
    section = section.at(0.5)
    L = length
    curvature = np.array([0.0, -1 / L, 0.0, 1 / L])
    shear = np.array([-1 / L, -0.5, 1 / L, -0.5])  # w' - s in the middle of the element
    bending, sliding = np.outer(curvature, curvature), np.outer(shear, shear)
    stiffness = L * (section.bending_stiffness * bending + section.shear_stiffness * sliding)
    line = L / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
    mass, tilt_inertia = np.zeros((4, 4)), np.zeros((4, 4))
    mass[0::2, 0::2] = section.density * section.area * line
    tilt_inertia[1::2, 1::2] = section.density * section.second_moment * line
    slope = np.array([-1 / L, 0.0, 1 / L, 0.0])
    return ElementMatrices(stiffness, mass + tilt_inertia, tilt_inertia, L * np.outer(slope, slope))
