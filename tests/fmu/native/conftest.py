"""The self-contained FMUs in place of pythonfmu's, for every test in this folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigtwin.fmu_src import compiling
from rigtwin.fmu_src.build import build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.sim.session import FmuSession
from tests.fmu.native.sanitizers import SANITIZED, sanitized_compiler

if SANITIZED in os.environ:
    compiling.compiler = sanitized_compiler


def build(name: str, fmi: str, made: pytest.TempPathFactory) -> Path:
    """One of the shipped rig's FMUs, for this machine."""
    folder, options = made.mktemp("native"), {"fmi": fmi, "targets": [this_machine()]}
    if name == "StiffnessEstimator":
        return build_native_estimator_fmu(folder, **options)
    return build_native_rotor_fmu(load_rig("nit-rourkela"), folder, **options)


@pytest.fixture(scope="session")
def rotor_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu``, FMI 2.0."""
    return build("RotorRig", "2.0", tmp_path_factory)


@pytest.fixture(scope="session")
def estimator_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``StiffnessEstimator.fmu``, FMI 2.0."""
    return build("StiffnessEstimator", "2.0", tmp_path_factory)


@pytest.fixture(scope="session")
def rotor3(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu``, FMI 3.0."""
    return build("RotorRig", "3.0", tmp_path_factory)


@pytest.fixture(scope="session")
def rotor3_with_array(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu``, FMI 3.0, built with its accelerations as an array, too."""
    folder, rig = tmp_path_factory.mktemp("with_array"), load_rig("nit-rourkela")
    return build_native_rotor_fmu(rig, folder, fmi="3.0", targets=[this_machine()], array_output=True)


@pytest.fixture(scope="session")
def estimator3(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``StiffnessEstimator.fmu``, FMI 3.0."""
    return build("StiffnessEstimator", "3.0", tmp_path_factory)


@pytest.fixture(
    params=[
        "rotor_fmu",
        *(pytest.param(name, marks=pytest.mark.long) for name in ("estimator_fmu", "rotor3")),
        "estimator3",
    ]
)
def any_fmu(request: pytest.FixtureRequest) -> Path:
    """Each of the four in turn."""
    return request.getfixturevalue(request.param)


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
