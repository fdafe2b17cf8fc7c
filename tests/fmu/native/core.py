"""The C core in a shared library, as ctypes sees it; its structs are read from its headers."""

from __future__ import annotations

import ctypes as ct
import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.fmu_src.compiling import compiler, this_machine
from rigtwin.fmu_src.model_description import Model
from rigtwin.fmu_src.native_sources import NATIVE, ROTOR_CORE, core_code
from rigtwin.fmu_src.rotor_variables import RotorFacts, rotor_variables
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import Structure as PythonStructure
from rigtwin.rotor.model.structure import to_arrays

DOUBLES, INTS = ct.POINTER(ct.c_double), ct.POINTER(ct.c_int)

# The core is printed for the variables of this rig; other rigs have the same parameters in the same places.
FACTS = RotorFacts(
    n_nodes=7,
    excitation_node=2,
    shaft_damping_ratio=0.001,
    bearing_damping=0.0,
    k_b_start=1e7,
    k_b_min=1e4,
    k_b_max=1e12,
    length=0.426,
)


@dataclass(frozen=True)
class Library:
    """The compiled core, the model whose variables make its designs, and its structs by name."""

    functions: ct.CDLL
    model: Model
    structs: Mapping[str, type[ct.Structure]]


def compiled(folder: Path, changed: Mapping[str, str] | None = None) -> Library:
    """The core, compiled without a warning and without fused operations: sums are those of numpy.

    Parameters
    ----------
    folder : where it is compiled
    changed : texts of C files that take the place of the core's own, by name
    """
    command = compiler(this_machine())
    flags = ["-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-shared", "-fPIC"]
    library, model = folder / "core.so", Model("RotorRig", "", "", "", 1.0, rotor_variables(FACTS))
    sources = {path.name: path.read_text(encoding="utf-8") for path in NATIVE.glob("*.[ch]")}
    sources |= {**(changed or {}), **core_code(model)}
    for name, text in sources.items():
        (folder / name).write_text(text, encoding="utf-8")
    files = [str(folder / f"{name}.c") for name in (*ROTOR_CORE, "design")]
    subprocess.run([*command, *flags, *files, "-o", str(library), "-lm"], check=True)
    structs = structs_of(sources["design.h"] + sources["rotor.h"])
    return Library(with_types(ct.CDLL(str(library))), model, structs)


def with_types(core: ct.CDLL) -> ct.CDLL:
    """The functions with what they take and return."""
    core.simulator_new.restype = ct.c_void_p
    for name in ("simulator_configure", "simulator_advance", "simulator_start_at", "simulator_restore", "system_build"):
        getattr(core, name).restype = ct.c_char_p
    core.simulator_time.restype = ct.c_double
    core.simulator_free.argtypes = [ct.c_void_p]
    core.simulator_time.argtypes = [ct.c_void_p]
    core.simulator_snapshot_size.argtypes = [ct.c_void_p]
    core.simulator_configure.argtypes = [ct.c_void_p, ct.c_void_p]
    core.simulator_advance.argtypes = [ct.c_void_p, ct.c_double, ct.c_double]
    core.simulator_hold.argtypes = [ct.c_void_p, ct.c_int]
    core.simulator_drive.argtypes = [ct.c_void_p, *[ct.c_double] * 3]
    for name in ("simulator_accelerations", "simulator_save"):
        getattr(core, name).argtypes = [ct.c_void_p, DOUBLES]
    core.simulator_restore.argtypes = [ct.c_void_p, ct.c_void_p, DOUBLES, ct.c_int]
    return core


def structs_of(header: str) -> dict[str, type[ct.Structure]]:
    """Every ``typedef struct { ... } Name;`` of a C header without nested structs, as a ctypes class by name."""
    types: dict[str, Any] = {"int": ct.c_int, "double": ct.c_double}
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    for body, name in re.findall(r"typedef struct \{(.*?)\} (\w+);", text, flags=re.DOTALL):
        members = []
        for declaration in body.split(";")[:-1]:
            kind, names = declaration.replace("const ", "").split(maxsplit=1)
            members += [_member(types[kind], one.strip()) for one in names.split(",")]
        types[name] = type(name, (ct.Structure,), {"_fields_": members})
    return types


def _member(kind: Any, declared: str) -> tuple[str, Any]:
    """Name and type of ``x``, ``*x`` or ``x[3]``."""
    pointer, name, count = re.fullmatch(r"(\*?)(\w+)(?:\[(\d+)\])?", declared).groups()
    kind = ct.POINTER(kind) if pointer else kind
    return name, kind * int(count) if count else kind


class Core:
    """The library for one structure.

    Parameters
    ----------
    library : of ``compiled``
    structure : the rotor
    """

    def __init__(self, library: Library, structure: PythonStructure):
        self.compiled, self.library, self._kept = library, library.functions, []
        s, Structure = structure, library.structs["Structure"]
        types = dict(Structure._fields_)
        arrays = {name: self._pointer(values, types[name]) for name, values in to_arrays(structure).items()}
        counts = {
            "n_mesh": len(s.x),
            "n_nodes": s.n_nodes,
            "n_disks": len(s.disk_node),
            "n_supports": len(s.support_node),
            "n_joints": len(s.joint_node),
            "n_rows": len(s.table_support),
        }
        assert {*arrays, *counts} == {*types}
        self.structure = Structure(**arrays, **counts)

    def _pointer(self, values: np.ndarray, kind: Any) -> Any:
        self._kept.append(np.ascontiguousarray(values, dtype=np.int32 if kind is INTS else float))
        return self._kept[-1].ctypes.data_as(kind)

    def design(
        self, condition: Condition, effects: Sequence[Effect], others: Mapping[str, float] | None = None
    ) -> ct.Structure:
        """The C core's design for a condition, effects and other values of the FMU's variables, as the FMU makes it."""
        values = {v.name: v.start or 0.0 for v in self.compiled.model.table} | vars(condition)
        for effect in effects:
            values |= effect.start_values()
        values |= others or {}
        design = self.compiled.structs["Design"]()
        self.library.design_of((ct.c_double * len(values))(*values.values()), ct.byref(design))
        return design

    def system(self, design: ct.Structure) -> dict[str, Any]:
        """The matrices of a design, which degrees of freedom they stand for, and the local forces' numbers."""
        sizes = n_doubles, n_ints, n_forces = ct.c_int(), ct.c_int(), ct.c_int()
        self.library.system_memory(ct.byref(self.structure), *map(ct.byref, sizes))
        doubles, ints = np.zeros(n_doubles.value), np.zeros(n_ints.value, dtype=np.int32)
        structs = self.compiled.structs
        system, forces = structs["System"](), (structs["LocalForce"] * n_forces.value)()
        system.forces = forces
        wrong = self.library.system_build(
            ct.byref(system), ct.byref(self.structure), ct.byref(design),
            doubles.ctypes.data_as(DOUBLES), ints.ctypes.data_as(INTS),
        )  # fmt: skip
        assert wrong is None, wrong
        n = system.n
        found = {k: np.ctypeslib.as_array(getattr(system, k), (n, n)).copy() for k in ("M", "K", "C", "G", "K_shaft")}
        found |= {k: np.ctypeslib.as_array(getattr(system, k), (n,)).copy() for k in ("free", "plane")}
        found["forces"] = [
            (f.law, tuple(f.coefficients), f.offset, np.array([np.ctypeslib.as_array(row, (n,)) for row in (f.y, f.z)]))
            for f in forces[: system.n_forces]
        ]
        return found


class Rotor:
    """A rotor that lives in the core, with the words of ``RotorSimulator``."""

    def __init__(self, core: Core, condition: Condition, effects: Sequence[Effect] = ()):
        self._core, self._library = core, core.library
        self._simulator = self._library.simulator_new(ct.byref(core.structure))
        assert self._simulator
        self.configure(condition, effects)

    def __del__(self) -> None:
        self._library.simulator_free(self._simulator)

    def configure(self, condition: Condition, effects: Sequence[Effect] = ()) -> None:
        """As RotorSimulator's. Raises ValueError."""
        self.use(self._core.design(condition, effects))

    def use(self, design: ct.Structure) -> None:
        """Be this design. Raises ValueError."""
        self._checked(self._library.simulator_configure(self._simulator, ct.byref(design)))
        self._design = design

    def drive(self, *, force: float, force_amplitude: float, force_frequency: float, hold_force: bool = False) -> None:
        """As RotorSimulator's."""
        self._library.simulator_hold(self._simulator, hold_force)
        self._library.simulator_drive(self._simulator, force, force_amplitude, force_frequency)

    def advance(self, time: float, step: float) -> None:
        """As RotorSimulator's. Raises ValueError."""
        self._checked(self._library.simulator_advance(self._simulator, time, step))

    @property
    def time(self) -> float:
        """Time the rotor stands at [s]."""
        return self._library.simulator_time(self._simulator)

    def accelerations(self) -> FloatArray:
        """(2 n_nodes,)"""
        found = np.zeros(2 * self._core.structure.n_nodes)
        self._library.simulator_accelerations(self._simulator, found.ctypes.data_as(DOUBLES))
        return found

    def snapshot(self) -> FloatArray:
        """Everything that is needed to go on from here."""
        found = np.zeros(self._library.simulator_snapshot_size(self._simulator))
        self._library.simulator_save(self._simulator, found.ctypes.data_as(DOUBLES))
        return found

    def restore(self, snapshot: FloatArray) -> None:
        """Go back to a snapshot under the same design."""
        values = snapshot.ctypes.data_as(DOUBLES)
        self._checked(self._library.simulator_restore(self._simulator, ct.byref(self._design), values, len(snapshot)))

    @staticmethod
    def _checked(wrong: bytes | None) -> None:
        if wrong:
            raise ValueError(wrong.decode())
