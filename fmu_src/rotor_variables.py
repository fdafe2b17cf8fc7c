"""The variables of ``RotorRig.fmu``, those of the effects derived from the effects themselves."""

from __future__ import annotations

from dataclasses import dataclass, fields

from rigtwin.fmu_src.variables import ArrayOutput, Variable
from rigtwin.rotor.effects.effect import SWITCH, Effect, Parameter
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.model.condition import MOST_BEARING_DAMPING

ROTOR_MEANING = "Finite-element rotor on its bearings: sine force in, node accelerations out"

# Switch by which the input ``force`` is held over a step.
HELD_FORCE = "held_force.enabled"
_NOT_YET = "; 0: the start value, for masters that set inputs before anything has an output"
_HELD = "Switch on: force is a staircase, held over each communication step; otherwise it is continued smoothly"


@dataclass(frozen=True)
class RotorFacts:
    """What the rotor's variable table needs to know of its rig."""

    n_nodes: int
    excitation_node: int
    shaft_damping_ratio: float
    bearing_damping: float
    k_b_start: float
    k_b_min: float
    k_b_max: float
    length: float  # of the shaft [m]
    step: float = 2e-5  # that the FMU recommends [s]
    spin_speed_start: float = 0.0
    spin_speed_min: float = -1e5
    spin_speed_max: float = 1e5
    k_b_input: bool = False  # whether k_b is an input, so that other FMUs can be connected to it


def rotor_variables(rig: RotorFacts) -> tuple[Variable, ...]:
    """Variables of ``RotorRig.fmu`` for a rig with these numbers."""
    inputs = (
        Variable(
            "force",
            "input",
            "Force at the excitation node; continued smoothly between communication points",
            "N",
            0.0,
            -1e9,
            1e9,
        ),
        Variable("force_amplitude", "input", "Amplitude (peak) of the built-in sine force", "N", 0.0, 0.0, 1e9),
        Variable(
            "force_frequency",
            "input",
            "Frequency of the built-in sine force; its phase stays continuous when this changes, and stands still at 0",
            "Hz",
            100.0,
            0.0,
            1e6,
        ),
        Variable(
            "spin_speed",
            "input",
            "Spin speed about +x",
            "rad/s",
            rig.spin_speed_start,
            rig.spin_speed_min,
            rig.spin_speed_max,
        ),
    )
    parameters = (
        Variable(
            "k_b",
            "input" if rig.k_b_input else "parameter",
            "Radial stiffness of each bearing, in y and z" + (_NOT_YET if rig.k_b_input else ""),
            "N/m",
            rig.k_b_start,
            0.0 if rig.k_b_input else rig.k_b_min,
            rig.k_b_max,
            None if rig.k_b_input else "tunable",
        ),
        Variable(
            "bearing_damping",
            "parameter",
            "Viscous damping of each bearing, beside k_b",
            "N.s/m",
            rig.bearing_damping,
            0.0,
            MOST_BEARING_DAMPING,
            "tunable",
        ),
        Variable(
            "shaft_damping_ratio",
            "parameter",
            "Damping ratio of the shaft's bending",
            "1",
            rig.shaft_damping_ratio,
            0.0,
            0.2,
            "tunable",
        ),
        Variable("rigid_support", "parameter", "True: the bearings are pinned, k_b has no effect", start=False),
        Variable(
            "excitation_node", "parameter", "Node the force acts on", None, rig.excitation_node, 1, rig.n_nodes, "fixed"
        ),
        Variable("excitation_plane", "parameter", "Plane the force acts in: 1 = y, 2 = z", None, 1, 1, 2, "fixed"),
    )
    effects = (*effect_variables(rig), Variable(HELD_FORCE, "parameter", _HELD, start=False))
    at_once = ("force_amplitude", "spin_speed", *(("k_b",) if rig.k_b_input else ()))
    at_rest = ("force", "spin_speed", "rigid_support", "excitation_node", "excitation_plane", *_acting_at_once())
    accelerations = tuple(
        Variable(
            f"node_{node}.acceleration_{plane}",
            "output",
            f"Acceleration of node {node} in {plane}",
            "m/s2",
            depends_on=at_once,
            initially_depends_on=at_rest,
        )
        for plane in "yz"
        for node in range(1, rig.n_nodes + 1)
    )
    force_applied = Variable(
        "force_applied",
        "output",
        "Force on the rotor at this instant: that of the input plus the built-in sine; the phase reference",
        "N",
        depends_on=("force_amplitude",),
        initially_depends_on=("force",),
    )
    return (*inputs, *parameters, *effects, *accelerations, force_applied)


def accelerations_array(rig: RotorFacts) -> ArrayOutput:
    """All accelerations once more as one output of FMI 3.0."""
    meaning = "Accelerations of all nodes: those in y, then those in z"
    return ArrayOutput("accelerations", meaning, "m/s2", "node_1.acceleration_y", (2, rig.n_nodes))


def effects_in_fmu() -> tuple[type[Effect], ...]:
    """Effects that the rotor FMU can switch on."""
    return tuple(effect for effect in EFFECTS.values() if effect.in_fmu)


def effect_variables(rig: RotorFacts) -> tuple[Variable, ...]:
    """``<id>.enabled`` and ``<id>.<parameter>`` of every effect in the FMU."""
    table: list[Variable] = []
    for effect in effects_in_fmu():
        switch = f"Switch the effect on: {effect.meaning}"
        variability = "fixed" if effect.changes_size else "tunable"
        table.append(Variable(effect.full_name(SWITCH), "parameter", switch, start=False, variability=variability))
        table += [_effect_parameter(effect, f.name, getattr(effect, f.name), rig) for f in fields(effect)]
    return tuple(table)


def _acting_at_once() -> tuple[str, ...]:
    """Variables of effects that change the accelerations of a rotor at rest."""
    effects = [effect for effect in effects_in_fmu() if effect.acts_at_once]
    return tuple(effect.full_name(name) for effect in effects for name in (SWITCH, *effect.roles()))


def _effect_parameter(effect: type[Effect], name: str, start: float, rig: RotorFacts) -> Variable:
    role, full_name = effect.roles()[name], effect.full_name(name)
    if isinstance(role, Parameter):
        limits = role.minimum, role.maximum
        variability = "fixed" if role.form and effect.changes_size else "tunable"
        return Variable(full_name, "parameter", role.meaning, role.unit, start, *limits, variability)
    if role.kind == "position":
        start = min(start, rig.length / 2)
        return Variable(full_name, "parameter", role.meaning, "m", start, 0.0, rig.length, "tunable")
    start, least = min(int(start), rig.n_nodes), role.first
    return Variable(full_name, "parameter", role.meaning, None, start, least, rig.n_nodes, "tunable")
