"""The force of a master's signal between the points at which the master gives it.

A master says what the force is at communication points u_0, u_1, ... only. A force that is held over each
step jumps from one value to the next. At the driving point, where the response is a small difference of
large terms, every jump is answered by all modes up to tens of kHz, and the held force is half a step late.
So the signal is continued smoothly instead: during a step the force is a parabola that goes on with the
value and the rate at which the step before ended: with equal steps a quadratic B-spline. The control point
of a step lies one and a half steps ahead of its start,

    c = u_k + 3/2 h r,   r = (u_k - u_{k-1}) / h_{k-1},

with the rate r of the last two samples, or the one that the master gives with the sample. For a sine the
force so made is late by nothing and too large by 1.7 (omega h)^2, 0.5 % with 120 steps a period. A jump of
the signal becomes three steps of an overshoot of 75 %, with the impulse that the held samples have.

Where a step is more than twice as long as the one before, the last samples say nothing about it: the force
is then held at the sample, as before the first step and where the signal is said to be a staircase.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import NamedTuple

# Longest step, in steps before it, over which the rate of the last samples is believed.
_LONGEST_GROWTH = 2.0

# Control point of a uniform quadratic B-spline, in steps ahead of a step's start.
_AHEAD = 1.5


class Course(NamedTuple):
    """The force during a step, t from its start: force + rate t + curvature t^2 / 2."""

    force: float = 0.0  # [N]
    rate: float = 0.0  # [N/s]
    curvature: float = 0.0  # [N/s^2]

    def after(self, t: float) -> tuple[float, float]:
        """Force [N] and rate [N/s] after t seconds."""
        return self.force + t * (self.rate + 0.5 * t * self.curvature), self.rate + t * self.curvature

    def share(self, h: float) -> tuple[float, float, float]:
        """What 1, t/h and (t/h)^2 have in it [N]."""
        return self.force, self.rate * h, 0.5 * self.curvature * h * h


@dataclass
class Exciter:
    """The signal's samples, and the force that has been made of them."""

    hold: bool = False  # the signal is a staircase
    sample: float = 0.0  # the master's latest value [N]
    previous: float = 0.0  # the one that the last step started with [N]
    last_step: float = 0.0  # length of that step [s]; 0: there was none
    force: float = 0.0  # on the rotor, at this instant [N]
    rate: float = 0.0  # of that force [N/s]
    given: bool = False  # whether the master has given the rate of its signal for the next step
    given_rate: float = 0.0  # [N/s]

    def set(self, sample: float, *, hold: bool) -> None:
        """Take up the signal's value at this instant [N]."""
        self.sample, self.hold = sample, hold
        if not self.last_step:
            self.force = sample

    def give_rate(self, rate: float) -> None:
        """Take up the signal's rate at this instant [N/s], for the next step alone."""
        self.given, self.given_rate = True, rate

    def course(self, h: float) -> Course:
        """The force over the next h seconds."""
        if self.hold:
            return Course(self.sample)
        if not self.last_step or (h > _LONGEST_GROWTH * self.last_step):
            return Course(self.sample, self.given_rate if self.given else 0.0)
        rate = self.given_rate if self.given else (self.sample - self.previous) / self.last_step
        ahead = self.sample + _AHEAD * h * rate
        return Course(self.force, self.rate, (ahead - self.force - _AHEAD * h * self.rate) / (h * h))

    def advance(self, course: Course, h: float) -> None:
        """Be at the end of a step of h seconds with this course."""
        self.force, self.rate = course.after(h)
        self.previous, self.last_step, self.given, self.given_rate = self.sample, h, False, 0.0

    def snapshot(self) -> list[float]:
        """Everything that decides how the force goes on."""
        return [float(number) for number in astuple(self)]

    @classmethod
    def of(cls, snapshot: list[float]) -> Exciter:
        """The exciter that a snapshot was taken of."""
        hold, sample, previous, last_step, force, rate, given, given_rate = snapshot
        return cls(bool(hold), sample, previous, last_step, force, rate, bool(given), given_rate)


# Steps for each period of the fastest motion that is of interest: the force of a sine is then 0.7 % too large.
_STEPS_PER_PERIOD = 100


def highest_frequency(step: float) -> float:
    """Frequency [Hz] up to which a signal is followed with a communication step [s]."""
    return 1.0 / (_STEPS_PER_PERIOD * step)


def recommended_step(highest_hz: float) -> float:
    """Communication step [s] with which a signal up to this frequency [Hz] is followed: 1, 2 or 5 times a power of ten.

    >>> recommended_step(390.0)
    2e-05
    """
    longest = 1.0 / (_STEPS_PER_PERIOD * highest_hz)
    power = math.floor(math.log10(longest))
    return next(float(f"{digit}e{power}") for digit in (5, 2, 1) if float(f"{digit}e{power}") <= longest)
