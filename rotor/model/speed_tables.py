"""Supports whose stiffness and damping follow the spin speed, as programs for fluid-film bearings give them.

A table holds two matrices for each of its spin speeds, with the force on the shaft -K (y, z) - C (y', z') [lund1987].
Between two speeds every coefficient follows a straight line. A straight line cannot overshoot, and between two damping
matrices that take energy out of every motion it gives one that does so, too, because such matrices form a convex cone
[boyd2004]; a smooth curve through each coefficient by itself promises neither. Its error is at most h^2/8 times the
largest second derivative of the coefficient, with h the distance of the speeds [deboor2001].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray, IntArray

# Distance from the end of a table, relative to the speed there, at which a speed still counts as the end's own: a speed
# that was written with six digits.
TABLE_END = 1e-5

_RPM = np.pi / 30


class SpinSpeedError(ValueError):
    """A support's table does not hold the spin speed."""


@dataclass(frozen=True)
class SpeedTable:
    """Stiffness and damping of one support over the spin speed, in (y, z)."""

    node: int  # of the rig, from 1
    spin_speed: FloatArray  # (n_rows,) [rad/s], ascending, two rows or more
    stiffness: FloatArray  # (n_rows, 2, 2) [[k_yy, k_yz], [k_zy, k_zz]] [N/m]
    damping: FloatArray  # (n_rows, 2, 2) [N s/m]

    def at(self, spin_speed: float) -> tuple[FloatArray, FloatArray]:
        """(2, 2) stiffness [N/m] and (2, 2) damping [N s/m] at a spin speed [rad/s].

        Raises SpinSpeedError outside the table: nothing is extrapolated.

        >>> ramp = np.array([1.0, 3.0])[:, None, None] * np.eye(2)
        >>> SpeedTable(1, np.array([100.0, 200.0]), ramp, 0 * ramp).at(150.0)[0]
        array([[2., 0.],
               [0., 2.]])
        """
        low, high = self.spin_speed[[0, -1]].tolist()
        if not low - TABLE_END * low <= spin_speed <= high + TABLE_END * high:
            raise SpinSpeedError(
                f"the table of the support at node {self.node} runs from {low / _RPM:.6g} to {high / _RPM:.6g} rev/min "
                f"and does not hold {spin_speed / _RPM:.6g} rev/min: choose a spin speed inside, or extend the table"
            )
        row = int(np.clip(np.searchsorted(self.spin_speed, spin_speed, side="right") - 1, 0, len(self.spin_speed) - 2))
        start, stop = self.spin_speed[row : row + 2]
        share = float(np.clip((spin_speed - start) / (stop - start), 0.0, 1.0))
        K, C = ((1 - share) * values[row] + share * values[row + 1] for values in (self.stiffness, self.damping))
        return K, C


@dataclass(frozen=True)
class SpeedSupports:
    """A rotor's matrices without its supports with tables, and these supports."""

    K: FloatArray  # (n, n) [N/m]
    C: FloatArray  # (n, n) supports' damping [N s/m]
    tables: tuple[SpeedTable, ...]
    places: tuple[IntArray, ...]  # of each table (2,) degrees of freedom in y and z

    def at(self, spin_speed: float) -> tuple[FloatArray, FloatArray]:
        """K and C (n, n) with the supports at a spin speed [rad/s]. Raises SpinSpeedError outside a table."""
        K, C = self.K.copy(), self.C.copy()
        for table, places in zip(self.tables, self.places, strict=True):
            own_K, own_C = table.at(spin_speed)
            K[np.ix_(places, places)] += own_K
            C[np.ix_(places, places)] += own_C
        return K, C
