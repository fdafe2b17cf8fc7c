"""The diagnosis in words."""

from __future__ import annotations

from collections.abc import Sequence

from gap.diagnosis import Cause, Diagnosis, Location, NextTest, Verdict
from rotor.effects.library import EFFECTS
from sim.campaign import Campaign


def place(location: Location) -> str:
    """A location as it stands in a sentence."""
    if location.node is not None:
        return f"at node {location.node}"
    if location.x_m is not None:
        return f"at x = {1e3 * location.x_m:.0f} mm"
    return {
        "bearings": "at the bearings",
        "disks": "at the disks",
        "shaft": "in the shaft",
        "sensor": "at the sensors",
        "exciter": "at the exciter",
        "rigid_support": "at the rigid supports",
        "raster": "in the frequency raster",
    }.get(location.kind, "")


def named(cause: Cause) -> str:
    """Effects of a cause, each with its place."""
    locations = cause.locations or (cause.location,)
    return " and ".join(
        f"{EFFECTS[effect].title.lower()} {place(where)}".strip()
        for effect, where in zip(cause.effects, locations, strict=False)
    )


def sentence(diagnosis: Diagnosis) -> str:
    """The verdict in a sentence."""
    if diagnosis.verdict == "no_gap":
        return "Model and measurement agree within the noise: there is nothing to explain."
    if diagnosis.verdict == "not_enough_data":
        return "The data are too few to tell one cause from another."
    if diagnosis.verdict == "unknown":
        return "There is a gap, and none of the known effects explains it."
    shrink = diagnosis.shrink
    tail = f": it takes away {100 * shrink.explainable:.0f} % of the gap that can be explained." if shrink else "."
    first = named(diagnosis.causes[0])
    if diagnosis.verdict == "cause":
        return f"The gap comes from {first} (probability {100 * diagnosis.causes[0].probability:.0f} %){tail}"
    others = ", or ".join(named(cause) for cause in diagnosis.equivalent) or first
    return f"These data cannot tell apart {others}; the first{tail}"


def next_test(
    verdict: Verdict, campaign: Campaign, causes: Sequence[Cause], equivalent: Sequence[Cause]
) -> NextTest | None:
    """The measurement that would tell more."""
    supports = {run.support for run in campaign.runs} | {peaks.support for peaks in campaign.peaks}
    if verdict == "no_gap":
        return None
    if missing := {"rigid", "bearing"} - supports:
        support = missing.pop()
        words = f"Measure the rotor on {support} supports too: an effect of the bearings cannot act on rigid ones."
        return NextTest(words, {"support": support, "excitation_node": 2, "force_amplitude_N": 1.0})
    sensors = {channel.node for run in campaign.runs for channel in run.channels}
    if len(sensors) < 3:
        words = "Measure at more nodes: with few accelerometers several places explain the same gap."
        return NextTest(words, {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 1.0})
    levels = {run.force_amplitude_N for run in campaign.runs if run.support == "bearing"}
    if len(levels) < 2 and verdict in ("unknown", "ambiguous"):
        words = (
            "Repeat the run on bearings at a third and at three times the force: a nonlinear cause changes with level."
        )
        return NextTest(words, {"support": "bearing", "excitation_node": 2, "force_amplitude_N": 3.0})
    if verdict in ("ambiguous", "unknown"):
        words = "Drive the rotor at another node, and once more with a known mass clamped to it."
        return NextTest(words, {"support": "bearing", "excitation_node": 4, "force_amplitude_N": 1.0})
    words = "Repeat the run with the shaker at another node: the corrected model should predict it."
    return NextTest(words, {"support": "bearing", "excitation_node": 4, "force_amplitude_N": 1.0})
