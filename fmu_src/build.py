"""Build the FMUs.

Stage the sources, let pythonfmu build, complete the archive (picture, documentation, names that
cannot clash), validate, and only then put the file in place. With ``--native`` both are built once
more without Python inside: print what is the rig's own as C, compile it with the core for every
platform in reach, and pack it for FMI 2.0 (``dist/fmi2``) and FMI 3.0 (``dist/fmi3``).
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, indent, tostring

import fmpy
import numpy as np
from fmpy.validation import validate_fmu

from rigtwin.estimator.tracking import TRACKER_CARD, shipped_tracker
from rigtwin.estimator.tracking.reduced_rotor import ReducedRotor
from rigtwin.estimator.tracking.reduced_rotor import to_arrays as to_reduced_arrays
from rigtwin.estimator.tracking.reduction import reduce_rotor
from rigtwin.estimator.tracking.tracker import MOST_SENSORS
from rigtwin.fmu_src.beside import (
    ReferenceRun,
    Terminal,
    external_dependencies,
    licences,
    metadata,
    node_terminals,
    references,
    sha256,
    terminals_and_icon,
)
from rigtwin.fmu_src.built_here import record
from rigtwin.fmu_src.compiling import CompileError, Target, compile_library, reachable_targets
from rigtwin.fmu_src.documentation import estimator_pages, listener_pages, rotor_pages
from rigtwin.fmu_src.estimator_variables import (
    ESTIMATOR_MEANING,
    ESTIMATOR_STEP,
    ESTIMATOR_TOLERANCE,
    estimator_variables,
)
from rigtwin.fmu_src.model_description import Model, build_description, fmi2, fmi3
from rigtwin.fmu_src.monitor_variables import MONITOR_MEANING, monitor_variables
from rigtwin.fmu_src.native_sources import (
    c_files,
    digest,
    estimator_sources,
    monitor_sources,
    rotor_sources,
    tracker_sources,
)
from rigtwin.fmu_src.reference_runs import estimator_run, monitor_run, rotor_run, tracker_run
from rigtwin.fmu_src.rotor_variables import ROTOR_MEANING, RotorFacts, accelerations_array, rotor_variables
from rigtwin.fmu_src.staging import Bundle, guid, hide_pythonfmu, modules_of, stage
from rigtwin.fmu_src.tracker_variables import (
    TRACKER_MEANING,
    TRACKER_NETWORK,
    TRACKER_TOLERANCE,
    TrackerFacts,
    tracker_variables,
)
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, RigError, load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure, to_arrays
from rigtwin.rotor.time.exciter import highest_frequency, recommended_step
from rigtwin.rotor.time.nonlinear_stepper import FORCE_ERROR
from rigtwin.scratch import replacing, scratch_folder

ROTOR_FMU = "RotorRig.fmu"
SHIPPED_RIG = "nit-rourkela"

# What both need: a slave that is driven by a variable table.
_SLAVE_MODULES = ("rigtwin.fmu_src.slave", "rigtwin.fmu_src.variables", "rigtwin.fmu_src.model_description")

# What the rotor needs at run time: everything but geometry and the frequency domain.
_ROTOR_PACKAGES = ("rigtwin.rotor.model", "rigtwin.rotor.effects", "rigtwin.rotor.time")
ESTIMATOR_FMU = "StiffnessEstimator.fmu"

# What tracker and monitor need at run time.
_LISTENING_MODULES = (
    "rigtwin.fmu_src.tracker_variables",
    "rigtwin.fmu_src.listening_slave",
    "rigtwin.estimator.intervals",
    "rigtwin.estimator.tracking.reduced_rotor",
    "rigtwin.estimator.tracking.tracker",
    "rigtwin.rotor.model.arrays",
)

# A tracker looks for k_b within this factor of the rig's start value, takes so many values for each period of the
# highest frequency, and begins with these dampings where the rig has none [N s/m] and [-].
_TRACKED, _VALUES, _SOME_DAMPING, _LITTLE_DAMPING = 1e3, 25, 1.0, 1e-4

# FMI's own C headers come with fmpy.
FMI_HEADERS = Path(fmpy.__file__).with_name("c-code")

# A fixed time stamp in the archive: the same sources give the same file, byte for byte.
_ZIP_DATE = (2020, 1, 1, 0, 0, 0)


class BuildError(RuntimeError):
    """pythonfmu failed, or the FMU it made does not pass validation."""


def build_rotor_fmu(
    rig: Rig, folder: Path, *, elements_between_nodes: int | None = None, k_b_input: bool = False
) -> Path:
    """Build ``RotorRig.fmu`` of a rig.

    Parameters
    ----------
    rig : the rig
    folder : where the FMU goes; made if it is not there
    elements_between_nodes : mesh refinement, default the rig's own
    k_b_input : k_b is an input, which other FMUs can be connected to, and no tunable parameter

    Returns
    -------
    Path of the FMU. Raises BuildError; an older file is then left as it was.
    """
    structure = assemble(rig, elements_between_nodes=elements_between_nodes)
    facts = rotor_facts(rig, structure, k_b_input=k_b_input)
    bundle = Bundle(
        script="rigtwin.fmu_src.rotor_slave",
        modules=(*_SLAVE_MODULES, "rigtwin.fmu_src.rotor_variables", *modules_of(_ROTOR_PACKAGES)),
        data={"structure.npz": _npz(to_arrays(structure)), "rig.json": rig_json(rig)},
        facts={"facts": asdict(facts), "rig": rig.name},
    )
    files = rotor_pages(rig, facts) | _beside_python(("numpy", "scipy")) | _rotor_extra(rig, structure, facts)
    return _build(bundle, files, folder / ROTOR_FMU)


def _beside_python(packages: Sequence[str]) -> dict[str, bytes]:
    """Licences and needs of an FMU on the host's Python."""
    return licences(("pythonfmu",)) | external_dependencies(packages)


def _beside_native(fmi: str) -> dict[str, bytes]:
    """Licences and needs of a compiled FMU."""
    headers = (FMI_HEADERS / f"fmi{fmi[0]}Functions.h").read_text(encoding="utf-8")
    return licences((), headers) | external_dependencies(())


def _rotor_extra(rig: Rig, structure: Structure, facts: RotorFacts) -> dict[str, bytes]:
    """A reference run of the rotor, and what it is the model of."""
    held = Condition(k_b=facts.k_b_start, rigid_support=True, spin_speed=facts.spin_speed_start)
    rigid, bearing = (
        elastic_frequencies_hz(build_system(structure, condition), plane=1)
        for condition in (held, replace(held, rigid_support=False))
    )
    described = {
        "model": "RotorRig",
        "rigtwin": version("rigtwin"),
        "rig": {"name": rig.name, "title": rig.title, "sha256": sha256(rig_json(rig))},
        "resonances_Hz": {"rigid": rigid[:2].tolist(), "bearing": bearing[:2].tolist()},
        "validity": {
            "k_b_N_per_m": [facts.k_b_min, facts.k_b_max],
            "force_signal_Hz": [0.0, highest_frequency(facts.step)],
            "communication_step_s": facts.step,
            "motion": "small lateral vibration of the shaft at a constant spin speed",
            **({"spin_speed_rad_per_s": [facts.spin_speed_min, facts.spin_speed_max]} if rig.has_tables else {}),
        },
    }
    return references(rotor_run(structure, facts)) | metadata(described)


def _estimator_extra(model: Path) -> dict[str, bytes]:
    """A reference run of the estimator, and what it was trained for."""
    from rigtwin.estimator.runtime import StiffnessEstimator

    described = {
        "model": "StiffnessEstimator",
        "rigtwin": version("rigtwin"),
        "rig": {"name": SHIPPED_RIG, "sha256": sha256(rig_json(load_rig(SHIPPED_RIG)))},
        "network": {"sha256": sha256(model.read_bytes())},
        "validity": StiffnessEstimator(model).card["training_range"],
    }
    return references(estimator_run(model)) | metadata(described)


def rig_json(rig: Rig) -> bytes:
    """The rig as it lies in the FMU."""
    return rig.model_dump_json(indent=1).encode()


# Highest frequency that an FMU is made for, over the second resonance on rigid supports.
_BAND = 1.2


def _highest_hz(structure: Structure) -> float:
    """Highest frequency that an FMU of a rotor is made for; all its supports are rigid for that."""
    system = build_system(structure.with_bearings_for_tables(), Condition(rigid_support=True))
    return _BAND * float(elastic_frequencies_hz(system, plane=1)[1])


def rotor_facts(rig: Rig, structure: Structure, *, k_b_input: bool = False) -> RotorFacts:
    """What the variable table needs to know of a rig.

    Supports that follow the spin speed set the range of ``spin_speed`` and its start, the lowest of their speeds. The
    step is that of a rotor whose supports are all rigid.
    """
    spin = [_outward(end, up) for end, up in zip(structure.spin_range, (False, True), strict=True)]
    ranges = {"spin_speed_min": spin[0], "spin_speed_max": spin[1]} if rig.has_tables else {}
    return RotorFacts(
        n_nodes=len(rig.nodes_m),
        excitation_node=rig.excitation_node,
        shaft_damping_ratio=rig.shaft_damping_ratio,
        bearing_damping=rig.bearing_damping_Ns_per_m,
        k_b_start=rig.k_b.start_N_per_m,
        k_b_min=rig.k_b.min_N_per_m,
        k_b_max=rig.k_b.max_N_per_m,
        length=rig.length,
        step=recommended_step(_highest_hz(structure)),
        spin_speed_start=structure.lowest_spin_speed,
        k_b_input=k_b_input,
        **ranges,
    )


def _outward(value: float, up: bool) -> float:
    """A number that a host may write with six digits, rounded so that it still lies inside; a table allows as much."""
    if not value or not np.isfinite(value):
        return value
    unit = 10.0 ** (np.floor(np.log10(abs(value))) - 5)
    return float(f"{(np.ceil if up else np.floor)(value / unit) * unit:.6g}")


def build_estimator_fmu(folder: Path, model: Path | None = None) -> Path:
    """Build ``StiffnessEstimator.fmu`` around a trained network, default the shipped one. Raises BuildError."""
    from rigtwin.estimator.runtime import shipped_model

    model = model or shipped_model()
    bundle = Bundle(
        script="rigtwin.fmu_src.estimator_slave",
        modules=(
            *_SLAVE_MODULES,
            "rigtwin.fmu_src.estimator_variables",
            "rigtwin.estimator.runtime",
            "rigtwin.estimator.onnx_file",
        ),
        data={"estimator.onnx": model.read_bytes()},
    )
    files = estimator_pages(model) | _beside_python(("numpy", "onnxruntime")) | _estimator_extra(model)
    return _build(bundle, files, folder / ESTIMATOR_FMU)


def reduced_rotor(rig: Rig, structure: Structure) -> ReducedRotor:
    """The rotor as a tracker carries it. Raises BuildError where no bearing has the stiffness k_b."""
    if not structure.bearings:
        raise BuildError(f"No tracker and no monitor is built: {rig.name} has no bearing whose stiffness is k_b")
    low, high = rig.k_b.min_N_per_m, rig.k_b.max_N_per_m
    start = rig.k_b.start_N_per_m
    within = max(low, start / _TRACKED), min(high, start * _TRACKED)
    return reduce_rotor(structure, within, _highest_hz(structure))


def tracker_facts(rig: Rig, rotor: ReducedRotor, nodes: Sequence[int]) -> TrackerFacts:
    """What the tracker's variable table needs to know of a rig. Raises BuildError for nodes that cannot be read."""
    for node in nodes:
        if not 1 <= node <= len(rig.nodes_m):
            raise BuildError(f"there is no node {node}; {rig.name} has nodes 1 to {len(rig.nodes_m)}")
    if not 1 <= len(set(nodes)) == len(nodes) <= MOST_SENSORS:
        raise BuildError(f"give 1 to {MOST_SENSORS} different nodes")
    step = 1 / (_VALUES * float(rotor.highest_hz))
    return TrackerFacts(
        nodes=tuple(nodes),
        n_nodes=len(rig.nodes_m),
        excitation_node=rig.excitation_node,
        k_b_start=rig.k_b.start_N_per_m,
        k_b_min=float(rotor.k_b[0]),
        k_b_max=float(rotor.k_b[1]),
        bearing_damping=rig.bearing_damping_Ns_per_m or _SOME_DAMPING,
        shaft_damping_ratio=rig.shaft_damping_ratio or _LITTLE_DAMPING,
        step=float(f"{step:.0e}"),
    )


@dataclass(frozen=True)
class Listener:
    """An FMU that listens to a running rotor, instant by instant."""

    name: str  # of the model; the file's with .fmu
    meaning: str
    variables: Callable[[TrackerFacts], tuple[Variable, ...]]
    script: str  # of its slave
    modules: tuple[str, ...]  # that its slave needs beside those of every slave
    template: str  # of its page
    sources: Callable[..., dict[str, str]]  # of model, rotor, nodes, FMI's version, and a network where there is one
    run: Callable[[ReducedRotor, TrackerFacts], ReferenceRun]


TRACKER = Listener(
    name="StiffnessTracker",
    meaning=TRACKER_MEANING,
    variables=tracker_variables,
    script="rigtwin.fmu_src.tracker_slave",
    modules=(*_LISTENING_MODULES, "rigtwin.estimator.onnx_file", "rigtwin.estimator.tracking.network"),
    template="tracker.html",
    sources=tracker_sources,
    run=tracker_run,
)
MONITOR = Listener(
    name="GapMonitor",
    meaning=MONITOR_MEANING,
    variables=monitor_variables,
    script="rigtwin.fmu_src.monitor_slave",
    modules=(*_LISTENING_MODULES, "rigtwin.fmu_src.monitor_variables", "rigtwin.estimator.tracking.monitor"),
    template="monitor.html",
    sources=monitor_sources,
    run=monitor_run,
)
LISTENERS = (TRACKER, MONITOR)


def tracker_network(listener: Listener, rig: Rig, nodes: Sequence[int], given: Path | None) -> Path | None:
    """The ONNX file of the network that goes into a listener of these nodes.

    That is the one given, or else the shipped one where it knows the rig; None where there is none. Raises BuildError
    for one that was trained for something else.
    """
    if listener.name != TRACKER.name:
        return None
    if given is None:
        return shipped_tracker() if is_shipped(rig) and tuple(nodes) == (rig.excitation_node,) else None
    card = _tracker_card(given)
    if Rig.model_validate(card["rig_values"]) != rig:
        raise BuildError(f"{given} was trained for the rig {card['rig']}, and its values are not those of {rig.name}")
    if tuple(card["nodes"]) != tuple(nodes):
        words = ", ".join(map(str, card["nodes"]))
        raise BuildError(f"{given} was trained to read the nodes {words}; say so with --tracker-node, or train another")
    return given


def _tracker_card(path: Path) -> dict:
    """What a network of ``rigtwin train --tracker`` says of itself. Raises BuildError for other files."""
    from rigtwin.estimator.tracking.network import TrackerNetwork

    try:
        card = TrackerNetwork(path).card
        if card["name"] == TRACKER_CARD:
            return card
        why = f"it is a {card['name']}"
    except Exception as error:  # onnxruntime has no common base class
        why = str(error).partition("\n")[0]
    raise BuildError(f"{path}: holds no network of rigtwin train --tracker ({why})")


def build_listener_fmu(
    listener: Listener, rig: Rig, folder: Path, nodes: Sequence[int] | None = None, network: Path | None = None
) -> Path:
    """Build ``StiffnessTracker.fmu`` or ``GapMonitor.fmu`` of a rig.

    It reads accelerations of some nodes, from 1, default the driven one. ``network`` is the tracker's, default the
    shipped one where it knows the rig. Raises BuildError; an older file is then left as it was.
    """
    structure = assemble(rig)
    rotor = reduced_rotor(rig, structure)
    facts = tracker_facts(rig, rotor, nodes or (rig.excitation_node,))
    data = _network_data(tracker_network(listener, rig, facts.nodes, network))
    bundle = Bundle(
        script=listener.script,
        modules=(*_SLAVE_MODULES, *listener.modules),
        data={"reduced.npz": _npz(to_reduced_arrays(rotor)), "rig.json": rig_json(rig), **data},
        facts={"facts": asdict(facts), "rig": rig.name},
    )
    packages = ("numpy", "scipy", *(("onnxruntime",) if data else ()))
    files = _listener_pages(listener, rig, facts, rotor, needs_python=True, network=bool(data))
    files |= _beside_python(packages)
    files |= _listener_extra(listener, rig, rotor, facts)
    return _build(bundle, files, folder / f"{listener.name}.fmu")


def build_native_listener_fmu(
    listener: Listener,
    rig: Rig,
    folder: Path,
    nodes: Sequence[int] | None = None,
    *,
    network: Path | None = None,
    fmi: str = "2.0",
    targets: Sequence[Target] | None = None,
) -> Path:
    """The same without Python inside; see ``build_native_rotor_fmu``."""
    rotor = reduced_rotor(rig, assemble(rig))
    facts = tracker_facts(rig, rotor, nodes or (rig.excitation_node,))
    known = tracker_network(listener, rig, facts.nodes, network)
    described = version("rigtwin"), listener.meaning, facts.step, listener.variables(facts)
    blank = Model(listener.name, "", *described, tolerance=TRACKER_TOLERANCE)

    def sources(model: Model) -> dict[str, str]:
        return listener.sources(model, rotor, facts.nodes, fmi, **({"network": known} if known else {}))

    pages = _listener_pages(listener, rig, facts, rotor, needs_python=False, network=known is not None)
    pages |= _listener_extra(listener, rig, rotor, facts)
    data = {"rig.json": rig_json(rig)} | _network_data(known)
    target = folder / f"{listener.name}.fmu"
    return build_native_fmu(blank, sources, fmi, targets, {"rig": rig.name}, data, pages, target)


def _network_data(network: Path | None) -> dict[str, bytes]:
    return {TRACKER_NETWORK: network.read_bytes()} if network else {}


def _listener_pages(
    listener: Listener, rig: Rig, facts: TrackerFacts, rotor: ReducedRotor, **how: bool
) -> dict[str, bytes]:
    about = facts, listener.variables(facts), float(rotor.highest_hz)
    return listener_pages(listener.template, rig, *about, **how)


def _listener_extra(listener: Listener, rig: Rig, rotor: ReducedRotor, facts: TrackerFacts) -> dict[str, bytes]:
    """A reference run, and what the FMU is made for."""
    described = {
        "model": listener.name,
        "rigtwin": version("rigtwin"),
        "rig": {"name": rig.name, "title": rig.title, "sha256": sha256(rig_json(rig))},
        "validity": {
            "k_b_N_per_m": [facts.k_b_min, facts.k_b_max],
            "motion_Hz": [0.0, float(rotor.highest_hz)],
            "motion": "lateral vibration of the shaft in y; the rotor stands, or its gyroscopic effect is small",
        },
    }
    return references(listener.run(rotor, facts)) | metadata(described)


def build_native_rotor_fmu(
    rig: Rig,
    folder: Path,
    *,
    fmi: str = "2.0",
    targets: Sequence[Target] | None = None,
    elements_between_nodes: int | None = None,
    array_output: bool = False,
    k_b_input: bool = False,
) -> Path:
    """Build ``RotorRig.fmu`` without Python inside.

    Parameters
    ----------
    rig, folder, elements_between_nodes, k_b_input : see ``build_rotor_fmu``
    fmi : version, "2.0" or "3.0"
    targets : platforms, default all that can be compiled for here
    array_output : FMI 3.0: all accelerations once more as one array; importers that read one value a reference fail

    Returns
    -------
    Path of the FMU. Raises BuildError and CompileError; an older file is then left as it was.
    """
    structure = assemble(rig, elements_between_nodes=elements_between_nodes)
    facts = rotor_facts(rig, structure, k_b_input=k_b_input)
    arrays = (accelerations_array(facts),) if array_output else ()
    blank = Model(
        "RotorRig",
        "",
        version("rigtwin"),
        f"{ROTOR_MEANING} (rig {rig.name})",
        facts.step,
        rotor_variables(facts),
        arrays,
        takes_derivatives=True,
        tolerance=FORCE_ERROR,
    )

    def sources(model: Model) -> dict[str, str]:
        return rotor_sources(model, structure, fmi)

    data = {"rig.json": rig_json(rig)}
    pages = rotor_pages(rig, facts, needs_python=False) | _rotor_extra(rig, structure, facts)
    target, terminals = folder / ROTOR_FMU, node_terminals(blank)
    return build_native_fmu(blank, sources, fmi, targets, {"rig": rig.name}, data, pages, target, terminals)


def build_native_estimator_fmu(
    folder: Path, model: Path | None = None, *, fmi: str = "2.0", targets: Sequence[Target] | None = None
) -> Path:
    """Build ``StiffnessEstimator.fmu`` without Python inside; see ``build_native_rotor_fmu``."""
    from rigtwin.estimator.runtime import StiffnessEstimator, shipped_model

    model = model or shipped_model()
    table = estimator_variables(StiffnessEstimator(model).card["example_inputs"])
    blank = Model(
        "StiffnessEstimator",
        "",
        version("rigtwin"),
        ESTIMATOR_MEANING,
        ESTIMATOR_STEP,
        table,
        tolerance=ESTIMATOR_TOLERANCE,
    )

    def sources(described: Model) -> dict[str, str]:
        return estimator_sources(described, model, fmi)

    data = {"estimator.onnx": model.read_bytes()}
    pages = estimator_pages(model, needs_python=False) | _estimator_extra(model)
    return build_native_fmu(blank, sources, fmi, targets, {}, data, pages, folder / ESTIMATOR_FMU)


def build_native_fmu(
    blank: Model,
    sources: Callable[[Model], dict[str, str]],
    fmi: str,
    targets: Sequence[Target] | None,
    facts: dict[str, str],
    data: dict[str, bytes],
    pages: dict[str, bytes],
    target: Path,
    terminals: Sequence[Terminal] = (),
) -> Path:
    """Print the sources, compile, and pack with everything beside them, licences and icon too; the path.

    Parameters
    ----------
    blank : the model, without sources and GUID
    sources : prints its sources
    fmi : version, "2.0" or "3.0"
    targets : platforms, default all that can be compiled for here
    facts : what stands in its manifest beside GUID and version
    data, pages : files in ``resources/`` and in the archive, by name, ``model.png`` among them
    terminals : of FMI 3.0

    Raises BuildError and CompileError; an older file is then left as it was.
    """
    pages = pages | _beside_native(fmi)
    if fmi == "3.0":
        pages |= terminals_and_icon(terminals, pages["model.png"])
    without_guid = sources(blank)
    model = replace(blank, sources=c_files(without_guid))
    model = replace(model, guid=guid(digest(without_guid | _described(model, fmi, facts, data))))
    manifest = {"guid": model.guid, "version": model.version, **facts}
    with scratch_folder("build_") as scratch:
        unpacked = _folder(scratch, "fmu")
        written = _folder(unpacked, "sources")
        for name, text in sources(model).items():
            (written / name).write_text(text, encoding="utf-8")
        for header in sorted(FMI_HEADERS.glob(f"fmi{fmi[0]}*.h")):
            (written / header.name).write_text(with_prefix(header.read_text(encoding="utf-8")), encoding="utf-8")
        for platform in targets or reachable_targets():
            library = unpacked / "binaries" / platform.folder(fmi) / f"{model.name}{platform.suffix}"
            compile_library(written, model.sources, platform, library)
        if fmi == "3.0":
            _write_xml(build_description(model), written / "buildDescription.xml")
        _write_xml(_description(model, fmi), unpacked / "modelDescription.xml")
        resources = {"manifest.json": json.dumps(manifest, indent=1).encode(), **data}
        _write_all(unpacked, pages | {f"resources/{name}": content for name, content in resources.items()})
        _pack(unpacked, target)
    return target


_NO_PREFIX = "#define fmi2FullName(name) name\n"
_PREFIX = """#ifdef FMI2_FUNCTION_PREFIX
#define fmi2Join(prefix, name) prefix##name
#define fmi2Joined(prefix, name) fmi2Join(prefix, name)
#define fmi2FullName(name) fmi2Joined(FMI2_FUNCTION_PREFIX, name)
#else
#define fmi2FullName(name) name
#endif
"""


def with_prefix(header: str) -> str:
    """A header of FMI with the prefix that the standard gives its functions in programs that hold several FMUs.

    fmpy's headers of FMI 2.0 leave it out; those of FMI 3.0 have it.
    """
    return header if "defined(FMI2_FUNCTION_PREFIX)" in header else header.replace(_NO_PREFIX, _PREFIX)


def _description(model: Model, fmi: str) -> Element:
    return fmi2(model, needs_execution_tool=False) if fmi == "2.0" else fmi3(model)


def _described(model: Model, fmi: str, facts: dict[str, str], data: dict[str, bytes]) -> dict[str, str]:
    """What the GUID stands for beside the sources: the description, the facts, the data."""
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in data.items()}
    return {"modelDescription.xml": tostring(_description(model, fmi), "unicode"), "facts": json.dumps(facts), **hashes}


def _write_xml(root: Element, path: Path) -> None:
    indent(root, "\t")
    ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)


def _write_all(folder: Path, contents: dict[str, bytes]) -> None:
    for name, content in contents.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def _build(bundle: Bundle, pages: dict[str, bytes], target: Path) -> Path:
    """Stage, build, complete, validate, put in place."""
    manifest = json.dumps({"guid": bundle.guid, "version": version("rigtwin"), **bundle.facts}, indent=1)
    with scratch_folder("build_") as scratch:
        stock = _run_pythonfmu(stage(bundle, manifest, _folder(scratch, "stage")), scratch)
        unpacked = scratch / "fmu"
        with zipfile.ZipFile(stock) as archive:
            archive.extractall(unpacked)
        hide_pythonfmu(unpacked / "resources", bundle)
        _write_all(unpacked, pages)
        _pack(unpacked, target)
    return target


def _pack(unpacked: Path, target: Path) -> None:
    """Zip beside the target, validate, put in place. Raises BuildError."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as complete:
        _zip(unpacked, complete)
        problems = validate_fmu(str(complete))
        if problems:
            raise BuildError(f"{target.name} is not a valid FMU: " + "; ".join(problems))
        record(complete)


def _run_pythonfmu(script: Path, scratch: Path) -> Path:
    """Build the stock FMU in a process of its own: pythonfmu imports the slave to describe it."""
    project_files = [str(p) for p in script.parent.iterdir() if p != script]
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", str(script), "-d", str(_folder(scratch, "stock"))]
    command += ["--handle-state", "--serialize-state", *project_files]
    own = os.environ | {"TMPDIR": str(scratch)}  # which goes with the scratch folder, however this ends
    finished = subprocess.run(command, capture_output=True, text=True, cwd=scratch, check=False, env=own)
    built = list((scratch / "stock").glob("*.fmu"))
    if finished.returncode or len(built) != 1:
        raise BuildError(f"pythonfmu could not build {script.name}:\n{finished.stderr.strip()}")
    return built[0]


def _folder(parent: str | Path, name: str) -> Path:
    path = Path(parent) / name
    path.mkdir()
    return path


def _zip(folder: Path, target: Path) -> None:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts):
            entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), _ZIP_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes())


def _npz(arrays: dict) -> bytes:
    """Arrays as .npz, the same bytes for the same arrays."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.asarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _ZIP_DATE), entry.getvalue())
    return buffer.getvalue()


def build_native(
    rig: Rig,
    folder: Path,
    *,
    estimator: bool = True,
    array_output: bool = False,
    k_b_input: bool = False,
    targets: Sequence[Target] | None = None,
) -> Iterator[Path]:
    """The FMUs for FMI 2.0 and 3.0, for some platforms or every one in reach; says which. Raises as they do."""
    names = ", ".join(target.fmi3 for target in targets or reachable_targets())
    hint = "" if targets or find_spec("ziglang") else "; with ziglang (pip install ziglang) for all others too"
    print(f"compiling for {names}{hint}", file=sys.stderr)
    for fmi in ("2.0", "3.0"):
        own = folder / f"fmi{fmi[0]}"
        yield build_native_rotor_fmu(rig, own, fmi=fmi, targets=targets, array_output=array_output, k_b_input=k_b_input)
        if estimator:
            yield build_native_estimator_fmu(own, fmi=fmi, targets=targets)


def is_shipped(rig: Rig) -> bool:
    """Whether this is the rig that the shipped estimator knows."""
    return rig == load_rig(SHIPPED_RIG)


def main(arguments: list[str] | None = None) -> int:
    """Command line of ``python build_fmu.py``."""
    parser = argparse.ArgumentParser(description="Build RotorRig.fmu and StiffnessEstimator.fmu.")
    parser.add_argument("rig", nargs="?", default=SHIPPED_RIG, help="a shipped rig or the path of a rig TOML")
    parser.add_argument("--out", type=Path, default=Path("dist"), help="folder for the FMUs (default: dist)")
    parser.add_argument("--native", action="store_true", help="build them once more, without Python inside")
    parser.add_argument(
        "--array-output", action="store_true", help="with --native: the accelerations as one array, too"
    )
    parser.add_argument("--k-b-input", action="store_true", help="k_b is an input of the rotor, and no parameter")
    options = parser.parse_args(arguments)
    try:
        for path in _all_of(load_rig(options.rig), options):
            print(path)
    except (RigError, BuildError, CompileError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _all_of(rig: Rig, options: argparse.Namespace) -> Iterator[Path]:
    """All FMUs that there are of a rig."""
    known = is_shipped(rig)
    yield build_rotor_fmu(rig, options.out, k_b_input=options.k_b_input)
    if known:
        yield build_estimator_fmu(options.out)
    else:
        print(f"{ESTIMATOR_FMU} is not built: its network knows the rig {SHIPPED_RIG} only", file=sys.stderr)
    if options.native:
        yield from build_native(
            rig, options.out, estimator=known, array_output=options.array_output, k_b_input=options.k_b_input
        )
