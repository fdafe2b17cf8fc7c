"""Effects against closed forms: a mass on two bearings, and a beam on two pins."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.special import ellipk

from benchmarks.page import bar, table
from rigtwin.rotor.effects import (
    AxialLoad,
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BilinearSupport,
    Effect,
    PedestalFlexibility,
)
from rigtwin.rotor.frequency.continuation import Curve, trace
from rigtwin.rotor.frequency.frequency_response import dynamic_stiffness, receptance
from rigtwin.rotor.frequency.harmonic_balance import Balance
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.elements import euler_bernoulli
from rigtwin.rotor.model.rotor_model import build_model, build_system
from rigtwin.rotor.model.structure import Structure

MASS, K_B = 2.0, 1e5  # kg on two bearings of that stiffness, N/m
OMEGA_0 = math.sqrt(2 * K_B / MASS)  # rad/s
_STEEL = {"youngs_modulus_Pa": 207e9, "poisson": 0.3}

Row = tuple[str, float, float]  # what, found, expected


def mass_on_bearings() -> Structure:
    """A disk in the middle of a stiff shaft that weighs next to nothing: one degree of freedom."""
    shaft = {"length_m": 0.4, "diameter_m": 0.2, "density_kg_per_m3": 7.84e-3, **_STEEL}
    supports = [{"node": node, "stiffness": "k_b"} for node in (1, 3)]
    tables = {
        "name": "mass",
        "nodes_m": [0.0, 0.2, 0.4],
        "segment": [shaft],
        "disk": [{"node": 2, "mass_kg": MASS}],
        "support": supports,
    }
    return assemble(Rig.model_validate(tables))


def _condition(bearing_damping: float) -> Condition:
    return Condition(k_b=K_B, bearing_damping=bearing_damping, shaft_damping_ratio=0.0)


def _curve(effect: Effect, bearing_damping: float, force: float, span: tuple[float, float]) -> Curve:
    condition = _condition(bearing_damping)
    balance = Balance(build_model(mass_on_bearings(), condition, [effect]), condition, harmonics=15, corner=5e-3)
    f0 = OMEGA_0 / (2 * math.pi)
    curve = trace(balance, span[0] * f0, span[1] * f0, force)
    if not curve.complete:
        raise RuntimeError(f"the curve of {effect.id} ends early: {curve.reason}")
    return curve


def _at_quadrature(curve: Curve) -> tuple[float, float]:
    """Frequency [Hz] and half the stroke [m] where the fundamental lags the force by a quarter of a period."""
    motions = curve.motions
    X = motions.joints[:, :, 0]  # (n, K)
    crossing = np.flatnonzero((X[:-1, 1].real > 0) & (X[1:, 1].real <= 0))[0]
    share = X[crossing, 1].real / (X[crossing, 1].real - X[crossing + 1, 1].real)
    phase = np.exp(1j * np.outer(np.linspace(0, 2 * np.pi, 2001), np.arange(X.shape[1])))
    x = (phase @ X[crossing : crossing + 2].T).real  # (n_time, 2)
    stroke = (x.max(axis=0) - x.min(axis=0)) / 2
    hz = motions.frequency_hz[crossing : crossing + 2]
    return float(hz @ [1 - share, share]), float(stroke @ [1 - share, share])


def duffing() -> list[Row]:
    """f = f0 sqrt(1 + 3 k3 a^2 / (4 k)) at phase quadrature; where motion is large the exact, elliptic period."""
    rows, k3, f0 = [], 1e11, OMEGA_0 / (2 * math.pi)
    for force in (0.3, 0.6):
        hz, a = _at_quadrature(_curve(BearingCubic(stiffness=k3), 3.0, force, (0.6, 1.6)))
        share = k3 * a**2 / K_B
        rows.append((f"Duffing backbone, k3 a²/k = {share:.2f}: f [Hz]", hz, f0 * math.sqrt(1 + 0.75 * share)))
    hz, a = _at_quadrature(_curve(BearingCubic(stiffness=k3), 3.0, 4.0, (0.6, 1.8)))
    share = k3 * a**2 / K_B
    exact = math.pi / 2 * f0 * math.sqrt(1 + share) / ellipk(share / (2 + 2 * share))
    rows.append((f"Duffing, exact period, k3 a²/k = {share:.2f}: f [Hz]", hz, float(exact)))
    return rows


def gap() -> list[Row]:
    """Free flight through the gap and half a sine in contact: T = 4 g / (omega_0 (a - g)) + 2 pi / omega_0."""
    rows = []
    g = 1e-4
    for force in (8.0, 16.0):
        hz, a = _at_quadrature(_curve(BearingClearance(gap=g), 20.0, force, (0.45, 1.4)))
        period = 4 * g / (OMEGA_0 * (a - g)) + 2 * math.pi / OMEGA_0
        rows.append((f"gap oscillator, a/g = {a / g:.1f}: f [Hz]", hz, 1 / period))
    return rows


def coulomb() -> list[Row]:
    """X = (F - 4 R / pi) / (c omega_0) at omega_0, R the friction of both bearings, sticking stiffness large."""
    friction, c = 1.0, 40.0
    condition = _condition(c / 2)
    model = build_model(mass_on_bearings(), condition, [BearingFriction(force=friction, stiffness=1e7)])
    balance = Balance(model, condition, harmonics=15)
    rows = []
    for force in (5.0, 20.0):
        curve = trace(balance, 0.7 * OMEGA_0 / (2 * math.pi), 1.3 * OMEGA_0 / (2 * math.pi), force)
        motions = curve.sweep(np.array([OMEGA_0 / (2 * math.pi)])).motions
        if not motions.converged.all():
            raise RuntimeError(f"no motion with friction at {force} N: {curve.reason}")
        expected = (force - 4 * 2 * friction / math.pi) / (c * OMEGA_0)
        found = float(np.abs(motions.joints[0, 1, 0]))
        rows.append((f"Coulomb friction, F = {force:g} N: X [mm]", 1e3 * found, 1e3 * expected))
    return rows


def bilinear() -> list[Row]:
    """f = 2 f+ f- / (f+ + f-)."""
    hz, _ = _at_quadrature(_curve(BilinearSupport(ratio=2.0), 3.0, 2.0, (0.8, 1.6)))
    f = OMEGA_0 / (2 * math.pi)
    return [("bilinear support, ratio 2: f [Hz]", hz, 2 * f * math.sqrt(2) / (1 + math.sqrt(2)))]


def pedestal() -> list[Row]:
    """Static flexibility 1 / k_b + 1 / k_p, and the formula's magnitude beyond the pedestal's pole."""
    k_p, m_p, c_p = 3e5, 1.0, 20.0
    effect = PedestalFlexibility(stiffness=k_p, mass=m_p, damping=c_p)
    system = build_system(mass_on_bearings(), _condition(0.0), [effect])
    rows = []
    for hz in (1e-3, 40.0, 150.0):
        w = 2 * math.pi * hz
        H = receptance(dynamic_stiffness(system, np.array([w])), system.unit_vector(2, 1)[:, None], system.read_out(1))
        base = k_p - w**2 * m_p + 1j * w * c_p
        expected = abs(1 / (2 * K_B * base / (K_B + base) - w**2 * MASS))
        rows.append((f"series pedestal at {hz:g} Hz: magnitude of H [µm/N]", 1e6 * abs(H[0, 1, 0]), 1e6 * expected))
    return rows


def tension() -> list[Row]:
    """f(P) = f(0) sqrt(1 + P / P_cr) of a slender pinned beam, P_cr = pi^2 E I / L^2."""
    L, d = 1.0, 0.01
    supports = [{"node": node, "stiffness": "k_b"} for node in (1, 3)]
    shaft = {"length_m": L, "diameter_m": d, "density_kg_per_m3": 7840.0, **_STEEL}
    beam = Rig.model_validate({"name": "beam", "nodes_m": [0.0, L / 2, L], "segment": [shaft], "support": supports})
    structure = assemble(beam, element=euler_bernoulli, elements_between_nodes=8)
    P_cr = math.pi**2 * 207e9 * math.pi * d**4 / 64 / L**2
    held = Condition(rigid_support=True)
    f0 = natural_frequencies_hz(build_system(structure, held), plane=1)[0]
    rows = []
    for share in (-0.8, -0.3, 0.5, 3.0):
        f = natural_frequencies_hz(build_system(structure, held, [AxialLoad(force=share * P_cr)]), plane=1)[0]
        rows.append((f"axial load, P/P_cr = {share:g}: f/f0", float(f / f0), math.sqrt(1 + share)))
    return rows


SOURCES: tuple[Callable[[], list[Row]], ...] = (duffing, gap, coulomb, bilinear, pedestal, tension)


def section() -> str:
    """Markdown of the comparison."""
    rows = [row for source in SOURCES for row in source()]
    errors = [abs(found / expected - 1) for _, found, expected in rows]
    cells = [
        (what, f"{found:.6g}", f"{expected:.6g}", f"{100 * error:.4f}")
        for (what, found, expected), error in zip(rows, errors, strict=True)
    ]
    return f"""## Closed forms

These tests use a mass of {MASS:g} kg on two bearings, because its motion has closed-form solutions. It is solved by
harmonic balance with the same effect classes as the rotor. A backbone curve gives the resonance frequency over the
amplitude; it is read where the fundamental lags the force by a quarter of a period. The axial load is tested on a
pinned beam.

{table(("what", "found", "closed form", "diff., %"), cells)}
{bar("closed forms, largest difference", 100 * max(errors), at_most=0.5, unit="%")}"""


if __name__ == "__main__":
    print(section())
