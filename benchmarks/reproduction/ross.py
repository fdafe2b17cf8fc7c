"""The same rotor in an independent code, ROSS."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.page import bar, power_of_ten, table
from benchmarks.reproduction.nominal import condition, percent
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure

ELEMENTS_PER_SPAN = 16
_ANNULUS = {"diameter_m": 0.124, "bore_m": 0.020, "thickness_m": 0.018, "density_kg_per_m3": 7840.0}


def ross_table() -> dict[str, Any]:
    """ROSS' frequencies and the disks it was given."""
    return tomllib.loads(Path(__file__).with_name("ross_table.toml").read_text(encoding="utf-8"))


def ross_structure(
    elements_per_span: int = ELEMENTS_PER_SPAN, *, disk: dict[str, float] | None = None, **changes: float
) -> Structure:
    """The paper's rotor with ROSS' rigid disks; ``changes`` go into the shaft segment."""
    tables = load_rig("nit-rourkela").model_dump(exclude_unset=True)
    tables["segment"][0].update(changes)
    tables["disk"] = [{"node": node, "inertia": True, **(disk or ross_table()["disk"])} for node in (3, 5)]
    return assemble(Rig.model_validate(tables), elements_between_nodes=elements_per_span)


def lateral_hz(structure: Structure) -> FloatArray:
    """(n_k_b, 4) lateral frequencies in one plane at ROSS' stiffnesses [Hz]."""
    stiffness = ross_table()["k_b_N_per_m"]
    return np.array([natural_frequencies_hz(build_system(structure, condition(k)), plane=1)[:4] for k in stiffness])


def _largest_difference(structure: Structure) -> float:
    return float(np.abs(percent(lateral_hz(structure) / np.array(ross_table()["f_Hz"]), 1.0)).max())


def ross() -> str:
    """Four lateral modes at four stiffnesses against ROSS."""
    theirs, ours = np.array(ross_table()["f_Hz"]), lateral_hz(ross_structure())
    rows = [
        (power_of_ten(k), f"{mode + 1}", f"{theirs[i, mode]:.3f}", f"{f:.3f}", f"{percent(f, theirs[i, mode]):+.4f}")
        for i, k in enumerate(ross_table()["k_b_N_per_m"])
        for mode, f in enumerate(ours[i])
    ]
    controls = [
        ("as it is", ross_structure()),
        ("disks by their dimensions, inertia unrounded", ross_structure(disk=_ANNULUS)),
        ("six elements (one per span)", ross_structure(elements_per_span=1)),
        ("two elements per span", ross_structure(elements_per_span=2)),
        ("shear factor 0.9 in place of Cowper's 0.886", ross_structure(shear_factor=0.9)),
        ("E = 206 GPa", ross_structure(youngs_modulus_Pa=206e9)),
    ]
    return f"""## An independent code: ROSS

The independent code ROSS 2.3.0 [ross2020] computed the same shaft with rigid disks on 44 nodes. The disks are rings
with a bore of 20 mm at 119 and 307 mm, with their mass and both moments of inertia. Our model has {ELEMENTS_PER_SPAN}
elements per span. At 1e15 N/m ROSS has a spring and our model a rigid support.

{table(("k_b, N/m", "mode", "ROSS, Hz", "ours, Hz", "diff., %"), rows)}
{bar("ROSS, largest difference of 16 frequencies", _largest_difference(ross_structure()), at_most=0.01, unit="%")}
No constant had to be adjusted: both codes use Cowper's shear factor 6(1+ν)/(7+6ν), G = E/2(1+ν), and the rotary inertia
of the shaft. Most of the remaining difference comes from the disk's moment of inertia, which is given with five digits;
the rest is the last printed digit of f1. The next table shows how sharp the comparison is: small changes in our model
alone make the difference much larger.

{table(("ours", "largest difference, %"), [(name, f"{_largest_difference(s):.4f}") for name, s in controls])}"""
