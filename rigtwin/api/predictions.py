"""A diagnosis applied to runs that it never saw, and how far it comes from what was measured there."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from rigtwin.api.diagnoses import read_diagnosis
from rigtwin.api.rigs import load_rig, refuse_tables
from rigtwin.errors import UserError, for_users
from rigtwin.gap.curves import nrmse
from rigtwin.gap.document import Diagnosis
from rigtwin.pages.diagnosis_words import share
from rigtwin.pages.figures import BLUE, INK, VERMILION
from rigtwin.pages.overlay_page import Layer, Overlay, Table, write_overlays
from rigtwin.rotor.model import html
from rigtwin.rotor.model.condition import Condition
from rigtwin.scratch import replacing
from rigtwin.sim.campaign import Campaign, Run
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats.run_file import write_beside
from rigtwin.wording import counted

PREDICTION_HEADER = ("run", "gap, nominal model", "gap, corrected model", "noise alone")
PAGE_FILE = "prediction.html"


@dataclass(frozen=True)
class PredictedRun:
    """A measured run beside what both models predict for its lines and channels."""

    file: str  # below nominal/ and corrected/
    measured: Run
    nominal: Run  # the recalibrated nominal model
    corrected: Run  # with the effect that the diagnosis names

    @property
    def gap_nominal(self) -> float:
        """Root of the squared difference over the squared response, averaged over the channels (``nrmse``)."""
        return nrmse(self.measured.H, self.measured.as_recorded(self.nominal.H))

    @property
    def gap_corrected(self) -> float:
        """The same of the corrected model."""
        return nrmse(self.measured.H, self.measured.as_recorded(self.corrected.H))

    @property
    def floor(self) -> float:
        """What the standard errors of the run alone give; nan where it has none."""
        run = self.measured
        return float("nan") if run.std is None else nrmse(run.H, run.H + run.std)


@dataclass(frozen=True)
class Prediction:
    """Every run of a campaign as a diagnosis predicts it."""

    campaign: Campaign
    runs: tuple[PredictedRun, ...]
    remarks: tuple[str, ...] = ()  # what has to be known of it, in sentences

    def rows(self) -> list[tuple[str, ...]]:
        """For a reader, beneath PREDICTION_HEADER."""
        return [
            (each.measured.name, *(_share(gap) for gap in (each.gap_nominal, each.gap_corrected, each.floor)))
            for each in self.runs
        ]

    def record(self) -> dict[str, Any]:
        """For a machine."""
        return {
            "runs": [
                {
                    "run": each.measured.name,
                    "file": each.file,
                    "gap_nominal": each.gap_nominal,
                    "gap_corrected": each.gap_corrected,
                    "floor": each.floor,
                }
                for each in self.runs
            ],
            "remarks": list(self.remarks),
        }

    def save(self, folder: str | Path) -> Path:
        """Write nominal/, corrected/ and the page that compares them; returns the page. Raises UserError."""
        return _save(self, Path(folder), with_page=True)

    def save_runs(self, folder: str | Path) -> None:
        """Write nominal/ and corrected/ alone. Raises UserError."""
        _save(self, Path(folder), with_page=False)

    def _repr_html_(self) -> str:
        return html.table(PREDICTION_HEADER, self.rows()) + "".join(map(html.paragraph, self.remarks))


def _share(gap: float) -> str:
    return share(gap) if gap == gap else ""


@for_users
def predict(diagnosis: Diagnosis | str | Path, campaign: Campaign | str | Path) -> Prediction:
    """What the nominal and the corrected model of a diagnosis predict for the runs of another campaign.

    Parameters
    ----------
    diagnosis : ``Diagnosed.diagnosis``, or the path of a diagnosis.json
    campaign : of the same rig, as it was loaded, or its folder

    Raises
    ------
    UserError : a file cannot be used, the campaign has no run, or the diagnosis does not go with its rotor

    >>> import rigtwin
    >>> rigtwin.predict("missing.json", "campaign")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: missing.json: no such file; check its name and folder
    """
    from rigtwin.gap.predict import predict as predict_runs

    name = "the diagnosis" if isinstance(diagnosis, Diagnosis) else str(diagnosis)
    if not isinstance(diagnosis, Diagnosis):
        diagnosis = read_diagnosis(Path(diagnosis))
    where = campaign.title if isinstance(campaign, Campaign) else str(campaign)
    if not isinstance(campaign, Campaign):
        campaign = load_campaign(campaign)
    refuse_tables(load_rig(campaign.rig), "a prediction")
    if not campaign.runs:
        raise UserError(f"{where}: the campaign has no run, only resonance lists; there are no lines to predict")
    files = _files(campaign, where)
    runs = [
        PredictedRun(file, measured, each.nominal, each.corrected)
        for file, measured, each in zip(files, campaign.runs, predict_runs(diagnosis, campaign), strict=True)
    ]
    return Prediction(campaign, tuple(runs), tuple(_remarks(diagnosis, campaign, name, where)))


def _remarks(diagnosis: Diagnosis, campaign: Campaign, name: str, where: str) -> list[str]:
    said = []
    if diagnosis.rig != Path(campaign.rig).name:
        said.append(f"{name} is of the rig {diagnosis.rig}, {where} of {campaign.rig}; the campaign's is predicted")
    if diagnosis.nominal.get("k_b") is None and any(run.support == "bearing" for run in campaign.runs):
        said.append(
            f"{name} does not say k_b: the runs on bearings are predicted with the default, {Condition.k_b:g} N/m"
        )
    if diagnosis.correction:
        node = diagnosis.correction.node
        said.append(f"the cause is unknown: the corrected model is a best effort by the law fitted at node {node}")
    elif not diagnosis.names_a_cause:
        said.append(f"{name} names no cause: the corrected model is the nominal model too")
    return said


def _files(campaign: Campaign, where: str) -> list[str]:
    """One CSV below the output folder for each run, named after it. Raises UserError where two would be one."""
    files = [_file_of(run) for run in campaign.runs]
    twice = {file for file in files if files.count(file) > 1}
    if twice:
        raise UserError(f"{where}: two runs would be written to {', '.join(sorted(twice))}; rename their data files")
    return files


def _file_of(run: Run) -> str:
    """'run01.csv'; a run from another folder stays inside the output folder."""
    parts = [part for part in PurePosixPath(run.name).parts if part not in ("/", "..", ".")]
    return "/".join(parts or ["run"]) + ".csv"


@for_users
def _save(found: Prediction, folder: Path, *, with_page: bool) -> Path:
    """Write all files under free names, then rename them: all or none."""

    with ExitStack() as stack:
        for each in found.runs:
            for kind, run in (("nominal", each.nominal), ("corrected", each.corrected)):
                path = folder / kind / each.file
                path.parent.mkdir(parents=True, exist_ok=True)
                write_beside(run, path, stack.enter_context(replacing(path)))
        if with_page:
            _write_page(found, folder / PAGE_FILE)
    return folder / PAGE_FILE


def _write_page(found: Prediction, path: Path) -> Path:
    mean = {kind: sum(getattr(each, f"gap_{kind}") for each in found.runs) / len(found.runs) for kind in _STYLES}
    gaps = Table(
        "Gaps",
        PREDICTION_HEADER,
        found.rows(),
        "The gap is the root of the squared difference between measurement and model, divided by the measurement and "
        "averaged over the channels. Noise alone is what the standard errors of the run give.",
    )
    return write_overlays(
        path,
        found.campaign.title or "Prediction",
        f"{counted(len(found.runs), 'run')} that the diagnosis never saw: the gap is {share(mean['nominal'])} with the "
        f"nominal model and {share(mean['corrected'])} with the corrected one.",
        found.remarks,
        [gaps],
        [_overlay(each) for each in found.runs],
    )


# How the models are drawn over the points that were measured.
_STYLES: dict[str, dict[str, object]] = {
    "nominal": {"line": {"color": VERMILION, "width": 2, "dash": "dash"}},
    "corrected": {"line": {"color": BLUE, "width": 2}},
}
_POINTS = {"mode": "markers", "marker": {"color": INK, "size": 5}}


def _overlay(each: PredictedRun) -> Overlay:
    layers = [
        Layer(each.measured, "measured", _POINTS),
        Layer(each.nominal, "nominal, recalibrated", _STYLES["nominal"]),
        Layer(each.corrected, "corrected", _STYLES["corrected"]),
    ]
    return Overlay(
        each.measured.name,
        layers,
        f"On {each.measured.support} support, force at node {each.measured.excitation_node}.",
    )
