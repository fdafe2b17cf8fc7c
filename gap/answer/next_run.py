"""Which measurement separates the causes that remain.

Each proposed run is computed for every member of the answered set, at its fitted numbers, with the noise that the
campaign has. Two members differ by

    chi2 = min over x of |(H_a - H_b - J x) / std|^2 + x' P^-1 x,

where x is what b may still change: its numbers and the sensors' gains within the errors they have after the fit, and
the gain and drifts of the new run within their priors. The run whose least chi2 over all pairs is largest is proposed.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rigtwin.gap.answer.causes import locations
from rigtwin.gap.document import NextTest
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B
from rigtwin.gap.inference.nuisances import PRIOR
from rigtwin.gap.inference.observed import as_real
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward, acting, nonlinear
from rigtwin.gap.model.linear import MODES
from rigtwin.gap.phrases import effects_at, supports
from rigtwin.rotor.effects import Effect, known_mass
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Channel, Run, SupportKind


@dataclass(frozen=True)
class ProposedRuns:
    """What proposed runs look like, and when they separate two members."""

    told_apart: float = 25.0  # chi-squared from which two members count as told apart
    added_mass: float = 0.03  # of a known mass to clamp on, over the rotor's
    lines: int = 60  # of a proposed run, evenly over the range; more round every resonance
    round_resonance: tuple[float, ...] = (-20, -10, -5, -2.5, -1, 0, 1, 2.5, 5, 10, 20)  # relative distances * 1e3
    levels: tuple[float, ...] = (1 / 3, 3.0)  # factors on a force that is measured already
    least_error: float = 1e-3  # of a value, over the run's median response


PROPOSED = ProposedRuns()

_NO_DRIFT = np.zeros(MODES, dtype=complex)


@dataclass(frozen=True)
class Proposal:
    """A measurement that could be made."""

    words: str
    runs: tuple[Run, ...]  # their settings and lines; no response
    gain_std: float = 0.0  # prior of the force gain
    added: tuple[Effect, ...] = ()  # what is clamped to the rotor on purpose

    @property
    def settings(self) -> dict[str, Any]:
        """The last run as a [[run]] table of a campaign."""
        run = self.runs[-1]
        plane = {"excitation_plane": "z"} if run.excitation_plane == "z" else {}
        force = float(f"{run.force_amplitude_N or 1.0:.2g}")
        there = {"support": run.support, "excitation_node": run.excitation_node}
        return {**there, **plane, "force_amplitude_N": force}


@dataclass(frozen=True)
class Separation:
    """A proposal and how well it tells the members apart."""

    proposal: Proposal
    chi2: float  # the least over all pairs
    pair: tuple[int, int] = field(default=(0, 1))  # which one


def best_next_test(problem: Problem, fits: Sequence[Fit]) -> NextTest | None:
    """The run that separates the members of an answered set best; None where no run can be computed for all of them.

    Parameters
    ----------
    problem : all runs, as they were fitted
    fits : one of each member, at least two

    Raises
    ------
    ValueError : fewer than two members
    """
    if len(fits) < 2:
        raise ValueError("a next test separates at least two candidates")
    ranked = separations(problem, fits, proposals(problem, fits))
    if not ranked:
        return None
    best = ranked[0]
    a, b = (effects_at(fits[k].hypothesis.ids, locations(fits[k].hypothesis, fits[k].u)) for k in best.pair)
    least = "" if len(fits) == 2 else "least of all pairs, "
    apart = f"{least}{a} and {b} then differ by chi-squared {_round(best.chi2)}"
    words = f"{best.proposal.words}: of {len(ranked)} possible runs it separates the candidates best; {apart}"
    words += "." if best.chi2 > PROPOSED.told_apart else ", which is not enough to tell them apart."
    return NextTest(words, best.proposal.settings)


def separations(problem: Problem, fits: Sequence[Fit], proposed: Sequence[Proposal]) -> list[Separation]:
    """Every proposal with the least chi-squared between two members, the best one first."""
    noise = relative_noise(problem)
    # Nothing was measured yet: a nonlinear branch is followed from line to line.
    forward = Forward(problem.forward.workshop).made(with_data=False)
    found = []
    for proposal in proposed:
        try:
            views = [_View(problem, forward, fit, proposal, noise) for fit in fits]
        except (ValueError, np.linalg.LinAlgError):  # an effect that the run's setting makes impossible
            continue
        pairs = [(a, b) for a, b in itertools.permutations(range(len(fits)), 2)]
        sizes = [views[b].distance(views[a]) for a, b in pairs]
        k = int(np.argmin(sizes))
        found.append(Separation(proposal, sizes[k], pairs[k]))
    return sorted(found, key=lambda separation: -separation.chi2)


def relative_noise(problem: Problem) -> float:
    """Standard error over response, in the median of all values."""
    parts = []
    for observed in problem.observed:
        size = np.abs(np.nan_to_num(observed.run.H))
        usable = observed.valid & (size > 0)
        parts.append((observed.std[usable] / size[usable]).ravel())
    every = np.concatenate(parts)
    return float(np.median(every)) if len(every) else 0.01


# -- what could be measured ------------------------------------------------------------------------


def proposals(problem: Problem, fits: Sequence[Fit]) -> list[Proposal]:
    """Other drive nodes, the other support, three levels, a known mass, more accelerometers."""
    structure = problem.forward.structure
    lines = _lines(problem, fits)
    made: list[Proposal] = []
    for support in ("bearing", "rigid"):
        run = _template(problem.runs, support, lines)
        made += _driven(problem.runs, run, structure, run.support in {r.support for r in problem.runs})
    run = _template(problem.runs, "bearing" if problem.with_k_b else "rigid", lines)
    here = f"on {supports(run.support)} at node {run.excitation_node}"
    if any(nonlinear(fit.effects) for fit in fits):
        levels = tuple(run.at_force(factor) for factor in PROPOSED.levels)
        made.append(Proposal(f"Drive the rotor {here} at a third and at three times the force", levels))
    else:
        made += _with_known_mass(run, structure, here)
    everywhere = tuple(Channel(node, run.excitation_plane) for node in range(1, structure.n_nodes + 1))
    if not set(everywhere) <= set(run.channels):
        everywhere = (*everywhere, *(c for c in run.channels if c not in everywhere))
        words = f"Repeat the run {here} with an accelerometer at every node"
        made.append(Proposal(words, (replace(run, channels=everywhere, H=_no_response(lines, everywhere)),)))
    gain_std = PRIOR.any_scale if run.quantity == "acceleration" else problem.nuisances.gain_std
    return [replace(each, gain_std=gain_std) for each in made]


def _driven(runs: Sequence[Run], run: Run, structure: Structure, measured: bool) -> Iterator[Proposal]:
    """Every free drive node that was not used on this support; the node in use, where the support is new."""
    used = {r.excitation_node for r in runs if r.support == run.support}
    nodes = [node for node in structure.free_nodes if node not in used] if measured else [run.excitation_node]
    for node in nodes:
        words = f"Drive the rotor on {supports(run.support)} at node {node}, accelerometers as they are"
        yield Proposal(words, (replace(run, excitation_node=node),))


def _with_known_mass(run: Run, structure: Structure, here: str) -> Iterator[Proposal]:
    mass = float(f"{PROPOSED.added_mass * scale_of(structure).mass:.1g}")
    for node in structure.free_nodes:
        words = f"Clamp a known mass of {mass:g} kg to node {node}, add it to the rig file, and repeat the run {here}"
        yield Proposal(words, (run,), added=(known_mass(mass, node),))


def _template(runs: Sequence[Run], support: SupportKind, lines: FloatArray) -> Run:
    """A run as the ones that were measured, on a support, without response."""
    alike = [run for run in runs if run.support == support] or list(runs)
    run = max(alike, key=lambda r: (r.force_amplitude_N or 0.0, len(r.channels)))
    bare = replace(run, std=None, harmonics={}, swept_hz=None, force_N=None)
    H = _no_response(lines, run.channels)
    return replace(bare, support=support, frequency_hz=lines, H=H, name="proposed")


def _no_response(lines: FloatArray, channels: Sequence[Channel]) -> ComplexArray:
    return np.zeros((len(lines), len(channels)), dtype=complex)


def _lines(problem: Problem, fits: Sequence[Fit]) -> FloatArray:
    """The range that was measured, denser round every member's resonances."""
    low = min(run.frequency_hz[0] for run in problem.runs)
    high = max(run.frequency_hz[-1] for run in problem.runs)
    parts = [np.linspace(low, high, PROPOSED.lines)]
    for fit in fits:
        for modal in problem.modals(fit.k_b, fit.effects):
            parts += [f * (1 + 1e-3 * np.array(PROPOSED.round_resonance)) for f in modal.frequencies_hz]
    every = np.unique(np.round(np.concatenate(parts), 4))
    return every[(every >= low) & (every <= high)]


# -- how far two members are apart -------------------------------------------------------------------


class _View:
    """A member's prediction of a proposal, its error, and what the member may still change."""

    def __init__(self, problem: Problem, forward: Forward, fit: Fit, proposal: Proposal, noise: float):
        forward = forward.at(fit.nu[problem.nuisances.tolerance])
        self.problem, self.forward, self.fit, self.proposal, self.noise = problem, forward, fit, proposal, noise
        self.H = [self._respond(run, fit.u) for run in proposal.runs]
        self.sensors = sorted({channel for run in proposal.runs for channel in run.channels})
        self.prior = self._prior()
        self.columns = [self._derivatives(r) for r in range(len(proposal.runs))]

    def distance(self, truth: _View) -> float:
        """Chi-squared by which this member misses what another one would measure."""
        flat, J = [], []
        for r, run in enumerate(self.proposal.runs):
            size = np.abs(truth.H[r])
            relative = np.hypot(self.noise, self.problem.model_error)
            least = PROPOSED.least_error * np.median(size[size > 0]) if (size > 0).any() else 1.0
            std = np.hypot(relative * size, least)
            moving = size > 1e-9 * max(size.max(initial=0.0), 1e-300)
            weight = np.where(moving, np.sqrt(2) / std, 0.0)
            off = (run.as_recorded(truth.H[r]) - run.as_recorded(self.H[r])) * weight
            flat.append(off.ravel() if run.magnitude_only else as_real(off, self.H[r], run))
            J.append(as_real(np.array(self.columns[r]) * weight, self.H[r], run))
        residual, jacobian = np.concatenate(flat), np.concatenate(J, axis=1)
        g = jacobian @ residual
        return float(residual @ residual - g @ np.linalg.solve(jacobian @ jacobian.T + self.prior, g))

    def _respond(self, run: Run, u: FloatArray) -> ComplexArray:
        return self._modal(run, u).response(None, self._tolerance) * self._gains(run)

    @property
    def _tolerance(self) -> FloatArray:
        """(n_tolerances,) of the rig, as they were fitted: they stay."""
        return self.fit.nu[self.problem.nuisances.tolerance]

    def _gains(self, run: Run) -> FloatArray:
        """(n_channels,) gains of the sensors, as they were fitted; 1 of a new one."""
        nuisances = self.problem.nuisances
        known = dict(zip(nuisances.sensors, self.fit.nu[nuisances.sensor], strict=True))
        return np.exp([known.get(channel, 0.0) for channel in run.channels])

    def _modal(self, run: Run, u: FloatArray):
        effects = acting(self.fit.hypothesis.effects(u[1:]), run.support)
        return self.forward.modal(run, K_B.value(u[0]), (*effects, *self.proposal.added))

    def _derivatives(self, r: int) -> list[ComplexArray]:
        """Of one run: by u, known sensors' gains, tolerances; then by every run's gain, drifts, level; new sensors."""
        run, H = self.proposal.runs[r], self.H[r]
        nuisances = self.problem.nuisances
        D = self._modal(run, self.fit.u).with_derivatives(_NO_DRIFT, self._tolerance)[1] * self._gains(run)
        columns = [self._by_number(run, H, j) for j in range(len(self.fit.u))]
        columns += [_one_channel(H, run, channel) for channel in nuisances.sensors]
        D, by_tolerance, by_level = np.split(D, [2 * MODES, 2 * MODES + len(self._tolerance)])
        columns += list(by_tolerance)
        for other in range(len(self.proposal.runs)):
            own = [H, *D, by_level[0] if len(by_level) else np.zeros_like(H)]
            columns += own if other == r else [np.zeros_like(H)] * len(own)
        return columns + [_one_channel(H, run, channel) for channel in self._new_sensors()]

    def _by_number(self, run: Run, H: ComplexArray, j: int) -> ComplexArray:
        """Derivative by a coordinate; none of a nonlinear member, which would take too long."""
        if nonlinear(self.fit.effects):
            return np.zeros_like(H)
        ends = self.fit.hypothesis.ends[j]
        step = 1e-5 * (ends[1] - ends[0]) * (1 if self.fit.u[j] < np.mean(ends) else -1)
        u = self.fit.u.copy()
        u[j] += step
        own = (_NO_DRIFT, self._tolerance)
        change = self._modal(run, self.fit.u).change_to(self._modal(run, u), *own)
        return change * self._gains(run) / step

    def _new_sensors(self) -> list[Channel]:
        return [channel for channel in self.sensors if channel not in self.problem.nuisances.sensors]

    def _prior(self) -> FloatArray:
        """Inverse covariance of what may change, in the order of ``_derivatives``."""
        n_u, nuisances = len(self.fit.u), self.problem.nuisances
        kept = np.r_[np.arange(n_u), n_u + np.r_[nuisances.sensor], n_u + np.r_[nuisances.tolerance]]
        known = np.linalg.inv(self.fit.covariance()[np.ix_(kept, kept)])
        drift_std = float(self.fit.prior_std[nuisances.drift[0].start])
        own = [self.proposal.gain_std**-2, *[drift_std**-2] * (2 * MODES), nuisances.level_std**-2]
        fresh = own * len(self.proposal.runs)
        fresh += [nuisances.sensor_std**-2] * len(self._new_sensors())
        prior = np.zeros((len(kept) + len(fresh),) * 2)
        prior[: len(kept), : len(kept)] = known
        prior[range(len(kept), len(prior)), range(len(kept), len(prior))] = fresh
        return prior


def _one_channel(H: ComplexArray, run: Run, channel: Channel) -> ComplexArray:
    """Derivative by a sensor's gain."""
    return np.where([own == channel for own in run.channels], H, 0.0)


def _round(value: float) -> str:
    return f"{value:.2g}" if value < 1e4 else f"{value:.0e}".replace("e+0", "e").replace("e+", "e")
