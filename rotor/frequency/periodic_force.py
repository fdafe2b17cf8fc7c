"""Local forces during a periodic motion: alternating frequency/time.

The joints' displacements are sampled over one period, the force laws are evaluated there, and the
forces' harmonics are read off by a discrete Fourier transform [cameron1989]. Every law comes with
its slope, so the derivative of the harmonics is exact for the sampled force.

When a sharp corner moves from one sample to the next, the sampled slope jumps. Near a lightly damped
resonance such a jump makes a fold that does not really exist. So at every sample, corners are rounded
over a third of the distance that the joint travels to the next sample. The rounding becomes smaller
with more samples, and it is almost zero where the joint turns back, as a shaft does at a stator. Because
of the rounding, a force also depends on the rate x' = dx/d(omega t).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rigtwin.rotor.model.arrays import BoolArray, ComplexArray, FloatArray
from rigtwin.rotor.model.force_laws import LAWS
from rigtwin.rotor.model.local_force import LocalForce

# Rounding of a corner, relative to the distance that the joint travels between two samples. With less, the curves of
# lightly damped rotors show small false folds, which move when there are more samples.
TRAVEL = 0.35

# Step into the complex plane that gives the derivatives of laws with memory: no difference is taken.
_COMPLEX_STEP = 1e-20

# Share of a law's stiffness below which what it remembers is round-off.
_ROUND_OFF = 1e-9

# Motions from which laws with memory go step by step: the steps of fewer are taken at once.
_FEW = 40


@dataclass(frozen=True)
class Memory:
    """Derivatives of a law with memory along two periods, the first from rest; (B, 2 n_samples) each."""

    slope: FloatArray  # by the displacement at the same instant [N/m]
    slope_before: FloatArray  # by the displacement one sample earlier [N/m]
    persistence: FloatArray  # by the force one sample earlier


@dataclass(frozen=True)
class SampledForce:
    """A local force over one period of each of B motions, at p of the joint coordinates."""

    coordinates: tuple[int, ...]  # (p,) which
    force: FloatArray  # (p, B, n_samples) [N]
    slope: FloatArray  # (p, p, B, n_samples) derivative by the displacements at the same instant [N/m]
    slope_by_rate: FloatArray | None = None  # (p, p, B, n_samples) by the rates [N/m]; None: not rounded
    memory: Memory | None = None


@dataclass(frozen=True)
class _Acting:
    """A local force in its place."""

    force: LocalForce
    coordinates: tuple[int, ...]


class PeriodicForces:
    """Harmonics of the local forces as functions of the harmonics of the joint coordinates.

    A displacement is x(t) = Re sum_k X_k e^{i k omega t}, k = 0 ... n_harmonics; X_0 is real. Forces
    on the same coordinate add up. A law with memory starts from rest: without displacement and
    without force. Its second period is taken, as the first closes every hysteresis loop; an element
    that never slips is a spring.

    Parameters
    ----------
    forces : local forces of the rotor
    plane : plane the rotor moves in, 1 = y or 2 = z; None: both
    harmonics : n_harmonics
    samples : samples of one period
    corner : rounding of the corners of laws with a gap, relative to the gap, where the joint is at rest
    """

    def __init__(self, forces: Sequence[LocalForce], plane: int | None, harmonics: int, samples: int, corner: float):
        self._acting: list[_Acting] = []
        self._rows: list[FloatArray] = []
        for force in forces:
            self._place(force, plane, corner)
        self.patterns = np.array(self._rows)  # (n_joints, n) displacement at each coordinate
        self.n_unknowns = 2 * harmonics + 1  # per coordinate: real parts, then imaginary parts but of the mean
        self._fourier = _fourier(harmonics, samples)

    def _place(self, force: LocalForce, plane: int | None, corner: float) -> None:
        """Put a force on its coordinates; what no free degree of freedom moves has no force."""
        if "gap" in force.law.coefficients:
            force = force.with_corner(corner * force.coefficient("gap"))
        planes = (1, 2) if plane is None else (plane,)
        moved = [p for p in planes if force.patterns[p - 1].any()]
        together = [tuple(planes)] if force.law.radial and moved else [(p,) for p in moved]
        for group in together:
            coordinates = tuple(self._coordinate(force.patterns[p - 1]) for p in group)
            self._acting.append(_Acting(force if 1 in group else force.centred, coordinates))

    def _coordinate(self, pattern: FloatArray) -> int:
        for place, row in enumerate(self._rows):
            if np.array_equal(row, pattern):
                return place
        self._rows.append(pattern)
        return len(self._rows) - 1

    def sampled(self, joints: ComplexArray, *, derivatives: bool = True) -> list[SampledForce]:
        """Forces and slopes over one period.

        Parameters
        ----------
        joints : (B, K, n_joints) peak phasors of the joint coordinates [m]
        derivatives : of laws with memory; without them those are zero
        """
        u = np.moveaxis(real_form(joints), 2, 0)  # (n_joints, B, n_unknowns)
        remembering = self._with_memory(u, derivatives)
        return [
            remembering[place] if acting.force.law.memory else self._sample(acting, u[list(acting.coordinates)])
            for place, acting in enumerate(self._acting)
        ]

    def _with_memory(self, u: FloatArray, derivatives: bool) -> dict[int, SampledForce]:
        """The forces with memory by their places, all of a law at once; one that slips in no motion is a spring."""
        found: dict[int, SampledForce] = {}
        for name in {acting.force.law.name for acting in self._acting if acting.force.law.memory}:
            some = {place: acting for place, acting in enumerate(self._acting) if acting.force.law.name == name}
            joint = [acting.coordinates[0] for acting in some.values()]
            values = np.array([acting.force.coefficients for acting in some.values()])  # (n_forces, n_coefficients)
            x = u[joint] @ self._fourier.displacement  # (n_forces, B, n_samples)
            springs, still = _unslipped(name, values, x)
            for place, force, slope in zip(
                itertools.compress(some, still), *(part[still] for part in springs), strict=True
            ):
                found[place] = SampledForce(some[place].coordinates, force[None], slope[None, None])
            some = {place: acting for (place, acting), at_rest in zip(some.items(), still, strict=True) if not at_rest}
            if not some:
                continue
            values, x = values[~still], x[~still]
            coefficients = np.repeat(values, x.shape[1], axis=0).T
            history = _history(name, coefficients, x.reshape(-1, x.shape[2]), derivatives)
            history = history.reshape(4, *x.shape[:2], -1)
            last = slice(x.shape[2], None)
            for (place, acting), (force, *slopes) in zip(some.items(), np.moveaxis(history, 1, 0), strict=True):
                found[place] = SampledForce(
                    acting.coordinates, force[None, :, last], slopes[0][None, None, :, last], memory=Memory(*slopes)
                )
        return found

    def _sample(self, acting: _Acting, u: FloatArray) -> SampledForce:
        x = u @ self._fourier.displacement  # (p, B, n_samples)
        if "corner" not in acting.force.law.coefficients:
            force, slope, _ = _evaluate(acting.force, x)
            return SampledForce(acting.coordinates, force, slope)
        rate = u @ self._fourier.rate
        travel = TRAVEL * 2 * np.pi / x.shape[2]
        own = acting.force.coefficient("corner")
        corner = np.sqrt(own**2 + travel**2 * np.sum(rate**2, axis=0))  # (B, n_samples)
        force, slope, by_corner = _evaluate(acting.force, x, corner)
        return SampledForce(acting.coordinates, force, slope, by_corner[:, None] * (travel**2 * rate / corner))

    def __call__(self, joints: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Harmonics of the forces and their derivative.

        Parameters
        ----------
        joints : (B, K, n_joints) peak phasors of the joint coordinates [m]

        Returns
        -------
        (B, K, n_joints) peak phasors [N] and (B, K, n_joints, n_unknowns, n_joints) their derivatives
        by ``real_form`` of the joints [N/m]
        """
        B, K, n = joints.shape
        N, DN = np.zeros((B, K, n), dtype=complex), np.zeros((B, K, n, self.n_unknowns, n), dtype=complex)
        slopes: dict[int, FloatArray] = {}  # of all laws with memory on a coordinate
        for sample in self.sampled(joints):
            for a, row in enumerate(sample.coordinates):
                N[:, :, row] += sample.force[a] @ self._fourier.analysis
                if sample.memory is not None:
                    slopes[row] = slopes.get(row, 0.0) + sample.slope[a, a]
                    DN[:, :, row, :, row] += self._fourier.remembered(sample.memory)
                    continue
                for b, column in enumerate(sample.coordinates):
                    by_rate = None if sample.slope_by_rate is None else sample.slope_by_rate[a, b]
                    DN[:, :, row, :, column] += self._fourier.derivative(sample.slope[a, b], by_rate)
        for row, slope in slopes.items():
            DN[:, :, row, :, row] += self._fourier.derivative(slope, None)
        return N, DN

    def harmonics(self, joints: ComplexArray) -> ComplexArray:
        """(B, K, n_joints) peak phasors of the forces [N] alone."""
        N = np.zeros(joints.shape, dtype=complex)
        for sample in self.sampled(joints, derivatives=False):
            for a, row in enumerate(sample.coordinates):
                N[:, :, row] += sample.force[a] @ self._fourier.analysis
        return N


@dataclass(frozen=True)
class _Fourier:
    """Between the harmonics 0 ... K - 1 of a real period, in ``real_form``, and its samples."""

    displacement: FloatArray  # (n_unknowns, n_samples) x by unknown
    rate: FloatArray  # (n_unknowns, n_samples) x' by unknown
    analysis: ComplexArray  # (n_samples, K)

    def derivative(self, slope: FloatArray, by_rate: FloatArray | None) -> ComplexArray:
        """(B, K, n_unknowns) derivative of a force's harmonics by those of a displacement.

        A force with the slopes s by x and r by x' answers to Re(X_j e^{i j theta}) with s cos - r j sin, to its
        imaginary part with -s sin - r j cos. With S_m and R_m the spectra of s and r,

            P = S_{k-j} + i j R_{k-j},  Q = S_{k+j} - i j R_{k+j},
            dN_k/dRe X_j = (P + Q)/2,  dN_k/dIm X_j = i (P - Q)/2.

        Parameters
        ----------
        slope, by_rate : (B, n_samples) s and r [N/m]
        """
        n_samples, K = self.analysis.shape
        j = np.arange(K)
        apart, together = (j[:, None] - j) % n_samples, (j[:, None] + j) % n_samples
        S = np.fft.fft(slope)
        P, Q = S[:, apart], S[:, together]
        if by_rate is not None:
            R = 1j * np.fft.fft(by_rate)
            P, Q = P + j * R[:, apart], Q - j * R[:, together]
        D = np.concatenate([P + Q, 1j * (P - Q)[:, :, 1:]], axis=2) / n_samples
        D[:, 0] /= 2
        return D

    def remembered(self, memory: Memory) -> ComplexArray:
        """(B, K, n_unknowns) what earlier samples add to that derivative, over the second of two periods.

        Chain rule, with T the displacement and G the force at a sample by the unknowns, both zero before the start:
        G_n = slope_n T_n + slope_before_n T_(n-1) + persistence_n G_(n-1). The persistence is 1 while a force goes on
        from the one before, and 0 where it forgets that. So T_m stays in all later forces, up to where they forget,
        with slope_before_(m+1) + persistence_(m+1) slope_m, which is zero but for where an element begins to stick.
        """
        n_samples = len(self.analysis)
        last = 2 * n_samples - 1
        stays = memory.slope_before[:, 1:] + memory.persistence[:, 1:] * memory.slope[:, :-1]  # (B, 2 n_samples - 1)
        D = np.zeros((len(stays), self.analysis.shape[1], len(self.displacement)), dtype=complex)
        forgets = np.where(memory.persistence == 0, np.arange(last + 1), last + 1)
        forgets = np.minimum.accumulate(forgets[:, ::-1], axis=1)[:, ::-1]  # the next sample that does
        motion, m = np.nonzero(np.abs(stays) > _ROUND_OFF * np.abs(memory.slope).max(initial=0.0))
        until = np.where(m + 1 < last, forgets[motion, np.minimum(m + 2, last)], last + 1)
        sums = np.concatenate([np.zeros((1, D.shape[1])), np.cumsum(self.analysis, axis=0)])
        seen = sums[np.maximum(until - n_samples, 0)] - sums[np.maximum(m + 1 - n_samples, 0)]  # (n, K)
        kept = stays[motion, m, None] * self.displacement.T[m % n_samples]  # (n, n_unknowns)
        some, first = np.unique(motion, return_index=True)
        if len(some):
            D[some] = np.add.reduceat(seen[:, :, None] * kept[:, None, :], first)
        return D


@lru_cache(maxsize=16)
def _fourier(harmonics: int, n_samples: int) -> _Fourier:
    k = np.arange(harmonics + 1.0)
    turn: ComplexArray = np.exp(2j * np.pi * np.outer(k, np.arange(n_samples)) / n_samples)  # (K, n_samples)
    displacement = np.concatenate([turn.real, -turn.imag[1:]])
    rate = np.concatenate([-k[:, None] * turn.imag, -k[1:, None] * turn.real[1:]])
    analysis = np.ascontiguousarray(turn.conj().T) * (2 / n_samples)
    analysis[:, 0] /= 2
    return _Fourier(displacement, rate, analysis)


def real_form(phasors: ComplexArray) -> FloatArray:
    """(B, 2 K - 1, n) real unknowns of (B, K, n) phasors: real parts, then imaginary parts without the mean's.

    >>> real_form(np.array([[[5.0], [2.0 + 3.0j]]])).ravel()
    array([5., 2., 3.])
    """
    return np.concatenate([phasors.real, phasors.imag[:, 1:]], axis=1)


def complex_form(unknowns: FloatArray) -> ComplexArray:
    """Inverse of ``real_form``."""
    K = (unknowns.shape[1] + 1) // 2
    phasors = unknowns[:, :K].astype(complex)
    phasors[:, 1:] += 1j * unknowns[:, K:]
    return phasors


def _evaluate(
    force: LocalForce, x: FloatArray, corner: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A force of a law without memory, in the one or two planes it acts in.

    Parameters
    ----------
    x : (p, B, n_samples) [m]
    corner : (B, n_samples) rounding [m] in place of the force's own

    Returns
    -------
    (p, B, n_samples) force, (p, p, B, n_samples) derivatives by the displacements, (p, B, n_samples) by the rounding
    """
    p, B, n_samples = x.shape
    q, rounding = x.reshape(p, -1), None if corner is None else corner.ravel()
    f, slope, by_corner = force.across(q[0], q[1], rounding) if p == 2 else force.along(q[0], rounding)
    return f.reshape(x.shape), slope.reshape(p, p, B, n_samples), by_corner.reshape(x.shape)


def _unslipped(name: str, coefficients: FloatArray, x: FloatArray) -> tuple[tuple[FloatArray, FloatArray], BoolArray]:
    """What laws with memory are where they never reach their limit: springs, whatever the path.

    Parameters
    ----------
    coefficients : (n_forces, n_coefficients)
    x : (n_forces, B, n_samples) [m]

    Returns
    -------
    (n_forces, B, n_samples) forces and slopes, and (n_forces,) whether none of the B motions reaches the limit
    """
    own = coefficients.T[..., None, None]
    force, limit = _UNLIMITED[name](x + 1j * _COMPLEX_STEP, 0.0, 0.0, *own)
    return (force.real, force.imag / _COMPLEX_STEP), (np.abs(force.real) <= limit).all(axis=(1, 2))


def _history(name: str, coefficients: FloatArray, x: FloatArray, derivatives: bool) -> FloatArray:
    """Go through two periods from rest.

    Parameters
    ----------
    name : of a law with memory
    coefficients : (n_coefficients, B) of the law, for each motion its own
    x : (B, n_samples) [m]
    derivatives : whether they are wanted, else they are zero

    Returns
    -------
    (4, B, 2 n_samples) force and derivatives, in the order of the law's arguments
    """
    unlimited, own = _UNLIMITED[name], coefficients[..., None]
    path = np.concatenate([x, x], axis=1)
    before = _one_earlier(path)
    more, limit = unlimited(path, before, 0.0, *own)
    values = np.zeros((4, *path.shape))
    values[0] = _added_up(more, limit)
    if derivatives:
        sticks = np.abs(more + _one_earlier(values[0])) <= limit
        by_path = unlimited(path + 1j * _COMPLEX_STEP, before, 0.0, *own)[0].imag / _COMPLEX_STEP
        by_before = unlimited(path, before + 1j * _COMPLEX_STEP, 0.0, *own)[0].imag / _COMPLEX_STEP
        values[1:] = np.where(sticks, [by_path, by_before, np.ones(path.shape)], 0.0)
    return values


def _one_earlier(values: FloatArray) -> FloatArray:
    """(B, n) what was there one sample before, zero at first."""
    return np.concatenate([np.zeros((len(values), 1)), values[:, :-1]], axis=1)


def _added_up(more: FloatArray, limit: FloatArray) -> FloatArray:
    """(B, n) sums from zero, kept within limits at every step.

    Parameters
    ----------
    more : (B, n) what a step adds
    limit : (B, 1)
    """
    return _by_spans(more, limit) if len(more) < _FEW else _step_by_step(more, limit)


def _by_spans(more: FloatArray, limit: FloatArray) -> FloatArray:
    """``_added_up`` of few, all steps at once.

    A step takes f to min(max(f + s, low), high), and so do several steps in a row, with another s, low and high: these
    are found for spans of one, two, four and more steps, each from two spans of half the length [blelloch1990].
    """
    s, low, high = more, np.broadcast_to(-limit, more.shape), np.broadcast_to(limit, more.shape)
    span = 1
    while span < more.shape[1]:
        s1, low1, high1 = (each[:, :-span] for each in (s, low, high))
        s2, low2, high2 = (each[:, span:] for each in (s, low, high))
        both = (s1 + s2, _kept(low1 + s2, low2, high2), _kept(high1 + s2, low2, high2))
        s, low, high = (np.hstack([old[:, :span], new]) for old, new in zip((s, low, high), both, strict=True))
        span *= 2
    return _kept(s, low, high)


def _step_by_step(more: FloatArray, limit: FloatArray) -> FloatArray:
    """``_added_up`` of many."""
    sums, most = np.array(more.T, order="C"), limit[:, 0]  # (n, B)
    least, before = -most, np.zeros(len(more))
    for now in sums:
        now += before
        np.maximum(now, least, out=now)
        before = np.minimum(now, most, out=now)
    return sums.T


def _kept(value: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    return np.minimum(np.maximum(value, low), high)


# Laws with memory before they are limited, and the limit: from the same expressions that are printed for floats.
_UNLIMITED = {
    law.name: eval(f"lambda {', '.join(law.arguments)}: {law.force}", {"limited": lambda u, a: (u, a)})
    for law in LAWS
    if law.memory
}
