"""The model of the measured runs: rotors built and solved, in modal form where they are linear.

A candidate is a tuple of effects. Its rotor is built and solved by ``rotor``; ``linear`` says what is kept of a
linear one, ``nonlinear`` of the others, ``tolerances`` how a workshop's tolerances bend either.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import numpy as np

from rigtwin.gap.model.branch import Known
from rigtwin.gap.model.linear import MODES, Group, Modal, chain_factors, holds, over_receptance, resonance_numbers
from rigtwin.gap.model.motions import FINE, Resolution
from rigtwin.gap.model.nonlinear import NonlinearModal
from rigtwin.gap.model.run_model import RunModel
from rigtwin.gap.model.tolerances import Bend, bend_of, bend_residues, sensitivity_of
from rigtwin.gap.model.workshop import Anchor, Workshop
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.effects.structure import known_mass
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.measured import channel_groups
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model
from rigtwin.rotor.model.state_space import StateSpace, UpperResidual
from rigtwin.rotor.model.structure import Structure
from rigtwin.rotor.model.system import LinearSystem
from rigtwin.sim.campaign import Channel, NominalBelief, Run

T = TypeVar("T")


@dataclass(frozen=True)
class ModelSize:
    """How much of a rotor is kept and remembered."""

    kept_ratio: float = 50.0  # modes above so many times the highest line are taken as quasi-static, ...
    kept: float = 200.0  # ... and none below so many times the lowest bending frequency on rigid supports
    # Resonances below so many times the highest line may drift. Some above the lines are among them: between
    # resonances, where the response nearly vanishes, their drifts are seen.
    drifting_ratio: float = 6.0
    structures: int = 32  # with tolerances, each some 300 kB: those of a few steps of a nonlinear fit
    remembered: int = 8  # balances, sensitivities: those of a candidate's runs
    rotors: int = 4096  # each some 10 kB: those of many candidates
    corner: float = 1e-4  # of laws with a gap, rounded by this share of it: more is a stiffness that is felt at rest
    # Samples of a period are taken one after the other where a law has memory. With 256 a motion is within 5e-5 of that
    # with 2048, relative to its peak, where friction sticks, slips now and then, and slips throughout.
    hysteresis_samples: int = 256


_SIZE = ModelSize()


@dataclass(frozen=True)
class _Rotor:
    """Modes of a rotor as a group of channels sees them."""

    poles: ComplexArray  # (n_states,)
    residues: ComplexArray  # (n_channels + 1, n_states)
    upper: UpperResidual
    sensitivity: ComplexArray  # (MODES, n_tolerances)


@dataclass(frozen=True)
class _Mesh:
    """A meshed rotor at an anchor, or with one of its tolerances a step larger."""

    FINE: ClassVar[int] = -2
    PLAIN: ClassVar[int] = -1

    anchor: Anchor
    number: int = PLAIN  # or from 0 the tolerance that is larger

    @property
    def key(self) -> tuple[bytes, int]:
        """What tells it from others."""
        return self.anchor.key, self.number

    @property
    def structure(self) -> Structure:
        """The rotor without its supports."""
        if self.number < 0:
            return self.anchor.structure if self.number == self.PLAIN else self.anchor.fine
        return self.anchor.variants[self.number]


@dataclass(frozen=True)
class Manner:
    """How finely responses are made."""

    refined: bool = False  # whether effects inside an element have the finer mesh
    resolution: Resolution = FINE  # of nonlinear motions
    with_data: bool = True  # whether a run's values say which branch a nonlinear motion is on
    images: bool = True  # whether a fast sweep's transients are seen with their images


class Forward:
    """Makes the modal form of runs on one rotor; remembers what it made last.

    The model is exact at its anchor, tolerances of the workshop's numbers; near it, it follows them to first order.

    Parameters
    ----------
    workshop : the rig and what is known of it, meshed finely enough: its own error must not look like an effect
    """

    def __init__(self, workshop: Workshop):
        self.workshop = workshop
        self.anchor = workshop.anchor(np.zeros(len(workshop.tolerances)))
        self.manner = Manner()
        self.beside: tuple[Effect, ...] = ()
        self._known: dict[tuple, Known] = {}
        self._rotors: dict[tuple, _Rotor] = {}
        self._structures: dict[tuple, Structure] = {}
        self._balances: dict[tuple, Balance | None] = {}
        self._sensitivities: dict[tuple, ComplexArray] = {}
        self._bends: dict[tuple, list[Bend]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Another process gets no rotors and structures: they are many."""
        return self.__dict__ | {"_rotors": {}, "_structures": {}}

    @property
    def structure(self) -> Structure:
        """The rotor without its supports, at the anchor."""
        return self.anchor.structure

    @property
    def belief(self) -> NominalBelief:
        """What the campaign says of the rig."""
        return self.workshop.belief

    def at(self, tolerance: FloatArray) -> Forward:
        """The same model, exact at these tolerances (n_tolerances,)."""
        other = copy.copy(self)
        other.anchor = self.workshop.anchor(tolerance)
        return other

    def settled(self, tolerance: FloatArray) -> bool:
        """Whether a fit that has come to these tolerances (n_tolerances,) would go nowhere else from there."""
        moved = np.abs(tolerance - self.anchor.values)
        return bool(np.all(moved <= [each.settled for each in self.workshop.tolerances]))

    def bend(self, run: Run, k_b: float, effects: Sequence[Effect]) -> None:
        """Find how the tolerances bend the modes of a run under these effects, near these numbers.

        Frequencies follow the tolerances in every candidate's own modes; shapes change by what they change in the
        nominal model, or in the candidate itself once this has been called for it.
        """
        plain = self._modal_on(_Mesh(self.anchor), self.condition(run, k_b), run, effects, bends=())
        meshes = (_Mesh(self.anchor, number) for number in range(len(self.anchor.values)))
        others = [
            self._modal_on(mesh, self.condition(run, k_b, tolerance), run, effects, bends=())
            for mesh, tolerance in zip(meshes, self.anchor.stepped, strict=True)
        ]
        self._bends[self._kind(run, effects)] = [
            bend_of(plain, each, [other.groups[g] for other in others]) for g, each in enumerate(plain.groups)
        ]

    def _bends_of(self, run: Run, k_b: float, effects: Sequence[Effect]) -> Sequence[Bend]:
        """Of these effects, or of the first ones of them that are known, down to the nominal model."""
        if not self.anchor.values.size:
            return ()
        for count in range(len(effects), -1, -1):
            known = self._bends.get(self._kind(run, effects[:count]))
            if known is not None:
                return known
        self.bend(run, k_b, ())
        return self._bends[self._kind(run, ())]

    def _kind(self, run: Run, effects: Sequence[Effect]) -> tuple:
        """What a bend belongs to: an anchor, a run, and effects at their nodes, whatever their numbers."""
        there = on_the_rotor(effects)
        nodes = [tuple(getattr(e, name) for name, place in e.places().items() if place.kind == "node") for e in there]
        return self.anchor.key, _key(run), tuple((e.id, *at) for e, at in zip(there, nodes, strict=True))

    def made(self, **manner: Any) -> Forward:
        """The same model with another ``Manner`` of making responses; both share what they remember."""
        other = copy.copy(self)
        other.manner = replace(self.manner, **manner)
        return other

    def on_rotor_with(self, effects: Sequence[Effect]) -> Forward:
        """The same model on a rotor that has these effects, whatever is added."""
        other = copy.copy(self)
        other.beside = tuple(effects)
        return other

    def forget(self) -> None:
        """Drop the motions that nonlinear candidates start from."""
        self._known.clear()

    def condition(self, run: Run, k_b: float, tolerance: FloatArray | None = None) -> Condition:
        """The test condition of a run, with the dampings at the anchor or at other tolerances."""
        belief = self.anchor.belief if tolerance is None else self.workshop.belief_at(tolerance)
        return Condition(
            k_b=k_b,
            rigid_support=run.support == "rigid",
            bearing_damping=belief.bearing_damping_Ns_per_m,
            shaft_damping_ratio=belief.shaft_damping_ratio,
            excitation_node=run.excitation_node,
            excitation_plane=1 if run.excitation_plane == "y" else 2,
            spin_speed=run.spin_rpm * np.pi / 30,
        )

    def modal(self, run: Run, k_b: float, effects: Sequence[Effect] = ()) -> RunModel:
        """The run's response with these effects. Raises ValueError where an effect is impossible."""
        effects = (*effects, *acting(self.beside, run.support))
        if nonlinear(effects):
            return self._nonlinear(run, k_b, effects)
        return self._linear(run, k_b, effects)

    def receptance(self, run: Run, k_b: float, driven: int, nodes: Sequence[int]) -> ComplexArray:
        """(n_freq, n_nodes) of the nominal rotor, a node driven along the run's force, at the run's lines [m/N]."""
        channels = tuple(Channel(node, run.excitation_plane) for node in nodes)
        H = np.zeros((len(run.frequency_hz), len(nodes)), dtype=complex)
        there = replace(run, channels=channels, H=H, std=None, harmonics={}, excitation_node=driven)
        return self.modal(there, k_b).response() / over_receptance(there)[:, None]

    def _linear(self, run: Run, k_b: float, effects: Sequence[Effect]) -> Modal:
        local = self.manner.refined and any(effect.needs_finer_mesh for effect in effects)
        mesh = _Mesh(self.anchor, _Mesh.FINE if local else _Mesh.PLAIN)
        return self._modal_on(mesh, self.condition(run, k_b), run, effects, self._bends_of(run, k_b, effects))

    def _modal_on(
        self, mesh: _Mesh, condition: Condition, run: Run, effects: Sequence[Effect], bends: Sequence[Bend]
    ) -> Modal:
        """The run's response on a mesh, with these bends by the tolerances."""
        omega = 2 * np.pi * run.frequency_hz
        nodes = sorted({channel.node for channel in run.channels})
        groups, sensitivity = [], np.zeros((MODES, len(self.anchor.values)), dtype=complex)
        for group in channel_groups(effects, nodes):
            columns = np.array([c for c, channel in enumerate(run.channels) if channel.node in group.nodes])
            made, sensitivity = self._group(mesh, run, omega, condition, group.effects, columns, bends)
            groups.append(made)
        exact, scale, images = self.anchor.values, over_receptance(run), self.manner.images
        return Modal(run, omega, tuple(groups), tuple(effects), sensitivity, exact, scale, images)

    def _nonlinear(self, run: Run, k_b: float, effects: Sequence[Effect]) -> RunModel:
        effects, manner, anchor = tuple(effects), self.manner, self.anchor.values
        mounted, condition = (*effects, *self._mounted(run)), self.condition(run, k_b)
        plain = self._balance(condition, mounted, anchor)
        if plain is None:
            return self._linear(run, k_b, [e for e in effects if e.family != "nonlinear"])
        top = 2 * np.pi * _SIZE.drifting_ratio * run.frequency_hz[-1]

        def balance(tolerance: FloatArray) -> tuple[Balance, IntArray]:
            made = self._balance(self.condition(run, k_b, tolerance), mounted, tolerance)
            assert made is not None  # no tolerance takes a law away
            return made, resonance_numbers(made.values, top)

        numbers = np.array([k_b, *(getattr(e, name) for e in effects for name in e.parameters())])
        mode, key = resonance_numbers(plain.values, top), (self.anchor.key, condition, mounted, effects)
        sensitivity = _remember(self._sensitivities, key, lambda: self._sensitivity(plain.system, effects))
        known, finely = self._known, manner.resolution
        return NonlinearModal(
            run, balance, plain, mode, sensitivity, anchor, effects, numbers, known, finely, manner.with_data
        )

    def _balance(self, condition: Condition, effects: tuple[Effect, ...], tolerance: FloatArray) -> Balance | None:
        """A rotor under nonlinear effects, None where no law acts; runs at several levels share it."""

        def make() -> Balance | None:
            model = build_model(self._structure_with(tolerance), condition, effects)
            if not model.forces:
                return None
            samples = min(finely.samples, _SIZE.hysteresis_samples) if model.memory else finely.samples
            made = Balance(model, condition, harmonics=finely.harmonics, samples=samples, corner=_SIZE.corner)
            if made.values.ndim > 1:
                raise ValueError("a rotor without a full set of eigenvectors has no modal form")
            return made

        finely = self.manner.resolution
        return _remember(self._balances, (self.anchor.key, condition, effects, tolerance.tobytes(), finely), make)

    def _structure_with(self, tolerance: FloatArray) -> Structure:
        """The rotor with the workshop's tolerances, exact; all numbers of a law share it."""
        make = partial(self.workshop.structure, tolerance)
        return _remember(self._structures, (tolerance.tobytes(),), make, _SIZE.structures)

    def _mounted(self, run: Run) -> tuple[Effect, ...]:
        """The mass of every accelerometer of a run, where the campaign states it."""
        mass = self.belief.sensor_mass_kg
        return tuple(known_mass(mass, node) for node in sorted({c.node for c in run.channels})) if mass else ()

    def _sensitivity(self, system: LinearSystem, effects: Sequence[Effect]) -> ComplexArray:
        replaced = {role.null for e in effects for role in e.parameters().values() if isinstance(role.null, str)}
        return sensitivity_of(system, self.workshop.tolerances, replaced)

    def _group(
        self,
        mesh: _Mesh,
        run: Run,
        omega: FloatArray,
        condition: Condition,
        effects: Sequence[Effect],
        columns: IntArray,
        bends: Sequence[Bend],
    ) -> tuple[Group, ComplexArray]:
        acting = (*effects, *self._mounted(run))
        rotor = self._rotor(mesh, run, condition, acting, tuple(run.channels[c] for c in columns))
        mode = resonance_numbers(rotor.poles, 2 * np.pi * _SIZE.drifting_ratio * run.frequency_hz[-1])
        rest = rotor.upper.receptance(omega)[:, :, 0]
        known = next((bend for bend in bends if holds(bend.columns, columns)), None)
        n = len(self.anchor.values)
        bent, aside = bend_residues(known, n, omega, columns, rotor.poles, rotor.residues, mode)
        made = Group(
            columns, rotor.poles, rotor.residues, mode, rest, chain_factors(effects, run, columns), bent, aside
        )
        sensitivity = rotor.sensitivity.astype(complex)
        if known is not None:
            sensitivity += known.missed
        return made, sensitivity

    def _rotor(
        self, mesh: _Mesh, run: Run, condition: Condition, effects: tuple[Effect, ...], channels: tuple[Channel, ...]
    ) -> _Rotor:
        """A rotor's modes as seen by some channels, remembered for all runs on the same rotor.

        k_b does not change the rotor on rigid supports; effects on drive and sensors never do.
        """
        lowest = self.workshop.scale.of("Hz") / (2 * np.pi)
        limit = max(_SIZE.kept * lowest, _SIZE.kept_ratio * run.frequency_hz[-1])
        if condition.rigid_support:
            condition = replace(condition, k_b=Condition.k_b)
        effects = on_the_rotor(effects)
        key = (*mesh.key, condition, effects, channels, limit)
        make = partial(self._solve, mesh.structure, condition, effects, channels, limit)
        return _remember(self._rotors, key, make, _SIZE.rotors)

    def _solve(
        self,
        structure: Structure,
        condition: Condition,
        effects: Sequence[Effect],
        channels: Sequence[Channel],
        limit_hz: float,
    ) -> _Rotor:
        model = build_model(structure, condition, effects)
        if model.forces:
            raise ValueError("a nonlinear rotor has no modal form")
        system = model.system
        exciter = system.unit_vector(condition.excitation_node, condition.excitation_plane)
        plane = system.plane_of_motion(exciter, condition.spin_speed)
        if plane:
            inside = system.plane == plane
            system, exciter = system.in_plane(plane), exciter[inside]
        rows = [system.read_out(1 if channel.plane == "y" else 2)[channel.node - 1] for channel in channels]
        outputs = np.vstack([*rows, exciter])
        # Dashpots in series with springs couple even modes far above, and so does spin.
        space = StateSpace(
            system, condition.spin_speed, np.inf if len(system.massless) or condition.spin_speed else limit_hz
        )
        poles, residues = space.poles(exciter[:, None], outputs)
        upper = space.upper_residual(exciter[:, None], outputs)
        return _Rotor(poles, residues[:, 0], upper, self._sensitivity(system, effects))


def _remember(store: dict[tuple, T], key: tuple, make: Callable[[], T], most: int = _SIZE.remembered) -> T:
    """The stored value of a key, made if it is new; the oldest value goes when the store is full."""
    if key not in store:
        if len(store) >= most:
            store.pop(next(iter(store)))
        store[key] = make()
    return store[key]


def acting(effects: Iterable[Effect], support: str) -> tuple[Effect, ...]:
    """The effects that a support lets act."""
    absent = "bearings" if support == "rigid" else "rigid_support"
    return tuple(effect for effect in effects if effect.location != absent)


def on_the_rotor(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects that change the rotor or its supports; the others change how it is driven and read."""
    return tuple(effect for effect in effects if type(effect).add_to is not Effect.add_to)


def nonlinear(effects: Iterable[Effect]) -> bool:
    """Whether one of the effects is nonlinear: such a rotor has no modal form."""
    return any(effect.family == "nonlinear" for effect in effects)


def _key(run: Run) -> tuple:
    settings = run.support, run.excitation_node, run.excitation_plane, run.spin_rpm
    return *settings, run.channels, run.frequency_hz.tobytes()
