"""The weights of a tracker's network as C, from its ONNX file; ``native/tracker_network.c`` computes with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import numpy_helper

from rigtwin.estimator.tracking.network import CARD_KEY, MOST_DOUBTED, SAME_STEP, TOO_LONG, UNHEARD, lag_of
from rigtwin.fmu_src.network_code import float_table

# Matrices whose names in C say that they are no sizes.
_NAMED = {"filters": "FILTERS_W", "cells": "CELLS_W"}


def tracker_network_code(file: Path) -> str:
    """``network_weights.h`` of an ONNX file of ``rigtwin train --tracker``."""
    model = onnx.load(file)
    card = json.loads(next(entry.value for entry in model.metadata_props if entry.key == CARD_KEY))
    arrays = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
    kept = {name.removesuffix("_kept"): array for name, array in arrays.items() if name.endswith("_kept")}
    tables = {_NAMED.get(name, name.upper()): array for name, array in kept.items()}
    tables["SIDES"] = arrays["sides"]
    lines = [f"#define {name} {value}\n" for name, value in (_sizes(arrays, kept) | _numbers(arrays, card)).items()]
    return "".join([*lines, *(float_table(name, array) for name, array in tables.items())])


def _sizes(arrays: dict[str, np.ndarray], kept: dict[str, np.ndarray]) -> dict[str, Any]:
    block, taps = arrays["places"].shape
    spans = (arrays["average"] > 0).sum(axis=1).tolist()
    return {
        "CHANNELS": len(kept["scale"]),
        "TAPS": taps,
        "BLOCK": block,
        "BLOCKS": arrays["average"].shape[1],
        "SPANS": f"{{{', '.join(map(str, spans))}}}",
        "N_SPANS": len(spans),
        "FILTERS": kept["filters"].shape[1],
        "CELLS": len(kept["ln_k"]),
        "NEURONS": kept["weigh_w"].shape[1],
        "ENOUGH": taps - 1 + block * arrays["average"].shape[1],
    }


def _numbers(arrays: dict[str, np.ndarray], card: dict[str, Any]) -> dict[str, Any]:
    named = {"TINY": "tiny", "LITTLE": "little", "LEAST_SHARE": "least_share", "LEAST_DOUBT": "doubt_0"}
    constants = {name: float(arrays[inside]) for name, inside in (named | {"MOST_DOUBT": "doubt_1"}).items()}
    low, high = card["k_b"]
    own = {
        "MOST_DOUBTED": MOST_DOUBTED,
        "SAME_STEP": SAME_STEP,
        "UNHEARD": UNHEARD,
        "STEP": card["step"],
        "LAG": lag_of(card, arrays["places"].shape[1]),
        "LEAST_K_B": low,
        "MOST_K_B": high,
        "TRAINED_NODE": card["excitation_node"],
    }
    return {name: repr(value) for name, value in (constants | own).items()} | {"TOO_LONG": json.dumps(TOO_LONG)}
