"""Local forces during a periodic motion: alternating frequency/time.

The joints' displacements are sampled over one period, the force laws are evaluated there, and the
forces' harmonics are read off by a discrete Fourier transform [cameron1989]. Every law comes with
its slope, so the derivative of the harmonics is exact for the sampled force.

A sharp corner that moves from one sample to the next makes the sampled slope jump, and near a lightly
damped resonance such a jump is a fold that reality does not have. So corners are rounded over what
a joint travels between samples: the rounding shrinks with their number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from rotor.force_laws import LAWS
from rotor.local_force import LocalForce
from rotor.printed_laws import SCALAR
from rotor.structure import ComplexArray, FloatArray

# Rounding of a corner, relative to the way that the joint makes between two samples. Well below a half,
# curves of lightly damped rotors break into small folds that closer sampling moves about.
TRAVEL = 0.5

# Relative step into the complex plane that gives the derivative by the rounding: no difference is taken.
_COMPLEX_STEP = 1e-20

# Fewer motions than this go through a law with memory one by one: an array costs more than a few floats.
_FEW = 24


@dataclass(frozen=True)
class Memory:
    """Derivatives of a law with memory along two periods, the first from rest; (B, 2 n_samples) each."""

    slope: FloatArray  # by the displacement at the same instant [N/m]
    slope_before: FloatArray  # by the displacement one sample earlier [N/m]
    persistence: FloatArray  # by the force one sample earlier


@dataclass(frozen=True)
class Rounding:
    """How a force depends on its rounding, and the rounding on the motion."""

    slope: FloatArray  # (p, B, n_samples) derivative of the force by the rounding [N/m]
    rate: FloatArray  # (B, n_unknowns, p) derivative of the rounding by the displacements in real form


@dataclass(frozen=True)
class SampledForce:
    """A local force over one period of each of B motions, at p of the joint coordinates."""

    coordinates: tuple[int, ...]  # (p,) which
    force: FloatArray  # (p, B, n_samples) [N]
    slope: FloatArray  # (p, p, B, n_samples) derivative by the displacements at the same instant [N/m]
    memory: Memory | None = None
    rounding: Rounding | None = None


@dataclass(frozen=True)
class _Acting:
    """A local force in its place."""

    force: LocalForce  # centred: without the offset
    offset: float  # [m]
    coordinates: tuple[int, ...]
    corner: float | None  # its own rounding [m]; None: a law without corners


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
    corner : rounding of the corners of laws with a gap, relative to the gap; at least what ``TRAVEL`` says
    """

    def __init__(self, forces: Sequence[LocalForce], plane: int | None, harmonics: int, samples: int, corner: float):
        self._acting: list[_Acting] = []
        self._rows: list[FloatArray] = []
        for force in forces:
            self._place(force, plane, corner)
        self.patterns = np.array(self._rows)  # (n_joints, n) displacement at each coordinate
        k = np.arange(harmonics + 1)
        phase = 2 * np.pi * np.outer(k, np.arange(samples)) / samples
        self.n_unknowns = 2 * harmonics + 1  # per coordinate: real parts, then imaginary parts but of the mean
        self._synthesis = np.concatenate([np.cos(phase), -np.sin(phase[1:])])  # (n_unknowns, n_samples)
        self._analysis = np.ascontiguousarray(np.exp(-1j * phase).T) * (2 / samples)  # (n_samples, K)
        self._analysis[:, 0] /= 2
        products = self._analysis[:, :, None] * self._synthesis.T[:, None, :]  # (n_samples, K, n_unknowns)
        self._slope_analysis = np.ascontiguousarray(products).reshape(samples, -1).view(float)
        self._travel = TRAVEL * 2 * np.pi / samples * np.concatenate([k, k[1:]])  # (n_unknowns,)

    def _place(self, force: LocalForce, plane: int | None, corner: float) -> None:
        """Put a force on its coordinates; what no free degree of freedom moves has no force."""
        own = None
        if "corner" in force.law.coefficients:
            has_gap = "gap" in force.law.coefficients
            own = corner * force.coefficient("gap") if has_gap else force.coefficient("corner")
        centred = replace(force, offset=0.0)
        planes = (1, 2) if plane is None else (plane,)
        moved = [p for p in planes if force.patterns[p - 1].any()]
        together = [tuple(planes)] if force.law.radial and moved else [(p,) for p in moved]
        for group in together:
            coordinates = tuple(self._coordinate(force.patterns[p - 1]) for p in group)
            self._acting.append(_Acting(centred, force.offset if 1 in group else 0.0, coordinates, own))

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
        u = real_form(joints)  # (B, n_unknowns, n_joints)
        x = np.moveaxis(u, 2, 0) @ self._synthesis  # (n_joints, B, n_samples)
        return [self._sample(acting, x[list(acting.coordinates)], u, derivatives) for acting in self._acting]

    def _sample(self, acting: _Acting, x: FloatArray, u: FloatArray, derivatives: bool) -> SampledForce:
        if acting.force.law.memory:
            return _with_memory(acting, x[0], derivatives)
        if acting.corner is None:
            return SampledForce(acting.coordinates, *_evaluate(acting, x))
        travel = self._travel[:, None] * u[:, :, list(acting.coordinates)]
        corner = np.sqrt(acting.corner**2 + np.sum(travel**2, axis=(1, 2)))  # (B,)
        step = _COMPLEX_STEP * corner
        force, slope = _evaluate(acting, x, corner + 1j * step)
        rounding = Rounding(force.imag / step[:, None], self._travel[:, None] * travel / corner[:, None, None])
        return SampledForce(acting.coordinates, force.real, slope.real, rounding=rounding)

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
        for sample in self.sampled(joints):
            for a, row in enumerate(sample.coordinates):
                N[:, :, row] += sample.force[a] @ self._analysis
                for b, column in enumerate(sample.coordinates):
                    DN[:, :, row, :, column] += self._derivative(sample, a, b)
        return N, DN

    def harmonics(self, joints: ComplexArray) -> ComplexArray:
        """(B, K, n_joints) peak phasors of the forces [N] alone."""
        N = np.zeros(joints.shape, dtype=complex)
        for sample in self.sampled(joints, derivatives=False):
            for a, row in enumerate(sample.coordinates):
                N[:, :, row] += sample.force[a] @ self._analysis
        return N

    def _derivative(self, sample: SampledForce, a: int, b: int) -> ComplexArray:
        """(B, K, n_unknowns) derivative of the harmonics of one force by those of one coordinate."""
        if sample.memory is not None:
            chain = _chain(sample.memory, self._synthesis.T)
            parts = self._analysis.view(float).T @ chain.reshape(len(chain), -1)  # (2 K, B n_unknowns)
            D = np.moveaxis(parts.reshape(-1, *chain.shape[1:]), 0, 2)
            return np.moveaxis(np.ascontiguousarray(D).view(complex), 2, 1)
        slope = sample.slope[a, b]
        D = (slope @ self._slope_analysis).view(complex).reshape(len(slope), -1, self.n_unknowns)
        if sample.rounding is not None:
            D += (sample.rounding.slope[a] @ self._analysis)[:, :, None] * sample.rounding.rate[:, None, :, b]
        return D


def real_form(phasors: ComplexArray) -> FloatArray:
    """(B, 2 K - 1, n) real unknowns of (B, K, n) phasors: real parts, then imaginary parts without the mean's."""
    return np.concatenate([phasors.real, phasors.imag[:, 1:]], axis=1)


def complex_form(unknowns: FloatArray) -> ComplexArray:
    """Inverse of ``real_form``."""
    K = (unknowns.shape[1] + 1) // 2
    phasors = unknowns[:, :K].astype(complex)
    phasors[:, 1:] += 1j * unknowns[:, K:]
    return phasors


def _evaluate(acting: _Acting, x: FloatArray, corner: ComplexArray | None = None) -> tuple[Any, Any]:
    """Force beyond that in the static position, and slope, of a law without memory.

    Parameters
    ----------
    x : (p, B, n_samples) [m]
    corner : (B,) rounding [m], one for each motion

    Returns
    -------
    (p, B, n_samples) and (p, p, B, n_samples)
    """
    p, B, n_samples = x.shape
    force = acting.force

    def law(q: FloatArray, repeats: int) -> tuple[Any, Any]:
        rounded = force if corner is None else force.with_corner(cast("float", np.repeat(corner, repeats)))
        if p == 2:
            return rounded.across(q[0], q[1])
        f, slope = rounded.along(q[0])
        return f[None], slope[None, None]

    static = np.array([[acting.offset], [0.0]])[:p]
    f, slope = law(x.reshape(p, -1) + static, n_samples)
    f = f.reshape(x.shape)
    if acting.offset:
        f = f - law(np.repeat(static, B, axis=1), 1)[0][:, :, None]
    return f, slope.reshape(p, p, B, n_samples)


def _with_memory(acting: _Acting, x: FloatArray, derivatives: bool) -> SampledForce:
    """Go through two periods sample by sample; x is (B, n_samples) [m]."""
    history = _one_by_one(acting, x) if len(x) < _FEW else _side_by_side(acting, x, derivatives)
    forces, *slopes = history
    last = slice(x.shape[1], None)
    return SampledForce(
        acting.coordinates, forces[None, :, last], slopes[0][None, None, :, last], memory=Memory(*slopes)
    )


def _one_by_one(acting: _Acting, x: FloatArray) -> FloatArray:
    """(4, B, 2 n_samples) force and derivatives of a law with memory, in floats."""
    law, coefficients = SCALAR[acting.force.law.name], acting.force.coefficients
    history: list[float] = []
    for path in x.tolist():
        before, force = 0.0, 0.0
        for displacement in path + path:
            step = law(displacement, before, force, *coefficients)
            history += step
            before, force = displacement, step[0]
    values = np.array(history, dtype=float).reshape(len(x), -1, 4)
    return np.ascontiguousarray(np.moveaxis(values, 2, 0))


def _side_by_side(acting: _Acting, x: FloatArray, derivatives: bool) -> FloatArray:
    """The same in arrays over the motions: forces step by step, then all derivatives at once, if they are wanted."""
    law, coefficients = _STEP[acting.force.law.name], acting.force.coefficients
    path = np.ascontiguousarray(np.concatenate([x, x], axis=1).T)  # (2 n_samples, B)
    values = np.zeros((4, *path.shape))
    force = values[0]
    before = last = np.zeros(len(x))
    for displacement, now in zip(path, force, strict=True):
        now[:] = law(displacement, before, last, *coefficients)
        before, last = displacement, now
    if not derivatives:
        return np.moveaxis(values, 1, 2)
    zero = np.zeros((1, len(x)))
    variables = [path, np.concatenate([zero, path[:-1]]), np.concatenate([zero, force[:-1]])]
    for place, variable in enumerate(variables):
        moved = [variable + 1j * _COMPLEX_STEP if v is variable else v for v in variables]
        values[1 + place] = law(*moved, *coefficients).imag / _COMPLEX_STEP
    return np.ascontiguousarray(np.moveaxis(values, 1, 2))


def _limited(u: Any, a: float) -> Any:
    """``limited`` of ``force_laws`` for arrays, real or complex for a derivative."""
    if np.iscomplexobj(u):
        return np.where(np.abs(u.real) <= a, u, np.copysign(a, u.real))
    return np.minimum(np.maximum(u, -a), a)


# Laws with memory for arrays, from the same expressions that are printed for floats.
_STEP = {
    law.name: eval(f"lambda {', '.join(law.arguments)}: {law.force}", {"limited": _limited})
    for law in LAWS
    if law.memory
}


def _chain(memory: Memory, synthesis: FloatArray) -> FloatArray:
    """Derivatives of a force with memory by the unknowns, over the second of two periods.

    Chain rule: G_n = slope_n T_n + slope_before_n T_(n-1) + persistence_n G_(n-1), G and T zero before the start.

    Parameters
    ----------
    memory : derivatives of the law
    synthesis : (n_samples, n_unknowns) T, displacement by unknown

    Returns
    -------
    (n_samples, B, n_unknowns) [N/m]
    """
    n = len(synthesis)
    slope, slope_before, persistence = (
        np.ascontiguousarray(part.T)[:, :, None] for part in (memory.slope, memory.slope_before, memory.persistence)
    )
    T = np.concatenate([synthesis, synthesis])[:, None]
    derivative = slope * T
    derivative[1:] += slope_before[1:] * T[:-1]
    for before, now, kept in zip(derivative[:-1], derivative[1:], persistence[1:], strict=True):
        now += kept * before
    return derivative[n:]
