"""The rotor that a command is asked about: a rig, how it is held and spun, and effects."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.commands.settings import parse_effects
from rigtwin.console import note, print_json, say
from rigtwin.errors import UserError
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.stiffness_map import BearingRange
from rigtwin.rotor.frequency.whirl import RPM
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.condition import MOST_BEARING_DAMPING, Condition
from rigtwin.rotor.model.rotor_model import RotorModel, build_model
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.scratch import check_writable
from rigtwin.wording import stiffness

# Kinds of picture by the suffix of their file.
PICTURES = (".png", ".svg", ".pdf")

# Parameters with an option of their own.
_OPTIONS = {
    "k_b": "--k-b",
    "bearing_damping": "--bearing-damping",
    "shaft_damping_ratio": "--shaft-damping-ratio",
    "rigid_support": "--rigid",
    "spin_speed": "--spin-rpm",
}


@dataclass(frozen=True)
class RotorRequest:
    """What was asked for on the command line; None: as the rig file says."""

    source: str
    effects: tuple[str, ...]  # ids
    settings: tuple[str, ...]  # "id.parameter=value"
    k_b: float | None = None  # [N/m]
    rigid: bool = False
    bearing_damping: float | None = None  # [N s/m]
    shaft_damping_ratio: float | None = None
    out: Path | None = None  # picture
    as_json: bool = False


@dataclass(frozen=True)
class AskedRotor:
    """The rotor in all its parts."""

    rig: Rig
    structure: Structure
    condition: Condition
    effects: tuple[Effect, ...]

    @cached_property
    def model(self) -> RotorModel:
        """The rotor with everything that acts on it. Raises UserError where it cannot be made, or buckles."""
        with user_errors():
            model = build_model(self.structure, self.condition, self.effects)
            _ = model.system.modes  # raises where the rotor buckles
        return model

    @property
    def system(self) -> LinearSystem:
        """The supported linear rotor."""
        return self.model.system

    @property
    def on_bearings(self) -> BearingRange:
        """The same on bearings of any stiffness."""
        return BearingRange(self.structure, replace(self.condition, rigid_support=False), self.effects)

    def also_with(self, effects: Sequence[Effect]) -> AskedRotor:
        """The same with more effects."""
        return replace(self, effects=(*self.effects, *effects))


def asked_rotor(request: RotorRequest) -> AskedRotor:
    """The rotor of a request. Raises UserError for options that contradict each other, RigError."""
    if request.out:
        check_picture(request.out)
    effects = _effects(request)
    for option, value in (("--k-b", request.k_b), ("--bearing-damping", request.bearing_damping)):
        if request.rigid and value is not None:
            raise UserError(f"{option} does nothing beside --rigid, which replaces the bearings: leave one of them out")
    rig = load_rig(request.source)
    _check_bearings(rig, request, effects)
    given = (request.bearing_damping, request.shaft_damping_ratio)
    bearing_damping, shaft_damping_ratio = (
        own if value is None else value
        for value, own in zip(given, (rig.bearing_damping_Ns_per_m, rig.shaft_damping_ratio), strict=True)
    )
    if bearing_damping > MOST_BEARING_DAMPING:
        raise UserError(f"--bearing-damping {bearing_damping:g}: at most {MOST_BEARING_DAMPING:g} N s/m")
    structure = assemble(rig)
    with user_errors():
        condition = Condition(
            k_b=rig.k_b.start_N_per_m if request.k_b is None else request.k_b,
            rigid_support=request.rigid,
            bearing_damping=bearing_damping,
            shaft_damping_ratio=shaft_damping_ratio,
            excitation_node=rig.excitation_node,
            spin_speed=structure.lowest_spin_speed,
        )
    return AskedRotor(rig, structure, condition, effects)


def _check_bearings(rig: Rig, request: RotorRequest, effects: Sequence[Effect]) -> None:
    """Raises UserError for what acts on bearings, where a rig has none."""
    if rig.has_bearings:
        return
    given = {"--k-b": request.k_b, "--bearing-damping": request.bearing_damping, "--rigid": request.rigid or None}
    options = [option for option, value in given.items() if value is not None]
    options += [f"--effect {effect.id}" for effect in effects if effect.location == "bearings"]
    if options:
        raise UserError(
            f'{options[0]} acts on supports with stiffness = "k_b", and rig {rig.name} has none: leave it out'
        )


def check_picture(out: Path) -> None:
    """Refuse before computing what could not be drawn after it. Raises UserError, OSError."""
    if out.suffix.lower() not in PICTURES:
        raise UserError(f"--out {out}: unknown kind of picture; give a name that ends in {', '.join(PICTURES)}")
    if not out.parent.is_dir():
        raise UserError(f"--out {out}: the folder {out.parent} does not exist; create it first")
    check_writable(out)


def _effects(request: RotorRequest) -> tuple[Effect, ...]:
    """Effects that change the linear rotor. Raises UserError for others, and for settings that belong to none."""
    effects, others = parse_effects(request.effects, request.settings)
    for setting in others:
        name = setting.partition("=")[0]
        if name in _OPTIONS:
            raise UserError(f"--set {setting}: use {_OPTIONS[name]} for this")
        raise UserError(f"--set {setting}: write ID.PARAMETER=VALUE, for an effect that --effect switches on")
    for effect in effects:
        if reason := _no_part_of_the_linear_rotor(effect):
            raise UserError(f"--effect {effect.id}: {reason}")
    return effects


def _no_part_of_the_linear_rotor(effect: Effect) -> str:
    """Why an effect changes no mode; empty where it may."""
    if effect.family == "chain":
        return "belongs to the measurement and changes no mode; rigtwin sweep has it"
    if effect.family == "nonlinear":
        return "is a force law, and modes are those of a linear rotor; rigtwin sweep has it"
    if effect.turns_with_shaft:
        return "is a force and changes no mode; rigtwin unbalance computes what it does"
    return ""


@contextmanager
def user_errors() -> Iterator[None]:
    """What the rotor refuses is the user's input."""
    try:
        yield
    except np.linalg.LinAlgError:
        raise
    except ValueError as error:
        raise UserError(str(error)) from error


# -- words ---------------------------------------------------------------------------------------


def held(asked: AskedRotor) -> str:
    """'nit-rourkela on bearings of 10.00 MN/m, 20 N s/m'."""
    condition, tables = asked.condition, len(asked.structure.speed_tables)
    words = ["on rigid supports" if condition.rigid_support else _bearings(condition)] if asked.rig.has_bearings else []
    if tables:
        low, high = (speed / RPM for speed in asked.structure.spin_range)
        supports = "a support with a table" if tables == 1 else f"{tables} supports with tables"
        words.append(f"{'' if words else 'on '}{supports} from {low:.6g} to {high:.6g} rev/min")
    return f"{asked.rig.name} {' and '.join(words)}"


def _bearings(condition: Condition) -> str:
    return f"on bearings of {stiffness(condition.k_b)} MN/m, {condition.bearing_damping:g} N s/m"


def say_rotor(asked: AskedRotor, more: str = "") -> None:
    """Print what is computed: the rotor, its supports, its effects."""
    say(f"{held(asked)}{more}; shaft damping ratio {asked.condition.shaft_damping_ratio:g}")
    say_effects(asked)


def say_effects(asked: AskedRotor) -> None:
    """Print the effects with their numbers."""
    for effect in asked.effects:
        values = ", ".join(f"{name} = {getattr(effect, name):g}" for name in effect.roles())
        say(f"with {effect.id}: {values}")


def rotor_record(asked: AskedRotor) -> dict[str, Any]:
    """The same for a machine."""
    condition = asked.condition
    no_bearings = condition.rigid_support or not asked.rig.has_bearings
    return {
        "rig": asked.rig.name,
        "rigid_support": condition.rigid_support,
        "k_b": None if no_bearings else condition.k_b,
        "bearing_damping": None if no_bearings else condition.bearing_damping,
        "shaft_damping_ratio": condition.shaft_damping_ratio,
        "effects": {effect.id: {name: getattr(effect, name) for name in effect.roles()} for effect in asked.effects},
        "rigid_body_motions": int(np.count_nonzero(~asked.system.modes.elastic)),
    }


def lumped_disks(asked: AskedRotor) -> str:
    """A remark where disks lack the moments of inertia that a spinning rotor feels; empty where they do not."""
    nodes = [str(disk.node) for disk in asked.rig.disk if not disk.inertia and disk.own_polar_inertia]
    if not nodes or any(effect.family == "spinning" for effect in asked.effects):
        return ""
    where = f"disk at node {nodes[0]} has" if len(nodes) == 1 else f"disks at nodes {', '.join(nodes)} have"
    return (
        f"in the rig file the {where} mass but no moments of inertia, and so no gyroscopic moments; "
        "inertia = true adds them"
    )


def tell(request: RotorRequest, record: Mapping[str, Any], text: Callable[[], None], remark: str = "") -> None:
    """Print the answer: JSON of the record, or text, with a remark on stderr and the name of the picture."""
    if request.as_json:
        print_json({**record, "picture": str(request.out) if request.out else None})
        return
    text()
    if remark:
        note(remark)
    if request.out:
        say(f"{request.out} written")


DIRECTIONS = {1: "forward", -1: "backward", 0: "planar"}
