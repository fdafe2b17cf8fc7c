"""Data files: what is written is read back, and a wrong file is refused with its place and a remedy."""

from __future__ import annotations

import logging
import pkgutil
import re
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyuff
import scipy.io
from hypothesis import given, settings

from rigtwin.sim.campaign import Channel, MeasurementError
from rigtwin.sim.formats import SUFFIXES, read_run, write_run
from rigtwin.sim.formats.settings import settings_of
from tests.repetitions import every_second_is_long
from tests.sim.recorded import a_run, assert_same_run, runs

FEW = settings(max_examples=40, deadline=None)
FEWER = settings(max_examples=10, deadline=None)  # each is read in a process of its own


def read_text(tmp_path: Path, text: str, **told):
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    return read_run(path, **{"support": "rigid", **told})


def refusal(tmp_path: Path, text: str) -> str:
    """The message a CSV text is refused with, without the folder."""
    with pytest.raises(MeasurementError) as refused:
        read_text(tmp_path, text)
    assert "\n" not in str(refused.value)
    return str(refused.value).removeprefix(f"{tmp_path}/")


# --- every format --------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".uff", ".unv"])
@given(run=runs())
@FEW
def test_uff_keeps_every_bit_and_every_setting(suffix, run):
    keeps(suffix, run)


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
@given(run=runs())
@FEWER
def test_binary_files_keep_every_bit_and_every_setting(suffix, run):
    keeps(suffix, run)


def keeps(suffix, run):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{suffix}"
        write_run(run, path)
        assert_same_run(read_run(path), run, sign_of_zero=suffix not in (".uff", ".unv"))


@given(run=runs())
@FEW
def test_csv_keeps_every_bit(run):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        write_run(run, path)
        assert_same_run(read_run(path, **settings_of(run)), run)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_run_of_one_line_is_a_run(tmp_path, suffix):
    run = a_run(frequency_hz=np.array([95.0]), H=np.ones((1, 2), complex), std=None, harmonics={})
    write_run(run, tmp_path / f"run{suffix}")
    assert_same_run(read_run(tmp_path / f"run{suffix}", support="bearing"), run)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_the_campaign_says_wins_over_the_file(tmp_path, suffix, caplog):
    path = tmp_path / f"run{suffix}"
    write_run(a_run(sweep="up", spin_rpm=3000.0), path)
    with caplog.at_level(logging.WARNING):
        run = read_run(path, support="rigid", excitation_node=4, force_amplitude_N=None, spin_rpm=10.0, sweep=None)
    assert (run.support, run.excitation_node, run.force_amplitude_N) == ("rigid", 4, None)
    assert (run.spin_rpm, run.sweep) == (10.0, None)
    assert ("support = 'bearing'" in caplog.text) == (suffix != ".csv")


def test_defaults_are_those_of_the_contract(tmp_path):
    run = read_text(tmp_path, "frequency_Hz,node2_re,node2_im\n95,1,2\n")
    assert (run.excitation_node, run.excitation_plane, run.force_amplitude_N) == (2, "y", 1.0)
    assert (run.spin_rpm, run.quantity, run.sweep, run.std) == (0.0, "accelerance", None, None)
    assert (run.name, run.harmonics, run.magnitude_only) == ("run", {}, False)


def test_at_constant_exciter_current_the_force_is_unknown_unless_said(tmp_path):
    text = "frequency_Hz,node2_abs\n95,1\n"
    assert read_text(tmp_path, text, quantity="acceleration").force_amplitude_N is None
    assert read_text(tmp_path, text, quantity="acceleration", force_amplitude_N=0.5).force_amplitude_N == 0.5


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"run{suffix}"
    write_run(a_run(), path)
    before = path.read_bytes()

    def disk_full(run):
        raise OSError("no space left on device")

    for place in ("csv_file._columns", "uff._blocks", "hdf5.arrays_of", "matlab.texts_of"):
        monkeypatch.setattr(f"rigtwin.sim.formats.{place}", disk_full)
    with pytest.raises(OSError, match="no space left"):
        write_run(a_run(name="other"), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("suffix", "step"), [(".h5", "h5py.Group.create_dataset"), (".uff", "rigtwin.sim.formats.uff._dataset_58")]
)
def test_a_failure_in_the_middle_of_a_file_leaves_the_old_one(tmp_path, suffix, step, monkeypatch):
    path = tmp_path / f"run{suffix}"
    write_run(a_run(), path)
    before = path.read_bytes()
    real, calls = pkgutil.resolve_name(step), []

    def fails_the_third_time(*arguments, **keywords):
        calls.append(arguments)
        if len(calls) == 3:
            raise OSError("no space left on device")
        return real(*arguments, **keywords)

    monkeypatch.setattr(step, fails_the_third_time)
    with pytest.raises(OSError, match="no space left"):
        write_run(a_run(), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        (
            {"H": np.array([[1, 2], [np.nan, 2], [1, 2]], dtype=complex)},
            r"H of node2 at 95\.00012345679 Hz is not a fin",
        ),
        ({"std": np.array([[0.1, 0.1], [0.1, 0.1], [0.1, np.inf]])}, r"std of node5_z at 300\.1 Hz is not a finite"),
        ({"std": np.array([[0.1, 0.1], [0.1, -0.1], [0.1, 0.1]])}, r"std of node5_z at 95\.00012345679 Hz is negative"),
        ({"magnitude_only": True}, r"H of node2 at 95\.000123456789 Hz is no magnitude"),
        ({"harmonics": {3: np.full((3, 2), np.nan, complex)}}, r"h3 of node2 at 95\.000123456789 Hz is not a finite"),
        ({"harmonics": {1: np.ones((3, 2), complex)}}, r"harmonics are of order \[1\]; they count from 2"),
        ({"channels": (Channel(2), Channel(2))}, r"channels are \[node2, node2\]; a run needs one or more, each once"),
        ({"force_amplitude_N": 0.0}, r"force_amplitude_N: Input should be greater than 0"),
    ],
)
def test_no_file_is_written_from_values_no_file_may_hold(tmp_path, suffix, changes, problem):
    path = tmp_path / f"run{suffix}"
    with pytest.raises(MeasurementError, match=rf"run\{suffix}: {problem}"):
        write_run(a_run(**changes), path)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_file_an_unknown_suffix_and_a_missing_folder_are_named(tmp_path):
    with pytest.raises(MeasurementError, match=r"nowhere\.csv: no such file"):
        read_run(tmp_path / "nowhere.csv", support="rigid")
    for call in (lambda p: read_run(p, support="rigid"), lambda p: write_run(a_run(), p)):
        with pytest.raises(MeasurementError, match=r"run\.xlsx: unknown kind of file; a run is one of \.csv, \.uff"):
            call(tmp_path / "run.xlsx")
    with pytest.raises(MeasurementError, match=r"the folder .*missing does not exist"):
        write_run(a_run(), tmp_path / "missing" / "run.csv")


@pytest.mark.parametrize(
    ("told", "problem"),
    [
        ({"support": "loose"}, "support: Input should be 'rigid' or 'bearing'"),
        ({"support": "rigid", "excitation_node": 0}, "excitation_node: Input should be greater than or equal to 1"),
        ({"support": "rigid", "force_amplitude_N": -1.0}, "force_amplitude_N: Input should be greater than 0"),
        ({"support": "rigid", "spin_rpm": np.nan}, "spin_rpm: Input should be a finite number"),
        ({"support": "rigid", "sweep": "sideways"}, "sweep: Input should be 'up' or 'down'"),
        ({"support": "rigid", "quantity": "compliance"}, "quantity: Input should be 'receptance', 'mobility'"),
        ({"support": "rigid", "exciter_node": 2}, "exciter_node: unknown key"),
        ({}, 'support is not known; say support = "rigid" or "bearing"'),
    ],
)
def test_a_wrong_setting_is_named(tmp_path, told, problem):
    write_run(a_run(), tmp_path / "run.csv")
    with pytest.raises(MeasurementError, match=f"run.csv: {problem}"):
        read_run(tmp_path / "run.csv", **told)


@pytest.mark.parametrize("suffix", [".uff", ".h5", ".mat", ".csv"])
def test_a_file_of_another_kind_is_refused_by_name(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)))
    with pytest.raises(MeasurementError, match=rf"run\{suffix}: "):
        read_run(path, support="rigid")


# --- CSV -----------------------------------------------------------------------------------------


def test_csv_is_the_layout_of_the_contract(tmp_path):
    write_run(a_run(), tmp_path / "run.csv")
    header, first, *_ = (tmp_path / "run.csv").read_text().splitlines()
    assert header == (
        "frequency_Hz,node2_re,node2_im,node2_h3_re,node2_h3_im,node2_std,"
        "node5_z_re,node5_z_im,node5_z_h3_re,node5_z_h3_im,node5_z_std"
    )
    assert first.startswith("95.000123456789,1.0,2.0,")


def test_csv_columns_may_stand_in_any_order(tmp_path):
    run = read_text(
        tmp_path, "node3_std,node3_im,frequency_Hz,node1_z_re,node1_z_im,node3_re,node1_z_std\n.1,2,95,3,4,1,.2\n"
    )
    assert run.channels == (Channel(3), Channel(1, "z"))
    np.testing.assert_array_equal(run.H, [[1 + 2j, 3 + 4j]])
    assert run.std is not None
    np.testing.assert_array_equal(run.std, [[0.1, 0.2]])


def test_csv_of_a_spreadsheet_is_read(tmp_path):
    """Byte-order mark, CRLF, quotes, blanks round cells and blank lines."""
    (tmp_path / "run.csv").write_bytes(
        b'\xef\xbb\xbf\r\nfrequency_Hz, "node2_abs"\r\n 95 ,"1.5"\r\n\r\n96,2\r\n,\r\n'.replace(b', "', b',"')
    )
    run = read_run(tmp_path / "run.csv", support="rigid")
    assert run.magnitude_only
    np.testing.assert_array_equal(run.H, [[1.5], [2.0]])


@pytest.mark.parametrize(
    "text",
    [
        "sep=,\nfrequency_Hz,node2_re,node2_im\n95,1.5,-2\n96,2,0.25\n",
        "SEP=;\r\nfrequency_Hz;node2_re;node2_im\r\n95;1,5;-2\r\n96;2;0,25\r\n",
        "frequency_Hz,node2_re,node2_im,\n95,1.5,-2,\n96,2,0.25,\n",
        "frequency_Hz,node2_re,node2_im,,\n95,1.5,-2\n96,2,0.25,,,\n",
        "\nfrequency_Hz;node2_re;node2_im\n95;1,5;-2\n96;2;0,25\n;;\n",
        '"frequency_Hz";"node2_re";"node2_im"\n"95,0";"1,5";"-2"\n96;2e0;0.25\n',
        "frequency_Hz\tnode2_re\tnode2_im\n95\t1.5\t-2\n96\t2\t0,25\n",
    ],
)
def test_csv_as_spreadsheets_of_any_country_write_it_is_read(tmp_path, text):
    (tmp_path / "run.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    run = read_run(tmp_path / "run.csv", support="rigid")
    np.testing.assert_array_equal(run.frequency_hz, [95, 96])
    np.testing.assert_array_equal(run.H, [[1.5 - 2j], [2 + 0.25j]])


def test_csv_harmonics_of_both_orders_are_read(tmp_path):
    run = read_text(
        tmp_path, "frequency_Hz,node2_re,node2_im,node2_h3_re,node2_h3_im,node2_h2_re,node2_h2_im\n95,1,2,3,4,5,6\n"
    )
    assert {order: values.item() for order, values in run.harmonics.items()} == {2: 5 + 6j, 3: 3 + 4j}


GOOD = "frequency_Hz,node2_re,node2_im\n95,1,2\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "run.csv: the file is empty; it needs a header"),
        ("frequency_Hz,node2_abs\n", "run.csv: nothing below the header"),
        ("95,1,2\n96,1,2\n", "run.csv, line 1: the header is missing; the first line names the columns"),
        ("\n95,1,2\n96,1,2\n", "run.csv, line 2: the header is missing"),
        ("frequency_Hz,node1\u0662_re,node2_im\n", "run.csv, line 1, column 2 'node1\u0662_re': unknown column"),
        (f"frequency_Hz,node{'1' * 5000}_abs\n95,1\n", "run.csv, line 1, column 2 'node1"),
        ("node2_re,node2_im\n1,2\n", "run.csv, line 1: column frequency_Hz is missing"),
        ("frequency_Hz\n95\n", "run.csv, line 1: no response column"),
        (
            "frequency_Hz,a,b;node2_abs\n95,1,5\n",
            "run.csv, line 1: columns must be separated by one sign throughout, a comma",
        ),
        ("sep=;\nfrequency_Hz;node2_abs\n95;1,5\n96;x\n", "run.csv, line 4, column node2_abs: 'x' is not a number"),
        ("frequency_Hz;node2_abs\n95;1.000,5\n", "run.csv, line 2, column node2_abs: '1.000.5' is not a number"),
        ("frequency_Hz,node2_abs,\n95,1,2\n", "run.csv, line 2: 3 cells, but the header names 2 columns"),
        ("frequency_Hz,node2_real\n95,1\n", "run.csv, line 1, column 2 'node2_real': unknown column; known are"),
        ("frequency_Hz,node0_abs\n95,1\n", "run.csv, line 1, column 2 'node0_abs': unknown column"),
        ("frequency_Hz,node2_abs,node2_h3_std\n9,1,1\n", "run.csv, line 1, column 3 'node2_h3_std': unknown column"),
        ("frequency_Hz,node2_h1_re\n95,1\n", "run.csv, line 1, column 2 'node2_h1_re': unknown column"),
        ("frequency_Hz,,node2_abs\n95,,1\n", "run.csv, line 1, column 2 '': unknown column"),
        ("frequency_Hz,node2_abs,node2_abs\n9,1,1\n", "run.csv, line 1, column node2_abs: is there 2 times; keep one"),
        ("frequency_Hz,node2_re\n95,1\n", "run.csv, line 1, column node2_re: column node2_im is missing"),
        ("frequency_Hz,node2_z_im\n95,1\n", "run.csv, line 1, column node2_z_im: column node2_z_re is missing"),
        (
            "frequency_Hz,node2_re,node2_im,node2_h3_re\n95,1,1,1\n",
            "run.csv, line 1, column node2_h3_re: column node2_h3_im is missing",
        ),
        (
            "frequency_Hz,node2_re,node2_im,node2_abs\n95,1,1,1\n",
            "run.csv, line 1, column node2_abs: this node has real and imaginary part too",
        ),
        ("frequency_Hz,node2_std\n95,1\n", "run.csv, line 1, column node2_std: node2 has no response; add node2_re"),
        (
            "frequency_Hz,node2_abs,node3_re,node3_im\n95,1,1,1\n",
            "run.csv, line 1, column node2_abs: other columns are complex (_re, _im); put the nodes",
        ),
        (GOOD + "96,1,two\n", "run.csv, line 3, column node2_im: 'two' is not a number; correct the cell"),
        (GOOD + "\n96,1,\n", "run.csv, line 4, column node2_im: '' is not a number"),
        (GOOD + "96,1_000,1\n", "run.csv, line 3, column node2_re: '1_000' is not a number"),
        (GOOD + "96,nan,1\n", "run.csv, line 3, column node2_re: 'nan' is not a finite number; remove the line"),
        (GOOD + "96,1,1e999\n", "run.csv, line 3, column node2_im: '1e999' is not a finite number"),
        (GOOD + "inf,1,1\n", "run.csv, line 3, column frequency_Hz: 'inf' is not a finite number"),
        (GOOD + "96,1,5,2,5\n", "run.csv, line 3: 5 cells, but the header names 3 columns; fill or remove the line"),
        (GOOD + "96,1,2\n96,1,2\n", "run.csv, line 4, column frequency_Hz: 96.0 Hz does not come after 96.0 Hz"),
        (GOOD + "97,1,2\n94,1,2\n", "run.csv, line 4, column frequency_Hz: 94.0 Hz does not come after 97.0 Hz"),
        (GOOD + "94,1,2\n94,1,2\n", "run.csv, line 3, column frequency_Hz: 94.0 Hz does not come after 95.0 Hz"),
        (GOOD + "94,1,2\n-1,1,2\n", "run.csv, line 3, column frequency_Hz: 94.0 Hz does not come after 95.0 Hz"),
        (
            "frequency_Hz,node2_abs\n0,1\n",
            "run.csv, line 2, column frequency_Hz: 0.0 Hz; frequencies must be positive: remove the line",
        ),
        ("frequency_Hz,node2_abs\n95,-1\n", "run.csv, line 2, column node2_abs: -1.0 is negative; a magnitude is not"),
        (
            "frequency_Hz,node2_abs,node2_std\n95,1,0.1\n96,1,-0.1\n",
            "run.csv, line 3, column node2_std: -0.1 is negative; a standard error is not",
        ),
        (GOOD + '96,"1,2\n', "run.csv, line 3: not CSV (unexpected end of data)"),
    ],
)
def test_a_wrong_csv_is_refused_with_file_line_and_column(tmp_path, text, message):
    assert refusal(tmp_path, text).startswith(message)


def test_standard_errors_and_harmonics_of_some_nodes_alone_are_left_out_with_a_warning(tmp_path, caplog):
    names = "frequency_Hz,node2_abs,node2_std,node3_abs,node3_h2_abs,node2_h3_abs,node3_h3_abs"
    run = read_text(tmp_path, f"{names}\n95,1,0.1,2,3,4,5\n")
    assert run.H.tolist() == [[1, 2]]
    assert run.std is None
    assert run.harmonics[3].tolist() == [[4, 5]]
    assert list(run.harmonics) == [3]
    assert [message.split("line 1: ")[1] for message in caplog.messages] == [
        "standard errors are missing for node3, and left out for all",
        "harmonics of order 2 are missing for node2, and left out for all",
    ]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_downward_sweep_may_stand_in_its_own_order(tmp_path, suffix):
    run = a_run(sweep="up")
    down = replace(
        run,
        H=run.H[::-1],
        std=run.std[::-1],
        harmonics={order: values[::-1] for order, values in run.harmonics.items()},
        sweep=None,
    )
    object.__setattr__(down, "frequency_hz", run.frequency_hz[::-1])  # which no run of this program has
    write_run(down, tmp_path / f"run{suffix}")
    assert_same_run(read_run(tmp_path / f"run{suffix}", support="bearing"), replace(run, sweep="down"))
    assert read_run(tmp_path / f"run{suffix}", support="bearing", sweep="up").sweep == "up"


def test_a_csv_in_another_encoding_is_refused(tmp_path):
    (tmp_path / "run.csv").write_text(GOOD, encoding="utf-16")
    with pytest.raises(MeasurementError, match="not a text file in UTF-8"):
        read_run(tmp_path / "run.csv", support="rigid")


# --- UFF -----------------------------------------------------------------------------------------


def function_58(**changes):
    """A frequency response as other software writes it: text, evenly spaced, no word about the run."""
    x = 10.0 + 2.0 * np.arange(5)
    dataset = {
        "type": 58, "binary": 0, "func_type": 4, "rsp_node": 3, "rsp_dir": 2, "ref_node": 5, "ref_dir": 2,
        "abscissa_spacing": 1, "abscissa_spec_data_type": 18, "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 13, "x": x, "data": np.exp(1j * x),
    }  # fmt: skip
    return {**dataset, **changes}


def read_uff(tmp_path, *datasets, **told):
    path = tmp_path / "foreign.unv"
    path.unlink(missing_ok=True)
    for dataset in datasets:
        pyuff.UFF(str(path)).write_sets(
            dict(dataset), mode="add", force_double=dataset.get("ord_data_type", 6) in (4, 6)
        )
    return read_run(path, **{"support": "rigid", **told})


def test_uff_says_everything_in_the_standard_records(tmp_path):
    write_run(a_run(excitation_node=4, excitation_plane="z"), tmp_path / "run.uff")
    file = pyuff.UFF(str(tmp_path / "run.uff"))
    assert file.get_set_types().tolist() == [151, 164] + [58] * 6
    units, *functions = file.read_sets(list(range(1, 8)))
    assert (units["units_code"], units["length"], units["force"]) == (1, 1.0, 1.0)
    response = functions[3]
    assert (response["id1"], response["binary"]) == ("RESPONSE node5_z", 1)
    assert (response["func_type"], response["ord_data_type"], response["abscissa_spacing"]) == (4, 6, 0)
    assert (response["rsp_node"], response["rsp_dir"], response["ref_node"], response["ref_dir"]) == (5, 3, 4, 3)
    assert (response["ordinate_spec_data_type"], response["orddenom_spec_data_type"]) == (12, 13)
    assert [f["func_type"] for f in functions] == [4, 0, 0, 4, 0, 0]  # others must not take a std for a response


def test_uff_stores_the_uneven_frequency_axis_unrounded(tmp_path):
    frequency_hz = np.array([299.99964, 300.0, 300.00035])  # the text form would merge these
    write_run(a_run(frequency_hz=frequency_hz), tmp_path / "run.uff")
    np.testing.assert_array_equal(pyuff.UFF(str(tmp_path / "run.uff")).read_sets(2)["x"], frequency_hz)


def test_uff_byte_count_is_what_follows_the_text(tmp_path):
    write_run(a_run(harmonics={}), tmp_path / "run.uff")
    for block in (tmp_path / "run.uff").read_bytes().split(b"    -1\n    58b")[1:]:
        n_bytes = int(block[24:36])
        body = b"".join(block.splitlines(keepends=True)[12:]).removesuffix(b"    -1\n")
        assert n_bytes == len(body)


@pytest.mark.parametrize("ord_data_type", [5, 6])
@pytest.mark.parametrize("spacing", [0, 1])
def test_uff_of_other_software_is_read(tmp_path, ord_data_type, spacing):
    dataset = function_58(ord_data_type=ord_data_type, abscissa_spacing=spacing)
    run = read_uff(tmp_path, dataset)
    assert run.channels == (Channel(3),)
    assert (run.excitation_node, run.excitation_plane, run.quantity) == (5, "y", "accelerance")
    np.testing.assert_array_equal(run.frequency_hz, dataset["x"])
    printed_digits = 0.5e-5 if ord_data_type == 5 else 0.5e-11
    np.testing.assert_allclose(run.H[:, 0], dataset["data"], rtol=0, atol=2 * printed_digits)


def test_uff_binary_of_other_software_gives_its_responses(tmp_path):
    """The same records under another program's name: general functions are then nobody's standard errors."""
    written = a_run()
    write_run(written, tmp_path / "run.uff")
    foreign = (tmp_path / "run.uff").read_bytes().replace(b"rigtwin", b"another")
    (tmp_path / "run.uff").write_bytes(foreign)
    run = read_run(tmp_path / "run.uff", support="rigid")
    np.testing.assert_array_equal(run.H, written.H)
    assert (run.channels, run.std, run.harmonics) == (written.channels, None, {})


def test_uff_magnitudes_are_read_as_magnitudes(tmp_path):
    run = read_uff(tmp_path, function_58(data=np.arange(5.0), abscissa_spacing=0))
    assert run.magnitude_only
    np.testing.assert_array_equal(run.H[:, 0], np.arange(5.0))


def test_uff_sensor_mounted_backwards_changes_the_sign(tmp_path):
    forwards = read_uff(tmp_path, function_58()).H
    np.testing.assert_array_equal(read_uff(tmp_path, function_58(rsp_dir=-2)).H, -forwards)
    np.testing.assert_array_equal(read_uff(tmp_path, function_58(rsp_dir=-2, ref_dir=-3)).H, forwards)
    unsaid = read_uff(tmp_path, function_58(rsp_dir=-2, ref_dir=0), excitation_plane="y").H
    np.testing.assert_array_equal(unsaid, -forwards)


@pytest.mark.parametrize(("numerator", "quantity"), [(8, "receptance"), (11, "mobility"), (12, "accelerance")])
def test_uff_data_types_name_the_quantity(tmp_path, numerator, quantity):
    assert read_uff(tmp_path, function_58(ordinate_spec_data_type=numerator)).quantity == quantity


def test_uff_units_are_turned_into_si(tmp_path):
    """Millimetres and millinewtons: the factors of dataset 164 divide; the code for SI means factors of one."""
    units = {"type": 164, "units_code": 9, "length": 1000.0, "force": 10.0, "temp": 1.0, "temp_offset": 0.0}
    plain = read_uff(tmp_path, function_58()).H
    np.testing.assert_allclose(read_uff(tmp_path, units, function_58()).H, plain / 1000 * 10, rtol=1e-15)
    constant_current = read_uff(tmp_path, units, function_58(), quantity="acceleration").H
    np.testing.assert_allclose(constant_current, plain / 1000, rtol=1e-15)
    np.testing.assert_array_equal(read_uff(tmp_path, {**units, "units_code": 1}, function_58()).H, plain)


def test_uff_line_at_zero_hertz_is_left_out(tmp_path):
    run = read_uff(tmp_path, function_58(x=2.0 * np.arange(5)))
    np.testing.assert_array_equal(run.frequency_hz, [2, 4, 6, 8])
    np.testing.assert_allclose(run.H[:, 0], np.exp(1j * (10 + 2 * np.arange(1, 5))), rtol=0, atol=1e-11)


def test_uff_axial_and_coherence_functions_are_passed_over(tmp_path):
    coherence = function_58(func_type=6, data=np.ones(5))
    run = read_uff(tmp_path, coherence, function_58(rsp_dir=1), function_58(rsp_dir=3))
    assert run.channels == (Channel(3, "z"),)
    axially_driven = function_58(rsp_node=4, ref_dir=1)
    assert read_uff(tmp_path, axially_driven, function_58()).channels == (Channel(3),)


def test_uff_spectra_are_accelerometers_only_where_they_say_so(tmp_path):
    spectrum = {"ref_node": 0, "ref_dir": 0, "orddenom_spec_data_type": 0}
    force = function_58(**spectrum, rsp_node=2, ordinate_spec_data_type=13, rsp_dir=3)
    read_uff(tmp_path, function_58(**spectrum), quantity="acceleration")
    pyuff.UFF(str(tmp_path / "foreign.unv")).write_sets(force, mode="add")
    functions = re.sub(r"^    4(?= )", "   12", (tmp_path / "foreign.unv").read_text(), flags=re.MULTILINE)  # spectra
    (tmp_path / "foreign.unv").write_text(functions)
    run = read_run(tmp_path / "foreign.unv", support="rigid", quantity="acceleration", excitation_node=2)
    assert run.channels == (Channel(3),)


@pytest.mark.parametrize("types", [(0, 0), (12, 0), (0, 13)])
def test_uff_that_leaves_its_data_types_out_is_an_accelerance(tmp_path, types):
    numerator, denominator = types
    data = function_58(ordinate_spec_data_type=numerator, orddenom_spec_data_type=denominator)
    assert read_uff(tmp_path, data).quantity == "accelerance"
    assert read_uff(tmp_path, data, quantity="mobility").quantity == "mobility"


def test_uff_with_two_exciter_places_needs_a_choice(tmp_path):
    both = (function_58(), function_58(ref_node=2, data=np.ones(5) + 0j))
    assert read_uff(tmp_path, *both, excitation_node=2).H[0, 0] == 1
    assert read_uff(tmp_path, *both, excitation_node=5).H[0, 0] != 1
    with pytest.raises(MeasurementError, match="holds responses to forces at node 5 y, node 2 y; choose one"):
        read_uff(tmp_path, *both)


@pytest.mark.parametrize(
    ("datasets", "problem"),
    [
        ([function_58(func_type=1, data=np.ones(5))], r"no frequency response .*the file has type 1 in direction 2"),
        ([function_58(rsp_dir=0)], r"no frequency response .*the file has type 4 in direction 0"),
        (
            [{"type": 151, "model_name": "", "description": "", "db_app": "", "program": ""}],
            "the file has no dataset 58",
        ),
        ([function_58(), function_58()], "RESPONSE is there for node3, node3; it must be there once"),
        (
            [function_58(), function_58(rsp_node=4, x=np.arange(1.0, 6))],
            "node3 and node4 have different frequency lines",
        ),
        ([function_58(), function_58(rsp_node=4, data=np.ones(5))], "node3 and node4: one is complex, the other a mag"),
        (
            [function_58(), function_58(rsp_node=4, ordinate_spec_data_type=8)],
            r"node3 and node4 hold different quantities \(ordinate types \(12, 13\) and \(8, 13\)\)",
        ),
        (
            [function_58(ordinate_spec_data_type=8, orddenom_spec_data_type=0)],
            r"ordinate types \(8, 0\) are none of receptance.*say the run's quantity in campaign\.toml",
        ),
        ([function_58(abscissa_spec_data_type=17)], "the abscissa of node3 has type 17, which is no frequency"),
        ([function_58(ref_dir=1)], "the file has type 4 in direction 2 of a force in direction 1"),
        ([function_58(data=-np.ones(5))], r"H of node3 at 10\.0 Hz is no magnitude"),
    ],
)
def test_a_wrong_uff_is_refused_by_name(tmp_path, datasets, problem):
    with pytest.raises(MeasurementError, match=rf"foreign\.unv: .*{problem}"):
        read_uff(tmp_path, *datasets)


def test_a_uff_cut_off_is_refused(tmp_path):
    write_run(a_run(), tmp_path / "run.uff")
    whole = (tmp_path / "run.uff").read_bytes()
    for kept in (0, len(whole) // 2, len(whole) - 8):
        (tmp_path / "run.uff").write_bytes(whole[:kept])
        with pytest.raises(MeasurementError, match=r"run\.uff: the closing line '    -1' is missing"):
            read_run(tmp_path / "run.uff")


def test_a_uff_function_with_lines_missing_is_refused(tmp_path):
    read_uff(tmp_path, function_58())
    lines = (tmp_path / "foreign.unv").read_text().splitlines(keepends=True)
    (tmp_path / "foreign.unv").write_text("".join([*lines[:-2], lines[-1]]))
    with pytest.raises(MeasurementError, match=r"foreign\.unv: node3 has 4 of 5 values: damaged, export it again"):
        read_run(tmp_path / "foreign.unv", support="rigid")


def test_a_uff_without_one_standard_error_is_refused(tmp_path):
    write_run(a_run(harmonics={}), tmp_path / "run.uff")
    blocks = (tmp_path / "run.uff").read_bytes().split(b"    -1\n    58b")
    (tmp_path / "run.uff").write_bytes(b"    -1\n    58b".join(blocks[:-1]))
    with pytest.raises(MeasurementError, match="STANDARD ERROR is there for node2; it must be there once for every"):
        read_run(tmp_path / "run.uff")


# --- HDF5 and MATLAB -----------------------------------------------------------------------------


def arrays(**changes):
    """The least a file must hold."""
    return {"frequency_Hz": np.array([95.0, 96.0]), "H": np.array([[1 + 1j, 2], [3, 4]]), "node": [2, 3], **changes}


def save_h5(path: Path, variables) -> None:
    with h5py.File(path, "w") as file:
        for name, value in variables.items():
            file[name] = value


def save_mat(path: Path, variables) -> None:
    scipy.io.savemat(path, variables)


def save_mat73(path: Path, variables) -> None:
    """As MATLAB 7.3 does: a 512-byte text block, axes reversed, complex pairs, text as 16-bit numbers."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")
        for name, value in variables.items():
            array = np.atleast_2d(np.array([ord(c) for c in value], np.uint16) if isinstance(value, str) else value).T
            if np.iscomplexobj(array):
                array = np.array(array).view([("real", float), ("imag", float)])
            file[name] = array
            file[name].attrs["MATLAB_class"] = np.bytes_("char" if isinstance(value, str) else "double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(512))


SAVERS = pytest.mark.parametrize(
    ("name", "save"),
    [("run.h5", save_h5), ("run.mat", save_mat), ("run.mat", save_mat73)],
    ids=["h5", "mat5", "mat7.3"],
)


@SAVERS
def test_a_file_made_by_hand_is_read(tmp_path, name, save):
    save(
        tmp_path / name,
        arrays(plane="yz", std=np.full((2, 2), 0.1), h3=np.ones((2, 2)) * 1j, support="bearing", spin_rpm=5.0),
    )
    run = read_run(tmp_path / name)
    assert run.channels == (Channel(2), Channel(3, "z"))
    np.testing.assert_array_equal(run.H, [[1 + 1j, 2], [3, 4]])
    np.testing.assert_array_equal(run.harmonics[3], np.ones((2, 2)) * 1j)
    assert (run.support, run.spin_rpm, run.excitation_node, run.force_amplitude_N) == ("bearing", 5.0, 2, 1.0)


@SAVERS
def test_real_responses_are_magnitudes_and_planes_are_y_unless_said(tmp_path, name, save):
    save(tmp_path / name, arrays(H=np.array([[1.0, 2.0], [3.0, 4.0]])))
    run = read_run(tmp_path / name, support="rigid")
    assert run.magnitude_only
    assert run.channels == (Channel(2), Channel(3))
    np.testing.assert_array_equal(run.H, [[1, 2], [3, 4]])


@SAVERS
def test_one_channel_may_be_a_vector(tmp_path, name, save):
    save(tmp_path / name, arrays(H=np.array([1 + 1j, 2]), node=[2]))
    np.testing.assert_array_equal(read_run(tmp_path / name, support="rigid").H, [[1 + 1j], [2]])


WRONG = [
    ({"Std": np.ones((2, 2))}, "unknown variable 'Std'; save only frequency_Hz, H, node, std, coherence, force_N"),
    (
        {"H": np.ones((3, 2)) * 1j},
        r"variable 'H' has shape \(3, 2\), expected \(2, 2\): a row for each of frequency_Hz",
    ),
    ({"std": np.ones((2, 3))}, r"variable 'std' has shape \(2, 3\), expected \(2, 2\)"),
    ({"std": np.ones((2, 2)) * 1j}, "variable 'std' is complex; it must be real"),
    ({"std": -np.ones((2, 2))}, r"std of node2 at 95\.0 Hz is negative"),
    ({"H": np.array([[1, 2], [3, np.nan]]) + 0j}, r"H of node3 at 96\.0 Hz is not a finite number"),
    ({"H": -np.ones((2, 2))}, r"H of node2 at 95\.0 Hz is no magnitude; give numbers that are not negative"),
    ({"H": "none"}, "variable 'H' holds no numbers"),
    ({"node": [2.5, 3]}, "variable 'node' must hold each channel's node, whole numbers from 1"),
    ({"node": [np.inf, 3]}, "variable 'node' must hold each channel's node, whole numbers from 1"),
    ({"node": [3, 3]}, r"channels are \[node3, node3\]"),
    ({"plane": "y"}, "variable 'plane' is 'y'; it must be a text of 2 letters"),
    ({"frequency_Hz": np.array([95.0, 95.0])}, r"frequency 2 of 2 is .*95\.0.* Hz; frequencies must be positive"),
    ({"support": "loose"}, "support: Input should be 'rigid' or 'bearing'"),
]


@SAVERS
@pytest.mark.parametrize(("changes", "problem"), every_second_is_long(WRONG))
def test_a_wrong_variable_is_refused_by_name(tmp_path, name, save, changes, problem):
    save(tmp_path / name, arrays(**changes))
    with pytest.raises(MeasurementError, match=rf"{name}: {problem}"):
        read_run(tmp_path / name, support="rigid")


@SAVERS
def test_a_missing_variable_is_named(tmp_path, name, save):
    save(tmp_path / name, {key: value for key, value in arrays().items() if key != "node"})
    with pytest.raises(MeasurementError, match=rf"{name}: variable 'node' is missing"):
        read_run(tmp_path / name, support="rigid")


def test_hdf5_attributes_of_other_names_are_passed_over(tmp_path):
    save_h5(tmp_path / "run.h5", arrays())
    with h5py.File(tmp_path / "run.h5", "a") as file:
        file.attrs.update({"operator": "N. N.", "support": "bearing", "plane": ["z", "y"]})
    run = read_run(tmp_path / "run.h5")
    assert run.channels == (Channel(2, "z"), Channel(3))


def test_hdf5_groups_are_refused(tmp_path):
    save_h5(tmp_path / "run.h5", arrays())
    with h5py.File(tmp_path / "run.h5", "a") as file:
        file.create_group("results")
    with pytest.raises(MeasurementError, match=r"run\.h5: 'results' is a group; put a run's arrays at the root"):
        read_run(tmp_path / "run.h5", support="rigid")


@pytest.mark.parametrize("as_attribute", [True, False], ids=["attribute", "dataset"])
def test_hdf5_texts_in_another_encoding_are_refused_by_name(tmp_path, as_attribute):
    save_h5(tmp_path / "run.h5", arrays())
    with h5py.File(tmp_path / "run.h5", "a") as file:
        texts = file.attrs if as_attribute else file
        texts["support"] = np.bytes_("gelagert, h\u00e4ngend".encode("latin-1"))
    with pytest.raises(MeasurementError, match=r"run\.h5.*support"):
        read_run(tmp_path / "run.h5")
