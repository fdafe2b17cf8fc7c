"""One system of all FMUs in other people's importers: ``python -m tests.fmu.native.hosts`` prints how far they differ.

A rotor is driven by its own sine. Its force drives a second rotor and stands for a shift at the estimator; its force
and the motion of node 2 go to the tracker and to the monitor. So all FMUs have something to do in every step. What each
host logs is compared with the same calls made one by one by fmpy.
"""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fmpy import read_model_description, simulate_fmu

from examples.in_ecos import ecos
from rigtwin.fmu_src.build import (
    MONITOR,
    TRACKER,
    build_native_estimator_fmu,
    build_native_listener_fmu,
    build_native_rotor_fmu,
)
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.fmu_src.ssp import START_VALUES, Component, Link, write_system
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.session import FmuSession

STEP, STEPS = 2e-4, 8000  # [s]; the tracker's filters begin after 0.1 s, the monitor bets after 1 s
STOP = STEP * STEPS
EVIDENCE = "monitor.drift"
ESTIMATE = "estimator.k_b"  # of a network in single precision: its last digit may turn
SENSOR = "node_2.acceleration_y"
KNOWN = {f"{name}_std": 0.0 for name in ("disk_mass", "bearing_damping", "shaft_damping", "gain")}
# A log with six decimals is good to 1e-9 where the motion is some thousand m/s2.
SINE = {"k_b": 3e6, "force_amplitude": 1e4, "force_frequency": 61.7}

Series = dict[str, np.ndarray]  # (steps,) of each watched variable, as "component.variable"


@dataclass(frozen=True)
class Plan:
    """What is simulated."""

    components: tuple[Component, ...]
    links: tuple[Link, ...]
    watched: tuple[tuple[str, str], ...]  # component and variable


def build(folder: Path, fmi: str) -> Plan:
    """The system with FMUs of one version of FMI, for this machine."""
    rig, options = load_rig("nit-rourkela"), {"fmi": fmi, "targets": [this_machine()]}
    rotor = build_native_rotor_fmu(rig, folder, **options)
    listeners = [build_native_listener_fmu(kind, rig, folder, **options) for kind in (TRACKER, MONITOR)]
    return plan(rotor, build_native_estimator_fmu(folder, **options), *listeners)


def plan(rotor: Path, estimator: Path, tracker: Path, monitor: Path) -> Plan:
    """The system of these FMUs."""
    components = (
        Component("first", rotor, SINE),
        Component("second", rotor, {"k_b": 1e6}),
        Component("estimator", estimator),
        Component("tracker", tracker, {"k_b_start": 3.1e6, **KNOWN}),
        Component("monitor", monitor, {"k_b": 3e6, "learning_time": 0.1, **KNOWN}),
    )
    listened = [Link("first", name, "tracker", to) for name, to in (("force_applied", "force"), (SENSOR, SENSOR))]
    links = (
        Link("first", "force_applied", "second", "force"),
        Link("first", "force_applied", "estimator", "delta_f1"),
        *listened,
        *(Link("first", link.output, "monitor", link.input) for link in listened),
    )
    watched = (
        ("first", SENSOR), ("first", "force_applied"), ("second", SENSOR), ("second", "node_5.acceleration_y"),
        ("estimator", "k_b"), ("tracker", "k_b"), ("tracker", "k_b_high"), ("monitor", "drift"),
    )  # fmt: skip
    return Plan(components, links, watched)


def of_rotors(system: Plan) -> Plan:
    """The part that has real outputs alone."""
    kept = {each.name for each in system.components if not {"Boolean", "Integer"} & _types(each)}
    return Plan(
        tuple(each for each in system.components if each.name in kept),
        tuple(link for link in system.links if {link.start, link.end} <= kept),
        tuple(each for each in system.watched if each[0] in kept),
    )


def _types(component: Component) -> set[str]:
    return {kind for causality, kind in component.variables.values() if causality == "output"}


def by_hand(system: Plan, *, in_turn: bool = False, logs_late: bool = False) -> Series:
    """Each FMU by fmpy's calls.

    Parameters
    ----------
    in_turn : the FMUs step one after the other, each with the latest outputs; else with those of the step before
    logs_late : outputs are logged when they have become inputs, which the estimator answers at once
    """
    found: dict[str, list[float]] = {f"{name}.{variable}": [] for name, variable in system.watched}
    with ExitStack() as stack:
        sessions = {each.name: stack.enter_context(FmuSession(each.fmu)) for each in system.components}
        for each in system.components:
            sessions[each.name].start(dict(each.starts))

        def carry(links: Sequence[Link]) -> None:
            values = [sessions[str(link.start)].get([link.output])[0] for link in links]
            for link, value in zip(links, values, strict=True):
                sessions[str(link.end)].set({link.input: value})

        for _ in range(STEPS):
            if not in_turn:
                carry(system.links)
            for name, session in sessions.items():
                if in_turn:
                    carry([link for link in system.links if link.end == name])
                session.step(STEP)
            if logs_late:
                carry(system.links)
            for name, variable in system.watched:
                found[f"{name}.{variable}"].append(sessions[name].get([variable])[0])
    return {name: np.array(values) for name, values in found.items()}


def in_ecos(system: Plan) -> Series:
    """By the ecos command, a program in C++."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ssp = write_system("AllFmus", system.components, system.links, folder / "all.ssp")
        columns = {f"{name}.{variable}": f"{name}::{variable}" for name, variable in system.watched}
        return by_ecos(ssp, folder, columns, STEP, STOP, "--parameterSet", START_VALUES)


def by_ecos(path: Path, folder: Path, columns: Mapping[str, str], step: float, stop: float, *options: str) -> Series:
    """What the command logs of an FMU or an SSP after every step [s], under the names of these columns."""
    command = [ecos(), "simulate", "--path", path, "--stopTime", str(stop), "--stepSize", str(step), *options]
    finished = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    (table,) = folder.glob("*.csv")
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))[1:]
    assert len(rows) in (round(stop / step), round(stop / step) - 1)  # the last step may be left out
    logged = {name.split("[")[0].strip(): name for name in rows[0]}
    return {name: np.array([float(row[logged[column]]) for row in rows]) for name, column in columns.items()}


def in_libcosim(system: Plan) -> Series:
    """By libcosim, a library in C++."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    reference = {each.name: _references(each.fmu) for each in system.components}
    execution = CosimExecution.from_step_size(step_size=round(STEP * 1e9))
    slaves = {
        each.name: execution.add_local_slave(CosimLocalSlave(fmu_path=str(each.fmu), instance_name=each.name))
        for each in system.components
    }
    for each in system.components:
        for variable, value in each.starts.items():
            execution.real_initial_value(slaves[each.name], reference[each.name][variable], float(value))
    for link in system.links:
        start, end = str(link.start), str(link.end)
        ends = slaves[start], reference[start][link.output], slaves[end], reference[end][link.input]
        execution.connect_real_variables(*ends)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    found: dict[str, list[float]] = {f"{name}.{variable}": [] for name, variable in system.watched}
    for k in range(1, STEPS + 1):
        execution.simulate_until(target_time=round(k * STEP * 1e9))
        for name, variable in system.watched:
            values = observer.last_real_values(slaves[name], [reference[name][variable]])
            found[f"{name}.{variable}"].append(values[0])
    return {name: np.array(values) for name, values in found.items()}


def in_pathsim(system: Plan) -> Series:
    """By PathSim's block for FMUs, which is a master of its own on fmpy."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Constant, Scope
    from pathsim_fmi import CoSimulationFMU

    blocks = {
        each.name: CoSimulationFMU(str(each.fmu), each.name, dict(each.starts), dt=STEP) for each in system.components
    }
    scope = Scope(sampling_period=STEP, labels=[f"{name}.{variable}" for name, variable in system.watched])
    links = [
        Connection(blocks[str(link.start)][link.output], blocks[str(link.end)][link.input]) for link in system.links
    ]
    given = [
        (each.name, name, Constant(value))  # as the block sets all inputs in each step, to 0 where nothing is connected
        for each in system.components
        for name, value in each.starts.items()
        if each.variables[name][0] == "input"
    ]
    links += [Connection(constant, blocks[name][variable]) for name, variable, constant in given]
    links += [Connection(blocks[name][variable], scope[k]) for k, (name, variable) in enumerate(system.watched)]
    constants = [constant for *_, constant in given]
    Simulation([*constants, *blocks.values(), scope], links, dt=STEP, log=False).run(STOP)
    _, values = scope.read()
    return {f"{name}.{variable}": series for (name, variable), series in zip(system.watched, values, strict=True)}


def in_a_container(system: Plan) -> Series:
    """As one FMU, packed by the FMU Manipulation Toolbox, by fmpy."""
    with tempfile.TemporaryDirectory() as name:
        fmu, ports = pack(system, Path(name)), _ports(system)
        result = simulate_fmu(str(fmu), stop_time=STOP, step_size=STEP, output_interval=STEP, output=[*ports.values()])
    return {name: result[port][1:] for name, port in ports.items()}


def in_a_container_in_ecos(system: Plan) -> Series:
    """The same FMU by the ecos command."""
    with tempfile.TemporaryDirectory() as name:
        columns = {watched: f"instance::{port}" for watched, port in _ports(system).items()}
        return by_ecos(pack(system, Path(name)), Path(name), columns, STEP, STOP)


def pack(system: Plan, folder: Path) -> Path:
    """The container FMU. Each component is a file of its own there."""
    files = {each.name: f"{each.name}.fmu" for each in system.components}
    for each in system.components:
        shutil.copy(each.fmu, folder / files[each.name])
    described = {
        "name": "All.fmu", "fmu": list(files.values()), "step_size": STEP,
        "link": [[files[str(k.start)], k.output, files[str(k.end)], k.input] for k in system.links],
        "output": [[files[name], variable, _port(name, variable)] for name, variable in system.watched],
        "start": [[files[each.name], name, value] for each in system.components for name, value in each.starts.items()],
        "auto_input": False, "auto_output": False, "auto_link": False, "auto_parameter": False, "profiling": False,
    }  # fmt: skip
    (folder / "plan.json").write_text(json.dumps(described))
    command = [Path(sys.executable).with_name("fmucontainer"), "-container", "plan.json", "-fmu-directory", folder]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "All.fmu"


def _ports(system: Plan) -> dict[str, str]:
    """What a container calls its outputs: names with a dot are its own there."""
    return {f"{name}.{variable}": _port(name, variable) for name, variable in system.watched}


def _port(name: str, variable: str) -> str:
    return f"{name}_{variable}".replace(".", "_")


def _references(fmu: Path) -> dict[str, int]:
    return {v.name: v.valueReference for v in read_model_description(str(fmu)).modelVariables}


@dataclass(frozen=True)
class Host:
    """An importer."""

    run: Callable[[Plan], Series]
    versions: tuple[str, ...] = ("2.0", "3.0")
    part: Callable[[Plan], Plan] = lambda system: system  # what it can run
    in_turn: bool = False  # as in ``by_hand``
    logs_late: bool = False


HOSTS: Mapping[str, Host] = {
    "ecos": Host(in_ecos, logs_late=True),
    "libcosim": Host(in_libcosim, versions=("2.0",)),
    "PathSim": Host(in_pathsim, part=of_rotors, in_turn=True),
    "container in fmpy": Host(in_a_container),
    "container in ecos": Host(in_a_container_in_ecos),
}


def difference(system: Plan, host: Host) -> tuple[float, float, float]:
    """Largest difference over the largest value, of all variables but two; that of the network's estimate; and that
    of the evidence, in decades.

    Raises AssertionError where a variable is at rest.
    """
    part = host.part(system)
    mine, theirs = by_hand(part, in_turn=host.in_turn, logs_late=host.logs_late), host.run(part)
    relative, single, decades = 0.0, 0.0, 0.0
    for name, values in mine.items():
        n = min(len(values), len(theirs[name]))
        assert n >= STEPS - 1
        assert values[:n].std() > 0, f"{name} is at rest"
        largest = float(np.abs(theirs[name][:n] - values[:n]).max())
        if name == EVIDENCE:
            decades = largest
        elif name == ESTIMATE:
            single = largest / float(np.abs(values).max())
        else:
            relative = max(relative, largest / float(np.abs(values).max()))
    return relative, single, decades


def main() -> None:
    """Print the differences of all hosts."""
    for fmi in ("2.0", "3.0"):
        with tempfile.TemporaryDirectory() as folder:
            system = build(Path(folder), fmi)
            for name, host in HOSTS.items():
                if fmi in host.versions:
                    relative, single, decades = difference(system, host)
                    words = f"{relative:.1g} of the largest value, estimate {single:.1g}, evidence {decades:.1g}"
                    print(f"FMI {fmi}, {name}: {words}", flush=True)


if __name__ == "__main__":
    main()
