"""The model of the measured runs: rotors built and solved, in modal form where they are linear.

A candidate is a tuple of effects. Its rotor is built and solved by ``rotor``; ``linear`` says what is kept of a
linear one, ``nonlinear`` of the others, ``tolerances`` how a workshop's tolerances bend either.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from rigtwin.gap.model.branch import Known
from rigtwin.gap.model.linear import MODES, TOLERANCES, Group, Modal, chain_factors, over_receptance, resonance_numbers
from rigtwin.gap.model.motions import FINE, Resolution
from rigtwin.gap.model.nonlinear import NonlinearModal
from rigtwin.gap.model.run_model import RunModel
from rigtwin.gap.model.tolerances import STEP, Bend, bend_of, bend_residues, sensitivity_of, variants_of
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.measured import channel_groups
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray, IntArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model
from rigtwin.rotor.model.state_space import StateSpace, UpperResidual
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Channel, NominalBelief, Run

T = TypeVar("T")


@dataclass(frozen=True)
class ModelSize:
    """How much of a rotor is kept and remembered."""

    kept_ratio: float = 50.0  # modes above so many times the highest line are taken as quasi-static, ...
    kept_hz: float = 20e3  # ... and none below this frequency [Hz]
    # Resonances below so many times the highest line may drift. The next one above the lines is among them: between
    # resonances, where the response nearly vanishes, its drift is seen.
    drifting_ratio: float = 3.0
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
    sensitivity: FloatArray  # (MODES, n_tolerances)


@dataclass(frozen=True)
class Manner:
    """How finely responses are made."""

    refined: bool = False  # whether effects inside an element have the finer mesh
    resolution: Resolution = FINE  # of nonlinear motions
    with_data: bool = True  # whether a run's values say which branch a nonlinear motion is on
    images: bool = True  # whether a fast sweep's transients are seen with their images


class Forward:
    """Makes the modal form of runs on one rotor; remembers what it made last.

    Parameters
    ----------
    structure : the free-free rotor, meshed finely enough: its own error must not look like an effect
    belief : damping that the nominal model believes in
    fine : a finer mesh for effects inside an element, a crack or a hub; default the same
    """

    def __init__(self, structure: Structure, belief: NominalBelief, fine: Structure | None = None):
        self.structure, self.belief, self._fine = structure, belief, fine or structure
        self.manner = Manner()
        self._known: dict[tuple, Known] = {}
        self._variants: list[Structure] = []
        self._rotors: dict[tuple, _Rotor] = {}
        self._balances: dict[tuple, Balance | None] = {}
        self._sensitivities: dict[tuple, FloatArray] = {}
        self._bends: dict[tuple, list[Bend]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Another process gets no rotors: they are many, and told apart by identities that it does not share."""
        return self.__dict__ | {"_rotors": {}}

    def allow_for_tolerances(self, rig: Rig, runs: Sequence[Run], k_b: float) -> None:
        """Find how the workshop's tolerances bend the modes of these runs, at a bearing stiffness near the truth.

        Frequencies follow the tolerances in every candidate's own modes; shapes change by what they change in the
        nominal model, or in the candidate itself once ``bend`` has been called for it.
        """
        stretches = len(assemble(rig, elements_between_nodes=1).x) - 1  # changes of section cut the mesh as well
        elements = (len(self.structure.x) - 1) // stretches
        self._variants = [assemble(each, elements_between_nodes=elements) for each in variants_of(rig)]
        self._rotors.clear()  # structures are told apart by their identity
        for run in runs:
            self.bend(run, k_b, ())

    def bend(self, run: Run, k_b: float, effects: Sequence[Effect]) -> None:
        """Find how the tolerances bend the modes of a run under these effects, near these numbers."""
        plain, *others = (
            self._modal_on(structure, run, k_b, effects, bends=()) for structure in (self.structure, *self._variants)
        )
        self._bends[_kind(run, effects)] = [
            bend_of(plain, each, [other.groups[g] for other in others]) for g, each in enumerate(plain.groups)
        ]

    def made(self, **manner: Any) -> Forward:
        """The same model with another ``Manner`` of making responses; both share what they remember."""
        other = copy.copy(self)
        other.manner = replace(self.manner, **manner)
        return other

    def believing(self, **belief: float) -> Forward:
        """The same model with other values in the nominal belief."""
        other = copy.copy(self)
        other.belief = replace(self.belief, **belief)
        return other

    def forget(self) -> None:
        """Drop the motions that nonlinear candidates start from."""
        self._known.clear()

    def condition(self, run: Run, k_b: float) -> Condition:
        """The test condition of a run."""
        return Condition(
            k_b=k_b,
            rigid_support=run.support == "rigid",
            bearing_damping=self.belief.bearing_damping_Ns_per_m,
            shaft_damping_ratio=self.belief.shaft_damping_ratio,
            excitation_node=run.excitation_node,
            excitation_plane=1 if run.excitation_plane == "y" else 2,
            spin_speed=run.spin_rpm * np.pi / 30,
        )

    def modal(self, run: Run, k_b: float, effects: Sequence[Effect] = ()) -> RunModel:
        """The run's response with these effects. Raises ValueError where an effect is impossible."""
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
        bends = self._bends.get(_kind(run, effects)) or self._bends.get(_kind(run, ()), ())
        return self._modal_on(self._fine if local else self.structure, run, k_b, effects, bends)

    def _modal_on(
        self, structure: Structure, run: Run, k_b: float, effects: Sequence[Effect], bends: Sequence[Bend]
    ) -> Modal:
        """The run's response on a structure, with these bends by the tolerances."""
        omega = 2 * np.pi * run.frequency_hz
        condition = self.condition(run, k_b)
        nodes = sorted({channel.node for channel in run.channels})
        groups, sensitivity = [], np.zeros((MODES, len(TOLERANCES)), dtype=complex)
        for group in channel_groups(effects, nodes):
            columns = np.array([c for c, channel in enumerate(run.channels) if channel.node in group.nodes])
            made, sensitivity = self._group(structure, run, omega, condition, group.effects, columns, bends)
            groups.append(made)
        return Modal(run, omega, tuple(groups), tuple(effects), sensitivity, over_receptance(run), self.manner.images)

    def _nonlinear(self, run: Run, k_b: float, effects: Sequence[Effect]) -> RunModel:
        condition, effects, manner = self.condition(run, k_b), tuple(effects), self.manner
        plain = self._balance(condition, effects, np.zeros(len(TOLERANCES)))
        if plain is None:
            return self._linear(run, k_b, [e for e in effects if e.family != "nonlinear"])
        top = 2 * np.pi * _SIZE.drifting_ratio * run.frequency_hz[-1]

        def balance(tolerance: FloatArray) -> tuple[Balance, IntArray]:
            made = self._balance(condition, effects, tolerance)
            assert made is not None  # no tolerance takes a law away
            return made, resonance_numbers(made.values, top)

        numbers = np.array([k_b, *(getattr(e, name) for e in effects for name in e.parameters())])
        mode, key = resonance_numbers(plain.values, top), (condition, effects)
        sensitivity = _remember(self._sensitivities, key, lambda: sensitivity_of(plain.system))
        known, finely = self._known, manner.resolution
        return NonlinearModal(run, balance, plain, mode, sensitivity, effects, numbers, known, finely, manner.with_data)

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
        return _remember(self._balances, (condition, effects, tolerance.tobytes(), finely), make)

    def _structure_with(self, tolerance: FloatArray) -> Structure:
        """The structure with the workshop's tolerances, its matrices to first order."""
        if not (self._variants and tolerance.any()):
            return self.structure
        plain, change = self.structure, {}
        for name in ("M", "K", "G"):
            own = getattr(plain, name)
            slopes = [(getattr(variant, name) - own) / STEP for variant in self._variants]
            change[name] = own + np.tensordot(tolerance, np.array(slopes), axes=1)
        return replace(plain, **change)

    def _group(
        self,
        structure: Structure,
        run: Run,
        omega: FloatArray,
        condition: Condition,
        effects: Sequence[Effect],
        columns: IntArray,
        bends: Sequence[Bend],
    ) -> tuple[Group, ComplexArray]:
        rotor = self._rotor(structure, run, condition, tuple(effects), tuple(run.channels[c] for c in columns))
        mode = resonance_numbers(rotor.poles, 2 * np.pi * _SIZE.drifting_ratio * run.frequency_hz[-1])
        rest = rotor.upper.receptance(omega)[:, :, 0]
        known = next((bend for bend in bends if np.isin(columns, bend.columns).all()), None)
        bent, aside = bend_residues(known, omega, columns, rotor.poles, rotor.residues, mode)
        made = Group(
            columns, rotor.poles, rotor.residues, mode, rest, chain_factors(effects, run, columns), bent, aside
        )
        sensitivity = rotor.sensitivity.astype(complex)
        if known is not None:
            sensitivity += known.missed
        return made, sensitivity

    def _rotor(
        self,
        structure: Structure,
        run: Run,
        condition: Condition,
        effects: tuple[Effect, ...],
        channels: tuple[Channel, ...],
    ) -> _Rotor:
        """A rotor's modes as seen by some channels, remembered for all runs on the same rotor.

        k_b does not change the rotor on rigid supports; effects on drive and sensors never do.
        """
        limit = max(_SIZE.kept_hz, _SIZE.kept_ratio * run.frequency_hz[-1])
        if condition.rigid_support:
            condition = replace(condition, k_b=Condition.k_b)
        effects = on_the_rotor(effects)
        key = (id(structure), condition, effects, channels, limit)
        make = partial(self._solve, structure, condition, effects, channels, limit)
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
        return _Rotor(poles, residues[:, 0], upper, sensitivity_of(system))


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


def _kind(run: Run, effects: Sequence[Effect]) -> tuple:
    """What a bend belongs to: a run, and effects at their nodes, whatever their numbers."""
    there = on_the_rotor(effects)
    nodes = [tuple(getattr(e, name) for name, place in e.places().items() if place.kind == "node") for e in there]
    return _key(run), tuple((e.id, *at) for e, at in zip(there, nodes, strict=True))
