"""``rigtwin train``: measure rigs through the FMU, train the estimator's network, build its FMU."""

from __future__ import annotations

import warnings
from concurrent.futures import Executor
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.api.fmus import SHIPPED_RIG, build_rotor, build_rotor_for_the_rig, is_shipped, trained_rig
from rigtwin.api.rigs import refuse_tables
from rigtwin.console import note, progress, say
from rigtwin.errors import UserError
from rigtwin.estimator.dataset import FEATURE_PLAN, Dataset, feature_plan, measure_rigs, read_dataset, write_dataset
from rigtwin.estimator.prior import PRIOR, Prior, prior_for
from rigtwin.estimator.runtime import StiffnessEstimator
from rigtwin.fmu_src.build import build_estimator_fmu
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import Rig, load_rig
from rigtwin.rotor.model.structure import Structure
from rigtwin.scale_out import executor
from rigtwin.sim.campaign import MeasurementError

if TYPE_CHECKING:
    from rigtwin.sim.stepped_sine import SweepPlan

# A network learns its mesh's error, too, which is as large as what a shift tells of stiff bearings. So training rigs
# have twice as many elements as the rig. Calibration rigs are others, and of a still finer mesh, at least this fine.
CALIBRATION_RIGS, CALIBRATION_SEED, CALIBRATION_ELEMENTS = 512, 2, 4
NETWORK_SEED = 0

# Largest over smallest k_b of a rig that an estimator is worth training for.
_NARROWEST = 2.0

# The order of sums, and with it the optimiser's path, depends on the number of threads.
_THREADS = 2

TRAINING_CSV, CALIBRATION_CSV, NETWORK = "training.csv", "calibration.csv", "stiffness.onnx"
MEASURED = "measured"  # what an interrupted training goes on from, and the FMUs it measures


@dataclass(frozen=True)
class TrainingPlan:
    """What to train; the defaults give the shipped network."""

    rig: str = SHIPPED_RIG
    rigs: int = 1024
    seed: int = 1
    calibration_rigs: int = CALIBRATION_RIGS
    out: Path = Path("runs/train")
    executor: str | None = None  # "dask://host:port"; default processes here


@dataclass(frozen=True)
class Trained:
    """Where everything is that a training made."""

    network: Path
    rotor_fmu: Path
    estimator_fmu: Path
    card: dict[str, Any]


def train(plan: TrainingPlan) -> Trained:
    """Measure what is not measured yet, train, calibrate, export, build the estimator FMU."""
    need_torch()
    check_numbers(plan, CALIBRATION_SEED)
    rig = load_rig(plan.rig)
    refuse_tables(rig, "training")
    prior, sweep_plan = PRIOR, FEATURE_PLAN
    if not is_shipped(rig):
        structure = assemble(rig)
        prior = prior_of(plan.rig, rig, structure)
        sweep_plan = feature_plan(structure, prior)
    rotor_fmu = build_rotor(rig, plan.out)
    fine = 2 * rig.elements_between_nodes
    finer = max(CALIBRATION_ELEMENTS, 2 * fine)
    measured = (plan.out / MEASURED).resolve()  # workers elsewhere see it under the same path
    learned, judged = (
        build_rotor_for_the_rig(rig, measured / name, elements_between_nodes=n)
        for name, n in (("training", fine), ("calibration", finer))
    )
    with executor(plan.executor) as pool:
        bench = _Bench(pool, prior, sweep_plan, rig.excitation_node, plan.out)
        training = bench.measure("training", learned, plan.rigs, plan.seed)
        calibration = bench.measure("calibration", judged, plan.calibration_rigs, CALIBRATION_SEED)
    network, card = _fit(training, calibration, prior, _about(rig, sweep_plan), plan.out)
    return Trained(network, rotor_fmu, build_estimator_fmu(plan.out, network), card)


def check_numbers(plan: TrainingPlan, calibration_seed: int) -> None:
    """Raises UserError for too few rigs, and for a seed that gives the calibration's."""
    for option, number in (("--rigs", plan.rigs), ("--calibration-rigs", plan.calibration_rigs)):
        if number < 16:
            raise UserError(f"{option} {number}: at least 16 are needed")
    if plan.seed == calibration_seed:
        raise UserError(f"--seed {plan.seed}: the calibration rigs are drawn from that one; take another")


def prior_of(source: str, rig: Rig, structure: Structure) -> Prior:
    """What a rig of the user's is trained for. Raises UserError where its k_b has too narrow a range."""
    limits = rig.k_b.min_N_per_m, rig.k_b.max_N_per_m
    if limits[1] < _NARROWEST * limits[0]:
        raise UserError(
            f"{source}: k_b: from {limits[0]:g} to {limits[1]:g} N/m is too narrow a range to train for; "
            f"widen it to a factor of {_NARROWEST:g}"
        )
    return prior_for(structure, rig.k_b.start_N_per_m, limits)


def train_from_data(out: Path) -> Trained:
    """Train on the data sets that come with rigtwin; nothing is measured."""
    need_torch()
    rig = load_rig(SHIPPED_RIG)
    training, calibration = (read_dataset(shipped_data(name)) for name in (TRAINING_CSV, CALIBRATION_CSV))
    network, card = _fit(training, calibration, PRIOR, _about(rig, FEATURE_PLAN), out)
    return Trained(network, build_rotor(rig, out), build_estimator_fmu(out, network), card)


def shipped_data(name: str) -> Path:
    """A data set that comes with rigtwin, rounded to ten digits. Raises UserError where it was left out."""
    path = Path(str(files("rigtwin.estimator"))) / "data" / name
    if not path.is_file():
        raise UserError(f"{path}: the shipped data set is missing; measure one: rigtwin train without --from-data")
    return path


def need_torch() -> None:
    """Raises UserError where the packages that train are not installed."""
    from importlib.util import find_spec

    missing = [name for name in ("torch", "onnx", "onnxscript") if find_spec(name) is None]
    if missing:
        raise UserError(f"training needs {', '.join(missing)}; install them with: pip install '.[train]' in a clone")


@dataclass(frozen=True)
class _Bench:
    """Where, how and of what data sets are measured."""

    executor: Executor
    prior: Prior
    plan: SweepPlan
    excitation_node: int
    out: Path

    def measure(self, name: str, fmu: Path, n: int, seed: int) -> Dataset:
        """Measure one data set; what OUT/measured holds of it is not measured again."""
        how = {"plan": self.plan, "excitation_node": self.excitation_node, "store": (self.out / MEASURED).resolve()}
        with progress(f"measuring {name} rigs", n) as count:
            try:
                rigs = self.prior.draw(n, seed)
                data = measure_rigs(fmu, rigs, self.executor, progress=count, **how)
            except MeasurementError as error:
                raise UserError(f"a {name} rig shows no usable resonances: {error}") from error
        write_dataset(data, self.out / f"{name}.csv")
        return data


def _about(rig: Rig, plan: SweepPlan) -> dict[str, Any]:
    """What the model card says of the rig; the shipped rig's network says it in words already."""
    if is_shipped(rig):
        return {}
    return {
        "rig": rig.name,
        "excitation_node": rig.excitation_node,
        "band_hz": [plan.f_min_hz, plan.f_max_hz],
        "limits_of_use": f"one rotor geometry: the rig {rig.name} with the force and the accelerometer "
        f"at node {rig.excitation_node}",
    }


def _fit(
    training: Dataset, calibration: Dataset, prior: Prior, about: dict[str, Any], out: Path
) -> tuple[Path, dict[str, Any]]:
    import torch

    from rigtwin.estimator.training import export
    from rigtwin.estimator.training import train as fit

    out.mkdir(parents=True, exist_ok=True)
    note(f"fitting the network to {len(training)} rigs, calibrating it on {len(calibration)}")
    torch.set_num_threads(_THREADS)
    network, card = fit(training, calibration, NETWORK_SEED, prior)
    card = {**card, **about}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # torch's exporter, about itself
        export(network, card, out / NETWORK)
    return out / NETWORK, card


def print_trained(trained: Trained) -> None:
    """Say what came out, and how it compares with the shipped network where both know the same rig."""
    curve1, curve2 = trained.card["curve_errors_in_log_k_b"]
    from_each = f"from Δf1 alone {100 * curve1:.2g} %, from Δf2 alone {100 * curve2:.2g} %"
    say(f"error of k_b on the calibration rigs, without noise: {from_each}")
    if trained_rig(trained.card) == SHIPPED_RIG:
        difference = _difference_from_shipped(trained.network)
        say(f"its k_b differs from the shipped network's by at most {100 * difference:.2g} %")
    for path in (trained.network, trained.estimator_fmu, trained.rotor_fmu):
        say(str(path))


def _difference_from_shipped(network: Path) -> float:
    """Largest relative difference of k_b over the shipped calibration rigs that both call valid."""
    tests = read_dataset(shipped_data(CALIBRATION_CSV)).features.copy()  # (n, 6)
    tests[:, 3:] = 1e-3 * tests[:, :3]
    ours, shipped = StiffnessEstimator(network)(tests), StiffnessEstimator()(tests)
    both = (ours[:, 4] > 0) & (shipped[:, 4] > 0)
    return float(np.max(np.abs(ours[both, 0] / shipped[both, 0] - 1), initial=0.0))
