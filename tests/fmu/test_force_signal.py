"""The input ``force``, as a co-simulation master gives it: samples at communication points.

Between them the FMU continues the signal smoothly (rotor/time/exciter.py), so that a sine of samples is
answered as the built-in sine is. These tests drive the FMU as a plain master does: set, step, read.
"""

from __future__ import annotations

import numpy as np
import pytest
from fmpy import read_model_description

from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.time.exciter import Exciter
from tests.fmu.truth import held_force

Y = [f"node_{n}.acceleration_y" for n in range(1, 8)]
READ = [*Y, "force_applied"]
SOFT = {"k_b": 2e6, "shaft_damping_ratio": 0.1, "bearing_damping": 200.0}
LINES_HZ = np.linspace(20.0, 400.0, 10)
SETTLE, MEASURE = 0.1, 0.05  # [s]; the slowest mode of this rotor falls by e in 9 ms


def phasor(time, readings, frequency_hz):
    """(n_columns,) amplitudes at one frequency, by least squares."""
    angle = 2 * np.pi * frequency_hz * time
    basis = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(time)])
    a, b, _ = np.linalg.lstsq(basis, readings, rcond=None)[0]
    return a - 1j * b


def respond(session, h, signal, parameters):
    """(n, 8) readings of a master that sets the force, steps, and then reads."""
    session.start({**parameters, "force": float(signal[0])})
    rows = []
    for k, force in enumerate(signal[:-1]):
        if k:
            session.set({"force": float(force)})
        session.step(h)
        rows.append(session.get(READ))
    return np.array(rows)


def signal_phasor(session, h, frequency_hz, parameters):
    """Amplitudes under a sine of samples with an amplitude of 1 N, once it has settled."""
    number = np.arange(round((SETTLE + MEASURE) / h) + 1)
    rows = respond(session, h, np.sin(2 * np.pi * frequency_hz * h * number), parameters)
    late = number[1:] * h > SETTLE
    return phasor(h * number[1:][late], rows[late], frequency_hz)


def sine_phasor(session, frequency_hz, parameters):
    """The same under the built-in sine."""
    h = 1e-4
    session.start({**parameters, "force_amplitude": 1.0, "force_frequency": float(frequency_hz)})
    session.step(SETTLE)
    rows = session.sample(READ, h, round(MEASURE / h))
    return phasor(SETTLE + h * np.arange(len(rows)), rows, frequency_hz)


def recommended_step(fmu):
    return float(read_model_description(str(fmu)).defaultExperiment.stepSize)


def test_a_sine_of_samples_at_the_recommended_step_is_answered_as_the_built_in_sine(rotor_fmu, rotor_session):
    """Ten lines, every node: within 1 % and 1 degree of what 1 N of the built-in sine gives."""
    h = recommended_step(rotor_fmu)
    for line in LINES_HZ:
        ratio = signal_phasor(rotor_session, h, line, SOFT) / sine_phasor(rotor_session, line, SOFT)
        assert np.abs(np.abs(ratio) - 1).max() < 0.01, line
        assert np.abs(np.angle(ratio, deg=True)).max() < 1.0, line


@pytest.mark.parametrize("h", [1e-4, 5e-4])
def test_referred_to_the_applied_force_coarse_steps_measure_the_rotor_too(rotor_session, h):
    """Of a coarse sine the applied force is too large, but it is a sine; a held force at 60 Hz would be 34 % off."""
    found, true = signal_phasor(rotor_session, h, 60.0, SOFT), sine_phasor(rotor_session, 60.0, SOFT)
    assert np.abs((found / found[-1]) / (true / true[-1]) - 1).max() < 0.01


def test_a_held_force_is_far_off_at_the_driving_point(rotor_session):
    """Negative control: the same master, the same step, the signal declared to be a staircase."""
    held = {**SOFT, "held_force.enabled": True}
    found, true = signal_phasor(rotor_session, 1e-4, 60.0, held), sine_phasor(rotor_session, 60.0, SOFT)
    assert np.abs((found / found[-1]) / (true / true[-1]) - 1)[1] > 0.05


def test_a_jump_has_the_impulse_of_its_samples(rotor_session):
    """A pulse of one sample: the shaft rings as after the held pulse, with the same momentum; 1 kHz and below."""
    pulse = np.zeros(400)
    pulse[3] = 5.0
    smooth = respond(rotor_session, 2e-5, pulse, SOFT)[40:, 2]
    held = respond(rotor_session, 2e-5, pulse, {**SOFT, "held_force.enabled": True})[40:, 2]
    slow = np.abs(np.fft.rfftfreq(len(held), 2e-5)) < 1000
    difference = np.abs(np.fft.rfft(smooth - held))[slow].max()
    assert difference < 0.05 * np.abs(np.fft.rfft(held))[slow].max()


def test_a_constant_force_is_that_force_from_the_start(rotor_session):
    rotor_session.start({"force": 3.0, **SOFT})
    readings = rotor_session.sample(["force_applied"], 1e-3, 20)
    assert (readings == 3.0).all()


def test_a_step_much_longer_than_the_last_one_holds_the_force(rotor_session):
    rotor_session.start(SOFT)
    for k in range(5):
        rotor_session.set({"force": 0.1 * k})
        rotor_session.step(1e-5)
    rotor_session.set({"force": 0.5})
    rotor_session.step(1.0)
    assert rotor_session.get(["force_applied"]) == [0.5]


def test_a_force_stands_still_at_zero_hertz(rotor_session):
    """From the phase at which the frequency falls to zero; the rotor then settles under a constant force."""
    rotor_session.start({**SOFT, "force_amplitude": 2.0, "force_frequency": 50.0})
    rotor_session.step(0.003)
    rotor_session.set({"force_frequency": 0.0})
    expected = 2 * np.sin(2 * np.pi * 50 * 0.003)
    moving = np.abs(rotor_session.get(Y)).max()
    for step in (1e-3, 0.5):
        rotor_session.step(step)
        assert rotor_session.get(["force_applied"])[0] == pytest.approx(expected, rel=1e-9)
    assert moving > 0.1
    assert np.abs(rotor_session.get(Y)).max() < 1e-6 * moving


def test_a_rotor_with_clearance_is_driven_by_the_same_force(rotor_session):
    """The nonlinear stepper takes the same course: referred to the applied force, both agree about a stiff contact."""
    joint = {**SOFT, "bearing_cubic.enabled": True, "bearing_cubic.stiffness": 1e9}
    linear = signal_phasor(rotor_session, 1e-4, 60.0, SOFT)
    almost_linear = signal_phasor(rotor_session, 1e-4, 60.0, joint)
    assert np.abs(almost_linear / linear - 1).max() < 1e-4


def test_without_memory_of_a_step_the_force_is_that_of_its_sample():
    exciter = Exciter()
    exciter.set(2.0, hold=False)
    assert exciter.course(0.1) == (2.0, 0.0, 0.0)
    exciter.give_rate(5.0)
    assert exciter.course(0.1) == (2.0, 5.0, 0.0)


def test_a_parabola_goes_on_without_a_jump_in_force_or_rate():
    rng, exciter, before = np.random.default_rng(3), Exciter(), None
    for h in (0.1, 0.1, 0.15, 0.05, 0.1, 0.1):
        exciter.set(float(rng.normal()), hold=False)
        course = exciter.course(h)
        if before:
            assert (course.force, course.rate) == pytest.approx(before)
        exciter.advance(course, h)
        before = course.after(h)


def test_the_held_force_of_the_switch_is_the_zero_order_hold(rotor_session, structure):
    u = np.cos(2 * np.pi * 50.0 * 1e-4 * np.arange(301)) + 0.3
    expected = held_force(build_system(structure, Condition()), 1e-4).respond(u[:-1])
    found = respond(rotor_session, 1e-4, u, {"held_force.enabled": True})[:, :7]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
