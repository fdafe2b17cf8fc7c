"""Fit a tracker's network to streams, calibrate its intervals on streams it has not seen, export it to ONNX."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import avg_pool1d, conv1d

from rigtwin.estimator.intervals import Z90
from rigtwin.estimator.tracking.network import MOST_DOUBTED
from rigtwin.estimator.tracking.streams import Streams
from rigtwin.rotor.model.arrays import FloatArray

# Instants of a stream for each of the network's; instants that a filter looks back; instants of a block; blocks of each
# average; filters; neurons of either layer.
EVERY, TAPS, BLOCK, SPANS, FILTERS, NEURONS = 2, 96, 16, (2, 4, 8, 16, 32, 64), 24, 24

# Stiffnesses and masses that predictions are made for at first.
STIFFNESSES, MASSES = 20, 3

# Noise of an accelerometer over the rms of its readings at most, standard error of its gain, and the noise that
# predictions are made for.
NOISE, GAIN, FIRST_NOISE = 0.03, 0.02, 0.015

# Degrees of freedom of the likelihood: nothing can know of a jump at once. Limits of ln sigma; least share of energy,
# and what is added to what a change of k_b would add, and to the force's share.
FREEDOM, DOUBTS, LEAST_SHARE, LITTLE = 4.0, (-7.0, 2.0), 1e-7, 1e-9

# Blocks between those that are learned from, epochs, rows of a step, streams that are filtered at once, and the largest
# rate.
_SPARSE, EPOCHS, _ROWS, _STREAMS, _RATE = 3, 40, 512, 16, 4e-3

# Numbers that are not rounded to half precision.
IN_SINGLE = ("sharpness", "ridge", "hidden.bias")

# Numbers of a span beside the residues: see ``ResidueNetwork.look``.
_BESIDE = 6

Progress = Callable[[int], None]


class ResidueNetwork(nn.Module):
    """Energies of what predictions of the acceleration are off by -> ln k_b and the logarithm of its standard error.

    Each cell is a prediction of the last acceleration from the instants before, for one stiffness and one mass, and its
    derivatives by both. Mean products of the three say by least squares which stiffness near it fits best, and what
    is left. The cells' answers are weighed by that, over several spans of time; two small networks correct the answer
    of each span, say how far it is off, and weigh the spans.
    """

    filters: Tensor
    cells: Tensor
    mean: Tensor
    std: Tensor

    def __init__(self, filters: Tensor, cells: Tensor, ln_k: Tensor, pitch: float):
        super().__init__()
        n = len(ln_k)
        self.pitch, self.channels = pitch, filters.shape[1]
        self.register_buffer("filters", filters)  # (FILTERS, channels, TAPS), of which all predictions are made
        self.register_buffer("cells", cells)  # (3 n, FILTERS)
        self.register_buffer("mean", torch.zeros(len(SPANS), n + _BESIDE))
        self.register_buffer("std", torch.ones(n + _BESIDE))
        self.ln_k, self.bias = nn.Parameter(ln_k), nn.Parameter(torch.zeros(n))
        self.sharpness, self.ridge = nn.Parameter(torch.tensor(4.0)), nn.Parameter(torch.tensor([-9.0, -9.0]))
        self.hidden, self.correct = nn.Linear(n + _BESIDE, NEURONS), nn.Linear(NEURONS, 2)
        self.weigh, self.answer = nn.Linear(2 * len(SPANS), NEURONS), nn.Linear(NEURONS, len(SPANS) + 1)
        for layer in (self.correct, self.answer):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def energies(self, signals: Tensor) -> Tensor:
        """(n, channels, instants) -> (n, 6 cells + channels, blocks) mean products of each cell, and mean squares."""
        raw = signals[:, :, TAPS - 1 :].square()
        off = torch.einsum("cf,nft->nct", self.cells, conv1d(signals, self.filters))
        e, k, m = off.chunk(3, dim=1)
        return avg_pool1d(torch.cat([e * e, e * k, e * m, k * k, k * m, m * m, raw], dim=1), BLOCK)

    def shares(self, energies: Tensor) -> Tensor:
        """(n, size, blocks) -> (n, later blocks, spans, size) averages over each span, over the last accelerations'."""
        longest = SPANS[-1]
        means = [avg_pool1d(energies[:, :, longest - span :], span, 1) for span in SPANS]
        averaged = torch.stack(means, dim=1).permute(0, 3, 1, 2)
        return averaged / averaged[..., -1:].clamp(min=1e-30)

    def look(self, shares: Tensor) -> tuple[Tensor, Tensor]:
        """(..., size) -> (...,) answers, and (..., cells + 6) what else is seen.

        That is the logarithms of what each cell leaves; and, on the average of the cells: that, what a change of k_b
        would add to it, the mass, the answer, and how far it lies off the cell; and the force.
        """
        ee, ek, em, kk, km, mm = shares[..., : 6 * len(self.ln_k)].chunk(6, dim=-1)
        of_k, of_m = self.ridge.exp()
        a, b = kk + of_k, mm + of_m
        alone = a * b - km * km
        x = ((em * km - ek * b) / alone).clamp(-1, 1)
        y = ((ek * km - em * a) / alone).clamp(-1, 1)
        left = ee + 2 * (x * ek + y * em + x * y * km) + x * x * kk + y * y * mm
        log = (left.clamp(min=0) + LEAST_SHARE).log()
        share = torch.softmax(self.bias - self.sharpness * log, dim=-1)
        told = (alone / b + LITTLE).log() - log
        sides = torch.sign(torch.arange(len(self.ln_k), device=x.device) - (len(self.ln_k) - 1) / 2)
        each = (log, told, sides + y, self.ln_k + self.pitch * x, x * x)
        means = [(share * value).sum(dim=-1) for value in each]
        force = (shares[..., -self.channels] + LITTLE).log()
        return means[3], torch.cat([log, torch.stack([*means, force], dim=-1)], dim=-1)

    def forward(self, shares: Tensor) -> tuple[Tensor, Tensor]:
        """(..., spans, size) -> ln k_b and the logarithm of its standard error (...)."""
        answers, seen = self.look(shares)
        own = self.correct(self.hidden((seen - self.mean) / self.std).tanh())
        answers, doubts = answers + own[..., 0], own[..., 1]
        told = self.answer(self.weigh(torch.cat([answers - answers[..., -1:], doubts], dim=-1)).tanh())
        weights = torch.softmax(told[..., :-1] - doubts, dim=-1)
        return (weights * answers).sum(dim=-1), (told[..., -1] + (weights * doubts).sum(dim=-1)).clamp(*DOUBTS)


@dataclass(frozen=True)
class Trained:
    """A network with what surrounds it."""

    network: ResidueNetwork
    scale: FloatArray  # (channels,) factors on force and accelerations
    k_ref: float  # [N/m]
    factor: float  # on the standard error
    least: FloatArray  # (spans, cells + 6) of what was seen
    most: FloatArray
    measured: dict[str, Any]  # on the calibration streams


@dataclass(frozen=True)
class _Material:
    """Streams as the network hears them, with noise and gains drawn anew each time."""

    streams: Streams
    scale: Tensor
    k_ref: float
    generator: torch.Generator

    def draw(self, which: NDArray[np.int_]) -> tuple[Tensor, Tensor]:
        """(n, channels, instants) signals, and (n, later blocks) ln k_b."""
        s, draw = self.streams, self.generator
        read = torch.from_numpy(s.read[which])
        n = (len(which), read.shape[1], 1)
        noise = NOISE * torch.rand((len(which), 1, 1), generator=draw) * read.square().mean(dim=2, keepdim=True).sqrt()
        read = (GAIN * torch.randn(n, generator=draw)).exp() * read + noise * torch.randn(read.shape, generator=draw)
        first = int(torch.randint(0, EVERY, (1,), generator=draw))
        signals = torch.cat([torch.from_numpy(s.force[which])[:, None], read], dim=1)[:, :, first::EVERY]
        ends = torch.arange(TAPS - 1 + SPANS[-1] * BLOCK - 1, signals.shape[2], BLOCK)
        return signals * self.scale[:, None], (torch.from_numpy(s.k_b[which, first::EVERY]) / self.k_ref).log()[:, ends]

    def rows(self, network: ResidueNetwork) -> tuple[Tensor, Tensor]:
        """(rows, spans, size) shares of some blocks of all streams, and (rows,) ln k_b."""
        shares, wanted = [], []
        with torch.no_grad():
            for which in np.array_split(np.arange(len(self.streams)), -(-len(self.streams) // _STREAMS)):
                signals, ln_k = self.draw(which)
                first = int(torch.randint(0, _SPARSE, (1,), generator=self.generator))
                shares.append(network.shares(network.energies(signals))[:, first::_SPARSE].flatten(0, 1))
                wanted.append(ln_k[:, first::_SPARSE].flatten())
        return torch.cat(shares), torch.cat(wanted)


def train(
    grid: Streams, streams: Streams, calibration: Streams, seed: int, progress: Progress | None = None
) -> Trained:
    """Begin with predictions made for a grid, learn from streams, calibrate on others.

    Parameters
    ----------
    grid : of STIFFNESSES and MASSES, see ``make_steady_streams``
    streams, calibration : without noise; it is drawn here
    seed : of weights, noise and order
    progress : called with the epochs so far, of EPOCHS
    """
    torch.manual_seed(seed)
    scale = np.array([np.median(grid.read.std(axis=2) / grid.force.std(axis=1)[:, None]), *[1.0] * grid.read.shape[1]])
    k_ref = float(np.exp(np.log(grid.k_b).mean()))
    network = _first_network(grid, scale, k_ref, np.random.default_rng(seed))
    generator = torch.Generator().manual_seed(seed)
    material = _Material(streams, torch.tensor(scale, dtype=torch.float32), k_ref, generator)
    shares, ln_k = material.rows(network)
    with torch.no_grad():
        seen = network.look(shares)[1]
        network.mean.copy_(seen.mean(dim=0))
        network.std.copy_(seen.std(dim=0).mean(dim=0).clamp(min=1e-3))
    _fit(network, shares, ln_k, generator, progress or (lambda _count: None))
    _round(network)
    return _calibrated(network, _Material(calibration, material.scale, k_ref, generator), scale)


# -- the first filters -------------------------------------------------------------------------------------


def _first_network(grid: Streams, scale: FloatArray, k_ref: float, rng: np.random.Generator) -> ResidueNetwork:
    """Predictions for each stiffness and mass of the grid, by few filters, and their differences."""
    predictions, likeness = _predictions(grid, scale, rng)
    root = np.linalg.cholesky(likeness)
    left, size, right = np.linalg.svd(predictions @ root, full_matrices=False)
    few = (left[:, :FILTERS] * size[:FILTERS]).reshape(MASSES, STIFFNESSES, -1)
    pairs = [(few[j : j + 2, i : i + 2]) for j in range(MASSES - 1) for i in range(STIFFNESSES - 1)]
    cells = [
        [each.mean(axis=(0, 1)) for each in pairs],
        [(each[:, 1] - each[:, 0]).mean(axis=0) for each in pairs],
        [(each[1] - each[0]).mean(axis=0) for each in pairs],
    ]
    ln_k = np.log(grid.k_b[:STIFFNESSES, 0] / k_ref)
    middles = np.tile([(a + b) / 2 for a, b in pairwise(ln_k)], MASSES - 1)
    filters = (right[:FILTERS] @ np.linalg.inv(root)).reshape(FILTERS, -1, TAPS)
    made = (filters, np.concatenate(cells), middles)
    return ResidueNetwork(*(torch.tensor(each, dtype=torch.float32) for each in made), pitch=float(ln_k[1] - ln_k[0]))


def _predictions(grid: Streams, scale: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """(n, channels TAPS) least-squares predictions of the last node's acceleration, less the acceleration; and the mean
    (channels TAPS, channels TAPS) of products of the instants that they see."""
    random, made, likeness = rng.standard_normal(grid.read.shape[1:]), [], 0.0
    for force, read in zip(grid.force, grid.read, strict=True):
        noisy = read + FIRST_NOISE * read.std(axis=1, keepdims=True) * random
        signals = np.vstack([force[None], noisy])[:, 500:].astype(float) * scale[:, None]
        windows = np.lib.stride_tricks.sliding_window_view(signals, EVERY * (TAPS - 1) + 1, axis=1)[..., ::EVERY]
        rows = windows.transpose(1, 0, 2).reshape(windows.shape[1], -1)
        products = rows.T @ rows / (rows[:, -1] @ rows[:, -1])
        known = products[:-1, :-1] + 1e-6 * np.eye(len(products) - 1)
        made.append(np.append(-np.linalg.solve(known, products[:-1, -1]), 1.0))
        likeness = likeness + products / len(grid)
    return np.array(made), likeness + 1e-6 * np.eye(len(made[0]))


# -- learning ----------------------------------------------------------------------------------------------


def loss(network: ResidueNetwork, shares: Tensor, ln_k: Tensor) -> Tensor:
    """Student's likelihood of errors of ln k_b."""
    told, doubt = network(shares)
    off = (ln_k - told) / doubt.exp()
    return ((FREEDOM + 1) / 2 * torch.log1p(off.square() / FREEDOM) + doubt).mean()


def _fit(network: ResidueNetwork, shares: Tensor, ln_k: Tensor, generator: torch.Generator, progress: Progress) -> None:
    """Adam, its rate falling from epoch to epoch; the filters stay."""
    learned = list(network.parameters())
    optimiser = torch.optim.Adam(learned)
    for epoch in range(EPOCHS):
        rate = _RATE * (1 + np.cos(np.pi * epoch / EPOCHS)) / (2 if epoch else 4)
        optimiser.param_groups[0]["lr"] = rate
        for some in torch.randperm(len(shares), generator=generator).split(_ROWS):
            optimiser.zero_grad()
            loss(network, shares[some], ln_k[some]).backward()
            nn.utils.clip_grad_norm_(learned, 1.0)
            optimiser.step()
        progress(epoch + 1)


def _round(network: ResidueNetwork) -> None:
    """Weights as the file keeps them: half precision, but for the few numbers that it keeps in single."""
    with torch.no_grad():
        network.hidden.weight.div_(network.std)
        network.std.fill_(1.0)
        for name, numbers in (*network.named_parameters(), ("filters", network.filters), ("cells", network.cells)):
            if name not in IN_SINGLE:
                numbers.copy_(numbers.half().float())


# -- calibration -------------------------------------------------------------------------------------------


def _calibrated(network: ResidueNetwork, material: _Material, scale: FloatArray) -> Trained:
    """The factor by which intervals hold 90 % where the tracker believes them, and the range of what it has seen."""
    shares, ln_k = material.rows(network)
    with torch.no_grad():
        told, doubt = network(shares)
        seen = network.look(shares)[1].numpy().astype(float)
    off, sigma = (told - ln_k).abs().numpy().astype(float), doubt.exp().numpy().astype(float)
    factor = 1.0
    for _ in range(20):  # which are believed depends on it
        believed = factor * sigma < MOST_DOUBTED
        if not believed.any():
            break
        factor = float(np.quantile(off[believed] / sigma[believed], 0.9)) / Z90
    believed = factor * sigma < MOST_DOUBTED
    trusted = seen[believed] if believed.any() else seen
    measured = {
        "believed_share": float(believed.mean()),
        "median_error_in_ln_k_b": float(np.median(off[believed])) if believed.any() else None,
    }
    return Trained(network, scale, material.k_ref, factor, trusted.min(axis=0), trusted.max(axis=0), measured)
