"""The page of a diagnosis: every part is there, and its figures hold the numbers of the diagnosis."""

from __future__ import annotations

import base64
import html
import json
import math
import re
import tomllib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rigtwin.gap.curves import Curve, nrmse
from rigtwin.gap.document import (
    Band,
    BearingStiffness,
    Calibrated,
    Calibration,
    Cause,
    Diagnosis,
    Estimate,
    Finding,
    JointStiffness,
    Location,
    NextTest,
    NodeShare,
    Shrink,
    Where,
)
from rigtwin.pages.diagnosis_figures import (
    RESPONSE_TRACES,
    bearings_figure,
    candidate_figure,
    gap_map,
    gap_map_figure,
    joint_figure,
    peaks_figure,
    response_figure,
    responses,
    shrink_figure,
)
from rigtwin.pages.diagnosis_page import write_diagnosis_page
from rigtwin.pages.diagnosis_words import parameters, quantity, run_toml, share
from rigtwin.rotor.effects.supports import PedestalFlexibility
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.sim.campaign import Campaign, Channel, PeakList, Run
from tests.rigtwin.test_report import Page, assert_self_contained

NOISE = 0.01
FLOAT32 = 2e-7
HEADINGS = [
    "Measured and computed responses",
    "Where the gap lies",
    "Candidates",
    "Joint dynamic stiffness",
    "How far the gap shrinks",
    "What was calibrated",
    "What to measure next",
    "Measurement audit",
    "Where this comes from",
]
# Of a diagnosis that calibrated nothing.
BARE = [heading for heading in HEADINGS if heading != "What was calibrated"]
FIGURES = ["responses", "gap-map", "candidates", "joint", "shrink"]


# --- a diagnosis as gap hands it over --------------------------------------------------------------


BANDS = (Band(20.0, 150.0, 1, 0.62), Band(150.0, 310.0, 2, 0.35), Band(310.0, 400.0, None, 0.03))
PEDESTAL = Cause(
    effects=("pedestal_flexibility",),
    location=Location("bearings"),
    probability=0.93,
    parameters={
        "pedestal_flexibility.stiffness": Estimate(1.02e7, 3e5, "N/m"),
        "pedestal_flexibility.mass": Estimate(1.01, 0.04, "kg"),
    },
    k_b=Estimate(1.002e7, 3e4, "N/m"),
    log_evidence=-1234.5,
    ess=412.0,
    locations=(Location("bearings"),),
)
CRACK = Cause(
    effects=("open_crack",),
    location=Location("position", x_m=0.213),
    probability=0.05,
    parameters={"open_crack.reduction": Estimate(0.6, 0.01)},
    k_b=Estimate(8e6, 1e5, "N/m"),
    log_evidence=-1241.0,
    at_prior_edge=("open_crack.reduction",),
)
PAIR = Cause(
    effects=("attached_mass", "bearing_damping"),
    location=Location("node", node=4),
    probability=2e-4,
    parameters={
        "attached_mass.mass": Estimate(0.1, 0.01, "kg"),
        "bearing_damping.damping": Estimate(120.0, 9.0, "N.s/m"),
    },
    k_b=Estimate(9e6, 1e5, "N/m"),
    log_evidence=-1250.0,
    locations=(Location("node", node=4), Location("bearings")),
)
JOINT = JointStiffness(
    node=1,
    support="bearing",
    frequency_hz=tuple(range(20, 400, 5)),
    real=tuple(-4e6 - 20.0 * f**2 for f in range(20, 400, 5)),
    imag=tuple(60.0 * f for f in range(20, 400, 5)),
    explained=0.97,
    order="a stiffness with a mass",
)
BEARINGS = BearingStiffness(
    run="bearing-1",
    frequency_hz=(30.0, 90.0, 200.0),
    real=(1.9e6, 2.4e6, 4.1e6),
    imag=(4e3, 1.1e4, 6e4),
    std=(2e5, 3e4, 5e4),
    nominal_real=(2e6, 2e6, 2e6),
    nominal_imag=(4e3, 1.2e4, 2.5e4),
    corrected_real=(2e6, 2.4e6, 4e6),
    corrected_imag=(4e3, 1.2e4, 6e4),
)
SHRINK = Shrink(
    held_out="the run on bearings at 2 N",
    before=0.314,
    after=0.0131,
    floor=0.011,
    shrink=0.958,
    explainable=0.993,
    ci90=(0.981, 0.999),
    verified_by="fmu",
    after_model=0.0128,
    without_effect=0.207,
)
GIGA = 1e9


def calibration(modulus: float, drift: float) -> Calibration:
    """Of a workshop that knows its modulus to 1 %, and whose resonances drift."""
    known = Estimate(207 * GIGA, 2.07 * GIGA, "Pa")
    told = Calibrated("modulus", "modulus of the shaft", known, Estimate(modulus * GIGA, 0.5 * GIGA, "Pa"))
    gain = Calibrated("sensor_gain.node4", "gain of the sensor node4", Estimate(1.0, 0.01), Estimate(0.985, 0.004))
    repeated = Calibrated("frequency_drift", "drift", Estimate(1e-4, 1.5e-4), Estimate(drift, 1e-4), learned=True)
    stated = Calibrated("gain_repeatability", "change of gains", Estimate(2e-3), Estimate(2e-3))
    return Calibration({"node4": 0.985}, {"modulus": math.log(modulus / 207)}, (told,), (gain,), (repeated, stated))


AUDIT = (
    Finding("noise", "ok", "Noise was given with the lines.", value=0.01),
    Finding("raster", "warning", "2 lines in the half-power band of mode 1: refine the raster.", "rigid-1", 2.0, 4.0),
    Finding("missing_lines", "note", "Lines 30 to 32 Hz are missing.", "bearing-1"),
)
DIAGNOSIS = Diagnosis(
    title="shaker at node 2",
    rig="nit-rourkela",
    verdict="cause",
    sentence="Pedestal flexibility at the bearings causes the gap (93 %); it falls from 31.4 % to 1.31 %.",
    nominal={"k_b": Estimate(7.1e6, 2e5, "N/m"), "gap": 0.35, "gap_dB": 4.2, "calibration": calibration(211, 9e-4)},
    calibration=calibration(205, 4e-4),
    where=Where(
        bands=BANDS,
        supports={"rigid": 0.02, "bearing": 0.98},
        nodes=(NodeShare(2, 0.4), NodeShare(4, 0.35), NodeShare(6, 0.25)),
        levels={"1": 0.5, "2": 0.5},
        joint=JOINT,
        remark="The gap sits in the runs on bearings.",
    ),
    causes=(PEDESTAL, CRACK, PAIR),
    next_test=NextTest(
        "Measure on bearings at 4 N with an accelerometer on the pedestal.",
        {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 4.0, "sweep": None},
    ),
    shrink=SHRINK,
    audit=AUDIT,
    excluded=("gyroscopic",),
    unknown_score=0.1,
    timing_s={"audit": 0.3, "search": 21.4},
)


def curve(support: str, force: float, channels: Iterable[Channel] = (Channel(2), Channel(4), Channel(6))) -> Curve:
    """A noisy run of a rig on pedestals, with its nominal and its corrected model."""
    structure, channels = assemble(load_rig("nit-rourkela")), tuple(channels)
    nodes = [channel.node for channel in channels]
    f = np.unique(np.concatenate([np.linspace(20, 400, 96), *(np.linspace(c - 3, c + 3, 25) for c in (85, 100, 240))]))
    truth = Condition(k_b=1e7, rigid_support=support == "rigid", bearing_damping=20.0, shaft_damping_ratio=0.003)
    pedestal = PedestalFlexibility(stiffness=1e7, mass=1.0, damping=50.0)
    effects = () if support == "rigid" else (pedestal,)
    exact = measured_response(structure, truth, effects, f, nodes)
    rng = np.random.default_rng(int(10 * force))
    std = NOISE * np.abs(exact) + 1e-6
    noise = std / math.sqrt(2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    run = Run(f, exact + noise, channels, support, std, force_amplitude_N=force, name=f"{support}-{force:g}")  # type: ignore[arg-type]
    nominal = measured_response(structure, replace(truth, k_b=4.6e6), (), f, nodes)
    return Curve(run, nominal, exact, std)


@pytest.fixture(scope="module")
def curves() -> tuple[Curve, ...]:
    """Both supports, two levels on bearings."""
    return curve("rigid", 1.0), curve("bearing", 1.0), curve("bearing", 2.0)


def campaign_of(curves: Iterable[Curve], title: str = "shaker at node 2", peaks: tuple[PeakList, ...] = ()) -> Campaign:
    return Campaign(title, "nit-rourkela", tuple(curve.run for curve in curves), peaks)


def page_of(diagnosis: Diagnosis, curves: tuple[Curve, ...], folder: Path, **of_campaign: Any) -> Page:
    campaign = campaign_of(curves, **of_campaign)
    return Page(write_diagnosis_page(diagnosis, curves, campaign, folder / "report.html"))


@pytest.fixture(scope="module")
def page(curves, tmp_path_factory) -> Page:
    """The page of a diagnosis that names a cause."""
    return page_of(DIAGNOSIS, curves, tmp_path_factory.mktemp("page"))


# --- the page --------------------------------------------------------------------------------------


def headings(page: Page) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", page.source)


def words(page: Page) -> str:
    """What the page says in one line, with plain spaces, elements apart."""
    body = re.sub(r"<(script|style)\b.*?</\1>", " ", page.source, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", body)).split()).replace(" :", ":").replace(" .", ".")


def test_the_page_has_every_part_in_order_and_is_self_contained(page):
    assert_self_contained(page)
    assert headings(page) == HEADINGS
    assert page.figures == FIGURES
    assert len(page.source) < 6e6


def test_the_verdict_stands_first_in_large_type_with_its_key_figures(page):
    text = words(page)
    assert re.findall(r'<h1 class="verdict">(.*?)</h1>', page.source)[0].replace("\xa0", " ") == DIAGNOSIS.sentence
    start = text.index(DIAGNOSIS.sentence)
    for value in ("31.4 %", "1.31 %", "1.10 %", "10.02 MN/m 90 % interval 9.971 to 10.069", "93 %"):
        assert start < text.index(value, start) < text.index(HEADINGS[0]), value


def test_effects_are_named_by_title_with_their_meaning(page):
    assert PedestalFlexibility.title in page.text
    assert PedestalFlexibility.meaning in page.text


def test_every_candidate_is_listed_with_place_size_and_remark(page):
    text = words(page)
    for said in (
        "Pedestal flexibility at the bearings",
        "stiffness (1.020 ± 0.030)×10⁷ N/m",
        "Open crack at x = 213 mm reduction at the end of the range that was searched",
        "Attached mass + Bearing damping at node 4; at the bearings",
        "Bearing damping: damping 120.0 ± 9.0 N s/m",
        "−6.5",
    ):
        assert said in text, said


def test_shrink_next_test_audit_and_foot_are_told(page):
    text = words(page)
    for said in (
        "95.8 % of the gap is gone; 99.3 % of what can be explained is explained; "
        "with another node driven, expect 98.1 % to 99.9 %",
        "the effect was switched on in RotorRig.fmu",
        "Measure on bearings at 4 N with an accelerometer on the pedestal.",
        "raster (warning, rigid-1): 2 lines in the half-power band of mode 1: refine the raster. [found 2, limit 4]",
        "effects left out Gyroscopic moments (gyroscopic)",
        "campaign shaker at node 2",
        "rig Dual-disk rotor on ball bearings, NIT Rourkela (nit-rourkela)",
    ):
        assert said in text, said
    assert re.findall(r'class="mark (\w+)" role="img" aria-label="(\w+)"', page.source) == [
        ("warning", "warning"),
        ("note", "note"),
        ("ok", "ok"),
    ]


def test_calibrated_numbers_stand_beside_what_was_known(page):
    text = words(page)
    for said in (
        "Known at least twice as well as before: modulus of the shaft. "
        "Moved by more than one standard deviation of what was known: none.",
        "number before nominal model with the effect moved by "
        "modulus of the shaft (2.070 ± 0.021)×10¹¹ Pa (2.1100 ± 0.0050)×10¹¹ Pa (2.0500 ± 0.0050)×10¹¹ Pa −1.0",
        "drift learned, usually 1×10⁻⁴ (9.0 ± 1.0)×10⁻⁴ (4.0 ± 1.0)×10⁻⁴",
        "change of gains 0.002, stated 0.002 0.002",
        "gain of the sensor node4 1.000 ± 0.010 0.9850 ± 0.0040 0.9850 ± 0.0040 −1.5",
    ):
        assert said in text, said


def test_without_a_cause_the_nominal_model_alone_is_calibrated(curves, tmp_path):
    bare = replace(DIAGNOSIS, verdict="unknown", shrink=None, calibration=DIAGNOSIS.nominal["calibration"])
    text = words(page_of(bare, curves, tmp_path))
    assert "number before nominal model moved by modulus" in text
    assert "what was known: modulus of the shaft (+1.9)." in text


def test_a_diagnosis_without_calibrated_numbers_has_no_such_part(curves, tmp_path):
    bare = replace(DIAGNOSIS, nominal={**DIAGNOSIS.nominal, "calibration": Calibration()}, calibration=Calibration())
    page = page_of(bare, curves, tmp_path)
    assert headings(page) == BARE


def test_the_next_run_is_a_table_that_a_campaign_can_take(page):
    (toml,) = re.findall(r"<pre[^>]*>(.*?)</pre>", page.source, re.DOTALL)
    assert tomllib.loads(html.unescape(toml)) == {
        "run": [{"support": "bearing", "excitation_node": 2, "force_amplitude_N": 4.0}]
    }


def test_settings_of_any_type_become_toml():
    settings = {"sweep": "up", "levels": [1.0, np.float64(2.5)], "words": 'a "b"\n', "flag": True, "none": None}
    assert tomllib.loads(run_toml(settings))["run"] == [
        {"sweep": "up", "levels": [1.0, 2.5], "words": 'a "b"\n', "flag": True}
    ]


def test_the_bearings_stiffness_is_drawn_where_a_run_tells_it(curves, tmp_path):
    seen = replace(DIAGNOSIS, where=replace(DIAGNOSIS.where, bearings=BEARINGS))
    page = page_of(seen, curves, tmp_path)
    assert page.figures == [*FIGURES[:-1], "bearings", FIGURES[-1]]
    assert "the response of bearing-1; no cause" in words(page)


@pytest.mark.parametrize("corrected", [True, False])
def test_each_part_of_the_bearings_stiffness_stands_beside_its_models(corrected):
    shown = BEARINGS if corrected else replace(BEARINGS, corrected_real=(), corrected_imag=())
    traces = bearings_figure(shown, "with the effect").data
    half = 3 if corrected else 2
    for part, named in ((traces[:half], "real"), (traces[half:], "imag")):
        assert_allclose(part[0].y, getattr(BEARINGS, named))
        assert_allclose(part[0].error_y.array, BEARINGS.std)
        assert_allclose(part[1].y, getattr(BEARINGS, f"nominal_{named}"))
        assert len(part) == half
        if corrected:
            assert_allclose(part[2].y, getattr(BEARINGS, f"corrected_{named}"))


@pytest.mark.parametrize("verdict", ["no_gap", "unknown", "not_enough_data"])
@pytest.mark.parametrize("with_candidates", [True, False])
def test_a_verdict_without_a_cause_names_none(curves, tmp_path, verdict, with_candidates):
    bare = replace(
        DIAGNOSIS, verdict=verdict, causes=(CRACK,) if with_candidates else (), shrink=None, next_test=None, audit=()
    )
    page = page_of(bare, tuple(replace(c, corrected=None) for c in curves), tmp_path)
    assert headings(page) == HEADINGS
    assert page.figures == ["responses", "gap-map", *["candidates"] * with_candidates, "joint"]
    text = words(page)
    assert "No cause is named." in text
    assert "Not measured: no effect was named." in text
    assert ("of the nominal model, 90 % interval" in text) == (verdict != "no_gap")
    assert text.index("35.0 %") < text.index(HEADINGS[0])
    assert "Probability" not in text[: text.index(HEADINGS[0])]
    assert "Probability of each candidate, given these data" not in text


def test_several_causes_are_marked_as_not_told_apart(curves, tmp_path):
    first, second = replace(PEDESTAL, probability=0.48), replace(CRACK, probability=0.45)
    both = replace(DIAGNOSIS, verdict="ambiguous", causes=(first, second, PAIR), equivalent=(first, second))
    page = page_of(both, curves, tmp_path)
    assert words(page).count("not told apart from the others marked so") == 2
    figure = candidate_figure(both.causes, both.equivalent)
    assert tuple(figure.data[0].marker.pattern.shape) == ("/", "/", "")


def test_many_candidates_stand_behind_a_fold(curves, tmp_path):
    page = page_of(replace(DIAGNOSIS, causes=(PEDESTAL, *[CRACK] * 20)), curves, tmp_path)
    assert len(candidate_figure((PEDESTAL, *[CRACK] * 20), ()).data[0].x) == 10
    assert len(candidate_figure((PEDESTAL, *[PAIR] * 20), ()).data[0].x) == 5
    assert "<summary>11 more candidates</summary>" in page.source


def test_a_campaign_of_resonance_lists_has_no_curves(tmp_path):
    peaks = (PeakList("rigid", np.array([95.0, 320.0]), np.array([1.5, 3.0])),)
    few = Diagnosis("", "nit-rourkela", "not_enough_data", "Two peaks are not enough.", {"k_b": None}, Where())
    page = page_of(few, (), tmp_path, title="", peaks=peaks)
    assert headings(page) == BARE
    assert page.figures == []
    assert "95.0 ± 1.5, 320.0 ± 3.0" in words(page)


def test_listed_resonances_stand_beside_the_models(tmp_path):
    peaks = (PeakList("rigid", np.array([95.0, 320.0]), np.array([1.5, 3.0])),)
    rows = [
        {"support": "rigid", "listed_Hz": 95.0, "std_Hz": 1.5, "nominal_Hz": 100.56, "best_Hz": 95.2},
        {"support": "rigid", "listed_Hz": 320.0, "std_Hz": 3.0, "nominal_Hz": None, "best_Hz": 319.9},
    ]
    fit = {"matched": 1, "unmatched": 1, "not_listed": 0, "parameters": 1, "chi2": 13.7, "degrees_of_freedom": 0,
           "p_value": math.nan, "determined": 1.0}  # fmt: skip
    nominal = {"k_b": None, "gap": None, "peaks": rows, "fit": fit, "best_fit": None}
    few = Diagnosis("", "nit-rourkela", "not_enough_data", "Two are not enough.", nominal, Where(), (PEDESTAL,))
    page = page_of(few, (), tmp_path, title="", peaks=peaks)
    assert page.figures == ["peaks", "candidates"]
    assert "rigid 95.0 ± 1.5 100.6 95.2 rigid 320.0 ± 3.0 none 319.9" in words(page)
    assert "nominal model 1 1 0 1 13.7 0 cannot be tested" in words(page)
    listed, nominal_marks, best = peaks_figure(rows, "Pedestal flexibility").data
    assert_allclose((listed.x, listed.error_x.array), ([95.0, 320.0], [1.5, 3.0]))
    assert_allclose(nominal_marks.x, [100.56])
    assert_allclose(best.x, [95.2, 319.9])


def test_no_gap_says_what_the_tests_own_gains_leave(curves, tmp_path):
    fine = replace(DIAGNOSIS, verdict="no_gap", shrink=None, next_test=None, causes=())
    page = page_of(fine, curves, tmp_path)
    text = words(page)
    left = np.mean([nrmse(c.run.H, c.corrected) for c in curves])
    assert f"Gap {share(float(left))} gains and drifts of this test allowed for" in text
    assert "Gains and drifts 35.0 % difference that they make" in text
    assert "nominal, with gains and drifts" in page.source


def test_checks_without_a_finding_stand_behind_a_fold(page):
    folded = page.source.split("<summary>1 check without a finding</summary>")[1].split("</details>")[0]
    assert "Noise was given with the lines." in folded
    assert "2 lines in the half-power band" not in folded


def test_a_number_at_the_end_of_its_range_has_no_error():
    assert parameters(replace(PEDESTAL, at_prior_edge=tuple(PEDESTAL.parameters)))[0] == "stiffness 1.02×10⁷ N/m"


def test_numbers_that_are_not_there_do_not_break_the_page(curves, tmp_path):
    nan = math.nan
    lost = replace(
        DIAGNOSIS,
        nominal={"k_b": None, "gap": nan},
        shrink=Shrink("a run", nan, nan, nan, nan, nan, (nan, nan), "model"),
        causes=(replace(PEDESTAL, k_b=None, log_evidence=nan, parameters={"a.b": Estimate(nan, nan)}),),
        where=Where(bands=(Band(20.0, 400.0, None, nan),), joint=replace(JOINT, real=(nan,) * 76, imag=(nan,) * 76)),
    )
    page = page_of(lost, curves, tmp_path)
    assert page.figures == ["responses", "gap-map", "candidates", "joint"]
    assert "nan" not in words(page).lower().split()


def test_texts_of_a_user_stay_texts(curves, tmp_path):
    evil = "</script><script>alert(1)</script>"
    run = replace(curves[0].run, name=evil)
    bad = replace(DIAGNOSIS, sentence=evil, audit=(Finding("noise", "note", evil, evil),), excluded=(evil,))
    page = page_of(bad, (replace(curves[0], run=run),), tmp_path, title=evil)
    assert [script for script in page.scripts if script.startswith("alert")] == []
    assert evil in page.text


# --- the numbers in the figures --------------------------------------------------------------------


def numbers(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_the_page_holds_every_line_of_every_run(page, curves):
    (data,) = re.findall(r'id="response-data">(.*?)</script>', page.source)
    runs = json.loads(data)["runs"]
    assert [run["label"] for run in runs] == [
        "rigid-1: rigid, 1 N at node 2",
        "bearing-1: bearing, 1 N at node 2",
        "bearing-2: bearing, 2 N at node 2",
    ]
    for run, curve in zip(runs, curves, strict=True):
        assert_allclose(numbers(run["frequency"], "<f8"), curve.run.frequency_hz, rtol=0)
        for place, channel in enumerate(run["channels"]):
            assert channel["label"] == f"node {curve.run.channels[place].node}"
            models = {"measured": curve.run.H, "nominal": curve.nominal, "corrected": curve.corrected}
            assert_allclose(numbers(channel["std"], "<f4"), curve.std[:, place], rtol=FLOAT32)
            for name, H in models.items():
                size, degrees = (
                    numbers(channel[name][part], kind) for part, kind in (("size", "<f4"), ("phase", "<i2"))
                )
                assert_allclose(size, np.abs(H[:, place]), rtol=FLOAT32)
                turns = np.exp(1j * np.radians(degrees / 100)) / np.exp(1j * np.angle(H[:, place]))
                assert np.abs(np.angle(turns, deg=True)).max() < 0.006  # half a hundredth of a degree


def test_the_page_opens_on_the_run_with_the_largest_gap_at_the_driving_point(page):
    (data,) = re.findall(r'id="response-data">(.*?)</script>', page.source)
    run, node = json.loads(data)["first"]
    assert (run > 0, node) == (True, 0)


def test_magnitudes_have_no_phase(curves, tmp_path):
    run = replace(curves[1].run, H=np.abs(curves[1].run.H).astype(complex), magnitude_only=True)
    curve = Curve(run, np.abs(curves[1].nominal), None, curves[1].std)
    (record,) = responses([curve])
    assert record["phase"] is False
    assert "phase" not in record["channels"][0]["measured"]
    assert "corrected" not in record["channels"][0]
    axes = sorted(axis for axis in response_figure([curve], ()).layout if axis.startswith("yaxis"))
    assert axes == ["yaxis", "yaxis2"]  # magnitude, and the difference of magnitudes
    page = page_of(replace(DIAGNOSIS, where=Where()), (curve,), tmp_path)
    assert "Without phase: bearing-1." in words(page)


def test_the_map_of_magnitudes_compares_magnitudes(curves):
    run = replace(curves[1].run, H=np.abs(curves[1].run.H).astype(complex), magnitude_only=True)
    turned = Curve(run, -1j * curves[1].run.H, None, curves[1].std)  # right but for its phase
    assert np.nanmax(gap_map([turned], BANDS).before) < 1e-12


def test_levels_that_differ_are_said_to_differ(curves, tmp_path):
    same = "the same at every force level that was measured"
    assert same in words(page_of(DIAGNOSIS, curves, tmp_path))
    louder = Finding("level", "note", "Levels differ.", value=3.0)
    text = words(page_of(replace(DIAGNOSIS, audit=(louder,)), curves, tmp_path))
    assert same not in text
    assert "changes with the force level" in text


def test_a_silent_channel_and_a_missing_line_leave_no_infinity():
    quiet = curve("rigid", 1.0, (Channel(1), Channel(2)))
    record = responses([quiet])[0]["channels"][0]["measured"]
    silent = np.abs(quiet.run.H[:, 0]) == 0
    assert np.isnan(numbers(record["size"], "<f4"))[silent].all()
    cells = gap_map([quiet], BANDS)
    assert np.isnan(cells.before[0, :, 0]).all()
    assert np.isfinite(cells.before[0, :, 1]).all()


def test_the_gap_map_is_the_error_of_each_band_and_node(curves):
    cells = gap_map(curves, BANDS)
    assert cells.runs == ("rigid 1 N", "bearing 1 N", "bearing 2 N")
    assert cells.before.shape == (3, 3, 3)
    run, nominal = curves[1].run, curves[1].nominal
    inside = (run.frequency_hz >= 150) & (run.frequency_hz <= 310)
    error = np.linalg.norm((run.H - nominal)[inside, 2]) / np.linalg.norm(run.H[inside, 2])
    assert_allclose(cells.before[1, 1, 2], error, rtol=1e-12)
    assert_allclose(cells.noise, NOISE, rtol=0.05)
    assert_allclose(cells.after, NOISE, rtol=0.6)
    assert (cells.before[1:] > 1.4 * cells.after[1:]).all()
    assert_allclose(10.0 ** np.array(gap_map_figure(cells).data[0].z[1]), cells.before[1].ravel(), rtol=1e-9)


def test_runs_that_look_alike_get_labels_of_their_own(curves):
    up, down = (replace(curves[1], run=replace(curves[1].run, sweep=way)) for way in ("up", "down"))
    moved = replace(curves[1], run=replace(curves[1].run, excitation_node=4, name="moved"))
    assert gap_map([up, down], ()).runs == ("bearing 1 N up", "bearing 1 N down")
    labels = gap_map([curves[1], moved, replace(moved, run=replace(moved.run, name="again"))], ()).runs
    assert len(set(labels)) == 3


def test_runs_with_different_channels_share_one_map(curves):
    other = curve("bearing", 3.0, (Channel(3), Channel(4)))
    cells = gap_map([curves[1], other], BANDS)
    assert [channel.node for channel in cells.channels] == [2, 3, 4, 6]
    assert np.isnan(cells.before[1, 0]).tolist() == [True, False, False, True]


def test_bars_and_curves_are_those_of_the_diagnosis(curves):
    figure = response_figure(curves, BANDS)
    assert len(figure.data) == len(RESPONSE_TRACES) + 1
    bands = figure.data[-1]
    assert_allclose(bands.y, [62, 35, 3])
    assert_allclose(np.array(bands.x) - np.array(bands.width) / 2, [20, 150, 310])
    candidates = candidate_figure(DIAGNOSIS.causes, ()).data[0]
    assert_allclose(candidates.x, [93, 5, 0.02])
    assert tuple(candidates.text) == ("93 %", "5.0 % *", "under 0.1 %")
    real, imag = joint_figure(JOINT).data[:2]
    assert_allclose((real.y, imag.y), (JOINT.real, JOINT.imag))
    bars, model = shrink_figure(SHRINK).data
    assert_allclose(bars.x, [31.4, 20.7, 1.31, 1.1])
    assert_allclose(model.x, [1.28])


def test_a_gap_that_grew_is_drawn_as_it_is():
    worse = replace(SHRINK, after=0.4, shrink=-0.27, explainable=-0.28, ci90=(-0.4, -0.1), after_model=None)
    assert_allclose(shrink_figure(worse).data[0].x, [31.4, 20.7, 40.0, 1.1])


# --- words -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(0.312, 0.0041, "kg"), "0.3120 ± 0.0041 kg"),
        (Estimate(1.02e7, 3e5, "N/m"), "(1.020 ± 0.030)×10⁷ N/m"),
        (Estimate(-6.5e-4, 8.4e-6, "m"), "(−6.500 ± 0.084)×10⁻⁴ m"),
        (Estimate(0.5, math.nan), "0.5"),
        (Estimate(3e15, 0.0, "N/m3"), "3×10¹⁵ N/m³"),
        (Estimate(0.0, 0.1, "1"), "0.00 ± 0.10"),
        (Estimate(math.nan, 1.0), "unknown"),
        (Estimate(5e-6, 0.31), "0.00 ± 0.31"),
    ],
)
def test_a_parameter_is_written_with_its_error_and_unit(estimate, text):
    assert quantity(estimate) == text


def test_parameters_of_a_pair_say_whose_they_are():
    assert parameters(PAIR)[0] == "Attached mass: mass 0.100 ± 0.010 kg"
