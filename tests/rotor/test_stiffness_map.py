"""Critical speeds and frequencies over bearing stiffness against closed forms."""

import numpy as np
from numpy.testing import assert_allclose

from rigtwin.rotor.effects import DiskInertia, Gyroscopic, PlaneAnisotropy
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.frequency.stiffness_map import (
    BearingRange,
    critical_speed_map,
    natural_frequency_map,
    stiffness_readings,
)
from rigtwin.rotor.frequency.whirl import critical_speeds
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.model.condition import Condition
from tests.rotor import rigs
from tests.tolerances import EIGENVALUE_ROUND_OFF, NEARLY_MASSLESS, ROUND_OFF, SPECTRAL

PAPER = BearingRange(rigs.paper_structure(), Condition(), (DiskInertia(), Gyroscopic()))
K_B = np.geomspace(1e4, 1e9, 26)


def test_critical_speeds_of_a_jeffcott_rotor_grow_with_the_root_of_the_stiffness():
    k_b = np.geomspace(1e3, 1e5, 5)
    found = critical_speed_map(BearingRange(assemble(rigs.jeffcott()), Condition()), k_b, n=2)
    assert_allclose(found.spin_speed, np.sqrt(k_b)[:, None] * [1.0, 1.0], rtol=1e3 * NEARLY_MASSLESS)  # 2 k_b / 2 kg
    assert found.direction[0].tolist() in ([-1, 1], [1, -1])


def test_every_line_of_the_map_is_one_whirl_and_the_map_has_what_each_stiffness_has():
    found = critical_speed_map(PAPER, K_B, n=6)
    assert (found.direction == found.direction[0]).all()
    assert (np.diff(found.spin_speed, axis=0) > 0).all()
    alone = critical_speeds(PAPER.at(K_B[12]), n=6).spin_speed
    assert_allclose(np.sort(found.spin_speed[12]), alone, rtol=SPECTRAL)


def test_lines_that_cross_are_followed():
    """Very unequal planes: the second mode of the soft one passes the first of the other, and stays in its plane."""
    rotor = BearingRange(rigs.paper_structure(), Condition(), (PlaneAnisotropy(anisotropy=1.7, angle=0.0),))
    found = critical_speed_map(rotor, np.geomspace(1e4, 1e8, 81), n=4)
    assert (np.argsort(found.spin_speed[-1]) != np.arange(4)).any(), "nothing crosses"
    assert (np.abs(np.diff(np.log(found.spin_speed), axis=0)) < 0.06).all(), "no line jumps: 20 stiffnesses a decade"


def test_a_frequency_tells_the_stiffness_of_every_mode_that_can_have_it():
    truth = 3.7e6
    f1, f2 = natural_frequencies_hz(PAPER.at(truth), plane=1)[:2]
    first, second = (stiffness_readings(PAPER, K_B, f) for f in (f1, f2))
    assert [reading.mode for reading in first] == [1, 2]
    assert [reading.mode for reading in second] == [2]
    assert_allclose([first[0].k_b, second[0].k_b], truth, rtol=EIGENVALUE_ROUND_OFF)
    assert_allclose(natural_frequencies_hz(PAPER.at(first[1].k_b), plane=1)[1], f1, rtol=ROUND_OFF)


def test_a_frequency_that_no_stiffness_gives_tells_none():
    lowest, highest = natural_frequency_map(PAPER, K_B)[[0, -1], :2].T
    assert stiffness_readings(PAPER, K_B, 0.99 * lowest[0]) == []
    between = 1.001 * highest[1]
    assert between < natural_frequency_map(PAPER, K_B)[0, 2], "a gap between the second mode and the third"
    assert stiffness_readings(PAPER, K_B, between) == []
