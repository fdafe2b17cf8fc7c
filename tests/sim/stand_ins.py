"""Rotors with a formula for their motion, in the place of an FMU session."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigtwin.sim.session import FmuSession


class StandIn:
    """An accelerometer at node 2, where the force F sin(phi) acts; a subclass says what it reads."""

    variables = ("node_2.acceleration_y", "force_applied")

    def start(self, values: Mapping[str, Any]) -> None:
        """From rest."""
        self.time, self.phase, self.frequency = 0.0, 0.3, 100.0
        self.at_rest()
        self.set(values)

    def set(self, values: Mapping[str, Any]) -> None:
        """Force and frequency; all else is ignored."""
        self.force = values.get("force_amplitude", getattr(self, "force", 0.0))
        self.frequency = values.get("force_frequency", self.frequency)

    def step(self, h: float) -> None:
        """The phase goes on; the motion follows a force that is held for a tenth of a second."""
        self.phase += 2 * np.pi * self.frequency * h
        self.time += h
        if h >= 0.1:
            self.follow()

    def sample(self, _outputs: list[str], h: float, n: int) -> np.ndarray:
        """(n, 2) acceleration and force."""
        phi = self.phase + 2 * np.pi * self.frequency * h * np.arange(n)
        self.phase, self.time = float(phi[-1]), self.time + (n - 1) * h
        return np.column_stack([self.acceleration(phi), self.force * np.sin(phi)])

    def save_state(self) -> dict[str, Any]:
        """Everything."""
        return dict(vars(self))

    def restore_state(self, state: dict[str, Any]) -> None:
        """Everything, as it was."""
        vars(self).update(state)

    def at_rest(self) -> None:
        """Forget."""

    def follow(self) -> None:
        """Come to the motion that the force causes."""

    def acceleration(self, phi: np.ndarray) -> np.ndarray:
        """Acceleration at phases of the force."""
        raise NotImplementedError

    def as_session(self) -> FmuSession:
        """For the type checker."""
        return self  # pyright: ignore[reportReturnType]


class DuffingOscillator(StandIn):
    """x'' + 2 zeta w0 x' + w0^2 x + k3 x^3 = F cos(w t), by its fundamental alone.

    The amplitude a obeys a^2 [(w0^2 + 3/4 k3 a^2 - w^2)^2 + (2 zeta w0 w)^2] = F^2: one root, or
    three of which the outer ones are stable. The motion stays on its branch while that exists.
    """

    def __init__(self, f0: float = 100.0, zeta: float = 0.005, k3: float = 4e6):
        self.w0, self.zeta, self.k3 = 2 * np.pi * f0, zeta, k3

    def at_rest(self) -> None:
        self.amplitude = 0.0

    def follow(self) -> None:
        roots = self.amplitudes(self.frequency, self.force)
        self.amplitude = float(min((roots[0], roots[-1]), key=lambda a: abs(a - self.amplitude)))

    def amplitudes(self, frequency: float, force: float) -> np.ndarray:
        """(1 or 3,) amplitudes that are possible, increasing."""
        w, slope = 2 * np.pi * frequency, 0.75 * self.k3
        off, drag = self.w0**2 - w**2, 2 * self.zeta * self.w0 * w
        squares = np.roots([slope**2, 2 * slope * off, off**2 + drag**2, -(force**2)])
        real = squares.real[(np.abs(squares.imag) < 1e-6 * np.abs(squares)) & (squares.real > 0)]
        return np.sqrt(np.sort(real))

    def receptance(self) -> complex:
        """Of the motion there is now."""
        w, a = 2 * np.pi * self.frequency, self.amplitude
        return 1 / (self.w0**2 + 0.75 * self.k3 * a**2 - w**2 + 2j * self.zeta * self.w0 * w)

    def acceleration(self, phi: np.ndarray) -> np.ndarray:
        turn = self.receptance() / abs(self.receptance())
        w = 2 * np.pi * self.frequency
        return (-(w**2) * self.amplitude * turn * np.exp(1j * phi)).imag


class SwellingMotion(StandIn):
    """An amplitude that swells and shrinks by ``share`` over four periods."""

    def __init__(self, share: float):
        self.share = share

    def acceleration(self, phi: np.ndarray) -> np.ndarray:
        return 2 * self.force * np.sin(phi) * (1 + self.share * np.cos(phi / 4))
