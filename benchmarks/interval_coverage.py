"""How often the true k_b lies in the interval: ``python -m benchmarks.interval_coverage [--rigs N] [--page FILE]``.

Fresh rigs come from the blind benchmark's own elements and solver: k_b evenly spread on a logarithmic scale from 1e6 to
1e8 N/m, dampings of the bearings evenly from 0 to 60 N s/m, of the shaft from 0.05 to 0.5 %. Each is measured at node 2
on both supports. The campaign says how well its rig is known and by how much resonances drift, and nothing of its
dampings. The estimator has its three numbers, root finding on the model has the two shifts, and the third method fits
the model to all lines together. The second table is of more rigs and of the estimator alone, whose three numbers are
found in no time.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from scipy.stats import binom

from benchmarks.page import machine, table
from rigtwin.api.estimates import Method, estimate
from rigtwin.blind.generate.lines import choose_lines, resonances
from rigtwin.blind.generate.machine import Setting
from rigtwin.blind.generate.machine import Workshop as MadeRig
from rigtwin.blind.generate.response import N_DRIFTING, machines, reported
from rigtwin.blind.generate.rig import read_rig
from rigtwin.errors import UserError
from rigtwin.estimator.features import Features, features_of_runs
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.estimator.runtime import StiffnessEstimator
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.arrays import FloatArray
from rigtwin.scale_out import executor
from rigtwin.sim.campaign import UNKNOWN_DAMPING, Campaign, Channel, MeasurementError, NominalBelief, Run

NODE, SEED = 2, 20_260
COARSE = np.arange(20.0, 400.1, 2.0)  # the paper's raster
# Of the estimator alone: noise of every line, and ends of ranges of k_b [N/m] and of the bearings' damping [N s/m].
NOISES = (1e-4, 1e-3, 1e-2, 5e-2)
STIFFNESSES, DAMPINGS = (1e6, 3e6, 1e7, 3e7, 1e8), (0.0, 20.0, 40.0, 60.0)
CELL_SEED = 20_261
# By how much ln k_b differs between codes with fine meshes, the aim for an error over its bound, and the rotor by whose
# shifts the bound is found.
OF_THE_MODEL, AIM = 2e-4, 1.15
MODEL = StiffnessFinder(assemble(load_rig("nit-rourkela")))

METHODS: dict[Method, str] = {"network": "estimator", "model": "root finding", "responses": "all lines"}


@dataclass(frozen=True)
class Conditions:
    """What the measurements of a table's row are like."""

    words: str
    noise: float = 0.01  # of every line, relative
    drift: float = 0.0  # of every resonance from run to run
    scatter: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of modulus, span and disks
    coarse: bool = False  # even lines, 2 Hz apart
    with_std: bool = True  # whether the files hold standard errors
    told: bool = True  # whether the campaign says how well its rig is known

    @property
    def belief(self) -> NominalBelief:
        """What the campaign says of this."""
        dampings = {"shaft_damping_tolerance": UNKNOWN_DAMPING, "bearing_damping_tolerance": UNKNOWN_DAMPING}
        if not self.told:
            return NominalBelief(**dampings)
        modulus, span, disks = self.scatter
        return NominalBelief(
            frequency_drift=self.drift,
            modulus_tolerance=modulus,
            span_tolerance=span,
            disk_mass_tolerance=disks,
            **dampings,
        )


CONDITIONS = (
    Conditions("1 % noise"),
    Conditions("0.1 % noise", noise=1e-3),
    Conditions("1 % noise, no standard errors in the files", with_std=False),
    Conditions("1 % noise, resonances drift by 0.01 % between the runs", drift=1e-4),
    Conditions("1 % noise, modulus, span and disks off by 0.05 %", scatter=(5e-4, 5e-4, 5e-4)),
    Conditions("1 % noise, modulus off by 1 %, span by 0.1 %, disks by 0.5 %", scatter=(1e-2, 1e-3, 5e-3)),
    Conditions("1 % noise, lines 2 Hz apart without refinement", coarse=True),
    Conditions("1 % noise, and the campaign says nothing of its rig", told=False),
)


@dataclass(frozen=True)
class Result:
    """One method's answer for one rig; refused where there is no estimate."""

    refused: bool
    valid: bool = False
    log_error: float = math.nan  # of k_b
    log_half: float = math.nan  # half the 90 % interval

    @property
    def covers(self) -> bool:
        """Whether the interval holds the true value."""
        return abs(self.log_error) <= self.log_half


def main() -> None:
    """Measure, print, and write the page if one is asked for."""
    parser = argparse.ArgumentParser(description="How often intervals hold the true k_b.")
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--cells", type=int, default=500, help="rigs of the second table, at four noises each")
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    with executor() as pool:
        rows = [row for c in CONDITIONS for row in _rows(c, options.rigs, pool)]
        cells = _cells(options.cells, pool)
    header = ("measured", "method", "refused", "valid", "90 % interval holds k_b", "median half-width", "median error")
    low, high = (binom(options.rigs, 0.9).ppf(p) / options.rigs for p in (0.025, 0.975))
    text = "\n\n".join(
        (
            (__doc__ or "").split("\n\n")[1],
            f"{options.rigs} rigs a row; {machine()}. Shares and medians are of the valid answers. An offset is the\n"
            f"standard deviation of many rigs. If intervals are right, {100 * low:.0f} to {100 * high:.0f} % of so "
            "many hold the true value.",
            table(header, rows),
            cells,
        )
    )
    print(text)
    if options.page:
        options.page.write_text(f"# Intervals of k_b, measured\n\n{text}", encoding="utf-8")


def _rows(conditions: Conditions, rigs: int, pool: Executor) -> Iterator[tuple[str, ...]]:
    results = list(pool.map(partial(_measured, conditions), range(rigs)))
    for place, words in enumerate(METHODS.values()):
        found = [result[place] for result in results]
        valid = [result for result in found if result.valid]
        yield (
            conditions.words if not place else "",
            words,
            f"{sum(r.refused for r in found)}",
            f"{len(valid)}",
            f"{100 * np.mean([r.covers for r in valid]):.0f} %" if valid else "",
            f"{100 * np.median([r.log_half for r in valid]):.3f} %" if valid else "",
            f"{100 * np.median([abs(r.log_error) for r in valid]):.3f} %" if valid else "",
        )


def _measured(conditions: Conditions, number: int) -> list[Result]:
    """What every method says of one rig."""
    rng = np.random.default_rng([SEED, number])
    k_b = float(np.exp(rng.uniform(*np.log([1e6, 1e8]))))
    damping = rng.uniform(0.0, 60.0), float(np.exp(rng.uniform(*np.log([5e-4, 5e-3]))))
    modulus, span, disks = conditions.scatter
    off = np.array([modulus, span, disks, disks]) * rng.standard_normal(4)
    made = MadeRig(float(off[0]), float(off[1]), (float(off[2]), float(off[3])))
    runs = [
        _run(conditions, Setting(rigid, k_b, *damping, NODE), made, np.random.default_rng([SEED, number, rigid]))
        for rigid in (True, False)
    ]
    campaign = Campaign("one rig", "nit-rourkela", tuple(runs), nominal=conditions.belief)
    return [_asked(campaign, method, k_b) for method in METHODS]


def _cells(rigs: int, pool: Executor) -> str:
    """How often the estimator's interval holds k_b, and its error over the bound, by stiffness, damping and noise."""
    told = np.concatenate(list(pool.map(_by_estimator, range(rigs))))
    k_b, damping, noise, inside, valid, error, bound = told[np.isfinite(told).all(axis=1)].T
    shares, over, rows, errors = [], [], [], []
    for (low, high), (least, most) in product(pairwise(STIFFNESSES), pairwise(DAMPINGS)):
        here = (low <= k_b) & (k_b < high) & (least <= damping) & (damping <= most)
        cells = [here & (noise == one) for one in NOISES]
        span = f"{low / 1e6:g} to {high / 1e6:g}", f"{least:g} to {most:g}"
        held = [inside[cell].mean() for cell in cells]
        pairs = [(_rms(error[cell]), math.hypot(_rms(bound[cell]), OF_THE_MODEL)) for cell in cells]
        shares, over = [*shares, *held], [*over, *(found / limit for found, limit in pairs)]
        rows.append((*span, *(f"{100 * share:.0f} %" for share in held), f"{100 * valid[here].mean():.1f} %"))
        errors.append((*span, *(f"{100 * found:.3f} of {100 * limit:.3f} %" for found, limit in pairs)))
    header = ("k_b, MN/m", "damping, N s/m", *(f"{100 * one:g} % noise" for one in NOISES))
    words = (
        "## The estimator alone",
        f"{len(k_b)} answers for {rigs} rigs: the 90 % interval holds k_b in {100 * inside.mean():.1f} % of them. In "
        f"the cells the shares are {100 * min(shares):.0f} to {100 * max(shares):.0f} %, of some 40 answers each.",
        table((*header, "valid"), rows),
        "The next table has the root mean square error of ln k_b, of the least that an unbiased estimate from these "
        f"two\nshifts can have: their Cramér-Rao bound, and {100 * OF_THE_MODEL:g} % by which codes with other meshes "
        f"differ. The error is {min(over):.2f} to\n{max(over):.2f} times the bound; in "
        f"{sum(each <= AIM for each in over)} of {len(over)} cells at most {AIM:g} times. It may lie below, because "
        "the meshes need not differ by that much.",
        table(header, errors),
    )
    return "\n\n".join(words)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _by_estimator(number: int) -> FloatArray:
    """(n_noises, 7) k_b, damping, noise, whether the interval holds k_b, valid, error of ln k_b, and its bound; nan: no
    features."""
    rng = np.random.default_rng([CELL_SEED, number])
    k_b = float(np.exp(rng.uniform(*np.log([STIFFNESSES[0], STIFFNESSES[-1]]))))
    damping = rng.uniform(DAMPINGS[0], DAMPINGS[-1]), float(np.exp(rng.uniform(*np.log([5e-4, 5e-3]))))
    told = []
    for noise in NOISES:
        exact, seeds = MadeRig(0.0, 0.0, (0.0, 0.0)), ([CELL_SEED, number, rigid] for rigid in (True, False))
        runs = [
            _run(Conditions("", noise), Setting(bool(s[-1]), k_b, *damping, NODE), exact, np.random.default_rng(s))
            for s in seeds
        ]
        try:
            features = features_of_runs(*runs)
            k, _, low, high, valid = StiffnessEstimator()(features.as_array()[None])[0].tolist()
            told.append((k_b, damping[0], noise, low <= k_b <= high, valid, math.log(k / k_b), _bound(features, k_b)))
        except MeasurementError:
            told.append((k_b, damping[0], noise, *[np.nan] * 4))
    return np.array(told, dtype=float)


def _bound(features: Features, k_b: float) -> float:
    """Least standard error of ln k_b that an unbiased estimate from both shifts can have."""
    stds = np.array([features.delta_f1_std, features.delta_f2_std])
    return float(np.sum((MODEL.slopes(k_b) / stds) ** 2) ** -0.5)


def _run(conditions: Conditions, setting: Setting, made: MadeRig, rng: np.random.Generator) -> Run:
    """One run at the driving point."""
    rig, lines = read_rig("nit-rourkela"), COARSE
    drift = conditions.drift * rng.standard_normal((2, N_DRIFTING))
    if not conditions.coarse:
        peaks = [peak for one in machines(rig, setting, (), made) for peak in resonances(one)]
        lines = choose_lines(peaks, rng)
    H = reported(rig, setting, (), lines, made, drift)[:, [NODE - 1]]
    std = conditions.noise * np.abs(H)
    H = H + std * (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) / np.sqrt(2)
    support = "rigid" if setting.rigid else "bearing"
    return Run(lines, H, (Channel(NODE),), support, std=std if conditions.with_std else None, name=support)


def _asked(campaign: Campaign, method: Method, k_b: float) -> Result:
    try:
        found = estimate(campaign, method=method).best.estimate
    except UserError:
        return Result(refused=True)
    half = math.log(found.k_b_high / found.k_b_low) / 2
    return Result(refused=False, valid=found.valid, log_error=math.log(found.k_b / k_b), log_half=half)


if __name__ == "__main__":
    main()
