"""The variables of ``StiffnessTracker.fmu``, and those that it shares with ``GapMonitor.fmu``."""

from __future__ import annotations

from dataclasses import dataclass

from rigtwin.fmu_src.variables import Variable

TRACKER_MEANING = "Bearing stiffness that changes while the machine runs, from the force and node accelerations"
TRACKER_TOLERANCE = 1e-6  # of its outputs
TRACKER_NETWORK = "tracker.onnx"  # among the resources of an FMU whose rig a network knows

# What ``method`` can be, and why it is refused.
NETWORK, KALMAN_FILTER = 1, 2
_METHODS = "2 = extended Kalman filter; 1 = network, less exact, where one knows the rig"
NO_NETWORK = (
    "method 1, a network, is not there: no network knows this rig and these nodes; train one (rigtwin train --tracker) "
    "and build the tracker with it (rigtwin build --tracker-network), or set method to 2"
)
OTHER_NODE = "the network of method 1 was trained with another excitation_node; set that one, or method to 2"


@dataclass(frozen=True)
class TrackerFacts:
    """What the variable tables of tracker and monitor need to know of its rig."""

    nodes: tuple[int, ...]  # whose accelerations are read
    n_nodes: int
    excitation_node: int
    k_b_start: float
    k_b_min: float
    k_b_max: float
    bearing_damping: float
    shaft_damping_ratio: float
    step: float  # of the default experiment [s]


def tracker_variables(facts: TrackerFacts) -> tuple[Variable, ...]:
    """Variables of ``StiffnessTracker.fmu`` for a rig with these numbers."""
    parameters = (
        whole("method", _METHODS, KALMAN_FILTER, 1, 2),
        number("k_b_start", "Radial stiffness of each bearing that is believed at the start", "N/m", facts.k_b_start,
               facts.k_b_min, facts.k_b_max),
        number("k_b_start_std", "Its standard error, of the logarithm", "1", 0.3, 0.01, 2.0),
        number("k_b_change", "Standard deviation of the change of ln k_b in a second", "1", 0.04, 0.0, 10.0),
        *about_the_machine(facts),
    )  # fmt: skip
    outputs = (
        ("k_b", "Radial stiffness of each bearing"),
        ("k_b_low", "Lower end of the 90 % interval of k_b"),
        ("k_b_high", "Upper end of the 90 % interval of k_b"),
    )
    at_start = ("k_b_start", "k_b_start_std")
    return (
        *readings(facts),
        *parameters,
        *(Variable(name, "output", text, "N/m", initially_depends_on=at_start) for name, text in outputs),
        Variable("valid", "output", "False while k_b is not known: do not use it then", boolean=True),
    )


def readings(facts: TrackerFacts) -> tuple[Variable, ...]:
    """What is measured of the machine: the force, and accelerations."""
    read = tuple(f"node_{node}.acceleration_y" for node in facts.nodes)
    return (
        Variable("force", "input", "Force on the rotor at this instant", "N", 0.0, -1e9, 1e9),
        *(
            Variable(name, "input", f"Measured acceleration of node {node} in y", "m/s2", 0.0, -1e9, 1e9)
            for name, node in zip(read, facts.nodes, strict=True)
        ),
    )


def about_the_machine(facts: TrackerFacts) -> tuple[Variable, ...]:
    """Parameters that say what is believed of the machine, apart from k_b."""
    return (
        whole("excitation_node", "Node the force acts on", facts.excitation_node, 1, facts.n_nodes),
        number("disk_mass_std", "Relative standard error of the disks' masses; 0: known", "1", 0.01, 0.0, 0.3),
        number("bearing_damping", "Viscous damping of each bearing that is believed", "N.s/m", facts.bearing_damping,
               1e-6, 1e9),
        number("bearing_damping_std", "Its standard error, of the logarithm; 0: known", "1", 0.7, 0.0, 2.0),
        number("shaft_damping_ratio", "Damping ratio of the shaft's bending that is believed", "1",
               facts.shaft_damping_ratio, 1e-8, 0.2),
        number("shaft_damping_std", "Its standard error, of the logarithm; 0: known", "1", 0.7, 0.0, 2.0),
        number("gain_std", "Relative standard error of the gain, force over sensors; 0: known", "1", 0.02, 0.0, 0.3),
        number("acceleration_std", "Standard error of an acceleration; 0: 2 % of the rms", "m/s2", 0.0, 0.0, 1e9),
    )  # fmt: skip


def number(name: str, text: str, unit: str, start: float, least: float, most: float) -> Variable:
    """A parameter."""
    return Variable(name, "parameter", text, unit, start, least, most, "fixed")


def whole(name: str, text: str, start: int, least: int, most: int) -> Variable:
    """A parameter that is a whole number."""
    return Variable(name, "parameter", text, None, start, least, most, "fixed")
