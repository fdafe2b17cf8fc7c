"""Checks of one run against another: reciprocity, repeatability, force level, direction of sweep."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.noise import mean_square
from rigtwin.gap.document import Finding
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import USUAL_DRIFT, Channel, NominalBelief, Run
from rigtwin.sim.resonances import Resonance


@dataclass(frozen=True)
class PairLimits:
    """Thresholds of the findings about two runs, and what makes them comparable."""

    gain_stds: float = 4.0  # standard deviations beyond which a gain has changed
    drift_stds: float = 4.0  # standard deviations beyond which a resonance has changed
    scatter_ratio: float = 2.0  # scatter of a comparison over what noise and drift explain
    scatter_floor: float = 0.01  # relative scatter that is too small to matter
    damping_change: float = 0.10  # relative change of a damping ratio that is worth a word
    fewest_movements: int = 3  # of resonances between repeated runs, from which their drift is learned
    common_lines: int = 8  # lines that two runs must share
    same_line: float = 1e-6  # relative difference of frequencies that are the same line's
    same_resonance: float = 0.05  # relative difference of frequencies within which two resonances may be the same
    clear_of_peaks: float = 2.0  # half-power widths from a resonance: nearer lines are not compared
    largest_error: float = 0.2  # relative standard error of a ratio: less certain values are not compared


_LIMITS = PairLimits()


@dataclass(frozen=True)
class Comparison:
    """ln(A / B) of paired channels over the shared lines away from resonances."""

    gain: float  # relative: |A / B| - 1, median
    odd_gain: float  # the same of the pair that is farthest from the median, over the median
    odd: Channel  # its channel of a
    phase: float  # [rad] median
    scatter: float  # rms of what is left, relative
    expected: float  # rms that noise and drift give
    lines: int

    @property
    def gain_error(self) -> float:
        """Standard error of the gain: of a median of so many lines."""
        return 1.25 * self.expected / np.sqrt(self.lines)

    @property
    def ratio(self) -> float:
        """Scatter over what is expected."""
        return self.scatter / self.expected

    @property
    def is_odd(self) -> bool:
        """Whether the runs differ by more than noise and drift explain, and by enough to matter."""
        return self.ratio > _LIMITS.scatter_ratio and self.scatter > _LIMITS.scatter_floor


def compare(a: CheckedRun, b: CheckedRun, paired: Sequence[tuple[Channel, Channel]], drift: float) -> Comparison | None:
    """Compare channels of two runs; None where they share too few lines.

    Parameters
    ----------
    paired : (channel of a, channel of b), live in both
    drift : relative standard deviation of a resonance from run to run
    """
    rows = _shared_lines(a.f, b.f)
    if len(rows[0]) < _LIMITS.common_lines or not paired:
        return None
    cols = [a.channels.index(x) for x, _ in paired], [b.channels.index(y) for _, y in paired]
    sigma = _ratio_errors(a, b, rows, cols, drift)
    far = a.away(_LIMITS.clear_of_peaks)[rows[0]] & b.away(_LIMITS.clear_of_peaks)[rows[1]]
    L: Any = _log_ratio(a.H[:, cols[0]][rows[0]], b.H[:, cols[1]][rows[1]])
    use = far[:, None] & np.isfinite(L) & (sigma < _LIMITS.largest_error)
    if np.count_nonzero(use) < _LIMITS.common_lines:
        return None
    L = np.where(use, L, complex(np.nan, np.nan))
    known = np.flatnonzero(np.isfinite(L.real).sum(axis=0) >= 3)
    gains = np.array([np.nanmedian(L[:, c].real) for c in known])  # (n_known,)
    if not len(known):
        return None
    gain, phase = float(np.median(gains)), _median_angle(L.imag)
    odd = int(np.argmax(np.abs(gains - gain)))
    turned = _wrap(L[:, known].imag - phase)  # an inverted sensor lies at both ends of a circle
    z = np.hypot(L[:, known].real - gains, turned)
    magnitude = a.run.magnitude_only or b.run.magnitude_only
    relative = np.sqrt(mean_square((z / sigma[:, known]).ravel() ** 2, magnitude=magnitude))
    typical = float(np.sqrt(np.mean(sigma[use] ** 2)))
    return Comparison(
        gain=float(np.expm1(gain)),
        odd_gain=float(np.expm1(gains[odd] - gain)),
        odd=paired[known[odd]][0],
        phase=phase,
        scatter=float(relative) * typical,
        expected=typical,
        lines=int(np.count_nonzero(far)),
    )


def _ratio_errors(
    a: CheckedRun, b: CheckedRun, rows: tuple[np.ndarray, np.ndarray], cols: tuple[list[int], list[int]], drift: float
) -> FloatArray:
    """(n_rows, n_pairs) relative standard error of A / B by noise and by drift of the resonances."""
    A, B = a.H[:, cols[0]], b.H[:, cols[1]]
    with np.errstate(divide="ignore", invalid="ignore"):  # a dropped line has no slope, and takes no part
        slope = np.abs(np.gradient(A, a.f, axis=0) / A) * a.f[:, None]  # not of log A, whose phase is wrapped
    noise = np.hypot((a.std[:, cols[0]] / np.abs(A))[rows[0]], (b.std[:, cols[1]] / np.abs(B))[rows[1]])
    return np.hypot(noise, np.sqrt(2) * drift * slope[rows[0]])


def _median_angle(angles: np.ndarray) -> float:
    """The median of angles [rad] about their mean direction; nan where there is none."""
    mean = np.angle(np.nansum(np.exp(1j * angles)))
    return float(_wrap(mean + np.nanmedian(_wrap(angles - mean))))


def _wrap(angles: Any) -> Any:
    """The same angles between -pi and pi [rad]."""
    return np.angle(np.exp(1j * angles))


def _log_ratio(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Complex ln(A / B); where one has magnitudes only, of the magnitudes."""
    if np.iscomplexobj(A) and np.iscomplexobj(B):
        return np.log(A / B)
    return np.log(np.abs(A) / np.abs(B)) + 0j


def _shared_lines(f: FloatArray, g: FloatArray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of lines that two rasters have in common."""
    if not len(f) or not len(g):
        return np.array([], dtype=int), np.array([], dtype=int)
    near = np.clip(np.searchsorted(g, f), 1, max(len(g) - 1, 1))
    near = np.where(np.abs(g[np.minimum(near, len(g) - 1)] - f) < np.abs(g[near - 1] - f), near, near - 1)
    near = np.clip(near, 0, len(g) - 1)
    same = np.abs(g[near] - f) <= _LIMITS.same_line * f
    return np.flatnonzero(same), near[same]


def _match_resonances(a: CheckedRun, b: CheckedRun) -> Iterator[tuple[Resonance, Resonance]]:
    """Resonances of both runs, each with the nearest of the other."""
    for r in a.resonances:
        near = [q for q in b.resonances if abs(q.frequency_hz / r.frequency_hz - 1) < _LIMITS.same_resonance]
        if near:
            yield r, min(near, key=lambda q: abs(q.frequency_hz - r.frequency_hz))


def _shared_channels(a: CheckedRun, b: CheckedRun) -> list[tuple[Channel, Channel]]:
    return [(c, c) for c in a.channels if c in b.channels]


def _reason_not_compared(a: CheckedRun, b: CheckedRun) -> str:
    """Why two runs cannot be compared."""
    if not _shared_channels(a, b):
        return "no channel: they are not compared"
    return "too few lines to be compared; use the same lines"


def _settings(run: Run) -> tuple:
    """What must agree for two runs to be the same test, the level and the direction apart."""
    return run.support, run.excitation_node, run.excitation_plane, run.spin_rpm, run.quantity


def is_copy(a: Run, b: Run) -> bool:
    """Whether two runs of one test hold the same values to the last digit."""
    test, other = ((*_settings(run), run.force_amplitude_N, run.sweep, run.channels) for run in (a, b))
    same_lines = np.array_equal(a.frequency_hz, b.frequency_hz)
    return test == other and same_lines and np.array_equal(a.H, b.H, equal_nan=True)


def check_pairs(runs: Sequence[CheckedRun], belief: NominalBelief) -> Iterator[Finding]:
    """Every comparison that the campaign allows."""
    tests = _tests(runs)
    repeats = [pair for levels in tests for same in levels.values() for pair in pairwise(same)]
    drift = _drift_shown(repeats) if belief.frequency_drift is None else belief.frequency_drift
    yield from _check_reciprocity(runs, belief, drift)
    for a, b in repeats:
        yield _repeatability(a, b, belief, drift)
    for levels in tests:
        if len(levels) > 1:
            yield from _level_findings([levels[key][0] for key in sorted(levels)], drift)
    if runs and not repeats:
        words = "No run was repeated, so drift and repeatability are not known; repeat one run after a rest."
        yield Finding("repeatability", "note", words)


def _tests(runs: Sequence[CheckedRun]) -> list[dict[float, list[CheckedRun]]]:
    """Runs of the same test, by their force level; those whose level is not known take no part."""
    tests: dict[tuple, dict[float, list[CheckedRun]]] = defaultdict(lambda: defaultdict(list))
    for p in runs:
        if p.run.force_amplitude_N is not None:
            tests[_settings(p.run)][p.run.force_amplitude_N].append(p)
    return list(tests.values())


def _drift_shown(repeats: Sequence[tuple[CheckedRun, CheckedRun]]) -> float:
    """Relative drift of a resonance that most resonances of repeated runs show, and its standard error on top.

    At least the usual drift, from which the diagnosis learns as well: few movements may be small by chance. One
    resonance that moves more than most others has not drifted.
    """
    true_repeats = [(a, b) for a, b in repeats if a.run.sweep == b.run.sweep and not is_copy(a.run, b.run)]
    shifts = [abs(m.shift) for a, b in true_repeats for m in _movements(a, b, 0.0)]
    if len(shifts) < _LIMITS.fewest_movements:
        return USUAL_DRIFT
    shown = 1.4826 * float(np.median(shifts)) / np.sqrt(2)  # of one run; the difference of two scatters more
    return max(USUAL_DRIFT, shown * (1 + 1.17 / np.sqrt(len(shifts))))


# -- same settings -----------------------------------------------------------------------------------


def _repeatability(a: CheckedRun, b: CheckedRun, belief: NominalBelief, drift: float) -> Finding:
    """One sentence on two runs of one test."""
    both = f"{a.label}, {b.label}"
    if is_copy(a.run, b.run):
        words = "These runs hold the same values to the last digit: one measurement is used once"
        return Finding("repeatability", "warning", f"{words}; remove one of them, or look for the other's file.", both)
    directions = {a.run.sweep, b.run.sweep} == {"up", "down"}
    check = "sweep_direction" if directions else "repeatability"
    found = compare(a, b, _shared_channels(a, b), drift)
    moved = [m for m in _movements(a, b, drift) if m.significant]
    cause = "a jump or a rotor that had not settled" if directions else "something changed between them"
    if moved:
        m = max(moved, key=lambda m: abs(m.value_and_limit[0]) / max(m.value_and_limit[1], 1e-12))
        words = f"{m.words} between two runs of one test: {cause}; find out before trusting either."
        return Finding(check, "warning", words, both, *m.value_and_limit)
    if found is None:
        return Finding(check, "note", f"Two runs of one test share {_reason_not_compared(a, b)}.", both)
    limit = _LIMITS.gain_stds * np.hypot(np.sqrt(2) * belief.gain_tolerance, found.gain_error)
    if abs(found.gain) > limit:
        words = f"Two runs of one test differ by {100 * found.gain:.2g} % in gain: the force or its sensor changed"
        return Finding(check, "warning", f"{words}; check the force channel.", both, found.gain, limit)
    if abs(found.odd_gain) > limit / 2:  # a sensor's gain is half as uncertain as the force's
        words = f"Channel {found.odd} changed by {100 * found.odd_gain:.2g} % in gain between two runs of one test"
        return Finding(check, "warning", f"{words}; check this sensor.", both, found.odd_gain, limit / 2)
    if found.is_odd:
        words = f"Two runs of one test differ by {100 * found.scatter:.2g} %"
        words += f", {found.ratio:.2g} times what noise and drift explain"
        words = f"{words}: {cause}; find out before trusting either."
        return Finding(check, "warning", words, both, found.ratio, _LIMITS.scatter_ratio)
    words = f"Two runs of one test agree to {100 * found.scatter:.2g} % and {100 * found.gain:.2g} % in gain"
    words += ", as noise explains" if drift <= USUAL_DRIFT else f", as noise and drifts of {100 * drift:.2g} % explain"
    return Finding(check, "ok", f"{words}.", both, found.ratio, _LIMITS.scatter_ratio)


@dataclass(frozen=True)
class _Movement:
    """A resonance in two runs."""

    frequency_hz: float
    shift: float  # relative change of frequency from a to b
    shift_limit: float
    damping: tuple[float, float]  # damping ratio in a and in b
    damping_limit: float  # of the relative change

    @property
    def shifted(self) -> bool:
        return abs(self.shift) > max(self.shift_limit, 1e-9)  # of a frequency that is exact

    @property
    def widened(self) -> float:
        """Relative change of the damping ratio."""
        return self.damping[1] / self.damping[0] - 1

    @property
    def significant(self) -> bool:
        return self.shifted or abs(self.widened) > self.damping_limit

    @property
    def value_and_limit(self) -> tuple[float, float]:
        """What has changed, the frequency first."""
        return (self.shift, self.shift_limit) if self.shifted else (self.widened, self.damping_limit)

    @property
    def words(self) -> str:
        """What the resonance does."""
        moves = f"The resonance at {self.frequency_hz:.4g} Hz moves by {100 * self.shift:+.2g} %"
        if not np.isfinite(self.damping).all():
            return moves
        low, high = (f"{100 * d:.3g}" for d in self.damping)
        return f"{moves} and its damping ratio from {low} to {high} %"


def _movements(a: CheckedRun, b: CheckedRun, drift: float) -> Iterator[_Movement]:
    """What each resonance does from one run to the other."""
    for r, q in _match_resonances(a, b):
        error = float(np.hypot(r.frequency_std_hz, q.frequency_std_hz)) / r.frequency_hz
        damping_error = float(np.hypot(r.damping_std, q.damping_std)) / r.damping_ratio
        yield _Movement(
            r.frequency_hz,
            q.frequency_hz / r.frequency_hz - 1,
            _LIMITS.drift_stds * float(np.hypot(error, np.sqrt(2) * drift)),
            (r.damping_ratio, q.damping_ratio),
            max(_LIMITS.drift_stds * damping_error, _LIMITS.damping_change) if np.isfinite(damping_error) else np.inf,
        )


def _force(p: CheckedRun) -> float:
    """What responses have to be divided by to be per newton."""
    return (p.run.force_amplitude_N or 1.0) if p.run.quantity == "acceleration" else 1.0


# -- levels ------------------------------------------------------------------------------------------


def _level_findings(levels: Sequence[CheckedRun], drift: float) -> Iterator[Finding]:
    """Runs of one test at rising force: is the rotor the same at each?"""
    low, high = levels[0], levels[-1]
    both = ", ".join(p.label for p in levels)
    forces = [p.run.force_amplitude_N or 0.0 for p in levels]
    span = f"from {forces[0]:g} to {forces[-1]:g} N"
    index = _homogeneity(low, high)
    amplitude_dependent = False
    for m in _movements(low, high, drift):
        if m.significant:
            amplitude_dependent = True
            words = f"{m.words} {span}: the rig depends on amplitude; look for a nonlinear cause."
            yield Finding("level", "note", words, both, *m.value_and_limit)
    for frequency, way in _find_lost_resonances(low, high):
        amplitude_dependent = True
        words = f"The resonance at {frequency:.4g} Hz and {forces[0]:g} N is gone at {forces[-1]:g} N, where "
        words += f"the nearest is {abs(way):.0%} {'above' if way > 0 else 'below'} it" if way else "there is none"
        words += ": the rig depends on amplitude; look for a nonlinear cause."
        yield Finding("level", "note", words, both, way or -1.0, _LIMITS.same_resonance)
    found = compare(high, low, _shared_channels(high, low), drift)
    if found is None:
        if not amplitude_dependent:
            yield Finding("level", "note", f"Runs {span} share {_reason_not_compared(high, low)}.", both)
        return
    if found.is_odd:
        words = f"Away from resonances the responses {span} differ by {100 * found.scatter:.2g} %"
        words += f", {found.ratio:.2g} times what noise and drift explain"
        words += ": the rig depends on amplitude."
        yield Finding("level", "note", words, both, found.ratio, _LIMITS.scatter_ratio)
    elif not amplitude_dependent:
        words = f"The responses {span} agree: homogeneity index {100 * index:.2g} % where noise and drift explain"
        words += f" {100 * found.expected:.2g} %."
        yield Finding("level", "ok", words, both, found.ratio, _LIMITS.scatter_ratio)


def _find_lost_resonances(low: CheckedRun, high: CheckedRun) -> Iterator[tuple[float, float]]:
    """Clear resonances that are missing at the higher force, although lines were measured there.

    Yields the frequency [Hz] and the relative distance to the nearest resonance, 0 where there is none.
    """
    if not _shared_channels(low, high):
        return
    kept = {r.line for r, _ in _match_resonances(low, high)}
    for r in low.resonances:
        beside = high.f / r.frequency_hz - 1
        near = [np.any((side > 0) & (side < _LIMITS.same_resonance)) for side in (beside, -beside)]
        if r.line in kept or not np.isfinite(r.damping_ratio) or not all(near):
            continue
        ways = [q.frequency_hz / r.frequency_hz - 1 for q in high.resonances]
        yield r.frequency_hz, min(ways, key=abs, default=0.0)


def _homogeneity(low: CheckedRun, high: CheckedRun) -> float:
    """Median |H(F2) - H(F1)| / |H(F1)| over shared lines and channels; nan where there are none."""
    rows, channels = _shared_lines(low.f, high.f), _shared_channels(low, high)
    if not len(rows[0]) or not channels:
        return float("nan")
    cols = [[p.channels.index(c) for c, _ in channels] for p in (low, high)]
    A, B = (p.H[r][:, c] / _force(p) for p, r, c in zip((low, high), rows, cols, strict=True))
    return float(np.median(np.abs(B - A) / np.maximum(np.abs(A), np.finfo(float).tiny)))


# -- reciprocity -------------------------------------------------------------------------------------


def _check_reciprocity(runs: Sequence[CheckedRun], belief: NominalBelief, drift: float) -> Iterator[Finding]:
    """Runs with exchanged exciter and sensor on one support, at standstill."""
    gains = belief.gain_tolerance * np.sqrt(2 + 2 * 0.25)  # two of the force, two of sensors, these half as uncertain
    for a, b in combinations(runs, 2):
        at_a = Channel(a.run.excitation_node, a.run.excitation_plane)
        at_b = Channel(b.run.excitation_node, b.run.excitation_plane)
        comparable = (
            a.run.support == b.run.support and a.run.quantity == b.run.quantity and a.run.quantity != "acceleration"
        )
        if at_a == at_b or not comparable or a.run.spin_rpm or b.run.spin_rpm:
            continue
        if at_b not in a.channels or at_a not in b.channels:
            continue
        found = compare(a, b, [(at_b, at_a)], drift)
        if found is None:
            continue
        both, who = f"{a.label}, {b.label}", f"{at_a} and {at_b}"
        limit = _LIMITS.gain_stds * np.hypot(gains, found.gain_error)
        change = f"Exchanging exciter and sensor between {who} changes the response by"
        gain, scatter = f"{100 * found.gain:.2g} % in gain", f"{100 * found.scatter:.2g} %"
        if abs(found.phase) > np.pi / 2:
            words = f"Exchanging exciter and sensor between {who} changes the sign: one sensor is inverted"
            yield Finding("reciprocity", "error", f"{words}; check polarities.", both, found.phase, np.pi / 2)
        elif abs(found.gain) > limit:
            words = f"{change} {gain}: a sensor's or the force's sensitivity is wrong; calibrate them."
            yield Finding("reciprocity", "warning", words, both, found.gain, limit)
        elif found.is_odd:
            words = (
                f"{change} {scatter}, {found.ratio:.2g} times what noise explains: a sensor is beside its node, or the"
            )
            words += " rig is not linear; check positions."
            yield Finding("reciprocity", "warning", words, both, found.ratio, _LIMITS.scatter_ratio)
        else:
            words = f"{change} {scatter} and {gain}, as noise and gains explain."
            yield Finding("reciprocity", "ok", words, both, found.gain, limit)
