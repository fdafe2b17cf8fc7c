"""Where a gap lies: shares, and the joint stiffness that explains it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.answer.where import _plain, locate
from rigtwin.gap.inference.hypotheses import NOMINAL
from rigtwin.rotor.effects import AttachedMass, BearingDamping, ExciterSuspension
from rigtwin.sim.campaign import Channel
from tests.gap.conftest import K_B, both_supports, measure, problem_of

MASS = AttachedMass(mass=0.1, node=3)
EXACT = 1e-6  # noise


def located(*runs):
    """Against the nominal model at the right bearing stiffness."""
    problem = problem_of(*runs)
    nominal = problem.fit(NOMINAL, np.array([np.log(K_B)]), anneal=(0.0,), steps=0)
    return locate(problem, nominal, problem.predict(nominal), "linear")


def shares(where):
    """All shares that must sum to one."""
    return [
        [band.share for band in where.bands],
        [node.share for node in where.nodes],
        list(where.supports.values()),
        list(where.levels.values()),
    ]


@pytest.mark.parametrize("support", ["rigid", "bearing"])
@pytest.mark.parametrize("quantity", ["accelerance", "receptance"])
def test_the_joint_stiffness_of_a_mass_is_its_inertia(support, quantity):
    where = located(measure(support, (MASS,), noise=EXACT, quantity=quantity))
    joint = where.joint
    assert joint is not None
    assert (joint.node, joint.support) == (3, support)
    assert joint.order.startswith("a mass")
    assert joint.explained > 0.999
    inertia = -((2 * np.pi * np.array(joint.frequency_hz)) ** 2) * MASS.mass
    Z = np.array(joint.real) + 1j * np.array(joint.imag)
    assert np.median(np.abs(Z - inertia) / np.abs(inertia)) < 0.03


def test_the_joint_stiffness_of_a_suspension_is_a_constant():
    where = located(measure("rigid", (ExciterSuspension(stiffness=1e5, damping=0.0),), noise=EXACT))
    assert where.joint is not None
    assert where.joint.node == 2
    assert where.joint.order.startswith("a stiffness")
    assert_allclose(np.median(where.joint.real), 1e5, rtol=0.03)


def test_noise_leaves_the_node_in_place():
    where = located(*both_supports(MASS))
    assert max(where.nodes, key=lambda node: node.share).node == 3
    assert where.remark == ""


@pytest.mark.parametrize("effects", [(), (MASS,)])
def test_shares_sum_to_one(effects):
    where = located(*both_supports(*effects))
    for each in shares(where):
        assert_allclose(sum(each), 1.0)
        assert min(each) >= 0
    assert [node.node for node in where.nodes] == [1, 2, 3, 4, 5, 6, 7]
    assert set(where.supports) == {"rigid", "bearing"}
    assert where.levels == {"1": pytest.approx(1.0)}


def test_bands_join_and_hold_a_resonance_each():
    bands = located(*both_supports(MASS)).bands
    assert [band.mode for band in bands] == list(range(1, len(bands) + 1))
    assert [band.f_lo for band in bands[1:]] == [band.f_hi for band in bands[:-1]]
    assert (bands[0].f_lo, bands[-1].f_hi) == (20.0, 400.0)


def test_a_band_has_the_number_of_its_mode():
    (band,) = located(measure("rigid", (MASS,), frequency_hz=np.linspace(200.0, 400.0, 300))).bands
    assert band.mode == 2


def test_a_held_node_is_no_second_accelerometer():
    assert located(measure("rigid", (MASS,), channels=(Channel(1), Channel(2)))).remark
    assert not located(measure("rigid", (MASS,), channels=(Channel(2), Channel(3)))).remark


def test_what_acts_in_the_bearings_shows_on_bearings_alone():
    supports = located(*both_supports(BearingDamping(damping=200.0))).supports
    assert supports["bearing"] > 0.95


def test_one_accelerometer_tells_no_node():
    where = located(measure("bearing", (MASS,), channels=(Channel(4),)))
    assert where.remark
    assert_allclose([node.share for node in where.nodes], 1 / 7)


def test_magnitudes_tell_no_node():
    run = measure("bearing", (MASS,))
    where = located(replace(run, H=np.abs(run.H), magnitude_only=True))
    assert where.joint is None
    assert where.nodes == ()
    assert where.remark
    assert_allclose(sum(band.share for band in where.bands), 1.0)


def test_an_arbitrary_unit_tells_the_node_as_well():
    """The force gain is fitted, and the joint stiffness is that of the rotor, whatever the unit."""
    runs = [
        replace(run, H=9.0 * run.H, std=9.0 * np.asarray(run.std), quantity="acceleration")
        for run in both_supports(MASS, force_amplitude_N=2.0)
    ]
    problem = problem_of(*runs)
    nominal = problem.fit(NOMINAL, np.array([np.log(K_B)]), anneal=(0.0,), steps=0)
    nu = nominal.nu.copy()
    nu[problem.nuisances.gain] = np.log(9.0 / 2.0)
    nominal = replace(nominal, nu=nu)
    where = locate(problem, nominal, problem.recalibrated(nominal), "linear")
    assert max(where.nodes, key=lambda node: node.share).node == 3
    assert where.joint is not None
    inertia = -((2 * np.pi * np.array(where.joint.frequency_hz)) ** 2) * MASS.mass
    assert_allclose(np.median(np.array(where.joint.real) / inertia), 1.0, rtol=0.1)
    assert where.joint.order.startswith("a mass of 0.1")


@pytest.mark.parametrize(("size", "words"), [(0.32, "0.32"), (1.234e6, "1.2×10⁶"), (-3.4e-5, "−3.4×10⁻⁵")])
def test_sizes_are_written_with_two_digits(size, words):
    assert _plain(size) == words


def test_missing_values_hide_nothing():
    run = measure("bearing", (MASS,))
    H = run.H.copy()
    H[::5, 1] = np.nan
    where = located(replace(run, H=H))
    assert max(where.nodes, key=lambda node: node.share).node == 3
    for each in shares(where):
        assert_allclose(sum(each), 1.0)
