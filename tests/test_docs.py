"""What the documentation says of names and units is what the code has."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from estimator.runtime import StiffnessEstimator
from fmu_src.documentation import _rows
from fmu_src.estimator_variables import estimator_variables
from fmu_src.rotor_variables import RotorFacts, rotor_variables
from fmu_src.variables import Variable
from rotor.rig import Disk, Mass, Rig, Segment, SupportTable

ROOT = Path(__file__).resolve().parent.parent
CONTRACTS = (ROOT / "docs" / "contracts.md").read_text(encoding="utf-8")
SHIPPED = RotorFacts(7, 2, 0.001, 0.0, 1e7, 1e4, 1e12, 0.426)


def _table_row(variable: Variable) -> str:
    row = _rows([variable])[0]
    columns = ("causality", "variability", "type", "unit", "range", "description")
    return "| " + " | ".join([f"`{row['name']}`", *(row[column] for column in columns)]) + " |"


@pytest.mark.parametrize(
    "variable",
    [v for v in rotor_variables(SHIPPED) if not v.name.startswith("node_")]
    + list(estimator_variables(StiffnessEstimator().card["example_inputs"])),
    ids=lambda v: v.name,
)
def test_every_fmu_variable_stands_in_the_contracts_as_it_is(variable):
    assert _table_row(variable) in CONTRACTS


@pytest.mark.parametrize("table", [Rig, Segment, Disk, Mass, SupportTable])
def test_every_key_of_a_rig_file_is_documented(table):
    section = CONTRACTS.split("## Rig files")[1].split("## Measured data")[0]
    for key in table.model_fields:
        assert f"`{key}" in section or f"[{key}]" in section, key


def test_links_between_the_pages_lead_somewhere():
    for page in [ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
            if not target.startswith("http"):
                assert (page.parent / target).exists(), f"{page.name} links to {target}"
