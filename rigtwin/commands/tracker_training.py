"""``rigtwin train --tracker``: let a rig run while its k_b changes, and train the tracker's network on that."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.api.fmus import build_rotor_for_the_rig, is_shipped
from rigtwin.api.rigs import refuse_tables
from rigtwin.commands.training import MEASURED, TrainingPlan, check_numbers, need_torch, prior_of
from rigtwin.console import note, progress, say
from rigtwin.errors import UserError
from rigtwin.estimator.prior import PRIOR, Prior
from rigtwin.estimator.tracking.streams import MASS_OFF, StreamPlan, Streams, make_steady_streams, make_streams
from rigtwin.fmu_src.build import TRACKER, BuildError, build_listener_fmu, reduced_rotor, tracker_facts
from rigtwin.fmu_src.tracker_variables import TRACKER_NETWORK
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.scale_out import executor
from rigtwin.sim.session import FmuError

# Seeds of grid, calibration and network; the training streams have the user's.
_GRID_SEED, _CALIBRATION_SEED, _NETWORK_SEED = 3, 2, 0

# Steps of the rotor's FMU in one of the tracker's; the lowest k_b that is answered for, over the static estimator's;
# and how far training goes beyond.
_FINER, _LOWER, _BEYOND = 2, 0.5, 1.3


@dataclass(frozen=True)
class TrainedTracker:
    """Where everything is that a training made."""

    network: Path
    tracker_fmu: Path
    card: dict[str, Any]


def train_tracker(plan: TrainingPlan, nodes: tuple[int, ...]) -> TrainedTracker:
    """Make streams, train, calibrate, export, build the tracker FMU.

    ``plan.rigs`` and ``plan.calibration_rigs`` are numbers of streams. Raises UserError for a rig that cannot be
    tracked.
    """
    need_torch()
    check_numbers(plan, _CALIBRATION_SEED)
    rig = load_rig(plan.rig)
    refuse_tables(rig, "training")
    nodes = nodes or (rig.excitation_node,)
    drawn, answered = _stream_plan(plan, rig, nodes)
    fmu = build_rotor_for_the_rig(rig, (plan.out / MEASURED).resolve())
    grid, training, calibration = _streams(plan, drawn, fmu)
    trained = _fitted(grid, training, calibration)
    path = plan.out / TRACKER_NETWORK
    card = _card(rig, drawn, answered, plan) | trained.measured
    from rigtwin.estimator.tracking.network_file import export

    export(trained, card, path)
    return TrainedTracker(path, build_listener_fmu(TRACKER, rig, plan.out, nodes, path), card)


def _stream_plan(plan: TrainingPlan, rig: Rig, nodes: tuple[int, ...]) -> tuple[StreamPlan, tuple[float, float]]:
    """What streams are drawn from, and the range of k_b that is answered for [N/m]."""
    structure = assemble(rig)
    prior = PRIOR if is_shipped(rig) else prior_of(plan.rig, rig, structure)
    try:
        rotor = reduced_rotor(rig, structure)
        facts = tracker_facts(rig, rotor, nodes)
    except BuildError as error:
        raise UserError(str(error)) from error
    answered = max(_LOWER * prior.k_b[0], rig.k_b.min_N_per_m), prior.k_b[1]
    return _drawn(rig, prior, answered, facts.step, float(rotor.highest_hz), nodes), answered


def _drawn(
    rig: Rig, prior: Prior, answered: tuple[float, float], step: float, highest_hz: float, nodes: tuple[int, ...]
) -> StreamPlan:
    return StreamPlan(
        step=step,
        finer=_FINER,
        highest_hz=highest_hz,
        nodes=nodes,
        k_b=(max(answered[0] / _BEYOND, rig.k_b.min_N_per_m), min(answered[1] * _BEYOND, rig.k_b.max_N_per_m)),
        shaft_damping_ratio=prior.shaft_damping_ratio,
        bearing_damping=prior.bearing_damping,
    )


def _streams(plan: TrainingPlan, drawn: StreamPlan, fmu: Path) -> tuple[Streams, Streams, Streams]:
    """The grid of the first predictions, and the streams of training and calibration."""
    from rigtwin.estimator.tracking.training import MASSES, STIFFNESSES

    made = []
    try:
        with executor(plan.executor) as pool:
            note("letting the rig run with one k_b each")
            grid = make_steady_streams(fmu, drawn, STIFFNESSES, MASSES, _GRID_SEED, pool)
            for name, n, seed in (
                ("training", plan.rigs, plan.seed), ("calibration", plan.calibration_rigs, _CALIBRATION_SEED)
            ):  # fmt: skip
                with progress(f"making {name} streams", n) as count:
                    made.append(make_streams(fmu, drawn, n, seed, pool, count))
    except FmuError as error:
        raise UserError(f"the rotor's FMU fails while k_b changes: {error}") from error
    return grid, *made


def _fitted(grid: Streams, training: Streams, calibration: Streams) -> Any:
    import torch

    from rigtwin.estimator.tracking.training import EPOCHS, train

    torch.set_num_threads(1)  # sums in another order would make another network
    with progress("fitting the network, epochs", EPOCHS) as count:
        return train(grid, training, calibration, _NETWORK_SEED, count)


def _card(rig: Rig, drawn: StreamPlan, answered: tuple[float, float], plan: TrainingPlan) -> dict[str, Any]:
    """What the file says of itself, but for what was measured on the calibration streams."""
    from rigtwin.estimator.tracking.training import EVERY, GAIN, NOISE

    return {
        "task": "k_b that changes while the machine runs, from force and accelerations",
        "architecture": "energies of 24 filters of force and accelerations as least-squares problems for k_b and mass, "
        "over six spans of time; two small networks that correct and weigh them",
        "licence": "MIT",
        "seed": plan.seed,
        "training_streams": plan.rigs,
        "calibration_streams": plan.calibration_rigs,
        "rig": rig.name,
        "rig_values": rig.model_dump(mode="json"),
        "nodes": list(drawn.nodes),
        "excitation_node": rig.excitation_node,
        "step": EVERY * drawn.step,
        "highest_hz": drawn.highest_hz,
        "k_b": list(answered),
        "training_range": {
            "k_b": list(drawn.k_b),
            "shaft_damping_ratio": list(drawn.shaft_damping_ratio),
            "bearing_damping": list(drawn.bearing_damping),
            "disk_mass_change": [-MASS_OFF, MASS_OFF],
            "gain_std": GAIN,
            "noise": [0.0, NOISE],
        },
    }


def print_trained_tracker(trained: TrainedTracker) -> None:
    """Say what came out."""
    share, off = trained.card["believed_share"], trained.card["median_error_in_ln_k_b"]
    if off is None:
        note("the network believes none of its answers: train it with more streams (--rigs)")
    else:
        words = f"it believes {100 * share:.0f} % of its answers; half of these are within {100 * np.expm1(off):.1f} %"
        say(f"on the calibration streams {words} of k_b")
    for path in (trained.network, trained.tracker_fmu):
        say(str(path))
