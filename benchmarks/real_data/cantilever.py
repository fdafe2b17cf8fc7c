"""A steel strip in a clamp, with small masses along it: hammer near the clamp, accelerometer at the tip."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.real_data.data_set import Control, DataSet, Fold, nrmse
from rigtwin.sim.campaign_folder import load_campaign

STATE = "c296_on_Beam_healthy"
TRAIN, HELD = STATE, f"{STATE}_held"


def folds(data: Path, made: Path) -> list[Fold]:
    """Every other line is diagnosed, and the lines in between are predicted."""
    return [Fold("every other line", data / TRAIN, data / HELD)]


def controls(data: Path) -> list[Control]:
    """The lines in between, by straight lines between their neighbours."""
    (train,), (held,) = (load_campaign(data / name).runs for name in (TRAIN, HELD))
    inside = (held.frequency_hz >= train.frequency_hz[0]) & (held.frequency_hz <= train.frequency_hz[-1])
    x, H = train.frequency_hz, train.H[:, 0]
    between = np.interp(held.frequency_hz[inside], x, H.real) + 1j * np.interp(held.frequency_hz[inside], x, H.imag)
    return [Control("straight lines between the neighbouring lines", (nrmse(held.H[inside, 0], between),))]


CANTILEVER = DataSet(
    key="cantilever",
    title="Cantilever",
    measured="A steel strip of 380 x 25.4 x 4.75 mm in a clamp carries six small masses. A hammer hit it 7 mm from "
    "the clamp, and an accelerometer at the tip measured up to 1.2 kHz, over four modes. The rig file was fitted to a "
    "state in which one mass was missing; in the state that is diagnosed it is there. By the masses that the rig file "
    "has, the right answer is an additional mass of 10.5 g at node 3, 50 mm from the clamp.",
    source="https://github.com/BalakumaranM/"
    "Transformer-based-Structural-Health-Monitoring-using-Frequency-Response-Function-FRF",
    licence="MIT",
    files=tuple(f"{name}/{file}" for name in (TRAIN, HELD) for file in ("campaign.toml", "rig.toml", "run.csv")),
    folds=folds,
    controls=controls,
    silent="The held-out lines lie between the others in the same hammer test: predicting them shows that the model "
    "can follow the data, not that the cause is right. Coherences were not stored, so that the noise is estimated. "
    "Other states of the strip would show whether the same cause is found again.",
)
