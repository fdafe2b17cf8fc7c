"""What the slaves of tracker and monitor share: the reduced rotor, its nodes, and what is believed of the machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.estimator.tracking.reduced_rotor import from_arrays
from rigtwin.estimator.tracking.tracker import Belief
from rigtwin.fmu_src.slave import TableSlave, read_manifest
from rigtwin.fmu_src.tracker_variables import TRACKER_TOLERANCE, TrackerFacts
from rigtwin.fmu_src.variables import Variable


class ListeningSlave(TableSlave):
    """A slave that listens to a running rotor, with these variables."""

    def __init__(self, variables: Callable[[TrackerFacts], tuple[Variable, ...]], meaning: str, **kwargs: Any):
        resources = Path(kwargs["resources"])
        with np.load(resources / "reduced.npz", allow_pickle=False) as arrays:
            self._rotor = from_arrays(arrays)
        facts = TrackerFacts(**read_manifest(resources)["facts"])
        super().__init__(
            variables(facts), description=meaning, step_size=facts.step, tolerance=TRACKER_TOLERANCE, **kwargs
        )
        self._nodes = tuple(facts.nodes)
        self._inputs = [v.name for v in self._table if v.causality == "input"]

    def _believed(self, *, k_b: str, k_b_std: str, walk: float) -> Belief:
        """What the parameters say of the machine; those of k_b by their names."""
        return Belief(
            k_b=self.value(k_b),
            bearing_damping=self.value("bearing_damping"),
            shaft_damping_ratio=self.value("shaft_damping_ratio"),
            k_b_std=self.value(k_b_std),
            disk_mass_std=self.value("disk_mass_std"),
            bearing_damping_std=self.value("bearing_damping_std"),
            shaft_damping_std=self.value("shaft_damping_std"),
            gain_std=self.value("gain_std"),
            walk=walk,
            acceleration_std=self.value("acceleration_std"),
            driven_node=self.value("excitation_node"),
        )
