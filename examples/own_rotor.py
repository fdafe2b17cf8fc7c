"""A rotor of your own, from its TOML to its bearing's stiffness: python examples/own_rotor.py

The shipped network knows only the paper's rotor. For another rotor you can train a network
(rigtwin train --rig examples/own_rotor.toml), or find k_b on the finite-element model, as it is done here.
"""

import tempfile
from pathlib import Path

from rigtwin.estimator.features import features_of_runs
from rigtwin.estimator.root_finding import StiffnessFinder
from rigtwin.fmu_src.build import build_rotor_fmu
from rigtwin.rotor.frequency.modal import natural_frequencies_hz
from rigtwin.rotor.geometry.assembly import assemble
from rigtwin.rotor.geometry.rig import load_rig
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.sim.session import FmuSession
from rigtwin.sim.stepped_sine import Rig, SweepPlan, sweep

TRUE_K_B = 3.4e6  # [N/m]


def main() -> float:
    """Build, measure, find k_b; returns the stiffness found [N/m]."""
    rig = load_rig(Path(__file__).with_name("own_rotor.toml"))
    structure = assemble(rig)
    f_rigid = natural_frequencies_hz(build_system(structure, Condition(rigid_support=True)), plane=1)
    print(f"rigid supports: f1 = {f_rigid[0]:.2f} Hz, f2 = {f_rigid[1]:.2f} Hz")

    plan = SweepPlan(f_min_hz=0.3 * f_rigid[0], f_max_hz=1.2 * f_rigid[1], n_lines=96)
    with tempfile.TemporaryDirectory() as folder, FmuSession(build_rotor_fmu(rig, Path(folder))) as session:
        setups = [Rig(s, rig.excitation_node, parameters={"k_b": TRUE_K_B}) for s in ("rigid", "bearing")]
        rigid, bearing = (sweep(session, setup, plan).run for setup in setups)
    features = features_of_runs(rigid, bearing)

    damping = Condition(shaft_damping_ratio=rig.shaft_damping_ratio)
    k_b = StiffnessFinder(structure, damping, node=rig.excitation_node).from_shift(1, features.delta_f1)
    print(f"shift of mode 1: {features.delta_f1:.5f} Hz, so k_b = {k_b:.6g} N/m; true {TRUE_K_B:g} N/m")
    # The frequencies of the virtual rig have an error of 1e-8, and the shift is a sixth of the frequency.
    assert abs(k_b / TRUE_K_B - 1) < 1e-5
    return k_b


if __name__ == "__main__":
    main()
