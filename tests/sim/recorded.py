"""Runs for the file tests: invented numbers, every bit of which must survive."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rigtwin.sim.campaign import Channel, Run

ANY_NUMBER = st.floats(allow_nan=False, allow_infinity=False)
NOT_NEGATIVE = st.floats(min_value=0.0, allow_nan=False, allow_infinity=False)
POSITIVE = st.floats(min_value=1e-9, max_value=1e9)


def a_run(**changes) -> Run:
    """Two channels in two planes, three uneven lines, standard errors and a third harmonic."""
    shape = (3, 2)
    values = np.array([[1 + 2j, 0.1 - 1e-300j], [1 / 3, -7e200j], [5e-324 + 1j, -2.5]])
    settings = {
        "frequency_hz": np.array([95.000123456789, 95.00012345679, 300.1]),
        "H": values,
        "channels": (Channel(2), Channel(5, "z")),
        "support": "bearing",
        "std": np.full(shape, 0.1),
        "harmonics": {3: values[::-1] / 7},
        "name": "run",
    }
    return Run(**{**settings, **changes})


@st.composite
def runs(draw, min_lines: int = 1) -> Run:
    """Any run: uneven lines, all or some of those swept, some sensors, with or without standard errors, harmonics and
    forces of each line, complex or not; or one of a roving exciter."""
    frequency_hz = np.array(sorted(draw(st.sets(POSITIVE, min_size=min_lines, max_size=6))))
    places = st.tuples(st.integers(1, 99), st.sampled_from(["y", "z"]), st.sampled_from(["", "b", "z"]))
    channels = tuple(Channel(*place) for place in draw(st.lists(places, min_size=1, max_size=3, unique=True)))
    shape = (len(frequency_hz), len(channels))
    magnitude_only = draw(st.booleans())

    def response() -> np.ndarray:
        values = np.zeros(shape, dtype=complex)
        values.real = draw(hnp.arrays(float, shape, elements=NOT_NEGATIVE if magnitude_only else ANY_NUMBER))
        if not magnitude_only:
            values.imag = draw(hnp.arrays(float, shape, elements=ANY_NUMBER))
        return values

    roving = draw(st.booleans())
    quantity = draw(st.sampled_from(["receptance", "mobility", "accelerance"] + ["acceleration"] * (not roving)))
    orders = st.sets(st.sampled_from([2, 3, 11]), max_size=0 if roving else 2)
    forces = hnp.arrays(float, shape[0], elements=POSITIVE)
    beside = draw(st.sets(POSITIVE, max_size=3)) - set(frequency_hz)
    return Run(
        frequency_hz=frequency_hz,
        H=response(),
        channels=channels,
        support=draw(st.sampled_from(["rigid", "bearing"])),
        std=draw(st.none() | hnp.arrays(float, shape, elements=NOT_NEGATIVE)),
        harmonics={order: response() for order in draw(orders)},
        quantity=quantity,  # type: ignore[arg-type]
        magnitude_only=magnitude_only,
        excitation_node=draw(st.integers(1, 99)),
        excitation_plane=draw(st.sampled_from(["y", "z"])),
        force_amplitude_N=draw(st.none() | st.floats(5e-324, 1.7e308)),
        spin_rpm=0.0 if roving else draw(ANY_NUMBER),
        sweep=draw(st.sampled_from([None, "up", "down"])),
        name="run",
        swept_hz=np.array(sorted(beside | set(frequency_hz))) if beside else None,
        force_N=None if roving or quantity == "acceleration" else draw(st.none() | forces),
        control=draw(st.sampled_from(["force", "response"])),
        roving="exciter" if roving else None,
    )


def assert_same_run(read: Run, written: Run, *, sign_of_zero: bool = True) -> None:
    """Every number has the same bits, everything else is equal."""

    def bits(values: np.ndarray) -> np.ndarray:
        doubles = np.ascontiguousarray(values).view(float)
        return (doubles if sign_of_zero else doubles + 0.0).view(np.int64)

    for name, expected in vars(written).items():
        value = getattr(read, name)
        if isinstance(expected, np.ndarray):
            assert value.dtype == expected.dtype, name
            np.testing.assert_array_equal(bits(value), bits(expected), err_msg=name)
        elif name == "harmonics":
            assert list(value) == sorted(expected)
            for order in expected:
                np.testing.assert_array_equal(bits(value[order]), bits(expected[order]), err_msg=f"h{order}")
        else:
            assert value == expected, name
