"""A machine whose bearing softens, as one system: rotor, bearing, tracker, and a supervisor of the speed.

The supervisor's force drives the rotor: that of its unbalance at the spin speed, and beside it a weak force of many
frequencies, without which no tracker could tell the stiffness. The bearing gives the rotor its stiffness, the tracker
finds it from force and accelerations, and by what it finds the supervisor keeps the speed away from the resonances.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from rigtwin.fmu_src.build import (
    TRACKER,
    build_native_fmu,
    build_native_listener_fmu,
    build_native_rotor_fmu,
    reduced_rotor,
    rig_json,
    tracker_facts,
)
from rigtwin.fmu_src.compiling import Target
from rigtwin.fmu_src.documentation import machine_pages
from rigtwin.fmu_src.machine_variables import (
    BEARING_MEANING,
    SUPERVISOR_MEANING,
    MachineFacts,
    bearing_variables,
    rounded,
    supervisor_variables,
)
from rigtwin.fmu_src.model_description import Model
from rigtwin.fmu_src.native_sources import bearing_sources, supervisor_sources
from rigtwin.fmu_src.ssp import Component, Link, write_system
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure

BEARING, SUPERVISOR, SYSTEM = "SofteningBearing", "SpeedSupervisor", "SoftenedMachine"

# Stiffnesses at which resonances are printed, and how many resonances.
_STIFFNESSES, _RESONANCES = 121, 2

# The machine runs so far below its first resonance, relative; its unbalance is that of balance quality grade G 6.3, in
# m/s [iso21940]; and the probe has this share of the unbalance's force.
_BELOW, _GRADE, _PROBE = 0.065, 6.3e-3, 0.1

# Lines of the probe, and its highest frequency over the highest resonance.
_LINES, _PROBED = 64, 1.2

_HOW = {
    BEARING: (
        "Connect k_b to a rotor that was built with k_b as an input.",
        "A rotor makes its equations anew for each change of k_b, so that many changes take time; a few large ones"
        " strike it like a hammer. change_every says how many there are.",
    ),
    SUPERVISOR: (
        "Connect k_b and valid to those of a StiffnessTracker, and force to the rotor.",
        "The machine runs up to the speed that is wanted, through resonances below it. Once a stiffness was valid, it"
        " goes no nearer to a resonance than the margin: where the stiffness moves one, the speed gives way to it."
        " While the tracker is not sure, the last stiffness that was valid counts. Another speed_wanted may lie beyond"
        " a resonance; the machine passes through it then.",
        "The probe has to be strong enough beside the unbalance; the tracker's output valid tells.",
    ),
}


def machine_facts(rig: Rig) -> MachineFacts:
    """The numbers of a machine with this rotor. Raises BuildError where no bearing has the stiffness k_b."""
    structure = assemble(rig)
    facts = tracker_facts(rig, reduced_rotor(rig, structure), (rig.excitation_node,))
    first, *_, last = resonances_at(structure, facts.k_b_start)
    speed = rounded((1 - _BELOW) * first)
    unbalance = rounded(scale_of(structure).mass * _GRADE / speed)
    return MachineFacts(
        k_b_start=facts.k_b_start,
        k_b_min=facts.k_b_min,
        k_b_max=facts.k_b_max,
        period=float(2 * np.pi / first),
        speed=speed,
        highest_speed=rounded(_PROBED * last),
        unbalance=unbalance,
        probe=rounded(_PROBE * unbalance * speed**2),
        step=facts.step,
    )


def resonances_at(structure: Structure, k_b: float) -> FloatArray:
    """(2,) lowest resonances in y [rad/s], of the rotor at rest."""
    return 2 * np.pi * elastic_frequencies_hz(build_system(structure, Condition(k_b=k_b)), plane=1)[:_RESONANCES]


def probe_lines(highest: float) -> tuple[FloatArray, FloatArray]:
    """(n,) frequencies [rad/s] up to a highest one, and phases [rad]: never the same again, and never very large.

    The n-th multiples of irrational numbers, modulo one, lie evenly and repeat nothing [weyl1916].
    """
    n = np.arange(_LINES)
    within, turn = np.modf(n * (np.sqrt(5) - 1) / 2)[0], np.modf(n * n * np.sqrt(2))[0]
    return highest * (n + 1 + within) / (_LINES + 1), 2 * np.pi * turn


def build_bearing_fmu(
    rig: Rig, facts: MachineFacts, folder: Path, *, fmi: str = "2.0", targets: Sequence[Target] | None = None
) -> Path:
    """Build ``SofteningBearing.fmu``, compiled. Raises BuildError and CompileError."""

    def sources(model: Model) -> dict[str, str]:
        return bearing_sources(model, fmi)

    return _build(rig, facts, (BEARING, BEARING_MEANING, bearing_variables(facts)), sources, folder, fmi, targets)


def build_supervisor_fmu(
    rig: Rig, facts: MachineFacts, folder: Path, *, fmi: str = "2.0", targets: Sequence[Target] | None = None
) -> Path:
    """Build ``SpeedSupervisor.fmu``, compiled. Raises BuildError and CompileError."""
    structure = assemble(rig)
    ln_k = np.linspace(np.log(facts.k_b_min), np.log(facts.k_b_max), _STIFFNESSES)
    resonances = np.array([resonances_at(structure, k_b) for k_b in np.exp(ln_k)]).T
    probe = probe_lines(_PROBED * float(resonances[-1, -1]))  # of the stiffest bearings

    def sources(model: Model) -> dict[str, str]:
        return supervisor_sources(model, ln_k, resonances, probe, fmi)

    table = supervisor_variables(facts)
    return _build(rig, facts, (SUPERVISOR, SUPERVISOR_MEANING, table), sources, folder, fmi, targets)


def _build(
    rig: Rig,
    facts: MachineFacts,
    described: tuple[str, str, tuple[Variable, ...]],
    sources: Callable[[Model], dict[str, str]],
    folder: Path,
    fmi: str,
    targets: Sequence[Target] | None,
) -> Path:
    name, meaning, table = described
    blank = Model(name, "", version("rigtwin"), meaning, facts.step, table)
    pages = machine_pages(rig, name, meaning, _HOW[name], table)
    data = {"rig.json": rig_json(rig)}
    return build_native_fmu(blank, sources, fmi, targets, {"rig": rig.name}, data, pages, folder / f"{name}.fmu")


def build_machine(
    rig: Rig, facts: MachineFacts, folder: Path, *, fmi: str = "2.0", targets: Sequence[Target] | None = None
) -> Path:
    """Build the four FMUs and the system of them, ``SoftenedMachine.ssp``; its path. Raises as they do.

    The system has no ports, as not every master knows ports of a system: set start values of its components instead,
    and read their outputs.
    """
    options = {"fmi": fmi, "targets": targets}
    components = (
        Component("bearing", build_bearing_fmu(rig, facts, folder, **options)),
        Component("supervisor", build_supervisor_fmu(rig, facts, folder, **options), shown=("speed", "resonance")),
        Component("rotor", build_native_rotor_fmu(rig, folder, k_b_input=True, **options)),
        Component("tracker", build_native_listener_fmu(TRACKER, rig, folder, **options), shown=("k_b_low", "k_b_high")),
    )
    read = f"node_{rig.excitation_node}.acceleration_y"
    links = (
        Link("bearing", "k_b", "rotor", "k_b"),
        Link("supervisor", "force", "rotor", "force"),
        Link("rotor", "force_applied", "tracker", "force"),
        Link("rotor", read, "tracker", read),
        Link("tracker", "k_b", "supervisor", "k_b"),
        Link("tracker", "valid", "supervisor", "valid"),
    )
    return write_system(SYSTEM, components, links, folder / f"{SYSTEM}.ssp")
