"""A campaign made ready: the model of its rig, its runs with their errors, and the recalibrated nominal model."""

from __future__ import annotations

from rigtwin.gap.audit.noise import believed_errors, common_error, scatter_over
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.observed import Observed, observe
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.search.linear import recalibrate
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Campaign, Run

# Elements between two nodes of the diagnosis model, at least: at zeta = 0.1 % a mesh error of 0.02 % is a gap.
# A crack or a hub inside an element needs more of them.
_ELEMENTS, _FINE_ELEMENTS = 2, 8


def elements_between_nodes(rig: str, least: int = _ELEMENTS) -> int:
    """So many, or the rig's own number, if that is larger."""
    return max(least, load_rig(rig).elements_between_nodes)


def structure_of(rig: str, least: int = _ELEMENTS) -> Structure:
    """The campaign's rig, with at least so many elements between two nodes."""
    return assemble(load_rig(rig), elements_between_nodes=elements_between_nodes(rig, least))


def forward_of(campaign: Campaign) -> Forward:
    """The model of a campaign's rig, meshed finely enough for a diagnosis.

    Raises MeasurementError where a run has a node that the rig lacks.
    """
    structure = structure_of(campaign.rig)
    for run in campaign.runs:
        run.check_nodes(structure.n_nodes)
    return Forward(structure, campaign.nominal, structure_of(campaign.rig, _FINE_ELEMENTS))


def _observed(run: Run) -> Observed:
    std = believed_errors(run)
    return observe(run, std, common_error(run), scatter_over(run, std))


def prepared(campaign: Campaign) -> tuple[Problem, Fit]:
    """A campaign's runs with their errors and model, and the recalibrated nominal model."""
    observed = [_observed(run) for run in campaign.runs]
    problem = Problem(forward_of(campaign), observed)
    problem, first = problem.in_si(recalibrate(problem))
    problem.allow_for_tolerances(load_rig(campaign.rig), first.k_b)
    return problem, recalibrate(problem, first)
