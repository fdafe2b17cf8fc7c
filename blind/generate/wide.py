"""The distance of ``detection`` for rigs of which little is known.

Resonances may drift by more than their width, so that a drift is no small change of the response, and dampings are
known by their order only. Both are parameters of the fit like modulus and span, with priors of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from rigtwin.blind.generate.case import Case
from rigtwin.blind.generate.detection import N_DRIFTS, Distance, Fit, State, stacked
from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.machine import Setting
from rigtwin.blind.generate.rig import ComplexArray, FloatArray, Rig

PEAK_ERROR = 1e-4  # relative, of a resonance that is read from the lines
ITERATIONS = 20


class WideDistance(Distance):
    """Parameters: those of ``Distance``, the logarithms of both dampings, each run's drifts."""

    rotations_follow: ClassVar[bool] = True

    def __init__(
        self,
        rig: Rig,
        case: Case,
        settings: Sequence[Setting],
        lines: Sequence[FloatArray],
        beside: Sequence[Effect] = (),
    ) -> None:
        super().__init__(rig, case, settings, lines, beside)
        self.n_affine = self.n_physical
        self.n_steady = self.n_affine + 2
        self.n_physical = self.n_steady + N_DRIFTS * len(self.runs)
        self.peak_error = PEAK_ERROR

    def of(self, responses: Sequence[ComplexArray], iterations: int = ITERATIONS) -> float:
        """Square root of the least chi^2; see ``Distance.of``."""
        return super().of(responses, iterations)

    def _starts(self, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]) -> list[FloatArray]:
        """The rig as it is; where that is far off, also the best with its resonances on the campaign's."""
        starts = super()._starts(responses, weights)
        if not starts[0].any():
            return starts
        matched = [start + damping for start in self._candidates(responses)[1] for damping in self._other_dampings()]
        return [*starts, min(matched, key=lambda theta: self._profile(theta, responses, weights).chi)]

    def _other_dampings(self) -> list[FloatArray]:
        """(q,) the dampings as they are, and twice their tolerances off."""
        known = self.case.tolerances
        shaft, bearing = np.eye(self.n_physical)[self.n_affine : self.n_steady]
        offs = [(i * known.shaft_damping, j * known.bearing_damping) for i in (-2, 0, 2) for j in (-2, 0, 2)]
        return [i * shaft + j * bearing for i, j in offs]

    def _longest_step(self, step: FloatArray) -> float:
        """Logarithms of dampings may change by more than what is relative to the rig."""
        dampings = np.zeros(len(step), dtype=bool)
        dampings[self.n_affine : self.n_steady] = True
        return min(super()._longest_step(step[~dampings]), 1.0 / max(1e-12, float(np.abs(step[dampings]).max())))

    def _drifts(self, number: int, theta: FloatArray) -> FloatArray:
        """(N_DRIFTS,) of a run."""
        start = self.n_steady + N_DRIFTS * number
        return theta[start : start + N_DRIFTS]

    def _modes(self, number: int, theta: FloatArray) -> FloatArray:
        """(m,) undamped resonances of a run, drifted [rad/s]."""
        modes = self.runs[number].frequencies(theta[: self.n_affine])
        drifts = self._drifts(number, theta)[: len(modes)]
        return np.concatenate([modes[: len(drifts)] * (1 + drifts), modes[len(drifts) :]])

    def _model(self, number: int, theta: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, n_nodes) response of a run and (n_freq, n_nodes, N_DRIFTS) its slopes by the drifts."""
        drifts = self._drifts(number, theta)
        log_dampings = np.clip(theta[self.n_affine : self.n_steady], -20.0, 20.0)  # a trial may be anywhere
        shaft, bearing = np.exp(log_dampings).tolist()
        state = State(shaft, bearing, drifts)
        x, slopes = self.runs[number].with_drift_slopes(theta[: self.n_affine], N_DRIFTS, state)
        return x, slopes / (1 + drifts)  # by the drift itself, not by what it adds to a resonance that has drifted

    def _residual(
        self, theta: FloatArray, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Weighted residual and its linear columns: each run's gain, the sensors' gains, and those of each run."""
        rows, blocks = [], []
        n_runs, n_channels = len(self.runs), len(self.channels)
        for i, (H, weight) in enumerate(zip(responses, weights, strict=True)):
            model = self._model(i, theta)[0][:, self.channels]
            own = model[:, :, None] * np.eye(n_channels)  # (n_freq, n_channels, n_channels)
            force = np.zeros((*model.shape, n_runs), dtype=complex)
            force[:, :, i] = model
            columns = np.concatenate([force, own], axis=2)
            if self.case.tolerances.repeatability:
                apart = np.zeros((*model.shape, n_runs * n_channels), dtype=complex)
                apart[:, :, i * n_channels : (i + 1) * n_channels] = own
                columns = np.concatenate([columns, apart], axis=2)
            here = weight[:, self.channels]
            rows.append(stacked((H[:, self.channels] - model) * here))
            blocks.append(stacked(columns * (here + 0j)[:, :, None]))
        return np.concatenate(rows), np.concatenate(blocks)

    def _slopes(self, fit: Fit, n: int, responses: Sequence[ComplexArray], weights: Sequence[FloatArray]) -> FloatArray:
        """(n_rows, n) derivatives of the residual: by differences, but those by the drifts in closed form."""
        steady = super()._slopes(fit, self.n_steady, responses, weights)
        rows = []
        for i, weight in enumerate(weights):
            slopes = self._model(i, fit.theta)[1][:, self.channels]
            block = np.zeros((*slopes.shape[:2], N_DRIFTS * len(self.runs)), dtype=complex)
            block[:, :, i * N_DRIFTS : (i + 1) * N_DRIFTS] = slopes
            rows.append(stacked(-block * (weight[:, self.channels] + 0j)[:, :, None]))
        return np.hstack([steady, np.concatenate(rows)])

    def _physical_prior(self) -> FloatArray:
        """(q,) one over the prior's standard deviation; k_b is free."""
        known = self.case.tolerances
        dampings = 1 / known.shaft_damping, 1 / known.bearing_damping
        drifts = (1 / known.drift,) * (N_DRIFTS * len(self.runs))
        return np.array([*super()._physical_prior(), *dampings, *drifts])

    def _linear_prior(self, n_columns: int) -> FloatArray:
        known, n_runs, n_channels = self.case.tolerances, len(self.runs), len(self.channels)
        shared = [1 / known.gain] * n_runs + [2 / known.gain] * n_channels
        return np.array([*shared, *[1 / (known.repeatability or 1.0)] * (n_columns - len(shared))])


def distance_for(
    rig: Rig, case: Case, settings: Sequence[Setting], lines: Sequence[FloatArray], beside: Sequence[Effect] = ()
) -> Distance:
    """The distance that suits what is known of the rig."""
    kind = WideDistance if case.tolerances.shaft_damping else Distance
    return kind(rig, case, settings, lines, beside)
