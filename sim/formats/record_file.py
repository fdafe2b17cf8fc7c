"""One record from a file; the suffix says which format."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import MeasurementError
from rigtwin.sim.formats import record_csv
from rigtwin.sim.formats.in_child import decode
from rigtwin.sim.formats.record import Record, record_of

# Variables of a MATLAB or HDF5 file that tell the time, in small letters without strokes.
_RATES = ("fs", "samplerate", "samplingrate", "sampleratehz", "samplingfrequency", "fsample")
_STEPS = ("dt", "tinterval", "sampleinterval", "samplinginterval", "timestep")
_TIMES = ("t", "time", "times", "timestamps")

# A file that holds one channel of a record is called after it. Sampling rates are one within this share.
_OF_CHANNEL, _SAME_RATE = re.compile(r"((?:.*[\d _-])?)(ch\d+)", re.IGNORECASE), 1e-4


def read_record(*paths: str | Path, sample_rate_hz: float | None = None) -> Record:
    """Read one record.

    Parameters
    ----------
    paths : a .csv, .txt, .wav, .mat, .h5 or .tdms file; or one for each channel, as ``record_files`` groups them
    sample_rate_hz : wins over what the files say

    Raises
    ------
    MeasurementError : a file cannot be used; names it, what is wrong and what to do
    """
    records = [_read_file(Path(path), sample_rate_hz) for path in paths]
    return records[0] if len(records) == 1 else _side_by_side([Path(path) for path in paths], records)


def _side_by_side(paths: list[Path], records: list[Record]) -> Record:
    """One record of files that hold a channel each. Raises MeasurementError."""
    first = records[0]
    for path, record in zip(paths, records, strict=True):
        if len(record.names) > 1:
            told = f"{len(record.names)} channels ({', '.join(record.names)})"
            raise MeasurementError(f"{path}: is called after one channel and holds {told}; rename it, or move it out")
        if (
            len(record.samples) != len(first.samples)
            or abs(record.sample_rate_hz / first.sample_rate_hz - 1) > _SAME_RATE
        ):
            raise MeasurementError(
                f"{path}: {len(record.samples)} samples at {record.sample_rate_hz:g} Hz, {paths[0].name} has "
                f"{len(first.samples)} at {first.sample_rate_hz:g} Hz; channels of one record are taken at once"
            )
    named = [_OF_CHANNEL.fullmatch(path.stem) for path in paths]
    names = tuple(match[2].upper() if match else path.stem for match, path in zip(named, paths, strict=True))
    name = f"{named[0][1].rstrip(' _-')}{paths[0].suffix}" if named[0] else first.name
    samples, units = np.hstack([record.samples for record in records]), tuple(record.units[0] for record in records)
    return Record(name, first.sample_rate_hz, samples, names, units)


def _read_file(path: Path, sample_rate_hz: float | None) -> Record:
    if not path.is_file():
        raise MeasurementError(f"{path}: no such file or folder; check its name")
    if path.suffix.lower() not in _READERS:
        raise MeasurementError(f"{path}: unknown kind of file; a record is one of {', '.join(RECORD_SUFFIXES)}")
    try:
        return _READERS[path.suffix.lower()](path, sample_rate_hz)
    except OSError as error:
        raise MeasurementError(f"{path}: cannot be read ({error.strerror or error})") from error


def record_files(paths: list[Path]) -> list[tuple[Path, ...]]:
    """The files of each record: those named and those in the folders, sorted by name.

    Files of one folder whose names differ in the channel alone, as F0001CH1.CSV and F0001CH2.CSV, are one record.
    Raises MeasurementError where a folder holds none.
    """
    groups: dict[tuple[Path, str], list[Path]] = {}
    for path in _files(paths):
        match = _OF_CHANNEL.fullmatch(path.stem)
        groups.setdefault((path.parent, match[1] + path.suffix if match else path.name), []).append(path)
    return [tuple(group) for group in groups.values()]


def _files(paths: list[Path]) -> list[Path]:
    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = _records_in(path.iterdir()) or _records_in(path.glob("*/*"))
            found += inside
            if not inside:
                kinds = ", ".join(RECORD_SUFFIXES)
                raise MeasurementError(f"{path}: holds no record; a record is a file of the kinds {kinds}")
        else:
            found.append(path)
    return found


def _records_in(paths: Iterable[Path]) -> list[Path]:
    kept = (path for path in paths if path.suffix.lower() in _READERS and not path.name.startswith("."))
    return sorted(path for path in kept if path.is_file())


def _wave(path: Path, sample_rate_hz: float | None) -> Record:
    """Counts of a WAV file; of one with 24 bits they stand in the upper bits of 32, as scipy reads them."""
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks that hold no samples
            rate, samples = wavfile.read(path)
    except OSError:
        raise
    except Exception as error:  # scipy raises many kinds on a damaged file
        raise MeasurementError(f"{path}: cannot be read as WAV ({error}); save it again") from error
    if rate <= 0 and sample_rate_hz is None:
        raise MeasurementError(f"{path}: its sampling rate is {rate}; give it with --sample-rate")
    columns = np.atleast_2d(samples.T).T
    channels = {str(k + 1): columns[:, k] for k in range(columns.shape[1])}
    return record_of(path, channels, ["counts"] * len(channels), time_s=None, sample_rate_hz=sample_rate_hz or rate)


def _hdf5(path: Path, sample_rate_hz: float | None) -> Record:
    datasets, attributes = decode(path, "hdf5")
    return _of_variables(path, attributes | datasets, sample_rate_hz)


def _matlab(path: Path, sample_rate_hz: float | None) -> Record:
    variables, _ = decode(path, "matlab")
    return _of_variables(path, {k: v for k, v in variables.items() if not k.startswith(("_", "#"))}, sample_rate_hz)


def _of_variables(path: Path, variables: Mapping[str, Any], sample_rate_hz: float | None) -> Record:
    """Vectors are channels or the time, a matrix has a channel in each column, and a number may be the rate."""
    time_s, channels = None, {}
    for name, value in variables.items():
        values, plain = np.asarray(value) if value is not None else np.zeros(0, dtype=str), _plain(name)
        if values.dtype.kind not in "biuf":
            continue
        if values.size == 1 and plain in (*_RATES, *_STEPS):
            number = float(values.ravel()[0])
            if not (np.isfinite(number) and number > 0):
                raise MeasurementError(f"{path}: {name} is {number:g}; give the sampling rate with --sample-rate")
            if sample_rate_hz is None:
                sample_rate_hz = number if plain in _RATES else 1 / number
        elif plain in _TIMES and values.size > 1:
            time_s = values.astype(float).ravel()
        elif values.size > 1 and values.ndim <= 2:
            channels |= _columns(name, values)
    if time_s is not None and channels and len(time_s) != len(next(iter(channels.values()))):
        lengths = ", ".join(f"{name} {len(values)}" for name, values in channels.items())
        raise MeasurementError(f"{path}: {len(time_s)} times, but channels of other lengths ({lengths} samples)")
    return record_of(path, channels, [""] * len(channels), time_s=time_s, sample_rate_hz=sample_rate_hz)


def _columns(name: str, values: np.ndarray) -> dict[str, FloatArray]:
    """Channels of an array: one of a vector; of a matrix ``name[1]`` and so on, along its shorter side."""
    if values.ndim < 2 or min(values.shape) == 1:
        return {name: values.ravel().astype(float)}
    table = values if values.shape[0] >= values.shape[1] else values.T
    return {f"{name}[{k + 1}]": table[:, k].astype(float) for k in range(table.shape[1])}


def _plain(name: str) -> str:
    return re.sub(r"[_\W]", "", name.lower())


def _tdms(path: Path, sample_rate_hz: float | None) -> Record:
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise MeasurementError(f"{path}: reading .tdms needs the package nptdms: pip install 'rigtwin[tdms]'") from None
    try:
        groups = TdmsFile.read(path).groups()
    except OSError:
        raise
    except Exception as error:  # nptdms raises many kinds on a damaged file
        raise MeasurementError(f"{path}: cannot be read as TDMS ({error}); save it again") from error
    found = [channel for group in groups for channel in group.channels() if len(channel) > 1]
    several = len({channel.group_name for channel in found}) > 1
    channels, units = {}, []
    for channel in found:
        name = f"{channel.group_name}/{channel.name}" if several else channel.name
        if np.asarray(channel[:]).dtype.kind in "biuf":
            channels[name] = np.asarray(channel[:], dtype=float)
            units.append(str(channel.properties.get("unit_string", "")))
    steps = {float(channel.properties["wf_increment"]) for channel in found if "wf_increment" in channel.properties}
    if len(steps) > 1 and sample_rate_hz is None:
        raise MeasurementError(f"{path}: channels of different sampling rates; save those of one rate in a file each")
    if steps and sample_rate_hz is None and (step := steps.pop()) > 0:
        sample_rate_hz = 1 / step
    return record_of(path, channels, units, time_s=None, sample_rate_hz=sample_rate_hz)


_READERS: dict[str, Callable[[Path, float | None], Record]] = {
    ".csv": record_csv.read,
    ".txt": record_csv.read,
    ".wav": _wave,
    ".mat": _matlab,
    ".h5": _hdf5,
    ".tdms": _tdms,
}

RECORD_SUFFIXES = tuple(_READERS)
