"""The tracker's network in use: the ONNX file, numpy and onnxruntime.

The file has a fixed step. It takes the last instants and the energies of the blocks before, and gives the energies of
this block and an answer, so that it remembers nothing itself. ``native/tracker_network.c`` is the same in C; its
weights are printed from the file.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.estimator.intervals import Z90
from rigtwin.estimator.onnx_file import CARD_KEY, onnx_session
from rigtwin.estimator.tracking.tracker import ENRICHED, ORDER, Belief, Tracked, is_rich, lag_between_forces, plain
from rigtwin.rotor.model.arrays import FloatArray

# Steps that differ from the network's by less than this share are the network's.
SAME_STEP = 1e-6

# Largest standard error of ln k_b that is believed; the filter is more exact, and has to be.
MOST_DOUBTED = 0.1

# By how much what is not heard lies beyond the training.
UNHEARD = 1e9

TOO_LONG = "method 1 takes steps of the network's at most; make the communication step shorter or set method to 2"


class TrackerNetwork:
    """A trained network.

    Parameters
    ----------
    model : path of the ONNX file
    """

    def __init__(self, model: Path):
        self._session = onnx_session(model)
        self.card: dict[str, Any] = json.loads(self._session.get_modelmeta().custom_metadata_map[CARD_KEY])
        signals, energies = (each.shape for each in self._session.get_inputs())
        self.channels, self.window = signals
        self.blocks, self.size = energies
        self.taps = self.window - self.card["block"] + 1

    def __call__(self, signals: FloatArray, energies: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the network makes of a block.

        Parameters
        ----------
        signals : (1 + n_nodes, window) force [N] and accelerations [m/s^2] at the last instants
        energies : (blocks, size) of the blocks before

        Returns
        -------
        (size,) energies of this block; (3,) ln k_b, its standard error, and by how much the features lie beyond those
        of the training
        """
        now, answer = self._session.run(None, {"signals": signals, "energies": energies})
        return np.asarray(now), np.asarray(answer)


def lag_of(card: dict[str, Any], taps: int) -> int:
    """``lag_between_forces`` of a network that looks back ``taps``, in its steps."""
    remembered = (taps - card["block"]) // (ORDER - 1)  # by the printed code, for the first instant of a block
    return min(remembered, lag_between_forces(card["highest_hz"], card["step"], taps))


@dataclass
class _State:
    """All that a tracker remembers."""

    signals: FloatArray  # (channels, window), the block that is filled at the end
    energies: FloatArray  # (blocks, size)
    before: FloatArray  # (channels,) the inputs of the step before
    likeness: FloatArray  # (ORDER, ORDER) mean products of the force's last values
    ln_k: float
    error: float
    beyond: float = UNHEARD
    phase: float = -1.0  # since the network's last instant, in its steps; negative: there was none
    filled: int = 0  # instants of this block
    heard: int = 0  # instants since the rotor first moved


class NetworkTracker:
    """Follows k_b by a network.

    Parameters
    ----------
    network : the network
    belief : what is believed at the start; of that the network takes k_b, and says it until there is an answer
    """

    def __init__(self, network: TrackerNetwork, belief: Belief):
        self._network, card = network, network.card
        self._step, self._block, (self._low, self._high) = card["step"], card["block"], card["k_b"]
        self._enough = network.window - self._block + self._block * (network.blocks + 1)
        signals, energies = np.zeros((network.channels, network.window)), np.zeros((network.blocks, network.size))
        newest, lag = np.arange(network.window - self._block, network.window), lag_of(card, network.taps)
        self._forces = newest[:, None] - lag * np.arange(ORDER)  # (block, ORDER) places of each instant's last values
        nothing = np.zeros(network.channels), np.zeros((ORDER, ORDER))
        self._state = _State(signals, energies, *nothing, math.log(belief.k_b), belief.k_b_std)

    def step(self, h: float, force: float, accelerations: FloatArray) -> None:
        """Take up the force [N] and the accelerations (n_nodes,) [m/s^2], all finite, of an instant.

        h : seconds after the last one, above 0

        Raises ValueError where h is longer than the network's step.
        """
        o, share, now = self._state, h / self._step, np.array([force, *accelerations])
        if share > 1 + SAME_STEP:
            raise ValueError(TOO_LONG)
        o.phase = o.phase + share if o.phase >= 0 else 1.0
        if o.phase >= 1 - SAME_STEP:
            o.phase = o.phase - 1 if o.phase > 1 + SAME_STEP else 0.0
            self._take(now + o.phase / share * (o.before - now))
        o.before = now

    def _take(self, now: FloatArray) -> None:
        """An instant of the network: force and accelerations."""
        o, n = self._state, self._network.window - self._block
        o.signals[:, n + o.filled] = now
        o.filled += 1
        o.heard += bool(o.heard or now[1:].any())
        if o.filled < self._block:
            return
        forces = o.signals[0, self._forces]
        o.likeness += min(1.0, self._block * self._step / ENRICHED) * (forces.T @ forces - o.likeness)
        energies, answer = self._network(o.signals, o.energies)
        o.signals[:, :n] = o.signals[:, self._block :]
        o.energies[:-1] = o.energies[1:]
        o.energies[-1] = energies
        o.filled = 0
        if o.heard >= self._enough and energies[-1] > 0:
            o.ln_k, o.error, o.beyond = answer.tolist()
        else:
            o.beyond = UNHEARD
        if not is_rich(o.likeness):
            o.beyond = UNHEARD

    @property
    def tracked(self) -> Tracked:
        """The estimate."""
        o = self._state
        k_b, width = math.exp(o.ln_k), math.exp(Z90 * o.error)
        known = o.error < MOST_DOUBTED and o.beyond <= 0
        return Tracked(k_b, k_b / width, k_b * width, known and self._low < k_b < self._high)

    def save(self) -> dict[str, Any]:
        """All that it remembers, in JSON types."""
        return plain(asdict(self._state))

    def restore(self, belief: Belief, saved: dict[str, Any]) -> None:
        """Go back to what ``save`` gave; nothing depends on the belief of then."""
        arrays = {name: np.array(saved[name]) for name in ("signals", "energies", "before", "likeness")}
        self._state = _State(**{**saved, **arrays})
