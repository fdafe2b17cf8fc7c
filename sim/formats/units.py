"""Units as measuring software writes them, and what a number in one of them is in SI."""

from __future__ import annotations

import math
import re

GRAVITY = 9.80665  # standard acceleration [m/s^2]
_POUND = 4.4482216152605  # of force [N]

# Keys as ``_plain`` leaves them.
FREQUENCY = dict.fromkeys(("hz", "hertz", "1/s"), 1.0) | dict.fromkeys(("rpm", "rev/min", "1/min", "cpm"), 1 / 60)
FREQUENCY |= {"khz": 1e3, "rad/s": 1 / (2 * math.pi)}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "micron": 1e-6}
_LENGTH |= {"in": 0.0254, "inch": 0.0254, "mil": 2.54e-5, "ft": 0.3048}
MOTION = {f"{name}{per}": factor for name, factor in _LENGTH.items() for per in ("", "/s", "/s2")}
MOTION |= {"g": GRAVITY, "gn": GRAVITY, "ips": 0.0254}
FORCE = {"n": 1.0, "kn": 1e3, "lbf": _POUND, "lb": _POUND, "kgf": GRAVITY, "kp": GRAVITY}
_SAYS_NOTHING = ("", "none", "-", "unknown", "unit")


def factor_of(label: str, units: dict[str, float]) -> float | None:
    """Factor to SI of a label, for example ``mm/s^2`` in MOTION; 1 where it says nothing, None where it is unknown.

    >>> factor_of("mm/s²", MOTION), factor_of("V", MOTION)
    (0.001, None)
    """
    name = _plain(label)
    return 1.0 if name in _SAYS_NOTHING else units.get(name)


def response_factor(unit: str) -> float | None:
    """Factor to SI of a response's unit, of a motion or of one over a force; None where it is unknown.

    >>> response_factor("g/N"), response_factor("mm/s^2")
    (9.80665, 0.001)
    """
    motion, force = motion_and_force(unit)
    moved, pushed = factor_of(motion, MOTION), factor_of(force, FORCE)
    return None if moved is None or pushed is None else moved / pushed


def motion_and_force(unit: str) -> tuple[str, str]:
    """The two parts of a response's unit; the force is empty where the unit is that of a motion alone.

    >>> motion_and_force("mm/s^2/lbf"), motion_and_force("m/s")
    (('mm/s^2', 'lbf'), ('m/s', ''))
    """
    motion, _, force = unit.strip().strip("[]").rpartition("/")
    return (motion, force) if motion and _plain(force) in FORCE else (unit, "")


def _plain(label: str) -> str:
    """A label in small letters without brackets and signs of powers, a square as ``/s2``."""
    text = label.lower().translate(str.maketrans({"²": "2", "µ": "u", "μ": "u", "^": "", "*": "", "·": "", " ": ""}))
    text = text.strip("[]()").replace("sec", "s")
    return re.sub(r"/s/s$|(?<!/)s-2$", "/s2", text)
