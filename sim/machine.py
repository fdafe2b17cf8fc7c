"""A machine that runs: the system of rotor, softening bearing, tracker and supervisor, simulated by fmpy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from types import SimpleNamespace
from typing import Any

import numpy as np
from fmpy import extract
from fmpy.ssp.simulation import do_step, free_fmu, get_value, instantiate_fmu
from fmpy.ssp.ssd import find_components, get_connections, read_ssd

from rigtwin.rotor.model.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class MachineRun:
    """What a machine did, window after window: values at each end, and the vibration's rms within."""

    time: FloatArray  # (n,) [s]
    k_b: FloatArray  # the bearing's own [N/m]
    tracked: FloatArray  # the tracker's
    low: FloatArray  # its 90 % interval
    high: FloatArray
    valid: BoolArray
    speed: FloatArray  # [rad/s]
    resonance: FloatArray  # nearest to it for the last k_b that was valid [rad/s]; 0: none was
    vibration: FloatArray  # rms of the acceleration that the tracker reads [m/s^2]


_WATCHED = (
    ("bearing", "k_b"), ("tracker", "k_b"), ("tracker", "k_b_low"), ("tracker", "k_b_high"), ("tracker", "valid"),
    ("supervisor", "speed"), ("supervisor", "resonance"),
)  # fmt: skip


@dataclass(frozen=True)
class MachinePlan:
    """How a machine is run."""

    stop: float  # [s]
    step: float  # [s]
    window: float  # over which vibration is averaged [s]
    supervise: bool = True


def run_machine(system: Path, plan: MachinePlan, progress: Callable[[int], None] | None = None) -> MachineRun:
    """Simulate ``SoftenedMachine.ssp``, of FMUs for FMI 2.0. Each steps with the outputs of the step before.

    Parameters
    ----------
    system : path of the .ssp file
    plan : how it is run
    progress : called with the hundredths that are done
    """
    steps = round(plan.stop / plan.step)
    told = np.empty((steps, len(_WATCHED) + 1))
    with _instances(system, plan) as (components, connections):
        by_name = {component.name: component for component in components}
        (read,) = (c.name for c in by_name["rotor"].connectors if c.name.startswith("node_"))
        watched = [*((by_name[name], variable) for name, variable in _WATCHED), (by_name["rotor"], read)]
        for k in range(steps):
            for start, end in connections:
                end.value = start.value
            for component in components:
                do_step(component, k * plan.step, plan.step)
            told[k] = [get_value(component, name) for component, name in watched]
            if progress and 100 * k // steps != 100 * (k - 1) // steps:
                progress(100 * k // steps)
    length = round(plan.window / plan.step)
    n = steps // length
    ends, windows = told[length - 1 :: length][:n], told[: n * length, -1].reshape(n, length)
    return MachineRun(
        time=plan.step * length * np.arange(1, n + 1),
        k_b=ends[:, 0],
        tracked=ends[:, 1],
        low=ends[:, 2],
        high=ends[:, 3],
        valid=ends[:, 4] > 0,
        speed=ends[:, 5],
        resonance=ends[:, 6],
        vibration=np.sqrt(np.mean(windows**2, axis=1)),
    )


@contextmanager
def _instances(system: Path, plan: MachinePlan) -> Iterator[tuple[list[Any], list[Any]]]:
    """The system's components with an FMU instance each, outputs read, and its connections."""
    described = read_ssd(str(system))
    components, folder = find_components(described.system), extract(str(system))
    given = [SimpleNamespace(name="supervisor.supervise", value=plan.supervise)]
    started: list[Any] = []
    try:
        for component in components:
            instantiate_fmu(component, folder, 0.0, plan.stop, SimpleNamespace(parameters=given))
            started.append(component)
            for connector in component.connectors:
                connector.value = get_value(component, connector.name)
        yield components, get_connections(described.system)
    finally:
        for component in started:
            free_fmu(component)
        rmtree(folder, ignore_errors=True)
