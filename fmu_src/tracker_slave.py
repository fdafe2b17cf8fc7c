"""StiffnessTracker: the Kalman filter of the reduced rotor as a co-simulation slave."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.estimator.tracking.reduced_rotor import from_arrays
from rigtwin.estimator.tracking.tracker import Belief
from rigtwin.estimator.tracking.tracker import StiffnessTracker as Tracker
from rigtwin.fmu_src.slave import TableSlave, read_manifest
from rigtwin.fmu_src.tracker_variables import (
    KALMAN_FILTER,
    NO_NETWORK,
    TRACKER_MEANING,
    TRACKER_TOLERANCE,
    TrackerFacts,
    tracker_variables,
)
from rigtwin.fmu_src.variables import Variable


class StiffnessTracker(TableSlave):
    """Force and accelerations in, instant by instant; bearing stiffness with its interval out."""

    def __init__(self, **kwargs: Any):
        resources = Path(kwargs["resources"])
        with np.load(resources / "reduced.npz", allow_pickle=False) as arrays:
            self._rotor = from_arrays(arrays)
        facts = TrackerFacts(**read_manifest(resources)["facts"])
        super().__init__(
            tracker_variables(facts),
            description=TRACKER_MEANING,
            step_size=facts.step,
            tolerance=TRACKER_TOLERANCE,
            **kwargs,
        )
        self._nodes = tuple(facts.nodes)
        self._inputs = [v.name for v in self._table if v.causality == "input"]
        self._tracker = Tracker(self._rotor, self._nodes, self._belief())

    def accept_settings(self, changed: Sequence[Variable]) -> None:
        """Begin with another belief, which is only possible before the simulation."""
        if self.value("method") != KALMAN_FILTER:
            self.refuse(NO_NETWORK)
        if any(v.causality == "parameter" for v in changed):
            self._tracker = Tracker(self._rotor, self._nodes, self._belief())

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
        """Go back; the variables' values have been restored already."""
        self._tracker.restore(self._belief(), state)

    def _belief(self) -> Belief:
        return Belief(
            k_b=self.value("k_b_start"),
            bearing_damping=self.value("bearing_damping"),
            shaft_damping_ratio=self.value("shaft_damping_ratio"),
            k_b_std=self.value("k_b_start_std"),
            disk_mass_std=self.value("disk_mass_std"),
            bearing_damping_std=self.value("bearing_damping_std"),
            shaft_damping_std=self.value("shaft_damping_std"),
            gain_std=self.value("gain_std"),
            walk=self.value("k_b_change"),
            acceleration_std=self.value("acceleration_std"),
            driven_node=self.value("excitation_node"),
        )
