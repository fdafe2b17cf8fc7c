"""Method 1 of StiffnessTracker.fmu: the network of the ONNX file, in both flavours."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rigtwin.estimator.tracking import shipped_tracker
from rigtwin.estimator.tracking.network import MOST_DOUBTED, NetworkTracker, TrackerNetwork
from rigtwin.estimator.tracking.tracker import Belief
from rigtwin.fmu_src.build import TRACKER, BuildError, build_listener_fmu, build_native_listener_fmu, tracker_network
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.session import FmuError, FmuSession
from tests.fmu.test_tracker import READ, RIG, STEP, compiled, steady_sine, stream, told, track  # noqa: F401 - two are fixtures

NETWORK = TrackerNetwork(shipped_tracker())
FIRST = round(0.25 / STEP)  # instants until the network answers, and a few


@pytest.fixture(scope="module")
def on_python(tmp_path_factory) -> Path:
    return build_listener_fmu(TRACKER, RIG, tmp_path_factory.mktemp("python"))


def test_the_c_code_says_what_the_file_says(compiled, stream):  # noqa: F811
    """Both compute in double precision; only sums are in another order."""
    force, read, _ = stream
    tracker, mine = NetworkTracker(NETWORK, Belief(3.5e6, 20.0, 0.005)), []
    for f, a in zip(force[:6_000], read[:6_000], strict=True):
        tracker.step(STEP, f, np.array([a]))
        now = tracker.tracked
        mine.append((now.k_b, now.k_b_low, now.k_b_high, now.valid))
    other = track(compiled, force[:6_000], read[:6_000], method=1)
    assert other[FIRST:, 0].std() > 0
    assert other[FIRST:, 3].any()
    np.testing.assert_allclose(mine, other, rtol=1e-9)


def test_both_flavours_tell_the_same(compiled, on_python, stream):  # noqa: F811
    some = slice(8_000, 12_000)
    force, read, _ = stream
    mine, other = (track(fmu, force[some], read[some], method=1) for fmu in (on_python, compiled))
    assert mine[FIRST:, 0].std() > 0
    np.testing.assert_allclose(mine, other, rtol=1e-9)


def test_a_step_of_the_stiffness_is_followed(compiled, stream):  # noqa: F811
    """To within three times what docs/tracker-measured.md says of band noise at 3 MN/m."""
    force, read, k_b = stream
    k, low, high, valid = track(compiled, force, read, method=1).T
    off = np.abs(np.log(k / k_b))
    assert not valid[: round(0.2 / STEP)].any()
    before, after = slice(FIRST, 10_000), slice(10_000 + round(0.25 / STEP), None)
    for part in (before, after):
        assert np.sqrt(np.mean(off[part] ** 2)) < 0.1
        assert valid[part].mean() > 0.5
    assert np.mean(((low < k_b) & (k_b < high))[valid > 0]) > 0.8


@pytest.mark.parametrize("hz", [60.0, 250.0])
def test_a_single_line_is_not_believed(compiled, hz):  # noqa: F811
    answers = track(compiled, *steady_sine(6_000, hz), method=1)
    assert answers[FIRST:, 0].std() > 0
    assert not answers[:, 3].any()


def test_a_ringing_that_is_in_no_model_is_borne_or_not_believed(compiled, stream):  # noqa: F811
    """With a third of the motion it is like noise; as loud as the motion it was never seen in training."""
    force, read, _ = (x[:6_000] for x in stream)
    ringing = read.std() * np.sin(2 * np.pi * 3100.0 * STEP * np.arange(len(read)))
    borne = track(compiled, force, read + 0.3 * ringing, method=1)[FIRST:]
    assert borne[:, 3].any()
    assert np.abs(np.log(borne[borne[:, 3] > 0, 0] / 3e6)).max() < 0.15
    assert not track(compiled, force, read + ringing, method=1)[:, 3].any()


def test_a_sensor_that_falls_silent_is_not_believed(compiled, stream):  # noqa: F811
    force, read, _ = stream
    dead = np.where(np.arange(6_000) < 5_000, read[:6_000], 0.0)
    answers = track(compiled, force[:6_000], dead, method=1)
    assert answers[:5_000, 3].any()
    assert not answers[5_500:, 3].any()
    assert np.isfinite(answers).all()


@pytest.mark.parametrize("flavour", ["compiled", "on_python"])
def test_a_saved_state_goes_on_as_before(flavour, stream, request):  # noqa: F811
    instants = list(zip(*stream[:2], strict=True))
    with FmuSession(request.getfixturevalue(flavour)) as tracker:
        tracker.start({"method": 1})
        for force, read in instants[:3_003]:
            told(tracker, force, read)
        state = tracker.save_state()
        at_once = tracker.get(("k_b", "k_b_low", "valid"))
        first = [told(tracker, *values) for values in instants[3_003:3_500]]
        tracker.restore_state(state)
        assert tracker.get(("k_b", "k_b_low", "valid")) == at_once
        again = [told(tracker, *values) for values in instants[3_003:3_500]]
    assert np.std(first, axis=0)[0] > 0
    assert again == first


def test_a_state_of_the_filter_is_restored_into_the_network_s_instance(compiled, stream):  # noqa: F811
    instants = list(zip(*stream[:2], strict=True))[:300]
    with FmuSession(compiled) as tracker:
        tracker.start({"method": 2, "k_b_start": 2e6})
        for values in instants:
            told(tracker, *values)
        state, said = tracker.save_state(), tracker.get(("k_b",))
        tracker.start({"method": 1, "k_b_start": 5e6})
        assert tracker.get(("k_b",)) == [pytest.approx(5e6, rel=1e-12)]
        tracker.restore_state(state)
        assert tracker.get(("k_b",)) == said


def test_shorter_steps_are_interpolated(compiled, stream):  # noqa: F811
    """The network has every second instant of the stream; others lie on the lines between these."""
    force, read, _ = stream
    coarse = [x[:6_000:2] for x in (force, read)]
    fine = [np.interp(np.arange(0, 5_996, 0.8), np.arange(0, 6_000, 2), x) for x in coarse]
    answers = [_last(compiled, *coarse, 2 * STEP), _last(compiled, *fine, 0.8 * STEP)]
    assert answers[0] != pytest.approx(3.5e6, rel=1e-3)  # what it began with
    assert answers[0] == pytest.approx(answers[1], rel=0.05)


def _last(fmu: Path, force: np.ndarray, read: np.ndarray, step: float) -> float:
    with FmuSession(fmu) as tracker:
        tracker.start({"method": 1, "k_b_start": 3.5e6})
        for f, a in zip(force, read, strict=True):
            tracker.set({"force": f, READ: a})
            tracker.step(step)
        return tracker.get(("k_b",))[0]


@pytest.mark.parametrize("flavour", ["compiled", "on_python"])
def test_what_the_network_cannot_do_is_refused(flavour, request):
    fmu = request.getfixturevalue(flavour)
    with FmuSession(fmu) as tracker, pytest.raises(FmuError, match="trained with another excitation_node"):
        tracker.start({"method": 1, "excitation_node": 3})
    with FmuSession(fmu) as tracker:
        tracker.start({"method": 1})
        tracker.step(2 * STEP)
        with pytest.raises(FmuError, match="make the communication step shorter"):
            tracker.step(2.01 * STEP)


def test_a_host_that_has_no_rigtwin_runs_the_network(on_python, tmp_path):
    """All that is rigtwin's comes out of the FMU, and is there when the FMU is loaded: its folder may go before it is
    loaded from another."""
    with zipfile.ZipFile(on_python) as archive:
        sources = {name: archive.read(name).decode() for name in archive.namelist() if name.endswith(".py")}
    assert any(name.endswith("tracking/network.py") for name in sources)
    plain = [name for name, text in sources.items() if re.search(r"^ *(from|import) rigtwin[. ]", text, re.MULTILINE)]
    assert not plain
    late = [name for name, text in sources.items() if re.search(r"^ +from rigtwin_", text, re.MULTILINE)]
    assert not [name for name in late if "tracker" in name or "network" in name]


def test_a_rig_that_no_network_knows_has_none(tmp_path):
    other = RIG.model_copy(update={"shaft_damping_ratio": 0.002})
    for build, how in ((build_listener_fmu, {}), (build_native_listener_fmu, {"targets": [this_machine()]})):
        fmu = build(TRACKER, other, tmp_path / build.__name__, **how)
        with FmuSession(fmu) as tracker, pytest.raises(FmuError, match="rigtwin train --tracker"):
            tracker.start({"method": 1})


def test_a_network_belongs_to_its_rig_and_its_nodes(tmp_path):
    known = shipped_tracker()
    assert tracker_network(TRACKER, RIG, (2,), None) == known
    assert tracker_network(TRACKER, RIG, (2, 3), None) is None
    assert tracker_network(TRACKER, load_rig("cantilever"), (2,), None) is None
    with pytest.raises(BuildError, match="trained for the rig nit-rourkela"):
        tracker_network(TRACKER, RIG.model_copy(update={"shaft_damping_ratio": 0.002}), (2,), known)
    with pytest.raises(BuildError, match="trained to read the nodes 2"):
        tracker_network(TRACKER, RIG, (3,), known)
    other = tmp_path / "other.onnx"
    other.write_bytes((known.parent / "stiffness.onnx").read_bytes())
    with pytest.raises(BuildError, match=r"other\.onnx: holds no network of rigtwin train --tracker"):
        tracker_network(TRACKER, RIG, (2,), other)


def test_the_shipped_network_is_small_and_says_what_it_is_for():
    assert shipped_tracker().stat().st_size < 45_000
    card = NETWORK.card
    assert (card["rig"], card["nodes"], card["step"]) == (RIG.name, [2], 2 * STEP)
    assert 0.2 < card["believed_share"] < 1
    assert card["median_error_in_ln_k_b"] < MOST_DOUBTED
