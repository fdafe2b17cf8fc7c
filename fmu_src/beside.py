"""What an FMU holds beside its model: licences, what it needs, terminals, a reference run, and facts about itself.

The names of files and folders are those of the FMI standard (``documentation/licenses``,
``documentation/externalDependencies.txt``, ``terminalsAndIcons``) and of the layered standard FMI-LS-REF
(``extra/org.fmi-standard.fmi-ls-ref``), which lists the files of ``extra`` with what they are for.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import distribution
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, register_namespace, tostring

import numpy as np

from rigtwin.fmu_src.model_description import Model
from rigtwin.rotor.model.arrays import FloatArray

REFERENCES = "extra/org.fmi-standard.fmi-ls-ref"
METADATA = "extra/rigtwin/metadata.json"

_LS_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_LS_REF = {
    "name": "org.fmi-standard.fmi-ls-ref",
    "version": "1.0.0-alpha.1",
    "description": "Layered Standard providing information on related files included in an FMU.",
}


# -- documentation -------------------------------------------------------------------------------


def licences(packages: Sequence[str], headers: str | None = None) -> dict[str, bytes]:
    """``documentation/licenses``: rigtwin's own licence as the entry, and those of what else is in the archive.

    Parameters
    ----------
    packages : installed packages of which the FMU holds a part
    headers : text of one of FMI's headers, where the FMU holds them: its first comment is their licence
    """
    folder = "documentation/licenses"
    found = {f"{folder}/license.txt": _licence("rigtwin")}
    found |= {f"{folder}/{package}.txt": _licence(package) for package in packages}
    if headers is not None:
        text = headers[headers.index("Copyright") : headers.index("*/", headers.index("Copyright"))]
        found[f"{folder}/fmi-headers.txt"] = text.strip().encode() + b"\n"
    return found


def _licence(package: str) -> bytes:
    """Text of an installed package's licence."""
    installed = distribution(package)
    for path in installed.files or ():
        if path.name.upper().startswith("LICENSE"):
            return path.read_binary()
    (terms,) = installed.metadata.get_all("License-Expression") or ["see its own pages"]
    return f"{package} {installed.version}: {terms}\n".encode()


def external_dependencies(packages: Sequence[str]) -> dict[str, bytes]:
    """``documentation/externalDependencies.txt``; ``packages``: of the host's Python, none where it is compiled C."""
    if packages:
        text = (
            "This FMU runs in the Python of its host. The host must be a Python process or embed Python 3.11 or\n"
            f"later, with these packages: {', '.join(packages)}. Nothing is read from outside the FMU.\n"
        )
    else:
        text = (
            "This FMU needs the C library of the operating system and nothing else (on Linux glibc 2.17 or later\n"
            "where it was compiled with ziglang). Nothing is read from outside the FMU.\n"
        )
    return {"documentation/externalDependencies.txt": text.encode()}


# -- terminals and icon --------------------------------------------------------------------------


@dataclass(frozen=True)
class Terminal:
    """Variables that a wire of a diagram carries together."""

    name: str
    description: str
    members: Mapping[str, str]  # names of the variables by what they are called in the terminal


def node_terminals(model: Model) -> tuple[Terminal, ...]:
    """The exciter, and the accelerations of each node."""
    nodes = dict.fromkeys(v.name.partition(".")[0] for v in model.table if v.name.startswith("node_"))
    return (
        Terminal("exciter", "Force of the exciter", {"force": "force", "force_applied": "force_applied"}),
        *(
            Terminal(
                node,
                f"Accelerometer at node {node.removeprefix('node_')}",
                {f"acceleration_{plane}": f"{node}.acceleration_{plane}" for plane in "yz"},
            )
            for node in nodes
        ),
    )


def terminals_and_icon(terminals: Sequence[Terminal], picture: bytes) -> dict[str, bytes]:
    """``terminalsAndIcons`` of FMI 3.0."""
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    corners = {"x1": "-100", "y1": "-50", "x2": "100", "y2": "50"}
    graphics = SubElement(root, "GraphicalRepresentation")
    SubElement(graphics, "CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"})
    SubElement(graphics, "Icon", corners)
    if terminals:
        parent = SubElement(root, "Terminals")
        for terminal in terminals:
            said = {"name": terminal.name, "matchingRule": "plug", "description": terminal.description}
            element = SubElement(parent, "Terminal", said)
            for member, variable in terminal.members.items():
                attributes = {"variableName": variable, "memberName": member, "variableKind": "signal"}
                SubElement(element, "TerminalMemberVariable", attributes)
    return {"terminalsAndIcons/terminalsAndIcons.xml": _xml(root), "terminalsAndIcons/icon.png": picture}


# -- the reference run ---------------------------------------------------------------------------


@dataclass(frozen=True)
class ReferenceRun:
    """Inputs that a master sets before each step, and the outputs that it reads after the step before."""

    time: FloatArray  # (n,) [s], of equal steps
    inputs: Mapping[str, FloatArray]  # (n,) each
    outputs: Mapping[str, FloatArray]  # (n,) each; those of the first row belong to its own inputs


def references(run: ReferenceRun) -> dict[str, bytes]:
    """``extra/org.fmi-standard.fmi-ls-ref``: the run as CSV, and the manifest that says what the files are."""
    register_namespace("fmi-ls", _LS_NAMESPACE)
    root = Element("fmiReferences", {f"{{{_LS_NAMESPACE}}}fmi-ls-{key}": text for key, text in _LS_REF.items()})
    step = run.time[1] - run.time[0]
    files = (
        ("text/csv", "reference_in.csv", "testcase", f"Inputs of a run with steps of {step:g} s, set before each step"),
        ("text/csv", "reference_out.csv", "result", "Outputs of that run, read after each step before inputs are set"),
        ("application/json", "../rigtwin/metadata.json", "meta-data", "Rig, hash and range of validity"),
    )
    for kind, source, role, description in files:
        SubElement(root, "Related", {"type": kind, "source": source, "role": role, "description": description})
    return {
        f"{REFERENCES}/fmi-ls-manifest.xml": _xml(root),
        f"{REFERENCES}/reference_in.csv": _csv(run.time, run.inputs),
        f"{REFERENCES}/reference_out.csv": _csv(run.time, run.outputs),
    }


def _csv(time: FloatArray, columns: Mapping[str, FloatArray]) -> bytes:
    table = np.column_stack([time, *columns.values()])
    rows = [",".join(f"{number:.12g}" for number in row) for row in table]
    return "\n".join([",".join(["time", *columns]), *rows, ""]).encode()


def run_through(
    time: FloatArray, inputs: Mapping[str, FloatArray], outputs: Sequence[str], answer: Callable[..., Sequence[float]]
) -> ReferenceRun:
    """The reference run of a model; ``answer(time, h, values)`` sets values, goes on for h seconds and reads."""
    rows = [answer(time[0], 0.0, {name: float(values[0]) for name, values in inputs.items()})]
    for k in range(len(time) - 1):
        values = {name: float(column[k]) for name, column in inputs.items()}
        rows.append(answer(float(time[k]), float(time[k + 1] - time[k]), values))
    return ReferenceRun(time, inputs, dict(zip(outputs, np.array(rows, dtype=float).T, strict=True)))


# -- facts ---------------------------------------------------------------------------------------


def metadata(facts: Mapping[str, Any]) -> dict[str, bytes]:
    """``extra/rigtwin/metadata.json``: facts that a data base of models asks for."""
    return {METADATA: json.dumps({"schema": "rigtwin.metadata/1", **facts}, indent=1).encode()}


def sha256(content: bytes) -> str:
    """Hash of a rig or a network."""
    return hashlib.sha256(content).hexdigest()


def _xml(root: Element) -> bytes:
    indent(root, "\t")
    return tostring(root, encoding="UTF-8", xml_declaration=True)
