"""Time stepping with local forces: closed forms, an independent integrator, the linear stepper, conservation laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from rigtwin.rotor.effects import (
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BearingHertz,
    BilinearSupport,
    Effect,
    Gyroscopic,
    PedestalFlexibility,
    PlaneAnisotropy,
    Rub,
    ViscoelasticSupport,
)
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.force_laws import BILINEAR, CLEARANCE, CONTACT, CUBIC, JENKINS, ForceLaw
from rigtwin.rotor.model.local_force import LocalForce
from rigtwin.rotor.model.rotor_model import RotorModel, build_model
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.rotor.time.drive import Drive, Tone
from rigtwin.rotor.time.exciter import Course
from rigtwin.rotor.time.nonlinear_stepper import NoBalanceError, NonlinearStepper
from rigtwin.rotor.time.simulator import RotorSimulator
from rigtwin.rotor.time.stepper import ModalStepper
from tests.rotor import rigs
from tests.tolerances import CONVERGENCE_ORDER, ENERGY_PER_PERIOD, NONLINEAR_STEPPER, ROUND_OFF, SLIDING, STEPPER

BEARING = Condition(k_b=1e7, bearing_damping=20.0)
Y, Z = (1.0, 0.0), (0.0, 1.0)


def one_mass(law: ForceLaw, *coefficients: float, stiffness: float = 0.0, offset: float = 0.0) -> RotorModel:
    """A mass of 2 kg that moves in y and z on springs, with one local force; undamped."""
    one = np.eye(2)
    system = LinearSystem(
        M=2.0 * one,
        K=stiffness * one,
        G=0 * one,
        K_shaft=0 * one,
        C_support=0 * one,
        shaft_damping_ratio=0.0,
        free=np.arange(2),
        plane=np.array([1, 2]),
        sensors=np.array([[Y], [Z]]),
        structure=rigs.paper_structure(),
    )
    return RotorModel(system, (LocalForce(law, coefficients, one, offset),))


def small_rotor() -> Structure:
    """Two elements and a mass in the middle: slow enough for a general integrator."""
    supports = [{"node": node, "stiffness": "k_b"} for node in (1, 3)]
    tables = {"segment": [rigs.round_shaft(0.4, 0.02)], "mass": [{"node": 2, "mass_kg": 2.0}], "support": supports}
    return assemble(rigs.rig(nodes_m=[0.0, 0.2, 0.4], **tables))


def small_model(*effects: Effect, condition: Condition = BEARING) -> RotorModel:
    return build_model(small_rotor(), condition, effects)


def paper_model(*effects: Effect, condition: Condition = BEARING) -> RotorModel:
    return build_model(rigs.paper_structure(), condition, effects)


def inputs(system: LinearSystem) -> FloatArray:
    """(n, 2) forces in y and in z: at node 2, or at the only mass."""
    return np.eye(2) if system.n == 2 else np.array([system.unit_vector(2, plane) for plane in (1, 2)]).T


def stepper(model: RotorModel, spin: float = 0.0) -> NonlinearStepper:
    read_out = np.vstack([model.system.read_out(1), model.system.read_out(2)])
    return NonlinearStepper(model, inputs(model.system), read_out, spin)


def linear(system: LinearSystem) -> ModalStepper:
    return ModalStepper(system, inputs(system), np.vstack([system.read_out(1), system.read_out(2)]))


def sine(amplitude: float, omega: float, t: float, h: float, direction: tuple[complex, complex] = Y) -> Drive:
    """A sine that runs through, from t to t + h."""
    return Drive(tones=(Tone(omega, omega * t, omega * (t + h), np.array(direction, dtype=np.complex128) * amplitude),))


def march(
    s: NonlinearStepper | ModalStepper, state: FloatArray, drive: Callable[[float, float], Drive], times: FloatArray
):
    """(n_times, n_states) states at these times."""
    states = [state]
    for t, h in zip(times[:-1], np.diff(times), strict=True):
        states.append(s.step(states[-1], drive(t, h), h))
    return np.array(states)


def silent(t: float, h: float) -> Drive:
    return Drive()


def let_go(
    s: NonlinearStepper, q: FloatArray, velocity: FloatArray, times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n_times, n) deflections and velocities of a free motion."""
    states = march(s, s.state_of(q, velocity), silent, times)
    motions = [s.motion_of(state) for state in states]
    return np.array([q for q, _ in motions]), np.array([v for _, v in motions])


# -- closed forms --------------------------------------------------------------------------------


def returns_after(model: RotorModel, x: float, v: float, period: float, periods: int = 4) -> None:
    """Let the mass go and check that it is back, as it was, after some periods."""
    s, rate = stepper(model), 2 * np.pi / period
    q, velocity = let_go(s, np.array([x, 0.0]), np.array([v, 0.0]), np.linspace(0, periods * period, periods + 1))
    size = max(abs(x), abs(v) / rate)
    assert_allclose(q[1:, 0], x, rtol=0, atol=NONLINEAR_STEPPER * size)
    assert_allclose(velocity[1:, 0], v, rtol=0, atol=NONLINEAR_STEPPER * rate * size)


@pytest.mark.parametrize("amplitude", [1e-6, 1e-4, 1e-2])
def test_duffing_vibrates_with_the_period_of_the_elliptic_integral(amplitude):
    k, k3 = 8e5, 3e11
    stiffness = k + k3 * amplitude**2
    period = 4 * np.sqrt(2.0 / stiffness) * ellipk(k3 * amplitude**2 / (2 * stiffness))
    returns_after(one_mass(CUBIC, k3, stiffness=k), amplitude, 0.0, period)


@pytest.mark.parametrize("speed", [1e-3, 0.1])
def test_a_mass_in_a_gap_takes_two_flights_and_two_impacts_a_period(speed):
    k, gap = 8e5, 2e-5
    period = 4 * gap / speed + 2 * np.pi * np.sqrt(2.0 / k)
    returns_after(one_mass(CLEARANCE, k, gap, 1e-6 * gap, stiffness=k), 0.0, speed, period)
    returns_after(one_mass(CONTACT, k, gap, 1e-6 * gap), 0.0, speed, period)


@pytest.mark.parametrize("ratio", [0.25, 4.0])
def test_a_bilinear_spring_takes_half_a_period_of_either(ratio):
    k = 8e5
    period = np.pi * np.sqrt(2.0 / k) * (1 + 1 / np.sqrt(ratio))
    returns_after(one_mass(BILINEAR, k, ratio, 1e-12, stiffness=k), 0.0, 0.05, period)


def test_a_joint_loaded_in_y_stays_centred_in_z():
    """Pushed far onto its stiff side in y, a bilinear spring is a linear one there and a bilinear one across."""
    k, ratio, offset = 8e5, 4.0, 1e-2
    model = one_mass(BILINEAR, k, ratio, 1e-12, stiffness=k, offset=offset)
    periods = 2 * np.pi * np.sqrt(2.0 / (ratio * k)), np.pi * np.sqrt(2.0 / k) * (1 + 1 / np.sqrt(ratio))
    for plane, period in enumerate(periods):
        start = 0.05 * np.eye(2)[plane]
        q, v = let_go(stepper(model), np.zeros(2), start, np.array([0.0, period]))
        assert_allclose(v[1], start, rtol=0, atol=NONLINEAR_STEPPER * 0.05)
        assert_allclose(q[1], 0, rtol=0, atol=NONLINEAR_STEPPER * 0.05 * period)


def test_two_halves_of_a_law_are_the_whole():
    k3, x = 1e15, np.array([2e-3, -1e-3])
    whole = one_mass(CUBIC, k3, stiffness=8e5)
    half = replace(whole.forces[0], coefficients=(k3 / 2,))
    times = np.linspace(0, 5e-3, 6)
    expected, _ = let_go(stepper(whole), x, np.zeros(2), times)
    both, _ = let_go(stepper(replace(whole, forces=(half, half))), x, np.zeros(2), times)
    assert_allclose(both, expected, rtol=0, atol=NONLINEAR_STEPPER * np.abs(x).max())


def test_a_friction_element_that_sticks_is_a_spring():
    k, k_t = 8e5, 4e5
    returns_after(one_mass(JENKINS, k_t, 50.0, stiffness=k), 0.0, 0.05, 2 * np.pi * np.sqrt(2.0 / (k + k_t)))


def test_sliding_friction_takes_its_work_from_every_swing():
    """Turning points from the energy: k (X_n^2 - X_m^2) / 2 = F (X_n + X_m - 2 F / k_t), m = n + 1."""
    k, k_t, limit, x = 8e5, 1e8, 10.0, [4e-4]
    period = 2 * np.pi * np.sqrt(2.0 / k)
    # The first swing starts without force: F / k_t less is lost to loading, and stays in the spring.
    x.append(max(np.roots([k / 2, limit, limit * x[0] - limit**2 / (2 * k_t) - k * x[0] ** 2 / 2])))
    while len(x) < 8:
        x.append(max(np.roots([k / 2, limit, limit * x[-1] - 2 * limit**2 / k_t - k * x[-1] ** 2 / 2])))
    s, times = stepper(one_mass(JENKINS, k_t, limit, stiffness=k)), np.arange(0, 3.9 * period, period / 400)
    q, _ = let_go(s, np.array([x[0], 0.0]), np.zeros(2), times)
    swings = np.array_split(q[:, 0] * np.sign(q[:, 0]), np.flatnonzero(np.diff(np.sign(q[:, 0])) != 0) + 1)
    assert_allclose([swing.max() for swing in swings[:8]], x, rtol=0, atol=SLIDING * x[0])


def test_flight_in_the_gap_is_exactly_free():
    """Two bearings that do not touch are no bearings: the linear stepper of the same rotor on no stiffness agrees."""
    free = Condition(k_b=1e-10, shaft_damping_ratio=0.0)
    model = small_model(BearingClearance(gap=1e-3), condition=Condition(k_b=1e7, shaft_damping_ratio=0.0))
    sharp = RotorModel(model.system, tuple(force.with_corner(0.0) for force in model.forces))
    s, reference = stepper(sharp), linear(small_model(condition=free).system)
    q, v = 1e-6 * np.sin(1 + np.arange(model.system.n)), 1e-4 * np.cos(np.arange(model.system.n))
    for h in (1e-6, 1e-3, 0.05):
        flown = s.motion_of(s.step(s.state_of(q, v), Drive(), h))
        expected = reference.motion_of(reference.step(reference.state_of(q, v), Drive(), h))
        for now, then in zip(flown, expected, strict=True):
            assert_allclose(now, then, rtol=0, atol=10 * STEPPER * np.abs(then).max())


# -- the linear limit ----------------------------------------------------------------------------

NOTHING = [BearingCubic(stiffness=0.0), BilinearSupport(ratio=1.0), Rub(stiffness=1e4, gap=1e-3)]


@pytest.mark.parametrize("effect", NOTHING, ids=lambda effect: effect.id)
@pytest.mark.parametrize("h", [1e-6, 1e-3, 1.0])
def test_a_force_that_never_acts_leaves_the_linear_rotor(effect, h):
    model = paper_model(effect)
    s, reference = stepper(model), linear(model.system)
    q, v = 1e-6 * np.sin(1 + np.arange(model.system.n)), 1e-4 * np.cos(np.arange(model.system.n))
    tones = (Tone(600.0, 0.3, 0.3 + 600 * h, np.array([3.0, 1j])), Tone(-100.0, 0.0, -100 * h, np.array([0, 1 + 1j])))
    drive = Drive(Course(2.0), tones)
    after, expected = s.step(s.state_of(q, v), drive, h), reference.step(reference.state_of(q, v), drive, h)
    assert_allclose(after[: len(expected)], expected, rtol=0, atol=STEPPER * np.abs(expected).max())
    forces = np.array([3.0, 1.0])
    a, b = s.acceleration(after, forces), reference.acceleration(expected, forces)
    assert_allclose(a, b, rtol=0, atol=10 * STEPPER * np.abs(b).max())


@pytest.mark.parametrize(
    "effect",
    [BearingCubic(), BearingHertz(), BearingClearance(), BearingFriction(), BilinearSupport(), Rub()],
    ids=lambda effect: effect.id,
)
def test_a_rotor_at_rest_stays_at_rest(effect):
    s = stepper(paper_model(effect))
    rest = np.zeros(s.n_states)
    assert not s.step(rest, Drive(), 0.3).any()
    n = s.motion_of(rest)[0].size
    settled = s.step(s.state_of(np.zeros(n), np.zeros(n)), Drive(), 0.3)
    assert not settled.any()
    assert not s.acceleration(settled, np.zeros(2)).any()


# -- an independent integrator -------------------------------------------------------------------

# The force laws with sharp corners, written out by hand.
SHARP: dict[str, Callable[..., float]] = {
    "cubic": lambda x, k3: k3 * x**3,
    "clearance": lambda x, k, gap, _: k * np.sign(x) * max(abs(x) - gap, 0.0) - k * x,
    "hertz": lambda x, k, d0, _: k / (3 * d0**0.5) * (max(d0 + x, 0) ** 1.5 - max(d0 - x, 0) ** 1.5) - k * x,
    "bilinear": lambda x, k, ratio, _: (ratio - 1) * k * max(x, 0.0),
    "contact": lambda x, k, gap, _: k * np.sign(x) * max(abs(x) - gap, 0.0),
}


def pull(force: LocalForce, y: float, z: float) -> FloatArray:
    """(2,) force of a law without memory, less the static one."""
    law, c = SHARP[force.law.name], force.coefficients
    static = law(force.offset, *c)
    if not force.law.radial:
        return np.array([law(y + force.offset, *c) - static, law(z, *c)])
    r = np.hypot(y + force.offset, z)
    along = law(r, *c) / r if r else 0.0
    return np.array([along * (y + force.offset) - static, along * z])


def integrate(model: RotorModel, load: Callable[[float], FloatArray], times: FloatArray, spin: float) -> FloatArray:
    """(n_times, n_states) linear states from rest, by a general integrator of order eight.

    A friction element is a state of its own: its rate is k v unless it slips.
    """
    space = StateSpace(model.system, spin)
    patterns = np.concatenate([force.patterns for force in model.forces])
    B, G, C = space.input(inputs(model.system)), space.input(patterns.T), space.displacement(patterns)
    V, n = C @ space.A, space.n_states
    memory = np.repeat([force.law.memory for force in model.forces], 2)
    seat, limit = np.array([f.coefficients[:2] if f.law.memory else (0, 0) for f in model.forces]).T.repeat(2, axis=1)

    def rate(t: float, s: FloatArray) -> FloatArray:
        d, v, g = C @ s[:n], V @ s[:n], s[n:].copy()
        for k, force in enumerate(model.forces):
            if not force.law.memory:
                g[2 * k : 2 * k + 2] = pull(force, d[2 * k], d[2 * k + 1])
        sticks = memory & ~((np.abs(g) >= limit) & (g * v > 0))
        return np.concatenate([space.A @ s[:n] + B @ load(t) - G @ g, np.where(sticks, seat * v, 0.0)])

    start = np.zeros(n + len(patterns))
    solution = solve_ivp(rate, times[[0, -1]], start, "DOP853", times, rtol=1e-8, atol=1e-12, max_step=5e-5)
    assert solution.success
    return solution.y[:n].T


SPINNING = replace(BEARING, spin_speed=300.0)
WHIRL = (1.0, 0.5j)
EVERYTHING = [BearingCubic(stiffness=1e16), BearingFriction(force=2.0), Rub(gap=1e-5, node=2)]
# Effects, force [N], its direction in (y, z), and the condition.
CASES = {
    "cubic": ([BearingCubic(stiffness=1e16)], 20.0, Y, BEARING),
    "hertz": ([BearingHertz(preload=1e-6)], 20.0, Y, BEARING),
    "clearance": ([BearingClearance(gap=1e-6)], 3.0, Y, BEARING),
    "preloaded clearance": ([BearingClearance(gap=1e-6, preload=10.0)], 10.0, Y, BEARING),
    "friction": ([BearingFriction(force=2.0)], 3.0, Y, BEARING),
    "bilinear": ([BilinearSupport(ratio=2.0)], 3.0, Y, BEARING),
    "rub": ([Rub(gap=1e-5, node=2)], 30.0, Y, BEARING),
    "rub between rigid supports": ([Rub(gap=1e-5, node=2)], 30.0, Y, rigs.RIGID),
    "cubic in both planes": ([BearingCubic(stiffness=1e16)], 20.0, WHIRL, BEARING),
    "friction in both planes": ([BearingFriction(force=2.0)], 6.0, WHIRL, BEARING),
    "rub in both planes": ([Rub(gap=1e-5, node=2)], 30.0, WHIRL, BEARING),
    "preloaded clearance shaken across": ([BearingClearance(gap=1e-6, preload=10.0)], 10.0, Z, BEARING),
    "three at once": (EVERYTHING, 30.0, Y, BEARING),
    "spinning": ([Gyroscopic(), Rub(gap=1e-5, node=2)], 30.0, Y, SPINNING),
    "planes coupled": ([PlaneAnisotropy(), BearingCubic(stiffness=1e16)], 50.0, Y, BEARING),
    "on pedestals": ([PedestalFlexibility(), BearingFriction(force=2.0)], 5.0, Y, BEARING),
    "with massless ends": ([ViscoelasticSupport(), BearingHertz(preload=1e-6)], 20.0, Y, BEARING),
}


@pytest.mark.parametrize("case", CASES)
def test_transients_agree_with_an_independent_integrator(case):
    effects, amplitude, direction, condition = CASES[case]
    model = small_model(*effects, condition=condition)
    omega = 0.9 * model.system.modes.omega[0]
    times = np.linspace(0, 3 * 2 * np.pi / omega, 31)
    s = stepper(model, condition.spin_speed)
    states = march(s, np.zeros(s.n_states), lambda t, h: sine(amplitude, omega, t, h, direction), times)

    def load(t: float) -> FloatArray:
        return (amplitude * np.array(direction) * np.exp(1j * omega * t)).imag

    expected = integrate(model, load, times, condition.spin_speed)
    without = linear(model.system)
    if case != "spinning":
        unaided = march(
            without, np.zeros(without.n_states), lambda t, h: sine(amplitude, omega, t, h, direction), times
        )
        assert np.abs(unaided - expected).max() > 0.01 * np.abs(expected).max(), "the effect is felt"
    assert_allclose(states[:, : expected.shape[1]], expected, rtol=0, atol=NONLINEAR_STEPPER * np.abs(expected).max())


# -- conservation and convergence ----------------------------------------------------------------

# Potentials of the conservative laws with sharp corners.
POTENTIAL: dict[str, Callable[..., FloatArray]] = {
    "cubic": lambda x, k3: k3 * x**4 / 4,
    "hertz": lambda x, k, d0, _: (
        k / (7.5 * d0**0.5) * (np.maximum(d0 + x, 0) ** 2.5 + np.maximum(d0 - x, 0) ** 2.5) - k * x**2 / 2
    ),
    "clearance": lambda x, k, gap, _: k * np.maximum(np.abs(x) - gap, 0) ** 2 / 2 - k * x**2 / 2,
    "bilinear": lambda x, k, ratio, _: (ratio - 1) * k * np.maximum(x, 0) ** 2 / 2,
    "contact": lambda x, k, gap, _: k * np.maximum(np.abs(x) - gap, 0) ** 2 / 2,
}


def energy(model: RotorModel, q: FloatArray, v: FloatArray) -> FloatArray:
    """(n_times,) energy [J] of deflections and velocities (n_times, n)."""
    total = (np.einsum("ti,ij,tj->t", v, model.system.M, v) + np.einsum("ti,ij,tj->t", q, model.system.K, q)) / 2
    for force in model.forces:
        for x in (q @ force.patterns.T).T:
            total += POTENTIAL[force.law.name](x, *force.coefficients)
            total -= POTENTIAL[force.law.name](0.0, *force.coefficients)
    return total


UNDAMPED = Condition(k_b=1e7, shaft_damping_ratio=0.0)


@pytest.mark.parametrize(
    "effect",
    [
        BearingCubic(stiffness=1e17),
        BearingHertz(preload=1e-6),
        BearingClearance(gap=1e-6),
        BilinearSupport(ratio=3.0),
        Rub(gap=1e-5),
    ],
    ids=lambda effect: effect.id,
)
def test_conservative_laws_keep_the_energy_of_an_undamped_rotor(effect):
    model = paper_model(effect, condition=UNDAMPED)
    first = model.system.modes.Phi[:, 0] * (model.system.plane == 1)
    period = 2 * np.pi / model.system.modes.omega[0]
    q, v = let_go(stepper(model), 1e-4 * first, np.zeros(model.system.n), np.linspace(0, 40 * period, 41))
    energies = energy(model, q, v)
    assert_allclose(energies, energies[0], rtol=40 * ENERGY_PER_PERIOD)


def test_the_error_falls_with_the_fourth_power_of_the_substep():
    """Communication steps that are short enough are the substeps."""
    k3, amplitude = 3e11, 2e-3
    s = stepper(one_mass(CUBIC, k3, stiffness=8e5))
    stiffness = 8e5 + k3 * amplitude**2
    period = 4 * np.sqrt(2.0 / stiffness) * ellipk(k3 * amplitude**2 / (2 * stiffness))
    errors = []
    for steps in (300, 600):
        _, v = let_go(s, np.array([amplitude, 0.0]), np.zeros(2), np.linspace(0, 2 * period, 2 * steps + 1))
        errors.append(abs(v[-1, 0]))
    assert_allclose(np.log2(errors[0] / errors[1]), 4, atol=CONVERGENCE_ORDER)


def test_friction_only_takes_energy():
    """Motion and loaded sliders together; what is left below the limit is kept for ever."""
    limit, seat = 5.0, 1e7
    model = paper_model(BearingFriction(force=limit, stiffness=seat), condition=UNDAMPED)
    s, first = stepper(model), model.system.modes.Phi[:, 0] * (model.system.plane == 1)
    states = march(s, s.state_of(5e-5 * first, np.zeros(model.system.n)), silent, np.linspace(0, 0.6, 1201))
    q, v = (np.array(part) for part in zip(*(s.motion_of(state) for state in states), strict=True))
    conservative = RotorModel(model.system)
    held = np.array([s.memory_of(state) for state in states])
    energies = energy(conservative, q, v) + (held**2).sum(axis=1) / (2 * seat)
    assert np.abs(held).max() <= limit
    assert np.diff(energies).max() < ENERGY_PER_PERIOD * energies[0]
    assert energies[-1] < 0.5 * energies[0]
    assert energies[-1] > 0.99 * energies[-200], "once it sticks, nothing more is lost"


@pytest.mark.parametrize(
    "effect",
    [BearingCubic(stiffness=1e16), BearingHertz(preload=1e-6), BearingFriction(), BilinearSupport(), Rub(gap=1e-5)],
    ids=lambda effect: effect.id,
)
def test_one_long_step_is_many_short_ones(effect):
    s, omega = stepper(paper_model(effect)), 2 * np.pi * 80.0
    rest = np.zeros(s.n_states)
    one = s.step(rest, sine(5.0, omega, 0.0, 0.5), 0.5)
    many = march(s, rest, lambda t, h: sine(5.0, omega, t, h), np.linspace(0, 0.5, 501))[-1]
    for a, b in zip(s.motion_of(one), s.motion_of(many), strict=True):
        assert_allclose(a, b, rtol=0, atol=NONLINEAR_STEPPER * np.abs(b).max())


# -- two planes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "effect",
    [
        BearingCubic(),
        BearingHertz(),
        BearingClearance(preload=5.0),
        BearingFriction(),
        BilinearSupport(),
        Rub(gap=1e-6),
    ],
    ids=lambda effect: effect.id,
)
def test_force_in_y_never_moves_z(effect):
    model = paper_model(effect)
    s = stepper(model)
    states = march(s, np.zeros(s.n_states), lambda t, h: sine(5.0, 500.0, t, h), np.linspace(0, 0.05, 11))
    q, v = s.motion_of(states[-1])
    across = model.system.plane == 2
    assert not q[across].any()
    assert not v[across].any()
    assert not s.acceleration(states[-1], np.array([5.0, 0.0]))[7:].any()
    assert q[~across].any()


@pytest.mark.parametrize("effect", [BearingCubic(stiffness=1e16), BearingClearance(gap=1e-6), Rub(gap=1e-5, node=2)])
@pytest.mark.parametrize("angle", [np.pi / 2, 0.7])
def test_turning_the_rotor_turns_its_motion(effect, angle):
    """A radial law knows no direction."""
    model = small_model(effect)
    s, y = stepper(model), model.system.plane == 1
    shape = 1e-4 * model.system.modes.Phi[:, 0] * y
    times = np.linspace(0, 0.02, 21)
    along, _ = let_go(s, shape, np.zeros(model.system.n), times)
    turn = np.zeros((model.system.n, model.system.n))
    for node in range(3):  # (y, z, theta_y, theta_z) turn as vectors do
        for a, b in ((0, 1), (2, 3)):
            a, b = 4 * node + a, 4 * node + b
            turn[np.ix_([a, b], [a, b])] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turned, _ = let_go(s, turn @ shape, np.zeros(model.system.n), times)
    assert_allclose(turned, along @ turn.T, rtol=0, atol=NONLINEAR_STEPPER * np.abs(along).max())


def test_a_radial_contact_keeps_angular_momentum_and_energy():
    model = one_mass(CONTACT, 8e5, 2e-5, 2e-11)
    q, v = let_go(stepper(model), np.array([1e-5, 0.0]), np.array([0.03, 0.04]), np.linspace(0, 0.2, 201))
    momentum = q[:, 0] * v[:, 1] - q[:, 1] * v[:, 0]
    assert_allclose(momentum, momentum[0], rtol=NONLINEAR_STEPPER)
    along = RotorModel(model.system)
    r = np.hypot(*q.T)
    energies = energy(along, q, v) + POTENTIAL["contact"](r, 8e5, 2e-5, 0.0)
    assert_allclose(energies, energies[0], rtol=NONLINEAR_STEPPER)


# -- state and memory ----------------------------------------------------------------------------


@pytest.mark.parametrize("effect", [BearingClearance(gap=1e-6), BearingFriction(force=1.0), BilinearSupport()])
def test_a_copied_state_replays_to_the_last_bit_whatever_was_done_before(effect):
    model = paper_model(effect)
    s, times = stepper(model), np.cumsum([0.0, *(1e-3 * (1 + np.arange(12) % 4))])
    states = march(s, np.zeros(s.n_states), lambda t, h: sine(3.0, 560.0, t, h, WHIRL), times)
    march(s, states[3], lambda t, h: sine(7.0, 900.0, t, h), np.array([0.0, 1e-4, 0.0123]))
    for other in (s, stepper(model)):
        again = march(other, states[5].copy(), lambda t, h: sine(3.0, 560.0, t, h, WHIRL), times[5:])
        assert np.array_equal(again, states[5:])


def test_motion_and_state_are_each_others_inverse():
    model = paper_model(BearingFriction(), BearingCubic())
    s = stepper(model)
    q, v = 1e-6 * np.cos(np.arange(model.system.n)), 1e-3 * np.sin(np.arange(model.system.n))
    memory = np.array([1.0, -2.0, 3.0, 0.0])
    back = s.motion_of(s.state_of(q, v, memory))
    assert_allclose(back[0], q, rtol=0, atol=ROUND_OFF * np.abs(q).max())
    assert_allclose(back[1], v, rtol=0, atol=ROUND_OFF * np.abs(v).max())
    assert np.array_equal(s.memory_of(s.state_of(q, v, memory)), memory)


def test_friction_survives_a_change_of_parameters():
    """A force that is held goes on from where it was; a lower limit cuts it; another set of laws starts anew."""
    model = paper_model(BearingFriction(force=5.0))
    s = stepper(model)
    state = march(s, np.zeros(s.n_states), lambda t, h: sine(20.0, 560.0, t, h), np.linspace(0, 0.1, 11))[-1]
    held = s.memory_of(state)
    assert np.abs(held).max() > 1.0
    stiffer = stepper(paper_model(BearingFriction(force=5.0), condition=replace(BEARING, k_b=2e7)))
    assert np.array_equal(stiffer.memory_of(stiffer.state_of(*s.motion_of(state), held)), held)
    weaker = stepper(paper_model(BearingFriction(force=0.5)))
    assert_allclose(weaker.memory_of(weaker.state_of(*s.motion_of(state), held)), np.clip(held, -0.5, 0.5))
    twice = stepper(paper_model(BearingFriction(force=5.0), BearingFriction(force=1.0)))
    assert not twice.memory_of(twice.state_of(*s.motion_of(state), held)).any()
    unchanged = s.state_of(*s.motion_of(state), held)
    later = [s.step(x, sine(20.0, 560.0, 0.1, 0.05), 0.05) for x in (state, unchanged)]
    for a, b in zip(s.motion_of(later[0]), s.motion_of(later[1]), strict=True):
        assert_allclose(a, b, rtol=0, atol=NONLINEAR_STEPPER * np.abs(a).max())


def test_the_simulator_steps_effects_and_goes_back():
    simulator = RotorSimulator(rigs.paper_structure(), BEARING, [BearingFriction(force=1.0)])
    simulator.drive(force=0.0, force_amplitude=10.0, force_frequency=90.0)
    for i in range(20):
        simulator.advance(i * 1e-3, 1e-3)
    simulator.configure(replace(BEARING, k_b=2e7), [BearingFriction(force=1.0), BearingCubic()])
    saved = simulator.snapshot()
    futures = []
    for _ in range(2):
        for i in range(20, 30):
            simulator.advance(i * 1e-3, 1e-3)
        futures.append(simulator.accelerations())
        simulator.configure(BEARING, [])
        simulator.restore(saved, replace(BEARING, k_b=2e7), [BearingFriction(force=1.0), BearingCubic()])
    assert np.array_equal(*futures)
    assert futures[0].any()


def test_acceleration_is_the_rate_of_the_velocity():
    model = paper_model(BearingHertz(preload=1e-6), BearingFriction(force=1.0))
    s, omega, h = stepper(model), 560.0, 1e-7
    state = march(s, np.zeros(s.n_states), lambda t, h: sine(20.0, omega, t, h), np.linspace(0, 0.1, 11))[-1]
    before, after = (s.step(state, sine(20.0, omega, 0.1, step), step) for step in (0.5 * h, 1.5 * h))
    read_out = np.vstack([model.system.read_out(1), model.system.read_out(2)])
    difference = read_out @ (s.motion_of(after)[1] - s.motion_of(before)[1]) / h
    now = s.step(state, sine(20.0, omega, 0.1, h), h)
    computed = s.acceleration(now, np.array([20.0 * np.sin(omega * (0.1 + h)), 0.0]))
    assert_allclose(computed, difference, rtol=0, atol=1e-4 * np.abs(computed).max())


# -- where it ends -------------------------------------------------------------------------------


def test_a_force_beyond_all_bounds_says_so():
    s = stepper(one_mass(CUBIC, 1e300, stiffness=8e5))
    state = s.state_of(np.array([1e-3, 0.0]), np.zeros(2))
    with pytest.raises(NoBalanceError, match=r"cubic in y finds no balance .* check the effect's parameters"):
        s.step(state, Drive(), 1e-3)
    assert issubclass(NoBalanceError, ValueError)


@pytest.mark.parametrize(
    "effect",
    [
        BearingFriction(force=0.1, stiffness=1e8),
        BearingFriction(force=50.0, stiffness=1e9),
        BearingClearance(gap=1e-9),
        BearingHertz(preload=1e-9),
        BilinearSupport(ratio=100.0),
        Rub(stiffness=1e10, gap=1e-8),
        BearingHertz(preload=20.0),
    ],
    ids=str,
)
def test_sharp_and_stiff_laws_are_stepped_through(effect):
    """From rest and back to rest: no failure, no growth without a force, and no crawling."""
    model = paper_model(effect, condition=replace(BEARING, bearing_damping=2000.0, shaft_damping_ratio=0.05))
    s = stepper(model)
    driven = s.step(np.zeros(s.n_states), sine(5.0, 560.0, 0.0, 0.01), 0.01)
    ringing = march(s, driven, silent, np.linspace(0, 0.03, 31))
    speeds = [np.abs(s.motion_of(state)[1]).max() for state in ringing]
    assert 0 < max(speeds[20:]) < max(speeds[:10])
