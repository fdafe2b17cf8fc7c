"""The C sources of a self-contained FMU: the core in ``native/``, and what is printed for one rig.

The core is written by hand and knows rotors, not rigs. A rig's numbers, its variables, and which
variable is which word of the core's ``Design`` are printed from the same tables that the Python
FMU is made of.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np

from rigtwin.fmu_src.compiling import CompileError
from rigtwin.fmu_src.model_description import Model, variability
from rigtwin.fmu_src.rotor_variables import effects_in_fmu
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.effects import nonlinear, supports
from rigtwin.rotor.effects.effect import SWITCH
from rigtwin.rotor.model import design, system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.time import nonlinear_stepper, simulator, stepper

NATIVE = Path(__file__).with_name("native")

# What every FMU has, what the rotor adds, and the shell of each FMI version.
INSTANCE = ("instance",)
ROTOR_CORE = ("laws", "linalg", "nonlinear", "rotor", "simulator", "states", "stepper")
SHELLS = {"2.0": "fmi2", "3.0": "fmi3"}

# Words of the core's ``Design``: the rotor's own parameters, by the same names, and those of every effect's.
CONDITION_WORDS = (
    "spin_speed", "k_b", "bearing_damping", "shaft_damping_ratio",
    "rigid_support", "excitation_node", "excitation_plane",
)  # fmt: skip
EFFECT_WORDS = {
    "attached_mass": {"mass": "mass[0]", "half_width": "mass_half_width[0]", "node": "mass_node[0]"},
    "sensor_mass": {"mass": "mass[1]", "node": "mass_node[1]"},
    "exciter_suspension": {"stiffness": "ground_stiffness", "damping": "ground_damping"},
    "disk_mass": {"change": "disk_mass_change"},
    "disk_inertia": {"factor": "disk_inertia_factor"},
    "hub_stiffening": {"factor": "hub_factor"},
    "shaft_modulus": {"factor": "modulus_factor"},
    "axial_load": {"force": "tension"},
    "open_crack": {"reduction": "crack_lost", "position": "crack_position"},
    "shaft_damping": {"damping_ratio": "shaft_damping_ratio"},
    "bearing_damping": {"damping": "bearing_damping"},
    "bearing_tilt_stiffness": {"stiffness": "tilt_stiffness"},
    "pedestal_flexibility": {
        SWITCH: "has_pedestal",
        "stiffness": "pedestal_stiffness",
        "mass": "pedestal_mass",
        "damping": "pedestal_damping",
        "block_compliance": "block_compliance",
        "block_mass": "block_mass",
    },
    "bearing_asymmetry": {"asymmetry": "asymmetry"},
    "bearing_offset": {"offset": "offset"},
    "compliant_rigid_support": {"stiffness": "rigid_stiffness"},
    "plane_anisotropy": {"anisotropy": "anisotropy", "angle": "anisotropy_angle"},
    "viscoelastic_support": {
        SWITCH: "has_branch",
        "strength": "branch_strength",
        "relaxation_time": "branch_time",
        "spread": "branch_spread",
    },
    "gyroscopic": {"factor": "gyroscopic_factor"},
    "sensor_position": {"offset": "sensor_offset", "node": "sensor_node"},
    "bearing_cubic": {"stiffness": "cubic_stiffness"},
    "bearing_hertz": {"preload": "hertz_preload"},
    "bearing_clearance": {"gap": "clearance_gap", "preload": "clearance_preload"},
    "bearing_friction": {"force": "friction_force", "stiffness": "friction_stiffness", "spread": "friction_spread"},
    "bilinear_support": {"ratio": "bilinear_ratio"},
    "rub": {"stiffness": "rub_stiffness", "gap": "rub_gap", "node": "rub_node"},
    "unbalance": {"node": "unbalance_node", "moment": "unbalance_moment", "phase": "unbalance_phase"},
}

# Numbers that decide what the core computes, where they are written in Python; C knows them without an underscore.
_CONSTANTS: tuple[tuple[ModuleType, tuple[str, ...]], ...] = (
    (design, ("CRACK_LENGTH", "WEAKEST_BRANCH", "GROUND_COMPLIANCE")),
    (supports, ("BRANCHES",)),
    (nonlinear, ("SHARP", "SHARP_LENGTH", "SEAT_PARTS")),
    (system, ("_NO_STRAIN",)),
    (stepper, ("_NO_STEADY_STATE",)),
    (simulator, ("TICKS_PER_SECOND", "_SAME_TIME", "_LAST_TIME")),
    (
        nonlinear_stepper,
        (
            "FORCE_ERROR", "_BEND", "_UNNOTICED", "_VELOCITY_CHANGE", "_STIFFNESS", "_EASY", "_PER_PERIOD",
            "_PERIODS_KEPT", "_SUBSTEPS_BETWEEN", "_FIRST", "_SHORTEST", "_MOST_SUBSTEPS", "_NEWTON_SHARE",
            "_NEWTON_RELATIVE", "_NEWTON_STEPS", "_ROUND_OFF", "_STRAIGHT", "_CENTRE",
        ),
    ),
)  # fmt: skip

_PRINTED = "/* Printed when the FMU was built; do not edit. */\n"


def rotor_sources(model: Model, structure: Structure, fmi: str) -> dict[str, str]:
    """C sources of ``RotorRig`` by file name, headers among them; those of FMI come from elsewhere."""
    names = (*INSTANCE, *ROTOR_CORE, SHELLS[fmi])
    printed = {
        "constants.h": constants_code(),
        "variables.c": variables_code(model),
        "rig.c": rig_code(model, structure),
    }
    return {**_written((*names, "rotor_model")), **printed}


def estimator_sources(model: Model, onnx_file: Path, fmi: str) -> dict[str, str]:
    """The same of ``StiffnessEstimator``. Raises ImportError without the package onnx."""
    from rigtwin.fmu_src.network_code import network_code

    printed = {"variables.c": variables_code(model), "network.c": _PRINTED + network_code(onnx_file, "network")}
    return {**_written((*INSTANCE, SHELLS[fmi], "estimator_model")), **printed}


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


def constants_code() -> str:
    """``constants.h``: the core's numbers."""
    named = [(name.lstrip("_"), getattr(module, name)) for module, names in _CONSTANTS for name in names]
    return _PRINTED + "".join(f"#define {name} {value!r}\n" for name, value in named)


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
    """``rig.c``: the rotor's numbers, and the design that its variables' values stand for."""
    s = structure
    doubles = {
        "M": s.M, "K": s.K, "G": s.G, "K_TENSION": s.K_tension, "X": s.x,
        "BENDING": s.bending_stiffness, "SHEAR": s.shear_stiffness, "DIAMETER": s.diameter,
        "DISK_MASS": s.disk_mass, "DISK_THICKNESS": s.disk_thickness,
        "DISK_DIAMETRAL": s.disk_lumped_diametral, "DISK_POLAR": s.disk_lumped_polar,
        "SUPPORT_STIFFNESS": s.support_stiffness, "SUPPORT_TILT": s.support_tilt_stiffness,
        "SUPPORT_DAMPING": s.support_damping,
    }  # fmt: skip
    ints = {"STATIONS": s.stations, "DISK_NODE": s.disk_node, "SUPPORT_NODE": s.support_node}
    arrays = [_array("double", name, values) for name, values in doubles.items()]
    arrays += [_array("int", name, values) for name, values in ints.items()]
    force = ", ".join(f"{name.upper()} = {model.reference(name)}" for name in _EXCITER)
    return f"""{_PRINTED}#include "rotor_model.h"

#include <math.h>

{"".join(arrays)}
const Structure STRUCTURE = {{
    {len(s.x)}, {s.n_nodes}, {len(s.disk_node)}, {len(s.support_node)},
    M, K, G, K_TENSION, X, STATIONS, BENDING, SHEAR, DIAMETER,
    DISK_NODE, DISK_MASS, DISK_THICKNESS, DISK_DIAMETRAL, DISK_POLAR,
    SUPPORT_NODE, SUPPORT_STIFFNESS, SUPPORT_TILT, SUPPORT_DAMPING,
}};

const int {force};

void design_of(const double *values, Design *design)
{{
    design_nominal(design);
{_design_lines(model)}}}
"""


_EXCITER = ("force", "force_amplitude", "force_frequency")


def _design_lines(model: Model) -> str:
    """Assignments to the design; an effect's, where it is switched on."""
    lines = [_assignment(model, name, name, "    ") for name in CONDITION_WORDS]
    for effect in effects_in_fmu():
        lines.append(f"    if (values[{model.reference(effect.full_name(SWITCH))}] != 0) {{\n")
        if effect.id not in EFFECT_WORDS:
            raise CompileError(f"the effect {effect.id} has no words in C: give them in EFFECT_WORDS, {__name__}")
        words = EFFECT_WORDS[effect.id].items()
        lines += [_assignment(model, effect.full_name(name), word, "        ") for name, word in words]
        lines.append("    }\n")
    return "".join(lines)


def _assignment(model: Model, name: str, word: str, indent: str) -> str:
    number = model.reference(name)
    cast = "" if model.table[number].kind == "Real" else "(int)"
    return f"{indent}design->{word} = {cast}values[{number}]; /* {name} */\n"


def _array(kind: str, name: str, values: np.ndarray) -> str:
    flat = np.asarray(values).ravel().tolist() or [0]
    written = [_number(x) for x in flat] if kind == "double" else [str(int(x)) for x in flat]
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
