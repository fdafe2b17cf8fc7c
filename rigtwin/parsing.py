"""TOML and JSON that people and other programs write: whatever is wrong with it is a ValueError in a sentence."""

from __future__ import annotations

import json
import math
import tomllib
from typing import Any


def parse_toml(text: str) -> dict[str, Any]:
    """Tables of a TOML document. Raises ValueError."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not valid TOML: {_reason(error)}") from error


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
