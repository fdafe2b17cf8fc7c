"""``rigtwin sweep`` with effects, force levels and directions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.api.sweeps import SweepRequest
from rigtwin.commands.sweep import Output, run_sweep
from rigtwin.rotor.effects import EFFECTS, AttachedMass, SensorGain
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.formats import read_run
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import measure_lines
from tests.rigtwin.conftest import run, run_json
from tests.tolerances import SETTLED_LINE

BAND = ("--f-min", 90, "--f-max", 110, "--lines", 8)


def test_effects_of_rotor_and_chain_are_switched_on_with_their_parameters(rotor_fmu, tmp_path):
    path = tmp_path / "run.h5"
    found = run_json(
        *("sweep", rotor_fmu, *BAND, "--effect", "attached_mass", "--effect", "sensor_gain", "--out", path),
        *("--set", "attached_mass.mass=0.3", "--set", "sensor_gain.node=4", "--set", "k_b=3e6"),
    )
    collar = {"mass": 0.3, "node": 4, "half_width": 0.0}
    assert found["effects"] == {"attached_mass": collar, "sensor_gain": {"gain": 1.1, "node": 4}}
    assert found["parameters"] == {"k_b": 3e6}
    swept = read_run(path)
    effects = AttachedMass(mass=0.3), SensorGain(node=4)
    structure = assemble(load_rig("nit-rourkela"))
    expected = measured_response(structure, Condition(k_b=3e6), effects, swept.frequency_hz)
    assert_allclose(swept.H, expected, rtol=0, atol=SETTLED_LINE * np.abs(expected).max())


@pytest.mark.parametrize("key", [key for key, effect in EFFECTS.items() if effect.family == "chain"])
def test_every_effect_of_the_chain_is_known(rotor_fmu, key):
    found = run_json("sweep", rotor_fmu, "--f-min", 90, "--f-max", 95, "--lines", 8, "--effect", key)
    assert list(found["effects"]) == [key]
    assert found["largest_remaining_transient"] is None or key != "fast_sweep"


def test_levels_make_a_run_and_a_file_each(rotor_fmu, tmp_path):
    arguments = ("sweep", rotor_fmu, *BAND, "--levels", "0.5,2", "--noise", 0.01, "--out", tmp_path / "run.csv")
    result = run(*arguments)
    assert result.exit_code == 0, result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run_0.5N.csv", "run_2N.csv"]
    assert "force 0.5 N at node 2" in result.stdout
    low, high = (read_run(tmp_path / f"run_{level}N.csv", support="bearing") for level in ("0.5", "2"))
    relative = np.abs(low.H / high.H - 1)
    assert 0.001 < np.median(relative) < 0.1  # the same rotor, another noise
    found = run_json(*arguments)["runs"]
    assert [one["force_amplitude_N"] for one in found] == [0.5, 2.0]


def test_direction_is_in_the_run(rotor_fmu, tmp_path):
    path = tmp_path / "run.h5"
    assert run_json("sweep", rotor_fmu, *BAND, "--direction", "down", "--out", path)["sweep"] == "down"
    assert read_run(path).sweep == "down"
    assert run_json("sweep", rotor_fmu, *BAND)["sweep"] == "up"


def test_accelerometers_across_the_force_see_what_the_bearings_turn(rotor_fmu, tmp_path):
    path = tmp_path / "run.csv"
    run_json("sweep", rotor_fmu, *BAND, "--effect", "plane_anisotropy", "--across", "--out", path)
    swept = read_run(path, support="bearing")
    assert {(c.node, c.plane) for c in swept.channels} == {(node, plane) for node in range(1, 8) for plane in "yz"}
    assert np.abs(swept.channel(2, "z")).max() > 0.05 * np.abs(swept.channel(2)).max()


def test_a_run_at_the_nominal_force_holds_accelerations(rotor_fmu, tmp_path):
    files = tmp_path / "per_force.h5", tmp_path / "as_it_is.h5"
    run_json("sweep", rotor_fmu, *BAND, "--force", 4, "--out", files[0])
    run_json("sweep", rotor_fmu, *BAND, "--force", 4, "--quantity", "acceleration", "--out", files[1])
    per_force, recorded = map(read_run, files)
    assert (per_force.quantity, recorded.quantity) == ("accelerance", "acceleration")
    assert_allclose(recorded.H, 4 * per_force.H, rtol=1e-9, atol=0)


def test_text_names_the_effects(rotor_fmu):
    printed = run("sweep", rotor_fmu, *BAND, "--effect", "sensor_delay", "--set", "sensor_delay.delay=1e-3").stdout
    assert "with sensor_delay: delay = 0.001, node = 0" in printed


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ("--effect", "sensor_gains"),
            "--effect sensor_gains: there is no effect 'sensor_gains'; did you mean sensor_gain?",
        ),
        (("--effect", "rub", "--effect", "rub"), "--effect rub: given twice"),
        (
            ("--effect", "sensor_gain", "--set", "sensor_gain.mass=1"),
            "--set sensor_gain.mass=1: sensor_gain has no parameter mass; it has gain, node",
        ),
        (("--set", "sensor_gain.gain=1"), "an effect is switched on with --effect sensor_gain"),
        (
            ("--effect", "attached_mass", "--set", "attached_mass.enabled=true"),
            "an effect is switched on with --effect attached_mass",
        ),
        (("--effect", "sensor_gain", "--set", "sensor_gain.gain=high"), "'high' is not a number"),
        (("--effect", "sensor_gain", "--set", "sensor_gain.node=2.5"), "'2.5' is not a whole number"),
        (("--effect", "sensor_gain", "--set", "sensor_gain.node=8"), "sensor_gain.node: node 8 does not exist"),
        (
            ("--effect", "attached_mass", "--set", "attached_mass.mass=-1"),
            "attached_mass.mass must be at least 0 kg, got -1",
        ),
        (
            ("--effect", "open_crack", "--set", "open_crack.position=9"),
            "open_crack.position must be at most 0.426 m, got 9",
        ),
        (("--effect", "force_dropout", "--effect", "fast_sweep"), "give force_dropout or fast_sweep"),
        (("--levels", "1,1"), "the forces must be positive and different"),
        (("--levels", "1.0000001,1.0000002"), "different in six digits"),
        (("--levels", "1,-2"), "the forces must be positive and different"),
        (("--levels", "low"), "write forces in newtons"),
        (("--force", 0), "--force 0: the force must be positive"),
        (("--direction", "left"), "'left' is not one of 'up', 'down'"),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else "",
)
def test_what_makes_no_sense_gives_one_message(refused, rotor_fmu, options, said):
    assert said in refused("sweep", rotor_fmu, *BAND, *options)


def test_remarks_on_lines_are_told(rotor_fmu, monkeypatch):
    """All of them in the record, the first three in the text."""

    def with_remarks(fmu, rig, plan, _progress):
        with FmuSession(fmu) as session:
            result = measure_lines(session, rig, plan, [91.0, 92.0, 93.0, 94.0, 95.0])
        lines = [replace(line, remark=f"{line.frequency_hz:g} Hz: it rattles") for line in result.lines]
        return replace(result, lines=tuple(lines))

    monkeypatch.setattr("rigtwin.api.sweeps.sweep_one", with_remarks)
    assert run_json("sweep", rotor_fmu)["remarks"] == [f"{f} Hz: it rattles" for f in range(91, 96)]
    said = run("sweep", rotor_fmu).stderr.splitlines()
    assert said[:3] == [f"rigtwin: {f} Hz: it rattles" for f in (91, 92, 93)]
    assert said[3:] == ["rigtwin: and 2 more lines with such remarks; --json lists them"]


@pytest.mark.parametrize(("noise", "said"), [(0.01, False), (1.0, True)])
def test_noise_that_looks_like_resonances_is_remarked_upon(monkeypatch, capsys, noise, said):
    monkeypatch.setattr("rigtwin.commands.sweep.measure", lambda *_: iter(()))
    run_sweep(SweepRequest("nit-rourkela", noise=noise), Output(None, as_json=False))
    assert ("noise of 100 % of each line looks like resonances" in capsys.readouterr().err) == said
