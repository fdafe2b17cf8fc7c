"""``rigtwin blind``: make sealed campaigns, diagnose them, score the answers.

The generator and the scorer are ``gap.blind``; nothing that is diagnosed here has seen a label.
"""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from rigtwin.console import note, say
from rigtwin.diagnose import write_prediction
from rigtwin.exits import UserError
from sim.formats.atomic import replacing

SETS = ("W1", "W2", "W3", "W4", "W5", "W6", "W7", "W8")
_INDEX = "index.json"
_SECONDS = "seconds.json"


@dataclass(frozen=True)
class BlindRequest:
    """What was asked for on the command line."""

    sets: tuple[str, ...]
    split: str
    count: int
    out: Path
    seed: int
    workers: int


def run_blind(request: BlindRequest) -> None:
    """Make the campaigns that are missing, diagnose those without an answer, write the scores."""
    from gap.blind import generate, score

    if unknown := sorted(set(request.sets) - set(SETS)):
        raise UserError(f"{', '.join(unknown)}: no such set; the sets are {', '.join(SETS)}")
    pages = []
    for name in request.sets:
        campaigns, answers = request.out / "campaigns" / name, request.out / "answers" / name
        order = ["--set", name, "--split", request.split, "--count", str(request.count), "--out", str(campaigns)]
        generate.main([*order, "--seed", str(request.seed), "--workers", str(request.workers)])
        diagnose_all(campaigns, answers, request.workers)
        outcomes, missing = score.read_outcomes(campaigns, answers)
        if missing:
            note(f"{name}: {len(missing)} campaigns without an answer are left out")
        pages.append(f"## {name}\n\n{score.markdown(outcomes)}")
    page = request.out / "blind.md"
    with replacing(page) as beside:
        beside.write_text("\n\n".join(pages) + "\n", encoding="utf-8")
    say("\n\n".join(pages))
    say(f"{page} written")


def diagnose_all(campaigns: Path, answers: Path, workers: int) -> None:
    """Diagnose every campaign of a set that has no answer yet, and predict what was held out."""
    index = json.loads((campaigns / _INDEX).read_text(encoding="utf-8"))
    entries = index["campaigns"] if isinstance(index, dict) else index
    jobs = [
        (campaigns / entry["campaign"], answers / entry["campaign"], tuple(entry.get("exclude", ())))
        for entry in entries
        if not (answers / entry["campaign"] / _SECONDS).exists()
    ]
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for number, done in enumerate(as_completed([pool.submit(diagnose_one, *job) for job in jobs]), start=1):
            name, seconds, failure = done.result()
            note(f"{campaigns.name} {number}/{len(jobs)} {name}: {failure or f'{seconds:.0f} s'}")


def diagnose_one(campaign: Path, answer: Path, exclude: Sequence[str]) -> tuple[str, float, str]:
    """Diagnosis and predictions of one campaign; returns its name, seconds, and why it failed."""
    from gap.diagnose import diagnose
    from sim.campaign_folder import load_campaign

    start = time.perf_counter()
    try:
        found = diagnose(load_campaign(campaign / "measured"), exclude).diagnosis
        seconds = time.perf_counter() - start
        path = found.save(answer)
        write_prediction(path, campaign / "held_out", answer)
    except Exception as error:  # one campaign must not end the benchmark; it counts as without an answer
        return campaign.name, time.perf_counter() - start, f"{type(error).__name__}: {error}"
    with replacing(answer / _SECONDS) as beside:
        beside.write_text(json.dumps({"seconds": seconds}), encoding="utf-8")
    return campaign.name, seconds, ""
