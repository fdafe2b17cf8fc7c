"""Fit the network, calibrate its intervals on rigs it has not seen, export it to ONNX."""

from __future__ import annotations

import copy
import hashlib
import json
import logging
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from scipy.optimize import least_squares
from torch import Tensor
from torch.func import functional_call, grad, vmap
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from rigtwin.estimator.dataset import Dataset
from rigtwin.estimator.features import FEATURE_NAMES
from rigtwin.estimator.network import K_REF, Curve, Limits, StiffnessNetwork
from rigtwin.estimator.prior import PRIOR, Prior
from rigtwin.estimator.runtime import CARD_KEY, OUTPUT_NAMES
from rigtwin.scratch import replacing, scratch_folder

UNITS = {"delta_f": "Hz", "amplitude_ratio": "1", "k_b": "N/m"}

# A curve is fitted from so many starts, since some end where neurons are saturated, in so many evaluations each. The
# ridge keeps weights of neurons that do nothing from growing without end.
_STARTS, _EVALUATIONS, _RIDGE = 4, 300, 1e-6

# Each calibration rig is looked at so many times, with errors drawn afresh.
_REPEATS = 40
_DECADES = range(-6, -1)  # of relative errors

# Weight of the squares of the own errors' slopes: what a few rigs happen to say of a place is not believed.
_SMOOTHNESS = 1e-3

_TORCH_CACHE = "TORCHINDUCTOR_CACHE_DIR"


Card = dict[str, Any]


@contextmanager
def _own_cache() -> Iterator[None]:
    """Torch makes a folder for compiled code, which it leaves behind, unless the user has named one."""
    if _TORCH_CACHE in os.environ:
        yield
        return
    with scratch_folder("torch_") as folder:
        os.environ[_TORCH_CACHE] = str(folder)
        try:
            yield
        finally:
            del os.environ[_TORCH_CACHE]


@_own_cache()
def train(training: Dataset, calibration: Dataset, seed: int, prior: Prior = PRIOR) -> tuple[StiffnessNetwork, Card]:
    """Train on one set, calibrate on another (made with a finer mesh).

    Parameters
    ----------
    training, calibration : noise-free rigs; errors are drawn here
    seed : of weights and errors

    Returns
    -------
    network and its model card
    """
    torch.manual_seed(seed)
    network = _fit(training, prior)
    _calibrate(network, calibration, np.random.default_rng(seed))
    return network, _card(network, training, calibration, seed, prior)


def _fit(training: Dataset, prior: Prior) -> StiffnessNetwork:
    log = torch.from_numpy(np.log(training.features[:, :3]))
    log_k = torch.from_numpy(np.log(training.rigs.k_b / K_REF))
    curves = tuple(_fit_curve(log[:, [i, 2]], log_k) for i in range(2))
    unknown = tuple(_blank(log[:, [i, 2]], 0.0) for i in range(2))
    undamped = torch.from_numpy(training.rigs.bearing_damping == 0)
    bound = _fit_curve(log_k[undamped][:, None], log[undamped, 2])
    return StiffnessNetwork(curves, unknown, bound, _limits(training, prior)).double()  # type: ignore[arg-type]


def _limits(training: Dataset, prior: Prior) -> Limits:
    """Range of each feature over the training rigs."""
    low, high = training.features[:, :3].min(axis=0), training.features[:, :3].max(axis=0)
    return Limits(
        k_b=prior.k_b,
        shift_min=(float(low[0]), float(low[1])),
        shift_max=(float(high[0]), float(high[1])),
        ratio=(float(low[2]), float(high[2])),
    )


def _fit_curve(x: Tensor, y: Tensor) -> Curve:
    """The curve of least squares through (n, n_in) -> (n,), the best of a few starts."""
    return min((_fitted(_blank(x, float(y.mean())), x, y) for _ in range(_STARTS)), key=itemgetter(1))[0]


def _fitted(curve: Curve, x: Tensor, y: Tensor) -> tuple[Curve, float]:
    """A curve fitted by Levenberg's and Marquardt's method, and what it leaves.

    A network of a hundred weights on a thousand smooth values: descents by the gradient alone stop at errors that are
    ten times as large.
    """
    shapes = {name: weight.shape for name, weight in curve.named_parameters()}
    n = math.sqrt(len(y))

    def value(weights: Tensor, x: Tensor) -> Tensor:
        """At one place (n_in,)."""
        parts = weights.split([shape.numel() for shape in shapes.values()])
        named = {name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)}
        return functional_call(curve, named, (x[None],))[0]

    values, slopes = vmap(value, (None, 0)), vmap(grad(value), (None, 0))

    def misfit(weights: np.ndarray) -> np.ndarray:
        left = (values(torch.from_numpy(weights), x) - y).detach().numpy()
        return np.append(left / n, _RIDGE * weights)

    def jacobian(weights: np.ndarray) -> np.ndarray:
        rows = slopes(torch.from_numpy(weights), x).detach().numpy()
        return np.vstack([rows / n, _RIDGE * np.eye(len(weights))])

    start = parameters_to_vector(curve.parameters()).detach().numpy()
    found = least_squares(misfit, start, jacobian, method="lm", xtol=1e-12, ftol=1e-12, max_nfev=_EVALUATIONS)  # type: ignore[arg-type]
    vector_to_parameters(torch.from_numpy(found.x), curve.parameters())
    return curve, float(found.cost)


def _fit_own_error(x: Tensor, error: Tensor) -> Curve:
    """The logarithm of the standard deviation of errors (n,) at places (n, 2), by the normal distribution's density."""
    curve = _blank(x, float(error.square().mean().sqrt().log()))

    def loss() -> Tensor:
        log_std = curve(x)
        slopes = sum(weight.square().sum() for weight in curve.parameters() if weight.ndim > 1)
        return (log_std + error.square() * (-2 * log_std).exp() / 2).mean() + _SMOOTHNESS * slopes

    _minimise(curve, loss, 1000)
    return curve


def _blank(x: Tensor, bias: float) -> Curve:
    curve = Curve(x.mean(dim=0), x.std(dim=0)).double()
    with torch.no_grad():
        curve.skip.bias.fill_(bias)
    return curve


def _minimise(curve: Curve, loss: Callable[[], Tensor], steps: int) -> None:
    """L-BFGS, full batch, double precision."""
    optimiser = torch.optim.LBFGS(
        curve.parameters(), max_iter=steps, max_eval=3 * steps // 2, history_size=50, line_search_fn="strong_wolfe",
        tolerance_grad=1e-12, tolerance_change=1e-16,
    )  # fmt: skip

    def value() -> Tensor:
        optimiser.zero_grad()
        found = loss()
        found.backward()
        return found

    optimiser.step(value)  # type: ignore[arg-type]


def _calibrate(network: StiffnessNetwork, calibration: Dataset, rng: np.random.Generator) -> None:
    """Set the curves' own errors, the interval's width and the contradiction gates."""
    k = calibration.rigs.k_b
    inside = (k >= network.limits.k_b[0]) & (k <= network.limits.k_b[1])
    log_k = torch.from_numpy(np.log(k[inside] / K_REF))
    clean = torch.from_numpy(calibration.features[inside, :3])
    for i, curve in enumerate((network.curve1, network.curve2)):
        places = torch.stack([clean[:, i].log(), clean[:, 2].log()], dim=1)
        with torch.no_grad():
            error = curve(places) - log_k
            network.floor[i] = error.square().mean().sqrt()
        setattr(network, f"own_error{i + 1}", _fit_own_error(places, error))
    with torch.no_grad():
        _calibrate_gates(network, calibration, inside, rng)


def _calibrate_gates(
    network: StiffnessNetwork, calibration: Dataset, inside: np.ndarray, rng: np.random.Generator
) -> None:
    """Width of the interval, and how far the inputs may contradict each other."""
    log_k = torch.from_numpy(np.log(calibration.rigs.k_b[inside] / K_REF))
    clean = torch.from_numpy(calibration.features[inside, :3])
    # The interval has to hold, and the gate to stay open, in every decade of errors, not on average.
    looks = [torch.from_numpy(draw_errors(clean.numpy(), _REPEATS, decade, rng)) for decade in _DECADES]
    truth = log_k.repeat(_REPEATS)
    network.quantile.fill_(max(_interval_quantile(network(look), truth) for look in looks))
    exact = torch.cat([clean, torch.zeros_like(clean)], dim=1)
    network.contradiction.fill_(max(float(torch.quantile(network.disagreement(x), 0.999)) for x in (*looks, exact)))
    undamped = torch.from_numpy(calibration.rigs.bearing_damping[inside] == 0)
    excess = network.ratio_excess((network(exact)[undamped, 0] / K_REF).log(), clean[undamped, 2].log())
    network.ratio_floor.copy_(excess.square().mean().sqrt())


def _interval_quantile(out: Tensor, log_k: Tensor) -> float:
    """Half-width, in standard deviations, that holds 90 % of the errors of log k_b."""
    z = ((out[:, 0] / K_REF).log() - log_k).abs() / (out[:, 1] / out[:, 0])
    return float(torch.quantile(z, 0.90))


def draw_errors(clean: np.ndarray, repeats: int, decade: int, rng: np.random.Generator) -> np.ndarray:
    """Noisy copies of clean features, relative errors log-uniform over one decade.

    Parameters
    ----------
    clean : (n, 3) shifts and ratio
    repeats : copies of each
    decade : the errors lie between 10^decade and 10^(decade + 1)

    Returns
    -------
    (n * repeats, 6) features and the errors they were drawn with
    """
    values = np.tile(clean, (repeats, 1))
    relative = 10 ** rng.uniform(decade, decade + 1, size=values.shape)
    std = relative * values
    return np.hstack([values + std * rng.standard_normal(values.shape), std])


def _card(network: StiffnessNetwork, training: Dataset, calibration: Dataset, seed: int, prior: Prior) -> Card:
    middle = int(np.argmin(np.abs(np.log(training.rigs.k_b / 1e7)) + (training.rigs.bearing_damping > 0)))
    values = [float(f"{value:.4g}") for value in training.features[middle, :3]]
    example = [*values, *(float(f"{1e-3 * value:.2g}") for value in values)]
    return {
        "name": "rigtwin bearing-stiffness estimator",
        "task": "k_b of both bearings from resonance shifts and amplitude ratio between rigid supports and bearings",
        "architecture": "two 2-8-8-1 tanh curves fused by inverse variance, two 2-8-8-1 curves of their errors, "
        "1-8-8-1 bound of the ratio",
        "licence": "MIT",
        "seed": seed,
        "training_rigs": len(training),
        "calibration_rigs": len(calibration),
        "training_data_sha256": data_digest(training),
        "calibration_data_sha256": data_digest(calibration),
        "curve_errors_in_log_k_b": network.floor.tolist(),
        "interval_half_width_in_sigma": float(network.quantile),
        "contradiction_gate_in_sigma": float(network.contradiction),
        "units": UNITS,
        "training_range": {**asdict(network.limits), **asdict(prior)},
        "example_inputs": dict(zip(FEATURE_NAMES, example, strict=True)),
        "limits_of_use": "one rotor geometry: the nit-rourkela rig with the force and the accelerometer at node 2",
    }


def data_digest(dataset: Dataset) -> str:
    """SHA-256 of a data set, from six significant digits."""
    table = np.column_stack([*asdict(dataset.rigs).values(), dataset.features[:, :3]])
    text = "\n".join(",".join(f"{value:.6g}" for value in row) for row in table)
    return hashlib.sha256(text.encode()).hexdigest()


@_own_cache()
def export(network: StiffnessNetwork, card: Card, path: Path) -> None:
    """Write the network as ONNX (float32), beside and renamed, with its card in the metadata."""
    # The exporter announces every optional package it does not find.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    example = torch.tensor([list(card["example_inputs"].values())] * 2, dtype=torch.float32)
    program = torch.onnx.export(
        copy.deepcopy(network).float().eval(),
        (example,),
        dynamo=True,
        input_names=["features"],
        output_names=["estimate"],
        dynamic_shapes=({0: torch.export.Dim("n")},),
        verbose=False,
    )
    assert program is not None
    model = program.model_proto
    model.doc_string = card["task"]
    for key, value in {
        CARD_KEY: json.dumps(card),
        "inputs": ", ".join(FEATURE_NAMES),
        "outputs": ", ".join(OUTPUT_NAMES),
    }.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    _strip_traces(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as beside:
        onnx.save(model, beside)


def _strip_traces(model: onnx.ModelProto) -> None:
    """Drop the exporter's notes on where each node came from: they hold paths of the machine."""
    for node in model.graph.node:
        node.ClearField("metadata_props")
        node.ClearField("doc_string")
    for value in (*model.graph.value_info, *model.graph.input, *model.graph.output, *model.graph.initializer):
        value.ClearField("metadata_props")
    model.graph.ClearField("metadata_props")
