"""The variables of ``GapMonitor.fmu``."""

from __future__ import annotations

from rigtwin.estimator.tracking.monitor import CAUSES, Watching
from rigtwin.fmu_src.tracker_variables import TrackerFacts, about_the_machine, number, readings
from rigtwin.fmu_src.variables import Variable

MONITOR_MEANING = "Whether a running rotor still does what its model says, and if not, what has changed"

# How fast k_b may drift while the monitor learns; standard deviation of the change of ln k_b in a second.
WALK = 0.0


def monitor_variables(facts: TrackerFacts) -> tuple[Variable, ...]:
    """Variables of ``GapMonitor.fmu`` for a rig with these numbers."""
    believed = "Radial stiffness of each bearing that is believed"
    watching = Watching()
    return (
        *readings(facts),
        Variable("k_b", "input", believed, "N/m", facts.k_b_start, facts.k_b_min, facts.k_b_max),
        *about_the_machine(facts),
        number("k_b_std", "Its standard error at the start, of the logarithm", "1", 0.3, 0.01, 2.0),
        number("learning_time", "Time for which it listens before it watches", "s", watching.learning, 0.1, 1e6),
        number("alarm_every", "Communication steps in the mean between two false alarms, at least", "1",
               watching.alarm_every, 1e3, 1e100),
        Variable("drift", "output", "Decimal logarithm of the evidence for a change; an alarm from that of alarm_every",
                 "1"),
        Variable("alarm", "output", "Something has changed", boolean=True),
        Variable("cause", "output", "What has changed", labels=CAUSES),
        Variable("k_b_found", "output", "Radial stiffness of each bearing that was found", "N/m",
                 initially_depends_on=("k_b",)),
    )  # fmt: skip
