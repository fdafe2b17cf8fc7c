"""Records as instruments write them, and one sentence for each that cannot be used."""

from __future__ import annotations

import subprocess
import sys

import h5py
import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose

from rigtwin.sim.campaign import MeasurementError
from rigtwin.sim.formats.record_file import read_record, record_files
from rigtwin.sim.formats.units import kind_of, sensitivity

STEP = 1e-3
TIME = STEP * np.arange(40)
VOLTS = np.column_stack([np.round(np.cos(60 * TIME), 3), np.round(2 * np.sin(60 * TIME), 3)])


def rows(separator: str = ",", point: str = ".", scale: float = 1.0, end: str = "") -> str:
    """Time and two channels, a line each."""
    lines = [separator.join(f"{x:.6g}" for x in (scale * t, *v)) + end for t, v in zip(TIME, VOLTS, strict=True)]
    return "\n".join(lines).replace(".", point) + "\n"


FILES = {
    "a plain header": "time,CH1,CH2\n" + rows(),
    "a preamble of settings": "Model,MDO3024\nSample Interval,1e-3\nVertical Units,V,V\n\nTIME,CH1,CH2\n" + rows(),
    "names above units": "x-axis,CH1,CH2\nsecond,Volt,Volt\n" + rows(),
    "sep= and decimal commas": "sep=;\nZeit (s);CH1 (V);CH2 (V)\n" + rows(";", ","),
    "tabs, milliseconds and an empty line": "Time\tCH1\tCH2\n(ms)\t(V)\t(V)\n\n" + rows("\t", ",", 1e3),
    "units in names": "in s,CH1 in V,CH2 in V\n" + rows(),
    "quotes and a trailing comma": '"Time","CH1","CH2",\n' + rows(end=","),
}


@pytest.mark.parametrize("text", FILES.values(), ids=FILES.keys())
def test_text_of_instruments_is_read(tmp_path, text):
    (tmp_path / "record.csv").write_text(text, encoding="utf-8")
    record = read_record(tmp_path / "record.csv")
    assert record.names == ("CH1", "CH2")
    assert_allclose(record.sample_rate_hz, 1 / STEP, rtol=1e-9)
    assert_allclose(record.samples, VOLTS, atol=1e-12)


def test_an_increment_in_the_header_times_a_counter(tmp_path):
    lines = "\n".join(f"{k},{a},{b},," for k, (a, b) in enumerate(VOLTS.tolist()))
    (tmp_path / "r.csv").write_text("X,CH1,CH2,Start,Increment,\nSequence,Volt,mV,-0.02,1e-3\n" + lines)
    record = read_record(tmp_path / "r.csv")
    assert (record.names, record.units) == (("CH1", "CH2"), ("Volt", "mV"))
    assert_allclose(record.sample_rate_hz, 1 / STEP)
    assert_allclose(record.samples, VOLTS)


def test_settings_beside_the_samples_leave_columns_by_number(tmp_path):
    beside = ["Record Length,40,Points", "Sample Interval,1e-3,s", *[",,"] * 38]
    lines = [f"{words},{row}" for words, row in zip(beside, rows().splitlines(), strict=True)]
    (tmp_path / "r.csv").write_text("\n".join(lines))
    record = read_record(tmp_path / "r.csv")
    assert record.names == ("5", "6")
    assert_allclose(record.sample_rate_hz, 1 / STEP)
    assert_allclose(record.samples, VOLTS)


def test_text_without_a_time_needs_a_rate(tmp_path):
    np.savetxt(tmp_path / "r.txt", VOLTS)
    with pytest.raises(
        MeasurementError, match=r"r\.txt: says neither times nor a sampling rate; give it with --sample"
    ):
        read_record(tmp_path / "r.txt")
    assert_allclose(read_record(tmp_path / "r.txt", sample_rate_hz=500.0).samples, VOLTS)


def test_a_rate_that_is_told_wins_over_the_times(tmp_path):
    (tmp_path / "r.csv").write_text(FILES["a plain header"])
    assert read_record(tmp_path / "r.csv", sample_rate_hz=123.0).sample_rate_hz == 123.0


def test_wav_matlab_and_hdf5_hold_the_same(tmp_path):
    counts = np.round(1000 * VOLTS).astype(np.int16)
    scipy.io.wavfile.write(tmp_path / "r.wav", 1000, counts)
    scipy.io.savemat(tmp_path / "r.mat", {"A": counts[:, 0], "B": counts[:, 1], "Tinterval": STEP, "Length": 40})
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["data"], file.attrs["sample_rate_Hz"] = counts, 1000.0
    found = {suffix: read_record(tmp_path / f"r.{suffix}") for suffix in ("wav", "mat", "h5")}
    assert {suffix: record.names for suffix, record in found.items()} == {
        "wav": ("1", "2"), "mat": ("A", "B"), "h5": ("data[1]", "data[2]")
    }  # fmt: skip
    for record in found.values():
        assert_allclose(record.sample_rate_hz, 1000.0)
        assert_allclose(record.samples, counts)


def test_tdms_is_read_with_its_units(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "r.tdms") as file:
        properties = {"wf_increment": STEP, "unit_string": "mV"}
        file.write_segment([nptdms.ChannelObject("run", f"ai{k}", VOLTS[:, k], properties) for k in range(2)])
    record = read_record(tmp_path / "r.tdms")
    assert (record.names, record.units) == (("ai0", "ai1"), ("mV", "mV"))
    assert_allclose(record.sample_rate_hz, 1 / STEP)
    assert_allclose(record.samples, VOLTS)


def test_without_its_reader_tdms_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "nptdms", None)
    (tmp_path / "r.tdms").write_bytes(b"TDSm")
    with pytest.raises(MeasurementError, match=r"pip install 'rigtwin\[tdms\]'"):
        read_record(tmp_path / "r.tdms")


# -- faults ------------------------------------------------------------------------------------------------


def changed(line: int, new: str | None) -> str:
    """The plain file with another line, counted from 1, or without it."""
    lines = FILES["a plain header"].splitlines()
    lines[line - 1 : line] = [] if new is None else [new]
    return "\n".join(lines) + "\n"


FAULTS = {
    "empty": ("", "the file is empty"),
    "only blank lines": ("\n\n \n", "the file is empty"),
    "no numbers": ("time,CH1\nnone,at all\n", "line 2: holds no number"),
    "too short": ("time,CH1\n0,1\n1,2\n", "2 samples; a record has 16 or more"),
    "not a number": (changed(9, "0.007,nan,1"), "sample 8 of CH1 is nan, not a number"),
    "out of range": (changed(9, "0.007,9.9e37,1"), "sample 8 of CH1 is 9.9e\\+37, out of the instrument's range"),
    "a word": (changed(9, "0.007,****,1"), "line 9, column 2: '\\*\\*\\*\\*' is not a number"),
    "different lengths": (
        changed(41, "0.039,0.5,"),
        r"column 3 39\) samples|different lengths \(.*column 3 39 samples\)",
    ),
    "a sample is missing": (changed(20, None), "not evenly spaced: from sample 18 to 19 they step by 0.002 s"),
    "times that stand still": (changed(2, "0.039,1,0"), "the times do not increase"),
    "two columns of one name": ("time,CH1,CH1\n" + rows(), "two columns have the same name"),
}


@pytest.mark.parametrize(("text", "words"), FAULTS.values(), ids=FAULTS.keys())
def test_a_record_that_cannot_be_used_is_told_in_a_sentence(tmp_path, text, words):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(MeasurementError, match=rf"r\.csv.*{words}") as error:
        read_record(tmp_path / "r.csv")
    assert "\n" not in str(error.value)


def test_arrays_of_different_lengths_are_refused(tmp_path):
    scipy.io.savemat(tmp_path / "r.mat", {"A": VOLTS[:, 0], "B": VOLTS[:30, 1], "dt": STEP})
    with pytest.raises(MeasurementError, match=r"channels of different lengths \(A 40, B 30 samples\)"):
        read_record(tmp_path / "r.mat")


def test_channels_that_are_called_by_numbers_are_those_of_the_header(tmp_path):
    """As some oscilloscopes write them, with the channels that were on."""
    rows = [f"{1e-3 * k},{10 + k % 3},{30 + k}" for k in range(20)]
    (tmp_path / "r.csv").write_text("\n".join(["x-axis,1,3", "second,Volt,Volt", *rows]))
    record = read_record(tmp_path / "r.csv")
    assert (record.names, record.units) == (("1", "3"), ("Volt", "Volt"))
    assert record.samples[:, record.names.index("3")].tolist() == list(range(30, 50))


def test_an_empty_wav_is_told(tmp_path):
    scipy.io.wavfile.write(tmp_path / "r.wav", 1000, np.zeros((0, 2), dtype=np.int16))
    with pytest.raises(MeasurementError, match=r"r\.wav: 0 samples"):
        read_record(tmp_path / "r.wav")


def test_a_damaged_wav_is_told(tmp_path):
    (tmp_path / "r.wav").write_bytes(b"RIFF\x10\x00\x00\x00WAVEjunk")
    with pytest.raises(MeasurementError, match=r"r\.wav: cannot be read as WAV"):
        read_record(tmp_path / "r.wav")


def test_rounded_times_are_taken_for_even(tmp_path):
    """Times of four digits that step by 1.02e-3: off by a twentieth of a step."""
    step = 1.02e-3
    lines = [f"{k * step:.4f},{a},{b}" for k, (a, b) in enumerate(VOLTS.tolist())]
    (tmp_path / "r.csv").write_text("time,CH1,CH2\n" + "\n".join(lines))
    assert_allclose(read_record(tmp_path / "r.csv").sample_rate_hz, 1 / step, rtol=2e-3)


def test_a_folder_gives_its_records_in_order_and_an_empty_one_is_told(tmp_path):
    for name in ("b.csv", "a.wav", "notes.md", ".hidden.csv"):
        (tmp_path / name).write_text("")
    assert [path.name for (path,) in record_files([tmp_path])] == ["a.wav", "b.csv"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(MeasurementError, match="empty: holds no record"):
        record_files([tmp_path / "empty"])


@pytest.mark.parametrize(
    ("text", "value"),
    [("22.4 mV/N", 22.4e-3), ("100mV/g", 0.1 / 9.80665), ("-10,2 mV/(m/s²)", -10.2e-3), ("1200 counts/kN", 1.2)],
)
def test_sensitivities_are_read_as_they_are_written(text, value):
    assert_allclose(sensitivity(text).value, value)


@pytest.mark.parametrize("text", ["22.4 mV", "mV/N", "0 mV/N", "3 N/mV", "3 V/V", "22.4 mV/furlong"])
def test_what_is_no_sensitivity_is_refused(text):
    with pytest.raises(ValueError, match="is no sensitivity"):
        sensitivity(text)


def test_units_tell_what_they_measure():
    assert [kind_of(unit) for unit in ("ips", "mil", "lbf", "furlong")][3] is None
    assert [(kind_of(unit) or ("",))[0] for unit in ("ips", "mil", "lbf")] == ["velocity", "displacement", "force"]


def test_the_reader_of_tdms_is_not_loaded_before_it_is_needed():
    script = "import sys, rigtwin.sim.formats.record_file; print('nptdms' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def tektronix(volts, unit="V") -> str:
    """One channel as a small oscilloscope writes it: settings in the first columns, samples in the last ones."""
    head = ["Record Length,2.5e+03", f"Sample Interval,{1e-3}", f"Vertical Units,{unit}", "Source,CH1"]
    rows = [f"{head[k] if k < len(head) else ','},,{1e-3 * k:.12f},{v:.6f}," for k, v in enumerate(volts)]
    return "\n".join(rows)


def test_files_of_one_channel_each_are_one_record(tmp_path):
    volts = np.column_stack([np.sin(0.3 * np.arange(50)), np.cos(0.3 * np.arange(50))])
    for record in ("ALL0000", "ALL0001"):
        (tmp_path / record).mkdir()
        for k, channel in enumerate(volts.T, start=1):
            (tmp_path / record / f"F{record[-4:]}CH{k}.CSV").write_text(tektronix(channel))
        (tmp_path / record / "TDS.SET").write_text("settings")
    files = record_files([tmp_path])
    assert [[path.name for path in each] for each in files] == [
        ["F0000CH1.CSV", "F0000CH2.CSV"], ["F0001CH1.CSV", "F0001CH2.CSV"]
    ]  # fmt: skip
    record = read_record(*files[1])
    assert (record.name, record.names, record.sample_rate_hz) == ("F0001.CSV", ("CH1", "CH2"), pytest.approx(1000))
    assert_allclose(record.samples, volts, atol=1e-6)


def test_names_that_only_sound_like_a_channel_stay_records_of_their_own(tmp_path):
    for name in ("hitch1.csv", "hitch2.csv"):
        (tmp_path / name).touch()
    assert [len(each) for each in record_files([tmp_path])] == [1, 1]


def test_channels_that_were_not_taken_at_once_are_refused(tmp_path):
    for k, n in ((1, 50), (2, 40)):
        (tmp_path / f"F1CH{k}.CSV").write_text(tektronix(np.sin(0.3 * np.arange(n))))
    with pytest.raises(MeasurementError, match=r"F1CH2\.CSV: 40 samples .* F1CH1\.CSV has 50"):
        read_record(*record_files([tmp_path])[0])
    (tmp_path / "F1CH2.CSV").write_text("time,CH1,CH2\n" + "\n".join(f"{k}e-3,{k},{-k}" for k in range(50)))
    with pytest.raises(MeasurementError, match="is called after one channel and holds 2 channels"):
        read_record(*record_files([tmp_path])[0])
