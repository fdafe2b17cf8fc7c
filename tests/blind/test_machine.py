"""The generator's shaft and machine: textbook frequencies, effects that fade, drift that is what it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

from rigtwin.blind.generate import beam
from rigtwin.blind.generate.beam import build_shaft
from rigtwin.blind.generate.effects import CHAIN, KINDS, LINEAR, STRANGERS, Effect, draw_effect, faded
from rigtwin.blind.generate.lines import choose_lines, resonances
from rigtwin.blind.generate.machine import Setting, build_machine
from rigtwin.blind.generate.response import N_DRIFTING, reported
from rigtwin.blind.generate.rig import Segment, read_rig
from rigtwin.blind.generate.transient import swept

RIG = read_rig("nit-rourkela")
BEARING = Setting(False, 1.3e6, 20.0, 0.002)
RIGID = replace(BEARING, rigid=True)
LINES = np.linspace(20.0, 400.0, 40)
STEADY = tuple(n for n in (*LINEAR, *CHAIN) if n not in ("coarse_grid", "fast_sweep"))


def test_pinned_timoshenko_beam_has_the_textbook_frequencies():
    """E I k^4 - rho A w^2 - rho I k^2 (1 + E/(kappa G)) w^2 + rho^2 I/(kappa G) w^4 = 0 with k = n pi / L."""
    steel = Segment(1.0, 0.05, 207e9, 7840.0, 0.3)
    shaft = build_shaft([steel], np.linspace(0, 1, 9))
    held = {int(np.argmax(shaft.deflection(x))) for x in (0.0, 1.0)}
    free = np.setdiff1d(np.arange(len(shaft.M)), [*held])
    squares = scipy.linalg.eigh(shaft.K[np.ix_(free, free)], shaft.M[np.ix_(free, free)], eigvals_only=True)
    k2 = (np.arange(1, 4) * np.pi) ** 2
    shear = steel.shear_stiffness / steel.area  # kappa G
    a = steel.density**2 * steel.second_moment / shear
    b = steel.density * (steel.area + steel.second_moment * k2 * (1 + steel.modulus / shear))
    c = steel.modulus * steel.second_moment * k2**2
    assert_allclose(squares[:3], 2 * c / (b + np.sqrt(b**2 - 4 * a * c)), rtol=1e-7)


def test_four_frequencies_are_converged(monkeypatch):
    coarse = build_machine(RIG, BEARING).omega[:4]
    monkeypatch.setattr(beam, "ORDER", 9)
    assert_allclose(coarse, build_machine(RIG, BEARING).omega[:4], rtol=1e-6)


@pytest.mark.parametrize("name", [*STEADY, *STRANGERS])
def test_an_effect_changes_the_response_and_fades_to_nothing(name):
    effect = draw_effect(np.random.default_rng(4), name, RIG)
    off = {"damping_ratio": BEARING.zeta, "damping": BEARING.c_b}
    change = []
    for severity in (1.0, 1e-5):
        weak = faded(effect, severity, off)
        change.append(max(_change(setting, weak) for setting in (BEARING, RIGID)))
    assert change[0] > 1e-3
    assert change[1] < 3e-3


def _change(setting: Setting, effect: Effect) -> float:
    H0 = reported(RIG, setting, (), LINES)
    H = reported(RIG, setting, (effect,), LINES)
    return float((np.abs(H - H0).max(axis=0) / np.abs(H0).max()).max())


def test_bearing_effects_do_not_act_on_rigid_supports():
    for name in LINEAR:
        if KINDS[name].group == "support" and name != "compliant_rigid_support":
            effect = draw_effect(np.random.default_rng(1), name, RIG)
            assert _change(RIGID, effect) < 1e-9, name


def test_drift_moves_every_resonance_by_what_it_says():
    machine = build_machine(RIG, BEARING)
    drift = np.array([3e-4, -2e-4, 1e-4])
    squares = scipy.linalg.eigh(machine.K + machine.stiffness_of_drift(drift), machine.M, eigvals_only=True)
    assert_allclose(np.sqrt(squares[:3]), machine.omega[:3] * (1 + drift), rtol=1e-10)
    assert_allclose(np.sqrt(squares[3:8]), machine.omega[3:8], rtol=1e-9)


def test_lines_crowd_in_the_half_power_band():
    peaks = resonances(build_machine(RIG, BEARING))
    lines = choose_lines(peaks, np.random.default_rng(0))
    assert len(lines) == 280
    assert np.all(np.diff(lines) > 0)
    for frequency, width in peaks:
        assert 6 <= np.sum(np.abs(lines - frequency) < width / 2) <= 14


def test_a_patient_sweep_reads_the_steady_response():
    lines = np.linspace(60, 90, 30)
    machine = build_machine(RIG, BEARING)
    H = reported(RIG, BEARING, (), lines)
    assert_allclose(swept(machine, lines, 200.0, np.zeros(N_DRIFTING)), H, atol=1e-6 * np.abs(H).max())


def test_an_impatient_sweep_reads_what_integration_gives():
    machine = build_machine(RIG, replace(BEARING, zeta=0.02))
    lines, dwell = np.array([60.0, 75.0, 80.0]), 0.11
    n = len(machine.M)
    A = np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-np.linalg.solve(machine.M, np.hstack([machine.K, machine.C + machine.C_shaft]))],
        ]
    )
    b = np.concatenate([np.zeros(n), np.linalg.solve(machine.M, machine.drive)])
    x, phi, expected = np.zeros(2 * n), -np.pi / 2, []
    for omega in 2 * np.pi * lines:
        per_period = 4000
        dt = 2 * np.pi / omega / per_period
        steady = np.linalg.solve(1j * omega * np.eye(2 * n) - A, b)
        free = scipy.linalg.expm(A * dwell) @ (x - (steady * np.exp(1j * phi)).real)
        step = scipy.linalg.expm(A * dt)
        total = 0j
        for k in range(per_period + 1):
            phase = phi + omega * (dwell + k * dt)
            acceleration = (A @ free)[n:] + (1j * omega * steady * np.exp(1j * phase)).real[n:]
            weight = 0.5 if k in (0, per_period) else 1.0
            total += weight * (machine.read[1] @ acceleration) * np.exp(-1j * phase)
            last, free = free, step @ free
        expected.append(2 * total / per_period)
        phi += omega * dwell
        x = last + (steady * np.exp(1j * phi)).real
    H = swept(machine, lines, dwell, np.zeros(N_DRIFTING))[:, 1]
    assert_allclose(H, expected, rtol=2e-4)
