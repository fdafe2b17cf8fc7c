"""Beam elements: shape functions first, every matrix integrated from them.

Written for one bending plane with the nodal coordinates ``(w1, s1, w2, s2)``: deflection w and
rotation s of the cross-section, positive like the slope dw/dx. The shape functions are the
shear-flexible cubics that solve the static Timoshenko beam exactly (Przemieniecki, *Theory of
Matrix Structural Analysis*, 1968; for rotors Nelson, *J. Mech. Design* 102, 1980, 793-803).
With ``shear_parameter = 0`` they are the Hermite cubics of the Euler-Bernoulli beam.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray

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


ElementType = Callable[[Section, float], ElementMatrices]


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


def timoshenko(section: Section, length: float) -> ElementMatrices:
    """Timoshenko element: shear flexibility, consistent mass, rotary inertia."""
    return _cubic_element(section, length, section.shear_parameter(length), rotary_inertia=True)


def euler_bernoulli(section: Section, length: float) -> ElementMatrices:
    """Euler-Bernoulli element: no shear, no rotary inertia, consistent mass."""
    return _cubic_element(section, length, 0.0, rotary_inertia=False)


def linear_timoshenko(section: Section, length: float) -> ElementMatrices:
    """Two-node element with linear interpolation and one integration point.

    The interpolation of ANSYS' BEAM188 in its default setting (KEYOPT(3) = 0): deflection and
    rotation are straight lines, so the curvature is constant over the element and bending comes
    out too stiff on a coarse mesh. Hughes, Taylor and Kanoknukulchai, *Int. J. Numer. Meth.
    Eng.* 11, 1977, 1529-1543.
    """
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
