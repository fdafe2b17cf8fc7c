"""An effect that nothing outside this file knows: what the library gains when somebody adds one."""

from __future__ import annotations

from dataclasses import dataclass

from rigtwin.rotor.effects.effect import Effect, parameter
from rigtwin.rotor.model.design import Design


@dataclass(frozen=True)
class DriveMass(Effect):
    """The exciter's drive rod moves with the shaft."""

    id = "drive_mass"
    title = "Mass at the exciter"
    meaning = "the exciter's drive rod moves with the shaft"
    equation = r"M \to M + m\, e_d e_d^{T}"
    signature = "lowers modes that move at the drive node"
    source = "ewins2000"
    location = "exciter"
    family = "structure"
    acts_at_once = True

    mass: float = parameter(0.2, "kg", "Mass of the drive rod", 0.1, 1.0, null=0.0, minimum=0.0, maximum=10.0)

    def add_to(self, design: Design) -> None:
        """M at the drive node, y and z."""
        design.masses.append((design.condition.excitation_node, self.mass, 0.0))


# The same in the C core, in ``add_bodies`` of rotor.c.
LINE_OF_C = "    add_mass(a, d->condition.excitation_node, d->drive_mass.mass, 0);\n"
