"""``import rigtwin``: names that are found lazily, results that show themselves, errors that are the user's."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose

import rigtwin
from rigtwin.errors import UserError, for_users
from rigtwin.rotor.geometry.rig import RigError
from rigtwin.rotor.model import html
from rigtwin.sim.formats import read_run
from tests.rigtwin.conftest import run, run_json

ROOT = Path(__file__).resolve().parents[2]
OWN_ROTOR = ROOT / "examples" / "own_rotor.toml"
SOURCE = ast.parse((ROOT / "rigtwin" / "__init__.py").read_text(encoding="utf-8"))


# -- names -----------------------------------------------------------------------------------------------


def test_importing_rigtwin_imports_none_of_its_rooms():
    script = "import sys, rigtwin; print(*[m for m in sys.modules if m.startswith('rigtwin.') or m == 'numpy'])"
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout == "\n"


def test_every_public_name_is_there_documented_and_known_to_type_checkers():
    for name in rigtwin.__all__:
        value = getattr(rigtwin, name)
        assert inspect.getdoc(value), name
        if inspect.isfunction(value):
            hints = inspect.signature(value)
            assert hints.return_annotation is not inspect.Signature.empty, name
            assert all(p.annotation is not p.empty for p in hints.parameters.values()), name
            assert ">>>" in (value.__doc__ or ""), f"{name} has no example"
    typed = {alias.asname for node in ast.walk(SOURCE) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert set(rigtwin.__all__) <= typed
    assert set(rigtwin.__all__) == set(rigtwin._HOMES) <= set(dir(rigtwin))


def test_every_public_name_stands_in_the_reference():
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert [name for name in rigtwin.__all__ if f"rigtwin.{name}" not in page] == []


def test_a_name_that_is_none_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'swep'"):
        rigtwin.swep  # noqa: B018


# -- errors ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: rigtwin.load_rig("nosuch.toml"), "nosuch.toml: cannot be read"),
        (lambda: rigtwin.load_campaign("nosuch"), "nosuch: no such folder"),
        (lambda: rigtwin.load_run("nosuch.csv", support="rigid"), "nosuch.csv: no such file"),
        (lambda: rigtwin.diagnose("nosuch"), "nosuch: no such folder"),
        (lambda: rigtwin.compare("nosuch", "nosuch"), "nosuch: no such folder"),
        (lambda: rigtwin.sweep("nosuch.fmu"), "nosuch.fmu: no such file"),
        (lambda: rigtwin.sweep(lines=3), "lines = 3: at least 8"),
        (lambda: rigtwin.sweep(parameters={"rigid_support": True}), "rigid_support: use support for this"),
        (lambda: rigtwin.estimate(shift=3.0), "shift: there is no such number"),
        (lambda: rigtwin.model_modes(k_b=-1.0), "k_b must be a positive stiffness"),
        (lambda: rigtwin.model_modes(support="soft"), "support is 'soft'"),  # type: ignore[arg-type]
        (lambda: rigtwin.model_response("nit-rourkela", [2.0, 1.0]), "frequencies must be positive and increase"),
        (lambda: rigtwin.model_response("nit-rourkela", [2.0], excitation_node=9), "node 9 does not exist"),
        (lambda: rigtwin.effect("open_crack", mass=1), "open_crack has no parameter mass; it has reduction"),
        (lambda: rigtwin.effect("attached_mass", mass=-1), "attached_mass.mass must"),
        (lambda: rigtwin.build_fmu("nit-rourkela", array_output=True), "only the FMI 3.0 FMU"),
        (lambda: rigtwin.check_fmu("x.fmu", expect_k_b=-1), "give a positive number"),
    ],
)
def test_wrong_input_is_a_user_error_that_says_what(call, said):
    with pytest.raises(rigtwin.UserError) as caught:
        call()
    assert said in str(caught.value)


def test_a_fault_of_ours_stays_what_it_is():
    @for_users
    def broken() -> None:
        raise ZeroDivisionError

    @for_users
    def refused() -> None:
        raise RigError("rig.toml: x: wrong")

    with pytest.raises(ZeroDivisionError):
        broken()
    with pytest.raises(UserError, match=r"rig\.toml: x: wrong") as caught:
        refused()
    assert isinstance(caught.value.__cause__, RigError)


# -- what the functions do is what the commands do ---------------------------------------------------------


def test_a_sweep_is_the_one_of_the_command(rotor_fmu, tmp_path):
    found = rigtwin.sweep(rotor_fmu, k_b=3e6, effects=["attached_mass"], f_min_hz=85, f_max_hz=100, lines=9, noise=0.01)
    found.save(tmp_path / "python.csv")
    arguments = ("--set", "k_b=3e6", "--effect", "attached_mass", "--f-min", 85, "--f-max", 100, "--lines", 9)
    told = run_json("sweep", rotor_fmu, *arguments, "--noise", 0.01, "--out", tmp_path / "command.csv")
    assert (tmp_path / "python.csv").read_bytes() == (tmp_path / "command.csv").read_bytes()
    assert [mode.frequency_hz for mode in found.modes] == [mode["frequency_hz"] for mode in told["modes"]]


def test_runs_estimate_as_their_files_do(swept):
    runs = read_run(swept.rigid, support="rigid"), read_run(swept.bearing)
    found = rigtwin.estimate(*runs)
    (told,) = run_json("estimate", swept.rigid, swept.bearing)["estimates"]
    assert found.k_b == told["k_b"] != 0
    assert (found.best.method, found.best.estimate.valid) == ("network", True)
    asked = rigtwin.estimate(rigtwin.Campaign("", "nit-rourkela", runs), method="network")
    assert_allclose(asked.k_b, found.k_b, rtol=1e-4)  # the two shifts weigh by what the rig may be off as well
    assert asked.best.estimate.k_b_std > 5 * found.best.estimate.k_b_std


def test_a_node_that_the_rig_lacks_is_named(swept):
    runs = read_run(swept.rigid, support="rigid"), replace(read_run(swept.bearing), excitation_node=9)
    with pytest.raises(rigtwin.UserError, match="excitation_node: node 9 does not exist, the rig has 7"):
        rigtwin.estimate(rigtwin.Campaign("", "nit-rourkela", runs))


def test_a_negative_standard_error_is_refused():
    numbers = {
        "delta_f1": 4.0,
        "delta_f2": 26.0,
        "amplitude_ratio": 1.2,
        "delta_f2_std": 0.1,
        "amplitude_ratio_std": 0.1,
    }
    with pytest.raises(rigtwin.UserError, match="--delta-f1-std -1: a standard error is 0 or more"):
        rigtwin.estimate(**numbers, delta_f1_std=-1)


# -- k_b of another rig ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def own_runs() -> tuple[rigtwin.Run, rigtwin.Run]:
    """The model's responses of the example's rotor, refined round its resonances."""
    runs = []
    for support, k_b in (("rigid", None), ("bearing", 3.4e6)):
        modes = rigtwin.model_modes(OWN_ROTOR, k_b=k_b, support=support, n_modes=2).frequency_hz
        near = [f * (1 + np.linspace(-0.03, 0.03, 121)) for f in modes]
        lines = np.unique(np.concatenate([np.linspace(40, 800, 80), *near]))
        runs.append(rigtwin.model_response(OWN_ROTOR, lines, k_b=k_b, support=support))
    return runs[0], runs[1]


def test_another_rig_is_estimated_on_its_model(own_runs, tmp_path):
    found = rigtwin.estimate(*own_runs, rig=OWN_ROTOR)
    assert found.best.method == "model"
    assert found.best.estimate.valid
    assert_allclose(found.k_b, 3.4e6, rtol=1e-4)
    campaign = rigtwin.Campaign("", str(OWN_ROTOR), own_runs)
    assert_allclose(rigtwin.estimate(campaign, method="model").k_b, found.k_b, rtol=1e-6)
    files = [rigtwin.save_run(run, tmp_path / f"{run.support}.csv") for run in own_runs]  # which do not say the node
    for method in ("model", "responses"):
        assert_allclose(rigtwin.estimate(*files, rig=OWN_ROTOR, method=method).k_b, 3.4e6, rtol=1e-3)
    assert rigtwin.load_run(files[0], OWN_ROTOR, support="rigid").excitation_node == own_runs[0].excitation_node == 4
    by_lines = rigtwin.estimate(campaign).best
    assert (by_lines.method, by_lines.features) == ("responses", found.best.features)
    assert by_lines.estimate.k_b_low < 3.4e6 < by_lines.estimate.k_b_high


def test_files_of_another_rig_are_refused_and_the_rig_is_asked_for(own_runs):
    own = [rigtwin.Run(**{**vars(r), "excitation_node": 2}) for r in own_runs]
    with pytest.raises(UserError, match="it is another rig; give its file with --rig"):
        rigtwin.estimate(*own)


def test_shifts_that_contradict_each_other_are_not_valid():
    given = {"delta_f1": 13.5, "delta_f2": 180.0, "delta_f1_std": 0.01, "delta_f2_std": 0.1}
    (answer,) = rigtwin.estimate(rig=OWN_ROTOR, **given)
    assert not answer.estimate.valid
    assert "delta_f1 alone gives 3.308 MN/m, delta_f2 alone 2.937 MN/m" in answer.objections[0]
    (answer,) = rigtwin.estimate(rig=OWN_ROTOR, **{**given, "delta_f2": 900.0})
    assert "delta_f2 = 900 Hz: the model has this shift at no k_b" in answer.objections[0]


# -- what notebooks show -------------------------------------------------------------------------------------


def shown(value: object) -> str:
    """What a notebook shows of it, checked to be well-formed."""
    text = value._repr_html_()  # type: ignore[attr-defined]
    ElementTree.fromstring(f"<div>{text}</div>")
    return text


def test_results_show_themselves(rotor_fmu, swept, own_runs):
    rig = rigtwin.load_rig(OWN_ROTOR)
    assert "stepped-cantilever" in shown(rig)
    assert shown(rig).count("<polygon") == len(rig.segment)
    assert shown(rig).count("<rect") == len(rig.disk)
    assert "81.46" in shown(rigtwin.model_modes(rig, support="rigid"))
    swept_run = rigtwin.sweep(rotor_fmu, k_b=3e6, f_min_hz=85, f_max_hz=100, lines=9)
    assert "<polyline" in shown(swept_run)
    assert "frequency, Hz" in shown(swept_run.modes)
    assert "open_crack" in shown(rigtwin.effects())
    assert "yes" in shown(rigtwin.estimate(swept.rigid, swept.bearing))
    campaign = rigtwin.Campaign("<b>", "nit-rourkela", own_runs)
    assert "&lt;b&gt;" in shown(campaign)
    assert "bearing" in shown(own_runs[1])


def test_a_curve_is_drawn_where_its_numbers_are():
    f = np.array([10.0, 20.0, 30.0])
    drawn = html.curves([html.Line(f, np.array([1.0, 100.0, 1.0]))], "Hz", "size")
    points = [tuple(map(float, p.split(","))) for p in drawn.split('points="')[1].split('"')[0].split()]
    assert points[1][0] == (points[0][0] + points[2][0]) / 2
    assert points[1][1] < points[0][1] == points[2][1]  # up is a smaller number in SVG
    assert html.curves([html.Line(f, np.zeros(3))], "Hz", "size") == ""


def test_help_lists_completion():
    assert "--install-completion" in run("--help").stdout
