"""Candidates: which effect, at which place, with which free numbers."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigtwin.rotor.effects import Effect
from rigtwin.rotor.effects.effect import Parameter
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.effects.scale import RigScale, scale_of
from rigtwin.rotor.model.arrays import BoolArray, FloatArray
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Run

# Prior range of the bearing stiffness [N/m], even in its logarithm, for any rig; ``RigScale.k_b`` says where one
# rig's is looked for.
K_B_RANGE = (1.0, 1e14)


@dataclass(frozen=True)
class Ranges:
    """How the ranges of numbers are used."""

    edge: float = 1e-3  # share of a range that counts as its end
    first: tuple[float, ...] = (0.15, 0.5, 0.85)  # shares where the first number of an effect starts,
    others: tuple[float, ...] = (0.5,)  # and the others, where the effect says nothing else
    bent: tuple[float, ...] = (0.5, 0.9)  # shares from which a number that bends a law is fitted
    positions: int = 5  # starts along the shaft,
    shaft_end: float = 0.03  # whose share at either end is left out
    towards_nothing: float = 30.0  # an effect may be so much weaker than its prior range says;
    towards_nominal: float = 5.0  # a damping may be so much lower than the nominal one


RANGES = Ranges()


@dataclass(frozen=True)
class Free:
    """A number that is fitted: its prior is even between the ends, in the logarithm where ``log``."""

    name: str
    low: float
    high: float
    log: bool
    fades: int = 0  # -1: the low end is as good as none of it, 1: the high end is
    step: float = 1e-5  # share of the range for a derivative
    along_shaft: bool = False  # whether it is a position [m]
    starts: tuple[float, ...] = ()  # shares of the range where fits start; empty: as the others

    @property
    def ends(self) -> tuple[float, float]:
        """The range in the coordinate that is fitted."""
        return (float(np.log(self.low)), float(np.log(self.high))) if self.log else (self.low, self.high)

    def value(self, u: float) -> float:
        """Physical value of a fitted coordinate."""
        return float(np.clip(np.exp(u), self.low, self.high)) if self.log else float(u)


K_B = Free("k_b", *K_B_RANGE, True, step=4e-6)


@dataclass(frozen=True)
class Term:
    """One effect of a candidate, its place fixed or free."""

    effect: type[Effect]
    fixed: tuple[tuple[str, float], ...]  # places and numbers that are not fitted
    free: tuple[Free, ...]
    forms: tuple[Free, ...] = ()  # numbers that bend its law, free or not

    def put(self, u: Sequence[float] | FloatArray) -> Effect:
        """The effect for fitted coordinates."""
        values = {free.name: free.value(x) for free, x in zip(self.free, u, strict=True)}
        return self.effect(**dict(self.fixed), **values)  # type: ignore[arg-type]

    @property
    def node(self) -> int:
        """The node that the effect sits at. Raises ValueError where it sits at none."""
        for name, value in self.fixed:
            if name in self.effect.places():
                return int(value)
        raise ValueError(f"{self.effect.id} sits at no node")

    @property
    def bent(self) -> Term:
        """The same with the numbers free that bend its law."""
        known = {free.name for free in self.free}
        more = (free for free in self.forms if free.name not in known)
        return replace(self, free=(*self.free, *more))

    @property
    def straight(self) -> tuple[bool, ...]:
        """Which of its free numbers do not bend its law."""
        roles = self.effect.parameters()
        return tuple(free.name not in roles or not roles[free.name].form for free in self.free)


@dataclass(frozen=True)
class Hypothesis:
    """Effects that act together; none is the nominal model."""

    terms: tuple[Term, ...] = ()
    prior: float = 1.0  # probability before the data, over the candidates of its size

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of its effects."""
        return tuple(term.effect.id for term in self.terms)

    @property
    def rotor(self) -> frozenset[Term]:
        """Its effects in whatever order: a pair found from either of its effects is one pair."""
        return frozenset(self.terms)

    @property
    def places(self) -> frozenset[tuple[type[Effect], tuple[tuple[str, float], ...]]]:
        """The same without what is fitted: a bent law is no other cause than the plain one."""
        return frozenset((term.effect, term.fixed) for term in self.terms)

    @property
    def free(self) -> tuple[Free, ...]:
        """Everything that is fitted, in order."""
        return tuple(free for term in self.terms for free in term.free)

    @property
    def coordinates(self) -> tuple[Free, ...]:
        """k_b and everything that is fitted, in the order of a fit's coordinates."""
        return (K_B, *self.free)

    @property
    def ends(self) -> FloatArray:
        """(1 + n_free, 2) ranges of the coordinates."""
        return np.array([free.ends for free in self.coordinates])

    @property
    def log(self) -> BoolArray:
        """(1 + n_free,) which coordinates are logarithms."""
        return np.array([free.log for free in self.coordinates])

    @property
    def bent(self) -> Hypothesis:
        """The same with the numbers free, after the others, that bend its law; of a single effect."""
        return replace(self, terms=tuple(term.bent for term in self.terms))

    def bent_from(self, u: FloatArray) -> list[FloatArray]:
        """Starts of ``bent`` at these coordinates (1 + n_free,); none where nothing bends its law."""
        low, high = self.bent.ends[len(u) :].T
        return [np.concatenate([u, low + share * (high - low)]) for share in RANGES.bent] if len(low) else []

    def straightened(self, u: FloatArray) -> tuple[Hypothesis, FloatArray]:
        """The same with plain laws, and its coordinates."""
        kept = [term.straight for term in self.terms]
        terms = (
            replace(term, free=tuple(itertools.compress(term.free, some)))
            for term, some in zip(self.terms, kept, strict=True)
        )
        return replace(self, terms=tuple(terms)), u[np.array([True, *itertools.chain(*kept)])]

    def clipped(self, u: FloatArray) -> FloatArray:
        """(1 + n_free,) coordinates within their ranges."""
        return np.clip(u, *self.ends.T)

    def effects(self, u: Sequence[float] | FloatArray) -> tuple[Effect, ...]:
        """The effects for fitted coordinates (n_free,)."""
        parts = self.split(np.asarray(u))
        return tuple(term.put(own) for term, own in zip(self.terms, parts, strict=True))

    def split(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Values (n_free, ...) of the free numbers, effect by effect."""
        ends = np.cumsum([0, *(len(term.free) for term in self.terms)])
        return [values[low:high] for low, high in itertools.pairwise(ends)]

    def at_edge(self, u: FloatArray) -> NDArray[np.bool_]:
        """(1 + n_free, 2) which coordinates stand at the low or at the high end of their ranges."""
        low, high = self.ends.T
        return np.stack([u - low, high - u], axis=1) < RANGES.edge * (high - low)[:, None]

    def starts(self) -> list[FloatArray]:
        """Starting points, each (n_free,); one parameter of each effect, and its position, take several values."""
        choices = [list(_term_starts(term)) for term in self.terms]
        return [np.concatenate(parts) if parts else np.zeros(0) for parts in itertools.product(*choices)]

    def __str__(self) -> str:
        return (
            " + ".join(
                term.effect.id
                + "".join(f" {name} {value:g}" for name, value in term.fixed if name in term.effect.places())
                for term in self.terms
            )
            or "nominal"
        )


def _term_starts(term: Term) -> Iterator[FloatArray]:
    """Points where a fit starts: of every number those that its effect says, or else the first number over its range,
    a position over the shaft, everything else at the middle of its range."""
    grid: list[tuple[float, ...]] = []
    first = True
    for free in term.free:
        low, high = free.ends
        if free.along_shaft:
            shares = tuple((np.arange(RANGES.positions) + 0.5) / RANGES.positions)
        else:
            shares = free.starts or (RANGES.first if first else RANGES.others)
            first = False
        grid.append(tuple(low + share * (high - low) for share in shares))
    for point in itertools.product(*grid):
        yield np.array(point)


@dataclass(frozen=True)
class Priors:
    """Probabilities before the data."""

    no_gap: float = 0.95
    # Of two effects of equal priors at once over either one alone, as the logarithm of the odds against: a pair whose
    # evidence is higher by that is as probable as its better effect. A second effect is as improbable as a first one,
    # with odds of 19 to 1 against any, and of one in some 200 candidates at all their places.
    pair_log_odds: float = 8.2


PRIORS = Priors()
NOMINAL = Hypothesis()


def candidates(
    runs: Sequence[Run], structure: Structure, exclude: Iterable[str] = (), *, nonlinear: bool = False
) -> tuple[Hypothesis, ...]:
    """Every effect of the library that could act in these runs, at every place where it could sit.

    All effects are equally probable before the data; an effect's places share its probability.

    Parameters
    ----------
    runs, structure : what was measured, on which rotor
    exclude : ids of effects that are withheld
    nonlinear : the nonlinear effects, or else the linear ones
    """
    found: list[Hypothesis] = []
    scale = scale_of(structure, max((max(run.levels, default=0.0) for run in runs), default=0.0))
    for name, effect in EFFECTS.items():
        if name in exclude or (effect.family == "nonlinear") != nonlinear or not _may_act(effect, runs, structure):
            continue
        found += _at_every_place(effect, runs, structure, scale)
    total = sum(h.prior for h in found)
    return tuple(Hypothesis(h.terms, h.prior / total) for h in found)


def at_every_place(effect: type[Effect], runs: Sequence[Run], structure: Structure) -> list[Hypothesis]:
    """One effect at every place where it could sit in these runs, all of them equally probable."""
    return _at_every_place(effect, runs, structure, scale_of(structure))


def _at_every_place(
    effect: type[Effect], runs: Sequence[Run], structure: Structure, scale: RigScale
) -> list[Hypothesis]:
    terms = [term for term in _terms(effect, runs, structure, scale) if all(f.low < f.high for f in term.free)]
    return [Hypothesis((term,), 1.0 / len(terms)) for term in terms]


def _may_act(effect: type[Effect], runs: Sequence[Run], structure: Structure) -> bool:
    """Whether runs like these of this rotor could show the effect, and a diagnosis may name it."""
    if not effect.is_candidate:
        return False
    supports = {run.support for run in runs}
    if effect.location == "bearings" and "bearing" not in supports:
        return False
    if effect.location == "rigid_support" and "rigid" not in supports:
        return False
    if effect.location == "joints" and not structure.tilting_joints:
        return False
    if effect.family == "spinning" and not any(run.spin_rpm for run in runs):
        return False
    if effect.needs_exciter_current and not any(run.quantity == "acceleration" for run in runs):
        return False
    return effect.moves_response and not (effect.needs_phase and all(run.magnitude_only for run in runs))


def _terms(effect: type[Effect], runs: Sequence[Run], structure: Structure, scale: RigScale) -> Iterator[Term]:
    across = _across(runs)
    free = tuple(
        _free(name, role, scale, both_signs=across or not role.sign_seen_across)
        for name, role in effect.parameters().items()
        if not role.form
    )
    forms = tuple(_free(name, role, scale) for name, role in effect.parameters().items() if role.form)
    sensors = sorted({channel.node for run in runs for channel in run.channels})
    places = effect.places()
    if not places:
        yield Term(effect, (), free, forms)
    for name, place in places.items():
        if place.kind == "position":
            length = float(structure.x[-1])
            ends = RANGES.shaft_end * length, (1 - RANGES.shaft_end) * length
            yield Term(effect, (), (*free, Free(name, *ends, log=False, along_shaft=True)), forms)
        elif effect.location == "sensor":
            everyone = [0] if place.all_nodes and len(sensors) > 1 and not effect.common_is_calibrated else []
            for node in [*everyone, *sensors]:
                yield Term(effect, ((name, node),), free, forms)
        else:
            for node in _moving(runs, structure):
                yield Term(effect, ((name, node),), free, forms)


def _across(runs: Sequence[Run]) -> bool:
    """Whether a sensor looks across its force."""
    return any(channel.plane != run.excitation_plane for run in runs for channel in run.channels)


def _free(name: str, role: Parameter, scale: RigScale, *, both_signs: bool = True) -> Free:
    """A parameter's range: the prior's, carried on towards the value at which the effect does nothing, as far as
    possible; empty (low > high) where nothing of it is.

    Parameters
    ----------
    scale : of the rig
    both_signs : whether the runs tell the number's sign; else its size alone is fitted
    """
    (low, high), fades = scale.ends(role), 0
    if isinstance(role.null, str):
        low /= RANGES.towards_nominal
    elif role.null == 0.0 and role.log:
        low /= RANGES.towards_nothing
    elif role.null is not None and np.isinf(role.null):
        high, fades = high * RANGES.towards_nothing, 1
    elif role.null is not None:
        low, high = min(low, role.null), max(high, role.null)
    if role.minimum == 0.0:
        fades = -1
    low = low if role.minimum is None else max(low, role.minimum)
    high = high if role.maximum is None else min(high, role.maximum)
    number = Free(name, low, high, role.log and low > 0, fades, role.step, starts=role.starts)
    if both_signs:
        return number
    sizes = sorted({round(abs(2 * share - 1), 12) for share in role.starts})  # the range is even about zero
    return replace(number, low=0.0, starts=tuple(sizes))


def _moving(runs: Sequence[Run], structure: Structure) -> Sequence[int]:
    """Nodes that some run lets move."""
    if any(run.support == "bearing" for run in runs):
        return range(1, structure.n_nodes + 1)
    return structure.free_nodes
