"""StiffnessTracker: the Kalman filter of the reduced rotor, or a network, as a co-simulation slave."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.estimator.tracking.network import NetworkTracker, TrackerNetwork
from rigtwin.estimator.tracking.tracker import Belief
from rigtwin.estimator.tracking.tracker import StiffnessTracker as Tracker
from rigtwin.fmu_src.listening_slave import ListeningSlave
from rigtwin.fmu_src.tracker_variables import (
    KALMAN_FILTER,
    NO_NETWORK,
    OTHER_NODE,
    TRACKER_MEANING,
    TRACKER_NETWORK,
    tracker_variables,
)
from rigtwin.fmu_src.variables import Variable

# A reset makes a new instance, and loading the network into each would pile up memory.
_network = lru_cache(maxsize=1)(TrackerNetwork)


class StiffnessTracker(ListeningSlave):
    """Force and accelerations in, instant by instant; bearing stiffness with its interval out."""

    def __init__(self, **kwargs: Any):
        super().__init__(tracker_variables, TRACKER_MEANING, **kwargs)
        self._model = Path(kwargs["resources"]) / TRACKER_NETWORK
        self._tracker = self._begun()

    def accept_settings(self, changed: Sequence[Variable]) -> None:
        """Begin with another belief, which is only possible before the simulation."""
        if self.value("method") != KALMAN_FILTER:
            if not self._model.is_file():
                self.refuse(NO_NETWORK)
            if self.value("excitation_node") != _network(self._model).card["excitation_node"]:
                self.refuse(OTHER_NODE)
        if any(v.causality == "parameter" for v in changed):
            self._tracker = self._begun()

    def advance(self, time: float, h: float) -> None:
        """Take up the inputs as they stood during this step."""
        force, *accelerations = (self.value(name) for name in self._inputs)
        self._tracker.step(h, force, np.array(accelerations))

    def compute_outputs(self) -> list[float | bool]:
        """k_b, its interval, and whether to believe them."""
        tracked = self._tracker.tracked
        return [tracked.k_b, tracked.k_b_low, tracked.k_b_high, tracked.valid]

    def save_state(self) -> Any:
        """All that the tracker remembers."""
        return self._tracker.save()

    def load_state(self, state: Any) -> None:
        """Go back; the variables' values have been restored already, method among them."""
        tracker = self._begun()
        tracker.restore(self._belief(), state)
        self._tracker = tracker

    def _begun(self) -> Any:
        """What ``method`` says, with nothing heard yet."""
        belief = self._belief()
        if self.value("method") == KALMAN_FILTER:
            return Tracker(self._rotor, self._nodes, belief)
        return NetworkTracker(_network(self._model), belief)

    def _belief(self) -> Belief:
        return self._believed(k_b="k_b_start", k_b_std="k_b_start_std", walk=self.value("k_b_change"))
