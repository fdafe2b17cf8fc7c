"""Points over the numbers of a force law, where a search over laws begins."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import K_B_RANGE, Free, Hypothesis
from rigtwin.rotor.model.arrays import FloatArray


@dataclass(frozen=True)
class Rest:
    """Linear rotors that suit the lowest and the highest level."""

    calm: Fit
    loud: float  # bearing stiffness [N/m]
    motion: FloatArray  # (n_nodes,) largest displacements [m]
    held: tuple[int, ...]  # nodes of the bearings

    @property
    def force(self) -> float:
        """Largest force of a bearing as soft as the lowest level's [N]."""
        return self.calm.k_b * float(self.motion[np.array(self.held) - 1].max())


@dataclass(frozen=True)
class LawGrid:
    """How finely the ranges are divided."""

    smallest: float = 0.01  # share of an even range that is its smallest point
    largest: float = 0.7  # and its largest
    stiffnesses: int = 5  # of a contact
    # Gaps of a contact, as shares of its node's largest motion, which goes little beyond them.
    gaps: tuple[float, ...] = (0.97, 0.85, 0.7, 0.5, 0.3)
    # The same where the forces in the runs are read, which is quick: what the motion can still reach.
    stiffnesses_read: int = 10
    gaps_read: tuple[float, ...] = (0.95, 0.8, 0.6, 0.4, 0.2, 0.1)
    clearances: int = 7
    # Preloads of a clearance, as shares of the largest force of the bearings: more keeps the contact closed.
    preloads: tuple[float, ...] = (0.95, 0.75, 0.55, 0.35, 0.2, 0.1, 0.02)
    angles: int = 4  # of microslip, at which all of a joint slips,
    angles_read: int = 10  # and where the forces in the runs are read
    exponents: int = 2
    contact: float = 0.15  # of a second contact, as a share of the largest stiffness,
    joint_gaps: int = 2  # and of its gap,
    joint_gaps_read: int = 8  # and where the forces in the runs are read
    forces: int = 30  # of friction, where its two stiffnesses are those of the lowest and the highest level


GRID = LawGrid()


def axis(free: Free, n: int) -> FloatArray:
    """(n,) points along the range of a number."""
    low, high = free.ends
    if free.log:
        return low + (np.arange(n) + 0.5) / n * (high - low)
    return low + (high - low) * np.geomspace(GRID.smallest, GRID.largest, n)


class LawStrategy:
    """The default: as many points along each number as its effect says, the stiffness at rest the lowest level's."""

    gridded = True  # whether a grid over its numbers tells where to begin
    readable = False  # whether its numbers can be read from the joint forces in the runs

    def axes(self, hypothesis: Hypothesis, rest: Rest, *, finely: bool = False) -> list[FloatArray]:
        """Points along each number's coordinate; finely where they are read from the runs' forces, which is quick."""
        roles = hypothesis.terms[0].effect.parameters()
        return [axis(free, roles[free.name].grid) for free in hypothesis.free]

    def points(self, hypothesis: Hypothesis, rest: Rest) -> Iterator[FloatArray]:
        """(1 + n_free,) points over its numbers, ln k_b first."""
        for point in itertools.product(*self.axes(hypothesis, rest)):
            for stiffness in self.stiffnesses_at_rest(point, rest):
                yield np.array([np.clip(np.log(stiffness), *np.log(K_B_RANGE)), *point])

    def readings(self, hypothesis: Hypothesis, rest: Rest) -> Iterator[FloatArray]:
        """(1 + n_free,) points that are compared with the forces in the runs, where these can be read."""
        for point in itertools.product(*self.axes(hypothesis, rest, finely=True)):
            yield np.array([rest.calm.u[0], *point])

    def stiffnesses_at_rest(self, point: Sequence[float], rest: Rest) -> Sequence[float]:
        """Bearing stiffnesses [N/m] that go with a point."""
        return (rest.calm.k_b,)


class Contact(LawStrategy):
    """A contact with a gap at one node."""

    readable = True

    def axes(self, hypothesis: Hypothesis, rest: Rest, *, finely: bool = False) -> list[FloatArray]:
        """Points along its stiffness, and gaps as shares of its node's largest motion."""
        stiffness, gap = hypothesis.free
        n, shares = (GRID.stiffnesses_read, GRID.gaps_read) if finely else (GRID.stiffnesses, GRID.gaps)
        gaps = np.array(shares) * rest.motion[hypothesis.terms[0].node - 1]
        return [axis(stiffness, n), np.unique(np.log(np.clip(gaps, gap.low, gap.high)))]


class Clearance(LawStrategy):
    """A gap in the bearings, closed by a preload."""

    def axes(self, hypothesis: Hypothesis, rest: Rest, *, finely: bool = False) -> list[FloatArray]:
        """Points along the gap; preloads as shares of the bearings' largest force."""
        gap, preload = hypothesis.free
        preloads = np.clip(np.array(GRID.preloads) * rest.force, preload.low, preload.high)
        return [axis(gap, GRID.clearances), np.unique(preloads)]


class Sliding(LawStrategy):
    """Friction, which shares the stiffness at rest with k_b."""

    def stiffnesses_at_rest(self, point: Sequence[float], rest: Rest) -> Sequence[float]:
        """Sticking or slipping at the lowest level."""
        k_b = rest.calm.k_b
        return max(k_b - float(np.exp(point[1])), 0.1 * k_b), 0.7 * k_b

    def points(self, hypothesis: Hypothesis, rest: Rest) -> Iterator[FloatArray]:
        """Also sticking at the lowest level and slipping at the highest."""
        yield from super().points(hypothesis, rest)
        if rest.loud < rest.calm.k_b:
            between = np.log(rest.calm.k_b - rest.loud)
            for force in axis(hypothesis.free[0], GRID.forces):
                yield hypothesis.clipped(np.array([np.log(rest.loud), force, between]))


class Microslip(LawStrategy):
    """Joints that slip part by part, a second contact closing at larger angles."""

    readable = True

    def axes(self, hypothesis: Hypothesis, rest: Rest, *, finely: bool = False) -> list[FloatArray]:
        """Few points along every number: motions take long, and the forces in the runs tell more.

        All have a second contact, which a descent can take away and not add: without one its gap tells nothing.
        """
        angle, exponent, contact, gap = hypothesis.free
        angles, gaps = (GRID.angles_read, GRID.joint_gaps_read) if finely else (GRID.angles, GRID.joint_gaps)
        contacts = GRID.contact * np.array([contact.high])
        return [axis(angle, angles), axis(exponent, GRID.exponents), contacts, axis(gap, gaps)]


class Uneven(LawStrategy):
    """Bearings stiffer one way than the other: the same at all levels, so that one level tells where to begin."""

    gridded = False
