"""One frequency line: wait until the rotor has settled, set the force of the exciter, read the motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rigtwin.rotor.effects.effect import SWITCH
from rigtwin.rotor.frequency.measured import ChannelGroup, at_constant_current, channel_factor, force_factor
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Channel
from rigtwin.sim.detection import HARMONICS, detect, harmonics, per_force
from rigtwin.sim.session import FmuSession, SavedState
from rigtwin.sim.setup import Rig, SetupError, SweepPlan

# Changes of a phasor this small are round-off of the FMU's propagator, not a decaying transient.
_ROUND_OFF = 1e-7

# Windows from which a transient is estimated, and those that show that waiting on is of no use.
_WINDOWS = 5
_STATIONARY_WINDOWS = 12

# A channel's changes are judged beside its own size, or beside this share of the largest channel. What
# is stepped in time has errors that are relative to the whole motion.
_SHARE, _SHARE_TIME_STEPPED = 1e-3, 0.1

# A motion whose fundamental spreads by more from period to period does not repeat; one by less need not be watched on.
PERIODIC, _ALIKE = 1e-3, 1e-4

# There are enough samples if the harmonics change by less than this when every other sample is left out. Only content
# near multiples of the number of samples is missed by this test; contacts have content at all frequencies.
_UNFOLDED = 1e-6

# What to do about a line that does not settle.
HOW_TO_SETTLE = "raise settle_time, or the damping if it is too low"

# Run-in [s], at most a period, after which a rotor that is stepped in time follows the spacing of the samples.
_RUN_IN = 5e-3

# Number of forces that are tried for an exciter at constant current.
_FORCE_STEPS = 20

# Where the frequency stands on its glide from one line to the next, 0 to 1: the integral of 1 - cos, in half as many
# steps a line needs a third more windows.
_GLIDE = [share - math.sin(2 * math.pi * share) / (2 * math.pi) for share in (np.arange(64) + 0.5) / 64]

# Samples a period while waiting: what folds back is the same in every window that begins at the same phase.
_WAITING_SAMPLES = 64


# The rotor's state, the exciter's force [N] and its frequency [Hz].
ReaderState = tuple[SavedState, float, float | None]


class NotSettledError(RuntimeError):
    """A line did not settle within the allowed time; ``frequency_hz`` and ``estimate`` say where."""

    def __init__(self, message: str, frequency_hz: float, estimate: float):
        super().__init__(message, frequency_hz, estimate)  # a worker's error reaches another process with these
        self.message = message
        self.frequency_hz = frequency_hz
        self.estimate = estimate

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True)
class Line:
    """One frequency line; phasors in the unit of the run, channels in the order of the sweep."""

    frequency_hz: float
    response: ComplexArray  # (n_harmonics, n_channels)
    std: FloatArray  # (n_channels,) standard error: noise, remaining transient, spread; noise alone with a dwell
    transient: float  # estimated remaining transient, largest over channels, relative [-]; nan: not judged
    drift_per_period: float  # relative change per period between the last two windows [-]; nan: not judged
    windows: int
    force: complex  # phasor of the applied force at the window's first sample [N]
    spread: float = 0.0  # of the fundamental over the periods read, largest over channels, relative [-]
    periodic: bool = True  # whether the spread is below PERIODIC
    remark: str = ""  # a sentence where something is wrong with the line

    @cached_property
    def size(self) -> float:
        """Root-sum-square of the fundamental over all channels."""
        return float(np.linalg.norm(self.response[0]))


@dataclass(frozen=True)
class _Settled:
    """Result of waiting for a line to settle."""

    windows: list[ComplexArray]  # (n_channels,) fundamentals per newton
    last: FloatArray  # (n_samples, n_channels + 1) the last of these windows, a period; with the force
    estimate: float  # remaining transient, relative [-]
    remark: str = ""  # what is wrong, where it did not settle


class LineReader:
    """Reads lines one after another; each starts from the state at the end of the line before.

    Parameters
    ----------
    session : an open RotorRig FMU
    rig, plan : the set-up; the plan as the rig carries it out
    group : the effects that act; all channels are read, those of the group as they are in the end
    """

    def __init__(self, session: FmuSession, rig: Rig, plan: SweepPlan, group: ChannelGroup):
        self._session, self._rig, self._plan, self._effects = session, rig, plan, group.effects
        self.channels = channels_of(session, rig)
        self._outputs = [*(f"node_{c.node}.acceleration_{c.plane}" for c in self.channels), "force_applied"]
        self._controlled = at_constant_current(group.effects)
        if self._controlled and rig.excitation_plane not in {c.plane for c in self.channels}:
            raise SetupError(
                "the force of an exciter at constant current follows from the motion in its plane: read it"
            )
        if self._controlled and plan.dwell is not None:
            both = [e.id for e in rig.effects if e.needs_exciter_current or e.sweep_changes()]
            raise SetupError(
                "the force of an exciter at constant current follows from the settled motion, and a fast sweep reads "
                f"before that: give {' or '.join(both)}"
            )
        place = rig.excitation_node
        self._beside_drive = [e for e in group.effects if e.reads_beside_node and e.sits_at(place)]
        unbalanced = any(effect.turns_with_shaft for effect in group.effects)
        self._spin_hz = abs(rig.spin_rpm) / 60 if unbalanced and not rig.nonlinear else 0.0
        self._share = _SHARE_TIME_STEPPED if rig.nonlinear else _SHARE
        self._amplitude = plan.force_amplitude
        self._at: float | None = None
        self._run_out: ComplexArray | None = None

    def start(self) -> None:
        """Put the rotor to rest; one that is out of balance runs until its own motion is known."""
        self._amplitude, self._at = self._plan.force_amplitude, None
        first = 0.0 if self._spin_hz else self._amplitude
        self._session.start({**self._rig.start_values(self._effects), "force_amplitude": first})
        self._run_out = None
        if self._spin_hz:
            self._run_out = self._measure_run_out()

    def _measure_run_out(self) -> ComplexArray:
        """(n_outputs,) phasors of the motion without the exciter at the spin frequency, from time zero."""
        windows: list[ComplexArray] = []
        while len(windows) < self._plan.max_windows:
            self._session.step(self._plan.settle_time)
            turn = np.exp(-2j * np.pi * self._spin_hz * self._session.time)
            samples = self._plan.samples(self._spin_hz)
            windows.append(harmonics(self._window(self._spin_hz, 1, samples), samples)[0] * turn)
            if len(windows) >= 3 and remaining_transient(windows) <= _ROUND_OFF:
                return windows[-1]
        raise NotSettledError(
            f"the motion by unbalance does not settle within {len(windows) * self._plan.settle_time:.0f} s; "
            + HOW_TO_SETTLE,
            frequency_hz=self._spin_hz,
            estimate=remaining_transient(windows),
        )

    def state(self) -> ReaderState:
        """Where the rotor and the exciter stand, for ``go_back``."""
        return self._session.save_state(), self._amplitude, self._at

    def go_back(self, state: ReaderState) -> None:
        """Go on from an earlier line."""
        saved, self._amplitude, self._at = state
        self._session.restore_state(saved)

    def read(self, frequency_hz: float) -> Line:
        """One line, as the plan asks for it. Raises NotSettledError."""
        at = frequency_hz * (1 + self._rig.drift)
        if self._plan.dwell is None:
            return self._settled_line(frequency_hz, at)
        self._hold(at, self._plan.dwell)
        return self._line(frequency_hz, at, _Settled([], np.empty((0, len(self._outputs))), np.nan), 1.0)

    def pass_by(self, frequency_hz: float) -> None:
        """Hold a line for as long as a glide to it would take, unread."""
        self._at = frequency_hz * (1 + self._rig.drift)
        self._hold(self._at, self._plan.glide_time)

    def _glide(self, at: float) -> None:
        """Bring the exciter from its last frequency to another [Hz]; a rotor at rest, from no force to its own."""
        if self._plan.glide_time:
            force, before, step = self._amplitude, self._at, self._plan.glide_time / len(_GLIDE)
            for share in _GLIDE:
                self._amplitude = share * force if before is None else force
                self._hold(at if before is None else before + share * (at - before), step)
            self._amplitude = force
        self._at = at

    def _hold(self, at: float, seconds: float) -> None:
        """Drive the rotor at a frequency [Hz] for some time."""
        self._session.set({"force_frequency": at, "force_amplitude": self._amplitude})
        self._session.step(seconds)

    # -- waiting -------------------------------------------------------------------------------

    def _settled_line(self, frequency_hz: float, at: float) -> Line:
        """Wait; where the exciter's force depends on the motion, until the two agree."""
        tried: list[tuple[float, float]] = []
        self._glide(at)
        while True:
            self._session.set({"force_frequency": at, "force_amplitude": self._amplitude})
            settled = self._settle(frequency_hz, at)
            factor = self._force_factor(at)
            wanted = self._plan.force_amplitude * abs(factor)
            off = abs(wanted / self._amplitude - 1)
            agreed = off <= self._plan.settling_tolerance
            if agreed or len(tried) == _FORCE_STEPS:
                break
            tried.append((self._amplitude, wanted))
            self._amplitude = _next_amplitude(tried)
        remark = ""
        if not agreed:
            remark = (
                f"{frequency_hz:.4f} Hz: force and motion of the exciter at constant current do not come to agree, "
                f"the force is off by {off:.1e}; another level may do"
            )
            if not self._plan.accept_nonperiodic:
                raise NotSettledError(remark, frequency_hz=frequency_hz, estimate=off)
        return self._line(frequency_hz, at, settled, factor, remark)

    def _settle(self, frequency_hz: float, at: float) -> _Settled:
        """Take windows until the transient is estimated to be gone."""
        plan, windows, last, estimate = self._plan, [], np.empty(0), np.inf
        wait, samples = self._wait(at), self._waiting_samples(at)
        while len(windows) < plan.max_windows:
            self._session.step(wait)
            last = self._window(at, 1, samples)
            windows.append(_fundamental(last))
            estimate = remaining_transient(windows, time_stepped=self._rig.nonlinear)
            if len(windows) >= 3 and estimate <= plan.settling_tolerance:
                return _Settled(windows, last, estimate)
            if plan.accept_nonperiodic and _is_stationary(windows):
                break
        share = f"{estimate:.1e}" if np.isfinite(estimate) else "an unknown share"
        waited = f"{frequency_hz:.4f} Hz: {share} of the response {{}} after {len(windows) * wait:.0f} s"
        if plan.accept_nonperiodic:
            return _Settled(windows, last, estimate, waited.format("still changes from window to window"))
        raise NotSettledError(
            waited.format("is still transient") + f"; {HOW_TO_SETTLE}", frequency_hz=frequency_hz, estimate=estimate
        )

    def _waiting_samples(self, at: float) -> int:
        """Samples of the window of one period that shows whether the motion still changes."""
        return min(self._plan.samples(at), _WAITING_SAMPLES)

    def _wait(self, at: float) -> float:
        """Seconds from a window's last sample to the next one's first; of a nonlinear rotor they begin at one phase."""
        if not self._rig.nonlinear:
            return self._plan.settle_time
        return (math.ceil(self._plan.settle_time * at) + 1 / self._waiting_samples(at)) / at

    def _force_factor(self, at: float) -> complex:
        """Force on the rotor over the nominal one, by the motion at the exciter."""
        if not self._controlled:
            return 1.0
        switches = [effect.full_name(SWITCH) for effect in self._beside_drive]
        if switches:  # the sensor reads beside the exciter: set it back for a moment
            self._session.set(dict.fromkeys(switches, False))
        moving = _fundamental(self._window(at, 1, self._plan.samples(at)))
        if switches:
            self._session.set(dict.fromkeys(switches, True))
        drive = self.channels.index(Channel(self._rig.excitation_node, self._rig.excitation_plane))
        omega = np.array([2 * np.pi * at])
        return complex(force_factor(self._effects, omega, -moving[drive] / omega**2)[0])

    # -- reading -------------------------------------------------------------------------------

    def _window(self, at: float, periods: int, n: int) -> FloatArray:
        """n samples of each of whole periods, less the motion by unbalance."""
        h, size = 1 / (n * at), n * periods
        if self._run_out is None:
            return self._session.sample(self._outputs, h, size)
        turn = np.exp(2j * np.pi * self._spin_hz * (self._session.time + h * np.arange(size)))
        return self._session.sample(self._outputs, h, size) - (turn[:, None] * self._run_out).real

    def _time_stepped(self, at: float) -> tuple[FloatArray, int]:
        """The plan's periods of a motion that is stepped in time, and how many samples each of them has.

        Only a motion that folds onto its harmonics is sampled densely, and only one that does not repeat is followed
        for more than two periods.
        """
        n = self._plan.samples_per_period
        pair = self._two_periods(at, n)
        if _folded(pair[:, :-1], n, self._share) > _UNFOLDED:
            n = self._plan.samples(at)
            pair = self._two_periods(at, n)
        size, left = np.abs(harmonics(pair, n)[0, :-1]), max(self._plan.periods - 2, 0)
        if _relative(_spread(pair[:, :-1], n), size, self._share) > _ALIKE:
            rest = self._session.sample(self._outputs, 1 / (n * at), 1 + left * n)[1:]
        else:
            rest = np.tile(pair, (math.ceil(left / 2), 1))[: left * n]
        return np.concatenate([pair, rest]), n

    def _two_periods(self, at: float, n: int) -> FloatArray:
        """Of n samples each, after some run-in."""
        run_in = math.ceil(n * min(_RUN_IN * at, 1.0))
        return self._session.sample(self._outputs, 1 / (n * at), run_in + 2 * n)[run_in:]

    def _line(self, frequency_hz: float, at: float, settled: _Settled, force: complex, remark: str = "") -> Line:
        plan, windows = self._plan, settled.windows
        if self._rig.nonlinear:
            clean, samples = self._time_stepped(at)
        else:
            samples = plan.samples(at)
            known = len(settled.last) == plan.periods * samples
            clean = settled.last if known else self._window(at, plan.periods, samples)
        noisy = clean.copy()
        noisy[:, :-1] = plan.noise.add(clean[:, :-1], self._stream(frequency_hz))
        detected = detect(noisy, samples, any_harmonics=self._rig.nonlinear)
        phasors, applied = per_force(detected), complex(detected.amplitude[0, -1])
        size, spread = np.abs(phasors.amplitude[0]), _spread(clean[:, :-1], samples) / abs(applied)
        if windows:
            judged = np.where(size > 0, np.maximum(size, self._share * size.max()), 0.0)
            std = np.sqrt(phasors.std**2 + (min(settled.estimate, 1.0) * judged) ** 2 + spread**2)
        else:  # a transient is in the data, and nobody knows
            std = detect(noisy - clean, samples).std[:-1] / abs(applied)
        relative_spread = _relative(spread, size, self._share)
        periodic = not windows or relative_spread <= PERIODIC
        drift = _change(windows[-2], windows[-1], self._share) if len(windows) > 1 else np.nan
        factor = self._reported(at, force)
        trouble = settled.remark if periodic else _does_not_repeat(frequency_hz, relative_spread)
        return Line(
            frequency_hz=frequency_hz,
            response=phasors.amplitude * factor,
            std=std * np.abs(factor[0]),
            transient=settled.estimate,
            drift_per_period=drift / (plan.settle_time * at + 1),
            windows=max(len(windows), 1),
            force=applied,
            spread=relative_spread,
            periodic=periodic,
            remark="; ".join(filter(None, (remark, trouble))),
        )

    def _stream(self, frequency_hz: float) -> tuple[str | int | float, ...]:
        """Values that identify the noise of this line among all others."""
        rig = self._rig
        place = int(rig.excitation_node), rig.excitation_plane
        return rig.support, float(self._plan.force_amplitude), *place, float(rig.spin_rpm), round(1e9 * frequency_hz)

    def _reported(self, at: float, force: complex) -> ComplexArray:
        """(n_harmonics, n_channels) what the run says over response per newton on the rotor."""
        omega = 2 * np.pi * at * np.array(HARMONICS)
        sensors = np.array([channel_factor(self._effects, omega, c.node) for c in self.channels]).T
        exciter = np.array([abs(force) * (force / abs(force)) ** k for k in HARMONICS])
        unit = self._plan.force_amplitude if self._rig.quantity == "acceleration" else 1.0
        return unit * exciter[:, None] * sensors


def channels_of(session: FmuSession, rig: Rig) -> tuple[Channel, ...]:
    """The FMU's accelerometers that the rig reads, plane after plane."""
    found = []
    for plane in rig.sensor_planes or (rig.excitation_plane,):
        names = [v for v in session.variables if v.endswith(f".acceleration_{plane}")]
        found += [Channel(int(name.split(".")[0].removeprefix("node_")), plane) for name in names]
    return tuple(found)


def _fundamental(period: FloatArray) -> ComplexArray:
    """(n_channels,) of the samples (n, n_channels + 1) of one period, per newton; the force is the last channel."""
    found = harmonics(period, len(period))[0]
    return found[:-1] / found[-1]


def remaining_transient(windows: Sequence[ComplexArray], *, time_stepped: bool = False) -> float:
    """What is left of the transient after the last of equally spaced windows (n_channels,), inf where it is not known.

    A transient that decays by the factor r from window to window changes the phasor by d and then by
    r d. After the last window at most d r / (1 - r) is left, with d the last change. Modes beat with the
    force and with each other, so a change may be small by chance. Therefore the largest of the last
    three changes and the slowest of their decays are used, which takes five windows. If only round-off
    changes, three windows are enough.

    A rotor that is stepped in time (``time_stepped``) ends in small irregular changes instead of
    round-off. There the last five windows must agree, and a decay that can be seen must have ended.

    >>> remaining_transient([np.array([1.0 + 0.0j])] * 3)
    0.0
    """
    share = _SHARE_TIME_STEPPED if time_stepped else _SHARE
    changes = [_change(*pair, share) for pair in itertools.pairwise(windows[-_WINDOWS:])]
    if len(changes) >= 2 and max(changes[-2:]) <= _ROUND_OFF:
        return max(changes[-2:])
    if len(changes) < _WINDOWS - 1:
        return np.inf
    ratio = max(after / before if before else np.inf for before, after in itertools.pairwise(changes))
    left = np.inf if ratio >= 1 else max(changes[1:]) * ratio / (1 - ratio)
    if not time_stepped:
        return left
    disagreement = max(_change(window, windows[-1], share) for window in windows[-_WINDOWS:-1])
    return max(disagreement, left) if np.isfinite(left) else disagreement


def _is_stationary(windows: Sequence[ComplexArray]) -> bool:
    """Whether the windows scatter now as they did before, so that waiting longer changes nothing."""
    if len(windows) < _STATIONARY_WINDOWS:
        return False
    last = np.array(windows[-_STATIONARY_WINDOWS:])
    before, after = (half.std(axis=0).max() for half in np.split(last, 2))
    return bool(0.7 * before <= after <= before / 0.7)


def _change(before: ComplexArray, after: ComplexArray, share: float) -> float:
    """Largest change over channels, see ``_relative``."""
    return _relative(np.abs(after - before), np.abs(after), share)


def _relative(difference: FloatArray, size: FloatArray, share: float) -> float:
    """Largest difference over channels, relative to the channel, or to a share of the largest channel."""
    if not size.any():  # the force sits on a rigidly held node
        return 0.0
    return float(np.max(difference / np.maximum(size, share * size.max())))


def _folded(samples: FloatArray, samples_per_period: int, share: float) -> float:
    """Largest change of a harmonic by leaving out every other sample, relative to the channel's fundamental."""
    if samples_per_period % 2:
        return np.inf
    whole, half = (harmonics(samples[::step], samples_per_period // step) for step in (1, 2))
    return max(_relative(np.abs(few - many), np.abs(whole[0]), share) for few, many in zip(half, whole, strict=True))


def _spread(samples: FloatArray, samples_per_period: int) -> FloatArray:
    """(n_channels,) root-mean-square deviation of the fundamental from its mean over the periods."""
    periods = samples.reshape(-1, samples_per_period, samples.shape[1])
    if len(periods) == 1:  # as of most linear lines
        return np.zeros(samples.shape[1])
    return np.std([harmonics(period, samples_per_period)[0] for period in periods], axis=0)


def _does_not_repeat(frequency_hz: float, spread: float) -> str:
    return (
        f"{frequency_hz:.4f} Hz: the motion does not repeat, its fundamental spreads by {100 * spread:.2g} % "
        "from period to period; the standard error holds the spread"
    )


def _next_amplitude(tried: Sequence[tuple[float, float]]) -> float:
    """Where force and motion may agree, by the secant through the last two of (force, force by its motion) [N]."""
    force, wanted = tried[-1]
    if len(tried) == 1 or tried[-2][0] == force:
        return wanted
    before, wanted_before = tried[-2]
    slope = (wanted - wanted_before) / (force - before)
    step = (wanted - force) / (1 - slope) if slope < 0.9 else wanted - force
    return float(np.clip(force + step, force / 4, 4 * force))
