"""The diagnosis in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rigtwin.gap.document import Cause, Diagnosis, Finding, FittedJoint, Shrink, explainable
from rigtwin.gap.phrases import effects_at, listed, lowered, part, place
from rigtwin.gap.verdict.thresholds import THRESHOLDS
from rigtwin.rotor.effects.library import EFFECTS


@dataclass(frozen=True)
class Mention:
    """From where on something is mentioned in the sentence."""

    gap_over_floor: float = 1.1  # the gap over its noise, for what the cause takes away: below, next to nothing can go
    without_cause: float = 0.5  # share of the gap that gains and tolerances take away alone
    one_joint: float = 0.9  # share of the gap that one joint stiffness explains


MENTION = Mention()


def name_cause(cause: Cause) -> str:
    """Effects of a cause, each with its place, and where else they may be if that is not sure."""
    words = effects_at(cause.effects, cause.locations or (cause.location,))
    if cause.place_probability >= THRESHOLDS.sure or not cause.other_places:
        return words
    others = ", or ".join(" and ".join(map(place, each)) for each in cause.other_places)
    return f"{words} (or {others})"


def sentence(diagnosis: Diagnosis) -> str:
    """The verdict in a sentence, and in another what the audit wants corrected before it is believed."""
    wrong: dict[str, list[str]] = {}
    for finding in filter(must_be_corrected, diagnosis.audit):
        wrong.setdefault(lowered(finding.words), []).append(finding.run)
    said = [f"{listed(runs)}: {words}" for words, runs in wrong.items()]
    return " ".join([_verdict(diagnosis), *(f"First of all, {first}" for first in said[:1]), *said[1:]])


def must_be_corrected(finding: Finding) -> bool:
    """Whether names, signs or units do not fit what a run shows: then no model that has them right can explain it."""
    return finding.check in ("labels", "sign", "units") and finding.severity == "error"


def _verdict(diagnosis: Diagnosis) -> str:
    if diagnosis.verdict == "no_gap":
        words = "Model and measurement agree within the noise and the drifts of the test: there is nothing to explain"
        # A cause may show on one line alone, as where a sweep jumps.
        if any(f.check == "missing_lines" and f.severity == "warning" for f in diagnosis.audit):
            words += " in the lines that were used; which ones are missing or left out, the audit says"
        return f"{words}."
    if diagnosis.verdict == "not_enough_data":
        return "The data are too few to tell one cause from another."
    if diagnosis.verdict == "unknown":
        return "There is a gap, and none of the known effects explains it" + _acts_like(diagnosis)
    if "step_hz" in EFFECTS[diagnosis.causes[0].effects[0]]().sweep_changes():
        surely = part(diagnosis.causes[0].probability)
        return (
            f"Model and measurement agree line by line, but the lines are too far apart to show the peaks ({surely})."
        )
    tail = _takes_away(diagnosis.shrink)
    first = name_cause(diagnosis.causes[0])
    if diagnosis.verdict == "cause":
        return f"The gap comes from {first} (probability {part(diagnosis.causes[0].probability)}){tail}"
    if len(diagnosis.equivalent) < 2:
        surely = part(diagnosis.causes[0].probability)
        return f"The gap may come from {first} (probability {surely}), or be none{tail}"
    none = ["no gap at all"] * (diagnosis.nominal.get("probability", 0.0) > 1 - THRESHOLDS.answered)
    words = f"These data cannot tell apart {', or '.join([*map(name_cause, diagnosis.equivalent), *none])}"
    return f"{words}." if tail == "." else f"{words}; the first{tail}"


def _takes_away(shrink: Shrink | None) -> str:
    """How much of the gap the cause takes away, and how much gains and tolerances would alone, where that is much."""
    if shrink is None or not math.isfinite(shrink.explainable) or shrink.before < MENTION.gap_over_floor * shrink.floor:
        return "."
    words = f": it takes away {part(shrink.explainable)} of the gap that can be explained"
    if shrink.without_effect is not None:
        alone = explainable(shrink.before, shrink.without_effect, shrink.floor)
        words += f"; gains and tolerances without it, {part(alone)}" if alone > MENTION.without_cause else ""
    return f"{words}."


def _acts_like(diagnosis: Diagnosis) -> str:
    """What the unknown mechanism is at its node: the law that was fitted there, or what one joint stiffness looks like
    that explains nearly the whole gap."""
    if any(map(must_be_corrected, diagnosis.audit)):
        return "."
    if diagnosis.measured_joint:
        return _unknown_mechanism(diagnosis.measured_joint)
    joint = diagnosis.where.joint
    if joint is None or diagnosis.where.remark or joint.explained < MENTION.one_joint:
        return "."
    if joint.order.startswith(("none", "too")):
        return "."
    law = joint.order.partition(" (")[0]
    return f"; at node {joint.node} something acts like {law} ({100 * joint.explained:.0f} % of the gap there)."


def _unknown_mechanism(joint: FittedJoint) -> str:
    """Where it is, and how far its fitted law corrects the model."""
    place = f"node {joint.node}" + (", where the exciter acts" if joint.at_exciter else "")
    gap = f"from {part(joint.shrink.before)} to {part(joint.shrink.after)}"
    return (
        f": an unknown mechanism acts at {place}. The dynamic stiffness that was fitted there takes the gap {gap} on "
        "data that were held out."
    )
