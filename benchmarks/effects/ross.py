"""Effects against ROSS, an independent rotordynamics code: the golden values of benchmarks/ross."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.page import bar, table
from rigtwin.rotor.effects import (
    AttachedMass,
    AxialLoad,
    BearingAsymmetry,
    BearingOffset,
    BearingTiltStiffness,
    DiskInertia,
    Effect,
    ExciterSuspension,
    Gyroscopic,
    OpenCrack,
    PedestalFlexibility,
    PlaneAnisotropy,
    Rub,
    UnbalanceForce,
)
from rigtwin.rotor.frequency.frequency_response import ComplexArray, dynamic_stiffness, receptance
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.frequency.whirl import campbell, critical_speeds, unbalance_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.design import CRACK_LENGTH
from rigtwin.rotor.model.rotor_model import RotorModel, build_model
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.rotor.time.drive import Drive, Tone
from rigtwin.rotor.time.nonlinear_stepper import NonlinearStepper

# A node that moves less than this share of the largest is judged by that share of the largest.
NODE_FLOOR = 1e-4

# ROSS' mesh; and finer ones for the effects that ROSS has mesh nodes of their own for.
ELEMENTS, FINER = 8, (16, 32)
OWN_MESH_NODES = ("bearing_offset", "open_crack")

# Of the rotor that rubs, by harmonic balance: samples of a period, rounding of the contact's corner over its gap.
HARMONICS, SAMPLES, CORNER = 25, 2048, 1e-3

# Of the same by time stepping: periods from rest until the motion is steady, samples of a period.
PERIODS, STEPS = 60, 64

FORCE_NODE = 2
SOLID_DISKS = (DiskInertia(factor=1.0), Gyroscopic(factor=1.0))
EMPTY = np.zeros(0)


@cache
def golden() -> dict[str, Any]:
    """ROSS' values, see benchmarks/ross/README.md."""
    path = Path(__file__).parents[1] / "ross/golden.json"
    return json.loads(path.read_text(encoding="utf-8"))


def case(name: str) -> dict[str, Any]:
    """One case of the golden values."""
    return golden()["cases"][name]


@dataclass(frozen=True)
class Difference:
    """Relative differences between the two codes, one per number that is compared."""

    frequencies: FloatArray = field(default_factory=lambda: EMPTY)
    responses: FloatArray = field(default_factory=lambda: EMPTY)


# -- our side -------------------------------------------------------------------------------------


@cache
def structure(elements: int) -> Structure:
    """The shipped rotor with so many elements in each span."""
    return assemble(load_rig("nit-rourkela"), elements_between_nodes=elements)


def condition(k_b: float, damping: float | None = None, spin_speed: float = 0.0) -> Condition:
    """ROSS' rotor: damped in the bearings only."""
    nominal_damping: float = golden()["rotor"]["bearing_damping_Ns_per_m"]
    return Condition(
        k_b=k_b,
        bearing_damping=nominal_damping if damping is None else damping,
        shaft_damping_ratio=0.0,
        excitation_node=FORCE_NODE,
        spin_speed=spin_speed,
    )


def rotor(k_b: float, *effects: Effect, elements: int = ELEMENTS, damping: float | None = None) -> RotorModel:
    """Our model with effects."""
    return build_model(structure(elements), condition(k_b, damping), effects)


def anisotropic(matrix: Sequence[Sequence[float]]) -> tuple[float, tuple[PlaneAnisotropy, ...]]:
    """k_b [N/m] and the effect that give the bearings this stiffness in (y, z)."""
    K = np.array(matrix)
    k_b, difference = K.trace() / 2, np.hypot(K[0, 0] - K[1, 1], 2 * K[0, 1])
    if not difference:
        return k_b, ()
    angle = np.arctan2(2 * K[0, 1], K[0, 0] - K[1, 1]) / 2
    return k_b, (PlaneAnisotropy(anisotropy=difference / k_b, angle=angle),)


def crack(compliance: float, position: float) -> OpenCrack:
    """The crack with this rotational compliance [rad/(N m)]."""
    EI, diameter = structure(1).bending_stiffness[0, 0], structure(1).diameter[0]
    ratio = compliance * EI / (CRACK_LENGTH * diameter)
    return OpenCrack(reduction=float(ratio / (1 + ratio)), position=position)


# -- differences ----------------------------------------------------------------------------------


def relative(ours: Any, theirs: Any) -> FloatArray:
    """Of numbers none of which is small."""
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    return (np.abs(ours - theirs) / np.abs(theirs)).ravel()


def node_by_node(ours: ComplexArray, theirs: ComplexArray, largest: FloatArray | float | None = None) -> FloatArray:
    """Of phasors (n_lines, n_nodes), each relative to its own size or to ``NODE_FLOOR`` of the line's ``largest``."""
    size = np.abs(theirs)
    floor = NODE_FLOOR * (size.max(axis=1, keepdims=True) if largest is None else largest)
    return (np.abs(ours - theirs) / np.maximum(size, floor)).ravel()


def phasors(values: dict[str, Any]) -> ComplexArray:
    """Complex numbers as they are stored."""
    if "real" in values:
        return np.array(values["real"]) + 1j * np.array(values["imag"])
    return np.array(values["amplitude_m"]) * np.exp(1j * np.array(values["phase_rad"]))


def both_planes(values: dict[str, Any]) -> ComplexArray:
    """(n_lines, 14) deflections in y and z."""
    return np.hstack([phasors(values["y"]), phasors(values["z"])])


def one_plane_hz(system: LinearSystem, n: int = 4) -> FloatArray:
    """Lowest frequencies in y [Hz]."""
    return natural_frequencies_hz(system.in_plane(1), plane=1)[:n]


def response(system: LinearSystem, theirs: dict[str, Any], spin_speed: float = 0.0) -> FloatArray:
    """Difference of the receptance at every stored line and node, of pedestals too where they are stored."""
    if "z" in theirs:
        read_out, H = np.vstack([system.read_out(1), system.read_out(2)]), both_planes(theirs)
    else:
        system = system.in_plane(1)
        read_out, H = system.read_out(1), phasors(theirs["y"])
    if "pedestals_y" in theirs:
        read_out = np.vstack([read_out, np.eye(system.n)[system.free >= system.structure.n]])
        H = np.hstack([H, phasors(theirs["pedestals_y"])])
    omega = 2 * np.pi * np.array(theirs["frequency_hz"])
    force = system.unit_vector(FORCE_NODE, 1)[:, None]
    return node_by_node(receptance(dynamic_stiffness(system, omega, spin_speed), force, read_out)[:, :, 0], H)


# -- cases ----------------------------------------------------------------------------------------


def _standing(name: str, *effects: Effect, elements: int = ELEMENTS) -> Difference:
    """f_hz at every k_b, receptance at those that have one."""
    theirs = case(name)
    systems = [rotor(k_b, *effects, elements=elements).system for k_b in theirs["k_b_N_per_m"]]
    hz = [one_plane_hz(system) for system in systems]
    lines = [response(system, stored) for system, stored in zip(systems, theirs["receptance"], strict=False)]
    return Difference(relative(hz, theirs["f_hz"]), np.concatenate(lines))


def nominal(elements: int = ELEMENTS) -> Difference:
    """No effect."""
    return _standing("nominal", elements=elements)


def attached_mass(elements: int = ELEMENTS) -> Difference:
    """A mass at a node."""
    theirs = case("attached_mass")
    effect = AttachedMass(mass=theirs["mass_kg"], node=theirs["node"])
    return _standing("attached_mass", effect, elements=elements)


def exciter_suspension(elements: int = ELEMENTS) -> Difference:
    """A spring and a damper at the driven node."""
    theirs = case("exciter_suspension")
    effect = ExciterSuspension(stiffness=theirs["stiffness_N_per_m"], damping=theirs["damping_Ns_per_m"])
    return _standing("exciter_suspension", effect, elements=elements)


def disk_inertia(elements: int = ELEMENTS) -> Difference:
    """Solid disks that resist tilting."""
    return _standing("disk_inertia", DiskInertia(factor=1.0), elements=elements)


def pedestal_flexibility(elements: int = ELEMENTS) -> Difference:
    """Bearings on masses on springs and dampers."""
    theirs = case("pedestal_flexibility")
    effect = PedestalFlexibility(
        stiffness=theirs["stiffness_N_per_m"], mass=theirs["mass_kg"], damping=theirs["damping_Ns_per_m"]
    )
    return _standing("pedestal_flexibility", effect, elements=elements)


def bearing_offset(elements: int = ELEMENTS) -> Difference:
    """Bearings beside their nodes; ROSS has mesh nodes there."""
    return _standing("bearing_offset", BearingOffset(offset=case("bearing_offset")["offset_m"]), elements=elements)


def bearing_tilt_stiffness(elements: int = ELEMENTS) -> Difference:
    """Rotational springs at the bearings."""
    theirs, hz, lines = case("bearing_tilt_stiffness"), [], []
    for tilt, stored in zip(theirs["tilt_stiffness_Nm_per_rad"], theirs["receptance"], strict=True):
        effect = BearingTiltStiffness(stiffness=tilt)
        systems = [rotor(k_b, effect, elements=elements).system for k_b in theirs["k_b_N_per_m"]]
        hz.append([one_plane_hz(system) for system in systems])
        lines.append(response(systems[0], stored))
    return Difference(relative(hz, theirs["f_hz"]), np.concatenate(lines))


def axial_load(elements: int = ELEMENTS) -> Difference:
    """Compression, none, tension."""
    theirs = case("axial_load")
    hz = [
        [one_plane_hz(rotor(k_b, AxialLoad(force=force), elements=elements).system) for k_b in theirs["k_b_N_per_m"]]
        for force in theirs["axial_force_N"]
    ]
    return Difference(relative(hz, theirs["f_hz"]))


def bearing_asymmetry(elements: int = ELEMENTS) -> Difference:
    """Unequal bearings."""
    theirs = case("bearing_asymmetry")
    left, right = theirs["k_left_N_per_m"], theirs["k_right_N_per_m"]
    k_b, asymmetry = (left + right) / 2, (left - right) / (left + right)
    system = rotor(k_b, BearingAsymmetry(asymmetry=asymmetry), elements=elements).system
    return Difference(relative(one_plane_hz(system), theirs["f_hz"]), response(system, theirs["receptance"][0]))


def plane_anisotropy(elements: int = ELEMENTS) -> Difference:
    """Bearings stiffer along one axis, in y or turned against it."""
    theirs, hz, lines = case("plane_anisotropy"), [], []
    for degrees, stored in zip(theirs["angle_deg"], theirs["receptance"], strict=True):
        effect = PlaneAnisotropy(anisotropy=theirs["anisotropy"], angle=np.radians(degrees))
        system = rotor(theirs["k_b_N_per_m"], effect, elements=elements).system
        hz.append(natural_frequencies_hz(system)[:8])
        lines.append(response(system, stored))
    return Difference(relative(hz, theirs["f_hz_both_planes"]), np.concatenate(lines))


def open_crack(elements: int = ELEMENTS) -> Difference:
    """Hinges of all depths in the weak and in the strong direction; ROSS has mesh nodes there."""
    theirs, hz, golden_hz = case("open_crack"), [], []
    for stored in theirs["frequencies"]["cases"]:
        for direction, plane in (("weak", "z"), ("strong", "y")):
            golden_hz.append(stored[f"f_hz_{plane}"])
            cracks = [crack(c, stored["x_m"]) for c in theirs["fracture_mechanics"][direction]]
            hz.append([one_plane_hz(rotor(stored["k_b_N_per_m"], c, elements=elements).system) for c in cracks])
    return Difference(relative(hz, golden_hz))


def gyroscopic(elements: int = ELEMENTS) -> Difference:
    """Whirl by direction at every spin, critical speeds by direction, a response of the spinning rotor."""
    theirs, frequencies = case("gyroscopic"), []
    spins = np.array(theirs["spin_rad_per_s"])
    for k_b, stored in zip(theirs["k_b_N_per_m"], theirs["whirl"], strict=True):
        system = rotor(k_b, *SOLID_DISKS, elements=elements, damping=0.0).system
        frequencies += _whirl(system, spins, stored)
        critical = critical_speeds(system, n=16)
        for direction, sign in (("forward", 1), ("backward", -1)):
            found = critical.spin_speed[critical.direction == sign]
            frequencies.append(relative(found[:4], stored["critical_speeds_rad_per_s"][direction]))
    stored = theirs["response_at_spin"]
    spinning = rotor(stored["k_b_N_per_m"], *SOLID_DISKS, elements=elements).system
    return Difference(np.concatenate(frequencies), response(spinning, stored["receptance"], stored["spin_rad_per_s"]))


def _whirl(system: LinearSystem, spins: FloatArray, stored: dict[str, Any]) -> list[FloatArray]:
    """Differences of the first four whirls of either direction; a round rotor at rest has pairs without direction."""
    found, differences = campbell(system, spins, n_modes=20), []
    for i, spin in enumerate(spins):
        hz, direction = found.frequency_hz[i], found.direction[i]
        if spin == 0:
            pairs = np.sort(stored["backward_hz"][i] + stored["forward_hz"][i])
            differences.append(relative(hz[: len(pairs)], pairs))
        else:
            for name, sign in (("backward_hz", -1), ("forward_hz", 1)):
                differences.append(relative(hz[direction == sign][:4], stored[name][i]))
    return differences


def unbalance(elements: int = ELEMENTS) -> Difference:
    """A turning force on a round rotor, with solid disks, on anisotropic bearings."""
    theirs, lines = case("unbalance"), []
    effect = UnbalanceForce(moment=theirs["unbalance_kg_m"], phase=theirs["phase_rad"], node=theirs["node"])
    for stored in theirs["variants"].values():
        k_b, effects = anisotropic(stored["bearing_stiffness_yz_N_per_m"])
        disks = SOLID_DISKS if stored["polar_inertia_kg_m2"] else ()
        model = rotor(k_b, *effects, *disks, effect, elements=elements)
        q = unbalance_response(model, 2 * np.pi * np.array(stored["frequency_hz"]))
        lines.append(node_by_node(q.reshape(len(q), -1), both_planes(stored)))
    return Difference(responses=np.concatenate(lines))


def harmonic_balance(elements: int = ELEMENTS) -> Difference:
    """Forces that turn once, twice, three times as fast as the rotor."""
    theirs = case("harmonic_balance")
    k_b, effects = anisotropic(theirs["bearing_stiffness_yz_N_per_m"])
    system = rotor(k_b, *effects, *SOLID_DISKS, elements=elements, damping=theirs["bearing_damping_Ns_per_m"]).system
    spin, node = theirs["spin_rad_per_s"], theirs["node"]
    y_and_z = np.column_stack([system.unit_vector(node, plane) for plane in (1, 2)])
    D = dynamic_stiffness(system, spin * np.array(theirs["harmonics"]), spin)
    read_out = np.vstack([system.read_out(1), system.read_out(2)])
    H = receptance(D, y_and_z, read_out) @ np.array([1, -1j])  # from y to z
    force = np.array(theirs["force_N"]) * np.exp(1j * np.array(theirs["phase_rad"]))
    return Difference(responses=node_by_node(force[:, None] * H, both_planes(theirs)))


CASES: dict[str, Callable[[int], Difference]] = {
    compare.__name__: compare
    for compare in (
        nominal,
        attached_mass,
        exciter_suspension,
        disk_inertia,
        axial_load,
        bearing_tilt_stiffness,
        pedestal_flexibility,
        bearing_asymmetry,
        bearing_offset,
        plane_anisotropy,
        open_crack,
        gyroscopic,
        unbalance,
        harmonic_balance,
    )
}

# -- rub ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RubTest:
    """A rotor that touches a ring, under a sine force or an unbalance."""

    model: RotorModel
    condition: Condition
    pattern: ComplexArray  # (n,) of the force, Re[force pattern e^{i omega t}]
    force: float  # [N]
    frequency_hz: float
    theirs: ComplexArray  # (5, 14) harmonics 1 to 5 of the nodes in y and z [m]

    @property
    def omega(self) -> float:
        """[rad/s]"""
        return 2 * np.pi * self.frequency_hz

    @property
    def read_out(self) -> FloatArray:
        """(14, n) nodes in y and z."""
        return np.vstack([self.model.system.read_out(1), self.model.system.read_out(2)])


def rub_tests() -> dict[str, RubTest]:
    """ROSS' three."""
    theirs = case("rub")
    return {name: _rub_test(stored, theirs["elements_per_span"]) for name, stored in theirs["tests"].items()}


def _rub_test(stored: dict[str, Any], elements: int) -> RubTest:
    k_b, effects = anisotropic(stored["bearing_stiffness_yz_N_per_m"])
    contact = Rub(stiffness=stored["contact_stiffness_N_per_m"], gap=stored["gap_m"], node=stored["rub_node"])
    held = condition(k_b, stored["bearing_damping_Ns_per_m"], stored["spin_rad_per_s"])
    model = build_model(structure(elements), held, (*effects, contact))
    y, z = (model.system.unit_vector(stored["force_node"], plane) for plane in (1, 2))
    hz = stored["frequency_hz"]
    if stored["force_N"] is not None:
        pattern, force = -1j * y, stored["force_N"]  # a sine
    else:
        pattern, force = y - 1j * z, stored["unbalance_kg_m"] * (2 * np.pi * hz) ** 2
    return RubTest(model, held, pattern, force, hz, both_planes(stored))


def rub_by_balance(test: RubTest) -> ComplexArray:
    """(5, 14) harmonics of the motion that harmonic balance finds [m]."""
    balance = Balance(
        test.model, test.condition, pattern=test.pattern, harmonics=HARMONICS, samples=SAMPLES, corner=CORNER
    )
    motions = balance.solve(test.frequency_hz, test.force)
    if not motions.converged.all():
        raise RuntimeError("harmonic balance found no motion of the rotor that rubs")
    q = np.zeros((5, 2, test.model.system.structure.n_nodes), dtype=complex)
    for plane in (1, 2) if balance.plane is None else (balance.plane,):
        q[:, plane - 1] = motions.acceleration(plane)[0, 1:6] * test.force
    k = np.arange(1, 6)[:, None]
    return (-q.reshape(5, -1) / (k * test.omega) ** 2).astype(complex)


def rub_by_stepping(test: RubTest) -> ComplexArray:
    """(5, 14) harmonics of the motion that the rotor settles in [m]."""
    inputs = np.column_stack([test.pattern.real, test.pattern.imag])
    stepper = NonlinearStepper(test.model, inputs, test.read_out, test.condition.spin_speed)
    state, period, motion = np.zeros(stepper.n_states), 1 / test.frequency_hz, []
    forces = np.array([1j * test.force, -test.force], dtype=complex)  # Im[force e^{i phase}]: cosine and negative sine
    for start, stop in pairwise(2 * np.pi * np.arange(PERIODS * STEPS + 1) / STEPS):
        drive = Drive(tones=(Tone(test.omega, start, stop, forces),))
        state = stepper.step(state, drive, period / STEPS)
        motion.append(test.read_out @ stepper.motion_of(state)[0])
    last = np.roll(np.array(motion[-STEPS:]), 1, axis=0)  # from phase zero on
    return np.fft.rfft(last, axis=0)[1:6] * 2 / STEPS


RUB_SOLVERS: dict[str, Callable[[RubTest], ComplexArray]] = {
    "harmonic balance": rub_by_balance,
    "time stepping": rub_by_stepping,
}


def rub_difference(test: RubTest, ours: ComplexArray, harmonic: int) -> FloatArray:
    """Difference of one harmonic at every node, or relative to ``NODE_FLOOR`` of the largest fundamental."""
    rows = slice(harmonic - 1, harmonic)
    return node_by_node(ours[rows], test.theirs[rows], float(np.abs(test.theirs[0]).max()))


# -- the mesh -------------------------------------------------------------------------------------


def with_nodes(positions: Sequence[float], elements: int, bearings: Sequence[float] | None = None) -> Structure:
    """The shipped rotor with further nodes [m], each interval cut into so many elements; bearings may move there."""
    tables = load_rig("nit-rourkela").model_dump(exclude_unset=True)
    before, after = tables["nodes_m"], sorted({*tables["nodes_m"], *positions})
    tables["nodes_m"] = after
    for disk in tables["disk"]:
        disk["node"] = after.index(before[disk["node"] - 1]) + 1
    for support, x in zip(tables["support"], bearings or (before[0], before[-1]), strict=True):
        support["node"] = after.index(x) + 1
    return assemble(Rig.model_validate(tables), elements_between_nodes=elements)


def ross_nodes(name: str, elements: int) -> FloatArray:
    """Differences of frequencies where our mesh has nodes where ROSS' has: at the bearings, at a crack left out."""
    theirs = case(name)
    if name == "bearing_offset":
        nodes, offset = golden()["rotor"]["nodes_m"], theirs["offset_m"]
        ends = (nodes[0] + offset, nodes[-1] - offset)
        pairs = zip(theirs["k_b_N_per_m"], theirs["f_hz"], strict=True)
        held = [(with_nodes(ends, elements, bearings=ends), k_b, hz) for k_b, hz in pairs]
    else:
        cases = theirs["frequencies"]["cases"]
        held = [(with_nodes((c["x_m"],), elements), c["k_b_N_per_m"], c["f_hz_intact"]) for c in cases]
    found = [relative(one_plane_hz(build_model(shaft, condition(k_b)).system), hz) for shaft, k_b, hz in held]
    return np.concatenate(found)


# -- the section ----------------------------------------------------------------------------------


def percent(differences: FloatArray) -> str:
    """The largest, in percent."""
    return f"{100 * differences.max():.1e}" if len(differences) else ""


def section() -> str:
    """Markdown of the comparison."""
    found = {name: compare(ELEMENTS) for name, compare in CASES.items()}
    rows = [
        (
            f"`{name}`",
            f"{len(d.frequencies) or ''}",
            percent(d.frequencies),
            f"{len(d.responses) or ''}",
            percent(d.responses),
        )
        for name, d in found.items()
    ]
    rubs = [
        (name, solver, *(rub_difference(test, solve(test), harmonic) for harmonic in (1, 3)))
        for name, test in rub_tests().items()
        for solver, solve in RUB_SOLVERS.items()
    ]
    mesh = [
        (f"{n}", *(percent((found[name] if n == ELEMENTS else CASES[name](n)).frequencies) for name in OWN_MESH_NODES))
        for n in (ELEMENTS, *FINER)
    ]
    mesh += [
        (f"{n}, nodes where ROSS has them", *(percent(ross_nodes(name, n)) for name in OWN_MESH_NODES))
        for n in (ELEMENTS, FINER[-1])
    ]
    frequencies = np.concatenate([d.frequencies for d in found.values()])
    responses = np.concatenate([d.responses for d in found.values()] + [d for row in rubs for d in row[2:]])
    header = ("effect", "frequencies", "largest diff., %", "response values", "largest diff., %")
    rub_header = ("motion", "solver", "fundamental, %", "third harmonic, %")
    rub_rows = [(f"`{name}`", solver, *map(percent, differences)) for name, solver, *differences in rubs]
    version, floor = golden()["ross"]["ross-rotordynamics"], f"{NODE_FLOOR:g}"
    return f"""## Effects in an independent code: ROSS

The rotor code ROSS {version} [ross2020] computed the shipped rotor with one effect at a time, with damping in every
bearing and none in the shaft. Our model computed the same with the effect of that name. The two codes share the theory
of the beam, but not a line of code. Both use {ELEMENTS} elements per span.

Differences of frequencies are relative to ROSS' frequency. Responses are compared as complex values at every stored
line and node, relative to the amplitude of that node in ROSS. If this amplitude is below {floor} of the largest one of
the line, {floor} of the largest one is used instead.

Some rows need an explanation:

- `axial_load` and `open_crack` have frequencies only; `unbalance` and `harmonic_balance` have responses only.
- `gyroscopic` compares backward and forward whirl up to 5000 rad/s and the critical speeds, each whirl direction
  separately, and a response at 2000 rad/s.
- `open_crack` compares five depths at two places, for bending across and along the crack's edge.
- `harmonic_balance` compares forces that turn once, twice and three times as fast as the rotor, because the harmonic
  balance of ROSS is linear.

{table(header, rows)}
{bar("frequencies, largest difference", 100 * frequencies.max(), at_most=0.1, unit="%")}
{bar("responses, largest difference, with those of the rub below", 100 * responses.max(), at_most=1, unit="%")}
Where the meshes are the same, only round-off is left: the matrices agree to the digits that are stored. The case
`nominal` also has bearings of 1e9 N/m. Its first resonance is then so sharp that the round-off of its frequency can be
seen in the response.

The cases `bearing_offset` and `open_crack` do not have the same mesh in both codes. ROSS has mesh nodes at the bearings
and at the crack, while our model puts the effect inside an element. The next table separates the influence of the mesh
from that of the effect. It repeats the comparison with finer meshes of ours, and with our mesh having nodes at the same
places (for the crack: of the rotor without the crack):

{table(("elements per span", *(f"`{name}`, %" for name in OWN_MESH_NODES)), mesh)}
With nodes at the same places the codes agree. The last row is the error of ROSS' own mesh, so a finer mesh of ours
cannot come closer to ROSS than that. In our model the crack changes the stiffness of an element but not its mass
matrix; this matters less when the element is short.

### Rub

The shaft touches a ring at node 3. Both codes have one element per span. In the first case a sine drives the standing
rotor. In the other two an unbalance drives the spinning rotor, on isotropic and on anisotropic bearings, and the shaft
touches the ring all the time.

The steady motion in ROSS is extrapolated from three step sizes of its time integration. It is accurate to 3e-6 of its
largest harmonic; the third harmonic under the sine is accurate to 5e-5 of itself. Our motion is computed by harmonic
balance ({HARMONICS} harmonics, {SAMPLES} samples per period, both planes where both move) and by time stepping from
rest ({PERIODS} periods). Differences are relative to the harmonic itself, but to at least {floor} of the largest
fundamental. So where ROSS has no harmonic, ours must have none either.

{table(rub_header, rub_rows)}
### What ROSS lacks, and why its numbers are believed

ROSS does not have everything that our library has. Its bearings are linear and have no tilt stiffness, its shaft has no
damping ratio, and its supports are springs. Its harmonic balance has no nonlinear force laws. Its crack exists only in
the time integration and is not a hinge there. The friction in its rub is not tangential.

For the comparison, the tilt stiffness and the hinge of the crack were added to ROSS' matrices by hand. Bearings with
clearance, with cubic, Hertzian or bilinear stiffness or with friction have no counterpart in ROSS. Hub stiffening,
viscoelastic supports, and the damping and modulus of the shaft were not compared. All these effects are checked by the
closed forms below and by comparing our own solvers, which share little with each other.

There are several reasons to believe the numbers of ROSS. For standing and whirling rotors they are solved from the
matrices that ROSS assembles. ROSS' own analyses (modal analysis, Campbell diagram with directions, critical speeds,
transfer matrix) give the same to 1e-8 in frequencies and to 3e-11 in responses. For unbalance, harmonic balance and rub
the numbers are ROSS' own answers, and solving its matrices directly gives the same. A pinned beam under an axial force
follows its closed form to 2e-7, so the sign of the tension is right. The compliance of the crack agrees with the strip
integral of fracture mechanics to 2e-6.

The script that makes the values is `benchmarks/ross/generate.py`; the README beside it says more about them.
"""


if __name__ == "__main__":
    print(section())
