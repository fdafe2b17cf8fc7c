"""``rigtwin demo``: FMUs, virtual tests, three unknown bearings, the paper's numbers, one page."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rigtwin.api.fmus import SHIPPED_RIG, ask, build_rotor, fmu_card
from rigtwin.api.runs import MODE_HEADER, mode_row
from rigtwin.commands.paper import PaperReading, read_paper, table_1, table_2_largest_difference, verdict
from rigtwin.commands.sweep import mode_record
from rigtwin.console import progress, say, table, to_json
from rigtwin.estimator.dataset import noisy
from rigtwin.estimator.features import Features, features_of_runs
from rigtwin.estimator.runtime import Estimate
from rigtwin.fmu_src.build import build_estimator_fmu
from rigtwin.gap.phrases import listed
from rigtwin.pages.figures import Curve, Mark, frequency_figure, frf_figure, readings_figure, rotor_drawing
from rigtwin.pages.page import write_page
from rigtwin.pages.provenance import provenance
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.structure import Structure
from rigtwin.scratch import check_writable, replacing
from rigtwin.sim.campaign import Campaign, Channel, Run
from rigtwin.sim.campaign_folder import save_campaign
from rigtwin.sim.modal_fit import fit_modes
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep
from rigtwin.wording import exponent, interval, percent, stiffness, stiffness_with_error, with_error, yes_no

RECORD = "demo.json"
NOISE = 0.01
NODE = Channel(2)  # the paper's accelerometer
_NOISE = f"{100 * NOISE:g} %"


@dataclass(frozen=True)
class Unknown:
    """A rig whose bearings the estimator is to find."""

    k_b: float  # [N/m]
    shaft_damping_ratio: float
    bearing_damping: float  # [N s/m]


UNKNOWNS = (Unknown(1.3e6, 0.001, 20.0), Unknown(6.2e6, 0.003, 0.0), Unknown(4.7e7, 0.0007, 5.0))


@dataclass(frozen=True)
class Found:
    """One of them, measured and estimated."""

    truth: Unknown
    features: Features
    estimate: Estimate
    frequencies_hz: tuple[float, float]  # on its bearings

    @property
    def error(self) -> float:
        """Relative error of the estimate."""
        return self.estimate.k_b / self.truth.k_b - 1

    @property
    def inside(self) -> bool:
        """Whether the truth lies in the 90 % interval."""
        return self.estimate.k_b_low <= self.truth.k_b <= self.estimate.k_b_high


@dataclass(frozen=True)
class Demo:
    """Everything the demo found."""

    runs: tuple[Run, Run]  # the default rig, rigid and bearing
    found: tuple[Found, ...]
    paper: PaperReading
    fmus: tuple[Path, ...]


def run_demo(out: Path, folder: Path) -> None:
    """Do everything, print the result, write OUT/index.html, OUT/demo.json and OUT/campaign."""
    begin = time.monotonic()
    check_writable(out / RECORD)
    rotor_fmu = build_rotor(load_rig(SHIPPED_RIG), folder)
    estimator_fmu = build_estimator_fmu(folder)
    say(f"built {rotor_fmu} and {estimator_fmu}")
    demo = _measure(rotor_fmu, estimator_fmu)
    save_campaign(Campaign("default rig, virtual", SHIPPED_RIG, demo.runs), out / "campaign")
    with replacing(out / RECORD) as beside:
        beside.write_text(to_json(_record(demo)) + "\n", encoding="utf-8")
    page = write_demo_page(demo, out / "index.html")
    _print(demo)
    say(f"{page} written, {time.monotonic() - begin:.0f} s in all")


def _measure(rotor_fmu: Path, estimator_fmu: Path) -> Demo:
    with FmuSession(rotor_fmu) as rig, FmuSession(estimator_fmu) as network:
        runs = _both_supports(rig, "default rig", {}, seed=0)
        found = tuple(_find(rig, network, truth, seed) for seed, truth in enumerate(UNKNOWNS, start=1))
        paper = read_paper(lambda features: ask(network, features), fmu_card(estimator_fmu))
    return Demo(runs, found, paper, (rotor_fmu, estimator_fmu))


def _both_supports(session: FmuSession, name: str, parameters: dict[str, Any], seed: int) -> tuple[Run, Run]:
    """One rig on rigid supports and on its bearings, with sensor noise."""
    plan = noisy(SweepPlan(), NOISE, seed)
    runs = []
    for support in ("rigid", "bearing"):
        with progress(f"{name}, {support} support", plan.n_lines) as count:
            run = sweep(session, Rig(support, parameters=parameters), plan, count).run
            runs.append(replace(run, name=support))
    return runs[0], runs[1]


def _find(session: FmuSession, network: FmuSession, truth: Unknown, seed: int) -> Found:
    rigid, bearing = _both_supports(session, f"rig {seed}", asdict(truth), seed)
    features = features_of_runs(rigid, bearing)
    first, second = fit_modes(bearing, 2)
    return Found(truth, features, ask(network, features), (first.frequency_hz, second.frequency_hz))


# -- the result in words, for the terminal, for machines, for the page -------------------------------


def _result(demo: Demo) -> str:
    """The result in a sentence or two."""
    worst = max(abs(found.error) for found in demo.found)
    names = listed([f"{found.truth.k_b / 1e6:g}" for found in demo.found])
    estimate, printed = demo.paper.estimate, demo.paper.printed_k_b
    return (
        f"Through the two FMUs, with {_NOISE} sensor noise, bearings of {names} MN/m are found again within "
        f"{100 * worst:.2g} %. The paper's own measured shifts and amplitude ratio give "
        f"{stiffness_with_error(estimate.k_b, estimate.k_b_std)} MN/m; the paper says {printed / 1e6:g} MN/m."
    )


_FOUND_HEADER = (
    "rig", "shaft ζ", "c_b, N s/m", "true k_b, MN/m", "estimated, MN/m", "90 % interval", "error", "inside", "valid",
)  # fmt: skip


def _found_rows(demo: Demo) -> list[tuple[str, ...]]:
    return [
        (
            str(place),
            f"{100 * found.truth.shaft_damping_ratio:g} %",
            f"{found.truth.bearing_damping:g}",
            f"{found.truth.k_b / 1e6:g}",
            stiffness_with_error(found.estimate.k_b, found.estimate.k_b_std),
            interval(found.estimate.k_b_low, found.estimate.k_b_high),
            percent(found.error),
            yes_no(found.inside),
            yes_no(found.estimate.valid),
        )
        for place, found in enumerate(demo.found, start=1)
    ]


def _misses(demo: Demo) -> str:
    """What to say of true values outside their intervals; empty where there are none."""
    outside = [str(place) for place, found in enumerate(demo.found, start=1) if not found.inside]
    if not outside:
        return ""
    return (
        f"The true value of rig {listed(outside)} lies outside its interval: one in ten does by chance, and with "
        "measurements this good the network's own error counts most, of which the interval knows what is usual for "
        "such rigs."
    )


_READING_HEADER = ("from", "k_b, MN/m", "one standard error")


def _reading_rows(paper: PaperReading) -> list[tuple[str, ...]]:
    rows = [(r.source, stiffness(r.k_b), interval(r.low, r.high)) for r in paper.readings]
    return [*rows, ("the paper", f"{paper.printed_k_b / 1e6:g}", "")]


def _print(demo: Demo) -> None:
    table(_FOUND_HEADER, _found_rows(demo), title="Three rigs, their bearings unknown to the estimator")
    if _misses(demo):
        say(_misses(demo) + "\n")
    table(_READING_HEADER, _reading_rows(demo.paper), title="The paper's measured numbers")
    for sentence in verdict(demo.paper):
        say(sentence)
    say()
    say(_result(demo))


def _record(demo: Demo) -> dict[str, Any]:
    structure = assemble(load_rig(SHIPPED_RIG))
    return {
        "schema": "rigtwin.demo/1",
        "result": _result(demo),
        "noise": NOISE,
        "default_rig": {run.support: [mode_record(run, mode) for mode in fit_modes(run)] for run in demo.runs},
        "rigs": [{**asdict(found), "error": found.error} for found in demo.found],
        "paper": demo.paper.record(),
        "verdict": verdict(demo.paper),
        "table_1": [asdict(row) for row in table_1(structure)],
        "table_2_largest_difference": table_2_largest_difference(structure),
        "provenance": provenance(demo.fmus),
    }


def write_demo_page(demo: Demo, path: Path) -> Path:
    rig = load_rig(SHIPPED_RIG)
    structure = assemble(rig)
    paper, (rigid, bearing) = demo.paper, demo.runs
    return write_page(
        "demo.html",
        path,
        result=_result(demo),
        noise=_NOISE,
        rig=rig,
        drawing=rotor_drawing(rig),
        frf=frf_figure([Curve(rigid, "rigid support", NODE), Curve(bearing, "bearings, 10 MN/m", NODE)]),
        mode_header=("support", *MODE_HEADER),
        mode_rows=_mode_rows(demo),
        rig_header=_FOUND_HEADER,
        rig_rows=_found_rows(demo),
        misses=_misses(demo),
        frequencies=frequency_figure(structure, _marks(demo)),
        paper=paper,
        readings=readings_figure(
            [(r.source, r.k_b, r.low, r.high) for r in paper.readings], ("the paper's answer", paper.printed_k_b)
        ),
        verdict=verdict(paper),
        peak_header=("peak", "measured, Hz", "model, Hz", "difference"),
        peak_rows=_peak_rows(paper),
        table_1_header=("k_b, N/m", "f1, paper", "f1, ours", "difference", "f2, paper", "f2, ours", "difference"),
        table_1_rows=_table_1_rows(structure),
        table_2=f"{100 * table_2_largest_difference(structure):.1f} %",
        provenance=provenance(demo.fmus),
    )


def _mode_rows(demo: Demo) -> list[tuple[str, ...]]:
    return [
        (run.support, str(place), *mode_row(run, mode))
        for run in demo.runs
        for place, mode in enumerate(fit_modes(run), start=1)
    ]


def _marks(demo: Demo) -> dict[str, list[Mark]]:
    """Measured resonances at the stiffness they give."""
    paper = demo.paper
    on_bearings = (paper.peaks[2].measured, paper.peaks[3].measured)
    return {
        "the three rigs, measured": [Mark(f.estimate.k_b, f.estimate.k_b_std, f.frequencies_hz) for f in demo.found],
        "the paper's rig": [Mark(paper.estimate.k_b, paper.estimate.k_b_std, on_bearings)],
    }


def _peak_rows(paper: PaperReading) -> list[tuple[str, ...]]:
    return [(p.name, with_error(p.measured, p.std), f"{p.model:.2f}", percent(p.difference)) for p in paper.peaks]


def _table_1_rows(structure: Structure) -> list[tuple[str, ...]]:
    return [
        (exponent(row.k_b), *_compared(row.printed[0], row.ours[0]), *_compared(row.printed[1], row.ours[1]))
        for row in table_1(structure)
    ]


def _compared(printed: float, ours: float) -> tuple[str, str, str]:
    return f"{printed:g}", f"{ours:.3f}", percent(ours / printed - 1)
