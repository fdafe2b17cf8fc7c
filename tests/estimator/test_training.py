"""Training: repeatable to the last bit, calibrated, and exported to a file that says the same as torch."""

from __future__ import annotations

import copy
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.estimator import training
from rigtwin.estimator.dataset import Dataset
from rigtwin.estimator.features import FEATURE_NAMES
from rigtwin.estimator.network import StiffnessNetwork
from rigtwin.estimator.prior import PRIOR
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.estimator.runtime import OUTPUT_NAMES, StiffnessEstimator, shipped_model
from rigtwin.estimator.training import data_digest, draw_errors, export, train
from rigtwin.rotor.model.condition import Condition
from tests.rotor.rigs import paper_structure

# Steps of the optimiser: enough for 0.3 % in k_b, a second instead of a minute.
STEPS = 200

# Two libraries round float32 sums and tanh differently: a few units of 6e-8 in log k_b, which is up to 18.
FLOAT32 = 1e-6

# The curves' slopes are differences of log k_b over steps of 0.02.
FLOAT32_SLOPES = 1e-3

SEED = 3


def rigs(n: int, seed: int) -> Dataset:
    """Noise-free features by the eigenvalues of the model, no FMU."""
    drawn = PRIOR.draw(n, seed)
    rows = []
    for k_b, zeta, damping in zip(drawn.k_b, drawn.shaft_damping_ratio, drawn.bearing_damping, strict=True):
        finder = StiffnessFinder(paper_structure(), Condition(bearing_damping=damping, shaft_damping_ratio=zeta))
        rows.append([*finder.shifts(k_b), finder.amplitude_ratio(k_b, damping), 0.0, 0.0, 0.0])
    return Dataset(drawn, np.array(rows))


@pytest.fixture(scope="module")
def data() -> tuple[Dataset, Dataset]:
    """64 rigs to train on and 48 others to calibrate on."""
    return rigs(64, 1), rigs(48, 2)


@pytest.fixture(scope="module", autouse=True)
def _few_steps() -> Iterator[None]:
    full = torch.optim.LBFGS

    def short(parameters: Any, **options: Any) -> torch.optim.LBFGS:
        return full(parameters, **{**options, "max_iter": STEPS, "max_eval": 2 * STEPS})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch.optim, "LBFGS", short)
        yield


@pytest.fixture(scope="module")
def trained(data) -> tuple[StiffnessNetwork, dict[str, Any]]:
    return train(*data, seed=SEED)


@pytest.fixture(scope="module")
def model(trained, tmp_path_factory) -> Path:
    """The exported network. torch's exporter uses a name of its own that it has deprecated."""
    path = tmp_path_factory.mktemp("model") / "new" / "stiffness.onnx"
    with pytest.warns(FutureWarning, match="LeafSpec"):
        export(*trained, path)
    return path


def noisy_rows(data: Dataset, decade: int = -3, repeats: int = 20) -> np.ndarray:
    """(n, 6) noisy features of the rigs in the range that is answered for."""
    k = data.rigs.k_b
    inside = (k >= PRIOR.k_b[0]) & (k <= PRIOR.k_b[1])
    return draw_errors(data.features[inside, :3], repeats, decade, np.random.default_rng(0))


def outputs(network: StiffnessNetwork, rows: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return network(torch.from_numpy(rows)).numpy()


# -- training --------------------------------------------------------------------------------------


def test_the_same_seed_trains_the_same_network_to_the_last_bit(data, trained):
    network, card = train(*data, seed=SEED)
    assert card == trained[1]
    for name, value in trained[0].state_dict().items():
        assert_array_equal(network.state_dict()[name], value, err_msg=name)


def test_another_seed_trains_another_network_that_knows_the_same(data, trained):
    other, _ = train(*data, seed=SEED + 1)
    rows = noisy_rows(data[1], decade=-6, repeats=1)
    own, others = outputs(trained[0], rows), outputs(other, rows)
    assert np.all(own[:, 0] != others[:, 0])
    assert_allclose(np.log(own[:, 0]), np.log(others[:, 0]), rtol=0, atol=0.05)


def test_rigs_it_has_not_seen_are_told_to_a_few_per_mille(trained):
    fresh = rigs(32, 5)
    inside = (fresh.rigs.k_b > PRIOR.k_b[0]) & (fresh.rigs.k_b < PRIOR.k_b[1])
    error = np.abs(outputs(trained[0], fresh.features[inside])[:, 0] / fresh.rigs.k_b[inside] - 1)
    assert np.median(error) < 0.003


def test_the_interval_holds_the_calibration_rigs_in_every_decade_of_errors(data, trained):
    """At least nine in ten, by construction; the errors here are drawn with another seed."""
    k = data[1].rigs.k_b
    k = k[(k >= PRIOR.k_b[0]) & (k <= PRIOR.k_b[1])]
    for decade in range(-6, -1):
        _, _, low, high, valid = outputs(trained[0], noisy_rows(data[1], decade)).T
        truth = np.tile(k, 20)
        assert np.mean((low <= truth) & (truth <= high)) > 0.87
        assert np.mean(valid) > 0.98


def test_outputs_are_ordered(data, trained):
    k, std, low, high, valid = outputs(trained[0], noisy_rows(data[1])).T
    assert np.all((low > 0) & (low < k) & (k < high) & (std > 0))
    assert set(valid) <= {0.0, 1.0}


def test_the_network_answers_within_its_training_data(data, trained):
    limits, seen = trained[0].limits, data[0].features[:, :3]
    assert limits.k_b == PRIOR.k_b
    assert_array_equal([*limits.shift_min, limits.ratio[0]], seen.min(axis=0))
    assert_array_equal([*limits.shift_max, limits.ratio[1]], seen.max(axis=0))


# -- errors that are drawn -------------------------------------------------------------------------


@pytest.mark.parametrize("decade", [-6, -2])
def test_drawn_errors_are_as_large_as_they_say(decade):
    clean = np.array([[4.0, 26.0, 1.2], [25.0, 130.0, 0.8]])
    rows = draw_errors(clean, 5000, decade, np.random.default_rng(1))
    values, std, truth = rows[:, :3], rows[:, 3:], np.tile(clean, (5000, 1))
    relative = std / truth
    assert relative.min() >= 10.0**decade
    assert relative.max() <= 10.0 ** (decade + 1)
    assert_allclose(np.log10(relative).mean(axis=0), decade + 0.5, atol=0.02)
    z = (values - truth) / std
    assert_allclose((z**2).mean(axis=0), 1.0, atol=4 * np.sqrt(2 / len(z)))
    assert np.abs(np.corrcoef(z, rowvar=False) - np.eye(3)).max() < 0.05


def test_a_data_set_is_known_by_its_digest(data):
    first, second = data
    assert data_digest(first) == data_digest(Dataset(first.rigs, first.features.copy()))
    assert data_digest(first) != data_digest(second)
    for part, relative, same in ((slice(0, 3), 1e-9, True), (slice(0, 3), 1e-4, False), (slice(3, 6), 1.0, True)):
        changed = first.features.copy()
        changed[0, part] += relative * changed[0, :3]
        assert (data_digest(Dataset(first.rigs, changed)) == data_digest(first)) == same


# -- the file --------------------------------------------------------------------------------------


def test_onnxruntime_says_what_torch_says(data, trained, model):
    rows = noisy_rows(data[1]).astype(np.float32)
    expected, found = outputs(copy.deepcopy(trained[0]).float(), rows), StiffnessEstimator(model)(rows)
    assert_allclose(np.log(found[:, 0]), np.log(expected[:, 0]), rtol=FLOAT32)
    assert_allclose(found[:, 1:4], expected[:, 1:4], rtol=FLOAT32_SLOPES)
    assert_array_equal(found[:, 4], expected[:, 4])


def test_single_precision_costs_nothing_that_matters(data, trained, model):
    """Against the network as it was trained, in double precision."""
    rows = noisy_rows(data[1])
    expected, found = outputs(trained[0], rows), StiffnessEstimator(model)(rows)
    assert_allclose(np.log(found[:, 0]), np.log(expected[:, 0]), rtol=FLOAT32)
    assert np.mean(found[:, 4] == expected[:, 4]) > 0.999


def test_exporting_leaves_the_network_as_it_was(trained, model):
    assert model.exists()
    assert {value.dtype for value in trained[0].state_dict().values()} == {torch.float64}


def test_training_leaves_nothing_in_the_folder_for_temporary_files(data, tmp_path, monkeypatch):
    """Torch keeps a cache there unless it is told otherwise."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    monkeypatch.delenv("TORCHINDUCTOR_CACHE_DIR", raising=False)
    with pytest.warns(FutureWarning, match="LeafSpec"):
        export(*train(*data, seed=SEED), tmp_path / "network.onnx")
    assert list(temporary.iterdir()) == []
    assert "TORCHINDUCTOR_CACHE_DIR" not in os.environ


def test_the_card_comes_back_out_of_the_file(trained, model):
    card = StiffnessEstimator(model).card
    assert card == json.loads(json.dumps(trained[1]))
    assert (card["seed"], card["training_rigs"], card["calibration_rigs"]) == (SEED, 64, 48)
    assert list(card["example_inputs"]) == list(FEATURE_NAMES)


def test_the_file_names_inputs_and_outputs(model):
    properties = {entry.key: entry.value for entry in onnx.load(model).metadata_props}
    assert properties["inputs"].split(", ") == list(FEATURE_NAMES)
    assert properties["outputs"].split(", ") == list(OUTPUT_NAMES)


def test_the_example_inputs_are_a_valid_test(trained, model):
    estimate = StiffnessEstimator(model).estimate(np.array(list(trained[1]["example_inputs"].values())))
    assert estimate.valid
    assert 5e6 < estimate.k_b < 2e7


def test_any_number_of_rows_may_be_asked(data, model):
    rows = noisy_rows(data[1])
    together = StiffnessEstimator(model)(rows)
    for n in (1, 3):
        assert_allclose(StiffnessEstimator(model)(rows[:n]), together[:n], rtol=1e-5)


@pytest.mark.parametrize("which", ["new", "shipped"])
def test_no_path_of_the_machine_is_in_the_file(model, which):
    content = (model if which == "new" else shipped_model()).read_bytes()
    root = Path(training.__file__).resolve().parents[1]
    for path in (root, Path.home(), Path(sys.prefix), Path(sys.base_prefix), Path(tempfile.gettempdir())):
        assert f"{path}/".encode() not in content
    assert b".py" not in content


def test_an_interrupted_export_leaves_the_old_file_and_nothing_beside_it(trained, model, tmp_path, monkeypatch):
    path = tmp_path / "stiffness.onnx"
    path.write_bytes(b"old")

    def half(_model: onnx.ModelProto, target: Path) -> None:
        target.write_bytes(model.read_bytes()[:100])
        raise OSError("disk full")

    program = SimpleNamespace(model_proto=onnx.load(model))
    monkeypatch.setattr(torch.onnx, "export", lambda *_arguments, **_options: program)
    monkeypatch.setattr(onnx, "save", half)
    with pytest.raises(OSError, match="disk full"):
        export(*trained, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
