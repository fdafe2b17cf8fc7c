"""Units as measuring software writes them, and what a number in one of them is in SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

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


# What a measuring channel gives before it is a force or a motion: volts, or counts of a converter.
_VOLTS = {"v": 1.0, "mv": 1e-3, "uv": 1e-6, "kv": 1e3, "volt": 1.0, "volts": 1.0, "vdc": 1.0, "vac": 1.0}
_COUNTS: dict[str, float] = {name: 1.0 for name in ("count", "counts", "digit", "digits", "lsb")}
_ORDERS = ("displacement", "velocity", "acceleration")


def kind_of(unit: str) -> tuple[str, float] | None:
    """What a unit of one signal measures, and its factor to SI, volts or counts; None where it is unknown.

    >>> kind_of("mV"), kind_of("g"), kind_of("kN"), kind_of("mm/s")
    (('voltage', 0.001), ('acceleration', 9.80665), ('force', 1000.0), ('velocity', 0.001))
    """
    name = _plain(unit)
    for kind, units in (("voltage", _VOLTS), ("counts", _COUNTS), ("force", FORCE)):
        if name in units:
            return kind, units[name]
    if name not in MOTION:
        return None
    order = 2 if name.endswith("/s2") or name in ("g", "gn") else int(name.endswith("/s") or name == "ips")
    return _ORDERS[order], MOTION[name]


def derivative_order(kind: str) -> int | None:
    """Which derivative of a displacement a kind of signal is, None of what is no motion."""
    return _ORDERS.index(kind) if kind in _ORDERS else None


@dataclass(frozen=True)
class Sensitivity:
    """What a sensor gives for one SI unit of what it measures."""

    signal: str  # "voltage" or "counts"
    measured: str  # "force", "displacement", "velocity" or "acceleration"
    value: float  # [V or counts per SI unit]; negative of a sensor that points the other way


_SENSITIVITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\s/\d][^/]*?)\s*/\s*(.+?)\s*")


def sensitivity(text: str) -> Sensitivity:
    """A sensitivity as calibration sheets write it. Raises ValueError where it is none.

    >>> sensitivity("22.4 mV/N")
    Sensitivity(signal='voltage', measured='force', value=0.0224)
    """
    match = _SENSITIVITY.fullmatch(re.sub(r"(?<=\d),(?=\d)", ".", text))
    given, per = (kind_of(match[2]), kind_of(match[3])) if match else (None, None)
    if match is None or given is None or per is None or given[0] not in ("voltage", "counts"):
        raise ValueError(
            f"{text!r} is no sensitivity; write one like 22.4 mV/N, 100 mV/g, 10 mV/(m/s^2) or 1200 counts/N"
        )
    if per[0] in ("voltage", "counts"):
        raise ValueError(
            f"{text!r} is no sensitivity of a sensor; the unit after the stroke is one of a force or motion"
        )
    value = float(match[1]) * given[1] / per[1]
    if not (math.isfinite(value) and value != 0):
        raise ValueError(f"{text!r} is no sensitivity; it must not be zero")
    return Sensitivity(given[0], per[0], value)
