"""k_b by all lines of measured responses together: ``rigtwin estimate --method responses``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import rigtwin
from benchmarks.k_b_bias import answers
from rigtwin.errors import UserError
from rigtwin.rotor.effects import AxialLoad, Effect, ShaftDamping
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.campaign import UNKNOWN_DAMPING, Channel, NominalBelief, Run
from rigtwin.sim.formats import write_run
from tests.gap.conftest import blank, with_noise
from tests.rigtwin.conftest import run_json

ROOT = Path(__file__).resolve().parents[2]
K_B = 4e6
COARSE = np.arange(20.0, 400.1, 2.0)  # the paper's raster, with hardly a line in any half-power band


def runs_of(
    rig: Rig,
    seed: int = 0,
    drift: float = 0.0,
    noise: float = 0.01,
    damping: float = 12.0,
    effects: Sequence[Effect] = (),
) -> list[Run]:
    """Both supports on a coarse raster and a finer mesh, with noise, and resonances that drift from run to run."""
    rng, structure, made = np.random.default_rng(seed), assemble(rig, elements_between_nodes=4), []
    for support in ("rigid", "bearing"):
        condition = Condition(K_B, support == "rigid", bearing_damping=damping, shaft_damping_ratio=0.002)
        H = measured_response(structure, condition, effects, COARSE / (1 + drift * rng.standard_normal()), [2])
        run = blank(support, COARSE, channels=(Channel(2),), name=support)
        made.append(with_noise(run, H, 2 * seed + len(made), noise))
    return made


@pytest.fixture(scope="module")
def shipped() -> Rig:
    return load_rig("nit-rourkela")


def test_a_coarse_raster_tells_k_b_to_its_interval_which_holds_what_a_workshop_does_not_know(shipped):
    stiffer = [s.model_copy(update={"youngs_modulus_Pa": 1.01 * s.youngs_modulus_Pa}) for s in shipped.segment]
    workshop = shipped.model_copy(update={"segment": stiffer})
    errors = []
    for seed in range(4):
        (answer,) = rigtwin.estimate(*runs_of(workshop, seed, drift=1e-4), method="responses")
        assert (answer.method, answer.estimate.valid) == ("responses", True), answer.objections
        log_std = answer.estimate.k_b_std / answer.estimate.k_b
        assert log_std < 0.004
        errors.append(np.log(answer.estimate.k_b / K_B) / log_std)
    assert np.abs(errors).max() < 4


def test_too_few_lines_for_shifts_are_all_lines_together(tmp_path, shipped):
    paths = []
    for run in runs_of(shipped, damping=0.5):
        write_run(run.on_lines(slice(None, None, 2)), tmp_path / f"{run.support}.csv")
        paths.append(tmp_path / f"{run.support}.csv")
    (told,) = run_json("estimate", *paths, "--excitation-node", 2)["estimates"]
    assert (told["method"], told["valid"], told["delta_f1"]) == ("responses", True, None)
    assert told["k_b_low"] < K_B < told["k_b_high"]


@pytest.mark.parametrize(("name", "holds"), [("ross_nothing", True), ("ross_pedestals", False)])
def test_a_campaign_is_answered_by_all_lines_as_its_workshop_knows_the_rig(name, holds):
    """Of rotors that another code has computed; of two files alone, the shifts are surer than they may be."""
    stored = ROOT / "benchmarks" / "stored_campaigns" / name
    true = json.loads((stored / "truth" / "label.json").read_text(encoding="utf-8"))["k_b"]
    (told,) = run_json("estimate", stored / "measured")["estimates"]
    assert (told["method"], told["valid"], told["delta_f1"] > 0) == ("responses", holds, True)
    assert (told["k_b_low"] < true < told["k_b_high"]) == holds
    (shifts,) = run_json("estimate", stored / "measured", "--method", "network")["estimates"]
    assert (shifts["k_b_low"] < true < shifts["k_b_high"]) == holds
    files = stored / "measured" / "run01_rigid_1N.csv", stored / "measured" / "run02_bearing_1N.csv"
    (as_drawn,) = run_json("estimate", *files, "--method", "network")["estimates"]
    assert not as_drawn["k_b_low"] < true < as_drawn["k_b_high"]


def test_drifts_that_would_hide_a_gap_are_an_objection(shipped):
    """A shaft under tension is none of the tolerances: resonances that drift by percents would explain it."""
    (answer,) = rigtwin.estimate(*runs_of(shipped, noise=1e-3, effects=[AxialLoad(force=2000.0)]), method="responses")
    assert abs(answer.estimate.k_b / K_B - 1) > 0.01
    assert not answer.estimate.valid
    assert any("frequency_drift of" in words for words in answer.objections), answer.objections
    (answer,) = rigtwin.estimate(*runs_of(shipped, noise=1e-3), method="responses")
    assert answer.estimate.valid, answer.objections


@pytest.mark.parametrize(("effect", "noticed"), [(ShaftDamping(damping_ratio=0.005), False), (AxialLoad(), True)])
def test_the_page_of_biases_says_whether_an_effect_is_noticed(effect, noticed):
    told = list(answers(effect, 2e6))
    assert len(told) == 3
    assert [words.endswith("flagged") for words in told] == [noticed] * 3
    assert any(words.endswith("inside") for words in told) != noticed


def test_one_run_on_bearings_is_enough(shipped):
    _, bearing = runs_of(shipped)
    belief = NominalBelief(shaft_damping_tolerance=UNKNOWN_DAMPING, bearing_damping_tolerance=UNKNOWN_DAMPING)
    found = rigtwin.estimate(rigtwin.Campaign("", "nit-rourkela", (bearing,), nominal=belief), method="responses")
    assert found.best.estimate.k_b_low < K_B < found.best.estimate.k_b_high
    assert found.best.estimate.valid


def test_a_rotor_that_its_model_does_not_describe_is_not_valid(shipped):
    heavier = [d.model_copy(update={"density_kg_per_m3": 1.3 * d.density_kg_per_m3}) for d in shipped.disk[:1]]
    odd = shipped.model_copy(update={"disk": [*heavier, *shipped.disk[1:]]})
    (answer,) = rigtwin.estimate(*runs_of(odd, noise=0.001), method="responses")
    assert not answer.estimate.valid
    assert "rigtwin diagnose says where" in answer.objections[0]


def test_what_does_not_go_together_is_refused(shipped, tmp_path):
    rigid, bearing = runs_of(shipped)
    with pytest.raises(UserError, match="asks no network"):
        rigtwin.estimate(rigid, bearing, method="responses", estimator=tmp_path / "a.fmu")
    with pytest.raises(UserError, match="no run on bearings"):
        rigtwin.estimate(rigtwin.Campaign("", "nit-rourkela", (rigid,)), method="responses")
    with pytest.raises(UserError, match="give a rigid and a bearing run, or one campaign folder"):
        rigtwin.estimate(bearing, method="responses")
    with pytest.raises(UserError, match="the campaign says that of its runs"):
        rigtwin.estimate(rigtwin.Campaign("", "nit-rourkela", (bearing,)), method="responses", excitation_node=3)
    with pytest.raises(UserError, match="numbers go without files"):
        rigtwin.estimate(rigid, bearing, method="responses", delta_f1=1.0)
    for sources in ((rigid, bearing), (rigtwin.Campaign("", "nit-rourkela", (rigid, bearing)),)):
        with pytest.raises(UserError, match="by its name or its file"):
            rigtwin.estimate(*sources, method="responses", rig=shipped)
