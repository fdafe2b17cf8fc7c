"""What nobody knows exactly beside a candidate's numbers: gains, drifts, force levels, and tolerances of the rig.

Of every run the force gain (relative standard deviation ``gain_tolerance``), of every sensor its gain (half of that),
of every sensor in every run another gain (``gain_repeatability``), and of every resonance of every run a drift of its
frequency and of its damping, relative (``frequency_drift`` each) are unknown; so is whatever the workshop knows within
a tolerance. Where a rotor is nonlinear, the level of a run's force counts beside its gain (``gain_tolerance`` each): a
force sensor that errs changes both, an error of what is read changes the gain alone. They have Gaussian priors, are
fitted beside the candidate's numbers, and are integrated over in the evidence (Laplace).

A repeatability that nobody states is learned: its own prior is log-normal and broad, and each candidate has the one
that makes the runs most probable (type-II maximum likelihood [mackay1992]).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.gap.model.linear import MODES
from rigtwin.gap.model.run_model import RunModel
from rigtwin.gap.model.workshop import Workshop
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.sim.campaign import USUAL_DRIFT, Channel, Run


@dataclass(frozen=True)
class PriorWidths:
    """Standard deviations that the belief of a campaign does not give."""

    any_scale: float = 5.0  # of the logarithm of an arbitrary unit
    known_force: float = 1e-7  # relative, of a force that is known
    least_gain: float = 1e-6  # relative: a gain that is believed exactly would make the equations singular
    least_drift: float = 1e-7  # relative, for the same reason
    usual_gain: float = 1e-3  # relative repeatability of a sensor's gain where it is learned: the prior's median
    spread: float = 1.5  # standard deviation of the logarithm of a repeatability that is learned


PRIOR = PriorWidths()


@dataclass(frozen=True)
class Learned:
    """A repeatability that the runs tell: one standard deviation of many nuisances, its prior log-normal."""

    name: str  # key of [nominal]
    places: IntArray  # of the nuisances
    median: float

    def of(self, std: FloatArray) -> float:
        """Their common standard deviation among those of all nuisances."""
        return float(std[self.places[0]])

    def size(self, nu: FloatArray) -> float:
        """Root mean square of the nuisances, not below the median."""
        return max(float(np.sqrt(np.mean(nu[self.places] ** 2))), self.median)

    def is_unusual(self, std: float) -> bool:
        """Whether it is so large that it may stand in for what a model lacks: beyond 98 % of the prior."""
        return std > self.median * np.exp(2 * PRIOR.spread)

    def log_prior(self, std: float) -> float:
        """Logarithm of the prior density over that at the median."""
        return -((np.log(std / self.median) / PRIOR.spread) ** 2) / 2


class Nuisances:
    """Where each nuisance stands in the vector, and its prior."""

    def __init__(self, runs: Sequence[Run], workshop: Workshop):
        belief = workshop.belief
        self.sensors = sorted({channel for run in runs for channel in run.channels})
        own = [0 if belief.gain_repeatability == 0 else len(run.channels) for run in runs]
        sizes = [len(runs), len(self.sensors), len(workshop.tolerances), *[2 * MODES] * len(runs), len(runs), *own]
        ends = itertools.accumulate(sizes)
        parts = [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]
        self.gain, self.sensor, self.tolerance = parts[:3]
        self.drift = parts[3 : 3 + len(runs)]
        self.level = parts[3 + len(runs)]
        self.own_gain = parts[4 + len(runs) :]
        self.n = sum(sizes)
        self.gain_std = max(belief.gain_tolerance, PRIOR.least_gain)
        self.sensor_std = max(belief.gain_tolerance / 2, PRIOR.least_gain)
        self.drift_std = max(belief.expected_drift, PRIOR.least_drift)
        self.std = np.empty(self.n)
        self.std[self.gain] = [PRIOR.any_scale if run.quantity == "acceleration" else self.gain_std for run in runs]
        self.std[self.sensor] = self.sensor_std
        self.std[self.tolerance] = workshop.std
        drifts, owns = np.arange(self.drift[0].start, self.drift[-1].stop), np.arange(self.level.stop, self.n)
        self.std[drifts] = self.drift_std
        self.std[self.level] = self.gain_std
        self.std[owns] = PRIOR.usual_gain if belief.gain_repeatability is None else belief.gain_repeatability
        self.repeatability = {"frequency_drift": drifts, "gain_repeatability": owns}  # key of [nominal] -> places
        usual = {"frequency_drift": USUAL_DRIFT, "gain_repeatability": PRIOR.usual_gain}
        self.learned = tuple(
            Learned(key, places, usual[key])
            for key, places in self.repeatability.items()
            if getattr(belief, key) is None
        )

    def std_for(self, nu: FloatArray) -> FloatArray:
        """(n,) standard deviations, where they are learned at least as large as these nuisances."""
        std = self.std.copy()
        for each in self.learned:
            std[each.places] *= each.size(nu) / each.median
        return std

    def penalty(self, nu: FloatArray) -> float:
        """-2 times the logarithm of the prior of nuisances (n,), over that of none."""
        std = self.std_for(nu)
        total = float(np.sum((nu / std) ** 2))
        for each in self.learned:
            size = each.size(nu)
            total += 2 * len(each.places) * float(np.log(size / each.median)) - 2 * each.log_prior(size)
        return total

    @property
    def level_std(self) -> float:
        """Standard error of a run's level: that of the forces, or hardly any where they are believed."""
        return float(self.std[self.level].max(initial=PRIOR.known_force))

    def of_run(self, nu: FloatArray, run: int, modal: RunModel) -> tuple[Any, ...]:
        """What a run's model takes: drift of its resonances, tolerances of the rig, level where it is nonlinear."""
        own = self.drift_of(nu, run), nu[self.tolerance]
        return (*own, nu[self.level][run]) if modal.level_is_parameter else own

    def drift_of(self, nu: FloatArray, run: int) -> ComplexArray:
        """(MODES,) drifts of a run's resonances, of their dampings as imaginary parts."""
        frequency, damping = np.split(nu[self.drift[run]], 2)
        return frequency + 1j * damping

    def places_of_run(self, run: int, modal: RunModel) -> list[int]:
        """Where these stand in the vector, in the order of a model's derivatives by them."""
        level = [self.level.start + run] if modal.level_is_parameter else []
        own = (range(part.start, part.stop) for part in (self.drift[run], self.tolerance))
        return [*itertools.chain(*own), *level]

    def places_of_sensor(self, run: int, column: int, channel: Channel) -> list[int]:
        """Where the gains of a run's channel stand: in all runs, and in this one."""
        own = range(self.n)[self.own_gain[run]]
        return [self.sensor.start + self.sensors.index(channel), *own[column : column + 1]]

    def gains(self, nu: FloatArray, run: int, modal: RunModel) -> FloatArray:
        """(n_channels,) factor of a run's channels."""
        own = nu[self.own_gain[run]]
        return np.exp(nu[self.gain][run] + (own if own.size else 0.0)) * self.sensor_gains(nu, modal.run)

    def sensor_gains(self, nu: FloatArray, run: Run) -> FloatArray:
        """(n_channels,) the part of it that is the sensor's in all runs."""
        return np.exp(nu[self.sensor][[self.sensors.index(channel) for channel in run.channels]])
