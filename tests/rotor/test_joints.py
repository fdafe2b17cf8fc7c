"""Joints between two sections of a shaft, against the closed form of two beams on a spring."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, newton

from rigtwin.rotor.effects import JointMicroslip
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, RigError, load_rig, parse_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.rotor.time.simulator import RotorSimulator
from tests.rotor.rigs import RIGID, held, rig, round_shaft, section_of

LENGTH, ELEMENTS = 1.0, 16

# Error of the second frequency with so many elements in each half; it falls with the fourth power of their number.
DISCRETISATION = 2e-6


def jointed(**joint: Any) -> Rig:
    """A pinned beam with a joint in its middle."""
    supports = [{"node": node, "stiffness": "k_b"} for node in (1, 3)]
    beam = round_shaft(LENGTH, 0.02)
    joints = [{"node": 2} | joint] if joint else []
    return rig(nodes_m=[0.0, LENGTH / 2, LENGTH], segment=[beam], support=supports, joint=joints)


def system_of(beam: Rig) -> LinearSystem:
    undamped = Condition(rigid_support=True, shaft_damping_ratio=0.0)
    return held(beam, elements=ELEMENTS, element=euler_bernoulli, condition=undamped)


def frequencies(beam: Rig) -> np.ndarray:
    """The first frequencies of bending in y [rad/s]."""
    return system_of(beam).in_plane(1).modes.omega[:3]


def omega(beta: Any) -> Any:
    """Frequency [rad/s] that belongs to a wave number of bending."""
    section = section_of(jointed())
    return beta**2 * np.sqrt(section.bending_stiffness / (section.density * section.area))


def symmetric(tilt: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """EI beta (tan(beta l) - tanh(beta l)) = 4 k: a pinned half beam whose end has no shear and turns against 2 k."""
    EI, half = section_of(jointed()).bending_stiffness, LENGTH / 2
    return lambda beta: EI * beta * (np.tan(beta * half) - np.tanh(beta * half)) - 4 * tilt(beta)


def antisymmetric(stiffness: float) -> Callable[[float], float]:
    """EI beta^3 (coth(beta l) - cot(beta l)) = 4 k: a pinned half beam, its end free to turn, slides against 2 k."""
    EI, half = section_of(jointed()).bending_stiffness, LENGTH / 2
    return lambda beta: EI * beta**3 * (1 / math.tanh(beta * half) - 1 / math.tan(beta * half)) - 4 * stiffness


@pytest.mark.parametrize("softness", [0.01, 1.0, 30.0])
def test_two_beams_on_a_rotational_spring_have_the_frequencies_of_the_closed_form(softness):
    tilt = section_of(jointed()).bending_stiffness / (softness * LENGTH)
    first = brentq(symmetric(lambda _: tilt), 0.01, math.pi / LENGTH - 1e-9)
    found = frequencies(jointed(tilt_stiffness_Nm_per_rad=tilt))
    np.testing.assert_allclose(found[0], omega(first), rtol=DISCRETISATION)
    np.testing.assert_allclose(found[1], frequencies(jointed())[1], rtol=DISCRETISATION)  # it has no moment there


@pytest.mark.parametrize("softness", [0.01, 1.0])
def test_two_beams_on_a_shear_spring_have_the_frequencies_of_the_closed_form(softness):
    stiffness = section_of(jointed()).bending_stiffness / (softness * LENGTH**3)
    beta = brentq(antisymmetric(stiffness), 0.01, 2 * math.pi / LENGTH - 1e-9)
    found = frequencies(jointed(stiffness_N_per_m=stiffness))
    assert np.min(np.abs(found / omega(beta) - 1)) < DISCRETISATION
    assert np.min(np.abs(found / frequencies(jointed())[0] - 1)) < DISCRETISATION  # it has no shear there


def test_a_joint_damps_as_the_closed_form_does():
    tilt = section_of(jointed()).bending_stiffness / LENGTH
    start = brentq(symmetric(lambda _: tilt), 0.01, math.pi / LENGTH - 1e-9)
    damping = 0.05 * tilt / float(omega(start))
    beta = newton(symmetric(lambda beta: tilt + 1j * omega(beta) * damping), start * (1 + 0.01j), tol=1e-13)
    modes = damped_modes(
        system_of(jointed(tilt_stiffness_Nm_per_rad=tilt, tilt_damping_Nms_per_rad=damping)).in_plane(1)
    )
    frequency = complex(omega(beta))
    assert modes.frequency_hz[0] * 2 * math.pi == pytest.approx(abs(frequency), rel=DISCRETISATION)
    assert modes.damping_ratio[0] == pytest.approx(frequency.imag / abs(frequency), rel=1e-5)


def test_a_joint_at_a_position_is_a_joint_at_a_node():
    here = jointed(tilt_stiffness_Nm_per_rad=500.0)
    moved = here.model_copy(update={"joint": [here.joint[0].model_copy(update={"node": None, "x_m": LENGTH / 2})]})
    np.testing.assert_array_equal(frequencies(moved), frequencies(here))
    beside = jointed(node=None, x_m=0.3 * LENGTH, tilt_stiffness_Nm_per_rad=500.0)
    assert assemble(beside).x.tolist() == [0.0, 0.3, 0.3, 0.5, 1.0]
    assert frequencies(beside)[1] < 0.99 * frequencies(here)[1]  # it lies where the second mode bends


def test_what_a_modulus_changes_is_the_shaft_and_not_the_joint():
    """With four times the modulus the closed form of a joint that is four times as soft beside it."""
    tilt, stiffer = section_of(jointed()).bending_stiffness / LENGTH, EFFECTS["shaft_modulus"](factor=4.0)
    structure = assemble(
        jointed(tilt_stiffness_Nm_per_rad=tilt), element=euler_bernoulli, elements_between_nodes=ELEMENTS
    )
    found = build_system(structure, RIGID, [stiffer]).in_plane(1).modes.omega[0]
    beta = brentq(symmetric(lambda _: tilt / 4), 0.01, math.pi / LENGTH - 1e-9)
    assert found == pytest.approx(2 * omega(beta), rel=DISCRETISATION)


def test_a_crack_beside_a_joint_is_one_anywhere():
    """The rotor turned round, with the crack on the other side of its joint, has the same frequencies."""
    mirrored = [
        build_system(
            assemble(jointed(tilt_stiffness_Nm_per_rad=500.0), elements_between_nodes=4),
            RIGID,
            [EFFECTS["open_crack"](reduction=0.4, position=x)],
        ).modes.omega[:6]
        for x in (0.45, 0.55)
    ]
    np.testing.assert_allclose(mirrored[0], mirrored[1], rtol=1e-9)
    assert mirrored[0][0] < 0.999 * frequencies(jointed(tilt_stiffness_Nm_per_rad=500.0))[0]


def test_the_response_across_a_joint_is_reciprocal():
    beam = jointed(node=None, x_m=0.4, tilt_stiffness_Nm_per_rad=200.0, tilt_damping_Nms_per_rad=0.1)
    fine = beam.model_copy(update={"nodes_m": [0.0, 0.2, 0.7, LENGTH], "support": _ends(4)})
    system = build_system(assemble(fine, elements_between_nodes=4), RIGID)
    lines = np.array([20.0, 40.0, 80.0])
    there, back = (accelerance(system, lines, excitation_node=node)[:, 5 - node - 1, 0] for node in (2, 3))
    np.testing.assert_allclose(there, back, rtol=1e-8)


def _ends(last: int) -> Any:
    return [
        support.model_copy(update={"node": node}) for support, node in zip(jointed().support, (1, last), strict=True)
    ]


RIG = """
name = "two-parts"
nodes_m = [0.0, 0.5, 1.0]
[[segment]]
length_m = 1.0
diameter_m = 0.02
youngs_modulus_Pa = 2e11
density_kg_per_m3 = 7800
[[support]]
node = 1
stiffness = "k_b"
[[support]]
node = 3
stiffness = "k_b"
"""


@pytest.mark.parametrize(
    ("joint", "problem"),
    [
        ("tilt_stiffness_Nm_per_rad = 10.0", "joint 1: give node or x_m, one of the two"),
        ("node = 2\nx_m = 0.5\ntilt_stiffness_Nm_per_rad = 10.0", "joint 1: give node or x_m, one of the two"),
        ("node = 2", "joint 1: gives no way at all: give stiffness_N_per_m or tilt_stiffness_Nm_per_rad a number"),
        (
            "node = 2\ntilt_stiffness_Nm_per_rad = 10.0\ndamping_Ns_per_m = 1.0",
            "joint 1: damping_Ns_per_m does nothing beside a rigid stiffness_N_per_m",
        ),
        (
            "node = 2\nstiffness_N_per_m = 10.0\ntilt_damping_Nms_per_rad = 1.0",
            "joint 1: tilt_damping_Nms_per_rad does nothing beside a rigid tilt_stiffness_Nm_per_rad",
        ),
        ("node = 4\nstiffness_N_per_m = 10.0", "rig: joint 1: node 4 does not exist, the rig has 3 nodes"),
        ("node = 3\nstiffness_N_per_m = 10.0", "rig: joint 1: lies at 1 m, and the shaft runs from 0 to 1 m"),
        (
            "node = 2\nstiffness_N_per_m = 10.0\n[[joint]]\nx_m = 0.5\nstiffness_N_per_m = 10.0",
            "rig: joint 2: there is another joint at 0.5 m; merge them",
        ),
    ],
)
def test_a_joint_that_makes_no_sense_is_refused(joint, problem):
    with pytest.raises(RigError) as refused:
        parse_rig(f"{RIG}[[joint]]\n{joint}\n", "rig.toml")
    assert str(refused.value).startswith(f"rig.toml: {problem}")


def test_another_joint_is_another_rotor():
    beam = jointed(tilt_stiffness_Nm_per_rad=500.0)
    assert not beam.same_rotor(jointed(tilt_stiffness_Nm_per_rad=501.0))
    assert load_rig("nit-rourkela").joint == []


SLIPPING = jointed(tilt_stiffness_Nm_per_rad=500.0)
DAMPED = Condition(k_b=1e7, shaft_damping_ratio=0.02, excitation_node=2)


def slipping(**numbers: float) -> Balance:
    return Balance(build_model(assemble(SLIPPING), DAMPED, [JointMicroslip(**numbers)]), DAMPED, harmonics=5)


def stiffness(balance: Balance, angle: float) -> complex:
    """Fundamental of the moment that the laws add, over the joint's stiffness and the amplitude of its angle."""
    joints = np.zeros((1, balance.harmonics + 1, 1), dtype=complex)
    joints[0, 1] = angle
    return complex(balance.forces.harmonics(joints)[0, 1, 0]) / (500.0 * angle)


@pytest.mark.parametrize("p", [0.7, 1.0, 1.5])
def test_a_joint_loses_what_a_continuous_law_does(p):
    """Backbone k x - c x^(1 + p), c = k / (1 + p) / theta_s^p: 4 c X^(2 + p) p / (2 + p) a cycle [segalman2005]."""
    balance = slipping(angle=0.02, exponent=p)
    for share in (0.02, 0.05, 0.1, 0.3):
        expected = 4 / ((1 + p) * (2 + p)) * p * share**p / np.pi
        assert stiffness(balance, 0.02 * share).imag == pytest.approx(expected, rel=0.15)
        assert -1.2 < stiffness(balance, 0.02 * share).real / (share**p / (1 + p)) < -0.8  # and is as much softer


def test_a_second_contact_stiffens_a_joint_beyond_its_gap():
    plain, closing = slipping(angle=0.02), slipping(angle=0.02, contact=0.3, gap=1e-3)
    assert stiffness(closing, 0.9e-3) == pytest.approx(stiffness(plain, 0.9e-3), rel=1e-3)
    assert stiffness(closing, 1.0).real - stiffness(plain, 1.0).real == pytest.approx(0.3, rel=0.01)


def test_a_joint_at_rest_is_that_of_the_rig_file():
    balance, hz = slipping(angle=0.02), np.linspace(10.0, 60.0, 6)
    system = build_system(assemble(SLIPPING), DAMPED)
    linear = accelerance(system, hz)[:, :, 0]
    H = balance.solve(hz, 1e-6).acceleration()[:, 1]
    np.testing.assert_allclose(H, linear, rtol=1e-6)


def test_a_rigid_direction_of_a_joint_does_not_slip():
    rotor = assemble(jointed(stiffness_N_per_m=1e6))
    assert not build_model(rotor, DAMPED, [JointMicroslip()]).forces


@pytest.mark.long
def test_stepping_through_time_settles_on_the_loop_of_harmonic_balance():
    hz, force, rotor = 20.0, 40.0, assemble(SLIPPING)
    simulator = RotorSimulator(rotor, DAMPED, [JointMicroslip(angle=0.05)])
    simulator.drive(force=0.0, force_amplitude=force, force_frequency=hz)
    per_period, periods = 64, 40
    readings = []
    for step in range(periods * per_period):
        simulator.advance(step / (hz * per_period), 1 / (hz * per_period))
        if step >= (periods - 1) * per_period:
            readings.append(simulator.accelerations()[1])
    t = (np.arange((periods - 1) * per_period, periods * per_period) + 1) / (hz * per_period)
    fundamental = 2 * np.mean(np.array(readings) * np.exp(-2j * np.pi * hz * t))
    expected = force * slipping(angle=0.05).solve(hz, force).acceleration()[0, 1, 1]
    linear = force * slipping(angle=1e6).solve(hz, force).acceleration()[0, 1, 1]
    assert abs(fundamental) == pytest.approx(abs(expected), rel=0.01)
    assert abs(abs(expected) / abs(linear) - 1) > 0.05
