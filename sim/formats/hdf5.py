"""HDF5: arrays as datasets, settings and planes as attributes of the root (layout in ``variables``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from rigtwin.sim.campaign import MeasurementError, Run
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.settings import RunSettings
from rigtwin.sim.formats.variables import UNITS, arrays_of, known, recording_of, texts_of

SCHEMA = "rigtwin.run/1"


def read(path: Path, given: RunSettings) -> Recording:
    """Read an HDF5 run. Datasets must be known by name; attributes of other names (provenance) are passed over."""
    try:
        with h5py.File(path, "r") as file:
            variables: dict[str, Any] = {name: value for name, value in file.attrs.items() if known(name)}
            variables |= {name: _contents(path, name, item) for name, item in file.items()}
    except OSError as error:
        raise MeasurementError(f"{path}: cannot be read as HDF5 ({error}); write the file again") from error
    return recording_of(path, variables)


def _contents(path: Path, name: str, item: Any) -> Any:
    if not isinstance(item, h5py.Dataset):
        raise MeasurementError(f"{path}: {name!r} is a group; put a run's arrays at the root of the file")
    return item.asstr(errors="replace")[()] if h5py.check_string_dtype(item.dtype) else item[()]


def write(run: Run, path: Path) -> None:
    """Write an HDF5 run."""
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = SCHEMA
        file.attrs.update(texts_of(run))
        for name, values in arrays_of(run).items():
            file.create_dataset(name, data=values)
        file["frequency_Hz"].attrs["unit"] = "Hz"
        file["H"].attrs["unit"] = UNITS[run.quantity]
