"""What the documentation says of names and units is what the code has."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmarks import thresholds
from rigtwin.blind.judge.page import page
from rigtwin.blind.judge.results import from_row
from rigtwin.estimator.runtime import StiffnessEstimator
from rigtwin.fmu_src.documentation import _rows
from rigtwin.fmu_src.estimator_variables import estimator_variables
from rigtwin.fmu_src.machine_variables import MachineFacts, bearing_variables, supervisor_variables
from rigtwin.fmu_src.monitor_variables import monitor_variables
from rigtwin.fmu_src.rotor_variables import RotorFacts, rotor_variables
from rigtwin.fmu_src.tracker_variables import TrackerFacts, tracker_variables
from rigtwin.fmu_src.variables import Variable
from rigtwin.rotor.geometry.rig import Disk, Joint, Mass, Rig, Segment, SpeedCoefficients, SupportTable

ROOT = Path(__file__).resolve().parent.parent
CONTRACTS = (ROOT / "docs" / "contracts.md").read_text(encoding="utf-8")
LISTENS = TrackerFacts((2,), 7, 2, 1e7, 1e4, 1e10, 1.0, 1e-3, 1e-4)
MACHINE = MachineFacts(1e7, 1e4, 1e10, 0.01, 567.0, 2250.0, 5e-5, 1.6, 1e-4)
SHIPPED = RotorFacts(7, 2, 0.001, 0.0, 1e7, 1e4, 1e12, 0.426)


def _table_row(variable: Variable) -> str:
    row = _rows([variable])[0]
    columns = ("causality", "variability", "type", "unit", "range", "description")
    return "| " + " | ".join([f"`{row['name']}`", *(row[column] for column in columns)]) + " |"


@pytest.mark.parametrize(
    "variable",
    [v for v in rotor_variables(SHIPPED) if not v.name.startswith("node_")]
    + list(estimator_variables(StiffnessEstimator().card["example_inputs"]))
    + [v for table in (bearing_variables, supervisor_variables) for v in table(MACHINE)]
    + [v for table in (tracker_variables, monitor_variables) for v in table(LISTENS) if not v.name.startswith("node_")],
    ids=lambda v: v.name,
)
def test_every_fmu_variable_stands_in_the_contracts_as_it_is(variable):
    assert _table_row(variable) in CONTRACTS


@pytest.mark.parametrize("table", [Rig, Segment, Disk, Joint, Mass, SupportTable, SpeedCoefficients])
def test_every_key_of_a_rig_file_is_documented(table):
    section = CONTRACTS.split("## Rig files")[1].split("## Measured data")[0]
    for key in table.model_fields:
        assert f"`{key}" in section or f"[{key}]" in section, key


ROOMS = ("docs", "examples", "benchmarks")
PAGES = [*ROOT.glob("*.md"), *(file for room in ROOMS for file in (ROOT / room).rglob("*.md"))]


def anchors(page: Path) -> set[str]:
    """What links into a page may name: its headings, as GitHub spells them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_between_the_pages_lead_somewhere():
    links = [
        (source, *link.partition("#")[::2])
        for source in PAGES
        for link in re.findall(r"\]\(([^)\s]+)\)", source.read_text(encoding="utf-8"))
        if not link.startswith("http")
    ]
    assert len(links) > 50
    for source, file, anchor in links:
        target = source.parent / file if file else source
        assert target.exists(), f"{source.name} links to {file}"
        assert not anchor or anchor in anchors(target), f"{source.name} links to {file}#{anchor}"


def test_every_page_stands_in_the_contents_of_the_site():
    contents = re.findall(
        r"^```\{toctree\}\n(?::[^\n]*\n)*\n(.*?)^```", (ROOT / "docs" / "index.md").read_text("utf-8"), re.M | re.S
    )
    listed = {name.strip() for block in contents for name in block.splitlines() if "/" not in name}
    assert listed == {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"}


@pytest.mark.parametrize("name", ["blind", "real-rigs"])
def test_the_page_of_the_blind_benchmark_is_the_one_of_its_results(name):
    results = json.loads((ROOT / "docs" / f"{name}.json").read_text(encoding="utf-8"))
    made = page([from_row(row) for row in results["campaigns"]], results["facts"])
    assert made == (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def test_the_page_of_thresholds_is_printed_from_them():
    assert thresholds.PAGE.read_text(encoding="utf-8") == thresholds.page()
