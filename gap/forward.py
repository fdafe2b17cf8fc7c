"""The model of a measured run: modal form of its response, so that resonances can drift one by one.

A candidate is a tuple of effects. Its rotor is built and solved by ``rotor``; what is kept is, for every
group of channels that sees one and the same rotor,

    H(omega) = sum_k R_k / (1 + delta_m(k)) / (i omega - lambda_k (1 + delta_m(k))) + what the modes far above leave,

times the powers of i omega and the factors of the measurement chain. delta_m is the relative shift of the
m-th resonance, which belongs to the run, not to the model.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from gap.nonlinear import CORNER, FINE, Known, NonlinearModal, Resolution
from gap.transients import as_read, transients
from rotor.assembly import assemble
from rotor.condition import Condition
from rotor.effects import Effect, FastSweep, HubStiffening, OpenCrack
from rotor.harmonic_balance import Balance
from rotor.measured import DERIVATIVE_ORDER, channel_factor, channel_groups, force_factor
from rotor.model import build_model
from rotor.rig import Disk, Rig
from rotor.state_space import StateSpace, UpperResidual
from rotor.structure import ComplexArray, FloatArray, IntArray, Structure
from rotor.system import LinearSystem
from sim.campaign import Channel, NominalBelief, Run

T = TypeVar("T")

# Modes above so many times the highest line (and at least this frequency) are taken as quasi-static.
_KEPT_RATIO, _KEPT_HZ = 50.0, 20e3

# A mode whose residues are below this share of the largest is not reached by the exciter: tolerances change it in
# proportion to that share.
_UNREACHED = 0.05

# What is remembered while the runs of a candidate are made; of rotors, each some 10 kB, those of many candidates.
_REMEMBERED, _ROTORS = 8, 4096

# Samples of a period are taken one after the other where a law has memory; with 256 of them a motion is within 5e-5 of
# that with 2048, its peak for 1, at levels where friction sticks, slips now and then, and slips throughout.
_HYSTERESIS_SAMPLES = 256

# Relative step of a tolerance.
_STEP = 1e-3

# Resonances of a run that may drift: those below so many times its highest line. The next one above the lines is
# among them: between resonances, where the response nearly vanishes, its drift is seen.
_DRIFTING = 3.0
MODES = 8  # at most

# Above so many times the highest line, transients do without their modes where they do without images.
_RINGING = 1.5

# What a workshop does not know: relative standard deviations of a uniform +-0.1 %.
TOLERANCE = 0.001 / np.sqrt(3)
TOLERANCES = ("modulus", "span", "disk_mass_1", "disk_mass_2")


@dataclass(frozen=True)
class _Group:
    """Channels that see one rotor."""

    columns: IntArray  # places of its channels in the run
    poles: ComplexArray  # (n_states,)
    residues: ComplexArray  # (n_channels + 1, n_states); the last row is the exciter's own
    mode: IntArray  # (n_states,) number of the drifting resonance a pole belongs to, -1: none
    rest: FloatArray  # (n_freq, n_channels + 1) what modes far above leave
    chain: ComplexArray  # (n_freq, n_channels)
    bent: ComplexArray  # (n_tolerances, n_channels + 1, n_states) change of the residues by the tolerances
    aside: ComplexArray  # (n_tolerances, n_freq, n_channels + 1) change of what the other modes leave


@dataclass(frozen=True)
class _Bend:
    """How the tolerances change what a group of channels sees."""

    columns: IntArray  # places of its channels in the run, ascending
    residues: ComplexArray  # (n_tolerances, n_channels + 1, MODES) over the size of each mode's residues
    missed: ComplexArray  # (MODES, n_tolerances) of the poles' logarithms, beyond ``Forward._sensitivity``
    aside: ComplexArray  # (n_tolerances, n_freq, n_channels + 1)


@dataclass(frozen=True)
class _Rotor:
    """Modes of a rotor as a group of channels sees them."""

    poles: ComplexArray  # (n_states,)
    residues: ComplexArray  # (n_channels + 1, n_states)
    upper: UpperResidual
    sensitivity: FloatArray  # (MODES, n_tolerances)


@dataclass(frozen=True)
class Modal:
    """Noise-free response of one run in modal form."""

    run: Run
    omega: FloatArray
    groups: tuple[_Group, ...]
    effects: tuple[Effect, ...]
    sensitivity: ComplexArray  # (MODES, n_tolerances) of the logarithm of each resonance's pole: frequency and damping
    scale: ComplexArray  # (n_freq,) powers of i omega and nominal force
    images: bool = True  # whether transients are seen with their images, and those of far modes at all

    @property
    def frequencies_hz(self) -> FloatArray:
        """Resonances that may drift, lowest first [Hz]."""
        group = self.groups[0]
        positive = (group.mode >= 0) & (group.poles.imag > 0)
        return np.sort(np.abs(group.poles[positive])) / (2 * np.pi)

    @property
    def in_order(self) -> IntArray:
        """(n_freq,) places of the lines in the order in which they were swept."""
        return np.arange(len(self.omega))[:: self._onward]

    @property
    def _onward(self) -> int:
        return -1 if self.run.sweep == "down" else 1

    def response(self, drift: FloatArray | None = None, tolerance: FloatArray | None = None) -> ComplexArray:
        """(n_freq, n_channels) response with drifts (MODES,) and tolerances (n_tolerances,), all relative."""
        return self._evaluate(drift, tolerance, derivatives=False)[0]

    def with_derivatives(self, drift: FloatArray, tolerance: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """``response`` and its (MODES + n_tolerances, n_freq, n_channels) derivatives."""
        return self._evaluate(drift, tolerance, derivatives=True)

    def _evaluate(
        self, drift: FloatArray | None, tolerance: FloatArray | None, *, derivatives: bool
    ) -> tuple[ComplexArray, ComplexArray]:
        tolerance = np.zeros(len(TOLERANCES)) if tolerance is None else tolerance
        shift = self._shift(drift, tolerance)
        n_f, n_c = len(self.omega), len(self.run.channels)
        H = np.empty((n_f, n_c), dtype=complex)
        D = np.zeros((MODES + len(TOLERANCES) if derivatives else 0, n_f, n_c), dtype=complex)
        for group in self.groups:
            poles = group.poles * (1 + _of_poles(group, shift))
            shares = self._shares(poles)
            still = _unshifted(group, drift)
            Y, residues = self._motion(group, shares * still, tolerance)
            force = self._force(Y[:, -1])
            H[:, group.columns] = Y[:, :-1] * group.chain * force[:, None]
            if not derivatives:
                continue
            slope, by_shift = self._force_slope(Y[:, -1], force), self._shares_slope(group.poles, poles, shares)
            for m in range(MODES):
                mine = group.mode == m
                if mine.any():
                    by_pole = (by_shift[:, mine] * still[mine]) @ residues[:, mine].T
                    by_height = -(shares[:, mine] * still[mine] ** 2) @ residues[:, mine].T
                    D[m][:, group.columns] = _driven(Y, by_pole + by_height, force, slope) * group.chain
            for t in range(len(TOLERANCES)):
                moved = (by_shift * still * _of_poles(group, self.sensitivity[:, t])) @ residues.T
                dY = moved + (shares * still) @ group.bent[t].T + group.aside[t]
                D[MODES + t][:, group.columns] = _driven(Y, dY, force, slope) * group.chain
        return H, D

    def of_resonances(self, drift: FloatArray, tolerance: FloatArray) -> ComplexArray:
        """(MODES, n_freq, n_channels) what each resonance that may drift adds to the response."""
        parts = np.zeros((MODES, len(self.omega), len(self.run.channels)), dtype=complex)
        shift = self._shift(drift, tolerance)
        for group in self.groups:
            shares = self._shares(group.poles * (1 + _of_poles(group, shift))) * _unshifted(group, drift)
            Y, residues = self._motion(group, shares, tolerance)
            force = self._force(Y[:, -1])
            for m in range(MODES):
                mine = group.mode == m
                parts[m][:, group.columns] = shares[:, mine] @ residues[:-1, mine].T * group.chain * force[:, None]
        return parts

    def _shares(self, poles: ComplexArray) -> ComplexArray:
        """(n_freq, n_states) 1 / (i omega - lambda), and what transients add."""
        shares = 1 / (1j * self.omega[:, None] - poles)
        return shares if self.dwell_s is None else shares + self._unsettled(poles, np.array(self.dwell_s))

    def _shares_slope(self, own: ComplexArray, poles: ComplexArray, shares: ComplexArray) -> ComplexArray:
        """(n_freq, n_states) derivative of the shares by a shift of the poles relative to their own places."""
        if self.dwell_s is None:
            return shares**2 * own
        step = 1e-7
        return (self._shares(poles + step * own) - shares) / step

    def _shift(self, drift: FloatArray | None, tolerance: FloatArray) -> ComplexArray:
        """(MODES,) relative shift of each resonance's pole."""
        return self.sensitivity @ tolerance + (0.0 if drift is None else drift)

    def _motion(self, group: _Group, shares: ComplexArray, tolerance: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """(n_freq, n_channels + 1) receptance and the residues that it is made of."""
        if not tolerance.any():
            return shares @ group.residues.T + group.rest, group.residues
        residues = group.residues + np.tensordot(tolerance, group.bent, axes=1)
        return shares @ residues.T + group.rest + np.tensordot(tolerance, group.aside, axes=1), residues

    def change_to(self, other: Modal, drift: FloatArray, tolerance: FloatArray) -> ComplexArray:
        """(n_freq, n_channels) another response less this one, to first order in the shifts of the resonances.

        A plain difference is no derivative where a resonance shifts by more than a small part of its width.
        """
        change = np.empty((len(self.omega), len(self.run.channels)), dtype=complex)
        for group in other.groups:
            twin = next((g for g in self.groups if np.isin(group.columns, g.columns).all()), None)
            here = None if twin is None else _matched(group, twin)
            if twin is None or here is None or self.dwell_s is not None or other.dwell_s is not None:
                return other.response(drift, tolerance) - self.response(drift, tolerance)
            change[:, group.columns] = self._change(twin, other, group, here, drift, tolerance)
        return change

    def _change(
        self, own: _Group, other: Modal, group: _Group, here: ComplexArray, drift: FloatArray, tolerance: FloatArray
    ) -> ComplexArray:
        """``change_to`` of one group, whose resonances stand at ``here`` in this model."""
        own_shift, shift = self._shift(drift, tolerance), other._shift(drift, tolerance)
        poles = group.poles * (1 + _of_poles(group, shift))
        there = np.where(group.mode >= 0, here * (1 + _of_poles(group, own_shift)), poles)
        shares = 1 / (1j * self.omega[:, None] - there)
        moved, _ = other._motion(group, (shares + shares**2 * (poles - there)) * _unshifted(group, drift), tolerance)
        poles = own.poles * (1 + _of_poles(own, own_shift))
        plain, _ = self._motion(own, self._shares(poles) * _unshifted(own, drift), tolerance)
        places = np.searchsorted(own.columns, group.columns)
        Y, chain = plain[:, [*places, -1]], own.chain[:, places]
        force = self._force(Y[:, -1])
        driven = _driven(Y, moved - Y, force, self._force_slope(Y[:, -1], force))
        turned = (other._force(Y[:, -1]) - force)[:, None] * chain + force[:, None] * (group.chain - chain)
        return driven * chain + Y[:, :-1] * turned

    def driven_and_read_by(self, effects: Sequence[Effect]) -> Modal:
        """The same rotor with these effects, of which those on the rotor are the same."""
        groups = (replace(g, chain=_chain(effects, self.run, g.columns)) for g in self.groups)
        return replace(self, groups=tuple(groups), effects=tuple(effects))

    @property
    def dwell_s(self) -> float | None:
        """Time after which every line is read, settled or not; None: when it has settled."""
        dwell = [effect.dwell for effect in self.effects if isinstance(effect, FastSweep)]
        return dwell[-1] if dwell else None

    def _unsettled(self, poles: ComplexArray, dwell: FloatArray) -> ComplexArray:
        """(n_freq, ..., n_states) what transients add to 1 / (i omega - lambda), read over a period after dwells (...).

        The real signal is the imaginary part of what a force e^{i theta} makes, so the conjugate pole's transient is
        seen as well: an image that turns with twice the phase of all dwells so far, 1e5 radians for a second more.
        """
        all_hz = self.run.frequency_hz if self.run.swept_hz is None else self.run.swept_hz
        swept = 2 * np.pi * all_hz[:: self._onward]
        w, dwell = swept.reshape(-1, *(1,) * dwell.ndim, 1), dwell[..., None]
        if self.images:
            left = transients(w, poles, dwell)
            twin = np.abs(poles[:, None] - poles.conj()).argmin(axis=1)
            left -= left[..., twin].conj() * np.exp(-2j * dwell * np.cumsum(w, axis=0))
            read = as_read(left, w, poles)
        else:
            near = np.flatnonzero(np.abs(poles) < _RINGING * w.max())
            read = np.zeros((len(w), *dwell.shape[:-1], len(poles)), dtype=complex)
            read[..., near] = as_read(transients(w, poles[near], dwell), w, poles[near])
        return read[:: self._onward][np.searchsorted(all_hz, self.run.frequency_hz)]

    def change_by_dwells(self, dwells: FloatArray, drift: FloatArray, tolerance: FloatArray) -> ComplexArray:
        """(n_dwells, n_freq, n_channels) what the transients of a fast sweep change of a settled response.

        Parameters
        ----------
        dwells : (n_dwells,) [s]
        drift, tolerance : as in ``response``
        """
        shift = self._shift(drift, tolerance)
        change = np.empty((len(dwells), len(self.omega), len(self.run.channels)), dtype=complex)
        for group in self.groups:
            poles, still = group.poles * (1 + _of_poles(group, shift)), _unshifted(group, drift)
            Y, residues = self._motion(group, self._shares(poles) * still, tolerance)
            dY = np.swapaxes((self._unsettled(poles, dwells) * still) @ residues.T, 0, 1)
            force = self._force(Y[:, -1])
            change[:, :, group.columns] = _driven(Y, dY, force, self._force_slope(Y[:, -1], force)) * group.chain
        return change

    def _force_slope(self, drive: ComplexArray, force: ComplexArray) -> ComplexArray:
        """Derivative of the force by the exciter's own receptance, of which it is an analytic function."""
        if self.run.quantity != "acceleration":
            return np.zeros_like(force)
        step = 1e-6 * drive
        return np.divide(self._force(drive + step) - force, step, out=np.zeros_like(force), where=step != 0)

    def _force(self, drive: ComplexArray) -> ComplexArray:
        if self.run.quantity != "acceleration":
            return self.scale
        return self.scale * force_factor(self.effects, self.omega, drive)


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
        self._bends: dict[tuple, list[_Bend]] = {}

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
        self._variants = [assemble(each, elements_between_nodes=elements) for each in _variants(rig)]
        self._rotors.clear()  # structures are told apart by their identity
        for run in runs:
            self.bend(run, k_b, ())

    def bend(self, run: Run, k_b: float, effects: Sequence[Effect]) -> None:
        """Find how the tolerances bend the modes of a run under these effects, near these numbers."""
        plain, *others = (
            self._on(structure, run, k_b, effects, bends=()) for structure in (self.structure, *self._variants)
        )
        self._bends[_kind(run, effects)] = [
            _bend(plain, each, [other.groups[g] for other in others]) for g, each in enumerate(plain.groups)
        ]

    def made(self, **manner: Any) -> Forward:
        """The same, its responses made in another ``Manner``; what either remembers serves both."""
        other = copy.copy(self)
        other.manner = replace(self.manner, **manner)
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

    def modal(self, run: Run, k_b: float, effects: Sequence[Effect] = ()) -> Modal | NonlinearModal:
        """The run's response with these effects. Raises ValueError where an effect is impossible."""
        if nonlinear(effects):
            return self._nonlinear(run, k_b, effects)
        return self._linear(run, k_b, effects)

    def _linear(self, run: Run, k_b: float, effects: Sequence[Effect]) -> Modal:
        local = self.manner.refined and any(isinstance(effect, (OpenCrack, HubStiffening)) for effect in effects)
        bends = self._bends.get(_kind(run, effects)) or self._bends.get(_kind(run, ()), ())
        return self._on(self._fine if local else self.structure, run, k_b, effects, bends)

    def _on(
        self, structure: Structure, run: Run, k_b: float, effects: Sequence[Effect], bends: Sequence[_Bend]
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

    def _nonlinear(self, run: Run, k_b: float, effects: Sequence[Effect]) -> Modal | NonlinearModal:
        condition, effects, manner = self.condition(run, k_b), tuple(effects), self.manner
        plain = self._balance(condition, effects, np.zeros(len(TOLERANCES)))
        if plain is None:
            return self._linear(run, k_b, [e for e in effects if e.family != "nonlinear"])
        top = 2 * np.pi * _DRIFTING * run.frequency_hz[-1]

        def balance(tolerance: FloatArray) -> tuple[Balance, IntArray]:
            made = self._balance(condition, effects, tolerance)
            assert made is not None  # no tolerance takes a law away
            return made, _numbers(made.values, top)

        numbers = np.array([k_b, *(getattr(e, name) for e in effects for name in e.parameters())])
        mode, key = _numbers(plain.values, top), (condition, effects)
        sensitivity = _remembered(self._sensitivities, key, lambda: self._sensitivity(plain.system))
        known, finely = self._known, manner.resolution
        return NonlinearModal(run, balance, plain, mode, sensitivity, effects, numbers, known, finely, manner.with_data)

    def _balance(self, condition: Condition, effects: tuple[Effect, ...], tolerance: FloatArray) -> Balance | None:
        """A rotor under nonlinear effects, None where no law acts; runs at several levels share it."""

        def make() -> Balance | None:
            model = build_model(self._with(tolerance), condition, effects)
            if not model.forces:
                return None
            samples = min(finely.samples, _HYSTERESIS_SAMPLES) if model.memory else finely.samples
            made = Balance(model, condition, harmonics=finely.harmonics, samples=samples, corner=CORNER)
            if made.values.ndim > 1:
                raise ValueError("a rotor without a full set of eigenvectors has no modal form")
            return made

        finely = self.manner.resolution
        return _remembered(self._balances, (condition, effects, tolerance.tobytes(), finely), make)

    def _with(self, tolerance: FloatArray) -> Structure:
        """The structure with the workshop's tolerances, its matrices to first order."""
        if not (self._variants and tolerance.any()):
            return self.structure
        plain, change = self.structure, {}
        for name in ("M", "K", "G"):
            own = getattr(plain, name)
            slopes = [(getattr(variant, name) - own) / _STEP for variant in self._variants]
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
        bends: Sequence[_Bend],
    ) -> tuple[_Group, ComplexArray]:
        rotor = self._rotor(structure, run, condition, tuple(effects), tuple(run.channels[c] for c in columns))
        mode = _numbers(rotor.poles, 2 * np.pi * _DRIFTING * run.frequency_hz[-1])
        rest = rotor.upper.receptance(omega)[:, :, 0]
        known = next((bend for bend in bends if np.isin(columns, bend.columns).all()), None)
        bent, aside = _bent(known, omega, columns, rotor.poles, rotor.residues, mode)
        made = _Group(columns, rotor.poles, rotor.residues, mode, rest, _chain(effects, run, columns), bent, aside)
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
        """A rotor's modes as seen by some channels; shared by runs at several levels and by all that do not change it.

        On rigid supports k_b does not, and nowhere does what changes only how the rotor is driven and read.
        """
        limit = max(_KEPT_HZ, _KEPT_RATIO * run.frequency_hz[-1])
        if condition.rigid_support:
            condition = replace(condition, k_b=Condition.k_b)
        effects = on_the_rotor(effects)
        key = (id(structure), condition, effects, channels, limit)
        make = partial(self._solve, structure, condition, effects, channels, limit)
        return _remembered(self._rotors, key, make, _ROTORS)

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
        # Dashpots in series with springs couple even modes far above.
        space = StateSpace(system, condition.spin_speed, np.inf if len(system.massless) else limit_hz)
        poles, residues = space.poles(exciter[:, None], outputs)
        upper = space.upper_residual(exciter[:, None], outputs)
        return _Rotor(poles, residues[:, 0], upper, self._sensitivity(system))

    def _sensitivity(self, system: LinearSystem) -> FloatArray:
        """(MODES, n_tolerances) relative change of each undamped resonance by modulus, span and each disk's mass."""
        modes = system.modes
        count = min(MODES, len(modes.omega))
        Phi, squares = modes.Phi[:, :count], np.maximum(modes.omega[:count] ** 2, 1e-12)
        strain = np.einsum("im,ij,jm->m", Phi, system.K_shaft, Phi) / squares
        at = np.zeros((MODES, len(TOLERANCES)))
        masses = [
            np.sum(mass * Phi[(system.free[:, None] == places).any(axis=1)] ** 2, axis=0)
            for places, mass in _disk_places(system.structure)
        ]
        shaft = np.clip(1 - sum(masses, np.zeros(count)), 0.0, 1.0)
        at[:count, 0] = strain / 2
        at[:count, 1] = -1.5 * strain - 0.5 * shaft
        for column, mass in enumerate(masses[:2]):
            at[:count, 2 + column] = -mass / 2
        return at


def _remembered(store: dict[tuple, T], key: tuple, make: Callable[[], T], most: int = _REMEMBERED) -> T:
    """The value of a key, made where it is new; of those kept the oldest goes."""
    if key not in store:
        if len(store) >= most:
            store.pop(next(iter(store)))
        store[key] = make()
    return store[key]


def _of_poles(group: _Group, shift: ComplexArray) -> ComplexArray:
    """(n_states,) relative shift of every pole, of (MODES,) the resonances'; none of the modes that do not drift."""
    own = shift[group.mode]
    return np.where(group.mode < 0, 0.0, np.where(group.poles.imag < 0, own.conj(), own))


def _unshifted(group: _Group, drift: FloatArray | None) -> FloatArray:
    """(n_states,) factor of the residues: a resonance drifts at a fixed mass-normalised shape, R ~ 1 / omega."""
    if drift is None:
        return np.ones(len(group.mode))
    return 1 / (1 + np.where(group.mode >= 0, drift[group.mode], 0.0))


def _chain(effects: Sequence[Effect], run: Run, columns: IntArray) -> ComplexArray:
    """(n_freq, n_columns) reported over true response of some channels."""
    omega = 2 * np.pi * run.frequency_hz
    return np.array([channel_factor(effects, omega, run.channels[c].node) for c in columns]).T


def _driven(Y: ComplexArray, dY: ComplexArray, force: ComplexArray, slope: ComplexArray) -> ComplexArray:
    """(..., n_freq, n_channels) change of the sensors' motion where the force changes with the exciter's own motion."""
    return dY[..., :-1] * force[:, None] + Y[:, :-1] * (slope * dY[..., -1])[..., None]


def _matched(group: _Group, twin: _Group) -> ComplexArray | None:
    """The twin's pole in the place of each of the group's resonances; None where they are not one to one."""
    poles = group.poles.copy()
    for k in np.flatnonzero(group.mode >= 0):
        same = np.flatnonzero((twin.mode == group.mode[k]) & (np.sign(twin.poles.imag) == np.sign(poles[k].imag)))
        if len(same) != 1 or abs(twin.poles[same[0]] / poles[k] - 1) > _SAME:
            return None
        poles[k] = twin.poles[same[0]]
    return poles if group.mode.max(initial=-1) == twin.mode.max(initial=-1) else None


# Resonances whose frequencies differ by more than this share are not one and the same.
_SAME = 0.05


def over_receptance(run: Run) -> ComplexArray:
    """(n_freq,) a run's values over receptances: powers of i omega, and the nominal force of recorded motions."""
    omega = 2 * np.pi * run.frequency_hz
    force = (run.force_amplitude_N or 1.0) if run.quantity == "acceleration" else 1.0
    return force * (1j * omega) ** DERIVATIVE_ORDER[run.quantity]


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
    return run.support, run.excitation_node, run.excitation_plane, run.channels, run.frequency_hz.tobytes()


def _kind(run: Run, effects: Sequence[Effect]) -> tuple:
    """What a bend belongs to: a run, and effects at their nodes, whatever their numbers."""
    there = on_the_rotor(effects)
    nodes = [tuple(getattr(e, name) for name, place in e.places().items() if place.kind == "node") for e in there]
    return _key(run), tuple((e.id, *at) for e, at in zip(there, nodes, strict=True))


def _bend(modal: Modal, plain: _Group, others: Sequence[_Group]) -> _Bend:
    """Change by each tolerance of a group's poles, residues and of what the modes that do not drift leave."""
    omega, n_rows = modal.omega, len(plain.columns) + 1
    missed = np.zeros((MODES, len(TOLERANCES)), dtype=complex)
    aside = np.zeros((len(TOLERANCES), len(omega), n_rows), dtype=complex)
    bent = np.zeros((len(TOLERANCES), n_rows, MODES), dtype=complex)
    sizes = _sizes(plain.residues, plain.mode)
    for t, other in enumerate(others):
        aside[t] = (_others(other, omega) - _others(plain, omega)) / _STEP
        for m in range(MODES):
            a, b = _upper(plain, m), _upper(other, m)
            if a is not None and b is not None:
                change = other.residues[:, b] - plain.residues[:, a]
                bent[t, :, m] = change / (_STEP * sizes[a])
                moved = np.log(other.poles[b] / plain.poles[a]) / np.log1p(_STEP)
                missed[m, t] = moved - modal.sensitivity[m, t]
    return _Bend(plain.columns, bent, missed, aside)


def _bent(known: _Bend | None, omega, columns, poles: ComplexArray, residues: ComplexArray, mode: IntArray):
    """(n_tolerances, n_channels + 1, n_states) and (n_tolerances, n_freq, n_channels + 1): a bend for these poles."""
    bent = np.zeros((len(TOLERANCES), *residues.shape), dtype=complex)
    if known is None:
        return bent, np.zeros((len(TOLERANCES), len(omega), len(columns) + 1), dtype=complex)
    rows = np.append(np.searchsorted(known.columns, columns), len(known.columns))
    sizes = _sizes(residues, mode)
    for k in np.flatnonzero((mode >= 0) & (poles.imag > 0)):
        bent[:, :, k] = known.residues[:, rows, mode[k]] * sizes[k]
        twin = int(np.argmin(np.abs(poles - poles[k].conj())))
        bent[:, :, twin] = bent[:, :, k].conj()
    return bent, known.aside[:, :, rows]


def _sizes(residues: ComplexArray, mode: IntArray) -> FloatArray:
    """(n_states,) size of each mode's residues, at least a share of the largest that drifts."""
    sizes = np.linalg.norm(residues, axis=0)
    return np.maximum(sizes, _UNREACHED * sizes[mode >= 0].max(initial=1e-300))


def _others(group: _Group, omega: FloatArray) -> ComplexArray:
    """(n_freq, n_channels + 1) what the modes that do not drift contribute."""
    mine = group.mode < 0
    return (1 / (1j * omega[:, None] - group.poles[mine])) @ group.residues[:, mine].T + group.rest


def _upper(group: _Group, m: int) -> int | None:
    """Place of a resonance's pole with positive frequency."""
    found = np.flatnonzero((group.mode == m) & (group.poles.imag > 0))
    return int(found[0]) if len(found) else None


def _variants(rig: Rig) -> list[Rig]:
    """The rig with each tolerance at a small value, in the order of ``TOLERANCES``."""
    more = 1 + _STEP
    stiffer = [s.model_copy(update={"youngs_modulus_Pa": more * s.youngs_modulus_Pa}) for s in rig.segment]
    longer = [s.model_copy(update={"length_m": more * s.length_m}) for s in rig.segment]
    variants = [
        rig.model_copy(update={"segment": stiffer}),
        rig.model_copy(update={"segment": longer, "nodes_m": [more * x for x in rig.nodes_m]}),
    ]
    for number in range(2):
        disks = [_heavier(disk, more) if k == number else disk for k, disk in enumerate(rig.disk)]
        variants.append(rig.model_copy(update={"disk": disks}))
    return variants


def _heavier(disk: Disk, factor: float) -> Disk:
    """The disk with another mass: of another density, where it has dimensions."""
    if disk.density_kg_per_m3 is not None:
        return disk.model_copy(update={"density_kg_per_m3": factor * disk.density_kg_per_m3})
    return disk.model_copy(update={"mass_kg": factor * disk.mass})


def _disk_places(structure: Structure) -> list[tuple[IntArray, float]]:
    """Translational degrees of freedom and mass of every disk."""
    return [
        (4 * int(node) + np.arange(2), float(mass))
        for node, mass in zip(structure.disk_node, structure.disk_mass, strict=True)
    ]


def _numbers(poles: ComplexArray, top: float) -> IntArray:
    """Number of the resonance that every pole belongs to; conjugates share it."""
    number = np.full(len(poles), -1)
    oscillating = np.flatnonzero((poles.imag > 0) & (np.abs(poles) < top))
    order = oscillating[np.argsort(np.abs(poles[oscillating]))][:MODES]
    for m, k in enumerate(order):
        number[k] = m
        number[np.argmin(np.abs(poles - poles[k].conj()))] = m
    return number
