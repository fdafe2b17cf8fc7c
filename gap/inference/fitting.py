"""The joint fit of a candidate's numbers and the nuisances, by damped Gauss-Newton steps.

These functions take the problem first; ``Problem`` has them as its methods. What a nuisance takes is judged by its
prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.gap.inference.descent import damped_step, minimise, shorten_logarithms, soften
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B, Hypothesis
from rigtwin.gap.inference.modes import resonance_residual
from rigtwin.gap.inference.nuisances import PRIOR, Learned
from rigtwin.gap.inference.observed import Observed, derivatives, misfit, weights_and_residuals
from rigtwin.gap.model.run_model import RunModel
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rigtwin.shared_work import seconds_left

if TYPE_CHECKING:
    from rigtwin.gap.inference.problem import Problem

Moved = tuple[float, list[RunModel]]  # a small step of one coordinate, and the models there
Slopes = tuple[FloatArray, FloatArray, IntArray]  # residuals, (n_columns, n_residuals) derivatives, places of columns


@dataclass(frozen=True)
class JointFit:
    """How starts are brought near the data, and how far steps are damped."""

    rough_error: float = 0.3  # of a rough start's logarithms, that counts as one
    silent: float = 1e-5  # share of a run's largest value below which a logarithm says nothing
    dampings: tuple[float, ...] = (1e-12, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e3)  # Marquardt's, tried in turn
    enough: float = 0.02  # misfit that a step must take away for another one
    enough_relative: float = 1e-5  # the same over the misfit and the penalty,
    enough_before: float = 1e-3  # and where an error is added, which is only the way to the next one
    lessons: int = 4  # how often repeatabilities are learned and the fit goes on, at most,
    learned: float = 0.1  # until their logarithms change by less


JOINT = JointFit()

# -- rough: resonances or logarithms, without nuisances --------------------------------------------------------------


def rough(problem: Problem, hypothesis: Hypothesis, u: FloatArray, steps: int) -> tuple[FloatArray, float]:
    """Bring a start near the data: bounded least squares of resonances, or of ln(model / data) where runs show none.

    Returns
    -------
    (1 + n_free,) coordinates and the cost per value
    """
    compare = _of_resonances if shows_resonances(problem, hypothesis) else _logarithms

    def residual(x: FloatArray) -> FloatArray | None:
        modals = problem.try_modals(hypothesis, x)
        if modals is None:
            return None
        parts = [compare(problem, observed, m) for observed, m in zip(problem.observed, modals, strict=True)]
        return soften(np.concatenate(parts))

    steps = steps if seconds_left() > 0 else 0
    return minimise(residual, u, problem.ends(hypothesis), hypothesis.log, problem.with_k_b, steps)


def shows_resonances(problem: Problem, hypothesis: Hypothesis) -> bool:
    """Whether the runs show resonances, which are the rotor's own under these effects."""
    effects = [term.effect for term in hypothesis.terms]
    moved = any(e.needs_exciter_current or e.sweep_changes is not Effect.sweep_changes for e in effects)
    linear = all(e.family != "nonlinear" for e in effects)
    return linear and not moved and all(o.resonances for o in problem.observed)


def _of_resonances(problem: Problem, observed: Observed, modal: RunModel) -> FloatArray:
    """Misfit of one run's resonances."""
    assert modal.as_linear is not None
    return resonance_residual(modal.as_linear, observed.resonances, problem.forward.workshop.std)


def _logarithms(problem: Problem, observed: Observed, modal: RunModel) -> FloatArray:
    """ln(model / data) of one run over its error: of the magnitudes, and of the phases where these were measured."""
    y, H = observed.run.H, modal.response()
    usable = np.isfinite(y) & (np.abs(y) > JOINT.silent * np.nanmax(np.abs(y))) & (np.abs(H) > 0)
    usable &= observed.std < 0.5 * np.abs(y)
    ratio = np.where(usable, H / np.where(usable, y, 1.0), 1.0)
    log = np.log(np.abs(ratio))
    if observed.run.quantity == "acceleration" and usable.any():
        log = log - np.median(log[usable])
    magnitudes = (np.where(usable, log, 0.0) / JOINT.rough_error).ravel()
    if observed.run.magnitude_only:
        return magnitudes
    return np.concatenate([magnitudes, (np.angle(ratio) / JOINT.rough_error).ravel()])


# -- fine: the data's own errors, nuisances included ---------------------------------------------------


def fit(
    problem: Problem,
    hypothesis: Hypothesis,
    u: FloatArray,
    nu: FloatArray | None = None,
    *,
    anneal: Sequence[float] = (0.1, 0.02, 0.0),
    steps: int = 12,
) -> Fit:
    """Gauss-Newton steps, damped, with what is left of a rough error added to the data's own.

    Parameters
    ----------
    u : (1 + n_free,) start
    nu : nuisances to start from, default none but the scale of an arbitrary unit
    anneal : relative errors that are added in turn; the last one should be zero
    steps : at each of them, at most

    Raises
    ------
    ValueError : the start has no model
    """
    u = u.copy()
    nu = unit(problem, hypothesis, u) if nu is None else nu.copy()
    std, descent = problem.nuisances.std_for(nu), _Descent(problem, hypothesis)
    for added in anneal:
        at = descent.run(u, nu, steps, added, std)
        u, nu = at.u, at.nu
    for _ in range(JOINT.lessons if problem.nuisances.learned and steps else 0):
        before, std = std, learn(problem, hypothesis, at, std)
        if np.abs(np.log(std / before)).max() < JOINT.learned:
            break
        at = descent.run(at.u, at.nu, steps, anneal[-1], std)
    n = sum(o.n_values for o in problem.observed)
    told = sum(each.log_prior(each.of(std)) for each in problem.nuisances.learned)
    penalty = float(np.sum((at.nu / std) ** 2))
    return Fit(
        hypothesis, at.u, at.nu, at.chi2, penalty, at.hessian, n, std, problem.with_k_b, anneal[-1], log_prior=told
    )


def refine(problem: Problem, fit: Fit, *, anchors: int, steps: int = 12) -> Fit:
    """The same candidate, fitted on; its model is made anew, exact, at the tolerances that the fit has come to.

    Parameters
    ----------
    anchors : how often that is done, at most
    steps : of each fit, at most
    """
    for _ in range(anchors):
        problem = problem.around(fit)
        further = try_fit(problem, fit.hypothesis, fit.u, fit.nu, anneal=(0.0,), steps=steps)
        if further is None:
            break
        fit = further
        if problem.forward.settled(fit.nu[problem.nuisances.tolerance]):
            break
    return fit


def try_fit(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray | None, **how: Any) -> Fit | None:
    """``fit``, or None where a start or a step has no model, or the time of the search is up."""
    if seconds_left() <= 0:
        return None
    try:
        return fit(problem, hypothesis, u, nu, **how)
    except (ValueError, np.linalg.LinAlgError):
        return None


def unit(problem: Problem, hypothesis: Hypothesis, u: FloatArray) -> FloatArray:
    """(n_nuisances,) nuisances at a start: none but the tolerances at which the model is exact, and the gain of a run
    whose unit is arbitrary."""
    nu = np.zeros(problem.nuisances.n)
    nu[problem.nuisances.tolerance] = problem.forward.anchor.values
    for r, observed in enumerate(problem.observed):
        if observed.run.quantity == "acceleration":
            modal = problem.modal(r, K_B.value(u[0]), hypothesis.effects(u[1:]))
            size, model = np.abs(np.nan_to_num(observed.run.H)), np.abs(modal.response())
            usable = observed.valid & (size > 0) & (model > 0)
            if usable.any():
                nu[problem.nuisances.gain][r] = np.median(np.log(size[usable] / model[usable]))
    return nu


@dataclass(frozen=True)
class _Point:
    """Where a descent is, with the misfit there and its derivatives by (u, nu)."""

    u: FloatArray
    nu: FloatArray
    chi2: float
    gradient: FloatArray  # -1/2 of the misfit's
    hessian: FloatArray  # 1/2 of the misfit's


class _Descent:
    """Steps of one candidate."""

    def __init__(self, problem: Problem, hypothesis: Hypothesis):
        self.problem, self.hypothesis = problem, hypothesis
        self.least = 1  # place of the least damping that is tried after the whole step: one less than helped last

    def run(self, u: FloatArray, nu: FloatArray, steps: int, added: float, std: FloatArray) -> _Point:
        """Where the steps end, with a relative error added to the data's own, and priors of these widths."""
        self.added, self.prior = added, 1 / std**2
        here = self._linearise(u, nu)
        if here is None:
            raise ValueError(f"{self.hypothesis}: no model at the start")
        total = here.chi2 + float(nu**2 @ self.prior)
        for _ in range(steps):
            lower = self._step(here, total)
            if lower is None:
                break
            u, nu, value = lower
            linear = self._linearise(u, nu)
            if linear is None:
                break
            here = linear
            gained, total = total - value, here.chi2 + float(nu**2 @ self.prior)
            enough = max(JOINT.enough, (JOINT.enough_before if added else JOINT.enough_relative) * total)
            if gained < enough or seconds_left() <= 0:
                break
        return here

    def _step(self, at: _Point, before: float) -> tuple[FloatArray, FloatArray, float] | None:
        """A point of a lower cost, and its cost; None where no damping leads to one."""
        n_u, ends = len(at.u), self.problem.ends(self.hypothesis)
        A, g = at.hessian.copy(), at.gradient.copy()
        A[range(n_u, len(A)), range(n_u, len(A))] += self.prior
        g[n_u:] -= self.prior * at.nu
        active = held(self.problem, at.u, g[:n_u], ends)
        # The whole step first: along a valley of nuisances any damping by the diagonal hardly moves.
        for place in (0, *range(self.least, len(JOINT.dampings))):
            step = damped_step(A, g, JOINT.dampings[place], active)
            own = np.where(self.hypothesis.log, shorten_logarithms(step[:n_u]), step[:n_u])
            trial_u = np.clip(at.u + own, ends[:, 0], ends[:, 1])
            trial_nu = at.nu + step[n_u:]
            value = misfit_of(self.problem, self.hypothesis, trial_u, trial_nu, self.added)
            value += float(trial_nu**2 @ self.prior)
            if value < before:
                self.least = max(place - 1, 1) if place else self.least
                return trial_u, trial_nu, value
        return None

    @np.errstate(over="ignore", invalid="ignore")  # a trial may lie anywhere
    def _linearise(self, u: FloatArray, nu: FloatArray) -> _Point | None:
        """The misfit at a point and its derivatives; None without a model."""
        parts = linear_parts(self.problem, self.hypothesis, u, nu, self.added)
        if parts is None:
            return None
        n = len(u) + self.problem.nuisances.n
        chi2, gradient, hessian = 0.0, np.zeros(n), curvature(parts, n)
        for residual, J, where in parts:
            chi2 += float(residual @ residual)
            gradient[where] += J @ residual
        return _Point(u, nu, chi2, gradient, hessian) if np.isfinite(hessian).all() else None


def learn(problem: Problem, hypothesis: Hypothesis, at: _Point, std: FloatArray) -> FloatArray:
    """(n_nuisances,) widths of the priors where each repeatability that is learned makes the runs most probable.

    The misfit is taken for quadratic, everything else follows. With S its curvature by the nuisances x of one
    repeatability sigma, and h = S x at its minimum, ln p(sigma) up to a constant is, over the eigenvalues l of S,

        1/2 sum h^2 / (l + 1/sigma^2) - 1/2 sum ln(l + 1/sigma^2) - n ln sigma + the logarithm of its prior.
    """
    std, n_u = std.copy(), len(at.u)
    stays = held(problem, at.u, at.gradient[:n_u], problem.ends(hypothesis))
    width = np.ptp(hypothesis.ends, axis=1)
    for each in problem.nuisances.learned:
        prior = np.concatenate([2 * np.pi / width**2, 1 / std**2])
        prior[:n_u][stays] = 1e30  # a coordinate that does not move
        own = n_u + each.places
        others = np.setdiff1d(np.arange(len(prior)), own)
        A, g = at.hessian + np.diag(prior), at.gradient.copy()
        g[n_u:] -= at.nu / std**2
        tied = np.linalg.solve(A[np.ix_(others, others)], np.column_stack([at.hessian[np.ix_(others, own)], g[others]]))
        S = at.hessian[np.ix_(own, own)] - at.hessian[np.ix_(own, others)] @ tied[:, :-1]
        h = at.gradient[own] - at.hessian[np.ix_(own, others)] @ tied[:, -1] + S @ at.nu[each.places]
        std[each.places] = _most_probable(each, *np.linalg.eigh((S + S.T) / 2), h)
    return std


def _most_probable(each: Learned, values: FloatArray, axes: FloatArray, h: FloatArray) -> float:
    """See ``learn``."""
    sizes = each.median * np.exp(PRIOR.spread * np.linspace(-4, 4, 161))
    told = np.maximum(values, 0.0) + 1 / sizes[:, None] ** 2
    log = np.sum((axes.T @ h) ** 2 / told - np.log(told), axis=1) / 2 - len(values) * np.log(sizes)
    return float(sizes[np.argmax(log + [each.log_prior(size) for size in sizes])])


def held(problem: Problem, u: FloatArray, gradient: FloatArray, ends: FloatArray) -> BoolArray:
    """(1 + n_free,) coordinates that stay: at an end of their range, or without influence."""
    margin = 1e-9 * (ends[:, 1] - ends[:, 0])
    stays = ((u <= ends[:, 0] + margin) & (gradient < 0)) | ((u >= ends[:, 1] - margin) & (gradient > 0))
    if not problem.with_k_b:
        stays[0] = True
    return stays


# -- misfit and its derivatives ------------------------------------------------------------------------


def cost(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, added: float = 0.0) -> float:
    """Misfit and penalty at a point, with a relative error added to the data's own; inf without a model."""
    return misfit_of(problem, hypothesis, u, nu, added) + problem.nuisances.penalty(nu)


@np.errstate(over="ignore", invalid="ignore")  # a trial may lie anywhere
def misfit_of(problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, added: float = 0.0) -> float:
    """Misfit at a point, with a relative error added to the data's own; inf without a model."""
    modals, nuisances = problem.try_modals(hypothesis, u), problem.nuisances
    if modals is None:
        return np.inf
    total = 0.0
    for r, (observed, modal) in enumerate(zip(problem.observed, modals, strict=True)):
        H = modal.response(*nuisances.of_run(nu, r, modal)) * nuisances.gains(nu, r, modal)
        total += float(misfit(observed, H, problem.total_error(added)))
    return total if np.isfinite(total) else np.inf


def costs(problem: Problem, fit: Fit, changes: Sequence[ComplexArray], added: float) -> FloatArray:
    """(k,) ``cost`` of a fit whose prediction changes, of every run (k, n_freq, n_channels)."""
    total = np.full(len(changes[0]), problem.nuisances.penalty(fit.nu))
    for observed, H, change in zip(problem.observed, problem.predict(fit), changes, strict=True):
        total += misfit(observed, H + change, problem.total_error(added))
    return total


def linear_parts(
    problem: Problem, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, added: float
) -> list[Slopes] | None:
    """Of every run: residuals, their derivatives, and which of (u, nu) each column is; None without a model."""
    modals = problem.try_modals(hypothesis, u)
    if modals is None:
        return None
    ends = problem.ends(hypothesis)
    moved = [_step_aside(problem, hypothesis, u, j, ends[j, 1]) for j in range(len(u))]
    error = problem.total_error(added)
    return [_slopes(problem, r, modal, moved, nu, error) for r, modal in enumerate(modals)]


def curvature(parts: Sequence[Slopes], n: int) -> FloatArray:
    """(n, n) half the misfit's, by all of (u, nu)."""
    total = np.zeros((n, n))
    for _, J, where in parts:
        total[np.ix_(where, where)] += J @ J.T
    return total


def _step_aside(problem: Problem, hypothesis: Hypothesis, u: FloatArray, j: int, high: float) -> Moved:
    """A small step of one coordinate, not beyond its high end, and the models there; 0 where it has none."""
    if j == 0 and not problem.with_k_b:
        return 0.0, []
    free = hypothesis.coordinates[j]
    step = free.step * (free.ends[1] - free.ends[0])
    if u[j] + step > high:
        step = -step
    v = u.copy()
    v[j] += step
    modals = problem.try_modals(hypothesis, v)
    return (0.0, []) if modals is None else (step, modals)


def _slopes(problem: Problem, r: int, modal: RunModel, moved: Sequence[Moved], nu: FloatArray, added: float) -> Slopes:
    """``linear_parts`` of one run, with its models after a small step of each coordinate."""
    n_u, nuisances, observed = len(moved), problem.nuisances, problem.observed[r]
    own, gains = nuisances.of_run(nu, r, modal), nuisances.gains(nu, r, modal)
    H0, D = modal.with_derivatives(*own)
    H = H0 * gains
    columns, places = [], []
    for j, (step, others) in enumerate(moved):
        if step == 0.0 or others[r] is modal:
            continue
        columns.append(modal.small_change_to(others[r], *own) * gains / step)
        places.append(j)
    columns.append(H)
    places.append(n_u + nuisances.gain.start + r)
    for c, channel in enumerate(modal.run.channels):
        only = np.zeros_like(H)
        only[:, c] = H[:, c]
        for place in nuisances.places_of_sensor(r, c, channel):
            columns.append(only)
            places.append(n_u + place)
    columns += [column * gains for column in D]
    places += [n_u + place for place in nuisances.places_of_run(r, modal)]
    weight, residual = weights_and_residuals(observed, H, added)
    weight = np.where(modal.tells(*own)[:, None], weight, 0.0)  # a line without a motion has a misfit, and no slope
    return residual, derivatives(observed, H, np.array(columns), weight), np.array(places)
