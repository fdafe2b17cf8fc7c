"""The runs of a campaign, the model of each, and the problems that are derived from these.

A problem is fitted by the functions of ``fitting``, which are its methods.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigtwin.gap.inference import fitting
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B, Hypothesis
from rigtwin.gap.inference.nuisances import PRIOR, Nuisances
from rigtwin.gap.inference.observed import Observed
from rigtwin.gap.model.forward import Forward, acting, nonlinear, on_the_rotor
from rigtwin.gap.model.run_model import RunModel
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.sim.campaign import Run

# What a linear model itself leaves at sharp places, relative to the response.
MODEL_ERROR = 1e-3


@dataclass(frozen=True)
class RunLimits:
    """Limits of what is kept of the runs and of their models."""

    few_lines: int = 32  # a run is thinned to no fewer
    models: int = 64  # that are remembered


LIMITS = RunLimits()


class Problem:
    """The runs of a campaign, and the model of each.

    Parameters
    ----------
    forward : model
    observed : the runs
    model_error : what the model itself leaves at sharp places, relative to the response
    """

    # The joint fit: functions of ``fitting`` that take the problem first.
    rough = fitting.rough
    shows_resonances = fitting.shows_resonances
    fit = fitting.fit
    try_fit = fitting.try_fit
    refine = fitting.refine
    unit = fitting.unit
    held = fitting.held
    cost = fitting.cost
    misfit_of = fitting.misfit_of
    costs = fitting.costs
    linear_parts = fitting.linear_parts

    def __init__(self, forward: Forward, observed: Sequence[Observed], model_error: float = MODEL_ERROR):
        self.forward, self.observed, self.model_error = forward, tuple(observed), model_error
        self.runs = tuple(o.run for o in observed)
        self.nuisances = Nuisances(self.runs, forward.workshop)
        self.with_k_b = any(run.support == "bearing" for run in self.runs)
        self._memory: dict[tuple, RunModel] = {}

    def __getstate__(self) -> dict[str, Any]:
        """What a helper in another process needs: all but what is remembered."""
        return {**self.__dict__, "_memory": {}}

    def ends(self, hypothesis: Hypothesis) -> FloatArray:
        """(1 + n_free, 2) ranges of a candidate's coordinates; that of k_b is this rig's own."""
        return np.vstack([np.log(self.forward.workshop.k_b), hypothesis.ends[1:]])

    def at_fit(self, fit: Fit) -> Problem:
        """The same with a model that is exact at the tolerances of a fit.

        Under a force law matrices follow the tolerances, which is all but exact, and grazing motions feel any change.
        """
        if nonlinear(fit.effects):
            return self
        return self._like(forward=self.forward.at(fit.nu[self.nuisances.tolerance]))

    def around(self, fit: Fit) -> Problem:
        """``at_fit``, where tolerances also bend the modes near by as they do under the fit's effects."""
        there = self.at_fit(fit)
        there.bend(fit)
        return there

    def has_model(self, fit: Fit) -> bool:
        """Whether a fit's rotor exists at its own tolerances: far from the anchor, the first order leads anywhere."""
        return self.at_fit(fit).try_modals(fit.hypothesis, fit.u) is not None

    def on_rotor_with(self, effects: Sequence[Effect]) -> Problem:
        """The same with a model on a rotor that has these effects, whatever a candidate adds."""
        return self._like(forward=self.forward.on_rotor_with(effects))

    def as_drawn(self) -> Problem:
        """The same with the model of the rig as drawn, without accelerometers on it."""
        forward = Forward(self.forward.workshop.without_sensors())
        forward.manner = self.forward.manner
        return self._like(forward=forward)

    def near_fit(self, fit: Fit) -> Problem:
        """The same with a model that holds where the tolerances of a fit are plausible: other fits begin there."""
        return self.at_fit(self.plausible(fit))

    def _like(self, **other: Any) -> Problem:
        """The same runs, nuisances and model, but for what is given."""
        made = copy.copy(self)
        made.__dict__ |= other
        made._memory = {}
        return made

    def bend(self, fit: Fit) -> None:
        """Let the tolerances bend the modes of a candidate as they do at its own numbers, here at the anchor."""
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
        return self._like(forward=self.forward.made(**manner))

    def modals(self, k_b: float, effects: Sequence[Effect]) -> list[RunModel]:
        """One for every run; what a run does not depend on is left out, so that it is solved once."""
        return [self.modal(r, k_b, effects) for r in range(len(self.runs))]

    def try_modals(self, hypothesis: Hypothesis, u: FloatArray) -> list[RunModel] | None:
        """``modals`` at coordinates (1 + n_free,); None where one of them has no model."""
        try:
            return self.modals(K_B.value(u[0]), hypothesis.effects(u[1:]))
        except (ValueError, np.linalg.LinAlgError):
            return None

    def modal(self, r: int, k_b: float, effects: Sequence[Effect]) -> RunModel:
        """The model of one run."""
        run = self.runs[r]
        there = acting(effects, run.support)
        key = (r, 0.0 if run.support == "rigid" else k_b, there)
        if key not in self._memory:
            if len(self._memory) >= LIMITS.models:
                self._memory.pop(next(iter(self._memory)))
            rotor = on_the_rotor(there)
            made = self.modal(r, k_b, rotor).driven_and_read_by(there) if len(rotor) < len(there) else None
            self._memory[key] = made or self.forward.modal(run, k_b, there)
        return self._memory[key]

    def predict(self, fit: Fit) -> list[ComplexArray]:
        """Response of every run, nuisances included."""
        made = []
        for r, modal in enumerate(self.at_fit(fit).modals(fit.k_b, fit.effects)):
            H = modal.response(*self.nuisances.of_run(fit.nu, r, modal))
            made.append(H * self.nuisances.gains(fit.nu, r, modal))
        return made

    def recalibrated(self, fit: Fit) -> list[ComplexArray]:
        """Response of every run, of the nuisances only tolerances as far as they are plausible; an arbitrary unit is
        none."""
        nu, tolerance = self._units(fit), self.nuisances.tolerance
        nu[tolerance] = self.plausible(fit).nu[tolerance]
        return self.predict(replace(fit, nu=nu))

    def plausible(self, fit: Fit) -> Fit:
        """A fit with its tolerances at most two standard deviations from nothing: beyond, they stand in for a cause."""
        nu, tolerance = fit.nu.copy(), self.nuisances.tolerance
        limit = 2 * self.forward.workshop.std
        nu[tolerance] = np.clip(nu[tolerance], -limit, limit)
        return replace(fit, nu=nu)

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

    def only(self, support: str) -> Problem | None:
        """The same with the runs on one support; None where there are none, or no others."""
        some = [o for o in self.observed if o.run.support == support]
        return Problem(self.forward, some, self.model_error) if 0 < len(some) < len(self.observed) else None

    def at_middle_level(self) -> Problem:
        """The same with one run on each support."""
        return Problem(self.forward, [self.observed[r] for r in middle_level(self.runs)], self.model_error)

    def thinned(self, every: int, model_error: float | None = None) -> Problem:
        """The same on every n-th line of every run, of ``few_lines`` or more; with another model error, where given."""
        some = []
        for o in self.observed:
            lines = slice(None, None, max(min(every, len(o.std) // LIMITS.few_lines), 1))
            some.append(replace(o, run=o.run.on_lines(lines), std=o.std[lines]))
        return Problem(self.forward, some, self.model_error if model_error is None else model_error)

    def on(self, observed: Sequence[Observed]) -> Problem:
        """The same model and nuisances on the same runs, of other lines or with other errors."""
        return self._like(observed=tuple(observed), runs=tuple(o.run for o in observed))

    def loosened(self, factor: float) -> Problem:
        """The same with priors of the nuisances wider by a factor, and none that is learned."""
        made = Problem(self.forward, self.observed, self.model_error)
        made.nuisances.std *= factor
        made.nuisances.learned = ()
        return made

    def at_believed_levels(self) -> Problem:
        """The same with forces as large as the runs believe."""
        made = Problem(self.forward, self.observed, self.model_error)
        made.nuisances.std[made.nuisances.level] = PRIOR.known_force
        return made

    def change(self, fit: Fit, more: Sequence[Effect]) -> list[ComplexArray]:
        """What more effects change of a fit's prediction, to first order in the shifts of the resonances."""
        here = self.at_fit(fit)
        before, after = here.modals(fit.k_b, fit.effects), here.modals(fit.k_b, (*fit.effects, *more))
        return [
            a.small_change_to(b, *self.nuisances.of_run(fit.nu, r, a)) * self.nuisances.gains(fit.nu, r, b)
            for r, (a, b) in enumerate(zip(before, after, strict=True))
        ]

    def change_by_dwells(self, fit: Fit, dwells: FloatArray) -> list[ComplexArray]:
        """(n_dwells, n_freq, n_channels) of every run, what a fast sweep changes of a settled linear fit's prediction.

        dwells : (n_dwells,) [s]
        """
        changes = []
        for r, modal in enumerate(self.at_fit(fit).modals(fit.k_b, fit.effects)):
            assert modal.as_linear is not None
            change = modal.as_linear.change_by_dwells(dwells, *self.nuisances.of_run(fit.nu, r, modal))
            changes.append(change * self.nuisances.gains(fit.nu, r, modal))
        return changes

    def total_error(self, added: float) -> float:
        """A relative error of the data besides their own, with the model's."""
        return float(np.hypot(added, self.model_error))


def middle_level(runs: Sequence[Run]) -> list[int]:
    """Of every support the run at the middle level."""
    places = {}
    for support in sorted({run.support for run in runs}):
        own = [r for r, run in enumerate(runs) if run.support == support]
        own.sort(key=lambda r: runs[r].force_amplitude_N or 0.0)
        places[support] = own[len(own) // 2]
    return list(places.values())
