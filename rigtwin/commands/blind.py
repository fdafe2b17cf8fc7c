"""``rigtwin blind``: make sealed campaigns, diagnose them, score the answers.

The generator and the scorer are ``rigtwin.blind``; nothing that is diagnosed here has seen a label. Every campaign is
diagnosed in a process of its own, so that one that dies takes no other along.
"""

from __future__ import annotations

import json
import math
import os
import platform
import shutil
import subprocess
import sys
import time
import zlib
from collections.abc import Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.blind import SETS
from rigtwin.console import note, say
from rigtwin.errors import UserError
from rigtwin.parsing import parse_json
from rigtwin.scale_out import ONE_THREAD, executor
from rigtwin.scratch import replacing, scratch_folder
from rigtwin.workers import end_with

PAGE = "blind.md"
SCHEMA = "rigtwin.blind-results/2"

# The fact that tells apart what must not stand on one page.
_SPLIT = "split"

# Seconds after which a diagnosis is given up: one that ends on a slow machine ends everywhere.
_LONGEST = 3600.0

# Of so many campaigns, one is fitted with a random effect, too.
_CONTROL_EVERY = 4

_SECONDS, _FAILURE = "seconds.json", "failure.txt"

# The program of one answer; campaign, folder and what to exclude follow.
_ANSWER = (sys.executable, "-m", "rigtwin.commands.blind")


@dataclass(frozen=True)
class BlindRequest:
    """What was asked for on the command line."""

    sets: tuple[str, ...]
    split: str
    count: int
    out: Path
    seed: int
    workers: int
    executor: str | None = None  # "dask://host:port"; default ``workers`` processes here
    page: Path | None = None  # default: blind.md in ``out``
    render_only: bool = False  # write the page from the results

    @property
    def pages(self) -> tuple[Path, Path]:
        """The page, and beside it the results that it is written from."""
        page = self.page or self.out / PAGE
        return page, page.with_suffix(".json")


def run_blind(request: BlindRequest) -> None:
    """Make the campaigns that are missing, diagnose those without an answer, write the scores."""
    if unknown := sorted(set(request.sets) - set(SETS)):
        raise UserError(f"{', '.join(unknown)}: no such set; the sets are {', '.join(SETS)}")
    if not request.render_only:
        for name in request.sets:
            _save(request, name, _make_and_diagnose(request, name))
    _render(request)


def _places(request: BlindRequest, name: str) -> tuple[Path, Path]:
    """Folders of a set's campaigns and answers; other splits and seeds have folders of their own."""
    out, draw = request.out.resolve(), f"{request.split}-{request.seed}"  # workers elsewhere see the same path
    return out / "campaigns" / draw / name, out / "answers" / draw / name


def _make_and_diagnose(request: BlindRequest, name: str) -> str:
    """One set; returns how many campaigns it has, of which seed, when it was done, and the SHA-256 of their labels."""
    from rigtwin.blind.generate import campaigns as generate
    from rigtwin.pages.provenance import commit

    campaigns, answers = _places(request, name)
    orders = [generate.Order(name, request.split, request.seed, index) for index in range(request.count)]
    campaigns.mkdir(parents=True, exist_ok=True)
    with executor(request.executor, request.workers) as pool, scratch_folder(beside=campaigns / name) as beside:
        if failed := generate.make_all(orders, campaigns, pool, beside):
            note(
                f"{name}: {failed} campaigns could not be made; they are missing from the page, run again to try again"
            )
    with executor(request.executor, request.workers) as pool:  # another one: a generator may have broken the first
        diagnose_all(campaigns, answers, pool)
    made = len(json.loads((campaigns / "index.json").read_text(encoding="utf-8")))
    sealed = (campaigns / "labels.sha256").read_text(encoding="utf-8").split()[0]
    revision = commit()
    by = f" by commit {revision}" if revision else ""
    return f"{made} campaigns, seed {request.seed}, {datetime.now(UTC):%Y-%m-%d}{by}, labels sealed: {sealed}"


# -- diagnosing ----------------------------------------------------------------------------------------


def diagnose_all(campaigns: Path, answers: Path, pool: Executor) -> None:
    """Diagnose every campaign of a set that has no answer yet, and predict what was held out."""
    entries = json.loads((campaigns / "index.json").read_text(encoding="utf-8"))
    jobs = [
        (campaigns / entry["campaign"], answers / entry["campaign"], tuple(entry["exclude"]))
        for entry in entries
        if not (answers / entry["campaign"] / _SECONDS).exists()
    ]
    waiting = {pool.submit(in_own_process, *job): job[0].name for job in jobs}
    for number, done in enumerate(as_completed(waiting), start=1):
        try:
            words = done.result()
        except OSError as error:  # of one campaign; the next ones go on
            words = f"no answer: {error}"
        note(f"{campaigns.name} {number}/{len(jobs)} {waiting[done]}: {words}")


def in_own_process(campaign: Path, answer: Path, exclude: Sequence[str]) -> str:
    """Diagnose in a process of its own; a failure is written down. Returns what happened.

    The answer is made beside its place: a worker that is given up may still be at it when another begins.
    """
    answer.parent.mkdir(parents=True, exist_ok=True)
    with scratch_folder(beside=answer) as folder:
        beside = folder / answer.name
        beside.mkdir()
        _run([*_ANSWER, str(campaign), str(beside), *exclude], beside)
        words = _words(beside)
        if not (answer / _SECONDS).exists():
            shutil.rmtree(answer, ignore_errors=True)  # of a run that failed
            try:
                beside.rename(answer)
            except OSError:
                if not (answer / _SECONDS).exists():  # else a worker that had been given up was faster
                    raise
    return words


def _run(command: Sequence[str], answer: Path) -> None:
    """Run the program of an answer, which ends when this process does; a failure is written down."""
    with subprocess.Popen(command, stdin=subprocess.PIPE, env=os.environ | ONE_THREAD) as process:
        try:
            code = process.wait(_LONGEST)
            if code and not (answer / _FAILURE).exists():
                _write(answer / _FAILURE, f"the process died with exit code {code}")
        except subprocess.TimeoutExpired:
            _write(answer / _FAILURE, f"took longer than {_LONGEST:.0f} s")
        finally:
            process.kill()


def _words(answer: Path) -> str:
    """How an answer ended."""
    if (answer / _FAILURE).exists():
        return (answer / _FAILURE).read_text(encoding="utf-8")
    return f"{json.loads((answer / _SECONDS).read_text(encoding='utf-8'))['seconds']:.0f} s"


def diagnose_one(campaign: Path, answer: Path, exclude: Sequence[str]) -> None:
    """Diagnosis and predictions of one campaign, in the folder of its answer; a failure is written there, too."""
    try:
        seconds = _answer(campaign, answer, exclude)
    except Exception as error:  # it counts as a wrong answer
        _write(answer / _FAILURE, f"{type(error).__name__}: {error}"[:300].replace("\n", " ").replace("|", "/"))
        return
    _write(answer / _SECONDS, json.dumps(seconds))


def _answer(campaign: Path, answer: Path, exclude: Sequence[str]) -> dict[str, float]:
    """Writes everything that is scored; returns the seconds of the diagnosis alone, by the clock and the processor."""
    from rigtwin.api.predictions import predict
    from rigtwin.gap.diagnose import diagnose
    from rigtwin.sim.campaign_folder import load_campaign

    measured = load_campaign(campaign / "measured")
    start, busy = time.perf_counter(), time.process_time()
    outcome = diagnose(measured, exclude)
    seconds = {"seconds": time.perf_counter() - start, "processor": time.process_time() - busy}
    path = outcome.diagnosis.save(answer)
    predict(path, campaign / "held_out").save_runs(answer)
    draw = zlib.crc32(campaign.name.encode())
    if outcome.diagnosis.verdict in ("cause", "ambiguous") and draw % _CONTROL_EVERY == 0:
        write_controls(measured, outcome.diagnosis, exclude, draw, campaign / "held_out", answer)
    return seconds


def write_controls(
    measured: Any, diagnosis: Any, exclude: Sequence[str], draw: int, held_out: Path, answer: Path
) -> None:
    """Fit a random linear effect that was not answered, and no effect at all; predict what was held out.

    Gains and tolerances are free in both, as they are in every fit: what they explain is no credit of the effect.
    """
    from rigtwin.api.predictions import predict
    from rigtwin.gap.inference.hypotheses import candidates
    from rigtwin.gap.model.campaign_model import forward_of

    answered = {name for cause in (*diagnosis.equivalent, *diagnosis.causes[:1]) for name in cause.effects}
    hypotheses = candidates(measured.runs, forward_of(measured).structure, exclude)
    names = sorted({h.ids[0] for h in hypotheses} - answered)
    chosen = str(np.random.default_rng(draw).choice(names))
    for folder, tried in (("control", [h for h in hypotheses if h.ids == (chosen,)]), ("no_effect", [])):
        path = control_diagnosis(measured, tried).save(answer / folder)
        predict(path, held_out).save_runs(path.parent)


def control_diagnosis(measured: Any, hypotheses: Sequence[Any]) -> Any:
    """A diagnosis with the best of these candidates, if any, as the cause."""
    from rigtwin.gap.answer.calibration import calibration_of
    from rigtwin.gap.document import Cause, Diagnosis, Estimate, Location, Where
    from rigtwin.gap.prepare import prepared
    from rigtwin.gap.search.linear import search

    problem, nominal = prepared(measured)
    best = search(problem, hypotheses, nominal).fits[0] if hypotheses else nominal
    values = best.hypothesis.split(best.u[1:])
    numbers = {
        f"{term.effect.id}.{name}": value
        for term, own in zip(best.hypothesis.terms, values, strict=True)
        for name, value in (*term.fixed, *((free.name, free.value(u)) for free, u in zip(term.free, own, strict=True)))
    }
    cause = Cause(best.hypothesis.ids, Location("node"), math.nan, {}, Estimate(best.k_b, math.nan), places=numbers)
    return Diagnosis(
        title="",
        rig=Path(measured.rig).name,
        verdict="cause",
        sentence="",
        nominal={"k_b": Estimate(nominal.k_b, math.nan)},
        where=Where(),
        causes=(cause,),
        calibration=calibration_of(problem, best, 1.0),
    )


# -- results -------------------------------------------------------------------------------------------


def _save(request: BlindRequest, name: str, seal: str) -> None:
    """A row for every campaign of a set; those of other sets of the same split stay, whatever their seed."""
    from rigtwin.blind.judge.results import to_row
    from rigtwin.blind.judge.score import read_outcomes

    file, facts = request.pages[1], _facts(request)
    before = _read(file) if file.exists() else {"facts": {}, "campaigns": []}
    same = before["facts"].get(_SPLIT) == facts[_SPLIT]
    seals = {key: words for key, words in before["facts"].items() if same and key in SETS}
    rows = [row for row in before["campaigns"] if same and row["label"]["set"] != name]
    rows += [to_row(outcome) for outcome in read_outcomes(*_places(request, name))]
    rows.sort(key=lambda row: row["label"]["set"])
    facts |= dict(sorted((seals | {name: seal}).items()))
    lines = ",\n".join(json.dumps(row) for row in rows)
    _write(file, f'{{"schema": "{SCHEMA}",\n"facts": {json.dumps(facts)},\n"campaigns": [\n{lines}\n]}}\n')


def _read(file: Path) -> dict[str, Any]:
    try:
        document = parse_json(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise UserError(f"{file}: {error}; give --page another name") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise UserError(f"{file}: schema is {schema!r}, not {SCHEMA!r}; give --page another name")
    return document


def _render(request: BlindRequest) -> None:
    """The page of the results."""
    from rigtwin.blind.judge.page import bar_table, page
    from rigtwin.blind.judge.results import from_row

    path, file = request.pages
    if not file.exists():
        raise UserError(f"{file} does not exist; run without --render-only first")
    document = _read(file)
    outcomes = [from_row(row) for row in document["campaigns"]]
    _write(path, page(outcomes, document["facts"]))
    say(bar_table(outcomes))
    say(f"{path} and {file} written")


def _facts(request: BlindRequest) -> dict[str, str]:
    """What the figures come from."""
    facts = {
        _SPLIT: request.split,
        "processor": request.executor
        or f"{_processor()}, {os.cpu_count()} cores, {request.workers} processes of one thread",
        "python": f"{platform.python_version()} on {platform.system()} {platform.machine()}",
    }
    return facts | {package: version(package) for package in ("numpy", "scipy", "rigtwin")}


def _processor() -> str:
    """Its name, where the system tells."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return (names or [platform.processor() or platform.machine()])[0]


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    end_with(sys.stdin.fileno())
    diagnose_one(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
