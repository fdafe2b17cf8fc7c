"""One page of measured runs: responses, fitted modes, and k_b where both supports are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.api.estimates import ANSWER_HEADER, Answer, answers_of_runs
from rigtwin.api.fmus import SHIPPED_RIG
from rigtwin.api.rigs import as_rig
from rigtwin.api.runs import MODE_HEADER, mode_row
from rigtwin.errors import UserError, existing, for_users
from rigtwin.pages.figures import Curve, frf_figure, rotor_drawing
from rigtwin.pages.page import write_page
from rigtwin.pages.provenance import provenance
from rigtwin.rotor.model import html
from rigtwin.scratch import check_writable
from rigtwin.sim.campaign import Campaign, Channel, MeasurementError, Run
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats import read_run
from rigtwin.sim.formats.settings import UnknownSupportError
from rigtwin.sim.modal_fit import try_modes
from rigtwin.wording import counted, interval, stiffness_with_error, with_error


@dataclass(frozen=True)
class Reported:
    """The page that was written, and its result in a sentence."""

    page: Path
    result: str

    def _repr_html_(self) -> str:
        return html.paragraph(f"{self.page}: {self.result}")


@for_users
def report(
    *sources: Campaign | Run | str | Path,
    out: str | Path = "page.html",
    rig: str | Path | None = None,
    rigid: Sequence[str | Path] = (),
    bearing: Sequence[str | Path] = (),
    estimator: str | Path | None = None,
    trust: bool = False,
) -> Reported:
    """Write one HTML page of measured runs: the rotor, responses, fitted modes, and k_b where both supports are there.

    Parameters
    ----------
    sources : a campaign, or runs that say their support themselves; as they were loaded, or their folder or files
    out : the page
    rig : file or name of the rig of the runs; default the shipped one, and of a campaign its own
    rigid, bearing : files of runs on that support, which do not say it themselves
    estimator : StiffnessEstimator.fmu or ONNX file; default the shipped network, or the model of another rig
    trust : whether an FMU may run that this installation has not built; it runs with all your rights

    Raises
    ------
    UserError : nothing is given, a file cannot be used, or a run does not go with the rig

    >>> import rigtwin
    >>> rigtwin.report()
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: nothing to report: give a campaign folder, or run files
    """
    page, chosen = Path(out), Path(estimator) if estimator else None
    check_writable(page)
    files = [(Path(path), support) for support, paths in (("rigid", rigid), ("bearing", bearing)) for path in paths]
    campaign = _read(sources, files, rig)
    return Reported(page, _write(campaign, page, chosen, trust))


def _write(campaign: Campaign, out: Path, estimator: Path | None, trust: bool) -> str:
    """Fit, estimate, write the page; returns its result in a sentence."""
    rig = as_rig(campaign.rig)
    campaign.check_nodes(len(rig.nodes_m))
    modes, unfitted = _modes(campaign.runs)
    answers, why_none = _estimate(campaign, estimator, trust)
    write_page(
        "report.html",
        out,
        title=campaign.title or "Measured runs",
        result=_result(campaign, answers, why_none),
        rig=rig,
        drawing=rotor_drawing(rig),
        frf=frf_figure([_curve(run) for run in campaign.runs]) if campaign.runs else None,
        notes=_notes(campaign.runs),
        mode_header=("run", "support", *MODE_HEADER),
        mode_rows=modes,
        unfitted=unfitted,
        answer_header=ANSWER_HEADER,
        answer_rows=[answer.row() for answer in answers],
        objections=[f"{answer.test}: not valid: {text}" for answer in answers for text in answer.objections],
        why_none=why_none,
        peak_header=("support", "peaks, Hz"),
        peak_rows=[(p.support, ", ".join(map(with_error, p.frequencies_hz, p.std_hz))) for p in campaign.peaks],
        provenance=provenance([estimator] if estimator and estimator.suffix.lower() == ".fmu" else []),
    )
    return _result(campaign, answers, why_none)


def _read(
    sources: Sequence[Campaign | Run | str | Path], told: Sequence[tuple[Path, Any]], rig: str | Path | None
) -> Campaign:
    """The campaign, or the runs as a campaign of the rig. Raises UserError."""
    whole = [s for s in sources if isinstance(s, Campaign) or (not isinstance(s, Run) and Path(s).is_dir())]
    if whole:
        name = whole[0].title if isinstance(whole[0], Campaign) else whole[0]
        if len(sources) > 1 or told:
            raise UserError(f"{name}: a campaign folder is reported alone; leave the other files out")
        if rig is not None:
            raise UserError(f"--rig {rig}: the campaign {name} says its rig; change its campaign.toml")
        return whole[0] if isinstance(whole[0], Campaign) else load_campaign(whole[0])
    if not sources and not told:
        raise UserError("nothing to report: give a campaign folder, or run files")
    node = as_rig(rig or SHIPPED_RIG).excitation_node
    runs = [s if isinstance(s, Run) else _read_run(Path(s), node, {}) for s in sources if not isinstance(s, Campaign)]
    runs += [_read_run(path, node, {"support": support}) for path, support in told]
    return Campaign("", SHIPPED_RIG if rig is None else str(rig), tuple(runs))


def _read_run(path: Path, node: int, settings: dict[str, Any]) -> Run:
    try:
        return read_run(existing(path), node, **settings)
    except UnknownSupportError as error:
        raise UserError(f"{path}: does not say its support; give it with --rigid or --bearing") from error


def _modes(runs: Sequence[Run]) -> tuple[list[tuple[str, ...]], list[str]]:
    """Rows of all fitted modes, and a sentence on each resonance that was not fitted, or each run without any."""
    rows, unfitted = [], []
    for run in runs:
        try:
            modes, left_out = try_modes(run)
        except MeasurementError as error:
            unfitted.append(str(error))
            continue
        rows += [(run.name, run.support, str(n), *mode_row(run, mode)) for n, mode in enumerate(modes, 1)]
        unfitted += left_out
    return rows, unfitted


def _estimate(campaign: Campaign, estimator: Path | None, trust: bool) -> tuple[list[Answer], str]:
    """Answers, or none and the reason."""
    if {run.support for run in campaign.runs} != {"rigid", "bearing"}:
        return [], "an estimate needs a run on rigid supports and one on bearings"
    try:
        return list(answers_of_runs(campaign.runs, campaign.rig, estimator, trust=trust)), ""
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
    return ", ".join(counted(n, what) for n, what in counts if n)


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
