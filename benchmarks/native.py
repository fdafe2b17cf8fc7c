"""The self-contained FMUs against pythonfmu's: ``python -m benchmarks.native`` writes docs/native-fmus.md."""

from __future__ import annotations

import ctypes
import json
import resource
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.page import DOCS, bar, best_seconds, machine
from rigtwin.estimator.runtime import StiffnessEstimator
from rigtwin.fmu_src.build import (
    FMI_HEADERS,
    build_estimator_fmu,
    build_native_estimator_fmu,
    build_native_rotor_fmu,
    build_rotor_fmu,
)
from rigtwin.fmu_src.compiling import compile_library, this_machine
from rigtwin.fmu_src.rotor_variables import effects_in_fmu
from rigtwin.rotor.effects import EFFECTS
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep

EMPTY_MODEL = Path(__file__).with_name("empty_model.c")

# The comparison's drive, under which every effect's motion becomes periodic; 10 s in steps of 1 ms.
DRIVE = {"force_amplitude": 20.0, "force_frequency": 50.0, "bearing_damping": 20.0, "shaft_damping_ratio": 0.005}
STEP, N_STEPS, PER_PERIOD = 1e-3, 10_000, 20

# What it takes besides for an effect to be felt, and to leave the motion periodic.
SPECIAL = {
    "compliant_rigid_support": {"rigid_support": True},
    "bearing_clearance": {"bearing_clearance.preload": 20.0},
    "rub": {"rub.gap": 1e-5},
}

CALLS = """#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
void network(const float *features, float *estimate);
EXPORT void calls(int n, const float *features, float *estimates)
{
    for (int i = 0; i < n; i++)
        network(features + 6 * i, estimates + 5 * i);
}
"""

# A motion that repeats no better than this is left to chance, digit by digit.
PERIODIC = 1e-6
CYCLES = 10_000


@dataclass(frozen=True)
class Agreement:
    """Largest difference of the two FMUs over all outputs, of each output's peak."""

    effect: str
    family: str
    worst: float
    spread: float  # change from the last period but one to the last, of the peak
    python_seconds: float
    native_seconds: float


def main() -> None:
    """Build, measure, print, write the page."""
    rig, target = load_rig("nit-rourkela"), [this_machine()]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        slow, fast = build_rotor_fmu(rig, folder), build_native_rotor_fmu(rig, folder / "native", targets=target)
        estimators = build_estimator_fmu(folder), build_native_estimator_fmu(folder / "native", targets=target)
        empty = _empty_fmu(fast, folder / "empty")
        with FmuSession(slow) as python, FmuSession(fast) as native, FmuSession(empty) as nothing:
            agreements = [
                _agreement(effect_id, python, native) for effect_id in ("", *(effect.id for effect in effects_in_fmu()))
            ]
            both = {"python": python, "native": native}
            steps = {name: _step_cost(session) for name, session in (both | {"empty": nothing}).items()}
            sweeps = {name: best_seconds(lambda s=session: _sweeps(s)) for name, session in both.items()}
            change = best_seconds(lambda: _change_k_b(native)) / 200
            growth = _growth(native)
        calls = _estimates(*estimators) | {"network": _network_call(estimators[1], folder / "calls")}
    page = _page(agreements, steps, sweeps, change, growth, calls)
    (DOCS / "native-fmus.md").write_text(page, encoding="utf-8")
    print(page)


def _agreement(effect_id: str, python: FmuSession, native: FmuSession) -> Agreement:
    start = dict(DRIVE)
    if effect_id:
        start |= EFFECTS[effect_id]().start_values()
        start |= {"spin_speed": 100.0} if EFFECTS[effect_id].family == "spinning" else {}
        start |= SPECIAL.get(effect_id, {})
    outputs = [v for v in python.variables if v.startswith("node_") or v == "force_applied"]
    readings, seconds = [], []
    for session in (python, native):
        begin = time.perf_counter()
        session.start(start)
        readings.append(session.sample(outputs, STEP, N_STEPS))
        seconds.append(time.perf_counter() - begin)
    peak = np.abs(readings[0]).max(axis=0)
    difference = np.abs(readings[1] - readings[0]).max(axis=0)
    family = EFFECTS[effect_id].family if effect_id else "nominal"
    before, last = readings[0][-2 * PER_PERIOD : -PER_PERIOD], readings[0][-PER_PERIOD:]
    spread = float(np.abs(last - before).max() / peak.max())
    return Agreement(
        effect_id or "none", family, float((difference[peak > 0] / peak[peak > 0]).max()), spread, *seconds
    )


def _step_cost(session: FmuSession, n: int = 20_000) -> float:
    """Seconds of one set, one step and seven gets through fmpy's slave, best of five."""
    session.start({"force_amplitude": 1.0})
    fmu, references = session._fmu, {v.name: v.valueReference for v in session.description.modelVariables}
    force, nodes = [references["force"]], [references[f"node_{k}.acceleration_y"] for k in range(1, 8)]
    clock = 0.0

    def loop() -> None:
        nonlocal clock
        for _ in range(n):
            fmu.setReal(force, [0.5])
            fmu.doStep(clock, 1e-4)
            clock += 1e-4
            fmu.getReal(nodes)

    return best_seconds(loop, 5) / n


def _sweeps(session: FmuSession) -> None:
    for support in ("rigid", "bearing"):
        sweep(session, Rig(support), SweepPlan())


def _change_k_b(session: FmuSession) -> None:
    session.start()
    for k in range(200):
        session.set({"k_b": 1e6 + k})


def _growth(session: FmuSession) -> float:
    """Megabytes by which the process has grown after so many instances made and freed."""
    fmu = session._fmu

    def cycles(n: int) -> float:
        for _ in range(n):
            fmu.fmi2FreeInstance(fmu.component)
            fmu.begin(lambda message: None)
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

    return -cycles(200) + cycles(CYCLES)


def _estimates(slow: Path, fast: Path) -> dict[str, float]:
    """Seconds of an estimate in each FMU, and the largest difference to onnxruntime over k_b."""
    rng, names = np.random.default_rng(0), ("k_b", "k_b_std", "k_b_low", "k_b_high")
    card = StiffnessEstimator().card
    inputs = list(card["example_inputs"])
    worst, found = 0.0, {}
    with FmuSession(slow) as python, FmuSession(fast) as native:
        for name, session in (("python", python), ("native", native)):
            session.start()
            fmu, references = session._fmu, {v.name: v.valueReference for v in session.description.modelVariables}
            given, asked = [references[i] for i in inputs], [references[n] for n in names]
            values = list(card["example_inputs"].values())

            def loop(fmu=fmu, given=given, asked=asked, values=values) -> None:
                for _ in range(5000):
                    fmu.setReal(given, values)
                    fmu.getReal(asked)

            found[name] = best_seconds(loop) / 5000
        for _ in range(2000):
            scale = np.exp(rng.normal(0, 1e-3, 3))
            values = np.array(list(card["example_inputs"].values()))
            values[:3] *= scale
            answers = []
            for session in (python, native):
                session.start(dict(zip(inputs, values.tolist(), strict=True)))
                answers.append(np.array(session.get(names)))
            worst = max(worst, float(np.abs(answers[1] - answers[0]).max() / answers[0][0]))
    return found | {"difference": worst}


def _network_call(fmu: Path, folder: Path, n: int = 200_000) -> float:
    """Seconds of a call of the estimator's network by C, at inputs that differ from call to call."""
    shutil.unpack_archive(fmu, folder, format="zip")
    target, sources, library = this_machine(), folder / "sources", folder / f"calls{this_machine().suffix}"
    (sources / "calls.c").write_text(CALLS, encoding="utf-8")
    compile_library(sources, ["calls.c", "network.c"], target, library)
    inputs = np.array(list(StiffnessEstimator().card["example_inputs"].values()))
    features = (inputs * np.exp(np.random.default_rng(0).normal(0, 1e-3, (n, 6)))).astype(np.float32)
    answers = np.empty((n, 5), dtype=np.float32)
    calls = ctypes.CDLL(str(library)).calls
    calls.argtypes = [ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]
    return best_seconds(lambda: calls(n, features.ctypes.data, answers.ctypes.data)) / n


def _empty_fmu(fmu: Path, folder: Path) -> Path:
    """The same FMU with a model that does nothing: what FMI itself costs."""
    shutil.unpack_archive(fmu, folder, format="zip")
    target, sources = this_machine(), folder / "sources"
    shutil.copy(EMPTY_MODEL, sources)
    for header in FMI_HEADERS.glob("fmi2*.h"):
        shutil.copy(header, sources)
    library = folder / "binaries" / target.folder("2.0") / f"{fmu.stem}{target.suffix}"
    compile_library(sources, ["empty_model.c", "fmi2.c", "instance.c", "variables.c"], target, library)
    packed = shutil.make_archive(str(folder.with_name("empty_fmu")), "zip", folder)
    return Path(packed).rename(folder.with_name("empty.fmu"))


def _page(
    agreements: list[Agreement], steps: dict[str, float], sweeps: dict[str, float], change: float, growth: float,
    calls: dict[str, float],
) -> str:  # fmt: skip
    rows = "\n".join(
        f"| {a.effect} | {a.family} | {a.worst:.1e} | {a.spread:.0e} | {a.python_seconds / a.native_seconds:.0f} |"
        for a in agreements
    )
    linear = max(a.worst for a in agreements if a.family != "nonlinear")
    other = max(a.worst for a in agreements if a.family == "nonlinear" and a.spread < PERIODIC)
    chance = ", ".join(a.effect for a in agreements if a.spread >= PERIODIC and a.family == "nonlinear") or "none"
    over_empty = steps["native"] / steps["empty"]
    grown = f"growth of the process memory after {CYCLES} instances were created and freed"
    drive, special = json.dumps(DRIVE), json.dumps({k: v for values in SPECIAL.values() for k, v in values.items()})
    return f"""# The self-contained FMUs, measured

This page compares the self-contained FMUs, which are compiled from C and need no Python, with the FMUs that pythonfmu
builds and that run in a Python interpreter. `python -m benchmarks.native` writes it ({machine()}). The times depend on
the machine, so quote the ratios and not the seconds.

## The same motion

Both versions of `RotorRig.fmu` are run with each of the FMU's effects switched on in turn, for {N_STEPS * STEP:g} s in
steps of {STEP:g} s. All runs have the inputs and parameters `{drive}`. Some effects need more to be felt and to give a
periodic motion; their runs have, in addition, the entry that belongs to them of `{special}`. Spinning effects are run
at 100 rad/s.

The column "difference" is the largest difference between the two versions over all outputs, relative to the peak of the
output. The column "repeats to" says how much the motion changes from the last period but one to the last. The column
"times faster" compares the running times, the loop of the virtual rig included.

| effect | family | difference | repeats to | times faster |
|:--|:--|--:|--:|--:|
{rows}

{bar("largest difference, linear effects", linear, at_most=1e-9)}
{bar("largest difference, nonlinear effects with a periodic motion", other, at_most=1e-6)}
If a motion is not periodic, the two versions may differ because rounding in the last digits grows with time. Nonlinear
effects of this kind: {chance}.

## Cost

| what | pythonfmu | self-contained | times faster |
|:--|--:|--:|--:|
| one step through fmpy: 1 set, doStep, 7 gets | {1e6 * steps["python"]:.1f} µs | {1e6 * steps["native"]:.1f} µs | \
{steps["python"] / steps["native"]:.1f} |
| sweep on both supports, refined around resonances, 7 nodes | {sweeps["python"]:.2f} s | {sweeps["native"]:.2f} s | \
{sweeps["python"] / sweeps["native"]:.1f} |
| one estimate through fmpy: set, get | {1e6 * calls["python"]:.1f} µs | {1e6 * calls["native"]:.1f} µs | \
{calls["python"] / calls["native"]:.1f} |

{bar("time of a step divided by that of an empty FMU with the same variables", over_empty, at_most=1.3)}
{bar("sweep on both supports", sweeps["native"], at_most=0.7, unit="s")}
{bar("a call of the estimator's network from C", 1e6 * calls["network"], at_most=1.0, unit="µs")}
{bar("difference between the estimator in C and onnxruntime, relative to k_b", calls["difference"], at_most=1e-6)}
{bar(grown, growth, at_most=0.1, unit="MB")}
Changing k_b while the FMU runs takes {1e3 * change:.2f} ms, because its core computes the matrices and the modes again.
The matrices that advance the motion by one step are computed with the next step.
"""


if __name__ == "__main__":
    main()
