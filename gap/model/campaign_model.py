"""The model of a campaign's rig, meshed finely enough for a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.workshop import Workshop
from rigtwin.rotor.effects.scale import scale_of
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.structure import Structure
from rigtwin.sim.campaign import UNKNOWN_DAMPING, Campaign, NominalBelief

# Elements between two nodes of the diagnosis model, at least: at zeta = 0.1 % a mesh error of 0.02 % is a gap. Two
# are too few for the second mode of a stout rotor. A crack or a hub inside an element needs more of them.
_ELEMENTS = 3
_FINE_ELEMENTS = 8


@dataclass(frozen=True)
class GuessedDamping:
    """Damping of bearings that nobody states; ball bearings have 0.05 to 5 % of the critical one."""

    share: float = 3e-3  # of the critical damping of the rotor's mass on k_b
    tolerance: float = 1.5  # standard deviation of its logarithm


_GUESS = GuessedDamping()


def elements_between_nodes(rig: Rig, least: int = _ELEMENTS) -> int:
    """So many, or the rig's own number, if that is larger."""
    return max(least, rig.elements_between_nodes)


def structure_of(rig: str, least: int = _ELEMENTS) -> Structure:
    """A rig as drawn, with at least so many elements between two nodes."""
    drawn = load_rig(rig)
    return assemble(drawn, elements_between_nodes=elements_between_nodes(drawn, least))


def workshop_of(campaign: Campaign) -> Workshop:
    """The campaign's rig and what is known of it."""
    rig = load_rig(campaign.rig)
    elements, fine = (elements_between_nodes(rig, least) for least in (_ELEMENTS, _FINE_ELEMENTS))
    return Workshop(rig, believed(campaign.nominal, rig), elements, fine)


def believed(belief: NominalBelief, rig: Rig) -> NominalBelief:
    """What is believed of a rig; of bearings whose damping neither campaign nor rig file states, a vague guess."""
    if belief.bearing_damping_Ns_per_m or belief.bearing_damping_tolerance < UNKNOWN_DAMPING:
        return belief
    critical = 2 * float(np.sqrt(rig.k_b.start_N_per_m * scale_of(assemble(rig)).mass))
    return replace(
        belief,
        bearing_damping_Ns_per_m=_GUESS.share * critical,
        bearing_damping_tolerance=max(belief.bearing_damping_tolerance, _GUESS.tolerance),
    )


def forward_of(campaign: Campaign) -> Forward:
    """The model of a campaign's rig, meshed finely enough for a diagnosis.

    Raises MeasurementError where a run has a node that the rig lacks.
    """
    forward = Forward(workshop_of(campaign))
    campaign.check_nodes(forward.structure.n_nodes)
    return forward
