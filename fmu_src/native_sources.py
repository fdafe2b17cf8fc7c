"""The C sources of a self-contained FMU: the core in ``native/``, and what is printed for one rig.

The core is written by hand and knows rotors, not rigs. A rig's numbers, its variables and the core's
``Design`` (the test condition and every effect's parameters) are printed from the same tables that the
Python FMU is made of.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from inspect import getmodule
from pathlib import Path
from types import ModuleType

import numpy as np

from rigtwin.estimator.tracking import monitor, tracker
from rigtwin.estimator.tracking.monitor import GapMonitor
from rigtwin.estimator.tracking.reduced_rotor import ReducedRotor
from rigtwin.estimator.tracking.reduced_rotor import to_arrays as to_reduced_arrays
from rigtwin.estimator.tracking.tracker import Belief
from rigtwin.fmu_src.compiling import CompileError
from rigtwin.fmu_src.model_description import Model, variability
from rigtwin.fmu_src.monitor_variables import WALK
from rigtwin.fmu_src.rotor_variables import HELD_FORCE, effects_in_fmu
from rigtwin.fmu_src.tracker_variables import KALMAN_FILTER, NO_NETWORK, OTHER_NODE
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.effects.effect import SWITCH, Effect
from rigtwin.rotor.model import design, speed_tables, system
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import Structure, to_arrays
from rigtwin.rotor.time import exciter, nonlinear_stepper, simulator, stepper

NATIVE = Path(__file__).with_name("native")

# What every FMU has, what the rotor adds, and the shell of each FMI version.
INSTANCE = ("instance",)
TRACKER_CORE = ("linalg", "reduced_rotor", "tracker")
ROTOR_CORE = ("exciter", "laws", "linalg", "nonlinear", "rotor", "simulator", "states", "stepper")
SHELLS = {"2.0": "fmi2", "3.0": "fmi3"}

# Files that declare a function of another file themselves.
_DECLARE_THEMSELVES = ("estimator_model.c", "tracker_model.c", "monitor_model.c")

# Numbers that decide what the core computes stand in these modules and in the effects'; C leaves their underscore out.
_MODULES_WITH_CONSTANTS = (design, speed_tables, system, stepper, simulator, nonlinear_stepper, exciter)

_PRINTED = "/* Printed when the FMU was built; do not edit. */\n"


def rotor_sources(model: Model, structure: Structure, fmi: str) -> dict[str, str]:
    """C sources of ``RotorRig`` by file name, headers among them; those of FMI come from elsewhere."""
    written = _written((*INSTANCE, *ROTOR_CORE, SHELLS[fmi], "rotor_model"))
    check_core_reads_every_effect("".join(written.values()))
    printed = {"variables.c": variables_code(model), "rig.c": rig_code(model, structure)}
    return _with_names(model, {**written, **core_code(model), **printed})


def estimator_sources(model: Model, onnx_file: Path, fmi: str) -> dict[str, str]:
    """The same of ``StiffnessEstimator``. Raises ImportError without the package onnx."""
    from rigtwin.fmu_src.network_code import network_code

    network = f'{_PRINTED}#include "names.h"\n\n{network_code(onnx_file, "network")}'
    printed = {"variables.c": variables_code(model), "network.c": network}
    return _with_names(model, {**_written((*INSTANCE, SHELLS[fmi], "estimator_model")), **printed})


def tracker_sources(
    model: Model, rotor: ReducedRotor, nodes: Sequence[int], fmi: str, network: Path | None = None
) -> dict[str, str]:
    """The same of ``StiffnessTracker``, which reads the accelerations of some nodes, from 1.

    ``network`` is the ONNX file of one that knows them; with it ImportError is raised without the package onnx.
    """
    core = (*INSTANCE, *TRACKER_CORE, "tracker_network" if network else "no_network", "tracker_model")
    printed = _network_weights(network) | {
        "variables.c": variables_code(model),
        "reduced.c": reduced_code(rotor),
        "tracker_variables.h": f"{_places(model, nodes)}{_OF_TRACKER}#define HAS_NETWORK {int(network is not None)}\n",
        "constants.h": _constants_code((*TRACKER_CORE, "tracker_model"), (tracker,)),
    }
    return _with_names(model, {**_written((*core, SHELLS[fmi])), **printed})


def _network_weights(network: Path | None) -> dict[str, str]:
    if network is None:
        return {}
    from rigtwin.fmu_src.tracker_network_code import tracker_network_code

    return {"network_weights.h": _PRINTED + tracker_network_code(network)}


def monitor_sources(model: Model, rotor: ReducedRotor, nodes: Sequence[int], fmi: str) -> dict[str, str]:
    """The same of ``GapMonitor``."""
    core = (*TRACKER_CORE, "monitor", "monitor_model")
    printed = {
        "variables.c": variables_code(model),
        "reduced.c": reduced_code(rotor),
        "monitor_variables.h": _places(model, nodes) + _numbers(rotor, nodes),
        "constants.h": _constants_code(core, (tracker, monitor)),
    }
    return _with_names(model, {**_written((*INSTANCE, *core, SHELLS[fmi])), **printed})


def bearing_sources(model: Model, fmi: str) -> dict[str, str]:
    """The same of ``SofteningBearing``."""
    printed = {"variables.c": variables_code(model), "machine_variables.h": _PRINTED + _places_of_values(model)}
    return _with_names(model, {**_written((*INSTANCE, SHELLS[fmi], "bearing_model")), **printed})


def supervisor_sources(
    model: Model, ln_k: FloatArray, resonances: FloatArray, probe: tuple[FloatArray, FloatArray], fmi: str
) -> dict[str, str]:
    """The same of ``SpeedSupervisor``.

    Parameters
    ----------
    ln_k : (n,) logarithms of stiffnesses, even
    resonances : (n_resonances, n) [rad/s]
    probe : (n_lines,) frequencies [rad/s] and phases [rad]
    """
    arrays = {"RESONANCES": resonances, "PROBE_FREQUENCY": probe[0], "PROBE_PHASE": probe[1]}
    sizes = {
        "N_RESONANCES": len(resonances),
        "N_STIFFNESSES": len(ln_k),
        "N_LINES": len(probe[0]),
        "LOWEST_LN_K": _number(ln_k[0]),
        "SPACING": _number(ln_k[1] - ln_k[0]),
        "TURN": _number(2 * np.pi),
    }
    header = "".join(f"#define {name} {value}\n" for name, value in sizes.items())
    header += "".join(_array(name, values) for name, values in arrays.items())
    printed = {
        "variables.c": variables_code(model),
        "machine_variables.h": _PRINTED + _places_of_values(model) + header,
    }
    return _with_names(model, {**_written((*INSTANCE, SHELLS[fmi], "supervisor_model")), **printed})


def _places_of_values(model: Model) -> str:
    """Where inputs and parameters are among the values."""
    given = [v for v in model.table if v.causality != "output"]
    lines = [f"#define {v.name.upper()} {model.reference(v.name)}\n" for v in given]
    return "".join(lines) + f"#define N_VALUES {len(given)}\n"


def reduced_code(rotor: ReducedRotor) -> str:
    """``reduced.c``: the numbers of a reduced rotor."""
    arrays = {
        name: value for name, value in to_reduced_arrays(rotor).items() if name not in ("ln_k", "k_b", "highest_hz")
    }
    low, high = rotor.k_b.tolist()
    numbers = {
        "lowest_ln_k": rotor.ln_k[0],
        "spacing": rotor.ln_k[1] - rotor.ln_k[0],
        "least_k_b": low,
        "most_k_b": high,
        "highest_hz": rotor.highest_hz,
    }
    members = [
        f"    .r = {rotor.r},\n",
        f"    .n_nodes = {len(rotor.nodes)},\n",
        f"    .n_stiffnesses = {len(rotor.ln_k)},\n",
    ]
    members += [f"    .{name} = {_number(float(value))},\n" for name, value in numbers.items()]
    members += [f"    .{name} = {name.upper()},\n" for name in arrays]
    return f"""{_PRINTED}#include "reduced_rotor.h"

{"".join(_array(name.upper(), value) for name, value in arrays.items())}extern const ReducedRotor REDUCED;

const ReducedRotor REDUCED = {{
{"".join(members)}}};
"""


def _places(model: Model, nodes: Sequence[int]) -> str:
    """``tracker_variables.h`` or ``monitor_variables.h``: where parameters and k_b are, and which nodes are read."""
    places = [v.name for v in model.table if v.causality == "parameter" or (v.causality, v.name) == ("input", "k_b")]
    named = {"BEARING_DAMPING_AT" if name == "bearing_damping" else name.upper(): name for name in places}
    lines = [f"#define {name} {model.reference(variable)}\n" for name, variable in named.items()]
    places_of_nodes = ", ".join(str(node - 1) for node in nodes)
    lines += [f"#define N_SENSORS {len(nodes)}\n", f"#define SENSOR_NODES {{{places_of_nodes}}}\n"]
    return _PRINTED + "".join(lines)


_OF_TRACKER = (
    f'#define KALMAN_FILTER {KALMAN_FILTER}\n#define NO_NETWORK "{NO_NETWORK}"\n#define OTHER_NODE "{OTHER_NODE}"\n'
)


def _numbers(rotor: ReducedRotor, nodes: Sequence[int]) -> str:
    """The rest of ``monitor_variables.h``: what can change."""
    can_change = GapMonitor(rotor, nodes, Belief(1e6, 1.0, 1e-3)).can_change
    rows = ", ".join(f"{{{cause}, {column}}}" for cause, column in can_change)
    sizes = f"#define COORDINATES {rotor.r}\n#define N_NODES {len(rotor.nodes)}\n"
    return f"{sizes}#define NUMBERS {{{rows}}}\n#define WALK {WALK}\n"


def _with_names(model: Model, sources: dict[str, str]) -> dict[str, str]:
    """The sources with ``names.h``, by which several FMUs can be linked into one program."""
    declared = "".join(text for name, text in sources.items() if name.endswith(".h") or name in _DECLARE_THEMSELVES)
    lines = [f"#define {name} {model.name}_{name}\n" for name in shared_names(declared)]
    return {**sources, "names.h": _PRINTED + "".join(lines)}


def shared_names(declarations: str) -> list[str]:
    """Names of the functions and constants that C declarations make known to other files, sorted.

    >>> shared_names("int la_lu(int n);\\nextern const int FIRST, ROWS[];\\nstatic inline int one(void)\\n{\\n}")
    ['FIRST', 'ROWS', 'la_lu']
    """
    functions = re.findall(r"^(?!static|extern|typedef)[A-Za-z][\w ]* \*?(\w+)\([^{]*?\);$", declarations, re.MULTILINE)
    constants = ", ".join(re.findall(r"^extern const \w+ ([^;]*);", declarations, re.MULTILINE))
    return sorted({*functions, *re.findall(r"\w+(?=\[|,|$)", constants)})


def digest(sources: Mapping[str, str]) -> str:
    """SHA-256 of sources."""
    every = hashlib.sha256()
    for name in sorted(sources):
        every.update(f"{name}\n{sources[name]}".encode())
    return every.hexdigest()


def _written(names: Iterable[str]) -> dict[str, str]:
    """Hand-written sources, and every header they may include."""
    files = [*(NATIVE / f"{name}.c" for name in names), *sorted(NATIVE.glob("*.h"))]
    return {path.name: path.read_text(encoding="utf-8") for path in files}


def check_core_reads_every_effect(core: str) -> None:
    """Raises CompileError where the text of the C core does not read a parameter of an effect."""
    names = [effect.full_name(name) for effect in effects_in_fmu() for name in effect.roles()]
    unread = [name for name in names if not re.search(rf"->{re.escape(name)}\b", core)]
    if unread:
        raise CompileError(
            f"the C core does not read {', '.join(unread)}: add the line that does to {NATIVE / 'rotor.c'}, "
            "or set in_fmu = False in the effect's class"
        )


def core_code(model: Model) -> dict[str, str]:
    """What the hand-written core of a rotor needs to be compiled, by file name."""
    names = {"names.h": _PRINTED}
    return {
        **names,
        "constants.h": _constants_code(
            ROTOR_CORE, dict.fromkeys([*_MODULES_WITH_CONSTANTS, *map(getmodule, effects_in_fmu())])
        ),
        "design.h": _design_header(model),
        "design.c": _design_code(model),
    }


def _constants_code(names: Iterable[str], modules: Iterable[ModuleType | None]) -> str:
    """``constants.h``: the numbers, and rows of them, in these Python modules that the core calls by name."""
    core = "".join((NATIVE / f"{name}.c").read_text(encoding="utf-8") for name in names)
    called = set(re.findall(r"\b[A-Z]\w+", core)) - set(re.findall(r"#define (\w+)", core))
    named = [(name.lstrip("_"), value) for module in modules for name, value in vars(module).items()]
    lines = [f"#define {name} {text}\n" for name, value in named if name in called and (text := _in_c(value))]
    return _PRINTED + "".join(dict.fromkeys(lines))


def _in_c(value: object) -> str | None:
    """A number, or a row of numbers, in C; None of anything else."""
    if isinstance(value, int | float):
        return repr(value)
    is_row = isinstance(value, tuple) and all(isinstance(each, int | float) for each in value)
    return f"{{{', '.join(map(repr, value))}}}" if is_row else None  # type: ignore[arg-type]


def _design_header(model: Model) -> str:
    """``design.h``: the core's ``Design``, a struct for the test condition and one for each effect."""
    effects = effects_in_fmu()
    structs = [_struct(model, "Condition", _condition_members())]
    structs += [_struct(model, effect.__name__, map(effect.full_name, _effect_members(effect))) for effect in effects]
    members = "".join(f"    {effect.__name__} {effect.id};\n" for effect in effects)
    return f"""{_PRINTED}#ifndef RIGTWIN_DESIGN_H
#define RIGTWIN_DESIGN_H

#include "names.h"

{"".join(structs)}/* The rotor with its effects. The numbers of an effect that is off change nothing. */
typedef struct {{
    Condition condition;
{members}}} Design;

/* The design that the values of all variables stand for. */
void design_of(const double *values, Design *design);

#endif
"""


def _struct(model: Model, name: str, variables: Iterable[str]) -> str:
    members = [model.table[model.reference(variable)] for variable in variables]
    rows = [f"    {_c_type(v)} {v.name.rpartition('.')[2]}; /* {v.description} [{v.unit or '-'}] */\n" for v in members]
    return f"typedef struct {{\n{''.join(rows)}}} {name};\n\n"


def _c_type(variable: Variable) -> str:
    return "double" if variable.kind == "Real" else "int"


def _condition_members() -> list[str]:
    """The numbers of the test condition, without those that stand in an effect's struct because it can replace them."""
    replaced = {p.null for effect in effects_in_fmu() for p in effect.parameters().values()}
    return [f.name for f in fields(Condition) if f.name not in replaced]


def _effect_members(effect: type[Effect]) -> list[str]:
    """An effect's numbers, and its switch where the effect changes the size of the equations."""
    return [*([SWITCH] if effect.changes_size else []), *effect.roles()]


def _design_code(model: Model) -> str:
    """``design.c``: where the numbers of a design come from."""
    lines = [f"    design->condition.{name} = {_condition_value(model, name)};\n" for name in _condition_members()]
    for effect in effects_in_fmu():
        switch = _value(model, effect.full_name(SWITCH))
        for name in _effect_members(effect):
            full_name, neutral = effect.full_name(name), _neutral(model, effect, name)
            lines.append(f"    design->{full_name} = {switch} ? {_value(model, full_name)} : {neutral};\n")
    return f"""{_PRINTED}#include "design.h"

#include <math.h>
#include <string.h>

void design_of(const double *values, Design *design)
{{
    memset(design, 0, sizeof *design); /* designs are compared byte by byte, gaps between their members included */
{"".join(lines)}}}
"""


def _condition_value(model: Model, name: str) -> str:
    """A number of the test condition in C; an input k_b that nothing has given yet is the start value."""
    variable, value = model.table[model.reference(name)], _value(model, name)
    as_input = (name, variable.causality) == ("k_b", "input")
    return f"{value} > 0 ? {value} : {_number(variable.start or 0.0)}" if as_input else value


def _value(model: Model, name: str) -> str:
    """A variable's value in C."""
    number = model.reference(name)
    return f"values[{number}]" if model.table[number].kind == "Real" else f"(int)values[{number}]"


def _neutral(model: Model, effect: type[Effect], name: str) -> str:
    """The number of an effect that is off, in C; zero where another number of the effect decides."""
    null = effect.parameters()[name].null if name in effect.parameters() else None
    return _value(model, null) if isinstance(null, str) else _number(null or 0.0)


def variables_code(model: Model) -> str:
    """``variables.c``: the variable table."""
    rows = ",\n".join(f"    {_variable(v)}" for v in model.table)
    arrays = [f"    {{{model.reference(a.first)}, {math.prod(a.shape)}}}" for a in model.arrays]
    n_outputs = sum(v.causality == "output" for v in model.table)
    return f"""{_PRINTED}#include "model.h"

#include <math.h>

const char MODEL_NAME[] = "{model.name}", MODEL_GUID[] = "{model.guid}";

const Variable VARIABLES[] = {{
{rows},
}};

const Array ARRAYS[] = {{
{",".join(arrays) or "    {0, 0}"},
}};

const int N_VARIABLES = {len(model.table)}, N_OUTPUTS = {n_outputs}, N_ARRAYS = {len(arrays)};
"""


def _variable(variable: Variable) -> str:
    role = "OUTPUT" if variable.causality == "output" else "INPUT"
    if variable.causality == "parameter":
        role = variability(variable).upper()
    least = -math.inf if variable.minimum is None else variable.minimum
    most = math.inf if variable.maximum is None else variable.maximum
    if variable.kind == "Boolean":
        least, most = 0, 1
    unit = "" if variable.unit in (None, "1") else variable.unit
    numbers = ", ".join(_number(x) for x in (variable.start or 0.0, least, most))
    return f'{{"{variable.name}", "{unit}", {variable.kind.upper()}, {role}, {numbers}}}'


def rig_code(model: Model, structure: Structure) -> str:
    """``rig.c``: the rotor's numbers, and where the exciter's variables are."""
    arrays = to_arrays(structure)
    counts = {"n_mesh": "x", "n_nodes": "stations", "n_disks": "disk_node", "n_supports": "support_node"}
    counts |= {"n_joints": "joint_node", "n_rows": "table_support"}
    members = [f"    .{count} = {len(arrays[name])},\n" for count, name in counts.items()]
    members += [f"    .{name} = {name.upper()},\n" for name in arrays]
    driven = ("force", "force_amplitude", "force_frequency", HELD_FORCE)
    places = ", ".join(f"{name.split('.')[0].upper()} = {model.reference(name)}" for name in driven)
    return f"""{_PRINTED}#include "rotor_model.h"

#include <math.h>

{"".join(_array(name.upper(), values) for name, values in arrays.items())}const Structure STRUCTURE = {{
{"".join(members)}}};

const int {places};
"""


def _array(name: str, values: np.ndarray) -> str:
    kind, write = ("int", str) if np.issubdtype(values.dtype, np.integer) else ("double", _number)
    written = [write(x) for x in values.ravel().tolist() or [0]]
    rows = (", ".join(written[k : k + 12]) for k in range(0, len(written), 12))
    return f"static const {kind} {name}[] = {{\n    " + ",\n    ".join(rows) + ",\n};\n\n"


def _number(value: float) -> str:
    """A C double; every bit is kept."""
    value = float(value)
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return "0" if value == 0 else repr(value)


def c_files(sources: Iterable[str]) -> tuple[str, ...]:
    """Those that are compiled, headers left out."""
    return tuple(sorted(name for name in sources if name.endswith(".c")))
