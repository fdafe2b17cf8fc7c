"""Measure a bearing's stiffness on the virtual rig: python examples/measure_k_b.py

The rotor in RotorRig.fmu is measured with two stepped sines, on rigid supports and on bearings. The
modal fits give three numbers: two frequency shifts and an amplitude ratio. StiffnessEstimator.fmu
turns them into k_b. On a real rig the two runs come from files: rigtwin.sim.formats.read_run.
"""

import tempfile
from pathlib import Path

from rigtwin.estimator.features import FEATURE_NAMES, features_of_runs
from rigtwin.fmu_src.build import build_estimator_fmu, build_rotor_fmu
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.sensors import SensorNoise
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep

TRUE_K_B = 6.2e6  # [N/m], the estimator has to find it
BEARINGS = {"k_b": TRUE_K_B, "bearing_damping": 8.0}  # [N s/m]
PLAN = SweepPlan(n_lines=96, periods=4, noise=SensorNoise(relative=0.01, seed=1))


def main() -> float:
    """Build, measure, estimate; returns the estimate [N/m]."""
    with tempfile.TemporaryDirectory() as folder:
        rotor_fmu = build_rotor_fmu(load_rig("nit-rourkela"), Path(folder))
        estimator_fmu = build_estimator_fmu(Path(folder))

        with FmuSession(rotor_fmu) as session:
            rigid = sweep(session, Rig("rigid", parameters=BEARINGS), PLAN).run
            bearing = sweep(session, Rig("bearing", parameters=BEARINGS), PLAN).run
        features = features_of_runs(rigid, bearing)

        with FmuSession(estimator_fmu) as session:
            session.start(dict(zip(FEATURE_NAMES, features.as_array().tolist(), strict=True)))
            k_b, std, valid = session.get(["k_b", "k_b_std", "valid"])

    print(
        f"shifts {features.delta_f1:.4f} and {features.delta_f2:.4f} Hz, amplitude ratio {features.amplitude_ratio:.4f}"
    )
    print(f"k_b = {k_b:.4g} +- {std:.1g} N/m, true {TRUE_K_B:g} N/m, valid: {bool(valid)}")
    # The error of the network itself is a few 1e-4. The noise of 1 % on every line adds less.
    assert valid
    assert abs(k_b / TRUE_K_B - 1) < 2e-3
    return k_b


if __name__ == "__main__":
    main()
