"""FMUs wired into one system (SSP 1.0).

``write_system`` packs any FMUs with their connections. ``write_ssp`` is the stiffness test: the rotor on rigid
supports, the rotor on bearings, and the estimator. A master drives both rotors with one force signal, reads node
accelerations and the applied forces, and hands the shifts and the amplitude ratio that it finds to the estimator,
whose k_b leaves the system.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, register_namespace, tostring

from fmpy import read_model_description

from rigtwin.scratch import replacing

_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
_TYPES = {"Float64": "Real", "Int32": "Integer", "Enumeration": "Integer"}  # of FMI, where SSP has another name
STIFFNESS_TEST = "StiffnessTest"
START_VALUES = "start_values"  # name of the parameter set
RIGS = ("rigid", "bearing")


@dataclass(frozen=True)
class Component:
    """One FMU of a system."""

    name: str
    fmu: Path
    starts: Mapping[str, bool | float] = field(default_factory=dict)  # by variable
    shown: Sequence[str] = ()  # outputs that masters log though no link needs them

    @cached_property
    def variables(self) -> dict[str, tuple[str, str]]:
        """Kind of connector and SSP's type, by variable."""
        read = read_model_description(str(self.fmu)).modelVariables
        return {v.name: (v.causality, _TYPES.get(v.type, v.type)) for v in read}


@dataclass(frozen=True)
class Link:
    """What gives a value to what. A component that is None is the system itself, whose connectors appear with it."""

    start: str | None  # component
    output: str
    end: str | None  # component
    input: str


def write_system(name: str, components: Sequence[Component], links: Sequence[Link], target: Path) -> Path:
    """Write a system of FMUs, beside and renamed.

    Parameters
    ----------
    name : of the system
    components : FMUs; several may share one file, whose name is then the same
    links : connections, at least one for each connector of the system
    target : path of the .ssp file

    Raises
    ------
    ValueError : a link names no component, or a variable that it does not have; two FMUs have one file name
    """
    for each, namespace in (("ssc", _SSC), ("ssd", _SSD), ("ssv", _SSV)):
        register_namespace(each, namespace)
    by_name = {component.name: component for component in components}
    for place, port in (end for k in links for end in ((k.start, k.output), (k.end, k.input)) if end[0] is not None):
        _type_of(place, port, by_name)
    root = Element(f"{{{_SSD}}}SystemStructureDescription", {"name": name, "version": "1.0"})
    system = SubElement(root, f"{{{_SSD}}}System", {"name": name})
    _add_connectors(system, _connectors(None, links, by_name))
    elements = SubElement(system, f"{{{_SSD}}}Elements")
    for component in components:
        _add_component(elements, component, _connectors(component.name, links, by_name))
    connections = SubElement(system, f"{{{_SSD}}}Connections")
    for link in links:
        SubElement(connections, f"{{{_SSD}}}Connection", _attributes(link))
    indent(root)
    fmus = list(dict.fromkeys(component.fmu for component in components))
    if len({fmu.name for fmu in fmus}) < len(fmus):
        raise ValueError("two FMUs of the system have the same file name; rename one of them")
    with replacing(target) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SystemStructure.ssd", tostring(root, encoding="UTF-8", xml_declaration=True))
        for fmu in fmus:
            archive.write(fmu, f"resources/{fmu.name}")
    return target


def write_ssp(
    rotor_fmu: Path,
    estimator_fmu: Path,
    target: Path,
    nodes: Sequence[int] = (2,),
    *,
    closed: bool = False,
    starts: Mapping[str, Mapping[str, float]] | None = None,
) -> Path:
    """Write the stiffness test.

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
    rotors = [
        Component(rig, rotor_fmu, {"rigid_support": rig == "rigid", **(starts or {}).get(rig, {})}) for rig in RIGS
    ]
    estimator = Component("estimator", estimator_fmu)
    links = [Link(RIGS[0], "force_applied", RIGS[1], "force")] if closed else _ports(estimator, nodes)
    return write_system(STIFFNESS_TEST, [*rotors, estimator], links, target)


def _ports(estimator: Component, nodes: Sequence[int]) -> list[Link]:
    """Connections of the stiffness test with the world."""
    links = []
    for rig in RIGS:
        links.append(Link(None, "force", rig, "force"))
        links += [Link(rig, f"node_{n}.acceleration_y", None, f"{rig}_node_{n}") for n in nodes]
        links.append(Link(rig, "force_applied", None, f"{rig}_force"))
    for name, (kind, _) in estimator.variables.items():
        if kind == "input":
            links.append(Link(None, name, estimator.name, name))
        elif kind == "output":
            links.append(Link(estimator.name, name, None, name))
    return links


def _connectors(
    owner: str | None, links: Sequence[Link], components: Mapping[str, Component]
) -> dict[str, tuple[str, str]]:
    """Kind and type of every connector of a component, or of the system, by name and in the order of the links."""
    found = {}
    for link in links:
        ends = (link.start, link.output), (link.end, link.input)
        for (place, port), (other, there), kind in zip(ends, reversed(ends), ("output", "input"), strict=True):
            if place != owner:
                continue
            if owner is None:  # what the system is given is what a component takes
                found[port] = "input" if kind == "output" else "output", _type_of(other, there, components)
            else:
                found[port] = kind, _type_of(owner, port, components)
    shown = components[owner].shown if owner is not None else ()
    return found | {name: ("output", _type_of(owner, name, components)) for name in shown}


def _type_of(component: str | None, variable: str, components: Mapping[str, Component]) -> str:
    """SSP's type of a component's variable."""
    if component is None or component not in components:
        raise ValueError(f"a link names {component}, which is no component")
    variables = components[component].variables
    if variable not in variables:
        raise ValueError(f"{component} has no variable {variable}")
    return variables[variable][1]


def _attributes(link: Link) -> dict[str, str]:
    """Of a connection; no element means the system's own connector."""
    found = {"startConnector": link.output, "endConnector": link.input}
    if link.start:
        found["startElement"] = link.start
    if link.end:
        found["endElement"] = link.end
    return found


def _add_component(elements: Element, component: Component, ports: Mapping[str, tuple[str, str]]) -> None:
    """One FMU with its connectors, and with start values for importers that read them (fmpy wants them passed)."""
    source = f"resources/{component.fmu.name}"
    attributes = {"name": component.name, "type": "application/x-fmu-sharedlibrary", "source": source}
    element = SubElement(elements, f"{{{_SSD}}}Component", attributes)
    _add_connectors(element, ports)
    if not component.starts:
        return
    binding = SubElement(SubElement(element, f"{{{_SSD}}}ParameterBindings"), f"{{{_SSD}}}ParameterBinding")
    values = SubElement(binding, f"{{{_SSD}}}ParameterValues")
    parameter_set = SubElement(values, f"{{{_SSV}}}ParameterSet", {"name": START_VALUES, "version": "1.0"})
    parameters = SubElement(parameter_set, f"{{{_SSV}}}Parameters")
    for name, value in component.starts.items():
        parameter = SubElement(parameters, f"{{{_SSV}}}Parameter", {"name": name})
        kind = "Boolean" if isinstance(value, bool) else "Real"
        SubElement(parameter, f"{{{_SSV}}}{kind}", {"value": str(value).lower()})


def _add_connectors(parent: Element, ports: Mapping[str, tuple[str, str]]) -> None:
    if not ports:
        return
    connectors = SubElement(parent, f"{{{_SSD}}}Connectors")
    for name, (kind, type_name) in ports.items():
        connector = SubElement(connectors, f"{{{_SSD}}}Connector", {"name": name, "kind": kind})
        SubElement(connector, f"{{{_SSC}}}{type_name}")
