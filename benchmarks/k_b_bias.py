"""What an effect that nobody knows of does to k_b: ``python -m benchmarks.k_b_bias [--page FILE]``.

The paper's rotor has one effect of the library at its default size, which a lab might well have, and is measured at
node 2 on both supports, with lines about all resonances and a noise of 0.1 %. The estimators do not know the effect.
Effects of how a sweep is made, of spinning disks, and nonlinear ones, whose bias depends on the force, are left out.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.interval_coverage import METHODS
from benchmarks.page import machine, table
from rigtwin.api.estimates import estimate
from rigtwin.errors import UserError
from rigtwin.gap.model.forward import acting
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.scale_out import executor
from rigtwin.sim.campaign import Channel, Run

NODE, ERROR = 2, 1e-3
STIFFNESSES = (2e6, 2e7)  # [N/m]
BEARING_DAMPING, SHAFT_DAMPING = 20.0, 0.002
# Distances of lines from a peak, in half-power bands.
WIDTHS = np.concatenate([-np.geomspace(40, 0.25, 16), [0.0], np.geomspace(0.25, 40, 16)])


def main() -> None:
    """Measure, print, and write the page if one is asked for."""
    parser = argparse.ArgumentParser(description="What unknown effects do to k_b.")
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    with executor() as pool:
        rows = [row for rows in pool.map(_rows, sorted(biasing())) for row in rows]
    header = ("effect", "k_b, MN/m", *METHODS.values())
    text = "\n\n".join(
        (
            (__doc__ or "").split("\n\n")[1].strip(),
            f"The table says by how much k_b is off; {machine()}. *inside*: the 90 % interval holds the true value.\n"
            "*flagged*: the answer is marked as not valid. *none*: no k_b explains the shifts. An offset without a\n"
            "word is a silent error.",
            table(header, rows),
        )
    )
    print(text)
    if options.page:
        options.page.write_text(f"# What unknown effects do to k_b, measured\n\n{text}", encoding="utf-8")


def biasing() -> list[str]:
    """Ids of the effects that the page has."""
    return [
        name
        for name, effect in EFFECTS.items()
        if effect.family not in ("nonlinear", "spinning") and effect.sweep_changes is Effect.sweep_changes
    ]


def _rows(name: str) -> list[tuple[str, ...]]:
    """One effect at every stiffness."""
    effect = EFFECTS[name]()
    size = ", ".join(f"{key} {value:g}" for key, value in asdict(effect).items() if value)
    rows = []
    for k_b in STIFFNESSES:
        words = f"[{name}](effects/{name}.md): {size}" if k_b == STIFFNESSES[0] else ""
        rows.append((words, f"{k_b / 1e6:g}", *answers(effect, k_b)))
    return rows


def answers(effect: Effect, k_b: float) -> Iterator[str]:
    """How far every method's k_b is off, in words."""
    structure = assemble(load_rig("nit-rourkela"))
    runs = [_run(structure, Condition(k_b, rigid, BEARING_DAMPING, SHAFT_DAMPING), effect) for rigid in (True, False)]
    for method in METHODS:
        try:
            found = estimate(*runs, method=method).best.estimate
        except UserError:
            yield "refused"
            continue
        inside = found.k_b_low <= k_b <= found.k_b_high
        word = " flagged" if not found.valid else " inside" if inside else ""
        off = 100 * (found.k_b / k_b - 1)
        yield f"{off:+.2f} %{word}" if math.isfinite(off) else "none"


def _run(structure: Structure, condition: Condition, effect: Effect) -> Run:
    """One run at the driving point, on lines about the resonances that are there."""
    support = "rigid" if condition.rigid_support else "bearing"
    effects = acting((effect,), support)
    modes = damped_modes(build_system(structure, condition, effects))
    peaks = zip(modes.frequency_hz, modes.damping_ratio, strict=True)
    lines = np.unique(np.concatenate([np.linspace(20, 400, 96), *(f * (1 + zeta * WIDTHS) for f, zeta in peaks)]))
    lines = lines[(lines >= 20) & (lines <= 400)]
    H = measured_response(structure, condition, effects, lines, [NODE])
    std, rng = ERROR * np.abs(H), np.random.default_rng(condition.rigid_support)
    noise = std * (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) / np.sqrt(2)
    return Run(lines, H + noise, (Channel(NODE),), support, std=std, name=support)


if __name__ == "__main__":
    main()
