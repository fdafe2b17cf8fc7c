"""Rigs, what their model computes, and the effects that a real rig may have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.errors import UserError, for_users
from rigtwin.rotor.effects import EFFECTS, Effect
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.frequency.whirl import RPM
from rigtwin.rotor.geometry import rig as rig_files
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model import html
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.speed_tables import SpinSpeedError
from rigtwin.sim.campaign import Channel, Run, SupportKind
from rigtwin.wording import close_to


@for_users
def load_rig(source: str | Path = "nit-rourkela") -> Rig:
    """A rig from its TOML file, or a shipped one by its name.

    Parameters
    ----------
    source : path of a rig file, or one of ``shipped_rigs()``

    Raises
    ------
    UserError : there is no such rig, or a key of the file is wrong; the message names the file and the key

    >>> import rigtwin
    >>> rig = rigtwin.load_rig("nit-rourkela")
    >>> len(rig.nodes_m), rig.length
    (7, 0.426)
    >>> rigtwin.load_rig("no-such-rig")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: no-such-rig: cannot be read (No such file or directory); ...
    """
    return rig_files.load_rig(source)


def shipped_rigs() -> list[str]:
    """Names of the rigs that come with rigtwin.

    >>> import rigtwin
    >>> "nit-rourkela" in rigtwin.shipped_rigs()
    True
    """
    return rig_files.shipped_rigs()


def refuse_tables(rig: Rig, what: str) -> None:
    """Raises UserError for a rig with supports that follow the spin speed, which ``what`` cannot take."""
    if rig.has_tables:
        raise UserError(
            f"rig {rig.name} has supports with tables, and {what} knows bearings of stiffness k_b at rest only; "
            "rigtwin modes, campbell, critical-speeds, unbalance, build and sweep take such a rig"
        )


def as_rig(rig: Rig | str | Path) -> Rig:
    """The rig itself, or the one of this name or file."""
    return rig if isinstance(rig, Rig) else rig_files.load_rig(rig)


@dataclass(frozen=True)
class ModelModes:
    """Bending modes of a rig's model in the plane y, lowest first."""

    rig: str
    frequency_hz: FloatArray  # (n_modes,) undamped
    damping_ratio: FloatArray  # (n_modes,)

    def _repr_html_(self) -> str:
        rows = [
            (place, f"{f:.4f}", f"{100 * zeta:.4f}")
            for place, (f, zeta) in enumerate(zip(self.frequency_hz, self.damping_ratio, strict=True), start=1)
        ]
        return html.table(("mode", "frequency, Hz", "damping, %"), rows, f"model of {self.rig}")


@for_users
def model_modes(
    rig: Rig | str | Path = "nit-rourkela",
    *,
    k_b: float | None = None,
    support: SupportKind = "bearing",
    effects: Sequence[Effect | str] = (),
    n_modes: int = 4,
) -> ModelModes:
    """Natural frequencies and dampings that the finite-element model of a rig has at standstill.

    Parameters
    ----------
    rig : a rig, its file or its name
    k_b : stiffness of every bearing [N/m]; default the start value of the rig file
    support : "bearing", or "rigid" for pinned bearings
    effects : linear effects of the rotor and its supports: ids, or what ``effect`` makes
    n_modes : how many

    Raises
    ------
    UserError : the rig cannot be read, or k_b is no stiffness

    >>> import rigtwin
    >>> rigtwin.model_modes(support="rigid", n_modes=2).frequency_hz.round(1)
    array([100.6, 324. ])
    >>> rigtwin.model_modes(k_b=1e7, n_modes=2).frequency_hz.round(1)
    array([ 96.5, 298. ])
    """
    rig = as_rig(rig)
    refuse_tables(rig, "model_modes")
    system = build_system(assemble(rig), _condition(rig, k_b, support), as_effects(effects)).in_plane(1)
    modes = damped_modes(system)
    return ModelModes(rig.name, modes.frequency_hz[:n_modes], modes.damping_ratio[:n_modes])


@for_users
def model_response(
    rig: Rig | str | Path,
    frequency_hz: Sequence[float] | FloatArray,
    *,
    k_b: float | None = None,
    support: SupportKind = "bearing",
    effects: Sequence[Effect | str] = (),
    excitation_node: int | None = None,
    spin_rpm: float = 0.0,
) -> Run:
    """The accelerance that the finite-element model computes, as a run without noise.

    It is solved in the frequency domain, for linear effects. ``sweep`` measures the FMU in time, and has all effects.

    Parameters
    ----------
    rig : a rig, its file or its name
    frequency_hz : (n_freq,) increasing [Hz]
    k_b, support, effects : as in ``model_modes``
    excitation_node : where the force acts, along y; default the rig's
    spin_rpm : spin [rev/min]; supports with tables have their stiffness and damping at this speed

    Returns
    -------
    a run with ``H`` (n_freq, n_nodes) in (m/s²)/N

    Raises
    ------
    UserError : the rig cannot be read, there is no such node, k_b or a frequency is not positive, or a support's
        table does not hold the spin speed

    >>> import rigtwin
    >>> run = rigtwin.model_response("nit-rourkela", [50.0, 96.5, 150.0], k_b=1e7)
    >>> run.H.shape, round(float(abs(run.channel(2)[0])), 3)
    ((3, 7), 0.038)
    """
    rig = as_rig(rig)
    node = excitation_node or rig.excitation_node
    condition = replace(_condition(rig, k_b, support, node), spin_speed=spin_rpm * RPM)
    lines = np.asarray(frequency_hz, dtype=float)
    channels = tuple(Channel(n) for n in range(1, len(rig.nodes_m) + 1))
    settings: dict[str, Any] = {"support": support, "excitation_node": node, "spin_rpm": spin_rpm}
    blank = Run(lines, np.zeros((len(lines), len(channels)), complex), channels, **settings)
    blank.check_nodes(len(rig.nodes_m))
    try:
        H = measured_response(assemble(rig), condition, as_effects(effects), lines)
    except SpinSpeedError as error:
        raise UserError(str(error)) from error
    return Run(lines, H, channels, **settings, name=f"model of {rig.name}")


def _condition(rig: Rig, k_b: float | None, support: SupportKind, node: int | None = None) -> Condition:
    """The model's condition. Raises UserError."""
    if support not in ("rigid", "bearing"):
        raise UserError(f"support is {support!r}; give 'rigid' or 'bearing'")
    try:
        return Condition(
            k_b=rig.k_b.start_N_per_m if k_b is None else k_b,
            rigid_support=support == "rigid",
            bearing_damping=rig.bearing_damping_Ns_per_m,
            shaft_damping_ratio=rig.shaft_damping_ratio,
            excitation_node=node or rig.excitation_node,
        )
    except ValueError as error:
        raise UserError(str(error)) from error


def effect_of(effect_id: str) -> type[Effect]:
    """The effect of this id. Raises UserError."""
    if effect_id in EFFECTS:
        return EFFECTS[effect_id]
    close = get_close_matches(effect_id.replace("-", "_"), EFFECTS, n=1)
    hint = f" did you mean {close[0]}?" if close else ""
    raise UserError(f"there is no effect {effect_id!r};{hint} rigtwin effects lists them all")


@for_users
def effect(effect_id: str, **values: float) -> Effect:
    """An effect of the library with its parameters and place; what is not given has its start value.

    ``rigtwin.effects()`` lists all of them.

    Raises
    ------
    UserError : there is no such effect or parameter, or its value is not possible

    >>> import rigtwin
    >>> rigtwin.effect("attached_mass", mass=0.06, node=4)
    AttachedMass(mass=0.06, node=4, half_width=0.0)
    >>> rigtwin.effect("attached_mas")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: there is no effect 'attached_mas'; did you mean attached_mass? ...
    """
    kind = effect_of(effect_id)
    for name in values:
        if name not in kind.roles():
            guess = close_to(name, kind.roles())
            raise UserError(f"{effect_id} has no parameter {name}; {guess}it has {', '.join(kind.roles())}")
    try:
        return kind(**values)
    except ValueError as error:  # says the effect and the parameter
        raise UserError(str(error)) from error


@dataclass(frozen=True)
class Effects:
    """The library of effects, in its order."""

    kinds: tuple[type[Effect], ...]

    @property
    def ids(self) -> list[str]:
        """What each is called."""
        return [kind.id for kind in self.kinds]

    def __getitem__(self, effect_id: str) -> type[Effect]:
        return effect_of(effect_id)

    def __len__(self) -> int:
        return len(self.kinds)

    def _repr_html_(self) -> str:
        rows = [(kind.id, kind.title, kind.meaning, ", ".join(kind.roles())) for kind in self.kinds]
        return html.table(("effect", "title", "what it is", "parameters and place"), rows)


def effects() -> Effects:
    """What a real rig may have and the nominal model lacks.

    >>> import rigtwin
    >>> library = rigtwin.effects()
    >>> library["open_crack"].meaning
    'an open crack adds rotational compliance at one cross-section'
    """
    return Effects(tuple(EFFECTS.values()))


def as_effects(effects: Sequence[Effect | str]) -> tuple[Effect, ...]:
    """Effects, those by their ids with start values. Raises UserError."""
    return tuple(effect_of(each)() if isinstance(each, str) else each for each in effects)
