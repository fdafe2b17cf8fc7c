"""Which panels show which effect, and the words below them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes

from benchmarks.effect_pages.plots import (
    ACCELERANCE,
    BAND,
    BEARING,
    COLOURS,
    NODE,
    NOMINAL,
    RIGID,
    Cases,
    Panel,
    at_levels,
    curves,
    force_law,
    frame,
    jointed_rotor,
    lines_hz,
    on_both_supports,
    paper_rotor,
    response,
)
from rigtwin.pages.palette import INK
from rigtwin.rotor.effects import (
    AttachedMass,
    AxialLoad,
    BearingAsymmetry,
    BearingClearance,
    BearingCubic,
    BearingDamping,
    BearingFriction,
    BearingHertz,
    BearingOffset,
    BearingTiltStiffness,
    BilinearSupport,
    CompliantRigidSupport,
    DiskInertia,
    DiskMass,
    ExciterSuspension,
    ForceDropout,
    Gyroscopic,
    HubStiffening,
    JointMicroslip,
    MeasuredJoint,
    OpenCrack,
    PedestalFlexibility,
    PlaneAnisotropy,
    Rub,
    SensorDelay,
    SensorGain,
    SensorMass,
    SensorPosition,
    ShaftDamping,
    ShaftModulus,
    UnbalanceForce,
    ViscoelasticSupport,
)
from rigtwin.rotor.frequency.frequency_response import dynamic_stiffness
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.frequency.whirl import campbell, unbalance_response
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.printed_laws import SCALAR
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.time.simulator import RotorSimulator


@dataclass(frozen=True)
class EffectFigure:
    """The panels of an effect, and what they show."""

    panels: Sequence[Panel]
    caption: str
    setting: str = ""  # in place of ``SETTING``


# What is the same in all figures.
SETTING = (
    f"Nominal in grey. Force and accelerometer at node {NODE}, k_b = 1.3 MN/m, c_b = 50 N s/m, shaft damping 0.3 %, "
    "four elements between nodes."
)
_BALANCED = SETTING + " By harmonic balance with seven harmonics; dashed: not stable."
_SPINNING = "k_b = 1.3 MN/m, c_b = 50 N s/m, shaft damping 0.3 %."


# -- panels that are an effect's own -------------------------------------------------------------


def shift_over_position(ax: Axes) -> None:
    """How far a crack lowers the first two modes on rigid supports, over its place."""
    x = np.linspace(0.0, float(paper_rotor().x[-1]), 107)
    nominal = natural_frequencies_hz(build_system(paper_rotor(), RIGID).in_plane(1))[:2]
    cracks = (OpenCrack(reduction=0.4, position=float(place)) for place in x)
    f = [natural_frequencies_hz(build_system(paper_rotor(), RIGID, [c]).in_plane(1))[:2] for c in cracks]
    for mode, line in enumerate(100 * (np.array(f) / nominal - 1).T, start=1):
        ax.plot(1e3 * x, line, color=INK, linestyle="-" if mode == 1 else "--", label=f"mode {mode}, 40 % lost")
    frame(ax, "on rigid supports", (0, 426), "shift, %", "position of the crack, mm")


def seat_over_frequency(cases: Mapping[str, ViscoelasticSupport], *, loss: bool) -> Panel:
    """Stiffness of a bearing, or its loss factor."""

    def draw(ax: Axes) -> None:
        f = np.linspace(*BAND, 400)
        ax.plot(f, np.zeros_like(f) if loss else np.full_like(f, BEARING.k_b / 1e6), label="nominal", **NOMINAL)
        for colour, (label, effect) in zip(COLOURS, cases.items(), strict=False):
            D = seat_stiffness(effect, 2 * np.pi * f)
            ax.plot(f, D.imag / D.real if loss else D.real / 1e6, color=colour, label=label)
        frame(ax, "the seat alone", BAND, "loss factor" if loss else "stiffness, MN/m")

    return draw


def seat_stiffness(effect: ViscoelasticSupport, omega: FloatArray) -> ComplexArray:
    """(n,) dynamic stiffness of one bearing's seat at omega (n,) [N/m]: k_b, and what the effect adds to the rotor."""
    undamped = replace(BEARING, bearing_damping=0.0, shaft_damping_ratio=0.0)
    nominal, system = (build_system(paper_rotor(), undamped, e).in_plane(1) for e in ((), (effect,)))
    heavy, light = system.heavy, system.massless
    D = dynamic_stiffness(system, omega)
    joints = np.linalg.solve(D[:, light[:, None], light], D[:, light[:, None], heavy])
    added = D[:, heavy[:, None], heavy] - D[:, heavy[:, None], light] @ joints - dynamic_stiffness(nominal, omega)
    bearing = nominal.unit_vector(paper_rotor().supported_nodes[0], 1)
    return BEARING.k_b + np.einsum("i,nij,j->n", bearing, added, bearing)


def phase(cases: Cases) -> Panel:
    """Phase of the accelerance on bearings."""

    def draw(ax: Axes) -> None:
        for style, label, effects in curves(cases):
            f = lines_hz(BEARING, effects)
            H = measured_response(paper_rotor(), BEARING, effects, f, [NODE])[:, 0]
            ax.plot(f, np.rad2deg(np.unwrap(np.angle(H))), label=label, **style)
        frame(ax, "on bearings", BAND, "phase, °")

    return draw


def shift_by_channel(grams: Sequence[float]) -> Panel:
    """Shift of the first two modes that the channels of one run show, over the sensor's node."""

    def draw(ax: Axes) -> None:
        nominal = natural_frequencies_hz(build_system(paper_rotor(), BEARING).in_plane(1))[:2]
        nodes = np.arange(1, 8)
        for colour, mass in zip(COLOURS, grams, strict=False):
            loaded = [SensorMass(mass=mass / 1e3, node=int(node)) for node in nodes]
            f = [natural_frequencies_hz(build_system(paper_rotor(), BEARING, [e]).in_plane(1))[:2] for e in loaded]
            shift = 100 * (np.array(f) / nominal - 1)
            for mode, marker in enumerate("os"):
                label = f"{mass:g} g, mode {mode + 1}"
                ax.plot(nodes, shift[:, mode], marker=marker, markersize=4, color=colour, label=label,
                        linestyle="-" if mode == 0 else "--")  # fmt: skip
        frame(ax, "what each channel shows of the poles", (0.8, 7.2), "shift, %", "node of the sensor")

    return draw


def sampled(steps_hz: Sequence[float], band: tuple[float, float], title: str) -> Panel:
    """A response, and the lines of coarse rasters on it."""

    def draw(ax: Axes) -> None:
        f = lines_hz(BEARING, (), band)
        H = measured_response(paper_rotor(), BEARING, (), f, [NODE])
        ax.semilogy(f, np.abs(H), label="nominal", **NOMINAL)
        for colour, step in zip(COLOURS, steps_hz, strict=False):
            lines = np.arange(20.0, band[1], step)
            lines = lines[lines >= band[0]]
            H = measured_response(paper_rotor(), BEARING, (), lines, [NODE])
            ax.semilogy(lines, np.abs(H), "o-", markersize=3.5, color=colour, label=f"every {step:g} Hz")
        frame(ax, title, band, ACCELERANCE)

    return draw


def swept(dwells_s: Sequence[float], lines: FloatArray) -> Panel:
    """What a stepped sine reads a fixed time after every step, upwards and downwards, simulated in time."""

    def draw(ax: Axes) -> None:
        f = lines_hz(BEARING, (), (lines[0], lines[-1]))
        H = measured_response(paper_rotor(), BEARING, (), f, [NODE])
        ax.semilogy(f, np.abs(H), label="nominal", **NOMINAL)
        for colour, dwell in zip(COLOURS, dwells_s, strict=False):
            for order, style in ((lines, "-"), (lines[::-1], ":")):
                label = f"read after {dwell:g} s" if style == "-" else None
                ax.semilogy(order, stepped_sine(order, dwell), style, color=colour, label=label)
        frame(ax, "on bearings, first mode", (lines[0], lines[-1]), ACCELERANCE)

    return draw


def stepped_sine(frequencies_hz: FloatArray, dwell_s: float) -> FloatArray:
    """Magnitude of the acceleration per newton at every line, fitted over the end of its dwell."""
    simulator, step, samples = RotorSimulator(paper_rotor(1), BEARING), 1e-3, 80
    sizes = []
    for f in frequencies_hz:
        simulator.drive(force=0.0, force_amplitude=1.0, force_frequency=float(f))
        simulator.advance(simulator.time, (dwell_s if sizes else 10.0) - samples * step)
        read = []
        for _ in range(samples):
            simulator.advance(simulator.time, step)
            read.append(simulator.accelerations()[NODE - 1])
        angle = 2 * np.pi * f * step * np.arange(samples)
        basis = np.column_stack([np.cos(angle), np.sin(angle)])
        sizes.append(np.linalg.norm(np.linalg.lstsq(basis, np.array(read), rcond=None)[0]))
    return np.array(sizes)


def whirl(factors: Sequence[float]) -> Panel:
    """Campbell diagram."""

    def draw(ax: Axes) -> None:
        rpm = np.linspace(0.0, 18000.0, 61)
        spins = rpm * np.pi / 30
        for style, label, effects in curves({f"γ = {g:g}": [Gyroscopic(factor=g)] for g in factors}):
            system = build_system(paper_rotor(2), BEARING, [DiskInertia(), *effects])
            lines = campbell(system, spins, n_modes=10).frequency_hz
            ax.plot(rpm, lines[:, 0], label=label, **style)
            ax.plot(rpm, lines[:, 1:], **style)
        ax.plot(rpm, rpm / 60, color=INK, linewidth=0.7, linestyle="--", label="spin frequency")
        ax.set_ylim(0, 700)
        frame(ax, "on bearings", (0, 18000), "whirl frequency, Hz", "spin speed, rev/min")

    return draw


def run_up(moments: Sequence[float]) -> Panel:
    """Radius of the orbit at the left disk over spin speed."""

    def draw(ax: Axes) -> None:
        f = lines_hz(BEARING, (), (10.0, 300.0))
        for colour, moment in zip(COLOURS, moments, strict=False):
            model = build_model(paper_rotor(1), BEARING, [UnbalanceForce(moment=moment, node=3)])
            orbit = unbalance_response(model, 2 * np.pi * f)[:, 0, 2]
            ax.semilogy(60 * f, 1e6 * np.abs(orbit), color=colour, label=f"{1e6 * moment:g} g mm")
        frame(ax, "on bearings", (0, 18000), "radius, µm", "spin speed, rev/min")

    return draw


def hysteresis(effect: BearingFriction, reaches_m: Sequence[float]) -> Panel:
    """Loops of a seat that sticks and slips, its parallel stiffness left out."""

    def draw(ax: Axes) -> None:
        for shade, reach in zip(("#6b7580", INK), reaches_m, strict=True):
            x = reach * np.cos(np.linspace(0, 2 * np.pi, 400))
            path, before, force = [], reach, effect.force  # on the loop from its corner
            for here in x:
                force = SCALAR["jenkins"](float(here), before, force, effect.stiffness, effect.force)[0]
                before = float(here)
                path.append(force)
            ax.plot(1e6 * x, path, color=shade)
        ends = 1.1e6 * max(reaches_m)
        frame(ax, "at the joint, friction alone", (-ends, ends), "force, N", "displacement, µm")

    return draw


def _of_angle(effect: JointMicroslip, angles: FloatArray) -> ComplexArray:
    """(n,) complex stiffness of a joint over that at rest, for amplitudes of its angle [rad]."""
    balance = Balance(build_model(jointed_rotor(1), BEARING, [effect]), BEARING, harmonics=1)
    joints = np.stack([0 * angles, angles], axis=1)[..., None].astype(complex)
    return 1 + balance.forces.harmonics(joints)[:, 1, 0] / (jointed_rotor(1).joint_tilt_stiffness[0] * angles)


def joint_loss(exponents: Sequence[float]) -> Panel:
    """Loss factor of a joint over the amplitude of its angle."""

    def draw(ax: Axes) -> None:
        angles = np.geomspace(1e-3, 1.0, 120)
        for colour, p in zip(COLOURS, exponents, strict=False):
            loss = _of_angle(JointMicroslip(angle=1.0, exponent=p), angles).imag
            ax.loglog(angles, loss, color=colour, linewidth=1.3, label=f"p = {p:g}")
        ax.set_ylim(1e-5, 1.0)
        frame(ax, "loss factor", (1e-3, 1.0), "Im k/k₀", "amplitude of the angle over θ_s")

    return draw


def joint_stiffness(exponents: Sequence[float]) -> Panel:
    """Stiffness of a joint over the amplitude of its angle, with and without a second contact."""

    def draw(ax: Axes) -> None:
        angles = np.geomspace(1e-3, 0.3, 120)
        for colour, p in zip(COLOURS, exponents, strict=False):
            for style, contact in (("-", 0.0), ("--", 0.3)):
                effect = JointMicroslip(angle=1.0, exponent=p, contact=contact, gap=0.03)
                ax.semilogx(angles, _of_angle(effect, angles).real, style, color=colour, linewidth=1.3)
        frame(ax, "stiffness", (1e-3, 0.3), "Re k/k₀", "amplitude of the angle over θ_s")

    return draw


# -- the figures ---------------------------------------------------------------------------------


def _signed(value: float, unit: str) -> str:
    return f"{value:+g} {unit}".replace("-", "−")


FIRST_MODE = 65.0, 95.0  # on bearings [Hz]
FIRST_MODE_RIGID = 85.0, 110.0
_ZOOMED = "on bearings, first mode"

_STIFF, _MIDDLE = replace(BEARING, k_b=1e8), replace(BEARING, excitation_node=4)
_SUSPENSIONS: Cases = {"30 kN/m": [ExciterSuspension(stiffness=3e4)], "300 kN/m": [ExciterSuspension(stiffness=3e5)]}
_CRACKS: Cases = {f"{r:g} % lost": [OpenCrack(reduction=r / 100)] for r in (30, 60)}
_RATIOS: Cases = {f"{100 * z:g} %": [ShaftDamping(damping_ratio=z)] for z in (0.001, 0.01, 0.02)}
_TILTS: Cases = {f"{k / 1e3:g} kN m/rad": [BearingTiltStiffness(stiffness=k)] for k in (2e3, 2e4)}
_PEDESTALS: Cases = {
    "10 MN/m, 1 kg": [PedestalFlexibility()],
    "10 MN/m, 8 kg": [PedestalFlexibility(mass=8.0)],
    "2 MN/m, 3 kg": [PedestalFlexibility(stiffness=2e6, mass=3.0)],
}
_UNEQUAL: Cases = {f"a = {a:g}": [BearingAsymmetry(asymmetry=a)] for a in (0.2, 0.5)}
_SPANS: Cases = {_signed(o, "mm"): [BearingOffset(offset=o / 1e3)] for o in (-9, 9)}
_ANISOTROPIC: Cases = {f"a = {a:g}, 20°": [PlaneAnisotropy(anisotropy=a, angle=0.35)] for a in (0.2, 0.5)}
_SEATS = {"g = 0.5, τ = 0.1 ms": 1e-4, "1 ms": 1e-3, "10 ms": 1e-2}
_RELAXING = {label: ViscoelasticSupport(strength=0.5, relaxation_time=tau) for label, tau in _SEATS.items()}
_LATE: Cases = {f"{1e3 * t:g} ms": [SensorDelay(delay=t)] for t in (2e-4, 1e-3, 2e-3)}
_BESIDE: Cases = {_signed(x, "mm"): [SensorPosition(offset=x / 1e3)] for x in (-10, 5, 10)}
_ARMATURES: Cases = {f"{m:g} kg": [ForceDropout(mass=m)] for m in (0.1, 0.3)}

_CUBIC, _HERTZ, _GAP = BearingCubic(stiffness=1e15), BearingHertz(preload=5e-6), BearingClearance(gap=2e-6)
_LOADED, _SLIPPING = BearingClearance(gap=2e-6, preload=20.0), BearingFriction(force=1.0, stiffness=1e6)
_ONE_SIDED, _STATOR = BilinearSupport(ratio=2.0), Rub()

_UNKNOWN: Cases = {
    "absorber": [MeasuredJoint(stiffness=0.0, mass=0.0, damping=0.0, branch_mass=0.2, branch_frequency=120.0)],
    "spring and damper": [MeasuredJoint(stiffness=1e5, mass=0.0, damping=20.0)],
}

FIGURES: dict[str, EffectFigure] = {
    "attached_mass": EffectFigure(
        on_both_supports({f"{m:g} kg": [AttachedMass(mass=m)] for m in (0.1, 0.5)}),
        "A mass at node 4, which is a node of the second mode.",
    ),
    "exciter_suspension": EffectFigure(
        (response(_SUSPENSIONS), response(_SUSPENSIONS, band=FIRST_MODE, title=_ZOOMED)),
        "Springs to ground at the drive node.",
    ),
    "disk_mass": EffectFigure(
        on_both_supports({_signed(d, "%"): [DiskMass(change=d / 100)] for d in (-8, 8)}),
        "Both disks lighter or heavier.",
    ),
    "disk_inertia": EffectFigure(
        on_both_supports({f"γ = {g:g}": [DiskInertia(factor=g)] for g in (1.0, 2.0)}),
        "On rigid supports the second mode has its antinodes close to the disks and hardly moves.",
    ),
    "hub_stiffening": EffectFigure(
        on_both_supports({f"β = {b:g}": [HubStiffening(factor=b)] for b in (1.5, 2.5)}),
        "A shaft that is stiffer over the 18 mm of each disk.",
    ),
    "shaft_modulus": EffectFigure(
        on_both_supports({f"ε = {e:g}": [ShaftModulus(factor=e)] for e in (0.9, 1.1)}),
        "On bearings the modes shift less, by the shaft's share of their strain energy.",
    ),
    "axial_load": EffectFigure(
        on_both_supports({_signed(P, "kN"): [AxialLoad(force=1e3 * P)] for P in (-20, 20)}),
        "On pins the shaft buckles at about −88 kN.",
    ),
    "open_crack": EffectFigure(
        (response(_CRACKS, RIGID, band=FIRST_MODE_RIGID), shift_over_position),
        "Left: a crack at 0.2 m. Right: the first two modes over the crack's position.",
    ),
    "shaft_damping": EffectFigure(
        (response(_RATIOS, band=FIRST_MODE, title=_ZOOMED),
         response(_RATIOS, RIGID, band=FIRST_MODE_RIGID, title="on rigid supports, first mode")),
        "On bearings only a share of the shaft's damping acts on a mode, and the bearings damp it too.",
    ),
    "measured_joint": EffectFigure(
        on_both_supports(_UNKNOWN),
        "Two laws at node 4: a branch alone, which is an absorber, and a spring with a damper to the ground.",
    ),
    "bearing_damping": EffectFigure(
        on_both_supports({f"{c:g} N s/m": [BearingDamping(damping=c)] for c in (10.0, 200.0, 500.0)}),
        "The second mode moves the bearings more than the first.",
    ),
    "bearing_tilt_stiffness": EffectFigure(
        (response(_TILTS, title="on bearings, k_b = 1.3 MN/m"),
         response(_TILTS, _STIFF, title="on bearings, k_b = 100 MN/m")),
        "The stiffer the bearings are, the larger is the influence of their tilt stiffness.",
    ),
    "pedestal_flexibility": EffectFigure(
        (response(_PEDESTALS),), "Heavy or soft pedestals bring poles of their own into the band."
    ),
    "bearing_asymmetry": EffectFigure(
        (response(_UNEQUAL), response(_UNEQUAL, _MIDDLE, node=4, title="force and accelerometer at node 4")),
        "Right: the middle, where the second mode does not show while the bearings are alike.",
    ),
    "bearing_offset": EffectFigure(
        (response(_SPANS), response(_SPANS, band=FIRST_MODE, title=_ZOOMED)),
        "Positive offsets make the span shorter.",
    ),
    "compliant_rigid_support": EffectFigure(
        (response({f"{k:g} MN/m": [CompliantRigidSupport(stiffness=1e6 * k)] for k in (100, 30, 10)}, RIGID),),
        "A rigid support that gives way acts like a bearing without damping.",
    ),
    "plane_anisotropy": EffectFigure(
        (response(_ANISOTROPIC, title="on bearings, along the force"),
         response(_ANISOTROPIC, title="on bearings, across the force", plane=2, nominal=False)),
        "Across the force the nominal rotor does not move at all.",
    ),
    "viscoelastic_support": EffectFigure(
        (response({label: [seat] for label, seat in _RELAXING.items()}),
         seat_over_frequency(_RELAXING, loss=False), seat_over_frequency(_RELAXING, loss=True)),
        "The loss is largest close to 1/(2πτ).",
    ),
    "bearing_cubic": EffectFigure(
        (at_levels(_CUBIC, (0.1, 0.5, 2.0), FIRST_MODE), at_levels(_CUBIC, (0.1, 0.5, 2.0), FIRST_MODE, 3),
         force_law(_CUBIC, 6e-5)),
        "k₃ = 10¹⁵ N/m³.",
        _BALANCED,
    ),
    "bearing_hertz": EffectFigure(
        (at_levels(_HERTZ, (0.1, 0.5, 2.0), FIRST_MODE), at_levels(_HERTZ, (0.1, 0.5, 2.0), FIRST_MODE, 3),
         force_law(_HERTZ, 7e-5)),
        "d₀ = 5 µm.",
        _BALANCED,
    ),
    "bearing_clearance": EffectFigure(
        (at_levels(_GAP, (1.0, 3.0, 10.0), (50.0, 90.0)),
         at_levels(_LOADED, (1.0, 3.0, 10.0), (50.0, 90.0), title="with 20 N of preload"), force_law(_GAP, 8e-6)),
        "g = 2 µm.",
        _BALANCED,
    ),
    "bearing_friction": EffectFigure(
        (at_levels(_SLIPPING, (0.1, 0.5, 5.0), (60.0, 110.0)), hysteresis(_SLIPPING, (2e-6, 5e-6))),
        "F_c = 1 N, k_t = 1 MN/m. Right: the friction force of the seat at two amplitudes.",
        _BALANCED,
    ),
    "bilinear_support": EffectFigure(
        (at_levels(_ONE_SIDED, (0.1, 1.0), (60.0, 110.0), widths=(3.0, 1.0)),
         at_levels(_ONE_SIDED, (0.1, 1.0), (60.0, 110.0), 2, widths=(3.0, 1.0)),
         force_law(_ONE_SIDED, 2e-5)),
        "ρ = 2; the curves of all force levels coincide.",
        _BALANCED,
    ),
    "rub": EffectFigure(
        (at_levels(_STATOR, (0.5, 1.5, 5.0), (60.0, 120.0)), at_levels(_STATOR, (0.5, 1.5, 5.0), (60.0, 120.0), 3),
         force_law(_STATOR, 1.5e-4, linear=0.0)),
        "A stator at node 4, k_s = 1 MN/m, g = 50 µm.",
        _BALANCED,
    ),
    "joint_microslip": EffectFigure(
        (joint_loss((0.7, 1.0, 1.7)), joint_stiffness((0.7, 1.0, 1.7))),
        "The joint alone. Dashed: with a second contact, c = 0.3, that closes at g = 0.03 θ_s.",
        "Fundamental of the moment over that of the angle.",
    ),
    "sensor_gain": EffectFigure(
        (response({f"γ = {g:g}": [SensorGain(gain=g)] for g in (0.8, 1.2)}),),
        "On a logarithmic scale the whole curve of the channel moves up or down.",
    ),
    "sensor_delay": EffectFigure((phase(_LATE),), "The magnitudes are those of the nominal rotor."),
    "sensor_mass": EffectFigure(
        (response({f"{m:g} g": [SensorMass(mass=m / 1e3)] for m in (20, 60)}, band=(180.0, 230.0),
                  title="on bearings, second mode"), shift_by_channel((20, 60))),
        "Right: the accelerometer is moved from node to node and loads the rotor where it reads.",
    ),
    "sensor_position": EffectFigure(
        (response(_BESIDE), response(_BESIDE, band=(100.0, 140.0), title="on bearings, antiresonance")),
        "The accelerometer sits beside node 2.",
    ),
    "force_dropout": EffectFigure(
        (response(_ARMATURES, band=FIRST_MODE, title="per nominal force", referred_to="nominal_force"),
         response(_ARMATURES, band=FIRST_MODE, title="per force on the rotor")),
        "Right: per force that really acts on the rotor, the effect cannot be seen.",
    ),
    "coarse_grid": EffectFigure(
        (sampled((1.0, 4.0), FIRST_MODE, _ZOOMED), sampled((1.0, 4.0), (190.0, 220.0), "on bearings, second mode")),
        "The value on every line is right, but the peaks between the lines are missed.",
    ),
    "fast_sweep": EffectFigure(
        (swept((1.0, 0.1), np.arange(70.0, 86.01, 0.2)),),
        "Steps of 0.2 Hz up (solid) and down (dotted), each read over the last 80 ms of its dwell.",
    ),
    "gyroscopic": EffectFigure(
        (whirl((0.5, 1.0, 1.5)),),
        "Backward whirl falls, forward whirl rises. The disks have their diametral inertia too.",
        f"Nominal in grey. {_SPINNING}",
    ),
    "unbalance": EffectFigure(
        (run_up((1e-6, 1e-5, 1e-4)),),
        "Unbalance and orbit at node 3: a circle while the bearings are alike in y and z.",
        _SPINNING,
    ),
}  # fmt: skip
