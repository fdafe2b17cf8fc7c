"""Campaigns on disk: the same seed gives the same files, labels are sealed, sizes mean what they say."""

from __future__ import annotations

import json
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.blind.generate import campaigns as generate
from rigtwin.blind.generate.campaigns import Order, make, make_all, seal
from rigtwin.blind.generate.case import measure, plan_lines, standard_error
from rigtwin.blind.generate.detection import THRESHOLD, Distance, PlainRun
from rigtwin.blind.generate.draw import LIBRARY, draw_campaign, empty_case, library_effect
from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.folder import read_csv, write_campaign
from rigtwin.blind.generate.machine import Workshop
from rigtwin.blind.generate.nonlinear import NotFoundError
from rigtwin.blind.generate.response import reported
from rigtwin.blind.generate.rig import read_rig
from rigtwin.blind.generate.sizes import shown_size, size_ratio
from rigtwin.blind.judge.score import read_labels
from rigtwin.sim.campaign_folder import load_campaign

RIG = read_rig("nit-rourkela")
CUBIC = next(i for i in range(len(LIBRARY)) if library_effect(i) == "bearing_cubic")


def test_the_same_order_makes_the_same_campaign(tmp_path):
    order = Order("W3", "tuning", 7, 0)
    for place in ("a", "b"):
        make(order, tmp_path / place)
    for file in sorted((tmp_path / "a" / order.name).glob("*/*.[ct]*")):
        other = tmp_path / "b" / file.relative_to(tmp_path / "a")
        assert file.read_bytes() == other.read_bytes(), file.name
    assert make(replace(order, split="report"), tmp_path / "c") != make(order, tmp_path / "d")


def test_the_campaign_is_one_that_the_project_reads(tmp_path):
    order = Order("W3", "tuning", 7, 1)
    label = make(order, tmp_path)
    for part in ("measured", "held_out"):
        campaign = load_campaign(tmp_path / order.name / part)
        assert len(campaign.runs) >= 2
    file = next((tmp_path / order.name / "measured").glob("*.csv"))
    frequency, values = read_csv(file)
    assert len(frequency) == 280
    assert sorted(values) == ([2] if label["sensors"] == "one" else [1, 2, 3, 4, 5, 6, 7])


def test_a_changed_label_breaks_the_seal(tmp_path):
    make(Order("W3", "tuning", 7, 0), tmp_path)
    seal(tmp_path)
    assert len(read_labels(tmp_path)) == 1
    labels = tmp_path / "labels.json"
    content = json.loads(labels.read_text(encoding="utf-8"))
    content["campaigns"][0]["k_b"] *= 1.1
    labels.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ValueError, match="does not match"):
        read_labels(tmp_path)


def test_measured_files_say_nothing_of_the_label(tmp_path):
    order = Order("W1", "tuning", 1, 0)
    make(order, tmp_path)
    text = (tmp_path / order.name / "measured" / "campaign.toml").read_text(encoding="utf-8")
    assert "attached_mass" not in text
    assert "W1" not in text


def test_noise_is_as_large_as_its_standard_error(tmp_path):
    rng = np.random.default_rng(0)
    case = replace(empty_case(RIG, "W3", rng), noise=0.008, with_std=True, quantity="accelerance")
    runs = measure(RIG, case, 2, (1.0,), rng)
    write_campaign(tmp_path / "measured", RIG.name, case, runs, rng)
    for run in runs:
        _, values = read_csv(tmp_path / "measured" / f"{run.name}.csv")
        error = np.column_stack([*values.values()]) - run.actual
        assert_allclose(np.mean(np.abs(error / standard_error(run.actual, 0.008)) ** 2), 1.0, rtol=0.1)


def test_what_the_nuisances_explain_is_no_distance():
    rng = np.random.default_rng(3)
    case = replace(empty_case(RIG, "W3", rng), noise=0.01)
    settings = [case.setting(rigid, 2) for rigid in (True, False)]
    lines = [plan_lines(RIG, case, s, 1.0, rng) for s in settings]
    distance = Distance(RIG, case, settings, lines)
    other = replace(case.workshop, modulus=case.workshop.modulus + 3e-4)
    responses = [
        1.01 * reported(RIG, replace(s, k_b=1.3 * s.k_b), (), f, other) for s, f in zip(settings, lines, strict=True)
    ]
    # half a standard deviation of gain in both runs and of modulus
    assert distance.of(responses) < 1.5
    assert distance.of([1.3 * H for H in responses]) > THRESHOLD


def test_a_run_so_far_out_that_its_masses_are_negative_has_neither_resonances_nor_a_response():
    one, none = np.ones((1, 1)), np.zeros((1, 1))
    run = PlainRun(np.ones(3), one, one, one, none, ((one, none, none),), 0.001, np.ones(1), np.ones((1, 1)))
    assert_allclose(run.frequencies(np.array([3.0])), [0.5])
    assert run.frequencies(np.array([-2.0])).size == 0
    assert np.isfinite(run.at(np.array([3.0]))).all()
    assert np.isnan(run.at(np.array([-2.0]))).all()  # as far away as can be, where a trial step leads there


@pytest.mark.parametrize(
    ("small", "large"),
    [
        (Effect("attached_mass", {"mass": 0.05}, 4), Effect("attached_mass", {"mass": 0.2}, 4)),
        # what tolerances and k_b follow, resonances and all
        (Effect("shaft_modulus", {"factor": 0.99}), Effect("shaft_modulus", {"factor": 0.96})),
        pytest.param(
            Effect("shaft_modulus", {"factor": 1.01}), Effect("shaft_modulus", {"factor": 1.04}), marks=pytest.mark.long
        ),
        # in another form, where resonances far apart are no further from each other than near ones
        (
            Effect("hub_stiffening", {"factor": 1.2}, form="tapered"),
            Effect("hub_stiffening", {"factor": 1.8}, form="tapered"),
        ),
    ],
)
def test_size_is_in_proportion_to_severity(small, large):
    rng = np.random.default_rng(5)
    case = replace(empty_case(RIG, "W1", rng), noise=0.01, workshop=Workshop())
    ratios = [size_ratio(RIG, case, effect, np.random.default_rng(1)) for effect in (small, large)]
    assert_allclose(ratios[1] / ratios[0], 4.0, rtol=0.1)
    assert ratios[0] > 1


def test_small_means_small():
    draws = [draw_campaign(RIG, "W1", index, np.random.default_rng(index)) for index in (1, 9)]
    for draw in draws:
        assert draw.ratio is not None
        assert draw.ratio >= 3


def test_a_worker_that_dies_is_not_taken_for_a_campaign(tmp_path):
    """Its campaigns are counted as missing, and made when the same is asked for again."""
    orders = [Order("W3", "tuning", 7, index) for index in range(2)]

    class Broken(Executor):
        def submit(self, fn, /, *args, **kwargs):
            future: Future = Future()
            future.set_exception(BrokenExecutor("a worker died"))
            return future

    assert make_all(orders, tmp_path, Broken()) == 2
    assert json.loads((tmp_path / "index.json").read_text(encoding="utf-8")) == []
    with ThreadPoolExecutor(1) as pool:
        assert make_all(orders, tmp_path, pool) == 0
    assert len(json.loads((tmp_path / "index.json").read_text(encoding="utf-8"))) == 2


def test_a_campaign_that_another_worker_has_made_meanwhile_stays(tmp_path):
    order = Order("W3", "tuning", 7, 0)
    make(order, tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    make(order, tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.long
def test_a_nonlinear_effect_that_the_runs_do_not_show_is_drawn_again(monkeypatch):
    """Its size is what the runs show: one whose motion never came about is none, whatever was planned."""
    shown: list[bool] = []

    def without(rig, case, drive_node, levels, rng):
        shown.append(bool(shown))  # not in the first draw
        seen = case if shown[-1] else replace(case, effects=())
        return measure(rig, seen, drive_node, levels, rng)

    monkeypatch.setattr(generate, "measure", without)
    order = Order("W1", "tuning", 3, CUBIC)
    draw, measured, _ = generate.measured_draw(RIG, order, order.rng())
    assert len(shown) == 3
    assert draw.rejected >= 1
    assert draw.ratios == (shown_size(RIG, draw.case, measured),)
    assert draw.ratios[0] >= 3


def test_an_effect_that_no_draw_shows_is_an_error(monkeypatch):
    def without(rig, case, drive_node, levels, rng):
        return measure(rig, replace(case, effects=()), drive_node, levels[:1], rng)

    monkeypatch.setattr(generate, "measure", without)
    monkeypatch.setattr(generate, "REDRAWS", 1)
    order = Order("W1", "tuning", 3, CUBIC)
    with pytest.raises(NotFoundError, match="1 showed no effect"):
        generate.measured_draw(RIG, order, order.rng())
