"""What a fit takes for gains, for the workshop's tolerances and for repeatabilities, each beside what was known before.

A number x > 0 that is fitted by its logarithm has the standard error x times that of the logarithm. A repeatability
sigma of n nuisances nu, each known to +- s after the data, is told by gamma = sum(1 - s^2 / sigma^2) of them
[mackay1992]: ln sigma has the variance 1 / (2 gamma + 1 / its prior's variance), and where sigma is stated the data
say sigma^2 = sum(nu^2) / gamma.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rigtwin.gap.document import Calibrated, Calibration, Estimate
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.nuisances import PRIOR
from rigtwin.gap.inference.posterior import posterior
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import acting, nonlinear
from rigtwin.rotor.model.arrays import FloatArray, IntArray

_REPEATABILITY = {
    "frequency_drift": "drift of a resonance's frequency and damping from run to run",
    "gain_repeatability": "change of a sensor's gain from run to run",
}


def calibration_of(problem: Problem, fit: Fit, scale: float) -> Calibration:
    """What a fit takes.

    Parameters
    ----------
    scale : true over believed standard error of the data
    """
    nuisances = problem.nuisances
    std = posterior(problem, fit, scale).std[len(fit.u) :]
    return Calibration(
        sensor_gain=dict(zip(map(str, nuisances.sensors), map(float, np.exp(fit.nu[nuisances.sensor])), strict=True)),
        tolerance=dict(zip(problem.forward.workshop.names, map(float, fit.nu[nuisances.tolerance]), strict=True)),
        numbers=tuple(_tolerances(problem, fit, std)),
        gains=tuple(_gains(problem, fit, std)),
        repeatability=tuple(_repeatabilities(problem, fit, std)),
    )


def _tolerances(problem: Problem, fit: Fit, std: FloatArray) -> Iterator[Calibrated]:
    places = problem.nuisances.tolerance
    for each, nu, error in zip(problem.forward.workshop.tolerances, fit.nu[places], std[places], strict=True):
        prior = _estimate(each.value, each.std, each.unit)
        posterior = _estimate(each.value * math.exp(nu), float(error), each.unit)
        yield Calibrated(each.name, each.words or each.name.replace("_", " "), prior, posterior)


def _gains(problem: Problem, fit: Fit, std: FloatArray) -> Iterator[Calibrated]:
    """Of each sensor and of each run, and levels of runs whose rotor is nonlinear."""
    nuisances = problem.nuisances
    names = {
        place: (f"sensor_gain.{channel}", f"gain of the sensor {channel}")
        for place, channel in enumerate(nuisances.sensors, nuisances.sensor.start)
    }
    for r, run in enumerate(problem.runs):
        name = run.name or str(r + 1)
        names[nuisances.gain.start + r] = f"run_gain.{name}", f"gain of the run {name}"
        if nonlinear(acting(fit.effects, run.support)):
            names[nuisances.level.start + r] = f"run_level.{name}", f"force level of the run {name}"
    for place, (name, words) in names.items():
        known = nuisances.std[place]
        prior = _estimate(1.0, math.nan if known >= PRIOR.any_scale else float(known))
        yield Calibrated(name, words, prior, _estimate(math.exp(fit.nu[place]), float(std[place])))


def _repeatabilities(problem: Problem, fit: Fit, std: FloatArray) -> Iterator[Calibrated]:
    nuisances = problem.nuisances
    learned = {each.name: each for each in nuisances.learned}
    for name, places in nuisances.repeatability.items():
        if not places.size:  # stated to be none
            continue
        told, words = _told(fit, std, places), _REPEATABILITY[name]
        if each := learned.get(name):
            spread = 1 / math.sqrt(2 * told + 1 / PRIOR.spread**2)
            found = _estimate(each.of(fit.prior_std), spread)
            yield Calibrated(name, words, _estimate(each.median, PRIOR.spread), found, learned=True)
        else:
            prior = Estimate(float(nuisances.std[places[0]]))
            yield Calibrated(name, words, prior, _from_data(fit, told, places) if told >= 1 else prior)


def _from_data(fit: Fit, told: float, places: IntArray) -> Estimate:
    """A repeatability by these nuisances alone, of which so many are told."""
    return _estimate(math.sqrt(float(np.sum(fit.nu[places] ** 2)) / told), 1 / math.sqrt(2 * told))


def _told(fit: Fit, std: FloatArray, places: IntArray) -> float:
    """How many of these nuisances the data tell."""
    return float(np.sum(np.maximum(1 - (std[places] / fit.prior_std[places]) ** 2, 0.0)))


def _estimate(value: float, of_logarithm: float, unit: str = "1") -> Estimate:
    return Estimate(value, value * of_logarithm, unit)
