"""FMUs that only these tests need, and one open session for tests that share a process."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import pytest

from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig, parse_rig
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.session import FmuSession


@pytest.fixture(params=["rotor_fmu", "estimator_fmu"])
def fmu(request: pytest.FixtureRequest) -> Path:
    """Each of the two FMUs in turn."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def larger_disks() -> Rig:
    """The shipped rig with 150 mm disks instead of 124 mm."""
    text = files("rigtwin.rotor").joinpath("rigs", "nit-rourkela.toml").read_text(encoding="utf-8")
    return parse_rig(text.replace("diameter_m = 0.124", "diameter_m = 0.150"))


@pytest.fixture(scope="session")
def larger_disks_fmu(larger_disks: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu`` of another rig: same file name, same class name, other numbers."""
    from rigtwin.fmu_src.build import build_rotor_fmu

    return build_rotor_fmu(larger_disks, tmp_path_factory.mktemp("larger_disks"))


@pytest.fixture(scope="session")
def structure() -> Structure:
    """The shipped rotor without its supports."""
    return assemble(load_rig("nit-rourkela"))


@pytest.fixture(scope="package")
def rotor_session(rotor_fmu: Path) -> Iterator[FmuSession]:
    """An open rotor FMU; every test restarts it."""
    with FmuSession(rotor_fmu) as session:
        yield session


@pytest.fixture(scope="package")
def estimator_session(estimator_fmu: Path) -> Iterator[FmuSession]:
    """An open estimator FMU; every test restarts it."""
    with FmuSession(estimator_fmu) as session:
        yield session
