"""Golden values from ROSS: writes golden.json. Runs in the environment that README.md describes.

OPENBLAS_NUM_THREADS=1 <environment>/bin/python benchmarks/ross/generate.py
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import crack
import model
import numpy as np
import rub
import spinning
import standing

CASES: tuple[Callable[[], model.Case], ...] = (
    standing.element,
    standing.nominal,
    standing.attached_mass,
    standing.exciter_suspension,
    standing.disk_inertia,
    standing.axial_load,
    standing.bearing_tilt_stiffness,
    standing.pedestal_flexibility,
    standing.bearing_asymmetry,
    standing.bearing_offset,
    standing.plane_anisotropy,
    crack.open_crack,
    spinning.gyroscopic,
    spinning.unbalance,
    spinning.harmonic_balance,
    rub.rub,
)
PACKAGES = ("ross-rotordynamics", "numpy", "scipy", "pandas", "numba")
CONVENTIONS = {
    "axes": "ours: x along the shaft, y and z lateral; ROSS' (x, y, z, alpha, beta, theta) are our "
    "(y, z, x, theta_y, theta_z, theta_x). Everything in this file is in our names",
    "spin": "positive about +x, y turns to z; forward whirl turns the same way",
    "nodes": "rig nodes count from 1 at the left end; arrays over nodes hold nodes 1 to 7",
    "time": "e^{+i omega t}, peak amplitudes",
    "receptance": "displacement over force [m/N] for 1 N in y at node 2, [line][node]; accelerance is -omega^2 times "
    "it. A list of responses goes with the case's other lists; where it is shorter than k_b_N_per_m, with the first of "
    "k_b_N_per_m",
    "f_hz": "undamped natural frequencies at standstill, ascending, of plane y where the key says nothing else",
    "damping": "every bearing has 100 N s/m in y and z unless a case says otherwise; the shaft has none",
    "checks": "relative differences of the same numbers solved another way, mostly by ROSS' own analysis methods",
    "units": "SI; Hz and degrees where the name says so",
}


def main() -> None:
    """Run every case and write golden.json beside this file."""
    golden = {
        "ross": {name: version(name) for name in PACKAGES},
        "conventions": CONVENTIONS,
        "rotor": rotor(),
        "cases": {case.__name__: timed(case) for case in CASES},
    }
    Path(__file__).with_name("golden.json").write_text(dump(golden) + "\n", encoding="utf-8")


def timed(case: Callable[[], model.Case]) -> model.Case:
    """Run a case and say how long it took."""
    start = time.perf_counter()
    result = {"what": " ".join((case.__doc__ or "").split()), **case()}
    print(f"{case.__name__:24s}{time.perf_counter() - start:6.1f} s", flush=True)
    return result


def rotor() -> model.Case:
    """What all cases share."""
    return {
        "nodes_m": model.NODES_M,
        "elements_per_span": model.ELEMENTS_PER_SPAN,
        "elements": len(model.mesh(model.Options())) - 1,
        "element": "Timoshenko with rotary inertia, Cowper's shear factor",
        "diameter_m": model.DIAMETER_M,
        "youngs_modulus_Pa": model.YOUNGS_MODULUS_PA,
        "density_kg_per_m3": model.DENSITY,
        "poisson": model.POISSON,
        "disk_nodes": model.DISK_NODES,
        "disk_mass_kg": model.DISK_MASS_KG,
        "solid_disk_diametral_inertia_kg_m2": model.DISK_ID_KG_M2,
        "solid_disk_polar_inertia_kg_m2": model.DISK_IP_KG_M2,
        "bearing_nodes": (1, len(model.NODES_M)),
        "bearing_damping_Ns_per_m": model.BEARING_DAMPING_NS_PER_M,
        "force_node": model.FORCE_NODE,
    }


def dump(value: Any, indent: str = "") -> str:
    """JSON with twelve digits, one row of numbers per line."""
    if isinstance(value, dict):
        items = [f"{indent}  {json.dumps(key)}: {dump(item, indent + '  ')}" for key, item in value.items()]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, (list, tuple, np.ndarray)):
        if all(isinstance(item, (int, float, str)) for item in value):
            return "[" + ", ".join(dump(item) for item in value) + "]"
        return "[\n" + ",\n".join(f"{indent}  {dump(item, indent + '  ')}" for item in value) + f"\n{indent}]"
    if isinstance(value, (float, np.floating)):
        assert np.isfinite(value), "not a number"
        return json.dumps(float(f"{value + 0.0:.12g}"))
    if isinstance(value, np.integer):
        value = int(value)
    return json.dumps(value)


if __name__ == "__main__":
    main()
