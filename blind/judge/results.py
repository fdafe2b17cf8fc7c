"""Judged campaigns as rows of JSON, so that the page can be written again without a campaign."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from rigtwin.blind.judge.score import Label, Outcome, Shrink, label_from

_IN_LABEL = (
    "campaign", "set", "split", "effects", "exclude", "size", "size_ratio", "k_b", "sensors", "levels",
    "rejected_draws", "not_periodic_draws", "source", "rotor", "nodes_m", "bearings", "drive_node", "drift",
    "n_effects",
)  # fmt: skip
_FLOATS = {"k_b_error", "k_b_error_nominal", "k_b_miss", "seconds", "processor_seconds", "probability", "unknown_score"}


def to_row(outcome: Outcome) -> dict[str, Any]:
    """JSON of one judged campaign; numbers that are not there are null."""
    fields = {f.name: getattr(outcome, f.name) for f in dataclasses.fields(outcome) if f.name != "label"}
    return {"label": _label(outcome.label), **{name: _plain(value) for name, value in fields.items()}}


def from_row(row: Mapping[str, Any]) -> Outcome:
    values = {key: _number(key, value) for key, value in row.items() if key != "label"}
    values |= {key: _shrink(row.get(key)) for key in ("shrink", "control", "no_effect")}
    values["top"] = frozenset(row["top"])
    values["answered"] = tuple(frozenset(names) for names in row["answered"])
    values["parameters_inside"] = tuple(row["parameters_inside"])
    values["parameter_errors"] = tuple(row["parameter_errors"])
    return Outcome(label=label_from(row["label"]), **values)


def _label(label: Label) -> dict[str, Any]:
    return {key: label.table[key] for key in _IN_LABEL if key in label.table}


def _number(key: str, value: Any) -> Any:
    return math.nan if value is None and key in _FLOATS else value


def _shrink(table: Mapping[str, Any] | None) -> Shrink | None:
    return None if table is None else Shrink(**{k: math.nan if v is None else v for k, v in table.items()})


def _plain(value: Any) -> Any:
    if isinstance(value, Shrink):
        return {key: _plain(v) for key, v in vars(value).items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, frozenset):
        return sorted(value)
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return value
