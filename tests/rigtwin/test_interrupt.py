"""Where an interrupt is taken, and where it waits."""

import signal
import sys
from types import FunctionType

import pytest

from rigtwin import interrupt


@pytest.fixture(autouse=True)
def installed():
    """The command line's handlers; this test's tracing, if any, goes on after them."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    tracing = sys.gettrace()
    interrupt.install()
    yield
    sys.settrace(tracing)
    for number, handler in before.items():
        signal.signal(number, handler)


def in_module(name, function):
    """The function, as if it stood in the module."""
    return FunctionType(function.__code__, {**function.__globals__, "__name__": name}, closure=function.__closure__)


def through(modules, done):
    """A call that leads through functions of the modules, the innermost first, to where the signal arrives.

    Each notes that it has come to its end.
    """

    def arrive():
        signal.raise_signal(signal.SIGTERM)
        done.append("signal")

    call = in_module(modules[0], arrive)
    for module in modules[1:]:
        call = in_module(module, passing_on(call, done, module))
    return call


def passing_on(call, done, module):
    def go_on():
        call()
        done.append(module)

    return go_on


@pytest.mark.parametrize(
    ("modules", "finished"),
    [
        (["rigtwin.commands.sweep", "rigtwin.cli"], 0),
        (
            ["fmpy.fmi2", "rigtwin.sim.session", "rigtwin.commands.sweep"],
            1,
        ),  # a call into the FMU, whose glue may hold the signal
        (["rigtwin.sim.instances", "rigtwin.sim.session", "rigtwin.commands.sweep"], 1),
        (["rotor_rig", "fmpy.fmi2", "rigtwin.sim.session", "rigtwin.commands.sweep"], 2),  # the FMU's own Python runs
        (["numpy", "rotor_rig", "fmpy.fmi2", "rigtwin.sim.instances", "rigtwin.sim.session"], 4),
        (["abc", "importlib._bootstrap", "fmpy.model_description"], 2),
        (["shutil", "rigtwin.sim.session"], 1),
        (["os", "tempfile", "rigtwin.sim.session"], 2),
    ],
)
def test_an_interrupt_waits_where_it_would_be_lost_or_leave_something_behind(modules, finished):
    done = []
    with pytest.raises(KeyboardInterrupt):
        through(modules, done)()
    assert done == ["signal", *modules[1:]][:finished]
    assert sys.gettrace() is None


def test_an_interrupt_is_not_lost_where_the_frame_outside_returns_at_once():
    done = []
    outside = in_module("rigtwin.sim.session", lambda: through(["fmpy.fmi2"], done)())
    with pytest.raises(KeyboardInterrupt):
        outside()
    assert done == ["signal"]


def test_an_interrupt_takes_the_place_of_an_error_inside():
    def fail():
        signal.raise_signal(signal.SIGTERM)
        raise ValueError("the FMU's")

    with pytest.raises(KeyboardInterrupt):
        in_module("fmpy.fmi2", fail)()


def test_a_second_signal_while_the_first_waits_is_one_interrupt():
    def twice():
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        in_module("fmpy.fmi2", twice)()
    assert sys.gettrace() is None


def test_an_interrupt_comes_before_the_end_of_a_try_whose_last_call_it_waited_for():
    closed = []

    def outside():
        try:
            through(["fmpy.fmi2"], [])()
        finally:
            closed.append(True)

    with pytest.raises(KeyboardInterrupt):
        outside()
    assert closed == [True]
