"""StiffnessTracker.fmu: both flavours beside a rotor that moves, and the same by the filter itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from rigtwin.fmu_src.build import (
    TRACKER,
    BuildError,
    build_listener_fmu,
    build_native_listener_fmu,
    build_native_rotor_fmu,
    reduced_rotor,
    tracker_facts,
)
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.session import FmuSession

RIG = load_rig("nit-rourkela")
TABLES = load_rig(str(Path(__file__).parents[2] / "examples" / "journal_bearings.toml"))
STEP = 1e-4
READ = "node_2.acceleration_y"
BELIEF = {"k_b_start": 3.5e6, "bearing_damping": 20.0, "shaft_damping_ratio": 0.005}


@pytest.fixture(scope="module")
def stream(tmp_path_factory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force, acceleration of node 2 with 2 % noise, and k_b, which falls by 40 % after 1 s, at every instant."""
    fmu = build_native_rotor_fmu(RIG, tmp_path_factory.mktemp("rotor"), targets=[this_machine()])
    rng, n = np.random.default_rng(0), 14_000
    band = butter(4, [20, 400], "bandpass", fs=1 / STEP, output="sos")
    wanted = sosfilt(band, rng.standard_normal(n)) * np.minimum(np.arange(n) * STEP / 0.02, 1.0)
    k_b = np.where(np.arange(n) * STEP < 1.0, 3e6, 1.8e6)
    force, read = np.zeros(n), np.zeros(n)
    with FmuSession(fmu) as rotor:
        rotor.start({"k_b": 3e6, "bearing_damping": 20.0, "shaft_damping_ratio": 0.005})
        for i in range(n):
            if i and k_b[i] != k_b[i - 1]:
                rotor.set({"k_b": k_b[i]})
            rotor.set({"force": wanted[i]})
            force[i], read[i] = rotor.get(("force_applied", READ))
            rotor.step(STEP)
    return force, read + 0.02 * read.std() * rng.standard_normal(n), k_b


@pytest.fixture(scope="module")
def compiled(tmp_path_factory) -> Path:
    return build_native_listener_fmu(TRACKER, RIG, tmp_path_factory.mktemp("c"), targets=[this_machine()])


def track(fmu: Path, force: np.ndarray, read: np.ndarray, **settings: float) -> np.ndarray:
    """(n, 4) k_b, its interval and whether to believe it, after every instant."""
    with FmuSession(fmu) as tracker:
        tracker.start(BELIEF | settings)
        return np.array([told(tracker, *values) for values in zip(force, read, strict=True)])


def told(tracker: FmuSession, force: float, read: float) -> list[float]:
    """What a tracker says after one more instant."""
    tracker.set({"force": force, READ: read})
    tracker.step(STEP)
    return tracker.get(("k_b", "k_b_low", "k_b_high", "valid"))


def test_nothing_is_believed_while_something_moves_the_machine_that_is_in_no_model(compiled, stream):
    force, read, _ = stream
    time = STEP * np.arange(len(read))
    ringing = np.where(time > 0.8, 0.05 * read.std() * np.sin(2 * np.pi * 3100.0 * time), 0.0)
    valid = track(compiled, force, read + ringing)[:, 3] > 0
    assert valid[(time > 0.7) & (time < 0.8)].mean() > 0.5
    assert not valid[time > 1.2].any()


def test_a_step_of_the_stiffness_is_followed(stream, compiled):
    force, read, k_b = stream
    k, low, high, valid = track(compiled, force, read).T
    off = np.abs(k / k_b - 1)
    assert not valid[: round(0.1 / STEP)].any()
    assert off[10_000 + round(0.1 / STEP) :].max() < 0.03
    steady = slice(round(1.2 / STEP), None)
    assert np.sqrt(np.mean(off[steady] ** 2)) < 0.005
    assert valid[steady].all()
    assert np.mean((low < k_b) & (k_b < high), where=valid > 0) > 0.85


def test_both_flavours_tell_the_same(stream, compiled, tmp_path):
    """Filters begin after 1,000 instants; the pythonfmu one is slow while there are several."""
    force, read, _ = stream
    python = build_listener_fmu(TRACKER, RIG, tmp_path)
    few = slice(2_000, 3_060)
    mine = track(python, force[few], read[few])
    other = track(compiled, force[few], read[few])
    assert mine[:, 0].std() > 0
    np.testing.assert_allclose(mine, other, rtol=1e-7)


def steady_sine(n: int, hz: float) -> tuple[np.ndarray, np.ndarray]:
    """A sine and the noisy response of the finite-element model's steady motion at 3 MN/m."""
    system = build_system(assemble(RIG), Condition(3e6, False, 20.0, 0.005)).in_plane(1)
    force, omega = system.unit_vector(2, 1), 2 * np.pi * hz
    H = -(omega**2) * force @ np.linalg.solve(system.K + 1j * omega * system.C - omega**2 * system.M, force)
    t, rng = np.arange(n) * STEP, np.random.default_rng(1)
    driven, read = np.sin(omega * t), np.imag(H * np.exp(1j * omega * t))
    return driven, read + 0.02 * read.std() * rng.standard_normal(n)


def test_a_sine_tells_no_stiffness_unless_all_else_is_known(compiled):
    driven, read = steady_sine(12_000, 60.0)
    unknown = track(compiled, driven, read)
    assert not unknown[:, 3].any()
    assert unknown[-1, 2] / unknown[-1, 1] > 1.5
    known = {f"{name}_std": 0.0 for name in ("disk_mass", "bearing_damping", "shaft_damping", "gain")}
    k, low, high, valid = track(compiled, driven, read, **known)[-1]
    assert valid
    assert abs(k / 3e6 - 1) < 0.01
    assert low < 3e6 < high


def test_a_saved_state_goes_on_as_before(stream, compiled):
    instants = list(zip(*stream[:2], strict=True))
    with FmuSession(compiled) as tracker:
        tracker.start(BELIEF)
        for force, read in instants[:2_000]:
            told(tracker, force, read)
        state = tracker.save_state()
        first = [told(tracker, *values)[0] for values in instants[2_000:2_500]]
        tracker.restore_state(state)
        again = [told(tracker, *values)[0] for values in instants[2_000:2_500]]
    assert np.std(first) > 0
    assert again == first


def test_what_cannot_be_tracked_is_refused():
    rotor = reduced_rotor(RIG, assemble(RIG))
    several = "1 to 8 different nodes"
    for nodes, words in (((9,), "there is no node 9"), ((2, 2), several), ((), several)):
        with pytest.raises(BuildError, match=words):
            tracker_facts(RIG, rotor, nodes)
    with pytest.raises(BuildError, match="no bearing whose stiffness is k_b"):
        reduced_rotor(TABLES, assemble(TABLES))


@pytest.mark.parametrize("k_b", [1e5, 1e7, 1e9])
def test_the_reduced_rotor_has_the_resonances_of_the_whole(k_b):
    rotor = reduced_rotor(RIG, assemble(RIG))
    K, M = rotor.stiffness_and_mass(np.log(k_b), 0.0)
    reduced = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real) / (2 * np.pi)
    whole = elastic_frequencies_hz(build_system(assemble(RIG), Condition(k_b)), plane=1)[:2]
    np.testing.assert_allclose(np.sort(reduced)[:2], whole, rtol=1e-5)
