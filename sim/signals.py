"""A record as forces and motions: the channels of a plan in SI, and what is wrong with how they were recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Channel, MeasurementError
from rigtwin.sim.formats.record import Record
from rigtwin.sim.formats.reduction_plan import Source

# So many samples at the end of the range, and so many times as many as one step before it, are more than the flat top
# of a sine has: there at most 2.4 times as many fall on the highest step as on the next.
_STUCK, _MORE_THAN_NEXT = 4, 4.0

# An end of the range is further from the middle than this share of the other end: the force of a hammer rests near it.
_NO_END = 0.25

# Levels closer together than this share of the range are one level that was written with rounded digits.
_SAME_LEVEL = 1e-9


@dataclass(frozen=True)
class Signals:
    """One record in SI."""

    name: str
    sample_rate_hz: float
    samples: FloatArray  # (n, n_channels [+ 1]) responses, and last the force or the reference, if there is one
    sources: tuple[Source, ...]  # order of axis 1

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Of the responses."""
        return tuple(source.channel for source in self.sources if source.channel)

    @property
    def steps(self) -> FloatArray:
        """(n_signals,) step of the converter in the unit of each signal; of a continuous signal next to nothing."""
        return np.array([converter_step(values) for values in self.samples.T])


def signals_of(record: Record, sources: tuple[Source, ...], path: Path) -> Signals:
    """The channels of a plan. Raises MeasurementError that names file and channel."""
    columns = [_column(record, source, path) for source in sources]
    factors = []
    for source, column in zip(sources, columns, strict=True):
        try:
            factors.append(source.factor(record.units[column]))
        except ValueError as error:
            raise MeasurementError(f"{path}: channel {source.name} ({record.names[column]}): {error}") from error
    samples = record.samples[:, columns] * np.array(factors)
    for source, values in zip(sources, samples.T, strict=True):
        if np.ptp(values) == 0:
            raise MeasurementError(
                f"{path}: channel {source.name}: every sample is the same; is it connected, and is its range small "
                "enough? Record it again, or take the channel out of the plan"
            )
    return Signals(record.name, record.sample_rate_hz, samples, sources)


def _column(record: Record, source: Source, path: Path) -> int:
    names = record.names
    wanted = str(source.column)
    alike = [k for k, name in enumerate(names) if name.lower() == wanted.lower()]
    if wanted in names or len(alike) == 1:
        return names.index(wanted) if wanted in names else alike[0]
    raise MeasurementError(
        f"{path}: channel {source.name}: no column is called {wanted!r}; the file has {', '.join(names)}"
    )


def converter_step(values: FloatArray) -> float:
    """Smallest distance of two levels among samples (n,).

    >>> converter_step(np.array([0.0, 0.5, 1.5, 0.5]))
    0.5
    """
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > _SAME_LEVEL * np.ptp(values)]
    return float(gaps.min()) if len(gaps) else 0.0


def clipped_share(values: FloatArray) -> float:
    """Share of the samples (n,) that stick to the end of the range; zero where no end of the range is seen.

    An end that is near the median is none: the force of a hammer rests there between blows.
    """
    step, middle = converter_step(values), float(np.median(values))
    stuck = 0
    for towards in (1.0, -1.0):
        reach = towards * (values - middle)
        if reach.max() < _NO_END * np.abs(values - middle).max():
            continue
        below = reach.max() - reach
        at_end = np.count_nonzero(below < 0.5 * step)
        at_next = np.count_nonzero((below >= 0.5 * step) & (below < 1.5 * step))
        if at_end >= max(_STUCK, _MORE_THAN_NEXT * at_next):
            stuck += at_end
    return stuck / len(values)
