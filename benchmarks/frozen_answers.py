"""Answers that must not change: ``python -m benchmarks.frozen_answers`` compares them, ``--freeze`` writes them anew.

A change that moves or renames things, and means to change no number, diagnoses the same thirty campaigns before and
after: 24 of the blind benchmark's tuning split, of every set, and six whose rotor is ROSS'. What was measured, the
verdict, the named effects and places, k_b and the shrink are compared; numbers to six digits. The answers are frozen
for one machine's arithmetic: freeze them before the change, on the machine that compares after it.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from rigtwin.blind.generate.campaigns import DATA, Order, make
from rigtwin.blind.generate.folder import MEASURED
from rigtwin.gap.diagnose import diagnose
from rigtwin.gap.document import Cause, Diagnosis
from rigtwin.sim.campaign_folder import load_campaign
from rigtwin.workers import worker_pool

FROZEN = Path(__file__).with_name("frozen_answers.json")
SEED = 48
DIGITS = 6

# Indices of the tuning campaigns of every set; 8, 12 and 17 of W1 hide force laws.
TUNING = {
    "W1": (0, 1, 2, 3, 6, 8, 10, 12, 13, 15, 17),
    "W2": (1, 4),
    "W3": (0, 1),
    "W4": (0, 1, 2),
    "W5": (0, 3),
    "W6": (0, 1),
    "W7": (0,),
    "W8": (0,),
}
ROSS = ("ross_asymmetry", "ross_damping", "ross_disks", "ross_modulus", "ross_nothing", "ross_pedestals")


def main() -> int:
    """Diagnose all, on two processes, and compare or freeze; 1 where an answer is another one."""
    answers = dict(sorted(_answers()))
    if "--freeze" in sys.argv[1:]:
        FROZEN.write_text(json.dumps(answers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"{len(answers)} answers frozen in {FROZEN}")
        return 0
    frozen = json.loads(FROZEN.read_text(encoding="utf-8"))
    changed = [name for name in sorted(frozen | answers) if frozen.get(name) != answers.get(name)]
    for name in changed:
        print(f"{name}\n  frozen: {json.dumps(frozen.get(name))}\n  now:    {json.dumps(answers.get(name))}")
    same = len(frozen) - len(changed)
    print(f"{same} of {len(frozen)} answers are the same to {DIGITS} digits; sha256 {_hash(answers)}")
    return 1 if changed else 0


def _answers() -> Iterator[tuple[str, dict[str, Any]]]:
    orders = [Order(name, "tuning", SEED, index) for name, indices in TUNING.items() for index in indices]
    with tempfile.TemporaryDirectory() as folder, worker_pool(2) as pool:
        jobs = [pool.submit(_of_tuning, order, Path(folder)) for order in orders]
        jobs += [pool.submit(_of_ross, name) for name in ROSS]
        for number, job in enumerate(as_completed(jobs), start=1):
            name, answer = job.result()
            print(f"{number}/{len(jobs)} {name}: {answer['verdict']} {answer['causes'][:1]}", flush=True)
            yield name, answer


def _of_tuning(order: Order, folder: Path) -> tuple[str, dict[str, Any]]:
    make(order, folder)
    return f"{order.set}-{order.index:02d}", _answer(folder / order.name / MEASURED)


def _of_ross(name: str) -> tuple[str, dict[str, Any]]:
    return name, _answer(DATA / name / MEASURED)


def _answer(folder: Path) -> dict[str, Any]:
    """What the campaign holds and what is said of it."""
    return {"measured": _measured(folder), **answer_of(diagnose(load_campaign(folder)).diagnosis)}


def answer_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """Verdict, names, places, k_b and shrink, numbers to six digits."""
    nominal = diagnosis.nominal["k_b"]
    shrink = diagnosis.shrink
    return {
        "verdict": diagnosis.verdict,
        "k_b": None if nominal is None else _rounded((nominal.value, nominal.std)),
        "causes": [_named(cause) for cause in diagnosis.causes[:3]],
        "equivalent": [_named(cause) for cause in diagnosis.equivalent],
        "shrink": None if shrink is None else _rounded((shrink.before, shrink.after, shrink.floor, shrink.shrink)),
    }


def _named(cause: Cause) -> list[Any]:
    """Effects with their places, probability, k_b, parameters."""
    k_b = () if cause.k_b is None else (cause.k_b.value,)
    numbers = (cause.probability, *k_b, *(estimate.value for estimate in cause.parameters.values()))
    places = [[location.kind, location.node] for location in (cause.locations or (cause.location,))]
    return ["+".join(cause.effects), places, _rounded(numbers)]


def _rounded(numbers: Sequence[float]) -> list[str]:
    return [f"{number:.{DIGITS}g}" for number in numbers]


def _measured(folder: Path) -> str:
    """Hash of the campaign's files: the generator, too, must make the same."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def _hash(answers: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(answers, sort_keys=True).encode()).hexdigest()[:16]


if __name__ == "__main__":
    sys.exit(main())
