"""MATLAB: version 5 to 7 through scipy, version 7.3 (HDF5 inside) through h5py (layout in ``variables``)."""

from __future__ import annotations

from pathlib import Path

import scipy.io

from rigtwin.sim.campaign import Run
from rigtwin.sim.formats.in_child import decode
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.settings import RunSettings
from rigtwin.sim.formats.variables import arrays_of, recording_of, texts_of


def read(path: Path, given: RunSettings) -> Recording:
    """Read a MATLAB run of any version from 4."""
    variables, _ = decode(path, "matlab")
    # Names such as __header__ and #refs# are the format's own.
    return recording_of(path, {name: value for name, value in variables.items() if not name.startswith(("_", "#"))})


def write(run: Run, path: Path) -> None:
    """Write a MATLAB 5 file."""
    with path.open("wb") as file:
        scipy.io.savemat(file, {**arrays_of(run), **texts_of(run)}, oned_as="column")
