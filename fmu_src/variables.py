"""The variables of both FMUs: names, units, ranges, start values. Everything else is derived.

The model description, the checks of incoming values, the HTML documentation and the tables in
``docs/`` all read these tables.
"""

from __future__ import annotations

from dataclasses import dataclass, field

# FMI 2 unit definitions: exponents of the SI base units.
UNITS: dict[str, dict[str, int]] = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "N/m": {"kg": 1, "s": -2},
    "N.s/m": {"kg": 1, "s": -1},
    "Hz": {"s": -1},
    "rad/s": {"rad": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "1": {},
}


@dataclass(frozen=True)
class Variable:
    """One FMI variable. ``start`` decides the type: bool, int or float; outputs have none."""

    name: str
    causality: str  # "input", "parameter" or "output"
    description: str
    unit: str | None = None
    start: float | int | bool | None = None
    minimum: float | int | None = None
    maximum: float | int | None = None
    variability: str | None = None
    setting: str = ""  # name of the physics setting it drives, default its own name
    depends_on: tuple[str, ...] = ()  # inputs with a direct feedthrough to this output
    initially_depends_on: tuple[str, ...] = ()  # what its value at initialisation depends on
    boolean: bool = field(default=False)

    @property
    def kind(self) -> str:
        """FMI type: "Boolean", "Integer" or "Real"."""
        if self.boolean or isinstance(self.start, bool):
            return "Boolean"
        return "Integer" if isinstance(self.start, int) else "Real"

    def refusal(self, value: float) -> str | None:
        """Why this value cannot be set, as a sentence; None when it can."""
        unit = f" {self.unit}" if self.unit and self.unit != "1" else ""
        if value != value or value in (float("inf"), float("-inf")):
            return f"{self.name} must be a finite number, got {value}"
        if self.minimum is not None and value < self.minimum:
            return f"{self.name} must be at least {self.minimum:g}{unit}, got {value:g}"
        if self.maximum is not None and value > self.maximum:
            return f"{self.name} must be at most {self.maximum:g}{unit}, got {value:g}"
        return None


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


def rotor_variables(rig: RotorFacts) -> tuple[Variable, ...]:
    """Variables of ``RotorRig.fmu`` for a rig with these numbers."""
    inputs = (
        Variable("force", "input", "Force at the excitation node, held over a communication step", "N", 0.0),
        Variable("force_amplitude", "input", "Amplitude (peak) of the built-in sine force", "N", 0.0, 0.0),
        Variable(
            "force_frequency",
            "input",
            "Frequency of the built-in sine force; its phase stays continuous when this changes",
            "Hz",
            100.0,
            1e-3,
            1e6,
        ),
        Variable("spin_speed", "input", "Spin speed about +x", "rad/s", 0.0, -1e5, 1e5),
    )
    parameters = (
        Variable(
            "k_b",
            "parameter",
            "Radial stiffness of each bearing, in y and z",
            "N/m",
            rig.k_b_start,
            rig.k_b_min,
            rig.k_b_max,
            "tunable",
        ),
        Variable(
            "bearing_damping",
            "parameter",
            "Viscous damping of each bearing, beside k_b",
            "N.s/m",
            rig.bearing_damping,
            0.0,
            1e6,
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
    at_rest = ("force", "rigid_support", "excitation_node", "excitation_plane")
    accelerations = tuple(
        Variable(
            f"node_{node}.acceleration_{plane}",
            "output",
            f"Acceleration of node {node} in {plane}",
            "m/s2",
            depends_on=("force", "force_amplitude", "spin_speed"),
            initially_depends_on=at_rest,
        )
        for plane in "yz"
        for node in range(1, rig.n_nodes + 1)
    )
    force_applied = Variable(
        "force_applied",
        "output",
        "Force on the rotor at this instant: input plus built-in sine; the phase reference",
        "N",
        depends_on=("force", "force_amplitude"),
        initially_depends_on=("force",),
    )
    return (*inputs, *parameters, *accelerations, force_applied)


ESTIMATOR_FEATURES = ("delta_f1", "delta_f2", "amplitude_ratio")


def estimator_variables(starts: dict[str, float]) -> tuple[Variable, ...]:
    """Variables of ``StiffnessEstimator.fmu``; ``starts`` is a consistent set of measured values."""
    what = {
        "delta_f1": ("Shift of the first resonance, rigid minus bearing support", "Hz"),
        "delta_f2": ("Shift of the second resonance, rigid minus bearing support", "Hz"),
        "amplitude_ratio": ("A1/A0: first-mode resonance acceleration at node 2, bearing over rigid support", "1"),
    }
    values = tuple(Variable(name, "input", text, unit, starts[name]) for name, (text, unit) in what.items())
    errors = tuple(
        Variable(f"{name}_std", "input", f"Standard error of {name}", unit, starts[f"{name}_std"], 0.0)
        for name, (_, unit) in what.items()
    )
    every = tuple(v.name for v in (*values, *errors))
    outputs = (
        ("k_b", "Radial stiffness of each bearing"),
        ("k_b_std", "Standard deviation of k_b"),
        ("k_b_low", "Lower end of the 90 % interval of k_b"),
        ("k_b_high", "Upper end of the 90 % interval of k_b"),
    )
    return (
        *values,
        *errors,
        *(
            Variable(name, "output", text, "N/m", depends_on=every, initially_depends_on=every)
            for name, text in outputs
        ),
        Variable(
            "valid",
            "output",
            "False outside the training range or when the inputs contradict each other",
            depends_on=every,
            initially_depends_on=every,
            boolean=True,
        ),
    )
