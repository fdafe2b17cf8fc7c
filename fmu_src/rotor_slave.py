"""RotorRig: the rotor as a co-simulation slave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.fmu_src.rotor_variables import HELD_FORCE, ROTOR_MEANING, RotorFacts, effects_in_fmu, rotor_variables
from rigtwin.fmu_src.slave import TableSlave, read_manifest
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.effects.effect import SWITCH, Effect
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import from_arrays
from rigtwin.rotor.time.nonlinear_stepper import FORCE_ERROR
from rigtwin.rotor.time.simulator import RotorSimulator

_CONDITION = tuple(f.name for f in fields(Condition))
_SINE = ("force_amplitude", "force_frequency")
_FORCE = ("force", *_SINE, HELD_FORCE)


class RotorRig(TableSlave):
    """Finite-element rotor: sine or signal force in, node accelerations out."""

    def __init__(self, **kwargs: Any):
        resources = Path(kwargs["resources"])
        with np.load(resources / "structure.npz", allow_pickle=False) as arrays:
            structure = from_arrays(arrays)
        manifest = read_manifest(resources)
        facts = RotorFacts(**manifest["facts"])
        self._k_b_start = facts.k_b_start
        super().__init__(
            rotor_variables(facts),
            description=f"{ROTOR_MEANING} (rig {manifest['rig']})",
            step_size=facts.step,
            tolerance=FORCE_ERROR,
            **kwargs,
        )
        self._simulator = RotorSimulator(structure, self._condition(), self._effects())
        self.accept_settings(self._table)

    def accept_settings(self, changed: Sequence[Variable]) -> None:
        """Hand everything to the rotor; it rebuilds its equations only where they changed."""
        if any(v.name not in _FORCE for v in changed):
            self._simulator.configure(self._condition(), self._effects())
        held = self.value(HELD_FORCE)
        self._simulator.drive(force=self.value("force"), hold_force=held, **{name: self.value(name) for name in _SINE})

    def start_at(self, time: float) -> None:
        """Set the clock."""
        self._simulator.start_at(time)

    def advance(self, time: float, h: float) -> None:
        """Integrate over one communication step."""
        self._simulator.advance(time, h)

    def compute_outputs(self) -> list[float]:
        """Accelerations in y, in z, and the force."""
        return [*self._simulator.accelerations().tolist(), self._simulator.force_applied]

    def save_state(self) -> Any:
        """The rotor's own snapshot."""
        return self._simulator.snapshot()

    def load_state(self, state: Any) -> None:
        """Go back to a snapshot; the variables' values have been restored already."""
        self._simulator.restore(state, self._condition(), self._effects())

    def _condition(self) -> Condition:
        given = {name: self.value(name) for name in _CONDITION}
        return Condition(**{**given, "k_b": given["k_b"] or self._k_b_start})

    def _effects(self) -> tuple[Effect, ...]:
        """The effects that are switched on, with their parameters."""
        return tuple(
            effect(**{name: self.value(effect.full_name(name)) for name in effect.roles()})
            for effect in effects_in_fmu()
            if self.value(effect.full_name(SWITCH))
        )
