"""Rigs measured through the FMU: the same numbers wherever the work runs, and a file that keeps every bit."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.estimator import dataset
from rigtwin.estimator.dataset import (
    FEATURE_PLAN,
    RIG_NAMES,
    Dataset,
    feature_plan,
    measure_rigs,
    noisy,
    read_dataset,
    write_dataset,
)
from rigtwin.estimator.features import FEATURE_NAMES
from rigtwin.estimator.prior import PRIOR, Rigs
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from tests.rotor.rigs import paper_structure

# A modal fit takes the neighbouring modes' tails for straight lines; these bearings are damped to 0.5 %.
MODAL_FIT = 1e-4

TWO = Rigs(np.array([2e6, 3e7]), np.array([1e-3, 2e-3]), np.array([20.0, 0.0]))
LOUD = noisy(FEATURE_PLAN, 0.01, seed=7)


class Here(Executor):
    """Runs the work in this process, when its result is asked for."""

    def map(self, fn: Callable, *iterables: Iterable, **_options: Any):
        return map(fn, *iterables)


@pytest.fixture(scope="module")
def two(rotor_fmu) -> Dataset:
    """The two rigs, with noise, measured here by one instance."""
    return measure_rigs(rotor_fmu, TWO, Here(), plan=LOUD)


@pytest.fixture(scope="module")
def clean(rotor_fmu) -> Dataset:
    """The two rigs without noise."""
    return measure_rigs(rotor_fmu, TWO, Here())


def random_dataset(n: int = 5) -> Dataset:
    """Numbers of any size, with every digit in use."""
    values = np.random.default_rng(1).standard_normal((n, 9)) * 10.0 ** np.arange(-5, 4)
    return Dataset(Rigs(*values[:, :3].T), values[:, 3:])


# -- measuring -------------------------------------------------------------------------------------


def test_features_are_those_of_the_rig_that_was_set(clean):
    assert clean.features.shape == (2, len(FEATURE_NAMES))
    for row, k_b, zeta, damping in zip(
        clean.features, TWO.k_b, TWO.shaft_damping_ratio, TWO.bearing_damping, strict=True
    ):
        finder = StiffnessFinder(paper_structure(), Condition(bearing_damping=damping, shaft_damping_ratio=zeta))
        assert_allclose(row[:3], [*finder.shifts(k_b), finder.amplitude_ratio(k_b, damping)], rtol=MODAL_FIT)


@pytest.mark.long
def test_the_result_does_not_depend_on_where_and_in_which_parts_the_work_runs(rotor_fmu, two, monkeypatch):
    """One process and one instance, or two processes with a rig each: the same bits, noise included."""
    monkeypatch.setattr(dataset, "_CHUNK", 1)
    counts: list[int] = []
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        apart = measure_rigs(rotor_fmu, TWO, pool, plan=LOUD, progress=counts.append)
    assert_array_equal(apart.features, two.features)
    assert counts == [1, 2]


@pytest.mark.long
def test_noise_differs_from_rig_to_rig_and_comes_again_with_its_seed(rotor_fmu, two):
    twins = Rigs(*(np.repeat(getattr(TWO, name)[:1], 2) for name in RIG_NAMES))
    first, second = measure_rigs(rotor_fmu, twins, Here(), plan=LOUD).features
    assert np.all(first[:3] != second[:3])
    assert_array_equal(first, two.features[0])


def test_noise_moves_the_features_by_their_standard_errors(clean, two):
    """Without noise the errors are what the fit's model of the neighbouring modes leaves."""
    assert np.all(np.abs(two.features[:, :3] - clean.features[:, :3]) < 4 * two.features[:, 3:])
    assert np.all(two.features[:, 3:] > 2 * clean.features[:, 3:])


def test_what_the_store_has_is_not_measured_again(rotor_fmu, two, tmp_path, monkeypatch):
    first = measure_rigs(rotor_fmu, TWO, Here(), plan=LOUD, store=tmp_path / "store")
    monkeypatch.delattr(dataset, "FmuSession")
    again = measure_rigs(rotor_fmu, TWO, Here(), plan=LOUD, store=tmp_path / "store")
    for data in (first, again):
        assert_array_equal(data.features, two.features)
    for other in ({"plan": noisy(FEATURE_PLAN, 0.01, seed=8)}, {"plan": LOUD, "excitation_node": 3}):
        with pytest.raises(NameError, match="FmuSession"):
            measure_rigs(rotor_fmu, TWO, Here(), store=tmp_path / "store", **other)


def test_the_shipped_rotor_needs_about_the_shipped_band():
    """The band holds modes 1 and 2 whatever k_b the prior draws, with room round them."""
    plan = feature_plan(paper_structure(), PRIOR)
    for condition in (Condition(PRIOR.k_b_trained[0]), Condition(rigid_support=True)):
        first, second = natural_frequencies_hz(build_system(paper_structure(), condition), plane=1)[:2]
        assert plan.f_min_hz < 0.8 * first
        assert second < 0.85 * plan.f_max_hz
    assert replace(plan, f_min_hz=FEATURE_PLAN.f_min_hz, f_max_hz=FEATURE_PLAN.f_max_hz) == FEATURE_PLAN


# -- the file --------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 5])
def test_a_data_set_read_back_has_every_bit(tmp_path, n):
    written = random_dataset(n)
    write_dataset(written, tmp_path / "rigs.csv")
    read = read_dataset(tmp_path / "rigs.csv")
    assert len(read) == len(written) == n
    assert_array_equal(read.features, written.features)
    for name in RIG_NAMES:
        assert_array_equal(getattr(read.rigs, name), getattr(written.rigs, name))


def test_the_file_names_its_columns(tmp_path):
    write_dataset(random_dataset(), tmp_path / "rigs.csv")
    header = (tmp_path / "rigs.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header == ",".join([*RIG_NAMES, *FEATURE_NAMES])


def test_the_data_the_network_was_trained_on_are_rigs_of_the_prior():
    training, calibration = (
        read_dataset(Path(dataset.__file__).with_name("data") / f"{n}.csv") for n in ("training", "calibration")
    )
    for data in (training, calibration):
        assert np.all((data.rigs.k_b >= PRIOR.k_b_trained[0]) & (data.rigs.k_b <= PRIOR.k_b_trained[1]))
        assert np.all(data.features[:, :3] > 0)
    assert not np.isin(training.rigs.k_b, calibration.rigs.k_b).any()


def test_interrupted_writing_leaves_the_old_file_and_nothing_beside_it(tmp_path, monkeypatch):
    path = tmp_path / "rigs.csv"
    write_dataset(random_dataset(3), path)
    before = path.read_bytes()
    broken = random_dataset(4)

    def number(value: float) -> float:
        if value == broken.features[2, 0]:
            raise KeyboardInterrupt
        return value

    monkeypatch.setattr(dataset, "float", number, raising=False)
    with pytest.raises(KeyboardInterrupt):
        write_dataset(broken, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
