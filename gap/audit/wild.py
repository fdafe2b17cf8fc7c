"""Wild lines: single ones that nothing near them explains, as where a controller slipped or an amplifier clipped once.

The line that lies farthest from its neighbours' smooth curve is left out, and the rest is looked at again. Lines are
called wild only if this ends after a few lines that lie apart. Ringing, jumps and peaks between two lines stay as they
are: there the remaining lines keep missing their curves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.noise import estimate_noise, responses
from rigtwin.gap.document import Finding
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class WildLimits:
    """From where on a line is wild."""

    errors: float = 12.0  # standard errors from which a line is wild, ...
    plain: float = 0.03  # ... and error over its own and its neighbours' size
    share: float = 0.1  # of a run's lines that may be wild, ...
    few: int = 3  # ... or so many
    crowd: int = 3  # so many wild lines ...
    within: int = 6  # ... within so many are no accident
    fewest: int = 20  # of fewer lines none is called wild: each may be a resonance
    lifted: float = 1.05  # a peak lifts the lines beside it over those beyond by this factor; a wild line does not


LIMITS = WildLimits()


def wild_lines(run: Run) -> NDArray[np.bool_]:
    """(n_freq,) which lines are wild."""
    n = len(run.frequency_hz)
    wild, none = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    error = _errors(run)
    while error.max(initial=0.0) > LIMITS.errors:
        wild[np.flatnonzero(~wild)[np.argmax(error)]] = True
        if wild.sum() > max(LIMITS.few, LIMITS.share * n):
            return none
        error = _errors(run.on_lines(~wild))
    return none if _are_crowded(np.flatnonzero(wild)) else wild


def without_wild_lines(runs: Sequence[Run]) -> list[Run]:
    """Runs with nan at their wild lines, which stay in the sweep: transients of a fast sweep depend on every line."""
    return [blank_lines(run, wild_lines(run)) for run in runs]


def drop_wild_lines(p: CheckedRun) -> CheckedRun:
    """A run without its wild lines; itself where there are none."""
    wild = wild_lines(p.run)
    return CheckedRun(p.run.on_lines(~wild), p.label) if wild.any() else p


def check_wild_lines(p: CheckedRun, left: CheckedRun) -> Iterator[Finding]:
    """Report the wild lines of a run: those that ``left``, the same run without them, lacks."""
    wild = np.setdiff1d(p.run.frequency_hz, left.run.frequency_hz)
    if len(wild):
        many = "1 line does not go with its" if len(wild) == 1 else f"{len(wild)} lines do not go with their"
        yield left_out_finding(p, wild, f"{many} neighbours")


def left_out_finding(p: CheckedRun, frequency_hz: FloatArray, why: str) -> Finding:
    """A warning that names the lines that are left out of a run, and the reason."""
    named = ", ".join(f"{f:.5g}" for f in frequency_hz[:5]) + (" and others" if len(frequency_hz) > 5 else "")
    words = f"{why}; left out: {named} Hz. Repeat what was measured there."
    return p.finding("missing_lines", "warning", words, float(len(frequency_hz)), 0.0)


def blank_lines(run: Run, lines: NDArray[np.bool_]) -> Run:
    """A run with nan at some lines, which stay in the sweep."""
    return replace(run, H=np.where(lines[:, None], np.nan, run.H)) if lines.any() else run


def _errors(run: Run) -> FloatArray:
    """(n_freq,) error of every line in its worst channel, in standard errors; 0 where unknown."""
    noise, own = estimate_noise(run), np.abs(np.nan_to_num(responses(run)))
    size, draws = own.copy(), noise.draws
    size[1:-1] = np.maximum.reduce([size[:-2], size[1:-1], size[2:]])
    with np.errstate(all="ignore"):
        if run.magnitude_only:  # whose fits are of squares: between larger ones, an error of a small one is larger
            draws = draws * own / size
        error = draws / noise.std
    plain = np.isfinite(error) & (draws > LIMITS.plain * size) & (len(own) >= LIMITS.fewest)
    if run.magnitude_only:
        plain[_beside_peaks(np.linalg.norm(own, axis=1))] = False
    return np.max(np.where(plain, error, 0.0), axis=1, initial=0.0)


def _beside_peaks(size: FloatArray) -> NDArray[np.bool_]:
    """(n_freq,) lines of a peak. A sharp peak of magnitudes is no smooth curve either, but it lifts its neighbours."""
    rises, falls = LIMITS.lifted * size[:-1] < size[1:], size[:-1] > LIMITS.lifted * size[1:]  # (n_freq - 1,)
    tops = 2 + np.flatnonzero(rises[:-3] & rises[1:-2] & falls[2:-1] & falls[3:])
    near = np.zeros(len(size), dtype=bool)
    for shift in range(-2, 3):
        near[tops + shift] = True
    return near


def _are_crowded(places: NDArray[np.intp]) -> bool:
    return bool(np.any(places[LIMITS.crowd - 1 :] - places[: len(places) - LIMITS.crowd + 1] < LIMITS.within))
