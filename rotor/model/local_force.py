"""A force law at a joint of the rotor: where it acts, and its force for a given displacement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.force_laws import ForceLaw
from rigtwin.rotor.model.printed_laws import ARRAY, SCALAR

# Below this displacement [m] the resultant of a radial law has no direction.
_NO_DISPLACEMENT = 1e-18


@dataclass(frozen=True)
class LocalForce:
    """A force -patterns' F(patterns q) on the rotor, beyond the linear stiffness of the joint.

    The joint displacements are y = patterns[0] q and z = patterns[1] q. A radial law acts along
    their resultant, any other law in each plane separately. ``offset`` is the static displacement of
    the joint in y, about which the rotor vibrates; the force of the law there is subtracted.
    """

    law: ForceLaw
    coefficients: tuple[float, ...]  # in the order of the law's
    patterns: FloatArray  # (2, n)
    offset: float = 0.0  # [m]

    def with_corner(self, corner: float) -> LocalForce:
        """The same force with its corners rounded over another length [m]; a law without corners stays."""
        return replace(self, coefficients=self._coefficients(corner))

    def coefficient(self, name: str) -> float:
        """Value of one of the law's coefficients. Raises ValueError when the law has no such."""
        return self.coefficients[self.law.coefficients.index(name)]

    def along(self, x: FloatArray, corner: FloatArray | None = None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force [N] and slopes [N/m] of a law without memory for motion in y alone, or in z of a centred joint.

        Parameters
        ----------
        x : (N,) joint displacement [m]
        corner : (N,) rounding [m] of each of them in place of the force's own

        Returns
        -------
        (N,) force and its derivatives by displacement and by rounding

        >>> force, slope, _ = LocalForce(CUBIC, coefficients=(2.0,), patterns=np.eye(2)).along(np.array([1.0, 3.0]))
        >>> force, slope
        (array([ 2., 54.]), array([ 6., 54.]))
        """
        force, slope, by_corner = ARRAY[self.law.name](x + self.offset, *self._coefficients(corner))
        return force - self._static, np.broadcast_to(slope, x.shape), np.broadcast_to(by_corner, x.shape)

    def across(
        self, y: FloatArray, z: FloatArray, corner: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Forces and their derivatives, of a law without memory, for motion in both planes.

        Parameters
        ----------
        y, z : (N,) joint displacements [m]
        corner : as for ``along``

        Returns
        -------
        (2, N) forces [N], (2, 2, N) derivatives by the displacements and (2, N) by the rounding [N/m]
        """
        if not self.law.radial:
            in_y, in_z = self.along(y, corner), self.centred.along(z, corner)
            zero = np.zeros_like(y)
            jacobian = np.array([[in_y[1], zero], [zero, in_z[1]]])
            return np.array([in_y[0], in_z[0]]), jacobian, np.array([in_y[2], in_z[2]])
        r = np.maximum(np.hypot(y + self.offset, z), _NO_DISPLACEMENT)
        force, slope, by_corner = ARRAY[self.law.name](r, *self._coefficients(corner))
        n, secant = np.array([(y + self.offset) / r, z / r]), force / r
        along = n[:, None] * n[None, :]
        forces = force * n - np.array([self._static, 0.0])[:, None]
        return forces, slope * along + secant * (np.eye(2)[:, :, None] - along), by_corner * n

    @property
    def centred(self) -> LocalForce:
        """The same force without static displacement."""
        return replace(self, offset=0.0)

    def _coefficients(self, corner: FloatArray | float | None) -> tuple[Any, ...]:
        """The law's coefficients, with another rounding unless it is None."""
        if corner is None:
            return self.coefficients
        return tuple(
            corner if n == "corner" else v for n, v in zip(self.law.coefficients, self.coefficients, strict=True)
        )

    @property
    def _static(self) -> float:
        """Force of the law at rest, in y [N]."""
        return float(SCALAR[self.law.name](self.offset, *self.coefficients)[0])
