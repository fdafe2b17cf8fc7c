"""Effects of a spinning rotor."""

from __future__ import annotations

from dataclasses import dataclass

from rigtwin.rotor.effects.effect import Effect, node, parameter
from rigtwin.rotor.model.design import Design


@dataclass(frozen=True)
class Gyroscopic(Effect):
    """Spinning disks answer a tilt with a moment across it."""

    id = "gyroscopic"
    title = "Gyroscopic moments"
    meaning = "a spinning disk that tilts makes a moment about the other axis; the nominal disks have only mass"
    equation = r"D(\omega) \to D(\omega) + i\omega\,\Omega\, G_d, \qquad I_p = \gamma\, m_d D^2 / 8"
    signature = "with spin speed, the modes split into backward and forward whirl, and y and z are coupled"
    source = "nelson1980"
    location = "disks"
    family = "spinning"
    couples_planes = True

    factor: float = parameter(
        1.0, "1", "Share of the solid disk's polar inertia", 0.0, 1.5, null=0.0, minimum=0.0, maximum=10.0
    )

    def add_to(self, design: Design) -> None:
        """G at the disks' rotations; it acts with the spin speed."""
        design.gyroscopic_factor += self.factor


@dataclass(frozen=True)
class UnbalanceForce(Effect):
    """A mass off the axis."""

    id = "unbalance"
    title = "Unbalance"
    meaning = "a mass off the axis makes a rotating force that grows with the square of the spin speed"
    equation = r"f_y + i f_z = m e\,\Omega^2\, e^{i(\Omega t + \varphi)}"
    signature = "a line at the spin frequency, which is largest at the critical speeds"
    source = "friswell2010"
    location = "node"
    family = "spinning"
    acts_at_once = True
    turns_with_shaft = True
    moves_response = False

    moment: float = parameter(
        1e-5, "kg.m", "Unbalance m e", 5e-08, 0.0005, null=0.0, minimum=0.0, maximum=1e3, log=True
    )
    phase: float = parameter(
        0.0, "rad", "Angle from y towards z at a spin angle of zero", -3.142, 3.142, minimum=-6.3, maximum=6.3
    )
    node: int = node(3, "Node at which the unbalance sits")

    def add_to(self, design: Design) -> None:
        """A force that turns with the rotor."""
        design.structure.dof(self.node, 1)  # raises where there is no such node
        design.unbalances.append((self.node, self.moment, self.phase))


def unbalance_at(node: int, moment: float, phase: float) -> UnbalanceForce:
    """An unbalance at a node: moment m e [kg m], phase from y towards z [rad]; one rotor may have several."""
    return UnbalanceForce(moment=moment, phase=phase, node=node)
