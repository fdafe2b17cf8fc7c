"""``rigtwin check``: the gates an FMU has to pass before it is released."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from rigtwin.api.checks import Checked, check_fmu
from rigtwin.console import output, print_json, say
from rigtwin.scratch import check_writable


def run_check(
    fmu: Path,
    *,
    expect_k_b: float | None,
    tolerance: float,
    estimator: Path | None,
    junit: Path | None,
    time_limit: float,
    as_json: bool,
) -> bool:
    """Run the gates, print them, write the report; returns whether no gate failed."""
    if junit:
        check_writable(junit)
    checked = check_fmu(fmu, expect_k_b=expect_k_b, tolerance=tolerance, estimator=estimator, time_limit_s=time_limit)
    if junit:
        checked.save_junit(junit)
    if as_json:
        gates = [asdict(gate) for gate in checked.gates]
        print_json({"fmu": str(fmu), "passed": checked.passed, "gates": gates})
    else:
        _print(checked)
    return checked.passed


def _print(checked: Checked) -> None:
    """One line for each gate."""
    colour = {"passed": "green", "failed": "bold red", "not run": "yellow"}
    for gate in checked.gates:
        console = output()
        console.print(f"{gate.outcome:>8}", style=colour[gate.outcome], end="  ")
        console.print(f"{gate.name}: {gate.message}", soft_wrap=True)
    failed = sum(gate.outcome == "failed" for gate in checked.gates)
    verdict = f"{failed} of {len(checked.gates)} gates failed" if failed else "no gate failed"
    say(f"{checked.fmu}: {verdict}")
