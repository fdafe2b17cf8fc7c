"""The model of a campaign's rig, meshed finely enough for a diagnosis."""

from __future__ import annotations

from rigtwin.gap.model.forward import Forward
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import Campaign

# Elements between two nodes of the diagnosis model, at least: at zeta = 0.1 % a mesh error of 0.02 % is a gap.
# A crack or a hub inside an element needs more of them.
_ELEMENTS = 2
_FINE_ELEMENTS = 8


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
