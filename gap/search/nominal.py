"""The nominal model: recalibrated, as near to all lines alike as it gets, or strained towards a cause."""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import NOMINAL
from rigtwin.gap.inference.problem import Problem
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition


@dataclass(frozen=True)
class NominalFits:
    """How the nominal model is fitted."""

    starts: int = 15  # values of the bearing stiffness along the range that suits the rig,
    steps: int = 8  # of a rough descent from each,
    every: int = 3  # on every third line, which tell enough to start from
    no_si_unit: float = 3.0  # factor on a response from which its unit cannot be one of SI
    anneal: tuple[float, ...] = (1.0, 0.3, 0.1, 0.02, 0.0)  # relative errors that are added in turn
    added: tuple[float, ...] = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)  # relative errors that make lines alike,
    within: float = 1.1  # and the mean square misfit that is within them
    anchors: int = 4  # how often the model is made anew at the tolerances that a fit has come to, at most
    near: float = 5.0  # close to the data: the nominal model's mean square misfit is below this,
    calm: float = 40.0  # and its nuisances are less far outside their priors, in standard deviations
    strain: tuple[float, ...] = (300.0, 100.0, 30.0, 10.0, 3.0, 1.0)  # factors of the nuisances' priors, in turn


NOMINAL_FITS = NominalFits()


def recalibrate(problem: Problem, u: FloatArray | None = None) -> Fit:
    """The nominal model with the bearing stiffness and the tolerances that suit the runs best, from where it is nearest
    roughly; u: these coordinates, where they are known already."""
    u = roughly(problem) if u is None else u
    near = problem.fit(NOMINAL, u, anneal=NOMINAL_FITS.anneal) if problem.with_k_b else problem.fit(NOMINAL, u)
    return problem.refine(near, anchors=NOMINAL_FITS.anchors)


def is_close(nominal: Fit) -> bool:
    """Whether the nominal model is close enough to the data for a search that begins with small changes of it."""
    outside = np.abs(nominal.nu / nominal.prior_std).max()
    return nominal.cost < NOMINAL_FITS.near * nominal.n_data and bool(outside < NOMINAL_FITS.calm)


def in_si(problem: Problem, u: FloatArray) -> Problem:
    """The same, with runs brought to SI whose unit is far from it: grids, rough descents and motions that data tell of
    know no gains.

    The unit is told by the nominal model where it is nearest roughly. What a fit of the lines takes for it may be
    anything where the gap is large.
    """
    gains = problem.unit(NOMINAL, u)[problem.nuisances.gain]
    far = np.abs(gains) > np.log(NOMINAL_FITS.no_si_unit)
    observed = [o.divide_by(np.exp(gain)) if f else o for o, gain, f in zip(problem.observed, gains, far, strict=True)]
    return Problem(problem.forward, observed, problem.model_error) if far.any() else problem


def roughly(problem: Problem) -> FloatArray:
    """(1,) coordinates of the nominal model where resonances and logarithms of responses are nearest, in any unit."""
    if not problem.with_k_b:
        return np.array([np.log(Condition.k_b)])
    starts = np.geomspace(*problem.forward.workshop.k_b, NOMINAL_FITS.starts)
    few = problem.thinned(NOMINAL_FITS.every)
    rough = [few.rough(NOMINAL, np.array([np.log(start)]), NOMINAL_FITS.steps) for start in starts]
    return min(rough, key=itemgetter(1))[0]


def fit_lines_alike(problem: Problem, fit: Fit, scale: float = 1.0) -> Fit:
    """A candidate that is as near to all lines alike as a relative error of the data lets it be.

    Where a gap is many times the noise, its drifts and tolerances would go any way to follow the few lines with the
    smallest errors, and its numbers with them. The least error is added that what is left is within: none without a
    gap. Drifts and tolerances begin anew, as those of the fit have followed these lines already.

    Parameters
    ----------
    fit : by the data's own errors
    scale : true over believed standard error
    """
    if fit.chi2 <= NOMINAL_FITS.within * fit.n_data * scale**2:
        return fit
    best, nu = fit, None
    for added in NOMINAL_FITS.added:
        nearer = problem.try_fit(fit.hypothesis, best.u, nu, anneal=(added,))
        if nearer is None or (nu is not None and nearer.chi2 > NOMINAL_FITS.within * nearer.n_data * scale**2):
            break
        best, nu = nearer, nearer.nu
    return best


def strain_towards(problem: Problem, cause: Fit) -> Fit:
    """The nominal model with its nuisances bent as far as they go towards what a cause explains.

    It starts with the cause's resonances, taken for drifts under priors far too wide, which are narrowed step by step.
    """
    nu, u = cause.nu.copy(), cause.u[:1]
    there, here = (problem.modals(cause.k_b, effects) for effects in (cause.effects, ()))
    for modal, plain, drift in zip(there, here, problem.nuisances.drift, strict=True):
        n = min(len(modal.frequencies_hz), len(plain.frequencies_hz))
        nu[drift][:n] += modal.frequencies_hz[:n] / plain.frequencies_hz[:n] - 1
    made = problem.loosened(NOMINAL_FITS.strain[0]).fit(NOMINAL, u, nu, anneal=(0.1, 0.02, 0.0))
    for factor in NOMINAL_FITS.strain[1:]:
        made = problem.loosened(factor).fit(NOMINAL, made.u, made.nu, anneal=(0.0,))
    return made
