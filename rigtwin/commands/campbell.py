"""``rigtwin campbell``: whirl frequencies over spin speed, and where they meet it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.commands.asked_rotor import (
    DIRECTIONS,
    AskedRotor,
    RotorRequest,
    asked_rotor,
    lumped_disks,
    rotor_record,
    say_rotor,
    tell,
    user_errors,
)
from rigtwin.console import say, table
from rigtwin.errors import UserError
from rigtwin.rotor.frequency.modal import damping_ratio, log_decrement
from rigtwin.rotor.frequency.whirl import RPM, Campbell, Crossings, critical_speeds, crossings, followed_campbell


@dataclass(frozen=True)
class SpeedRange:
    """Spin speeds of a diagram; None: up to what shows the first critical speeds."""

    lowest_rpm: float
    highest_rpm: float | None
    n: int

    def check(self) -> None:
        """Raises UserError where it is none."""
        if not np.isfinite(self.lowest_rpm) or self.lowest_rpm < 0:
            raise UserError(f"--rpm-min {self.lowest_rpm:g}: give a speed of 0 rev/min or more")
        if self.highest_rpm is not None and not self.lowest_rpm < self.highest_rpm < np.inf:
            raise UserError(f"--rpm-min {self.lowest_rpm:g} --rpm-max {self.highest_rpm:g}: need rpm-min < rpm-max")

    def highest(self, asked: AskedRotor) -> float:
        """The highest speed [rad/s]: as asked for, or a fifth above the fourth critical speed. Raises UserError."""
        if self.highest_rpm is not None:
            return self.highest_rpm * RPM
        highest = 1.2 * float(critical_speeds(asked.system, 4).spin_speed.max(initial=0.0))
        if highest <= self.lowest_rpm * RPM:
            raise UserError(
                f"--rpm-min {self.lowest_rpm:g}: without --rpm-max the diagram ends at {highest / RPM:.0f} rev/min, a "
                "fifth above the fourth critical speed; give --rpm-max, too"
            )
        return highest


def run_campbell(request: RotorRequest, speeds: SpeedRange, n_modes: int, multiple: float) -> None:
    """Compute, draw, print."""
    speeds.check()
    if not 0 < multiple < np.inf:
        raise UserError(f"--multiple {multiple:g}: give a positive number")
    asked = asked_rotor(request)
    with user_errors():
        spin_speed = np.linspace(speeds.lowest_rpm * RPM, speeds.highest(asked), speeds.n)
        diagram = followed_campbell(asked.system, spin_speed, n_modes)
        met = crossings(asked.system, diagram, multiple)
    if request.out:
        from rigtwin.pages.rotor_figures import campbell_figure, save_figure

        save_figure(campbell_figure(diagram, met, multiple), request.out)

    def text() -> None:
        say_rotor(asked)
        _print(diagram, met, multiple)

    tell(request, {**rotor_record(asked), **_record(diagram, met, multiple)}, text, lumped_disks(asked))


def _print(diagram: Campbell, met: Crossings, multiple: float) -> None:
    low, high = (f"{speed / RPM:.0f} rev/min" for speed in diagram.spin_speed[[0, -1]])
    first, last = diagram.frequency_hz[[0, -1]]
    rows = []
    for mode in range(diagram.frequency_hz.shape[1]):
        own = met.mode == mode
        rows.append(
            (
                str(mode + 1),
                DIRECTIONS[int(diagram.direction[-1, mode])],
                f"{first[mode]:#.5g}",
                f"{last[mode]:#.5g}",
                ", ".join(f"{speed / RPM:.1f}" for speed in met.spin_speed[own]) or "none",
                ", ".join(f"{100 * zeta:.3g}" for zeta in damping_ratio(met.eigenvalue)[own]),
            )
        )
    header = ("mode", "whirl", f"Hz at {low}", f"Hz at {high}", f"meets {multiple:g}x at, rev/min", "damping there, %")
    table(header, rows)
    unstable = (diagram.damping_ratio < 0).any(axis=1)
    if unstable.any():
        say(f"unstable from {diagram.spin_speed[np.argmax(unstable)] / RPM:.0f} rev/min: a mode has a negative damping")


def _record(diagram: Campbell, met: Crossings, multiple: float) -> dict[str, Any]:
    """The diagram for a machine."""
    return {
        "spin_rpm": (diagram.spin_speed / RPM).tolist(),
        "modes": [
            {
                "mode": mode + 1,
                "frequency_hz": diagram.frequency_hz[:, mode].tolist(),
                "damping_ratio": diagram.damping_ratio[:, mode].tolist(),
                "log_decrement": log_decrement(diagram.eigenvalue[:, mode]).tolist(),
                "direction": [DIRECTIONS[int(d)] for d in diagram.direction[:, mode]],
            }
            for mode in range(diagram.frequency_hz.shape[1])
        ],
        "multiple": multiple,
        "crossings": [
            {
                "mode": int(met.mode[place]) + 1,
                "spin_rpm": float(met.spin_speed[place] / RPM),
                "frequency_hz": float(met.eigenvalue[place].imag / (2 * np.pi)),
                "damping_ratio": float(damping_ratio(met.eigenvalue)[place]),
                "log_decrement": float(log_decrement(met.eigenvalue)[place]),
                "direction": DIRECTIONS[int(met.direction[place])],
            }
            for place in range(len(met.mode))
        ],
    }
