"""How a run is set up: the rig with its effects, and the plan of its sweep."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from rigtwin.rotor.effects.effect import SWITCH, Effect
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Plane, SupportKind, SweepDirection
from rigtwin.sim.sensors import SensorNoise

# What a rotor with a nonlinear effect needs: samples that keep harmonics from folding back (a law
# with corners excites all modes, up to 52 kHz on the shipped rotor, whose accelerations are large: at
# 50 Hz, 128 samples a period leave 50 % of error in the third harmonic of a clearance, and 1024 still
# 3 % of a bilinear support's), and periods that show whether the motion repeats. And, where the plan
# leaves it open, windows that are close together, because the rotor is stepped in time, which is
# exact to about the tolerance, and a glide from line to line, which starts no transients: without
# one a clearance's lines take two and a half times as many windows.
_NONLINEAR_SAMPLES, _NONLINEAR_RATE_HZ, _NONLINEAR_PERIODS = 128, 150e3, 4
_NONLINEAR = {"settle_time": 0.25, "settling_tolerance": 1e-3, "max_windows": 120, "glide_time": 0.5}
_SEARCH_TOLERANCE = 1e-2


class SetupError(ValueError):
    """A rig or a plan that cannot be carried out; the message says why."""


@dataclass(frozen=True)
class SweepPlan:
    """Which lines a sweep measures, and how accurately.

    A line is settled when what is left of the transient, estimated from five windows
    ``settle_time`` apart, is below ``settling_tolerance`` of the line's value in every channel.
    With a ``dwell`` nothing is checked: every line is read so long after its frequency was set.
    For a nonlinear rotor ``Rig.carry_out`` changes some of the defaults.
    """

    f_min_hz: float = 20.0
    f_max_hz: float = 400.0
    n_lines: int = 201
    refine: bool = True
    lines_per_half_power_band: int = 8
    force_amplitude: float = 1.0  # [N]; of an exciter at constant current the nominal one
    samples_per_period: int = 16  # at least
    sample_rate_hz: float = 0.0  # at least; of a nonlinear rotor only where fewer samples a period would fold
    periods: int = 1  # of the window a line is read from
    settle_time: float = 30.0  # [s], between windows
    glide_time: float = 0.0  # [s], from one settled line's frequency to the next one's
    settling_tolerance: float = 1e-5
    max_windows: int = 60
    noise: SensorNoise = field(default_factory=SensorNoise)
    direction: SweepDirection = "up"  # lines are measured in this order, each from the state the one before left
    dwell: float | None = None  # [s]
    accept_nonperiodic: bool = False  # keep, and mark, lines whose motion does not repeat from period to period

    def __post_init__(self) -> None:
        if not (math.isfinite(self.force_amplitude) and self.force_amplitude > 0):
            raise SetupError(
                f"force_amplitude must be a positive number of newtons, got {self.force_amplitude:g}: "
                "the response is referred to the force"
            )
        if not 0 < self.f_min_hz <= self.f_max_hz < math.inf:
            raise SetupError(f"need 0 < f_min_hz <= f_max_hz, got {self.f_min_hz:g} and {self.f_max_hz:g} Hz")
        if self.n_lines < 1 or self.periods < 1:
            raise SetupError(f"need at least one line and one period, got {self.n_lines} and {self.periods}")
        if self.direction not in ("up", "down"):
            raise SetupError(f'direction must be "up" or "down", got {self.direction!r}')
        if self.dwell is not None and not 0 < self.dwell < math.inf:
            raise SetupError(f"dwell must be a positive number of seconds, got {self.dwell:g}")

    def samples(self, frequency_hz: float) -> int:
        """Samples a period, at a frequency of the exciter."""
        return max(self.samples_per_period, math.ceil(self.sample_rate_hz / frequency_hz))

    def base_lines(self) -> FloatArray:
        """(n_lines,) evenly spaced frequencies before refinement [Hz], increasing.

        >>> SweepPlan(f_min_hz=10.0, f_max_hz=30.0, n_lines=3).base_lines()
        array([10., 20., 30.])
        """
        return np.linspace(self.f_min_hz, self.f_max_hz, self.n_lines)

    def in_order(self, frequency_hz: Iterable[float]) -> list[float]:
        """Frequencies as they are swept."""
        return sorted(map(float, frequency_hz), reverse=self.direction == "down")


@dataclass(frozen=True)
class Rig:
    """How the FMU is set up for a run: support, exciter, effects, and any further FMU parameters.

    Effects of the rotor are switched on in the FMU, those of the measurement chain act in the
    sweep. ``drift`` is the relative amount by which this run's frequency is higher than it reports.
    """

    support: SupportKind = "bearing"
    excitation_node: int = 2
    excitation_plane: Plane = "y"
    spin_rpm: float = 0.0
    parameters: dict[str, float | int | bool] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()
    drift: float = 0.0
    quantity: Literal["accelerance", "acceleration"] = "accelerance"
    sensor_planes: tuple[Plane, ...] = ()  # in which the accelerometers look; default the force's

    def __post_init__(self) -> None:
        if not (math.isfinite(self.drift) and abs(self.drift) < 0.5):
            raise SetupError(f"drift is a small relative change of frequency, got {self.drift:g}")
        for name in self.parameters:
            if name.endswith(f".{SWITCH}"):
                raise SetupError(f"{name} in parameters: the rig has to know its effects; give them as effects")

    @property
    def nonlinear(self) -> bool:
        """Whether an effect makes the response depend on level and history; rigid supports have no bearing effects."""
        bearings_held = self.support == "rigid"
        return any(e.family == "nonlinear" and not (bearings_held and e.location == "bearings") for e in self.effects)

    def start_values(self, effects: Sequence[Effect] | None = None) -> dict[str, float | int | bool]:
        """FMU start values of this set-up.

        Parameters
        ----------
        effects : that act now, where a sensor roves; default all

        Raises SetupError where one effect is given twice: the FMU has one of each.
        """
        acting = [effect for effect in (self.effects if effects is None else effects) if effect.in_fmu]
        ids = [effect.id for effect in acting]
        if twice := {name for name in ids if ids.count(name) > 1}:
            raise SetupError(f"{', '.join(sorted(twice))} is given twice; the FMU has one of each effect")
        return {
            "rigid_support": self.support == "rigid",
            "excitation_node": self.excitation_node,
            "excitation_plane": "yz".index(self.excitation_plane) + 1,
            "spin_speed": self.spin_rpm * np.pi / 30,
            **self.parameters,
            **{name: value for effect in acting for name, value in effect.start_values().items()},
        }

    def carry_out(self, plan: SweepPlan) -> SweepPlan:
        """The plan with this rig's raster and dwell, and with the settings that a nonlinear rotor needs."""
        changes = {name: value for effect in self.effects for name, value in effect.sweep_changes().items()}
        if "step_hz" in changes:
            steps = math.floor((plan.f_max_hz - plan.f_min_hz) / changes["step_hz"] + 1e-9)
            last = plan.f_min_hz + steps * changes["step_hz"]
            plan = replace(plan, f_max_hz=last, n_lines=steps + 1, refine=False)
        if "dwell_s" in changes:
            plan = replace(plan, dwell=changes["dwell_s"])
        if self.nonlinear:
            left_open = {name: v for name, v in _NONLINEAR.items() if getattr(plan, name) == getattr(SweepPlan, name)}
            plan = replace(
                plan,
                samples_per_period=max(plan.samples_per_period, _NONLINEAR_SAMPLES),
                sample_rate_hz=max(plan.sample_rate_hz, _NONLINEAR_RATE_HZ),
                periods=max(plan.periods, _NONLINEAR_PERIODS),
                accept_nonperiodic=True,
                **left_open,
            )
        return plan

    def search_plan(self, plan: SweepPlan) -> SweepPlan:
        """The carried-out plan for lines that only show where the resonances are."""
        plan = replace(plan, dwell=None)
        if not self.nonlinear:
            return plan
        return replace(plan, settling_tolerance=max(plan.settling_tolerance, _SEARCH_TOLERANCE))
