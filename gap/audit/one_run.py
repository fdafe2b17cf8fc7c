"""Checks of one run: raster, missing lines, noise, channels, saturation, ringing behind a peak."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.gap.audit.checked_run import CheckedRun, Severity
from rigtwin.gap.audit.geometry import Geometry
from rigtwin.gap.audit.noise import (
    GIVEN_ERRORS,
    NoiseEstimate,
    estimate_noise,
    mean_square,
    of_complex,
    responses,
    weigh_errors,
)
from rigtwin.gap.document import Finding
from rigtwin.gap.phrases import listed
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel, NominalBelief, Run
from rigtwin.sim.resonances import Resonance


@dataclass(frozen=True)
class RunLimits:
    """Thresholds of the findings about one run."""

    lines_in_band: int = 3  # of a half-power band: a mode has three unknowns at its peak (frequency, width, height)
    nearest: int = 9  # lines next to a frequency, whose spacing ...
    finer: float = 0.5  # ... is this share of the average or less, where lines are laid closer
    hole: float = 2.5  # a hole in the raster over the spacing that covers half of the band, and over both neighbours
    even_hole: float = 1.5  # the same in an even raster, where a single missing line shows
    # Estimated over given noise. The estimate is good to 10 % on 60 lines; a laboratory's is often wrong by 2 to 3.
    noise_ratio: float = 1.5
    noise_ratio_channel: float = 2.0  # the same of one channel beside the others
    # Given standard errors below this share of the response are mostly not noise (settling, rounding), and no verdict
    # depends on them.
    negligible_noise: float = 1e-4
    only_noise: float = 0.4  # scatter about a smooth curve, relative, from which a channel does not carry the rotor
    same_values: int = 3  # lines that may have one value in a channel that is alive
    rigid_share: float = 1e-2  # of the largest response: a sensor at a rigid support moves less
    weak_share: float = 1e-4  # of the largest response: below, a cable or a gain is wrong
    # A top is flat where the lines within 2 % of the maximum span this share of the half-power band; one mode's do over
    # 0.2 of it, one clipped at half its height over 0.65.
    flat_share: float = 0.4
    flat_depth: float = 0.02  # those 2 %
    flat_lines: int = 4  # fewer decide nothing
    flat_drop: float = 0.5  # of those 2 %: it falls less to its ends; two close modes make a wide top, too
    # A settled linear mode fits its lines to the noise; on healthy runs of the shipped rig the worst of 320 peaks is
    # off by 1.8 times.
    peak_misfit: float = 3.0
    peak_misfit_relative: float = 0.02  # of the response: what is less does not matter


_LIMITS = RunLimits()


def check_raster(p: CheckedRun, belief: NominalBelief) -> Iterator[Finding]:
    """Lines inside the half-power band of each resonance."""
    if not p.resonances:
        words = "No resonance stands out in this run, so nothing can be said of modes; widen the band."
        yield p.finding("raster", "note", words)
        return
    least = _LIMITS.lines_in_band
    resonances = [r for r in p.resonances if not any(r.line in beats for beats in p.beats.values())]
    widths = [p.half_power_hz(r, belief) for r in resonances]
    inside = [
        int(np.count_nonzero(np.abs(p.f - r.frequency_hz) <= w / 2)) if np.isfinite(w) else None
        for r, w in zip(resonances, widths, strict=True)
    ]
    even = np.ptp(np.diff(p.f)) < 0.02 * np.median(np.diff(p.f))
    for r, w, n in zip(resonances, widths, inside, strict=True):
        if n is None:
            words = f"The resonance near {r.frequency_hz:.4g} Hz is so narrow between its lines that its damping cannot"
            yield p.finding("raster", "warning", f"{words} be read; lay finer lines there or state the damping.")
        elif n < least:
            words = f"The half-power band at {r.frequency_hz:.4g} Hz is {w:.2g} Hz wide and holds {n} lines, so the"
            words += f" peak's height is erratic; lay lines at most {w / least:.2g} Hz apart there."
            severity = "note" if _is_refined(p.f, r.frequency_hz) else "warning"
            yield p.finding("raster", severity, words, float(n), float(least))
    known = [n for n in inside if n is not None]
    if len(known) == len(inside) and min(known) >= least:
        words = f"At least {min(known)} lines lie inside the half-power band of every resonance"
        kind = "even" if even else "uneven, which does no harm"
        yield p.finding("raster", "ok", f"{words}; the raster is {kind}.", float(min(known)), float(least))


def _is_refined(f: FloatArray, at: float) -> bool:
    """Whether lines are closer next to a frequency than elsewhere, so that few lines in a band mean missing ones."""
    near = np.sort(np.abs(f - at))[: _LIMITS.nearest]
    return bool(2 * near[-1] / len(near) < _LIMITS.finer * np.ptp(f) / len(f))


def check_missing_lines(p: CheckedRun) -> Iterator[Finding]:
    """Lines without a number, and holes in the raster."""
    n_bad = len(p.run.frequency_hz) - len(p.lines)
    if len(p.live) and n_bad:
        words = f"{n_bad} of {len(p.run.frequency_hz)} lines lack a number, or are exactly zero, in a channel that"
        words += " moves elsewhere; that is left out: repeat them."
        yield p.finding("missing_lines", "warning", words, float(n_bad), 0.0)
    holes = _holes(p)
    near = [h for h in holes if any(_touches(h, r) for r in p.resonances)]
    for lo, hi in holes[:5]:
        where = "; a resonance lies there and its peak may be lost" if (lo, hi) in near else ""
        words = f"No line lies between {lo:.5g} and {hi:.5g} Hz in a raster that is finer elsewhere{where}; fill it."
        yield p.finding("missing_lines", "warning" if where else "note", words, hi - lo)
    if not n_bad and not holes:
        yield p.finding("missing_lines", "ok", f"All {len(p.f)} lines are there, without a hole in the raster.", 0.0)


def _holes(p: CheckedRun) -> list[tuple[float, float]]:
    """(from, to) [Hz] where lines seem to be missing."""
    f = p.f
    if len(f) < 6:
        return []
    step = np.diff(f)
    order = np.sort(step)
    usual = order[np.searchsorted(np.cumsum(order), step.sum() / 2)]  # covers half of the band
    beside = np.maximum(np.append(step[1:], step[-2]), np.append(step[1], step[:-1]))
    # In an even raster a single missing line shows too.
    even = np.mean(np.abs(step / np.median(step) - 1) < 0.02) > 0.8
    limit = _LIMITS.even_hole if even else _LIMITS.hole
    return [(float(f[i]), float(f[i + 1])) for i in np.flatnonzero((step > limit * usual) & (step > limit * beside))]


def _touches(hole: tuple[float, float], r: Resonance) -> bool:
    margin = 5 * r.half_power_hz if np.isfinite(r.damping_ratio) else 0.0
    return hole[0] - margin <= r.frequency_hz <= hole[1] + margin


def check_noise(p: CheckedRun) -> Iterator[Finding]:
    """Noise from the data, and the given standard errors beside it."""
    relative = p.noise.relative[p.live]
    if not np.isfinite(relative).any():
        words = f"{len(p.f)} clean lines are too few to estimate the noise; measure more lines."
        yield p.finding("noise", "note", words)
        return
    level = float(np.nanmedian(relative))
    if p.run.std is None:
        taken = "which is taken as the noise." if p.noise.resolved else "which is more than the noise: lay them closer."
        words = f"No standard errors are given; the lines scatter by {100 * level:.2g} % (median over channels)"
        yield p.finding("noise", "note", f"{words}, {taken}", level)
    elif not p.noise.resolved:
        words = "Lines lie too far apart to tell the noise; the given standard errors are believed as they are."
        yield p.finding("noise", "note", words)
    else:
        yield from _given_errors(p, p.run.std[np.ix_(p.lines, p.live)], level)


def _given_errors(p: CheckedRun, given: np.ndarray, level: float) -> Iterator[Finding]:
    """Standard errors beside the lines' own scatter.

    Parameters
    ----------
    given : (n_lines, n_live) standard errors of the lines and channels that count
    level : relative scatter of the lines
    """
    if not np.isfinite(given).all() or (given < 0).any():
        words = "Some given standard errors are no number or negative and cannot be used; correct them."
        yield p.finding("noise", "warning", words)
    ratio, relative = _noise_ratios(p, given), given / np.abs(p.H)
    believed = float(np.nanmedian(relative)) if np.isfinite(relative).any() else 0.0
    if max(level, believed) < _LIMITS.negligible_noise:
        words = f"Noise is negligible: lines scatter by {100 * level:.1g} %."
        yield p.finding("noise", "ok", words, level, _LIMITS.negligible_noise)
    elif not np.isfinite(ratio).any():
        words = f"The given standard errors are zero but the lines scatter by {100 * level:.2g} %; use the estimate."
        yield p.finding("noise", "warning", words, level)
    else:
        yield from _errors_against_scatter(p, ratio)
        yield from _uneven_errors(p, given)
        yield from _odd_channels(p, ratio)


def _uncertainty_factor(p: CheckedRun) -> float:
    """Factor on limits for runs with few lines: these lie far apart, and two resonances in a window look like noise."""
    return 1 + 6 * p.noise.uncertainty


def _errors_against_scatter(p: CheckedRun, ratio: np.ndarray) -> Iterator[Finding]:
    """Whether the lines scatter as the standard errors say."""
    overall, limit = float(np.nanmedian(ratio)), max(_LIMITS.noise_ratio, _uncertainty_factor(p))
    words = f"The lines scatter {overall:.2g} times as much as the given standard errors say"
    if 1 / limit < overall < limit:
        yield p.finding("noise", "ok", f"{words}.", overall, limit)
        return
    wrong = (
        "too small, so that noise would pass for a gap"
        if overall > 1
        else "too large, or hold more than line-to-line noise, so that a gap could hide"
    )
    yield p.finding("noise", "warning", f"{words}: those are {wrong}; check them.", overall, limit)


def _odd_channels(p: CheckedRun, ratio: np.ndarray) -> Iterator[Finding]:
    """Sensors that scatter otherwise than the rest."""
    overall, limit = float(np.nanmedian(ratio)), max(_LIMITS.noise_ratio_channel, _uncertainty_factor(p) ** 1.5)
    for i in np.flatnonzero((ratio > limit * overall) | (ratio < overall / limit)):
        words = f"Channel {p.channels[i]} scatters {ratio[i]:.2g} times as much as its standard errors say, other"
        words += f" channels {overall:.2g} times; check this sensor."
        yield p.finding("noise", "warning", words, float(ratio[i]), limit)


def _uneven_errors(p: CheckedRun, given: np.ndarray) -> Iterator[Finding]:
    """Standard errors that are right on the whole and wrong at single values."""
    weighed = weigh_errors(given, of_complex(p.noise.std[np.ix_(p.lines, p.live)], p.run), p.H)
    rough, share = weighed.roughness, weighed.share
    if weighed.rough:
        words = f"The given standard errors themselves scatter by {100 * rough:.2g} % from line to line, as those from"
        words += (
            " few repeats do; the scatter of the lines is taken instead. Average the errors over neighbouring lines."
        )
        severity = "warning" if rough > 2 * GIVEN_ERRORS.rough else "note"  # little is lost with the scatter instead
        yield p.finding("noise", severity, words, rough, GIVEN_ERRORS.rough)
    elif weighed.uneven:
        words = f"{100 * share:.2g} % of the values scatter over {GIVEN_ERRORS.contradicted:g} times as much as their"
        words += " errors say; their scatter is taken instead. Give every line an error of its own."
        yield p.finding("noise", "warning", words, share, GIVEN_ERRORS.contradicted_share)


def _noise_ratios(p: CheckedRun, given: np.ndarray) -> np.ndarray:
    """(n_live,) estimated over given noise; nan where a channel's standard errors are zero or no number."""
    draws = of_complex(p.noise.draws[np.ix_(p.lines, p.live)], p.run)
    usable = np.isfinite(given) & (given > 0)
    squares = np.where(usable, (draws / np.where(usable, given, 1.0)) ** 2, np.nan)
    return np.sqrt([mean_square(s, magnitude=p.run.magnitude_only) for s in squares.T])


def check_channels(p: CheckedRun, geometry: Geometry) -> Iterator[Finding]:
    """Channels that are dead, constant, noise only, or move where they should not."""
    run, healthy = p.run, True
    size = np.abs(np.nan_to_num(responses(run)))
    usual = np.median(size[:, p.live], axis=0).max() if len(p.live) else 0.0
    for i, channel in enumerate(run.channels):
        problem = _channel_problem(p, i, _stands_still(run, channel, geometry), float(usual))
        if problem is not None:
            healthy = healthy and problem[0] == "ok"
            yield p.finding("channels", *problem)
    if healthy:
        words = f"Every one of the {len(run.channels)} channels carries a plausible response."
        yield p.finding("channels", "ok", words)


def without_dead_channels(run: Run, telling: Sequence[int]) -> Run:
    """A run with its telling channels only; unchanged where it would lose every channel."""
    return run.with_channels(telling) if 0 < len(telling) < len(run.channels) else run


def is_dead(run: Run, telling: Sequence[int], geometry: Geometry) -> bool:
    """Whether every channel says nothing of those that have to move."""
    moving = {i for i, channel in enumerate(run.channels) if not _stands_still(run, channel, geometry)}
    return bool(moving) and not moving & set(telling)


def telling_channels(run: Run, geometry: Geometry) -> list[int]:
    """Places of the channels that carry a response: finite, not constant, not mere noise, zero only at a held node."""
    H, noise = responses(run), estimate_noise(run)
    still = [bool(_stands_still(run, channel, geometry)) for channel in run.channels]
    alive = [i for i in range(len(still)) if _is_alive(H[:, i], still[i])]
    return [i for i in alive if still[i] or not is_only_noise(noise, i)] or alive


def is_only_noise(noise: NoiseEstimate, channel: int) -> bool:
    """Whether the lines of a channel follow no curve; lines too far apart do not say."""
    return noise.resolved and bool(noise.relative[channel] > _LIMITS.only_noise)


def _stands_still(run: Run, channel: Channel, geometry: Geometry) -> str:
    """Why a channel may read nothing; empty where the shaft moves."""
    if channel.plane != run.excitation_plane:
        return "a round rotor is across the force"
    return "" if channel.node in geometry.moving_nodes(run) else "it must be where the shaft is held"


def _is_alive(H: ComplexArray, may_be_zero: bool) -> bool:
    there = H[np.isfinite(H)]
    if not there.any():
        return len(there) > 0 and may_be_zero
    return len(there) <= _LIMITS.same_values or not (there == there[0]).all()


_Problem = tuple[Severity, str, float | None, float | None]  # severity, words, value, limit


def _channel_problem(p: CheckedRun, i: int, still: str, usual: float) -> _Problem | None:
    """The problem with one channel, or None; ``usual`` is the size of the largest channel."""
    H, name = responses(p.run)[:, i], p.run.channels[i]
    size = np.abs(H[np.isfinite(H)])
    if not size.any() or not _is_alive(H, bool(still)):
        return _dead_channel(f"Channel {name}", size, still)
    if name.plane != p.run.excitation_plane:
        return None
    share, relative = float(np.median(size)) / usual if usual else 1.0, float(p.noise.relative[i])
    if still:
        if not share > _LIMITS.rigid_share or relative > _LIMITS.only_noise:
            return None
        words = f"Channel {name} sits at a rigid support but moves by {100 * share:.2g} % of the largest channel: "
        words += "the support gives way or the sensor sees something else."
        return "note", words, share, _LIMITS.rigid_share
    if is_only_noise(p.noise, i):
        words = f"Channel {name} scatters by {100 * relative:.2g} % from line to line: it carries noise, not the rotor"
        words += ", and is left out where there are others; raise the force."
        return "warning", words, relative, _LIMITS.only_noise
    if share < _LIMITS.weak_share:
        words = f"Channel {name} is {share:.1g} of the largest channel, as if its cable or gain were wrong"
        return "warning", f"{words}; check it.", share, _LIMITS.weak_share
    return None


def _dead_channel(name: str, size: FloatArray, still: str) -> _Problem:
    """The problem with a channel without a response; ``still`` is the reason why it may have none, or empty."""
    if not len(size):
        return "error", f"{name} holds no number at all; leave it out or measure it again.", 0.0, None
    if size.any():
        return "error", f"{name} has the same value at every line: a dead channel; check the sensor.", 0.0, None
    if still:
        return "ok", f"{name} is zero, as {still}.", 0.0, None
    return "error", f"{name} is zero at every line: a dead channel; leave it out or check the sensor.", 0.0, None


def check_saturation(p: CheckedRun) -> Iterator[Finding]:
    """Flat tops of peaks, and values that repeat exactly."""
    found = False
    for r in p.resonances:
        flat = [c for c in range(len(p.live)) if _is_flat(p, r, c)]
        if flat:
            found = True
            who = "all channels" if len(flat) == len(p.live) else f"channel {listed(p.channels[c] for c in flat)}"
            cause = "a stop or a weak exciter" if len(flat) == len(p.live) else "a clipped sensor or amplifier"
            words = f"The peak at {r.frequency_hz:.4g} Hz has a flat top in {who}: {cause}; lower the force or change "
            words += "the range."
            yield p.finding("saturation", "warning", words, float(len(flat)), 0.0)
    stuck = _stuck_lines(p)
    if stuck:
        found = True
        words = f"{stuck} lines repeat the line before to the last digit: the acquisition was stuck or lines were "
        words += "filled in; measure them again."
        yield p.finding("saturation", "warning", words, float(stuck), 0.0)
    if not found and p.resonances:
        yield p.finding("saturation", "ok", "No peak has a flat top, and no values repeat.", 0.0)


def _is_flat(p: CheckedRun, r: Resonance, c: int) -> bool:
    """Whether the lines next to a channel's maximum lie on a plateau instead of a peak."""
    size = np.abs(p.H[:, c])
    depth = _LIMITS.flat_depth + 2 * p.std[:, c] / np.maximum(size, np.finfo(float).tiny)
    width = r.half_power_hz if np.isfinite(r.damping_ratio) else 0.0
    near = np.flatnonzero(np.abs(p.f - p.f[r.line]) <= max(2 * width, _spread(p.f, r.line, 3)))
    top = near[np.argmax(size[near])]
    depth = float(np.median(np.minimum(depth[near], 0.1)))
    lines = _run_of(size >= size[top] * (1 - depth), top)
    plateau, half = (_width(p.f, size, top, float(size[top] * share)) for share in (1 - depth, np.sqrt(0.5)))
    wide = bool(plateau / half > max(_LIMITS.flat_share, 1.5 * np.sqrt(2 * depth)))
    return len(lines) >= _LIMITS.flat_lines and wide and abs(_drop(p.f[lines], size[lines])) < _LIMITS.flat_drop * depth


def _drop(f: np.ndarray, size: np.ndarray) -> float:
    """Relative fall of a parabola through a top from its middle to its ends; negative where it has a dip."""
    x = (f - (f[0] + f[-1]) / 2) / ((f[-1] - f[0]) / 2)
    return -float(np.polyfit(x, np.log(size), 2)[0])


def _width(f: np.ndarray, size: np.ndarray, top: int, level: float) -> float:
    """Width of a peak at a level, straight lines between the lines [Hz]; nan where a side is not in the band."""
    inside = _run_of(size >= level, top)
    if inside[0] == 0 or inside[-1] == len(size) - 1:
        return float("nan")
    edges = [(inside[0], inside[0] - 1), (inside[-1], inside[-1] + 1)]
    lo, hi = (f[i] + (f[o] - f[i]) * (size[i] - level) / (size[i] - size[o]) for i, o in edges)
    return float(hi - lo)


def _spread(f: np.ndarray, line: int, lines: int) -> float:
    """Distance to the line so many lines away [Hz]."""
    return float(max(f[min(line + lines, len(f) - 1)] - f[line], f[line] - f[max(line - lines, 0)]))


def _run_of(mask: np.ndarray, place: int) -> np.ndarray:
    """Indices of the unbroken run of true entries around a place."""
    breaks = np.flatnonzero(~mask)
    lo = breaks[breaks < place][-1] + 1 if (breaks < place).any() else 0
    hi = breaks[breaks > place][0] if (breaks > place).any() else len(mask)
    return np.arange(lo, hi)


def _stuck_lines(p: CheckedRun) -> int:
    """Lines that equal the one before in every live channel; magnitudes only where three are alike, for few digits."""
    if len(p.f) < 4 or not len(p.live):
        return 0
    same = (p.H[1:] == p.H[:-1]).all(axis=1)
    if p.run.magnitude_only or len(p.live) == 1:
        same = same[1:] & same[:-1]
    return int(np.count_nonzero(same))


def check_sweep_rate(p: CheckedRun) -> Iterator[Finding]:
    """Peaks that no settled linear mode has: with beats behind them, or with a shape that is not one pole's."""
    beating = p.beats
    for leader, followers in beating.items():
        side = "above" if p.f[followers[0]] > p.f[leader] else "below"
        words = f"{len(followers)} lesser peaks follow {side} the one at {p.f[leader]:.4g} Hz, as when the rotor still "
        words += "rings: the peak is low, late and too broad; wait longer at each line."
        yield p.finding("sweep_rate", "warning", words, float(len(followers)), 0.0)
    judged = [r for r in p.resonances if np.isfinite(r.misfit) and r.line not in beating]
    odd = [r for r in judged if r.misfit > _LIMITS.peak_misfit and r.misfit_relative > _LIMITS.peak_misfit_relative]
    for r in odd:
        yield p.finding("sweep_rate", "note", _peak_shape(p, r), r.misfit, _LIMITS.peak_misfit)
    if judged and not odd and not beating:
        worst = max(r.misfit for r in judged)
        words = f"Every peak has the shape of one settled mode, to {worst:.2g} times the noise at worst"
        yield p.finding("sweep_rate", "ok", f"{words}.", worst, _LIMITS.peak_misfit)


def _peak_shape(p: CheckedRun, r: Resonance) -> str:
    """What a peak that is not one pole's may come from."""
    behind = {"up": r.misfit_above, "down": 1 - r.misfit_above}.get(p.run.sweep or "", 0.0)
    cause = "a fast sweep, a dependence on amplitude, a close pair or a roving sensor's mass"
    cause = "ringing of a fast sweep" if behind > 0.7 else cause
    words = f"The peak at {r.frequency_hz:.4g} Hz is {r.misfit:.2g} times the noise off the shape of one settled mode"
    words += f" ({cause}), so its damping of {100 * r.damping_ratio:.2g} % is apparent"
    return f"{words}; repeat it slower and weaker."
