"""What the rest of the diagnosis may ask of a run's model, whether the rotor is linear or follows a force law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from rigtwin.rotor.effects import Effect
from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray
from rigtwin.sim.campaign import Run

if TYPE_CHECKING:
    from rigtwin.gap.model.linear import Modal
    from rigtwin.gap.model.nonlinear import NonlinearModal


class RunModel(Protocol):
    """Noise-free response of one run.

    Its methods take ``drift`` (MODES,), relative shifts of the resonances, and of their dampings as imaginary parts;
    ``tolerance`` (n_tolerances,), logarithms of factors on the numbers that the workshop knows within a tolerance, by
    default those at which the model was made; and ``level``, the logarithm of the true force over the one that the run
    believes.
    """

    run: Run
    level_is_parameter: ClassVar[bool] = False  # whether the response per newton changes with the force

    @property
    def frequencies_hz(self) -> FloatArray:
        """Resonances that may drift, lowest first [Hz]."""
        ...

    @property
    def as_linear(self) -> Modal | None:
        """This model as a sum of resonances; None where a force law acts."""
        return None

    @property
    def as_nonlinear(self) -> NonlinearModal | None:
        """This model as motions under a force law; None where none acts."""
        return None

    def response(
        self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None, level: float = 0.0
    ) -> ComplexArray:
        """(n_freq, n_channels) response."""
        ...

    def with_derivatives(
        self, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """``response`` and its (n, n_freq, n_channels) derivatives by the real, then the imaginary
        part of MODES drifts, n_tolerances, 1 if level is a parameter."""
        ...

    def change_to(
        self, other: RunModel, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> ComplexArray:
        """(n_freq, n_channels) response of another model less this one."""
        return other.response(drift, tolerance, level) - self.response(drift, tolerance, level)

    def small_change_to(
        self, other: RunModel, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> ComplexArray:
        """``change_to`` a model whose numbers differ by a small step, to first order in these, for a derivative."""
        return self.change_to(other, drift, tolerance, level)

    def found(self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None) -> BoolArray:
        """(n_freq,) lines that have a response."""
        return np.ones(len(self.run.frequency_hz), dtype=bool)

    def harmonic(
        self, order: int, drift: ComplexArray, tolerance: FloatArray, level: float = 0.0
    ) -> ComplexArray | FloatArray:
        """(n_freq, n_channels) response at ``order`` times each line, as ``Run.harmonics`` has it."""
        return np.zeros((len(self.run.frequency_hz), len(self.run.channels)))

    def tells(
        self, drift: ComplexArray | None = None, tolerance: FloatArray | None = None, level: float = 0.0
    ) -> BoolArray:
        """(n_freq,) lines whose response is near enough to a solution to have a derivative."""
        return self.found(drift, tolerance)

    def driven_and_read_by(self, effects: Sequence[Effect]) -> RunModel | None:
        """The same rotor with another exciter and other sensors; None where it has to be solved again for that."""
        return None
