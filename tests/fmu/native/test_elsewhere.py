"""The host in C that carries the binaries to other platforms, on this one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from rigtwin.fmu_src.compiling import this_machine
from tests.fmu.native.elsewhere import SINE, STARTS, STEPS, H, difference, estimator_script, rotor_script, run


@pytest.fixture(scope="module")
def there(rotor_fmu, tmp_path_factory):
    """(1 + 3 STEPS + 1, n_outputs) what the host reads of a rotor with clearance."""
    script = rotor_script(rotor_fmu, STARTS["clearance"])
    numbers = run(rotor_fmu, this_machine(), script, tmp_path_factory.mktemp("host"))
    return np.array(numbers).reshape(2 + 3 * STEPS, -1)


def test_it_reads_what_fmpy_reads(there, rotor_session):
    outputs = [v.name for v in rotor_session.description.modelVariables if v.causality == "output"]
    rotor_session.start(SINE | STARTS["clearance"])
    assert_allclose(there[: 1 + 2 * STEPS], rotor_session.sample(outputs, H, 1 + 2 * STEPS), rtol=1e-12, atol=1e-12)


def test_it_goes_back_to_a_state(there):
    assert_array_equal(there[1 + STEPS : 1 + 2 * STEPS], there[1 + 2 * STEPS : 1 + 3 * STEPS])
    assert np.any(there[-1] != there[-2])  # another k_b


def test_it_asks_the_estimator(estimator_fmu, estimator_session, tmp_path):
    numbers = run(estimator_fmu, this_machine(), estimator_script(estimator_fmu), tmp_path)
    estimator_session.start()
    assert numbers[0] == pytest.approx(estimator_session.get(["k_b"])[0], rel=1e-12)
    assert len(set(numbers)) == 12


def test_a_call_that_fails_is_told(rotor_fmu, tmp_path):
    script = rotor_script(rotor_fmu, {"k_b": -1.0})
    with pytest.raises(RuntimeError, match="k_b"):
        run(rotor_fmu, this_machine(), script, tmp_path)


def test_differences_are_seen():
    assert difference([1.0, -2.0], [1.0, -2.1]) == pytest.approx(0.05)
    assert difference([1.0], [1.0, 2.0]) == difference([], []) == np.inf
