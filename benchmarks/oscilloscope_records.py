"""k_b from an oscilloscope's records and from the sweep itself: ``python -m benchmarks.oscilloscope_records``; minutes.

The virtual rig measures the shipped rotor on both supports. Then a virtual oscilloscope with 8 bits and 2 % of noise
records every line, and ``rigtwin reduce`` makes runs of the files. Both ways end in the shipped estimator.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.page import bar, machine, table
from rigtwin.api.fmus import open_estimator, rotor_fmu
from rigtwin.commands.reduce import ReduceRequest, reduce_records
from rigtwin.estimator.features import features_of_runs
from rigtwin.sim.campaign import Run, SupportKind
from rigtwin.sim.formats import read_run, write_run
from rigtwin.sim.oscilloscope import Oscilloscope, file_name, record_lines, write_record
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep

STIFFNESSES = (1.3e6, 6.2e6, 4.7e7)  # [N/m], those of the demo
PLAN, NODE = SweepPlan(n_lines=96), 2
SUPPORTS: tuple[SupportKind, ...] = ("rigid", "bearing")

Pair = tuple[Run, Run]


def main() -> None:
    """Measure, record, reduce, print."""
    rows, differences, coverage = [], [], []
    with rotor_fmu("nit-rourkela") as fmu, open_estimator(None) as (ask, _), tempfile.TemporaryDirectory() as folder:
        for number, k_b in enumerate(STIFFNESSES):
            with FmuSession(fmu) as session:
                swept, recorded = _both_ways(session, k_b, Path(folder) / str(number), seed=number)
            by_sweep, by_records = (ask(features_of_runs(*pair)) for pair in (swept, recorded))
            differences.append(abs(by_records.k_b / by_sweep.k_b - 1))
            coverage += [_scaled_errors(*pair) for pair in zip(swept, recorded, strict=True)]
            values = (k_b, by_sweep.k_b, by_records.k_b, by_records.k_b_std)
            numbers = [f"{value / 1e6:.5g}" for value in values]
            rows.append((*numbers, f"{100 * differences[-1]:.2g} %"))
    header = ("true k_b, MN/m", "from the sweep", "from the records", "standard error", "difference")
    print(f"{machine()}\n\n{table(header, rows)}")
    print(bar("largest difference of k_b from records and from the sweep", max(differences), at_most=0.01))
    print(f"|error|²/standard error² of the lines, mean (1 is right): {np.mean(np.concatenate(coverage)):.2f}")


def _both_ways(session: FmuSession, k_b: float, folder: Path, seed: int) -> tuple[Pair, Pair]:
    """Rigid and bearing run as the sweep measures them, and as they come from records."""
    scope, swept, recorded = Oscilloscope(seed=seed), [], []
    for support in SUPPORTS:
        rig = Rig(support, parameters={"k_b": k_b, "bearing_damping": 20.0, "shaft_damping_ratio": 0.003})
        run = sweep(session, rig, PLAN).run
        records = folder / support
        records.mkdir(parents=True)
        for frequency, interval, volts in record_lines(session, rig, run.frequency_hz, (NODE,), scope):
            write_record(records / file_name(frequency), interval, volts)
        (folder / "plan.toml").write_text(scope.plan((NODE,)), encoding="utf-8")
        out = folder / f"{support}.csv"
        request = ReduceRequest((records,), out, folder / "plan.toml", (), {}, (f"support={support}",), as_json=False)
        write_run(reduce_records(request).run, out)
        swept.append(run)
        recorded.append(read_run(out, support=support))
    return (swept[0], swept[1]), (recorded[0], recorded[1])


def _scaled_errors(swept: Run, recorded: Run) -> np.ndarray:
    """(n_freq,) squared errors of the recorded lines over the squares of their standard errors."""
    true = swept.channel(NODE)
    assert recorded.std is not None
    return np.abs(recorded.H[:, 0] - true) ** 2 / recorded.std[:, 0] ** 2


if __name__ == "__main__":
    main()
