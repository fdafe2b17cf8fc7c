"""TOML and JSON that people and other programs write: whatever is wrong with it is a ValueError in a sentence."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from typing import Any


def parse_toml(text: str) -> dict[str, Any]:
    """Tables of a TOML document. Raises ValueError."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not valid TOML: {_reason(error)}") from error


def toml_value(value: Any) -> str:
    """A value as TOML has it.

    >>> toml_value({"node2": ["CH 2 Ω", True, 1e-4]})
    '{"node2" = ["CH 2 Ω", true, 0.0001]}'
    """
    plain = value.item() if hasattr(value, "item") else value
    if isinstance(plain, Mapping):
        return "{" + ", ".join(f"{toml_value(str(key))} = {toml_value(each)}" for key, each in plain.items()) + "}"
    if isinstance(plain, list | tuple):
        return "[" + ", ".join(map(toml_value, plain)) + "]"
    # A JSON string, number or truth value is one of TOML too, but for DEL, which TOML wants escaped.
    return json.dumps(plain, ensure_ascii=False, default=str).replace("\x7f", "\\u007f")


def toml_lines(table: Mapping[str, Any]) -> list[str]:
    """The keys of a table, a line each; what is None is left out, as TOML has no null."""
    return [f"{key} = {toml_value(value)}" for key, value in table.items() if value is not None]


def parse_json(text: str) -> Any:
    """Value of a JSON document, all of whose numbers are finite. Raises ValueError."""
    try:
        return json.loads(text, parse_float=_finite, parse_constant=_finite)
    except json.JSONDecodeError as error:
        raise ValueError(f"line {error.lineno}: not valid JSON ({error.msg})") from error
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not valid JSON ({_reason(error)})") from error


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    return "a whole number in it has thousands of digits" if "integer string" in str(error) else str(error)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is not a finite number")
    return value
