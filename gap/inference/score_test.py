"""Rao's score test beside a fit: what one more number could gain, without fitting it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.linalg import block_diag

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.fitting import curvature
from rigtwin.gap.inference.observed import derivatives, weights_and_residuals
from rigtwin.gap.inference.posterior import with_sizes
from rigtwin.gap.inference.problem import Problem
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition


@dataclass(frozen=True)
class Distinct:
    """Shares of an effect's change that the fit's own numbers do not make as well."""

    none: float = 1e-12  # below this it counts as none
    # Below this the fit's own numbers make the same, as far as slopes are known, to 1 %. All that such an effect can
    # gain is that these numbers come back to where their priors have them.
    parallel: float = 1e-4


DISTINCT = Distinct()


class Score:
    """Rao's score test beside a fit: how much of the misfit a small effect explains, the fit's numbers refitted.

    Of a rough fit it is the misfit with the relative error that it was fitted with.

    A fit stops short of its minimum. What is left to gain there would pass for the effect's, along a direction that the
    effect shares with the nuisances. With ``settled``, slopes are those at the minimum, to first order (the efficient
    score): right where the fit is good, misleading where it is so bad that its minimum lies elsewhere. A number that
    stands at an end of its range, and would leave it, stays there.

    A repeatability that was learned may have grown to stand in for the effect, and falls back where the effect is
    added. With ``settled``, an effect counts by the size of it with which both together gain most.

    Parameters
    ----------
    problem, fit : where the effect is added
    settled : whether slopes are those at the minimum next to the fit
    """

    def __init__(self, problem: Problem, fit: Fit, *, settled: bool = False):
        problem = problem.around(fit)
        parts = problem.linear_parts(fit.hypothesis, fit.u, fit.nu, fit.added)
        if parts is None:
            raise ValueError(f"{fit.hypothesis}: the fit has no model")
        self._problem, self.fit, self._parts = problem, fit, parts
        self._model = problem.predict(fit)
        self._weights = [
            weights_and_residuals(observed, H, problem.total_error(fit.added))[0]
            for observed, H in zip(problem.observed, self._model, strict=True)
        ]
        gradient = self._gradient()
        held = problem.held(fit.u, gradient[: len(fit.u)], problem.ends(fit.hypothesis))
        # Of these slopes, not of those that the fit ended with: a gain is a share of the misfit, whatever was fitted.
        here = replace(fit, precision=curvature(parts, len(gradient)))
        self._covariance = here.covariance(held=held)
        self._unsettled = gradient if settled else np.zeros(len(gradient))
        self._others = partial(_with_less_repeatability, problem, here, held) if settled else tuple

    @cached_property
    def _beliefs(self) -> list[_Belief]:
        """The fit's own belief first."""
        return [_Belief(self._covariance, self.fit.prior_std, np.zeros(len(self._covariance)), 0.0), *self._others()]

    @property
    def misfit(self) -> float:
        """Of the data alone, as the fit stands."""
        return sum(float(residual @ residual) for residual, *_ in self._parts)

    @property
    def condition(self) -> Condition:
        """What the nominal model believes."""
        return self._problem.forward.condition(self._problem.runs[0], self.fit.k_b)

    def tolerances_of(self, change: FloatArray) -> dict[str, float]:
        """Of a change of the fit's (u, nu), what the workshop's tolerances have of it, by their names."""
        nuisances, names = self._problem.nuisances, self._problem.forward.workshop.names
        return dict(zip(names, change[len(self.fit.u) :][nuisances.tolerance].tolist(), strict=True))

    def gain(self, effects: Sequence[Effect]) -> tuple[float, float, FloatArray]:
        """To first order, the misfit that these small effects take away once they are scaled.

        Returns
        -------
        gain and scale, both negative where the effects would have to be, and by how much the fit's (u, nu) move
        """
        try:
            changes = self._problem.change(self.fit, effects)
        except (ValueError, np.linalg.LinAlgError):
            return 0.0, 0.0, np.zeros(len(self._covariance))
        (gain,), (scale,), (moved,) = self.gains([change[None] for change in changes])
        return float(gain), float(scale), moved

    def gains(self, changes: Sequence[ComplexArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """``gain`` of k changes of the prediction, of every run (k, n_freq, n_channels); (k,), (k,), (k, n)."""
        k, n = len(changes[0]), len(self._covariance)
        slope, size, shared = np.zeros(k), np.zeros(k), np.zeros((k, n))
        for observed, H, weight, change, (residual, J, where) in zip(
            self._problem.observed, self._model, self._weights, changes, self._parts, strict=True
        ):
            columns = derivatives(observed, H, change, weight)
            slope += columns @ residual
            size += np.sum(columns**2, axis=1)
            shared[:, where] += columns @ J.T
        found = [self._believing(belief, slope, size, shared) for belief in self._beliefs]
        gains, scales, moves = (np.array(parts) for parts in zip(*found, strict=True))
        best = np.abs(gains).argmax(axis=0), np.arange(k)
        return gains[best], scales[best], moves[best]

    def _believing(
        self, belief: _Belief, slope: FloatArray, size: FloatArray, shared: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """``gains`` from slopes (k,) and curvatures (k,) by the changes, and what the fit's numbers share (k, n)."""
        step, answer = belief.covariance @ (self._unsettled + belief.pull), shared @ belief.covariance
        priors = answer * np.append(np.zeros(len(self.fit.u)), 1 / belief.prior_std**2)
        own, by_priors = size - np.sum(shared * answer, axis=1), np.sum(priors * answer, axis=1)
        slope = slope - shared @ step
        alike = own - by_priors <= DISTINCT.parallel * size
        own[alike], slope[alike] = by_priors[alike], priors[alike] @ (np.append(self.fit.u, self.fit.nu) + step)
        own[own <= DISTINCT.none * size] = np.inf
        scale = slope / own
        gain = np.maximum(np.abs(scale * slope) - belief.less, 0.0)
        return np.copysign(gain, scale), scale, step - scale[:, None] * answer

    def _gradient(self) -> FloatArray:
        """-gradient/2 of misfit and penalty by (u, nu): not zero where the fit stopped short of its minimum."""
        fit = self.fit
        left = np.zeros(len(fit.u) + len(fit.nu))
        for residual, J, where in self._parts:
            left[where] += J @ residual
        n_u = len(fit.u)
        left[n_u:] -= fit.nu / fit.prior_std**2
        return left

    def apart(self, runs: Sequence[int], *, shapes: bool = False) -> tuple[float, int]:
        """To first order, the misfit that goes where each resonance of these runs has its own shift and damping.

        Parameters
        ----------
        shapes : whether it has its own height and phase in every channel, too

        Returns
        -------
        gain, and how many numbers it takes: without a cause the gain is chi-squared with so many degrees of freedom
        """
        return _gain(*self._slopes({r: self._freed(r, shapes) for r in runs}))

    def _slopes(self, changes: Mapping[int, ComplexArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of -misfit/2 by multiples of changes (n_columns, n_freq, n_channels) of these runs: slope (n,) and curvature
        (n, n), the fit's own numbers following, and the curvature where they stay."""
        slopes, blocks, shared = [], [], []
        for r, columns in changes.items():
            residual, J, where = self._parts[r]
            X = derivatives(self._problem.observed[r], self._model[r], columns, self._weights[r])
            slopes.append(X @ residual)
            blocks.append(X @ X.T)
            shared.append(np.zeros((len(self._covariance), len(X))))
            shared[-1][where] = J @ X.T
        together = np.concatenate(shared, axis=1)
        size = np.asarray(block_diag(*blocks))
        told = size - together.T @ self._covariance @ together
        slope = np.concatenate(slopes) - together.T @ self._covariance @ self._unsettled
        return slope, told, size

    def _freed(self, r: int, shapes: bool) -> ComplexArray:
        """(n_columns, n_freq, n_channels) change of a run's prediction by numbers that are each resonance's own."""
        problem, fit = self._problem, self.fit
        modal = problem.modals(fit.k_b, fit.effects)[r]
        own = problem.nuisances.of_run(fit.nu, r, modal)
        inside = int(np.sum(modal.frequencies_hz < problem.runs[r].frequency_hz[-1]))
        freed = modal.with_derivatives(*own)[1][:inside]
        if shapes:
            assert modal.as_linear is not None
            parts = modal.as_linear.of_resonances(*own)[:inside]
            freed = np.concatenate([freed, _each_channel(parts)])
        return np.concatenate([freed, 1j * freed]) * problem.nuisances.gains(fit.nu, r, modal)


@dataclass(frozen=True)
class _Belief:
    """How the priors of the nuisances hold a fit's numbers (u, nu)."""

    covariance: FloatArray  # (n, n)
    prior_std: FloatArray  # (n_nuisances,)
    pull: FloatArray  # (n,) slopes that these priors add to those of the fit's own
    less: float  # misfit that makes as much less probable as these priors


def _with_less_repeatability(problem: Problem, fit: Fit, held: BoolArray) -> Iterator[_Belief]:
    """Beliefs with one of the learned repeatabilities halved again and again, down to what is usual."""
    learned = problem.nuisances.learned
    best = [each.of(fit.prior_std) for each in learned]
    probable = with_sizes(fit, learned, best, 1.0)[0]
    for k, each in enumerate(learned):
        for size in best[k] / 2.0 ** np.arange(1, int(np.log2(max(best[k] / each.median, 1.0))) + 1):
            std, sizes = fit.prior_std.copy(), [*best[:k], size, *best[k + 1 :]]
            std[each.places] = size
            less = 2 * (probable - with_sizes(fit, learned, sizes, 1.0)[0])
            pull = np.append(np.zeros(len(fit.u)), (1 / fit.prior_std**2 - 1 / std**2) * fit.nu)
            yield _Belief(replace(fit, prior_std=std).covariance(held=held), std, pull, less)


def _gain(slope: FloatArray, told: FloatArray, size: FloatArray) -> tuple[float, int]:
    """The misfit that goes along all directions that tell something, and how many these are."""
    unit = 1 / np.sqrt(np.maximum(size.diagonal(), 1e-30))
    values, axes = np.linalg.eigh(told * unit * unit[:, None])
    free = values > DISTINCT.none * values.max(initial=0.0)
    along = (axes.T @ (slope * unit))[free]
    return float(np.sum(along**2 / values[free])), int(free.sum())


def _each_channel(changes: ComplexArray) -> ComplexArray:
    """(n * n_channels, n_freq, n_channels) changes (n, n_freq, n_channels) of one channel at a time."""
    alone = changes[:, None] * np.eye(changes.shape[-1])[:, None]
    return alone.reshape(-1, *changes.shape[1:])
