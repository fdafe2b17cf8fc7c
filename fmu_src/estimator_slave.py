"""StiffnessEstimator: the network as a co-simulation slave."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.estimator.runtime import StiffnessEstimator as Network
from rigtwin.fmu_src.estimator_variables import (
    ESTIMATOR_MEANING,
    ESTIMATOR_STEP,
    ESTIMATOR_TOLERANCE,
    estimator_variables,
)
from rigtwin.fmu_src.slave import TableSlave

# A reset makes a new instance, and loading the network into each would pile up memory.
_network = lru_cache(maxsize=1)(Network)


class StiffnessEstimator(TableSlave):
    """Frequency shifts and amplitude ratio in, bearing stiffness with its interval out."""

    def __init__(self, **kwargs: Any):
        self._network = _network(Path(kwargs["resources"]) / "estimator.onnx")
        super().__init__(
            estimator_variables(self._network.card["example_inputs"]),
            description=ESTIMATOR_MEANING,
            step_size=ESTIMATOR_STEP,
            tolerance=ESTIMATOR_TOLERANCE,
            **kwargs,
        )
        self._inputs = [v.name for v in self._table if v.causality == "input"]

    def advance(self, time: float, h: float) -> None:
        """Nothing to integrate: the outputs follow the inputs at once."""

    def compute_outputs(self) -> list[float | bool]:
        """k_b, its standard deviation, its interval, and whether to believe them."""
        estimate = self._network.estimate(np.array([self.value(name) for name in self._inputs]))
        return [estimate.k_b, estimate.k_b_std, estimate.k_b_low, estimate.k_b_high, estimate.valid]
