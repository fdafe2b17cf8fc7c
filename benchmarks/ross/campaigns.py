"""Blind campaigns whose rotor is ROSS': benchmarks/stored_campaigns.

    OPENBLAS_NUM_THREADS=1 ~/ross-environment/bin/python benchmarks/ross/campaigns.py

ROSS assembles shaft, disks, bearings and pedestals; from its lateral matrices the generator's measurement is taken:
its shaft damping by modes, lines, drift, gains and noise. The span is the drawing's; modulus and disk masses deviate.
Beside the data stands versions.json. A second run writes the same files to the last digit but one.
"""

from __future__ import annotations

import platform
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import model
import numpy as np
import ross as rs

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from rigtwin.blind.generate.case import FREQUENCY_DRIFT, GAIN_TOLERANCE, Case, Run  # noqa: E402
from rigtwin.blind.generate.draw import Draw, empty_case  # noqa: E402
from rigtwin.blind.generate.effects import Effect  # noqa: E402
from rigtwin.blind.generate.folder import HELD_OUT, MEASURED, TRUTH, write_campaign, write_json, write_truth  # noqa: E402
from rigtwin.blind.generate.label import label_of  # noqa: E402
from rigtwin.blind.generate.lines import choose_lines, resonances  # noqa: E402
from rigtwin.blind.generate.machine import Machine, Setting  # noqa: E402
from rigtwin.blind.generate.response import N_DRIFTING  # noqa: E402
from rigtwin.blind.generate.rig import read_rig  # noqa: E402
from rigtwin.blind.generate.sizes import size_ratio  # noqa: E402

OUT = ROOT / "benchmarks" / "stored_campaigns"
RIG = "nit-rourkela"
LINES = 180
DIGITS = 5
DRIVE_NODES = {MEASURED: 2, HELD_OUT: 4}
ELEMENTS = 4  # per span

Change = Callable[[model.Options, Case], model.Options]


@dataclass(frozen=True)
class Hidden:
    """What a campaign hides: the effect as the label says it, and what it changes in ROSS' rotor."""

    effect: Effect | None
    change: Change
    modulus: float = 1.0


def _nothing(options: model.Options, case: Case) -> model.Options:
    return options


def _disks(options: model.Options, change: float) -> model.Options:
    more = tuple((node, change * model.DISK_MASS_KG) for node in model.DISK_NODES)
    return replace(options, masses=(*options.masses, *more))


def _asymmetric(options: model.Options, case: Case) -> model.Options:
    return replace(options, k_b=(case.k_b * 1.06, case.k_b * 0.94))


HIDDEN = {
    "nothing": Hidden(None, _nothing),
    "mass": Hidden(
        Effect("attached_mass", {"mass": 0.08}, 4), lambda o, case: replace(o, masses=(*o.masses, (4, 0.08)))
    ),
    "disks": Hidden(Effect("disk_mass", {"change": 0.03}), lambda o, case: _disks(o, 0.03)),
    "modulus": Hidden(Effect("shaft_modulus", {"factor": 0.97}), _nothing, 0.97),
    "damping": Hidden(Effect("bearing_damping", {"damping": 140.0}), lambda o, case: replace(o, damping=140.0)),
    "asymmetry": Hidden(Effect("bearing_asymmetry", {"asymmetry": 0.06}), _asymmetric),
    "pedestals": Hidden(
        Effect("pedestal_flexibility", {"stiffness": 8e6, "mass": 2.5, "damping": 60.0}),
        lambda o, case: replace(o, pedestal=model.Pedestal(8e6, 2.5, 60.0)),
    ),
    "tension": Hidden(Effect("axial_load", {"force": 6000.0}), lambda o, case: replace(o, axial_force=6000.0)),
}


def machine_of(case: Case, hidden: Hidden, setting: Setting) -> Machine:
    """ROSS' rotor in the plane of the force."""
    model._STEEL = rs.Material(
        name="steel",
        rho=model.DENSITY,
        E=model.YOUNGS_MODULUS_PA * hidden.modulus * (1 + case.workshop.modulus),
        Poisson=model.POISSON,
    )
    deviations = zip(model.DISK_NODES, case.workshop.disk_masses, strict=True)
    options = model.Options(
        k_b=(case.k_b, case.k_b),
        damping=case.c_b,
        masses=tuple((node, deviation * model.DISK_MASS_KG) for node, deviation in deviations),
        elements_per_span=ELEMENTS,
    )
    options = hidden.change(options, case)
    free_free = replace(options, k_b=(0.0, 0.0), pedestal=None)
    system, loose, unloaded = map(model.build, (options, free_free, replace(free_free, axial_force=0.0)))
    n = 4 * len(system.rotor.nodes)
    plane = np.array([*(i for i in range(n) if i % 4 in (0, 3)), *(p[0] for p in system.pedestals)])
    grid = np.ix_(plane, plane)
    M, K, C = system.M[grid], system.K[grid], system.C[grid]
    of_shaft = np.flatnonzero(plane < n)
    K_free, K_shaft = np.zeros_like(K), np.zeros_like(K)  # without supports; and without the axial force
    for target, source in ((K_free, loose), (K_shaft, unloaded)):
        target[np.ix_(of_shaft, of_shaft)] = source.K[np.ix_(plane[of_shaft], plane[of_shaft])]
    at = [int(np.flatnonzero(plane == system.place(node, "y"))[0]) for node in range(1, len(model.NODES_M) + 1)]
    free = np.arange(len(plane))
    if setting.rigid:
        K, C = K_free, np.zeros_like(C)
        free = np.setdiff1d(of_shaft, [at[0], at[-1]])
    keep = np.ix_(free, free)
    read = np.eye(len(plane))[at][:, free]
    drive = np.eye(len(plane))[at[setting.drive_node - 1], free]
    return Machine(M[keep], C[keep], K[keep], K_shaft[keep], case.zeta, drive, read)


def measure(case: Case, hidden: Hidden, drive_node: int, rng: np.random.Generator) -> list[Run]:
    """A rigid run and a bearing run, each with its own force gain and drift."""
    runs = []
    for number, (support, rigid) in enumerate((("rigid", True), ("bearing", False)), start=1):
        setting = case.setting(rigid, drive_node)
        machine = machine_of(case, hidden, setting)
        frequency = choose_lines(resonances(machine), rng, LINES)
        drift = FREQUENCY_DRIFT * rng.standard_normal((2, N_DRIFTING))
        gain = float(GAIN_TOLERANCE * rng.standard_normal())
        omega = 2 * np.pi * frequency
        ideal, actual = (-(omega[:, None] ** 2) * machine.receptance(omega, d)[0] for d in (0 * drift[0], drift[0]))
        actual = actual * (1 + gain) * (1 + np.array(case.sensor_gains))
        runs.append(Run(f"run{number:02d}_{support}_1N", setting, 1.0, frequency, gain, drift, ideal, actual))
    return runs


def write(name: str, hidden: Hidden, seed: int) -> None:
    """One campaign folder with its label."""
    rng, rig = np.random.default_rng((2024, seed)), read_rig(RIG)
    case = replace(empty_case(rig, "W6", rng), quantity="accelerance", with_std=True)
    case = replace(case, workshop=replace(case.workshop, span=0.0))
    ratios: tuple[float, ...] = ()
    if hidden.effect is not None:
        case = replace(case, effects=(hidden.effect,))
        ratios = (size_ratio(rig, case, hidden.effect, rng),)
    runs = {part: measure(case, hidden, node, rng) for part, node in DRIVE_NODES.items()}
    folder = OUT / f"ross_{name}"
    shutil.rmtree(folder, ignore_errors=True)
    for part, each in runs.items():
        write_campaign(folder / part, RIG, case, each, rng, DIGITS)
    write_truth(folder / TRUTH, runs[MEASURED], runs[HELD_OUT], case)
    for part in DRIVE_NODES:
        _shorten(folder / TRUTH / f"{part}.npz")
    label = label_of(Draw(case, ratios), f"ross_{name}", "stored")
    write_json(folder / TRUTH / "label.json", {**label, "source": "ROSS"})
    print(name, ratios)


def _shorten(path: Path) -> None:
    """Single precision is plenty beside noise."""
    with np.load(path) as file:
        arrays = {key: value.astype(np.complex64) if np.iscomplexobj(value) else value for key, value in file.items()}
    arrays |= {key: value.astype(np.float32) for key, value in arrays.items() if key.endswith("/std")}
    np.savez_compressed(path, **arrays)


def main() -> None:
    for seed, (name, hidden) in enumerate(HIDDEN.items()):
        write(name, hidden, seed)
    packages = ("ross-rotordynamics", "numpy", "scipy")
    versions = {"python": platform.python_version(), **{package: version(package) for package in packages}}
    write_json(OUT / "versions.json", versions)


if __name__ == "__main__":
    main()
