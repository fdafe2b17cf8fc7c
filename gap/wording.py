"""The diagnosis in words."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from gap.diagnosis import Cause, Diagnosis, Finding, NextTest, Shrink, Verdict, explainable
from gap.hypotheses import SURE
from gap.phrases import effects_at, listed, lowered, part, place, supports
from gap.ranking import ANSWERED
from rotor.rig import Rig, load_rig
from sim.campaign import SUPPORTS, Campaign


def named(cause: Cause) -> str:
    """Effects of a cause, each with its place, and where else they may be if that is not sure."""
    words = effects_at(cause.effects, cause.locations or (cause.location,))
    if cause.place_probability >= SURE or not cause.other_places:
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
        return f"{words}{_IN_WHAT_IS_THERE if _lines_lack(diagnosis) else ''}."
    if diagnosis.verdict == "not_enough_data":
        return "The data are too few to tell one cause from another."
    if diagnosis.verdict == "unknown":
        return "There is a gap, and none of the known effects explains it" + _acts_like(diagnosis)
    if diagnosis.causes[0].location.kind == "raster":
        surely = part(diagnosis.causes[0].probability)
        return (
            f"Model and measurement agree line by line, but the lines are too far apart to show the peaks ({surely})."
        )
    tail = _takes_away(diagnosis.shrink)
    first = named(diagnosis.causes[0])
    if diagnosis.verdict == "cause":
        return f"The gap comes from {first} (probability {part(diagnosis.causes[0].probability)}){tail}"
    if len(diagnosis.equivalent) < 2:
        surely = part(diagnosis.causes[0].probability)
        return f"The gap may come from {first} (probability {surely}), or be none{tail}"
    choices = [*map(named, diagnosis.equivalent), *(["no gap at all"] if _may_be_none(diagnosis) else [])]
    words = f"These data cannot tell apart {', or '.join(choices)}"
    return f"{words}." if tail == "." else f"{words}; the first{tail}"


# A cause may show on one line alone, as where a sweep jumps.
_IN_WHAT_IS_THERE = " in the lines that were used; which ones are missing or left out, the audit says"


def _lines_lack(diagnosis: Diagnosis) -> bool:
    return any(f.check == "missing_lines" and f.severity == "warning" for f in diagnosis.audit)


def _may_be_none(diagnosis: Diagnosis) -> bool:
    return diagnosis.nominal.get("probability", 0.0) > 1 - ANSWERED


def _takes_away(shrink: Shrink | None) -> str:
    """What the cause explains, and what gains and tolerances would without it, where that is much."""
    if shrink is None or not math.isfinite(shrink.explainable) or shrink.before < _PLAINLY * shrink.floor:
        return "."
    words = f": it takes away {part(shrink.explainable)} of the gap that can be explained"
    if shrink.without_effect is not None:
        alone = explainable(shrink.before, shrink.without_effect, shrink.floor)
        words += f"; gains and tolerances without it, {part(alone)}" if alone > _MUCH else ""
    return f"{words}."


# A gap over its floor that leaves something to take away on single lines.
_PLAINLY = 1.1

# Share of the gap from which it is said what goes without the cause.
_MUCH = 0.5


def _acts_like(diagnosis: Diagnosis) -> str:
    """What one joint stiffness would have to be, where one at a single node explains nearly all of what is right."""
    joint = diagnosis.where.joint
    if joint is None or any(map(must_be_corrected, diagnosis.audit)):
        return "."
    if diagnosis.where.remark or joint.explained < _NEARLY or joint.order.startswith(("none", "too")):
        return "."
    law = joint.order.partition(" (")[0]
    return f"; at node {joint.node} something acts like {law} ({100 * joint.explained:.0f} % of the gap there)."


# Share of the gap from which one joint stiffness is worth a word.
_NEARLY = 0.9


def next_test(
    verdict: Verdict, campaign: Campaign, causes: Sequence[Cause] = (), equivalent: Sequence[Cause] = ()
) -> NextTest | None:
    """The measurement that would tell more, by what the campaign lacks.

    Where several causes remain, ``gap.next_test`` computes which run separates them.
    """
    if verdict == "no_gap":
        return None
    if verdict == "cause" and causes and (words := _AGAIN.get(causes[0].effects)):
        return NextTest(words)
    runs = [run for run in campaign.runs if run.support == "bearing"] or list(campaign.runs)
    run = max(runs, key=lambda r: r.force_amplitude_N or 0.0)
    settings = {"support": run.support, "excitation_node": run.excitation_node}
    settings |= {"excitation_plane": run.excitation_plane} if run.excitation_plane != "y" else {}
    settings |= {"force_amplitude_N": run.force_amplitude_N} if run.force_amplitude_N else {}
    if verdict == "not_enough_data":
        words = f"Measure the rotor on {supports(run.support)} again, at fifty lines or more from below its first "
        words += "resonance to above its second, and mend what the audit finds dead"
        return NextTest(f"{words}: of so few values nothing follows.", settings)
    there = {run.support for run in campaign.runs}
    for support in SUPPORTS:
        if support not in there:
            words = f"Measure the rotor on {supports(support)} too: what acts in the bearings shows on them alone."
            return NextTest(words, settings | {"support": support})
    structure = load_rig(campaign.rig)
    sensors = {channel.node for run in campaign.runs for channel in run.channels}
    if more := _spread(structure, sensors, max(_SENSORS - len(sensors), 0)):
        nodes = " and ".join(map(str, sorted(more)))
        words = f"Measure at {'nodes' if len(more) > 1 else 'node'} {nodes} too"
        return NextTest(f"{words}: with few accelerometers several places explain the same gap.", settings)
    levels = {run.force_amplitude_N for run in runs}
    force = run.force_amplitude_N or 1.0
    if len(levels) < 2 and verdict == "unknown":
        words = f"Repeat the run on {supports(run.support)} at a third and at three times the force, once from the "
        words += "highest line down: a nonlinear cause changes with level, a drift of rig or sensors with time."
        return NextTest(words, settings | {"force_amplitude_N": 3 * force})
    if verdict == "unknown" and not any(r.sweep == "down" for r in runs):
        words = f"Repeat the run on {supports(run.support)} at {force:.3g} N from the highest "
        words += "line down: where a law has several motions, or the rig drifts, it comes out otherwise."
        return NextTest(words, settings | {"sweep": "down"})
    elsewhere = _spread(structure, {r.excitation_node for r in runs}, 1)
    if not elsewhere:
        words = f"Repeat the run on {supports(run.support)} with a known mass at a node that moves: "
        return NextTest(words + "what it changes is known, and what the rig makes of it is not.", settings)
    (node,) = elsewhere
    words = f"Drive the rotor on {supports(run.support)} at node {node} instead of {run.excitation_node}"
    words += ", accelerometers as they are"
    if verdict == "cause" and causes:
        words += f": a model with {named(causes[0])} should predict that run."
    elif equivalent:
        words += f": {', '.join(map(named, equivalent))} may part there."
    else:
        words += ": what lies elsewhere shows there in another way."
    return NextTest(words, settings | {"excitation_node": node})


# What to do again where the way of measuring is the cause.
_AGAIN: dict[tuple[str, ...], str] = {
    ("coarse_grid",): "Repeat the runs with lines as close together as the audit asks for under raster: then the peaks "
    "show.",
    ("fast_sweep",): "Repeat the runs and stay longer at each line near the resonances, until the response has "
    "settled: then peaks are as high as they are, and where they are.",
}

# Accelerometers that tell most places apart.
_SENSORS = 3


def _spread(rig: Rig, taken: Collection[int], count: int) -> list[int]:
    """Nodes far from those that are taken and from the supports, one after the other."""
    held = {support.node for support in rig.support}
    chosen: list[int] = []
    for _ in range(count):
        free = [n for n in range(1, len(rig.nodes_m) + 1) if n not in {*taken, *chosen, *held}]
        if not free:
            break
        full = [rig.nodes_m[n - 1] for n in {*taken, *chosen, *held}]
        chosen.append(max(free, key=lambda n: min(abs(rig.nodes_m[n - 1] - x) for x in full)))
    return chosen
