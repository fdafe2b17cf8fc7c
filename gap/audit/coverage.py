"""What a campaign cannot tell, however good its data: notes on what was not measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.geometry import Geometry
from rigtwin.gap.document import Finding
from rigtwin.gap.phrases import listed
from rigtwin.sim.campaign import Campaign


def check_coverage(campaign: Campaign, runs: Sequence[CheckedRun], geometry: Geometry) -> Iterator[Finding]:
    """Notes on supports, levels, sensors and kinds of data."""
    if not runs:
        what = "only lists of resonances" if campaign.peaks else "neither a run nor a list of resonances"
        severity = "note" if campaign.peaks else "error"
        words = f"The campaign holds {what}: damping, place and shape of a gap cannot be told; measure a run."
        yield Finding("coverage", severity, words)
    if runs and campaign.peaks:
        words = "Lists of resonances beside runs are not used"
        yield Finding("coverage", "note", f"{words}: the runs hold more; leave out the runs to look at the lists.")
    supports = {each.support for each in (campaign.runs or campaign.peaks)}
    if len(supports) == 1:
        missing = "bearing" if supports == {"rigid"} else "rigid"
        words = f"Only {supports.pop()} supports were measured: causes on shaft and at supports cannot be told apart"
        yield Finding("coverage", "note", f"{words}; measure on {missing} supports too.")
    elif len(supports) == 2:
        yield Finding("coverage", "ok", "Both rigid and bearing supports were measured.")
    levels = {(p.run.support, p.run.excitation_node, p.run.force_amplitude_N) for p in runs}
    if runs and len({(s, n) for s, n, _ in levels}) == len(levels):
        words = "Each test was run at one force level only, so a dependence on amplitude cannot be seen"
        yield Finding("coverage", "note", f"{words}; repeat one at another level.")
    for p in runs:
        yield from _run_coverage(p, geometry)


def _run_coverage(p: CheckedRun, geometry: Geometry) -> Iterator[Finding]:
    run = p.run
    nodes = {c.node for c in p.channels}
    if len(nodes) == 1:
        words = "Only one node carries a response, so the place of a gap cannot be told from sensors"
        yield p.finding("coverage", "note", f"{words}; measure at more nodes.", 1.0)
    elif not nodes:
        yield p.finding("coverage", "error", "No channel of this run carries a response; it cannot be used.", 0.0)
    if geometry.n_nodes is not None:
        held = geometry.held_nodes(run)
        missing = sorted(set(range(1, geometry.n_nodes + 1)) - held - {c.node for c in run.channels})
        if missing and len(nodes) > 1:
            words = f"Node{'s' if len(missing) > 1 else ''} {listed(missing)} carried no sensor; a gap that shows there"
            yield p.finding("coverage", "note", f"{words} only is not seen.", float(len(missing)))
        beyond = sorted(c.node for c in run.channels if c.node > geometry.n_nodes)
        if beyond:
            words = f"Node {listed(beyond)} does not exist: the rig has {geometry.n_nodes} nodes"
            yield p.finding("coverage", "error", f"{words}; correct the channel's name.")
    if run.magnitude_only:
        words = "Magnitudes only: polarity, delay and phase errors cannot be seen, and damping less well"
        yield p.finding("coverage", "note", f"{words}; record the phase against the force.")
    if run.quantity == "acceleration":
        words = "Accelerations are not referred to a measured force: level and drop of the force at resonances are open"
        yield p.finding("coverage", "note", f"{words}; add a force sensor.")
    if run.force_amplitude_N is None:
        words = "The force amplitude was not recorded, so this run says nothing on amplitude dependence"
        yield p.finding("coverage", "note", f"{words}; write it down.")
    driven = (run.excitation_node, run.excitation_plane)
    if nodes and driven not in {(c.node, c.plane) for c in p.channels}:
        words = f"The drive point, node {run.excitation_node}, carried no sensor: passivity and exciter are not checked"
        yield p.finding("coverage", "note", f"{words}; add one there.")
