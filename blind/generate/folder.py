"""A blind campaign on disk: ``measured`` and ``held_out`` for the diagnosis, ``truth`` for the scorer alone."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rigtwin.blind.generate.case import Case, Run, standard_error
from rigtwin.blind.generate.rig import ComplexArray, FloatArray

MEASURED, HELD_OUT, TRUTH = "measured", "held_out", "truth"


def write_campaign(
    folder: Path, rig_name: str, case: Case, runs: Sequence[Run], rng: np.random.Generator, digits: int = 10
) -> None:
    """``campaign.toml`` and a CSV for each run, with noise."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f'title = "{folder.parent.name}"', f'rig = "{rig_name}"', "", "[nominal]"]
    lines += [f"{key} = {value!r}" for key, value in stated(case).items()]
    for run in runs:
        lines += [
            "",
            "[[run]]",
            f'file = "{run.name}.csv"',
            f'support = "{"rigid" if run.setting.rigid else "bearing"}"',
            f"excitation_node = {run.setting.drive_node}",
            f"force_amplitude_N = {float(run.level)!r}",
            "spin_rpm = 0.0",
            f'quantity = "{case.quantity}"',
            'sweep = "up"',
        ]
        scale = run.level if case.quantity == "acceleration" else 1.0
        std = standard_error(run.actual, case.noise)
        noise = rng.standard_normal((*std.shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
        columns = [n - 1 for n in case.nodes]
        values = scale * (run.actual + std * noise)[:, columns]
        write_csv(
            folder / f"{run.name}.csv",
            run.frequency_hz,
            values,
            case.nodes,
            scale * std[:, columns] if case.with_std else None,
            digits,
        )
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def stated(case: Case) -> Mapping[str, float]:
    """The keys of [nominal]: what the case says that a workshop states, or else everything, exactly as it is."""
    if case.stated is not None:
        return case.stated
    tolerances = case.tolerances
    return {
        "shaft_damping_ratio": case.zeta,
        "bearing_damping_Ns_per_m": case.c_b,
        "gain_tolerance": tolerances.gain,
        "frequency_drift": tolerances.drift,
        "gain_repeatability": tolerances.repeatability,
        "modulus_tolerance": float(f"{tolerances.modulus:.3g}"),
        "disk_mass_tolerance": float(f"{tolerances.disk_mass:.3g}"),
        "span_tolerance": float(f"{tolerances.span:.3g}"),
        "shaft_damping_tolerance": tolerances.shaft_damping,
        "bearing_damping_tolerance": tolerances.bearing_damping,
    }


def write_csv(
    path: Path,
    frequency_hz: FloatArray,
    values: ComplexArray,
    nodes: Sequence[int],
    std: FloatArray | None,
    digits: int = 10,
) -> None:
    """The campaign format's CSV: re and im of every node, then their standard errors."""
    header = ["frequency_Hz", *(f"node{n}_{part}" for n in nodes for part in ("re", "im"))]
    table = [frequency_hz[:, None], np.stack([values.real, values.imag], axis=2).reshape(len(values), -1)]
    if std is not None:
        header += [f"node{n}_std" for n in nodes]
        table.append(std)
    columns = np.hstack(table)
    formats = ["%.10g", *[f"%.{digits}g"] * (columns.shape[1] - 1)]
    np.savetxt(path, columns, fmt=formats, delimiter=",", header=",".join(header), comments="")


def read_csv(path: Path) -> tuple[FloatArray, dict[int, ComplexArray]]:
    """(n_freq,) frequencies and each node's complex response in plane y."""
    header = path.read_text(encoding="utf-8").split("\n", 1)[0].strip().split(",")
    table = dict(zip(header, np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).T, strict=True))
    nodes = [
        int(name[4:-3]) for name in header if name.startswith("node") and name.count("_") == 1 and name.endswith("_re")
    ]
    return table["frequency_Hz"], {n: table[f"node{n}_re"] + 1j * table[f"node{n}_im"] for n in nodes}


def write_truth(folder: Path, measured: Sequence[Run], held_out: Sequence[Run], case: Case) -> None:
    """The responses free of noise: ``<run>/ideal`` without gains and drift, ``<run>/actual`` with them; all nodes."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, runs in ((MEASURED, measured), (HELD_OUT, held_out)):
        arrays: dict[str, np.ndarray] = {}
        for run in runs:
            scale = run.level if case.quantity == "acceleration" else 1.0
            arrays |= {
                f"{run.name}/frequency_Hz": run.frequency_hz,
                f"{run.name}/ideal": scale * run.ideal,
                f"{run.name}/actual": scale * run.actual,
                f"{run.name}/std": scale * standard_error(run.actual, case.noise),
                f"{run.name}/drift": run.drift,
                f"{run.name}/gain": np.array(run.gain),
            }
        np.savez_compressed(folder / f"{name}.npz", **arrays)  # type: ignore[arg-type]


def write_json(path: Path, content: Mapping[str, object] | Sequence[object]) -> None:
    """Whole or not at all."""
    beside = path.with_name(path.name + ".part")
    beside.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    beside.replace(path)
