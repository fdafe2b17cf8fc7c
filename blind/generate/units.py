"""The same campaign in other units of mass and length: the same rig to the eye of anyone who knows no absolute size.

The unit of time stays, so that frequencies, damping ratios and relative noise are exactly those of the original.
Stiffness and damping grow with the mass, forces with mass and length, a modulus with mass over length, accelerances
with one over the mass. With powers of two every number of the data is scaled without rounding.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.blind.generate.effects import KINDS
from rigtwin.blind.generate.folder import HELD_OUT, MEASURED, TRUTH, write_json
from rigtwin.blind.generate.rig import SHIPPED_RIGS
from rigtwin.blind.generate.scale import Scale

PLAN, RIG, LABEL = "campaign.toml", "rig.toml", "label.json"

# Powers of mass and length in the unit that a key ends with; the longest ending counts.
ENDINGS = {
    "_m": (0, 1),
    "_m2": (0, 2),
    "_m4": (0, 4),
    "_kg": (1, 0),
    "_kg_m2": (1, 2),
    "_kg_per_m3": (1, -3),
    "_N": (1, 1),
    "_N_per_m": (1, 0),
    "_Ns_per_m": (1, 0),
    "_Nm_per_rad": (1, 2),
    "_Pa": (1, -1),
    "stiffness": (1, 0),
    "k_b": (1, 0),
    "levels": (1, 1),
}


def in_other_units(campaign: Path, out: Path, *, mass: float, length: float) -> None:
    """Write a campaign's copy in which every mass is ``mass`` times and every length ``length`` times what it was.

    Parameters
    ----------
    campaign : folder with measured, held_out and truth
    out : folder of the copy; its rig lies beside each campaign.toml

    Raises ValueError for a campaign that hides an effect in another form, whose extra numbers have no units.
    """
    scale = Scale(mass, length)
    for part in (MEASURED, HELD_OUT):
        factors = _write_part(campaign / part, out / part, scale)
        _write_truth(campaign / TRUTH / f"{part}.npz", out / TRUTH / f"{part}.npz", factors)
    label = json.loads((campaign / TRUTH / LABEL).read_text(encoding="utf-8"))
    write_json(out / TRUTH / LABEL, _label(label, scale) | {"campaign": out.name})


def scaled_table(table: Mapping[str, Any], scale: Scale) -> dict[str, Any]:
    """A table of a TOML or JSON file with every number scaled whose key ends with a unit.

    >>> scaled_table({"length_m": 0.5, "poisson": 0.3, "support": [{"stiffness": "k_b"}]}, Scale(length=2.0))
    {'length_m': 1.0, 'poisson': 0.3, 'support': [{'stiffness': 'k_b'}]}
    """
    return {key: _scaled(value, _factor(key, scale), scale) for key, value in table.items()}


def _scaled(value: Any, factor: float | None, scale: Scale) -> Any:
    if isinstance(value, Mapping):
        return scaled_table(value, scale)
    if isinstance(value, list):
        return [_scaled(item, factor, scale) for item in value]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return value * factor if is_number and factor is not None else value


def _factor(key: str, scale: Scale) -> float | None:
    """What the numbers under this key grow by; nothing where they have no unit of mass or length."""
    endings = [ending for ending in ENDINGS if key.endswith(ending)]
    if not endings:
        return None
    mass, length = ENDINGS[max(endings, key=len)]
    return scale.mass**mass * scale.length**length


def _write_part(folder: Path, out: Path, scale: Scale) -> dict[str, float]:
    """Rig, plan and data of one part; returns what each run's response grows by."""
    out.mkdir(parents=True, exist_ok=True)
    plan = tomllib.loads((folder / PLAN).read_text(encoding="utf-8"))
    shipped = SHIPPED_RIGS / f"{plan['rig']}.toml"
    source = shipped if shipped.exists() else folder / plan["rig"]
    rig = tomllib.loads(source.read_text(encoding="utf-8"))
    name = rig["name"].removesuffix("-in-other-units") + "-in-other-units"
    (out / RIG).write_text(as_toml(scaled_table(rig, scale) | {"name": name}), encoding="utf-8")
    told = scaled_table(plan, scale) | {"title": out.parent.name, "rig": RIG}
    (out / PLAN).write_text(as_toml(told), encoding="utf-8")
    factors = {}
    for run in plan["run"]:
        factor = scale.length if run["quantity"] == "acceleration" else 1 / scale.mass
        _write_data(folder / run["file"], out / run["file"], factor)
        factors[Path(run["file"]).stem] = factor
    return factors


def _write_data(file: Path, out: Path, factor: float) -> None:
    """A CSV with everything scaled but its frequencies; to the last digit."""
    header = file.read_text(encoding="utf-8").split("\n", 1)[0].strip()
    table = np.loadtxt(file, delimiter=",", skiprows=1, ndmin=2)
    table[:, 1:] *= factor
    np.savetxt(out, table, fmt="%.17g", delimiter=",", header=header, comments="")


def _write_truth(file: Path, out: Path, factors: Mapping[str, float]) -> None:
    """The responses free of noise; frequencies, drifts and gains have no unit that changes."""
    out.parent.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, np.ndarray] = {}
    with np.load(file) as truth:
        for key in truth.files:
            run, name = key.rsplit("/", 1)
            arrays[key] = truth[key] * factors[run] if name in ("ideal", "actual", "std") else truth[key]
    np.savez_compressed(out, **arrays)  # type: ignore[arg-type]


def _label(label: Mapping[str, Any], scale: Scale) -> dict[str, Any]:
    """Of the copy: its effects' numbers have units of their own."""
    effects = []
    for effect in label["effects"]:
        if effect["form"]:
            raise ValueError(
                f"campaign {label['campaign']} hides {effect['id']} in another form; its extras have no units"
            )
        ranges = KINDS[effect["id"]].ranges
        numbers = {name: value * scale.of(ranges[name].unit) for name, value in effect["parameters"].items()}
        place = scaled_table(effect["location"], scale)
        effects.append(effect | {"parameters": numbers, "location": place})
    return scaled_table({key: value for key, value in label.items() if key != "effects"}, scale) | {"effects": effects}


def as_toml(table: Mapping[str, Any]) -> str:
    """A table of numbers, texts, lists, tables and lists of tables, one level deep.

    >>> print(as_toml({"name": "a", "k_b": {"start_N_per_m": 1e7}}).strip())
    name = "a"
    <BLANKLINE>
    [k_b]
    start_N_per_m = 10000000.0
    """
    plain = {key: value for key, value in table.items() if not isinstance(value, Mapping) and not _is_tables(value)}
    lines = [_line(key, value) for key, value in plain.items()]
    for key, value in table.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{key}]", *(_line(k, v) for k, v in value.items())]
        elif _is_tables(value):
            for entry in value:
                lines += ["", f"[[{key}]]", *(_line(k, v) for k, v in entry.items())]
    return "\n".join(lines) + "\n"


def _is_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _line(key: str, value: object) -> str:
    """JSON's texts, truths and lists of numbers are TOML's."""
    return f"{key} = {json.dumps(value, ensure_ascii=False)}"
