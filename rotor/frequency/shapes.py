"""Shapes of modes: how the shaft is deflected, and how its points move."""

from __future__ import annotations

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.design import shaft_point
from rigtwin.rotor.model.structure import DOF_PER_NODE
from rigtwin.rotor.model.system import LinearSystem

# Deflections that differ by less than this share are equally large: the first of them then has the phase zero.
_EQUALLY_LARGE = 1e-6


def shaft_shapes(system: LinearSystem, shapes: ComplexArray, x: FloatArray) -> ComplexArray:
    """Deflection of the shaft between and at its nodes, by the shape functions of its elements.

    Parameters
    ----------
    system : the supported rotor, n degrees of freedom
    shapes : (n, m) displacement shapes
    x : (n_x,) positions along the shaft [m]

    Returns
    -------
    (2, n_x, m) deflections in y and z, each shape divided by its largest deflection in y or z: that one is 1, at a
    phase of zero
    """
    every = _on_every_node(system, shapes)
    deflections = np.zeros((2, len(x), shapes.shape[1]), dtype=complex)
    for plane in (1, 2):
        for place, position in enumerate(x.tolist()):
            places, weights = shaft_point(system.structure, position, plane)[0]
            deflections[plane - 1, place] = weights @ every[places]
    return _over_largest(deflections)


def _on_every_node(system: LinearSystem, shapes: ComplexArray) -> ComplexArray:
    """(n_structure, m) shapes over all mesh nodes: zero at rigid supports, alike on both sides of a rigid joint."""
    structure = system.structure
    own = system.free < structure.n
    every = np.zeros((structure.n, shapes.shape[1]), dtype=complex)
    every[system.free[own]] = shapes[own]
    for stiffness, first in ((structure.joint_stiffness, 0), (structure.joint_tilt_stiffness, 2)):
        for node in structure.joint_node[np.isinf(stiffness)]:
            left = DOF_PER_NODE * int(node) + first + np.arange(2)
            every[left + DOF_PER_NODE] = every[left]
    return every


def _over_largest(deflections: ComplexArray) -> ComplexArray:
    """Deflections (2, n_x, m) divided by the largest of each shape; of equally large ones by the first, y before z."""
    flat = deflections.reshape(-1, deflections.shape[-1])
    size = np.abs(flat)
    first = np.argmax(size >= (1 - _EQUALLY_LARGE) * size.max(axis=0), axis=0)
    largest = flat[first, np.arange(flat.shape[1])]
    return deflections / np.where(largest == 0, 1.0, largest)


def semi_axes(y: ComplexArray, z: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Major and minor semi-axis of the orbits y = Re Y e^{i omega t}, z = Re Z e^{i omega t}.

    y + i z = F e^{i omega t} + B e^{-i omega t} with F = (Y + i Z)/2 and B = (Y* + i Z*)/2, two circles that turn
    against each other. The minor axis is positive where the orbit turns from y towards z, and zero in a plane.

    >>> major, minor = semi_axes(np.array([3.0 + 0j]), np.array([-2.0j]))
    >>> major, minor
    (array([3.]), array([2.]))
    """
    forward, backward = np.abs(y + 1j * z) / 2, np.abs(y.conj() + 1j * z.conj()) / 2
    return forward + backward, forward - backward
