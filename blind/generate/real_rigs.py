"""Set W9: rotors of three sizes, known as well as a workshop knows them.

Modulus, disks and span deviate by a workshop's tolerances, dampings by a factor, resonances drift from run to run, and
the accelerometers weigh something. ``KINDS_OF_CAMPAIGN`` says how many effects hide in which campaign.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from rigtwin.blind.generate.case import Case, Tolerances
from rigtwin.blind.generate.draw import Draw, draw_sized
from rigtwin.blind.generate.effects import CHAIN, KINDS, LINEAR, NONLINEAR, STRANGERS, Effect, log_uniform
from rigtwin.blind.generate.machine import Workshop
from rigtwin.blind.generate.rig import Rig
from rigtwin.blind.generate.sizes import size_class

ROTORS = ("nit-rourkela", "pump-overhung", "spindle")

# Kinds of campaigns, cycled through; a column is one rotor, which moves on by one with every cycle.
KINDS_OF_CAMPAIGN = (
    "nothing", "large", "two",
    "small", "nothing", "three",
    "stranger", "beside", "nothing",
    "nothing", "small", "nonlinear",
    "large", "nothing", "stranger",
    "two", "three", "nothing",
    "nothing", "stranger", "large",
    "beside", "nothing", "small",
)  # fmt: skip

WORKSHOP = Tolerances(0.01, 0.001, 0.005, shaft_damping=0.4, bearing_damping=0.7)
CLIP = 2.5  # standard deviations beyond which no deviation is drawn
MOST_DRIFT = (1e-4, 3e-3)  # range of the drift from run to run; its end in half of the campaigns
REMOUNTED = (5e-4, 3e-3)  # range of the sensors' repeatability where it is not zero
SENSOR_KG = (0.002, 0.010)  # of an accelerometer on the reference rotor
ATTEMPTS = 4  # draws of one effect before another one is taken
ATTEMPTS_NONLINEAR = 2  # the same of a nonlinear one

# A workshop does not know the modulus better than to a third of what may be drawn; sensors that stay mounted and
# one that is moved from node to node do not go together.
LEFT_OUT = ("shaft_modulus", "sensor_mass")
STEADY_CHAIN = ("sensor_gain", "sensor_delay", "sensor_position")
# Not beside a nonlinear effect: two planes, and supports whose stiffness depends on frequency.
NOT_BESIDE = ("plane_anisotropy", "viscoelastic_support")
BOTH_PLANES = {"exciter_suspension", "plane_anisotropy"}  # act along the force only, or across it too


def rotor_of(index: int) -> str:
    """Name of the index-th campaign's rotor; every kind of campaign meets every rotor."""
    return ROTORS[(index + index // len(KINDS_OF_CAMPAIGN)) % len(ROTORS)]


def kind_of(index: int) -> str:
    return KINDS_OF_CAMPAIGN[index % len(KINDS_OF_CAMPAIGN)]


def draw_real(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    """The index-th campaign."""
    case = workshop_case(rig, rng)
    wanted = ("large", "small")[(index // len(KINDS_OF_CAMPAIGN) + index) % 2]
    match kind_of(index):
        case "nothing":
            return Draw(case, ())
        case "large" | "small" as size:
            return _first_of_size(rig, case, _shuffled(_library(rig), rng), size, rng)
        case "nonlinear":
            return _first_nonlinear(rig, case, wanted, rng)
        case "stranger":
            return _first_of_size(rig, case, _shuffled(STRANGERS, rng), wanted, rng)
        case "two":
            return _several(rig, case, 2, wanted, rng)
        case "three":
            return _several(rig, case, 3, wanted, rng)
        case _:
            return _beside(rig, case, wanted, rng)


def workshop_case(rig: Rig, rng: np.random.Generator) -> Case:
    """A rig without effects, and what its workshop states of it."""
    known = replace(
        WORKSHOP,
        drift=MOST_DRIFT[1] if rng.random() < 0.5 else log_uniform(rng, *MOST_DRIFT),
        repeatability=log_uniform(rng, *REMOUNTED) if rng.random() < 0.5 else 0.0,
    )
    deviation = np.clip(rng.standard_normal(4 + len(rig.disks)), -CLIP, CLIP)
    zeta, c_b, told = _dampings(rig, known, rng)
    sensor_mass = float(f"{rng.uniform(*SENSOR_KG) * rig.scale.of('kg'):.3g}")
    force = float(f"{rig.scale.of('N'):.1g}")
    nodes = tuple(range(1, len(rig.nodes) + 1))
    return Case(
        set="W9",
        effects=(),
        k_b=log_uniform(rng, 3e5, 5e6) * rig.scale.of("N/m"),
        c_b=c_b * float(np.exp(known.bearing_damping * deviation[0])),
        zeta=zeta * float(np.exp(known.shaft_damping * deviation[1])),
        workshop=Workshop(
            known.modulus * deviation[2],
            known.span * deviation[3],
            tuple(known.disk_mass * deviation[4:]),
            sensor_mass,
            nodes,
        ),
        noise=rng.uniform(0.005, 0.01),
        levels=(force,),
        with_std=bool(rng.random() < 0.8),
        quantity="acceleration" if rng.random() < 0.1 else "accelerance",
        sensor_gains=tuple(known.gain / 2 * rng.standard_normal(len(rig.nodes))),
        drive_node=rig.drive_node,
        force=force,
        repeats=int(rng.random() < 0.4),
        tolerances=known,
        stated={**told, **_stated(known, rng), "sensor_mass_kg": sensor_mass},
    )


def _dampings(rig: Rig, known: Tolerances, rng: np.random.Generator) -> tuple[float, float, dict[str, float]]:
    """What is believed of the shaft's and the bearings' damping, and what of it is stated.

    Half of the campaigns state both with their tolerances; in the others the rig's file is believed. A file that gives
    no damping of the bearings cannot be believed, so that such a rig's campaigns always state it.
    """
    zeta, c_b = rng.uniform(1e-3, 3e-3), log_uniform(rng, 5, 50) * rig.scale.of("N s/m")
    usual = len([name for name in ROTORS if name != "nit-rourkela"]) / len(ROTORS)  # of rotors with a file to believe
    if rig.c_b and rng.random() > (0.5 - (1 - usual)) / usual:
        return rig.zeta, rig.c_b, {}
    told = {"shaft_damping_ratio": float(f"{zeta:.3g}"), "bearing_damping_Ns_per_m": float(f"{c_b:.3g}")}
    tolerances = {"shaft_damping_tolerance": known.shaft_damping, "bearing_damping_tolerance": known.bearing_damping}
    return told["shaft_damping_ratio"], told["bearing_damping_Ns_per_m"], told | tolerances


def _stated(known: Tolerances, rng: np.random.Generator) -> dict[str, float]:
    """Tolerances that are those which are taken anyway, drift and repeatability: each in a third of the campaigns."""
    usual = {name: getattr(known, name.removesuffix("_tolerance")) for name in
             ("gain_tolerance", "modulus_tolerance", "disk_mass_tolerance", "span_tolerance")}  # fmt: skip
    drift, repeatability = {"frequency_drift": known.drift}, {"gain_repeatability": known.repeatability}
    told: dict[str, float] = {}
    for some in (usual, drift, repeatability):
        if rng.random() < 1 / 3:
            told |= some
    return told


def _shuffled(names: Iterable[str], rng: np.random.Generator) -> list[str]:
    return [str(name) for name in rng.permutation(list(names))]


def _library(rig: Rig) -> list[str]:
    """Linear effects and errors of the measurement that can act on the rig and be told from what is not known."""
    names = [name for name in (*LINEAR, *CHAIN) if name not in LEFT_OUT]
    return [name for name in names if name != "disk_inertia" or not all(disk.tilts for disk in rig.disks)]


def _first_of_size(rig: Rig, case: Case, names: Sequence[str], wanted: str, rng: np.random.Generator) -> Draw:
    """The first of these effects that can have the wanted size; of any size that can be seen where none has it."""
    other: Draw | None = None
    for draw in _seen(rig, case, names, wanted, rng, ATTEMPTS):
        if draw.ratio is not None and size_class(draw.ratio) == wanted:
            return draw
        other = other or draw
    return _found(other, names)


def _first_nonlinear(rig: Rig, case: Case, wanted: str, rng: np.random.Generator) -> Draw:
    """The first nonlinear effect that can be seen; to find its size takes long, so that any will do."""
    names, case = _shuffled(NONLINEAR, rng), replace(case, repeats=0)  # three levels, and no repeat besides
    return _found(next(_seen(rig, case, names, wanted, rng, ATTEMPTS_NONLINEAR), None), names)


def _seen(
    rig: Rig, case: Case, names: Sequence[str], wanted: str, rng: np.random.Generator, attempts: int
) -> Iterator[Draw]:
    """One draw of each of these effects that can be seen; what it replaces is as it is believed."""
    for name in names:
        try:
            yield draw_sized(rig, replaced(case, (name,), rig), name, wanted, rng, attempts=attempts)
        except ValueError:  # this one cannot
            continue


def _found(draw: Draw | None, names: Sequence[str]) -> Draw:
    if draw is None:
        raise ValueError(f"none of {', '.join(names)} can be seen in this rig")
    return draw


def replaced(case: Case, names: Sequence[str], rig: Rig) -> Case:
    """The case with those dampings as they are believed that one of these effects replaces: no deviation is left."""
    told = case.stated or {}
    if "shaft_damping" in names:
        case = replace(case, zeta=told.get("shaft_damping_ratio", rig.zeta))
    if "bearing_damping" in names:
        case = replace(case, c_b=told.get("bearing_damping_Ns_per_m", rig.c_b))
    return case


def _several(rig: Rig, case: Case, count: int, wanted: str, rng: np.random.Generator) -> Draw:
    """Linear effects of different groups: shaft, supports, and of three the measurement chain, too."""
    library = _library(rig)
    groups = [[n for n in library if KINDS[n].group == group] for group in ("structure", "support")]
    groups.append([n for n in library if n in STEADY_CHAIN])
    chosen = [groups[i] for i in sorted(rng.permutation(3)[:count])]
    draws: list[Draw] = []
    for names in chosen:
        before = {e.id for d in draws for e in d.case.effects}
        left = [n for n in names if len(BOTH_PLANES & (before | {n})) < 2]
        draws.append(_first_of_size(rig, case, _shuffled(left, rng), wanted, rng))
    return _together(rig, case, draws)


def _beside(rig: Rig, case: Case, wanted: str, rng: np.random.Generator) -> Draw:
    """A nonlinear effect and, beside it, a linear one."""
    linear = [n for n in _library(rig) if n in (*LINEAR, *STEADY_CHAIN) and n not in NOT_BESIDE]
    partner = _first_of_size(rig, case, _shuffled(linear, rng), wanted, rng)
    nonlinear = _first_nonlinear(rig, case, wanted, rng)
    both = _together(rig, case, [nonlinear, partner])
    return replace(both, case=replace(both.case, levels=nonlinear.case.levels, repeats=0))


def _together(rig: Rig, case: Case, draws: Sequence[Draw]) -> Draw:
    """Several draws in one rig; each has the size that it has alone."""
    effects: tuple[Effect, ...] = tuple(e for d in draws for e in d.case.effects)
    return Draw(
        replace(replaced(case, [e.id for e in effects], rig), effects=effects),
        tuple(r for d in draws for r in d.ratios),
        sum(d.rejected for d in draws),
        sum(d.not_periodic for d in draws),
    )
