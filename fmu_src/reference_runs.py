"""The runs whose results each FMU holds, computed without the FMU's own code: by the model in Python.

An importer that replays them knows that it drives the FMU as it is meant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.estimator.tracking.monitor import CAUSES, GapMonitor
from rigtwin.estimator.tracking.reduced_rotor import ReducedRotor
from rigtwin.estimator.tracking.tracker import Belief, StiffnessTracker
from rigtwin.fmu_src.beside import ReferenceRun, run_through
from rigtwin.fmu_src.estimator_variables import estimator_variables
from rigtwin.fmu_src.monitor_variables import WALK, monitor_variables
from rigtwin.fmu_src.rotor_variables import RotorFacts, rotor_variables
from rigtwin.fmu_src.tracker_variables import TrackerFacts, tracker_variables
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.time.simulator import RotorSimulator

# Of the rotor's run: steps, their length in recommended ones, and those that the pulse of the force takes.
_STEPS, _RECOMMENDED, _PULSE = 200, 20, 50

# The sine beside the pulse: amplitude [N], and periods in the whole run.
_AMPLITUDE, _PERIODS = 0.5, 6.5

# Of the estimator's run: steps of a second, and the relative growth of the first shift in each.
_ESTIMATES, _GROWTH = 10, 0.01

# Seconds of the tracker's run.
_TRACKED = 0.12


def rotor_run(structure: Structure, facts: RotorFacts) -> ReferenceRun:
    """A rotor at its start values under a pulse of the force and the built-in sine."""
    table = rotor_variables(facts)
    starts: dict[str, Any] = {v.name: v.start for v in table}
    rotor = RotorSimulator(structure, Condition(**{f.name: starts[f.name] for f in fields(Condition)}))
    step = _RECOMMENDED * facts.step
    number = np.arange(_STEPS + 1)
    pulse = np.where(number < _PULSE, np.sin(np.pi * number / _PULSE) ** 2, 0.0)
    ones = np.ones(_STEPS + 1)
    frequency = _PERIODS / (_STEPS * step)
    inputs = {"force": pulse, "force_amplitude": _AMPLITUDE * ones, "force_frequency": frequency * ones}

    def answer(time: float, h: float, values: dict[str, Any]) -> Sequence[float]:
        rotor.drive(**values)
        if h:
            rotor.advance(time, h)
        return [*rotor.accelerations().tolist(), rotor.force_applied]

    return run_through(step * number, inputs, _outputs(table), answer)


def estimator_run(model: Path) -> ReferenceRun:
    """An estimator whose first shift grows."""
    from rigtwin.estimator.runtime import StiffnessEstimator

    network = StiffnessEstimator(model)
    table = estimator_variables(network.card["example_inputs"])
    names = [v.name for v in table if v.causality == "input"]
    ones = np.ones(_ESTIMATES + 1)
    inputs = {v.name: float(v.start or 0.0) * ones for v in table if v.causality == "input"}
    inputs["delta_f1"] = inputs["delta_f1"] * (1.0 + _GROWTH * np.arange(_ESTIMATES + 1))

    def answer(_time: float, _h: float, values: dict[str, float]) -> Sequence[float]:
        estimate = network.estimate(np.array([values[name] for name in names]))
        return [estimate.k_b, estimate.k_b_std, estimate.k_b_low, estimate.k_b_high, float(estimate.valid)]

    return run_through(np.arange(_ESTIMATES + 1.0), inputs, _outputs(table), answer)


def tracker_run(rotor: ReducedRotor, facts: TrackerFacts) -> ReferenceRun:
    """A tracker that listens to its own rotor under noise: until it begins, and some values more."""
    table = tracker_variables(facts)
    starts = {v.name: float(v.start or 0.0) for v in table}
    tracker = StiffnessTracker(rotor, facts.nodes, _belief(starts["k_b_start"], starts, facts))
    inputs, names = _noise(facts)

    def answer(_time: float, h: float, values: dict[str, float]) -> Sequence[float]:
        if h:
            tracker.step(h, values["force"], np.array([values[name] for name in names]))
        tracked = tracker.tracked
        return [tracked.k_b, tracked.k_b_low, tracked.k_b_high, float(tracked.valid)]

    return run_through(facts.step * np.arange(len(inputs["force"])), inputs, _outputs(table), answer)


def monitor_run(rotor: ReducedRotor, facts: TrackerFacts) -> ReferenceRun:
    """A monitor that listens under noise."""
    table = monitor_variables(facts)
    starts = {v.name: float(v.start or 0.0) for v in table}
    monitor = GapMonitor(rotor, facts.nodes, replace(_belief(starts["k_b"], starts, facts), walk=WALK))
    inputs, names = _noise(facts)
    inputs["k_b"] = np.full(len(inputs["force"]), starts["k_b"])

    def answer(_time: float, h: float, values: dict[str, float]) -> Sequence[float]:
        if h:
            monitor.step(h, values["force"], np.array([values[name] for name in names]), values["k_b"])
        watched = monitor.watched
        return [watched.drift, float(watched.alarm), float(CAUSES.index(watched.cause)), watched.k_b]

    return run_through(facts.step * np.arange(len(inputs["force"])), inputs, _outputs(table), answer)


def _belief(k_b: float, starts: dict[str, float], facts: TrackerFacts) -> Belief:
    return Belief(k_b, starts["bearing_damping"], starts["shaft_damping_ratio"], driven_node=facts.excitation_node)


def _noise(facts: TrackerFacts) -> tuple[dict[str, Any], list[str]]:
    """Inputs, and names of the accelerations. What the rotor does does not matter: only the answers are compared."""
    force = np.random.default_rng(0).standard_normal(round(_TRACKED / facts.step) + 1)
    names = [f"node_{node}.acceleration_y" for node in facts.nodes]
    return {"force": force, **{name: np.roll(force, place + 1) for place, name in enumerate(names)}}, names


def _outputs(table: Sequence[Variable]) -> list[str]:
    return [v.name for v in table if v.causality == "output"]
