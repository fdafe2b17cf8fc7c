"""The network: two learned inverse curves, fused by their errors.

Each shift alone says what k_b is, up to a small influence of damping that the amplitude ratio
carries; so curve i is a small network g_i(log delta_f_i, log ratio) -> log k_b, over a reference in the
middle of the range, lest float32 spends its digits on the unit. The curves'
slopes turn the inputs' standard errors into errors of log k_b, beside which each curve has errors of its
own, which further small networks know: they depend on the place. The two answers are averaged by inverse
variance; what codes differ by puts both off alike, so that it counts in full. A third network knows the
largest ratio that a bearing without damping allows. What the inputs say about k_b twice over is what tells
whether they contradict each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from rigtwin.estimator.intervals import BETWEEN_CODES

# What the network's own log k_b is relative to [N/m].
K_REF = 1e7

# Neurons of a curve's layer.
_WIDTH = 8

# Logarithms of the least and the largest error that a curve may have of its own, whatever the calibration rigs say.
_OWN_ERROR = (math.log(1e-5), 0.0)


@dataclass(frozen=True)
class Limits:
    """What the network answers for; everything else is invalid."""

    k_b: tuple[float, float]
    shift_min: tuple[float, float]  # [Hz]
    shift_max: tuple[float, float]  # [Hz]
    ratio: tuple[float, float]
    relative_std_min: float = 1e-6  # smaller errors are taken as this
    relative_std_max: float = 0.3


class Curve(nn.Module):
    """A smooth map from a few normalised inputs to one number."""

    mean: Tensor
    scale: Tensor

    def __init__(self, mean: Tensor, scale: Tensor):
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("scale", scale)
        self.body = nn.Sequential(
            nn.Linear(len(mean), _WIDTH), nn.Tanh(), nn.Linear(_WIDTH, _WIDTH), nn.Tanh(), nn.Linear(_WIDTH, 1)
        )
        self.skip = nn.Linear(len(mean), 1)

    def forward(self, x: Tensor) -> Tensor:
        """(n, n_in) -> (n,)."""
        z = (x - self.mean) / self.scale
        return (self.body(z) + self.skip(z))[:, 0]

    def with_slopes(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """(n, n_in) -> (n,) and its derivatives (n, n_in)."""
        z = (x - self.mean) / self.scale
        first, second, last = (layer for layer in self.body if isinstance(layer, nn.Linear))
        one = first(z).tanh()
        two = second(one).tanh()
        value = (last(two) + self.skip(z))[:, 0]
        slopes = []
        for axis in range(x.shape[1]):
            inner = (1 - one**2) * first.weight[:, axis]
            outer = (1 - two**2) * (inner @ second.weight.T)
            slopes.append(((outer @ last.weight.T)[:, 0] + self.skip.weight[0, axis]) / self.scale[axis])
        return value, torch.stack(slopes, dim=1)


class StiffnessNetwork(nn.Module):
    """(n, 6) features with errors -> (n, 5): k_b, k_b_std, k_b_low, k_b_high [N/m], valid (0 or 1)."""

    floor: Tensor
    quantile: Tensor
    contradiction: Tensor
    ratio_floor: Tensor

    def __init__(
        self, curves: tuple[Curve, Curve], own_errors: tuple[Curve, Curve], ratio_bound: Curve, limits: Limits
    ):
        super().__init__()
        self.curve1, self.curve2 = curves
        self.own_error1, self.own_error2 = own_errors  # logarithms of the curves' errors in log k_b
        self.ratio_bound = ratio_bound
        self.limits = limits
        self.register_buffer("floor", torch.zeros(2))  # error of each curve in log k_b, over all places
        self.register_buffer("quantile", torch.tensor(1.645))  # half-width of the 90 % interval in sigmas
        self.register_buffer("contradiction", torch.tensor(4.0))  # largest disagreement of the curves in sigmas
        self.register_buffer("ratio_floor", torch.tensor(0.0))  # error of the ratio bound in log ratio

    def forward(self, features: Tensor) -> Tensor:
        """See the class."""
        log_shift, log_ratio, relative = self._inputs(features)
        answers, variances = self._answers(log_shift, log_ratio, relative)  # (n, 2), (n, 2)
        weight = 1 / variances
        log_k = (answers * weight).sum(dim=1) / weight.sum(dim=1)
        sigma = (1 / weight.sum(dim=1) + BETWEEN_CODES**2).sqrt()
        disagreement = _apart(answers, variances)
        # The bound is about as steep as k_b itself, so the error of log k_b counts once in full.
        excess = self.ratio_excess(log_k, log_ratio) / (relative[:, 2] ** 2 + self.ratio_floor**2 + sigma**2).sqrt()
        valid = self._in_range(features, log_k) & (disagreement < self.contradiction) & (excess < self.contradiction)
        k = K_REF * log_k.exp()
        half = self.quantile * sigma
        return torch.stack([k, k * sigma, k * (-half).exp(), k * half.exp(), valid.to(k.dtype)], dim=1)

    def ratio_excess(self, log_k: Tensor, log_ratio: Tensor) -> Tensor:
        """(n,) by how much the log ratio exceeds what bearings without damping allow; log_k is log(k_b / K_REF)."""
        return log_ratio - self.ratio_bound(log_k[:, None])

    def disagreement(self, features: Tensor) -> Tensor:
        """(n,) how far the two shifts' answers are apart, in standard deviations."""
        return _apart(*self._answers(*self._inputs(features)))

    def _inputs(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Logarithms of shifts (n, 2) and ratio (n,), and relative errors (n, 3), kept in range."""
        L = self.limits
        low = torch.tensor([*L.shift_min, L.ratio[0]], dtype=features.dtype)
        high = torch.tensor([*L.shift_max, L.ratio[1]], dtype=features.dtype)
        values = torch.minimum(torch.maximum(features[:, :3], low / 2), high * 2)
        relative = (features[:, 3:] / values).clamp(L.relative_std_min, 1.0)
        logs = values.log()
        return logs[:, :2], logs[:, 2], relative

    def _answers(self, log_shift: Tensor, log_ratio: Tensor, relative: Tensor) -> tuple[Tensor, Tensor]:
        """What each shift says about log k_b, and the variance of that."""
        answers, variances = [], []
        pairs = (self.curve1, self.own_error1), (self.curve2, self.own_error2)
        for i, (curve, own_error) in enumerate(pairs):
            x = torch.stack([log_shift[:, i], log_ratio], dim=1)
            errors = torch.stack([relative[:, i], relative[:, 2]], dim=1)
            value, slopes = curve.with_slopes(x)
            answers.append(value)
            own = own_error(x).clamp(*_OWN_ERROR)
            variances.append(((slopes * errors) ** 2).sum(dim=1) + (2 * own).exp())
        return torch.stack(answers, dim=1), torch.stack(variances, dim=1)

    def _in_range(self, features: Tensor, log_k: Tensor) -> Tensor:
        L = self.limits
        low = torch.tensor([*L.shift_min, L.ratio[0]], dtype=features.dtype)
        high = torch.tensor([*L.shift_max, L.ratio[1]], dtype=features.dtype)
        values, errors = features[:, :3], features[:, 3:]
        inside = (values >= low).all(dim=1) & (values <= high).all(dim=1)
        known = (errors >= 0).all(dim=1) & (errors <= L.relative_std_max * values.abs()).all(dim=1)
        # The ends of the range belong to it, to within what the curves themselves are worth.
        slack = 2 * self.floor.max()
        k_low, k_high = (torch.tensor(L.k_b, dtype=features.dtype) / K_REF).log()
        return inside & known & (log_k >= k_low - slack) & (log_k <= k_high + slack)


def _apart(answers: Tensor, variances: Tensor) -> Tensor:
    """(n,) how far both shifts' answers (n, 2) are apart, in standard deviations; each may be another code's."""
    return (answers[:, 0] - answers[:, 1]).abs() / (variances.sum(dim=1) + 2 * BETWEEN_CODES**2).sqrt()
