"""What a rig without noise would report: the measurement chain in the frequency domain."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.rotor.effects import (
    AttachedMass,
    BearingCubic,
    CoarseGrid,
    ExciterSuspension,
    FastSweep,
    ForceDropout,
    Gyroscopic,
    PedestalFlexibility,
    PlaneAnisotropy,
    SensorDelay,
    SensorGain,
    SensorMass,
    SensorPosition,
)
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.measured import ChannelGroup, channel_groups, measured_response
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from tests.rotor.rigs import paper_structure
from tests.tolerances import ROUND_OFF

STRUCTURE = paper_structure()
FREQUENCY = np.linspace(20.0, 400.0, 39)
OMEGA = 2 * np.pi * FREQUENCY
NODES = tuple(range(1, 8))

# The shaft's damping follows the modes, and so any mass that is added; formulas for a mass that is
# added to a given rotor are exact without it.
GIVEN = Condition(k_b=2e6, bearing_damping=20.0, shaft_damping_ratio=0.0)
CONDITIONS = [GIVEN, Condition(), Condition(rigid_support=True, excitation_node=4)]


def measured(*effects, condition=GIVEN, **options):
    return measured_response(STRUCTURE, condition, effects, FREQUENCY, **options)


def close(actual, expected, tolerance=ROUND_OFF):
    assert_allclose(actual, expected, rtol=0, atol=tolerance * np.abs(expected).max())


# --- what is reported ------------------------------------------------------------------------------


@pytest.mark.parametrize("condition", CONDITIONS)
def test_without_effects_it_is_the_accelerance_of_every_node(condition):
    system = build_system(STRUCTURE, condition)
    expected = accelerance(system, FREQUENCY, excitation_node=condition.excitation_node)[:, :, 0]
    close(measured(condition=condition), expected)


def test_structural_effects_are_in_the_rotor():
    effects = PedestalFlexibility(), AttachedMass()
    close(measured(*effects), accelerance(build_system(STRUCTURE, GIVEN, effects), FREQUENCY)[:, :, 0])


def test_quantities_differ_by_powers_of_i_omega():
    receptance, mobility, accelerances = (measured(quantity=q) for q in ("receptance", "mobility", "accelerance"))
    close(mobility, 1j * OMEGA[:, None] * receptance)
    close(accelerances, 1j * OMEGA[:, None] * mobility)


def test_channels_come_in_the_order_asked_for():
    effects = SensorGain(gain=1.3, node=5), SensorMass(node=2)
    close(measured(*effects, nodes=(5, 2, 6)), measured(*effects)[:, [4, 1, 5]])


def test_a_node_may_be_read_twice():
    close(measured(nodes=[2, 4, 2]), measured(nodes=[2, 4])[:, [0, 1, 0]])


def test_coupled_planes_are_seen_across_the_force_and_uncoupled_ones_are_not():
    assert not measured(plane=2).any()
    assert np.abs(measured(PlaneAnisotropy(), plane=2)).max() > 0.1 * np.abs(measured(PlaneAnisotropy())).max()
    spinning = Condition(k_b=1e6, spin_speed=600.0, excitation_plane=2)
    expected = accelerance(build_system(STRUCTURE, spinning, (Gyroscopic(),)), FREQUENCY, plane=2, spin_speed=600.0)
    close(measured(Gyroscopic(), condition=spinning), expected[:, :, 0])


# --- sensors ---------------------------------------------------------------------------------------


def test_gain_and_delay_multiply_their_channels():
    late = np.exp(-1j * OMEGA * 3e-4)[:, None]
    close(measured(SensorDelay(delay=3e-4)), late * measured())
    both = measured(SensorGain(gain=0.9, node=3), SensorDelay(delay=3e-4, node=0))
    gains = np.where(np.array(NODES) == 3, 0.9, 1.0)
    close(both, gains * late * measured())


def test_a_sensors_mass_changes_its_own_channel_only():
    """There by the formula H_sd / (1 - omega^2 m H_ss)."""
    sensor, at_4 = SensorMass(mass=0.05, node=4), Condition(**{**vars(GIVEN), "excitation_node": 4})
    H_ss = measured(condition=at_4, quantity="receptance")[:, 3]
    expected = measured()
    expected[:, 3] /= 1 - OMEGA**2 * 0.05 * H_ss
    close(measured(sensor), expected)


def test_a_roving_mass_is_at_every_node_while_that_is_read():
    roving = measured(SensorMass(mass=0.05, node=0))
    for node in NODES:
        alone = measured(SensorMass(mass=0.05, node=node))
        close(roving[:, node - 1], alone[:, node - 1])


def test_groups_are_as_few_as_can_be():
    gain, mass = SensorGain(node=2), SensorMass(node=4)
    assert channel_groups((gain,), NODES) == (ChannelGroup(NODES, (gain,)),)
    assert channel_groups((gain, mass), NODES) == (
        ChannelGroup((1, 2, 3, 5, 6, 7), (gain,)),
        ChannelGroup((4,), (gain, mass)),
    )
    assert channel_groups((mass,), (1, 2)) == (ChannelGroup((1, 2), ()),)
    roving = channel_groups((SensorMass(mass=0.03, node=0),), (3, 1))
    assert [(group.nodes, group.effects) for group in roving] == [
        ((node,), (SensorMass(mass=0.03, node=node),)) for node in (3, 1)
    ]


def test_a_sensor_beside_its_node_reads_the_bending_line_there():
    """A sensor that is moved by a whole mesh element reads the next mesh node."""
    spacing = float(STRUCTURE.x[STRUCTURE.stations[3]] - STRUCTURE.x[STRUCTURE.stations[2]])
    moved, plain = measured(SensorPosition(offset=spacing, node=3)), measured()
    close(moved[:, 2], plain[:, 3])
    close(np.delete(moved, 2, axis=1), np.delete(plain, 2, axis=1))


# --- exciter ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("node", [2, 5])
def test_per_nominal_force_a_rotor_on_constant_current_is_the_rotor_with_its_exciter(node):
    """Armature and suspension at the drive node; the sensors' own faults come on top."""
    condition, gain = Condition(**{**vars(GIVEN), "excitation_node": node}), SensorGain(gain=0.8, node=3)
    dropout = ForceDropout(mass=0.2, stiffness=2e4, damping=7.0)
    exciter = AttachedMass(mass=0.2, node=node), ExciterSuspension(stiffness=2e4, damping=7.0)
    nominal = measured(dropout, gain, condition=condition, referred_to="nominal_force")
    close(nominal, measured(*exciter, gain, condition=condition))


def test_per_force_on_the_rotor_the_exciter_is_not_seen():
    close(measured(ForceDropout()), measured())


def test_acceleration_follows_the_nominal_force():
    nominal = measured(ForceDropout(), referred_to="nominal_force")
    close(measured(ForceDropout(), quantity="acceleration", force_amplitude=3.0), 3.0 * nominal)


def test_the_exciter_feels_the_shaft_and_not_what_a_sensor_beside_it_reads():
    beside = measured(ForceDropout(), SensorPosition(node=2), referred_to="nominal_force")
    plain = measured(ForceDropout(), referred_to="nominal_force")
    close(np.delete(beside, 1, axis=1), np.delete(plain, 1, axis=1))


# --- what changes nothing, what is refused ---------------------------------------------------------


def test_raster_and_sweep_rate_change_no_settled_line():
    close(measured(CoarseGrid(), FastSweep()), measured())


def test_a_nonlinear_rotor_has_no_frequency_response():
    with pytest.raises(ValueError, match="has no frequency response"):
        measured(BearingCubic())
    measured(BearingCubic(), condition=Condition(rigid_support=True))  # no bearings, nothing nonlinear


@pytest.mark.parametrize("effect", [SensorGain(node=8), SensorDelay(node=9), SensorMass(node=8)])
def test_a_sensor_at_no_node_is_refused(effect):
    with pytest.raises(ValueError, match=rf"{effect.id}.node: node {effect.node} does not exist: .* nodes 1 to 7"):
        measured(effect)


def test_a_channel_at_no_node_is_refused():
    with pytest.raises(ValueError, match="node 8 does not exist"):
        measured(nodes=(2, 8))
