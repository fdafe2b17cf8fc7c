"""The virtual test rig: a stepped sine through an FMU, with more lines around the resonances."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.rotor.frequency.measured import ChannelGroup, channel_groups, check_nodes
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Channel, Run
from rigtwin.sim.detection import HARMONICS
from rigtwin.sim.lines import Line, LineReader, NotSettledError, ReaderState, channels_of
from rigtwin.sim.modal_fit import half_power_band, resonances
from rigtwin.sim.session import FmuSession
from rigtwin.sim.setup import Rig, SetupError, SweepPlan

__all__ = ["Line", "NotSettledError", "Rig", "SetupError", "Sweep", "SweepPlan", "measure_lines", "sweep"]

logger = logging.getLogger(__name__)

# Lines are not put closer together than this, relative to their frequency. No peak of a linear rotor is so sharp; a
# branch of a nonlinear rotor ends in a jump, which has no half-power band.
_SHARPEST, _SHARPEST_JUMP = 1e-7, 1e-4
_JUMP_BAND = 1e-3

# Looks for resonances that the lines of others have brought to light.
_ROUNDS = 4

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Sweep:
    """A run, and how well the motion had settled on each of its lines."""

    run: Run
    lines: tuple[Line, ...]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is wrong with single lines, a sentence each."""
        return tuple(line.remark for line in self.lines if line.remark)


def sweep(session: FmuSession, rig: Rig, plan: SweepPlan, progress: Progress | None = None) -> Sweep:
    """Sweep from rest in the plan's direction, with more lines round each resonance.

    Where a line depends on the one before (a nonlinear rotor, or a dwell that does not wait), the
    resonances are looked for first, and then all lines are swept once, in order.

    Parameters
    ----------
    session : an open RotorRig FMU
    rig : support, exciter, effects, parameters
    plan : lines, settling, noise
    progress : called with the number of lines measured so far

    Raises
    ------
    NotSettledError : a line did not settle
    SetupError : rig and plan cannot be carried out together
    """
    plan = rig.carry_out(plan)
    passes = _passes(session, rig, plan, progress)
    lines = set(plan.base_lines().tolist())
    if plan.refine:
        lines |= {f for one in passes for f in one.search()}
    return _result(passes, rig, plan, lines)


def measure_lines(
    session: FmuSession,
    rig: Rig,
    plan: SweepPlan,
    frequency_hz: Sequence[float] | FloatArray,
    *,
    passing: Sequence[float] | FloatArray = (),
) -> Sweep:
    """Measure exactly these lines, from rest, in the plan's direction.

    ``passing`` are lines [Hz] that are held for ``glide_time`` on the way and not read: a nonlinear rotor that takes
    them all in one step may leave the branch that a sweep would follow.
    """
    plan = rig.carry_out(plan)
    lines = set(np.asarray(frequency_hz, dtype=float).tolist())
    return _result(_passes(session, rig, plan, None), rig, plan, lines, set(map(float, passing)))


class _Pass:
    """The lines of one group of channels, by frequency."""

    def __init__(self, session: FmuSession, rig: Rig, plan: SweepPlan, group: ChannelGroup, count: Callable[[], None]):
        self.group = group
        self._reader = LineReader(session, rig, plan, group)
        self._searcher = LineReader(session, rig, rig.search_plan(plan), group)
        self._plan, self._count = plan, count
        self._branches = rig.nonlinear  # of the response: which one is seen depends on where the sweep comes from
        self._in_one_go = rig.nonlinear or plan.dwell is not None
        self.lines: dict[float, Line] = {}

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels, of which this pass is about its group's."""
        return self._reader.channels

    @property
    def columns(self) -> list[int]:
        """Places of the group's channels among all."""
        return [place for place, channel in enumerate(self.channels) if channel.node in self.group.nodes]

    def search(self) -> list[float]:
        """Measure the base lines, settled, and more round each resonance."""
        raster = _Raster(self._searcher, self._plan, self._count, keep_states=self._branches)
        raster.at(self._plan.base_lines())
        raster.refine()
        if not self._in_one_go:
            self.lines = raster.lines
        return list(raster.lines)

    def complete(self, frequencies: set[float], passing: Set[float]) -> None:
        """Measure the lines that are not there yet, passing others on the way."""
        missing = frequencies - self.lines.keys()
        if missing:
            raster = _Raster(self._reader, self._plan, self._count)
            raster.at(missing, passing if self._branches else frozenset())
            self.lines |= raster.lines


class _Raster:
    """Lines measured one after another from rest, and more where they are needed."""

    def __init__(self, reader: LineReader, plan: SweepPlan, count: Callable[[], None], *, keep_states: bool = False):
        self._reader, self._plan, self._count, self._keep_states = reader, plan, count, keep_states
        self._states: dict[float, ReaderState] = {}
        self.lines: dict[float, Line] = {}
        reader.start()

    def at(self, frequencies: Iterable[float], passing: Set[float] = frozenset()) -> None:
        """Measure the lines that are not there yet, in the direction of the sweep, passing others on the way."""
        missing = set(map(float, frequencies)) - self.lines.keys()
        way = self._plan.in_order(missing | passing)
        while way and way[-1] not in missing:  # nobody asks for what comes after the last line
            way.pop()
        for f in way:
            if f not in missing:
                self._reader.pass_by(f)
                continue
            if self._keep_states:
                self._approach(f)
            self.lines[f] = self._reader.read(f)
            if self._keep_states:
                self._states[f] = self._reader.state()
            self._count()

    def _approach(self, f: float) -> None:
        """Go back to the nearest line that a sweep meets before this one."""
        passed = self._plan.in_order(self._states)
        ahead = self._plan.in_order([*passed, f]).index(f)
        if ahead:
            self._reader.go_back(self._states[passed[ahead - 1]])
        else:
            self._reader.start()

    def refine(self) -> None:
        """Add lines until every resonance is resolved, then lay a raster over its band.

        Lines beside one resonance may show another that the base lines had missed.
        """
        seen: list[tuple[float, float]] = []  # where, and how far from there it is the same resonance
        for _ in range(_ROUNDS):
            fresh = [peak for peak in self._candidates() if not any(abs(peak - f) <= near for f, near in seen)]
            for peak in fresh:
                closest = self._close_in(peak)
                seen.append((peak, 0.0))
                if closest is not None:
                    seen.append(self._lay_raster(closest))

    def _lay_raster(self, peak: float) -> tuple[float, float]:
        """Measure the lines of a peak's band; returns where the resonance is and how wide its band [Hz]."""
        plan = self._plan
        centre, width = half_power_band(*self._magnitude(), peak)
        if self._keep_states:
            width = max(width, _JUMP_BAND * centre)
        half = plan.lines_per_half_power_band // 2
        inner = np.arange(-half, half + 1) / (2 * half)
        outer = np.array([-8.0, -4.0, -2.0, -1.0, 1.0, 2.0, 4.0, 8.0])
        raster = centre + width * np.concatenate([inner, outer])
        self.at(f for f in raster if plan.f_min_hz <= f <= plan.f_max_hz)
        return centre, max(width, abs(peak - centre))

    def _warn_of_resonance_beyond(self, end: float) -> None:
        """Say so where a resonance lies less than a base line outside the band: 1 / magnitude goes to zero there."""
        f, magnitude = self._magnitude()
        inside = 1 if end == f[0] else -2
        ratio, gap = magnitude[inside] / magnitude[f == end][0], abs(f[inside] - end)
        if gap * ratio < (1 - ratio) * np.ptp(f) / (self._plan.n_lines - 1):
            beyond = gap * ratio / (1 - ratio)
            logger.warning("a resonance lies within %.2g Hz beyond the end of the band, %g Hz; widen it", beyond, end)

    def _magnitude(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies and root-sum-square displacement over all channels."""
        f = np.array(sorted(self.lines))
        return f, np.array([self.lines[x].size for x in f]) / f**2

    def _candidates(self) -> list[float]:
        """Lines that stand out; the ends count when the response rises towards them."""
        f, magnitude = self._magnitude()
        return resonances(np.pad(f, 1), np.pad(magnitude, 1)) if len(f) > 1 and magnitude.any() else []

    def _close_in(self, peak: float) -> float | None:
        """The highest line next to a maximum, once its half-power band is seen; None where there is no such thing.

        Lines half way to the neighbours are added until these are nearly as high. At an end of the
        band there is one neighbour, which is that high, too, when it is twice as far from the
        resonance as the end: one more line tells the two apart.
        """
        sharpest = _SHARPEST_JUMP if self._keep_states else _SHARPEST
        for _ in range(40):
            if not self.lines[peak].periodic:  # high by chance
                return None
            f, magnitude = self._magnitude()
            here = int(np.flatnonzero(f == peak)[0])
            beside = [k for k in (here - 1, here + 1) if 0 <= k < len(f)]
            seen = magnitude[beside].min() > 0.8 * magnitude[here] or max(abs(f[beside] - peak)) < sharpest * peak
            at_end = len(beside) == 1
            if seen and not at_end:
                break
            self.at((f[k] + peak) / 2 for k in beside)
            low, high = f[min(here, *beside)], f[max(here, *beside)]
            f, magnitude = self._magnitude()
            near = (f >= low) & (f <= high)
            highest = float(f[near][np.argmax(magnitude[near])])
            if seen and highest == peak:
                self._warn_of_resonance_beyond(peak)
                return None
            peak = highest
        return peak


def _passes(session: FmuSession, rig: Rig, plan: SweepPlan, progress: Progress | None) -> list[_Pass]:
    """One pass of the sweep for each group of channels that can be measured together."""
    nodes = list(dict.fromkeys(channel.node for channel in channels_of(session, rig)))
    try:
        check_nodes(rig.effects, max(nodes, default=0))
    except ValueError as error:
        raise SetupError(str(error)) from error
    measured = 0

    def count() -> None:
        nonlocal measured
        measured += 1
        if progress:
            progress(measured)

    return [_Pass(session, rig, plan, group, count) for group in channel_groups(rig.effects, nodes)]


def _result(
    passes: list[_Pass], rig: Rig, plan: SweepPlan, frequencies: set[float], passing: Set[float] = frozenset()
) -> Sweep:
    """All lines in order, every channel from the pass of its group."""
    for one in passes:
        one.complete(frequencies, passing)
    lines = tuple(_merge(passes, f) for f in sorted(frequencies))
    responses = np.array([line.response for line in lines])  # (n_freq, n_harmonics, n_channels)
    run = Run(
        frequency_hz=np.array([line.frequency_hz for line in lines]),
        H=responses[:, 0],
        channels=passes[0].channels,
        support=rig.support,
        std=np.array([line.std for line in lines]),
        harmonics={order: responses[:, k] for k, order in enumerate(HARMONICS) if order > 1},
        quantity=rig.quantity,
        excitation_node=rig.excitation_node,
        excitation_plane=rig.excitation_plane,
        force_amplitude_N=plan.force_amplitude,
        spin_rpm=rig.spin_rpm,
        sweep=plan.direction,
        name=f"{rig.support} support, {plan.force_amplitude:g} N",
    )
    return Sweep(run, lines)


def _merge(passes: list[_Pass], frequency_hz: float) -> Line:
    """One line of all channels; of what is said of the line as a whole, the worst."""
    if len(passes) == 1:
        return passes[0].lines[frequency_hz]
    lines = [one.lines[frequency_hz] for one in passes]
    response, std = lines[0].response.copy(), lines[0].std.copy()
    for one, line in zip(passes, lines, strict=True):
        columns = one.columns
        response[:, columns], std[columns] = line.response[:, columns], line.std[columns]
    worst = {name: max(getattr(line, name) for line in lines) for name in ("transient", "drift_per_period", "spread")}
    return replace(
        lines[0],
        response=response,
        std=std,
        **worst,
        windows=sum(line.windows for line in lines),
        periodic=all(line.periodic for line in lines),
        remark=" ".join(line.remark for line in lines if line.remark),
    )
