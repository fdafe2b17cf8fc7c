"""A gate of ``rigtwin check``, and all of them as a JUnit report, which CI systems show."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from rigtwin.scratch import replacing

# XML 1.0 has no place for these, however they are escaped.
_NOT_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

Outcome = Literal["passed", "failed", "not run"]

_TAG = {"failed": "failure", "not run": "skipped"}


@dataclass(frozen=True)
class Gate:
    """One gate and what came out."""

    name: str
    outcome: Outcome
    message: str
    seconds: float


def write_junit(fmu: Path, gates: Sequence[Gate], path: Path) -> None:
    """Write one test case for each gate."""
    outcomes = [gate.outcome for gate in gates]
    suite = Element(
        "testsuite",
        name=f"rigtwin check {_text(fmu.name)}",
        tests=str(len(gates)),
        failures=str(outcomes.count("failed")),
        errors="0",
        skipped=str(outcomes.count("not run")),
        time=f"{sum(gate.seconds for gate in gates):.3f}",
    )
    for gate in gates:
        case = SubElement(
            suite, "testcase", classname=f"rigtwin.check.{_text(fmu.stem)}", name=gate.name, time=f"{gate.seconds:.3f}"
        )
        if gate.outcome in _TAG:
            SubElement(case, _TAG[gate.outcome], message=_text(gate.message)).text = _text(gate.message)
        else:
            SubElement(case, "system-out").text = _text(gate.message)
    root = Element("testsuites")
    root.append(suite)
    indent(root)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as beside:
        ElementTree(root).write(beside, encoding="utf-8", xml_declaration=True)


def _text(message: str) -> str:
    return _NOT_XML.sub("?", message)
