"""Force laws of joints beyond their linear stiffness, sampled over a period.

A law takes the joint's displacement at N samples of a period and gives its force there, together with the slope by the
coefficients of the displacement: for a law without memory f'(x) Gamma, with one the rows of the samples it remembers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigtwin.blind.generate.effects import Effect
from rigtwin.blind.generate.rig import FloatArray

# coefficients u (nc,), Gamma (N, nc), dGamma/d(omega t), omega -> force (N,), slope by the coefficients (N, nc)
Law = Callable[[FloatArray, FloatArray, FloatArray, float], tuple[FloatArray, FloatArray]]
ROUNDING = 0.003  # corners, over the largest displacement
DEPTH = 1e-4  # the same of a contact, over the gap: a hard stator is entered by hardly more than a thousandth of it


@dataclass(frozen=True)
class Memoryless:
    """A law whose force follows from the displacement alone; ``at`` gives force and slope for any displacements."""

    at: Callable[[FloatArray], tuple[FloatArray, FloatArray]]

    def __call__(
        self, u: FloatArray, gamma: FloatArray, rate: FloatArray, omega: float
    ) -> tuple[FloatArray, FloatArray]:
        force, slope = self.at(gamma @ u)
        return force, slope[:, None] * gamma


def positive_part(x: FloatArray, rounding: float) -> tuple[FloatArray, FloatArray]:
    """(x)_+ with its corner rounded, and its slope."""
    root = np.sqrt(x**2 + rounding**2)
    return (x + root) / 2, (1 + x / root) / 2


def depth(x: FloatArray, rounding: float) -> tuple[FloatArray, FloatArray]:
    """(x)_+ with a parabola for a corner, and its slope: exactly nothing where there is no contact."""
    inside = np.clip((x + rounding) / (2 * rounding), 0.0, 1.0)
    return np.where(x > rounding, x, rounding * inside**2), inside


def cubic(effect: Effect, stiffness: float) -> Law:
    """k3 x^3; form "quintic" adds a stiffening k3 x^5 / s^2, "sinh" is 6 k3 s^3 (sinh(x/s) - x/s)."""
    k3 = effect["stiffness"]
    s = effect.extras.get("scale", 1.0)

    def plain(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return k3 * x**3, 3 * k3 * x**2

    def quintic(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return k3 * (x**3 + x**5 / s**2), k3 * (3 * x**2 + 5 * x**4 / s**2)

    def sinh(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        r = np.clip(x / s, -30, 30)
        return 6 * k3 * s**3 * (np.sinh(r) - r), 6 * k3 * s**2 * (np.cosh(r) - 1)

    return Memoryless({"": plain, "quintic": quintic, "sinh": sinh}[effect.form])


def hertz(effect: Effect, stiffness: float) -> Law:
    """k/(3 sqrt(d0)) [(d0 + x)_+^p - (d0 - x)_+^p] - k x with p = 3/2; roller contacts (form "roller"): p = 10/9."""
    d0 = effect["preload"]
    p = 10 / 9 if effect.form == "roller" else 1.5
    K = stiffness / (2 * p * d0 ** (p - 1))

    def force(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        left, right = np.maximum(d0 + x, 0), np.maximum(d0 - x, 0)
        return K * (left**p - right**p) - stiffness * x, K * p * (left ** (p - 1) + right ** (p - 1)) - stiffness

    return Memoryless(force)


def dead_band(gap: float, stiffness: float, linear: float, power: float = 1.0) -> Law:
    """stiffness ((x - g)_+ - (-x - g)_+) - linear x; with a power, contact hardens as (depth/g)^(power - 1)."""
    rounding = DEPTH * gap

    def force(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        (a, da), (b, db) = depth(x - gap, rounding), depth(-x - gap, rounding)
        scale = gap ** (1 - power)
        f = stiffness * scale * (a**power - b**power) - linear * x
        slope = stiffness * scale * power * (a ** (power - 1) * da + b ** (power - 1) * db) - linear
        return f, slope

    return Memoryless(force)


def bilinear(effect: Effect, stiffness: float) -> Law:
    """k (rho - 1) x for x > 0; form "smooth" rounds the corner over a length of its own."""
    change = stiffness * (effect["ratio"] - 1)

    def force(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        rounding = effect.extras.get("rounding", ROUNDING * max(float(np.abs(x).max()), 1e-15))
        f, slope = positive_part(x, rounding)
        return change * (f - rounding / 2), change * slope

    return Memoryless(force)


def jenkins(limits: FloatArray, stiffnesses: FloatArray) -> Law:
    """Springs that slip at their limits, in parallel: one is a Jenkins element, a row of them an Iwan chain.

    A sample is a map f -> clip(f + k dx, -F, F); such maps compose into maps of the same kind, so a period is followed
    by a prefix scan. Between slips the force is +-F + k (x - x_m), m the last sample that slipped.
    """

    def law(u: FloatArray, gamma: FloatArray, rate: FloatArray, omega: float) -> tuple[FloatArray, FloatArray]:
        x = gamma @ u
        force, last = stop_operator(x, limits, stiffnesses)
        stuck = stiffnesses[:, None] * (last != np.arange(len(x)))  # (n_elements, N)
        remembered = np.zeros_like(gamma)
        for weight, m in zip(stuck, last, strict=True):
            remembered += np.where(m >= 0, weight, 0.0)[:, None] * gamma[m]
        return force.sum(axis=0), stuck.sum(axis=0)[:, None] * gamma - remembered

    return law


def stop_operator(x: FloatArray, limits: FloatArray, stiffnesses: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """(n_elements, N) forces in the settled period, and for each sample the one that slipped last (-1: none does).

    The elements start unloaded at x = 0.
    """
    N = len(x)
    k, limit = stiffnesses[:, None], limits[:, None]
    shift = np.hstack(
        [k * np.diff(x, prepend=0.0), k * np.diff(x, prepend=x[-1])]
    )  # two laps: the first closes the loop
    low, high = np.broadcast_to(-limit, shift.shape).copy(), np.broadcast_to(limit, shift.shape).copy()
    step = 1
    while step < 2 * N:  # prefix composition
        s1, l1, h1 = shift[:, step:].copy(), low[:, step:].copy(), high[:, step:].copy()
        low[:, step:] = np.minimum(np.maximum(low[:, :-step] + s1, l1), h1)
        high[:, step:] = np.minimum(np.maximum(high[:, :-step] + s1, l1), h1)
        shift[:, step:] = shift[:, :-step] + s1
        step *= 2
    force = np.minimum(np.maximum(shift, low), high)
    slips = np.abs(force) >= limit * (1 - 1e-12)
    last = np.maximum.accumulate(np.where(slips, np.arange(2 * N), -1), axis=1)[:, N:]
    return force[:, N:], np.where(last >= 0, last % N, -1)


def coulomb_tanh(effect: Effect) -> Law:
    """F_c tanh(v / v_0): Coulomb friction with its step at rest smoothed."""

    def law(u: FloatArray, gamma: FloatArray, rate: FloatArray, omega: float) -> tuple[FloatArray, FloatArray]:
        F, v0 = effect["force"], effect.extras["velocity"]
        t = np.tanh(omega * (rate @ u) / v0)
        return F * t, (F * (1 - t**2) / v0 * omega)[:, None] * rate

    return law


def friction(effect: Effect, stiffness: float) -> Law:
    """One Jenkins element; "iwan": several whose limits are spread evenly; "tanh": Coulomb friction, smoothed."""
    if effect.form == "tanh":
        return coulomb_tanh(effect)
    n = int(effect.extras.get("elements", 1))
    shares = 2 * np.arange(1, n + 1) / (n * (n + 1))
    return jenkins(effect["force"] * shares, np.full(n, effect["stiffness"] / n))


def law_of(effect: Effect, stiffness: float) -> Law:
    """The law of a nonlinear effect at a joint with this linear stiffness [N/m]."""
    power = effect.extras.get("power", 1.0)
    match effect.id:
        case "bearing_cubic":
            return cubic(effect, stiffness)
        case "bearing_hertz":
            return hertz(effect, stiffness)
        case "bearing_clearance":
            return dead_band(effect["gap"], stiffness, stiffness, power)
        case "bearing_friction":
            return friction(effect, stiffness)
        case "bilinear_support":
            return bilinear(effect, stiffness)
        case "rub":
            return dead_band(effect["gap"], effect["stiffness"], 0.0, power)
    raise ValueError(f"{effect.id} has no force law")
