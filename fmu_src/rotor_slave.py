"""RotorRig: the rotor as a co-simulation slave."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from fmu_src.slave import TableSlave, read_manifest
from fmu_src.variables import RotorFacts, rotor_variables
from rotor.simulator import RotorSimulator, Settings
from rotor.structure import from_arrays

_SETTINGS = tuple(f.name for f in fields(Settings))
_FORCE = ("force", "force_amplitude", "force_frequency")


class RotorRig(TableSlave):
    """Finite-element rotor: sine or signal force in, node accelerations out."""

    def __init__(self, **kwargs: Any):
        resources = Path(kwargs["resources"])
        with np.load(resources / "structure.npz", allow_pickle=False) as arrays:
            structure = from_arrays(arrays)
        facts = RotorFacts(**read_manifest(resources)["facts"])
        super().__init__(
            rotor_variables(facts),
            description="Finite-element rotor on its bearings: sine force in, node accelerations out",
            step_size=1e-4,
            **kwargs,
        )
        self._simulator = RotorSimulator(structure)
        self.accept_settings()

    def accept_settings(self) -> None:
        """Hand everything to the rotor; it rebuilds its equations only where they changed."""
        self._simulator.configure(Settings(**{name: self.value(name) for name in _SETTINGS}))
        self._simulator.drive(**{name: self.value(name) for name in _FORCE})

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Set the clock."""
        self._simulator.start_at(start_time)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Integrate over one communication step of any length."""
        self._simulator.advance(current_time, step_size)
        self._stale = True
        return True

    def compute_outputs(self) -> list[float]:
        """Accelerations in y, in z, and the force."""
        return [*self._simulator.accelerations().tolist(), self._simulator.force_applied]

    def save_state(self) -> Any:
        """The rotor's own snapshot."""
        return self._simulator.snapshot()

    def load_state(self, state: Any) -> None:
        """Go back to a snapshot."""
        self._simulator.restore(state)
