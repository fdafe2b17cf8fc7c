"""Records as a laboratory's oscilloscope makes them: python examples/oscilloscope_records.py FOLDER

The virtual rig runs a stepped sine on rigid supports and on bearings, and a virtual oscilloscope with
8 bits and 2 % of noise stores one CSV per frequency: channel 1 is the force, channel 2 the
accelerometer at node 2. `rigtwin reduce` makes runs of them (docs/reduce.md).
"""

import sys
import tempfile
from pathlib import Path

from rigtwin.api.fmus import build_rotor_for_the_rig
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.sim.oscilloscope import Oscilloscope, file_name, record_lines, write_record
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep

TRUE_K_B = 6.2e6  # [N/m]
BEARINGS = {"k_b": TRUE_K_B, "bearing_damping": 20.0, "shaft_damping_ratio": 0.003}
PLAN = SweepPlan(n_lines=96)
NODES = (2,)


def main(out: Path) -> int:
    """Write the folders `rigid` and `bearing` and the plan; returns the number of records."""
    scope, count = Oscilloscope(seed=1), 0
    out.mkdir(parents=True, exist_ok=True)
    (out / "plan.toml").write_text(scope.plan(NODES), encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_rotor_for_the_rig(load_rig("nit-rourkela"), Path(folder))
        with FmuSession(fmu) as session:
            for support in ("rigid", "bearing"):
                (out / support).mkdir(exist_ok=True)
                rig = Rig(support, parameters=BEARINGS)
                lines = sweep(session, rig, PLAN).run.frequency_hz
                for frequency, interval, volts in record_lines(session, rig, lines, NODES, scope):
                    write_record(out / support / file_name(frequency), interval, volts)
                    count += 1
    print(f"{count} records in {out}, k_b = {TRUE_K_B:g} N/m")
    assert count > 2 * PLAN.n_lines
    return count


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "records"))
