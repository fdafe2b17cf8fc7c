"""Two rotors and the estimator in libcosim, a co-simulation master in C++ that knows no Python.

    python examples/in_libcosim.py

The first rotor stands on rigid supports and the second on bearings. The built-in sine of the first
rotor drives the second one through a connection. The estimator turns the paper's measured numbers
into k_b.
It needs `pip install libcosimpy` and a C compiler or `pip install ziglang`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from fmpy import read_model_description
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from rigtwin.fmu_src.build import build_native_estimator_fmu, build_native_rotor_fmu
from rigtwin.fmu_src.compiling import this_machine
from rigtwin.rotor.geometry.rig import load_rig

STEP = 1e-3  # [s]
MEASURED = {"delta_f1": 25.0, "delta_f2": 130.0, "amplitude_ratio": 0.78}
ERRORS = {"delta_f1_std": 2.1, "delta_f2_std": 4.2, "amplitude_ratio_std": 0.08}


def references(fmu: Path) -> dict[str, int]:
    """Value references of an FMU's variables, by name."""
    return {v.name: v.valueReference for v in read_model_description(str(fmu)).modelVariables}


def main() -> None:
    """Build the FMUs, connect them, run, and read the results."""
    log_output_level(CosimLogLevel.WARNING)
    with tempfile.TemporaryDirectory() as folder:
        rotor = build_native_rotor_fmu(load_rig("nit-rourkela"), Path(folder), targets=[this_machine()])
        estimator = build_native_estimator_fmu(Path(folder), targets=[this_machine()])
        execution = CosimExecution.from_step_size(step_size=int(STEP * 1e9))
        rigid, bearing, network = (
            execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name=name))
            for name, fmu in (("rigid", rotor), ("bearing", rotor), ("network", estimator))
        )
        of_rotor, of_estimator = references(rotor), references(estimator)
        execution.boolean_initial_value(rigid, of_rotor["rigid_support"], True)
        execution.real_initial_value(bearing, of_rotor["k_b"], 1.1e6)
        execution.connect_real_variables(rigid, of_rotor["force_applied"], bearing, of_rotor["force"])
        settings, readings = CosimManipulator.create_override(), CosimObserver.create_last_value()
        execution.add_manipulator(settings)
        execution.add_observer(readings)
        sine = [of_rotor["force_amplitude"], of_rotor["force_frequency"]]
        settings.slave_real_values(slave_index=rigid, variable_references=sine, values=[1.0, 60.0])
        measured = MEASURED | ERRORS
        settings.slave_real_values(
            slave_index=network,
            variable_references=[of_estimator[name] for name in measured],
            values=list(measured.values()),
        )
        peaks = {rigid: 0.0, bearing: 0.0}
        for _ in range(2000):
            execution.step()
            for slave, peak in peaks.items():
                (now,) = readings.last_real_values(
                    slave_index=slave, variable_references=[of_rotor["node_2.acceleration_y"]]
                )
                peaks[slave] = max(peak, abs(now))
        (k_b,) = readings.last_real_values(slave_index=network, variable_references=[of_estimator["k_b"]])
    print(f"node 2 at 60 Hz: {peaks[rigid]:.2f} m/s2 on rigid supports, {peaks[bearing]:.2f} m/s2 on bearings")
    print(f"the paper's measured shifts and ratio: k_b = {k_b / 1e6:.3f} MN/m")
    assert np.isclose(k_b, 1.112e6, rtol=0.01)
    assert 1.5 * peaks[rigid] < peaks[bearing]


if __name__ == "__main__":
    main()
