"""One run from a file, one run into a file; the suffix says which format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np

from rigtwin.scratch import replacing
from rigtwin.sim.campaign import MeasurementError, Run, SupportKind
from rigtwin.sim.formats import csv_file, hdf5, matlab, uff
from rigtwin.sim.formats.corrections import corrected
from rigtwin.sim.formats.recording import Recording, check_frequencies, check_run, falls
from rigtwin.sim.formats.settings import READING, RunSettings, check_settings, settle, stored_settings


class _Format(NamedTuple):
    read: Callable[[Path, RunSettings], Recording]
    write: Callable[[Run, Path], None]


_FORMATS = {
    ".csv": _Format(csv_file.read, csv_file.write),
    ".uff": _Format(uff.read, uff.write),
    ".unv": _Format(uff.read, uff.write),
    ".h5": _Format(hdf5.read, hdf5.write),
    ".mat": _Format(matlab.read, matlab.write),
}

SUFFIXES = tuple(_FORMATS)


def read_run(path: str | Path, usual_node: int = Run.excitation_node, **settings: Unpack[RunSettings]) -> Run:
    """Read one run.

    Parameters
    ----------
    path : a .csv, .uff, .unv, .h5 or .mat file
    usual_node : the exciter's, where neither the file nor the settings say it
    settings : support, excitation_node, excitation_plane, force_amplitude_N [N], spin_rpm [rev/min],
        quantity, sweep and others; see RunSettings. What is given here wins over what the file says; what
        neither says takes its default. CSV files say nothing: there ``support`` must be given.

    Returns
    -------
    Run whose name is the file's name without its suffix

    Raises
    ------
    MeasurementError : the file or a setting cannot be used; names the file and the line, column or key
    """
    path = Path(path)
    given = check_settings(settings, path)
    return _as_run(path, _recording(path, given), given, usual_node)


def _recording(path: Path, given: RunSettings) -> Recording:
    """What a file holds. Raises MeasurementError."""
    if path.is_dir():
        raise MeasurementError(f"{path}: a folder; give one file of a run (rigtwin report and diagnose take campaigns)")
    reader = _format_of(path).read
    if "channels" in given and reader not in (csv_file.read, uff.read):
        raise MeasurementError(f"{path}: channels: is for CSV and universal files; rename the variables in the file")
    if not path.is_file():
        raise MeasurementError(f"{path}: no such file; check its name and folder")
    try:
        return reader(path, given)
    except OSError as error:
        raise MeasurementError(f"{path}: cannot be read ({error.strerror or error})") from error


def read_run_and_said(
    path: str | Path, usual_node: int, usual_support: SupportKind, **settings: Unpack[RunSettings]
) -> tuple[Run, RunSettings]:
    """As ``read_run``, of a support that need not be known; and what file and settings say of the run."""
    path = Path(path)
    given = check_settings(settings, path)
    recording = _recording(path, given)
    said: RunSettings = {**recording.settings, **given}
    support: RunSettings = {} if "support" in said else {"support": usual_support}
    return _as_run(path, recording, {**given, **support}, usual_node), said


def _as_run(path: Path, recording: Recording, given: RunSettings, usual_node: int) -> Run:
    """Check a recording and add the settings. Raises MeasurementError that names the file."""
    if falls(recording.frequency_hz if recording.swept_hz is None else recording.swept_hz):
        recording = recording.upwards()
    settings = settle(path, given, recording.settings, usual_node)
    check_frequencies(path, recording.frequency_hz)
    recording = corrected(path, recording, settings)
    if recording.force_N is not None and "force_amplitude_N" not in {**recording.settings, **given}:
        settings["force_amplitude_N"] = float(np.median(recording.force_N))
    run = Run(
        frequency_hz=recording.frequency_hz,
        H=recording.H,
        channels=recording.channels,
        std=recording.std,
        harmonics=recording.harmonics,
        magnitude_only=recording.magnitude_only,
        name=path.stem,
        swept_hz=recording.swept_hz,
        force_N=recording.force_N,
        **{key: value for key, value in settings.items() if key not in READING},
    )
    check_run(run, path)
    return run


def write_run(run: Run, path: str | Path) -> None:
    """Write one run; an existing file is replaced only when the new one is complete.

    Raises
    ------
    MeasurementError : the run holds values that no file may hold, or the suffix is unknown
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise MeasurementError(f"{path}: the folder {path.parent} does not exist; create it first")
    with replacing(path) as beside:
        write_beside(run, path, beside)


def write_beside(run: Run, path: Path, beside: Path) -> None:
    """Write what belongs into ``path`` under the name ``beside``, which the caller renames."""
    writer = _format_of(path).write
    check_run(run, path)
    check_settings(stored_settings(run), path)
    writer(run, beside)


def _format_of(path: Path) -> _Format:
    try:
        return _FORMATS[path.suffix.lower()]
    except KeyError:
        raise MeasurementError(f"{path}: unknown kind of file; a run is one of {', '.join(SUFFIXES)}") from None
