"""What a data file holds, and the checks that every format shares."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel, MeasurementError, Run
from rigtwin.sim.formats.settings import RunSettings


@dataclass(frozen=True)
class Recording:
    """The contents of one data file, before the campaign's own settings are added."""

    frequency_hz: FloatArray  # (n_freq,)
    H: ComplexArray  # (n_freq, n_channels)
    channels: tuple[Channel, ...]  # order of axis 1
    std: FloatArray | None = None  # (n_freq, n_channels)
    harmonics: dict[int, ComplexArray] = field(default_factory=dict)  # order -> (n_freq, n_channels)
    magnitude_only: bool = False
    settings: RunSettings = field(default_factory=RunSettings)  # what the file itself says
    force_N: FloatArray | None = None  # (n_freq,) peak force of each line
    coherence: FloatArray | None = None  # (n_freq, n_channels)
    swept_hz: FloatArray | None = None  # all lines that were swept, where only some of them are here

    def on_lines(self, lines: NDArray[np.bool_] | slice) -> Recording:
        """The same with some of its lines, or with all of them in another order."""
        return replace(
            self,
            frequency_hz=self.frequency_hz[lines],
            H=self.H[lines],
            std=None if self.std is None else self.std[lines],
            harmonics={order: values[lines] for order, values in self.harmonics.items()},
            force_N=None if self.force_N is None else self.force_N[lines],
            coherence=None if self.coherence is None else self.coherence[lines],
        )

    def upwards(self) -> Recording:
        """A downward sweep with its lines in ascending order."""
        swept = None if self.swept_hz is None else np.sort(self.swept_hz)
        return replace(
            self.on_lines(slice(None, None, -1)), swept_hz=swept, settings={"sweep": "down", **self.settings}
        )


def falls(frequency_hz: FloatArray) -> bool:
    """Whether lines stand in the order of a downward sweep."""
    return len(frequency_hz) > 1 and bool(np.all(np.diff(frequency_hz) < 0))


def misplaced(frequency_hz: FloatArray) -> int | None:
    """Index of the first line that is not positive, or above the one before; None where all rise, or all fall.

    >>> misplaced(np.array([10.0, 12.0, 11.0]))
    2
    """
    if falls(frequency_hz) and frequency_hz[-1] > 0:
        return None
    wrong = ~np.isfinite(frequency_hz) | (np.diff(frequency_hz, prepend=0.0) <= 0)
    return int(np.argmax(wrong)) if wrong.any() else None


def check_frequencies(path: Path, frequency_hz: FloatArray) -> None:
    """Refuse lines that are not positive or not in order; ``path`` names the file."""
    if frequency_hz.size == 0:
        raise MeasurementError(f"{path}: no frequency lines; a run needs at least one")
    if (row := misplaced(frequency_hz)) is not None:
        raise MeasurementError(
            f"{path}: frequency {row + 1} of {len(frequency_hz)} is {float(frequency_hz[row])!r} Hz; "
            "frequencies must be positive numbers that increase, or all decrease: sort the lines and remove repeats"
        )


def check_run(run: Run, path: Path) -> None:
    """Refuse what no data file may hold, on the way in and on the way out; ``path`` names the file."""
    names = ", ".join(map(str, run.channels))
    if not run.channels or len(set(run.channels)) < len(run.channels) or min(c.node for c in run.channels) < 1:
        raise MeasurementError(f"{path}: channels are [{names}]; a run needs one or more, each once, nodes from 1")
    if any(order < 2 for order in run.harmonics):
        raise MeasurementError(f"{path}: harmonics are of order {sorted(run.harmonics)}; they count from 2")
    _check_lines(path, run)
    _check_values(path, run, "H", run.H)
    for order, values in run.harmonics.items():
        _check_values(path, run, f"h{order}", values)
    if run.std is not None:
        _refuse(path, run, "std", ~np.isfinite(run.std), "is not a finite number; remove the line")
        _refuse(path, run, "std", run.std < 0, "is negative; a standard error is not")


def _check_lines(path: Path, run: Run) -> None:
    if run.force_N is not None:
        _refuse_line(path, run, "force_N", ~(np.isfinite(run.force_N) & (run.force_N > 0)), "is not a positive number")
        if run.quantity == "acceleration":
            raise MeasurementError(
                f'{path}: force_N: quantity = "acceleration" is for a force that nobody recorded; divide the response '
                'of each line by its force and write quantity = "accelerance"'
            )
    if run.swept_hz is not None:
        check_frequencies(path, run.swept_hz)
        _refuse_line(path, run, "frequency", ~np.isin(run.frequency_hz, run.swept_hz), "is not among the swept lines")


def _refuse_line(path: Path, run: Run, label: str, wrong: NDArray[np.bool_], problem: str) -> None:
    """Raise for the first True of ``wrong`` (n_freq,)."""
    if wrong.any():
        place = f"{label} at {float(run.frequency_hz[np.argmax(wrong)])!r} Hz"
        raise MeasurementError(f"{path}: {place} {problem}; correct it or remove the line")


def _check_values(path: Path, run: Run, label: str, values: ComplexArray) -> None:
    _refuse(path, run, label, ~np.isfinite(values), "is not a finite number; remove the line")
    if run.magnitude_only:
        advice = "is no magnitude; give numbers that are not negative, or complex values"
        _refuse(path, run, label, (values.real < 0) | (values.imag != 0), advice)


def _refuse(path: Path, run: Run, label: str, wrong: np.ndarray, problem: str) -> None:
    """Raise for the first True of ``wrong`` (n_freq, n_channels)."""
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        place = f"{label} of {run.channels[column]} at {float(run.frequency_hz[row])!r} Hz"
        raise MeasurementError(f"{path}: {place} {problem}")
