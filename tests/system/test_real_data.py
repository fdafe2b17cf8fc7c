"""The benchmark on data of other laboratories, on data made up in their format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from benchmarks.real_data import __main__ as command
from benchmarks.real_data import bolted_beam, diagnosing
from benchmarks.real_data.bolted_beam import BOLTED_BEAM, MAT, RIG, jointed
from benchmarks.real_data.cantilever import CANTILEVER
from benchmarks.real_data.data_set import MissingDataError, nrmse, scatter
from benchmarks.real_data.diagnosing import Judged, judged
from benchmarks.real_data.joint_law import Law, fit_law
from benchmarks.real_data.report import Result, page
from benchmarks.real_data.single_mode import Sweep, leave_one_out, mode
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import parse_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.campaign_folder import load_campaign
from tests.tolerances import ROUND_OFF

LAW = Law(1.0, 0.015, 0.2, 1.8, 0.06, 0.0045, 0.0016, 0.9, -0.02)
LINES = 79.2 + 0.05 * np.arange(41)


def sweep(force: float, name: str = "made 1") -> Sweep:
    """What a beam with this law would give under a steady force [N]."""
    forces = np.full(len(LINES), force)
    empty = Sweep(name, LINES, forces, np.ones(len(LINES), complex))
    return Sweep(name, LINES, forces, jointed(empty).predict(LAW, forces))


@pytest.fixture(scope="module")
def beam(tmp_path_factory) -> Path:
    """A folder like that of the bolted beam: four sweeps under force control and two under response control."""
    folder = tmp_path_factory.mktemp("data") / BOLTED_BEAM.key
    folder.mkdir()
    fields = ("frequency", "force", "amplitude", "phase", "units")

    def table(forces: tuple[float, ...]) -> np.ndarray:
        runs = np.zeros(len(forces), dtype=[(name, object) for name in fields])
        for place, force in enumerate(forces):
            s = sweep(force)
            runs[place] = (LINES, s.force, np.abs(s.H) * s.force, np.angle(-s.H), "Hz, N, m/s^2, rad")
        return runs

    FRdata = {"ForceControl": table((0.15, 0.4, 0.95, 1.4)), "ResponseControl": table((0.2, 1.2))}
    scipy.io.savemat(folder / MAT, {"FRdata": FRdata})
    return folder


def test_the_rig_of_the_bolted_beam_has_the_first_mode_where_small_motions_have_it():
    system = build_system(assemble(parse_rig(RIG)), Condition(k_b=500.0)).in_plane(1)
    elastic = system.modes.omega[system.modes.omega > 2 * np.pi * 20]
    assert elastic[0] / (2 * np.pi) == pytest.approx(80.5, abs=0.05)


def test_a_fold_holds_the_sweeps_as_they_were_measured(beam, tmp_path):
    every, folds = bolted_beam.sweeps(beam, "ForceControl"), BOLTED_BEAM.folds(beam, tmp_path)
    assert [fold.name for fold in folds] == [
        f"sweep {k}, {f} N" for k, f in enumerate(("0.15", "0.4", "0.95", "1.4"), 1)
    ]
    for left_out, fold in enumerate(folds):
        train, held = load_campaign(fold.train).runs, load_campaign(fold.held).runs
        assert (len(train), len(held)) == (3, 1)
        others = [s for k, s in enumerate(every) if k != left_out]
        for run, expected in zip((*train, *held), (*others, every[left_out]), strict=True):
            np.testing.assert_allclose(run.H[:, 0], expected.H, rtol=0, atol=ROUND_OFF * abs(expected.H).max())
            np.testing.assert_array_equal(run.force_N, expected.force)
            assert (run.excitation_node, run.sweep, run.support) == (2, "up", "bearing")


def test_the_law_of_a_joint_is_found_again_and_predicts_a_sweep_it_has_not_seen():
    every = [sweep(force) for force in (0.15, 0.4, 0.95, 1.4)]
    models = [jointed(s) for s in every]
    law = fit_law(models[:3], every[:3])
    for name, expected in vars(LAW).items():
        assert getattr(law, name) == pytest.approx(expected, rel=0.02), name
    assert nrmse(every[3].H, models[3].predict(law, every[3].force)) < 0.01
    assert nrmse(every[3].H, models[3].respond(law, models[3].angle_at(law, every[3]))[0]) < 0.01


def test_one_mode_whose_damping_grows_is_found_again_and_one_damping_is_not_enough():
    shared = np.array([np.log(1.4e-3), np.log(8e-4), 0.5, -0.02])

    def made(force: float, natural_hz: float) -> Sweep:
        H = np.ones(len(LINES), complex)
        for _ in range(300):  # the level that follows from the response, and the reverse
            s = Sweep("made", LINES, np.full(len(LINES), force), H)
            H = 0.9 * H + 0.1 * mode(s, shared, natural_hz, 1.7)
        return Sweep("made", LINES, s.force, H)

    sweeps = [made(*pair) for pair in ((0.2, 80.1), (0.5, 80.3), (1.2, 80.2))]
    assert max(leave_one_out(sweeps, 80.2, 1.7)) < 1e-3
    assert max(leave_one_out(sweeps, 80.2)) > 0.1


def test_the_scatter_of_lines_is_their_noise():
    rng = np.random.default_rng(3)
    smooth = np.exp(1j * np.linspace(0, 2, 4000))
    noise = 0.01 * (rng.standard_normal(4000) + 1j * rng.standard_normal(4000)) / np.sqrt(2)
    assert scatter(smooth + noise) == pytest.approx(0.01, rel=0.05)


def test_the_controls_are_measured_on_every_sweep(beam):
    controls = BOLTED_BEAM.controls(beam)
    assert [len(control.errors) for control in controls] == [2, 4, 2, 4, 4, 4]
    assert max(controls[-1].errors) < 0.02  # the data follow this law


@pytest.mark.parametrize("data", [BOLTED_BEAM, CANTILEVER], ids=lambda data: data.key)
def test_a_missing_file_is_named_with_where_it_comes_from(data, tmp_path, capsys):
    assert command.main([str(tmp_path), "--only", data.key]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"{tmp_path / data.key / data.files[0]}: no such file; {data.title} needs it")
    assert data.source in said
    assert said.count("\n") == 1


def test_a_file_of_another_kind_is_named(tmp_path):
    scipy.io.savemat(tmp_path / MAT, {"something": 1.0})
    with pytest.raises(MissingDataError, match=r"holds no FRdata\.ForceControl as it was published"):
        bolted_beam.sweeps(tmp_path, "ForceControl")


def test_a_diagnosis_that_fails_is_a_row_of_the_page(beam, tmp_path, monkeypatch):
    def fails(campaign):
        raise ValueError("the model is too far off")

    monkeypatch.setattr(diagnosing, "diagnose", fails)
    said: list[str] = []
    fold = BOLTED_BEAM.folds(beam, tmp_path)[0]
    result = judged(fold, said.append)
    assert said[-1] == "sweep 1, 0.15 N: failed, ValueError: the model is too far off"
    text = page([Result(BOLTED_BEAM, (result,), ())])
    assert "- sweep 1, 0.15 N: ValueError: the model is too far off\n" in text


def test_the_command_writes_the_page_and_names_folders_that_it_does_not_read(beam, tmp_path, monkeypatch, capsys):
    answer = Judged("fold", "unknown", ("joint (0.5)",), "Nothing fits.", 0.5, 0.25, 0.01, 12.0)
    monkeypatch.setattr(command, "judged", lambda fold, say: answer)
    (beam.parent / "other-rig").mkdir(exist_ok=True)
    assert command.main([str(beam.parent), "--only", "bolted-beam", "--page", str(tmp_path / "page.md")]) == 0
    assert f"{beam.parent / 'other-rig'}: no data set of this name is known" in capsys.readouterr().out
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert text.count("| fold | unknown | joint (0.5) | 0.500 | 0.250 | 0.010 | 12 |") == 4
    assert BOLTED_BEAM.source in text
    assert "GPL-3.0" in text
