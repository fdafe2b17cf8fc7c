"""What a data set of another laboratory is to the benchmark."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray


class MissingDataError(ValueError):
    """A file of a data set is not there; the message says which and where it comes from."""


@dataclass(frozen=True)
class Fold:
    """A campaign to diagnose, and one to predict."""

    name: str
    train: Path  # folder of a campaign
    held: Path  # folder of a campaign


@dataclass(frozen=True)
class Control:
    """What something simpler than the diagnosis predicts of sweeps that it has not seen."""

    words: str
    errors: tuple[float, ...]  # NRMSE of each


@dataclass(frozen=True)
class DataSet:
    """Measurements of one rig."""

    key: str  # name of its folder
    title: str
    measured: str  # what and how
    source: str  # address of the repository
    licence: str
    files: tuple[str, ...]  # that must be there, below its folder
    folds: Callable[[Path, Path], list[Fold]]  # from its folder and an empty one for campaigns
    controls: Callable[[Path], list[Control]]  # from its folder
    silent: str  # what these data cannot say

    def folder_in(self, data: Path) -> Path:
        """Its folder. Raises MissingDataError where a file is missing."""
        for file in self.files:
            if not (data / self.key / file).is_file():
                raise MissingDataError(
                    f"{data / self.key / file}: no such file; {self.title} needs it: take it from {self.source}, or "
                    "leave this data set out with --only"
                )
        return data / self.key


def nrmse(measured: ComplexArray, predicted: ComplexArray) -> float:
    """sqrt(sum |H - Hp|^2 / sum |H|^2) of one sweep."""
    return float(np.linalg.norm(measured - predicted) / np.linalg.norm(measured))


def scatter(H: ComplexArray) -> float:
    """What neighbouring lines, evenly spaced, leave unexplained of each other, over the whole: an NRMSE (n_freq >= 5).

    Every line is compared with the cubic through the two lines on each side, whose own noise is taken off. Where a
    resonance is as narrow as the lines are apart, the cubic misses it and the figure is too large.

    >>> line = np.arange(20.0) ** 3 + 1j
    >>> scatter(line) < 1e-12
    True
    """
    weights = np.array([-1, 4, 0, 4, -1]) / 6
    between = np.convolve(H, weights, mode="valid")
    own = np.sqrt(1 + np.sum(weights**2))
    return float(np.linalg.norm(H[2:-2] - between) / own / np.linalg.norm(H[2:-2]))
