"""The types that every measurement has, virtual or real."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from rigtwin.sim.campaign import Campaign, Channel, MeasurementError, NominalBelief, Run
from tests.sim.recorded import a_run


def test_a_channel_is_found_by_its_node_and_plane():
    run = a_run()
    assert_array_equal(run.channel(2), run.H[:, 0])
    assert_array_equal(run.channel(5, "z"), run.H[:, 1])


@pytest.mark.parametrize("place", [(3, "y"), (2, "z"), (5, "y")])
def test_a_channel_that_was_not_measured_is_named_beside_those_that_were(place):
    with pytest.raises(MeasurementError) as refused:
        a_run().channel(*place)
    assert str(refused.value) == f"run 'run' has no channel {Channel(*place)}; it has node2, node5_z"


@pytest.mark.parametrize(
    "frequencies", [[], [0.0, 1.0, 2.0], [-1.0, 1.0, 2.0], [1.0, 3.0, 2.0], [1.0, 1.0, 2.0]], ids=str
)
def test_frequencies_must_be_positive_and_increase(frequencies):
    shape = len(frequencies), 2
    with pytest.raises(MeasurementError, match="run 'run': frequencies must be positive and increase"):
        a_run(frequency_hz=np.array(frequencies), H=np.zeros(shape, complex), std=None, harmonics={})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"H": np.zeros((2, 2), complex)}, r"H has shape \(2, 2\), expected \(3, 2\)"),
        ({"std": np.zeros(3)}, r"std has shape \(3,\), expected \(3, 2\)"),
        ({"harmonics": {3: np.zeros((3, 1), complex)}}, r"3 has shape \(3, 1\), expected \(3, 2\)"),
        ({"channels": (Channel(1),)}, r"H has shape \(3, 2\), expected \(3, 1\)"),
    ],
)
def test_every_array_has_a_line_for_each_frequency_and_a_column_for_each_channel(change, message):
    with pytest.raises(MeasurementError, match=message):
        a_run(**change)


def test_channels_sort_by_node_then_plane_and_are_called_as_in_the_files():
    channels = [Channel(5, "z"), Channel(2, "z"), Channel(10), Channel(2)]
    assert [str(c) for c in sorted(channels)] == ["node2", "node2_z", "node5_z", "node10"]


def test_a_run_of_one_line_is_a_run():
    assert len(Run(np.array([95.0]), np.ones((1, 1), complex), (Channel(2),), "rigid").frequency_hz) == 1


def test_a_campaign_believes_what_the_format_says_by_default():
    """The defaults of campaign.toml's [nominal]."""
    assert Campaign("empty", "nit-rourkela").nominal == NominalBelief(0.001, 0.0, 0.02, None, None)


def test_measured_data_cannot_be_reassigned():
    with pytest.raises(FrozenInstanceError):
        a_run().support = "rigid"  # pyright: ignore[reportAttributeAccessIssue]


def test_the_forces_of_lines_are_those_recorded_or_the_runs_own():
    force = np.array([1.0, 4.0, 2.0])
    plain = a_run(force_amplitude_N=3.0)
    assert_array_equal(plain.forces, [3.0, 3.0, 3.0])
    assert_array_equal(a_run(force_amplitude_N=None).forces, [1.0, 1.0, 1.0])
    assert_array_equal(a_run(force_amplitude_N=3.0, force_N=force).forces, force)
    assert plain.levels == (3.0,)
    assert a_run(force_amplitude_N=None).levels == ()
    assert a_run(force_amplitude_N=3.0, force_N=force).levels == (3.0,)
    assert a_run(force_amplitude_N=2.0, force_N=force, control="response").levels == (1.0, 4.0)
    doubled = a_run(force_amplitude_N=2.0, force_N=force).at_force(2.0)
    assert doubled.force_amplitude_N == 4.0
    assert_array_equal(doubled.forces, 2 * force)
    assert plain.at_force(1.0) is plain
