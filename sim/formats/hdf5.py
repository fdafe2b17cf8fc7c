"""HDF5: arrays as datasets, settings and planes as attributes of the root (layout in ``variables``)."""

from __future__ import annotations

from pathlib import Path

import h5py

from rigtwin.sim.campaign import MeasurementError, Run
from rigtwin.sim.formats.in_child import decode
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.settings import RunSettings
from rigtwin.sim.formats.variables import UNITS, arrays_of, known, recording_of, texts_of

SCHEMA = "rigtwin.run/1"


def read(path: Path, given: RunSettings) -> Recording:
    """Read an HDF5 run. Datasets must be known by name; attributes of other names (provenance) are passed over."""
    datasets, attributes = decode(path, "hdf5")
    for name, value in datasets.items():
        if value is None:
            raise MeasurementError(f"{path}: {name!r} is a group; put a run's arrays at the root of the file")
    variables = {name: value for name, value in attributes.items() if known(name)}
    return recording_of(path, variables | datasets)


def write(run: Run, path: Path) -> None:
    """Write an HDF5 run."""
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = SCHEMA
        file.attrs.update(texts_of(run))
        for name, values in arrays_of(run).items():
            file.create_dataset(name, data=values)
        file["frequency_Hz"].attrs["unit"] = "Hz"
        file["H"].attrs["unit"] = UNITS[run.quantity]
