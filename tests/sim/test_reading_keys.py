"""Data as laboratories have them: forces of lines, decibels, bands, coherences, a roving hammer, two sensors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigtwin.rotor.frequency.frequency_response import accelerance
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.campaign import Campaign, Channel, MeasurementError, NominalBelief, Run
from rigtwin.sim.campaign_folder import load_campaign, save_campaign
from rigtwin.sim.formats import SUFFIXES, read_run, write_run
from rigtwin.sim.formats.corrections import error_of_coherence
from tests.sim.recorded import a_run, assert_same_run
from tests.sim.test_formats import function_58, read_uff
from tests.tolerances import ROUND_OFF

PLAIN = "frequency_Hz,node2_re,node2_im\n95,3,4\n96,6,8\n97,0,1\n"


def read(tmp_path: Path, text: str, **told) -> Run:
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    return read_run(path, **{"support": "bearing", **told})


def refusal(tmp_path: Path, text: str, **told) -> str:
    """The message without the folder; one line."""
    with pytest.raises(MeasurementError) as refused:
        read(tmp_path, text, **told)
    assert "\n" not in str(refused.value)
    return str(refused.value).removeprefix(f"{tmp_path}/")


# --- forces of lines ------------------------------------------------------------------------------


def test_each_line_may_have_its_own_force(tmp_path):
    run = read(tmp_path, "frequency_Hz,force_N,node2_re,node2_im\n97,0.5,3,4\n96,2,6,8\n95,1,0,1\n")
    assert run.force_N is not None
    assert run.force_N.tolist() == [1, 2, 0.5]  # a downward sweep, turned
    assert (run.force_amplitude_N, run.sweep) == (1.0, "down")  # their median
    assert read(tmp_path, "frequency_Hz,force_N,node2_abs\n95,2,3\n", force_amplitude_N=3.0).force_amplitude_N == 3.0


def test_a_controlled_response_gives_the_force_of_each_line(tmp_path):
    run = read(tmp_path, PLAIN, control="response", response_amplitude=20.0)
    assert run.control == "response"
    assert run.force_N is not None
    assert run.force_N.tolist() == [4, 2, 20]
    assert run.force_amplitude_N == 4


def test_without_force_or_response_the_force_of_a_controlled_response_is_unknown(tmp_path):
    run = read(tmp_path, PLAIN, control="response")
    assert (run.force_N, run.force_amplitude_N) == (None, None)


@pytest.mark.parametrize(
    ("text", "told", "message"),
    [
        (PLAIN, {"response_amplitude": 20.0}, 'run.csv: response_amplitude: goes with control = "response"'),
        (PLAIN, {"response_node": 3}, "run.csv: response_node: goes with response_amplitude"),
        (
            PLAIN,
            {"control": "response", "response_amplitude": 20.0, "response_node": 3},
            "run.csv: response_amplitude: the controlled channel node3 is not in the file, which has node2; say its",
        ),
        (
            "frequency_Hz,force_N,node2_abs\n95,1,1\n",
            {"control": "response", "response_amplitude": 20.0},
            "run.csv: response_amplitude: the file holds force_N of every line; remove the key",
        ),
        (
            "frequency_Hz,node2_abs\n95,0\n",
            {"control": "response", "response_amplitude": 20.0},
            "run.csv: response_amplitude: node2 has lines without response; remove these lines",
        ),
        (
            "frequency_Hz,force_N,node2_abs\n95,0,1\n",
            {},
            "run.csv, line 2, column force_N: 0.0 is no force; give the positive peak force of the line",
        ),
        (
            "frequency_Hz,force_N,node2_abs\n95,1,1\n",
            {"quantity": "acceleration"},
            'run.csv: force_N: quantity = "acceleration" is for a force that nobody recorded; divide the response',
        ),
    ],
)
def test_a_force_that_makes_no_sense_is_refused(tmp_path, text, told, message):
    assert refusal(tmp_path, text, **told).startswith(message)


# --- decibels and degrees -------------------------------------------------------------------------


def test_decibels_and_degrees_are_the_same_response(tmp_path):
    complex_one = read(tmp_path, "frequency_Hz,node2_re,node2_im\n95,0,-10\n")
    for text in ("node2_dB,node2_deg\n95,20,-90\n", "node2_deg,node2_abs\n95,270,10\n"):
        run = read(tmp_path, f"frequency_Hz,{text}")
        assert not run.magnitude_only
        np.testing.assert_allclose(run.H, complex_one.H, rtol=ROUND_OFF, atol=10 * ROUND_OFF)
    loud = read(tmp_path, "frequency_Hz,node2_dB\n95,-40\n")
    assert loud.magnitude_only
    np.testing.assert_allclose(loud.H, [[0.01]], rtol=ROUND_OFF)


def test_a_phase_offset_turns_every_channel_and_a_harmonic_by_its_order(tmp_path):
    run = read(tmp_path, "frequency_Hz,node2_re,node2_im,node2_h2_re,node2_h2_im\n95,1,2,3,4\n", phase_offset_deg=90)
    np.testing.assert_allclose(run.H, [[-2 + 1j]], rtol=ROUND_OFF)
    np.testing.assert_allclose(run.harmonics[2], [[-3 - 4j]], rtol=ROUND_OFF)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (
            "node2_deg",
            "run.csv, line 1, column node2_deg: a phase needs its magnitude; add node2_abs or the same in _dB",
        ),
        (
            "node2_abs,node2_dB",
            "run.csv, line 1, column node2_abs: this node has its magnitude in dB too; keep _abs or",
        ),
        ("node2_re,node2_im,node2_dB", "run.csv, line 1, column node2_dB: this node has real and imaginary part too"),
        ("node2_dB,node3_abs,node3_deg", "run.csv, line 1, column node2_dB: other columns are complex (_re, _im); put"),
        ("node2_h3_dB", "run.csv, line 1, column node2_h3_dB: node2 has no response; add node2_re and _im, or _abs"),
    ],
)
def test_magnitudes_and_phases_that_do_not_go_together_are_refused(tmp_path, header, message):
    assert refusal(tmp_path, f"frequency_Hz,{header}\n").startswith(message)


def test_magnitudes_have_no_phase_to_turn(tmp_path):
    words = refusal(tmp_path, "frequency_Hz,node2_abs\n95,1\n", phase_offset_deg=180)
    assert words == "run.csv: phase_offset_deg: the data have no phases; remove the key"


# --- bands ----------------------------------------------------------------------------------------


def test_bands_are_left_out_and_what_was_swept_stays_known(tmp_path):
    run = read(tmp_path, PLAIN, leave_out_Hz=[(95.5, 96)])
    assert run.frequency_hz.tolist() == [95, 97]
    assert run.swept_hz is not None
    assert run.swept_hz.tolist() == [95, 96, 97]
    assert run.H[:, 0].tolist() == [3 + 4j, 1j]
    kept = read(tmp_path, PLAIN, keep_Hz=[(94, 95), (96.5, 99)])
    assert_same_run(kept, run)


def test_a_line_without_values_was_swept(tmp_path):
    run = read(tmp_path, "frequency_Hz,node2_re,node2_im\n97,1,2\n96,,\n95, , \n")
    assert run.frequency_hz.tolist() == [97]
    assert run.swept_hz is not None
    assert (run.swept_hz.tolist(), run.sweep) == ([95, 96, 97], "down")


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"leave_out_Hz": [(90, 100)]}, "run.csv: leave_out_Hz: leaves no line of the file; correct the bands"),
        ({"keep_Hz": [(9, 10)]}, "run.csv: keep_Hz: leaves no line of the file; correct the bands"),
        ({"leave_out_Hz": [(100, 90)]}, "run.csv: leave_out_Hz 1: a band is [from, to] in Hz, from below to"),
        ({"leave_out_Hz": [90, 100]}, "run.csv: leave_out_Hz 1: Input should be a valid tuple"),
    ],
)
def test_wrong_bands_are_refused(tmp_path, told, message):
    assert refusal(tmp_path, PLAIN, **told).startswith(message)


# --- coherence ------------------------------------------------------------------------------------


def test_a_coherence_gives_the_standard_error_that_averaged_spectra_have():
    """Noise on the response only, many H1 estimates of known truth; the spread of 4,000 draws is known to 3 %."""
    rng = np.random.default_rng(7)
    averages, draws, H, noise = 8, 4000, 2.0 - 1.0j, 0.7

    def spectra() -> np.ndarray:
        return (rng.standard_normal((draws, averages)) + 1j * rng.standard_normal((draws, averages))) / np.sqrt(2)

    force = spectra()
    response = H * force + noise * spectra()
    estimates = (response * force.conj()).sum(1) / (abs(force) ** 2).sum(1)
    coherence = abs(H) ** 2 / (abs(H) ** 2 + noise**2)
    told = error_of_coherence(np.array([[H]]), np.array([[coherence]]), averages)[0, 0]
    # The mean of 1/Gxx over few averages is n / (n - 1) times that over many.
    expected = told * np.sqrt(averages / (averages - 1))
    assert np.sqrt(np.mean(abs(estimates - H) ** 2)) == pytest.approx(expected, rel=0.03)


def test_coherences_of_a_file_become_standard_errors(tmp_path):
    run = read(tmp_path, "frequency_Hz,node2_re,node2_im,node2_coherence\n95,3,4,0.8\n96,3,4,1\n", averages=4)
    np.testing.assert_allclose(run.std, [[1.25], [0.0]], rtol=ROUND_OFF)


@pytest.mark.parametrize(
    ("text", "told", "message"),
    [
        ("node2_abs,node2_coherence\n95,1,0.5\n", {}, "run.csv: averages is not known; say how many spectra were"),
        ("node2_abs\n95,1\n", {"averages": 3}, "run.csv: averages: says how many spectra are behind a coherence, and"),
        ("node2_abs,node2_coherence\n95,1,0.5\n", {"averages": 1}, "run.csv: averages: Input should be greater than"),
        (
            "node2_abs,node2_coherence,node2_std\n95,1,0.5,1\n",
            {"averages": 3},
            "run.csv: holds both standard errors and coherence; keep one of them",
        ),
        (
            "node2_abs,node2_coherence\n95,1,1.5\n",
            {"averages": 3},
            "run.csv, line 2, column node2_coherence: 1.5 is no coherence; it lies above 0 and is at most 1",
        ),
    ],
)
def test_a_coherence_that_gives_no_error_is_refused(tmp_path, text, told, message):
    assert refusal(tmp_path, f"frequency_Hz,{text}", **told).startswith(message)


def test_a_universal_file_brings_its_coherences(tmp_path):
    coherence = function_58(func_type=6, data=np.full(5, 0.5), ord_data_type=4, ordinate_spec_data_type=0)
    assert read_uff(tmp_path, function_58(), coherence).std is None
    run = read_uff(tmp_path, function_58(), coherence, averages=4)
    np.testing.assert_allclose(run.std, np.full((5, 1), 0.5), rtol=1e-6)  # the text form has seven digits


# --- a roving hammer ------------------------------------------------------------------------------


def test_a_roving_hammer_measures_what_roving_sensors_measure(tmp_path):
    """Blows at nodes 2 and 4, the accelerometer at node 3; the rotor's own receptances must fit the run."""
    system = build_system(assemble(load_rig("nit-rourkela")), Condition(k_b=1e7))
    lines = np.array([70.0, 90.0, 110.0])
    blows = [accelerance(system, lines, excitation_node=node)[:, 3 - 1, 0] for node in (2, 4)]
    columns = np.column_stack([lines, blows[0].real, blows[0].imag, blows[1].real, blows[1].imag])
    rows = "".join(",".join(map(repr, row)) + "\n" for row in columns.tolist())
    header = "frequency_Hz,node2_re,node2_im,node4_re,node4_im\n"
    run = read(tmp_path, header + rows, roving="exciter", excitation_node=3)
    assert (run.roving, run.excitation_node, run.channels) == ("exciter", 3, (Channel(2), Channel(4)))
    shaken = accelerance(system, lines, excitation_node=3)[:, [1, 3], 0]
    np.testing.assert_allclose(run.H, shaken, rtol=1e-9, atol=ROUND_OFF * abs(shaken).max())


def test_a_universal_file_says_where_the_blows_were(tmp_path):
    blows = [function_58(rsp_node=9, ref_node=node) for node in (2, 4)]
    run = read_uff(tmp_path, *blows, roving="exciter")
    assert (run.excitation_node, run.channels) == (9, (Channel(2), Channel(4)))
    write_run(run, tmp_path / "again.uff")
    assert_same_run(read_run(tmp_path / "again.uff"), replace(run, name="again"), sign_of_zero=False)
    with pytest.raises(MeasurementError, match="holds responses to forces at node 2 y, node 4 y; choose one"):
        read_uff(tmp_path, *blows)


@pytest.mark.parametrize(
    ("text", "told", "why"),
    [
        (PLAIN, {"spin_rpm": 600.0}, "holds for a rotor that stands still"),
        (PLAIN, {"quantity": "acceleration"}, "needs responses per newton"),
        ("frequency_Hz,force_N,node2_abs\n95,1,1\n", {}, "leaves no place for a force of each line"),
        ("frequency_Hz,node2_abs,node2_h2_abs\n95,1,1\n", {}, "holds for a linear rotor, and the file holds harmonics"),
    ],
)
def test_reciprocity_is_not_used_where_it_does_not_hold(tmp_path, text, told, why):
    assert why in refusal(tmp_path, text, roving="exciter", **told)


def test_a_hammer_carries_no_accelerometer(tmp_path):
    toml = 'rig = "nit-rourkela"\n[nominal]\nsensor_mass_kg = 0.01\n[[run]]\nfile = "run.csv"\nsupport = "bearing"\n'
    (tmp_path / "campaign.toml").write_text(toml + 'roving = "exciter"\n')
    (tmp_path / "run.csv").write_text(PLAIN)
    with pytest.raises(
        MeasurementError, match=r"campaign\.toml: nominal sensor_mass_kg: the accelerometer of run 'run'"
    ):
        load_campaign(tmp_path)


# --- two sensors at a node, and whole campaigns ---------------------------------------------------


def test_two_sensors_of_a_node_are_two_channels(tmp_path):
    run = read(tmp_path, "frequency_Hz,node2_abs,node2b_abs,node2b_z_abs\n95,1,2,3\n")
    assert run.channels == (Channel(2), Channel(2, label="b"), Channel(2, "z", "b"))
    assert run.channel(2, label="b").tolist() == [2]
    words = refusal(tmp_path, "frequency_Hz,node2_abs,node2_abs\n95,1,2\n")
    assert words == "run.csv, line 1, column node2_abs: is there 2 times; keep one"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_campaign_of_such_runs_is_the_same_when_it_is_saved_and_loaded(tmp_path, suffix):
    channels = (Channel(2), Channel(2, label="b"))
    force, swept = np.array([1.0, 2.5, 1 / 3]), np.array([94.0, 95.000123456789, 95.00012345679, 200.0, 300.1])
    held = a_run(channels=channels, force_N=force, control="response", swept_hz=swept, name="held")
    hammer = a_run(channels=channels, roving="exciter", harmonics={}, force_amplitude_N=None, name="hammer")
    campaign = Campaign("real", "nit-rourkela", (held, hammer), nominal=NominalBelief())
    save_campaign(campaign, tmp_path, suffix[1:])
    again = load_campaign(tmp_path)
    for read_back, written in zip(again.runs, campaign.runs, strict=True):
        assert_same_run(read_back, written, sign_of_zero=suffix not in (".uff", ".unv"))


def test_a_run_must_stand_among_the_lines_that_were_swept(tmp_path):
    with pytest.raises(MeasurementError, match=r"frequency at 300\.1 Hz is not among the swept lines"):
        write_run(a_run(swept_hz=np.array([95.000123456789, 95.00012345679])), tmp_path / "run.csv")
