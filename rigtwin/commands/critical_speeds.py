"""``rigtwin critical-speeds``: undamped critical speeds over bearing stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.commands.asked_rotor import (
    DIRECTIONS,
    AskedRotor,
    RotorRequest,
    asked_rotor,
    lumped_disks,
    rotor_record,
    say_effects,
    tell,
    user_errors,
)
from rigtwin.console import say, table
from rigtwin.errors import UserError
from rigtwin.rotor.frequency.stiffness_map import (
    CriticalSpeedMap,
    Reading,
    TableReading,
    critical_speed_map,
    natural_frequency_map,
    stiffness_readings,
    table_readings,
)
from rigtwin.rotor.frequency.whirl import RPM
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.wording import exponent

if TYPE_CHECKING:
    from rigtwin.sim.campaign import Campaign


@dataclass(frozen=True)
class StiffnessRange:
    """Bearing stiffnesses of a map; None: the rig file's."""

    lowest: float | None
    highest: float | None
    n: int

    def values(self, asked: AskedRotor) -> FloatArray:
        """(n,) stiffnesses, evenly spaced in the logarithm [N/m]. Raises UserError."""
        lowest = asked.rig.k_b.min_N_per_m if self.lowest is None else self.lowest
        highest = asked.rig.k_b.max_N_per_m if self.highest is None else self.highest
        if not 0 < lowest < highest < np.inf:
            raise UserError(f"--k-b-min {lowest:g} --k-b-max {highest:g}: need 0 < k-b-min < k-b-max")
        return np.geomspace(lowest, highest, self.n)


@dataclass(frozen=True)
class Resonance:
    """A resonance that was measured on the standing rotor."""

    source: str  # run, or "peaks"
    rigid: bool
    frequency_hz: float
    readings: Sequence[Reading]  # none on rigid supports


def run_critical_speeds(request: RotorRequest, stiffnesses: StiffnessRange, n: int, folder: Path | None) -> None:
    """Compute, draw, print."""
    campaign = _campaign(folder)
    if not request.source:
        request = replace(request, source=campaign.rig if campaign else SHIPPED)
    asked = asked_rotor(request)
    k_b = stiffnesses.values(asked)
    with user_errors():
        speeds = critical_speed_map(asked.on_bearings, k_b, n)
        measured = _measured(campaign, asked, k_b) if campaign else []
        on_tables = table_readings(asked.on_bearings, speeds)
    if request.out:
        _draw(asked, speeds, measured, request.out)

    def text() -> None:
        say(f"{asked.rig.name}, undamped, on bearings of {exponent(k_b[0])} to {exponent(k_b[-1])} N/m")
        say_effects(asked)
        _print(asked, speeds, measured)
        _print_tables(asked, speeds, on_tables)

    record = {**_rotor(asked), **_record(speeds, measured), "supports_with_tables": _tables(asked, on_tables)}
    tell(request, record, text, lumped_disks(asked))


SHIPPED = "nit-rourkela"


def _rotor(asked: AskedRotor) -> dict[str, Any]:
    """What does not depend on the bearings' stiffness."""
    left_out = ("rigid_support", "k_b", "bearing_damping", "shaft_damping_ratio")
    return {name: value for name, value in rotor_record(asked).items() if name not in left_out}


def _campaign(folder: Path | None) -> Campaign | None:
    if folder is None:
        return None
    from rigtwin.sim.campaign_folder import load_campaign

    return load_campaign(folder)


def _measured(campaign: Campaign, asked: AskedRotor, k_b: FloatArray) -> list[Resonance]:
    """Resonances of the standing runs in y and of the lists, with the stiffness that each tells."""
    found = [(run.name, run.support, f) for run in campaign.runs if not run.spin_rpm for f in _frequencies(run)]
    found += [("peaks", peaks.support, float(f)) for peaks in campaign.peaks for f in peaks.frequencies_hz]
    return [
        Resonance(
            name, support == "rigid", f, () if support == "rigid" else stiffness_readings(asked.on_bearings, k_b, f)
        )
        for name, support, f in found
    ]


def _frequencies(run: Any) -> list[float]:
    """Fitted natural frequencies [Hz], or the lines at which a run peaks where nothing can be fitted."""
    from rigtwin.sim.modal_fit import ModalFitError, resonances, try_modes

    try:
        return [mode.frequency_hz for mode in try_modes(run)[0]]
    except ModalFitError:
        return resonances(run.frequency_hz, np.abs(run.H).max(axis=1))


def _print(asked: AskedRotor, speeds: CriticalSpeedMap, measured: Sequence[Resonance]) -> None:
    last = len(speeds.k_b) - 1
    decades = np.unique(np.round(np.linspace(0, last, 1 + min(last, round(np.log10(speeds.k_b[-1] / speeds.k_b[0]))))))
    columns = range(speeds.spin_speed.shape[1])
    rows = [
        (exponent(float(speeds.k_b[row])), *(f"{speeds.spin_speed[row, column] / RPM:.1f}" for column in columns))
        for row in decades.astype(int)
    ]
    header = ("k_b, N/m", *(f"{DIRECTIONS[int(speeds.direction[-1, column])]}, rev/min" for column in columns))
    table(header, rows)
    if rigid := rotor_record(asked)["rigid_body_motions"]:
        say(f"{rigid} rigid-body motions, at 0 rev/min, are left out")
    if measured:
        table(("measured", "support", "Hz", "the model at rest has it at"), map(_row, measured))


def _print_tables(asked: AskedRotor, speeds: CriticalSpeedMap, readings: Sequence[TableReading]) -> None:
    """What k_b stands for where supports have tables, and where their direct stiffness meets the map."""
    if not asked.structure.speed_tables:
        return
    say("k_b takes the place of the supports with tables: alike in y and z, without cross-coupling")
    if not readings:
        say("no direct stiffness of a table meets a line of this map")
        return
    rows = [
        (
            str(one.node),
            _COEFFICIENTS[one.plane],
            f"{one.k_b:.4g}",
            f"{one.spin_speed / RPM:.1f}",
            DIRECTIONS[int(speeds.direction[-1, one.whirl])],
        )
        for one in readings
    ]
    table(("node", "table's", "meets the map at, N/m", "rev/min", "whirl"), rows)


_COEFFICIENTS = {1: "kyy", 2: "kzz"}


def _tables(asked: AskedRotor, readings: Sequence[TableReading]) -> list[dict[str, Any]]:
    """The direct stiffnesses of supports with tables and where they meet the map, for a machine."""
    return [
        {
            "node": one.node,
            "spin_rpm": (one.spin_speed / RPM).tolist(),
            "kyy_N_per_m": one.stiffness[:, 0, 0].tolist(),
            "kzz_N_per_m": one.stiffness[:, 1, 1].tolist(),
            "meets": [
                {"of": _COEFFICIENTS[r.plane], "k_b": r.k_b, "spin_rpm": r.spin_speed / RPM, "whirl": r.whirl + 1}
                for r in readings
                if r.node == one.node
            ],
        }
        for one in asked.structure.speed_tables
    ]


def _row(one: Resonance) -> tuple[str, str, str, str]:
    frequency = f"{one.frequency_hz:#.5g}"
    if one.rigid:
        return one.source, "rigid", frequency, ""
    return one.source, "bearing", frequency, _words(one)


def _words(one: Resonance) -> str:
    return ", ".join(f"{r.k_b:.4g} N/m (mode {r.mode})" for r in one.readings) or "no stiffness of this range"


def _record(speeds: CriticalSpeedMap, measured: Sequence[Resonance]) -> dict[str, Any]:
    """The map for a machine."""
    return {
        "k_b": speeds.k_b.tolist(),
        "critical_speeds": [
            {
                "spin_rpm": (speeds.spin_speed[:, column] / RPM).tolist(),
                "direction": [DIRECTIONS[int(d)] for d in speeds.direction[:, column]],
            }
            for column in range(speeds.spin_speed.shape[1])
        ],
        "measured": [
            {
                "source": one.source,
                "support": "rigid" if one.rigid else "bearing",
                "frequency_hz": one.frequency_hz,
                "readings": [{"mode": r.mode, "k_b": r.k_b} for r in one.readings],
            }
            for one in measured
        ],
    }


def _draw(asked: AskedRotor, speeds: CriticalSpeedMap, measured: Sequence[Resonance], out: Path) -> None:
    from rigtwin.pages.rotor_figures import MeasuredResonance, critical_speed_figure, save_figure

    marks = [MeasuredResonance(one.frequency_hz, one.rigid, tuple(r.k_b for r in one.readings)) for one in measured]
    n = -(-speeds.spin_speed.shape[1] // 2)
    standing = natural_frequency_map(asked.on_bearings, speeds.k_b)[:, :n] if marks else np.zeros((len(speeds.k_b), 0))
    save_figure(critical_speed_figure(speeds, standing, marks, asked.structure.speed_tables), out)
