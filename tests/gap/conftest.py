"""Small synthetic campaigns, made by the rotor and not by the model that is tested."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.gap.answer.report import Outcome
from rigtwin.gap.diagnose import diagnose
from rigtwin.gap.inference.hypotheses import Hypothesis, candidates
from rigtwin.gap.inference.observed import observe
from rigtwin.gap.inference.problem import Problem
from rigtwin.gap.model.campaign_model import elements_between_nodes, structure_of, workshop_of
from rigtwin.gap.model.forward import Forward
from rigtwin.gap.model.workshop import Workshop
from rigtwin.rotor.effects import EFFECTS, AttachedMass, BearingCubic, Effect
from rigtwin.rotor.frequency.measured import measured_response
from rigtwin.rotor.frequency.modal import damped_modes
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.arrays import ComplexArray, FloatArray
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.campaign import Campaign, Channel, NominalBelief, Run

RIG = "nit-rourkela"


def workshop(belief: NominalBelief) -> Workshop:
    """The shipped rig, and what is known of it."""
    return workshop_of(Campaign("", RIG, nominal=belief))


STRUCTURE = structure_of(RIG)
ELEMENTS = elements_between_nodes(load_rig(RIG))
# A workshop that knows its rotor to 0.1 % and its dampings exactly, and whose runs repeat as it says.
BELIEF = NominalBelief(
    shaft_damping_ratio=0.003,
    bearing_damping_Ns_per_m=20.0,
    frequency_drift=1e-4,
    gain_repeatability=0.0,
    modulus_tolerance=6e-4,
    disk_mass_tolerance=6e-4,
    span_tolerance=6e-4,
    shaft_damping_tolerance=0.0,
    bearing_damping_tolerance=0.0,
)
WORKSHOP = workshop(BELIEF)
TOLERANCES = WORKSHOP.names
K_B = 2e6
NOISE = 0.01
CHANNELS = tuple(Channel(node) for node in range(1, 8))
LINEAR = [key for key, effect in EFFECTS.items() if effect.family in ("structure", "support", "chain")]


def condition(support: str, drive: int = 2, k_b: float = K_B) -> Condition:
    """What the rotor is measured under."""
    return Condition(
        k_b=k_b,
        rigid_support=support == "rigid",
        bearing_damping=BELIEF.bearing_damping_Ns_per_m,
        shaft_damping_ratio=BELIEF.shaft_damping_ratio or 0.0,
        excitation_node=drive,
    )


def lines(support: str, effects: Sequence[Effect] = ()) -> FloatArray:
    """Some 80 lines from 20 to 400 Hz, most of them round the resonances of the rotor with and without effects."""
    places = np.array([-16, -8, -4, -2, -1.4, -1, -0.6, -0.3, 0, 0.3, 0.6, 1, 1.4, 2, 4, 8, 16])
    found = [np.linspace(20, 400, 39)]
    for acting in ((), tuple(effects)):
        modes = damped_modes(build_system(STRUCTURE, condition(support), acting))
        for f, zeta in zip(modes.frequency_hz, modes.damping_ratio, strict=True):
            found.append(f * (1 + zeta * places))
    every = np.unique(np.round(np.concatenate(found), 6))
    return every[(every >= 20) & (every <= 400)]


def rebuilt(tolerance: str, size: float) -> Rig:
    """The rig as a workshop makes it that is off by so much."""
    rig, more = load_rig(RIG), 1 + size
    segment, disk = rig.segment, rig.disk
    if tolerance == "modulus":
        segment = [s.model_copy(update={"youngs_modulus_Pa": more * s.youngs_modulus_Pa}) for s in segment]
        return rig.model_copy(update={"segment": segment})
    if tolerance == "span":
        segment = [s.model_copy(update={"length_m": more * s.length_m}) for s in segment]
        return rig.model_copy(update={"segment": segment, "nodes_m": [more * x for x in rig.nodes_m]})
    number = int(tolerance[-1]) - 1
    disks = [
        d.model_copy(update={"density_kg_per_m3": more * d.density_kg_per_m3}) if k == number else d
        for k, d in enumerate(disk)
    ]
    return rig.model_copy(update={"disk": disks})


def blank(support: str, frequency_hz: FloatArray, **settings) -> Run:
    """A run of which only the lines and the setting matter."""
    channels = settings.pop("channels", CHANNELS)
    return Run(frequency_hz, np.zeros((len(frequency_hz), len(channels)), dtype=complex), channels, support, **settings)


def truth(run: Run, effects: Sequence[Effect] = (), drift: float = 0.0, k_b: float = K_B) -> ComplexArray:
    """What the rotor's own solver says of a run; all of its resonances may lie a little higher."""
    return measured_response(
        STRUCTURE,
        condition(run.support, run.excitation_node, k_b),
        effects,
        run.frequency_hz / (1 + drift),
        [channel.node for channel in run.channels],
        quantity=run.quantity,
        force_amplitude=run.force_amplitude_N or 1.0,
    )


def measure(
    support: str,
    effects: Sequence[Effect] = (),
    *,
    seed: int = 0,
    noise: float = NOISE,
    gain=1.0,
    drift=0.0,
    **settings,
) -> Run:
    """A run with noise, as in ``with_noise``."""
    run = blank(support, settings.pop("frequency_hz", lines(support, effects)), name=f"{support}-{seed}", **settings)
    return with_noise(run, gain * truth(run, effects, drift), seed, noise)


def with_noise(run: Run, H: ComplexArray, seed: int, noise: float = NOISE) -> Run:
    """The run with these values, noise in proportion to each, and the standard errors that belong to it."""
    rng = np.random.default_rng(seed)
    error = (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) / np.sqrt(2)
    std = noise * np.abs(H)
    return replace(run, H=H + std * error, std=std)


def both_supports(*effects: Effect, seed: int = 0, **settings) -> tuple[Run, Run]:
    """The rotor on rigid supports and on its bearings."""
    return measure("rigid", effects, seed=seed, **settings), measure("bearing", effects, seed=seed + 1, **settings)


def campaign_of(*runs: Run) -> Campaign:
    return Campaign("synthetic", RIG, runs, nominal=BELIEF)


def problem_of(*runs: Run) -> Problem:
    """The fitting problem of runs whose errors are known."""
    return Problem(Forward(WORKSHOP), [observe(run, run.std) for run in runs])  # type: ignore[arg-type]


def candidate(runs: Sequence[Run], name: str, node: int | None = None) -> Hypothesis:
    """One effect of the library at one place."""
    nodes = {None if h.terms[0].fixed == () else h.terms[0].fixed[0][1]: h for h in of(runs, name)}
    return nodes[node]


def of(runs: Sequence[Run], *names: str) -> tuple[Hypothesis, ...]:
    """Candidates of some effects alone."""
    return candidates(runs, STRUCTURE, all_but(*names))


def all_but(*names: str) -> tuple[str, ...]:
    """What to exclude so that only these effects are left."""
    return tuple(key for key in EFFECTS if key not in names)


# What the campaigns' diagnoses may choose from: enough to be wrong, and few enough to be fast.
MASS = AttachedMass(mass=0.1, node=3)
RIVALS = ("attached_mass", "disk_mass", "shaft_modulus")

# A law that bends the resonances, and the forces [N] at which it does so more and more.
CUBIC = BearingCubic(stiffness=1e15)
LEVELS = (0.05, 0.2, 0.8)


@pytest.fixture(scope="session")
def weighed() -> Outcome:
    """Diagnosis of a rotor with a mass of 100 g at node 3."""
    return diagnose(campaign_of(*both_supports(MASS, seed=3)), exclude=all_but(*RIVALS))
