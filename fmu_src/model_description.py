"""The model description of an FMU, FMI 2.0 and FMI 3.0, from its variable table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from rigtwin.fmu_src.variables import DISPLAY_UNITS, UNITS, ArrayOutput, Variable

_DEFAULT_VARIABILITY = {"Real": "continuous", "Integer": "discrete", "Boolean": "discrete"}
_FMI3_TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration"}

# What an FMU tells its host, by log category; pythonfmu's FMUs tell of errors only.
LOG_CATEGORIES = {
    "logEvents": "Start, end and reset of a simulation",
    "logStatusWarning": "What was taken and has no effect",
    "logStatusError": "Why a call failed",
}
_PYTHON_CATEGORIES = ("logStatusError",)

# What every rigtwin FMU can do; the same words in both versions but for the state's.
_CAN = {"canHandleVariableCommunicationStepSize": "true", "canBeInstantiatedOnlyOncePerProcess": "false"}


@dataclass(frozen=True)
class Model:
    """An FMU as its importer sees it."""

    name: str
    guid: str
    version: str
    description: str
    step_size: float  # of the default experiment [s]
    table: tuple[Variable, ...]
    arrays: tuple[ArrayOutput, ...] = ()
    sources: tuple[str, ...] = ()  # C files, in sources/
    takes_derivatives: bool = False  # of inputs, FMI 2.0
    tolerance: float | None = None  # relative error of its outputs

    def reference(self, name: str) -> int:
        """Value reference of a variable: its place in the table, after which come the arrays, then the time."""
        names = [v.name for v in (*self.table, *self.arrays)]
        return len(names) if name == "time" else names.index(name)


def variability(variable: Variable) -> str:
    """FMI variability: as written, or what its causality and type imply."""
    if variable.variability:
        return variable.variability
    return "fixed" if variable.causality == "parameter" else _DEFAULT_VARIABILITY[variable.kind]


def fmi2(model: Model, *, needs_execution_tool: bool) -> Element:
    """FMI 2.0 model description; ``needs_execution_tool``: whether the FMU runs on the host's Python."""
    root = _root(model, "2.0", guid=model.guid, numberOfEventIndicators="0")
    co_simulation = {
        "modelIdentifier": model.name,
        "needsExecutionTool": str(needs_execution_tool).lower(),
        **_CAN,
        "canInterpolateInputs": str(model.takes_derivatives).lower(),
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
    }
    element = SubElement(root, "CoSimulation", co_simulation)
    if model.sources:
        files = SubElement(element, "SourceFiles")
        for name in model.sources:
            SubElement(files, "File", {"name": name})
    _add_frame(root, model, _PYTHON_CATEGORIES if needs_execution_tool else tuple(LOG_CATEGORIES))
    variables = SubElement(root, "ModelVariables")
    for number, variable in enumerate(model.table):
        attributes = {"name": variable.name, "valueReference": str(number), **_said(variable)}
        if variable.causality == "output":
            attributes["initial"] = "calculated"
        elif variable.causality == "parameter":
            attributes["initial"] = "exact"
        SubElement(SubElement(variables, "ScalarVariable", attributes), variable.type, _type_of(variable))
    structure = SubElement(root, "ModelStructure")
    for tag, attribute in (("Outputs", "depends_on"), ("InitialUnknowns", "initially_depends_on")):
        parent = SubElement(structure, tag)
        for output in _outputs(model):
            known = sorted(model.reference(name) + 1 for name in getattr(output, attribute))
            unknown = {"index": str(model.reference(output.name) + 1), **_dependencies(known)}
            SubElement(parent, "Unknown", unknown)
    return root


def fmi3(model: Model) -> Element:
    """FMI 3.0 model description: the same scalars with the same value references, then the arrays and the time."""
    root = _root(model, "3.0", instantiationToken=f"{{{model.guid}}}")
    co_simulation = {
        "modelIdentifier": model.name,
        "needsExecutionTool": "false",
        **_CAN,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
    }
    SubElement(root, "CoSimulation", co_simulation)
    _add_frame(root, model, tuple(LOG_CATEGORIES))
    variables = SubElement(root, "ModelVariables")
    for number, variable in enumerate(model.table):
        attributes = {"name": variable.name, "valueReference": str(number), **_said(variable), **_type_of(variable)}
        SubElement(variables, _FMI3_TYPES[variable.type], attributes)
    for array in model.arrays:
        attributes = {"name": array.name, "valueReference": str(model.reference(array.name)), "causality": "output"}
        attributes |= {"variability": "continuous", "description": array.description, "unit": array.unit}
        element = SubElement(variables, "Float64", attributes)
        for length in array.shape:
            SubElement(element, "Dimension", {"start": str(length)})
    time = {"name": "time", "valueReference": str(model.reference("time")), "causality": "independent"}
    SubElement(variables, "Float64", {**time, "variability": "continuous", "description": "Time", "unit": "s"})
    structure = SubElement(root, "ModelStructure")
    for tag, attribute in (("Output", "depends_on"), ("InitialUnknown", "initially_depends_on")):
        for output in (*_outputs(model), *model.arrays):
            like = output if isinstance(output, Variable) else _named(model, output.first)
            known = sorted(model.reference(name) for name in getattr(like, attribute))
            SubElement(structure, tag, {"valueReference": str(model.reference(output.name)), **_dependencies(known)})
    return root


def build_description(model: Model) -> Element:
    """FMI 3.0 build description: how the binary is made from the sources."""
    root = Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = SubElement(root, "BuildConfiguration", {"modelIdentifier": model.name})
    files = SubElement(configuration, "SourceFileSet", {"language": "C99"})
    for name in model.sources:
        SubElement(files, "SourceFile", {"name": name})
    return root


def _root(model: Model, version: str, **identity: str) -> Element:
    attributes = {
        "fmiVersion": version,
        "modelName": model.name,
        **identity,
        "description": model.description,
        "version": model.version,
        "license": "MIT",
        "generationTool": f"rigtwin {model.version}",
        "variableNamingConvention": "structured",
    }
    return Element("fmiModelDescription", attributes)


def _add_frame(root: Element, model: Model, log_categories: Sequence[str]) -> None:
    """What stands between the interface and the variables: units, log categories, default experiment."""
    definitions = SubElement(root, "UnitDefinitions")
    used = {v.unit for v in model.table} | ({"s"} if root.get("fmiVersion") == "3.0" else set())
    for name, exponents in UNITS.items():
        if name in used:
            unit = SubElement(definitions, "Unit", {"name": name})
            SubElement(unit, "BaseUnit", {base: str(power) for base, power in exponents.items()})
            if name in DISPLAY_UNITS:
                shown, factor = DISPLAY_UNITS[name]
                SubElement(unit, "DisplayUnit", {"name": shown, "factor": _number(factor)})
    _add_enumerations(root, model)
    categories = SubElement(root, "LogCategories")
    for name in log_categories:
        SubElement(categories, "Category", {"name": name, "description": LOG_CATEGORIES[name]})
    experiment = {"startTime": "0.0", "stopTime": "1.0", "stepSize": str(model.step_size)}
    if model.tolerance is not None:
        experiment["tolerance"] = _number(model.tolerance)
    SubElement(root, "DefaultExperiment", experiment)


def _add_enumerations(root: Element, model: Model) -> None:
    """What the values of enumerations mean."""
    if not (named := [v for v in model.table if v.labels]):
        return
    definitions = SubElement(root, "TypeDefinitions")
    for variable in named:
        if root.get("fmiVersion") == "3.0":
            items = SubElement(definitions, "EnumerationType", {"name": variable.name})
        else:
            items = SubElement(SubElement(definitions, "SimpleType", {"name": variable.name}), "Enumeration")
        for value, label in enumerate(variable.labels):
            SubElement(items, "Item", {"name": label, "value": str(value)})


def _said(variable: Variable) -> dict[str, str]:
    return {"causality": variable.causality, "variability": variability(variable), "description": variable.description}


def _type_of(variable: Variable) -> dict[str, str]:
    attributes = {"declaredType": variable.name} if variable.labels else {}
    if variable.unit:
        attributes["unit"] = variable.unit
        if variable.unit in DISPLAY_UNITS:
            attributes["displayUnit"] = DISPLAY_UNITS[variable.unit][0]
    for name, limit in (("min", variable.minimum), ("max", variable.maximum)):
        if limit is not None:
            attributes[name] = _number(limit)
    if variable.start is not None:
        start = variable.start
        attributes["start"] = str(start).lower() if isinstance(start, bool) else _number(start)
    return attributes


def _number(value: float) -> str:
    """The shortest text that reads as the same number."""
    short = f"{value:.16g}"
    return short if float(short) == value else repr(value)


def _outputs(model: Model) -> list[Variable]:
    return [v for v in model.table if v.causality == "output"]


def _named(model: Model, name: str) -> Variable:
    return model.table[model.reference(name)]


def _dependencies(known: Sequence[int]) -> dict[str, str]:
    return {"dependencies": " ".join(map(str, known)), "dependenciesKind": " ".join("dependent" for _ in known)}
