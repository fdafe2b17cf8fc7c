"""docs/effects is what the effect library says, and every page has its figure."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest

from benchmarks.effect_pages.__main__ import (
    FAMILIES,
    FOLDER,
    REFERENCES,
    latex,
    main,
    overview,
    page,
    pages,
    read_references,
)
from benchmarks.effect_pages.figures import FIGURES, stepped_sine
from benchmarks.effect_pages.plots import BEARING, NODE, paper_rotor
from rigtwin.commands.effects import LOCATIONS
from rigtwin.rotor.effects import EFFECTS, Parameter
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.model.force_laws import LAWS

CITATIONS = read_references(REFERENCES.read_text(encoding="utf-8"))

# A figure must not weigh on the repository.
LARGEST_FIGURE = 60_000


@pytest.mark.parametrize("name", ["README.md", *(f"{key}.md" for key in EFFECTS)])
def test_a_page_is_what_the_library_says(name):
    assert (FOLDER / name).read_text(encoding="utf-8") == pages()[name], "run make effect-pages"


def test_there_is_a_page_and_a_figure_for_every_effect_and_for_nothing_else():
    assert {path.stem for path in FOLDER.glob("*.md")} == {"README", *EFFECTS}
    assert {path.stem for path in (FOLDER / "figures").iterdir()} == set(EFFECTS) == set(FIGURES)


@pytest.mark.parametrize("key", EFFECTS)
def test_a_figure_is_a_small_picture_that_can_be_read(key):
    data = (FOLDER / "figures" / f"{key}.png").read_bytes()
    assert data.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", data[16:24])
    assert width >= 500
    assert height >= 300
    assert len(data) < LARGEST_FIGURE


@pytest.mark.parametrize("key", EFFECTS)
def test_a_page_has_equation_parameters_place_figure_and_source(key):
    effect, text = EFFECTS[key], page(EFFECTS[key], CITATIONS)
    assert f"$$ {effect.equation} $$" in text
    assert f"](figures/{key}.png)" in text
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == list(effect.parameters())
    flowing = " ".join(text.split())
    assert LOCATIONS[effect.location] in flowing
    assert CITATIONS[effect.source] in flowing
    for name, role in effect.roles().items():
        assert f"`{name}`" in text
        if isinstance(role, Parameter):
            assert role.meaning in text


def test_the_overview_links_every_effect_under_its_family():
    sections = re.split(r"^## ", overview(), flags=re.MULTILINE)[1:]
    assert [section.splitlines()[0] for section in sections] == list(FAMILIES.values())
    for family, section in zip(FAMILIES, sections, strict=True):
        expected = [key for key, effect in EFFECTS.items() if effect.family == family]
        assert re.findall(r"\]\((\w+)\.md\)", section) == expected


def test_every_effect_with_a_force_law_shows_it():
    shown = {key for key, effect in EFFECTS.items() if "As force law" in page(effect, CITATIONS)}
    assert shown == {key for key, effect in EFFECTS.items() if effect.family == "nonlinear"}
    assert {law.name: latex(law) for law in LAWS}["contact"] == (
        r"k \left(\left(x - g\right)_{+} - \left(- x - g\right)_{+}\right)"
    )


def test_every_source_is_a_complete_entry_of_the_bibliography():
    for effect in EFFECTS.values():
        citation = CITATIONS[effect.source]
        assert re.search(r"\*.+\*.*, (19|20)\d\d[,.]", citation), citation
        assert not re.search(r"[{}\\]", citation), citation


def test_citations_read_like_citations():
    assert CITATIONS["kramer1993"] == "Erwin Krämer, *Dynamics of Rotors and Foundations*, Springer, 1993."
    assert CITATIONS["shaw1983"] == (
        "S. W. Shaw and P. J. Holmes, *A Periodically Forced Piecewise Linear Oscillator*, "
        "Journal of Sound and Vibration 90(1), 129–155, 1983."
    )


def test_an_effect_that_does_not_exist_has_no_figure(capsys):
    assert main(["warp_drive"]) == 2
    assert "no such effect: warp_drive" in capsys.readouterr().err


def test_the_figure_of_a_fast_sweep_reads_the_rotor_where_it_has_settled():
    """After four seconds exp(-zeta omega t) of the transient is left, less than 1e-4."""
    f = np.array([70.0, 72.0, 84.0])
    settled = np.abs(measured_response(paper_rotor(1), BEARING, (), f, [NODE]))[:, 0]
    np.testing.assert_allclose(stepped_sine(f, 4.0), settled, rtol=1e-4)
