"""How well the estimator does on rigs it has never seen: ``python -m benchmarks.estimator_accuracy``.

Writes docs/estimator.md. About ten minutes on two cores: 200 rigs with a finer mesh than the
training rigs, measured through the FMU by the virtual rig, without noise and with 1 % noise.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description

from rigtwin.api.fmus import build_rotor_for_the_rig
from rigtwin.estimator.dataset import FEATURE_PLAN, Dataset, measure_rigs, noisy
from rigtwin.estimator.features import FEATURE_NAMES, Features
from rigtwin.estimator.prior import PRIOR
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.estimator.runtime import StiffnessEstimator
from rigtwin.fmu_src.build import build_estimator_fmu
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.scale_out import executor

DOC = Path(__file__).resolve().parent.parent / "docs" / "estimator.md"

# Seeds of the fresh rigs: neither the training's nor the calibration's.
_FRESH_SEED, _OUTSIDE_SEED, _NOISE_SEED = 20_111, 20_112, 17
_FINER_MESH = 4
_FUSED = "both, averaged by their errors"


@dataclass(frozen=True)
class Answers:
    """What the estimator FMU and the baselines say about a set of rigs; arrays are (n,)."""

    truth: np.ndarray
    network: np.ndarray  # (n, 5) outputs of the FMU
    baselines: dict[str, np.ndarray]


def main() -> None:
    """Measure, print, write the page."""
    rig = load_rig("nit-rourkela")
    with tempfile.TemporaryDirectory() as folder:
        fine = build_rotor_for_the_rig(rig, Path(folder) / "fine", elements_between_nodes=_FINER_MESH)
        coarse = build_rotor_for_the_rig(rig, Path(folder) / "coarse")
        ask = _EstimatorFmu(build_estimator_fmu(Path(folder)))
        finder = StiffnessFinder(assemble(rig))
        with executor() as pool:
            fresh = PRIOR.draw(200, _FRESH_SEED, k_b=PRIOR.k_b)
            clean = measure_rigs(fine, fresh, pool)
            loud = measure_rigs(fine, fresh, pool, plan=noisy(FEATURE_PLAN, 0.01, _NOISE_SEED))
            outside = [_outside(coarse, pool, limits) for limits in ((2e5, 9.7e5), (1.03e8, 1e9))]
        sections = [
            _accuracy_section("noise-free", _answers(clean, ask, finder)),
            _accuracy_section("1 % noise on every line", _answers(loud, ask, finder)),
            _validity_section(ask, clean, outside),
        ]
        ask.close()
    drawn = {"undamped": f"{PRIOR.undamped_share:.0%}", "most": f"{PRIOR.bearing_damping[1]:g}"}
    page = "\n".join([_HEAD.format(card=_card_lines(), **drawn), *sections])
    DOC.write_text(page, encoding="utf-8")
    print(page)


class _EstimatorFmu:
    """StiffnessEstimator.fmu asked through fmpy."""

    def __init__(self, path: Path):
        unpacked = extract(str(path))
        self._description = read_model_description(unpacked)
        self._references = {v.name: v.valueReference for v in self._description.modelVariables}
        self._fmu = instantiate_fmu(unpacked, self._description, "CoSimulation")
        self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()
        self._time = 0.0

    def __call__(self, features: np.ndarray) -> np.ndarray:
        """(n, 6) features -> (n, 5) k_b, std, low, high, valid."""
        return np.array([self._one(row) for row in features])

    def _one(self, row: np.ndarray) -> list[float]:
        self._fmu.setReal([self._references[name] for name in FEATURE_NAMES], row.tolist())
        self._fmu.doStep(self._time, 1.0)
        self._time += 1.0
        outputs = [self._references[name] for name in ("k_b", "k_b_std", "k_b_low", "k_b_high")]
        return [*self._fmu.getReal(outputs), self._fmu.getBoolean([self._references["valid"]])[0]]

    def close(self) -> None:
        """Free the instance."""
        self._fmu.freeInstance()


def _outside(fmu: Path, executor: Executor, limits: tuple[float, float]) -> Dataset:
    return measure_rigs(fmu, PRIOR.draw(32, _OUTSIDE_SEED, k_b=limits), executor)


def _answers(data: Dataset, ask: _EstimatorFmu, finder: StiffnessFinder) -> Answers:
    features = [Features(*row) for row in data.features]
    return Answers(
        truth=data.rigs.k_b,
        network=ask(data.features),
        baselines={
            "root finding on the first shift": np.array([finder.from_shift(1, f.delta_f1) for f in features]),
            "root finding on the second shift": np.array([finder.from_shift(2, f.delta_f2) for f in features]),
            _FUSED: np.array([finder.fused(f) for f in features]),
        },
    )


def _accuracy_section(title: str, answers: Answers) -> str:
    inside = (answers.network[:, 2] <= answers.truth) & (answers.truth <= answers.network[:, 3])
    rows = [_row("**estimator FMU**", answers.network[:, 0], answers.truth)]
    rows += [_row(name, k, answers.truth) for name, k in answers.baselines.items()]
    return f"""## {len(answers.truth)} fresh rigs, {title}

| how | median error | 95th percentile | largest |
|---|---|---|---|
{chr(10).join(rows)}

The estimator set `valid` on {np.mean(answers.network[:, 4]):.1%} of the rigs. Its 90 % interval contains the true k_b
on {np.mean(inside):.1%} of them. If the interval is right, this share lies in the range
{_binomial_range(len(answers.truth))} for {len(answers.truth)} rigs (95 % range of the binomial distribution).
{_verdict(answers)}
"""


def _verdict(answers: Answers) -> str:
    """Whether the one-dimensional look-up beats the network."""
    network, look_up = (
        np.median(np.abs(k / answers.truth - 1)) for k in (answers.network[:, 0], answers.baselines[_FUSED])
    )
    better = "better" if look_up < network else "no better"
    return (
        f"If only accuracy counts, root finding is {better} than the network: its median error is {look_up:.3%}, "
        f"that of the network {network:.3%}."
    )


def _row(name: str, k_b: np.ndarray, truth: np.ndarray) -> str:
    error = np.abs(k_b / truth - 1)
    return f"| {name} | {np.median(error):.3%} | {np.quantile(error, 0.95):.3%} | {error.max():.3%} |"


def _binomial_range(n: int) -> str:
    from scipy.stats import binom

    low, high = binom.ppf([0.025, 0.975], n, 0.9) / n
    return f"{low:.1%} to {high:.1%}"


def _validity_section(ask: _EstimatorFmu, clean: Dataset, outside: list[Dataset]) -> str:
    rng = np.random.default_rng(_FRESH_SEED)
    contradictory = _contradictory(clean, rng)
    beyond = np.vstack([d.features for d in outside])
    rows = [
        ("in range, measured", ask(clean.features)[:, 4], "valid"),
        ("k_b below 0.97e6 or above 1.03e8 N/m, measured", ask(beyond)[:, 4], "not valid"),
        ("shifts of two different rigs, k_b at least 5 % apart", ask(contradictory)[:, 4], "not valid"),
        ("amplitude ratio 1.2 x what undamped bearings allow", ask(_too_loud(clean))[:, 4], "not valid"),
        ("relative errors above 0.3", ask(_too_uncertain(clean))[:, 4], "not valid"),
    ]
    table = "\n".join(
        f"| {name} | {len(v)} | {wanted} | {np.mean(v if wanted == 'valid' else 1 - v):.1%} |"
        for name, v, wanted in rows
    )
    return f"""## When the estimator says `valid`

The output `valid` must be true for a measurement of a rig like those of the training, and false for inputs that the
network was not trained for. The table gives the share of the cases in which it was right.

| inputs | cases | wanted | got it right |
|---|---|---|---|
{table}
"""


def _contradictory(clean: Dataset, rng: np.random.Generator) -> np.ndarray:
    """First shift and ratio of one rig with the second shift of another."""
    order = rng.permutation(len(clean))
    apart = np.abs(np.log(clean.rigs.k_b[order] / clean.rigs.k_b)) > 0.05
    mixed = clean.features.copy()
    mixed[:, [1, 4]] = clean.features[order][:, [1, 4]]
    return mixed[apart]


def _too_loud(clean: Dataset) -> np.ndarray:
    undamped = clean.features[clean.rigs.bearing_damping == 0].copy()
    undamped[:, 2] *= 1.2
    return undamped


def _too_uncertain(clean: Dataset) -> np.ndarray:
    vague = clean.features.copy()
    vague[:, 3:] = 0.35 * vague[:, :3]
    return vague


def _card_lines() -> str:
    card = StiffnessEstimator().card
    wanted = ("architecture", "training_rigs", "calibration_rigs", "limits_of_use")
    return "\n".join(f"- {key.replace('_', ' ')}: {card[key]}" for key in wanted)


_HEAD = """# The estimator, measured

This page says how accurate the bearing-stiffness estimator is on rigs that it has not seen during training.
`python -m benchmarks.estimator_accuracy` writes it. The estimator is described by these facts:

{card}

The rigs below were drawn at random with other seeds than those of the training. The bearing stiffness k_b is spread
evenly on a logarithmic scale from 1e6 to 1e8 N/m, and the shaft damping from 0.05 to 0.5 %. Of the rigs, {undamped}
have undamped bearings; the damping of the others is spread evenly up to {most} N s/m.

Each rig was modelled with twice as many elements as the training rigs. The virtual rig measured it through
`RotorRig.fmu`, and the features of that measurement were given to `StiffnessEstimator.fmu`. The tables compare the
estimator with the method that anyone would try first: look up, on the model with six elements, which k_b gives the
measured frequency shift (root finding). That method knows the rotor, but it knows nothing about the damping.
"""


if __name__ == "__main__":
    main()
