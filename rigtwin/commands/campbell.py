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
from rigtwin.rotor.frequency.whirl import (
    RPM,
    Campbell,
    Crossings,
    critical_speeds,
    crossings,
    followed_campbell,
    grows,
    stability_limits,
)


@dataclass(frozen=True)
class SpeedRange:
    """Spin speeds of a diagram; None: what shows the first critical speeds, or all that the supports' tables hold."""

    lowest_rpm: float | None
    highest_rpm: float | None
    n: int

    def check(self) -> None:
        """Raises UserError where it is none."""
        least = self.lowest_rpm or 0.0
        if not 0 <= least < np.inf:
            raise UserError(f"--rpm-min {least:g}: give a speed of 0 rev/min or more")
        if self.highest_rpm is not None and not least < self.highest_rpm < np.inf:
            raise UserError(f"--rpm-min {least:g} --rpm-max {self.highest_rpm:g}: need rpm-min < rpm-max")

    def ends(self, asked: AskedRotor, least_share: float = 0.0) -> tuple[float, float]:
        """Lowest and highest speed [rad/s]. Raises UserError.

        By default the highest is a fifth above the fourth critical speed, the lowest a share of it; where supports
        follow the spin speed, both are those of their tables.
        """
        low, high = asked.structure.spin_range
        tables = bool(asked.structure.speed_tables)
        if self.highest_rpm is not None:
            highest = self.highest_rpm * RPM
        else:
            highest = high if tables else 1.2 * float(critical_speeds(asked.system, 4).spin_speed.max(initial=0.0))
        lowest = self.lowest_rpm * RPM if self.lowest_rpm is not None else low if tables else 0.0
        if highest <= lowest:
            end = "where the supports' tables end" if tables else "a fifth above the fourth critical speed"
            raise UserError(
                f"--rpm-min {lowest / RPM:g}: without --rpm-max the diagram ends at {highest / RPM:.0f} rev/min, "
                f"{end}; give --rpm-max, too"
            )
        return lowest or least_share * highest, highest


def run_campbell(request: RotorRequest, speeds: SpeedRange, n_modes: int, multiple: float) -> None:
    """Compute, draw, print."""
    speeds.check()
    if not 0 < multiple < np.inf:
        raise UserError(f"--multiple {multiple:g}: give a positive number")
    asked = asked_rotor(request)
    with user_errors():
        followed = asked.system.n if asked.structure.speed_tables else n_modes  # a higher mode may grow, too
        every = followed_campbell(asked.system, np.linspace(*speeds.ends(asked), speeds.n), followed)
        diagram = every.lowest(n_modes)
        met = crossings(asked.system, diagram, multiple)
        limits = stability_limits(asked.system, every)
    if request.out:
        from rigtwin.pages.rotor_figures import campbell_figure, save_figure

        grown = [(one["spin_rpm"], one["frequency_hz"]) for one in _limits(every, limits) if one["grows_above"]]
        save_figure(campbell_figure(diagram, met, multiple, grown), request.out)

    def text() -> None:
        say_rotor(asked)
        _print(diagram, met, multiple)
        _print_stability(every, limits)

    record = {**rotor_record(asked), **_record(diagram, met, multiple), "stability_limits": _limits(every, limits)}
    tell(request, record, text, lumped_disks(asked))


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


def _print_stability(diagram: Campbell, limits: Crossings) -> None:
    """A sentence for every mode that grows, from the speed at which it begins."""
    lowest = f"{diagram.spin_speed[0] / RPM:.0f} rev/min"
    for mode in np.flatnonzero(grows(diagram.eigenvalue[0])):
        say(f"unstable from {lowest}, the lowest speed: mode {mode + 1} grows, its damping is negative")
    for limit in _limits(diagram, limits):
        where = f"{limit['spin_rpm']:.1f} rev/min"
        whirl = f"{limit['direction']} at {limit['frequency_hz']:#.5g} Hz, {limit['whirl_ratio']:.3f} of the spin"
        if limit["grows_above"]:
            say(f"unstable from {where}: mode {limit['mode']} grows, its damping is negative; it whirls {whirl}")
        else:
            say(f"mode {limit['mode']} grows no longer from {where}; it whirls {whirl}")


def _limits(diagram: Campbell, limits: Crossings) -> list[dict[str, Any]]:
    """Where modes begin or cease to grow, for a machine."""
    above = np.searchsorted(diagram.spin_speed, limits.spin_speed, side="right").clip(max=len(diagram.spin_speed) - 1)
    return [
        {
            "mode": int(limits.mode[place]) + 1,
            "spin_rpm": float(limits.spin_speed[place] / RPM),
            "frequency_hz": float(limits.eigenvalue[place].imag / (2 * np.pi)),
            "whirl_ratio": float(limits.eigenvalue[place].imag / limits.spin_speed[place]),
            "direction": DIRECTIONS[int(limits.direction[place])],
            "grows_above": bool(grows(diagram.eigenvalue[above[place], limits.mode[place]])),
        }
        for place in range(len(limits.mode))
    ]


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
