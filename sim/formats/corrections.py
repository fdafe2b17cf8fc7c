"""What the campaign says of how data are to be read: phases, bands, coherence, a controlled response, reciprocity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel, MeasurementError
from rigtwin.sim.formats.recording import Recording
from rigtwin.sim.formats.units import FREQUENCY, factor_of, response_factor


def corrected(path: Path, recording: Recording, settings: Mapping[str, Any]) -> Recording:
    """The recording as a run holds it. Raises MeasurementError that names the file and the key.

    Parameters
    ----------
    settings : all settings of the run; see ``RunSettings``
    """
    recording = _in_si(recording, settings.get("unit", ""), settings.get("frequency_unit", ""))
    recording = _with_phase_offset(path, recording, settings.get("phase_offset_deg", 0.0))
    recording = _with_errors_of_coherence(path, recording, settings.get("averages"))
    recording = _with_force_of_response(path, recording, settings)
    recording = _without_bands(path, recording, settings.get("keep_Hz"), settings.get("leave_out_Hz", ()))
    _check_reciprocal(path, recording, settings)
    return recording


def _in_si(recording: Recording, unit: str, frequency_unit: str) -> Recording:
    """Responses and frequencies in SI that the file holds in other units."""
    factor, per_hertz = response_factor(unit) or 1.0, factor_of(frequency_unit, FREQUENCY) or 1.0
    if factor == per_hertz == 1:
        return recording
    return replace(
        recording,
        frequency_hz=recording.frequency_hz * per_hertz,
        swept_hz=None if recording.swept_hz is None else recording.swept_hz * per_hertz,
        H=recording.H * factor,
        std=None if recording.std is None else recording.std * factor,
        harmonics={order: values * factor for order, values in recording.harmonics.items()},
    )


def _with_phase_offset(path: Path, recording: Recording, offset_deg: float) -> Recording:
    """Every phase later by an offset of the reference; a harmonic of order n by n times as much."""
    if offset_deg == 0:
        return recording
    if recording.magnitude_only:
        raise MeasurementError(f"{path}: phase_offset_deg: the data have no phases; remove the key")

    def turn(order: int) -> complex:
        return complex(np.exp(1j * np.radians(order * offset_deg)))

    harmonics = {order: values * turn(order) for order, values in recording.harmonics.items()}
    return replace(recording, H=recording.H * turn(1), harmonics=harmonics)


def error_of_coherence(H: ComplexArray, coherence: FloatArray, averages: float) -> FloatArray:
    """Standard error of an H1 estimate, sqrt(E|error|^2) = |H| sqrt((1 - g) / (g n)) with the coherence g.

    The part (1 - g) of the response's spectrum Gyy is noise, and the squared error of H1 = Gxy / Gxx is that part over
    n Gxx, with g Gyy = |H|^2 Gxx. Half of it lies along H: the magnitude's error is |H| sqrt((1 - g) / (2 g n)).

    Parameters
    ----------
    H, coherence : (n_freq, n_channels); coherence above 0 and at most 1
    averages : number n of averaged spectra

    >>> error_of_coherence(np.array([[2.0]]), np.array([[0.8]]), averages=4)
    array([[0.5]])
    """
    return np.abs(H) * np.sqrt((1 - coherence) / (coherence * averages))


def _with_errors_of_coherence(path: Path, recording: Recording, averages: int | None) -> Recording:
    coherence = recording.coherence
    if coherence is None:
        if averages is not None:
            raise MeasurementError(
                f"{path}: averages: says how many spectra are behind a coherence, and the file holds no coherence of "
                "all channels; add it or remove the key"
            )
        return recording
    if averages is None:
        raise MeasurementError(
            f"{path}: averages is not known; say how many spectra were averaged, for example averages = 5, so that "
            "the coherence gives standard errors"
        )
    if recording.std is not None:
        raise MeasurementError(f"{path}: holds both standard errors and coherence; keep one of them")
    if wrong := np.argwhere(~((coherence > 0) & (coherence <= 1))).tolist():
        row, column = wrong[0]
        place = f"{recording.channels[column]} at {float(recording.frequency_hz[row])!r} Hz"
        value = float(coherence[row, column])
        raise MeasurementError(
            f"{path}: coherence of {place} is {value!r}; it lies above 0 and is at most 1: remove the line"
        )
    return replace(recording, std=error_of_coherence(recording.H, coherence, averages), coherence=None)


def _with_force_of_response(path: Path, recording: Recording, settings: Mapping[str, Any]) -> Recording:
    """The force of every line where a controller held a response: that response over its response per newton."""
    amplitude, node = settings.get("response_amplitude"), settings.get("response_node")
    if amplitude is None:
        if node is not None:
            raise MeasurementError(f"{path}: response_node: goes with response_amplitude; add that or remove the key")
        return recording
    if settings["control"] != "response":
        raise MeasurementError(f'{path}: response_amplitude: goes with control = "response"; write that, too')
    if recording.force_N is not None:
        raise MeasurementError(f"{path}: response_amplitude: the file holds force_N of every line; remove the key")
    held = Channel(settings["excitation_node"] if node is None else node, settings["excitation_plane"])
    if held not in recording.channels:
        there = ", ".join(map(str, recording.channels))
        raise MeasurementError(
            f"{path}: response_amplitude: the controlled channel {held} is not in the file, which has {there}; say "
            "its node with response_node"
        )
    response = np.abs(recording.H[:, recording.channels.index(held)])
    if not response.all():
        raise MeasurementError(f"{path}: response_amplitude: {held} has lines without response; remove these lines")
    return replace(recording, force_N=amplitude / response)


def _without_bands(
    path: Path,
    recording: Recording,
    keep: Sequence[tuple[float, float]] | None,
    leave_out: Sequence[tuple[float, float]],
) -> Recording:
    """The lines inside the bands to keep and outside those to leave out; what was swept stays known."""
    kept = np.ones(len(recording.frequency_hz), dtype=bool)
    if keep is not None:
        kept &= _inside(recording.frequency_hz, keep)
    kept &= ~_inside(recording.frequency_hz, leave_out)
    if kept.all():
        return recording
    if not kept.any():
        key = "keep_Hz" if keep is not None and not leave_out else "leave_out_Hz"
        raise MeasurementError(f"{path}: {key}: leaves no line of the file; correct the bands")
    swept = recording.frequency_hz if recording.swept_hz is None else recording.swept_hz
    return replace(recording.on_lines(kept), swept_hz=swept)


def _inside(frequency_hz: FloatArray, bands: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """(n_freq,) whether a line is in one of the bands, their ends included."""
    inside = np.zeros(len(frequency_hz), dtype=bool)
    for low, high in bands:
        inside |= (frequency_hz >= low) & (frequency_hz <= high)
    return inside


def _check_reciprocal(path: Path, recording: Recording, settings: Mapping[str, Any]) -> None:
    """A roving exciter is written as roving sensors, which holds for a linear rotor that does not spin."""
    if settings["roving"] is None:
        return
    if settings["spin_rpm"]:
        why = "holds for a rotor that stands still"
    elif recording.harmonics:
        why = "holds for a linear rotor, and the file holds harmonics"
    elif recording.force_N is not None:
        why = "leaves no place for a force of each line"
    elif settings["quantity"] == "acceleration":
        why = "needs responses per newton"
    else:
        return
    raise MeasurementError(f'{path}: roving = "exciter": the reciprocity that is used {why}; make a run for each blow')
