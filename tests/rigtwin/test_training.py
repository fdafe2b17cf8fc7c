"""rigtwin train: what is measured is measured once, and another rig gets its own ranges."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import rigtwin.commands.training as training
from rigtwin.commands.training import TRAINING_CSV, TrainingPlan, shipped_data, train
from rigtwin.errors import UserError
from rigtwin.estimator.dataset import FEATURE_PLAN, Dataset, measure_rigs, read_dataset
from rigtwin.estimator.prior import PRIOR
from rigtwin.estimator.runtime import StiffnessEstimator
from rigtwin.estimator.training import data_digest
from tests.rigtwin.conftest import run

OWN_ROTOR = Path(__file__).resolve().parents[2] / "examples" / "own_rotor.toml"

TEN_DIGITS = 1e-9  # of the shipped data sets


class InThisProcess(Executor):
    """Runs a task at once."""

    def submit(self, fn, /, *args, **kwargs):
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


@pytest.mark.long
def test_rigs_that_were_measured_before_an_interrupt_are_not_measured_again(rotor_fmu, tmp_path, monkeypatch):
    monkeypatch.setattr("rigtwin.estimator.dataset._CHUNK", 1)
    rigs = PRIOR.draw(4, seed=5)
    with pytest.raises(KeyboardInterrupt):
        measure_rigs(rotor_fmu, rigs, InThisProcess(), store=tmp_path, progress=_interrupt_at(2))
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert 2 <= len(kept) <= 4
    resumed = measure_rigs(rotor_fmu, rigs, InThisProcess(), store=tmp_path)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert_array_equal(resumed.features, measure_rigs(rotor_fmu, rigs, InThisProcess()).features)


def _interrupt_at(limit):
    def count(measured):
        if measured >= limit:
            raise KeyboardInterrupt

    return count


@pytest.mark.parametrize("change", ["rigs", *(pytest.param(each, marks=pytest.mark.long) for each in ("plan", "node"))])
def test_what_was_measured_otherwise_is_measured_again(rotor_fmu, tmp_path, change):
    plan = FEATURE_PLAN
    measure_rigs(rotor_fmu, PRIOR.draw(1, seed=5), InThisProcess(), plan=plan, store=tmp_path)
    other = {
        "rigs": {"rigs": PRIOR.draw(1, seed=6)},
        "plan": {"plan": training.FEATURE_PLAN.__class__(n_lines=120)},
        "node": {"excitation_node": 3},
    }[change]
    asked = {"rigs": PRIOR.draw(1, seed=5), "plan": plan, **other}
    measure_rigs(rotor_fmu, executor=InThisProcess(), store=tmp_path, **asked)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.fixture
def asked(monkeypatch) -> list[tuple]:
    """What a training asks to be measured and fitted; neither is done."""
    calls: list[tuple] = []
    shipped = read_dataset(shipped_data(TRAINING_CSV))

    def measured(fmu, rigs, executor, **how):
        calls.append((fmu.name, rigs, how))
        return Dataset(rigs, shipped.features[: len(rigs)])

    def fitted(training, calibration, prior, about, out):
        calls.append((prior, about))
        return None, {}

    monkeypatch.setattr(training, "measure_rigs", measured)
    monkeypatch.setattr(training, "_fit", fitted)
    monkeypatch.setattr(training, "build_estimator_fmu", lambda out, model: out)
    return calls


def test_the_defaults_ask_for_the_data_the_shipped_network_was_trained_on(asked, tmp_path):
    train(TrainingPlan(out=tmp_path))
    (_, rigs, how), (_, fine_rigs, _), (prior, about) = asked
    shipped, calibration = (read_dataset(shipped_data(name)).rigs for name in (TRAINING_CSV, training.CALIBRATION_CSV))
    assert_allclose(rigs.k_b, shipped.k_b, rtol=TEN_DIGITS)
    assert_allclose(fine_rigs.k_b, calibration.k_b, rtol=TEN_DIGITS)
    assert (how["plan"], how["excitation_node"], prior, about) == (FEATURE_PLAN, 2, PRIOR, {})


@pytest.mark.long
def test_another_rig_is_trained_in_its_own_range_band_and_driving_point(asked, tmp_path):
    train(TrainingPlan(rig=str(OWN_ROTOR), rigs=32, out=tmp_path))
    (_, rigs, how), _, (prior, about) = asked
    assert prior.k_b == (2e5, 2e7)
    assert prior.bearing_damping[1] < PRIOR.bearing_damping[1]
    assert how["excitation_node"] == about["excitation_node"] == 4
    assert how["plan"].f_min_hz < 30 < 820 < how["plan"].f_max_hz  # modes at 51 to 81 and 422 to 701 Hz
    assert about["rig"] == "stepped-cantilever"
    assert np.all((rigs.k_b >= 1.2e5) & (rigs.k_b <= 3.4e7))


def limited(folder, low, high):
    """The own rotor with k_b from ``low`` to ``high`` [N/m]."""
    text = OWN_ROTOR.read_text(encoding="utf-8").replace("[k_b]", f"[k_b]\nmin_N_per_m = {low}\nmax_N_per_m = {high}")
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    return str(folder / "rig.toml")


@pytest.mark.long
def test_no_training_rig_is_outside_the_limits_of_the_rig(asked, tmp_path):
    train(TrainingPlan(rig=limited(tmp_path, 1.5e6, 4e6), rigs=32, out=tmp_path))
    (_, coarse, _), (_, fine, _), (prior, _) = asked
    for rigs in (coarse, fine):
        assert 1.5e6 <= rigs.k_b.min() < 1.7e6
        assert 3.6e6 < rigs.k_b.max() <= 4e6
    assert prior.k_b == (1.5e6, 4e6)


def test_a_rig_with_hardly_a_range_of_stiffness_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"from 1\.9e\+06 to 2\.1e\+06 N/m is too narrow"):
        train(TrainingPlan(rig=limited(tmp_path, 1.9e6, 2.1e6), out=tmp_path))


def test_the_calibration_rigs_are_no_training_rigs(tmp_path):
    with pytest.raises(UserError, match="--seed 2: the calibration rigs"):
        train(TrainingPlan(out=tmp_path, seed=2))


def test_the_shipped_network_says_which_shipped_data_it_was_trained_on():
    card = StiffnessEstimator().card
    for name, key in ((TRAINING_CSV, "training"), (training.CALIBRATION_CSV, "calibration")):
        assert data_digest(read_dataset(shipped_data(name))) == card[f"{key}_data_sha256"]


def test_the_command_asks_for_what_its_options_say(monkeypatch, tmp_path):
    plans = []
    monkeypatch.setattr(training, "train", lambda plan: plans.append(plan))
    monkeypatch.setattr(training, "print_trained", lambda trained: None)
    options = ("--rig", "mine.toml", "--rigs", 33, "--calibration-rigs", 17, "--seed", 5, "--out", tmp_path)
    result = run("train", *options, "--executor", "dask://here:1")
    assert result.exit_code == 0, result.stderr
    (plan,) = plans
    assert plan == TrainingPlan(
        rig="mine.toml", rigs=33, calibration_rigs=17, seed=5, out=tmp_path, executor="dask://here:1"
    )
