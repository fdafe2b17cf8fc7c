"""An unknown mechanism at one node: the dynamic stiffness that the runs tell there, as a passive law.

Where no effect explains the runs, something unknown acts, and several sensors still tell at which node. With H0 the
response of the nominal model, a_s and A the receptances from a node to the sensors and to itself, and b that from the
exciter to the node, a dynamic stiffness Z between the node and the ground gives every sensor

    H_s = H0_s - a_s g,   g = Z b / (1 + Z A),   Z = g / (b - g A).

g is fitted to all sensors line by line, which assumes no law; what that leaves ranks nodes and bearing stiffnesses.
Then the law of ``MeasuredJoint`` is fitted to Z, which is linear in all numbers but the frequency and damping of its
branch: these are looked for by descents from a grid. From there every node's law is fitted to the runs themselves, with
all nuisances, and the nodes compete by evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import minimize, nnls

from rigtwin.gap.inference.descent import soften
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import Hypothesis, at_every_place
from rigtwin.gap.inference.observed import Observed
from rigtwin.gap.inference.problem import Problem, middle_level
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.linear import over_receptance
from rigtwin.gap.search.race import Stage, best_first, first_of_each, fitted, reach
from rigtwin.gap.search.starts import Start
from rigtwin.rotor.effects.structure import MeasuredJoint
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.shared_work import each
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class JointSearch:
    """How a joint is looked for."""

    least_sensors: int = 3  # along the force, in one run: with fewer every node explains nearly everything
    every: int = 3  # lines: every third tells enough to start from
    model_error: float = 0.02  # relative error of the rotor's model beside the data's, line by line,
    shift: float = 0.003  # and relative error of its frequencies, which counts most beside sharp resonances
    k_b: tuple[float, float, int] = (-0.7, 0.7, 29)  # logarithm of its factors on the nominal one: from, to, how many
    nodes: int = 2  # that explain most are fitted,
    behind: float = 1.5  # unless they leave so many times what the best one leaves,
    frequencies: int = 32  # of branches, evenly in the logarithm over their range
    ratios: int = 6  # the same of their damping ratios
    law_error: float = 0.05  # relative error of Z, added to its own
    rough_steps: int = 4  # of a descent to the resonances that the runs show
    stages: tuple[Stage, ...] = (Stage(0.1, 6, 2), Stage(0.02, 10, 2))  # of the fits on these lines
    anchors: int = 2  # how often the model is made anew at the tolerances that the last fits have come to,
    steps: int = 20  # each of so many steps


JOINT_SEARCH = JointSearch()

# Dampers of a branch, of which it mostly has one, with the least damping ratio that is looked for: beside its spring it
# makes a resonance, and a large one to the ground a Maxwell element.
DAMPERS = {"branch_damping_ratio": 0.0, "branch_ground_ratio": 0.3}


@dataclass(frozen=True)
class FoundJoint:
    """Where an unknown mechanism acts, and its law."""

    node: int  # whose forces explain most; 0: the exciter's
    fits: tuple[Fit, ...]  # of the law at this node and the next likely ones, best first by evidence


def find_joint(problem: Problem, nominal: Fit) -> FoundJoint | None:
    """Where a joint explains most, and its law there; None where too few sensors tell a place.

    Parameters
    ----------
    problem : the runs; those with phases and ``least_sensors`` along the force tell where the joint is
    nominal : the fit of the nominal model to them
    """
    few = problem.thinned(JOINT_SEARCH.every)
    views = [view for view in _views(few) if len(view.sensors) >= JOINT_SEARCH.least_sensors]
    if not views:
        return None
    located = _most_explained(few.forward, views, joints(problem), nominal.k_b if problem.with_k_b else None)
    laws = [law for found in located for law in _laws(found, views, few.forward)]
    starts = list(each(partial(_rough, few), laws))
    first, *further = JOINT_SEARCH.stages
    fits = _found(each(partial(fitted, few, first), starts))
    for stage in further:
        fits = _found(each(partial(_fitted_on, few, stage), fits))
    fits = first_of_each(fits, lambda fit: fit.hypothesis.places)
    fits = best_first(each(partial(_polished, problem), [fit for fit in fits if fit.cost <= reach(fits[0])]))
    return FoundJoint(located[0].hypothesis.terms[0].node, tuple(best_first([*fits, *map(_plain(problem), fits[:1])])))


def _plain(problem: Problem) -> Callable[[Fit], Fit]:
    """Fits a law anew without its branch."""

    def plain(fit: Fit) -> Fit:
        hypothesis, u = fit.hypothesis.straightened(fit.u)
        return _polished(problem, replace(fit, hypothesis=hypothesis, u=u))

    return plain


def _rough(few: Problem, law: tuple[Hypothesis, FloatArray]) -> Start:
    """A law brought near the resonances that the runs show, where that is nearer than it was."""
    hypothesis, u = law
    if few.shows_resonances(hypothesis):
        moved, _ = few.rough(hypothesis, u, JOINT_SEARCH.rough_steps)
        starts = [Start(hypothesis, at, few.unit(hypothesis, at)) for at in (u, moved)]
        return min(starts, key=lambda start: few.cost(hypothesis, start.u, start.nu, JOINT_SEARCH.stages[0].added))
    return Start(hypothesis, u, few.unit(hypothesis, u))


def _polished(problem: Problem, fit: Fit) -> Fit:
    return problem.refine(fit, anchors=JOINT_SEARCH.anchors, steps=JOINT_SEARCH.steps)


def joints(problem: Problem) -> list[Hypothesis]:
    """A joint at every node that moves; where all runs drive one and the same node, there it goes with the exciter."""
    driven = {run.excitation_node for run in problem.runs}
    every = at_every_place(MeasuredJoint, problem.runs, problem.forward.structure)
    fixed = [h for h in every if driven != {h.terms[0].node}]
    (term,) = every[0].terms
    return [*fixed, replace(every[0], terms=(replace(term, fixed=(("node", 0),)),))]


def _fitted_on(problem: Problem, stage: Stage, fit: Fit) -> Fit | None:
    return fitted(problem, stage, Start(fit.hypothesis, fit.u, fit.nu))


def _found(made: Iterable[Fit | None]) -> list[Fit]:
    """The fits that have a model, of the lowest cost first."""
    return sorted((fit for fit in made if fit is not None), key=lambda fit: fit.cost)


# -- line by line ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _View:
    """One run as sensors along its force see it, as receptances [m/N]."""

    run: Run
    sensors: tuple[int, ...]
    omega: FloatArray  # (n_freq,)
    y: ComplexArray  # (n_freq, n_sensors)
    error: FloatArray  # (n_freq, n_sensors) of data and model; infinite where there is no value

    def error_beside(self, H: ComplexArray) -> FloatArray:
        """(n_freq, n_sensors) the same, with what a shift of a model's resonances would make."""
        return np.hypot(self.error, _moved(H, self.omega))


@dataclass(frozen=True)
class _Located:
    """What a joint at one node explains at the bearing stiffness that suits it best."""

    hypothesis: Hypothesis
    k_b: float | None  # None: no run on bearings
    left: float  # softened mean square


def _views(problem: Problem) -> Iterator[_View]:
    """One run with phases on each support and of each drive."""
    seen = set()
    for r in sorted(range(len(problem.runs)), key=lambda r: r not in middle_level(problem.runs)):
        observed = problem.observed[r]
        run = observed.run
        setup = run.support, run.excitation_node, run.excitation_plane, run.channels
        if not run.magnitude_only and setup not in seen:
            seen.add(setup)
            yield _view(observed)


def _view(observed: Observed) -> _View:
    run, scale = observed.run, over_receptance(observed.run)[:, None]
    columns = run.along_force
    y, valid = np.nan_to_num(run.H[:, columns]) / scale, observed.valid[:, columns]
    error = np.hypot(observed.std[:, columns] / np.abs(scale), JOINT_SEARCH.model_error * np.abs(y))
    omega = 2 * np.pi * run.frequency_hz
    error = np.where(valid, np.hypot(error, _moved(y, omega)), np.inf)
    return _View(run, tuple(run.channels[c].node for c in columns), omega, y, error)


def _moved(H: ComplexArray, omega: FloatArray) -> FloatArray:
    """(n_freq, n_sensors) change of a response by a small shift of its frequencies."""
    return JOINT_SEARCH.shift * np.abs(np.gradient(H, np.log(omega), axis=0))


@dataclass(frozen=True)
class _Forces:
    """The force that a node would need on every line."""

    g: ComplexArray  # (n_freq,) per newton of the exciter
    b: ComplexArray  # (n_freq,) receptance from the exciter to the node
    A: ComplexArray  # (n_freq,) of the node itself
    norm: FloatArray  # (n_freq,) one over the variance of g
    left: FloatArray  # (n_freq,) mean square over the sensors that it leaves

    @property
    def stiffness(self) -> tuple[ComplexArray, FloatArray]:
        """(n_freq,) Z [N/m] and its standard error."""
        with np.errstate(divide="ignore", invalid="ignore"):  # where neither moves, nothing is told
            Z = self.g / (self.b - self.g * self.A)
            std = np.abs(self.b / (self.b - self.g * self.A) ** 2) * np.sqrt(np.maximum(self.left, 1.0) / self.norm)
        return Z, std


def _driven(forward: Forward, view: _View, k_b: float) -> ComplexArray:
    """(n_freq, n_sensors + n_nodes) receptance from the exciter to the sensors and to every node of the rig."""
    nodes = range(1, forward.structure.n_nodes + 1)
    return forward.receptance(view.run, k_b, view.run.excitation_node, [*view.sensors, *nodes])


def _forces(forward: Forward, view: _View, k_b: float, node: int, driven: ComplexArray) -> _Forces:
    """The forces of a node; ``driven`` is that of ``_driven``, which all nodes share."""
    node, n = node or view.run.excitation_node, len(view.sensors)
    from_node = forward.receptance(view.run, k_b, node, [*view.sensors, node])
    a, H0 = from_node[:, :-1], driven[:, :n]
    w2 = 1 / np.maximum(view.error_beside(H0), 1e-300) ** 2
    norm = np.sum(w2 * np.abs(a) ** 2, axis=1)
    e = H0 - view.y
    g = np.sum(w2 * a.conj() * e, axis=1) / np.maximum(norm, 1e-300)
    left = np.mean(w2 * np.abs(e - a * g[:, None]) ** 2, axis=1)
    return _Forces(g, driven[:, n + node - 1], from_node[:, -1], norm, left)


def _most_explained(
    forward: Forward, views: Sequence[_View], hypotheses: Sequence[Hypothesis], k_b: float | None
) -> list[_Located]:
    """The nodes at which forces explain most, each at its best bearing stiffness."""
    tried = list(k_b * np.exp(np.linspace(*JOINT_SEARCH.k_b))) if k_b else [None]
    left = np.array([_left(forward, views, stiffness or 1.0, hypotheses) for stiffness in tried])
    found = [
        _Located(hypothesis, tried[best], float(left[best, column]))
        for column, (hypothesis, best) in enumerate(zip(hypotheses, left.argmin(axis=0), strict=True))
    ]
    found.sort(key=lambda each: each.left)
    return [each for each in found[: JOINT_SEARCH.nodes] if each.left < JOINT_SEARCH.behind * found[0].left]


def _left(forward: Forward, views: Sequence[_View], k_b: float, hypotheses: Sequence[Hypothesis]) -> list[float]:
    """Softened mean square of what forces at each node leave."""
    seen = [(view, _driven(forward, view, k_b)) for view in views]
    found = []
    for hypothesis in hypotheses:
        node = hypothesis.terms[0].node
        parts = [soften(np.sqrt(_forces(forward, view, k_b, node, driven).left)) ** 2 for view, driven in seen]
        found.append(float(np.mean(np.concatenate(parts))))
    return found


# -- the law --------------------------------------------------------------------------------------------


def _laws(found: _Located, views: Sequence[_View], forward: Forward) -> list[tuple[Hypothesis, FloatArray]]:
    """Starts at one node: the laws, of a branch with either damper, that suit its Z best."""
    node, k_b = found.hypothesis.terms[0].node, found.k_b or 1.0
    forces = [_forces(forward, view, k_b, node, _driven(forward, view, k_b)) for view in views]
    told = [(view.omega, *one.stiffness) for view, one in zip(views, forces, strict=True)]
    omega, Z, std = (np.concatenate(parts) for parts in zip(*told, strict=True))
    usable = np.isfinite(Z) & np.isfinite(std)
    law, bent = _LinearLaw(omega[usable], Z[usable], std[usable]), found.hypothesis.bent
    ranges = {free.name: free.ends for free in bent.free}
    made = []
    for damper, least in DAMPERS.items():
        low, high = ranges[damper]
        ratios = max(low, float(np.log(max(least, 1e-300)))), high
        made.append(law.with_branch(damper, [ranges["branch_frequency"], ratios]))
    return [(bent, bent.clipped(_coordinates(bent, k_b, numbers))) for numbers in made]


def _coordinates(hypothesis: Hypothesis, k_b: float, numbers: dict[str, float]) -> FloatArray:
    """(1 + n_free,) of physical numbers."""
    values = [numbers[free.name] for free in hypothesis.free]
    values = [np.log(max(x, free.low)) if free.log else x for x, free in zip(values, hypothesis.free, strict=True)]
    return np.array([np.log(k_b), *values])


class _LinearLaw:
    """Least squares of Z by k, m, c and the mass of a branch, none of them active."""

    def __init__(self, omega: FloatArray, Z: ComplexArray, std: FloatArray):
        self.omega = omega
        self.weight = 1 / np.hypot(std, JOINT_SEARCH.law_error * np.abs(Z))
        one = np.ones(len(omega), dtype=complex)
        self.base = [one, -one, -(omega**2) * one, 1j * omega]  # k either way, m, c
        self.target = self._real(Z)

    def _real(self, values: ComplexArray) -> FloatArray:
        z = values * self.weight
        return np.concatenate([z.real, z.imag])

    def _solve(self, *more: ComplexArray) -> tuple[float, FloatArray]:
        columns = np.stack([self._real(column) for column in (*self.base, *more)], axis=1)
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        Q, R = np.linalg.qr(columns / size)
        x, left = nnls(R, Q.T @ self.target)
        return left, x / size

    def with_branch(self, damper: str, ends: Sequence[tuple[float, float]]) -> dict[str, float]:
        """The numbers of the law that leaves least, from the lowest point of a grid.

        damper : which of its dampers the branch has
        ends : ranges of the logarithms of the branch's frequency [Hz] and damping ratio
        """
        grid = np.meshgrid(np.linspace(*ends[0], JOINT_SEARCH.frequencies), np.linspace(*ends[1], JOINT_SEARCH.ratios))
        points = np.stack([axis.ravel() for axis in grid], axis=1)
        begin = min(points, key=lambda at: self._beside(damper, at)[0])
        at = minimize(lambda at: self._beside(damper, at)[0], begin, method="Nelder-Mead", bounds=ends).x
        x = self._beside(damper, at)[1]
        numbers = {"stiffness": x[0] - x[1], "mass": x[2], "damping": x[3], "branch_mass": x[4]}
        return numbers | dict.fromkeys(DAMPERS, 0.0) | dict(zip(("branch_frequency", damper), np.exp(at), strict=True))

    def _beside(self, damper: str, at: FloatArray) -> tuple[float, FloatArray]:
        """What a branch of this frequency and damping ratio, both as logarithms, leaves, and the numbers."""
        frequency, ratio = np.exp(at)
        undamped = MeasuredJoint(0.0, 0.0, 0.0, branch_mass=1.0, branch_frequency=frequency)
        unit = replace(undamped, **dict.fromkeys(DAMPERS, 0.0) | {damper: ratio})
        return self._solve(unit.dynamic_stiffness(self.omega))
