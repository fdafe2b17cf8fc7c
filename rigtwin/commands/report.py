"""``rigtwin report``: one page of measured runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.commands.estimate import ANSWER_HEADER, Answer, answer_row, answers_of_runs
from rigtwin.commands.fmus import SHIPPED_RIG, existing
from rigtwin.commands.sweep import MODE_HEADER, mode_row
from rigtwin.console import say
from rigtwin.exits import UserError
from rigtwin.pages.figures import Curve, frf_figure, rotor_picture
from rigtwin.pages.page import write_page
from rigtwin.pages.provenance import provenance
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.campaign import Campaign, Channel, MeasurementError, Run
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats import read_run
from rigtwin.sim.formats.atomic import check_writable
from rigtwin.sim.formats.settings import UnknownSupportError
from rigtwin.sim.modal_fit import fit_modes
from rigtwin.wording import interval, stiffness_with_error, with_error


@dataclass(frozen=True)
class Sources:
    """What was given on the command line."""

    paths: tuple[Path, ...]  # a campaign folder, or runs that say their support themselves
    rigid: tuple[Path, ...]
    bearing: tuple[Path, ...]


def write_report(sources: Sources, out: Path, estimator: Path | None, *, trust: bool = False) -> None:
    """Read, fit, estimate, write the page."""
    check_writable(out)
    campaign = _read(sources)
    rig = load_rig(campaign.rig)
    for run in campaign.runs:
        run.check_nodes(len(rig.nodes_m))
    modes, unfitted = _modes(campaign.runs)
    answers, why_none = _estimate(campaign, estimator, trust)
    write_page(
        "report.html",
        out,
        title=campaign.title or "Measured runs",
        result=_result(campaign, answers, why_none),
        rig=rig,
        picture=rotor_picture(rig),
        frf=frf_figure([_curve(run) for run in campaign.runs]) if campaign.runs else None,
        notes=_notes(campaign.runs),
        mode_header=("run", "support", *MODE_HEADER),
        mode_rows=modes,
        unfitted=unfitted,
        answer_header=ANSWER_HEADER,
        answer_rows=[answer_row(answer) for answer in answers],
        objections=[f"{answer.test}: not valid: {text}" for answer in answers for text in answer.objections],
        why_none=why_none,
        peak_header=("support", "peaks, Hz"),
        peak_rows=[(p.support, ", ".join(map(with_error, p.frequencies_hz, p.std_hz))) for p in campaign.peaks],
        provenance=provenance([estimator] if estimator and estimator.suffix.lower() == ".fmu" else []),
    )
    say(f"{out} written: {_result(campaign, answers, why_none)}")


def _read(sources: Sources) -> Campaign:
    """The campaign folder, or the runs as a campaign of the shipped rig. Raises UserError."""
    told = [(path, {"support": support}) for support in ("rigid", "bearing") for path in getattr(sources, support)]
    folders = [path for path in sources.paths if path.is_dir()]
    if folders:
        if len(sources.paths) > 1 or told:
            raise UserError(f"{folders[0]}: a campaign folder is reported alone; leave the other files out")
        return load_campaign(folders[0])
    files: list[tuple[Path, Any]] = [*((path, {}) for path in sources.paths), *told]
    if not files:
        raise UserError("nothing to report: give a campaign folder, or run files")
    return Campaign("", SHIPPED_RIG, tuple(_read_run(path, settings) for path, settings in files))


def _read_run(path: Path, settings: dict[str, Any]) -> Run:
    try:
        return read_run(existing(path), **settings)
    except UnknownSupportError as error:
        raise UserError(f"{path}: does not say its support; give it with --rigid or --bearing") from error


def _modes(runs: Sequence[Run]) -> tuple[list[tuple[str, ...]], list[str]]:
    """Rows of all fitted modes, and a sentence for each run without any."""
    rows, unfitted = [], []
    for run in runs:
        try:
            rows += [(run.name, run.support, str(n), *mode_row(run, mode)) for n, mode in enumerate(fit_modes(run), 1)]
        except MeasurementError as error:
            unfitted.append(str(error))
    return rows, unfitted


def _estimate(campaign: Campaign, estimator: Path | None, trust: bool) -> tuple[list[Answer], str]:
    """Answers, or none and the reason."""
    if {run.support for run in campaign.runs} != {"rigid", "bearing"}:
        return [], "an estimate needs a run on rigid supports and one on bearings"
    try:
        return answers_of_runs(campaign.runs, campaign.rig, estimator, trust=trust), ""
    except MeasurementError as error:
        return [], str(error)
    except UserError as error:
        if estimator:
            raise
        return [], str(error)


def _result(campaign: Campaign, answers: Sequence[Answer], why_none: str) -> str:
    if not answers:
        return f"{_counted(campaign)}; no stiffness: {why_none}."
    valid = [answer.estimate for answer in answers if answer.estimate.valid]
    if not valid:
        return f"{_counted(campaign)}; the estimated stiffness is not valid: {answers[0].objections[0]}."
    best = min(valid, key=lambda estimate: estimate.k_b_std / estimate.k_b)
    return (
        f"k_b = {stiffness_with_error(best.k_b, best.k_b_std)} MN/m, "
        f"90 % interval {interval(best.k_b_low, best.k_b_high)} MN/m."
    )


def _counted(campaign: Campaign) -> str:
    """What was measured, in words."""
    counts = ((len(campaign.runs), "run"), (len(campaign.peaks), "resonance list"))
    return ", ".join(f"{n} {what}{'s' * (n != 1)}" for n, what in counts if n)


def _curve(run: Run) -> Curve:
    """The driving point where it was measured, else the channel with the largest response."""
    point = Channel(run.excitation_node, run.excitation_plane)
    channel = point if point in run.channels else run.channels[int(np.argmax(np.abs(run.H).max(axis=0)))]
    place = f"node {channel.node}{channel.label} {channel.plane}"
    # Plotly reads labels as HTML.
    return Curve(run, escape(f"{run.name}: {run.support} support, {place}", quote=False), channel)


def _notes(runs: Sequence[Run]) -> list[str]:
    """What a reader has to know of the runs."""
    notes = []
    if any(run.magnitude_only for run in runs):
        notes.append("Runs of magnitudes only have no phase, and so no modal fit.")
    without = [run.name for run in runs if run.std is None]
    if without:
        notes.append(f"Without standard errors of their own, estimated from the fit: {', '.join(without)}.")
    spinning = [f"{run.name} ({run.spin_rpm:g} rpm)" for run in runs if run.spin_rpm]
    if spinning:
        notes.append(f"Spinning, and not used for k_b: {', '.join(spinning)}.")
    return notes
