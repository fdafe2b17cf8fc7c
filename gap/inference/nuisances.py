"""What nobody knows exactly beside a candidate's numbers: gains, drifts, force levels, and tolerances of the rig.

Of every run the force gain (relative standard deviation ``gain_tolerance``), of every sensor its gain (half of
that), of every sensor in every run another gain where sensors were mounted again (``gain_repeatability``), and of every
resonance of every run a drift (``frequency_drift``) are unknown; so are modulus, span and disk masses within a
workshop's tolerance. Where a rotor is nonlinear, the level of a run's force counts beside its gain
(``gain_tolerance`` each): a force sensor that errs changes both, an error of what is read changes the gain alone. They
have Gaussian priors, are fitted beside the candidate's numbers, and are integrated over in the evidence (Laplace).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.gap.model.linear import MODES, TOLERANCE, TOLERANCES
from rigtwin.gap.model.run_model import RunModel
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.sim.campaign import Channel, NominalBelief, Run


@dataclass(frozen=True)
class PriorWidths:
    """Standard deviations that the belief of a campaign does not give."""

    any_scale: float = 5.0  # of the logarithm of an arbitrary unit
    known_force: float = 1e-7  # relative, of a force that is known
    least_gain: float = 1e-6  # relative: a gain that is believed exactly would make the equations singular
    least_drift: float = 1e-7  # relative, for the same reason


PRIOR = PriorWidths()


class Nuisances:
    """Where each nuisance stands in the vector, and its prior."""

    def __init__(self, runs: Sequence[Run], belief: NominalBelief):
        self.sensors = sorted({channel for run in runs for channel in run.channels})
        own = [len(run.channels) if belief.gain_repeatability else 0 for run in runs]
        sizes = [len(runs), len(self.sensors), len(TOLERANCES), *[MODES] * len(runs), len(runs), *own]
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
        self.std[self.tolerance] = TOLERANCE
        self.std[self.drift[0].start : self.drift[-1].stop] = self.drift_std
        self.std[self.level] = self.gain_std
        self.std[self.level.stop :] = belief.gain_repeatability or 0.0

    @property
    def level_std(self) -> float:
        """Standard error of a run's level: that of the forces, or hardly any where they are believed."""
        return float(self.std[self.level].max(initial=PRIOR.known_force))

    def of_run(self, nu: FloatArray, run: int, modal: RunModel) -> tuple[Any, ...]:
        """What a run's model takes: drift of its resonances, tolerances of the rig, level where it is nonlinear."""
        own = nu[self.drift[run]], nu[self.tolerance]
        return (*own, nu[self.level][run]) if modal.level_is_parameter else own

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
