"""The model of a campaign's rig, meshed finely enough for a diagnosis."""

from __future__ import annotations

from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.workshop import Workshop
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
    """A rig as drawn, with at least so many elements between two nodes."""
    return assemble(load_rig(rig), elements_between_nodes=elements_between_nodes(rig, least))


def workshop_of(campaign: Campaign) -> Workshop:
    """The campaign's rig and what is known of it."""
    elements, fine = (elements_between_nodes(campaign.rig, least) for least in (_ELEMENTS, _FINE_ELEMENTS))
    return Workshop(load_rig(campaign.rig), campaign.nominal, elements, fine)


def forward_of(campaign: Campaign) -> Forward:
    """The model of a campaign's rig, meshed finely enough for a diagnosis.

    Raises MeasurementError where a run has a node that the rig lacks.
    """
    forward = Forward(workshop_of(campaign))
    for run in campaign.runs:
        run.check_nodes(forward.structure.n_nodes)
    return forward
