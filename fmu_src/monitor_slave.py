"""GapMonitor: the monitor of the reduced rotor as a co-simulation slave."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rigtwin.estimator.tracking.monitor import CAUSES, Watching
from rigtwin.estimator.tracking.monitor import GapMonitor as Monitor
from rigtwin.estimator.tracking.tracker import Belief
from rigtwin.fmu_src.listening_slave import ListeningSlave
from rigtwin.fmu_src.monitor_variables import MONITOR_MEANING, WALK, monitor_variables
from rigtwin.fmu_src.variables import Variable


class GapMonitor(ListeningSlave):
    """Force, accelerations and believed k_b in, instant by instant; what has changed out."""

    def __init__(self, **kwargs: Any):
        super().__init__(monitor_variables, MONITOR_MEANING, **kwargs)
        self._monitor = self._new()

    def accept_settings(self, changed: Sequence[Variable]) -> None:
        """Begin with another belief, which is only possible before the simulation."""
        if any(v.causality == "parameter" for v in changed):
            self._monitor = self._new()

    def advance(self, time: float, h: float) -> None:
        """Take up the inputs as they stood during this step."""
        force, *accelerations, k_b = (self.value(name) for name in self._inputs)
        self._monitor.step(h, force, np.array(accelerations), k_b)

    def compute_outputs(self) -> list[float | bool | int]:
        """Evidence, whether it is an alarm, what has changed, and k_b."""
        watched, begun = self._monitor.watched, self._monitor.has_begun
        k_b = watched.k_b if begun else self.value("k_b")
        return [watched.drift, watched.alarm, CAUSES.index(watched.cause), k_b]

    def save_state(self) -> Any:
        """All that the monitor remembers."""
        return self._monitor.save()

    def load_state(self, state: Any) -> None:
        """Go back; the variables' values have been restored already."""
        monitor = self._new()
        monitor.restore(self._belief(), state)
        self._monitor = monitor

    def _new(self) -> Monitor:
        return Monitor(self._rotor, self._nodes, self._belief(), self._watching())

    def _watching(self) -> Watching:
        return Watching(alarm_every=self.value("alarm_every"), learning=self.value("learning_time"))

    def _belief(self) -> Belief:
        return self._believed(k_b="k_b", k_b_std="k_b_std", walk=WALK)
