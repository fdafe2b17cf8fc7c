"""Named arrays and settings, the layout that HDF5 and MATLAB files share.

===================  =======================  ==========================================================
name                 shape                    meaning
===================  =======================  ==========================================================
``frequency_Hz``     (n_freq,)                lines, increasing
``H``                (n_freq, n_channels)     response; real where magnitudes only were recorded
``node``             (n_channels,)            node of each channel, from 1
``plane``            text of n_channels       "y" or "z" for each channel; left out: all y
``sensor``           text of n_channels       a letter for each of several sensors of one node, "-" for none
``std``              (n_freq, n_channels)     standard error, optional
``coherence``        (n_freq, n_channels)     coherence of averaged spectra, optional
``force_N``          (n_freq,)                force of each line, optional
``swept_Hz``         (n_swept,)               all lines that were swept, where only some are here
``h2``, ``h3`` …     (n_freq, n_channels)     harmonics, optional
settings             scalar or text           ``support``, ``spin_rpm`` …, the keys of a ``[[run]]`` table
===================  =======================  ==========================================================
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Channel, MeasurementError, Run
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.settings import SETTING_NAMES, check_settings, stored_settings

_ARRAYS = ("frequency_Hz", "H", "node", "std", "coherence", "force_N", "swept_Hz")
_TEXTS = ("plane", "sensor")
_HARMONIC = re.compile(r"h([2-9]|[1-9]\d+)")

UNITS = {"accelerance": "(m/s^2)/N", "mobility": "(m/s)/N", "receptance": "m/N", "acceleration": "m/s^2"}


def arrays_of(run: Run) -> dict[str, np.ndarray]:
    """The arrays of a run by name."""
    responses = {"H": run.H, **{f"h{order}": values for order, values in sorted(run.harmonics.items())}}
    arrays = {
        "frequency_Hz": np.asarray(run.frequency_hz, dtype=float),
        "node": np.array([channel.node for channel in run.channels], dtype=np.int64),
        **{name: values.real if run.magnitude_only else values.astype(complex) for name, values in responses.items()},
    }
    optional = {"std": run.std, "force_N": run.force_N, "swept_Hz": run.swept_hz}
    return arrays | {name: values for name, values in optional.items() if values is not None}


def texts_of(run: Run) -> dict[str, str | int | float]:
    """Settings, planes and sensors' letters of a run by name."""
    texts = {**stored_settings(run), "plane": "".join(channel.plane for channel in run.channels)}
    labelled = any(channel.label for channel in run.channels)
    return texts | ({"sensor": "".join(channel.label or "-" for channel in run.channels)} if labelled else {})


def known(name: str) -> bool:
    """Whether a variable of this name belongs to a run.

    >>> known("h3"), known("force")
    (True, False)
    """
    return name in (*_ARRAYS, *_TEXTS, *SETTING_NAMES) or _HARMONIC.fullmatch(name) is not None


def recording_of(path: Path, variables: Mapping[str, Any]) -> Recording:
    """Assemble a recording from named arrays, scalars and texts. Raises MeasurementError that names the variable."""
    _check_names(path, variables)
    frequency_hz = _vector(path, "frequency_Hz", variables["frequency_Hz"])
    channels = _channels(path, variables)
    shape = (len(frequency_hz), len(channels))
    H = _matrix(path, "H", variables["H"], shape)
    harmonics = {_order(name): _matrix(path, name, variables[name], shape) for name in variables if _order(name)}
    return Recording(
        frequency_hz=frequency_hz,
        H=H.astype(complex),
        channels=channels,
        std=_optional(path, "std", variables, shape),
        harmonics={order: values.astype(complex) for order, values in sorted(harmonics.items())},
        magnitude_only=not np.iscomplexobj(H),
        settings=check_settings({name: _scalar(variables[name]) for name in SETTING_NAMES if name in variables}, path),
        force_N=_optional(path, "force_N", variables, shape[:1]),
        coherence=_optional(path, "coherence", variables, shape),
        swept_hz=_vector(path, "swept_Hz", variables["swept_Hz"]) if "swept_Hz" in variables else None,
    )


def _order(name: str) -> int:
    """Harmonic order of a variable's name, 0 for any other name."""
    match = _HARMONIC.fullmatch(name)
    return int(match[1]) if match else 0


def _check_names(path: Path, variables: Mapping[str, Any]) -> None:
    for name in variables:
        if not known(name):
            raise MeasurementError(
                f"{path}: unknown variable {name!r}; save only {', '.join((*_ARRAYS, *_TEXTS))}, h2, h3 … "
                f"and {', '.join(SETTING_NAMES)}"
            )
    for name in ("frequency_Hz", "H", "node"):
        if name not in variables:
            raise MeasurementError(f"{path}: variable {name!r} is missing; a run needs frequency_Hz, H and node")


def _numbers(path: Path, name: str, value: Any) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.kind not in "iufc":
        raise MeasurementError(f"{path}: variable {name!r} holds no numbers; save it as a numeric array")
    return array


def _real(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    if np.iscomplexobj(array):
        raise MeasurementError(f"{path}: variable {name!r} is complex; it must be real")
    return array.astype(float)


def _vector(path: Path, name: str, value: Any) -> FloatArray:
    return _real(path, name, _numbers(path, name, value)).ravel()


def _optional(path: Path, name: str, variables: Mapping[str, Any], shape: tuple[int, ...]) -> FloatArray | None:
    """Real numbers, (n_freq, n_channels) or (n_freq,); None where the file does not hold them."""
    if name not in variables:
        return None
    if len(shape) == 2:
        return _real(path, name, _matrix(path, name, variables[name], (shape[0], shape[1])))
    vector = _vector(path, name, variables[name])
    if vector.shape != shape:
        raise MeasurementError(f"{path}: variable {name!r} has {vector.size} numbers; give one for each frequency_Hz")
    return vector


def _matrix(path: Path, name: str, value: Any, shape: tuple[int, int]) -> np.ndarray:
    """(n_freq, n_channels) numbers; with a single channel any vector will do."""
    array = _numbers(path, name, value)
    if shape[1] == 1 and array.size == shape[0]:
        array = array.reshape(shape)
    if array.shape != shape:
        raise MeasurementError(
            f"{path}: variable {name!r} has shape {array.shape}, expected {shape}: a row for each of frequency_Hz, "
            "a column for each of node"
        )
    return array


def _channels(path: Path, variables: Mapping[str, Any]) -> tuple[Channel, ...]:
    nodes = _vector(path, "node", variables["node"])
    if nodes.size == 0 or not np.isfinite(nodes).all() or np.any(nodes < 1) or np.any(nodes != np.round(nodes)):
        raise MeasurementError(f"{path}: variable 'node' must hold each channel's node, whole numbers from 1")
    planes = str(_scalar(variables["plane"])) if "plane" in variables else "y" * nodes.size
    if len(planes) != nodes.size or not set(planes) <= {"y", "z"}:
        raise MeasurementError(
            f"{path}: variable 'plane' is {planes!r}; it must be a text of {nodes.size} letters, y or z for each node"
        )
    letters = str(_scalar(variables["sensor"])) if "sensor" in variables else "-" * nodes.size
    if not re.fullmatch(f"[a-z-]{{{nodes.size}}}", letters):
        raise MeasurementError(
            f"{path}: variable 'sensor' is {letters!r}; it must be a text of {nodes.size} characters, for each node "
            "a small letter, or - where it has one sensor"
        )
    return tuple(
        Channel(int(node), "z" if plane == "z" else "y", letter.strip("-"))
        for node, plane, letter in zip(nodes, planes, letters, strict=True)
    )


def _scalar(value: Any) -> Any:
    """A number, a text or nested lists out of the array a file keeps them in."""
    array = np.asarray(value)
    if array.dtype.kind == "S":
        array = np.char.decode(array, "utf-8", errors="replace")
    texts = array.ravel().tolist()
    if array.size and all(isinstance(text, str) for text in texts):
        return "".join(texts)
    return array.item() if array.size == 1 else array.tolist()
