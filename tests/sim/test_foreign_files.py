"""Files as other software writes them: units, names for numbers, Fortran, bytes like a closing line."""

from __future__ import annotations

import logging
import re
import struct
from typing import Any

import numpy as np
import pytest

from rigtwin.sim.campaign import Channel, MeasurementError
from rigtwin.sim.formats.run_file import read_run, write_run
from tests.sim.test_formats import a_run

VALUES = np.array([1.5 - 2j, 0.25 + 0.5j, -3 + 1j])
FREQUENCY_HZ = np.array([20.0, 20.5, 21.0])


def text_58(
    rsp=("NONE", 3, 2), ref=("NONE", 5, 2), *, motion="m/s^2", force="N", axis="Hz", factor=1.0, step=0.5, at=20.0
):
    """A dataset 58 by the columns of the standard, single precision and even."""
    sixth = f"{4:5d}{0:10d}{1:5d}{0:10d} {rsp[0]:<10}{rsp[1]:10d}{rsp[2]:4d} {ref[0]:<10}{ref[1]:10d}{ref[2]:4d}"
    axes = ((18, "Frequency", axis), (12, "Acceleration", motion), (13, "Force", force), (0, "NONE", "NONE"))
    records = [f"{kind:10d}{0:5d}{0:5d}{0:5d} {name:<20} {unit:<20}" for kind, name, unit in axes]
    values = VALUES * factor
    numbers = "".join(f"{part:13.5E}" for value in values for part in (value.real, value.imag))
    form = f"{5:10d}{len(values):10d}{1:10d}{at:13.5E}{step:13.5E}{0:13.5E}"
    return "\n".join(["    -1", "    58", *["NONE"] * 5, sixth, form, *records, numbers, "    -1", ""])


def read(tmp_path, *datasets, **told: Any):
    path = tmp_path / "foreign.uff"
    path.write_text("".join(datasets))
    return read_run(path, support="rigid", **told)


@pytest.mark.parametrize(
    ("motion", "force", "factor"),
    [("g", "N", 9.80665), ("mm/s²", "N", 1e-3), ("in/s^2", "lbf", 0.0254 / 4.4482216152605), ("(m/s/s)", "kN", 1e-3)],
)
def test_a_unit_that_a_label_names_is_turned_into_si_and_said(tmp_path, caplog, motion, force, factor):
    with caplog.at_level(logging.WARNING):
        run = read(tmp_path, text_58(motion=motion.replace("²", "^2"), force=force))
    np.testing.assert_allclose(run.H[:, 0], VALUES * factor, rtol=1e-12)
    assert "turned into SI" in caplog.text


def test_a_label_that_nobody_knows_counts_as_si_and_is_said(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(read(tmp_path, text_58(motion="V")).H[:, 0], VALUES)
    assert "the unit 'V' is not known" in caplog.text


def test_frequencies_in_radians_or_turns_are_turned_into_hertz(tmp_path):
    for axis, unit in (("rad/s", 2 * np.pi), ("RPM", 60.0)):
        run = read(tmp_path, text_58(axis=axis, at=20 * unit, step=0.5 * unit))
        np.testing.assert_allclose(run.frequency_hz, FREQUENCY_HZ, rtol=5e-6)  # six digits


def test_a_label_of_another_unit_wins_over_the_factors_and_one_of_si_does_not(tmp_path):
    millimetres = "\n".join(
        ["    -1", "   164", f"{9:10d}{'mm':>20}{1:10d}", "  1.0D+03  1.0D+00  1.0D+00", "  0.0D+00", "    -1", ""]
    )
    np.testing.assert_allclose(read(tmp_path, millimetres, text_58()).H[:, 0], VALUES / 1000)
    np.testing.assert_allclose(read(tmp_path, millimetres, text_58(motion="g")).H[:, 0], VALUES * 9.80665)


def test_numbers_of_fortran_are_numbers(tmp_path):
    text = text_58().replace("E+", "D+").replace("E-", "D-")
    np.testing.assert_array_equal(read(tmp_path, text).H[:, 0], VALUES)
    np.testing.assert_allclose(read(tmp_path, text_58().replace("  1.50000E+00", "  1.500000-101")).H[0, 0], -2j)


def test_numbers_that_touch_or_stand_apart_are_read_alike(tmp_path):
    touching = text_58(factor=-1.0).replace(f"{-1.5:13.5E}{2.0:13.5E}", "-1.5000000000-2.0000000000")
    np.testing.assert_array_equal(read(tmp_path, touching).H[0, 0], -1.5 - 2j)
    apart = re.sub(r"(?m)^  1\.50000E.*$", lambda line: " ".join(line[0].split()), text_58())
    np.testing.assert_array_equal(read(tmp_path, apart).H[:, 0], VALUES)


def test_a_number_that_did_not_fit_its_column_is_named_with_its_line(tmp_path):
    with pytest.raises(
        MeasurementError, match=r"foreign.uff: .*line 14: '\*{13}' is not a number \(the number did not"
    ):
        read(tmp_path, text_58().replace(f"{1.5:13.5E}", 13 * "*"))


def test_a_channel_without_a_number_has_the_place_that_its_name_says(tmp_path):
    run = read(tmp_path, text_58(rsp=("2Y+", 0, 0), ref=("6Z-", 0, 0)), excitation_plane="z")
    assert (run.channels, run.excitation_node) == ((Channel(2),), 6)
    np.testing.assert_array_equal(run.H[:, 0], -VALUES)


def test_channels_say_where_named_and_nameless_responses_are(tmp_path):
    datasets = text_58(rsp=("Acc 1", 0, 2)), text_58(rsp=("Acc 2", 0, 2), factor=2.0), text_58(rsp=("NONE", 0, 2))
    told = {"Acc 1": "node2", "Acc 2": "-node4_z", "3": "node5"}
    run = read(tmp_path, *datasets, channels=told)
    assert run.channels == (Channel(2), Channel(4, "z"), Channel(5))
    np.testing.assert_array_equal(run.H, np.column_stack([VALUES, -2 * VALUES, VALUES]))
    for channels, problem in (
        ({}, r'responses have no number of a node; .*channels = \{"Acc 1" = "node2"\}'),
        ({**told, "Acc 9": "node2"}, "channels: 'Acc 9' is in the file neither as a name nor as the number"),
        ({**told, "3": "knot5"}, "channels: 'knot5' is no channel; write node2"),
    ):
        with pytest.raises(MeasurementError, match=problem):
            read(tmp_path, *datasets, channels=channels)


def test_channels_name_the_columns_of_a_csv(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("f;A1 real;A1 imag\n20;1,5;-2\n")
    names = {"f": "frequency_Hz", "A1 real": "node3_re", "A1 imag": "node3_im"}
    assert read_run(path, support="rigid", channels=names).H.item() == 1.5 - 2j
    with pytest.raises(MeasurementError, match="channels: no column is called 'A2'; the file has f, A1 real, A1 imag"):
        read_run(path, support="rigid", channels={**names, "A2": "node2_abs"})
    write_run(a_run(), tmp_path / "run.h5")
    with pytest.raises(MeasurementError, match="channels: is for CSV and universal files"):
        read_run(tmp_path / "run.h5", support="rigid", channels=names)


@pytest.mark.parametrize("counted", ["right", "wrong"])
@pytest.mark.parametrize("order", [1, 2])
def test_bytes_that_look_like_a_closing_line_are_numbers(tmp_path, order, counted):
    """The count of values says where a binary dataset ends; that of bytes is wrong in many files."""
    text = text_58().split("\n")
    closing = struct.unpack("<d", b"\n    -1\n")[0]  # as a number in the middle of the others
    numbers = [1.5, -2.0, closing if order == 1 else 0.25, 0.5, -3.0, 1.0]
    body = struct.pack(f"{'<' if order == 1 else '>'}6d", *numbers)
    n_bytes = len(body) if counted == "right" else 7
    first = f"    58b{order:6d}{2:6d}{11:12d}{n_bytes:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    header = [first, *text[2:8], f"{6:10d}" + text[8][10:], *text[9:13]]
    again = text_58(rsp=("NONE", 4, 2))
    path = tmp_path / "binary.uff"
    path.write_bytes("\n".join(["    -1", *header, ""]).encode() + body + b"\n    -1\n" + again.encode())
    run = read_run(path, support="rigid")
    assert run.channels == (Channel(3), Channel(4))
    np.testing.assert_array_equal(run.H[:, 0], np.array(numbers[::2]) + 1j * np.array(numbers[1::2]))
    np.testing.assert_array_equal(run.H[:, 1], VALUES)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("g/N", 9.80665), ("mm/s^2", 1e-3), ("in/s²/lbf", 0.0254 / 4.4482216152605), ("(m/s^2)/kN", 1e-3), ("µm/N", 1e-6)],
)
def test_a_run_says_in_which_unit_its_file_is(tmp_path, unit, factor):
    written = a_run()
    write_run(written, tmp_path / "run.csv")
    run = read_run(tmp_path / "run.csv", support="rigid", unit=unit, frequency_unit="rpm")
    np.testing.assert_allclose(run.H, written.H * factor, rtol=1e-12)
    np.testing.assert_allclose(run.harmonics[3], written.harmonics[3] * factor, rtol=1e-12)
    assert run.std is not None
    assert written.std is not None
    np.testing.assert_allclose(run.std, written.std * factor, rtol=1e-12)
    np.testing.assert_allclose(run.frequency_hz, written.frequency_hz / 60, rtol=1e-12)


def test_what_the_campaign_says_of_units_wins_over_the_labels_of_a_file(tmp_path):
    run = read(tmp_path, text_58(motion="mm/s^2", axis="rad/s"), unit="g", frequency_unit="kHz")
    np.testing.assert_allclose(run.H[:, 0], VALUES * 9.80665)
    np.testing.assert_allclose(run.frequency_hz, FREQUENCY_HZ * 1000)
    np.testing.assert_allclose(read(tmp_path, text_58(motion="g"), unit="mm/s^2").H[:, 0], VALUES / 1000)


def test_a_unit_that_nobody_knows_is_refused_by_name(tmp_path):
    write_run(a_run(), tmp_path / "run.csv")
    cases: dict[str, dict[str, Any]] = {"'V' is no unit": {"unit": "V"}, "'m' is no unit": {"frequency_unit": "m"}}
    for words, told in cases.items():
        with pytest.raises(MeasurementError, match=f"run.csv: .*unit: .*{words}"):
            read_run(tmp_path / "run.csv", support="rigid", **told)
