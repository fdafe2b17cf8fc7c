"""A joint whose stiffness and loss follow the amplitude of its angle, in one mode of a rig.

With the angle's amplitude t the joint has the complex stiffness

    Z(t) = k [1 - s t / (1 + t / q) + c N(t / g) + i (h0 + h1 t^1.7)]

s: micro-slip, which softens the joint in proportion to small angles and less beyond q; c: a second contact that closes
at the angle g, N being the describing function of a dead zone; h: losses at rest and those that grow with the angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from benchmarks.real_data.single_mode import Sweep
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.structure import DOF_PER_NODE
from rigtwin.rotor.model.system import LinearSystem


@dataclass(frozen=True)
class Law:
    """The numbers of the joint, and what the chain of force and motion adds."""

    stiffness: float  # k over that of the rig file [-]
    softening: float  # s [1/mrad]
    saturation: float  # 1 / q [1/mrad]
    gap: float  # g [mrad]
    contact: float  # c [-]
    loss: float  # h0 [-]
    growth: float  # h1 [mrad^-1.7]
    gain: float  # of the chain [-]
    phase: float  # of the chain [rad]


START = Law(1.0, 0.01, 0.1, 1.8, 0.07, 0.0045, 0.0015, 0.9, 0.0)
EXPONENT = 1.7


def dead_zone(ratio: FloatArray) -> FloatArray:
    """Describing function N of a dead zone over its stiffness, for amplitudes in units of the gap.

    >>> dead_zone(np.array([0.5, 1.0, 1e6])).round(3)
    array([0., 0., 1.])
    """
    inside = 1 / np.maximum(ratio, 1.0)
    return 1 - 2 / np.pi * (np.arcsin(inside) + inside * np.sqrt(1 - inside**2))


@dataclass(frozen=True)
class JointedRig:
    """One mode of a rig with one joint, driven and measured at one node, at the lines of a sweep.

    The other modes are left out. On the bolted beam they are those of a rigid body on bungees: with them the sweeps
    that are left out are predicted worse.
    """

    system: LinearSystem  # motion in y
    mode: int  # place of the mode
    node: int
    tilt_stiffness: float  # of the joint in the rig file [N m/rad]
    frequency_hz: FloatArray  # (n_freq,)

    @cached_property
    def _receptances(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n_freq,) motion at the node by its force, angle of the joint by it, and that angle by a moment there."""
        structure, modes = self.system.structure, self.system.modes
        left = DOF_PER_NODE * int(structure.joint_node[0]) + 3  # theta_z, the slope in y
        angle = (self.system.free == left + DOF_PER_NODE).astype(float) - (self.system.free == left)
        shape = modes.Phi[:, self.mode]
        moves, turns = self.system.unit_vector(self.node, 1) @ shape, angle @ shape
        answer = 1 / (modes.omega[self.mode] ** 2 - (2 * np.pi * self.frequency_hz) ** 2)
        return moves**2 * answer, moves * turns * answer, turns**2 * answer

    def respond(self, law: Law, angle: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Accelerance of the chain and the joint's angle by a newton [mrad/N], at amplitudes of the angle.

        Parameters
        ----------
        angle : (n_freq,) or (n_levels, n_freq) [mrad]

        Returns
        -------
        two arrays of the shape of ``angle``
        """
        own, to_joint, at_joint = self._receptances
        closed = dead_zone(angle / law.gap)
        slipped = law.softening * angle / (1 + law.saturation * angle)
        stiff = law.stiffness * (1 - slipped + law.contact * closed)
        lost = law.stiffness * (law.loss + law.growth * angle**EXPONENT)
        added = self.tilt_stiffness * (stiff - 1 + 1j * lost)
        yielding = to_joint / (1 + added * at_joint)
        w2 = (2 * np.pi * self.frequency_hz) ** 2
        chain = law.gain * np.exp(1j * law.phase)
        return -w2 * chain * (own - added * to_joint * yielding), 1e3 * yielding

    def angle_at(self, law: Law, sweep: Sweep) -> FloatArray:
        """(n_freq,) amplitude of the joint's angle [mrad] that belongs to the measured amplitude of the node."""
        angle = np.zeros(len(sweep.force))
        for _ in range(4):  # the ratio of the two hardly depends on the joint
            H, to_joint = self.respond(law, angle)
            angle = sweep.amplitude * sweep.omega**2 * np.abs(to_joint / H)
        return angle

    def predict(self, law: Law, force: FloatArray) -> ComplexArray:
        """(n_freq,) accelerance of an upward sweep under these forces, the level of every line being what follows.

        Of several levels that a line allows the one nearest to the line before is taken.
        """
        levels = np.geomspace(1e-3, 20.0, 1500)[:, None] * np.ones(len(force))  # [mrad]
        excess = np.abs(self.respond(law, levels)[1]) * force - levels
        angle, before = np.zeros(len(force)), 0.0
        for line in range(len(force)):
            at = np.flatnonzero(np.diff(np.sign(excess[:, line])))
            share = excess[at, line] / (excess[at, line] - excess[at + 1, line])
            roots = levels[at, line] + share * (levels[at + 1, line] - levels[at, line])
            before = roots[0] if before == 0 else roots[np.argmin(np.abs(np.log(roots / before)))]
            angle[line] = before
        return self.respond(law, angle)[0]


def fit_law(rigs: Sequence[JointedRig], sweeps: Sequence[Sweep]) -> Law:
    """The law of several sweeps, at the levels that were measured; every line counts by its relative error."""
    start = np.array(list(vars(START).values()))
    scale = np.where(start == 0, 0.1, np.abs(start))

    def misfit(p: FloatArray) -> FloatArray:
        law = Law(*p)
        parts = []
        for rig, sweep in zip(rigs, sweeps, strict=True):
            error = rig.respond(law, rig.angle_at(law, sweep))[0] - sweep.H
            parts += [error.real / np.abs(sweep.H), error.imag / np.abs(sweep.H)]
        return np.concatenate(parts)

    low = np.array([0.8, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.5, -0.5])
    high = np.array([1.2, 0.2, 5.0, 10.0, 2.0, 0.1, 0.1, 1.5, 0.5])
    return Law(*least_squares(misfit, start, bounds=(low, high), x_scale=scale).x)
