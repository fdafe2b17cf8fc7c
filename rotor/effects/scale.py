"""The scale of a rig: its rotor's mass, its length, and the time scale of its vibration.

The range of every number of an effect is stated in these, so that it suits a spindle as well as a pump: masses over the
rotor's, stiffnesses over mass over time squared, and so on by the number's unit. Numbers that matter only in motions of
a certain size (``Parameter.amplitude``) reach as far as the forces of the runs do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.effects.effect import Parameter
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import work

# Powers of mass, length and time in a unit.
UNITS = {
    "1": (0, 0, 0),
    "rad": (0, 0, 0),
    "kg": (1, 0, 0),
    "kg.m": (1, 1, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "N": (1, 1, -2),
    "N/m": (1, 0, -2),
    "N.s/m": (1, 0, -1),
    "N.m/rad": (1, 2, -2),
    "N/m3": (1, -2, -2),
}

# From far softer to far stiffer than any shaft, over the rig's own unit of stiffness.
BEARINGS = (5.6e-3, 5.6e3)

# Share of a mode's strain energy in the shaft from which it counts as bending: in others soft supports give way.
BENT = 0.5

# Force of a test over the product of stiffness and length that ranges of amplitudes are stated for.
_USUAL_FORCE = 1.5e-6


def in_own_units(unit: str) -> str:
    """A unit in those of a rig: its mass m_r, its length l_r, its time t_r.

    >>> in_own_units("N/m"), in_own_units("1")
    ('m_r t_r^-2', '')
    """
    powers = zip(("m_r", "l_r", "t_r"), UNITS[unit], strict=True)
    return " ".join(name if power == 1 else f"{name}^{power}" for name, power in powers if power)


@dataclass(frozen=True)
class RigScale:
    """A rig's own units.

    >>> RigScale(mass=4.0, length=0.5, time=2.0).of("N/m")
    1.0
    """

    mass: float  # of the rotor [kg]
    length: float  # between the ends of the shaft [m]
    time: float  # one over the lowest frequency, on rigid supports, at which the shaft bends [s/rad]
    force: float = 0.0  # largest of the runs [N]; 0: not known

    def of(self, unit: str) -> float:
        """One of this rig's own units in SI; raises KeyError for a unit that is not in ``UNITS``."""
        mass, length, time = UNITS[unit]
        return float(self.mass**mass * self.length**length * self.time**time)

    @property
    def k_b(self) -> tuple[float, float]:
        """Range that the stiffness of bearings may be in [N/m]."""
        unit = self.of("N/m")
        return BEARINGS[0] * unit, BEARINGS[1] * unit

    def ends(self, role: Parameter) -> tuple[float, float]:
        """Range of a number for this rig, in SI."""
        unit = self.of(role.unit)
        low, high = role.low * unit, role.high * unit
        if role.amplitude and self.force:
            ratio = (self.force / self.of("N") / _USUAL_FORCE) ** role.amplitude
            low, high = low * min(1.0, ratio), high * max(1.0, ratio)
        return low, high


def scale_of(structure: Structure, force: float = 0.0) -> RigScale:
    """The scale of a rotor, and the largest force [N] that it was tested with."""
    system = build_system(structure, Condition(rigid_support=True, spin_speed=structure.lowest_spin_speed))
    Phi, omega = system.modes.Phi, system.modes.omega
    in_shaft = work(system.K_shaft, Phi) / np.maximum(omega, 1e-300) ** 2
    bending = omega[(in_shaft > BENT) & system.modes.elastic]
    along_y = np.arange(0, structure.n, 4)
    mass = float(np.sum(structure.M[np.ix_(along_y, along_y)]))
    length = float(structure.x[-1] - structure.x[0])
    return RigScale(mass, length, 1 / float(bending[0]), force)
