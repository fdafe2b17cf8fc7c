"""How well a candidate explains the runs: residuals, nuisances, and their joint fit.

Of every run the force gain (relative standard deviation ``gain_tolerance``), of every sensor its gain (half of
that), of every sensor in every run another gain where sensors were mounted anew (``gain_repeatability``), and of every
resonance of every run a drift (``frequency_drift``) are unknown; so are modulus, span and disk masses within a
workshop's tolerance. Where a rotor is nonlinear, the level of a run's force counts beside its gain
(``gain_tolerance`` each): a force sensor that errs changes both, an error of what is read the gain alone. They have
Gaussian priors, are fitted beside the candidate's numbers, and are integrated over in the evidence (Laplace). What a
nuisance takes is judged by its prior.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from rigtwin.gap.inference.descent import damped_step, minimise, softened, tamed
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B, Hypothesis
from rigtwin.gap.inference.observed import Observed, derivatives, misfit, weighted
from rigtwin.gap.model.forward import Forward, acting, nonlinear, on_the_rotor
from rigtwin.gap.model.linear import MODES, TOLERANCE, TOLERANCES
from rigtwin.gap.model.run_model import BoolArray, RunModel
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.structure import ComplexArray, FloatArray, IntArray
from rigtwin.sim.campaign import Channel, NominalBelief, Run

# Values below this share of the run's largest say nothing about a logarithm.
_SILENT = 1e-5

# A run is thinned to no fewer lines.
FEW_LINES = 32

# Prior standard deviation of the logarithm of an arbitrary unit; and from which factor on a unit is none of SI.
ANY_SCALE, _NO_SI = 5.0, 3.0

# Relative standard deviation of a force that is known.
_SURE = 1e-7

# Error of a rough start's logarithms that counts as one.
_ROUGH = 0.3

# What a linear model itself leaves at sharp places, relative to the response.
MODEL_ERROR = 1e-3

# Marquardt's damping, tried in turn.
_DAMPING = (1e-12, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e3)

_MEMORY = 64


class Nuisances:
    """Where each nuisance stands in the vector, and its prior."""

    def __init__(self, runs: Sequence[Run], belief: NominalBelief):
        self.sensors = sorted({channel for run in runs for channel in run.channels})
        n_runs, n_sensors = len(runs), len(self.sensors)
        self.gain = slice(0, n_runs)
        self.sensor = slice(n_runs, n_runs + n_sensors)
        at = n_runs + n_sensors
        self.tolerance = slice(at, at + len(TOLERANCES))
        at += len(TOLERANCES)
        self.drift = [slice(at + MODES * r, at + MODES * (r + 1)) for r in range(n_runs)]
        at += MODES * n_runs
        self.level = slice(at, at + n_runs)
        at += n_runs
        own = [len(run.channels) if belief.gain_repeatability > 0 else 0 for run in runs]
        ends = at + np.cumsum(own)
        self.own_gain = [slice(end - n, end) for n, end in zip(own, ends, strict=True)]
        self.n = at + sum(own)
        self.gain_std = max(belief.gain_tolerance, 1e-6)
        self.sensor_std = max(belief.gain_tolerance / 2, 1e-6)
        self.drift_std = max(belief.frequency_drift, 1e-7)
        std = np.empty(self.n)
        std[self.gain] = [ANY_SCALE if run.quantity == "acceleration" else self.gain_std for run in runs]
        std[self.sensor] = self.sensor_std
        std[self.tolerance] = TOLERANCE
        for each in self.drift:
            std[each] = self.drift_std
        std[self.level] = self.gain_std
        for each in self.own_gain:
            std[each] = belief.gain_repeatability
        self.std = std

    @property
    def level_std(self) -> float:
        """Standard error of a run's level: that of the forces, or hardly any where they are believed."""
        return float(self.std[self.level].max(initial=_SURE))

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


class Problem:
    """The runs of a campaign, and the model of each.

    Parameters
    ----------
    forward : model
    observed : the runs
    model_error : what the model itself leaves at sharp places, relative to the response
    """

    def __init__(self, forward: Forward, observed: Sequence[Observed], model_error: float = MODEL_ERROR):
        self.forward, self.observed, self.model_error = forward, tuple(observed), model_error
        self.runs = tuple(o.run for o in observed)
        self.nuisances = Nuisances(self.runs, forward.belief)
        self.with_k_b = any(run.support == "bearing" for run in self.runs)
        self._memory: dict[tuple, RunModel] = {}

    def __getstate__(self) -> dict[str, Any]:
        """What a helper in another process needs: all but what is remembered."""
        return {**self.__dict__, "_memory": {}}

    def allow_for_tolerances(self, rig: Rig, k_b: float) -> None:
        """Let the workshop's tolerances bend the modes; see ``Forward``."""
        self.forward.allow_for_tolerances(rig, self.runs, k_b)
        self._memory.clear()

    def bend(self, fit: Fit) -> None:
        """Let the tolerances bend the modes of a candidate as they do at its own numbers."""
        if nonlinear(fit.effects):
            return
        with suppress(ValueError, np.linalg.LinAlgError):  # a tolerance beside it has no model: they stay as they were
            for run in self.runs:
                self.forward.bend(run, fit.k_b, acting(fit.effects, run.support))
        self._memory.clear()

    def forget(self) -> None:
        """Drop what was solved: a nonlinear motion is looked for from the one before."""
        self.forward.forget()
        self._memory.clear()

    def made(self, **manner: Any) -> Problem:
        """The same, responses made in another ``Manner``."""
        other = Problem(self.forward.made(**manner), self.observed, self.model_error)
        other.nuisances = self.nuisances
        return other

    def modals(self, k_b: float, effects: Sequence[Effect]) -> list[RunModel]:
        """One for every run; what a run does not depend on is left out, so that it is solved once."""
        return [self._modal(r, k_b, effects) for r in range(len(self.runs))]

    def _modal(self, r: int, k_b: float, effects: Sequence[Effect]) -> RunModel:
        run = self.runs[r]
        there = acting(effects, run.support)
        key = (r, 0.0 if run.support == "rigid" else k_b, there)
        if key not in self._memory:
            if len(self._memory) >= _MEMORY:
                self._memory.pop(next(iter(self._memory)))
            rotor = on_the_rotor(there)
            made = self._modal(r, k_b, rotor).driven_and_read_by(there) if len(rotor) < len(there) else None
            self._memory[key] = made or self.forward.modal(run, k_b, there)
        return self._memory[key]

    def predict(self, fit: Fit) -> list[ComplexArray]:
        """Response of every run, nuisances included."""
        made = []
        for r, modal in enumerate(self.modals(fit.k_b, fit.effects)):
            H = modal.response(*self.nuisances.of_run(fit.nu, r, modal))
            made.append(H * self.nuisances.gains(fit.nu, r, modal))
        return made

    def bare(self, fit: Fit) -> list[ComplexArray]:
        """Response of every run, nuisances left out; an arbitrary unit is not one."""
        return self.predict(replace(fit, nu=self._units(fit)))

    def calibrated(self, fit: Fit) -> list[ComplexArray]:
        """Response of every run, of the nuisances only those that all runs of the rig share: sensors, tolerances."""
        nu = self._units(fit)
        for shared in (self.nuisances.sensor, self.nuisances.tolerance):
            nu[shared] = fit.nu[shared]
        return self.predict(replace(fit, nu=nu))

    def _units(self, fit: Fit) -> FloatArray:
        """Nuisances that are zero but for the gains of runs in an arbitrary unit."""
        nu = np.zeros_like(fit.nu)
        gain = self.nuisances.gain
        nu[gain] = np.where([run.quantity == "acceleration" for run in self.runs], fit.nu[gain], 0.0)
        return nu

    def in_si(self, fit: Fit) -> tuple[Problem, Fit]:
        """The same, and the fit to it, with runs brought to SI where it says that their unit is far from it.

        Grids, rough descents and motions that data tell of know no gains.
        """
        gains = np.where([run.quantity == "acceleration" for run in self.runs], fit.nu[self.nuisances.gain], 0.0)
        gains[np.abs(gains) < np.log(_NO_SI)] = 0.0
        observed = [o.divided(np.exp(gain)) if gain else o for o, gain in zip(self.observed, gains, strict=True)]
        nu = fit.nu.copy()
        nu[self.nuisances.gain] -= gains
        return Problem(self.forward, observed, self.model_error), replace(fit, nu=nu)

    def only(self, support: str) -> Problem | None:
        """The same with the runs on one support; None where there are none, or no others."""
        some = [o for o in self.observed if o.run.support == support]
        return Problem(self.forward, some, self.model_error) if 0 < len(some) < len(self.observed) else None

    def at_middle_level(self) -> Problem:
        """The same with one run on each support."""
        return Problem(self.forward, [self.observed[r] for r in middle_level(self.runs)], self.model_error)

    def thinned(self, every: int, model_error: float | None = None) -> Problem:
        """The same on every n-th line of every run, of ``FEW_LINES`` or more; with another model error, where given."""
        some = []
        for o in self.observed:
            lines = slice(None, None, max(min(every, len(o.std) // FEW_LINES), 1))
            some.append(replace(o, run=o.run.on_lines(lines), std=o.std[lines]))
        return Problem(self.forward, some, self.model_error if model_error is None else model_error)

    def on(self, observed: Sequence[Observed]) -> Problem:
        """The same model and nuisances on the same runs, of other lines or with other errors."""
        made = Problem(self.forward, observed, self.model_error)
        made.nuisances = self.nuisances
        return made

    def loosened(self, factor: float) -> Problem:
        """The same with priors of the nuisances wider by a factor."""
        made = Problem(self.forward, self.observed, self.model_error)
        made.nuisances.std *= factor
        return made

    def remounted(self) -> Problem:
        """The same where each sensor's gain may change from run to run by as much as it may be off."""
        belief = self.forward.belief
        forward = self.forward.believing(gain_repeatability=belief.gain_repeatability or self.nuisances.sensor_std)
        return Problem(forward, self.observed, self.model_error)

    def at_believed_levels(self) -> Problem:
        """The same with forces as large as the runs believe."""
        made = Problem(self.forward, self.observed, self.model_error)
        made.nuisances.std[made.nuisances.level] = _SURE
        return made

    # -- rough: logarithms, without nuisances --------------------------------------------------

    def rough(self, hypothesis: Hypothesis, u: FloatArray, steps: int) -> tuple[FloatArray, float]:
        """Bring a start near the data: least squares of ln(model / data), bounded.

        Returns
        -------
        (1 + n_free,) coordinates and the cost per value
        """

        def residual(x: FloatArray) -> FloatArray | None:
            try:
                modals = self.modals(K_B.value(x[0]), hypothesis.effects(x[1:]))
            except (ValueError, np.linalg.LinAlgError):
                return None
            parts = []
            for observed, modal in zip(self.observed, modals, strict=True):
                y = observed.run.H
                H = modal.response()
                usable = np.isfinite(y) & (np.abs(y) > _SILENT * np.nanmax(np.abs(y))) & (np.abs(H) > 0)
                usable &= observed.std < 0.5 * np.abs(y)
                ratio = np.where(usable, H / np.where(usable, y, 1.0), 1.0)
                log = np.log(np.abs(ratio))
                if observed.run.quantity == "acceleration" and usable.any():
                    log = log - np.median(log[usable])
                parts.append((np.where(usable, log, 0.0) / _ROUGH).ravel())
                if not observed.run.magnitude_only:
                    parts.append((np.angle(ratio) / _ROUGH).ravel())
            return softened(np.concatenate(parts))

        return minimise(residual, u, hypothesis.ends, self.with_k_b, steps)

    # -- fine: the data's own errors, nuisances included ---------------------------------------

    def fit(
        self,
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
        """
        u = u.copy()
        nu = self.unit(hypothesis, u) if nu is None else nu.copy()
        for added in anneal:
            u, nu, chi2, penalty, precision = self._descend(hypothesis, u, nu, added, steps)
        n = sum(o.n_values for o in self.observed)
        return Fit(hypothesis, u, nu, chi2, penalty, precision, n, self.nuisances.std, self.with_k_b, anneal[-1])

    def unit(self, hypothesis: Hypothesis, u: FloatArray) -> FloatArray:
        """(n_nuisances,) nuisances at a start: none, but for the gain of a run whose unit is arbitrary."""
        nu = np.zeros(self.nuisances.n)
        for r, observed in enumerate(self.observed):
            if observed.run.quantity == "acceleration":
                modal = self._modal(r, K_B.value(u[0]), hypothesis.effects(u[1:]))
                size, model = np.abs(np.nan_to_num(observed.run.H)), np.abs(modal.response())
                usable = observed.valid & (size > 0) & (model > 0)
                if usable.any():
                    nu[self.nuisances.gain][r] = np.median(np.log(size[usable] / model[usable]))
        return nu

    def try_fit(
        self, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, *, anneal: Sequence[float], steps: int
    ) -> Fit | None:
        """``fit``, or None where a start or a step has no model."""
        try:
            return self.fit(hypothesis, u, nu, anneal=anneal, steps=steps)
        except (ValueError, np.linalg.LinAlgError):
            return None

    def _descend(self, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, added: float, steps: int):
        ends = hypothesis.ends
        log = np.array([free.log for free in hypothesis.coordinates])
        prior = 1 / self.nuisances.std**2
        n_u = len(u)
        here = self._linearise(hypothesis, u, nu, added)
        if here is None:
            raise ValueError(f"{hypothesis}: no model at the start")
        chi2, gradient, hessian = here
        cost = chi2 + float(nu**2 @ prior)
        for _ in range(steps):
            A = hessian.copy()
            A[range(n_u, len(A)), range(n_u, len(A))] += prior
            g = gradient.copy()
            g[n_u:] -= prior * nu
            active = self.held(u, g[:n_u], ends)
            # The whole step first: along a valley of nuisances any damping by the diagonal hardly moves.
            for mu in _DAMPING:
                step = damped_step(A, g, mu, active)
                trial_u = np.clip(u + np.where(log, tamed(step[:n_u]), step[:n_u]), ends[:, 0], ends[:, 1])
                trial_nu = nu + step[n_u:]
                value = self.cost(hypothesis, trial_u, trial_nu, added)
                if value < cost:
                    break
            else:
                break
            gained = cost - value
            u, nu = trial_u, trial_nu
            linear = self._linearise(hypothesis, u, nu, added)
            assert linear is not None
            chi2, gradient, hessian = linear
            cost = chi2 + float(nu**2 @ prior)
            if gained < max(0.02, 1e-5 * cost):
                break
        return u, nu, chi2, float(nu**2 @ prior), hessian

    def held(self, u: FloatArray, gradient: FloatArray, ends: FloatArray) -> BoolArray:
        """Coordinates held at an end of their range, or without a say."""
        margin = 1e-9 * (ends[:, 1] - ends[:, 0])
        held = ((u <= ends[:, 0] + margin) & (gradient < 0)) | ((u >= ends[:, 1] - margin) & (gradient > 0))
        if not self.with_k_b:
            held[0] = True
        return held

    @np.errstate(over="ignore", invalid="ignore")  # a trial may lie anywhere
    def cost(self, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, added: float = 0.0) -> float:
        """Misfit and penalty at a point, with a relative error added to the data's own; inf without a model."""
        try:
            modals = self.modals(K_B.value(u[0]), hypothesis.effects(u[1:]))
        except (ValueError, np.linalg.LinAlgError):
            return np.inf
        total = float(np.sum((nu / self.nuisances.std) ** 2))
        for r, (observed, modal) in enumerate(zip(self.observed, modals, strict=True)):
            H = modal.response(*self.nuisances.of_run(nu, r, modal)) * self.nuisances.gains(nu, r, modal)
            total += float(misfit(observed, H, self.total_error(added)))
        return total if np.isfinite(total) else np.inf

    def costs(self, fit: Fit, changes: Sequence[ComplexArray], added: float) -> FloatArray:
        """(k,) ``cost`` of a fit whose prediction changes, of every run (k, n_freq, n_channels)."""
        total = np.full(len(changes[0]), float(np.sum((fit.nu / self.nuisances.std) ** 2)))
        for observed, H, change in zip(self.observed, self.predict(fit), changes, strict=True):
            total += misfit(observed, H + change, self.total_error(added))
        return total

    def total_error(self, added: float) -> float:
        """A relative error of the data besides their own, with the model's."""
        return float(np.hypot(added, self.model_error))

    def _linearise(self, hypothesis: Hypothesis, u: FloatArray, nu: FloatArray, added: float):
        """chi2, -gradient/2 and Hessian/2 of the data's misfit by (u, nu)."""
        try:
            modals = self.modals(K_B.value(u[0]), hypothesis.effects(u[1:]))
        except (ValueError, np.linalg.LinAlgError):
            return None
        moved = [self._moved(hypothesis, u, j) for j in range(len(u))]
        n = len(u) + self.nuisances.n
        chi2, gradient, hessian = 0.0, np.zeros(n), np.zeros((n, n))
        for r in range(len(self.runs)):
            residual, J, where = self._slopes(r, modals[r], moved, nu, self.total_error(added))
            chi2 += float(residual @ residual)
            gradient[where] += J @ residual
            hessian[np.ix_(where, where)] += J @ J.T
        return chi2, gradient, hessian

    def _slopes(
        self,
        r: int,
        modal: RunModel,
        moved: Sequence[tuple[float, list[RunModel]]],
        nu: FloatArray,
        added: float,
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Residuals of a run, their derivatives (n_columns, n_residuals), and which of (u, nu) each column is."""
        n_u = len(moved)
        own, gains = self.nuisances.of_run(nu, r, modal), self.nuisances.gains(nu, r, modal)
        H0, D = modal.with_derivatives(*own)
        H = H0 * gains
        columns, places = [], []
        for j, (step, others) in enumerate(moved):
            if step == 0.0 or others[r] is modal:
                continue
            columns.append(modal.small_change_to(others[r], *own) * gains / step)
            places.append(j)
        columns.append(H)
        places.append(n_u + self.nuisances.gain.start + r)
        for c, channel in enumerate(modal.run.channels):
            only = np.zeros_like(H)
            only[:, c] = H[:, c]
            for place in self.nuisances.places_of_sensor(r, c, channel):
                columns.append(only)
                places.append(n_u + place)
        columns += [column * gains for column in D]
        places += [n_u + place for place in self.nuisances.places_of_run(r, modal)]
        weight, residual = weighted(self.observed[r], H, added)
        weight = np.where(modal.tells(*own)[:, None], weight, 0.0)  # a line without a motion has a misfit, and no slope
        return residual, derivatives(self.observed[r], H, np.array(columns), weight), np.array(places)

    def change(self, fit: Fit, more: Sequence[Effect]) -> list[ComplexArray]:
        """What more effects change of a fit's prediction, to first order in the shifts of the resonances."""
        before, after = self.modals(fit.k_b, fit.effects), self.modals(fit.k_b, (*fit.effects, *more))
        return [
            a.change_to(b, *self.nuisances.of_run(fit.nu, r, a)) * self.nuisances.gains(fit.nu, r, b)
            for r, (a, b) in enumerate(zip(before, after, strict=True))
        ]

    def change_by_dwells(self, fit: Fit, dwells: FloatArray) -> list[ComplexArray]:
        """(n_dwells, n_freq, n_channels) of every run, what a fast sweep changes of a settled linear fit's prediction.

        dwells : (n_dwells,) [s]
        """
        changes = []
        for r, modal in enumerate(self.modals(fit.k_b, fit.effects)):
            assert modal.as_linear is not None
            change = modal.as_linear.change_by_dwells(dwells, *self.nuisances.of_run(fit.nu, r, modal))
            changes.append(change * self.nuisances.gains(fit.nu, r, modal))
        return changes

    def linear_parts(self, fit: Fit) -> list[tuple[FloatArray, FloatArray, IntArray]]:
        """Of every run: residuals, their derivatives (n_columns, n_residuals), and which of (u, nu) each column is."""
        modals = self.modals(fit.k_b, fit.effects)
        moved = [self._moved(fit.hypothesis, fit.u, j) for j in range(len(fit.u))]
        error = self.total_error(fit.added)
        return [self._slopes(r, modals[r], moved, fit.nu, error) for r in range(len(self.runs))]

    def _moved(self, hypothesis: Hypothesis, u: FloatArray, j: int) -> tuple[float, list[RunModel]]:
        """A small step of one coordinate, into the range, and the models there."""
        if j == 0 and not self.with_k_b:
            return 0.0, []
        low, high = hypothesis.ends[j]
        step = hypothesis.coordinates[j].step * (high - low)
        if u[j] + step > high:
            step = -step
        v = u.copy()
        v[j] += step
        try:
            return step, self.modals(K_B.value(v[0]), hypothesis.effects(v[1:]))
        except (ValueError, np.linalg.LinAlgError):
            return 0.0, []


def middle_level(runs: Sequence[Run]) -> list[int]:
    """Of every support the run at the middle level."""
    places = {}
    for support in sorted({run.support for run in runs}):
        own = [r for r, run in enumerate(runs) if run.support == support]
        own.sort(key=lambda r: runs[r].force_amplitude_N or 0.0)
        places[support] = own[len(own) // 2]
    return list(places.values())
