"""A record: samples of one or more channels over time, as an instrument stored them, and the checks of all formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import MeasurementError

# Times may be this far from evenly spaced ones, in steps: a lost sample shifts what follows by a whole step.
_UNEVEN = 0.3

# Instruments write numbers like 9.9e37 where a value was out of their range.
_OUT_OF_RANGE = 1e30

# Two samples give no spectrum; a record of so few is a list of something else.
_FEWEST = 16


@dataclass(frozen=True)
class Record:
    """Samples of one or more channels, evenly spaced in time, in the units of the file."""

    name: str  # of its file
    sample_rate_hz: float
    samples: FloatArray  # (n, n_channels)
    names: tuple[str, ...]  # of the channels, in the order of axis 1
    units: tuple[str, ...]  # of the channels; empty where the file says none


def record_of(
    path: Path,
    channels: Mapping[str, FloatArray],
    units: Sequence[str],
    *,
    time_s: FloatArray | None,
    sample_rate_hz: float | None,
) -> Record:
    """Assemble a record and check it.

    Parameters
    ----------
    channels : name -> (n,) samples
    units : of the channels, in their order
    time_s : (n,) of each sample, where the file has it
    sample_rate_hz : wins over ``time_s``

    Raises
    ------
    MeasurementError : names the file and what is wrong with it
    """
    lengths = {name: len(values) for name, values in channels.items()}
    if not lengths:
        raise MeasurementError(f"{path}: holds no channel; a record has one column or array for each channel")
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise MeasurementError(f"{path}: channels of different lengths ({told} samples); save them again, all as long")
    if min(lengths.values()) < _FEWEST:
        raise MeasurementError(f"{path}: {min(lengths.values())} samples; a record has {_FEWEST} or more")
    samples = np.column_stack([np.asarray(values, dtype=float) for values in channels.values()])
    _check_numbers(path, samples, tuple(channels))
    if sample_rate_hz is None:
        if time_s is None:
            raise MeasurementError(
                f"{path}: says neither times nor a sampling rate; give it with --sample-rate, or as sample_rate_Hz in "
                "the plan"
            )
        sample_rate_hz = _rate_of(path, time_s)
    return Record(path.name, float(sample_rate_hz), samples, tuple(channels), tuple(units))


def _check_numbers(path: Path, samples: FloatArray, names: Sequence[str]) -> None:
    wrong = ~np.isfinite(samples) | (np.abs(np.nan_to_num(samples)) > _OUT_OF_RANGE)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        value = float(samples[row, column])
        why = "out of the instrument's range" if np.isfinite(value) or np.isinf(value) else "not a number"
        raise MeasurementError(
            f"{path}: sample {row + 1} of {names[column]} is {value:g}, {why} ({np.count_nonzero(wrong)} in "
            "all); record it again, or move the file out of the folder"
        )


def _rate_of(path: Path, time_s: FloatArray) -> float:
    """Samples a second of evenly spaced times. Raises MeasurementError where they are not."""
    n = len(time_s)
    if not np.isfinite(time_s).all():
        raise MeasurementError(f"{path}: time of sample {np.argmin(np.isfinite(time_s)) + 1} is no number; correct it")
    step = (time_s[-1] - time_s[0]) / (n - 1)
    if step <= 0:
        raise MeasurementError(f"{path}: the times do not increase; give the sampling rate with --sample-rate")
    off = np.abs(time_s - time_s[0] - step * np.arange(n)) / step
    if off.max() > _UNEVEN:
        place = int(np.argmax(np.abs(np.diff(time_s) - step)))
        raise MeasurementError(
            f"{path}: the times are not evenly spaced: from sample {place + 1} to {place + 2} they step by "
            f"{time_s[place + 1] - time_s[place]:.6g} s, on the whole by {step:.6g} s; samples are missing, or the "
            "times are rounded too much: then give the sampling rate with --sample-rate"
        )
    return 1 / step
