"""Score diagnoses against the sealed labels. Reads JSON and CSV only.

    python -m rigtwin.blind.judge.score LABELS_DIR DIAGNOSES_DIR

DIAGNOSES_DIR/<campaign>/

    diagnosis.json                            the answer
    seconds.json                              what it took
    failure.txt                               why there is none
    nominal/<run>.csv, corrected/<run>.csv    predictions on the held-out runs' own lines
    control/corrected/<run>.csv               the same with a random effect outside the answered set
    no_effect/corrected/<run>.csv             the same with gains and tolerances alone

Right answers: a cause with the label's effects, ``no_gap`` where the label has none, ``unknown`` where the effect was
excluded or is in nobody's library. A campaign without an answer counts as answered wrongly.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.blind.generate.effects import NONLINEAR, STRANGERS
from rigtwin.blind.generate.folder import HELD_OUT, TRUTH, read_csv
from rigtwin.blind.judge.statistics import Rate, auroc, brier, calibration_error, median, rate

POSITION_TOLERANCE = 0.010  # m, on a rotor as long as the reference
REFERENCE_SPAN = 0.426  # m
Z_90 = 1.645
QUIET_CHANNEL = 1e-4  # of the largest: left out of a gap
FAILED = "failed"  # in place of a verdict


@dataclass(frozen=True)
class Label:
    """What was hidden."""

    campaign: str
    set: str
    effects: tuple[Mapping[str, Any], ...]
    exclude: tuple[str, ...]
    size: str | None
    size_ratio: float | None
    k_b: float
    sensors: str
    levels: tuple[float, ...]
    table: Mapping[str, Any] = field(repr=False, default_factory=dict)

    @property
    def ids(self) -> frozenset[str]:
        return frozenset(e["id"] for e in self.effects)

    @property
    def name(self) -> str:
        return " + ".join(sorted(self.ids)) or "nothing"

    @property
    def form(self) -> str:
        """Of another functional form (W6)."""
        return " + ".join(e["form"] for e in self.effects if e.get("form"))

    @property
    def outside_library(self) -> bool:
        return self.set == "W8" or bool(self.ids & {*self.exclude, *STRANGERS})

    @property
    def is_nonlinear(self) -> bool:
        return len(self.levels) > 1 and bool(self.ids.intersection(NONLINEAR))

    @property
    def rotor(self) -> str:
        """Name of the rig, where a set has several."""
        return self.table.get("rotor", "")

    @property
    def position_tolerance(self) -> float:
        """How far beside a crack a right answer may lie [m]."""
        nodes = self.table.get("nodes_m")
        return POSITION_TOLERANCE * (nodes[-1] / REFERENCE_SPAN if nodes else 1.0)

    @property
    def places(self) -> frozenset[int]:
        """Nodes where the effects act, as far as they act at nodes."""
        at_kind = {"bearings": self.table.get("bearings", ()), "exciter": (self.table.get("drive_node"),)}
        found: set[int | None] = set()
        for effect in self.effects:
            location = effect["location"]
            found |= {location["node"]} if location.get("node") else set(at_kind.get(location["kind"], ()))
        return frozenset(node for node in found if node is not None)


@dataclass(frozen=True)
class Shrink:
    """How far the held-out gap shrinks; gaps against the response free of noise, gains and drift."""

    before: float
    after: float
    floor: float  # a repeat run's distance from that response: gains, drift and noise
    low: float = math.nan  # the diagnosis' 90 % interval of the explainable shrink
    high: float = math.nan

    @property
    def true(self) -> float:
        return 1 - self.after / self.before if self.before > 0 else 0.0

    @property
    def explainable(self) -> float:
        """(before - after)/(before - floor); 1 is all that a repeat run leaves."""
        room = self.before - self.floor
        return (self.before - self.after) / room if room > 0 else math.nan

    @property
    def covered(self) -> bool | None:
        """Whether the diagnosis' interval covers the true shrink; nothing where it gives none."""
        return None if math.isnan(self.low) else self.low <= self.true <= self.high


@dataclass(frozen=True)
class Outcome:
    """One diagnosis beside its label."""

    label: Label
    verdict: str
    top: frozenset[str]  # effects of the first cause
    answered: tuple[frozenset[str], ...]  # the set that it answers
    probability: float  # of the first cause, 0 without one
    unknown_score: float  # higher: less explained
    located: bool
    parameters_inside: tuple[bool, ...]  # 90 % intervals that cover, for a right cause
    parameter_errors: tuple[float, ...]  # relative
    k_b_error: float  # relative, after the diagnosis
    k_b_error_nominal: float
    k_b_miss: float  # of the recalibrated nominal, in its own standard errors
    seconds: float
    shrink: Shrink | None = None  # on the held-out transfer
    control: Shrink | None = None  # as shrink, of a random effect outside the answered set
    no_effect: Shrink | None = None  # as shrink, of gains and tolerances alone
    processor_seconds: float = math.nan
    failure: str = ""
    place: int | None = None  # node at which the answer sees the gap, whatever its cause

    @property
    def top_right(self) -> bool:
        if self.label.outside_library:
            return self.verdict == "unknown"
        if not self.label.ids:
            return self.verdict == "no_gap"
        return self.verdict in ("cause", "ambiguous") and self.top == self.label.ids

    @property
    def set_right(self) -> bool:
        if self.label.outside_library or not self.label.ids:
            return self.top_right
        return self.label.ids in self.answered

    @property
    def false_alarm(self) -> bool:
        """A cause where there is none, or no answer."""
        return self.verdict in ("cause", "ambiguous", "unknown", FAILED)

    @property
    def not_blamed(self) -> bool:
        """Of an effect outside the library: unknown, or an equivalent that predicts to twice the repeat floor."""
        return self.verdict in ("unknown", "not_enough_data") or self.has_equivalent

    @property
    def has_equivalent(self) -> bool:
        """Whether the answered effect, or none, predicts the held-out transfer to twice the repeat floor."""
        return self.verdict in ("cause", "ambiguous", "no_gap") and self.predicts

    @property
    def predicts(self) -> bool:
        """Whether the answer's prediction of the held-out transfer reaches twice the repeat floor."""
        return self.shrink is not None and self.shrink.after <= 2 * self.shrink.floor

    @property
    def near_place(self) -> bool:
        """Whether the gap is seen within a node of where it comes from."""
        return self.place is not None and any(abs(self.place - node) <= 1 for node in self.label.places)

    @property
    def harmless(self) -> bool:
        """Named, or one of an ambiguous set; or no gap, from which the held-out transfer follows as from a repeat."""
        return self.top_right or self.set_right or (self.verdict == "no_gap" and self.predicts)


def read_labels(folder: Path) -> list[Label]:
    """The sealed labels; raises ValueError where they do not match their seal."""
    content = (folder / "labels.json").read_bytes()
    seal = (folder / "labels.sha256").read_text(encoding="utf-8").split()[0]
    if hashlib.sha256(content).hexdigest() != seal:
        raise ValueError(f"{folder / 'labels.json'} does not match labels.sha256; labels were changed after sealing")
    return [label_from(c) for c in json.loads(content)["campaigns"]]


def label_from(table: Mapping[str, Any]) -> Label:
    return Label(
        table["campaign"],
        table["set"],
        tuple(table["effects"]),
        tuple(table["exclude"]),
        table["size"],
        table["size_ratio"],
        table["k_b"],
        table["sensors"],
        tuple(table["levels"]),
        table,
    )


def failed(label: Label, words: str) -> Outcome:
    """No answer: wrong in every respect."""
    nothing = outcome(label, {"verdict": FAILED, "unknown_score": 0.0 if label.outside_library else 1.0})
    return replace(nothing, failure=words or "no answer")


def outcome(label: Label, diagnosis: Mapping[str, Any], shrink: Shrink | None = None) -> Outcome:
    """Judge one ``diagnosis.json`` (schema rigtwin.diagnosis/1)."""
    causes: list[Mapping[str, Any]] = list(diagnosis.get("causes") or [])
    first = causes[0] if causes else {}
    top = frozenset(first.get("effects", ()))
    verdict = diagnosis["verdict"]
    right = {e["id"]: e for e in label.effects} if top == label.ids else {}
    inside, errors = _parameters(first.get("parameters", {}), right)
    nominal = (diagnosis.get("nominal") or {}).get("k_b") or {}
    k_b = first.get("k_b") if verdict in ("cause", "ambiguous") else nominal
    k_b = k_b or nominal
    return Outcome(
        label,
        verdict,
        top,
        _answered(verdict, causes, diagnosis.get("equivalent") or ()),
        float(first.get("probability", 0.0)),
        _unknown_score(diagnosis, float(first.get("probability", 0.0))),
        bool(right) and _located(first.get("locations") or first.get("location"), label),
        inside,
        errors,
        _relative(k_b, label.k_b),
        _relative(nominal, label.k_b),
        _deviation(nominal, label.k_b),
        sum((diagnosis.get("timing_s") or {}).values()) or math.nan,
        shrink,
        place=_place(diagnosis.get("where") or {}),
    )


def _place(where: Mapping[str, Any]) -> int | None:
    """The joint's node, or the one with the largest share of the gap."""
    joint, nodes = where.get("joint"), where.get("nodes") or ()
    if joint:
        return int(joint["node"])
    return int(max(nodes, key=lambda n: n["share"])["node"]) if nodes else None


def _unknown_score(diagnosis: Mapping[str, Any], probability: float) -> float:
    """The diagnosis' own, else what its first cause leaves."""
    own = diagnosis.get("unknown_score")
    return 1.0 - probability if own is None else float(own)


def _answered(
    verdict: str, causes: Sequence[Mapping[str, Any]], equivalent: Iterable[Mapping[str, Any] | str]
) -> tuple[frozenset[str], ...]:
    if verdict == "ambiguous":
        members = [frozenset([e] if isinstance(e, str) else e["effects"]) for e in equivalent]
        return tuple(dict.fromkeys(members))
    return (frozenset(causes[0]["effects"]),) if verdict == "cause" and causes else ()


def _parameters(
    found: Mapping[str, Any], right: Mapping[str, Mapping[str, Any]]
) -> tuple[tuple[bool, ...], tuple[float, ...]]:
    """Coverage and relative error of every parameter whose true value is known; names may be ``id.parameter``."""
    inside, errors = [], []
    for effect_id, effect in right.items():
        for name, true in effect["parameters"].items() if not effect.get("form") else ():
            answer = found.get(f"{effect_id}.{name}", found.get(name))
            if answer is None or answer.get("value") is None:
                continue
            error = float(answer["value"]) - true
            inside.append(abs(error) <= Z_90 * float(answer.get("std") or 0.0))
            errors.append(abs(error) / max(abs(true), 1e-300))
    return tuple(inside), tuple(errors)


def _located(answer: object, label: Label) -> bool:
    """Exact node, x within the tolerance, else the kind; of a pair, every place has to be among the answers."""
    answers: list[Mapping[str, Any]] = [
        a for a in (answer if isinstance(answer, list) else [answer]) if isinstance(a, Mapping)
    ]
    return all(any(_same_place(a, e["location"], label.position_tolerance) for a in answers) for e in label.effects)


def _same_place(answer: Mapping[str, Any], true: Mapping[str, Any], tolerance: float) -> bool:
    if "x_m" in true:
        return answer.get("x_m") is not None and abs(answer["x_m"] - true["x_m"]) <= tolerance
    if answer.get("kind") != true["kind"]:
        return False
    # Node 0 stands for all sensors.
    return answer.get("node") == true["node"] if true.get("node") else True


def _relative(answer: Mapping[str, Any], true: float) -> float:
    value = answer.get("value")
    return math.nan if value is None else abs(float(value) - true) / true


def _deviation(answer: Mapping[str, Any], true: float) -> float:
    value, std = answer.get("value"), answer.get("std")
    return math.nan if value is None or not std else abs(float(value) - true) / float(std)


def read_shrink(campaign: Path, nominal: Path, corrected: Path, diagnosis: Mapping[str, Any]) -> Shrink | None:
    """Gaps of predicted held-out runs against the truth; nothing where a prediction is missing.

    nominal, corrected : folders of the two predictions
    """
    before, after, floor = [], [], []
    with np.load(campaign / TRUTH / f"{HELD_OUT}.npz") as truth:
        for run in sorted({key.rsplit("/", 1)[0] for key in truth.files}):
            files = [folder / f"{run}.csv" for folder in (nominal, corrected)]
            if not all(f.exists() for f in files):
                return None
            ideal, actual, std = (truth[f"{run}/{name}"] for name in ("ideal", "actual", "std"))
            for target, file in zip((before, after), files, strict=True):
                nodes = read_csv(file)[1]
                channels = [n - 1 for n in nodes]
                target.append(gap(ideal[:, channels], np.column_stack([*nodes.values()])))
            repeat = np.sqrt(np.abs(actual - ideal) ** 2 + std**2)[:, channels]
            floor.append(gap(ideal[:, channels], ideal[:, channels] + repeat))
    return Shrink(float(np.mean(before)), float(np.mean(after)), float(np.mean(floor)), *_interval(diagnosis))


def _interval(diagnosis: Mapping[str, Any]) -> tuple[float, float]:
    """90 % interval of the explainable shrink that the diagnosis gives."""
    low, high = ((diagnosis.get("shrink") or {}).get("ci90") or (None, None))[:2]
    return (math.nan if low is None else float(low), math.nan if high is None else float(high))


def gap(true: np.ndarray, predicted: np.ndarray) -> float:
    """sqrt(sum |H - H^|^2 / sum |H|^2), averaged over the channels that move."""
    power = np.sum(np.abs(true) ** 2, axis=0)
    moving = power > QUIET_CHANNEL**2 * power.max()
    error = np.sum(np.abs(true - predicted) ** 2, axis=0)
    return float(np.mean(np.sqrt(error[moving] / power[moving])))


@dataclass(frozen=True)
class Score:
    """Figures of one group of campaigns."""

    group: str
    count: int
    top1: Rate
    set_hit: Rate
    mean_set: float
    largest_set: int
    location: Rate
    coverage: Rate
    parameter_error: float  # median, relative
    k_b_error: float  # median, relative
    k_b_gain: float  # median of nominal's error over the diagnosis', where the nominal misses by over 5 sigma
    unknown: Rate
    not_blamed: Rate
    false_alarms: Rate
    brier: float
    calibration: float
    shrink_median: float
    shrink_worst: float
    shrink_covered: Rate
    seconds: float  # median


def score(group: str, outcomes: Sequence[Outcome]) -> Score:
    """Figures of a group; shrink is counted where a cause was named rightly."""
    answered = [o for o in outcomes if o.answered]
    named = [o for o in outcomes if o.label.ids and not o.label.outside_library]
    missed = [o for o in named if o.k_b_miss > 5 and o.k_b_error > 0]
    empty = [o for o in outcomes if not o.label.ids]
    outside = [o for o in outcomes if o.label.outside_library]
    sure = [o for o in named if o.answered]
    right = [o for o in named if o.top_right and o.shrink is not None]
    explainable = [o.shrink.explainable for o in right if o.shrink and not math.isnan(o.shrink.explainable)]
    covered = [o.shrink.covered for o in right if o.shrink and o.shrink.covered is not None]
    seconds = [o.seconds for o in outcomes if not math.isnan(o.seconds)]
    return Score(
        group,
        len(outcomes),
        rate([o.top_right for o in outcomes]),
        rate([o.set_right for o in outcomes]),
        float(np.mean([len(o.answered) for o in answered])) if answered else math.nan,
        max((len(o.answered) for o in answered), default=0),
        rate([o.located for o in named]),
        rate([hit for o in named for hit in o.parameters_inside]),
        median([e for o in named for e in o.parameter_errors]),
        median([o.k_b_error for o in outcomes if not math.isnan(o.k_b_error)]),
        median([o.k_b_error_nominal / o.k_b_error for o in missed]),
        rate([o.verdict == "unknown" for o in outcomes]),
        rate([o.not_blamed for o in outside]),
        rate([o.false_alarm for o in empty]),
        brier([o.probability for o in sure], [o.top_right for o in sure]),
        calibration_error([o.probability for o in sure], [o.top_right for o in sure]),
        median(explainable),
        min(explainable, default=math.nan),
        rate([bool(c) for c in covered]),
        median(seconds),
    )


def groups(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """Sets, and in them sizes, sensors, rotors and nonlinear effects."""
    result: dict[str, list[Outcome]] = {}
    for o in sorted(outcomes, key=lambda o: o.label.set):
        label = o.label
        keys = [label.set]
        if label.size:
            keys.append(f"{label.set} {label.size}")
        if label.set == "W1" and not label.is_nonlinear:
            keys.append(f"W1 {label.size}, {label.sensors} sensor{'s' * (label.sensors == 'all')}")
        if label.rotor:
            keys.append(f"{label.set} {label.rotor}")
        if label.is_nonlinear:
            keys.append(f"{label.set} nonlinear")
        for key in keys:
            result.setdefault(key, []).append(o)
    return result


def unknown_auroc(outcomes: Sequence[Outcome]) -> float:
    """How well the score separates effects outside the library (W2, W8) from those inside it and none (W1, W3)."""
    outside = [o.unknown_score for o in outcomes if o.label.set in ("W2", "W8")]
    return auroc(outside, [o.unknown_score for o in outcomes if o.label.set in ("W1", "W3")])


def shuffled(outcomes: Sequence[Outcome], rng: np.random.Generator) -> list[Outcome]:
    """The control: diagnoses against the labels of other campaigns; must score at chance."""
    order = rng.permutation(len(outcomes))
    return [replace(o, label=outcomes[k].label, located=False) for o, k in zip(outcomes, order, strict=True)]


def group_table(outcomes: Sequence[Outcome]) -> str:
    """A row for every group."""
    head = (
        "campaigns", "top-1", "set", "set size (largest)", "place", "coverage", "parameter error", "k_b error",
        "k_b gain", "unknown", "not blamed", "false alarms", "Brier", "ECE", "shrink median (worst)",
        "shrink covered", "time, s",
    )  # fmt: skip
    rows = [f"| group | {' | '.join(head)} |", "|" + " --- |" * (len(head) + 1)]
    rows += [_row(score(name, members)) for name, members in sorted(groups(outcomes).items())]
    return "\n".join(rows)


def _row(s: Score) -> str:
    cells = (
        s.count, s.top1, s.set_hit, f"{_number(s.mean_set)} ({s.largest_set})", s.location, s.coverage,
        _number(s.parameter_error), _number(s.k_b_error), _number(s.k_b_gain), s.unknown, s.not_blamed, s.false_alarms,
        _number(s.brier), _number(s.calibration), f"{_number(s.shrink_median)} ({_number(s.shrink_worst)})",
        s.shrink_covered, _number(s.seconds),
    )  # fmt: skip
    return f"| {s.group} | {' | '.join(map(str, cells))} |"


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.3g}"


def read_outcomes(labels_dir: Path, answers: Path) -> list[Outcome]:
    """Every label beside its answer."""
    return [
        _read_outcome(label, labels_dir / label.campaign, answers / label.campaign) for label in read_labels(labels_dir)
    ]


def _read_outcome(label: Label, campaign: Path, answer: Path) -> Outcome:
    file, seconds, failure = answer / "diagnosis.json", answer / "seconds.json", answer / "failure.txt"
    if failure.exists() or not file.exists():
        return failed(label, failure.read_text(encoding="utf-8").strip() if failure.exists() else "")
    diagnosis = json.loads(file.read_text(encoding="utf-8"))
    nominal = answer / "nominal"
    found = replace(
        outcome(label, diagnosis, read_shrink(campaign, nominal, answer / "corrected", diagnosis)),
        control=read_shrink(campaign, nominal, answer / "control" / "corrected", diagnosis),
        no_effect=read_shrink(campaign, nominal, answer / "no_effect" / "corrected", diagnosis),
    )
    if seconds.exists():
        taken = json.loads(seconds.read_text(encoding="utf-8"))
        found = replace(found, seconds=taken["seconds"], processor_seconds=taken.get("processor", math.nan))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m rigtwin.blind.judge.score", description="Score blind diagnoses.")
    parser.add_argument("labels", type=Path)
    parser.add_argument("diagnoses", type=Path)
    options = parser.parse_args(arguments)
    print(group_table(read_outcomes(options.labels, options.diagnoses)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
