"""Every page in Chromium: light, dark, narrow and on paper; readable, reachable by the keyboard, and safe."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigtwin.pages.page import plotly_js
from rigtwin.pages.palette import MAP, ON_DARK, ON_MAP
from tests.rigtwin.gallery import EVIL, PAGES

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="needs chromium")

ROOT = Path(__file__).resolve().parents[2]
CHECKS = Path(__file__).with_name("page_checks.js").read_text(encoding="utf-8")
WIDE, NARROW = {"width": 1100, "height": 900}, {"width": 400, "height": 800}

# A sheet of A4 less margins of 12 mm, in CSS pixels.
SHEET = {"width": 703, "height": 1031}

# Pages without a title of a user.
OURS = ("demo", "estimator_fmu")


# Whether the last figure has the colour of the page and the width of its place, on paper of the sheet.
_DRAWN = """() => {
  const figure = [...document.querySelectorAll(".figure")].pop(), ground = e => getComputedStyle(e).backgroundColor;
  if (!figure) return true;
  const drawn = figure.querySelector(".main-svg");
  const width = matchMedia("print").matches ? 680 : figure.clientWidth;
  return drawn && ground(drawn) === ground(document.body) && drawn.getBoundingClientRect().width === width;
}"""


@dataclass
class Opened:
    """A page in the browser, opened once for all tests of it."""

    name: str
    path: Path
    tab: Any
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)
    shown: Any = None

    def show(self, size: dict[str, int] = WIDE, scheme: str = "light", media: str = "screen") -> None:
        """Let the page be so large, in one of two colour schemes, on the screen or on paper."""
        if self.shown == (size, scheme, media):
            return
        self.tab.emulate_media(color_scheme=scheme, media=media)
        self.tab.set_viewport_size(size)
        self.tab.wait_for_function(_DRAWN)
        self.shown = size, scheme, media

    def wrong(self, check: str) -> Any:
        """What one of the checks says."""
        return self.tab.evaluate(f"{CHECKS}.{check}()")


class Gallery:
    """Pages by name, each made and opened once, with a title that would break out of its place."""

    def __init__(self, folder: Path, browser: Any):
        self._folder, self._browser = folder, browser
        self.opened: dict[str, Opened] = {}

    def path(self, name: str) -> Path:
        """The file of a page."""
        path = self._folder / f"{name}.html"
        if not path.exists():
            PAGES[name](path, EVIL)
        return path

    def open(self, name: str) -> Opened:
        """A page in a tab of its own; the next one begins to load meanwhile."""
        opened = self._begin(name)
        following = list(PAGES)[list(PAGES).index(name) + 1 :][:1]
        for next_name in following:
            self._begin(next_name)
        opened.tab.wait_for_load_state()
        return opened

    def _begin(self, name: str) -> Opened:
        if name not in self.opened:
            tab = self._browser.new_page(viewport=WIDE, offline=True)
            opened = self.opened[name] = Opened(name, self.path(name), tab)
            tab.on("console", lambda said: opened.complaints.append(f"{said.type}: {said.text}"))
            tab.on("pageerror", lambda error: opened.complaints.append(str(error)))
            tab.on("request", lambda asked: opened.requests.append(asked.url))
            tab.goto(opened.path.as_uri(), wait_until="commit")
        return self.opened[name]


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gallery]:
    """All pages; in the end none has complained of anything or has asked for another file."""
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        pages = Gallery(tmp_path_factory.mktemp("pages"), browser)
        yield pages
        complaints = {name: page.complaints for name, page in pages.opened.items() if page.complaints}
        asked = {name: page.requests for name, page in pages.opened.items() if len(page.requests) > 1}
        browser.close()
    assert (complaints, asked) == ({}, {})


@pytest.fixture(params=list(PAGES), scope="module")
def page(request: pytest.FixtureRequest, gallery: Gallery) -> Opened:
    return gallery.open(request.param)


def test_a_page_complains_of_nothing_asks_for_nothing_and_is_small(page):
    page.show()
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith("data:")] == [page.path.as_uri()]
    assert page.path.stat().st_size < 2e6


def test_a_hostile_title_is_a_text(page):
    page.show()
    assert page.tab.evaluate("window.broken") is None
    assert (EVIL in page.tab.inner_text("body")) == (page.name not in OURS)


def test_every_figure_is_drawn_and_told_in_a_sentence(page):
    page.show()
    for figure in page.tab.query_selector_all(".figure"):
        assert figure.get_attribute("role") == "img"
        assert re.fullmatch(r"[A-Z].{20,}\.", figure.get_attribute("aria-label"), re.DOTALL)
        assert figure.query_selector(".main-svg")
    for drawing in page.tab.query_selector_all("svg[role=img]"):
        assert drawing.get_attribute("aria-label")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_all_text_can_be_read(page, scheme):
    page.show(scheme=scheme)
    assert page.wrong("contrast") == []


def test_a_dark_page_is_dark_with_its_figures(page):
    page.show(scheme="dark")
    grounds = page.tab.evaluate(
        """[document.body, ...document.querySelectorAll(".figure .main-svg:first-child")].map(
            e => getComputedStyle(e).backgroundColor)"""
    )
    if page.name.endswith("fmu"):  # the browser's own colours
        assert page.tab.evaluate("getComputedStyle(document.documentElement).colorScheme") == "light dark"
    else:
        assert set(grounds) == {"rgb(20, 24, 29)"}


@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_nothing_is_cut(page, size):
    page.show(size)
    assert page.wrong("cut") == []


def test_what_scrolls_is_reached_by_the_keyboard(page):
    page.show(NARROW)
    assert page.wrong("unreachable") == []


def test_all_controls_are_reached_by_the_keyboard_and_seen(page):
    page.show(NARROW)
    page.tab.evaluate("document.activeElement.blur()")
    wanted = page.tab.evaluate(
        "[...document.querySelectorAll('select, summary, [tabindex=\"0\"]')].filter(e => e.checkVisibility()).length"
    )
    found = []
    for _ in range(wanted):
        page.tab.keyboard.press("Tab")
        found.append(page.wrong("focused"))
    assert [stop for stop in found if stop["kind"] == "BODY" or not stop["seen"]] == []
    assert len({(stop["kind"], stop["name"]) for stop in found}) >= min(wanted, 2)


def test_a_printed_page_is_light_and_has_its_first_figure_on_its_first_sheet(page):
    page.show(SHEET, "dark", "print")
    assert not [choice for choice in page.tab.query_selector_all("select") if choice.is_visible()]
    assert page.wrong("cut") == []
    figures = page.tab.query_selector_all(".figure")
    if page.name in ("cause", "unknown"):
        ends = figures[0].bounding_box()
        assert ends["y"] + ends["height"] < SHEET["height"]
        assert "Drawn: bearing" in page.tab.inner_text("#chosen")
    if not page.name.endswith("fmu"):
        grounds = page.tab.evaluate(
            """[document.body, ...document.querySelectorAll(".figure .main-svg:first-child")].map(
                e => getComputedStyle(e).backgroundColor)"""
        )
        assert set(grounds) <= {"rgb(255, 255, 255)"}


def test_a_page_is_drawn_for_paper_before_it_is_printed_and_for_the_screen_afterwards(gallery):
    """A browser tells so before it lays the page out for paper."""
    page = gallery.open("lists")
    page.show(scheme="dark")
    ground = "getComputedStyle(document.querySelector('.figure .main-svg')).backgroundColor"
    for event, colour in (("beforeprint", "rgb(255, 255, 255)"), ("afterprint", "rgb(20, 24, 29)")):
        page.tab.evaluate(f"dispatchEvent(new Event('{event}'))")
        assert page.tab.evaluate(ground) == colour


# -- a page of a diagnosis --------------------------------------------------------------------------------


def test_another_run_is_drawn_when_it_is_chosen_and_stays_in_the_dark(gallery):
    page = gallery.open("cause")
    page.show()
    runs, nodes = (
        page.tab.eval_on_selector_all(f"#{name} option", "all => all.map(e => e.text)") for name in ("run", "node")
    )
    assert [run.split(":")[-1] for run in runs] == [
        f" {s}, {f} N at node 2" for s, f in (("rigid", 1), ("bearing", 1), ("bearing", 2))
    ]
    assert nodes == ["node 2", "node 4", "node 6"]
    before = page.tab.evaluate("document.getElementById('responses').data[3].y[5]")
    page.tab.select_option("#run", index=0)
    after = page.tab.evaluate("document.getElementById('responses').data[3].y[5]")
    assert before != after
    page.show(scheme="dark")
    assert page.tab.evaluate("document.getElementById('responses').data[3].y[5]") == after
    assert page.tab.evaluate("document.getElementById('responses').data[3].marker.color") == "#e6e9ed"


@pytest.mark.parametrize(("name", "nodes"), [("cause", [1, 7]), ("unknown", [5])])
def test_the_place_that_a_diagnosis_names_is_ringed_on_the_drawing(gallery, name, nodes):
    page = gallery.open(name)
    rings = page.tab.evaluate("[...document.querySelectorAll('.ring')].map(e => e.getAttribute('cx'))")
    numbers = page.tab.evaluate(
        "[...document.querySelectorAll('.rotor text')].map(e => [e.textContent, e.getAttribute('x')])"
    )
    assert list(dict.fromkeys(rings)) == [dict(numbers)[str(node)] for node in nodes]
    assert "Ringed: " in page.tab.inner_text(".rotor + .caption")


def test_the_meaning_of_a_variable_has_a_column_to_itself(gallery):
    page = gallery.open("rotor_fmu")
    page.show(NARROW)
    width = page.tab.evaluate("document.querySelector('.variables td:last-child').getBoundingClientRect().width")
    assert width > 250


def test_plotly_is_the_one_that_is_published():
    """npm's plotly.js-cartesian-dist-min 4.1.1, byte for byte."""
    published = "79542150855a52c567260e3137095dbe2b744e6d702a5cabe67da246942fba7a"
    assert hashlib.sha256(plotly_js().encode()).hexdigest() == published


# -- colours ----------------------------------------------------------------------------------------------


def luminance(colour: str) -> float:
    """Relative luminance (WCAG 2.2)."""
    parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


@pytest.mark.parametrize("dark", [False, True])
def test_numbers_in_the_map_can_be_read_on_every_colour(dark):
    shades = [ON_DARK[colour] if dark else colour for colour in (*MAP, *ON_MAP)]
    *scale, below, above = [luminance(shade) for shade in shades]
    for place in range(len(scale)):
        text = below if place < 4 else above
        low, high = sorted((text, scale[place]))
        assert (high + 0.05) / (low + 0.05) >= 4.5


def test_every_colour_of_a_figure_has_one_for_the_dark(gallery):
    for name in PAGES:
        source = gallery.path(name).read_text(encoding="utf-8")
        for figure in re.findall(r'-figure">(.*?)</script>', source, re.DOTALL):
            shown = {colour.lower() for colour in re.findall(r"#[0-9a-fA-F]{6}\b", json.dumps(json.loads(figure)))}
            assert shown <= {colour.lower() for colour in ON_DARK}, name


def test_colours_stand_in_the_palette_alone():
    pages = ROOT / "rigtwin" / "pages"
    for path in (*pages.glob("*.py"), *(pages / "templates").iterdir()):
        if path.name != "palette.py":
            assert re.findall(r"#[0-9a-fA-F]{3,8}\b(?!-)", path.read_text(encoding="utf-8")) == [], path.name
