"""From a rig to matrices: mass, signs, and the gyroscopic effect against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.rotor.effects import DiskInertia, Gyroscopic
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.frequency.whirl import campbell
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import DOF_PER_NODE
from tests.rotor import rigs
from tests.tolerances import FINE_MESH, NEARLY_MASSLESS, ROUND_OFF

UNDAMPED = Condition(rigid_support=True, shaft_damping_ratio=0.0)
DISK = {"mass_kg": 1.66, "diametral_inertia_kg_m2": 1.68e-3, "polar_inertia_kg_m2": 3.27e-3, "inertia": True}
Y, Z, THETA_Y, THETA_Z = range(DOF_PER_NODE)


@pytest.fixture(scope="module")
def with_disks():
    disks = [{"node": node, **DISK} for node in (3, 5)]
    return assemble(Rig.model_validate(rigs.tables(disk=disks, mass=[{"node": 2, "mass_kg": 0.3}])))


@pytest.mark.parametrize("matrix", ["M", "K"])
def test_mass_and_stiffness_are_symmetric(with_disks, matrix):
    A = getattr(with_disks, matrix)
    assert_allclose(A, A.T, rtol=0, atol=1e-15 * np.abs(A).max())


def test_gyroscopic_matrix_is_skew(with_disks):
    G = with_disks.G
    assert np.abs(G).max() > 0
    assert_allclose(G, -G.T, rtol=0, atol=1e-15 * np.abs(G).max())


def test_gyroscopic_matrix_couples_the_planes_only(with_disks):
    in_y = np.isin(np.arange(len(with_disks.G)) % DOF_PER_NODE, (Y, THETA_Z))
    assert not with_disks.G[np.ix_(in_y, in_y)].any()
    assert not with_disks.G[np.ix_(~in_y, ~in_y)].any()


def rigid_motions(x: np.ndarray) -> dict[str, np.ndarray]:
    """Rigid translations and small rotations of the whole rotor about the left end."""
    motions = {name: np.zeros(DOF_PER_NODE * len(x)) for name in ("y", "z", "about z", "about y")}
    motions["y"][Y::DOF_PER_NODE] = motions["z"][Z::DOF_PER_NODE] = 1
    motions["about z"][Y::DOF_PER_NODE], motions["about z"][THETA_Z::DOF_PER_NODE] = x, 1
    motions["about y"][Z::DOF_PER_NODE], motions["about y"][THETA_Y::DOF_PER_NODE] = -x, 1
    return motions


@pytest.mark.parametrize("motion", ["y", "z", "about z", "about y"])
def test_a_rotor_without_supports_moves_freely(with_disks, motion):
    forces = with_disks.K @ rigid_motions(with_disks.x)[motion]
    assert_allclose(forces, 0, atol=ROUND_OFF * np.abs(with_disks.K).max())


@pytest.mark.parametrize("motion", ["y", "z"])
def test_translation_carries_the_total_mass(with_disks, motion):
    rigid = rigid_motions(with_disks.x)[motion]
    shaft = 7840 * np.pi * 0.01**2 * 0.426
    assert_allclose(rigid @ with_disks.M @ rigid, shaft + 2 * DISK["mass_kg"] + 0.3, rtol=ROUND_OFF)


@pytest.mark.parametrize("motion", ["about y", "about z"])
def test_rotation_carries_the_total_moment_of_inertia(with_disks, motion):
    rigid = rigid_motions(with_disks.x)[motion]
    L, r = 0.426, 0.01
    shaft = 7840 * np.pi * r**2 * L * (L**2 / 3 + r**2 / 4)
    disks = sum(DISK["mass_kg"] * x**2 + DISK["diametral_inertia_kg_m2"] for x in (0.119, 0.307))
    assert_allclose(rigid @ with_disks.M @ rigid, shaft + disks + 0.3 * 0.0595**2, rtol=ROUND_OFF)


def test_conical_motion_carries_the_total_polar_inertia(with_disks):
    motions = rigid_motions(with_disks.x)
    shaft = 7840 * np.pi * 0.01**2 * 0.426 * 0.01**2 / 2
    polar = shaft + 2 * DISK["polar_inertia_kg_m2"]
    assert_allclose(motions["about y"] @ with_disks.G @ motions["about z"], polar, rtol=ROUND_OFF)


@pytest.mark.parametrize("effect", [Gyroscopic(), DiskInertia()])
def test_effects_give_a_disk_only_the_inertia_that_it_lacks(with_disks, effect):
    nominal, with_it = (build_system(with_disks, UNDAMPED, effects) for effects in ([], [effect]))
    assert_array_equal(with_it.M, nominal.M)
    assert_array_equal(with_it.G, nominal.G)
    lumped = assemble(Rig.model_validate(rigs.tables(disk=[{"node": 3, **DISK, "inertia": False}])))
    bare, given = (build_system(lumped, UNDAMPED, effects) for effects in ([], [effect]))
    inertia = DISK["polar_inertia_kg_m2"] if isinstance(effect, Gyroscopic) else DISK["diametral_inertia_kg_m2"]
    assert max(np.abs(given.M - bare.M).max(), np.abs(given.G - bare.G).max()) == pytest.approx(inertia)


def test_the_papers_disks_weigh_what_their_dimensions_say():
    rig = load_rig("nit-rourkela")
    assert_allclose(rig.disk[0].mass, 7840 * np.pi * 0.062**2 * 0.018, rtol=1e-14)
    assert not any(disk.diametral_inertia or disk.polar_inertia for disk in rig.disk)


def overhung(polar_share: float) -> Rig:
    """A disk at the free end of a light clamped shaft."""
    disk = {"node": 2, "mass_kg": 2.0, "diametral_inertia_kg_m2": 0.01, "inertia": True}
    disk["polar_inertia_kg_m2"] = polar_share * 0.01
    return rigs.cantilever(rigs.round_shaft(0.3, 0.02, rigs.LIGHT_STEEL), disk=[disk])


def overhung_whirl(rig: Rig, spin_speed: float) -> np.ndarray:
    """Whirl speeds [rad/s] of the overhung disk, negative backward, ascending.

    With y + i z = W e^{i omega t} and the slope S of the cantilever's end:

        (12 EI/L^3 - m omega^2) W - 6 EI/L^2 S                              = 0
        -6 EI/L^2 W + (4 EI/L - I_d omega^2 + I_p Omega omega) S            = 0
    """
    EI, L, disk = rigs.section_of(rig).bending_stiffness, rig.length, rig.disk[0]
    translation = [-disk.mass, 0.0, 12 * EI / L**3]
    tilt = [-disk.diametral_inertia, disk.polar_inertia * spin_speed, 4 * EI / L]
    roots = np.roots(np.polymul(translation, tilt) - np.array([0, 0, 0, 0, (6 * EI / L**2) ** 2]))
    return np.sort(roots.real)


@pytest.mark.parametrize("polar_share", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("spin_speed", [0.0, 300.0, 1500.0])
def test_an_overhung_disk_whirls_as_in_closed_form(polar_share, spin_speed):
    rig = overhung(polar_share)
    system = rigs.held(rig, elements=1, element=euler_bernoulli, condition=UNDAMPED)
    computed = 2 * np.pi * campbell(system, np.array([spin_speed]), n_modes=4).frequency_hz[0]
    assert_allclose(computed, np.sort(np.abs(overhung_whirl(rig, spin_speed))), rtol=NEARLY_MASSLESS)


def test_spin_stiffens_forward_whirl_and_softens_backward_whirl():
    system = rigs.held(overhung(2.0), elements=1, element=euler_bernoulli, condition=UNDAMPED)
    standing, spinning = campbell(system, np.array([0.0, 300.0]), n_modes=4).frequency_hz
    assert spinning[0] < standing[0] < spinning[1]


@pytest.mark.parametrize("spin_speed", [300.0, -300.0])
def test_forward_whirl_turns_with_the_spin(spin_speed):
    """y = cos, z = sin is a turn about +x: z lags y by a quarter, z = -i y."""
    system = rigs.held(overhung(2.0), elements=1, element=euler_bernoulli, condition=UNDAMPED)
    modes = damped_modes(system, spin_speed)
    y, z = (system.unit_vector(2, plane) @ modes.shape for plane in (1, 2))
    backward, forward = (z / y)[:2]
    turn = -1j * np.sign(spin_speed)
    assert_allclose([backward, forward], [-turn, turn], rtol=0, atol=NEARLY_MASSLESS)


@pytest.mark.parametrize("spin_speed", [0.0, 2000.0])
def test_a_spinning_shaft_splits_its_own_whirl_as_in_closed_form(spin_speed):
    beam = rigs.pinned_beam(rigs.round_shaft(0.4, 0.04))
    system = rigs.held(beam, elements=24, condition=UNDAMPED)
    backward, forward = rigs.pinned_timoshenko_whirl(rigs.section_of(beam), 0.4, 1, spin_speed)
    computed = 2 * np.pi * campbell(system, np.array([spin_speed]), n_modes=2).frequency_hz[0]
    assert_allclose(computed, [backward, forward], rtol=FINE_MESH)
    if spin_speed:
        # The split itself, a hundred times smaller than the frequencies.
        assert_allclose(np.diff(computed), forward - backward, rtol=0.01)


def test_refinement_keeps_the_rigs_nodes():
    for elements in (1, 3):
        structure = assemble(load_rig("nit-rourkela"), elements_between_nodes=elements)
        assert_allclose(structure.x[structure.stations], load_rig("nit-rourkela").nodes_m, rtol=0, atol=1e-15)
        assert len(structure.x) == 6 * elements + 1


@pytest.mark.parametrize(("node", "plane"), [(0, 1), (8, 1), (1, 0), (1, 3)])
def test_a_node_or_plane_that_does_not_exist_is_refused(with_disks, node, plane):
    with pytest.raises(ValueError, match="does not exist"):
        with_disks.dof(node, plane)
