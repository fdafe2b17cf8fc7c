"""The paper's numbers and the paper's rotor."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import ElementType, timoshenko
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem

# The paper's "1e15 N/m" is its simply supported rotor. Here such a support removes the degree of
# freedom: as a spring it moves f1 by round-off, about 1e-7, and by nothing that is physics.
RIGID_ABOVE = 1e14


@cache
def paper() -> dict[str, Any]:
    """The numbers printed in the paper, table by table."""
    return tomllib.loads(Path(__file__).parents[1].joinpath("paper_tables.toml").read_text(encoding="utf-8"))


@cache
def structure(element: ElementType = timoshenko, elements_per_span: int = 1) -> Structure:
    """The paper's rotor; one element per span is the paper's six-element mesh."""
    return assemble(load_rig("nit-rourkela"), element=element, elements_between_nodes=elements_per_span)


def condition(k_b: float, bearing_damping: float = 0.0) -> Condition:
    """Both bearings at k_b [N/m]; the paper's 1e15 is a rigid support."""
    if k_b > RIGID_ABOVE:
        return Condition(rigid_support=True)
    return Condition(k_b=k_b, bearing_damping=bearing_damping)


def system(k_b: float, *, element: ElementType = timoshenko, elements_per_span: int = 1) -> LinearSystem:
    """The paper's rotor on bearings of k_b [N/m]."""
    return build_system(structure(element, elements_per_span), condition(k_b))


def two_frequencies_hz(supported: LinearSystem) -> FloatArray:
    """(2,) the first two bending frequencies in y [Hz]."""
    return natural_frequencies_hz(supported, plane=1)[:2]


def percent(ours: float, theirs: float) -> float:
    """Relative difference of ours against theirs [%]."""
    return 100 * (ours / theirs - 1)
