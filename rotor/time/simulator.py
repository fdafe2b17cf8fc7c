"""The rotor in time: its parameters, a clock, a sine generator and the state of motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.design import Unbalance
from rigtwin.rotor.model.rotor_model import Change, build_model
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.time.drive import Drive, Tone
from rigtwin.rotor.time.exciter import Exciter
from rigtwin.rotor.time.nonlinear_stepper import NonlinearStepper
from rigtwin.rotor.time.stepper import ModalStepper

# A phase at the start and at the end of a step.
Span = tuple[float, float]

# The clock counts ticks of 2^-44 s (57 fs), so that times add up exactly: a master's step that
# differs in its last bits from one step to the next meets a propagator that is already there, and
# a replay from a saved state is exact to the last bit. Masters whose times differ in the last bits
# may be a tick apart, which moves a sine of 400 Hz by 1.4e-10 of its amplitude.
TICKS_PER_SECOND = 2.0**44

# Largest difference, in steps, between the time that a master gives for a step and the time of the rotor.
_SAME_TIME = 1e-6

# Largest time [s], thirty years: far above any settling time, and the arithmetic of the clock stays finite.
_LAST_TIME = 1e9


class RotorSimulator:
    """Integrates the rotor from rest.

    Parameters
    ----------
    structure : the free-free rotor
    condition : how it is held, driven and spun at first
    effects : what reality adds to the nominal rotor
    """

    def __init__(self, structure: Structure, condition: Condition | None = None, effects: Sequence[Change] = ()):
        self._structure = structure
        self._ticks = 0
        self._cycles = 0.0  # phase of the sine generator, in periods
        self._turns = 0.0  # spin angle, in turns
        self._exciter, self._amplitude, self._frequency_hz = Exciter(), 0.0, 0.0
        self._build(condition or Condition(), tuple(effects))
        self._state = np.zeros(self._stepper.n_states)

    @property
    def time(self) -> float:
        """Time the rotor stands at [s]."""
        return self._ticks / TICKS_PER_SECOND

    def configure(self, condition: Condition, effects: Sequence[Change] = ()) -> None:
        """Change condition and effects; deflections and velocities stay continuous.

        Raises ValueError for a value that is not physical and for a change of the number of degrees
        of freedom while the rotor moves; nothing is changed then.
        """
        effects = tuple(effects)
        if condition == self._condition and effects == self._effects:
            return
        before = self._condition, self._effects
        free, motion, memory = self._free, self._stepper.motion_of(self._state), self._stepper.memory_of(self._state)
        self._build(condition, effects)
        if np.array_equal(free, self._free):
            self._state = self._stepper.state_of(*motion, memory)
        elif self._state.any():
            self._build(*before)
            raise ValueError(
                "this changes the degrees of freedom (rigid_support, or an effect with masses or states of its own): "
                "set it before the simulation starts"
            )
        else:
            self._state = np.zeros(self._stepper.n_states)

    def drive(self, *, force: float, force_amplitude: float, force_frequency: float, hold_force: bool = False) -> None:
        """Set the signal's value [N] and the built-in sine [N, Hz]; the sine's phase stays continuous.

        Between two values the force goes on smoothly, see ``exciter``; with ``hold_force`` it is held.
        """
        self._exciter.set(force, hold=hold_force)
        self._amplitude, self._frequency_hz = force_amplitude, force_frequency

    def start_at(self, time: float) -> None:
        """Set the clock [s] of a rotor that has not moved yet. Raises ValueError for a time beyond its range."""
        if not abs(time) <= _LAST_TIME:
            raise ValueError(f"the start time must lie within {_LAST_TIME:g} s of zero, got {time:.9g} s")
        self._ticks = round(time * TICKS_PER_SECOND)

    def advance(self, time: float, step: float) -> None:
        """Integrate from ``time`` over ``step`` [s].

        Raises ValueError when the step is not positive or ``time`` is not where the rotor stands.

        >>> rotor = RotorSimulator(assemble(load_rig("nit-rourkela")))
        >>> rotor.advance(time=0.0, step=0.5)
        >>> rotor.time
        0.5
        """
        if not (math.isfinite(time) and math.isfinite(step)):
            raise ValueError(f"the communication step must be finite, got {step:.9g} s at {time:.9g} s")
        if step <= 0:
            raise ValueError(f"the communication step must be positive, got {step:.9g} s")
        if max(abs(time), abs(time + step)) > _LAST_TIME:
            raise ValueError(f"a step to {time + step:.9g} s leaves the clock's range of {_LAST_TIME:g} s")
        if abs(time - self.time) > _SAME_TIME * step + 1e-9 * max(1.0, abs(time)):
            raise ValueError(f"a step from {time:.9g} s was asked for, but the rotor stands at {self.time:.9g} s")
        end = round((time + step) * TICKS_PER_SECOND)
        if end <= self._ticks:
            raise ValueError(f"a communication step of {step:.9g} s is below the clock's resolution")
        h = (end - self._ticks) / TICKS_PER_SECOND
        cycles = _advance(self._cycles, self._frequency_hz, h)
        turns = _advance(self._turns, self._condition.spin_speed / (2 * math.pi), h)
        tones = self._tones((self._cycles, cycles), (self._turns, turns))
        course = self._exciter.course(h)
        self._state = self._stepper.step(self._state, Drive(course, tones), h)
        self._exciter.advance(course, h)
        self._cycles, self._turns, self._ticks = cycles, turns, end

    @property
    def force_applied(self) -> float:
        """Total force of the exciter at this instant [N]: that of the signal plus the built-in sine."""
        return self._exciter.force + self._amplitude * math.sin(2 * math.pi * self._cycles)

    def accelerations(self) -> FloatArray:
        """(2 n_nodes,) accelerations [m/s^2]: y of every node, then z of every node."""
        forces = np.zeros(self._n_inputs)
        for tone in self._tones((self._cycles, self._cycles), (self._turns, self._turns)):
            forces += (tone.force * np.exp(1j * tone.start)).imag
        forces[0] = self.force_applied
        return self._stepper.acceleration(self._state, forces)

    def snapshot(self) -> dict[str, Any]:
        """Everything that is needed to go on from here, in JSON types; floats keep every bit."""
        return {
            "force": [self._amplitude, self._frequency_hz],
            "exciter": self._exciter.snapshot(),
            "ticks": self._ticks,
            "cycles": self._cycles,
            "turns": self._turns,
            "state": self._state.tolist(),
        }

    def restore(self, snapshot: dict[str, Any], condition: Condition, effects: Sequence[Change] = ()) -> None:
        """Go back to a snapshot that was taken under this condition and these effects."""
        if condition != self._condition or tuple(effects) != self._effects:
            self._build(condition, tuple(effects))
        self._amplitude, self._frequency_hz = snapshot["force"]
        self._exciter = Exciter.of(snapshot["exciter"])
        self._ticks, self._cycles, self._turns = snapshot["ticks"], snapshot["cycles"], snapshot["turns"]
        self._state = np.array(snapshot["state"], dtype=float)

    def _build(self, condition: Condition, effects: tuple[Change, ...]) -> None:
        """Everything that follows from condition and effects; nothing is changed where it fails."""
        model = build_model(self._structure, condition, effects)
        system = model.system
        exciter = system.unit_vector(condition.excitation_node, condition.excitation_plane)
        inputs = np.array([exciter, *(row for u in model.unbalances for row in u.patterns)]).T  # (n, n_inputs)
        read_out = np.vstack([system.read_out(1), system.read_out(2)])
        if model.forces:
            stepper = NonlinearStepper(model, inputs, read_out, condition.spin_speed)
        else:
            stepper = ModalStepper(system, inputs, read_out, condition.spin_speed)
        self._stepper, self._free, self._n_inputs = stepper, system.free, inputs.shape[1]
        self._spinning_force = _spinning_force(model.unbalances, condition.spin_speed, self._n_inputs)
        self._condition, self._effects = condition, effects

    def _tones(self, cycles: Span, turns: Span) -> tuple[Tone, ...]:
        """The sine generator and the unbalance between two phases and two spin angles, in periods and turns."""
        tones = []
        if self._amplitude:
            force = np.zeros(self._n_inputs, dtype=complex)
            force[0] = self._amplitude
            tones.append(Tone(2 * math.pi * self._frequency_hz, *_radians(cycles), force))
        if self._spinning_force.any():
            tones.append(Tone(self._condition.spin_speed, *_radians(turns), self._spinning_force))
        return tuple(tones)


def _radians(span: Span) -> Span:
    return 2 * math.pi * span[0], 2 * math.pi * span[1]


def _advance(periods: float, frequency_hz: float, h: float) -> float:
    """Phase after h seconds, in periods, less whole ones."""
    return math.fmod(periods + math.fmod(frequency_hz * h, 1.0), 1.0)


def _spinning_force(unbalances: Sequence[Unbalance], spin_speed: float, n_inputs: int) -> ComplexArray:
    """(n_inputs,) phasors with f = Im[phasor e^{i spin angle}]: cosine along y, sine along z; the exciter's is zero."""
    force = np.zeros(n_inputs, dtype=complex)
    for k, unbalance in enumerate(unbalances):
        pull = unbalance.moment * spin_speed**2 * np.exp(1j * unbalance.phase)
        force[1 + 2 * k : 3 + 2 * k] = 1j * pull, pull
    return force
