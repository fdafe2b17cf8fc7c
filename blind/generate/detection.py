"""How large an effect is against the smallest that the campaign could show at all.

Distance: the noise-weighted least squares between the campaign with the effect and the nearest campaign without it.
Nearest means that k_b, the workshop's tolerances, force gains, sensor gains and the drift of every resonance in every
run are refitted; all but k_b pay for it by their priors. The detection limit is the share of the severity at which the
distance reaches three standard deviations (chi^2 = 9).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from rigtwin.blind.generate.case import Case, standard_error
from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.machine import Machine, Setting, Workshop, build_machine
from rigtwin.blind.generate.rig import ComplexArray, FloatArray, Rig

THRESHOLD = 3.0  # standard deviations
N_SHAPES = 14
N_DRIFTS = 6


@dataclass(frozen=True)
class State:
    """A rig's dampings over its own, and how far its lowest resonances have drifted in a run."""

    shaft_damping: float = 1.0
    bearing_damping: float = 1.0
    drifts: FloatArray | None = None  # (n_drifts,) relative


@dataclass(frozen=True)
class PlainRun:
    """A run without the effect on m shapes, affine in its q parameters: the workshop's deviations and k_b."""

    omega: FloatArray  # (n_freq,)
    M: FloatArray  # (m, m)
    K: FloatArray
    K_shaft: FloatArray
    C: FloatArray
    slopes: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]  # q times (dM, dK, dK_shaft)
    zeta: float
    drive: FloatArray  # (m,)
    read: FloatArray  # (n_nodes, m)

    def frequencies(self, parameters: FloatArray) -> FloatArray:
        """(m,) undamped [rad/s]; none so far out that the affine masses are no longer positive."""
        M, K, _ = self._matrices(parameters)
        try:
            return np.sqrt(np.maximum(scipy.linalg.eigh(K, M, eigvals_only=True), 0.0))
        except np.linalg.LinAlgError:
            return np.zeros(0)

    def _matrices(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """M, K and K_shaft, (m, m) each."""
        bases = (self.M, self.K, self.K_shaft)
        changes = [sum(p * slope[i] for p, slope in zip(parameters, self.slopes, strict=True)) for i in range(3)]
        M, K, K_shaft = (base + change for base, change in zip(bases, changes, strict=True))
        return M, K, K_shaft

    def at(self, parameters: FloatArray) -> ComplexArray:
        return self.with_drift_slopes(parameters, 0)[0]

    def with_drift_slopes(
        self, parameters: FloatArray, n_drifts: int, state: State | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, n_nodes) accelerance, and (n_freq, n_nodes, n_drifts) its slope by each resonance's drift.

        state : dampings and drifts at which it is wanted; by default those of the rig itself

        Not a number so far out that the affine masses are no longer positive: the distance of such a trial is infinite.
        """
        M, K, K_shaft = self._matrices(parameters)
        try:
            squares, Phi = scipy.linalg.eigh(K, M)
        except np.linalg.LinAlgError:
            shape = (len(self.omega), len(self.read))
            return np.full(shape, np.nan, dtype=complex), np.full((*shape, n_drifts), np.nan, dtype=complex)
        with np.errstate(invalid="ignore"):  # a trial may make the rotor unstable; its distance is infinite
            root = squares**0.25
        state = state or State()
        zeta, C_b = self.zeta * state.shaft_damping, state.bearing_damping * self.C
        C = Phi.T @ C_b @ Phi + 2 * zeta * (Phi.T @ K_shaft @ Phi) / np.outer(root, root)
        if state.drifts is not None:
            squares = squares.copy()
            squares[: len(state.drifts)] *= (1 + state.drifts) ** 2
        w = self.omega[:, None, None]
        D = np.diag(squares) + 1j * w * C - w**2 * np.eye(len(squares))
        loads = np.hstack([(Phi.T @ self.drive)[:, None], np.eye(len(squares))[:, :n_drifts]]).astype(complex)
        q = np.linalg.solve(D, np.broadcast_to(loads, (len(w), *loads.shape)))  # (n_freq, m, 1 + n_drifts)
        x = -(w**2) * ((self.read @ Phi) @ q)  # (n_freq, n_nodes, 1 + n_drifts)
        slopes = -x[:, :, 1:] * (2 * squares[:n_drifts] * q[:, :n_drifts, 0])[:, None, :]
        return x[:, :, 0], slopes


def plain_run(
    rig: Rig,
    setting: Setting,
    workshop: Workshop,
    frequency_hz: FloatArray,
    beside: Sequence[Effect] = (),
    *,
    rotations_follow: bool = False,
) -> PlainRun:
    """Parameters: modulus, span, each disk mass (relative), log k_b (bearing run only counts).

    beside : effects that the run has, too
    rotations_follow : whether a longer span turns the cross-sections of a shape less; without it a shape is sheared,
        and deviations of a thousandth are too stiff. The sizes of W1 to W8 were measured without.
    """
    base = build_machine(rig, setting, beside, workshop)
    basis = _basis(base)
    changed = _changed(rig, setting, workshop, beside)

    def small(matrix: FloatArray) -> FloatArray:
        return basis.T @ matrix @ basis

    slopes = [
        (small(m.M - base.M) * 1e3, small(m.K - base.K) * 1e3, small(m.K_shaft - base.K_shaft) * 1e3) for m in changed
    ]
    if rotations_follow:
        slopes[1] = _stretched(base, changed[1], basis, 1e-3)
    return PlainRun(
        2 * np.pi * frequency_hz,
        small(base.M),
        small(base.K),
        small(base.K_shaft),
        small(base.C),
        tuple(slopes),
        base.zeta,
        base.drive @ basis,
        base.read @ basis,
    )


def _changed(rig: Rig, setting: Setting, workshop: Workshop, beside: Sequence[Effect]) -> list[Machine]:
    """Machines of which one parameter each is larger by a thousandth."""
    workshops = [replace(workshop, modulus=workshop.modulus + 1e-3), replace(workshop, span=workshop.span + 1e-3)]
    for i, deviation in enumerate(workshop.disk_masses):
        masses = [*workshop.disk_masses]
        masses[i] = deviation + 1e-3
        workshops.append(replace(workshop, disk_masses=tuple(masses)))
    changed = [build_machine(rig, setting, beside, other) for other in workshops]
    return [*changed, build_machine(rig, replace(setting, k_b=setting.k_b * (1 + 1e-3)), beside, workshop)]


def _stretched(
    base: Machine, longer: Machine, basis: FloatArray, stretch: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slopes of M, K and K_shaft by the span, (m, m) each, with shapes that keep their deflections."""
    follow = basis.copy()
    follow[list(base.rotations)] /= 1 + stretch
    pairs = ((longer.M, base.M), (longer.K, base.K), (longer.K_shaft, base.K_shaft))
    M, K, K_shaft = ((follow.T @ new @ follow - basis.T @ old @ basis) / stretch for new, old in pairs)
    return M, K, K_shaft


def _basis(machine: Machine) -> FloatArray:
    """(n, m) lowest modes, and what they lack of the static shapes under forces at the exciter and the bearings."""
    basis = machine.Phi[:, :N_SHAPES]
    for load in (machine.drive, *(joint.row for joint in machine.bearings)):
        shape = np.linalg.solve(machine.K, load)
        for _ in range(2):
            shape = shape - basis @ (basis.T @ (machine.M @ shape))
        basis = np.column_stack([basis, shape / np.sqrt(shape @ machine.M @ shape)])
    return basis


class Distance:
    """Distance of a campaign from the nearest one that has no effects but those ``beside``; runs on given lines."""

    rotations_follow: ClassVar[bool] = False

    def __init__(
        self,
        rig: Rig,
        case: Case,
        settings: Sequence[Setting],
        lines: Sequence[FloatArray],
        beside: Sequence[Effect] = (),
    ) -> None:
        self.case = case
        self.runs = [
            plain_run(rig, s, case.workshop, f, beside, rotations_follow=self.rotations_follow)
            for s, f in zip(settings, lines, strict=True)
        ]
        self.n_physical = len(self.runs[0].slopes)
        self.place_of_k_b = self.n_physical - 1
        self.peak_error = case.tolerances.drift  # relative, of a resonance that is seen
        self.channels = [n - 1 for n in case.nodes]

    def of(self, responses: Sequence[ComplexArray], iterations: int = 10) -> float:
        """Square root of the least chi^2, by Gauss-Newton over the physical parameters, the linear ones eliminated.

        responses : (n_freq, n_nodes) accelerance of each run with the effect, on the lines
        """
        weights = [np.sqrt(2) / standard_error(H, self.case.noise) for H in responses]
        starts = self._starts(responses, weights)
        return min(self._fitted(start, responses, weights, iterations) for start in starts)

    def _fitted(
        self, start: FloatArray, responses: Sequence[ComplexArray], weights: Sequence[FloatArray], iterations: int
    ) -> float:
        """Square root of the least chi^2 that Gauss-Newton finds from a start."""
        fit = self._profile(start, responses, weights)
        for _ in range(iterations):
            step = self._step(fit, responses, weights)
            for shortened in (1.0, 0.3, 0.1, 0.01):
                trial = self._profile(fit.theta + shortened * step, responses, weights)
                if trial.chi < fit.chi:
                    break
            if trial.chi > 0.995 * fit.chi:
                return min(trial.chi, fit.chi)
            fit = trial
        return fit.chi

    def _starts(self, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]) -> list[FloatArray]:
        """(q,) parameters to begin with, here one: a fit that begins beside narrow resonances stays there."""
        zero = np.zeros(self.n_physical)
        if self._profile(zero, responses, weights).chi < 10 * THRESHOLD:
            return [zero]
        near, matched = self._candidates(responses)
        return [min([*near, *matched], key=lambda theta: self._profile(theta, responses, weights).chi)]

    def _candidates(self, responses: Sequence[ComplexArray]) -> tuple[list[FloatArray], list[FloatArray]]:
        """Parameters (q,) that are near the rig's by some k_b, and with resonances that fall on the campaign's."""
        zero, by_k_b = np.zeros(self.n_physical), np.eye(self.n_physical)[self.place_of_k_b]
        peaks = [
            run.omega[_tops(np.abs(H[:, self.channels]).sum(axis=1))]
            for run, H in zip(self.runs, responses, strict=True)
        ]
        shifts = np.exp(np.arange(-1.5, 1.5, 0.005)) - 1
        misses = [np.abs(self._resonance_misses(shift * by_k_b, peaks)).sum() for shift in shifts]
        near = [zero, *(shifts[k] * by_k_b for k in np.argsort(misses)[:4])]
        return near, [self._with_resonances(start, peaks) for start in near]

    def _resonance_misses(self, theta: FloatArray, peaks: Sequence[FloatArray]) -> FloatArray:
        """(n_peaks,) how far the nearest mode lies above each peak of each run, relative."""
        misses = []
        for number, (run, at) in enumerate(zip(self.runs, peaks, strict=True)):
            modes = self._modes(number, theta)
            modes = modes[(modes > run.omega[0]) & (modes < run.omega[-1])]
            off = np.log(modes[:, None] / at)
            misses.append(off[np.abs(off).argmin(axis=0), np.arange(len(at))] if len(modes) else np.ones(len(at)))
        return np.concatenate(misses)

    def _modes(self, number: int, theta: FloatArray) -> FloatArray:
        """(m,) undamped resonances of a run [rad/s]."""
        return self.runs[number].frequencies(theta)

    def _with_resonances(self, theta: FloatArray, peaks: Sequence[FloatArray], iterations: int = 4) -> FloatArray:
        """(q,) parameters with the nearest modes on the peaks, as far as the priors and the drifts let them."""
        prior = np.diag(self._physical_prior())
        for _ in range(iterations):
            misses = self._resonance_misses(theta, peaks)
            slopes = [
                (self._resonance_misses(theta + step, peaks) - misses) / 1e-6 for step in 1e-6 * np.eye(len(theta))
            ]
            J = np.vstack([np.transpose(slopes) / self.peak_error, prior])
            theta = theta - np.linalg.lstsq(J, np.concatenate([misses / self.peak_error, prior @ theta]))[0]
        return theta

    def _step(self, fit: Fit, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]) -> FloatArray:
        """(q,) Gauss-Newton step of the physical parameters; the linear ones move along."""
        slopes = self._slopes(fit, self.n_physical, responses, weights)
        J = np.hstack([slopes, -fit.columns])
        weight = np.concatenate([self._physical_prior(), self._linear_prior(fit.columns.shape[1])]) ** 2
        at = np.concatenate([fit.theta, fit.linear])
        gradient = J.T @ (fit.residual - fit.columns @ fit.linear) + weight * at
        step = -np.linalg.solve(J.T @ J + np.diag(weight), gradient)[: self.n_physical]
        return step * min(1.0, self._longest_step(step))

    def _longest_step(self, step: FloatArray) -> float:
        """Share of a step that is not too long to be trusted."""
        return 0.2 / max(1e-12, float(np.abs(step).max()))

    def _slopes(self, fit: Fit, n: int, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]) -> FloatArray:
        """(n_rows, n) derivatives of the residual by the first n physical parameters."""
        slopes = np.empty((len(fit.residual), n))
        for p in range(n):
            shifted = fit.theta.copy()
            shifted[p] += 1e-6
            slopes[:, p] = (self._residual(shifted, responses, weights)[0] - fit.residual) / 1e-6
        return slopes

    def _profile(self, theta: FloatArray, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]) -> Fit:
        residual, columns = self._residual(theta, responses, weights)
        prior = self._linear_prior(columns.shape[1])
        linear = np.linalg.solve(columns.T @ columns + np.diag(prior**2), columns.T @ residual)
        left = residual - columns @ linear
        chi = left @ left + np.sum((prior * linear) ** 2) + np.sum((self._physical_prior() * theta) ** 2)
        return Fit(theta, linear, residual, columns, float(np.sqrt(chi)) if np.isfinite(chi) else np.inf)

    def _residual(
        self, theta: FloatArray, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Weighted residual and its linear columns: each run's gain and drifts, then sensor gains."""
        n_columns = len(self.runs) * (1 + N_DRIFTS) + len(self.channels)
        rows, blocks = [], []
        for i, (run, H, weight) in enumerate(zip(self.runs, responses, weights, strict=True)):
            model, drifts = run.with_drift_slopes(theta, N_DRIFTS)
            columns = np.zeros((*H.shape, n_columns), dtype=complex)
            columns[:, :, i * (1 + N_DRIFTS)] = model
            columns[:, :, i * (1 + N_DRIFTS) + 1 : (i + 1) * (1 + N_DRIFTS)] = drifts
            for s, channel in enumerate(self.channels):
                columns[:, channel, n_columns - len(self.channels) + s] = model[:, channel]
            rows.append(stacked(((H - model) * weight)[:, self.channels]))
            blocks.append(stacked((columns * (weight + 0j)[:, :, None])[:, self.channels]))
        return np.concatenate(rows), np.concatenate(blocks)

    def _physical_prior(self) -> FloatArray:
        """(q,) one over the prior's standard deviation; k_b is free."""
        known = self.case.tolerances
        n_disks = self.place_of_k_b - 2
        return np.array([1 / known.modulus, 1 / known.span, *(1 / known.disk_mass,) * n_disks, 1e-3])

    def _linear_prior(self, n_columns: int) -> FloatArray:
        known = self.case.tolerances
        runs = [1 / known.gain, *(1 / known.drift,) * N_DRIFTS] * len(self.runs)
        return np.array([*runs, *[2 / known.gain] * (n_columns - len(runs))])


@dataclass(frozen=True)
class Fit:
    theta: FloatArray  # (q,) physical parameters
    linear: FloatArray  # (n_columns,)
    residual: FloatArray  # (n_rows,) before the linear nuisances
    columns: FloatArray  # (n_rows, n_columns)
    chi: float


def _tops(size: FloatArray, most: int = 4) -> NDArray[np.intp]:
    """Where a curve has its largest local maxima."""
    inner = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    return inner[np.argsort(-size[inner])[:most]] if len(inner) else np.array([int(np.argmax(size))])


def stacked(values: ComplexArray) -> FloatArray:
    """Real and imaginary parts beside each other along the first two axes, flattened over them."""
    flat = values.reshape(values.shape[0] * values.shape[1], *values.shape[2:])
    return np.concatenate([flat.real, flat.imag])


def severity_at_limit(distance: Callable[[float], float], first: float = 0.05) -> float:
    """Severity at which the distance reaches the threshold, by secants in proportion; at most 1 is ever asked.

    distance : of the campaign at a share of its severity
    """
    severity = first
    for _ in range(6):
        reached = distance(severity)
        factor = THRESHOLD / max(reached, 1e-9)
        if abs(np.log(factor)) < 0.1 or (severity >= 1.0 and factor > 1.0):
            return severity * factor
        severity = float(np.clip(severity * np.clip(factor, 1e-3, 30.0), 1e-7, 1.0))
    return severity
