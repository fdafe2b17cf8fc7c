"""The virtual test rig: a stepped sine through an FMU, settled, detected, refined at resonances."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim.campaign import Channel, ComplexArray, FloatArray, Plane, Run, SupportKind
from sim.detection import HARMONICS, Phasors, detect
from sim.modal_fit import half_power_band, resonances
from sim.sensors import SensorNoise
from sim.session import FmuSession


class NotSettledError(RuntimeError):
    """A line did not settle within the allowed time; ``frequency_hz`` and ``estimate`` say where."""

    def __init__(self, message: str, *, frequency_hz: float, estimate: float):
        super().__init__(message)
        self.frequency_hz = frequency_hz
        self.estimate = estimate


@dataclass(frozen=True)
class SweepPlan:
    """What to sweep and how well.

    A line is settled when what is left of the transient, estimated from five windows
    ``settle_time`` apart, is below ``settling_tolerance`` of the line's value in every channel.
    """

    f_min_hz: float = 20.0
    f_max_hz: float = 400.0
    n_lines: int = 201
    refine: bool = True
    lines_per_half_power_band: int = 8
    force_amplitude: float = 1.0  # [N]
    samples_per_period: int = 16
    periods: int = 1  # of one detection window
    settle_time: float = 30.0  # [s], between windows
    settling_tolerance: float = 1e-5
    max_windows: int = 60
    noise: SensorNoise = field(default_factory=SensorNoise)

    def base_lines(self) -> FloatArray:
        """(n_lines,) evenly spaced frequencies before refinement [Hz]."""
        return np.linspace(self.f_min_hz, self.f_max_hz, self.n_lines)


@dataclass(frozen=True)
class Rig:
    """How the FMU is set up for a run: support, exciter, and any further FMU parameters."""

    support: SupportKind = "bearing"
    excitation_node: int = 2
    excitation_plane: Plane = "y"
    spin_rpm: float = 0.0
    parameters: dict[str, float | int | bool] = field(default_factory=dict)

    def start_values(self) -> dict[str, float | int | bool]:
        """FMU start values of this set-up."""
        return {
            "rigid_support": self.support == "rigid",
            "excitation_node": self.excitation_node,
            "excitation_plane": "yz".index(self.excitation_plane) + 1,
            "spin_speed": self.spin_rpm * np.pi / 30,
            **self.parameters,
        }


@dataclass(frozen=True)
class Line:
    """One settled frequency line; phasors per force, channels in the order of the sweep."""

    frequency_hz: float
    response: ComplexArray  # (n_harmonics, n_channels) per newton
    std: FloatArray  # (n_channels,) standard error: noise and remaining transient
    transient: float  # estimated remaining transient, largest over channels, relative [-]
    drift_per_period: float  # relative change per period between the last two windows [-]
    windows: int
    force: complex  # phasor of the applied force at the window's first sample [N]


@dataclass(frozen=True)
class Sweep:
    """A run, and how well each of its lines had settled."""

    run: Run
    lines: tuple[Line, ...]


# Changes of a phasor this small are round-off of the FMU's propagator, not a decaying transient.
_ROUND_OFF = 1e-7

# Windows from which a transient is estimated.
_WINDOWS = 5

Progress = Callable[[int], None]


def sweep(session: FmuSession, rig: Rig, plan: SweepPlan, progress: Progress | None = None) -> Sweep:
    """Sweep upwards from rest, then refine round each resonance.

    Parameters
    ----------
    session : an open RotorRig FMU
    rig : support, exciter, parameters
    plan : lines, settling, noise
    progress : called with the number of lines measured so far

    Raises
    ------
    NotSettledError : a line did not settle
    """
    measurement = _Measurement(session, rig, plan, progress)
    measurement.at(plan.base_lines())
    if plan.refine:
        measurement.refine()
    return measurement.result()


def measure_lines(session: FmuSession, rig: Rig, plan: SweepPlan, frequency_hz: Sequence[float] | FloatArray) -> Sweep:
    """Measure exactly these lines, from rest, in increasing order."""
    measurement = _Measurement(session, rig, plan, None)
    measurement.at(np.asarray(frequency_hz, dtype=float))
    return measurement.result()


class _Measurement:
    """A running sweep: the lines measured so far, by frequency."""

    def __init__(self, session: FmuSession, rig: Rig, plan: SweepPlan, progress: Progress | None):
        self._session, self._rig, self._plan = session, rig, plan
        self._progress = progress or (lambda count: None)
        plane = rig.excitation_plane
        names = [v for v in session.variables if v.endswith(f".acceleration_{plane}")]
        self._channels = tuple(Channel(int(name.split(".")[0].removeprefix("node_")), plane) for name in names)
        self._outputs = [*names, "force_applied"]
        self._lines: dict[float, Line] = {}
        session.start({**rig.start_values(), "force_amplitude": plan.force_amplitude})

    def at(self, frequencies: FloatArray | Sequence[float]) -> None:
        """Measure the lines that are not there yet, upwards."""
        for f in np.sort(np.asarray(frequencies, dtype=float)):
            if float(f) not in self._lines:
                self._lines[float(f)] = self._settled_line(float(f))
                self._progress(len(self._lines))

    def refine(self) -> None:
        """Add lines until every resonance is resolved, then lay a raster over its band."""
        for peak in resonances(*self._magnitude()):
            centre, width = self._close_in(peak)
            half = self._plan.lines_per_half_power_band // 2
            inner = np.arange(-half, half + 1) / (2 * half)
            outer = np.array([-8.0, -4.0, -2.0, -1.0, 1.0, 2.0, 4.0, 8.0])
            raster = centre + width * np.concatenate([inner, outer])
            self.at([f for f in raster if self._plan.f_min_hz <= f <= self._plan.f_max_hz])

    def result(self) -> Sweep:
        """All lines in order."""
        lines = tuple(self._lines[f] for f in sorted(self._lines))
        responses = np.array([line.response for line in lines])  # (n_freq, n_harmonics, n_channels)
        run = Run(
            frequency_hz=np.array([line.frequency_hz for line in lines]),
            H=responses[:, 0],
            channels=self._channels,
            support=self._rig.support,
            std=np.array([line.std for line in lines]),
            harmonics={order: responses[:, k] for k, order in enumerate(HARMONICS) if order > 1},
            excitation_node=self._rig.excitation_node,
            excitation_plane=self._rig.excitation_plane,
            force_amplitude_N=self._plan.force_amplitude,
            spin_rpm=self._rig.spin_rpm,
            sweep="up",
            name=f"{self._rig.support} support, {self._plan.force_amplitude:g} N",
        )
        return Sweep(run, lines)

    # -- refinement ----------------------------------------------------------------------------

    def _magnitude(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies and root-sum-square displacement per force over all channels."""
        f = np.array(sorted(self._lines))
        a = np.array([np.linalg.norm(self._lines[x].response[0]) for x in f])
        return f, a / f**2

    def _close_in(self, peak: float) -> tuple[float, float]:
        """Bisect towards a maximum until its half-power band is seen.

        Returns
        -------
        resonance frequency and half-power bandwidth [Hz]
        """
        for _ in range(40):
            f, magnitude = self._magnitude()
            here = int(np.flatnonzero(f == peak)[0])
            if here in (0, len(f) - 1):
                break
            left, right = f[here - 1], f[here + 1]
            if min(magnitude[here - 1], magnitude[here + 1]) > 0.8 * magnitude[here] or right - left < 1e-7 * peak:
                break
            self.at([(left + peak) / 2, (peak + right) / 2])
            f, magnitude = self._magnitude()
            near = (f >= left) & (f <= right)
            peak = float(f[near][np.argmax(magnitude[near])])
        return half_power_band(*self._magnitude(), peak)

    # -- one line ------------------------------------------------------------------------------

    def _settled_line(self, frequency: float) -> Line:
        """Step to a frequency and take windows until the transient is estimated to be gone."""
        self._session.set({"force_frequency": frequency})
        history: list[Phasors] = []
        estimate = np.inf
        while len(history) < self._plan.max_windows:
            self._session.step(self._plan.settle_time)
            history.append(_per_force(detect(self._window(frequency, periods=1), self._plan.samples_per_period)))
            estimate = _remaining_transient(history)
            if len(history) >= 3 and estimate <= self._plan.settling_tolerance:
                return self._line(frequency, self._window(frequency, self._plan.periods), history, estimate)
        raise NotSettledError(
            f"{frequency:.4f} Hz: {estimate:.1e} of the response is still transient after "
            f"{len(history) * self._plan.settle_time:.0f} s; raise settle_time, or the damping if it is too low",
            frequency_hz=frequency,
            estimate=estimate,
        )

    def _window(self, frequency: float, periods: int) -> FloatArray:
        n = self._plan.samples_per_period
        return self._session.sample(self._outputs, 1 / (n * frequency), n * periods)

    def _line(self, frequency: float, window: FloatArray, history: list[Phasors], estimate: float) -> Line:
        noisy = window.copy()
        stream = ("rigid", "bearing").index(self._rig.support), round(1e9 * frequency)
        noisy[:, :-1] = self._plan.noise.add(window[:, :-1], stream)
        detected = detect(noisy, self._plan.samples_per_period)
        phasors = _per_force(detected)
        periods = self._plan.settle_time * frequency + 1
        return Line(
            frequency_hz=frequency,
            response=phasors.amplitude,
            std=np.hypot(phasors.std, min(estimate, 1.0) * np.abs(phasors.amplitude[0])),
            transient=estimate,
            drift_per_period=_relative_change(history[-2], history[-1]) / periods,
            windows=len(history),
            force=complex(detected.amplitude[0, -1]),
        )


def _per_force(phasors: Phasors) -> Phasors:
    """Response phasors referred to the force in the last channel, harmonics to its k-th power's phase."""
    force = phasors.amplitude[0, -1]
    turn = np.array([abs(force) * (force / abs(force)) ** k for k in HARMONICS])
    return replace(phasors, amplitude=phasors.amplitude[:, :-1] / turn[:, None], std=phasors.std[:-1] / abs(force))


def _relative_change(before: Phasors, after: Phasors) -> float:
    """Largest change over channels, relative to the channel, or to 1e-3 of the largest channel."""
    size = np.abs(after.amplitude[0])
    if not size.any():  # the force sits on a rigidly held node
        return 0.0
    reference = np.maximum(size, 1e-3 * size.max())
    return float(np.max(np.abs(after.amplitude[0] - before.amplitude[0]) / reference))


def _remaining_transient(windows: list[Phasors]) -> float:
    """What is left of the transient after the last of equally spaced windows, inf where it is not known.

    A transient that decays by the factor r from window to window changes the phasor by d, then by
    r d; what is left after the last window is at most d r / (1 - r), with d the last change. Modes
    beat with the force and with each other, so that a change may be small by chance: of the last
    three changes the largest counts, of their decays the slowest, which takes five windows. Where
    nothing but round-off changes, three windows do.
    """
    changes = [_relative_change(*pair) for pair in itertools.pairwise(windows[-_WINDOWS:])]
    if len(changes) >= 2 and max(changes[-2:]) <= _ROUND_OFF:
        return max(changes[-2:])
    if len(changes) < _WINDOWS - 1:
        return np.inf
    ratio = max(after / before for before, after in itertools.pairwise(changes))
    return np.inf if ratio >= 1 else max(changes[1:]) * ratio / (1 - ratio)
