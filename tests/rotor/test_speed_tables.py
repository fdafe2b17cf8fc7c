"""Supports that follow the spin speed: tables, whirl on a stiffness that is not symmetric, oil whip."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eig

from rigtwin.rotor.effects import Rub, unbalance_at
from rigtwin.rotor.frequency.frequency_response import accelerance, dynamic_stiffness
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import damped_modes, listed_modes
from rigtwin.rotor.frequency.stiffness_map import BearingRange, critical_speed_map, table_readings
from rigtwin.rotor.frequency.whirl import (
    critical_speeds,
    crossings,
    followed_campbell,
    speeds_through_resonances,
    stability_limits,
    synchronous_whirls,
    unbalance_response,
    unstable_speeds,
    whirl_direction,
)
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import RigError, parse_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.structure import from_arrays, to_arrays
from rigtwin.rotor.time.simulator import RotorSimulator
from tests.rotor import rigs
from tests.rotor.journals import (
    RPM,
    TABLE_RPM,
    UNDAMPED_SHAFT,
    disk_in_oil,
    film,
    jeffcott,
    oil_film,
    on_tables,
    short_bearing,
    system_of,
)
from tests.tolerances import EIGENVALUE_ROUND_OFF, NEARLY_MASSLESS, PEAK_BETWEEN_SPEEDS, SPECTRAL

K, C = 5e5, 400.0  # of each support of the Jeffcott rotor
SPEEDS = (1000.0, 5000.0, 20000.0)


def swirling(Omega):
    """An oil film that turns at half of the spin speed: k_yz = -k_zy = c Omega / 2."""
    q = C * Omega / 2
    return [[K, q], [-q, K]], [[C, 0.0], [0.0, C]]


def shaft_stiffness(rig):
    """Of the middle of a pinned shaft: 48 EI / L^3 in series with 4 kappa G A / L."""
    section, L = rigs.section_of(rig), rig.length
    return 1 / (L**3 / (48 * section.bending_stiffness) + L / (4 * section.shear_stiffness))


# -- closed forms -------------------------------------------------------------------------------------------


def test_a_jeffcott_rotor_on_a_swirling_film_becomes_unstable_at_twice_its_frequency():
    """M z'' + k_s (z - w) = 0, k_s (z - w) = 2 (k - i q) w + 2 c w': at the threshold q = c omega and
    M omega^2 = 2 k k_s / (2 k + k_s), so that with q = c Omega / 2 the rotor whirls at half of the spin speed."""
    rig = jeffcott(swirling, SPEEDS)
    k_s = shaft_stiffness(rig)
    omega = math.sqrt(2 * K * k_s / (2 * K + k_s) / 2.0)
    system = system_of(rig)
    limits = stability_limits(system, followed_campbell(system, np.linspace(1000, 20000, 20) * RPM, 6))
    assert_allclose(limits.spin_speed, [2 * omega], rtol=NEARLY_MASSLESS)
    assert_allclose(limits.eigenvalue.imag, [omega], rtol=NEARLY_MASSLESS)
    assert limits.direction.tolist() == [1.0]
    below, above = (listed_modes(system, share * 2 * omega).log_decrement[:2].min() for share in (0.99, 1.01))
    assert below > 0 > above


@pytest.mark.parametrize("rpm", [1000.0, 3456.0, 20000.0])
def test_its_eigenvalues_are_the_roots_of_its_polynomial(rpm):
    """(M l^2 + k_s) (k_s + Z) = k_s^2 with Z = 2 (k - i q + c l): a cubic in l; Im l < 0 is backward whirl."""
    rig = jeffcott(swirling, SPEEDS)
    k_s, q = shaft_stiffness(rig), C * rpm * RPM / 2
    roots = np.roots(np.polymul([2.0, 0, k_s], [2 * C, 2 * (K - 1j * q) + k_s]) - np.array([0, 0, 0, k_s**2]))
    oscillating = roots[np.argsort(-np.abs(roots.imag))][:2]  # forward: imag > 0, backward: its conjugate turns so
    expected = np.sort_complex(oscillating.real + 1j * np.abs(oscillating.imag))
    found = damped_modes(system_of(rig), rpm * RPM)
    nearest = [found.eigenvalue[np.argmin(np.abs(found.eigenvalue - value))] for value in expected]
    assert_allclose(nearest, expected, rtol=NEARLY_MASSLESS)


@pytest.mark.parametrize("eccentricity", [0.1, 0.3, 0.6])
def test_a_rigid_rotor_in_short_bearings_has_its_threshold_where_the_coefficients_say(eccentricity):
    """k_eq = (a_uu b_vv + a_vv b_uu - a_uv b_vu - a_vu b_uv) / (b_uu + b_vv) and
    gamma^2 = [(k_eq - a_uu)(k_eq - a_vv) - a_uv a_vu] / (b_uu b_vv - b_uv b_vu): whirl at gamma Omega from
    Omega^2 = k_eq / gamma^2, in units of F / (c M) [lund1987]."""
    _, a, b = short_bearing(eccentricity)
    k_eq = (a[0, 0] * b[1, 1] + a[1, 1] * b[0, 0] - a[0, 1] * b[1, 0] - a[1, 0] * b[0, 1]) / np.trace(b)
    ratio = math.sqrt(((k_eq - a[0, 0]) * (k_eq - a[1, 1]) - a[0, 1] * a[1, 0]) / np.linalg.det(b))
    load, clearance, mass = 1.0, 5e-5, 200.0  # the shaft then is rigid and weightless to a few millionths
    threshold = math.sqrt(k_eq * load / clearance * 2 / mass) / ratio

    def own(Omega):
        return a * load / clearance, b * load / (clearance * Omega)

    rpm = threshold / RPM
    system = system_of(jeffcott(own, (0.8 * rpm, rpm, 1.25 * rpm), mass_kg=mass, diameter=0.3))
    limits = stability_limits(system, followed_campbell(system, np.linspace(0.81, 1.2, 9) * threshold, 4))
    assert_allclose(limits.spin_speed, [threshold], rtol=NEARLY_MASSLESS)
    assert_allclose(limits.eigenvalue.imag / limits.spin_speed, [ratio], rtol=NEARLY_MASSLESS)


def test_the_short_bearing_of_the_tests_has_the_coefficients_that_are_printed_for_it():
    """A bearing of 100 by 30 mm, clearance 0.1 mm, 525 N, 0.1 Pa s, 1500 rev/min [friswell2010; ross2020]."""
    stiffness, damping = oil_film(525, 0.1, 0.03, 1e-4, 0.1)(1500 * RPM)
    assert_allclose(stiffness / 1e6, [[12.80796, 16.39359], [-25.06039, 8.81530]], atol=6e-6)
    assert_allclose(damping / 1e3, [[232.8970, -81.9244], [-81.9244, 294.9116]], atol=6e-5)


# -- literature -----------------------------------------------------------------------------------------------


def test_cross_coupled_bearings_have_the_frequencies_that_ross_prints():
    """Two disks on a shaft of six elements, k_xy = 0.5 MN/m and k_yx = 0: an example in the pages of ROSS [ross2020].

    Its axes x and y are y and z here. The numbers are printed with ten digits; its first pair at rest is that of a
    defective matrix and agrees to the root of its round-off.
    """
    E, G = 211e9, 81.2e9
    steel = {"youngs_modulus_Pa": E, "density_kg_per_m3": 7810.0, "poisson": E / (2 * G) - 1}
    rig = on_tables(
        lambda Omega: ([[1e6, 0.5e6], [0.0, 1e6]], np.zeros((2, 2))),
        (0.0, 10000.0),
        (1, 7),
        nodes_m=np.linspace(0, 1.5, 7).tolist(),
        segment=[rigs.round_shaft(1.5, 0.05, steel)],
        disk=[
            {
                "node": node,
                "diameter_m": diameter,
                "bore_m": 0.05,
                "thickness_m": 0.07,
                "density_kg_per_m3": 7810.0,
                "inertia": True,
            }
            for node, diameter in ((3, 0.28), (5, 0.35))
        ],
    )
    at_rest, spinning = (2 * np.pi * damped_modes(system_of(rig), rpm * RPM).frequency_hz[:6] for rpm in (0, 4000))
    printed = [84.19790045, 89.03269396, 246.44121183, 301.08623205, 594.81950178, 834.0420378]
    assert_allclose(spinning, printed, rtol=2e-8)
    printed = [86.65808619, 86.65814251, 274.31285373, 274.31285411, 716.78471745, 716.78790695]
    assert_allclose(at_rest, printed, rtol=5e-6)


# -- an independent small system --------------------------------------------------------------------------------


def beam(EI, mass, L):
    """Stiffness and consistent mass (4, 4) of an Euler-Bernoulli element in (w, w') at both ends [friswell2010]."""
    k = [[12, 6 * L, -12, 6 * L], [6 * L, 4 * L**2, -6 * L, 2 * L**2]]
    k += [[-12, -6 * L, 12, -6 * L], [6 * L, 2 * L**2, -6 * L, 4 * L**2]]
    m = [[156, 22 * L, 54, -13 * L], [22 * L, 4 * L**2, 13 * L, -3 * L**2]]
    m += [[54, 13 * L, 156, -22 * L], [-13 * L, -3 * L**2, -22 * L, 4 * L**2]]
    return EI / L**3 * np.array(k), mass * L / 420 * np.array(m)


def independent(rpm):
    """M, C + Omega G and K of ``disk_in_oil``, assembled here: all (w, w') of y, then all of z."""
    lengths, EI, mass = (0.25, 0.25, 0.3), 207e9 * math.pi * 0.05**4 / 64, 7840 * math.pi * 0.05**2 / 4
    M, D, S = (np.zeros((16, 16)) for _ in range(3))
    for plane in (0, 8):
        for number, L in enumerate(lengths):
            block = slice(plane + 2 * number, plane + 2 * number + 4)
            k, m = beam(EI, mass, L)
            S[block, block] += k
            M[block, block] += m
        M[plane + 2, plane + 2] += 60.0
        M[plane + 3, plane + 3] += 0.8
    D[3, 11], D[11, 3] = 1.5 * rpm * RPM, -1.5 * rpm * RPM
    rows = [film(row * RPM) for row in TABLE_RPM]
    for place in np.ndindex(2, 2):
        k, c = (np.interp(rpm, TABLE_RPM, [row[which][place] for row in rows]) for which in (0, 1))
        for node in (0, 6):
            S[8 * place[0] + node, 8 * place[1] + node] += k
            D[8 * place[0] + node, 8 * place[1] + node] += c
    return M, D, S


@pytest.mark.parametrize("rpm", [2000.0, 4000.0, 5432.1, 11000.0])
def test_eigenvalues_in_oil_are_those_of_a_system_that_was_assembled_independently(rpm):
    M, D, S = independent(rpm)
    Z, one = np.zeros((16, 16)), np.eye(16)
    values = eig(np.block([[Z, one], [-S, -D]]), np.block([[one, Z], [Z, M]]), right=False)
    expected = values[values.imag > 1e-6 * np.abs(values).max()]
    expected = expected[np.argsort(np.abs(expected))]
    found = damped_modes(system_of(disk_in_oil(), element=euler_bernoulli), rpm * RPM).eigenvalue
    assert_allclose(found[:6], expected[:6], rtol=EIGENVALUE_ROUND_OFF)


def test_oil_whip_sets_in_between_the_rows_where_the_independent_system_says():
    def growth(rpm):
        M, D, S = independent(rpm)
        A = np.block([[np.zeros((16, 16)), np.eye(16)], [-np.linalg.solve(M, S), -np.linalg.solve(M, D)]])
        return np.linalg.eigvals(A).real.max()

    system = system_of(disk_in_oil(), element=euler_bernoulli)
    limits = stability_limits(system, followed_campbell(system, np.linspace(2000, 11000, 31) * RPM, 6))
    assert len(limits.spin_speed) == 1
    rpm = float(limits.spin_speed[0] / RPM)
    print(f"oil whip from {rpm:.1f} rev/min, whirl ratio {limits.eigenvalue[0].imag / limits.spin_speed[0]:.3f}")
    assert growth(rpm * (1 - 1e-6)) < 0 < growth(rpm * (1 + 1e-6))
    assert limits.direction[0] == 1
    outside = unstable_speeds(system, np.array([0.9, 1.1]) * limits.spin_speed[0])
    assert_allclose(outside, [1.1 * limits.spin_speed[0]])


def test_the_response_in_oil_is_that_of_the_independent_system():
    """Also from a force in y to the motion in z, which the reverse does not equal: K is not symmetric."""
    rpm, f = 3210.0, np.array([20.0, 47.0, 130.0])
    M, D, S = independent(rpm)
    w = 2 * np.pi * f[:, None, None]
    H = np.linalg.inv(S + 1j * w * D - w**2 * M)
    structure = assemble(disk_in_oil(), element=euler_bernoulli)
    condition = Condition(shaft_damping_ratio=0.0, spin_speed=rpm * RPM, excitation_node=2)
    system = build_system(structure, condition)
    found = accelerance(system, f, excitation_node=2, plane=1, spin_speed=rpm * RPM)
    nodes = [0, 2, 4, 6]
    assert_allclose(found[:, :, 0], -(w[:, :, 0] ** 2) * H[:, nodes, 2], rtol=1e-8)
    across = measured_response(structure, condition, (), f, plane=2)
    expected = -(w[:, :, 0] ** 2) * H[:, [8 + n for n in nodes], 2]
    assert_allclose(across, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())
    assert np.abs(H[:, 10, 2] - H[:, 2, 10]).max() > 0.1 * np.abs(H[:, 10, 2]).max()


def test_the_response_to_unbalance_takes_each_speed_with_its_own_coefficients():
    rpm = np.array([2500.0, 3600.0, 6000.0])
    rotor = assemble(disk_in_oil(), element=euler_bernoulli)
    condition = Condition(shaft_damping_ratio=0.0, spin_speed=rotor.lowest_spin_speed)
    model = build_model(rotor, condition, [unbalance_at(2, 1e-4, 0.0)])
    found = unbalance_response(model, rpm * RPM)
    for place, speed in enumerate(rpm):
        M, D, S = independent(speed)
        Omega = speed * RPM
        force = np.zeros(16, dtype=complex)
        force[[2, 10]] = 1e-4 * Omega**2 * np.array([1, -1j])
        q = np.linalg.solve(S + 1j * Omega * D - Omega**2 * M, force)
        assert_allclose(found[place], [q[[0, 2, 4, 6]], q[[8, 10, 12, 14]]], rtol=1e-8)


def test_the_rotor_in_time_grows_as_its_eigenvalue_says():
    """Above the threshold, from a kick: the ratio of its motion a period of the whirl later is e^(Re lambda T)."""
    structure = assemble(disk_in_oil())
    rpm = 10500.0
    condition = Condition(shaft_damping_ratio=0.001, spin_speed=rpm * RPM)
    system = build_system(structure, condition)
    values = damped_modes(system, rpm * RPM).eigenvalue
    worst = values[np.argmax(values.real)]
    assert worst.real > 0
    rotor, T = RotorSimulator(structure, condition), 2 * np.pi / worst.imag
    rotor.drive(force=100.0, force_amplitude=0.0, force_frequency=0.0)
    rotor.advance(0.0, 1e-3)
    rotor.drive(force=0.0, force_amplitude=0.0, force_frequency=0.0)
    settled = max(40, round(8 / worst.real / T)) * T  # the other motions have died
    rotor.advance(rotor.time, settled)
    before = rotor.accelerations()
    rotor.advance(rotor.time, T)
    assert_allclose(rotor.accelerations() / before, math.exp(worst.real * T), rtol=1e-6)


def test_a_change_of_speed_keeps_deflections_and_takes_other_coefficients():
    structure = assemble(disk_in_oil())
    slow, fast = (Condition(spin_speed=rpm * RPM) for rpm in (2500.0, 5000.0))
    rotor = RotorSimulator(structure, slow)
    rotor.drive(force=0.0, force_amplitude=50.0, force_frequency=40.0)
    rotor.advance(0.0, 0.3)
    before = rotor._stepper.motion_of(rotor._state)
    rotor.configure(fast)
    after = rotor._stepper.motion_of(rotor._state)
    for one, other in zip(before, after, strict=True):
        assert_allclose(one, other, rtol=1e-9, atol=1e-12 * np.abs(one).max())
    rotor.advance(rotor.time, 20.0)
    system = build_system(structure, fast)
    expected = np.abs(accelerance(system, np.array([40.0]), excitation_node=2, spin_speed=fast.spin_speed)[0, :, 0])
    samples = []
    for _ in range(200):
        rotor.advance(rotor.time, 1 / 40.0 / 200)
        samples.append(rotor.accelerations()[:4])
    assert_allclose(np.abs(samples).max(axis=0), 50.0 * expected, rtol=1e-3)
    with pytest.raises(ValueError, match=r"from 2000 to 11000 rev/min and does not hold 1999 rev/min"):
        rotor.configure(Condition(spin_speed=1999 * RPM))
    rotor.advance(rotor.time, 1e-3)  # nothing was changed


def test_unbalance_in_time_settles_on_the_response_of_the_tables():
    structure = assemble(disk_in_oil())
    condition = Condition(spin_speed=4500 * RPM)
    unbalanced = [unbalance_at(2, 1e-4, 0.3)]
    rotor = RotorSimulator(structure, condition, unbalanced)
    rotor.advance(0.0, 20.0)
    turn = 2 * np.pi / condition.spin_speed
    samples = []
    for _ in range(64):
        rotor.advance(rotor.time, turn / 64)
        samples.append(rotor.accelerations())
    found = np.abs(2 / 64 * np.exp(-2j * np.pi * np.arange(64) / 64) @ np.array(samples))
    (q,) = unbalance_response(build_model(structure, condition, unbalanced), np.array([condition.spin_speed]))
    assert_allclose(found, condition.spin_speed**2 * np.abs(q).ravel(), rtol=1e-6)


def test_harmonic_balance_of_a_rub_solves_the_equations_on_tables():
    """Every harmonic at every degree of freedom, with a K that is not symmetric."""
    structure = assemble(disk_in_oil())
    condition = Condition(spin_speed=4500 * RPM, excitation_node=2)
    model = build_model(structure, condition, [Rub(stiffness=1e6, gap=2e-5, node=2)])
    f = np.array([35.0, 46.0])
    motions = Balance(model, condition).solve(f, 400.0)
    assert np.abs(motions.forces).max() > 1.0  # it touches
    system = model.system
    force = np.zeros((*motions.joints.shape[:2], system.n), dtype=complex)
    force[:, 1] = motions.force_amplitude * system.unit_vector(2, 1)
    force -= motions.forces @ motions.balance.forces.patterns
    w = 2 * np.pi * f[:, None, None, None] * np.arange(force.shape[1])[:, None, None]
    D = system.K + 1j * w * (system.C + condition.spin_speed * system.G) - w**2 * system.M
    q = np.linalg.solve(D, force[..., None])[..., 0]
    expected = -(w[..., 0] ** 2) * (q @ system.read_out(1).T) / 400.0
    assert_allclose(motions.acceleration(), expected, atol=SPECTRAL * np.abs(expected).max())


# -- tables -------------------------------------------------------------------------------------------------


def test_coefficients_follow_straight_lines_and_end_with_the_table():
    (table, _) = assemble(disk_in_oil()).speed_tables
    for row, speed in enumerate(table.spin_speed):
        assert_allclose(table.at(speed), (table.stiffness[row], table.damping[row]), rtol=1e-15)
    between = table.at(0.25 * table.spin_speed[1] + 0.75 * table.spin_speed[2])
    for values, found in zip((table.stiffness, table.damping), between, strict=True):
        assert_allclose(found, 0.25 * values[1] + 0.75 * values[2], rtol=1e-12)
    assert_allclose(
        table.at(table.spin_speed[0] * (1 - 4e-6)), table.at(table.spin_speed[0])
    )  # written with six digits
    for outside in (0.999 * table.spin_speed[0], 1.001 * table.spin_speed[-1], -table.spin_speed[1], np.nan):
        with pytest.raises(ValueError, match="the table of the support at node 1 runs from 2000 to 11000 rev/min"):
            table.at(outside)


def test_a_table_that_never_changes_is_a_plain_support():
    stiffness, damping = 3e6, 250.0
    keys = {"nodes_m": [0.0, 0.2, 0.4], "segment": [rigs.round_shaft(0.4, 0.02)], "disk": [{"node": 2, "mass_kg": 2.0}]}
    held = on_tables(lambda Omega: (stiffness * np.eye(2), damping * np.eye(2)), (0.0, 9000.0), (1, 3), **keys)
    supports = [{"node": node, "stiffness": stiffness, "damping_Ns_per_m": damping} for node in (1, 3)]
    supports.append({"node": 2, "stiffness": "k_b"})  # a rig needs one; so soft that it does nothing
    plain = rigs.rig(support=supports, **keys)
    soft = Condition(k_b=1e-6, shaft_damping_ratio=0.002)
    one, other = system_of(held, condition=soft), build_system(assemble(plain), soft)
    for rpm in (0.0, 6000.0):
        found, expected = (listed_modes(system, rpm * RPM) for system in (one, other))
        assert_allclose(found.eigenvalue, expected.eigenvalue, rtol=SPECTRAL)
        assert np.array_equal(found.alike, expected.alike)
    assert one.circulatory is None


def test_without_cross_coupling_the_planes_keep_apart_at_rest():
    def own(Omega):
        return np.diag([1e6 + Omega, 2e6 + Omega]), np.diag([100.0, 50.0])

    modes = listed_modes(system_of(jeffcott(own, (0.0, 9000.0))), 0.0)
    assert set(modes.plane.tolist()) == {1, 2}
    spinning = listed_modes(system_of(jeffcott(own, (0.0, 9000.0))), 500.0)  # no inertia, no gyroscopic moments
    assert spinning.frequency_hz[0] > modes.frequency_hz[0]


def test_reversing_the_cross_coupling_makes_the_whirl_grow_backward():
    def backward(Omega):
        stiffness, damping = swirling(Omega)
        return np.transpose(stiffness), damping

    Omega = 15000 * RPM
    for own, direction in ((swirling, 1.0), (backward, -1.0)):
        system = system_of(jeffcott(own, SPEEDS))
        modes = damped_modes(system, Omega)
        grows = modes.eigenvalue.real > 0
        assert whirl_direction(system, modes.shape[:, grows]).tolist() == [direction]


def test_speeds_of_a_system_are_all_the_same_system():
    """``at`` gives what building at that speed gives, to the last bit, and leaves a rotor without tables alone."""
    structure = assemble(disk_in_oil())
    conditions = [Condition(spin_speed=rpm * RPM) for rpm in (2000.0, 7654.3)]
    slow, fast = (build_system(structure, condition) for condition in conditions)
    taken = slow.at(conditions[1].spin_speed)
    for name in ("M", "K", "C_support", "C"):
        assert np.array_equal(getattr(taken, name), getattr(fast, name))
    plain = rigs.paper_system(Condition())
    assert plain.at(123.0) is plain
    with pytest.raises(ValueError, match="one plane"):
        slow.in_plane(1).at(300.0)
    with pytest.raises(ValueError, match="does not hold 0 rev/min"):
        StateSpace(slow)
    assert not np.array_equal(dynamic_stiffness(slow, np.ones(1), 300.0), dynamic_stiffness(slow, np.ones(1), 400.0))


def test_a_structure_with_tables_survives_its_arrays():
    structure = assemble(disk_in_oil())
    again = from_arrays(to_arrays(structure))
    assert [t.node for t in again.speed_tables] == [1, 4]
    assert np.array_equal(again.table_stiffness, structure.table_stiffness)
    assert again.spin_range == pytest.approx((2000 * RPM, 11000 * RPM))
    assert rigs.paper_structure().lowest_spin_speed == 0.0


# -- critical speeds ----------------------------------------------------------------------------------------


def test_critical_speeds_on_tables_are_where_damped_whirls_meet_the_spin_speed():
    system = system_of(disk_in_oil())
    low, high = (rpm * RPM for rpm in (2000.0, 11000.0))
    met = synchronous_whirls(system, low, high)
    assert len(met.spin_speed)
    assert_allclose(met.eigenvalue.imag, met.spin_speed, rtol=EIGENVALUE_ROUND_OFF)
    same = crossings(system, followed_campbell(system, np.linspace(low, high, 40), 6))
    assert set(same.spin_speed.round(3)) <= set(met.spin_speed.round(3))
    with pytest.raises(ValueError, match="no undamped critical speeds"):
        critical_speeds(system)
    speeds = speeds_through_resonances(system, low, high, 50)
    assert speeds.min() >= low
    assert speeds.max() <= high
    assert len(speeds) > 50


def test_peaks_of_the_response_on_tables_are_resolved():
    structure = assemble(disk_in_oil())
    condition = Condition(spin_speed=structure.lowest_spin_speed)
    model = build_model(structure, condition, [unbalance_at(2, 1e-4, 0.0)])
    low, high = 2000 * RPM, 6000 * RPM
    coarse, fine = speeds_through_resonances(model.system, low, high, 20), np.linspace(low, high, 4000)
    peaks = [np.abs(unbalance_response(model, speeds)[:, 0, 1]).max() for speeds in (coarse, fine)]
    assert peaks[0] == pytest.approx(peaks[1], rel=PEAK_BETWEEN_SPEEDS)


def test_the_map_over_stiffness_has_bearings_in_place_of_tables():
    """Where k_yy meets a line, a rotor on plain bearings of that stiffness has its critical speed there."""

    def own(Omega):
        return np.diag([4e5 + 500 * Omega, 9e5 + 500 * Omega]), np.diag([100.0, 100.0])

    rig = jeffcott(own, (0.0, 30000.0))
    rotor = BearingRange(assemble(rig), UNDAMPED_SHAFT)
    speeds = critical_speed_map(rotor, np.geomspace(1e4, 1e8, 21), 2)
    k_s = shaft_stiffness(rig)
    for reading in table_readings(rotor, speeds):
        own = {1: 4e5, 2: 9e5}[reading.plane] + 500 * reading.spin_speed
        assert reading.k_b == pytest.approx(own, rel=1e-9)
        omega = math.sqrt(2 * own * k_s / (2 * own + k_s) / 2.0)
        assert reading.spin_speed == pytest.approx(omega, rel=NEARLY_MASSLESS)
    assert {(r.node, r.plane) for r in table_readings(rotor, speeds)} == {(1, 1), (1, 2), (3, 1), (3, 2)}


# -- rig files ------------------------------------------------------------------------------------------------

RIG = """
name = "mine"
nodes_m = [0.0, 0.2, 0.4]
[[segment]]
length_m = 0.4
diameter_m = 0.02
youngs_modulus_Pa = 207e9
density_kg_per_m3 = 7840
[[support]]
node = 1
stiffness = "table"
[support.table]
spin_rpm = [1000, 2000]
kyy_N_per_m = [1e7, 2e7]
kzz_N_per_m = [1e7, 2e7]
kyz_N_per_m = [-1e6, -2e6]
cyy_Ns_per_m = [1e3, 1e3]
czz_Ns_per_m = [1e3, 1e3]
[[support]]
node = 3
stiffness = "k_b"
"""


def test_a_rig_file_holds_a_table_below_its_support():
    rig = parse_rig(RIG)
    (table,) = assemble(rig).speed_tables
    assert table.stiffness[1].tolist() == [[2e7, -2e6], [0.0, 2e7]]
    assert rig.has_tables
    assert rig.has_bearings


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[1000, 2000]", "[2000, 1000]", "support 1 table: spin_rpm must increase"),
        ("[1000, 2000]", "[1000, 2000, 3000]", "kyy_N_per_m has 2 values, and spin_rpm has 3: give one for each speed"),
        ("[1000, 2000]", "[1000]", "support 1 table spin_rpm"),
        ("[1000, 2000]", "[-1000, 2000]", "support 1 table spin_rpm 1"),
        ("[-1e6, -2e6]", "[]", "kyz_N_per_m has 0 values"),
        ("kyy_N_per_m = [1e7, 2e7]", "kyy_N_per_m = [1e7, nan]", "support 1 table kyy_N_per_m 2"),
        ("kyy_N_per_m = [1e7, 2e7]", "", "support 1 table kyy_N_per_m: is missing"),
        ("kyz_N_per_m", "kxy_N_per_m", "did you mean kzy_N_per_m"),
        ('stiffness = "table"', "stiffness = 1e6", 'stiffness = "table" and a [support.table] go together'),
        ('stiffness = "k_b"', 'stiffness = "table"', 'stiffness = "table" and a [support.table] go together'),
        ('stiffness = "table"', 'stiffness = "table"\ndamping_Ns_per_m = 1.0', "a table has its own damping"),
    ],
)
def test_a_wrong_table_gives_one_sentence_with_its_key(old, new, words):
    with pytest.raises(RigError) as raised:
        parse_rig(RIG.replace(old, new, 1), "my.toml")
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


def test_tables_without_a_common_speed_are_refused():
    table = RIG[RIG.index("[support.table]") : RIG.rindex("[[support]]")]
    other = table.replace("[1000, 2000]", "[3000, 4000]")
    with pytest.raises(RigError, match="node 1 runs from 1000 to 2000 rev/min, and another one has none of these"):
        parse_rig(RIG.replace('"k_b"', '"table"') + other)
