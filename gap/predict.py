"""What a diagnosis predicts for runs that it never saw."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigtwin.gap.document import DAMPING, SCHEMA
from rigtwin.gap.model.forward import acting, nonlinear
from rigtwin.gap.model.linear import TOLERANCES
from rigtwin.gap.model.motions import FINAL
from rigtwin.gap.prepare import forward_of
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import ComplexArray, FloatArray
from rigtwin.sim.campaign import Campaign, MeasurementError, Run


@dataclass(frozen=True)
class Predicted:
    """A run as the nominal and as the corrected model predict it, on its own lines."""

    run: Run
    nominal: Run
    corrected: Run


def predict(document: Mapping[str, Any], campaign: Campaign) -> tuple[Predicted, ...]:
    """Predict every run of a campaign.

    Parameters
    ----------
    document : the contents of a diagnosis.json
    campaign : any campaign of the same rig; of its data only the lines and channels are used, and of what it believes
        only what the diagnosis does not say

    Raises
    ------
    MeasurementError : the document is not a diagnosis, or does not hold what is needed
    """
    if document.get("schema") != SCHEMA:
        raise MeasurementError(f"diagnosis: schema is {document.get('schema')!r}, expected {SCHEMA!r}; diagnose again")
    damaged = "the file is damaged or of another rig, diagnose again"
    try:
        told = _told(document)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise MeasurementError(f"diagnosis: {error}; {damaged}") from error
    try:
        return tuple(_predict(told, campaign))
    except MeasurementError:  # of the campaign
        raise
    except ValueError as error:  # effects that do not go with its rotor
        raise MeasurementError(f"diagnosis: {error}; {damaged}") from error


@dataclass(frozen=True)
class _Told:
    """What a document says of the rig."""

    nominal_k_b: float  # [N/m]
    k_b: float  # of the corrected model [N/m]
    effects: tuple[Effect, ...]
    damping: Mapping[str, float]
    tolerance: FloatArray  # (len(TOLERANCES),)
    sensor_gain: Mapping[str, float]  # by channel


def _told(document: Mapping[str, Any]) -> _Told:
    effects, k_b = corrected_rotor(document)
    calibration = (document.get("calibration") if explains(document) else None) or {}
    return _Told(
        nominal_k_b=Condition(k_b=_nominal_k_b(document)).k_b,  # which refuses what is no stiffness
        k_b=Condition(k_b=float(k_b)).k_b,
        effects=effects,
        damping={key: float(value) for key in DAMPING if (value := document["nominal"].get(key)) is not None},
        tolerance=np.array([float(calibration.get("tolerance", {}).get(name, 0.0)) for name in TOLERANCES]),
        sensor_gain={channel: float(gain) for channel, gain in calibration.get("sensor_gain", {}).items()},
    )


def _predict(told: _Told, campaign: Campaign) -> Iterator[Predicted]:
    forward = forward_of(replace(campaign, nominal=replace(campaign.nominal, **told.damping)))
    forward = forward.made(refined=True, resolution=FINAL, with_data=False)
    forward.allow_for_tolerances(load_rig(campaign.rig), campaign.runs, told.k_b)
    for run in campaign.runs:
        before = forward.modal(run, told.nominal_k_b).response()
        there = acting(told.effects, run.support)
        if not nonlinear(there):
            forward.bend(run, told.k_b, there)
        after = forward.modal(run, told.k_b, there)
        gains = np.array([told.sensor_gain.get(str(channel), 1.0) for channel in run.channels])
        yield Predicted(run, _with(run, before), _with(run, after.response(None, told.tolerance) * gains))


def _nominal_k_b(document: Mapping[str, Any]) -> float:
    """Bearing stiffness [N/m] of the nominal model; the default where the diagnosis does not know it."""
    return float((document["nominal"].get("k_b") or {}).get("value", Condition.k_b))


def corrected_rotor(document: Mapping[str, Any]) -> tuple[tuple[Effect, ...], float]:
    """Effects and bearing stiffness [N/m] of the corrected model; no effect where none is named."""
    nominal = _nominal_k_b(document)
    if not explains(document):
        return (), nominal
    cause = document["causes"][0]
    places = cause["places"] if "places" in cause else _by_location(cause)
    effects = []
    for name in cause["effects"]:
        values = _of_effect(cause["parameters"], name, alone=len(cause["effects"]) == 1)
        values = {key: entry["value"] for key, entry in values.items()} | _of_effect(places, name, alone=False)
        if "node" in values:
            values["node"] = int(values["node"])
        effects.append(EFFECTS[name](**values))
    return tuple(effects), (cause["k_b"] or {}).get("value", nominal)


def _by_location(cause: Mapping[str, Any]) -> dict[str, Any]:
    """Places of the effects where only locations are told."""
    located = zip(cause["effects"], cause.get("locations") or [cause["location"]], strict=False)
    numbers = [(name, {"node": spot.get("node"), "position": spot.get("x_m")}) for name, spot in located]
    return {
        f"{name}.{key}": value
        for name, values in numbers
        for key, value in values.items()
        if value is not None and key in EFFECTS[name].roles()
    }


def explains(document: Mapping[str, Any]) -> bool:
    """Whether a diagnosis names a cause, so that the corrected model is another than the nominal one."""
    return document["verdict"] in ("cause", "ambiguous") and bool(document["causes"])


def _of_effect(table: Mapping[str, Any], effect: str, *, alone: bool) -> dict[str, Any]:
    """Entries of one effect, by plain name; of a single effect the names are plain already."""
    prefix = f"{effect}."
    return {
        key.removeprefix(prefix): v for key, v in table.items() if key.startswith(prefix) or (alone and "." not in key)
    }


def _with(run: Run, H: ComplexArray) -> Run:
    values = run.as_recorded(H)
    return replace(run, H=values, std=None, harmonics={})
