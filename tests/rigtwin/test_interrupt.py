"""Where an interrupt is taken, and where it waits."""

import pytest

from rigtwin.interrupt import _can_be_left


@pytest.mark.parametrize(
    ("modules", "left"),
    [
        (["rigtwin.sweep", "rigtwin.cli"], True),
        (["fmpy.fmi2", "sim.session", "rigtwin.sweep"], True),  # the call has come back
        (["sim.instances", "sim.session", "rigtwin.sweep"], True),
        (["rotor_rig", "fmpy.fmi2", "sim.session", "rigtwin.sweep"], False),  # the FMU's own Python runs
        (["numpy", "rotor_rig", "sim.instances", "sim.session"], False),
        (["abc", "importlib._bootstrap", "fmpy.model_description"], False),
        (["shutil", "sim.session"], False),
        (["os", "tempfile", "sim.session"], False),
    ],
)
def test_an_interrupt_waits_where_it_would_be_lost_or_leave_something_behind(modules, left):
    assert _can_be_left(modules) is left
