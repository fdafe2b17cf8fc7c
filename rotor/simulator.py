"""The rotor as something that lives in time: parameters, a clock, a sine generator, a state."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rotor.stepper import Drive, ModalStepper
from rotor.structure import FloatArray, Structure
from rotor.system import Condition, build_system

# The clock counts ticks of 2^-36 s (15 ps), so that times add up exactly: a master's step that
# differs in its last bits from one step to the next meets a propagator that is already there, and
# a replay from a saved state is exact to the last bit.
TICKS_PER_SECOND = 2.0**36

# A master that calls a step from another time than the rotor stands at has lost track of it.
_SAME_TIME = 1e-6

# Thirty years, seven orders of magnitude above any settling time; the clock's arithmetic stays finite.
_LAST_TIME = 1e9


@dataclass(frozen=True)
class Settings:
    """What the rotor's equations depend on: parameters and spin speed, SI units."""

    k_b: float = 1e7
    rigid_support: bool = False
    bearing_damping: float = 0.0
    shaft_damping_ratio: float = 0.001
    excitation_node: int = 2
    excitation_plane: int = 1
    spin_speed: float = 0.0


class RotorSimulator:
    """Integrates the rotor from rest.

    Parameters
    ----------
    structure : the free-free rotor
    settings : initial settings
    """

    def __init__(self, structure: Structure, settings: Settings | None = None):
        self._structure = structure
        self._ticks = 0
        self._cycles = 0.0  # phase of the sine generator, in periods
        self._drive, self._frequency_hz = Drive(), 0.0
        self._build(settings or Settings())
        self._state = np.zeros(self._stepper.n_states)

    @property
    def time(self) -> float:
        """Time the rotor stands at [s]."""
        return self._ticks / TICKS_PER_SECOND

    @property
    def settings(self) -> Settings:
        """What is set now."""
        return self._settings

    def configure(self, settings: Settings) -> None:
        """Change settings; deflections and velocities stay continuous.

        Raises ValueError for a setting that is not physical and for a change of ``rigid_support``
        while the rotor moves; nothing is changed then.
        """
        if settings == self._settings:
            return
        if settings.rigid_support != self._settings.rigid_support:
            if self._ticks or self._state.any():
                raise ValueError("rigid_support changes the degrees of freedom: set it before the simulation starts")
            self._build(settings)
            self._state = np.zeros(self._stepper.n_states)
        else:
            motion = self._stepper.motion_of(self._state)
            self._build(settings)
            self._state = self._stepper.state_of(*motion)

    def drive(self, *, force: float, force_amplitude: float, force_frequency: float) -> None:
        """Set the held force [N] and the built-in sine [N, Hz]; the sine's phase stays continuous."""
        self._drive = Drive(force, force_amplitude, 2 * math.pi * force_frequency)
        self._frequency_hz = force_frequency

    def start_at(self, time: float) -> None:
        """Set the clock [s] of a rotor that has not moved yet. Raises ValueError for a time beyond its range."""
        if not abs(time) <= _LAST_TIME:
            raise ValueError(f"the start time must lie within {_LAST_TIME:g} s of zero, got {time} s")
        self._ticks = round(time * TICKS_PER_SECOND)

    def advance(self, time: float, step: float) -> None:
        """Integrate from ``time`` over ``step`` [s].

        Raises ValueError when the step is not positive or ``time`` is not where the rotor stands.
        """
        if not (math.isfinite(time) and math.isfinite(step)):
            raise ValueError(f"the communication step must be finite, got {step} s at {time} s")
        if step <= 0:
            raise ValueError(f"the communication step must be positive, got {step} s")
        if max(abs(time), abs(time + step)) > _LAST_TIME:
            raise ValueError(f"a step to {time + step:g} s leaves the clock's range of {_LAST_TIME:g} s")
        if abs(time - self.time) > _SAME_TIME * step + 1e-9 * max(1.0, abs(time)):
            raise ValueError(f"a step from {time} s was asked for, but the rotor stands at {self.time} s")
        end = round((time + step) * TICKS_PER_SECOND)
        if end <= self._ticks:
            raise ValueError(f"a communication step of {step} s is below the clock's resolution")
        h = (end - self._ticks) / TICKS_PER_SECOND
        cycles = math.fmod(self._cycles + math.fmod(self._frequency_hz * h, 1.0), 1.0)
        phases = (2 * math.pi * self._cycles, 2 * math.pi * cycles)
        self._state = self._stepper.step(self._state, phases, self._drive, h)
        self._cycles, self._ticks = cycles, end

    @property
    def force_applied(self) -> float:
        """Total force at this instant [N]: the input plus the built-in sine."""
        return self._drive.held + self._drive.amplitude * math.sin(2 * math.pi * self._cycles)

    def accelerations(self) -> FloatArray:
        """(2 n_nodes,) accelerations [m/s^2]: y of every node, then z of every node."""
        return self._stepper.acceleration(self._state, self.force_applied)

    def snapshot(self) -> dict[str, Any]:
        """Everything that is needed to go on from here, in JSON types; floats keep every bit."""
        return {
            "settings": asdict(self._settings),
            "force": [self._drive.held, self._drive.amplitude, self._frequency_hz],
            "ticks": self._ticks,
            "cycles": self._cycles,
            "state": self._state.tolist(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back to a snapshot."""
        settings = Settings(**snapshot["settings"])
        if settings != self._settings:
            self._build(settings)
        held, amplitude, frequency = snapshot["force"]
        self.drive(force=held, force_amplitude=amplitude, force_frequency=frequency)
        self._ticks, self._cycles = snapshot["ticks"], snapshot["cycles"]
        self._state = np.array(snapshot["state"], dtype=float)

    def _build(self, settings: Settings) -> None:
        condition = Condition(
            k_b=settings.k_b,
            rigid_support=settings.rigid_support,
            bearing_damping=settings.bearing_damping,
            shaft_damping_ratio=settings.shaft_damping_ratio,
        )
        system = build_system(self._structure, condition)
        force = system.unit_vector(settings.excitation_node, settings.excitation_plane)
        read_out = np.vstack([system.read_out(1), system.read_out(2)])
        self._stepper = ModalStepper(system, force, read_out, settings.spin_speed)
        self._settings = settings
