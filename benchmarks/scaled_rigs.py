"""The same answers for rigs of other sizes: ``python -m benchmarks.scaled_rigs`` writes docs/scaled-rigs.md.

Rotors of three sizes are diagnosed with the same effects in their own units, and each campaign a second time in other
units of mass, length and time. Physics cannot tell these apart, so that any difference is an absolute number in the
code.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.page import DOCS, machine, table
from rigtwin.gap.diagnose import diagnose
from rigtwin.gap.document import Cause, Diagnosis
from rigtwin.gap.phrases import part
from rigtwin.pages.diagnosis_words import cause_title, places
from rigtwin.rotor.effects import AttachedMass, BearingAsymmetry, Effect
from rigtwin.rotor.effects.scale import RigScale, scale_of
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER, measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Campaign, Channel, NominalBelief, Run, SupportKind

# A rig ten times as long, a thousand times as heavy, and three times as slow.
OTHER_UNITS = RigScale(mass=1000.0, length=10.0, time=3.0)

ROTORS = ("nit-rourkela", "pump-overhung", "spindle")
NOISE = 0.005
ZETA = 0.002
# Dampers and springs of the bearings, and an additional mass, in the rotor's own units.
C_B, K_B, MASS = 0.01, 3.0, 0.04

# Powers of mass, length and time by the end of a key of a rig file; longer ends first.
_ENDS = {
    "_Nms_per_rad": (1, 2, -1),
    "_Nm_per_rad": (1, 2, -2),
    "_kg_per_m3": (1, -3, 0),
    "_Ns_per_m": (1, 0, -1),
    "_N_per_m": (1, 0, -2),
    "stiffness": (1, 0, -2),
    "_kg_m2": (1, 2, 0),
    "_Pa": (1, -1, -2),
    "_kg": (1, 0, 0),
    "_m4": (0, 4, 0),
    "_m2": (0, 2, 0),
    "_m": (0, 1, 0),
}


# -- the same campaign in other units -------------------------------------------------------------------


def in_other_units(campaign: Campaign, units: RigScale, folder: Path) -> Campaign:
    """The campaign of a rig whose masses, lengths and times are so many times as large; its file is in a folder."""
    rig = load_rig(campaign.rig)
    table_of = _grown(rig.model_dump(exclude_none=True), units) | {"name": f"{rig.name}-scaled"}
    path = folder / f"{rig.name}-scaled.toml"
    path.write_text("".join(f"{key} = {_toml(value)}\n" for key, value in table_of.items()), encoding="utf-8")
    belief = campaign.nominal
    nominal = replace(
        belief,
        bearing_damping_Ns_per_m=belief.bearing_damping_Ns_per_m * units.of("N.s/m"),
        sensor_mass_kg=belief.sensor_mass_kg * units.of("kg"),
    )
    return replace(campaign, rig=str(path), runs=tuple(_run(run, units) for run in campaign.runs), nominal=nominal)


def _grown(value: Any, units: RigScale, key: str = "") -> Any:
    """A part of a rig file in other units."""
    if isinstance(value, Mapping):
        return {name: _grown(each, units, name) for name, each in value.items()}
    if isinstance(value, list):
        return [_grown(each, units, key) for each in value]
    powers = next((powers for end, powers in _ENDS.items() if key.endswith(end)), None)
    if powers is None or isinstance(value, (str, bool)):
        return value
    mass, length, time_ = powers
    return value * units.mass**mass * units.length**length * units.time**time_


def _toml(value: Any) -> str:
    """A value of TOML; tables are written in line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def _run(run: Run, units: RigScale) -> Run:
    response = units.of("m") / units.of("s") ** DERIVATIVE_ORDER[run.quantity]
    response /= 1.0 if run.quantity == "acceleration" else units.of("N")
    return replace(
        run,
        frequency_hz=run.frequency_hz * units.of("Hz"),
        swept_hz=None if run.swept_hz is None else run.swept_hz * units.of("Hz"),
        spin_rpm=run.spin_rpm * units.of("Hz"),
        H=run.H * response,
        std=None if run.std is None else run.std * response,
        harmonics={order: harmonic * response for order, harmonic in run.harmonics.items()},
        force_amplitude_N=None if run.force_amplitude_N is None else run.force_amplitude_N * units.of("N"),
        force_N=None if run.force_N is None else run.force_N * units.of("N"),
    )


# -- what is compared -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measured:
    """A rotor of some size, as drawn but for one effect, measured on both supports."""

    rotor: str
    effect: Effect | None

    @property
    def campaign(self) -> Campaign:
        """With noise, drifts and gains of sensors that do not change with the size."""
        structure = assemble(load_rig(self.rotor), elements_between_nodes=3)
        units, supports = scale_of(structure), ("rigid", "bearing")
        belief = NominalBelief(shaft_damping_ratio=ZETA, bearing_damping_Ns_per_m=C_B * units.of("N.s/m"))
        runs = tuple(self._run(structure, units, each, seed) for seed, each in enumerate(supports))  # type: ignore[arg-type]
        return Campaign(self.rotor, self.rotor, runs, nominal=belief)

    def _run(self, structure: Structure, units: RigScale, support: SupportKind, seed: int) -> Run:
        rig, rng = load_rig(self.rotor), np.random.default_rng(seed)
        effects = (self.effect,) if self.effect else ()
        setting = Condition(
            k_b=K_B * units.of("N/m"),
            rigid_support=support == "rigid",
            bearing_damping=C_B * units.of("N.s/m"),
            shaft_damping_ratio=ZETA,
            excitation_node=rig.excitation_node,
        )
        f = _lines(structure, setting, effects, units)
        nodes = [node for node in range(1, len(rig.nodes_m) + 1) if support == "bearing" or node not in _held(rig)]
        H = measured_response(structure, setting, effects, f, nodes)
        error = (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) / np.sqrt(2)
        std, channels = NOISE * np.abs(H), tuple(map(Channel, nodes))
        force = 1e-6 * units.of("N")
        return Run(
            f, H + std * error, channels, support, std, excitation_node=rig.excitation_node, force_amplitude_N=force,
            name=support,
        )  # fmt: skip


def _held(rig: Rig) -> set[int]:
    """Nodes that rigid supports hold."""
    return {support.node for support in rig.support}


def _lines(structure: Structure, setting: Condition, effects: Sequence[Effect], units: RigScale) -> np.ndarray:
    """Even lines up to four times the first resonance, and more round each with and without the effect [Hz]."""
    round_one, first = np.linspace(-6, 6, 25), units.of("Hz") / (2 * np.pi)
    found = [np.linspace(0.3, 4.5, 60) * first]
    for acting in ((), effects):
        modes = damped_modes(build_system(structure, setting, acting))
        found += [f * (1 + zeta * round_one) for f, zeta in zip(modes.frequency_hz, modes.damping_ratio, strict=True)]
    every = np.unique(np.concatenate(found))
    every = every[np.diff(every, prepend=0.0) > 1e-9 * every]  # lines that are one but for round-off
    return every[(every > 0.3 * first) & (every < 4.5 * first)]


def cases() -> Iterator[Measured]:
    """Every rotor without an effect, with a mass, and with unequal bearings."""
    for rotor in ROTORS:
        units = scale_of(assemble(load_rig(rotor), elements_between_nodes=3))
        yield Measured(rotor, None)
        yield Measured(rotor, AttachedMass(mass=MASS * units.mass, node=4))
        yield Measured(rotor, BearingAsymmetry(asymmetry=0.3))


# -- the page -------------------------------------------------------------------------------------------


def found_by(campaign: Campaign, exclude: Sequence[str] = ()) -> Diagnosis:
    """The diagnosis of a campaign."""
    return diagnose(campaign, exclude=exclude).diagnosis


def likeliest(diagnosis: Diagnosis) -> Cause | None:
    """The cause that is named; None where none is."""
    return diagnosis.causes[0] if diagnosis.names_a_cause else None


def _answer(diagnosis: Diagnosis) -> str:
    best = likeliest(diagnosis)
    words = diagnosis.verdict.replace("_", " ")
    return f"{words}: {cause_title(best).lower()}, {places(best)}" if best else words


def _probability(diagnosis: Diagnosis) -> float:
    best = likeliest(diagnosis)
    return best.probability if best else diagnosis.nominal["probability"]


def main() -> None:
    """Diagnose everything twice and write the page; it grows with every campaign."""
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        for case in cases():
            began = time.perf_counter()
            own = found_by(case.campaign)
            other = found_by(in_other_units(case.campaign, OTHER_UNITS, Path(folder)))
            effect = case.effect.title.lower() if case.effect else "nothing"
            difference = f"{abs(_probability(own) - _probability(other)):.0e}"
            rows.append((case.rotor, effect, _answer(own), _answer(other), part(_probability(own)), difference))
            print(*rows[-1], f"{time.perf_counter() - began:.0f} s", sep=" | ", flush=True)
            (DOCS / "scaled-rigs.md").write_text(_page(rows), encoding="utf-8")


def _page(rows: Sequence[tuple[str, ...]]) -> str:
    units, same = OTHER_UNITS, sum(own == other for _, _, own, other, *_ in rows)
    return f"""# The same rig in other units

`python -m benchmarks.scaled_rigs`, {machine()}.

Rotors of three sizes have the same effects in their own units of mass, length and time. Each campaign is diagnosed
twice with the whole library: as it is, and as that of a rig {units.length:g} times as long, {units.mass:g} times as
heavy and {units.time:g} times as slow, with every stiffness, damping, force and response scaled to suit. Nothing
physical differs, so that the answers must not. The last column is the difference of the two probabilities.

**Same answers in other units:** {same} of {len(rows)}.

{table(("rotor", "hidden", "found", "found in other units", "probability", "difference"), rows)}"""


if __name__ == "__main__":
    main()
