"""The rotor whose stiffness is an input: the same rotor, to which another FMU can be connected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description

from rigtwin.api.checks import run_gates
from rigtwin.fmu_src.build import build_native_rotor_fmu, build_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.session import FmuSession

RIG = load_rig("nit-rourkela")
STEP, STEPS = 1e-3, 60
FALLING = np.linspace(3e6, 1e6, STEPS)  # k_b before every step
FORCE = {"k_b": 3e6, "force_amplitude": 1.0, "force_frequency": 60.0}


@pytest.fixture(scope="module", params=["2.0", "3.0", "Python"])
def with_input(request, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("k_b_input")
    if request.param == "Python":
        return build_rotor_fmu(RIG, folder, k_b_input=True)
    return build_native_rotor_fmu(RIG, folder, fmi=request.param, targets=[this_machine()], k_b_input=True)


def motion(fmu: Path) -> np.ndarray:
    """Acceleration of node 2 after every step while k_b falls."""
    with FmuSession(fmu) as rotor:
        rotor.start(FORCE)
        found = []
        for k_b in FALLING:
            rotor.set({"k_b": float(k_b)})
            rotor.step(STEP)
            found += rotor.get(["node_2.acceleration_y"])
    return np.array(found)


def test_it_moves_as_the_rotor_whose_parameter_is_set_between_steps(with_input, rotor_fmu):
    expected = motion(rotor_fmu)
    assert expected.std() > 0.1
    np.testing.assert_allclose(motion(with_input), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_k_b_is_an_input_that_accelerations_answer_at_once(with_input):
    read = read_model_description(str(with_input))
    by_name = {v.name: v for v in read.modelVariables}
    assert (by_name["k_b"].causality, by_name["k_b"].start) == ("input", repr(RIG.k_b.start_N_per_m).removesuffix(".0"))
    answers = next(o for o in read.outputs if o.variable.name == "node_2.acceleration_y")
    assert "k_b" in {v.name for v in answers.dependencies}


@pytest.mark.parametrize("with_input", ["2.0"], indirect=True)
def test_every_gate_of_the_check_passes(with_input):
    assert {gate.name: gate.message for gate in run_gates(with_input, None, 600) if gate.outcome != "passed"} == {}
