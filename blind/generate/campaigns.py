"""Write blind campaigns and seal their labels.

DIR/<campaign>/measured and held_out are for the diagnosis; DIR/<campaign>/truth, DIR/labels.json are for the scorer.
DIR/index.json says which campaigns there are and which effects to exclude. What is there already is not made again.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import shutil
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from rigtwin.blind import SETS
from rigtwin.blind.generate.case import Run, measure
from rigtwin.blind.generate.draw import Draw, draw_campaign
from rigtwin.blind.generate.folder import HELD_OUT, MEASURED, TRUTH, write_campaign, write_json, write_truth
from rigtwin.blind.generate.label import label_of, of_real_rig
from rigtwin.blind.generate.nonlinear import NotFoundError
from rigtwin.blind.generate.real_rigs import draw_real, rotor_of
from rigtwin.blind.generate.rig import REFERENCE, Rig, read_rig
from rigtwin.blind.generate.sizes import SMALL, shown_size

SPLITS = ("tuning", "report")
REAL = "W9"  # the set whose rotors have several sizes
LABEL = "label.json"
DATA = Path(__file__).parents[2] / "benchmarks" / "stored_campaigns"  # of a checkout; none where it is installed
BETWEEN_STORED = 8
REDRAWS = 5  # of a campaign whose motions at all levels and drive nodes cannot be found, or do not show its effect


@dataclass(frozen=True)
class Order:
    """One campaign to be made."""

    set: str
    split: str
    seed: int
    index: int

    @property
    def name(self) -> str:
        """Tells nothing."""
        text = f"{self.set}/{self.split}/{self.seed}/{self.index}"
        return "c" + hashlib.sha256(text.encode()).hexdigest()[:12]

    def rng(self) -> np.random.Generator:
        key = (self.seed, SETS.index(self.set), SPLITS.index(self.split), self.index)
        return np.random.default_rng(np.random.SeedSequence(key))


def make(order: Order, out: Path, beside: Path | None = None) -> dict[str, object]:
    """Draw, measure and write one campaign, or take a stored one; its label.

    It is made beside its place, or in a folder that is given for it: a worker that is given up may still be at it when
    another begins.
    """
    beside = (beside or out) / f".{secrets.token_hex(4)}"
    try:
        stored = stored_case(order)
        label = take(stored, order, beside) if stored else draw_and_measure(order, beside)
        if not (out / order.name / TRUTH / LABEL).exists():
            shutil.rmtree(out / order.name, ignore_errors=True)
            (beside / order.name).rename(out / order.name)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return label


def stored_case(order: Order) -> Path | None:
    """Every eighth campaign of W6 is one that another code has made, as long as there are any left."""
    number, rest = divmod(order.index + 1, BETWEEN_STORED)
    cases = sorted(DATA.glob(f"*/{TRUTH}/{LABEL}"))
    return cases[number - 1].parents[1] if order.set == "W6" and not rest and number <= len(cases) else None


def take(stored: Path, order: Order, out: Path) -> dict[str, object]:
    """Copy a stored campaign under the order's name."""
    folder = out / order.name
    for part in (MEASURED, HELD_OUT, TRUTH):
        shutil.copytree(stored / part, folder / part, dirs_exist_ok=True, ignore=shutil.ignore_patterns(LABEL))
    for part in (MEASURED, HELD_OUT):
        plan = folder / part / "campaign.toml"
        plan.write_text(plan.read_text(encoding="utf-8").replace(stored.name, order.name), encoding="utf-8")
    label = json.loads((stored / TRUTH / LABEL).read_text(encoding="utf-8")) | {"campaign": order.name}
    write_json(folder / TRUTH / LABEL, label)
    return label


def draw_and_measure(order: Order, out: Path) -> dict[str, object]:
    """A campaign of the generator's own."""
    rig = read_rig(rotor_of(order.index) if order.set == REAL else REFERENCE)
    rng = order.rng()
    draw, measured, held_out = measured_draw(rig, order, rng)
    folder = out / order.name
    write_campaign(folder / MEASURED, rig.name, draw.case, measured, rng)
    write_campaign(folder / HELD_OUT, rig.name, draw.case, held_out, rng)
    write_truth(folder / TRUTH, measured, held_out, draw.case)
    label = label_of(draw, order.name, order.split)
    if order.set == REAL:
        label |= of_real_rig(draw, rig)
    write_json(folder / TRUTH / LABEL, label)
    return label


def measured_draw(rig: Rig, order: Order, rng: np.random.Generator) -> tuple[Draw, list[Run], list[Run]]:
    """A draw with its runs, held-out ones apart. Its motions can be found, and a nonlinear effect can be seen in them.

    What was planned by harmonic balance may not come about: solved in time, a bearing that could lift off need not.
    """
    unseen = lost = 0
    while unseen + lost < REDRAWS:
        drawn = draw_real if order.set == REAL else partial(draw_campaign, set_name=order.set)
        draw = drawn(rig, index=order.index, rng=rng)
        case = draw.case
        middle = case.levels[len(case.levels) // 2]
        try:
            measured = measure(rig, case, rig.drive_node, [*case.levels, *[middle] * case.repeats], rng)
            if case.is_nonlinear:
                draw = replace(draw, ratios=(shown_size(rig, case, measured), *draw.ratios[1:]))
                if draw.ratios[0] < SMALL:
                    unseen += 1
                    continue
            held_out = measure(rig, case, rig.plan.held_out_node, [middle], rng)
        except NotFoundError:
            lost += 1
            continue
        draw = replace(draw, rejected=draw.rejected + unseen, not_periodic=draw.not_periodic + lost)
        return draw, measured, held_out
    raise NotFoundError(f"of {REDRAWS} draws {lost} had motions that were not found, {unseen} showed no effect")


def make_missing(
    orders: Sequence[Order], out: Path, executor: Executor, beside: Path | None = None
) -> Iterator[tuple[Order, str]]:
    """Make what is not there yet; yields each order as it is done, with an error's text or nothing."""
    missing = [order for order in orders if not (out / order.name / TRUTH / LABEL).exists()]
    waiting = {executor.submit(make, order, out, beside): order for order in missing}
    for future in as_completed(waiting):
        error = future.exception()
        yield waiting[future], "" if error is None else f"{type(error).__name__}: {error}"


def seal(out: Path) -> str:
    """Gather the labels of all campaigns in the folder, and their SHA-256."""
    labels = [json.loads(p.read_text(encoding="utf-8")) for p in sorted(out.glob(f"*/{TRUTH}/{LABEL}"))]
    write_json(out / "labels.json", {"schema": "rigtwin.blind-labels/1", "campaigns": labels})
    digest = hashlib.sha256((out / "labels.json").read_bytes()).hexdigest()
    (out / "labels.sha256").write_text(f"{digest}  labels.json\n", encoding="utf-8")
    index = [{"campaign": label["campaign"], "set": label["set"], "exclude": label["exclude"]} for label in labels]
    write_json(out / "index.json", index)
    return digest


def make_all(orders: Sequence[Order], out: Path, executor: Executor, beside: Path | None = None) -> int:
    """Make what is missing of a set, in a folder of the same disk, and seal it; returns how many could not be made."""
    out.mkdir(parents=True, exist_ok=True)
    failed = 0
    for done, (order, error) in enumerate(make_missing(orders, out, executor, beside), start=1):
        if error:
            failed += 1
            print(f"\ncampaign {order.index} of {order.set}: {error}", file=sys.stderr)
        if sys.stderr.isatty():
            print(f"\r{done} of {len(orders)} campaigns", end="", file=sys.stderr, flush=True)
    digest = seal(out)
    print(f"{out}: labels sealed, SHA-256 {digest}")
    return failed
