"""Numbers as they are printed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from difflib import get_close_matches

_NO_BREAK = "\u00a0"
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:%|Hz|mm|MN/m|N)\b|%|±)|(?<=±) |(?<=N) (?=s/m)")

_UNITS = {"1": "", "N.s/m": "N s/m", "N/m3": "N/m³", "N.m/rad": "N m/rad", "kg.m": "kg m", "kg.m2": "kg m²"}

# A standard error below this share of its value is round-off, not noise, and is not printed.
_EXACT = 1e-8


def with_error(value: float, std: float) -> str:
    """'25.0 ± 2.1': the error with two significant digits, the value with as many decimals."""
    if not math.isfinite(value) or not std > _EXACT * abs(value):
        return f"{value:.7g}"
    if not math.isfinite(std):
        return f"{value:.7g} ± ?"
    decimals = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{decimals}f} ± {std:.{decimals}f}"


def stiffness(k_b: float) -> str:
    """'1.300', in MN/m."""
    return f"{k_b / 1e6:#.4g}" if math.isfinite(k_b) else "none"


def stiffness_with_error(k_b: float, std: float) -> str:
    """'1.302 ± 0.013', in MN/m."""
    return with_error(k_b / 1e6, std / 1e6)


def interval(low: float, high: float) -> str:
    """'1.28 to 1.32', in MN/m, with two digits of its own width."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return "none"
    decimals = 6 if high <= low else max(0, 1 - math.floor(math.log10((high - low) / 1e6)))
    return f"{low / 1e6:.{decimals}f} to {high / 1e6:.{decimals}f}"


def exponent(value: float) -> str:
    """'1e7' of 1e+07."""
    mantissa, power = f"{value:.2e}".split("e")
    return f"{float(mantissa):g}e{int(power)}"


def percent(share: float) -> str:
    """'+0.42 %'."""
    return f"{100 * share:+.2g} %".replace("-", "−")


def unbroken(text: str) -> str:
    """The text with no line break between a number and its unit or its error."""
    return _BEFORE_UNIT.sub(_NO_BREAK, text)


def counted(count: int, what: str) -> str:
    """'1 line', '2 lines'."""
    return f"{count} {what}{'s' * (count != 1)}"


def close_to(name: str, known: Iterable[str]) -> str:
    """A question after a name that is not known, 'did you mean gap? '; empty where none is like it.

    >>> close_to("gp", ["stiffness", "gap"])
    'did you mean gap? '
    """
    close = get_close_matches(name, list(known), n=1)
    return f"did you mean {close[0]}? " if close else ""


def yes_no(flag: bool) -> str:
    """'yes' or 'no'."""
    return "yes" if flag else "no"


def number(value: float) -> str:
    """'0.02', '30000', '1e7', '∞'."""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:g}" if value == 0 or 1e-3 <= abs(value) < 1e5 else exponent(value)
    return text.replace("-", "−") if value < 0 else text


def unit(text: str) -> str:
    """'N s/m' of 'N.s/m'; empty for a number without a unit."""
    return _UNITS.get(text, text)
