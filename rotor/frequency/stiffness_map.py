"""The rotor over its bearing stiffness: critical speeds, natural frequencies, and what stiffness a frequency tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.frequency.whirl import critical_speeds, follow
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import Change, build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem

# Critical speeds above those that are followed over the stiffness.
_SPARE = 6


@dataclass(frozen=True)
class CriticalSpeedMap:
    """Undamped critical speeds over bearing stiffness: a row for each stiffness, a column for each whirl."""

    k_b: FloatArray  # (n_k,) [N/m]
    spin_speed: FloatArray  # (n_k, m) [rad/s]
    direction: FloatArray  # (n_k, m) 1 forward, -1 backward, 0 planar


@dataclass(frozen=True)
class Reading:
    """The bearing stiffness at which a mode has a frequency that was measured."""

    mode: int  # bending mode of one plane, from 1
    k_b: float  # [N/m]


@dataclass(frozen=True)
class BearingRange:
    """A rotor on bearings of any stiffness; they also take the place of supports that follow the spin speed."""

    structure: Structure
    condition: Condition  # its k_b is replaced
    effects: Sequence[Change] = ()

    @property
    def free_structure(self) -> Structure:
        """The structure with bearings in place of supports that follow the spin speed."""
        return self.structure.with_bearings_for_tables()

    def at(self, k_b: float) -> LinearSystem:
        """The rotor on bearings of this stiffness [N/m]."""
        return build_system(self.free_structure, replace(self.condition, k_b=float(k_b)), self.effects)


def critical_speed_map(rotor: BearingRange, k_b: FloatArray, n: int = 6) -> CriticalSpeedMap:
    """The lowest critical speeds over bearing stiffness, each followed by its shape.

    Parameters
    ----------
    k_b : (n_k,) stiffnesses [N/m], ascending
    n : whirls that are followed, counted at the lowest stiffness; fewer where a rotor has fewer critical speeds
    """
    systems = [rotor.at(k) for k in k_b]
    rows = [critical_speeds(system, n + _SPARE) for system in systems]
    n = min(n, *(len(row.spin_speed) for row in rows))
    columns = follow(systems[0].M, [row.shape for row in rows], 0, n)
    pairs = list(zip(rows, columns, strict=True))
    return CriticalSpeedMap(
        np.asarray(k_b, dtype=float),
        np.array([row.spin_speed[c] for row, c in pairs]),
        np.array([row.direction[c] for row, c in pairs]),
    )


@dataclass(frozen=True)
class TableReading:
    """Where the direct stiffness of a support that follows the spin speed meets a line of the map."""

    node: int  # of the support
    plane: int  # 1: k_yy, 2: k_zz
    whirl: int  # column of the map, from 0
    spin_speed: float  # [rad/s]
    k_b: float  # [N/m]


def table_readings(rotor: BearingRange, speeds: CriticalSpeedMap) -> list[TableReading]:
    """The undamped critical speeds of a rotor on supports that follow the spin speed, as their maker reads them.

    Each direct stiffness, k_yy and k_zz of every table, is taken as if all supports had it, in both planes and without
    cross-coupling. Where it meets a line of the map, the rotor on bearings of that stiffness has its critical speed at
    the speed at which the table has that stiffness.

    Parameters
    ----------
    rotor : that of the map
    speeds : of ``critical_speed_map``
    """
    found = []
    for table, plane in ((t, p) for t in rotor.structure.speed_tables for p in (0, 1)):
        own = table.stiffness[:, plane, plane]
        for whirl, line in enumerate(speeds.spin_speed.T):
            over = np.interp(line, table.spin_speed, own, left=np.nan, right=np.nan) - speeds.k_b  # (n_k,)
            for row in np.flatnonzero(over[:-1] * over[1:] < 0).tolist():
                piece = _Piece(rotor, speeds.k_b[row : row + 2], line[row : row + 2], speeds.spin_speed.shape[1])
                k_b, Omega = piece.meets(table.spin_speed, own)
                found.append(TableReading(table.node, plane + 1, whirl, Omega, k_b))
    return sorted(found, key=lambda reading: (reading.node, reading.plane, reading.spin_speed))


@dataclass(frozen=True)
class _Piece:
    """A line of the map between two stiffnesses."""

    rotor: BearingRange
    k_b: FloatArray  # (2,) [N/m]
    spin_speed: FloatArray  # (2,) [rad/s]
    n: int  # lines of the map

    def at(self, k_b: float) -> float:
        """The critical speed [rad/s] at a stiffness in between: the one closest to the straight line."""
        guess = np.exp(np.interp(np.log(k_b), np.log(self.k_b), np.log(self.spin_speed)))
        every = critical_speeds(self.rotor.at(k_b), self.n + _SPARE).spin_speed
        return float(every[np.argmin(np.abs(every - guess))])

    def meets(self, spin_speed: FloatArray, stiffness: FloatArray) -> tuple[float, float]:
        """Stiffness [N/m] and speed [rad/s] where it meets a stiffness over speed, both (n_rows,)."""
        from scipy.optimize import brentq  # as in ``stiffness_readings``

        def off(k_b: float) -> float:
            return float(np.interp(self.at(k_b), spin_speed, stiffness)) - k_b

        k_b = float(brentq(off, *self.k_b.tolist()))  # type: ignore[arg-type]
        return k_b, self.at(k_b)


def natural_frequency_map(rotor: BearingRange, k_b: FloatArray, plane: int = 1) -> FloatArray:
    """(n_k, n_modes) natural frequencies [Hz] of the standing rotor in one plane, over k_b (n_k,) [N/m]."""
    rows = [elastic_frequencies_hz(rotor.at(k), plane) for k in k_b]
    n = min(len(row) for row in rows)
    return np.array([row[:n] for row in rows])


def stiffness_readings(rotor: BearingRange, k_b: FloatArray, frequency_hz: float, plane: int = 1) -> list[Reading]:
    """Every bearing stiffness at which a mode of the standing rotor has this frequency, by mode.

    A frequency never falls with the stiffness, so that a mode has it once at most.

    Parameters
    ----------
    k_b : (n_k,) stiffnesses between which one is looked for [N/m], ascending
    frequency_hz : measured [Hz]
    """
    from scipy.optimize import brentq  # takes longer to import than modes take to compute

    found = natural_frequency_map(rotor, k_b[[0, -1]], plane)  # (2, n_modes)
    modes = np.flatnonzero((found[0] < frequency_hz) & (frequency_hz < found[1]))

    def off(log_k_b: float, mode: int) -> float:
        return float(elastic_frequencies_hz(rotor.at(np.exp(log_k_b)), plane)[mode] - frequency_hz)

    ends = np.log(k_b[0]), np.log(k_b[-1])
    return [Reading(int(mode) + 1, float(np.exp(brentq(off, *ends, args=(mode,))))) for mode in modes]  # type: ignore[arg-type]
