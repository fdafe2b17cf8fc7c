"""The C core in a shared library, as ctypes sees it."""

from __future__ import annotations

import ctypes as ct
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.fmu_src.compiling import compiler, this_machine
from rigtwin.fmu_src.native_sources import CONDITION_WORDS, EFFECT_WORDS, NATIVE, ROTOR_CORE, constants_code
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.effects.effect import SWITCH
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import FloatArray, IntArray
from rigtwin.rotor.model.structure import Structure as PythonStructure

DOUBLES, INTS = ct.POINTER(ct.c_double), ct.POINTER(ct.c_int)


def compiled(folder: Path) -> ct.CDLL:
    """The core, compiled without a warning and without fused operations: sums are those of numpy."""
    command = compiler(this_machine())
    flags = ["-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-shared", "-fPIC"]
    library = folder / "core.so"
    (folder / "constants.h").write_text(constants_code(), encoding="utf-8")
    sources = [str(NATIVE / f"{name}.c") for name in ROTOR_CORE]
    subprocess.run([*command, *flags, f"-I{folder}", *sources, "-o", str(library), "-lm"], check=True)
    core = ct.CDLL(str(library))
    core.simulator_new.restype = ct.c_void_p
    for name in ("simulator_configure", "simulator_advance", "simulator_start_at", "simulator_restore", "system_build"):
        getattr(core, name).restype = ct.c_char_p
    core.simulator_time.restype = ct.c_double
    core.simulator_free.argtypes = [ct.c_void_p]
    core.simulator_time.argtypes = [ct.c_void_p]
    core.simulator_snapshot_size.argtypes = [ct.c_void_p]
    core.simulator_configure.argtypes = [ct.c_void_p, ct.c_void_p]
    core.simulator_advance.argtypes = [ct.c_void_p, ct.c_double, ct.c_double]
    core.simulator_drive.argtypes = [ct.c_void_p, *[ct.c_double] * 3]
    for name in ("simulator_accelerations", "simulator_save"):
        getattr(core, name).argtypes = [ct.c_void_p, DOUBLES]
    core.simulator_restore.argtypes = [ct.c_void_p, ct.c_void_p, DOUBLES, ct.c_int]
    return core


def _fields(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


class Structure(ct.Structure):
    """``Structure`` of rotor.h."""

    _fields_ = [
        *_fields(ct.c_int, "n_mesh n_nodes n_disks n_supports"),
        *_fields(DOUBLES, "M K G K_tension x"),
        *_fields(INTS, "stations"),
        *_fields(DOUBLES, "bending shear diameter"),
        *_fields(INTS, "disk_node"),
        *_fields(DOUBLES, "disk_mass disk_thickness disk_lumped_diametral disk_lumped_polar"),
        *_fields(INTS, "support_node"),
        *_fields(DOUBLES, "support_stiffness support_tilt_stiffness support_damping"),
    ]


class Design(ct.Structure):
    """``Design`` of rotor.h."""

    _fields_ = [
        *_fields(ct.c_double, "k_b bearing_damping shaft_damping_ratio spin_speed"),
        *_fields(ct.c_int, "rigid_support excitation_node excitation_plane"),
        *_fields(ct.c_double, "modulus_factor hub_factor crack_position crack_lost tension"),
        *_fields(ct.c_double, "disk_mass_change disk_inertia_factor gyroscopic_factor"),
        *_fields(ct.c_int * 2, "mass_node"),
        *_fields(ct.c_double * 2, "mass mass_half_width"),
        *_fields(ct.c_int, "sensor_node"),
        *_fields(ct.c_double, "sensor_offset ground_stiffness ground_damping rigid_stiffness tilt_stiffness"),
        *_fields(ct.c_int, "has_pedestal"),
        *_fields(ct.c_double, "pedestal_stiffness pedestal_mass pedestal_damping block_compliance block_mass"),
        *_fields(ct.c_double, "asymmetry offset anisotropy anisotropy_angle"),
        *_fields(ct.c_int, "has_branch"),
        *_fields(ct.c_double, "branch_strength branch_time branch_spread"),
        *_fields(ct.c_int, "unbalance_node"),
        *_fields(ct.c_double, "unbalance_moment unbalance_phase"),
        *_fields(ct.c_double, "cubic_stiffness hertz_preload clearance_gap clearance_preload"),
        *_fields(ct.c_double, "friction_force friction_stiffness friction_spread bilinear_ratio"),
        *_fields(ct.c_int, "rub_node"),
        *_fields(ct.c_double, "rub_stiffness rub_gap"),
    ]


class LocalForce(ct.Structure):
    """``LocalForce`` of rotor.h."""

    _fields_ = [
        *_fields(ct.c_int, "law"),
        *_fields(ct.c_double * 3, "coefficients"),
        *_fields(ct.c_double, "offset"),
        *_fields(DOUBLES, "y z"),
    ]


class System(ct.Structure):
    """``System`` of rotor.h."""

    _fields_ = [
        *_fields(ct.c_int, "n"),
        *_fields(DOUBLES, "M K C G K_shaft"),
        *_fields(INTS, "free plane"),
        ("forces", ct.POINTER(LocalForce)),
        ("n_forces", ct.c_int),
    ]


class Core:
    """The library for one structure.

    Parameters
    ----------
    library : of ``compiled``
    structure : the rotor
    """

    def __init__(self, library: ct.CDLL, structure: PythonStructure):
        self.library, self._kept = library, []
        s, d, i = structure, self._doubles, self._ints
        self.structure = Structure(
            len(s.x), s.n_nodes, len(s.disk_node), len(s.support_node),
            d(s.M), d(s.K), d(s.G), d(s.K_tension), d(s.x), i(s.stations),
            d(s.bending_stiffness), d(s.shear_stiffness), d(s.diameter),
            i(s.disk_node), d(s.disk_mass), d(s.disk_thickness), d(s.disk_lumped_diametral), d(s.disk_lumped_polar),
            i(s.support_node), d(s.support_stiffness), d(s.support_tilt_stiffness), d(s.support_damping),
        )  # fmt: skip

    def _doubles(self, values: FloatArray) -> Any:
        self._kept.append(np.ascontiguousarray(values, dtype=float))
        return self._kept[-1].ctypes.data_as(DOUBLES)

    def _ints(self, values: IntArray) -> Any:
        self._kept.append(np.ascontiguousarray(values, dtype=np.int32))
        return self._kept[-1].ctypes.data_as(INTS)

    def design(self, condition: Condition, effects: Sequence[Effect]) -> Design:
        """The C core's words for a condition and effects."""
        design = Design()
        self.library.design_nominal(ct.byref(design))
        for name in CONDITION_WORDS:
            setattr(design, name, getattr(condition, name))
        for effect in effects:
            for name, word in EFFECT_WORDS[effect.id].items():
                field, _, place = word.partition("[")
                value = True if name == SWITCH else getattr(effect, name)
                if place:
                    getattr(design, field)[int(place[0])] = value
                else:
                    setattr(design, field, value)
        return design

    def system(self, design: Design) -> dict[str, Any]:
        """The matrices of a design, which degrees of freedom they stand for, and the local forces' numbers."""
        sizes = n_doubles, n_ints, n_forces = ct.c_int(), ct.c_int(), ct.c_int()
        self.library.system_memory(ct.byref(self.structure), *map(ct.byref, sizes))
        doubles, ints = np.zeros(n_doubles.value), np.zeros(n_ints.value, dtype=np.int32)
        system, forces = System(), (LocalForce * n_forces.value)()
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

    def use(self, design: Design) -> None:
        """Be this design. Raises ValueError."""
        self._checked(self._library.simulator_configure(self._simulator, ct.byref(design)))
        self._design = design

    def drive(self, *, force: float, force_amplitude: float, force_frequency: float) -> None:
        """As RotorSimulator's."""
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
