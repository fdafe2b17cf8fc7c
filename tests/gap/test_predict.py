"""What a diagnosis predicts for a run that it never saw."""

from __future__ import annotations

import copy
import json
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.gap.document import DAMPING, SCHEMA, Diagnosis, DocumentError
from rigtwin.gap.predict import corrected_rotor as corrected_rotor_of
from rigtwin.gap.predict import predict as predict_runs
from rigtwin.rotor.effects import AttachedMass
from rigtwin.sim.campaign import Channel, MeasurementError, NominalBelief
from tests.gap.conftest import K_B, MASS, blank, campaign_of, lines, truth

SENSORS = (Channel(2), Channel(4), Channel(6))


@pytest.fixture(scope="module")
def document(weighed):
    return json.loads(weighed.diagnosis.to_json())


def by_hand(verdict="cause", **changes):
    """A document with the least that a prediction needs."""
    cause = {
        "effects": ["attached_mass"],
        "parameters": {"attached_mass.mass": {"value": 0.1, "std": 0.001}},
        "places": {"attached_mass.node": 3},
        "k_b": {"value": 2e6, "std": 1e3},
    }
    nominal = {"k_b": {"value": 1.9e6}}
    return {"schema": SCHEMA, "verdict": verdict, "nominal": nominal, "causes": [cause]} | changes


def predict(document, campaign):
    return predict_runs(Diagnosis.from_document(document), campaign)


def corrected_rotor(document):
    return corrected_rotor_of(Diagnosis.from_document(document))


def elsewhere(support="bearing"):
    """A run with the shaker at another node; of its values nothing is known."""
    return blank(support, lines(support, [MASS]), excitation_node=4, channels=SENSORS)


def error(H, expected):
    return np.linalg.norm(H - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize("support", ["rigid", "bearing"])
def test_the_corrected_model_is_nearer_to_a_run_it_never_saw(document, support):
    run = elsewhere(support)
    (predicted,) = predict(document, campaign_of(run))
    expected = truth(run, [MASS])
    assert predicted.run is run
    assert error(predicted.corrected.H, expected) < 0.05
    assert error(predicted.nominal.H, expected) > 0.2


def test_predictions_keep_the_run_s_lines_and_channels(document):
    run = elsewhere()
    (predicted,) = predict(document, campaign_of(run))
    for made in (predicted.nominal, predicted.corrected):
        assert made.channels == run.channels
        assert made.excitation_node == 4
        assert np.array_equal(made.frequency_hz, run.frequency_hz)
        assert made.std is None


def test_values_of_the_run_are_not_used():
    run = elsewhere()
    loud = blank("bearing", run.frequency_hz, excitation_node=4, channels=run.channels)
    loud.H[:] = 1e3
    (a,), (b,) = predict(by_hand(), campaign_of(run)), predict(by_hand(), campaign_of(loud))
    assert np.array_equal(a.corrected.H, b.corrected.H)


def test_a_document_by_hand_gives_the_rotor_itself():
    run = elsewhere()
    (predicted,) = predict(by_hand(), campaign_of(run))
    assert error(predicted.corrected.H, truth(run, [MASS])) < 1e-4
    assert error(predicted.nominal.H, truth(run, k_b=1.9e6)) < 1e-4


def test_what_was_calibrated_is_put_in():
    run = elsewhere()
    (plain,) = predict(by_hand(), campaign_of(run))
    (calibrated,) = predict(by_hand(calibration={"sensor_gain": {"node4": 1.1}}), campaign_of(run))
    assert np.allclose(calibrated.corrected.H / plain.corrected.H, [1.0, 1.1, 1.0])
    (stiffer,) = predict(by_hand(calibration={"tolerance": {"modulus": 1e-3}}), campaign_of(run))
    assert error(stiffer.corrected.H, plain.corrected.H) > 0.01
    assert np.array_equal(stiffer.nominal.H, plain.nominal.H)


def test_a_cause_without_effects_is_gains_and_tolerances_alone():
    run = elsewhere()
    alone = {"effects": [], "parameters": {}, "places": {}, "k_b": {"value": 1.9e6}}
    calibration = {"sensor_gain": {"node4": 1.1}}
    (predicted,) = predict(by_hand(causes=[alone], calibration=calibration), campaign_of(run))
    assert np.allclose(predicted.corrected.H / predicted.nominal.H, [1.0, 1.1, 1.0])


def test_magnitudes_are_predicted_as_magnitudes():
    run = blank("bearing", lines("bearing"), magnitude_only=True)
    (predicted,) = predict(by_hand(), campaign_of(run))
    assert np.isrealobj(predicted.corrected.H)
    assert (predicted.corrected.H >= 0).all()


@pytest.mark.parametrize("verdict", ["no_gap", "unknown", "not_enough_data"])
def test_without_a_cause_nothing_is_corrected(verdict):
    assert corrected_rotor(by_hand(verdict)) == ((), 1.9e6)
    assert corrected_rotor(by_hand(causes=[])) == ((), 1.9e6)


@pytest.mark.parametrize("verdict", ["no_gap", "unknown"])
def test_without_a_cause_gains_that_were_fitted_are_no_correction(verdict):
    strained = {"sensor_gain": {"node4": 1.1}, "tolerance": {"modulus": 1e-3}}
    document = by_hand(verdict, calibration=strained)
    document["nominal"]["calibration"] = strained
    (predicted,) = predict(document, campaign_of(elsewhere()))
    assert np.array_equal(predicted.corrected.H, predicted.nominal.H)


def test_damping_is_what_the_diagnosis_believed():
    """A campaign that says nothing of the damping is that of the same rig."""
    run = elsewhere()
    silent = replace(campaign_of(run), nominal=NominalBelief())
    told = by_hand()
    told["nominal"] |= {key: getattr(campaign_of(run).nominal, key) for key in DAMPING}
    (predicted,) = predict(told, silent)
    assert error(predicted.corrected.H, truth(run, [MASS])) < 1e-4
    (predicted,) = predict(by_hand(), silent)
    assert error(predicted.corrected.H, truth(run, [MASS])) > 0.05


def test_a_cause_is_put_together_again():
    assert corrected_rotor(by_hand()) == ((AttachedMass(mass=0.1, node=3),), K_B)
    without = by_hand()
    without["causes"][0]["k_b"] = None
    assert corrected_rotor(without)[1] == 1.9e6


def damaged(*keys, to=None):
    """A document in which an entry is gone, or is something else."""
    document = copy.deepcopy(by_hand())
    inner = document
    for key in keys[:-1]:
        inner = inner[key]
    if to is None:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = to
    return document


@pytest.mark.parametrize(
    "document",
    [
        {},
        {"schema": "rigtwin.diagnosis/2"},
        damaged("verdict"),
        damaged("nominal"),
        damaged("nominal", to="none"),
        damaged("causes"),
        damaged("causes", 0, "parameters"),
        damaged("causes", 0, "places"),
        damaged("causes", 0, "k_b"),
        damaged("causes", 0, "effects", to=["flux_capacitor"]),
        damaged("causes", 0, "parameters", to={"attached_mass.weight": {"value": 1.0}}),
        damaged("causes", 0, "parameters", to={"attached_mass.mass": {"value": -1.0}}),
        damaged("causes", 0, "parameters", to={"attached_mass.mass": {"value": "heavy"}}),
        damaged("causes", 0, "parameters", to={"attached_mass.mass": {}}),
        damaged("causes", 0, "places", to={"attached_mass.node": 0}),
        damaged("causes", 0, "places", to={"attached_mass.node": 9}),
        damaged("causes", 0, "k_b", to={"value": -1.0}),
        damaged("causes", 0, "k_b", to=2e6),
        damaged("nominal", "k_b", to={"value": None}) | {"calibration": {}},
        by_hand(calibration=[1.0]),
        by_hand(calibration={"tolerance": {"modulus": "large"}}),
    ],
)
def test_a_damaged_document_is_refused(document):
    with pytest.raises((MeasurementError, DocumentError), match="diagnos"):
        predict(document, campaign_of(elsewhere()))


def test_places_may_be_told_by_locations_alone(weighed):
    document = json.loads(weighed.diagnosis.to_json())
    for keys in (("places",), ("places", "locations")):
        bare = json.loads(weighed.diagnosis.to_json())
        for cause in bare["causes"]:
            for key in keys:
                cause.pop(key)
        assert corrected_rotor(bare) == corrected_rotor(document)
    ((mass,), _) = corrected_rotor(document)
    assert isinstance(mass, AttachedMass)
    assert mass.node == MASS.node == 3


def test_what_is_wrong_with_the_campaign_is_not_blamed_on_the_diagnosis(weighed):
    run = blank("bearing", lines("bearing"), channels=(Channel(9),))
    with pytest.raises(MeasurementError, match=r"^(?!diagnosis).*9"):
        predict(json.loads(weighed.diagnosis.to_json()), campaign_of(run))
