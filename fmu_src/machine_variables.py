"""The variables of ``SofteningBearing.fmu`` and ``SpeedSupervisor.fmu``."""

from __future__ import annotations

from dataclasses import dataclass

from rigtwin.fmu_src.variables import Variable

BEARING_MEANING = "A bearing stiffness that falls, or rises, while the machine runs"
SUPERVISOR_MEANING = "Speed of a machine that keeps away from its resonances, wherever the bearing stiffness moves them"

# Periods of the first resonance: until k_b changes, in which it changes, in which the machine runs up, in all; and
# changes of k_b in one of them. A rotor makes its equations anew for each, and is struck by it like by a hammer.
_AT, _FOR, _RUN_UP, _ALL, _CHANGES = 500.0, 1200.0, 200.0, 2000.0, 20.0

# So many times as small is k_b at the end. Relative distance that is kept from a resonance.
_LOSS, _MARGIN = 5.0, 0.05


@dataclass(frozen=True)
class MachineFacts:
    """What the variable tables need to know of a rig."""

    k_b_start: float  # [N/m]
    k_b_min: float
    k_b_max: float
    period: float  # of the first resonance at first [s]
    speed: float  # that is wanted [rad/s]
    highest_speed: float  # [rad/s]
    unbalance: float  # [kg m]
    probe: float  # rms of the force that makes the machine tell its stiffness [N]
    step: float  # of the default experiment [s]

    @property
    def seconds(self) -> float:
        """Time in which the machine shows all that it can [s]."""
        return rounded(_ALL * self.period)


def rounded(value: float, digits: int = 3) -> float:
    """A start value that people read."""
    return float(f"{value:.{digits}g}")


def bearing_variables(facts: MachineFacts) -> tuple[Variable, ...]:
    """Variables of ``SofteningBearing.fmu``."""
    ends, low, high = (facts.k_b_start, facts.k_b_start / _LOSS), facts.k_b_min, facts.k_b_max
    return (
        _fixed("k_b_start", "Radial stiffness of each bearing at first", "N/m", ends[0], low, high),
        _fixed("k_b_end", "The same at last", "N/m", max(ends[1], low), low, high),
        _fixed("change_at", "When it begins to change", "s", rounded(_AT * facts.period), 0.0, 1e9),
        _fixed("change_for", "How long it changes, evenly in its logarithm; 0: at once", "s",
               rounded(_FOR * facts.period), 0.0, 1e9),
        _fixed("change_every", "Time between two of its small changes; 0: it changes in every step", "s",
               rounded(facts.period / _CHANGES, 1), 0.0, 1e9),
        Variable(
            "k_b",
            "output",
            "Radial stiffness of each bearing now",
            "N/m",
            initially_depends_on=("k_b_start", "k_b_end"),
        ),
    )  # fmt: skip


def supervisor_variables(facts: MachineFacts) -> tuple[Variable, ...]:
    """Variables of ``SpeedSupervisor.fmu``."""
    speed, most = facts.speed, facts.highest_speed
    return (
        Variable("k_b", "input", "Radial stiffness of each bearing, as a tracker says", "N/m", 0.0, 0.0, 1e30),
        Variable("valid", "input", "Whether it is to be believed; where not, the last one that was is", start=False),
        Variable("speed_wanted", "input", "Spin speed that the process asks for", "rad/s", speed, 0.0, most),
        Variable("supervise", "input", "False: run at the speed that is wanted, whatever resonates", start=True),
        _fixed("margin", "Relative distance that is kept from each resonance", "1", _MARGIN, 0.0, 0.5),
        _fixed("acceleration", "Change of the spin speed in a second, at most", "rad/s2",
               rounded(speed / (_RUN_UP * facts.period)), 0.0, 1e9),
        _fixed("unbalance_moment", "Mass times eccentricity of the unbalance", "kg.m", facts.unbalance, 0.0, 1e9),
        _fixed("probe", "Rms of the force of many frequencies beside it, 0: none", "N", facts.probe, 0.0, 1e9),
        Variable("force", "output", "Force on the rotor in y: of the unbalance, and the probe", "N",
                 initially_depends_on=("probe",)),
        Variable("speed", "output", "Spin speed; the machine starts at rest", "rad/s"),
        Variable("resonance", "output", "Resonance nearest to it for the k_b that is believed; 0: k_b is not known",
                 "rad/s"),
    )  # fmt: skip


def _fixed(name: str, text: str, unit: str, start: float, least: float, most: float) -> Variable:
    return Variable(name, "parameter", text, unit, start, least, most, "fixed")
