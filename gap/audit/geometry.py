"""What the rig's drawing says whatever its stiffnesses are: nodes, supports, signs of quasi-static response."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.state_space import StateSpace
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Run


@dataclass(frozen=True)
class Geometry:
    """Of a rig; without a structure where its file cannot be read."""

    stiffnesses_for_signs: ClassVar[int] = 4  # of bearings, over which the signs of a response have to agree
    clear_share: ClassVar[float] = 0.01  # of the largest node's response: a smaller one has no sign to rely on

    bearings: frozenset[int] = frozenset()  # nodes of supports with the stiffness k_b
    fixed: frozenset[int] = frozenset()  # nodes that are held in every run
    structure: Structure | None = None
    rig: Rig | None = None

    def held_nodes(self, run: Run) -> frozenset[int]:
        """Nodes that cannot move in a run."""
        return self.fixed | self.bearings if run.support == "rigid" else self.fixed

    @property
    def n_nodes(self) -> int | None:
        """Number of nodes, None where the rig is not known."""
        return None if self.structure is None else self.structure.n_nodes

    @property
    def nodes(self) -> frozenset[int]:
        """Numbers of all nodes; none where the rig is not known."""
        return frozenset(range(1, (self.n_nodes or 0) + 1))

    def moving_nodes(self, run: Run) -> frozenset[int]:
        """Nodes that can move in a run."""
        return self.nodes - self.held_nodes(run)

    def knows(self, run: Run) -> bool:
        """Whether rig and exciter are known."""
        return self.structure is not None and 1 <= run.excitation_node <= self.structure.n_nodes

    def stiffnesses(self, count: int) -> FloatArray:
        """(count,) bearing stiffnesses [N/m] over the range that suits the rig, which has to be known."""
        return np.geomspace(*self._k_b, count)

    @cached_property
    def _k_b(self) -> tuple[float, float]:
        """That range, no further than the rig's file allows."""
        assert self.structure and self.rig
        return self.rig.k_b.limit(*scale_of(self.structure).k_b)

    def low_response(self, run: Run) -> tuple[FloatArray, FloatArray] | None:
        """Sign of the receptance below the first resonance, and the first resonance at the stiffest.

        Returns
        -------
        (n_nodes,) +1 or -1, 0 where bearing stiffness decides it; (n_stiffnesses,) first natural frequency [Hz];
        None where rig or exciter are not known
        """
        if not self.knows(run):
            return None
        signs, first = [], []
        for k_b in self.stiffnesses(1 if run.support == "rigid" else self.stiffnesses_for_signs):
            first.append(self.first_resonance(run, k_b))
            H = self.response(run, np.array([0.02, 0.9]) * first[-1], k_b).real
            signs.append(np.where(np.abs(H) > self.clear_share * np.abs(H).max(axis=1, keepdims=True), np.sign(H), 0))
        all_signs = np.concatenate(signs)
        agree = (all_signs == all_signs[0]).all(axis=0)
        return np.where(agree, all_signs[0], 0), np.array(first)

    def first_resonance(self, run: Run, k_b: float = Condition.k_b) -> float:
        """First natural frequency [Hz]; rig and exciter have to be known."""
        assert self.structure is not None
        condition = _condition(run, k_b)
        return float(natural_frequencies_hz(build_system(self.structure, condition), condition.excitation_plane)[0])

    def response(
        self, run: Run, frequency_hz: FloatArray, k_b: float = Condition.k_b, exciter: int | None = None
    ) -> ComplexArray:
        """(n_freq, n_nodes) receptance along the exciter; rig and exciter have to be known.

        Parameters
        ----------
        exciter : its node, where it is another than the run's
        """
        space, deflections = self._rotor(_condition(run, k_b))
        driven = deflections[(run.excitation_node if exciter is None else exciter) - 1]
        return space.receptance(2 * np.pi * frequency_hz, driven[:, None], deflections)[:, :, 0]

    def _rotor(self, condition: Condition) -> tuple[StateSpace, FloatArray]:
        """The rotor as drawn in the plane of its exciter, wherever this is, and (n_nodes, n) its nodes' deflections."""
        assert self.structure is not None
        key = condition.k_b, condition.rigid_support, condition.excitation_plane
        if key not in self._rotors:
            system = build_system(self.structure, condition).in_plane(condition.excitation_plane)
            self._rotors[key] = StateSpace(system), system.read_out(condition.excitation_plane)
        return self._rotors[key]

    @cached_property
    def _rotors(self) -> dict[tuple, tuple[StateSpace, FloatArray]]:
        return {}


def _condition(run: Run, k_b: float) -> Condition:
    plane, driven = "yz".index(run.excitation_plane) + 1, run.excitation_node
    return Condition(k_b=k_b, rigid_support=run.support == "rigid", excitation_node=driven, excitation_plane=plane)


def geometry_of(rig: str) -> Geometry:
    """Geometry of a campaign's rig; an empty one where it cannot be loaded."""
    try:
        table = load_rig(rig)
        structure = assemble(table)
        fixed = frozenset(s.node for s in table.support if s.stiffness == "rigid")
        return Geometry(frozenset(structure.bearing_nodes), fixed, structure, table)
    except (ValueError, OSError, ArithmeticError):
        return Geometry()
