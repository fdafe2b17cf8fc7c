"""Stepped sine from records: one record of one frequency becomes one line, with everything that is odd about it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER, Quantity
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel, MeasurementError, Run
from rigtwin.sim.detection import NoSineError, Phasors, detect, detect_at, find_frequency, per_force, quantisation_error
from rigtwin.sim.formats.reduction_plan import FORCE
from rigtwin.sim.signals import Signals, clipped_share

# A change from the first to the last part that is so many standard errors large is no noise: once in 8,000 lines by
# chance, as |error|^2/std^2 is exponential.
_SEEN = 3.0

# A sine of which this share of the samples sticks to an end of the range has lost 0.05 % of its peak there.
_CLIPPED = 0.01

# A channel's change is judged beside its own size, or beside this share of the largest channel.
_SHARE = 0.1

# Fewest periods of a part of a record; a record of six and more is judged by its thirds, a shorter one by its halves.
_PART, _THIRDS = 1, 6

# A frequency in a file's name is believed to this share, and to half of its last digit.
_NAMED_EXACTLY = 1e-3
# From so many records, all misnamed by one factor within this share, the sampling rate may be wrong.
_MANY, _ALL_ALIKE = 4, 0.02
_NAME = re.compile(r"(\d+)(?:[.,p](\d+))?[ _]?(k?)hz", re.IGNORECASE)


@dataclass(frozen=True)
class RecordedLine:
    """One frequency line from one record."""

    record: str
    frequency_hz: float
    frequency_std_hz: float
    response: ComplexArray  # (n_channels,) acceleration per newton, or acceleration; real where no phase is known
    std: FloatArray  # (n_channels,) standard error: noise, steps of the converter, what has not settled
    force_N: float  # peak; nan without a force channel
    periods: float
    change: float  # from the first to the last part of the record beyond noise, largest over channels, relative
    remarks: tuple[str, ...]  # what is odd, each a sentence without the record's name, which may say another frequency
    usable: bool = True


def line_of(signals: Signals, largest_change: float) -> RecordedLine:
    """Reduce one record of a settled sine.

    The frequency is that of the force, of the reference where there is no force, else of the strongest response.

    Parameters
    ----------
    largest_change : of the response from the first to the last part of the record; a line that changes more is left out

    Raises
    ------
    MeasurementError : the record holds no steady sine of two periods or more
    """
    rate, lead = signals.sample_rate_hz, _leading(signals)
    try:
        found, found_std = find_frequency(signals.samples[:, lead])
    except NoSineError as error:
        name = signals.sources[lead].name
        raise MeasurementError(
            f"{signals.name}: channel {name}: {error}; record a settled sine, or move the file out of the folder"
        ) from error
    response, std, force = _per_lead(signals, _phasors(signals, found))
    change, unsettled = _change(signals, found)
    std = np.hypot(std, unsettled)
    frequency = found * rate
    to_acceleration = _to_acceleration(signals, frequency)
    response, std = response * to_acceleration, std * np.abs(to_acceleration)
    if not _has_lead(signals):
        response = np.abs(response).astype(complex)
    clipped = _clipped(signals)
    remarks = [*clipped]
    if unsettled.any():
        words = f"the response still changes by {100 * change:.2g} % from the first to the last part"
        used = "the standard error holds the change" if change <= largest_change else "the line is left out"
        remarks.append(f"not settled: {words}; {used}")
    if clipped:
        remarks[0] += "; the line is left out"
    return RecordedLine(
        record=signals.name,
        frequency_hz=frequency,
        frequency_std_hz=found_std * rate,
        response=response,
        std=std,
        force_N=force,
        periods=len(signals.samples) * found,
        change=change,
        remarks=tuple(remarks),
        usable=not clipped and change <= largest_change,
    )


def remarks_of(lines: Sequence[RecordedLine]) -> list[str]:
    """What is odd about each record, and about names of files that say other frequencies than their samples."""
    misnamed = [(line, said) for line in lines if (said := _named_otherwise(line)) is not None]
    factors = [said / line.frequency_hz for line, said in misnamed]
    told = [f"{line.record}: {words}" for line in lines for words in line.remarks]
    if len(factors) >= _MANY and max(factors) < (1 + _ALL_ALIKE) * min(factors):
        words = f"the names of {len(factors)} records say {np.median(factors):.3g} times the frequency of their samples"
        return [f"{words}: is the sampling rate right? The samples are believed", *told]
    for line, said in misnamed:
        words = f"its name says {said:g} Hz, its samples {line.frequency_hz:.6g} Hz; the samples are believed"
        told.append(f"{line.record}: {words}")
    return told


def run_of_lines(lines: Sequence[RecordedLine], channels: Sequence[Channel], lead: str | None) -> Run:
    """A run of all usable lines; the others are among those that were swept.

    Parameters
    ----------
    lead : "force", "reference" or None, as the records have it; without a force the run holds accelerations

    Raises
    ------
    MeasurementError : no line is usable, or two records are of one frequency
    """
    lines = sorted(lines, key=lambda line: line.frequency_hz)
    used = [line for line in lines if line.usable]
    if not used:
        raise MeasurementError(f"no record is usable; of the first, {lines[0].record}: {'; '.join(lines[0].remarks)}")
    for before, after in itertools.pairwise(lines):
        if after.frequency_hz <= before.frequency_hz:
            raise MeasurementError(
                f"{before.record} and {after.record}: both are of {after.frequency_hz:.6g} Hz; move one "
                "out of the folder"
            )
    quantity: Quantity = "accelerance" if lead == FORCE else "acceleration"
    force = np.array([line.force_N for line in used])
    frequency, H = np.array([line.frequency_hz for line in used]), np.array([line.response for line in used])
    return Run(
        frequency_hz=frequency,
        H=H,
        channels=tuple(channels),
        support="bearing",
        std=np.hypot([line.std for line in used], _by_frequency(used, frequency, H)),
        quantity=quantity,
        magnitude_only=lead is None,
        force_amplitude_N=float(np.median(force)) if lead == FORCE else None,
        force_N=force if lead == FORCE else None,
        swept_hz=np.array([line.frequency_hz for line in lines]) if len(used) < len(lines) else None,
    )


def _by_frequency(lines: Sequence[RecordedLine], frequency_hz: FloatArray, H: ComplexArray) -> FloatArray:
    """(n_freq, n_channels) error of each line by that of its frequency, where the response is steep."""
    if len(lines) < 2:
        return np.zeros(H.shape)
    slope = np.abs(np.gradient(H, frequency_hz, axis=0))
    return slope * np.array([line.frequency_std_hz for line in lines])[:, None]


def _has_lead(signals: Signals) -> bool:
    """Whether the last signal is a force or a reference."""
    return signals.sources[-1].channel is None


def _leading(signals: Signals) -> int:
    """Place of the signal that tells the frequency."""
    return len(signals.sources) - 1 if _has_lead(signals) else int(np.argmax(signals.samples.std(axis=0)))


def _phasors(signals: Signals, cycles_per_sample: float, part: slice = slice(None)) -> Phasors:
    """Phasors of a part of a record; the error by the converter's steps is among the standard errors."""
    samples = signals.samples[part]
    per_period = round(1 / cycles_per_sample)
    whole = len(samples) % per_period == 0 and per_period >= 8 and abs(per_period * cycles_per_sample - 1) < 1e-9
    phasors = detect(samples, per_period) if whole else detect_at(samples, cycles_per_sample)
    steps = quantisation_error(np.abs(phasors.amplitude[0]), signals.steps, phasors.std, len(samples))
    return replace(phasors, std=np.hypot(phasors.std, steps))


def _per_lead(signals: Signals, phasors: Phasors) -> tuple[ComplexArray, FloatArray, float]:
    """Fundamental over the force; over the reference's phase; or as it is. Standard error; peak force, or nan."""
    if not _has_lead(signals):
        return phasors.amplitude[0], phasors.std, np.nan
    size = float(np.abs(phasors.amplitude[0, -1]))
    over = per_force(phasors)
    if signals.sources[-1].name == FORCE:
        return over.amplitude[0], over.std, size
    return over.amplitude[0] * size, over.std * size, np.nan


def _change(signals: Signals, cycles_per_sample: float) -> tuple[float, FloatArray]:
    """Change from the first part of the record to the last beyond noise: largest, relative; and (n_channels,)."""
    N, periods = len(signals.samples), len(signals.samples) * cycles_per_sample
    length = N // 3 if periods >= _THIRDS else N // 2
    if length * cycles_per_sample < _PART * 0.999:
        return 0.0, np.zeros(len(signals.channels))
    ends = [
        _per_lead(signals, _phasors(signals, cycles_per_sample, part)) for part in (slice(length), slice(-length, None))
    ]
    (first, first_std, _), (last, last_std, _) = ends
    if not _has_lead(signals):
        first, last = np.abs(first), np.abs(last)
    difference, size = np.abs(last - first), np.abs(last)
    judged = np.maximum(size, _SHARE * size.max())
    unsettled = np.where(difference > _SEEN * np.hypot(first_std, last_std), difference, 0.0)
    return float(np.max(unsettled / judged)), unsettled


def _to_acceleration(signals: Signals, frequency_hz: float) -> ComplexArray:
    """(n_channels,) factors from what each sensor measures to its acceleration."""
    order = np.array([source.order for source in signals.sources if source.channel])
    return (2j * np.pi * frequency_hz) ** (DERIVATIVE_ORDER["acceleration"] - order)


def _clipped(signals: Signals) -> list[str]:
    """A sentence on the channels that stick to the end of their range; a reference may be a square wave."""
    shares = {
        source.name: clipped_share(values)
        for source, values in zip(signals.sources, signals.samples.T, strict=True)
        if source.channel or source.name == FORCE
    }
    found = [f"{name} ({100 * share:.2g} % of its samples)" for name, share in shares.items() if share > _CLIPPED]
    return [f"clipped: {', '.join(found)} at the end of the range"] if found else []


def _named_otherwise(line: RecordedLine) -> float | None:
    """The frequency that the file's name says [Hz], where it is another than that of its samples."""
    match = _NAME.search(line.record)
    if match is None:
        return None
    scale = 1e3 if match[3] else 1.0
    said = float(f"{match[1]}.{match[2] or 0}") * scale
    rounding = 0.5 * 10.0 ** -len(match[2] or "") * scale
    return said if said and abs(line.frequency_hz - said) > _NAMED_EXACTLY * said + rounding else None
