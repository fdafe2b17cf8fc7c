"""``rigtwin modes``, ``campbell``, ``critical-speeds`` and ``unbalance``: numbers, pictures, refusals."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

import rigtwin
from rigtwin.rotor.effects import DiskInertia, Gyroscopic, unbalance_at
from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.frequency.modal import elastic_frequencies_hz, listed_modes, natural_frequencies_hz
from rigtwin.rotor.frequency.whirl import RPM, critical_speeds, unbalance_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_model, build_system
from tests.rigtwin.conftest import run, run_json
from tests.tolerances import EIGENVALUE_ROUND_OFF, ROUND_OFF, SPECTRAL

ROOT = Path(__file__).resolve().parents[2]
PAPER = ROOT / "examples" / "nit-rourkela-paper"
STORED = ROOT / "benchmarks" / "stored_campaigns" / "ross_nothing" / "measured"
DISKS = ("--effect", "disk_inertia", "--effect", "gyroscopic")
COMMANDS = ("modes", "campbell", "critical-speeds", "unbalance")

# A shaft that swings about its one bearing.
SWINGING = """
name = "swinging"
nodes_m = [0.0, 0.2, 0.4]
shaft_damping_ratio = 0.01
[[segment]]
length_m = 0.4
diameter_m = 0.02
youngs_modulus_Pa = 207e9
density_kg_per_m3 = 7840
[[support]]
node = 1
stiffness = "k_b"
"""


def shipped(name: str, *effects, **condition):
    """The linear rotor of a shipped rig."""
    return build_system(assemble(load_rig(name)), Condition(**condition), effects)


# -- modes ---------------------------------------------------------------------------------------


def test_modes_are_those_of_the_rig_file_and_of_the_options():
    found = run_json("modes", "--k-b", 2e6, "--bearing-damping", 30, "--shaft-damping-ratio", 0.002, "--modes", 3)
    modes = listed_modes(shipped("nit-rourkela", k_b=2e6, bearing_damping=30.0, shaft_damping_ratio=0.002))
    assert [mode["mode"] for mode in found["modes"]] == [1, 2, 3]
    for key in ("frequency_hz", "damped_frequency_hz", "damping_ratio", "log_decrement"):
        assert_allclose([mode[key] for mode in found["modes"]], getattr(modes, key)[:3], rtol=EIGENVALUE_ROUND_OFF)
    first = found["modes"][0]
    assert (first["plane"], first["direction"], first["same_in_other_plane"]) == ("y", None, True)
    assert max(first["shape"]["y_re"]) == pytest.approx(1)
    assert len(found["nodes_m"]) == len(first["shape"]["y_re"]) == 7
    assert (found["k_b"], found["bearing_damping"], found["rigid_body_motions"]) == (2e6, 30, 0)


def test_what_no_option_says_is_in_the_rig_file():
    found = run_json("modes", "pump-overhung")
    assert (found["k_b"], found["bearing_damping"], found["shaft_damping_ratio"]) == (2e7, 300, 0.003)
    rigid = run_json("modes", "--rigid")
    assert (rigid["rigid_support"], rigid["k_b"], rigid["bearing_damping"]) == (True, None, None)
    expected = natural_frequencies_hz(shipped("nit-rourkela", rigid_support=True), plane=1)[:6]
    assert_allclose([mode["frequency_hz"] for mode in rigid["modes"]], expected, rtol=EIGENVALUE_ROUND_OFF)


def test_a_spinning_rotor_whirls_backward_and_forward():
    found = run_json("modes", *DISKS, "--set", "gyroscopic.factor=1.2", "--spin-rpm", 9000, "--modes", 4)
    assert [mode["direction"] for mode in found["modes"]] == ["backward", "forward"] * 2
    assert found["effects"] == {"disk_inertia": {"factor": 1.0}, "gyroscopic": {"factor": 1.2}}
    backward, forward = found["modes"][:2]
    assert forward["frequency_hz"] > 1.01 * backward["frequency_hz"]
    size = np.hypot(forward["shape"]["z_re"], forward["shape"]["z_im"])
    assert_allclose(size, np.hypot(forward["shape"]["y_re"], forward["shape"]["y_im"]), rtol=1e-6)  # circles


def test_rigid_body_motions_are_shown_at_zero_hertz_and_have_no_number(tmp_path):
    path = tmp_path / "swinging.toml"
    path.write_text(SWINGING, encoding="utf-8")
    found = run_json("modes", path, "--modes", 2, "--shaft-damping-ratio", 0)
    swing, bending = found["modes"][:2]
    assert (swing["mode"], swing["kind"], swing["frequency_hz"], swing["damping_ratio"]) == (0, "rigid_body", 0, None)
    assert (bending["mode"], bending["kind"]) == (1, "elastic")
    expected = elastic_frequencies_hz(build_system(assemble(load_rig(path)), Condition(k_b=1e7)), plane=1)[0]
    assert_allclose(bending["frequency_hz"], expected, rtol=EIGENVALUE_ROUND_OFF)
    text = run("modes", path).stdout
    assert "rigid body" in text
    assert "2 rigid-body motions, at 0 rev/min, are left out" in run("critical-speeds", path).stdout


def test_the_text_says_what_was_computed():
    text = run("modes", "cantilever", "--modes", 2).stdout
    assert "cantilever on bearings of 10.00 MN/m, 20 N s/m; shaft damping ratio 0.004" in text
    assert "33.390" in text
    assert "in y" in text
    assert "in z" in text
    whirl = run("modes", "pump-overhung", "--spin-rpm", 3000, "--modes", 2)
    assert "spinning at 3000 rev/min" in whirl.stdout
    assert "z, ¼ period later" in whirl.stdout
    assert "node 1" in whirl.stderr
    assert "inertia = true" in whirl.stderr


# -- over the spin speed -------------------------------------------------------------------------


def test_a_campbell_diagram_meets_the_synchronous_line_at_the_critical_speeds():
    found = run_json("campbell", *DISKS, "--shaft-damping-ratio", 0, "--rpm-max", 25_000, "--speeds", 31, "--modes", 4)
    system = shipped("nit-rourkela", DiskInertia(), Gyroscopic(), shaft_damping_ratio=0.0)
    expected = critical_speeds(system, n=4)
    crossings = found["crossings"]
    assert_allclose([c["spin_rpm"] for c in crossings], expected.spin_speed / RPM, rtol=EIGENVALUE_ROUND_OFF)
    assert_allclose([60 * c["frequency_hz"] for c in crossings], expected.spin_speed / RPM, rtol=EIGENVALUE_ROUND_OFF)
    assert [c["direction"] for c in crossings] == ["backward", "forward"] * 2
    assert len(found["spin_rpm"]) == len(found["modes"][0]["frequency_hz"]) == 31
    assert set(found["modes"][0]["direction"][1:]) == {"backward"}


def test_without_a_highest_speed_the_diagram_shows_the_fourth_critical_speed():
    found = run_json("campbell", *DISKS, "--speeds", 11)
    fourth = critical_speeds(shipped("nit-rourkela", DiskInertia(), Gyroscopic()), n=4).spin_speed[3]
    assert_allclose(found["spin_rpm"][-1], 1.2 * fourth / RPM, rtol=ROUND_OFF)
    text = run("campbell", "--rpm-max", 3000, "--speeds", 5, "--modes", 2).stdout
    assert "none" in text  # nothing is met below 3000 rev/min


def test_unbalances_add_up_and_their_phases_turn_the_response():
    speeds = ("--rpm-max", 9000, "--speeds", 5, *DISKS, "--bearing-damping", 50)
    both = run_json("unbalance", "--node", 3, "--node", 5, "--moment", 2e-5, "--moment", 1e-5, "--phase-deg", 0,
                    "--phase-deg", 90, "--read", 4, *speeds)  # fmt: skip
    effects = (DiskInertia(), Gyroscopic(), unbalance_at(3, 2e-5, 0.0), unbalance_at(5, 1e-5, np.pi / 2))
    condition = Condition(bearing_damping=50.0)
    model = build_model(assemble(load_rig("nit-rourkela")), condition, effects)
    expected = unbalance_response(model, np.array(both["spin_rpm"]) * RPM)[:, :, 3]
    (read,) = both["nodes"]
    assert read["node"] == 4
    for place, plane in enumerate("yz"):
        found = np.array(read[f"{plane}_re"]) + 1j * np.array(read[f"{plane}_im"])
        assert_allclose(found, expected[:, place], rtol=0, atol=ROUND_OFF * np.abs(expected).max())
    assert_allclose(read["major_semi_axis_m"], np.abs(expected[:, 0]), rtol=1e-6)  # a round rotor's orbits are circles
    assert len(both["spin_rpm"]) > 100, "more speeds at the critical ones"
    assert both["unbalances"][1] == {"node": 5, "moment_kg_m": 1e-5, "phase_deg": 90}


def test_an_unbalance_sits_at_the_heaviest_disk_and_every_node_that_moves_is_read():
    found = run_json("unbalance", "pump-overhung", "--rigid", "--speeds", 3)
    assert [one["node"] for one in found["unbalances"]] == [7]
    assert [one["node"] for one in found["nodes"]] == [1, 3, 4, 6, 7, 8]


# -- over the stiffness --------------------------------------------------------------------------


def test_the_map_has_the_critical_speeds_of_every_stiffness():
    found = run_json("critical-speeds", *DISKS, "--k-b-min", 1e5, "--k-b-max", 1e8, "--stiffnesses", 7, "--modes", 4)
    assert_allclose(found["k_b"], np.geomspace(1e5, 1e8, 7), rtol=ROUND_OFF)
    columns = np.array([column["spin_rpm"] for column in found["critical_speeds"]])
    expected = critical_speeds(shipped("nit-rourkela", DiskInertia(), Gyroscopic(), k_b=1e8), n=4).spin_speed / RPM
    assert_allclose(np.sort(columns[:, -1]), expected, rtol=EIGENVALUE_ROUND_OFF)
    assert found["measured"] == []


def test_measured_resonances_tell_the_stiffness_of_a_healthy_rig(tmp_path):
    """ROSS' rotor, whose modulus and disk masses deviate by the workshop's tolerances."""
    picture = tmp_path / "map.png"
    found = run_json("critical-speeds", "--campaign", STORED, "--out", picture)
    rigid = [one for one in found["measured"] if one["support"] == "rigid"]
    first, second = [one for one in found["measured"] if one["support"] == "bearing"][:2]
    assert [one["readings"] for one in rigid] == [[], []]
    assert [r["mode"] for r in first["readings"]] == [1, 2]
    assert_allclose(first["readings"][0]["k_b"], second["readings"][0]["k_b"], rtol=0.02)
    assert picture.stat().st_size > 20_000


def test_a_list_of_peaks_is_read_too():
    text = run("critical-speeds", "--campaign", PAPER).stdout
    assert "1.042e+06 N/m (mode 2)" in text
    assert "peaks" in text


# -- pictures ------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_every_command_draws_a_picture(command, suffix, tmp_path):
    path = tmp_path / f"picture{suffix}"
    result = run(command, "--out", path)
    assert result.exit_code == 0, result.stderr
    assert f"{path} written" in result.stdout
    assert [file.name for file in tmp_path.iterdir()] == [path.name], "nothing beside it"
    if suffix == ".svg":
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
        return
    with Image.open(path) as picture:
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    blue = (np.abs(colours.astype(int) - [0x00, 0x72, 0xB2]).max(axis=1) < 8).sum()
    assert blue > 300, "the lines are there"


def test_whirling_modes_are_drawn_with_their_orbits(tmp_path):
    path = tmp_path / "orbits.pdf"
    assert run_json("modes", *DISKS, "--spin-rpm", 9000, "--modes", 3, "--out", path)["picture"] == str(path)
    assert path.read_bytes().startswith(b"%PDF")


def test_modes_load_no_library_that_they_do_not_need(tmp_path):
    """The first picture has to be there within two seconds."""
    watch = "import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); "
    script = watch + "from rigtwin.cli import main; sys.argv = ['rigtwin', 'modes', '--out', sys.argv[1]]; main()"
    command = [sys.executable, "-c", script, str(tmp_path / "modes.png")]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = set(result.stderr.split())
    assert "matplotlib.figure" in loaded
    heavy = {"torch", "plotly", "fmpy", "onnxruntime", "onnx", "jinja2", "matplotlib.pyplot", "scipy.optimize"}
    assert loaded & heavy == set()


# -- supports with tables ------------------------------------------------------------------------

OILED = ROOT / "examples" / "journal_bearings.toml"


def test_modes_on_tables_are_those_at_the_spin_speed_and_say_where_the_rotor_is_unstable():
    found = run_json("modes", OILED, "--spin-rpm", 9000, "--modes", 3)
    structure = assemble(load_rig(OILED))
    system = build_system(structure, Condition(shaft_damping_ratio=0.002, spin_speed=9000 * RPM))
    modes = listed_modes(system, 9000 * RPM)
    decrements = [mode["log_decrement"] for mode in found["modes"]]
    assert_allclose(decrements, modes.log_decrement[:3], rtol=EIGENVALUE_ROUND_OFF)
    assert decrements[0] < 0
    assert (found["k_b"], found["bearing_damping"]) == (None, None)
    text = run("modes", OILED, "--spin-rpm", 9000).stdout
    assert "on 2 supports with tables from 1500 to 12000 rev/min, spinning at 9000 rev/min" in text
    assert "the rotor is unstable" in text


def test_a_campbell_diagram_on_tables_says_from_where_oil_whip_grows():
    found = run_json("campbell", OILED, "--speeds", 40)
    assert_allclose([found["spin_rpm"][0], found["spin_rpm"][-1]], [1500, 12000])
    (limit,) = found["stability_limits"]
    assert limit["grows_above"]
    assert limit["direction"] == "forward"
    assert 0.4 < limit["whirl_ratio"] < 0.6
    structure = assemble(load_rig(OILED))
    for share, grows in ((0.999, False), (1.001, True)):
        spin_speed = share * limit["spin_rpm"] * RPM
        system = build_system(structure, Condition(shaft_damping_ratio=0.002, spin_speed=spin_speed))
        assert (listed_modes(system, spin_speed).log_decrement < 0).any() == grows
    text = run("campbell", OILED, "--speeds", 40).stdout
    assert f"unstable from {limit['spin_rpm']:.1f} rev/min: mode {limit['mode']} grows" in text


def test_unbalance_on_tables_says_where_no_response_is_reached():
    found = run_json("unbalance", OILED, "--node", 4, "--read", 4)
    limit = run_json("campbell", OILED, "--speeds", 40)["stability_limits"][0]["spin_rpm"]
    assert limit < found["unstable_rpm"][0] < 1.05 * limit
    assert found["spin_rpm"][0] == pytest.approx(1500)
    assert "there no steady response is ever reached" in run("unbalance", OILED, "--node", 4).stdout
    assert run_json("unbalance", "--read", 3)["unstable_rpm"] == []


def test_the_map_over_stiffness_shows_where_tables_meet_it(tmp_path):
    picture = tmp_path / "map.svg"
    found = run_json("critical-speeds", OILED, "--modes", 2, "--out", picture)
    assert [support["node"] for support in found["supports_with_tables"]] == [2, 5]
    meets = found["supports_with_tables"][0]["meets"]
    assert {one["of"] for one in meets} == {"kyy", "kzz"}
    lines = found["critical_speeds"]
    for one in meets:
        line = lines[one["whirl"] - 1]["spin_rpm"]
        assert np.interp(np.log(one["k_b"]), np.log(found["k_b"]), line) == pytest.approx(one["spin_rpm"], rel=0.01)
    text = run("critical-speeds", OILED, "--modes", 2).stdout
    assert "k_b takes the place of the supports with tables: alike in y and z, without cross-coupling" in text
    assert "kyy of tables" in picture.read_text(encoding="utf-8")
    assert run_json("critical-speeds", "--stiffnesses", 3)["supports_with_tables"] == []


def test_a_rotor_on_tables_is_built_without_an_estimator(tmp_path):
    result = run("build", OILED, "--out", tmp_path)
    assert "journal-bearings has supports with tables, and k_b says nothing about them" in " ".join(
        result.stderr.split()
    )
    assert [path.name for path in tmp_path.iterdir()] == ["RotorRig.fmu"]


def test_the_response_of_a_model_on_tables_is_that_at_its_spin_speed():
    lines = [20.0, 65.0, 150.0]
    run_at_speed = rigtwin.model_response(OILED, lines, spin_rpm=3000)
    system = build_system(assemble(load_rig(OILED)), Condition(shaft_damping_ratio=0.002, spin_speed=3000 * RPM))
    expected = accelerance(system, np.array(lines), excitation_node=3, spin_speed=3000 * RPM)[:, :, 0]
    assert_allclose(run_at_speed.H, expected, rtol=SPECTRAL, atol=SPECTRAL * np.abs(expected).max())
    assert run_at_speed.spin_rpm == 3000
    with pytest.raises(rigtwin.UserError, match="does not hold 0 rev/min"):
        rigtwin.model_response(OILED, lines)
    with pytest.raises(rigtwin.UserError, match="has supports with tables"):
        rigtwin.model_modes(OILED)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("modes", OILED), "support at node 2 runs from 1500 to 12000 rev/min and does not hold 0 rev/min"),
        (("modes", OILED, "--spin-rpm", 12001), "does not hold 12001 rev/min: choose a spin speed inside"),
        (("modes", OILED, "--spin-rpm", -3000), "does not hold -3000 rev/min"),
        (("campbell", OILED, "--rpm-min", 0), "does not hold 0 rev/min"),
        (("campbell", OILED, "--rpm-min", 13000), "where the supports' tables end; give --rpm-max, too"),
        (("unbalance", OILED, "--rpm-max", 20000), "does not hold"),
        (("modes", OILED, "--k-b", 1e6), '--k-b acts on supports with stiffness = "k_b", and rig journal-bearings has'),
        (("modes", OILED, "--rigid"), "--rigid acts on supports"),
        (("campbell", OILED, "--effect", "pedestal_flexibility"), "--effect pedestal_flexibility acts on supports"),
        (("sweep", OILED), "spin_rpm = 0: this rotor has spin speeds from 1500 to 12000 rev/min; give one"),
        (("estimate", STORED, "--rig", OILED), "has supports with tables, and an estimate of k_b knows bearings"),
    ],
)
def test_rotors_on_tables_refuse_what_they_cannot_be(refused, arguments, words):
    assert words in refused(*arguments)


# -- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nothing.toml",), "nothing.toml: cannot be read"),
        (("--k-b", -1), "k_b must be a positive stiffness in N/m, got -1.0"),
        (("--k-b", 1e6, "--rigid"), "--k-b does nothing beside --rigid"),
        (("--bearing-damping", 3, "--rigid"), "--bearing-damping does nothing beside --rigid"),
        (("--bearing-damping", -3), "bearing_damping must not be negative"),
        (("--bearing-damping", 1e12), "--bearing-damping 1e+12: at most 1e+09 N s/m"),
        (("--effect", "nothing"), "there is no effect 'nothing'"),
        (("--effect", "sensor_gain"), "--effect sensor_gain: belongs to the measurement"),
        (("--effect", "rub"), "--effect rub: is a force law"),
        (("--effect", "unbalance"), "rigtwin unbalance computes what it does"),
        (("--set", "k_b=3"), "use --k-b for this"),
        (("--set", "mass=3"), "write ID.PARAMETER=VALUE"),
        (("--effect", "attached_mass", "--set", "attached_mass.node=99"), "node 99 does not exist"),
        (("--effect", "axial_load", "--set", "axial_load.force=-1e7"), "the rotor buckles"),
        (("--out", "modes.txt"), "unknown kind of picture; give a name that ends in .png, .svg, .pdf"),
        (("--out", "no/such/folder/modes.png"), "the folder no/such/folder does not exist"),
        (("--spin-rpm", "nan"), "--spin-rpm nan: give a number"),
        (("--modes", 40, "--out", "modes.png"), "a picture holds 12 modes at most"),
    ],
)
def test_modes_refuse_what_cannot_be(refused, arguments, words):
    assert words in refused("modes", *arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("campbell", "--rpm-min", -5), "--rpm-min -5: give a speed of 0 rev/min or more"),
        (("campbell", "--rpm-min", 9000, "--rpm-max", 100), "need rpm-min < rpm-max"),
        (("campbell", "--rpm-min", 1e6), "give --rpm-max, too"),
        (("campbell", "--multiple", 0), "--multiple 0: give a positive number"),
        (("critical-speeds", "--k-b-min", 1e9, "--k-b-max", 1e4), "need 0 < k-b-min < k-b-max"),
        (("critical-speeds", "--campaign", "nowhere"), "nowhere"),
        (("critical-speeds", "--effect", "axial_load", "--set", "axial_load.force=-1e7"), "the rotor buckles"),
        (("unbalance", "--node", 9), "--node 9: there is no such node, rig nit-rourkela has nodes 1 to 7"),
        (("unbalance", "--read", 0), "--read 0: there is no such node"),
        (("unbalance", "--moment", 0), "--moment 0: give a positive unbalance in kg m"),
        (("unbalance", "--phase-deg", 700), "--phase-deg 700: give an angle between -360 and 360 degrees"),
        (("unbalance", "--node", 3, "--moment", 1e-5, "--moment", 2e-5), "given 2 times for 1 node;"),
        (("unbalance", "cantilever"), "has no disk: say with --node where the unbalance is"),
        (("unbalance", "--rpm-min", 500, "--rpm-max", 400), "need rpm-min < rpm-max"),
    ],
)
def test_the_other_commands_refuse_what_cannot_be(refused, arguments, words):
    assert words in refused(*arguments)
