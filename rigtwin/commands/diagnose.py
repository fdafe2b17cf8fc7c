"""``rigtwin diagnose`` and ``rigtwin predict``: where the gap lies, what causes it, what the model then says."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

from rigtwin.api.diagnoses import CAUSE_HEADER, FOREMOST, Progress, cause_row, diagnose
from rigtwin.api.predictions import PREDICTION_HEADER, predict
from rigtwin.console import note, print_json, say, stages, table
from rigtwin.gap.document import FILE_NAME as DIAGNOSIS_FILE
from rigtwin.gap.document import Diagnosis, Shrink
from rigtwin.pages.diagnosis_words import NO_CAUSE, at_edge, cause_title, explained, finite, k_b_words, share
from rigtwin.scratch import check_writable
from rigtwin.wording import counted

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
    time_limit_s: float | None = None  # seconds of work; default that of ``diagnose``


def run_diagnose(request: DiagnosisRequest) -> None:
    """Diagnose a campaign, write diagnosis.json and the page, print what was found."""
    with _folder(request.out):  # what cannot be written is refused before the work
        with _progress() as progress:
            found = diagnose(
                request.campaign,
                exclude=request.exclude,
                fmu=request.fmu,
                workers=request.workers,
                progress=progress,
                time_limit_s=request.time_limit_s,
            )
        page = found.save(request.out)
    if request.as_json:
        print(found.diagnosis.to_json(), end="")
    else:
        _print(found.diagnosis, page)


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


@contextmanager
def _progress() -> Iterator[Progress]:
    """A progress bar that says what is going on; where stderr is not a terminal, a line for the stage now and then."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn()
    if not console.is_terminal:
        say_stage = stages()
        yield lambda done, total, words: say_stage(words, done, total)
        return
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task("diagnosis", total=None)
        yield lambda done, total, words: bar.update(task, completed=done, total=total, description=words)


# -- what is printed ---------------------------------------------------------------------------------


def _print(diagnosis: Diagnosis, page: Path) -> None:
    say(diagnosis.sentence)
    if diagnosis.causes:
        if not diagnosis.names_a_cause:
            say(NO_CAUSE[diagnosis.verdict])
        table(CAUSE_HEADER, map(cause_row, diagnosis.causes[:FOREMOST]))
        for cause in diagnosis.causes[:FOREMOST]:
            if cause.at_prior_edge:
                say(f"{cause_title(cause)}: {at_edge(cause)}")
        if len(diagnosis.causes) > FOREMOST:
            say(f"and {len(diagnosis.causes) - FOREMOST} candidates less likely")
    if diagnosis.verdict == "no_gap" and (k_b := diagnosis.nominal.get("k_b")):
        say(f"k_b = {k_b_words(k_b)} MN/m, of the nominal model")
    if diagnosis.shrink:
        say(_shrink_line(diagnosis.shrink))
    if diagnosis.next_test:
        say(f"next: {diagnosis.next_test.words}")
    for finding in diagnosis.audit:
        if finding.severity in ("warning", "error"):
            say(f"{finding.severity}: {f'{finding.run}: ' if finding.run else ''}{finding.words}")
    say(f"{page} and {DIAGNOSIS_FILE} written")


def _shrink_line(s: Shrink) -> str:
    """The gap before and after, in one line."""
    floor = f"; noise alone leaves {share(s.floor)}" if finite(s.floor) else ""
    alone = f"; gains and tolerances alone leave {share(s.without_effect)}" if finite(s.without_effect) else ""
    return (
        f"gap on {s.held_out}: {share(s.before)} before, {share(s.after)} after{floor}{alone}\n"
        f"{explained(s)}; {_VERIFIED[s.verified_by]}"
    )


# -- predict -------------------------------------------------------------------------------------------


def run_predict(path: Path, folder: Path, out: Path, *, as_json: bool = False) -> None:
    """Write every run of a campaign as the nominal and as the corrected model compute it, and compare."""
    found = predict(path, folder)
    page = found.save(out)
    for remark in found.remarks:
        note(remark)
    if as_json:
        print_json(found.record())
        return
    table(PREDICTION_HEADER, found.rows())
    say(f"{counted(len(found.runs), 'run')} written to {out / 'nominal'} and {out / 'corrected'}; {page} compares them")
