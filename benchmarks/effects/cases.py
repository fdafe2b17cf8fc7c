"""The rotor and the nonlinear cases that this package's sections measure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.effects import (
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BearingHertz,
    BilinearSupport,
    Effect,
    Rub,
)
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.structure import Structure

K_B, BEARING_DAMPING, SHAFT_DAMPING = 1.3e6, 50.0, 0.005


@dataclass(frozen=True)
class Case:
    """A nonlinear effect, and force levels at which it goes from hardly to strongly felt."""

    effect: Effect
    levels_N: tuple[float, float, float]
    harmonics: int = 15  # of harmonic balance

    @property
    def name(self) -> str:
        """The effect's id; a preload is worth saying."""
        return (
            f"{self.effect.id}, preloaded"
            if getattr(self.effect, "preload", 0) and "gap" in vars(self.effect)
            else self.effect.id
        )


CASES = (
    Case(BearingCubic(stiffness=1e15), (0.3, 1.0, 3.0)),
    Case(BearingHertz(preload=5e-6), (0.3, 1.0, 3.0)),
    # Sharp corners at 40 Hz reach the third and fourth mode, at 670 and 950 Hz.
    Case(BearingClearance(gap=2e-6), (3.0, 10.0, 30.0), harmonics=31),
    Case(BearingClearance(gap=2e-6, preload=20.0), (1.0, 3.0, 10.0), harmonics=31),
    Case(BearingFriction(force=1.0, stiffness=3e6), (0.5, 2.0, 8.0), harmonics=31),
    Case(BilinearSupport(ratio=1.5), (0.3, 1.0, 3.0), harmonics=31),
    Case(Rub(stiffness=1e6, gap=3e-5, node=4), (0.3, 1.0, 3.0), harmonics=31),
)

# Round the first resonance closely, round its superharmonics and the second resonance loosely.
LINES_HZ: FloatArray = np.array(
    [
        22.0,
        25.5,
        27.0,
        33.0,
        38.0,
        41.0,
        50.0,
        62.0,
        70.0,
        75.0,
        77.5,
        79.0,
        81.5,
        84.0,
        88.0,
        95.0,
        120.0,
        160.0,
        195.0,
        206.0,
        215.0,
        250.0,
    ]
)


def structure() -> Structure:
    """The shipped rotor on its six elements, as the FMU has it."""
    return assemble(load_rig("nit-rourkela"))


def condition() -> Condition:
    """On bearings, with enough damping to settle in seconds."""
    return Condition(k_b=K_B, bearing_damping=BEARING_DAMPING, shaft_damping_ratio=SHAFT_DAMPING)


def fmu_parameters() -> dict[str, float]:
    """The same for the FMU."""
    return {"k_b": K_B, "bearing_damping": BEARING_DAMPING, "shaft_damping_ratio": SHAFT_DAMPING}
