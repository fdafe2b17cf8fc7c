"""What to measure next, by what the campaign lacks.

Where several causes remain, ``next_run`` computes which run separates them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from rigtwin.gap.answer.sentence import name_cause
from rigtwin.gap.document import Cause, NextTest, Verdict
from rigtwin.gap.phrases import supports
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.sim.campaign import SUPPORTS, Campaign, Run

# Accelerometers that tell most places apart.
SENSORS = 3

Step = tuple[str, dict[str, Any]]  # words, and the settings of a run that change


def missing_test(
    verdict: Verdict, campaign: Campaign, causes: Sequence[Cause] = (), equivalent: Sequence[Cause] = ()
) -> NextTest | None:
    """The measurement that would tell more; None where there is no gap."""
    if verdict == "no_gap":
        return None
    if verdict == "cause" and causes and (remedy := _remedy(causes[0])):
        return NextTest(remedy)
    run = max(_runs_to_repeat(campaign), key=lambda r: r.force_amplitude_N or 0.0)
    words, changed = next(_steps(verdict, campaign, run, _expected(verdict, causes, equivalent)))
    return NextTest(words, _settings(run) | changed)


def _remedy(cause: Cause) -> str:
    """How to measure again where a single effect of the way of measuring is the cause; else empty."""
    return EFFECTS[cause.effects[0]].remedy if len(cause.effects) == 1 else ""


def _runs_to_repeat(campaign: Campaign) -> Sequence[Run]:
    """Runs on bearings, or all where there are none."""
    return [run for run in campaign.runs if run.support == "bearing"] or campaign.runs


def _settings(run: Run) -> dict[str, Any]:
    """As in a ``[[run]]``; what is not known, or taken for granted, is left out."""
    settings: dict[str, Any] = {"support": run.support, "excitation_node": run.excitation_node}
    settings |= {"excitation_plane": run.excitation_plane} if run.excitation_plane != "y" else {}
    return settings | ({"force_amplitude_N": run.force_amplitude_N} if run.force_amplitude_N else {})


def _expected(verdict: Verdict, causes: Sequence[Cause], equivalent: Sequence[Cause]) -> str:
    """What a run with another exciter should show."""
    if verdict == "cause" and causes:
        return f"a model with {name_cause(causes[0])} should predict that run"
    if equivalent:
        return f"{', '.join(map(name_cause, equivalent))} may part there"
    return "what lies elsewhere shows there in another way"


def _steps(verdict: Verdict, campaign: Campaign, run: Run, expected: str) -> Iterator[Step]:
    """What the campaign lacks, the most useful first; at least one."""
    there = f"the run on {supports(run.support)}"
    if verdict == "not_enough_data":
        words = f"Measure the rotor on {supports(run.support)} again, at fifty lines or more from below its first "
        words += "resonance to above its second, and mend what the audit finds dead"
        yield f"{words}: of so few values nothing follows.", {}
    yield from _on_other_supports(campaign)
    yield from _at_more_nodes(campaign)
    if verdict == "unknown":
        yield from _at_other_levels(campaign, there)
        yield from _downwards(campaign, run, there)
    yield from _with_another_exciter(campaign, run, expected)
    words = f"Repeat {there} with a known mass at a node that moves: "
    yield f"{words}what it changes is known, and what the rig makes of it is not.", {}


def _on_other_supports(campaign: Campaign) -> Iterator[Step]:
    used = {run.support for run in campaign.runs}
    for support in SUPPORTS:
        if support not in used:
            words = f"Measure the rotor on {supports(support)} too: what acts in the bearings shows on them alone."
            yield words, {"support": support}


def _at_more_nodes(campaign: Campaign) -> Iterator[Step]:
    sensors = {channel.node for run in campaign.runs for channel in run.channels}
    if more := _far_nodes(load_rig(campaign.rig), sensors, max(SENSORS - len(sensors), 0)):
        words = f"Measure at {'nodes' if len(more) > 1 else 'node'} {' and '.join(map(str, sorted(more)))} too"
        yield f"{words}: with few accelerometers several places explain the same gap.", {}


def _at_other_levels(campaign: Campaign, there: str) -> Iterator[Step]:
    levels = {run.force_amplitude_N for run in _runs_to_repeat(campaign)}
    if len(levels) < 2:
        words = f"Repeat {there} at a third and at three times the force, once from the highest line down: a nonlinear "
        words += "cause changes with level, a drift of rig or sensors with time."
        yield words, {"force_amplitude_N": 3 * (max(level or 0.0 for level in levels) or 1.0)}


def _downwards(campaign: Campaign, run: Run, there: str) -> Iterator[Step]:
    if not any(each.sweep == "down" for each in _runs_to_repeat(campaign)):
        words = f"Repeat {there} at {run.force_amplitude_N or 1.0:.3g} N from the highest line down: where a law has "
        yield f"{words}several motions, or the rig drifts, it comes out otherwise.", {"sweep": "down"}


def _with_another_exciter(campaign: Campaign, run: Run, expected: str) -> Iterator[Step]:
    for node in _far_nodes(load_rig(campaign.rig), {each.excitation_node for each in _runs_to_repeat(campaign)}, 1):
        words = f"Drive the rotor on {supports(run.support)} at node {node} instead of {run.excitation_node}"
        yield f"{words}, accelerometers as they are: {expected}.", {"excitation_node": node}


def _far_nodes(rig: Rig, taken: Collection[int], count: int) -> list[int]:
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
