"""A run as every check sees it: its clean lines, noise and resonances."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from rigtwin.gap.audit.noise import GIVEN_ERRORS, NoiseEstimate, estimate_noise, live_channels, responses
from rigtwin.gap.document import Finding
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Channel, NominalBelief, Run
from rigtwin.sim.resonances import Resonance, find_resonances

Severity = Literal["ok", "note", "warning", "error"]


@dataclass(frozen=True)
class CheckedRun:
    """One run and what every check needs of it."""

    # Beats lie within this share of the resonance; a real rotor has no three modes in one plane so close.
    beat_reach: ClassVar[float] = 0.15
    fewest_beats: ClassVar[int] = 2  # of peaks behind the highest one

    run: Run
    label: str  # name of the run, or its number

    @cached_property
    def live(self) -> np.ndarray:
        """(n_live,) indices of the channels that carry a response."""
        return np.flatnonzero(live_channels(self.run))

    @cached_property
    def lines(self) -> np.ndarray:
        """(n,) indices of the lines that are finite in every live channel."""
        return np.flatnonzero(np.isfinite(responses(self.run)[:, self.live]).all(axis=1) & (len(self.live) > 0))

    @property
    def f(self) -> FloatArray:
        """(n,) frequencies of the clean lines [Hz]."""
        return np.asarray(self.run.frequency_hz[self.lines], dtype=float)

    @cached_property
    def H(self) -> np.ndarray:
        """(n, n_live) clean responses, real for magnitudes."""
        H = responses(self.run)[np.ix_(self.lines, self.live)]
        return np.abs(H) if self.run.magnitude_only else H

    @property
    def channels(self) -> list[Channel]:
        """(n_live,) the live channels."""
        return [self.run.channels[i] for i in self.live]

    @cached_property
    def noise(self) -> NoiseEstimate:
        """The noise of the data."""
        return estimate_noise(self.run)

    @cached_property
    def std(self) -> FloatArray:
        """(n, n_live) estimated standard errors; a usual value where too few lines tell. Never zero."""
        std, size = self.noise.std[np.ix_(self.lines, self.live)], np.abs(self.H)
        known = np.where(np.isfinite(std), std, GIVEN_ERRORS.usual * size)
        return np.maximum(known, 1e-6 * size + np.finfo(float).tiny)

    @cached_property
    def resonances(self) -> tuple[Resonance, ...]:
        """Every resonance, ascending."""
        return find_resonances(self.f, self.H, self.std, self.run.quantity)

    @cached_property
    def beats(self) -> dict[int, list[int]]:
        """Lines of peaks that look like beats behind a higher one, by that one's line.

        A rotor that rings on after its resonance beats with the exciter: two or more peaks follow on
        one side, each lower than the one before, and none is on the other side.
        """
        found: dict[int, list[int]] = {}
        for leader in self.resonances:
            near = [r for r in self.resonances if 0 < abs(self.f[r.line] / self.f[leader.line] - 1) < self.beat_reach]
            above = [r for r in near if r.line > leader.line]
            behind = above or near[::-1]
            heights = [leader.peak, *(r.peak for r in behind)]
            if len(behind) < self.fewest_beats or len(behind) < len(near) or any(np.diff(heights) >= 0):
                continue
            if (self.run.sweep == "up" and not above) or (self.run.sweep == "down" and above):
                continue
            if not any(leader.line in lines for lines in found.values()):
                found[leader.line] = [r.line for r in behind]
        return found

    @cached_property
    def receptance(self) -> np.ndarray:
        """(n, n_live) responses brought to displacement; magnitudes for magnitudes."""
        s = 2 * np.pi * self.f[:, None] * (1 if self.run.magnitude_only else 1j)
        return self.H / s ** DERIVATIVE_ORDER[self.run.quantity]

    def half_power_hz(self, resonance: Resonance, belief: NominalBelief) -> float:
        """Width of a resonance's half-power band [Hz], fitted or else as believed; nan where neither is known."""
        if np.isfinite(resonance.damping_ratio):
            return resonance.half_power_hz
        return 2 * (belief.shaft_damping_ratio or np.nan) * resonance.frequency_hz

    def away(self, widths: float) -> np.ndarray:
        """(n,) whether a clean line is farther than some half-power widths from every resonance."""
        far = np.ones(len(self.f), dtype=bool)
        for r in self.resonances:
            width = r.half_power_hz if np.isfinite(r.damping_ratio) else 2 * r.frequency_std_hz
            far &= np.abs(self.f - r.frequency_hz) > widths * width
        return far

    def finding(
        self, check: str, severity: Severity, words: str, value: float | None = None, limit: float | None = None
    ) -> Finding:
        """A finding about this run."""
        return Finding(check, severity, words, self.label, value, limit)


def checked_runs(runs: tuple[Run, ...]) -> tuple[CheckedRun, ...]:
    """Every run with a label of its own, without the values that were dropped."""
    return tuple(CheckedRun(without_dropped_values(run), run.name or f"run {k}") for k, run in enumerate(runs, start=1))


def without_dropped_values(run: Run) -> Run:
    """A run with nan where a channel that moves elsewhere is exactly zero: so instruments write what they dropped."""
    zero = run.H == 0
    dropped = zero & ~zero.all(axis=0)
    return replace(run, H=np.where(dropped, np.nan, run.H)) if dropped.any() else run
