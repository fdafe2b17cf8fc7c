"""MATLAB: version 5 to 7 through scipy, version 7.3 (HDF5 inside) through h5py (layout in ``variables``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from rigtwin.sim.campaign import MeasurementError, Run
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.settings import RunSettings
from rigtwin.sim.formats.variables import arrays_of, recording_of, texts_of


def read(path: Path, given: RunSettings) -> Recording:
    """Read a MATLAB run of any version from 4."""
    try:
        variables = _read_v73(path) if h5py.is_hdf5(path) else scipy.io.loadmat(path, appendmat=False)
    except Exception as error:  # scipy and h5py raise many kinds on a damaged file
        raise MeasurementError(f"{path}: cannot be read as a MATLAB file ({error}); save it again") from error
    # Names such as __header__ and #refs# are the format's own.
    return recording_of(path, {name: value for name, value in variables.items() if name[0] not in "_#"})


def _read_v73(path: Path) -> dict[str, Any]:
    with h5py.File(path, "r") as file:
        return {name: _matlab_array(item) for name, item in file.items()}


def _matlab_array(item: Any) -> Any:
    """A MATLAB 7.3 array as MATLAB shows it: axes in HDF5 are reversed, text is numbers, complex a pair."""
    if not isinstance(item, h5py.Dataset):
        return np.array(None)  # a struct, refused by name unless it is the format's own
    array = np.asarray(item[()]).T
    if item.attrs.get("MATLAB_class") == b"char":
        return np.array("".join(map(chr, array.ravel())))
    if array.dtype.names == ("real", "imag"):
        values = np.empty(array.shape, dtype=complex)
        values.real, values.imag = array["real"], array["imag"]
        return values
    return array


def write(run: Run, path: Path) -> None:
    """Write a MATLAB 5 file."""
    with path.open("wb") as file:
        scipy.io.savemat(file, {**arrays_of(run), **texts_of(run)}, oned_as="column")
