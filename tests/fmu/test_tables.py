"""FMUs of a rotor on supports with tables: range and start of the spin speed, response, what is refused."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.fmu_src.build import build_native_rotor_fmu, build_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.session import FmuSession
from tests.fmu.child import in_child
from tests.rotor.journals import RPM, disk_in_oil
from tests.tolerances import SETTLED_LINE

RIG = disk_in_oil(shaft_damping_ratio=0.01)
OILED = 3456.0 * RPM


@pytest.fixture(scope="module", params=["python", "2.0"])
def oiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``RotorRig.fmu`` of the rig on tables, on the host's Python and compiled."""
    folder = tmp_path_factory.mktemp("oiled")
    if request.param == "python":
        return build_rotor_fmu(RIG, folder)
    return build_native_rotor_fmu(RIG, folder, fmi=request.param, targets=[this_machine()])


def response(path, spin_speed, frequency):
    """Peak of the accelerations in y at the nodes once the built-in sine has settled."""
    import fmpy

    result = fmpy.simulate_fmu(
        path,
        stop_time=4.0,
        output_interval=1 / frequency / 64,
        start_values={"spin_speed": spin_speed, "force_amplitude": 1.0, "force_frequency": frequency},
        output=[f"node_{n}.acceleration_y" for n in (1, 2, 3, 4)],
    )
    last = [[row[name] for name in result.dtype.names[1:]] for row in result[-64:]]
    return [[float(x) for x in row] for row in last]


def refusal(path, spin_speed):
    """What fmpy raises at a spin speed."""
    import fmpy

    try:
        fmpy.simulate_fmu(path, stop_time=1e-3, start_values={"spin_speed": spin_speed})
    except Exception as error:
        return str(error) or type(error).__name__
    return ""


def test_the_spin_speed_has_the_range_of_the_tables_and_starts_at_its_lowest(oiled):
    variables = {v.name: v for v in fmpy.read_model_description(str(oiled)).modelVariables}
    spin = variables["spin_speed"]
    low, high, start = (float(x) for x in (spin.min, spin.max, spin.start))
    assert start == pytest.approx(2000 * RPM, rel=1e-15)
    assert 0 <= 2000 * RPM - low <= 1e-5 * low
    assert 0 <= high - 11000 * RPM <= 1e-5 * high
    with zipfile.ZipFile(oiled) as archive:
        described = json.loads(archive.read("extra/rigtwin/metadata.json"))
        page = archive.read("documentation/index.html").decode()
    assert described["validity"]["spin_speed_rad_per_s"] == [low, high]
    assert "follow the spin speed" in page
    assert "do nothing" in page


def test_it_answers_as_the_frequency_response_on_tables(oiled):
    """Of samples of a settled period at 64 points, the first harmonic."""
    frequency = 47.0
    rows = np.array(in_child(response, oiled, OILED, frequency))
    structure = assemble(RIG)
    system = build_system(structure, Condition(shaft_damping_ratio=0.01, spin_speed=OILED))
    expected = accelerance(system, np.array([frequency]), spin_speed=OILED)[0, :, 0]
    amplitude = np.abs(2 / 64 * np.exp(-2j * np.pi * np.arange(64) / 64) @ rows)
    assert_allclose(amplitude, np.abs(expected), rtol=10 * SETTLED_LINE)
    still = accelerance(system, np.array([frequency]), spin_speed=2000 * RPM)[0, :, 0]
    assert np.abs(np.abs(still) - amplitude).max() > 0.05 * amplitude.max()


@pytest.mark.parametrize("rpm", [0.0, 11500.0])
def test_a_speed_outside_the_tables_is_refused(oiled, rpm):
    assert in_child(refusal, oiled, rpm * RPM)


def test_the_refusal_is_a_sentence(oiled):
    with FmuSession(oiled) as session, pytest.raises(Exception, match="spin_speed must be at least"):
        session.start({"spin_speed": 0.0})
