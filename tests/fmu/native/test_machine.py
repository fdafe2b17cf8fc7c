"""A machine whose bearing softens: its two small FMUs, and the system of four in fmpy and in ecos."""

from __future__ import annotations

from pathlib import Path
from tempfile import gettempdir

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.validation import validate_fmu

from rigtwin.fmu_src.build import BuildError
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.fmu_src.machine import (
    build_bearing_fmu,
    build_machine,
    build_supervisor_fmu,
    machine_facts,
    probe_lines,
    resonances_at,
)
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.machine import MachinePlan, run_machine
from rigtwin.sim.session import FmuSession
from tests.fmu.native import hosts

RIG = load_rig("nit-rourkela")
FACTS = machine_facts(RIG)
TABLES = str(Path(__file__).parents[3] / "examples" / "journal_bearings.toml")
STEP = 1e-3


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def fmi(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def bearing(fmi, tmp_path_factory) -> Path:
    return build_bearing_fmu(RIG, FACTS, tmp_path_factory.mktemp("bearing"), fmi=fmi, targets=[this_machine()])


@pytest.fixture(scope="module")
def supervisor(fmi, tmp_path_factory) -> Path:
    return build_supervisor_fmu(RIG, FACTS, tmp_path_factory.mktemp("supervisor"), fmi=fmi, targets=[this_machine()])


@pytest.fixture(scope="module")
def system(tmp_path_factory) -> Path:
    return build_machine(RIG, FACTS, tmp_path_factory.mktemp("machine"), targets=[this_machine()])


def test_k_b_falls_evenly_in_its_logarithm_by_small_changes(bearing):
    assert validate_fmu(str(bearing)) == []
    starts = {"k_b_start": 8e6, "k_b_end": 2e6, "change_at": 0.1, "change_for": 0.4, "change_every": 0.05}
    with FmuSession(bearing) as session:
        session.start(starts)
        found = [session.get(["k_b"])[0]]
        for _ in range(700):
            session.step(STEP)
            found += session.get(["k_b"])
    time = STEP * np.arange(701)
    share = np.clip(np.floor((time - 0.1) / 0.05 + 1e-9) * 0.05 / 0.4, 0.0, 1.0)
    np.testing.assert_allclose(found, 8e6 * 0.25**share, rtol=1e-9)
    assert len(set(found)) == 9


def test_without_changes_in_between_k_b_falls_in_every_step_or_at_once(bearing):
    with FmuSession(bearing) as session:
        session.start({"k_b_start": 8e6, "k_b_end": 2e6, "change_at": 0.0, "change_for": 1.0, "change_every": 0.0})
        session.step(0.37)
        assert session.get(["k_b"])[0] == pytest.approx(8e6 * 0.25**0.37, rel=1e-12)
        session.start({"k_b_start": 8e6, "k_b_end": 2e6, "change_at": 0.5, "change_for": 0.0})
        session.step(0.4)
        assert session.get(["k_b"])[0] == 8e6
        session.step(0.2)
        assert session.get(["k_b"])[0] == pytest.approx(2e6, rel=1e-12)


def run(session: FmuSession, seconds: float, **values) -> np.ndarray:
    """(n, 3) outputs while these inputs stand."""
    session.set(values)
    told = []
    for _ in range(round(seconds / STEP)):
        session.step(STEP)
        told.append(session.get(["force", "speed", "resonance"]))
    return np.array(told)


def test_the_speed_gives_way_to_a_resonance_that_comes_down_and_not_to_one_that_nobody_knows(supervisor):
    assert validate_fmu(str(supervisor)) == []
    first = resonances_at(assemble(RIG), 1e7)[0]
    softer = resonances_at(assemble(RIG), 3e6)[0]
    with FmuSession(supervisor) as session:
        session.start({"acceleration": 1000.0, "margin": 0.05})
        risen = run(session, 0.5, k_b=1e7, valid=False)
        assert np.allclose(risen[:, 1], 1000.0 * STEP * np.arange(1, 501))  # from rest, as fast as it may
        assert risen[-1, 2] == 0.0
        known = run(session, 0.5, k_b=1e7, valid=True)
        assert known[-1, 1] == FACTS.speed
        assert known[-1, 2] == pytest.approx(first, rel=2e-4)
        unsure = run(session, 0.5, k_b=3e6, valid=False)
        assert unsure[-1, 1] == FACTS.speed
        away = run(session, 0.5, k_b=3e6, valid=True)
        assert away[-1, 1] == pytest.approx(0.95 * softer, rel=2e-4)
        assert np.diff(away[:, 1]).min() >= -1000.0 * STEP * (1 + 1e-9)
        back = run(session, 0.5, k_b=1e7, valid=True)
        assert back[-1, 1] == FACTS.speed
        alone = run(session, 0.5, k_b=3e6, valid=True, supervise=False)
        assert alone[-1, 1] == FACTS.speed


def test_a_speed_beyond_a_resonance_is_reached_through_it_and_kept_above_it(supervisor):
    first, softer = (resonances_at(assemble(RIG), k_b)[0] for k_b in (3e6, 1e7))
    with FmuSession(supervisor) as session:
        session.start({"acceleration": 2000.0, "margin": 0.05})
        run(session, 1.0, k_b=3e6, valid=True)
        beyond = run(session, 1.0, k_b=3e6, valid=True, speed_wanted=1.08 * first)
        assert beyond[-1, 1] == pytest.approx(1.08 * first)
        stiffer = run(session, 1.0, k_b=1e7, valid=True)
        assert stiffer[-1, 1] == pytest.approx(1.05 * softer, rel=2e-4)


def test_the_force_is_that_of_the_unbalance_and_of_a_probe_of_many_frequencies(supervisor):
    with FmuSession(supervisor) as session:
        session.start({"acceleration": 1e6, "unbalance_moment": 1e-4, "probe": 0.0, "speed_wanted": 100.0})
        told = run(session, 1.0)
        phase = np.cumsum(STEP * np.convolve([0.0, *told[:, 1]], [0.5, 0.5], "valid"))
        np.testing.assert_allclose(told[:, 0], 1e-4 * told[:, 1] ** 2 * np.sin(phase), atol=1e-9)
        session.start({"unbalance_moment": 0.0, "probe": 2.0})
        told = run(session, 2.0)[:, 0]
    assert told.std() == pytest.approx(2.0, rel=0.05)
    assert np.abs(told).max() < 4 * 2.0
    frequency, _ = probe_lines(1.0)
    assert (np.diff(frequency) > 0).all()
    assert frequency[-1] < 1.0


@pytest.mark.parametrize(("name", "starts", "inputs"), [
    ("k_b", {"change_at": 0.0, "change_for": 1.0}, {}), ("force", {}, {"k_b": 3e6, "valid": True}),
], ids=["bearing", "supervisor"])  # fmt: skip
def test_a_state_goes_on_where_it_was_saved(name, starts, inputs, bearing, supervisor):
    with FmuSession(supervisor if inputs else bearing) as session:
        session.start(starts)
        session.set(inputs)
        for _ in range(500):
            session.step(STEP)
        state, there = session.save_state(), session.get([name])
        told = []
        for _ in range(2):
            session.restore_state(state)
            assert session.get([name]) == there
            for _ in range(50):
                session.step(STEP)
            told.append(session.get([name])[0])
    assert told[0] == told[1] != 0.0


def test_ecos_runs_the_same_machine(system, tmp_path):
    """The command logs six decimals; what several filters of the tracker say before they agree feels each of them."""
    plan = MachinePlan(stop=1.2, step=FACTS.step, window=10 * FACTS.step)
    mine = run_machine(system, plan)
    columns = {
        "speed": "supervisor::speed", "tracked": "tracker::k_b", "valid": "tracker::valid",
        "read": "rotor::node_2.acceleration_y",
    }  # fmt: skip
    theirs = hosts.by_ecos(system, tmp_path, columns, plan.step, plan.stop)
    n = len(mine.time) - 1
    ends = {name: values[9::10][:n] for name, values in theirs.items()}
    vibration = np.sqrt(np.mean(theirs["read"][: 10 * n].reshape(n, 10) ** 2, axis=1))
    np.testing.assert_allclose(mine.speed[:n], ends["speed"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(mine.vibration[:n], vibration, rtol=0, atol=1e-5 * vibration.max())
    assert np.array_equal(mine.valid[:n], ends["valid"] > 0)
    assert mine.valid[-1]
    known = mine.valid[:n]
    np.testing.assert_allclose(mine.tracked[:n][known], ends["tracked"][known], rtol=1e-4)
    assert mine.tracked[-1] == pytest.approx(1e7, rel=0.01)
    assert mine.speed.max() > 300.0
    assert not list(Path(gettempdir()).glob("tmp*/SystemStructure.ssd"))


def test_fmpys_own_simulation_takes_the_system_though_it_begins_with_zeros(system):
    told = simulate_ssp(str(system), stop_time=0.8, step_size=FACTS.step)
    assert told["rotor.k_b"][0] > 0
    assert told["rotor.node_2.acceleration_y"].std() > 1.0
    assert told["tracker.k_b"][-1] == pytest.approx(1e7, rel=0.02)
    assert told["supervisor.speed"][-1] > 200.0


def test_a_rig_without_such_bearings_has_no_machine(tmp_path):
    with pytest.raises(BuildError, match="no bearing whose stiffness is k_b"):
        build_machine(load_rig(TABLES), machine_facts(load_rig(TABLES)), tmp_path)
    assert list(tmp_path.iterdir()) == []
