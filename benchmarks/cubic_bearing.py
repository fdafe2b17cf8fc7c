"""k_b of a bearing that hardens: ``python -m benchmarks.cubic_bearing [--page FILE]``; ten minutes.

Rigs of the blind benchmark's own elements and solver have bearings whose force is k_b x + k_3 x^3, so that what they
resonate at depends on the force. They are measured on rigid supports and at three forces on their bearings. A diagnosis
whose only candidate is this law fits k_b and k_3 to all lines of all runs.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.page import machine, table
from rigtwin.blind.generate.case import Case, Tolerances, measure
from rigtwin.blind.generate.draw import draw_sized, empty_case
from rigtwin.blind.generate.folder import write_campaign
from rigtwin.blind.generate.machine import Workshop
from rigtwin.blind.generate.rig import REFERENCE, Rig, read_rig
from rigtwin.gap.diagnose import diagnose
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.sim.campaign_folder import load_campaign

LAW, SEED = "bearing_cubic", 20_262


@dataclass(frozen=True)
class Conditions:
    """What the measurements of a table's rows are like."""

    words: str
    noise: float  # of every line, relative
    drift: float  # of every resonance from run to run


CONDITIONS = (
    Conditions("0.01 % noise, nothing drifts", 1e-4, 0.0),
    Conditions("1 % noise, nothing drifts", 1e-2, 0.0),
    Conditions("1 % noise, resonances drift by 0.01 %", 1e-2, 1e-4),
)


def main() -> None:
    """Measure, print, and write the page if one is asked for."""
    parser = argparse.ArgumentParser(description="How well k_b and k_3 of a hardening bearing are found.")
    parser.add_argument("--rigs", type=int, default=5)
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    rows = [row for conditions in CONDITIONS for row in _rows(conditions, options.rigs)]
    header = ("measured", "k_b, MN/m", "k_b off by", "standard error", "k_3 off by", "standard error")
    told = f"{machine()}. The last row of each block has root mean squares."
    text = "\n\n".join(((__doc__ or "").split("\n\n")[1], told, table(header, rows)))
    print(text)
    if options.page:
        options.page.write_text(f"# A bearing that hardens, measured\n\n{text}", encoding="utf-8")


def _rows(conditions: Conditions, rigs: int) -> Iterator[tuple[str, ...]]:
    found = []
    for number in range(rigs):
        k_b, numbers = _measured(conditions, np.random.default_rng([SEED, number]))
        found.append(numbers)
        yield conditions.words if not number else "", f"{k_b / 1e6:.3g}", *_percent(numbers)
    yield "", "all", *_percent(np.sqrt(np.mean(np.square(found), axis=0)))


def _percent(numbers: Sequence[float]) -> Iterator[str]:
    return (f"{100 * number:.4f} %" for number in numbers)


def _measured(conditions: Conditions, rng: np.random.Generator) -> tuple[float, tuple[float, float, float, float]]:
    """k_b of a rig [N/m]; its relative error and its standard error, and those of k_3."""
    rig = read_rig(REFERENCE)
    case = _drawn(rig, conditions, rng)
    runs = measure(rig, case, rig.drive_node, case.levels, rng)
    with tempfile.TemporaryDirectory() as folder:
        write_campaign(Path(folder), rig.name, case, runs, rng)
        campaign = load_campaign(Path(folder))
    cause = diagnose(campaign, exclude=[name for name in EFFECTS if name != LAW]).diagnosis.causes[0]
    true = case.effects[0]["stiffness"]
    k_b, k_3 = cause.k_b, cause.parameters["stiffness"]
    assert k_b is not None
    return case.k_b, (k_b.value / case.k_b - 1, k_b.std / k_b.value, k_3.value / true - 1, k_3.std / k_3.value)


def _drawn(rig: Rig, conditions: Conditions, rng: np.random.Generator) -> Case:
    """A rig that is as drawn but for its law, with a law that shows plainly."""
    case = draw_sized(rig, empty_case(rig, "W1", rng), LAW, "large", rng).case
    known = Tolerances(modulus=0.0, span=0.0, disk_mass=0.0, drift=conditions.drift)
    exact = Workshop(0.0, 0.0, tuple(0.0 for _ in rig.disks))
    return replace(
        case, noise=conditions.noise, tolerances=known, workshop=exact, with_std=True, quantity="accelerance"
    )


if __name__ == "__main__":
    main()
