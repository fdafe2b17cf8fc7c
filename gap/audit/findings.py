"""The audit of a measured campaign, and the campaign as it is diagnosed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rigtwin.gap.audit import one_run
from rigtwin.gap.audit.checked_run import CheckedRun, checked_runs, without_dropped_values
from rigtwin.gap.audit.coverage import check_coverage
from rigtwin.gap.audit.geometry import Geometry, geometry_of
from rigtwin.gap.audit.labels import check_labels
from rigtwin.gap.audit.pairs import check_pairs, is_copy
from rigtwin.gap.audit.phase import check_delay, check_sign, find_delays
from rigtwin.gap.audit.wild import check_wild_lines, drop_wild_lines, without_wild_lines
from rigtwin.gap.document import Finding
from rigtwin.sim.campaign import Campaign, NominalBelief

# Checks that only make sense where nodes, exciter and quantity are labelled correctly.
_OF_RIGHT_NAMES = ("delay", "sign", "units")

# Checks that only make sense for linear rigs.
_OF_LINEAR_RIGS = ("delay", "raster")


def audit(campaign: Campaign) -> tuple[Finding, ...]:
    """Look at every run by itself, at runs together, and at what was not measured.

    Returns
    -------
    findings in that order; "ok" for a check that passed, "note" for what limits a conclusion,
    "warning" for data that may mislead, "error" for data that will
    """
    geometry = geometry_of(campaign.rig)
    as_measured = checked_runs(campaign.runs)
    runs = tuple(drop_wild_lines(p) for p in as_measured)
    with np.errstate(all="ignore"):
        telling = [_drop_dead_channels(p, geometry) for p in runs]
        findings = [f for p, left in zip(as_measured, runs, strict=True) for f in _check_all_lines(p, left)]
        for p, left in zip(runs, telling, strict=True):
            findings += _check_run(p, left or p, campaign.nominal, geometry)
        findings += check_pairs(runs, campaign.nominal)
        named = list(check_labels([p for p in telling if p], geometry))
        findings = [*_drop_findings_of_wrong_names(findings, named), *named]
        findings += check_coverage(campaign, runs, geometry)
    return tuple(_drop_findings_of_bent_peaks(findings))


def usable(campaign: Campaign) -> Campaign:
    """The campaign as it is diagnosed: no dropped or wild values, no dead channels or runs, and every run only once."""
    geometry = geometry_of(campaign.rig)
    once = [run for k, run in enumerate(campaign.runs) if not any(is_copy(run, other) for other in campaign.runs[:k])]
    tame = without_wild_lines([without_dropped_values(run) for run in once])
    runs = [(run, one_run.telling_channels(run, geometry)) for run in tame]
    alive = [(run, telling) for run, telling in runs if not one_run.is_dead(run, telling, geometry)] or runs
    return replace(campaign, runs=tuple(one_run.without_dead_channels(run, telling) for run, telling in alive))


def _check_all_lines(p: CheckedRun, left: CheckedRun) -> Iterator[Finding]:
    """Checks that look at all lines of a run, the wild ones among them; ``left`` is the run without these."""
    yield from check_wild_lines(p, left)
    if len(p.lines):
        yield from one_run.check_saturation(p)


def _check_run(p: CheckedRun, telling: CheckedRun, belief: NominalBelief, geometry: Geometry) -> Iterator[Finding]:
    """Checks of a single run; phase and size are judged by ``telling``, the run without dead channels."""
    yield from one_run.check_channels(p, geometry)
    yield from one_run.check_missing_lines(p)
    if not len(p.lines):
        return
    yield from one_run.check_raster(p, belief)
    yield from one_run.check_noise(p)
    yield from one_run.check_sweep_rate(p)
    delays = None if p.run.spin_rpm else find_delays(telling)
    yield from check_delay(telling, delays)
    yield from check_sign(telling, geometry, delays)


def _drop_dead_channels(p: CheckedRun, geometry: Geometry) -> CheckedRun | None:
    """A run without dead channels; None where nothing is left."""
    telling = one_run.telling_channels(p.run, geometry)
    if one_run.is_dead(p.run, telling, geometry):
        return None
    run = one_run.without_dead_channels(p.run, telling)
    return p if run is p.run else CheckedRun(run, p.label)


def _drop_findings_of_wrong_names(findings: Sequence[Finding], named: Sequence[Finding]) -> Iterator[Finding]:
    """Leave out findings on delay, sign and units of runs with wrong labels: these look like such faults."""
    wrong = {label for f in named if f.severity == "error" for label in f.run.split(", ")}
    return (f for f in findings if f.run not in wrong or f.check not in _OF_RIGHT_NAMES)


def _drop_findings_of_bent_peaks(findings: Sequence[Finding]) -> Iterator[Finding]:
    """Leave out findings on delay and raster of runs that depend on the force: bent peaks and jumps look like these."""
    bent = {label for f in findings if _shows_a_law(f) for label in f.run.split(", ")}
    for finding in findings:
        if finding.run not in bent or finding.check not in _OF_LINEAR_RIGS:
            yield finding
    for label in sorted(bent):
        words = "Peaks bend with the force here: neither a delay nor a half-power band could be told from that."
        yield Finding("delay", "note", words, label)


def _shows_a_law(finding: Finding) -> bool:
    """Whether a finding says that runs at different levels differ by more than noise; too few lines say nothing."""
    return finding.check == "level" and finding.severity != "ok" and finding.value is not None


def amplitude_dependent(findings: Sequence[Finding]) -> bool:
    """Whether the audit saw runs at different levels differ by more than their noise."""
    return any(map(_shows_a_law, findings))
