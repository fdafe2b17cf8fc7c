"""GapMonitor.fmu: both flavours beside a rotor that changes, and the same by the monitor itself."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest

from benchmarks.monitor import Machine
from benchmarks.tracker import FASTER, NODE, TRUE, band_noise, sine
from rigtwin.estimator.tracking.monitor import AT_REST, CAUSES, GapMonitor, Watching, _Guess
from rigtwin.estimator.tracking.reduced_rotor import ReducedRotor
from rigtwin.estimator.tracking.tracker import Belief
from rigtwin.fmu_src.build import MONITOR, build_listener_fmu, build_native_listener_fmu, reduced_rotor
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.effects import AttachedMass
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.session import FmuError, FmuSession

RIG = load_rig("nit-rourkela")
STEP, LEARNED, HEARD = 1e-4, 15_000, 3_000
READ = f"node_{NODE}.acceleration_y"
BELIEF = {"k_b": 3.15e6, "bearing_damping": 20.0, "shaft_damping_ratio": 0.005}
SOFTER = {"condition": replace(TRUE, k_b=0.98 * 3e6)}
CHANGES = {
    "k_b": SOFTER,
    "damping": {"condition": replace(TRUE, k_b=3e6, bearing_damping=40.0)},
    "mass": {"effects": (AttachedMass(mass=0.1, node=4),)},
    "sensor": {"gain": 0.9},
    "unknown": {"rub": 1e6},
}


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def compiled(request, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("monitor")
    return build_native_listener_fmu(MONITOR, RIG, folder, fmi=request.param, targets=[this_machine()])


@pytest.fixture(scope="module")
def force() -> np.ndarray:
    force = band_noise((LEARNED + HEARD) * FASTER + 1, np.random.default_rng(3))
    return force * np.minimum(np.arange(len(force)) * STEP / FASTER / 0.02, 1.0)


@pytest.fixture(scope="module")
def early(force) -> tuple[Machine, np.ndarray]:
    """A machine that was driven for a while, and what it did."""
    machine = Machine(replace(TRUE, k_b=3e6), ())
    return machine, machine.run(force[: LEARNED * FASTER + 1], 0.0)


def stream(force: np.ndarray, early: tuple[Machine, np.ndarray], change: dict) -> tuple[np.ndarray, np.ndarray]:
    """Force and noisy acceleration of a machine that changes after LEARNED instants."""
    machine, before = early
    stiffness = change.get("rub", 0.0)

    def rub(_t: float, q: np.ndarray) -> np.ndarray:
        return np.where(np.arange(len(q)) == 3, -stiffness * np.maximum(q - 1e-6, 0.0), 0.0)

    settings = change.get("condition", machine.condition), change.get("effects", ()), rub if stiffness else None
    after = Machine(*settings, machine.x.copy()).run(force[LEARNED * FASTER :], LEARNED * STEP)
    read = np.concatenate([before, change.get("gain", 1.0) * after])
    return force[:-1:FASTER], read + 0.01 * before.std() * np.random.default_rng(4).standard_normal(len(read))


def one_line(n: int, _rng: np.random.Generator) -> np.ndarray:
    """A sine of 60 Hz."""
    return sine(n, 60.0)


def said(fmu: FmuSession, force: float, read: float, **others: float) -> list:
    fmu.set({"force": force, READ: read, **others})
    fmu.step(STEP)
    return fmu.get(("drift", "alarm", "cause", "k_b_found"))


def watched(fmu: Path, force: np.ndarray, read: np.ndarray, **settings: float) -> np.ndarray:
    """(n, 4) drift, alarm, cause and k_b after every instant."""
    with FmuSession(fmu) as session:
        session.start(BELIEF | settings)
        return np.array([said(session, *values) for values in zip(force, read, strict=True)], float)


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_change_is_found_and_named(compiled, force, early, change, request):
    drift, alarm, cause, k_b = watched(compiled, *stream(force, early, change)).T
    assert not alarm[:LEARNED].any()
    assert (drift[: LEARNED - 1] < 9).all()
    first = int(np.argmax(alarm)) - LEARNED
    assert alarm[LEARNED + first :].all()
    assert 0 <= first * STEP < 0.05
    assert CAUSES[int(cause[-1])] == request.node.callspec.id.split("-")[-1]
    true = change.get("condition", early[0].condition).k_b
    assert k_b[-1] == pytest.approx(true, rel=0.005)


def test_a_machine_that_stays_as_it_is_raises_no_alarm(compiled, force, early):
    drift, alarm, cause, _ = watched(compiled, *stream(force, early, {}), alarm_every=1e4).T
    assert drift[-1] != 0
    assert not alarm.any()
    assert not cause.any()


def test_a_k_b_that_is_set_to_what_was_found_is_known(compiled, force, early):
    instants = list(zip(*stream(force, early, SOFTER), strict=True))
    with FmuSession(compiled) as session:
        session.start(BELIEF)
        for values in instants[:-500]:
            _, alarm, cause, k_b = said(session, *values)
        assert (alarm, CAUSES[cause]) == (True, "k_b")
        answers = [said(session, *values, k_b=k_b) for values in instants[-500:]]
    assert not any(alarm for _, alarm, _, _ in answers)
    assert {CAUSES[cause] for _, _, cause, _ in answers} == {"none"}


def test_a_saved_state_goes_on_as_before(compiled, force, early):
    instants = list(zip(*stream(force, early, SOFTER), strict=True))
    with FmuSession(compiled) as session:
        session.start(BELIEF)
        for values in instants[: LEARNED + 100]:
            said(session, *values)
        state = session.save_state()
        first = [said(session, *values) for values in instants[LEARNED + 100 :]]
        session.restore_state(state)
        assert [said(session, *values) for values in instants[LEARNED + 100 :]] == first
    assert first[-1][1]


KNOWN = dict.fromkeys(("disk_mass_std", "bearing_damping_std", "shaft_damping_std", "gain_std"), 0.0)


@pytest.mark.long
@pytest.mark.parametrize(("excitation", "learned", "known"), [(one_line, 12_500, KNOWN), (band_noise, 13_500, {})])
def test_both_languages_say_the_same(excitation, learned, known, tmp_path):
    """The monitor itself against its C, past the alarm. A single line tells k_b where all else is known."""
    instants, k_b, learning_s = learned + 400, BELIEF["k_b"], 0.2
    force = excitation(instants * FASTER + 1, np.random.default_rng(3))
    read = Machine(replace(TRUE, k_b=3e6), ()).run(force, 0.0)
    read[learned:] *= 0.7
    read += 0.01 * read.std() * np.random.default_rng(4).standard_normal(len(read))
    fmu = build_native_listener_fmu(MONITOR, RIG, tmp_path, targets=[this_machine()])
    compiled = watched(fmu, force[:-1:FASTER], read, learning_time=learning_s, alarm_every=1e5, **known)
    belief = Belief(k_b, 20.0, 0.005, walk=0.0, **known, driven_node=RIG.excitation_node)
    monitor = GapMonitor(reduced_rotor(RIG, assemble(RIG)), (NODE,), belief, Watching(1e5, learning_s))
    answers = []
    for f, a in zip(force[:-1:FASTER], read, strict=True):
        monitor.step(STEP, f, np.array([a]), k_b)
        answers.append([monitor.watched.drift, monitor.watched.alarm, CAUSES.index(monitor.watched.cause)])
    mine = np.array(answers, float)
    assert mine[-1, 1]
    assert not mine[learned - 1, 1]
    np.testing.assert_array_equal(mine[:, 1:], compiled[:, 1:3])
    np.testing.assert_allclose(mine[:, 0], compiled[:, 0], rtol=1e-5, atol=1e-5)


def test_the_pythonfmu_flavour_is_the_monitor(force, early, tmp_path):
    """While it listens, and its state goes on as before."""
    driven, read = (each[5_000:5_060] for each in stream(force, early, {}))
    python = build_listener_fmu(MONITOR, RIG, tmp_path / "python")
    fmu = build_native_listener_fmu(MONITOR, RIG, tmp_path, targets=[this_machine()])
    mine = watched(python, driven, read)
    np.testing.assert_allclose(mine, watched(fmu, driven, read), rtol=1e-9)
    with FmuSession(python) as session:
        session.start(BELIEF)
        said(session, driven[0], read[0])
        state = session.save_state()
        first = said(session, driven[1], read[1])
        session.restore_state(state)
        assert said(session, driven[1], read[1]) == first


def test_before_the_first_step_k_b_is_what_is_believed(compiled, tmp_path):
    for fmu in (compiled, build_listener_fmu(MONITOR, RIG, tmp_path)):
        with FmuSession(fmu) as session:
            session.start(BELIEF | {"k_b": 2e6})
            assert session.get(("k_b_found",)) == [2e6]


def test_a_state_of_another_shape_is_refused_and_leaves_everything_as_it_was(tmp_path):
    python = build_listener_fmu(MONITOR, RIG, tmp_path)
    with FmuSession(python) as session:
        session.start(BELIEF)
        said(session, 1.0, 0.5)
        state = session.save_state()
        content = json.loads(state.content)
        first = said(session, 2.0, 0.7)
        session.restore_state(state)
        for damage in ({"state": {}}, {"state": None}, {"values": [1.0]}, {"values": 3}):
            with pytest.raises(FmuError, match="not a state that this FMU saved"):
                session.restore_state(replace(state, content=json.dumps(content | damage).encode()))
        assert said(session, 2.0, 0.7) == first


def test_a_new_k_b_begins_with_what_the_sensors_may_show_at_rest():
    """However much has been learned of it since."""
    monitor = GapMonitor(reduced_rotor(RIG, assemble(RIG)), (NODE,), Belief(3e6, 20.0, 0.005, walk=0.0))
    state, n = monitor._state, 2 * monitor._rotor.r
    state.heard, state.x, state.P = 4.0, np.zeros(n), np.eye(n)
    monitor._start_watch(np.eye(5))
    prior = state.C[-1, -1]
    state.C[-1, -1] *= 1e-4
    state.guesses = [_Guess(0, np.log(3e6), np.log(3e6), np.zeros(n), np.eye(n + 1), 0.0)]
    monitor._take_for_known()
    assert state.C[-1, -1] == prior == AT_REST**2 * 4.0


def test_another_importer_sees_the_same(compiled, force, early):
    """fmpy's own loop, with the inputs as a table."""
    driven, read = stream(force, early, SOFTER)
    columns = {
        "time": STEP * np.arange(len(read)),
        "force": driven,
        READ: read,
        "k_b": np.full(len(read), BELIEF["k_b"]),
    }
    inputs = np.rec.fromarrays(list(columns.values()), names=list(columns))
    start = {name: value for name, value in BELIEF.items() if name != "k_b"}
    said_there = fmpy.simulate_fmu(
        str(compiled),
        start_values=start,
        input=inputs,
        output=["cause", "k_b_found"],
        stop_time=columns["time"][-1],
        step_size=STEP,
        output_interval=STEP,
    )
    assert CAUSES[said_there["cause"][-1]] == "k_b"
    assert said_there["k_b_found"][-1] == pytest.approx(SOFTER["condition"].k_b, rel=0.005)


def test_the_causes_are_an_enumeration(compiled):
    variable = {v.name: v for v in fmpy.read_model_description(str(compiled)).modelVariables}["cause"]
    assert variable.type == "Enumeration"
    assert [item.name for item in variable.declaredType.items] == list(CAUSES)


def test_a_mass_at_a_node_is_the_effect_of_that_name():
    """The monitor's mass is the diagnosis' attached mass: the same resonances."""
    rotor: ReducedRotor = reduced_rotor(RIG, assemble(RIG))
    masses = np.zeros(len(rotor.nodes))
    masses[3] = 0.2
    at = np.array([np.log(3e6), 0.0, np.log(20.0), np.log(0.005)])
    rows = rotor.accelerations(at, 1, masses)
    r = rotor.r
    found = np.sort(np.sqrt(np.abs(np.linalg.eigvals(-rows[:, :r] * rotor.scale))))[:2]
    system = build_system(assemble(RIG), replace(TRUE, k_b=3e6), (AttachedMass(mass=0.2, node=4),)).in_plane(1)
    np.testing.assert_allclose(found, system.modes.omega[:2], rtol=1e-5)
