"""What drives the rotor during one step: the force of a signal, and pure tones."""

from __future__ import annotations

from dataclasses import dataclass, field

from rigtwin.rotor.model.arrays import ComplexArray
from rigtwin.rotor.time.exciter import Course


@dataclass(frozen=True)
class Tone:
    """Forces Im[force e^{i phi}], with phi running from ``start`` to ``stop`` [rad] at ``omega`` [rad/s]."""

    omega: float
    start: float
    stop: float
    force: ComplexArray  # (n_inputs,) [N]


@dataclass(frozen=True)
class Drive:
    """Forces during a step: that of the ``signal`` on the first input, and tones."""

    signal: Course = field(default_factory=Course)
    tones: tuple[Tone, ...] = field(default_factory=tuple)
