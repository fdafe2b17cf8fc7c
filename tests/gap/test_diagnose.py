"""From a campaign to a verdict, on small campaigns whose truth is known."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from threadpoolctl import threadpool_info, threadpool_limits

from rigtwin.gap.answer.held_out import _figures, _held_out, lines_to_measure
from rigtwin.gap.answer.report import _equivalent, _may_be_the_bearings, _regime
from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.findings import usable
from rigtwin.gap.audit.noise import common_error
from rigtwin.gap.curves import nrmse
from rigtwin.gap.diagnose import diagnose
from rigtwin.gap.document import FILE_NAME, SCHEMA, Cause, Diagnosis, Finding, Location, Where
from rigtwin.gap.explain import _laws_not_ruled_out, library_of
from rigtwin.gap.inference.hypotheses import candidates
from rigtwin.gap.inference.observed import observe
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.predict import predict
from rigtwin.gap.prepare import prepared
from rigtwin.gap.search.nominal import recalibrate
from rigtwin.gap.verdict.adequacy import Adequacy, judge, not_shared, odd_lines
from rigtwin.gap.verdict.ranking import Ranked, _of_the_likeliest, _verdict_of
from rigtwin.gap.verdict.standing import Standing, excess_of
from rigtwin.rotor.effects import (
    AttachedMass,
    BearingCubic,
    BearingOffset,
    CompliantRigidSupport,
    FastSweep,
    ForceDropout,
    PedestalFlexibility,
    PlaneAnisotropy,
    SensorDelay,
    SensorPosition,
    ViscoelasticSupport,
)
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.sim.campaign import Channel, MeasurementError
from tests.gap.conftest import (
    BELIEF,
    K_B,
    MASS,
    NOISE,
    RIVALS,
    STRUCTURE,
    all_but,
    blank,
    both_supports,
    campaign_of,
    condition,
    lines,
    measure,
    problem_of,
    truth,
    with_noise,
    workshop,
)


@pytest.fixture(scope="module")
def healthy():
    """Diagnosis of a rotor that is the nominal one."""
    return diagnose(campaign_of(*both_supports(seed=5)), exclude=all_but(*RIVALS))


@pytest.fixture(scope="module")
def withheld():
    """Diagnosis of a rotor with a mass, by a library that has no mass."""
    return diagnose(campaign_of(*both_supports(MASS, seed=3)), exclude=all_but("disk_mass", "shaft_modulus"))


def inside(estimate, truth):
    return abs(estimate.value - truth) < 4 * estimate.std


# -- an effect of the library ----------------------------------------------------------------------


def test_an_attached_mass_is_the_cause(weighed):
    diagnosis = weighed.diagnosis
    assert diagnosis.verdict == "cause"
    cause = diagnosis.causes[0]
    assert cause.effects == ("attached_mass",)
    assert (cause.location.kind, cause.location.node) == ("node", 3)
    assert cause.probability > 0.9
    assert "attached mass at node 3" in diagnosis.sentence


def test_its_size_and_the_bearings_are_within_their_errors(weighed):
    cause = weighed.diagnosis.causes[0]
    mass = cause.parameters["mass"]
    assert inside(mass, MASS.mass)
    assert mass.std < 0.05 * MASS.mass
    assert mass.unit == "kg"
    assert inside(cause.k_b, K_B)
    assert cause.k_b.std < 0.01 * K_B
    # The nominal model alone makes good for the mass by softer bearings.
    assert not inside(weighed.diagnosis.nominal["k_b"], K_B)


def test_the_gap_shrinks_to_the_noise(weighed):
    shrink = weighed.diagnosis.shrink
    assert shrink.verified_by == "model"
    assert shrink.before > 10 * NOISE
    assert_allclose([shrink.after, shrink.floor], NOISE, rtol=0.3)
    assert shrink.explainable > 0.95
    assert 5 * NOISE < shrink.without_effect < 0.2 * shrink.before  # strained tolerances take much of it along


def test_the_interval_is_one_for_another_excitation_free_of_noise(weighed):
    document = Diagnosis.from_json(weighed.diagnosis.to_json())
    runs = [blank(support, lines(support, [MASS]), excitation_node=4) for support in ("rigid", "bearing")]
    true = [truth(run, [MASS]) for run in runs]
    predicted = predict(document, campaign_of(*runs))
    before = np.mean([nrmse(H, each.nominal.H) for H, each in zip(true, predicted, strict=True)])
    after = np.mean([nrmse(H, each.corrected.H) for H, each in zip(true, predicted, strict=True)])
    low, high = weighed.diagnosis.shrink.ci90
    assert 0.9 < low < high < 1.0
    assert high - low > 0.005
    assert low - 0.005 < 1 - after / before < high + 0.005


def test_the_curves_are_the_runs_and_their_models(weighed):
    assert len(weighed.curves) == 2
    for curve in weighed.curves:
        nominal, corrected = (np.linalg.norm(curve.run.H - H) for H in (curve.nominal, curve.corrected))
        assert corrected < 0.1 * nominal
        assert corrected < 2 * NOISE * np.linalg.norm(curve.run.H)


def test_the_bearings_stiffness_stands_there_unless_the_gap_is_named_elsewhere(weighed, healthy):
    assert weighed.diagnosis.where.bearings is None
    told = healthy.diagnosis.where.bearings
    assert told.run == healthy.curves[1].run.name
    damping = 2 * np.pi * np.array(told.frequency_hz) * BELIEF.bearing_damping_Ns_per_m
    assert_allclose(np.median(told.real), K_B, rtol=0.02)
    assert_allclose(told.nominal_real, K_B, rtol=0.01)
    assert_allclose(told.nominal_imag, damping)
    assert told.corrected_real == ()


@pytest.mark.parametrize(
    ("verdict", "kinds", "shown"),
    [
        ("no_gap", [], True),
        ("unknown", ["node"], True),
        ("cause", ["bearings"], True),
        ("cause", ["node"], False),
        ("ambiguous", ["node", "bearings"], True),
        ("ambiguous", ["node", "shaft"], False),
    ],
)
def test_an_answer_elsewhere_hides_the_bearings_stiffness(verdict, kinds, shown):
    causes = [Cause(("a",), Location(kind), 0.5, {}, None, 0.0, locations=(Location(kind),)) for kind in kinds]
    answered = {"cause": causes[:1], "ambiguous": causes}.get(verdict, [])
    assert _may_be_the_bearings(answered) == shown


def test_where_names_the_node(weighed):
    where = weighed.diagnosis.where
    assert max(where.nodes, key=lambda node: node.share).node == 3
    assert where.regime == "linear"


def test_all_causes_together_are_certain(weighed):
    assert_allclose(sum(cause.probability for cause in weighed.diagnosis.causes), 1.0)
    assert weighed.diagnosis.equivalent == ()


# -- nothing ---------------------------------------------------------------------------------------


def test_where_nothing_is_there_is_no_gap(healthy):
    diagnosis = healthy.diagnosis
    assert diagnosis.verdict == "no_gap"
    assert diagnosis.shrink is None
    assert diagnosis.next_test is None
    assert diagnosis.nominal["probability"] > 0.5
    assert inside(diagnosis.nominal["k_b"], K_B)


# -- an effect that the library lacks --------------------------------------------------------------


def test_a_withheld_effect_is_not_blamed_on_another(withheld):
    diagnosis = withheld.diagnosis
    assert diagnosis.verdict == "unknown"
    assert diagnosis.unknown_score > 0.5
    assert "attached_mass" in diagnosis.excluded
    assert all("attached_mass" not in cause.effects for cause in diagnosis.causes)
    assert diagnosis.shrink is None
    assert diagnosis.next_test is not None


def test_a_small_withheld_effect_is_not_passed_over():
    """Bearings 0.15 mm aside: no single line shows it, all lines of a resonance together do."""
    campaign = campaign_of(*both_supports(BearingOffset(offset=1.5e-4), seed=1))
    problem, nominal = prepared(campaign)
    quality = judge(problem, nominal)
    assert quality.misfit < 1 + 3 * quality.spread
    assert abs(quality.correlation) < 3.5
    diagnosis = diagnose(campaign, exclude=all_but("sensor_gain")).diagnosis
    assert diagnosis.verdict == "unknown"
    assert diagnosis.unknown_score > 0.5


def test_a_known_effect_is_less_strange_than_a_withheld_one(weighed, healthy, withheld):
    known = max(weighed.diagnosis.unknown_score, healthy.diagnosis.unknown_score)
    assert known < 0.5 < withheld.diagnosis.unknown_score


def test_an_effect_that_does_not_exist_cannot_be_excluded():
    with pytest.raises(ValueError, match="no effect flux_capacitor"):
        diagnose(campaign_of(*both_supports()), exclude=("flux_capacitor", "open_crack"))


# -- runs of other kinds ---------------------------------------------------------------------------


def test_rigid_runs_alone_give_no_bearing_stiffness():
    run = measure("rigid", (MASS,), seed=1)
    diagnosis = diagnose(campaign_of(run), exclude=all_but("attached_mass", "bearing_damping")).diagnosis
    assert diagnosis.nominal["k_b"] is None
    assert diagnosis.causes[0].effects == ("attached_mass",)
    assert diagnosis.causes[0].k_b is None
    assert diagnosis.next_test is not None
    assert diagnosis.next_test.run["support"] == "bearing"


def test_errors_need_not_be_given():
    runs = (replace(run, std=None) for run in both_supports(MASS, seed=3))
    diagnosis = diagnose(campaign_of(*runs), exclude=all_but("attached_mass")).diagnosis
    assert diagnosis.causes[0].effects == ("attached_mass",)
    assert diagnosis.causes[0].location.node == 3


def test_few_lines_without_errors_do_not_hide_a_gap():
    runs = [replace(run.on_lines(slice(0, None, len(run.frequency_hz) // 6)), std=None) for run in both_supports(MASS)]
    assert max(len(run.frequency_hz) for run in runs) < 8
    assert diagnose(campaign_of(*runs), exclude=all_but("attached_mass")).diagnosis.verdict != "no_gap"


def test_next_to_no_data_is_not_enough():
    run = measure("rigid", channels=(Channel(2),), frequency_hz=np.linspace(50.0, 60.0, 4))
    diagnosis = diagnose(campaign_of(replace(run, std=None)), exclude=all_but("attached_mass")).diagnosis
    assert diagnosis.verdict == "not_enough_data"
    assert diagnosis.shrink is None
    assert diagnosis.where == Where()
    assert np.isnan(diagnosis.nominal["probability"])
    assert "fifty lines" in diagnosis.next_test.words


def test_where_every_channel_is_zero_nothing_is_said_of_the_bearings():
    run = measure("bearing")
    diagnosis = diagnose(campaign_of(replace(run, H=0 * run.H, std=None)), exclude=all_but("attached_mass")).diagnosis
    assert (diagnosis.verdict, diagnosis.nominal["k_b"], diagnosis.where) == ("not_enough_data", None, Where())


def test_a_node_that_the_rig_lacks_is_wrong_input():
    run = measure("rigid", (MASS,))
    beyond = replace(run, channels=(*run.channels[:-1], Channel(9)))
    with pytest.raises(MeasurementError, match="channel node9: node 9 does not exist, the rig has 7"):
        diagnose(campaign_of(beyond))
    with pytest.raises(MeasurementError, match="excitation_node: node 8 does not exist, the rig has 7"):
        diagnose(campaign_of(replace(run, excitation_node=8)))


def test_with_every_effect_excluded_a_gap_is_unknown():
    diagnosis = diagnose(campaign_of(*both_supports(MASS, seed=3)), exclude=tuple(EFFECTS)).diagnosis
    assert (diagnosis.verdict, diagnosis.causes) == ("unknown", ())


@pytest.mark.long
def test_exchanged_sensors_are_said_to_be_the_cause_rather_than_an_effect():
    rigid, bearing = both_supports()
    exchanged = tuple(Channel({2: 3, 3: 2}.get(c.node, c.node)) for c in bearing.channels)
    found = diagnose(campaign_of(rigid, replace(bearing, channels=exchanged)), exclude=all_but("disk_mass"))
    assert found.diagnosis.verdict == "unknown"
    assert "nodes 2 and 3 look like each other's" in found.diagnosis.sentence
    assert "corrected" in found.diagnosis.next_test.words


def test_a_gap_on_rigid_supports_is_no_law_of_the_bearings():
    bearing = [blank("bearing", lines("bearing"), force_amplitude_N=force) for force in (0.1, 1.0)]
    for effects, left in (((), ("bearing_cubic", "rub")), ((CompliantRigidSupport(stiffness=2e7),), ("rub",))):
        runs = [measure("rigid", effects), *(measure("bearing", frequency_hz=run.frequency_hz) for run in bearing)]
        laws = candidates(bearing, STRUCTURE, all_but("bearing_cubic", "rub"), nonlinear=True)
        assert len(laws) > 1
        assert {law.ids[0] for law in _laws_not_ruled_out(problem_of(*runs), laws)} == set(left)


def test_runs_are_prepared_with_the_scatter_of_their_lines():
    problem, _ = prepared(campaign_of(*both_supports()))
    assert [observed.scatter for observed in problem.observed] == pytest.approx([1.0, 1.0], rel=0.2)


@pytest.mark.parametrize(("scatter", "noise"), [((np.nan, np.nan), True), ((1.4, 1.5, np.nan), True), ((1.0,), False)])
def test_a_misfit_that_scatters_is_still_a_misfit(scatter, noise):
    """What a nonlinear fit leaves at sharp resonances is no noise that its errors would have to be scaled by.

    As much is as the lines scatter about smooth curves, by no model; where they do not tell, not very much.
    """
    problem = SimpleNamespace(observed=[SimpleNamespace(scatter=each) for each in scatter])
    quality = Adequacy(scale=30.0, misfit=5.0, correlation=0.0, spread=0.03)
    for chi2, passes in ((5000.0, False), (1900.0, noise)):
        fit = SimpleNamespace(effects=(BearingCubic(stiffness=1e15),), chi2=chi2, n_data=1000)
        assert (excess_of(problem, fit, quality) < 1) == passes  # type: ignore[arg-type]


def test_a_cause_is_named_only_where_it_is_sure():
    """No gap takes its share of the probability, and what is hopeless is in no set."""
    fits = tuple(SimpleNamespace(hypothesis=SimpleNamespace(ids=(name,))) for name in ("a", "b", "c"))
    for shares, no_gap, verdict in (((0.53, 0.01, 0.0), 0.46, "ambiguous"), ((0.95, 0.01, 0.0), 0.04, "cause")):
        ranked = Ranked(fits, shares, no_gap)  # type: ignore[arg-type]
        assert _verdict_of(ranked, SimpleNamespace(excess=0.5)) == verdict  # type: ignore[arg-type]
    causes = [Cause((name,), Location("shaft"), p, {}, None, 0.0) for name, p in (("a", 0.5), ("b", 0.45), ("c", 1e-9))]
    assert [cause.effects for cause in _equivalent(causes)] == [("a",), ("b",)]


def test_no_gap_is_unknown_where_the_nominal_model_leaves_more_than_noise():
    """Although the best fit of an effect leaves noise alone; the doubt is the nominal model's then."""
    problem = problem_of(*both_supports(MASS))
    nominal = recalibrate(problem)
    standing = Standing((nominal,), judge(problem, nominal), 0.5)
    for no_gap, doubted in ((0.4, False), (0.6, True)):
        ranked = Ranked((), (), no_gap)
        assert (_of_the_likeliest(problem, nominal, ranked, standing).excess > 1) == doubted
    healthy = problem_of(*both_supports())
    assert _of_the_likeliest(healthy, recalibrate(healthy), Ranked((), (), 0.6), standing).excess < 1
    for excess, verdict in ((0.5, "no_gap"), (1.5, "unknown")):
        assert _verdict_of(Ranked((), (), 0.6), replace(standing, excess=excess)) == verdict


def test_the_regime_is_that_of_all_causes_that_are_answered():
    place = Location("sensor", 3)
    gain, delay, mass = (
        Cause((name,), place, 0.5, {}, None, 0.0) for name in ("sensor_gain", "sensor_delay", "attached_mass")
    )
    assert _regime((gain, delay), ()) == "measurement_chain"
    assert _regime((gain, mass), ()) == _regime((mass,), ()) == _regime((), ()) == "linear"
    bent = Finding("level", "note", "The resonance moves: the rig depends on amplitude.", "one, two", 0.01, 0.001)
    assert _regime((gain, mass), (bent,)) == "amplitude_dependent"


@pytest.mark.parametrize("magnitude", [pytest.param(False, marks=pytest.mark.long), True])
def test_what_the_nominal_model_leaves_of_its_own_rig_is_noise(magnitude):
    """The same with given errors and with errors by the lines' own scatter."""
    fine = np.unique(np.r_[np.linspace(20.0, 400.0, 800), lines("bearing")])
    runs = [measure("bearing", seed=seed, frequency_hz=fine) for seed in range(2)]
    for given in (True, False):
        some = [replace(run, H=np.abs(run.H), magnitude_only=True) if magnitude else run for run in runs]
        some = some if given else [replace(run, std=None) for run in some]
        problem, nominal = prepared(campaign_of(*some))
        assert nominal.chi2 / nominal.n_data == pytest.approx(1.0, abs=0.15)
        assert abs(judge(problem, nominal).correlation) < 3.5


def test_progress_and_the_virtual_rig_are_asked():
    told, asked = [], []

    def confirm(runs, effects, k_b):
        asked.append((len(runs), effects, k_b))
        return [], "model"

    outcome = diagnose(
        campaign_of(*both_supports(MASS, seed=3)),
        exclude=all_but("attached_mass"),
        progress=lambda done, total, words: told.append((done, total, words)),
        confirm=confirm,
    )
    assert told
    assert all(0 <= done <= total and words for done, total, words in told)
    ((n_runs, (effect,), k_b),) = asked
    assert (n_runs, effect.node) == (2, 3)
    assert_allclose(k_b, outcome.diagnosis.causes[0].k_b.value, rtol=1e-2)


def test_the_virtual_rig_measures_some_held_out_lines_of_a_nonlinear_run_and_all_of_a_linear_one():
    held_out = (np.arange(280) // 28) % 2 == 1
    assert lines_to_measure(held_out, (MASS,)).all()
    some = lines_to_measure(held_out, (BearingCubic(),))
    assert 8 <= some.sum() <= 12
    assert (some <= held_out).all()
    assert all(some[28 * block : 28 * (block + 1)].any() for block in range(1, 10, 2))


# -- the file --------------------------------------------------------------------------------------


@pytest.mark.parametrize("outcome", ["weighed", "healthy", "withheld"])
def test_the_file_holds_what_was_agreed(outcome, request, tmp_path):
    diagnosis = request.getfixturevalue(outcome).diagnosis
    path = diagnosis.save(tmp_path)
    assert path.name == FILE_NAME
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document == json.loads(diagnosis.to_json())
    assert document["schema"] == SCHEMA
    keys = {
        "verdict",
        "sentence",
        "nominal",
        "where",
        "causes",
        "equivalent",
        "next_test",
        "shrink",
        "audit",
        "excluded",
    }
    assert keys <= set(document)
    assert {"title", "rig", "timing_s", "calibration", "unknown_score"} <= set(document)
    assert document["verdict"] == diagnosis.verdict
    assert {"k_b", "gap"} <= set(document["nominal"])
    assert {"f_lo", "f_hi", "mode", "share"} <= set(document["where"]["bands"][0])
    assert {"node", "share"} <= set(document["where"]["nodes"][0])
    assert {"check", "severity", "words", "run"} <= set(document["audit"][0])
    if document["shrink"]:
        figures = {"before", "after", "floor", "shrink", "explainable", "ci90", "verified_by"}
        assert {"held_out", *figures} <= set(document["shrink"])
        assert len(document["shrink"]["ci90"]) == 2
    if document["next_test"]:
        assert {"words", "run"} <= set(document["next_test"])
    assert {"bands", "supports", "nodes", "regime", "levels", "joint"} <= set(document["where"])
    assert {"value", "std", "unit"} == set(document["nominal"]["k_b"])
    for cause, written in zip(diagnosis.causes, document["causes"], strict=True):
        assert written["effects"] == list(cause.effects)
        named = {"location", "probability", "parameters", "k_b", "log_evidence", "ess"}
        extended = {"locations", "places", "at_prior_edge", "place_probability", "other_places"}
        assert named | extended <= set(written)
        assert {"kind"} <= set(written["location"]) <= {"kind", "node", "x_m"}
        for name, estimate in cause.parameters.items():
            assert written["parameters"][name]["value"] == estimate.value
            assert {"value", "std", "unit"} <= set(written["parameters"][name])


# -- an effect in another form than the library's -----------------------------------------------------


def slow(run, corner: float = 2e-4):
    """The run with the accelerometer at node 4 behind a low pass of first order: nearly a delay."""
    H = run.H.copy()
    H[:, 3] /= 1 + 2j * np.pi * run.frequency_hz * corner
    return replace(run, H=H)


@pytest.mark.long
def test_an_effect_in_another_form_is_named_and_said_to_be_one():
    campaign = campaign_of(*map(slow, both_supports(seed=7)))
    found = diagnose(campaign, exclude=all_but("sensor_delay", "sensor_position", *RIVALS)).diagnosis
    assert found.verdict == "cause"
    assert (found.causes[0].effects, found.causes[0].location.node) == (("sensor_delay",), 4)
    (form,) = (finding for finding in found.audit if finding.check == "form")
    assert form.value > 1.15
    assert 0.1 < found.unknown_score < 0.5


@pytest.mark.long
def test_without_that_effect_the_same_gap_is_unknown():
    campaign = campaign_of(*map(slow, both_supports(seed=7)))
    found = diagnose(campaign, exclude=all_but("sensor_position", *RIVALS)).diagnosis
    assert found.verdict == "unknown"
    assert not [finding for finding in found.audit if finding.check == "form"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "name", "settings"),
    [
        (AttachedMass(mass=0.3, node=3, half_width=0.025), "half_width", {}),
        (ViscoelasticSupport(strength=0.5, relaxation_time=1e-3, spread=0.9), "spread", {}),
        (
            PedestalFlexibility(stiffness=8e6, mass=3.0, damping=250.0, block_compliance=0.15, block_mass=8.0),
            "block_compliance",
            {},
        ),
        (
            ForceDropout(mass=0.05, stiffness=1e4, damping=30.0, time_constant=7e-4),
            "time_constant",
            {"quantity": "acceleration"},
        ),
    ],
    ids=lambda value: getattr(value, "id", None),
)
def test_the_form_of_a_law_is_fitted_where_the_plain_law_leaves_more_than_noise(effect, name, settings):
    runs = both_supports(effect, seed=11, **settings)
    found = diagnose(campaign_of(*runs), exclude=all_but(effect.id, "bearing_damping", *RIVALS)).diagnosis
    assert (found.verdict, found.causes[0].effects) == ("cause", (effect.id,))
    assert not [finding for finding in found.audit if finding.check == "form"]
    assert found.causes[0].place_probability > 0.99  # of one fit, not of several that are the same
    form = found.causes[0].parameters[name]
    assert abs(form.value - getattr(effect, name)) < 4 * form.std < getattr(effect, name)
    plain = diagnose(
        campaign_of(*both_supports(replace(effect, **{name: 0.0}), seed=11, **settings)),
        exclude=all_but(effect.id, *RIVALS),
    ).diagnosis
    assert (plain.verdict, plain.causes[0].effects) == ("cause", (effect.id,))
    assert name not in plain.causes[0].parameters


@pytest.mark.long
def test_a_law_that_is_bent_little_is_no_second_effect():
    """A collar 14 mm wide, without its width within twice the noise; with it, nothing is left for another effect."""
    runs = both_supports(AttachedMass(mass=0.3, node=3, half_width=0.007), seed=11)
    kept = ("attached_mass", "disk_inertia", "sensor_position", "bearing_damping")
    found = diagnose(campaign_of(*runs), exclude=all_but(*kept, *RIVALS)).diagnosis
    assert [cause.effects for cause in found.causes] == [("attached_mass",)]
    width = found.causes[0].parameters["half_width"]
    assert abs(width.value - 0.007) < 3 * width.std < 0.0035


def test_a_diagnosis_keeps_linear_algebra_on_one_thread(monkeypatch):
    threads: list[int] = []

    def seen(_):
        threads.extend(library["num_threads"] for library in threadpool_info())
        raise InterruptedError

    monkeypatch.setattr("rigtwin.gap.diagnose.audit", seen)
    with threadpool_limits(limits=2), pytest.raises(InterruptedError):
        diagnose(campaign_of())
    assert set(threads) == {1}


@pytest.mark.long
def test_a_place_is_as_sure_as_the_data_make_it():
    """Driven and read in the middle, a rotor that is its own mirror image does not tell left from right."""
    runs = both_supports(AttachedMass(mass=0.2, node=3), excitation_node=4, channels=(Channel(4),))
    found = diagnose(campaign_of(*runs), exclude=all_but("attached_mass")).diagnosis
    cause = found.causes[0]
    assert found.verdict == "cause"
    assert cause.probability > 0.99
    assert cause.place_probability == pytest.approx(0.5, abs=0.2)
    assert {cause.location.node, *(each[0].node for each in cause.other_places)} == {3, 5}
    assert "(or at node" in found.sentence
    assert found.next_test is not None
    assert "separates the candidates best" in found.next_test.words


def test_a_dead_channel_is_left_out():
    """Zero where the shaft moves is no measurement; zero where it is held is one."""
    runs = [replace(run, H=np.where(np.array(run.channels) == Channel(5), 0.0, run.H)) for run in both_supports()]
    found = diagnose(campaign_of(*runs), exclude=all_but("attached_mass", "sensor_gain"))
    assert found.diagnosis.verdict == "no_gap"
    for curve in found.curves:
        assert Channel(5) not in curve.run.channels
    assert Channel(1) in found.curves[0].run.channels
    assert any("dead channel" in finding.words for finding in found.diagnosis.audit)


def test_a_dead_run_is_left_out():
    rigid, bearing = both_supports()
    dead = replace(rigid, H=0 * rigid.H)
    assert [run.name for run in usable(campaign_of(dead, bearing)).runs] == [bearing.name]
    assert len(usable(campaign_of(dead)).runs) == 1  # there is nothing else


def test_all_effects_are_equally_probable_beforehand():
    runs = [replace(run, force_amplitude_N=level) for run in both_supports() for level in (1.0, 3.0)]
    library = library_of(problem_of(*runs), ())
    priors = Counter()
    for hypothesis in (*library.linear, *library.laws):
        priors[hypothesis.ids] += hypothesis.prior
    assert {"rub", "bearing_cubic", "attached_mass"} < {name for (name,) in priors}
    assert_allclose(list(priors.values()), 1 / len(priors))
    assert library_of(problem_of(*both_supports()), ()).laws == []


@pytest.mark.parametrize(
    "effect",
    [
        pytest.param(PlaneAnisotropy(anisotropy=0.3, angle=1.2), marks=pytest.mark.long),
        SensorDelay(delay=-2e-4),
        pytest.param(SensorDelay(delay=1.1e-3, node=4), marks=pytest.mark.long),
    ],
    ids=["stiffer across the force", "early", "late"],
)
def test_an_effect_may_act_either_way(effect):
    found = diagnose(campaign_of(*both_supports(effect)), exclude=all_but(*RIVALS, effect.id)).diagnosis
    assert (found.verdict, found.causes[0].effects) == ("cause", (effect.id,))
    (name, estimate), *_ = found.causes[0].parameters.items()
    assert inside(estimate, getattr(effect, name))


@pytest.mark.long
def test_sensors_across_the_force_tell_to_which_side_the_bearings_turn():
    effect = PlaneAnisotropy(anisotropy=0.3, angle=-0.5)
    runs = []
    for support in ("rigid", "bearing"):
        along = measure(support, [effect], seed=2)
        H = measured_response(STRUCTURE, condition(support), [effect], along.frequency_hz, [2, 5], plane=2)
        channels = (*along.channels, Channel(2, "z"), Channel(5, "z"))
        std = np.hstack([along.std, np.maximum(NOISE * np.abs(H), 1e-6 * np.abs(along.H).max())])  # type: ignore[list-item]
        runs.append(replace(along, H=np.hstack([along.H, H]), channels=channels, std=std))
    found = diagnose(campaign_of(*runs), exclude=all_but(*RIVALS, effect.id)).diagnosis
    assert (found.verdict, found.causes[0].effects) == ("cause", (effect.id,))
    assert inside(found.causes[0].parameters["angle"], effect.angle)
    assert not [finding for finding in found.audit if finding.check == "channels" and finding.severity != "ok"]


@pytest.mark.parametrize("unit", [1e6, pytest.param(1e-6, marks=pytest.mark.long)])
def test_an_arbitrary_unit_may_be_any(unit):
    runs = [
        replace(run, H=unit * run.H, std=unit * run.std, quantity="acceleration")
        for run in both_supports(AttachedMass(mass=0.2, node=3))
    ]
    found = diagnose(campaign_of(*runs), exclude=all_but("attached_mass")).diagnosis
    assert found.verdict == "cause"
    assert found.causes[0].k_b is not None
    assert_allclose(found.causes[0].k_b.value, K_B, rtol=0.01)


@pytest.mark.parametrize("effects", [(), (AttachedMass(mass=0.05, node=3),)])
@pytest.mark.parametrize("told", [True, pytest.param(False, marks=pytest.mark.long)])
def test_lines_far_apart_hide_no_gap_and_make_none(effects, told):
    """A smooth curve does not follow resonances between lines 20 Hz apart; what it leaves is no noise."""
    hz = np.arange(20.0, 401.0, 20.0)
    runs = both_supports(*effects, frequency_hz=hz, channels=(Channel(2), Channel(4)))
    runs = runs if told else tuple(replace(run, std=None) for run in runs)
    found = diagnose(campaign_of(*runs), exclude=(*all_but("attached_mass"), "coarse_grid")).diagnosis
    assert (found.verdict == "no_gap") == (not effects)


@pytest.mark.parametrize("n", [2, 3, 5, 9, 10, 12, 280])
def test_of_any_run_of_some_lines_some_are_held_out(n):
    held = _held_out(n)
    assert len(held) == n
    assert 0.2 * n <= held.sum() <= 0.6 * n


def test_runs_in_other_units_count_alike():
    """A run in m/N is as much of the gap as one in (m/s^2)/N."""
    problem = problem_of(*both_supports(MASS))
    masks = [np.ones(len(run.frequency_hz), dtype=bool) for run in problem.runs]
    made = problem.predict(recalibrate(problem))
    alike, *_ = _figures(problem, masks, made, made, 1.0)
    units = (1.0, 1e-7)
    pairs = list(zip(problem.observed, units, strict=True))
    small: Any = SimpleNamespace(
        observed=[replace(o, run=replace(o.run, H=s * o.run.H), std=s * o.std) for o, s in pairs]
    )
    scaled = [s * H for s, H in zip(units, made, strict=True)]
    assert _figures(small, masks, scaled, scaled, 1.0)[0] == pytest.approx(alike)


def test_a_raster_that_is_too_coarse_is_named_in_its_own_words():
    runs = both_supports(frequency_hz=np.arange(20.0, 401.0, 2.0), channels=(Channel(2), Channel(4)))
    found = diagnose(
        campaign_of(*runs), exclude=[name for name in EFFECTS if name not in ("attached_mass", "coarse_grid")]
    )
    assert found.diagnosis.causes[0].effects == ("coarse_grid",)
    assert found.diagnosis.causes[0].k_b == found.diagnosis.nominal["k_b"]
    assert found.diagnosis.verdict == "cause"
    assert "agree line by line" in found.diagnosis.sentence


def test_lines_missing_from_a_fine_raster_are_no_cause():
    runs = [_without_peaks(run) for run in both_supports(channels=(Channel(2), Channel(4)))]
    found = diagnose(
        campaign_of(*runs), exclude=[name for name in EFFECTS if name not in ("attached_mass", "coarse_grid")]
    ).diagnosis
    assert found.verdict == "no_gap"
    few = [f for f in found.audit if f.check == "raster" and f.value is not None and f.value < f.limit]
    assert {f.severity for f in few} == {"note"}


def _without_peaks(run):
    """A run without the lines next to each of its resonances."""
    widths = [(r.frequency_hz, r.half_power_hz) for r in CheckedRun(run, "").resonances]
    keep = np.all([np.abs(run.frequency_hz - f) > 0.4 * width for f, width in widths], axis=0)
    return replace(run, frequency_hz=run.frequency_hz[keep], H=run.H[keep], std=run.std[keep])


def test_one_coarse_run_among_finer_ones_is_no_cause():
    settings = {"channels": (Channel(2), Channel(4))}
    coarse = measure("bearing", seed=7, frequency_hz=np.arange(20.0, 401.0, 2.0), **settings)
    found = diagnose(
        campaign_of(*both_supports(**settings), coarse),
        exclude=[name for name in EFFECTS if name not in ("attached_mass", "coarse_grid")],
    ).diagnosis
    assert found.verdict == "no_gap"
    assert coarse.name in {f.run for f in found.audit if f.check == "raster" and f.severity == "warning"}


OWN_GAINS = np.exp(0.01 * np.random.default_rng(5).standard_normal((2, 7)))


def mounted_anew(*effects):
    """A rigid run and one on bearings, between which every sensor's gain changes by nobody knows how much."""
    supports = zip(("rigid", "bearing"), OWN_GAINS, strict=True)
    runs = [measure(support, effects, seed=k, gain=gain) for k, (support, gain) in enumerate(supports)]
    return replace(campaign_of(*runs), nominal=replace(BELIEF, gain_repeatability=None))


def test_sensors_that_were_mounted_anew_are_no_gap():
    diagnosis = diagnose(mounted_anew(), exclude=all_but(*RIVALS)).diagnosis
    assert diagnosis.verdict == "no_gap"
    (found,) = (f for f in diagnosis.audit if "differ from run to run" in f.words)
    assert found.check == "repeatability"
    apart = np.log(OWN_GAINS[1] / OWN_GAINS[0])
    assert_allclose(found.value, np.std(apart) / 2, rtol=0.4)  # what both runs share is the sensor's


@pytest.mark.long
def test_sensors_that_were_mounted_anew_do_not_hide_a_cause():
    diagnosis = diagnose(mounted_anew(MASS), exclude=all_but(*RIVALS)).diagnosis
    assert (diagnosis.verdict, diagnosis.causes[0].effects) == ("cause", ("attached_mass",))
    mass = diagnosis.causes[0].parameters["mass"]
    assert abs(mass.value - MASS.mass) < 4 * mass.std


def test_a_campaign_may_say_that_sensors_were_mounted_anew():
    told = replace(BELIEF, gain_repeatability=0.01)
    diagnosis = diagnose(replace(mounted_anew(), nominal=told), exclude=all_but(*RIVALS)).diagnosis
    assert diagnosis.verdict == "no_gap"
    assert not [f for f in diagnosis.audit if "differ from run to run" in f.words]


@pytest.mark.long
def test_a_sensor_beside_its_node_is_not_passed_off_as_one_mounted_anew():
    effect = SensorPosition(offset=1e-3, node=3)
    diagnosis = diagnose(campaign_of(*both_supports(effect)), exclude=all_but("sensor_position", *RIVALS)).diagnosis
    assert (diagnosis.verdict, diagnosis.causes[0].effects) == ("cause", ("sensor_position",))
    assert not [f for f in diagnosis.audit if "differ from run to run" in f.words]


# -- single lines ---------------------------------------------------------------------------------------

# A hum of three lines, which lie too close to each other to be wild.
HUM = np.array([49.5, 50.0, 50.5])


def humming(*effects, at=HUM):
    """Both supports, with what is read at three frequencies besides the rotor."""
    runs = []
    for seed, support in enumerate(("rigid", "bearing")):
        run = measure(support, effects, frequency_hz=np.unique(np.r_[lines(support), at]), seed=seed)
        hum = 0.3 * np.median(np.abs(run.H)) * np.isin(run.frequency_hz, at)
        runs.append(replace(run, H=run.H + hum[:, None]))
    return runs


def test_lines_that_nothing_but_hum_keeps_from_the_model_are_left_out_and_said():
    diagnosis = diagnose(campaign_of(*humming()), exclude=all_but(*RIVALS)).diagnosis
    assert diagnosis.verdict == "no_gap"
    assert [f.value for f in diagnosis.audit if "49.5, 50, 50.5 Hz" in f.words] == [3, 3]
    assert "in the lines that were used" in diagnosis.sentence


@pytest.mark.long
@pytest.mark.parametrize("mass", [0.1, 0.02])
def test_a_cause_beside_a_hum_is_no_odd_line(mass):
    campaign = campaign_of(*humming(AttachedMass(mass=mass, node=3)))
    diagnosis = diagnose(campaign, exclude=all_but(*RIVALS)).diagnosis
    assert diagnosis.verdict != "no_gap"
    assert not [f for f in diagnosis.audit if "far from any resonance" in f.words]


def test_a_line_beside_a_resonance_is_never_odd():
    """There a gap may show on few lines."""
    peak = problem_of(measure("rigid")).modals(K_B, ())[0].frequencies_hz[0]
    for at, odd in ((peak * 1.005, 0), (peak * 1.5, 1)):
        problem = problem_of(*humming(at=np.array([at])))
        assert odd_lines(problem, recalibrate(problem))[0].sum() == odd


# -- errors that channels share -------------------------------------------------------------------------


def sharing(run, common):
    """A problem that takes part of a run's errors for shared ones."""
    return problem_of(run).on([observe(run, run.std, common)])


@pytest.mark.parametrize("magnitude", [False, True])
def test_errors_that_channels_do_not_share_are_no_shared_ones(magnitude):
    run = measure("bearing")
    run = replace(run, H=np.abs(run.H), magnitude_only=True) if magnitude else run
    problem = sharing(run, 0.9 * NOISE)
    less = not_shared(problem, recalibrate(problem))
    assert less
    assert less.observed[0].common == 0


def test_errors_that_channels_share_stay_shared_ones():
    run, rng = measure("bearing", noise=1e-3), np.random.default_rng(2)
    force = rng.standard_normal((len(run.H), 1)) + 1j * rng.standard_normal((len(run.H), 1))
    H = run.H * (1 + NOISE / np.sqrt(2) * force)
    problem = sharing(replace(run, H=H, std=NOISE * np.abs(run.H)), 0.95 * NOISE)
    assert not_shared(problem, recalibrate(problem)) is None
    assert not_shared(sharing(run, 0.0), recalibrate(sharing(run, 0.0))) is None


@pytest.mark.long
def test_what_a_fast_sweep_still_rings_with_is_no_noise_of_the_force():
    """All channels ring alike, so that near a line it looks like it; what the fit leaves tells."""
    belief, effect = replace(BELIEF, shaft_damping_ratio=0.0019), FastSweep(dwell=0.47)
    rng, near = np.random.default_rng(1), np.array([0, 0.3, 0.6, 1, 1.4, 2, 3, 4, 6, 8, 12, 16, 22, 30])
    peaks = [f * (1 + 0.0019 * sign * near) for f in (100.5, 323.5) for sign in (-1, 1)]
    frequency_hz = np.unique(np.round(np.r_[np.linspace(20, 400, 190) + rng.uniform(-0.5, 0.5, 190), *peaks], 6))
    run = blank("rigid", frequency_hz, sweep="up")
    run = with_noise(run, Forward(workshop(belief)).modal(run, K_B, [effect]).response(), 1)
    assert common_error(run) > NOISE
    campaign = replace(campaign_of(run), nominal=belief)
    found = diagnose(campaign, exclude=all_but("fast_sweep", *RIVALS)).diagnosis
    assert (found.verdict, found.causes[0].effects) == ("cause", ("fast_sweep",))
    assert_allclose(found.causes[0].parameters["dwell"].value, effect.dwell, rtol=1e-4)


@pytest.mark.parametrize("stated", [0.01, None], ids=["stated", "not stated"])
def test_responses_without_any_noise_show_no_gap(stated):
    """What the model's own mesh and modes leave of a computed response is no gap, whatever errors are stated."""
    computed = (replace(run, H=truth(run)) for run in (blank(s, lines(s), name=s) for s in ("rigid", "bearing")))
    runs = [replace(run, std=None if stated is None else stated * np.abs(run.H)) for run in computed]
    diagnosis = diagnose(campaign_of(*runs), exclude=all_but(*RIVALS)).diagnosis
    assert diagnosis.verdict == "no_gap"
    assert diagnosis.nominal["k_b"].value == pytest.approx(K_B, rel=1e-3)
