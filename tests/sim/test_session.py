"""One FMU instance from unzip to free: it starts at rest, says what went wrong, and leaves nothing behind."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fmpy import platform, platform_tuple
from numpy.testing import assert_array_equal

from rigtwin.sim.session import FmuError, FmuSession

NODE_2 = "node_2.acceleration_y"
SINE = {"force_amplitude": 1.0, "force_frequency": 90.0}


@pytest.fixture(autouse=True)
def temporary_files(tmp_path, monkeypatch) -> Path:
    """A folder for temporary files of this test's own, so that leftovers show."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def session(rotor_fmu) -> Iterator[FmuSession]:
    with FmuSession(rotor_fmu) as opened:
        yield opened


def repacked(fmu: Path, target: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A copy of an FMU with files changed or, where ``change`` returns None, left out."""
    with zipfile.ZipFile(fmu) as original, zipfile.ZipFile(target, "w") as copy:
        for name in original.namelist():
            content = change(name, original.read(name))
            if content is not None:
                copy.writestr(name, content)
    return target


def zip_with(target: Path, **files: str) -> Path:
    with zipfile.ZipFile(target, "w") as archive:
        for name, text in files.items():
            archive.writestr(name.replace("_", "."), text)
    return target


def response_from_start(session: FmuSession) -> np.ndarray:
    session.start(SINE)
    return session.sample([NODE_2, "force_applied"], 1e-3, 50)


def test_a_binary_that_is_named_by_its_processor_is_the_one_that_is_loaded(tmp_path, rotor_fmu):
    """FMI 2.0 has no name for processors other than x86."""
    usual = f"binaries/{platform}/"
    two = repacked(rotor_fmu, tmp_path / "two.fmu", lambda name, content: b"another's" if usual in name else content)
    with zipfile.ZipFile(rotor_fmu) as original, zipfile.ZipFile(two, "a") as copy:
        for name in (name for name in original.namelist() if usual in name):
            copy.writestr(name.replace(usual, f"binaries/{platform_tuple}/"), original.read(name))
    with FmuSession(two) as session, FmuSession(rotor_fmu) as plain:
        assert_array_equal(response_from_start(session), response_from_start(plain))


# -- a run ---------------------------------------------------------------------------------------


def test_a_fresh_rotor_is_at_rest(session):
    session.start()
    assert session.time == 0.0
    assert session.get([name for name in session.variables if ".acceleration_" in name]) == [0.0] * 14


def test_a_restart_begins_at_rest_with_the_start_values(session):
    first = response_from_start(session)
    session.set({"k_b": 1e6})
    session.step(1.0)
    assert session.get([NODE_2, "k_b"])[0] != 0.0
    again = response_from_start(session)
    assert session.get(["k_b"]) == [1e7]
    assert first[0, 0] == 0.0
    assert np.abs(first).max() > 0
    assert_array_equal(again, first)


def test_a_restart_may_change_the_degrees_of_freedom(session):
    response_from_start(session)
    session.start({"rigid_support": True, **SINE})
    session.step(0.01)
    assert session.get(["rigid_support", "node_1.acceleration_y"]) == [True, 0.0]
    assert session.get([NODE_2])[0] != 0.0


def test_samples_are_what_single_steps_read(session):
    sampled = response_from_start(session)
    assert session.time == pytest.approx(0.049)
    session.start(SINE)
    stepped = [session.get([NODE_2, "force_applied"])]
    for _ in range(49):
        session.step(1e-3)
        stepped.append(session.get([NODE_2, "force_applied"]))
    assert_array_equal(sampled, stepped)


def test_every_type_of_variable_is_set_and_read(session):
    values = {"k_b": 2.5e6, "excitation_node": 4, "rigid_support": True}
    session.start(values)
    assert session.get(list(values)) == list(values.values())


def test_a_saved_state_replays_to_the_last_bit(session):
    response_from_start(session)
    saved = session.save_state()
    ahead = session.sample([NODE_2], 1e-3, 20)
    session.set({"force_frequency": 33.0})
    session.restore_state(saved)
    assert session.time == saved.time
    assert_array_equal(session.sample([NODE_2], 1e-3, 20), ahead)


# -- what is refused, and how --------------------------------------------------------------------

WRONG_CALLS: dict[str, Callable[[FmuSession], object]] = {
    "start": lambda s: s.start({"stiffness": 1.0}),
    "set": lambda s: s.set({"stiffness": 1.0}),
    "get": lambda s: s.get([NODE_2, "stiffness"]),
    "sample": lambda s: s.sample(["stiffness"], 0.1, 2),
}


@pytest.mark.parametrize("call", WRONG_CALLS.values(), ids=WRONG_CALLS)
def test_a_variable_that_is_not_there_is_named(session, call):
    session.start()
    with pytest.raises(FmuError, match=r"^RotorRig has no variable 'stiffness'$"):
        call(session)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"k_b": -1.0}, "k_b must be at least 10000 N/m, got -1"),
        ({"k_b": math.nan}, "k_b must be a finite number, got nan"),
        ({"excitation_node": 8}, "excitation_node must be at most 7, got 8"),
        ({NODE_2: 1.0}, "node_2.acceleration_y is an output and cannot be set"),
    ],
)
def test_what_the_fmu_wrote_to_its_log_is_in_the_error(session, values, sentence):
    with pytest.raises(FmuError) as refused:
        session.start(values)
    assert "fmi2Set" in str(refused.value)
    assert sentence in str(refused.value)


def test_an_error_carries_its_own_log_only(session):
    for value in (-1.0, -2.0):
        with pytest.raises(FmuError) as refused:
            session.start({"k_b": value})
    assert "got -2" in str(refused.value)
    assert "got -1" not in str(refused.value)


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan])
def test_a_step_that_goes_nowhere_is_refused_and_time_stands_still(session, step):
    session.start()
    for call in (lambda: session.step(step), lambda: session.sample([NODE_2], step, 2)):
        with pytest.raises(FmuError, match="communication step must be"):
            call()
        assert session.time == 0.0


def test_a_fixed_parameter_cannot_change_during_a_run(session):
    session.start(SINE)
    session.step(0.1)
    with pytest.raises(FmuError, match="rigid_support can only be set before the simulation starts"):
        session.set({"rigid_support": True})


def test_a_refused_run_leaves_a_session_that_works(session):
    expected = response_from_start(session)
    with pytest.raises(FmuError):
        session.start({"k_b": -1.0})
    assert_array_equal(response_from_start(session), expected)


# -- what is no FMU of ours ----------------------------------------------------------------------


def test_a_missing_file_is_named(tmp_path, temporary_files):
    with pytest.raises(FmuError, match=r"absent\.fmu cannot be read as an FMU"):
        FmuSession(tmp_path / "absent.fmu")
    assert list(temporary_files.iterdir()) == []


def test_a_text_file_and_half_a_download_are_refused(tmp_path, rotor_fmu, temporary_files):
    for name, content in {"text.fmu": b"no zip", "half.fmu": rotor_fmu.read_bytes()[:5000]}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FmuError, match=rf"{name} cannot be read as an FMU"):
            FmuSession(tmp_path / name)
    assert list(temporary_files.iterdir()) == []


def test_a_damaged_byte_is_noticed(tmp_path, rotor_fmu, temporary_files):
    content = bytearray(rotor_fmu.read_bytes())
    content[len(content) // 3] ^= 0xFF
    (tmp_path / "damaged.fmu").write_bytes(content)
    with pytest.raises(FmuError, match=r"damaged\.fmu cannot be read as an FMU"):
        FmuSession(tmp_path / "damaged.fmu")
    assert list(temporary_files.iterdir()) == []


@pytest.mark.parametrize(
    "files",
    [
        {"readme_txt": "a zip, but no FMU"},
        {"modelDescription_xml": "<fmiModelDescription"},
        {"modelDescription_xml": "<fmiModelDescription fmiVersion='1.5'/>"},
        {"modelDescription_xml": "<fmiModelDescription fmiVersion='2.0'/>"},
    ],
    ids=["no description", "broken XML", "unknown version", "against the schema"],
)
def test_a_zip_that_is_no_fmu_is_refused(tmp_path, temporary_files, files):
    with pytest.raises(FmuError, match=r"other\.fmu cannot be read as an FMU"):
        FmuSession(zip_with(tmp_path / "other.fmu", **files))
    assert list(temporary_files.iterdir()) == []


def test_model_exchange_is_not_what_this_rig_drives(tmp_path, rotor_fmu, temporary_files):
    def model_exchange(_name: str, content: bytes) -> bytes:
        return re.sub(rb"<CoSimulation[^>]*/>", b'<ModelExchange modelIdentifier="RotorRig"/>', content)

    with pytest.raises(FmuError, match=r"^RotorRig is not an FMI 2\.0 or 3\.0 co-simulation FMU$"):
        FmuSession(repacked(rotor_fmu, tmp_path / "other.fmu", model_exchange))
    assert list(temporary_files.iterdir()) == []


@pytest.mark.parametrize(
    ("broken", "sentence"),
    [
        (lambda name, content: None if name.endswith(".so") else content, "Cannot find shared library"),
        (lambda name, content: b"damaged" if name.endswith(".so") else content, "Failed to load shared library"),
        (lambda name, content: None if name.endswith("structure.npz") else content, "FileNotFoundError"),
    ],
    ids=["no library", "no such library", "slave that raises"],
)
def test_an_fmu_that_does_not_start_says_why_and_leaves_nothing_behind(
    tmp_path, rotor_fmu, temporary_files, broken, sentence
):
    """Not even another working directory: fmpy changes it to load the library."""
    if sys.platform != "linux":
        pytest.skip("names the library of this platform")
    with pytest.raises(FmuError, match=sentence):
        FmuSession(repacked(rotor_fmu, tmp_path / "broken.fmu", broken))
    assert list(temporary_files.iterdir()) == []


def test_a_folder_that_would_crash_the_loader_is_refused(tmp_path, rotor_fmu, monkeypatch):
    folder = tmp_path / "a+b"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    with pytest.raises(FmuError, match="set TMPDIR"):
        FmuSession(rotor_fmu)
    assert list(folder.iterdir()) == []


# -- the end -------------------------------------------------------------------------------------


def test_closing_deletes_the_unpacked_files(rotor_fmu, temporary_files):
    with FmuSession(rotor_fmu):
        assert len(list(temporary_files.iterdir())) == 1
    assert list(temporary_files.iterdir()) == []


def test_an_error_inside_the_session_deletes_them_too(rotor_fmu, temporary_files):
    with pytest.raises(ZeroDivisionError), FmuSession(rotor_fmu):
        _ = 1 / 0
    assert list(temporary_files.iterdir()) == []


def test_a_closed_session_refuses_calls_and_a_second_close_does_nothing(rotor_fmu):
    """In a process of its own: the library would answer both with a segmentation fault."""
    script = """
import sys
from rigtwin.sim.session import FmuError, FmuSession

session = FmuSession(sys.argv[1])
session.start()
session.close()
session.close()
for call in (session.start, lambda: session.step(0.1), lambda: session.sample(["k_b"], 0.1, 1), session.save_state):
    try:
        call()
    except FmuError as error:
        print(error)
"""
    run = subprocess.run([sys.executable, "-c", script, rotor_fmu], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines() == ["the session of RotorRig is closed; open a new one"] * 4
