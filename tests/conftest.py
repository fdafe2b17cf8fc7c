"""Settings and guards for every test: none may leave the process in another state than it found it in."""

from __future__ import annotations

import ctypes
import os
import random
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rich.style  # noqa: F401 - draws a random number when it is imported, which is no test's doing
from hypothesis import settings

# A busy machine must not fail a test, nor one run in a hundred. To look further:
# pytest --hypothesis-profile=default --hypothesis-seed=random
settings.register_profile("rigtwin", deadline=None, derandomize=True)
settings.load_profile("rigtwin")


# What the Python packages do not bring: a program or a library, its Debian package, and the tests that need it.
TOOLS = (
    ("cc", "gcc libc6-dev", "the printed force laws in C, sanitizers, FMI calls in random order"),
    ("libtbb.so.12", "libtbb12", "the ecos command as an importer (tests/fmu/native/test_importers.py)"),
    ("chromium", "chromium", "rendered HTML pages (tests/rigtwin/test_pages_in_browser.py, test_app.py)"),
)


def _is_there(tool: str) -> bool:
    if ".so" not in tool:
        return shutil.which(tool) is not None
    try:
        ctypes.CDLL(tool)
    except OSError:
        return False
    return True


def pytest_report_header() -> list[str]:
    """What is missing on this machine, which tests fail or are left out for it, and how to get it."""
    return [
        f"{tool} is missing ({tests} cannot run): apt-get install {package}"
        for tool, package, tests in TOOLS
        if not _is_there(tool)
    ]


def process_state() -> dict[str, Any]:
    """What a test must not change: global random states, floating-point errors, working directory."""
    algorithm, keys, *position = np.random.get_state(legacy=True)  # noqa: NPY002 - watched, not used
    return {
        "the global numpy random state": (algorithm, keys.tobytes(), *position),
        "the global random state": random.getstate(),
        "np.seterr": np.geterr(),
        "the working directory": os.getcwd(),
    }


@pytest.fixture(autouse=True)
def _process_state_is_left_alone() -> Iterator[None]:
    before = process_state()
    yield
    after = process_state()
    changed = [name for name in before if before[name] != after[name]]
    if changed:
        os.chdir(before["the working directory"])
        pytest.fail(f"the test changed {' and '.join(changed)}", pytrace=False)


@pytest.fixture(scope="session", autouse=True)
def _own_list_of_fmus(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What tests build does not count as the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session")
def rotor_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu`` of the shipped rig, built once for all tests."""
    from rigtwin.fmu_src.build import build_rotor_fmu
    from rigtwin.rotor.geometry.rig import load_rig

    return build_rotor_fmu(load_rig("nit-rourkela"), tmp_path_factory.mktemp("rotor_fmu"))


@pytest.fixture(scope="session")
def estimator_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``StiffnessEstimator.fmu`` around the shipped network, built once for all tests."""
    from rigtwin.fmu_src.build import build_estimator_fmu

    return build_estimator_fmu(tmp_path_factory.mktemp("estimator_fmu"))
