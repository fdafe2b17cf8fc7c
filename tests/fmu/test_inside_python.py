"""What only pythonfmu's FMU can be asked: the Python inside it."""

from __future__ import annotations

import zipfile

import pytest

from tests.fmu.child import in_child


def count_exponentials(fmu, jitter, n):
    """Matrix exponentials that n steps of nearly 1e-4 s cost the FMU, and where they lead."""
    import random
    import sys

    from rigtwin.sim.session import FmuSession

    with FmuSession(fmu) as session:
        session.start({"force_amplitude": 1.0, "spin_speed": 100.0})
        (stepper,) = (m for name, m in sys.modules.items() if name.startswith("rigtwin_") and name.endswith(".stepper"))
        made, expm = [], stepper.expm
        stepper.expm = lambda matrix: made.append(1) or expm(matrix)
        rng = random.Random(1)
        for _ in range(n):
            session.step(1e-4 * (1 + jitter * rng.uniform(-1, 1)))
        return len(made), session.get(["node_2.acceleration_y"])[0]


def test_steps_that_differ_in_their_last_bits_share_their_propagators(rotor_fmu):
    """As a master's steps do: fmpy's differ from h by some 1e-15 from one call to the next."""
    even, reading = in_child(count_exponentials, rotor_fmu, 0.0, 3000)
    jittery, reading_with_jitter = in_child(count_exponentials, rotor_fmu, 1e-12, 3000)
    assert even <= 3  # times of whole steps fall on either side of a tick
    assert jittery <= 3
    assert reading_with_jitter == pytest.approx(reading, rel=1e-5)


def test_steps_that_do_differ_are_not_taken_for_equal(rotor_fmu):
    """Negative control of the one above."""
    assert in_child(count_exponentials, rotor_fmu, 1e-3, 200)[0] > 150


def warned(fmu):
    """A step in which numpy warns, in a host that turns warnings into errors."""
    import sys
    import warnings

    from rigtwin.sim.session import FmuError, FmuSession

    with FmuSession(fmu) as session:
        session.start({"force": 1.0})
        (stepper,) = (m for name, m in sys.modules.items() if name.startswith("rigtwin_") and name.endswith(".stepper"))
        expm = stepper.expm
        stepper.expm = lambda matrix: warnings.warn("overflow", RuntimeWarning, stacklevel=2) or expm(matrix)
        message = ""
        try:
            session.step(2e-3)
        except FmuError as error:
            message = str(error)
        stepper.expm = expm
        session.start({"force": 1.0})
        session.step(1e-3)
        return message, session.get(["node_2.acceleration_y"])


def test_the_instance_survives_a_host_that_turns_warnings_into_errors(rotor_fmu, rotor_session):
    message, reading = in_child(warned, rotor_fmu, options=["-W", "error"])
    assert "RuntimeWarning" in message
    rotor_session.start({"force": 1.0})
    rotor_session.step(1e-3)
    assert reading == rotor_session.get(["node_2.acceleration_y"])


def test_it_brings_pythonfmus_glue_for_linux_and_windows(fmu):
    names = zipfile.ZipFile(fmu).namelist()
    for library in (f"binaries/linux64/{fmu.stem}.so", f"binaries/win64/{fmu.stem}.dll"):
        assert library in names
