"""The bearings' dynamic stiffness line by line, read from a run on bearings without assuming any law.

With the shaft known, a run on bearings is the rotor's response under one complex number a line, the stiffness D that
all bearings have in common:

    H_s = H0_sd - a_s' z (I + z A)^-1 b,   z = D - D0,

where H0 is the response under another stiffness D0, b and A that of the bearings to the exciter and to forces on them,
and a_s that of the sensors to those. D may be anything. The poles of what the bearings stand on are plain to see in
it, while in H they are narrow resonances that a descent misses; so laws are compared with D first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution, least_squares

from rigtwin.gap.document import BearingStiffness
from rigtwin.gap.inference.descent import soften
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B, Hypothesis
from rigtwin.gap.inference.observed import Observed
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward, nonlinear, on_the_rotor
from rigtwin.gap.model.linear import over_receptance
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.rotor_model import bearing_stiffness
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class LineFit:
    """How the stiffness of each line is fitted, and when it is believed."""

    model_error: float = 0.01  # relative error of the shaft's model, added to the data's
    stiffest: float = 1e6  # stiffness over the nominal k_b from which a bearing counts as rigid
    beside: float = 1 + 1e-6  # factor on a sensor's own stiffness: exactly there a motion it does not see has a pole
    steps: int = 5  # Gauss-Newton steps from each start
    largest_step: float = 0.7  # relative to the stiffness at hand
    common_misfit: float = 6.0  # that three quarters of the lines stay below where all bearings follow one law
    shown_error: float = 0.3  # relative standard error up to which a line is shown


@dataclass(frozen=True)
class LawSearch:
    """How a law's numbers are searched that suit the stiffness: differential evolution, then descents."""

    error: float = 0.05  # relative error of D, added to its own
    softest: float = np.log(1 / 30)  # logarithm of k_b over the nominal model's, at least
    stiffest: float = np.log(1000)  # at most: in series with a soft pedestal k_b is much stiffer than the nominal one
    population: int = 10  # over the number of a law's numbers
    generations: int = 50
    descents: int = 3  # of the last generation
    evaluations: int = 100  # of a descent, at most
    same: float = 0.01  # distance in coordinates below which two ends are one
    no_law: float = 1e3  # residual where a law has no model


LINE_FIT = LineFit()
LAW_SEARCH = LawSearch()


@dataclass(frozen=True)
class MeasuredStiffness:
    """The bearings' dynamic stiffness as a run shows it."""

    run: Run
    omega: FloatArray  # (n_freq,) [rad/s]
    D: ComplexArray  # (n_freq,) of each bearing, its damper in it [N/m]
    std: FloatArray  # (n_freq,) its standard error, large where nothing common to all bearings explains the line
    misfit: FloatArray  # (n_freq,) what it leaves: mean square over the error of data and shaft

    @property
    def error(self) -> FloatArray:
        """(n_freq,) relative standard error."""
        return self.std / np.abs(self.D)


def measured_stiffness(problem: Problem, nominal: Fit) -> MeasuredStiffness | None:
    """The stiffness as the run shows it that shows it best; None where it is not common to all bearings.

    It takes a run on bearings, per force, with phases, and two sensors or more along the force.
    """
    forward, found = problem.forward, []
    for observed in problem.observed:
        run = observed.run
        columns = run.along_force
        plain = not run.magnitude_only and run.quantity != "acceleration"
        if run.support == "bearing" and plain and len(columns) > 1:
            found.append(_read(forward, observed, columns, nominal.k_b))
    common = [each for each in found if np.quantile(each.misfit, 0.75) < LINE_FIT.common_misfit]
    return min(common, key=lambda each: float(np.median(each.error)), default=None)


class _Lines:
    """A run's lines under any stiffness of the bearings, and how near each can come to what was measured."""

    def __init__(self, forward: Forward, observed: Observed, columns: Sequence[int], k_b: float):
        run = observed.run
        sensors, bearings = [run.channels[c].node for c in columns], forward.structure.bearing_nodes
        scale, valid = over_receptance(run)[:, None], observed.valid[:, columns]
        self.y, self.k_b = np.nan_to_num(run.H[:, columns]) / scale, k_b
        error = np.hypot(observed.std[:, columns] / np.abs(scale), LINE_FIT.model_error * np.abs(self.y))
        self.weight = np.where(valid, 1 / np.maximum(error, 1e-300), 0.0)
        self.H0, self.b = (forward.receptance(run, k_b, run.excitation_node, nodes) for nodes in (sensors, bearings))
        self.a, self.A = (
            np.stack([forward.receptance(run, k_b, bearing, nodes) for bearing in bearings], axis=2)
            for nodes in (sensors, bearings)
        )
        self.n_values = np.maximum(valid.sum(axis=1), 1)

    def misfit(self, z: ComplexArray) -> ComplexArray:
        """(n_freq, n_sensors) misfit over its error where all bearings are stiffer by z."""
        held = np.eye(self.A.shape[1]) + z[:, None, None] * self.A
        pull = np.linalg.solve(held, z[:, None, None] * self.b[:, :, None])
        return (self.y - self.H0 + (self.a @ pull)[:, :, 0]) * self.weight

    def slope(self, z: ComplexArray, e: ComplexArray) -> ComplexArray:
        """(n_freq, n_sensors) derivative of the misfit e at z."""
        step = 1e-6 * (np.abs(z + self.k_b) + 1e-3 * self.k_b)
        return (self.misfit(z + step) - e) / step[:, None]

    def descend(self, z: ComplexArray) -> tuple[ComplexArray, FloatArray]:
        """Gauss-Newton steps of all lines: where they end, and the squared misfit there."""
        for _ in range(LINE_FIT.steps):
            e = self.misfit(z)
            J = self.slope(z, e)
            step = -np.sum(J.conj() * e, axis=1) / np.maximum(np.sum(np.abs(J) ** 2, axis=1), 1e-300)
            z = z + step / np.maximum(np.abs(step) / np.abs(z + self.k_b) / LINE_FIT.largest_step, 1.0)
        return z, np.sum(np.abs(self.misfit(z)) ** 2, axis=1)

    def exact(self) -> ComplexArray:
        """(n_freq, n_sensors * n_bearings) every z that gives one sensor's value exactly; nan where there is none.

        Of the pencil of (I + z A) q = b and z a_s' q + y_s - H0_s = 0, singular where q stands for both.
        """
        n_freq, n_sensors, n = self.a.shape
        left, right = (np.zeros((n_freq, n_sensors, n + 1, n + 1), dtype=complex) for _ in range(2))
        left[..., :n, :n], left[..., :n, n], left[..., n, n] = np.eye(n), -self.b[:, None], self.y - self.H0
        right[..., :n, :n], right[..., n, :n] = self.A[:, None], self.a
        usable = (self.weight > 0) & (self.y != self.H0)
        left[~usable] = np.eye(n + 1)
        inverse = np.linalg.eigvals(np.linalg.solve(left, right))
        inverse = np.take_along_axis(inverse, np.argsort(np.abs(inverse)), axis=-1)[..., 1:]  # one is 0 always
        usable = usable[..., None] & (self.k_b * np.abs(inverse) * LINE_FIT.stiffest > 1)
        return np.where(usable, -LINE_FIT.beside / np.where(usable, inverse, 1.0), np.nan).reshape(n_freq, -1)

    def nearest(self) -> tuple[ComplexArray, FloatArray]:
        """(n_freq,) z that leaves least, of starts from each sensor's own, and what it leaves."""
        z = np.zeros(len(self.y), dtype=complex)
        squares = np.sum(np.abs(self.misfit(z)) ** 2, axis=1)
        for start in self.exact().T:
            tried, left = self.descend(np.where(np.isfinite(start), start, 0.0))
            lower = left < squares
            z[lower], squares[lower] = tried[lower], left[lower]
        return z, squares


def _read(forward: Forward, observed: Observed, columns: Sequence[int], k_b: float) -> MeasuredStiffness:
    """The stiffness of one run, line by line."""
    lines, omega = _Lines(forward, observed, columns, k_b), 2 * np.pi * observed.run.frequency_hz
    z, squares = lines.nearest()
    slope = np.sqrt(np.sum(np.abs(lines.slope(z, lines.misfit(z))) ** 2, axis=1))
    misfit = squares / lines.n_values
    D = z + k_b + 1j * omega * forward.belief.bearing_damping_Ns_per_m
    std = np.sqrt(np.maximum(misfit, 1.0)) / np.maximum(slope, 1e-300)
    return MeasuredStiffness(observed.run, omega, D, std, misfit)


def law_starts(problem: Problem, measured: MeasuredStiffness, law: Hypothesis, k_b: float) -> list[FloatArray]:
    """Where fits of a law that all bearings follow begin: (1 + n_free,) coordinates, those nearest to D first."""

    def residual(u: FloatArray) -> FloatArray:
        try:
            return _law_misfit(problem.forward, measured, law, u)
        except (ValueError, np.linalg.LinAlgError):
            return np.full(2 * len(measured.omega), LAW_SEARCH.no_law)

    ends = law.ends.copy()
    ends[0] = np.clip(np.log(k_b) + np.array([LAW_SEARCH.softest, LAW_SEARCH.stiffest]), *ends[0])
    made = differential_evolution(
        lambda u: float(np.sum(residual(u) ** 2)),
        ends,
        popsize=LAW_SEARCH.population,
        maxiter=LAW_SEARCH.generations,
        init="sobol",
        rng=0,
        polish=False,
        tol=0.0,
    )
    lowest = np.argsort(made.population_energies)[: LAW_SEARCH.descents]
    best = np.clip(made.population[lowest], *ends.T)  # rounding leaves ranges
    found = [least_squares(residual, u, bounds=ends.T, x_scale="jac", max_nfev=LAW_SEARCH.evaluations) for u in best]
    kept: list[FloatArray] = []
    for end in sorted(found, key=lambda end: end.cost):
        if not any(np.allclose(end.x, u, rtol=0, atol=LAW_SEARCH.same) for u in kept):
            kept.append(end.x)
    return kept


def _law_misfit(forward: Forward, measured: MeasuredStiffness, law: Hypothesis, u: FloatArray) -> FloatArray:
    """ln(law / D) over its error, real and imaginary."""
    D = _law_stiffness(forward, measured, K_B.value(u[0]), law.effects(u[1:]))
    z = np.log(D / measured.D) / np.hypot(measured.error, LAW_SEARCH.error)
    return soften(np.concatenate([z.real, z.imag]))


def _law_stiffness(forward: Forward, at: MeasuredStiffness, k_b: float, effects: Sequence[Effect]) -> ComplexArray:
    """(n_freq,) stiffness by linear effects, of the bearings' mean."""
    condition = forward.condition(at.run, k_b)
    plane = condition.excitation_plane
    return bearing_stiffness(forward.structure, condition, effects, at.omega, plane).mean(axis=1)


def compare_with_models(problem: Problem, nominal: Fit, best: Fit | None) -> BearingStiffness | None:
    """The stiffness that a run shows beside the nominal model's and a linear candidate's; None where no run shows it.

    Parameters
    ----------
    nominal : recalibrated model without effects
    best : candidate that explains the runs; None: there is none
    """
    measured = measured_stiffness(problem, nominal)
    if measured is None:
        return None
    usable = measured.error < LINE_FIT.shown_error
    models: list[tuple[float, Sequence[Effect]]] = [(nominal.k_b, ())]
    if best is not None and not nonlinear(best.effects):
        models.append((best.k_b, on_the_rotor(best.effects)))
    curves = (_law_stiffness(problem.forward, measured, k_b, effects) for k_b, effects in models)
    shown: dict[str, FloatArray] = {"frequency_hz": measured.run.frequency_hz, "std": measured.std}
    for name, D in zip(("", "nominal_", "corrected_"), (measured.D, *curves), strict=False):
        shown |= {f"{name}real": D.real, f"{name}imag": D.imag}
    lists = {name: tuple(values[usable].tolist()) for name, values in shown.items()}
    return BearingStiffness(measured.run.name, **lists)
