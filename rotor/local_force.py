"""A force law at a joint of the rotor: where it acts, on what, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rotor.force_laws import ForceLaw
from rotor.printed_laws import ARRAY, SCALAR
from rotor.structure import FloatArray

# Two displacements this close [m] are one: the resultant of a radial law has no direction there.
_NO_DISPLACEMENT = 1e-18


@dataclass(frozen=True)
class LocalForce:
    """A force -patterns' F(patterns q) on the rotor, beyond the linear stiffness of the joint.

    The joint displacements are y = patterns[0] q and z = patterns[1] q. A radial law acts along
    their resultant, any other in each plane alone. ``offset`` is the joint's static displacement
    in y, about which the rotor vibrates.
    """

    law: ForceLaw
    coefficients: tuple[float, ...]  # in the order of the law's
    patterns: FloatArray  # (2, n)
    offset: float = 0.0  # [m]

    def with_corner(self, corner: float) -> LocalForce:
        """The same force with its corners rounded over another length [m]; a law without corners stays."""
        if "corner" not in self.law.coefficients:
            return self
        place = self.law.coefficients.index("corner")
        return replace(self, coefficients=(*self.coefficients[:place], corner, *self.coefficients[place + 1 :]))

    def coefficient(self, name: str) -> float:
        """Value of one of the law's coefficients. Raises ValueError when the law has no such."""
        return self.coefficients[self.law.coefficients.index(name)]

    def along(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Force [N] and slope [N/m] of a law without memory for motion in y alone, or in z of a centred joint.

        Parameters
        ----------
        x : (N,) joint displacement [m]
        """
        law = ARRAY[self.law.name]
        force, slope = law(x + self.offset, *self.coefficients)
        return force - self._static, slope

    def across(self, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces and their Jacobian of a law without memory for motion in both planes.

        Parameters
        ----------
        y, z : (N,) joint displacements [m]

        Returns
        -------
        (2, N) forces [N] and (2, 2, N) derivatives [N/m]
        """
        law = ARRAY[self.law.name]
        if not self.law.radial:
            (force_y, slope_y), (force_z, slope_z) = self.along(y), law(z, *self.coefficients)
            zero = np.zeros_like(force_y)
            return np.array([force_y, force_z]), np.array([[slope_y, zero], [zero, slope_z]])
        r = np.maximum(np.hypot(y + self.offset, z), _NO_DISPLACEMENT)
        force, slope = law(r, *self.coefficients)
        n, secant = np.array([(y + self.offset) / r, z / r]), force / r
        along = n[:, None] * n[None, :]
        forces = force * n - np.array([self._static, 0.0])[:, None]
        return forces, slope * along + secant * (np.eye(2)[:, :, None] - along)

    @property
    def _static(self) -> float:
        """Force in the static position, in y [N]."""
        return SCALAR[self.law.name](self.offset, *self.coefficients)[0] if self.offset else 0.0
