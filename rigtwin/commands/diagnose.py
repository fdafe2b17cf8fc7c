"""``rigtwin diagnose`` and ``rigtwin predict``: where the gap lies, what causes it, what the model then says."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

from rigtwin.commands.effects import effect_of
from rigtwin.commands.fmus import existing, rotor_fmu
from rigtwin.console import note, say, table
from rigtwin.exits import UserError
from rigtwin.gap.document import FILE_NAME as DIAGNOSIS_FILE
from rigtwin.gap.document import Cause, Diagnosis, DocumentError, Shrink
from rigtwin.gap.phrases import part
from rigtwin.pages.diagnosis_page import FILE_NAME as PAGE_FILE
from rigtwin.pages.diagnosis_page import write_diagnosis_page
from rigtwin.pages.diagnosis_words import (
    NO_CAUSE,
    at_edge,
    cause_title,
    explained,
    finite,
    k_b_words,
    named,
    parameters,
    places,
    share,
)
from rigtwin.rotor.effects import Effect
from rigtwin.rotor.frequency.measured import DERIVATIVE_ORDER
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import ComplexArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.scale_out import executor
from rigtwin.sim.campaign import Campaign, Run
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.sim.formats.atomic import check_writable, replacing
from rigtwin.sim.formats.run_file import write_beside
from rigtwin.sim.session import FmuSession
from rigtwin.sim.setup import SetupError
from rigtwin.sim.stepped_sine import Rig, SweepPlan, measure_lines

# Candidates that are printed; the page and the JSON hold all.
_CAUSES = 5

_VERIFIED = {"fmu": "verified by the FMU", "rig": "verified on the virtual rig", "model": "by the fitting model alone"}


@dataclass(frozen=True)
class DiagnosisRequest:
    """What was asked for on the command line."""

    campaign: Path
    out: Path
    exclude: tuple[str, ...]  # effect ids
    fmu: bool  # whether the FMU of the rig is built and asked
    as_json: bool
    workers: int | None = None  # processes, this one among them; default one for each core


def run_diagnose(request: DiagnosisRequest) -> None:
    """Diagnose a campaign, write diagnosis.json and the page, print what was found."""
    from rigtwin.gap.diagnose import diagnose

    exclude = _known(request.exclude)
    campaign = load_campaign(request.campaign)
    page = request.out / PAGE_FILE
    with _folder(request.out):  # what cannot be written is refused before the work
        with _progress() as progress:
            confirm = partial(_confirmed_if_possible, campaign, progress=progress) if request.fmu else None
            with shared_among(request.workers if campaign.runs else 1) as helpers:  # peaks need no fits
                outcome = diagnose(campaign, exclude=exclude, progress=progress, confirm=confirm, helpers=helpers)
        with replacing(request.out / DIAGNOSIS_FILE) as document:  # both files are new, or neither
            document.write_text(outcome.diagnosis.to_json(), encoding="utf-8")
            write_diagnosis_page(outcome.diagnosis, outcome.curves, campaign, page)
    if request.as_json:
        print(outcome.diagnosis.to_json(), end="")
    else:
        _print(outcome.diagnosis, page)


@contextmanager
def shared_among(workers: int | None) -> Iterator[Executor | None]:
    """Helpers for ``diagnose``: all processes but this one; they load what they need while the audit goes on."""
    others = (workers or os.cpu_count() or 1) - 1
    if others < 1:
        yield None
        return
    with executor(workers=others) as pool:
        for _ in range(others):
            pool.submit(_load)
        yield pool


def _load() -> None:
    import rigtwin.gap.search.linear  # noqa: F401


def _known(effect_ids: Sequence[str]) -> tuple[str, ...]:
    """The effects to leave out, each once. Raises UserError where there is no such effect."""
    try:
        return tuple(dict.fromkeys(effect_of(effect_id).id for effect_id in effect_ids))
    except UserError as error:
        raise UserError(f"--exclude: {error}") from None


@contextmanager
def _folder(path: Path) -> Iterator[None]:
    """A folder to write into; one that was made for it is taken away again where nothing comes of it."""
    new = not path.exists()
    check_writable(path / DIAGNOSIS_FILE)
    path.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        if new and not any(path.iterdir()):
            path.rmdir()
        raise


# Called with (done, total, words).
Progress = Callable[[int, int, str], None]


@contextmanager
def _progress() -> Iterator[Progress]:
    """A progress bar that says what is going on; nothing is drawn where stderr is not a terminal."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn()
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("diagnosis", total=None)
        yield lambda done, total, words: bar.update(task, completed=done, total=total, description=words)


# -- the virtual rig -----------------------------------------------------------------------------------


def _confirmed_if_possible(
    campaign: Campaign, runs: Sequence[Run], effects: Sequence[Effect], k_b: float, progress: Progress
) -> tuple[list[ComplexArray], str]:
    """What the virtual rig measures; nothing where it fails or is interrupted, as the diagnosis itself is finished."""
    try:
        return measured_on_the_virtual_rig(campaign, runs, effects, k_b, progress)
    except KeyboardInterrupt:
        reason = "was interrupted"
    except (RuntimeError, SetupError, UserError, OSError) as error:
        reason = f"does not confirm the cause ({error})"
    note(f"the virtual rig {reason}: the after-figure is the fitting model's own")
    return [], "model"


def measured_on_the_virtual_rig(
    campaign: Campaign, runs: Sequence[Run], effects: Sequence[Effect], k_b: float, progress: Progress | None = None
) -> tuple[list[ComplexArray], str]:
    """Each run measured again without noise, with the effects, on an FMU of the rig with the diagnosis' mesh.

    Parameters
    ----------
    campaign : says the rig, and the damping that the nominal model believes in
    runs : their lines, channels and settings
    effects : those of the rotor are switched on in the FMU, those of the measurement chain act in the sweep
    k_b : stiffness of the bearings [N/m]
    progress : told which run is being measured

    Returns
    -------
    (n_freq, n_channels) of each run, and "fmu", or "rig" where an effect is none of the FMU's
    """
    from rigtwin.gap.model.campaign_model import believed, elements_between_nodes

    rig = load_rig(campaign.rig)
    belief = believed(campaign.nominal, rig)
    parameters = {
        "k_b": k_b,
        "bearing_damping": belief.bearing_damping_Ns_per_m,
        "shaft_damping_ratio": belief.shaft_damping_ratio,
    }
    tell = progress or (lambda *_: None)
    tell(0, len(runs), "virtual rig: building the FMU")
    measured = []
    mesh = elements_between_nodes(rig)
    with rotor_fmu(campaign.rig, elements_between_nodes=mesh) as fmu, FmuSession(fmu) as session:
        for number, run in enumerate(runs):
            tell(number, len(runs), f"virtual rig: run {number + 1} of {len(runs)}")
            measured.append(_measure(session, run, parameters, tuple(effects)))
    return measured, "fmu" if all(effect.family != "chain" for effect in effects) else "rig"


def _measure(session: FmuSession, run: Run, parameters: dict[str, float], effects: tuple[Effect, ...]) -> ComplexArray:
    """(n_freq, n_channels) in the run's own quantity, on its own lines.

    Per force that acts, nothing of a force drop-out is seen.
    """
    if run.quantity != "acceleration":
        effects = tuple(effect for effect in effects if not effect.needs_exciter_current)
    rig = Rig(
        support=run.support,
        excitation_node=run.excitation_node,
        excitation_plane=run.excitation_plane,
        spin_rpm=run.spin_rpm,
        parameters={**parameters},
        effects=effects,
        quantity="acceleration" if run.quantity == "acceleration" else "accelerance",
        sensor_planes=tuple(dict.fromkeys((run.excitation_plane, *(channel.plane for channel in run.channels)))),
    )
    plan = SweepPlan(force_amplitude=run.force_amplitude_N or 1.0, direction=run.sweep or "up")
    swept = run.frequency_hz if run.swept_hz is None else run.swept_hz
    found = measure_lines(session, rig, plan, run.frequency_hz, passing=swept).run
    H = np.column_stack([found.channel(channel.node, channel.plane) for channel in run.channels])
    omega = 2 * np.pi * run.frequency_hz[:, None]
    return H * (1j * omega) ** (DERIVATIVE_ORDER[run.quantity] - DERIVATIVE_ORDER["accelerance"])


# -- what is printed ---------------------------------------------------------------------------------


def _print(diagnosis: Diagnosis, page: Path) -> None:
    say(diagnosis.sentence)
    if diagnosis.causes:
        if not named(diagnosis):
            say(NO_CAUSE[diagnosis.verdict])
        table(("cause", "where", "probability", "size", "k_b, MN/m"), map(_row, diagnosis.causes[:_CAUSES]))
        for cause in diagnosis.causes[:_CAUSES]:
            if cause.at_prior_edge:
                say(f"{cause_title(cause)}: {at_edge(cause)}")
        if len(diagnosis.causes) > _CAUSES:
            say(f"and {len(diagnosis.causes) - _CAUSES} candidates less likely")
    if diagnosis.shrink:
        say(_shrink_line(diagnosis.shrink))
    if diagnosis.next_test:
        say(f"next: {diagnosis.next_test.words}")
    for finding in diagnosis.audit:
        if finding.severity in ("warning", "error"):
            say(f"{finding.severity}: {f'{finding.run}: ' if finding.run else ''}{finding.words}")
    say(f"{page} and {DIAGNOSIS_FILE} written")


def _row(cause: Cause) -> tuple[str, ...]:
    size = ", ".join(parameters(cause))
    return cause_title(cause), places(cause), part(cause.probability), size, k_b_words(cause.k_b)


def _shrink_line(s: Shrink) -> str:
    """The gap before and after, in one line."""
    alone = f", gains and tolerances alone {share(s.without_effect)}" if finite(s.without_effect) else ""
    floor = f", noise alone {share(s.floor)}" if finite(s.floor) else ""
    return (
        f"gap on {s.held_out}: {share(s.before)} before, {share(s.after)} after{alone}{floor}; "
        f"{explained(s)}; {_VERIFIED[s.verified_by]}"
    )


# -- predict -------------------------------------------------------------------------------------------


def run_predict(path: Path, folder: Path, out: Path) -> None:
    """Write every run of a campaign as the nominal and as the corrected model compute it."""
    n = write_prediction(path, folder, out)
    say(f"{n} runs written to {out / 'nominal'} and {out / 'corrected'}")
    diagnosis = load_diagnosis(path)
    if diagnosis.correction:
        node = diagnosis.correction.node
        note(f"the cause is unknown: {out / 'corrected'} is a best effort by the law that was fitted at node {node}")
    elif not diagnosis.names_a_cause:
        note(f"{path} names no cause: what is in {out / 'corrected'} is the nominal model too")


def write_prediction(path: Path, folder: Path, out: Path) -> int:
    """The files of ``run_predict``; returns the number of runs."""
    from rigtwin.gap.predict import predict

    diagnosis = load_diagnosis(path)
    campaign = load_campaign(folder)
    if not campaign.runs:
        raise UserError(f"{folder}: the campaign has no run, only resonance lists; there are no lines to predict")
    if diagnosis.rig != Path(campaign.rig).name:
        note(f"{path} is of the rig {diagnosis.rig}, {folder} of {campaign.rig}; the campaign's is predicted")
    if diagnosis.nominal.get("k_b") is None and any(run.support == "bearing" for run in campaign.runs):
        note(f"{path} does not say k_b: the runs on bearings are predicted with the default, {Condition.k_b:g} N/m")
    files = _files(campaign, folder)
    runs = [
        (out / kind / file, run)
        for file, predicted in zip(files, predict(diagnosis, campaign), strict=True)
        for kind, run in (("nominal", predicted.nominal), ("corrected", predicted.corrected))
    ]
    _write_all(runs)
    return len(files)


def load_diagnosis(path: Path) -> Diagnosis:
    """A diagnosis.json, its effects known ones. Raises UserError."""
    file = existing(path)
    try:
        diagnosis = Diagnosis.from_json(file.read_text(encoding="utf-8"))
        for number, cause in enumerate(diagnosis.causes, start=1):
            for effect_id in cause.effects:
                _check_effect(number, effect_id)
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: not a text file in UTF-8 ({error.reason}); diagnose again") from error
    except (DocumentError, UserError) as error:
        raise UserError(f"{path}: {error}") from error
    return diagnosis


def _check_effect(number: int, effect_id: str) -> None:
    try:
        effect_of(effect_id)
    except UserError as error:
        raise UserError(f"cause {number}: {error}") from error


def _files(campaign: Campaign, folder: Path) -> list[str]:
    """One CSV below the output folder for each run, named after it. Raises UserError where two would be one."""
    files = [_file_of(run) for run in campaign.runs]
    twice = {file for file in files if files.count(file) > 1}
    if twice:
        raise UserError(f"{folder}: two runs would be written to {', '.join(sorted(twice))}; rename their data files")
    return files


def _file_of(run: Run) -> str:
    """'run01.csv'; a run from another folder stays inside the output folder."""
    parts = [part for part in PurePosixPath(run.name).parts if part not in ("/", "..", ".")]
    return "/".join(parts or ["run"]) + ".csv"


def _write_all(runs: Sequence[tuple[Path, Run]]) -> None:
    """Write all files under free names, then rename them: all or none."""
    with ExitStack() as stack:
        for path, run in runs:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_beside(run, path, stack.enter_context(replacing(path)))
