"""A tracker's network as an ONNX file: the graph, in double precision, and its weights, kept in half or single."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from rigtwin.estimator.onnx_file import CARD_KEY
from rigtwin.estimator.tracking import TRACKER_CARD
from rigtwin.estimator.tracking.training import BLOCK, DOUBTS, IN_SINGLE, LEAST_SHARE, LITTLE, SPANS, TAPS, Trained
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.scratch import replacing

# Least energy that others are divided by.
TINY = 1e-300

_OPSET, _IR = 18, 9


@dataclass
class _Graph:
    """Nodes and constants so far."""

    nodes: list[onnx.NodeProto] = field(default_factory=list)
    constants: list[onnx.TensorProto] = field(default_factory=list)

    def constant(self, name: str, values: Any, kept: Any = np.float64) -> str:
        """A constant in double precision, whatever it is kept in; whole numbers stay as they are."""
        array = np.asarray(values)
        if array.dtype.kind == "i" or kept is np.float64:
            self.constants.append(numpy_helper.from_array(array, name))
            return name
        self.constants.append(numpy_helper.from_array(array.astype(kept), f"{name}_kept"))
        return self.do("Cast", f"{name}_kept", to_name=name, to=TensorProto.DOUBLE)

    def do(self, kind: str, *inputs: str, to_name: str | None = None, **options: Any) -> str:
        """An operation with one result, whose name it returns."""
        name = to_name or f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **options))
        return name

    def parts(self, x: str, sizes: Sequence[int], axis: int) -> list[str]:
        """Parts of these sizes along an axis."""
        names = [f"t{len(self.nodes)}_{k}" for k in range(len(sizes))]
        given = self.constant(f"sizes_of_{names[0]}", np.array(sizes))
        self.nodes.append(helper.make_node("Split", [x, given], names, axis=axis))
        return names

    def dense(self, x: str, layer: str) -> str:
        """A layer of the network: x W + b, by the names of its weights."""
        return self.do("Add", self.do("MatMul", x, f"{layer}_w"), f"{layer}_b")


def export(trained: Trained, about: dict[str, Any], path: Path) -> None:
    """Write the network beside ``path`` and rename it, with a card in its metadata.

    Parameters
    ----------
    trained : the network
    about : the card but for what the network knows itself: rig, nodes, step, range of k_b
    path : of the ONNX file
    """
    g, network = _Graph(), trained.network
    halves, singles = weights(trained)
    for values, kept in ((halves, np.float16), (singles, np.float32)):
        for name, array in values.items():
            g.constant(name, array, kept)
    cells, channels = len(network.ln_k), network.channels
    size = 6 * cells + channels
    _now(g, cells, channels)
    _answer(g, cells, channels)
    shapes = {
        "signals": (channels, TAPS - 1 + BLOCK),
        "energies": (SPANS[-1] - 1, size),
        "now": (size,),
        "answer": (3,),
    }
    ends = [helper.make_tensor_value_info(name, TensorProto.DOUBLE, shape) for name, shape in shapes.items()]
    graph = helper.make_graph(g.nodes, "tracker", ends[:2], ends[2:], g.constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR)
    card = {"name": TRACKER_CARD, "block": BLOCK, **about, **trained.measured}
    helper.set_model_props(model, {CARD_KEY: json.dumps(card)})
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as beside:
        onnx.save(model, beside)


def weights(trained: Trained) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Every number of a network by the name that it has in the file: those kept in half precision, and in single."""
    network = trained.network
    own = {name: p.detach().numpy().T.astype(float) for name, p in network.named_parameters()}
    own |= {"filters": network.filters.flatten(1).numpy().T, "cells": network.cells.numpy().T}
    singles = {name: own.pop(name) for name in IN_SINGLE}
    halves = {name.replace(".weight", "_w").replace(".bias", "_b"): array for name, array in own.items()}
    unmean = network.mean.numpy().astype(float) @ halves["hidden_w"]  # (spans, NEURONS)
    return halves, {
        "sharpness": singles["sharpness"],
        "ridge": np.exp(singles["ridge"]),
        "hidden_b": singles["hidden.bias"] - unmean,
        "least": trained.least,
        "most": trained.most,
        "scale": trained.scale,
        "pitch": np.array(network.pitch),
        "ln_k_ref": np.log(trained.k_ref),
        "factor": np.array(trained.factor),
    }


def _now(g: _Graph, cells: int, channels: int) -> None:
    """From the last instants to the energies of the block: ``now``."""
    scale = g.do("Unsqueeze", "scale", g.constant("last", np.array([1])))
    signals = g.do("Mul", "signals", scale)
    places = np.arange(BLOCK)[:, None] + np.arange(TAPS)
    windows = g.do("Gather", signals, g.constant("places", places.astype(np.int32)), axis=1)  # (channels, BLOCK, TAPS)
    rows = g.do("Transpose", windows, perm=[1, 0, 2])
    rows = g.do("Reshape", rows, g.constant("flat", np.array([BLOCK, channels * TAPS])))
    off = g.do("MatMul", g.do("MatMul", rows, "filters"), "cells")
    e, k, m = g.parts(off, (cells,) * 3, axis=1)
    newest = g.constant("newest", np.arange(TAPS - 1, TAPS - 1 + BLOCK, dtype=np.int32))
    raw = g.do("Transpose", g.do("Gather", signals, newest, axis=1), perm=[1, 0])
    pairs = ((e, e), (e, k), (e, m), (k, k), (k, m), (m, m), (raw, raw))
    products = g.do("Concat", *(g.do("Mul", *pair) for pair in pairs), axis=1)
    g.do("ReduceMean", products, g.constant("first", np.array([0])), keepdims=0, to_name="now")


def _answer(g: _Graph, cells: int, channels: int) -> None:
    """From the energies of all blocks to ``answer``: ln k_b, its standard error, what lies beyond the training."""
    blocks = g.do("Concat", "energies", g.do("Unsqueeze", "now", "first"), axis=0)
    spans = np.array([[(back < n) / n for back in range(SPANS[-1])[::-1]] for n in SPANS])
    means = g.do("MatMul", g.constant("average", spans), blocks)  # (spans, size)
    last = g.do("Gather", means, g.constant("at_last", np.array([6 * cells + channels - 1])), axis=1)
    shares = g.do("Div", means, g.do("Max", last, g.constant("tiny", TINY)))
    products, raw = g.parts(shares, (6 * cells, channels), axis=1)
    answers, seen = _look(g, products, raw, cells)
    beyond = g.do("Max", g.do("Sub", "least", seen), g.do("Sub", seen, "most"))
    own, doubts = g.parts(g.dense(g.do("Tanh", g.dense(seen, "hidden")), "correct"), (1, 1), axis=1)
    row = g.constant("row", np.array([-1]))
    answers, doubts = g.do("Reshape", g.do("Add", answers, own), row), g.do("Reshape", doubts, row)
    ln_k, doubt = _weighed(g, answers, doubts)
    low, high = (g.constant(f"doubt_{k}", limit) for k, limit in enumerate(DOUBTS))
    sigma = g.do("Mul", g.do("Exp", g.do("Min", g.do("Max", doubt, low), high)), "factor")
    most = g.do("Reshape", g.do("ReduceMax", beyond, keepdims=0), "last")
    g.do("Concat", g.do("Add", ln_k, "ln_k_ref"), sigma, most, axis=0, to_name="answer")


def _weighed(g: _Graph, answers: str, doubts: str) -> tuple[str, str]:
    """(1,) ln k_b and the logarithm of its standard error, from those of the spans (spans,)."""
    longest = g.do("Gather", answers, g.constant("longest", np.array([len(SPANS) - 1])))
    read = g.do("Concat", g.do("Sub", answers, longest), doubts, axis=0)
    told = g.dense(g.do("Tanh", g.dense(read, "weigh")), "answer")
    weights, more = g.parts(told, (len(SPANS), 1), axis=0)
    share = g.do("Softmax", g.do("Sub", weights, doubts), axis=0)
    ln_k, doubt = (g.do("ReduceSum", g.do("Mul", share, x), "first", keepdims=1) for x in (answers, doubts))
    return ln_k, g.do("Add", doubt, more)


def _look(g: _Graph, products: str, raw: str, cells: int) -> tuple[str, str]:
    """See ``ResidueNetwork.look``: (spans, 1) answers, and (spans, cells + 6) what is seen."""
    mul, add, sub = (partial(g.do, kind) for kind in ("Mul", "Sum", "Sub"))
    ee, ek, em, kk, km, mm = g.parts(products, (cells,) * 6, axis=1)
    of_k, of_m = g.parts("ridge", (1, 1), axis=0)
    a, b = add(kk, of_k), add(mm, of_m)
    alone = sub(mul(a, b), mul(km, km))
    one, minus, two, zero = (g.constant(f"number_{k}", float(k)) for k in (1, -1, 2, 0))
    ups = sub(mul(em, km), mul(ek, b)), sub(mul(ek, km), mul(em, a))
    x, y = (g.do("Min", g.do("Max", g.do("Div", up, alone), minus), one) for up in ups)
    crossed = mul(two, add(mul(x, ek), mul(y, em), mul(mul(x, y), km)))
    left = add(ee, crossed, mul(mul(x, x), kk), mul(mul(y, y), mm))
    log = g.do("Log", add(g.do("Max", left, zero), g.constant("least_share", LEAST_SHARE)))
    share = g.do("Softmax", sub("bias", mul("sharpness", log)), axis=1)
    little = g.constant("little", LITTLE)
    told = sub(g.do("Log", add(g.do("Div", alone, b), little)), log)
    sides = g.constant("sides", np.sign(np.arange(cells) - (cells - 1) / 2))
    each = (log, told, add(sides, y), add("ln_k", mul("pitch", x)), mul(x, x))
    across = g.constant("across", np.array([1]))
    means = [g.do("ReduceSum", mul(share, value), across, keepdims=1) for value in each]
    force = g.do("Gather", raw, g.constant("force", np.array([0])), axis=1)
    return means[3], g.do("Concat", log, *means, g.do("Log", add(force, little)), axis=1)
