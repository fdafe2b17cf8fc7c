"""k_b from whole responses: the nominal model fitted to every line, and all that a workshop does not know beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rigtwin.gap.audit.findings import usable
from rigtwin.gap.inference.posterior import posterior
from rigtwin.gap.prepare import prepared
from rigtwin.gap.verdict.adequacy import judge
from rigtwin.gap.verdict.standing import excess_of, scale_of
from rigtwin.sim.campaign import Campaign, MeasurementError


@dataclass(frozen=True)
class ResponseFit:
    """What the responses of a campaign tell of k_b where the nominal model is right but for its tolerances."""

    k_b: float  # [N/m]
    log_std: float  # standard error of its logarithm, the Cramér-Rao bound of all lines [kay1993]
    misfit: float  # mean square of what is left, over that of the noise
    explained: bool  # whether noise alone is left, by tolerances that are plausible
    unusual: Mapping[str, float]  # repeatabilities, by key of [nominal], that the runs tell and that may hide a gap


def fit_responses(campaign: Campaign) -> ResponseFit:
    """Fit k_b, dampings, tolerances, gains and drifts of the nominal model to all lines of a campaign together.

    Raises MeasurementError where no run is on bearings, or one has a node that the rig lacks.
    """
    if not any(run.support == "bearing" for run in campaign.runs):
        raise MeasurementError(f"campaign {campaign.title!r}: no run on bearings says anything about k_b")
    problem, nominal = prepared(usable(campaign))
    quality = judge(problem, nominal)
    scale = max(scale_of(quality), quality.misfit**0.5, 1.0)  # what is left counts as noise
    learned = [(each, each.of(nominal.prior_std)) for each in problem.nuisances.learned]
    return ResponseFit(
        k_b=nominal.k_b,
        log_std=float(posterior(problem, nominal, scale).std[0]),
        misfit=float(quality.misfit),
        explained=excess_of(problem, nominal, quality) < 1,
        unusual={each.name: size for each, size in learned if each.is_unusual(size)},
    )
