"""The variables of an HDF5 or MATLAB file, decoded in a process that a damaged file cannot take along."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rigtwin.sim.campaign import MeasurementError

_DECODER = Path(__file__).with_name("decoder.py")
_NAMES = {"hdf5": "HDF5", "matlab": "a MATLAB file"}

# Seconds by the clock, on a machine that is busy with other work; the program ends after 8 s of the processor's time.
_LONGEST = 60.0


def decode(path: Path, kind: Literal["hdf5", "matlab"]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays and texts at the root of a file, and its attributes, by name; None for what is neither.

    Raises MeasurementError where the file cannot be read.
    """
    path.open("rb").close()  # whether it may be read at all
    command = [sys.executable, "-P", str(_DECODER), kind, str(path.absolute())]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, capture_output=True, timeout=_LONGEST, check=False, env=environment)
    except subprocess.TimeoutExpired:
        raise _unreadable(path, kind, f"it takes more than {_LONGEST:.0f} s") from None
    if done.returncode == 3:
        raise _unreadable(path, kind, done.stderr.decode(errors="replace").strip())
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        raise _unreadable(path, kind, "it takes too long")
    if done.returncode:
        raise _unreadable(path, kind, f"the library that reads it ended with exit code {done.returncode}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
        names, attributes = archive["names"].tolist(), archive["attributes"].tolist()
        values = [archive[f"v{k}"] for k in range(len(names) + len(attributes))]
    known = [None if value.dtype.kind == "V" else value for value in values]
    return dict(zip(names, known, strict=False)), dict(zip(attributes, known[len(names) :], strict=True))


def _unreadable(path: Path, kind: str, why: str) -> MeasurementError:
    return MeasurementError(f"{path}: cannot be read as {_NAMES[kind]} ({why}); save it again")
