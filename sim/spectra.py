"""Hammer and random records: averaged spectra of force and responses, by ``scipy.signal``, become a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import csd, get_window, welch

from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import MeasurementError, Run
from rigtwin.sim.formats.corrections import error_of_coherence
from rigtwin.sim.formats.reduction_plan import Estimator, ReductionPlan
from rigtwin.sim.signals import Signals, clipped_share

# Anti-aliasing filters of analysers let pass up to the sampling rate over this.
_PASSED = 2.56

# Share of a block before the hit, in which offsets are read.
_BEFORE = 0.02

# A pulse ends where the force is below this share of its peak; a second peak above the other share is a second blow.
_PULSE_END, _SECOND_BLOW = 0.05, 0.1

# The force is cut off after so many pulse lengths, smoothly over as many again.
_KEPT_PULSES = 5

# A response that ends a block above this share of its beginning, and above three times its noise, is cut off.
_DECAYED, _ABOVE_NOISE = 0.01, 3.0

# Blocks of a random record without a stated length: so many, each half over the next.
_BLOCKS = 32

# Coherences below this say nothing, and the formula of the error fails.
_INCOHERENT = 1e-6


@dataclass(frozen=True)
class Reduction:
    """A run from spectra, and how it came about."""

    run: Run
    averages: float  # independent spectra behind each line, overlap taken into account
    coherence: FloatArray  # (n_freq, n_channels)
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class _Spectra:
    """Averaged densities of all blocks."""

    frequency_hz: FloatArray  # (n_freq,)
    Gxx: FloatArray  # (n_freq,) of the force
    Gyy: FloatArray  # (n_freq, n_channels)
    Gxy: ComplexArray  # (n_freq, n_channels)
    averages: float


@dataclass(frozen=True)
class _Hit:
    """A blow: its record, its first sample there, and samples since the blow before."""

    signals: Signals
    place: int
    since_last: float


def reduce_spectra(records: Sequence[Signals], plan: ReductionPlan) -> Reduction:
    """A run from hammer or random records.

    Raises
    ------
    MeasurementError : the records differ in channels or rate, hold no blow, or too few of them
    """
    rates = {round(each.sample_rate_hz, 6) for each in records}
    if len(rates) > 1:
        told = ", ".join(f"{rate:g}" for rate in sorted(rates))
        raise MeasurementError(f"records of different sampling rates ({told} Hz); reduce those of one rate at a time")
    spectra, remarks = _of_hits(records, plan) if plan.method == "hammer" else _of_noise(records, plan)
    if spectra.averages < 1.5:
        unit = "blow" if plan.method == "hammer" else "block"
        raise MeasurementError(
            f"one usable {unit} has no coherence, and so no standard errors; {'; '.join(remarks) or 'record'} more"
        )
    return _reduction(records[0], spectra, plan, remarks)


# -- random -------------------------------------------------------------------------------------------------


def _of_noise(records: Sequence[Signals], plan: ReductionPlan) -> tuple[_Spectra, list[str]]:
    """Welch's method with a Hann window, blocks half over the next."""
    rate = records[0].sample_rate_hz
    longest = max(len(each.samples) for each in records)
    n = round(plan.block_s * rate) if plan.block_s else 2 * longest // (_BLOCKS + 1)
    if n > min(len(each.samples) for each in records):
        shortest = min(each.samples.shape[0] for each in records) / rate
        raise MeasurementError(
            f"block_s: {n / rate:g} s is longer than the shortest record, {shortest:g} s; shorten it"
        )
    remarks = _clipped_records(records)
    window = np.asarray(get_window("hann", n), dtype=float)
    parts, blocks = [], []
    for each in records:
        parts.append(_densities(each.samples, rate, window, overlap=n // 2, detrend="constant"))
        blocks.append((len(each.samples) - n // 2) // (n - n // 2))
    averages = sum(_independent(window, n - n // 2, count) for count in blocks)
    return _mean(parts, blocks, averages), remarks


def _clipped_records(records: Sequence[Signals]) -> list[str]:
    """Noise touches the end of a range now and then; a record that sticks to it is no use. Raises MeasurementError."""
    for each in records:
        for source, values in zip(each.sources, each.samples.T, strict=True):
            if share := clipped_share(values):
                raise MeasurementError(
                    f"{each.name}: channel {source.name} is clipped, {100 * share:.2g} % of its samples are at the end "
                    "of the range; record it again with a larger range, or move the file out of the folder"
                )
    return []


def _independent(window: FloatArray, step: int, blocks: int) -> float:
    """How many independent blocks have the variance of so many overlapping ones [welch1967].

    >>> round(_independent(get_window("hann", 64), step=32, blocks=100), 1)
    94.8
    """
    total = 1.0
    for k in range(1, min(blocks, math.ceil(len(window) / step))):
        shifted = float(np.sum(window[k * step :] * window[: len(window) - k * step]) / np.sum(window**2))
        total += 2 * (1 - k / blocks) * shifted**2
    return blocks / total


# -- hammer -------------------------------------------------------------------------------------------------


def _of_hits(records: Sequence[Signals], plan: ReductionPlan) -> tuple[_Spectra, list[str]]:
    """One block from each blow that is usable, without overlap."""
    rate = records[0].sample_rate_hz
    hits = [hit for each in records for hit in _hits_of(each, plan.trigger)]
    if not hits:
        raise MeasurementError("no blow is in the records; is the force the right channel?")
    n = round(plan.block_s * rate) if plan.block_s else _shortest(records, plan.trigger)
    before = max(4, round(_BEFORE * n))
    blocks, remarks = [], []
    for number, hit in enumerate(hits, start=1):
        block = hit.signals.samples[max(hit.place - before, 0) : hit.place - before + n]
        where = f"{hit.signals.name}: blow {number} at {hit.place / rate:.4g} s"
        if hit.place < before or len(block) < n:
            remarks.append(f"{where}: the record does not hold its whole block of {n / rate:.3g} s; left out")
        elif hit.since_last < n - before:
            remarks.append(f"{where}: the motion of the blow before is still in it; left out")
        elif problem := _wrong_blow(block, before, hit.signals):
            remarks.append(f"{where}: {problem}; left out")
        else:
            blocks.append(_windowed(block, before, rate, plan.exponential_s, remarks, where))
    if not blocks:
        raise MeasurementError(f"no blow is usable: {'; '.join(remarks)}")
    if plan.exponential_s:
        remarks.append(
            f"the exponential window of {plan.exponential_s:g} s adds 1/(2 pi f x {plan.exponential_s:g} s) to each "
            f"damping ratio, {1 / (2 * math.pi * 100 * plan.exponential_s):.2g} at 100 Hz; subtract it from fitted ones"
        )
    joined = np.concatenate(blocks)
    spectra = _densities(joined, rate, np.ones(n), overlap=0, detrend=False)
    return _mean([spectra], [len(blocks)], float(len(blocks))), remarks


def _hits_of(signals: Signals, trigger: float) -> list[_Hit]:
    places = find_hits(signals.samples[:, -1], trigger)
    since = [math.inf, *np.diff(places).tolist()]
    return [_Hit(signals, place, last) for place, last in zip(places, since, strict=False)]


def find_hits(force: FloatArray, trigger: float) -> list[int]:
    """Samples at which the force (n,) rises through a share of its largest value; a pulse counts once.

    >>> force = np.zeros(40)
    >>> force[[3, 4, 30]] = 1.0, 5.0, 4.0
    >>> find_hits(force, trigger=0.1)
    [3, 30]
    """
    reach = np.abs(force - np.median(force))
    above = reach > trigger * reach.max()
    begins = np.flatnonzero(above & ~np.roll(above, 1))
    begins = begins[begins > 0]
    if len(begins) == 0:
        return []
    # A pulse that is bent, or a rebound, rises again within a few of its lengths.
    pulse = max(1, round(np.count_nonzero(above) / len(begins)))
    kept = [int(begins[0])]
    for begin in begins[1:]:
        if begin - kept[-1] > 2 * _KEPT_PULSES * pulse:
            kept.append(int(begin))
    return kept


def _shortest(records: Sequence[Signals], trigger: float) -> int:
    """Samples from a blow to the next or to the end of the record, the fewest; one before the next blow."""
    lengths = []
    for each in records:
        places = [*find_hits(each.samples[:, -1], trigger), len(each.samples)]
        lengths += np.diff(places).tolist()
    shortest = min(length for length in lengths if length > 0.5 * max(lengths))
    return math.floor(shortest / (1 + _BEFORE)) - 1


def _wrong_blow(block: FloatArray, before: int, signals: Signals) -> str:
    """Why a blow is not used, nothing where it is."""
    for source, values in zip(signals.sources, block.T, strict=True):
        if clipped_share(values):
            return f"channel {source.name} is clipped"
    force = np.abs(block[:, -1] - np.median(block[:before, -1]))
    end = _pulse_end(force)
    noise = force[:before].max()
    if force[end:].max(initial=0.0) > max(_SECOND_BLOW * force.max(), _ABOVE_NOISE * noise):
        return "the hammer hit twice"
    return ""


def _pulse_end(force: FloatArray) -> int:
    """Sample behind the peak from which on the force (n,) is below a small share of the peak."""
    peak = int(np.argmax(force))
    low = np.flatnonzero(force[peak:] < _PULSE_END * force[peak])
    return peak + int(low[0]) if len(low) else len(force)


def _windowed(
    block: FloatArray, before: int, rate: float, exponential_s: float | None, remarks: list[str], where: str
) -> FloatArray:
    """A block without offsets, its force cut off behind the pulse, and all of it under the exponential window."""
    block = block - block[:before].mean(axis=0)
    force = np.abs(block[:, -1])
    pulse = _pulse_end(force) - before
    kept = min(before + _KEPT_PULSES * pulse, len(block))
    taper = np.zeros(len(block))
    taper[:kept] = 1.0
    slope = min(_KEPT_PULSES * pulse, len(block) - kept)
    taper[kept : kept + slope] = 0.5 * (1 + np.cos(np.pi * (np.arange(slope) + 1) / (slope + 1)))
    block[:, -1] *= taper
    if exponential_s:
        time = (np.arange(len(block)) - before) / rate
        block *= np.exp(-time / exponential_s)[:, None]
    tenth = max(1, len(block) // 10)
    begin, end = (np.sqrt(np.mean(part**2, axis=0))[:-1] for part in (block[before : before + tenth], block[-tenth:]))
    noise = block[:before, :-1].std(axis=0)
    ringing = (end > _DECAYED * begin) & (end > _ABOVE_NOISE * noise)
    if ringing.any():
        share = float(np.max(end[ringing] / begin[ringing]))
        remarks.append(
            f"{where}: the response is still at {100 * share:.2g} % when its block ends, which blurs the resonances; "
            "take longer blocks, or an exponential window (exponential_s), which adds damping"
        )
    return block


# -- common -------------------------------------------------------------------------------------------------


def _densities(
    samples: FloatArray, rate: float, window: FloatArray, *, overlap: int, detrend: Literal["constant"] | bool
) -> tuple[FloatArray, FloatArray, FloatArray, ComplexArray]:
    """Frequencies (n_freq,), Gxx, Gyy and Gxy of responses (n, n_channels) and the force behind them."""
    options = {"fs": rate, "window": window, "nperseg": len(window), "noverlap": overlap, "detrend": detrend}
    force, responses = samples[:, -1], samples[:, :-1]
    frequency_hz, Gxx = welch(force, **options)
    _, Gyy = welch(responses, axis=0, **options)
    _, Gxy = csd(force[:, None], responses, axis=0, **options)
    return frequency_hz, Gxx, Gyy, np.asarray(Gxy, dtype=complex)


def _mean(
    parts: Sequence[tuple[FloatArray, FloatArray, FloatArray, ComplexArray]], weights: Sequence[int], averages: float
) -> _Spectra:
    """Densities of several records, each by the number of its blocks."""
    share = np.array(weights) / sum(weights)

    def mean(place: int) -> np.ndarray:
        return sum(w * part[place] for w, part in zip(share, parts, strict=True))  # type: ignore[return-value]

    return _Spectra(parts[0][0], mean(1), mean(2), mean(3), averages)


def estimate_response(
    Gxx: FloatArray, Gyy: FloatArray, Gxy: ComplexArray, estimator: Estimator
) -> tuple[ComplexArray, FloatArray]:
    """Response and coherence (n_freq, n_channels) from averaged densities.

    H1 = Gxy/Gxx is right where the responses are noisy, H2 = Gyy/Gyx where the force is; coherence |Gxy|^2/(Gxx Gyy)
    [bendat2010].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        H = Gxy / Gxx[:, None] if estimator == "h1" else Gyy / Gxy.conj()
        coherence = np.abs(Gxy) ** 2 / (Gxx[:, None] * Gyy)
    return H, np.minimum(coherence, 1.0)


def _reduction(record: Signals, spectra: _Spectra, plan: ReductionPlan, remarks: list[str]) -> Reduction:
    H, coherence = estimate_response(spectra.Gxx, spectra.Gyy, spectra.Gxy, plan.estimator)
    frequency = spectra.frequency_hz
    low, high = plan.band_Hz or (0.0, record.sample_rate_hz / _PASSED)
    used = (frequency > 0) & (frequency >= low) & (frequency <= high)
    used &= np.isfinite(H).all(axis=1) & (coherence > _INCOHERENT).all(axis=1)
    if not used.any():
        raise MeasurementError(f"band_Hz: no line of the spectra lies between {low:g} and {high:g} Hz; widen it")
    order = np.array([source.order for source in record.sources if source.channel])
    to_acceleration = (2j * np.pi * frequency[used, None]) ** (DERIVATIVE_ORDER["acceleration"] - order)
    # One of the averages goes into the response itself: the residual of n blocks has n - 1 degrees of freedom.
    std = error_of_coherence(H[used], coherence[used], spectra.averages - 1)
    run = Run(
        frequency_hz=frequency[used],
        H=H[used] * to_acceleration,
        channels=record.channels,
        support="bearing",
        std=std * np.abs(to_acceleration),
        force_amplitude_N=None,
    )
    return Reduction(run, spectra.averages, coherence[used], tuple(remarks))
