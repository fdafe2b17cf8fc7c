"""The self-contained FMUs in place of pythonfmu's, for every test in this folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from build_fmu import build_native_estimator_fmu, build_native_rotor_fmu
from fmu_src.compiling import this_machine
from rotor.rig import Rig, load_rig
from sim.session import FmuSession


@pytest.fixture(scope="session")
def rotor_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu`` of the shipped rig, FMI 2.0, for this machine."""
    folder = tmp_path_factory.mktemp("native_rotor")
    return build_native_rotor_fmu(load_rig("nit-rourkela"), folder, targets=[this_machine()])


@pytest.fixture(scope="session")
def estimator_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``StiffnessEstimator.fmu``, FMI 2.0, for this machine."""
    return build_native_estimator_fmu(tmp_path_factory.mktemp("native_estimator"), targets=[this_machine()])


@pytest.fixture(scope="session")
def larger_disks_fmu(larger_disks: Rig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu`` of another rig."""
    return build_native_rotor_fmu(larger_disks, tmp_path_factory.mktemp("native_disks"), targets=[this_machine()])


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
