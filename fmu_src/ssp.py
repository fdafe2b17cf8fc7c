"""Both FMUs wired into one system (SSP 1.0): the rotor on rigid supports, on bearings, the estimator.

A master drives both rotors with one force signal, reads node accelerations and the applied forces,
and hands the shifts and the amplitude ratio it finds to the estimator, whose k_b leaves the system.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, register_namespace, tostring

from fmpy import read_model_description

_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
SYSTEM_NAME = "StiffnessTest"
RIGS = ("rigid", "bearing")


def write_ssp(
    rotor_fmu: Path,
    estimator_fmu: Path,
    target: Path,
    nodes: Sequence[int] = (2,),
    *,
    closed: bool = False,
    starts: Mapping[str, Mapping[str, float]] | None = None,
) -> Path:
    """Write the system, beside and renamed.

    Its inputs are ``force`` and the estimator's inputs; its outputs ``<rig>_node_<n>`` and
    ``<rig>_force`` for both rigs, and the estimator's outputs. A closed system, for masters that
    know no ports of a system, has none of these: the first rotor's own sine drives the second one
    as well, and every FMU's outputs are read where they are.

    Parameters
    ----------
    rotor_fmu, estimator_fmu : the FMUs to pack
    target : path of the .ssp file
    nodes : accelerometers in the y plane
    closed : without ports of its own
    starts : start values by rotor ("rigid", "bearing") and variable; Real ones
    """
    for name, prefix in (("ssc", _SSC), ("ssd", _SSD), ("ssv", _SSV)):
        register_namespace(name, prefix)
    root = Element(f"{{{_SSD}}}SystemStructureDescription", {"name": SYSTEM_NAME, "version": "1.0"})
    system = SubElement(root, f"{{{_SSD}}}System", {"name": SYSTEM_NAME})
    ports, links = _wiring(estimator_fmu, nodes)
    if closed:
        links = [_link(RIGS[0], "force_applied", RIGS[1], "force")]
    else:
        _add_connectors(system, ports)
    elements = SubElement(system, f"{{{_SSD}}}Elements")
    for rig in RIGS:
        outputs = [(f"node_{n}.acceleration_y", "output", "Real") for n in nodes] + [
            ("force_applied", "output", "Real")
        ]
        component = _component(elements, rig, rotor_fmu.name, [("force", "input", "Real"), *outputs])
        _bind(component, {"rigid_support": rig == "rigid", **(starts or {}).get(rig, {})})
    _component(elements, "estimator", estimator_fmu.name, _estimator_ports(estimator_fmu))
    connections = SubElement(system, f"{{{_SSD}}}Connections")
    for link in links:
        SubElement(connections, f"{{{_SSD}}}Connection", link)
    indent(root)
    beside = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("SystemStructure.ssd", tostring(root, encoding="UTF-8", xml_declaration=True))
            for fmu in (rotor_fmu, estimator_fmu):
                archive.write(fmu, f"resources/{fmu.name}")
        os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)
    return target


def _estimator_ports(estimator_fmu: Path) -> list[tuple[str, str, str]]:
    variables = read_model_description(str(estimator_fmu)).modelVariables
    return [(v.name, v.causality, v.type) for v in variables]


def _wiring(estimator_fmu: Path, nodes: Sequence[int]) -> tuple[list[tuple[str, str, str]], list[dict[str, str]]]:
    """System connectors, and the connections between them and the components."""
    ports = [("force", "input", "Real")]
    links = []
    for rig in RIGS:
        links.append(_link(None, "force", rig, "force"))
        outputs = [(f"{rig}_node_{n}", f"node_{n}.acceleration_y") for n in nodes] + [(f"{rig}_force", "force_applied")]
        for port, variable in outputs:
            ports.append((port, "output", "Real"))
            links.append(_link(rig, variable, None, port))
    for name, kind, fmi_type in _estimator_ports(estimator_fmu):
        ports.append((name, kind, fmi_type))
        links.append(_link(None, name, "estimator", name) if kind == "input" else _link("estimator", name, None, name))
    return ports, links


def _link(start: str | None, start_port: str, end: str | None, end_port: str) -> dict[str, str]:
    """Attributes of a connection; no element means the system's own connector."""
    link = {"startConnector": start_port, "endConnector": end_port}
    if start:
        link["startElement"] = start
    if end:
        link["endElement"] = end
    return link


def _component(elements: Element, name: str, fmu: str, ports: Sequence[tuple[str, str, str]]) -> Element:
    attributes = {"name": name, "type": "application/x-fmu-sharedlibrary", "source": f"resources/{fmu}"}
    component = SubElement(elements, f"{{{_SSD}}}Component", attributes)
    _add_connectors(component, ports)
    return component


def _add_connectors(parent: Element, ports: Sequence[tuple[str, str, str]]) -> None:
    connectors = SubElement(parent, f"{{{_SSD}}}Connectors")
    for name, kind, fmi_type in ports:
        connector = SubElement(connectors, f"{{{_SSD}}}Connector", {"name": name, "kind": kind})
        SubElement(connector, f"{{{_SSC}}}{fmi_type}")


def _bind(component: Element, values: Mapping[str, bool | float]) -> None:
    """Inline parameter values, for importers that read them (fmpy wants them passed as well)."""
    binding = SubElement(SubElement(component, f"{{{_SSD}}}ParameterBindings"), f"{{{_SSD}}}ParameterBinding")
    values_element = SubElement(binding, f"{{{_SSD}}}ParameterValues")
    parameter_set = SubElement(values_element, f"{{{_SSV}}}ParameterSet", {"name": "support", "version": "1.0"})
    parameters = SubElement(parameter_set, f"{{{_SSV}}}Parameters")
    for name, value in values.items():
        parameter = SubElement(parameters, f"{{{_SSV}}}Parameter", {"name": name})
        kind = "Boolean" if isinstance(value, bool) else "Real"
        SubElement(parameter, f"{{{_SSV}}}{kind}", {"value": str(value).lower()})
