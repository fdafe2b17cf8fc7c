"""rigtwin train --tracker from a rig file to the FMU, and the same network from the same seed."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from rigtwin.commands import tracker_training
from rigtwin.estimator.tracking import streams, training
from rigtwin.estimator.tracking.network import TrackerNetwork
from rigtwin.sim.session import FmuSession
from tests.rigtwin.conftest import run
from tests.rigtwin.test_training import InThisProcess

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
OWN_ROTOR, TABLES = EXAMPLES / "own_rotor.toml", EXAMPLES / "journal_bearings.toml"


@pytest.fixture
def small(monkeypatch):
    """Few short streams, made in this process, and few cells; what was fitted is appended to a list."""
    fitted = []
    monkeypatch.setattr(streams, "INSTANTS", 3_000)
    monkeypatch.setattr(training, "STIFFNESSES", 13)
    monkeypatch.setattr(training, "MASSES", 2)
    monkeypatch.setattr(training, "EPOCHS", 2)
    monkeypatch.setattr(tracker_training, "executor", lambda _where: nullcontext(InThisProcess()))
    train = training.train

    def kept(*arguments):
        fitted.append((arguments, train(*arguments)))
        return fitted[-1][1]

    monkeypatch.setattr(training, "train", kept)
    return fitted, train


def test_a_rig_of_ones_own_gets_a_network(small, tmp_path):
    """And from the same streams and seed the same once more, to the last digit: one thread sums in one order."""
    out = tmp_path / "out"
    done = run("train", "--tracker", "--rig", OWN_ROTOR, "--rigs", 16, "--calibration-rigs", 16, "--out", out)
    assert done.exit_code == 0, done.output
    network = TrackerNetwork(out / "tracker.onnx")
    assert str(out / "StiffnessTracker.fmu") in done.stdout.replace("\n", "")
    with FmuSession(out / "StiffnessTracker.fmu") as tracker:
        tracker.start({"method": 1})
        (read,) = (name for name in tracker.variables if name.startswith("node_"))
        rng = np.random.default_rng(0)
        for force in rng.standard_normal(2_600):
            tracker.set({"force": force, read: 0.5 * force})
            tracker.step(network.card["step"] / 2)
        k_b, start = tracker.get(("k_b", "k_b_start"))
    assert k_b != pytest.approx(start, rel=1e-6)
    fitted, train = small
    arguments, first = fitted[0]
    again = train(*arguments[:4])
    for mine, other in zip(first.network.parameters(), again.network.parameters(), strict=True):
        np.testing.assert_array_equal(mine.detach().numpy(), other.detach().numpy())
    assert again.factor == first.factor


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--tracker", "--from-data"), "no streams are shipped"),
        (("--tracker-node", "3"), "add --tracker"),
        (("--tracker", "--rigs", "3"), "at least 16 are needed"),
        (("--tracker", "--tracker-node", "9"), "there is no node 9"),
        (("--tracker", "--rig", TABLES), "tables"),
    ],
)
def test_what_cannot_be_trained_is_refused(options, words, tmp_path, refused):
    assert words in refused("train", *options, "--out", tmp_path)
