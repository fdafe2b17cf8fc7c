"""What a diagnosis predicts for runs that took no part in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.gap.document import DAMPING, Calibration, Cause, Diagnosis
from rigtwin.gap.model.campaign_model import forward_of
from rigtwin.gap.model.forward import acting
from rigtwin.gap.model.motions import FINAL
from rigtwin.gap.model.workshop import TOLERANCE_KEYS
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.effects.structure import MeasuredJoint
from rigtwin.rotor.model.arrays import ComplexArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.campaign import Campaign, MeasurementError, Run


@dataclass(frozen=True)
class Predicted:
    """A run as the nominal and as the corrected model predict it, on its own lines."""

    run: Run
    nominal: Run
    corrected: Run


def predict(diagnosis: Diagnosis, campaign: Campaign) -> tuple[Predicted, ...]:
    """Predict every run of a campaign.

    Parameters
    ----------
    diagnosis : of another campaign of the same rig, as ``Diagnosis.from_json`` reads it
    campaign : of its data only the lines and channels are used, and of what it believes only what the diagnosis does
        not say

    Raises
    ------
    MeasurementError : the diagnosis names effects that do not exist, or that do not go with the campaign's rotor
    """
    damaged = "the file is damaged or of another rig, diagnose again"
    try:
        models = _models(diagnosis)
        return tuple(_predict(models, campaign))
    except MeasurementError:  # of the campaign
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise MeasurementError(f"diagnosis: {error}; {damaged}") from error


@dataclass(frozen=True)
class _Models:
    """The nominal and the corrected model, as a diagnosis gives them."""

    nominal_k_b: float  # [N/m]
    k_b: float  # of the corrected model [N/m]
    effects: tuple[Effect, ...]
    damping: Mapping[str, float]
    nominal_tolerance: Mapping[str, float]  # by its name, of the nominal model
    tolerance: Mapping[str, float]  # of the corrected model
    sensor_gain: Mapping[str, float]  # by channel


def _models(diagnosis: Diagnosis) -> _Models:
    effects, k_b = corrected_rotor(diagnosis)
    nominal = diagnosis.nominal.get("calibration", Calibration())
    calibration = diagnosis.calibration if diagnosis.names_a_cause else replace(nominal, sensor_gain={})
    if diagnosis.correction:
        calibration = diagnosis.correction.calibration
    return _Models(
        nominal_k_b=Condition(k_b=_nominal_k_b(diagnosis)).k_b,  # which refuses what is no stiffness
        k_b=Condition(k_b=k_b).k_b,
        effects=effects,
        damping={key: float(value) for key in DAMPING if (value := diagnosis.nominal.get(key)) is not None},
        nominal_tolerance=nominal.tolerance,
        tolerance=calibration.tolerance,
        sensor_gain=calibration.sensor_gain,
    )


def _predict(models: _Models, campaign: Campaign) -> Iterator[Predicted]:
    belief = replace(campaign.nominal, **models.damping, **dict.fromkeys(TOLERANCE_KEYS, 1.0))  # every number may move
    forward = forward_of(replace(campaign, nominal=belief))
    forward = forward.made(refined=True, resolution=FINAL, with_data=False)
    names = forward.workshop.names
    nominal, corrected = (
        forward.at(np.array([values.get(name, 0.0) for name in names]))
        for values in (models.nominal_tolerance, models.tolerance)
    )
    for run in campaign.runs:
        before = nominal.modal(run, models.nominal_k_b).response()
        after = corrected.modal(run, models.k_b, acting(models.effects, run.support)).response()
        gains = np.array([models.sensor_gain.get(str(channel), 1.0) for channel in run.channels])
        yield Predicted(run, _with(run, before), _with(run, after * gains))


def _nominal_k_b(diagnosis: Diagnosis) -> float:
    """Bearing stiffness [N/m] of the nominal model; the default where the diagnosis does not know it."""
    known = diagnosis.nominal.get("k_b")
    return Condition.k_b if known is None else known.value


def corrected_rotor(diagnosis: Diagnosis) -> tuple[tuple[Effect, ...], float]:
    """Effects and bearing stiffness [N/m] of the corrected model; no effect where none is named and no joint fitted."""
    nominal = _nominal_k_b(diagnosis)
    if joint := diagnosis.correction:
        values = {name: estimate.value for name, estimate in joint.parameters.items()}
        effect = MeasuredJoint(**values, node=0 if joint.at_exciter else joint.node)
        return (effect,), nominal if joint.k_b is None else joint.k_b.value
    if not diagnosis.names_a_cause:
        return (), nominal
    cause = diagnosis.causes[0]
    values = {name: estimate.value for name, estimate in cause.parameters.items()}
    places = cause.places or _by_location(cause)
    alone = len(cause.effects) == 1
    effects = [_effect(name, _of(name, values, alone=alone) | _of(name, places, alone=False)) for name in cause.effects]
    return tuple(effects), nominal if cause.k_b is None else cause.k_b.value


def _effect(name: str, values: Mapping[str, float]) -> Effect:
    """An effect with its numbers. Raises KeyError, TypeError and ValueError where there is no such effect."""
    kind = EFFECTS[name]
    nodes = {place for place, role in kind.places().items() if role.kind == "node"}
    return kind(**{key: int(value) if key in nodes else value for key, value in values.items()})


def _by_location(cause: Cause) -> dict[str, float]:
    """Places of the effects of a cause that gives only locations."""
    located = zip(cause.effects, cause.locations or (cause.location,), strict=False)
    spots = [(name, {"node": spot.node, "position": spot.x_m}) for name, spot in located]
    return {
        f"{name}.{place}": value
        for name, by_kind in spots
        for place, role in EFFECTS[name].places().items()
        if (value := by_kind[role.kind]) is not None
    }


def _of(effect: str, table: Mapping[str, float], *, alone: bool) -> dict[str, float]:
    """Entries of one effect by the parameter's own name, which is all that a single effect needs."""
    prefix = f"{effect}."
    return {
        key.removeprefix(prefix): v for key, v in table.items() if key.startswith(prefix) or (alone and "." not in key)
    }


def _with(run: Run, H: ComplexArray) -> Run:
    values = run.as_recorded(H)
    return replace(run, H=values, std=None, harmonics={})
