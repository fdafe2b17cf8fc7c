"""``rigtwin unbalance``: steady response to unbalance over spin speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigtwin.commands.asked_rotor import (
    AskedRotor,
    RotorRequest,
    asked_rotor,
    lumped_disks,
    rotor_record,
    say_rotor,
    tell,
    user_errors,
)
from rigtwin.commands.campbell import SpeedRange
from rigtwin.console import say, table
from rigtwin.errors import UserError
from rigtwin.rotor.effects import unbalance_at
from rigtwin.rotor.frequency.shapes import semi_axes
from rigtwin.rotor.frequency.whirl import (
    RPM,
    speeds_through_resonances,
    synchronous_whirls,
    unbalance_response,
    unstable_speeds,
)
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray

# Evenly spaced speeds at which a rotor is asked whether it is stable.
_LOOKED_AT = 61

# Lowest speed where none is given, over the highest.
_LOWEST = 0.01


@dataclass(frozen=True)
class Weights:
    """Unbalances as they are given: a moment for each node or one for all, and so the phases."""

    nodes: tuple[int, ...]  # none: the node of the heaviest disk
    moments: tuple[float, ...]  # [kg m]
    phases_deg: tuple[float, ...]  # from y towards z

    def placed(self, rig: Rig) -> list[tuple[int, float, float]]:
        """Node, moment [kg m] and phase [degrees] of each. Raises UserError."""
        nodes = self.nodes or (_heaviest_disk(rig),)
        moments = _for_each("--moment", self.moments, len(nodes))
        phases = _for_each("--phase-deg", self.phases_deg, len(nodes))
        for moment in moments:
            if not 0 < moment < np.inf:
                raise UserError(f"--moment {moment:g}: give a positive unbalance in kg m (1 g mm is 1e-6 kg m)")
        for phase in phases:
            if not -360 <= phase <= 360:
                raise UserError(f"--phase-deg {phase:g}: give an angle between -360 and 360 degrees")
        for node in nodes:
            _check_node("--node", node, rig)
        return list(zip(nodes, moments, phases, strict=True))


def _heaviest_disk(rig: Rig) -> int:
    if not rig.disk:
        raise UserError(f"rig {rig.name} has no disk: say with --node where the unbalance is")
    return max(rig.disk, key=lambda disk: disk.mass).node


def _for_each(option: str, values: tuple[float, ...], n: int) -> tuple[float, ...]:
    if len(values) not in (1, n):
        raise UserError(
            f"{option}: given {len(values)} times for {n} node{'s' * (n != 1)}; give it once for all, or once for each"
        )
    return values * (n if len(values) == 1 else 1)


def _check_node(option: str, node: int, rig: Rig) -> None:
    if not 1 <= node <= len(rig.nodes_m):
        raise UserError(f"{option} {node}: there is no such node, rig {rig.name} has nodes 1 to {len(rig.nodes_m)}")


def run_unbalance(request: RotorRequest, weights: Weights, speeds: SpeedRange, read: tuple[int, ...]) -> None:
    """Compute, draw, print."""
    speeds.check()
    asked = asked_rotor(request)
    placed = weights.placed(asked.rig)
    for node in read:
        _check_node("--read", node, asked.rig)
    unbalanced = asked.also_with([unbalance_at(node, moment, np.radians(phase)) for node, moment, phase in placed])
    nodes = tuple(dict.fromkeys(read)) or _moving(asked)
    with user_errors():
        lowest, highest = speeds.ends(asked, _LOWEST)
        spin_speed = speeds_through_resonances(asked.system, lowest, highest, speeds.n)
        critical = synchronous_whirls(asked.system, lowest, highest)
        unstable = unstable_speeds(asked.system, np.linspace(lowest, highest, _LOOKED_AT))
        response = unbalance_response(unbalanced.model, spin_speed)[:, :, [node - 1 for node in nodes]]
    met = critical.spin_speed[(critical.direction >= 0) | bool(asked.structure.speed_tables)]
    if request.out:
        from rigtwin.pages.rotor_figures import save_figure, unbalance_figure

        save_figure(unbalance_figure(spin_speed, response, nodes, met), request.out)

    def text() -> None:
        say_rotor(asked)
        for node, moment, phase in placed:
            say(f"unbalance of {moment:g} kg m at node {node}, {phase:g} degrees from y towards z")
        if not asked.system.C.any():
            say("the rotor has no damping: at its critical speeds the response is infinite")
        if len(unstable):
            low, high = unstable[[0, -1]] / RPM
            say(f"unstable from about {low:.0f} to {high:.0f} rev/min: there no steady response is ever reached")
        _print(spin_speed, response, nodes, met)

    given = {"unbalances": [{"node": n, "moment_kg_m": m, "phase_deg": p} for n, m, p in placed]}
    record = {**rotor_record(asked), **given, **_record(spin_speed, response, nodes, met)}
    record["unstable_rpm"] = (unstable / RPM).tolist()
    tell(request, record, text, lumped_disks(asked))


def _moving(asked: AskedRotor) -> tuple[int, ...]:
    """Nodes that can move."""
    moves = np.abs(asked.system.read_out(1)).sum(axis=1) + np.abs(asked.system.read_out(2)).sum(axis=1) > 0
    return tuple((np.flatnonzero(moves) + 1).tolist())


def _print(spin_speed: FloatArray, response: ComplexArray, nodes: Sequence[int], critical: FloatArray) -> None:
    say(f"{len(spin_speed)} speeds from {spin_speed[0] / RPM:.0f} to {spin_speed[-1] / RPM:.0f} rev/min")
    say("critical speeds, rev/min: " + (", ".join(f"{speed / RPM:.1f}" for speed in critical) or "none"))
    rows = []
    for place, node in enumerate(nodes):
        y, z = response[:, 0, place], response[:, 1, place]
        major, minor = semi_axes(y, z)
        top = int(np.argmax(major))
        rows.append(
            (
                str(node),
                f"{1e6 * major[top]:.4g}",
                f"{spin_speed[top] / RPM:.1f}",
                f"{np.degrees(np.angle(y[top])):.1f}",
                f"{1e6 * minor[top]:.4g}",
                f"{1e6 * major[-1]:.4g}",
            )
        )
    header = ("node", "largest, µm", "at, rev/min", "phase of y, °", "minor semi-axis, µm", "at the highest speed, µm")
    table(header, rows)


def _record(
    spin_speed: FloatArray, response: ComplexArray, nodes: Sequence[int], critical: FloatArray
) -> dict[str, Any]:
    """The response for a machine."""
    found = []
    for place, node in enumerate(nodes):
        y, z = response[:, 0, place], response[:, 1, place]
        major, minor = semi_axes(y, z)
        found.append(
            {
                "node": node,
                "y_re": y.real.tolist(),
                "y_im": y.imag.tolist(),
                "z_re": z.real.tolist(),
                "z_im": z.imag.tolist(),
                "major_semi_axis_m": major.tolist(),
                "minor_semi_axis_m": minor.tolist(),
            }
        )
    speeds = {"spin_rpm": (spin_speed / RPM).tolist(), "critical_speeds_rpm": (critical / RPM).tolist()}
    return speeds | {"nodes": found}
