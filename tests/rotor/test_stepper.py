"""Exact time stepping against closed forms and against the direct frequency response."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rigtwin.rotor.frequency.frequency_response import dynamic_stiffness, receptance
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.system import LinearSystem, undamped_modes
from rigtwin.rotor.time.drive import Drive, Tone
from rigtwin.rotor.time.exciter import Course
from rigtwin.rotor.time.stepper import ModalStepper
from tests.rotor import rigs
from tests.tolerances import ROUND_OFF, STEPPER

BEARING = Condition(k_b=1e6, bearing_damping=20.0)
each_condition = pytest.mark.parametrize("condition", [rigs.RIGID, BEARING], ids=["rigid", "bearing"])


def stepper(system: LinearSystem, spin_speed: float = 0.0, node: int = 2) -> ModalStepper:
    read_out = np.vstack([system.read_out(1), system.read_out(2)])
    return ModalStepper(system, system.unit_vector(node, 1)[:, None], read_out, spin_speed)


class Force(NamedTuple):
    """A held force and a sine at the exciter."""

    held: float = 0.0
    amplitude: float = 0.0
    omega: float = 0.0


def advance(s: ModalStepper, state: np.ndarray, phase: float, force: Force, h: float) -> np.ndarray:
    """One step of a sine that runs through: its phase at the end follows from that at the start."""
    tone = Tone(force.omega, phase, phase + force.omega * h, np.array([force.amplitude + 0j]))
    return s.step(state, Drive(Course(force.held), (tone,) if force.amplitude else ()), h)


def spinning_system() -> LinearSystem:
    disks = [{"node": node, "inertia": True, **rigs.ROSS["disk"]} for node in (3, 5)]
    return build_system(assemble(Rig.model_validate(rigs.tables(disk=disks))), BEARING)


def some_state(s: ModalStepper) -> np.ndarray:
    return 1e-3 * np.sin(1 + np.arange(s.n_states))


def steady_motion(system: LinearSystem, omega: float, phase: float, spin: float) -> tuple[np.ndarray, np.ndarray]:
    """Deflections and velocities under sin(omega t + phase) at node 2, t = 0, from the direct response."""
    D = dynamic_stiffness(system, np.array([omega]), spin)
    q = receptance(D, system.unit_vector(2, 1)[:, None], np.eye(system.n))[0, :, 0] * np.exp(1j * phase)
    return q.imag, (1j * omega * q).imag


@each_condition
@pytest.mark.parametrize("spin", [0.0, 400.0])
@pytest.mark.parametrize("frequency_hz", [17.0, 96.5, 250.0])
def test_a_step_of_any_length_stays_on_the_direct_steady_response(condition, spin, frequency_hz):
    system = rigs.paper_system(condition)
    s, omega = stepper(system, spin), 2 * np.pi * frequency_hz
    state = s.state_of(*steady_motion(system, omega, 0.3, spin))
    for h in (1e-5, 1e-3, 0.1, 1.7):
        after = advance(s, state, 0.3, Force(amplitude=1.0, omega=omega), h)
        expected = s.state_of(*steady_motion(system, omega, 0.3 + omega * h, spin))
        assert_allclose(after, expected, rtol=0, atol=STEPPER * np.abs(expected).max())


@each_condition
def test_steady_accelerations_are_the_direct_accelerance(condition):
    system = rigs.paper_system(condition)
    s, omega, phase = stepper(system), 2 * np.pi * 120.0, 0.7
    state = s.state_of(*steady_motion(system, omega, phase, 0.0))
    D = dynamic_stiffness(system, np.array([omega]))
    H = receptance(D, system.unit_vector(2, 1)[:, None], system.read_out(1))[0, :, 0]
    expected = (-(omega**2) * H * np.exp(1j * phase)).imag
    computed = s.acceleration(state, np.array([np.sin(phase)]))
    assert_allclose(computed[:7], expected, rtol=0, atol=STEPPER * np.abs(expected).max())
    assert not computed[7:].any(), "the other plane is at rest"


def test_from_rest_a_long_step_settles_on_the_direct_response():
    system = rigs.paper_system(Condition(k_b=1e6, bearing_damping=200.0, shaft_damping_ratio=0.02))
    s, omega, h = stepper(system), 2 * np.pi * 60.0, 20.0
    after = advance(s, np.zeros(s.n_states), 0.0, Force(amplitude=1.0, omega=omega), h)
    expected = s.state_of(*steady_motion(system, omega, omega * h, 0.0))
    # The slowest mode has zeta omega above 1.5 1/s: exp(-30) is left of the transient after 20 s.
    assert_allclose(after, expected, rtol=0, atol=STEPPER * np.abs(expected).max())


@each_condition
@pytest.mark.parametrize("spin", [0.0, 400.0])
@settings(max_examples=10, deadline=None)
@given(parts=st.integers(2, 40), h=st.floats(1e-5, 0.05), frequency=st.floats(0, 500), held=st.floats(-5, 5))
def test_one_big_step_is_many_small_ones(condition, spin, parts, h, frequency, held):
    s = stepper(rigs.paper_system(condition), spin)
    drive = Force(held=held, amplitude=2.0, omega=2 * np.pi * frequency)
    big = advance(s, some_state(s), 0.4, drive, h * parts)
    small = some_state(s)
    for i in range(parts):
        small = advance(s, small, 0.4 + drive.omega * h * i, drive, h)
    assert_allclose(small, big, rtol=0, atol=STEPPER * np.abs(big).max())


@pytest.mark.parametrize("zeta", [0.001, 0.02])
def test_a_mode_rings_down_with_its_damping_ratio(zeta):
    """After n damped periods the deflection is exp(-2 pi n zeta / sqrt(1 - zeta^2)) of what it was."""
    system = rigs.paper_system(Condition(rigid_support=True, shaft_damping_ratio=zeta))
    modes, s = undamped_modes(system), stepper(system)
    shape, decay = modes.Phi[:, 0], 2 * np.pi * 50 * zeta / np.sqrt(1 - zeta**2)
    period = 2 * np.pi / (modes.omega[0] * np.sqrt(1 - zeta**2))
    velocity = -zeta * modes.omega[0] * shape  # the free decay's own, so that a period repeats the motion
    q, _ = s.motion_of(advance(s, s.state_of(shape, velocity), 0.0, Force(), 50 * period))
    assert_allclose(q, np.exp(-decay) * shape, rtol=0, atol=STEPPER * np.abs(shape).max())


@pytest.mark.parametrize("h", [1e-4, 3e-3, 0.4])
def test_a_held_force_gives_the_closed_form_step_response(h):
    """eta = (phi f / omega^2) [1 - e^{-zeta omega t} (cos omega_d t + zeta omega/omega_d sin omega_d t)] per mode."""
    system = rigs.paper_system(rigs.RIGID)
    modes, s, zeta = undamped_modes(system), stepper(system), system.shaft_damping_ratio
    omega_d = modes.omega * np.sqrt(1 - zeta**2)
    swing = np.cos(omega_d * h) + zeta * modes.omega / omega_d * np.sin(omega_d * h)
    eta = 3.0 * (modes.Phi.T @ system.unit_vector(2, 1)) / modes.omega**2
    expected = modes.Phi @ (eta * (1 - np.exp(-zeta * modes.omega * h) * swing))
    q, _ = s.motion_of(advance(s, np.zeros(s.n_states), 0.0, Force(held=3.0), h))
    assert_allclose(q, expected, rtol=0, atol=STEPPER * np.abs(expected).max())


def test_a_held_force_ends_in_the_static_deflection():
    system = rigs.paper_system(Condition(k_b=1e6, bearing_damping=500.0, shaft_damping_ratio=0.1))
    s = stepper(system)
    q, velocity = s.motion_of(advance(s, np.zeros(s.n_states), 0.0, Force(held=10.0), 30.0))
    static = 10.0 * np.linalg.solve(system.K, system.unit_vector(2, 1))
    assert_allclose(q, static, rtol=0, atol=STEPPER * np.abs(static).max())
    assert_allclose(velocity, 0, atol=STEPPER * undamped_modes(system).omega[0] * np.abs(static).max())


def test_a_held_force_and_a_sine_superpose():
    s, omega = stepper(rigs.paper_system(BEARING)), 2 * np.pi * 80
    drives = [Force(held=2.0, omega=omega), Force(amplitude=3.0, omega=omega), Force(2.0, 3.0, omega)]
    held, sine, both = (advance(s, np.zeros(s.n_states), 0.2, drive, 0.03) for drive in drives)
    assert_allclose(held + sine, both, rtol=0, atol=STEPPER * np.abs(both).max())


def test_an_undamped_rotor_keeps_its_energy():
    system = rigs.paper_system(Condition(k_b=1e6, shaft_damping_ratio=0.0))
    s = stepper(system)
    energies = []
    for state in (some_state(s), advance(s, some_state(s), 0.0, Force(), 5.0)):
        q, v = s.motion_of(state)
        energies.append(q @ system.K @ q + v @ system.M @ v)
    assert_allclose(energies[1], energies[0], rtol=100 * STEPPER)  # 5 s are a million radians of the highest mode


@pytest.mark.parametrize("spin", [0.0, 400.0])
def test_motion_and_state_are_each_others_inverse(spin):
    system = rigs.paper_system(BEARING)
    s = stepper(system, spin)
    q, v = 1e-6 * np.cos(np.arange(system.n)), 1e-3 * np.sin(np.arange(system.n))
    back = s.motion_of(s.state_of(q, v))
    assert_allclose(back[0], q, rtol=0, atol=ROUND_OFF * np.abs(q).max())
    assert_allclose(back[1], v, rtol=0, atol=ROUND_OFF * np.abs(v).max())
    state = some_state(s)
    assert_allclose(s.state_of(*s.motion_of(state)), state, rtol=0, atol=ROUND_OFF * np.abs(state).max())


def test_a_standing_rotor_forced_in_y_never_moves_in_z():
    system = rigs.paper_system(BEARING)
    s, state = stepper(system), np.zeros(2 * system.n)
    for i in range(20):
        state = advance(s, state, 0.1 * i, Force(held=1.0, amplitude=1.0, omega=500.0), 1e-3)
        assert not (system.read_out(2) @ s.motion_of(state)[0]).any()
        assert not s.acceleration(state, np.array([1.0]))[7:].any()
    assert (system.read_out(1) @ s.motion_of(state)[0]).any()


def test_reversing_the_spin_mirrors_the_motion_in_z():
    system = spinning_system()
    motions = []
    for spin in (400.0, -400.0):
        s = stepper(system, spin)
        state = advance(s, np.zeros(s.n_states), 0.0, Force(amplitude=1.0, omega=500.0), 0.2)
        motions.append([system.read_out(plane) @ s.motion_of(state)[0] for plane in (1, 2)])
    (y, z), (y_reversed, z_reversed) = motions
    scale = STEPPER * np.abs(y).max()
    assert np.abs(z).max() > 1e-3 * np.abs(y).max(), "the spin couples the planes"
    assert_allclose(y_reversed, y, rtol=0, atol=scale)
    assert_allclose(z_reversed, -z, rtol=0, atol=scale)


def test_acceleration_jumps_by_the_force_over_the_moving_mass():
    """A unit force changes the accelerations at once by read-out M^-1 force."""
    system = rigs.paper_system(BEARING)
    s = stepper(system)
    jump = s.acceleration(some_state(s), np.array([1.0])) - s.acceleration(some_state(s), np.array([0.0]))
    expected = system.read_out(1) @ np.linalg.solve(system.M, system.unit_vector(2, 1))
    scale = np.abs(s.acceleration(some_state(s), np.array([0.0]))).max()
    assert_allclose(jump[:7], expected, rtol=0, atol=ROUND_OFF * scale)
    assert_allclose(s.feedthrough[:, 0][:7], expected, rtol=0, atol=ROUND_OFF * np.abs(expected).max())


def test_a_rigidly_held_node_never_accelerates():
    s = stepper(rigs.paper_system(rigs.RIGID))
    accelerations = s.acceleration(some_state(s), np.array([1.0]))
    assert not accelerations[[0, 6, 7, 13]].any()


def test_a_rotor_that_swings_freely_drifts_under_a_held_force():
    """One pinned bearing: no stiffness against the swing, so the angle grows as torque t^2 / 2 I."""
    tables = rigs.tables(support=[{"node": 1, "stiffness": "k_b"}])
    condition = Condition(rigid_support=True, shaft_damping_ratio=0.01)
    system = build_system(assemble(Rig.model_validate(tables)), condition)
    s, t = stepper(system), 2.0
    q, _ = s.motion_of(advance(s, np.zeros(s.n_states), 0.0, Force(held=1.0), t))
    swing = np.zeros(len(system.structure.M))
    swing[0::4], swing[3::4] = system.structure.x, 1.0
    inertia = swing @ system.structure.M @ swing
    angle = 0.0595 * t**2 / (2 * inertia)
    tip = (system.read_out(1) @ q)[-1]
    # What is left are the elastic deflections, micrometres against metres.
    assert_allclose(tip, angle * 0.426, rtol=1e-5)


@pytest.mark.parametrize("detuning", [0.0, 1e-12, 1e-8])
def test_an_undamped_rotor_driven_at_its_resonance_grows_without_limit(detuning):
    """eta'' + omega^2 eta = b sin(omega t) from rest: eta = b (sin omega t - omega t cos omega t) / 2 omega^2."""
    system = rigs.paper_system(Condition(rigid_support=True, shaft_damping_ratio=0.0))
    modes, s, t = undamped_modes(system), stepper(system), 0.1
    omega = modes.omega[0] * (1 + detuning)
    q, _ = s.motion_of(advance(s, np.zeros(s.n_states), 0.0, Force(amplitude=1.0, omega=omega), t))
    driven = np.flatnonzero(np.abs(modes.Phi.T @ system.unit_vector(2, 1)) > 0)[0]
    shape = modes.Phi[:, driven]
    growth = (np.sin(omega * t) - omega * t * np.cos(omega * t)) / (2 * omega**2)
    eta = shape @ system.M @ q
    # Detuned by d, the closed form is off by d omega t.
    assert_allclose(eta, (shape @ system.unit_vector(2, 1)) * growth, rtol=STEPPER + 100 * detuning)


def test_a_frequency_of_zero_is_a_constant_force_even_for_a_rotor_that_swings_freely():
    tables = rigs.tables(support=[{"node": 1, "stiffness": "k_b"}])
    system = build_system(assemble(Rig.model_validate(tables)), Condition(rigid_support=True))
    s = stepper(system)
    constant = advance(s, np.zeros(s.n_states), np.pi / 2, Force(amplitude=1.0, omega=0.0), 0.5)
    held = advance(s, np.zeros(s.n_states), 0.0, Force(held=1.0), 0.5)
    assert_allclose(constant, held, rtol=0, atol=STEPPER * np.abs(held).max())
