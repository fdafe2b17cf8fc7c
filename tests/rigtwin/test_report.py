"""The pages: whole and self-contained; and the demo's numbers behind them."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from rigtwin.pages.figures import Curve, frf_figure
from rigtwin.sim.campaign import Campaign
from rigtwin.sim.campaign_folder import load_campaign, save_campaign
from rigtwin.sim.formats import read_run, write_run
from tests.rigtwin.conftest import run

# How plotly.js begins, whatever its version.
PLOTLY_JS = re.compile(r"\* plotly\.js \(cartesian - minified\) v[\d.]+")

# The network's own error of k_b, and what 1 % noise on every line adds to it.
ESTIMATE = 2e-3


class Page(HTMLParser):
    """What a page refers to and what it holds."""

    def __init__(self, path: Path):
        super().__init__()
        self.addresses: list[str] = []
        self.figures: list[str] = []
        self.scripts: list[str] = []
        self.text = ""
        self._inside = ""
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag, attrs):
        known = {name: value for name, value in attrs if value}
        self.addresses += [known[name] for name in ("src", "href", "action", "data") if name in known]
        self._inside = tag
        if tag == "script":
            self.scripts.append("")
        if known.get("class") == "figure":
            self.figures.append(known["id"])

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside == "script":
            self.scripts[-1] += data
        elif self._inside != "style":
            self.text += data


@pytest.fixture(scope="module")
def demo_page(demo) -> Page:
    return Page(demo.out / "index.html")


@pytest.fixture
def report_page(swept, tmp_path) -> Page:
    """The page of two swept runs."""
    result = run("report", swept.bearing, "--rigid", swept.rigid, "--out", tmp_path / "page.html")
    assert result.exit_code == 0, result.stderr
    return Page(tmp_path / "page.html")


def assert_self_contained(page: Page) -> None:
    """One plotly.js, and nothing that a browser would fetch."""
    libraries = [script for script in page.scripts if PLOTLY_JS.search(script)]
    assert len(libraries) == 1
    assert [address for address in page.addresses if not address.startswith("data:")] == []
    ours = page.source.replace(libraries[0], "")
    assert re.findall(r"https?:|url\(|@import", ours) == []


# --- the demo --------------------------------------------------------------------------------------


def test_the_demo_leaves_both_fmus_a_page_the_numbers_and_a_campaign(demo):
    assert {path.name for path in demo.fmus.iterdir()} == {"RotorRig.fmu", "StiffnessEstimator.fmu"}
    assert {path.name for path in demo.out.iterdir()} == {"index.html", "demo.json", "campaign"}
    assert {run.support for run in load_campaign(demo.out / "campaign").runs} == {"rigid", "bearing"}


def test_the_demo_finds_three_stiffnesses_again(demo):
    rigs = demo.numbers["rigs"]
    assert [rig["truth"]["k_b"] for rig in rigs] == [1.3e6, 6.2e6, 4.7e7]
    assert_allclose([rig["estimate"]["k_b"] / rig["truth"]["k_b"] for rig in rigs], 1, atol=ESTIMATE)
    assert all(rig["estimate"]["valid"] is True for rig in rigs)


def test_the_demo_measures_the_default_rig_as_the_paper_computes_it(demo):
    """Table 1 within the half a percent that nothing explains; the modes measured are the model's own."""
    modes = demo.numbers["default_rig"]
    assert_allclose([mode["frequency_hz"] for mode in modes["rigid"]], (100.018, 323.083), rtol=6e-3)
    assert_allclose([mode["frequency_hz"] for mode in modes["bearing"]], (96.04, 297.5), rtol=6e-3)
    assert demo.numbers["table_2_largest_difference"] < 0.035


def test_the_demo_page_is_self_contained(demo_page):
    assert_self_contained(demo_page)


def test_the_demo_page_has_every_figure_and_every_result(demo, demo_page):
    assert demo_page.figures == ["frf", "frequencies", "readings"]
    assert demo_page.addresses == []
    text = demo_page.text.replace("\xa0", " ")
    for sentence in (demo.numbers["result"], *demo.numbers["verdict"]):
        assert sentence in text
        assert sentence in demo.printed
    assert all(value in text for value in demo.numbers["provenance"].values() if not value.endswith("UTC"))


def test_no_page_names_a_folder_of_this_machine(demo, demo_page):
    assert str(demo.out.parent) not in demo_page.source
    assert str(Path(__file__).resolve().parents[2]) not in demo_page.source


# --- the report ------------------------------------------------------------------------------------


def test_the_report_page_is_self_contained(report_page):
    assert_self_contained(report_page)
    assert report_page.figures == ["frf"]


def test_the_report_shows_modes_and_stiffness(report_page, swept):
    assert float(re.search(r"k_b = ([\d.]+)", report_page.text)[1]) == pytest.approx(3.7, rel=1e-3)
    assert report_page.text.count("100.561") == 1  # mode 1 on rigid supports


def test_the_report_reads_a_campaign_folder(demo, tmp_path):
    assert run("report", demo.out / "campaign", "--out", tmp_path / "page.html").exit_code == 0
    found = re.search(r"k_b = ([\d.]+)\s±\s([\d.]+)\sMN/m", Page(tmp_path / "page.html").text)
    assert found
    k_b, error = map(float, found.groups())
    assert abs(k_b - 10) < 4 * error < 0.01


def test_one_support_alone_has_no_stiffness_and_says_why(swept, tmp_path):
    result = run("report", "--rigid", swept.rigid, "--out", tmp_path / "page.html")
    assert result.exit_code == 0
    assert "1 run; no stiffness: an estimate needs a run on rigid supports and one on bearings" in result.stdout


def test_a_campaign_of_peaks_alone_is_a_page_without_figures(tmp_path):
    paper = Path(__file__).resolve().parents[2] / "examples" / "nit-rourkela-paper"
    assert run("report", paper, "--out", tmp_path / "page.html").exit_code == 0
    page = Page(tmp_path / "page.html")
    assert page.figures == []
    assert "95.0 ± 1.5" in page.text.replace("\xa0", " ")


def test_runs_of_magnitudes_are_drawn_and_the_page_says_what_is_missing(swept, tmp_path):
    lines = ["frequency_Hz,node2_abs", *(f"{90 + i},{1 + i % 3}" for i in range(20))]
    (tmp_path / "abs.csv").write_text("\n".join(lines), encoding="utf-8")
    run("report", "--bearing", tmp_path / "abs.csv", "--rigid", swept.rigid, "--out", tmp_path / "page.html")
    page = Page(tmp_path / "page.html")
    assert page.figures == ["frf"]
    assert "holds magnitudes only" in page.text


def test_a_title_cannot_break_out_of_its_place(swept, tmp_path):
    """Titles and file names come from others: they are text, in the page and in its scripts."""
    evil = "</script><script>alert(1)</script>"
    runs = (read_run(swept.bearing),)
    save_campaign(Campaign(evil, "nit-rourkela", runs), tmp_path / "campaign")
    write_run(runs[0], tmp_path / "<b>bold.uff")
    for number, source in enumerate((tmp_path / "campaign", tmp_path / "<b>bold.uff")):
        assert run("report", source, "--out", tmp_path / f"{number}.html").exit_code == 0
        page = Page(tmp_path / f"{number}.html")
        assert len(page.scripts) == 3  # plotly.js, what draws with it, and one figure
        assert not [script for script in page.scripts if "alert(1)" in script]
        assert "<b>bold" not in page.source
    assert evil in Page(tmp_path / "0.html").text


def test_a_csv_on_its_own_is_asked_for_its_support(refused, swept, tmp_path):
    message = refused("report", swept.rigid, "--out", tmp_path / "page.html")
    assert "give it with --rigid or --bearing" in message


def test_the_name_of_a_file_does_not_change_what_is_said_of_it(refused, swept, tmp_path):
    wrong = tmp_path / "wrong support.csv"
    wrong.write_text(swept.rigid.read_text(encoding="utf-8").replace("frequency_Hz", "speed"), encoding="utf-8")
    assert "--rigid or --bearing" not in refused("report", wrong, "--out", tmp_path / "page.html")


def test_a_node_that_the_rig_lacks_is_refused(refused, swept, tmp_path):
    header, *lines = swept.rigid.read_text(encoding="utf-8").splitlines(keepends=True)
    wrong, page = tmp_path / "rigid.csv", tmp_path / "page.html"
    wrong.write_text("".join([header.replace("node7", "node12"), *lines]), encoding="utf-8")
    assert "channel node12: node 12 does not exist, the rig has 7" in refused("report", "--rigid", wrong, "--out", page)
    assert not page.exists()


def test_a_dead_channel_is_drawn_as_nothing(swept):
    run = read_run(swept.bearing)
    assert run.std is not None
    dead = dataclasses.replace(run, H=0 * run.H)
    figure = frf_figure([Curve(dead, "dead", run.channels[0])])
    assert [len(trace.x) for trace in figure.data] == [0]
