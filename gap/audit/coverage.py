"""What a campaign cannot tell, however good its data: notes on what was not measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.geometry import Geometry
from rigtwin.gap.document import Finding
from rigtwin.gap.phrases import listed
from rigtwin.sim.campaign import Campaign

# Measured over expected quasi-static response on rigid supports, where only the drawing counts. Effects
# of a rig change it by some ten per cent; a wrong unit by ten or a thousand.
_UNIT_FACTOR = 2.5

# What the factor says of the unit.
_UNITS = {1 / 9.81: "g instead of m/s^2", 1e3: "mm instead of m, or kN instead of N", 1e6: "um instead of m"}


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


def check_units(p: CheckedRun, geometry: Geometry) -> Iterator[Finding]:
    """Size of the response below the first resonance on rigid supports against the drawing's."""
    unscaled = p.run.quantity == "acceleration"
    if unscaled or not p.resonances or p.run.support != "rigid" or not geometry.knows(p.run):
        return
    expected = geometry.response(p.run, p.f)
    low = p.f < 0.7 * p.resonances[0].frequency_hz
    places = [i for i, c in enumerate(p.channels) if c.plane == p.run.excitation_plane and c.node <= expected.shape[1]]
    places = [i for i in places if p.channels[i].node not in geometry.held_nodes(p.run)]
    if np.count_nonzero(low) < 3 or not places:
        return
    columns = [p.channels[i].node - 1 for i in places]
    if not expected[low][:, columns].all():  # driven at a support, which the audit finds under labels
        return
    ratio = np.abs(p.receptance[low][:, places]) / np.abs(expected[low][:, columns])
    factor = float(np.median(ratio))
    if 1 / _UNIT_FACTOR < factor < _UNIT_FACTOR:
        words = f"The quasi-static response is {factor:.3g} times what the drawing gives."
        yield p.finding("units", "ok", words, factor, _UNIT_FACTOR)
        return
    guess = [name for unit, name in _UNITS.items() if abs(np.log(factor / unit)) < np.log(1.5)]
    hint = f" ({guess[0]}?)" if guess else ""
    words = f"The quasi-static response on rigid supports is {factor:.3g} times what the drawing gives: a unit or a "
    words += f"sensitivity is wrong{hint}; check units of response and force."
    yield p.finding("units", "error", words, factor, _UNIT_FACTOR)
