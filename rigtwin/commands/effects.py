"""``rigtwin effects``: the effect library, for a reader and for a machine."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from typing import Any

from rigtwin.api.rigs import effect_of
from rigtwin.console import print_json, say, table
from rigtwin.rotor.effects import EFFECTS, Effect, Parameter, Place
from rigtwin.rotor.effects.scale import in_own_units
from rigtwin.wording import number, unit

# Where an effect may sit, by its ``location``.
LOCATIONS = {
    "node": "a node",
    "position": "any position along the shaft",
    "shaft": "the whole shaft",
    "disks": "every disk",
    "joints": "every joint of the rig file whose sections can turn against each other",
    "bearings": "every bearing; nothing on rigid supports",
    "rigid_support": "every rigid support in place of a bearing; nothing on bearings",
    "exciter": "the exciter, at the drive node",
    "sensor": "a sensor",
    "raster": "the way the test steps through its frequencies",
}

NO_CANDIDATE = "never named as a cause; it is fitted where the cause is unknown"


# -- for a machine -------------------------------------------------------------------------------


def record(effect: type[Effect]) -> dict[str, Any]:
    """All there is to say about an effect, in JSON types."""
    return {
        "id": effect.id,
        "title": effect.title,
        "family": effect.family,
        "where": effect.location,
        "meaning": effect.meaning,
        "equation": effect.equation,
        "signature": effect.signature,
        "source": effect.source,
        "in_fmu": effect.in_fmu,
        "is_candidate": effect.is_candidate,
        "changes_size": effect.changes_size,
        "parameters": [_parameter(name, start, role) for name, start, role in parameters_of(effect)],
        "places": [{"name": name, "start": start, **asdict(role)} for name, start, role in places_of(effect)],
    }


def _parameter(name: str, start: float, role: Parameter) -> dict[str, Any]:
    return {
        "name": name,
        "unit": role.unit,
        "meaning": role.meaning,
        "start": start,
        "prior": {
            "low": role.low,
            "high": role.high,
            "in": in_own_units(role.unit),
            "even_in": "log" if role.log else "linear",
        },
        "zero": "infinity" if role.null == math.inf else role.null,
        "minimum": role.minimum,
        "maximum": role.maximum,
    }


def parameters_of(effect: type[Effect]) -> Iterator[tuple[str, float, Parameter]]:
    """Name, start value and role of every parameter."""
    return ((name, _starts(effect)[name], role) for name, role in effect.parameters().items())


def places_of(effect: type[Effect]) -> Iterator[tuple[str, float, Place]]:
    """Name, start value and role of every place."""
    return ((name, _starts(effect)[name], role) for name, role in effect.places().items())


def _starts(effect: type[Effect]) -> Mapping[str, Any]:
    return {f.name: f.default for f in fields(effect)}


# -- for a reader --------------------------------------------------------------------------------


def prior(role: Parameter) -> str:
    """'0.004 to 0.5 m_r, log': the prior range in the rig's own units, and where its logarithm is what is uniform."""
    return f"{number(role.low)} to {number(role.high)} {in_own_units(role.unit)}".rstrip() + (
        ", log" if role.log else ""
    )


def zero(role: Parameter) -> str:
    """The value that switches an effect off; empty where another parameter does."""
    if role.null is None:
        return ""
    return "as in the test" if isinstance(role.null, str) else number(role.null)


def print_effects(*, as_json: bool) -> None:
    """Print all effects, in the order of the library."""
    if as_json:
        print_json({"effects": [record(effect) for effect in EFFECTS.values()]})
        return
    for family in dict.fromkeys(effect.family for effect in EFFECTS.values()):
        rows = [row for effect in EFFECTS.values() if effect.family == family for row in _rows(effect)]
        table(("effect", "title", "where", *_PARAMETER_HEADER), rows, title=family)
    say("prior range: in units of the rig: m_r mass of the rotor, l_r its length, t_r 1/(2 pi f1) on rigid supports")
    say("log: uniform in the logarithm; no effect at: empty where another parameter switches the effect off")
    say("rigtwin effects ID: what it adds, how it shows, where it comes from")


_PARAMETER_HEADER = ("parameter", "start", "unit", "prior range", "no effect at")


def _rows(effect: type[Effect]) -> list[tuple[str, ...]]:
    """One row for each parameter; what is the effect's own stands in the first."""
    rows = []
    first = effect.id, effect.title, effect.location.replace("_", " ")
    for name, start, role in parameters_of(effect):
        rows.append((*first, name, number(start), unit(role.unit), prior(role), zero(role)))
        first = ("", "", "")
    return rows


def print_effect(effect_id: str, *, as_json: bool) -> None:
    """Print one effect. Raises UserError where there is none of this id."""
    effect = effect_of(effect_id)
    if as_json:
        print_json(record(effect))
        return
    say(f"{effect.id}: {effect.title}\n\n{effect.meaning}\n")
    facts = {
        "where": LOCATIONS[effect.location],
        "equation": effect.equation,
        "shows": effect.signature,
        "source": f"{effect.source} in docs/references.bib",
    }
    if not effect.is_candidate:
        facts["diagnosis"] = NO_CANDIDATE
    for name, text in facts.items():
        say(f"  {name:<10}{text}")
    rows = [
        (name, number(start), unit(role.unit), prior(role), zero(role), limits(role), role.meaning)
        for name, start, role in parameters_of(effect)
    ]
    rows += [
        (name, number(start), "m" if role.kind == "position" else "", "", "", "", role.meaning)
        for name, start, role in places_of(effect)
    ]
    table((*_PARAMETER_HEADER, "allowed range", "meaning"), rows)


def limits(role: Parameter) -> str:
    """'0 to 100': what is physically possible."""
    low = "−∞" if role.minimum is None else number(role.minimum)
    return f"{low} to {'∞' if role.maximum is None else number(role.maximum)}"
