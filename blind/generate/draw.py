"""What each campaign of the sets hides: drawn from its own seed, sizes measured, too small ones rejected."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rigtwin.blind.generate.case import GAIN_TOLERANCE, TOLERANCE, Case
from rigtwin.blind.generate.effects import (
    CHAIN,
    KINDS,
    LINEAR,
    NONLINEAR,
    STRANGERS,
    Effect,
    draw_effect,
    faded,
    least_severity,
    log_uniform,
    ranges_of,
)
from rigtwin.blind.generate.forms import FORMS, in_form, with_scale
from rigtwin.blind.generate.machine import Workshop
from rigtwin.blind.generate.nonlinear import NotFoundError, telling_levels
from rigtwin.blind.generate.rig import Rig
from rigtwin.blind.generate.sizes import LARGE, SMALL, can_fade, nominal_off, size_class, size_ratio

LIBRARY = (*LINEAR, *CHAIN, *NONLINEAR)
ATTEMPTS = 10  # draws for the wanted size class; then any that can be seen
ATTEMPTS_NONLINEAR = 6  # their sizes take long
LEAST_STRENGTH = 1e-3  # to which a nonlinear effect is weakened before another one is drawn
TYPICAL_SMALL = 10.0  # size ratio to which small nonlinear effects are steered
# size class and accelerometers, cycled through so that a third has one accelerometer
COMBINATIONS = (
    ("large", "all"),
    ("small", "all"),
    ("large", "one"),
    ("small", "all"),
    ("large", "all"),
    ("small", "one"),
)


@dataclass(frozen=True)
class Draw:
    """A case and what the label says of its sizes."""

    case: Case
    ratios: tuple[float, ...]
    rejected: int = 0  # draws that nobody could have seen
    not_periodic: int = 0  # draws whose motion could not be found at every line

    @property
    def ratio(self) -> float | None:
        return min(self.ratios) if self.ratios else None


def draw_campaign(rig: Rig, set_name: str, index: int, rng: np.random.Generator) -> Draw:
    """The index-th campaign of a set."""
    return {
        "W1": _library,
        "W2": _withheld,
        "W3": _nothing,
        "W4": _pair,
        "W5": _artefact,
        "W6": _other_form,
        "W7": _swept_size,
        "W8": _stranger,
    }[set_name](rig, index, rng)


def empty_case(rig: Rig, set_name: str, rng: np.random.Generator, *, sensors: str = "all") -> Case:
    """A rig without effects: k_b, damping, tolerances of the workshop, sensors and noise."""
    return Case(
        set=set_name,
        effects=(),
        k_b=log_uniform(rng, 3e5, 5e6),
        c_b=float(np.round(log_uniform(rng, 5, 50), 2)),
        zeta=float(np.round(rng.uniform(1e-3, 3e-3), 6)),
        workshop=Workshop(
            rng.uniform(-TOLERANCE, TOLERANCE),
            rng.uniform(-TOLERANCE, TOLERANCE),
            tuple(rng.uniform(-TOLERANCE, TOLERANCE, len(rig.disks))),
        ),
        noise=rng.uniform(0.005, 0.01),
        sensors=sensors,
        with_std=bool(rng.random() < 0.8),
        quantity="acceleration" if rng.random() < 0.1 else "accelerance",
        sensor_gains=tuple(GAIN_TOLERANCE / 2 * rng.standard_normal(len(rig.nodes))),
    )


def _decoy_levels(case: Case, rng: np.random.Generator, share: float) -> Case:
    """Some linear rigs are measured at three levels, too."""
    return replace(case, levels=(0.3, 1.0, 3.0)) if rng.random() < share else case


def _nothing(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    case = empty_case(rig, "W3", rng, sensors="one" if index % 3 == 2 else "all")
    return Draw(_decoy_levels(case, rng, 0.25), (), 0)


def _library(rig: Rig, index: int, rng: np.random.Generator, set_name: str = "W1") -> Draw:
    wanted, sensors = COMBINATIONS[(index // len(LIBRARY) + index) % len(COMBINATIONS)]
    return draw_sized(rig, empty_case(rig, set_name, rng, sensors=sensors), library_effect(index), wanted, rng)


def library_effect(index: int) -> str:
    """Which effect a campaign of W1 or W2 hides; neighbours are of different families: 7 and 30 are coprime."""
    return LIBRARY[(index * 7) % len(LIBRARY)]


def _withheld(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    draw = _library(rig, index, rng, "W2")
    return replace(draw, case=replace(draw.case, exclude=tuple(e.id for e in draw.case.effects)))


def _artefact(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    name = CHAIN[index % len(CHAIN)]
    wanted = ("large", "small")[(index // len(CHAIN)) % 2]
    return draw_sized(rig, empty_case(rig, "W5", rng), name, wanted, rng)


def _pair(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    """Two effects of different kinds; those that both planes need and those that pull at the exciter do not meet."""
    shaft = [n for n in LINEAR if KINDS[n].group == "structure"]
    support = [n for n in LINEAR if KINDS[n].group == "support"]
    chain = ["sensor_gain", "sensor_delay", "sensor_position", "sensor_mass"]
    kinds = ((shaft, support), (shaft, support), (shaft, chain), (support, chain))[index % 4]
    while True:
        names = tuple(str(rng.choice(names)) for names in kinds)
        if set(names) != {"exciter_suspension", "plane_anisotropy"}:
            break
    case = empty_case(rig, "W4", rng)
    wanted = ("large", "small")[(index // 4) % 2]
    draws = [draw_sized(rig, case, name, wanted, rng) for name in names]
    both = replace(case, effects=tuple(e for d in draws for e in d.case.effects))
    return Draw(both, tuple(r for d in draws for r in d.ratios), sum(d.rejected for d in draws))


def _other_form(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    name, form = FORMS[index % len(FORMS)]
    wanted = ("large", "small")[(index // len(FORMS)) % 2]
    return draw_sized(rig, empty_case(rig, "W6", rng), name, wanted, rng, form=form)


def _stranger(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    names = tuple(STRANGERS)
    wanted = ("large", "small")[(index // len(names)) % 2]
    return draw_sized(rig, empty_case(rig, "W8", rng), names[index % len(names)], wanted, rng)


def _swept_size(rig: Rig, index: int, rng: np.random.Generator) -> Draw:
    """An effect faded to 0.3 to 10 times its detection limit."""
    names = tuple(n for n in (*LINEAR, *CHAIN) if n not in ("coarse_grid", "fast_sweep"))
    case = empty_case(rig, "W7", rng, sensors="one" if index % 3 == 2 else "all")
    target = log_uniform(rng, 0.3, 10.0)
    for _ in range(ATTEMPTS):
        effect = draw_effect(rng, names[(index * 5) % len(names)], rig, case.sensors)
        ratio = size_ratio(rig, prepared(case, effect), effect, rng)
        if ratio > target:
            break
    weak = faded(effect, min(1.0, target / ratio), nominal_off(case))
    return Draw(replace(prepared(case, weak), effects=(weak,)), (min(target, ratio),), 0)


def prepared(case: Case, effect: Effect) -> Case:
    """The case measured in a way that can show the effect."""
    if effect.id == "force_dropout":
        case = replace(case, quantity="acceleration")
    return case


def draw_sized(
    rig: Rig, case: Case, name: str, wanted: str, rng: np.random.Generator, *, form: str = "", attempts: int = ATTEMPTS
) -> Draw:
    """An effect of this id, of the wanted size class if its range allows; draws below the limit are counted out.

    Raises ValueError where four times so many ``attempts`` show nothing.

    Where a small one is wanted and the effect can fade, it fades to a size that is log-uniform over the small ones.
    A nonlinear effect is weakened until it is small, as far as its range allows.
    """
    rejected = not_periodic = 0
    strength = 0.1 if wanted == "small" else 1.0  # of a nonlinear effect, see ``weakened``
    drawn: Effect | None = None
    best: Draw | None = None
    for attempt in range(4 * attempts):
        effect = drawn or draw_effect(rng, name, rig, case.sensors)
        try:
            draw = _sized(rig, case, in_form(effect, form, rng) if form else effect, strength, rng)
        except NotFoundError:
            not_periodic += 1
            drawn = None
            continue
        if wanted == "small" and can_fade(effect):
            draw = _small(rig, draw, rng)
        if wanted == "small" and effect.is_nonlinear:
            strength *= float(np.clip((TYPICAL_SMALL / max(draw.ratios[0], 1e-3)) ** 0.6, 0.05, 3.0))
            drawn = effect if strength > LEAST_STRENGTH else None
        if draw.ratios[0] < SMALL:
            rejected += 1
            continue
        best = draw
        if size_class(draw.ratios[0]) == wanted or attempt + 1 >= (
            min(attempts, ATTEMPTS_NONLINEAR) if effect.is_nonlinear else attempts
        ):
            break
    if best is None:
        raise ValueError(f"{4 * attempts} draws of {name} could not be seen; its range is below the detection limit")
    if not best.case.is_nonlinear and not best.case.stated:
        best = replace(best, case=_decoy_levels(best.case, rng, 0.1))
    return replace(best, rejected=rejected, not_periodic=not_periodic)


def _sized(rig: Rig, case: Case, effect: Effect, strength: float, rng: np.random.Generator) -> Draw:
    if effect.is_nonlinear:
        effect, share = weakened(effect, strength, rig)
        case = replace(case, effects=(effect,))
        case = with_levels(rig, case, share, rng)
        case = replace(case, effects=(with_scale(rig, case, effect),))
    else:
        case = replace(prepared(case, effect), effects=(effect,))
    return Draw(case, (size_ratio(rig, case, case.effects[0], rng),))


def weakened(effect: Effect, strength: float, rig: Rig) -> tuple[Effect, float]:
    """A nonlinear effect that is felt less, and the share of the force level at which it is felt well.

    Less is felt of friction at higher levels, of what is out of proportion at lower ones; a clearance closes besides, a
    stator softens, and a bilinear support, whose share of the motion does not depend on the level, fades.
    """
    match effect.id:
        case "bearing_friction":
            return _with(effect, "force", effect["force"] * strength, rig), 1 / strength
        case "bearing_clearance":  # below a level its bearing never lifts off
            return _with(effect, "gap", effect["gap"] * strength, rig), float(np.clip(4 * strength, 0.13, 1.0))
        case "rub":  # nor does the shaft touch
            return _with(effect, "stiffness", effect["stiffness"] * strength, rig), float(
                np.clip(4 * strength, 0.3, 1.0)
            )
        case "bilinear_support":
            return faded(effect, strength, {}), 1.0
    return effect, strength


def _with(effect: Effect, name: str, value: float, rig: Rig) -> Effect:
    """Another value of a parameter, as far as its range goes."""
    least = ranges_of(effect.id, rig)[name].low
    return replace(effect, parameters={**effect.parameters, name: max(value, least)})


def _small(rig: Rig, draw: Draw, rng: np.random.Generator) -> Draw:
    """The drawn effect faded to a log-uniform size among the small ones that its range allows; else as it was drawn."""
    (effect,), (ratio,) = draw.case.effects, draw.ratios
    low, high = max(SMALL / ratio, 1.001 * least_severity(effect, rig)), min(1.0, LARGE / ratio)
    if low >= high:
        return draw
    severity = log_uniform(rng, low, high)
    weak = faded(effect, severity, nominal_off(draw.case))
    return replace(draw, case=replace(draw.case, effects=(weak,)), ratios=(ratio * severity,))


def with_levels(rig: Rig, case: Case, share: float, rng: np.random.Generator) -> Case:
    """Three force levels at which the case's nonlinear effect is felt, or a share of them."""
    effect = next(e for e in case.effects if e.is_nonlinear)
    return replace(case, levels=telling_levels(rig, case.setting(False, rig.drive_node), effect, rng, share))
