"""Both FMUs in one SSP: a hammer blow on two rotors, and k_b from the estimator.

    python examples/ssp_hammer_test.py

The system contains the rotor on rigid supports, the rotor on bearings and the estimator. A force
pulse hits both rotors. Their ring-down gives two frequency responses, and these give the frequency
shifts and the amplitude ratio. The three numbers go back into the system, where the estimator
turns them into k_b.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fmpy.ssp.simulation import simulate_ssp

from rigtwin.estimator.features import FEATURE_NAMES, features_of_runs
from rigtwin.fmu_src.build import build_estimator_fmu, build_rotor_fmu
from rigtwin.fmu_src.ssp import write_ssp
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.campaign import Channel, Run

TRUE_K_B = 8e6  # [N/m]
STEP = 1e-4  # [s]
RING_DOWN = 4.0  # [s], long enough for a damping ratio of 0.5 %


@dataclass(frozen=True)
class Parameter:
    """A start value in the form that fmpy's SSP simulation takes."""

    name: str
    value: float


@dataclass(frozen=True)
class ParameterSet:
    """Start values of the system. fmpy does not read those inside the SSP, so they are passed to it like this."""

    parameters: list[Parameter]


START_VALUES = ParameterSet(
    [
        Parameter("rigid.rigid_support", 1.0),
        Parameter("rigid.shaft_damping_ratio", 0.005),
        Parameter("bearing.shaft_damping_ratio", 0.005),
        Parameter("bearing.k_b", TRUE_K_B),
    ]
)


def hammer(t: float, duration: float = 3e-3, peak: float = 100.0) -> float:
    """Force of a soft hammer tip [N]: a smooth pulse that leaves the modes above 1 kHz alone.

    A pulse of a single sample would excite modes of many kHz, which sampling would fold into the band.
    """
    return peak * np.sin(np.pi * t / duration) ** 2 if t < duration else 0.0


def frequency_response(result: np.ndarray, rig: str) -> Run:
    """Accelerance at node 2 from a ring-down: response spectrum over force spectrum."""
    frequency = np.fft.rfftfreq(len(result), STEP)
    band = (frequency > 20) & (frequency < 400)
    response, force = (np.fft.rfft(result[name])[band] for name in (f"{rig}_node_2", f"{rig}_force"))
    H = (response / force)[:, None]
    return Run(frequency[band], H, (Channel(2),), support=rig, name=f"hammer, {rig}")  # type: ignore[arg-type]


def measure(ssp: Path) -> float:
    """k_b [N/m] that the system itself finds."""
    blow = {"force": hammer}
    ring_down = simulate_ssp(str(ssp), stop_time=RING_DOWN, step_size=STEP, parameter_set=START_VALUES, input=blow)
    features = features_of_runs(*(frequency_response(ring_down, rig) for rig in ("rigid", "bearing")))
    values = zip(FEATURE_NAMES, features.as_array().tolist(), strict=True)
    constants = {name: lambda t, value=value: value for name, value in values}
    result = simulate_ssp(str(ssp), stop_time=4 * STEP, step_size=STEP, parameter_set=START_VALUES, input=constants)
    print(f"shifts {features.delta_f1:.3f} and {features.delta_f2:.3f} Hz, ratio {features.amplitude_ratio:.3f}")
    print(f"k_b = {result['k_b'][-1]:.4g} N/m, valid: {bool(result['valid'][-1])}, true: {TRUE_K_B:.4g} N/m")
    assert result["valid"][-1]
    return float(result["k_b"][-1])


def main() -> None:
    """Build the FMUs, pack them, measure, and check k_b."""
    with tempfile.TemporaryDirectory() as folder:
        fmus = build_rotor_fmu(load_rig("nit-rourkela"), Path(folder)), build_estimator_fmu(Path(folder))
        k_b = measure(write_ssp(*fmus, Path(folder) / "StiffnessTest.ssp"))
    assert abs(k_b / TRUE_K_B - 1) < 0.005, k_b


if __name__ == "__main__":
    main()
